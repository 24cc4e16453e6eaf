//! Accelerations as the solution of M a = τ − bias.

use crate::dense::NotPositive;
use crate::inverse_dynamics::inverse_dynamics;
use crate::mass_matrix_inverse::solve_mass_matrix;
use phipsi_model::Model;
use phipsi_spatial::{Real, Wrench};

/// Accelerations of generalised forces `tau` at (q, v) under external wrenches.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn forward_dynamics<T: Real>(
    model: &Model,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<T>, NotPositive> {
    let bias = inverse_dynamics(model, q, v, &vec![T::zero(); model.nv()], wrenches);
    let net: Vec<T> = tau.iter().zip(&bias).map(|(t, b)| *t - *b).collect();
    solve_mass_matrix(model, q, &net)
}
