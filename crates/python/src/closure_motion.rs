//! Motions that closures are given: at an instant, and as functions of time.
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | γ, γ̇, γ̈ | position, velocity and acceleration of a row of a closure | rad, m and their rates |

use crate::batch::Argument;
use crate::compiled::Compiled;
use crate::errors::{argument_error, choice_error};
use crate::simulate::Raised;
use phipsi::closure::{ClosedDynamics, ClosureMotion, Conditions};
use phipsi::motion::{Course, MovingClosure, Prescription, Signal};
use phipsi_simulate::scene;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, PoisonError};

const ARGUMENT: &str = "closure_motion";

/// γ, γ̇, γ̈ of all rows at an instant; closures that are not named rest.
pub(crate) struct Instant(Option<[Vec<f64>; 3]>);

impl Instant {
    /// From {name: (3, rows)}.
    pub(crate) fn read(template: &ClosedDynamics<f64>, given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let Some(given) = given else { return Ok(Instant(None)) };
        let mut gamma: [Vec<f64>; 3] = std::array::from_fn(|_| vec![0.0; template.rows()]);
        for (name, motion) in given {
            let i = find(template, &name)?;
            let rows = template.closure(i).1;
            let read = rows_of(&motion, ARGUMENT, rows.len())?;
            for (gamma, part) in gamma.iter_mut().zip(read.chunks_exact(rows.len())) {
                gamma[rows.clone()].copy_from_slice(part);
            }
        }
        Ok(Instant(Some(gamma)))
    }
    pub(crate) fn motion(&self) -> Option<ClosureMotion<'_, f64>> {
        let [position, velocity, acceleration] = self.0.as_ref()?;
        Some(ClosureMotion { position, velocity, acceleration })
    }
    pub(crate) fn conditions(&self) -> Conditions<'_, f64> {
        Conditions { motion: self.motion(), ..Conditions::default() }
    }
}

/// The closure of a name.
fn find(template: &ClosedDynamics<f64>, name: &Bound<'_, PyAny>) -> PyResult<usize> {
    let text: String = name.extract()?;
    (0..template.closures()).find(|&i| template.closure(i).0 == text).ok_or_else(|| {
        let names: Vec<&str> = (0..template.closures()).map(|i| template.closure(i).0).collect();
        choice_error(name.py(), ARGUMENT, &text, &names)
    })
}

/// Position, velocity and acceleration of every row, (3, rows).
fn rows_of(
    object: &Bound<'_, PyAny>,
    name: impl Into<std::borrow::Cow<'static, str>>,
    rows: usize,
) -> PyResult<Vec<f64>> {
    let describe = |at: usize| {
        let what = ["position", "velocity", "acceleration"][at / rows.max(1) % 3];
        format!("{what} of row {}", at % rows.max(1))
    };
    let read = Argument::read(
        object,
        name,
        &[3, rows],
        "position, velocity and acceleration of every row",
        &describe,
    )?;
    crate::simulator::check_single(object.py(), &read)?;
    Ok(read.at(0).to_vec())
}

/// Motions of closures as functions of time, from {name: {direction: number or expression}} or {name: function of t}.
///
/// Kinks of expressions are looked for up to `t_end`. What a function raises goes into `raised`, and ends the run.
///
/// # Errors
/// `ArgumentError`; what a function raises at `t0`.
pub(crate) fn prescription(
    py: Python<'_>,
    compiled: &Compiled,
    given: Option<&Bound<'_, PyDict>>,
    (t0, t_end): (f64, f64),
    raised: &Raised,
) -> PyResult<Prescription> {
    let mut prescription = Prescription::default();
    let Some(given) = given else { return Ok(prescription) };
    let template = compiled.closed(py)?;
    for (name, motion) in given {
        let closure = find(template, &name)?;
        let rows = template.closure(closure).1.len();
        let mut add = |row, course| prescription.closures.push(MovingClosure { closure, row, course });
        if let Ok(directions) = motion.cast::<PyDict>() {
            for (direction, function) in directions {
                add(row_of(py, template, closure, &direction)?, course(&name, &direction, &function, t_end)?);
            }
        } else if motion.is_callable() {
            let sampled = Arc::new(Sampled {
                function: motion.unbind(),
                name: format!("the result of {ARGUMENT}[\"{name}\"]"),
                rows,
                raised: raised.clone(),
                last: Mutex::new((f64::NAN, Vec::new())),
            });
            sampled.evaluate(py, t0)?;
            for row in 0..rows {
                let of = |part: usize| {
                    let sampled = sampled.clone();
                    move |t| sampled.at(t, part * rows + row)
                };
                let position = Signal::function(of(0), of(1));
                add(row, Course::Position { position, velocity: Signal::function(of(1), of(2)) });
            }
        } else {
            let found = motion.get_type().to_string();
            let required = "a dict {direction: expression in t}, or a function of t";
            let message = format!("`{ARGUMENT}[\"{name}\"]` is {found}, but {required} is required");
            return Err(argument_error(py, ARGUMENT, found.into(), required.into(), &message, None));
        }
    }
    Ok(prescription)
}

