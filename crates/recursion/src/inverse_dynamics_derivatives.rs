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
use crate::kernel::kernel;
use crate::layout::{GROUND, Layout, LayoutBody, Shifts};
use phipsi_spatial::{Mat3, Motion, RigidInertia, Scalar, Sym3, Transform, Vec3, Wrench};
use std::ops::Range;

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

/// Changes of forces at unit changes of one degree of freedom c, moved inward from body to body. Four six-vectors side by side,
/// so that one instruction works on all:
///
/// | | |
/// |---|---|
/// | 0 | R S, the force of an acceleration; also the weights with which rows of c see changes Ψ and Γ inboard |
/// | 1 | force of a change of position |
/// | 2 | force of a change of velocity |
/// | 3 | −2B* S, the weights with which rows of c see angular changes of velocity inboard; its force is zero |
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Column<T> {
    moment: [[T; 4]; 3],
    force: [[T; 4]; 3],
}

impl<T: Scalar> Column<T> {
    fn zero() -> Self {
        Column { moment: [[T::zero(); 4]; 3], force: [[T::zero(); 4]; 3] }
    }
    #[inline(always)]
    fn new(inertia: Wrench<T>, position: Wrench<T>, velocity: Wrench<T>, gyroscopic: Vec3<T>) -> Self {
        let (mut moment, mut force) = ([[T::zero(); 4]; 3], [[T::zero(); 4]; 3]);
        for i in 0..3 {
            moment[i] = [inertia.moment.0[i], position.moment.0[i], velocity.moment.0[i], gyroscopic.0[i]];
            force[i] = [inertia.force.0[i], position.force.0[i], velocity.force.0[i], T::zero()];
        }
        Column { moment, force }
    }
    /// The components along the i-th axis of a joint.
    #[inline(always)]
    fn along(&self, hinge: &Hinge<T::Constant>, i: usize) -> [T; 4] {
        if let Hinge::Revolute = hinge {
            return self.moment[2];
        }
        let component = hinge.components()[i];
        let mut along = if component < 3 { self.moment[component] } else { self.force[component - 3] };
        if let Hinge::Helical { pitch } = hinge {
            for x in 0..4 {
                along[x] = self.force[2][x].fma(T::constant(*pitch), along[x]);
            }
        }
        along
    }
    /// A change Ψ or Γ inboard and its angular part ψ or s, as the row of c sees it.
    #[inline(always)]
    fn see(&self, change: Motion<T>, angular: Vec3<T>) -> T {
        let (n, f) = (&self.moment, &self.force);
        let ([a, b, c], [d, e, g], [x, y, z]) = (change.angular.0, change.linear.0, angular.0);
        let first = n[0][0].fma(a, n[1][0].fma(b, n[2][0] * c));
        let second = f[0][0].fma(d, f[1][0].fma(e, f[2][0] * g));
        n[0][3].fma(x, n[1][3].fma(y, n[2][3].fma(z, first + second)))
    }
    /// Moved to the parent; `drift` is −2u.
    #[inline(always)]
    fn shifted(&self, pose: &Transform<T>, drift: Vec3<T>) -> Self {
        let r = &pose.rotation.0;
        let mut moved = Self::zero();
        for (to, row) in moved.force.iter_mut().zip(r) {
            for x in 0..4 {
                to[x] = row[0].fma(self.force[0][x], row[1].fma(self.force[1][x], row[2] * self.force[2][x]));
            }
        }
        let f = moved.force;
        let t = pose.translation.0;
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let (row, m) = (&r[i], &self.moment);
            for x in 0..4 {
                let lever = t[j].fma(f[k][x], -(t[k] * f[j][x]));
                moved.moment[i][x] = row[0].fma(m[0][x], row[1].fma(m[1][x], row[2].fma(m[2][x], lever)));
            }
        }
        let gyroscopic = drift.cross(Vec3([f[0][0], f[1][0], f[2][0]]));
        for (to, x) in moved.moment.iter_mut().zip(gyroscopic.0) {
            to[3] -= x;
        }
        moved
    }
}

/// Motion of one body: what the inward sweep needs of it.
#[derive(Clone, Copy, Debug)]
struct Moving<T> {
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
        let (d_dq, d_dv) = (T::arithmetic_mut(d_dq), T::arithmetic_mut(d_dv));
        let out = Matrices { d_dq, d_dv, d_da: Some(T::arithmetic_mut(d_da)) };
        T::Arithmetic::dispatch(Derive {
            shifts: &mut self.shifts,
            sweeps: &mut self.sweeps,
            layout,
            q,
            v,
            a,
            out,
        });
        Ok(())
    }
}

