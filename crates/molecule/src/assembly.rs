//! Atoms and bonds of a PDB file and an OpenMM System that belong together.
//!
//! | what | from |
//! |---|---|
//! | masses | the System |
//! | names, elements, positions | the PDB file; an element that it does not give: by the mass |
//! | bonds | springs (HarmonicBondForce) and constraints of the System, CONECT of the PDB; none is guessed from distances |
//!
//! Springs between atoms that share a neighbour are no bonds where they are 1.2 times as long as both bonds to it
//! (Urey–Bradley springs, rigid water; in rings of three atoms the ratio is near 1), nor are springs above 0.3 nm
//! (restraints).

use crate::atoms::{AtomName, Atoms, MoleculeError, MoleculeErrors};
use crate::masses::{element_of_mass, misfits, weight};
use phipsi_formats::pdb::{Pdb, PdbAtom, atomic_number};
use phipsi_formats::system::{ForceKind, System};
use phipsi_spatial::Vec3;
use std::collections::BTreeMap;

/// A spring this much longer than the bonds of both its ends to a third atom spans their angle.
const SPAN: f64 = 1.2;

/// A spring longer than this, nm, is a restraint.
const LONGEST_BOND: f64 = 0.3;

/// A constraint longer than this, nm, is no bond: S–S and C–I have 0.21.
const LONGEST_CONSTRAINED: f64 = 0.22;

/// Most problems that are named.
const MOST_NAMED: usize = 10;

/// Atoms with their positions.
#[derive(Clone, Debug)]
pub struct Assembled {
    /// Masses, elements, bonds, names.
    pub atoms: Atoms,
    /// Positions of the PDB file, nm.
    pub positions: Vec<Vec3<f64>>,
}

/// Puts a PDB file and a System together.
///
/// # Errors
/// [`MoleculeErrors`]: different numbers of atoms; an atom whose element and mass contradict each other, which is the sign of
/// another order of atoms. At most ten are named.
pub fn assemble(pdb: &Pdb, system: &System) -> Result<Assembled, MoleculeErrors> {
    let (found, required) = (pdb.atoms.len(), system.masses.len());
    if found != required {
        let nearest = pdb.atoms.get(found.min(required).saturating_sub(1)).map_or(String::new(), |a| {
            format!("; the last of both is {} in line {} of the PDB file", label(a), a.line)
        });
        return Err(MoleculeErrors(vec![MoleculeError::new(
            "molecule",
            format!("{found} atoms in the PDB file and {required} particles in the System{nearest}"),
            "the same atoms in the same order",
            "write both files from the same topology: hydrogens and water are often missing in the PDB file",
        )]));
    }
    // Chains are named only where there are several.
    let several = pdb.atoms.iter().any(|a| a.chain != pdb.atoms[0].chain);
    let names = pdb.atoms.iter().map(|a| AtomName {
        chain: if several { a.chain.clone() } else { String::new() },
        residue: residue(a),
        atom: a.name.clone(),
    });
    let element =
        |(a, &mass): (&PdbAtom, &f64)| atomic_number(&a.element).unwrap_or_else(|| element_of_mass(mass));
    let elements = pdb.atoms.iter().zip(&system.masses).map(element);
    let atoms = Atoms {
        masses: system.masses.clone(),
        elements: elements.collect(),
        bonds: bonds(pdb, system),
        names: names.collect(),
    };
    let misfits = misfits(&atoms);
    if !misfits.is_empty() {
        let error = |&i: &usize| misfit(&atoms, &pdb.atoms[i], i);
        return Err(MoleculeErrors(misfits.iter().take(MOST_NAMED).map(error).collect()));
    }
    Ok(Assembled { atoms, positions: pdb.atoms.iter().map(|a| Vec3(a.position)).collect() })
}

fn residue(atom: &PdbAtom) -> String {
    format!("{}{}{}", atom.residue_name, atom.residue_number, atom.insertion_code).trim().into()
}

fn label(atom: &PdbAtom) -> String {
    format!("{}:{}", residue(atom), atom.name)
}

fn misfit(atoms: &Atoms, atom: &PdbAtom, i: usize) -> MoleculeError {
    let line = if atom.line > 0 { format!(" in line {} of the PDB file", atom.line) } else { String::new() };
    let element = &atom.element;
    MoleculeError::new(
        format!("atom {}", atoms.label(i)),
        format!("element {element}{line}, but a mass of {} Da in the System", atoms.masses[i]),
        format!("{} Da, the mass of {element}", weight(atoms.elements[i]).unwrap_or_default()),
        "write both files from one topology, so that the order of atoms is the same",
    )
}

