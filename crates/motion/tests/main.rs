//! Forces, integrators and their orders, on mechanisms with known motions.

mod closed_forms;
mod common;
mod events;
mod flexible;
mod forces;
mod integrators;
mod midpoint;
mod midpoint_loops;
mod rosenbrock;
mod satellites;
mod slider_crank;
mod stops;
mod wide;
