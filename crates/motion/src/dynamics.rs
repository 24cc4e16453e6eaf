//! The equations of motion of a mechanism under its forces, as a [`System`] for the integrators.
//!
//! Auxiliary slots, in this order: the work of non-conservative forces (if the plan integrates it), the impulse of external
//! forces (angular about the centre of mass, linear; world axes), then each force's own.

use crate::conservative::Conservative;
use crate::constraints::Constraints;
use crate::event::Events;
use crate::force::{Force, ForceError, Loads, Situation};
use crate::plan::Plan;
use crate::prescription::Prescription;
use crate::switch::Switches;
use crate::system::{Linearization, Projected, System, differences};
use phipsi_closure::{ClosedForm, ClosedFormChoice};
use phipsi_model::Model;
use phipsi_recursion::layout::GROUND;
use phipsi_recursion::{
    DynamicsError, Form, FormChoice, FormForwardDynamics, InverseDynamics, Kinematics, Layout,
    center_of_mass, potential_energy,
};
use phipsi_spatial::{Vec3, Wrench};

mod error;
mod linearization;
mod switching;

pub use error::MotionError;
use linearization::Tangent;

/// A mechanism with its forces.
pub struct Dynamics {
    model: Model,
    layout: Layout<f64>,
    forces: Vec<Box<dyn Force>>,
    plan: Plan,
    /// First auxiliary slot of each force.
    slots: Vec<usize>,
    names: Vec<String>,
    kinematics: Kinematics<f64>,
    solver: Solver,
    form_choice: Option<FormChoice>,
    closed_choice: Option<ClosedFormChoice>,
    inverse: InverseDynamics<f64>,
    rest: Vec<f64>,
    tau: Vec<f64>,
    wrenches: Vec<Wrench<f64>>,
    moving_mass: f64,
    tangent: Option<Tangent>,
    aux_dot: Vec<f64>,
    /// Times at which given motions are not smooth.
    given_breaks: Vec<f64>,
    switches: Switches,
    /// Holds joints of a tree.
    holder: Option<Box<Constraints>>,
}

/// What gives the accelerations.
#[derive(Clone)]
enum Solver {
    /// A tree of passive joints.
    Tree(FormForwardDynamics),
    /// Loops, prescribed motions, or both.
    Constrained(Box<Constraints>),
}

