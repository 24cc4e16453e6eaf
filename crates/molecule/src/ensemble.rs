//! Which ensemble a run samples, and with what.

use crate::atoms::MoleculeError;

/// Friction of Langevin dynamics where none is given, 1/ps.
pub const FRICTION: f64 = 1.0;

/// Relaxation time of a Nosé–Hoover chain where none is given, ps.
pub const RELAXATION: f64 = 0.1;

/// Length of a Monte Carlo trajectory where none is given, ps.
pub const TRAJECTORY: f64 = 0.05;

/// An ensemble with its parameters, times in the model's unit (ps for molecules).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Ensemble {
    /// Constant energy.
    #[default]
    ConstantEnergy,
    /// Canonical, by friction and noise in the metric of the mass matrix.
    Langevin {
        /// Friction, 1/time.
        friction: f64,
    },
    /// Canonical, by chains of thermostats on rigid and internal motion; the common momentum is zero.
    NoseHoover {
        /// Relaxation time.
        relaxation: f64,
    },
    /// Canonical, exact at any step: momenta drawn anew, a trajectory, a Metropolis test.
    HybridMonteCarlo {
        /// Steps of a trajectory.
        steps: u64,
    },
}

impl Ensemble {
    /// The words of all ensembles.
    pub const WORDS: [&str; 4] = ["nve", "langevin", "nose_hoover", "hmc"];

    /// Its word in scenes and arguments.
    pub fn word(&self) -> &'static str {
        match self {
            Ensemble::ConstantEnergy => Self::WORDS[0],
            Ensemble::Langevin { .. } => Self::WORDS[1],
            Ensemble::NoseHoover { .. } => Self::WORDS[2],
            Ensemble::HybridMonteCarlo { .. } => Self::WORDS[3],
        }
    }
    /// For people; `unit` is that of time.
    pub fn describe(&self, unit: &str) -> String {
        match self {
            Ensemble::ConstantEnergy => "constant energy".into(),
            Ensemble::Langevin { friction } => {
                format!("canonical, Langevin dynamics (OBABO) with a friction of {friction}/{unit}")
            }
            Ensemble::NoseHoover { relaxation } => format!(
                "canonical at zero momentum, Nosé–Hoover chains with a relaxation time of {relaxation} {unit}"
            ),
            Ensemble::HybridMonteCarlo { steps } => {
                format!("canonical, hybrid Monte Carlo with trajectories of {steps} steps")
            }
        }
    }
    /// Steps that belong together: between two of them the run has a state of the ensemble.
    pub fn stride(&self) -> u64 {
        if let Ensemble::HybridMonteCarlo { steps } = self { (*steps).max(1) } else { 1 }
    }
    /// What is wrong with its parameters.
    ///
    /// # Errors
    /// [`MoleculeError`] that names the parameter.
    pub fn check(&self) -> Result<(), MoleculeError> {
        let wrong = |what: &str, found: String, required: &str, remedy: &str| {
            Err(MoleculeError::new(what, found, required, remedy))
        };
        match *self {
            Ensemble::Langevin { friction } if !(friction >= 0.0 && friction.is_finite()) => wrong(
                "friction",
                friction.to_string(),
                "a finite number, at least 0",
                "1/ps is gentle; 5/ps couples strongly",
            ),
            Ensemble::NoseHoover { relaxation } if !(relaxation > 0.0 && relaxation.is_finite()) => wrong(
                "relaxation",
                relaxation.to_string(),
                "a positive finite number",
                "0.1 ps serves molecules; at least two steps",
            ),
            Ensemble::HybridMonteCarlo { steps: 0 } => {
                wrong("trajectory", "0 steps".into(), "at least 1", "a few steps, 50 fs together")
            }
            _ => Ok(()),
        }
    }
}
