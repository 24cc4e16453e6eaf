//! The physical inertia that is nearest to an unphysical one, as a suggestion to the user.

use nalgebra::{Matrix3, Vector3};

/// The tensor (xx, xy, xz, yy, yz, zz) of a mass distribution that is nearest to the given one in the sum of squares of
/// the matrix entries; `None` if that is zero, which is no suggestion.
///
/// Its principal axes are those of the given one. Principal moments are those of a mass distribution where each is at
/// most the sum of the others, from which it follows that none is negative.
pub(crate) fn nearest_inertia(tensor: [f64; 6]) -> Option<[f64; 6]> {
    let [xx, xy, xz, yy, yz, zz] = tensor;
    let scale = tensor.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let eigen = (Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) / scale).symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let moments = nearest_moments(order.map(|i| eigen.eigenvalues[i]))?;
    let mut corrected = Vector3::zeros();
    for (&i, moment) in order.iter().zip(moments) {
        corrected[i] = moment;
    }
    let v = eigen.eigenvectors;
    let m = v * Matrix3::from_diagonal(&corrected) * v.transpose();
    let nearest = [m[(0, 0)], m[(0, 1)], m[(0, 2)], m[(1, 1)], m[(1, 2)], m[(2, 2)]];
    // Rounding of the rotation is no product of inertia.
    Some(nearest.map(|x| if x.abs() < 1e-12 { 0.0 } else { x * scale }))
}

/// The same for principal moments in ascending order.
fn nearest_moments([small, middle, large]: [f64; 3]) -> Option<[f64; 3]> {
    // Outside: onto the face large = small + middle, or beyond its edge onto the edge (0, t, t).
    let third = ((large - small - middle) / 3.0).max(0.0);
    let on_face = [small + third, middle + third, large - third];
    if on_face[0] >= 0.0 {
        return (on_face[2] > 0.0).then_some(on_face);
    }
    let t = 0.5 * (middle + large);
    (t > 0.0).then_some([0.0, t, t])
}

/// The tensor as attributes, nine digits each.
pub(crate) fn as_attributes(tensor: [f64; 6]) -> String {
    let names = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];
    let nine_digits = |x: f64| format!("{x:.8e}").parse().unwrap_or(x);
    let parts: Vec<String> =
        names.iter().zip(tensor).map(|(n, x)| format!("{n}={:?}", nine_digits(x))).collect();
    parts.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Random;

    fn matrix([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Matrix3<f64> {
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// Smallest of b + c − a over the principal moments: negative where no mass distribution has them.
    fn slack(tensor: [f64; 6]) -> f64 {
        let m = matrix(tensor).symmetric_eigenvalues();
        m.sum() - 2.0 * m.max()
    }

    /// Projection onto a convex cone: the answer lies in it, and the rest is orthogonal to it and at most obtuse to every
    /// member.
    #[test]
    fn it_is_the_projection_onto_the_physical_tensors() {
        for seed in 0..500 {
            let mut r = Random::new(seed);
            let tensor: [f64; 6] = std::array::from_fn(|_| r.signed());
            let Some(nearest) = nearest_inertia(tensor) else {
                // Only where every member is at most orthogonal to the tensor: no moment helps.
                for _ in 0..20 {
                    assert!((matrix(tensor).component_mul(&member(&mut r))).sum() <= 1e-12, "seed {seed}");
                }
                continue;
            };
            // Six entries and three rotations of size at most 3.
            let budget = 100.0 * f64::EPSILON;
            assert!(slack(nearest) >= -budget, "seed {seed}");
            let rest = matrix(tensor) - matrix(nearest);
            assert!(rest.component_mul(&matrix(nearest)).sum().abs() <= budget, "seed {seed}");
            for _ in 0..20 {
                assert!(rest.component_mul(&member(&mut r)).sum() <= budget, "seed {seed}");
            }
        }
    }

    /// The inertia of a few random points.
    fn member(r: &mut Random) -> Matrix3<f64> {
        (0..2)
            .map(|_| Vector3::from(r.vector()))
            .map(|p| Matrix3::identity() * p.dot(&p) - p * p.transpose())
            .sum()
    }

    #[test]
    fn known_cases() {
        for (given, expected) in [
            ([1.0, 0.0, 0.0, 1.0, 0.0, 5.0], "ixx=2.0 ixy=0.0 ixz=0.0 iyy=2.0 iyz=0.0 izz=4.0"),
            ([-1.0, 0.0, 0.0, 2.0, 0.0, 2.0], "ixx=0.0 ixy=0.0 ixz=0.0 iyy=2.0 iyz=0.0 izz=2.0"),
            ([1e-9, 0.0, 0.0, 3e-9, 0.0, 4e-9], "ixx=1e-9 ixy=0.0 ixz=0.0 iyy=3e-9 iyz=0.0 izz=4e-9"),
        ] {
            assert_eq!(nearest_inertia(given).map(as_attributes).as_deref(), Some(expected));
        }
        assert_eq!(nearest_inertia([-1.0, 0.0, 0.0, -1.0, 0.0, -1.0]), None);
        assert_eq!(nearest_inertia([0.0; 6]), None);
    }
}
