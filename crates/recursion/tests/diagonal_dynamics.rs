//! Dynamics in diagonal velocities: against dense factors and dual numbers, by their identities, and along a motion.

use crate::common::{growth, scaled_condition, seeds, wide_wrenches};
use phipsi_model::Model;
use phipsi_recursion::{
    ArticulatedSweep, DiagonalDynamics, DiagonalVelocity, Layout, diagonal_coriolis, diagonal_dynamics,
    diagonal_velocity, forward_dynamics, joint_velocity, kinetic_energy,
};
use phipsi_reference as slow;
use phipsi_reference::generate::{Case, case};
use phipsi_reference::sensitivity::widened;
use phipsi_spatial::{Dd, Real, Scalar};

const TREES: u64 = 300;

const KINDS: [DiagonalVelocity; 2] = [DiagonalVelocity::Plain, DiagonalVelocity::Normalized];

/// What terms of a case reach in units of a component: products of speeds, times what the filter may lose.
fn terms(case: &Case) -> f64 {
    let speed: f64 = case.v.iter().map(|v| v.abs()).sum();
    growth(case) * scaled_condition(case) * (1.0 + speed * speed)
}

fn largest(x: &[Dd]) -> f64 {
    x.iter().fold(1e-3, |m: f64, x| m.max(x.hi.abs()))
}

fn assert_close(what: &str, seed: u64, got: &[Dd], want: &[Dd], allowed: f64) -> f64 {
    let mut worst = 0.0f64;
    for (i, (g, w)) in got.iter().zip(want).enumerate() {
        let error = (*g - *w).abs().to_f64();
        assert!(error <= allowed, "{what}[{i}], PHIPSI_SEED={seed}: {} instead of {}, {error:e}", g.hi, w.hi);
        worst = worst.max(error / allowed);
    }
    assert_eq!(got.len(), want.len());
    worst
}

/// η, C_D and Ḋ against dense factors and their derivatives by dual numbers: thirty digits.
#[test]
fn diagonal_velocities_and_their_coriolis_forces() {
    let mut worst = 0.0f64;
    for seed in seeds(TREES) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let (q, v) = (widened(&case.q), widened(&case.v));
        let plain = DiagonalVelocity::Plain;
        let eta = diagonal_velocity(&layout, &q, &v, plain).unwrap();
        let want = slow::diagonal_velocity(&case.model, &q, &v).unwrap();
        worst = worst.max(assert_close("η", seed, &eta, &want, 1e-29 * largest(&want) * terms(&case)));
        let coriolis = diagonal_coriolis(&layout, &q, &eta, plain).unwrap();
        let want = slow::diagonal_coriolis(&case.model, &q, &v).unwrap();
        let d = slow::articulated_joint_inertias(&case.model, &q).unwrap();
        let size = largest(&want) + largest(&d) * largest(&eta).powi(2);
        worst = worst.max(assert_close("C_D", seed, &coriolis, &want, 1e-29 * size * terms(&case)));
        // Normalised: C_ν = D^(−½) (C_D − ½ Ḋ η).
        let rates = slow::joint_inertia_rates(&case.model, &q, &v).unwrap();
        let nu = diagonal_velocity(&layout, &q, &v, DiagonalVelocity::Normalized).unwrap();
        let normalized = diagonal_coriolis(&layout, &q, &nu, DiagonalVelocity::Normalized).unwrap();
        for i in 0..nu.len() {
            let half = rates[i] * eta[i] * Dd::from_f64(0.5);
            let want = (want[i] - half) / d[i].sqrt();
            let allowed = 1e-29 * size * terms(&case) * (1.0 + d[i].sqrt().recip().hi);
            assert_close("C_ν", seed, &normalized[i..=i], &[want], allowed);
            assert_close("ν", seed, &nu[i..=i], &[eta[i] * d[i].sqrt()], allowed);
        }
    }
    println!("largest part of the budget: {worst:e}");
}

