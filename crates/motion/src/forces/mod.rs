//! The first force models.

mod control;
mod dissipation;
mod servo;
mod spring;
mod torque;
mod wrench;

pub use control::Control;
pub use dissipation::{JointDissipation, passive_forces};
pub use servo::Servo;
pub use spring::{JointSpring, PointSpring};
pub use torque::JointTorque;
pub use wrench::{BodyWrench, WrenchAxes};
