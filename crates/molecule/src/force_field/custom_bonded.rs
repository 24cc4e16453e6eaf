//! Energies that are functions of one distance, angle or torsion.

use super::geometry::{angle, distance, push_angle, push_torsion, torsion};
use phipsi_formats::system::{CustomBonded, Formula, Slope};
use phipsi_spatial::Vec3;

#[derive(Clone, Debug)]
pub(super) struct CustomTerms<const N: usize> {
    energy: Formula,
    slope: Slope,
    atoms: Vec<[usize; N]>,
    parameters: Vec<f64>,
    count: usize,
    buffer: Vec<f64>,
}

impl<const N: usize> CustomTerms<N> {
    pub(super) fn new(tables: &CustomBonded<N>) -> Self {
        CustomTerms {
            energy: tables.energy.clone(),
            slope: tables.energy.slope(tables.coordinate),
            atoms: tables.atoms.clone(),
            parameters: tables.parameters.clone(),
            count: tables.parameter_names.len(),
            buffer: vec![0.0; tables.energy.slots()],
        }
    }

    pub(super) fn len(&self) -> usize {
        self.atoms.len()
    }

    /// Takes out the entries whose atoms are `held`.
    pub(super) fn take_out(&mut self, held: impl Fn(&[usize]) -> bool) -> Self {
        let (atoms, parameters) = (std::mem::take(&mut self.atoms), std::mem::take(&mut self.parameters));
        let (mut out, count) = (self.clone(), self.count);
        for (k, atoms) in atoms.into_iter().enumerate() {
            let to = if held(&atoms) { &mut out } else { &mut *self };
            to.atoms.push(atoms);
            to.parameters.extend_from_slice(&parameters[k * count..(k + 1) * count]);
        }
        out
    }

    /// The sum over all entries: `coordinate` measures one, `push` adds its forces for a slope of the energy.
    fn sum<G>(
        &mut self,
        coordinate: impl Fn([usize; N]) -> (f64, G),
        mut push: impl FnMut([usize; N], f64, G),
    ) -> f64 {
        let mut energy = 0.0;
        for (k, atoms) in self.atoms.iter().enumerate() {
            let (q, gradients) = coordinate(*atoms);
            self.buffer[0] = q;
            let parameters = &self.parameters[k * self.count..(k + 1) * self.count];
            self.buffer[1..=self.count].copy_from_slice(parameters);
            let mut slope = [0.0];
            energy += self.energy.value_and_slopes(&mut self.buffer, &[&self.slope], &mut slope);
            push(*atoms, slope[0], gradients);
        }
        energy
    }
}

impl CustomTerms<2> {
    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        self.sum(
            |atoms| distance(x, atoms),
            |[i, j], slope, gradient| {
                let force = gradient.scale(-slope);
                forces[i] -= force;
                forces[j] += force;
            },
        )
    }
}

impl CustomTerms<3> {
    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        self.sum(|atoms| angle(x, atoms), |atoms, slope, g| push_angle(forces, atoms, slope, g))
    }
}

impl CustomTerms<4> {
    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        self.sum(|atoms| torsion(x, atoms), |atoms, slope, g| push_torsion(forces, atoms, slope, g))
    }
}
