//! Functions of time: numbers, expressions in t, tables of (time, value) points.

use super::tree::{Node, Table, Value, finite, number_list, shorten};
use phipsi_formats::Report;
use phipsi_formats::expression::Expression;
use phipsi_motion::Signal;
use std::f64::consts::PI;

const REQUIRED: &str = "a number, an expression in t in quotes, or a table [[time, value], …]";

/// The function of time under a key.
pub(crate) fn read(table: &mut Table<'_>, key: &'static str, report: &mut Report) -> Option<Signal> {
    let node = table.get(key)?;
    from_node(table, key, node, report)
}

/// The function of time under a key that must be there.
pub(crate) fn required(table: &mut Table<'_>, key: &'static str, report: &mut Report) -> Option<Signal> {
    table.required(key, report, REQUIRED)?;
    read(table, key, report)
}

/// Three functions of time; zeros where the key is missing.
pub(crate) fn three(table: &mut Table<'_>, key: &'static str, report: &mut Report) -> Option<[Signal; 3]> {
    let zero = || Signal::Constant(0.0);
    let Some(node) = table.get(key) else { return Some([zero(), zero(), zero()]) };
    let required = "three functions of time in brackets";
    match &node.value {
        Value::List(items) if items.len() == 3 => {
            let read: Vec<Signal> =
                items.iter().filter_map(|item| from_node(table, key, item, report)).collect();
            <[Signal; 3]>::try_from(read).ok()
        }
        other => {
            let found = format!("{key} = {}", other.describe());
            table.error(Some(node), report, found, required, format!("correct `{key}`"));
            None
        }
    }
}

fn from_node(table: &Table<'_>, key: &str, node: &Node, report: &mut Report) -> Option<Signal> {
    let mut wrong = |found: String, required: &str, remedy: String| {
        table.error(Some(node), report, found, required, remedy);
        None
    };
    match &node.value {
        Value::Text(text) => match expression(text) {
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

/// An expression in t with its symbolic derivative.
fn expression(text: &str) -> Result<Signal, String> {
    let value = Expression::parse(text, &["t"], &[("pi", PI)]).map_err(|e| e.to_string())?;
    let rate = value.derivative("t");
    if !value.value(&[0.0]).is_finite() && !value.value(&[1e-3]).is_finite() {
        return Err("it is not finite at t = 0".into());
    }
    Ok(Signal::function(move |t| value.value(&[t]), move |t| rate.value(&[t])))
}
