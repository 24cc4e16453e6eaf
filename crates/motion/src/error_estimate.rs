//! An estimate of the global error at the end of a run (notes on integrators, section 6).
//!
//! | how | difference divided by | used for |
//! |---|---|---|
//! | merged steps: every two accepted steps repeated as one, no controller | 2^p − 1 | tolerance ≤ 1e-9, if the doubled steps are stable |
//! | companion run at ten times the tolerance | 9 | tolerance ≤ 1e-8, where merged steps do not serve; looser ones with Tsitouras' method |
//! | companion run in steps an eighth shorter: the run's, no controller | 1 − (7/8)^p | looser tolerances with Dormand and Prince's method |
//! | companion run at a tenth of the tolerance | 0.9 | looser tolerances with other methods, or where stops or dry friction act |
//! | companion run at twice the fixed step | 2^p − 1 | fixed steps |
//!
//! At loose tolerances errors jump from tolerance to tolerance: a looser companion may be wrong by any multiple of the run's error, or by the
//! same error. A tighter one is wrong by less than the run, whatever the multiple. At order eight shorter steps are cheap: (7/8)⁸ is a third of
//! the error, and there are no rejections. Which estimates hold how often, and what they cost: `docs/src/errors.md`.
//!
//! Where stops or dry friction act, a companion finds its own events. Instants between an event of one run and the same event of the other
//! are not compared; where the runs do not do the same in the end, there is no estimate.
//!
//! A sum of embedded errors is 100 to 1e5 times too large and is not used.
//!
//! A companion needs of the run only its start; merged steps need the ends of its steps, stops and dry friction what happened so far, and
//! the comparison its samples. All of that comes through a [`Trail`], so that a companion can go on beside the run on another thread.

use crate::event::{Happening, Occurrence};
use crate::integrate::{IntegrateError, Integrator, Method, Tolerances};
use crate::system::System;
use crate::trail::Trail;
use phipsi_model::Model;
use phipsi_model::State;
use std::collections::BTreeMap;

mod given_steps;

use given_steps::{merged, shortened};

/// An increment beyond this, or a tenth of the motion, is no estimate: the solution is chaotic or the run too coarse.
const LOST: f64 = 0.1;

/// Loosest tolerance at which errors follow the tolerance well enough for a looser companion.
const FOLLOWING: f64 = 1e-8;

/// The run to be judged.
#[derive(Clone, Debug)]
pub struct JudgedRun<'a> {
    /// Method.
    pub method: Method,
    /// Its tolerances.
    pub tolerances: Tolerances,
    /// Start: t, q, v, aux.
    pub start: (f64, &'a [f64], &'a [f64], &'a [f64]),
    /// Ends of all accepted steps.
    pub steps: &'a [f64],
    /// Times at which forces are not smooth.
    pub breaks: &'a [f64],
    /// Some instants of the run, the last one its end.
    pub samples: &'a [State],
    /// What happened in it.
    pub events: &'a [Occurrence],
}

/// What is known of a run to be judged before it has ended.
#[derive(Clone, Debug)]
pub struct PlannedRun<'a> {
    /// Method.
    pub method: Method,
    /// Its tolerances.
    pub tolerances: Tolerances,
    /// Start: t, q, v, aux.
    pub start: (f64, &'a [f64], &'a [f64], &'a [f64]),
    /// Where its last step ends.
    pub end: f64,
    /// Times at which forces are not smooth.
    pub breaks: &'a [f64],
    /// Times of its samples, the last one its end.
    pub instants: &'a [f64],
}

/// The estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorEstimate {
    /// Largest component of the estimated error of q at the end, rad or m; `None` where it has no meaning.
    pub q: Option<f64>,
    /// Largest component of the estimated error of v at the end.
    pub v: Option<f64>,
    /// Where q and v are `None`: the time up to which the errors were small.
    pub horizon: Option<f64>,
    /// How it was obtained.
    pub how: String,
    /// Evaluations it took.
    pub evaluations: u64,
}

/// Estimates the error of a run at its end.
///
/// # Errors
/// Those of the integrator.
pub fn estimate_error<S: System>(
    system: &mut S,
    run: &JudgedRun<'_>,
) -> Result<ErrorEstimate, IntegrateError<S::Error>> {
    let JudgedRun { method, tolerances, start, steps, breaks, samples, events } = *run;
    let instants: Vec<f64> = samples.iter().map(|s| s.t).collect();
    let end = steps.last().copied().unwrap_or(start.0);
    let planned = PlannedRun { method, tolerances, start, end, breaks, instants: &instants };
    estimate_error_beside(system, &planned, &Trail::of_ended(steps, events, samples))
}

