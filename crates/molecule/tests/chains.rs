//! Chains of beads whose distributions are known in closed form, with Fixman's potential and without, by hybrid Monte Carlo.
//!
//! | chain | rigid | stiff limit |
//! |---|---|---|
//! | four beads, rigid bonds and angles: torsion φ | √(P Q) | uniform |
//! | rigid bonds only: angles θ_i | Π sin θ_i √det H, H the tridiagonal matrix of the constraints | Π sin θ_i |
//!
//! Formulas: data on constrained chains (derivation there). A rod of two beads has no inertia about itself; it is given one,
//! which multiplies det M by a constant, so that ball joints can carry the chain.

use crate::common::chains::*;
use crate::common::statistics::{check_mean, correlation, p_value};
use phipsi_model::Model;
use phipsi_molecule::FixmanPotential;
use phipsi_recursion::{ArticulatedSweep, Layout};
use std::f64::consts::PI;
use std::path::Path;

/// ½ kT ln det M is −kT ln of the closed forms, up to a constant.
#[test]
fn the_potential_is_that_of_the_closed_forms() {
    let spread = |x: &[f64]| {
        let largest = x.iter().fold(f64::NEG_INFINITY, |m, x| m.max(*x));
        largest - x.iter().fold(f64::INFINITY, |m, x| m.min(*x))
    };
    for (end, middle, degrees) in [(1.0, 1.0, 90.0), (15.035, 14.027, 112.0), (3.0, 17.0, 75.0f64)] {
        let theta = degrees.to_radians();
        let torsion = rotating(&[end, middle, middle, end], 0.15, theta);
        let mut q = torsion.model().neutral::<f64>();
        let i = torsion.model().nq() - 1;
        let mut fixman = FixmanPotential::new(torsion.layout(), 1.0);
        let differences: Vec<f64> = (0..24)
            .map(|k| {
                q[i] = f64::from(k) * PI / 12.0;
                let own = fixman.evaluate(&q, &mut vec![0.0; torsion.model().nv()]).unwrap();
                own - rigid_torsion(end, middle, theta.cos(), PI + q[i]).ln()
            })
            .collect();
        // ln det M of 7 factors whose sizes are 1 … 1e-2, and a closed form of ten terms.
        assert!(spread(&differences) < 200.0 * f64::EPSILON, "{differences:?}");
    }
    let masses = [15.0, 3.0, 20.0, 1.0, 7.0, 15.0];
    let model = jointed(&masses);
    let layout = Layout::new(&model);
    let mut fixman = FixmanPotential::new(&layout, 1.0);
    let differences: Vec<f64> = (0..50)
        .map(|seed| {
            let q = model.random_state(seed).q;
            let own = fixman.evaluate(&q, &mut vec![0.0; model.nv()]).unwrap();
            own - root_of_constraints(&masses, &cosines(&model, &q)).ln()
        })
        .collect();
    // 18 factors.
    assert!(spread(&differences) < 400.0 * f64::EPSILON, "{}", spread(&differences));
}

/// ½ ln(det M/det M(trans, trans)) of five beads with rigid angles: a table of 25 × 25 torsions with ten decimals.
#[test]
fn the_pentamer_has_its_tabulated_potential() {
    let table = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../validation/data/molecules/constrained_chains/pentamer_fixed_angles_half_lndetM.csv");
    let text = std::fs::read_to_string(table).unwrap();
    let torsion = rotating(&[1.0; 5], 1.0, (-1.0f64 / 3.0).acos());
    let (model, layout) = (torsion.model(), torsion.layout());
    let hinge = |h: usize| {
        let name = layout.joint_of_velocity(torsion.hinge_dof(h)).0;
        model.q_offset(model.find_joint(name).unwrap())
    };
    let at = |a: f64, b: f64| {
        let mut q = model.neutral::<f64>();
        // The table counts from cis, and begins at −180°.
        (q[hinge(0)], q[hinge(1)]) = (a.to_radians(), b.to_radians());
        0.5 * ArticulatedSweep::new(layout, &q).unwrap().log_determinant()
    };
    let zero = at(0.0, 0.0);
    let mut compared = 0;
    for (i, line) in text.lines().filter(|l| !l.starts_with('#')).enumerate() {
        for (j, entry) in line.split(',').enumerate() {
            let want: f64 = entry.parse().unwrap();
            let got = at(15.0 * i as f64, 15.0 * j as f64) - zero;
            // The table's decimals, and the finite differences by which it was made.
            assert!((got - want).abs() < 1e-9, "{i} {j}: {got} {want}");
            compared += 1;
        }
    }
    assert_eq!(compared, 625);
}

