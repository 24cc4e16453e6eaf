//! Seeds and budgets that several tests share.
#![allow(dead_code)] // `batch`, a binary of its own, uses a part

use phipsi_recursion::{DynamicsError, Layout};
use phipsi_reference::generate::{Case, case};
use phipsi_reference::sensitivity::{sensitivity, widened};
use phipsi_spatial::{Dd, Real, Vec3, Wrench};

/// Trees that every algorithm is tried on.
pub const TREES: u64 = 1000;

/// Perturbations that κ is estimated from.
pub const SAMPLES: usize = 6;

/// Roundings per step of a sweep, beyond the n of n·ε·κ: products of 3×3 matrices and sums of three terms round a few
/// times each. Largest seen on the thousand trees: 2.2, and 4.0 of derivatives, which also turn inertias.
pub const FACTOR: f64 = 4.0;

/// The seeds of a test: the first `count`, or the one in the environment variable `PHIPSI_SEED`.
pub fn seeds(count: u64) -> Vec<u64> {
    match std::env::var("PHIPSI_SEED") {
        Ok(seed) => vec![seed.parse().expect("PHIPSI_SEED is a whole number")],
        Err(_) => (0..count).collect(),
    }
}

/// n of the budget: bodies and degrees of freedom, the steps of a sweep.
pub fn steps(case: &Case) -> f64 {
    (case.model.len() + case.model.nv()) as f64
}

/// The kernel's result against the reference's on every seed, component by component, within [`FACTOR`]·n·ε·κ.
///
/// `sizes` gets, for every component, κ times the component and may enlarge it where that is too little; it says why.
pub fn agree(
    what: &str,
    fast: impl Fn(&Layout<f64>, &Case) -> Result<Vec<f64>, DynamicsError>,
    slow: impl Fn(&Case) -> Vec<Dd>,
    sizes: impl Fn(&Case, &mut [f64]),
) {
    agree_on(TREES, SAMPLES, what, fast, slow, |case, _, size| sizes(case, size));
}

/// [`agree`] on another number of trees, with another number of perturbations. κ is a maximum over all perturbations: one
/// comes first, all where that puts a case above the budget, then four times as many; `sizes` gets the number, too.
pub fn agree_on(
    trees: u64,
    samples: usize,
    what: &str,
    fast: impl Fn(&Layout<f64>, &Case) -> Result<Vec<f64>, DynamicsError>,
    slow: impl Fn(&Case) -> Vec<Dd>,
    sizes: impl Fn(&Case, usize, &mut [f64]),
) {
    agree_in(case, trees, samples, what, fast, slow, sizes);
}

/// [`agree_on`] other cases.
pub fn agree_in(
    cases: impl Fn(u64) -> Case,
    trees: u64,
    samples: usize,
    what: &str,
    fast: impl Fn(&Layout<f64>, &Case) -> Result<Vec<f64>, DynamicsError>,
    slow: impl Fn(&Case) -> Vec<Dd>,
    sizes: impl Fn(&Case, usize, &mut [f64]),
) {
    let (mut worst, mut at) = (0.0f64, 0);
    for seed in seeds(trees) {
        let case = cases(seed);
        let got = fast(&Layout::new(&case.model), &case)
            .unwrap_or_else(|e| panic!("{what}, PHIPSI_SEED={seed}: {e}"));
        let measured = |samples: usize| {
            let (want, mut size) = sensitivity(&case, samples, seed, &slow);
            sizes(&case, samples, &mut size);
            // The reference rounds too, by ε² of its largest terms in every product of rotations.
            let largest = size.iter().fold(0.0f64, |m, x| m.max(*x));
            size.iter_mut().for_each(|x| *x += 16.0 * f64::EPSILON * largest);
            (want, size)
        };
        let unit = steps(&case) * f64::EPSILON;
        // κ of one perturbation is at most that of more, and suffices in most cases.
        let mut ratio = f64::INFINITY;
        for tried in [1, samples] {
            if ratio > FACTOR {
                let (want, size) = measured(tried);
                ratio = worst_ratio(&got, &want, &size, unit).1;
            }
        }
        if ratio > FACTOR {
            let (want, size) = measured(4 * samples);
            ratio = compare(what, seed, &got, &want, &size, unit);
        }
        if ratio > worst {
            (worst, at) = (ratio, seed);
        }
    }
    println!("{what}: at most {worst:.2} n·ε·κ, with PHIPSI_SEED={at}; allowed {FACTOR}");
}

