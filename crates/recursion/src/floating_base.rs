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
