//! Multibody dynamics on the spatial operator algebra.
//!
//! The rooms: [`spatial`] (six-vectors, inertias), [`topology`] (trees), [`model`] (what a mechanism is), [`recursion`]
//! (O(n) kernels).

pub use phipsi_model as model;
pub use phipsi_recursion as recursion;
pub use phipsi_spatial as spatial;
pub use phipsi_topology as topology;
