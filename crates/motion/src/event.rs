//! Events: instants that the state decides, found as passages of functions through zero, and what happens there.

use crate::force::Situation;
use crate::integrate::Tolerances;
use std::fmt;

/// Which way a function passes through zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From positive to negative.
    Falling,
    /// From negative to positive.
    Rising,
    /// Both.
    Either,
}

impl Direction {
    /// True for a passage that leaves the side of this sign.
    pub(crate) fn leaves(self, side: i8) -> bool {
        match self {
            Direction::Falling => side > 0,
            Direction::Rising => side < 0,
            Direction::Either => side != 0,
        }
    }
}

/// Energies of a mechanism at one instant, J.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energies {
    /// Kinetic energy.
    pub kinetic: f64,
    /// Potential energy of gravity, strain and conservative forces.
    pub potential: f64,
}

/// A function of time and state of which there may be a second one.
pub(crate) trait OfMotion: FnMut(&Situation<'_>) -> f64 + Send {
    fn another(&self) -> Box<dyn OfMotion>;
}

impl<F: FnMut(&Situation<'_>) -> f64 + Clone + Send + 'static> OfMotion for F {
    fn another(&self) -> Box<dyn OfMotion> {
        Box::new(self.clone())
    }
}

/// The same with energies.
pub(crate) trait OfEnergies: FnMut(&Situation<'_>, Energies) -> f64 + Send {
    fn another(&self) -> Box<dyn OfEnergies>;
}

impl<F: FnMut(&Situation<'_>, Energies) -> f64 + Clone + Send + 'static> OfEnergies for F {
    fn another(&self) -> Box<dyn OfEnergies> {
        Box::new(self.clone())
    }
}

/// What an event looks at.
pub(crate) enum Function {
    /// Time and state.
    Motion(Box<dyn OfMotion>),
    /// Energies besides.
    Energy(Box<dyn OfEnergies>),
}

impl Clone for Function {
    fn clone(&self) -> Self {
        match self {
            Function::Motion(function) => Function::Motion((**function).another()),
            Function::Energy(function) => Function::Energy((**function).another()),
        }
    }
}

/// A change of state, (t, q, v) ↦ new (q, v): any function that is `Clone` and `Send`.
pub trait Change: FnMut(f64, &mut [f64], &mut [f64]) + Send {
    /// Another one like it, for a second thread.
    fn another(&self) -> Box<dyn Change>;
}

impl<F: FnMut(f64, &mut [f64], &mut [f64]) + Clone + Send + 'static> Change for F {
    fn another(&self) -> Box<dyn Change> {
        Box::new(self.clone())
    }
}

/// What an event does.
pub enum Action {
    /// The run ends.
    Stop,
    /// It is recorded.
    Record,
    /// (t, q, v) ↦ new (q, v). Quaternions are normalised afterwards, closures projected onto.
    Change(Box<dyn Change>),
}

impl Clone for Action {
    fn clone(&self) -> Self {
        match self {
            Action::Stop => Action::Stop,
            Action::Record => Action::Record,
            Action::Change(change) => Action::Change((**change).another()),
        }
    }
}

impl fmt::Debug for Action {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Action::Stop => "Stop",
            Action::Record => "Record",
            Action::Change(_) => "Change",
        })
    }
}

/// An event: a function of time and state with what its passage through zero does.
///
/// The function must be continuous in time and state; where an impact or a change of state throws it over zero, that counts as a passage.
/// A passage shorter than an eighth of a step, there and back, may be missed.
///
/// ```
/// use phipsi_motion::{Action, Direction, Event};
/// // The first joint reaches 0.5 rad.
/// let event = Event::new("half", Direction::Rising, Action::Record, |at| at.q[0] - 0.5);
/// assert_eq!(event.name, "half");
/// ```
#[derive(Clone)]
pub struct Event {
    /// The user's name.
    pub name: String,
    /// Which passages count.
    pub direction: Direction,
    /// What happens.
    pub action: Action,
    /// True if the function looks at poses and velocities of bodies.
    pub kinematics: bool,
    pub(crate) function: Function,
}

impl fmt::Debug for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Event { name, direction, action, .. } = self;
        write!(f, "Event {{ {name}, {direction:?}, {action:?} }}")
    }
}

