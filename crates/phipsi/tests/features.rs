//! What each feature pulls in: counted here, and told in the documentation.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

/// Crates of a build, this one among them.
fn crates(features: &str) -> usize {
    let output = Command::new(env!("CARGO"))
        .args([
            "tree",
            "-p",
            "phipsi",
            "--no-default-features",
            "-e",
            "normal",
            "--prefix",
            "none",
            "--offline",
        ])
        .args(["--features", features])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("text");
    let name = |line: &str| line.split_whitespace().take(2).collect::<Vec<_>>().join(" ");
    text.lines().map(name).filter(|n| !n.is_empty()).collect::<BTreeSet<_>>().len()
}

/// Tree dynamics alone stays small: a user of the kernels pulls in nothing else.
#[test]
fn tree_dynamics_alone_needs_few_crates() {
    let count = crates("");
    assert!(count <= 25, "{count} crates");
}

#[test]
fn the_page_tells_what_each_feature_needs() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/src/left_out.md");
    let page = std::fs::read_to_string(page).unwrap();
    for feature in ["", "closure", "hybrid", "freeflight", "formats", "motion", "molecule", "simulate"] {
        let row = format!("| {} | {} |", if feature.is_empty() { "none" } else { feature }, crates(feature));
        assert!(page.contains(&row), "the page lacks `{row}`");
    }
}
