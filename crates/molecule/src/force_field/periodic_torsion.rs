//! Periodic torsions: E = Σ k (1 + cos(n φ − γ)), φ = π for trans.
//!
//! Terms of the same four atoms that follow each other share their geometry. cos nφ and sin nφ are the parts of (cos φ + i sin φ)ⁿ:
//! no angle is taken, and no sine. Terms without an energy, as force fields have them about atoms on a line, are not looked at.

use super::geometry::{push_torsion, torsion_cos_sin};
use phipsi_formats::system::PeriodicTorsion;
use phipsi_spatial::Vec3;

#[derive(Clone, Debug)]
pub(super) struct PeriodicTorsions {
    torsions: Vec<Torsion>,
    waves: Vec<Wave>,
}

#[derive(Clone, Debug)]
struct Torsion {
    atoms: [usize; 4],
    /// Its waves end here, and begin where those of the torsion before end.
    end: usize,
    /// All of them have k = 0.
    is_flat: bool,
}

/// n, cos γ and sin γ, k.
#[derive(Clone, Debug)]
struct Wave {
    n: u32,
    phase: [f64; 2],
    k: f64,
}

impl PeriodicTorsions {
    pub(super) fn new(entries: &[PeriodicTorsion]) -> Self {
        let mut torsions: Vec<Torsion> = Vec::new();
        let mut waves = Vec::new();
        for entry in entries {
            let (sin, cos) = entry.phase.sin_cos();
            waves.push(Wave { n: entry.periodicity, phase: [cos, sin], k: entry.stiffness });
            match torsions.last_mut() {
                Some(last) if last.atoms == entry.atoms => {
                    last.end = waves.len();
                    last.is_flat &= entry.stiffness == 0.0;
                }
                _ => {
                    let is_flat = entry.stiffness == 0.0;
                    torsions.push(Torsion { atoms: entry.atoms, end: waves.len(), is_flat });
                }
            }
        }
        PeriodicTorsions { torsions, waves }
    }

    pub(super) fn len(&self) -> usize {
        self.waves.len()
    }

    /// Takes out the torsions whose atoms are `held`.
    pub(super) fn take_out(&mut self, held: impl Fn(&[usize]) -> bool) -> Self {
        let empty = || PeriodicTorsions { torsions: Vec::new(), waves: Vec::new() };
        let PeriodicTorsions { torsions, waves } = std::mem::replace(self, empty());
        let (mut out, mut begin) = (empty(), 0);
        for torsion in torsions {
            let to = if held(&torsion.atoms) { &mut out } else { &mut *self };
            to.waves.extend_from_slice(&waves[begin..torsion.end]);
            begin = torsion.end;
            to.torsions.push(Torsion { end: to.waves.len(), ..torsion });
        }
        out
    }

    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let mut energy = 0.0;
        let mut begin = 0;
        for entry in &self.torsions {
            if entry.is_flat {
                begin = entry.end;
                continue;
            }
            let (z, gradients) = torsion_cos_sin(x, entry.atoms);
            let square = times(z, z);
            let powers = [[1.0, 0.0], z, square, times(square, z), times(square, square)];
            let mut slope = 0.0;
            for wave in &self.waves[begin..entry.end] {
                let known = powers.get(wave.n as usize).copied();
                let [cos, sin] = known.unwrap_or_else(|| power(z, wave.n));
                let [cos_gamma, sin_gamma] = wave.phase;
                energy += wave.k * (1.0 + (cos * cos_gamma + sin * sin_gamma));
                slope -= wave.k * f64::from(wave.n) * (sin * cos_gamma - cos * sin_gamma);
            }
            begin = entry.end;
            push_torsion(forces, entry.atoms, slope, gradients);
        }
        energy
    }
}

/// The product of complex numbers.
#[inline]
fn times([a, b]: [f64; 2], [c, d]: [f64; 2]) -> [f64; 2] {
    [a * c - b * d, a * d + b * c]
}

/// zⁿ.
fn power(mut z: [f64; 2], mut n: u32) -> [f64; 2] {
    let mut product = [1.0, 0.0];
    while n > 0 {
        if n & 1 == 1 {
            product = times(product, z);
        }
        z = times(z, z);
        n >>= 1;
    }
    product
}
