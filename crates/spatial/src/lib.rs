//! Six-vectors, rigid transforms, inertias and the scalar trait of the spatial operator algebra.
//!
//! Conventions: six-vectors are angular first. A [`Motion`] is (ω, v), a [`Wrench`] is (n, f), both of the body-frame
//! origin and in body axes unless a name says otherwise. A [`Transform`] is the pose of a child frame in its
//! parent's frame, so that it plays φ(p, k) on wrenches and φ*(p, k) on motions (papers: the rigid shift operators).
//!
//! The three-vectors and matrices here are ours because lanes of a SIMD register must stay inlined through them;
//! nalgebra serves everything dense above.

// Kernels carry the papers' symbols: P, J, C.
#![allow(non_snake_case)]

pub mod abreast;
pub mod double_double;
pub mod inertia;
pub mod lanes;
pub mod ordered;
pub mod quaternion;
pub mod scalar;
mod sin_cos;
pub mod six;
pub mod six_lanes;
pub mod transform;
pub mod turn;
pub mod vector;
pub mod wide;

pub use abreast::Abreast;
pub use double_double::Dd;
pub use inertia::{ArticulatedInertia, RigidInertia};
pub use ordered::Ordered;
pub use quaternion::Quaternion;
pub use scalar::{Kernel, Real, Scalar};
pub use six::{Motion, Wrench};
pub use six_lanes::SixLanes;
pub use transform::Transform;
pub use turn::{Axis, Turn};
pub use vector::{Mat3, Sym3, Vec3};
