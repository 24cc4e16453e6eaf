//! The gradient of ln det M: tr(M⁻¹ ∂M), with ∂M by dual numbers along the increments of q.

use crate::dense::NotPositive;
use crate::inverse_dynamics_derivatives::{seeded, tangent};
use crate::mass_matrix::mass_matrix;
use crate::mass_matrix_inverse::mass_matrix_inverse;
use phipsi_model::Model;
use phipsi_spatial::Real;

/// ∂ ln det M/∂q_j, nv.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn log_determinant_gradient<T: Real>(model: &Model, q: &[T]) -> Result<Vec<T>, NotPositive> {
    let inverse = mass_matrix_inverse(model, q)?;
    let nv = model.nv();
    let component = |j: usize| {
        let mut unit = vec![T::zero(); nv];
        unit[j] = T::one();
        let m = mass_matrix(model, &seeded(q, &tangent(model, q, &unit)));
        inverse.iter().zip(m.iter()).fold(T::zero(), |sum, (x, m)| sum + *x * m.rate)
    };
    Ok((0..nv).map(component).collect())
}
