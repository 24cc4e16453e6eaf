//! Derivatives of inverse dynamics by q, v and v̇.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | S = (s, b) | one axis of a joint, a column of H* | 6 | paper 2 (2.3) |
//! | ω_λ, α_λ | what the parent's motion is at the child's place | 3, 6 | |
//! | δv, u | speed of the child's origin against the parent's frame, and against its origin | 3 | |
//! | ψ | ω_λ × s: angular change of the velocities outboard when S moves and v stays | 3 | Ψ̇ of Singh, Russo, Wensing 2022 |
//! | Ψ | (α̇_λ×s + ω_λ×ψ, a_λ×s − 2δv×ψ + α̇_λ×b + ω_λ×(ω_λ×b)) | 6 | Ψ̈ there |
//! | Γ | ((ω_λ+ω)×s, 2ω_λ×b), without the turning c of planar and free joints | 6 | Ψ̇ + Ṡ there |
//! | R | composite inertia | 10 | paper 2 (4.12) |
//! | B | Σ of (ω~ Σ₂ + …, l~): with −2 before it, the force of an angular change of velocity | 9 + 3 | 𝓑 there |
//! | f | force across the joint | 6 | paper 1 (5.1) |
//!
//! When a joint moves along S and v, v̇ stay as numbers, every body m outboard gets the change f(m) = R(m) Ψ − 2B(m) ψ of its
//! joint's force, in its own axes; a change of speed along S gives R(m) Γ − 2B(m) s. −2B(m) sees only angular changes, so it is
//! a 6×3 matrix of nine numbers N and the linear momentum l.
//!
//! All vectors are in the axes of the ground, each body's about its own origin (`ground_axes.rs`). Velocities are those
//! against the body's own origin: in that frame of reference, which is as good as any other, the body's linear velocity is
//! zero. Moving to the parent changes the frame of reference by u, and −2B by the composite's mass and first moment times u. So
//! no speed against the world enters, as in [`crate::kinematics`].

use crate::derivative_columns::{Column, Meet, Meetings};
use crate::error::{DynamicsError, check_length};
use crate::flexible::{Map, derivatives};
use crate::ground_axes::{
    self, AXIS, COMPOSITE, Directions, OFFSET, OwnInertias, each_body, each_own_inertia, set_body, spread,
};
use crate::hinge::{Hinge, combine};
use crate::layout::{GROUND, Layout, LayoutBody, Shifts};
use crate::places::{Group, Places, Table, View};
use core::marker::PhantomData;
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{Motion, RigidInertia, Scalar, Vec3, Wrench};

mod composite;
mod floating_base;

use composite::Composite;
pub(crate) use floating_base::{own_blocks, own_position_block, weigh_position, weigh_velocity};

// Rows of the table after those of `ground_axes`.
/// −2u.
pub(crate) const DRIFT: usize = ground_axes::ROWS;
/// ω_λ.
const CARRIED_OMEGA: usize = DRIFT + 3;
/// α_λ.
const CARRIED_ALPHA: usize = CARRIED_OMEGA + 3;
/// ω.
const OMEGA: usize = CARRIED_ALPHA + 6;
/// δv.
const SPEED: usize = OMEGA + 3;
/// α; before it is known, a: what velocities add to it at the joint.
pub(crate) const ALPHA: usize = SPEED + 3;
/// −2N of the composite.
const MOMENT: usize = ALPHA + 6;
/// −2l.
const MOMENTUM: usize = MOMENT + 9;
/// f.
pub(crate) const FORCE: usize = MOMENTUM + 3;
/// ψ.
pub(crate) const PSI: usize = FORCE + 6;
/// Ψ.
pub(crate) const POSITION_RATE: usize = PSI + 3;
/// Γ.
pub(crate) const VELOCITY_RATE: usize = POSITION_RATE + 6;
/// ∂T/∂q of the degree of freedom's own force by its own coordinate.
pub(crate) const DIAGONAL: usize = VELOCITY_RATE + 6;
pub(crate) const ROWS: usize = DIAGONAL + 1;

/// Workspace of the derivatives of inverse dynamics.
#[derive(Clone, Debug)]
pub struct InverseDynamicsDerivatives<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    sweeps: DerivativeSweeps<T::Arithmetic>,
}

