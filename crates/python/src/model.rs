//! The class `Model`: loading, names, and the configuration space.

use crate::batch::{Argument, Batch};
use crate::errors::{
    Failure, argument_error, check_file, choice_error, dynamics_error, load_error, name_error,
    potential_error,
};
use crate::report::Report;
use phipsi::closure::{ClosedDynamics, ClosedFormChoice, ClosureError};
use phipsi::formats::urdf::{Mimic, UrdfOptions, read_urdf, read_urdf_file};
use phipsi::formats::{Loaded, Problem};
use phipsi::model::{Base, JointKind};
use phipsi::recursion::batch::Input;
use phipsi::recursion::{Form, FormChoice, Layout, singular_hinges};
use phipsi::spatial::{Vec3, Wrench};
use pyo3::exceptions::PyRuntimeWarning;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock, PoisonError, RwLock};

/// A model and its compiled form, both immutable.
pub struct Compiled {
    /// What the mechanism is.
    pub model: phipsi::model::Model,
    /// What the recursions run on.
    pub layout: Layout<f64>,
    /// The same without gravity, made when it is first asked for.
    weightless: OnceLock<Layout<f64>>,
    /// The dynamics of its loops, to be cloned; made when it is first asked for.
    closed: OnceLock<Result<ClosedDynamics<f64>, ClosureError>>,
    /// The form of forward dynamics that the model needs, measured when it is first asked for, and that of its loops.
    form: OnceLock<FormChoice>,
    closed_form: OnceLock<Result<ClosedFormChoice, ClosureError>>,
}

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
        *compiled = Arc::new(Compiled {
            model: compiled.model.clone().with_gravity(g),
            layout: compiled.layout.clone().with_gravity(Vec3(g)),
            weightless: OnceLock::new(),
            closed: OnceLock::new(),
            form: OnceLock::new(),
            closed_form: OnceLock::new(),
        });
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

