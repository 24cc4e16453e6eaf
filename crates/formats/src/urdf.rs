//! URDF: robots of links and joints.
//!
//! Read are `<robot>`, `<link>` with `<inertial>`, and `<joint>` with `<origin>`, `<parent>`, `<child>`, `<axis>`,
//! `<limit>`, `<dynamics>` and `<mimic>`, in SI units. Everything else is listed in the report as ignored; what URDF
//! does not know is ignored with a warning that names the nearest known word.
//!
//! | URDF | here |
//! |---|---|
//! | no `<inertial>` | a massless body |
//! | no `<axis>` | (1, 0, 0), as URDF says |
//! | `<origin quat_xyzw>` | the orientation instead of `rpy` |
//! | `<limit>`, revolute and prismatic | required by URDF; a warning where it or a part of it is missing, and no limit then |
//! | `<limit>` of a joint that has more than one degree of freedom or none | ignored |
//! | `<mimic>` | a [`Coupling`], or dropped: [`Mimic`] |
//! | root link called `world` | the inertial frame |
//! | templates of xacro: its elements, `${…}` | refused |
//!
//! URDF has no words for some joints. These types are an extension, and noted as used in the report:
//!
//! | type | what is read |
//! |---|---|
//! | `helical` | `<axis xyz="…" pitch="…"/>`, pitch in m/rad |
//! | `cylindrical` | `<axis xyz="…"/>` |
//! | `universal` | `<axis xyz="…"/>` and `<axis2 xyz="…"/>`, which turns with the first |
//! | `spherical`, `translation` | nothing |
//!
//! Source: the URDF specification of ROS (wiki.ros.org/urdf/XML).

mod joint;
mod link;
mod mimic;
mod reader;

use crate::file::read_text;
use crate::report::{Loaded, Problem, Report};
use crate::suggest::{quote, shown};
use crate::xml;
use phipsi_model::{Base, Body, Coupling, Joint, Model, ModelBuilder, Subject, Violation};
use reader::{Element, Reader};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

/// What becomes of `<mimic>`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mimic {
    /// A closure between the two joints.
    #[default]
    Closure,
    /// Dropped: the joint moves freely. The report lists it as approximated.
    Free,
}

/// How a URDF is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UrdfOptions {
    /// How the root link hangs on the world.
    pub base: Base,
    /// What becomes of `<mimic>`.
    pub mimic: Mimic,
}

/// The model of a URDF text; `source` is its name in the report.
///
/// # Cost
/// Linear in the length of the text.
///
/// # Errors
/// In the report: XML that is not well formed; missing or repeated elements and attributes; what is no finite number;
/// unknown joint types; and every violation that [`ModelBuilder::check`] finds, with its line.
///
/// # Example
/// ```
/// use phipsi_formats::urdf::{UrdfOptions, read_urdf};
/// let read = read_urdf("<robot name='r'>\n<link nam='a'/>\n</robot>", "r.urdf", &UrdfOptions::default());
/// assert!(read.value.is_none());
/// assert_eq!(read.report.errors[0].line, Some(2));
/// assert_eq!(read.report.warnings[0].remedy, "did you mean `name`?");
/// ```
pub fn read_urdf(text: &str, source: &str, options: &UrdfOptions) -> Loaded<Model> {
    build(urdf_builder(text, source, options))
}

/// The model of a URDF file.
///
/// # Errors
/// In the report: a file that cannot be read, is larger than 256 MiB or is not UTF-8; else as [`read_urdf`].
pub fn read_urdf_file(path: impl AsRef<Path>, options: &UrdfOptions) -> Loaded<Model> {
    build(urdf_builder_file(path, options))
}

/// A builder with everything of a URDF file, to which more can be added.
///
/// # Errors
/// As [`read_urdf_file`].
pub fn urdf_builder_file(path: impl AsRef<Path>, options: &UrdfOptions) -> Loaded<ModelBuilder> {
    let source = path.as_ref().display().to_string();
    match read_text(path.as_ref(), "a URDF") {
        Ok(text) => urdf_builder(&text, &source, options),
        Err(problem) => failed(Report::new(source), problem),
    }
}

