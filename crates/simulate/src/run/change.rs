//! Freeze and thaw in the run loop: other clusters go on from the state of the run, and the balances with them.

use super::phase::{Phase, PhaseState, refused};
use super::{RunState, Runner};
use crate::error::SimulateError;
use crate::molecule::Molecule;
use crate::recluster::{ChangeRecord, Schedule, fixman};
use crate::simulation::Simulation;
use phipsi_model::State;
use phipsi_molecule::{Bath, Ledger, TorsionModel};
use phipsi_motion::{Scheme, Stepper, System};
use std::sync::Arc;

/// The clusters that a run begins or goes on with, and a start on them, where they are not those of the scene's model.
pub(super) fn first_phase(
    simulation: &Simulation,
    state: Option<&RunState>,
) -> Result<Option<(Phase, State)>, SimulateError> {
    let Some((molecule, schedule)) = scheduled(simulation) else { return Ok(None) };
    if let Scheme::Explicit(_) = simulation.choice.method {
        let message = "clusters that change during a run need the midpoint method: set its step";
        return Err(SimulateError::Start(message.into()));
    }
    let start = &simulation.start;
    if let Some(state) = state {
        let Some(phase) = state.phase.clone() else { return Ok(None) };
        let phase = Phase::new(molecule, schedule, state.changes.len(), phase)?;
        let v = vec![0.0; phase.torsion.model().nv()];
        let start = phase.start(start.t, v);
        return Ok(Some((phase, start)));
    }
    if !schedule.starts_narrower() {
        return Ok(None);
    }
    // Velocities of the widest model, projected: with a temperature, those of the narrower one.
    let from = (&*molecule.torsion, &start.q[..], &start.v[..]);
    let begun = schedule.apply(0, from, molecule.seed).map_err(refused)?;
    let state = PhaseState { positions: begun.positions, near: start.q.clone(), given: 0.0 };
    let phase = Phase::new(molecule, schedule, 0, state)?;
    let start = phase.start(start.t, begun.v);
    Ok(Some((phase, start)))
}

fn scheduled(simulation: &Simulation) -> Option<(&Molecule, &Arc<Schedule>)> {
    let molecule = simulation.molecule.as_ref()?;
    let schedule = molecule.schedule.as_ref().filter(|s| !s.changes.is_empty())?;
    Some((molecule, schedule))
}

impl Runner<'_> {
    /// Makes the next change of clusters if its time has come.
    pub(super) fn change_if_due(&mut self) -> Result<(), SimulateError> {
        let Some((_, schedule)) = scheduled(self.simulation) else { return Ok(()) };
        let schedule = schedule.clone();
        let (t, n) = (self.stepper.t(), self.changes.len());
        let slack = self.simulation.choice.method.fixed_step().map_or(0.0, |step| 1e-6 * step);
        let Some(change) = schedule.changes.get(n).filter(|change| t >= change.time - slack) else {
            return Ok(());
        };
        let stopped = |e: SimulateError| SimulateError::Stopped {
            t,
            message: format!("at t = {t} ps clusters cannot be changed: {e}"),
        };
        let after = self.changed(&schedule, n).map_err(stopped)?;
        self.changes.push(ChangeRecord::new(t, change, after.ledger, after.fixman));
        (self.phase, self.stepper, self.bath) = (Some(after.phase), after.stepper, after.bath);
        Ok(())
    }

    /// Clusters, method and bath after the n-th change, and what it did: kinetic energies, change of Fixman's potential.
    fn changed(&mut self, schedule: &Schedule, n: usize) -> Result<After, SimulateError> {
        let Some(molecule) = self.simulation.molecule.clone() else {
            return Err(SimulateError::Start("a change of clusters without a molecule".into()));
        };
        let (q, v) = (self.stepper.q().to_vec(), self.stepper.v().to_vec());
        let (old, near, given): (Arc<TorsionModel>, _, _) = match &self.phase {
            Some(phase) => (phase.torsion.clone(), phase.state.near.clone(), phase.state.given),
            None => (molecule.torsion.clone(), q.clone(), 0.0),
        };
        let changed = schedule.apply(n + 1, (&old, &q, &v), molecule.seed).map_err(refused)?;
        let state = PhaseState { positions: changed.positions, near, given };
        let mut phase = Phase::new(&molecule, schedule, n + 1, state)?;
        let start = phase.start(self.simulation.start.t, changed.v);
        let kt = molecule.fixman_kt();
        let fixman = fixman(&phase.torsion, &start.q, kt)? - fixman(&old, &q, kt)?;
        let (mut stepper, _) = super::stepper(self.simulation, Some(&mut phase), &start)?;
        let t = self.stepper.t();
        let counts = self.stepper.with_midpoint(|m, _| Ok((m.state().steps, m.state().iterations)));
        let before = self.bath.as_ref();
        let made = counts.and_then(|counts| {
            stepper.with_midpoint(|m, _| {
                let (steps, iterations) = counts.unwrap_or_default();
                m.count(t, steps, iterations);
                Ok(before.map(|bath| bath.of_another(m)))
            })
        });
        let made = made.map_err(|e| SimulateError::stopped(&e, phase.dynamics.model()))?;
        let bath = made.flatten().transpose().map_err(|e| SimulateError::Start(e.to_string()))?;
        let heat = |bath: Option<&Bath>| bath.map_or(0.0, Bath::heat);
        let Ledger { drawn, removed, .. } = changed.ledger;
        phase.state.given += drawn - removed + fixman - (heat(bath.as_ref()) - heat(before));
        Ok(After { phase, stepper, bath, ledger: changed.ledger, fixman })
    }
}

/// What goes on after a change.
struct After {
    phase: Phase,
    stepper: Stepper,
    bath: Option<Bath>,
    ledger: Ledger,
    fixman: f64,
}
