//! Lennard-Jones and Coulomb energies of all pairs, without cutoff.
//!
//! | symbol | meaning |
//! |---|---|
//! | E | 4 ε [(σ/r)¹² − (σ/r)⁶] + K q q / r |
//! | σ, ε | (σᵢ + σⱼ)/2, √(εᵢ εⱼ) |
//! | K | 1/(4πε₀) in kJ/mol·nm/e² |
//! | exceptions | pairs with a charge product, σ and ε of their own, in place of these |

use super::geometry::distance;
use phipsi_formats::system::{Nonbonded, NonbondedException};
use phipsi_spatial::Vec3;
use std::f64::consts::PI;

/// Elementary charge, C, and Avogadro's number, 1/mol: exact since 2019. Vacuum permittivity, F/m: CODATA 2018, as OpenMM.
const ELEMENTARY_CHARGE: f64 = 1.602176634e-19;
const AVOGADRO: f64 = 6.02214076e23;
const VACUUM_PERMITTIVITY: f64 = 8.8541878128e-12;

/// 1/(4πε₀), kJ/mol·nm/e².
pub(super) const COULOMB: f64 =
    1e6 * ELEMENTARY_CHARGE * ELEMENTARY_CHARGE * AVOGADRO / (4.0 * PI * VACUUM_PERMITTIVITY);

/// Pairs that a sum over all pairs leaves out: for each particle those with a larger index, in order.
#[derive(Clone, Debug)]
pub(super) struct Exclusions {
    starts: Vec<usize>,
    partners: Vec<usize>,
}

impl Exclusions {
    pub(super) fn new(n: usize, pairs: impl Iterator<Item = [usize; 2]>) -> Self {
        let mut sorted: Vec<[usize; 2]> = pairs.map(|[i, j]| [i.min(j), i.max(j)]).collect();
        sorted.sort_unstable();
        sorted.dedup();
        let mut starts = vec![0; n + 1];
        for [i, _] in &sorted {
            starts[i + 1] += 1;
        }
        for i in 0..n {
            starts[i + 1] += starts[i];
        }
        Exclusions { starts, partners: sorted.into_iter().map(|[_, j]| j).collect() }
    }

    /// Ranges of the partners j > i of particle i that are not excluded.
    #[inline]
    pub(super) fn partners(&self, i: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
        let n = self.starts.len() - 1;
        let excluded = &self.partners[self.starts[i]..self.starts[i + 1]];
        let begins = [i + 1].into_iter().chain(excluded.iter().map(|j| j + 1));
        begins.zip(excluded.iter().copied().chain([n])).map(|(begin, end)| begin..end)
    }
}

#[derive(Clone, Debug)]
pub(super) struct NonbondedPairs {
    particles: Vec<Particle>,
    exclusions: Exclusions,
    /// Exceptions with an energy.
    exceptions: Vec<NonbondedException>,
    has_lennard_jones: bool,
}

/// q, σ/2, 2√ε.
#[derive(Clone, Copy, Debug)]
struct Particle {
    charge: f64,
    half_sigma: f64,
    twice_root_epsilon: f64,
}

impl NonbondedPairs {
    pub(super) fn new(tables: &Nonbonded) -> Self {
        let particles: Vec<Particle> = (tables.particles.iter())
            .map(|p| Particle {
                charge: p.charge,
                half_sigma: 0.5 * p.sigma,
                twice_root_epsilon: 2.0 * p.epsilon.sqrt(),
            })
            .collect();
        let exceptions = tables.exceptions.iter();
        NonbondedPairs {
            exclusions: Exclusions::new(particles.len(), exceptions.clone().map(|e| e.atoms)),
            exceptions: exceptions.filter(|e| e.charge_product != 0.0 || e.epsilon != 0.0).copied().collect(),
            has_lennard_jones: particles.iter().any(|p| p.twice_root_epsilon != 0.0),
            particles,
        }
    }

    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let all_pairs = if self.has_lennard_jones {
            self.all_pairs::<true>(x, forces)
        } else {
            self.all_pairs::<false>(x, forces)
        };
        let mut energy = 0.0;
        for exception in &self.exceptions {
            let (r, gradient) = distance(x, exception.atoms);
            let s2 = (exception.sigma / r) * (exception.sigma / r);
            let s6 = s2 * s2 * s2;
            let coulomb = COULOMB * exception.charge_product / r;
            energy += 4.0 * exception.epsilon * s6 * (s6 - 1.0) + coulomb;
            let force = gradient.scale((4.0 * exception.epsilon * s6 * (12.0 * s6 - 6.0) + coulomb) / r);
            forces[exception.atoms[0]] -= force;
            forces[exception.atoms[1]] += force;
        }
        all_pairs + energy
    }

    fn all_pairs<const LENNARD_JONES: bool>(&self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let mut energy = 0.0;
        for i in 0..x.len() {
            let (xi, a) = (x[i], self.particles[i]);
            let scaled_charge = COULOMB * a.charge;
            let (mut row, mut force_i) = (0.0, Vec3::zero());
            for partners in self.exclusions.partners(i) {
                for j in partners {
                    let b = self.particles[j];
                    let d = x[j] - xi;
                    let inverse_square = 1.0 / d.dot(d);
                    let coulomb = scaled_charge * b.charge * inverse_square.sqrt();
                    let (mut pair, mut slope) = (coulomb, coulomb);
                    if LENNARD_JONES {
                        let sigma = a.half_sigma + b.half_sigma;
                        let s2 = sigma * sigma * inverse_square;
                        let s6 = s2 * s2 * s2;
                        let scaled = a.twice_root_epsilon * b.twice_root_epsilon * s6;
                        pair += scaled * (s6 - 1.0);
                        slope += scaled * (12.0 * s6 - 6.0);
                    }
                    row += pair;
                    let force = d.scale(slope * inverse_square);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn excluded_pairs_are_left_out_once() {
        let pairs = [[2, 0], [0, 1], [1, 4], [0, 2], [0, 4]];
        let exclusions = Exclusions::new(5, pairs.into_iter());
        let partners = |i: usize| exclusions.partners(i).flatten().collect::<Vec<usize>>();
        assert_eq!(
            (0..5).map(partners).collect::<Vec<_>>(),
            [vec![3], vec![2, 3], vec![3, 4], vec![4], vec![]]
        );
    }
}
