//! Constraints of a System against the clusters: satisfied by rigidity, or refused.

use crate::atoms::{Atoms, MoleculeError, MoleculeErrors};
use crate::clusters::Clusters;
use phipsi_formats::system::System;

/// How many constraints of a System the clusters satisfy.
///
/// A distance stays what it is between two atoms of one cluster, and between an atom and the far end of one of its cluster's hinges.
///
/// # Errors
/// [`MoleculeErrors`] naming the constraints across hinges.
pub fn satisfied_constraints(
    atoms: &Atoms,
    clusters: &Clusters,
    system: &System,
) -> Result<usize, MoleculeErrors> {
    let at_rest = clusters.at_rest();
    let mut errors = Vec::new();
    for c in &system.constraints {
        let kept = c.atoms.iter().any(|a| {
            let members = &at_rest[clusters.cluster_of[*a]];
            c.atoms.iter().all(|atom| members.contains(atom))
        });
        if !kept && errors.len() < 10 {
            errors.push(MoleculeError::new(
                format!("constraint {}", atoms.bond_label(c.atoms)),
                format!("a distance of {} nm that hinges change", c.distance),
                "constraints within clusters",
                "make the System with constraints=None, or keep the bonds between the two atoms rigid",
            ));
        }
    }
    if errors.is_empty() { Ok(system.constraints.len()) } else { Err(MoleculeErrors(errors)) }
}
