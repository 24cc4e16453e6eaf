//! Closed loops: dynamics, projection and assembly of mechanisms whose graph is not a tree.
//!
//! A [`phipsi_model::Closure`] joins two bodies of a tree; a [`phipsi_model::Coupling`] ties two joints. [`ClosedDynamics`]
//! solves the equations of motion with all of them in one inward and one outward sweep, at a cost linear in bodies and loops
//! where loops are local, whatever their rank: planar mechanisms, redundant closures and singular positions are no
//! exceptions.
//!
//! The same factorisation serves everything here: multipliers, the projection of velocities and positions onto the closures,
//! assembly from a rough guess.

// Kernels carry the papers' symbols: P, D, R, X.
#![allow(non_snake_case)]

pub mod assembly;
pub mod closed_dynamics;
pub mod closure_compliance;
mod compiled;
pub mod cut_joints;
pub mod error;
mod factors;
mod frames;
pub mod momenta;
mod number;
pub mod projection;
mod reflections;
mod rows;
mod solution;
mod structure;
mod tree;
pub mod tree_choice;

pub use assembly::{PositionProjection, VelocityProjection};
pub use closed_dynamics::{
    ClosedDynamics, ClosedForm, ClosedFormChoice, ClosedInfo, ClosureMotion, Conditions, HeavyBody,
    Prescribed, Solved,
};
pub use closure_compliance::{ClosureCompliance, closure_compliance};
pub use compiled::Number;
pub use cut_joints::{Cost, CutChoice, GraphJoint, TreeJoint, choose_cuts};
pub use error::ClosureError;
pub use factors::Redundant;
pub use momenta::{ClosedMomenta, Openness};
pub use projection::Projection;
pub use solution::Inconsistency;
pub use tree_choice::{TreeChoice, choose_tree};
