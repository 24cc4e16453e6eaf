//! Langevin, Nosé–Hoover and hybrid Monte Carlo against averages by quadrature and against each other; the conserved
//! quantities, continuation bit for bit, and what is refused.

use crate::common::molecule;
use crate::common::statistics::{check_mean, mean, p_value};
use allocation_counter::measure;
use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use phipsi_molecule::{
    BOLTZMANN, Bath, Clustering, Clusters, Ensemble, FixmanPotential, ForceField, MolecularForces,
    TorsionModel, WithFixman,
};
use phipsi_motion::{Conservative, Midpoint};
use phipsi_recursion::{ArticulatedSweep, DynamicsError, Layout, momentum};
use phipsi_reference::mass_matrix;
use std::f64::consts::TAU;
use std::sync::Arc;

const LANGEVIN: Ensemble = Ensemble::Langevin { friction: 1.0 };
const NOSE_HOOVER: Ensemble = Ensemble::NoseHoover { relaxation: 0.5 };
const MONTE_CARLO: Ensemble = Ensemble::HybridMonteCarlo { steps: 8 };

/// Three equal rods in a plane on a fixed base: ⟨cos 2q₃⟩ of the rigid model is −0.0701 without forces.
fn arm() -> Model {
    let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
    let names = ["first", "second", "third"];
    let mut builder = ModelBuilder::new("arm").gravity([0.0; 3]);
    for k in 0..3 {
        let joint = Joint::new(format!("hinge{k}"), JointKind::Continuous { axis: [0.0, 0.0, 1.0] });
        let (joint, parent) = match k {
            0 => (joint, "world"),
            _ => (joint.at(Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3])), names[k - 1]),
        };
        builder = builder.body(Body::new(names[k], rod)).joint(joint, parent, names[k]);
    }
    builder.build().unwrap()
}

/// A potential on the arm; `strength` 0 leaves it free.
fn potential(strength: f64) -> impl FnMut(&[f64], &mut [f64]) -> Result<f64, DynamicsError> {
    move |q, f| {
        f[0] = -strength * (q[0] - 0.4).sin();
        f[1] = -strength * (q[1] + 0.7).sin();
        f[2] = -2.0 * strength * (2.0 * q[2]).sin() - 0.5 * strength * (q[2] - q[1]).sin();
        f[1] += 0.5 * strength * (q[2] - q[1]).sin();
        Ok(strength
            * (-(q[0] - 0.4).cos() - (q[1] + 0.7).cos() - (2.0 * q[2]).cos() - 0.5 * (q[2] - q[1]).cos()))
    }
}

/// A function of the coordinates.
type Observable = fn(&[f64]) -> f64;

const OBSERVED: [(&str, Observable); 5] = [
    ("⟨cos q1⟩", |q| q[0].cos()),
    ("⟨cos q2⟩", |q| q[1].cos()),
    ("⟨sin q2⟩", |q| q[1].sin()),
    ("⟨cos 2q3⟩", |q| (2.0 * q[2]).cos()),
    ("⟨cos(q2 − q3)⟩", |q| (q[1] - q[2]).cos()),
];

/// Averages by the trapezoidal rule, with the dense mass matrix.
fn quadrature(model: &Model, kt: f64, strength: f64, fixman: bool) -> [f64; 5] {
    const N: usize = 32;
    let at = |i: usize| TAU * i as f64 / N as f64;
    let mut energy = potential(strength);
    let (mut sums, mut total) = ([0.0; 5], 0.0);
    for j in 0..N {
        for k in 0..N {
            let root =
                if fixman { 1.0 } else { mass_matrix(model, &[0.0, at(j), at(k)]).determinant().sqrt() };
            for i in 0..N {
                let q = [at(i), at(j), at(k)];
                let weight = root * (-energy(&q, &mut [0.0; 3]).unwrap() / kt).exp();
                total += weight;
                sums.iter_mut().zip(&OBSERVED).for_each(|(sum, (_, of))| *sum += weight * of(&q));
            }
        }
    }
    sums.map(|x| x / total)
}

