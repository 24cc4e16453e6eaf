//! A finite element model in files: matrices in Matrix Market's format, nodes in a table.

use super::{Files, count};
use crate::scene::SceneFile;
use crate::scene::tree::{Table, Value, suggestion};
use phipsi_formats::matrix_market::{MarketMatrix, read_matrix_market_file};
use phipsi_formats::node_table::{NodeTable, read_nodes_file};
use phipsi_formats::{Loaded, Note, Problem, Report};
use phipsi_model::{CraigBampton, FlexibleBody, InterfaceNode, KeptModes, SymmetricMatrix};

/// Most modes with clamped interfaces.
const MOST_MODES: usize = 200;

/// Reads `mass`, `stiffness`, `nodes`, `inboard`, `interface`, `modes` or `shapes`, `damping`.
pub(super) fn read(
    table: &mut Table<'_>,
    (name, index): (&str, usize),
    files: &mut Files<'_>,
    report: &mut Report,
) -> Option<FlexibleBody> {
    let before = report.errors.len();
    let mass = matrix("mass", table, index, files, report);
    let stiffness = matrix("stiffness", table, index, files, report);
    let nodes: Option<NodeTable> = {
        table.required("nodes", report, "a file: label, x, y, z of every node");
        file("nodes", table, index, files, report, read_nodes_file)
    };
    let inboard = labels("inboard", table, nodes.as_ref(), report);
    let interface = labels("interface", table, nodes.as_ref(), report);
    let shapes: Option<MarketMatrix> = file("shapes", table, index, files, report, read_matrix_market_file);
    let modes = match (table.number("modes", report), shapes) {
        (Some(_), Some(_)) => {
            let found = "both `modes` and `shapes`";
            table.error(None, report, found, "one of the two", "remove `modes`: the given shapes are taken");
            None
        }
        (_, Some(shapes)) => dense(table, &shapes, report).map(KeptModes::Given),
        (modes, None) => {
            Some(KeptModes::Lowest(count(modes.unwrap_or(6.0), "modes", MOST_MODES, table, report)))
        }
    };
    let damping = table.positive("damping", true, report).unwrap_or_default();
    if inboard.is_empty() && table.has("inboard") && nodes.is_some() {
        table.error(
            None,
            report,
            "no inboard node",
            "at least one label",
            "name the nodes that the joint holds",
        );
    }
    table.required("inboard", report, "labels of the nodes that the body's joint holds");
    if report.errors.len() > before {
        return None;
    }
    let nodes = nodes?;
    let named = |&(k, ref label): &(usize, String)| InterfaceNode { name: label.clone(), index: k };
    let elements = CraigBampton {
        mass: mass?,
        stiffness: stiffness?,
        positions: nodes.positions,
        inboard: inboard.iter().map(|x| x.0).collect(),
        outboard: interface.iter().map(named).collect(),
        modes: modes?,
    };
    match elements.reduce(name) {
        Ok((body, found)) => {
            let place = || format!("body `{name}`");
            report.used.push(Note::new(table.line, place(), found.to_string()));
            if found.lumped {
                let what = "products of shapes are taken with masses lumped at the nodes";
                report.approximated.push(Note::new(table.line, place(), what));
            }
            if elements.mass.size() == 3 * elements.positions.len() && !elements.outboard.is_empty() {
                let what = "nodes without rotations: what is attached there does not turn with them";
                report.approximated.push(Note::new(table.line, place(), what));
            }
            let damping = body.stiffness.iter().map(|k| damping * k).collect();
            Some(body.damped(damping))
        }
        Err(errors) => {
            report.errors.extend(
                errors
                    .0
                    .into_iter()
                    .map(|v| Problem::new(table.line, v.subject.to_string(), v.found, v.required, v.remedy)),
            );
            None
        }
    }
}

/// The value in the file that a key names; notes and problems of the file are in a report of its own.
fn file<T>(
    key: &'static str,
    table: &mut Table<'_>,
    index: usize,
    files: &mut Files<'_>,
    report: &mut Report,
    reader: impl Fn(&std::path::Path) -> Loaded<T>,
) -> Option<T> {
    let path = files.folder.join(table.text(key, report)?);
    let Loaded { value, report: read } = reader(&path);
    if value.is_none() {
        let (found, place) =
            (format!("{key} = {:?} cannot be used", path.display().to_string()), table.get(key));
        table.error(place, report, found, "a file without errors", "see the errors of that file");
    }
    files.reports.push(read);
    files.read.push(SceneFile { key: format!("body.{index}.flexible.{key}"), path });
    value
}

fn matrix(
    key: &'static str,
    table: &mut Table<'_>,
    index: usize,
    files: &mut Files<'_>,
    report: &mut Report,
) -> Option<SymmetricMatrix> {
    table.required(key, report, "a file in Matrix Market's format");
    let read = file(key, table, index, files, report, read_matrix_market_file)?;
    match read.to_symmetric() {
        Ok(matrix) => Some(matrix),
        Err(e) => {
            let found = format!("{key}: {e}");
            let node = table.get(key);
            table.error(node, report, found, "a symmetric matrix", "correct the file");
            None
        }
    }
}

/// All numbers of a matrix.
fn dense(
    table: &mut Table<'_>,
    matrix: &MarketMatrix,
    report: &mut Report,
) -> Option<nalgebra::DMatrix<f64>> {
    let numbers = matrix.to_columns();
    if numbers.is_none() {
        let found = format!("shapes of {}×{}", matrix.rows, matrix.columns);
        table.error(None, report, found, "at most 2^28 numbers", "keep fewer shapes");
    }
    Some(nalgebra::DMatrix::from_vec(matrix.rows, matrix.columns, numbers?))
}

/// Labels of nodes, as texts or whole numbers, with their places in the table.
fn labels(
    key: &'static str,
    table: &mut Table<'_>,
    nodes: Option<&NodeTable>,
    report: &mut Report,
) -> Vec<(usize, String)> {
    let Some(node) = table.get(key) else { return Vec::new() };
    let items = match &node.value {
        Value::List(items) => &items[..],
        _ => std::slice::from_ref(node),
    };
    let mut found = Vec::new();
    for item in items {
        let label = match &item.value {
            Value::Text(label) => label.clone(),
            Value::Integer(label) => label.to_string(),
            other => {
                let what = format!("{key}: {}", other.describe());
                table.error(
                    Some(item),
                    report,
                    what,
                    "labels of nodes, texts or whole numbers",
                    "correct it",
                );
                continue;
            }
        };
        let Some(nodes) = nodes else { continue };
        match nodes.find(&label) {
            Some(k) => found.push((k, label)),
            None => {
                let known: Vec<&str> = nodes.labels.iter().take(1000).map(String::as_str).collect();
                let remedy = suggestion(&label, &known);
                table.error(
                    Some(item),
                    report,
                    format!("node `{label}`"),
                    "a label of the table of nodes",
                    remedy,
                );
            }
        }
    }
    found
}
