//! Attraction by a point mass, with the gravity gradient over each body.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | r | from the attracting point to a body's centre of mass, body axes | 3 |
//! | J | inertia about the centre of mass, body axes | 3×3 |
//! | U | −μ m/r − μ/(2 r³) (tr J − 3 r·J r/r²) | |
//! | F, N | −∂U/∂r; moment about the centre of mass, 3μ r × J r/r⁵ | 3 |
//!
//! Source: MacCullagh's formula, second order in size over distance; Hughes, *Spacecraft Attitude Dynamics*, 8.1.

use crate::force::{Force, ForceError, Loads, Needs, Situation};
use crate::force_rates::LoadRates;
use crate::wide::{WideLoads, WideSituation};
use phipsi_model::Model;
use phipsi_spatial::{Quaternion, Real, Sym3, Transform, Vec3, Wrench};

/// Attraction of every body by a point mass at rest. The error of the potential is of third order in size over distance.
#[derive(Clone, Debug)]
pub struct CentralGravity {
    name: String,
    /// μ, m³/s².
    mu: f64,
    /// The attracting point, world, m.
    center: Vec3<f64>,
    bodies: Vec<Attracted>,
}

/// A body that has mass.
#[derive(Clone, Copy, Debug)]
struct Attracted {
    body: usize,
    mass: f64,
    /// Centre of mass, body frame.
    point: Vec3<f64>,
    inertia: Sym3<f64>,
}

impl CentralGravity {
    /// Of all bodies of a model; those that are flexible count as they are undeformed. `mu`: G times the attracting mass, m³/s²;
    /// `center`: its place in the world, m.
    pub fn new(name: impl Into<String>, model: &Model, mu: f64, center: [f64; 3]) -> Self {
        let attracted = |(body, b): (usize, &phipsi_model::Body)| {
            let [xx, xy, xz, yy, yz, zz] = b.inertia.tensor;
            let rotation = Quaternion(b.inertia.frame.rotation).to_rotation();
            let inertia = Sym3 { xx, xy, xz, yy, yz, zz }.rotate(&rotation);
            Attracted { body, mass: b.inertia.mass, point: Vec3(b.inertia.frame.translation), inertia }
        };
        let bodies = model.bodies().iter().enumerate().filter(|(_, b)| b.inertia.mass > 0.0).map(attracted);
        CentralGravity { name: name.into(), mu, center: Vec3(center), bodies: bodies.collect() }
    }
    fn too_near(&self, t: f64) -> ForceError {
        let message = "a body's centre of mass is at the attracting point; keep them apart".into();
        ForceError { force: self.name.clone(), t, message }
    }
}

