//! `Simulator`: one's own loop, one step of bounded work a call.

use crate::batch::{Argument, array};
use crate::closure::motion_error;
use crate::closure_motion::prescription;
use crate::compiled::Compiled;
use crate::errors::{Field, argument_error, exception};
use crate::model::Model;
use crate::simulate::{Raised, simulate_error};
use phipsi::model::State;
use phipsi::motion::forces::JointDissipation;
use phipsi::motion::{
    Dynamics, Force, ForceError, IntegrateError, Integrator, Loads, Method, Situation, System, Tolerances,
};
use phipsi_simulate::SimulateError;
use phipsi_simulate::simulation::settle;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, PoisonError};

/// Generalized forces held over a step.
struct Held(Arc<Mutex<Vec<f64>>>);

impl Force for Held {
    fn name(&self) -> &str {
        "tau"
    }
    fn add(
        &mut self,
        _: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        let tau = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        loads.tau.iter_mut().zip(tau.iter()).for_each(|(sum, x)| *sum += x);
        Ok(())
    }
}

struct Stepper {
    dynamics: Dynamics,
    integrator: Integrator,
}

/// A simulation in one's own loop: every ``step`` is ``substeps`` Runge–Kutta steps of order 4, so its work is bounded.
///
/// Damping and friction of the file's joints act. Gravity is the model's when the simulator is made.
///
/// Parameters
/// ----------
/// m : a Model.
/// q0, v0 : (nq,), (nv,); None: neutral, at rest.
/// t0 : s, the start.
/// substeps : Runge–Kutta steps a call.
/// closure_motion : {name: motion} of closures that move with time, as ``simulate`` takes it.
///
/// Loops are followed: the start must close them (``Model.assemble``) and its velocities are made consistent; after each
/// substep positions and velocities are projected onto them.
///
/// Raises
/// ------
/// ArgumentError; NumericalError for numbers that are not finite; Error for a start with open loops.
///
/// Example
/// -------
/// >>> m = phipsi.Model.from_urdf("arm.urdf")
/// >>> sim = phipsi.Simulator(m, [0.5, 0.0], [0.0, 0.0])
/// >>> for _ in range(10):
/// ...     t, q, v = sim.state
/// ...     sim.step(0.001, -2.0 * v)
/// >>> round(sim.state.t, 9)
/// 0.01
#[pyclass(frozen, module = "phipsi")]
pub struct Simulator {
    compiled: Arc<Compiled>,
    tau: Arc<Mutex<Vec<f64>>>,
    /// What a function of the closures' motion raised.
    raised: Raised,
    substeps: u32,
    /// In a box: lanes are aligned, and Python's objects are not.
    stepper: Box<Mutex<Stepper>>,
}

#[pymethods]
impl Simulator {
    #[new]
    #[pyo3(signature = (m, q0 = None, v0 = None, t0 = 0.0, substeps = 1, closure_motion = None))]
    fn new(
        py: Python<'_>,
        m: &Bound<'_, Model>,
        q0: Option<&Bound<'_, PyAny>>,
        v0: Option<&Bound<'_, PyAny>>,
        t0: f64,
        substeps: u32,
        closure_motion: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let compiled = m.get().compiled();
        let model = &compiled.model;
        if substeps == 0 {
            let message = "`substeps` is 0, but at least 1 is required";
            return Err(argument_error(py, "substeps", Field::Index(0), "at least 1".into(), message, None));
        }
        check_time(py, "t0", t0)?;
        let (q, v) = start(py, &compiled, q0, v0)?;
        let (q, v) = (q.unwrap_or_else(|| model.neutral()), v.unwrap_or_else(|| vec![0.0; model.nv()]));
        let tau = Arc::new(Mutex::new(vec![0.0; model.nv()]));
        let mut forces: Vec<Box<dyn Force>> = vec![Box::new(Held(tau.clone()))];
        if let Some(force) = JointDissipation::new(model, JointDissipation::SPEED) {
            forces.push(Box::new(force));
        }
        let raised = Raised::default();
        // The step size is the caller's: kinks are not looked for.
        let motions = prescription(py, &compiled, closure_motion, (t0, 0.0), &raised)?;
        let mut dynamics = Dynamics::prescribed(model, forces, &motions).map_err(|e| motion_error(py, &e))?;
        let start = State { q, v, t: t0 };
        let integrator = settled(&mut dynamics, start)
            .map_err(|e| raised.take().unwrap_or_else(|| simulate_error(py, e)))?;
        let stepper = Box::new(Mutex::new(Stepper { dynamics, integrator }));
        Ok(Simulator { compiled, tau, raised, substeps, stepper })
    }
    /// Advances by ``dt`` seconds under generalized forces ``tau`` (nv,), held constant; None is no force.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError, with ``time``, if the step fails: the state is then the last good one.
    ///
    /// Example
    /// -------
    /// >>> sim = phipsi.Simulator(phipsi.Model.from_urdf("arm.urdf"))
    /// >>> sim.step(0.01, [0.1, 0.0])
    #[pyo3(signature = (dt, tau = None))]
    fn step(&self, py: Python<'_>, dt: f64, tau: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        if !(dt > 0.0 && dt.is_finite()) {
            let message = format!("`dt` is {dt}, but a positive finite number is required");
            let required = "a positive finite number".into();
            return Err(argument_error(py, "dt", Field::Number(dt), required, &message, None));
        }
        let tau = tau.map(|x| self.compiled.v(x, "tau")).transpose()?;
        if let Some(tau) = &tau {
            check_single(py, tau)?;
        }
        let result = py.detach(|| {
            let mut stepper = self.stepper.lock().unwrap_or_else(PoisonError::into_inner);
            {
                let mut held = self.tau.lock().unwrap_or_else(PoisonError::into_inner);
                match &tau {
                    Some(tau) => held.copy_from_slice(tau.at(0)),
                    None => held.iter_mut().for_each(|x| *x = 0.0),
                }
            }
            stepper.advance(dt, self.substeps)
        });
        if let Some(error) = self.raised.take() {
            return Err(error);
        }
        result.map_err(|(t, message)| {
            let fields = vec![
                ("quantity", Some("step".into())),
                ("time", Some(Field::Number(t))),
                ("required", Some("a step that succeeds".into())),
                ("remedy", Some("take a smaller dt, or look at tau and the state".into())),
            ];
            exception(py, "NumericalError", &message, fields)
        })
    }
    /// The present State (t, q, v); settable from any (t, q, v).
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (t, q, v) = py.detach(|| {
            let stepper = self.stepper.lock().unwrap_or_else(PoisonError::into_inner);
            (stepper.integrator.t(), stepper.integrator.q().to_vec(), stepper.integrator.v().to_vec())
        });
        let (nq, nv) = (q.len(), v.len());
        let state = py.import("phipsi.state")?.getattr("State")?;
        state.call1((t, array(py, q, vec![nq])?, array(py, v, vec![nv])?))
    }
    #[setter]
    fn set_state(&self, py: Python<'_>, state: &Bound<'_, PyAny>) -> PyResult<()> {
        let parts: Vec<Bound<'_, PyAny>> = state.try_iter()?.collect::<PyResult<_>>()?;
        let [t, q, v] = &parts[..] else {
            let message = format!("`state` has {} parts, but three are required: t, q, v", parts.len());
            let required = "(t, q, v)".into();
            return Err(argument_error(py, "state", Field::Index(parts.len()), required, &message, None));
        };
        let t: f64 = t.extract()?;
        check_time(py, "t", t)?;
        let (Some(q), Some(v)) = start(py, &self.compiled, Some(q), Some(v))? else { return Ok(()) };
        let done = py.detach(|| {
            let mut stepper = self.stepper.lock().unwrap_or_else(PoisonError::into_inner);
            stepper.integrator = settled(&mut stepper.dynamics, State { t, q, v })?;
            Ok::<(), SimulateError>(())
        });
        if let Some(error) = self.raised.take() {
            return Err(error);
        }
        done.map_err(|e| simulate_error(py, e))
    }
    fn __repr__(&self, py: Python<'_>) -> String {
        let t = py.detach(|| self.stepper.lock().unwrap_or_else(PoisonError::into_inner).integrator.t());
        format!("<phipsi.Simulator of `{}` at t = {t}>", self.compiled.model.name())
    }
}

