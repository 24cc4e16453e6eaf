//! Springs and dampers at joints and between points of bodies.

use crate::force::{Force, ForceError, Loads, Needs, Situation, acts_on_base};
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
    fn add_wide(&self, at: &WideSituation<'_>, loads: &mut WideLoads<'_>) -> bool {
        let [k, c, rest] = [self.stiffness, self.damping, self.rest].map(Dd::from_f64);
        loads.tau[self.dof] -= k * (at.q[self.coordinate] - rest) + c * at.v[self.dof];
        true
    }
    fn potential(&self, at: &Situation<'_>) -> f64 {
        let x = at.q[self.coordinate] - self.rest;
        0.5 * self.stiffness * x * x
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
}
