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
            inward(numbers, sweep, bodies.clone())?;
        }
        sweep.layout = whole;
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use crate::layout::Layout;
    use phipsi_model::{Body, Inertia, Joint};
    use phipsi_reference::generate::{Case, case_with_limbs, rebuilt};
    use phipsi_spatial::lanes::Level;

    type Three = (Vec<f64>, Vec<f64>, Vec<f64>);

    fn derivatives(layout: &Layout<f64>, case: &Case) -> Result<Three, String> {
        let (q, v, tau) = (&case.q[..], &case.v[..], &case.tau[..]);
        crate::forward_dynamics_derivatives(layout, q, v, tau, Some(&case.wrenches))
            .map_err(|e| e.to_string())
    }

    /// Limbs in lanes and bodies one by one round what they add in other orders; a small D divides it: ε times the number of bodies times the
    /// growth of M⁻¹ against 1/diag(M). A hinge that fails is the same one.
    #[test]
    fn limbs_in_lanes_have_the_derivatives_of_bodies_one_by_one() {
        let (mut in_lanes, mut failed) = (0, 0);
        for seed in 0..200 {
            let mut case = case_with_limbs(seed);
            if seed % 4 == 3 {
                let k = seed as usize * 5 % case.model.len();
                let inertia = |i: usize, body: &Body| if i == k { Inertia::ZERO } else { body.inertia };
                let joint = |_: usize, joint: &Joint| (joint.kind, joint.placement);
                case.model = rebuilt(&case.model, inertia, joint, case.model.gravity());
            }
            let (with, mut without) = (Layout::new(&case.model), Layout::new(&case.model));
            without.limbs = None;
            in_lanes += usize::from(with.limbs.is_some());
            let nv = case.model.nv();
            match (derivatives(&with, &case), derivatives(&without, &case)) {
                (Ok(a), Ok(b)) => {
                    let m = crate::mass_matrix(&without, &case.q).unwrap();
                    let growth = (0..nv).map(|i| m[i * nv + i] * b.2[i * nv + i]).fold(1.0, f64::max);
                    for (a, b) in [(a.0, b.0), (a.1, b.1), (a.2, b.2)] {
                        let largest = b.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
                        let allowed = 8.0 * nv as f64 * f64::EPSILON * growth * largest;
                        for (a, b) in a.iter().zip(&b) {
                            assert!(
                                (a - b).abs() <= allowed,
                                "seed {seed}: {a} and {b}, allowed {allowed:e}"
                            );
                        }
                    }
                }
                (a, b) => {
                    assert_eq!(a.map(|_| ()), b.map(|_| ()), "seed {seed}");
                    failed += 1;
                }
            }
        }
        let expected = if Level::best() >= Level::Avx2 { 200 } else { 0 };
        assert_eq!(in_lanes, expected);
        assert!(failed > 10, "{failed}");
    }
}
