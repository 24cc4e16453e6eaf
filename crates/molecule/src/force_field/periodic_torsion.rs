//! Periodic torsions: E = Σ k (1 + cos(n φ − γ)), φ = π for trans.
//!
//! Terms of the same four atoms that follow each other share their geometry.

use super::geometry::{push_torsion, torsion};
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
}

/// n, γ, k.
#[derive(Clone, Debug)]
struct Wave {
    n: f64,
    gamma: f64,
    k: f64,
}

impl PeriodicTorsions {
    pub(super) fn new(entries: &[PeriodicTorsion]) -> Self {
        let mut torsions: Vec<Torsion> = Vec::new();
        let mut waves = Vec::new();
        for entry in entries {
            waves.push(Wave { n: f64::from(entry.periodicity), gamma: entry.phase, k: entry.stiffness });
            match torsions.last_mut() {
                Some(last) if last.atoms == entry.atoms => last.end = waves.len(),
                _ => torsions.push(Torsion { atoms: entry.atoms, end: waves.len() }),
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
            let (phi, gradients) = torsion(x, entry.atoms);
            let mut slope = 0.0;
            for wave in &self.waves[begin..entry.end] {
                let (sin, cos) = (wave.n * phi - wave.gamma).sin_cos();
                energy += wave.k * (1.0 + cos);
                slope -= wave.k * wave.n * sin;
            }
            begin = entry.end;
            push_torsion(forces, entry.atoms, slope, gradients);
        }
        energy
    }
}
