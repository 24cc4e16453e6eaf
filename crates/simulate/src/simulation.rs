//! A simulation ready to run: mechanism, forces, start, method, and what is recorded.

use crate::error::SimulateError;
use crate::molecule::Molecule;
use crate::output::{KnownValue, Output};
use phipsi_formats::Problem;
use phipsi_model::{Model, State};
use phipsi_motion::forces::JointDissipation;
use phipsi_motion::{
    Dynamics, Event, Force, JointSwitch, Method, MotionError, Prescription, Projected, Scheme, System,
    Tolerances,
};

/// Tolerance where nothing else is said.
pub const DEFAULT_TOLERANCE: f64 = 1e-9;

/// Loosest tolerance at which the method of order 8 is cheaper than that of order 5 (notes on integrators, section 5).
const LOOSE: f64 = 1e-4;

/// How far closures may be open in given starts: numbers are often given with eight digits or so.
pub(crate) const LARGEST_OPENING: f64 = 1e-6;

/// Breaks per second above which steps are too short for a method of high order.
const MANY_BREAKS: usize = 100;

/// The integration method, and why it was chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The method.
    pub method: Scheme,
    /// Why, for people.
    pub why: String,
}

impl Choice {
    /// `auto`: DOP853, or Tsit5 for loose tolerances and for forces with many breaks.
    pub fn automatic(tolerances: Tolerances, breaks: usize) -> Self {
        let tolerance = tolerances.rtol.max(tolerances.atol);
        if tolerance >= LOOSE {
            let why =
                format!("tolerance {tolerance:e} is loose: order 5 takes fewer evaluations than order 8");
            Choice { method: Method::Tsit5.into(), why }
        } else if breaks > MANY_BREAKS {
            let why =
                format!("forces break at {breaks} times: steps are short, order 5 restarts more cheaply");
            Choice { method: Method::Tsit5.into(), why }
        } else {
            let why = "smooth forces and a tolerance below 1e-4: order 8 takes fewest evaluations".into();
            Choice { method: Method::Dop853.into(), why }
        }
    }
    /// The method that the user left to the program, after a look at how it steps: [`crate::stiffness`].
    pub(crate) fn settled(simulation: &mut Simulation) -> Self {
        let explicit = simulation.choice.clone();
        crate::stiffness::look(simulation).unwrap_or(explicit)
    }
    /// A method that the user asked for.
    pub fn asked(method: impl Into<Scheme>) -> Self {
        Choice { method: method.into(), why: "asked for".into() }
    }
}

/// The name of a method in scenes and reports.
pub fn method_name(method: Scheme) -> &'static str {
    match method {
        Scheme::Explicit(Method::Dop853) => "dop853",
        Scheme::Explicit(Method::Tsit5) => "tsit5",
        Scheme::Explicit(Method::Rk4 { .. }) => "rk4",
        Scheme::Explicit(Method::Rodas4) => "rodas4",
        Scheme::Explicit(Method::Rodas5p) => "rodas5p",
        Scheme::Midpoint { .. } => "midpoint",
    }
}

/// How limits and dry friction of a model's joints act.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointBehavior {
    /// Restitution of the stops of each joint of the model; joints without one move through their limits, which is told.
    pub restitution: Vec<Option<f64>>,
    /// Breakaway over sliding force of each joint of the model; 1 where it is missing.
    pub breakaway_ratio: Vec<f64>,
    /// Speed at which dry friction is regularised, rad/s or m/s; `None`: it sticks and slips.
    pub friction_speed: Option<f64>,
}

impl JointBehavior {
    /// Joints that switch.
    fn switches(&self, model: &Model) -> Vec<JointSwitch> {
        let ratio = |k: usize| self.breakaway_ratio.get(k).copied().unwrap_or(1.0);
        let restitution = |k: usize| self.restitution.get(k).copied().flatten();
        let mut switches = JointSwitch::of_model(model, ratio, restitution);
        if self.friction_speed.is_some() {
            switches.iter_mut().for_each(|s| s.friction = None);
            switches.retain(|s| s.stops.is_some());
        }
        switches
    }
}

