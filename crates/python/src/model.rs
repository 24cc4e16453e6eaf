//! The class `Model`: loading, names, and the configuration space.

use crate::batch::{Argument, Batch};
use crate::compiled::{Compiled, Names};
use crate::errors::{argument_error, check_file, choice_error, load_error, name_error};
use crate::report::Report;
use phipsi::formats::urdf::{Mimic, UrdfOptions, read_urdf, read_urdf_file};
use phipsi::formats::{Loaded, Problem};
use phipsi::model::{Base, JointKind};
use phipsi::recursion::singular_hinges;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::path::PathBuf;
use std::sync::{Arc, PoisonError, RwLock};

/// A mechanism: bodies, joints and their names.
///
/// Made by ``Model.from_urdf``. Angles in rad, lengths in m, masses in kg. Six-vectors are angular first. Every method takes
/// lists, tuples or arrays of real numbers; leading batch axes are always allowed and are broadcast.
///
/// ``q`` (nq): an angle or displacement per one-axis joint; spherical: quaternion x y z w; planar: x, y, angle; free: position
/// in the parent's axes, then quaternion x y z w. ``v`` (nv): their rates; spherical: angular velocity in body axes; planar:
/// (ω_z, v_x, v_y) in body axes; free: (ω, velocity of the body-frame origin) in body axes. Accelerations are the
/// componentwise time derivative of ``v``; generalized forces are power-conjugate to ``v``.
///
/// Example
/// -------
/// >>> m = phipsi.Model.from_urdf("arm.urdf")
/// >>> m
/// <phipsi.Model `arm`: 3 bodies, nq = 2, nv = 2>
/// >>> m.forward_dynamics([0.0, 0.0], [0.0, 0.0], [0.0, 0.0]).shape
/// (2,)
#[pyclass(frozen, module = "phipsi")]
pub struct Model {
    compiled: RwLock<Arc<Compiled>>,
    report: Py<Report>,
}

