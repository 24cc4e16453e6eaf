//! Inverse kinematics: the configuration that brings a body to a pose, or as near to it as it can come.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | φ | log(R* R^T), rotation that is still to do, world axes | |
//! | p | position that is still to go | |
//! | ℓ | radius at which rotations count as lengths | |
//! | e | (ℓ φ, p): ½ |e|² is made least | |
//! | W J | Jacobian with angular rows times ℓ: e changes by −W J δq, to first order in e | paper 2 (4.8) |
//! | σ, U, V | singular values and vectors of W J | [`crate::jacobian_pseudo_inverse`](mod@crate::jacobian_pseudo_inverse) |
//! | g | −(W J)* e, the gradient: exact, for φ · Jr⁻¹(φ) ω = φ · ω | |
//! | B | second derivatives of ½ |e|² along the increments of `Model::integrate`, exact | `curvature.rs` |
//!
//! Steps to a target that is reached are damped least squares, V σ/(σ² + μ) U* e with μ a multiple of |e|²: quadratic
//! convergence also where the arm is redundant (Yamashita and Fukushima 2001). Where e does not go to zero its curvature counts
//! and steps are Newton's, (B + μ) δq = −g with μ a multiple of the squares of the columns of W J. Limits hold by an active set: coordinates that the gradient presses against a limit
//! stay there. A start that limits stop is tried again without them: hinges are turned back by whole turns afterwards.

use crate::error::{DynamicsError, check_length};
use crate::jacobian_pseudo_inverse::JacobianPseudoInverse;
use crate::layout::{GROUND, Layout};
use curvature::Path;
use descent::{End, Goal, clip};
use phipsi_model::{JointKind, Model, Random};
use phipsi_spatial::{Real, Scalar, Transform};

mod curvature;
mod descent;

/// What inverse kinematics is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseKinematicsOptions {
    /// The target is reached if the rotation error, rad, and the position error, in units of `length`, are at most this.
    pub tolerance: f64,
    /// Steps from each starting configuration, at most.
    pub iterations: usize,
    /// Further starts after the user's own configuration, at most: the same again passing limits, where there are limits, and
    /// random ones.
    pub restarts: usize,
    /// Seed of these.
    pub seed: u64,
    /// False: only the position counts.
    pub orientation: bool,
    /// True: one-axis joints stay within their limits.
    pub limits: bool,
    /// ℓ, m, the radius at which a rotation counts as a length; `None`: the length of the path of joint origins from the base
    /// to the body at q = 0, or 1 where it is zero.
    pub length: Option<f64>,
}

impl Default for InverseKinematicsOptions {
    fn default() -> Self {
        InverseKinematicsOptions {
            tolerance: 1e-10,
            iterations: 100,
            restarts: 10,
            seed: 0,
            orientation: true,
            limits: true,
            length: None,
        }
    }
}

/// How inverse kinematics ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseKinematicsInfo {
    /// True if the target was reached; false: the result is the closest configuration found.
    pub reached: bool,
    /// Remaining rotation, rad (also where only the position counts).
    pub rotation_error: f64,
    /// Remaining distance, m.
    pub position_error: f64,
    /// Steps taken, of all starts together.
    pub iterations: usize,
    /// Configurations started from.
    pub starts: usize,
    /// |g| over σ₁ |e|: zero where no small motion comes nearer. Zero if reached.
    pub gradient: f64,
    /// Singular values of W J at the result, falling, m; zeros where there are fewer than six.
    pub singular_values: [f64; 6],
    /// Coordinates that the target presses against a limit.
    pub at_limits: usize,
    /// ℓ, m.
    pub length: f64,
}

/// Workspace of inverse kinematics.
#[derive(Clone, Debug)]
pub struct InverseKinematics<T: Scalar> {
    pseudo: JacobianPseudoInverse<T>,
    path: Path,
    /// Joints of the model on the path.
    moving: Vec<bool>,
    lower: Vec<Option<f64>>,
    upper: Vec<Option<f64>>,
    /// False while limits are passed.
    bounded: bool,
    q: Vec<T>,
    trial: Vec<T>,
    step: Vec<T>,
    gradient: Vec<T>,
    frozen: Vec<bool>,
    hessian: Vec<T>,
    /// Squares of the columns of W J, then μ.
    squares: Vec<T>,
    best: Vec<T>,
}

