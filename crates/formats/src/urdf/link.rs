//! `<link>`: a body with its mass properties.

use super::reader::{Element, Reader};
use phipsi_model::Inertia;

/// Elements of a link without effect on its dynamics.
const IGNORED: [(&str, &str); 7] = [
    ("visual", "geometry to look at"),
    ("collision", "geometry of contacts"),
    ("self_collision_checking", "geometry of contacts"),
    ("contact", "geometry of contacts"),
    ("material", "appearance"),
    ("sensor", "sensor"),
    ("verbose", "documentation"),
];

/// Mass properties of a link; what cannot be read is zero and reported.
pub(super) fn read(reader: &mut Reader, link: &Element<'_>) -> Inertia {
    reader.check_attributes(link, &["name"]);
    let children = reader.children(link, &["inertial"], &IGNORED);
    let Some(inertial) = reader.only(link, &children, "inertial") else {
        reader.used(link, "no <inertial>: massless");
        return Inertia::ZERO;
    };
    reader.check_attributes(&inertial, &[]);
    let children = reader.children(&inertial, &["origin", "mass", "inertia"], &[]);
    let origin = reader.only(&inertial, &children, "origin");
    let frame = reader.origin(origin.as_ref());
    let mut mass = None;
    if let Some(element) = reader.required(&inertial, &children, "mass") {
        reader.check_attributes(&element, &["value"]);
        reader.children(&element, &[], &[]);
        mass = reader.required_number(&element, "value");
    }
    let mut tensor = [None; 6];
    if let Some(element) = reader.required(&inertial, &children, "inertia") {
        const NAMES: [&str; 6] = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];
        reader.check_attributes(&element, &NAMES);
        reader.children(&element, &[], &[]);
        tensor = NAMES.map(|name| reader.required_number(&element, name));
    }
    // A number that could not be read leaves the link massless, so that the model's checks find nothing more in it.
    match (mass, tensor) {
        (Some(mass), [Some(xx), Some(xy), Some(xz), Some(yy), Some(yz), Some(zz)]) => {
            Inertia { mass, frame, tensor: [xx, xy, xz, yy, yz, zz] }
        }
        _ => Inertia::ZERO,
    }
}
