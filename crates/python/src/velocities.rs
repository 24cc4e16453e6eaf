//! Methods of `Model` about the mass matrix as a metric: its determinant, velocities of equipartition, and diagonal velocities.

use crate::batch::Batch;
use crate::compiled::Names;
use crate::errors::{Field, argument_error};
use crate::model::Model;
use phipsi::molecule::{Deviates, sample_velocities};
use phipsi::recursion::articulated_sweep::SolveWorkspace;
use phipsi::recursion::batch::kernels;
use phipsi::recursion::flexible;
use phipsi::recursion::{ArticulatedSweep, DiagonalDynamics, DiagonalVelocity, DynamicsError, Layout};
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
                out[0] = match layout.is_flexible() {
                    true => flexible::log_determinant(layout, q.at(i))?,
                    false => factored(factors, layout, q.at(i))?.log_determinant(),
                };
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
        let out = match layout.is_flexible() {
            true => batch.each(
                py,
                nv,
                || (),
                |(), i, out| {
                    out.copy_from_slice(&flexible::log_determinant_gradient(layout, q.at(i))?);
                    Ok(())
                },
            ),
            false => batch.run(py, &kernels::LogDeterminantGradient { layout }, &[q.input()], nv),
        };
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
    /// Velocities in which the mass matrix is diagonal: η = (I + HφK)* v, or ν = D^½ η with the kinetic energy ½ ν·ν; paper 2 (4.16).
    ///
    /// ``q``: (…, nq). ``v``: (…, nv). ``normalized``: ν, else η. Cost O(n) a state.
    ///
    /// Returns (…, nv).
    ///
    /// Raises ArgumentError; NumericalError at a joint without articulated inertia; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(1)
    /// >>> nu = m.diagonal_velocity(q, v)
    /// >>> bool(np.isclose(nu @ nu / 2, m.kinetic_energy(q, v)))
    /// True
    /// >>> bool(np.allclose(m.joint_velocity(q, nu), v))
    /// True
    #[pyo3(signature = (q, v, normalized = true))]
    fn diagonal_velocity<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        normalized: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.diagonal(py, (q, "q"), (v, "v"), |work, layout, q, v, out| {
            work.diagonal(layout, q, v, kind(normalized), out)
        })
    }
    /// Joint velocities of diagonal ones: the inverse of ``diagonal_velocity``.
    ///
    /// ``q``: (…, nq). ``nu``: (…, nv), η if not ``normalized``. Returns (…, nv). Raises as ``diagonal_velocity``.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.joint_velocity([0.3, 0.4], [0.0, 0.0])
    /// array([0., 0.])
    #[pyo3(signature = (q, nu, normalized = true))]
    fn joint_velocity<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        nu: &Bound<'py, PyAny>,
        normalized: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.diagonal(py, (q, "q"), (nu, "nu"), |work, layout, q, nu, out| {
            work.joint_velocity(layout, q, nu, kind(normalized), out)
        })
    }
    /// The Coriolis term of the diagonal equations of motion, of velocities alone; paper 2 (4.17). It does no work: ν·C = 0.
    ///
    /// ``q``: (…, nq). ``nu``: (…, nv), η if not ``normalized``. Returns (…, nv). Raises as ``diagonal_velocity``.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, nu = m.random_state(1)
    /// >>> bool(abs(nu @ m.diagonal_coriolis(q, nu)) < 1e-14)
    /// True
    #[pyo3(signature = (q, nu, normalized = true))]
    fn diagonal_coriolis<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        nu: &Bound<'py, PyAny>,
        normalized: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.diagonal(py, (q, "q"), (nu, "nu"), |work, layout, q, nu, out| {
            work.coriolis(layout, q, nu, kind(normalized), out)
        })
    }
    /// Equations of motion in diagonal velocities: ν̇ = ε_T − C, weight included; paper 2 (4.17).
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). nu : (…, nv), η if not ``normalized``. tau : (…, nv), generalized forces.
    ///
    /// Returns
    /// -------
    /// v, rate : (…, nv) each: the joint velocities, and the time derivative of ν or of η.
    ///
    /// Raises
    /// ------
    /// As ``diagonal_velocity``.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(1)
    /// >>> nu, h = m.diagonal_velocity(q, v), 1e-6
    /// >>> same, rate = m.diagonal_dynamics(q, nu, [0.3, -0.2])
    /// >>> a = m.forward_dynamics(q, v, [0.3, -0.2])
    /// >>> later, sooner = (m.diagonal_velocity(m.integrate(q, s * v), v + s * a) for s in (h, -h))
    /// >>> bool(np.allclose(same, v) and np.allclose((later - sooner) / (2 * h), rate))
    /// True
    #[pyo3(signature = (q, nu, tau, normalized = true))]
    fn diagonal_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        nu: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
        normalized: bool,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let compiled = self.compiled();
        let layout = &compiled.layout;
        let (mut q, mut nu, mut tau) = (compiled.q(q, "q")?, compiled.v(nu, "nu")?, compiled.v(tau, "tau")?);
        let (nv, batch) = (layout.nv(), Batch::of(py, [&mut q, &mut nu, &mut tau])?);
        let out = batch.each(
            py,
            2 * nv,
            || DiagonalDynamics::<f64>::new(layout),
            |work, i, out| {
                let (v, rate) = out.split_at_mut(nv);
                work.run(layout, q.at(i), nu.at(i), tau.at(i), None, kind(normalized), v, rate)?;
                Ok(())
            },
        );
        let names = Names::Other("diagonal dynamics");
        let out = out.map_err(|e| compiled.failure(py, &batch, e, names))?;
        let half =
            |first: usize| out.chunks_exact(2 * nv.max(1)).flat_map(move |x| x[first..first + nv].to_vec());
        Ok((batch.array(py, half(0).collect(), &[nv])?, batch.array(py, half(nv).collect(), &[nv])?))
    }
}

fn kind(normalized: bool) -> DiagonalVelocity {
    if normalized { DiagonalVelocity::Normalized } else { DiagonalVelocity::Plain }
}

impl Model {
    /// One vector of nv numbers from q and another of nv, for every state.
    fn diagonal<'py>(
        &self,
        py: Python<'py>,
        q: (&Bound<'py, PyAny>, &'static str),
        v: (&Bound<'py, PyAny>, &'static str),
        run: impl Fn(
            &mut DiagonalDynamics<f64>,
            &Layout<f64>,
            &[f64],
            &[f64],
            &mut [f64],
        ) -> Result<(), DynamicsError>
        + Sync
        + Send,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q, mut v) = (&compiled.layout, compiled.q(q.0, q.1)?, compiled.v(v.0, v.1)?);
        let (nv, batch) = (layout.nv(), Batch::of(py, [&mut q, &mut v])?);
        let out = batch.each(
            py,
            nv,
            || DiagonalDynamics::<f64>::new(layout),
            |work, i, out| Ok(run(work, layout, q.at(i), v.at(i), out)?),
        );
        compiled.result(py, &batch, out, Names::Velocity("velocity"), &[nv])
    }
}
