//! The runs of a report: every method, coarse to fine, as far as time allows.

use super::advice::{advise, orders};
use super::beyond::{Beyond, Collector};
use super::reference::{Reference, apart, instants};
use super::{Budget, Report, ReportWatcher};
use crate::drift::{Drift, drift};
use crate::error::SimulateError;
use crate::record::{Observer, Row};
use crate::run::run;
use crate::simulation::{Choice, Simulation, method_name};
use crate::stiffness::MOST_DOF;
use phipsi_model::{Model, State};
use phipsi_motion::{Method, Scheme, Tolerances};
use std::time::{Duration, Instant};

/// Loosest and tightest exponents of the tolerances.
const EXPONENTS: std::ops::RangeInclusive<i32> = 3..=13;

/// Most halvings of a fixed step.
const HALVINGS: i32 = 9;

/// Longest time of a run that is counted, s.
const LONGEST: f64 = 1e9;

/// Most rows through which a line of the energy is drawn.
const MOST_ROWS: usize = 100_000;

/// Runs shorter than this are repeated, s: the least of three times is kept.
const SHORT: f64 = 0.05;

/// One run.
#[derive(Clone, Debug)]
pub struct Trial {
    /// Name of its method.
    pub method: &'static str,
    /// Tolerance, relative and absolute, of an adaptive method.
    pub tolerance: Option<f64>,
    /// Step of a fixed one.
    pub step: Option<f64>,
    /// Largest error of q over the instants up to the horizon, rad or m.
    pub error_q: Option<f64>,
    /// Largest error of v.
    pub error_v: Option<f64>,
    /// Errors of q and v at the end, or at the horizon.
    pub error_end: Option<[f64; 2]>,
    /// Relative imbalance of energy over the whole run.
    pub energy_error: f64,
    /// Straight line through the energy less work over the whole run; `None` for very many samples.
    pub drift: Option<Drift>,
    /// Relative imbalances of angular and linear momentum.
    pub momentum_error: Option<[f64; 2]>,
    /// Largest residuals of closures at the ends of steps: positions (m, rad) and velocities; `None` without closures.
    pub closure_residual: Option<[f64; 2]>,
    /// Largest relative error of outputs with known values.
    pub reference_error: Option<f64>,
    /// Distributions after the horizon: of the kinetic energy, then of the outputs. Empty where the motion is known to the end.
    pub beyond: Vec<Beyond>,
    /// Accepted steps.
    pub steps: u64,
    /// Rejected steps.
    pub rejected: u64,
    /// Evaluations of the equations of motion.
    pub evaluations: u64,
    /// Wall time without an error estimate, s.
    pub wall_s: f64,
    /// Why it did not end.
    pub failed: Option<String>,
}

/// Theoretical order of a method.
pub fn order(method: Scheme) -> u32 {
    match method {
        Scheme::Explicit(method) => method.order(),
        Scheme::Midpoint { .. } => 2,
    }
}

/// A method that is tried.
struct Candidate {
    order: u32,
    name: &'static str,
    settings: Vec<(Scheme, Tolerances)>,
}

/// Runs all methods; after each run the report is brought up to date and handed out. True if it was stopped.
pub(crate) fn study(
    simulation: &mut Simulation,
    report: &mut Report,
    budget: &Budget,
    watcher: &mut dyn ReportWatcher,
    done: &mut dyn FnMut(&Report) -> Result<(), SimulateError>,
) -> Result<bool, SimulateError> {
    let own = (simulation.choice.clone(), simulation.tolerances, simulation.estimate);
    simulation.estimate = false;
    let mut adaptive = candidates(simulation);
    if simulation.molecule.is_none() && simulation.model().nv() > MOST_DOF {
        let nv = simulation.model().nv();
        report
            .left_out
            .push(format!("rodas4, rodas5p: {nv} degrees of freedom, and at most {MOST_DOF} are tried"));
    }
    let count = adaptive.len() + 2;
    let mut result = Ok(false);
    for i in 0..count {
        let candidate = if i < adaptive.len() {
            let first = &mut adaptive[i];
            Candidate { order: first.order, name: first.name, settings: std::mem::take(&mut first.settings) }
        } else {
            match fixed(simulation, report, i == adaptive.len()) {
                Ok(candidate) => candidate,
                Err(why) => {
                    report.left_out.extend(why);
                    continue;
                }
            }
        };
        let share = budget.left() / (count - i) as f64;
        match one_method(simulation, report, &candidate, share, budget, watcher, done) {
            Ok(false) => {}
            other => {
                result = other;
                break;
            }
        }
    }
    (simulation.choice, simulation.tolerances, simulation.estimate) = own;
    result
}

