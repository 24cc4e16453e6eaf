//! Where to put actuators: measures of how well the active axes move a body and hold the passive ones.

use crate::{HybridError, UnderActuated};
use phipsi_model::Model;
use phipsi_spatial::Vec3;

/// Placements that are tried at most.
const LIMIT: u128 = 20_000;

/// How good a placement is at one configuration; larger is better, but for `effort`.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacementMeasures {
    /// Singular values of the generalised Jacobian of the point, largest first: what it reaches from the active axes.
    pub reach: Vec<f64>,
    /// The product of those singular values, the manipulability of the active axes; zero if a direction is out of reach.
    pub manipulability: f64,
    /// Singular values of S_ap*, largest first: how far the passive axes answer to the active ones. As many as the passive axes
    /// and all above zero: the passive axes can be steered.
    pub coupling: Vec<f64>,
    /// Largest eigenvalue of S_aa over its smallest: how unequal the actuators' loads are.
    pub effort: f64,
}

/// A choice of active degrees of freedom.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// The active degrees of freedom, ascending.
    pub active: Vec<usize>,
    /// Its measures.
    pub measures: PlacementMeasures,
}

impl UnderActuated<f64> {
    /// The measures of this placement for a point of a body: by dense singular values of nv columns.
    ///
    /// # Errors
    /// As [`UnderActuated::generalized_jacobian`].
    pub fn measures(&self, body: usize, point: Vec3<f64>) -> Result<PlacementMeasures, HybridError> {
        let values = |m: nalgebra::DMatrix<f64>| {
            let mut values: Vec<f64> =
                if m.is_empty() { vec![] } else { m.singular_values().as_slice().to_vec() };
            values.sort_by(|a, b| b.total_cmp(a));
            values
        };
        let reach = values(self.generalized_jacobian(&[(body, point)])?.dense()?);
        let coupling = values(self.S_ap.adjoint().dense()?);
        let load = values(self.S_aa.dense()?);
        let effort = match (load.first(), load.last()) {
            (Some(first), Some(last)) => first / last,
            _ => f64::NAN,
        };
        Ok(PlacementMeasures { manipulability: reach.iter().product(), reach, coupling, effort })
    }
}

fn choose(n: usize, k: usize) -> u128 {
    (0..k).fold(1u128, |c, i| c.saturating_mul((n - i) as u128) / (i as u128 + 1))
}

/// All placements of `actuators` actuators on `candidates` (degrees of freedom; all others stay passive), for a point of a
/// body at a configuration: the most manipulable first.
///
/// # Errors
/// [`HybridError::Count`], [`HybridError::TooMany`] (above 20 000); those of [`UnderActuated::new`].
pub fn placements(
    model: &Model,
    q: &[f64],
    candidates: &[usize],
    actuators: usize,
    (body, point): (usize, Vec3<f64>),
) -> Result<Vec<Placement>, HybridError> {
    if actuators == 0 || actuators > candidates.len() || candidates.iter().any(|&i| i >= model.nv()) {
        return Err(HybridError::Count { actuators, candidates: candidates.len().min(model.nv()) });
    }
    let count = choose(candidates.len(), actuators);
    if count > LIMIT {
        return Err(HybridError::TooMany { placements: count, limit: LIMIT });
    }
    let mut all = Vec::new();
    let mut chosen: Vec<usize> = (0..actuators).collect();
    loop {
        let mut active: Vec<usize> = chosen.iter().map(|&i| candidates[i]).collect();
        active.sort_unstable();
        let mut pattern = vec![false; model.nv()];
        active.iter().for_each(|&i| pattern[i] = true);
        let measures = UnderActuated::new(model, q, &pattern)?.measures(body, point)?;
        all.push(Placement { active, measures });
        // The next combination in lexical order.
        let Some(i) = (0..actuators).rev().find(|&i| chosen[i] < candidates.len() - actuators + i) else {
            break;
        };
        chosen[i] += 1;
        for j in i + 1..actuators {
            chosen[j] = chosen[j - 1] + 1;
        }
    }
    all.sort_by(|a, b| b.measures.manipulability.total_cmp(&a.measures.manipulability));
    Ok(all)
}
