//! O(n) recursions of multibody dynamics on trees, one file per algorithm.
//!
//! A [`Layout`] compiles a model: fixed joints fused, joint axes turned onto coordinate axes. It is invisible in results:
//! poses, velocities and wrenches are in the user's frames. Each algorithm owns a workspace, made once from a layout;
//! its method then runs without allocation. The functions of the same name allocate and suit single calls.
//!
//! Models may have [`flexible`] bodies; an algorithm that knows none refuses them.
//!
//! Everything is generic over the scalar; constants of the layout are kept in [`phipsi_spatial::Scalar::Constant`].
//!
//! ```
//! use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
//! use phipsi_recursion::{Layout, forward_dynamics};
//! let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
//! let model = ModelBuilder::new("pendulum")
//!     .body(Body::new("rod", rod))
//!     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
//!     .gravity([0.0, 0.0, -9.81])
//!     .build()?;
//! let layout = Layout::<f64>::new(&model);
//! let acceleration = forward_dynamics(&layout, &[0.0], &[0.0], &[0.0], None)?;
//! assert!((acceleration[0] - 1.5_f64 * 9.81).abs() < 1e-14); // a rod falling from the horizontal
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// Kernels carry the papers' symbols: P, D, G, H, M.
#![allow(non_snake_case)]

pub mod articulated_sweep;
pub mod batch;
mod branching;
mod composites;
mod derivative_columns;
pub mod diagonal_dynamics;
pub mod energy;
pub mod error;
pub mod flexible;
mod floating_base;
pub mod form;
pub mod forward_dynamics;
pub mod forward_dynamics_derivatives;
mod ground_axes;
pub mod hinge;
pub mod hinge_check;
pub mod hybrid_dynamics;
pub mod innovations;
pub mod inverse_dynamics;
pub mod inverse_dynamics_derivatives;
pub mod inverse_kinematics;
pub mod jacobian;
pub mod jacobian_pseudo_inverse;
pub mod joint_reactions;
mod kernel;
pub mod kinematics;
pub mod layout;
mod limbs;
pub mod linearize;
mod link;
pub mod log_determinant_gradient;
pub mod mass_matrix;
pub mod mass_matrix_inverse;
pub mod momentum;
pub mod operational_space_inertia;
pub mod operators;
mod packed;
mod places;
pub mod refined_forward_dynamics;
mod singular_values;
pub mod square_root_forward_dynamics;
pub mod upsilon;

pub use articulated_sweep::ArticulatedSweep;
pub use diagonal_dynamics::{
    DiagonalDynamics, DiagonalVelocity, diagonal_coriolis, diagonal_dynamics, diagonal_velocity,
    joint_velocity,
};
pub use energy::{CenterOfMass, KineticEnergy, center_of_mass, kinetic_energy, potential_energy};
pub use error::DynamicsError;
pub use form::{Form, FormChoice, FormForwardDynamics};
pub use forward_dynamics::{ForwardDynamics, ForwardInfo, WorstHinge, forward_dynamics, forward_info};
pub use forward_dynamics_derivatives::{ForwardDynamicsDerivatives, forward_dynamics_derivatives};
pub use hinge_check::singular_hinges;
pub use hybrid_dynamics::{HybridDynamics, hybrid_dynamics};
pub use innovations::innovations_operator;
pub use inverse_dynamics::{
    InverseDynamics, bias_forces, gravity_forces, inverse_dynamics, multiply_by_mass_matrix,
};
pub use inverse_dynamics_derivatives::{InverseDynamicsDerivatives, inverse_dynamics_derivatives};
pub use inverse_kinematics::{
    InverseKinematics, InverseKinematicsInfo, InverseKinematicsOptions, inverse_kinematics,
};
pub use jacobian::{Jacobian, jacobian};
pub use jacobian_pseudo_inverse::{
    JacobianPseudoInverse, PseudoInverseOptions, Tip, jacobian_gram, jacobian_pseudo_inverse,
};
pub use joint_reactions::{JointReactions, joint_reactions};
pub use kinematics::{Kinematics, body_pose, body_velocity};
pub use layout::Layout;
pub use linearize::{Linearization, linearize};
pub use log_determinant_gradient::{LogDeterminantGradient, log_determinant_gradient};
pub use mass_matrix::{MassMatrix, mass_matrix};
pub use mass_matrix_inverse::{
    MassMatrixInverse, MassMatrixSolution, mass_matrix_inverse, solve_mass_matrix,
};
pub use momentum::{About, CentroidalMomentumMatrix, Momentum, centroidal_momentum_matrix, momentum};
pub use operational_space_inertia::{
    OperationalSpaceInertia, OperationalSpaceInfo, operational_space_inertia,
};
pub use operators::{DynamicsDerivatives, Operators, Sensitivity};
pub use refined_forward_dynamics::{RefinedForwardDynamics, refined_forward_dynamics};
pub use square_root_forward_dynamics::{SquareRootForwardDynamics, square_root_forward_dynamics};
pub use upsilon::{Upsilon, upsilon};
