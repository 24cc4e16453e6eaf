//! Molecules from files: the atoms of a PDB and the System of their force field, with reports on both.

use crate::assembly::assemble;
use crate::atoms::{Atoms, MoleculeError};
use crate::potential::PotentialError;
use phipsi_formats::pdb::{Pdb, read_pdb_file};
use phipsi_formats::system::{System, SystemOptions, read_system_file};
use phipsi_formats::{Note, Problem, Report};
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
    let (pdb, mut system) = (read_pdb_file(pdb), read_system_file(system, options));
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
