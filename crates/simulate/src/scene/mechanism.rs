//! The mechanism of a scene: a URDF file, bodies and joints written in the scene, or both.

use super::SceneFile;
use super::closure::{self, ReadClosure};
use super::flexible::{Files, read_flexible};
use super::molecule::MoleculeScene;
use super::tree::{Table, Value, suggestion};
use phipsi_closure::choose_tree;
use phipsi_formats::urdf::{Mimic, UrdfOptions, urdf_builder_file};
use phipsi_formats::{Note, Problem, Report, joint_kind};
use phipsi_model::{
    Base, Body, Coupling, Inertia, Joint, JointKind, Limits, Model, ModelBuilder, ModelErrors, Placement,
    Severity, Subject,
};
use phipsi_motion::MovingClosure;
use std::collections::HashMap;
use std::path::Path;

/// What `[model]`, `[[body]]` and `[[joint]]`, or `[molecule]`, give.
pub(crate) struct Mechanism {
    pub(crate) model: Model,
    /// Files that were read, besides the scene.
    pub(crate) files: Vec<SceneFile>,
    /// Reports on them.
    pub(crate) reports: Vec<Report>,
    /// Speed at which dry friction is regularised, where it is.
    pub(crate) friction_speed: Option<f64>,
    /// Rows of closures that move.
    pub(crate) moving: Vec<MovingClosure>,
    /// What a molecule has besides.
    pub(crate) molecule: Option<MoleculeScene>,
}

