//! Methods of `Model` about closed loops.

use crate::batch::{Argument, Batch};
use crate::closure_motion::Instant;
use crate::compiled::{Compiled, Names};
use crate::dynamics::{ForwardInfo, forward_judgement};
use crate::errors::{Failure, argument_error, choice_error, dynamics_error, exception, violations_error};
use crate::model::Model;
use phipsi::closure::{ClosedDynamics, ClosedForm, ClosureError, Conditions, PositionProjection, Solved};
use phipsi::model::{Closure, ClosureKind, Placement};
use phipsi::motion::MotionError;
use phipsi::recursion::{Form, forward_info};
use phipsi::spatial::{Mat3, Quaternion, Vec3};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// What ``assemble`` did.
///
/// ``closure_residual``: what is left open, largest of m and rad; ``iterations``. A float and an int, or arrays of the batch
/// axes.
#[pyclass(frozen, get_all, module = "phipsi")]
pub struct AssemblyInfo {
    /// Residual of the positions.
    pub closure_residual: Py<PyAny>,
    /// Iterations.
    pub iterations: Py<PyAny>,
}

#[pymethods]
impl AssemblyInfo {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (residual, iterations) =
            (self.closure_residual.bind(py).repr()?, self.iterations.bind(py).repr()?);
        Ok(format!("AssemblyInfo(closure_residual={residual}, iterations={iterations})"))
    }
}

/// What moves a configuration onto the closures.
pub(crate) type Closing = fn(
    &mut ClosedDynamics<f64>,
    &mut [f64],
    &Conditions<'_, f64>,
) -> Result<PositionProjection, ClosureError>;

/// A pose in a body, from a 4×4 matrix.
fn placement(object: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Placement> {
    let describe = |i: usize| format!("row {}, column {}", i / 4, i % 4);
    let read = Argument::read(object, name, &[4, 4], "a pose in the body's frame, m", &describe)?;
    let py = object.py();
    crate::simulator::check_single(py, &read)?;
    let x = read.at(0);
    let rotation = Mat3([0, 1, 2].map(|i| [x[4 * i], x[4 * i + 1], x[4 * i + 2]]));
    let product = rotation.transpose() * rotation;
    let determinant = Vec3(rotation.0[0]).cross(Vec3(rotation.0[1])).dot(Vec3(rotation.0[2]));
    let unit = (0..9).all(|i| (product.0[i / 3][i % 3] - f64::from(i / 3 == i % 3)).abs() < 1e-6);
    if !unit || determinant < 0.0 || x[12..] != [0.0, 0.0, 0.0, 1.0] {
        let message = format!(
            "`{name}` is no pose: its upper left 3×3 block must be a rotation and its last row 0 0 0 1"
        );
        return Err(argument_error(py, name, "another matrix".into(), "a pose, 4×4".into(), &message, None));
    }
    Ok(Placement { translation: [x[3], x[7], x[11]], rotation: Quaternion::from_rotation(&rotation).0 })
}

/// Whole numbers that went through a batch as floats.
pub(crate) fn as_type<'py>(x: Bound<'py, PyAny>, kind: &str) -> PyResult<Py<PyAny>> {
    let py = x.py();
    if let Ok(number) = x.extract::<f64>() {
        return if kind == "bool" {
            (number != 0.0).into_py_any(py)
        } else {
            (number as i64).into_py_any(py)
        };
    }
    Ok(x.call_method1("astype", (kind,))?.unbind())
}

