//! Methods of `Model` that go by the Jacobian: inertias of tips, generalised inverses, inverse kinematics.

use crate::batch::{Argument, Batch};
use crate::compiled::{Compiled, Names};
use crate::errors::{Failure, argument_error};
use crate::model::Model;
use phipsi::recursion::{
    InverseKinematics, InverseKinematicsOptions, JacobianPseudoInverse, OperationalSpaceInertia,
    PseudoInverseOptions, Tip,
};
use phipsi::spatial::{Mat3, Quaternion, Transform, Vec3};
use pyo3::prelude::*;

/// What decided about the result of ``operational_space_inertia``.
///
/// ``singular_values``: (…, 6), falling, kg^(−½): how easily the six principal directions move. ``rank``: how many of them count;
/// in the others the point cannot move. ``condition``: largest over smallest that counts. ``length``: the radius, m, at which
/// angular motions count as linear ones. Floats and ints, or arrays of the batch axes.
#[pyclass(frozen, get_all, module = "phipsi")]
pub struct OperationalSpaceInfo {
    /// Singular values, falling, kg^(−½).
    pub singular_values: Py<PyAny>,
    /// How many singular values count.
    pub rank: Py<PyAny>,
    /// Largest over smallest singular value that counts.
    pub condition: Py<PyAny>,
    /// Radius at which rotations count as lengths, m.
    pub length: Py<PyAny>,
}

#[pymethods]
impl OperationalSpaceInfo {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (rank, condition) = (self.rank.bind(py).repr()?, self.condition.bind(py).repr()?);
        Ok(format!("OperationalSpaceInfo(rank={rank}, condition={condition})"))
    }
}

/// How ``inverse_kinematics`` ended.
///
/// ``reached``: True if the pose was reached; False: q is the closest configuration found. ``rotation_error``, rad, and
/// ``position_error``, m: what is left. ``iterations``, ``starts``: steps and starting configurations. ``gradient``: zero where no
/// small motion comes nearer. ``singular_values``: (…, 6), of the Jacobian at q with angular rows times ``length``, falling, m.
/// ``at_limits``: coordinates that the pose presses against a limit. ``length``: the radius, m, at which rotations count as
/// lengths. Plain numbers, or arrays of the batch axes.
#[pyclass(frozen, get_all, module = "phipsi")]
pub struct InverseKinematicsInfo {
    /// True if the pose was reached.
    pub reached: Py<PyAny>,
    /// Remaining rotation.
    pub rotation_error: Py<PyAny>,
    /// Remaining distance.
    pub position_error: Py<PyAny>,
    /// Steps of all starts together.
    pub iterations: Py<PyAny>,
    /// Starting configurations.
    pub starts: Py<PyAny>,
    /// Gradient of the error, relative to the largest one possible.
    pub gradient: Py<PyAny>,
    /// Singular values of the Jacobian, falling, m.
    pub singular_values: Py<PyAny>,
    /// Coordinates at limits.
    pub at_limits: Py<PyAny>,
    /// Radius at which rotations count as lengths, m.
    pub length: Py<PyAny>,
}

#[pymethods]
impl InverseKinematicsInfo {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let show = |x: &Py<PyAny>| x.bind(py).repr().map(|text| text.to_string());
        Ok(format!(
            "InverseKinematicsInfo(reached={}, rotation_error={}, position_error={}, iterations={}, starts={})",
            show(&self.reached)?,
            show(&self.rotation_error)?,
            show(&self.position_error)?,
            show(&self.iterations)?,
            show(&self.starts)?
        ))
    }
}

/// Results of several quantities, state after state.
struct Columns<'a> {
    batch: &'a Batch,
    out: Vec<f64>,
    width: usize,
}

impl Columns<'_> {
    /// Numbers `from`, … of every state, with the axes `core` of one state.
    fn numbers<'py>(&self, py: Python<'py>, from: usize, core: &[usize]) -> PyResult<Bound<'py, PyAny>> {
        let size: usize = core.iter().product();
        let states = self.out.chunks_exact(self.width);
        let part = states.flat_map(|state| state[from..from + size].iter().copied()).collect();
        self.batch.array(py, part, core)
    }
    /// One number of every state, as Python's or NumPy's `kind`.
    fn typed(&self, py: Python<'_>, from: usize, kind: &str) -> PyResult<Py<PyAny>> {
        let numbers = self.numbers(py, from, &[])?;
        if numbers.hasattr("astype")? {
            return Ok(numbers.call_method1("astype", (kind,))?.unbind());
        }
        Ok(py.import("builtins")?.getattr(kind)?.call1((numbers,))?.unbind())
    }
    fn float(&self, py: Python<'_>, from: usize) -> PyResult<Py<PyAny>> {
        Ok(self.numbers(py, from, &[])?.unbind())
    }
}

