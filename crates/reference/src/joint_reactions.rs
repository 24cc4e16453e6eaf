//! Reactions by free-body balance: everything outboard of a joint is one system, moved by the joint's wrench, weights and
//! external wrenches.

use crate::bodies::world_inertias;
use crate::kinematics::kinematics;
use phipsi_model::Model;
use phipsi_spatial::{Real, Vec3, Wrench};

/// The wrench on every body from its parent, at its origin, its axes.
pub fn joint_reactions<T: Real>(
    model: &Model,
    q: &[T],
    v: &[T],
    a: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Vec<Wrench<T>> {
    let motions = kinematics(model, q, v, a);
    let inertias = world_inertias(model, &motions);
    let g = Vec3::splat(model.gravity());
    let balance = |k: usize| {
        let pose = motions[k].pose;
        let mut sum = Wrench::zero();
        for j in (k..model.len()).filter(|&j| model.tree().path_to_root(j).any(|i| i == k)) {
            let (motion, inertia) = (&motions[j], &inertias[j]);
            let w = motion.velocity.angular;
            let force = (motion.acceleration_at(inertia.center) - g).scale(inertia.mass);
            let moment = inertia.tensor * motion.acceleration.angular + w.cross(inertia.tensor * w);
            sum += Wrench::new((inertia.center - pose.translation).cross(force) + moment, force);
            if let Some(wrenches) = wrenches {
                let r = motion.pose.rotation;
                let (n, f) = (r * wrenches[j].moment, r * wrenches[j].force);
                sum -= Wrench::new((motion.pose.translation - pose.translation).cross(f) + n, f);
            }
        }
        Wrench::new(pose.rotation.transpose_mul(sum.moment), pose.rotation.transpose_mul(sum.force))
    };
    (0..model.len()).map(balance).collect()
}
