//! Stops and dry friction of joints: what they are, and the modes in which they can be.

use crate::dynamics::MotionError;
use crate::event::{Event, Mode};
use phipsi_model::Model;

/// Stops of a degree of freedom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stops {
    /// Index in q.
    pub coordinate: usize,
    /// Lower stop, rad or m; −∞ for none.
    pub lower: f64,
    /// Upper stop; ∞ for none.
    pub upper: f64,
    /// Newton's coefficient of restitution e, 0 … 1: ṡ⁺ = −e ṡ⁻.
    pub restitution: f64,
}

/// Coulomb's dry friction of a degree of freedom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DryFriction {
    /// Force while it slides, N·m or N.
    pub sliding: f64,
    /// Largest force that holds it, N·m or N; not below `sliding`.
    pub breakaway: f64,
}

/// A degree of freedom with stops, dry friction, or both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSwitch {
    /// Index in v.
    pub dof: usize,
    /// Stops.
    pub stops: Option<Stops>,
    /// Friction.
    pub friction: Option<DryFriction>,
}

impl JointSwitch {
    /// Dry friction of a model's joints (URDF `friction`) at each of their degrees of freedom, the breakaway force being `ratio` times
    /// the sliding force; and their limits as stops with a restitution each, where `restitution` gives one (by number of the joint).
    pub fn of_model(
        model: &Model,
        ratio: impl Fn(usize) -> f64,
        restitution: impl Fn(usize) -> Option<f64>,
    ) -> Vec<JointSwitch> {
        let mut switches = Vec::new();
        for k in model.moving_joints() {
            let joint = &model.joints()[k];
            let friction = (joint.friction != 0.0)
                .then(|| DryFriction { sliding: joint.friction, breakaway: joint.friction * ratio(k) });
            let stops = match (joint.limits.position, restitution(k)) {
                (Some([lower, upper]), Some(restitution)) if joint.kind.nv() == 1 => {
                    Some(Stops { coordinate: model.q_offset(k), lower, upper, restitution })
                }
                _ => None,
            };
            if friction.is_some() || stops.is_some() {
                switches.extend(model.v_range(k).map(|dof| JointSwitch { dof, stops, friction }));
            }
        }
        switches
    }
    pub(crate) fn breakaway(&self) -> f64 {
        self.friction.map_or(0.0, |f| f.breakaway)
    }
    /// Distances from the stops, lower and upper; infinite where there is none.
    pub(crate) fn gaps(&self, q: &[f64]) -> [f64; 2] {
        self.stops.map_or([f64::INFINITY; 2], |s| [q[s.coordinate] - s.lower, s.upper - q[s.coordinate]])
    }
    /// How it moves at a speed that is not zero, or in a direction from rest.
    pub(crate) fn moving(&self, speed: f64) -> Mode {
        match self.friction {
            None => Mode::Free,
            Some(_) if speed > 0.0 => Mode::Forward,
            Some(_) => Mode::Backward,
        }
    }
    /// What is wrong with it.
    fn problem(&self, model: &Model) -> Option<String> {
        if self.dof >= model.nv() {
            return Some(format!(
                "stops or friction of degree of freedom {}, which does not exist",
                self.dof
            ));
        }
        let name = &model.joints()[model.joint_of_velocity(self.dof).0].name;
        if let Some(Stops { coordinate, lower, upper, restitution }) = self.stops {
            let ordered = lower < upper;
            if !ordered || coordinate >= model.nq() {
                return Some(format!(
                    "joint `{name}` has stops at {lower} and {upper}; the lower one must be below the upper one"
                ));
            }
            if !(0.0..=1.0).contains(&restitution) {
                return Some(format!("joint `{name}` has restitution {restitution}; 0 … 1 is required"));
            }
        }
        if let Some(DryFriction { sliding, breakaway }) = self.friction
            && !(sliding >= 0.0 && breakaway >= sliding && breakaway.is_finite())
        {
            return Some(format!(
                "joint `{name}` slides against {sliding} and breaks away at {breakaway}; \
                 0 ≤ sliding ≤ breakaway is required"
            ));
        }
        None
    }
}

/// All that switches in a mechanism, with its present modes.
#[derive(Clone, Default)]
pub(crate) struct Switches {
    pub(crate) joints: Vec<JointSwitch>,
    pub(crate) events: Vec<Event>,
    pub(crate) passes_over_stops: bool,
    pub(crate) modes: Vec<Mode>,
    /// Degrees of freedom that do not move.
    pub(crate) held: Vec<bool>,
    pub(crate) any_held: bool,
    /// Forces that hold them, accelerations with them, and the largest force in sight.
    pub(crate) holding: Vec<f64>,
    pub(crate) acceleration: Vec<f64>,
    pub(crate) scale: f64,
    /// Further forces on joints, of a trial.
    pub(crate) trial: Vec<f64>,
}

impl Switches {
    pub(crate) fn new(model: &Model, joints: Vec<JointSwitch>) -> Result<Self, MotionError> {
        let nv = model.nv();
        for (i, joint) in joints.iter().enumerate() {
            let twice = joints[..i].iter().any(|other| other.dof == joint.dof);
            let twice = twice.then(|| format!("degree of freedom {} has stops or friction twice", joint.dof));
            if let Some(what) = joint.problem(model).or(twice) {
                return Err(MotionError::Switch { what });
            }
        }
        Ok(Switches {
            modes: vec![Mode::Free; joints.len()],
            joints,
            events: Vec::new(),
            passes_over_stops: false,
            held: vec![false; nv],
            any_held: false,
            holding: vec![0.0; nv],
            acceleration: vec![0.0; nv],
            scale: 0.0,
            trial: vec![0.0; nv],
        })
    }
    /// Takes over modes.
    pub(crate) fn enter(&mut self, modes: &[Mode]) {
        self.modes.clear();
        self.modes.extend_from_slice(modes);
        self.held.fill(false);
        for (joint, mode) in self.joints.iter().zip(modes) {
            self.held[joint.dof] = mode.holds();
        }
        self.any_held = self.held.contains(&true);
    }
    /// Sliding friction.
    pub(crate) fn add_friction(&self, tau: &mut [f64]) {
        for (joint, mode) in self.joints.iter().zip(&self.modes) {
            tau[joint.dof] += self.trial[joint.dof];
            let Some(friction) = joint.friction else { continue };
            match mode {
                Mode::Forward => tau[joint.dof] -= friction.sliding,
                Mode::Backward => tau[joint.dof] += friction.sliding,
                _ => {}
            }
        }
    }
}
