//! The homogeneous box with the same mass and moments of inertia as a body.

use nalgebra::Matrix3;
use phipsi_model::Inertia;
use phipsi_spatial::{Mat3, Quaternion};

/// A 3×3 matrix needs fewer than ten; numbers that overflow would go on for ever.
const MOST_ITERATIONS: usize = 100;

/// Half sizes and pose (x y z qx qy qz qw, in the body frame) of the homogeneous box with the same mass, centre of mass and
/// moments of inertia.
///
/// # Computes
/// I_x = m (b² + c²)/3 for half sizes a, b, c, so a² = 3 (I_y + I_z − I_x)/(2 m) in principal axes. Moments that no body can
/// have give size 0 along that axis.
///
/// `None`: no mass, no size, or numbers that are not finite.
pub fn equivalent_box(inertia: &Inertia) -> Option<([f32; 3], [f32; 7])> {
    let [xx, xy, xz, yy, yz, zz] = inertia.tensor;
    let finite = inertia.tensor.iter().chain(&[inertia.mass]).all(|x| x.is_finite());
    if !finite || inertia.mass <= 0.0 {
        return None;
    }
    let tensor = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let principal = tensor.try_symmetric_eigen(f64::EPSILON, MOST_ITERATIONS)?;
    let mut axes = principal.eigenvectors;
    if axes.determinant() < 0.0 {
        axes.set_column(0, &-axes.column(0));
    }
    let [a, b, c] = [0, 1, 2].map(|i| principal.eigenvalues[i] / inertia.mass);
    let half = [b + c - a, c + a - b, a + b - c].map(|s| (1.5 * s.max(0.0)).sqrt() as f32);
    let rows = [0, 1, 2].map(|i| [0, 1, 2].map(|j| axes[(i, j)]));
    let own = Quaternion::from_rotation(&Mat3(rows));
    let frame = &inertia.frame;
    let turn = Quaternion(frame.rotation).normalized().compose(own).0;
    let [x, y, z] = frame.translation;
    let pose = [x, y, z, turn[0], turn[1], turn[2], turn[3]].map(|v| v as f32);
    let sized = half.iter().all(|h| h.is_finite()) && half.iter().any(|h| *h > 0.0);
    (sized && pose.iter().all(|v| v.is_finite())).then_some((half, pose))
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::Placement;
    use phipsi_spatial::{Sym3, Vec3};

    /// The tensor of a box that is turned and moved gives its sides and its corners back.
    #[test]
    fn a_box_is_its_own_equivalent() {
        let (m, sides) = (3.0, [0.1, 0.2, 0.7]);
        let [a2, b2, c2] = sides.map(|s| s * s * m / 3.0);
        let turn = Quaternion::from_roll_pitch_yaw(0.4, -0.3, 1.2);
        let moments = Sym3 { xx: b2 + c2, xy: 0.0, xz: 0.0, yy: c2 + a2, yz: 0.0, zz: a2 + b2 };
        let tensor = moments.rotate(&turn.to_rotation()).entries();
        let frame = Placement::from_xyz_rpy([1.0, 2.0, 3.0], [0.7, 0.1, -0.2]);
        let (half, pose) = equivalent_box(&Inertia { mass: m, frame, tensor }).unwrap();
        let mut found = half.map(f64::from);
        found.sort_by(f64::total_cmp);
        // Rounded to f32 at the end; the eigenvalues are far apart.
        let tolerance = 4.0 * f64::from(f32::EPSILON);
        assert!((0..3).all(|i| (found[i] - sides[i]).abs() < tolerance), "{half:?}");
        assert_eq!(pose[..3], [1.0, 2.0, 3.0]);
        let axis_of = |r: Mat3<f64>, i: usize| r.column(i);
        let got = Quaternion([3, 4, 5, 6].map(|i| f64::from(pose[i]))).to_rotation();
        let want = Quaternion(frame.rotation).compose(turn).to_rotation();
        for (i, h) in half.iter().enumerate() {
            let j = (0..3).find(|j| (sides[*j] - f64::from(*h)).abs() < 1e-3).unwrap();
            let parallel: f64 = axis_of(got, i).dot(axis_of(want, j)).abs();
            assert!((parallel - 1.0).abs() < tolerance, "{parallel}");
        }
        let handed = axis_of(got, 0).cross(axis_of(got, 1)) - axis_of(got, 2);
        assert!(Vec3::norm(handed) < tolerance);
    }

    #[test]
    fn what_has_no_size_has_no_box() {
        let of = |mass, moments| equivalent_box(&Inertia::from_principal(mass, [0.0; 3], moments));
        assert_eq!(of(0.0, [1.0; 3]), None);
        assert_eq!(of(1.0, [0.0; 3]), None);
        assert_eq!(of(1.0, [f64::NAN, 1.0, 1.0]), None);
        assert_eq!(of(f64::INFINITY, [1.0; 3]), None);
        // A thin rod of length 1: half its length along one axis, nothing across.
        let mut half = of(2.0, [0.0, 2.0 / 12.0, 2.0 / 12.0]).unwrap().0;
        half.sort_by(f32::total_cmp);
        assert!((half[2] - 0.5).abs() < 1e-6 && half[1] < 1e-3, "{half:?}");
    }
}