impl<T: Real> InverseKinematics<T> {
    /// A workspace for a model and its layout.
    pub fn new(model: &Model, layout: &Layout<T>) -> Self {
        let (nq, nv) = (layout.nq(), layout.nv());
        InverseKinematics {
            pseudo: JacobianPseudoInverse::new(layout, 1),
            path: Path::new(layout),
            moving: vec![false; model.len()],
            lower: vec![None; nv],
            upper: vec![None; nv],
            bounded: true,
            q: vec![T::zero(); nq],
            trial: vec![T::zero(); nq],
            step: vec![T::zero(); nv],
            gradient: vec![T::zero(); nv],
            frozen: vec![false; nv],
            hessian: vec![T::zero(); nv * nv],
            squares: vec![T::zero(); nv],
            best: vec![T::zero(); nq],
        }
    }
    /// The configuration nearest to q0's basin that brings a body to a pose; the closest one found if none does.
    ///
    /// # Computes
    /// A minimum of ½ |e|², e = (ℓ φ, p): zero if the pose is reached. Starts at `q0`, then at random configurations, until the
    /// pose is reached. Joints that do not carry the body keep their coordinates.
    ///
    /// # Shapes & units
    /// `target`: pose of the body's frame in the world; `q0`, `out`: nq, `out` with unit quaternions.
    ///
    /// # Method
    /// Damped least squares on the configuration space, Newton steps where the pose is out of reach: see the module.
    ///
    /// # Cost
    /// For every step the singular values of a 6×nv matrix and, out of reach, a Cholesky factorisation of the path's degrees
    /// of freedom. No allocation.
    ///
    /// # Accuracy
    /// `info` tells what is left; a result counts as reached by `tolerance` alone.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Body`], [`DynamicsError::Closure`]; [`DynamicsError::NotFinite`] if q0 or the target is not finite.
    #[allow(clippy::too_many_arguments)]
    pub fn run(
        &mut self,
        model: &Model,
        layout: &Layout<T>,
        body: usize,
        target: &Transform<T>,
        q0: &[T],
        options: InverseKinematicsOptions,
        out: &mut [T],
    ) -> Result<InverseKinematicsInfo, DynamicsError> {
        layout.check_closures()?;
        layout.check_rigid("inverse_kinematics")?;
        layout.check_body(Some(body))?;
        check_length("q0", q0, layout.nq())?;
        check_length("out", out, layout.nq())?;
        check_length("workspace", &self.moving, model.len())?;
        check_length("bodies", &self.moving, layout.model_bodies())?;
        let numbers = target.rotation.0.iter().flatten().chain(&target.translation.0).chain(q0);
        if let Some((index, x)) = numbers.enumerate().find(|(_, x)| !x.is_finite()) {
            return Err(DynamicsError::NotFinite { index, found: x.to_f64() });
        }
        self.path.set(layout, body);
        self.set_limits(model, body, options.limits);
        let length = options.length.unwrap_or_else(|| reach(layout, body));
        let goal = Goal { model, layout, body, target, options, length };
        let mut random = Random::new(options.seed);
        let (mut iterations, mut starts) = (0, 0);
        let mut found: Option<End<T>> = None;
        for start in 0..=options.restarts {
            let limited = self.lower.iter().any(Option::is_some);
            // What limits stop on the way may lie within them by whole turns: q0 again, and random starts, pass them first.
            self.begin(&goal, q0, start > usize::from(limited), &mut random);
            starts += 1;
            if limited && start > 0 {
                self.bounded = false;
                let free = self.descend(&goal, &mut iterations);
                self.bounded = true;
                free?;
                self.unwind(model);
                clip(model, &self.lower, &self.upper, &mut self.q);
            }
            let end = self.descend(&goal, &mut iterations)?;
            let reached = goal.is_reached(&end.residual);
            // Also true if what was found before is no number.
            if !found.as_ref().is_some_and(|best| best.residual.square <= end.residual.square) {
                self.best.copy_from_slice(&self.q);
                found = Some(end);
            }
            if reached || self.path.dofs.is_empty() {
                break;
            }
        }
        out.copy_from_slice(&self.best);
        let Some(End { residual, gradient, at_limits, singular_values }) = found else {
            return Err(DynamicsError::NotFinite { index: 0, found: f64::NAN });
        };
        let reached = goal.is_reached(&residual);
        Ok(InverseKinematicsInfo {
            reached,
            rotation_error: residual.rotation.norm().to_f64(),
            position_error: residual.position.norm().to_f64(),
            iterations,
            starts,
            gradient: if reached { 0.0 } else { gradient },
            singular_values,
            at_limits,
            length,
        })
    }
    /// Joints on the path and their limits.
    fn set_limits(&mut self, model: &Model, body: usize, limits: bool) {
        self.moving.fill(false);
        (self.lower.iter_mut()).chain(&mut self.upper).for_each(|limit| *limit = None);
        let mut at = Some(body);
        while let Some(k) = at {
            self.moving[k] = true;
            let joint = &model.joints()[k];
            let one_axis = matches!(
                joint.kind,
                JointKind::Revolute { .. } | JointKind::Prismatic { .. } | JointKind::Helical { .. }
            );
            if let Some([lower, upper]) = joint.limits.position
                && limits
                && one_axis
                && lower <= upper
            {
                let v = model.v_offset(k);
                (self.lower[v], self.upper[v]) = (Some(lower), Some(upper));
            }
            at = model.tree().parent(k);
        }
    }
    /// Whole turns of hinges taken off, to the middle of their limits.
    fn unwind(&mut self, model: &Model) {
        for k in (0..model.len()).filter(|&k| self.moving[k]) {
            let (at, v) = (model.q_offset(k), model.v_offset(k));
            if let JointKind::Revolute { .. } = model.joints()[k].kind
                && let (Some(lower), Some(upper)) = (self.lower[v], self.upper[v])
            {
                let away = self.q[at].to_f64() - 0.5 * (lower + upper);
                let turns = (away / std::f64::consts::TAU).round();
                // 2π of the scalar.
                let turn = T::splat(8.0) * T::one().atan2(T::one());
                if turns.is_finite() && turns != 0.0 {
                    self.q[at] -= turn * T::splat(turns);
                }
            }
        }
    }
    /// The configuration of a start, within limits: the user's, or a random one of the joints on the path.
    fn begin(&mut self, goal: &Goal<'_, T>, q0: &[T], anywhere: bool, random: &mut Random) {
        self.q.copy_from_slice(q0);
        goal.model.normalize(&mut self.q);
        if anywhere {
            for k in (0..goal.model.len()).filter(|&k| self.moving[k]) {
                let (range, v) = (goal.model.q_range(k), goal.model.v_offset(k));
                let kind = goal.model.joints()[k].kind;
                for (i, at) in range.clone().enumerate() {
                    let x = random.signed();
                    self.q[at] = match kind {
                        JointKind::Spherical | JointKind::Free if range.end - at <= 4 => T::splat(x),
                        JointKind::Planar { .. } if i == 2 => T::splat(std::f64::consts::PI * x),
                        JointKind::Planar { .. } | JointKind::Free => T::splat(goal.length * x),
                        _ if kind.is_rotation(i) => T::splat(std::f64::consts::PI * x),
                        _ => T::splat(goal.length * x),
                    };
                    if let (1, Some(lower), Some(upper)) = (range.len(), self.lower[v], self.upper[v]) {
                        self.q[at] = T::splat(0.5 * (lower + upper) + 0.5 * (upper - lower) * x);
                    }
                }
            }
            goal.model.normalize(&mut self.q);
        }
        clip(goal.model, &self.lower, &self.upper, &mut self.q);
    }
}

