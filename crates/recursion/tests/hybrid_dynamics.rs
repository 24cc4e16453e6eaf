//! Hybrid dynamics against the dense partitioned equations, and against its two limits.

use crate::common::{FACTOR, SAMPLES, growth, seeds, steps, wide_wrenches};
use phipsi_model::Random;
use phipsi_recursion::{
    DynamicsError, HybridDynamics, Layout, forward_dynamics, hybrid_dynamics, inverse_dynamics,
};
use phipsi_reference::generate::{Case, Limits, case, case_within};
use phipsi_reference::sensitivity::{sensitivity, widened};
use phipsi_spatial::{Dd, Real, Scalar};

/// Accelerations, then forces.
fn fast(case: &Case, active: &[bool]) -> Vec<f64> {
    let layout = Layout::<f64>::new(&case.model);
    let (q, v, a, tau) = (&case.q, &case.v, &case.a, &case.tau);
    let (a, tau) = hybrid_dynamics(&layout, q, v, active, a, tau, Some(&case.wrenches)).unwrap();
    [a, tau].concat()
}

fn slow(case: &Case, active: &[bool]) -> Vec<Dd> {
    let (q, v, a, tau) = (widened(&case.q), widened(&case.v), widened(&case.a), widened(&case.tau));
    let wrenches = wide_wrenches(case);
    let (a, tau) =
        phipsi_reference::hybrid_dynamics(&case.model, &q, &v, active, &a, &tau, Some(&wrenches)).unwrap();
    [a, tau].concat()
}

/// The largest error over n·ε·κ; the filter loses the ratio of composite to articulated inertia (soa.md 2.2).
fn check(case: &Case, seed: u64, active: &[bool]) -> f64 {
    let unit = steps(case) * f64::EPSILON * growth(case);
    let got = fast(case, active);
    let mut worst = f64::INFINITY;
    for samples in [SAMPLES, 6 * SAMPLES] {
        let (want, mut size) = sensitivity(case, samples, seed, |case| slow(case, active));
        let nv = case.model.nv();
        // Forces and accelerations of one tree share what is lost on the way.
        for half in [0..nv, nv..2 * nv] {
            let largest = size[half.clone()].iter().fold(0.0f64, |m, x| m.max(*x));
            size[half].iter_mut().for_each(|x| *x = x.max(1e-3 * largest));
        }
        worst = got
            .iter()
            .zip(want.iter().zip(&size))
            .map(|(x, (y, size))| (x - y.hi).abs() / (unit * size).max(f64::MIN_POSITIVE))
            .fold(0.0, f64::max);
        if worst <= FACTOR {
            break;
        }
    }
    assert!(worst <= FACTOR, "PHIPSI_SEED={seed}, active {active:?}: {worst} n·ε·κ");
    worst
}

#[test]
fn random_patterns() {
    let mut worst = 0.0f64;
    for seed in seeds(300) {
        let case = case(seed);
        let mut random = Random::new(seed);
        let active: Vec<bool> = (0..case.model.nv()).map(|_| random.uniform() < 0.5).collect();
        worst = worst.max(check(&case, seed, &active));
    }
    println!("hybrid dynamics: at most {worst:.2} n·ε·κ; allowed {FACTOR}");
}

/// All 2ⁿ patterns of trees with at most seven degrees of freedom, fixed and free bases.
#[test]
fn every_pattern_of_small_trees() {
    for seed in seeds(12) {
        let case = case_within(seed, Limits { degrees_of_freedom: 4, decades: 0.5 });
        let nv = case.model.nv();
        for pattern in 0u32..1 << nv.min(7) {
            let active: Vec<bool> = (0..nv).map(|i| pattern >> (i % 7) & 1 == 1).collect();
            check(&case, seed, &active);
        }
    }
}

