//! PDB: atoms with their names, residues, elements and positions, and the bonds that the file lists.
//!
//! | record | here |
//! |---|---|
//! | ATOM, HETATM | an atom; its columns are those of version 3.3 of the format |
//! | CONECT | bonds; no bond is guessed from distances or names |
//! | MODEL, ENDMDL | the first model is read, the others are ignored |
//! | TER | ends a residue |
//! | alternate locations | the first of each residue is read, the others are ignored |
//! | serial and residue numbers beyond 99 999 and 9 999 | hybrid-36, or the hexadecimal numbers that OpenMM writes |
//! | no element in columns 77–78 | from the columns of the atom's name, with a note |
//! | every other record of the format | without effect |
//! | anything else | an error |

mod atom;
mod element;
mod number;

pub(crate) use element::symbol_of_number;

pub use element::atomic_number;

use crate::file::read_text;
use crate::report::{Loaded, Note, Problem, Report};
use crate::suggest::{quote, remedy};
use std::collections::{BTreeSet, HashMap};
use std::path::Path;

/// Most entries of each list of the report.
const MOST_ENTRIES: usize = 1000;

/// The atoms of a PDB file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pdb {
    /// The atoms in the order of the file.
    pub atoms: Vec<PdbAtom>,
    /// Bonds of CONECT records: pairs of atoms, the smaller index first, each once and in order.
    pub bonds: Vec<[usize; 2]>,
    /// Number of residues.
    pub residues: usize,
}

/// An atom.
#[derive(Clone, Debug, PartialEq)]
pub struct PdbAtom {
    /// Its name in its residue: "CA".
    pub name: String,
    /// Name of its residue: "ALA".
    pub residue_name: String,
    /// Its chain: "A"; may be empty.
    pub chain: String,
    /// Number of its residue in the chain.
    pub residue_number: i64,
    /// Insertion code of its residue; a space where there is none.
    pub insertion_code: char,
    /// Its residue, counted from 0 over the whole file.
    pub residue: usize,
    /// Symbol of its element: "C", "Na"; empty where it is not known.
    pub element: String,
    /// Position, nm.
    pub position: [f64; 3],
    /// Its serial number, where it has one.
    pub serial: Option<i64>,
    /// True of HETATM records.
    pub hetero: bool,
    /// Its line in the file.
    pub line: u32,
}

/// The atoms of a PDB text; `source` is its name in the report.
///
/// # Cost
/// O(n log n) in the length of the text.
///
/// # Errors
/// In the report: lines that are no records, that are too short, or whose numbers cannot be read; no atoms.
///
/// # Example
/// ```
/// use phipsi_formats::pdb::read_pdb;
/// let text = "\
/// ATOM      1  CA  ALA A   1       1.000   2.000  -3.500  1.00  0.00           C
/// ATOM      2  CB  ALA A   1       1.000   2.000  -2.000  1.00  0.00           C
/// CONECT    1    2
/// END
/// ";
/// let (pdb, _) = read_pdb(text, "ala.pdb").into_result(true)?;
/// assert_eq!((pdb.atoms[0].name.as_str(), pdb.atoms[0].position), ("CA", [0.1, 0.2, -0.35]));
/// assert_eq!(pdb.bonds, [[0, 1]]);
/// # Ok::<(), Box<phipsi_formats::Report>>(())
/// ```
pub fn read_pdb(text: &str, source: &str) -> Loaded<Pdb> {
    if text.trim_start().starts_with('<') {
        let mut report = Report::new(source);
        let to_do = "give the PDB file first and the System in XML second";
        report.errors.push(Problem::new(Some(1), "file", "XML", "a PDB file", to_do));
        return Loaded { value: None, report };
    }
    let mut reader = Reader::new(source);
    for (number, line) in (1u32..).zip(text.lines()) {
        reader.line(number, line);
    }
    reader.finish()
}

/// The atoms of a PDB file.
///
/// # Errors
/// In the report: a file that cannot be read, is larger than 256 MiB or is not UTF-8; else as [`read_pdb`].
pub fn read_pdb_file(path: impl AsRef<Path>) -> Loaded<Pdb> {
    let source = path.as_ref().display().to_string();
    match read_text(path.as_ref(), "a PDB file") {
        Ok(text) => read_pdb(&text, &source),
        Err(problem) => {
            let mut report = Report::new(source);
            report.errors.push(problem);
            Loaded { value: None, report }
        }
    }
}

