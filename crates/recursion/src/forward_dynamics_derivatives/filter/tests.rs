use super::*;
use crate::innovations::Innovations;
use crate::inverse_dynamics_derivatives::DerivativeSweeps;
use crate::layout::Shifts;
use phipsi_reference::generate::case;

/// Numbers and six-vectors in lanes, which on plain numbers are eight numbers one after the other. What a body rounds is passed on
/// to all inboard of it, and a small D divides it: ε times the number of bodies times the growth of M⁻¹ against 1/diag(M).
#[test]
fn six_vectors_in_lanes_are_the_same_filter() {
    let mut compared = 0;
    for seed in 0..300 {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        if layout.is_flexible() || layout.nv() == 0 {
            continue;
        }
        let mut sweeps = DerivativeSweeps::<f64>::new(&layout);
        let mut shifts = Shifts::new(&layout);
        shifts.set_all(&layout, &case.q);
        let mut filter = Filter::<f64>::new(&layout, &sweeps.places, false);
        let mut innovations = Innovations::<f64>::with_products(&layout, &sweeps.places, 0);
        let mut results = [const { Vec::new() }; 2];
        for (packed, result) in results.iter_mut().enumerate() {
            sweeps.move_bodies::<false, f64>(&layout, &shifts, &case.v, &[]);
            let (places, mut residuals) = (&sweeps.places, case.tau.clone());
            let (view, gains) = (sweeps.table.view(), innovations.gains());
            let mut sweep = Sweep { layout: &layout, places, view, gains, residuals: &mut residuals };
            let all = 0..layout.len();
            if packed == 1 {
                inward(&mut filter.packed, &mut sweep, all).unwrap();
            } else {
                inward(&mut filter.numbers, &mut sweep, all).unwrap();
            }
            for place in places.margin..places.count {
                result.extend(sweep.gains.gain(place).to_array());
            }
            result.extend(residuals);
        }
        let [numbers, lanes] = &results;
        let diagonal = |m: &[f64], i: usize| m[i * layout.nv() + i];
        let m = crate::mass_matrix(&layout, &case.q).unwrap();
        let inverse = crate::mass_matrix_inverse(&layout, &case.q).unwrap();
        let growth = (0..layout.nv()).map(|i| diagonal(&m, i) * diagonal(&inverse, i)).fold(1.0, f64::max);
        let largest = numbers.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
        let allowed = 8.0 * layout.len() as f64 * f64::EPSILON * growth * largest;
        for (i, (a, b)) in numbers.iter().zip(lanes).enumerate() {
            assert!((a - b).abs() <= allowed, "seed {seed}, number {i}: {a} and {b}, allowed {allowed:e}");
        }
        compared += 1;
    }
    assert!(compared > 200, "{compared}");
}