/// Kinetic energies and configurations of a run of the arm at kT = 1.
fn run_arm(
    ensemble: Ensemble,
    (strength, fixman): (f64, bool),
    (h, thin, samples): (f64, usize, usize),
) -> (Vec<f64>, Vec<Vec<f64>>, Bath) {
    let model = arm();
    let mut own = potential(strength);
    let mut correction = FixmanPotential::new(&Layout::new(&model), 1.0);
    let mut system = WithFixman { inner: &mut own, fixman: fixman.then_some(&mut correction) };
    let q = [0.3, -0.4, 0.5];
    let mut method = Midpoint::new(&model, &mut system, 0.0, &q, &[0.0; 3]).unwrap();
    let mut bath = Bath::new(&mut method, ensemble, 1.0, 5).unwrap();
    let (mut kinetic, mut states) = (Vec::new(), Vec::new());
    for i in 0..(samples + 50) * thin {
        bath.advance(&mut method, &mut system, h, u64::MAX).unwrap();
        if i >= 50 * thin && i % thin == thin - 1 {
            kinetic.push(method.kinetic_energy().unwrap());
            states.push(method.state().q.clone());
        }
    }
    (kinetic, states, bath)
}

fn check_kinetic(what: &str, kinetic: &[f64], freedom: f64, kt: f64, bias: f64) {
    let half = 0.5 * freedom;
    check_mean(
        &format!("{what}: ⟨K⟩/kT"),
        &kinetic.iter().map(|k| k / kt).collect::<Vec<_>>(),
        half,
        bias * half,
    );
    let squares: Vec<f64> = kinetic.iter().map(|k| (k / kt).powi(2)).collect();
    check_mean(&format!("{what}: ⟨K²⟩/kT²"), &squares, half * (half + 1.0), 2.0 * bias * half * (half + 1.0));
}

/// A free arm samples √det M, with Fixman's potential the uniform distribution.
#[test]
fn an_arm_without_forces_has_its_marginals_with_and_without_fixman() {
    let model = arm();
    let exact = quadrature(&model, 1.0, 0.0, false)[3];
    println!("⟨cos 2q3⟩ by quadrature {exact:.5}");
    assert!((exact + 0.0701).abs() < 5e-5);
    for fixman in [false, true] {
        let (kinetic, states, bath) = run_arm(MONTE_CARLO, (0.0, fixman), (0.1, 1, 12_000));
        let x: Vec<f64> = states.iter().map(|q| (2.0 * q[2]).cos()).collect();
        let (want, wrong) = if fixman { (0.0, exact) } else { (exact, 0.0) };
        let (got, error) = check_mean("⟨cos 2q3⟩", &x, want, 0.0);
        assert!((got - wrong).abs() > 6.0 * error);
        check_kinetic("hmc", &kinetic, 3.0, 1.0, 0.0);
        // χ² of K on its own distribution √K e^(−K), every second value: K ends a trajectory that began independently.
        let thinned: Vec<f64> = kinetic.iter().step_by(2).map(|k| k.min(6.0)).collect();
        let p = p_value(&thinned, [0.0, 6.0], 12, |k| {
            // The last bin has the tail: ∫_{5.5}^∞ = 0.5 (…) spread over it.
            if k < 5.5 { k.sqrt() * (-k).exp() } else { tail() / 0.5 }
        });
        let trials = bath.trials();
        let weight = trials.mean_weight().unwrap();
        println!("p of K {p:.3}, acceptance {:.3}, ⟨exp(−ΔH/kT)⟩ {weight:.4}", trials.acceptance().unwrap());
        assert!(p > 1e-3);
        // The weights scatter by √⟨(e^(−ΔH) − 1)²⟩ < 1.
        assert!((weight - 1.0).abs() < 4.0 / (trials.made as f64).sqrt());
    }
}

