//! `<joint>`: how a link moves against its parent.

use super::reader::{Element, Reader};
use crate::{JointKindError, is_extension, joint_kind};
use phipsi_model::{Coupling, Joint, JointKind, Limits};
use roxmltree::Node;

/// Elements of a joint without effect on the dynamics.
const IGNORED: [(&str, &str); 4] = [
    ("safety_controller", "controller settings"),
    ("calibration", "calibration"),
    ("sensor", "sensor"),
    ("hardware_interface", "controller settings"),
];

/// What a joint element says.
pub(super) struct Read<'a> {
    pub joint: Joint,
    /// False where the type could not be read, so that the joint stands in for it.
    pub has_kind: bool,
    /// Names of the parent and child link; `None` where missing and reported.
    pub links: [Option<&'a str>; 2],
    pub coupling: Option<Coupling>,
}

/// A joint; what cannot be read is replaced by a fixed joint or zeros, and reported.
pub(super) fn read<'a>(reader: &mut Reader, at: &Element<'a>, name: &str) -> Read<'a> {
    reader.check_attributes(at, &["name", "type"]);
    let used = ["origin", "parent", "child", "axis", "axis2", "limit", "dynamics", "mimic"];
    let children = reader.children(at, &used, &IGNORED);
    let origin = reader.only(at, &children, "origin");
    let placement = reader.origin(origin.as_ref());
    let links = ["parent", "child"].map(|role| {
        let element = reader.required(at, &children, role)?;
        reader.check_attributes(&element, &["link"]);
        reader.children(&element, &[], &[]);
        reader.name(&element, "link")
    });
    let kind = kind(reader, at, &children);
    let has_kind = kind.is_some();
    // Beside an unknown type, the rest is read as that of a joint which can have all of it and needs nothing.
    let assumed = kind.unwrap_or(JointKind::Helical { axis: [1.0, 0.0, 0.0], pitch: 0.0 });
    let (damping, friction) = dynamics(reader, at, &children, assumed);
    let limits = limits(reader, at, &children, assumed);
    let kind = kind.unwrap_or(JointKind::Fixed);
    let coupling = coupling(reader, at, &children, name);
    let joint = Joint { name: name.into(), kind, placement, limits, damping, friction };
    Read { joint, has_kind, links, coupling }
}

/// The joint's type with its axes.
fn kind<'a>(reader: &mut Reader, at: &Element<'a>, children: &[Node<'a, 'a>]) -> Option<JointKind> {
    let word = reader.text(at, "type");
    let [first, second] = ["axis", "axis2"].map(|name| reader.only(at, children, name));
    for (element, known) in [(&first, &["xyz", "pitch"][..]), (&second, &["xyz"])] {
        let Some(element) = element else { continue };
        reader.check_attributes(element, known);
        reader.children(element, &[], &[]);
    }
    let given = |element: &Option<Element<'a>>, name| {
        element.as_ref().filter(|e| e.node.has_attribute(name)).cloned()
    };
    let [axis_at, axis2_at] = [given(&first, "xyz"), given(&second, "xyz")];
    let pitch_at = given(&first, "pitch");
    let [axis, axis2] = [&axis_at, &axis2_at].map(|e| e.as_ref().map(|e| reader.numbers(e, "xyz")));
    let pitch = pitch_at.as_ref().map(|e| reader.number(e, "pitch"));
    // What is given but cannot be read has been reported; a stand-in keeps it from being reported as missing too.
    let kind = joint_kind(
        word?,
        axis.map(|a| a.unwrap_or([1.0, 0.0, 0.0])),
        axis2.map(|a| a.unwrap_or([0.0; 3])),
        pitch.map(|p| p.unwrap_or(0.0)),
    );
    let kind = match kind {
        Ok(kind) => kind,
        Err(JointKindError { found, required, remedy }) => {
            reader.error(at, found, &required, &remedy);
            return None;
        }
    };
    let word = kind.word();
    if is_extension(&kind) {
        reader.used(at, format!("joint type `{word}`, an extension of URDF"));
    }
    let axes = kind.axes().len();
    if axes > 0 && axis.is_none() {
        reader.used(at, "no axis: URDF's default (1, 0, 0)");
    }
    for (element, used) in [(&first, axes > 0), (&second, axes > 1)] {
        if let Some(element) = element
            && !used
        {
            reader.ignored(element, format!("{} of a {word} joint", element.tag()));
        }
    }
    let screw = matches!(kind, JointKind::Helical { .. });
    if let Some(element) = pitch_at.as_ref().filter(|_| !screw) {
        reader.ignored(element, format!("pitch of a {word} joint"));
    }
    let unreadable = (axes > 0 && axis == Some(None))
        || (axes > 1 && axis2 == Some(None))
        || (screw && pitch == Some(None));
    (!unreadable).then_some(kind)
}

