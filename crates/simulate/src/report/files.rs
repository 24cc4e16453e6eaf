//! `index.html`, `runs.csv` and `report.json` of a report.

use super::Report;
use super::beyond::Beyond;
use super::study::Trial;
use crate::error::SimulateError;
use crate::folder::checkpoint::replace;
use crate::folder::summary::short;
use crate::page::{Chart, PageData, Series, render};
use serde_json::{Value, json};
use std::path::Path;

/// Writes all files, each replaced as a whole.
///
/// # Errors
/// [`SimulateError::File`].
pub fn write(report: &Report, folder: &Path) -> Result<(), SimulateError> {
    replace(&folder.join("runs.csv"), csv(report).as_bytes())?;
    let mut text = report.to_json(folder).to_string();
    text.push('\n');
    replace(&folder.join("report.json"), text.as_bytes())?;
    replace(&folder.join("index.html"), page(report).as_bytes())
}

/// One row per run; empty where there is no such number.
pub fn csv(report: &Report) -> String {
    let mut text = String::from(
        "method,tolerance,step,error_q,error_v,error_end_q,error_end_v,energy_error,energy_drift,energy_noise,angular_momentum_error,\
         linear_momentum_error,closure_position,closure_velocity,reference_error,kinetic_beyond,kinetic_beyond_error,\
         kinetic_beyond_deviation,steps,rejected,evaluations,wall_s,failed\n",
    );
    for t in &report.trials {
        let number = |x: Option<f64>| x.filter(|x| x.is_finite()).map_or(String::new(), |x| format!("{x:e}"));
        let kinetic = t.beyond.first();
        let numbers = [
            t.tolerance,
            t.step,
            t.error_q,
            t.error_v,
            t.error_end.map(|e| e[0]),
            t.error_end.map(|e| e[1]),
            Some(t.energy_error),
            t.drift.map(|d| d.slope),
            t.drift.map(|d| d.noise),
            t.momentum_error.map(|m| m[0]),
            t.momentum_error.map(|m| m[1]),
            t.closure_residual.map(|c| c[0]),
            t.closure_residual.map(|c| c[1]),
            t.reference_error,
            kinetic.map(|b| b.mean),
            kinetic.map(|b| b.error),
            kinetic.map(|b| b.deviation),
        ];
        let failed = t.failed.as_deref().map_or(String::new(), |f| format!("\"{}\"", f.replace('"', "\"\"")));
        text += &format!(
            "{},{},{},{},{},{},{}\n",
            t.method,
            numbers.map(number).join(","),
            t.steps,
            t.rejected,
            t.evaluations,
            number(Some(t.wall_s)),
            failed.replace('\n', " ")
        );
    }
    text
}

impl Trial {
    /// Method and setting in a few words.
    pub fn describe(&self, time_unit: &str) -> String {
        match (self.tolerance, self.step) {
            (Some(tolerance), _) => format!("{}, tolerance {tolerance:e}", self.method),
            (_, Some(step)) if time_unit == "ps" => {
                format!("{}, step {} fs", self.method, short(1000.0 * step))
            }
            (_, Some(step)) => format!("{}, step {step} s", self.method),
            _ => self.method.into(),
        }
    }
    fn to_json(&self) -> Value {
        json!({
            "method": self.method, "tolerance": self.tolerance, "step": self.step,
            "error_q": self.error_q, "error_v": self.error_v, "error_end": self.error_end,
            "energy_error": self.energy_error,
            "energy_drift": self.drift.map(|d| json!({"slope": d.slope, "error": d.error, "noise": d.noise})),
            "momentum_error": self.momentum_error.map(|[angular, linear]| json!({"angular": angular, "linear": linear})),
            "closure_residual":
                self.closure_residual.map(|[position, velocity]| json!({"position": position, "velocity": velocity})),
            "reference_error": self.reference_error,
            "beyond_horizon": self.beyond.iter().map(Beyond::to_json).collect::<Vec<_>>(),
            "steps": self.steps, "rejected": self.rejected, "evaluations": self.evaluations, "wall_s": self.wall_s,
            "failed": self.failed,
        })
    }
}

