//! A model with what recursions run on, shared by the calls of Python: its layout, the dynamics of its loops, the form that it needs;
//! how arguments are read and failures told in its words.

use crate::batch::{Argument, Batch};
use crate::errors::{Failure, argument_error, dynamics_error, name_error, potential_error};
use crate::lent::{Lent, Place};
use phipsi::closure::{ClosedDynamics, ClosedFormChoice, ClosureError};
use phipsi::model::JointKind;
use phipsi::recursion::batch::Input;
use phipsi::recursion::{Form, FormChoice, Layout};
use phipsi::spatial::{Vec3, Wrench};
use pyo3::exceptions::PyRuntimeWarning;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::borrow::Cow;
use std::sync::OnceLock;

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
    /// The same mechanism under another gravity, m/s², world axes.
    pub fn with_gravity(&self, g: [f64; 3]) -> Self {
        Compiled {
            model: self.model.clone().with_gravity(g),
            layout: self.layout.clone().with_gravity(Vec3(g)),
            weightless: OnceLock::new(),
            closed: OnceLock::new(),
            form: OnceLock::new(),
            closed_form: OnceLock::new(),
        }
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
        self.lent_q(object, name)?.settled(object.py(), self)
    }
    /// The same, large ones where they are.
    pub fn lent_q<'py>(&self, object: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Lent<'py>> {
        let (model, py) = (&self.model, object.py());
        let place: Place = Compiled::place_of_position;
        let q = Lent::read(object, name, &[model.nq()], "nq positions", (self, place))?;
        for k in model.moving_joints() {
            if !matches!(model.joints()[k].kind, JointKind::Spherical | JointKind::Free) {
                continue;
            }
            let end = model.q_range(k).end;
            for (state, x) in q.own_states() {
                let square: f64 = x[end - 4..].iter().take(4).map(|c| c * c).sum();
                if square == 0.0 || !square.is_finite() {
                    q.check(py, self)?;
                    let joint = &model.joints()[k].name;
                    let quantity = format!("`{name}`: squared length of the quaternion");
                    let at = format!("joint `{joint}`, component {}", end - 4 - model.q_offset(k));
                    let remedy = "a quaternion needs a length; the identity is (0, 0, 0, 1)";
                    let place = q.argument.place(state);
                    return Err(crate::batch::unfit(py, &quantity, &at, square, place, remedy));
                }
            }
        }
        Ok(q)
    }
    /// Reads velocities, accelerations, generalized forces.
    pub fn v(&self, object: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Argument> {
        self.lent_v(object, name)?.settled(object.py(), self)
    }
    /// The same, large ones where they are.
    pub fn lent_v<'py>(&self, object: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Lent<'py>> {
        let place: Place = Compiled::place_of_velocity;
        let meaning = "one number per degree of freedom, nv";
        Lent::read(object, name, &[self.model.nv()], meaning, (self, place))
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
