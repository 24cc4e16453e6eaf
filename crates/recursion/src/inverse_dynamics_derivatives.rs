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

use crate::error::{DynamicsError, check_length};
use crate::hinge::Hinge;
use crate::layout::{GROUND, Layout, LayoutBody};
use phipsi_spatial::{Mat3, Motion, RigidInertia, Scalar, Sym3, Transform, Vec3, Wrench};

/// What one degree of freedom brings to the entries of its column.
#[derive(Clone, Copy, Debug)]
struct AxisRates<T> {
    /// S.
    axis: Motion<T>,
    /// ψ.
    psi: Vec3<T>,
    /// Ψ.
    position: Motion<T>,
    /// Γ.
    velocity: Motion<T>,
}

/// Changes of forces at unit changes of one degree of freedom c, moved inward from body to body.
#[derive(Clone, Copy, Debug)]
struct Column<T> {
    /// R S: the force of an acceleration; also the weights with which rows of c see changes Ψ and Γ inboard.
    inertia: Wrench<T>,
    /// −2B* S: the weights with which rows of c see angular changes of velocity inboard.
    gyroscopic: Vec3<T>,
    /// Force of a change of position.
    position: Wrench<T>,
    /// Force of a change of velocity.
    velocity: Wrench<T>,
}

impl<T: Scalar> Column<T> {
    fn zero() -> Self {
        let zero = Wrench::zero();
        Column { inertia: zero, gyroscopic: Vec3::zero(), position: zero, velocity: zero }
    }
}

/// Motion of one body: what the inward sweep needs of it.
#[derive(Clone, Copy, Debug)]
struct Moving<T> {
    /// X.
    pose: Transform<T>,
    /// ω.
    omega: Vec3<T>,
    /// α.
    alpha: Motion<T>,
    /// ω_λ.
    carried_omega: Vec3<T>,
    /// α_λ.
    carried_alpha: Motion<T>,
    /// −2u, parent's axes.
    drift: Vec3<T>,
}

/// Sums over a body and all outboard of it.
#[derive(Clone, Copy, Debug)]
struct Composite<T> {
    /// R.
    inertia: RigidInertia<T>,
    /// −2N.
    moment: Mat3<T>,
    /// −2l.
    momentum: Vec3<T>,
    /// f.
    force: Wrench<T>,
}

/// Workspace of the derivatives of inverse dynamics.
#[derive(Clone, Debug)]
pub struct InverseDynamicsDerivatives<T: Scalar> {
    sweeps: DerivativeSweeps<T::Arithmetic>,
}

impl<T: Scalar> InverseDynamicsDerivatives<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        InverseDynamicsDerivatives { sweeps: DerivativeSweeps::new(layout) }
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
        let sweeps = &mut self.sweeps;
        T::Arithmetic::dispatch(
            #[inline(always)]
            || {
                let v = T::arithmetic(v);
                sweeps.outboard::<true>(layout, T::arithmetic(q), v, T::arithmetic(a));
                sweeps.subtract_wrenches::<T>(layout, wrenches);
                let (d_dq, d_dv) = (T::arithmetic_mut(d_dq), T::arithmetic_mut(d_dv));
                let d_da = Some(T::arithmetic_mut(d_da));
                sweeps.inboard::<true>(layout, v, Matrices { d_dq, d_dv, d_da });
            },
        );
        Ok(())
    }
}

/// Where the derivatives go: nv×nv matrices by rows.
pub(crate) struct Matrices<'a, T> {
    pub(crate) d_dq: &'a mut [T],
    pub(crate) d_dv: &'a mut [T],
    pub(crate) d_da: Option<&'a mut [T]>,
}

/// The two sweeps and what they need.
#[derive(Clone, Debug)]
pub(crate) struct DerivativeSweeps<T> {
    /// For every body, one past the last degree of freedom outboard of it: with the model's depth-first order, those of a
    /// subtree are a range.
    ends: Vec<usize>,
    moving: Vec<Moving<T>>,
    composite: Vec<Composite<T>>,
    columns: Vec<Column<T>>,
}

