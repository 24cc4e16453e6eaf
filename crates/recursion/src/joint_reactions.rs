//! Reaction wrenches across all joints, fixed ones included.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | f(k) | M α + b − w + Σ φ(k,c) f(c): wrench on body k from its parent | paper 2 (3.6) |

use crate::error::{DynamicsError, check_length};
use crate::kernel::kernel;
use crate::kinematics::Kinematics;
use crate::layout::{GROUND, Layout};
use phipsi_model::Model;
use phipsi_spatial::{Motion, RigidInertia, Scalar, Transform, Vec3, Wrench};

/// Workspace of the joint reactions.
#[derive(Clone, Debug)]
pub struct JointReactions<T: Scalar> {
    kinematics: Kinematics<T::Arithmetic>,
    /// Parent of every body of the model, or [`GROUND`].
    parents: Vec<usize>,
    force: Vec<Wrench<T::Arithmetic>>,
}

impl<T: Scalar> JointReactions<T> {
    /// A workspace for a model and its layout.
    pub fn new(model: &Model, layout: &Layout<T::Constant>) -> Self {
        let parents = (0..model.len()).map(|k| model.tree().parent(k).unwrap_or(GROUND));
        JointReactions {
            kinematics: Kinematics::new(layout),
            parents: parents.collect(),
            force: vec![Wrench::zero(); model.len()],
        }
    }
    /// The wrench on every body of the model from its parent, at the body-frame origin, body axes.
    ///
    /// # Shapes & units
    /// `q`: nq; `v`, `a`: nv; `wrenches`, `out`: one per body of the model, fused ones included; N·m, N.
    ///
    /// # Cost
    /// O(n), no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`]; [`DynamicsError::Closure`].
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        a: &[T],
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [Wrench<T>],
    ) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        layout.check_rigid("joint_reactions")?;
        check_length("q", q, layout.nq())?;
        check_length("v", v, layout.nv())?;
        check_length("a", a, layout.nv())?;
        check_length("out", out, layout.model_bodies())?;
        check_length("workspace", &self.force, layout.model_bodies())?;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, layout.model_bodies())?;
        }
        let (q, v, a) = (T::arithmetic(q), T::arithmetic(v), T::arithmetic(a));
        T::Arithmetic::dispatch(Sweeps { work: self, layout, q, v, a, wrenches, out })
    }
}

kernel! {
    Sweeps<'a, T> {
        work: &'a mut JointReactions<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        v: &'a [T::Arithmetic],
        a: &'a [T::Arithmetic],
        wrenches: Option<&'a [Wrench<T>]>,
        out: &'a mut [Wrench<T>],
    } -> Result<(), DynamicsError> {
        let JointReactions { kinematics, parents, force: forces } = work;
        kinematics.set_position(layout, q)?;
        kinematics.set_velocity(layout, v)?;
        kinematics.set_acceleration(layout, v, a)?;
        let gravity = Vec3::constant(layout.gravity);
        for (k, f) in forces.iter_mut().enumerate() {
            let M = RigidInertia::constant(&layout.carriers[k].inertia);
            let r = kinematics.pose(layout, Some(k)).rotation;
            let omega = kinematics.velocity_in_body(layout, Some(k)).angular;
            // Against free fall.
            let weightless = Motion::new(Vec3::zero(), r.transpose_mul(gravity));
            let alpha = kinematics.acceleration_in_body(layout, Some(k)) - weightless;
            *f = M.momentum(alpha) + M.gyroscopic(omega);
            if let Some(wrenches) = wrenches {
                *f -= wrenches[k].map(T::to_arithmetic);
            }
        }
        for (k, &p) in parents.iter().enumerate().rev() {
            if p != GROUND {
                let shifted = relative_pose(layout, kinematics, p, k).wrench_to_parent(forces[k]);
                forces[p] += shifted;
            }
        }
        for (out, f) in out.iter_mut().zip(forces) {
            *out = f.map(T::from_arithmetic);
        }
        Ok(())
    }
}

/// [`JointReactions::run`] for a single call.
///
/// # Errors
/// As there.
pub fn joint_reactions<T: Scalar>(
    model: &Model,
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    a: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<Wrench<T>>, DynamicsError> {
    let mut out = vec![Wrench::zero(); layout.model_bodies()];
    JointReactions::new(model, layout).run(layout, q, v, a, wrenches, &mut out)?;
    Ok(out)
}

/// Pose of the user's frame of body k in that of its parent p.
#[inline(always)]
fn relative_pose<T: Scalar>(
    layout: &Layout<T::Constant>,
    kinematics: &Kinematics<T>,
    p: usize,
    k: usize,
) -> Transform<T> {
    let (inner, outer) = (&layout.carriers[k], &layout.carriers[p]);
    let mut pose = Transform::constant(&inner.pose);
    let mut at = inner.body;
    // No step for a fixed joint, one for a hinge, two for a universal joint.
    while at != outer.body && at != GROUND {
        pose = kinematics.hinge[at].compose(&pose);
        at = layout.bodies[at].parent;
    }
    Transform::constant(&outer.pose).inverse().compose(&pose)
}
