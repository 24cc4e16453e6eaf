//! Generalized Born energy with the radii of Onufriev, Bashford and Case (2004), and a surface energy (ACE).
//!
//! | symbol | meaning |
//! |---|---|
//! | ρᵢ, oᵢ, sⱼ | radius; radius less its offset; the size of j where it displaces solvent |
//! | U, L | r + sⱼ, max(oᵢ, \|r − sⱼ\|) |
//! | Iᵢ | ½ Σ [1/L − 1/U + ¼ (r − sⱼ²/r)(1/U² − 1/L²) + ½ ln(L/U)/r], over all j with U > oᵢ |
//! | | + 2 (1/oᵢ − 1/L) in the bracket where oᵢ < sⱼ − r, in GBSAOBCForce only |
//! | ψ, Bᵢ | Iᵢ oᵢ; 1/Bᵢ = 1/oᵢ − tanh(ψ − β ψ² + γ ψ³)/ρᵢ |
//! | f² | r² + Bᵢ Bⱼ e, e = exp(−r²/(4 Bᵢ Bⱼ)) |
//! | E | −κ₁ Σ qᵢ²/Bᵢ − κ₂ Σ_{i<j} qᵢ qⱼ (1/f − 1/r_c) + Σ cᵢ/Bᵢ⁶; without a cutoff r_c no 1/r_c |
//!
//! Method: sums over pairs for I (`born_integrals`), for E with ∂E/∂B (`born_pairs`), and for the chain rule ∂E/∂I ∂I/∂r
//! (`born_integrals` again, with the slopes that the first sum kept where there is room for them).

use super::born_integrals::{Chain, ChainAgain, Integrals, KEPT};
use super::born_pairs::Pairs;
use super::exclusions::Exclusions;
use super::neighbors::Neighbors;
use super::nonbonded::COULOMB;
use super::sweep::{Places, Sweep};
use super::tiles::{COLUMNS, ROWS};
use phipsi_formats::system::GbsaObc;
use phipsi_spatial::Vec3;
use phipsi_spatial::lanes::{Fused, Level};
use std::f64::consts::PI;

/// β and γ of OBC2.
pub(super) const OBC2: [f64; 2] = [0.8, 4.85];
/// Offset of the radii in GBSAOBCForce, nm.
const OFFSET: f64 = 0.009;
/// Radius of a water molecule in its surface energy, nm.
const PROBE: f64 = 0.14;

/// Most memory for numbers kept from one sum over pairs to another, bytes.
const MOST_KEPT: usize = 64 << 20;

/// Numbers of one particle that do not change.
#[derive(Clone, Copy, Debug)]
pub(super) struct Particle {
    pub charge: f64,
    /// o.
    pub offset_radius: f64,
    /// s.
    pub scaled_radius: f64,
    /// ρ in B.
    pub radius: f64,
    /// c, kJ/mol·nm⁶.
    pub surface: f64,
}

/// The numbers of sums over pairs, by places; those beyond the last particle are of no pair, and harmless.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    /// q, o, 1/o, s.
    pub charge: Vec<Fused>,
    pub offset_radius: Vec<Fused>,
    pub inverse_offset_radius: Vec<Fused>,
    pub scaled_radius: Vec<Fused>,
    /// B, 1/B; ∂E/∂I.
    pub born: Vec<Fused>,
    pub inverse_born: Vec<Fused>,
    pub slopes: Vec<Fused>,
}

#[derive(Clone, Debug)]
pub(super) struct GeneralizedBorn {
    particles: Vec<Particle>,
    constants: Constants,
    neighbors: Neighbors,
    places: Places,
    sweep: Sweep,
    most_kept: usize,
    columns: Columns,
    /// ∂B/∂I.
    by_integral: Vec<f64>,
}

/// The numbers of a model that no particle has.
#[derive(Clone, Copy, Debug)]
pub(super) struct Constants {
    /// κ₁, κ₂.
    pub kappa: [f64; 2],
    /// β, γ.
    pub obc: [f64; 2],
    /// True if an atom inside another one has the last part of the bracket.
    pub inside: bool,
    /// r_c.
    pub cutoff: Option<f64>,
    /// 1/r_c as it is in the energy.
    pub shift: f64,
}

impl GeneralizedBorn {
    pub(super) fn new(particles: Vec<Particle>, constants: Constants) -> Self {
        let n = particles.len();
        let neighbors = Neighbors::new(n, Exclusions::none(n), constants.cutoff);
        let tiles = neighbors.tiles();
        let padded = tiles.padded();
        let each = |f: fn(&Particle) -> f64, beyond: f64| {
            let mut all: Vec<Fused> = particles.iter().map(|p| Fused(f(p))).collect();
            all.resize(padded, Fused(beyond));
            all
        };
        let mut born = GeneralizedBorn {
            places: Places::new(padded),
            sweep: Sweep::default(),
            most_kept: MOST_KEPT,
            constants,
            neighbors,
            columns: Columns {
                charge: each(|p| p.charge, 0.0),
                offset_radius: each(|p| p.offset_radius, 1.0),
                inverse_offset_radius: each(|p| 1.0 / p.offset_radius, 1.0),
                scaled_radius: each(|p| p.scaled_radius, 0.0),
                born: vec![Fused(1.0); padded],
                inverse_born: vec![Fused(1.0); padded],
                slopes: vec![Fused(0.0); padded],
            },
            by_integral: vec![0.0; n],
            particles,
        };
        born.fit();
        born
    }

    /// Makes room for the pairs.
    fn fit(&mut self) {
        self.sweep.fit(self.neighbors.tiles(), if self.keeps() { KEPT } else { 0 });
    }

