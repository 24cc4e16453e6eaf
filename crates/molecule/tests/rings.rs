//! Flexible rings, open angles, Cartesian coordinates.
//!
//! `PHIPSI_STEPS=1000000 cargo test --release -p phipsi-molecule --test all rings::closed -- --nocapture` makes the long runs;
//! `PHIPSI_RINGS="bpti"` runs others, of the folder that `PHIPSI_MOLECULES` names.

use crate::common::chains::KT;
use crate::common::molecule;
use crate::common::statistics::{about_a_line, check_mean, p_value};
use phipsi_closure::ClosedMomenta;
use phipsi_molecule::{
    Angles, Atoms, BOLTZMANN, Bath, Clustering, Clusters, Deviates, Ensemble, FixmanPotential, ForceField,
    MinimizeOptions, MolecularForces, Potential, Rings, TorsionModel, WithFixman, draw_momenta,
    fixman_energy_of_rings, minimize,
};
use phipsi_motion::{Conservative, Midpoint};
use phipsi_recursion::DynamicsError;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_spatial::Vec3;
use std::sync::Arc;

fn steps(default: usize) -> usize {
    std::env::var("PHIPSI_STEPS").map_or(default, |s| s.parse().expect("PHIPSI_STEPS is a whole number"))
}

fn model(name: &str, id: &str, clustering: &Clustering) -> (Arc<TorsionModel>, MolecularForces<ForceField>) {
    let m = molecule(name, if name == "caac_ss" { "charmm36" } else { "vacuum" }, id);
    let clusters = Clusters::new(&m.atoms, &m.positions, clustering).unwrap();
    let torsion = Arc::new(TorsionModel::new(&m.atoms, &m.positions, clusters).unwrap());
    (torsion.clone(), MolecularForces::new(torsion, m.field))
}

fn flexible() -> Clustering {
    Clustering { rings: Rings::Flexible, ..Clustering::default() }
}

/// At a temperature, thermalised by drawing momenta anew.
fn thermal(
    torsion: &TorsionModel,
    forces: &mut MolecularForces<ForceField>,
    (kelvin, h, seed): (f64, f64, u64),
) -> Midpoint {
    let nv = torsion.model().nv();
    let mut method =
        Midpoint::new(torsion.model(), forces, 0.0, &torsion.model().neutral::<f64>(), &vec![0.0; nv])
            .unwrap();
    let (mut deviates, mut workspace) = (Deviates::new(seed), SolveWorkspace::new(torsion.layout()));
    let mut p = vec![0.0; nv];
    for _ in 0..10 {
        let factors = method.factors().unwrap();
        draw_momenta(torsion.layout(), factors, kelvin, &mut deviates, &mut workspace, &mut p);
        method.set_momenta(&p).unwrap();
        for _ in 0..50 {
            method.step(forces, h).unwrap();
        }
    }
    method
}

fn largest(x: impl IntoIterator<Item = f64>) -> f64 {
    x.into_iter().fold(0.0f64, |most, x| most.max(x.abs()))
}

