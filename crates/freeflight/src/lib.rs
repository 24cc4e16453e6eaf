//! Free-flying systems: which body is called the base does not matter.
//!
//! Two sequences cross the tree independently (paper 2 §4.8). The one from the tips knows what is outboard of each joint, the
//! other, from the root, what is inboard of it; neither uses what the other knows. Their results are two uncorrelated
//! estimates of the force at a joint, and combine as Fraser and Potter's: weights are inertias, and every body's
//! acceleration comes out by itself, from a 6 × 6 system of its own.
//!
//! [`TwoSided`] runs both directions for any pattern of active and passive joints: all passive is forward dynamics (the
//! articulated recursion, ψ), all active inverse dynamics with a floating base (the rigid one, φ). [`TwoSided::inertia`] is
//! the inertia that a force feels at any body, of all bodies from one pass.
//!
//! Free-flyer practice: [`SpaceJacobian`] (velocities at zero momentum), [`reactionless_basis`] (joint motions that leave the base alone).
//! Centre of mass and momentum are `phipsi_recursion::{center_of_mass, momentum}`.

// Kernels carry the papers' symbols.
#![allow(non_snake_case)]

mod error;
mod solve;
mod space_jacobian;
mod two_sided;

pub use error::FreeFlightError;
pub use space_jacobian::{ReactionlessBasis, SpaceJacobian, reactionless_basis};
pub use two_sided::TwoSided;
