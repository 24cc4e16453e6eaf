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
pub mod dense;
pub mod dual;
pub mod energy;
pub mod extreme;
pub mod flexible;
pub mod forward_dynamics;
pub mod forward_dynamics_derivatives;
pub mod generate;
pub mod generate_flexible;
pub mod hinge_check;
pub mod innovations;
pub mod inverse_dynamics;
pub mod inverse_dynamics_derivatives;
pub mod jacobian;
pub mod jet;
pub mod joint_reactions;
pub mod kinematics;
pub mod mass_matrix;
pub mod mass_matrix_inverse;
pub mod momentum;
pub mod refined_forward_dynamics;
pub mod sensitivity;
pub mod square_root_forward_dynamics;

pub use articulated_sweep::{articulated_joint_inertias, log_determinant};
pub use dense::NotPositive;
pub use dual::Dual;
pub use energy::{center_of_mass, kinetic_energy, potential_energy};
pub use forward_dynamics::forward_dynamics;
pub use forward_dynamics_derivatives::forward_dynamics_derivatives;
pub use hinge_check::singular_hinges;
pub use innovations::innovations_operator;
pub use inverse_dynamics::{bias_forces, gravity_forces, inverse_dynamics, multiply_by_mass_matrix};
pub use inverse_dynamics_derivatives::inverse_dynamics_derivatives;
pub use jacobian::{bias_acceleration, jacobian};
pub use joint_reactions::joint_reactions;
pub use kinematics::{BodyMotion, kinematics};
pub use mass_matrix::mass_matrix;
pub use mass_matrix_inverse::{mass_matrix_inverse, solve_mass_matrix};
pub use momentum::{centroidal_momentum_matrix, momentum};
pub use refined_forward_dynamics::refined_forward_dynamics;
pub use square_root_forward_dynamics::square_root_forward_dynamics;
