//! Forward dynamics on the table of the derivatives: the recursion of [`crate::forward_dynamics`] in the axes of the ground, where
//! the derivatives have velocities and inertias of the bodies anyway. An inertia that goes to the parent is only shifted. A floating base
//! is eliminated in its own axes.
//!
//! Symbols: those of [`crate::articulated_sweep`] and [`crate::forward_dynamics`].

use crate::error::DynamicsError;
use crate::floating_base::{self, along_axes, each_axis, seen};
use crate::ground_axes::{AXIS, COMPOSITE, OFFSET};
use crate::hinge::Hinge;
use crate::innovations::Gains;
use crate::inverse_dynamics_derivatives::{ALPHA, FORCE, ROWS};
use crate::layout::{GROUND, Layout, LayoutBody, Pending};
use crate::limbs::Moved;
use crate::packed::Packed;
use crate::places::{Lane, Places, Table, View};
use core::ops::Range;
use phipsi_spatial::{ArticulatedInertia, Motion, RigidInertia, Scalar, SixLanes, Sym3, Vec3, Wrench};

mod limbs;
mod packed;

pub(super) use limbs::LimbFilter;
use limbs::OfLimbs;

/// A D below this multiple of ε, against the inertia that it is a sum of, may be rounding alone: an axis that was turned into those of the
/// ground does not find an exact zero again. At most ten roundings turn an inertia, and six take its components along an axis.
const ROUNDING: f64 = 16.0;

/// What the filter keeps.
#[derive(Clone, Debug)]
pub(super) struct Filter<T: Scalar> {
    numbers: Waiting<Moved<T>>,
    /// The same where six-vectors are in lanes.
    packed: Waiting<Packed<T::Six>>,
    /// Limbs in lanes, group by group.
    limbs: Vec<OfLimbs<T>>,
}

/// What children gave, that of the first one in hand.
#[derive(Clone, Debug)]
struct Waiting<X> {
    pending: Pending<X>,
    hand: X,
}

impl<X: Copy> Waiting<X> {
    fn new<C: Scalar>(layout: &Layout<C>, zero: X) -> Self {
        Waiting { pending: Pending::new(layout, zero), hand: zero }
    }
}

/// What the steps of the sweep read and write.
pub(super) struct Sweep<'a, 'b, T: Scalar> {
    pub(super) layout: &'a Layout<T::Constant>,
    pub(super) places: &'a Places,
    /// Bodies with their own inertias, what turning and loads need as `FORCE`, and a as `ALPHA`.
    pub(super) view: View<'b, T, ROWS>,
    /// Of all degrees of freedom, by places.
    pub(super) gains: Gains<'b, T>,
    /// T before and ν after, in the order of v.
    pub(super) residuals: &'a mut [T],
}

impl<T: Scalar> Filter<T> {
    /// Of a `lone` state limbs may be in lanes.
    pub(super) fn new(layout: &Layout<T::Constant>, places: &Places, lone: bool) -> Self {
        let plan = layout.limbs.as_deref().filter(|_| lone);
        Filter {
            numbers: Waiting::new(layout, Carried::zero()),
            packed: Waiting::new(layout, Packed::zero::<T>()),
            limbs: plan.map_or(Vec::new(), |plan| OfLimbs::of_all(plan, places)),
        }
    }
    /// Tip to base; of a `lone` state in the lanes of the processor, if that is faster.
    #[inline(always)]
    pub(super) fn inward(&mut self, lone: bool, sweep: &mut Sweep<'_, '_, T>) -> Result<(), DynamicsError> {
        self.numbers.pending.clear();
        self.packed.pending.clear();
        if !lone || !<T::Six as SixLanes<T>>::is_fast() {
            return inward(&mut self.numbers, sweep, 0..sweep.layout.len());
        }
        inward(&mut self.packed, sweep, 0..sweep.layout.len())
    }
}

/// P and z as they go inward.
trait Carried<T: Scalar>: Copy {
    fn zero() -> Self;
    fn add(&mut self, other: &Self);
    fn of(moved: &Moved<T>) -> Self;
    fn numbers(&self) -> Moved<T>;
    /// Past a joint of one axis, to the parent's origin. Without `LINEAR`, the axis has no linear part.
    fn pass_axis<const LINEAR: bool>(
        &mut self,
        body: &LayoutBody<T::Constant>,
        place: usize,
        sweep: &mut Sweep<'_, '_, T>,
    ) -> Result<(), DynamicsError>;
}

