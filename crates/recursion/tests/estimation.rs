//! Dynamics as estimation, beyond what `papers.rs` checks line by line: sampled covariances, vertical sweeps against the kernel,
//! and mistakes.

#![allow(non_snake_case)] // the papers' symbols

use crate::common::seeds;
use nalgebra::DMatrix;
use phipsi_model::{Inertia, Random};
use phipsi_recursion::{DynamicsError, Layout, Operators, mass_matrix_inverse};
use phipsi_reference::generate::{Case, Limits, case_within, rebuilt};

fn case(seed: u64) -> Case {
    case_within(seed, Limits { degrees_of_freedom: 1 + (seed % 13) as usize, decades: 0.5 })
}

/// (1/N) Σ x x*.
fn sampled(count: usize, size: usize, mut draw: impl FnMut() -> Vec<f64>) -> DMatrix<f64> {
    let mut sum = DMatrix::zeros(size, size);
    for _ in 0..count {
        let x = draw();
        for j in 0..size {
            for i in 0..size {
                sum[(i, j)] += x[i] * x[j];
            }
        }
    }
    sum / count as f64
}

/// ‖Ĉ − C‖² over what it is on average, (‖C‖² + (tr C)²)/N for N normal vectors of covariance C.
fn excess(got: &DMatrix<f64>, want: &DMatrix<f64>, count: usize) -> f64 {
    let expected = (want.norm_squared() + want.trace().powi(2)) / count as f64;
    (got - want).norm_squared() / expected
}

/// The excess of many independent estimates: its mean is one at every N, which is the rate 1/√N of the error. The mean of R
/// ratios is known to its standard error; five of them are allowed.
fn mean_is_one(what: &str, count: usize, excesses: &[f64]) {
    let n = excesses.len() as f64;
    let mean = excesses.iter().sum::<f64>() / n;
    let variance = excesses.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let deviation = (variance / n).sqrt();
    println!("{what}, {count} samples: error² / expected {mean:.3} ± {deviation:.3}");
    assert!((mean - 1.0).abs() < 5.0 * deviation, "{what}, {count} samples: {mean} ± {deviation}");
    assert!(deviation < 0.25, "{what}: {deviation} tells nothing");
}

/// W ~ N(0, M(k)) body by body gives T with the covariance 𝓜, and its innovations are white with the covariance D: paper 1
/// Lemmas 2 and 7, by the experiment that its section 10 proposes. Two decades of N.
#[test]
fn a_random_field_gives_the_mass_matrix_and_white_innovations() {
    let trees: Vec<u64> = (0..60).collect();
    for count in [100, 1000, 10_000] {
        let (mut of_mass, mut of_innovations) = (vec![], vec![]);
        // Fewer trees where a tree costs more.
        for &seed in trees.iter().take(if count > 1000 { 40 } else { 60 }) {
            let case = case(seed);
            let ops = Operators::new(&case.model, &case.q).unwrap();
            let nv = case.model.nv();
            let (field, L) = (ops.random_field(), ops.innovations_operator());
            let mut random = Random::new(seed ^ count as u64);
            // 𝓜 by the dense reference. Units differ between joints: each is measured by the root of its own inertia.
            let mass = phipsi_reference::mass_matrix(&case.model, &case.q);
            let unit: Vec<f64> = (0..nv).map(|i| mass[(i, i)].sqrt()).collect();
            let D = ops.D.dense().unwrap();
            let scaled = |a: &DMatrix<f64>| DMatrix::from_fn(nv, nv, |i, j| a[(i, j)] / (unit[i] * unit[j]));
            let mut innovations = vec![];
            let got = sampled(count, nv, || {
                let T = field.sample(&mut random).T;
                innovations.push(L.apply(&T).unwrap());
                T
            });
            of_mass.push(excess(&scaled(&got), &scaled(&mass), count));
            let mut drawn = innovations.into_iter();
            let got = sampled(count, nv, || drawn.next().unwrap());
            of_innovations.push(excess(&scaled(&got), &scaled(&D), count));
        }
        mean_is_one("𝓜", count, &of_mass);
        mean_is_one("D", count, &of_innovations);
    }
}

