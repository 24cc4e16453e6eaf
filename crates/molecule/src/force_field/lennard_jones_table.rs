//! Lennard-Jones energies by tables of pairs of types: E = A(t₁, t₂)/r¹² − B(t₁, t₂)/r⁶.
//!
//! The closed form of a CustomNonbondedForce, which CHARMM's force fields use; the first type is that of the particle with
//! the smaller index.

use super::custom_nonbonded::switch;
use super::exclusions::Exclusions;
use phipsi_formats::system::Cutoff;
use phipsi_spatial::Vec3;

#[derive(Clone, Debug)]
pub(super) struct LennardJonesTable {
    /// Type of each particle.
    pub types: Vec<usize>,
    /// Number of types.
    pub count: usize,
    /// A and B of first type + count · second type.
    pub coefficients: Vec<[f64; 2]>,
    pub exclusions: Exclusions,
    pub cutoff: Option<Cutoff>,
}

impl LennardJonesTable {
    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let mut energy = 0.0;
        for i in 0..x.len() {
            let (xi, first) = (x[i], self.types[i]);
            let (mut row, mut force_i) = (0.0, Vec3::zero());
            for partners in self.exclusions.partners(i) {
                for j in partners {
                    let [a, b] = self.coefficients[first + self.count * self.types[j]];
                    let d = x[j] - xi;
                    if self.cutoff.is_some_and(|cutoff| d.dot(d) >= cutoff.distance * cutoff.distance) {
                        continue;
                    }
                    let inverse_square = 1.0 / d.dot(d);
                    let r6 = inverse_square * inverse_square * inverse_square;
                    let mut pair = (a * r6 - b) * r6;
                    let mut by_r2 = (12.0 * a * r6 - 6.0 * b) * r6 * inverse_square;
                    if let Some(cutoff) = &self.cutoff {
                        let r = d.norm();
                        let (factor, slope) = switch(r, cutoff);
                        by_r2 = factor * by_r2 - slope * pair / r;
                        pair *= factor;
                    }
                    row += pair;
                    let force = d.scale(by_r2);
                    force_i -= force;
                    forces[j] += force;
                }
            }
            energy += row;
            forces[i] += force_i;
        }
        energy
    }
}
