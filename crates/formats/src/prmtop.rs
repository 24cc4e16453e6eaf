//! AMBER's topology files (prmtop) and coordinates (inpcrd, rst7): atoms, and the tables of their force field as a [`System`].
//!
//! | section | here | units there |
//! |---|---|---|
//! | ATOM_NAME, RESIDUE_LABEL, RESIDUE_POINTER, ATOMIC_NUMBER, MASS | atoms | Da |
//! | CHARGE | charges, divided by 18.2223 | e √(332.0522 kcal Å/mol) |
//! | BOND_…, BONDS_… | `HarmonicBondForce`, k (r − r₀)² there and ½ k (r − r₀)² here | kcal/mol/Å², Å |
//! | ANGLE_…, ANGLES_… | `HarmonicAngleForce`, the same | kcal/mol/rad² |
//! | DIHEDRAL_…, DIHEDRALS_… | `PeriodicTorsionForce`, impropers too | kcal/mol |
//! | SCEE_SCALE_FACTOR, SCNB_SCALE_FACTOR | divide Coulomb and Lennard-Jones energies of 1-4 pairs; 1.2 and 2 where they are not there | |
//! | LENNARD_JONES_ACOEF, …_BCOEF, NONBONDED_PARM_INDEX | A/r¹² − B/r⁶ as σ and ε of each atom | kcal/mol Å¹², Å⁶ |
//! | EXCLUDED_ATOMS_LIST | exceptions without energy | |
//! | CMAP_… | `CMAPTorsionForce`; its maps begin at −180° | kcal/mol |
//! | RADII, SCREEN | `GBSAOBCForce`, where [`PrmtopOptions::obc2`] asks for it | Å |
//!
//! A file has eight digits of each number, so that energies have seven. Refused: 10-12 terms, pairs of types with Lennard-Jones
//! terms of their own, files of CHARMM's force field, perturbations, caps of water, virtual sites. A periodic box is ignored,
//! as there is no cutoff, and the report says so.

mod bonded;
mod nonbonded;
mod sections;

use crate::file::read_text;
use crate::pdb::{Pdb, PdbAtom};
use crate::report::{Loaded, Note, Problem, Report};
use crate::suggest::quote;
use crate::system::{Force, ForceKind, System};
use sections::Sections;
use std::path::Path;

/// kJ in a kcal.
const CALORIE: f64 = 4.184;

/// Atoms and force field of a prmtop file.
#[derive(Clone, Debug, Default)]
pub struct Prmtop {
    /// The atoms, without positions, and their bonds.
    pub atoms: Pdb,
    /// The force field.
    pub system: System,
}

/// How a prmtop file is read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PrmtopOptions {
    /// Dielectric constants of solvent and molecule of a generalized Born energy (OBC2, with surface energy); `None`: vacuum.
    pub obc2: Option<[f64; 2]>,
}

/// The numbers of things in a file, by their places in POINTERS.
struct Pointers(Vec<i64>);

impl Pointers {
    fn at(&self, place: usize) -> i64 {
        self.0.get(place).copied().unwrap_or(0)
    }
    /// A number of fields; a file has not so many that this bound matters.
    fn count(&self, place: usize) -> usize {
        usize::try_from(self.at(place)).unwrap_or(0).min(1 << 24)
    }
}

/// Atoms and force field of a prmtop text; `source` is its name in the report.
///
/// # Cost
/// O(n) in the length of the text.
///
/// # Errors
/// In the report: sections that are missing, too short or no numbers; atoms that do not exist; what the module's page refuses.
///
/// # Example
/// ```
/// use phipsi_formats::prmtop::{PrmtopOptions, read_prmtop};
/// let report = read_prmtop("ATOM", "a.prmtop", &PrmtopOptions::default()).into_result(false).unwrap_err();
/// assert_eq!(report.errors[0].required, "a prmtop file of AMBER 7 or later");
/// ```
pub fn read_prmtop(text: &str, source: &str, options: &PrmtopOptions) -> Loaded<Prmtop> {
    let mut sections = Sections::new(text, source);
    let value = if sections.report.errors.is_empty() { read(&mut sections, options) } else { None };
    let mut report = sections.report;
    if let Some(prmtop) = &value {
        let what = format!("{}, of {} residues", prmtop.atoms.atoms.len(), prmtop.atoms.residues);
        report.used.insert(0, Note::new(None, "atoms", what));
        for force in &prmtop.system.forces {
            report.used.push(Note::new(force.line, format!("force `{}`", force.name), "energy"));
        }
    }
    Loaded { value: value.filter(|_| report.errors.is_empty()), report }
}

/// Atoms and force field of a prmtop file.
///
/// # Errors
/// In the report: a file that cannot be read, is larger than 256 MiB or is not UTF-8; else as [`read_prmtop`].
pub fn read_prmtop_file(path: impl AsRef<Path>, options: &PrmtopOptions) -> Loaded<Prmtop> {
    let source = path.as_ref().display().to_string();
    match read_text(path.as_ref(), "a prmtop file") {
        Ok(text) => read_prmtop(&text, &source, options),
        Err(problem) => failed(source, problem),
    }
}

