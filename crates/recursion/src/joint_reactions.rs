//! Reaction wrenches across all joints, fixed ones included.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | f(k) | M α + b − w + Σ φ(k,c) f(c): wrench on body k from its parent | paper 2 (3.6) |

use crate::error::{DynamicsError, check_length};
use crate::kinematics::Kinematics;
use crate::layout::{GROUND, Layout};
use phipsi_model::Model;
use phipsi_spatial::{Motion, Scalar, Transform, Vec3, Wrench};

/// The wrench on every body of the model from its parent, at the body-frame origin, body axes.
///
/// # Shapes & units
/// `q`: nq; `v`, `a`: nv; `wrenches`: one per body; result: one per body of the model, fused ones included; N·m, N.
///
/// # Cost
/// O(n).
///
/// # Errors
/// [`DynamicsError::Shape`]; [`DynamicsError::Closure`].
pub fn joint_reactions<T: Scalar>(
    model: &Model,
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    a: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<Wrench<T>>, DynamicsError> {
    layout.check_tree()?;
    if let Some(wrenches) = wrenches {
        check_length("wrenches", wrenches, layout.model_bodies())?;
    }
    check_length("a", a, layout.nv())?;
    let mut kinematics = Kinematics::new(layout);
    kinematics.set_position(layout, q)?;
    kinematics.set_velocity(layout, v)?;
    kinematics.set_acceleration(layout, v, a)?;
    let gravity = Vec3::<T>::constant(layout.gravity);
    let mut forces = Vec::with_capacity(layout.model_bodies());
    for k in 0..layout.model_bodies() {
        let inertia = phipsi_spatial::RigidInertia::constant(&layout.carriers[k].inertia);
        let r = kinematics.pose(layout, Some(k)).rotation;
        let omega = kinematics.velocity_in_body(layout, Some(k)).angular;
        // Against free fall.
        let weightless = Motion::new(Vec3::zero(), r.transpose_mul(gravity));
        let alpha = kinematics.acceleration_in_body(layout, Some(k)) - weightless;
        let mut f = inertia.momentum(alpha) + inertia.gyroscopic(omega);
        if let Some(wrenches) = wrenches {
            f -= wrenches[k];
        }
        forces.push(f);
    }
    for k in (0..layout.model_bodies()).rev() {
        if let Some(p) = model.tree().parent(k) {
            let shifted = relative_pose(layout, &kinematics, p, k).wrench_to_parent(forces[k]);
            forces[p] += shifted;
        }
    }
    Ok(forces)
}

/// Pose of the user's frame of body k in that of its parent p.
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