/// Reads the mechanism; `None` if there are errors, in `report` or in those of the files, which are returned then.
pub(crate) fn read(
    scene: &mut Table<'_>,
    folder: &Path,
    t_end: f64,
    report: &mut Report,
) -> Result<Mechanism, Vec<Report>> {
    let mut reports = Vec::new();
    let mut files = Vec::new();
    let mut builder = ModelBuilder::new("scene");
    let mut options = UrdfOptions::default();
    let mut friction_speed = None;
    // Names that stay what they are where the tree is chosen; `None`: the tree is the given one.
    let mut kept: Option<Vec<String>> = None;
    let has_bodies = scene.has("body");
    if let Some(mut table) = scene.table("model", report) {
        if let Some(word) = table.word("base", &["fixed", "free"], report) {
            options.base = if word == "free" { Base::Free } else { Base::Fixed };
        }
        if let Some(word) = table.word("mimic", &["closure", "free"], report) {
            options.mimic = if word == "free" { Mimic::Free } else { Mimic::Closure };
        }
        let keep = table.texts("keep", report).unwrap_or_default();
        kept = (table.word("tree", &["given", "chosen"], report) == Some("chosen")).then_some(keep);
        let gravity = table.numbers::<3>("gravity", report);
        friction_speed = table.positive("friction_speed", false, report);
        if let Some(urdf) = table.text("urdf", report) {
            let path = folder.join(urdf);
            let loaded = urdf_builder_file(&path, &options);
            if let Some(read) = loaded.value {
                builder = read;
            }
            reports.push(loaded.report);
            files.push(SceneFile { key: "model.urdf".into(), path });
        } else if !has_bodies {
            let remedy = "add `urdf = \"…\"` to [model], or describe [[body]] and [[joint]] here";
            table.error(None, report, "no mechanism", "a URDF file or bodies", remedy);
        }
        if let Some(gravity) = gravity {
            builder = builder.gravity(gravity);
        }
        table.finish(report);
    } else if !has_bodies {
        let remedy = "add [model] with `urdf = \"…\"`, or describe [[body]] and [[joint]]";
        scene.error(None, report, "no mechanism", "[model] or [[body]]", remedy);
    }
    builder = builder.base(options.base);
    let mut lines = HashMap::new();
    for (index, mut table) in scene.tables("body", report).into_iter().enumerate() {
        let mut found = Files { folder, read: &mut files, reports: &mut reports };
        if let Some(body) = read_body(&mut table, index, &mut found, report) {
            lines.insert(format!("body `{}`", body.name), table.line);
            builder = builder.body(body);
        }
        table.finish(report);
    }
    for mut table in scene.tables("joint", report) {
        let node = table.text("node", report);
        if let Some((joint, parent, child, coupling)) = read_joint(&mut table, report) {
            lines.insert(format!("joint `{}`", joint.name), table.line);
            if let Some(coupling) = coupling {
                if options.mimic == Mimic::Free {
                    let what =
                        format!("mimic of joint `{}` dropped: the joint moves freely", coupling.source);
                    report.approximated.push(Note::new(table.line, format!("joint `{}`", joint.name), what));
                } else {
                    builder = builder.coupling(coupling);
                }
            }
            builder = match node {
                Some(node) => builder.joint_at_node(joint, parent, node, child),
                None => builder.joint(joint, parent, child),
            };
        }
        table.finish(report);
    }
    let closures = closure::read(scene, t_end, report);
    // URDF has couplings, but no closures.
    let moving = closure::moving(&closures, 0);
    for read in &closures {
        lines.insert(format!("closure `{}`", read.closure.name), read.line);
        builder = builder.closure(read.closure.clone());
    }
    // The reader of a URDF file has checked it; only what was added here can be new.
    if (has_bodies || !closures.is_empty())
        && report.errors.is_empty()
        && reports.iter().all(|r: &Report| r.errors.is_empty())
    {
        for violation in builder.check() {
            let place = violation.subject.to_string();
            let line = match violation.subject {
                Subject::Model => None,
                _ => lines.get(&place).copied().flatten(),
            };
            let problem = Problem::new(line, place, violation.found, violation.required, violation.remedy);
            match violation.severity {
                Severity::Error => report.errors.push(problem),
                Severity::Warning => report.warnings.push(problem),
            }
        }
    }
    if !report.errors.is_empty() || reports.iter().any(|r| !r.errors.is_empty()) {
        return Err(reports);
    }
    let built = builder.build().and_then(|model| match kept {
        Some(kept) => on_chosen_tree(&model, kept, &closures, report),
        None => Ok((model, moving)),
    });
    match built {
        Ok(_) if !report.errors.is_empty() => Err(reports),
        Ok((model, moving)) => {
            Ok(Mechanism { model, files, reports, friction_speed, moving, molecule: None })
        }
        Err(errors) => {
            report.errors.extend(
                errors
                    .0
                    .into_iter()
                    .map(|v| Problem::new(None, v.subject.to_string(), v.found, v.required, v.remedy)),
            );
            Err(reports)
        }
    }
}

/// The model on the tree that its loops ask for, with its moving closures, which stay closures.
fn on_chosen_tree(
    model: &Model,
    mut kept: Vec<String>,
    closures: &[ReadClosure],
    report: &mut Report,
) -> Result<(Model, Vec<MovingClosure>), ModelErrors> {
    for name in &kept {
        if model.find_joint(name).is_err() && !model.closures().iter().any(|c| c.name == *name) {
            let required = "the name of a joint or a closure";
            report.errors.push(Problem::new(
                None,
                "model.keep",
                format!("`{name}`"),
                required,
                "correct the name",
            ));
        }
    }
    kept.extend(closures.iter().filter(|c| !c.moving.is_empty()).map(|c| c.closure.name.clone()));
    let names: Vec<&str> = kept.iter().map(String::as_str).collect();
    let choice = choose_tree(model, &names)?;
    report.used.push(Note::new(None, "tree", choice.to_string()));
    let mut moving = closure::moving(closures, 0);
    for m in &mut moving {
        let name = &closures[m.closure].closure.name;
        m.closure = choice.model.closures().iter().position(|c| c.name == *name).unwrap_or(m.closure);
    }
    Ok((choice.model, moving))
}

