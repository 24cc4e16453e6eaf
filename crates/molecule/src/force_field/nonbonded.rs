//! Lennard-Jones and Coulomb energies of all pairs, without cutoff.
//!
//! | symbol | meaning |
//! |---|---|
//! | E | 4 ε [(σ/r)¹² − (σ/r)⁶] + K q q / r |
//! | σ, ε | (σᵢ + σⱼ)/2, √(εᵢ εⱼ) |
//! | K | 1/(4πε₀) in kJ/mol·nm/e² |
//! | slope | −E′/r: the force on the second atom is slope d |
//! | exceptions | pairs with a charge product, σ and ε of their own, in place of these |

use super::exclusions::Exclusions;
use super::geometry::distance;
use super::sweep::{At, PairKernel, Places, Sweep};
use super::tiles::Tiles;
use phipsi_formats::system::{Nonbonded, NonbondedException};
use phipsi_spatial::Vec3;
use phipsi_spatial::lanes::{Fused, Lanes, Level};
use std::f64::consts::PI;

/// Elementary charge, C, and Avogadro's number, 1/mol: exact since 2019. Vacuum permittivity, F/m: CODATA 2018, as OpenMM.
const ELEMENTARY_CHARGE: f64 = 1.602176634e-19;
const AVOGADRO: f64 = 6.02214076e23;
const VACUUM_PERMITTIVITY: f64 = 8.8541878128e-12;

/// 1/(4πε₀), kJ/mol·nm/e².
pub(super) const COULOMB: f64 =
    1e6 * ELEMENTARY_CHARGE * ELEMENTARY_CHARGE * AVOGADRO / (4.0 * PI * VACUUM_PERMITTIVITY);

#[derive(Clone, Debug)]
pub(super) struct NonbondedPairs {
    tiles: Tiles,
    places: Places,
    sweep: Sweep,
    particles: Particles,
    /// Exceptions with an energy.
    exceptions: Vec<NonbondedException>,
    has_lennard_jones: bool,
}

/// √K q, σ/2, 2√ε of each place.
#[derive(Clone, Debug)]
struct Particles {
    charge: Vec<Fused>,
    half_sigma: Vec<Fused>,
    twice_root_epsilon: Vec<Fused>,
}

impl NonbondedPairs {
    pub(super) fn new(tables: &Nonbonded) -> Self {
        let n = tables.particles.len();
        let exceptions = tables.exceptions.iter();
        let tiles = Tiles::all_pairs(n, &Exclusions::new(n, exceptions.clone().map(|e| e.atoms)));
        let padded = tiles.padded();
        let each = |f: fn(&phipsi_formats::system::NonbondedParticle) -> f64| {
            let mut all: Vec<Fused> = tables.particles.iter().map(|p| Fused(f(p))).collect();
            all.resize(padded, Fused(0.0));
            all
        };
        NonbondedPairs {
            places: Places::new(padded),
            sweep: Sweep::new(&tiles, 0),
            tiles,
            particles: Particles {
                charge: each(|p| COULOMB.sqrt() * p.charge),
                half_sigma: each(|p| 0.5 * p.sigma),
                twice_root_epsilon: each(|p| 2.0 * p.epsilon.sqrt()),
            },
            exceptions: exceptions.filter(|e| e.charge_product != 0.0 || e.epsilon != 0.0).copied().collect(),
            has_lennard_jones: tables.particles.iter().any(|p| p.epsilon != 0.0),
        }
    }

    pub(super) fn evaluate(&mut self, level: Level, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let NonbondedPairs { tiles, places, sweep, particles, .. } = self;
        places.set(x);
        let all_pairs = if self.has_lennard_jones {
            sweep.run(level, tiles, places, &Pairs::<true>(particles))
        } else {
            sweep.run(level, tiles, places, &Pairs::<false>(particles))
        };
        sweep.add_forces(tiles, forces);
        all_pairs + self.exceptions(x, forces)
    }

    fn exceptions(&self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
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
        energy
    }
}

/// The sum over pairs that have no exception; with Lennard-Jones energies or without.
struct Pairs<'a, const LENNARD_JONES: bool>(&'a Particles);

impl<const LENNARD_JONES: bool> PairKernel<3> for Pairs<'_, LENNARD_JONES> {
    type Row<T: Lanes> = [T; 3];
    type Column<T: Lanes> = [T; 3];

    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> [T; 3] {
        let Particles { charge, half_sigma, twice_root_epsilon } = self.0;
        [
            T::broadcast(charge[place]),
            T::broadcast(half_sigma[place]),
            T::broadcast(twice_root_epsilon[place]),
        ]
    }
    #[inline(always)]
    fn column<T: Lanes>(&self, first: usize) -> [T; 3] {
        let Particles { charge, half_sigma, twice_root_epsilon } = self.0;
        [T::load(&charge[first..]), T::load(&half_sigma[first..]), T::load(&twice_root_epsilon[first..])]
    }
    #[inline(always)]
    fn pair<T: Lanes>(
        &self,
        row: &[T; 3],
        column: &[T; 3],
        at: At<'_, T>,
        row_sums: &mut [T; 3],
        column_sums: &mut [T; 3],
    ) -> T {
        let inverse = at.square.reciprocal_root();
        // Of coincident atoms it is infinite, and the force then not a number.
        let inverse_square = inverse * inverse;
        let coulomb = at.only(row[0] * column[0]) * inverse;
        let (mut energy, mut slope) = (coulomb, coulomb);
        if LENNARD_JONES {
            let sigma = row[1] + column[1];
            let s2 = sigma * sigma * inverse_square;
            let s6 = s2 * s2 * s2;
            let scaled = at.only(row[2] * column[2]) * s6;
            energy = scaled.fma(s6 - T::one(), energy);
            slope = scaled.fma(s6.fma(T::splat(12.0), T::splat(-6.0)), slope);
        }
        let slope = slope * inverse_square;
        let opposite = -slope;
        for k in 0..3 {
            row_sums[k] = opposite.fma(at.d[k], row_sums[k]);
            column_sums[k] = slope.fma(at.d[k], column_sums[k]);
        }
        energy
    }
}
