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
use crate::places::{Places, View};
use phipsi_spatial::{ArticulatedInertia, Motion, Real, Scalar, Wrench};

/// P and z of an eliminated body, about its parent's origin.
type Moved<T> = (ArticulatedInertia<T>, Wrench<T>);

/// A D below this multiple of ε, against the inertia that it is a sum of, may be rounding alone: an axis that was turned into those of the
/// ground does not find an exact zero again. At most ten roundings turn an inertia, and six take its components along an axis.
const ROUNDING: f64 = 16.0;

/// What the filter keeps.
#[derive(Clone, Debug)]
pub(super) struct Filter<T> {
    pending: Pending<Moved<T>>,
    hand: Moved<T>,
}

impl<T: Scalar> Filter<T> {
    pub(super) fn new(layout: &Layout<T::Constant>) -> Self {
        let empty = (ArticulatedInertia::zero(), Wrench::zero());
        Filter { pending: Pending::new(layout, empty), hand: empty }
    }
    /// Tip to base: gains and D⁻¹ of all degrees of freedom, by places, and ν in place of T, in the order of v. Bodies have their own inertias
    /// in the table, what turning and loads need as `FORCE`, and a as `ALPHA`.
    #[inline(always)]
    pub(super) fn inward(
        &mut self,
        layout: &Layout<T::Constant>,
        places: &Places,
        view: &mut View<'_, T, ROWS>,
        gains: &mut Gains<'_, T>,
        residuals: &mut [T],
    ) -> Result<(), DynamicsError> {
        let Filter { pending, hand } = self;
        pending.clear();
        let (bodies, first) = (layout.bodies(), &places.first[..layout.len()]);
        let mut k = bodies.len();
        while k > 0 {
            k -= 1;
            let body = &bodies[k];
            pending.gather(body, hand, |sum, x| {
                sum.0 = sum.0 + x.0;
                sum.1 += x.1;
            });
            if body.hinge.nv() > 1 {
                let moved = pass_joint(layout, body, first[k], view, hand, gains, residuals)?;
                pending.give(k, body, hand, moved);
                continue;
            }
            // Along a run of joints of one axis the sum stays in registers.
            let mut run =
                if body.children == 0 { (ArticulatedInertia::zero(), Wrench::zero()) } else { *hand };
            loop {
                let body = &bodies[k];
                if let Hinge::Revolute = body.hinge {
                    pass_axis::<T, false>(layout, body, first[k], view, &mut run, gains, residuals)?;
                } else {
                    pass_axis::<T, true>(layout, body, first[k], view, &mut run, gains, residuals)?;
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
}

/// P and z past a joint of one axis, to the parent's origin. Without `LINEAR`, the axis has no linear part.
#[inline(always)]
fn pass_axis<T: Scalar, const LINEAR: bool>(
    layout: &Layout<T::Constant>,
    body: &LayoutBody<T::Constant>,
    place: usize,
    view: &mut View<'_, T, ROWS>,
    (P, z): &mut Moved<T>,
    gains: &mut Gains<'_, T>,
    residuals: &mut [T],
) -> Result<(), DynamicsError> {
    let here = view.at(place);
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

/// The same past any other joint, of what comes from outboard.
#[inline(always)]
fn pass_joint<T: Scalar>(
    layout: &Layout<T::Constant>,
    body: &LayoutBody<T::Constant>,
    place: usize,
    view: &mut View<'_, T, ROWS>,
    outboard: &Moved<T>,
    gains: &mut Gains<'_, T>,
    residuals: &mut [T],
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
