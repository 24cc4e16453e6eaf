//! Forward dynamics of one state with its limbs in lanes ([`crate::layout::LimbPlan`]): the same sweeps, on registers in place of numbers.
//!
//! Limbs go first inward and last outward; the trunk meets what they give where they stand in the order of bodies.
//!
//! Symbols: those of [`crate::forward_dynamics`].

use super::ForwardDynamics;
use super::carrying::{Carrying, InNumbers, carried};
use super::run::Run;
use crate::error::{DynamicsError, check_length};
use crate::layout::{GROUND, Layout, LimbPlan, Limbs};
use crate::limbs::{self, Moved};
use core::marker::PhantomData;
use num_traits::Zero;
use phipsi_spatial::{ArticulatedInertia, Kernel, Motion, Scalar, SixLanes, Vec3, Wrench};

/// Workspace of one group of limbs.
#[derive(Clone, Debug)]
pub(super) struct OfLimbs<T: Scalar> {
    q: Vec<T::Abreast>,
    v: Vec<T::Abreast>,
    residuals: Vec<T::Abreast>,
    work: ForwardDynamics<T::Abreast>,
    /// What each limb gives to its parent.
    gifts: [Moved<T::Arithmetic>; 4],
}

impl<T: Scalar> OfLimbs<T> {
    pub(super) fn of_all(layout: &Layout<T::Constant>) -> Vec<Self> {
        let groups = layout.limbs.iter().flat_map(|plan| &plan.groups);
        groups
            .map(|limbs| {
                let zeros = vec![T::Abreast::zero(); limbs.q.len()];
                OfLimbs {
                    q: zeros.clone(),
                    v: zeros.clone(),
                    residuals: zeros,
                    work: ForwardDynamics::new(&limbs.layout),
                    gifts: [(ArticulatedInertia::zero(), Wrench::zero()); 4],
                }
            })
            .collect()
    }
    /// The limbs' part of a call.
    #[inline(always)]
    fn gather(&mut self, of: &Limbs<T::Constant>, run: &Run<'_, T>) {
        for (to, at) in self.q.iter_mut().zip(&of.q) {
            *to = limbs::numbers(run.call.q, *at);
        }
        for ((v, residual), at) in self.v.iter_mut().zip(&mut self.residuals).zip(&of.v) {
            *v = limbs::numbers(run.call.v, *at);
            *residual = limbs::numbers(run.residuals, *at);
        }
        if let Some(loads) = run.call.loads {
            for (i, to) in self.work.loads.iter_mut().enumerate() {
                let [a, b, c, d] = of.roots;
                let [a, b, c, d] = [&loads[a + i], &loads[b + i], &loads[c + i], &loads[d + i]];
                *to = Wrench::new(
                    limbs::vector([a.moment, b.moment, c.moment, d.moment]),
                    limbs::vector([a.force, b.force, c.force, d.force]),
                );
            }
        }
    }
    /// Velocities outward and the filter inward; false if a hinge of some limb is singular.
    #[inline(always)]
    fn filter(&mut self, of: &Limbs<T::Constant>, run: &Run<'_, T>) -> bool {
        self.gather(of, run);
        let mut omega = [Vec3::zero(); 4];
        for (omega, &parent) in omega.iter_mut().zip(&of.parents) {
            if parent != GROUND {
                *omega = run.moving[parent].omega;
            }
        }
        let loaded = run.call.loads.is_some();
        let OfLimbs { q, v, residuals, work, gifts } = self;
        let numbers = 0..q.len();
        let mut lanes = work.all_bodies(&of.layout, q, v, loaded, residuals);
        lanes.outside.0 = limbs::vector(omega);
        lanes.sweep_velocities::<false>(numbers.clone());
        if lanes.sweep_inboard::<false>(numbers).is_err() {
            return false;
        }
        limbs::give(of, &lanes.given.hand, gifts);
        true
    }
    /// The smoother outward.
    #[inline(always)]
    fn smooth(&mut self, of: &Limbs<T::Constant>, run: &mut Run<'_, T>) {
        let mut alpha = [run.call.ground; 4];
        for (alpha, &parent) in alpha.iter_mut().zip(&of.parents) {
            if parent != GROUND {
                *alpha = run.alpha[parent].get();
            }
        }
        let [a, b, c, d] = alpha;
        let OfLimbs { q, v, residuals, work, .. } = self;
        let numbers = 0..q.len();
        let mut lanes = work.all_bodies(&of.layout, q, v, false, residuals);
        lanes.outside.1 = Motion::new(
            limbs::vector([a.angular, b.angular, c.angular, d.angular]),
            limbs::vector([a.linear, b.linear, c.linear, d.linear]),
        );
        lanes.sweep_outboard::<false, InNumbers>(numbers);
        for (x, at) in residuals.iter().zip(&of.v) {
            let (x, [a, b, c, d]) = (limbs::lanes::<T::Arithmetic>(*x), *at);
            (run.residuals[a], run.residuals[b], run.residuals[c], run.residuals[d]) =
                (x[0], x[1], x[2], x[3]);
        }
    }
}