impl Stepper {
    /// All substeps, or none: a failure leaves the state as it was. The error is a time and what happened.
    fn advance(&mut self, dt: f64, substeps: u32) -> Result<(), (f64, String)> {
        let Stepper { dynamics, integrator } = self;
        let (t0, before) = (integrator.t(), integrator.checkpoint());
        // The forces have changed: what was carried from the last step does not hold.
        integrator.restart();
        for k in 1..=substeps {
            let limit = t0 + dt * f64::from(k) / f64::from(substeps);
            integrator.propose(limit - integrator.t());
            if let Err(e) = integrator.step(dynamics, limit, false) {
                integrator.restore(before);
                let t = match &e {
                    IntegrateError::StepUnderflow { t, .. } | IntegrateError::Start { t, .. } => *t,
                    _ => t0,
                };
                return Err((t, e.describe(dynamics.model())));
            }
        }
        Ok(())
    }
}

/// An integrator that starts from a state on the closures.
fn settled(dynamics: &mut Dynamics, mut state: State) -> Result<Integrator, SimulateError> {
    settle(dynamics, &mut state)?;
    let State { t, q, v } = &state;
    let aux = vec![0.0; dynamics.auxiliary_len()];
    // The step is proposed at every call.
    let method = Method::Rk4 { step: 1.0 };
    Ok(Integrator::new(dynamics.model(), method, Tolerances::new(1.0), *t, q, v, &aux))
}

fn check_time(py: Python<'_>, name: &str, t: f64) -> PyResult<()> {
    if t.is_finite() {
        return Ok(());
    }
    let message = format!("`{name}` is {t}, but a finite number is required");
    Err(argument_error(py, name, Field::Number(t), "a finite number".into(), &message, None))
}

/// A single state's numbers.
pub fn check_single(py: Python<'_>, argument: &Argument) -> PyResult<()> {
    if argument.is_single() {
        return Ok(());
    }
    let (name, shape) = (&argument.name, argument.shape());
    let message =
        format!("`{name}` has shape {}, but one state is required here", crate::batch::show(&shape));
    let required = "one state, without batch axes".into();
    Err(argument_error(py, name, Field::Tuple(shape), required, &message, None))
}

/// Starting values of one state.
#[allow(clippy::type_complexity)]
pub fn start(
    py: Python<'_>,
    compiled: &Compiled,
    q0: Option<&Bound<'_, PyAny>>,
    v0: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Option<Vec<f64>>, Option<Vec<f64>>)> {
    let q = q0.map(|q| compiled.q(q, "q0")).transpose()?;
    let v = v0.map(|v| compiled.v(v, "v0")).transpose()?;
    let one = |a: Argument| {
        check_single(py, &a)?;
        PyResult::Ok(a.at(0).to_vec())
    };
    let mut q = q.map(one).transpose()?;
    if let Some(q) = &mut q {
        compiled.model.normalize(q);
    }
    Ok((q, v.map(one).transpose()?))
}
