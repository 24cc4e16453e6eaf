//! Harmonic angles: E = ½ k (θ − θ₀)².

use super::geometry::{angle, push_angle};
use phipsi_formats::system::HarmonicAngle;
use phipsi_spatial::Vec3;

#[derive(Clone, Debug)]
pub(super) struct HarmonicAngles {
    angles: Vec<HarmonicAngle>,
}

impl HarmonicAngles {
    pub(super) fn new(angles: &[HarmonicAngle]) -> Self {
        HarmonicAngles { angles: angles.to_vec() }
    }

    pub(super) fn len(&self) -> usize {
        self.angles.len()
    }

    /// Takes out the entries whose atoms are `held`.
    pub(super) fn take_out(&mut self, held: impl Fn(&[usize]) -> bool) -> Self {
        let all = std::mem::take(&mut self.angles);
        let (out, rest) = all.into_iter().partition(|angle| held(&angle.atoms));
        self.angles = rest;
        HarmonicAngles { angles: out }
    }

    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let mut energy = 0.0;
        for entry in &self.angles {
            let (theta, gradients) = angle(x, entry.atoms);
            let bend = theta - entry.angle;
            energy += 0.5 * entry.stiffness * bend * bend;
            push_angle(forces, entry.atoms, entry.stiffness * bend, gradients);
        }
        energy
    }
}
