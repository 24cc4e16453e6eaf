//! What a scene needs, decided once, and what is left out.

use crate::force::Force;
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
        let momentum = !model.is_empty()
            && (0..model.len())
                .all(|k| model.tree().parent(k).is_some() || model.joints()[k].kind == JointKind::Free);
        Plan {
            kinematics: needs.iter().any(|n| n.kinematics),
            wrenches,
            work: needs.iter().any(|n| !n.conservative) || has_modal_damping(model),
            impulse: momentum && (gravity || forces.iter().any(|f| f.is_external(model))),
            momentum,
            gravity,
            form: Form::Auto,
        }
    }
    /// Everything, whether needed or not: the general code that a plan is compared with.
    pub fn everything() -> Self {
        Plan {
            kinematics: true,
            wrenches: true,
            work: true,
            impulse: true,
            momentum: true,
            gravity: true,
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
        say(false, "loop closures and their projection: the model is a tree");
        say(false, "articulated sweep over prescribed joints: every joint is passive");
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
