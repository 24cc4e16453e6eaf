//! `trajectory.dcd`: positions of a molecule's atoms at the recorded instants.

use crate::error::SimulateError;
use crate::molecule::Molecule;
use crate::record::Row;
use crate::simulation::Simulation;
use phipsi_formats::dcd::{DcdTiming, DcdWriter};
use phipsi_formats::trajectory::TrajectoryError;
use std::path::Path;

/// A trajectory being written.
pub struct AtomWriter {
    writer: DcdWriter,
    molecule: Molecule,
    /// Instants seen; frames that an earlier attempt wrote behind the checkpoint are kept, they are the same.
    seen: usize,
}

impl AtomWriter {
    /// Begins, or goes on behind the rows of a checkpoint; `None` for a scene without a molecule.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn open(path: &Path, simulation: &Simulation, before: &[Row]) -> Result<Option<Self>, SimulateError> {
        let Some(molecule) = simulation.molecule.clone() else { return Ok(None) };
        let atoms = molecule.torsion.atoms().len();
        if !before.is_empty()
            && let Ok(writer) = DcdWriter::append(path, atoms)
            && writer.frames() >= before.len()
        {
            return Ok(Some(AtomWriter { writer, molecule, seen: before.len() }));
        }
        let step = simulation.choice.method.fixed_step().unwrap_or(simulation.every);
        let interval = (simulation.every / step).round().clamp(1.0, f64::from(i32::MAX)) as i32;
        let timing = DcdTiming { first_step: 0, interval, dt_ps: step };
        let writer = DcdWriter::create(path, atoms, timing).map_err(failed)?;
        let mut trajectory = AtomWriter { writer, molecule, seen: 0 };
        before.iter().try_for_each(|row| trajectory.row(row))?;
        Ok(Some(trajectory))
    }
    /// Adds an instant.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn row(&mut self, row: &Row) -> Result<(), SimulateError> {
        self.seen += 1;
        if self.seen <= self.writer.frames() {
            return Ok(());
        }
        let positions = self.molecule.positions(&row.q)?;
        self.writer.write(&positions).map_err(failed)
    }
}

fn failed(e: TrajectoryError) -> SimulateError {
    let source = std::io::Error::other(format!("{}; required: {}; {}", e.found, e.required, e.remedy));
    SimulateError::File { path: e.path, source }
}