/// The same of a run that may still be going on, elsewhere and with a system of its own: another one like `system`. Waits on the trail for
/// what it needs and returns after the run has ended.
///
/// # Errors
/// As [`estimate_error`].
pub fn estimate_error_beside<S: System>(
    system: &mut S,
    run: &PlannedRun<'_>,
    trail: &Trail,
) -> Result<ErrorEstimate, IntegrateError<S::Error>> {
    let order = run.method.order() as i32;
    let halving = 2f64.powi(order) - 1.0;
    let switching = system.events().is_some_and(|e| (0..e.functions()).any(|i| e.acts(i)));
    match run.method {
        Method::Rk4 { step } => {
            let companion = Method::Rk4 { step: 2.0 * step };
            let how = "companion run at twice the step";
            let beside = compare(system, run, trail, companion, run.tolerances, halving)?;
            Ok(beside.judge(system.model(), how))
        }
        // Steps that end at events of one run are none of the other's: they cannot be merged.
        _ if switching => companion(system, run, trail),
        _ if run.tolerances.rtol <= 1e-9 && run.tolerances.atol <= 1e-9 => {
            let beside = merged(system, run, trail, halving)?;
            let spent = beside.evaluations;
            if beside.is_complete() {
                let estimate = beside.judge(system.model(), MERGED);
                if estimate.q.is_some() {
                    return Ok(estimate);
                }
            }
            // Steps at the edge of stability cannot be doubled; a controlled companion can still judge them.
            let mut second = companion(system, run, trail)?;
            second.evaluations += spent;
            Ok(second)
        }
        Method::Dop853 if !follows(&run.tolerances) => {
            let beside = shortened(system, run, trail)?;
            let spent = beside.evaluations;
            if beside.is_complete() {
                let estimate = beside.judge(system.model(), SHORTENED);
                if estimate.q.is_some() {
                    return Ok(estimate);
                }
            }
            // Given steps can fail where step sizes vary much; a controlled companion is a second opinion.
            let mut second = looser(system, run, trail)?;
            second.evaluations += spent;
            Ok(second)
        }
        _ => {
            let estimate = match run.method {
                Method::Tsit5 => looser(system, run, trail)?,
                _ => companion(system, run, trail)?,
            };
            if estimate.q != Some(0.0) || estimate.v != Some(0.0) {
                return Ok(estimate);
            }
            // Both took the same steps, as they do where the span or a largest step limits them: that says nothing.
            let mut second = merged(system, run, trail, halving)?.judge(system.model(), MERGED);
            second.evaluations += estimate.evaluations;
            Ok(second)
        }
    }
}

const MERGED: &str = "merged steps";

const SHORTENED: &str = "companion run in steps an eighth shorter";

/// True if errors follow the tolerance well enough for any looser companion.
fn follows(tolerances: &Tolerances) -> bool {
    tolerances.rtol.max(tolerances.atol) <= FOLLOWING
}

/// The companion at ten times the tolerance, or at a tenth of a loose one.
fn companion<S: System>(
    system: &mut S,
    run: &PlannedRun<'_>,
    trail: &Trail,
) -> Result<ErrorEstimate, IntegrateError<S::Error>> {
    if follows(&run.tolerances) {
        return looser(system, run, trail);
    }
    at_another_tolerance(system, run, trail, (0.1, 0.9, "companion run at a tenth of the tolerance"))
}

fn looser<S: System>(
    system: &mut S,
    run: &PlannedRun<'_>,
    trail: &Trail,
) -> Result<ErrorEstimate, IntegrateError<S::Error>> {
    at_another_tolerance(system, run, trail, (10.0, 9.0, "companion run at ten times the tolerance"))
}

fn at_another_tolerance<S: System>(
    system: &mut S,
    run: &PlannedRun<'_>,
    trail: &Trail,
    (factor, divisor, how): (f64, f64, &str),
) -> Result<ErrorEstimate, IntegrateError<S::Error>> {
    let Tolerances { rtol, atol, max_step } = run.tolerances;
    let tolerances = Tolerances { rtol: factor * rtol, atol: factor * atol, max_step };
    let beside = compare(system, run, trail, run.method, tolerances, divisor)?;
    Ok(beside.judge(system.model(), how))
}

fn compare<'a, S: System>(
    system: &mut S,
    run: &'a PlannedRun<'a>,
    trail: &'a Trail,
    method: Method,
    tolerances: Tolerances,
    divisor: f64,
) -> Result<Beside<'a>, IntegrateError<S::Error>> {
    let (t, q, v, aux) = run.start;
    let mut companion = Integrator::new(system.model(), method, tolerances, t, q, v, aux);
    companion.ignore_records();
    let mut beside = Beside::new(system, run, trail, divisor);
    let breaks = run.breaks.iter().copied().filter(|b| *b > t && *b < run.end).map(|b| (b, true));
    'all: for (limit, stop) in breaks.chain([(run.end, run.breaks.contains(&run.end))]) {
        while companion.t() < limit {
            match companion.step(system, limit, stop) {
                Ok(_) => beside.look(system, &mut companion),
                Err(IntegrateError::StepUnderflow { .. }) => break 'all,
                Err(e) => return Err(e),
            }
        }
        companion.restart();
    }
    beside.evaluations = companion.counts()[2];
    Ok(beside)
}

