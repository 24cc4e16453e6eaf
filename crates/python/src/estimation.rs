//! Methods of `Operators` about dynamics as estimation: filter, smoother, batch estimates, and the random field behind them.

use crate::batch::{Argument, Batch, array};
use crate::errors::{Failure, argument_error, exception};
use crate::operators::{Operator, Operators, operator_error};
use phipsi::model::Random;
use pyo3::prelude::*;

/// Most numbers of a call that draws.
const MOST_NUMBERS: usize = 1 << 28;

/// What the filter leaves, tip to base; paper 1 (9.7)–(9.10). Blocks as ``Operators.bodies``.
#[pyclass(frozen, get_all, module = "phipsi")]
pub struct Filtered {
    /// z = ψ K T: spatial forces estimated from the joints outboard, (…, 6 bodies).
    pub z: Py<PyAny>,
    /// ε = T − H z, (…, nv): white, with covariance D.
    pub innovation: Py<PyAny>,
    /// ν = D⁻¹ ε, (…, nv): accelerations if all inboard joints were locked.
    pub residual: Py<PyAny>,
    /// z⁺ = z + G ε, (…, 6 bodies).
    pub z_plus: Py<PyAny>,
}

/// What filter and smoother give; paper 1 (9.7)–(9.14). Blocks as ``Operators.bodies``.
#[pyclass(frozen, get_all, module = "phipsi")]
pub struct Smoothed {
    /// α⁺ = E_φ* α: what the parent's motion gives each body, (…, 6 bodies).
    pub alpha_plus: Py<PyAny>,
    /// α = ψ* H* ν: spatial accelerations, (…, 6 bodies).
    pub alpha: Py<PyAny>,
    /// θ̈ = ν − K* α = 𝓜⁻¹ T, (…, nv).
    pub acceleration: Py<PyAny>,
    /// f = z + P α: spatial forces, the batch estimate 𝒢 T, (…, 6 bodies).
    pub force: Py<PyAny>,
    /// What the filter left.
    pub filtered: Py<Filtered>,
}

/// Draws from the random field; paper 1 (5.1)–(5.4).
#[pyclass(frozen, get_all, module = "phipsi")]
#[allow(non_snake_case)]
pub struct FieldSamples {
    /// W ~ N(0, M), (count, 6 bodies).
    pub W: Py<PyAny>,
    /// X = φ W, (count, 6 bodies): covariance S.
    pub X: Py<PyAny>,
    /// T = H X, (count, nv): covariance 𝓜.
    pub T: Py<PyAny>,
}

impl Operators {
    /// Parts of a vector result of every state of `tau`, in this order.
    fn estimated<'py, const N: usize>(
        &self,
        py: Python<'py>,
        tau: &Bound<'py, PyAny>,
        parts: [usize; N],
        estimate: impl Fn(&[f64]) -> Result<Vec<f64>, Failure> + Sync + Send,
    ) -> PyResult<[Py<PyAny>; N]> {
        let nv = self.ops.joint_space().dimension();
        let meaning = "joint forces without bias forces, one number per degree of freedom, nv";
        let mut tau = Argument::read(tau, "tau", &[nv], meaning, &|i| format!("degree of freedom {i}"))?;
        let batch = Batch::of(py, [&mut tau])?;
        let size = parts.iter().sum();
        let run = |(): &mut (), state: usize, out: &mut [f64]| -> Result<(), Failure> {
            out.copy_from_slice(&estimate(tau.at(state))?);
            Ok(())
        };
        let all = batch.each(py, size, || (), run).map_err(|(state, failure)| {
            let fields = vec![("state", batch.place(state).map(crate::errors::Field::Tuple))];
            exception(py, "NumericalError", &format!("estimate: {failure:?}"), fields)
        })?;
        let mut arrays = std::array::from_fn(|_| py.None());
        let mut first = 0;
        for (array, part) in arrays.iter_mut().zip(parts) {
            let columns = all.chunks_exact(size.max(1)).flat_map(|row| row[first..first + part].to_vec());
            *array = batch.array(py, columns.collect(), &[part])?.unbind();
            first += part;
        }
        Ok(arrays)
    }
    fn sizes(&self) -> (usize, usize) {
        (self.ops.state_space().dimension(), self.ops.joint_space().dimension())
    }
    /// Refuses counts of samples that no memory holds.
    fn check_count(&self, py: Python<'_>, count: usize) -> PyResult<()> {
        let (state, joints) = self.sizes();
        let numbers = count.checked_mul(2 * state + joints);
        if count > 0 && numbers.is_some_and(|n| n <= MOST_NUMBERS) {
            return Ok(());
        }
        let most = MOST_NUMBERS / (2 * state + joints).max(1);
        let required = format!("1 to {most}");
        let message = format!("`count` is {count}, but {required} is required");
        let found = crate::errors::Field::Index(count);
        Err(argument_error(py, "count", found, required.into(), &message, Some("draw in several calls")))
    }
}

