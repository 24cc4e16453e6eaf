//! `<joint>`: how a link moves against its parent.

use super::reader::{Element, Reader};
use crate::suggest::{nearest, quote};
use phipsi_model::{Coupling, Joint, JointKind, Limits};
use roxmltree::Node;

/// The joint types, URDF's first, then the extension.
const TYPES: [&str; 11] = [
    "revolute",
    "continuous",
    "prismatic",
    "fixed",
    "floating",
    "planar",
    "helical",
    "cylindrical",
    "universal",
    "spherical",
    "translation",
];
/// How many of [`TYPES`] are URDF's own.
const OWN: usize = 6;

/// Words of other programs for the same joints.
const SYNONYMS: [(&str, &str); 10] = [
    ("ball", "spherical"),
    ("free", "floating"),
    ("gearbox", "revolute"),
    ("hinge", "revolute"),
    ("screw", "helical"),
    ("slide", "prismatic"),
    ("slider", "prismatic"),
    ("translational", "translation"),
    ("revolute2", "universal"),
    ("weld", "fixed"),
];

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
        reader.text(&element, "link")
    });
    let kind = kind(reader, at, &children).unwrap_or(JointKind::Fixed);
    let (damping, friction) = dynamics(reader, at, &children, kind);
    let limits = limits(reader, at, &children, kind);
    let coupling = coupling(reader, at, &children, name);
    let joint = Joint { name: name.into(), kind, placement, limits, damping, friction };
    Read { joint, links, coupling }
}

/// The joint's type with its axes.
fn kind<'a>(reader: &mut Reader, at: &Element<'a>, children: &[Node<'a, 'a>]) -> Option<JointKind> {
    let word = reader.text(at, "type");
    let axis_element = reader.only(at, children, "axis");
    let second_element = reader.only(at, children, "axis2");
    let word = word?;
    let Some(position) = TYPES.iter().position(|t| *t == word) else {
        let lower = word.to_ascii_lowercase();
        let known = SYNONYMS.iter().find(|(other, _)| *other == lower).map(|(_, ours)| *ours);
        let to_do = match known.or_else(|| nearest(word, TYPES)) {
            Some(guess) => format!("did you mean `{guess}`?"),
            None => format!("use one of {}", TYPES.join(", ")),
        };
        reader.error(at, format!("joint type {}", quote(word)), "a joint type", &to_do);
        return None;
    };
    if position >= OWN {
        reader.used(at, format!("joint type `{word}`, an extension of URDF"));
    }
    if let Some(element) = &axis_element {
        let known: &[&str] = if word == "helical" { &["xyz", "pitch"] } else { &["xyz"] };
        reader.check_attributes(element, known);
        reader.children(element, &[], &[]);
    }
    if let Some(element) = &second_element {
        reader.check_attributes(element, &["xyz"]);
        reader.children(element, &[], &[]);
        if word != "universal" {
            reader.ignored(element, format!("axis2 of a {word} joint"));
        }
    }
    let without_axis = match word {
        "fixed" => Some(JointKind::Fixed),
        "floating" => Some(JointKind::Free),
        "spherical" => Some(JointKind::Spherical),
        "translation" => Some(JointKind::Translation),
        _ => None,
    };
    if without_axis.is_some() {
        if let Some(element) = &axis_element {
            reader.ignored(element, format!("axis of a {word} joint"));
        }
        return without_axis;
    }
    let axis = axis(reader, at, axis_element.as_ref());
    Some(match word {
        "revolute" => JointKind::Revolute { axis: axis? },
        "continuous" => JointKind::Continuous { axis: axis? },
        "prismatic" => JointKind::Prismatic { axis: axis? },
        "cylindrical" => JointKind::Cylindrical { axis: axis? },
        "planar" => JointKind::Planar { normal: axis? },
        "helical" => {
            let pitch = match &axis_element {
                Some(element) => reader.required_number(element, "pitch"),
                None => {
                    let to_do = "add <axis xyz=\"…\" pitch=\"…\"/>";
                    reader.error(at, "a helical joint without <axis>", "a pitch in m/rad", to_do);
                    None
                }
            };
            JointKind::Helical { axis: axis?, pitch: pitch? }
        }
        _ => {
            let second = match &second_element {
                Some(element) => match element.node.has_attribute("xyz") {
                    true => reader.numbers(element, "xyz"),
                    false => {
                        reader.error(
                            element,
                            "no attribute `xyz` in <axis2>",
                            "three numbers",
                            "add xyz=\"…\"",
                        );
                        None
                    }
                },
                None => {
                    let to_do = "add <axis2 xyz=\"…\"/>";
                    reader.error(at, "a universal joint without <axis2>", "two axes", to_do);
                    None
                }
            };
            JointKind::Universal { axes: [axis?, second?] }
        }
    })
}

/// The axis, or URDF's default.
fn axis(reader: &mut Reader, at: &Element<'_>, element: Option<&Element<'_>>) -> Option<[f64; 3]> {
    match element {
        Some(element) if element.node.has_attribute("xyz") => reader.numbers(element, "xyz"),
        _ => {
            reader.used(at, "no axis: URDF's default (1, 0, 0)");
            Some([1.0, 0.0, 0.0])
        }
    }
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
            Some(v) if v < 0.0 => (format!("{name}=\"{v}\""), "give a positive number"),
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
                let found = format!("lower = upper = {lower}");
                reader.warning(&element, found, "lower < upper", "correct the limits, or use a fixed joint");
            }
            Some([lower, upper])
        }
    };
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
    let source = reader.text(&element, "joint");
    let multiplier = reader.number(&element, "multiplier");
    let offset = reader.number(&element, "offset");
    Some(Coupling {
        joint: name.into(),
        source: source?.into(),
        multiplier: multiplier.unwrap_or(1.0),
        offset: offset.unwrap_or(0.0),
    })
}
