//! An estimate of the global error at the end of a run (notes on integrators, section 6).
//!
//! | how | difference divided by | used for |
//! |---|---|---|
//! | merged steps: every two accepted steps repeated as one, no controller | 2^p − 1 | tolerance ≤ 1e-9, if the doubled steps are stable |
//! | companion run at ten times the tolerance | 9 | tolerance ≤ 1e-8, where merged steps do not serve |
//! | companion run at a tenth of the tolerance | 0.9 | looser tolerances |
//! | companion run at twice the fixed step | 2^p − 1 | fixed steps |
//!
//! At loose tolerances errors jump from tolerance to tolerance: a looser companion may be wrong by any multiple of the run's error, or by the
//! same error. A tighter one is wrong by less than the run, whatever the multiple, and such runs are short.
//!
//! Where stops or dry friction act, a companion finds its own events. Instants between an event of one run and the same event of the other
//! are not compared; where the runs do not do the same in the end, there is no estimate.
//!
//! A sum of embedded errors is 100 to 1e5 times too large and is not used.

use crate::event::{Happening, Occurrence};
use crate::integrate::{IntegrateError, Integrator, Method, Tolerances};
use crate::system::System;
use phipsi_model::State;
use std::collections::BTreeMap;

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
    let order = run.method.order() as i32;
    let halving = 2f64.powi(order) - 1.0;
    let switching = system.events().is_some_and(|e| (0..e.functions()).any(|i| e.acts(i)));
    match run.method {
        Method::Rk4 { step } => {
            let companion = Method::Rk4 { step: 2.0 * step };
            compare(system, run, companion, run.tolerances, halving, "companion run at twice the step")
        }
        // Steps that end at events of one run are none of the other's: they cannot be merged.
        _ if switching => companion(system, run),
        _ if run.tolerances.rtol <= 1e-9 && run.tolerances.atol <= 1e-9 => {
            let estimate = merged(system, run, halving)?;
            if estimate.q.is_some() {
                return Ok(estimate);
            }
            // Steps at the edge of stability cannot be doubled; a controlled companion can still judge them.
            let mut second = companion(system, run)?;
            second.evaluations += estimate.evaluations;
            Ok(second)
        }
        _ => {
            let estimate = companion(system, run)?;
            if estimate.q != Some(0.0) || estimate.v != Some(0.0) {
                return Ok(estimate);
            }
            // Both took the same steps, as they do where the span or a largest step limits them: that says nothing.
            let mut second = merged(system, run, halving)?;
            second.evaluations += estimate.evaluations;
            Ok(second)
        }
    }
}

/// The companion at ten times the tolerance, or at a tenth of a loose one.
fn companion<S: System>(
    system: &mut S,
    run: &JudgedRun<'_>,
) -> Result<ErrorEstimate, IntegrateError<S::Error>> {
    let Tolerances { rtol, atol, max_step } = run.tolerances;
    let follows = rtol.max(atol) <= FOLLOWING;
    let (factor, divisor, how) = match follows {
        true => (10.0, 9.0, "companion run at ten times the tolerance"),
        false => (0.1, 0.9, "companion run at a tenth of the tolerance"),
    };
    let tolerances = Tolerances { rtol: factor * rtol, atol: factor * atol, max_step };
    compare(system, run, run.method, tolerances, divisor, how)
}

/// Repeats the run's steps two at a time; a step before a break or at the end stands alone.
fn merged<S: System>(
    system: &mut S,
    run: &JudgedRun<'_>,
    divisor: f64,
) -> Result<ErrorEstimate, IntegrateError<S::Error>> {
    let is_break = |t: f64| run.breaks.binary_search_by(|b| b.total_cmp(&t)).is_ok();
    let mut ends = Vec::with_capacity(run.steps.len() / 2 + 1);
    let mut waiting = false;
    for &t in run.steps {
        if waiting || is_break(t) {
            ends.push(t);
            waiting = false;
        } else {
            waiting = true;
        }
    }
    if let Some(&last) = run.steps.last()
        && ends.last() != Some(&last)
    {
        ends.push(last);
    }
    // Steps are given: twice the size makes 2^(p+1) times the local error. One with more is not of order p any more (it is
    // unstable, or too large for its smoothness), and then the divisor means nothing.
    let Tolerances { rtol, atol, .. } = run.tolerances;
    let more = 2.0 * (divisor + 1.0);
    let accept = Tolerances { rtol: more * rtol, atol: more * atol, max_step: f64::INFINITY };
    let (t, q, v, aux) = run.start;
    let mut companion = Integrator::new(system.model(), run.method, accept, t, q, v, aux);
    companion.ignore_records();
    let mut judge = Judge::new(system, run, divisor);
    for &end in &ends {
        let stop = is_break(end);
        companion.propose(end - companion.t());
        match companion.step(system, end, stop) {
            Ok(_) if companion.counts()[1] > 0 => break,
            Ok(_) => {}
            // Doubled steps can leave the domain of the forces; then there is no estimate, which the result says.
            Err(IntegrateError::StepUnderflow { .. }) => break,
            Err(e) => return Err(e),
        }
        if stop {
            companion.restart();
        }
        judge.look(system, &mut companion)?;
    }
    Ok(judge.finish("merged steps", companion.counts()[2]))
}

