//! From bodies and joints with names to a validated [`Model`].

use crate::flexible::{FlexibleBody, check_flexible};
use crate::model::{Body, Coupling, Model};
use crate::nearest_inertia::{as_attributes, nearest_inertia};
use crate::still_axis::check_still_axis;
use crate::violation::{ModelErrors, Severity, Subject, Violation};
use crate::{Closure, Inertia, Joint, JointKind};
use nalgebra::Matrix3;
use phipsi_topology::{Edge, Tree, spanning_tree};
use std::collections::HashMap;

/// Largest magnitude of a mass, length or moment: its products with others stay far from overflow.
pub(crate) const LARGEST: f64 = 1e60;

/// Standard gravity, m/s².
pub const STANDARD_GRAVITY: [f64; 3] = [0.0, 0.0, -9.80665];

/// How the root body hangs on the world when no joint of the user's says so.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Base {
    /// Welded to the world.
    #[default]
    Fixed,
    /// Free, by a joint named after the root body.
    Free,
}

/// Collects bodies and joints and builds a [`Model`].
///
/// Joints name their parent and child; a parent `world` is the inertial frame. A body that is nobody's child is the
/// root and hangs on the world by `base`. A root body that is itself called `world` *is* the inertial frame.
#[derive(Clone, Debug, Default)]
pub struct ModelBuilder {
    name: String,
    bodies: Vec<Body>,
    joints: Vec<(Joint, String, String)>,
    /// Nodes of parents, by the name of the joint that is on them.
    nodes: HashMap<String, String>,
    couplings: Vec<Coupling>,
    closures: Vec<Closure>,
    gravity: Option<[f64; 3]>,
    base: Base,
}

impl ModelBuilder {
    /// An empty model.
    pub fn new(name: impl Into<String>) -> Self {
        ModelBuilder { name: name.into(), ..Default::default() }
    }
    /// Adds a body.
    pub fn body(mut self, body: Body) -> Self {
        self.bodies.push(body);
        self
    }
    /// Adds a joint between two bodies, by their names.
    pub fn joint(mut self, joint: Joint, parent: impl Into<String>, child: impl Into<String>) -> Self {
        self.joints.push((joint, parent.into(), child.into()));
        self
    }
    /// Adds a joint at a node of a flexible parent: its placement is in the node's frame.
    pub fn joint_at_node(
        mut self,
        joint: Joint,
        parent: impl Into<String>,
        node: impl Into<String>,
        child: impl Into<String>,
    ) -> Self {
        self.nodes.insert(joint.name.clone(), node.into());
        self.joint(joint, parent, child)
    }
    /// Puts joints at nodes of their flexible parents.
    pub(crate) fn with_nodes(mut self, nodes: impl IntoIterator<Item = (String, String)>) -> Self {
        self.nodes.extend(nodes);
        self
    }
    /// Adds a coupling between two joints (URDF `mimic`).
    pub fn coupling(mut self, coupling: Coupling) -> Self {
        self.couplings.push(coupling);
        self
    }
    /// Adds a closure between two bodies, or a body and the world.
    pub fn closure(mut self, closure: Closure) -> Self {
        self.closures.push(closure);
        self
    }
    /// Sets gravity, m/s², world axes; [`STANDARD_GRAVITY`] otherwise.
    pub fn gravity(mut self, gravity: [f64; 3]) -> Self {
        self.gravity = Some(gravity);
        self
    }
    /// How the root body hangs on the world.
    pub fn base(mut self, base: Base) -> Self {
        self.base = base;
        self
    }
    /// Every violated condition, errors and warnings, in the order of the input.
    pub fn check(&self) -> Vec<Violation> {
        let mut found = Vec::new();
        for body in &self.bodies {
            match &body.flexible {
                None => check_inertia(body, &mut found),
                Some(flexible) => check_flexible(&body.name, flexible, &mut found),
            }
        }
        for (joint, _, _) in &self.joints {
            check_joint(joint, &mut found);
        }
        for body in self.bodies.iter().filter(|b| b.still_axis.is_some()) {
            let is_free = match self.joints.iter().find(|(_, _, child)| *child == body.name) {
                Some((joint, parent, _)) => joint.kind == JointKind::Free && parent == "world",
                None => self.base == Base::Free,
            };
            let is_alone = is_free && !self.joints.iter().any(|(_, parent, _)| *parent == body.name);
            check_still_axis(body, is_alone, &mut found);
        }
        self.check_structure(&mut found);
        if self.gravity.is_some_and(|g| g.iter().any(|x| !is_sane(*x))) {
            found.push(Violation::error(
                Subject::Model,
                format!("gravity {:?}", self.gravity.unwrap_or_default()),
                "three finite numbers",
                "give gravity as [x, y, z] in m/s²",
            ));
        }
        found
    }
    /// The model.
    ///
    /// # Errors
    /// [`ModelErrors`] with every violated condition that is an error; never stops at the first.
    pub fn build(self) -> Result<Model, ModelErrors> {
        let mut errors = self.check();
        errors.retain(|v| v.severity == Severity::Error);
        if !errors.is_empty() {
            return Err(ModelErrors(errors));
        }
        Ok(self.assemble())
    }

