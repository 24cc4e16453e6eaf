//! A thruster fixed to a body, with the propellant that it uses.

use crate::force::{Force, ForceError, Loads, Needs, Situation};
use crate::force_rates::LoadRates;
use crate::signal::Signal;
use crate::wide::{WideLoads, WideSituation};
use phipsi_spatial::{Dd, Vec3, Wrench};

/// Standard gravity, m/s²: specific impulses are given in seconds by it.
pub const STANDARD_GRAVITY: f64 = 9.80665;

/// A force along a direction of a body. Propellant is counted, ṁ = |F|/(I_sp g₀); the body's mass stays what it is.
#[derive(Clone, Debug)]
pub struct Thruster {
    /// The user's name.
    pub name: String,
    /// The body.
    pub body: usize,
    /// Where it acts, body frame, m.
    pub point: Vec3<f64>,
    /// Unit vector along which it pushes the body, body axes.
    pub direction: Vec3<f64>,
    /// F as a function of time, N.
    pub thrust: Signal,
    /// I_sp, s; `None`: propellant is not counted.
    pub specific_impulse: Option<f64>,
}

impl Thruster {
    /// A thrust that is there during some spans of time, [from, to), and not otherwise.
    pub fn on_off(thrust: f64, spans: Vec<[f64; 2]>) -> Signal {
        let breaks = spans.concat();
        let value = move |t: f64| if spans.iter().any(|[a, b]| t >= *a && t < *b) { thrust } else { 0.0 };
        Signal::function(value, |_| 0.0).with_breaks(breaks)
    }
    fn wrench<T: phipsi_spatial::Real>(&self, thrust: T) -> Wrench<T> {
        let force = Vec3::splat(self.direction.0).scale(thrust);
        Wrench::new(Vec3::splat(self.point.0).cross(force), force)
    }
}

impl Force for Thruster {
    fn name(&self) -> &str {
        &self.name
    }
    fn needs(&self) -> Needs {
        Needs { wrenches: true, ..Needs::default() }
    }
    fn auxiliary(&self) -> Vec<String> {
        self.specific_impulse.map(|_| format!("{}.propellant", self.name)).into_iter().collect()
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        rate: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        let thrust = self.thrust.value(at.t);
        loads.wrenches[self.body] += self.wrench(thrust);
        if let (Some(rate), Some(impulse)) = (rate.first_mut(), self.specific_impulse) {
            *rate = thrust.abs() / (impulse * STANDARD_GRAVITY);
        }
        Ok(())
    }
    fn is_autonomous(&self) -> bool {
        matches!(self.thrust, Signal::Constant(_))
    }
    fn add_rates(&mut self, _: &Situation<'_>, _: &mut LoadRates<'_>) -> bool {
        true
    }
    fn add_wide(&self, _: &WideSituation<'_>, loads: &mut WideLoads<'_>) -> bool {
        let (Signal::Constant(thrust), None) = (&self.thrust, self.specific_impulse) else { return false };
        loads.wrenches[self.body] += self.wrench(Dd::from_f64(*thrust));
        true
    }
    fn breaks(&self) -> Vec<f64> {
        self.thrust.breaks()
    }
    fn another(&self) -> Option<Box<dyn Force>> {
        Some(Box::new(self.clone()))
    }
}
