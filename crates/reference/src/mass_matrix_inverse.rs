//! M⁻¹ and M⁻¹ x by the dense factors.

use crate::articulated_sweep::factors;
use crate::dense::NotPositive;
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::Real;

/// M⁻¹ x.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn solve_mass_matrix<T: Real>(model: &Model, q: &[T], x: &[T]) -> Result<Vec<T>, NotPositive> {
    Ok(factors(model, q)?.solve(x))
}

/// M⁻¹, nv×nv, one column after the other.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn mass_matrix_inverse<T: Real>(model: &Model, q: &[T]) -> Result<DMatrix<T>, NotPositive> {
    let factors = factors(model, q)?;
    let nv = model.nv();
    let mut inverse = DMatrix::from_element(nv, nv, T::zero());
    for j in 0..nv {
        let mut unit = vec![T::zero(); nv];
        unit[j] = T::one();
        for (i, x) in factors.solve(&unit).into_iter().enumerate() {
            inverse[(i, j)] = x;
        }
    }
    Ok(inverse)
}
