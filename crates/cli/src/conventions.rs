//! `phipsi conventions`.

use crate::show::print_json;
use crate::{Common, Ending};
use serde_json::{Map, Value};

/// Matter and choice, as in the design.
const CONVENTIONS: [(&str, &str); 13] = [
    ("six-vectors", "angular first: motion (omega, v), force (n, f)"),
    ("order of bodies", "parents before children"),
    ("hinge map", "6 x n, columns = joint axes (the papers' H*)"),
    (
        "acceleration of bodies",
        "inertial derivative of omega and of the velocity of the body-frame origin; generalized: componentwise \
         derivative of v",
    ),
    ("generalized forces", "power-conjugate to v"),
    ("quaternions", "x y z w, child to parent; either sign is read"),
    (
        "joints, q",
        "revolute, continuous, prismatic, helical: 1 (rad, m; continuous is not wrapped); cylindrical: angle, \
         displacement; universal: two angles; planar: x, y, angle; translation: x, y, z; spherical: quaternion; free: \
         position in the parent's axes, then quaternion",
    ),
    (
        "joints, v",
        "angular part first, child (body) axes: spherical omega; free (omega, v of the body-frame origin); planar \
         (omega_z, v_x, v_y); cylindrical (rate, speed); one-axis and universal joints, translation: the derivatives of q",
    ),
    (
        "joint names",
        "the moving joints in the order of v; a free base given by base = \"free\" is the first, named after its root \
         link; fixed joints are not among them; the body `world` is the inertial frame",
    ),
    ("gravity", "default (0, 0, -9.80665) m/s2"),
    ("units", "SI: m, kg, s, rad"),
    ("momentum", "angular about the centre of mass, then linear; world axes"),
    ("wrenches on bodies", "at the body frame's origin, body axes, angular first"),
];

/// Prints them.
pub fn conventions(common: &Common) -> Ending {
    if common.json {
        let all: Map<String, Value> =
            CONVENTIONS.iter().map(|(matter, choice)| ((*matter).into(), (*choice).into())).collect();
        print_json(&Value::Object(all));
    } else {
        for (matter, choice) in CONVENTIONS {
            anstream::println!("{matter}: {choice}");
        }
    }
    Ending::Fine
}
