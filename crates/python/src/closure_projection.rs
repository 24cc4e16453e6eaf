//! Projections onto the closures of a model, the tree that they ask for, and prescribed motions of closed chains.

use crate::batch::{Argument, Batch};
use crate::closure::{AssemblyInfo, as_type};
use crate::closure_motion::Instant;
use crate::compiled::{Compiled, Names};
use crate::errors::{name_error, violations_error};
use crate::model::Model;
use phipsi::closure::{ClosedDynamics, Conditions, Prescribed, Projection, choose_tree};
use phipsi::recursion::Form;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Mutex, PoisonError};

/// What ``project_velocity`` did.
///
/// ``velocity_residual``: what is left of the closures' rates, largest of m/s and rad/s; ``energy_removed``: kinetic energy of the
/// change, J; ``rank``: independent rows. Floats and an int, or arrays of the batch axes.
#[pyclass(frozen, get_all, module = "phipsi")]
pub struct VelocityProjectionInfo {
    /// Residual of the velocities.
    pub velocity_residual: Py<PyAny>,
    /// Kinetic energy of the change.
    pub energy_removed: Py<PyAny>,
    /// Independent rows.
    pub rank: Py<PyAny>,
}

#[pymethods]
impl VelocityProjectionInfo {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let of = |x: &Py<PyAny>| x.bind(py).repr().map(|s| s.to_string());
        let (residual, energy, rank) =
            (of(&self.velocity_residual)?, of(&self.energy_removed)?, of(&self.rank)?);
        Ok(format!(
            "VelocityProjectionInfo(velocity_residual={residual}, energy_removed={energy}, rank={rank})"
        ))
    }
}

/// The projection I − b̂b̂* of a model with loops at one configuration: an operator, never a matrix.
///
/// b̂ spans the directions that the loops close, in the coordinates x = l* θ̇ in which the kinetic energy of the open tree is
/// ½|x|²; 𝓜 = l l*.
#[pyclass(frozen, module = "phipsi")]
pub struct ClosureProjection {
    work: Mutex<Projection<f64>>,
    compiled: std::sync::Arc<Compiled>,
}

impl ClosureProjection {
    fn each<'py>(
        &self,
        x: &Bound<'py, PyAny>,
        step: impl Fn(&mut Projection<f64>, &mut [f64]) -> Result<(), phipsi::closure::ClosureError> + Send + Sync,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = x.py();
        let mut x = self.compiled.v(x, "x")?;
        let batch = Batch::of(py, [&mut x])?;
        let nv = self.compiled.model.nv();
        let template = self.work.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let out = batch.each(
            py,
            nv,
            || template.clone(),
            |work, i, out| {
                out.copy_from_slice(x.at(i));
                Ok(step(work, out)?)
            },
        );
        let out = out.map_err(|e| self.compiled.failure(py, &batch, e, Names::Velocity("projected")))?;
        batch.array(py, out, &[nv])
    }
}

#[pymethods]
impl ClosureProjection {
    /// Number of directions that the loops close.
    #[getter]
    fn rank(&self) -> usize {
        self.work.lock().unwrap_or_else(PoisonError::into_inner).rank()
    }
    /// (I − b̂b̂*) x, O(nv).
    ///
    /// Parameters
    /// ----------
    /// x : (…, nv).
    ///
    /// Returns
    /// -------
    /// (…, nv).
    ///
    /// Raises
    /// ------
    /// ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.close_loop("world", np.eye(4), m.body_names[-1], np.eye(4), kind="point_on_plane")
    /// >>> P = m.closure_projection(m.assemble([0.3, 0.2])[0])
    /// >>> x = P.apply([1.0, 2.0])
    /// >>> bool(np.allclose(P.apply(x), x)), P.rank
    /// (True, 1)
    fn apply<'py>(&self, x: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.each(x, |work, x| work.apply(x))
    }
    /// Accelerations of the closed mechanism at rest, without weight, under generalized forces, O(nv).
    ///
    /// Parameters
    /// ----------
    /// x : (…, nv), forces, N·m or N.
    ///
    /// Returns
    /// -------
    /// (…, nv), rad/s² or m/s²: l⁻*(I − b̂b̂*)l⁻¹ x.
    ///
    /// Raises
    /// ------
    /// ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.close_loop("world", np.eye(4), m.body_names[-1], np.eye(4), kind="point_on_plane")
    /// >>> q, _ = m.assemble([0.3, 0.2])
    /// >>> m.gravity = (0, 0, 0)
    /// >>> a = m.forward_dynamics(q, [0.0, 0.0], [1.0, 2.0])
    /// >>> bool(np.allclose(m.closure_projection(q).solve([1.0, 2.0]), a))
    /// True
    fn solve<'py>(&self, x: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.each(x, |work, x| work.solve(x))
    }
    fn __repr__(&self) -> String {
        format!("<ClosureProjection of rank {} on {} velocities>", self.rank(), self.compiled.model.nv())
    }
}