/// Length of the path of joint origins from the base to a body at q = 0, m; 1 where it is zero.
fn reach<T: Real>(layout: &Layout<T>, body: usize) -> f64 {
    let carrier = &layout.carriers()[body];
    let (mut sum, mut k) = (carrier.pose.translation.norm().to_f64(), carrier.body);
    while k != GROUND {
        let body = &layout.bodies()[k];
        if body.parent != GROUND {
            sum += body.placement().translation.norm().to_f64();
        }
        k = body.parent;
    }
    if sum > 0.0 { sum } else { 1.0 }
}

/// [`InverseKinematics::run`] for a single call.
///
/// # Errors
/// As there.
///
/// # Example
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder, Placement};
/// use phipsi_recursion::{InverseKinematicsOptions, Layout, body_pose, inverse_kinematics};
/// let hinge = JointKind::Revolute { axis: [0.0, 0.0, 1.0] };
/// let meter = Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3]);
/// let body = || Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.1; 3]);
/// let model = ModelBuilder::new("arm")
///     .body(Body::new("upper", body()))
///     .body(Body::new("lower", body()))
///     .body(Body::new("hand", body()))
///     .joint(Joint::new("shoulder", hinge), "world", "upper")
///     .joint(Joint::new("elbow", hinge).at(meter), "upper", "lower")
///     .joint(Joint::new("wrist", hinge).at(meter), "lower", "hand")
///     .build()?;
/// let layout = Layout::<f64>::new(&model);
/// let target = body_pose(&layout, &[0.3, 0.8, -0.2], Some(2))?;
/// let options = InverseKinematicsOptions::default();
/// let (q, info) = inverse_kinematics(&model, &layout, 2, &target, &[0.1, 0.5, 0.0], options)?;
/// assert!(info.reached && (q[1] - 0.8).abs() < 1e-8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn inverse_kinematics<T: Real>(
    model: &Model,
    layout: &Layout<T>,
    body: usize,
    target: &Transform<T>,
    q0: &[T],
    options: InverseKinematicsOptions,
) -> Result<(Vec<T>, InverseKinematicsInfo), DynamicsError> {
    let mut out = vec![T::zero(); layout.nq()];
    let mut work = InverseKinematics::new(model, layout);
    let info = work.run(model, layout, body, target, q0, options, &mut out)?;
    Ok((out, info))
}
