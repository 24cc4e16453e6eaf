//! `simulate`: a model or a scene through `phipsi_simulate`, with control laws in Python.

use crate::batch::{Argument, array};
use crate::closure::motion_error;
use crate::closure_motion::prescription;
use crate::errors::{Field, argument_error, choice_error, dynamics_error, exception};
use crate::model::Model;
use crate::report::{Problem, Report};
use crate::trajectory::Trajectory;
use phipsi::model::State;
use phipsi::molecule::Ensemble;
use phipsi::motion::forces::Control;
use phipsi::motion::{Force, Method, Scheme};
use phipsi_simulate::LimitPassed;
use phipsi_simulate::{
    Choice, JointBehavior, Observer, Progress, Recording, Row, SimulateError, Simulation, StepRecord, run,
};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// Most numbers that a trajectory may hold: 16 GiB.
const LARGEST: f64 = 2.0 * (1u64 << 30) as f64;

/// The exception that a callback raised or that a signal caused, kept until the run has come to its end.
#[derive(Clone, Default)]
pub struct Raised(Arc<Mutex<Option<PyErr>>>);

impl Raised {
    /// Keeps an exception.
    pub fn set(&self, error: PyErr) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
    }
    /// True if there is one.
    pub fn is_set(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }
    /// The exception, which is then gone.
    pub fn take(&self) -> Option<PyErr> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// Keeps rows in memory and lets Ctrl-C through.
struct Watcher {
    recording: Recording,
    raised: Raised,
}

impl Observer for Watcher {
    fn row(&mut self, row: &Row) -> Result<(), SimulateError> {
        self.recording.row(row)
    }
    fn step(&mut self, step: &StepRecord, progress: &Progress<'_>) -> Result<(), SimulateError> {
        // Every 16 steps: taking the interpreter costs about as much as a step of a small model.
        if self.recording.steps.len() % 16 == 15
            && let Err(e) = Python::attach(|py| py.check_signals())
        {
            self.raised.set(e);
        }
        self.recording.step(step, progress)
    }
    fn stop(&self) -> bool {
        self.raised.is_set()
    }
    fn step_ends(&mut self) -> Result<Vec<f64>, SimulateError> {
        self.recording.step_ends()
    }
    fn spread_rows(&mut self, most: usize) -> Result<Vec<State>, SimulateError> {
        self.recording.spread_rows(most)
    }
}

/// Simulates a model or a scene file, with the error of its end.
///
/// Loops (``Model.close_loop``, ``<mimic>``) are followed: after each step positions and velocities are projected onto them with
/// the least change in kinetic energy. The start must close them, see ``Model.assemble``; ``v0`` is made consistent.
///
/// Damping and friction of the file's joints act; joint limits do not, but ``Trajectory.limits`` tells which were passed.
///
/// Parameters
/// ----------
/// model_or_scene : a Model, or the path of a scene file (TOML), whose own values hold where an argument is None.
/// q0, v0 : (nq,), (nv,), the start at t = 0; None: neutral, at rest.
/// t_end : s; required with a model.
/// control : control(t, q, v) -> tau, (nv,); called at trial steps too, so it must depend on its arguments only. What it
///     raises comes out as it is. Only with a model: a scene has its own forces.
/// closure_motion : {name: motion} of closures that move, others rest. A motion is {direction: expression}, as in scenes: the
///     offset along "x", "y", "z", the rotation "rx", "ry", "rz", the "distance", as far as the closure keeps it, each a
///     number or an expression in t such as "0.01*sin(10*t)"; or a function of t that returns (3, rows): positions, velocities
///     and accelerations of all rows, smooth, and each the rate of the one before. Its work is in ``Trajectory.work``. Only with
///     a model.
/// rtol, atol : error control of the adaptive methods; atol defaults to rtol, both to 1e-9.
/// method : "auto", "dop853", "tsit5" (adaptive) or "rk4" with ``step``, s; None: a scene's own, otherwise "auto".
/// max_step : s, the largest step of the adaptive methods.
/// every : s, the interval of the returned samples; a 200th of the run by default.
/// estimate : False leaves out the estimate of the error at the end, which costs up to as much as the run; where forces and motions
///     call no Python, it is made beside the run on a second processor, if other runs leave one free.
///
/// Returns
/// -------
/// Trajectory with t, q, v, energy, momentum, error.
///
/// Raises
/// ------
/// ArgumentError; ModelError for a model or a scene that cannot be used; Error for a start with open loops; NumericalError, with ``time`` and
/// the ``trajectory`` so far, where no step can be made.
///
/// Example
/// -------
/// >>> m = phipsi.Model.from_urdf("arm.urdf")
/// >>> r = phipsi.simulate(m, q0=[0.5, 0.0], t_end=1.0, control=lambda t, q, v: [0.0, -0.2 * v[1]])
/// >>> r.q.shape, bool(r.error.energy_error < 1e-8), bool(r.error.q < 1e-7)
/// ((201, 2), True, True)
#[pyfunction]
#[pyo3(signature = (model_or_scene, q0 = None, v0 = None, t_end = None, control = None, rtol = None, atol = None,
    method = None, step = None, max_step = None, every = None, estimate = None, closure_motion = None))]
