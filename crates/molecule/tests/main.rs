//! Force fields, torsion models, ensembles.

mod chains;
mod common;
mod energies;
mod ensembles;
mod minimize;
mod nve;
mod pair_sums;
mod rings;
mod torsion_model;
mod velocities;