/// In double-double numbers nothing but rounding at the 31st digit is left between the sweeps and the dense equations.
#[test]
fn double_double_agrees_to_thirty_digits() {
    for seed in seeds(60) {
        let case = case_within(seed, Limits { degrees_of_freedom: 9, decades: 0.5 });
        let mut random = Random::new(seed);
        let active: Vec<bool> = (0..case.model.nv()).map(|_| random.uniform() < 0.5).collect();
        let layout = Layout::<Dd>::new(&case.model);
        let (q, v) = (widened(&case.q), widened(&case.v));
        let (a, tau) =
            hybrid_dynamics(&layout, &q, &v, &active, &widened(&case.a), &widened(&case.tau), None).unwrap();
        let (want_a, want_tau) = phipsi_reference::hybrid_dynamics(
            &case.model,
            &q,
            &v,
            &active,
            &widened(&case.a),
            &widened(&case.tau),
            None,
        )
        .unwrap();
        for (got, want) in [(a, want_a), (tau, want_tau)] {
            let size = want.iter().fold(1.0f64, |m, x| m.max(x.abs().hi));
            let lost = growth(&case) * crate::common::scaled_condition(&case) * 1e3;
            for (x, y) in got.iter().zip(&want) {
                let error = (*x - *y).abs().hi;
                assert!(
                    error <= Dd::EPSILON * size * lost * steps(&case),
                    "PHIPSI_SEED={seed}: {error:e} of {size:e}"
                );
            }
        }
    }
}

/// None active is forward dynamics, all active inverse dynamics; a workspace gives the same again.
#[test]
fn all_active_and_none() {
    for seed in seeds(300) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let (q, v, wrenches) = (&case.q, &case.v, Some(&case.wrenches[..]));
        let nv = case.model.nv();
        let unit = FACTOR * steps(&case) * f64::EPSILON;
        let wide = |x: &[f64]| widened(x);
        let mut work = HybridDynamics::new(&layout);

        let (mut a, mut tau) = (vec![0.0; nv], case.tau.clone());
        work.run(&layout, q, v, &vec![false; nv], &mut a, &mut tau, wrenches).unwrap();
        let want = forward_dynamics(&layout, q, v, &case.tau, wrenches).unwrap();
        let (_, size) = sensitivity(&case, SAMPLES, seed, |c| {
            let wrenches = wide_wrenches(c);
            let (q, v, tau) = (wide(&c.q), wide(&c.v), wide(&c.tau));
            phipsi_reference::forward_dynamics(&c.model, &q, &v, &tau, Some(&wrenches)).unwrap()
        });
        let largest = size.iter().fold(0.0f64, |m, x| m.max(*x));
        for ((x, y), size) in a.iter().zip(&want).zip(&size) {
            let budget = 2.0 * unit * growth(&case) * size.max(1e-3 * largest);
            assert!((x - y).abs() <= budget, "forward, PHIPSI_SEED={seed}: {x} instead of {y}");
        }
        assert_eq!(tau, case.tau);

        let (mut a, mut tau) = (case.a.clone(), vec![0.0; nv]);
        work.run(&layout, q, v, &vec![true; nv], &mut a, &mut tau, wrenches).unwrap();
        let want = inverse_dynamics(&layout, q, v, &case.a, wrenches).unwrap();
        let (_, size) = sensitivity(&case, SAMPLES, seed, |c| {
            let wrenches = wide_wrenches(c);
            let (q, v, a) = (wide(&c.q), wide(&c.v), wide(&c.a));
            phipsi_reference::inverse_dynamics(&c.model, &q, &v, &a, Some(&wrenches))
        });
        let largest = size.iter().fold(0.0f64, |m, x| m.max(*x));
        for ((x, y), size) in tau.iter().zip(&want).zip(&size) {
            let budget = 2.0 * unit * size.max(1e-3 * largest);
            assert!((x - y).abs() <= budget, "inverse, PHIPSI_SEED={seed}: {x} instead of {y}");
        }
        assert_eq!(a, case.a);
    }
}

#[test]
fn mistakes_are_named() {
    let case = case(3);
    let layout = Layout::<f64>::new(&case.model);
    let short = hybrid_dynamics(&layout, &case.q, &case.v, &[], &case.a, &case.tau, None).unwrap_err();
    assert!(matches!(short, DynamicsError::Shape { argument: "active", .. }));
}