impl Report {
    /// The value that `report --json` prints.
    pub fn to_json(&self, folder: &Path) -> Value {
        let r = &self.reference;
        let recommendations: Vec<Value> = self
            .advice
            .iter()
            .map(|a| {
                let t = a.trial.map(|i| &self.trials[i]);
                json!({
                    "error": a.error,
                    "method": t.map(|t| t.method), "tolerance": t.and_then(|t| t.tolerance), "step": t.and_then(|t| t.step),
                    "error_q": t.and_then(|t| t.error_q), "error_v": t.and_then(|t| t.error_v),
                    "wall_s": t.map(|t| t.wall_s), "evaluations": t.map(|t| t.evaluations),
                    "set": t.map(|t| self.settings(t)), "command": t.map(|t| self.command(t)), "why_not": a.why,
                })
            })
            .collect();
        let orders: Vec<Value> = self
            .orders
            .iter()
            .map(|o| json!({ "method": o.method, "order": o.order, "observed_order": o.observed }))
            .collect();
        json!({
            "scene": self.scene, "time_unit": self.time_unit, "t_end": self.t_end,
            "reference": {
                "methods": r.methods, "double_double": r.wide, "why_not_double_double": r.why_not_wide,
                "agreement_q": r.agreement[0], "agreement_v": r.agreement[1],
                "converged": r.horizon.is_none(), "horizon": r.horizon, "why": r.why,
                "instants": r.states.len(), "evaluations": r.evaluations, "wall_s": r.wall_s,
            },
            "methods": orders,
            "runs": self.trials.iter().map(Trial::to_json).collect::<Vec<_>>(),
            "recommendations": recommendations,
            "left_out": self.left_out, "warnings": self.warnings,
            "finished": self.finished, "report_folder": folder.display().to_string(),
        })
    }
    /// Rows of a table for people: what, and lines about it.
    pub fn summary(&self) -> Vec<(String, Vec<String>)> {
        let r = &self.reference;
        let unit = &self.time_unit;
        let mut rows = vec![("scene".to_string(), vec![self.title.clone()])];
        let mut lines = vec![
            format!("{} against {}", r.methods[1], r.methods[0]),
            match r.states.len() {
                0 => "they agree nowhere".to_string(),
                n => format!(
                    "they agree to {:.1e} in q, {:.1e} in v at {n} instants up to t = {} {unit}",
                    r.agreement[0],
                    r.agreement[1],
                    short(r.horizon.unwrap_or(self.t_end))
                ),
            },
            format!("{} evaluations, {:.3} s", r.evaluations, r.wall_s),
        ];
        if let Some(why) = &r.why_not_wide {
            lines.push(format!("no double-double numbers: {why}"));
        }
        rows.push(("reference".into(), lines));
        for o in &self.orders {
            let observed = o.observed.map_or("too few runs show it".into(), |x| format!("observed {x:.1}"));
            let runs = self.trials.iter().filter(|t| t.method == o.method).count();
            rows.push((o.method.into(), vec![format!("order {}, {observed}; {runs} runs", o.order)]));
        }
        for a in &self.advice {
            let line = match a.trial.map(|i| &self.trials[i]) {
                Some(t) => format!(
                    "{}: {}, {} evaluations (error {:.1e} in q, {:.1e} in v; energy {:.1e})",
                    t.describe(unit),
                    seconds(t.wall_s),
                    t.evaluations,
                    t.error_q.unwrap_or(f64::NAN),
                    t.error_v.unwrap_or(f64::NAN),
                    t.energy_error
                ),
                None => a.why.clone().unwrap_or_default(),
            };
            rows.push((format!("for {:e}", a.error), vec![line]));
        }
        rows
    }
}

/// A wall time in two digits.
fn seconds(s: f64) -> String {
    if s < 0.1 { format!("{:.2} ms", 1000.0 * s) } else { format!("{s:.2} s") }
}

/// `index.html`.
pub fn page(report: &Report) -> String {
    let mut warnings = report.warnings.clone();
    if !report.finished {
        warnings.insert(0, "this report has not ended: it holds the runs so far".into());
    }
    let summary =
        report.summary().into_iter().skip(1).map(|(name, lines)| (name, lines.join("\n"))).collect();
    let mut details: Vec<(String, String)> = report
        .advice
        .iter()
        .filter_map(|a| Some((format!("for {:e}", a.error), report.command(&report.trials[a.trial?]))))
        .collect();
    details.extend(report.trials.iter().map(|t| {
        let text = match &t.failed {
            Some(why) => format!("failed: {why}"),
            None => format!(
                "error {} in q, {} in v; energy {:.1e}; {} steps ({} rejected), {} evaluations, {}{}",
                t.error_q.map_or("unknown".into(), |e| format!("{e:.2e}")),
                t.error_v.map_or("unknown".into(), |e| format!("{e:.2e}")),
                t.energy_error,
                t.steps,
                t.rejected,
                t.evaluations,
                seconds(t.wall_s),
                t.beyond.iter().map(|b| format!("; beyond the horizon {}", b.describe())).collect::<String>()
            ),
        };
        (t.describe(&report.time_unit), text)
    }));
    details.push(("reproduce".into(), format!("phipsi report {}", report.path)));
    details.push(("phipsi".into(), env!("CARGO_PKG_VERSION").into()));
    details.push(("instruction level".into(), crate::level::instruction_level()));
    render(&PageData {
        title: &report.title,
        summary,
        warnings,
        left_out: report.left_out.clone(),
        details,
        charts: charts(report),
        drawing: None,
    })
}

