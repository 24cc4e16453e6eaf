//! Force fields, torsion models, ensembles.

mod chains;
mod common;
mod energies;
mod ensembles;
mod lines;
mod minimize;
mod multiple_steps;
mod nve;
mod pair_sums;
mod recluster;
mod ring_densities;
mod rings;
mod straight;
mod torsion_model;
mod velocities;
