//! The driver: steps under error control, landing on given times, checkpoints.

use crate::event::{Mode, Occurrence};
use crate::explicit::StageError;
use crate::increment::largest_rotation;
use crate::one_step::OneStep;
use crate::system::{Projected, System};
use phipsi_model::Model;

mod error;
mod method;
mod passing;

pub use error::IntegrateError;
pub use method::{Method, Tolerances};
use passing::{Ahead, Passing};

/// An accepted step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepInfo {
    /// Start.
    pub t0: f64,
    /// End.
    pub t1: f64,
    /// What the projection at its end did; `None` where nothing is projected.
    pub projected: Option<Projected>,
    /// An event ended it: [`Integrator::occurrences`] has what happened.
    pub event: bool,
    /// An event ends the run here.
    pub stop: bool,
}

/// Everything that continues a run bit for bit.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct IntegratorState {
    /// Time.
    pub t: f64,
    /// Configuration, velocity, auxiliary quantities.
    pub q: Vec<f64>,
    /// Velocity.
    pub v: Vec<f64>,
    /// Auxiliary quantities.
    pub aux: Vec<f64>,
    /// Carried accelerations.
    pub v_dot: Vec<f64>,
    /// Carried rates.
    pub aux_dot: Vec<f64>,
    /// Proposed step; 0 before the first.
    pub h: f64,
    /// Error of the last accepted step, the controller's memory.
    pub last_error: f64,
    /// Largest speed so far of each degree of freedom.
    pub largest: Vec<f64>,
    /// Accepted and rejected steps, evaluations.
    pub counts: [u64; 3],
    /// False if the derivative must be evaluated anew before the next step.
    pub carried: bool,
    /// Modes of joints with stops or friction.
    #[cfg_attr(feature = "serde", serde(default))]
    pub modes: Vec<Mode>,
    /// Sides of zero on which the event functions are; empty before the start.
    #[cfg_attr(feature = "serde", serde(default))]
    pub sides: Vec<i8>,
}

/// Most events at one instant.
const MOST_AT_ONCE: usize = 64;

/// A method with its state.
#[derive(Clone, Debug)]
pub struct Integrator {
    method: Method,
    tolerances: Tolerances,
    step: OneStep,
    state: IntegratorState,
    next_q: Vec<f64>,
    next: Vec<f64>,
    /// The last accepted step can still be sampled.
    pending: bool,
    latest: f64,
    passing: Passing,
}

impl Integrator {
    /// At (t, q, v) with auxiliary quantities `aux`.
    pub fn new(
        model: &Model,
        method: Method,
        tolerances: Tolerances,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
    ) -> Self {
        let (nq, nv) = (model.nq(), model.nv());
        let state = IntegratorState {
            t,
            q: q.to_vec(),
            v: v.to_vec(),
            aux: aux.to_vec(),
            v_dot: vec![0.0; nv],
            aux_dot: vec![0.0; aux.len()],
            h: 0.0,
            last_error: 1e-4,
            largest: v.iter().map(|x| x.abs()).collect(),
            counts: [0; 3],
            carried: false,
            modes: Vec::new(),
            sides: Vec::new(),
        };
        Integrator {
            method,
            tolerances,
            step: OneStep::new(method, nq, nv, aux.len()),
            state,
            next_q: vec![0.0; nq],
            next: Vec::new(),
            pending: false,
            latest: f64::INFINITY,
            passing: Passing::default(),
        }
    }
    /// Time.
    pub fn t(&self) -> f64 {
        self.state.t
    }
    /// Configuration.
    pub fn q(&self) -> &[f64] {
        &self.state.q
    }
    /// Velocity.
    pub fn v(&self) -> &[f64] {
        &self.state.v
    }
    /// Auxiliary quantities.
    pub fn aux(&self) -> &[f64] {
        &self.state.aux
    }
    /// Accepted and rejected steps, evaluations.
    pub fn counts(&self) -> [u64; 3] {
        self.state.counts
    }
    /// Modes of the joints with stops or friction; none before the first step.
    pub fn modes(&self) -> &[Mode] {
        &self.state.modes
    }
    /// What has happened since the last call of [`Integrator::forget_occurrences`].
    pub fn occurrences(&self) -> &[Occurrence] {
        &self.passing.log
    }
    /// Forgets what has happened.
    pub fn forget_occurrences(&mut self) {
        self.passing.log.clear();
    }
    /// Passes over events that change nothing, for a run that another one is compared with.
    pub fn ignore_records(&mut self) {
        self.passing.ignores_records = true;
    }
    /// The next derivative is evaluated anew: after a time at which a force is not smooth.
    pub fn restart(&mut self) {
        self.state.carried = false;
    }
    /// Proposes the size of the next step.
    pub fn propose(&mut self, h: f64) {
        self.state.h = h;
    }
    /// Everything that continues bit for bit.
    pub fn checkpoint(&self) -> IntegratorState {
        self.state.clone()
    }
    /// Continues from a checkpoint of the same method and model.
    pub fn restore(&mut self, state: IntegratorState) {
        self.state = state;
        self.pending = false;
    }