/// Positions of an inpcrd or rst7 text, nm, of `atoms` atoms; velocities and the box are ignored.
///
/// # Errors
/// In the report: another number of atoms, numbers that cannot be read.
///
/// # Example
/// ```
/// use phipsi_formats::prmtop::read_inpcrd;
/// let text = "title\n    1\n   1.0000000   2.0000000  -3.5000000\n";
/// let (positions, _) = read_inpcrd(text, "a.inpcrd", 1).into_result(true)?;
/// assert_eq!(positions, [[0.1, 0.2, -0.35]]);
/// # Ok::<(), Box<phipsi_formats::Report>>(())
/// ```
pub fn read_inpcrd(text: &str, source: &str, atoms: usize) -> Loaded<Vec<[f64; 3]>> {
    let mut report = Report::new(source);
    let found = inpcrd(text, atoms, &mut report);
    if let Err(problem) = &found {
        report.errors.push(problem.clone());
    }
    Loaded { value: found.ok(), report }
}

/// Positions of an inpcrd or rst7 file.
///
/// # Errors
/// In the report: a file that cannot be read, is larger than 256 MiB or is not UTF-8 (such as NetCDF); else as [`read_inpcrd`].
pub fn read_inpcrd_file(path: impl AsRef<Path>, atoms: usize) -> Loaded<Vec<[f64; 3]>> {
    let source = path.as_ref().display().to_string();
    match read_text(path.as_ref(), "an inpcrd file in text, not NetCDF") {
        Ok(text) => read_inpcrd(&text, &source, atoms),
        Err(problem) => failed(source, problem),
    }
}

fn failed<T>(source: String, problem: Problem) -> Loaded<T> {
    Loaded { value: None, report: Report { errors: vec![problem], ..Report::new(source) } }
}

fn inpcrd(text: &str, atoms: usize, report: &mut Report) -> Result<Vec<[f64; 3]>, Problem> {
    /// Columns of a number.
    const WIDTH: usize = 12;
    let problem = |line: u32, found: String, required: String, remedy: &str| {
        Problem::new(Some(line), "coordinates", found, required, remedy)
    };
    let mut lines = (1u32..).zip(text.lines()).skip(1);
    let count = lines.next().and_then(|(_, line)| line.split_ascii_whitespace().next());
    let given = count.and_then(|word| word.parse::<usize>().ok());
    if given != Some(atoms) {
        let found = format!("{} atoms", count.map_or("no number of".into(), quote));
        let required = format!("{atoms} atoms, as the prmtop file has");
        return Err(problem(2, found, required, "give the coordinates of the same atoms"));
    }
    let mut numbers = Vec::with_capacity(3 * atoms);
    let mut rest = 0;
    for (number, line) in lines {
        if !line.is_ascii() {
            let found = "a character that is not ASCII".to_string();
            return Err(problem(number, found, "numbers".into(), "remove it"));
        }
        for at in (0..line.trim_end().len()).step_by(WIDTH) {
            if numbers.len() == 3 * atoms {
                rest += 1;
                continue;
            }
            let field = line[at..(at + WIDTH).min(line.len())].trim();
            match field.parse::<f64>().ok().filter(|x| x.is_finite()) {
                Some(x) => numbers.push(x / 10.0),
                None => {
                    let required = "finite numbers of 12 columns".to_string();
                    return Err(problem(number, quote(field), required, "correct it"));
                }
            }
        }
    }
    if numbers.len() < 3 * atoms {
        let found = format!("{} numbers", numbers.len());
        return Err(problem(
            2,
            found,
            format!("{}", 3 * atoms),
            "see whether the file was written to its end",
        ));
    }
    if rest > 0 {
        report.ignored.push(Note::new(None, "coordinates", "velocities and the box"));
    }
    Ok(numbers.chunks_exact(3).map(|x| [x[0], x[1], x[2]]).collect())
}

