//! Minimisation in torsions, and the announcement of strained starts.

use crate::common::molecule;
use phipsi_molecule::{
    Clustering, Clusters, ForceField, MinimizeOptions, MolecularForces, Potential, PotentialError,
    TorsionModel, minimize, strain,
};
use phipsi_motion::Conservative;
use phipsi_spatial::Vec3;
use std::sync::Arc;

fn forces(name: &str, environment: &str, id: &str) -> MolecularForces<ForceField> {
    let m = molecule(name, environment, id);
    let clusters = Clusters::new(&m.atoms, &m.positions, &Clustering::default()).unwrap();
    let torsion = TorsionModel::new(&m.atoms, &m.positions, clusters).unwrap();
    MolecularForces::new(Arc::new(torsion), m.field)
}

/// Ends where the largest generalised force is as small as was asked, at lower energy, also from overlapping atoms.
#[test]
fn minima_are_reached_from_every_conformation() {
    for (name, environment) in
        [("aladi", "vacuum"), ("aladi", "obc2"), ("met_enkephalin", "vacuum"), ("aladi_x2", "vacuum")]
    {
        for id in ["min", "torsion1", "torsion2", "md", "strained"] {
            let mut forces = forces(name, environment, id);
            let torsion = forces.torsion().clone();
            let q = torsion.model().neutral::<f64>();
            let mut tau = vec![0.0; torsion.model().nv()];
            let before = forces.evaluate(&q, &mut tau).unwrap();
            let options = MinimizeOptions { largest_force: 1e-4, ..MinimizeOptions::default() };
            let (minimum, _) = minimize(&mut forces, &q, &options).unwrap();
            println!(
                "{name}, {environment}, {id}: {before:.3} → {:.6} kJ/mol, force {:.1e}, {} evaluations",
                minimum.energy, minimum.largest_force, minimum.evaluations
            );
            assert!(minimum.converged, "{name}, {environment}, {id}: {minimum:?}");
            let energy = forces.evaluate(&minimum.q, &mut tau).unwrap();
            assert_eq!(energy, minimum.energy);
            assert!(energy <= before, "{name}, {id}");
            assert!(tau.iter().all(|f| f.abs() <= 1e-4), "{name}, {id}: {tau:?}");
            // A minimum and no saddle: every torsion pushed by 0.01 rad either way costs energy.
            for h in 0..torsion.clusters().hinges.len() {
                for sign in [1.0, -1.0] {
                    let mut x = vec![0.0; torsion.model().nv()];
                    x[torsion.hinge_dof(h)] = 0.01 * sign;
                    let moved = torsion.model().integrate(&minimum.q, &x);
                    assert!(forces.evaluate(&moved, &mut tau).unwrap() > energy, "{name}, {id}, hinge {h}");
                }
            }
        }
    }
}

#[test]
fn a_budget_of_evaluations_is_kept() {
    let mut forces = forces("aladi", "vacuum", "torsion1");
    let q = forces.torsion().model().neutral::<f64>();
    let options = MinimizeOptions { evaluations: 5, ..MinimizeOptions::default() };
    let (minimum, _) = minimize(&mut forces, &q, &options).unwrap();
    assert!(!minimum.converged && minimum.evaluations <= 5, "{minimum:?}");
    assert!(!minimum.joint.is_empty());
}

/// Two atoms of different clusters brought together are named, and a relaxed start says nothing.
#[test]
fn strained_starts_are_announced() {
    let mut calm = forces("aladi", "vacuum", "md");
    let q = calm.torsion().model().neutral::<f64>();
    assert_eq!(strain(&mut calm, &q).unwrap(), None);
    let m = molecule("aladi_x2", "vacuum", "md");
    let mut positions = m.positions;
    // The oxygen of the second alanine, its whole molecule with it, onto that of the first.
    let (first, second) = (11, 33);
    let shift = positions[first] - positions[second] + Vec3([0.0, 0.0, 0.11]);
    (22..44).for_each(|i| positions[i] += shift);
    let clusters = Clusters::new(&m.atoms, &positions, &Clustering::default()).unwrap();
    let torsion = TorsionModel::new(&m.atoms, &positions, clusters).unwrap();
    let q = torsion.model().neutral::<f64>();
    let mut forces = MolecularForces::new(Arc::new(torsion), m.field);
    let found = strain(&mut forces, &q).unwrap().expect("two oxygens at 0.11 nm");
    let text = found.to_string();
    println!("{text}");
    assert!(found.force > 1e5 && found.nearest.is_some(), "{text}");
    let (minimum, announced) = minimize(&mut forces, &q, &MinimizeOptions::default()).unwrap();
    assert_eq!(announced, Some(found));
    assert!(minimum.converged, "{minimum:?}");
    assert_eq!(strain(&mut forces, &minimum.q).unwrap(), None);
}

/// A potential that has no value everywhere.
struct Wall {
    terms: Vec<String>,
}

impl Potential for Wall {
    fn terms(&self) -> &[String] {
        &self.terms
    }
    fn evaluate(
        &mut self,
        positions: &[Vec3<f64>],
        energies: &mut [f64],
        forces: &mut [Vec3<f64>],
    ) -> Result<(), PotentialError> {
        // −z² of the first atom and a wall at z = 1 nm: downhill as far as the wall lets it.
        let z = positions[0].0[2];
        if z.abs() > 1.0 {
            return Err(PotentialError { term: "wall".into(), atoms: vec![0], message: "outside".into() });
        }
        energies[0] = -z * z;
        forces.iter_mut().for_each(|f| *f = Vec3::zero());
        forces[0].0[2] = 2.0 * z;
        Ok(())
    }
}

/// Steps into a region without a value are shortened; a start there is an error.
#[test]
fn steps_without_a_value_are_shortened() {
    let m = molecule("butane", "charmm36", "md");
    let clusters = Clusters::new(&m.atoms, &m.positions, &Clustering::default()).unwrap();
    let torsion = Arc::new(TorsionModel::new(&m.atoms, &m.positions, clusters).unwrap());
    let wall = || MolecularForces::new(torsion.clone(), Wall { terms: vec!["wall".into()] });
    let q = torsion.model().neutral::<f64>();
    let options = MinimizeOptions { evaluations: 300, ..MinimizeOptions::default() };
    let (minimum, _) = minimize(&mut wall(), &q, &options).unwrap();
    assert!(minimum.energy.is_finite() && !minimum.converged, "{minimum:?}");
    let mut far = q;
    far[2] += 5.0;
    let error = minimize(&mut wall(), &far, &options).unwrap_err().to_string();
    assert!(error.contains("wall"), "{error}");
}
