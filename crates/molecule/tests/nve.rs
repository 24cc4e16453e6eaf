//! Molecules at constant energy by the midpoint method: order of the energy noise, reversibility, drift.
//!
//! `PHIPSI_PICOSECONDS=100 cargo test --release -p phipsi-molecule --test all nve -- --nocapture` prints the noise of longer runs.

use crate::common::molecule;
use crate::common::statistics::about_a_line;
use allocation_counter::measure;
use phipsi_molecule::{
    Clustering, Clusters, Deviates, ForceField, MolecularForces, PotentialForce, TorsionModel, draw_momenta,
    temperature,
};
use phipsi_motion::{Conservative, Dynamics, Integrator, Method, Midpoint, Situation, System, Tolerances};
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{About, body_pose, momentum};
use phipsi_spatial::Vec3;
use std::sync::Arc;

/// A molecule in vacuum at 300 K: its snapshot of flexible dynamics, whose frozen bonds and angles are strained, so that
/// torsions relax and heat it, thermalised by drawing momenta anew every 50 steps of 2 fs.
fn start(name: &str, seed: u64) -> (MolecularForces<ForceField>, Vec<f64>, Vec<f64>) {
    let m = molecule(name, "vacuum", "md");
    let clusters = Clusters::new(&m.atoms, &m.positions, &Clustering::default()).unwrap();
    let torsion = Arc::new(TorsionModel::new(&m.atoms, &m.positions, clusters).unwrap());
    let (model, layout) = (torsion.model(), torsion.layout());
    let mut forces = MolecularForces::new(torsion.clone(), m.field);
    let (q, nv) = (model.neutral::<f64>(), model.nv());
    let mut method = Midpoint::new(model, &mut forces, 0.0, &q, &vec![0.0; nv]).unwrap();
    let (mut deviates, mut workspace) = (Deviates::new(seed), SolveWorkspace::new(layout));
    let mut p = vec![0.0; nv];
    for _ in 0..20 {
        let factors = method.factors().unwrap();
        draw_momenta(layout, factors, 300.0, &mut deviates, &mut workspace, &mut p);
        method.set_momenta(&p).unwrap();
        for _ in 0..50 {
            method.step(&mut forces, 0.002).unwrap();
        }
    }
    let v = method.velocity().unwrap().to_vec();
    (forces, method.state().q.clone(), v)
}

/// Root mean square of the total energy about a line, its slope (kJ/mol/ps), mean iterations of a drift, mean temperature.
#[derive(Debug)]
struct Noise {
    rms: f64,
    slope: f64,
    iterations: f64,
    kelvin: f64,
}

/// Of a run, or the message of the step that could not be made.
fn noise(name: &str, seed: u64, femtoseconds: f64, picoseconds: f64) -> Result<Noise, String> {
    let (mut forces, q, v) = start(name, seed);
    let model = forces.torsion().model().clone();
    let mut method = Midpoint::new(&model, &mut forces, 0.0, &q, &v).unwrap();
    let h = femtoseconds * 1e-3;
    let steps = (picoseconds / h).round() as usize;
    let mut kinetic = 0.0;
    let mut energies = Vec::with_capacity(steps);
    for _ in 0..steps {
        method.step(&mut forces, h).map_err(|e| e.to_string())?;
        let own = method.kinetic_energy().unwrap();
        kinetic += own;
        energies.push(own + method.state().potential);
    }
    let n = steps as f64;
    let (rms, slope) = about_a_line(&energies);
    Ok(Noise {
        rms,
        slope: slope / h,
        iterations: method.state().iterations as f64 / n,
        kelvin: temperature(kinetic / n, model.nv()),
    })
}

/// The noise of the energy grows as h²: slope of its logarithm 2 ± 0.2 over 0.5 … 8 fs, averaged over a few starts.
#[test]
fn energy_noise_is_of_second_order() {
    for (name, seeds) in [("aladi", 4), ("met_enkephalin", 2)] {
        let steps = [0.5f64, 1.0, 2.0, 4.0, 8.0];
        let mean_logarithm = |h: f64| {
            let sum: f64 = (0..seeds).map(|seed| noise(name, seed, h, 1.0).unwrap().rms.ln()).sum();
            sum / seeds as f64
        };
        let points: Vec<(f64, f64)> = steps.iter().map(|&h| (h.ln(), mean_logarithm(h))).collect();
        let n = points.len() as f64;
        let (x, y) = points.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
        let slope = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>()
            / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>();
        println!(
            "{name}: slope {slope:.3}, noise {:.5?} kJ/mol",
            points.iter().map(|p| p.1.exp()).collect::<Vec<_>>()
        );
        assert!((slope - 2.0).abs() < 0.2, "{name}: {slope}");
    }
}