/// The adaptive methods.
fn candidates(simulation: &Simulation) -> Vec<Candidate> {
    let max_step = simulation.tolerances.max_step;
    // A force field has no second derivatives here: linearisation by differences would cost thousands of evaluations a step.
    let implicit = simulation.molecule.is_none() && simulation.model().nv() <= MOST_DOF;
    [Method::Dop853, Method::Tsit5, Method::Rodas4, Method::Rodas5p]
        .map(|method| {
            let scheme = Scheme::Explicit(method);
            let settings = EXPONENTS.map(|exponent| {
                // Read from text, so that it is the number that a user writes.
                let tolerance = format!("1e-{exponent}").parse().unwrap_or(1e-9);
                (scheme, Tolerances { rtol: tolerance, atol: tolerance, max_step })
            });
            Candidate { order: order(scheme), name: method_name(scheme), settings: settings.collect() }
        })
        .into_iter()
        .filter(|c: &Candidate| implicit || !c.name.starts_with("rodas"))
        .collect()
}

/// The methods of fixed step; their largest step is that of a coarse adaptive run. `Err`: why one is left out.
fn fixed(simulation: &Simulation, report: &Report, rk4: bool) -> Result<Candidate, Option<String>> {
    let settings = |steps: Vec<f64>, make: &dyn Fn(f64) -> Scheme| {
        steps.into_iter().map(|step| (make(step), simulation.tolerances)).collect()
    };
    let span = simulation.t_end - simulation.start.t;
    if rk4 {
        if simulation.molecule.is_some() {
            return Err(None);
        }
        let coarse = report.trials.iter().find(|t| t.failed.is_none() && t.tolerance == Some(1e-5));
        let Some(coarse) = coarse.or(report.trials.iter().find(|t| t.failed.is_none())) else {
            return Err(Some("rk4: no adaptive run tells the size of a step".into()));
        };
        let largest = span / (coarse.steps.max(1) as f64);
        let steps = round_steps(largest).into_iter().filter(|s| *s <= span).collect();
        let make = |step| Scheme::Explicit(Method::Rk4 { step });
        return Ok(Candidate { order: 4, name: "rk4", settings: settings(steps, &make) });
    }
    if simulation.dynamics.is_prescribed() {
        return Err(Some("midpoint: motions are prescribed".into()));
    }
    let conservative = |f: &dyn phipsi_motion::Force| f.needs().conservative && f.auxiliary().is_empty();
    if let Some(force) = simulation.dynamics.forces().iter().find(|f| !conservative(f.as_ref())) {
        let why = format!("midpoint: force `{}` has no potential energy", force.name());
        return Err(Some(why));
    }
    let intervals = span / simulation.every;
    if simulation.dynamics.is_switching() {
        return Err(Some("midpoint: it knows no stops and dry friction".into()));
    }
    if (intervals - intervals.round()).abs() > 1e-6 {
        let why =
            "midpoint: the run is not a whole number of record.every, and it has states at its steps only";
        return Err(Some(why.into()));
    }
    let own = match simulation.choice.method {
        Scheme::Midpoint { step } => step,
        _ => simulation.every,
    };
    let multiple = (simulation.every / own).round().max(1.0);
    let mut parts: Vec<f64> = Vec::new();
    for k in -2..HALVINGS {
        let part = (multiple * 2f64.powi(k)).round().max(1.0);
        if !parts.contains(&part) {
            parts.push(part);
        }
    }
    let steps = parts.into_iter().map(|part| simulation.every / part).collect();
    Ok(Candidate { order: 2, name: "midpoint", settings: settings(steps, &|step| Scheme::Midpoint { step }) })
}

