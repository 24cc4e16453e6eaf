//! Methods of `Model` about forces: forward and inverse dynamics, mass matrices, reactions.

use crate::batch::Batch;
use crate::compiled::{Compiled, Names};
use crate::errors::choice_error;
use crate::model::Model;
use phipsi::motion::forces::passive_forces;
use phipsi::recursion::batch::{Input, kernels};
use phipsi::recursion::{Form, FormForwardDynamics, forward_info};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The hinge that loses most digits.
///
/// ``joint``, ``component``: which one. ``ratio``: its articulated inertia over the inertia about it with all joints
/// outboard locked; cancellation can multiply rounding by the inverse. ``state``: which state of the batch, or None.
#[pyclass(frozen, get_all, module = "phipsi")]
pub struct WorstHinge {
    /// The joint's name.
    pub joint: String,
    /// Which of its degrees of freedom.
    pub component: usize,
    /// Articulated over composite inertia.
    pub ratio: f64,
    /// Place in the batch.
    pub state: Option<Vec<usize>>,
}

#[pymethods]
impl WorstHinge {
    fn __repr__(&self) -> String {
        let WorstHinge { joint, component, ratio, .. } = self;
        format!("<joint `{joint}`, component {component}, ratio {ratio:e}>")
    }
}

/// How good a result of ``forward_dynamics`` is.
///
/// ``backward_error``: |τ − inverse dynamics of the result| over the sum of |terms|, largest component; a float, or an
/// array of the batch axes. ``worst_hinge``: a WorstHinge, of the whole batch; None if nothing moves. ``form``: the form
/// that ran; of loops "mixed", "square_root" or, if all states of the batch were solved so, "plain".
///
/// Of models with loops, else None: ``closure_residual``, ``velocity_residual``: how far the state is off the closures,
/// largest of m and rad, m/s and rad/s. ``smallest_pivot``: the weakest closed direction over the scale of its loop;
/// ``error_estimate``: relative error to expect of it, rounding over that pivot. Floats, or arrays of the batch axes.
/// ``rank``: independent closure rows, int or array. ``near_singular``: bool or array. Of a single state: ``redundant``, the
/// directions that others imply; ``inconsistency``, the one of them that contradicts the others most, None if they agree.
#[pyclass(frozen, get_all, module = "phipsi")]
pub struct ForwardInfo {
    /// Backward error, float or array.
    pub backward_error: Py<PyAny>,
    /// The hinge that loses most digits.
    pub worst_hinge: Option<Py<WorstHinge>>,
    /// The form that ran.
    pub form: &'static str,
    /// Residual of the positions.
    pub closure_residual: Option<Py<PyAny>>,
    /// Residual of the velocities.
    pub velocity_residual: Option<Py<PyAny>>,
    /// Weakest pivot.
    pub smallest_pivot: Option<Py<PyAny>>,
    /// Rounding over the weakest pivot.
    pub error_estimate: Option<Py<PyAny>>,
    /// Independent rows.
    pub rank: Option<Py<PyAny>>,
    /// A pivot below 1e-6, or no clear gap.
    pub near_singular: Option<Py<PyAny>>,
    /// Directions that others imply.
    pub redundant: Option<Vec<String>>,
    /// The one that contradicts the others most.
    pub inconsistency: Option<String>,
}

#[pymethods]
impl ForwardInfo {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let error = self.backward_error.bind(py).repr()?;
        let hinge = self.worst_hinge.as_ref().map_or("None".into(), |h| h.get().__repr__());
        Ok(format!("ForwardInfo(backward_error={error}, worst_hinge={hinge}, form='{}')", self.form))
    }
}