/// Everything that a run needs. Made from a scene file ([`crate::scene::load`]) or from a model in memory.
///
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
/// use phipsi_simulate::{Recording, Simulation, run};
/// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
/// let model = ModelBuilder::new("pendulum")
///     .body(Body::new("rod", rod))
///     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
///     .build()?;
/// let mut simulation = Simulation::new(&model, Vec::new(), 2.0)?;
/// let mut recording = Recording::default();
/// let summary = run(&mut simulation, &mut recording)?;
/// assert!(summary.energy_error < 1e-9);
/// assert!(summary.error_estimate.unwrap().q.unwrap() < 1e-8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Simulation {
    /// Name of the scene.
    pub name: String,
    /// Mechanism and forces.
    pub dynamics: Dynamics,
    /// State at the start.
    pub start: State,
    /// Method.
    pub choice: Choice,
    /// Error control.
    pub tolerances: Tolerances,
    /// End.
    pub t_end: f64,
    /// Whether the error at the end is estimated.
    pub estimate: bool,
    /// Largest number of threads, `None`: as many as there are processors that other runs of this process and their estimates leave free. On
    /// more than one the error is estimated beside the run where its forces allow it ([`Force::another`]). Results do not depend on it.
    pub threads: Option<usize>,
    /// Interval of the recorded samples.
    pub every: f64,
    /// Named numbers.
    pub outputs: Vec<Output>,
    /// Their known values at the end.
    pub known: Vec<KnownValue>,
    /// Where the known values come from.
    pub known_source: Option<String>,
    /// What was replaced by something simpler, for people.
    pub approximated: Vec<String>,
    /// What a molecule has besides; times are then in ps and energies in kJ/mol.
    pub molecule: Option<Molecule>,
}

