//! The arrows between crates: each may know only the rooms below it. The list here is the plan; `cargo metadata` is the fact.

use serde_json::Value;
use std::process::Command;

/// Each crate and the crates of ours it may depend on.
const ALLOWED: [(&str, &[&str]); 16] = [
    ("spatial", &[]),
    ("topology", &["spatial"]),
    ("model", &["spatial", "topology"]),
    ("reference", &["spatial", "topology", "model"]),
    ("formats", &["spatial", "topology", "model"]),
    ("recursion", &["spatial", "topology", "model"]),
    ("closure", &["spatial", "topology", "model", "recursion"]),
    ("hybrid", &["spatial", "topology", "model", "recursion"]),
    ("freeflight", &["spatial", "topology", "model", "recursion"]),
    ("motion", &["spatial", "topology", "model", "recursion", "closure", "hybrid", "freeflight"]),
    ("molecule", &MOTION_AND_BELOW),
    ("contact", &MOTION_AND_BELOW),
    ("simulate", &SIMULATE_MAY),
    ("phipsi", &FACADE_MAY),
    ("cli", &["phipsi", "simulate"]),
    ("python", &["phipsi", "simulate"]),
];

const MOTION_AND_BELOW: [&str; 9] =
    ["spatial", "topology", "model", "formats", "recursion", "closure", "hybrid", "freeflight", "motion"];

const SIMULATE_MAY: [&str; 11] = [
    "spatial",
    "topology",
    "model",
    "formats",
    "recursion",
    "closure",
    "hybrid",
    "freeflight",
    "motion",
    "molecule",
    "contact",
];

const FACADE_MAY: [&str; 12] = [
    "spatial",
    "topology",
    "model",
    "formats",
    "recursion",
    "closure",
    "hybrid",
    "freeflight",
    "motion",
    "molecule",
    "contact",
    "simulate",
];

/// `phipsi-NAME` is the crate in the room NAME; the facade is `phipsi` itself.
fn room(package: &str) -> Option<&str> {
    if package == "phipsi" { Some(package) } else { package.strip_prefix("phipsi-") }
}

/// Packages of the workspace with all their dependencies, those on the tests' reference left out.
fn arrows() -> Vec<(String, Vec<String>)> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--format-version", "1", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let text = |v: &Value| v.as_str().expect("a string").to_string();
    let packages = metadata["packages"].as_array().expect("packages");
    packages
        .iter()
        .map(|package| {
            let all = package["dependencies"].as_array().expect("dependencies").iter();
            let kept = all.filter(|d| d["kind"] != "dev" || d["name"] != "phipsi-reference");
            (text(&package["name"]), kept.map(|d| text(&d["name"])).collect())
        })
        .collect()
}

#[test]
fn arrows_run_downward_only() {
    let arrows = arrows();
    let rooms: Vec<&str> = arrows.iter().filter_map(|(name, _)| room(name)).collect();
    for needed in ["spatial", "topology", "model", "recursion", "reference"] {
        assert!(rooms.contains(&needed), "no crate for the room `{needed}`: {rooms:?}");
    }
    for (name, dependencies) in &arrows {
        let from = room(name).unwrap_or_else(|| panic!("crate `{name}` is no room: call it phipsi-NAME"));
        let (_, allowed) = ALLOWED
            .iter()
            .find(|(room, _)| *room == from)
            .unwrap_or_else(|| panic!("room `{from}` is not in the list: add it with its arrows"));
        for to in dependencies.iter().filter_map(|d| room(d)) {
            assert!(allowed.contains(&to), "`{from}` depends on `{to}`, which it must not know");
        }
    }
}

/// The list itself has no cycle: every room stands after all that it may know.
#[test]
fn the_list_is_in_order() {
    for (i, (room, allowed)) in ALLOWED.iter().enumerate() {
        for other in *allowed {
            assert!(ALLOWED[..i].iter().any(|(earlier, _)| earlier == other), "`{other}` after `{room}`");
        }
    }
}
