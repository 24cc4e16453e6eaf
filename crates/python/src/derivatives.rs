//! Methods of `Model`: derivatives of forward and inverse dynamics.

use crate::batch::Batch;
use crate::compiled::{Compiled, Names};
use crate::errors::Failure;
use crate::model::Model;
use phipsi::recursion::batch::kernels;
use pyo3::prelude::*;

/// Three matrices.
type Matrices<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

#[pymethods]
impl Model {
    /// Derivatives of the accelerations of ``forward_dynamics``, analytic, at the accelerations of (q, v, tau).
    ///
    /// −M⁻¹ times the derivatives of inverse dynamics; M⁻¹ from the articulated inertias, not from M. In each derivative the
    /// other arguments stay as numbers; wrenches stay in their bodies' axes.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v, tau : (…, nv); N·m or N.
    /// wrenches : {body: (…, 6)}, moment then force on the body, at its frame's origin, in its axes.
    ///
    /// Returns
    /// -------
    /// d_dq, d_dv, d_dtau : (…, nv, nv); row i is the acceleration i. d_dq has nv columns, one for each component of an increment
    /// of ``integrate``; d_dtau is the inverse of the mass matrix.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError at a joint without articulated inertia; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(1)
    /// >>> d_dq, d_dv, d_dtau = m.forward_dynamics_derivatives(q, v, [1.0, 0.5])
    /// >>> h = np.array([1e-6, 0.0])
    /// >>> after = m.forward_dynamics(m.integrate(q, h), v, [1.0, 0.5])
    /// >>> before = m.forward_dynamics(m.integrate(q, -h), v, [1.0, 0.5])
    /// >>> bool(np.allclose(d_dq[:, 0], (after - before) / 2e-6))
    /// True
    #[pyo3(signature = (q, v, tau, wrenches = None))]
    fn forward_dynamics_derivatives<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
        wrenches: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Matrices<'py>> {
        let compiled = self.compiled();
        let layout = &compiled.layout;
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v, "v")?);
        let (mut tau, mut wrenches) = (compiled.v(tau, "tau")?, compiled.wrenches(wrenches)?);
        let batch = Batch::of(py, [&mut q, &mut v, &mut tau].into_iter().chain(&mut wrenches.arguments))?;
        let square = layout.nv() * layout.nv();
        let kernel = kernels::ForwardDynamicsDerivatives { layout, loaded: &wrenches.bodies };
        let out = batch.run(py, &kernel, &wrenches.inputs([&q, &v, &tau]), 3 * square);
        matrices(&compiled, py, &batch, out, "derivative of an acceleration")
    }
    /// Derivatives of the generalized forces of ``inverse_dynamics``, analytic.
    ///
    /// In each derivative the other arguments stay as numbers; wrenches stay in their bodies' axes.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v, a : (…, nv).
    /// wrenches : {body: (…, 6)}, moment then force on the body, at its frame's origin, in its axes.
    ///
    /// Returns
    /// -------
    /// d_dq, d_dv, d_da : (…, nv, nv); row i is the force i. d_dq has nv columns, one for each component of an increment of
    /// ``integrate``; d_da is the mass matrix.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError for numbers that are not finite; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(1)
    /// >>> d_dq, d_dv, d_da = m.inverse_dynamics_derivatives(q, v, [1.0, 0.5])
    /// >>> bool(np.allclose(d_da, m.mass_matrix(q)))
    /// True
    #[pyo3(signature = (q, v, a, wrenches = None))]
    fn inverse_dynamics_derivatives<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        a: &Bound<'py, PyAny>,
        wrenches: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Matrices<'py>> {
        let compiled = self.compiled();
        let layout = &compiled.layout;
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v, "v")?);
        let (mut a, mut wrenches) = (compiled.v(a, "a")?, compiled.wrenches(wrenches)?);
        let batch = Batch::of(py, [&mut q, &mut v, &mut a].into_iter().chain(&mut wrenches.arguments))?;
        let square = layout.nv() * layout.nv();
        let kernel = kernels::InverseDynamicsDerivatives { layout, loaded: &wrenches.bodies };
        let out = batch.run(py, &kernel, &wrenches.inputs([&q, &v, &a]), 3 * square);
        matrices(&compiled, py, &batch, out, "derivative of a generalized force")
    }
    /// The dynamics linearised about a state: δẋ = A δx + B δτ with x = (δq, δv).
    ///
    /// δq and δv are deviations from the motion through (q, v): δq = difference(q, q'), δv = v' − v. At rest, and for joints whose q
    /// are numbers, the upper rows of A are (0, I); ball, planar and free joints in motion add −ad(v), since increments are seen from
    /// a frame that turns.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v, tau : (…, nv); N·m or N.
    /// wrenches : {body: (…, 6)}, moment then force on the body, at its frame's origin, in its axes.
    ///
    /// Returns
    /// -------
    /// A, B : (…, 2 nv, 2 nv) and (…, 2 nv, nv).
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError at a joint without articulated inertia; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(1)
    /// >>> A, B = m.linearize(q, v, [1.0, 0.5])
    /// >>> d_dq, d_dv, d_dtau = m.forward_dynamics_derivatives(q, v, [1.0, 0.5])
    /// >>> bool(np.array_equal(A[2:], np.hstack([d_dq, d_dv]))), bool(np.array_equal(B[2:], d_dtau))
    /// (True, True)
    #[pyo3(signature = (q, v, tau, wrenches = None))]
    fn linearize<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
        wrenches: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let compiled = self.compiled();
        let layout = &compiled.layout;
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v, "v")?);
        let (mut tau, mut wrenches) = (compiled.v(tau, "tau")?, compiled.wrenches(wrenches)?);
        let batch = Batch::of(py, [&mut q, &mut v, &mut tau].into_iter().chain(&mut wrenches.arguments))?;
        let nv = layout.nv();
        let (square, width) = (4 * nv * nv, 6 * nv * nv);
        let kernel = kernels::Linearization { layout, loaded: &wrenches.bodies };
        let out = batch.run(py, &kernel, &wrenches.inputs([&q, &v, &tau]), width);
        let names = Names::Columns("linearised dynamics");
        let out = out.map_err(|e| compiled.failure(py, &batch, e, names))?;
        let states = || out.chunks_exact(width.max(1));
        let a = states().flat_map(|x| x[..square].iter().copied()).collect();
        let b = states().flat_map(|x| x[square..].iter().copied()).collect();
        Ok((batch.array(py, a, &[2 * nv, 2 * nv])?, batch.array(py, b, &[2 * nv, nv])?))
    }
}

/// The three matrices of every state, each as an array of its own.
fn matrices<'py>(
    compiled: &Compiled,
    py: Python<'py>,
    batch: &Batch,
    out: Result<Vec<f64>, (usize, Failure)>,
    quantity: &'static str,
) -> PyResult<Matrices<'py>> {
    let out = out.map_err(|e| compiled.failure(py, batch, e, Names::Columns(quantity)))?;
    let nv = compiled.layout.nv();
    let square = nv * nv;
    let part = |k: usize| {
        let mut own = Vec::with_capacity(out.len() / 3);
        for state in out.chunks_exact((3 * square).max(1)) {
            own.extend_from_slice(&state[k * square..(k + 1) * square]);
        }
        batch.array(py, own, &[nv, nv])
    };
    Ok((part(0)?, part(1)?, part(2)?))
}
