//! Events of a step: looking for passages, landing on the first one, and what happens there.
//!
//! The dense output tells where a passage is; the step is then made again to end there, so that the state has the order of the method, and
//! its end is corrected by Newton's iteration on the method's own ends, until rounding of time ends it.

use super::{IntegrateError, Integrator, IntegratorState};
use crate::event::{Changing, Events, Occurrence};
use crate::event_search::{Search, Watched, side};
use crate::explicit::StageError;
use crate::system::{Projected, System};

/// Most corrections of a landing.
const CORRECTIONS: usize = 8;

/// What belongs to events, besides the state.
#[derive(Clone, Debug, Default)]
pub(super) struct Passing {
    pub(super) log: Vec<Occurrence>,
    pub(super) ignores_records: bool,
    search: Search,
    watched: Vec<Watched>,
    start: Vec<f64>,
    end: Vec<f64>,
    q: Vec<f64>,
    v: Vec<f64>,
    aux: Vec<f64>,
}

/// What lies in a step.
pub(super) enum Ahead {
    Nothing,
    /// The step has been cut to end there.
    Passage {
        index: usize,
        t: f64,
        projected: Option<Projected>,
    },
    /// At its start.
    AtOnce {
        index: usize,
    },
}

impl Integrator {
    /// Finds the modes of a start; tells the system those of the state.
    pub(super) fn enter_modes<S: System>(&mut self, system: &mut S) -> Result<(), IntegrateError<S::Error>> {
        let Some(events) = system.events() else { return Ok(()) };
        let n = events.functions();
        if (self.state.sides.len(), self.state.modes.len()) == (n, events.modes()) {
            events.enter(&self.state.modes);
            return Ok(());
        }
        let t = self.state.t;
        let failed = |cause| IntegrateError::Start { t, cause: StageError::System(cause) };
        self.state.modes = vec![super::Mode::Free; events.modes()];
        let IntegratorState { q, v, aux, modes, .. } = &mut self.state;
        let mut state = Changing { t, q, v, aux, modes };
        let done = events.act(None, &mut state, &self.tolerances, &mut self.passing.log).map_err(failed)?;
        events.enter(&self.state.modes);
        self.passing.start.resize(n, 0.0);
        let state = (&self.state.q[..], &self.state.v[..], &self.state.aux[..]);
        let evaluations = events.values(t, state, &mut self.passing.start).map_err(failed)?;
        self.state.counts[2] += evaluations;
        self.state.sides = self.passing.start.iter().map(|g| side(*g)).collect();
        if done.changed {
            self.state.carried = false;
            system.project(t, &mut self.state.q, &mut self.state.v).map_err(failed)?;
        }
        Ok(())
    }

    /// Values of the event functions at a fraction of the attempted step.
    fn values_at<S: System>(
        &mut self,
        system: &mut S,
        t: f64,
        theta: f64,
        out: &mut [f64],
    ) -> Result<(), StageError<S::Error>> {
        let latest = self.latest;
        let Passing { q, v, aux, .. } = &mut self.passing;
        q.resize(self.state.q.len(), 0.0);
        v.resize(self.state.v.len(), 0.0);
        aux.resize(self.state.aux.len(), 0.0);
        self.step.sample(system, theta, latest, q, v, aux)?;
        system.project(t.min(latest), q, v).map_err(StageError::System)?;
        let Some(events) = system.events() else { return Ok(()) };
        let evaluations = events.values(t.min(latest), (q, v, aux), out).map_err(StageError::System)?;
        self.step.count(evaluations);
        Ok(())
    }
    /// The same at the end of the attempted step, which has been projected.
    fn values_at_end<S: System>(
        &mut self,
        system: &mut S,
        t: f64,
        out: &mut [f64],
    ) -> Result<(), StageError<S::Error>> {
        let nv = self.state.v.len();
        let Some(events) = system.events() else { return Ok(()) };
        let state = (&self.next_q[..], &self.next[nv..2 * nv], &self.next[2 * nv..]);
        let evaluations = events.values(t.min(self.latest), state, out).map_err(StageError::System)?;
        self.step.count(evaluations);
        Ok(())
    }

