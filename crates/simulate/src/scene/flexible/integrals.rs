//! Shape integrals of a flexible body as numbers.

use super::count;
use crate::scene::tree::{Node as TomlNode, Table, Value, finite, number_list};
use phipsi_formats::Report;
use phipsi_model::flexible::Matrix3;
use phipsi_model::{FlexibleBody, Node, ShapeIntegrals, Stiffening};

/// Most modes of a body whose integrals are written out.
const MOST_MODES: usize = 200;

/// Reads `integrals = { … }`, `stiffness`, `damping`, `nodes`.
pub(super) fn read(table: &mut Table<'_>, report: &mut Report) -> Option<FlexibleBody> {
    let before = report.errors.len();
    let mut t = table.table("integrals", report)?;
    t.required("modes", report, "the number of modes");
    let n = t.number("modes", report).map_or(0, |x| count(x, "modes", MOST_MODES, &t, report));
    let mut sum = ShapeIntegrals::zero(n);
    t.required("mass", report, "a mass in kg");
    sum.mass = t.positive("mass", false, report).unwrap_or(1.0);
    sum.first_moment = t.numbers::<3>("first_moment", report).unwrap_or_default();
    sum.second_moment = matrix(&mut t, "second_moment", report).unwrap_or_default();
    sum.rotary = matrix(&mut t, "rotary", report).unwrap_or_default();
    vectors(&mut t, "displacement", &mut sum.displacement, report);
    vectors(&mut t, "rotary_coupling", &mut sum.rotary_coupling, report);
    for mut entry in t.tables("moment", report) {
        let l = mode(&mut entry, "mode", n, report);
        if let (Some(l), Some(m)) = (l, required_matrix(&mut entry, report)) {
            sum.moment[l] = m;
        }
        entry.finish(report);
    }
    pairs(&mut t, "product", n, report, |l, m, x| {
        sum.product[m * n + l] = transposed(&x);
        sum.product[l * n + m] = x;
    });
    if let Some(node) = t.get("rotary_modal") {
        sum.rotary_modal = square(&t, "rotary_modal", node, n, report);
    }
    let mut stiffening =
        Stiffening { displacement: vec![[0.0; 3]; n * n], moment: vec![[[0.0; 3]; 3]; n * n] };
    let stiffened = t.has("stiffening_displacement") || t.has("stiffening_moment");
    vector_pairs(&mut t, "stiffening_displacement", n, &mut stiffening.displacement, report);
    pairs(&mut t, "stiffening_moment", n, report, |l, m, x| {
        (stiffening.moment[l * n + m], stiffening.moment[m * n + l]) = (x, x);
    });
    sum.stiffening = stiffened.then_some(stiffening);
    t.finish(report);
    let stiffness = match table.get("modal_stiffness") {
        Some(node) => square(table, "modal_stiffness", node, n, report),
        None => {
            table.required("modal_stiffness", report, "n rows of n numbers");
            Vec::new()
        }
    };
    let damping = match table.get("modal_damping") {
        Some(node) => square(table, "modal_damping", node, n, report),
        None => vec![0.0; n * n],
    };
    let mut nodes = Vec::new();
    for mut entry in table.tables("nodes", report) {
        let name = entry.required_text("name", report);
        let position = entry.numbers::<3>("position", report).unwrap_or_default();
        let mut node = Node::fixed(name.unwrap_or_default(), position, n);
        vectors(&mut entry, "displacement", &mut node.displacement, report);
        vectors(&mut entry, "rotation", &mut node.rotation, report);
        if entry.has("quadratic") {
            let mut quadratic = vec![[0.0; 3]; n * n];
            vector_pairs(&mut entry, "quadratic", n, &mut quadratic, report);
            node.quadratic = Some(quadratic);
        }
        entry.finish(report);
        nodes.push(node);
    }
    (report.errors.len() == before).then(|| FlexibleBody::new(sum, stiffness, nodes).damped(damping))
}

fn transposed(m: &Matrix3) -> Matrix3 {
    std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
}

/// Three rows of three numbers.
fn matrix(table: &mut Table<'_>, key: &'static str, report: &mut Report) -> Option<Matrix3> {
    let node = table.get(key)?;
    let rows = rows(node).and_then(|rows| {
        let rows: Option<Vec<[f64; 3]>> = rows.into_iter().map(|row| row.try_into().ok()).collect();
        rows?.try_into().ok()
    });
    if rows.is_none() {
        table.error(
            Some(node),
            report,
            format!("{key} = {}", node.value.describe()),
            "three rows of three numbers",
            format!("correct `{key}`"),
        );
    }
    rows
}