impl Model {
    /// ``hybrid_dynamics`` of a model with loops; `given`: nv numbers a state, accelerations and forces.
    ///
    /// # Errors
    /// As of ``hybrid_dynamics``.
    pub fn closed_hybrid_dynamics(
        py: Python<'_>,
        compiled: &Compiled,
        batch: &Batch,
        state: [&Argument; 2],
        (active, given): (&[bool], &[f64]),
        wrenches: &crate::compiled::Wrenches,
    ) -> PyResult<Vec<f64>> {
        let (template, _) = compiled.closed_in(py, Form::Auto)?;
        let template = &*template;
        let nv = compiled.model.nv();
        let [q, v] = state;
        let out = batch.each(
            py,
            nv,
            || (template.clone(), wrenches.workspace(), vec![0.0; nv], vec![0.0; nv]),
            |(work, scratch, a, forces), i, out| {
                let loads = wrenches.at(i, scratch);
                // Only the active ones are read of the accelerations, and forces of the passive ones.
                let given = &given[i * nv..][..nv];
                let prescribed = Some(Prescribed { active, acceleration: given });
                let conditions = Conditions { wrenches: loads, prescribed, ..Conditions::default() };
                let mut solved = work.run(q.at(i), v.at(i), given, &conditions, a)?;
                solved.generalized_forces(q.at(i), v.at(i), given, a, loads, forces)?;
                for j in 0..nv {
                    out[j] = if active[j] { forces[j] } else { a[j] };
                }
                Ok(())
            },
        );
        out.map_err(|e| compiled.failure(py, batch, e, Names::Columns("result")))
    }
}

