//! Inverse dynamics: joint forces of a given motion (Newton–Euler).
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | ω, α | angular velocity and inertial acceleration of a body, α(ground) = (0, −g) | soa.md 3.0 |
//! | a, c | Coriolis accelerations: [`crate::kinematics`] | soa.md 3.0 |
//! | b | (ω × J ω, ω × (ω × h)), gyroscopic force | soa.md 3.0 |
//! | f | M α + b − w + Σ φ(k,c) f(c), force across the joint | paper 1 (5.1), paper 2 (3.6) |
//! | T | H f, generalised force | paper 1 |

use crate::branching::{Given, recur};
use crate::error::{DynamicsError, check_length};
use crate::flexible;
use crate::hinge::{Hinge, each_component};
use crate::kernel::kernel;
use crate::kinematics::relative;
use crate::layout::{GROUND, Layout, LayoutBody, Passage, Shifts, TOGETHER};
use crate::link::each_shape;
use core::ops::Range;
use phipsi_spatial::{Motion, RigidInertia, Scalar, Vec3, Wrench};

mod run;

use run::{Call, Run};

/// ω and α of a body.
type Moving<T> = (Vec3<T>, Motion<T>);

/// Workspace of inverse dynamics.
#[derive(Clone, Debug)]
pub struct InverseDynamics<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    /// Motion of bodies with several children.
    moving: Vec<Moving<T::Arithmetic>>,
    /// f, before what comes from outboard.
    force: Vec<Wrench<T::Arithmetic>>,
    given: Given<Wrench<T::Arithmetic>>,
    loads: Vec<Wrench<T::Arithmetic>>,
    /// For a layout with flexible bodies.
    flexible: Option<Box<flexible::Inverse<T>>>,
}

impl<T: Scalar> InverseDynamics<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let n = layout.len();
        InverseDynamics {
            shifts: Shifts::new(layout),
            moving: vec![(Vec3::zero(), Motion::zero()); n],
            force: vec![Wrench::zero(); n],
            given: Given::new(layout, Wrench::zero()),
            loads: vec![Wrench::zero(); n],
            flexible: layout.flexible().map(|tree| Box::new(flexible::Inverse::new(tree))),
        }
    }
    /// Generalised forces of accelerations `a` at (q, v).
    ///
    /// # Computes
    /// T = H φ [M (φ*(H* a + coriolis) + gravity) + b − w], soa.md 3.1.
    ///
    /// # Shapes & units
    /// `q`: nq; `v`, `a`, `out`: nv; `wrenches`: one per body of the model, at its frame's origin, its axes, acting on it.
    ///
    /// # Cost
    /// O(n): one outward and one inward sweep; no allocation. Of a tree of 8192 bodies or more, branches run side by side
    /// (feature `parallel`), for the same result: a few allocations for each.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`]; [`DynamicsError::Closure`] if the model has closures.
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        a: &[T],
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        check_length("q", q, layout.nq())?;
        check_length("v", v, layout.nv())?;
        check_length("a", a, layout.nv())?;
        check_length("out", out, layout.nv())?;
        check_length("workspace", &self.force, layout.len())?;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, layout.model_bodies())?;
        }
        if layout.is_flexible() {
            return flexible::Inverse::run(&mut self.flexible, layout, (q, v, a), wrenches, out);
        }
        if let Some(wrenches) = wrenches {
            layout.gather_loads(wrenches, &mut self.loads);
        }
        let (q, v, a) = (T::arithmetic(q), T::arithmetic(v), T::arithmetic(a));
        let (loaded, out) = (wrenches.is_some(), T::arithmetic_mut(out));
        let Some(branch) = layout.branches::<T>() else {
            T::Arithmetic::dispatch(Whole { work: self, layout, q, v, a, loaded, out });
            return Ok(());
        };
        self.given.check(branch)?;
        self.given.clear();
        recur(self.all_bodies(layout, q, v, a, loaded, out), branch)
    }
    /// All bodies as a run.
    #[inline(always)]
    fn all_bodies<'a>(
        &'a mut self,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        v: &'a [T::Arithmetic],
        a: &'a [T::Arithmetic],
        loaded: bool,
        out: &'a mut [T::Arithmetic],
    ) -> Run<'a, T> {
        let loads = if loaded { Some(&self.loads[..]) } else { None };
        self.given.pending.clear();
        Run {
            call: Call { layout, q, v, a, loads },
            first: 0,
            first_v: 0,
            outside: (Vec3::zero(), Motion::new(Vec3::zero(), -Vec3::constant(layout.gravity))),
            shifts: self.shifts.run(),
            moving: &mut self.moving,
            force: &mut self.force,
            out,
            given: &mut self.given,
        }
    }
}

