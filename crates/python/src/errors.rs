//! Rust errors as the Python classes of `phipsi.errors`, with their fields.

use crate::report::{Problem, Report};
use phipsi::closure::ClosureError;
use phipsi::molecule::PotentialError;
use phipsi::recursion::DynamicsError;
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::Path;

/// A field of an exception.
pub enum Field {
    /// Text.
    Text(String),
    /// A number.
    Number(f64),
    /// An index.
    Index(usize),
    /// A shape, a place in a batch, or atoms.
    Tuple(Vec<usize>),
    /// A report.
    Report(Report),
    /// Problems.
    Problems(Vec<Problem>),
}

impl Field {
    fn into_object(self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        match self {
            Field::Text(x) => x.into_py_any(py),
            Field::Number(x) => x.into_py_any(py),
            Field::Index(x) => x.into_py_any(py),
            Field::Tuple(x) => pyo3::types::PyTuple::new(py, x)?.into_py_any(py),
            Field::Report(x) => x.into_py_any(py),
            Field::Problems(x) => x.into_py_any(py),
        }
    }
}

impl From<&str> for Field {
    fn from(x: &str) -> Self {
        Field::Text(x.into())
    }
}

impl From<String> for Field {
    fn from(x: String) -> Self {
        Field::Text(x)
    }
}

/// An exception of a class of `phipsi.errors`; fields that are `None` keep the class's default.
pub fn exception(py: Python<'_>, class: &str, message: &str, fields: Vec<(&str, Option<Field>)>) -> PyErr {
    let build = || -> PyResult<PyErr> {
        let keywords = PyDict::new(py);
        for (name, field) in fields {
            if let Some(field) = field {
                keywords.set_item(name, field.into_object(py)?)?;
            }
        }
        let class = py.import("phipsi.errors")?.getattr(class)?;
        Ok(PyErr::from_value(class.call((message,), Some(&keywords))?))
    };
    build().unwrap_or_else(|error| error)
}

/// `ArgumentError`: an argument, what it is, what it should be.
pub fn argument_error(
    py: Python<'_>,
    argument: &str,
    found: Field,
    required: Field,
    message: &str,
    remedy: Option<&str>,
) -> PyErr {
    let fields = vec![
        ("argument", Some(argument.into())),
        ("found", Some(found)),
        ("required", Some(required)),
        ("remedy", remedy.map(Field::from)),
    ];
    exception(py, "ArgumentError", message, fields)
}

/// `ArgumentError` for a word that is none of the choices.
pub fn choice_error(py: Python<'_>, argument: &str, found: &str, choices: &[&str]) -> PyErr {
    let choices = choices.iter().map(|c| format!("\"{c}\"")).collect::<Vec<_>>().join(", ");
    let message = format!("`{argument}` is \"{found}\"; there are: {choices}");
    argument_error(py, argument, found.into(), choices.into(), &message, None)
}

/// `OSError` for a file that cannot be opened.
pub fn check_file(path: &Path) -> PyResult<()> {
    let Err(e) = std::fs::metadata(path) else { return Ok(()) };
    let text = e.to_string();
    let reason = text.split(" (os error").next().unwrap_or_default().to_string();
    Err(PyOSError::new_err((e.raw_os_error(), reason, path.as_os_str().to_os_string())))
}

/// `ModelError` with the report on files that cannot be used.
pub fn load_error(py: Python<'_>, report: Report) -> PyErr {
    let mut message = report.text().to_string();
    if report.errors.is_empty() {
        message = format!("warnings are errors, as strict = True\n{message}");
    }
    let (errors, warnings) = (report.errors.clone(), report.warnings.clone());
    let fields = vec![
        ("errors", Some(Field::Problems(errors))),
        ("warnings", Some(Field::Problems(warnings))),
        ("report", Some(Field::Report(report))),
    ];
    exception(py, "ModelError", message.trim_end(), fields)
}