#[pymethods]
impl Model {
    /// Makes positions consistent with the closures, near where they are: q ∘ δ(−Φ), the least change in the kinetic metric.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq), near the closures; ``assemble`` goes further.
    /// closure_motion : {name: (3, rows)}, what closures are given at this instant, as ``forward_dynamics`` takes it; only the
    ///     positions count.
    ///
    /// Returns
    /// -------
    /// (q, AssemblyInfo).
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError, with the worst closure, if the residual does not fall to rounding.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.close_loop("world", np.eye(4), m.body_names[-1], np.eye(4), kind="point_on_plane")
    /// >>> q, _ = m.assemble([0.3, 0.2])
    /// >>> q, info = m.project_position(q + 1e-3)
    /// >>> bool(info.closure_residual < 1e-14)
    /// True
    #[pyo3(signature = (q, closure_motion = None))]
    fn project_position<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        closure_motion: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(Bound<'py, PyAny>, Py<AssemblyInfo>)> {
        self.closed_positions(py, q, closure_motion, ClosedDynamics::project_position)
    }
    /// Makes velocities consistent with the closures: v + δ(−Jv), the change of least kinetic energy.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v : (…, nv).
    /// closure_motion : {name: (3, rows)}, what closures are given at this instant, as ``forward_dynamics`` takes it; only the
    ///     velocities count.
    ///
    /// Returns
    /// -------
    /// (v, VelocityProjectionInfo).
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError at a joint without articulated inertia.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.close_loop("world", np.eye(4), m.body_names[-1], np.eye(4), kind="point_on_plane")
    /// >>> q, _ = m.assemble([0.3, 0.2])
    /// >>> v, info = m.project_velocity(q, [1.0, 0.0])
    /// >>> info.rank, bool(info.velocity_residual < 1e-14), bool(info.energy_removed > 0)
    /// (1, True, True)
    #[pyo3(signature = (q, v, closure_motion = None))]
    fn project_velocity<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        closure_motion: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(Bound<'py, PyAny>, Py<VelocityProjectionInfo>)> {
        let compiled = self.compiled();
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v, "v")?);
        let batch = Batch::of(py, [&mut q, &mut v])?;
        let template = compiled.closed(py)?;
        let instant = Instant::read(template, closure_motion)?;
        let nv = compiled.model.nv();
        let out = batch.each(
            py,
            nv + 3,
            || template.clone(),
            |work, i, out| {
                out[..nv].copy_from_slice(v.at(i));
                let done = work.project_velocity(q.at(i), &mut out[..nv], &instant.conditions())?;
                out[nv..].copy_from_slice(&[done.residual[1], done.energy_removed, done.rank as f64]);
                Ok(())
            },
        );
        let out = out.map_err(|e| compiled.failure(py, &batch, e, Names::Velocity("velocity")))?;
        let states = || out.chunks_exact(nv + 3);
        let column = |j: usize| batch.array(py, states().map(|s| s[nv + j]).collect(), &[]);
        let info = VelocityProjectionInfo {
            velocity_residual: column(0)?.unbind(),
            energy_removed: column(1)?.unbind(),
            rank: as_type(column(2)?, "int64")?,
        };
        let v = batch.array(py, states().flat_map(|s| s[..nv].iter().copied()).collect(), &[nv])?;
        Ok((v, Py::new(py, info)?))
    }
    /// The projection I − b̂b̂* at one configuration, whose loops are closed.
    ///
    /// Parameters
    /// ----------
    /// q : (nq,).
    ///
    /// Returns
    /// -------
    /// ClosureProjection, with ``apply``, ``solve`` and ``rank``.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError at a joint without articulated inertia.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.close_loop("world", np.eye(4), m.body_names[-1], np.eye(4), kind="point_on_plane")
    /// >>> m.closure_projection(m.assemble([0.3, 0.2])[0])
    /// <ClosureProjection of rank 1 on 2 velocities>
    fn closure_projection(&self, py: Python<'_>, q: &Bound<'_, PyAny>) -> PyResult<ClosureProjection> {
        let compiled = self.compiled();
        let mut q = compiled.q(q, "q")?;
        crate::simulator::check_single(py, &q)?;
        let batch = Batch::of(py, [&mut q])?;
        let projection = Projection::new(&compiled.model, q.at(0))
            .map_err(|e| compiled.failure(py, &batch, (0, e.into()), Names::Other("a projection")))?;
        Ok(ClosureProjection { work: Mutex::new(projection), compiled })
    }
    /// Puts the model on the spanning tree on which its loops overlap least: closures may become joints, joints closures, and
    /// joints may be turned round. The coordinates are those of the new joints: ``joint_names``.
    ///
    /// Parameters
    /// ----------
    /// keep : names of joints and closures that stay what they are. Joints with limits, damping, friction or a coupling stay
    ///     joints in any case.
    ///
    /// Returns
    /// -------
    /// str : what was exchanged, and the cost of both trees: the sum over joints of the squared number of open rows.
    ///
    /// Raises
    /// ------
    /// ArgumentError for a name that there is not.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.choose_tree()
    /// 'the given tree, sum of squared open rows 0: no better one was found'
    #[pyo3(signature = (keep = None))]
    fn choose_tree(&self, py: Python<'_>, keep: Option<Vec<String>>) -> PyResult<String> {
        let keep = keep.unwrap_or_default();
        let names: Vec<&str> = keep.iter().map(String::as_str).collect();
        let mut words = String::new();
        self.replace(|model| {
            for name in &names {
                if !model.closures().iter().any(|c| c.name == *name) {
                    model.find_joint(name).map_err(|e| name_error(py, "keep", &e))?;
                }
            }
            let choice = choose_tree(model, &names).map_err(|e| violations_error(py, &e))?;
            words = choice.to_string();
            Ok(choice.model)
        })?;
        Ok(words)
    }
}
