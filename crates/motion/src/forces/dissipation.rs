//! Damping and dry friction of the model's joints (URDF `dynamics`).

use crate::force::{Force, ForceError, Loads, Situation, acts_on_base};
use crate::force_rates::LoadRates;
use crate::wide::{WideLoads, WideSituation};
use phipsi_model::Model;
use phipsi_spatial::Dd;

/// τ = −c v − f tanh(v/s) at every degree of freedom of the joints that have damping c or friction f.
///
/// Dry friction is regularised: at the speed s the force has reached 76 % of f, and below it the joint creeps instead of
/// sticking.
#[derive(Clone, Debug)]
pub struct JointDissipation {
    /// (degree of freedom, damping, friction).
    terms: Vec<(usize, f64, f64)>,
    /// s, rad/s or m/s.
    speed: f64,
}

impl JointDissipation {
    /// Regularisation speed where a scene does not say: 0.01 rad/s or m/s.
    pub const SPEED: f64 = 0.01;

    /// Of all joints of a model; `None` if no joint has damping or friction.
    pub fn new(model: &Model, speed: f64) -> Option<Self> {
        let mut terms = Vec::new();
        for k in model.moving_joints() {
            let joint = &model.joints()[k];
            if joint.damping != 0.0 || joint.friction != 0.0 {
                terms.extend(model.v_range(k).map(|i| (i, joint.damping, joint.friction)));
            }
        }
        (!terms.is_empty()).then_some(JointDissipation { terms, speed })
    }
    /// Damping alone; `None` if no joint has any.
    pub fn damping(model: &Model) -> Option<Self> {
        let mut force = Self::new(model, Self::SPEED)?;
        force.terms.retain(|t| t.1 != 0.0);
        force.terms.iter_mut().for_each(|t| t.2 = 0.0);
        (!force.terms.is_empty()).then_some(force)
    }
    /// s, rad/s or m/s.
    pub fn speed(&self) -> f64 {
        self.speed
    }
    /// True if a joint has dry friction.
    pub fn has_friction(&self) -> bool {
        self.terms.iter().any(|t| t.2 != 0.0)
    }
    fn add_to(&self, v: &[f64], tau: &mut [f64]) {
        for &(i, damping, friction) in &self.terms {
            tau[i] -= damping * v[i] + friction * (v[i] / self.speed).tanh();
        }
    }
}

/// Damping and regularised friction forces of a model at velocities v, nv.
pub fn passive_forces(model: &Model, v: &[f64]) -> Vec<f64> {
    let mut tau = vec![0.0; model.nv()];
    if let Some(force) = JointDissipation::new(model, JointDissipation::SPEED) {
        force.add_to(v, &mut tau);
    }
    tau
}

impl Force for JointDissipation {
    fn name(&self) -> &str {
        "joint damping and friction"
    }
    fn is_autonomous(&self) -> bool {
        true
    }
    fn add_rates(&mut self, at: &Situation<'_>, rates: &mut LoadRates<'_>) -> bool {
        for &(i, damping, friction) in &self.terms {
            let creep = (at.v[i] / self.speed).tanh();
            rates.d_dv[i * rates.nv + i] -= damping + friction * (1.0 - creep * creep) / self.speed;
        }
        true
    }
    fn add_wide(&self, at: &WideSituation<'_>, loads: &mut WideLoads<'_>) -> bool {
        for &(i, damping, _) in &self.terms {
            loads.tau[i] -= Dd::from_f64(damping) * at.v[i];
        }
        !self.has_friction()
    }
    fn is_external(&self, model: &Model) -> bool {
        self.terms.iter().any(|t| acts_on_base(model, t.0))
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        self.add_to(at.v, loads.tau);
        Ok(())
    }
    fn another(&self) -> Option<Box<dyn Force>> {
        Some(Box::new(self.clone()))
    }
}
