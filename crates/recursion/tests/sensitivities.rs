//! Υ of every body and the gradient of ln det M, against dense matrices and dual numbers.

use crate::common::{agree_on, by_vectors, gram, growth, scaled_condition, seeds};
use phipsi_model::JointKind;
use phipsi_recursion::batch::{Input, kernels, run_batch};
use phipsi_recursion::{ArticulatedSweep, Layout, LogDeterminantGradient, log_determinant_gradient, upsilon};
use phipsi_reference as slow;
use phipsi_reference::generate::{Case, case};
use phipsi_reference::sensitivity::widened;
use phipsi_spatial::lanes::Level;
use phipsi_spatial::{Dd, Real};

const TREES: u64 = 300;

/// Perturbations that κ is estimated from.
const SAMPLES: usize = 3;

fn flat<T: Copy>(matrices: &[[[T; 6]; 6]]) -> Vec<T> {
    matrices.iter().flatten().flatten().copied().collect()
}

/// Blocks of M⁻¹ seen at the bodies: they round as M⁻¹ does. Directions in turned axes round by the largest of all three, entries
/// of a block by the roots of two such.
#[test]
fn upsilon_of_every_body() {
    agree_on(
        TREES,
        SAMPLES,
        "upsilon",
        |layout, case| Ok(flat(&upsilon(layout, &case.q)?)),
        |case| slow::upsilon(&case.model, &widened(&case.q)).expect("generated trees are regular"),
        |case, _, size| {
            let growth = growth(case);
            for block in size.chunks_exact_mut(36) {
                let mut diagonal: Vec<f64> = (0..6).map(|i| block[7 * i]).collect();
                by_vectors(&mut diagonal);
                gram(|i| diagonal[i], block);
                block.iter_mut().for_each(|x| *x *= growth);
            }
        },
    );
}

fn slow_gradient(case: &Case) -> Vec<Dd> {
    slow::log_determinant_gradient(&case.model, &widened(&case.q)).expect("generated trees are regular")
}

/// Entries are traces of products of an inertia with a compliance, and H P Υ = H: products of size one, in metres and radians,
/// whose sum cancels where the mechanism is symmetric.
#[test]
fn gradient_of_the_log_determinant() {
    agree_on(
        TREES,
        SAMPLES,
        "log_determinant_gradient",
        |layout, case| log_determinant_gradient(layout, &case.q),
        slow_gradient,
        |case, _, size| {
            let growth = growth(case);
            size.iter_mut().for_each(|x| *x = growth * x.max(1.0));
        },
    );
}

/// The same in double-double numbers: what is left is the rounding of thirty digits.
#[test]
fn the_gradient_has_thirty_digits_in_double_double_numbers() {
    let mut worst = 0.0f64;
    for seed in seeds(TREES) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let q = widened(&case.q);
        let got = log_determinant_gradient(&layout, &q).unwrap();
        let want = slow_gradient(&case);
        let size = scaled_condition(&case) * want.iter().fold(1.0f64, |m, x| m.max(x.hi.abs()));
        for (i, (g, w)) in got.iter().zip(&want).enumerate() {
            let error = (*g - *w).abs().to_f64() / size;
            worst = worst.max(error);
            assert!(error < 1e-28, "PHIPSI_SEED={seed}, [{i}]: {error:e}");
        }
    }
    println!("largest: {worst:e}");
}

