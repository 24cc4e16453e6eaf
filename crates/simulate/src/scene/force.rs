//! `[[force]]`: torques, servos, springs, dampers, wrenches, thrusters and central gravity.

use super::mechanism::{find_body, joint_dof};
use super::signal;
use super::tree::{Table, Value, number_list};
use phipsi_formats::{Note, Report};
use phipsi_model::Model;
use phipsi_motion::forces::{
    BodyWrench, CentralGravity, JointSpring, JointTorque, PointSpring, Servo, Thruster, WrenchAxes,
};
use phipsi_motion::{Force, Signal};
use phipsi_spatial::Vec3;

const KINDS: [&str; 7] = ["torque", "servo", "spring", "damper", "wrench", "thruster", "central_gravity"];

/// All forces of a scene; kinks and jumps of their functions of time are looked for up to `t_end`.
pub(crate) fn read(
    scene: &mut Table<'_>,
    model: &Model,
    t_end: f64,
    report: &mut Report,
) -> Vec<Box<dyn Force>> {
    let mut forces: Vec<Box<dyn Force>> = Vec::new();
    for (i, mut table) in scene.tables("force", report).into_iter().enumerate() {
        if table.required("kind", report, &format!("one of {}", KINDS.join(", "))).is_none() {
            continue;
        }
        let Some(kind) = table.word("kind", &KINDS, report) else { continue };
        let name = table.text("name", report).map_or_else(|| format!("{kind} {i}"), str::to_string);
        table.place = format!("force `{name}`");
        let force = match kind {
            "torque" => torque(&mut table, name, model, t_end, report),
            "servo" => servo(&mut table, name, model, t_end, report),
            "thruster" => thruster(&mut table, name, model, t_end, report),
            "central_gravity" => central_gravity(&mut table, name, model, report),
            "wrench" => wrench(&mut table, name, model, t_end, report),
            kind if table.has("joint") => joint_spring(&mut table, name, kind, model, report),
            kind => point_spring(&mut table, name, kind, model, report),
        };
        table.finish(report);
        forces.extend(force);
    }
    forces
}

type MaybeForce = Option<Box<dyn Force>>;

fn torque(table: &mut Table<'_>, name: String, model: &Model, t_end: f64, report: &mut Report) -> MaybeForce {
    let joint = joint_dof(table, "joint", model, report);
    let value = signal::required(table, "value", t_end, report);
    Some(Box::new(JointTorque { name, dof: joint?.dof, value: value? }))
}

fn servo(table: &mut Table<'_>, name: String, model: &Model, t_end: f64, report: &mut Report) -> MaybeForce {
    let joint = joint_dof(table, "joint", model, report);
    let target = signal::required(table, "target", t_end, report);
    table.required("stiffness", report, "a stiffness, N·m/rad or N/m");
    let stiffness = table.positive("stiffness", true, report);
    let damping = table.positive("damping", true, report).unwrap_or_default();
    let integral = table.positive("integral", true, report).unwrap_or_default();
    let limit = table.positive("limit", false, report).unwrap_or(f64::INFINITY);
    let joint = joint?;
    let coordinate = one_axis(table, joint.coordinate, report)?;
    let (dof, target, stiffness) = (joint.dof, target?, stiffness?);
    Some(Box::new(Servo { name, coordinate, dof, target, stiffness, damping, integral, limit }))
}

fn joint_spring(
    table: &mut Table<'_>,
    name: String,
    kind: &str,
    model: &Model,
    report: &mut Report,
) -> MaybeForce {
    let joint = joint_dof(table, "joint", model, report);
    let [stiffness, damping] = coefficients(table, kind, report);
    let rest = if kind == "spring" { table.number("rest", report).unwrap_or_default() } else { 0.0 };
    let joint = joint?;
    let coordinate = one_axis(table, joint.coordinate, report)?;
    Some(Box::new(JointSpring { name, coordinate, dof: joint.dof, stiffness, damping, rest }))
}

fn point_spring(
    table: &mut Table<'_>,
    name: String,
    kind: &str,
    model: &Model,
    report: &mut Report,
) -> MaybeForce {
    let bodies = ["body_a", "body_b"].map(|key| find_body(table, key, model, report));
    let points = ["point_a", "point_b"].map(|key| Vec3(table.numbers(key, report).unwrap_or_default()));
    let [stiffness, damping] = coefficients(table, kind, report);
    let rest_length =
        if kind == "spring" { table.positive("rest_length", true, report).unwrap_or_default() } else { 0.0 };
    let [a, b] = bodies;
    let bodies = [a?, b?];
    if bodies[0] == bodies[1] {
        let remedy = "give two different bodies, or `joint = …`";
        table.error(None, report, "both ends on one body", "two bodies", remedy);
        return None;
    }
    Some(Box::new(PointSpring { name, bodies, points, stiffness, damping, rest_length }))
}

