//! `phipsi.operators(m, q)`: the papers' operators of a model, and expressions of them.

use crate::batch::{Argument, Batch};
use crate::errors::{argument_error, dynamics_error, exception};
use crate::model::Model;
use numpy::{PyArray1, PyArrayMethods};
use phipsi::recursion::operators::Sensitivity;
use phipsi::spatial::Vec3;
use phipsi::topology::OperatorError;
use pyo3::prelude::*;

type Expression = phipsi::topology::Operator<f64>;

/// An operator's error as a Python exception.
pub fn operator_error(py: Python<'_>, error: &OperatorError) -> PyErr {
    match error {
        OperatorError::Singular { pivot, .. } => {
            let fields = vec![
                ("quantity", Some("pivot of a block".into())),
                ("found", Some(crate::errors::Field::Number(*pivot))),
                ("required", Some("a number that is not zero".into())),
            ];
            exception(py, "NumericalError", &error.to_string(), fields)
        }
        other => exception(py, "ArgumentError", &other.to_string(), vec![]),
    }
}

/// A linear operator over the bodies of a model, as an expression that stays sweeps until it is applied.
///
/// ``A @ B``, ``A + B``, ``A - B``, ``-A``, ``2.0 * A``, ``A.T`` and ``A.inv()`` are expressions again; ``A @ x`` applies one to
/// (…, columns) numbers, in O(n) for every operator of ``phipsi.operators``. No matrix is formed but by ``A.dense()``.
#[pyclass(frozen, module = "phipsi")]
pub struct Operator {
    /// What it stands for.
    pub expression: Expression,
}

impl Operator {
    pub fn new(py: Python<'_>, expression: Expression) -> PyResult<Self> {
        expression.check().map_err(|e| operator_error(py, &e))?;
        Ok(Operator { expression })
    }
    /// A x for every state of an argument.
    fn applied<'py>(
        py: Python<'py>,
        expression: &Expression,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (rows, columns) = (expression.rows().dimension(), expression.columns().dimension());
        let meaning = format!("the columns of `{expression}`");
        let mut x = Argument::read(x, "x", &[columns], &meaning, &|i| format!("component {i}"))?;
        let batch = Batch::of(py, [&mut x])?;
        let out = batch.each(
            py,
            rows,
            || (),
            |(), state, out| {
                if let Ok(image) = expression.apply(x.at(state)) {
                    out.copy_from_slice(&image);
                }
                Ok(())
            },
        );
        let out = out.map_err(|(state, failure)| match failure {
            crate::errors::Failure::NotFinite(i, found) => {
                let message = format!("component {i} of `{expression}` x is {found}");
                let fields = vec![("state", batch.place(state).map(crate::errors::Field::Tuple))];
                exception(py, "NumericalError", &message, fields)
            }
            other => exception(py, "NumericalError", &format!("{other:?}"), vec![]),
        })?;
        batch.array(py, out, &[rows])
    }
}

#[pymethods]
impl Operator {
    /// NumPy leaves products with arrays to the operator.
    #[classattr]
    fn __array_ufunc__() -> Option<bool> {
        None
    }
    fn __matmul__<'py>(&self, py: Python<'py>, right: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        if let Ok(right) = right.cast::<Operator>() {
            let product = &self.expression * &right.get().expression;
            return Ok(Bound::new(py, Operator::new(py, product)?)?.into_any());
        }
        Operator::applied(py, &self.expression, right)
    }
    fn __rmatmul__<'py>(&self, py: Python<'py>, left: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        Operator::applied(py, &self.expression.adjoint(), left)
    }
    fn __add__(&self, py: Python<'_>, right: &Operator) -> PyResult<Operator> {
        Operator::new(py, &self.expression + &right.expression)
    }
    fn __sub__(&self, py: Python<'_>, right: &Operator) -> PyResult<Operator> {
        Operator::new(py, &self.expression - &right.expression)
    }
    fn __mul__(&self, scale: f64) -> Operator {
        Operator { expression: self.expression.scaled(scale) }
    }
    fn __rmul__(&self, scale: f64) -> Operator {
        self.__mul__(scale)
    }
    fn __neg__(&self) -> Operator {
        Operator { expression: -&self.expression }
    }
    /// The adjoint.
    #[getter(T)]
    fn transposed(&self) -> Operator {
        Operator { expression: self.expression.adjoint() }
    }
    /// (rows, columns).
    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.expression.rows().dimension(), self.expression.columns().dimension())
    }
    /// Multiplications and additions of one application.
    #[getter]
    fn cost(&self) -> u64 {
        self.expression.cost()
    }
    /// The inverse as sweeps, where an identity provides it: of block diagonals, φ and ψ, I − E, I + H φ K, H φ M φ* H*, and
    /// products of such.
    ///
    /// Raises ArgumentError if none does; NumericalError if a block that must be inverted is singular.
    ///
    /// Example
    /// -------
    /// >>> ops = phipsi.operators(phipsi.Model.from_urdf("arm.urdf"), [0.3, 0.4])
    /// >>> mass = ops.H @ ops.phi @ ops.M @ ops.phi.T @ ops.H.T
    /// >>> mass.inv()                                  # filter and smoother
    /// <phipsi.Operator (I − K* ψ* H*) D⁻¹ (I − H ψ K): 2 × 2>
    /// >>> bool(np.allclose(mass.inv() @ (mass @ np.ones(2)), 1.0))
    /// True
    fn inv(&self, py: Python<'_>) -> PyResult<Operator> {
        let expression = self.expression.inverse().map_err(|e| operator_error(py, &e))?;
        Ok(Operator { expression })
    }
    /// The matrix, (rows, columns): for checks and small problems.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> ops = phipsi.operators(m, [0.3, 0.4])
    /// >>> mass = ops.H @ ops.phi @ ops.M @ ops.phi.T @ ops.H.T
    /// >>> bool(np.allclose(mass.dense(), m.mass_matrix([0.3, 0.4])))
    /// True
    fn dense<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let matrix = self.expression.dense().map_err(|e| operator_error(py, &e))?;
        let rows: Vec<f64> = matrix.transpose().as_slice().to_vec();
        Ok(PyArray1::from_vec(py, rows).reshape([matrix.nrows(), matrix.ncols()])?.into_any())
    }
    fn __str__(&self) -> String {
        self.expression.to_string()
    }
    fn __repr__(&self) -> String {
        let (rows, columns) = self.shape();
        format!("<phipsi.Operator {}: {rows} × {columns}>", self.expression)
    }
}

