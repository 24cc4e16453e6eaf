//! Forward dynamics: a Kalman filter from tip to base and a Bryson–Frazier smoother back.
//!
//! Symbols: those of [`crate::articulated_sweep`], and
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | ω | angular velocity, body axes | paper 2 (3.7) |
//! | a | Coriolis acceleration (missing from paper 1's boundary-value problem): [`crate::kinematics`] | soa.md 3.0, 4 |
//! | c | (0, δω × δv), in the range of H*: sweeps work with θ̈ + c, so that a free body's speed stays out of its moments | |
//! | b | (ω × J ω, ω × (ω × h)) − w, gyroscopic force less the external wrench | soa.md 3.0 |
//! | α, α⁺ | acceleration of the body, and of its inboard side φ*α(p); α(ground) = (0, −g) | paper 1 (9.12)–(9.14) |

use crate::articulated_sweep::{Pivot, smooth, smooth_revolute};
use crate::branching::{Given, recur};
use crate::error::{DynamicsError, check_length};
use crate::flexible;
use crate::hinge::Hinge;
use crate::kinematics::{relative, relative_revolute};
use crate::layout::{GROUND, Layout, Shifts, TOGETHER, each_kind};
use crate::limbs::Moved;
use crate::link::each_shape;
use crate::packed::{Packed, is_lone};
use core::marker::PhantomData;
use core::ops::Range;
use num_traits::Zero;
use phipsi_spatial::{ArticulatedInertia, Kernel, Motion, Scalar, SixLanes, Vec3, Wrench};

mod carrying;
mod info;
mod inward;
mod limbs;
mod packed;
mod run;

use carrying::{Carrying, Lanes, carried};
pub use info::{ForwardInfo, WorstHinge, forward_info};
use limbs::{OfLimbs, RunWithLimbs};
use run::{Apart, Call, Filter, Run, Smoother};

/// What the first sweep leaves of a body.
#[derive(Clone, Copy, Debug)]
struct Moving<T> {
    omega: Vec3<T>,
    /// a, zero at a root.
    coriolis: Motion<T>,
}

/// Workspace of forward dynamics.
#[derive(Clone, Debug)]
pub struct ForwardDynamics<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    moving: Vec<Moving<T::Arithmetic>>,
    pivots: Vec<Pivot<T::Arithmetic>>,
    given: Given<Moved<T::Arithmetic>>,
    packed: Given<Packed<<T::Arithmetic as Scalar>::Six>>,
    /// α of bodies with several children.
    alpha: Vec<Apart<T::Arithmetic>>,
    /// Minus the external wrenches, where there are any.
    loads: Vec<Wrench<T::Arithmetic>>,
    /// Limbs in lanes, group by group.
    limbs: Vec<OfLimbs<T>>,
    lanes: Lanes,
    /// For a layout with flexible bodies.
    flexible: Option<Box<flexible::Forward<T>>>,
}