impl Model {
    /// Configurations that `close` moves onto the closures.
    pub(crate) fn closed_positions<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        closure_motion: Option<&Bound<'py, PyDict>>,
        close: Closing,
    ) -> PyResult<(Bound<'py, PyAny>, Py<AssemblyInfo>)> {
        let compiled = self.compiled();
        let mut q = compiled.q(q, "q")?;
        let batch = Batch::of(py, [&mut q])?;
        let template = compiled.closed(py)?;
        let instant = Instant::read(template, closure_motion)?;
        let nq = compiled.model.nq();
        let out = batch.each(
            py,
            nq + 2,
            || template.clone(),
            |work, i, out| {
                out[..nq].copy_from_slice(q.at(i));
                let done = close(work, &mut out[..nq], &instant.conditions())?;
                compiled.model.normalize(&mut out[..nq]);
                out[nq..].copy_from_slice(&[done.residual[1], done.iterations as f64]);
                Ok(())
            },
        );
        let out = out.map_err(|e| compiled.failure(py, &batch, e, Names::Other("a configuration")))?;
        let states = || out.chunks_exact(nq + 2);
        let column = |j: usize| batch.array(py, states().map(|s| s[nq + j]).collect(), &[]);
        let info =
            AssemblyInfo { closure_residual: column(0)?.unbind(), iterations: as_type(column(1)?, "int64")? };
        let q = batch.array(py, states().flat_map(|s| s[..nq].iter().copied()).collect(), &[nq])?;
        Ok((q, Py::new(py, info)?))
    }
    /// ``forward_dynamics`` of a model with loops.
    ///
    /// # Errors
    /// As of ``forward_dynamics``.
    pub fn closed_forward_dynamics<'py>(
        &self,
        py: Python<'py>,
        compiled: &Compiled,
        arguments: [&Bound<'py, PyAny>; 3],
        (wrenches, closure_motion): (Option<&Bound<'py, PyAny>>, Option<&Bound<'py, PyDict>>),
        form: Form,
        info: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let [q, v, tau] = arguments;
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v, "v")?);
        let (mut tau, mut wrenches) = (compiled.v(tau, "tau")?, compiled.wrenches(wrenches)?);
        let batch = Batch::of(py, [&mut q, &mut v, &mut tau].into_iter().chain(&mut wrenches.arguments))?;
        let (template, name) = compiled.closed_in(py, form)?;
        let template = &*template;
        let instant = Instant::read(template, closure_motion)?;
        let motion = instant.motion();
        let nv = compiled.model.nv();
        // Accelerations, then what the info holds.
        const MORE: usize = 10;
        // Of the first state: redundant rows, and the one that contradicts the others most.
        let redundant = std::sync::Mutex::new((Vec::new(), None));
        let out = batch.each(
            py,
            nv + MORE,
            || (template.clone(), wrenches.workspace(), vec![0.0; nv]),
            |(work, scratch, tree_force), i, out| {
                let loads = wrenches.at(i, scratch);
                let conditions = Conditions { wrenches: loads, motion, ..Conditions::default() };
                let (a, more) = out.split_at_mut(nv);
                let solved = work.run(q.at(i), v.at(i), tau.at(i), &conditions, a)?;
                if !info {
                    return Ok(());
                }
                let found = solved.info();
                if i == 0 {
                    let all = (solved.redundant().to_vec(), found.inconsistency);
                    *redundant.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = all;
                }
                // What moves the open tree as the loops do.
                solved.generalized_constraint_force(tree_force)?;
                tree_force.iter_mut().zip(tau.at(i)).for_each(|(f, tau)| *f += tau);
                let judged = forward_info(work.layout(), q.at(i), v.at(i), tree_force, loads, a)?;
                more.copy_from_slice(&[
                    judged.backward_error,
                    -1.0,
                    0.0,
                    found.position_error,
                    found.velocity_error,
                    // Infinite where nothing is closed: an array of results is finite.
                    found.smallest_pivot.min(f64::MAX),
                    found.error_estimate,
                    found.rank as f64,
                    f64::from(found.near_singular),
                    f64::from(found.form == ClosedForm::Mixed),
                ]);
                if let Some(worst) = judged.worst_hinge
                    && let Ok(k) = compiled.model.find_joint(&worst.joint)
                {
                    more[1] = (compiled.model.v_offset(k) + worst.component) as f64;
                    more[2] = worst.ratio;
                }
                Ok(())
            },
        );
        let out = out.map_err(|e| compiled.failure(py, &batch, e, Names::Velocity("acceleration")))?;
        let states = || out.chunks_exact(nv + MORE);
        let accelerations =
            batch.array(py, states().flat_map(|s| s[..nv].iter().copied()).collect(), &[nv])?;
        if !info {
            return Ok(accelerations);
        }
        let judged: Vec<f64> = states().flat_map(|s| s[nv..nv + 3].iter().copied()).collect();
        let column = |j: usize| batch.array(py, states().map(|s| s[nv + j]).collect(), &[]);
        let (redundant, inconsistency) =
            redundant.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        // A state that squares did not serve was solved in the mixed form.
        let form = if states().any(|s| s[nv + 9] != 0.0) { ClosedForm::Mixed.name() } else { name };
        let name = |closure: usize, row: usize| {
            format!("closure `{}`: {}", template.closure(closure).0, template.direction(closure, row))
        };
        let single = batch.place(0).is_none();
        let found = ForwardInfo {
            closure_residual: Some(column(3)?.unbind()),
            velocity_residual: Some(column(4)?.unbind()),
            smallest_pivot: Some(column(5)?.unbind()),
            error_estimate: Some(column(6)?.unbind()),
            rank: Some(as_type(column(7)?, "int64")?),
            near_singular: Some(as_type(column(8)?, "bool")?),
            redundant: single.then(|| redundant.iter().map(|r| name(r.closure, r.row)).collect()),
            inconsistency: inconsistency
                .filter(|_| single)
                .map(|i| format!("{}, by {:.1e} of its terms", name(i.closure, i.row), i.size)),
            ..forward_judgement(py, compiled, &batch, &judged, form)?
        };
        (accelerations, Py::new(py, found)?).into_bound_py_any(py)
    }
    /// `size` numbers of the solved closed dynamics of every state.
    fn each_closed<'py>(
        &self,
        py: Python<'py>,
        compiled: &Compiled,
        arguments: [&Bound<'py, PyAny>; 3],
        closure_motion: Option<&Bound<'py, PyDict>>,
        size: usize,
        body: impl Fn(&mut Solved<'_, f64>, &mut [f64]) -> Result<(), ClosureError> + Sync + Send,
    ) -> PyResult<(Batch, Vec<f64>)> {
        let [q, v, tau] = arguments;
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v, "v")?);
        let mut tau = compiled.v(tau, "tau")?;
        let batch = Batch::of(py, [&mut q, &mut v, &mut tau])?;
        let (template, _) = compiled.closed_in(py, Form::Auto)?;
        let template = &*template;
        let instant = Instant::read(template, closure_motion)?;
        let nv = compiled.model.nv();
        let out = batch.each(
            py,
            size,
            || (template.clone(), vec![0.0; nv]),
            |(work, a), i, out| {
                let mut solved = work.run(q.at(i), v.at(i), tau.at(i), &instant.conditions(), a)?;
                Ok(body(&mut solved, out)?)
            },
        );
        let out =
            out.map_err(|e| compiled.failure(py, &batch, e, Names::Other("a force of the closures")))?;
        Ok((batch, out))
    }
}

