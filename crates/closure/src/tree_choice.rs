//! A model on another spanning tree: closures that become joints, joints that become closures, so that loops overlap little.
//!
//! | symbol | meaning |
//! |---|---|
//! | A, B | frames of a joint or closure on its two bodies; a joint's are its placement and its child's frame |
//! | T(q) | pose of B in A; a joint that is turned round has T⁻¹, whose axes point the other way |
//!
//! Only what the user's words say is exchanged: joints with limits, damping or friction, couplings, fixed and floating joints
//! stay joints; rods and points on planes stay closures; models with flexible bodies keep their tree.

use crate::cut_joints::{Cost, CutChoice, GraphJoint, choose_cuts, cost_of};
use phipsi_model::joint::rotation_from_z;
use phipsi_model::{
    Body, Closure, ClosureKind, Inertia, Joint, JointKind, Limits, Model, ModelBuilder, ModelErrors,
    Placement,
};
use phipsi_spatial::{Mat3, Quaternion, Transform, Vec3};
use std::fmt;

/// What [`choose_tree`] made of a model.
#[derive(Clone, Debug)]
pub struct TreeChoice {
    /// The mechanism on its new tree; the given model if that costs no more.
    pub model: Model,
    /// What the given tree costs.
    pub given: Cost,
    /// What was found.
    pub found: CutChoice,
    /// Joints that are closures now.
    pub cut: Vec<String>,
    /// Closures that are joints now.
    pub joined: Vec<String>,
    /// Joints whose parent is their child now: coordinates are those of the inverse motion, axes point the other way.
    pub turned: Vec<String>,
}

impl TreeChoice {
    /// True if the model is on another tree than before.
    pub fn is_changed(&self) -> bool {
        !self.joined.is_empty()
    }
}

impl fmt::Display for TreeChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (given, found) = (self.given.nesting, self.found.cost.nesting);
        if self.model.is_flexible() {
            return write!(
                f,
                "the given tree, sum of squared open rows {given}: with flexible bodies it stays"
            );
        }
        if !self.is_changed() {
            return write!(f, "the given tree, sum of squared open rows {given}: no better one was found");
        }
        let list = |names: &[String]| if names.is_empty() { "none".to_string() } else { names.join(", ") };
        write!(
            f,
            "sum of squared open rows {found} instead of {given}; closures that became joints: {}; joints that became \
             closures: {}; joints turned round: {}",
            list(&self.joined),
            list(&self.cut),
            list(&self.turned)
        )
    }
}

