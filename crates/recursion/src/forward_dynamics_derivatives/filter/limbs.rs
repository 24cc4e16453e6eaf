//! The filter of one state with its limbs in lanes ([`crate::layout::LimbPlan`]): their bodies are read from four places of the table, and
//! their gains written there.

use super::{Filter, Numbers, Passed, Sweep, Waiting, inward, pass_axis};
use crate::error::DynamicsError;
use crate::hinge::Hinge;
use crate::inverse_dynamics_derivatives::ROWS;
use crate::layout::{GROUND, LimbPlan, Limbs};
use crate::limbs::{self, Moved};
use crate::places::{Lane, Places, Table};
use num_traits::Zero;
use phipsi_spatial::{ArticulatedInertia, Kernel, Scalar, Wrench};

/// Workspace of one group of limbs.
#[derive(Clone, Debug)]
pub(super) struct OfLimbs<T: Scalar> {
    waiting: Waiting<Moved<T::Abreast>>,
    /// Places of the bodies of each limb, and where their numbers start.
    places: Vec<[usize; 4]>,
    starts: Vec<[usize; 4]>,
    /// ν.
    residuals: Vec<T::Abreast>,
    gifts: [Moved<T>; 4],
}

impl<T: Scalar> OfLimbs<T> {
    pub(super) fn of_all(plan: &LimbPlan<T::Constant>, places: &Places) -> Vec<Self> {
        let each = plan.groups.iter().map(|limbs| {
            let count = limbs.layout.len();
            let places: Vec<[usize; 4]> =
                (0..count).map(|i| limbs.roots.map(|root| places.first[root + i])).collect();
            OfLimbs {
                waiting: Waiting::new(&limbs.layout, (ArticulatedInertia::zero(), Wrench::zero())),
                starts: places.iter().map(|at| at.map(Table::<T, ROWS>::start)).collect(),
                places,
                residuals: vec![T::Abreast::zero(); count],
                gifts: [(ArticulatedInertia::zero(), Wrench::zero()); 4],
            }
        });
        each.collect()
    }
    /// Tip to base; false if a hinge of some limb is singular.
    #[inline(always)]
    fn inward(&mut self, of: &Limbs<T::Constant>, sweep: &mut Sweep<'_, '_, T>) -> bool {
        let OfLimbs { waiting: Waiting { pending, hand }, places, starts, residuals, gifts } = self;
        let bodies = of.layout.bodies();
        pending.clear();
        for i in (0..bodies.len()).rev() {
            let body = &bodies[i];
            if body.children == 0 {
                *hand = (ArticulatedInertia::zero(), Wrench::zero());
            } else {
                for _ in 1..body.children {
                    let other = pending.take();
                    hand.0 = hand.0 + other.0;
                    hand.1 += other.1;
                }
            }
            let [a, b, c, d] = starts[i];
            let view = &sweep.view;
            let here = FourPlaces([view.lane(a), view.lane(b), view.lane(c), view.lane(d)]);
            let force = limbs::numbers(sweep.residuals, of.v[i]);
            let passed = if let Hinge::Revolute = body.hinge {
                pass_axis::<T::Abreast, _, false>(hand, &here, false, force)
            } else {
                pass_axis::<T::Abreast, _, true>(hand, &here, false, force)
            };
            let Ok(Passed { gain, inverse, nu }) = passed else { return false };
            residuals[i] = nu;
            let (gains, inverses) = (limbs::lanes_of_wrench::<T>(gain), limbs::lanes::<T>(inverse));
            for lane in 0..4 {
                sweep.gains.set(places[i][lane], gains[lane], inverses[lane]);
            }
            if i > 0 && !body.follows_parent(i) {
                pending.put(hand);
            }
        }
        limbs::give(of, hand, gifts);
        true
    }
}

/// The numbers of four bodies.
struct FourPlaces<'a, T>([Lane<'a, T, ROWS>; 4]);

impl<T: Scalar> Numbers<T::Abreast> for FourPlaces<'_, T> {
    #[inline(always)]
    fn get(&self, row: usize) -> T::Abreast {
        let [a, b, c, d] = &self.0;
        limbs::number([a.get(row), b.get(row), c.get(row), d.get(row)])
    }
}

/// All bodies of one state, limbs in lanes; false, and all is to be done body by body, if a hinge of theirs is singular.
pub(crate) struct LimbFilter<'r, 'a, 'b, T: Scalar> {
    pub(crate) filter: &'r mut Filter<T>,
    pub(crate) plan: &'a LimbPlan<T::Constant>,
    pub(crate) sweep: &'r mut Sweep<'a, 'b, T>,
}

impl<T: Scalar> Kernel for LimbFilter<'_, '_, '_, T> {
    type Output = Result<bool, DynamicsError>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let LimbFilter { filter, plan, sweep } = self;
        let Filter { numbers, limbs: groups, .. } = filter;
        // A workspace of another layout has no lanes for these limbs.
        if groups.len() != plan.groups.len() {
            return Ok(false);
        }
        for (of, own) in plan.groups.iter().zip(groups.iter_mut()) {
            if own.starts.len() != of.v.len() || !own.inward(of, sweep) {
                return Ok(false);
            }
        }
        for (of, own) in plan.groups.iter().zip(groups.iter()) {
            for (x, at) in own.residuals.iter().zip(&of.v) {
                let x = limbs::lanes::<T>(*x);
                for lane in 0..4 {
                    sweep.residuals[at[lane]] = x[lane];
                }
            }
        }
        let whole = sweep.layout;
        sweep.layout = &plan.layout;
        numbers.pending.clear();
        for (bodies, gift) in plan.trunk.iter().rev() {
            if let Some(gift) = gift {
                let (root, moved) = (&whole.bodies()[gift.root], &groups[gift.group].gifts[gift.lane]);
                if root.follows_parent(gift.root) {
                    numbers.hand = *moved;
                } else if root.parent != GROUND {
                    numbers.pending.put(moved);
                }
            }
            inward(numbers, &[], sweep, bodies.clone())?;
        }
        sweep.layout = whole;
        Ok(true)
    }
}
