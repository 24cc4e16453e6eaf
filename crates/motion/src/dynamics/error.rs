//! What can go wrong in the equations of motion.

use crate::force::ForceError;
use phipsi_closure::ClosureError;
use phipsi_recursion::DynamicsError;
use std::fmt;

/// Why accelerations could not be computed.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum MotionError {
    /// A recursion failed.
    Dynamics(DynamicsError),
    /// A force failed.
    Force(ForceError),
    /// The midpoint method was asked for with a force that has no potential energy.
    NotConservative {
        /// Its name.
        force: String,
    },
    /// The loops of a model could not be closed or solved.
    Closure(ClosureError),
    /// A motion that is given for something that does not exist, or twice.
    Prescription {
        /// What is wrong.
        what: String,
    },
    /// The midpoint method was asked for with prescribed motions.
    Driven,
    /// Stops or dry friction that cannot be.
    Switch {
        /// What is wrong.
        what: String,
    },
    /// A joint that starts, or is put, beyond one of its stops.
    BeyondStop {
        /// The joint.
        joint: String,
        /// Where it is, rad or m.
        position: f64,
        /// Its stop.
        stop: f64,
    },
}

impl fmt::Display for MotionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MotionError::Dynamics(e) => e.fmt(f),
            MotionError::Force(e) => e.fmt(f),
            MotionError::NotConservative { force } => write!(
                f,
                "force `{force}` has no potential energy, which the midpoint method requires; \
                 use an adaptive method, or remove the force"
            ),
            MotionError::Closure(e) => e.fmt(f),
            MotionError::Prescription { what } => {
                write!(f, "{what}; give one motion for each degree of freedom of a joint or row of a closure")
            }
            MotionError::Switch { what } => f.write_str(what),
            MotionError::BeyondStop { joint, position, stop } => write!(
                f,
                "joint `{joint}` is at {position}, beyond its stop at {stop}; start it inside, or take its stops away"
            ),
            MotionError::Driven => f.write_str(
                "the midpoint method does not know prescribed motions; use \"dop853\", \"tsit5\" or \"rk4\"",
            ),
        }
    }
}

impl std::error::Error for MotionError {}

impl From<DynamicsError> for MotionError {
    fn from(e: DynamicsError) -> Self {
        MotionError::Dynamics(e)
    }
}

impl From<ClosureError> for MotionError {
    fn from(e: ClosureError) -> Self {
        match e {
            ClosureError::Dynamics(e) => MotionError::Dynamics(e),
            e => MotionError::Closure(e),
        }
    }
}

impl From<ForceError> for MotionError {
    fn from(e: ForceError) -> Self {
        MotionError::Force(e)
    }
}