fn compare<S: System>(
    system: &mut S,
    run: &JudgedRun<'_>,
    method: Method,
    tolerances: Tolerances,
    divisor: f64,
    how: &str,
) -> Result<ErrorEstimate, IntegrateError<S::Error>> {
    let (t, q, v, aux) = run.start;
    let mut companion = Integrator::new(system.model(), method, tolerances, t, q, v, aux);
    companion.ignore_records();
    let mut judge = Judge::new(system, run, divisor);
    let Some(&end) = run.steps.last() else { return Ok(judge.finish(how, 0)) };
    let breaks = run.breaks.iter().copied().filter(|b| *b > t && *b < end).map(|b| (b, true));
    for (limit, stop) in breaks.chain([(end, run.breaks.contains(&end))]) {
        while companion.t() < limit {
            match companion.step(system, limit, stop) {
                Ok(_) => judge.look(system, &mut companion)?,
                Err(IntegrateError::StepUnderflow { .. }) => {
                    return Ok(judge.finish(how, companion.counts()[2]));
                }
                Err(e) => return Err(e),
            }
        }
        companion.restart();
    }
    Ok(judge.finish(how, companion.counts()[2]))
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

/// Compares a companion with the run at the run's samples.
struct Judge<'a> {
    tallies: [Tally; 2],
    counted: [usize; 2],
    apart: bool,
    run: &'a JudgedRun<'a>,
    divisor: f64,
    next: usize,
    /// Largest motion of each of q and v over the run: what a tenth is taken of.
    motion: [f64; 2],
    horizon: f64,
    lost: bool,
    last: Option<[f64; 2]>,
    scratch: [Vec<f64>; 3],
}

impl<'a> Judge<'a> {
    fn new<S: System>(system: &S, run: &'a JudgedRun<'a>, divisor: f64) -> Self {
        let model = system.model();
        let (t, q0, v0, aux) = run.start;
        let mut motion = [0.0f64, v0.iter().fold(0.0, |m: f64, x| m.max(x.abs()))];
        for State { q, v, .. } in run.samples {
            motion[0] = model.difference(q0, q).iter().fold(motion[0], |m, x| m.max(x.abs()));
            motion[1] = v.iter().fold(motion[1], |m, x| m.max(x.abs()));
        }
        let scratch = [vec![0.0; q0.len()], vec![0.0; v0.len()], vec![0.0; aux.len()]];
        let tallies = <[Tally; 2]>::default();
        let (counted, apart) = ([0; 2], false);
        Judge {
            tallies,
            counted,
            apart,
            run,
            divisor,
            next: 0,
            motion,
            horizon: t,
            lost: false,
            last: None,
            scratch,
        }
    }
    /// Takes the samples inside the companion's last step.
    fn look<S: System>(
        &mut self,
        system: &mut S,
        companion: &mut Integrator,
    ) -> Result<(), IntegrateError<S::Error>> {
        while let Some(State { t, q, v }) = self.run.samples.get(self.next).filter(|s| s.t <= companion.t()) {
            self.next += 1;
            if *t <= self.run.start.0 {
                continue;
            }
            let [theirs, own] = &mut self.tallies;
            theirs.follow(self.run.events, &mut self.counted[0], *t);
            own.follow(companion.occurrences(), &mut self.counted[1], *t);
            self.apart = theirs != own;
            if self.apart {
                continue;
            }
            let [own_q, own_v, own_aux] = &mut self.scratch;
            companion.sample(system, *t, own_q, own_v, own_aux)?;
            let dq = system.model().difference(q, own_q).iter().fold(0.0f64, |m, x| m.max(x.abs()));
            let dv = v.iter().zip(own_v.iter()).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
            let errors = [dq / self.divisor, dv / self.divisor];
            let small = errors[0] <= LOST.min(0.1 * self.motion[0]) && errors[1] <= 0.1 * self.motion[1];
            if small && !self.lost {
                self.horizon = *t;
            }
            self.lost |= !small;
            self.last = Some(errors);
        }
        Ok(())
    }
    fn finish(self, how: &str, evaluations: u64) -> ErrorEstimate {
        let complete = self.next == self.run.samples.len();
        let known = self.last.filter(|_| complete && !self.lost && !self.apart);
        let order = if self.apart { ", whose events are not those of the run at the end" } else { "" };
        ErrorEstimate {
            q: known.map(|e| e[0]),
            v: known.map(|e| e[1]),
            horizon: if known.is_some() { None } else { Some(self.horizon) },
            how: format!("{how}{order}"),
            evaluations,
        }
    }
}