/// The papers' spatial operators of a model at a configuration; made by ``phipsi.operators``.
///
/// One block a moving body (``bodies``), parents before children, six-vectors angular first in the user's body frames; joint
/// columns in the order of v. ``E_phi``, ``phi`` = (I − E_φ)⁻¹; ``H``, ``M``; ``P``, ``D``, ``G``, ``K`` of the Riccati equation;
/// ``tau`` = G H, ``tau_bar`` = I − τ; ``E_psi``, ``psi``; ``R`` composite inertias; ``S`` = φ M φ*; ``upsilon``, ``omega`` = ψ* H* D⁻¹ H ψ;
/// ``phi_tilde`` = φ − I, ``psi_tilde`` = ψ − I; ``I`` on spatial and ``I_joint`` on joint vectors.
#[pyclass(frozen, module = "phipsi")]
pub struct Operators {
    /// The operators.
    pub ops: phipsi::recursion::Operators<f64>,
    /// The model that they belong to.
    pub model: Py<Model>,
    bodies: Vec<String>,
}

macro_rules! operators {
    ($($name:literal $method:ident |$ops:ident| $expression:expr;)*) => {
        #[pymethods]
        impl Operators {
            $(
                #[doc = concat!("``", $name, "`` of the papers.")]
                #[getter($name)]
                fn $method(&self) -> Operator {
                    let $ops = &self.ops;
                    Operator { expression: $expression }
                }
            )*
        }
    };
}
operators! {
    "E_phi" e_phi |ops| ops.E_phi.clone();
    "phi" phi |ops| ops.phi.clone();
    "phi_tilde" phi_tilde |ops| ops.phi_tilde();
    "H" hinge |ops| ops.H.clone();
    "M" inertia |ops| ops.M.clone();
    "P" articulated |ops| ops.P.clone();
    "D" pivots |ops| ops.D.clone();
    "D_inverse" inverse_pivots |ops| ops.D_inverse.clone();
    "G" gain |ops| ops.G.clone();
    "K" shifted_gain |ops| ops.K.clone();
    "tau" tau |ops| ops.tau();
    "tau_bar" tau_bar |ops| ops.tau_bar.clone();
    "E_psi" e_psi |ops| ops.E_psi.clone();
    "psi" psi |ops| ops.psi.clone();
    "psi_tilde" psi_tilde |ops| ops.psi_tilde();
    "R" composite |ops| ops.R.clone();
    "S" state_covariance |ops| ops.state_covariance();
    "upsilon" upsilon |ops| ops.upsilon.clone();
    "omega" omega |ops| ops.omega();
    "I" identity |ops| ops.identity();
    "I_joint" joint_identity |ops| ops.joint_identity();
}

