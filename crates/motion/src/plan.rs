//! What a scene needs, decided once, and what is left out.

use crate::force::{Force, acts_on_base};
use crate::prescription::Prescription;
use phipsi_model::{JointKind, Model};
use phipsi_recursion::Form;

/// The parts of the dynamics that a scene uses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Poses and velocities of bodies for the forces.
    pub kinematics: bool,
    /// Wrenches on bodies.
    pub wrenches: bool,
    /// The work of non-conservative forces is integrated with the state.
    pub work: bool,
    /// The impulse of external forces is integrated with the state.
    pub impulse: bool,
    /// Momentum is a conserved quantity: every root is free.
    pub momentum: bool,
    /// Gravity is not zero.
    pub gravity: bool,
    /// The model has closures or couplings.
    pub loops: bool,
    /// Some motion is given as a function of time.
    pub prescribed: bool,
    /// Some joint has stops or dry friction.
    pub switches: bool,
    /// The form of forward dynamics that is asked for.
    pub form: Form,
}

/// True if modes lose energy.
fn has_modal_damping(model: &Model) -> bool {
    model.bodies().iter().filter_map(|b| b.flexible.as_ref()).any(|b| b.damping.iter().any(|c| *c != 0.0))
}

impl Plan {
    /// For a model and its forces.
    pub fn new(model: &Model, forces: &[Box<dyn Force>]) -> Self {
        let needs: Vec<_> = forces.iter().map(|f| f.needs()).collect();
        let wrenches = needs.iter().any(|n| n.wrenches);
        let gravity = model.gravity() != [0.0; 3];
        // A closure to the world pushes from outside.
        let tied = model.closures().iter().any(|c| c.body_a == "world" || c.body_b == "world");
        let momentum = !model.is_empty()
            && !tied
            && (0..model.len())
                .all(|k| model.tree().parent(k).is_some() || model.joints()[k].kind == JointKind::Free);
        Plan {
            kinematics: needs.iter().any(|n| n.kinematics),
            wrenches,
            work: needs.iter().any(|n| !n.conservative) || has_modal_damping(model),
            impulse: momentum && (gravity || forces.iter().any(|f| f.is_external(model))),
            momentum,
            gravity,
            loops: !(model.closures().is_empty() && model.couplings().is_empty()),
            prescribed: false,
            switches: false,
            form: Form::Auto,
        }
    }
    /// The same where some motions are given: actuators do work, and those at a base push from outside.
    pub fn with_prescription(mut self, model: &Model, prescription: &Prescription) -> Self {
        if prescription.is_empty() {
            return self;
        }
        let at_base = prescription.joints.iter().any(|p| acts_on_base(model, p.dof));
        self.momentum &= !at_base;
        self.impulse &= !at_base;
        (self.prescribed, self.work) = (true, true);
        self
    }
    /// The same where joints of these degrees of freedom have stops or dry friction: both take energy, and those at a base push from
    /// outside.
    pub(crate) fn with_switches(mut self, model: &Model, dofs: impl Iterator<Item = usize>) -> Self {
        let at_base = dofs.into_iter().any(|dof| acts_on_base(model, dof));
        self.momentum &= !at_base;
        self.impulse &= !at_base;
        (self.switches, self.work) = (true, true);
        self
    }
    /// Everything, whether needed or not: the general code that a plan is compared with. Without closures the solver of loops finds
    /// none, without given motions it finds every joint passive.
    pub fn everything() -> Self {
        Plan {
            kinematics: true,
            wrenches: true,
            work: true,
            impulse: true,
            momentum: true,
            gravity: true,
            loops: true,
            prescribed: true,
            switches: false,
            form: Form::Auto,
        }
    }
    /// What is left out, one line each, for people.
    pub fn left_out(&self) -> Vec<String> {
        let mut lines = Vec::new();
        let mut say = |needed: bool, line: &str| {
            if !needed {
                lines.push(line.to_string());
            }
        };
        say(self.loops, "loop closures and their projection: the model is a tree");
        say(self.prescribed, "articulated sweep over prescribed joints: every joint is passive");
        say(self.switches, "events of stops and dry friction: no joint has any that act");
        say(self.gravity, "gravity: it is zero");
        say(self.kinematics, "poses of bodies in the force sweep: no force needs them");
        say(self.wrenches, "wrenches on bodies: no force adds any");
        say(self.work, "integral of work: every force has a potential");
        let no_impulse = match self.momentum {
            true => "integral of external impulse: no external force acts",
            false => "integral of external impulse: momentum is not balanced",
        };
        say(self.impulse, no_impulse);
        say(self.momentum, "momentum balance: the base is not free");
        lines
    }
}