/// ∫_{5.5}^∞ √K e^(−K) dK.
fn tail() -> f64 {
    crate::common::statistics::upper_gamma(1.5, 5.5) * 0.5 * std::f64::consts::PI.sqrt()
}

/// Averages of an arm in a potential, and moments of K, by all methods against the quadrature.
#[test]
fn all_methods_agree_with_the_quadrature_on_an_arm() {
    let model = arm();
    for fixman in [false, true] {
        let exact = quadrature(&model, 1.0, 1.0, fixman);
        for (ensemble, plan) in
            [(MONTE_CARLO, (0.1, 2, 6_000)), (LANGEVIN, (0.04, 16, 8_000)), (NOSE_HOOVER, (0.03, 20, 8_000))]
        {
            let (kinetic, states, _) = run_arm(ensemble, (1.0, fixman), plan);
            // Steps of 0.04 at frequencies up to 10: (hω)²/24 of the energies, not for Monte Carlo.
            let bias = if ensemble == MONTE_CARLO { 0.0 } else { 0.007 };
            for ((name, of), want) in OBSERVED.iter().zip(exact) {
                let x: Vec<f64> = states.iter().map(|q| of(q)).collect();
                check_mean(&format!("{}: {name}", ensemble.word()), &x, want, bias);
            }
            check_kinetic(ensemble.word(), &kinetic, 3.0, 1.0, bias);
        }
    }
}

/// A molecule in vacuum, thermalised by Monte Carlo.
fn start(name: &str, environment: &str, kelvin: f64) -> (MolecularForces<ForceField>, Vec<f64>, Vec<f64>) {
    let m = molecule(name, environment, "md");
    let clusters = Clusters::new(&m.atoms, &m.positions, &Clustering::default()).unwrap();
    let torsion = Arc::new(TorsionModel::new(&m.atoms, &m.positions, clusters).unwrap());
    let mut forces = MolecularForces::new(torsion.clone(), m.field);
    let (q, nv) = (torsion.model().neutral::<f64>(), torsion.model().nv());
    let mut method = Midpoint::new(torsion.model(), &mut forces, 0.0, &q, &vec![0.0; nv]).unwrap();
    let ensemble = Ensemble::HybridMonteCarlo { steps: 20 };
    let mut bath = Bath::new(&mut method, ensemble, BOLTZMANN * kelvin, 1).unwrap();
    for _ in 0..30 {
        bath.advance(&mut method, &mut forces, 0.004, 20).unwrap();
    }
    let v = method.velocity().unwrap().to_vec();
    (forces, method.state().q.clone(), v)
}

