//! Force models.
//!
//! All but [`Control`], the user's own function, give their derivatives to implicit methods.

mod central_gravity;
mod control;
mod dissipation;
mod servo;
mod spring;
mod thruster;
mod torque;
mod wrench;

pub use central_gravity::CentralGravity;
pub use control::Control;
pub use dissipation::{JointDissipation, passive_forces};
pub use servo::Servo;
pub use spring::{JointSpring, PointSpring};
pub use thruster::{STANDARD_GRAVITY, Thruster};
pub use torque::JointTorque;
pub use wrench::{BodyWrench, WrenchAxes};
