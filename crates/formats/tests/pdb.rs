//! PDB files: those of OpenMM, every record, every kind of mistake, and files broken at random.

use flate2::read::GzDecoder;
use phipsi_formats::pdb::{Pdb, read_pdb, read_pdb_file};
use phipsi_formats::report::{Loaded, Report};
use phipsi_model::Random;
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const SMALL: &str = "\
HEADER    A TEST
CRYST1   20.000   20.000   20.000  90.00  90.00  90.00 P 1           1
MODEL        1
ATOM      1  N   ALA A   1      -1.250   2.000   0.001  1.00  0.00           N
ATOM      2  CA AALA A   1       0.000   0.000   0.000  0.60  0.00           C
ATOM      3  CA BALA A   1       9.000   0.000   0.000  0.40  0.00           C
ATOM      4  CB AALA A   1       1.500   0.000   0.000  0.60  0.00           C
ATOM      5  CB BSER A   1       9.500   0.000   0.000  0.40  0.00           C
ATOM      6  OG BSER A   1       9.900   0.000   0.000  0.40  0.00           O
ATOM      7 HG21 VAL A   1A      3.000   0.000   0.000  1.00  0.00
TER       8      VAL A   1A
HETATMA0000 CL    CL B9999     -10.000  20.000 -30.000  1.00  0.00          CL
HETATMA0001 NA    NA BA000     -12.000  20.000 -30.000  1.00  0.00          Na
ENDMDL
MODEL        2
ATOM      1  N   ALA A   1       7.000   7.000   7.000  1.00  0.00           N
ENDMDL
CONECT    1    2    4
CONECT    2    1    3
CONECTA0000A0001
END
";

fn read(text: &str) -> Loaded<Pdb> {
    read_pdb(text, "test.pdb")
}

fn accept(text: &str) -> (Pdb, Report) {
    read(text).into_result(true).unwrap_or_else(|report| panic!("{report}"))
}

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../validation/data/molecules")
}

#[test]
fn files_of_openmm_are_what_its_topology_says() {
    let mut files = 0;
    for folder in std::fs::read_dir(data()).unwrap().map(|entry| entry.unwrap().path()) {
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        let path = folder.join(format!("{name}.pdb"));
        if !path.exists() {
            continue;
        }
        files += 1;
        let (pdb, _) = read_pdb_file(&path).into_result(true).unwrap_or_else(|report| panic!("{report}"));
        let mut json = String::new();
        let file = std::fs::File::open(folder.join(format!("{name}.ref.json.gz"))).unwrap();
        GzDecoder::new(file).read_to_string(&mut json).unwrap();
        let reference: Value = serde_json::from_str(&json).unwrap();
        let atoms = &reference["atoms"];
        let n = atoms["name"].as_array().unwrap().len();
        assert_eq!(pdb.atoms.len(), n, "{name}");
        let minimum = &reference["conformations"][0];
        assert_eq!(minimum["id"], "min");
        for (i, atom) in pdb.atoms.iter().enumerate() {
            let residue = atoms["residue"][i].as_u64().unwrap() as usize;
            assert_eq!(
                (atom.name.as_str(), atom.element.as_str()),
                (text(&atoms["name"][i]), text(&atoms["element"][i]))
            );
            assert_eq!(
                (atom.residue, atom.residue_name.as_str()),
                (residue, text(&atoms["residue_name"][residue]))
            );
            assert!(atom.serial.is_some_and(|serial| serial > i as i64));
            for axis in 0..3 {
                // The file has three decimals of an ångström: half of the last, in nm, and rounding of 1.
                let exact = minimum["positions"][i][axis].as_f64().unwrap();
                assert!((atom.position[axis] - exact).abs() <= 0.5e-4 + 4.0 * f64::EPSILON, "{name} {i}");
            }
        }
        let bonds: BTreeSet<[usize; 2]> = (reference["bonds"].as_array().unwrap().iter())
            .map(|bond| [0, 1].map(|k| bond[k].as_u64().unwrap() as usize))
            .map(|[i, j]| [i.min(j), i.max(j)])
            .collect();
        // OpenMM writes those that no standard residue has.
        assert!(pdb.bonds.iter().all(|bond| bonds.contains(bond)), "{name}: {:?}", pdb.bonds);
        assert_eq!(pdb.bonds.is_empty(), name == "met_enkephalin", "{name}");
    }
    assert_eq!(files, 10);
}

