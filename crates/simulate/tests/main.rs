//! Scenes, runs, reports.

mod benchmarks;
mod elements;
mod loops;
mod molecule;
mod mutation;
mod report;
mod satellite;
mod scenes;
mod slider_crank;
mod two_bodies;
