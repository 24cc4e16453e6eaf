//! Pairs at their nearest images in a periodic box.
//!
//! | symbol | meaning |
//! |---|---|
//! | a, b, c | box vectors in reduced form: a = (aₓ, 0, 0), b = (bₓ, b_y, 0) |
//! | d | d − c round(d_z/c_z), then − b round(d_y/b_y), then − a round(d_x/a_x) |
//!
//! The image is the nearest wherever that is closer than half of the box's widths, as within a cutoff it is (OpenMM, theory of
//! NonbondedForce).
//!
//! The mean Lennard-Jones energy beyond the cutoff, with the switching function S (OpenMM, the same):
//! E = 8πN²/V ⟨∫_{r_s}^{∞} (1 − S) ε [(σ/r)¹² − (σ/r)⁶] r² dr⟩, the mean over all N(N+1)/2 pairs, each with itself too.

use phipsi_formats::system::{Cutoff, NonbondedParticle, Periodic};
use phipsi_spatial::Vec3;
use phipsi_spatial::lanes::Lanes;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Added and taken away, it leaves the nearest integer.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// Points of a quadrature over the switched interval, in parts of which the integrand is a polynomial but for powers of r.
const PARTS: usize = 64;

/// Of Gauss and Legendre, three points.
const GAUSS: [[f64; 2]; 3] =
    [[-0.774_596_669_241_483_4, 5.0 / 9.0], [0.0, 8.0 / 9.0], [0.774_596_669_241_483_4, 5.0 / 9.0]];

/// A box.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearestImage {
    vectors: [[f64; 3]; 3],
    inverse: [f64; 3],
}

impl NearestImage {
    pub(super) fn new(periodic: &Periodic) -> Self {
        let vectors = periodic.box_vectors;
        NearestImage { vectors, inverse: [0, 1, 2].map(|k| 1.0 / vectors[k][k]) }
    }
    /// d at its nearest image.
    #[inline(always)]
    pub(super) fn shift<T: Lanes>(&self, d: &mut [T; 3]) {
        let rounder = T::splat(ROUNDER);
        for k in [2, 1, 0] {
            let turns = (d[k] * T::splat(self.inverse[k]) + rounder) - rounder;
            for i in 0..=k {
                d[i] -= turns * T::splat(self.vectors[k][i]);
            }
        }
    }
    /// The same of a vector.
    pub(super) fn of(&self, mut d: Vec3<f64>) -> Vec3<f64> {
        for k in [2, 1, 0] {
            let turns = (d.0[k] * self.inverse[k] + ROUNDER) - ROUNDER;
            d -= Vec3(self.vectors[k]).scale(turns);
        }
        d
    }
    /// The box vectors.
    pub(super) fn vectors(&self) -> [Vec3<f64>; 3] {
        self.vectors.map(Vec3)
    }
    /// Coordinates along the box vectors.
    pub(super) fn fractions(&self, mut x: Vec3<f64>) -> [f64; 3] {
        let mut s = [0.0; 3];
        for k in [2, 1, 0] {
            s[k] = x.0[k] * self.inverse[k];
            x -= Vec3(self.vectors[k]).scale(s[k]);
        }
        s
    }
    /// The distance of the two faces across each box vector.
    pub(super) fn face_distances(&self) -> [f64; 3] {
        let v = self.vectors();
        [0, 1, 2].map(|k| self.volume() / v[(k + 1) % 3].cross(v[(k + 2) % 3]).norm())
    }
    /// The least width.
    pub(super) fn width(&self) -> f64 {
        (0..3).map(|k| self.vectors[k][k]).fold(f64::INFINITY, f64::min)
    }
    fn volume(&self) -> f64 {
        (0..3).map(|k| self.vectors[k][k]).product()
    }
    /// The mean Lennard-Jones energy beyond the cutoff, kJ/mol. Cost: of the square of the number of kinds of particles.
    pub(super) fn dispersion(&self, particles: &[NonbondedParticle], cutoff: Cutoff) -> f64 {
        let mut kinds: BTreeMap<[u64; 2], usize> = BTreeMap::new();
        for p in particles {
            *kinds.entry([p.sigma.to_bits(), p.epsilon.to_bits()]).or_default() += 1;
        }
        let kinds: Vec<(f64, f64, f64)> = kinds
            .into_iter()
            .map(|([sigma, epsilon], n)| (f64::from_bits(sigma), f64::from_bits(epsilon), n as f64))
            .collect();
        let mut sum = 0.0;
        for (i, a) in kinds.iter().enumerate() {
            for (j, b) in kinds[..=i].iter().enumerate() {
                let pairs = if i == j { 0.5 * a.2 * (a.2 + 1.0) } else { a.2 * b.2 };
                let epsilon = (a.1 * b.1).sqrt();
                if epsilon > 0.0 {
                    sum += pairs * epsilon * beyond(0.5 * (a.0 + b.0), cutoff);
                }
            }
        }
        let n = particles.len() as f64;
        8.0 * PI * n * n / self.volume() * sum / (0.5 * n * (n + 1.0))
    }
}

/// ∫ (1 − S) [(σ/r)¹² − (σ/r)⁶] r² dr from where switching begins.
fn beyond(sigma: f64, cutoff: Cutoff) -> f64 {
    let energy = |r: f64| {
        let s6 = (sigma / r).powi(6);
        (s6 * s6 - s6) * r * r
    };
    let (end, s6) = (cutoff.distance, (sigma / cutoff.distance).powi(6));
    let mut sum = end.powi(3) * (s6 * s6 / 9.0 - s6 / 3.0);
    if let Some(start) = cutoff.switching {
        let half = 0.5 * (end - start) / PARTS as f64;
        for part in 0..PARTS {
            for [x, weight] in GAUSS {
                let r = start + half * (2.0 * part as f64 + 1.0 + x);
                let t = (r - start) / (end - start);
                sum += half * weight * t.powi(3) * (10.0 - 15.0 * t + 6.0 * t * t) * energy(r);
            }
        }
    }
    sum
}
