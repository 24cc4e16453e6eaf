//! The midpoint method at the times t₀ + n h, with events that are recorded or end the run.
//!
//! | symbol | meaning |
//! |---|---|
//! | x, Φ_s | state at the start of a step, one step of size s from it |
//! | g(θ) | an event function at Φ_θh(x), 0 ≤ θ ≤ 1: continuous, and at θ = 1 the step's own end |
//!
//! A passage lies where g changes its sign between θ = 0 and 1; its root is bracketed by the Illinois rule, each value a step of its own
//! from x. The step itself is then as if nobody had looked: what is recorded leaves the map symplectic and reversible. A function that
//! passes through zero and back within one step is not seen.

use crate::dynamics::{Dynamics, MotionError};
use crate::event::{Happening, Occurrence};
use crate::event_search::side;
use crate::integrate::StepInfo;
use crate::midpoint::{Midpoint, MidpointState};
use crate::midpoint_error::MidpointError;
use phipsi_recursion::DynamicsError;

/// Most values for one root: the Illinois rule needs about ten.
const MOST_VALUES: usize = 60;

pub(super) struct FixedMidpoint {
    pub(super) method: Midpoint,
    start: f64,
    pub(super) step: f64,
    pub(super) velocity: Vec<f64>,
    /// Where an event ended the run inside a step.
    ended: Option<f64>,
    pub(super) log: Vec<Occurrence>,
}

type Failed = MidpointError<MotionError>;

impl FixedMidpoint {
    pub(super) fn new(method: Midpoint, start: f64, step: f64, velocity: &[f64]) -> Self {
        FixedMidpoint { method, start, step, velocity: velocity.to_vec(), ended: None, log: Vec::new() }
    }
    pub(super) fn t(&self) -> f64 {
        self.ended.unwrap_or(self.start + self.method.state().steps as f64 * self.step)
    }
    /// Takes over what the method has come to by itself.
    pub(super) fn settle(&mut self) -> Result<(), DynamicsError> {
        let velocity = self.method.velocity()?;
        self.velocity.copy_from_slice(velocity);
        Ok(())
    }
    /// False if the state is of another model.
    pub(super) fn restore(&mut self, state: MidpointState) -> bool {
        let t = state.t;
        self.ended = None;
        let fits = self.method.restore(state).is_ok() && self.settle().is_ok();
        // The method's own clock sums steps, with their roundings; only an event ends between two of them.
        let inside = (t - self.t()).abs() > 1e-6 * self.step.abs();
        self.ended = inside.then_some(t);
        fits
    }

    /// Part θ of a step from the method's state.
    fn part(&mut self, dynamics: &mut Dynamics, t0: f64, theta: f64) -> Result<(), Failed> {
        self.method.step(dynamics, theta * self.step)?;
        self.settle().map_err(|cause| MidpointError::Dynamics { t: t0, cause })
    }
    fn values(&self, dynamics: &mut Dynamics, t: f64, out: &mut [f64]) -> Result<(), Failed> {
        dynamics
            .user_values(t, &self.method.state().q, &self.velocity, out)
            .map_err(|cause| MidpointError::Force { t, cause })
    }

    /// One step; an event that stops the run ends it early. After an error the state is that before the step.
    pub(super) fn advance(&mut self, dynamics: &mut Dynamics) -> Result<StepInfo, Failed> {
        self.log.clear();
        self.ended = None;
        let t0 = self.t();
        let failed = |cause| MidpointError::Dynamics { t: t0, cause };
        let stop = if dynamics.user_events().is_empty() {
            self.part(dynamics, t0, 1.0)?;
            false
        } else {
            let before = self.method.state().clone();
            match self.watched(dynamics, t0, &before) {
                Ok(stop) => stop,
                Err(e) => {
                    self.method.reset(&before).and_then(|()| self.settle()).map_err(failed)?;
                    return Err(e);
                }
            }
        };
        // A sum of all steps would carry their roundings.
        let (t1, state) = (self.t(), self.method.state());
        let (steps, iterations) = (state.steps, state.iterations);
        self.method.count(t1, steps, iterations);
        let projected = self.method.residual().map_err(failed)?;
        Ok(StepInfo { t0, t1, projected, event: !self.log.is_empty(), stop })
    }

    /// A step on which events are watched; true if one stops the run.
    fn watched(&mut self, dynamics: &mut Dynamics, t0: f64, before: &MidpointState) -> Result<bool, Failed> {
        let n = dynamics.user_events().len();
        let [mut old, mut new, mut inside] = std::array::from_fn(|_| vec![0.0; n]);
        self.values(dynamics, t0, &mut old)?;
        self.part(dynamics, t0, 1.0)?;
        self.values(dynamics, self.t(), &mut new)?;
        let after = self.method.state().clone();
        let mut passages = Vec::new();
        for i in 0..n {
            let (left, direction) = (side(old[i]), dynamics.user_events()[i].direction);
            if !new[i].is_nan() && side(new[i]) != left && direction.leaves(left) {
                passages.push((self.root(dynamics, before, (t0, i), [old[i], new[i]], &mut inside)?, i));
            }
        }
        passages.sort_by(|a, b| a.0.total_cmp(&b.0));
        let last = passages.iter().find(|(_, i)| dynamics.ends(*i)).map(|p| p.0);
        for (theta, index) in passages.into_iter().filter(|p| last.is_none_or(|last| p.0 <= last)) {
            let what = Happening::Event { index };
            self.log.push(Occurrence { t: t0 + theta * self.step, what });
        }
        let failed = |cause| MidpointError::Dynamics { t: t0, cause };
        match last {
            Some(theta) if theta < 1.0 => {
                self.method.reset(before).map_err(failed)?;
                self.part(dynamics, t0, theta)?;
                self.ended = Some(t0 + theta * self.step);
            }
            _ => self.method.reset(&after).and_then(|()| self.settle()).map_err(failed)?,
        }
        Ok(last.is_some())
    }

    /// θ where function i passes through zero, its values at both ends given.
    fn root(
        &mut self,
        dynamics: &mut Dynamics,
        before: &MidpointState,
        (t0, i): (f64, usize),
        [mut g0, mut g1]: [f64; 2],
        values: &mut [f64],
    ) -> Result<f64, Failed> {
        let (mut lower, mut upper) = (0.0, 1.0);
        let resolution = 2.0 * f64::EPSILON * (t0.abs() / self.step).max(1.0);
        let mut replaced = 0;
        for _ in 0..MOST_VALUES {
            if g1 == 0.0 || upper - lower <= resolution {
                break;
            }
            let chord = lower + (upper - lower) * g0 / (g0 - g1);
            // A chord that does not fall inside, as of an infinite value, is no better than the middle.
            let theta = if lower < chord && chord < upper { chord } else { 0.5 * (lower + upper) };
            self.method.reset(before).map_err(|cause| MidpointError::Dynamics { t: t0, cause })?;
            self.part(dynamics, t0, theta)?;
            self.values(dynamics, t0 + theta * self.step, values)?;
            let g = values[i];
            if side(g) == side(g0) {
                (lower, g0) = (theta, g);
                g1 *= if replaced == -1 { 0.5 } else { 1.0 };
                replaced = -1;
            } else {
                (upper, g1) = (theta, g);
                g0 *= if replaced == 1 { 0.5 } else { 1.0 };
                replaced = 1;
            }
        }
        Ok(upper)
    }
}
