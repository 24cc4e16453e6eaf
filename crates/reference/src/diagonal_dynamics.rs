//! Dynamics in the coordinates that make the dense mass matrix diagonal: M = l D l*, η = l* v.

use crate::articulated_sweep::factors;
use crate::dense::NotPositive;
use crate::inverse_dynamics::bias_forces;
use crate::inverse_dynamics_derivatives::{fixed, seeded, tangent};
use crate::mass_matrix::mass_matrix;
use phipsi_model::Model;
use phipsi_spatial::Real;

/// η = l* v = D⁻¹ l⁻¹ (M v).
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn diagonal_velocity<T: Real>(model: &Model, q: &[T], v: &[T]) -> Result<Vec<T>, NotPositive> {
    let (m, factors) = (mass_matrix(model, q), factors(model, q)?);
    let nv = model.nv();
    let momentum: Vec<T> =
        (0..nv).map(|i| (0..nv).fold(T::zero(), |sum, j| sum + m[(i, j)] * v[j])).collect();
    let innovations = factors.innovations(&momentum);
    Ok(innovations.iter().zip(factors.pivots()).map(|(x, d)| *x / d).collect())
}

/// C_D of D η̇ + C_D = l⁻¹ T, T the whole generalised force: l⁻¹ C − D (d l*/dt) v, the last by dual numbers along the motion.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn diagonal_coriolis<T: Real>(model: &Model, q: &[T], v: &[T]) -> Result<Vec<T>, NotPositive> {
    let factors = factors(model, q)?;
    let weightless = model.clone().with_gravity([0.0; 3]);
    let bias = factors.innovations(&bias_forces(&weightless, q, v));
    let moving = diagonal_velocity(model, &seeded(q, &tangent(model, q, v)), &fixed(v))?;
    let terms = bias.iter().zip(&moving).zip(factors.pivots());
    Ok(terms.map(|((c, eta), d)| *c - d * eta.rate).collect())
}

/// dD/dt along the motion, by dual numbers.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn joint_inertia_rates<T: Real>(model: &Model, q: &[T], v: &[T]) -> Result<Vec<T>, NotPositive> {
    let moving = factors(model, &seeded(q, &tangent(model, q, v)))?;
    Ok(moving.pivots().iter().map(|d| d.rate).collect())
}
