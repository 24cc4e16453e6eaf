//! Entries whose atoms all belong to one rigid body: their energies are constant, and their forces move nothing.

use super::Term;
use phipsi_spatial::Vec3;
use phipsi_spatial::lanes::Level;
use std::fmt;

/// Atoms that keep their distances from each other. An atom may be in several groups, as those on the axis of a hinge are.
#[derive(Clone, Debug)]
pub struct RigidGroups {
    groups: Vec<Vec<usize>>,
    /// The groups of each atom, ascending.
    of: Vec<Vec<usize>>,
}

impl RigidGroups {
    /// Groups of n atoms; atoms that do not exist are ignored.
    pub fn new(n: usize, groups: impl IntoIterator<Item = Vec<usize>>) -> Self {
        let mut of = vec![Vec::new(); n];
        let mut kept = Vec::new();
        for (k, mut group) in groups.into_iter().enumerate() {
            group.retain(|&atom| atom < n);
            group.sort_unstable();
            group.dedup();
            group.iter().for_each(|&atom| of[atom].push(k));
            kept.push(group);
        }
        RigidGroups { groups: kept, of }
    }

    /// True if one group has all these atoms.
    pub(super) fn hold(&self, atoms: &[usize]) -> bool {
        let Some((first, others)) = atoms.split_first() else { return false };
        let has = |atom: &usize, group: &usize| self.of[*atom].binary_search(group).is_ok();
        self.of[*first].iter().any(|group| others.iter().all(|atom| has(atom, group)))
    }

    /// The groups, each with its pairs that no group before has, as places in it.
    pub(super) fn pairs(&self) -> impl Iterator<Item = (&[usize], Vec<[usize; 2]>)> {
        self.groups.iter().enumerate().map(|(k, group)| {
            let mut pairs = Vec::new();
            for (a, i) in group.iter().enumerate() {
                for (b, j) in group.iter().enumerate().skip(a + 1) {
                    let first = self.of[*i].iter().find(|g| self.of[*j].binary_search(g).is_ok());
                    if first == Some(&k) {
                        pairs.push([a, b]);
                    }
                }
            }
            (&group[..], pairs)
        })
    }
}

/// What a term leaves out.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// The term.
    pub term: String,
    /// How many of its entries (bonds, angles, torsions, pairs), and of how many.
    pub entries: [usize; 2],
    /// Their energy, kJ/mol: a constant of the term.
    pub energy: f64,
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let LeftOut { term, entries: [out, all], energy } = self;
        write!(f, "{term}: {out} of {all} entries, within rigid clusters; {energy:.6} kJ/mol, evaluated once")
    }
}

/// What a kernel takes out of itself: how many entries, of how many, and their energy.
pub(super) type TakenOut = ([usize; 2], f64);

impl Term {
    /// Takes out what the groups hold; `None` for a term that is evaluated as a whole. The forces are overwritten.
    pub(super) fn leave_out(
        &mut self,
        groups: &RigidGroups,
        level: Level,
        x: &[Vec3<f64>],
        forces: &mut [Vec3<f64>],
    ) -> Option<TakenOut> {
        let held = |atoms: &[usize]| groups.hold(atoms);
        Some(match self {
            Term::HarmonicBond(term) => {
                let (out, rest) = (term.take_out(held), term.len());
                ([out.len(), out.len() + rest], { out }.evaluate(x, forces))
            }
            Term::HarmonicAngle(term) => {
                let (out, rest) = (term.take_out(held), term.len());
                ([out.len(), out.len() + rest], { out }.evaluate(x, forces))
            }
            Term::PeriodicTorsion(term) => {
                let (out, rest) = (term.take_out(held), term.len());
                ([out.len(), out.len() + rest], { out }.evaluate(x, forces))
            }
            Term::RbTorsion(term) => {
                let (out, rest) = (term.take_out(held), term.len());
                ([out.len(), out.len() + rest], { out }.evaluate(x, forces))
            }
            Term::CustomBond(term) => {
                let (out, rest) = (term.take_out(held), term.len());
                ([out.len(), out.len() + rest], { out }.evaluate(x, forces))
            }
            Term::CustomAngle(term) => {
                let (out, rest) = (term.take_out(held), term.len());
                ([out.len(), out.len() + rest], { out }.evaluate(x, forces))
            }
            Term::CustomTorsion(term) => {
                let (out, rest) = (term.take_out(held), term.len());
                ([out.len(), out.len() + rest], { out }.evaluate(x, forces))
            }
            Term::Nonbonded(term) => term.take_out(groups, level, x),
            // Energies of single entries are not constant, or too few to matter.
            Term::GeneralizedBorn(_)
            | Term::CustomGb(_)
            | Term::Cmap(_)
            | Term::LennardJonesTable(_)
            | Term::CustomNonbonded(_) => return None,
        })
    }
}