    /// Index of a body by name; the inertial frame is `None`.
    fn indices(&self) -> HashMap<&str, usize> {
        self.bodies.iter().enumerate().map(|(i, b)| (b.name.as_str(), i)).collect()
    }

    fn check_structure(&self, found: &mut Vec<Violation>) {
        let before = found.len();
        let error = |subject, what: String, required: &str, remedy: &str| {
            Violation::error(subject, what, required, remedy)
        };
        if self.bodies.is_empty() {
            found.push(error(Subject::Model, "no body".into(), "at least one body", "add a link"));
            return;
        }
        let mut seen = HashMap::new();
        for body in &self.bodies {
            if seen.insert(body.name.as_str(), ()).is_some() {
                let subject = Subject::Body(body.name.clone());
                found.push(error(
                    subject,
                    "name given twice".into(),
                    "different names",
                    "rename one of the bodies",
                ));
            }
        }
        let mut seen_joints: HashMap<&str, ()> = HashMap::new();
        let indices = self.indices();
        let mut inboard: Vec<Option<&str>> = vec![None; self.bodies.len()];
        for (joint, parent, child) in &self.joints {
            let subject = || Subject::Joint(joint.name.clone());
            if seen_joints.insert(&joint.name, ()).is_some() {
                found.push(error(
                    subject(),
                    "name given twice".into(),
                    "different names",
                    "rename one of the joints",
                ));
            }
            if !indices.contains_key(parent.as_str()) && parent != "world" {
                let what = format!("parent `{parent}` does not exist");
                found.push(error(
                    subject(),
                    what,
                    "the name of a body or `world`",
                    "add the body or correct the name",
                ));
            }
            if let Some(node) = self.nodes.get(&joint.name) {
                self.check_node(subject(), parent, node, found);
            }
            match indices.get(child.as_str()) {
                None => {
                    let what = format!("child `{child}` does not exist");
                    found.push(error(
                        subject(),
                        what,
                        "the name of a body",
                        "add the body or correct the name",
                    ));
                }
                Some(&c) => {
                    if let Some(first) = inboard[c] {
                        let what = format!("body `{child}` is also the child of joint `{first}`");
                        let remedy = "make one of the joints a closure of the loop";
                        found.push(error(subject(), what, "one inboard joint per body", remedy));
                    } else {
                        inboard[c] = Some(&joint.name);
                    }
                    if child == "world" {
                        let remedy = "turn the joint round, or rename the body";
                        found.push(error(
                            subject(),
                            "child is the world".into(),
                            "the world is nobody's child",
                            remedy,
                        ));
                    }
                }
            }
        }
        for coupling in &self.couplings {
            let subject = Subject::Joint(coupling.joint.clone());
            for name in [&coupling.joint, &coupling.source] {
                if !seen_joints.contains_key(name.as_str()) {
                    let what = format!("mimics joint `{name}`, which does not exist");
                    found.push(error(subject.clone(), what, "the name of a joint", "correct the name"));
                }
            }
            if coupling.joint == coupling.source {
                found.push(error(
                    subject,
                    "mimics itself".into(),
                    "another joint",
                    "name the joint it follows",
                ));
            }
        }
        let mut seen_closures: HashMap<&str, ()> = HashMap::new();
        for closure in &self.closures {
            if seen_closures.insert(&closure.name, ()).is_some() {
                let subject = Subject::Closure(closure.name.clone());
                found.push(error(
                    subject,
                    "name given twice".into(),
                    "different names",
                    "rename one of the closures",
                ));
            }
            closure.check(&indices, found);
        }
        // Numbers that are wrong do not keep the tree from being looked at; missing or doubled names do.
        if found[before..].iter().any(|v| v.severity == Severity::Error) {
            return;
        }
        let roots: Vec<usize> = (0..self.bodies.len()).filter(|&i| inboard[i].is_none()).collect();
        if roots.len() > 1 {
            let names: Vec<&str> = roots.iter().take(5).map(|&i| self.bodies[i].name.as_str()).collect();
            let more = if roots.len() > names.len() { ", …" } else { "" };
            let what = format!("{} bodies without an inboard joint: {}{more}", roots.len(), names.join(", "));
            found.push(error(
                Subject::Model,
                what,
                "one root",
                "connect them with joints, to `world` if they are separate",
            ));
        }
        let tree = spanning_tree(self.bodies.len(), &self.edges(&roots));
        if let Some(&k) = tree.unreached.first() {
            let subject = Subject::Body(self.bodies[k].name.clone());
            let what = format!("{} bodies hang in a cycle, this one among them", tree.unreached.len());
            found.push(error(
                subject,
                what,
                "a tree from the root",
                "remove a joint of the cycle, or make it a closure",
            ));
        }
        if let Some(body) = self.bodies.iter().find(|b| b.name == "world" && b.flexible.is_some()) {
            let subject = Subject::Body(body.name.clone());
            let remedy = "rename the body and hang it on the world by a joint";
            found.push(error(
                subject,
                "the world is flexible".into(),
                "`world` is the inertial frame",
                remedy,
            ));
        }
        if self.base == Base::Free && roots.first().is_some_and(|&r| self.bodies[r].name == "world") {
            let subject = Subject::Body("world".into());
            let remedy =
                "use base = \"fixed\" (its child's floating joint makes a free base), or rename the body";
            found.push(error(
                subject,
                "a free base called `world`".into(),
                "`world` is the inertial frame",
                remedy,
            ));
        }
    }

