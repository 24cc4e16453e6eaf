//! Why a step of the midpoint method could not be made.

use phipsi_closure::ClosureError;
use phipsi_recursion::DynamicsError;
use std::fmt;

/// Why a step could not be made; the state before it is intact.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum MidpointError<E> {
    /// The forces have no value.
    Force {
        /// Time at the end of the step.
        t: f64,
        /// Why.
        cause: E,
    },
    /// A recursion failed.
    Dynamics {
        /// Time.
        t: f64,
        /// Why.
        cause: DynamicsError,
    },
    /// The loops: a coupling that cannot be, or a start from which they do not close.
    Closure {
        /// Time.
        t: f64,
        /// Why.
        cause: ClosureError,
    },
    /// Forces or potential energy are no finite numbers.
    NotFinite {
        /// Time at the end of the step.
        t: f64,
        /// The joint whose force it is; `None` for the potential energy.
        joint: Option<String>,
    },
    /// The implicit drift does not converge.
    NotConverged {
        /// Time at the start of the step.
        t: f64,
        /// Step size.
        h: f64,
        /// Iterations made.
        iterations: usize,
        /// Size of the last correction relative to the velocity.
        correction: f64,
        /// The joint whose velocity was corrected most.
        joint: String,
    },
}

impl<E: fmt::Display> fmt::Display for MidpointError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MidpointError::Force { t, cause } => write!(f, "forces at t = {t}: {cause}"),
            MidpointError::Dynamics { t, cause } => write!(f, "at t = {t}: {cause}"),
            MidpointError::Closure { t, cause } => write!(f, "at t = {t}: {cause}"),
            MidpointError::NotFinite { t, joint: Some(joint) } => {
                write!(f, "at t = {t} the force on joint `{joint}` is not finite; take a smaller step")
            }
            MidpointError::NotFinite { t, joint: None } => {
                write!(f, "at t = {t} the potential energy is not finite; take a smaller step")
            }
            MidpointError::NotConverged { t, h, iterations, correction, joint } => write!(
                f,
                "at t = {t} a drift of {h} has not converged in {iterations} iterations (last correction \
                 {correction:.1e} of the velocity, most of it in joint `{joint}`); a drift must turn no joint far: \
                 take a smaller step, or lock the fastest joint"
            ),
        }
    }
}

impl<E: fmt::Display + fmt::Debug> std::error::Error for MidpointError<E> {}

impl<E> MidpointError<E> {
    /// Of loops, or of the tree that they are on.
    pub(crate) fn of_loops(t: f64, cause: ClosureError) -> Self {
        match cause {
            ClosureError::Dynamics(cause) => MidpointError::Dynamics { t, cause },
            cause => MidpointError::Closure { t, cause },
        }
    }
}
