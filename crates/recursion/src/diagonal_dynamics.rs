//! Lagrangian dynamics in velocities that make the kinetic energy a sum of squares.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | η | (I + HφK)* v: G* V of each degree of freedom; kinetic energy ½ η* D η | nv | paper 2 (4.16) |
//! | ν | D^½ η, normalised; kinetic energy ½ ν* ν | nv | soa.md 3.8 |
//! | C_D | of D η̇ + C_D = L T, with L = I − HψK | nv | paper 2 (4.17), whose D is missing |
//! | C_ν | of ν̇ + C_ν = D^(−½) L T; ν* C_ν = 0 | nv | soa.md 3.8 |
//! | S | H* v, the joint's velocity, with S~ its cross product on wrenches | 6 | soa.md 3.0 |
//! | V, a, b | velocity; S~* φ* V(p) = V × S; V~ M V: the pair of componentwise rates in body axes | 6 | soa.md 3.0 |
//! | Ṗ | Σ φ (Ṗ⁺ + S~ P⁺ + P⁺ S~*) φ*, with Ṗ⁺ = (I − G H) Ṗ (I − G H)* | 6×6 | soa.md 3.8 |
//! | Ḋ, Ġ | H Ṗ H*, (I − G H) Ṗ H* D⁻¹ | | |
//! | z, ε | bias force Σ φ z⁺ + b − weight − w + P a, innovation T − H z | | paper 1 (9.3) |
//!
//! η̇ = D⁻¹ ε + G* a + Ġ* V for each degree of freedom. Joints of several degrees of freedom take one component after the
//! other, as in [`crate::articulated_sweep`].

use crate::articulated_sweep::{ArticulatedSweep, Pivot};
use crate::error::{DynamicsError, check_length};
use crate::hinge::Hinge;
use crate::kernel::kernel;
use crate::layout::{GROUND, Layout, LayoutBody, Pending};
use phipsi_spatial::{ArticulatedInertia, Mat3, Motion, RigidInertia, Scalar, Sym3, Vec3, Wrench};

/// Which of the two diagonal velocities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DiagonalVelocity {
    /// η = (I + HφK)* v: the velocity of each joint against what its inboard side would give it if it were free.
    Plain,
    /// ν = D^½ η: every unit of it has the same energy.
    Normalized,
}

/// Ṗ and z of an eliminated body, moved to its parent.
type Moved<T> = (ArticulatedInertia<T>, Wrench<T>);

/// Workspace of the diagonal dynamics.
#[derive(Clone, Debug)]
pub struct DiagonalDynamics<T: Scalar> {
    factors: ArticulatedSweep<T>,
    P: Vec<ArticulatedInertia<T::Arithmetic>>,
    velocity: Vec<Motion<T::Arithmetic>>,
    /// Gravity in the axes of each body.
    gravity: Vec<Motion<T::Arithmetic>>,
    loads: Vec<Wrench<T::Arithmetic>>,
    pending: Pending<Moved<T::Arithmetic>>,
    eta: Vec<T>,
}

