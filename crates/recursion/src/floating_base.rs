//! A free joint on the ground. Its axes turn about and slide along those of its body: in the body's axes H is the identity, and the
//! joint is eliminated as a 6×6 matrix is factored.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | P = Λ D Λ* | articulated inertia in the body's axes; column i of Λ is the gain K of axis i, whose numbers before the i-th are zero | paper 1 (9.5) |
//! | ε | innovations: Λ ε = T − z, forward substitution | paper 1 (9.5) |
//! | β + θ̈ | acceleration of the body: Λ* (β + θ̈) = D⁻¹ ε, where β is the ground's, back substitution | paper 1 (9.14) |

use crate::ground_axes::{Directions, dot};
use crate::hinge::combine;
use crate::places::vector;
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{ArticulatedInertia, Mat3, Motion, RigidInertia, Scalar, Sym3, Vec3, Wrench};

/// A step for each of the six axes, whose number is a constant: an array of registers then needs no memory.
macro_rules! each_axis {
    (|$i:ident| $step:expr) => {
        each_axis!(|$i| $step; 0 1 2 3 4 5)
    };
    (|$i:ident| $step:expr; $($number:literal)*) => {$({
        const $i: usize = $number;
        $step
    })*};
}
pub(crate) use each_axis;

/// Components of vectors along the axes.
#[inline(always)]
pub(crate) fn along_three<T: Scalar, W: Wide<T>>([x, y, z]: &Directions<T>, v: Vec3<W>) -> [W; 3] {
    [dot(*x, v), dot(*y, v), dot(*z, v)]
}

/// H f: components along the axes, those of the moment first.
#[inline(always)]
pub(crate) fn along_axes<T: Scalar, W: Wide<T>>(axes: &Directions<T>, f: &Wrench<W>) -> [W; 6] {
    let ([a, b, c], [d, e, f]) = (along_three(axes, f.moment), along_three(axes, f.force));
    [a, b, c, d, e, f]
}

/// A vector, seen in the body's axes.
#[inline(always)]
pub(crate) fn seen<T: Scalar>(axes: &Directions<T>, v: Vec3<T>) -> Vec3<T> {
    Vec3(along_three::<T, T>(axes, v))
}

/// A symmetric matrix, seen in the body's axes.
#[inline(always)]
pub(crate) fn seen_symmetric<T: Scalar>([x, y, z]: &Directions<T>, m: &Sym3<T>) -> Sym3<T> {
    m.rotate(&Mat3([x.0, y.0, z.0]))
}

/// A matrix, seen in the body's axes.
#[inline(always)]
pub(crate) fn seen_matrix<T: Scalar>(axes: &Directions<T>, m: &Mat3<T>) -> Mat3<T> {
    let column = [seen(axes, *m * axes[0]), seen(axes, *m * axes[1]), seen(axes, *m * axes[2])];
    Mat3::from_columns(column[0], column[1], column[2])
}

/// An inertia, seen in the body's axes.
#[inline(always)]
pub(crate) fn seen_rigid<T: Scalar>(axes: &Directions<T>, m: &RigidInertia<T>) -> RigidInertia<T> {
    RigidInertia {
        mass: m.mass,
        first_moment: seen(axes, m.first_moment),
        inertia: seen_symmetric(axes, &m.inertia),
    }
}

/// Gains and D⁻¹ of the six axes from P in the axes of the ground. `pivot` inverts the D of an axis, given what it is a part of: the
/// trace of the inertia or of the mass of P.
#[inline(always)]
pub(crate) fn factor<T: Scalar, E>(
    axes: &Directions<T>,
    P: &ArticulatedInertia<T>,
    mut pivot: impl FnMut(usize, T, T) -> Result<T, E>,
) -> Result<([[T; 6]; 6], [T; 6]), E> {
    let (J, C, m) =
        (seen_symmetric(axes, &P.inertia), seen_matrix(axes, &P.coupling), seen_symmetric(axes, &P.mass));
    let scales = [J.xx + J.yy + J.zz, m.xx + m.yy + m.zz];
    // Rows of the upper triangle, which becomes D Λ*.
    let mut rows = ArticulatedInertia { inertia: J, coupling: C, mass: m }.to_rows();
    let (mut gains, mut inverses) = ([[T::zero(); 6]; 6], [T::zero(); 6]);
    for i in 0..6 {
        inverses[i] = pivot(i, rows[i][i], scales[i / 3])?;
        gains[i][i] = T::one();
        for j in i + 1..6 {
            gains[i][j] = rows[i][j] * inverses[i];
        }
        for j in i + 1..6 {
            for c in j..6 {
                rows[j][c] = (-gains[i][j]).fma(rows[i][c], rows[j][c]);
            }
        }
    }
    Ok((gains, inverses))
}