impl<T: Scalar> InverseDynamicsDerivatives<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        InverseDynamicsDerivatives { shifts: Shifts::new(layout), sweeps: DerivativeSweeps::new(layout) }
    }
    /// Derivatives of the generalised forces of (q, v, a) under wrenches that are constant in their bodies' axes.
    ///
    /// # Computes
    /// ∂T/∂q along the increments of `Model::integrate` (body-axes velocities of the joints), ∂T/∂v, and ∂T/∂v̇ = M(q); in each
    /// the other arguments stay as numbers.
    ///
    /// # Shapes & units
    /// `q`: nq; `v`, `a`: nv; `wrenches`: one per body of the model, at its frame's origin, its axes; `d_dq`, `d_dv`, `d_da`:
    /// nv×nv by rows, row i is the force of degree of freedom i.
    ///
    /// # Cost
    /// O(n · depth) besides writing the zeros; no allocation. With flexible bodies dual numbers go through the sweeps: O(nv · n),
    /// with allocations.
    ///
    /// # Accuracy
    /// n·ε·κ; only speeds of bodies against their parents enter. Entries that vanish because axes are parallel come out as the
    /// rounding of their terms.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`]; [`DynamicsError::Closure`] if the model has closures.
    #[allow(clippy::too_many_arguments)] // three arguments, three derivatives
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        a: &[T],
        wrenches: Option<&[Wrench<T>]>,
        d_dq: &mut [T],
        d_dv: &mut [T],
        d_da: &mut [T],
    ) -> Result<(), DynamicsError> {
        check_arguments(layout, (q, v, ("a", a)), wrenches, (d_dq, d_dv, ("d_da", d_da)))?;
        if !layout.is_flexible() {
            check_length("workspace", &self.sweeps.places.first, layout.len())?;
        }
        if layout.is_flexible() {
            return derivatives(Map::Inverse, layout, (q, v, a), wrenches, (d_dq, d_dv, d_da));
        }
        self.sweeps.load(layout, wrenches);
        let (q, v, a) = (T::arithmetic(q), T::arithmetic(v), T::arithmetic(a));
        let out = [T::arithmetic_mut(d_dq), T::arithmetic_mut(d_dv), T::arithmetic_mut(d_da)];
        let (shifts, sweeps) = (&mut self.shifts, &mut self.sweeps);
        T::Arithmetic::dispatch_wide(Derive { shifts, sweeps, layout, q, v, a, out });
        Ok(())
    }
}