/// What the numbers of a result are called in an error.
#[derive(Clone, Copy)]
pub enum Names {
    /// One per position coordinate.
    Position(&'static str),
    /// One per degree of freedom.
    Velocity(&'static str),
    /// A matrix with one column per degree of freedom.
    Columns(&'static str),
    /// Something else.
    Other(&'static str),
}

impl Compiled {
    /// Compiles a model.
    pub fn of(model: phipsi::model::Model) -> Self {
        let (layout, weightless) = (Layout::new(&model), OnceLock::new());
        let (closed, form, closed_form) = (OnceLock::new(), OnceLock::new(), OnceLock::new());
        Compiled { layout, model, weightless, closed, form, closed_form }
    }
    /// True if the model has closures or couplings.
    pub fn has_loops(&self) -> bool {
        self.layout.refusal().is_some()
    }
    /// The dynamics of its loops.
    ///
    /// # Errors
    /// `ModelError` for a coupling that cannot be.
    pub fn closed(&self, py: Python<'_>) -> PyResult<&ClosedDynamics<f64>> {
        let closed = self.closed.get_or_init(|| ClosedDynamics::new(&self.model));
        closed.as_ref().map_err(|e| crate::closure::closure_error(py, e, None))
    }
    /// The same in the form that runs when `form` is asked for, with its name; warns, once, where none is good enough for the model.
    ///
    /// # Errors
    /// `ArgumentError` for a form that loops do not have; as [`Compiled::closed`]; a warning that Python turns into an error.
    pub fn closed_in(
        &self,
        py: Python<'_>,
        form: Form,
    ) -> PyResult<(Cow<'_, ClosedDynamics<f64>>, &'static str)> {
        let failed = |e: &ClosureError| match e {
            ClosureError::Form { found } => {
                let allowed = [Form::Auto, Form::Plain, Form::SquareRoot].map(Form::name);
                crate::errors::choice_error(py, "form", found.name(), &allowed)
            }
            e => crate::closure::closure_error(py, e, None),
        };
        let measure = || ClosedFormChoice::new(&self.model, form);
        let choice = match (form, self.closed_form.get()) {
            (Form::Auto, Some(known)) => known.clone(),
            (Form::Auto, None) => {
                let measured = py.detach(|| self.closed_form.get_or_init(measure).clone());
                if let Some(choice) = measured.as_ref().ok().filter(|choice| !choice.is_sufficient()) {
                    let text =
                        std::ffi::CString::new(format!("forward dynamics: {choice}")).unwrap_or_default();
                    PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 1)?;
                }
                measured
            }
            _ => measure(),
        };
        let choice = choice.map_err(|e| failed(&e))?;
        let closed = self.closed(py)?;
        if choice.form == closed.form() {
            return Ok((Cow::Borrowed(closed), choice.name()));
        }
        let closed = closed.clone().with_form(choice.form).map_err(|e| failed(&e))?;
        Ok((Cow::Owned(closed), choice.name()))
    }
    /// The layout without gravity.
    pub fn weightless(&self) -> &Layout<f64> {
        self.weightless.get_or_init(|| self.layout.clone().with_gravity(Vec3::zero()))
    }
    /// The form that runs when `form` is asked for; warns, once, where none is good enough for the model.
    ///
    /// # Errors
    /// A warning that Python turns into an error.
    pub fn form(&self, py: Python<'_>, form: Form) -> PyResult<Form> {
        if form != Form::Auto {
            return Ok(form);
        }
        if let Some(choice) = self.form.get() {
            return Ok(choice.form);
        }
        let choice = py.detach(|| *self.form.get_or_init(|| FormChoice::of(&self.model, &self.layout)));
        if !choice.is_sufficient() {
            let text = std::ffi::CString::new(format!("forward dynamics: {choice}")).unwrap_or_default();
            PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 1)?;
        }
        Ok(choice.form)
    }
    /// Reads configurations; quaternions of length zero are refused.
    pub fn q(&self, object: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Argument> {
        let model = &self.model;
        let describe = |i: usize| self.place_of_position(i);
        let q = Argument::read(object, name, &[model.nq()], "nq positions", &describe)?;
        for k in model.moving_joints() {
            if !matches!(model.joints()[k].kind, JointKind::Spherical | JointKind::Free) {
                continue;
            }
            let end = model.q_range(k).end;
            for (state, x) in q.own_states() {
                let square: f64 = x[end - 4..].iter().take(4).map(|c| c * c).sum();
                if square == 0.0 || !square.is_finite() {
                    let joint = &model.joints()[k].name;
                    let quantity = format!("`{name}`: squared length of the quaternion");
                    let at = format!("joint `{joint}`, component {}", end - 4 - model.q_offset(k));
                    let remedy = "a quaternion needs a length; the identity is (0, 0, 0, 1)";
                    let py = object.py();
                    return Err(crate::batch::unfit(py, &quantity, &at, square, q.place(state), remedy));
                }
            }
        }
        Ok(q)
    }
    /// Reads velocities, accelerations, generalized forces.
    pub fn v(&self, object: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Argument> {
        let describe = |i: usize| self.place_of_velocity(i);
        let meaning = "one number per degree of freedom, nv";
        Argument::read(object, name, &[self.model.nv()], meaning, &describe)
    }
    /// Reads points or vectors of the world or of a body.
    pub fn point(&self, object: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Argument> {
        let describe = |i: usize| format!("axis {}", ["x", "y", "z"][i]);
        Argument::read(object, name, &[3], "x, y, z in m", &describe)
    }
    /// Index of a body; `None` is the world.
    pub fn body(&self, py: Python<'_>, name: &str) -> PyResult<Option<usize>> {
        self.model.find_body(name).map_err(|e| name_error(py, "body", &e))
    }
    /// Reads external wrenches, {body: (…, 6)}.
    pub fn wrenches(&self, object: Option<&Bound<'_, PyAny>>) -> PyResult<Wrenches> {
        let mut wrenches = Wrenches { bodies: Vec::new(), arguments: Vec::new(), len: self.model.len() };
        let Some(object) = object else { return Ok(wrenches) };
        let py = object.py();
        let Ok(dict) = object.cast::<PyDict>() else {
            let found = object.get_type().to_string();
            let message = format!("`wrenches` is {found}, but a dict {{body: (…, 6)}} is required");
            let required = "a dict {body: (…, 6)}".into();
            return Err(argument_error(py, "wrenches", found.into(), required, &message, None));
        };
        for (key, value) in dict {
            let body: String = key.extract()?;
            let index = self.model.find_body(&body).map_err(|e| name_error(py, "wrenches", &e))?;
            let Some(index) = index else {
                let message = "`wrenches`: a wrench on `world` moves nothing";
                let required = "the name of a body".into();
                return Err(argument_error(py, "wrenches", "world".into(), required, message, None));
            };
            let describe = |i: usize| {
                ["moment x", "moment y", "moment z", "force x", "force y", "force z"][i].to_string()
            };
            let meaning = "moment, then force, at the body frame's origin, body axes";
            let name = format!("wrenches[\"{body}\"]");
            wrenches.arguments.push(Argument::read(&value, name, &[6], meaning, &describe)?);
            wrenches.bodies.push(index);
        }
        Ok(wrenches)
    }
    /// "joint `elbow`, component 0".
    pub fn place_of_velocity(&self, i: usize) -> String {
        if let Some(mode) = i.checked_sub(self.model.joint_nv()) {
            return format!("mode `{}`", self.model.mode_names().nth(mode).unwrap_or_default());
        }
        let (joint, component) = self.model.joint_of_velocity(i);
        format!("joint `{}`, component {component}", self.model.joints()[joint].name)
    }
    fn place_of_position(&self, i: usize) -> String {
        let model = &self.model;
        if let Some(mode) = i.checked_sub(model.joint_nq()) {
            return format!("mode `{}`", model.mode_names().nth(mode).unwrap_or_default());
        }
        let joint = model.moving_joints().find(|&k| model.q_range(k).contains(&i));
        joint.map_or(String::new(), |k| {
            format!("joint `{}`, component {}", model.joints()[k].name, i - model.q_offset(k))
        })
    }
    /// The results of a batch as an array, or the failure of its first state that failed.
    pub fn result<'py>(
        &self,
        py: Python<'py>,
        batch: &Batch,
        out: Result<Vec<f64>, (usize, Failure)>,
        names: Names,
        core: &[usize],
    ) -> PyResult<Bound<'py, PyAny>> {
        batch.array(py, out.map_err(|e| self.failure(py, batch, e, names))?, core)
    }
    /// A failure as a Python exception.
    pub fn failure(&self, py: Python<'_>, batch: &Batch, failure: (usize, Failure), names: Names) -> PyErr {
        let (state, failure) = failure;
        let place = batch.place(state);
        let (i, found) = match failure {
            Failure::Dynamics(e) => return dynamics_error(py, &e, place),
            Failure::Closure(e) => return crate::closure::closure_error(py, &e, place),
            Failure::Potential(e) => return potential_error(py, &e, &e.to_string(), place),
            Failure::NotFinite(i, found) => (i, found),
        };
        let (quantity, at) = match names {
            Names::Position(x) => (x, Some(self.place_of_position(i))),
            Names::Velocity(x) => (x, Some(self.place_of_velocity(i))),
            Names::Columns(x) => (x, Some(self.place_of_velocity(i % self.model.nv().max(1)))),
            Names::Other(x) => (x, None),
        };
        let remedy = "look for inputs so large that products overflow, and for masses that are zero";
        crate::batch::not_finite(py, quantity, at.as_deref(), found, place, remedy)
    }
}

/// External wrenches of a batch.
pub struct Wrenches {
    /// The bodies that have any.
    pub bodies: Vec<usize>,
    /// One for each of them.
    pub arguments: Vec<Argument>,
    len: usize,
}

impl Wrenches {
    /// The inputs of a kernel: these arguments, then the wrenches.
    pub fn inputs<'a>(&'a self, arguments: [&'a Argument; 3]) -> Vec<Input<'a>> {
        arguments.into_iter().chain(&self.arguments).map(Argument::input).collect()
    }
    /// Scratch for one state.
    pub fn workspace(&self) -> Vec<Wrench<f64>> {
        if self.bodies.is_empty() { Vec::new() } else { vec![Wrench::zero(); self.len] }
    }
    /// The wrenches of one state, if there are any.
    pub fn at<'a>(&self, state: usize, scratch: &'a mut [Wrench<f64>]) -> Option<&'a [Wrench<f64>]> {
        for (body, argument) in self.bodies.iter().zip(&self.arguments) {
            let x = argument.at(state);
            scratch[*body] = Wrench::from_array(std::array::from_fn(|i| x[i]));
        }
        (!self.bodies.is_empty()).then_some(scratch)
    }
}