impl Event {
    /// An event of a function of (t, q, v). It is cloned for the companion run of an error estimate.
    pub fn new(
        name: impl Into<String>,
        direction: Direction,
        action: Action,
        function: impl FnMut(&Situation<'_>) -> f64 + Clone + Send + 'static,
    ) -> Self {
        let function = Function::Motion(Box::new(function));
        Event { name: name.into(), direction, action, kinematics: false, function }
    }
    /// An event of a function of (t, q, v) and the energies there, which cost O(n) at every look. An energy that the motion conserves passes
    /// through its own value by rounding only: compare it with another one.
    pub fn of_energies(
        name: impl Into<String>,
        direction: Direction,
        action: Action,
        function: impl FnMut(&Situation<'_>, Energies) -> f64 + Clone + Send + 'static,
    ) -> Self {
        let function = Function::Energy(Box::new(function));
        Event { name: name.into(), direction, action, kinematics: false, function }
    }
    /// True if its function looks at energies.
    pub fn looks_at_energies(&self) -> bool {
        matches!(self.function, Function::Energy(_))
    }
    /// True if it changes the state.
    pub fn changes(&self) -> bool {
        matches!(self.action, Action::Change(_))
    }
    /// The same, whose function looks at poses and velocities of bodies.
    pub fn with_kinematics(mut self) -> Self {
        self.kinematics = true;
        self
    }
}

/// How a joint with stops or dry friction moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Mode {
    /// It moves, without friction.
    Free,
    /// It slides with v > 0.
    Forward,
    /// It slides with v < 0.
    Backward,
    /// Friction holds it.
    Stuck,
    /// It rests on its lower stop.
    AtLower,
    /// It rests on its upper stop.
    AtUpper,
}

impl Mode {
    /// True if the joint does not move.
    pub fn holds(self) -> bool {
        matches!(self, Mode::Stuck | Mode::AtLower | Mode::AtUpper)
    }
}

/// What happened at an event.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Happening {
    /// An [`Event`], by its number.
    Event {
        /// Its number.
        index: usize,
    },
    /// A joint struck one of its stops.
    Impact {
        /// Index in v.
        dof: usize,
        /// The upper stop.
        upper: bool,
        /// Speed of the joint before and after, rad/s or m/s.
        speed: [f64; 2],
        /// Energy that the stop took, J.
        energy: f64,
    },
    /// A joint came to rest on a stop.
    Rest {
        /// Index in v.
        dof: usize,
        /// The upper stop.
        upper: bool,
        /// Infinitely many impacts were left, smaller than the tolerance tells from rest: one took what was left.
        endless: bool,
    },
    /// A joint left the stop on which it rested.
    Leave {
        /// Index in v.
        dof: usize,
    },
    /// Friction stopped a joint.
    Stick {
        /// Index in v.
        dof: usize,
    },
    /// A joint broke away from friction, or turned while it slid.
    Slip {
        /// Index in v.
        dof: usize,
        /// True if v > 0 from now on.
        forward: bool,
    },
}

impl Happening {
    /// What it is and of which joint or event, without its numbers: equal where two runs do the same.
    pub(crate) fn kind(&self) -> (u8, usize) {
        match *self {
            Happening::Event { index } => (0, index),
            Happening::Impact { dof, upper, .. } => (1 + u8::from(upper), dof),
            Happening::Rest { dof, .. } => (3, dof),
            Happening::Leave { dof } => (4, dof),
            Happening::Stick { dof } => (5, dof),
            Happening::Slip { dof, .. } => (6, dof),
        }
    }
    /// True if the equations of motion or the state change there.
    pub fn acts(&self) -> bool {
        !matches!(self, Happening::Event { .. })
    }
}

/// Something that happened.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Occurrence {
    /// When.
    pub t: f64,
    /// What.
    pub what: Happening,
}

/// A state that an event may change: t, q, v, auxiliary quantities.
pub struct Changing<'a> {
    /// Time.
    pub t: f64,
    /// Configuration.
    pub q: &'a mut [f64],
    /// Velocity.
    pub v: &'a mut [f64],
    /// Auxiliary quantities.
    pub aux: &'a mut [f64],
    /// Modes of the joints with stops or friction.
    pub modes: &'a mut [Mode],
}

/// What an event came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Consequence {
    /// State or equations are others now: the derivative is evaluated anew.
    pub changed: bool,
    /// The run is to end.
    pub stop: bool,
}

/// The events of a system.
pub trait Events {
    /// Why a function could not be computed.
    type Error;
    /// Number of event functions.
    fn functions(&self) -> usize;
    /// Number of modes.
    fn modes(&self) -> usize;
    /// Which passages of function i count.
    fn direction(&self, i: usize) -> Direction;
    /// True if function i belongs to a mode, in which it is positive: at zero it has not passed yet.
    fn is_guard(&self, i: usize) -> bool;
    /// True if the passage of function i changes state or equations.
    fn acts(&self, i: usize) -> bool;
    /// The equations of these modes from now on.
    fn enter(&mut self, modes: &[Mode]);
    /// Values of all functions in the present modes, infinite where one has no meaning; returns the evaluations it took.
    ///
    /// # Errors
    /// Those of the equations of motion.
    fn values(
        &mut self,
        t: f64,
        state: (&[f64], &[f64], &[f64]),
        out: &mut [f64],
    ) -> Result<u64, Self::Error>;
    /// Below this, a guard at the start of a step is zero.
    fn noise(&self, i: usize, q: &[f64], v: &[f64], tolerances: &Tolerances) -> f64;
    /// Does what the passage of function `cause` does; `None`: finds the modes of a start.
    ///
    /// # Errors
    /// Those of the equations of motion.
    fn act(
        &mut self,
        cause: Option<usize>,
        state: &mut Changing<'_>,
        tolerances: &Tolerances,
        log: &mut Vec<Occurrence>,
    ) -> Result<Consequence, Self::Error>;
}
