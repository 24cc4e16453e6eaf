//! Accelerations by Gauss' principle as one dense least-squares problem, without the mass matrix.
//!
//! minimise ½‖A θ̈ + y‖² − f·θ̈: rows √m (velocity of the centre of mass along x, y, z) and those of a factor of the moments
//! about it; f holds joint forces, wrenches and gyroscopic moments. With A = QR: θ̈ = R⁻¹(R⁻* f − Q* y).

use crate::bodies::world_inertias;
use crate::dense::NotPositive;
use crate::jacobian::{axes, supports};
use crate::kinematics::kinematics;
use phipsi_model::Model;
use phipsi_spatial::{Mat3, Real, Vec3, Wrench};

/// Accelerations of generalised forces `tau` at (q, v) under external wrenches.
///
/// # Errors
/// [`NotPositive`] if a column of A depends on those before it.
pub fn square_root_forward_dynamics<T: Real>(
    model: &Model,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<T>, NotPositive> {
    let nv = model.nv();
    let motions = kinematics(model, q, v, &vec![T::zero(); nv]);
    let axes = axes(model, &motions);
    let gravity = Vec3::splat(model.gravity());
    let mut rows: Vec<Vec<T>> = Vec::new();
    let mut f = tau.to_vec();
    for ((k, support), inertia) in supports(model).iter().enumerate().zip(world_inertias(model, &motions)) {
        let motion = &motions[k];
        let w = motion.velocity.angular;
        let gyroscopic = w.cross(inertia.tensor * w);
        for &i in support {
            f[i] -= axes[i].angular.dot(gyroscopic);
            if let Some(wrenches) = wrenches {
                let r = motion.pose.rotation;
                let (n, force) = (r * wrenches[k].moment, r * wrenches[k].force);
                f[i] += axes[i].velocity_at(motion.pose.translation).dot(force) + axes[i].angular.dot(n);
            }
        }
        let mut row = |of: &dyn Fn(usize) -> T, y: T| {
            let mut entries = vec![T::zero(); nv + 1];
            support.iter().for_each(|&i| entries[i] = of(i));
            entries[nv] = y;
            rows.push(entries);
        };
        let root = inertia.mass.sqrt();
        let fall = motion.acceleration_at(inertia.center) - gravity;
        for i in 0..3 {
            row(&|j| root * axes[j].velocity_at(inertia.center).0[i], root * fall.0[i]);
        }
        for l in columns_of_factor(&inertia.tensor) {
            row(&|j| l.dot(axes[j].angular), l.dot(motion.acceleration.angular));
        }
    }
    solve(rows, f)
}

/// The columns of L with L L* = the tensor, zero where it is singular.
fn columns_of_factor<T: Real>(tensor: &Mat3<T>) -> [Vec3<T>; 3] {
    let mut left = tensor.0;
    let mut columns = [Vec3::zero(); 3];
    for j in 0..3 {
        let rounding = tensor.0[j][j] * T::splat(16.0 * T::EPSILON);
        if left[j][j] <= rounding {
            continue;
        }
        let root = left[j][j].sqrt();
        let l: [T; 3] = std::array::from_fn(|i| if i < j { T::zero() } else { left[i][j] / root });
        for a in 0..3 {
            for b in 0..3 {
                left[a][b] -= l[a] * l[b];
            }
        }
        columns[j] = Vec3(l);
    }
    columns
}

/// Householder reflections of the rows (A, y), in the order of the columns, with the largest entry as pivot.
fn solve<T: Real>(mut rows: Vec<Vec<T>>, mut f: Vec<T>) -> Result<Vec<T>, NotPositive> {
    let n = f.len();
    for c in 0..n {
        let largest = (c..rows.len()).max_by(|&a, &b| {
            rows[a][c].abs().partial_cmp(&rows[b][c].abs()).unwrap_or(std::cmp::Ordering::Equal)
        });
        let failed = NotPositive { degree_of_freedom: c };
        rows.swap(c, largest.ok_or(failed)?);
        let size = rows[c..].iter().fold(T::zero(), |sum, row| sum + row[c] * row[c]).sqrt();
        if !size.is_positive() {
            return Err(failed);
        }
        let rho = if rows[c][c] > T::zero() { -size } else { size };
        let mut v: Vec<T> = rows[c..].iter().map(|row| row[c]).collect();
        v[0] -= rho;
        let scale = -(rho * v[0]).recip();
        for j in c..=n {
            let w = rows[c..].iter().zip(&v).fold(T::zero(), |sum, (row, v)| sum + row[j] * *v) * scale;
            rows[c..].iter_mut().zip(&v).for_each(|(row, v)| row[j] -= *v * w);
        }
    }
    for i in 0..n {
        f[i] = (0..i).fold(f[i], |sum, k| sum - rows[k][i] * f[k]) / rows[i][i];
    }
    for i in 0..n {
        f[i] -= rows[i][n];
    }
    for i in (0..n).rev() {
        f[i] = (i + 1..n).fold(f[i], |sum, k| sum - rows[i][k] * f[k]) / rows[i][i];
    }
    Ok(f)
}
