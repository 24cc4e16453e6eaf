//! Multiple time steps: bonded terms in short steps, pairs in long ones.
//!
//! `PHIPSI_STEPS=100000 cargo test --release -p phipsi-molecule --test all multiple_steps::noise -- --nocapture` makes the table of
//! the documentation.

use crate::common::{molecule, statistics};
use phipsi_molecule::deviates::Deviates;
use phipsi_molecule::{
    Bath, Clustering, Clusters, Ensemble, ForceField, MolecularForces, Potential, Rings, TorsionModel,
    draw_velocities,
};
use phipsi_motion::{Midpoint, MidpointState};
use phipsi_recursion::ArticulatedSweep;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_spatial::Vec3;
use std::sync::Arc;

type Forces = MolecularForces<ForceField>;

/// The same molecule with all forces together, and with the slow ones apart; velocities at 300 K.
fn both(name: &str, clustering: &Clustering) -> (Arc<TorsionModel>, [Forces; 2], Vec<f64>) {
    let m = molecule(name, "vacuum", "min");
    let clusters = Clusters::new(&m.atoms, &m.positions, clustering).unwrap();
    let torsion = Arc::new(TorsionModel::new(&m.atoms, &m.positions, clusters).unwrap());
    let [fast, slow] = m.field.clone().split();
    let split = MolecularForces::new(torsion.clone(), fast).with_slow(slow);
    let q = torsion.model().neutral::<f64>();
    let mut v = vec![0.0; torsion.model().nv()];
    let factors = ArticulatedSweep::new(torsion.layout(), &q).unwrap();
    let mut workspace = SolveWorkspace::new(torsion.layout());
    draw_velocities(torsion.layout(), &factors, 300.0, &mut Deviates::new(7), &mut workspace, &mut v);
    torsion.close_velocities(&q, &mut v).unwrap();
    (torsion.clone(), [MolecularForces::new(torsion, m.field), split], v)
}

fn proline() -> Clustering {
    Clustering { rings: Rings::Flexible, ..Clustering::default() }
}

fn begin(torsion: &TorsionModel, forces: &mut Forces, v: &[f64], substeps: usize) -> Midpoint {
    let q = torsion.model().neutral::<f64>();
    let mut method = Midpoint::new(torsion.model(), forces, 0.0, &q, v).unwrap();
    method.substeps = substeps;
    method
}

fn largest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Farthest an atom of one state is from where it is in another, nm.
fn apart(torsion: &TorsionModel, a: &MidpointState, b: &MidpointState) -> f64 {
    let (a, b) = (torsion.positions(&a.q).unwrap(), torsion.positions(&b.q).unwrap());
    a.iter().zip(&b).map(|(a, b)| (*a - *b).norm()).fold(0.0, f64::max)
}

#[test]
fn the_parts_are_the_force_field() {
    let m = molecule("aladi", "vacuum", "min");
    let sum = |fields: &mut [ForceField]| {
        let (mut energy, mut forces) = (0.0, vec![Vec3::zero(); m.positions.len()]);
        for field in fields {
            let mut energies = vec![0.0; field.terms().len()];
            let mut own = forces.clone();
            field.evaluate(&m.positions, &mut energies, &mut own).unwrap();
            energy += energies.iter().sum::<f64>();
            forces.iter_mut().zip(&own).for_each(|(f, own)| *f += *own);
        }
        (energy, forces)
    };
    let mut whole = [m.field.clone()];
    let (energy, forces) = sum(&mut whole);
    let mut parts = m.field.clone().split();
    assert!(parts.iter().all(|part| !part.terms().is_empty()));
    let (of_parts, split) = sum(&mut parts);
    // Sums of some hundred entries in another order, of terms up to a thousand kJ/mol and kJ/mol/nm.
    assert!((energy - of_parts).abs() < 1e-10, "{energy} {of_parts}");
    for (a, b) in forces.iter().zip(&split) {
        assert!((*a - *b).norm() < 1e-9);
    }
}

/// With one substep the kicks are those of the whole force; with several both ends are of second order in the long step.
#[test]
fn one_substep_is_the_plain_step_and_the_order_is_two() {
    for (name, clustering) in [("aladi", Clustering::default()), ("ace_pro_nme", proline())] {
        let (torsion, [mut whole, mut split], v) = both(name, &clustering);
        let (mut plain, mut one) = (begin(&torsion, &mut whole, &v, 1), begin(&torsion, &mut split, &v, 1));
        assert!((plain.state().potential - one.state().potential).abs() < 1e-10);
        for _ in 0..20 {
            plain.step(&mut whole, 1e-3).unwrap();
            one.step(&mut split, 1e-3).unwrap();
        }
        assert_eq!(one.state().steps, 20);
        // Kicks whose terms cancel, and twenty drifts solved to rounding.
        assert!(apart(&torsion, plain.state(), one.state()) < 1e-11);
        let end = |split: &mut Forces, n: usize, substeps: usize| {
            let mut method = begin(&torsion, split, &v, substeps);
            for _ in 0..n {
                method.step(split, 0.032 / n as f64).unwrap();
            }
            method.state().clone()
        };
        let exact = end(&mut split, 512, 1);
        let error = |split: &mut Forces, n: usize| apart(&torsion, &end(split, n, 3), &exact);
        let (coarse, fine) = (error(&mut split, 16), error(&mut split, 32));
        let order = (coarse / fine).log2();
        assert!((order - 2.0).abs() < 0.15, "{name}: {coarse:e} {fine:e}");
    }
}