    /// True if slopes are kept between sums over pairs.
    fn keeps(&self) -> bool {
        let tiles: usize =
            self.neighbors.tiles().chunks().iter().map(|c| self.neighbors.tiles().count(c)).sum();
        tiles * ROWS * COLUMNS * KEPT * size_of::<f64>() <= self.most_kept
    }

    pub(super) fn from_gbsa_obc(tables: &GbsaObc) -> Self {
        let particle = |p: &phipsi_formats::system::GbsaParticle| {
            let offset_radius = p.radius - OFFSET;
            let probed = p.radius + PROBE;
            Particle {
                charge: p.charge,
                offset_radius,
                scaled_radius: p.scale * offset_radius,
                radius: p.radius,
                surface: 4.0 * PI * tables.surface_area_energy * probed * probed * p.radius.powi(6),
            }
        };
        let kappa = COULOMB * (1.0 / tables.solute_dielectric - 1.0 / tables.solvent_dielectric);
        let constants = Constants {
            kappa: [0.5 * kappa, kappa],
            obc: OBC2,
            inside: true,
            cutoff: tables.cutoff,
            shift: tables.cutoff.map_or(0.0, |cutoff| 1.0 / cutoff),
        };
        Self::new(tables.particles.iter().map(particle).collect(), constants)
    }

    pub(super) fn evaluate(&mut self, level: Level, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        if self.neighbors.update(x) {
            self.fit();
        }
        self.places.set(x);
        let Constants { kappa: [_, kappa], inside, cutoff, shift, .. } = self.constants;
        let cutoff_square = cutoff.map_or(f64::INFINITY, |cutoff| cutoff * cutoff);
        let keeps = self.keeps();
        let GeneralizedBorn { neighbors, places, sweep, columns, .. } = self;
        let tiles = neighbors.tiles();
        if keeps {
            let kernel = Integrals::<true> { columns, inside, cutoff_square };
            sweep.run(level, tiles, places, &kernel);
        } else {
            let kernel = Integrals::<false> { columns, inside, cutoff_square };
            sweep.run(level, tiles, places, &kernel);
        }
        self.radii();
        let own = self.single();
        let GeneralizedBorn { neighbors, places, sweep, columns, .. } = self;
        let tiles = neighbors.tiles();
        let pairs = sweep.run(level, tiles, places, &Pairs { columns, kappa, shift, cutoff_square });
        sweep.add_forces(tiles, forces);
        let slopes = columns.slopes.iter_mut().zip(sweep.sums(tiles, 3)).zip(&self.by_integral);
        for ((slope, by_pairs), by_integral) in slopes {
            slope.0 = (slope.0 + by_pairs.0) * by_integral;
        }
        if keeps {
            sweep.run(level, tiles, places, &Chain(columns));
        } else {
            let again = ChainAgain(Integrals { columns, inside, cutoff_square });
            sweep.run(level, tiles, places, &again);
        }
        sweep.add_forces(tiles, forces);
        own + pairs
    }

    /// B and ∂B/∂I.
    fn radii(&mut self) {
        let [beta, gamma] = self.constants.obc;
        let integrals = self.sweep.sums(self.neighbors.tiles(), 0);
        for (i, (a, integral)) in self.particles.iter().zip(integrals).enumerate() {
            let o = a.offset_radius;
            let psi = 0.5 * integral.0 * o;
            let tanh = (psi - beta * psi * psi + gamma * psi * psi * psi).tanh();
            let inverse = 1.0 / o - tanh / a.radius;
            let b = 1.0 / inverse;
            let slope =
                (1.0 - tanh * tanh) * (1.0 - 2.0 * beta * psi + 3.0 * gamma * psi * psi) * o / a.radius;
            self.columns.born[i] = Fused(b);
            self.columns.inverse_born[i] = Fused(inverse);
            self.by_integral[i] = b * b * slope;
        }
    }

    /// Energies of single particles; sets ∂E/∂B.
    fn single(&mut self) -> f64 {
        let mut energy = 0.0;
        let Columns { inverse_born, slopes, .. } = &mut self.columns;
        for ((a, inverse), slope) in self.particles.iter().zip(inverse_born).zip(slopes) {
            let inverse = inverse.0;
            let polar = -self.constants.kappa[0] * a.charge * a.charge * inverse;
            let surface = a.surface * inverse.powi(6);
            energy += polar + surface;
            slope.0 = -(polar + 6.0 * surface) * inverse;
        }
        energy
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::Random;

    #[test]
    fn slopes_kept_and_computed_again_are_the_same_bits() {
        let n = 150;
        let mut random = Random::new(1);
        let x: Vec<Vec3<f64>> = (0..n).map(|_| Vec3([(); 3].map(|()| 0.8 * random.signed()))).collect();
        let particle = |random: &mut Random| Particle {
            charge: random.signed(),
            offset_radius: 0.14,
            scaled_radius: 0.12 + 0.1 * random.uniform(),
            radius: 0.149,
            surface: 1e-8,
        };
        let particles: Vec<Particle> = (0..n).map(|_| particle(&mut random)).collect();
        for cutoff in [None, Some(0.6)] {
            for inside in [true, false] {
                let constants = Constants { kappa: [68.0, 136.0], obc: OBC2, inside, cutoff, shift: 0.3 };
                let mut kept = GeneralizedBorn::new(particles.clone(), constants);
                let mut again =
                    GeneralizedBorn { most_kept: 0, ..GeneralizedBorn::new(particles.clone(), constants) };
                again.fit();
                let evaluate = |born: &mut GeneralizedBorn| {
                    let mut forces = vec![Vec3([0.0; 3]); n];
                    (born.evaluate(Level::best(), &x, &mut forces), forces)
                };
                assert_eq!(evaluate(&mut kept), evaluate(&mut again));
                assert!(kept.keeps() && !again.keeps());
            }
        }
    }
}
