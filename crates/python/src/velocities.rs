//! Methods of `Model` about the mass matrix as a metric: its determinant, and velocities of equipartition.

use crate::batch::Batch;
use crate::errors::{Field, argument_error};
use crate::model::{Model, Names};
use phipsi::molecule::{Deviates, sample_velocities};
use phipsi::recursion::articulated_sweep::SolveWorkspace;
use phipsi::recursion::batch::kernels;
use phipsi::recursion::{ArticulatedSweep, DynamicsError, Layout};
use pyo3::prelude::*;

/// The factors of M at a configuration, in the workspace of the first.
fn factored<'a>(
    factors: &'a mut Option<ArticulatedSweep<f64>>,
    layout: &Layout<f64>,
    q: &[f64],
) -> Result<&'a ArticulatedSweep<f64>, DynamicsError> {
    match factors {
        Some(factors) => {
            factors.update(layout, q)?;
            Ok(factors)
        }
        None => Ok(factors.insert(ArticulatedSweep::new(layout, q)?)),
    }
}

#[pymethods]
impl Model {
    /// ln det M(q): the sum of the logarithms of the articulated joint inertias.
    ///
    /// ``q``: (…, nq). Returns (…), a float without batch axes.
    ///
    /// Raises ArgumentError; NumericalError at a joint without articulated inertia; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(1)
    /// >>> bool(np.isclose(m.log_determinant(q), np.linalg.slogdet(m.mass_matrix(q))[1]))
    /// True
    fn log_determinant<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let batch = Batch::of(py, [&mut q])?;
        let out = batch.each(
            py,
            1,
            || None,
            |factors, i, out| {
                out[0] = factored(factors, layout, q.at(i))?.log_determinant();
                Ok(())
            },
        );
        compiled.result(py, &batch, out, Names::Other("ln det M"), &[])
    }
    /// All derivatives of ln det M(q), analytic, in O(nv).
    ///
    /// 2 tr(Υ⁺ S~ P⁺) for every degree of freedom. −½ kT times it is the force of Fixman's potential +½ kT ln det M.
    ///
    /// ``q``: (…, nq). Returns (…, nv): one for each component of an increment of ``integrate``; 1/rad or 1/m.
    ///
    /// Raises ArgumentError; NumericalError at a joint without articulated inertia; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, h = np.array([0.3, 0.8]), np.array([0.0, 1e-6])
    /// >>> slope = (m.log_determinant(m.integrate(q, h)) - m.log_determinant(m.integrate(q, -h))) / 2e-6
    /// >>> bool(np.isclose(m.log_determinant_gradient(q)[1], slope))
    /// True
    fn log_determinant_gradient<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let (nv, batch) = (layout.nv(), Batch::of(py, [&mut q])?);
        let out = batch.run(py, &kernels::LogDeterminantGradient { layout }, &[q.input()], nv);
        compiled.result(py, &batch, out, Names::Velocity("derivative of ln det M"), &[nv])
    }
    /// Velocities of thermal equilibrium: normal, with covariance kT M(q)⁻¹.
    ///
    /// v = √kT (I − HψK)* D^(−½) ξ with independent deviates ξ, in O(nv): each direction of the mass metric gets ½ kT of kinetic
    /// energy in the mean.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). kT : temperature times Boltzmann's constant, J; not negative.
    /// seed : each state of the batch has a stream of it of its own, by its place in the batch.
    ///
    /// Returns
    /// -------
    /// (…, nv).
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError at a joint without articulated inertia; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q = np.tile([0.3, 0.8], (10000, 1))
    /// >>> energy = m.kinetic_energy(q, m.sample_velocities(q, 2.0, seed=1))
    /// >>> bool(abs(energy.mean() - m.nv / 2 * 2.0) < 0.1)
    /// True
    #[pyo3(name = "sample_velocities", signature = (q, kT, seed))]
    #[allow(non_snake_case)]
    fn sample_velocities<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        kT: f64,
        seed: u64,
    ) -> PyResult<Bound<'py, PyAny>> {
        if !(kT >= 0.0 && kT.is_finite()) {
            let required = "a number that is not negative";
            let message = format!("`kT` is {kT}, but {required} is required");
            return Err(argument_error(py, "kT", Field::Number(kT), required.into(), &message, None));
        }
        let compiled = self.compiled();
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let (nv, batch) = (layout.nv(), Batch::of(py, [&mut q])?);
        let out = batch.each(
            py,
            nv,
            || (None, SolveWorkspace::<f64>::new(layout)),
            |(factors, workspace), i, out| {
                let factors = factored(factors, layout, q.at(i))?;
                let mut deviates = Deviates::stream(seed, i as u64);
                sample_velocities(layout, factors, kT, &mut deviates, workspace, out);
                Ok(())
            },
        );
        compiled.result(py, &batch, out, Names::Velocity("velocity"), &[nv])
    }
}
