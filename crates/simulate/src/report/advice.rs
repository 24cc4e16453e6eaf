//! Observed orders, and the cheapest run for each error.

use super::Report;
use super::study::Trial;

/// Errors that advice is given for, rad or m.
pub const ERRORS: [f64; 6] = [1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12];

/// Runs within this factor of the shortest time are as fast as it: of them, the one with fewest evaluations is advised.
const AS_FAST: f64 = 1.2;

/// Order of a method in theory and as observed.
#[derive(Clone, Debug)]
pub struct MethodOrder {
    /// Name of the method.
    pub method: &'static str,
    /// In theory.
    pub order: u32,
    /// Slope of log(error) against log of the mean step; `None` where too few runs show it.
    pub observed: Option<f64>,
}

/// The cheapest run for an error.
#[derive(Clone, Debug)]
pub struct Advice {
    /// The error that is asked for.
    pub error: f64,
    /// Position of the run, `None` if no run reaches it.
    pub trial: Option<usize>,
    /// Why there is none.
    pub why: Option<String>,
}

/// Orders of all methods that have run.
pub fn orders(report: &Report) -> Vec<MethodOrder> {
    let mut found: Vec<MethodOrder> = Vec::new();
    for trial in &report.trials {
        if found.iter().all(|f| f.method != trial.method) {
            let order = match trial.method {
                "dop853" => 8,
                "tsit5" | "rodas5p" => 5,
                "rk4" | "rodas4" => 4,
                _ => 2,
            };
            let own: Vec<&Trial> = report.trials.iter().filter(|t| t.method == trial.method).collect();
            let observed = observed(&own, report.reference.agreement[0]);
            found.push(MethodOrder { method: trial.method, order, observed });
        }
    }
    found
}

/// Slope by least squares over the runs whose errors are small enough to be asymptotic and well above the reference's.
fn observed(trials: &[&Trial], floor: f64) -> Option<f64> {
    let points: Vec<(f64, f64)> = trials
        .iter()
        .filter_map(|t| {
            let error = t.error_q.filter(|e| *e < 1e-2 && *e > (30.0 * floor).max(1e-12))?;
            let work = t.step.map_or(t.steps as f64, |step| 1.0 / step);
            Some((work.ln(), error.ln()))
        })
        .collect();
    let n = points.len() as f64;
    let mean = points.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let (xx, xy) = points
        .iter()
        .fold((0.0, 0.0), |(xx, xy), p| (xx + (p.0 - mean.0).powi(2), xy + (p.0 - mean.0) * (p.1 - mean.1)));
    (points.len() >= 3 && xx > 0.1).then(|| -xy / xx)
}

/// The cheapest run for each error.
pub fn advise(report: &Report) -> Vec<Advice> {
    let agreement = report.reference.agreement[0];
    let none = |error: f64, why: String| Advice { error, trial: None, why: Some(why) };
    ERRORS
        .into_iter()
        .map(|error| {
            if report.reference.states.is_empty() {
                return none(error, "the motion is not known".into());
            }
            if agreement > 0.1 * error {
                return none(error, format!("the references agree to {agreement:.0e} only"));
            }
            // What the reference may be wrong by counts against the run.
            let good = |t: &&(usize, &Trial)| {
                t.1.failed.is_none() && t.1.error_q.is_some_and(|e| e + agreement <= error)
            };
            let all: Vec<(usize, &Trial)> = report.trials.iter().enumerate().collect();
            let fastest = all.iter().filter(good).map(|t| t.1.wall_s).fold(f64::INFINITY, f64::min);
            let chosen = all
                .iter()
                .filter(good)
                .filter(|t| t.1.wall_s <= AS_FAST * fastest)
                .min_by_key(|t| t.1.evaluations);
            match chosen {
                Some((i, _)) => Advice { error, trial: Some(*i), why: None },
                None => none(error, "no run reaches it".into()),
            }
        })
        .collect()
}

impl Report {
    /// The command that repeats a run.
    pub fn command(&self, trial: &Trial) -> String {
        let mut command = format!("phipsi run {}", quoted(&self.path));
        for o in &self.overrides {
            command += &format!(" --set {}", quoted(o));
        }
        for setting in self.settings(trial) {
            command += &format!(" --set {setting}");
        }
        command
    }
    /// The overrides that make the scene this run; those of keys that its method does not have are empty, which removes them.
    pub fn settings(&self, trial: &Trial) -> Vec<String> {
        let (foreign, value): (&[&str], _) = match (trial.tolerance, trial.step) {
            (Some(tolerance), _) => (&["step", "step_fs", "atol"], format!("rtol={tolerance:e}")),
            (_, step) => {
                let own = format!("step={:?}", step.unwrap_or_default());
                (
                    if trial.method == "midpoint" {
                        &["step_fs", "rtol", "atol", "form"]
                    } else {
                        &["step_fs", "rtol", "atol"]
                    },
                    own,
                )
            }
        };
        let mut settings = vec![format!("integrator.method={}", trial.method)];
        let present = foreign.iter().filter(|key| self.present.iter().any(|k| k == *key));
        settings.extend(present.map(|key| format!("integrator.{key}=")));
        settings.push(format!("integrator.{value}"));
        settings.push("integrator.estimate=false".into());
        settings
    }
}

fn quoted(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._-/=".contains(c);
    if text.chars().all(plain) { text.into() } else { format!("'{}'", text.replace('\'', "'\\''")) }
}
