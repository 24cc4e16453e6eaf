//! The part of a run between two changes of clusters: a model of its own, whose states are recorded in the coordinates of the scene's.

use crate::error::SimulateError;
use crate::molecule::Molecule;
use crate::recluster::Schedule;
use phipsi_model::State;
use phipsi_molecule::{MoleculeErrors, TorsionModel, same_motion};
use phipsi_motion::Dynamics;
use phipsi_recursion::Kinematics;
use phipsi_spatial::Vec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What makes the part of a run again, bit for bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhaseState {
    /// Positions at its start, whose bond lengths and angles the clusters keep, nm.
    pub positions: Vec<[f64; 3]>,
    /// The last recorded configuration, from which the turns of angles are counted.
    pub near: Vec<f64>,
    /// Energy that changes of clusters have given so far, with what they changed in the energy of a bath, kJ/mol.
    pub given: f64,
}

/// Clusters, forces and state of a part of a run.
pub(super) struct Phase {
    pub(super) torsion: Arc<TorsionModel>,
    pub(super) dynamics: Dynamics,
    pub(super) kinematics: Kinematics<f64>,
    pub(super) state: PhaseState,
}

impl Phase {
    /// After `changes` changes of a schedule.
    pub(super) fn new(
        molecule: &Molecule,
        schedule: &Schedule,
        changes: usize,
        state: PhaseState,
    ) -> Result<Self, SimulateError> {
        let widest = &molecule.torsion;
        let (atoms, nq) = (widest.atoms().len(), widest.model().nq());
        if state.positions.len() != atoms || state.near.len() != nq {
            return Err(SimulateError::Start("the checkpoint is of another scene".into()));
        }
        let positions: Vec<Vec3<f64>> = state.positions.iter().map(|x| Vec3(*x)).collect();
        let torsion = Arc::new(schedule.model(changes, widest, &positions).map_err(refused)?);
        let neutral = torsion.model().neutral();
        let own = molecule.forces_on(&torsion, schedule.field.clone(), &neutral).map_err(refused)?;
        let mut dynamics = Dynamics::new(torsion.model(), own.forces)?;
        dynamics.leave_out_integrals();
        let kinematics = Kinematics::new(dynamics.layout());
        Ok(Phase { torsion, dynamics, kinematics, state })
    }
    /// A state at its start: at the given time, with velocities.
    pub(super) fn start(&self, t: f64, v: Vec<f64>) -> State {
        State { q: self.torsion.model().neutral(), v, t }
    }
    /// A state in the coordinates of the scene's model.
    pub(super) fn recorded(
        &self,
        molecule: &Molecule,
        q: &[f64],
        v: &[f64],
    ) -> Result<(Vec<f64>, Vec<f64>), SimulateError> {
        same_motion(&self.torsion, q, v, &molecule.torsion, &self.state.near).map_err(refused)
    }
}

pub(super) fn refused(e: MoleculeErrors) -> SimulateError {
    SimulateError::Start(format!("other clusters cannot be made: {e}"))
}
