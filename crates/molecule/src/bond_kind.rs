//! Kinds of rotatable bonds, decided from elements and bonding alone.
//!
//! | kind | bond |
//! |---|---|
//! | omega | carbonyl C to an N with another heavy neighbour: secondary and tertiary amides |
//! | planar | carbonyl C to another N (primary amides), and C with three neighbours, two of them N, to N: guanidinium, amidines |
//! | backbone_phi, backbone_psi | N and carbonyl C of an amino acid to its α carbon, charged ends included |
//! | methyl | a light rotor: one end has only hydrogens beyond (CH₃, NH₃⁺, OH, SH) |
//! | chi | all others |
//!
//! The first that fits, from the top: the NH₂ of a primary amide is planar, no light rotor, and the bond to a charged
//! N-terminus is backbone_phi.

use crate::atoms::Atoms;

const H: u8 = 1;
const C: u8 = 6;
const N: u8 = 7;
const O: u8 = 8;
const S: u8 = 16;

/// The kind of a rotatable bond.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum BondKind {
    /// An amide bond.
    Omega,
    /// Another conjugated bond to nitrogen.
    Planar,
    /// N–Cα.
    BackbonePhi,
    /// Cα–C.
    BackbonePsi,
    /// A light rotor.
    Methyl,
    /// Any other.
    Chi,
}

impl BondKind {
    /// All kinds.
    pub const ALL: [BondKind; 6] = [
        BondKind::Omega,
        BondKind::Planar,
        BondKind::BackbonePhi,
        BondKind::BackbonePsi,
        BondKind::Methyl,
        BondKind::Chi,
    ];
    /// The word for it in scene files.
    pub fn word(self) -> &'static str {
        match self {
            BondKind::Omega => "omega",
            BondKind::Planar => "planar",
            BondKind::BackbonePhi => "backbone_phi",
            BondKind::BackbonePsi => "backbone_psi",
            BondKind::Methyl => "methyl",
            BondKind::Chi => "chi",
        }
    }
    /// The kind of a word.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.word() == word)
    }
}

/// The bonding around atoms.
pub(crate) struct Chemistry<'a> {
    elements: &'a [u8],
    neighbors: &'a [Vec<usize>],
}

impl<'a> Chemistry<'a> {
    pub(crate) fn new(atoms: &'a Atoms, neighbors: &'a [Vec<usize>]) -> Self {
        Chemistry { elements: &atoms.elements, neighbors }
    }
    fn is(&self, atom: usize, element: u8) -> bool {
        self.elements[atom] == element
    }
    fn count(&self, atom: usize, element: u8) -> usize {
        self.neighbors[atom].iter().filter(|&&n| self.is(n, element)).count()
    }
    /// C with three neighbours, one of them a terminal O or S.
    fn is_carbonyl(&self, atom: usize) -> bool {
        let terminal = |&n: &usize| (self.is(n, O) || self.is(n, S)) && self.neighbors[n].len() == 1;
        self.is(atom, C) && self.neighbors[atom].len() == 3 && self.neighbors[atom].iter().any(terminal)
    }
    /// Tetrahedral C between an N and a carbonyl C.
    fn is_alpha_carbon(&self, atom: usize) -> bool {
        self.is(atom, C)
            && self.neighbors[atom].len() == 4
            && self.count(atom, N) > 0
            && self.neighbors[atom].iter().any(|&n| self.is_carbonyl(n))
    }
    /// The end `j` of a bond has only hydrogens beyond, at least one.
    fn is_light_rotor(&self, i: usize, j: usize) -> bool {
        let mut beyond = self.neighbors[j].iter().filter(|&&n| n != i).peekable();
        !self.is(j, H) && beyond.peek().is_some() && beyond.all(|&n| self.is(n, H))
    }
    fn conjugated(&self, c: usize, n: usize) -> Option<BondKind> {
        if !(self.is(c, C) && self.is(n, N) && self.neighbors[c].len() == 3 && self.neighbors[n].len() <= 3) {
            return None;
        }
        if self.is_carbonyl(c) {
            let heavy = self.neighbors[n].len() - self.count(n, H);
            Some(if heavy > 1 { BondKind::Omega } else { BondKind::Planar })
        } else {
            (self.count(c, N) > 1).then_some(BondKind::Planar)
        }
    }
    /// The kind of the bond between two atoms.
    pub(crate) fn kind(&self, [i, j]: [usize; 2]) -> BondKind {
        let either = |test: &dyn Fn(usize, usize) -> bool| test(i, j) || test(j, i);
        if let Some(kind) = self.conjugated(i, j).or_else(|| self.conjugated(j, i)) {
            kind
        } else if either(&|a, b| self.is(a, N) && self.is_alpha_carbon(b)) {
            BondKind::BackbonePhi
        } else if either(&|a, b| self.is_carbonyl(a) && self.is_alpha_carbon(b)) {
            BondKind::BackbonePsi
        } else if either(&|a, b| self.is_light_rotor(a, b)) {
            BondKind::Methyl
        } else {
            BondKind::Chi
        }
    }
}
