//! `[outputs]` and `[reference]`.

use super::mechanism::{find_body, find_joint, joint_dof};
use super::tree::{Entry, Table, Value, finite, suggestion};
use crate::output::{BodyPoint, EnergyKind, KnownValue, Output, Quantity};
use phipsi_formats::{Problem, Report};
use phipsi_model::Model;
use phipsi_spatial::Vec3;

/// All outputs.
pub(crate) fn read(scene: &mut Table<'_>, model: &Model, report: &mut Report) -> Vec<Output> {
    let Some(table) = scene.table("outputs", report) else { return Vec::new() };
    let mut outputs = Vec::new();
    for entry in table.rest() {
        let Some(mut output) = Table::new(&entry.node, format!("output `{}`", entry.key), report) else {
            continue;
        };
        let quantity = quantity(&mut output, model, report);
        output.finish(report);
        outputs.extend(quantity.map(|quantity| Output { name: entry.key.clone(), quantity }));
    }
    outputs
}

fn quantity(table: &mut Table<'_>, model: &Model, report: &mut Report) -> Option<Quantity> {
    if table.has("energy") {
        return Some(Quantity::Energy(
            match table.word("energy", &["kinetic", "potential", "total"], report)? {
                "kinetic" => EnergyKind::Kinetic,
                "potential" => EnergyKind::Potential,
                _ => EnergyKind::Total,
            },
        ));
    }
    if table.has("joints") {
        return sum_of_joints(table, model, report);
    }
    if table.has("joint") {
        let joint = joint_dof(table, "joint", model, report);
        let of = table.word("of", &["q", "v"], report).unwrap_or("q");
        let joint = joint?;
        if of == "v" {
            return Some(Quantity::Velocities(vec![(joint.dof, 1.0)]));
        }
        if joint.coordinate.is_none() {
            let remedy = "use `of = \"v\"`, or the position of a point";
            table.error(None, report, "a degree of freedom without a coordinate", "a one-axis joint", remedy);
        }
        return Some(Quantity::Coordinates(vec![(joint.coordinate?, 1.0)]));
    }
    if table.has("body_a") || table.has("body_b") {
        let ends = [("body_a", "point_a"), ("body_b", "point_b")].map(|(body, point)| {
            let body = find_body(table, body, model, report);
            let point = Vec3(table.numbers(point, report).unwrap_or_default());
            body.map(|body| BodyPoint { body, point })
        });
        let [a, b] = ends;
        return Some(Quantity::Distance(a?, b?));
    }
    if table.has("mode") {
        return modal_coordinate(table, model, report);
    }
    if table.has("body") {
        let body = find_body(table, "body", model, report);
        let point = Vec3(table.numbers("point", report).unwrap_or_default());
        table.required("axis", report, "\"x\", \"y\" or \"z\"");
        let axis = table.word("axis", &["x", "y", "z"], report);
        let of = table.word("of", &["position", "velocity"], report).unwrap_or("position");
        let (point, axis) = (BodyPoint { body: body?, point }, axis?);
        let axis = ["x", "y", "z"].iter().position(|a| *a == axis)?;
        return Some(match of {
            "velocity" => Quantity::Velocity(point, axis),
            _ => Quantity::Position(point, axis),
        });
    }
    let required = "joint, joints, body (with point and axis), body_a and body_b (a distance), or energy";
    table.error(None, report, "nothing to measure", required, "add one of these keys");
    None
}

/// Mode `mode` of the flexible body `body`.
fn modal_coordinate(table: &mut Table<'_>, model: &Model, report: &mut Report) -> Option<Quantity> {
    let of = table.word("of", &["q", "v"], report).unwrap_or("q");
    let body = find_body(table, "body", model, report)?;
    let count = body.map_or(0, |k| model.bodies()[k].modes());
    let number = table.number("mode", report)?;
    let (Some(k), true) = (body, (1.0..=count as f64).contains(&number) && number.fract() == 0.0) else {
        let node = table.get("mode");
        let required = format!("a mode of this body, 1 to {count}");
        table.error(node, report, format!("mode = {number}"), required, "correct `mode` or `body`");
        return None;
    };
    let n = number as usize - 1;
    Some(match of {
        "v" => Quantity::Velocities(vec![(model.mode_v_range(k).start + n, 1.0)]),
        _ => Quantity::Coordinates(vec![(model.mode_q_range(k).start + n, 1.0)]),
    })
}

fn sum_of_joints(table: &mut Table<'_>, model: &Model, report: &mut Report) -> Option<Quantity> {
    let node = table.get("joints")?;
    let names: Option<Vec<&str>> = match &node.value {
        Value::List(items) => items
            .iter()
            .map(|i| match &i.value {
                Value::Text(name) => Some(name.as_str()),
                _ => None,
            })
            .collect(),
        _ => None,
    };
    let Some(names) = names.filter(|n| !n.is_empty()) else {
        let found = format!("joints = {}", node.value.describe());
        table.error(Some(node), report, found, "names of joints in brackets", "correct `joints`");
        return None;
    };
    let factors = match table.get("factors") {
        None => vec![1.0; names.len()],
        Some(factors) => match super::tree::number_list(factors).filter(|f| f.len() == names.len()) {
            Some(factors) => factors,
            None => {
                let found = format!("factors = {}", factors.value.describe());
                let required = format!("{} numbers, one for each joint", names.len());
                table.error(Some(factors), report, found, required, "correct `factors`");
                return None;
            }
        },
    };
    let of = table.word("of", &["q", "v"], report).unwrap_or("q");
    let mut terms = Vec::new();
    for (name, factor) in names.into_iter().zip(factors) {
        let k = find_joint(table, "joints", name, model, report)?;
        if model.joints()[k].kind.nv() != 1 {
            let found = format!("joint `{name}`, which has several degrees of freedom");
            table.error(Some(node), report, found, "joints with one axis", "name them one by one");
            return None;
        }
        terms.push((if of == "v" { model.v_offset(k) } else { model.q_offset(k) }, factor));
    }
    Some(if of == "v" { Quantity::Velocities(terms) } else { Quantity::Coordinates(terms) })
}

/// Known values of outputs, and where they come from.
pub(crate) fn reference(
    scene: &mut Table<'_>,
    outputs: &[Output],
    report: &mut Report,
) -> (Vec<KnownValue>, Option<String>) {
    let Some(mut table) = scene.table("reference", report) else { return (Vec::new(), None) };
    let source = table.text("source", report).map(str::to_string);
    let names: Vec<&str> = outputs.iter().map(|o| o.name.as_str()).collect();
    let mut known = Vec::new();
    for Entry { key, line, node } in table.rest() {
        let mut wrong = |found: String, required: &str, remedy: String| {
            report.errors.push(Problem::new(*line, "reference", found, required, remedy));
        };
        if !names.contains(&key.as_str()) {
            wrong(format!("`{key}`"), "the name of an output", suggestion(key, &names));
            continue;
        }
        match finite(node) {
            Some(value) => known.push(KnownValue { output: key.clone(), value }),
            None => wrong(
                format!("{key} = {}", node.value.describe()),
                "a finite number",
                format!("correct `{key}`"),
            ),
        }
    }
    (known, source)
}
