//! Degrees of freedom without articulated inertia: vanishing pivots of the dense mass matrix at random states.

use crate::dense::{Factors, tips_first};
use crate::mass_matrix::mass_matrix;
use phipsi_model::Model;
use phipsi_spatial::Dd;

/// A pivot below this part of its diagonal entry is nothing but rounding in double-double numbers.
const ROUNDING: f64 = 1e-22;

/// The degrees of freedom whose pivot vanishes at three random states; one that does is locked for the others.
pub fn singular_hinges(model: &Model) -> Vec<usize> {
    let mut found: Option<Vec<usize>> = None;
    for seed in 0..3 {
        let q: Vec<Dd> = model.random_state(seed).q.iter().map(|&x| Dd::from_f64(x)).collect();
        let m = mass_matrix(model, &q);
        let mut order = tips_first(model);
        let mut singular = Vec::new();
        while let Err(at) = Factors::new(&m, order.clone(), ROUNDING) {
            singular.push(at.degree_of_freedom);
            order.retain(|&i| i != at.degree_of_freedom);
        }
        found = Some(match found {
            None => singular,
            Some(before) => before.into_iter().filter(|i| singular.contains(i)).collect(),
        });
    }
    let mut found = found.unwrap_or_default();
    found.sort_unstable();
    found
}
