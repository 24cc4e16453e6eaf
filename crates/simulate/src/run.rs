//! The run loop: steps, samples, balances, limits, checkpoints, and the error estimate at the end.

use crate::error::SimulateError;
use crate::event_record::EventRecord;
use crate::output::reference_error;
use crate::recluster::ChangeRecord;
use crate::record::{LimitPassed, Observer, StepRecord};
use crate::simulation::Simulation;
use phipsi_model::{Model, State};
use phipsi_molecule::Bath;
use phipsi_motion::{Conserved, ErrorEstimate, Occurrence, Scheme, StepError, StepInfo, Stepper, System};
use phipsi_recursion::Kinematics;
use std::time::Instant;

mod change;
mod companion;
mod cores;
mod estimate;
mod phase;
mod recording;
mod results;

use companion::Companion;
use cores::CORES;
use phase::Phase;

pub use phase::PhaseState;
pub use results::{ClosureRecord, Progress, RunState, Summary};

/// Steps after which a run looks whether its end is within reach.
const LOOK_AHEAD: u64 = 100_000;

/// More steps than these have no end: thirty years at a microsecond each, and time does not tell that many apart.
const MOST_STEPS: f64 = 1e15;

/// Runs a simulation from its start.
///
/// # Errors
/// [`SimulateError`]; everything recorded so far has reached the observer.
pub fn run(simulation: &mut Simulation, observer: &mut dyn Observer) -> Result<Summary, SimulateError> {
    Runner::new(simulation, None)?.run(observer)
}

/// Continues a run from a checkpoint of the same simulation.
///
/// # Errors
/// As [`run`].
pub fn resume(
    simulation: &mut Simulation,
    state: RunState,
    observer: &mut dyn Observer,
) -> Result<Summary, SimulateError> {
    Runner::new(simulation, Some(state))?.run(observer)
}

struct Runner<'a> {
    simulation: &'a mut Simulation,
    stepper: Stepper,
    bath: Option<Bath>,
    kinematics: Kinematics<f64>,
    conserved: Conserved,
    closures: Option<ClosureRecord>,
    rows: u64,
    steps: u64,
    limits: Vec<LimitPassed>,
    events: Vec<Occurrence>,
    /// True if an event has ended the run.
    ended: bool,
    /// One-axis joints with limits that are no stops: (joint, index in q, limits).
    limited: Vec<(usize, usize, [f64; 2])>,
    spent_s: f64,
    clock: Instant,
    /// Makes the error estimate beside the run.
    companion: Option<Companion>,
    estimated_beside: bool,
    /// Clusters other than those of the scene's model, and the changes so far.
    phase: Option<Phase>,
    changes: Vec<ChangeRecord>,
}

impl<'a> Runner<'a> {
    fn new(simulation: &'a mut Simulation, state: Option<RunState>) -> Result<Self, SimulateError> {
        if let Scheme::Midpoint { .. } = simulation.choice.method {
            simulation.dynamics.leave_out_integrals();
        }
        let model = simulation.dynamics.model();
        let start = &simulation.start;
        for (what, found, required) in [("q", start.q.len(), model.nq()), ("v", start.v.len(), model.nv())] {
            if found != required {
                return Err(SimulateError::Start(format!(
                    "`{what}` of the start has length {found}, but length {required} is required"
                )));
            }
        }
        let settled = simulation.settle_start()?.filter(|_| simulation.dynamics.plan().loops);
        // What a start that is not exact loses is no loss of the run.
        let closures = settled.map(|p| ClosureRecord { energy_removed: 0.0, ..ClosureRecord::of(&p) });
        let (mut phase, start) = match change::first_phase(simulation, state.as_ref())? {
            Some((phase, start)) => (Some(phase), start),
            None => (None, simulation.start.clone()),
        };
        let (mut stepper, bath) = stepper(simulation, phase.as_mut(), &start)?;
        if let Some(s) = &state
            && !stepper.restore(s.stepper.clone())
        {
            return Err(SimulateError::Start("the checkpoint is of another scene".into()));
        }
        let model = simulation.dynamics.model();
        let has_stops = |k: usize| {
            let mut stops = simulation.dynamics.switches().iter().filter(|s| s.stops.is_some());
            stops.any(|s| s.dof == model.v_offset(k))
        };
        let limited = model
            .moving_joints()
            .filter(|&k| model.joints()[k].kind.nv() == 1 && !has_stops(k))
            .filter_map(|k| Some((k, model.q_offset(k), model.joints()[k].limits.position?)))
            .collect();
        let mut runner = Runner {
            kinematics: Kinematics::new(simulation.dynamics.layout()),
            conserved: Conserved::default(),
            closures,
            rows: 0,
            steps: 0,
            limits: Vec::new(),
            events: Vec::new(),
            ended: false,
            limited,
            spent_s: 0.0,
            clock: Instant::now(),
            companion: None,
            estimated_beside: false,
            phase,
            changes: Vec::new(),
            stepper,
            bath,
            simulation,
        };
        if let Some(s) = state {
            match (&mut runner.bath, &s.bath) {
                (Some(bath), Some(state)) => bath.restore(state),
                (None, None) => {}
                _ => return Err(SimulateError::Start("the checkpoint is of another scene".into())),
            }
            runner.conserved = s.conserved;
            runner.closures = s.closures;
            (runner.rows, runner.steps) = (s.rows, s.steps);
            runner.limits = s.limits;
            runner.changes = s.changes;
            (runner.events, runner.ended) = (s.events, s.ended);
            runner.spent_s = s.wall_s;
        }
        Ok(runner)
    }

