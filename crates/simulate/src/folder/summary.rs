//! The short table of a run for people, printed by the command and shown on the page.

use super::results::{Results, RunFile, Status};

/// Most events that are shown.
const MOST_EVENTS: usize = 12;

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
    let unit = &plan.time_unit;
    let duration = match file.status {
        Status::Finished => match &results.ended_by {
            Some(event) => {
                format!("{} of {} {unit}: event `{event}`", short(results.end.t), short(plan.t_end))
            }
            None => format!("{} {unit}", short(plan.t_end)),
        },
        _ => format!("{} of {} {unit}", short(results.end.t), short(plan.t_end)),
    };
    let mut rows = vec![
        ("duration", vec![duration]),
        ("method", vec![format!("{} ({})", plan.describe(), plan.why)]),
        ("steps", vec![format!("{steps} ({rejected} rejected), {evaluations} evaluations")]),
        ("wall time", vec![format!("{:.3} s", results.wall_s)]),
        ("energy error", vec![format!("{:.1e}", results.energy_error)]),
    ];
    if let Some(form) = plan.describe_form() {
        rows.insert(2, ("forward dynamics", vec![form]));
    }
    if let Some([ensemble, distribution]) = plan.describe_ensemble() {
        rows.insert(2, ("ensemble", vec![ensemble]));
        rows.insert(3, ("distribution", vec![distribution]));
    }
    if !results.changes.is_empty() {
        rows.push(("freeze and thaw", results.changes.iter().map(|c| c.describe()).collect()));
    }
    if let Some(acceptance) = results.acceptance {
        rows.push(("acceptance", vec![format!("{acceptance:.3}")]));
    }
    if let Some(refused) = results.refused.filter(|n| *n > 0) {
        rows.push(("refused", vec![format!("{refused} trajectories or drifts that did not converge")]));
    }
    if let Some(m) = &results.momentum_error {
        rows.push(("momentum error", vec![format!("angular {:.1e}, linear {:.1e}", m.angular, m.linear)]));
    }
    if let Some(c) = &results.closure_residual {
        let taken = results.energy_removed.unwrap_or_default();
        let line = format!(
            "{:.1e} in position, {:.1e} in velocity; projections took {taken:.1e} J",
            c.position, c.velocity
        );
        rows.push(("closure residual", vec![line]));
    }
    if let Some(kelvin) = results.temperature_K {
        rows.push(("temperature", vec![format!("{kelvin:.0} K on average")]));
    }
    if let Some(d) = &results.drift {
        let energy = if unit == "ps" { "kJ/mol" } else { "J" };
        let each = d.slope.abs() / d.degrees_of_freedom.max(1) as f64;
        rows.push((
            "energy drift",
            vec![
                format!(
                    "{:.1e} ± {:.0e} {energy}/{unit}, {each:.1e} per degree of freedom",
                    d.slope, d.error
                ),
                format!("noise {:.2e} {energy} about the line", d.noise),
            ],
        ));
    }
    if results.drift.is_none() || results.error_estimate.is_some() {
        rows.push(("estimated error", vec![estimate(results, unit)]));
    }
    if let Some(e) = results.reference_error {
        rows.push(("reference error", vec![format!("{e:.1e}")]));
    }
    if !results.events.is_empty() {
        rows.push(("events", events(results, unit)));
    }
    let outputs: Vec<String> =
        results.outputs.iter().map(|(name, x)| format!("{name} = {}", number(x))).collect();
    if !outputs.is_empty() {
        rows.push(("outputs", outputs));
    }
    rows
}

/// The first events, and how many more there are.
fn events(results: &Results, unit: &str) -> Vec<String> {
    let line = |e: &crate::event_record::EventRecord| format!("t = {} {unit}: {}", e.t, e.what);
    let shown = if results.events.len() <= MOST_EVENTS { MOST_EVENTS } else { MOST_EVENTS - 1 };
    let mut lines: Vec<String> = results.events.iter().take(shown).map(line).collect();
    if results.event_count > lines.len() {
        lines.push(format!("… {} more: run.json has the first 1000", results.event_count - lines.len()));
    }
    lines
}

fn estimate(results: &Results, unit: &str) -> String {
    let Some(e) = &results.error_estimate else { return "not made".into() };
    let how = format!("{}, {} evaluations", e.how, e.evaluations);
    match (e.q, e.v, e.horizon) {
        (Some(q), Some(v), _) => format!("{q:.1e} in q, {v:.1e} in v at the end ({how})"),
        (_, _, Some(t)) => format!("small up to t = {} {unit}, unknown after it ({how})", short(t)),
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
