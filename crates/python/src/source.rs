//! What a `System` is made of: kept, so that it can be made again in another process.

use phipsi::formats::pdb::{Pdb, PdbAtom, read_pdb};
use phipsi::formats::prmtop::{PrmtopOptions, read_inpcrd, read_prmtop};
use phipsi::formats::system::{System as Tables, SystemOptions, read_system};
use phipsi::formats::{Loaded, Report};
use phipsi::molecule::{LoadedMolecule, Molecule, join, join_amber};

/// An atom of another program's topology: name, residue name, chain, residue number, element; the residue counted from 0.
pub type TopologyAtom = (String, String, String, i64, usize, String);

/// Texts, or tables of another program.
#[derive(Clone, Debug, Default)]
pub struct Source {
    /// `files`: a PDB file and a System; `openmm`: a System and tables; `amber`: a prmtop and an inpcrd file; `atoms`: tables.
    pub kind: String,
    /// Names and texts of files.
    pub texts: Vec<(String, String)>,
    /// Dielectric constants of `amber`, masses of `atoms`.
    pub numbers: Vec<f64>,
    /// Tables.
    pub atoms: Vec<TopologyAtom>,
    /// Bonds.
    pub bonds: Vec<[usize; 2]>,
    /// Positions, nm, three for each atom.
    pub positions: Vec<f64>,
    /// Forces that are left out.
    pub ignore: Vec<String>,
}

impl Source {
    /// Reads it. `None` for what no `Source` of this crate is.
    pub fn load(&self) -> Option<LoadedMolecule> {
        let options = SystemOptions { ignore: self.ignore.clone() };
        if self.positions.len() != 3 * self.atoms.len()
            || self.bonds.iter().flatten().any(|i| *i >= self.atoms.len())
        {
            return None;
        }
        let text = |i: usize| self.texts.get(i).map(|(name, text)| (name.as_str(), text.as_str()));
        match self.kind.as_str() {
            "files" => {
                let ((pdb_name, pdb), (name, xml)) = (text(0)?, text(1)?);
                Some(join(read_pdb(pdb, pdb_name), read_system(xml, name, &options), &options))
            }
            "openmm" => {
                let (name, xml) = text(0)?;
                Some(self.with_tables(read_system(xml, name, &options)))
            }
            "amber" => {
                let ((name, prmtop), (other, inpcrd)) = (text(0)?, text(1)?);
                let obc2 = <[f64; 2]>::try_from(&self.numbers[..]).ok();
                let prmtop = read_prmtop(prmtop, name, &PrmtopOptions { obc2 });
                Some(join_amber(prmtop, |n| read_inpcrd(inpcrd, other, n)))
            }
            "atoms" => {
                let tables = Tables { masses: self.numbers.clone(), ..Tables::default() };
                Some(self.with_tables(Loaded { value: Some(tables), report: Report::new("atoms") }))
            }
            _ => None,
        }
    }
    fn with_tables(&self, system: Loaded<Tables>) -> LoadedMolecule {
        let reports = [Report::new("Topology"), system.report];
        match system.value {
            Some(value) => Molecule::load(&self.table(), value, reports),
            None => LoadedMolecule { value: None, reports },
        }
    }
    /// Another program's topology as the table of a PDB.
    fn table(&self) -> Pdb {
        let residues = self.atoms.last().map_or(0, |atom| atom.4 + 1);
        let atom = |(i, atom): (usize, &TopologyAtom)| {
            let (name, residue_name, chain, residue_number, residue, element) = atom.clone();
            let x = &self.positions[3 * i..3 * i + 3];
            PdbAtom {
                name,
                residue_name,
                chain,
                residue_number,
                insertion_code: ' ',
                residue,
                element,
                position: [x[0], x[1], x[2]],
                serial: None,
                hetero: false,
                line: 0,
            }
        };
        Pdb { atoms: self.atoms.iter().enumerate().map(atom).collect(), bonds: self.bonds.clone(), residues }
    }
}
