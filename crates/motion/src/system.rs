//! What an integrator integrates.

use phipsi_model::Model;

/// What putting a state back onto closures and prescribed motions did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Projected {
    /// Largest residual of the closures afterwards, rad or m.
    pub position: f64,
    /// Largest residual of their rates afterwards, rad/s or m/s.
    pub velocity: f64,
    /// Kinetic energy of what was taken from the velocities, J.
    pub energy_removed: f64,
}

/// Equations of motion on the configuration space of a model, with quantities integrated beside the state.
pub trait System {
    /// Why a derivative could not be computed.
    type Error;
    /// The model whose configuration space it is.
    fn model(&self) -> &Model;
    /// Number of auxiliary quantities.
    fn auxiliary_len(&self) -> usize;
    /// Accelerations (nv) and rates of the auxiliary quantities.
    ///
    /// # Errors
    /// A trial step that meets one is tried again with a smaller size.
    fn derivative(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
        v_dot: &mut [f64],
        aux_dot: &mut [f64],
    ) -> Result<(), Self::Error>;
    /// Puts a state back onto what the system keeps exactly; `None` and no change where there is no such thing.
    ///
    /// # Errors
    /// The step that led here is then tried again with a smaller size.
    fn project(&mut self, _t: f64, _q: &mut [f64], _v: &mut [f64]) -> Result<Option<Projected>, Self::Error> {
        Ok(None)
    }
}
