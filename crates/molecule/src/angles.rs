//! Open bond angles: hinges that bend besides turning.
//!
//! | symbol | meaning |
//! |---|---|
//! | h–i–j | the angle θ; i–j is a hinge, h is at rest in the cluster of i |
//! | n | the axis of the bend, through i, normal to the plane of h, i, j |
//! | β | the bend: θ = θ₀ + β, since n stays normal to the plane |
//!
//! The hinge is then a universal joint in i, or, where turning about i–j moves nothing, the bend alone.

use crate::atoms::{Atoms, MoleculeError, MoleculeErrors};
use crate::clusters::{Clusters, LockedHinge};
use crate::rings::OPEN_ANGLES;
use crate::roots::{Rooted, rooted};
use phipsi_spatial::Vec3;

/// Sine of an angle below which it cannot open: its plane is not determined.
const STRAIGHT: f64 = 0.05;

/// Which bond angles are open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Angles {
    /// None.
    #[default]
    Rigid,
    /// One at every hinge that turns, at its end towards the base: between the bond and the one before it.
    AtHinges,
    /// These: h, i, j with bonds h–i and i–j. A bond i–j that was no hinge becomes one. Of a small flexible ring that has one of them
    /// the listed ones are all that open.
    Listed(Vec<[usize; 3]>),
}

/// The bend of a hinge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bend {
    /// h, the end of the angle that is not on the hinge.
    pub reference: usize,
    /// i, the end of the hinge at which the angle is.
    pub center: usize,
}

/// Reports indices that are no atoms.
pub(crate) fn check_angles(angles: &Angles, check: &mut dyn FnMut(&str, &mut dyn Iterator<Item = &usize>)) {
    if let Angles::Listed(list) = angles {
        check("angles", &mut list.iter().flatten());
    }
}

impl Angles {
    /// An angle at this bond is listed.
    pub(crate) fn opens(&self, [a, b]: [usize; 2]) -> bool {
        let Angles::Listed(list) = self else { return false };
        list.iter().any(|[_, i, j]| [*i, *j] == [a, b] || [*i, *j] == [b, a])
    }
}

impl Clusters {
    /// Opens the angles that are asked for, and those of small flexible rings.
    pub(crate) fn open_angles(
        &mut self,
        atoms: &Atoms,
        positions: &[Vec3<f64>],
        angles: &Angles,
        small: &[Vec<usize>],
    ) -> Result<(), MoleculeErrors> {
        if *angles == Angles::Rigid && small.is_empty() {
            return Ok(());
        }
        let order = rooted(atoms, self, &[])?;
        let mut errors = Vec::new();
        if let Angles::Listed(list) = angles {
            for &[h, i, j] in list {
                if let Err(error) = self.open_listed(atoms, positions, [h, i, j]) {
                    errors.push(error);
                }
            }
        }
        let is_listed = |ring: &[usize]| {
            let Angles::Listed(list) = angles else { return false };
            list.iter().any(|angle| angle.iter().all(|i| ring.contains(i)))
        };
        for ring in small.iter().filter(|ring| !is_listed(ring)) {
            self.open_ring(atoms, positions, &order, ring);
        }
        if *angles == Angles::AtHinges {
            self.open_at_hinges(atoms, positions, &order);
        }
        if errors.is_empty() { Ok(()) } else { Err(MoleculeErrors(errors)) }
    }

    /// h is at rest in the cluster of i: one of its atoms, or the far end of a hinge that does not bend in i.
    fn rests(&self, h: usize, i: usize) -> bool {
        let across = self.hinges.iter().find(|x| x.atoms == [h, i] || x.atoms == [i, h]);
        self.cluster_of[h] == self.cluster_of[i]
            || across.is_some_and(|x| x.bend.is_none_or(|b| b.center == h))
    }

    /// An angle at i is measured from j, which must rest.
    fn is_reference(&self, j: usize, i: usize) -> bool {
        self.hinges.iter().any(|x| x.bend == Some(Bend { reference: j, center: i }))
    }