/// In f64, by n·ε of the largest terms.
#[test]
fn diagonal_dynamics_in_f64() {
    for seed in seeds(TREES) {
        let case = case(seed);
        let (narrow, layout) = (Layout::<f64>::new(&case.model), Layout::<Dd>::new(&case.model));
        let wrenches = Some(&case.wrenches[..]);
        for kind in KINDS {
            let diagonal = diagonal_velocity(&narrow, &case.q, &case.v, kind).unwrap();
            let (v, rate) =
                diagonal_dynamics(&narrow, &case.q, &diagonal, &case.tau, wrenches, kind).unwrap();
            let wide = widened(&diagonal);
            let (want_v, want_rate) = diagonal_dynamics(
                &layout,
                &widened(&case.q),
                &wide,
                &widened(&case.tau),
                Some(&wide_wrenches(&case)),
                kind,
            )
            .unwrap();
            let unit = crate::common::FACTOR * crate::common::steps(&case) * f64::EPSILON * terms(&case);
            assert_close("v", seed, &widened(&v), &want_v, unit * largest(&want_v));
            let size = largest(&want_rate) + largest(&wide).powi(2);
            assert_close("rate", seed, &widened(&rate), &want_rate, unit * size);
        }
    }
}

/// The two maps undo each other, and the energy is ½ η* D η = ½ ν* ν.
#[test]
fn diagonal_velocities_carry_the_kinetic_energy() {
    for seed in seeds(TREES) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let (q, v) = (widened(&case.q), widened(&case.v));
        for kind in KINDS {
            let diagonal = diagonal_velocity(&layout, &q, &v, kind).unwrap();
            let back = joint_velocity(&layout, &q, &diagonal, kind).unwrap();
            assert_close("v", seed, &back, &v, 1e-28 * largest(&v) * growth(&case) * scaled_condition(&case));
        }
        let nu = diagonal_velocity(&layout, &q, &v, DiagonalVelocity::Normalized).unwrap();
        let energy = nu.iter().fold(Dd::from_f64(0.0), |sum, x| sum + *x * *x) * Dd::from_f64(0.5);
        let want = kinetic_energy(&layout, &q, &v).unwrap();
        let error = (energy - want).hi.abs() / want.hi;
        assert!(error < 1e-28 * growth(&case), "PHIPSI_SEED={seed}: {error:e}");
    }
}

/// ν* C_ν = 0, and η* C_D = ½ η* Ḋ η with Ḋ by dual numbers.
#[test]
fn normalized_coriolis_forces_do_no_work() {
    let mut worst = 0.0f64;
    for seed in seeds(TREES) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let (q, v) = (widened(&case.q), widened(&case.v));
        let zero = Dd::from_f64(0.0);
        // Where a mechanism has no Coriolis forces, the terms that cancel have the size of its power.
        let speed: f64 = case.v.iter().map(|v| v.abs()).sum();
        let floor = kinetic_energy(&layout, &q, &v).unwrap().hi * speed;
        let nu = diagonal_velocity(&layout, &q, &v, DiagonalVelocity::Normalized).unwrap();
        let coriolis = diagonal_coriolis(&layout, &q, &nu, DiagonalVelocity::Normalized).unwrap();
        let power = nu.iter().zip(&coriolis).fold(zero, |sum, (x, c)| sum + *x * *c).hi.abs();
        let size: f64 = nu.iter().zip(&coriolis).map(|(x, c)| (x.hi * c.hi).abs()).sum();
        let allowed = 1e-29 * (size + floor) * terms(&case);
        worst = worst.max(power / allowed);
        assert!(power <= allowed, "ν* C_ν, PHIPSI_SEED={seed}: {power:e} of {size:e}");
        let eta = diagonal_velocity(&layout, &q, &v, DiagonalVelocity::Plain).unwrap();
        let coriolis = diagonal_coriolis(&layout, &q, &eta, DiagonalVelocity::Plain).unwrap();
        let rates = slow::joint_inertia_rates(&case.model, &q, &v).unwrap();
        let mut power = zero;
        let mut size = floor;
        for i in 0..eta.len() {
            let half = Dd::from_f64(0.5) * rates[i] * eta[i] * eta[i];
            power += eta[i] * coriolis[i] - half;
            size += (eta[i].hi * coriolis[i].hi).abs() + half.hi.abs();
        }
        let power = power.hi.abs();
        assert!(power <= 1e-29 * size * terms(&case), "η* C_D, PHIPSI_SEED={seed}: {power:e} of {size:e}");
    }
    println!("largest part of the budget: {worst:e}");
}

