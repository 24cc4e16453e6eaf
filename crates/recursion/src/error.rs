//! What can go wrong in a recursion.

use std::fmt;

/// Why a recursion gave no result.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum DynamicsError {
    /// An argument of the wrong length.
    Shape {
        /// The argument's name.
        argument: &'static str,
        /// Required length.
        expected: usize,
        /// Found length.
        found: usize,
    },
    /// A number that no body of the model has.
    Body {
        /// The number.
        found: usize,
        /// How many bodies there are.
        count: usize,
    },
    /// An articulated joint inertia D that is not positive.
    SingularHinge {
        /// The joint's name.
        joint: String,
        /// Which of its degrees of freedom.
        component: usize,
        /// The value of D.
        inertia: f64,
    },
    /// A number of the result that is not finite.
    NotFinite {
        /// Its index in the result.
        index: usize,
        /// The number.
        found: f64,
    },
    /// A number of an input of a batch that is not finite, where inputs are looked at.
    InputNotFinite {
        /// Which input.
        input: usize,
        /// Its index in one state of the input.
        index: usize,
        /// The number.
        found: f64,
    },
    /// The model has a closure that these recursions do not close.
    Closure {
        /// The joint with the closure.
        joint: String,
        /// The joint it follows.
        source: String,
    },
    /// The model has loops that these recursions do not close.
    Loop {
        /// The closure's name.
        closure: String,
    },
    /// The model has flexible bodies, of which the algorithm knows nothing.
    Flexible {
        /// The first flexible body.
        body: String,
        /// The algorithm.
        algorithm: &'static str,
    },
    /// The model has no flexible bodies, for which alone the algorithm is.
    Rigid {
        /// The algorithm.
        algorithm: &'static str,
    },
}

impl fmt::Display for DynamicsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DynamicsError::Shape { argument, expected, found } => {
                write!(f, "`{argument}` has length {found}, but length {expected} is required")
            }
            DynamicsError::Body { found, count } => write!(
                f,
                "no body has number {found}: the model has {count}, counted from 0; look the number up by the body's name"
            ),
            DynamicsError::SingularHinge { joint, component, inertia } => write!(
                f,
                "joint `{joint}`, degree of freedom {component}: articulated inertia {inertia:e} is not positive; \
                 give the bodies outboard of it mass away from its axis, or make it fixed"
            ),
            DynamicsError::NotFinite { index, found } => write!(
                f,
                "number {index} of the result is {found}, but a finite number is required; look for inputs so large that \
                 products overflow, and for masses that are zero"
            ),
            DynamicsError::InputNotFinite { input, index, found } => {
                write!(f, "number {index} of input {input} is {found}; pass finite numbers")
            }
            DynamicsError::Closure { joint, source } => write!(
                f,
                "joint `{joint}` mimics joint `{source}`: a closure, which tree dynamics does not close; \
                 load the model with mimic = \"free\" to let the joint move freely"
            ),
            DynamicsError::Loop { closure } => write!(
                f,
                "closure `{closure}` closes a loop, which tree dynamics does not close; \
                 use the dynamics of closed loops, or the model without closures"
            ),
            DynamicsError::Flexible { body, algorithm } => write!(
                f,
                "body `{body}` is flexible, but `{algorithm}` computes with rigid bodies only; \
                 give the body no modes, or use forward or inverse dynamics"
            ),
            DynamicsError::Rigid { algorithm } => write!(
                f,
                "the model has no flexible body, but `{algorithm}` is for models that have; \
                 use `ArticulatedSweep`"
            ),
        }
    }
}

impl std::error::Error for DynamicsError {}

/// Refuses a slice of the wrong length.
pub(crate) fn check_length<T>(
    argument: &'static str,
    slice: &[T],
    expected: usize,
) -> Result<(), DynamicsError> {
    if slice.len() == expected {
        Ok(())
    } else {
        Err(DynamicsError::Shape { argument, expected, found: slice.len() })
    }
}
