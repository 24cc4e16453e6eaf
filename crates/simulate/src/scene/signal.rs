//! Functions of time: numbers, expressions in t, tables of (time, value) points.

use super::tree::{Node, Table, Value, finite, number_list, shorten};
use phipsi_formats::Report;
use phipsi_formats::expression::Expression;
use phipsi_motion::{Course, Signal};
use std::f64::consts::PI;
use std::fmt;

const REQUIRED: &str = "a number, an expression in t in quotes, or a table [[time, value], …]";

const REQUIRED_COURSE: &str = "a number, or an expression in t with a continuous rate";

/// The function of time under a key that must be there. `t_end`: kinks and jumps are looked for up to this time.
pub(crate) fn required(
    table: &mut Table<'_>,
    key: &'static str,
    t_end: f64,
    report: &mut Report,
) -> Option<Signal> {
    let node = table.required(key, report, REQUIRED)?;
    from_node(table, key, node, t_end, report)
}

/// Three functions of time; zeros where the key is missing.
pub(crate) fn three(
    table: &mut Table<'_>,
    key: &'static str,
    t_end: f64,
    report: &mut Report,
) -> Option<[Signal; 3]> {
    let zero = || Signal::Constant(0.0);
    let Some(node) = table.get(key) else { return Some([zero(), zero(), zero()]) };
    let required = "three functions of time in brackets";
    match &node.value {
        Value::List(items) if items.len() == 3 => {
            let read: Vec<Signal> =
                items.iter().filter_map(|item| from_node(table, key, item, t_end, report)).collect();
            <[Signal; 3]>::try_from(read).ok()
        }
        other => {
            let found = format!("{key} = {}", other.describe());
            table.error(Some(node), report, found, required, format!("correct `{key}`"));
            None
        }
    }
}

fn from_node(table: &Table<'_>, key: &str, node: &Node, t_end: f64, report: &mut Report) -> Option<Signal> {
    let mut wrong = |found: String, required: &str, remedy: String| {
        table.error(Some(node), report, found, required, remedy);
        None
    };
    match &node.value {
        Value::Text(text) => match expression(text, t_end) {
            Ok(signal) => Some(signal),
            Err(message) => {
                let found = format!("{key} = {:?}: {message}", shorten(text));
                wrong(found, "an expression in t, constant pi", "correct the expression".into())
            }
        },
        Value::List(items) => {
            let points: Option<Vec<(f64, f64)>> =
                items.iter().map(|p| number_list(p).filter(|p| p.len() == 2).map(|p| (p[0], p[1]))).collect();
            match points.map(Signal::table) {
                Some(Ok(signal)) => Some(signal),
                Some(Err(e)) => wrong(format!("{key}: {e}"), "increasing times", "sort the points".into()),
                None => {
                    wrong(format!("{key} = {}", node.value.describe()), REQUIRED, format!("correct `{key}`"))
                }
            }
        }
        other => match finite(node) {
            Some(x) => Some(Signal::Constant(x)),
            None => wrong(format!("{key} = {}", other.describe()), REQUIRED, format!("correct `{key}`")),
        },
    }
}

/// The course of a coordinate under a key: a function of time whose rate is continuous, or a number at which it is locked.
pub(crate) fn position(
    table: &mut Table<'_>,
    key: &'static str,
    t_end: f64,
    report: &mut Report,
) -> Option<Course> {
    let node = table.get(key)?;
    course_from_node(table, key, node, t_end, report)
}

/// The same of a value.
pub(crate) fn course_from_node(
    table: &Table<'_>,
    key: &str,
    node: &Node,
    t_end: f64,
    report: &mut Report,
) -> Option<Course> {
    if let Value::List(_) = node.value {
        let remedy = "give the velocity as a table, or the position as an expression";
        let found = format!("{key} is a table, whose rate jumps");
        table.error(Some(node), report, found, REQUIRED_COURSE, remedy);
        return None;
    }
    let Value::Text(text) = &node.value else {
        let position = from_node(table, key, node, t_end, report)?;
        return Some(Course::Position { position, velocity: Signal::Constant(0.0) });
    };
    match course(text, t_end) {
        Ok(course) => Some(course),
        Err(e) => {
            let found = format!("{key} {}", e.found);
            table.error(Some(node), report, found, e.required, e.remedy);
            None
        }
    }
}

/// Why a text is not the course of a coordinate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CourseError {
    /// What is wrong with it.
    pub found: String,
    /// What it must be.
    pub required: &'static str,
    /// What to do.
    pub remedy: &'static str,
}

impl fmt::Display for CourseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, but {} is required; {}", self.found, self.required, self.remedy)
    }
}

impl std::error::Error for CourseError {}