impl<T: Scalar> ForwardDynamics<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let n = layout.len();
        ForwardDynamics {
            shifts: Shifts::new(layout),
            moving: vec![Moving { omega: Vec3::zero(), coriolis: Motion::zero() }; n],
            pivots: vec![Pivot::empty(); layout.nv()],
            given: Given::new(layout, (ArticulatedInertia::zero(), Wrench::zero())),
            packed: Given::new(layout, Packed::zero::<T::Arithmetic>()),
            alpha: vec![Apart::zero(); n],
            loads: vec![Wrench::zero(); n],
            limbs: if is_lone::<T>() { OfLimbs::of_all(layout) } else { Vec::new() },
            lanes: Lanes::of::<T>(),
            flexible: layout.flexible().map(|tree| Box::new(flexible::Forward::new(tree))),
        }
    }
    /// A workspace in which inertias have their 21 entries, never the 36 of six-vectors in lanes: these are faster, but round an entry and its
    /// mirror image apart. Where lengths grow outward, a refinement finds no digits then that it finds otherwise: twice a link, 2e-10 in
    /// place of 3e-14.
    pub(crate) fn symmetric(layout: &Layout<T::Constant>) -> Self {
        ForwardDynamics { lanes: Lanes::Numbers, ..Self::new(layout) }
    }
    /// Accelerations of generalised forces `tau` at (q, v).
    ///
    /// # Computes
    /// θ̈ = (I − HψK)* D⁻¹ (I − HψK) (T − C), without forming the mass matrix (soa.md 3.1).
    ///
    /// # Shapes & units
    /// `q`: nq; `v`, `tau`, `out`: nv; `wrenches`: one per body of the model, at its frame's origin, its axes.
    ///
    /// # Cost
    /// O(n): three sweeps; no allocation. Of a tree of 8192 bodies or more, branches run side by side (feature `parallel`),
    /// for the same result: a few allocations for each.
    ///
    /// # Accuracy
    /// n·ε·κ, but ε × mass ratio where a heavy body hangs on a light one (soa.md 2.2); [`forward_info`] measures it.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`]; [`DynamicsError::SingularHinge`] if a D is not positive,
    /// also when an input is not finite.
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        tau: &[T],
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        check_length("q", q, layout.nq())?;
        check_length("v", v, layout.nv())?;
        check_length("tau", tau, layout.nv())?;
        check_length("out", out, layout.nv())?;
        check_length("workspace", &self.moving, layout.len())?;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, layout.model_bodies())?;
        }
        if layout.is_flexible() {
            out.copy_from_slice(tau);
            return flexible::Forward::run(&mut self.flexible, layout, (q, v), wrenches, out);
        }
        if let Some(wrenches) = wrenches {
            layout.gather_loads(wrenches, &mut self.loads);
        }
        out.copy_from_slice(tau);
        let (q, v, out) = (T::arithmetic(q), T::arithmetic(v), T::arithmetic_mut(out));
        let loaded = wrenches.is_some();
        let Some(branch) = layout.branches::<T>() else {
            if layout.limbs.is_some() {
                let work = &mut *self;
                let in_limbs = RunWithLimbs::<T> { work, layout, q, v, loaded, out: &mut *out };
                if T::lone(in_limbs).unwrap_or(Ok(false))? {
                    return Ok(());
                }
            }
            return carried!(self.lanes, |X| {
                T::Arithmetic::dispatch(Whole::<T, X> {
                    work: self,
                    layout,
                    q,
                    v,
                    loaded,
                    out,
                    by: PhantomData,
                })
            });
        };
        self.given.check(branch)?;
        self.given.clear();
        self.packed.clear();
        let mut run = self.all_bodies(layout, q, v, loaded, out);
        recur(Filter(run.again()), branch)?;
        recur(Smoother(run), branch)
    }
    /// All bodies as a run.
    #[inline(always)]
    fn all_bodies<'a>(
        &'a mut self,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        v: &'a [T::Arithmetic],
        loaded: bool,
        out: &'a mut [T::Arithmetic],
    ) -> Run<'a, T> {
        let ground = Motion::new(Vec3::zero(), -Vec3::constant(layout.gravity));
        let loads = if loaded { Some(&self.loads[..]) } else { None };
        self.given.pending.clear();
        self.packed.pending.clear();
        Run {
            call: Call { layout, q, v, loads, ground, lanes: self.lanes },
            first: 0,
            first_v: 0,
            outside: (Vec3::zero(), ground),
            shifts: self.shifts.run(),
            moving: &mut self.moving,
            pivots: &mut self.pivots,
            alpha: &mut self.alpha,
            residuals: out,
            given: &mut self.given,
            packed: &mut self.packed,
        }
    }
}

/// All bodies at once. Each way of carrying has a kernel of its own: a register of 64 bytes that one moves would slow down the others.
struct Whole<'a, T: Scalar, X> {
    work: &'a mut ForwardDynamics<T>,
    layout: &'a Layout<T::Constant>,
    q: &'a [T::Arithmetic],
    v: &'a [T::Arithmetic],
    loaded: bool,
    out: &'a mut [T::Arithmetic],
    by: PhantomData<X>,
}

impl<T: Scalar, X: Carrying<T>> Kernel for Whole<'_, T, X> {
    type Output = Result<(), DynamicsError>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let Whole { work, layout, q, v, loaded, out, .. } = self;
        // A run that is made here stays in registers, where its firsts are zero.
        let mut run = work.all_bodies(layout, q, v, loaded, out);
        let numbers = 0..layout.bodies.len();
        run.sweep_velocities::<true>(numbers.clone());
        X::inboard::<true>(&mut run, numbers.clone())?;
        run.sweep_outboard::<true, X>(numbers);
        Ok(())
    }
}