#[pymethods]
impl Model {
    /// Joins two bodies, or a body and ``world``, besides the joints of the tree; ``forward_dynamics`` follows the loops.
    ///
    /// Parameters
    /// ----------
    /// body_a, body_b : names of bodies.
    /// pose_a, pose_b : (4, 4), frames A and B in their bodies.
    /// kind : what the closure keeps; axes are those of the frames. "weld": everything; "revolute": a hinge about the z axes;
    ///     "spherical": the origins; "universal": the origins, and x of A at right angles to y of B; "cylindrical": the z axes
    ///     as one line; "prismatic": a slider along them; "planar": the x-y planes; "distance": the distance of the origins,
    ///     ``length``; "point_on_plane": the origin of B in the x-y plane of A.
    /// name : by which results and errors call it; "closure1", "closure2", … if None.
    /// length : of "distance", m.
    ///
    /// Rows that others imply are found and left out: a planar loop may be closed by a hinge in three dimensions.
    ///
    /// Raises
    /// ------
    /// ArgumentError; ModelError for a name that is taken.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> tip = np.eye(4)
    /// >>> m.close_loop("world", tip, m.body_names[-1], tip, kind="point_on_plane", name="floor")
    /// >>> m.closure_residual(m.neutral()).shape
    /// (1,)
    #[pyo3(signature = (body_a, pose_a, body_b, pose_b, kind = "weld", name = None, length = None))]
    #[allow(clippy::too_many_arguments)]
    fn close_loop(
        &self,
        py: Python<'_>,
        body_a: &str,
        pose_a: &Bound<'_, PyAny>,
        body_b: &str,
        pose_b: &Bound<'_, PyAny>,
        kind: &str,
        name: Option<String>,
        length: Option<f64>,
    ) -> PyResult<()> {
        let Some(kind) = ClosureKind::from_word(kind, length.unwrap_or(0.0)) else {
            return Err(choice_error(py, "kind", kind, &ClosureKind::WORDS));
        };
        let (pose_a, pose_b) = (placement(pose_a, "pose_a")?, placement(pose_b, "pose_b")?);
        self.replace(|model| {
            for (argument, body) in [("body_a", body_a), ("body_b", body_b)] {
                model.find_body(body).map_err(|e| crate::errors::name_error(py, argument, &e))?;
            }
            let name = name.clone().unwrap_or_else(|| {
                let taken = |name: &String| model.closures().iter().any(|c| c.name == *name);
                (1..).map(|i| format!("closure{i}")).find(|name| !taken(name)).unwrap_or_default()
            });
            let (body_a, body_b) = (body_a.to_string(), body_b.to_string());
            let closure = Closure { name, kind, body_a, pose_a, body_b, pose_b };
            model.clone().with_closure(closure).map_err(|e| violations_error(py, &e))
        })
    }
    /// Names of the closures, in the order of their rows; a coupling (``mimic``) is called by its following joint.
    #[getter]
    fn closure_names(&self) -> Vec<String> {
        let model = &self.compiled().model;
        let closures = model.closures().iter().map(|c| c.name.clone());
        closures.chain(model.couplings().iter().map(|c| c.joint.clone())).collect()
    }
    /// A configuration that closes the loops, near a rough guess: Levenberg's iteration in the kinetic metric.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq), the guess.
    /// closure_motion : {name: (3, rows)}, what closures are given at this instant, as ``forward_dynamics`` takes it; only the
    ///     positions count.
    ///
    /// Returns
    /// -------
    /// (q, AssemblyInfo).
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError, with the worst closure, if the loops cannot be closed from there.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.close_loop("world", np.eye(4), m.body_names[-1], np.eye(4), kind="point_on_plane")
    /// >>> q, info = m.assemble([0.3, 0.2])
    /// >>> bool(abs(m.closure_residual(q)[0]) < 1e-14)
    /// True
    #[pyo3(signature = (q, closure_motion = None))]
    fn assemble<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        closure_motion: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(Bound<'py, PyAny>, Py<AssemblyInfo>)> {
        self.closed_positions(py, q, closure_motion, ClosedDynamics::assemble)
    }
    /// How far a state is off the closures.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v : (…, nv), or None.
    /// closure_motion : {name: (3, rows)}, what closures are given at this instant, as ``forward_dynamics`` takes it.
    ///
    /// Returns
    /// -------
    /// (…, rows), rad and m, closure by closure in the order of ``closure_names``, angular rows of each first, in the axes of
    /// frame A; with v a tuple of that and (…, rows) of the velocities.
    ///
    /// Raises
    /// ------
    /// ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.close_loop("world", np.eye(4), m.body_names[-1], np.eye(4), kind="point_on_plane")
    /// >>> position, velocity = m.closure_residual([0.3, 0.2], v=[1.0, 0.0])
    #[pyo3(signature = (q, v = None, closure_motion = None))]
    fn closure_residual<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: Option<&Bound<'py, PyAny>>,
        closure_motion: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let mut q = compiled.q(q, "q")?;
        let mut v = v.map(|v| compiled.v(v, "v")).transpose()?;
        let batch = Batch::of(py, std::iter::once(&mut q).chain(&mut v))?;
        let template = compiled.closed(py)?;
        let instant = Instant::read(template, closure_motion)?;
        let rows = template.rows();
        let size = if v.is_some() { 2 * rows } else { rows };
        let out = batch.each(
            py,
            size,
            || template.clone(),
            |work, i, out| {
                let (position, velocity) = out.split_at_mut(rows);
                let v = v.as_ref().map(|v| v.at(i));
                Ok(work.residual(q.at(i), v, &instant.conditions(), position, velocity)?)
            },
        );
        let out = out.map_err(|e| compiled.failure(py, &batch, e, Names::Other("a residual")))?;
        if v.is_none() {
            return batch.array(py, out, &[rows]);
        }
        let half = |first: usize| {
            let states = out.chunks_exact(size.max(1));
            batch.array(py, states.flat_map(|s| s[first..first + rows].iter().copied()).collect(), &[rows])
        };
        (half(0)?, half(rows)?).into_bound_py_any(py)
    }
    /// Forces of the closures, in the closure's own axes.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v, tau : (…, nv).
    /// closure_motion : {name: (3, rows)}, what closures are given at this instant, as ``forward_dynamics`` takes it.
    ///
    /// Returns
    /// -------
    /// {name: (…, rows)}: moments of angular rows, then forces, on the body of frame B at its origin, in the axes of frame A; the
    /// opposite acts on the body of frame A. Of redundant rows, whose forces are not determined, those of least norm.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError at a joint without articulated inertia.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.close_loop("world", np.eye(4), m.body_names[-1], np.eye(4), kind="point_on_plane", name="floor")
    /// >>> q, info = m.assemble([0.3, 0.2])
    /// >>> m.closure_forces(q, [0.0, 0.0], [0.0, 0.0])["floor"].shape
    /// (1,)
    #[pyo3(signature = (q, v, tau, closure_motion = None))]
    fn closure_forces<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
        closure_motion: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let compiled = self.compiled();
        let template = compiled.closed(py)?;
        let rows = template.rows();
        let (batch, out) = self
            .each_closed(py, &compiled, [q, v, tau], closure_motion, rows, |s, out| s.closure_forces(out))?;
        let forces = PyDict::new(py);
        for i in 0..template.closures() {
            let (name, range) = template.closure(i);
            let states = out.chunks_exact(rows.max(1));
            let part = states.flat_map(|s| s[range.clone()].iter().copied()).collect();
            forces.set_item(name, batch.array(py, part, &[range.len()])?)?;
        }
        Ok(forces)
    }
    /// The generalized force of all closures, Jᵀλ; unique also where single forces are not.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v, tau : (…, nv).
    /// closure_motion : {name: (3, rows)}, what closures are given at this instant, as ``forward_dynamics`` takes it.
    ///
    /// Returns
    /// -------
    /// (…, nv), N·m or N: what must be added to tau for the open tree to move as the closed mechanism.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError at a joint without articulated inertia.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.close_loop("world", np.eye(4), m.body_names[-1], np.eye(4), kind="point_on_plane")
    /// >>> q, info = m.assemble([0.3, 0.2])
    /// >>> m.generalized_constraint_force(q, [0.0, 0.0], [0.0, 0.0]).shape
    /// (2,)
    #[pyo3(signature = (q, v, tau, closure_motion = None))]
    fn generalized_constraint_force<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
        closure_motion: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let nv = compiled.model.nv();
        let (batch, out) = self.each_closed(py, &compiled, [q, v, tau], closure_motion, nv, |s, out| {
            s.generalized_constraint_force(out)
        })?;
        batch.array(py, out, &[nv])
    }
}