/// Largest error in units of `unit`·size; fails above [`FACTOR`].
pub fn compare<T: Real>(what: &str, seed: u64, got: &[T], want: &[Dd], size: &[f64], unit: f64) -> f64 {
    assert_eq!(got.len(), want.len(), "{what}, PHIPSI_SEED={seed}");
    let (i, ratio) = worst_ratio(got, want, size, unit);
    assert!(
        ratio <= FACTOR,
        "{what}[{i}], PHIPSI_SEED={seed}: {} instead of {}, {ratio:.1} n·ε·κ",
        got[i].to_f64(),
        want[i].hi
    );
    ratio
}

/// The component with the largest error in units of `unit`·size, and that error; one that is no number counts as infinite.
fn worst_ratio<T: Real>(got: &[T], want: &[Dd], size: &[f64], unit: f64) -> (usize, f64) {
    let mut worst = (0, 0.0f64);
    for (i, (x, y)) in got.iter().zip(want).enumerate() {
        let error = distance(*x, *y);
        let ratio = if error == 0.0 { 0.0 } else { error / (unit * size[i]) };
        let ratio = if ratio.is_nan() { f64::INFINITY } else { ratio };
        if ratio > worst.1 {
            worst = (i, ratio);
        }
    }
    worst
}

/// |x − y|, without losing the low part of x where it has one.
fn distance<T: Real>(x: T, y: Dd) -> f64 {
    let high = x.to_f64();
    let low = (x - T::splat(high)).to_f64();
    (Dd::from_f64(high) - y + Dd::from_f64(low)).hi.abs()
}

/// max over degrees of freedom of M_ii / D_i: the cancellation in D outboard of a hinge (heavy bodies on light ones), by
/// which forward dynamics may lose more than κ (soa.md 2.2).
pub fn growth(case: &Case) -> f64 {
    let q = widened(&case.q);
    let m = phipsi_reference::mass_matrix(&case.model, &q);
    let d =
        phipsi_reference::articulated_joint_inertias(&case.model, &q).expect("generated trees are regular");
    d.iter().enumerate().map(|(i, d)| (m[(i, i)] / *d).hi).fold(1.0, f64::max)
}

/// max over degrees of freedom of M_ii M⁻¹_ii: the condition of M once its diagonal is scaled to ones. It bounds what the
/// pivots of an elimination lose (Demmel 1989).
pub fn scaled_condition(case: &Case) -> f64 {
    let q = widened(&case.q);
    let m = phipsi_reference::mass_matrix(&case.model, &q);
    let inverse =
        phipsi_reference::mass_matrix_inverse(&case.model, &q).expect("generated trees are regular");
    (0..case.model.nv()).map(|i| (m[(i, i)] * inverse[(i, i)]).hi).fold(1.0, f64::max)
}

/// Components of vectors in turned axes: each gets the size of its vector.
pub fn by_vectors(size: &mut [f64]) {
    for vector in size.chunks_exact_mut(3) {
        let largest = vector.iter().fold(0.0f64, |m, x| m.max(*x));
        vector.fill(largest);
    }
}

/// An entry of a Gram matrix is a sum of terms up to the root of the product of its diagonal entries, also where it is zero.
pub fn gram(diagonal: impl Fn(usize) -> f64, size: &mut [f64]) {
    let n = size.len().isqrt();
    for (ij, size) in size.iter_mut().enumerate() {
        *size = size.max((diagonal(ij / n) * diagonal(ij % n)).sqrt());
    }
}

/// In double-double numbers.
pub fn wide(x: Vec3<f64>) -> Vec3<Dd> {
    Vec3(x.0.map(Dd::from_f64))
}

/// What stands for the rounding of forces in a perturbed case.
pub fn rounding(case: &Case) -> Vec<Wrench<Dd>> {
    case.rounding.iter().map(|w| Wrench::new(wide(w.moment), wide(w.force))).collect()
}

/// The case's wrenches, with what stands for rounding.
pub fn wide_wrenches(case: &Case) -> Vec<Wrench<Dd>> {
    let widen = |w: &Wrench<f64>| Wrench::new(wide(w.moment), wide(w.force));
    case.wrenches.iter().zip(rounding(case)).map(|(w, r)| widen(w) + r).collect()
}
