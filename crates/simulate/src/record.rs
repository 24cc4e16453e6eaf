//! What a run records, and what listens to it.

use crate::error::SimulateError;
use crate::run::Progress;
use phipsi_model::State;
use serde::{Deserialize, Serialize};

/// A recorded instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Time.
    pub t: f64,
    /// Position coordinates.
    pub q: Vec<f64>,
    /// Velocities.
    pub v: Vec<f64>,
    /// Kinetic energy, potential energy, work of non-conservative forces, J.
    pub energy: [f64; 3],
    /// Angular momentum about the centre of mass, linear momentum, world axes; zeros where the base is not free.
    pub momentum: [f64; 6],
    /// The scene's outputs.
    pub outputs: Vec<f64>,
    /// Parts of the potential energy: the terms of a force field.
    pub terms: Vec<f64>,
}

impl Row {
    /// Its state.
    pub fn state(&self) -> State {
        State { q: self.q.clone(), v: self.v.clone(), t: self.t }
    }
}

/// An accepted step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepRecord {
    /// End of the step.
    pub t: f64,
    /// Imbalance of energy, J, of angular and of linear momentum, absolute, at the end of the step.
    pub imbalance: [f64; 3],
}

/// A joint limit that the motion passed: limits do not act on the dynamics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LimitPassed {
    /// The joint.
    pub joint: String,
    /// Its position at the end of the step that passed the limit.
    pub position: f64,
    /// The limit.
    pub limit: f64,
    /// Start and end of that step.
    pub between: [f64; 2],
}

impl LimitPassed {
    /// For people.
    pub fn describe(&self) -> String {
        let LimitPassed { joint, position, limit, between: [t0, t1] } = self;
        format!(
            "joint `{joint}` passed its limit {limit} between t = {t0} and t = {t1} (then at {position}); \
             limits act on the motion where a scene has [joint_stops] only"
        )
    }
}

/// What one's own loop, a run folder or a progress bar does with a run.
pub trait Observer {
    /// A recorded instant, in the order of time.
    ///
    /// # Errors
    /// Anything stops the run.
    fn row(&mut self, row: &Row) -> Result<(), SimulateError>;
    /// An accepted step; `progress` has what a checkpoint needs.
    ///
    /// # Errors
    /// Anything stops the run.
    fn step(&mut self, _step: &StepRecord, _progress: &Progress<'_>) -> Result<(), SimulateError> {
        Ok(())
    }
    /// The run stops before its end, at its last good state: the user asked, or a step failed.
    ///
    /// # Errors
    /// Told unless the run stops at an error of its own.
    fn stopped(&mut self, _progress: &Progress<'_>) -> Result<(), SimulateError> {
        Ok(())
    }
    /// True stops the run after the present step.
    fn stop(&self) -> bool {
        false
    }
    /// The run goes over to its error estimate.
    fn estimating(&mut self) {}
    /// All steps so far, those before a resumed checkpoint included: ends of steps.
    ///
    /// # Errors
    /// If they cannot be read back.
    fn step_ends(&mut self) -> Result<Vec<f64>, SimulateError>;
    /// At most `most` recorded rows, evenly spread, the last one included.
    ///
    /// # Errors
    /// If they cannot be read back.
    fn spread_rows(&mut self, most: usize) -> Result<Vec<State>, SimulateError>;
}

/// Rows and steps kept in memory.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// Recorded instants.
    pub rows: Vec<Row>,
    /// Accepted steps.
    pub steps: Vec<StepRecord>,
}

impl Observer for Recording {
    fn row(&mut self, row: &Row) -> Result<(), SimulateError> {
        self.rows.push(row.clone());
        Ok(())
    }
    fn step(&mut self, step: &StepRecord, _: &Progress<'_>) -> Result<(), SimulateError> {
        self.steps.push(*step);
        Ok(())
    }
    fn step_ends(&mut self) -> Result<Vec<f64>, SimulateError> {
        Ok(self.steps.iter().map(|s| s.t).collect())
    }
    fn spread_rows(&mut self, most: usize) -> Result<Vec<State>, SimulateError> {
        let rows = spread(self.rows.len(), most);
        Ok(rows.map(|i| self.rows[i].state()).collect())
    }
}

/// At most `most` of n positions, evenly spread, the last one included.
pub fn spread(n: usize, most: usize) -> impl Iterator<Item = usize> {
    let taken = n.min(most.max(1));
    (1..=taken).map(move |k| (k * n) / taken - 1)
}
