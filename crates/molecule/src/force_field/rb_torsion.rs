//! Torsions of Ryckaert and Bellemans: E = Σ Cₙ cosⁿ ψ, ψ = φ − π, so that ψ = 0 for trans.

use super::geometry::{push_torsion, torsion};
use phipsi_formats::system::RbTorsion;
use phipsi_spatial::Vec3;

#[derive(Clone, Debug)]
pub(super) struct RbTorsions {
    torsions: Vec<RbTorsion>,
}

impl RbTorsions {
    pub(super) fn new(torsions: &[RbTorsion]) -> Self {
        RbTorsions { torsions: torsions.to_vec() }
    }

    pub(super) fn len(&self) -> usize {
        self.torsions.len()
    }

    /// Takes out the entries whose atoms are `held`.
    pub(super) fn take_out(&mut self, held: impl Fn(&[usize]) -> bool) -> Self {
        let all = std::mem::take(&mut self.torsions);
        let (out, rest) = all.into_iter().partition(|torsion| held(&torsion.atoms));
        self.torsions = rest;
        RbTorsions { torsions: out }
    }

    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let mut energy = 0.0;
        for entry in &self.torsions {
            // A constant has no slope, also where three atoms lie on a line.
            if entry.coefficients[1..].iter().all(|c| *c == 0.0) {
                energy += entry.coefficients[0];
                continue;
            }
            let (phi, gradients) = torsion(x, entry.atoms);
            let (sin, cos) = phi.sin_cos();
            let (sin_psi, cos_psi) = (-sin, -cos);
            // Horner's scheme for the polynomial in cos ψ and its derivative.
            let (mut value, mut derivative) = (0.0, 0.0);
            for c in entry.coefficients.iter().rev() {
                derivative = derivative * cos_psi + value;
                value = value * cos_psi + c;
            }
            energy += value;
            push_torsion(forces, entry.atoms, -sin_psi * derivative, gradients);
        }
        energy
    }
}
