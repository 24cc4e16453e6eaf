//! What a run leaves: its state between two steps, and what it came to.

use super::phase::PhaseState;
use crate::event_record::EventRecord;
use crate::recluster::ChangeRecord;
use crate::record::LimitPassed;
use phipsi_molecule::{Bath, BathState, Trials};
use phipsi_motion::{Conserved, ErrorEstimate, Occurrence, Projected, Stepper, StepperState};
use serde::{Deserialize, Serialize};

/// How well closures were kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ClosureRecord {
    /// Largest residual of positions at the ends of steps, m or rad.
    pub position: f64,
    /// Largest residual of velocities, m/s or rad/s.
    pub velocity: f64,
    /// Kinetic energy of all that projections took from the velocities, J.
    pub energy_removed: f64,
}

impl ClosureRecord {
    pub(super) fn of(p: &Projected) -> Self {
        let Projected { position, velocity, energy_removed } = *p;
        ClosureRecord { position, velocity, energy_removed }
    }
    /// Takes a further projection into account.
    pub(super) fn record(&mut self, p: &Projected) {
        let larger = |a: f64, b: f64| if b.is_nan() { b } else { a.max(b) };
        self.position = larger(self.position, p.position);
        self.velocity = larger(self.velocity, p.velocity);
        self.energy_removed += p.energy_removed;
    }
}

/// Everything that continues a run bit for bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunState {
    /// State of the integration scheme.
    pub stepper: StepperState,
    /// State of the heat bath, where there is one.
    #[serde(default)]
    pub bath: Option<BathState>,
    /// Balances so far.
    pub conserved: Conserved,
    /// Closures so far.
    #[serde(default)]
    pub closures: Option<ClosureRecord>,
    /// Rows recorded so far.
    pub rows: u64,
    /// Steps recorded so far.
    pub steps: u64,
    /// Limits passed so far.
    pub limits: Vec<LimitPassed>,
    /// What happened so far.
    #[serde(default)]
    pub events: Vec<Occurrence>,
    /// True if an event has ended the run.
    #[serde(default)]
    pub ended: bool,
    /// Changes of a molecule's clusters so far.
    #[serde(default)]
    pub changes: Vec<ChangeRecord>,
    /// The clusters of now, where they are not those of the scene's model.
    #[serde(default)]
    pub phase: Option<PhaseState>,
    /// Wall time spent so far, s.
    pub wall_s: f64,
}

/// A look at a run between two steps.
pub struct Progress<'a> {
    /// Time.
    pub t: f64,
    /// End of the run.
    pub t_end: f64,
    /// Limits passed so far.
    pub limits: &'a [LimitPassed],
    pub(super) stepper: &'a Stepper,
    pub(super) bath: Option<&'a Bath>,
    pub(super) conserved: &'a Conserved,
    pub(super) closures: Option<ClosureRecord>,
    pub(super) events: &'a [Occurrence],
    pub(super) ended: bool,
    pub(super) changes: &'a [ChangeRecord],
    pub(super) phase: Option<&'a PhaseState>,
    pub(super) rows: u64,
    pub(super) steps: u64,
    pub(super) wall_s: f64,
}

impl Progress<'_> {
    /// A copy of everything that continues the run.
    pub fn state(&self) -> RunState {
        RunState {
            stepper: self.stepper.checkpoint(),
            bath: self.bath.map(Bath::state),
            conserved: self.conserved.clone(),
            closures: self.closures,
            rows: self.rows,
            steps: self.steps,
            limits: self.limits.to_vec(),
            events: self.events.to_vec(),
            ended: self.ended,
            changes: self.changes.to_vec(),
            phase: self.phase.cloned(),
            wall_s: self.wall_s,
        }
    }
}

/// What a run came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Time, configuration and velocity at the end.
    pub t: f64,
    /// Configuration.
    pub q: Vec<f64>,
    /// Velocity.
    pub v: Vec<f64>,
    /// The scene's outputs at the end, by name.
    pub outputs: Vec<(String, f64)>,
    /// Accepted steps.
    pub steps: u64,
    /// Rejected steps.
    pub rejected: u64,
    /// Evaluations of the equations of motion by the run itself.
    pub evaluations: u64,
    /// Wall time, s, the error estimate included.
    pub wall_s: f64,
    /// The estimated error at the end; `None` if it was left out or stopped.
    pub error_estimate: Option<ErrorEstimate>,
    /// True if it was made beside the run, on a second thread.
    pub estimated_beside: bool,
    /// Relative imbalance of energy.
    pub energy_error: f64,
    /// Trajectories of Monte Carlo and refused drifts, where there is a bath.
    pub trials: Option<Trials>,
    /// Relative imbalances of angular and linear momentum; `None` where the base is not free, and where a bath changes them.
    pub momentum_error: Option<[f64; 2]>,
    /// How well closures were kept; `None` without closures.
    pub closures: Option<ClosureRecord>,
    /// Largest relative error of outputs with known values.
    pub reference_error: Option<f64>,
    /// Limits that were passed.
    pub limits: Vec<LimitPassed>,
    /// Events, impacts, stick and slip, in the order of time.
    pub events: Vec<EventRecord>,
    /// Changes of a molecule's clusters.
    pub changes: Vec<ChangeRecord>,
    /// True if an event ended the run.
    pub ended_by_event: bool,
    /// False if an observer stopped the run.
    pub finished: bool,
}