/// Proline: five ring bonds, one of them the closure, three angles: two coordinates of pucker. A disulfide: a ring of more than
/// seven atoms has six degrees of freedom less than bonds.
#[test]
fn degrees_of_freedom_are_counted_from_the_rank() {
    let (proline, _) = model("ace_pro_nme", "min", &flexible());
    let (rigid, _) = model("ace_pro_nme", "min", &Clustering::default());
    assert_eq!((proline.clusters().closures.len(), proline.clusters().bends()), (1, 3));
    assert_eq!(proline.model().nv() - proline.degrees_of_freedom(), 5);
    assert_eq!(proline.degrees_of_freedom(), rigid.degrees_of_freedom() + 2);

    let (bridge, _) = model("caac_ss", "min", &flexible());
    let (rigid, _) = model("caac_ss", "min", &Clustering::default());
    let closures = &bridge.clusters().closures;
    assert_eq!(closures.len(), 1);
    // A lone sulfur turns nothing: the ring is cut beside it.
    assert!(closures[0].atoms.iter().all(|&i| bridge.atoms().elements[i] == 6), "{closures:?}");
    let ring = bridge.clusters().hinges.len() - rigid.clusters().hinges.len() + 1;
    // Six conditions close a ring of bonds that all turn.
    assert_eq!(bridge.degrees_of_freedom(), rigid.degrees_of_freedom() + ring - 6);
    assert_eq!(bridge.clusters().bends(), 0);

    // A ring of twenty with a disulfide, and a proline in the tail.
    let (both, _) = model("oxytocin", "min", &flexible());
    let (rigid, _) = model("oxytocin", "min", &Clustering::default());
    assert_eq!((both.clusters().closures.len(), both.clusters().bends()), (2, 3));
    assert_eq!(both.degrees_of_freedom(), rigid.degrees_of_freedom() + 2 + (20 - 6));

    // Head to tail: a ring of eighteen, and two prolines, of whose two coordinates of pucker each one is a φ of the large ring.
    let (cycle, _) = model("cyclo_apg2", "min", &flexible());
    let (rigid, _) = model("cyclo_apg2", "min", &Clustering::default());
    assert_eq!((cycle.clusters().closures.len(), cycle.clusters().bends()), (3, 6));
    assert_eq!(cycle.degrees_of_freedom(), rigid.degrees_of_freedom() + (18 - 6) + 2);

    // Aromatic rings stay rigid.
    let (aromatic, _) = model("met_enkephalin", "min", &flexible());
    assert!(aromatic.clusters().closures.is_empty());
    // A list names the rings.
    let proline_ring: Vec<usize> = {
        let names = ["N", "CA", "CB", "CG", "CD"];
        let atoms = proline.atoms();
        (0..atoms.len())
            .filter(|&i| {
                atoms.names[i].residue.starts_with("PRO") && names.contains(&atoms.names[i].atom.as_str())
            })
            .collect()
    };
    let listed = Clustering { rings: Rings::Listed(vec![proline_ring]), ..Clustering::default() };
    let (again, _) = model("ace_pro_nme", "min", &listed);
    assert_eq!(again.clusters(), proline.clusters());
}

/// Closure to 1e-10 nm, no drift of the energy, bond lengths of the cut bonds kept; reversible.
#[test]
fn closed_rings_run_at_constant_energy() {
    let names = std::env::var("PHIPSI_RINGS").unwrap_or("ace_pro_nme caac_ss oxytocin cyclo_apg2".into());
    for name in names.split(' ') {
        let h = if name == "caac_ss" { 0.004 } else { 0.002 };
        let (torsion, mut forces) = model(name, "min", &flexible());
        let mut method = thermal(&torsion, &mut forces, (300.0, h, 1));
        let start = method.state().clone();
        let (n, mut open) = (steps(10_000), 0.0f64);
        let mut energies = Vec::with_capacity(n);
        let clock = std::time::Instant::now();
        for _ in 0..n {
            method.step(&mut forces, h).unwrap();
            open = open.max(method.residual().unwrap().unwrap().position);
            energies.push(method.kinetic_energy().unwrap() + method.state().potential);
        }
        let microseconds = clock.elapsed().as_secs_f64() * 1e6 / n as f64;
        let bond = torsion.clusters().closures[0].atoms;
        let length = |q: &[f64]| {
            let x = torsion.positions(q).unwrap();
            (x[bond[0]] - x[bond[1]]).norm()
        };
        let stretched = (length(&method.state().q) - length(&torsion.model().neutral::<f64>())).abs();
        let (rms, slope) = about_a_line(&energies);
        let slope = slope / h;
        let dof = torsion.degrees_of_freedom();
        println!(
            "{name}: {n} steps of {h} ps, {dof} degrees of freedom: closure {open:.1e}, bond {stretched:.1e} nm, noise \
             {rms:.4} kJ/mol, drift {:.1e} kJ/mol/ps/dof, {:.1} iterations, {microseconds:.0} µs a step",
            slope / dof as f64,
            (method.state().iterations - start.iterations) as f64 / n as f64
        );
        assert!(open < 1e-10 && stretched < 1e-10, "{name}: {open:e} {stretched:e}");
        // A line through a run has a slope of at most its noise.
        assert!(slope.abs() * n as f64 * h < 2.0 * rms, "{name}: {slope:e}");

        // 100 steps there and back.
        let begin = method.state().clone();
        for half in 0..2 {
            for _ in 0..100 {
                method.step(&mut forces, h).unwrap();
            }
            if half == 0 {
                let reversed: Vec<f64> = method.state().p.iter().map(|p| -p).collect();
                method.set_momenta(&reversed).unwrap();
            }
        }
        let (a, b) = (torsion.positions(&begin.q).unwrap(), torsion.positions(&method.state().q).unwrap());
        let away = largest(a.iter().zip(&b).map(|(a, b)| (*a - *b).norm()));
        println!("{name}: back within {away:.1e} nm");
        // Chaos multiplies the rounding of 200 steps by some ten.
        assert!(away < 1e-11, "{name}: {away:e} nm");
    }
}

