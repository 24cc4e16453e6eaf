//! Kernels against their dense twins, identities, the papers. One binary: every test of a file of its own would compile every
//! kernel again. `batch`, whose lanes are another set of copies, is the second.

mod against_reference;
mod allocation;
mod branches;
mod common;
mod derivatives;
mod diagonal_dynamics;
mod errors;
mod estimation;
mod flexible;
mod flexible_beams;
mod flexible_errors;
mod forms;
mod hybrid_dynamics;
mod identities;
mod jacobian_family;
mod operators;
mod papers;
mod scalars;
mod sensitivities;