/// χ² of samples against the right density and the wrong one.
fn judge(what: &str, x: &[f64], range: [f64; 2], bins: usize, [right, wrong]: [&dyn Fn(f64) -> f64; 2]) {
    let (p, q) = (p_value(x, range, bins, right), p_value(x, range, bins, wrong));
    println!("{what}: p = {p:.3}, against the other density {q:.1e}, {} samples", x.len());
    assert!(p > 1e-3 && q < 1e-6, "{what}: {p:e}, {q:e}");
}

/// Of independent samples: 1/√n.
fn check_independence(what: &str, x: &[f64]) {
    let lag = correlation(x, 1);
    println!("{what}: correlation from one sample to the next {lag:.4}");
    assert!(lag.abs() < 4.0 / (x.len() as f64).sqrt(), "{what}: {lag}");
}

fn draw(model: &Model, fixman: bool, plan: (f64, u64, usize), samples: usize, measure: impl FnMut(&[f64])) {
    let trials = sample(model, fixman, plan, samples, 1, measure);
    let (acceptance, weight) = (trials.acceptance().unwrap(), trials.mean_weight().unwrap());
    let refused = trials.refused;
    println!("acceptance {acceptance:.3}, ⟨exp(−ΔH/kT)⟩ {weight:.4}, refused {refused} of {}", trials.made);
}

#[test]
fn a_freely_rotating_chain_has_its_two_distributions() {
    let torsion = rotating(&[15.0; 4], 0.15, (-1.0f64 / 3.0).acos());
    let i = torsion.model().nq() - 1;
    let uniform = |_: f64| 1.0;
    let rigid = |phi: f64| rigid_torsion(15.0, 15.0, -1.0 / 3.0, phi);
    for fixman in [false, true] {
        let mut phi = Vec::new();
        draw(torsion.model(), fixman, (0.05, 10, 6), 6_000, |q| phi.push((PI + q[i]).rem_euclid(2.0 * PI)));
        let of = |k: f64| phi.iter().map(|x| (k * x).cos()).collect::<Vec<_>>();
        check_independence("cos φ", &of(1.0));
        check_independence("cos 2φ", &of(2.0));
        let densities: [&dyn Fn(f64) -> f64; 2] =
            if fixman { [&uniform, &rigid] } else { [&rigid, &uniform] };
        let name = if fixman { "stiff limit" } else { "rigid" };
        judge(&format!("torsion, {name}"), &phi, [0.0, 2.0 * PI], 16, densities);
        check_mean("⟨cos φ⟩", &of(1.0), if fixman { 0.0 } else { -0.025_611_1 }, 0.0);
        check_mean("⟨cos 2φ⟩", &of(2.0), if fixman { 0.0 } else { -0.074_370_5 }, 0.0);
    }
}

/// Light beads between heavy ones: there the two densities differ most.
#[test]
fn freely_jointed_chains_have_their_two_distributions() {
    for (masses, plan) in
        [(&[60.0, 12.0, 60.0][..], (0.04, 10, 6)), (&[60.0, 12.0, 60.0, 12.0, 60.0], (0.04, 10, 6))]
    {
        let model = jointed(masses);
        let marginal = first_angle(masses);
        for fixman in [false, true] {
            let mut u = Vec::new();
            draw(&model, fixman, plan, 3_000, |q| u.push(cosines(&model, q)[0]));
            let squares: Vec<f64> = u.iter().map(|u| u * u).collect();
            check_independence("cos θ", &u);
            check_independence("cos² θ", &squares);
            let uniform = |_: f64| 1.0;
            let densities: [&dyn Fn(f64) -> f64; 2] =
                if fixman { [&uniform, &marginal] } else { [&marginal, &uniform] };
            let name = if fixman { "stiff limit" } else { "rigid" };
            judge(&format!("{} beads, {name}", masses.len()), &u, [-1.0, 1.0], 10, densities);
        }
    }
}
