//! A molecule of rigid clusters with and without what is constant within them.

use super::{Failure, ROUNDS, median};
use phipsi::formats::system::SystemOptions;
use phipsi::molecule::{Clustering, Clusters, ForceField, MolecularForces, TorsionModel, read_molecule};
use phipsi::motion::Midpoint;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Steps of a round, and their size, ps.
const STEPS: usize = 400;
const STEP: f64 = 0.002;

/// Seconds a step of the midpoint method, from rest.
fn time(torsion: &TorsionModel, forces: &mut MolecularForces<ForceField>) -> Result<f64, Failure> {
    let model = torsion.model();
    let (q, v) = (model.neutral::<f64>(), vec![0.0; model.nv()]);
    let mut method = Midpoint::new(model, forces, 0.0, &q, &v)?;
    let start = Instant::now();
    for _ in 0..STEPS {
        method.step(forces, STEP)?;
    }
    Ok(start.elapsed().as_secs_f64() / STEPS as f64)
}

/// What is left out, and seconds a step with the plan and without.
pub fn row() -> Result<(String, [f64; 2]), Failure> {
    let file = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(name);
    let options = SystemOptions::default();
    let read = read_molecule(file("ala_dipeptide.pdb"), file("ala_dipeptide.xml"), &options);
    let (molecule, _) =
        read.into_result(false).map_err(|reports| format!("{}\n{}", reports[0], reports[1]))?;
    let clusters = Clusters::new(&molecule.atoms, &molecule.positions, &Clustering::default())?;
    let torsion = Arc::new(TorsionModel::new(&molecule.atoms, &molecule.positions, clusters)?);
    let forces =
        || Ok::<_, Failure>(MolecularForces::new(torsion.clone(), ForceField::new(&molecule.system)?));
    let (mut planned, mut general) = (forces()?, forces()?);
    let left_out = planned.leave_out_constants(&torsion.model().neutral())?;
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..ROUNDS {
        times[0].push(time(&torsion, &mut planned)?);
        times[1].push(time(&torsion, &mut general)?);
    }
    let lines =
        left_out.iter().map(|l| format!("{} of {} entries of {}", l.entries[0], l.entries[1], l.term));
    Ok((lines.collect::<Vec<_>>().join("; "), times.map(median)))
}
