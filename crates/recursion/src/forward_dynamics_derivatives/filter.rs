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
use crate::packed::Packed;
use crate::places::{Places, View};
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{ArticulatedInertia, Motion, Scalar, SixLanes, Wrench};

mod packed;

use packed::OwnNumbers;

/// P and z of an eliminated body, about its parent's origin.
type Moved<T> = (ArticulatedInertia<T>, Wrench<T>);

/// A D below this multiple of ε, against the inertia that it is a sum of, may be rounding alone: an axis that was turned into those of the
/// ground does not find an exact zero again. At most ten roundings turn an inertia, and six take its components along an axis.
const ROUNDING: f64 = 16.0;

/// What the filter keeps.
#[derive(Clone, Debug)]
pub(super) struct Filter<T: Scalar> {
    numbers: Waiting<Moved<T>>,
    /// The same where six-vectors are in lanes.
    packed: Waiting<Packed<T::Six>>,
    own: OwnNumbers<T>,
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
    pub(super) fn new(layout: &Layout<T::Constant>, places: &Places) -> Self {
        Filter {
            numbers: Waiting::new(layout, Carried::zero()),
            packed: Waiting::new(layout, Packed::zero::<T>()),
            own: OwnNumbers::new(places),
        }
    }
    /// Tip to base; of a `lone` state in the lanes of the processor, if that is faster.
    #[inline(always)]
    pub(super) fn inward<W: Wide<T>>(
        &mut self,
        lone: bool,
        sweep: &mut Sweep<'_, '_, T>,
    ) -> Result<(), DynamicsError> {
        if !lone || !<T::Six as SixLanes<T>>::is_fast() {
            return inward(&mut self.numbers, &[], sweep);
        }
        self.own.gather::<W>(sweep.places, &mut sweep.view);
        inward(&mut self.packed, self.own.all(), sweep)
    }
}

/// P and z as they go inward.
trait Carried<T: Scalar>: Copy {
    fn zero() -> Self;
    fn add(&mut self, other: &Self);
    fn of(moved: &Moved<T>) -> Self;
    fn numbers(&self) -> Moved<T>;
    /// Past a joint of one axis, to the parent's origin. Without `LINEAR`, the axis has no linear part. `own`: the numbers of all bodies
    /// that are not read from the table.
    fn pass_axis<const LINEAR: bool>(
        &mut self,
        own: &[T],
        body: &LayoutBody<T::Constant>,
        place: usize,
        sweep: &mut Sweep<'_, '_, T>,
    ) -> Result<(), DynamicsError>;
}