/// Tip to base over some bodies, after all that is outboard of them.
#[inline(always)]
fn inward<T: Scalar, X: Carried<T>>(
    Waiting { pending, hand }: &mut Waiting<X>,
    sweep: &mut Sweep<'_, '_, T>,
    numbers: Range<usize>,
) -> Result<(), DynamicsError> {
    let layout = sweep.layout;
    let (bodies, first) = (layout.bodies(), &sweep.places.first[..layout.len()]);
    let mut k = numbers.end;
    while k > numbers.start {
        k -= 1;
        let body = &bodies[k];
        for _ in 1..body.children {
            hand.add(pending.take());
        }
        if body.hinge.nv() > 1 {
            let moved = pass_joint(body, first[k], &hand.numbers(), sweep)?;
            pending.give(k, body, hand, X::of(&moved));
            continue;
        }
        // Along a run of joints of one axis the sum stays in registers.
        let mut run = if body.children == 0 { X::zero() } else { *hand };
        loop {
            let body = &bodies[k];
            if let Hinge::Revolute = body.hinge {
                run.pass_axis::<false>(body, first[k], sweep)?;
            } else {
                run.pass_axis::<true>(body, first[k], sweep)?;
            }
            if !body.follows_parent(k) {
                if body.parent != GROUND {
                    pending.put(&run);
                }
                break;
            }
            let parent = &bodies[k - 1];
            if parent.children > 1 || parent.hinge.nv() > 1 {
                *hand = run;
                break;
            }
            k -= 1;
        }
    }
    Ok(())
}

impl<T: Scalar> Carried<T> for Moved<T> {
    #[inline(always)]
    fn zero() -> Self {
        (ArticulatedInertia::zero(), Wrench::zero())
    }
    #[inline(always)]
    fn add(&mut self, other: &Self) {
        self.0 = self.0 + other.0;
        self.1 += other.1;
    }
    #[inline(always)]
    fn of(moved: &Moved<T>) -> Self {
        *moved
    }
    #[inline(always)]
    fn numbers(&self) -> Moved<T> {
        *self
    }
    #[inline(always)]
    fn pass_axis<const LINEAR: bool>(
        &mut self,
        body: &LayoutBody<T::Constant>,
        place: usize,
        Sweep { layout, view, gains, residuals, .. }: &mut Sweep<'_, '_, T>,
    ) -> Result<(), DynamicsError> {
        let (at, root) = (view.lane(Table::<T, ROWS>::start(place)), body.parent == GROUND);
        match pass_axis::<T, _, LINEAR>(self, &at, root, residuals[body.v]) {
            Ok(Passed { gain, inverse, nu }) => {
                gains.set(place, gain, inverse);
                residuals[body.v] = nu;
                Ok(())
            }
            Err(D) => Err(layout.singular(body.v, D.min_lane())),
        }
    }
}

/// What the filter keeps of an axis.
struct Passed<T> {
    gain: Wrench<T>,
    inverse: T,
    nu: T,
}

/// The numbers of a body that a step reads, by rows of the table.
trait Numbers<T: Scalar> {
    fn get(&self, row: usize) -> T;
    #[inline(always)]
    fn vector(&self, row: usize) -> Vec3<T> {
        Vec3([self.get(row), self.get(row + 1), self.get(row + 2)])
    }
    #[inline(always)]
    fn motion(&self, row: usize) -> Motion<T> {
        Motion::new(self.vector(row), self.vector(row + 3))
    }
}

impl<T: Scalar> Numbers<T> for Lane<'_, T, ROWS> {
    #[inline(always)]
    fn get(&self, row: usize) -> T {
        Lane::get(self, row)
    }
}

/// Past a joint of one axis, to the parent's origin, under the force T of the joint. On failure D.
#[inline(always)]
fn pass_axis<T: Scalar, N: Numbers<T>, const LINEAR: bool>(
    (P, z): &mut Moved<T>,
    here: &N,
    root: bool,
    force: T,
) -> Result<Passed<T>, T> {
    *P = P.plus_rigid(&own_inertia(here));
    let turning = here.motion(FORCE);
    *z += Wrench::new(turning.angular, turning.linear);
    if !root {
        *z += P.times(here.motion(ALPHA));
    }
    let s = here.vector(AXIS);
    let mut U = Wrench::new(P.inertia * s, P.coupling.transpose_mul(s));
    let mut D = s.dot(U.moment);
    let mut along = s.dot(z.moment);
    let mut scale = P.inertia.xx + P.inertia.yy + P.inertia.zz;
    if LINEAR {
        let b = here.vector(AXIS + 3);
        U += Wrench::new(P.coupling * b, P.mass * b);
        D = s.dot(U.moment) + b.dot(U.force);
        along += b.dot(z.force);
        scale = s.dot(s) * scale + b.dot(b) * (P.mass.xx + P.mass.yy + P.mass.zz);
    }
    let inverse = reciprocal(D, scale)?;
    let gain = U.scale(inverse);
    let innovation = force - along;
    if !root {
        *z = gain.scale_add(innovation, *z);
        P.subtract_outer(gain, U);
        let d = here.vector(OFFSET);
        z.moment = d.cross_add(z.force, z.moment);
        *P = P.shifted(d);
    }
    Ok(Passed { gain, inverse, nu: innovation * inverse })
}

#[inline(always)]
fn own_inertia<T: Scalar, N: Numbers<T>>(here: &N) -> RigidInertia<T> {
    let ([xx, xy, xz], [yy, yz, zz]) = (here.vector(COMPOSITE + 4).0, here.vector(COMPOSITE + 7).0);
    RigidInertia {
        mass: here.get(COMPOSITE),
        first_moment: here.vector(COMPOSITE + 1),
        inertia: Sym3 { xx, xy, xz, yy, yz, zz },
    }
}