/// The rate of η along the motion that ordinary forward dynamics gives, by differences in double-double numbers.
#[test]
fn rates_are_those_of_ordinary_forward_dynamics() {
    const STEP: f64 = 1e-12;
    for seed in seeds(100) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let (mut q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
        case.model.normalize(&mut q);
        let wrenches = wide_wrenches(&case);
        let a = forward_dynamics(&layout, &q, &v, &tau, Some(&wrenches)).unwrap();
        for kind in KINDS {
            let at = |sign: f64| {
                let (h, half) = (Dd::from_f64(sign * STEP), Dd::from_f64(0.5 * STEP * STEP));
                let x: Vec<Dd> = v.iter().zip(&a).map(|(v, a)| *v * h + *a * half).collect();
                let v: Vec<Dd> = v.iter().zip(&a).map(|(v, a)| *v + *a * h).collect();
                diagonal_velocity(&layout, &case.model.integrate(&q, &x), &v, kind).unwrap()
            };
            let (after, before) = (at(1.0), at(-1.0));
            let diagonal = diagonal_velocity(&layout, &q, &v, kind).unwrap();
            let (back, rate) =
                diagonal_dynamics(&layout, &q, &diagonal, &tau, Some(&wrenches), kind).unwrap();
            assert_close("v", seed, &back, &v, 1e-28 * largest(&v) * growth(&case) * scaled_condition(&case));
            let difference: Vec<Dd> =
                after.iter().zip(&before).map(|(x, y)| (*x - *y) / Dd::from_f64(2.0 * STEP)).collect();
            // Third derivatives times the square of the step, and thirty digits over the step.
            let rates = 1.0 + largest(&v) + largest(&a);
            let allowed = 1e-17 * terms(&case) * rates * (largest(&diagonal) + largest(&rate));
            assert_close("rate", seed, &rate, &difference, allowed);
        }
    }
}

/// Classical Runge–Kutta steps of (q, x) with q moving along `Model::integrate`, in the chart of the step's beginning.
fn simulate(
    model: &Model,
    (q0, x0): (&[f64], &[f64]),
    steps: usize,
    mut rates: impl FnMut(&[f64], &[f64]) -> (Vec<f64>, Vec<f64>),
) -> (Vec<f64>, Vec<f64>) {
    let h = 0.5 / steps as f64;
    let (mut q, mut x) = (q0.to_vec(), x0.to_vec());
    for _ in 0..steps {
        let mut increments: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
        for (part, weight) in [(0, 0.0), (0, 0.5), (1, 0.5), (2, 1.0)] {
            let (mut dq, mut dx) = (vec![0.0; x.len()], vec![0.0; x.len()]);
            if weight > 0.0 {
                let (a, b) = &increments[part];
                (0..x.len()).for_each(|i| (dq[i], dx[i]) = (h * weight * a[i], h * weight * b[i]));
            }
            let moved: Vec<f64> = x.iter().zip(&dx).map(|(x, d)| x + d).collect();
            let (v, rate) = rates(&model.integrate(&q, &dq), &moved);
            increments.push((chart_rate(model, &q, &dq, &v), rate));
        }
        let mean = |f: &dyn Fn(usize, usize) -> f64, i: usize| {
            h / 6.0 * (f(0, i) + 2.0 * f(1, i) + 2.0 * f(2, i) + f(3, i))
        };
        let dq: Vec<f64> = (0..x.len()).map(|i| mean(&|k, i| increments[k].0[i], i)).collect();
        (0..x.len()).for_each(|i| x[i] += mean(&|k, i| increments[k].1[i], i));
        q = model.integrate(&q, &dq);
    }
    (q, x)
}