/// Butane at 1000 K: averages over its three torsions by quadrature, without and with Fixman's potential, by all methods; and
/// the base, which Nosé–Hoover couples by a chain of its own.
#[test]
fn all_methods_agree_with_the_quadrature_on_butane() {
    const KELVIN: f64 = 1000.0;
    const N: usize = 24;
    let kt = BOLTZMANN * KELVIN;
    let (mut forces, q0, v0) = start("butane", "charmm36", KELVIN);
    let torsion = forces.torsion().clone();
    let (model, layout) = (torsion.model().clone(), torsion.layout());
    let places: Vec<usize> = (0..3)
        .map(|h| model.q_offset(model.find_joint(layout.joint_of_velocity(torsion.hinge_dof(h)).0).unwrap()))
        .collect();
    // The middle hinge is that of the backbone.
    let backbone = places[1];
    for fixman in [false, true] {
        let (mut q, mut f) = (q0.clone(), vec![0.0; model.nv()]);
        let (mut total, mut energy, mut cosine) = (0.0, 0.0, 0.0);
        let least = -10.0;
        for i in 0..N * N * N {
            for (place, k) in places.iter().zip([i % N, i / N % N, i / N / N]) {
                q[*place] = TAU * k as f64 / N as f64;
            }
            let u = forces.evaluate(&q, &mut f).unwrap();
            let ln = if fixman { 0.0 } else { ArticulatedSweep::new(layout, &q).unwrap().log_determinant() };
            let weight = (0.5 * ln - (u - least) / kt).exp();
            total += weight;
            energy += weight * u;
            cosine += weight * q[backbone].cos();
        }
        let (energy, cosine) = (energy / total, cosine / total);
        for ensemble in [
            Ensemble::HybridMonteCarlo { steps: 8 },
            Ensemble::Langevin { friction: 5.0 },
            Ensemble::NoseHoover { relaxation: 0.1 },
        ] {
            let mut correction = FixmanPotential::new(layout, kt);
            let mut system = WithFixman { inner: &mut forces, fixman: fixman.then_some(&mut correction) };
            let mut method = Midpoint::new(&model, &mut system, 0.0, &q0, &v0).unwrap();
            let mut bath = Bath::new(&mut method, ensemble, kt, 2).unwrap();
            let freedom = bath.degrees_of_freedom();
            assert_eq!(freedom, if ensemble.word() == "nose_hoover" { 6 } else { 9 });
            let (mut kinetic, mut potential, mut angle) = (Vec::new(), Vec::new(), Vec::new());
            for i in 0..6000 {
                for _ in 0..if ensemble.stride() > 1 { 1 } else { 8 } {
                    bath.advance(&mut method, &mut system, 0.008, 8).unwrap();
                }
                if i >= 200 {
                    kinetic.push(method.kinetic_energy().unwrap());
                    let q = &method.state().q;
                    angle.push(q[backbone].cos());
                    potential.push(system.inner.evaluate(q, &mut f).unwrap());
                }
            }
            let what = ensemble.word();
            let bias = if ensemble.stride() > 1 { 0.0 } else { 0.01 };
            check_kinetic(what, &kinetic, freedom as f64, kt, bias);
            check_mean(&format!("{what}: ⟨U⟩"), &potential, energy, bias * kt);
            check_mean(&format!("{what}: ⟨cos φ⟩"), &angle, cosine, bias);
        }
    }
}

/// ⟨e^(−ΔE'/kT)⟩ = 1 for the change of E' = K + U − heat in any number of steps from the canonical distribution: noise and
/// friction are reversible by themselves, and the step keeps volumes. A wrong heat, noise or Jacobian would show.
#[test]
fn langevin_steps_leave_the_canonical_distribution_invariant_up_to_their_work() {
    let model = arm();
    let mut system = potential(1.0);
    let mut method = Midpoint::new(&model, &mut system, 0.0, &[0.3, -0.4, 0.5], &[0.0; 3]).unwrap();
    let mut exact = Bath::new(&mut method, MONTE_CARLO, 1.0, 5).unwrap();
    let (mut weights, mut reweighted, mut refused) = (Vec::new(), Vec::new(), 0);
    let want = quadrature(&model, 1.0, 1.0, false)[1];
    for seed in 0..4000 {
        exact.advance(&mut method, &mut system, 0.1, 8).unwrap();
        let begin = method.state().clone();
        let e0 = method.kinetic_energy().unwrap() + begin.potential;
        let ensemble = Ensemble::Langevin { friction: 3.0 };
        let mut bath = Bath::new(&mut method, ensemble, 1.0, 1000 + seed).unwrap();
        for _ in 0..5 {
            // Steps large enough for their work to be felt, and for drifts to be refused.
            bath.advance(&mut method, &mut system, 0.12, 1).unwrap();
        }
        refused += bath.trials().refused;
        let e1 = method.kinetic_energy().unwrap() + method.state().potential - bath.heat();
        weights.push((e0 - e1).exp());
        reweighted.push((e0 - e1).exp() * (method.state().q[1].cos() - want));
        method.reset(&begin).unwrap();
    }
    println!("{refused} drifts of {} refused", 5 * weights.len());
    assert!(refused > 100);
    let spread = mean(&weights.iter().map(|w| (w - 1.0).powi(2)).collect::<Vec<_>>()).0.sqrt();
    println!("weights scatter by {spread:.3}");
    assert!(spread > 0.02);
    check_mean("⟨exp(−ΔE'/kT)⟩", &weights, 1.0, 0.002);
    check_mean("⟨exp(−ΔE'/kT) (cos q2 − exact)⟩", &reweighted, 0.0, 0.002);
}