fn required_matrix(table: &mut Table<'_>, report: &mut Report) -> Option<Matrix3> {
    table.required("matrix", report, "three rows of three numbers");
    matrix(table, "matrix", report)
}

/// Lists of finite numbers.
fn rows(node: &TomlNode) -> Option<Vec<Vec<f64>>> {
    match &node.value {
        Value::List(items) => items.iter().map(number_list).collect(),
        _ => None,
    }
}

/// One vector for every mode.
fn vectors(table: &mut Table<'_>, key: &'static str, out: &mut Vec<[f64; 3]>, report: &mut Report) {
    let Some(node) = table.get(key) else { return };
    let n = out.len();
    let read: Option<Vec<[f64; 3]>> =
        rows(node).and_then(|rows| rows.into_iter().map(|row| row.try_into().ok()).collect());
    match read.filter(|x| x.len() == n) {
        Some(x) => *out = x,
        None => {
            let required = format!("{n} vectors of three numbers, one for every mode");
            let found = format!("{key} = {}", node.value.describe());
            table.error(Some(node), report, found, required, format!("correct `{key}`"));
        }
    }
}

/// n rows of n numbers.
fn square(table: &Table<'_>, key: &str, node: &TomlNode, n: usize, report: &mut Report) -> Vec<f64> {
    match rows(node).filter(|rows| rows.len() == n && rows.iter().all(|row| row.len() == n)) {
        Some(rows) => rows.concat(),
        None => {
            let found = format!("{key} = {}", node.value.describe());
            let required = format!("{n} rows of {n} numbers");
            table.error(Some(node), report, found, required, format!("correct `{key}`"));
            vec![0.0; n * n]
        }
    }
}

/// A mode by its number, from 1.
fn mode(table: &mut Table<'_>, key: &'static str, n: usize, report: &mut Report) -> Option<usize> {
    let node = table.required(key, report, "the number of a mode, from 1")?;
    index(finite(node), n).or_else(|| {
        let found = format!("{key} = {}", node.value.describe());
        table.error(
            Some(node),
            report,
            found,
            format!("whole numbers from 1 to {n}"),
            format!("correct `{key}`"),
        );
        None
    })
}

fn index(x: Option<f64>, n: usize) -> Option<usize> {
    x.filter(|x| (1.0..=n as f64).contains(x) && x.fract() == 0.0).map(|x| x as usize - 1)
}

/// The modes of a pair, from 1.
fn pair(entry: &mut Table<'_>, n: usize, report: &mut Report) -> Option<(usize, usize)> {
    entry.required("modes", report, "the numbers of two modes, from 1");
    let [l, m] = entry.numbers::<2>("modes", report)?;
    let found = index(Some(l), n).zip(index(Some(m), n));
    if found.is_none() {
        let node = entry.get("modes");
        entry.error(
            node,
            report,
            format!("modes = [{l}, {m}]"),
            format!("whole numbers from 1 to {n}"),
            "correct `modes`",
        );
    }
    found
}

/// Matrices of pairs of modes; pairs that are not named are zero.
fn pairs(
    table: &mut Table<'_>,
    key: &'static str,
    n: usize,
    report: &mut Report,
    mut set: impl FnMut(usize, usize, Matrix3),
) {
    for mut entry in table.tables(key, report) {
        let at = pair(&mut entry, n, report);
        if let (Some((l, m)), Some(x)) = (at, required_matrix(&mut entry, report)) {
            set(l, m, x);
        }
        entry.finish(report);
    }
}

/// Vectors of pairs of modes, symmetric; pairs that are not named are zero.
fn vector_pairs(
    table: &mut Table<'_>,
    key: &'static str,
    n: usize,
    out: &mut [[f64; 3]],
    report: &mut Report,
) {
    for mut entry in table.tables(key, report) {
        let at = pair(&mut entry, n, report);
        entry.required("vector", report, "three numbers");
        if let (Some((l, m)), Some(x)) = (at, entry.numbers::<3>("vector", report)) {
            (out[l * n + m], out[m * n + l]) = (x, x);
        }
        entry.finish(report);
    }
}
