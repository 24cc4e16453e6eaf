//! `[initial]`, `[integrator]` and `[record]`.

use super::tree::{Entry, Node, Table, finite, number_list, suggestion};
use crate::folder::CHECKPOINT_S;
use crate::simulation::{Choice, DEFAULT_TOLERANCE};
use phipsi_formats::{Problem, Report};
use phipsi_model::{JointKind, Model, State};
use phipsi_motion::{Method, Tolerances};

/// What `[integrator]` says.
pub(crate) struct IntegratorSettings {
    pub(crate) choice: Choice,
    pub(crate) tolerances: Tolerances,
    pub(crate) t_end: f64,
    pub(crate) estimate: bool,
}

/// Start: the neutral state with the joints that `[initial]` names.
pub(crate) fn initial(scene: &mut Table<'_>, model: &Model, report: &mut Report) -> State {
    let mut state = State { q: model.neutral(), v: vec![0.0; model.nv()], t: 0.0 };
    let Some(mut table) = scene.table("initial", report) else { return state };
    if let Some(q) = table.table("q", report) {
        for entry in q.rest() {
            let at = |k: usize| (model.q_range(k), "position coordinates");
            if let Some((k, values)) = joint_values("initial.q", entry, model, at, report) {
                state.q[model.q_range(k)].copy_from_slice(&values);
                check_quaternion(entry, model, k, &values, report);
            }
        }
    }
    if let Some(v) = table.table("v", report) {
        for entry in v.rest() {
            let at = |k: usize| (model.v_range(k), "degrees of freedom");
            if let Some((k, values)) = joint_values("initial.v", entry, model, at, report) {
                state.v[model.v_range(k)].copy_from_slice(&values);
            }
        }
    }
    table.finish(report);
    model.normalize(&mut state.q);
    state
}