/// ε of T − z, in registers of columns; `gains` by rows.
#[inline(always)]
pub(crate) fn innovations<T: Scalar, W: Wide<T>>(gains: &[[T; 6]; 6], mut difference: [W; 6]) -> [W; 6] {
    for i in 0..6 {
        for j in i + 1..6 {
            difference[j] = (-difference[i]).fma(W::broadcast(gains[i][j]), difference[j]);
        }
    }
    difference
}

/// Λ⁻¹ by rows: the innovations of unit forces, one a column.
#[inline(always)]
pub(crate) fn inverse<T: Scalar>(gains: &[[T; 6]; 6]) -> [[T; 6]; 6] {
    let mut rows = [[T::zero(); 6]; 6];
    for c in 0..6 {
        rows[c][c] = T::one();
        for i in c..6 {
            for j in i + 1..6 {
                rows[j][c] = (-rows[i][c]).fma(gains[i][j], rows[j][c]);
            }
        }
    }
    rows
}

/// β + θ̈ of D⁻¹ ε, in registers of columns.
#[inline(always)]
pub(crate) fn accelerations<T: Scalar, W: Wide<T>>(gains: &[[T; 6]; 6], mut x: [W; 6]) -> [W; 6] {
    for i in (0..6).rev() {
        for j in i + 1..6 {
            x[i] = (-x[j]).fma(W::broadcast(gains[i][j]), x[i]);
        }
    }
    x
}

/// A motion, given its components along the axes.
#[inline(always)]
pub(crate) fn motion<T: Scalar, W: Wide<T>>(axes: &Directions<T>, x: [W; 6]) -> Motion<W> {
    let axes = [vector(axes[0]), vector(axes[1]), vector(axes[2])];
    let [a, b, c, d, e, f] = x;
    Motion::new(combine(&axes, Vec3([a, b, c])), combine(&axes, Vec3([d, e, f])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::Layout;
    use crate::places::Places;
    use core::convert::Infallible;
    use phipsi_reference::generate::case;

    /// Λ D Λ* is P, and Λ⁻¹ Λ the identity. Each entry of the product has at most six terms, no larger than √(P_ii P_jj) as P is
    /// positive definite, of two roundings each, and as many come from the factors.
    #[test]
    fn gains_factor_an_inertia() {
        let mut P = RigidInertia::from_center_of_mass(
            2.0,
            Vec3([0.1, -0.3, 0.2]),
            Sym3 { xx: 0.5, xy: 0.02, xz: -0.03, yy: 0.4, yz: 0.01, zz: 0.6 },
        )
        .to_articulated();
        P.add_outer(Wrench::from_array([0.3, -0.2, 0.9, 1.0, -0.4, 0.1]), 0.7);
        let axes = [Vec3::unit(0), Vec3::unit(1), Vec3::unit(2)];
        let Ok((gains, inverses)) = factor(&axes, &P, |_, D: f64, _| Ok::<f64, Infallible>(1.0 / D));
        let (rows, inverse) = (P.to_rows(), inverse(&gains));
        for i in 0..6 {
            for j in 0..6 {
                let product: f64 = (0..6).map(|k| gains[k][i] * gains[k][j] / inverses[k]).sum();
                let allowed = 24.0 * f64::EPSILON * (rows[i][i] * rows[j][j]).sqrt();
                assert!((product - rows[i][j]).abs() <= allowed, "[{i}, {j}]");
                let one: f64 = (0..6).map(|k| inverse[i][k] * gains[j][k]).sum();
                let terms: f64 = (0..6).map(|k| (inverse[i][k] * gains[j][k]).abs()).sum();
                assert!(
                    (one - f64::from(u8::from(i == j))).abs() <= 24.0 * f64::EPSILON * terms,
                    "[{i}, {j}]"
                );
            }
        }
    }

    /// The generated tests of matrices and derivatives see bases behind other trees, several of them, and such without limbs.
    #[test]
    fn generated_trees_have_bases_everywhere() {
        let (mut behind, mut several, mut bare) = (0, 0, 0);
        for seed in 0..500 {
            let layout = Layout::<f64>::new(&case(seed).model);
            let places = Places::new::<f64>(&layout);
            behind += usize::from(places.bases.iter().any(|&first| first > places.margin));
            several += usize::from(places.bases.len() > 1);
            let bodies = layout.bodies();
            bare += usize::from(bodies.iter().any(|body| body.floats() && body.children == 0));
        }
        assert!(behind > 10 && several > 10 && bare > 10, "{behind}, {several}, {bare}");
    }
}