    /// A joint's node must be one of its parent's.
    fn check_node(&self, subject: Subject, parent: &str, node: &str, found: &mut Vec<Violation>) {
        let Some(body) = self.bodies.iter().find(|body| body.name == parent) else {
            if parent == "world" {
                let what = format!("node `{node}` of the world");
                found.push(Violation::error(
                    subject,
                    what,
                    "a flexible parent",
                    "place the joint without a node",
                ));
            }
            return;
        };
        let Some(flexible) = &body.flexible else {
            let what = format!("node `{node}` of body `{parent}`, which is rigid");
            found.push(Violation::error(
                subject,
                what,
                "a flexible parent",
                "place the joint without a node",
            ));
            return;
        };
        if flexible.find_node(node).is_none() {
            let names: Vec<&str> = flexible.nodes.iter().take(20).map(|n| n.name.as_str()).collect();
            let what = format!("body `{parent}` has no node `{node}`; nodes: {}", names.join(", "));
            found.push(Violation::error(subject, what, "the name of a node", "correct the name"));
        }
    }

    /// The user's joints, then a joint from the ground to each root.
    fn edges(&self, roots: &[usize]) -> Vec<Edge> {
        let indices = self.indices();
        let user = self.joints.iter().map(|(_, parent, child)| Edge {
            parent: indices.get(parent.as_str()).copied(),
            child: indices[child.as_str()],
        });
        user.chain(roots.iter().map(|&child| Edge { parent: None, child })).collect()
    }

