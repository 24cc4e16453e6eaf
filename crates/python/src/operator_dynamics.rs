//! Methods of `Operators` about the equations of motion: their derivatives and linearisation as expressions.

use crate::errors::{argument_error, dynamics_error};
use crate::operators::{Operator, Operators};
use numpy::PyArrayDyn;
use phipsi::recursion::DynamicsError;
use phipsi::recursion::operators::DynamicsDerivatives;
use pyo3::prelude::*;

type Three = (Operator, Operator, Operator);

impl Operators {
    /// Reads a joint vector of the one configuration.
    fn joint_vector(&self, object: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Vec<f64>> {
        let compiled = self.model.get().compiled();
        let x = compiled.v(object, name)?;
        if x.is_single() {
            return Ok(x.at(0).to_vec());
        }
        let required = format!("({},)", compiled.model.nv());
        let message = format!(
            "`{name}` has shape {:?}, but {required} is required: operators belong to one state; call once for each",
            x.shape()
        );
        let found = crate::errors::Field::Tuple(x.shape());
        Err(argument_error(object.py(), name, found, required.into(), &message, None))
    }
    fn three(py: Python<'_>, made: Result<DynamicsDerivatives<f64>, DynamicsError>) -> PyResult<Three> {
        let DynamicsDerivatives { d_dq, d_dv, d_last } = made.map_err(|e| dynamics_error(py, &e, None))?;
        Ok((Operator::new(py, d_dq)?, Operator::new(py, d_dv)?, Operator::new(py, d_last)?))
    }
}

#[pymethods]
impl Operators {
    /// ∂T/∂q, ∂T/∂v, ∂T/∂a of inverse dynamics as expressions of the operators; the last is the mass matrix H φ M φ* H*.
    ///
    /// ``v``, ``a``: (nv,). q in the increments of ``Model.integrate``. Cost O(n) to make, O(n) for each product with a vector.
    ///
    /// Raises ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v, a = [0.3, 0.4], [1.0, -0.5], [0.2, 0.1]
    /// >>> d_dq, d_dv, d_da = phipsi.operators(m, q).inverse_dynamics_derivatives(v, a)
    /// >>> bool(np.allclose(d_dq.dense(), m.inverse_dynamics_derivatives(q, v, a)[0]))
    /// True
    fn inverse_dynamics_derivatives(
        &self,
        py: Python<'_>,
        v: &Bound<'_, PyAny>,
        a: &Bound<'_, PyAny>,
    ) -> PyResult<Three> {
        let (v, a) = (self.joint_vector(v, "v")?, self.joint_vector(a, "a")?);
        Self::three(py, self.ops.inverse_dynamics_derivatives(&v, &a))
    }
    /// ∂a/∂q, ∂a/∂v, ∂a/∂T of forward dynamics as expressions: −𝓜⁻¹ times those of inverse dynamics, and 𝓜⁻¹ = L* D⁻¹ L.
    ///
    /// ``v``, ``tau``: (nv,). q in the increments of ``Model.integrate``. Cost O(n) to make, O(n) for each product with a vector.
    ///
    /// Raises ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v, tau = [0.3, 0.4], [1.0, -0.5], [0.2, 0.1]
    /// >>> d_dq, d_dv, d_dtau = phipsi.operators(m, q).forward_dynamics_derivatives(v, tau)
    /// >>> bool(np.allclose(d_dv.dense(), m.forward_dynamics_derivatives(q, v, tau)[1]))
    /// True
    fn forward_dynamics_derivatives(
        &self,
        py: Python<'_>,
        v: &Bound<'_, PyAny>,
        tau: &Bound<'_, PyAny>,
    ) -> PyResult<Three> {
        let (v, tau) = (self.joint_vector(v, "v")?, self.joint_vector(tau, "tau")?);
        Self::three(py, self.ops.forward_dynamics_derivatives(&v, &tau))
    }
    /// A and B of the linearised dynamics δẋ = A δx + B δT, x = (δq, δv), as expressions: 2nv × 2nv and 2nv × nv.
    ///
    /// ``v``, ``tau``: (nv,). ``Model.linearize`` gives the same as matrices. Cost O(n) to make, O(n) for each product with a
    /// vector: what a Krylov method for a long chain needs.
    ///
    /// Raises ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> A, B = phipsi.operators(m, [0.3, 0.4]).linearize([1.0, -0.5], [0.2, 0.1])
    /// >>> A.shape, B.shape
    /// ((4, 4), (4, 2))
    /// >>> bool(np.allclose(A @ [0.0, 0.0, 1.0, 0.0], m.linearize([0.3, 0.4], [1.0, -0.5], [0.2, 0.1])[0][:, 2]))
    /// True
    fn linearize(
        &self,
        py: Python<'_>,
        v: &Bound<'_, PyAny>,
        tau: &Bound<'_, PyAny>,
    ) -> PyResult<(Operator, Operator)> {
        let (v, tau) = (self.joint_vector(v, "v")?, self.joint_vector(tau, "tau")?);
        let linear = self.ops.linearize(&v, &tau).map_err(|e| dynamics_error(py, &e, None))?;
        Ok((Operator::new(py, linear.A)?, Operator::new(py, linear.B)?))
    }
    /// ∂ ln det 𝓜/∂q = 2 tr(Υ Ė_φ P⁺ E_φ*), all coordinates in one sweep over the blocks, (nv,); 1/rad or 1/m.
    ///
    /// ``Model.log_determinant_gradient`` gives the same without operators. Cost O(n).
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> ops = phipsi.operators(m, [0.3, 0.4])
    /// >>> bool(np.allclose(ops.log_determinant_gradient(), m.log_determinant_gradient([0.3, 0.4])))
    /// True
    fn log_determinant_gradient<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let gradient = self.ops.log_determinant_gradient();
        let size = gradient.len();
        crate::batch::array(py, gradient, vec![size])
    }
}
