//! `[initial]`, `[integrator]` and `[record]`.

use super::tree::{Entry, Node, Table, Value, finite, number_list, suggestion};
use crate::folder::CHECKPOINT_S;
use crate::simulation::{Choice, DEFAULT_TOLERANCE};
use phipsi_formats::{Problem, Report};
use phipsi_model::{JointKind, Model, State};
use phipsi_molecule::{Ensemble, ensemble};
use phipsi_motion::{Method, Scheme, Tolerances};
use phipsi_recursion::Form;

/// What `[integrator]` says.
pub(crate) struct IntegratorSettings {
    pub(crate) choice: Choice,
    pub(crate) tolerances: Tolerances,
    pub(crate) t_end: f64,
    pub(crate) estimate: bool,
    pub(crate) form: Form,
    /// True where the method was left to the program.
    pub(crate) automatic: bool,
    /// The keys that are there.
    pub(crate) keys: Vec<String>,
    pub(crate) ensemble: Ensemble,
}

/// What `[initial]` says.
pub(crate) struct Start {
    pub(crate) state: State,
    /// Degrees of freedom of the joints whose position and velocity it names.
    pub(crate) named: [Vec<bool>; 2],
    /// Whether the loops are to be closed from there.
    pub(crate) assemble: bool,
}

/// Start: a given state with the joints that `[initial]` names.
pub(crate) fn initial(scene: &mut Table<'_>, model: &Model, given: State, report: &mut Report) -> Start {
    let mut state = given;
    let mut named = [vec![false; model.nv()], vec![false; model.nv()]];
    let Some(mut table) = scene.table("initial", report) else {
        return Start { state, named, assemble: false };
    };
    let assemble = table.flag("assemble", report).unwrap_or(false);
    if let Some(q) = table.table("q", report) {
        for entry in q.rest() {
            if let Value::Table(modes) = &entry.node.value {
                let range = |k: usize| model.mode_q_range(k);
                for (i, value) in mode_values("initial.q", entry, modes, model, range, report) {
                    state.q[i] = value;
                    named[0][model.joint_nv() + i - model.joint_nq()] = true;
                }
                continue;
            }
            let at = |k: usize| (model.q_range(k), "position coordinates");
            if let Some((k, values)) = joint_values("initial.q", entry, model, at, report) {
                state.q[model.q_range(k)].copy_from_slice(&values);
                named[0][model.v_range(k)].fill(true);
                check_quaternion(entry, model, k, &values, report);
            }
        }
    }
    if let Some(v) = table.table("v", report) {
        for entry in v.rest() {
            if let Value::Table(modes) = &entry.node.value {
                let range = |k: usize| model.mode_v_range(k);
                for (i, value) in mode_values("initial.v", entry, modes, model, range, report) {
                    state.v[i] = value;
                    named[1][i] = true;
                }
                continue;
            }
            let at = |k: usize| (model.v_range(k), "degrees of freedom");
            if let Some((k, values)) = joint_values("initial.v", entry, model, at, report) {
                state.v[model.v_range(k)].copy_from_slice(&values);
                named[1][model.v_range(k)].fill(true);
            }
        }
    }
    table.finish(report);
    model.normalize(&mut state.q);
    Start { state, named, assemble }
}

