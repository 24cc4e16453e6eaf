//! Molecules: rigid clusters of atoms joined by torsions as an ordinary model, force fields as ordinary forces.
//!
//! Units are OpenMM's: nm, ps, Da, kJ/mol, e, K.

mod angles;
pub mod assembly;
pub mod atoms;
pub mod bath;
pub mod bond_kind;
mod bridges;
mod center_of_mass;
pub mod clustering;
pub mod clusters;
pub mod constraints;
pub mod deviates;
pub mod ensemble;
pub mod files;
pub mod fixman;
pub mod force_field;
pub mod hybrid_monte_carlo;
mod langevin;
pub mod lbfgs;
mod lines;
mod masses;
pub mod minimize;
pub mod molecular_forces;
pub mod nose_hoover;
pub mod potential;
pub mod recluster;
mod ring_determinant;
mod rings;
mod roots;
mod superpose;
mod surface;
pub mod torsion_model;
pub mod velocities;

pub use angles::{Angles, Bend};
pub use assembly::{Assembled, assemble};
pub use atoms::{AtomName, Atoms, BOLTZMANN, MoleculeError, MoleculeErrors};
pub use bath::{Bath, BathState};
pub use bond_kind::BondKind;
pub use clustering::{Clustering, Hinges};
pub use clusters::{Clusters, HingeBond, LockedHinge};
pub use constraints::satisfied_constraints;
pub use deviates::{Deviates, DeviatesState};
pub use ensemble::Ensemble;
pub use files::{LoadedMolecule, Molecule, join, join_amber, read_molecule};
pub use fixman::{Distribution, FixmanForce, FixmanPotential, WithFixman, fixman_energy_of_rings};
pub use force_field::{ForceField, ForceFieldError, LeftOut, RigidGroups};
pub use hybrid_monte_carlo::Trials;
pub use lbfgs::{MinimizeOptions, Minimum};
pub use minimize::{Strain, minimize, strain};
pub use molecular_forces::{MolecularError, MolecularForces, PotentialForce};
pub use potential::{Potential, PotentialError};
pub use recluster::{Ledger, Reclustered, recluster};
pub use rings::Rings;
pub use torsion_model::{GatherWorkspace, Poses, TorsionModel};
pub use velocities::{draw_momenta, draw_velocities, sample_velocities, temperature};