/// `{ xyz = […], rpy = […] }`; zeros where missing.
pub(crate) fn pose(table: &mut Table<'_>, key: &'static str, report: &mut Report) -> Placement {
    let Some(mut origin) = table.table(key, report) else { return Placement::IDENTITY };
    let xyz = origin.numbers::<3>("xyz", report).unwrap_or_default();
    let rpy = origin.numbers::<3>("rpy", report).unwrap_or_default();
    origin.finish(report);
    Placement::from_xyz_rpy(xyz, rpy)
}

fn read_body(
    table: &mut Table<'_>,
    index: usize,
    files: &mut Files<'_>,
    report: &mut Report,
) -> Option<Body> {
    let name = table.required_text("name", report);
    if let Some(name) = name {
        table.place = format!("body `{name}`");
    }
    let flexible = match table.table("flexible", report) {
        None => None,
        Some(mut flexible) => {
            let body = read_flexible(&mut flexible, (name.unwrap_or("body"), index), files, report);
            flexible.finish(report);
            if table.has("inertial") {
                let remedy = "remove `inertial`; a payload is a body of its own on a fixed joint";
                table.error(None, report, "`inertial` of a flexible body", "one of the two", remedy);
            }
            Some(body)
        }
    };
    let inertia = match table.table("inertial", report) {
        None => Inertia::ZERO,
        Some(mut inertial) => {
            let frame = pose(&mut inertial, "origin", report);
            inertial.required("mass", report, "a mass in kg");
            let mass = inertial.number("mass", report).unwrap_or_default();
            let mut tensor = [0.0; 6];
            if let Some(mut moments) = inertial.table("inertia", report) {
                for (value, key) in tensor.iter_mut().zip(["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]) {
                    *value = moments.number(key, report).unwrap_or_default();
                }
                moments.finish(report);
            }
            inertial.finish(report);
            Inertia { mass, frame, tensor }
        }
    };
    match flexible {
        None => Some(Body::new(name?, inertia)),
        Some(flexible) => Some(Body::flexible(name?, flexible?)),
    }
}

type ReadJoint<'a> = (Joint, &'a str, &'a str, Option<Coupling>);

fn read_joint<'a>(table: &mut Table<'a>, report: &mut Report) -> Option<ReadJoint<'a>> {
    let name = table.required_text("name", report);
    if let Some(name) = name {
        table.place = format!("joint `{name}`");
    }
    let word = table.required_text("type", report);
    let parent = table.required_text("parent", report);
    let child = table.required_text("child", report);
    let placement = pose(table, "origin", report);
    let axis = table.numbers::<3>("axis", report);
    let second = table.numbers::<3>("axis2", report);
    let pitch = table.number("pitch", report);
    let kind = word.and_then(|word| match joint_kind(word, axis, second, pitch) {
        Ok(kind) => Some(kind),
        Err(e) => {
            let node = table.get("type");
            table.error(node, report, e.found, e.required, e.remedy);
            None
        }
    });
    let mut limits = Limits::default();
    if let Some(mut limit) = table.table("limit", report) {
        let [lower, upper] = ["lower", "upper"].map(|key| limit.number(key, report));
        if lower.is_some() || upper.is_some() {
            limits.position = Some([lower.unwrap_or(f64::NEG_INFINITY), upper.unwrap_or(f64::INFINITY)]);
        }
        limits.velocity = limit.positive("velocity", false, report);
        limits.effort = limit.positive("effort", false, report);
        limit.finish(report);
    }
    let (mut damping, mut friction) = (0.0, 0.0);
    if let Some(mut dynamics) = table.table("dynamics", report) {
        damping = dynamics.number("damping", report).unwrap_or_default();
        friction = dynamics.number("friction", report).unwrap_or_default();
        dynamics.finish(report);
    }
    let mut coupling = None;
    if let Some(mut mimic) = table.table("mimic", report) {
        let source = mimic.required_text("joint", report);
        let multiplier = mimic.number("multiplier", report).unwrap_or(1.0);
        let offset = mimic.number("offset", report).unwrap_or_default();
        mimic.finish(report);
        coupling = Some(Coupling { joint: name?.into(), source: source?.into(), multiplier, offset });
    }
    let joint = Joint { name: name?.into(), kind: kind?, placement, limits, damping, friction };
    Some((joint, parent?, child?, coupling))
}

