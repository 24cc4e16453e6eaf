//! The same kernels in f32 and in double-double numbers, against the reference in double-double numbers.

use crate::common::{SAMPLES, compare, gram, growth, scaled_condition, seeds, steps, wide_wrenches};
use phipsi_recursion::{Layout, forward_dynamics, inverse_dynamics, mass_matrix};
use phipsi_reference as slow;
use phipsi_reference::generate::{Case, Limits, case, case_within};
use phipsi_reference::sensitivity::{sensitivity, widened};
use phipsi_spatial::{Dd, Real, Wrench};

fn inverse(case: &Case) -> Vec<Dd> {
    let (q, v, a) = (widened(&case.q), widened(&case.v), widened(&case.a));
    slow::inverse_dynamics(&case.model, &q, &v, &a, Some(&wide_wrenches(case)))
}

fn forward(case: &Case) -> Vec<Dd> {
    let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
    slow::forward_dynamics(&case.model, &q, &v, &tau, Some(&wide_wrenches(case)))
        .expect("generated trees are regular")
}

fn matrix(case: &Case) -> Vec<Dd> {
    slow::mass_matrix(&case.model, &widened(&case.q)).as_slice().into()
}

/// The kernels in the scalar T on one case, within n·ε·κ of T; κ of forward dynamics times `loss`. What cancels rounds by
/// its terms: `part` of the largest component stands for them.
fn check<T: Real>(seed: u64, case: &Case, loss: f64, part: f64) {
    let convert = |x: &[f64]| x.iter().map(|&x| T::splat(x)).collect::<Vec<T>>();
    let (q, v, a, tau) = (convert(&case.q), convert(&case.v), convert(&case.a), convert(&case.tau));
    let wrenches: Vec<Wrench<T>> =
        case.wrenches.iter().map(|w| Wrench::from_array(w.to_array().map(T::splat))).collect();
    let layout = Layout::<T>::new(&case.model);
    let unit = steps(case) * T::EPSILON;
    let floor = |size: &mut [f64]| {
        let largest = size.iter().fold(0.0f64, |m, x| m.max(*x));
        size.iter_mut().for_each(|x| *x = x.max(part * largest));
    };
    let (want, mut size) = sensitivity(case, SAMPLES, seed, inverse);
    floor(&mut size);
    let got = inverse_dynamics(&layout, &q, &v, &a, Some(&wrenches)).unwrap();
    compare("inverse_dynamics", seed, &got, &want, &size, unit);
    let (want, mut size) = sensitivity(case, SAMPLES, seed, matrix);
    let nv = case.model.nv();
    gram(|i| want[i * nv + i].hi, &mut size);
    compare("mass_matrix", seed, &mass_matrix(&layout, &q).unwrap(), &want, &size, unit);
    let (want, mut size) = sensitivity(case, SAMPLES, seed, forward);
    size.iter_mut().for_each(|x| *x *= loss);
    floor(&mut size);
    let got = forward_dynamics(&layout, &q, &v, &tau, Some(&wrenches)).unwrap();
    compare("forward_dynamics", seed, &got, &want, &size, unit);
}

/// Thirty digits of the largest component. Here the reference rounds as much as the kernel: its sums with m |ω| |v| of fast
/// bodies cancel, and its dense factors lose max M_ii M⁻¹_ii.
#[test]
fn double_double_kernels_keep_thirty_digits() {
    for seed in seeds(150) {
        let case = case(seed);
        check::<Dd>(seed, &case, scaled_condition(&case), 1.0);
    }
}

/// Seven digits, for models without decades of masses. Inputs are rounded to f32 first; constants round inside.
#[test]
fn single_precision_kernels_run() {
    for seed in seeds(300) {
        let mut case =
            case_within(seed, Limits { degrees_of_freedom: 1 + (seed % 12) as usize, decades: 0.5 });
        for x in [&mut case.q, &mut case.v, &mut case.a, &mut case.tau] {
            x.iter_mut().for_each(|x| *x = f64::from(*x as f32));
        }
        for w in &mut case.wrenches {
            *w = Wrench::from_array(w.to_array().map(|x| f64::from(x as f32)));
        }
        check::<f32>(seed, &case, growth(&case), 1e-3);
    }
}
