//! What `simulate` returns.

use crate::batch::array;
use crate::pickle::{Reduced, item, reduced};
use crate::simulate::limits_in_words;
use numpy::PyArrayDyn;
use phipsi_simulate::simulation::method_name;
use phipsi_simulate::{Recording, Simulation, Summary};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// How wrong the end of a run is.
///
/// ``q``, ``v``: estimated largest error of a component at the end, rad or m, rad/s or m/s; None where the motion is chaotic
/// or nothing was estimated. ``horizon``: then, the time up to which they were small, s. ``how``: how it was estimated.
/// ``energy_error``: largest |E − E₀ − work| over the largest sum of |energies|. ``momentum_error``: {"angular", "linear"},
/// relative imbalances; None unless the base is free. ``closure_residual``: {"position", "velocity"}, largest of m and rad at
/// the ends of steps; None without loops. ``energy_removed``: what projections onto the loops took from the velocities, J.
#[pyclass(frozen, get_all, module = "phipsi")]
pub struct RunError {
    /// Error of q at the end.
    pub q: Option<f64>,
    /// Error of v at the end.
    pub v: Option<f64>,
    /// Time up to which the errors were small.
    pub horizon: Option<f64>,
    /// How it was estimated.
    pub how: Option<String>,
    /// Relative imbalance of energy.
    pub energy_error: Option<f64>,
    /// Relative imbalances of momentum.
    pub momentum_error: Option<Py<PyDict>>,
    /// Largest residuals of closures.
    pub closure_residual: Option<Py<PyDict>>,
    /// Kinetic energy that projections took, J.
    pub energy_removed: Option<f64>,
}

#[pymethods]
impl RunError {
    fn __repr__(&self) -> String {
        let show = |x: Option<f64>| x.map_or("None".into(), |x| format!("{x:.1e}"));
        let (q, v, energy) = (show(self.q), show(self.v), show(self.energy_error));
        let momentum = self.momentum_error.as_ref().map_or("None".into(), |d| d.to_string());
        format!("RunError(q={q}, v={v}, energy_error={energy}, momentum_error={momentum})")
    }
}

/// A simulated motion at n instants.
///
/// ``t``: (n,), s. ``q``: (n, nq). ``v``: (n, nv). ``energy``: (n,), kinetic plus potential, J, with ``kinetic_energy``,
/// ``potential_energy`` and ``work`` (of actuators, dampers, friction) apart. ``momentum``: (n, 6), angular about the center
/// of mass, then linear, world axes; zeros unless the base is free. ``error``: a RunError. ``outputs``: {name: (n,)} of a
/// scene. ``method``, ``steps``, ``rejected``, ``evaluations``, ``wall_s``: how it was computed. ``limits``, ``left_out``,
/// ``approximated``: joint limits that were passed, what the plan left out, what was simplified; lists of text. ``events``: what was
/// located, in the order of time, each ``(time, name, kind)``: the name of the event or of the joint, and "event", "impact", "rest",
/// "leave", "stick" or "slip".
#[pyclass(frozen, get_all, module = "phipsi")]
pub struct Trajectory {
    /// Times, s; (n,).
    pub t: Py<PyArrayDyn<f64>>,
    /// Configurations; (n, nq).
    pub q: Py<PyArrayDyn<f64>>,
    /// Velocities; (n, nv).
    pub v: Py<PyArrayDyn<f64>>,
    /// Kinetic plus potential energy.
    pub energy: Py<PyArrayDyn<f64>>,
    /// Kinetic energy.
    pub kinetic_energy: Py<PyArrayDyn<f64>>,
    /// Potential energy.
    pub potential_energy: Py<PyArrayDyn<f64>>,
    /// Work of forces without a potential.
    pub work: Py<PyArrayDyn<f64>>,
    /// Momentum: angular about the center of mass, linear; (n, 6).
    pub momentum: Py<PyArrayDyn<f64>>,
    /// How wrong the end is.
    pub error: Py<RunError>,
    /// Outputs of a scene.
    pub outputs: Py<PyDict>,
    /// Integration method.
    pub method: String,
    /// Accepted steps.
    pub steps: u64,
    /// Rejected steps.
    pub rejected: Option<u64>,
    /// Evaluations of the equations of motion.
    pub evaluations: Option<u64>,
    /// Wall time, s.
    pub wall_s: Option<f64>,
    /// Joint limits that were passed.
    pub limits: Vec<String>,
    /// Located events: time, name, kind.
    pub events: Vec<(f64, String, String)>,
    /// What the plan left out.
    pub left_out: Vec<String>,
    /// What was simplified.
    pub approximated: Vec<String>,
}

#[pymethods]
impl Trajectory {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let shape = self.q.bind(py).getattr("shape")?;
        let error = self.error.get().__repr__();
        Ok(format!("<phipsi.Trajectory: q {shape}, {} steps of {}, {error}>", self.steps, self.method))
    }
}

