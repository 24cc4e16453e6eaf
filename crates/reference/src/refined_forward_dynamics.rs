//! Accelerations by dense factors, corrected once by the residual of M a + bias = τ.

use crate::dense::NotPositive;
use crate::forward_dynamics::forward_dynamics;
use crate::inverse_dynamics::inverse_dynamics;
use crate::mass_matrix_inverse::solve_mass_matrix;
use phipsi_model::Model;
use phipsi_spatial::{Real, Wrench};

/// Accelerations of generalised forces `tau` at (q, v) under external wrenches.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn refined_forward_dynamics<T: Real>(
    model: &Model,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<T>, NotPositive> {
    let first = forward_dynamics(model, q, v, tau, wrenches)?;
    let found = inverse_dynamics(model, q, v, &first, wrenches);
    let residual: Vec<T> = tau.iter().zip(&found).map(|(t, f)| *t - *f).collect();
    let correction = solve_mass_matrix(model, q, &residual)?;
    Ok(first.iter().zip(correction).map(|(a, c)| *a + c).collect())
}