impl<T: Scalar> DiagonalDynamics<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let n = layout.len();
        DiagonalDynamics {
            factors: ArticulatedSweep::empty(layout),
            P: vec![ArticulatedInertia::zero(); n],
            velocity: vec![Motion::zero(); n],
            gravity: vec![Motion::zero(); n],
            loads: vec![Wrench::zero(); n],
            pending: Pending::new(layout, (ArticulatedInertia::zero(), Wrench::zero())),
            eta: vec![T::zero(); layout.nv()],
        }
    }
    /// D⁻¹ of every degree of freedom at the configuration of the last call.
    pub fn factors(&self) -> &ArticulatedSweep<T> {
        &self.factors
    }
    /// η or ν of joint velocities.
    ///
    /// `q`: nq; `v`, `out`: nv. Cost O(n): the articulated sweep and one sweep outward; no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`], [`DynamicsError::SingularHinge`].
    pub fn diagonal(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        kind: DiagonalVelocity,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        self.check(layout, q, [("v", v), ("out", out)])?;
        out.copy_from_slice(v);
        let (q, out) = (T::arithmetic(q), T::arithmetic_mut(out));
        T::Arithmetic::dispatch(ToDiagonal { work: self, layout, q, kind, out })
    }
    /// Joint velocities of η or ν: the inverse of [`Self::diagonal`].
    ///
    /// `q`: nq; `diagonal`, `out`: nv. Cost O(n): the articulated sweep and one smoother sweep; no allocation.
    ///
    /// # Errors
    /// As [`Self::diagonal`].
    pub fn joint_velocity(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        diagonal: &[T],
        kind: DiagonalVelocity,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        self.check(layout, q, [("diagonal", diagonal), ("out", out)])?;
        out.copy_from_slice(diagonal);
        let (q, out) = (T::arithmetic(q), T::arithmetic_mut(out));
        T::Arithmetic::dispatch(ToJoints { work: self, layout, q, kind, out })
    }
    /// C_D or C_ν of velocities alone: without weight and other forces.
    ///
    /// `q`: nq; `diagonal`: η or ν, nv; `out`: nv. Cost O(n), four sweeps; no allocation.
    ///
    /// # Errors
    /// As [`Self::diagonal`].
    pub fn coriolis(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        diagonal: &[T],
        kind: DiagonalVelocity,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        self.check(layout, q, [("diagonal", diagonal), ("out", out)])?;
        self.eta.copy_from_slice(diagonal);
        out.fill(T::zero());
        let mut v = core::mem::take(&mut self.eta);
        let result = {
            let (q, v, out) = (T::arithmetic(q), T::arithmetic_mut(&mut v), T::arithmetic_mut(out));
            T::Arithmetic::dispatch(Rates { work: self, layout, q, kind, forces: Forces::None, v, out })
        };
        self.eta = v;
        result?;
        for (i, x) in out.iter_mut().enumerate() {
            let rate = -x.to_arithmetic();
            let inverse = self.factors.pivots[i].inverse;
            *x = T::from_arithmetic(if kind == DiagonalVelocity::Plain { rate / inverse } else { rate });
        }
        Ok(())
    }
    /// Forward dynamics in diagonal velocities: joint velocities, and the rate of η or ν.
    ///
    /// # Computes
    /// v = L* η and η̇ = D⁻¹ (L T − C_D), or v = L* D^(−½) ν and ν̇ = D^(−½) L T − C_ν; T with the weight and the wrenches.
    ///
    /// # Shapes & units
    /// `q`: nq; `diagonal`, `tau`, `v`, `rate`: nv; `wrenches`: one per body of the model, at its frame's origin, its axes.
    ///
    /// # Method
    /// soa.md 3.8, paper 2 (4.17) corrected. Only rotation, speed and the articulated inertias enter; M, its rate and Christoffel
    /// symbols are never formed.
    ///
    /// # Cost
    /// O(n): two sweeps inward and two outward; no allocation.
    ///
    /// # Accuracy
    /// As forward dynamics in the plain form, but products v × ω of the bodies' own speeds enter: a common speed |v| of all
    /// bodies costs ε |v| |ω|, which `ForwardDynamics` avoids.
    ///
    /// # Errors
    /// As [`Self::diagonal`].
    #[allow(clippy::too_many_arguments)]
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        diagonal: &[T],
        tau: &[T],
        wrenches: Option<&[Wrench<T>]>,
        kind: DiagonalVelocity,
        v: &mut [T],
        rate: &mut [T],
    ) -> Result<(), DynamicsError> {
        self.check(layout, q, [("diagonal", diagonal), ("tau", tau)])?;
        check_length("v", v, layout.nv())?;
        check_length("rate", rate, layout.nv())?;
        let mut forces = Forces::Weight;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, layout.model_bodies())?;
            layout.gather_loads(wrenches, &mut self.loads);
            forces = Forces::WeightAndLoads;
        }
        v.copy_from_slice(diagonal);
        rate.copy_from_slice(tau);
        let (q, v, out) = (T::arithmetic(q), T::arithmetic_mut(v), T::arithmetic_mut(rate));
        T::Arithmetic::dispatch(Rates { work: self, layout, q, kind, forces, v, out })
    }
    fn check(
        &self,
        layout: &Layout<T::Constant>,
        q: &[T],
        arguments: [(&'static str, &[T]); 2],
    ) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        layout.check_rigid("diagonal_dynamics")?;
        check_length("q", q, layout.nq())?;
        for (name, x) in arguments {
            check_length(name, x, layout.nv())?;
        }
        check_length("workspace", &self.P, layout.len())
    }
    /// ν to η.
    #[inline(always)]
    fn scale(&self, kind: DiagonalVelocity, x: &mut [T::Arithmetic]) {
        if kind == DiagonalVelocity::Normalized {
            for (x, pivot) in x.iter_mut().zip(&self.factors.pivots) {
                *x *= pivot.inverse.sqrt();
            }
        }
    }
}

/// What acts besides `tau`.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Forces {
    None,
    Weight,
    WeightAndLoads,
}

