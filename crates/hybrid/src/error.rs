//! What can be wrong with a question about an under-actuated system.

use phipsi_recursion::DynamicsError;
use phipsi_topology::OperatorError;
use std::fmt;

/// Why there is no answer.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum HybridError {
    /// A recursion's error.
    Dynamics(DynamicsError),
    /// An operator's error.
    Operator(OperatorError),
    /// More placements than can be tried.
    TooMany {
        /// How many there are.
        placements: u128,
        /// How many may be.
        limit: u128,
    },
    /// A number of actuators that there cannot be.
    Count {
        /// The number.
        actuators: usize,
        /// How many places there are.
        candidates: usize,
    },
}

impl fmt::Display for HybridError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            HybridError::Dynamics(error) => error.fmt(f),
            HybridError::Operator(error) => error.fmt(f),
            HybridError::TooMany { placements, limit } => write!(
                f,
                "there are {placements} placements, more than {limit}: name fewer candidates or another number of actuators"
            ),
            HybridError::Count { actuators, candidates } => {
                write!(f, "{actuators} actuators cannot stand in {candidates} places: 1 to {candidates} can")
            }
        }
    }
}

impl std::error::Error for HybridError {}

impl From<DynamicsError> for HybridError {
    fn from(error: DynamicsError) -> Self {
        HybridError::Dynamics(error)
    }
}

impl From<OperatorError> for HybridError {
    fn from(error: OperatorError) -> Self {
        HybridError::Operator(error)
    }
}
