//! Potential energies of atoms.

use phipsi_spatial::Vec3;
use std::fmt;

/// A potential energy of the positions of all atoms, in named terms.
pub trait Potential: Send {
    /// Names of the terms, in the order of the energies.
    fn terms(&self) -> &[String];
    /// True if turning all atoms together changes no energy: forces then keep the angular momentum. False in a periodic box.
    fn is_isotropic(&self) -> bool {
        true
    }
    /// Energies of the terms, kJ/mol, and the force on every atom, kJ/mol/nm (both overwritten), at positions in nm.
    ///
    /// # Errors
    /// [`PotentialError`] with the atoms where a term is not finite.
    fn evaluate(
        &mut self,
        positions: &[Vec3<f64>],
        energies: &mut [f64],
        forces: &mut [Vec3<f64>],
    ) -> Result<(), PotentialError>;
}

/// A potential that has no value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PotentialError {
    /// The term.
    pub term: String,
    /// The atoms, counted from 0.
    pub atoms: Vec<usize>,
    /// What happened and what to do.
    pub message: String,
}

impl fmt::Display for PotentialError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "term `{}`, atoms {:?}: {}", self.term, self.atoms, self.message)
    }
}

impl std::error::Error for PotentialError {}
