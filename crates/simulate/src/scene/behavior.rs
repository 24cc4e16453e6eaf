//! `[joint_stops]` and `[friction]`: how limits and dry friction of joints act.

use super::mechanism::find_joint;
use super::tree::{Table, Value, finite};
use crate::simulation::JointBehavior;
use phipsi_formats::{Note, Report};
use phipsi_model::{JointKind, Model};

/// Both tables; `friction_speed` is that of `[model]`.
pub(crate) fn read(
    scene: &mut Table<'_>,
    model: &Model,
    friction_speed: Option<f64>,
    report: &mut Report,
) -> JointBehavior {
    let mut behavior = JointBehavior { friction_speed, ..JointBehavior::default() };
    let limited = |k: usize| model.joints()[k].kind.nv() == 1 && model.joints()[k].limits.position.is_some();
    if let Some(mut table) = scene.table("joint_stops", report) {
        table.required("restitution", report, "a coefficient of restitution, or { JOINT = … }");
        let given = per_joint(&mut table, "restitution", [0.0, 1.0], model, report);
        table.finish(report);
        behavior.restitution = (0..model.len())
            .map(|k| match given {
                Given::All(e) if limited(k) => Some(e),
                Given::Some(ref list) => list.iter().find(|(joint, _)| *joint == k).map(|(_, e)| *e),
                _ => None,
            })
            .collect();
        for k in (0..model.len()).filter(|&k| behavior.restitution[k].is_some() && !limited(k)) {
            let joint = &model.joints()[k];
            let found = format!("restitution of joint `{}`, which has no limits", joint.name);
            table_error(report, found, "a joint with one axis and limits", "give it a `limit`, or remove it");
        }
        let stops: Vec<String> = (0..model.len())
            .filter_map(|k| Some(format!("{} ({})", model.joints()[k].name, behavior.restitution[k]?)))
            .collect();
        if !stops.is_empty() {
            let what = format!("limits are stops, with restitution: {}", stops.join(", "));
            report.used.push(Note::new(None, "joint_stops", what));
        }
    }
    if let Some(mut table) = scene.table("friction", report) {
        let given = per_joint(&mut table, "breakaway_ratio", [1.0, f64::INFINITY], model, report);
        table.finish(report);
        behavior.breakaway_ratio = (0..model.len())
            .map(|k| match given {
                Given::All(ratio) => ratio,
                Given::Some(ref list) => list.iter().find(|(joint, _)| *joint == k).map_or(1.0, |(_, x)| *x),
                Given::Nothing => 1.0,
            })
            .collect();
    }
    let rubs = |k: &usize| model.joints()[*k].friction != 0.0;
    if behavior.friction_speed.is_none() {
        let names: Vec<&str> =
            model.moving_joints().filter(rubs).map(|k| model.joints()[k].name.as_str()).collect();
        if !names.is_empty() {
            let what = format!("dry friction that sticks and slips: joints {}", names.join(", "));
            report.used.push(Note::new(None, "friction", what));
        }
    }
    behavior
}

fn table_error(report: &mut Report, found: String, required: &str, remedy: &str) {
    report.errors.push(phipsi_formats::Problem::new(None, "joint_stops", found, required, remedy));
}

enum Given {
    Nothing,
    All(f64),
    Some(Vec<(usize, f64)>),
}

/// A number for all joints, or a table of numbers by joint.
fn per_joint(
    table: &mut Table<'_>,
    key: &'static str,
    [least, most]: [f64; 2],
    model: &Model,
    report: &mut Report,
) -> Given {
    let Some(node) = table.get(key) else { return Given::Nothing };
    let required = match most.is_finite() {
        true => format!("a number from {least} to {most}, or {{ JOINT = … }}"),
        false => format!("a number of {least} or more, or {{ JOINT = … }}"),
    };
    let good = |x: &f64| (least..=most).contains(x);
    if let Value::Table(_) = node.value {
        let Some(joints) = table.table(key, report) else { return Given::Nothing };
        let mut list = Vec::new();
        for entry in joints.rest() {
            let Some(k) = find_joint(table, key, &entry.key, model, report) else { continue };
            match finite(&entry.node).filter(good) {
                Some(x) if model.joints()[k].kind != JointKind::Fixed => list.push((k, x)),
                _ => {
                    let found = format!("{key} of `{}` = {}", entry.key, entry.node.value.describe());
                    table.error(Some(&entry.node), report, found, required.clone(), "correct it");
                }
            }
        }
        return Given::Some(list);
    }
    match finite(node).filter(good) {
        Some(x) => Given::All(x),
        None => {
            let found = format!("{key} = {}", node.value.describe());
            table.error(Some(node), report, found, required, format!("correct `{key}`"));
            Given::Nothing
        }
    }
}