#[pymethods]
impl Operators {
    /// Names of the bodies that the blocks belong to.
    #[getter]
    fn bodies(&self) -> Vec<String> {
        self.bodies.clone()
    }
    /// The pick-off B: a wrench at a point of a body, body axes, to its body's block; ``B.T @ V`` is the point's velocity.
    ///
    /// ``body``: its name; ``point``: (3,), m, in the body's frame, None is its origin.
    ///
    /// Raises ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> ops = phipsi.operators(phipsi.Model.from_urdf("arm.urdf"), [0.3, 0.4])
    /// >>> J = ops.B("lower").T @ ops.phi.T @ ops.H.T       # the Jacobian, in the body's axes
    /// >>> J
    /// <phipsi.Operator B* φ* H*: 6 × 2>
    #[pyo3(signature = (body, point = None))]
    #[expect(non_snake_case)]
    fn B(&self, py: Python<'_>, body: &str, point: Option<&Bound<'_, PyAny>>) -> PyResult<Operator> {
        let compiled = self.model.get().compiled();
        let body = compiled.body(py, body)?;
        let point = match point {
            Some(point) => {
                let x = Argument::read(point, "point", &[3], "x, y, z in m", &|i| format!("component {i}"))?;
                let one = x.at(0);
                Vec3([one[0], one[1], one[2]])
            }
            None => Vec3::zero(),
        };
        let Some(body) = body else {
            let message = "`body` is `world`, which does not move; name a body of the model";
            return Err(argument_error(py, "body", "world".into(), "a body".into(), message, None));
        };
        let b = self.ops.pick_off(&[(body, point)]).map_err(|e| operator_error(py, &e))?;
        Operator::new(py, b)
    }
    /// Derivatives of all operators by one degree of freedom, along the increments of ``Model.integrate``: a dict from the
    /// operator's name to its derivative, in terms of the operators themselves.
    ///
    /// ``i``: index in v.
    ///
    /// Raises ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> ops = phipsi.operators(phipsi.Model.from_urdf("arm.urdf"), [0.3, 0.4])
    /// >>> ops.sensitivity(1)["phi"]
    /// <phipsi.Operator φ Ė_φ φ: 12 × 12>
    fn sensitivity<'py>(&self, py: Python<'py>, i: usize) -> PyResult<Bound<'py, PyAny>> {
        let rates = self.ops.sensitivity(i).map_err(|e| operator_error(py, &e))?;
        let Sensitivity { E_phi, phi, H, P, D, D_inverse, G, K, tau_bar, E_psi, psi, R, .. } = &rates;
        let Sensitivity { upsilon, state_covariance, mass_matrix, mass_matrix_inverse, omega, .. } = &rates;
        let all = [
            ("E_phi", E_phi),
            ("phi", phi),
            ("H", H),
            ("P", P),
            ("D", D),
            ("D_inverse", D_inverse),
            ("G", G),
            ("K", K),
            ("tau_bar", tau_bar),
            ("E_psi", E_psi),
            ("psi", psi),
            ("R", R),
            ("S", state_covariance),
            ("upsilon", upsilon),
            ("omega", omega),
            ("mass_matrix", mass_matrix),
            ("mass_matrix_inverse", mass_matrix_inverse),
        ];
        let dict = pyo3::types::PyDict::new(py);
        for (name, rate) in all {
            dict.set_item(name, Bound::new(py, Operator::new(py, rate.clone())?)?)?;
        }
        Ok(dict.into_any())
    }
    fn __repr__(&self) -> String {
        format!(
            "<phipsi.Operators of {} bodies, nv = {}>",
            self.bodies.len(),
            self.ops.joint_space().dimension()
        )
    }
}

/// The papers' spatial operators of a model at one configuration. ``q``: (nq,). Cost O(n); a model with closures gives the
/// operators of its tree.
///
/// Raises ArgumentError; NumericalError for numbers that are not finite and for a joint without articulated inertia.
///
/// Example
/// -------
/// >>> m = phipsi.Model.from_urdf("arm.urdf")
/// >>> ops = phipsi.operators(m, [0.3, 0.4])
/// >>> L = ops.I_joint - ops.H @ ops.psi @ ops.K
/// >>> (L @ [1.0, 2.0]).round(6)                         # innovations of the joint forces (1, 2)
/// array([-5.093604,  2.      ])
#[pyfunction]
pub fn operators(py: Python<'_>, m: Py<Model>, q: &Bound<'_, PyAny>) -> PyResult<Operators> {
    let compiled = m.get().compiled();
    let q = compiled.q(q, "q")?;
    if !q.is_single() {
        let message = format!(
            "`q` has shape {:?}, but ({},) is required: operators belong to one configuration; call once for each",
            q.shape(),
            compiled.model.nq()
        );
        let required = format!("({},)", compiled.model.nq());
        let found = crate::errors::Field::Tuple(q.shape());
        return Err(argument_error(py, "q", found, required.into(), &message, None));
    }
    let ops = phipsi::recursion::Operators::new(&compiled.model, q.at(0))
        .map_err(|e| dynamics_error(py, &e, None))?;
    let bodies = ops.bodies().iter().map(|&k| compiled.model.bodies()[k].name.clone()).collect();
    Ok(Operators { ops, model: m, bodies })
}