fn joint_values(
    place: &str,
    entry: &Entry,
    model: &Model,
    range: impl Fn(usize) -> (std::ops::Range<usize>, &'static str),
    report: &mut Report,
) -> Option<(usize, Vec<f64>)> {
    let mut wrong = |found: String, required: String, remedy: String| {
        report.errors.push(Problem::new(entry.line, place, found, required, remedy));
        None
    };
    let name = entry.key.as_str();
    let found = model.find_joint(name).ok().filter(|&k| model.joints()[k].kind != JointKind::Fixed);
    let Some(k) = found else {
        let names: Vec<&str> = model.moving_joints().map(|k| model.joints()[k].name.as_str()).collect();
        let remedy = suggestion(name, &names);
        return wrong(format!("joint `{name}`"), "a moving joint of the model".into(), remedy);
    };
    let (range, what) = range(k);
    let values = match finite(&entry.node) {
        Some(x) => Some(vec![x]),
        None => number_list(&entry.node),
    };
    match values {
        Some(values) if values.len() == range.len() => Some((k, values)),
        _ => {
            let found = format!("{name} = {}", entry.node.value.describe());
            let kind = model.joints()[k].kind.word();
            let required = format!("{} finite numbers: the {what} of a {kind} joint", range.len());
            wrong(found, required, "see `phipsi conventions` for their order".into())
        }
    }
}

fn check_quaternion(entry: &Entry, model: &Model, k: usize, values: &[f64], report: &mut Report) {
    let quaternion = match model.joints()[k].kind {
        JointKind::Spherical => values,
        JointKind::Free => &values[3..],
        _ => return,
    };
    let norm = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
    let problem = |found: String| {
        let required = "a unit quaternion x, y, z, w";
        Problem::new(entry.line, "initial.q", found, required, "scale it to unit length")
    };
    if !(norm.is_finite() && norm > 1e-100) {
        report.errors.push(problem(format!("{} has a quaternion of length {norm:e}", entry.key)));
    } else if (norm - 1.0).abs() > 1e-6 {
        let found = format!("{} has a quaternion of length {norm}; it is scaled to 1", entry.key);
        report.warnings.push(problem(found));
    }
}

/// The end of the run before everything else is read; 0 where there is none, which [`integrator`] reports.
pub(crate) fn end(root: &Node) -> f64 {
    let mut unread = Report::new("");
    let integrator =
        Table::new(root, "scene", &mut unread).and_then(|mut s| s.table("integrator", &mut unread));
    integrator.and_then(|mut t| t.positive("t_end", false, &mut unread)).unwrap_or(0.0)
}

/// Method, tolerances, end.
pub(crate) fn integrator(
    scene: &mut Table<'_>,
    breaks: usize,
    report: &mut Report,
) -> Option<IntegratorSettings> {
    let what = "the end of the simulation, s";
    scene.required("integrator", report, "a table with t_end")?;
    let mut table = scene.table("integrator", report)?;
    table.required("t_end", report, what);
    let t_end = table.positive("t_end", false, report);
    let word = table.word("method", &["auto", "dop853", "tsit5", "rk4"], report).unwrap_or("auto");
    let tolerance = |key, table: &mut Table<'_>, report: &mut Report| table.positive(key, false, report);
    let (rtol, atol) = (tolerance("rtol", &mut table, report), tolerance("atol", &mut table, report));
    let step = table.positive("step", false, report);
    let max_step = table.positive("max_step", false, report).unwrap_or(f64::INFINITY);
    let estimate = table.flag("estimate", report).unwrap_or(true);
    // One of the two alone means both; neither, the default.
    let tolerances = Tolerances {
        rtol: rtol.or(atol).unwrap_or(DEFAULT_TOLERANCE),
        atol: atol.or(rtol).unwrap_or(DEFAULT_TOLERANCE),
        max_step,
    };
    for (key, value) in [("rtol", rtol), ("atol", atol)] {
        if value.is_some_and(|x| !(1e-14..=0.1).contains(&x)) {
            let node = table.get(key);
            let found = format!("{key} = {:e}", value.unwrap_or_default());
            table.error(node, report, found, "a tolerance from 1e-14 to 0.1", "choose one in this range");
        }
    }
    let choice = match (word, step) {
        ("rk4", Some(step)) => Choice::asked(Method::Rk4 { step }),
        ("rk4", None) => {
            table.error(None, report, "method = \"rk4\" without `step`", "a step in s", "add `step = …`");
            Choice::automatic(tolerances, breaks)
        }
        (word, Some(_)) => {
            let node = table.get("step");
            let found = format!("`step` with method = \"{word}\"");
            let remedy = "use method = \"rk4\", or rtol and atol";
            table.error(node, report, found, "a method of fixed step", remedy);
            Choice::automatic(tolerances, breaks)
        }
        ("dop853", None) => Choice::asked(Method::Dop853),
        ("tsit5", None) => Choice::asked(Method::Tsit5),
        _ => Choice::automatic(tolerances, breaks),
    };
    if word == "rk4" && (rtol.is_some() || atol.is_some()) {
        let remedy = "remove rtol and atol, or use an adaptive method";
        table.error(None, report, "rtol or atol with method = \"rk4\"", "a step alone", remedy);
    }
    if let (Method::Rk4 { step }, Some(t_end)) = (choice.method, t_end)
        && t_end / step > 1e10
    {
        let found = format!("{:e} steps", t_end / step);
        table.error(None, report, found, "at most 1e10 steps", "use a larger step");
    }
    table.finish(report);
    Some(IntegratorSettings { choice, tolerances, t_end: t_end?, estimate })
}

/// Most samples of a run.
const MOST_SAMPLES: f64 = 1e8;

/// Interval of the samples, and wall time between checkpoints.
pub(crate) fn record(scene: &mut Table<'_>, t_end: f64, report: &mut Report) -> (f64, f64) {
    let default = (t_end / 200.0, CHECKPOINT_S);
    let Some(mut table) = scene.table("record", report) else { return default };
    let every = table.positive("every", false, report).unwrap_or(default.0);
    let checkpoint_s = table.positive("checkpoint_s", true, report).unwrap_or(default.1);
    if t_end / every > MOST_SAMPLES {
        let node = table.get("every");
        let found = format!("{:e} samples", t_end / every);
        table.error(node, report, found, format!("at most {MOST_SAMPLES:e}"), "record less often");
    }
    table.finish(report);
    (every, checkpoint_s)
}
