//! One face for all integration schemes: explicit methods with error control, and the midpoint method.

use crate::dynamics::{Dynamics, MotionError};
use crate::event::{Mode, Occurrence};
use crate::integrate::{IntegrateError, Integrator, IntegratorState, Method, StepInfo, Tolerances};
use crate::midpoint::{Midpoint, MidpointState};
use crate::midpoint_error::MidpointError;
use crate::system::{Projected, System};
use phipsi_model::{Model, State};
use std::fmt;

mod fixed_midpoint;

use fixed_midpoint::FixedMidpoint;

/// How a simulation advances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scheme {
    /// An explicit method on (q, v).
    Explicit(Method),
    /// Kick – variational midpoint drift – kick on (q, p): order 2, symplectic, for conservative forces.
    Midpoint {
        /// Step size.
        step: f64,
    },
}

impl From<Method> for Scheme {
    fn from(method: Method) -> Self {
        Scheme::Explicit(method)
    }
}

impl Scheme {
    /// The step of a scheme of fixed step.
    pub fn fixed_step(&self) -> Option<f64> {
        match self {
            Scheme::Explicit(Method::Rk4 { step }) | Scheme::Midpoint { step } => Some(*step),
            Scheme::Explicit(_) => None,
        }
    }
}

/// Why a step could not be made; the state before it is intact.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum StepError {
    /// Of an explicit method.
    Explicit(IntegrateError<MotionError>),
    /// Of the midpoint method.
    Midpoint(MidpointError<MotionError>),
}

impl StepError {
    /// The time of the last good state.
    pub fn time(&self) -> f64 {
        match self {
            StepError::Explicit(
                IntegrateError::StepUnderflow { t, .. }
                | IntegrateError::Start { t, .. }
                | IntegrateError::Endless { t, .. },
            ) => *t,
            StepError::Midpoint(
                MidpointError::Force { t, .. }
                | MidpointError::Dynamics { t, .. }
                | MidpointError::Closure { t, .. }
                | MidpointError::NotFinite { t, .. }
                | MidpointError::NotConverged { t, .. },
            ) => *t,
        }
    }
    /// In words, with names from the model.
    pub fn describe(&self, model: &Model) -> String {
        match self {
            StepError::Explicit(e) => e.describe(model),
            StepError::Midpoint(e) => e.to_string(),
        }
    }
}

impl fmt::Display for StepError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StepError::Explicit(e) => write!(f, "{e:?}"),
            StepError::Midpoint(e) => e.fmt(f),
        }
    }
}

impl std::error::Error for StepError {}

/// Everything that continues a run bit for bit.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum StepperState {
    /// Of an explicit method.
    Explicit(IntegratorState),
    /// Of the midpoint method.
    Midpoint(MidpointState),
}

/// A scheme with its state.
pub struct Stepper(Kind);

enum Kind {
    Explicit(Box<Integrator>),
    Midpoint(Box<FixedMidpoint>),
}