    /// Moves the method's scratch to the present state.
    fn settle<S: System>(&mut self, system: &mut S) -> Result<(), IntegrateError<S::Error>> {
        self.enter_modes(system)?;
        let s = &mut self.state;
        self.pending = false;
        self.step.resume((&s.q, &s.v, &s.aux), (&s.v_dot, &s.aux_dot), s.counts[2]);
        if !s.carried {
            let t = s.t;
            self.step
                .begin(system, t, (&s.q, &s.v, &s.aux))
                .map_err(|cause| IntegrateError::Start { t, cause })?;
            s.counts[2] = self.step.evaluations();
            let (v_dot, aux_dot) = self.step.carried();
            s.v_dot.copy_from_slice(v_dot);
            s.aux_dot.copy_from_slice(aux_dot);
            s.carried = true;
        }
        Ok(())
    }

    /// Hairer's first guess of a step, from the sizes of the first derivative and its change over a small step.
    fn first_step<S: System>(&mut self, system: &mut S, limit: f64) -> f64 {
        let s = &self.state;
        let span = limit - s.t;
        let Tolerances { rtol, atol, max_step } = self.tolerances;
        let norm = |xi: &mut dyn Iterator<Item = f64>, v: &mut dyn Iterator<Item = f64>| {
            let xi: f64 = xi.map(|x| (x / atol).powi(2)).sum();
            let v: f64 = v.zip(&s.largest).map(|(x, l)| (x / (rtol * (1.0 + l))).powi(2)).sum();
            ((xi + v) / (2.0 * s.v.len().max(1) as f64)).sqrt()
        };
        let d0 = norm(&mut std::iter::empty(), &mut s.v.iter().copied());
        let d1 = norm(&mut s.v.iter().copied(), &mut s.v_dot.iter().copied());
        let h0 = if d0 < 1e-5 || d1 < 1e-5 { 1e-6 * span.min(1.0) } else { 0.01 * d0 / d1 };
        let h0 = h0.min(span).min(max_step);
        let (t, v_dot) = (s.t, s.v_dot.clone());
        let d2 = match self.step.attempt(system, t, h0, limit) {
            Ok(()) => {
                let (end, last) = (self.step.end_velocity(), self.step.end_rates().0);
                norm(
                    &mut end.iter().zip(&s.v).map(|(a, b)| a - b),
                    &mut last.iter().zip(&v_dot).map(|(a, b)| a - b),
                ) / h0
            }
            Err(_) => return h0 * 1e-3,
        };
        self.state.counts[2] = self.step.evaluations();
        let order = f64::from(self.step.order());
        let largest = d1.max(d2);
        let h1 = if largest <= 1e-15 { (h0 * 1e-3).max(1e-6) } else { (0.01 / largest).powf(1.0 / order) };
        (100.0 * h0).min(h1).min(span).min(max_step)
    }