impl Dynamics {
    /// With the plan that the scene needs.
    ///
    /// # Errors
    /// [`MotionError::Closure`] for a coupling that cannot be.
    pub fn new(model: &Model, forces: Vec<Box<dyn Force>>) -> Result<Self, MotionError> {
        Self::prescribed(model, forces, &Prescription::default())
    }
    /// The same where motions of joints or closures are given as functions of time.
    ///
    /// # Errors
    /// As [`Dynamics::new`]; [`MotionError::Prescription`].
    pub fn prescribed(
        model: &Model,
        forces: Vec<Box<dyn Force>>,
        prescription: &Prescription,
    ) -> Result<Self, MotionError> {
        let plan = Plan::new(model, &forces).with_prescription(model, prescription);
        Self::planned(model, forces, plan, prescription)
    }
    /// With a given plan; [`Plan::everything`] is the general code.
    ///
    /// # Errors
    /// As [`Dynamics::prescribed`].
    pub fn with_plan(
        model: &Model,
        forces: Vec<Box<dyn Force>>,
        plan: Plan,
        prescription: &Prescription,
    ) -> Result<Self, MotionError> {
        Self::planned(model, forces, plan, prescription)
    }
    fn planned(
        model: &Model,
        forces: Vec<Box<dyn Force>>,
        plan: Plan,
        prescription: &Prescription,
    ) -> Result<Self, MotionError> {
        let layout = Layout::new(&model.clone().without_closures());
        let mut names = Vec::new();
        if plan.work {
            names.push("work".to_string());
        }
        if plan.impulse {
            names.extend(["x", "y", "z"].map(|a| format!("angular impulse {a}")));
            names.extend(["x", "y", "z"].map(|a| format!("impulse {a}")));
        }
        let mut slots = vec![names.len()];
        for force in &forces {
            names.extend(force.auxiliary());
            slots.push(names.len());
        }
        let mut closed_choice = None;
        let (solver, form_choice) =
            match Constraints::new(model, prescription, plan.loops || plan.prescribed)? {
                Some(mut constraints) => {
                    let choice = ClosedFormChoice::new(model, plan.form)?;
                    constraints.set_form(choice.form)?;
                    closed_choice = Some(choice);
                    (Solver::Constrained(Box::new(constraints)), None)
                }
                None => {
                    let (forward, choice) = forward(model, &layout, plan.form);
                    (Solver::Tree(forward), choice)
                }
            };
        let moving = layout.carriers().iter().filter(|c| c.body != GROUND);
        Ok(Dynamics {
            moving_mass: moving.map(|c| c.inertia.mass).sum(),
            kinematics: Kinematics::new(&layout),
            solver,
            form_choice,
            closed_choice,
            given_breaks: prescription.breaks(),
            switches: Switches::new(model, Vec::new())?,
            holder: None,
            inverse: InverseDynamics::new(&layout),
            tangent: None,
            aux_dot: Vec::new(),
            rest: vec![0.0; model.nv()],
            tau: vec![0.0; model.nv()],
            wrenches: vec![Wrench::zero(); model.len()],
            model: model.clone(),
            layout,
            forces,
            plan,
            slots,
            names,
        })
    }
    /// Another one like this, for a second thread; `None` where a force has no copy ([`Force::another`]). Both give the same numbers
    /// to the last bit.
    pub fn another(&self) -> Option<Self> {
        let forces = self.forces.iter().map(|f| f.another()).collect::<Option<Vec<_>>>()?;
        Some(Dynamics {
            model: self.model.clone(),
            layout: self.layout.clone(),
            forces,
            plan: self.plan.clone(),
            slots: self.slots.clone(),
            names: self.names.clone(),
            kinematics: self.kinematics.clone(),
            solver: self.solver.clone(),
            form_choice: self.form_choice,
            closed_choice: self.closed_choice,
            inverse: self.inverse.clone(),
            rest: self.rest.clone(),
            tau: self.tau.clone(),
            wrenches: self.wrenches.clone(),
            moving_mass: self.moving_mass,
            tangent: None,
            aux_dot: self.aux_dot.clone(),
            given_breaks: self.given_breaks.clone(),
            switches: self.switches.clone(),
            holder: self.holder.clone(),
        })
    }
    /// What is computed.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }
    /// Another form of forward dynamics than the plan's; of loops and prescribed motions that of [`ClosedFormChoice`].
    ///
    /// # Errors
    /// [`MotionError::Closure`] for a form that mechanisms with loops or prescribed motions do not have, [`MotionError::Dynamics`] for
    /// one that flexible bodies do not have; nothing has changed then.
    pub fn set_form(&mut self, form: Form) -> Result<(), MotionError> {
        if form == self.plan.form {
            return Ok(());
        }
        match &mut self.solver {
            Solver::Tree(tree) => (*tree, self.form_choice) = forward(&self.model, &self.layout, form),
            Solver::Constrained(_) => {
                self.closed_choice = Some(ClosedFormChoice::new(&self.model, form)?);
            }
        }
        self.plan.form = form;
        self.spread_form()
    }
    /// Takes the form over to what closes loops and holds joints.
    fn spread_form(&mut self) -> Result<(), MotionError> {
        let of_tree = ClosedFormChoice::beside(self.form(), self.layout.is_flexible());
        let form = self.closed_choice.map_or(of_tree, |choice| choice.form);
        self.constraints().map_or(Ok(()), |constraints| Ok(constraints.set_form(form)?))
    }
    /// The form that runs, of loops and prescribed motions the one that asks for it; never [`Form::Auto`].
    pub fn form(&self) -> Form {
        match (&self.solver, self.closed_choice) {
            (Solver::Tree(forward), _) => forward.form(),
            (_, Some(choice)) if choice.form == ClosedForm::SquareRoot => Form::SquareRoot,
            _ => Form::Plain,
        }
    }
    /// True if the model has loops or prescribed motions.
    pub fn is_constrained(&self) -> bool {
        matches!(self.solver, Solver::Constrained(_))
    }
    /// True if motions of joints or closures are given.
    pub fn is_prescribed(&self) -> bool {
        matches!(&self.solver, Solver::Constrained(c) if c.is_prescribed())
    }
    /// Degrees of freedom whose motion is given.
    pub fn active(&self) -> Vec<bool> {
        match &self.solver {
            Solver::Tree(_) => vec![false; self.model.nv()],
            Solver::Constrained(c) => c.given().to_vec(),
        }
    }
    /// Closures and couplings (by their following joint), with the number of rows of each.
    pub fn loops(&self) -> Vec<(String, usize)> {
        match &self.solver {
            Solver::Tree(_) => Vec::new(),
            Solver::Constrained(c) => c.loops(),
        }
    }
    /// Number of independent rows of all closures at a state.
    ///
    /// # Errors
    /// [`MotionError`].
    pub fn rank(&mut self, t: f64, q: &[f64], v: &[f64]) -> Result<usize, MotionError> {
        match &mut self.solver {
            Solver::Tree(_) => Ok(0),
            Solver::Constrained(c) => Ok(c.rank(t, q, v)?),
        }
    }
    /// Largest residuals of closures: positions (m, rad) and velocities; `None` without closures.
    ///
    /// # Errors
    /// [`MotionError`].
    pub fn closure_residual(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
    ) -> Result<Option<[f64; 2]>, MotionError> {
        match &mut self.solver {
            Solver::Constrained(c) if self.plan.loops => Ok(Some(c.residual(t, q, v)?)),
            _ => Ok(None),
        }
    }
    /// Puts coordinates whose motion is given where they are at time t.
    pub fn follow(&self, t: f64, q: &mut [f64], v: &mut [f64]) {
        if let Solver::Constrained(c) = &self.solver {
            c.follow(t, q, v);
        }
    }
    /// Closes the loops from a rough guess, then makes the velocities consistent. Degrees of freedom (nv) that are `kept` stay:
    /// the first ones in position, the second in velocity.
    ///
    /// # Errors
    /// [`MotionError::Closure`] if the loops cannot be closed from here.
    pub fn assemble(
        &mut self,
        t: f64,
        q: &mut [f64],
        v: &mut [f64],
        kept: [&[bool]; 2],
    ) -> Result<Projected, MotionError> {
        match &mut self.solver {
            Solver::Tree(_) => Ok(Projected::default()),
            Solver::Constrained(c) => Ok(c.assemble(t, (q, v), kept)?),
        }
    }
    /// The form of loops and prescribed motions, and why; `None` of a tree without them.
    pub fn closed_form_choice(&self) -> Option<&ClosedFormChoice> {
        self.closed_choice.as_ref()
    }
    /// Why this form, where the plan's is [`Form::Auto`].
    pub fn form_choice(&self) -> Option<&FormChoice> {
        self.form_choice.as_ref()
    }
    /// The compiled model.
    pub fn layout(&self) -> &Layout<f64> {
        &self.layout
    }
    /// The forces.
    pub fn forces(&self) -> &[Box<dyn Force>] {
        &self.forces
    }
    /// Names of the auxiliary slots.
    pub fn auxiliary_names(&self) -> &[String] {
        &self.names
    }
    /// The integrated work, if the plan has it.
    pub fn work(&self, auxiliary: &[f64]) -> f64 {
        if self.plan.work { auxiliary[0] } else { 0.0 }
    }
    /// The integrated impulse of external forces, if the plan has it.
    pub fn impulse(&self, auxiliary: &[f64]) -> Wrench<f64> {
        if self.plan.impulse {
            let first = usize::from(self.plan.work);
            Wrench::from_array(std::array::from_fn(|i| auxiliary[first + i]))
        } else {
            Wrench::zero()
        }
    }
    /// For a method without auxiliary quantities (midpoint): no integrals of work and impulse. Momentum is then balanced only
    /// where no external force changes it.
    pub fn leave_out_integrals(&mut self) {
        self.plan.momentum &= !self.plan.impulse;
        (self.plan.work, self.plan.impulse) = (false, false);
        self.names.clear();
        self.tangent = None;
        self.slots = vec![0];
        for force in &self.forces {
            self.names.extend(force.auxiliary());
            self.slots.push(self.names.len());
        }
    }
    /// Times at which a force is not smooth, sorted, without repetition.
    pub fn breaks(&self) -> Vec<f64> {
        let mut breaks: Vec<f64> = self.forces.iter().flat_map(|f| f.breaks()).collect();
        breaks.extend(&self.given_breaks);
        breaks.sort_by(f64::total_cmp);
        breaks.dedup();
        breaks
    }
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

