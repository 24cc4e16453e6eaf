//! The error of a pose, and its gradient by dual numbers: what inverse kinematics makes zero.

use crate::inverse_dynamics_derivatives::{fixed, seeded, tangent};
use crate::kinematics::kinematics;
use phipsi_model::Model;
use phipsi_spatial::{Mat3, Real, Transform, Vec3};

/// The vector of a rotation: its axis from the antisymmetric part, its angle from that and the trace. Below half a turn.
fn rotation_vector<T: Real>(r: &Mat3<T>) -> Vec3<T> {
    let (m, half) = (&r.0, T::splat(0.5));
    let sine = Vec3([m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]).scale(half);
    let cosine = (m[0][0] + m[1][1] + m[2][2] - T::one()) * half;
    let s = sine.norm();
    if s == T::zero() {
        return sine;
    }
    sine.scale(s.atan2(cosine) / s)
}

/// Rotation (world axes) and displacement from a body's pose to a target.
pub fn pose_error<T: Real>(model: &Model, q: &[T], body: usize, target: &Transform<T>) -> [Vec3<T>; 2] {
    let zero = vec![T::zero(); model.nv()];
    let pose = kinematics(model, q, &zero, &zero)[body].pose;
    [rotation_vector(&(target.rotation * pose.rotation.transpose())), target.translation - pose.translation]
}

/// The gradient of ½ (ℓ² |rotation|² + |displacement|²) along the increments of q, nv.
pub fn pose_error_gradient<T: Real>(
    model: &Model,
    q: &[T],
    body: usize,
    target: &Transform<T>,
    length: T,
) -> Vec<T> {
    let constant = |m: &Transform<T>| {
        let rotation = Mat3(m.rotation.0.map(|row| row.map(crate::Dual::fixed)));
        Transform::new(rotation, Vec3(m.translation.0.map(crate::Dual::fixed)))
    };
    let (target, square) = (constant(target), fixed(&[length * length])[0]);
    let half = fixed(&[T::splat(0.5)])[0];
    let component = |j: usize| {
        let mut unit = vec![T::zero(); model.nv()];
        unit[j] = T::one();
        let moving = seeded(q, &tangent(model, q, &unit));
        let [rotation, position] = pose_error(model, &moving, body, &target);
        ((square * rotation.dot(rotation) + position.dot(position)) * half).rate
    };
    (0..model.nv()).map(component).collect()
}
