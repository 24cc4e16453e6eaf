//! Multibody dynamics on the spatial operator algebra.
//!
//! The rooms: [`spatial`] (six-vectors, inertias), [`topology`] (trees), [`model`] (what a mechanism is), [`recursion`]
//! (O(n) kernels), `closure` (loops), `hybrid` (active and passive joints), `freeflight` (free-flying systems), `formats`
//! (files), `motion` (forces and integration), `molecule` (force fields, torsion models), `simulate` (scenes and runs). The
//! last seven are features, all on by default; without them the crate is the tree kernels alone.
//!
//! ```
//! use phipsi::prelude::*;
//! let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
//! let model = ModelBuilder::new("pendulum")
//!     .body(Body::new("rod", rod))
//!     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
//!     .build()?;
//! let layout = Layout::<f64>::new(&model);
//! let acceleration = forward_dynamics(&layout, &[0.3], &[0.0], &[0.0], None)?;
//! assert!(acceleration[0] > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[cfg(feature = "closure")]
pub use phipsi_closure as closure;
#[cfg(feature = "formats")]
pub use phipsi_formats as formats;
#[cfg(feature = "freeflight")]
pub use phipsi_freeflight as freeflight;
#[cfg(feature = "hybrid")]
pub use phipsi_hybrid as hybrid;
pub use phipsi_model as model;
#[cfg(feature = "molecule")]
pub use phipsi_molecule as molecule;
#[cfg(feature = "motion")]
pub use phipsi_motion as motion;
pub use phipsi_recursion as recursion;
#[cfg(feature = "simulate")]
pub use phipsi_simulate as simulate;
pub use phipsi_spatial as spatial;
pub use phipsi_topology as topology;

/// What most programs need.
pub mod prelude {
    #[cfg(feature = "formats")]
    pub use phipsi_formats::urdf::{Mimic, UrdfOptions, read_urdf, read_urdf_file};
    pub use phipsi_model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, State};
    #[cfg(feature = "motion")]
    pub use phipsi_motion::{Force, Signal, Tolerances, forces};
    pub use phipsi_recursion::{
        About, Kinematics, Layout, bias_forces, body_pose, center_of_mass, forward_dynamics,
        inverse_dynamics, jacobian, kinetic_energy, mass_matrix, momentum, potential_energy,
    };
    #[cfg(feature = "simulate")]
    pub use phipsi_simulate::{Recording, Simulation, run};
    pub use phipsi_spatial::{Motion, Transform, Vec3, Wrench};
}

// The README's Rust is compiled and run with the other examples.
#[cfg(all(doctest, feature = "simulate"))]
#[doc = include_str!("../../../README.md")]
struct Readme;