fn text(value: &Value) -> &str {
    value.as_str().expect("a text")
}

#[test]
fn every_record_arrives() {
    let (pdb, report) = accept(SMALL);
    let names: Vec<&str> = pdb.atoms.iter().map(|atom| atom.name.as_str()).collect();
    assert_eq!(names, ["N", "CA", "CB", "HG21", "CL", "NA"]);
    let elements: Vec<&str> = pdb.atoms.iter().map(|atom| atom.element.as_str()).collect();
    assert_eq!(elements, ["N", "C", "C", "H", "Cl", "Na"]);
    let residues: Vec<usize> = pdb.atoms.iter().map(|atom| atom.residue).collect();
    assert_eq!((residues, pdb.residues), (vec![0, 0, 0, 1, 2, 3], 4));
    assert_eq!(pdb.atoms[0].position, [-0.125, 0.2, 0.0001]);
    assert_eq!(pdb.atoms[4].position, [-1.0, 2.0, -3.0]);
    assert_eq!((pdb.atoms[4].serial, pdb.atoms[4].residue_number), (Some(100_000), 9999));
    assert_eq!((pdb.atoms[5].serial, pdb.atoms[5].residue_number), (Some(100_001), 10_000));
    assert_eq!((pdb.atoms[3].insertion_code, pdb.atoms[3].chain.as_str(), pdb.atoms[3].line), ('A', "A", 10));
    assert!(pdb.atoms[4].hetero && !pdb.atoms[3].hetero);
    assert_eq!(pdb.bonds, [[0, 1], [0, 2], [4, 5]]);
    let report = report.to_string();
    for note in [
        "3 in another alternate location than the first (line 6)",
        "1 records behind the first one (line 15)",
        "1 bonds of atoms that are left out (line 19)",
        "elements of 1 atoms from their names (line 10)",
        "atoms: 6, residues: 4, bonds: 3",
    ] {
        assert!(report.contains(note), "{note}: {report}");
    }
}

#[test]
fn elements_come_from_columns_or_names() {
    for (name, columns, element) in [
        (" CA ", " C", "C"),
        ("CA  ", "CA", "Ca"),
        (" CA ", "  ", "C"),
        ("CA  ", "  ", "Ca"),
        ("HG21", "  ", "H"),
        ("1HB ", "  ", "H"),
        (" H12", "  ", "H"),
        ("FE  ", "  ", "Fe"),
        ("ZN  ", "  ", "Zn"),
        ("CL1 ", "  ", "Cl"),
        ("OP1'", "  ", "O"),
        ("NH1A", "  ", "N"),
        (" SD ", "xx", "S"),
        (" D  ", "D ", "D"),
    ] {
        let text = format!(
            "ATOM      1 {name} XXX A   1       0.000   0.000   0.000  1.00  0.00          {columns}\n"
        );
        assert_eq!(accept(&text).0.atoms[0].element, element, "{name} {columns}");
    }
    let ion = "ATOM      1  Cl   Cl A   1       0.000   0.000   0.000\n";
    assert_eq!(accept(ion).0.atoms[0].element, "Cl");
    let unknown = "ATOM      1  ?   XXX A   1       0.000   0.000   0.000\n";
    let read = read(unknown);
    assert!(read.value.is_some_and(|pdb| pdb.atoms[0].element.is_empty()));
    assert_eq!(read.report.warnings[0].found, "1 atoms without an element");
}

