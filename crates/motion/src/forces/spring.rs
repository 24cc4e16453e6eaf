//! Springs and dampers at joints and between points of bodies.

use crate::force::{Force, ForceError, Loads, Needs, Situation, acts_on_base};
use crate::force_rates::LoadRates;
use crate::wide::{WideLoads, WideSituation};
use phipsi_model::Model;
use phipsi_spatial::{Dd, Vec3, Wrench};

/// τ = −k (q − q₀) − c v at a one-axis degree of freedom.
#[derive(Clone, Debug)]
pub struct JointSpring {
    /// The user's name.
    pub name: String,
    /// Index in q.
    pub coordinate: usize,
    /// Index in v.
    pub dof: usize,
    /// k, N·m/rad or N/m.
    pub stiffness: f64,
    /// c, N·m·s/rad or N·s/m.
    pub damping: f64,
    /// q₀, rad or m.
    pub rest: f64,
}

impl Force for JointSpring {
    fn name(&self) -> &str {
        &self.name
    }
    fn needs(&self) -> Needs {
        Needs { conservative: self.damping == 0.0, ..Needs::default() }
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        // A spring with damping is not conservative: its whole work is integrated and its potential not counted.
        loads.tau[self.dof] -=
            self.stiffness * (at.q[self.coordinate] - self.rest) + self.damping * at.v[self.dof];
        Ok(())
    }
    fn is_external(&self, model: &Model) -> bool {
        acts_on_base(model, self.dof)
    }
    fn is_autonomous(&self) -> bool {
        true
    }
    fn add_rates(&mut self, _: &Situation<'_>, rates: &mut LoadRates<'_>) -> bool {
        let at = self.dof * rates.nv + self.dof;
        rates.d_dq[at] -= self.stiffness;
        rates.d_dv[at] -= self.damping;
        true
    }
    fn add_wide(&self, at: &WideSituation<'_>, loads: &mut WideLoads<'_>) -> bool {
        let [k, c, rest] = [self.stiffness, self.damping, self.rest].map(Dd::from_f64);
        loads.tau[self.dof] -= k * (at.q[self.coordinate] - rest) + c * at.v[self.dof];
        true
    }
    fn potential(&self, at: &Situation<'_>) -> f64 {
        let x = at.q[self.coordinate] - self.rest;
        0.5 * self.stiffness * x * x
    }
    fn another(&self) -> Option<Box<dyn Force>> {
        Some(Box::new(self.clone()))
    }
}

/// A spring and damper along the line between two points: force k (L − L₀) + c dL/dt pulling them together.
#[derive(Clone, Debug)]
pub struct PointSpring {
    /// The user's name.
    pub name: String,
    /// The two bodies; `None` is the world.
    pub bodies: [Option<usize>; 2],
    /// The points in their bodies' frames, m.
    pub points: [Vec3<f64>; 2],
    /// k, N/m.
    pub stiffness: f64,
    /// c, N·s/m.
    pub damping: f64,
    /// L₀, m.
    pub rest_length: f64,
}

impl PointSpring {
    /// Vector from point a to point b and its length, world axes.
    fn line(&self, at: &Situation<'_>) -> (Vec3<f64>, f64) {
        let [a, b] = [0, 1].map(|i| at.pose(self.bodies[i]).point(self.points[i]));
        let line = b - a;
        (line, line.norm())
    }
}

