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
//! | E | −κ₁ Σ qᵢ²/Bᵢ − κ₂ Σ_{i<j} qᵢ qⱼ/f + Σ cᵢ/Bᵢ⁶ |
//!
//! L and U depend on r, but their slopes cancel in ∂I/∂r, except where the atom i lies inside j and the last part of the
//! bracket is missing: 2/L² remains there.
//!
//! Method: sums over pairs for I, then for E with ∂E/∂B, then for the chain rule ∂E/∂I ∂I/∂r.

use super::nonbonded::COULOMB;
use phipsi_formats::system::GbsaObc;
use phipsi_spatial::Vec3;
use std::f64::consts::PI;

/// β and γ of OBC2.
pub(super) const OBC2: [f64; 2] = [0.8, 4.85];
/// Offset of the radii in GBSAOBCForce, nm.
const OFFSET: f64 = 0.009;
/// Radius of a water molecule in its surface energy, nm.
const PROBE: f64 = 0.14;

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

#[derive(Clone, Debug)]
pub(super) struct GeneralizedBorn {
    particles: Vec<Particle>,
    /// κ₁, κ₂.
    kappa: [f64; 2],
    /// β, γ.
    obc: [f64; 2],
    /// True if an atom inside another one has the last part of the bracket.
    inside: bool,
    /// B and ∂B/∂I, then ∂E/∂B, which becomes ∂E/∂I.
    born: Vec<[f64; 2]>,
    slopes: Vec<f64>,
}

impl GeneralizedBorn {
    pub(super) fn new(particles: Vec<Particle>, kappa: [f64; 2], obc: [f64; 2], inside: bool) -> Self {
        let n = particles.len();
        GeneralizedBorn { particles, kappa, obc, inside, born: vec![[0.0; 2]; n], slopes: vec![0.0; n] }
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
        Self::new(tables.particles.iter().map(particle).collect(), [0.5 * kappa, kappa], OBC2, true)
    }

    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        self.radii(x);
        let energy = self.single() + self.pairs(x, forces);
        for (slope, [_, by_integral]) in self.slopes.iter_mut().zip(&self.born) {
            *slope *= by_integral;
        }
        self.chain(x, forces);
        energy
    }

    /// B and ∂B/∂I.
    fn radii(&mut self, x: &[Vec3<f64>]) {
        let integrals = &mut self.slopes;
        integrals.fill(0.0);
        for i in 0..x.len() {
            let a = self.particles[i];
            for j in i + 1..x.len() {
                let b = self.particles[j];
                let r = (x[j] - x[i]).norm();
                integrals[i] += bracket(r, a.offset_radius, b.scaled_radius, self.inside);
                integrals[j] += bracket(r, b.offset_radius, a.scaled_radius, self.inside);
            }
        }
        let [beta, gamma] = self.obc;
        for ((integral, a), born) in integrals.iter().zip(&self.particles).zip(&mut self.born) {
            let o = a.offset_radius;
            let psi = 0.5 * integral * o;
            let tanh = (psi - beta * psi * psi + gamma * psi * psi * psi).tanh();
            let b = 1.0 / (1.0 / o - tanh / a.radius);
            let slope =
                (1.0 - tanh * tanh) * (1.0 - 2.0 * beta * psi + 3.0 * gamma * psi * psi) * o / a.radius;
            *born = [b, b * b * slope];
        }
    }

    /// Energies of single particles; sets ∂E/∂B.
    fn single(&mut self) -> f64 {
        let mut energy = 0.0;
        for ((a, [b, _]), slope) in self.particles.iter().zip(&self.born).zip(&mut self.slopes) {
            let polar = -self.kappa[0] * a.charge * a.charge / b;
            let surface = a.surface / (b * b * b * b * b * b);
            energy += polar + surface;
            *slope = -(polar + 6.0 * surface) / b;
        }
        energy
    }

    /// Energies of pairs; adds to ∂E/∂B and to the forces at constant B.
    fn pairs(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let mut energy = 0.0;
        for i in 0..x.len() {
            let (scaled_charge, bi) = (-self.kappa[1] * self.particles[i].charge, self.born[i][0]);
            let (mut row, mut slope_i, mut force_i) = (0.0, 0.0, Vec3::zero());
            for j in i + 1..x.len() {
                let bj = self.born[j][0];
                let d = x[j] - x[i];
                let square = d.dot(d);
                let product = bi * bj;
                let e = (-square / (4.0 * product)).exp();
                let f2 = square + product * e;
                let pair = scaled_charge * self.particles[j].charge / f2.sqrt();
                row += pair;
                let by_f2 = -0.5 * pair / f2;
                slope_i += by_f2 * e * (bj + square / (4.0 * bi));
                self.slopes[j] += by_f2 * e * (bi + square / (4.0 * bj));
                let force = d.scale(-2.0 * by_f2 * (1.0 - 0.25 * e));
                force_i -= force;
                forces[j] += force;
            }
            energy += row;
            self.slopes[i] += slope_i;
            forces[i] += force_i;
        }
        energy
    }

    /// Adds the forces through the radii; `slopes` are ∂E/∂I.
    fn chain(&self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) {
        for i in 0..x.len() {
            let a = self.particles[i];
            let mut force_i = Vec3::zero();
            for j in i + 1..x.len() {
                let b = self.particles[j];
                let d = x[j] - x[i];
                let r = d.norm();
                let slope = self.slopes[i] * bracket_slope(r, a.offset_radius, b.scaled_radius, self.inside)
                    + self.slopes[j] * bracket_slope(r, b.offset_radius, a.scaled_radius, self.inside);
                let force = d.scale(-0.5 * slope / r);
                force_i -= force;
                forces[j] += force;
            }
            forces[i] += force_i;
        }
    }
}

/// The bracket in I.
#[inline]
fn bracket(r: f64, o: f64, s: f64, inside: bool) -> f64 {
    let upper = r + s;
    if upper <= o {
        return 0.0;
    }
    let lower = o.max((r - s).abs());
    let (inverse_u, inverse_l) = (1.0 / upper, 1.0 / lower);
    let squares = inverse_u * inverse_u - inverse_l * inverse_l;
    let mut sum = inverse_l - inverse_u + 0.25 * (r - s * s / r) * squares + 0.5 * (lower / upper).ln() / r;
    if inside && o < s - r {
        sum += 2.0 * (1.0 / o - inverse_l);
    }
    sum
}

/// Its slope in r.
#[inline]
fn bracket_slope(r: f64, o: f64, s: f64, inside: bool) -> f64 {
    let upper = r + s;
    if upper <= o {
        return 0.0;
    }
    let lower = o.max((r - s).abs());
    let (inverse_u, inverse_l) = (1.0 / upper, 1.0 / lower);
    let squares = inverse_u * inverse_u - inverse_l * inverse_l;
    let inverse_r2 = 1.0 / (r * r);
    let mut sum = 0.25 * (1.0 + s * s * inverse_r2) * squares - 0.5 * (lower / upper).ln() * inverse_r2;
    if !inside && o < s - r {
        sum += 2.0 * inverse_l * inverse_l;
    }
    sum
}