#[test]
fn mistakes_have_line_place_and_remedy() {
    let columns = "correct it; positions may not reach out of their columns";
    for (from, to, line, place, found, remedy) in [
        (
            "      -1.250   2.000   0.001  1.00  0.00           N",
            "      -1.250   2.0",
            4,
            "atom N ALA A1",
            "a record of 44 columns",
            "see whether the file was written to its end",
        ),
        ("  -1.250", "  -1.2x0", 4, "atom N ALA A1", "x is \"-1.2x0\"", columns),
        ("  -1.250", "********", 4, "atom N ALA A1", "x is \"********\"", columns),
        ("  -1.250", "     nan", 4, "atom N ALA A1", "x is \"nan\"", columns),
        ("   2.000   0.001", "           0.001", 4, "atom N ALA A1", "y is \"\"", columns),
        (
            "N   ALA A   1      -1",
            "N   ALA A   x      -1",
            4,
            "atom N ALA Ax",
            "residue number \"x\"",
            "correct it",
        ),
        (" HG21 VAL", "      VAL", 10, "atom  VAL A1A", "no name in columns 13-16", "add it"),
        ("HETATMA0000", "HETATMA 000", 12, "atom CL CL B9999", "serial number \"A 000\"", "correct it"),
        ("CONECT    1    2", "CONECT    1    x", 18, "CONECT 1", "serial number \"x\"", "correct the line"),
        ("CONECT    1    2", "CONECT         2", 18, "CONECT ", "serial number \"\"", "correct the line"),
        (
            "HEADER    A TEST",
            "HEADR     A TEST",
            1,
            "record",
            "a line that begins with \"HEADR\"",
            "did you mean `HEADER`?",
        ),
        (
            "HEADER    A TEST",
            "{\"a\": 1}",
            1,
            "record",
            "a line that begins with \"{\"a\":\"",
            "remove the line, or begin it with REMARK",
        ),
        (
            "CL    CL B",
            "C\u{e9}   CL B",
            12,
            "atom  CL ",
            "a character that is not ASCII",
            "replace it: the columns of an atom are counted in bytes",
        ),
    ] {
        assert_eq!(SMALL.matches(from).count(), 1, "{from}");
        let read = read(&SMALL.replace(from, to));
        assert!(read.value.is_none());
        let [problem] = &read.report.errors[..] else { panic!("{to}: {}", read.report) };
        assert_eq!(
            (problem.line, problem.found.as_str(), problem.remedy.as_str()),
            (Some(line), found, remedy),
            "{to}"
        );
        assert!(problem.place.trim_end() == place.trim_end() || to.contains('\u{e9}'), "{to}: {problem:?}");
    }
    assert_eq!(read("REMARK\nEND\n").report.errors[0].found, "no ATOM or HETATM record");
    assert_eq!(read("").report.errors[0].found, "no ATOM or HETATM record");
    assert_eq!(read_pdb_file("no such file.pdb").report.errors[0].place, "file");
}

#[test]
fn bonds_of_unknown_or_repeated_serials_are_warnings() {
    let text: String = SMALL
        .lines()
        .filter(|line| !line.contains("BSER") && !line.contains("BALA"))
        .collect::<Vec<_>>()
        .join("\n");
    let text = text.split("ENDMDL").next().unwrap().to_string();
    for conect in ["CONECT    1   77", "CONECT    1    1"] {
        let read = read(&format!("{text}{conect}\n"));
        assert!(read.value.is_some_and(|pdb| pdb.bonds.is_empty()));
        assert_eq!(read.report.warnings[0].found, "1 bonds of a serial number that no atom has, or several");
    }
    let repeated = text.replace("HETATMA0001", "HETATMA0000") + "CONECTA0000    1\n";
    assert_eq!(read(&repeated).report.warnings.len(), 1);
    // Asterisks are no serial number, and hexadecimal ones are as good as any.
    let (pdb, _) = accept(&text.replace("HETATMA0001", "HETATM*****"));
    assert_eq!(pdb.atoms[pdb.atoms.len() - 1].serial, None);
    let (pdb, _) = accept(&(text.replace("HETATMA0001", "HETATMA000F") + "CONECTA000FA0000\n"));
    assert_eq!(pdb.bonds, [[4, 5]]);
}