#[allow(clippy::too_many_arguments)]
pub fn simulate(
    py: Python<'_>,
    model_or_scene: &Bound<'_, PyAny>,
    q0: Option<&Bound<'_, PyAny>>,
    v0: Option<&Bound<'_, PyAny>>,
    t_end: Option<f64>,
    control: Option<Bound<'_, PyAny>>,
    rtol: Option<f64>,
    atol: Option<f64>,
    method: Option<&str>,
    step: Option<f64>,
    max_step: Option<f64>,
    every: Option<f64>,
    estimate: Option<bool>,
    closure_motion: Option<&Bound<'_, PyDict>>,
) -> PyResult<Trajectory> {
    let raised = Raised::default();
    for (name, value) in [
        ("t_end", t_end),
        ("rtol", rtol),
        ("atol", atol),
        ("step", step),
        ("max_step", max_step),
        ("every", every),
    ] {
        if let Some(x) = value {
            check_positive(py, name, x)?;
        }
    }
    let mut simulation = match model_or_scene.cast::<Model>() {
        Ok(model) => from_model(py, model.get(), t_end, control, closure_motion, &raised)?,
        Err(_) => from_scene(model_or_scene, t_end, control.is_some(), closure_motion.is_some())?,
    };
    set_start(py, &mut simulation, q0, v0)?;
    set_method(py, &mut simulation, (rtol, atol, max_step), method, step)?;
    if let Some(every) = every {
        simulation.every = every;
    }
    if let Some(estimate) = estimate {
        simulation.estimate = estimate;
    }
    let numbers = (simulation.t_end - simulation.start.t) / simulation.every
        * (simulation.start.q.len() + simulation.start.v.len() + 10) as f64;
    if numbers > LARGEST {
        let message =
            format!("`every` is {}: the trajectory would hold {numbers:e} numbers", simulation.every);
        let required = format!("at most {LARGEST:e} numbers");
        let found = Field::Number(simulation.every);
        return Err(argument_error(py, "every", found, required.into(), &message, Some("give a larger one")));
    }
    let mut watcher = Watcher { recording: Recording::default(), raised: raised.clone() };
    let (result, simulation, watcher) = py.detach(move || {
        let result = run(&mut simulation, &mut watcher);
        (result, simulation, watcher)
    });
    if let Some(error) = raised.take() {
        return Err(error);
    }
    match result {
        Ok(summary) => Trajectory::new(py, &simulation, &watcher.recording, Some(&summary)),
        Err(e) => {
            let error = simulate_error(py, e);
            let so_far = Trajectory::new(py, &simulation, &watcher.recording, None)?;
            if error.get_type(py).name()? == "NumericalError" {
                error.value(py).setattr("trajectory", so_far)?;
            }
            Err(error)
        }
    }
}

fn check_positive(py: Python<'_>, name: &str, x: f64) -> PyResult<()> {
    if x > 0.0 && x.is_finite() {
        return Ok(());
    }
    let message = format!("`{name}` is {x}, but a positive finite number is required");
    Err(argument_error(py, name, Field::Number(x), "a positive finite number".into(), &message, None))
}