/// Kinetic energy of Langevin dynamics on a closed ring: n/2 kT with n counted from the rank.
#[test]
fn the_temperature_counts_the_closed_degrees_of_freedom() {
    let (torsion, mut forces) = model("ace_pro_nme", "min", &flexible());
    let mut method = thermal(&torsion, &mut forces, (300.0, 0.001, 2));
    let mut bath = Bath::new(&mut method, Ensemble::Langevin { friction: 20.0 }, KT, 3).unwrap();
    assert_eq!(bath.degrees_of_freedom(), torsion.degrees_of_freedom());
    let n = 6000;
    let mut sum = 0.0;
    for _ in 0..n {
        bath.advance(&mut method, &mut forces, 0.002, 1).unwrap();
        sum += method.kinetic_energy().unwrap();
    }
    let ratio = 2.0 * sum / (n as f64 * KT * torsion.degrees_of_freedom() as f64);
    // Velocities forget themselves in 25 steps: 240 values of 13 squares have a deviation of √(2/(240·13)) = 0.025.
    println!("2⟨K⟩/(n kT) = {ratio:.3}");
    assert!((ratio - 1.0).abs() < 4.0 * 0.025, "{ratio}");
}

/// Chains on rigid and internal motion keep rings closed, conserve their energy to second order, and give the temperature.
#[test]
fn nose_hoover_chains_leave_rings_closed() {
    let (torsion, mut forces) = model("ace_pro_nme", "min", &flexible());
    let start = thermal(&torsion, &mut forces, (300.0, 0.001, 9));
    let mut run = |h: f64, steps: usize| {
        let mut method = start.clone();
        let mut bath = Bath::new(&mut method, Ensemble::NoseHoover { relaxation: 0.1 }, KT, 3).unwrap();
        assert_eq!(bath.degrees_of_freedom(), torsion.degrees_of_freedom() - 3);
        let (mut conserved, mut sum, mut open) = (Vec::new(), 0.0, 0.0f64);
        for _ in 0..steps {
            bath.advance(&mut method, &mut forces, h, 1).unwrap();
            let kinetic = method.kinetic_energy().unwrap();
            sum += kinetic;
            conserved.push(kinetic + method.state().potential - bath.heat());
            let residual = method.residual().unwrap().unwrap();
            open = open.max(residual.position).max(residual.velocity * h);
        }
        let freedom = bath.degrees_of_freedom() as f64;
        (about_a_line(&conserved).0, 2.0 * sum / (steps as f64 * KT * freedom), open)
    };
    let (fine, _, open) = run(0.001, 2000);
    let (coarse, ..) = run(0.002, 1000);
    let (_, ratio, _) = run(0.002, 10_000);
    println!("noise {fine:.2e}, {coarse:.2e} kJ/mol, 2⟨K⟩/(n kT) {ratio:.3}, open {open:.1e}");
    // Second order over the same 2 ps: a factor of four within two.
    assert!(coarse < 8.0 * fine && fine < 0.02, "{fine:e} {coarse:e}");
    assert!(open < 1e-12, "{open:e}");
    // Twenty picoseconds have some two hundred relaxation times of ten squares.
    assert!((ratio - 1.0).abs() < 4.0 * (2.0 / (200.0 * 10.0f64)).sqrt(), "{ratio}");
}

