//! ln det(G M⁻¹ G*) of the closures of a model, and its gradient: tr(Ω⁻¹ ∂Ω), with ∂Ω by dual numbers along the increments of q.

use crate::closed_dynamics::{angular_rows, closure_jacobian};
use crate::dense::{Factors, NotPositive, tips_first};
use crate::inverse_dynamics_derivatives::{seeded, tangent};
use crate::mass_matrix::mass_matrix;
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::Real;

/// ln det Ω and its gradient, nv; angular rows count times `length`. `ln` is taken in f64.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite, or rows are redundant.
pub fn ring_determinant<T: Real>(model: &Model, q: &[T], length: f64) -> Result<(f64, Vec<T>), NotPositive> {
    let omega = omega(model, q, length)?;
    let m = omega.nrows();
    let factors = Factors::new(&omega, (0..m).collect(), 1e-14)?;
    let logarithm = factors.pivots().iter().map(|d| d.to_f64().ln()).sum();
    let inverse: Vec<Vec<T>> = (0..m).map(|j| factors.solve(&unit(m, j))).collect();
    let mut gradient = Vec::new();
    for j in 0..model.nv() {
        let rates = self::omega(model, &seeded(q, &tangent(model, q, &unit(model.nv(), j))), length)?;
        let mut sum = T::zero();
        for (r, column) in inverse.iter().enumerate() {
            for (s, x) in column.iter().enumerate() {
                sum += *x * rates[(r, s)].rate;
            }
        }
        gradient.push(sum);
    }
    Ok((logarithm, gradient))
}

/// Ω = G M⁻¹ G*.
fn omega<T: Real>(model: &Model, q: &[T], length: f64) -> Result<DMatrix<T>, NotPositive> {
    let factors = Factors::new(&mass_matrix(model, q), tips_first(model), 0.0)?;
    let jacobian = closure_jacobian(model, q);
    let weights = angular_rows(model).into_iter().map(|a| T::splat(if a { length } else { 1.0 }));
    let rows: Vec<Vec<T>> = weights
        .enumerate()
        .map(|(r, weight)| (0..model.nv()).map(|i| jacobian[(r, i)] * weight).collect())
        .collect();
    let solved: Vec<Vec<T>> = rows.iter().map(|row| factors.solve(row)).collect();
    Ok(DMatrix::from_fn(rows.len(), rows.len(), |r, s| {
        rows[r].iter().zip(&solved[s]).fold(T::zero(), |sum, (a, b)| sum + *a * *b)
    }))
}

fn unit<T: Real>(n: usize, i: usize) -> Vec<T> {
    (0..n).map(|j| if i == j { T::one() } else { T::zero() }).collect()
}
