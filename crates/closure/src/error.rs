//! What can go wrong with closed loops.

use phipsi_recursion::{DynamicsError, Form};
use std::fmt;

/// Why a mechanism with loops gave no result.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum ClosureError {
    /// What can go wrong on the tree: lengths of arguments, a joint without inertia.
    Dynamics(DynamicsError),
    /// A coupling of a joint that has not exactly one degree of freedom.
    Coupling {
        /// The following joint.
        joint: String,
        /// The joint with another number of degrees of freedom: the following one or its source.
        found: String,
        /// That number.
        freedoms: usize,
    },
    /// Loops that could not be closed.
    NotClosed {
        /// The closure with the largest residual.
        closure: String,
        /// That residual, m or rad.
        residual: f64,
        /// The residual that is required.
        required: f64,
        /// Iterations done.
        iterations: usize,
    },
    /// A modal coordinate whose acceleration is given.
    PrescribedMode {
        /// Its name.
        mode: String,
    },
    /// A row of which squares do not tell whether it is redundant.
    PlainForm {
        /// The closure.
        closure: String,
        /// The row of that closure.
        row: usize,
        /// Its pivot over the scale of its loop.
        pivot: f64,
    },
    /// A form of forward dynamics that is for trees only.
    Form {
        /// The form.
        found: Form,
    },
    /// A number that is not finite.
    NotFinite {
        /// The joint.
        joint: String,
        /// Which of its degrees of freedom.
        component: usize,
        /// The number.
        found: f64,
    },
}

impl fmt::Display for ClosureError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ClosureError::Dynamics(error) => error.fmt(f),
            ClosureError::Coupling { joint, found, freedoms } => write!(
                f,
                "coupling of joint `{joint}`: joint `{found}` has {freedoms} degrees of freedom, but 1 is required; \
                 couple joints with one degree of freedom, or remove the coupling"
            ),
            ClosureError::NotClosed { closure, residual, required, iterations } => write!(
                f,
                "closure `{closure}` is open by {residual:e} m or rad after {iterations} iterations, but {required:e} is \
                 required; the loops cannot be closed from here: start nearer, or correct the lengths of the mechanism"
            ),
            ClosureError::PrescribedMode { mode } => write!(
                f,
                "mode `{mode}` is prescribed, but modes must be passive; prescribe joints, and make stiff what shall not bend"
            ),
            ClosureError::PlainForm { closure, row, pivot } => write!(
                f,
                "row {row} of closure `{closure}` has a pivot of {pivot:e}, but the plain form requires more than 1e-4, or a row \
                 that is zero by itself; solve in the form `Auto` or `Mixed`"
            ),
            ClosureError::Form { found } => write!(
                f,
                "form \"{found}\" is for trees, but loops and prescribed motions have \"plain\" and \"square_root\" only; \
                 use one of them, or \"auto\""
            ),
            ClosureError::NotFinite { joint, component, found } => write!(
                f,
                "acceleration of joint `{joint}`, degree of freedom {component}: {found}, but a finite number is required; \
                 look for inputs that are not finite or so large that products overflow"
            ),
        }
    }
}

impl std::error::Error for ClosureError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            ClosureError::Dynamics(error) => Some(error),
            _ => None,
        }
    }
}

impl From<DynamicsError> for ClosureError {
    fn from(error: DynamicsError) -> Self {
        ClosureError::Dynamics(error)
    }
}

/// Refuses a slice of the wrong length.
pub(crate) fn check_length<T>(
    argument: &'static str,
    slice: &[T],
    expected: usize,
) -> Result<(), ClosureError> {
    if slice.len() == expected {
        return Ok(());
    }
    Err(DynamicsError::Shape { argument, expected, found: slice.len() }.into())
}
