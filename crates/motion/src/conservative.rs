//! Forces with a potential energy, for the midpoint method.

use crate::midpoint_error::MidpointError;
use phipsi_recursion::Layout;

/// Forces with a potential energy. Closures from (q, forces) to the energy are.
pub trait Conservative {
    /// Why there is no value.
    type Error;
    /// Writes the generalised forces −∂U/∂q along the joints' increments (nv) and returns the potential energy U.
    ///
    /// # Errors
    /// The step is not made.
    fn evaluate(&mut self, q: &[f64], forces: &mut [f64]) -> Result<f64, Self::Error>;
    /// True if a part that changes slowly is kept out of [`Conservative::evaluate`].
    fn has_slow(&self) -> bool {
        false
    }
    /// The slow part, as [`Conservative::evaluate`]: evaluated once in [`crate::Midpoint::substeps`] steps.
    ///
    /// # Errors
    /// The step is not made.
    fn evaluate_slow(&mut self, _: &[f64], forces: &mut [f64]) -> Result<f64, Self::Error> {
        forces.fill(0.0);
        Ok(0.0)
    }
}

impl<E, F: FnMut(&[f64], &mut [f64]) -> Result<f64, E>> Conservative for F {
    type Error = E;
    fn evaluate(&mut self, q: &[f64], forces: &mut [f64]) -> Result<f64, E> {
        self(q, forces)
    }
}

/// Which part of the forces.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Part {
    Fast,
    Slow,
}

/// Forces and potential energy of a part, if they are finite.
pub(crate) fn evaluate<C: Conservative>(
    system: &mut C,
    part: Part,
    layout: &Layout<f64>,
    t: f64,
    q: &[f64],
    forces: &mut [f64],
) -> Result<f64, MidpointError<C::Error>> {
    let found = match part {
        Part::Fast => system.evaluate(q, forces),
        Part::Slow => system.evaluate_slow(q, forces),
    };
    let potential = found.map_err(|cause| MidpointError::Force { t, cause })?;
    if let Some(i) = forces.iter().position(|f| !f.is_finite()) {
        return Err(MidpointError::NotFinite { t, joint: Some(layout.joint_of_velocity(i).0.into()) });
    }
    if potential.is_finite() { Ok(potential) } else { Err(MidpointError::NotFinite { t, joint: None }) }
}
