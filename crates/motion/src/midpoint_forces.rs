//! A model's weight and its conservative [`Force`]s, as the [`Conservative`] system of the midpoint method.

use crate::force::{Force, ForceError, Loads, Situation};
use crate::midpoint::Conservative;
use phipsi_model::Model;
use phipsi_recursion::{DynamicsError, InverseDynamics, Kinematics, Layout, potential_energy};
use phipsi_spatial::Wrench;
use std::fmt;

/// Why the forces have no value.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum ModelForcesError {
    /// A recursion failed.
    Dynamics(DynamicsError),
    /// A force failed.
    Force(ForceError),
    /// A force without a potential energy.
    NotConservative {
        /// Its name.
        force: String,
    },
}

impl fmt::Display for ModelForcesError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ModelForcesError::Dynamics(e) => e.fmt(f),
            ModelForcesError::Force(e) => e.fmt(f),
            ModelForcesError::NotConservative { force } => write!(
                f,
                "force `{force}` has no potential energy, which the midpoint method requires; \
                 use an adaptive method, or remove the force"
            ),
        }
    }
}

impl std::error::Error for ModelForcesError {}

impl From<DynamicsError> for ModelForcesError {
    fn from(e: DynamicsError) -> Self {
        ModelForcesError::Dynamics(e)
    }
}

/// Weight and forces of a model.
pub struct ModelForces {
    model: Model,
    layout: Layout<f64>,
    forces: Vec<Box<dyn Force>>,
    kinematics: Kinematics<f64>,
    inverse: InverseDynamics<f64>,
    rest: Vec<f64>,
    tau: Vec<f64>,
    wrenches: Vec<Wrench<f64>>,
}

impl ModelForces {
    /// Forces must be conservative and without quantities of their own.
    ///
    /// # Errors
    /// [`ModelForcesError::NotConservative`].
    pub fn new(model: &Model, forces: Vec<Box<dyn Force>>) -> Result<Self, ModelForcesError> {
        if let Some(force) = forces.iter().find(|f| !f.needs().conservative || !f.auxiliary().is_empty()) {
            return Err(ModelForcesError::NotConservative { force: force.name().into() });
        }
        let layout = Layout::new(model);
        Ok(ModelForces {
            kinematics: Kinematics::new(&layout),
            inverse: InverseDynamics::new(&layout),
            rest: vec![0.0; model.nv()],
            tau: vec![0.0; model.nv()],
            wrenches: vec![Wrench::zero(); model.len()],
            model: model.clone(),
            layout,
            forces,
        })
    }
}

impl Conservative for ModelForces {
    type Error = ModelForcesError;

    fn evaluate(&mut self, q: &[f64], out: &mut [f64]) -> Result<f64, ModelForcesError> {
        self.tau.iter_mut().for_each(|x| *x = 0.0);
        self.wrenches.iter_mut().for_each(|w| *w = Wrench::zero());
        self.kinematics.set_position(&self.layout, q)?;
        self.kinematics.set_velocity(&self.layout, &self.rest)?;
        let (model, layout, kinematics) = (&self.model, &self.layout, Some(&self.kinematics));
        let at = Situation { model, layout, t: 0.0, q, v: &self.rest, kinematics };
        let mut potential = potential_energy(&self.layout, q)?;
        for force in &mut self.forces {
            let mut loads = Loads { tau: &mut self.tau, wrenches: &mut self.wrenches };
            force.add(&at, &[], &mut [], &mut loads).map_err(ModelForcesError::Force)?;
            potential += force.potential(&at);
        }
        // What holds the tree at rest against weight and wrenches is their opposite.
        self.inverse.run(&self.layout, q, &self.rest, &self.rest, Some(&self.wrenches), out)?;
        for (out, tau) in out.iter_mut().zip(&self.tau) {
            *out = tau - *out;
        }
        Ok(potential)
    }
}