kernel! {
    Whole<'a, T> {
        work: &'a mut InverseDynamics<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        v: &'a [T::Arithmetic],
        a: &'a [T::Arithmetic],
        loaded: bool,
        out: &'a mut [T::Arithmetic],
    } -> () {
        // A run that is made here stays in registers, where its firsts are zero.
        let mut run = work.all_bodies(layout, q, v, a, loaded, out);
        let numbers = 0..layout.bodies.len();
        run.sweep_outboard::<true>(numbers.clone());
        run.sweep_inboard::<true>(numbers);
    }
}

impl<T: Scalar> Run<'_, T> {
    /// Outward: with the sines of `ALL` hinges at once, or of some bodies at a time.
    #[inline(always)]
    fn sweep_outboard<const WHOLE: bool>(&mut self, numbers: Range<usize>) {
        let mut previous = self.outside;
        if WHOLE {
            self.shifts.begin_all(self.call.layout, self.call.q);
            self.outward::<WHOLE>(numbers, previous);
            return;
        }
        for start in numbers.clone().step_by(TOGETHER) {
            let some = start..numbers.end.min(start + TOGETHER);
            self.shifts
                .begin(&self.call.layout.bodies[self.first + some.start..self.first + some.end], self.call.q);
            previous = self.outward::<WHOLE>(some, previous);
        }
    }

    /// Motions and forces of bodies whose sines are taken; returns the motion of the last.
    #[inline(always)]
    fn outward<const WHOLE: bool>(
        &mut self,
        numbers: Range<usize>,
        mut previous: Moving<T::Arithmetic>,
    ) -> Moving<T::Arithmetic> {
        let Call { layout, q, v, a, .. } = self.call;
        let (first, end, given) = (self.first::<WHOLE>(), numbers.end, self.outside);
        let bodies = &layout.bodies[first..first + end];
        let (moving, force) = (&mut self.moving[..end], &mut self.force[..end]);
        let mut i = numbers.start;
        while i < end {
            let mut inboard = match bodies[i].parent {
                GROUND => given,
                _ if bodies[i].follows_parent(first + i) => previous,
                parent if WHOLE => moving[parent],
                parent => moving.get(parent.wrapping_sub(first)).copied().unwrap_or(given),
            };
            // Along a run of first children the motion stays in registers.
            loop {
                let body = &bodies[i];
                inboard = if let Hinge::Revolute = body.hinge {
                    let turn = self.shifts.turned::<WHOLE>(i - numbers.start, body, q);
                    self.shifts.set_turn(i, turn);
                    let shift = body.link.hinged(turn);
                    let (carried, alpha) = each_shape!(body.link, |link| link.carried_along(&shift, inboard));
                    let ([x, y, z], [dx, dy, dz]) = (carried.0, alpha.angular.0);
                    let (rate, push) = (v[body.v], a[body.v]);
                    let angular = Vec3([y.fma(rate, dx), (-x).fma(rate, dy), dz + push]);
                    (Vec3([x, y, z + rate]), Motion::new(angular, alpha.linear))
                } else {
                    self.shifts.set::<WHOLE>(i, i - numbers.start, body, q);
                    motion_past(body, self.shifts.at(i, body), (&v[body.v..], &a[body.v..]), inboard)
                };
                force[i] = RigidInertia::constant(&body.inertia).force(inboard.0, inboard.1);
                if body.children > 1 {
                    moving[i] = inboard;
                }
                i += 1;
                if i == end || !bodies[i].follows_parent(first + i) {
                    break;
                }
            }
            previous = inboard;
        }
        previous
    }

    #[inline(always)]
    fn sweep_inboard<const WHOLE: bool>(&mut self, numbers: Range<usize>) {
        let Call { layout, loads, .. } = self.call;
        let (first, first_v, end) = (self.first::<WHOLE>(), self.first_v::<WHOLE>(), numbers.end);
        let bodies = &layout.bodies[first..first + end];
        let (force, out) = (&self.force[..end], &mut *self.out);
        let mut hand = if WHOLE { Wrench::zero() } else { self.given.hand };
        for i in numbers.rev() {
            let (k, body) = (first + i, &bodies[i]);
            let own = force[i];
            let mut f = self.given.pending.all(body, &mut hand, |a, b| *a += *b).map_or(own, |f| f + own);
            if let Some(loads) = loads {
                f += loads[k];
            }
            let v = body.v - first_v;
            if let Hinge::Revolute = body.hinge {
                out[v] = f.moment.0[2];
                if body.parent != GROUND {
                    let shift = body.link.hinged(self.shifts.turn(i));
                    let moved = each_shape!(body.link, |link| link.wrench_to_parent(&shift, f));
                    self.given.pending.give(k, body, &mut hand, moved);
                }
                continue;
            }
            let along = &mut out[v..v + body.hinge.nv()];
            each_component!(body.hinge, |I, C| along[I] = f.get(C), along[0] = body.hinge.project(0, &f));
            if body.parent != GROUND {
                self.given.pending.give(k, body, &mut hand, self.shifts.at(i, body).wrench_to_parent(f));
            }
        }
        if !WHOLE {
            self.given.hand = hand;
        }
    }
}