/// All bodies of one state, limbs in lanes. The result is false, and T is still in `out`, if a hinge of a limb is singular: body by
/// body, the error is that of the tipmost.
pub(super) struct RunWithLimbs<'a, T: Scalar> {
    pub(super) work: &'a mut ForwardDynamics<T>,
    pub(super) layout: &'a Layout<T::Constant>,
    pub(super) q: &'a [T::Arithmetic],
    pub(super) v: &'a [T::Arithmetic],
    pub(super) loaded: bool,
    pub(super) out: &'a mut [T::Arithmetic],
}

impl<T: Scalar> Kernel for RunWithLimbs<'_, T> {
    type Output = Result<bool, DynamicsError>;
    fn run(self) -> Self::Output {
        let RunWithLimbs { work, layout, q, v, loaded, out } = self;
        let Some(plan) = layout.limbs.as_deref() else { return Ok(false) };
        check_length("workspace", &work.limbs, plan.groups.len())?;
        for (limbs, own) in plan.groups.iter().zip(&work.limbs) {
            check_length("workspace", &own.q, limbs.q.len())?;
        }
        let mut own = core::mem::take(&mut work.limbs);
        let groups = &mut own[..];
        let run = &mut work.all_bodies(layout, q, v, loaded, out);
        run.call.layout = &plan.layout;
        let mut result = Ok(T::Arithmetic::dispatch(LimbsInward::<T> { run, plan, groups }));
        if let Ok(true) = result {
            result = carried!(run.call.lanes, |X| {
                T::Arithmetic::dispatch(Trunk::<T, X> { run, plan, groups, by: PhantomData })
            });
        }
        if let Ok(true) = result {
            T::Arithmetic::dispatch(LimbsOutward::<T> { run, plan, groups });
        }
        work.limbs = own;
        result
    }
}

/// Velocities of all, and the filter of limbs; false if a hinge of theirs is singular.
struct LimbsInward<'r, 'a, T: Scalar> {
    run: &'r mut Run<'a, T>,
    plan: &'r LimbPlan<T::Constant>,
    groups: &'r mut [OfLimbs<T>],
}

impl<T: Scalar> Kernel for LimbsInward<'_, '_, T> {
    type Output = bool;
    #[inline(always)]
    fn run(self) -> bool {
        for (bodies, _) in &self.plan.trunk {
            self.run.sweep_velocities::<false>(bodies.clone());
        }
        for (limbs, own) in self.plan.groups.iter().zip(self.groups) {
            if !own.filter(limbs, self.run) {
                return false;
            }
        }
        true
    }
}

/// The filter and the smoother of the trunk.
struct Trunk<'r, 'a, T: Scalar, X> {
    run: &'r mut Run<'a, T>,
    plan: &'r LimbPlan<T::Constant>,
    groups: &'r [OfLimbs<T>],
    by: PhantomData<X>,
}

