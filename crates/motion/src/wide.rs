//! The equations of motion in double-double numbers, for references of scenes whose forces can be had in them.

use crate::dynamics::Dynamics;
use crate::extrapolation::coordinate_rate;
use crate::force::Force;
use crate::system::System;
use phipsi_model::Model;
use phipsi_recursion::{DynamicsError, ForwardDynamics, Kinematics, Layout};
use phipsi_spatial::{Dd, Motion, Transform, Vec3, Wrench};

/// The state that a force sees, in double-double numbers.
pub struct WideSituation<'a> {
    /// The mechanism.
    pub model: &'a Model,
    /// Its compiled form.
    pub layout: &'a Layout<Dd>,
    /// Position coordinates, nq.
    pub q: &'a [Dd],
    /// Velocities, nv.
    pub v: &'a [Dd],
    /// Poses and velocities of all bodies.
    pub kinematics: &'a Kinematics<Dd>,
}

impl WideSituation<'_> {
    /// World pose of a body; the identity for the world.
    pub fn pose(&self, body: Option<usize>) -> Transform<Dd> {
        self.kinematics.pose(self.layout, body)
    }
    /// Velocity of a body in its own axes at its own origin.
    pub fn velocity(&self, body: Option<usize>) -> Motion<Dd> {
        self.kinematics.velocity_in_body(self.layout, body)
    }
}

/// Where forces add, as [`crate::Loads`].
pub struct WideLoads<'a> {
    /// Generalised forces, nv.
    pub tau: &'a mut [Dd],
    /// Wrench on each body of the model, at its frame's origin, its axes.
    pub wrenches: &'a mut [Wrench<Dd>],
}

/// A mechanism under its forces in double-double numbers.
pub struct WideDynamics<'a> {
    model: &'a Model,
    forces: &'a [Box<dyn Force>],
    layout: Layout<Dd>,
    kinematics: Kinematics<Dd>,
    forward: ForwardDynamics<Dd>,
    tau: Vec<Dd>,
    wrenches: Vec<Wrench<Dd>>,
    poses: bool,
}

impl<'a> WideDynamics<'a> {
    /// Of a mechanism; `None` if one of its forces cannot be had in these numbers ([`Force::add_wide`]), or if it switches.
    pub fn new(dynamics: &'a Dynamics) -> Option<Self> {
        if dynamics.is_switching() {
            return None;
        }
        let model = System::model(dynamics);
        let layout =
            Layout::<Dd>::new(model).with_gravity(Vec3(dynamics.layout().gravity().0.map(Dd::from_f64)));
        let mut wide = WideDynamics {
            kinematics: Kinematics::new(&layout),
            forward: ForwardDynamics::new(&layout),
            tau: vec![Dd::from_f64(0.0); model.nv()],
            wrenches: vec![Wrench::zero(); model.len()],
            poses: dynamics.plan().kinematics || dynamics.plan().wrenches,
            forces: dynamics.forces(),
            model,
            layout,
        };
        let q = model.neutral::<Dd>();
        let v = vec![Dd::from_f64(0.0); model.nv()];
        let able = wide.loads(&q, &v).ok()?;
        able.then_some(wide)
    }
    fn loads(&mut self, q: &[Dd], v: &[Dd]) -> Result<bool, DynamicsError> {
        self.tau.fill(Dd::from_f64(0.0));
        self.wrenches.fill(Wrench::zero());
        if self.poses {
            self.kinematics.set_position(&self.layout, q)?;
            self.kinematics.set_velocity(&self.layout, v)?;
        }
        let at =
            WideSituation { model: self.model, layout: &self.layout, q, v, kinematics: &self.kinematics };
        let mut loads = WideLoads { tau: &mut self.tau, wrenches: &mut self.wrenches };
        Ok(self.forces.iter().all(|f| f.add_wide(&at, &mut loads)))
    }
    /// Rates of y = (q, v), quaternions as four numbers ([`coordinate_rate`]).
    ///
    /// # Errors
    /// Those of forward dynamics; where a force has no value, the rates are not numbers.
    pub fn derivative(&mut self, y: &[Dd], out: &mut [Dd]) -> Result<(), DynamicsError> {
        let (q, v) = y.split_at(self.model.nq());
        let (q_dot, v_dot) = out.split_at_mut(self.model.nq());
        coordinate_rate(self.model, q, v, q_dot);
        let able = self.loads(q, v)?;
        let wrenches = self.poses.then_some(&self.wrenches[..]);
        self.forward.run(&self.layout, q, v, &self.tau, wrenches, v_dot)?;
        if !able {
            v_dot.fill(Dd::from_f64(f64::NAN));
        }
        Ok(())
    }
}