/// E − heat is kept to second order in the step by Langevin dynamics and by Nosé–Hoover chains.
#[test]
fn conserved_quantities_are_of_second_order() {
    let (mut forces, q, v) = start("aladi", "vacuum", 300.0);
    let torsion = forces.torsion().clone();
    for ensemble in [Ensemble::Langevin { friction: 2.0 }, Ensemble::NoseHoover { relaxation: 0.1 }] {
        let mut noise = |femtoseconds: f64| {
            let mut method = Midpoint::new(torsion.model(), &mut forces, 0.0, &q, &v).unwrap();
            let mut bath = Bath::new(&mut method, ensemble, BOLTZMANN * 300.0, 7).unwrap();
            let steps = (4000.0 / femtoseconds) as usize;
            let mut energies = Vec::new();
            for _ in 0..steps {
                bath.advance(&mut method, &mut forces, femtoseconds * 1e-3, 1).unwrap();
                energies.push(method.kinetic_energy().unwrap() + method.state().potential - bath.heat());
            }
            let mean = energies.iter().sum::<f64>() / steps as f64;
            (energies.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / steps as f64).sqrt()
        };
        let (fine, coarse) = (noise(1.0), noise(4.0));
        let order = (coarse / fine).log2() / 2.0;
        println!("{}: noise {fine:.5}, {coarse:.5} kJ/mol, order {order:.2}", ensemble.word());
        // Different noise realisations at the two steps: the order is that of two sample deviations.
        assert!((order - 2.0).abs() < 0.4, "{order}");
    }
}

/// Nosé–Hoover: no momentum, and three degrees of freedom less.
#[test]
fn nose_hoover_removes_the_common_momentum() {
    for name in ["aladi_x2", "aladi_water_ions"] {
        let (mut forces, q, v) = start(name, "vacuum", 300.0);
        let torsion = forces.torsion().clone();
        let mut method = Midpoint::new(torsion.model(), &mut forces, 0.0, &q, &v).unwrap();
        let linear = |method: &mut Midpoint| {
            let v = method.velocity().unwrap().to_vec();
            momentum(torsion.layout(), &method.state().q, &v, phipsi_recursion::About::CenterOfMass)
                .unwrap()
                .force
                .norm()
        };
        let before = linear(&mut method);
        let energy = method.kinetic_energy().unwrap();
        let ensemble = Ensemble::NoseHoover { relaxation: 0.1 };
        let mut bath = Bath::new(&mut method, ensemble, BOLTZMANN * 300.0, 7).unwrap();
        let mass = torsion.atoms().masses.iter().sum::<f64>();
        let gone = energy - method.kinetic_energy().unwrap();
        assert!((gone - 0.5 * before * before / mass).abs() < 1e-12 * energy);
        assert_eq!(bath.degrees_of_freedom(), torsion.degrees_of_freedom() - 3);
        for _ in 0..200 {
            bath.advance(&mut method, &mut forces, 0.004, 1).unwrap();
        }
        let after = linear(&mut method);
        println!("{name}: momentum {before:.2e} before, {after:.2e} Da nm/ps after 200 steps");
        // Rounding of 200 steps on the scale of one molecule's momentum.
        assert!(before > 1.0 && after < 1e-11 * before, "{before:e} {after:e}");
    }
}

