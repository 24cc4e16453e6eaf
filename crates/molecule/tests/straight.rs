//! Three atoms whose open angle is free to be straight: there M is singular, drifts have several solutions or none that is found, and
//! Monte Carlo has to refuse what does not lead back.

use crate::common::chains::KT;
use crate::common::statistics::{check_mean, p_value};
use phipsi_formats::system::{Force, ForceKind, PeriodicTorsion, RbTorsion, System};
use phipsi_molecule::deviates::Deviates;
use phipsi_molecule::{
    Angles, Atoms, Bath, Clustering, Clusters, Ensemble, FixmanPotential, ForceField, Potential,
    TorsionModel, WithFixman, draw_momenta,
};
use phipsi_motion::Midpoint;
use phipsi_recursion::DynamicsError;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_spatial::Vec3;
use std::collections::BTreeMap;

const MASSES: [f64; 3] = [24.0, 4.0, 24.0];

/// Bonds of 0.15 nm, an open angle θ = θ₀ + q.
fn trimer() -> TorsionModel {
    let (a, theta) = (0.15, 1.9f64);
    let positions = vec![Vec3([a, 0.0, 0.0]), Vec3::zero(), Vec3([a * theta.cos(), a * theta.sin(), 0.0])];
    let atoms = Atoms {
        masses: MASSES.to_vec(),
        elements: vec![0; 3],
        bonds: vec![[0, 1], [1, 2]],
        names: Vec::new(),
    };
    let clustering = Clustering { angles: Angles::Listed(vec![[0, 1, 2]]), ..Clustering::default() };
    let clusters = Clusters::new(&atoms, &positions, &clustering).unwrap();
    TorsionModel::new(&atoms, &positions, clusters).unwrap()
}

fn free(_: &[f64], forces: &mut [f64]) -> Result<f64, DynamicsError> {
    forces.fill(0.0);
    Ok(0.0)
}

/// From states of the canonical distribution: a step that does not lead back takes more iterations than Monte Carlo trusts, and
/// `retraces` tells it as a step back does.
#[test]
fn steps_that_do_not_lead_back_take_many_iterations() {
    let torsion = trimer();
    let (coordinate, _, start) = torsion.open_angles().next().unwrap();
    let model = torsion.model();
    let mut workspace = SolveWorkspace::new(torsion.layout());
    let (mut deviates, mut p) = (Deviates::new(1), vec![0.0; model.nv()]);
    for h in [0.01, 0.04] {
        let mut table: BTreeMap<(bool, usize), usize> = BTreeMap::new();
        let samples = std::env::var("PHIPSI_SAMPLES").map_or(3000, |s| s.parse().expect("a whole number"));
        for _ in 0..samples {
            let mut q = model.neutral::<f64>();
            q[coordinate] = (2.0 * deviates.uniform() - 1.0).clamp(-1.0, 1.0).acos() - start;
            // A straight angle to rounding has no solution at all.
            let Ok(mut method) = Midpoint::new(model, &mut free, 0.0, &q, &vec![0.0; model.nv()]) else {
                continue;
            };
            let factors = method.factors().unwrap();
            draw_momenta(torsion.layout(), factors, 300.0, &mut deviates, &mut workspace, &mut p);
            method.set_momenta(&p).unwrap();
            let before = method.state().clone();
            let Ok(info) = method.step(&mut free, h) else { continue };
            let after = method.state().clone();
            let told = method.retraces(h, &before, 1e-9);
            assert_eq!(method.state(), &after);
            method.begin_anew().unwrap();
            let back = method.step(&mut free, -h).is_ok();
            let near = |a: &[f64], b: &[f64]| {
                let scale = 1.0 + b.iter().fold(0.0f64, |m, x| m.max(x.abs()));
                a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-9 * scale)
            };
            let returned = back && near(&method.state().q, &before.q) && near(&method.state().p, &before.p);
            assert_eq!(told, returned);
            *table.entry((returned, info.iterations)).or_default() += 1;
        }
        println!("{h} ps: {table:?}");
        assert!(table.keys().all(|&(returned, iterations)| returned || iterations > 10), "{table:?}");
        assert!(h < 0.02 || table.keys().any(|&(returned, _)| !returned));
    }
}