fn bonds(pdb: &Pdb, system: &System) -> Vec<[usize; 2]> {
    let ordered = |[i, j]: [usize; 2]| [i.min(j), i.max(j)];
    let mut length: BTreeMap<[usize; 2], f64> = BTreeMap::new();
    for force in &system.forces {
        let ForceKind::HarmonicBond(springs) = &force.kind else { continue };
        for spring in springs {
            let least = length.entry(ordered(spring.atoms)).or_insert(spring.length);
            *least = least.min(spring.length);
        }
    }
    for c in system.constraints.iter().filter(|c| c.distance <= LONGEST_CONSTRAINED) {
        length.entry(ordered(c.atoms)).or_insert(c.distance);
    }
    let mut neighbors: BTreeMap<usize, BTreeMap<usize, f64>> = BTreeMap::new();
    for (&[i, j], &distance) in &length {
        neighbors.entry(i).or_default().insert(j, distance);
        neighbors.entry(j).or_default().insert(i, distance);
    }
    let spans = |[i, j]: [usize; 2], distance: f64| {
        neighbors[&i]
            .iter()
            .any(|(k, to_i)| neighbors[&j].get(k).is_some_and(|to_j| distance > SPAN * to_i.max(*to_j)))
    };
    let is_bond = |pair: [usize; 2], distance: f64| distance <= LONGEST_BOND && !spans(pair, distance);
    let mut bonds: Vec<[usize; 2]> =
        length.iter().filter(|(pair, distance)| is_bond(**pair, **distance)).map(|(pair, _)| *pair).collect();
    bonds.extend(pdb.bonds.iter().map(|b| ordered(*b)));
    bonds.sort_unstable();
    bonds.dedup();
    bonds
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_formats::pdb::read_pdb;
    use phipsi_formats::system::{SystemOptions, read_system};

    /// Atoms (name, element, mass) and springs (atoms, length).
    fn read(
        atoms: &[(&str, &str, f64)],
        springs: &[(usize, usize, f64)],
    ) -> Result<Assembled, MoleculeErrors> {
        let mut text = String::new();
        for (i, (name, symbol, _)) in atoms.iter().enumerate() {
            let x = 1.1 * i as f64;
            text += &format!("ATOM  {:5} {name:^4} RES A   1    {x:8.3}{x:8.3}{x:8.3}  1.00  0.00", i + 1);
            text += &format!("          {symbol:>2}\n");
        }
        let particles: String = atoms.iter().map(|(.., m)| format!("<Particle mass=\"{m}\"/>")).collect();
        let springs: String = springs
            .iter()
            .map(|(i, j, d)| format!("<Bond p1=\"{i}\" p2=\"{j}\" d=\"{d}\" k=\"1\"/>"))
            .collect();
        let xml = format!(
            "<System><Particles>{particles}</Particles><Forces><Force type=\"HarmonicBondForce\"><Bonds>{springs}\
             </Bonds></Force></Forces></System>"
        );
        let (pdb, system) = (read_pdb(&text, "a.pdb"), read_system(&xml, "a.xml", &SystemOptions::default()));
        assemble(&pdb.value.unwrap(), &system.value.unwrap())
    }

    const METHANOL: [(&str, &str, f64); 6] = [
        ("C", "C", 12.01),
        ("H1", "H", 1.008),
        ("H2", "H", 1.008),
        ("H3", "H", 1.008),
        ("O", "O", 16.0),
        ("HO", "H", 1.008),
    ];
    const SPRINGS: [(usize, usize, f64); 5] =
        [(0, 1, 0.109), (2, 0, 0.109), (0, 3, 0.109), (0, 4, 0.141), (4, 5, 0.096)];

    #[test]
    fn bonds_are_those_of_springs_that_span_no_angle() {
        // Urey–Bradley springs of all kinds, a restraint, and a bond given twice.
        let others = [(1, 2, 0.1802), (1, 4, 0.2), (0, 5, 0.195), (2, 5, 0.31), (0, 1, 0.109)];
        let molecule = read(&METHANOL, &[&SPRINGS[..], &others].concat()).unwrap();
        assert_eq!(molecule.atoms.bonds, [[0, 1], [0, 2], [0, 3], [0, 4], [4, 5]]);
        assert_eq!(molecule.atoms.label(5), "RES1:HO");
    }

    #[test]
    fn rings_of_three_atoms_keep_their_bonds() {
        // Thiirane, without hydrogens.
        let atoms = [("C1", "C", 12.0), ("C2", "C", 12.0), ("S", "S", 32.1)];
        let molecule = read(&atoms, &[(0, 1, 0.148), (0, 2, 0.182), (1, 2, 0.182)]).unwrap();
        assert_eq!(molecule.atoms.bonds, [[0, 1], [0, 2], [1, 2]]);
    }

    #[test]
    fn elements_and_masses_that_contradict_each_other_name_the_atom() {
        let mut atoms = METHANOL;
        (atoms[1].2, atoms[4].2) = (16.0, 1.008);
        let errors = read(&atoms, &SPRINGS).unwrap_err().0;
        assert_eq!(
            errors.iter().map(|e| e.place.as_str()).collect::<Vec<_>>(),
            ["atom RES1:H1", "atom RES1:O"]
        );
        // Heavy hydrogens take their mass from their carbon.
        let mut heavy = METHANOL;
        heavy[1..4].iter_mut().for_each(|a| a.2 = 3.0);
        heavy[0].2 = 6.0;
        assert!(read(&heavy, &SPRINGS).is_ok());
    }
}