impl From<ClosureError> for Failure {
    fn from(e: ClosureError) -> Self {
        match e {
            ClosureError::Dynamics(e) => e.into(),
            e => Failure::Closure(e),
        }
    }
}

/// An error of closed loops, at a place in the batch.
pub fn closure_error(py: Python<'_>, error: &ClosureError, state: Option<Vec<usize>>) -> PyErr {
    let at = state.as_ref().map(|s| format!("state {s:?}: ")).unwrap_or_default();
    let message = format!("{at}{error}");
    match error {
        ClosureError::NotClosed { closure, residual, required, .. } => {
            let fields = vec![
                ("quantity", Some(format!("residual of closure `{closure}`").into())),
                ("found", Some(crate::errors::Field::Number(*residual))),
                ("required", Some(format!("at most {required:e}").into())),
                ("remedy", Some("start nearer, or correct the lengths of the mechanism".into())),
                ("state", state.map(crate::errors::Field::Tuple)),
            ];
            exception(py, "NumericalError", &message, fields)
        }
        ClosureError::NotFinite { joint, component, found } => {
            let fields = vec![
                ("quantity", Some("acceleration".into())),
                ("joint", Some(joint.as_str().into())),
                ("component", Some(crate::errors::Field::Index(*component))),
                ("found", Some(crate::errors::Field::Number(*found))),
                ("required", Some("a finite number".into())),
                ("state", state.map(crate::errors::Field::Tuple)),
            ];
            exception(py, "NumericalError", &message, fields)
        }
        other => exception(py, "ModelError", &other.to_string(), vec![]),
    }
}

/// Equations of motion that could not be set up, or loops that could not be closed.
pub fn motion_error(py: Python<'_>, error: &MotionError) -> PyErr {
    match error {
        MotionError::Dynamics(e) => dynamics_error(py, e, None),
        MotionError::Closure(e) => closure_error(py, e, None),
        other => exception(py, "ModelError", &other.to_string(), vec![]),
    }
}