/// Bodies that are points or nothing have a singular M(k), whose root is no Cholesky factor.
#[test]
fn singular_inertias_have_a_root() {
    for seed in seeds(200) {
        let case = case(seed);
        let mut random = Random::new(seed);
        let body = |_: usize, body: &phipsi_model::Body| match random.below(3) {
            0 => Inertia { tensor: [0.0; 6], ..body.inertia },
            1 => Inertia { tensor: [1.0, 0.0, 0.0, 1.0, 0.0, 0.0], ..body.inertia }, // a thin rod
            _ => body.inertia,
        };
        let model = rebuilt(&case.model, body, |_, joint| (joint.kind, joint.placement), [0.0; 3]);
        // Some are singular at a hinge, and are not asked here.
        let Ok(ops) = Operators::new(&model, &case.q) else { continue };
        let field = ops.random_field();
        let square = (field.root() * &field.root().adjoint()).dense().unwrap();
        let M = ops.M.dense().unwrap();
        for (i, j) in (0..M.nrows()).flat_map(|i| (0..M.ncols()).map(move |j| (i, j))) {
            // Moments round in proportion to the largest one of their body, in any axes; pivots are dropped at 64 ε of it.
            let largest = |i: usize| (3 * (i / 3)..3 * (i / 3) + 3).map(|i| M[(i, i)]).fold(0.0, f64::max);
            let size = (largest(i) * largest(j)).sqrt();
            let error = (square[(i, j)] - M[(i, j)]).abs();
            assert!(
                error <= 128.0 * f64::EPSILON * size,
                "PHIPSI_SEED={seed}: M[{i},{j}] {error:e} of {size:e}"
            );
        }
    }
}

/// Lemma 13 and the kernel, L* D⁻¹ L of gains, are two ways to 𝓜⁻¹.
#[test]
fn vertical_sweeps_give_the_inverse_of_the_kernel() {
    for seed in seeds(200) {
        let case = case(seed);
        let ops = Operators::new(&case.model, &case.q).unwrap();
        let kernel = mass_matrix_inverse(&Layout::new(&case.model), &case.q).unwrap();
        let sweeps = ops.mass_matrix_inverse_by_sweeps();
        let (n, nv) = (crate::common::steps(&case), case.model.nv());
        let unit = crate::common::FACTOR * n * f64::EPSILON * crate::common::growth(&case);
        for (i, j) in (0..nv).flat_map(|i| (0..nv).map(move |j| (i, j))) {
            let size =
                (kernel[i * (nv + 1)] * kernel[j * (nv + 1)]).sqrt() * crate::common::scaled_condition(&case);
            let error = (sweeps[(i, j)] - kernel[i * nv + j]).abs();
            assert!(error <= unit * size, "PHIPSI_SEED={seed}: [{i},{j}] {error:e} of {size:e}");
        }
    }
}

#[test]
fn samples_are_those_of_their_seed() {
    let case = case(7);
    let ops = Operators::new(&case.model, &case.q).unwrap();
    let draw = |seed| ops.sample_field(&mut Random::new(seed));
    assert_eq!(draw(3), draw(3));
    assert_ne!(draw(3), draw(4));
    assert!(draw(3).W.iter().all(|x| x.is_finite()));
}

#[test]
fn mistakes_of_filter_and_smoother_are_named() {
    let (one, other) = (case(12), case(3));
    let ops = Operators::new(&one.model, &one.q).unwrap();
    let error = ops.filter(&[1.0; 99]).unwrap_err();
    assert!(matches!(error, DynamicsError::Shape { argument: "tau", .. }), "{error}");
    let filtered = ops.filter(&one.tau).unwrap();
    assert_ne!(one.model.nv(), other.model.nv());
    let elsewhere = Operators::new(&other.model, &other.q).unwrap();
    let error = elsewhere.smooth(&filtered).unwrap_err();
    assert!(matches!(error, DynamicsError::Shape { argument: "filtered.nu", .. }), "{error}");
    let mut cut = filtered;
    cut.z.pop();
    let error = ops.smooth(&cut).unwrap_err();
    assert!(matches!(error, DynamicsError::Shape { argument: "filtered.z", .. }), "{error}");
}
