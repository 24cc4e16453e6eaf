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

use crate::articulated_sweep::{Pivot, eliminate, filter, smooth};
use crate::error::{DynamicsError, check_length};
use crate::inverse_dynamics::inverse_dynamics;
use crate::kinematics::coriolis;
use crate::layout::{GROUND, Layout};
use crate::mass_matrix::composite_inertias;
use phipsi_spatial::{ArticulatedInertia, Motion, Real, RigidInertia, Scalar, Transform, Vec3, Wrench};

/// Workspace of forward dynamics.
#[derive(Clone, Debug)]
pub struct ForwardDynamics<T> {
    hinge: Vec<Transform<T>>,
    omega: Vec<Vec3<T>>,
    coriolis: Vec<Motion<T>>,
    inertia: Vec<ArticulatedInertia<T>>,
    bias: Vec<Wrench<T>>,
    alpha: Vec<Motion<T>>,
    pivots: Vec<Pivot<T>>,
}

impl<T: Scalar> ForwardDynamics<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let n = layout.len();
        ForwardDynamics {
            hinge: vec![Transform::identity(); n],
            omega: vec![Vec3::zero(); n],
            coriolis: vec![Motion::zero(); n],
            inertia: vec![ArticulatedInertia::zero(); n],
            bias: vec![Wrench::zero(); n],
            alpha: vec![Motion::zero(); n],
            pivots: vec![Pivot::empty(); layout.nv()],
        }
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
    /// O(n): three sweeps; no allocation.
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
        self.run_turning(layout, q, v, tau, wrenches, out)?;
        for body in &layout.bodies {
            let dofs = body.v..body.v + body.hinge.nv();
            body.hinge.subtract_turning(&v[body.v..], &mut out[dofs]);
        }
        Ok(())
    }
    /// The same, but `out` gets θ̈ + c.
    pub(crate) fn run_turning(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        tau: &[T],
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        layout.check_tree()?;
        check_length("q", q, layout.nq())?;
        check_length("v", v, layout.nv())?;
        check_length("tau", tau, layout.nv())?;
        check_length("out", out, layout.nv())?;
        check_length("workspace", &self.bias, layout.len())?;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, layout.model_bodies())?;
        }
        self.sweep_velocities(layout, q, v);
        layout.subtract_wrenches(wrenches, &mut self.bias);
        out.copy_from_slice(tau);
        self.sweep_inboard(layout, out)?;
        self.sweep_outboard(layout, out);
        Ok(())
    }

    /// Pivot of one degree of freedom, after a run.
    #[inline(always)]
    pub(crate) fn pivot(&self, i: usize) -> Pivot<T::Arithmetic> {
        let Pivot { column, inverse } = self.pivots[i];
        Pivot {
            column: Wrench::from_array(column.to_array().map(T::to_arithmetic)),
            inverse: inverse.to_arithmetic(),
        }
    }

    #[inline(always)]
    fn sweep_velocities(&mut self, layout: &Layout<T::Constant>, q: &[T], v: &[T]) {
        for (k, body) in layout.bodies.iter().enumerate() {
            let x = body.pose(q);
            let joint = body.hinge.expand(&v[body.v..]);
            let inboard = if body.parent == GROUND { Vec3::zero() } else { self.omega[body.parent] };
            let omega = x.rotation.transpose_mul(inboard) + joint.angular;
            let M = RigidInertia::constant(&body.inertia);
            self.bias[k] = M.gyroscopic(omega);
            self.coriolis[k] = coriolis(&x, inboard, omega, joint);
            self.inertia[k] = M.to_articulated();
            (self.hinge[k], self.omega[k]) = (x, omega);
        }
    }

    /// Kalman filter: `residuals` holds T before and ν after.
    #[inline(always)]
    fn sweep_inboard(
        &mut self,
        layout: &Layout<T::Constant>,
        residuals: &mut [T],
    ) -> Result<(), DynamicsError> {
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let dofs = body.v..body.v + body.hinge.nv();
            let mut P = self.inertia[k];
            let mut z = self.bias[k] + P.times(self.coriolis[k]);
            let pivots = &mut self.pivots[dofs.clone()];
            eliminate(&body.hinge, &mut P, pivots).map_err(|(i, D)| layout.singular(body.v + i, D))?;
            filter(&body.hinge, pivots, &mut z, &mut residuals[dofs]);
            if body.parent != GROUND {
                let x = &self.hinge[k];
                self.bias[body.parent] += x.wrench_to_parent(z);
                self.inertia[body.parent] = self.inertia[body.parent] + x.articulated_to_parent(&P);
            }
        }
        Ok(())
    }

    /// Bryson–Frazier smoother: `residuals` holds ν before and θ̈ + c after.
    #[inline(always)]
    fn sweep_outboard(&mut self, layout: &Layout<T::Constant>, residuals: &mut [T]) {
        let ground = Motion::new(Vec3::zero(), -Vec3::constant(layout.gravity));
        for (k, body) in layout.bodies.iter().enumerate() {
            let dofs = body.v..body.v + body.hinge.nv();
            let inboard = if body.parent == GROUND { ground } else { self.alpha[body.parent] };
            let mut alpha = self.hinge[k].motion_to_child(inboard);
            smooth(&body.hinge, &self.pivots[dofs.clone()], &mut alpha, &mut residuals[dofs]);
            self.alpha[k] = alpha + self.coriolis[k];
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

/// The hinge that loses most digits.
#[derive(Clone, Debug, PartialEq)]
pub struct WorstHinge {
    /// The joint's name.
    pub joint: String,
    /// Which of its degrees of freedom.
    pub component: usize,
    /// Articulated inertia D over the composite inertia of the same degree of freedom (joints outboard locked): the
    /// factor by which cancellation outboard of it can multiply rounding is the inverse.
    pub ratio: f64,
}

/// How good a forward dynamics result is.
#[derive(Clone, Debug, PartialEq)]
pub struct ForwardInfo {
    /// The hinge with the smallest D relative to its composite inertia.
    pub worst_hinge: Option<WorstHinge>,
    /// |τ − inverse dynamics of the result| over the sum of |terms|, largest component, in units of 1.
    pub backward_error: f64,
}

/// Backward error and worst hinge of accelerations `a` that forward dynamics gave for (q, v, tau).
///
/// The sum of terms of component i is |τ_i| + |M_ii a_i| + |bias_i| + Σ_j |M_ij a_j|, from the mass matrix.
/// Cost O(n · depth).
///
/// # Errors
/// As [`ForwardDynamics::run`].
pub fn forward_info<T: Real>(
    layout: &Layout<T>,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
    a: &[T],
) -> Result<ForwardInfo, DynamicsError> {
    let sweep = crate::ArticulatedSweep::new(layout, q)?;
    let back = inverse_dynamics(layout, q, v, a, wrenches)?;
    let bias = inverse_dynamics(layout, q, v, &vec![T::zero(); layout.nv()], wrenches)?;
    let (hinge, R) = composite_inertias(layout, q);
    let mut terms: Vec<f64> = (0..layout.nv()).map(|i| (tau[i].abs() + bias[i].abs()).to_f64()).collect();
    let mut worst: Option<(usize, f64)> = None;
    for (k, body) in layout.bodies.iter().enumerate() {
        for i in 0..body.hinge.nv() {
            let column = body.v + i;
            let mut f = R[k].momentum(body.hinge.axis(i));
            let own = body.hinge.project(i, &f);
            let ratio = (sweep.pivots[column].inverse * own).recip().to_f64();
            if worst.is_none_or(|(_, smallest)| ratio < smallest) {
                worst = Some((column, ratio));
            }
            let (mut from, mut at) = (k, k);
            while at != GROUND {
                if at != from {
                    f = hinge[from].wrench_to_parent(f);
                }
                let up = &layout.bodies[at];
                for j in 0..up.hinge.nv() {
                    let row = up.v + j;
                    let entry = up.hinge.project(j, &f).abs();
                    terms[row] += (entry * a[column].abs()).to_f64();
                    if at != k {
                        terms[column] += (entry * a[row].abs()).to_f64();
                    }
                }
                (from, at) = (at, up.parent);
            }
        }
    }
    let relative = |i: usize| match (back[i] - tau[i]).abs().to_f64() {
        0.0 => 0.0,
        residual => residual / terms[i],
    };
    Ok(ForwardInfo {
        worst_hinge: worst.map(|(i, ratio)| {
            let (joint, component) = layout.joint_of_velocity(i);
            WorstHinge { joint: joint.into(), component, ratio }
        }),
        backward_error: (0..layout.nv()).map(relative).fold(0.0, f64::max),
    })
}
