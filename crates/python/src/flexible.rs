//! The class `FlexibleBody`, and methods of `Model` about modes: beams, finite element models, shape integrals.

use crate::batch::{Argument, array};
use crate::errors::{Field, argument_error, choice_error, exception, violations_error};
use crate::model::Model;
use phipsi::formats::matrix_market::read_matrix_market_file;
use phipsi::model::{
    Beam, BeamModes, CraigBampton, InterfaceNode, KeptModes, Node, Section, ShapeIntegrals, SymmetricMatrix,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

type Dict<'py> = Bound<'py, PyDict>;

/// Numbers of a matrix, by rows.
fn matrix(object: &Bound<'_, PyAny>, name: &'static str, shape: &[usize]) -> PyResult<Vec<f64>> {
    let describe = |i: usize| format!("entry {i}, by rows");
    let read = Argument::read(object, name, shape, "one number for each", &describe)?;
    crate::simulator::check_single(object.py(), &read)?;
    Ok(read.at(0).to_vec())
}

/// A number that must be above zero, or at least zero.
fn positive(py: Python<'_>, name: &str, x: f64, zero: bool) -> PyResult<f64> {
    if x.is_finite() && (x > 0.0 || (zero && x == 0.0)) {
        return Ok(x);
    }
    let required = if zero { "a finite number, at least 0" } else { "a finite number above 0" };
    let message = format!("`{name}` is {x}, but {required} is required");
    Err(argument_error(py, name, Field::Number(x), required.into(), &message, None))
}

/// A symmetric matrix: a Matrix Market file, a sparse matrix with ``tocoo``, or an array.
fn symmetric(object: &Bound<'_, PyAny>, name: &'static str) -> PyResult<SymmetricMatrix> {
    let py = object.py();
    let wrong = |e: phipsi::model::MatrixError| {
        let message = format!("`{name}`: {e}");
        argument_error(py, name, e.to_string().into(), "a symmetric matrix".into(), &message, None)
    };
    if let Ok(path) = object.extract::<PathBuf>() {
        crate::errors::check_file(&path)?;
        let read = py.detach(|| read_matrix_market_file(&path)).into_result(false);
        let (read, _) =
            read.map_err(|report| crate::errors::load_error(py, crate::report::Report::new(&report)))?;
        return read.to_symmetric().map_err(wrong);
    }
    if object.hasattr("tocoo")? {
        let coo = object.call_method0("tocoo")?;
        let (size, columns): (usize, usize) = coo.getattr("shape")?.extract()?;
        let numbers = |key: &str| -> PyResult<Bound<'_, PyAny>> { coo.getattr(key)?.call_method0("tolist") };
        let rows: Vec<usize> = numbers("row")?.extract()?;
        let places: Vec<usize> = numbers("col")?.extract()?;
        let values: Vec<f64> = numbers("data")?.extract()?;
        let entries = rows.into_iter().zip(places).zip(values).map(|((i, j), x)| (i, j, x));
        return SymmetricMatrix::from_entries(size.max(columns), entries).map_err(wrong);
    }
    let size = object.len()?;
    let dense = matrix(object, name, &[size, size])?;
    let entries = dense.iter().enumerate().map(|(x, a)| (x / size, x % size, *a));
    SymmetricMatrix::from_entries(size, entries.filter(|x| x.2 != 0.0)).map_err(wrong)
}

/// The modal coordinates of a body: what the dynamics needs of its shapes, and where other bodies attach.
///
/// Made by ``beam``, ``craig_bampton`` or ``from_integrals``; put into a model by ``Model.with_flexible_body``. A body is held by its
/// joint at its frame's origin, where no mode moves it, or at the node ``held_at``.
#[pyclass(frozen, module = "phipsi")]
pub struct FlexibleBody {
    body: phipsi::model::FlexibleBody,
    report: Option<String>,
}

impl FlexibleBody {
    fn new(body: phipsi::model::FlexibleBody, held_at: Option<String>) -> Self {
        let body = match held_at {
            Some(node) => body.held_at(node),
            None => body,
        };
        FlexibleBody { body, report: None }
    }
}

#[pymethods]
impl FlexibleBody {
    /// A straight beam along x of the body's frame, of Euler and Bernoulli, with a node ``tip`` at its end.
    ///
    /// Parameters
    /// ----------
    /// length : m. mass_per_length : kg/m. bending_stiffness : (2,), EI for displacement along y and along z, N·m².
    /// bending, torsion, axial : numbers of modes; of bending (2,), along y and along z, (2, 2) where None.
    /// torsional_stiffness, polar_inertia, axial_stiffness : GJ, N·m²; ρI_p, kg·m; EA, N.
    /// modes : "interface" (for beams that carry something: two cubics in each plane besides), "clamped_free" or "pinned".
    /// stiffened : with the shortening by bending. damping : C = damping K, s. nodes : {name: x}, m. held_at : a node.
    ///
    /// Raises
    /// ------
    /// ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> phipsi.FlexibleBody.beam(1.0, 1.0, [3.0, 3.0], bending=[2, 2]).modes
    /// 8
    #[staticmethod]
    #[pyo3(signature = (
        length, mass_per_length, bending_stiffness, bending = None, torsion = 0, axial = 0, torsional_stiffness = 0.0,
        polar_inertia = 0.0, axial_stiffness = 0.0, modes = "interface", stiffened = false, damping = 0.0, nodes = None,
        held_at = None
    ))]
    #[expect(clippy::too_many_arguments, reason = "the arguments of the Python method")]
    fn beam(
        py: Python<'_>,
        length: f64,
        mass_per_length: f64,
        bending_stiffness: [f64; 2],
        bending: Option<[usize; 2]>,
        torsion: usize,
        axial: usize,
        torsional_stiffness: f64,
        polar_inertia: f64,
        axial_stiffness: f64,
        modes: &str,
        stiffened: bool,
        damping: f64,
        nodes: Option<std::collections::BTreeMap<String, f64>>,
        held_at: Option<String>,
    ) -> PyResult<Self> {
        let family = match modes {
            "interface" => BeamModes::Interface,
            "clamped_free" => BeamModes::ClampedFree,
            "pinned" => BeamModes::Pinned,
            other => return Err(choice_error(py, "modes", other, &["interface", "clamped_free", "pinned"])),
        };
        let bending = bending.unwrap_or([2, 2]);
        for (name, count) in [("bending", bending[0].max(bending[1])), ("torsion", torsion), ("axial", axial)]
        {
            if count > 40 {
                let message = format!("`{name}` is {count}, but at most 40 modes are allowed");
                let found = Field::Index(count);
                return Err(argument_error(py, name, found, "at most 40".into(), &message, None));
            }
        }
        let [y, z] = bending_stiffness;
        let section = Section {
            mass_per_length: positive(py, "mass_per_length", mass_per_length, false)?,
            bending_stiffness: [
                positive(py, "bending_stiffness[0]", y, true)?,
                positive(py, "bending_stiffness[1]", z, true)?,
            ],
            torsional_stiffness: positive(py, "torsional_stiffness", torsional_stiffness, true)?,
            polar_inertia: positive(py, "polar_inertia", polar_inertia, true)?,
            axial_stiffness: positive(py, "axial_stiffness", axial_stiffness, true)?,
        };
        let mut beam = Beam::new(positive(py, "length", length, false)?, section)
            .family(family)
            .bending(bending)
            .torsion(torsion)
            .axial(axial)
            .damped(positive(py, "damping", damping, true)?);
        if stiffened {
            beam = beam.stiffened();
        }
        for (name, x) in nodes.unwrap_or_default() {
            beam = beam.node(name, x);
        }
        Ok(Self::new(beam.build(), held_at))
    }
    /// A finite element model, reduced by Craig and Bampton: modes with all interfaces clamped, the lowest, and a static shape for
    /// every degree of freedom of an outboard interface.
    ///
    /// Parameters
    /// ----------
    /// mass, stiffness : of the free elements, node after node, each with x, y, z and, if there are six, rotations about them: an array, a
    ///     matrix of scipy.sparse, or the path of a Matrix Market file. kg, kg·m, kg·m²; N/m, N, N·m.
    /// positions : (nodes, 3), m. inboard : indices of the nodes that the joint holds; the frame's origin is at the first.
    /// interface : {name: index} of nodes where other bodies attach.
    /// modes : how many with clamped interfaces to keep. shapes : (degrees of freedom, modes), instead: shapes that another program
    ///     made, zero at the inboard nodes.
    /// damping : C = damping K, s. name : of the body, for errors.
    ///
    /// Raises
    /// ------
    /// OSError; ArgumentError; ModelError with everything that is wrong with the elements.
    ///
    /// Example
    /// -------
    /// >>> k, o = np.diag([1.0, 1.0, 1.0]), np.zeros((3, 3))                 # a mass on a spring, held at the first node
    /// >>> body = phipsi.FlexibleBody.craig_bampton(
    /// ...     np.block([[o, o], [o, k]]), np.block([[k, -k], [-k, k]]), np.zeros((2, 3)), [0], {"tip": 1}, modes=0)
    /// >>> body.frequencies
    /// array([1., 1., 1.])
    #[staticmethod]
    #[pyo3(signature = (
        mass, stiffness, positions, inboard, interface, modes = 6, shapes = None, damping = 0.0, name = "body"
    ))]
    #[expect(clippy::too_many_arguments, reason = "the arguments of the Python method")]
    fn craig_bampton(
        py: Python<'_>,
        mass: &Bound<'_, PyAny>,
        stiffness: &Bound<'_, PyAny>,
        positions: &Bound<'_, PyAny>,
        inboard: Vec<usize>,
        interface: std::collections::BTreeMap<String, usize>,
        modes: usize,
        shapes: Option<&Bound<'_, PyAny>>,
        damping: f64,
        name: &str,
    ) -> PyResult<Self> {
        let damping = positive(py, "damping", damping, true)?;
        let (mass, stiffness) = (symmetric(mass, "mass")?, symmetric(stiffness, "stiffness")?);
        let nodes = positions.len()?;
        let places = matrix(positions, "positions", &[nodes, 3])?;
        let kept = match shapes {
            None => KeptModes::Lowest(modes),
            Some(shapes) => {
                let (_, columns): (usize, usize) = shapes.getattr("shape")?.extract()?;
                let numbers = matrix(shapes, "shapes", &[mass.size(), columns])?;
                KeptModes::given(columns, &numbers)
            }
        };
        let elements = CraigBampton {
            mass,
            stiffness,
            positions: places.chunks_exact(3).map(|x| [x[0], x[1], x[2]]).collect(),
            inboard,
            outboard: interface.into_iter().map(|(name, index)| InterfaceNode { name, index }).collect(),
            modes: kept,
        };
        let (body, report) = py.detach(|| elements.reduce(name)).map_err(|e| violations_error(py, &e))?;
        let damping = body.stiffness.iter().map(|k| damping * k).collect();
        let mut made = Self::new(body.damped(damping), None);
        made.report = Some(report.to_string());
        Ok(made)
    }
    /// Shape integrals as numbers, for published models; what is not given is zero.
    ///
    /// Parameters
    /// ----------
    /// mass : kg. modal_stiffness : (n, n). modal_damping : (n, n).
    /// first_moment : (3,), Σ m s. second_moment, rotary : (3, 3), Σ m s s*, Σ J.
    /// displacement : (n, 3), Σ m ψ_l. moment : (n, 3, 3), Σ m ψ_l s*. product : (n, n, 3, 3), Σ m ψ_l ψ_m*.
    /// rotary_coupling : (n, 3), Σ J ψʳ_l. rotary_modal : (n, n), Σ ψʳ_l·J ψʳ_m.
    /// nodes : {name: {"position": (3,), "displacement": (n, 3), "rotation": (n, 3)}}. held_at : a node.
    ///
    /// Raises
    /// ------
    /// ArgumentError.
    ///
    /// Example
    /// -------
    /// >>> product = np.zeros((1, 1, 3, 3)); product[0, 0, 1, 1] = 0.5
    /// >>> body = phipsi.FlexibleBody.from_integrals(2.0, [[8.0]], displacement=[[0, 1.0, 0]], product=product)
    /// >>> body.frequencies
    /// array([4.])
    #[staticmethod]
    #[pyo3(signature = (
        mass, modal_stiffness, modal_damping = None, first_moment = None, second_moment = None, displacement = None,
        moment = None, product = None, rotary = None, rotary_coupling = None, rotary_modal = None, nodes = None,
        held_at = None
    ))]
    #[expect(clippy::too_many_arguments, reason = "the arguments of the Python method")]
    fn from_integrals(
        py: Python<'_>,
        mass: f64,
        modal_stiffness: &Bound<'_, PyAny>,
        modal_damping: Option<&Bound<'_, PyAny>>,
        first_moment: Option<&Bound<'_, PyAny>>,
        second_moment: Option<&Bound<'_, PyAny>>,
        displacement: Option<&Bound<'_, PyAny>>,
        moment: Option<&Bound<'_, PyAny>>,
        product: Option<&Bound<'_, PyAny>>,
        rotary: Option<&Bound<'_, PyAny>>,
        rotary_coupling: Option<&Bound<'_, PyAny>>,
        rotary_modal: Option<&Bound<'_, PyAny>>,
        nodes: Option<&Dict<'_>>,
        held_at: Option<String>,
    ) -> PyResult<Self> {
        let n = modal_stiffness.len()?;
        let given = |object: Option<&Bound<'_, PyAny>>, name: &'static str, shape: &[usize]| match object {
            Some(object) => matrix(object, name, shape),
            None => Ok(vec![0.0; shape.iter().product()]),
        };
        let vectors =
            |x: Vec<f64>| -> Vec<[f64; 3]> { x.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect() };
        let tensors = |x: Vec<f64>| -> Vec<[[f64; 3]; 3]> {
            vectors(x).chunks_exact(3).map(|m| [m[0], m[1], m[2]]).collect()
        };
        let mut sum = ShapeIntegrals::zero(n);
        sum.mass = positive(py, "mass", mass, false)?;
        sum.first_moment = vectors(given(first_moment, "first_moment", &[3])?)[0];
        sum.second_moment = tensors(given(second_moment, "second_moment", &[3, 3])?)[0];
        sum.rotary = tensors(given(rotary, "rotary", &[3, 3])?)[0];
        sum.displacement = vectors(given(displacement, "displacement", &[n, 3])?);
        sum.moment = tensors(given(moment, "moment", &[n, 3, 3])?);
        sum.product = tensors(given(product, "product", &[n, n, 3, 3])?);
        sum.rotary_coupling = vectors(given(rotary_coupling, "rotary_coupling", &[n, 3])?);
        sum.rotary_modal = given(rotary_modal, "rotary_modal", &[n, n])?;
        let stiffness = matrix(modal_stiffness, "modal_stiffness", &[n, n])?;
        let damping = given(modal_damping, "modal_damping", &[n, n])?;
        let mut all = Vec::new();
        for (name, value) in nodes.map(|nodes| nodes.iter().collect::<Vec<_>>()).unwrap_or_default() {
            let (name, node): (String, Dict<'_>) = (name.extract()?, value.cast_into()?);
            let known = ["position", "displacement", "rotation"];
            for key in node.keys() {
                let key: String = key.extract()?;
                if !known.contains(&key.as_str()) {
                    return Err(choice_error(py, "nodes", &key, &known));
                }
            }
            let part = |key: &'static str, shape: &[usize]| given(node.get_item(key)?.as_ref(), key, shape);
            all.push(Node {
                name,
                position: vectors(part("position", &[3])?)[0],
                displacement: vectors(part("displacement", &[n, 3])?),
                rotation: vectors(part("rotation", &[n, 3])?),
                quadratic: None,
            });
        }
        Ok(Self::new(phipsi::model::FlexibleBody::new(sum, stiffness, all).damped(damping), held_at))
    }
    /// Number of modes.
    #[getter]
    fn modes(&self) -> usize {
        self.body.modes()
    }
    /// Names of its nodes.
    #[getter]
    fn nodes(&self) -> Vec<String> {
        self.body.nodes.iter().map(|node| node.name.clone()).collect()
    }
    /// Natural frequencies with its frame held, rad/s, (modes,).
    ///
    /// Raises NumericalError if the modal mass matrix is not positive definite.
    #[getter]
    fn frequencies<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let Some(squares) = self.body.squared_frequencies() else {
            let message = "the modal mass matrix is not positive definite; leave out modes without mass";
            return Err(exception(py, "NumericalError", message, vec![]));
        };
        let n = squares.len();
        let roots = squares.iter().map(|x| x.max(0.0).sqrt()).collect();
        Ok(array(py, roots, vec![n])?.into_any())
    }
    /// What an import of finite elements found and left out; None of other bodies.
    #[getter]
    fn report(&self) -> Option<String> {
        self.report.clone()
    }
    fn __repr__(&self) -> String {
        format!("<phipsi.FlexibleBody: {} modes, nodes {}>", self.body.modes(), self.nodes().join(", "))
    }
}