kernel! {
    Derive<'a, T> {
        shifts: &'a mut Shifts<T>,
        sweeps: &'a mut DerivativeSweeps<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T],
        v: &'a [T],
        a: &'a [T],
        out: Matrices<'a, T>,
    } -> () {
        shifts.set_all(layout, q);
        sweeps.outboard::<true>(layout, shifts, v, a);
        sweeps.inboard::<true>(layout, v, out);
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
    /// X of every body.
    pub(crate) poses: Vec<Transform<T>>,
    moving: Vec<Moving<T>>,
    composite: Vec<Composite<T>>,
    columns: Vec<Column<T>>,
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
        DerivativeSweeps {
            ends: subtree_ends(layout),
            poses: vec![Transform::identity(); layout.len()],
            moving: vec![moving; layout.len()],
            composite: vec![composite; layout.len()],
            columns: vec![Column::zero(); layout.nv()],
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
            let pose = shifts.at(k, body).pose();
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
            self.poses[k] = pose;
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
                let rates;
                if let Hinge::Revolute = body.hinge {
                    (rates, self.columns[i]) = composite.revolute(moving);
                } else {
                    rates = axis_rates::<T, TURNING>(body, i - first, moving, &v[first..]);
                    self.columns[i] = composite.column(&rates);
                }
                // Row and column of this axis with the joints outboard.
                let outboard = &self.columns[inner..end];
                let (q, v) = (below(d_dq, nv, i, inner..end), below(d_dv, nv, i, inner..end));
                if let Hinge::Revolute = body.hinge {
                    meet(
                        i,
                        &rates,
                        outboard,
                        q,
                        v,
                        #[inline(always)]
                        |c| c.moment[2],
                    );
                } else {
                    meet(
                        i,
                        &rates,
                        outboard,
                        q,
                        v,
                        #[inline(always)]
                        |c| c.along(&body.hinge, i - first),
                    );
                }
                if let Some(d_da) = &mut d_da {
                    let (row, rows) = below(d_da, nv, i, inner..end);
                    for ((x, row), column) in row.iter_mut().zip(rows).zip(&self.columns[inner..end]) {
                        [*x, ..] = column.along(&body.hinge, i - first);
                        row[i] = *x;
                    }
                }
            }
            for i in first..inner {
                for c in first..inner {
                    let at = i * nv + c;
                    let along = self.columns[c].along(&body.hinge, i - first);
                    [_, d_dq[at], d_dv[at], _] = along;
                    if let Some(d_da) = &mut d_da {
                        d_da[at] = along[0];
                    }
                }
            }
            if body.parent == GROUND {
                continue;
            }
            for i in first..inner {
                // The force itself turns and moves with the axis, as the parent sees it.
                let turned = body.hinge.axis(i - first).cross_wrench(composite.force);
                for j in 0..3 {
                    self.columns[i].moment[j][1] += turned.moment.0[j];
                    self.columns[i].force[j][1] += turned.force.0[j];
                }
            }
            let (pose, drift) = (self.poses[k], moving.drift);
            for column in &mut self.columns[first..end] {
                *column = column.shifted(&pose, drift);
                apart();
            }
            let moved = composite.shifted(&pose, drift);
            self.composite[body.parent].add(&moved);
        }
    }
}

/// Keeps a compiler from turning the columns of a loop into lanes, by gather and scatter: the four vectors of each are lanes.
#[inline(always)]
fn apart() {
    core::hint::black_box(());
}

/// Entries of row and column i with the columns outboard; `along` gives a column's components along the axis.
#[inline(always)]
fn meet<'a, T: Scalar>(
    i: usize,
    rates: &AxisRates<T>,
    outboard: &[Column<T>],
    (row_q, rows_q): (&mut [T], impl Iterator<Item = &'a mut [T]>),
    (row_v, rows_v): (&mut [T], impl Iterator<Item = &'a mut [T]>),
    along: impl Fn(&Column<T>) -> [T; 4],
) {
    let entries = row_q.iter_mut().zip(row_v).zip(rows_q.zip(rows_v)).zip(outboard);
    for (((q, v), (row_q, row_v)), column) in entries {
        [_, *q, *v, _] = along(column);
        row_q[i] = column.see(rates.position, rates.psi);
        row_v[i] = column.see(rates.velocity, rates.axis.angular);
        apart();
    }
}

/// Columns `range` of row i of a matrix with `nv` columns, and the rows `range`, all after row i.
#[inline(always)]
fn below<T>(
    matrix: &mut [T],
    nv: usize,
    i: usize,
    range: Range<usize>,
) -> (&mut [T], impl Iterator<Item = &mut [T]>) {
    let (upper, lower) = matrix[..range.end * nv].split_at_mut(range.start * nv);
    (&mut upper[i * nv + range.start..i * nv + range.end], lower.chunks_exact_mut(nv))
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
        Column::new(
            self.inertia.momentum(rates.axis),
            self.inertia.momentum(rates.position) + self.gyroscopic(rates.psi),
            self.inertia.momentum(rates.velocity) + self.gyroscopic(s),
            self.moment.transpose_mul(s) + b.cross(self.momentum),
        )
    }
    /// Rates and column of the hinge about z: those of the general formulas, without their zeros.
    #[inline(always)]
    fn revolute(&self, moving: &Moving<T>) -> (AxisRates<T>, Column<T>) {
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
        let column =
            Column::new(inertia, self.inertia.momentum(position) + swing, velocity, self.moment.row(2));
        let velocity = Motion::new(gamma, Vec3::zero());
        (AxisRates { axis: Motion::unit(2), psi, position, velocity }, column)
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
