//! Companions without step control: the run's own steps, two as one or each a little shorter.

use super::{Beside, PlannedRun};
use crate::integrate::{IntegrateError, Integrator, Tolerances};
use crate::system::System;
use crate::trail::Trail;

/// Repeats the run's steps two at a time; a step before a break or at the end stands alone.
pub(super) fn merged<'a, S: System>(
    system: &mut S,
    run: &'a PlannedRun<'a>,
    trail: &'a Trail,
    divisor: f64,
) -> Result<Beside<'a>, IntegrateError<S::Error>> {
    let is_break = |t: f64| run.breaks.binary_search_by(|b| b.total_cmp(&t)).is_ok();
    // Steps are given: twice the size makes 2^(p+1) times the local error. One with more is not of order p any more (it is
    // unstable, or too large for its smoothness), and then the divisor means nothing.
    let Tolerances { rtol, atol, .. } = run.tolerances;
    let more = 2.0 * (divisor + 1.0);
    let accept = Tolerances { rtol: more * rtol, atol: more * atol, max_step: f64::INFINITY };
    let (t, q, v, aux) = run.start;
    let mut companion = Integrator::new(system.model(), run.method, accept, t, q, v, aux);
    companion.ignore_records();
    let mut beside = Beside::new(system, run, trail, divisor);
    let mut k = 0;
    while let Some(first) = trail.step(k) {
        let second = if is_break(first) { None } else { trail.step(k + 1) };
        k += if second.is_some() { 2 } else { 1 };
        let end = second.unwrap_or(first);
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
        beside.look(system, &mut companion);
    }
    beside.evaluations = companion.counts()[2];
    Ok(beside)
}

/// Eight steps for seven of the run: each as long as the run's at that place, less an eighth. They begin anew at breaks.
///
/// The local error is (7/8)^(p+1) of the run's, so the error at the end differs from the run's by 1 − (7/8)^p of it, however rough the
/// solution is at this tolerance.
pub(super) fn shortened<'a, S: System>(
    system: &mut S,
    run: &'a PlannedRun<'a>,
    trail: &'a Trail,
) -> Result<Beside<'a>, IntegrateError<S::Error>> {
    let is_break = |t: f64| run.breaks.binary_search_by(|b| b.total_cmp(&t)).is_ok();
    let infinite = f64::INFINITY;
    let accept = Tolerances { rtol: infinite, atol: infinite, max_step: infinite };
    let (t, q, v, aux) = run.start;
    let mut companion = Integrator::new(system.model(), run.method, accept, t, q, v, aux);
    companion.ignore_records();
    let divisor = 1.0 - 0.875f64.powi(run.method.order() as i32);
    let mut beside = Beside::new(system, run, trail, divisor);
    // Steps of the run that are behind, where they end, and eighths of the next one.
    let (mut k, mut before, mut eighths) = (0, t, 0);
    while let Some(mut next) = trail.step(k) {
        eighths += 7;
        if eighths > 8
            && !is_break(next)
            && let Some(after) = trail.step(k + 1)
        {
            (k, before, next, eighths) = (k + 1, next, after, eighths - 8);
        }
        let end = if eighths >= 8 { next } else { before + f64::from(eighths) / 8.0 * (next - before) };
        let stop = is_break(end);
        companion.propose(end - companion.t());
        match companion.step(system, end, stop) {
            Ok(_) if companion.counts()[1] > 0 => break,
            Ok(_) => {}
            Err(IntegrateError::StepUnderflow { .. }) => break,
            Err(e) => return Err(e),
        }
        if eighths >= 8 {
            (k, before, eighths) = (k + 1, next, 0);
        }
        if stop {
            companion.restart();
        }
        beside.look(system, &mut companion);
    }
    beside.evaluations = companion.counts()[2];
    Ok(beside)
}
