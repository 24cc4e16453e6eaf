//! Joint forces by d'Alembert's principle: the power of (inertia force − weight − wrench) on every degree of freedom.

use crate::bodies::world_inertias;
use crate::jacobian::{axes, supports};
use crate::kinematics::kinematics;
use crate::mass_matrix::mass_matrix;
use phipsi_model::Model;
use phipsi_spatial::{Real, Vec3, Wrench};

/// Generalised forces of accelerations `a` at (q, v) under external wrenches (one per body, at its origin, its axes).
pub fn inverse_dynamics<T: Real>(
    model: &Model,
    q: &[T],
    v: &[T],
    a: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Vec<T> {
    let motions = kinematics(model, q, v, a);
    let axes = axes(model, &motions);
    let inertias = world_inertias(model, &motions);
    let g = Vec3::splat(model.gravity());
    let mut tau = vec![T::zero(); model.nv()];
    for (k, support) in supports(model).iter().enumerate() {
        let (motion, inertia) = (&motions[k], &inertias[k]);
        let force = (motion.acceleration_at(inertia.center) - g).scale(inertia.mass);
        let w = motion.velocity.angular;
        let moment = inertia.tensor * motion.acceleration.angular + w.cross(inertia.tensor * w);
        for &i in support {
            tau[i] += axes[i].velocity_at(inertia.center).dot(force) + axes[i].angular.dot(moment);
            if let Some(wrenches) = wrenches {
                let r = motion.pose.rotation;
                let (n, f) = (r * wrenches[k].moment, r * wrenches[k].force);
                tau[i] -= axes[i].velocity_at(motion.pose.translation).dot(f) + axes[i].angular.dot(n);
            }
        }
    }
    tau
}

/// Coriolis, centrifugal and gravity forces.
pub fn bias_forces<T: Real>(model: &Model, q: &[T], v: &[T]) -> Vec<T> {
    inverse_dynamics(model, q, v, &vec![T::zero(); model.nv()], None)
}

/// The forces that hold the mechanism at rest.
pub fn gravity_forces<T: Real>(model: &Model, q: &[T]) -> Vec<T> {
    bias_forces(model, q, &vec![T::zero(); model.nv()])
}

/// M(q) x.
pub fn multiply_by_mass_matrix<T: Real>(model: &Model, q: &[T], x: &[T]) -> Vec<T> {
    let m = mass_matrix(model, q);
    (0..model.nv()).map(|i| (0..model.nv()).fold(T::zero(), |sum, j| sum + m[(i, j)] * x[j])).collect()
}