#[pymethods]
impl Model {
    /// Accelerations of generalized forces.
    ///
    /// θ̈ = (I − HψK)* D⁻¹ (I − HψK) (T − C), in O(nv) without the mass matrix. Pure mechanics: ``tau`` is the whole
    /// generalized force; damping and friction of the file act in ``simulate`` and ``passive_forces`` only.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v, tau : (…, nv); N·m or N.
    /// wrenches : {body: (…, 6)}, moment then force on the body, at its frame's origin, in its axes.
    /// form : how rounding is dealt with. "plain": the recursion itself, which loses digits where heavy bodies hang on light
    ///     ones; "refined": corrected once; "square_root": on factors of the inertias, loses none; "double_double": 32 digits;
    ///     "auto": the cheapest that is good, which is measured once per model.
    /// info : True returns (result, ForwardInfo).
    /// closure_motion : {name: (3, rows)}, positions γ, velocities γ̇ and accelerations γ̈ that closures are given at this instant,
    ///     in the order of their rows; others rest.
    ///
    /// Models with closures or couplings move with their loops closed (``close_loop``). "auto" is the mixed form then, or, where heavy
    /// bodies hang on light ones, "square_root"; "plain" squares the rows of the loops, and solves states in the mixed form where squares
    /// do not tell the rank; the other two are for trees.
    ///
    /// Returns
    /// -------
    /// (…, nv), rad/s² or m/s²: the componentwise time derivative of v.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError at a joint without articulated inertia. Warns, RuntimeWarning, where "auto" finds no form
    /// that is good.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(1)
    /// >>> a, info = m.forward_dynamics(q, v, [0.0, 0.0], info=True)
    /// >>> bool(info.backward_error < 1e-14)
    /// True
    /// >>> info.worst_hinge.joint, info.form
    /// ('shoulder', 'plain')
    #[pyo3(signature = (q, v, tau, wrenches = None, form = "auto", info = false, closure_motion = None))]
    #[allow(clippy::too_many_arguments)]
    fn forward_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
        wrenches: Option<&Bound<'py, PyAny>>,
        form: &str,
        info: bool,
        closure_motion: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let Some(form) = Form::from_name(form) else {
            return Err(choice_error(py, "form", form, &Form::ALL.map(Form::name)));
        };
        let compiled = self.compiled();
        if compiled.has_loops() || closure_motion.is_some() {
            let loads = (wrenches, closure_motion);
            return self.closed_forward_dynamics(py, &compiled, [q, v, tau], loads, form, info);
        }
        let layout = &compiled.layout;
        let (mut q, mut v) = (compiled.lent_q(q, "q")?, compiled.lent_v(v, "v")?);
        let (mut tau, mut wrenches) = (compiled.lent_v(tau, "tau")?, compiled.wrenches(wrenches)?);
        let own = [&mut q, &mut v, &mut tau].map(|lent| &mut lent.argument);
        let batch = Batch::of(py, own.into_iter().chain(&mut wrenches.arguments))?;
        let nv = layout.nv();
        let form = compiled.form(py, form)?;
        let kernel = kernels::ForwardDynamics { layout, loaded: &wrenches.bodies };
        if form == Form::Plain && !info {
            let arguments = (&[&q, &v, &tau][..], &wrenches.arguments[..]);
            let out = batch.run_lent(py, &compiled, &kernel, arguments, nv)?;
            return compiled.result(py, &batch, out, Names::Velocity("acceleration"), &[nv]);
        }
        let (q, v) = (q.settled(py, &compiled)?, v.settled(py, &compiled)?);
        let tau = tau.settled(py, &compiled)?;
        let out = if form == Form::Plain {
            batch.run(py, &kernel, &wrenches.inputs([&q, &v, &tau]), nv)
        } else {
            batch.each(
                py,
                nv,
                || (FormForwardDynamics::new(&compiled.model, layout, form), wrenches.workspace()),
                |(work, scratch), i, out| {
                    let loads = wrenches.at(i, scratch);
                    Ok(work.run(layout, q.at(i), v.at(i), tau.at(i), loads, out)?)
                },
            )
        };
        if !info {
            return compiled.result(py, &batch, out, Names::Velocity("acceleration"), &[nv]);
        }
        let accelerations =
            out.map_err(|e| compiled.failure(py, &batch, e, Names::Velocity("acceleration")))?;
        // Per state: backward error, degree of freedom of the worst hinge (−1: none), its ratio.
        let judged = batch.each(
            py,
            3,
            || wrenches.workspace(),
            |scratch, i, out| {
                let loads = wrenches.at(i, scratch);
                let a = &accelerations[i * nv..(i + 1) * nv];
                let found = forward_info(layout, q.at(i), v.at(i), tau.at(i), loads, a)?;
                out.copy_from_slice(&[found.backward_error, -1.0, 0.0]);
                if let Some(worst) = found.worst_hinge
                    && let Ok(k) = compiled.model.find_joint(&worst.joint)
                {
                    out[1] = (compiled.model.v_offset(k) + worst.component) as f64;
                    out[2] = worst.ratio;
                }
                Ok(())
            },
        );
        let judged =
            judged.map_err(|e| compiled.failure(py, &batch, e, Names::Other("a measure of the result")))?;
        let result = (
            batch.array(py, accelerations, &[nv])?,
            Py::new(py, forward_judgement(py, &compiled, &batch, &judged, form.name())?)?,
        );
        result.into_bound_py_any(py)
    }
    /// Generalized forces of a motion (Newton–Euler), O(nv).
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v, a : (…, nv).
    /// wrenches : {body: (…, 6)}, external, as in ``forward_dynamics``.
    ///
    /// Returns
    /// -------
    /// (…, nv), N·m or N.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError for numbers that are not finite; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(1)
    /// >>> tau = m.inverse_dynamics(q, v, [1.0, 2.0])
    /// >>> bool(np.allclose(m.forward_dynamics(q, v, tau), [1.0, 2.0]))
    /// True
    #[pyo3(signature = (q, v, a, wrenches = None))]
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        a: &Bound<'py, PyAny>,
        wrenches: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let layout = &compiled.layout;
        let (mut q, mut v) = (compiled.lent_q(q, "q")?, compiled.lent_v(v, "v")?);
        let (mut a, mut wrenches) = (compiled.lent_v(a, "a")?, compiled.wrenches(wrenches)?);
        let own = [&mut q, &mut v, &mut a].map(|lent| &mut lent.argument);
        let batch = Batch::of(py, own.into_iter().chain(&mut wrenches.arguments))?;
        let kernel = kernels::InverseDynamics { layout, loaded: &wrenches.bodies };
        let arguments = (&[&q, &v, &a][..], &wrenches.arguments[..]);
        let out = batch.run_lent(py, &compiled, &kernel, arguments, layout.nv())?;
        compiled.result(py, &batch, out, Names::Velocity("generalized force"), &[layout.nv()])
    }
    /// The mass matrix M(q), full and symmetric: of the tree, with closures and couplings open.
    ///
    /// ``q``: (…, nq). Returns (…, nv, nv), kg·m², kg·m or kg.
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.mass_matrix(np.zeros((5, 2))).shape
    /// (5, 2, 2)
    fn mass_matrix<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let (nv, batch) = (layout.nv(), Batch::of(py, [&mut q])?);
        let out = batch.run(py, &kernels::MassMatrix { layout }, &[q.input()], nv * nv);
        compiled.result(py, &batch, out, Names::Columns("mass matrix"), &[nv, nv])
    }
    /// The inverse of the mass matrix, full and symmetric, without forming M: O(nv depth²).
    ///
    /// ``q``: (…, nq). Returns (…, nv, nv).
    ///
    /// Raises ArgumentError; NumericalError at a joint without articulated inertia; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q = [0.1, 0.2]
    /// >>> bool(np.allclose(m.mass_matrix(q) @ m.mass_matrix_inverse(q), np.eye(2)))
    /// True
    fn mass_matrix_inverse<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let (nv, batch) = (layout.nv(), Batch::of(py, [&mut q])?);
        let out = batch.run(py, &kernels::MassMatrixInverse { layout }, &[q.input()], nv * nv);
        compiled.result(py, &batch, out, Names::Columns("inverse of the mass matrix"), &[nv, nv])
    }
    /// M(q) x in O(nv), without the matrix.
    ///
    /// ``q``: (…, nq); ``x``: (…, nv). Returns (…, nv).
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, x = m.random_state(2)
    /// >>> bool(np.allclose(m.multiply_by_mass_matrix(q, x), m.mass_matrix(q) @ x))
    /// True
    fn multiply_by_mass_matrix<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q, mut x) = (&compiled.layout, compiled.q(q, "q")?, compiled.v(x, "x")?);
        let batch = Batch::of(py, [&mut q, &mut x])?;
        let kernel = kernels::InverseDynamics { layout: compiled.weightless(), loaded: &[] };
        let zero = vec![0.0; layout.nv()];
        let inputs = [q.input(), Input::same(&zero), x.input()];
        let out = batch.run(py, &kernel, &inputs, layout.nv());
        compiled.result(py, &batch, out, Names::Velocity("M x"), &[layout.nv()])
    }
    /// M(q)⁻¹ x in O(nv), without a matrix.
    ///
    /// ``q``: (…, nq); ``x``: (…, nv). Returns (…, nv).
    ///
    /// Raises ArgumentError; NumericalError at a joint without articulated inertia; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, x = m.random_state(2)
    /// >>> bool(np.allclose(m.solve_mass_matrix(q, m.multiply_by_mass_matrix(q, x)), x))
    /// True
    fn solve_mass_matrix<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q, mut x) = (&compiled.layout, compiled.q(q, "q")?, compiled.v(x, "x")?);
        let batch = Batch::of(py, [&mut q, &mut x])?;
        let kernel = kernels::MassMatrixSolution { layout };
        let out = batch.run(py, &kernel, &[q.input(), x.input()], layout.nv());
        compiled.result(py, &batch, out, Names::Velocity("M⁻¹ x"), &[layout.nv()])
    }
    /// Inverse dynamics at a = 0: Coriolis, centrifugal and gravity forces.
    ///
    /// ``q``: (…, nq); ``v``: (…, nv). Returns (…, nv), N·m or N.
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(3)
    /// >>> bool(np.array_equal(m.bias_forces(q, v), m.inverse_dynamics(q, v, [0, 0])))
    /// True
    fn bias_forces<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v, "v")?);
        let (batch, layout) = (Batch::of(py, [&mut q, &mut v])?, &compiled.layout);
        let zero = vec![0.0; layout.nv()];
        let kernel = kernels::InverseDynamics { layout, loaded: &[] };
        let inputs = [q.input(), v.input(), Input::same(&zero)];
        let out = batch.run(py, &kernel, &inputs, layout.nv());
        compiled.result(py, &batch, out, Names::Velocity("bias force"), &[layout.nv()])
    }
    /// The generalized forces that hold the mechanism at rest against gravity.
    ///
    /// ``q``: (…, nq). Returns (…, nv), N·m or N.
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.gravity = (0, 0, 0)
    /// >>> bool(np.all(m.gravity_forces([0.3, 0.4]) == 0))
    /// True
    fn gravity_forces<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let batch = Batch::of(py, [&mut q])?;
        let zero = vec![0.0; layout.nv()];
        let kernel = kernels::InverseDynamics { layout, loaded: &[] };
        let inputs = [q.input(), Input::same(&zero), Input::same(&zero)];
        let out = batch.run(py, &kernel, &inputs, layout.nv());
        compiled.result(py, &batch, out, Names::Velocity("gravity force"), &[layout.nv()])
    }
    /// Damping and friction forces of the file's joints, as they act in ``simulate``: −c v − f tanh(v/s), s = 0.01.
    ///
    /// ``q``: (…, nq); ``v``: (…, nv). Returns (…, nv), N·m or N.
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.passive_forces([0.0, 0.0], [1.0, 1.0])
    /// array([-0.1,  0. ])
    fn passive_forces<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v, "v")?);
        let (batch, nv) = (Batch::of(py, [&mut q, &mut v])?, compiled.model.nv());
        let out = batch.each(
            py,
            nv,
            || (),
            |(), i, out| {
                out.copy_from_slice(&passive_forces(&compiled.model, v.at(i)));
                Ok(())
            },
        );
        compiled.result(py, &batch, out, Names::Velocity("passive force"), &[nv])
    }
    /// The wrench on every body from its parent, across its joint; fixed joints included.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v, a : (…, nv).
    /// wrenches : {body: (…, 6)}, external, as in ``forward_dynamics``.
    ///
    /// Returns
    /// -------
    /// (…, n_bodies, 6), rows as ``body_names``: moment, then force; at the body frame's origin, body axes; N·m, N.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError for numbers that are not finite; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.joint_reactions([0, 0], [0, 0], [0, 0]).shape
    /// (3, 6)
    #[pyo3(signature = (q, v, a, wrenches = None))]
    fn joint_reactions<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        a: &Bound<'py, PyAny>,
        wrenches: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let Compiled { model, layout, .. } = &*compiled;
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v, "v")?);
        let (mut a, mut wrenches) = (compiled.v(a, "a")?, compiled.wrenches(wrenches)?);
        let batch = Batch::of(py, [&mut q, &mut v, &mut a].into_iter().chain(&mut wrenches.arguments))?;
        let kernel = kernels::JointReactions { model, layout, loaded: &wrenches.bodies };
        let out = batch.run(py, &kernel, &wrenches.inputs([&q, &v, &a]), 6 * model.len());
        compiled.result(py, &batch, out, Names::Other("joint reaction"), &[model.len(), 6])
    }
}

/// The info of a batch from (backward error, degree of freedom of the worst hinge, ratio) per state.
pub fn forward_judgement(
    py: Python<'_>,
    compiled: &Compiled,
    batch: &Batch,
    judged: &[f64],
    form: &'static str,
) -> PyResult<ForwardInfo> {
    let errors = judged.chunks(3).map(|x| x[0]).collect();
    let worst = judged.chunks(3).enumerate().filter(|(_, x)| x[1] >= 0.0);
    let worst = worst.min_by(|(_, a), (_, b)| a[2].total_cmp(&b[2])).map(|(state, x)| {
        let (joint, component) = compiled.layout.joint_of_velocity(x[1] as usize);
        Py::new(py, WorstHinge { joint: joint.into(), component, ratio: x[2], state: batch.place(state) })
    });
    Ok(ForwardInfo {
        backward_error: batch.array(py, errors, &[])?.unbind(),
        worst_hinge: worst.transpose()?,
        form,
        closure_residual: None,
        velocity_residual: None,
        smallest_pivot: None,
        error_estimate: None,
        rank: None,
        near_singular: None,
        inconsistency: None,
        redundant: None,
    })
}
