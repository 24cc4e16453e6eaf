//! Articulated inertias through a joint: whole, or after its degree of freedom has been eliminated.

use super::quarter::{back_quarter, back_quarter_symmetric, quarter, quarter_symmetric};
use super::{Link, Shift, Twist};
use phipsi_spatial::turn::{shift_coupling, shift_inertia};
use phipsi_spatial::{ArticulatedInertia, Axis, Mat3, Scalar, Sym3, Turn, Vec3, Wrench};

impl<C: Scalar> Link<C> {
    /// φ(p, k) P φ*(p, k).
    #[inline(always)]
    pub(crate) fn articulated_to_parent<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        P: &ArticulatedInertia<T>,
    ) -> ArticulatedInertia<T> {
        let turned = shift.turn.articulated_up(Axis::Z, P);
        let twisted = match self.shape {
            Twist::Straight => turned,
            Twist::Quarter => quarter(&turned),
            Twist::BackQuarter => back_quarter(&turned),
            Twist::Oblique => Turn::constant(&self.twist).articulated_up(Axis::X, &turned),
        };
        self.first_articulated(twisted.shifted(shift.offset))
    }
    /// φ(p, k) (P − G H P) φ*(p, k) for a hinge about z, whose column of P is U and gain G = (gx, gy, 1, g).
    ///
    /// Block after block, mass first, so that few numbers are in use at once.
    #[inline(always)]
    pub(crate) fn eliminated_to_parent<T: Scalar<Constant = C>>(
        &self,
        turn: Turn<T>,
        P: &ArticulatedInertia<T>,
        gain: &Wrench<T>,
    ) -> ArticulatedInertia<T> {
        let (J, C) = (&P.inertia, &P.coupling.0);
        let (ux, uy, force) = (J.xz, J.yz, Vec3(C[2]));
        let ([gx, gy, _], g) = (gain.moment.0, gain.force);
        let offset = Vec3::constant(self.offset);
        let mut mass = P.mass;
        mass.add_product(-g, force);
        let mass = self.twist_symmetric(&turn.symmetric_up(Axis::Z, &mass));
        let rows = [force.scale_add(-gx, Vec3(C[0])).0, force.scale_add(-gy, Vec3(C[1])).0];
        let coupling = self.twisted_rows(turn.flat_coupling_z(rows));
        let moved = shift_coupling(&coupling, &mass, offset);
        let flat = [(-gx).fma(ux, J.xx), (-gx).fma(uy, J.xy), (-gy).fma(uy, J.yy)];
        let inertia = self.twisted_flat(turn.flat_inertia_z(flat));
        let inertia = shift_inertia(&inertia, &coupling, &moved, offset);
        self.first_articulated(ArticulatedInertia { inertia, coupling: moved, mass })
    }
    /// The same for a slider along z, whose gain is G = (g, gx, gy, 1).
    #[inline(always)]
    pub(crate) fn slid_to_parent<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        P: &ArticulatedInertia<T>,
        gain: &Wrench<T>,
    ) -> ArticulatedInertia<T> {
        let (m, C, turn) = (&P.mass, &P.coupling, shift.turn);
        let (ux, uy, moment) = (m.xz, m.yz, C.column(2));
        let (g, [gx, gy, _]) = (gain.moment, gain.force.0);
        let flat = [(-gx).fma(ux, m.xx), (-gx).fma(uy, m.xy), (-gy).fma(uy, m.yy)];
        let mass = self.twisted_flat(turn.flat_inertia_z(flat));
        let columns = [moment.scale_add(-gx, C.column(0)).0, moment.scale_add(-gy, C.column(1)).0];
        let coupling = self.twisted_rows(turn.flat_coupling_z(columns)).transpose();
        let moved = shift_coupling(&coupling, &mass, shift.offset);
        let mut inertia = P.inertia;
        inertia.add_product(-g, moment);
        let inertia = self.twist_symmetric(&turn.symmetric_up(Axis::Z, &inertia));
        let inertia = shift_inertia(&inertia, &coupling, &moved, shift.offset);
        self.first_articulated(ArticulatedInertia { inertia, coupling: moved, mass })
    }
    /// X(α) on a symmetric matrix of xx, xy, yy.
    #[inline(always)]
    fn twisted_flat<T: Scalar<Constant = C>>(&self, flat: [T; 3]) -> Sym3<T> {
        let ([xx, xy, yy], o) = (flat, T::zero());
        match self.shape {
            Twist::Straight => Sym3 { xx, xy, xz: o, yy, yz: o, zz: o },
            Twist::Quarter => Sym3 { xx, xy: o, xz: xy, yy: o, yz: o, zz: yy },
            Twist::BackQuarter => Sym3 { xx, xy: o, xz: -xy, yy: o, yz: o, zz: yy },
            Twist::Oblique => Turn::constant(&self.twist).flat_inertia_x(flat),
        }
    }
    /// X(α) on a matrix of rows x and y.
    #[inline(always)]
    fn twisted_rows<T: Scalar<Constant = C>>(&self, rows: [[T; 3]; 2]) -> Mat3<T> {
        let ([x, y], o) = (rows, T::zero());
        match self.shape {
            Twist::Straight => Mat3([x, y, [o; 3]]),
            Twist::Quarter => Mat3([[x[0], -x[2], x[1]], [o; 3], [y[0], -y[2], y[1]]]),
            Twist::BackQuarter => Mat3([[x[0], x[2], -x[1]], [o; 3], [-y[0], -y[2], y[1]]]),
            Twist::Oblique => Turn::constant(&self.twist).flat_coupling_x(rows),
        }
    }
    #[inline(always)]
    pub(super) fn twist_symmetric<T: Scalar<Constant = C>>(&self, m: &Sym3<T>) -> Sym3<T> {
        match self.shape {
            Twist::Straight => *m,
            Twist::Quarter => quarter_symmetric(m),
            Twist::BackQuarter => back_quarter_symmetric(m),
            Twist::Oblique => Turn::constant(&self.twist).symmetric_up(Axis::X, m),
        }
    }
    #[inline(always)]
    fn first_articulated<T: Scalar<Constant = C>>(&self, P: ArticulatedInertia<T>) -> ArticulatedInertia<T> {
        if self.has_first { Turn::constant(&self.first).articulated_up(Axis::Z, &P) } else { P }
    }
}