/// A builder with everything of a URDF text, to which closures, bodies and gravity can be added.
///
/// # Errors
/// As [`read_urdf`]: the URDF alone must be a valid model.
pub fn urdf_builder(text: &str, source: &str, options: &UrdfOptions) -> Loaded<ModelBuilder> {
    let report = Report::new(source);
    let document = match xml::parse(text) {
        Ok(document) => document,
        Err(problem) => return failed(report, problem),
    };
    let mut reader = Reader::new(text, report);
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        let at = reader.element(root, "document");
        let found = format!("root element {}", quote(root.tag_name().name()));
        let to_do = match root.tag_name().name() {
            "sdf" | "world" => "this is an SDF file: convert it to URDF",
            "mujoco" | "mujocoinclude" => "this is a MuJoCo file: convert it to URDF",
            "COLLADA" => "this is a COLLADA file: give the URDF that refers to it",
            "launch" => "this is a ROS launch file: give the URDF that it loads",
            _ => "give a URDF file",
        };
        reader.error(&at, found, "<robot>", to_do);
        return Loaded { value: None, report: reader.report };
    }
    let robot = Robot::read(&mut reader, root, options);
    robot.check(&mut reader);
    robot.summarize(&mut reader, options);
    let report = reader.report;
    Loaded { value: report.errors.is_empty().then_some(robot.builder), report }
}

fn failed<T>(mut report: Report, problem: Problem) -> Loaded<T> {
    report.errors.push(problem);
    Loaded { value: None, report }
}

/// Builds what has been checked.
fn build(read: Loaded<ModelBuilder>) -> Loaded<Model> {
    let Loaded { value, mut report } = read;
    match value.map(ModelBuilder::build) {
        Some(Ok(model)) => Loaded { value: Some(model), report },
        Some(Err(errors)) => {
            report.errors.extend(errors.0.into_iter().map(|v| {
                let place = v.subject.to_string();
                Problem { line: None, place, found: v.found, required: v.required, remedy: v.remedy }
            }));
            Loaded { value: None, report }
        }
        None => Loaded { value: None, report },
    }
}

/// Elements of a robot without effect on its dynamics.
const IGNORED: [(&str, &str); 7] = [
    ("material", "appearance"),
    ("transmission", "actuator model"),
    ("gazebo", "settings of another program"),
    ("ros2_control", "controller settings"),
    ("sensor", "sensor"),
    ("plugin", "settings of another program"),
    ("mujoco", "settings of another program"),
];

/// What has been read, with the lines of the names.
struct Robot {
    place: String,
    line: Option<u32>,
    builder: ModelBuilder,
    /// Lines of the links and joints of a name; more than one where the name is given twice.
    links: HashMap<String, Vec<Option<u32>>>,
    joints: HashMap<String, Vec<Option<u32>>>,
    /// How often each joint type occurs.
    kinds: BTreeMap<&'static str, usize>,
    /// The first link that is nobody's child.
    root: Option<String>,
    /// True if a link or joint without a usable name or child was left out: the rest need not be connected.
    incomplete: bool,
}