impl Stepper {
    /// At a state, with auxiliary quantities `aux` (the midpoint method has none).
    ///
    /// # Errors
    /// [`StepError`] of the midpoint method, whose momenta and forces are needed at the start.
    pub fn new(
        dynamics: &mut Dynamics,
        scheme: Scheme,
        tolerances: Tolerances,
        start: &State,
        aux: &[f64],
    ) -> Result<Self, StepError> {
        let State { q, v, t } = start;
        Ok(Stepper(match scheme {
            Scheme::Explicit(method) => {
                let explicit = Integrator::new(dynamics.model(), method, tolerances, *t, q, v, aux);
                Kind::Explicit(Box::new(explicit))
            }
            Scheme::Midpoint { step } => {
                let model = dynamics.model().clone();
                let method = Midpoint::new(&model, dynamics, *t, q, v).map_err(StepError::Midpoint)?;
                Kind::Midpoint(Box::new(FixedMidpoint::new(method, *t, step, v)))
            }
        }))
    }
    /// Time.
    pub fn t(&self) -> f64 {
        match &self.0 {
            Kind::Explicit(i) => i.t(),
            Kind::Midpoint(m) => m.t(),
        }
    }
    /// Configuration.
    pub fn q(&self) -> &[f64] {
        match &self.0 {
            Kind::Explicit(i) => i.q(),
            Kind::Midpoint(m) => &m.method.state().q,
        }
    }
    /// Velocity.
    pub fn v(&self) -> &[f64] {
        match &self.0 {
            Kind::Explicit(i) => i.v(),
            Kind::Midpoint(m) => &m.velocity,
        }
    }
    /// Auxiliary quantities.
    pub fn aux(&self) -> &[f64] {
        match &self.0 {
            Kind::Explicit(i) => i.aux(),
            Kind::Midpoint(_) => &[],
        }
    }
    /// Accepted and rejected steps, evaluations of the forces.
    pub fn counts(&self) -> [u64; 3] {
        match &self.0 {
            Kind::Explicit(i) => i.counts(),
            // One evaluation (of the fast forces) a step, or a short step of several, and the one at the start.
            Kind::Midpoint(m) => {
                let steps = m.method.state().steps;
                [steps, 0, steps * m.method.substeps.max(1) as u64 + 1]
            }
        }
    }
    /// What happened in the last step.
    pub fn occurrences(&self) -> &[Occurrence] {
        match &self.0 {
            Kind::Explicit(i) => i.occurrences(),
            Kind::Midpoint(m) => &m.log,
        }
    }
    /// Modes of the joints with stops or friction.
    pub fn modes(&self) -> &[Mode] {
        match &self.0 {
            Kind::Explicit(i) => i.modes(),
            Kind::Midpoint(_) => &[],
        }
    }
    /// The next derivative is evaluated anew: after a time at which a force is not smooth.
    pub fn restart(&mut self) {
        if let Kind::Explicit(i) = &mut self.0 {
            i.restart();
        }
    }
    /// One accepted step; an explicit method ends it at `limit` at the latest. `is_break`: see [`Integrator::step`].
    ///
    /// # Errors
    /// [`StepError`].
    pub fn step(
        &mut self,
        dynamics: &mut Dynamics,
        limit: f64,
        is_break: bool,
    ) -> Result<StepInfo, StepError> {
        match &mut self.0 {
            Kind::Explicit(i) => {
                i.forget_occurrences();
                i.step(dynamics, limit, is_break).map_err(StepError::Explicit)
            }
            Kind::Midpoint(m) => m.advance(dynamics).map_err(StepError::Midpoint),
        }
    }
    /// What is open of the closures of the midpoint method; `None` for trees and explicit methods.
    ///
    /// # Errors
    /// [`StepError`] if the loops cannot be placed.
    pub fn residual(&mut self) -> Result<Option<Projected>, StepError> {
        let Kind::Midpoint(m) = &mut self.0 else { return Ok(None) };
        let t = m.t();
        m.method.residual().map_err(|cause| StepError::Midpoint(MidpointError::Dynamics { t, cause }))
    }
    /// The midpoint method with its step size, for what acts between steps or makes them; `None` for an explicit method.
    ///
    /// # Errors
    /// Those of `act`, and [`StepError`] if the velocity has no value afterwards.
    pub fn with_midpoint<R>(
        &mut self,
        act: impl FnOnce(&mut Midpoint, f64) -> Result<R, MidpointError<MotionError>>,
    ) -> Result<Option<R>, StepError> {
        let Kind::Midpoint(m) = &mut self.0 else { return Ok(None) };
        m.log.clear();
        let t = m.t();
        let done = act(&mut m.method, m.step).map_err(StepError::Midpoint)?;
        m.settle().map_err(|cause| StepError::Midpoint(MidpointError::Dynamics { t, cause }))?;
        Ok(Some(done))
    }
    /// State at a time inside the last step: q, v, aux. The midpoint method gives the end of the step.
    ///
    /// # Errors
    /// [`StepError`] if a further stage of the dense output fails.
    pub fn sample(
        &mut self,
        dynamics: &mut Dynamics,
        t: f64,
        q: &mut [f64],
        v: &mut [f64],
        aux: &mut [f64],
    ) -> Result<(), StepError> {
        match &mut self.0 {
            Kind::Explicit(i) => i.sample(dynamics, t, q, v, aux).map_err(StepError::Explicit),
            Kind::Midpoint(m) => {
                q.copy_from_slice(&m.method.state().q);
                v.copy_from_slice(&m.velocity);
                Ok(())
            }
        }
    }
    /// Everything that continues bit for bit.
    pub fn checkpoint(&self) -> StepperState {
        match &self.0 {
            Kind::Explicit(i) => StepperState::Explicit(i.checkpoint()),
            Kind::Midpoint(m) => StepperState::Midpoint(m.method.state().clone()),
        }
    }
    /// Continues from a checkpoint; false if it is of another scheme or model.
    pub fn restore(&mut self, state: StepperState) -> bool {
        match (&mut self.0, state) {
            (Kind::Explicit(i), StepperState::Explicit(s)) => {
                let (now, nv) = (i.checkpoint(), s.v.len());
                let fits = now.q.len() == s.q.len()
                    && [&now.v, &s.v_dot, &s.largest].iter().all(|x| x.len() == nv)
                    && now.aux.len() == s.aux.len()
                    && s.aux.len() == s.aux_dot.len();
                if fits {
                    i.restore(s);
                }
                fits
            }
            (Kind::Midpoint(m), StepperState::Midpoint(s)) => m.restore(s),
            _ => false,
        }
    }
}
