//! Energies of all pairs as functions of their distance and parameters.

use super::exclusions::Exclusions;
use super::geometry::distance;
use phipsi_formats::system::{CustomNonbonded, Formula, Slope};
use phipsi_spatial::Vec3;

#[derive(Clone, Debug)]
pub(super) struct CustomPairs {
    energy: Formula,
    slope: Slope,
    parameters: Vec<f64>,
    count: usize,
    exclusions: Exclusions,
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
                buffer[0] = r;
                buffer[1 + count..1 + 2 * count].copy_from_slice(of(j));
                let mut slope = [0.0];
                energy += self.energy.value_and_slopes(buffer, &[&self.slope], &mut slope);
                let force = gradient.scale(-slope[0]);
                forces[i] -= force;
                forces[j] += force;
            }
        }
        energy
    }
}
