//! What can be wrong with a question about a free-flying system.

use phipsi_recursion::DynamicsError;
use std::fmt;

/// Why there is no answer.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum FreeFlightError {
    /// A recursion's error.
    Dynamics(DynamicsError),
    /// A root that does not float.
    NotFree {
        /// Its joint.
        joint: String,
    },
    /// More than one root, where one is needed.
    Roots {
        /// How many there are.
        found: usize,
    },
    /// An active degree of freedom of the base.
    ActiveBase {
        /// Its joint.
        joint: String,
        /// Which of its degrees of freedom.
        component: usize,
    },
    /// A body on which a force meets no inertia.
    NoInertia {
        /// A joint of the layout's body.
        joint: String,
        /// The pivot that is not positive.
        pivot: f64,
    },
}

impl fmt::Display for FreeFlightError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FreeFlightError::Dynamics(error) => error.fmt(f),
            FreeFlightError::NotFree { joint } => write!(
                f,
                "joint `{joint}` holds a root to the world; two-sided dynamics needs floating roots: load the model with a free base \
                 (the inertia seen at a body of a fixed base is `operational_space_inertia`)"
            ),
            FreeFlightError::Roots { found } => {
                write!(f, "the model has {found} roots; one floating base is required")
            }
            FreeFlightError::ActiveBase { joint, component } => write!(
                f,
                "degree of freedom {component} of the base `{joint}` is active; a floating base is passive: give its wrench instead"
            ),
            FreeFlightError::NoInertia { joint, pivot } => write!(
                f,
                "the whole system, seen at the body of joint `{joint}`, has no inertia in some direction (pivot {pivot:e}); give its bodies mass"
            ),
        }
    }
}

impl std::error::Error for FreeFlightError {}

impl From<DynamicsError> for FreeFlightError {
    fn from(error: DynamicsError) -> Self {
        FreeFlightError::Dynamics(error)
    }
}