/// The minimum of a molecule with flexible rings is closed, below that with rigid ones, and no motion of the rings lowers it.
#[test]
fn minima_with_flexible_rings_are_closed() {
    for (name, id) in [("ace_pro_nme", "md"), ("caac_ss", "min"), ("cyclo_apg2", "md")] {
        let lowest = |clustering: &Clustering| {
            let (torsion, mut forces) = model(name, id, clustering);
            let q = torsion.model().neutral::<f64>();
            let (minimum, _) = minimize(&mut forces, &q, &MinimizeOptions::default()).unwrap();
            assert!(minimum.converged, "{name}: {minimum:?}");
            (torsion, forces, minimum)
        };
        let (_, _, rigid) = lowest(&Clustering::default());
        let (torsion, mut forces, minimum) = lowest(&flexible());
        println!(
            "{name}: {} rigid, {} flexible, {} evaluations",
            rigid.energy, minimum.energy, minimum.evaluations
        );
        assert!(minimum.energy < rigid.energy - 0.01, "{name}");
        // A run from there, without speed, stays closed and where it is: forces along the rings are gone.
        let nv = torsion.model().nv();
        let mut method =
            Midpoint::new(torsion.model(), &mut forces, 0.0, &minimum.q, &vec![0.0; nv]).unwrap();
        assert!(method.residual().unwrap().unwrap().position < 1e-12);
        let start = method.state().potential;
        assert!((start - minimum.energy).abs() < 1e-9 * (1.0 + start.abs()));
        let mut most = 0.0f64;
        for _ in 0..200 {
            method.step(&mut forces, 0.001).unwrap();
            most = most.max(method.kinetic_energy().unwrap());
        }
        // ½ f·H⁻¹f of a residual force of 0.01 kJ/mol/rad in each of some twenty soft directions.
        assert!(most < 1e-3, "{name}: {most:e}");
    }
}

/// Fixman's potential on rings against differences along the closed rings, and its energy against the elimination of the loops.
#[test]
fn fixmans_force_is_the_gradient_along_the_closed_rings() {
    for (name, id) in [("ace_pro_nme", "min"), ("caac_ss", "min"), ("cyclo_apg2", "min")] {
        let (torsion, mut forces) = model(name, id, &flexible());
        let method = thermal(&torsion, &mut forces, (300.0, 0.001, 5));
        let mut fixman = FixmanPotential::of(&torsion, KT).unwrap();
        let mut momenta = ClosedMomenta::<f64>::new(torsion.model()).unwrap();
        let mut closed = phipsi_closure::ClosedDynamics::<f64>::new(torsion.model()).unwrap();
        let (q, nv) = (method.state().q.clone(), torsion.model().nv());
        let mut force = vec![0.0; nv];
        let energy = fixman.evaluate(&q, &mut force).unwrap();
        let sines: f64 = torsion.open_angles().map(|(c, _, start)| (start + q[c]).sin().ln()).sum();
        let other = fixman_energy_of_rings(&mut momenta, &q, KT).unwrap().unwrap() - KT * sines;
        // ln det of matrices of condition 1e6.
        assert!((energy - other).abs() < 1e-9 * energy.abs(), "{name}: {energy} {other}");
        let mut deviates = Deviates::new(6);
        let mut worst = 0.0f64;
        for _ in 0..10 {
            let mut v = vec![0.0; nv];
            deviates.fill_normal(&mut v);
            torsion.close_velocities(&q, &mut v).unwrap();
            let size = v.iter().map(|v| v * v).sum::<f64>().sqrt();
            v.iter_mut().for_each(|v| *v /= size);
            let mut at = |step: f64| {
                let x: Vec<f64> = v.iter().map(|v| step * v).collect();
                let mut there = torsion.model().integrate(&q, &x);
                closed.project_position(&mut there, &Default::default()).unwrap();
                fixman.evaluate(&there, &mut vec![0.0; nv]).unwrap()
            };
            // The way over the surface differs from its tangent by second order, which the odd part does not see; fifth order next.
            let h = 2e-3;
            let slope = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
            let own: f64 = -force.iter().zip(&v).map(|(f, v)| f * v).sum::<f64>();
            worst = worst.max((slope - own).abs());
            // ε of the energy over the step, and its fifth derivative.
            assert!((slope - own).abs() < 1e-6 * KT, "{name}: {slope} {own}");
        }
        println!("{name}: {worst:.1e} kJ/mol/rad");
    }
}