impl Model {
    /// What a call works on: it keeps it to its end, whatever is set meanwhile.
    pub fn compiled(&self) -> Arc<Compiled> {
        self.compiled.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Puts another model in the place of this one, made from it.
    ///
    /// # Errors
    /// Those of `change`.
    pub fn replace(
        &self,
        change: impl FnOnce(&phipsi::model::Model) -> PyResult<phipsi::model::Model>,
    ) -> PyResult<()> {
        let mut compiled = self.compiled.write().unwrap_or_else(PoisonError::into_inner);
        let model = change(&compiled.model)?;
        *compiled = Arc::new(Compiled::of(model));
        Ok(())
    }

    /// A model that no file describes.
    ///
    /// # Errors
    /// Those of Python's allocation.
    pub fn made(py: Python<'_>, model: phipsi::model::Model, report: Report) -> PyResult<Self> {
        let compiled = RwLock::new(Arc::new(Compiled::of(model)));
        Ok(Model { compiled, report: Py::new(py, report)? })
    }

    fn loaded(py: Python<'_>, read: Loaded<phipsi::model::Model>, strict: bool) -> PyResult<Self> {
        let Loaded { value, mut report } = read;
        if let Some(model) = &value
            && model.refused_closure().is_none()
        {
            report.warnings.extend(
                singular_hinges(model)
                    .into_iter()
                    .map(|v| Problem::new(None, v.subject.to_string(), v.found, v.required, v.remedy)),
            );
        }
        match value {
            Some(model) if report.is_ok(strict) => {
                let report = Py::new(py, Report::new(&report))?;
                Ok(Model { compiled: RwLock::new(Arc::new(Compiled::of(model))), report })
            }
            _ => Err(load_error(py, Report::new(&report))),
        }
    }
}

/// Reads `base` and `mimic`.
fn options(py: Python<'_>, base: &str, mimic: &str) -> PyResult<UrdfOptions> {
    let base = match base {
        "fixed" => Base::Fixed,
        "free" => Base::Free,
        other => return Err(choice_error(py, "base", other, &["fixed", "free"])),
    };
    let mimic = match mimic {
        "closure" => Mimic::Closure,
        "free" => Mimic::Free,
        other => return Err(choice_error(py, "mimic", other, &["closure", "free"])),
    };
    Ok(UrdfOptions { base, mimic })
}

#[pymethods]
impl Model {
    /// Reads a URDF file.
    ///
    /// Parameters
    /// ----------
    /// path : the file.
    /// base : "fixed" (the root link is welded to the world) or "free" (it floats; the joint is named after it and is first).
    /// mimic : "closure" (a ``<mimic>`` couples the two joints) or "free" (it is dropped, the joint moves by itself).
    /// strict : True refuses warnings too.
    ///
    /// Raises
    /// ------
    /// OSError if the file cannot be opened; ModelError, with the report, if it cannot be used.
    ///
    /// Example
    /// -------
    /// >>> phipsi.Model.from_urdf("arm.urdf", base="free").joint_names
    /// ['foot', 'shoulder', 'elbow']
    #[staticmethod]
    #[pyo3(signature = (path, base = "fixed", mimic = "closure", strict = false))]
    fn from_urdf(py: Python<'_>, path: PathBuf, base: &str, mimic: &str, strict: bool) -> PyResult<Self> {
        let options = options(py, base, mimic)?;
        check_file(&path)?;
        Self::loaded(py, py.detach(|| read_urdf_file(&path, &options)), strict)
    }
    /// Reads the text of a URDF file; arguments and errors as ``from_urdf``.
    ///
    /// ``source`` is its name in the report.
    ///
    /// Example
    /// -------
    /// >>> phipsi.Model.from_urdf_text("<robot name='r'><link name='a'/></robot>").body_names
    /// ['a']
    #[staticmethod]
    #[pyo3(signature = (text, base = "fixed", mimic = "closure", strict = false, source = "text"))]
    fn from_urdf_text(
        py: Python<'_>,
        text: &str,
        base: &str,
        mimic: &str,
        strict: bool,
        source: &str,
    ) -> PyResult<Self> {
        let options = options(py, base, mimic)?;
        Self::loaded(py, py.detach(|| read_urdf(text, source, &options)), strict)
    }
    /// What the reader used, approximated and ignored: a Report.
    #[getter]
    pub fn report(&self, py: Python<'_>) -> Py<Report> {
        self.report.clone_ref(py)
    }
    /// The model's name.
    #[getter]
    fn name(&self) -> String {
        self.compiled().model.name().into()
    }
    /// Number of position coordinates.
    #[getter]
    fn nq(&self) -> usize {
        self.compiled().model.nq()
    }
    /// Number of degrees of freedom.
    #[getter]
    fn nv(&self) -> usize {
        self.compiled().model.nv()
    }
    /// Names of the moving joints, in the order of v; a free base given by base = "free" has its root link's name.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        let model = &self.compiled().model;
        model.moving_joints().map(|k| model.joints()[k].name.clone()).collect()
    }
    /// Types of the moving joints, in the order of joint_names: "revolute", "spherical", "floating", …
    #[getter]
    fn joint_types(&self) -> Vec<&'static str> {
        let model = &self.compiled().model;
        model.moving_joints().map(|k| model.joints()[k].kind.word()).collect()
    }
    /// Names of the bodies, without `world`, parents before children; bodies on fixed joints included.
    #[getter]
    fn body_names(&self) -> Vec<String> {
        self.compiled().model.bodies().iter().map(|b| b.name.clone()).collect()
    }
    /// First index in q of a joint.
    ///
    /// Raises ArgumentError for an unknown name and for a fixed joint.
    ///
    /// Example
    /// -------
    /// >>> phipsi.Model.from_urdf("arm.urdf", base="free").joint_q_offset("shoulder")
    /// 7
    fn joint_q_offset(&self, py: Python<'_>, name: &str) -> PyResult<usize> {
        let compiled = self.compiled();
        Ok(compiled.model.q_offset(moving_joint(py, &compiled.model, name)?))
    }
    /// First index in v of a joint.
    ///
    /// Raises ArgumentError for an unknown name and for a fixed joint.
    ///
    /// Example
    /// -------
    /// >>> phipsi.Model.from_urdf("arm.urdf", base="free").joint_v_offset("shoulder")
    /// 6
    fn joint_v_offset(&self, py: Python<'_>, name: &str) -> PyResult<usize> {
        let compiled = self.compiled();
        Ok(compiled.model.v_offset(moving_joint(py, &compiled.model, name)?))
    }
    /// Gravity, m/s², world axes: a tuple of three; settable. A call already running keeps the one it began with.
    #[getter]
    fn gravity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.compiled().model.gravity())
    }
    #[setter]
    fn set_gravity(&self, gravity: &Bound<'_, PyAny>) -> PyResult<()> {
        let describe = |i: usize| format!("axis {}", ["x", "y", "z"][i]);
        let read = Argument::read(gravity, "gravity", &[3], "m/s², world axes", &describe)?;
        let py = gravity.py();
        crate::simulator::check_single(py, &read)?;
        let g: [f64; 3] = std::array::from_fn(|i| read.at(0)[i]);
        let mut compiled = self.compiled.write().unwrap_or_else(PoisonError::into_inner);
        *compiled = Arc::new(compiled.with_gravity(g));
        Ok(())
    }
    /// The configuration at zero: zeros, and unit quaternions; (nq,).
    ///
    /// Example
    /// -------
    /// >>> phipsi.Model.from_urdf("arm.urdf").neutral()
    /// array([0., 0.])
    fn neutral<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let q: Vec<f64> = self.compiled().model.neutral();
        let n = q.len();
        Ok(crate::batch::array(py, q, vec![n])?.into_any())
    }
    /// A reproducible random state (q, v): q within the joint limits, orientations uniform, v in [−1, 1].
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(7)
    /// >>> bool((q == m.random_state(7)[0]).all())
    /// True
    fn random_state<'py>(
        &self,
        py: Python<'py>,
        seed: u64,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let state = self.compiled().model.random_state(seed);
        let (nq, nv) = (state.q.len(), state.v.len());
        let q = crate::batch::array(py, state.q, vec![nq])?.into_any();
        Ok((q, crate::batch::array(py, state.v, vec![nv])?.into_any()))
    }
    /// The configuration after unit time at the constant body velocity ``v_dt``.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq).
    /// v_dt : (…, nv), a velocity times a duration, laid out as v.
    ///
    /// Returns
    /// -------
    /// (…, nq); quaternions are normalized.
    ///
    /// Raises
    /// ------
    /// ArgumentError, NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> phipsi.Model.from_urdf("arm.urdf").integrate([0.0, 1.0], [0.5, 0.5])
    /// array([0.5, 1.5])
    fn integrate<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v_dt: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v_dt, "v_dt")?);
        let (nq, batch) = (compiled.model.nq(), Batch::of(py, [&mut q, &mut v])?);
        let out = batch.each(
            py,
            nq,
            || (),
            |(), i, out| {
                compiled.model.integrate_into(q.at(i), v.at(i), out);
                Ok(())
            },
        );
        compiled.result(py, &batch, out, Names::Position("q"), &[nq])
    }
    /// The shortest increment x with integrate(q0, x) = q1.
    ///
    /// Parameters
    /// ----------
    /// q0, q1 : (…, nq). Angles are not wrapped; quaternions are read with either sign.
    ///
    /// Returns
    /// -------
    /// (…, nv), laid out as v.
    ///
    /// Raises
    /// ------
    /// ArgumentError, NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> phipsi.Model.from_urdf("arm.urdf").difference([0.0, 1.0], [0.5, 1.5])
    /// array([0.5, 0.5])
    fn difference<'py>(
        &self,
        py: Python<'py>,
        q0: &Bound<'py, PyAny>,
        q1: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (mut a, mut b) = (compiled.q(q0, "q0")?, compiled.q(q1, "q1")?);
        let (nv, batch) = (compiled.model.nv(), Batch::of(py, [&mut a, &mut b])?);
        let out = batch.each(
            py,
            nv,
            || (),
            |(), i, out| {
                compiled.model.difference_into(a.at(i), b.at(i), out);
                Ok(())
            },
        );
        compiled.result(py, &batch, out, Names::Velocity("increment"), &[nv])
    }
    fn __repr__(&self) -> String {
        let model = &self.compiled().model;
        let (bodies, nq, nv) = (model.len(), model.nq(), model.nv());
        format!("<phipsi.Model `{}`: {bodies} bodies, nq = {nq}, nv = {nv}>", model.name())
    }
}

/// Index of a joint with degrees of freedom.
fn moving_joint(py: Python<'_>, model: &phipsi::model::Model, name: &str) -> PyResult<usize> {
    let k = model.find_joint(name).map_err(|e| name_error(py, "name", &e))?;
    if model.joints()[k].kind == JointKind::Fixed {
        let message = format!("`name`: joint `{name}` is fixed: it has no coordinates");
        return Err(argument_error(py, "name", name.into(), "a moving joint".into(), &message, None));
    }
    Ok(k)
}