/// Records of the format that have no effect here.
const WITHOUT_EFFECT: [&str; 46] = [
    "HEADER", "OBSLTE", "TITLE", "SPLIT", "CAVEAT", "COMPND", "SOURCE", "KEYWDS", "EXPDTA", "NUMMDL",
    "MDLTYP", "AUTHOR", "REVDAT", "SPRSDE", "JRNL", "REMARK", "DBREF", "DBREF1", "DBREF2", "SEQADV",
    "SEQRES", "MODRES", "HET", "HETNAM", "HETSYN", "FORMUL", "HELIX", "SHEET", "TURN", "SSBOND", "LINK",
    "CISPEP", "SITE", "CRYST1", "ORIGX1", "ORIGX2", "ORIGX3", "SCALE1", "SCALE2", "SCALE3", "MTRIX1",
    "MTRIX2", "MTRIX3", "ANISOU", "SIGATM", "SIGUIJ",
];
/// More of them, by other programs.
const OTHERS: [&str; 5] = ["MASTER", "END", "USER", "HYDBND", "SLTBRG"];
/// Records that are used.
const USED: [&str; 6] = ["ATOM", "HETATM", "CONECT", "MODEL", "ENDMDL", "TER"];

/// What makes a residue: chain, number, insertion code, name.
type ResidueKey = (String, i64, char, String);

struct Reader {
    report: Report,
    pdb: Pdb,
    /// Atoms by the text of their serial number; none where several have it.
    serials: HashMap<String, Option<usize>>,
    residue: Option<ResidueKey>,
    /// Of the residues with alternate locations: the name of the first, and the atoms' names that have been read.
    alternates: HashMap<(String, i64, char), (String, BTreeSet<String>)>,
    left_out: Count,
    guessed: Count,
    models: usize,
    other_models: Count,
    /// True behind the first model.
    is_over: bool,
    links: Vec<(u32, String, String)>,
}

/// How often something happened, and where first.
#[derive(Default)]
struct Count {
    number: usize,
    line: Option<u32>,
}

impl Count {
    fn add(&mut self, line: u32) {
        self.number += 1;
        self.line.get_or_insert(line);
    }
}

impl Reader {
    fn new(source: &str) -> Self {
        Reader {
            report: Report::new(source),
            pdb: Pdb::default(),
            serials: HashMap::new(),
            residue: None,
            alternates: HashMap::new(),
            left_out: Count::default(),
            guessed: Count::default(),
            models: 0,
            other_models: Count::default(),
            is_over: false,
            links: Vec::new(),
        }
    }

    fn error(&mut self, line: u32, place: &str, found: String, required: &str, to_do: &str) {
        if self.report.errors.len() < MOST_ENTRIES {
            self.report.errors.push(Problem::new(Some(line), place, found, required, to_do));
        }
    }

    fn line(&mut self, number: u32, line: &str) {
        let record = line.get(..6).unwrap_or(line).trim_end();
        match record {
            "" if line.trim().is_empty() => {}
            "MODEL" => {
                self.models += 1;
                if self.models > 1 {
                    self.is_over = true;
                    self.other_models.add(number);
                }
            }
            "ENDMDL" => self.is_over = true,
            "ATOM" | "HETATM" if !self.is_over => self.atom(number, line),
            "TER" if !self.is_over => self.residue = None,
            "CONECT" => self.connection(number, line),
            "ATOM" | "HETATM" | "TER" => {}
            _ if WITHOUT_EFFECT.contains(&record) || OTHERS.contains(&record) => {}
            _ => {
                let known = [&USED[..], &WITHOUT_EFFECT, &OTHERS].concat();
                let to_do = match remedy(record, &known, "") {
                    guess if guess.starts_with("did") => guess,
                    _ => "remove the line, or begin it with REMARK".into(),
                };
                let found = format!("a line that begins with {}", quote(record));
                self.error(number, "record", found, "a record of the PDB format", &to_do);
            }
        }
    }