/// The row that a word of scenes stands for: `x`, `rz`, `distance`.
fn row_of(
    py: Python<'_>,
    template: &ClosedDynamics<f64>,
    closure: usize,
    direction: &Bound<'_, PyAny>,
) -> PyResult<usize> {
    let word: String = direction.extract()?;
    let rows = template.closure(closure).1.len();
    let word_of = |row: usize| {
        let held = template.direction(closure, row);
        scene::DIRECTIONS.iter().find(|(_, direction)| *direction == held).map(|(word, _)| *word)
    };
    (0..rows).find(|&row| word_of(row) == Some(&word)).ok_or_else(|| {
        let words: Vec<&str> = (0..rows).filter_map(word_of).collect();
        choice_error(py, ARGUMENT, &word, &words)
    })
}

/// A row that follows a number or an expression in t.
fn course(
    name: &Bound<'_, PyAny>,
    direction: &Bound<'_, PyAny>,
    function: &Bound<'_, PyAny>,
    t_end: f64,
) -> PyResult<Course> {
    let py = function.py();
    let place = format!("`{ARGUMENT}[\"{name}\"][\"{direction}\"]`");
    if let Ok(text) = function.extract::<String>() {
        return scene::course(&text, t_end).map_err(|e| {
            let message = format!("{place} {e}");
            argument_error(py, ARGUMENT, text.into(), e.required.into(), &message, Some(e.remedy))
        });
    }
    match function.extract::<f64>() {
        Ok(x) if x.is_finite() => Ok(Course::locked(x)),
        _ => {
            let (found, required) =
                (function.repr()?.to_string(), "a finite number, or an expression in t as text");
            let message = format!("{place} is {found}, but {required} is required");
            Err(argument_error(py, ARGUMENT, found.into(), required.into(), &message, None))
        }
    }
}

/// A function of Python, kept at the time of its last call: every row asks for three numbers of one evaluation.
struct Sampled {
    function: Py<PyAny>,
    name: String,
    rows: usize,
    raised: Raised,
    last: Mutex<(f64, Vec<f64>)>,
}

impl Sampled {
    fn evaluate(&self, py: Python<'_>, t: f64) -> PyResult<Vec<f64>> {
        rows_of(&self.function.bind(py).call1((t,))?, self.name.clone(), self.rows)
    }
    /// One of the numbers; none after an exception, which ends the run.
    fn at(&self, t: f64, i: usize) -> f64 {
        // Not held while Python runs: two threads would wait for each other.
        let kept = |last: &(f64, Vec<f64>)| (last.0 == t).then(|| last.1[i]);
        if let Some(x) = kept(&self.last.lock().unwrap_or_else(PoisonError::into_inner)) {
            return x;
        }
        if self.raised.is_set() {
            return f64::NAN;
        }
        match Python::attach(|py| self.evaluate(py, t)) {
            Ok(all) => {
                let x = all[i];
                *self.last.lock().unwrap_or_else(PoisonError::into_inner) = (t, all);
                x
            }
            Err(e) => {
                self.raised.set(e);
                f64::NAN
            }
        }
    }
}