kernel! {
    ToDiagonal<'a, T> {
        work: &'a mut DiagonalDynamics<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        kind: DiagonalVelocity,
        // v before, η or ν after.
        out: &'a mut [T::Arithmetic],
    } -> Result<(), DynamicsError> {
        let DiagonalDynamics { factors, velocity, .. } = work;
        factors.sweep_inboard(layout, q, |_, _| {})?;
        for (k, body) in layout.bodies.iter().enumerate() {
            let joint = body.hinge.expand(&out[body.v..]);
            velocity[k] = match body.parent {
                GROUND => joint,
                p => factors.shifts.at(k, body).motion_to_child(velocity[p]) + joint,
            };
            for i in body.v..body.v + body.hinge.nv() {
                out[i] = velocity[k].dot(factors.pivots[i].gain);
            }
        }
        if kind == DiagonalVelocity::Normalized {
            for (x, pivot) in out.iter_mut().zip(&factors.pivots) {
                *x /= pivot.inverse.sqrt();
            }
        }
        Ok(())
    }
}

kernel! {
    ToJoints<'a, T> {
        work: &'a mut DiagonalDynamics<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        kind: DiagonalVelocity,
        // η or ν before, v after.
        out: &'a mut [T::Arithmetic],
    } -> Result<(), DynamicsError> {
        work.factors.sweep_inboard(layout, q, |_, _| {})?;
        work.scale(kind, out);
        work.factors.sweep_outboard(layout, out, &mut work.velocity);
        Ok(())
    }
}

kernel! {
    Rates<'a, T> {
        work: &'a mut DiagonalDynamics<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        kind: DiagonalVelocity,
        forces: Forces,
        // η or ν before, v after.
        v: &'a mut [T::Arithmetic],
        // T before, the rate of η or ν after.
        out: &'a mut [T::Arithmetic],
    } -> Result<(), DynamicsError> {
        let P = &mut work.P;
        work.factors.sweep_inboard(layout, q, |k, inertia| P[k] = *inertia)?;
        work.scale(kind, v);
        let DiagonalDynamics { factors, P, velocity, gravity, loads, pending, .. } = work;
        factors.sweep_outboard(layout, v, velocity);
        if forces != Forces::None {
            let ground = Motion::new(Vec3::zero(), Vec3::constant(layout.gravity));
            for (k, body) in layout.bodies.iter().enumerate() {
                let inboard = if body.parent == GROUND { ground } else { gravity[body.parent] };
                gravity[k] = factors.shifts.at(k, body).motion_to_child(inboard);
            }
        }
        pending.clear();
        let mut hand = (ArticulatedInertia::zero(), Wrench::zero());
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let from_children = pending.all(body, &mut hand, |sum, x| *sum = (sum.0 + x.0, sum.1 + x.1));
            let (rate, mut z) = from_children.unwrap_or((ArticulatedInertia::zero(), Wrench::zero()));
            let M = RigidInertia::constant(&body.inertia);
            let (V, joint) = (velocity[k], body.hinge.expand(&v[body.v..]));
            let a = V.cross_motion(joint);
            z += V.cross_wrench(M.momentum(V)) + P[k].times(a);
            if forces != Forces::None {
                z -= M.momentum(gravity[k]);
            }
            if forces == Forces::WeightAndLoads {
                z += loads[k];
            }
            let dofs = body.v..body.v + body.hinge.nv();
            let state = State { kind, P: P[k], rate, z, V, a };
            let (P, rate, z) = state.eliminate(body, &factors.pivots[dofs.clone()], &mut out[dofs]);
            if body.parent != GROUND {
                let passage = factors.shifts.at(k, body);
                let moved = if matches!(body.hinge, Hinge::Free) {
                    ArticulatedInertia::zero()
                } else {
                    passage.articulated_to_parent(&(rate + turned(joint, &P)))
                };
                pending.give(k, body, &mut hand, (moved, passage.wrench_to_parent(z)));
            }
        }
        Ok(())
    }
}

/// What the elimination of a joint works on.
struct State<T> {
    kind: DiagonalVelocity,
    P: ArticulatedInertia<T>,
    rate: ArticulatedInertia<T>,
    z: Wrench<T>,
    V: Motion<T>,
    a: Motion<T>,
}

