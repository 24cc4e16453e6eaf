//! Jacobians, column by column from the axes of the joints in the world, and J̇ v.

use crate::kinematics::{BodyMotion, kinematics, plane_axes, unit};
use nalgebra::DMatrix;
use phipsi_model::{JointKind, Model};
use phipsi_spatial::{Motion, Real, Vec3};

/// The velocity field of one degree of freedom at unit speed: rotation `angular` about `point`, and translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis<T> {
    /// The joint, and the body it carries.
    pub joint: usize,
    /// World axes.
    pub angular: Vec3<T>,
    /// A point that the rotation leaves in place, world.
    pub point: Vec3<T>,
    /// World axes.
    pub linear: Vec3<T>,
}

impl<T: Real> Axis<T> {
    /// Velocity of the world point x.
    pub fn velocity_at(&self, x: Vec3<T>) -> Vec3<T> {
        self.linear + self.angular.cross(x - self.point)
    }
}

/// The axes of all degrees of freedom, in the order of v.
pub fn axes<T: Real>(model: &Model, motions: &[BodyMotion<T>]) -> Vec<Axis<T>> {
    let mut all = Vec::with_capacity(model.nv());
    for (k, joint) in model.joints().iter().enumerate() {
        let r = motions[k].pose.rotation;
        let o = Vec3::zero();
        let mut push = |angular: Vec3<T>, linear: Vec3<T>| {
            all.push(Axis { joint: k, angular, point: motions[k].pose.translation, linear });
        };
        match joint.kind {
            JointKind::Revolute { axis } | JointKind::Continuous { axis } => push(r * unit(axis), o),
            JointKind::Prismatic { axis } => push(o, r * unit(axis)),
            JointKind::Helical { axis, pitch } => {
                let w = r * unit(axis);
                push(w, w.scale(T::splat(pitch)));
            }
            JointKind::Cylindrical { axis } => {
                push(r * unit(axis), o);
                push(o, r * unit(axis));
            }
            JointKind::Universal { axes: [first, second] } => {
                // The first axis stands in the joint frame, the second goes with the body.
                let outer = model.tree().parent(k).map_or(BodyMotion::world(), |p| motions[p]);
                let frame = outer.pose.compose(&joint.placement.to_transform());
                push(frame.rotation * unit(first), o);
                push(r * unit(second), o);
            }
            JointKind::Planar { normal } => {
                let plane = plane_axes::<T>(normal);
                push(r * plane.column(2), o);
                push(o, r * plane.column(0));
                push(o, r * plane.column(1));
            }
            JointKind::Translation => (0..3).for_each(|i| push(o, r.column(i))),
            JointKind::Spherical => (0..3).for_each(|i| push(r.column(i), o)),
            JointKind::Free => {
                (0..3).for_each(|i| push(r.column(i), o));
                (0..3).for_each(|i| push(o, r.column(i)));
            }
            _ => {}
        }
    }
    all
}

/// For every body, the degrees of freedom that move it.
pub fn supports(model: &Model) -> Vec<Vec<usize>> {
    (0..model.len())
        .map(|k| {
            let mut all: Vec<usize> = model.tree().path_to_root(k).flat_map(|j| model.v_range(j)).collect();
            all.sort_unstable();
            all
        })
        .collect()
}

/// J with (ω, velocity of the point) = J v, world axes; `point` in the body's frame (`None`: its origin). 6×nv.
pub fn jacobian<T: Real>(model: &Model, q: &[T], body: Option<usize>, point: Option<Vec3<T>>) -> DMatrix<T> {
    let mut j = DMatrix::from_element(6, model.nv(), T::zero());
    let Some(body) = body else { return j };
    let zero = vec![T::zero(); model.nv()];
    let motions = kinematics(model, q, &zero, &zero);
    let x = motions[body].pose.point(point.unwrap_or(Vec3::zero()));
    let axes = axes(model, &motions);
    for &i in &supports(model)[body] {
        let column = Motion::new(axes[i].angular, axes[i].velocity_at(x)).to_array();
        (0..6).for_each(|row| j[(row, i)] = column[row]);
    }
    j
}

/// J̇ v of the body-frame origin: its acceleration at v̇ = 0, world axes.
pub fn bias_acceleration<T: Real>(model: &Model, q: &[T], v: &[T], body: Option<usize>) -> Motion<T> {
    let zero = vec![T::zero(); model.nv()];
    body.map_or(Motion::zero(), |k| kinematics(model, q, v, &zero)[k].acceleration)
}