/// A run that is interrupted and continued from its states is the same run to the last bit, in every ensemble.
#[test]
fn runs_continue_bit_for_bit_and_do_not_allocate() {
    let (mut forces, q, v) = start("aladi", "vacuum", 300.0);
    let torsion = forces.torsion().clone();
    let kt = BOLTZMANN * 300.0;
    for ensemble in [
        Ensemble::ConstantEnergy,
        Ensemble::Langevin { friction: 2.0 },
        Ensemble::NoseHoover { relaxation: 0.1 },
        Ensemble::HybridMonteCarlo { steps: 3 },
    ] {
        let mut correction = FixmanPotential::new(torsion.layout(), kt);
        let mut system = WithFixman { inner: &mut forces, fixman: Some(&mut correction) };
        let mut method = Midpoint::new(torsion.model(), &mut system, 0.0, &q, &v).unwrap();
        let mut bath = Bath::new(&mut method, ensemble, kt, 7).unwrap();
        let mut advance = |method: &mut Midpoint, bath: &mut Bath, n: usize| {
            for _ in 0..n {
                bath.advance(method, &mut system, 0.02, 3).unwrap();
            }
        };
        advance(&mut method, &mut bath, 30);
        let (state, kept) = (method.state().clone(), bath.state());
        let count = measure(|| advance(&mut method, &mut bath, 30));
        assert_eq!(count.count_total, 0, "{}", ensemble.word());
        let mut other = Midpoint::new(torsion.model(), &mut forces, 0.0, &q, &v).unwrap();
        let mut other_bath = Bath::new(&mut other, ensemble, kt, 999).unwrap();
        other.restore(state).unwrap();
        other_bath.restore(&kept);
        let mut correction = FixmanPotential::new(torsion.layout(), kt);
        let mut system = WithFixman { inner: &mut forces, fixman: Some(&mut correction) };
        for _ in 0..30 {
            other_bath.advance(&mut other, &mut system, 0.02, 3).unwrap();
        }
        assert_eq!(method.state(), other.state(), "{}", ensemble.word());
        assert_eq!(bath.state(), other_bath.state(), "{}", ensemble.word());
    }
}

/// Force and energy of U_F on a molecule: central differences, and the dense determinant.
#[test]
fn fixmans_force_is_the_gradient_of_the_dense_determinant() {
    let (forces, q, _) = start("aladi", "vacuum", 300.0);
    let torsion = forces.torsion();
    let model = torsion.model();
    let dense = |q: &[f64]| {
        let m = mass_matrix(model, q);
        // In place of the determinant its logarithm: the product of 13 inertias spans many decades.
        nalgebra::linalg::Cholesky::new(m).unwrap().l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>()
    };
    let kt = 2.5;
    let mut force = vec![0.0; model.nv()];
    let energy = FixmanPotential::new(torsion.layout(), kt).evaluate(&q, &mut force).unwrap();
    assert!((energy - kt * dense(&q)).abs() < 1e-10, "{energy} {}", kt * dense(&q));
    const STEP: f64 = 1e-4;
    for i in 0..model.nv() {
        let at = |x: f64| {
            let (mut v, mut to) = (vec![0.0; model.nv()], q.clone());
            v[i] = x;
            model.integrate_into(&q, &v, &mut to);
            kt * dense(&to)
        };
        let slope = (at(STEP) - at(-STEP)) / (2.0 * STEP);
        // Differences: h² of a third derivative of size one, and 1e-12 of ln det/h.
        assert!((slope + force[i]).abs() < 1e-7, "{i}: {slope} {}", force[i]);
    }
}

/// 100 steps of 12 fs with Fixman's potential, there and back.
#[test]
fn steps_with_fixmans_potential_are_reversible() {
    let (mut forces, q, v) = start("aladi", "vacuum", 300.0);
    let torsion = forces.torsion().clone();
    let mut correction = FixmanPotential::new(torsion.layout(), BOLTZMANN * 300.0);
    let mut system = WithFixman { inner: &mut forces, fixman: Some(&mut correction) };
    let mut method = Midpoint::new(torsion.model(), &mut system, 0.0, &q, &v).unwrap();
    for _ in 0..100 {
        method.step(&mut system, 0.012).unwrap();
    }
    let reversed: Vec<f64> = method.state().p.iter().map(|p| -p).collect();
    method.set_momenta(&reversed).unwrap();
    for _ in 0..100 {
        method.step(&mut system, 0.012).unwrap();
    }
    let (from, to) = (torsion.positions(&q).unwrap(), torsion.positions(&method.state().q).unwrap());
    let away = from.iter().zip(&to).fold(0.0f64, |m, (a, b)| m.max((*a - *b).norm()));
    println!("back within {away:.1e} nm");
    assert!(away < 1e-12, "{away:e}");
}