/// 100 steps of 12 fs, momenta reversed, 100 steps: every atom back where it was, and every momentum.
#[test]
fn a_hundred_steps_of_twelve_femtoseconds_are_reversible() {
    for name in ["aladi", "met_enkephalin", "aladi_x2", "aladi_water_ions"] {
        let (mut forces, q, v) = start(name, 1);
        let torsion = forces.torsion().clone();
        let mut method = Midpoint::new(torsion.model(), &mut forces, 0.0, &q, &v).unwrap();
        let begin = method.state().clone();
        for _ in 0..100 {
            method.step(&mut forces, 0.012).unwrap();
        }
        let there = torsion.positions(&method.state().q).unwrap();
        let reversed: Vec<f64> = method.state().p.iter().map(|p| -p).collect();
        method.set_momenta(&reversed).unwrap();
        for _ in 0..100 {
            method.step(&mut forces, 0.012).unwrap();
        }
        let largest = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0f64, |m, x| m.max(x.abs()));
        let (from, to) = (torsion.positions(&q).unwrap(), torsion.positions(&method.state().q).unwrap());
        let moved = largest(&mut from.iter().zip(&there).map(|(a, b)| (*a - *b).norm()));
        let away = largest(&mut from.iter().zip(&to).map(|(a, b)| (*a - *b).norm()));
        let p = largest(&mut begin.p.iter().zip(&method.state().p).map(|(a, b)| a + b));
        let relative = p / largest(&mut begin.p.iter().copied());
        println!("{name}: moved {moved:.2} nm, back within {away:.1e} nm, momenta within {relative:.1e}");
        assert!(moved > 0.05, "{name}");
        assert!(away < 1e-12 && relative < 1e-12, "{name}: {away:e} nm, {relative:e}");
    }
}

/// The same molecule with its base elsewhere moves the same to second order: a difference four times smaller at half the step.
#[test]
fn the_choice_of_root_matters_to_second_order_only() {
    let (mut forces, q, v) = start("aladi", 4);
    let one = forces.torsion().clone();
    let (mut poses, mut positions) = (one.poses(), one.positions(&q).unwrap());
    let mut momenta = positions.clone();
    one.positions_into(&q, &mut poses, &mut positions).unwrap();
    one.velocities_into(&poses, &v, &mut momenta).unwrap();
    momenta.iter_mut().zip(&one.atoms().masses).for_each(|(u, m)| *u = u.scale(*m));
    let other = TorsionModel::with_roots(one.atoms(), &positions, one.clusters().clone(), &[0]).unwrap();
    let start = other.model().neutral::<f64>();
    let mut other_poses = other.poses();
    other.positions_into(&start, &mut other_poses, &mut positions).unwrap();
    let mut p = vec![0.0; other.model().nv()];
    other.gather_into(&other_poses, &momenta, &mut other.gather_workspace(), &mut p).unwrap();
    let other = Arc::new(other);
    let mut other_forces = MolecularForces::new(other.clone(), molecule("aladi", "vacuum", "md").field);
    let mut apart = |h: f64, steps: u32| {
        let mut method = Midpoint::new(one.model(), &mut forces, 0.0, &q, &v).unwrap();
        let rest = vec![0.0; p.len()];
        let mut second = Midpoint::new(other.model(), &mut other_forces, 0.0, &start, &rest).unwrap();
        second.set_momenta(&p).unwrap();
        for _ in 0..steps {
            method.step(&mut forces, h).unwrap();
            second.step(&mut other_forces, h).unwrap();
        }
        let a = one.positions(&method.state().q).unwrap();
        let b = other.positions(&second.state().q).unwrap();
        a.iter().zip(&b).map(|(a, b)| (*a - *b).norm()).fold(0.0, f64::max)
    };
    let differences = [apart(0.002, 50), apart(0.001, 100), apart(0.0005, 200)];
    println!("two roots: apart by {differences:?} nm");
    for pair in differences.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.1, "order {order}: {differences:?}");
    }
}

