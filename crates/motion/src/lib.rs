//! Motion of a mechanism: forces, integration on the configuration manifold, error estimates, and the plan of what a scene
//! needs.
//!
//! [`Dynamics`] is a model with its [`Force`]s; an [`Integrator`] advances it step by step; [`estimate_error`] says how wrong
//! the end is.

pub mod conservative;
pub mod conserved;
mod constraints;
pub mod dynamics;
pub mod error_estimate;
pub mod event;
mod event_search;
pub mod explicit;
pub mod extrapolation;
pub mod force;
pub mod force_rates;
pub mod forces;
mod impact;
pub mod increment;
pub mod integrate;
mod lu;
pub mod midpoint;
pub mod midpoint_error;
pub mod midpoint_maps;
mod midpoint_mixing;
pub mod midpoint_momentum;
mod one_step;
pub mod plan;
pub mod prescription;
pub mod rosenbrock;
pub mod rosenbrock_tableau;
pub mod signal;
pub mod stepper;
pub mod switch;
pub mod system;
pub mod tableau;
pub mod trail;
pub mod wide;

pub use conservative::Conservative;
pub use conserved::{Balance, Conserved, balance};
pub use dynamics::{Dynamics, MotionError};
pub use error_estimate::{ErrorEstimate, JudgedRun, PlannedRun, estimate_error, estimate_error_beside};
pub use event::{
    Action, Change, Changing, Consequence, Direction, Energies, Event, Events, Happening, Mode, Occurrence,
};
pub use extrapolation::{Extrapolation, ExtrapolationError, coordinate_rate};
pub use force::{Force, ForceError, Loads, Needs, Situation};
pub use force_rates::{LoadRates, PointRates};
pub use integrate::{IntegrateError, Integrator, IntegratorState, Method, StepInfo, Tolerances};
pub use midpoint::{DriftInfo, Midpoint, MidpointState};
pub use midpoint_error::MidpointError;
pub use plan::Plan;
pub use prescription::{Course, MovingClosure, PrescribedJoint, Prescription};
pub use signal::Signal;
pub use stepper::{Scheme, StepError, Stepper, StepperState};
pub use switch::{DryFriction, JointSwitch, Stops};
pub use system::{Linearization, Projected, System};
pub use trail::Trail;
pub use wide::{WideDynamics, WideLoads, WideSituation};