/// Damping and friction.
fn dynamics<'a>(
    reader: &mut Reader,
    at: &Element<'a>,
    children: &[Node<'a, 'a>],
    kind: JointKind,
) -> (f64, f64) {
    let Some(element) = reader.only(at, children, "dynamics") else { return (0.0, 0.0) };
    reader.check_attributes(&element, &["damping", "friction"]);
    reader.children(&element, &[], &[]);
    let damping = reader.number(&element, "damping").unwrap_or(0.0);
    let friction = reader.number(&element, "friction").unwrap_or(0.0);
    if kind == JointKind::Fixed {
        reader.ignored(&element, "dynamics of a fixed joint");
        return (0.0, 0.0);
    }
    if damping != 0.0 || friction != 0.0 {
        reader.used(&element, "damping and friction, as passive forces");
    }
    (damping, friction)
}

/// Limits of a joint with one degree of freedom.
fn limits<'a>(reader: &mut Reader, at: &Element<'a>, children: &[Node<'a, 'a>], kind: JointKind) -> Limits {
    let limited = matches!(kind, JointKind::Revolute { .. } | JointKind::Prismatic { .. });
    let word = kind.word();
    let Some(element) = reader.only(at, children, "limit") else {
        if limited {
            let found = format!("a {word} joint without <limit>");
            reader.warning(
                at,
                found,
                "<limit> with lower, upper, effort, velocity",
                "add it, or use a continuous joint",
            );
        }
        return Limits::default();
    };
    reader.check_attributes(&element, &["lower", "upper", "effort", "velocity"]);
    reader.children(&element, &[], &[]);
    let [lower, upper, effort, velocity] =
        ["lower", "upper", "effort", "velocity"].map(|name| reader.number(&element, name));
    if kind.nv() != 1 {
        reader.ignored(&element, format!("limit of a {word} joint"));
        return Limits::default();
    }
    for (name, value) in [("effort", effort), ("velocity", velocity)] {
        let given = element.node.has_attribute(name);
        let (found, to_do) = match value {
            None if given => continue,
            None if !limited => continue,
            None => (format!("no attribute `{name}` in <limit>"), "add it; it is read as no limit"),
            Some(v) if v < 0.0 => {
                (format!("{name}=\"{v:?}\""), "give a positive number; it is read as no limit")
            }
            Some(0.0) => (format!("{name}=\"0\""), "give the largest value, or leave it out for no limit"),
            Some(_) => continue,
        };
        reader.warning(&element, found, &format!("{name} > 0"), to_do);
    }
    let given = ["lower", "upper"].map(|name| element.node.has_attribute(name));
    let position = match (kind, given) {
        (JointKind::Continuous { .. }, [false, false]) => None,
        (JointKind::Continuous { .. }, _) => {
            reader.ignored(&element, "lower and upper of a continuous joint");
            None
        }
        (_, [false, false]) => {
            if limited {
                let found = "neither `lower` nor `upper` in <limit>, which URDF reads as 0 and 0";
                reader.warning(
                    &element,
                    found,
                    "lower < upper",
                    "add them; until then there is no position limit",
                );
            }
            None
        }
        _ => {
            let [lower, upper] = [lower.unwrap_or(0.0), upper.unwrap_or(0.0)];
            if lower == upper {
                let found = format!("lower = upper = {lower:?}");
                reader.warning(&element, found, "lower < upper", "correct the limits, or use a fixed joint");
            }
            Some([lower, upper])
        }
    };
    let [velocity, effort] = [velocity, effort].map(|limit| limit.filter(|v| *v >= 0.0));
    let limits = Limits { position, velocity, effort };
    if limits != Limits::default() {
        reader.used(&element, "limits, kept beside the equations of motion");
    }
    limits
}

/// `mimic`: this joint follows another.
fn coupling<'a>(
    reader: &mut Reader,
    at: &Element<'a>,
    children: &[Node<'a, 'a>],
    name: &str,
) -> Option<Coupling> {
    let element = reader.only(at, children, "mimic")?;
    reader.check_attributes(&element, &["joint", "multiplier", "offset"]);
    reader.children(&element, &[], &[]);
    let source = reader.name(&element, "joint");
    let multiplier = reader.number(&element, "multiplier");
    let offset = reader.number(&element, "offset");
    Some(Coupling {
        joint: name.into(),
        source: source?.into(),
        multiplier: multiplier.unwrap_or(1.0),
        offset: offset.unwrap_or(0.0),
    })
}