    fn wall_s(&self) -> f64 {
        self.spent_s + self.clock.elapsed().as_secs_f64()
    }

    fn run(mut self, observer: &mut dyn Observer) -> Result<Summary, SimulateError> {
        let _busy = CORES.occupy();
        let (t0, t_end) = (self.simulation.start.t, self.simulation.t_end);
        let breaks: Vec<f64> =
            self.simulation.dynamics.breaks().into_iter().filter(|b| *b > t0 && *b < t_end).collect();
        if self.rows == 0 {
            let balance = self.balance()?;
            self.conserved.record(&balance);
            self.watch_limits(t0);
            self.record_due(observer)?;
        }
        let mut stopped = observer.stop();
        let mut mark = (self.stepper.t(), self.steps);
        // A fixed step that ends within rounding of the end has reached it.
        let last = t_end - self.simulation.choice.method.fixed_step().map_or(0.0, |step| 1e-6 * step);
        if !stopped && !self.ended && self.stepper.t() < last {
            self.begin_companion(&breaks, observer)?;
        }
        while !stopped && !self.ended && self.stepper.t() < last {
            let t = self.stepper.t();
            let next = breaks.partition_point(|b| *b <= t);
            let limit = breaks.get(next).copied().unwrap_or(t_end);
            let stepped = match self.change_if_due() {
                Ok(()) => self.step(limit, limit < t_end, observer),
                Err(e) => Err(e),
            };
            if let Err(e) = stepped {
                // A step that failed has left the last good state. The first error is the one to tell.
                if self.stepper.t() == t {
                    let _ = observer.stopped(&self.progress());
                }
                return Err(e);
            }
            stopped = observer.stop();
            if self.steps - mark.1 >= LOOK_AHEAD {
                if let Err(e) = self.look_ahead(mark.0) {
                    let _ = observer.stopped(&self.progress());
                    return Err(e);
                }
                mark = (self.stepper.t(), self.steps);
            }
        }
        if stopped {
            observer.stopped(&self.progress())?;
        }
        let mut estimate = None;
        if let Scheme::Explicit(method) = self.simulation.choice.method
            && !stopped
            && self.simulation.estimate
        {
            observer.estimating();
            estimate = self.estimate(method, &breaks, observer)?;
            stopped = observer.stop();
        }
        self.summary(estimate, !stopped)
    }

    /// Begins the companion run of the estimate on a thread of its own, where that can be.
    fn begin_companion(&mut self, breaks: &[f64], observer: &mut dyn Observer) -> Result<(), SimulateError> {
        if let Scheme::Explicit(method) = self.simulation.choice.method
            && self.simulation.estimate
        {
            let steps = if self.steps > 0 { observer.step_ends()? } else { Vec::new() };
            self.companion = Companion::begin(self.simulation, method, breaks, &steps, &self.events);
        }
        Ok(())
    }

    /// Refuses an end that steps like those since `before` do not reach.
    fn look_ahead(&self, before: f64) -> Result<(), SimulateError> {
        let (t, t_end, unit) = (self.stepper.t(), self.simulation.t_end, self.simulation.time_unit());
        let step = (t - before) / LOOK_AHEAD as f64;
        let left = (t_end - t) / step;
        if left <= MOST_STEPS {
            return Ok(());
        }
        let message = format!(
            "after {} steps the run is at t = {t:.2e} {unit} and goes on by {step:.1e} {unit} a step: its end at t = {t_end:e} {unit} \
             is {left:.0e} steps away, but at most {MOST_STEPS:e} are within reach; choose an earlier t_end, or let an event stop the run",
            self.steps
        );
        Err(SimulateError::Stopped { t, message })
    }

    /// One accepted step with everything that is looked at after it.
    fn step(&mut self, limit: f64, is_break: bool, observer: &mut dyn Observer) -> Result<(), SimulateError> {
        let info = self.advance(limit, is_break)?;
        self.events.extend_from_slice(self.stepper.occurrences());
        self.ended |= info.stop;
        if let Some(companion) = &mut self.companion {
            companion.step(info.t1, self.stepper.occurrences());
        }
        if let (Some(record), Some(projected)) = (&mut self.closures, &info.projected) {
            record.record(projected);
        }
        self.record_due(observer)?;
        let balance = self.balance()?;
        let mut imbalance = self.conserved.record(&balance);
        if self.bath.is_some() {
            // It changes momenta: they are not balanced.
            imbalance[1..].fill(0.0);
        }
        self.watch_limits(info.t0);
        self.steps += 1;
        if is_break && info.t1 == limit {
            self.stepper.restart();
        }
        observer.step(&StepRecord { t: info.t1, imbalance }, &self.progress())
    }