impl Force for PointSpring {
    fn name(&self) -> &str {
        &self.name
    }
    fn needs(&self) -> Needs {
        Needs { kinematics: true, wrenches: true, conservative: self.damping == 0.0 }
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        let (line, length) = self.line(at);
        if length == 0.0 {
            if self.rest_length == 0.0 && self.damping == 0.0 {
                return Ok(());
            }
            let message =
                "its two points coincide, so the force has no direction; move a point or use rest_length = 0";
            return Err(ForceError { force: self.name.clone(), t: at.t, message: message.into() });
        }
        let direction = line.scale(1.0 / length);
        let [a, b] = [0, 1].map(|i| {
            let v = at.velocity(self.bodies[i]);
            at.pose(self.bodies[i]).rotation * (v.linear + v.angular.cross(self.points[i]))
        });
        let pull = self.stiffness * (length - self.rest_length) + self.damping * (b - a).dot(direction);
        for (i, sign) in [(0, 1.0), (1, -1.0)] {
            if let Some(body) = self.bodies[i] {
                let force = at.pose(self.bodies[i]).rotation.transpose_mul(direction.scale(sign * pull));
                loads.wrenches[body] += Wrench::new(self.points[i].cross(force), force);
            }
        }
        Ok(())
    }
    fn is_external(&self, _: &Model) -> bool {
        self.bodies.contains(&None)
    }
    fn is_autonomous(&self) -> bool {
        true
    }
    fn add_rates(&mut self, at: &Situation<'_>, rates: &mut LoadRates<'_>) -> bool {
        let (line, length) = self.line(at);
        if length == 0.0 {
            return false;
        }
        for (i, point) in rates.points.iter_mut().enumerate() {
            if !point.set(at, self.bodies[i], self.points[i]) {
                return false;
            }
        }
        let LoadRates { d_dq, d_dv, nv, points: [a, b], .. } = rates;
        let nv = *nv;
        let speed = |p: &crate::force_rates::PointRates| {
            (0..nv).fold(Vec3::zero(), |sum, j| sum + p.linear(j).scale(at.v[j]))
        };
        let direction = line.scale(1.0 / length);
        let apart = speed(b) - speed(a);
        let pull = self.stiffness * (length - self.rest_length) + self.damping * apart.dot(direction);
        for j in 0..nv {
            let stretch = b.linear(j) - a.linear(j);
            let turn = (stretch - direction.scale(direction.dot(stretch))).scale(1.0 / length);
            let faster = (b.rate(j) - a.rate(j)).dot(direction) + apart.dot(turn);
            let more = self.stiffness * direction.dot(stretch) + self.damping * faster;
            // Of the force on the end at point a; the other one is its opposite.
            let by_q = direction.scale(more) + turn.scale(pull);
            let by_v = direction.scale(self.damping * direction.dot(stretch));
            for (end, sign) in [(&*a, 1.0), (&*b, -1.0)] {
                let fixed = by_q - end.angular(j).cross(direction.scale(pull));
                for i in 0..nv {
                    d_dq[i * nv + j] += sign * end.linear(i).dot(fixed);
                    d_dv[i * nv + j] += sign * end.linear(i).dot(by_v);
                }
            }
        }
        true
    }
    fn add_wide(&self, at: &WideSituation<'_>, loads: &mut WideLoads<'_>) -> bool {
        let points = self.points.map(|p| Vec3(p.0.map(Dd::from_f64)));
        let [k, c, rest] = [self.stiffness, self.damping, self.rest_length].map(Dd::from_f64);
        let [a, b] = [0, 1].map(|i| at.pose(self.bodies[i]).point(points[i]));
        let line = b - a;
        let length = line.norm();
        if length == Dd::from_f64(0.0) {
            return self.rest_length == 0.0 && self.damping == 0.0;
        }
        let direction = line.scale(Dd::from_f64(1.0) / length);
        let [a, b] = [0, 1].map(|i| {
            let v = at.velocity(self.bodies[i]);
            at.pose(self.bodies[i]).rotation * (v.linear + v.angular.cross(points[i]))
        });
        let pull = k * (length - rest) + c * (b - a).dot(direction);
        for (i, pull) in [(0, pull), (1, -pull)] {
            if let Some(body) = self.bodies[i] {
                let force = at.pose(self.bodies[i]).rotation.transpose_mul(direction.scale(pull));
                loads.wrenches[body] += Wrench::new(points[i].cross(force), force);
            }
        }
        true
    }
    fn potential(&self, at: &Situation<'_>) -> f64 {
        let x = self.line(at).1 - self.rest_length;
        0.5 * self.stiffness * x * x
    }
    fn another(&self) -> Option<Box<dyn Force>> {
        Some(Box::new(self.clone()))
    }
}