/// 1, 2, 5 times powers of ten, from about `largest` down.
fn round_steps(largest: f64) -> Vec<f64> {
    let mut exponent = largest.log10().floor() as i32;
    let mut digits = [5, 2, 1].into_iter().cycle();
    let mut steps = Vec::new();
    while steps.len() < HALVINGS as usize {
        let Some(digit) = digits.next() else { break };
        // Read from text, so that it is the number that a user writes.
        let step: f64 = format!("{digit}e{exponent}").parse().unwrap_or(largest);
        if step <= 1.5 * largest {
            steps.push(step);
        }
        if digit == 1 {
            exponent -= 1;
        }
    }
    steps
}

fn one_method(
    simulation: &mut Simulation,
    report: &mut Report,
    candidate: &Candidate,
    seconds: f64,
    budget: &Budget,
    watcher: &mut dyn ReportWatcher,
    done: &mut dyn FnMut(&Report) -> Result<(), SimulateError>,
) -> Result<bool, SimulateError> {
    let begun = Instant::now();
    let floor = report.reference.agreement[0];
    let mut last: Option<(f64, Option<f64>)> = None;
    let mut growth = 1.5f64;
    let mut idle = 0;
    for (i, (scheme, tolerances)) in candidate.settings.iter().enumerate() {
        let left = seconds - begun.elapsed().as_secs_f64();
        let repeats = |wall: f64| if wall < SHORT { 3.0 } else { 1.0 };
        if let Some((wall, _)) = last
            && growth * wall * repeats(growth * wall) > left
        {
            let rest = candidate.settings.len() - i;
            report.left_out.push(format!(
                "{}: the {rest} finest of {} runs, which would take longer than the {seconds:.1} s that it has (--budget)",
                candidate.name,
                candidate.settings.len()
            ));
            break;
        }
        let cap = Duration::from_secs_f64((2.0 * left).clamp(0.1, LONGEST));
        let what = describe(candidate.name, *scheme, tolerances);
        let trial = trial(simulation, (*scheme, *tolerances), &report.reference, cap, &what, budget, watcher);
        if watcher.stop() {
            return Ok(true);
        }
        let now = (trial.wall_s, trial.error_q);
        if let Some((wall, error)) = last {
            growth = (now.0 / wall.max(1e-9)).clamp(1.3, 4.0);
            // Errors that no longer fall, at the size of the reference's own, are rounding.
            let stalled =
                matches!((error, now.1), (Some(a), Some(b)) if b > 0.7 * a && b <= 1e3 * floor.max(1e-15));
            idle = if stalled { idle + 1 } else { 0 };
        }
        let failed = trial.failed.is_some();
        if !failed {
            last = Some(now);
        }
        report.trials.push(trial);
        report.orders = orders(report);
        report.advice = advise(report);
        done(report)?;
        if idle >= 2 {
            break;
        }
    }
    Ok(false)
}

fn describe(name: &str, scheme: Scheme, tolerances: &Tolerances) -> String {
    match scheme.fixed_step() {
        Some(step) => format!("{name}, step {step}"),
        None => format!("{name}, tolerance {:e}", tolerances.rtol),
    }
}