impl Robot {
    fn read<'a>(reader: &mut Reader, node: roxmltree::Node<'a, 'a>, options: &UrdfOptions) -> Self {
        let at = reader.element(
            node,
            match node.attribute("name") {
                Some(name) => format!("robot `{}`", shown(name)),
                None => "robot".into(),
            },
        );
        if !node.has_attribute("name") {
            reader.warning(&at, "no attribute `name` in <robot>", "a name", "add name=\"…\"");
        }
        let name = node.attribute("name").and_then(|_| reader.name(&at, "name")).unwrap_or("robot");
        reader.check_attributes(&at, &["name", "version"]);
        let mut robot = Robot {
            place: at.place.clone(),
            line: at.line,
            builder: ModelBuilder::new(name).base(options.base),
            links: HashMap::new(),
            joints: HashMap::new(),
            kinds: BTreeMap::new(),
            root: None,
            incomplete: false,
        };
        let children = reader.children(&at, &["link", "joint"], &IGNORED);
        let mut order = Vec::new();
        for node in children.iter().filter(|n| n.tag_name().name() == "link") {
            match robot.link(reader, *node) {
                Some(name) => order.push(name),
                None => robot.incomplete = true,
            }
        }
        let mut joints = Vec::new();
        for node in children.iter().filter(|n| n.tag_name().name() == "joint") {
            match robot.joint(reader, *node) {
                Some(joint) => joints.push(joint),
                None => robot.incomplete = true,
            }
        }
        let children: HashSet<&str> = joints.iter().map(|read| read.links[1]).collect();
        robot.root = order.iter().find(|name| !children.contains(*name)).map(|name| (*name).into());
        for coupling in mimic::couplings(reader, &joints, options.mimic) {
            robot.builder = std::mem::take(&mut robot.builder).coupling(coupling);
        }
        for ReadJoint { joint, links: [parent, child], .. } in joints {
            robot.builder = std::mem::take(&mut robot.builder).joint(joint, parent, child);
        }
        robot
    }

    /// Adds a link; its name.
    fn link<'a>(&mut self, reader: &mut Reader, node: roxmltree::Node<'a, 'a>) -> Option<&'a str> {
        let (at, name) = named(reader, node);
        let inertia = link::read(reader, &at);
        let name = name?;
        self.links.entry(name.into()).or_default().push(at.line);
        self.builder = std::mem::take(&mut self.builder).body(Body::new(name, inertia));
        Some(name)
    }

    /// Reads a joint; `None` where it has no name or no child.
    fn joint<'a>(&mut self, reader: &mut Reader, node: roxmltree::Node<'a, 'a>) -> Option<ReadJoint<'a>> {
        let (at, name) = named(reader, node);
        let joint::Read { joint, has_kind, links: [parent, child], coupling } =
            joint::read(reader, &at, name.unwrap_or_default());
        *self.kinds.entry(joint.kind.word()).or_default() += 1;
        self.joints.entry(name?.into()).or_default().push(at.line);
        // A missing parent has been reported; in its place the world keeps the child from being reported as a root too.
        Some(ReadJoint { at, joint, has_kind, links: [parent.unwrap_or("world"), child?], coupling })
    }

    /// The violations of the model, each with the line of its link or joint.
    fn check(&self, reader: &mut Reader) {
        let mut repeated: HashMap<String, usize> = HashMap::new();
        for violation in self.builder.check() {
            let Violation { subject, severity, found, required, remedy } = violation;
            if self.incomplete && subject == Subject::Model {
                continue;
            }
            let lines = match &subject {
                Subject::Body(name) => self.links.get(name),
                Subject::Joint(name) => self.joints.get(name),
                Subject::Closure(_) | Subject::Model => None,
            };
            let place = match &subject {
                Subject::Body(name) => format!("link `{}`", shown(name)),
                Subject::Joint(name) => format!("joint `{}`", shown(name)),
                Subject::Closure(name) => format!("closure `{}`", shown(name)),
                Subject::Model => self.place.clone(),
            };
            let mut line = match &subject {
                Subject::Model => self.line,
                _ => lines.and_then(|l| l.first().copied().flatten()),
            };
            if found == "name given twice" {
                let n = repeated.entry(place.clone()).or_insert(0);
                *n += 1;
                line = lines.and_then(|l| l.get(*n).copied().flatten()).or(line);
            }
            let problem = Problem { line, place, found, required, remedy };
            reader.problem(severity, problem);
        }
    }

    /// Notes what there is, and what the root is.
    fn summarize(&self, reader: &mut Reader, options: &UrdfOptions) {
        let links: usize = self.links.values().map(Vec::len).sum();
        let joints: usize = self.kinds.values().sum();
        let kinds: Vec<String> = self.kinds.iter().map(|(word, n)| format!("{n} {word}")).collect();
        let kinds = if kinds.is_empty() { String::new() } else { format!(" ({})", kinds.join(", ")) };
        let mut note = |place: String, line, what: String| {
            reader.report.used.insert(0, crate::report::Note { line, place, what });
        };
        if let Some(root) = &self.root {
            let line = self.links.get(root).and_then(|l| l.first().copied().flatten());
            let what = match (root.as_str(), options.base) {
                ("world", _) => "root, the inertial frame",
                (_, Base::Fixed) => "root, welded to the world",
                (_, Base::Free) => "root, a free base",
            };
            note(format!("link `{}`", shown(root)), line, what.into());
        }
        note(self.place.clone(), self.line, format!("links: {links}, joints: {joints}{kinds}"));
    }
}

/// A link or joint element, its place, and its name if it has one.
fn named<'a>(reader: &mut Reader, node: roxmltree::Node<'a, 'a>) -> (Element<'a>, Option<&'a str>) {
    let tag = node.tag_name().name();
    let place = match node.attribute("name") {
        Some(name) => format!("{tag} `{}`", shown(name)),
        None => format!("{tag} without a name"),
    };
    let at = reader.element(node, place);
    let name = reader.name(&at, "name");
    (at, name)
}

/// A joint with its element.
struct ReadJoint<'a> {
    at: Element<'a>,
    joint: Joint,
    has_kind: bool,
    links: [&'a str; 2],
    coupling: Option<Coupling>,
}
