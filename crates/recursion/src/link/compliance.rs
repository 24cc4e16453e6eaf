//! Compliances through a joint, outward: φ* Y φ.

use super::quarter::{back_quarter, quarter};
use super::{Link, Shift, Twist};
use phipsi_spatial::{ArticulatedInertia, Axis, Scalar, Turn, Vec3};

#[inline(always)]
fn back<T: Scalar>(turn: Turn<T>) -> Turn<T> {
    Turn { cos: turn.cos, sin: -turn.sin }
}

impl<C: Scalar> Link<C> {
    /// φ*(p, k) Y φ(p, k), where Y has its halves exchanged: motions are to it what wrenches are to an inertia, so that it
    /// goes outward as an inertia goes inward.
    #[inline(always)]
    pub(crate) fn compliance_to_child<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        Y: &ArticulatedInertia<T>,
    ) -> ArticulatedInertia<T> {
        let faced = match self.first_turn::<T>() {
            Some(first) => back(first).articulated_up(Axis::Z, Y),
            None => *Y,
        };
        let moved = faced.shifted(Vec3::zero() - shift.offset);
        let untwisted = match self.shape {
            Twist::Straight => moved,
            Twist::Quarter => back_quarter(&moved),
            Twist::BackQuarter => quarter(&moved),
            Twist::Oblique => back(Turn::constant(&self.twist)).articulated_up(Axis::X, &moved),
        };
        back(shift.turn).articulated_up(Axis::Z, &untwisted)
    }
}