    /// One accepted step, ending at `limit` at the latest and exactly there when it is reached.
    ///
    /// `is_break`: a force is not smooth at `limit`, so stages at the very end are evaluated just before it.
    ///
    /// # Errors
    /// [`IntegrateError`]; the state is that before the step.
    pub fn step<S: System>(
        &mut self,
        system: &mut S,
        limit: f64,
        is_break: bool,
    ) -> Result<StepInfo, IntegrateError<S::Error>> {
        self.settle(system)?;
        let mut at_once = 0;
        self.latest = if is_break { limit.next_down() } else { f64::INFINITY };
        let t0 = self.state.t;
        let fixed = if let Method::Rk4 { step } = self.method { Some(step) } else { None };
        if self.state.h == 0.0 {
            self.state.h = fixed.unwrap_or_else(|| self.first_step(system, limit));
        }
        let mut h = self.state.h.min(self.tolerances.max_step);
        let mut cause = None;
        let mut rejected = false;
        loop {
            // A remainder of less than a hundredth of a step (a fixed one: of rounding) is taken with it.
            let stretch = if fixed.is_some() { 1.0 + 1e-9 } else { 1.01 };
            let landing = t0 + stretch * h >= limit;
            // The step is the difference of its times as they round, for forces and prescribed motions see the times: 22 m/s by
            // half an ulp of 0.1 s are 1.5e-16 m a step.
            let t1 = if landing { limit } else { t0 + h };
            let trial = t1 - t0;
            if trial.is_nan() || trial <= 4.0 * f64::EPSILON * t0.abs().max(f64::MIN_POSITIVE) {
                return Err(IntegrateError::StepUnderflow { t: t0, h: trial, cause });
            }
            let result = self.step.attempt(system, t0, trial, self.latest);
            self.state.counts[2] = self.step.evaluations();
            let error = match result {
                Ok(()) => {
                    let Tolerances { rtol, atol, .. } = self.tolerances;
                    let turned = largest_rotation(system.model(), self.step.end_increment());
                    cause = None;
                    // Beyond half a turn the increment's chart ends.
                    if turned > std::f64::consts::PI {
                        f64::INFINITY
                    } else {
                        self.step.error(atol, rtol, &self.state.largest)
                    }
                }
                Err(e) => {
                    cause = Some(e);
                    f64::INFINITY
                }
            };
            if fixed.is_some() && error.is_infinite() {
                return Err(IntegrateError::StepUnderflow { t: t0, h: trial, cause });
            }
            let mut refused = error.is_nan() || error > 1.0;
            let mut projected = None;
            if !refused {
                match self.arrive(system, t1) {
                    Ok(done) => projected = done,
                    Err(e) => {
                        cause = Some(StageError::System(e));
                        refused = true;
                    }
                }
            }
            if !refused {
                match self.look_for_events(system, t0, t1) {
                    Ok(Ahead::Nothing) => {
                        self.finish(t1, trial, error, rejected, fixed, projected.is_none());
                        return Ok(StepInfo { t0, t1, projected, event: false, stop: false });
                    }
                    Ok(Ahead::Passage { index, t, projected }) => {
                        let Tolerances { rtol, atol, .. } = self.tolerances;
                        let error = self.step.error(atol, rtol, &self.state.largest);
                        self.finish(t, t - t0, error, rejected, fixed, projected.is_none());
                        let stop = self.happen(system, index)?;
                        return Ok(StepInfo { t0, t1: t, projected, event: true, stop });
                    }
                    Ok(Ahead::AtOnce { index }) => {
                        at_once += 1;
                        if at_once > MOST_AT_ONCE {
                            return Err(IntegrateError::Endless { t: t0, events: at_once });
                        }
                        if self.happen(system, index)? {
                            return Ok(StepInfo { t0, t1: t0, projected: None, event: true, stop: true });
                        }
                        self.settle(system)?;
                        continue;
                    }
                    Err(e) => cause = Some(e),
                }
            }
            if fixed.is_some() {
                return Err(IntegrateError::StepUnderflow { t: t0, h: trial, cause });
            }
            rejected = true;
            self.state.counts[1] += 1;
            let (alpha, _) = self.step.controller();
            h = trial
                * if error.is_finite() && error > 1.0 {
                    (0.9 * error.powf(-alpha)).clamp(0.2, 0.9)
                } else {
                    0.25
                };
        }
    }