/// ω and α past any joint with these rates of its coordinates.
#[inline(always)]
fn motion_past<T: Scalar>(
    body: &LayoutBody<T::Constant>,
    passage: Passage<'_, T>,
    (v, a): (&[T], &[T]),
    inboard: Moving<T>,
) -> Moving<T> {
    let joint = body.hinge.expand(v);
    let mut alpha = passage.motion_to_child(inboard.1) + body.hinge.expand(a);
    if matches!(body.hinge, Hinge::Planar | Hinge::Free) {
        alpha += body.hinge.turning(v);
    }
    if body.parent == GROUND {
        return (joint.angular, alpha);
    }
    let (carried, centripetal) = passage.carried(inboard.0);
    let (omega, coriolis) = relative(&body.hinge, carried, centripetal, joint);
    (omega, alpha + coriolis)
}

/// [`InverseDynamics::run`] for a single call.
///
/// # Errors
/// As there.
pub fn inverse_dynamics<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    a: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    InverseDynamics::new(layout).run(layout, q, v, a, wrenches, &mut out)?;
    Ok(out)
}

/// Inverse dynamics at a = 0: Coriolis, centrifugal and gravity forces.
///
/// # Errors
/// As [`InverseDynamics::run`].
pub fn bias_forces<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
) -> Result<Vec<T>, DynamicsError> {
    inverse_dynamics(layout, q, v, &vec![T::zero(); layout.nv()], None)
}

/// The forces that hold the mechanism at rest against gravity.
///
/// # Errors
/// As [`InverseDynamics::run`].
pub fn gravity_forces<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<Vec<T>, DynamicsError> {
    let zero = vec![T::zero(); layout.nv()];
    inverse_dynamics(layout, q, &zero, &zero, None)
}

/// M(q) x in O(n), without the matrix.
///
/// # Errors
/// As [`InverseDynamics::run`].
pub fn multiply_by_mass_matrix<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    x: &[T],
) -> Result<Vec<T>, DynamicsError> {
    let weightless = layout.clone().inertial();
    inverse_dynamics(&weightless, q, &vec![T::zero(); layout.nv()], x, None)
}