/// Ordinary dynamics under the potential as an ordinary force: DOP853 and the midpoint method agree to the latter's order,
/// and the force tells its terms.
#[test]
fn a_potential_is_an_ordinary_force() {
    let (mut forces, q, v) = start("aladi", 6);
    let torsion = forces.torsion().clone();
    let model = torsion.model();
    let mut tau = vec![0.0; model.nv()];
    let energy = forces.evaluate(&q, &mut tau).unwrap();
    let terms: Vec<(String, f64)> = forces.energies().map(|(name, e)| (name.to_string(), e)).collect();
    let own = MolecularForces::new(torsion.clone(), molecule("aladi", "vacuum", "md").field);
    let mut dynamics = Dynamics::new(model, vec![Box::new(PotentialForce::new("ff14SB", own))]).unwrap();
    let mut again = tau.clone();
    assert_eq!(dynamics.evaluate(&q, &mut again).unwrap(), energy);
    assert_eq!(again, tau);
    let force = &dynamics.forces()[0];
    let at = Situation { model, layout: torsion.layout(), t: 0.0, q: &q, v: &v, kinematics: None };
    let told: Vec<(String, f64)> = force.terms().into_iter().zip(force.term_energies(&at)).collect();
    assert_eq!(told, terms);

    let aux = vec![0.0; dynamics.auxiliary_len()];
    let mut exact = Integrator::new(model, Method::Dop853, Tolerances::new(1e-11), 0.0, &q, &v, &aux);
    while exact.t() < 0.02 {
        exact.step(&mut dynamics, 0.02, false).unwrap();
    }
    let mut error = |steps: u32| {
        let mut method = Midpoint::new(model, &mut forces, 0.0, &q, &v).unwrap();
        for _ in 0..steps {
            method.step(&mut forces, 0.02 / f64::from(steps)).unwrap();
        }
        let x = model.difference(exact.q(), &method.state().q);
        x.iter().fold(0.0f64, |m, x| m.max(x.abs()))
    };
    let order = (error(40) / error(80)).log2();
    assert!((order - 2.0).abs() < 0.05, "order {order}");
}

#[test]
fn steps_do_not_allocate() {
    let (mut forces, q, v) = start("aladi", 7);
    let model = forces.torsion().model().clone();
    let mut method = Midpoint::new(&model, &mut forces, 0.0, &q, &v).unwrap();
    let counted = measure(|| {
        method.step(&mut forces, 0.004).unwrap();
    });
    assert_eq!(counted.count_total, 0, "{counted:?}");
}

/// Momentum and, in vacuum, angular momentum about the centre of mass of a molecule at rest on the whole.
#[test]
fn a_molecule_keeps_its_momentum() {
    let (mut forces, q, mut v) = start("aladi", 3);
    let torsion = forces.torsion().clone();
    // The base's velocity takes up the momentum: the centre of mass is at rest.
    let layout = torsion.layout();
    let [.., x, y, z] = momentum(layout, &q, &v, About::CenterOfMass).unwrap().to_array();
    let axes = body_pose(layout, &q, Some(0)).unwrap().rotation;
    let speed = axes.transpose_mul(Vec3([x, y, z])).scale(1.0 / torsion.model().total_mass());
    (0..3).for_each(|i| v[3 + i] -= speed.0[i]);
    let spatial = |q: &[f64], v: &[f64]| momentum(layout, q, v, About::CenterOfMass).unwrap().to_array();
    let before = spatial(&q, &v);
    let mut method = Midpoint::new(torsion.model(), &mut forces, 0.0, &q, &v).unwrap();
    for _ in 0..2000 {
        method.step(&mut forces, 0.008).unwrap();
    }
    let v = method.velocity().unwrap().to_vec();
    let after = spatial(&method.state().q, &v);
    let size = before.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let error = before.iter().zip(&after).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / size;
    println!("momentum after 2000 steps: {error:.1e} relative");
    // A step rounds by the moments of forces that cancel, some 1e3 times the angular momentum's rate: 1e3 ε √2000.
    assert!(error < 1e-11, "{error:e}");
}

/// No drift at 4 fs that could be told from the noise, and the table of noise that longer runs print.
#[test]
fn energy_does_not_drift() {
    let picoseconds: f64 = match std::env::var("PHIPSI_PICOSECONDS") {
        Ok(text) => text.parse().expect("PHIPSI_PICOSECONDS is a number"),
        Err(_) => 10.0,
    };
    for (name, steps) in [("aladi", &[4.0, 12.0][..]), ("met_enkephalin", &[4.0][..])] {
        let long = [0.5, 1.0, 2.0, 4.0, 8.0, 12.0, 15.0];
        for &h in if picoseconds > 10.0 { &long[..] } else { steps } {
            let (forces, ..) = start(name, 2);
            let nv = forces.torsion().degrees_of_freedom() as f64;
            let Noise { rms, slope, iterations, kelvin } = match noise(name, 2, h, picoseconds) {
                Ok(noise) => noise,
                // Beyond the range of the method a long run may be lost, and says so.
                Err(message) if h > 12.0 => {
                    println!("{name}, {picoseconds} ps at {h} fs: lost: {message}");
                    continue;
                }
                Err(message) => panic!("{name}, {h} fs: {message}"),
            };
            println!(
                "{name}, {picoseconds} ps at {h} fs: noise {rms:.4} kJ/mol, drift {:.1e} kJ/mol/ps/dof, \
                 {iterations:.1} iterations, {kelvin:.0} K",
                slope.abs() / nv
            );
            // The energy wanders by its noise within the run: a line through it has a slope of at most that.
            assert!(h > 8.0 || slope.abs() * picoseconds < 2.0 * rms, "{name}, {h} fs: {slope:e}");
        }
    }
}
