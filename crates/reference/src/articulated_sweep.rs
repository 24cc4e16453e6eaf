//! Articulated joint inertias: the pivots of the dense mass matrix, eliminated from the tips to the base.

use crate::dense::{Factors, NotPositive, tips_first};
use crate::mass_matrix::mass_matrix;
use phipsi_model::Model;
use phipsi_spatial::Real;

/// The dense factors of M(q).
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn factors<T: Real>(model: &Model, q: &[T]) -> Result<Factors<T>, NotPositive> {
    Factors::new(&mass_matrix(model, q), tips_first(model), 0.0)
}

/// D of every degree of freedom.
///
/// # Errors
/// As [`factors`].
pub fn articulated_joint_inertias<T: Real>(model: &Model, q: &[T]) -> Result<Vec<T>, NotPositive> {
    Ok(factors(model, q)?.pivots())
}

/// ln det M; `ln` is taken in f64.
///
/// # Errors
/// As [`factors`].
pub fn log_determinant<T: Real>(model: &Model, q: &[T]) -> Result<f64, NotPositive> {
    Ok(factors(model, q)?.pivots().iter().map(|d| d.to_f64().ln()).sum())
}