impl Attracted {
    /// r of a pose.
    fn line<T: Real>(&self, center: Vec3<T>, pose: &Transform<T>) -> Vec3<T> {
        let point = Vec3::splat(self.point.0);
        pose.rotation.transpose_mul(pose.translation - center) + point
    }
    fn inertia<T: Real>(&self) -> Sym3<T> {
        let Sym3 { xx, xy, xz, yy, yz, zz } = self.inertia;
        let [xx, xy, xz, yy, yz, zz] = [xx, xy, xz, yy, yz, zz].map(T::splat);
        Sym3 { xx, xy, xz, yy, yz, zz }
    }
    /// N about the centre of mass, and F.
    fn pull<T: Real>(&self, mu: T, r: Vec3<T>) -> Wrench<T> {
        let inertia = self.inertia::<T>();
        let s = T::splat;
        let trace = inertia.xx + inertia.yy + inertia.zz;
        let two = T::one() / r.dot(r);
        let three = two * two.sqrt();
        let five = three * two;
        let moved = inertia * r;
        let along = -s(self.mass) * three + s(0.5) * five * (s(15.0) * r.dot(moved) * two - s(3.0) * trace);
        let force = r.scale(mu * along) - moved.scale(s(3.0) * mu * five);
        Wrench::new(r.cross(moved).scale(s(3.0) * mu * five), force)
    }
    /// Change of the pull by a change of r.
    fn pull_rate(&self, mu: f64, r: Vec3<f64>, d: Vec3<f64>) -> Wrench<f64> {
        let inertia = self.inertia;
        let trace = inertia.xx + inertia.yy + inertia.zz;
        let two = 1.0 / r.dot(r);
        let (three, five) = (two * two.sqrt(), two * two * two.sqrt());
        let closer = -r.dot(d) * two;
        let (moved, turned) = (inertia * r, inertia * d);
        let q = r.dot(moved);
        let along = -self.mass * three + 0.5 * five * (15.0 * q * two - 3.0 * trace);
        let more = -self.mass * 3.0 * closer * three
            + 0.5 * five * (15.0 * two * (2.0 * d.dot(moved) + 7.0 * closer * q) - 15.0 * closer * trace);
        let force = r.scale(mu * more) + d.scale(mu * along)
            - (turned + moved.scale(5.0 * closer)).scale(3.0 * mu * five);
        let moment = d.cross(moved) + r.cross(turned) + r.cross(moved).scale(5.0 * closer);
        Wrench::new(moment.scale(3.0 * mu * five), force)
    }
    /// U.
    fn potential(&self, mu: f64, r: Vec3<f64>) -> f64 {
        let inertia = self.inertia;
        let trace = inertia.xx + inertia.yy + inertia.zz;
        let two = 1.0 / r.dot(r);
        let one = two.sqrt();
        -mu * one * (self.mass + 0.5 * two * (trace - 3.0 * r.dot(inertia * r) * two))
    }
}

impl Force for CentralGravity {
    fn name(&self) -> &str {
        &self.name
    }
    fn needs(&self) -> Needs {
        Needs { kinematics: true, wrenches: true, conservative: true }
    }
    fn is_autonomous(&self) -> bool {
        true
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        for b in &self.bodies {
            let r = b.line(self.center, &at.pose(Some(b.body)));
            if r == Vec3::zero() {
                return Err(self.too_near(at.t));
            }
            let mut pull = b.pull(self.mu, r);
            pull.moment += b.point.cross(pull.force);
            loads.wrenches[b.body] += pull;
        }
        Ok(())
    }
    fn potential(&self, at: &Situation<'_>) -> f64 {
        self.bodies.iter().map(|b| b.potential(self.mu, b.line(self.center, &at.pose(Some(b.body))))).sum()
    }
    fn add_rates(&mut self, at: &Situation<'_>, rates: &mut LoadRates<'_>) -> bool {
        let LoadRates { d_dq, nv, points: [p, _], .. } = rates;
        for b in &self.bodies {
            let pose = at.pose(Some(b.body));
            let r = b.line(self.center, &pose);
            if r == Vec3::zero() || !p.set(at, Some(b.body), b.point) {
                return false;
            }
            for j in 0..*nv {
                let (turn, shift) = (p.angular(j), p.linear(j));
                // r in body axes: it turns back where the body turns.
                let change = pose.rotation.transpose_mul(shift) - pose.rotation.transpose_mul(turn).cross(r);
                let pull = b.pull_rate(self.mu, r, change);
                let (moment, force) = (pose.rotation * pull.moment, pose.rotation * pull.force);
                for i in 0..*nv {
                    d_dq[i * *nv + j] += p.angular(i).dot(moment) + p.linear(i).dot(force);
                }
            }
        }
        true
    }
    fn add_wide(&self, at: &WideSituation<'_>, loads: &mut WideLoads<'_>) -> bool {
        use phipsi_spatial::Dd;
        for b in &self.bodies {
            let r = b.line(Vec3(self.center.0.map(Dd::from_f64)), &at.pose(Some(b.body)));
            let mut pull = b.pull(Dd::from_f64(self.mu), r);
            pull.moment += Vec3(b.point.0.map(Dd::from_f64)).cross(pull.force);
            loads.wrenches[b.body] += pull;
        }
        true
    }
    fn another(&self) -> Option<Box<dyn Force>> {
        Some(Box::new(self.clone()))
    }
}
