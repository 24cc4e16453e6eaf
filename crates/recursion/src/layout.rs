//! The compiled form of a model that the sweeps run on.
//!
//! Fixed joints are fused into the body that carries them; a universal joint becomes two hinges with a massless body
//! between; frames are turned so that every joint axis is a coordinate axis (z for one-axis joints). Each body of the
//! model keeps its pose in the layout body that carries it, so results come back in the user's frames and names.

use crate::error::DynamicsError;
use crate::hinge::Hinge;
use phipsi_model::joint::rotation_from_z;
use phipsi_model::{JointKind, Model};
use phipsi_spatial::{Mat3, Real, RigidInertia, Scalar, Transform, Vec3, Wrench};

/// Marks the ground as a parent or carrier.
pub const GROUND: usize = usize::MAX;

/// A moving body of the layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayoutBody<C> {
    /// Index of its parent, or [`GROUND`].
    pub parent: usize,
    /// Its inboard joint.
    pub hinge: Hinge<C>,
    /// First position coordinate, in the model's q.
    pub q: usize,
    /// First degree of freedom, in the model's v.
    pub v: usize,
    /// Joint frame in the parent's frame at q = 0.
    pub placement: Transform<C>,
    /// Inertia of the body and all that is fused to it, about its origin.
    pub inertia: RigidInertia<C>,
}

impl<C: Real> LayoutBody<C> {
    /// Pose of the body in its parent at coordinates `q` of the whole model.
    #[inline(always)]
    pub fn pose<T: Scalar<Constant = C>>(&self, q: &[T]) -> Transform<T> {
        self.hinge.transform(&self.placement, &q[self.q..])
    }
}

/// Where a body of the model lives in the layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carrier<C> {
    /// The layout body, or [`GROUND`].
    pub body: usize,
    /// Pose of the user's body frame in the layout body's frame.
    pub pose: Transform<C>,
    /// The body's own inertia about its frame's origin, in the user's axes.
    pub inertia: RigidInertia<C>,
}

/// A model compiled for the sweeps, with constants in the scalar `C`.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout<C = f64> {
    pub(crate) bodies: Vec<LayoutBody<C>>,
    pub(crate) carriers: Vec<Carrier<C>>,
    pub(crate) gravity: Vec3<C>,
    nq: usize,
    nv: usize,
    joint_of_velocity: Vec<(String, usize)>,
    refused: Option<DynamicsError>,
}

