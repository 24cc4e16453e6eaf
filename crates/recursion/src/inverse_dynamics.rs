//! Inverse dynamics: joint forces of a given motion (Newton–Euler).
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | ω, α | angular velocity and inertial acceleration of a body, α(ground) = (0, −g) | soa.md 3.0 |
//! | a, c | Coriolis accelerations: [`crate::kinematics`] | soa.md 3.0 |
//! | b | (ω × J ω, ω × (ω × h)), gyroscopic force | soa.md 3.0 |
//! | f | M α + b − w + Σ φ(k,c) f(c), force across the joint | paper 1 (5.1), paper 2 (3.6) |
//! | T | H f, generalised force | paper 1 |

use crate::error::{DynamicsError, check_length};
use crate::kinematics::coriolis;
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{Motion, Scalar, Transform, Vec3, Wrench};

/// Workspace of inverse dynamics.
#[derive(Clone, Debug)]
pub struct InverseDynamics<T> {
    hinge: Vec<Transform<T>>,
    omega: Vec<Vec3<T>>,
    acceleration: Vec<Motion<T>>,
    force: Vec<Wrench<T>>,
}

impl<T: Scalar> InverseDynamics<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let n = layout.len();
        InverseDynamics {
            hinge: vec![Transform::identity(); n],
            omega: vec![Vec3::zero(); n],
            acceleration: vec![Motion::zero(); n],
            force: vec![Wrench::zero(); n],
        }
    }
    /// Generalised forces of accelerations `a` at (q, v).
    ///
    /// # Computes
    /// T = H φ [M (φ*(H* a + coriolis) + gravity) + b − w], soa.md 3.1.
    ///
    /// # Shapes & units
    /// `q`: nq; `v`, `a`, `out`: nv; `wrenches`: one per body of the model, at its frame's origin, its axes, acting on it.
    ///
    /// # Cost
    /// O(n): one outward and one inward sweep; no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`]; [`DynamicsError::Closure`] if the model has closures.
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        a: &[T],
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        layout.check_tree()?;
        check_length("q", q, layout.nq())?;
        check_length("v", v, layout.nv())?;
        check_length("a", a, layout.nv())?;
        check_length("out", out, layout.nv())?;
        check_length("workspace", &self.force, layout.len())?;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, layout.model_bodies())?;
        }
        self.sweep_outboard(layout, q, v, a);
        layout.subtract_wrenches(wrenches, &mut self.force);
        self.sweep_inboard(layout, out);
        Ok(())
    }

    #[inline(always)]
    fn sweep_outboard(&mut self, layout: &Layout<T::Constant>, q: &[T], v: &[T], a: &[T]) {
        let ground = Motion::new(Vec3::zero(), -Vec3::constant(layout.gravity));
        for (k, body) in layout.bodies.iter().enumerate() {
            let x = body.pose(q);
            let joint = body.hinge.expand(&v[body.v..]);
            let (inboard, inboard_acceleration) = if body.parent == GROUND {
                (Vec3::zero(), ground)
            } else {
                (self.omega[body.parent], self.acceleration[body.parent])
            };
            let omega = x.rotation.transpose_mul(inboard) + joint.angular;
            let alpha = x.motion_to_child(inboard_acceleration)
                + body.hinge.expand(&a[body.v..])
                + body.hinge.turning(&v[body.v..])
                + coriolis(&x, inboard, omega, joint);
            let M = phipsi_spatial::RigidInertia::constant(&body.inertia);
            self.force[k] = M.momentum(alpha) + M.gyroscopic(omega);
            (self.hinge[k], self.omega[k], self.acceleration[k]) = (x, omega, alpha);
        }
    }

    #[inline(always)]
    fn sweep_inboard(&mut self, layout: &Layout<T::Constant>, out: &mut [T]) {
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let f = self.force[k];
            for i in 0..body.hinge.nv() {
                out[body.v + i] = body.hinge.project(i, &f);
            }
            if body.parent != GROUND {
                let shifted = self.hinge[k].wrench_to_parent(f);
                self.force[body.parent] += shifted;
            }
        }
    }
}

/// [`InverseDynamics::run`] for a single call.
///
/// # Errors
/// As there.
pub fn inverse_dynamics<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    a: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    InverseDynamics::new(layout).run(layout, q, v, a, wrenches, &mut out)?;
    Ok(out)
}

/// Inverse dynamics at a = 0: Coriolis, centrifugal and gravity forces.
///
/// # Errors
/// As [`InverseDynamics::run`].
pub fn bias_forces<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
) -> Result<Vec<T>, DynamicsError> {
    inverse_dynamics(layout, q, v, &vec![T::zero(); layout.nv()], None)
}

/// The forces that hold the mechanism at rest against gravity.
///
/// # Errors
/// As [`InverseDynamics::run`].
pub fn gravity_forces<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<Vec<T>, DynamicsError> {
    let zero = vec![T::zero(); layout.nv()];
    inverse_dynamics(layout, q, &zero, &zero, None)
}

/// M(q) x in O(n), without the matrix.
///
/// # Errors
/// As [`InverseDynamics::run`].
pub fn multiply_by_mass_matrix<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    x: &[T],
) -> Result<Vec<T>, DynamicsError> {
    let weightless = layout.clone().with_gravity(Vec3::zero());
    inverse_dynamics(&weightless, q, &vec![T::zero(); layout.nv()], x, None)
}