    fn place(&mut self, q: &[f64], v: &[f64]) -> Result<(), DynamicsError> {
        self.kinematics.set_position(&self.layout, q)?;
        self.kinematics.set_velocity(&self.layout, v)
    }

    /// Adds the loads of the forces that are conservative or not, as asked.
    fn add_forces(
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
    fn collect(
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

/// Forward dynamics in a form; with `Auto`, measured on the model.
fn forward(model: &Model, layout: &Layout<f64>, form: Form) -> (FormForwardDynamics, Option<FormChoice>) {
    let choice = (form == Form::Auto).then(|| FormChoice::of(model, layout));
    let form = choice.map_or(form, |choice| choice.form);
    (FormForwardDynamics::new(model, layout, form), choice)
}

impl System for Dynamics {
    type Error = MotionError;

    fn model(&self) -> &Model {
        &self.model
    }

    fn auxiliary_len(&self) -> usize {
        self.names.len()
    }

    fn derivative(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
        v_dot: &mut [f64],
        aux_dot: &mut [f64],
    ) -> Result<(), MotionError> {
        self.collect(t, (q, v, aux), aux_dot)?;
        let wrenches = self.plan.wrenches.then_some(&self.wrenches[..]);
        let holder = self.holder.as_mut().filter(|_| self.switches.any_held);
        match (&mut self.solver, holder) {
            (Solver::Tree(forward), None) => {
                forward.run(&self.layout, q, v, &self.tau, wrenches, v_dot)?;
            }
            (Solver::Constrained(c), _) | (Solver::Tree(_), Some(c)) => {
                let wants_power = self.plan.work && self.plan.prescribed;
                let power = c.run((t, q, v), &self.tau, wrenches, wants_power, v_dot)?;
                if wants_power {
                    aux_dot[0] += power;
                }
            }
        }
        Ok(())
    }

    fn project(&mut self, t: f64, q: &mut [f64], v: &mut [f64]) -> Result<Option<Projected>, MotionError> {
        match &mut self.solver {
            Solver::Tree(_) => Ok(None),
            Solver::Constrained(c) => Ok(Some(c.project(t, q, v)?)),
        }
    }

    fn events(&mut self) -> Option<&mut dyn Events<Error = MotionError>> {
        if self.functions() > 0 { Some(self) } else { None }
    }

    fn is_autonomous(&self) -> bool {
        matches!(self.solver, Solver::Tree(_)) && self.forces.iter().all(|f| f.is_autonomous())
    }

    fn linearize(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
        out: &mut Linearization,
    ) -> Result<u64, MotionError> {
        let loops = matches!(self.solver, Solver::Constrained(_)) || self.switches.any_held;
        if loops || !self.analytic(t, (q, v, aux), out)? {
            return differences(self, t, (q, v, aux), out);
        }
        if !aux.is_empty() {
            self.auxiliary_rates(t, (q, v, aux), out)?;
        }
        Ok(0)
    }
}

/// Weight and conservative forces, for the midpoint method.
impl Conservative for Dynamics {
    type Error = MotionError;

    fn evaluate(&mut self, q: &[f64], out: &mut [f64]) -> Result<f64, MotionError> {
        if self.is_prescribed() {
            return Err(MotionError::Driven);
        }
        if self.is_switching() {
            let what = "the midpoint method knows no stops, dry friction and events that change the state; \
                        use \"dop853\" or \"tsit5\"";
            return Err(MotionError::Switch { what: what.into() });
        }
        if let Some(force) = self.forces.iter().find(|f| !f.needs().conservative || !f.auxiliary().is_empty())
        {
            return Err(MotionError::NotConservative { force: force.name().into() });
        }
        let rest = std::mem::take(&mut self.rest);
        let result = self.evaluate_at(q, &rest, out);
        self.rest = rest;
        result
    }
}

impl Dynamics {
    fn evaluate_at(&mut self, q: &[f64], rest: &[f64], out: &mut [f64]) -> Result<f64, MotionError> {
        self.tau.iter_mut().for_each(|x| *x = 0.0);
        self.wrenches.iter_mut().for_each(|w| *w = Wrench::zero());
        self.place(q, rest)?;
        self.add_forces(true, (0.0, q, rest), &[], &mut [])?;
        let (model, layout, kinematics) = (&self.model, &self.layout, Some(&self.kinematics));
        let at = Situation { model, layout, t: 0.0, q, v: rest, kinematics };
        let springs: f64 = self.forces.iter().map(|f| f.potential(&at)).sum();
        // What holds the tree at rest against weight and wrenches is their opposite.
        self.inverse.run(&self.layout, q, rest, rest, Some(&self.wrenches), out)?;
        for (out, tau) in out.iter_mut().zip(&self.tau) {
            *out = tau - *out;
        }
        Ok(potential_energy(&self.layout, q)? + springs)
    }
}
