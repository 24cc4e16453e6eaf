//! Rigid clusters of atoms: what is left when the hinges are cut.
//!
//! A hinge is a bond about which its two sides turn. By default these are all bonds that lie on no ring and have more than
//! one atom on either side. A hinge is locked, and said to be, if one of its clusters lies on one line with all its hinges:
//! turning about that line moves nothing.

use crate::atoms::{Atoms, MoleculeError, MoleculeErrors};
use crate::bond_kind::{BondKind, Chemistry};
use crate::bridges::bridges;
use phipsi_spatial::Vec3;

/// Atoms nearer than this to a line (nm) lie on it: a rotor that close to its axis has less than a tenth of the inertia of
/// a hydroxyl and would set the time step. Five degrees of a bond to hydrogen.
const LINEAR: f64 = 0.01;

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
}

/// A hinge between two clusters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HingeBond {
    /// The bond, as it was given.
    pub atoms: [usize; 2],
    /// The clusters of its two atoms.
    pub clusters: [usize; 2],
    /// Its kind.
    pub kind: BondKind,
}

/// A hinge that was asked for and does not turn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LockedHinge {
    /// The bond.
    pub atoms: [usize; 2],
    /// Why.
    pub why: String,
}

/// Molecules as rigid clusters and hinges; the hinges make a forest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Clusters {
    /// Atoms of each cluster, ascending; clusters in the order of their first atoms.
    pub clusters: Vec<Vec<usize>>,
    /// The cluster of each atom.
    pub cluster_of: Vec<usize>,
    /// Hinges, in the order of the bonds.
    pub hinges: Vec<HingeBond>,
    /// Hinges that were locked.
    pub locked: Vec<LockedHinge>,
}

/// Union-find with path halving.
struct Union(Vec<usize>);

impl Union {
    fn find(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }
    fn join(&mut self, i: usize, j: usize) {
        let (a, b) = (self.find(i), self.find(j));
        self.0[a.max(b)] = a.min(b);
    }
}

impl Clusters {
    /// Divides molecules. `positions`: one for each atom, nm; they tell only which clusters are linear.
    ///
    /// # Errors
    /// [`MoleculeErrors`]: tables that contradict each other, and hinges on rings.
    pub fn new(
        atoms: &Atoms,
        positions: &[Vec3<f64>],
        clustering: &Clustering,
    ) -> Result<Self, MoleculeErrors> {
        let mut errors = atoms.check();
        if positions.len() != atoms.len() {
            errors.push(MoleculeError::new(
                "positions",
                format!("{} entries", positions.len()),
                format!("one for each of the {} atoms", atoms.len()),
                "give the positions of the same atoms",
            ));
        }
        if errors.is_empty() {
            errors = check_clustering(atoms, clustering);
        }
        if let Some(i) = positions.iter().position(|x| x.0.iter().any(|c| !c.is_finite())) {
            errors.push(MoleculeError::new(
                format!("atom {}", i),
                format!("position {:?} nm", positions[i].0),
                "finite numbers",
                "correct the position",
            ));
        }
        if !errors.is_empty() {
            return Err(MoleculeErrors(errors));
        }
        let mut division = Division::new(atoms, clustering);
        division.choose(clustering)?;
        division.lock_rings(clustering)?;
        division.lock_linear(positions);
        Ok(division.finish())
    }
    /// Number of degrees of freedom that the hinges have; bases not counted.
    pub fn torsions(&self) -> usize {
        self.hinges.len()
    }
}

fn check_clustering(atoms: &Atoms, clustering: &Clustering) -> Vec<MoleculeError> {
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

/// Work in progress: clusters as a union-find of atoms, hinges as indices of bonds.
struct Division<'a> {
    atoms: &'a Atoms,
    neighbors: Vec<Vec<usize>>,
    is_free: Vec<bool>,
    union: Union,
    hinges: Vec<usize>,
    locked: Vec<LockedHinge>,
}

