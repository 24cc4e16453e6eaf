//! The immutable model: a tree of bodies with names, inertias and joints.

use crate::flexible::{FlexibleBody, Node};
use crate::violation::{ModelErrors, Subject, Violation};
use crate::{Closure, Joint, JointKind, ModelBuilder, Placement};
use phipsi_spatial::{Quaternion, Real, RigidInertia, Sym3, Vec3};
use phipsi_topology::Tree;
use std::collections::HashMap;
use std::fmt;

/// Mass properties as the user gave them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    /// Mass, kg.
    pub mass: f64,
    /// Pose of the inertial frame in the body frame; its origin is the centre of mass.
    pub frame: Placement,
    /// Moments about the centre of mass in the inertial frame: xx, xy, xz, yy, yz, zz, kg·m².
    pub tensor: [f64; 6],
}

impl Inertia {
    /// No mass.
    pub const ZERO: Inertia = Inertia { mass: 0.0, frame: Placement::IDENTITY, tensor: [0.0; 6] };

    /// Mass, centre of mass (m) and principal moments (kg·m²) along the body's axes.
    pub fn from_principal(mass: f64, center: [f64; 3], moments: [f64; 3]) -> Self {
        let frame = Placement { translation: center, ..Placement::IDENTITY };
        Inertia { mass, frame, tensor: [moments[0], 0.0, 0.0, moments[1], 0.0, moments[2]] }
    }
    /// The spatial inertia about the body frame's origin, in body axes.
    pub fn to_rigid<T: Real>(&self) -> RigidInertia<T> {
        let [xx, xy, xz, yy, yz, zz] = self.tensor.map(T::splat);
        let rotation = Quaternion(self.frame.rotation.map(T::splat)).to_rotation();
        let about_center = Sym3 { xx, xy, xz, yy, yz, zz }.rotate(&rotation);
        RigidInertia::from_center_of_mass(
            T::splat(self.mass),
            Vec3::splat(self.frame.translation),
            about_center,
        )
    }
    /// True if mass and moments are exactly zero.
    pub fn is_zero(&self) -> bool {
        self.mass == 0.0 && self.tensor == [0.0; 6]
    }
}

/// A body: rigid, or with modal coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// The user's name.
    pub name: String,
    /// Its mass properties; of a flexible body where nothing is deformed.
    pub inertia: Inertia,
    /// Its modes, if it is flexible.
    pub flexible: Option<FlexibleBody>,
    /// An axis through its origin about which it does not turn: see [`Model::still_axes`].
    pub still_axis: Option<[f64; 3]>,
}

impl Body {
    /// A named rigid body.
    pub fn new(name: impl Into<String>, inertia: Inertia) -> Self {
        Body { name: name.into(), inertia, flexible: None, still_axis: None }
    }
    /// A named flexible body.
    pub fn flexible(name: impl Into<String>, flexible: FlexibleBody) -> Self {
        let inertia = flexible.integrals.undeformed();
        Body { name: name.into(), inertia, flexible: Some(flexible), still_axis: None }
    }
    /// Number of modal coordinates.
    pub fn modes(&self) -> usize {
        self.flexible.as_ref().map_or(0, FlexibleBody::modes)
    }
}

/// A gear or URDF `mimic`: q(joint) = multiplier · q(source) + offset, a closure between two joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Coupling {
    /// The following joint.
    pub joint: String,
    /// The joint it follows.
    pub source: String,
    /// Ratio.
    pub multiplier: f64,
    /// Offset, rad or m.
    pub offset: f64,
}

/// A name that the model does not have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NameError {
    /// What was looked for: "body" or "joint".
    pub what: &'static str,
    /// The unknown name.
    pub name: String,
    /// The names there are (the first twenty).
    pub known: Vec<String>,
}

impl fmt::Display for NameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no {} is called `{}`; there are: {}", self.what, self.name, self.known.join(", "))
    }
}

impl std::error::Error for NameError {}