/// ln det M, ln det(G M⁻¹ G*) and their gradients along the closed rings, against dense matrices and dual numbers, at thermal states.
#[test]
fn the_potential_of_rings_is_that_of_dense_matrices() {
    for (name, seeds) in [("ace_pro_nme", 0..3), ("caac_ss", 3..4), ("cyclo_apg2", 4..5)] {
        let (torsion, mut forces) = model(name, "min", &flexible());
        let mut fixman = FixmanPotential::of(&torsion, KT).unwrap();
        let length = ClosedMomenta::<f64>::new(torsion.model()).unwrap().dynamics().length();
        let tree = torsion.model().clone().without_closures();
        for seed in seeds {
            let q = thermal(&torsion, &mut forces, (300.0, 0.001, seed)).state().q.clone();
            let nv = torsion.model().nv();
            let mut force = vec![0.0; nv];
            let energy = fixman.evaluate(&q, &mut force).unwrap();
            let (log, of_rings) = phipsi_reference::ring_determinant(torsion.model(), &q, length).unwrap();
            let of_mass = phipsi_reference::log_determinant_gradient(&tree, &q).unwrap();
            let mut want = 0.5 * KT * (phipsi_reference::log_determinant(&tree, &q).unwrap() + log);
            let mut slope: Vec<f64> =
                of_rings.iter().zip(&of_mass).map(|(a, b)| -0.5 * KT * (a + b)).collect();
            for (c, dof, start) in torsion.open_angles() {
                let (sin, cos) = (start + q[c]).sin_cos();
                want -= KT * sin.abs().ln();
                slope[dof] += KT * cos / sin;
            }
            // n·ε·κ: both sides solve with M, whose condition is κ.
            let eigen = phipsi_reference::mass_matrix(&tree, &q).symmetric_eigenvalues();
            let kappa = eigen.max() / eigen.min();
            let bar = 8.0 * nv as f64 * f64::EPSILON * kappa * KT;
            assert!((energy - want).abs() < bar * nv as f64, "{name}, {seed}: {energy} {want}");
            let mut deviates = Deviates::new(seed);
            let size = largest(of_rings.iter().chain(&of_mass).copied());
            for _ in 0..nv {
                let mut v = vec![0.0; nv];
                deviates.fill_normal(&mut v);
                torsion.close_velocities(&q, &mut v).unwrap();
                let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
                let off: f64 = force.iter().zip(&slope).zip(&v).map(|((a, b), v)| (a - b) * v).sum();
                assert!(off.abs() < bar * size * norm, "{name}, {seed}: {off:e} {:e}", bar * size * norm);
            }
        }
    }
}