/// A joint by the user's name, and one of its degrees of freedom.
pub(crate) struct JointDof {
    /// Index in q of the coordinate whose rate this is, where there is one.
    pub(crate) coordinate: Option<usize>,
    /// Index in v.
    pub(crate) dof: usize,
}

/// The joint under `key` and its `component` (0 where missing).
pub(crate) fn joint_dof(
    table: &mut Table<'_>,
    key: &'static str,
    model: &Model,
    report: &mut Report,
) -> Option<JointDof> {
    let name = table.required_text(key, report)?;
    let component = table.get("component").map(|n| n.value.clone());
    let k = find_joint(table, key, name, model, report)?;
    let joint = &model.joints()[k];
    let nv = joint.kind.nv();
    let component = match component {
        None if nv <= 1 => 0,
        Some(Value::Integer(i)) if usize::try_from(i).is_ok_and(|i| i < nv) => i as usize,
        given => {
            let found = match given {
                Some(value) => format!("component = {}", value.describe()),
                None => format!("no `component` for a {} joint", joint.kind.word()),
            };
            let required = format!("a degree of freedom of joint `{name}`, 0 … {}", nv.saturating_sub(1));
            let node = table.get(key);
            table.error(node, report, found, required, "add `component = …`");
            return None;
        }
    };
    Some(JointDof {
        coordinate: coordinate(&joint.kind, component).map(|c| model.q_offset(k) + c),
        dof: model.v_offset(k) + component,
    })
}

/// The moving joint of a name.
pub(crate) fn find_joint(
    table: &mut Table<'_>,
    key: &'static str,
    name: &str,
    model: &Model,
    report: &mut Report,
) -> Option<usize> {
    let node = table.get(key);
    let found = model.find_joint(name).ok().filter(|&k| model.joints()[k].kind != JointKind::Fixed);
    if found.is_none() {
        let names: Vec<&str> = model.moving_joints().map(|k| model.joints()[k].name.as_str()).collect();
        let what = match model.find_joint(name) {
            Ok(_) => format!("{key} = {name:?}, a fixed joint"),
            Err(_) => format!("{key} = {name:?}"),
        };
        table.error(node, report, what, "a moving joint of the model", named(name, &names));
    }
    found
}

/// The body of a name; `Some(None)` is the world.
pub(crate) fn find_body(
    table: &mut Table<'_>,
    key: &'static str,
    model: &Model,
    report: &mut Report,
) -> Option<Option<usize>> {
    let name = table.required_text(key, report)?;
    let node = table.get(key);
    match model.find_body(name) {
        Ok(body) => Some(body),
        Err(_) => {
            let names: Vec<&str> = model.bodies().iter().map(|b| b.name.as_str()).collect();
            let what = format!("{key} = {name:?}");
            table.error(node, report, what, "a body of the model, or \"world\"", named(name, &names));
            None
        }
    }
}

/// The nearest name, or the first few there are.
fn named(word: &str, names: &[&str]) -> String {
    match suggestion(word, names) {
        s if s.starts_with("did") => s,
        _ => {
            let more = if names.len() > 8 { ", …" } else { "" };
            format!("there are: {}{more}", names[..names.len().min(8)].join(", "))
        }
    }
}

/// The coordinate whose rate is component i of the velocity, where the joint has one.
fn coordinate(kind: &JointKind, i: usize) -> Option<usize> {
    match kind {
        JointKind::Spherical | JointKind::Free => None,
        // q: x, y, angle; v: ω, v_x, v_y. Only the angle's rate is a component of v.
        JointKind::Planar { .. } => (i == 0).then_some(2),
        _ => Some(i),
    }
}
