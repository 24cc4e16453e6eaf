//! Reference molecules that several tests read.

pub mod chains;
pub mod statistics;

use flate2::read::GzDecoder;
use phipsi_formats::system::{SystemOptions, read_system};
use phipsi_molecule::{AtomName, Atoms, ForceField};
use phipsi_spatial::Vec3;
use serde_json::Value;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Molecules whose torsion models are kept beside the tests.
pub const MOLECULES: [&str; 6] =
    ["aladi", "ace_pro_nme", "met_enkephalin", "ace_ala3_nme", "butane", "aladi_x2"];

/// Folders with one folder for each molecule: the tests' own, and another named by `PHIPSI_MOLECULES`.
pub fn folders() -> Vec<PathBuf> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../validation/data/molecules");
    std::iter::once(own).chain(std::env::var("PHIPSI_MOLECULES").ok().map(PathBuf::from)).collect()
}

/// The file NAME.ENDING, gzipped or not.
pub fn find(folder: &Path, name: &str, ending: &str) -> Option<PathBuf> {
    let path = |zip: &str| folder.join(name).join(format!("{name}.{ending}{zip}"));
    ["", ".gz"].into_iter().map(path).find(|path| path.exists())
}

/// The text of a file, gunzipped where its name ends in gz.
pub fn text(path: &Path) -> String {
    let mut text = String::new();
    let mut file = std::fs::File::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    if path.extension().is_some_and(|e| e == "gz") {
        GzDecoder::new(file).read_to_string(&mut text).unwrap();
    } else {
        file.read_to_string(&mut text).unwrap();
    }
    text
}

pub fn json(path: &Path) -> Value {
    serde_json::from_str(&text(path)).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

pub fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

pub fn index(value: &Value) -> usize {
    value.as_u64().expect("an index") as usize
}

pub fn word(value: &Value) -> &str {
    value.as_str().expect("a word")
}

pub fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

pub fn numbers(value: &Value) -> Vec<f64> {
    list(value).iter().map(number).collect()
}

pub fn indices(value: &Value) -> Vec<usize> {
    list(value).iter().map(index).collect()
}

pub fn vectors(value: &Value) -> Vec<Vec3<f64>> {
    list(value).iter().map(|row| Vec3([0, 1, 2].map(|i| number(&row[i])))).collect()
}

fn atomic_number(symbol: &str) -> u8 {
    match symbol {
        "H" => 1,
        "C" => 6,
        "N" => 7,
        "O" => 8,
        "Na" => 11,
        "S" => 16,
        "Cl" => 17,
        other => panic!("element {other}"),
    }
}

/// Names, elements and bonds of a NAME.ref.json, with the given masses.
pub fn atoms(reference: &Value, masses: Vec<f64>) -> Atoms {
    let table = &reference["atoms"];
    let chains = indices(&table["chain_of_residue"]);
    let names = list(&table["name"]).iter().zip(indices(&table["residue"])).map(|(name, residue)| AtomName {
        chain: if chains.iter().any(|&c| c > 0) { chains[residue].to_string() } else { String::new() },
        residue: format!("{}{}", word(&table["residue_name"][residue]), residue + 1),
        atom: word(name).into(),
    });
    Atoms {
        masses,
        elements: list(&table["element"]).iter().map(|e| atomic_number(word(e))).collect(),
        bonds: list(&reference["bonds"]).iter().map(|b| [index(&b[0]), index(&b[1])]).collect(),
        names: names.collect(),
    }
}

pub fn conformation<'a>(reference: &'a Value, id: &str) -> &'a Value {
    let all = list(&reference["conformations"]);
    all.iter().find(|c| c["id"] == id).unwrap_or_else(|| panic!("no conformation {id}"))
}

/// A molecule with its force field, at a conformation.
pub struct Molecule {
    pub atoms: Atoms,
    pub positions: Vec<Vec3<f64>>,
    pub field: ForceField,
}

pub fn molecule(name: &str, environment: &str, id: &str) -> Molecule {
    let folder = folders().into_iter().find(|f| find(f, name, "ref.json").is_some());
    let folder = folder.unwrap_or_else(|| panic!("no molecule {name}"));
    let reference = json(&find(&folder, name, "ref.json").unwrap());
    let path =
        find(&folder, name, &format!("{environment}.xml")).unwrap_or_else(|| panic!("{name} {environment}"));
    let read = read_system(&text(&path), &path.display().to_string(), &SystemOptions::default());
    let system = read.into_result(true).unwrap_or_else(|report| panic!("{report}")).0;
    Molecule {
        atoms: atoms(&reference, system.masses.clone()),
        positions: vectors(&conformation(&reference, id)["positions"]),
        field: ForceField::new(&system).unwrap(),
    }
}
