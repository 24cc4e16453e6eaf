//! The forces at a state: their loads, potentials, power, and what they change of the momentum.

use super::{Dynamics, MotionError};
use crate::force::{ForceError, Loads, Situation};
use phipsi_recursion::{DynamicsError, center_of_mass};
use phipsi_spatial::{Vec3, Wrench};

impl Dynamics {
    /// Potential energies of the conservative forces at a state.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn potentials(&mut self, t: f64, q: &[f64], v: &[f64]) -> Result<Vec<f64>, DynamicsError> {
        self.place(q, v)?;
        let (model, layout, kinematics) = (&self.model, &self.layout, Some(&self.kinematics));
        let at = Situation { model, layout, t, q, v, kinematics };
        Ok(self.forces.iter().filter(|f| f.needs().conservative).map(|f| f.potential(&at)).collect())
    }

    /// Names of the parts of potential energies that are of interest, force after force.
    pub fn terms(&self) -> Vec<String> {
        self.forces.iter().flat_map(|f| f.terms()).collect()
    }
    /// The parts of potential energies at a state, in the order of [`Dynamics::terms`].
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn term_energies(&mut self, t: f64, q: &[f64], v: &[f64]) -> Result<Vec<f64>, DynamicsError> {
        if self.forces.iter().all(|f| f.terms().is_empty()) {
            return Ok(Vec::new());
        }
        self.place(q, v)?;
        let (model, layout, kinematics) = (&self.model, &self.layout, Some(&self.kinematics));
        let at = Situation { model, layout, t, q, v, kinematics };
        Ok(self.forces.iter().flat_map(|f| f.term_energies(&at)).collect())
    }

    pub(super) fn place(&mut self, q: &[f64], v: &[f64]) -> Result<(), DynamicsError> {
        self.kinematics.set_position(&self.layout, q)?;
        self.kinematics.set_velocity(&self.layout, v)
    }

    /// Adds the loads of the forces that are conservative or not, as asked.
    pub(super) fn add_forces(
        &mut self,
        conservative: bool,
        (t, q, v): (f64, &[f64], &[f64]),
        aux: &[f64],
        aux_dot: &mut [f64],
    ) -> Result<(), ForceError> {
        let kinematics = self.plan.kinematics.then_some(&self.kinematics);
        let at = Situation { model: &self.model, layout: &self.layout, t, q, v, kinematics };
        let mut loads = Loads { tau: &mut self.tau, wrenches: &mut self.wrenches };
        for (i, force) in self.forces.iter_mut().enumerate() {
            if force.needs().conservative == conservative {
                let slots = self.slots[i]..self.slots[i + 1];
                // The midpoint method has no auxiliary quantities at all.
                let slots = if slots.is_empty() { 0..0 } else { slots };
                force.add(&at, &aux[slots.clone()], &mut aux_dot[slots], &mut loads)?;
            }
        }
        Ok(())
    }

    /// All loads at a state, and the rates of the auxiliary quantities.
    pub(super) fn collect(
        &mut self,
        t: f64,
        (q, v, aux): (&[f64], &[f64], &[f64]),
        aux_dot: &mut [f64],
    ) -> Result<(), MotionError> {
        self.tau.iter_mut().for_each(|x| *x = 0.0);
        if self.plan.wrenches {
            self.wrenches.iter_mut().for_each(|w| *w = Wrench::zero());
        }
        if self.plan.kinematics || self.plan.wrenches || self.plan.impulse {
            self.place(q, v)?;
        }
        self.add_forces(false, (t, q, v), aux, aux_dot)?;
        self.switches.add_friction(&mut self.tau);
        if self.plan.work {
            aux_dot[0] = self.power(v);
        }
        self.add_forces(true, (t, q, v), aux, aux_dot)?;
        if self.plan.impulse {
            let rate = self.external(q)?.to_array();
            let first = usize::from(self.plan.work);
            aux_dot[first..first + 6].copy_from_slice(&rate);
        }
        Ok(())
    }

    /// Power of the loads collected so far.
    fn power(&self, v: &[f64]) -> f64 {
        let joints: f64 = self.tau.iter().zip(v).map(|(tau, v)| tau * v).sum();
        let bodies = |k: usize| self.kinematics.velocity_in_body(&self.layout, Some(k)).dot(self.wrenches[k]);
        let wrenches = if self.plan.wrenches { (0..self.model.len()).map(bodies).sum::<f64>() } else { 0.0 };
        joints + wrenches - self.modal_loss(v)
    }

    /// η̇·C η̇ over all flexible bodies.
    fn modal_loss(&self, v: &[f64]) -> f64 {
        let mut loss = 0.0;
        for (k, body) in self.model.bodies().iter().enumerate() {
            let Some(flexible) = &body.flexible else { continue };
            let rates = &v[self.model.mode_v_range(k)];
            for (row, x) in flexible.damping.chunks_exact(rates.len().max(1)).zip(rates) {
                loss += x * row.iter().zip(rates).map(|(c, y)| c * y).sum::<f64>();
            }
        }
        loss
    }

    /// Rate of momentum by external forces: moment about the centre of mass, force; world axes.
    fn external(&self, q: &[f64]) -> Result<Wrench<f64>, DynamicsError> {
        let center = center_of_mass(&self.layout, q)?;
        let mut total = Wrench::new(Vec3::zero(), Vec3(self.model.gravity()).scale(self.moving_mass));
        let mut add = |k: usize, wrench: Wrench<f64>| {
            let pose = self.kinematics.pose(&self.layout, Some(k));
            let force = pose.rotation * wrench.force;
            total.moment += pose.rotation * wrench.moment + (pose.translation - center).cross(force);
            total.force += force;
        };
        for k in 0..self.model.len() {
            if self.plan.wrenches && self.wrenches[k] != Wrench::zero() {
                add(k, self.wrenches[k]);
            }
            if self.model.tree().parent(k).is_none() && self.model.v_range(k).len() == 6 {
                let first = self.model.v_offset(k);
                add(k, Wrench::from_array(std::array::from_fn(|i| self.tau[first + i])));
            }
        }
        Ok(total)
    }
}