fn from_model(
    py: Python<'_>,
    model: &Model,
    t_end: Option<f64>,
    control: Option<Bound<'_, PyAny>>,
    closure_motion: Option<&Bound<'_, PyDict>>,
    raised: &Raised,
) -> PyResult<Simulation> {
    let Some(t_end) = t_end else {
        let message = "`t_end` is missing: a model does not say how long to simulate";
        return Err(argument_error(py, "t_end", "None".into(), "seconds".into(), message, None));
    };
    let mut forces: Vec<Box<dyn Force>> = Vec::new();
    if let Some(control) = control {
        forces.push(Box::new(control_law(model, &control, raised)?));
    }
    let compiled = model.compiled();
    let prescription = prescription(py, &compiled, closure_motion, (0.0, t_end), raised)?;
    let mut simulation =
        Simulation::prescribed(&compiled.model, forces, &prescription, t_end, JointBehavior::default())
            .map_err(|e| motion_error(py, &e))?;
    // Python runs on one thread at a time, and its functions may be of a kind that must.
    if closure_motion.is_some_and(|motions| motions.values().iter().any(|motion| motion.is_callable())) {
        simulation.threads = Some(1);
    }
    Ok(simulation)
}

fn from_scene(
    scene: &Bound<'_, PyAny>,
    t_end: Option<f64>,
    control: bool,
    closure_motion: bool,
) -> PyResult<Simulation> {
    let py = scene.py();
    let Ok(path) = scene.extract::<PathBuf>() else {
        let found = scene.get_type().to_string();
        let message = format!("`model_or_scene` is {found}, but a Model or the path of a scene is required");
        let required = "a Model or a path".into();
        return Err(argument_error(py, "model_or_scene", found.into(), required, &message, None));
    };
    if control {
        let message = "`control` needs a model: a scene's forces are those of the scene file";
        let remedy = "load the URDF with Model.from_urdf, or write the force as [[force]] into the scene";
        let required = "None with a scene".into();
        return Err(argument_error(py, "control", "a function".into(), required, message, Some(remedy)));
    }
    if closure_motion {
        let message = "`closure_motion` needs a model: a scene's closures move as the scene file says";
        let remedy = "write motion = { x = \"…\" } into the [[closure]] of the scene";
        let required = "None with a scene".into();
        return Err(argument_error(py, "closure_motion", "a dict".into(), required, message, Some(remedy)));
    }
    if let Err(e) = std::fs::metadata(&path) {
        let reason = e.to_string().split(" (os error").next().unwrap_or_default().to_string();
        return Err(PyOSError::new_err((e.raw_os_error(), reason, path.into_os_string())));
    }
    let loaded = py.detach(|| phipsi_simulate::scene::load(&path, &[]));
    let mut simulation = loaded.map_err(|e| simulate_error(py, e))?.simulation;
    if let Some(t_end) = t_end {
        if t_end <= simulation.start.t {
            let (message, found) = (format!("`t_end` is {t_end}, before the start"), Field::Number(t_end));
            return Err(argument_error(py, "t_end", found, "a time after the start".into(), &message, None));
        }
        simulation.t_end = t_end;
    }
    Ok(simulation)
}

fn set_start(
    py: Python<'_>,
    simulation: &mut Simulation,
    q0: Option<&Bound<'_, PyAny>>,
    v0: Option<&Bound<'_, PyAny>>,
) -> PyResult<()> {
    let compiled = crate::compiled::Compiled::of(simulation.model().clone());
    let (q, v) = crate::simulator::start(py, &compiled, q0, v0)?;
    if let Some(q) = q {
        simulation.start.q = q;
    }
    if let Some(v) = v {
        simulation.start.v = v;
    }
    Ok(())
}

