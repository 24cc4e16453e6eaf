//! The estimate of the error at the end of a run.

use super::Runner;
use crate::error::SimulateError;
use crate::record::Observer;
use crate::simulation::Simulation;
use phipsi_model::{Model, State};
use phipsi_motion::{
    Dynamics, ErrorEstimate, Events, IntegrateError, JudgedRun, Linearization, Method, MotionError,
    Projected, System, estimate_error,
};

/// Most instants at which a run is compared with its companion. In a run of some dozens of steps each takes a dense output of the companion,
/// a quarter more of a step, and a projection; where the run is lost, this is how finely its horizon is told.
pub(super) const JUDGED_SAMPLES: usize = 32;

/// What the integration of a companion comes to.
pub(super) type Estimated = Result<ErrorEstimate, IntegrateError<MotionError>>;

impl Runner<'_> {
    /// The estimate of the error at the end, with what the observer has kept of the run: from the companion beside it, or made now.
    pub(super) fn estimate(
        &mut self,
        method: Method,
        breaks: &[f64],
        observer: &mut dyn Observer,
    ) -> Result<Option<ErrorEstimate>, SimulateError> {
        let samples = observer.spread_rows(JUDGED_SAMPLES)?;
        if let Some(companion) = self.companion.take().filter(|c| c.fits(&samples)) {
            self.estimated_beside = true;
            return Ok(companion.finish(samples, self.simulation.model(), observer));
        }
        self.estimate_after(method, breaks, &samples, observer)
    }

    fn estimate_after(
        &mut self,
        method: Method,
        breaks: &[f64],
        samples: &[State],
        observer: &mut dyn Observer,
    ) -> Result<Option<ErrorEstimate>, SimulateError> {
        let steps = observer.step_ends()?;
        let Simulation { dynamics, start, tolerances, .. } = &mut *self.simulation;
        dynamics.pass_over_stops(true);
        let aux = vec![0.0; dynamics.auxiliary_len()];
        let judged = JudgedRun {
            method,
            tolerances: *tolerances,
            start: (start.t, &start.q, &start.v, &aux),
            steps: &steps,
            breaks,
            samples,
            events: &self.events,
        };
        let mut watched = Watched { dynamics, stop: &|| observer.stop() };
        let estimate = estimate_error(&mut watched, &judged);
        watched.dynamics.pass_over_stops(false);
        Ok(in_words(estimate, self.simulation.model(), observer))
    }
}

/// The estimate, or why there is none; `None` if the user wants to stop.
pub(super) fn in_words(
    estimated: Estimated,
    model: &Model,
    observer: &mut dyn Observer,
) -> Option<ErrorEstimate> {
    if observer.stop() {
        return None;
    }
    // The run itself has succeeded: that there is no estimate is a result too.
    Some(estimated.unwrap_or_else(|e| {
        let how = format!("none: the companion run stopped, {}", e.describe(model));
        ErrorEstimate { q: None, v: None, horizon: None, how, evaluations: 0 }
    }))
}

/// A system that gives up when nobody wants the estimate any more: it has no steps of its own to stop after.
pub(super) struct Watched<'a> {
    pub(super) dynamics: &'a mut Dynamics,
    pub(super) stop: &'a dyn Fn() -> bool,
}

impl System for Watched<'_> {
    type Error = MotionError;
    fn model(&self) -> &Model {
        self.dynamics.model()
    }
    fn auxiliary_len(&self) -> usize {
        self.dynamics.auxiliary_len()
    }
    fn derivative(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
        v_dot: &mut [f64],
        aux_dot: &mut [f64],
    ) -> Result<(), MotionError> {
        if (self.stop)() {
            let message = "stopped by the user".into();
            return Err(MotionError::Force(phipsi_motion::ForceError { force: "run".into(), t, message }));
        }
        self.dynamics.derivative(t, q, v, aux, v_dot, aux_dot)
    }
    fn is_autonomous(&self) -> bool {
        self.dynamics.is_autonomous()
    }
    fn events(&mut self) -> Option<&mut dyn Events<Error = MotionError>> {
        self.dynamics.events()
    }
    fn linearize(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
        out: &mut Linearization,
    ) -> Result<u64, MotionError> {
        self.dynamics.linearize(t, q, v, aux, out)
    }
    fn project(&mut self, t: f64, q: &mut [f64], v: &mut [f64]) -> Result<Option<Projected>, MotionError> {
        self.dynamics.project(t, q, v)
    }
}
