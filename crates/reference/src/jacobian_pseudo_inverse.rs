//! Generalised inverses of dense Jacobians by normal equations, and J J* as a product.

use crate::dense::{Factors, NotPositive};
use crate::jacobian::jacobian;
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::{Real, Vec3};

/// The Jacobians of several points, one below the other.
pub fn stacked<T: Real>(model: &Model, q: &[T], tips: &[(Option<usize>, Option<Vec3<T>>)]) -> DMatrix<T> {
    let mut all = DMatrix::from_element(6 * tips.len(), model.nv(), T::zero());
    for (t, (body, point)) in tips.iter().enumerate() {
        let j = jacobian(model, q, *body, *point);
        for r in 0..6 {
            (0..model.nv()).for_each(|c| all[(6 * t + r, c)] = j[(r, c)]);
        }
    }
    all
}

/// A A* by rows.
pub fn gram<T: Real>(a: &DMatrix<T>) -> Vec<T> {
    let (rows, n) = (a.nrows(), a.ncols());
    let entry = |r: usize, c: usize| (0..n).fold(T::zero(), |sum, k| sum + a[(r, k)] * a[(c, k)]);
    (0..rows * rows).map(|i| entry(i / rows, i % rows)).collect()
}

/// J⁺ x: J* (J J*)⁻¹ x with at least as many columns as rows, else (J* J)⁻¹ J* x.
///
/// # Errors
/// [`NotPositive`] if J has no full rank: a pivot below 1e-20 of its diagonal entry counts as zero.
pub fn jacobian_pseudo_inverse<T: Real>(j: &DMatrix<T>, x: &[T]) -> Result<Vec<T>, NotPositive> {
    let (rows, n) = (j.nrows(), j.ncols());
    let transpose = j.transpose();
    let solve = |a: &DMatrix<T>, b: &[T]| {
        let size = a.nrows();
        let square = DMatrix::from_row_slice(size, size, &gram(a));
        Factors::new(&square, (0..size).collect(), 1e-20).map(|f| f.solve(b))
    };
    let times = |a: &DMatrix<T>, b: &[T]| -> Vec<T> {
        (0..a.nrows()).map(|r| (0..a.ncols()).fold(T::zero(), |sum, k| sum + a[(r, k)] * b[k])).collect()
    };
    if rows <= n { Ok(times(&transpose, &solve(j, x)?)) } else { solve(&transpose, &times(&transpose, x)) }
}
