//! A 6 × 6 system with a symmetric positive matrix, by L D L*.

use phipsi_spatial::{ArticulatedInertia, Motion, Real, Wrench};

/// The motion V of I V = f; the pivot that is not positive is the error.
pub(crate) fn solve<T: Real>(inertia: &ArticulatedInertia<T>, f: Wrench<T>) -> Result<Motion<T>, f64> {
    let (mut a, mut x) = (inertia.to_rows(), f.to_array());
    for j in 0..6 {
        let pivot = a[j][j];
        if !pivot.is_positive() {
            return Err(pivot.to_f64());
        }
        for i in j + 1..6 {
            let factor = a[i][j] / pivot;
            for c in j + 1..6 {
                let above = a[j][c];
                a[i][c] -= factor * above;
            }
            let above = x[j];
            x[i] -= factor * above;
        }
    }
    for j in (0..6).rev() {
        let rest = (j + 1..6).fold(x[j], |rest, c| rest - a[j][c] * x[c]);
        x[j] = rest / a[j][j];
    }
    Ok(Motion::from_array(x))
}