/// A multibody model: what the mechanism is. Made by [`crate::ModelBuilder`]; immutable.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    pub(crate) name: String,
    pub(crate) bodies: Vec<Body>,
    pub(crate) joints: Vec<Joint>,
    pub(crate) tree: Tree,
    pub(crate) q_offsets: Vec<usize>,
    pub(crate) v_offsets: Vec<usize>,
    /// First modal coordinate of every body, counted from the first of all, and their number.
    pub(crate) mode_offsets: Vec<usize>,
    /// The node of the parent that each joint is on.
    pub(crate) nodes: Vec<Option<usize>>,
    pub(crate) gravity: [f64; 3],
    pub(crate) couplings: Vec<Coupling>,
    pub(crate) closures: Vec<Closure>,
    pub(crate) body_index: HashMap<String, usize>,
    pub(crate) joint_index: HashMap<String, usize>,
}

impl Model {
    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// Number of bodies, the world not counted, fused ones included.
    pub fn len(&self) -> usize {
        self.bodies.len()
    }
    /// True if there is no body.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty()
    }
    /// Number of position coordinates: of all joints, then the modal coordinates of flexible bodies, body after body.
    pub fn nq(&self) -> usize {
        self.joint_nq() + self.modes()
    }
    /// Number of degrees of freedom, in the same order.
    pub fn nv(&self) -> usize {
        self.joint_nv() + self.modes()
    }
    /// Number of position coordinates of the joints.
    pub fn joint_nq(&self) -> usize {
        *self.q_offsets.last().expect("offsets have one entry more than bodies")
    }
    /// Number of degrees of freedom of the joints.
    pub fn joint_nv(&self) -> usize {
        *self.v_offsets.last().expect("offsets have one entry more than bodies")
    }
    /// Number of modal coordinates of all bodies.
    pub fn modes(&self) -> usize {
        *self.mode_offsets.last().expect("offsets have one entry more than bodies")
    }
    /// True if some body has modal coordinates.
    pub fn is_flexible(&self) -> bool {
        self.modes() > 0
    }
    /// Modal coordinates of body k in q.
    pub fn mode_q_range(&self, k: usize) -> std::ops::Range<usize> {
        self.joint_nq() + self.mode_offsets[k]..self.joint_nq() + self.mode_offsets[k + 1]
    }
    /// Modal coordinates of body k in v.
    pub fn mode_v_range(&self, k: usize) -> std::ops::Range<usize> {
        self.joint_nv() + self.mode_offsets[k]..self.joint_nv() + self.mode_offsets[k + 1]
    }
    /// Names of the modal coordinates, in their order: `BODY.mode1` …
    pub fn mode_names(&self) -> impl Iterator<Item = String> + '_ {
        self.bodies.iter().flat_map(|body| (1..=body.modes()).map(|l| format!("{}.mode{l}", body.name)))
    }
    /// Index, among the nodes of its parent, of the node that joint k is on; `None`: it is placed in the parent's frame.
    pub fn node_of_joint(&self, k: usize) -> Option<usize> {
        self.nodes[k]
    }
    /// That node.
    pub fn attachment(&self, k: usize) -> Option<&Node> {
        let parent = &self.bodies[self.tree.parent(k)?];
        parent.flexible.as_ref()?.nodes.get(self.nodes[k]?)
    }
    /// Bodies, parents before children.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }
    /// Joints; joint k carries body k.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }
    /// The tree of bodies; roots hang on the world.
    pub fn tree(&self) -> &Tree {
        &self.tree
    }
    /// Gravity, m/s², world axes.
    pub fn gravity(&self) -> [f64; 3] {
        self.gravity
    }
    /// The same model under another gravity.
    pub fn with_gravity(mut self, gravity: [f64; 3]) -> Self {
        self.gravity = gravity;
        self
    }
    /// Couplings between joints (`mimic`).
    pub fn couplings(&self) -> &[Coupling] {
        &self.couplings
    }
    /// Closures between two frames.
    pub fn closures(&self) -> &[Closure] {
        &self.closures
    }
    /// The same model with one more closure.
    ///
    /// # Errors
    /// [`ModelErrors`] if it names no body of the model, has numbers that make no sense, or a name that is taken.
    pub fn with_closure(mut self, closure: Closure) -> Result<Self, ModelErrors> {
        let mut found = Vec::new();
        if self.closures.iter().any(|c| c.name == closure.name) {
            let subject = Subject::Closure(closure.name.clone());
            let remedy = "rename one of the closures";
            found.push(Violation::error(subject, "name given twice", "different names", remedy));
        }
        let bodies = self.body_index.keys().map(|name| (name.as_str(), ())).collect();
        closure.check::<()>(&bodies, &mut found);
        if !found.is_empty() {
            return Err(ModelErrors(found));
        }
        self.closures.push(closure);
        Ok(self)
    }
    /// A builder that holds this model, to build another one from it. Bodies and joints in the model's order.
    pub fn to_builder(&self) -> ModelBuilder {
        let mut builder = ModelBuilder::new(self.name.clone()).gravity(self.gravity);
        for (k, body) in self.bodies.iter().enumerate() {
            let parent = self.tree.parent(k).map_or("world", |p| self.bodies[p].name.as_str());
            let joint = self.joints[k].clone();
            builder = match self.attachment(k) {
                Some(node) => builder.joint_at_node(joint, parent, node.name.clone(), body.name.clone()),
                None => builder.joint(joint, parent, body.name.clone()),
            };
            builder = builder.body(body.clone());
        }
        let with_couplings = self.couplings.iter().fold(builder, |b, c| b.coupling(c.clone()));
        self.closures.iter().fold(with_couplings, |b, c| b.closure(c.clone()))
    }
    /// The same model with a flexible body in place of the body of this name: `nodes` says, by joint, at which of its nodes the
    /// joints outboard of it are; others stay where they are in its frame.
    ///
    /// # Errors
    /// [`ModelErrors`], as [`ModelBuilder::build`]; a body or joint that does not exist.
    pub fn with_flexible_body(
        &self,
        name: &str,
        body: FlexibleBody,
        nodes: &[(String, String)],
    ) -> Result<Model, ModelErrors> {
        let unknown = |subject: Subject, e: NameError| {
            let required = format!("one of {}", e.known.join(", "));
            ModelErrors(vec![Violation::error(subject, e.to_string(), required, "correct the name")])
        };
        let subject = || Subject::Body(name.into());
        let Some(k) = self.find_body(name).map_err(|e| unknown(subject(), e))? else {
            let remedy = "name a body of the model";
            return Err(ModelErrors(vec![Violation::error(subject(), "the world", "a body", remedy)]));
        };
        let mut attached = HashMap::new();
        for (joint, node) in nodes {
            let j = self.find_joint(joint).map_err(|e| unknown(Subject::Joint(joint.clone()), e))?;
            attached.insert(j, node.clone());
        }
        let mut copy = self.clone();
        copy.bodies[k] = Body::flexible(name, body);
        for j in (0..copy.len()).filter(|&j| copy.tree.parent(j) == Some(k)) {
            copy.nodes[j] = None;
        }
        copy.to_builder()
            .with_nodes(attached.into_iter().map(|(j, node)| (self.joints[j].name.clone(), node)))
            .build()
    }
    /// The same model whose flexible bodies have neither stiffness nor damping: what an impulse meets.
    pub fn without_stiffness(mut self) -> Self {
        for flexible in self.bodies.iter_mut().filter_map(|b| b.flexible.as_mut()) {
            flexible.stiffness.fill(0.0);
            flexible.damping.fill(0.0);
        }
        self
    }
    /// The tree alone: the same model without closures and couplings.
    pub fn without_closures(mut self) -> Self {
        self.closures.clear();
        self.couplings.clear();
        self
    }
    /// First position coordinate of joint k.
    pub fn q_offset(&self, k: usize) -> usize {
        self.q_offsets[k]
    }
    /// First degree of freedom of joint k.
    pub fn v_offset(&self, k: usize) -> usize {
        self.v_offsets[k]
    }
    /// Position coordinates of joint k.
    pub fn q_range(&self, k: usize) -> std::ops::Range<usize> {
        self.q_offsets[k]..self.q_offsets[k + 1]
    }
    /// Degrees of freedom of joint k.
    pub fn v_range(&self, k: usize) -> std::ops::Range<usize> {
        self.v_offsets[k]..self.v_offsets[k + 1]
    }
    /// Indices of the joints that move, in the order of v.
    pub fn moving_joints(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.len()).filter(|&k| self.joints[k].kind != JointKind::Fixed)
    }
    /// Index of a body by name; `None` for `world`, the inertial frame.
    ///
    /// # Errors
    /// [`NameError`] with the names there are.
    pub fn find_body(&self, name: &str) -> Result<Option<usize>, NameError> {
        if let Some(&k) = self.body_index.get(name) {
            return Ok(Some(k));
        }
        if name == "world" {
            return Ok(None);
        }
        let known = self.bodies.iter().take(20).map(|b| b.name.clone()).collect();
        Err(NameError { what: "body", name: name.into(), known })
    }
    /// Index of a joint by name.
    ///
    /// # Errors
    /// [`NameError`] with the names there are.
    pub fn find_joint(&self, name: &str) -> Result<usize, NameError> {
        self.joint_index.get(name).copied().ok_or_else(|| {
            let known = self.moving_joints().take(20).map(|k| self.joints[k].name.clone()).collect();
            NameError { what: "joint", name: name.into(), known }
        })
    }
    /// Total mass, kg.
    pub fn total_mass(&self) -> f64 {
        self.bodies.iter().map(|b| b.inertia.mass).sum()
    }
    /// The joint and component that a degree of freedom belongs to. The modes of body k are components of joint k, after those
    /// of the joint itself.
    pub fn joint_of_velocity(&self, i: usize) -> (usize, usize) {
        if i >= self.joint_nv() {
            let mode = i - self.joint_nv();
            let k = self.mode_offsets.partition_point(|&o| o <= mode) - 1;
            return (k, self.joints[k].kind.nv() + mode - self.mode_offsets[k]);
        }
        let k = self.v_offsets.partition_point(|&o| o <= i) - 1;
        (k, i - self.v_offsets[k])
    }
    /// The coupling for which tree dynamics refuses the model, if it has couplings.
    pub fn refused_closure(&self) -> Option<&Coupling> {
        self.couplings.first()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Beam, Closure, ClosureKind, Section};

    fn rod(name: &str) -> Body {
        Body::new(name, Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.1; 3]))
    }

    fn arm() -> Model {
        let hinge = |name: &str| Joint::new(name, JointKind::Revolute { axis: [0.0, 1.0, 0.0] });
        let (pose_a, pose_b) = (Placement::IDENTITY, Placement::IDENTITY);
        let (body_a, body_b) = ("hand".into(), "world".into());
        ModelBuilder::new("arm")
            .gravity([0.0, 1.0, 2.0])
            .body(rod("upper"))
            .body(rod("lower"))
            .body(rod("hand"))
            .joint(hinge("shoulder"), "world", "upper")
            .joint(hinge("elbow"), "upper", "lower")
            .joint(hinge("wrist"), "lower", "hand")
            .coupling(Coupling {
                joint: "elbow".into(),
                source: "wrist".into(),
                multiplier: 2.0,
                offset: 0.1,
            })
            .closure(Closure {
                name: "pin".into(),
                kind: ClosureKind::Spherical,
                body_a,
                pose_a,
                body_b,
                pose_b,
            })
            .build()
            .unwrap()
    }

    #[test]
    fn a_model_is_built_again_from_its_builder() {
        let section = Section {
            mass_per_length: 1.0,
            bending_stiffness: [3.0, 2.0],
            torsional_stiffness: 1.0,
            polar_inertia: 0.01,
            axial_stiffness: 1e3,
        };
        let (model, beam) = (arm(), Beam::new(1.0, section).bending([1, 1]).build());
        assert_eq!(model.to_builder().build().unwrap(), model);
        let at_tip = [("wrist".to_string(), "tip".to_string())];
        let flexible = model.with_flexible_body("lower", beam.clone(), &at_tip).unwrap();
        assert_eq!((flexible.nv(), flexible.modes()), (3 + 6, 6));
        assert_eq!(flexible.attachment(flexible.find_joint("wrist").unwrap()).unwrap().name, "tip");
        assert_eq!(flexible.closures(), model.closures());
        assert_eq!(flexible.to_builder().build().unwrap(), flexible);
        // A second time without nodes: the wrist is in the frame again.
        let again = flexible.with_flexible_body("lower", beam.clone(), &[]).unwrap();
        assert!(again.attachment(2).is_none());
        let said = |name: &str, joint: &str, node: &str| {
            let nodes = [(joint.to_string(), node.to_string())];
            model.with_flexible_body(name, beam.clone(), &nodes).unwrap_err().to_string()
        };
        assert!(said("arm", "wrist", "tip").contains("no body is called `arm`"));
        assert!(said("world", "wrist", "tip").contains("the world"));
        assert!(said("lower", "wrst", "tip").contains("no joint is called `wrst`"));
        assert!(said("lower", "wrist", "end").contains("no node `end`"));
    }
}
