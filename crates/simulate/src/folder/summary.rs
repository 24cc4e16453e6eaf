//! The short table of a run for people, printed by the command and shown on the page.

use super::results::{Results, RunFile};

/// Rows of the table: what, and lines about it.
pub fn summary(file: &RunFile) -> Vec<(&'static str, Vec<String>)> {
    let mut rows = vec![("scene", vec![file.title.clone()])];
    if let Some(results) = &file.results {
        rows.extend(of_results(file, results));
    }
    for (name, lines) in [("approximated", &file.approximated), ("warnings", &file.warnings)] {
        if !lines.is_empty() {
            rows.push((name, lines.clone()));
        }
    }
    rows.push(("left out", file.plan.left_out.clone()));
    rows
}

fn of_results(file: &RunFile, results: &Results) -> Vec<(&'static str, Vec<String>)> {
    let plan = &file.plan;
    let Results { steps, rejected, evaluations, .. } = results;
    let duration = match results.end.t == plan.t_end {
        true => format!("{} s", short(plan.t_end)),
        false => format!("{} of {} s", short(results.end.t), short(plan.t_end)),
    };
    let mut rows = vec![
        ("duration", vec![duration]),
        ("method", vec![format!("{} ({})", plan.describe(), plan.why)]),
        ("steps", vec![format!("{steps} ({rejected} rejected), {evaluations} evaluations")]),
        ("wall time", vec![format!("{:.3} s", results.wall_s)]),
        ("energy error", vec![format!("{:.1e}", results.energy_error)]),
    ];
    if let Some(m) = &results.momentum_error {
        rows.push(("momentum error", vec![format!("angular {:.1e}, linear {:.1e}", m.angular, m.linear)]));
    }
    rows.push(("estimated error", vec![estimate(results)]));
    if let Some(e) = results.reference_error {
        rows.push(("reference error", vec![format!("{e:.1e}")]));
    }
    let outputs: Vec<String> =
        results.outputs.iter().map(|(name, x)| format!("{name} = {}", number(x))).collect();
    if !outputs.is_empty() {
        rows.push(("outputs", outputs));
    }
    rows
}

fn estimate(results: &Results) -> String {
    let Some(e) = &results.error_estimate else { return "not made".into() };
    let how = format!("{}, {} evaluations", e.how, e.evaluations);
    match (e.q, e.v, e.horizon) {
        (Some(q), Some(v), _) => format!("{q:.1e} in q, {v:.1e} in v at the end ({how})"),
        (_, _, Some(t)) => format!("small up to t = {} s, unknown after it ({how})", short(t)),
        _ => format!("unknown ({how})"),
    }
}

/// An output in all its digits, or the word that JSON has no number for.
fn number(x: &serde_json::Value) -> String {
    x.as_f64().map_or("not finite".into(), |x| format!("{x:?}"))
}

/// A number in a few digits.
pub fn short(x: f64) -> String {
    if x == 0.0 || (1e-3..1e6).contains(&x.abs()) {
        let text = format!("{x:.6}");
        text.trim_end_matches('0').trim_end_matches('.').into()
    } else {
        format!("{x:.2e}")
    }
}