    fn atom(&mut self, number: u32, line: &str) {
        let (mut atom, serial, alternate) = match atom::parse(line, number) {
            Ok(parsed) => parsed,
            Err(atom::Mistake { place, found, required, remedy }) => {
                return self.error(number, &place, found, required, remedy);
            }
        };
        let place = (atom.chain.clone(), atom.residue_number, atom.insertion_code);
        if alternate != ' ' {
            let (name, read) = self
                .alternates
                .entry(place.clone())
                .or_insert_with(|| (atom.residue_name.clone(), BTreeSet::new()));
            // The first location of each atom, and no atom of another residue in the same place.
            if *name != atom.residue_name || !read.insert(atom.name.clone()) {
                return self.left_out.add(number);
            }
        }
        if atom.element.is_empty() {
            atom.element = atom::element_of_name(line).unwrap_or_default();
            self.guessed.add(number);
        }
        let key = (place.0, place.1, place.2, atom.residue_name.clone());
        if self.residue.as_ref() != Some(&key) {
            self.residue = Some(key);
            self.pdb.residues += 1;
        }
        atom.residue = self.pdb.residues - 1;
        let index = self.pdb.atoms.len();
        if !serial.is_empty() {
            self.serials.entry(serial).and_modify(|known| *known = None).or_insert(Some(index));
        }
        self.pdb.atoms.push(atom);
    }

    fn connection(&mut self, number: u32, line: &str) {
        let field = |k: usize| {
            let end = (11 + 5 * k).min(line.len());
            line.get(6 + 5 * k..end).map(str::trim).unwrap_or_default()
        };
        let place = format!("CONECT {}", field(0));
        for k in 0..5 {
            let text = field(k);
            if (k == 0 || !text.is_empty()) && number::parse(text, 5).is_none() {
                let found = format!("serial number {}", quote(text));
                return self.error(
                    number,
                    &place,
                    found,
                    "numbers of atoms in columns 7-31",
                    "correct the line",
                );
            }
            if k > 0 && !text.is_empty() {
                self.links.push((number, field(0).into(), text.into()));
            }
        }
    }

    fn finish(mut self) -> Loaded<Pdb> {
        let mut bonds = BTreeSet::new();
        let mut unknown = Count::default();
        for (line, from, to) in &self.links {
            let find = |serial: &String| self.serials.get(serial).copied().flatten();
            match (find(from), find(to)) {
                (Some(i), Some(j)) if i != j => {
                    bonds.insert([i.min(j), i.max(j)]);
                }
                _ => unknown.add(*line),
            }
        }
        self.pdb.bonds = bonds.into_iter().collect();
        if unknown.number > 0 {
            // Bonds of atoms that were left out have nowhere to go.
            if self.left_out.number > 0 || self.other_models.number > 0 {
                let what = format!("{} bonds of atoms that are left out", unknown.number);
                self.report.ignored.push(Note::new(unknown.line, "CONECT", what));
            } else {
                self.report.warnings.push(Problem::new(
                    unknown.line,
                    "CONECT",
                    format!("{} bonds of a serial number that no atom has, or several", unknown.number),
                    "serial numbers of two different atoms",
                    "number the atoms, or remove these records",
                ));
            }
        }
        if self.pdb.atoms.is_empty() && self.report.errors.is_empty() {
            self.report.errors.push(Problem::new(
                None,
                "file",
                "no ATOM or HETATM record",
                "at least one atom",
                "check that it is a PDB file; mmCIF files must be converted first",
            ));
        }
        let ignored = [
            (&self.left_out, "atom", "in another alternate location than the first"),
            (&self.other_models, "MODEL", "records behind the first one"),
        ];
        for (count, place, what) in ignored {
            if count.number > 0 {
                self.report.ignored.push(Note::new(count.line, place, format!("{} {what}", count.number)));
            }
        }
        if self.guessed.number > 0 {
            let what = format!("elements of {} atoms from their names", self.guessed.number);
            self.report.approximated.push(Note::new(self.guessed.line, "atom", what));
        }
        let elements = self.pdb.atoms.iter().filter(|atom| atom.element.is_empty()).count();
        if elements > 0 {
            let line = self.pdb.atoms.iter().find(|atom| atom.element.is_empty()).map(|atom| atom.line);
            self.report.warnings.push(Problem::new(
                line,
                "atom",
                format!("{elements} atoms without an element"),
                "a symbol in columns 77-78",
                "add it",
            ));
        }
        let what = format!(
            "atoms: {}, residues: {}, bonds: {}",
            self.pdb.atoms.len(),
            self.pdb.residues,
            self.pdb.bonds.len()
        );
        self.report.used.push(Note::new(None, "file", what));
        Loaded { value: self.report.errors.is_empty().then_some(self.pdb), report: self.report }
    }
}
