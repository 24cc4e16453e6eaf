//! `phipsi energy`: energies against OpenMM's, output for people and programs, errors.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn phipsi(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_phipsi")).args(arguments).output().unwrap()
}

fn example(extension: &str) -> String {
    root().join(format!("examples/ala_dipeptide.{extension}")).to_str().unwrap().to_string()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// kJ/mol, by the Reference platform of OpenMM 8.6.1 at the positions of examples/ala_dipeptide.pdb.
const OPENMM: [(&str, f64); 4] = [
    ("HarmonicBondForce", 1.450264672985873),
    ("HarmonicAngleForce", 1.997418440456485),
    ("PeriodicTorsionForce", 36.65089108878511),
    ("NonbondedForce", -127.09077237322819),
];

#[test]
fn json_has_the_energies_of_openmm() {
    let output = phipsi(&["energy", &example("pdb"), "--system", &example("xml"), "--json"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let value: Value = serde_json::from_slice(&output.stdout).expect("exactly one JSON value");
    let keys: Vec<&String> = value.as_object().unwrap().keys().collect();
    assert_eq!(keys, ["forces", "terms", "total"]);
    assert!(value["forces"].is_null());
    let terms = value["terms"].as_object().unwrap();
    assert_eq!(terms.len(), OPENMM.len());
    let scale: f64 = OPENMM.iter().map(|(_, e)| e.abs()).sum();
    for (name, expected) in OPENMM {
        // Rounding of some hundred pairs and of the positions, relative to all terms.
        let error = (terms[name].as_f64().unwrap() - expected).abs() / scale;
        assert!(error < 1e-12, "{name}: {error:e}");
    }
    let total: f64 = OPENMM.iter().map(|(_, e)| e).sum();
    assert!((value["total"].as_f64().unwrap() - total).abs() / scale < 1e-12);
}

#[test]
fn forces_are_given_where_asked_for() {
    let output = phipsi(&["energy", &example("pdb"), "--system", &example("xml"), "--json", "--forces"]);
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    let forces: Vec<[f64; 3]> = serde_json::from_value(value["forces"].clone()).unwrap();
    assert_eq!(forces.len(), 22);
    let largest = forces.iter().flatten().fold(0.0f64, |m, f| m.max(f.abs()));
    for axis in 0..3 {
        let sum: f64 = forces.iter().map(|f| f[axis]).sum();
        // Bonds of 1e5 kJ/mol/nm² have forces a hundred times those that are left of them in the minimum.
        assert!(sum.abs() < 22.0 * 100.0 * f64::EPSILON * largest * 22.0, "{sum:e} of {largest}");
    }
    let output = phipsi(&["energy", &example("pdb"), "--system", &example("xml"), "--forces"]);
    let shown = text(&output.stdout);
    assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
    for part in ["NonbondedForce", "total", "kJ/mol", "ALA2:CA", "kJ/mol/nm"] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
    let row = shown.lines().find(|l| l.starts_with("ALA2:CA ")).unwrap();
    let numbers: Vec<f64> = row.split_whitespace().skip(1).map(|w| w.parse().unwrap()).collect();
    assert!(numbers.iter().zip(forces[8]).all(|(a, b)| (a - b).abs() < 1e-6), "{row} {:?}", forces[8]);
}

#[test]
fn a_force_is_left_out_by_name() {
    let arguments = ["energy", &example("pdb"), "--system", &example("xml"), "--ignore", "NonbondedForce"];
    let output = phipsi(&arguments);
    assert!(output.status.success());
    assert!(!text(&output.stdout).contains("NonbondedForce"));
    assert!(text(&output.stderr).starts_with("ignored: ") && text(&output.stderr).contains("as asked for"));
    let quiet = phipsi(&[&arguments[..], &["--quiet"]].concat());
    assert!(quiet.stderr.is_empty() && quiet.stdout == output.stdout);
    let misspelled = ["energy", &example("pdb"), "--system", &example("xml"), "--ignore", "Nonbonded"];
    assert!(text(&phipsi(&misspelled).stderr).contains("warning"));
    let strict = phipsi(&[&misspelled[..], &["--strict"]].concat());
    assert_eq!(strict.status.code(), Some(1));
    assert!(text(&strict.stderr).contains("Nonbonded"));
}

/// Runs with one of the two files changed; the message.
fn broken(extension: &str, change: impl Fn(String) -> String, json: bool) -> (Option<i32>, String, String) {
    let scratch = tempfile::tempdir().unwrap();
    let mut files = [example("pdb"), example("xml")];
    let k = usize::from(extension == "xml");
    let path = scratch.path().join(format!("mine.{extension}"));
    std::fs::write(&path, change(std::fs::read_to_string(&files[k]).unwrap())).unwrap();
    files[k] = path.to_str().unwrap().into();
    let mut arguments = vec!["energy", &files[0], "--system", &files[1]];
    if json {
        arguments.push("--json");
    }
    let output = phipsi(&arguments);
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn errors_say_where_and_what_to_do() {
    let (code, out, err) = broken("pdb", |t| t.replacen("   3.535  ", "   3.5x5  ", 1), false);
    assert_eq!((code, out.as_str()), (Some(1), ""));
    assert!(err.starts_with("error: ") && err.contains("mine.pdb:10") && err.contains("to do:"), "{err}");
    let (code, _, err) = broken("xml", |t| t.replacen("method=\"0\"", "method=\"4\"", 1), false);
    assert_eq!(code, Some(1));
    assert!(err.contains("mine.xml:") && err.contains("NoCutoff"), "{err}");
    let (code, out, err) = broken(
        "pdb",
        |t| t.replacen("H3  NME", "H4  NME", 1).replacen("HETATM   22", "REMARK   22", 1),
        true,
    );
    assert_eq!(code, Some(1));
    let value: Value = serde_json::from_str(&out).expect("one JSON value");
    assert!(value["error"].as_str().unwrap().contains("21 atoms"), "{out}");
    assert!(err.contains("22 particles"), "{err}");
    // Two atoms at one place: numbers, not files, fail, and the atoms are named.
    let coincide = |t: String| {
        let line = |name: &str| t.lines().find(|l| l.contains(name)).unwrap().to_string();
        let (a, b) = (line("H1  ACE"), line("HB1 ALA"));
        t.replacen(&b, &format!("{}{}{}", &b[..30], &a[30..54], &b[54..]), 1)
    };
    let (code, _, err) = broken("pdb", coincide, false);
    assert_eq!(code, Some(1));
    assert!(err.contains("ACE1:H1") && err.contains("ALA2:HB1") && err.contains("NonbondedForce"), "{err}");
}

#[test]
fn wrong_usage_is_told_from_wrong_files() {
    assert_eq!(phipsi(&["energy", &example("pdb")]).status.code(), Some(2));
    let missing = phipsi(&["energy", "none.pdb", "--system", &example("xml")]);
    assert_eq!(missing.status.code(), Some(1));
    assert!(text(&missing.stderr).contains("none.pdb"));
}
