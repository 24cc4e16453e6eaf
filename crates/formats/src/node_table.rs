//! Nodes of finite element models: a table of labels and coordinates.
//!
//! A line is `label, x, y, z`, in m, separated by commas, semicolons or blanks; nodes in the order of the matrices. A first line
//! that has no numbers is a heading; lines that begin with # are without effect.

use crate::file::read_text;
use crate::matrix_market::{real, shorten};
use crate::report::{Loaded, Problem, Report};
use std::collections::HashMap;
use std::path::Path;

/// Most problems that are reported of a file.
const MOST_PROBLEMS: usize = 20;

/// Nodes in the order of the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeTable {
    /// Their labels, each once.
    pub labels: Vec<String>,
    /// Their coordinates, m.
    pub positions: Vec<[f64; 3]>,
}

impl NodeTable {
    /// The index of a label.
    pub fn find(&self, label: &str) -> Option<usize> {
        self.labels.iter().position(|x| x == label)
    }
}

/// Reads a table of nodes.
pub fn read_nodes_file(path: &Path) -> Loaded<NodeTable> {
    let source = path.display().to_string();
    match read_text(path, "a table of nodes") {
        Ok(text) => read_nodes(&text, &source),
        Err(problem) => {
            let mut report = Report::new(source);
            report.errors.push(problem);
            Loaded { value: None, report }
        }
    }
}

/// Reads the text of a table of nodes; `source` is its name in the report.
///
/// # Example
/// ```
/// use phipsi_formats::node_table::read_nodes;
/// let (nodes, _) = read_nodes("node, x, y, z\nroot, 0, 0, 0\ntip, 1.5, 0, 0\n", "nodes.csv").into_result(true)?;
/// assert_eq!(nodes.find("tip"), Some(1));
/// assert_eq!(nodes.positions[1], [1.5, 0.0, 0.0]);
/// # Ok::<(), Box<phipsi_formats::Report>>(())
/// ```
pub fn read_nodes(text: &str, source: &str) -> Loaded<NodeTable> {
    let mut report = Report::new(source);
    let mut table = NodeTable::default();
    let mut seen: HashMap<String, usize> = HashMap::new();
    let mut is_first = true;
    for (i, line) in text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())) {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let mut wrong = |found: String, required: &str, remedy: &str| {
            report.errors.push(Problem::new(u32::try_from(i).ok(), "nodes", found, required, remedy));
        };
        let words: Vec<&str> =
            line.split([',', ';', ' ', '\t']).map(str::trim).filter(|x| !x.is_empty()).collect();
        let numbers: Vec<f64> = words.iter().skip(1).filter_map(|x| real(x)).collect();
        let heading = std::mem::take(&mut is_first) && numbers.is_empty();
        match (&words[..], &numbers[..]) {
            _ if heading => {}
            ([label, ..], &[x, y, z]) if words.len() == 4 => {
                if let Some(before) = seen.insert(label.to_string(), i) {
                    let found = format!("node `{label}` a second time, first in line {before}");
                    wrong(found, "different labels", "rename one of them");
                }
                table.labels.push(label.to_string());
                table.positions.push([x, y, z]);
            }
            _ => wrong(shorten(line), "a label and three finite numbers", "write `label, x, y, z`"),
        }
        if report.errors.len() >= MOST_PROBLEMS {
            break;
        }
    }
    if table.positions.is_empty() && report.errors.is_empty() {
        let remedy = "write a line `label, x, y, z` for every node";
        report.errors.push(Problem::new(None, "nodes", "no nodes", "at least one node", remedy));
    }
    Loaded { value: report.errors.is_empty().then_some(table), report }
}
