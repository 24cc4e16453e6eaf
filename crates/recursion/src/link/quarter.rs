//! Quarter turns about x: exchanges of entries, with signs.

use phipsi_spatial::{ArticulatedInertia, Mat3, Scalar, Sym3};

/// y → z, z → −y.
#[inline(always)]
pub(super) fn quarter_symmetric<T: Scalar>(m: &Sym3<T>) -> Sym3<T> {
    Sym3 { xx: m.xx, xy: -m.xz, xz: m.xy, yy: m.zz, yz: -m.yz, zz: m.yy }
}

/// y → −z, z → y.
#[inline(always)]
pub(super) fn back_quarter_symmetric<T: Scalar>(m: &Sym3<T>) -> Sym3<T> {
    Sym3 { xx: m.xx, xy: m.xz, xz: -m.xy, yy: m.zz, yz: -m.yz, zz: m.yy }
}

#[inline(always)]
fn quarter_matrix<T: Scalar>(A: &Mat3<T>) -> Mat3<T> {
    let [x, y, z] = A.0;
    Mat3([[x[0], -x[2], x[1]], [-z[0], z[2], -z[1]], [y[0], -y[2], y[1]]])
}

#[inline(always)]
fn back_quarter_matrix<T: Scalar>(A: &Mat3<T>) -> Mat3<T> {
    let [x, y, z] = A.0;
    Mat3([[x[0], x[2], -x[1]], [z[0], z[2], -z[1]], [-y[0], -y[2], y[1]]])
}

#[inline(always)]
pub(super) fn quarter<T: Scalar>(P: &ArticulatedInertia<T>) -> ArticulatedInertia<T> {
    ArticulatedInertia {
        inertia: quarter_symmetric(&P.inertia),
        coupling: quarter_matrix(&P.coupling),
        mass: quarter_symmetric(&P.mass),
    }
}

#[inline(always)]
pub(super) fn back_quarter<T: Scalar>(P: &ArticulatedInertia<T>) -> ArticulatedInertia<T> {
    ArticulatedInertia {
        inertia: back_quarter_symmetric(&P.inertia),
        coupling: back_quarter_matrix(&P.coupling),
        mass: back_quarter_symmetric(&P.mass),
    }
}
