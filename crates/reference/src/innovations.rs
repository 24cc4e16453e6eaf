//! The innovations operator: the inverse of the dense unit-triangular factor of M.

use crate::articulated_sweep::factors;
use crate::dense::NotPositive;
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::Real;

/// L with L M L* = D, eliminated from the tips to the base. nv×nv.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn innovations_operator<T: Real>(model: &Model, q: &[T]) -> Result<DMatrix<T>, NotPositive> {
    let factors = factors(model, q)?;
    let nv = model.nv();
    let mut operator = DMatrix::from_element(nv, nv, T::zero());
    for j in 0..nv {
        let mut unit = vec![T::zero(); nv];
        unit[j] = T::one();
        for (i, x) in factors.innovations(&unit).into_iter().enumerate() {
            operator[(i, j)] = x;
        }
    }
    Ok(operator)
}