/// Langevin dynamics with Fixman's potential on rings conserves its energy to second order, as its force is the gradient.
#[test]
fn fixmans_potential_on_rings_keeps_the_energy() {
    let (torsion, mut forces) = model("ace_pro_nme", "min", &flexible());
    let mut fixman = FixmanPotential::of(&torsion, KT).unwrap();
    let start = thermal(&torsion, &mut forces, (300.0, 0.001, 5));
    let mut noise = |h: f64| {
        let mut method = start.clone();
        let mut system = WithFixman { inner: &mut forces, fixman: Some(&mut fixman) };
        method.refresh(&mut system).unwrap();
        let energies: Vec<f64> = (0..(0.5 / h) as usize)
            .map(|_| {
                method.step(&mut system, h).unwrap();
                method.kinetic_energy().unwrap() + method.state().potential
            })
            .collect();
        about_a_line(&energies).0
    };
    let order = (noise(2e-3) / noise(1e-3)).log2();
    assert!((order - 2.0).abs() < 0.2, "{order}");
}

/// det M · det(G M⁻¹ G*) against a dense determinant: of M on the tangent space of the closures, det M det(G M⁻¹ G*) =
/// det(N* M N) det(G G*) with N an orthonormal basis of the null space of G.
#[test]
fn the_determinant_of_rings_is_that_of_dense_matrices() {
    let (torsion, mut forces) = model("ace_pro_nme", "min", &flexible());
    let mut method = thermal(&torsion, &mut forces, (300.0, 0.001, 5));
    let mut momenta = ClosedMomenta::<f64>::new(torsion.model()).unwrap();
    let energy = |q: &[f64], momenta: &mut ClosedMomenta<f64>| {
        let mut closed = phipsi_closure::ClosedDynamics::<f64>::new(torsion.model()).unwrap();
        let (nv, rows, length) = (q_len(&torsion), closed.rows(), closed.length());
        let mut jacobian = nalgebra::DMatrix::zeros(rows, nv);
        let (mut position, mut rate) = (vec![0.0; rows], vec![0.0; rows]);
        for i in 0..nv {
            let mut v = vec![0.0; nv];
            v[i] = 1.0;
            closed.residual(q, Some(&v), &Default::default(), &mut position, &mut rate).unwrap();
            for (row, rate) in rate.iter().enumerate() {
                // A revolute closure: the first two rows are angles.
                jacobian[(row, i)] = if row < 2 { length * rate } else { *rate };
            }
        }
        let mut mass = nalgebra::DMatrix::zeros(nv, nv);
        for i in 0..nv {
            let mut v = vec![0.0; nv];
            v[i] = 1.0;
            let column = phipsi_recursion::multiply_by_mass_matrix(torsion.layout(), q, &v).unwrap();
            column.iter().enumerate().for_each(|(j, x)| mass[(j, i)] = *x);
        }
        let inverse = mass.clone().cholesky().unwrap();
        let omega = &jacobian * inverse.solve(&jacobian.transpose());
        let dense = 2.0 * inverse.l().diagonal().map(f64::ln).sum()
            + 2.0 * omega.cholesky().unwrap().l().diagonal().map(f64::ln).sum();
        let own = fixman_energy_of_rings(momenta, q, 2.0).unwrap().unwrap();
        (own, dense)
    };
    for _ in 0..5 {
        for _ in 0..100 {
            method.step(&mut forces, 0.002).unwrap();
        }
        let (own, dense) = energy(&method.state().q, &mut momenta);
        // The dense solution loses the condition of M, some 1e6.
        assert!((own - dense).abs() < 1e-9 * dense.abs(), "{own} {dense}");
    }
}

fn q_len(torsion: &TorsionModel) -> usize {
    torsion.model().nv()
}