/// What has happened so far, in numbers: of each kind and joint. Impacts before a rest do not count, there may be infinitely many.
#[derive(Debug, Default, PartialEq)]
struct Tally(BTreeMap<(u8, usize), u64>);

impl Tally {
    fn count(&mut self, what: &Happening) {
        if !what.acts() {
            return;
        }
        if let Happening::Rest { dof, .. } = *what {
            for upper in [false, true] {
                self.0.remove(&Happening::Impact { dof, upper, speed: [0.0; 2], energy: 0.0 }.kind());
            }
        }
        *self.0.entry(what.kind()).or_default() += 1;
    }
    /// Counts a list from its end that was counted last, up to a time.
    fn follow(&mut self, list: &[Occurrence], counted: &mut usize, t: f64) {
        while let Some(next) = list.get(*counted).filter(|o| o.t <= t) {
            self.count(&next.what);
            *counted += 1;
        }
    }
}

/// A companion at the instants of the run's samples, to be compared with them when the run has ended.
struct Beside<'a> {
    run: &'a PlannedRun<'a>,
    trail: &'a Trail,
    divisor: f64,
    switching: bool,
    /// What happened in the run and in the companion, as far as it was counted.
    tallies: [Tally; 2],
    counted: [usize; 2],
    happened: Vec<Occurrence>,
    apart: bool,
    /// q and v of the companion at the instants so far; none where the two are not to be compared.
    own: Vec<Option<[Vec<f64>; 2]>>,
    aux: Vec<f64>,
    evaluations: u64,
}

impl<'a> Beside<'a> {
    fn new<S: System>(system: &mut S, run: &'a PlannedRun<'a>, trail: &'a Trail, divisor: f64) -> Self {
        let switching = system.events().is_some_and(|e| (0..e.functions()).any(|i| e.acts(i)));
        Beside {
            run,
            trail,
            divisor,
            switching,
            tallies: <[Tally; 2]>::default(),
            counted: [0; 2],
            happened: Vec::new(),
            apart: false,
            own: Vec::with_capacity(run.instants.len()),
            aux: vec![0.0; run.start.3.len()],
            evaluations: 0,
        }
    }
    /// Samples the companion at the instants inside its last step, without evaluations: between steps it is only asked whether the two
    /// are near each other. The last instant is the end of a step.
    fn look<S: System>(&mut self, system: &S, companion: &mut Integrator) {
        while let Some(&t) = self.run.instants.get(self.own.len()).filter(|t| **t <= companion.t()) {
            let mut own = None;
            if t > self.run.start.0 {
                if self.switching {
                    self.trail.follow_events(t, &mut self.happened);
                    let [theirs, ours] = &mut self.tallies;
                    theirs.follow(&self.happened, &mut self.counted[0], t);
                    ours.follow(companion.occurrences(), &mut self.counted[1], t);
                    self.apart = theirs != ours;
                }
                if !self.apart {
                    let (_, q, v, _) = self.run.start;
                    let (mut q, mut v) = (vec![0.0; q.len()], vec![0.0; v.len()]);
                    companion.sample_roughly(system, t, &mut q, &mut v, &mut self.aux);
                    own = Some([q, v]);
                }
            }
            self.own.push(own);
        }
    }
    /// False if the companion gave up before the end.
    fn is_complete(&self) -> bool {
        self.own.len() == self.run.instants.len()
    }
    /// Compares with the run's samples, for which it waits.
    fn judge(self, model: &Model, how: &str) -> ErrorEstimate {
        let samples = self.trail.samples();
        let (t0, q0, v0, _) = self.run.start;
        // Largest motion of each of q and v over the run: what a tenth is taken of.
        let mut motion = [0.0f64, v0.iter().fold(0.0, |m: f64, x| m.max(x.abs()))];
        for State { q, v, .. } in &samples {
            motion[0] = model.difference(q0, q).iter().fold(motion[0], |m, x| m.max(x.abs()));
            motion[1] = v.iter().fold(motion[1], |m, x| m.max(x.abs()));
        }
        let (mut horizon, mut lost, mut last) = (t0, false, None);
        for (State { t, q, v }, own) in samples.iter().zip(&self.own) {
            let Some([own_q, own_v]) = own else { continue };
            let dq = model.difference(q, own_q).iter().fold(0.0f64, |m, x| m.max(x.abs()));
            let dv = v.iter().zip(own_v).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
            let errors = [dq / self.divisor, dv / self.divisor];
            let small = errors[0] <= LOST.min(0.1 * motion[0]) && errors[1] <= 0.1 * motion[1];
            if small && !lost {
                horizon = *t;
            }
            lost |= !small;
            last = Some(errors);
        }
        let known = last.filter(|_| self.is_complete() && !lost && !self.apart);
        let order = if self.apart { ", whose events are not those of the run at the end" } else { "" };
        ErrorEstimate {
            q: known.map(|e| e[0]),
            v: known.map(|e| e[1]),
            horizon: if known.is_some() { None } else { Some(horizon) },
            how: format!("{how}{order}"),
            evaluations: self.evaluations,
        }
    }
}
