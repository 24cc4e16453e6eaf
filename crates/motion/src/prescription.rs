//! Motions that are given as functions of time: of joints, and of the frames of closures.

use crate::signal::Signal;

/// A function of time that a coordinate follows, given as its position, its rate or its acceleration.
#[derive(Clone, Debug)]
pub enum Course {
    /// The coordinate itself, with its rate as a function of its own. Both must be continuous.
    Position {
        /// γ(t), rad or m.
        position: Signal,
        /// γ̇(t), whose rate is γ̈.
        velocity: Signal,
    },
    /// The rate, which must be continuous; its rate is γ̈.
    Velocity(Signal),
    /// The acceleration.
    Acceleration(Signal),
}

impl Course {
    /// A coordinate that stays where it is.
    pub fn locked(position: f64) -> Self {
        Course::Position { position: Signal::Constant(position), velocity: Signal::Constant(0.0) }
    }
    /// γ(t), if it is given.
    pub fn position(&self, t: f64) -> Option<f64> {
        match self {
            Course::Position { position, .. } => Some(position.value(t)),
            _ => None,
        }
    }
    /// γ̇(t), if it is given.
    pub fn velocity(&self, t: f64) -> Option<f64> {
        match self {
            Course::Position { velocity, .. } | Course::Velocity(velocity) => Some(velocity.value(t)),
            Course::Acceleration(_) => None,
        }
    }
    /// γ̈(t).
    pub fn acceleration(&self, t: f64) -> f64 {
        match self {
            Course::Position { velocity, .. } | Course::Velocity(velocity) => velocity.rate(t),
            Course::Acceleration(acceleration) => acceleration.value(t),
        }
    }
    /// Times at which it is not smooth.
    pub fn breaks(&self) -> Vec<f64> {
        match self {
            Course::Position { position, velocity } => [position.breaks(), velocity.breaks()].concat(),
            Course::Velocity(signal) | Course::Acceleration(signal) => signal.breaks(),
        }
    }
}

/// A degree of freedom that follows a function of time; its actuator gives the force that this takes.
#[derive(Clone, Debug)]
pub struct PrescribedJoint {
    /// Index in v.
    pub dof: usize,
    /// Index in q of the coordinate whose rate it is; needed where the position is given.
    pub coordinate: Option<usize>,
    /// The function.
    pub course: Course,
}

/// A row of a closure that follows a function of time.
#[derive(Clone, Debug)]
pub struct MovingClosure {
    /// Number of the closure in the model.
    pub closure: usize,
    /// Its row, as [`phipsi_model::ClosureKind`] counts them.
    pub row: usize,
    /// The function, its position given.
    pub course: Course,
}

/// All motions that are given.
#[derive(Clone, Debug, Default)]
pub struct Prescription {
    /// Of degrees of freedom.
    pub joints: Vec<PrescribedJoint>,
    /// Of closures.
    pub closures: Vec<MovingClosure>,
}

impl Prescription {
    /// True if nothing is given.
    pub fn is_empty(&self) -> bool {
        self.joints.is_empty() && self.closures.is_empty()
    }
    /// Times at which a function is not smooth.
    pub fn breaks(&self) -> Vec<f64> {
        let joints = self.joints.iter().flat_map(|p| p.course.breaks());
        joints.chain(self.closures.iter().flat_map(|p| p.course.breaks())).collect()
    }
}
