//! The inward sweep of forward dynamics on one state whose six-vectors lie in lanes ([`crate::packed`]).
//!
//! Symbols: those of [`crate::forward_dynamics`].

use super::Moving;
use super::run::{Call, Run};
use crate::articulated_sweep::{eliminate, filter};
use crate::error::DynamicsError;
use crate::hinge::Hinge;
use crate::layout::{GROUND, LayoutBody, Pending};
use crate::packed::{Eliminated, Packed, pivot};
use core::ops::Range;
use phipsi_spatial::{Scalar, SixLanes};

type Hand<T> = Packed<<<T as Scalar>::Arithmetic as Scalar>::Six>;

impl<T: Scalar> Run<'_, T> {
    /// [`Self::sweep_inboard`] with the six-vectors of the state in lanes.
    #[inline(always)]
    pub(super) fn sweep_inboard_packed<const WHOLE: bool>(
        &mut self,
        numbers: Range<usize>,
    ) -> Result<(), DynamicsError> {
        let Call { layout, loads, .. } = self.call;
        let (first, first_v, end) = (self.first::<WHOLE>(), self.first_v::<WHOLE>(), numbers.end);
        let (bodies, rigid) = (&layout.bodies[first..first + end], &layout.rigid[first..first + end]);
        let moving = &self.moving[..end];
        let (pivots, residuals) = (&mut *self.pivots, &mut *self.residuals);
        let mut hand: Hand<T> = if WHOLE { Packed::zero() } else { self.packed.hand };
        for i in numbers.rev() {
            let (k, body) = (first + i, &bodies[i]);
            let v = body.v - first_v;
            let Moving { omega, coriolis } = &moving[i];
            for _ in 1..body.children {
                hand.add(self.packed.pending.take());
            }
            hand.add_body(&rigid[i], *omega);
            if let Hinge::Revolute = body.hinge {
                if let Some(loads) = loads {
                    hand.z = hand.z + Packed::lanes(&loads[k]);
                }
                if body.parent != GROUND {
                    hand.add_coriolis(coriolis);
                }
                let Eliminated { gain, inverse, nu } =
                    hand.eliminate_revolute(residuals[v]).map_err(|D| layout.singular(body.v, D))?;
                let shift = body.link.hinged(self.shifts.turn(i));
                let (moved, gain) = hand.moved::<_, true>(&body.link, &shift, gain);
                (pivots[v], residuals[v]) = (pivot(gain, inverse), nu);
                hand = give(&mut self.packed.pending, k, body, moved);
                continue;
            }
            if let Hinge::Prismatic = body.hinge
                && body.parent != GROUND
            {
                if let Some(loads) = loads {
                    hand.z = hand.z + Packed::lanes(&loads[k]);
                }
                hand.add_acceleration(coriolis);
                let Eliminated { gain, inverse, nu } =
                    hand.eliminate_prismatic(residuals[v]).map_err(|D| layout.singular(body.v, D))?;
                let (moved, gain) = hand.moved::<_, false>(&body.link, self.shifts.shift(i), gain);
                (pivots[v], residuals[v]) = (pivot(gain, inverse), nu);
                hand = give(&mut self.packed.pending, k, body, moved);
                continue;
            }
            let (P, mut z) = hand.unpack();
            if let Some(loads) = loads {
                z += loads[k];
            }
            if body.parent != GROUND {
                z += P.times(*coriolis);
            }
            let dofs = v..v + body.hinge.nv();
            let pivots = &mut pivots[dofs.clone()];
            let passage = self.shifts.at(i, body);
            let moved = eliminate(body, passage, P, pivots)
                .map_err(|(component, D)| layout.singular(body.v + component, D))?;
            filter(&body.hinge, pivots, &mut z, &mut residuals[dofs]);
            hand = Packed::zero();
            if body.parent != GROUND {
                let moved = Packed::pack(&moved, &passage.wrench_to_parent(z));
                hand = give(&mut self.packed.pending, k, body, moved);
            }
        }
        if !WHOLE {
            self.packed.hand = hand;
        }
        Ok(())
    }
}

/// What a body gives to its parent: returned if the parent is next, else kept for it.
#[inline(always)]
fn give<T: Scalar, S: SixLanes<T>>(
    pending: &mut Pending<Packed<S>>,
    k: usize,
    body: &LayoutBody<T::Constant>,
    moved: Packed<S>,
) -> Packed<S> {
    if body.follows_parent(k) {
        return moved;
    }
    if body.parent != GROUND {
        pending.put(&moved);
    }
    Packed::zero()
}
