//! Forces and directions along the closures of a model, by the dense equations of closed loops at rest without weight.

use crate::closed_dynamics::{Given, angular_rows, closed_dynamics};
use crate::dense::NotPositive;
use crate::inverse_dynamics::multiply_by_mass_matrix;
use phipsi_model::Model;
use phipsi_spatial::Real;

/// x and f + J*λ with M x = f + J*λ, J x = 0; rows that are redundant below the part `tolerance` count once.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn along_closures<T: Real>(
    model: &Model,
    q: &[T],
    f: &[T],
    tolerance: f64,
) -> Result<[Vec<T>; 2], NotPositive> {
    let zero = vec![T::zero(); model.nv()];
    let given = Given {
        wrenches: None,
        gamma: vec![T::zero(); angular_rows(model).len()],
        active: vec![false; model.nv()],
        acceleration: zero.clone(),
        length: 1.0,
        tolerance,
    };
    let light = model.clone().with_gravity([0.0; 3]);
    let solution = closed_dynamics(&light, q, &zero, f, &given)?;
    let force = f.iter().zip(&solution.force).map(|(f, c)| *f + *c).collect();
    Ok([solution.acceleration, force])
}

/// The part of a direction along the closures, orthogonal to the rest in the metric M.
///
/// # Errors
/// As [`along_closures`].
pub fn tangent_part<T: Real>(model: &Model, q: &[T], d: &[T], tolerance: f64) -> Result<Vec<T>, NotPositive> {
    let [x, _] = along_closures(model, q, &multiply_by_mass_matrix(model, q, d), tolerance)?;
    Ok(x)
}