/// Refuses an option that is not what it must be.
fn check(py: Python<'_>, good: bool, name: &str, found: f64, required: &str) -> PyResult<()> {
    if good {
        return Ok(());
    }
    let message = format!("`{name}` is {found}, but {required} is required");
    Err(argument_error(py, name, crate::errors::Field::Number(found), required.into(), &message, None))
}

/// Poses as 4×4 matrices; matrices that do not turn are refused.
fn poses(py: Python<'_>, object: &Bound<'_, PyAny>) -> PyResult<Argument> {
    let describe = |i: usize| format!("row {}, column {}", i / 4, i % 4);
    let poses = Argument::read(object, "pose", &[4, 4], "rotation and position, as body_pose", &describe)?;
    for (own, x) in poses.own_states() {
        let r = pose(x).rotation;
        let product = r.transpose() * r;
        let identity = Mat3::<f64>::identity();
        let mut error = 0.0f64;
        for (row, one) in product.0.iter().zip(&identity.0) {
            row.iter().zip(one).for_each(|(x, y)| error = error.max((x - y).abs()));
        }
        let turned = r.column(0).cross(r.column(1)).dot(r.column(2));
        let last = (0..4).map(|i| (x[12 + i] - if i == 3 { 1.0 } else { 0.0 }).abs()).fold(0.0, f64::max);
        if error > 1e-6 || turned < 0.0 || last > 1e-6 {
            let place = poses.place(own).map(|p| format!("state {p:?}: ")).unwrap_or_default();
            let message = format!(
                "{place}`pose` is no pose: its 3×3 block differs by {error:.1e} from a rotation (determinant {turned:.3}), its last row by {last:.1e} from 0 0 0 1"
            );
            let required = "rotation and position, last row 0 0 0 1".into();
            return Err(argument_error(py, "pose", "no pose".into(), required, &message, None));
        }
    }
    Ok(poses)
}

fn pose(x: &[f64]) -> Transform<f64> {
    let row = |i: usize| [x[4 * i], x[4 * i + 1], x[4 * i + 2]];
    Transform::new(Mat3([row(0), row(1), row(2)]), Vec3([x[3], x[7], x[11]]))
}

fn point_at(point: &Option<Argument>, state: usize) -> Option<Vec3<f64>> {
    point.as_ref().map(|p| {
        let x = p.at(state);
        Vec3([x[0], x[1], x[2]])
    })
}

/// A name or several.
fn bodies(compiled: &Compiled, py: Python<'_>, object: &Bound<'_, PyAny>) -> PyResult<Vec<Option<usize>>> {
    if let Ok(name) = object.extract::<String>() {
        return Ok(vec![compiled.body(py, &name)?]);
    }
    let names: Vec<String> = object.extract()?;
    check(py, !names.is_empty(), "body", 0.0, "a name, or a list of at least one")?;
    names.iter().map(|name| compiled.body(py, name)).collect()
}

