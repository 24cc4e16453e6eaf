//! Dense, slow, obvious versions of every algorithm of `phipsi-recursion`: the judges of its tests.
//!
//! Another derivation, not the same recursion again. Poses are functions of time, written with [`jet::Jet`]s from the
//! definition of each joint; velocities and accelerations are their derivatives. Bodies are rigid bodies in world axes.
//! Kane's equations with dense Jacobians give the mass matrix and the joint forces, a dense LDL* solves them, and
//! reactions balance whole subtrees. The same file names as in `phipsi-recursion`; the crate knows models, no layouts.
//!
//! [`generate`] makes random models and states from a seed, [`sensitivity`] tells how much a result answers to relative
//! changes of its inputs: the κ of the tests' budgets n·ε·κ.

pub mod articulated_sweep;
pub mod bodies;
pub mod closed_dynamics;
pub mod dense;
pub mod diagonal_dynamics;
pub mod dual;
pub mod energy;
pub mod extreme;
pub mod fixed_midpoint;
pub mod flexible;
pub mod forward_dynamics;
pub mod forward_dynamics_derivatives;
pub mod generate;
pub mod generate_flexible;
pub mod hinge_check;
pub mod hybrid_dynamics;
pub mod innovations;
pub mod inverse_dynamics;
pub mod inverse_dynamics_derivatives;
pub mod inverse_kinematics;
pub mod jacobian;
pub mod jacobian_pseudo_inverse;
pub mod jet;
pub mod joint_reactions;
pub mod kinematics;
pub mod linearize;
pub mod log_determinant_gradient;
pub mod loops;
pub mod mass_matrix;
pub mod mass_matrix_inverse;
pub mod momentum;
pub mod operational_space_inertia;
pub mod refined_forward_dynamics;
pub mod ring_determinant;
pub mod sensitivity;
pub mod square_root_forward_dynamics;
pub mod surface;
pub mod upsilon;

pub use articulated_sweep::{articulated_joint_inertias, log_determinant};
pub use closed_dynamics::{closed_dynamics, closure_jacobian};
pub use dense::NotPositive;
pub use diagonal_dynamics::{diagonal_coriolis, diagonal_velocity, joint_inertia_rates};
pub use dual::Dual;
pub use energy::{center_of_mass, kinetic_energy, potential_energy};
pub use fixed_midpoint::midpoint_step;
pub use forward_dynamics::forward_dynamics;
pub use forward_dynamics_derivatives::forward_dynamics_derivatives;
pub use hinge_check::singular_hinges;
pub use hybrid_dynamics::hybrid_dynamics;
pub use innovations::innovations_operator;
pub use inverse_dynamics::{bias_forces, gravity_forces, inverse_dynamics, multiply_by_mass_matrix};
pub use inverse_dynamics_derivatives::inverse_dynamics_derivatives;
pub use inverse_kinematics::{pose_error, pose_error_gradient};
pub use jacobian::{bias_acceleration, jacobian};
pub use jacobian_pseudo_inverse::jacobian_pseudo_inverse;
pub use joint_reactions::joint_reactions;
pub use kinematics::{BodyMotion, kinematics};
pub use linearize::linearize;
pub use log_determinant_gradient::log_determinant_gradient;
pub use mass_matrix::mass_matrix;
pub use mass_matrix_inverse::{mass_matrix_inverse, solve_mass_matrix};
pub use momentum::{centroidal_momentum_matrix, momentum};
pub use operational_space_inertia::operational_space_inertia;
pub use refined_forward_dynamics::refined_forward_dynamics;
pub use ring_determinant::ring_determinant;
pub use square_root_forward_dynamics::square_root_forward_dynamics;
pub use surface::{along_closures, tangent_part};
pub use upsilon::upsilon;
