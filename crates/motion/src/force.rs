//! What pushes the mechanism: the trait `Force`, what it may look at, and where it adds.

use crate::force_rates::LoadRates;
use crate::wide::{WideLoads, WideSituation};
use phipsi_model::Model;
use phipsi_recursion::{Kinematics, Layout};
use phipsi_spatial::{Motion, Transform, Wrench};
use std::fmt;

/// The state that a force sees.
pub struct Situation<'a> {
    /// The mechanism.
    pub model: &'a Model,
    /// Its compiled form.
    pub layout: &'a Layout<f64>,
    /// Time.
    pub t: f64,
    /// Position coordinates, nq.
    pub q: &'a [f64],
    /// Velocities, nv.
    pub v: &'a [f64],
    /// Poses and velocities of all bodies; present if the force's [`Needs`] asked for them.
    pub kinematics: Option<&'a Kinematics<f64>>,
}

impl Situation<'_> {
    /// World pose of a body; the identity for the world, and for all if poses were not asked for.
    pub fn pose(&self, body: Option<usize>) -> Transform<f64> {
        self.kinematics.map_or(Transform::identity(), |k| k.pose(self.layout, body))
    }
    /// Velocity of a body in its own axes at its own origin; zero if velocities were not asked for.
    pub fn velocity(&self, body: Option<usize>) -> Motion<f64> {
        self.kinematics.map_or(Motion::zero(), |k| k.velocity_in_body(self.layout, body))
    }
}

/// Where forces add.
pub struct Loads<'a> {
    /// Generalised forces, nv.
    pub tau: &'a mut [f64],
    /// Wrench on each body of the model, at its frame's origin, its axes.
    pub wrenches: &'a mut [Wrench<f64>],
}

/// What a force uses, so that a plan leaves out the rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Poses and velocities of bodies.
    pub kinematics: bool,
    /// It adds wrenches on bodies.
    pub wrenches: bool,
    /// It has a potential energy, so its work is not integrated.
    pub conservative: bool,
}

/// A force that cannot be evaluated.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceError {
    /// The force's name.
    pub force: String,
    /// Time.
    pub t: f64,
    /// What happened and what to do.
    pub message: String,
}

impl fmt::Display for ForceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "force `{}` at t = {}: {}", self.force, self.t, self.message)
    }
}

impl std::error::Error for ForceError {}

/// A force model: joint forces, wrenches on bodies, or both.
///
/// ```
/// use phipsi_motion::{Force, ForceError, Loads, Situation};
/// /// Wind that grows with time on one joint.
/// struct Wind { dof: usize }
/// impl Force for Wind {
///     fn name(&self) -> &str { "wind" }
///     fn add(&mut self, at: &Situation<'_>, _: &[f64], _: &mut [f64], loads: &mut Loads<'_>) -> Result<(), ForceError> {
///         loads.tau[self.dof] += 0.1 * at.t;
///         Ok(())
///     }
/// }
/// ```
pub trait Force: Send {
    /// The user's name for it.
    fn name(&self) -> &str;
    /// What it uses.
    fn needs(&self) -> Needs {
        Needs::default()
    }
    /// Names of the quantities it integrates beside the state (a servo's integral); they start at zero.
    fn auxiliary(&self) -> Vec<String> {
        Vec::new()
    }
    /// Adds its generalised forces and wrenches, and writes the rates of its own auxiliary quantities.
    ///
    /// # Errors
    /// [`ForceError`] if it cannot be evaluated here; the step is then tried again with a smaller size.
    fn add(
        &mut self,
        at: &Situation<'_>,
        auxiliary: &[f64],
        auxiliary_rate: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError>;
    /// Potential energy of a conservative force.
    fn potential(&self, _at: &Situation<'_>) -> f64 {
        0.0
    }
    /// Names of the parts of its potential energy, where it has several that are of interest (the terms of a force field).
    fn terms(&self) -> Vec<String> {
        Vec::new()
    }
    /// The parts of its potential energy, in the order of [`Force::terms`].
    fn term_energies(&self, _at: &Situation<'_>) -> Vec<f64> {
        Vec::new()
    }
    /// True unless it is known to leave the momentum of the whole system alone (a pair of opposite forces, a joint torque
    /// between two bodies).
    fn is_external(&self, _model: &Model) -> bool {
        true
    }
    /// The same as [`Force::add`] in double-double numbers, for references; false where it cannot, or depends on time.
    fn add_wide(&self, _at: &WideSituation<'_>, _loads: &mut WideLoads<'_>) -> bool {
        false
    }
    /// True if its loads do not depend on time itself.
    fn is_autonomous(&self) -> bool {
        false
    }
    /// Adds the derivatives of its loads; false where it cannot, or where a difference quotient is as good: those of the whole
    /// system are then taken by differences.
    fn add_rates(&mut self, _at: &Situation<'_>, _rates: &mut LoadRates<'_>) -> bool {
        false
    }
    /// Another one like it, for a companion run on a second thread: `Some(Box::new(self.clone()))` where it is `Clone`. `None`: there is
    /// no second one, and the error of a run is estimated after the run.
    fn another(&self) -> Option<Box<dyn Force>> {
        None
    }
    /// True if it changes slowly: the midpoint method then evaluates it once in [`crate::Midpoint::substeps`] steps, if it is conservative.
    fn is_slow(&self) -> bool {
        false
    }
    /// Times at which it is not smooth: steps end there.
    fn breaks(&self) -> Vec<f64> {
        Vec::new()
    }
}

/// True if a degree of freedom belongs to a joint that hangs on the world, so that its force is external.
pub(crate) fn acts_on_base(model: &Model, dof: usize) -> bool {
    model.tree().parent(model.joint_of_velocity(dof).0).is_none()
}