/// The same past any other joint, of what comes from outboard.
#[inline(always)]
fn pass_joint<T: Scalar>(
    body: &LayoutBody<T::Constant>,
    place: usize,
    outboard: &Moved<T>,
    Sweep { layout, view, gains, residuals, .. }: &mut Sweep<'_, '_, T>,
) -> Result<Moved<T>, DynamicsError> {
    let here = view.at(place);
    let (own, force) = (here.rigid::<T>(COMPOSITE), here.wrench::<T>(FORCE));
    let (mut P, mut z) = if body.children == 0 {
        (own.to_articulated(), force)
    } else {
        (outboard.0.plus_rigid(&own), outboard.1 + force)
    };
    if body.floats() {
        let axes = here.axes();
        let (K, inverses) =
            floating_base::factor(&axes, &P, |i, D, scale| pivot(layout, body.v + i, D, scale))?;
        gains.set_base(place, &K, &inverses);
        let mut difference = along_axes(&axes, &-z);
        each_axis!(|I| difference[I] += residuals[body.v + I]);
        let epsilon = floating_base::innovations(&K, difference);
        each_axis!(|I| residuals[body.v + I] = epsilon[I] * inverses[I]);
        return Ok((P, z));
    }
    if body.parent != GROUND {
        z += P.times(here.motion(ALPHA));
    }
    // Of what the whole joint sees: the last axes of a joint have little left.
    let (turning, sliding) = (P.inertia.xx + P.inertia.yy + P.inertia.zz, P.mass.xx + P.mass.yy + P.mass.zz);
    let mut passed = Wrench::zero();
    for i in 0..body.hinge.nv() {
        let S = view.at(place + i).motion::<T>(AXIS);
        let U = P.times(S);
        let scale = S.angular.dot(S.angular) * turning + S.linear.dot(S.linear) * sliding;
        let inverse = pivot(layout, body.v + i, S.dot(U), scale)?;
        let gain = U.scale(inverse);
        gains.set(place + i, gain, inverse);
        let force = residuals[body.v + i];
        let innovation = force - S.dot(z);
        residuals[body.v + i] = innovation * inverse;
        z = gain.scale_add(innovation, z);
        P.subtract_outer(gain, U);
        passed += Wrench::new(S.angular.scale(force), S.linear.scale(force));
    }
    if body.parent == GROUND {
        return Ok((P, z));
    }
    if let Hinge::Free = body.hinge {
        // H = I: its own force passes, and nothing of what comes from outboard.
        (P, z) = (ArticulatedInertia::zero(), passed);
    }
    let d = view.at(place).vector::<T>(OFFSET);
    z.moment = d.cross_add(z.force, z.moment);
    Ok((P.shifted(d), z))
}

/// 1/D, where D is more than rounding of `scale`.
#[inline(always)]
fn pivot<T: Scalar>(layout: &Layout<T::Constant>, v: usize, D: T, scale: T) -> Result<T, DynamicsError> {
    reciprocal(D, scale).map_err(|D| layout.singular(v, D.min_lane()))
}

/// The same; on failure D.
#[inline(always)]
fn reciprocal<T: Scalar>(D: T, scale: T) -> Result<T, T> {
    let least = T::splat(ROUNDING * T::EPSILON) * scale;
    if (D - least).is_positive() { Ok(D.recip()) } else { Err(D) }
}

/// θ̈ of a joint from ν, and α from α⁺.
#[inline(always)]
pub(super) fn smooth<T: Scalar>(
    body: &LayoutBody<T::Constant>,
    place: usize,
    view: &mut View<'_, T, ROWS>,
    gains: &mut Gains<'_, T>,
    residuals: &mut [T],
    alpha: &mut Motion<T>,
) {
    if let Hinge::Revolute = body.hinge {
        let x = residuals[body.v] - alpha.dot(gains.gain(place));
        residuals[body.v] = x;
        alpha.angular = view.at(place).vector::<T>(AXIS).scale_add(x, alpha.angular);
        return;
    }
    if body.floats() {
        let (axes, K) = (view.at(place).axes(), gains.base(place));
        let mut x = [T::zero(); 6];
        each_axis!(|I| x[I] = residuals[body.v + I]);
        let all = floating_base::accelerations(&K, x);
        let (angular, linear) = (seen(&axes, alpha.angular).0, seen(&axes, alpha.linear).0);
        for i in 0..3 {
            residuals[body.v + i] = all[i] - angular[i];
            residuals[body.v + 3 + i] = all[3 + i] - linear[i];
        }
        *alpha = floating_base::motion(&axes, all);
        return;
    }
    for i in (0..body.hinge.nv()).rev() {
        let x = residuals[body.v + i] - alpha.dot(gains.gain(place + i));
        residuals[body.v + i] = x;
        let S = view.at(place + i).motion::<T>(AXIS);
        alpha.angular = S.angular.scale_add(x, alpha.angular);
        alpha.linear = S.linear.scale_add(x, alpha.linear);
    }
}

#[cfg(test)]
mod tests;