/// Stiffness (of a spring) and damping (which a damper must have).
fn coefficients(table: &mut Table<'_>, kind: &str, report: &mut Report) -> [f64; 2] {
    let required = if kind == "spring" { "stiffness" } else { "damping" };
    table.required(required, report, "a number, at least 0");
    let stiffness =
        if kind == "spring" { table.positive("stiffness", true, report).unwrap_or_default() } else { 0.0 };
    [stiffness, table.positive("damping", true, report).unwrap_or_default()]
}

fn wrench(table: &mut Table<'_>, name: String, model: &Model, t_end: f64, report: &mut Report) -> MaybeForce {
    let body = find_body(table, "body", model, report);
    let point = Vec3(table.numbers("point", report).unwrap_or_default());
    let axes = match table.word("axes", &["body", "world"], report) {
        Some("world") => WrenchAxes::World,
        _ => WrenchAxes::Body,
    };
    let moment = signal::three(table, "moment", t_end, report);
    let force = signal::three(table, "force", t_end, report);
    let Some(body) = body? else {
        let node = table.get("body");
        table.error(node, report, "a wrench on the world", "a body that moves", "name another body");
        return None;
    };
    let ([mx, my, mz], [fx, fy, fz]) = (moment?, force?);
    Some(Box::new(BodyWrench { name, body, point, axes, components: [mx, my, mz, fx, fy, fz] }))
}

fn thruster(
    table: &mut Table<'_>,
    name: String,
    model: &Model,
    t_end: f64,
    report: &mut Report,
) -> MaybeForce {
    let body = find_body(table, "body", model, report);
    let point = Vec3(table.numbers("point", report).unwrap_or_default());
    table.required("direction", report, "three numbers: along which it pushes the body, body axes");
    let direction = table.numbers("direction", report).map(Vec3);
    let length = direction.map(|d| d.norm());
    if length.is_some_and(|length| !(length.is_finite() && length > 0.0)) {
        let node = table.get("direction");
        table.error(node, report, "a direction of length zero", "a direction", "give its components");
        return None;
    }
    let thrust = match table.has("on") {
        false => signal::required(table, "thrust", t_end, report),
        true => on_off(table, report),
    };
    let specific_impulse = table.positive("specific_impulse", false, report);
    if specific_impulse.is_some() {
        let what = "its propellant is counted, but the mass of its body stays what it is";
        report.approximated.push(Note::new(table.line, table.place.clone(), what));
    }
    let Some(body) = body? else {
        let node = table.get("body");
        table.error(node, report, "a thruster on the world", "a body that moves", "name another body");
        return None;
    };
    let direction = direction?.scale(1.0 / length?);
    Some(Box::new(Thruster { name, body, point, direction, thrust: thrust?, specific_impulse }))
}

/// A constant thrust that is there in the spans `on`.
fn on_off(table: &mut Table<'_>, report: &mut Report) -> Option<Signal> {
    table.required("thrust", report, "a thrust in N while it is on");
    let thrust = table.number("thrust", report);
    let node = table.get("on")?;
    let spans: Option<Vec<[f64; 2]>> = match &node.value {
        Value::List(items) => {
            items.iter().map(|item| number_list(item).and_then(|s| <[f64; 2]>::try_from(s).ok())).collect()
        }
        _ => None,
    };
    let ordered =
        |s: &Vec<[f64; 2]>| s.iter().all(|[a, b]| a < b) && s.windows(2).all(|w| w[0][1] <= w[1][0]);
    match spans.filter(ordered) {
        Some(spans) => Some(Thruster::on_off(thrust?, spans)),
        None => {
            let found = format!("on = {}", node.value.describe());
            let required = "spans [[from, to], …] that do not overlap, in the order of time";
            table.error(Some(node), report, found, required, "correct `on`");
            None
        }
    }
}

fn central_gravity(table: &mut Table<'_>, name: String, model: &Model, report: &mut Report) -> MaybeForce {
    table.required("mu", report, "G times the attracting mass, m³/s² (Earth: 3.986004418e14)");
    let mu = table.positive("mu", false, report);
    let center = table.numbers("center", report).unwrap_or_default();
    if model.bodies().iter().any(|b| b.flexible.is_some()) {
        let found = "central gravity on flexible bodies";
        table.error(None, report, found, "rigid bodies", "remove the force or make the bodies rigid");
        return None;
    }
    if model.gravity() != [0.0; 3] {
        let [x, y, z] = model.gravity();
        let what = format!("acts besides the uniform gravity ({x}, {y}, {z}) of [model]");
        report.used.push(Note::new(table.line, table.place.clone(), what));
    }
    Some(Box::new(CentralGravity::new(name, model, mu?, center)))
}

/// The coordinate of a joint's degree of freedom; an error where it has none.
fn one_axis(table: &mut Table<'_>, coordinate: Option<usize>, report: &mut Report) -> Option<usize> {
    if coordinate.is_none() {
        let node = table.get("joint");
        let required = "a degree of freedom with a coordinate of its own";
        table.error(
            node,
            report,
            "a degree of freedom without a coordinate",
            required,
            "name a one-axis joint",
        );
    }
    coordinate
}