impl<T: Scalar, X: Carrying<T>> Kernel for Trunk<'_, '_, T, X> {
    type Output = Result<bool, DynamicsError>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let Trunk { run, plan, groups, .. } = self;
        X::begin(run);
        for (bodies, gift) in plan.trunk.iter().rev() {
            if let Some(gift) = gift {
                X::take(run, gift.root, &groups[gift.group].gifts[gift.lane]);
            }
            if !bodies.is_empty() {
                X::inboard::<false>(run, bodies.clone())?;
            }
        }
        for (bodies, _) in &plan.trunk {
            run.sweep_outboard::<false, X>(bodies.clone());
        }
        Ok(true)
    }
}

/// The smoother of limbs.
struct LimbsOutward<'r, 'a, T: Scalar> {
    run: &'r mut Run<'a, T>,
    plan: &'r LimbPlan<T::Constant>,
    groups: &'r mut [OfLimbs<T>],
}

impl<T: Scalar> Kernel for LimbsOutward<'_, '_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        for (limbs, own) in self.plan.groups.iter().zip(self.groups) {
            own.smooth(limbs, self.run);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::{Inertia, Joint, Model};
    use phipsi_reference::generate::{case_with_limbs, rebuilt};

    fn accelerations(
        layout: &Layout<f64>,
        case: &phipsi_reference::generate::Case,
    ) -> Result<Vec<f64>, String> {
        crate::forward_dynamics(layout, &case.q, &case.v, &case.tau, None).map_err(|e| e.to_string())
    }

    fn without_limbs(model: &Model) -> Layout<f64> {
        let mut layout = Layout::new(model);
        layout.limbs = None;
        layout
    }

    /// A hinge that moves nothing, in a limb or in the trunk: the error is that of the sweep body by body.
    #[test]
    fn errors_are_those_of_single_bodies() {
        let mut failed = 0;
        for seed in 0..200 {
            let mut case = case_with_limbs(seed);
            let n = case.model.len();
            let bodies = [seed as usize * 7 % n, n - 1];
            let inertia = |k: usize, body: &phipsi_model::Body| {
                if bodies.contains(&k) { Inertia::ZERO } else { body.inertia }
            };
            let joint = |_: usize, joint: &Joint| (joint.kind, joint.placement);
            case.model = rebuilt(&case.model, inertia, joint, case.model.gravity());
            let (with, without) = (Layout::new(&case.model), without_limbs(&case.model));
            let [with, without] = [accelerations(&with, &case), accelerations(&without, &case)];
            assert_eq!(with.as_ref().err(), without.as_ref().err(), "seed {seed}");
            failed += usize::from(with.is_err());
        }
        assert!(failed > 100, "{failed}");
    }

    /// Gravity that is changed after the limbs were found reaches all of them; a workspace of another layout is refused. Orders of sums
    /// differ: ε times the number of bodies times the growth of M⁻¹ against 1/diag(M).
    #[test]
    fn gravity_is_the_layouts_own() {
        for seed in 0..50 {
            let case = case_with_limbs(seed);
            let gravity = Vec3([1.0, -2.0, 3.0]);
            let layouts =
                [Layout::new(&case.model), without_limbs(&case.model)].map(|l| l.with_gravity(gravity));
            let [with, without] = [0, 1].map(|i| accelerations(&layouts[i], &case).unwrap());
            let m = crate::mass_matrix(&layouts[1], &case.q).unwrap();
            let inverse = crate::mass_matrix_inverse(&layouts[1], &case.q).unwrap();
            let at = |i: usize| i * case.model.nv() + i;
            let growth = (0..case.model.nv()).map(|i| m[at(i)] * inverse[at(i)]).fold(1.0, f64::max);
            let largest = without.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
            let allowed = 8.0 * case.model.nv() as f64 * f64::EPSILON * growth * largest;
            for (a, b) in with.iter().zip(&without) {
                assert!((a - b).abs() <= allowed, "seed {seed}: {a} and {b}");
            }
            let mut other = ForwardDynamics::<f64>::new(&layouts[1]);
            let mut out = case.tau.clone();
            let result = other.run(&layouts[0], &case.q, &case.v, &case.tau, None, &mut out);
            assert_eq!(result.is_err(), layouts[0].limbs.is_some(), "seed {seed}");
        }
    }
}