/// `BODY = { mode1 = … }`: places of modal coordinates and their values.
fn mode_values(
    place: &str,
    entry: &Entry,
    modes: &[Entry],
    model: &Model,
    range: impl Fn(usize) -> std::ops::Range<usize>,
    report: &mut Report,
) -> Vec<(usize, f64)> {
    let mut wrong = |line, found: String, required: String, remedy: String| {
        report.errors.push(Problem::new(line, place, found, required, remedy));
    };
    let name = entry.key.as_str();
    let is_flexible = |k: &usize| model.bodies()[*k].modes() > 0;
    let Some(k) = model.find_body(name).ok().flatten().filter(is_flexible) else {
        let names: Vec<&str> =
            (0..model.len()).filter(is_flexible).map(|k| model.bodies()[k].name.as_str()).collect();
        let required = "a flexible body of the model".into();
        wrong(entry.line, format!("modes of `{name}`"), required, suggestion(name, &names));
        return Vec::new();
    };
    let range = range(k);
    let mut values = Vec::new();
    for Entry { key, line, node } in modes {
        let number = key.strip_prefix("mode").and_then(|n| n.parse::<usize>().ok());
        match (number.filter(|n| (1..=range.len()).contains(n)), finite(node)) {
            (Some(n), Some(value)) => values.push((range.start + n - 1, value)),
            _ => {
                let found = format!("{name}.{key} = {}", node.value.describe());
                let required = format!("mode1 to mode{} and a finite number", range.len());
                wrong(*line, found, required, "correct the mode or the number".into());
            }
        }
    }
    values
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

/// Steps with bonds, angles and torsions in a step of a molecule, before everything else is read; [`integrator`] reports what is wrong.
pub(crate) fn inner_steps(root: &Node) -> usize {
    let mut unread = Report::new("");
    let integrator =
        Table::new(root, "scene", &mut unread).and_then(|mut s| s.table("integrator", &mut unread));
    integrator.map_or(1, |mut t| whole(&mut t, "inner_steps", &mut unread).unwrap_or(1) as usize)
}

/// Most steps with bonds, angles and torsions in one.
const MOST_INNER: u64 = 1000;

/// A whole number of at least 1; where it is another one, 1 after a report.
fn whole(table: &mut Table<'_>, key: &'static str, report: &mut Report) -> Option<u64> {
    let node = table.get(key)?;
    match node.value {
        Value::Integer(n) if n > 0 => Some(n as u64),
        _ => {
            let found = format!("{key} = {}", node.value.describe());
            table.error(Some(node), report, found, "a whole number, at least 1", format!("correct `{key}`"));
            Some(1)
        }
    }
}

/// Method, tolerances, end.
///
/// Of a molecule, times are in ps, the step may be given in fs, and `auto` is the midpoint method.
pub(crate) fn integrator(
    scene: &mut Table<'_>,
    breaks: usize,
    molecule: bool,
    report: &mut Report,
) -> Option<IntegratorSettings> {
    let what = if molecule { "the end of the simulation, ps" } else { "the end of the simulation, s" };
    scene.required("integrator", report, "a table with t_end")?;
    let mut table = scene.table("integrator", report)?;
    let keys = table.rest().map(|e| e.key.clone()).collect();
    table.required("t_end", report, what);
    let t_end = table.positive("t_end", false, report);
    let words = ["auto", "dop853", "tsit5", "rodas4", "rodas5p", "rk4", "midpoint"];
    let word = match table.word("method", &words, report).unwrap_or("auto") {
        "auto" if molecule => "midpoint",
        word => word,
    };
    let tolerance = |key, table: &mut Table<'_>, report: &mut Report| table.positive(key, false, report);
    let (rtol, atol) = (tolerance("rtol", &mut table, report), tolerance("atol", &mut table, report));
    let mut step = table.positive("step", false, report);
    if molecule && let Some(fs) = table.positive("step_fs", false, report) {
        if step.is_some() {
            let node = table.get("step_fs");
            table.error(node, report, "both `step` and `step_fs`", "one of them", "remove one");
        }
        step = Some(fs / 1000.0);
    }
    let max_step = table.positive("max_step", false, report).unwrap_or(f64::INFINITY);
    let estimate = table.flag("estimate", report).unwrap_or(true);
    let forms = Form::ALL.map(Form::name);
    let asked = table.word("form", &forms, report).map(|word| Form::from_name(word).unwrap_or_default());
    // One of the two alone means both; neither, the default.
    let tolerances = Tolerances {
        rtol: rtol.or(atol).unwrap_or(DEFAULT_TOLERANCE),
        atol: atol.or(rtol).unwrap_or(DEFAULT_TOLERANCE),
        max_step,
    };
    // Of numbers of size 1e-6 that matter to 1e-14, 1e-20 may be asked for; relative ones end at rounding.
    for (key, value, least) in [("rtol", rtol, 1e-14), ("atol", atol, 1e-30)] {
        if value.is_some_and(|x| !(least..=0.1).contains(&x)) {
            let node = table.get(key);
            let found = format!("{key} = {:e}", value.unwrap_or_default());
            let required = format!("a tolerance from {least:e} to 0.1");
            table.error(node, report, found, required, "choose one in this range");
        }
    }
    let ensemble = if molecule { ensemble(&mut table, step, report) } else { Ensemble::ConstantEnergy };
    if ensemble != Ensemble::ConstantEnergy && word != "midpoint" {
        let node = table.get("ensemble");
        let found = format!("ensemble = \"{}\" with method = \"{word}\"", ensemble.word());
        table.error(node, report, found, "method = \"midpoint\"", "remove `method`");
    }
    if molecule && let Some(n) = whole(&mut table, "inner_steps", report) {
        let node = table.get("inner_steps");
        if n > MOST_INNER {
            let required = format!("at most {MOST_INNER}");
            table.error(node, report, format!("inner_steps = {n}"), required, "take a shorter step");
        }
        if word != "midpoint" {
            let found = format!("inner_steps with method = \"{word}\"");
            table.error(node, report, found, "method = \"midpoint\"", "remove `inner_steps`, or `method`");
        }
    }
    let choice = match (word, step) {
        ("rk4", Some(step)) => Choice::asked(Method::Rk4 { step }),
        ("midpoint", Some(step)) => {
            let why =
                if molecule { "symplectic and reversible: the energy does not drift" } else { "asked for" };
            Choice { method: Scheme::Midpoint { step }, why: why.into() }
        }
        ("rk4" | "midpoint", None) => {
            let (unit, key) = if molecule { ("fs", "step_fs") } else { ("s", "step") };
            let found = format!("method = \"{word}\" without `{key}`");
            table.error(None, report, found, format!("a step in {unit}"), format!("add `{key} = …`"));
            Choice::automatic(tolerances, breaks)
        }
        (word, Some(_)) => {
            let node = table.get("step");
            let found = format!("`step` with method = \"{word}\"");
            let remedy = "use method = \"rk4\" or \"midpoint\", or rtol and atol";
            table.error(node, report, found, "a method of fixed step", remedy);
            Choice::automatic(tolerances, breaks)
        }
        ("dop853", None) => Choice::asked(Method::Dop853),
        ("tsit5", None) => Choice::asked(Method::Tsit5),
        ("rodas4", None) => Choice::asked(Method::Rodas4),
        ("rodas5p", None) => Choice::asked(Method::Rodas5p),
        _ => Choice::automatic(tolerances, breaks),
    };
    if word == "midpoint" && asked.is_some() {
        let remedy = "remove form, or use an explicit method";
        let node = table.get("form");
        table.error(node, report, "form with method = \"midpoint\"", "a method with accelerations", remedy);
    }
    if ["rk4", "midpoint"].contains(&word) && (rtol.is_some() || atol.is_some()) {
        let remedy = "remove rtol and atol, or use an adaptive method";
        let found = format!("rtol or atol with method = \"{word}\"");
        table.error(None, report, found, "a step alone", remedy);
    }
    if let (Scheme::Midpoint { step }, Some(t_end)) = (choice.method, t_end)
        && let step = ensemble.stride() as f64 * step
        && !is_multiple(t_end, step)
    {
        let node = table.get("t_end");
        let found = format!("t_end = {t_end} with {} of {step}", pieces(&ensemble).1);
        let remedy = format!("use t_end = {}", (t_end / step).round().max(1.0) * step);
        table.error(node, report, found, format!("a whole number of {}", pieces(&ensemble).0), remedy);
    }
    if let (Some(step), Some(t_end)) = (choice.method.fixed_step(), t_end)
        && t_end / step > 1e10
    {
        let found = format!("{:e} steps", t_end / step);
        table.error(None, report, found, "at most 1e10 steps", "use a larger step");
    }
    table.finish(report);
    let form = asked.unwrap_or_default();
    Some(IntegratorSettings {
        choice,
        tolerances,
        t_end: t_end?,
        estimate,
        form,
        automatic: word == "auto",
        keys,
        ensemble,
    })
}

/// What a run is made of, several and one.
pub(crate) fn pieces(ensemble: &Ensemble) -> (&'static str, &'static str) {
    if ensemble.stride() > 1 { ("trajectories", "a trajectory") } else { ("steps", "a step") }
}

/// `ensemble` with its parameter; a parameter of another one is refused. `step`: ps.
fn ensemble(table: &mut Table<'_>, step: Option<f64>, report: &mut Report) -> Ensemble {
    let word = table.word("ensemble", &Ensemble::WORDS, report).unwrap_or("nve");
    let friction = table.positive("friction_per_ps", true, report);
    let relaxation = table.positive("relaxation_ps", false, report);
    // Any number of steps is a whole number of these: one problem is told once.
    let steps = whole(table, "trajectory_steps", report);
    for (key, owner) in
        [("friction_per_ps", "langevin"), ("relaxation_ps", "nose_hoover"), ("trajectory_steps", "hmc")]
    {
        if word != owner && table.get(key).is_some() {
            let node = table.get(key);
            let found = format!("{key} with ensemble = \"{word}\"");
            let remedy = format!("remove `{key}`, or set ensemble = \"{owner}\"");
            table.error(node, report, found, format!("ensemble = \"{owner}\""), remedy);
        }
    }
    match word {
        "langevin" => Ensemble::Langevin { friction: friction.unwrap_or(ensemble::FRICTION) },
        "nose_hoover" => Ensemble::NoseHoover { relaxation: relaxation.unwrap_or(ensemble::RELAXATION) },
        "hmc" => {
            let own = step.map_or(1.0, |h| (ensemble::TRAJECTORY / h).round().max(1.0)) as u64;
            Ensemble::HybridMonteCarlo { steps: steps.unwrap_or(own) }
        }
        _ => Ensemble::ConstantEnergy,
    }
}

/// Most samples of a run.
const MOST_SAMPLES: f64 = 1e8;

/// True if x is a whole number of steps, to a millionth of one.
pub(crate) fn is_multiple(x: f64, step: f64) -> bool {
    let n = x / step;
    n > 0.5 && (n - n.round()).abs() < 1e-6
}

/// Interval of the samples, and wall time between checkpoints. The midpoint method has states at its steps only.
pub(crate) fn record(
    scene: &mut Table<'_>,
    IntegratorSettings { t_end, choice, ensemble, .. }: &IntegratorSettings,
    report: &mut Report,
) -> (f64, f64) {
    let every = match choice.method {
        Scheme::Midpoint { step } => {
            let step = ensemble.stride() as f64 * step;
            (t_end / 200.0 / step).ceil() * step
        }
        Scheme::Explicit(_) => t_end / 200.0,
    };
    let default = (every, CHECKPOINT_S);
    let Some(mut table) = scene.table("record", report) else { return default };
    let every = table.positive("every", false, report).unwrap_or(default.0);
    if let Scheme::Midpoint { step } = choice.method
        && let step = ensemble.stride() as f64 * step
        && !is_multiple(every, step)
    {
        let node = table.get("every");
        let found = format!("every = {every} with {} of {step}", pieces(ensemble).1);
        let remedy = format!("use every = {}", (every / step).round().max(1.0) * step);
        table.error(node, report, found, format!("a whole number of {}", pieces(ensemble).0), remedy);
    }
    let checkpoint_s = table.positive("checkpoint_s", true, report).unwrap_or(default.1);
    if t_end / every > MOST_SAMPLES {
        let node = table.get("every");
        let found = format!("{:e} samples", t_end / every);
        table.error(node, report, found, format!("at most {MOST_SAMPLES:e}"), "record less often");
    }
    table.finish(report);
    (every, checkpoint_s)
}
