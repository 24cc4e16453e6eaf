//! Υ of every body: J M⁻¹ J* with the dense Jacobian in the body's axes.

use crate::dense::NotPositive;
use crate::jacobian::jacobian;
use crate::kinematics::kinematics;
use crate::mass_matrix_inverse::mass_matrix_inverse;
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::{Motion, Real, Vec3};

/// J M⁻¹ J* of J in any axes, by rows.
pub fn mobility<T: Real>(j: &DMatrix<T>, inverse: &DMatrix<T>) -> Vec<T> {
    let (rows, n) = (j.nrows(), j.ncols());
    let mut half = DMatrix::from_element(rows, n, T::zero());
    for r in 0..rows {
        for c in 0..n {
            half[(r, c)] = (0..n).fold(T::zero(), |sum, k| sum + j[(r, k)] * inverse[(k, c)]);
        }
    }
    let entry = |r: usize, c: usize| (0..n).fold(T::zero(), |sum, k| sum + half[(r, k)] * j[(c, k)]);
    (0..rows * rows).map(|i| entry(i / rows, i % rows)).collect()
}

/// 36 numbers for each body, by rows, at its origin in its axes.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn upsilon<T: Real>(model: &Model, q: &[T]) -> Result<Vec<T>, NotPositive> {
    let inverse = mass_matrix_inverse(model, q)?;
    let zero = vec![T::zero(); model.nv()];
    let motions = kinematics(model, q, &zero, &zero);
    let mut out = Vec::with_capacity(36 * model.len());
    for (k, motion) in motions.iter().enumerate() {
        let mut j = jacobian(model, q, Some(k), None);
        for c in 0..model.nv() {
            let column = Motion::from_array(std::array::from_fn(|r| j[(r, c)]));
            let turned = |v: Vec3<T>| motion.pose.rotation.transpose_mul(v);
            let column = Motion::new(turned(column.angular), turned(column.linear)).to_array();
            (0..6).for_each(|r| j[(r, c)] = column[r]);
        }
        out.extend(mobility(&j, &inverse));
    }
    Ok(out)
}