/// Differences of Σ ln D along `Model::integrate`, which share nothing with the trace.
#[test]
fn the_gradient_is_that_of_the_factors() {
    let step = Dd::from_f64(1e-10);
    for seed in seeds(TREES) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let mut q = widened(&case.q);
        case.model.normalize(&mut q);
        let gradient = log_determinant_gradient(&layout, &q).unwrap();
        let x = widened(&case.v);
        let along = gradient.iter().zip(&x).fold(Dd::from_f64(0.0), |sum, (g, x)| sum + *g * *x);
        // The product of the pivots, before over after, so that no logarithm rounds.
        let pivots = |sign: f64| {
            let h: Vec<Dd> = x.iter().map(|x| *x * step * Dd::from_f64(sign)).collect();
            let moved = case.model.integrate(&q, &h);
            slow::articulated_joint_inertias(&case.model, &moved).unwrap()
        };
        let (after, before) = (pivots(1.0), pivots(-1.0));
        let mut ratio = Dd::from_f64(1.0);
        for (a, b) in after.iter().zip(&before) {
            ratio *= *a / *b;
        }
        let difference = (ratio - Dd::from_f64(1.0)) / (step + step);
        let speed: f64 = 1.0 + x.iter().map(|x| x.hi.abs()).sum::<f64>();
        let size: f64 = 1.0 + gradient.iter().zip(&x).map(|(g, x)| (g.hi * x.hi).abs()).sum::<f64>();
        // ratio − 1 − ln ratio and the third derivative: a part step · speed · size of the result.
        let allowed = 1e-10 * speed * size * (size + scaled_condition(&case));
        let error = (difference - along).hi.abs();
        assert!(error <= allowed, "PHIPSI_SEED={seed}: {} {}", difference.hi, along.hi);
    }
}

/// What is the same for every configuration has no gradient; a workspace's factors are those of the sweep.
#[test]
fn roots_have_no_gradient() {
    for seed in seeds(TREES) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let mut work = LogDeterminantGradient::new(&layout);
        let mut gradient = vec![1.0; case.model.nv()];
        work.run(&layout, &case.q, &mut gradient).unwrap();
        for k in 0..case.model.len() {
            let free = case.model.joints()[k].kind == JointKind::Free;
            let universal = matches!(case.model.joints()[k].kind, JointKind::Universal { .. });
            if free || case.model.tree().parent(k).is_none() && !universal {
                assert!(gradient[case.model.v_range(k)].iter().all(|g| *g == 0.0), "PHIPSI_SEED={seed}");
            }
        }
        let sweep = ArticulatedSweep::new(&layout, &case.q).unwrap();
        assert_eq!(work.factors().log_determinant(), sweep.log_determinant(), "PHIPSI_SEED={seed}");
    }
}

/// States in lanes of every width have the bits of one state by itself.
#[test]
fn lanes_give_the_bits_of_one_state() {
    const STATES: usize = 11;
    for seed in seeds(60) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let mut q = case.q.clone();
        (1..STATES as u64).for_each(|i| q.extend(case.model.random_state(100 * seed + i).q));
        let (nq, nv, n) = (case.model.nq(), case.model.nv(), case.model.len());
        let (mut gradients, mut blocks) = (vec![0.0; STATES * nv], vec![0.0; STATES * 36 * n]);
        for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
            let inputs = [Input::each(&q, nq)];
            let kernel = kernels::LogDeterminantGradient { layout: &layout };
            run_batch(&kernel, level, &inputs, STATES, &mut gradients).unwrap();
            run_batch(&kernels::Upsilon { layout: &layout }, level, &inputs, STATES, &mut blocks).unwrap();
            for (i, q) in q.chunks_exact(nq).enumerate() {
                let gradient = log_determinant_gradient(&layout, q).unwrap();
                assert_eq!(
                    bits(&gradients[i * nv..(i + 1) * nv]),
                    bits(&gradient),
                    "PHIPSI_SEED={seed}, state {i}"
                );
                let own = flat(&upsilon(&layout, q).unwrap());
                assert_eq!(
                    bits(&blocks[i * 36 * n..(i + 1) * 36 * n]),
                    bits(&own),
                    "PHIPSI_SEED={seed}, state {i}"
                );
            }
        }
    }
}

fn bits(x: &[f64]) -> Vec<u64> {
    x.iter().map(|x| x.to_bits()).collect()
}