/// One run, repeated if it is too short to be timed.
fn trial(
    simulation: &mut Simulation,
    (scheme, tolerances): (Scheme, Tolerances),
    reference: &Reference,
    cap: Duration,
    what: &str,
    budget: &Budget,
    watcher: &mut dyn ReportWatcher,
) -> Trial {
    simulation.choice = Choice::asked(scheme);
    simulation.tolerances = tolerances;
    let step = scheme.fixed_step();
    let mut trial = Trial {
        method: method_name(scheme),
        tolerance: step.is_none().then_some(tolerances.rtol),
        step,
        error_q: None,
        error_v: None,
        error_end: None,
        energy_error: f64::NAN,
        drift: None,
        momentum_error: None,
        closure_residual: None,
        reference_error: None,
        beyond: Vec::new(),
        steps: 0,
        rejected: 0,
        evaluations: 0,
        wall_s: f64::NAN,
        failed: None,
    };
    let names: Vec<String> = simulation.outputs.iter().map(|o| o.name.clone()).collect();
    for repeat in 0..3 {
        let model = simulation.model().clone();
        let mut judge = Judge {
            model: &model,
            reference,
            judged: instants(simulation),
            row: 0,
            next: 0,
            worst: [0.0; 2],
            last: None,
            energies: Vec::new(),
            beyond: Collector::new(reference.horizon, &names),
            begun: Instant::now(),
            cap,
            over: std::cell::Cell::new(false),
            watcher,
            what,
            part: budget.part(),
        };
        let result = run(simulation, &mut judge);
        let (worst, last, over) = (judge.worst, judge.last, judge.over.get());
        let (energies, beyond) = (judge.energies, judge.beyond);
        match result {
            Ok(summary) if summary.finished => {
                let judged = !reference.states.is_empty();
                trial.error_q = judged.then_some(worst[0]);
                trial.error_v = judged.then_some(worst[1]);
                trial.error_end = last;
                trial.energy_error = summary.energy_error;
                trial.drift = if energies.len() < MOST_ROWS { drift(&energies) } else { None };
                trial.momentum_error = summary.momentum_error;
                trial.closure_residual = summary.closures.map(|c| [c.position, c.velocity]);
                trial.reference_error = summary.reference_error;
                trial.beyond = beyond.finish();
                (trial.steps, trial.rejected) = (summary.steps, summary.rejected);
                trial.evaluations = summary.evaluations;
                trial.wall_s = if repeat == 0 { summary.wall_s } else { trial.wall_s.min(summary.wall_s) };
                if summary.wall_s > SHORT {
                    break;
                }
            }
            Ok(_) if over => {
                trial.failed = Some(format!("not ended after {:.1} s", cap.as_secs_f64()));
                break;
            }
            Ok(_) => {
                trial.failed = Some("stopped by the user".into());
                break;
            }
            Err(e) => {
                trial.failed = Some(e.to_string());
                break;
            }
        }
    }
    trial
}

/// Compares the rows of a run with the reference as they come.
struct Judge<'a> {
    model: &'a Model,
    reference: &'a Reference,
    /// Positions of the judged rows.
    judged: Vec<u64>,
    row: u64,
    next: usize,
    worst: [f64; 2],
    last: Option<[f64; 2]>,
    /// Rows with time and energy alone.
    energies: Vec<Row>,
    beyond: Collector<'a>,
    begun: Instant,
    cap: Duration,
    over: std::cell::Cell<bool>,
    watcher: &'a mut dyn ReportWatcher,
    what: &'a str,
    part: f64,
}

impl Observer for Judge<'_> {
    fn row(&mut self, row: &Row) -> Result<(), SimulateError> {
        let at = self.judged.get(self.next) == Some(&self.row);
        self.row += 1;
        self.beyond.row(row);
        if self.energies.len() < MOST_ROWS {
            let none = Vec::new;
            let (outputs, terms, momentum) = (none(), none(), [0.0; 6]);
            let (t, energy) = (row.t, row.energy);
            self.energies.push(Row { t, q: none(), v: none(), energy, momentum, outputs, terms });
        }
        if at {
            if let Some(known) = self.reference.states.get(self.next) {
                let errors = apart(self.model, known, &row.state());
                for (worst, error) in self.worst.iter_mut().zip(errors) {
                    *worst = if error.is_nan() || worst.is_nan() { f64::NAN } else { worst.max(error) };
                }
                self.last = Some(errors);
            }
            self.next += 1;
            self.watcher.at(self.what, self.part);
        }
        Ok(())
    }
    fn stop(&self) -> bool {
        if self.begun.elapsed() > self.cap {
            self.over.set(true);
        }
        self.over.get() || self.watcher.stop()
    }
    fn step_ends(&mut self) -> Result<Vec<f64>, SimulateError> {
        Ok(Vec::new())
    }
    fn spread_rows(&mut self, _: usize) -> Result<Vec<State>, SimulateError> {
        Ok(Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_steps_are_numbers_that_one_writes() {
        assert_eq!(round_steps(0.04), [0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4, 1e-4]);
        assert_eq!(round_steps(0.012)[..2], [0.01, 0.005]);
    }
}
