//! What a mechanism *is*: bodies, joints, closures, their names, and its states. No algorithms.
//!
//! A [`Model`] is a tree of bodies, rigid or [`flexible`], parents before children; joint k carries body k. It is immutable, `Send + Sync`,
//! and stores the user's f64 numbers; a wider scalar reads the same numbers exactly.
//!
//! ```
//! use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
//! let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
//! let model = ModelBuilder::new("pendulum")
//!     .body(Body::new("rod", rod))
//!     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
//!     .build()?;
//! assert_eq!(model.nv(), 1);
//! # Ok::<(), phipsi_model::ModelErrors>(())
//! ```

pub mod builder;
pub mod closure;
pub mod configuration;
pub mod flexible;
pub mod joint;
pub mod model;
mod nearest_inertia;
pub mod random;
pub mod state;
pub mod still_axis;
pub mod violation;

pub use builder::{Base, ModelBuilder};
pub use closure::{Closure, ClosureKind};
pub use flexible::{
    Beam, BeamModes, FlexibleBody, MassPoint, MatrixError, Node, Section, ShapeIntegrals, Stiffening,
    SymmetricMatrix,
};
#[cfg(feature = "finite-elements")]
pub use flexible::{CraigBampton, ImportReport, InterfaceNode, KeptModes};
pub use joint::{Joint, JointKind, Limits, Placement};
pub use model::{Body, Coupling, Inertia, Model, NameError};
pub use random::Random;
pub use state::State;
pub use still_axis::StillAxis;
pub use violation::{ModelErrors, Severity, Subject, Violation};
