//! Deviates and Maxwell–Boltzmann velocities: reproducibility, moments, covariance, equipartition.

use crate::common::molecule;
use phipsi_molecule::{
    BOLTZMANN, Clustering, Clusters, Deviates, TorsionModel, draw_momenta, draw_velocities, temperature,
};
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{
    ArticulatedSweep, kinetic_energy, mass_matrix, mass_matrix_inverse, multiply_by_mass_matrix,
};

fn torsion(name: &str) -> TorsionModel {
    let m = molecule(name, if name == "butane" { "charmm36" } else { "vacuum" }, "md");
    let clusters = Clusters::new(&m.atoms, &m.positions, &Clustering::default()).unwrap();
    TorsionModel::new(&m.atoms, &m.positions, clusters).unwrap()
}

/// Sample moments of n independent deviates differ from 0, 1, 0, 3 by their own deviations √(1, 2, 15, 96)/√n, five times at
/// most.
#[test]
fn deviates_are_normal_and_independent() {
    let n = 400_000;
    let mut x = vec![0.0; n];
    Deviates::new(1).fill_normal(&mut x);
    let mean = |f: &dyn Fn(usize) -> f64| (0..n).map(f).sum::<f64>() / n as f64;
    let root = (n as f64).sqrt();
    for (power, want, spread) in [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0f64)] {
        let got = mean(&|i| x[i].powi(power));
        assert!((got - want).abs() < 5.0 * spread.sqrt() / root, "moment {power}: {got}");
    }
    for lag in 1..4 {
        let got = mean(&|i| x[i] * x[(i + lag) % n]);
        assert!(got.abs() < 5.0 / root, "lag {lag}: {got}");
    }
    // Φ(−1) and Φ(−3): fractions below.
    for (limit, want) in [(-1.0, 0.158_655_253_931_457_05), (-3.0, 0.001_349_898_031_630_094_6)] {
        let got = mean(&|i| f64::from(u8::from(x[i] < limit)));
        assert!((got - want).abs() < 5.0 * f64::sqrt(want * (1.0 - want)) / root, "below {limit}: {got}");
    }
    let u: Vec<f64> = {
        let mut d = Deviates::new(2);
        (0..n).map(|_| d.uniform()).collect()
    };
    assert!(u.iter().all(|u| *u > 0.0 && *u <= 1.0));
    assert!((mean(&|i| u[i]) - 0.5).abs() < 5.0 / (12.0f64.sqrt() * root));
}

#[test]
fn a_stream_goes_on_from_any_place_and_streams_differ() {
    let draw = |deviates: &mut Deviates, n: usize| {
        let mut x = vec![0.0; n];
        deviates.fill_normal(&mut x);
        x
    };
    let mut one = Deviates::new(7);
    let first = draw(&mut one, 13);
    let place = one.state();
    let next = draw(&mut one, 13);
    assert_eq!(draw(&mut Deviates::at(place), 13), next);
    assert_eq!(draw(&mut Deviates::new(7), 13), first);
    assert_ne!(draw(&mut Deviates::new(8), 13), first);
    assert_ne!(draw(&mut Deviates::stream(7, 1), 13), first);
}

/// ⟨v v*⟩ = kT M⁻¹ and ⟨p p*⟩ = kT M: every entry within five of its own deviations √((c_ii c_jj + c_ij²)/n).
#[test]
fn velocities_and_momenta_have_their_covariances() {
    for name in ["butane", "aladi"] {
        let torsion = torsion(name);
        let layout = torsion.layout();
        let q = torsion.model().random_state(3).q;
        let sweep = ArticulatedSweep::new(layout, &q).unwrap();
        let mut workspace = SolveWorkspace::new(layout);
        let mut deviates = Deviates::new(4);
        let nv = torsion.model().nv();
        let kt = BOLTZMANN * 300.0;
        let samples = 20_000;
        let (mut vv, mut pp) = (vec![0.0; nv * nv], vec![0.0; nv * nv]);
        let mut x = vec![0.0; nv];
        for _ in 0..samples {
            draw_velocities(layout, &sweep, 300.0, &mut deviates, &mut workspace, &mut x);
            (0..nv * nv).for_each(|i| vv[i] += x[i / nv] * x[i % nv]);
            draw_momenta(layout, &sweep, 300.0, &mut deviates, &mut workspace, &mut x);
            (0..nv * nv).for_each(|i| pp[i] += x[i / nv] * x[i % nv]);
        }
        for (what, sum, want) in [
            ("velocities", vv, mass_matrix_inverse(layout, &q).unwrap()),
            ("momenta", pp, mass_matrix(layout, &q).unwrap()),
        ] {
            for i in 0..nv * nv {
                let (a, b) = (want[(i / nv) * (nv + 1)], want[(i % nv) * (nv + 1)]);
                let spread = kt * ((a * b + want[i] * want[i]) / f64::from(samples)).sqrt();
                let error = sum[i] / f64::from(samples) - kt * want[i];
                assert!(error.abs() < 5.0 * spread, "{name}, {what}[{i}]: {error:e}, spread {spread:e}");
            }
        }
    }
}

/// ½ v·M v is kT/2 for each degree of freedom, and the same for the momenta of the same kind.
#[test]
fn kinetic_energy_is_that_of_the_temperature() {
    let torsion = torsion("met_enkephalin");
    let layout = torsion.layout();
    let q = torsion.model().neutral::<f64>();
    let sweep = ArticulatedSweep::new(layout, &q).unwrap();
    let mut workspace = SolveWorkspace::new(layout);
    let mut deviates = Deviates::new(11);
    let nv = torsion.degrees_of_freedom();
    let samples = 5000;
    let (mut x, mut sum) = (vec![0.0; nv], 0.0);
    for i in 0..samples {
        if i % 2 == 0 {
            draw_velocities(layout, &sweep, 310.0, &mut deviates, &mut workspace, &mut x);
        } else {
            draw_momenta(layout, &sweep, 310.0, &mut deviates, &mut workspace, &mut x);
            sweep.solve_in_place(layout, &mut x, &mut workspace);
        }
        let energy = kinetic_energy(layout, &q, &x).unwrap();
        let p = multiply_by_mass_matrix(layout, &q, &x).unwrap();
        let again = 0.5 * p.iter().zip(&x).map(|(p, v)| p * v).sum::<f64>();
        assert!((energy - again).abs() < 1e-12 * energy);
        sum += temperature(energy, nv);
    }
    let mean = sum / f64::from(samples);
    // χ² of nv·samples degrees of freedom.
    let spread = 310.0 * (2.0 / (nv as f64 * f64::from(samples))).sqrt();
    assert!((mean - 310.0).abs() < 5.0 * spread, "{mean} K, spread {spread} K");
}