    /// One step of the scheme; with a bath one of its steps or trajectories.
    fn advance(&mut self, limit: f64, is_break: bool) -> Result<StepInfo, SimulateError> {
        let Simulation { dynamics, t_end, .. } = &mut *self.simulation;
        let dynamics = match &mut self.phase {
            Some(phase) => &mut phase.dynamics,
            None => dynamics,
        };
        let stepped = match &mut self.bath {
            None => self.stepper.step(dynamics, limit, is_break),
            Some(bath) => {
                let t0 = self.stepper.t();
                let act = |m: &mut phipsi_motion::Midpoint, h: f64| {
                    let most = ((*t_end - t0) / h).round().max(1.0) as u64;
                    bath.advance(m, dynamics, h, most)
                };
                self.stepper.with_midpoint(act).and_then(|_| {
                    let projected = self.stepper.residual()?;
                    Ok(StepInfo { t0, t1: self.stepper.t(), projected, event: false, stop: false })
                })
            }
        };
        stepped.map_err(|e| SimulateError::stopped(&e, dynamics.model()))
    }

    fn progress(&self) -> Progress<'_> {
        Progress {
            t: self.stepper.t(),
            t_end: self.end(),
            limits: &self.limits,
            stepper: &self.stepper,
            bath: self.bath.as_ref(),
            conserved: &self.conserved,
            closures: self.closures,
            events: &self.events,
            ended: self.ended,
            changes: &self.changes,
            phase: self.phase.as_ref().map(|phase| &phase.state),
            rows: self.rows,
            steps: self.steps,
            wall_s: self.wall_s(),
        }
    }
    /// Where the run ends: earlier than it should if an event has ended it.
    fn end(&self) -> f64 {
        if self.ended { self.stepper.t() } else { self.simulation.t_end }
    }

    fn summary(
        mut self,
        error_estimate: Option<ErrorEstimate>,
        finished: bool,
    ) -> Result<Summary, SimulateError> {
        let [steps, rejected, evaluations] = self.stepper.counts();
        // Forces of new clusters are evaluated once more.
        let evaluations = evaluations + self.changes.len() as u64;
        let t = self.stepper.t();
        let (q, v) = (self.stepper.q().to_vec(), self.stepper.v().to_vec());
        let (aux, heat) = (self.stepper.aux().to_vec(), self.heat());
        let row = self.measure(t, q, v, &aux, heat)?;
        let (q, v) = (row.q, row.v);
        let names = self.simulation.outputs.iter().map(|o| o.name.clone());
        let outputs: Vec<(String, f64)> = names.zip(row.outputs).collect();
        let value = |name: &str| outputs.iter().find(|(n, _)| n == name).map(|(_, x)| *x);
        let at_end = self.rows >= self.simulation.samples();
        let dynamics = &self.simulation.dynamics;
        let events = self.events.iter().map(|o| EventRecord::new(o, dynamics)).collect();
        Ok(Summary {
            t,
            q,
            v,
            steps,
            rejected,
            evaluations,
            wall_s: self.wall_s(),
            error_estimate,
            estimated_beside: self.estimated_beside,
            energy_error: self.conserved.energy_error(),
            closures: self.closures,
            momentum_error: (self.simulation.dynamics.plan().momentum && self.bath.is_none())
                .then(|| self.conserved.momentum_error()),
            trials: self.bath.as_ref().map(|b| *b.trials()),
            reference_error: if at_end { reference_error(&self.simulation.known, value) } else { None },
            outputs,
            limits: self.limits,
            events,
            changes: self.changes,
            ended_by_event: self.ended,
            finished,
        })
    }
}

/// The method at a start, of the scene's model or of other clusters, with its bath.
fn stepper(
    simulation: &mut Simulation,
    phase: Option<&mut Phase>,
    start: &State,
) -> Result<(Stepper, Option<Bath>), SimulateError> {
    let Simulation { dynamics, molecule, choice, tolerances, .. } = simulation;
    let dynamics = match phase {
        Some(phase) => &mut phase.dynamics,
        None => dynamics,
    };
    let aux = vec![0.0; dynamics.auxiliary_len()];
    let mut stepper = Stepper::new(dynamics, choice.method, *tolerances, start, &aux)
        .map_err(|e| SimulateError::stopped(&e, dynamics.model()))?;
    let mut bath = None;
    if let Some(molecule) = molecule {
        let made = stepper.with_midpoint(|m, _| {
            m.substeps = molecule.inner_steps;
            Ok(molecule.bath(m))
        });
        let made = made.map_err(|e| SimulateError::stopped(&e, dynamics.model()))?;
        bath = made.transpose().map_err(|e| SimulateError::Start(e.to_string()))?.flatten();
    }
    Ok((stepper, bath))
}

impl SimulateError {
    /// A step that failed, in words with the model's names.
    pub(crate) fn stopped(e: &StepError, model: &Model) -> Self {
        SimulateError::Stopped { t: e.time(), message: e.describe(model) }
    }
}
