//! A wrench on a body as a function of time.

use crate::force::{Force, ForceError, Loads, Needs, Situation};
use crate::force_rates::LoadRates;
use crate::signal::Signal;
use crate::wide::{WideLoads, WideSituation};
use phipsi_spatial::{Dd, Vec3, Wrench};

/// The axes in which a wrench is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WrenchAxes {
    /// The body's own, turning with it (a thruster).
    Body,
    /// The world's (a pull).
    World,
}

/// Moment and force on a body at a point of it.
#[derive(Clone, Debug)]
pub struct BodyWrench {
    /// The user's name.
    pub name: String,
    /// The body.
    pub body: usize,
    /// Point of application in the body's frame, m.
    pub point: Vec3<f64>,
    /// Axes of the components.
    pub axes: WrenchAxes,
    /// Moment about the point, then force, N·m and N.
    pub components: [Signal; 6],
}

impl Force for BodyWrench {
    fn name(&self) -> &str {
        &self.name
    }
    fn needs(&self) -> Needs {
        Needs { kinematics: self.axes == WrenchAxes::World, wrenches: true, conservative: false }
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        let six = [0, 1, 2, 3, 4, 5].map(|i| self.components[i].value(at.t));
        let mut wrench = Wrench::from_array(six);
        if self.axes == WrenchAxes::World {
            let r = at.pose(Some(self.body)).rotation;
            wrench = Wrench::new(r.transpose_mul(wrench.moment), r.transpose_mul(wrench.force));
        }
        wrench.moment += self.point.cross(wrench.force);
        loads.wrenches[self.body] += wrench;
        Ok(())
    }
    fn is_autonomous(&self) -> bool {
        self.components.iter().all(|c| matches!(c, Signal::Constant(_)))
    }
    fn add_rates(&mut self, at: &Situation<'_>, rates: &mut LoadRates<'_>) -> bool {
        if self.axes == WrenchAxes::Body {
            return true;
        }
        let LoadRates { d_dq, nv, points: [p, _], .. } = rates;
        if !p.set(at, Some(self.body), self.point) {
            return false;
        }
        let six = [0, 1, 2, 3, 4, 5].map(|i| self.components[i].value(at.t));
        let wrench = Wrench::from_array(six);
        for j in 0..*nv {
            let turn = p.angular(j);
            let (moment, force) = (turn.cross(wrench.moment), turn.cross(wrench.force));
            for i in 0..*nv {
                d_dq[i * *nv + j] -= p.angular(i).dot(moment) + p.linear(i).dot(force);
            }
        }
        true
    }
    fn add_wide(&self, at: &WideSituation<'_>, loads: &mut WideLoads<'_>) -> bool {
        let mut six = [0.0; 6];
        for (value, signal) in six.iter_mut().zip(&self.components) {
            let Signal::Constant(x) = signal else { return false };
            *value = *x;
        }
        let mut wrench = Wrench::from_array(six.map(Dd::from_f64));
        if self.axes == WrenchAxes::World {
            let r = at.pose(Some(self.body)).rotation;
            wrench = Wrench::new(r.transpose_mul(wrench.moment), r.transpose_mul(wrench.force));
        }
        wrench.moment += Vec3(self.point.0.map(Dd::from_f64)).cross(wrench.force);
        loads.wrenches[self.body] += wrench;
        true
    }
    fn breaks(&self) -> Vec<f64> {
        self.components.iter().flat_map(Signal::breaks).collect()
    }
    fn another(&self) -> Option<Box<dyn Force>> {
        Some(Box::new(self.clone()))
    }
}
