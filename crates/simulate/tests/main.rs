//! Scenes, runs, reports.

mod benchmarks;
mod loops;
mod molecule;
mod mutation;
mod report;
mod satellite;
mod scenes;
mod stress;
mod two_bodies;