#[pymethods]
impl Operators {
    /// The Kalman filter from the tips to the base: z = ψ K T, ε = T − H z, ν = D⁻¹ ε, z⁺ = z + G ε.
    ///
    /// ``tau``: (…, nv), what is left after bias forces. Cost O(n) a state.
    ///
    /// Raises ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> ops = phipsi.operators(phipsi.Model.from_urdf("arm.urdf"), [0.3, 0.4])
    /// >>> ops.filter([1.0, 2.0]).innovation.round(6)
    /// array([-5.093604,  2.      ])
    fn filter<'py>(&self, py: Python<'py>, tau: &Bound<'py, PyAny>) -> PyResult<Filtered> {
        let (state, nv) = self.sizes();
        let parts = [state, nv, nv, state];
        let [z, innovation, residual, z_plus] = self.estimated(py, tau, parts, |tau| {
            let x = self.ops.filter(tau)?;
            Ok([x.z, x.epsilon, x.nu, x.z_plus].concat())
        })?;
        Ok(Filtered { z, innovation, residual, z_plus })
    }
    /// Filter, then the Bryson–Frazier smoother back: α = ψ* H* ν, θ̈ = ν − K* α, f = z + P α.
    ///
    /// ``tau``: (…, nv), what is left after bias forces. Cost O(n) a state.
    ///
    /// Raises ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> ops = phipsi.operators(m, [0.3, 0.4])
    /// >>> smoothed = ops.smooth([1.0, 2.0])
    /// >>> bool(np.allclose(m.mass_matrix([0.3, 0.4]) @ smoothed.acceleration, [1.0, 2.0]))
    /// True
    /// >>> bool(np.allclose(ops.batch_gain @ [1.0, 2.0], smoothed.force))
    /// True
    fn smooth<'py>(&self, py: Python<'py>, tau: &Bound<'py, PyAny>) -> PyResult<Smoothed> {
        let (state, nv) = self.sizes();
        let parts = [state, nv, nv, state, state, state, nv, state];
        let estimated = self.estimated(py, tau, parts, |tau| {
            let x = self.ops.filter(tau)?;
            let y = self.ops.smooth(&x)?;
            Ok([x.z, x.epsilon, x.nu, x.z_plus, y.alpha_plus, y.alpha, y.acceleration, y.f].concat())
        })?;
        let [z, innovation, residual, z_plus, alpha_plus, alpha, acceleration, force] = estimated;
        let filtered = Py::new(py, Filtered { z, innovation, residual, z_plus })?;
        Ok(Smoothed { alpha_plus, alpha, acceleration, force, filtered })
    }
    /// 𝒢 = S H* 𝓜⁻¹, the gain of the batch estimate of the spatial forces, f = 𝒢 T; paper 1 (7.2).
    #[getter]
    fn batch_gain(&self) -> Operator {
        Operator { expression: self.ops.batch_gain() }
    }
    /// 𝒫 = (I − 𝒢 H) S, the covariance of the error of the smoothed forces; paper 1 (7.5). H 𝒫 = 0.
    #[getter]
    fn smoothed_error_covariance(&self) -> Operator {
        Operator { expression: self.ops.smoothed_error_covariance() }
    }
    /// ψ M ψ*, the covariance of the error of the filtered forces; paper 1 Lemma 8.
    #[getter]
    fn filtered_error_covariance(&self) -> Operator {
        Operator { expression: self.ops.filtered_error_covariance() }
    }
    /// Q = M − M φ* H* 𝓜⁻¹ H φ M, the covariance of the error of the estimated inertial forces; paper 1 section 7.
    #[getter]
    fn inertial_force_error_covariance(&self) -> Operator {
        Operator { expression: self.ops.inertial_force_error_covariance() }
    }
    /// Draws from the random field: W ~ N(0, M) body by body, X = φ W, T = H X. The covariance of T is the mass matrix.
    ///
    /// ``count``: how many. ``seed``: the same draws each time. Cost O(n) a draw.
    ///
    /// Raises ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> T = phipsi.operators(m, [0.3, 0.4]).sample_field(20000, seed=1).T
    /// >>> bool(np.allclose(T.T @ T / 20000, m.mass_matrix([0.3, 0.4]), rtol=0.05))
    /// True
    fn sample_field(&self, py: Python<'_>, count: usize, seed: u64) -> PyResult<FieldSamples> {
        self.check_count(py, count)?;
        let (state, nv) = self.sizes();
        let [w, x, t] = py.detach(|| {
            let (field, mut random) = (self.ops.random_field(), Random::new(seed));
            let mut all = [state, state, nv].map(|size| Vec::with_capacity(count * size));
            for _ in 0..count {
                let sample = field.sample(&mut random);
                for (all, part) in all.iter_mut().zip([sample.W, sample.X, sample.T]) {
                    all.extend(part);
                }
            }
            all
        });
        let made = |data: Vec<f64>, size: usize| -> PyResult<Py<PyAny>> {
            Ok(array(py, data, vec![count, size])?.into_any().unbind())
        };
        Ok(FieldSamples { W: made(w, state)?, X: made(x, state)?, T: made(t, nv)? })
    }
    /// The mass matrix as a sample covariance: the mean of T T* over draws of the random field, and its expected error.
    ///
    /// ``count``: how many draws. ``seed``: the same draws each time. Cost O(n + nv²) a draw.
    ///
    /// Returns (estimate, error): (nv, nv), and √((‖𝓜‖² + (tr 𝓜)²)/count), the expected distance of the two in Frobenius' norm.
    ///
    /// Raises ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> estimate, error = phipsi.operators(m, [0.3, 0.4]).estimate_mass_matrix(10000, seed=1)
    /// >>> bool(np.linalg.norm(estimate - m.mass_matrix([0.3, 0.4])) < 4 * error)
    /// True
    fn estimate_mass_matrix<'py>(
        &self,
        py: Python<'py>,
        count: usize,
        seed: u64,
    ) -> PyResult<(Bound<'py, PyAny>, f64)> {
        self.check_count(py, count)?;
        let (_, nv) = self.sizes();
        let mass = self.ops.mass_matrix().dense().map_err(|e| operator_error(py, &e))?;
        let error = ((mass.norm_squared() + mass.trace().powi(2)) / count as f64).sqrt();
        let mean = py.detach(|| {
            let (field, mut random) = (self.ops.random_field(), Random::new(seed));
            let mut sum = vec![0.0; nv * nv];
            for _ in 0..count {
                let forces = field.sample(&mut random).T;
                for (i, row) in sum.chunks_exact_mut(nv.max(1)).enumerate() {
                    row.iter_mut().zip(&forces).for_each(|(sum, t)| *sum += forces[i] * t);
                }
            }
            sum.iter_mut().for_each(|x| *x /= count as f64);
            sum
        });
        Ok((array(py, mean, vec![nv, nv])?.into_any(), error))
    }
}