impl Simulation {
    /// From a model at its neutral state under `forces`, its joints' damping and friction included. Loops are followed.
    ///
    /// # Errors
    /// [`MotionError`]: a coupling that cannot be.
    pub fn new(model: &Model, forces: Vec<Box<dyn Force>>, t_end: f64) -> Result<Self, MotionError> {
        Self::prescribed(model, forces, &Prescription::default(), t_end, JointBehavior::default())
    }
    /// The same where motions are given as functions of time, and limits and dry friction act as said.
    ///
    /// # Errors
    /// As [`Simulation::new`]; [`MotionError::Prescription`].
    pub fn prescribed(
        model: &Model,
        mut forces: Vec<Box<dyn Force>>,
        prescription: &Prescription,
        t_end: f64,
        behavior: JointBehavior,
    ) -> Result<Self, MotionError> {
        let mut approximated = Vec::new();
        let dissipation = match behavior.friction_speed {
            Some(speed) => JointDissipation::new(model, speed),
            None => JointDissipation::damping(model),
        };
        if let Some(force) = dissipation {
            if force.has_friction() {
                approximated.push(format!(
                    "dry friction of joints is regularised: −f tanh(v/s) with s = {} rad/s or m/s; \
                     below that speed joints creep instead of sticking",
                    force.speed()
                ));
            }
            forces.push(Box::new(force));
        }
        let dynamics = Dynamics::switching(model, forces, prescription, behavior.switches(model))?;
        let tolerances = Tolerances::new(DEFAULT_TOLERANCE);
        let breaks = dynamics.breaks().len();
        Ok(Simulation {
            name: model.name().into(),
            start: State { q: model.neutral(), v: vec![0.0; model.nv()], t: 0.0 },
            choice: Choice::automatic(tolerances, breaks),
            tolerances,
            t_end,
            estimate: true,
            threads: None,
            every: t_end / 200.0,
            outputs: Vec::new(),
            known: Vec::new(),
            known_source: None,
            approximated,
            molecule: None,
            dynamics,
        })
    }
    /// The mechanism.
    pub fn model(&self) -> &Model {
        self.dynamics.model()
    }
    /// Unit of time.
    pub fn time_unit(&self) -> &'static str {
        if self.molecule.is_some() { "ps" } else { "s" }
    }
    /// Unit of energy.
    pub fn energy_unit(&self) -> &'static str {
        if self.molecule.is_some() { "kJ/mol" } else { "J" }
    }
    /// True if a heat bath acts.
    pub fn has_bath(&self) -> bool {
        self.molecule.as_ref().is_some_and(Molecule::has_bath)
    }
    /// Degrees of freedom that carry the temperature.
    pub fn degrees_of_freedom(&self) -> usize {
        self.molecule.as_ref().map_or(self.model().nv(), Molecule::degrees_of_freedom)
    }
    /// Number of recorded samples, the start and the end included.
    pub fn samples(&self) -> u64 {
        self.samples_until(self.t_end)
    }
    /// The same where the run ends at another time: an event stops it.
    pub(crate) fn samples_until(&self, end: f64) -> u64 {
        let span = (end - self.start.t) / self.every;
        // A last interval of less than a millionth is rounding, not a sample of its own.
        (span - 1e-6).max(0.0).ceil() as u64 + 1
    }
    /// Time of the k-th recorded sample.
    pub fn sample_time(&self, k: u64) -> f64 {
        self.sample_time_until(k, self.t_end)
    }
    pub(crate) fn sample_time_until(&self, k: u64, end: f64) -> f64 {
        if k + 1 >= self.samples_until(end) { end } else { self.start.t + k as f64 * self.every }
    }
    /// With events of functions of the state.
    pub fn with_events(mut self, events: Vec<Event>) -> Self {
        self.dynamics.add_events(events);
        self
    }
    /// The form of forward dynamics and why it is that one, for people; `None` where the method has none.
    pub fn form(&self) -> Option<(&'static str, String)> {
        if let Scheme::Midpoint { .. } = self.choice.method {
            return None;
        }
        if let Some(choice) = self.dynamics.closed_form_choice() {
            return Some((choice.name(), choice.why()));
        }
        let why = self.dynamics.form_choice().map_or("asked for".into(), |choice| choice.why());
        Some((self.dynamics.form().name(), why))
    }
    /// Where no form of forward dynamics is accurate enough.
    pub(crate) fn form_warning(&self) -> Option<Problem> {
        self.form()?;
        let mut remedy = "expect as few digits, or bring masses and lengths closer together".to_string();
        let (error, limit, form) = match (self.dynamics.form_choice(), self.dynamics.closed_form_choice()) {
            (Some(choice), _) if !choice.is_sufficient() => (choice.error, choice.limit, choice.form.name()),
            (_, Some(choice)) if !choice.is_sufficient() => {
                if let Some(heavy) = &choice.heavy {
                    remedy = format!("{heavy}; otherwise expect as few digits");
                }
                (choice.error(), choice.tree?.limit, choice.name())
            }
            _ => return None,
        };
        let found = format!("forward dynamics errs by {error:.0e} in its best form, {form}");
        let required = format!("an error up to {limit:.0e}");
        Some(Problem::new(None, "model", found, required, remedy))
    }
    /// Puts the start onto the closures and prescribed motions: [`settle`].
    ///
    /// # Errors
    /// As [`settle`].
    pub fn settle_start(&mut self) -> Result<Option<Projected>, SimulateError> {
        settle(&mut self.dynamics, &mut self.start)
    }
    /// What the plan leaves out, for people.
    pub fn left_out(&self) -> Vec<String> {
        let mut lines = self.dynamics.plan().left_out();
        if let Scheme::Midpoint { .. } = self.choice.method {
            lines.push(
                "estimate of the error at the end: the midpoint method reports conserved quantities".into(),
            );
            if self.has_bath() {
                lines.push("balance of momentum: the bath changes it".into());
            }
        } else if !self.estimate {
            lines.push("estimate of the error at the end: estimate = false".into());
        }
        lines
    }
}

/// Puts a state onto the closures and prescribed motions.
///
/// # Errors
/// [`SimulateError::Start`] if the closures are open by more than rounding of the given numbers explains.
pub fn settle(dynamics: &mut Dynamics, state: &mut State) -> Result<Option<Projected>, SimulateError> {
    let State { q, v, t } = state;
    dynamics.follow(*t, q, v);
    if let Some([open, _]) = dynamics.closure_residual(*t, q, v)?
        && (open.is_nan() || open > LARGEST_OPENING)
    {
        return Err(SimulateError::Start(format!(
            "the closures are open by {open:e} m or rad at the start, but at most {LARGEST_OPENING:e} is required; \
             set `assemble = true` in [initial] (in Python: q, _ = m.assemble(q)), or correct the positions"
        )));
    }
    Ok(dynamics.project(*t, q, v)?)
}
