//! What an integrator integrates.

use phipsi_model::Model;

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
}
