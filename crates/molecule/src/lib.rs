//! Molecules: rigid clusters of atoms joined by torsions as an ordinary model, force fields as ordinary forces.
//!
//! Units are OpenMM's: nm, ps, Da, kJ/mol, e, K.

pub mod force_field;
pub mod potential;

pub use force_field::{ForceField, ForceFieldError};
pub use potential::{Potential, PotentialError};
