//! Energies of all pairs as functions of their distance and parameters.

use super::exclusions::Exclusions;
use super::geometry::distance;
use phipsi_formats::system::{CustomNonbonded, Cutoff, Formula, Slope};
use phipsi_spatial::Vec3;

#[derive(Clone, Debug)]
pub(super) struct CustomPairs {
    energy: Formula,
    slope: Slope,
    parameters: Vec<f64>,
    count: usize,
    exclusions: Exclusions,
    cutoff: Option<Cutoff>,
    buffer: Vec<f64>,
}

impl CustomPairs {
    pub(super) fn new(tables: &CustomNonbonded, n: usize) -> Self {
        CustomPairs {
            energy: tables.energy.clone(),
            slope: tables.energy.slope("r"),
            parameters: tables.parameters.clone(),
            count: tables.parameter_names.len(),
            exclusions: Exclusions::new(n, tables.exclusions.iter().copied()),
            cutoff: tables.cutoff,
            buffer: vec![0.0; tables.energy.slots()],
        }
    }

    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let (count, buffer) = (self.count, &mut self.buffer);
        let of = |i: usize| &self.parameters[i * count..(i + 1) * count];
        let mut energy = 0.0;
        for i in 0..x.len() {
            buffer[1..1 + count].copy_from_slice(of(i));
            for j in self.exclusions.partners(i).flatten() {
                let (r, gradient) = distance(x, [i, j]);
                if self.cutoff.is_some_and(|cutoff| r >= cutoff.distance) {
                    continue;
                }
                buffer[0] = r;
                buffer[1 + count..1 + 2 * count].copy_from_slice(of(j));
                let mut slope = [0.0];
                let mut pair = self.energy.value_and_slopes(buffer, &[&self.slope], &mut slope);
                if let Some(cutoff) = &self.cutoff {
                    let (factor, by_r) = switch(r, cutoff);
                    slope[0] = factor * slope[0] + by_r * pair;
                    pair *= factor;
                }
                energy += pair;
                let force = gradient.scale(-slope[0]);
                forces[i] -= force;
                forces[j] += force;
            }
        }
        energy
    }
}

/// The factor that switches energies off, and its slope in r: 1 − 10 t³ + 15 t⁴ − 6 t⁵ with t from 0, where switching begins, to
/// 1 at the cutoff.
#[inline]
pub(super) fn switch(r: f64, cutoff: &Cutoff) -> (f64, f64) {
    match cutoff.switching {
        Some(start) if r > start => {
            let scale = 1.0 / (cutoff.distance - start);
            let t = (r - start) * scale;
            let factor = 1.0 + t * t * t * (-10.0 + t * (15.0 - 6.0 * t));
            (factor, -30.0 * t * t * (1.0 - t) * (1.0 - t) * scale)
        }
        _ => (1.0, 0.0),
    }
}