fn charts(report: &Report) -> Vec<Chart> {
    let series = |x: &dyn Fn(&Trial) -> Option<f64>, y: &dyn Fn(&Trial) -> Option<f64>| -> Vec<Series> {
        report
            .orders
            .iter()
            .map(|o| {
                let observed = o.observed.map_or(String::new(), |x| format!(", observed {x:.1}"));
                let own = report.trials.iter().filter(|t| t.method == o.method && t.failed.is_none());
                Series {
                    name: format!("{} (order {}{observed})", o.method, o.order),
                    points: own.filter_map(|t| Some((x(t)?, y(t)?))).collect(),
                }
            })
            .filter(|s| !s.points.is_empty())
            .collect()
    };
    let log = |title: &str, x_label: &str, y_label: &str, series: Vec<Series>| Chart {
        title: title.into(),
        x_label: x_label.into(),
        y_label: y_label.into(),
        log_x: true,
        log_y: true,
        series,
    };
    let wall: &dyn Fn(&Trial) -> Option<f64> = &|t| Some(t.wall_s);
    let work: &dyn Fn(&Trial) -> Option<f64> = &|t| Some(t.evaluations as f64);
    let error = |t: &Trial| t.error_q;
    let q = "largest error of q, rad or m";
    let mut charts = vec![
        log("Error against wall time", "wall time, s", q, series(wall, &error)),
        log("Error against evaluations", "evaluations", q, series(work, &error)),
        log("Error of velocities", "evaluations", "largest error of v", series(work, &|t| t.error_v)),
        log("Error against tolerance", "tolerance", q, series(&|t| t.tolerance, &error)),
        log("Error against step", &format!("step, {}", report.time_unit), q, series(&|t| t.step, &error)),
        log("Energy error", "evaluations", "relative", series(work, &|t| Some(t.energy_error))),
    ];
    let unit = if report.time_unit == "ps" { "kJ/mol/ps" } else { "J/s" };
    let slopes = series(work, &|t| t.drift.map(|d| d.slope.abs()));
    charts.push(log("Energy drift", "evaluations", &format!("|slope|, {unit}"), slopes));
    if report.momentum {
        let angular = series(work, &|t| t.momentum_error.map(|m| m[0]));
        let linear = series(work, &|t| t.momentum_error.map(|m| m[1]));
        charts.push(log("Angular momentum error", "evaluations", "relative", angular));
        charts.push(log("Linear momentum error", "evaluations", "relative", linear));
    }
    for (i, (title, unit)) in
        [("Closure residual", "m or rad"), ("Residual of closures' rates", "m/s or rad/s")]
            .into_iter()
            .enumerate()
    {
        let residual = series(work, &|t| t.closure_residual.map(|c| c[i]));
        charts.push(log(title, "evaluations", unit, residual));
    }
    charts.extend(beyond(report));
    charts.retain(|c| !c.series.is_empty());
    let difference = |name: &str, value: &dyn Fn(&(f64, f64, f64)) -> f64| Series {
        name: name.into(),
        points: report.reference.differences.iter().map(|d| (d.0, value(d))).collect(),
    };
    charts.push(Chart {
        title: "Difference of the two references".into(),
        x_label: format!("time, {}", report.time_unit),
        y_label: "rad or m; per time for v".into(),
        log_x: false,
        log_y: true,
        series: vec![difference("in q", &|d| d.1), difference("in v", &|d| d.2)],
    });
    charts
}

/// Distributions after the horizon, of the finest run of each method.
fn beyond(report: &Report) -> Vec<Chart> {
    let finest = |method: &str| {
        let mut own = report.trials.iter().rev().filter(|t| t.method == method && t.failed.is_none());
        own.find(|t| !t.beyond.is_empty())
    };
    let runs: Vec<&Trial> = report.orders.iter().filter_map(|o| finest(o.method)).collect();
    let mut names: Vec<&str> = Vec::new();
    for name in runs.iter().flat_map(|t| &t.beyond).map(|b| b.name.as_str()) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let chart = |name: &&str| Chart {
        title: format!("Beyond the horizon: {name}"),
        x_label: name.to_string(),
        y_label: "part of the instants below".into(),
        log_x: false,
        log_y: false,
        series: (runs.iter())
            .filter_map(|t| {
                let own = t.beyond.iter().find(|b| b.name == **name)?;
                Some(Series { name: t.describe(&report.time_unit), points: own.distribution() })
            })
            .collect(),
    };
    names.iter().map(chart).collect()
}