impl<'a> Division<'a> {
    fn new(atoms: &'a Atoms, clustering: &Clustering) -> Self {
        let mut is_free = vec![false; atoms.len()];
        clustering.free.iter().for_each(|&i| is_free[i] = true);
        Division {
            atoms,
            neighbors: atoms.neighbors(),
            is_free,
            union: Union((0..atoms.len()).collect()),
            hinges: Vec::new(),
            locked: Vec::new(),
        }
    }

    /// A bond that ties its atoms: none of them is free.
    fn ties(&self, bond: &[usize; 2]) -> bool {
        !bond.iter().any(|&i| self.is_free[i])
    }

    /// Hinges by the user's choice and by kind; all other bonds join their atoms.
    fn choose(&mut self, clustering: &Clustering) -> Result<(), MoleculeErrors> {
        let bonds = &self.atoms.bonds;
        let sides = bridges(self.atoms.len(), bonds);
        let sorted = |b: &[usize; 2]| [b[0].min(b[1]), b[0].max(b[1])];
        let mut in_ring = Vec::new();
        let is_hinge: Vec<bool> = match &clustering.hinges {
            Hinges::Rotatable => sides.iter().map(|s| s.is_bridge && s.smaller > 1).collect(),
            Hinges::Bonds(wanted) => {
                let wanted: std::collections::HashSet<_> = wanted.iter().map(sorted).collect();
                bonds.iter().map(|b| wanted.contains(&sorted(b))).collect()
            }
            Hinges::Clusters(clusters) => {
                let mut cluster = vec![usize::MAX; self.atoms.len()];
                for (c, list) in clusters.iter().enumerate() {
                    for &i in list {
                        cluster[i] = c;
                        self.union.join(list[0], i);
                    }
                }
                bonds.iter().map(|b| cluster[b[0]] != cluster[b[1]]).collect()
            }
        };
        let chemistry = Chemistry::new(self.atoms, &self.neighbors);
        for (b, bond) in bonds.iter().enumerate() {
            if !self.ties(bond) {
                continue;
            }
            if is_hinge[b] && !clustering.rigid.contains(&chemistry.kind(*bond)) {
                self.hinges.push(b);
                if !sides[b].is_bridge {
                    in_ring.push(b);
                }
            } else {
                self.union.join(bond[0], bond[1]);
            }
        }
        if in_ring.is_empty() {
            return Ok(());
        }
        let error = |&b: &usize| {
            MoleculeError::new(
                format!("hinge {}", self.atoms.bond_label(bonds[b])),
                "it lies on a ring",
                "hinges outside rings: the torsion model closes no rings",
                "take it from the hinges, or put the atoms of the ring into one cluster",
            )
        };
        Err(MoleculeErrors(in_ring.iter().map(error).collect()))
    }

    /// Hinges on rings of clusters: groups close such rings, clusters of the user's must not.
    fn lock_rings(&mut self, clustering: &Clustering) -> Result<(), MoleculeErrors> {
        for group in &clustering.groups {
            for &i in group {
                self.union.join(group[0], i);
            }
        }
        let ends: Vec<[usize; 2]> = self.hinges.clone().into_iter().map(|b| self.ends(b)).collect();
        let sides = bridges(self.atoms.len(), &ends);
        let mut kept = Vec::new();
        let mut errors = Vec::new();
        for (h, &b) in self.hinges.clone().iter().enumerate() {
            let bond = self.atoms.bonds[b];
            if sides[h].is_bridge {
                kept.push(b);
            } else if clustering.groups.is_empty() {
                errors.push(MoleculeError::new(
                    format!("hinge {}", self.atoms.bond_label(bond)),
                    "its two clusters are also joined by other hinges",
                    "clusters without rings between them: the torsion model closes no rings",
                    "put the atoms of the ring into one cluster",
                ));
            } else {
                self.lock(b, "both its sides are in one rigid group");
            }
        }
        self.hinges = kept;
        if errors.is_empty() { Ok(()) } else { Err(MoleculeErrors(errors)) }
    }

