//! Trees with flexible bodies: what the public functions of this crate run on if a layout has modal coordinates.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | y | [η̇; V]: rates of the modal coordinates, and velocity of the floating frame F | soa.md 3.10 |
//! | A_t | [Π_t, X_t]: node t's velocity is A_t y | notes/flexible.md 2 |
//! | L | [[1, 0], [Γ, X_d⁻¹]]: the hinge frame in place of F | notes/flexible.md 5 |
//! | D_M, G_M | P′_ee, P′_de D_M⁻¹: articulated inertia and gain of the modes | Jain and Rodriguez 1992, tree form |
//! | Υ | base-to-tip recursion whose blocks are diagonal blocks of Ω | paper 1 (10.2) |
//!
//! Coordinates of a model are all joints as ever, then the modes of its flexible bodies. The modes of a body are eliminated
//! before its joint, so that 6×6 quantities alone travel from body to body and a joint meets the rigid filter's own steps. Modal
//! generalised forces are the last entries of τ: an actuator's on the modes; strain and damping act by themselves.
//!
//! A model without modes runs on the rigid kernels, unchanged; an algorithm that knows no modes refuses them with
//! [`Flexible`](crate::DynamicsError::Flexible). Frames of a flexible body are its floating frame F; wrenches on it act at F, those on its nodes
//! are wrenches on a (massless) body on a fixed joint there.

mod body;
mod composite;
mod filter;
mod motions;
mod newton_euler;
mod sensitivity;
mod stations;
mod tangent;
mod tree;
mod workspaces;

pub(crate) use composite::Composite;
pub(crate) use filter::Filter;
pub(crate) use newton_euler::NewtonEuler;
pub(crate) use sensitivity::first_singular;
pub use sensitivity::{log_determinant, log_determinant_gradient};
pub use stations::{HeldBody, Station, StationJoint};
pub(crate) use tangent::{Map, derivatives};
pub(crate) use tree::{FlexibleTree, rigid_inboard, rigid_node};
pub(crate) use workspaces::{Forward, Inverse, Placing, Solution};

use crate::layout::{GROUND, Layout};
use phipsi_spatial::{Scalar, Transform, Wrench};

/// Minus the user's external wrenches (one per body of the model, its frame), each at its carrier.
pub(crate) fn gather_loads<T: Scalar>(
    layout: &Layout<T::Constant>,
    wrenches: &[Wrench<T>],
    loads: &mut [Wrench<T>],
) {
    loads.fill(Wrench::zero());
    for (carrier, wrench) in layout.carriers().iter().zip(wrenches) {
        if carrier.body != GROUND {
            loads[carrier.body] -= Transform::constant(&carrier.pose).wrench_to_parent(*wrench);
        }
    }
}
