//! A generalised force at one degree of freedom as a function of time.

use crate::force::{Force, ForceError, Loads, Situation, acts_on_base};
use crate::force_rates::LoadRates;
use crate::signal::Signal;
use crate::wide::{WideLoads, WideSituation};
use phipsi_model::Model;
use phipsi_spatial::Dd;

/// τ(t) at one degree of freedom, N·m or N.
#[derive(Clone, Debug)]
pub struct JointTorque {
    /// The user's name.
    pub name: String,
    /// Index in v.
    pub dof: usize,
    /// Force as a function of time.
    pub value: Signal,
}

impl Force for JointTorque {
    fn name(&self) -> &str {
        &self.name
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        loads.tau[self.dof] += self.value.value(at.t);
        Ok(())
    }
    fn is_external(&self, model: &Model) -> bool {
        acts_on_base(model, self.dof)
    }
    fn is_autonomous(&self) -> bool {
        matches!(self.value, Signal::Constant(_))
    }
    fn add_rates(&mut self, _: &Situation<'_>, _: &mut LoadRates<'_>) -> bool {
        true
    }
    fn add_wide(&self, _: &WideSituation<'_>, loads: &mut WideLoads<'_>) -> bool {
        let Signal::Constant(value) = self.value else { return false };
        loads.tau[self.dof] += Dd::from_f64(value);
        true
    }
    fn breaks(&self) -> Vec<f64> {
        self.value.breaks()
    }
    fn another(&self) -> Option<Box<dyn Force>> {
        Some(Box::new(self.clone()))
    }
}