#[test]
fn broken_files_are_refused_or_sound() {
    let number = |variable: &str| std::env::var(variable).ok().and_then(|text| text.parse::<u64>().ok());
    let duration = number("PHIPSI_FUZZ_SECONDS").map_or(Duration::from_secs(2), Duration::from_secs);
    let first = number("PHIPSI_FUZZ_SEED").unwrap_or(0);
    let (start, mut seed, mut accepted) = (Instant::now(), first, 0u64);
    while seed == first || start.elapsed() < duration {
        match catch_unwind(AssertUnwindSafe(|| case(seed))) {
            Ok(sound) => accepted += u64::from(sound),
            Err(panic) => {
                eprintln!("PHIPSI_FUZZ_SEED={seed} reproduces this");
                std::panic::resume_unwind(panic);
            }
        }
        seed += 1;
    }
    eprintln!("{} cases, {accepted} accepted", seed - first);
}

const PIECES: [&str; 20] = [
    "ATOM  ",
    "HETATM",
    "CONECT",
    "MODEL ",
    "ENDMDL",
    "TER",
    "\n",
    "\r\n",
    " ",
    "     ",
    "A0000",
    "zzzzz",
    "*****",
    "nan",
    "1e9",
    "é",
    "\u{1f980}",
    "\0",
    "\t",
    "99999",
];

/// True if the file was accepted.
fn case(seed: u64) -> bool {
    let mut r = Random::new(seed);
    let mut bytes = SMALL.as_bytes().to_vec();
    for _ in 0..1 + r.below(4) {
        let n = bytes.len();
        let at = r.below(n + 1);
        let end = (at + [1, 6, 81][r.below(3)]).min(n);
        let piece = PIECES[r.below(PIECES.len())];
        match r.below(7) {
            0 if n > 0 => bytes[at.min(n - 1)] ^= 1 << r.below(8),
            1 => drop(bytes.drain(at..end)),
            2 => {
                let copy = bytes[at..end].to_vec();
                let to = r.below(n + 1);
                bytes.splice(to..to, copy);
            }
            3 if r.below(4) == 0 => bytes.truncate(at),
            4 => drop(bytes.splice(at..at, piece.bytes())),
            // The same columns remain.
            _ => drop(bytes.splice(at..(at + piece.len()).min(n), piece.bytes())),
        }
    }
    let text = String::from_utf8_lossy(&bytes).into_owned();
    let read = read(&text);
    assert_eq!(read.value.is_none(), !read.report.errors.is_empty());
    for problem in read.report.errors.iter().chain(&read.report.warnings) {
        let parts = [&problem.place, &problem.found, &problem.required, &problem.remedy];
        assert!(parts.iter().all(|part| !part.is_empty() && part.len() < 1000), "{problem:?}");
        assert!(problem.line.is_none_or(|line| (1..=text.lines().count()).contains(&(line as usize))));
    }
    let Some(pdb) = read.value else { return false };
    assert!(!pdb.atoms.is_empty());
    for atom in &pdb.atoms {
        assert!(
            atom.position.iter().all(|x| x.is_finite())
                && atom.residue < pdb.residues
                && !atom.name.is_empty()
        );
    }
    assert!(pdb.bonds.iter().all(|[i, j]| i < j && *j < pdb.atoms.len()));
    true
}

#[test]
fn a_system_in_the_place_of_a_pdb_is_one_error() {
    let read = read_pdb("<?xml version=\"1.0\" ?>\n<System>\n<Particles/>\n</System>\n", "swapped.xml");
    assert!(read.value.is_none());
    assert_eq!((read.report.errors.len(), read.report.errors[0].found.as_str()), (1, "XML"));
}