fn read(sections: &mut Sections<'_>, options: &PrmtopOptions) -> Option<Prmtop> {
    let pointers = Pointers(sections.integers("POINTERS", None)?);
    refuse(sections, &pointers);
    let n = pointers.count(0);
    if n == 0 {
        sections.error(
            sections.line("POINTERS"),
            "POINTERS",
            "no atoms".into(),
            "at least one",
            "write the file anew",
        );
        return None;
    }
    let mut atoms = read_atoms(sections, n, pointers.count(11))?;
    let masses = sections.reals("MASS", n)?;
    if let Some(i) = masses.iter().position(|m| *m < 0.0) {
        let found = format!("mass {} of atom {}", masses[i], i + 1);
        sections.error(sections.line("MASS"), "MASS", found, "masses that are not negative", "correct it");
    }
    let mut system = System { masses, ..System::default() };
    let mut add = |sections: &Sections<'_>, class: &str, section: &str, kind: ForceKind| {
        let line = sections.line(section);
        system.forces.push(Force { name: class.into(), class: class.into(), group: 0, line, kind });
    };
    let bonds = bonded::bonds(sections, &pointers, n)?;
    atoms.bonds = bonds.iter().map(|b| [b.atoms[0].min(b.atoms[1]), b.atoms[0].max(b.atoms[1])]).collect();
    atoms.bonds.sort_unstable();
    atoms.bonds.dedup();
    add(sections, "HarmonicBondForce", "BOND_FORCE_CONSTANT", ForceKind::HarmonicBond(bonds));
    let angles = bonded::angles(sections, &pointers, n)?;
    add(sections, "HarmonicAngleForce", "ANGLE_FORCE_CONSTANT", ForceKind::HarmonicAngle(angles));
    let (torsions, pairs) = bonded::torsions(sections, &pointers, n)?;
    add(sections, "PeriodicTorsionForce", "DIHEDRAL_FORCE_CONSTANT", ForceKind::PeriodicTorsion(torsions));
    if let Some(maps) = bonded::maps(sections, n) {
        add(sections, "CMAPTorsionForce", "CMAP_COUNT", ForceKind::CmapTorsion(maps));
    }
    let nonbonded = nonbonded::nonbonded(sections, &pointers, n, &pairs)?;
    let charges: Vec<f64> = nonbonded.particles.iter().map(|p| p.charge).collect();
    add(sections, "NonbondedForce", "LENNARD_JONES_ACOEF", ForceKind::Nonbonded(nonbonded));
    if let Some(dielectric) = options.obc2 {
        let solvent = nonbonded::gbsa_obc(sections, &charges, dielectric)?;
        add(sections, "GBSAOBCForce", "RADII", ForceKind::GbsaObc(solvent));
    }
    Some(Prmtop { atoms, system })
}

/// What a file may have that has no counterpart here.
fn refuse(sections: &mut Sections<'_>, pointers: &Pointers) {
    let line = sections.line("POINTERS");
    if let Some(k) = pointers.0.iter().position(|n| *n < 0) {
        let found = format!("field {} is {}", k + 1, pointers.at(k));
        sections.error(line, "POINTERS", found, "numbers that are not negative", "write the file anew");
    }
    let refused = [
        (20, "a perturbation (IFPERT)", "write a file without it"),
        (29, "a cap of water (IFCAP)", "write a file without it"),
        (30, "virtual sites (NUMEXTRA)", "use a model of water without them, such as TIP3P"),
    ];
    for (place, found, remedy) in refused {
        if pointers.at(place) != 0 {
            sections.error(line, "POINTERS", found.into(), "none", remedy);
        }
    }
    for (section, found) in [
        ("CHARMM_UREY_BRADLEY_COUNT", "CHARMM's force field"),
        ("LENNARD_JONES_CCOEF", "12-6-4 Lennard-Jones terms"),
        ("POLARIZABILITY", "polarizabilities"),
    ] {
        if sections.has(section) {
            let remedy = "make a System with OpenMM: createSystem, then XmlSerializer.serialize";
            sections.error(sections.line(section), section, found.into(), "AMBER's force field", remedy);
        }
    }
    if pointers.at(27) != 0 {
        let what = "periodic box: there is no cutoff, and all pairs interact once";
        sections.report.ignored.push(Note::new(line, "section `POINTERS`", what));
    }
}

fn read_atoms(sections: &mut Sections<'_>, n: usize, residues: usize) -> Option<Pdb> {
    let names = sections.words("ATOM_NAME", n)?;
    let labels = sections.words("RESIDUE_LABEL", residues)?;
    let starts = sections.integers("RESIDUE_POINTER", Some(residues))?;
    let numbers = match sections.has("ATOMIC_NUMBER") {
        true => sections.integers("ATOMIC_NUMBER", Some(n))?,
        false => vec![0; n],
    };
    let rising = starts.windows(2).all(|w| w[0] < w[1]) && starts.iter().all(|s| (1..=n as i64).contains(s));
    if !rising || starts.first() != Some(&1) {
        let found = "first atoms of residues that do not rise from 1".to_string();
        let line = sections.line("RESIDUE_POINTER");
        sections.error(line, "RESIDUE_POINTER", found, "rising numbers of atoms", "write the file anew");
        return None;
    }
    let mut residue = 0;
    let atom = |(i, name): (usize, String)| {
        if starts.get(residue + 1).is_some_and(|start| *start == i as i64 + 1) {
            residue += 1;
        }
        let element =
            u8::try_from(numbers[i]).ok().and_then(crate::pdb::symbol_of_number).unwrap_or_default();
        PdbAtom {
            name,
            residue_name: labels.get(residue).cloned().unwrap_or_default(),
            chain: String::new(),
            residue_number: residue as i64 + 1,
            insertion_code: ' ',
            residue,
            element: element.into(),
            position: [0.0; 3],
            serial: None,
            hetero: false,
            line: 0,
        }
    };
    let atoms = names.into_iter().enumerate().map(atom).collect();
    Some(Pdb { atoms, bonds: Vec::new(), residues })
}
