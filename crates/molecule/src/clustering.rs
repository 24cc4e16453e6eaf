//! How to divide molecules into clusters: what the user chooses.

use crate::angles::{Angles, check_angles};
use crate::atoms::{Atoms, MoleculeError};
use crate::bond_kind::BondKind;
use crate::rings::{Rings, check_rings};

/// Which bonds are hinges, before kinds and groups are taken out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Hinges {
    /// All bonds that lie on no ring and have more than one atom on either side.
    #[default]
    Rotatable,
    /// These bonds.
    Bonds(Vec<[usize; 2]>),
    /// All bonds between different ones of these clusters; every atom is in one of them.
    Clusters(Vec<Vec<usize>>),
}

/// How to divide molecules into clusters.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Clustering {
    /// The hinges to start from.
    pub hinges: Hinges,
    /// Kinds of bonds that stay rigid.
    pub rigid: Vec<BondKind>,
    /// Atoms that move as one body; hinges between them, and on rings that this closes, are locked.
    pub groups: Vec<Vec<usize>>,
    /// Atoms that move as points, tied to others by forces only.
    pub free: Vec<usize>,
    /// Rings that are flexible.
    pub rings: Rings,
    /// Bond angles that are open.
    pub angles: Angles,
}

impl Clustering {
    /// Every atom a body of three degrees of freedom: Cartesian coordinates.
    pub fn cartesian(atoms: usize) -> Self {
        Clustering { free: (0..atoms).collect(), ..Clustering::default() }
    }
}

/// Indices that are no atoms, hinges that are no bonds, clusters that do not divide the atoms.
pub(crate) fn check_clustering(atoms: &Atoms, clustering: &Clustering) -> Vec<MoleculeError> {
    let n = atoms.len();
    let mut found = Vec::new();
    let mut check = |what: &str, list: &mut dyn Iterator<Item = &usize>| {
        for &i in list.filter(|&&i| i >= n) {
            found.push(MoleculeError::new(
                what,
                format!("atom {i}"),
                format!("atoms of 0…{}", n.saturating_sub(1)),
                "correct the index; atoms count from 0",
            ));
        }
    };
    check("free", &mut clustering.free.iter());
    check("groups", &mut clustering.groups.iter().flatten());
    check_rings(&clustering.rings, &mut check);
    check_angles(&clustering.angles, &mut check);
    match &clustering.hinges {
        Hinges::Rotatable => {}
        Hinges::Bonds(bonds) => {
            check("hinges", &mut bonds.iter().flatten());
            let sorted = |b: &[usize; 2]| [b[0].min(b[1]), b[0].max(b[1])];
            let known: std::collections::HashSet<_> = atoms.bonds.iter().map(sorted).collect();
            for bond in bonds.iter().filter(|b| b.iter().all(|&i| i < n) && !known.contains(&sorted(b))) {
                found.push(MoleculeError::new(
                    "hinges",
                    format!("{}, which is no bond", atoms.bond_label(*bond)),
                    "two bonded atoms",
                    "name the two atoms of a bond",
                ));
            }
        }
        Hinges::Clusters(clusters) => {
            check("clusters", &mut clusters.iter().flatten());
            let mut times = vec![0usize; n];
            clusters.iter().flatten().filter(|&&i| i < n).for_each(|&i| times[i] += 1);
            for &i in clustering.free.iter().filter(|&&i| i < n) {
                times[i] += 1;
            }
            for (i, times) in times.iter().enumerate().filter(|(_, times)| **times != 1) {
                found.push(MoleculeError::new(
                    format!("atom {}", atoms.label(i)),
                    format!("in {times} clusters"),
                    "every atom in one cluster, or free",
                    "add it to a cluster, or remove it from the others",
                ));
            }
        }
    }
    found
}