impl Trajectory {
    /// From a recording; `summary` is `None` for a run that failed.
    pub fn new(
        py: Python<'_>,
        simulation: &Simulation,
        recording: &Recording,
        summary: Option<&Summary>,
    ) -> PyResult<Self> {
        let rows = &recording.rows;
        let n = rows.len();
        let column = |of: &dyn Fn(&phipsi_simulate::Row) -> f64| -> PyResult<Py<PyArrayDyn<f64>>> {
            Ok(array(py, rows.iter().map(of).collect(), vec![n])?.unbind())
        };
        let outputs = PyDict::new(py);
        for (i, output) in simulation.outputs.iter().enumerate() {
            outputs.set_item(&output.name, column(&|r| r.outputs[i])?)?;
        }
        let estimate = summary.and_then(|s| s.error_estimate.as_ref());
        let momentum_error = summary.and_then(|s| s.momentum_error).map(|[angular, linear]| {
            let d = PyDict::new(py);
            d.set_item("angular", angular)?;
            d.set_item("linear", linear)?;
            PyResult::Ok(d.unbind())
        });
        let closure_residual = summary.and_then(|s| s.closures).map(|c| {
            let d = PyDict::new(py);
            d.set_item("position", c.position)?;
            d.set_item("velocity", c.velocity)?;
            PyResult::Ok(d.unbind())
        });
        let error = RunError {
            q: estimate.and_then(|e| e.q),
            v: estimate.and_then(|e| e.v),
            horizon: estimate.and_then(|e| e.horizon),
            how: estimate.map(|e| e.how.clone()),
            energy_error: summary.map(|s| s.energy_error),
            momentum_error: momentum_error.transpose()?,
            closure_residual: closure_residual.transpose()?,
            energy_removed: summary.and_then(|s| s.closures).map(|c| c.energy_removed),
        };
        let (nq, nv) = (simulation.start.q.len(), simulation.start.v.len());
        let stack = |of: fn(&phipsi_simulate::Row) -> &[f64], width: usize| {
            let data = rows.iter().flat_map(|r| of(r).iter().copied()).collect();
            PyResult::Ok(array(py, data, vec![n, width])?.unbind())
        };
        Ok(Trajectory {
            t: column(&|r| r.t)?,
            q: stack(|r| &r.q, nq)?,
            v: stack(|r| &r.v, nv)?,
            energy: column(&|r| r.energy[0] + r.energy[1])?,
            kinetic_energy: column(&|r| r.energy[0])?,
            potential_energy: column(&|r| r.energy[1])?,
            work: column(&|r| r.energy[2])?,
            momentum: stack(|r| &r.momentum, 6)?,
            error: Py::new(py, error)?,
            outputs: outputs.unbind(),
            method: method_name(simulation.choice.method).into(),
            steps: recording.steps.len() as u64,
            rejected: summary.map(|s| s.rejected),
            evaluations: summary.map(|s| s.evaluations),
            wall_s: summary.map(|s| s.wall_s),
            limits: summary.map_or(Vec::new(), |s| limits_in_words(&s.limits)),
            events: summary.map_or(Vec::new(), |s| {
                s.events.iter().map(|e| (e.t, e.name.clone(), e.kind.clone())).collect()
            }),
            left_out: simulation.left_out(),
            approximated: simulation.approximated.clone(),
        })
    }
}

#[pymethods]
impl RunError {
    /// The result again, in another process.
    #[staticmethod]
    fn _restore(state: &Bound<'_, PyDict>) -> PyResult<RunError> {
        Ok(RunError {
            q: item(state, "q")?,
            v: item(state, "v")?,
            horizon: item(state, "horizon")?,
            how: item(state, "how")?,
            energy_error: item(state, "energy_error")?,
            momentum_error: item(state, "momentum_error")?,
            closure_residual: item(state, "closure_residual")?,
            energy_removed: item(state, "energy_removed")?,
        })
    }
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        reduced(
            slf.as_any(),
            &[
                "q",
                "v",
                "horizon",
                "how",
                "energy_error",
                "momentum_error",
                "closure_residual",
                "energy_removed",
            ],
        )
    }
}

#[pymethods]
impl Trajectory {
    /// The result again, in another process.
    #[staticmethod]
    fn _restore(state: &Bound<'_, PyDict>) -> PyResult<Trajectory> {
        Ok(Trajectory {
            t: item(state, "t")?,
            q: item(state, "q")?,
            v: item(state, "v")?,
            energy: item(state, "energy")?,
            kinetic_energy: item(state, "kinetic_energy")?,
            potential_energy: item(state, "potential_energy")?,
            work: item(state, "work")?,
            momentum: item(state, "momentum")?,
            error: item(state, "error")?,
            outputs: item(state, "outputs")?,
            method: item(state, "method")?,
            steps: item(state, "steps")?,
            rejected: item(state, "rejected")?,
            evaluations: item(state, "evaluations")?,
            wall_s: item(state, "wall_s")?,
            limits: item(state, "limits")?,
            events: item(state, "events")?,
            left_out: item(state, "left_out")?,
            approximated: item(state, "approximated")?,
        })
    }
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        reduced(
            slf.as_any(),
            &[
                "t",
                "q",
                "v",
                "energy",
                "kinetic_energy",
                "potential_energy",
                "work",
                "momentum",
                "error",
                "outputs",
                "method",
                "steps",
                "rejected",
                "evaluations",
                "wall_s",
                "limits",
                "events",
                "left_out",
                "approximated",
            ],
        )
    }
}