/// Every atom a body: the same trajectory as velocity Verlet in Cartesian coordinates, written here.
#[test]
fn cartesian_coordinates_are_velocity_verlet() {
    let m = molecule("aladi", "vacuum", "md");
    let n = m.atoms.len();
    let clusters = Clusters::new(&m.atoms, &m.positions, &Clustering::cartesian(n)).unwrap();
    let torsion = Arc::new(TorsionModel::new(&m.atoms, &m.positions, clusters).unwrap());
    assert_eq!(torsion.degrees_of_freedom(), 3 * n);
    let mut forces = MolecularForces::new(torsion.clone(), m.field);
    let mut deviates = Deviates::new(4);
    let mut noise = vec![0.0; 3 * n];
    deviates.fill_normal(&mut noise);
    let mut u: Vec<Vec3<f64>> = (0..n)
        .map(|i| Vec3([0, 1, 2].map(|k| noise[3 * i + k] * (BOLTZMANN * 300.0 / m.atoms.masses[i]).sqrt())))
        .collect();
    let mut x = m.positions.clone();
    let (q, mut poses) = (torsion.model().neutral::<f64>(), torsion.poses());
    torsion.positions_into(&q, &mut poses, &mut vec![Vec3::zero(); n]).unwrap();
    let momenta: Vec<Vec3<f64>> = u.iter().zip(&m.atoms.masses).map(|(u, m)| u.scale(*m)).collect();
    let mut p = vec![0.0; 3 * n];
    torsion.gather_into(&poses, &momenta, &mut torsion.gather_workspace(), &mut p).unwrap();
    let mut method = Midpoint::new(torsion.model(), &mut forces, 0.0, &q, &vec![0.0; 3 * n]).unwrap();
    method.set_momenta(&p).unwrap();

    let mut field = molecule("aladi", "vacuum", "md").field;
    let mut energies = vec![0.0; field.terms().len()];
    let mut f = vec![Vec3::zero(); n];
    let h = 0.001;
    field.evaluate(&x, &mut energies, &mut f).unwrap();
    for _ in 0..100 {
        for i in 0..n {
            u[i] += f[i].scale(0.5 * h / m.atoms.masses[i]);
            x[i] += u[i].scale(h);
        }
        field.evaluate(&x, &mut energies, &mut f).unwrap();
        for i in 0..n {
            u[i] += f[i].scale(0.5 * h / m.atoms.masses[i]);
        }
        method.step(&mut forces, h).unwrap();
    }
    let own = torsion.positions(&method.state().q).unwrap();
    let apart = largest(own.iter().zip(&x).map(|(a, b)| (*a - *b).norm()));
    println!("after 100 steps of 1 fs: {apart:.1e} nm from velocity Verlet");
    // Rounding of 1e-16 nm a step, which bonds multiply little in 0.1 ps.
    assert!(apart < 1e-12, "{apart:e} nm");
}

/// Bond angles that are open: forces are the gradient of the energy along every increment, bends included, and θ = θ₀ + β.
#[test]
fn angles_bend_as_they_say() {
    let clustering = Clustering { angles: Angles::AtHinges, ..Clustering::default() };
    let (torsion, mut forces) = model("aladi", "md", &clustering);
    let plain = model("aladi", "md", &Clustering::default()).0;
    let bends = torsion.clusters().bends();
    assert!(
        bends >= 5 && bends + torsion.clusters().locked.len() == torsion.clusters().torsions(),
        "{bends}"
    );
    assert_eq!(torsion.degrees_of_freedom(), plain.degrees_of_freedom() + bends);
    let nv = torsion.model().nv();
    let start = torsion.model().neutral::<f64>();
    let mut fixman = FixmanPotential::of(&torsion, KT).unwrap();
    let mut energy =
        |q: &[f64], out: &mut [f64]| forces.evaluate(q, out).unwrap() + fixman.evaluate(q, out).unwrap();
    let x: Vec<f64> = (0..nv).map(|i| 0.1 * ((7 * i) as f64).sin()).collect();
    let q = torsion.model().integrate(&start, &x);
    let mut gradient = vec![0.0; nv];
    energy(&q, &mut gradient);
    for i in 0..nv {
        let mut at = |delta: f64| {
            let mut x = vec![0.0; nv];
            x[i] = delta;
            energy(&torsion.model().integrate(&q, &x), &mut vec![0.0; nv])
        };
        let step = 1e-5;
        let slope = (8.0 * (at(step) - at(-step)) - (at(2.0 * step) - at(-2.0 * step))) / (12.0 * step);
        let scale = largest(gradient.clone());
        // Rounding of the energy over the step.
        assert!((slope + gradient[i]).abs() < 1e-7 * scale, "{i}: {slope} {}", gradient[i]);
    }
    let positions = torsion.positions(&q).unwrap();
    let mut open = torsion.open_angles();
    for hinge in &torsion.clusters().hinges {
        let Some(bend) = hinge.bend else { continue };
        let (coordinate, _, theta) = open.next().unwrap();
        let other = if hinge.atoms[0] == bend.center { hinge.atoms[1] } else { hinge.atoms[0] };
        let (u, w) =
            (positions[bend.reference] - positions[bend.center], positions[other] - positions[bend.center]);
        let angle = u.cross(w).norm().atan2(u.dot(w));
        assert!((angle - theta - q[coordinate]).abs() < 1e-12, "{angle} {theta} {}", q[coordinate]);
    }
}