/// Puts a model on the spanning tree on which its loops cost least.
///
/// `keep`: names of joints and closures that stay what they are. Joints with limits, damping, friction or a coupling stay joints
/// in any case. Coordinates of the new model are those of its own joints.
///
/// # Method
/// [`choose_cuts`] on the graph of joints and closures. A body on a joint that was a closure, or that is turned round, keeps its
/// frame: between the joint and the body there is a massless one on a fixed joint. A model with flexible bodies keeps its tree.
///
/// # Cost
/// As [`choose_cuts`]; once per model.
///
/// # Errors
/// [`ModelErrors`] if a name that a joint needs is taken.
///
/// # Example
/// ```
/// use phipsi_closure::choose_tree;
/// use phipsi_model::{Body, Closure, ClosureKind, Inertia, Joint, JointKind, ModelBuilder, Placement};
/// // Two rails of two pieces, a rung between each pair of pieces, hung on the left rail and closed to the right one.
/// let hinge = |name: String| {
///     Joint::new(name, JointKind::Continuous { axis: [0.0, 0.0, 1.0] })
///         .at(Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3]))
/// };
/// let rod = |name: String| Body::new(name, Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.1; 3]));
/// let mut builder = ModelBuilder::new("ladder");
/// for side in ["left", "right"] {
///     let mut parent = "world".to_string();
///     for i in 0..6 {
///         let name = format!("{side}{i}");
///         builder = builder.body(rod(name.clone())).joint(hinge(format!("{name} hinge")), parent, name.as_str());
///         parent = name;
///     }
/// }
/// for i in 0..6 {
///     let (rung, left, right) = (format!("rung{i}"), format!("left{i}"), format!("right{i}"));
///     builder = builder.body(rod(rung.clone())).joint(hinge(format!("{rung} hinge")), left, rung.as_str()).closure(Closure {
///         name: format!("pin{i}"),
///         kind: ClosureKind::Revolute,
///         body_a: rung,
///         pose_a: Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3]),
///         body_b: right,
///         pose_b: Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3]),
///     });
/// }
/// let choice = choose_tree(&builder.build()?, &[])?;
/// assert!(choice.found.cost.nesting < choice.given.nesting, "{choice}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn choose_tree(model: &Model, keep: &[&str]) -> Result<TreeChoice, ModelErrors> {
    let edges = edges(model, keep);
    let joints: Vec<GraphJoint> = edges.iter().map(|e| e.graph).collect();
    let given: Vec<bool> = (0..edges.len()).map(|j| j < model.len()).collect();
    let given = cost_of(model.len(), &joints, &given);
    let found = choose_cuts(model.len(), &joints);
    let unchanged = TreeChoice {
        model: model.clone(),
        given,
        found,
        cut: Vec::new(),
        joined: Vec::new(),
        turned: Vec::new(),
    };
    if model.is_flexible() || unchanged.found.cost.nesting >= given.nesting {
        return Ok(unchanged);
    }
    let found = unchanged.found;
    let name = |body: Option<usize>| body.map_or("world".into(), |k| model.bodies()[k].name.clone());
    let mut builder = ModelBuilder::new(model.name()).gravity(model.gravity());
    let (mut joined, mut turned) = (Vec::new(), Vec::new());
    for place in &found.tree {
        let Some(j) = place.joint else { continue };
        let edge = &edges[j];
        let back = edge.graph.bodies[0] != place.parent;
        let [inner, outer] = if back { [edge.frames[1], edge.frames[0]] } else { edge.frames };
        if back {
            turned.push(edge.name.clone());
        }
        if j >= model.len() {
            joined.push(edge.name.clone());
        }
        let kind = if back { inverse(edge.kind) } else { edge.kind };
        let given = edge.joint.clone().unwrap_or_else(|| Joint::new(edge.name.as_str(), kind));
        let joint = Joint { kind, ..given }.at(inner);
        let body = model.bodies()[place.body].clone();
        if outer == Placement::IDENTITY {
            builder = builder.joint(joint, name(place.parent), body.name.as_str()).body(body);
            continue;
        }
        let between = format!("{} frame", edge.name);
        let fixed = Joint::new(format!("{between} of {}", body.name), JointKind::Fixed);
        let outward = placement(&outer.to_transform().inverse());
        builder = builder
            .body(Body::new(between.as_str(), Inertia::ZERO))
            .joint(joint, name(place.parent), between.as_str())
            .joint(fixed.at(outward), between, body.name.as_str())
            .body(body);
    }
    let mut cut = Vec::new();
    for &j in &found.cuts {
        let Some(joint) = &edges[j].joint else {
            builder = builder.closure(model.closures()[j - model.len()].clone());
            continue;
        };
        cut.push(joint.name.clone());
        let Some((kind, turn)) = closure_of(&joint.kind) else { continue };
        let turn = Transform::new(turn, Vec3::zero());
        let [a, b] = edges[j].graph.bodies;
        builder = builder.closure(Closure {
            name: joint.name.clone(),
            kind,
            body_a: name(a),
            pose_a: placement(&joint.placement.to_transform().compose(&turn)),
            body_b: name(b),
            pose_b: placement(&turn),
        });
    }
    for coupling in model.couplings() {
        builder = builder.coupling(coupling.clone());
    }
    Ok(TreeChoice { model: builder.build()?, given, found, cut, joined, turned })
}

/// A joint or closure: its frames on the two bodies, and the motion between them.
struct Edge {
    name: String,
    graph: GraphJoint,
    kind: JointKind,
    frames: [Placement; 2],
    /// The user's joint, unless it is a closure.
    joint: Option<Joint>,
}

