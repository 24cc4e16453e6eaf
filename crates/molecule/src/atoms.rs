//! What the torsion model has to know about atoms, and how they are called.

use std::fmt;

/// Boltzmann's constant, kJ/mol/K (CODATA 2018: exact).
pub const BOLTZMANN: f64 = 0.008_314_462_618_153_24;

/// An atom's place in a chain of residues.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AtomName {
    /// Chain, empty where there is only one.
    pub chain: String,
    /// Residue name and number: `ALA2`.
    pub residue: String,
    /// Name within the residue: `CA`.
    pub atom: String,
}

/// Atoms and the bonds between them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Atoms {
    /// Masses, Da.
    pub masses: Vec<f64>,
    /// Atomic numbers; 0 for a particle that is no atom.
    pub elements: Vec<u8>,
    /// Covalent bonds, each once, in either order.
    pub bonds: Vec<[usize; 2]>,
    /// Names; empty where there are none, and atoms are then called by their index.
    pub names: Vec<AtomName>,
}

impl Atoms {
    /// Number of atoms.
    pub fn len(&self) -> usize {
        self.masses.len()
    }
    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.masses.is_empty()
    }
    /// `ALA2:CA`, with the chain before it where there are several; the index where atoms have no names.
    pub fn label(&self, atom: usize) -> String {
        match self.names.get(atom) {
            Some(name) => format!("{}:{}", self.residue_label(name), name.atom),
            None => atom.to_string(),
        }
    }
    /// `ALA2:N-CA` within a residue, `ALA2:C-NME3:N` across two, `4-6` where atoms have no names; the lower index first.
    pub fn bond_label(&self, bond: [usize; 2]) -> String {
        let [i, j] = [bond[0].min(bond[1]), bond[0].max(bond[1])];
        match (self.names.get(i), self.names.get(j)) {
            (Some(a), Some(b)) if (&a.chain, &a.residue) == (&b.chain, &b.residue) => {
                format!("{}:{}-{}", self.residue_label(a), a.atom, b.atom)
            }
            _ => format!("{}-{}", self.label(i), self.label(j)),
        }
    }
    fn residue_label(&self, name: &AtomName) -> String {
        if name.chain.is_empty() { name.residue.clone() } else { format!("{}/{}", name.chain, name.residue) }
    }
    /// The atoms bonded to each atom.
    pub fn neighbors(&self) -> Vec<Vec<usize>> {
        let mut neighbors = vec![Vec::new(); self.len()];
        for &[i, j] in &self.bonds {
            neighbors[i].push(j);
            neighbors[j].push(i);
        }
        neighbors
    }
    /// The atoms of molecules of water: one oxygen and two hydrogens, bonded to each other and to nothing else.
    pub fn water(&self) -> Vec<usize> {
        let neighbors = self.neighbors();
        let is_hydrogen = |i: &usize| self.elements.get(*i) == Some(&1);
        let mut found = Vec::new();
        for oxygen in (0..self.len()).filter(|&i| self.elements.get(i) == Some(&8)) {
            let hydrogens = &neighbors[oxygen];
            // Rigid models bind the hydrogens to each other, too.
            let alone = |h: &usize| neighbors[*h].iter().all(|i| *i == oxygen || hydrogens.contains(i));
            if hydrogens.len() == 2 && hydrogens.iter().all(|h| is_hydrogen(h) && alone(h)) {
                found.push(oxygen);
                found.extend(hydrogens);
            }
        }
        found.sort_unstable();
        found
    }
    /// Every problem of the tables themselves.
    pub(crate) fn check(&self) -> Vec<MoleculeError> {
        let mut found = Vec::new();
        let n = self.len();
        for (what, len, may_miss) in
            [("elements", self.elements.len(), false), ("names", self.names.len(), true)]
        {
            if len != n && !(may_miss && len == 0) {
                found.push(MoleculeError::new(
                    what,
                    format!("{len} entries"),
                    format!("one for each of the {n} atoms"),
                    "give as many as there are masses",
                ));
            }
        }
        if !found.is_empty() {
            return found;
        }
        for (i, &mass) in self.masses.iter().enumerate() {
            if !(mass > 0.0 && mass.is_finite()) {
                found.push(MoleculeError::new(
                    format!("atom {}", self.label(i)),
                    format!("mass {mass} Da"),
                    "a finite mass above 0",
                    "correct the mass; a massless site cannot move as an atom",
                ));
            }
        }
        let mut seen = std::collections::HashSet::new();
        for &[i, j] in &self.bonds {
            if i >= n || j >= n || i == j {
                found.push(MoleculeError::new(
                    "bonds",
                    format!("a bond between atoms {i} and {j}"),
                    format!("two different atoms of 0…{}", n.saturating_sub(1)),
                    "correct the bond; atoms count from 0",
                ));
            } else if !seen.insert([i.min(j), i.max(j)]) {
                found.push(MoleculeError::new(
                    "bonds",
                    format!("bond {} given twice", self.bond_label([i, j])),
                    "each bond once",
                    "remove one of them",
                ));
            }
        }
        found
    }
}

/// A problem of a molecule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MoleculeError {
    /// The atom, bond or table.
    pub place: String,
    /// What was found.
    pub found: String,
    /// What is required.
    pub required: String,
    /// What to do.
    pub remedy: String,
}

impl MoleculeError {
    /// At a place: what was found, what is required, what to do.
    pub fn new(
        place: impl Into<String>,
        found: impl Into<String>,
        required: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        MoleculeError {
            place: place.into(),
            found: found.into(),
            required: required.into(),
            remedy: remedy.into(),
        }
    }
}

impl fmt::Display for MoleculeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let MoleculeError { place, found, required, remedy } = self;
        write!(f, "{place}: {found}; required: {required}; {remedy}")
    }
}

/// All problems of a molecule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MoleculeErrors(pub Vec<MoleculeError>);

impl fmt::Display for MoleculeErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, error) in self.0.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            error.fmt(f)?;
        }
        Ok(())
    }
}

impl std::error::Error for MoleculeErrors {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn water_is_told_by_its_bonds() {
        // Water, rigid water, methanol, hydroxide, hydrogen peroxide, a sodium ion, hydronium.
        let elements = [8, 1, 1, 1, 8, 1, 6, 1, 1, 1, 8, 1, 8, 1, 1, 8, 8, 1, 11, 8, 1, 1, 1];
        let bonds = [
            [0, 1],
            [2, 0],
            [3, 4],
            [4, 5],
            [3, 5],
            [6, 7],
            [6, 8],
            [6, 9],
            [6, 10],
            [10, 11],
            [12, 13],
            [14, 15],
            [15, 16],
            [16, 17],
            [19, 20],
            [19, 21],
            [19, 22],
        ];
        let atoms = Atoms {
            masses: vec![1.0; elements.len()],
            elements: elements.to_vec(),
            bonds: bonds.to_vec(),
            names: Vec::new(),
        };
        assert_eq!(atoms.water(), [0, 1, 2, 3, 4, 5]);
    }
}