/// Three beads, rigid bonds, free angle, U = −2 kT ln sin θ, which keeps them from the line, where the coordinates are singular:
/// sin³θ √((1/m₁ + 1/m₂)(1/m₂ + 1/m₃) − cos²θ/m₂²) without Fixman's potential, sin³θ with it, by hybrid Monte Carlo.
#[test]
fn a_free_angle_has_the_density_of_the_trimer() {
    const MASSES: [f64; 3] = [24.0, 4.0, 24.0];
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
    let torsion = TorsionModel::new(&atoms, &positions, clusters).unwrap();
    assert_eq!(torsion.degrees_of_freedom(), 7);
    let (coordinate, dof, start) = torsion.open_angles().next().unwrap();
    for fixman in [false, true] {
        let mut wall = |q: &[f64], forces: &mut [f64]| {
            let (sin, cos) = (start + q[coordinate]).sin_cos();
            forces.fill(0.0);
            forces[dof] = 2.0 * KT * cos / sin;
            Ok::<f64, DynamicsError>(-2.0 * KT * sin.abs().ln())
        };
        let mut potential = FixmanPotential::of(&torsion, KT).unwrap();
        let mut system = WithFixman { inner: &mut wall, fixman: fixman.then_some(&mut potential) };
        let model = torsion.model();
        let mut method =
            Midpoint::new(model, &mut system, 0.0, &model.neutral::<f64>(), &vec![0.0; model.nv()]).unwrap();
        let mut bath =
            Bath::new(&mut method, Ensemble::HybridMonteCarlo { steps: 8 }, KT, 11 + u64::from(fixman))
                .unwrap();
        let mut cosines = Vec::new();
        let samples = std::env::var("PHIPSI_SAMPLES").map_or(5000, |s| s.parse().expect("a whole number"));
        for i in 0..2 * samples {
            bath.advance(&mut method, &mut system, 0.04, 8).unwrap();
            if i % 2 == 1 {
                cosines.push((start + method.state().q[coordinate]).cos());
            }
        }
        // In u = cos θ.
        let [first, last] = [0, 2].map(|i| 1.0 / MASSES[i] + 1.0 / MASSES[1]);
        let wall = |u: f64| 1.0 - u * u;
        let hard = |u: f64| wall(u) * (first * last - u * u / (MASSES[1] * MASSES[1])).sqrt();
        let hard = p_value(&cosines, [-1.0, 1.0], 8, hard);
        let stiff = p_value(&cosines, [-1.0, 1.0], 8, wall);
        let acceptance = bath.trials().acceptance().unwrap();
        println!("fixman {fixman}: p {hard:.2e} rigid, {stiff:.2e} stiff limit; acceptance {acceptance:.3}");
        let (right, wrong) = if fixman { (stiff, hard) } else { (hard, stiff) };
        assert!(right > 1e-3 && wrong < 1e-4, "{right} {wrong}");
        if fixman {
            let squares: Vec<f64> = cosines.iter().map(|u| u * u).collect();
            check_mean("⟨cos²θ⟩", &squares, 0.2, 0.0);
        }
    }
}