    /// The end of the attempted step, projected.
    fn arrive<S: System>(&mut self, system: &mut S, t1: f64) -> Result<Option<Projected>, S::Error> {
        self.step.accept(system, &mut self.next_q, &mut self.next);
        let nv = self.state.v.len();
        system.project(t1.min(self.latest), &mut self.next_q, &mut self.next[nv..2 * nv])
    }

    /// Takes the end of the attempted step over; `carries`: its derivative is that of the next start.
    fn finish(&mut self, t1: f64, trial: f64, error: f64, rejected: bool, fixed: Option<f64>, carries: bool) {
        let s = &mut self.state;
        let nv = s.v.len();
        if fixed.is_none() {
            let (alpha, beta) = self.step.controller();
            let error = error.max(1e-10);
            let factor = (0.9 * error.powf(-alpha) * s.last_error.powf(beta))
                .clamp(0.2, if rejected { 1.0 } else { 6.0 });
            // A step cut short by its limit says little about the next one: it must not shrink the proposal.
            let proposal = trial * factor;
            s.h = if trial < 0.999 * s.h && !rejected { proposal.max(s.h) } else { proposal };
            s.last_error = error;
        }
        s.t = t1;
        s.q.copy_from_slice(&self.next_q);
        s.v.copy_from_slice(&self.next[nv..2 * nv]);
        s.aux.copy_from_slice(&self.next[2 * nv..]);
        let (v_dot, aux_dot) = self.step.end_rates();
        s.v_dot.copy_from_slice(v_dot);
        s.aux_dot.copy_from_slice(aux_dot);
        s.largest.iter_mut().zip(&s.v).for_each(|(l, v)| *l = l.max(v.abs()));
        s.counts[0] += 1;
        s.carried = carries;
        self.pending = true;
    }

    /// State at a time inside the last accepted step: q, v, aux.
    ///
    /// # Errors
    /// [`IntegrateError::Start`] if a further stage of the dense output fails.
    pub fn sample<S: System>(
        &mut self,
        system: &mut S,
        t: f64,
        q: &mut [f64],
        v: &mut [f64],
        aux: &mut [f64],
    ) -> Result<(), IntegrateError<S::Error>> {
        let Some(theta) = self.inside(t) else {
            self.present(q, v, aux);
            return Ok(());
        };
        let result = self.step.sample(system, theta, self.latest, q, v, aux);
        self.state.counts[2] = self.step.evaluations();
        result
            .and_then(|()| system.project(t.min(self.latest), q, v).map_err(StageError::System))
            .map(|_| ())
            .map_err(|cause| IntegrateError::Start { t, cause })
    }
    /// The same without evaluations and projections. Of DOP853 to fifth order: where its step is a radian of an oscillation, 1e-5 of the
    /// amplitude, where it is three, 1e-2. At the step's end nothing is lost.
    pub fn sample_roughly<S: System>(
        &mut self,
        system: &S,
        t: f64,
        q: &mut [f64],
        v: &mut [f64],
        aux: &mut [f64],
    ) {
        match self.inside(t) {
            Some(theta) => self.step.sample_roughly(system, theta, q, v, aux),
            None => self.present(q, v, aux),
        }
    }
    /// Fraction of the last accepted step; `None` at its end, and where nothing but the end is left of it.
    fn inside(&self, t: f64) -> Option<f64> {
        let (start, h) = self.step.span();
        (t != self.state.t && self.pending).then(|| (t - start) / h)
    }
    fn present(&self, q: &mut [f64], v: &mut [f64], aux: &mut [f64]) {
        q.copy_from_slice(&self.state.q);
        v.copy_from_slice(&self.state.v);
        aux.copy_from_slice(&self.state.aux);
    }
}
