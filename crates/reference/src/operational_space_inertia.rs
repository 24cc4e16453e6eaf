//! (J M⁻¹ J*)⁻¹ by dense factors, where it exists.

use crate::dense::{Factors, NotPositive};
use crate::jacobian::jacobian;
use crate::mass_matrix_inverse::mass_matrix_inverse;
use crate::upsilon::mobility;
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::{Real, Vec3};

/// Λ of a point of a body, 6×6 by rows, world axes.
///
/// # Errors
/// [`NotPositive`] if M or J M⁻¹ J* is not positive definite: a pivot below 1e-20 of its diagonal entry counts as zero.
pub fn operational_space_inertia<T: Real>(
    model: &Model,
    q: &[T],
    body: Option<usize>,
    point: Option<Vec3<T>>,
) -> Result<Vec<T>, NotPositive> {
    let inverse = mass_matrix_inverse(model, q)?;
    let rows = mobility(&jacobian(model, q, body, point), &inverse);
    let factors = Factors::new(&DMatrix::from_row_slice(6, 6, &rows), (0..6).collect(), 1e-20)?;
    let columns = (0..6).flat_map(|j| {
        let mut unit = vec![T::zero(); 6];
        unit[j] = T::one();
        factors.solve(&unit)
    });
    // Symmetric: columns are rows.
    Ok(columns.collect())
}
