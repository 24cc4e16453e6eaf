//! Harmonic springs: E = ½ k (r − r₀)².

use super::geometry::distance;
use phipsi_formats::system::HarmonicBond;
use phipsi_spatial::Vec3;

#[derive(Clone, Debug)]
pub(super) struct HarmonicBonds {
    bonds: Vec<HarmonicBond>,
}

impl HarmonicBonds {
    pub(super) fn new(bonds: &[HarmonicBond]) -> Self {
        HarmonicBonds { bonds: bonds.to_vec() }
    }

    pub(super) fn len(&self) -> usize {
        self.bonds.len()
    }

    /// Takes out the entries whose atoms are `held`.
    pub(super) fn take_out(&mut self, held: impl Fn(&[usize]) -> bool) -> Self {
        let all = std::mem::take(&mut self.bonds);
        let (out, rest) = all.into_iter().partition(|bond| held(&bond.atoms));
        self.bonds = rest;
        HarmonicBonds { bonds: out }
    }

    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let mut energy = 0.0;
        for bond in &self.bonds {
            let (r, gradient) = distance(x, bond.atoms);
            let stretch = r - bond.length;
            energy += 0.5 * bond.stiffness * stretch * stretch;
            let force = gradient.scale(-bond.stiffness * stretch);
            forces[bond.atoms[0]] -= force;
            forces[bond.atoms[1]] += force;
        }
        energy
    }
}