/// The rate of the increment from q0 at q0 ∘ τ(dq) moving with v, by a dual number through `difference`.
fn chart_rate(model: &Model, q0: &[f64], dq: &[f64], v: &[f64]) -> Vec<f64> {
    use slow::inverse_dynamics_derivatives::{fixed, seeded, tangent};
    let q = model.integrate(q0, dq);
    let moving = seeded(&q, &tangent(model, &q, v));
    model.difference(&fixed(q0), &moving).iter().map(|x| x.rate).collect()
}

/// A motion in ν is the motion in v: both of fourth order to the same state.
#[test]
fn a_motion_in_normalized_velocities_is_the_ordinary_one() {
    let mut tried = 0;
    for seed in seeds(40) {
        let case = case(seed);
        // Slow enough for half a second to be smooth; quick enough to see Coriolis forces.
        let layout = Layout::<f64>::new(&case.model);
        let start = case.model.random_state(seed);
        let tau = vec![0.0; case.model.nv()];
        let ordinary = |steps: usize| {
            simulate(&case.model, (&start.q, &start.v), steps, |q, v| {
                (v.to_vec(), forward_dynamics(&layout, q, v, &tau, None).unwrap())
            })
        };
        let mut work = DiagonalDynamics::new(&layout);
        let mut diagonal = |steps: usize| {
            let nu = diagonal_velocity(&layout, &start.q, &start.v, DiagonalVelocity::Normalized).unwrap();
            let (q, nu) = simulate(&case.model, (&start.q, &nu), steps, |q, nu| {
                let (mut v, mut rate) = (vec![0.0; nu.len()], vec![0.0; nu.len()]);
                let kind = DiagonalVelocity::Normalized;
                work.run(&layout, q, nu, &tau, None, kind, &mut v, &mut rate).unwrap();
                (v, rate)
            });
            let v = joint_velocity(&layout, &q, &nu, DiagonalVelocity::Normalized).unwrap();
            (q, v)
        };
        let distance = |(q, v): &(Vec<f64>, Vec<f64>), (p, w): &(Vec<f64>, Vec<f64>)| {
            let turned = case.model.difference(q, p);
            turned
                .iter()
                .map(|x| x.abs())
                .chain(v.iter().zip(w).map(|(v, w)| (v - w).abs()))
                .fold(0.0, f64::max)
        };
        let (coarse, fine) = (ordinary(200), ordinary(400));
        let error = distance(&coarse, &fine);
        // What is violent needs a finer step, not another test.
        if error.is_nan() || error > 1e-6 {
            continue;
        }
        tried += 1;
        let (other_coarse, other) = (diagonal(200), diagonal(400));
        let other_error = distance(&other_coarse, &other);
        let allowed = error + other_error + 1e-11;
        assert!(other_error < 1e-4, "PHIPSI_SEED={seed}: {other_error:e}");
        assert!(distance(&fine, &other) <= allowed, "PHIPSI_SEED={seed}: {:e}", distance(&fine, &other));
    }
    assert!(tried > 15 || std::env::var("PHIPSI_SEED").is_ok(), "{tried}");
}

/// A singular hinge is named, arguments of the wrong length are refused, and factors are those of the sweep.
#[test]
fn workspaces_of_diagonal_dynamics() {
    let case = case(3);
    let layout = Layout::<f64>::new(&case.model);
    let mut work = DiagonalDynamics::new(&layout);
    let nv = case.model.nv();
    let (mut out, mut rate) = (vec![0.0; nv], vec![0.0; nv]);
    let kind = DiagonalVelocity::Plain;
    work.diagonal(&layout, &case.q, &case.v, kind, &mut out).unwrap();
    let sweep = ArticulatedSweep::new(&layout, &case.q).unwrap();
    assert_eq!(work.factors().log_determinant(), sweep.log_determinant());
    let short = work.run(&layout, &case.q, &case.v[1..], &case.tau, None, kind, &mut out, &mut rate);
    assert_eq!(
        short.unwrap_err().to_string(),
        format!("`diagonal` has length {}, but length {nv} is required", nv - 1)
    );
    work.coriolis(&layout, &case.q, &case.v, kind, &mut out).unwrap();
}