impl<T: Scalar> DerivativeSweeps<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let zero = Vec3::zero();
        let moving = Moving {
            pose: Transform::identity(),
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
        DerivativeSweeps {
            ends: subtree_ends(layout),
            moving: vec![moving; layout.len()],
            composite: vec![composite; layout.len()],
            columns: vec![Column::zero(); layout.nv()],
        }
    }
    /// Motions, and each body's own part of the composites. With `TURNING`, `a` is v̇; without, v̇ + c.
    #[inline(always)]
    pub(crate) fn outboard<const TURNING: bool>(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        a: &[T],
    ) {
        let ground = Motion::new(Vec3::zero(), -Vec3::constant(layout.gravity()));
        for (k, body) in layout.bodies().iter().enumerate() {
            let pose = body.pose(q);
            let joint = body.hinge.expand(&v[body.v..]);
            let (inboard, mut alpha) = match body.parent {
                GROUND => (Vec3::zero(), ground),
                p => (self.moving[p].omega, self.moving[p].alpha),
            };
            let around = inboard.cross(pose.translation);
            alpha.linear += inboard.cross(around);
            let carried_omega = pose.rotation.transpose_mul(inboard);
            let carried_alpha = pose.motion_to_child(alpha);
            let omega = carried_omega + joint.angular;
            let coriolis = Motion::new(
                carried_omega.cross(joint.angular),
                (carried_omega + carried_omega).cross(joint.linear),
            );
            let mut own = body.hinge.expand(&a[body.v..]);
            if TURNING {
                own += body.hinge.turning(&v[body.v..]);
            }
            let alpha = carried_alpha + own + coriolis;
            let drift = (around + pose.rotation * joint.linear).scale(-T::splat(2.0));
            self.moving[k] = Moving { pose, omega, alpha, carried_omega, carried_alpha, drift };
            self.composite[k] = Composite::of_body(&RigidInertia::constant(&body.inertia), omega, alpha);
        }
    }
    /// The external wrenches, taken from the forces of the bodies that carry them.
    #[inline(always)]
    pub(crate) fn subtract_wrenches<U: Scalar<Constant = T::Constant, Arithmetic = T>>(
        &mut self,
        layout: &Layout<T::Constant>,
        wrenches: Option<&[Wrench<U>]>,
    ) {
        for (carrier, wrench) in layout.carriers().iter().zip(wrenches.unwrap_or_default()) {
            if carrier.body != GROUND {
                let wrench = Wrench::from_array(wrench.to_array().map(U::to_arithmetic));
                let moved = Transform::constant(&carrier.pose).wrench_to_parent(wrench);
                self.composite[carrier.body].force -= moved;
            }
        }
    }

    /// Composites and columns, from the tips to the base; every body meets the columns of all joints outboard of it. With
    /// `TURNING`, v̇ is the derivative of v; without, v̇ + c is the number that stays while v changes.
    #[inline(always)]
    pub(crate) fn inboard<const TURNING: bool>(
        &mut self,
        layout: &Layout<T::Constant>,
        v: &[T],
        out: Matrices<'_, T>,
    ) {
        let Matrices { d_dq, d_dv, mut d_da } = out;
        d_dq.fill(T::zero());
        d_dv.fill(T::zero());
        if let Some(d_da) = &mut d_da {
            d_da.fill(T::zero());
        }
        let nv = layout.nv();
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let (moving, composite) = (&self.moving[k], &self.composite[k]);
            let (first, inner, end) = (body.v, body.v + body.hinge.nv(), self.ends[k]);
            for i in first..inner {
                let rates = axis_rates::<T, TURNING>(body, i - first, moving, &v[first..]);
                self.columns[i] = composite.column(&rates);
                // Rows and columns of this axis with the joints outboard.
                for (c, column) in (inner..end).zip(&self.columns[inner..end]) {
                    d_dq[c * nv + i] = rates.position.dot(column.inertia) + rates.psi.dot(column.gyroscopic);
                    d_dv[c * nv + i] =
                        rates.velocity.dot(column.inertia) + rates.axis.angular.dot(column.gyroscopic);
                }
                let row = i * nv + inner..i * nv + end;
                project(&body.hinge, i - first, &self.columns[inner..end], &mut d_dq[row.clone()], |c| {
                    &c.position
                });
                project(&body.hinge, i - first, &self.columns[inner..end], &mut d_dv[row.clone()], |c| {
                    &c.velocity
                });
                if let Some(d_da) = &mut d_da {
                    project(&body.hinge, i - first, &self.columns[inner..end], &mut d_da[row], |c| {
                        &c.inertia
                    });
                    for c in inner..end {
                        d_da[c * nv + i] = d_da[i * nv + c];
                    }
                }
            }
            for i in first..inner {
                let row = i * nv + first..i * nv + inner;
                let own = &self.columns[first..inner];
                project(&body.hinge, i - first, own, &mut d_dq[row.clone()], |c| &c.position);
                project(&body.hinge, i - first, own, &mut d_dv[row.clone()], |c| &c.velocity);
                if let Some(d_da) = &mut d_da {
                    project(&body.hinge, i - first, own, &mut d_da[row], |c| &c.inertia);
                }
            }
            if body.parent == GROUND {
                continue;
            }
            for i in first..inner {
                // The force itself turns and moves with the axis, as the parent sees it.
                self.columns[i].position += body.hinge.axis(i - first).cross_wrench(composite.force);
            }
            let (pose, drift) = (moving.pose, moving.drift);
            for column in &mut self.columns[first..end] {
                let inertia = pose.wrench_to_parent(column.inertia);
                *column = Column {
                    inertia,
                    gyroscopic: pose.rotation * column.gyroscopic - drift.cross(inertia.force),
                    position: pose.wrench_to_parent(column.position),
                    velocity: pose.wrench_to_parent(column.velocity),
                };
            }
            let moved = composite.shifted(&pose, drift);
            self.composite[body.parent].add(&moved);
        }
    }
    /// Pose of every layout body in its parent, after [`outboard`](Self::outboard).
    #[inline(always)]
    pub(crate) fn pose(&self, k: usize) -> &Transform<T> {
        &self.moving[k].pose
    }
}

