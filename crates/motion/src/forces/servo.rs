//! A PD servo at a one-axis degree of freedom, with an optional integral part and effort limit.

use crate::force::{Force, ForceError, Loads, Situation, acts_on_base};
use crate::force_rates::LoadRates;
use crate::signal::Signal;
use crate::wide::{WideLoads, WideSituation};
use phipsi_model::Model;
use phipsi_spatial::Dd;

/// τ = k_p (target − q) + k_d (target rate − v) + k_i ∫(target − q) dt, cut off at ± limit.
#[derive(Clone, Debug)]
pub struct Servo {
    /// The user's name.
    pub name: String,
    /// Index in q.
    pub coordinate: usize,
    /// Index in v.
    pub dof: usize,
    /// Wanted position, rad or m.
    pub target: Signal,
    /// k_p, N·m/rad or N/m.
    pub stiffness: f64,
    /// k_d, N·m·s/rad or N·s/m.
    pub damping: f64,
    /// k_i, N·m/(rad·s) or N/(m·s); 0 for none.
    pub integral: f64,
    /// Largest effort, N·m or N; infinite for none.
    pub limit: f64,
}

impl Force for Servo {
    fn name(&self) -> &str {
        &self.name
    }
    fn auxiliary(&self) -> Vec<String> {
        if self.integral == 0.0 { Vec::new() } else { vec![format!("{}.integral", self.name)] }
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        auxiliary: &[f64],
        auxiliary_rate: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        let error = self.target.value(at.t) - at.q[self.coordinate];
        let mut tau = self.stiffness * error + self.damping * (self.target.rate(at.t) - at.v[self.dof]);
        if let (Some(sum), Some(rate)) = (auxiliary.first(), auxiliary_rate.first_mut()) {
            tau += self.integral * sum;
            *rate = error;
        }
        loads.tau[self.dof] += tau.clamp(-self.limit, self.limit);
        Ok(())
    }
    fn is_external(&self, model: &Model) -> bool {
        acts_on_base(model, self.dof)
    }
    fn is_autonomous(&self) -> bool {
        matches!(self.target, Signal::Constant(_))
    }
    fn add_rates(&mut self, at: &Situation<'_>, rates: &mut LoadRates<'_>) -> bool {
        let error = self.target.value(at.t) - at.q[self.coordinate];
        let sum = rates.own.first().map_or(0.0, |sum| self.integral * sum);
        let tau = self.stiffness * error + self.damping * (self.target.rate(at.t) - at.v[self.dof]) + sum;
        if tau.abs() < self.limit {
            let i = self.dof * rates.nv + self.dof;
            rates.d_dq[i] -= self.stiffness;
            rates.d_dv[i] -= self.damping;
            if !rates.own.is_empty() {
                rates.d_daux[self.dof * rates.auxiliary + rates.slot] += self.integral;
            }
        }
        true
    }
    fn add_wide(&self, at: &WideSituation<'_>, loads: &mut WideLoads<'_>) -> bool {
        let Signal::Constant(target) = self.target else { return false };
        if self.integral != 0.0 || self.limit.is_finite() {
            return false;
        }
        let [k, c, target] = [self.stiffness, self.damping, target].map(Dd::from_f64);
        loads.tau[self.dof] += k * (target - at.q[self.coordinate]) - c * at.v[self.dof];
        true
    }
    fn breaks(&self) -> Vec<f64> {
        self.target.breaks()
    }
    fn another(&self) -> Option<Box<dyn Force>> {
        Some(Box::new(self.clone()))
    }
}