    fn open_listed(
        &mut self,
        atoms: &Atoms,
        positions: &[Vec3<f64>],
        [h, i, j]: [usize; 3],
    ) -> Result<(), MoleculeError> {
        let bonded = |a: usize, b: usize| atoms.bonds.iter().any(|x| *x == [a, b] || *x == [b, a]);
        let wrong = |found: String, required: &str, remedy: &str| {
            let name = [h, i, j].map(|a| atoms.label(a)).join("-");
            Err(MoleculeError::new(format!("angle {name}"), found, required, remedy))
        };
        if h == j || !bonded(h, i) || !bonded(i, j) {
            let remedy = "name the atoms in the order of the bonds";
            return wrong("atoms that are not bonded in this order".into(), "two bonds that meet", remedy);
        }
        let Some(at) = self.hinges.iter().position(|x| x.atoms == [i, j] || x.atoms == [j, i]) else {
            // Told already, with what keeps it rigid.
            if self.locked.iter().any(|x| x.atoms == [i, j] || x.atoms == [j, i]) {
                return Ok(());
            }
            let found = format!("no hinge {}", atoms.bond_label([i, j]));
            let remedy = "name the hinge's atoms last, or free the bond";
            return wrong(found, "a hinge between the last two atoms", remedy);
        };
        if self.hinges[at].bend.is_some() {
            return wrong(
                "a hinge that bends already".into(),
                "one angle for each hinge",
                "remove one of them",
            );
        }
        if self.is_reference(j, i) {
            let found = format!("{} is the first atom of another open angle there", atoms.label(j));
            let remedy = "open the other angle with another first atom";
            return wrong(found, "a first atom that rests", remedy);
        }
        if !self.rests(h, i) {
            let found = format!("{} moves against {} by another open angle", atoms.label(h), atoms.label(i));
            let remedy = "open the angle with another first atom";
            return wrong(found, "a first atom at rest in the cluster of the second", remedy);
        }
        if is_straight(positions, [h, i, j]) {
            let remedy = "leave it rigid, or move the atoms as points (`free`)";
            return wrong("a straight angle".into(), "an angle whose plane is determined", remedy);
        }
        self.hinges[at].bend = Some(Bend { reference: h, center: i });
        Ok(())
    }

    /// The angles at hinges, each at the end towards the base.
    fn open_at_hinges(&mut self, atoms: &Atoms, positions: &[Vec3<f64>], order: &[Rooted]) {
        let neighbors = atoms.neighbors();
        // The hinge by which each cluster hangs.
        let mut own = vec![None; self.clusters.len()];
        order.iter().for_each(|step| own[step.cluster] = step.hinge);
        for step in order {
            let Some((hinge, i)) = step.hinge else { continue };
            if self.hinges[hinge].bend.is_some() || !self.hinges[hinge].turns {
                continue;
            }
            let j = step.atom;
            let inboard = own[self.cluster_of[i]].map(|(_, p)| p).filter(|p| neighbors[i].contains(p));
            let mut others: Vec<usize> = neighbors[i].iter().copied().filter(|&h| h != j).collect();
            // Atoms of its own cluster first: they rest whatever opens.
            let own_cluster = |h: usize| self.cluster_of[h] == self.cluster_of[i];
            others.sort_by(|a, b| {
                let heavier = atoms.masses[*b].total_cmp(&atoms.masses[*a]);
                own_cluster(*b).cmp(&own_cluster(*a)).then(heavier).then(a.cmp(b))
            });
            let mut candidates = inboard.into_iter().chain(others);
            let found =
                candidates.find(|&h| h != j && self.rests(h, i) && !is_straight(positions, [h, i, j]));
            match found.filter(|_| !self.is_reference(j, i)) {
                Some(reference) => self.hinges[hinge].bend = Some(Bend { reference, center: i }),
                None => self.locked.push(LockedHinge {
                    atoms: self.hinges[hinge].atoms,
                    why: "its angle stays rigid: others are measured from it, or no atom gives it a plane"
                        .into(),
                }),
            }
        }
    }

    /// Three angles of a small ring, at atoms that the closure does not keep.
    fn open_ring(&mut self, atoms: &Atoms, positions: &[Vec3<f64>], order: &[Rooted], ring: &[usize]) {
        let kept: Vec<usize> = self.closures.iter().flat_map(|c| c.atoms).collect();
        let neighbors = atoms.neighbors();
        let mut opened = 0;
        // Tips last: an angle near the closure would be as good, one near the base moves more.
        for step in order {
            let Some((hinge, i)) = step.hinge else { continue };
            let j = step.atom;
            if opened == OPEN_ANGLES || !ring.contains(&i) || !ring.contains(&j) || kept.contains(&i) {
                continue;
            }
            let reference = neighbors[i].iter().copied().find(|&h| h != j && ring.contains(&h));
            if let Some(h) = reference
                && self.hinges[hinge].bend.is_none()
                && self.rests(h, i)
                && !is_straight(positions, [h, i, j])
                && !self.hinges.iter().any(|x| x.bend.is_some_and(|b| b.center == i))
            {
                self.hinges[hinge].bend = Some(Bend { reference: h, center: i });
                opened += 1;
            }
        }
    }
}

fn is_straight(positions: &[Vec3<f64>], [h, i, j]: [usize; 3]) -> bool {
    let (u, v) = (positions[h] - positions[i], positions[j] - positions[i]);
    u.cross(v).norm() <= STRAIGHT * u.norm() * v.norm()
}