/// out = the components along the i-th axis of one force of each column.
#[inline(always)]
fn project<T: Scalar>(
    hinge: &Hinge<T::Constant>,
    i: usize,
    columns: &[Column<T>],
    out: &mut [T],
    force: impl Fn(&Column<T>) -> &Wrench<T>,
) {
    for (out, column) in out.iter_mut().zip(columns) {
        *out = hinge.project(i, force(column));
    }
}

/// For every body, one past the last degree of freedom outboard of it or its own.
pub(crate) fn subtree_ends<C: phipsi_spatial::Real>(layout: &Layout<C>) -> Vec<usize> {
    let mut ends: Vec<usize> = layout.bodies().iter().map(|b| b.v + b.hinge.nv()).collect();
    for (k, body) in layout.bodies().iter().enumerate().rev() {
        if body.parent != GROUND {
            ends[body.parent] = ends[body.parent].max(ends[k]);
        }
    }
    ends
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
        let column = |j: usize| second.column(j).cross(omega);
        Composite {
            inertia: *M,
            moment: Mat3::from_columns(column(0), column(1), column(2)),
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
            gyroscopic: self.moment.transpose_mul(s) + b.cross(self.momentum),
            position: self.inertia.momentum(rates.position) + self.gyroscopic(rates.psi),
            velocity: self.inertia.momentum(rates.velocity) + self.gyroscopic(s),
        }
    }
    /// Moved to the parent's origin and its frame of reference; `drift` is −2u.
    #[inline(always)]
    fn shifted(&self, pose: &Transform<T>, drift: Vec3<T>) -> Self {
        let inertia = pose.rigid_to_parent(&self.inertia);
        let l = pose.rotation * self.momentum;
        let (t, h) = (pose.translation, inertia.first_moment);
        let mut moment = pose.rotation * self.moment * pose.rotation.transpose();
        let trace = t.dot(l) + h.dot(drift);
        for i in 0..3 {
            let row = Vec3(moment.0[i]) + t.scale(l.0[i]) + h.scale(drift.0[i]);
            moment.0[i] = row.0;
            moment.0[i][i] -= trace;
        }
        Composite {
            inertia,
            moment,
            momentum: l + drift.scale(inertia.mass),
            force: pose.wrench_to_parent(self.force),
        }
    }
    #[inline(always)]
    fn add(&mut self, other: &Self) {
        self.inertia = self.inertia + other.inertia;
        self.moment = self.moment + other.moment;
        self.momentum += other.momentum;
        self.force += other.force;
    }
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