#[inline(always)]
fn inward<T: Scalar, X: Carried<T>>(
    Waiting { pending, hand }: &mut Waiting<X>,
    own: &[T],
    sweep: &mut Sweep<'_, '_, T>,
) -> Result<(), DynamicsError> {
    pending.clear();
    let layout = sweep.layout;
    let (bodies, first) = (layout.bodies(), &sweep.places.first[..layout.len()]);
    let mut k = bodies.len();
    while k > 0 {
        k -= 1;
        let body = &bodies[k];
        pending.gather(body, hand, |sum, x| sum.add(x));
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
                run.pass_axis::<false>(own, body, first[k], sweep)?;
            } else {
                run.pass_axis::<true>(own, body, first[k], sweep)?;
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
        _: &[T],
        body: &LayoutBody<T::Constant>,
        place: usize,
        Sweep { layout, view, gains, residuals, .. }: &mut Sweep<'_, '_, T>,
    ) -> Result<(), DynamicsError> {
        let ((P, z), here) = (self, view.at(place));
        *P = P.plus_rigid(&here.rigid(COMPOSITE));
        *z += here.wrench::<T>(FORCE);
        let root = body.parent == GROUND;
        if !root {
            *z += P.times(here.motion(ALPHA));
        }
        let s = here.vector::<T>(AXIS);
        let mut U = Wrench::new(P.inertia * s, P.coupling.transpose_mul(s));
        let mut D = s.dot(U.moment);
        let mut along = s.dot(z.moment);
        let mut scale = P.inertia.xx + P.inertia.yy + P.inertia.zz;
        if LINEAR {
            let b = here.vector::<T>(AXIS + 3);
            U += Wrench::new(P.coupling * b, P.mass * b);
            D = s.dot(U.moment) + b.dot(U.force);
            along += b.dot(z.force);
            scale = s.dot(s) * scale + b.dot(b) * (P.mass.xx + P.mass.yy + P.mass.zz);
        }
        let inverse = pivot(layout, body.v, D, scale)?;
        let gain = U.scale(inverse);
        gains.set(place, gain, inverse);
        let innovation = residuals[body.v] - along;
        residuals[body.v] = innovation * inverse;
        if root {
            return Ok(());
        }
        *z = gain.scale_add(innovation, *z);
        P.subtract_outer(gain, U);
        let d = here.vector::<T>(OFFSET);
        z.moment = d.cross_add(z.force, z.moment);
        *P = P.shifted(d);
        Ok(())
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
    let least = T::splat(ROUNDING * T::Constant::EPSILON) * scale;
    if (D - least).is_positive() { Ok(D.recip()) } else { Err(layout.singular(v, D.min_lane())) }
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
mod tests {
    use super::*;
    use crate::innovations::Innovations;
    use crate::inverse_dynamics_derivatives::DerivativeSweeps;
    use crate::layout::Shifts;
    use phipsi_reference::generate::case;

    /// Numbers and six-vectors in lanes, which on plain numbers are eight numbers one after the other. What a body rounds is passed on
    /// to all inboard of it, and a small D divides it: ε times the number of bodies times the growth of M⁻¹ against 1/diag(M).
    #[test]
    fn six_vectors_in_lanes_are_the_same_filter() {
        let mut compared = 0;
        for seed in 0..300 {
            let case = case(seed);
            let layout = Layout::<f64>::new(&case.model);
            if layout.is_flexible() || layout.nv() == 0 {
                continue;
            }
            let mut sweeps = DerivativeSweeps::<f64>::new(&layout);
            let mut shifts = Shifts::new(&layout);
            shifts.set_all(&layout, &case.q);
            let mut filter = Filter::<f64>::new(&layout, &sweeps.places);
            let mut innovations = Innovations::<f64>::with_products(&layout, &sweeps.places, 0);
            let mut results = [const { Vec::new() }; 2];
            for (packed, result) in results.iter_mut().enumerate() {
                sweeps.move_bodies::<false, f64>(&layout, &shifts, &case.v, &[]);
                let (places, mut residuals) = (&sweeps.places, case.tau.clone());
                let (view, gains) = (sweeps.table.view(), innovations.gains());
                let mut sweep = Sweep { layout: &layout, places, view, gains, residuals: &mut residuals };
                if packed == 1 {
                    filter.own = OwnNumbers::with_room(places);
                    filter.own.gather::<f64>(places, &mut sweep.view);
                    inward(&mut filter.packed, filter.own.all(), &mut sweep).unwrap();
                } else {
                    inward(&mut filter.numbers, &[], &mut sweep).unwrap();
                }
                for place in places.margin..places.count {
                    result.extend(sweep.gains.gain(place).to_array());
                }
                result.extend(residuals);
            }
            let [numbers, lanes] = &results;
            let diagonal = |m: &[f64], i: usize| m[i * layout.nv() + i];
            let m = crate::mass_matrix(&layout, &case.q).unwrap();
            let inverse = crate::mass_matrix_inverse(&layout, &case.q).unwrap();
            let growth =
                (0..layout.nv()).map(|i| diagonal(&m, i) * diagonal(&inverse, i)).fold(1.0, f64::max);
            let largest = numbers.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
            let allowed = 8.0 * layout.len() as f64 * f64::EPSILON * growth * largest;
            for (i, (a, b)) in numbers.iter().zip(lanes).enumerate() {
                assert!(
                    (a - b).abs() <= allowed,
                    "seed {seed}, number {i}: {a} and {b}, allowed {allowed:e}"
                );
            }
            compared += 1;
        }
        assert!(compared > 200, "{compared}");
    }
}