#[test]
fn steps_lead_back_and_failed_ones_leave_the_state() {
    for (name, clustering) in [("aladi", Clustering::default()), ("ace_pro_nme", proline())] {
        let (torsion, [_, mut split], v) = both(name, &clustering);
        let mut method = begin(&torsion, &mut split, &v, 4);
        let start = method.state().clone();
        for _ in 0..50 {
            method.step(&mut split, 4e-3).unwrap();
        }
        assert!(apart(&torsion, method.state(), &start) > 1e-3);
        let reversed: Vec<f64> = method.state().p.iter().map(|p| -p).collect();
        method.set_momenta(&reversed).unwrap();
        for _ in 0..50 {
            method.step(&mut split, 4e-3).unwrap();
        }
        let off = apart(&torsion, method.state(), &start);
        // Two hundred drifts there and back, at rounding, which the molecule amplifies a thousand times in 0.2 ps.
        assert!(off < 1e-10, "{name}: {off:e}");
        // A step that is too long for its drift, or for the forces at its end.
        let before = method.state().clone();
        assert!(method.step(&mut split, 50.0).is_err());
        assert_eq!(method.state(), &before);
        method.step(&mut split, 1e-3).unwrap();
    }
}

/// A state that was kept without its slow forces finds them again; a bath steps with both.
#[test]
fn states_go_on_and_baths_take_both_parts() {
    let (torsion, [_, mut split], v) = both("aladi", &Clustering::default());
    let mut method = begin(&torsion, &mut split, &v, 2);
    method.step(&mut split, 2e-3).unwrap();
    let kept = method.state().clone();
    method.step(&mut split, 2e-3).unwrap();
    let end = method.state().clone();
    method.restore(kept.clone()).unwrap();
    method.step(&mut split, 2e-3).unwrap();
    assert_eq!(method.state(), &end);
    method.refresh(&mut split).unwrap();
    assert!((method.state().potential - end.potential).abs() < 1e-9);
    assert!(largest(&method.state().slow, &end.slow) < 1e-9);
    let short = MidpointState { slow: vec![0.0; 2], ..kept };
    assert!(method.restore(short).is_err());
    let kt = phipsi_molecule::BOLTZMANN * 300.0;
    let mut bath = Bath::new(&mut method, Ensemble::HybridMonteCarlo { steps: 5 }, kt, 3).unwrap();
    for _ in 0..100 {
        bath.advance(&mut method, &mut split, 4e-3, 5).unwrap();
    }
    let trials = bath.trials();
    assert!(trials.acceptance().unwrap() > 0.9, "{trials:?}");
    // ⟨e^(−ΔH/kT)⟩ = 1; the errors of energy are a tenth of kT.
    assert!((trials.mean_weight().unwrap() - 1.0).abs() < 0.05, "{trials:?}");
}

/// The energy noise of long and short steps; longer inner steps than the outer bring nothing, shorter ones less and less.
#[test]
fn noise_of_long_and_short_steps() {
    let time = std::env::var("PHIPSI_STEPS").map_or(1.0, |s| s.parse::<f64>().unwrap() * 1e-3);
    for name in ["aladi", "met_enkephalin"] {
        let (torsion, [_, mut split], v) = both(name, &Clustering::default());
        let mut noises = Vec::new();
        for (outer, substeps) in
            [(2, 1), (2, 2), (4, 1), (4, 2), (4, 4), (8, 1), (8, 2), (8, 4), (12, 1), (12, 3)]
        {
            let h = f64::from(outer) * 1e-3;
            let mut method = begin(&torsion, &mut split, &v, substeps);
            // Away from the minimum first.
            for _ in 0..250 {
                method.step(&mut split, 2e-3).unwrap();
            }
            let n = (time / h) as usize;
            let clock = std::time::Instant::now();
            let energies: Vec<f64> = (0..n)
                .map(|_| {
                    method.step(&mut split, h).unwrap();
                    method.kinetic_energy().unwrap() + method.state().potential
                })
                .collect();
            let us = clock.elapsed().as_secs_f64() * 1e6 / n as f64;
            let (noise, _) = statistics::about_a_line(&energies);
            println!("{name}: {outer} fs, {substeps} substeps: noise {noise:.2e} kJ/mol, {us:.1} µs a step");
            noises.push(noise);
        }
        // Second order: 4 fs has four times the noise of 2 fs, and four substeps no more than the plain step; runs of a picosecond see
        // different neighbourhoods, whose noise differs by two.
        assert!(noises[2] < 8.0 * noises[0] && noises[4] < 2.0 * noises[2], "{noises:?}");
    }
}