/// The joints of a model, body after body, then its closures.
fn edges(model: &Model, keep: &[&str]) -> Vec<Edge> {
    let coupled = |name: &str| model.couplings().iter().any(|c| c.joint == name || c.source == name);
    let joints = model.joints().iter().enumerate().map(|(k, joint)| {
        let plain = joint.limits == Limits::default() && joint.damping == 0.0 && joint.friction == 0.0;
        let free = plain && !coupled(&joint.name) && !keep.contains(&joint.name.as_str());
        let cut = if free && closure_of(&joint.kind).is_some() { None } else { Some(false) };
        let bodies = [model.tree().parent(k), Some(k)];
        Edge {
            name: joint.name.clone(),
            graph: GraphJoint { bodies, freedoms: joint.kind.nv(), cut },
            kind: joint.kind,
            frames: [joint.placement, Placement::IDENTITY],
            joint: Some(joint.clone()),
        }
    });
    let closures = model.closures().iter().map(|c| {
        // Names were checked when the model was built.
        let body = |name: &str| model.find_body(name).ok().flatten();
        let kind = joint_of(c.kind).filter(|_| !keep.contains(&c.name.as_str()));
        Edge {
            name: c.name.clone(),
            graph: GraphJoint {
                bodies: [body(&c.body_a), body(&c.body_b)],
                freedoms: 6 - c.kind.rows(),
                cut: if kind.is_some() { None } else { Some(true) },
            },
            kind: kind.unwrap_or(JointKind::Fixed),
            frames: [c.pose_a, c.pose_b],
            joint: None,
        }
    });
    joints.chain(closures).collect()
}

/// The closure that keeps what a joint keeps, and the axes of its frames in the joint's.
fn closure_of(kind: &JointKind) -> Option<(ClosureKind, Mat3<f64>)> {
    let along = |axis: &[f64; 3]| rotation_from_z(Vec3(*axis));
    Some(match kind {
        JointKind::Revolute { axis } | JointKind::Continuous { axis } => (ClosureKind::Revolute, along(axis)),
        JointKind::Prismatic { axis } => (ClosureKind::Prismatic, along(axis)),
        JointKind::Cylindrical { axis } => (ClosureKind::Cylindrical, along(axis)),
        JointKind::Planar { normal } => (ClosureKind::Planar, along(normal)),
        JointKind::Spherical => (ClosureKind::Spherical, Mat3::identity()),
        _ => return None,
    })
}

/// The joint that leaves what a closure leaves.
fn joint_of(kind: ClosureKind) -> Option<JointKind> {
    let z = [0.0, 0.0, 1.0];
    Some(match kind {
        ClosureKind::Weld => JointKind::Fixed,
        ClosureKind::Revolute => JointKind::Continuous { axis: z },
        ClosureKind::Prismatic => JointKind::Prismatic { axis: z },
        ClosureKind::Cylindrical => JointKind::Cylindrical { axis: z },
        ClosureKind::Planar => JointKind::Planar { normal: z },
        ClosureKind::Universal => JointKind::Universal { axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] },
        ClosureKind::Spherical => JointKind::Spherical,
        _ => return None,
    })
}

/// The kind of T⁻¹; the motions of planes, balls, translations and free joints are their own inverses' kind.
fn inverse(kind: JointKind) -> JointKind {
    let back = |axis: [f64; 3]| axis.map(|x| -x);
    match kind {
        JointKind::Revolute { axis } => JointKind::Revolute { axis: back(axis) },
        JointKind::Continuous { axis } => JointKind::Continuous { axis: back(axis) },
        JointKind::Prismatic { axis } => JointKind::Prismatic { axis: back(axis) },
        JointKind::Helical { axis, pitch } => JointKind::Helical { axis: back(axis), pitch },
        JointKind::Cylindrical { axis } => JointKind::Cylindrical { axis: back(axis) },
        JointKind::Universal { axes: [a, b] } => JointKind::Universal { axes: [back(b), back(a)] },
        same => same,
    }
}

fn placement(pose: &Transform<f64>) -> Placement {
    Placement { translation: pose.translation.0, rotation: Quaternion::from_rotation(&pose.rotation).0 }
}