/// Without forces: √((1/m₁ + 1/m₂)(1/m₂ + 1/m₃) − cos²θ/m₂²) in cos θ without Fixman's potential, uniform with it.
#[test]
fn an_angle_that_may_be_straight_has_its_density() {
    let torsion = trimer();
    let (coordinate, _, start) = torsion.open_angles().next().unwrap();
    let model = torsion.model();
    let samples = std::env::var("PHIPSI_SAMPLES").map_or(5000, |s| s.parse().expect("a whole number"));
    let [first, last] = [0, 2].map(|i| 1.0 / MASSES[i] + 1.0 / MASSES[1]);
    let hard = |u: f64| (first * last - u * u / (MASSES[1] * MASSES[1])).sqrt();
    let uniform = |_: f64| 1.0;
    for (fixman, density) in [(false, &hard as &dyn Fn(f64) -> f64), (true, &uniform)] {
        let mut forces = free;
        let mut potential = FixmanPotential::of(&torsion, KT).unwrap();
        let mut system = WithFixman { inner: &mut forces, fixman: fixman.then_some(&mut potential) };
        let q = model.neutral::<f64>();
        let mut method = Midpoint::new(model, &mut system, 0.0, &q, &vec![0.0; model.nv()]).unwrap();
        let mut bath = Bath::new(&mut method, Ensemble::HybridMonteCarlo { steps: 8 }, KT, 11).unwrap();
        let mut cosines = Vec::new();
        for i in 0..2 * samples {
            bath.advance(&mut method, &mut system, 0.04, 8).unwrap();
            if i % 2 == 1 {
                cosines.push((start + method.state().q[coordinate]).cos());
            }
        }
        let p = p_value(&cosines, [-1.0, 1.0], 16, density);
        let trials = bath.trials();
        println!(
            "fixman {fixman}: p {p:.2e}, acceptance {:.3}, refused {} of {}",
            trials.acceptance().unwrap(),
            trials.refused,
            trials.made
        );
        // Means by the midpoint rule.
        let node = |i: usize| -1.0 + (i as f64 + 0.5) / 500.0;
        let sum = |f: &dyn Fn(f64) -> f64| (0..1000).map(|i| f(node(i))).sum::<f64>();
        let want = sum(&|u| u * u * density(u)) / sum(&|u| density(u));
        let squares: Vec<f64> = cosines.iter().map(|u| u * u).collect();
        check_mean("⟨cos²θ⟩", &squares, want, 0.0);
        assert!(p > 1e-4, "{p:e}");
    }
}

/// Torsions about atoms on a line: without an energy, as force fields have them there, they count nothing; with one they are refused
/// by name.
#[test]
fn torsions_about_a_line_are_zero_or_refused() {
    let x: Vec<Vec3<f64>> = [0.0, 0.1, 0.22, 0.32].map(|x| Vec3([x, 0.2, -0.1])).to_vec();
    let periodic = |stiffness: f64| {
        let torsion = PeriodicTorsion { atoms: [0, 1, 2, 3], periodicity: 2, phase: 0.5, stiffness };
        ForceKind::PeriodicTorsion(vec![torsion, torsion])
    };
    let powers = |slope: f64| {
        let coefficients = [1.5, 0.0, slope, 0.0, 0.0, 0.0];
        ForceKind::RbTorsion(vec![RbTorsion { atoms: [0, 1, 2, 3], coefficients }])
    };
    let evaluate = |kind: ForceKind| {
        let force = Force { name: "torsions".into(), class: "torsions".into(), group: 0, line: None, kind };
        let system = System { masses: vec![1.0; 4], forces: vec![force], ..System::default() };
        let (mut energy, mut forces) = ([0.0], vec![Vec3::zero(); 4]);
        ForceField::new(&system).unwrap().evaluate(&x, &mut energy, &mut forces).map(|()| (energy[0], forces))
    };
    assert_eq!(evaluate(periodic(0.0)).unwrap(), (0.0, vec![Vec3::zero(); 4]));
    assert_eq!(evaluate(powers(0.0)).unwrap(), (1.5, vec![Vec3::zero(); 4]));
    for kind in [periodic(1.0), powers(1.0)] {
        let error = evaluate(kind).unwrap_err();
        assert!(error.term == "torsions" && error.message.contains("on a line"), "{error}");
        assert!(!error.atoms.is_empty());
    }
}
