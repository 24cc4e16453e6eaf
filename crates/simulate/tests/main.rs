//! Scenes, runs, reports.

mod benchmarks;
mod elements;
mod estimate;
mod estimate_beside;
mod events;
mod loops;
mod molecule;
mod mutation;
mod recluster;
mod report;
mod satellite;
mod scenes;
mod slider_crank;
mod stress;
mod two_bodies;
