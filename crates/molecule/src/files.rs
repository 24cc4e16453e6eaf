//! Molecules from files: the atoms of a PDB and the System of their force field, with reports on both.

use crate::assembly::assemble;
use crate::atoms::{Atoms, MoleculeError};
use crate::potential::PotentialError;
use phipsi_formats::pdb::{Pdb, read_pdb_file};
use phipsi_formats::prmtop::Prmtop;
use phipsi_formats::system::{System, SystemOptions, read_system_file};
use phipsi_formats::{Loaded, Note, Problem, Report};
use phipsi_spatial::Vec3;
use std::path::Path;

/// Atoms with positions, and the System of their force field.
#[derive(Clone, Debug)]
pub struct Molecule {
    /// Names, elements, masses, bonds.
    pub atoms: Atoms,
    /// Positions of the PDB, nm.
    pub positions: Vec<Vec3<f64>>,
    /// The System.
    pub system: System,
}

/// A molecule, where there were no errors, and the reports on the PDB and on the System, always.
#[derive(Clone, Debug)]
pub struct LoadedMolecule {
    /// The molecule; `None` exactly if a report has errors.
    pub value: Option<Molecule>,
    /// On the PDB and on the System.
    pub reports: [Report; 2],
}

impl LoadedMolecule {
    /// The molecule with its reports.
    ///
    /// # Errors
    /// The reports, if one has errors, or warnings where `strict`.
    pub fn into_result(self, strict: bool) -> Result<(Molecule, [Report; 2]), Box<[Report; 2]>> {
        match self.value {
            Some(value) if self.reports.iter().all(|r| r.is_ok(strict)) => Ok((value, self.reports)),
            _ => Err(Box::new(self.reports)),
        }
    }
}

/// Reads a PDB file and the System of the same atoms in an XML file.
///
/// # Errors
/// In the reports: those of the readers, and of [`assemble`] for files that are not of the same atoms.
pub fn read_molecule(
    pdb: impl AsRef<Path>,
    system: impl AsRef<Path>,
    options: &SystemOptions,
) -> LoadedMolecule {
    join(read_pdb_file(pdb), read_system_file(system, options), options)
}

/// A PDB file and a System that have been read.
///
/// # Errors
/// As [`read_molecule`].
pub fn join(pdb: Loaded<Pdb>, mut system: Loaded<System>, options: &SystemOptions) -> LoadedMolecule {
    for name in &options.ignore {
        let place = format!("force `{name}`");
        let is = |note: &Note| note.place == place || note.what.split(',').next() == Some(name);
        if system.value.is_some() && !system.report.ignored.iter().any(is) {
            system.report.warnings.push(Problem::new(
                None,
                place,
                "not in this System, though it is to be ignored",
                "names or classes of its forces",
                "correct the name",
            ));
        }
    }
    match (pdb.value, system.value) {
        (Some(atoms), Some(value)) => Molecule::load(&atoms, value, [pdb.report, system.report]),
        _ => LoadedMolecule { value: None, reports: [pdb.report, system.report] },
    }
}

/// A prmtop file that has been read, and positions of so many atoms. The reports: on the positions, on the prmtop file.
///
/// # Errors
/// In the reports: those of the readers.
pub fn join_amber(
    prmtop: Loaded<Prmtop>,
    positions: impl FnOnce(usize) -> Loaded<Vec<[f64; 3]>>,
) -> LoadedMolecule {
    let Some(Prmtop { mut atoms, system }) = prmtop.value else {
        return LoadedMolecule { value: None, reports: [Report::new("coordinates"), prmtop.report] };
    };
    let positions = positions(atoms.atoms.len());
    let reports = [positions.report, prmtop.report];
    let Some(positions) = positions.value else { return LoadedMolecule { value: None, reports } };
    atoms.atoms.iter_mut().zip(positions).for_each(|(atom, position)| atom.position = position);
    Molecule::load(&atoms, system, reports)
}

impl Molecule {
    /// The molecule of both tables, with the reports on them.
    ///
    /// # Errors
    /// In the first report: those of [`assemble`].
    pub fn load(pdb: &Pdb, system: System, mut reports: [Report; 2]) -> LoadedMolecule {
        let value = match assemble(pdb, &system) {
            Ok(assembled) => {
                let what = format!("{}, of springs, constraints and CONECT", assembled.atoms.bonds.len());
                reports[1].used.push(Note::new(None, "bonds", what));
                Some(Molecule { atoms: assembled.atoms, positions: assembled.positions, system })
            }
            Err(errors) => {
                let other = &reports[1].source;
                let problems = errors.0.into_iter().map(|e| {
                    let MoleculeError { place, found, required, remedy } = e;
                    Problem::new(None, place, format!("{found} (the System is {other})"), required, remedy)
                });
                reports[0].errors.extend(problems);
                None
            }
        };
        LoadedMolecule { value, reports }
    }
    /// An error of the potential with the names of its atoms.
    pub fn describe(&self, error: &PotentialError) -> String {
        let named = |i: &usize| format!("{i} = {}", self.atoms.label(*i));
        let names: Vec<String> = error.atoms.iter().map(named).collect();
        match names.is_empty() {
            true => format!("term `{}`: {}", error.term, error.message),
            false => format!("term `{}`: {} (atoms {})", error.term, error.message, names.join(", ")),
        }
    }
}
