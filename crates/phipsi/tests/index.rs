//! The index of algorithms: every kernel file has a dense twin and a row, and what a row names exists.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Files of `recursion` that hold no algorithm.
const SUPPORT: [&str; 18] = [
    "batch",
    "branching",
    "composites",
    "derivative_columns",
    "error",
    "floating_base",
    "form",
    "ground_axes",
    "hinge",
    "kernel",
    "layout",
    "lib",
    "limbs",
    "link",
    "operators",
    "packed",
    "places",
    "singular_values",
];

/// Algorithms of `closure`: all of its public files. The dense twin of the first judges the others, too.
const CLOSURE: [&str; 7] = [
    "closed_dynamics",
    "assembly",
    "closure_compliance",
    "momenta",
    "projection",
    "cut_joints",
    "tree_choice",
];

/// Files of `closure` that hold parts of those, or none.
const CLOSURE_SUPPORT: [&str; 11] = [
    "compiled",
    "error",
    "factors",
    "frames",
    "lib",
    "number",
    "reflections",
    "rows",
    "solution",
    "structure",
    "tree",
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: PathBuf) -> String {
    fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Names without extension of the Rust files of a folder.
fn stems(folder: &str) -> BTreeSet<String> {
    let entries = fs::read_dir(root().join(folder)).expect("a folder");
    let paths = entries.map(|entry| entry.expect("an entry").path());
    let rust = paths.filter(|p| p.extension().is_some_and(|e| e == "rs"));
    rust.map(|p| p.file_stem().expect("a name").to_string_lossy().into_owned()).collect()
}

fn algorithms() -> Vec<String> {
    stems("crates/recursion/src").into_iter().filter(|s| !SUPPORT.contains(&s.as_str())).collect()
}

/// The text of an algorithm: its file and those of its folder.
fn algorithm_source(stem: &str) -> String {
    let home = if CLOSURE.contains(&stem) { "closure" } else { "recursion" };
    let mut source = read(root().join(format!("crates/{home}/src/{stem}.rs")));
    let folder = format!("crates/{home}/src/{stem}");
    if root().join(&folder).is_dir() {
        for part in stems(&folder) {
            source += &read(root().join(&folder).join(format!("{part}.rs")));
        }
    }
    source
}

/// The table's rows, as cells.
fn rows() -> Vec<Vec<String>> {
    let text = read(root().join("docs/src/algorithms.md"));
    let table = text.lines().filter(|line| line.starts_with("| ")).skip(1);
    table
        .map(|line| {
            let line = line.replace("\\|", "‖");
            line.trim_matches('|').split('|').map(|cell| cell.trim().to_string()).collect()
        })
        .collect()
}

/// What stands between backticks.
fn quoted(cell: &str) -> Vec<&str> {
    cell.split('`').skip(1).step_by(2).collect()
}

#[test]
fn every_algorithm_has_a_twin_and_a_row() {
    let twins = stems("crates/reference/src");
    let rows = rows();
    let algorithms = algorithms();
    assert!(algorithms.len() > 8, "{algorithms:?}");
    for stem in algorithms {
        assert!(
            twins.contains(&stem),
            "crates/reference/src/{stem}.rs is missing: the dense twin of recursion's"
        );
        let prefix = format!("{stem}::");
        assert!(
            rows.iter().any(|row| quoted(&row[2]).iter().any(|name| name.starts_with(&prefix))),
            "docs/src/algorithms.md has no row for `{stem}`"
        );
    }
}

#[test]
fn algorithms_of_closure_have_rows() {
    assert!(stems("crates/reference/src").contains(CLOSURE[0]));
    let rows = rows();
    let known: BTreeSet<String> = CLOSURE.iter().chain(&CLOSURE_SUPPORT).map(|s| s.to_string()).collect();
    assert_eq!(stems("crates/closure/src"), known);
    for stem in CLOSURE {
        let prefix = format!("{stem}::");
        assert!(
            rows.iter().any(|row| quoted(&row[2]).iter().any(|name| name.starts_with(&prefix))),
            "docs/src/algorithms.md has no row for `{stem}`"
        );
    }
}

#[test]
fn every_row_is_full_and_names_what_exists() {
    let mut tests = String::new();
    for folder in [
        "crates/recursion/tests",
        "crates/closure/tests",
        "crates/closure/src",
        "crates/motion/tests",
        "crates/phipsi/tests",
    ] {
        for stem in stems(folder) {
            tests += &read(root().join(folder).join(format!("{stem}.rs")));
        }
    }
    let rows = rows();
    assert!(!rows.is_empty());
    for row in rows {
        assert_eq!(row.len(), 5, "{row:?}");
        assert!(row.iter().all(|cell| !cell.is_empty()), "{row:?}");
        for function in quoted(&row[2]) {
            let parts: Vec<&str> = function.split("::").collect();
            let source = algorithm_source(parts[0]);
            let name = parts[parts.len() - 1];
            assert!(source.contains(&format!("pub fn {name}")), "`{function}` is no public function");
        }
        let named = quoted(&row[4]);
        assert!(!named.is_empty(), "{row:?}: no test");
        for test in named {
            assert!(tests.contains(&format!("fn {test}()")), "{}: no test is called `{test}`", row[0]);
        }
    }
}

/// Algorithms without a bench of their own: the forms are in `form`, the operator is a part of the derivatives, and the
/// check runs once for a model.
const NO_BENCH: [&str; 4] =
    ["hinge_check", "innovations", "refined_forward_dynamics", "square_root_forward_dynamics"];

#[test]
fn every_algorithm_has_a_bench_of_its_name() {
    let benches = stems("crates/recursion/benches");
    for stem in algorithms() {
        let has = benches.contains(&stem);
        assert!(
            has != NO_BENCH.contains(&stem.as_str()),
            "crates/recursion/benches/{stem}.rs: {}",
            if has { "take it off NO_BENCH" } else { "missing" }
        );
    }
    // `long` measures several algorithms on many bodies.
    let sources = stems("crates/recursion/src");
    let stray: Vec<&String> = benches.iter().filter(|b| *b != "long" && !sources.contains(*b)).collect();
    assert!(stray.is_empty(), "benches without a file of that name in recursion: {stray:?}");
    let manifest = read(root().join("crates/recursion/Cargo.toml"));
    for bench in benches {
        assert!(
            manifest.contains(&format!("[[bench]]\nname = \"{bench}\"\nharness = false")),
            "`{bench}` is not in recursion's manifest, or not with `harness = false`"
        );
    }
}
