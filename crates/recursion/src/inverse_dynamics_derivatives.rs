//! Derivatives of inverse dynamics by q, v and v̇, in body-fixed frames.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | S = (s, b) | one axis of a joint, a column of H* | 6 | paper 2 (2.3) |
//! | ω_λ, α_λ | what the parent's motion is at the child's place, child axes | 3, 6 | |
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
//! Velocities are those against the body's own origin: in that frame of reference, which is as good as any other, the body's
//! linear velocity is zero. Moving to the parent changes the frame of reference by u, and −2B by the composite's mass and first
//! moment times u. So no speed against the world enters, as in [`crate::kinematics`].

use crate::derivative_columns::{Column, DerivativeColumns};
use crate::error::{DynamicsError, check_length};
use crate::hinge::Hinge;
use crate::layout::{GROUND, Layout, LayoutBody, Passage, Shifts};
use crate::side_by_side::Places;
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{Mat3, Motion, RigidInertia, Scalar, Sym3, Vec3, Wrench};

/// What one degree of freedom brings to the entries of its column.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AxisRates<T> {
    /// S.
    pub(crate) axis: Motion<T>,
    /// ψ.
    pub(crate) psi: Vec3<T>,
    /// Ψ.
    pub(crate) position: Motion<T>,
    /// Γ.
    pub(crate) velocity: Motion<T>,
}

/// Motion of one body: what the inward sweep needs of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moving<T> {
    /// ω.
    omega: Vec3<T>,
    /// α.
    alpha: Motion<T>,
    /// ω_λ.
    carried_omega: Vec3<T>,
    /// α_λ.
    carried_alpha: Motion<T>,
    /// −2u, parent's axes.
    pub(crate) drift: Vec3<T>,
}

/// Sums over a body and all outboard of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Composite<T> {
    /// R.
    inertia: RigidInertia<T>,
    /// −2N.
    moment: Mat3<T>,
    /// −2l.
    momentum: Vec3<T>,
    /// f.
    pub(crate) force: Wrench<T>,
}

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
    /// O(n · depth) besides writing the zeros; no allocation.
    ///
    /// # Accuracy
    /// n·ε·κ; only speeds of bodies against their parents enter.
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
        layout.check_tree()?;
        let nv = layout.nv();
        check_length("q", q, layout.nq())?;
        check_length("v", v, nv)?;
        check_length("a", a, nv)?;
        check_length("d_dq", d_dq, nv * nv)?;
        check_length("d_dv", d_dv, nv * nv)?;
        check_length("d_da", d_da, nv * nv)?;
        check_length("workspace", &self.sweeps.moving, layout.len())?;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, layout.model_bodies())?;
        }
        self.sweeps.load(layout, wrenches);
        let (q, v, a) = (T::arithmetic(q), T::arithmetic(v), T::arithmetic(a));
        let out = [T::arithmetic_mut(d_dq), T::arithmetic_mut(d_dv), T::arithmetic_mut(d_da)];
        let (shifts, sweeps) = (&mut self.shifts, &mut self.sweeps);
        T::Arithmetic::dispatch_wide(Derive { shifts, sweeps, layout, q, v, a, out });
        Ok(())
    }
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
        sweeps.outboard::<true>(layout, shifts, v, a);
        sweeps.inboard::<true, W>(layout, shifts, v);
        let (places, columns) = (&sweeps.places, &sweeps.columns);
        places.write_all::<T, W>(&columns.d_dq, d_dq);
        places.write_all::<T, W>(&columns.d_dv, d_dv);
        places.write_all::<T, W>(&columns.d_da, d_da);
        places.mirror(d_da);
    }
}

/// The two sweeps and what they need.
#[derive(Clone, Debug)]
pub(crate) struct DerivativeSweeps<T> {
    pub(crate) places: Places,
    pub(crate) moving: Vec<Moving<T>>,
    pub(crate) composite: Vec<Composite<T>>,
    pub(crate) columns: DerivativeColumns<T>,
    /// Minus the external wrenches, where there are any.
    loads: Vec<Wrench<T>>,
    loaded: bool,
}