    /// Builds what [`check`](Self::check) has passed.
    fn assemble(self) -> Model {
        let mut is_child = vec![false; self.bodies.len()];
        let indices = self.indices();
        for (_, _, child) in &self.joints {
            is_child[indices[child.as_str()]] = true;
        }
        let roots: Vec<usize> = (0..self.bodies.len()).filter(|&i| !is_child[i]).collect();
        let edges = self.edges(&roots);
        let order = spanning_tree(self.bodies.len(), &edges).order;
        // A massive or massless root body called `world` is the inertial frame: it is not a body of the model.
        let world = roots.iter().copied().find(|&r| self.bodies[r].name == "world");
        let mut position = vec![None; self.bodies.len()];
        let (mut bodies, mut joints, mut parents) = (Vec::new(), Vec::new(), Vec::new());
        let (mut q_offsets, mut v_offsets) = (vec![0], vec![0]);
        let (mut mode_offsets, mut nodes) = (vec![0], Vec::new());
        for step in order {
            if Some(step.node) == world {
                continue;
            }
            position[step.node] = Some(bodies.len());
            let body = self.bodies[step.node].clone();
            let joint = match self.joints.get(step.edge) {
                Some((joint, _, _)) => joint.clone(),
                None => {
                    let kind = if self.base == Base::Free { JointKind::Free } else { JointKind::Fixed };
                    Joint::new(body.name.clone(), kind)
                }
            };
            parents.push(edges[step.edge].parent.and_then(|p| position[p]));
            q_offsets.push(q_offsets[q_offsets.len() - 1] + joint.kind.nq());
            v_offsets.push(v_offsets[v_offsets.len() - 1] + joint.kind.nv());
            mode_offsets.push(mode_offsets[mode_offsets.len() - 1] + body.modes());
            let flexible: Option<&FlexibleBody> =
                edges[step.edge].parent.and_then(|p| self.bodies[p].flexible.as_ref());
            let named = self.nodes.get(&joint.name).filter(|_| step.edge < self.joints.len());
            nodes.push(named.and_then(|name| flexible?.find_node(name)));
            bodies.push(body);
            joints.push(joint);
        }
        let body_index =
            bodies.iter().enumerate().map(|(i, b): (usize, &Body)| (b.name.clone(), i)).collect();
        let joint_index =
            joints.iter().enumerate().map(|(i, j): (usize, &Joint)| (j.name.clone(), i)).collect();
        Model {
            name: self.name,
            bodies,
            joints,
            tree: Tree::new(parents).expect("depth-first order puts parents first"),
            q_offsets,
            v_offsets,
            mode_offsets,
            nodes,
            gravity: self.gravity.unwrap_or(STANDARD_GRAVITY),
            couplings: self.couplings,
            closures: self.closures,
            body_index,
            joint_index,
        }
    }
}

pub(crate) fn is_sane(x: f64) -> bool {
    x.is_finite() && x.abs() <= LARGEST
}

fn check_inertia(body: &Body, found: &mut Vec<Violation>) {
    let Inertia { mass, frame, tensor } = body.inertia;
    let subject = || Subject::Body(body.name.clone());
    let range = format!("finite numbers of magnitude at most {LARGEST:e}");
    for (what, values) in [
        ("mass", vec![mass]),
        ("centre of mass", frame.translation.to_vec()),
        ("inertial frame's quaternion", frame.rotation.to_vec()),
        ("inertia", tensor.to_vec()),
    ] {
        if values.iter().any(|x| !is_sane(*x)) {
            let remedy = "correct the number (units: kg, m, kg·m²)";
            found.push(Violation::error(subject(), format!("{what} {values:?}"), &range, remedy));
            return;
        }
    }
    if frame.rotation == [0.0; 4] {
        let what = "inertial frame's quaternion is zero";
        found.push(Violation::error(subject(), what, "a rotation", "use (0, 0, 0, 1)"));
    }
    if mass < 0.0 {
        let remedy = "give a positive mass, or 0 for a massless frame";
        found.push(Violation::error(subject(), format!("mass {mass:e} kg"), "mass ≥ 0", remedy));
        return;
    }
    let [xx, xy, xz, yy, yz, zz] = tensor;
    let moments = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).symmetric_eigenvalues();
    let mut moments = [moments[0], moments[1], moments[2]];
    moments.sort_by(f64::total_cmp);
    let [small, middle, large] = moments;
    // Printed inertias carry about six digits, so a principal moment may come out slightly negative.
    let slack = 1e-6 * large.abs();
    if mass == 0.0 && tensor != [0.0; 6] {
        let what = format!("no mass but principal moments {small:.6e}, {middle:.6e}, {large:.6e} kg·m²");
        let remedy = "give the body its mass, or remove the inertia";
        found.push(Violation::error(subject(), what, "mass > 0 where there is inertia", remedy).as_warning());
    }
    if small < -slack {
        let what = format!("principal moments {small:.6e}, {middle:.6e}, {large:.6e} kg·m²");
        let remedy = with_nearest("check the signs and the axes of the inertial frame", tensor);
        found.push(Violation::error(subject(), what, "all principal moments ≥ 0", remedy));
    } else if small + middle < large - slack {
        let what = format!("principal moments {small:.6e} + {middle:.6e} < {large:.6e} kg·m²");
        let remedy = with_nearest("no mass distribution has this inertia", tensor);
        let required = "triangle inequality: the largest principal moment is at most the sum of the others";
        found.push(Violation::error(subject(), what, required, remedy).as_warning());
    }
}