fn set_method(
    py: Python<'_>,
    simulation: &mut Simulation,
    (rtol, atol, max_step): (Option<f64>, Option<f64>, Option<f64>),
    method: Option<&str>,
    step: Option<f64>,
) -> PyResult<()> {
    if let Some(rtol) = rtol {
        simulation.tolerances.rtol = rtol;
    }
    if let Some(atol) = atol.or(rtol) {
        simulation.tolerances.atol = atol;
    }
    if let Some(max_step) = max_step {
        simulation.tolerances.max_step = max_step;
    }
    if step.is_some() != (method == Some("rk4")) {
        let (found, message) = match step {
            Some(_) => ("a step", "`step` belongs to method = \"rk4\": the other methods choose their steps"),
            None => ("None", "`step` is missing: method = \"rk4\" has a fixed step, in s"),
        };
        let required = "a step with method = \"rk4\" only".into();
        return Err(argument_error(py, "step", found.into(), required, message, None));
    }
    let own = simulation.choice.method;
    if let (Some(method), Some(molecule)) = (method, &simulation.molecule) {
        let bath = molecule.ensemble != Ensemble::ConstantEnergy;
        if bath || molecule.schedule.is_some() || molecule.inner_steps > 1 {
            let message =
                "`method` is given, but what this scene's molecule asks for needs its midpoint method";
            let required = "None with a bath, with inner_steps and with changes of clusters".into();
            return Err(argument_error(py, "method", method.into(), required, message, None));
        }
    }
    // "auto" of explicit methods depends on the tolerances; what a scene asks for or needs stays where nothing is said.
    let follows_tolerances = matches!(own, Scheme::Explicit(Method::Dop853 | Method::Tsit5));
    simulation.choice = match (method, step) {
        (None, _) if !follows_tolerances || simulation.choice == Choice::asked(own) => return Ok(()),
        (None | Some("auto"), _) => {
            Choice::automatic(simulation.tolerances, simulation.dynamics.breaks().len())
        }
        (Some("dop853"), _) => Choice::asked(Method::Dop853),
        (Some("tsit5"), _) => Choice::asked(Method::Tsit5),
        (Some("rk4"), Some(step)) => Choice::asked(Method::Rk4 { step }),
        (Some(other), _) => {
            return Err(choice_error(py, "method", other, &["auto", "dop853", "tsit5", "rk4"]));
        }
    };
    Ok(())
}

/// A control law that calls Python; what it raises stops the run.
fn control_law(model: &Model, control: &Bound<'_, PyAny>, raised: &Raised) -> PyResult<Control> {
    let py = control.py();
    if !control.is_callable() {
        let found = control.get_type().to_string();
        let message = format!("`control` is {found}, but a function control(t, q, v) -> tau is required");
        return Err(argument_error(py, "control", found.into(), "a function".into(), &message, None));
    }
    let (compiled, raised, control) = (model.compiled(), raised.clone(), control.clone().unbind());
    let nv = compiled.model.nv();
    Ok(Control::new("control", nv, move |t, q, v, tau| {
        if raised.is_set() {
            return Err("its exception ends the run".into());
        }
        let called = Python::attach(|py| -> PyResult<Argument> {
            let q = array(py, q.to_vec(), vec![q.len()])?;
            let v = array(py, v.to_vec(), vec![v.len()])?;
            let result = control.bind(py).call1((t, q, v))?;
            let tau = compiled.v(&result, "the result of control")?;
            crate::simulator::check_single(py, &tau)?;
            Ok(tau)
        });
        match called {
            Ok(result) => {
                tau.copy_from_slice(result.at(0));
                Ok(())
            }
            Err(e) => {
                raised.set(e);
                Err("it raised an exception".into())
            }
        }
    }))
}

/// A failed run as a Python exception.
pub fn simulate_error(py: Python<'_>, error: SimulateError) -> PyErr {
    match error {
        SimulateError::Scene(reports) => {
            let message = reports.iter().map(|r| r.to_string().trim_end().to_string()).collect::<Vec<_>>();
            let reports: Vec<Report> = reports.iter().map(Report::new).collect();
            let gather = |of: fn(&Report) -> &Vec<Problem>| {
                Some(Field::Problems(reports.iter().flat_map(|r| of(r).clone()).collect()))
            };
            let fields = vec![
                ("errors", gather(|r| &r.errors)),
                ("warnings", gather(|r| &r.warnings)),
                ("report", reports.first().cloned().map(Field::Report)),
            ];
            exception(py, "ModelError", &message.join("\n"), fields)
        }
        SimulateError::Dynamics(e) => dynamics_error(py, &e, None),
        SimulateError::Motion(e) => motion_error(py, &e),
        SimulateError::Stopped { t, message } => {
            let fields = vec![
                ("quantity", Some("step".into())),
                ("time", Some(Field::Number(t))),
                ("required", Some("a step that succeeds".into())),
            ];
            exception(py, "NumericalError", &message, fields)
        }
        SimulateError::File { path, source } => {
            PyOSError::new_err((source.raw_os_error(), source.to_string(), path.into_os_string()))
        }
        other => exception(py, "Error", &other.to_string(), vec![]),
    }
}

/// Limits that were passed, in words.
pub fn limits_in_words(limits: &[LimitPassed]) -> Vec<String> {
    limits.iter().map(LimitPassed::describe).collect()
}
