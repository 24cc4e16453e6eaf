//! Why a step could not be made, with names from the model.

use crate::explicit::{NotFinite, StageError};
use phipsi_model::Model;
use std::fmt;

/// Why a step could not be made; the state before it is intact.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum IntegrateError<E> {
    /// The step size fell below what the time can resolve.
    StepUnderflow {
        /// Time.
        t: f64,
        /// Step size.
        h: f64,
        /// What made the last trial fail, if not the error estimate.
        cause: Option<StageError<E>>,
    },
    /// The derivative at the very start (or after a break) failed.
    Start {
        /// Time.
        t: f64,
        /// What failed.
        cause: StageError<E>,
    },
    /// Events follow each other without time between them.
    Endless {
        /// Time.
        t: f64,
        /// How many there were.
        events: usize,
    },
}

impl NotFinite {
    /// In words, with the joint's name.
    pub fn describe(&self, model: &Model) -> String {
        let joint = |i: usize| {
            let (k, component) = model.joint_of_velocity(i);
            format!("joint `{}`, degree of freedom {component}", model.joints()[k].name)
        };
        match self {
            NotFinite::Acceleration(i) => format!("acceleration of {}", joint(*i)),
            NotFinite::Velocity(i) => format!("velocity of {}", joint(*i)),
            NotFinite::Auxiliary(i) => format!("rate of auxiliary quantity {i}"),
        }
    }
}

impl<E: fmt::Display> IntegrateError<E> {
    /// In words, with names from the model.
    pub fn describe(&self, model: &Model) -> String {
        let cause = |c: &StageError<E>| match c {
            StageError::System(e) => e.to_string(),
            StageError::NotFinite(what) => format!("{} is not finite", what.describe(model)),
        };
        match self {
            IntegrateError::StepUnderflow { t, h, cause: Some(c) } => {
                format!("at t = {t} no step of size {h:e} or more succeeds: {}", cause(c))
            }
            IntegrateError::StepUnderflow { t, h, cause: None } => {
                let resolved = 4.0 * f64::EPSILON * t.abs();
                // Where a microsecond is not resolved, the clock is what is wrong, and not the forces.
                let remedy = match resolved > 1e-6 {
                    true => "count time from a zero that is nearer",
                    false => "loosen rtol, or look for a force that is not smooth there",
                };
                format!(
                    "at t = {t} the step size fell to {h:e} without meeting the tolerance, and time resolves {resolved:.0e} \
                     there; {remedy}"
                )
            }
            IntegrateError::Start { t, cause: c } => format!("at t = {t}: {}", cause(c)),
            IntegrateError::Endless { t, events } => format!(
                "at t = {t} {events} events follow each other without time between them; look for an event whose change \
                 brings about another one, or for joints whose stops and friction contradict each other"
            ),
        }
    }
}