/// Refuses closures and wrong lengths; the last argument, and the derivative by it, have names of their own.
#[allow(clippy::type_complexity)] // two names beside their numbers
pub(crate) fn check_arguments<T: Scalar>(
    layout: &Layout<T::Constant>,
    (q, v, (last, x)): (&[T], &[T], (&'static str, &[T])),
    wrenches: Option<&[Wrench<T>]>,
    (d_dq, d_dv, (d_last, d_dx)): (&[T], &[T], (&'static str, &[T])),
) -> Result<(), DynamicsError> {
    layout.check_closures()?;
    let nv = layout.nv();
    check_length("q", q, layout.nq())?;
    check_length("v", v, nv)?;
    check_length(last, x, nv)?;
    check_length("d_dq", d_dq, nv * nv)?;
    check_length("d_dv", d_dv, nv * nv)?;
    check_length(d_last, d_dx, nv * nv)?;
    wrenches.map_or(Ok(()), |wrenches| check_length("wrenches", wrenches, layout.model_bodies()))
}

struct Derive<'a, T: Scalar> {
    shifts: &'a mut Shifts<T>,
    sweeps: &'a mut DerivativeSweeps<T>,
    layout: &'a Layout<T::Constant>,
    q: &'a [T],
    v: &'a [T],
    a: &'a [T],
    /// ∂T/∂q, ∂T/∂v, M.
    out: [&'a mut [T]; 3],
}

impl<T: Scalar> WideKernel<T> for Derive<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T>>(self) {
        let Derive { shifts, sweeps, layout, q, v, a, out: [d_dq, d_dv, d_da] } = self;
        shifts.set_all(layout, q);
        sweeps.move_bodies::<true, W>(layout, shifts, v, a);
        sweeps.run::<true, W>(layout);
        let (places, derivatives) = (&sweeps.places, &mut sweeps.meetings);
        places.mirror::<T, W>(0, places.stride, &mut derivatives.d_da);
        derivatives.rates.write::<W>(places, [d_dq, d_dv]);
        places.write_all::<T, W>(&derivatives.d_da, d_da);
    }
}

/// The sweeps and what they need.
#[derive(Clone, Debug)]
pub(crate) struct DerivativeSweeps<T> {
    pub(crate) places: Places,
    pub(crate) table: Table<T, ROWS>,
    own: OwnInertias<T>,
    pub(crate) meetings: Meetings<T>,
    /// Minus the external wrenches, where there are any.
    loads: Vec<Wrench<T>>,
    loaded: bool,
}

impl<T: Scalar> DerivativeSweeps<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let places = Places::new::<T>(layout);
        DerivativeSweeps {
            table: ground_axes::table(&places),
            own: OwnInertias::new(layout, &places),
            meetings: Meetings::new(layout, &places),
            places,
            loads: vec![Wrench::zero(); layout.len()],
            loaded: false,
        }
    }
    /// Takes the external wrenches.
    pub(crate) fn load<U: Scalar<Constant = T::Constant, Arithmetic = T>>(
        &mut self,
        layout: &Layout<T::Constant>,
        wrenches: Option<&[Wrench<U>]>,
    ) {
        self.loaded = wrenches.is_some();
        if let Some(wrenches) = wrenches {
            layout.gather_loads(wrenches, &mut self.loads);
        }
    }
    /// Velocities of all bodies, their own inertias, and the forces of their turning and of loads; if `TURNING` their accelerations, too,
    /// with those of joints, `a`, and the forces of these. Otherwise [`accelerate_outboard`] is to follow.
    #[inline(always)]
    pub(crate) fn move_bodies<const TURNING: bool, W: Wide<T>>(
        &mut self,
        layout: &Layout<T::Constant>,
        shifts: &Shifts<T>,
        v: &[T],
        a: &[T],
    ) {
        let (places, view) = (&self.places, &mut self.table.view());
        move_outboard::<TURNING, T>(layout, shifts, places, view, v, a);
        each_own_inertia!(T, W, layout, places, self.own, view, |group, inertia| {
            let mut composite = Composite::of_body(&inertia, group.vector(OMEGA));
            if TURNING {
                composite.force += inertia.momentum(group.motion(ALPHA));
            }
            composite.put(&mut group);
        });
        if self.loaded {
            for (load, &at) in self.loads.iter().zip(&places.first) {
                let mut here = view.at(at);
                let axes = here.axes();
                let turned = Wrench::new(combine(&axes, load.moment), combine(&axes, load.force));
                let force = here.wrench::<T>(FORCE) + turned;
                here.set_wrench(FORCE, force);
            }
        }
    }
    /// The derivatives, after [`DerivativeSweeps::move_bodies`]. With `TURNING`, accelerations are those of v̇,
    /// and M comes, too; without, of v̇ + c, which stays while v changes.
    #[inline(always)]
    pub(crate) fn run<const TURNING: bool, W: Wide<T>>(&mut self, layout: &Layout<T::Constant>) {
        let (places, view) = (&self.places, &mut self.table.view());
        if !TURNING {
            each_body!(T, W, places, view, |group| {
                let of_acceleration = group.rigid::<W>(COMPOSITE).momentum(group.motion(ALPHA));
                let force = group.wrench::<W>(FORCE) + of_acceleration;
                group.set_wrench(FORCE, force);
            });
        }
        gather_inboard(layout, places, view);
        spread::<_, W, ROWS>(places, view, (COMPOSITE..ALPHA).chain(MOMENT..PSI));
        let view = self.table.view();
        W::dispatch(Meet::<T, W, TURNING> {
            places,
            view,
            meetings: &mut self.meetings,
            register: PhantomData,
        });
    }
}

/// Velocities and accelerations of all bodies, base to tip; without `TURNING`, of the latter what velocities add at each joint.
#[inline(always)]
fn move_outboard<const TURNING: bool, T: Scalar>(
    layout: &Layout<T::Constant>,
    shifts: &Shifts<T>,
    places: &Places,
    view: &mut View<'_, T, ROWS>,
    v: &[T],
    a: &[T],
) {
    let first = &places.first[..layout.len()];
    let ground = (ground_axes::ground(), Vec3::zero(), ground_acceleration(layout));
    let mut previous = ground;
    for (k, body) in layout.bodies().iter().enumerate() {
        let (axes, inboard, inboard_alpha) = match body.parent {
            GROUND => ground,
            _ if body.follows_parent(k) => previous,
            parent => {
                let parent = view.at(first[parent]);
                (parent.axes(), parent.vector(OMEGA), parent.motion(ALPHA))
            }
        };
        let (axes, d) = shifts.at(k, body).axes_to_child(axes);
        set_body(view, first[k], body, &axes, d);
        let mut here = view.at(first[k]);
        let mut around = inboard.cross(d);
        let mut alpha = Motion::new(Vec3::zero(), inboard.cross(around));
        if TURNING {
            alpha +=
                Motion::new(inboard_alpha.angular, inboard_alpha.angular.cross_add(d, inboard_alpha.linear));
        }
        here.set_motion(CARRIED_ALPHA, alpha);
        let turning = if let Hinge::Revolute = body.hinge {
            if TURNING {
                alpha.angular = axes[2].scale_add(a[body.v], alpha.angular);
            }
            axes[2].scale(v[body.v])
        } else {
            if TURNING {
                alpha += turned(&axes, body.hinge.expand(&a[body.v..]) + body.hinge.turning(&v[body.v..]));
            }
            let joint = turned(&axes, body.hinge.expand(&v[body.v..]));
            around += joint.linear;
            here.set_vector(SPEED, joint.linear);
            let swept = inboard.cross(joint.linear);
            alpha.linear += swept + swept;
            joint.angular
        };
        alpha.angular = inboard.cross_add(turning, alpha.angular);
        let omega = inboard + turning;
        here.set_vector(DRIFT, around.scale(-T::splat(2.0)));
        here.set_vector(CARRIED_OMEGA, inboard);
        here.set_vector(OMEGA, omega);
        here.set_motion(ALPHA, alpha);
        previous = (axes, omega, alpha);
    }
}

/// What gravity adds to all accelerations.
#[inline(always)]
fn ground_acceleration<T: Scalar>(layout: &Layout<T::Constant>) -> Motion<T> {
    Motion::new(Vec3::zero(), -Vec3::constant(layout.gravity()))
}

/// Accelerations of all bodies, base to tip, after velocities; `join` adds θ̈ of a joint to φ*α(p), before a is added.
#[inline(always)]
pub(crate) fn accelerate_outboard<T: Scalar>(
    layout: &Layout<T::Constant>,
    places: &Places,
    view: &mut View<'_, T, ROWS>,
    mut join: impl FnMut(&mut View<'_, T, ROWS>, &LayoutBody<T::Constant>, usize, &mut Motion<T>),
) {
    let first = &places.first[..layout.len()];
    let ground = ground_acceleration(layout);
    let mut previous = ground;
    for (k, body) in layout.bodies().iter().enumerate() {
        let inboard = match body.parent {
            GROUND => ground,
            _ if body.follows_parent(k) => previous,
            parent => view.at(first[parent]).motion(ALPHA),
        };
        let mut here = view.at(first[k]);
        let linear = inboard.angular.cross_add(here.vector(OFFSET), inboard.linear);
        let mut alpha = Motion::new(inboard.angular, linear);
        let carried = here.motion::<T>(CARRIED_ALPHA) + alpha;
        here.set_motion(CARRIED_ALPHA, carried);
        join(view, body, first[k], &mut alpha);
        let mut here = view.at(first[k]);
        alpha += here.motion(ALPHA);
        here.set_motion(ALPHA, alpha);
        previous = alpha;
    }
}

/// Composites of all bodies, tip to base, from their own parts.
#[inline(always)]
fn gather_inboard<T: Scalar>(layout: &Layout<T::Constant>, places: &Places, view: &mut View<'_, T, ROWS>) {
    let (bodies, first) = (layout.bodies(), &places.first[..layout.len()]);
    let mut k = bodies.len();
    // From every tip along a run of first children, whose sum stays in registers.
    while k > 0 {
        k -= 1;
        let mut sum = Composite::<T>::get(&view.at(first[k]));
        while bodies[k].parent != GROUND {
            let (body, here) = (&bodies[k], view.at(first[k]));
            let moved = sum.shifted(here.vector(OFFSET), here.vector(DRIFT));
            let mut parent = view.at(first[body.parent]);
            sum = Composite::get(&parent).plus(&moved);
            sum.put(&mut parent);
            if !body.follows_parent(k) {
                break;
            }
            k -= 1;
        }
    }
}

/// ψ, Ψ and Γ of the degrees of freedom of a group, and their columns. Without `LINEAR`, no axis has a linear part.
#[inline(always)]
pub(crate) fn begin_columns<T: Scalar, W: Wide<T>, const TURNING: bool, const LINEAR: bool>(
    group: &mut Group<'_, T, ROWS>,
) -> Column<W> {
    let composite: Composite<W> = Composite::get(group);
    let (s, b): (Vec3<W>, Vec3<W>) =
        (group.vector(AXIS), if LINEAR { group.vector(AXIS + 3) } else { Vec3::zero() });
    let (omega, alpha) = (group.vector::<W>(CARRIED_OMEGA), group.motion::<W>(CARRIED_ALPHA));
    let own = group.vector::<W>(OMEGA);
    let psi = omega.cross(s);
    let mut position = Motion::new(omega.cross_add(psi, alpha.angular.cross(s)), alpha.linear.cross(s));
    let mut velocity = Motion::new((omega + own).cross(s), Vec3::zero());
    let M = &composite.inertia;
    let (mut inertia, mut of_velocity) = (M.spin(s), M.spin(velocity.angular));
    let mut gyroscopic = composite.moment.transpose_mul(s);
    if LINEAR {
        let speed = group.vector::<W>(SPEED);
        let (sweep, along) = (omega.cross(b), speed.cross(psi));
        position.linear =
            omega.cross_add(sweep, alpha.angular.cross_add(b, position.linear)) - (along + along);
        velocity.linear = sweep + sweep;
        if TURNING {
            velocity.linear += s.cross_add(speed, (own - omega).cross(b));
        }
        inertia = M.momentum(Motion::new(s, b));
        of_velocity = M.momentum(velocity);
        gyroscopic = b.cross_add(composite.momentum, gyroscopic);
    }
    let of_position = M.momentum(position) + composite.gyroscopic(psi);
    let turned = Motion::new(s, b).cross_wrench(composite.force);
    let mut diagonal = s.dot(of_position.moment);
    if LINEAR {
        diagonal += b.dot(of_position.force);
    }
    // One zero, whether or not the terms of linear axes are there.
    group.set(DIAGONAL, diagonal + W::zero());
    group.set_vector(PSI, psi);
    group.set_motion(POSITION_RATE, position);
    group.set_motion(VELOCITY_RATE, velocity);
    Column {
        inertia,
        // The force itself turns and moves with the axis, as the bodies inboard see it.
        position: of_position + turned,
        velocity: of_velocity + composite.gyroscopic(s),
        gyroscopic,
    }
}

/// A motion in the body's axes, turned.
#[inline(always)]
fn turned<T: Scalar>(axes: &Directions<T>, x: Motion<T>) -> Motion<T> {
    Motion::new(combine(axes, x.angular), combine(axes, x.linear))
}

/// (∂T/∂q, ∂T/∂v, ∂T/∂v̇ = M): [`InverseDynamicsDerivatives::run`] for a single call.
///
/// # Errors
/// As there.
#[allow(clippy::type_complexity)] // three matrices
pub fn inverse_dynamics_derivatives<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    a: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<(Vec<T>, Vec<T>, Vec<T>), DynamicsError> {
    let zero = vec![T::zero(); layout.nv() * layout.nv()];
    let (mut d_dq, mut d_dv, mut d_da) = (zero.clone(), zero.clone(), zero);
    let mut work = InverseDynamicsDerivatives::new(layout);
    work.run(layout, q, v, a, wrenches, &mut d_dq, &mut d_dv, &mut d_da)?;
    Ok((d_dq, d_dv, d_da))
}