/// Acceptance of alanine dipeptide with trajectories of 50 and 60 fs.
#[test]
fn alanine_dipeptide_accepts_large_steps() {
    let (mut forces, q, v) = start("aladi", "vacuum", 300.0);
    let torsion = forces.torsion().clone();
    for (femtoseconds, steps, least) in [(10.0, 5, 0.95), (20.0, 3, 0.85)] {
        let mut method = Midpoint::new(torsion.model(), &mut forces, 0.0, &q, &v).unwrap();
        let ensemble = Ensemble::HybridMonteCarlo { steps };
        let mut bath = Bath::new(&mut method, ensemble, BOLTZMANN * 300.0, 3).unwrap();
        for _ in 0..1500 {
            bath.advance(&mut method, &mut forces, femtoseconds * 1e-3, steps).unwrap();
        }
        let acceptance = bath.trials().acceptance().unwrap();
        println!("{femtoseconds} fs: {acceptance:.3}, {:?}", bath.trials());
        assert!(acceptance >= least, "{acceptance}");
        assert_eq!(method.state().steps, 1500 * steps);
    }
}

/// Steps that cannot be made: Monte Carlo refuses and stays, the others stop with everything as before.
#[test]
fn failures_leave_the_last_state() {
    let model = arm();
    let mut own = potential(1.0);
    let mut wall = |q: &[f64], f: &mut [f64]| {
        let u = own(q, f)?;
        Ok::<f64, DynamicsError>(if q[1] > 0.5 { f64::INFINITY } else { u })
    };
    for ensemble in [LANGEVIN, NOSE_HOOVER, MONTE_CARLO] {
        let mut method = Midpoint::new(&model, &mut wall, 0.0, &[0.3, 0.3, 0.5], &[0.0, 0.5, 0.0]).unwrap();
        let mut bath = Bath::new(&mut method, ensemble, 1.0, 4).unwrap();
        let mut stopped = false;
        for _ in 0..300 {
            let (state, kept) = (method.state().clone(), bath.state());
            if bath.advance(&mut method, &mut wall, 0.1, 8).is_err() {
                assert_eq!((method.state(), &bath.state()), (&state, &kept));
                stopped = true;
                break;
            }
        }
        assert_eq!(stopped, ensemble != MONTE_CARLO, "{}", ensemble.word());
        if ensemble == MONTE_CARLO {
            let trials = bath.trials();
            assert!(trials.refused > 10 && trials.accepted > 100, "{trials:?}");
            assert!(method.state().q[1] <= 0.5);
        }
    }
}

#[test]
fn wrong_parameters_are_named() {
    let model = arm();
    let mut method = Midpoint::new(&model, &mut potential(0.0), 0.0, &[0.0; 3], &[0.0; 3]).unwrap();
    for (ensemble, kt, place) in [
        (Ensemble::Langevin { friction: -1.0 }, 1.0, "friction"),
        (Ensemble::Langevin { friction: f64::NAN }, 1.0, "friction"),
        (Ensemble::NoseHoover { relaxation: 0.0 }, 1.0, "relaxation"),
        (Ensemble::HybridMonteCarlo { steps: 0 }, 1.0, "trajectory"),
        (LANGEVIN, 0.0, "temperature"),
        (MONTE_CARLO, f64::INFINITY, "temperature"),
    ] {
        let error = Bath::new(&mut method, ensemble, kt, 1).unwrap_err();
        assert_eq!(error.place, place);
    }
    assert!(Bath::new(&mut method, Ensemble::ConstantEnergy, 0.0, 1).is_ok());
}
