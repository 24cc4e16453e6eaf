//! Rigid bodies in world axes.

use crate::kinematics::BodyMotion;
use phipsi_model::Model;
use phipsi_spatial::{Mat3, Quaternion, Real, Vec3};

/// Mass properties of a body at its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldInertia<T> {
    /// kg.
    pub mass: T,
    /// Centre of mass, m, world axes.
    pub center: Vec3<T>,
    /// Moments about the centre of mass, world axes, kg·m².
    pub tensor: Mat3<T>,
}

/// Mass properties of every body where it is.
pub fn world_inertias<T: Real>(model: &Model, motions: &[BodyMotion<T>]) -> Vec<WorldInertia<T>> {
    let place = |(body, motion): (&phipsi_model::Body, &BodyMotion<T>)| {
        let inertia = &body.inertia;
        let [xx, xy, xz, yy, yz, zz] = inertia.tensor.map(T::splat);
        let axes = motion.pose.rotation * Quaternion(inertia.frame.rotation.map(T::splat)).to_rotation();
        WorldInertia {
            mass: T::splat(inertia.mass),
            center: motion.pose.point(Vec3::splat(inertia.frame.translation)),
            tensor: axes * Mat3([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * axes.transpose(),
        }
    };
    model.bodies().iter().zip(motions).map(place).collect()
}

/// True for bodies that some joint can move.
pub fn moves(model: &Model) -> Vec<bool> {
    (0..model.len()).map(|k| model.tree().path_to_root(k).any(|j| model.joints()[j].kind.nv() > 0)).collect()
}