/// A coordinate that follows an expression in t, with its first and second derivatives; kinks and jumps are looked for from 0 to
/// `t_end`, s.
///
/// # Errors
/// [`CourseError`]: the text is no expression in t, or its value or its rate jumps.
///
/// # Example
/// ```
/// let course = phipsi_simulate::scene::course("0.5*t^2", 1.0)?;
/// assert_eq!((course.position(1.0), course.velocity(1.0), course.acceleration(1.0)), (Some(0.5), Some(1.0), 1.0));
/// assert!(phipsi_simulate::scene::course("abs(t - 0.5)", 1.0).is_err());
/// # Ok::<(), phipsi_simulate::scene::CourseError>(())
/// ```
pub fn course(text: &str, t_end: f64) -> Result<Course, CourseError> {
    let wrong = |message: String| CourseError {
        found: format!("= {:?}: {message}", shorten(text)),
        required: "an expression in t, constant pi",
        remedy: "correct the expression",
    };
    let position = expression(text, t_end).map_err(wrong)?;
    let value = Expression::parse(text, &["t"], &[("pi", PI)]).map_err(|e| wrong(e.to_string()))?;
    let (rate, breaks) = (value.derivative("t"), position.breaks());
    let second = rate.derivative("t");
    let velocity =
        Signal::function(move |t| rate.value(&[t]), move |t| second.value(&[t])).with_breaks(breaks);
    for (signal, what) in [(&position, "jumps"), (&velocity, "has a rate that jumps")] {
        if let Some(t) = jump(signal) {
            let remedy = "round the corner, for example with 3*s^2 - 2*s^3";
            return Err(CourseError {
                found: format!("{what} at t = {t}"),
                required: REQUIRED_COURSE,
                remedy,
            });
        }
    }
    Ok(Course::Position { position, velocity })
}

/// The velocity of a coordinate under a key: continuous.
pub(crate) fn velocity(
    table: &mut Table<'_>,
    key: &'static str,
    t_end: f64,
    report: &mut Report,
) -> Option<Course> {
    let node = table.get(key)?;
    let signal = from_node(table, key, node, t_end, report)?;
    if let Some(t) = jump(&signal) {
        let (found, remedy) = (format!("{key} jumps at t = {t}"), "join the values by a short ramp");
        table.error(Some(node), report, found, "a continuous function of time", remedy);
        return None;
    }
    Some(Course::Velocity(signal))
}

/// The acceleration of a coordinate under a key; it may jump.
pub(crate) fn acceleration(
    table: &mut Table<'_>,
    key: &'static str,
    t_end: f64,
    report: &mut Report,
) -> Option<Course> {
    let node = table.get(key)?;
    Some(Course::Acceleration(from_node(table, key, node, t_end, report)?))
}

/// The first time at which a function jumps by more than rounding.
fn jump(signal: &Signal) -> Option<f64> {
    signal.breaks().into_iter().find(|&t| {
        let (before, after) = (signal.value(t.next_down()), signal.value(t));
        let difference = (after - before).abs();
        difference.is_nan() || difference > 1e-9 * (1.0 + before.abs().max(after.abs()))
    })
}

/// Intervals in which changes of sign are looked for.
const LOOKS: u32 = 20_000;

/// An expression in t with its symbolic derivative and the times at which it is not smooth.
fn expression(text: &str, t_end: f64) -> Result<Signal, String> {
    let value = Expression::parse(text, &["t"], &[("pi", PI)]).map_err(|e| e.to_string())?;
    let rate = value.derivative("t");
    if !value.value(&[0.0]).is_finite() && !value.value(&[1e-3]).is_finite() {
        return Err("it is not finite at t = 0".into());
    }
    let mut breaks: Vec<f64> = value.switches().iter().flat_map(|s| sign_changes(s, t_end)).collect();
    breaks.sort_by(f64::total_cmp);
    breaks.dedup();
    Ok(Signal::function(move |t| value.value(&[t]), move |t| rate.value(&[t])).with_breaks(breaks))
}

/// First times of the new sign, to the last bit. Changes closer than t_end/20000 may be missed: steps are then cut there by
/// their error control.
fn sign_changes(f: &Expression, t_end: f64) -> Vec<f64> {
    let is_positive = |t: f64| f.value(&[t]) >= 0.0;
    let time = |i: u32| t_end * f64::from(i) / f64::from(LOOKS);
    let mut found = Vec::new();
    let mut before = is_positive(0.0);
    for i in 1..=LOOKS {
        let now = is_positive(time(i));
        if now != before {
            let (mut low, mut high) = (time(i - 1), time(i));
            loop {
                let middle = 0.5 * (low + high);
                if middle <= low || middle >= high {
                    break;
                }
                if is_positive(middle) == before { low = middle } else { high = middle }
            }
            found.push(high);
            before = now;
        }
    }
    found
}