/// Advice, with the nearest inertia that a body can have.
fn with_nearest(advice: &str, tensor: [f64; 6]) -> String {
    match nearest_inertia(tensor) {
        Some(nearest) => format!("{advice}; the nearest that a body can have: {}", as_attributes(nearest)),
        None => advice.into(),
    }
}

fn check_joint(joint: &Joint, found: &mut Vec<Violation>) {
    let subject = || Subject::Joint(joint.name.clone());
    let range = format!("finite numbers of magnitude at most {LARGEST:e}");
    let placement = joint.placement;
    for (what, values) in
        [("origin", placement.translation.to_vec()), ("orientation", placement.rotation.to_vec())]
    {
        if values.iter().any(|x| !is_sane(*x)) {
            found.push(Violation::error(
                subject(),
                format!("{what} {values:?}"),
                &range,
                "correct the number",
            ));
        }
    }
    if placement.rotation == [0.0; 4] {
        found.push(Violation::error(
            subject(),
            "orientation is the zero quaternion",
            "a rotation",
            "use (0, 0, 0, 1)",
        ));
    }
    let axes = joint.kind.axes();
    for axis in &axes {
        let norm = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
        if axis.iter().any(|x| !is_sane(*x)) || norm < 1e-9 {
            let what = format!("axis {axis:?}");
            found.push(Violation::error(
                subject(),
                what,
                "a finite axis that is not zero",
                "give a unit vector",
            ));
        } else if (norm - 1.0).abs() > 1e-3 {
            let what = format!("axis {axis:?} has length {norm:.6}");
            let remedy = "it is normalised: check that its direction is meant";
            found.push(Violation::error(subject(), what, "a unit vector", remedy).as_warning());
        }
    }
    if let [a, b] = axes[..] {
        let dot: f64 = a.iter().zip(&b).map(|(x, y)| x * y).sum();
        let (na, nb): (f64, f64) = (a.iter().map(|x| x * x).sum(), b.iter().map(|x| x * x).sum());
        // 1 − cos² below 1e-12: the two axes span a line to six digits.
        if dot * dot > (1.0 - 1e-12) * na * nb {
            let what = format!("axes {a:?} and {b:?} are parallel");
            found.push(Violation::error(
                subject(),
                what,
                "two different directions",
                "use a cylindrical or revolute joint",
            ));
        }
    }
    if let JointKind::Helical { pitch, .. } = joint.kind
        && !is_sane(pitch)
    {
        found.push(Violation::error(
            subject(),
            format!("pitch {pitch:?}"),
            "a finite number",
            "give the pitch in m/rad",
        ));
    }
    if let Some([lower, upper]) = joint.limits.position {
        if lower.is_nan() || upper.is_nan() {
            let what = format!("limits [{lower:?}, {upper:?}]");
            found.push(Violation::error(subject(), what, "numbers", "give lower and upper in rad or m"));
        } else if lower > upper {
            let what = format!("lower limit {lower:?} above upper limit {upper:?}");
            found.push(Violation::error(subject(), what, "lower ≤ upper", "exchange them").as_warning());
        }
    }
    for (what, value) in [("damping", joint.damping), ("friction", joint.friction)] {
        if !is_sane(value) {
            found.push(Violation::error(
                subject(),
                format!("{what} {value:?}"),
                "a finite number",
                "correct the number",
            ));
        } else if value < 0.0 {
            let remedy = "a negative value feeds energy in";
            found.push(
                Violation::error(subject(), format!("{what} {value:?}"), "0 or more", remedy).as_warning(),
            );
        }
    }
}