#[pymethods]
impl Model {
    /// The same model with a flexible body in place of a rigid one. Its modal coordinates are the last entries of q and v.
    ///
    /// Parameters
    /// ----------
    /// name : of the body. body : the FlexibleBody; its frame is the body's.
    /// nodes : {joint: node}, which of the joints outboard of it are on which of its nodes; a joint's origin is then in the node's
    ///     frame. Other joints stay where they are in the body's frame.
    ///
    /// Returns
    /// -------
    /// A Model; this one stays as it is.
    ///
    /// Raises
    /// ------
    /// ModelError with everything that is wrong.
    ///
    /// Example
    /// -------
    /// >>> beam = phipsi.FlexibleBody.beam(1.0, 1.0, [3.0, 3.0], bending=[1, 1])
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.with_flexible_body(m.body_names[-1], beam).mode_names[:2]
    /// ['lower.mode1', 'lower.mode2']
    #[pyo3(signature = (name, body, nodes = None))]
    fn with_flexible_body(
        &self,
        py: Python<'_>,
        name: &str,
        body: &FlexibleBody,
        nodes: Option<std::collections::BTreeMap<String, String>>,
    ) -> PyResult<Model> {
        let nodes: Vec<(String, String)> = nodes.unwrap_or_default().into_iter().collect();
        let made = self.compiled().model.with_flexible_body(name, body.body.clone(), &nodes);
        let report = self.report(py).borrow(py).clone();
        Model::made(py, made.map_err(|e| violations_error(py, &e))?, report)
    }
    /// Names of the modal coordinates, body after body: the last entries of q and v.
    #[getter]
    fn mode_names(&self) -> Vec<String> {
        self.compiled().model.mode_names().collect()
    }
    /// First index in q of a body's modal coordinates.
    ///
    /// Raises ArgumentError for an unknown name and for a rigid body.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m = m.with_flexible_body("lower", phipsi.FlexibleBody.beam(1.0, 1.0, [3.0, 2.0], bending=[1, 1]))
    /// >>> m.mode_q_offset("lower")
    /// 2
    fn mode_q_offset(&self, py: Python<'_>, body: &str) -> PyResult<usize> {
        let compiled = self.compiled();
        Ok(compiled.model.mode_q_range(flexible_body(py, &compiled, body)?).start)
    }
    /// First index in v of a body's modal coordinates.
    ///
    /// Raises ArgumentError for an unknown name and for a rigid body.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m = m.with_flexible_body("lower", phipsi.FlexibleBody.beam(1.0, 1.0, [3.0, 2.0], bending=[1, 1]))
    /// >>> m.mode_v_offset("lower")
    /// 2
    fn mode_v_offset(&self, py: Python<'_>, body: &str) -> PyResult<usize> {
        let compiled = self.compiled();
        Ok(compiled.model.mode_v_range(flexible_body(py, &compiled, body)?).start)
    }
}

/// Index of a flexible body.
fn flexible_body(py: Python<'_>, compiled: &crate::compiled::Compiled, name: &str) -> PyResult<usize> {
    let found = compiled.body(py, name)?.filter(|&k| compiled.model.bodies()[k].modes() > 0);
    found.ok_or_else(|| {
        let message = format!("`body`: `{name}` is rigid: it has no modes");
        argument_error(py, "body", name.into(), "a flexible body".into(), &message, None)
    })
}
