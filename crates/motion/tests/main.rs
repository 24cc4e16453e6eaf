//! Forces, integrators and their orders, on mechanisms with known motions.

mod closed_forms;
mod common;
mod flexible;
mod forces;
mod integrators;
mod midpoint;
mod midpoint_loops;
mod rosenbrock;
mod slider_crank;
mod wide;