impl<T: Scalar> DerivativeSweeps<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let zero = Vec3::zero();
        let moving = Moving {
            omega: zero,
            alpha: Motion::zero(),
            carried_omega: zero,
            carried_alpha: Motion::zero(),
            drift: zero,
        };
        let composite = Composite {
            inertia: RigidInertia::zero(),
            moment: Mat3::zero(),
            momentum: zero,
            force: Wrench::zero(),
        };
        let places = Places::new::<T>(layout);
        DerivativeSweeps {
            columns: DerivativeColumns::new(&places),
            places,
            moving: vec![moving; layout.len()],
            composite: vec![composite; layout.len()],
            loads: vec![Wrench::zero(); layout.len()],
            loaded: false,
        }
    }
    /// Motions, and each body's own part of the composites. With `TURNING`, `a` is v̇; without, v̇ + c.
    #[inline(always)]
    pub(crate) fn outboard<const TURNING: bool>(
        &mut self,
        layout: &Layout<T::Constant>,
        shifts: &Shifts<T>,
        v: &[T],
        a: &[T],
    ) {
        let ground = Motion::new(Vec3::zero(), -Vec3::constant(layout.gravity()));
        for (k, body) in layout.bodies().iter().enumerate() {
            let passage = shifts.at(k, body);
            let joint = body.hinge.expand(&v[body.v..]);
            let (inboard, alpha) = match body.parent {
                GROUND => (Vec3::zero(), ground),
                p => (self.moving[p].omega, self.moving[p].alpha),
            };
            let mut carried_alpha = passage.motion_to_child(alpha);
            let mut around = Vec3::zero();
            let mut carried_omega = Vec3::zero();
            if body.parent != GROUND {
                let centripetal;
                (carried_omega, centripetal) = passage.carried(inboard);
                carried_alpha.linear += centripetal;
                around = inboard.cross(passage.translation());
            }
            let omega = carried_omega + joint.angular;
            let mut own = body.hinge.expand(&a[body.v..]);
            if TURNING {
                own += body.hinge.turning(&v[body.v..]);
            }
            let mut alpha = carried_alpha + own;
            alpha.angular += carried_omega.cross(joint.angular);
            if !matches!(body.hinge, Hinge::Revolute) {
                alpha.linear += (carried_omega + carried_omega).cross(joint.linear);
                around += passage.vector_to_parent(joint.linear);
            }
            let drift = around.scale(-T::splat(2.0));
            self.moving[k] = Moving { omega, alpha, carried_omega, carried_alpha, drift };
            let mut composite = Composite::of_body(&RigidInertia::constant(&body.inertia), omega, alpha);
            if self.loaded {
                composite.force += self.loads[k];
            }
            self.composite[k] = composite;
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
}

/// S, ψ, Ψ and Γ of one axis.
#[inline(always)]
fn axis_rates<T: Scalar, const TURNING: bool>(
    body: &LayoutBody<T::Constant>,
    i: usize,
    moving: &Moving<T>,
    v: &[T],
) -> AxisRates<T> {
    let axis: Motion<T> = body.hinge.axis(i);
    let (s, b) = (axis.angular, axis.linear);
    let joint = body.hinge.expand(v);
    let (omega, alpha) = (moving.carried_omega, moving.carried_alpha);
    let psi = omega.cross(s);
    let sweep = omega.cross(b);
    let along = joint.linear.cross(psi);
    let position = Motion::new(
        alpha.angular.cross(s) + omega.cross(psi),
        alpha.linear.cross(s) - (along + along) + alpha.angular.cross(b) + omega.cross(sweep),
    );
    let mut velocity = Motion::new((omega + moving.omega).cross(s), sweep + sweep);
    if TURNING && matches!(body.hinge, Hinge::Planar | Hinge::Free) {
        velocity.linear += s.cross(joint.linear) + joint.angular.cross(b);
    }
    AxisRates { axis, psi, position, velocity }
}

impl<T: Scalar> Composite<T> {
    /// The sums of one body.
    #[inline(always)]
    fn of_body(M: &RigidInertia<T>, omega: Vec3<T>, alpha: Motion<T>) -> Self {
        // −2ω~Σ₂ with 2Σ₂ = tr(J) 1 − 2J: second moments of mass.
        let J = M.inertia;
        let trace = J.xx + J.yy + J.zz;
        let two = T::splat(2.0);
        let second = Sym3::diagonal(trace) + scaled(&J, -two);
        Composite {
            inertia: *M,
            moment: Mat3::from_columns(
                second.column(0).cross(omega),
                second.column(1).cross(omega),
                second.column(2).cross(omega),
            ),
            momentum: M.first_moment.cross(omega).scale(two),
            force: M.momentum(alpha) + M.gyroscopic(omega),
        }
    }
    /// −2B x of an angular change of velocity.
    #[inline(always)]
    fn gyroscopic(&self, x: Vec3<T>) -> Wrench<T> {
        Wrench::new(self.moment * x, self.momentum.cross(x))
    }
    /// The column of an axis of the body.
    #[inline(always)]
    fn column(&self, rates: &AxisRates<T>) -> Column<T> {
        let (s, b) = (rates.axis.angular, rates.axis.linear);
        Column {
            inertia: self.inertia.momentum(rates.axis),
            position: self.inertia.momentum(rates.position) + self.gyroscopic(rates.psi),
            velocity: self.inertia.momentum(rates.velocity) + self.gyroscopic(s),
            gyroscopic: self.moment.transpose_mul(s) + b.cross(self.momentum),
        }
    }
    /// Rates and column of the i-th axis of a joint.
    #[inline(always)]
    pub(crate) fn general<const TURNING: bool>(
        &self,
        body: &LayoutBody<T::Constant>,
        i: usize,
        moving: &Moving<T>,
        v: &[T],
    ) -> (AxisRates<T>, Column<T>) {
        let rates = axis_rates::<T, TURNING>(body, i, moving, v);
        (rates, self.column(&rates))
    }
    /// Rates and column of the hinge about z: those of the general formulas, without their zeros.
    #[inline(always)]
    pub(crate) fn revolute(&self, moving: &Moving<T>) -> (AxisRates<T>, Column<T>) {
        let o = T::zero();
        let ([x, y, z], w) = (moving.carried_omega.0, moving.carried_omega + moving.omega);
        let ([a, b, _], [c, d, _]) = (moving.carried_alpha.angular.0, moving.carried_alpha.linear.0);
        let (psi, gamma) = (Vec3([y, -x, o]), Vec3([w.0[1], -w.0[0], o]));
        let position = Motion::new(Vec3([x.fma(z, b), y.fma(z, -a), -(x.fma(x, y * y))]), Vec3([d, -c, o]));
        let (J, h, N, l) =
            (&self.inertia.inertia, self.inertia.first_moment.0, &self.moment.0, self.momentum.0);
        let inertia = Wrench::new(J.column(2), Vec3([-h[1], h[0], o]));
        let swing = Wrench::new(
            Vec3([
                across(N[0][0], N[0][1], psi),
                across(N[1][0], N[1][1], psi),
                across(N[2][0], N[2][1], psi),
            ]),
            lever(l, psi),
        );
        let velocity = Wrench::new(
            Vec3([
                N[0][2] + across(J.xx, J.xy, gamma),
                N[1][2] + across(J.xy, J.yy, gamma),
                N[2][2] + across(J.xz, J.yz, gamma),
            ]),
            Vec3([l[1], -l[0], o]) - lever(h, gamma),
        );
        let position_force = self.inertia.momentum(position) + swing;
        let column = Column { inertia, position: position_force, velocity, gyroscopic: self.moment.row(2) };
        let velocity = Motion::new(gamma, Vec3::zero());
        (AxisRates { axis: Motion::unit(2), psi, position, velocity }, column)
    }
    /// Moved to the parent's origin and its frame of reference; `drift` is −2u.
    #[inline(always)]
    pub(crate) fn shifted(&self, passage: &Passage<'_, T>, drift: Vec3<T>) -> Self {
        let inertia = passage.rigid_to_parent(&self.inertia);
        let l = passage.vector_to_parent(self.momentum);
        let (t, h) = (passage.translation(), inertia.first_moment);
        let mut moment = passage.matrix_to_parent(&self.moment);
        let trace = t.dot(l) + h.dot(drift);
        for i in 0..3 {
            let row = h.scale_add(drift.0[i], t.scale_add(l.0[i], Vec3(moment.0[i])));
            moment.0[i] = row.0;
            moment.0[i][i] -= trace;
        }
        Composite {
            inertia,
            moment,
            momentum: drift.scale_add(inertia.mass, l),
            force: passage.wrench_to_parent(self.force),
        }
    }
    #[inline(always)]
    pub(crate) fn add(&mut self, other: &Self) {
        self.inertia = self.inertia + other.inertia;
        self.moment = self.moment + other.moment;
        self.momentum += other.momentum;
        self.force += other.force;
    }
}

/// (p, q, ·) · v.
#[inline(always)]
fn across<T: Scalar>(p: T, q: T, v: Vec3<T>) -> T {
    p.fma(v.0[0], q * v.0[1])
}

/// m × v for a v without z.
#[inline(always)]
fn lever<T: Scalar>(m: [T; 3], v: Vec3<T>) -> Vec3<T> {
    Vec3([-(m[2] * v.0[1]), m[2] * v.0[0], m[0].fma(v.0[1], -(m[1] * v.0[0]))])
}

#[inline(always)]
fn scaled<T: Scalar>(a: &Sym3<T>, s: T) -> Sym3<T> {
    Sym3 { xx: a.xx * s, xy: a.xy * s, xz: a.xz * s, yy: a.yy * s, yz: a.yz * s, zz: a.zz * s }
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