#[pymethods]
impl Model {
    /// The operational-space inertia Λ of a body: the wrench Λ a accelerates it by a, at rest and without weight.
    ///
    /// Λ = (J M⁻¹ J*)⁻¹, from the articulated inertias and singular values on the path to the base, without M. Where the body cannot
    /// move in all directions: the pseudo-inverse, with moments counted in units of ``info.length``.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). body : its name.
    /// point : (…, 3), m, in the body's frame; None is its origin.
    /// info : True returns (result, OperationalSpaceInfo).
    ///
    /// Returns
    /// -------
    /// (…, 6, 6), rows angular then linear, world axes, at the point; kg·m², kg·m, kg.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError at a joint without articulated inertia; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf", base="free")
    /// >>> q, v = m.random_state(1)
    /// >>> inertia, info = m.operational_space_inertia(q, "lower", info=True)
    /// >>> J = m.jacobian(q, "lower")
    /// >>> bool(np.allclose(inertia @ (J @ m.mass_matrix_inverse(q) @ J.T), np.eye(6))), info.rank
    /// (True, 6)
    #[pyo3(signature = (q, body, point = None, info = false))]
    fn operational_space_inertia<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        body: &str,
        point: Option<&Bound<'py, PyAny>>,
        info: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let body = compiled.body(py, body)?;
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let mut point = point.map(|p| compiled.point(p, "point")).transpose()?;
        let batch = Batch::of(py, std::iter::once(&mut q).chain(&mut point))?;
        let width = 36 + 9;
        let out = batch.each(
            py,
            width,
            || OperationalSpaceInertia::<f64>::new(layout),
            |work, i, out| {
                let (inertia, rest) = out.split_at_mut(36);
                let found = work.run(layout, q.at(i), body, point_at(&point, i), inertia)?;
                rest[..6].copy_from_slice(&found.singular_values);
                rest[6..].copy_from_slice(&[found.rank as f64, found.condition, found.length]);
                Ok(())
            },
        );
        let out =
            out.map_err(|e| compiled.failure(py, &batch, e, Names::Other("operational-space inertia")))?;
        let columns = Columns { batch: &batch, out, width };
        let inertia = columns.numbers(py, 0, &[6, 6])?;
        if !info {
            return Ok(inertia);
        }
        let info = OperationalSpaceInfo {
            singular_values: columns.numbers(py, 36, &[6])?.unbind(),
            rank: columns.typed(py, 42, "int")?,
            condition: columns.float(py, 43)?,
            length: columns.float(py, 44)?,
        };
        Ok((inertia, Py::new(py, info)?).into_pyobject(py)?.into_any())
    }
    /// The generalised inverse of the Jacobian of one or several bodies.
    ///
    /// J⁺ x are the least joint rates that give the bodies the motion x, or the motion nearest to it; near singular configurations
    /// too, by the singular values of J. With ``damping`` λ each of them is inverted as σ/(σ² + λ²).
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). body : its name, or a list of t names.
    /// point : (…, 3), m, in the body's frame; None is its origin. Only for one body.
    /// damping : λ, in units of the singular values.
    /// length : radius, m, at which angular rows count: for ranks, damping, and motions that cannot be had.
    ///
    /// Returns
    /// -------
    /// (…, nv, 6 t), columns angular then linear for each body, world axes.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(1)
    /// >>> bool(np.allclose(m.jacobian_pseudo_inverse(q, "lower") @ m.body_velocity(q, v, "lower"), v))
    /// True
    #[pyo3(signature = (q, body, point = None, damping = 0.0, length = 1.0))]
    fn jacobian_pseudo_inverse<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        body: &Bound<'py, PyAny>,
        point: Option<&Bound<'py, PyAny>>,
        damping: f64,
        length: f64,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        check(
            py,
            damping >= 0.0 && damping.is_finite(),
            "damping",
            damping,
            "a number that is not negative",
        )?;
        check(py, length > 0.0 && length.is_finite(), "length", length, "a positive number")?;
        let bodies = bodies(&compiled, py, body)?;
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let mut point = point.map(|p| compiled.point(p, "point")).transpose()?;
        check(
            py,
            point.is_none() || bodies.len() == 1,
            "point",
            bodies.len() as f64,
            "one body, for a point,",
        )?;
        let batch = Batch::of(py, std::iter::once(&mut q).chain(&mut point))?;
        let (nv, rows) = (layout.nv(), 6 * bodies.len());
        let options = PseudoInverseOptions { damping, length, ..Default::default() };
        let out = batch.each(
            py,
            nv * rows,
            || {
                let tips = bodies.iter().map(|&body| Tip { body, point: None }).collect::<Vec<_>>();
                let work = JacobianPseudoInverse::<f64>::new(layout, tips.len());
                (work, tips, vec![0.0; rows], vec![0.0; nv])
            },
            |(work, tips, unit, column), i, out| {
                tips[0].point = point_at(&point, i);
                work.update(layout, q.at(i), tips, options)?;
                for c in 0..rows {
                    unit.fill(0.0);
                    unit[c] = 1.0;
                    work.solve(unit, column)?;
                    (0..nv).for_each(|r| out[r * rows + c] = column[r]);
                }
                Ok(())
            },
        );
        compiled.result(py, &batch, out, Names::Other("generalised inverse"), &[nv, rows])
    }
    /// The configuration that brings a body to a pose, or as near to it as it can come.
    ///
    /// Least squares on the configuration space from ``q0``, then from random configurations, until the pose is reached: a pose out
    /// of reach gives the closest configuration, and ``info.reached`` says so. Joints that do not carry the body stay as they are.
    ///
    /// Parameters
    /// ----------
    /// body : its name. pose : (…, 4, 4), of its frame in the world, as ``body_pose``. q0 : (…, nq).
    /// orientation : False: only the position counts.
    /// limits : True: one-axis joints stay within the limits of the model.
    /// tolerance : reached if the rotation left, rad, and the distance left, in units of ``length``, are at most this.
    /// iterations : steps from each start, at most. restarts : further starts, at most: q0 passing
    ///     limits, whose hinges are turned back by whole turns, then random ones. seed : of these.
    /// length : radius, m, at which rotations count as lengths; None: the length of the path of joints to the body.
    ///
    /// Returns
    /// -------
    /// (q, info): (…, nq), and an InverseKinematicsInfo.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError for numbers that are not finite; ModelError if the model has closures.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> pose = m.body_pose([0.3, 0.8], "lower")
    /// >>> q, info = m.inverse_kinematics("lower", pose, [0.0, 0.1])
    /// >>> bool(np.allclose(m.body_pose(q, "lower"), pose)), info.reached
    /// (True, True)
    #[pyo3(signature = (
        body, pose, q0, orientation = true, limits = true, tolerance = 1e-10, iterations = 100, restarts = 10, seed = 0,
        length = None
    ))]
    #[allow(clippy::too_many_arguments)]
    fn inverse_kinematics<'py>(
        &self,
        py: Python<'py>,
        body: &str,
        pose: &Bound<'py, PyAny>,
        q0: &Bound<'py, PyAny>,
        orientation: bool,
        limits: bool,
        tolerance: f64,
        iterations: usize,
        restarts: usize,
        seed: u64,
        length: Option<f64>,
    ) -> PyResult<(Bound<'py, PyAny>, InverseKinematicsInfo)> {
        let compiled = self.compiled();
        check(py, tolerance > 0.0 && tolerance.is_finite(), "tolerance", tolerance, "a positive number")?;
        if let Some(length) = length {
            check(py, length > 0.0 && length.is_finite(), "length", length, "a positive number")?;
        }
        let Some(index) = compiled.body(py, body)? else {
            let message = "`body`: `world` does not move";
            return Err(argument_error(
                py,
                "body",
                "world".into(),
                "the name of a body".into(),
                message,
                None,
            ));
        };
        let (mut targets, mut q0) = (poses(py, pose)?, compiled.q(q0, "q0")?);
        let batch = Batch::of(py, [&mut targets, &mut q0])?;
        let (model, layout) = (&compiled.model, &compiled.layout);
        let options =
            InverseKinematicsOptions { tolerance, iterations, restarts, seed, orientation, limits, length };
        let (nq, width) = (layout.nq(), layout.nq() + 14);
        let out = batch.each(
            py,
            width,
            || InverseKinematics::<f64>::new(model, layout),
            |work, i, out| -> Result<(), Failure> {
                let mut target = self::pose(targets.at(i));
                target.rotation = Quaternion::from_rotation(&target.rotation).to_rotation();
                let (q, rest) = out.split_at_mut(nq);
                let found = work.run(model, layout, index, &target, q0.at(i), options, q)?;
                rest[..6].copy_from_slice(&found.singular_values);
                rest[6..].copy_from_slice(&[
                    f64::from(u8::from(found.reached)),
                    found.rotation_error,
                    found.position_error,
                    found.iterations as f64,
                    found.starts as f64,
                    found.gradient,
                    found.at_limits as f64,
                    found.length,
                ]);
                Ok(())
            },
        );
        let out = out.map_err(|e| compiled.failure(py, &batch, e, Names::Other("inverse kinematics")))?;
        let columns = Columns { batch: &batch, out, width };
        let info = InverseKinematicsInfo {
            singular_values: columns.numbers(py, nq, &[6])?.unbind(),
            reached: columns.typed(py, nq + 6, "bool")?,
            rotation_error: columns.float(py, nq + 7)?,
            position_error: columns.float(py, nq + 8)?,
            iterations: columns.typed(py, nq + 9, "int")?,
            starts: columns.typed(py, nq + 10, "int")?,
            gradient: columns.float(py, nq + 11)?,
            at_limits: columns.typed(py, nq + 12, "int")?,
            length: columns.float(py, nq + 13)?,
        };
        Ok((columns.numbers(py, 0, &[nq])?, info))
    }
}
