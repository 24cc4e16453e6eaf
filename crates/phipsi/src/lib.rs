//! Multibody dynamics on the spatial operator algebra.
//!
//! The rooms: [`spatial`] (six-vectors, inertias), [`topology`] (trees), [`model`] (what a mechanism is), [`recursion`]
//! (O(n) kernels), [`formats`] (files), [`motion`] (forces and integration).

#[cfg(feature = "formats")]
pub use phipsi_formats as formats;
pub use phipsi_model as model;
#[cfg(feature = "motion")]
pub use phipsi_motion as motion;
pub use phipsi_recursion as recursion;
pub use phipsi_spatial as spatial;
pub use phipsi_topology as topology;