impl<T: Scalar> Run<'_, T> {
    /// Velocities outward: with the sines of `ALL` hinges at once, or of some bodies at a time.
    #[inline(always)]
    fn sweep_velocities<const WHOLE: bool>(&mut self, numbers: Range<usize>) {
        let mut previous = self.outside.0;
        if WHOLE {
            self.shifts.begin_all(self.call.layout, self.call.q);
            self.velocities::<WHOLE>(numbers, previous);
            return;
        }
        for start in numbers.clone().step_by(TOGETHER) {
            let some = start..numbers.end.min(start + TOGETHER);
            self.shifts
                .begin(&self.call.layout.bodies[self.first + some.start..self.first + some.end], self.call.q);
            previous = self.velocities::<WHOLE>(some, previous);
        }
    }

    /// Velocities of bodies whose sines are taken; returns ω of the last.
    #[inline(always)]
    fn velocities<const WHOLE: bool>(
        &mut self,
        numbers: Range<usize>,
        mut previous: Vec3<T::Arithmetic>,
    ) -> Vec3<T::Arithmetic> {
        let Call { layout, q, v, .. } = self.call;
        let (first, end, given) = (self.first::<WHOLE>(), numbers.end, self.outside.0);
        let bodies = &layout.bodies[first..first + end];
        let moving = &mut self.moving[..end];
        let mut i = numbers.start;
        while i < end {
            let mut omega = match bodies[i].parent {
                GROUND => given,
                _ if bodies[i].follows_parent(first + i) => previous,
                parent if WHOLE => moving[parent].omega,
                parent => moving.get(parent.wrapping_sub(first)).map_or(given, |parent| parent.omega),
            };
            // Along a run of first children ω stays in registers.
            loop {
                let body = &bodies[i];
                let coriolis;
                if let Hinge::Revolute = body.hinge {
                    let (turn, rate) = (self.shifts.turned::<WHOLE>(i - numbers.start, body, q), v[body.v]);
                    self.shifts.set_turn(i, turn);
                    if body.parent == GROUND {
                        omega = Vec3([T::Arithmetic::zero(), T::Arithmetic::zero(), rate]);
                        coriolis = Motion::zero();
                    } else {
                        let shift = body.link.hinged(turn);
                        let (carried, centripetal) =
                            each_shape!(body.link, |link| link.carried(&shift, omega));
                        (omega, coriolis) = relative_revolute(carried, centripetal, rate);
                    }
                } else {
                    (omega, coriolis) = each_kind!(body, |known| {
                        self.shifts.set::<WHOLE>(i, i - numbers.start, known, q);
                        let joint = known.hinge.expand(&v[known.v..]);
                        if known.parent == GROUND {
                            (joint.angular, Motion::zero())
                        } else {
                            let (carried, centripetal) = self.shifts.at(i, known).carried(omega);
                            relative(&known.hinge, carried, centripetal, joint)
                        }
                    });
                }
                moving[i] = Moving { omega, coriolis };
                i += 1;
                if i == end || !bodies[i].follows_parent(first + i) {
                    break;
                }
            }
            previous = omega;
        }
        previous
    }

    /// Bryson–Frazier smoother: `residuals` holds ν before and θ̈ after. Where six-vectors are in lanes, gains
    /// of joints of one axis are seen from the parent, so that θ̈ and α are calculated side by side.
    #[inline(always)]
    fn sweep_outboard<const WHOLE: bool, X: Carrying<T>>(&mut self, numbers: Range<usize>) {
        let Call { layout, v, .. } = self.call;
        let (first, first_v) = (self.first::<WHOLE>(), self.first_v::<WHOLE>());
        let (end, given) = (numbers.end, self.outside.1);
        let bodies = &layout.bodies[first..first + end];
        let (moving, alpha_of) = (&self.moving[..end], &mut self.alpha[..end]);
        let (pivots, residuals) = (&*self.pivots, &mut *self.residuals);
        let mut previous = given;
        let mut i = numbers.start;
        while i < end {
            let mut alpha = match bodies[i].parent {
                GROUND => given,
                _ if bodies[i].follows_parent(first + i) => previous,
                parent if WHOLE => alpha_of[parent].get(),
                parent => alpha_of.get(parent.wrapping_sub(first)).map_or(given, Apart::get),
            };
            // Along a run of first children α stays in registers.
            loop {
                let (body, inboard) = (&bodies[i], alpha);
                let at = body.v - first_v;
                let a = &moving[i].coriolis;
                if let Hinge::Revolute = body.hinge {
                    let shift = body.link.hinged(self.shifts.turn(i));
                    if X::PACKED {
                        alpha = each_shape!(body.link, |link| link.motion_to_child_plus(&shift, inboard, a));
                        residuals[at] -= inboard.dot(pivots[at].gain);
                        alpha.angular.0[2] += residuals[at];
                    } else {
                        alpha = each_shape!(body.link, |link| link.motion_to_child(&shift, inboard));
                        residuals[at] = smooth_revolute(&pivots[at], &mut alpha, residuals[at]);
                        alpha += *a;
                    }
                } else if X::PACKED
                    && let Hinge::Prismatic = body.hinge
                    && body.parent != GROUND
                {
                    alpha = self.shifts.at(i, body).motion_to_child(inboard);
                    residuals[at] -= inboard.dot(pivots[at].gain);
                    alpha.linear.0[2] += residuals[at];
                    alpha += *a;
                } else {
                    alpha = each_kind!(body, |known| {
                        let dofs = at..at + known.hinge.nv();
                        let mut alpha = self.shifts.at(i, known).motion_to_child(inboard);
                        smooth(&known.hinge, &pivots[dofs.clone()], &mut alpha, &mut residuals[dofs.clone()]);
                        known.hinge.subtract_turning(&v[known.v..], &mut residuals[dofs]);
                        alpha + *a
                    });
                }
                if body.children > 1 {
                    alpha_of[i].set(&alpha);
                }
                i += 1;
                if i == end || !bodies[i].follows_parent(first + i) {
                    break;
                }
            }
            previous = alpha;
        }
        // An only child may be a limb in lanes.
        if !WHOLE && end > numbers.start {
            alpha_of[end - 1].set(&previous);
        }
    }
}

/// [`ForwardDynamics::run`] for a single call.
///
/// # Errors
/// As there.
pub fn forward_dynamics<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    ForwardDynamics::new(layout).run(layout, q, v, tau, wrenches, &mut out)?;
    Ok(out)
}