    /// The first passage in the attempted step from t0 to t1, whose end is accepted.
    pub(super) fn look_for_events<S: System>(
        &mut self,
        system: &mut S,
        t0: f64,
        t1: f64,
    ) -> Result<Ahead, StageError<S::Error>> {
        let Some(events) = system.events() else { return Ok(Ahead::Nothing) };
        let n = events.functions();
        if n == 0 || (self.passing.ignores_records && (0..n).all(|i| !events.acts(i))) {
            return Ok(Ahead::Nothing);
        }
        let mut start = std::mem::take(&mut self.passing.start);
        let mut end = std::mem::take(&mut self.passing.end);
        let mut watched = std::mem::take(&mut self.passing.watched);
        let mut search = std::mem::take(&mut self.passing.search);
        start.resize(n, 0.0);
        end.resize(n, 0.0);
        watched.clear();
        let mut look = || {
            let Some(events) = system.events() else { return Ok(Ahead::Nothing) };
            let s = &self.state;
            let evaluations =
                events.values(t0, (&s.q, &s.v, &s.aux), &mut start).map_err(StageError::System)?;
            self.step.count(evaluations);
            for i in 0..n {
                let (guard, mut side_now) = (events.is_guard(i), s.sides[i]);
                let noise = if guard { events.noise(i, &s.q, &s.v, &self.tolerances) } else { 0.0 };
                if guard {
                    side_now = i8::from(start[i] > noise);
                }
                if self.passing.ignores_records && !events.acts(i) {
                    start[i] = f64::INFINITY;
                }
                watched.push(Watched { direction: events.direction(i), side: side_now, guard, noise });
            }
            self.values_at_end(system, t1, &mut end)?;
            let mut evaluate =
                |theta: f64, out: &mut [f64]| self.values_at(system, t0 + theta * (t1 - t0), theta, out);
            let found = search.first(&mut watched, &start, &end, &mut evaluate)?;
            let Some(passage) = found else {
                self.remember(&watched, None);
                return Ok(Ahead::Nothing);
            };
            let h = t1 - t0;
            let resolution = 4.0 * f64::EPSILON * t0.abs().max(f64::MIN_POSITIVE);
            let (index, mut t) = (passage.index, t0 + passage.theta * h);
            if t - t0 <= resolution {
                self.remember(&[], Some((index, watched[index].side)));
                return Ok(Ahead::AtOnce { index });
            }
            let mut slope = passage.slope / h;
            let mut best: Option<(f64, f64)> = None;
            let mut projected = None;
            for correction in 0..CORRECTIONS {
                self.step.attempt(system, t0, t - t0, self.latest)?;
                projected = self.arrive(system, t).map_err(StageError::System)?;
                self.values_at_end(system, t, &mut end)?;
                let g = end[index];
                let (t_best, g_best) = best.unwrap_or((t, f64::INFINITY));
                if g.abs() >= g_best.abs() {
                    // Rounding: the one before was better.
                    self.step.attempt(system, t0, t_best - t0, self.latest)?;
                    projected = self.arrive(system, t_best).map_err(StageError::System)?;
                    self.values_at_end(system, t_best, &mut end)?;
                    t = t_best;
                    break;
                }
                if g_best.is_finite() {
                    slope = (g - g_best) / (t - t_best);
                }
                best = Some((t, g));
                // A function that only touches zero has no root to correct.
                let change = -g / slope;
                let next = (t + change).clamp(t0 + resolution, t1);
                let small = change.abs() <= 2.0 * f64::EPSILON * t.abs().max(h);
                if !change.is_finite() || small || next == t || correction + 1 == CORRECTIONS {
                    break;
                }
                t = next;
            }
            // The others have not passed yet, whatever rounding says of those that pass at the same time.
            let now = |((w, g), kept): ((&Watched, &f64), &i8)| {
                let side = if w.direction.leaves(*kept) { *kept } else { side(*g) };
                Watched { side, ..*w }
            };
            let sides: Vec<Watched> = watched.iter().zip(&end).zip(&self.state.sides).map(now).collect();
            self.remember(&sides, Some((index, watched[index].side)));
            Ok(Ahead::Passage { index, t, projected })
        };
        let found = look();
        (self.passing.start, self.passing.end) = (start, end);
        (self.passing.watched, self.passing.search) = (watched, search);
        self.state.counts[2] = self.step.evaluations();
        found
    }
    /// Keeps the sides; `passed`: a function with the side that it leaves.
    fn remember(&mut self, watched: &[Watched], passed: Option<(usize, i8)>) {
        for (kept, w) in self.state.sides.iter_mut().zip(watched).filter(|(_, w)| w.side != 0) {
            *kept = w.side;
        }
        if let Some((index, side)) = passed {
            self.state.sides[index] = -side;
        }
    }

    /// What a passage does, at the present state; true if it ends the run.
    pub(super) fn happen<S: System>(
        &mut self,
        system: &mut S,
        index: usize,
    ) -> Result<bool, IntegrateError<S::Error>> {
        let t = self.state.t;
        let failed = |cause| IntegrateError::Start { t, cause: StageError::System(cause) };
        let Some(events) = system.events() else { return Ok(false) };
        // A change of state by the user may put its own function on another side, or leave it at zero.
        let changes = events.acts(index) && !events.is_guard(index);
        let mut own = [0.0; 2];
        let mut value = |events: &mut dyn Events<Error = S::Error>, s: &IntegratorState| {
            self.passing.end.resize(events.functions(), 0.0);
            self.step.count(events.values(t, (&s.q, &s.v, &s.aux), &mut self.passing.end)?);
            Ok(self.passing.end[index])
        };
        if changes {
            own[0] = value(events, &self.state).map_err(failed)?;
        }
        let IntegratorState { q, v, aux, modes, .. } = &mut self.state;
        let mut state = Changing { t, q, v, aux, modes };
        let done =
            events.act(Some(index), &mut state, &self.tolerances, &mut self.passing.log).map_err(failed)?;
        events.enter(&self.state.modes);
        if changes {
            own[1] = value(events, &self.state).map_err(failed)?;
            self.state.sides[index] = if own[0] == own[1] { 0 } else { side(own[1]) };
            self.state.counts[2] = self.step.evaluations();
        }
        if done.changed {
            self.state.carried = false;
            system.project(t, &mut self.state.q, &mut self.state.v).map_err(failed)?;
        }
        Ok(done.stop)
    }
}