impl<T: Scalar> State<T> {
    /// P⁺, Ṗ⁺ and z⁺; `out` holds T before and the rate of η or ν after.
    #[inline(always)]
    fn eliminate(
        mut self,
        body: &LayoutBody<T::Constant>,
        pivots: &[Pivot<T>],
        out: &mut [T],
    ) -> (ArticulatedInertia<T>, ArticulatedInertia<T>, Wrench<T>) {
        // H = I and G = I: z⁺ = T exactly, whatever the size of z.
        let through = matches!(body.hinge, Hinge::Free)
            .then(|| Wrench::from_array([out[0], out[1], out[2], out[3], out[4], out[5]]));
        for (i, pivot) in pivots.iter().enumerate() {
            let (axis, G) = (body.hinge.axis(i), pivot.gain);
            let W = self.rate.times(axis);
            let D_rate = body.hinge.project(i, &W);
            let G_rate = G.scale_add(-D_rate, W).scale(pivot.inverse);
            let epsilon = out[i] - body.hinge.project(i, &self.z);
            self.z = G.scale_add(epsilon, self.z);
            let eta_rate = epsilon.fma(pivot.inverse, self.a.dot(G) + self.V.dot(G_rate));
            out[i] = match self.kind {
                DiagonalVelocity::Plain => eta_rate,
                // ½ Ḋ η + D η̇ over √D.
                DiagonalVelocity::Normalized => {
                    let eta = self.V.dot(G);
                    let half = D_rate * eta * T::splat(0.5);
                    half.fma(pivot.inverse, eta_rate) / pivot.inverse.sqrt()
                }
            };
            // Ṗ − G W* − W G* + Ḋ G G*.
            let x = G.scale_add(-D_rate * T::splat(0.5), W);
            subtract_symmetric(&mut self.rate, G, x);
            let column = self.P.times(axis);
            self.P.subtract_outer(G, column);
        }
        (self.P, self.rate, through.unwrap_or(self.z))
    }
}

/// P −= a x* + x a*.
#[inline(always)]
fn subtract_symmetric<T: Scalar>(P: &mut ArticulatedInertia<T>, a: Wrench<T>, x: Wrench<T>) {
    for (m, a, x) in [(&mut P.inertia, a.moment, x.moment), (&mut P.mass, a.force, x.force)] {
        m.add_product(-a, x);
        m.add_product(-x, a);
    }
    for i in 0..3 {
        for j in 0..3 {
            let entry = &mut P.coupling.0[i][j];
            *entry = (-a.moment.0[i]).fma(x.force.0[j], (-x.moment.0[i]).fma(a.force.0[j], *entry));
        }
    }
}

/// S~ P + P S~*.
#[inline(always)]
fn turned<T: Scalar>(S: Motion<T>, P: &ArticulatedInertia<T>) -> ArticulatedInertia<T> {
    let (w, v) = (Mat3::skew(S.angular), Mat3::skew(S.linear));
    let (C, m) = (P.coupling, P.mass.to_mat3());
    let inertia = w * P.inertia.to_mat3() + v * C.transpose();
    let mass = w * m;
    ArticulatedInertia {
        inertia: Sym3::from_upper(&(inertia + inertia.transpose())),
        coupling: w * C + v * m - C * w,
        mass: Sym3::from_upper(&(mass + mass.transpose())),
    }
}

/// [`DiagonalDynamics::diagonal`] for a single call.
///
/// # Errors
/// As there.
pub fn diagonal_velocity<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    kind: DiagonalVelocity,
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    DiagonalDynamics::new(layout).diagonal(layout, q, v, kind, &mut out)?;
    Ok(out)
}

/// [`DiagonalDynamics::joint_velocity`] for a single call.
///
/// # Errors
/// As there.
pub fn joint_velocity<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    diagonal: &[T],
    kind: DiagonalVelocity,
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    DiagonalDynamics::new(layout).joint_velocity(layout, q, diagonal, kind, &mut out)?;
    Ok(out)
}

/// [`DiagonalDynamics::coriolis`] for a single call.
///
/// # Errors
/// As there.
pub fn diagonal_coriolis<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    diagonal: &[T],
    kind: DiagonalVelocity,
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    DiagonalDynamics::new(layout).coriolis(layout, q, diagonal, kind, &mut out)?;
    Ok(out)
}

/// [`DiagonalDynamics::run`] for a single call: joint velocities, and the rate of η or ν.
///
/// # Errors
/// As there.
///
/// # Example
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
/// use phipsi_recursion::{DiagonalVelocity, Layout, diagonal_dynamics};
/// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
/// let model = ModelBuilder::new("pendulum")
///     .body(Body::new("rod", rod))
///     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
///     .gravity([0.0, 0.0, -9.81])
///     .build()?;
/// let layout = Layout::<f64>::new(&model);
/// let nu = [2.0f64]; // kinetic energy 2 J
/// let (v, rate) = diagonal_dynamics(&layout, &[0.0], &nu, &[0.0], None, DiagonalVelocity::Normalized)?;
/// assert!((v[0] * v[0] / 6.0 - 2.0).abs() < 1e-14);
/// assert!((rate[0] - 1.5 * 9.81 / 3.0f64.sqrt()).abs() < 1e-14);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn diagonal_dynamics<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    diagonal: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
    kind: DiagonalVelocity,
) -> Result<(Vec<T>, Vec<T>), DynamicsError> {
    let (mut v, mut rate) = (vec![T::zero(); layout.nv()], vec![T::zero(); layout.nv()]);
    DiagonalDynamics::new(layout).run(layout, q, diagonal, tau, wrenches, kind, &mut v, &mut rate)?;
    Ok((v, rate))
}