impl<C: Real> Layout<C> {
    /// Compiles a model. Cost O(n).
    pub fn new(model: &Model) -> Self {
        let mut bodies: Vec<LayoutBody<C>> = Vec::new();
        let mut carriers: Vec<Carrier<C>> = Vec::with_capacity(model.len());
        for k in 0..model.len() {
            let joint = &model.joints()[k];
            let (parent, inboard) = match model.tree().parent(k) {
                Some(p) => (carriers[p].body, carriers[p].pose),
                None => (GROUND, Transform::identity()),
            };
            let frame = inboard.compose(&joint.placement.to_transform());
            let (q, v) = (model.q_offset(k), model.v_offset(k));
            let mut push = |parent: usize, hinge: Hinge<C>, placement: Transform<C>, first: usize| {
                bodies.push(LayoutBody {
                    parent,
                    hinge,
                    q: q + first,
                    v: v + first,
                    placement,
                    inertia: RigidInertia::zero(),
                });
                bodies.len() - 1
            };
            let along = |axis: [f64; 3]| rotation_from_z(Vec3::<C>::splat(axis));
            let (body, pose) = match joint.kind {
                JointKind::Fixed => (parent, frame),
                JointKind::Universal { axes: [first, second] } => {
                    let (a, b) = (along(first), along(second));
                    let between = push(parent, Hinge::Revolute, turn(&frame, &a), 0);
                    let placement = Transform::new(a.transpose() * b, Vec3::zero());
                    let body = push(between, Hinge::Revolute, placement, 1);
                    (body, Transform::new(b.transpose(), Vec3::zero()))
                }
                kind => {
                    let (hinge, turned) = hinge_of(&kind);
                    let body = push(parent, hinge, turn(&frame, &turned), 0);
                    (body, Transform::new(turned.transpose(), Vec3::zero()))
                }
            };
            let inertia = model.bodies()[k].inertia.to_rigid();
            if body != GROUND {
                bodies[body].inertia = bodies[body].inertia + pose.rigid_to_parent(&inertia);
            }
            carriers.push(Carrier { body, pose, inertia });
        }
        let joint_of_velocity = (0..model.nv())
            .map(|i| {
                let (k, component) = model.joint_of_velocity(i);
                (model.joints()[k].name.clone(), component)
            })
            .collect();
        let refused = model
            .refused_closure()
            .map(|c| DynamicsError::Closure { joint: c.joint.clone(), source: c.source.clone() });
        Layout {
            bodies,
            carriers,
            gravity: Vec3::splat(model.gravity()),
            nq: model.nq(),
            nv: model.nv(),
            joint_of_velocity,
            refused,
        }
    }
    /// Number of moving bodies.
    pub fn len(&self) -> usize {
        self.bodies.len()
    }
    /// True if nothing moves.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }
    /// Number of bodies of the model.
    pub fn model_bodies(&self) -> usize {
        self.carriers.len()
    }
    /// Number of position coordinates.
    pub fn nq(&self) -> usize {
        self.nq
    }
    /// Number of degrees of freedom.
    pub fn nv(&self) -> usize {
        self.nv
    }
    /// Gravity, world axes.
    pub fn gravity(&self) -> Vec3<C> {
        self.gravity
    }
    /// The same layout under another gravity.
    pub fn with_gravity(mut self, gravity: Vec3<C>) -> Self {
        self.gravity = gravity;
        self
    }
    /// The moving bodies, parents before children.
    pub fn bodies(&self) -> &[LayoutBody<C>] {
        &self.bodies
    }
    /// Where each body of the model lives.
    pub fn carriers(&self) -> &[Carrier<C>] {
        &self.carriers
    }
    /// Name of the joint and component of a degree of freedom.
    pub fn joint_of_velocity(&self, i: usize) -> (&str, usize) {
        let (name, component) = &self.joint_of_velocity[i];
        (name, *component)
    }
    /// The error of a hinge whose pivot failed.
    pub(crate) fn singular(&self, i: usize, inertia: f64) -> DynamicsError {
        let (joint, component) = self.joint_of_velocity[i].clone();
        DynamicsError::SingularHinge { joint, component, inertia }
    }
    /// Refuses models whose closures tree dynamics would ignore.
    pub(crate) fn check_tree(&self) -> Result<(), DynamicsError> {
        self.refused.clone().map_or(Ok(()), Err)
    }
    /// −= the user's external wrenches (one per body of the model, its frame), each at its carrier.
    #[inline(always)]
    pub(crate) fn subtract_wrenches<T: Scalar<Constant = C>>(
        &self,
        wrenches: Option<&[Wrench<T>]>,
        forces: &mut [Wrench<T>],
    ) {
        for (carrier, wrench) in self.carriers.iter().zip(wrenches.unwrap_or_default()) {
            if carrier.body != GROUND {
                forces[carrier.body] -= Transform::constant(&carrier.pose).wrench_to_parent(*wrench);
            }
        }
    }
}

fn turn<C: Scalar>(frame: &Transform<C>, rotation: &Mat3<C>) -> Transform<C> {
    Transform::new(frame.rotation * *rotation, frame.translation)
}

/// The hinge of a joint and the rotation of the layout's joint frame against the user's.
fn hinge_of<C: Real>(kind: &JointKind) -> (Hinge<C>, Mat3<C>) {
    let hinge = match *kind {
        JointKind::Revolute { .. } | JointKind::Continuous { .. } => Hinge::Revolute,
        JointKind::Prismatic { .. } => Hinge::Prismatic,
        JointKind::Helical { pitch, .. } => Hinge::Helical { pitch: C::splat(pitch) },
        JointKind::Cylindrical { .. } => Hinge::Cylindrical,
        JointKind::Planar { .. } => Hinge::Planar,
        JointKind::Translation => Hinge::Translation,
        JointKind::Spherical => Hinge::Spherical,
        _ => Hinge::Free,
    };
    let rotation = kind.axes().first().map_or(Mat3::identity(), |axis| rotation_from_z(Vec3::splat(*axis)));
    (hinge, rotation)
}