    fn ends(&mut self, b: usize) -> [usize; 2] {
        self.atoms.bonds[b].map(|i| self.union.find(i))
    }

    fn lock(&mut self, b: usize, why: &str) {
        let atoms = self.atoms.bonds[b];
        self.union.join(atoms[0], atoms[1]);
        self.locked.push(LockedHinge { atoms, why: why.into() });
    }

    /// Locks one hinge of every cluster that lies on one line with its hinges, until there is none.
    fn lock_linear(&mut self, positions: &[Vec3<f64>]) {
        let mut members: Vec<Vec<usize>> = vec![Vec::new(); self.atoms.len()];
        for i in 0..self.atoms.len() {
            members[self.union.find(i)].push(i);
        }
        let mut hinges_of: Vec<Vec<usize>> = vec![Vec::new(); self.atoms.len()];
        for &b in &self.hinges.clone() {
            self.ends(b).into_iter().for_each(|c| hinges_of[c].push(b));
        }
        let mut open: Vec<usize> = (0..self.atoms.len()).rev().filter(|&c| !members[c].is_empty()).collect();
        let mut is_locked = vec![false; self.atoms.bonds.len()];
        while let Some(c) = open.pop() {
            hinges_of[c].retain(|&b| !is_locked[b]);
            if members[c].is_empty() || hinges_of[c].is_empty() {
                continue;
            }
            // The atoms at the far ends of hinges keep their places in the cluster too.
            let bonds = hinges_of[c].iter().map(|&b| self.atoms.bonds[b]);
            let points: Vec<Vec3<f64>> =
                members[c].iter().copied().chain(bonds.flatten()).map(|i| positions[i]).collect();
            if !is_linear(&points) {
                continue;
            }
            let b = hinges_of[c][0];
            let [one, other] = self.ends(b);
            is_locked[b] = true;
            self.lock(b, "its axis is the line on which all atoms of one side lie, which it would not move");
            let joined = self.union.find(one);
            let gone = if joined == one { other } else { one };
            let (moved, hinges) = (std::mem::take(&mut members[gone]), std::mem::take(&mut hinges_of[gone]));
            members[joined].extend(moved);
            hinges_of[joined].extend(hinges);
            open.push(joined);
        }
        self.hinges.retain(|&b| !is_locked[b]);
    }

    fn finish(mut self) -> Clusters {
        let n = self.atoms.len();
        let mut number = vec![usize::MAX; n];
        let mut clusters: Vec<Vec<usize>> = Vec::new();
        let mut cluster_of = Vec::with_capacity(n);
        for i in 0..n {
            let root = self.union.find(i);
            if number[root] == usize::MAX {
                number[root] = clusters.len();
                clusters.push(Vec::new());
            }
            clusters[number[root]].push(i);
            cluster_of.push(number[root]);
        }
        let chemistry = Chemistry::new(self.atoms, &self.neighbors);
        let hinge = |&b: &usize| {
            let atoms = self.atoms.bonds[b];
            HingeBond { atoms, clusters: atoms.map(|i| cluster_of[i]), kind: chemistry.kind(atoms) }
        };
        let hinges = self.hinges.iter().map(hinge).collect();
        Clusters { clusters, cluster_of, hinges, locked: self.locked }
    }
}

/// True if all points are within [`LINEAR`] of the line through the first and the farthest from it.
pub(crate) fn is_linear(points: &[Vec3<f64>]) -> bool {
    let Some(&first) = points.first() else { return true };
    let far =
        points.iter().fold(first, |far, &x| if (x - first).norm() > (far - first).norm() { x } else { far });
    let line = far - first;
    let length = line.norm();
    length == 0.0 || points.iter().all(|&x| line.cross(x - first).norm() <= LINEAR * length)
}