/// `ModelError` with what is wrong with a model that was put together.
pub fn violations_error(py: Python<'_>, errors: &phipsi::model::ModelErrors) -> PyErr {
    let problem = |v: &phipsi::model::Violation| Problem {
        source: None,
        line: None,
        place: v.subject.to_string(),
        found: v.found.clone(),
        required: v.required.clone(),
        remedy: v.remedy.clone(),
    };
    let problems = errors.0.iter().map(problem).collect();
    exception(py, "ModelError", &errors.to_string(), vec![("errors", Some(Field::Problems(problems)))])
}

/// `ArgumentError` for a name that the model does not have.
pub fn name_error(py: Python<'_>, argument: &str, error: &phipsi::model::NameError) -> PyErr {
    let required = format!("the name of a {}: {}", error.what, error.known.join(", "));
    let message = format!("`{argument}`: {error}");
    argument_error(py, argument, error.name.as_str().into(), required.into(), &message, None)
}

/// What failed at one state.
#[derive(Clone, Debug)]
pub enum Failure {
    /// A recursion.
    Dynamics(DynamicsError),
    /// Closed loops.
    Closure(ClosureError),
    /// A force field.
    Potential(PotentialError),
    /// A number of the result, by its index, that is not finite.
    NotFinite(usize, f64),
}

impl From<DynamicsError> for Failure {
    fn from(e: DynamicsError) -> Self {
        match e {
            DynamicsError::NotFinite { index, found } => Failure::NotFinite(index, found),
            e => Failure::Dynamics(e),
        }
    }
}

impl From<PotentialError> for Failure {
    fn from(e: PotentialError) -> Self {
        Failure::Potential(e)
    }
}

/// A force field's error with its atoms, at a place in the batch; `message` names the atoms.
pub fn potential_error(
    py: Python<'_>,
    error: &PotentialError,
    message: &str,
    state: Option<Vec<usize>>,
) -> PyErr {
    let at = state.as_ref().map(|s| format!("state {s:?}: ")).unwrap_or_default();
    let fields = vec![
        ("quantity", Some("energy or force".into())),
        ("term", Some(error.term.as_str().into())),
        ("atoms", Some(Field::Tuple(error.atoms.clone()))),
        ("required", Some("finite numbers".into())),
        (
            "remedy",
            Some("separate atoms that coincide, and atoms 1-2-3 of a torsion that lie on a line".into()),
        ),
        ("state", state.map(Field::Tuple)),
    ];
    exception(py, "NumericalError", &format!("{at}{message}"), fields)
}

/// A recursion's error, at a place in the batch (`None` without batch axes).
pub fn dynamics_error(py: Python<'_>, error: &DynamicsError, state: Option<Vec<usize>>) -> PyErr {
    match error {
        DynamicsError::SingularHinge { joint, component, inertia } => {
            let at = state.as_ref().map(|s| format!("state {s:?}: ")).unwrap_or_default();
            let remedy = "give the bodies outboard of it mass away from its axis, or make it fixed";
            let fields = vec![
                ("quantity", Some("articulated inertia".into())),
                ("joint", Some(joint.as_str().into())),
                ("component", Some(Field::Index(*component))),
                ("found", Some(Field::Number(*inertia))),
                ("required", Some("a positive number".into())),
                ("remedy", Some(remedy.into())),
                ("state", state.map(Field::Tuple)),
            ];
            exception(py, "NumericalError", &format!("{at}{error}"), fields)
        }
        DynamicsError::Closure { joint, source } => {
            let problem = Problem {
                source: None,
                line: None,
                place: format!("joint `{joint}`"),
                found: format!("a mimic of joint `{source}`"),
                required: "a tree".into(),
                remedy: "load the model with mimic = \"free\" to let the joint move freely".into(),
            };
            let fields = vec![("errors", Some(Field::Problems(vec![problem])))];
            exception(py, "ModelError", &error.to_string(), fields)
        }
        DynamicsError::Loop { closure } => {
            let problem = Problem {
                source: None,
                line: None,
                place: format!("closure `{closure}`"),
                found: "a loop".into(),
                required: "a tree".into(),
                remedy: "ask the model without closures".into(),
            };
            let fields = vec![("errors", Some(Field::Problems(vec![problem])))];
            exception(py, "ModelError", &error.to_string(), fields)
        }
        other => exception(py, "ArgumentError", &other.to_string(), vec![]),
    }
}
