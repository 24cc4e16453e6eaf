//! Methods of `Model` about free-flying systems.

use crate::batch::{Argument, Batch};
use crate::compiled::Names;
use crate::errors::{Failure, dynamics_error, exception};
use crate::model::Model;
use phipsi::freeflight::{FreeFlightError, SpaceJacobian, TwoSided, reactionless_basis};
use phipsi::recursion::DynamicsError;
use phipsi::spatial::Vec3;
use pyo3::prelude::*;

/// An error that does not depend on the state, as a Python exception.
fn free_flight_error(py: Python<'_>, error: &FreeFlightError) -> PyErr {
    match error {
        FreeFlightError::Dynamics(error) => dynamics_error(py, error, None),
        FreeFlightError::NotFree { .. } | FreeFlightError::Roots { .. } => {
            exception(py, "ModelError", &error.to_string(), vec![])
        }
        other => exception(py, "ArgumentError", &other.to_string(), vec![]),
    }
}

/// The failure of one state.
fn failure(error: FreeFlightError) -> Failure {
    match error {
        FreeFlightError::Dynamics(error) => error.into(),
        FreeFlightError::NoInertia { joint, pivot } => {
            DynamicsError::SingularHinge { joint, component: 0, inertia: pivot }.into()
        }
        // What depends on the model alone was refused before.
        _ => DynamicsError::NotFinite { index: 0, found: f64::NAN }.into(),
    }
}

#[pymethods]
impl Model {
    /// The inertia that a wrench on a body feels, every joint free and the base floating, for all bodies from one pass of the two
    /// sequences of base-invariant dynamics, O(n).
    ///
    /// ``q``: (…, nq). Returns (…, n_bodies, 6, 6), rows as ``body_names``; angular first, about the body frame's origin, body axes:
    /// acceleration = inverse · wrench.
    ///
    /// Raises ArgumentError; ModelError if the base does not float; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf", base="free")
    /// >>> m.articulated_inertias(m.neutral()).shape
    /// (3, 6, 6)
    fn articulated_inertias<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let batch = Batch::of(py, [&mut q])?;
        let bodies = compiled.model.len();
        let work = TwoSided::new(layout).map_err(|e| free_flight_error(py, &e))?;
        let out = batch.each(
            py,
            36 * bodies,
            || work.clone(),
            |work, state, out| {
                work.set_position(layout, q.at(state)).map_err(failure)?;
                for (body, out) in out.chunks_exact_mut(36).enumerate() {
                    let rows = work.inertia(layout, body).map(|i| i.to_rows()).unwrap_or_default();
                    out.copy_from_slice(rows.as_flattened());
                }
                Ok(())
            },
        );
        compiled.result(py, &batch, out, Names::Other("inertia"), &[bodies, 6, 6])
    }
    /// The space (generalised) Jacobian: (ω, velocity of the point) from the joint rates alone while the total momentum is zero.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). body : its name.
    /// point : (…, 3), m, in the body's frame; None is its origin.
    ///
    /// Returns
    /// -------
    /// (…, 6, nv − 6), angular rows first, world axes; columns in the order of v without the base's six.
    ///
    /// Raises
    /// ------
    /// ArgumentError; ModelError if the base does not float or is not the only root; NumericalError.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf", base="free")
    /// >>> m.space_jacobian(m.neutral(), "lower").shape
    /// (6, 2)
    #[pyo3(signature = (q, body, point = None))]
    fn space_jacobian<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        body: &str,
        point: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let body = compiled.body(py, body)?;
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let mut point = point.map(|p| compiled.point(p, "point")).transpose()?;
        let batch = Batch::of(py, std::iter::once(&mut q).chain(&mut point))?;
        let work = SpaceJacobian::new(layout).map_err(|e| free_flight_error(py, &e))?;
        let columns = layout.nv() - 6;
        let at = |point: &Argument, state: usize| {
            let x = point.at(state);
            Vec3([x[0], x[1], x[2]])
        };
        let out = batch.each(
            py,
            6 * columns,
            || work.clone(),
            |work, state, out| {
                let point = point.as_ref().map(|p| at(p, state));
                work.run(layout, q.at(state), body, point, out).map_err(failure)
            },
        );
        compiled.result(py, &batch, out, Names::Other("space Jacobian"), &[6, columns])
    }
    /// An orthonormal basis of the joint motions that leave a floating base at rest: the null space of the coupling between base
    /// and joints.
    ///
    /// ``q``: (nq,). Returns (nv − 6, dimension): columns of joint rates, in the order of v without the base's six.
    ///
    /// Raises ArgumentError; ModelError if the base does not float or is not the only root.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf", base="free")
    /// >>> m.reactionless_basis(m.neutral()).shape          # two hinges about y: three momenta in their plane
    /// (2, 0)
    fn reactionless_basis<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let mut q = compiled.q(q, "q")?;
        if !q.is_single() {
            let message = "`q` has batch axes, but bases of different configurations may differ in size: call once for each";
            return Err(exception(py, "ArgumentError", message, vec![]));
        }
        let batch = Batch::of(py, [&mut q])?;
        let basis = reactionless_basis(&compiled.layout, q.at(0)).map_err(|e| free_flight_error(py, &e))?;
        let (rows, columns) = (compiled.layout.nv() - 6, basis.vectors.len());
        let numbers = (0..rows).flat_map(|r| basis.vectors.iter().map(move |v| v[r])).collect();
        batch.array(py, numbers, &[rows, columns])
    }
}
