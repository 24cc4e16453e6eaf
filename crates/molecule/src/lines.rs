//! Linear molecules: rigid bodies of five degrees of freedom.
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | c, a | mass centre and line of the atoms: the axis of their least moment of inertia | nm |
//! | I | moment of inertia across the line, about c | Da nm² |
//!
//! The body is a free one with the inertia I about all axes and a still axis ([`Model::still_axes`]): quaternion and six speeds,
//! of which the one about a is zero. A joint of five coordinates would have two angles for the direction, which are singular
//! somewhere, or a hinge map that is not closed under brackets, which no symplectic map on the joint's group has. The motion
//! does not depend on the inertia about a, only an error of the steps of fourth order does; as that of a sphere it gives a molecule
//! whose centre rests the drift without an error in direction. The measure of quaternions is that of uniform directions.
//!
//! [`Model::still_axes`]: phipsi_model::Model::still_axes

use crate::atoms::{Atoms, MoleculeError, MoleculeErrors};
use crate::clusters::{Clusters, is_linear};
use crate::roots::Rooted;
use nalgebra::{Matrix3, SymmetricEigen};
use phipsi_model::Body;
use phipsi_spatial::Vec3;

/// The line of a molecule.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    axis: Vec3<f64>,
    moment: f64,
}

impl Line {
    /// The body with five degrees of freedom.
    pub(crate) fn body(&self, mut body: Body) -> Body {
        body.inertia.tensor = [self.moment, 0.0, 0.0, self.moment, 0.0, self.moment];
        // Along the axis also where positions far from the world's origin have lost digits.
        let along = self.axis.dot(Vec3(body.inertia.frame.translation));
        body.inertia.frame.translation = self.axis.scale(along).0;
        body.with_still_axis(self.axis.0)
    }
}

/// Lines by clusters, positions, the largest distance.
type Straightened = (Vec<Option<Line>>, Vec<Vec3<f64>>, f64);

/// The line of each cluster that is a linear molecule, all positions with its atoms on it, and the largest distance (nm) that an
/// atom was off.
pub(crate) fn straighten(
    atoms: &Atoms,
    positions: &[Vec3<f64>],
    clusters: &Clusters,
    order: &[Rooted],
) -> Result<Straightened, MoleculeErrors> {
    let mut lines = vec![None; clusters.clusters.len()];
    let (mut straight, mut off, mut errors) = (positions.to_vec(), 0.0f64, Vec::new());
    for step in order.iter().filter(|s| s.hinge.is_none() && !s.has_hinges) {
        let members = &clusters.clusters[step.cluster];
        let points: Vec<Vec3<f64>> = members.iter().map(|&i| positions[i]).collect();
        if members.len() == 1 || !is_linear(&points) {
            continue;
        }
        let mass: f64 = members.iter().map(|&i| atoms.masses[i]).sum();
        let center =
            members.iter().fold(Vec3::zero(), |c, &i| c + positions[i].scale(atoms.masses[i] / mass));
        let mut spread = Matrix3::zeros();
        for &i in members {
            let x = (positions[i] - center).0;
            spread += Matrix3::from_fn(|r, c| atoms.masses[i] * x[r] * x[c]);
        }
        // Finite: positions have been checked.
        let eigen = SymmetricEigen::new(spread);
        let axis = eigen.eigenvectors.column(eigen.eigenvalues.imax());
        let axis = Vec3([axis[0], axis[1], axis[2]]);
        let mut moment = 0.0;
        for &i in members {
            let along = axis.dot(positions[i] - center);
            moment += atoms.masses[i] * along * along;
            straight[i] = center + axis.scale(along);
            off = off.max((straight[i] - positions[i]).norm());
        }
        if moment > 0.0 {
            lines[step.cluster] = Some(Line { axis, moment });
        } else {
            let names: Vec<String> = members.iter().map(|&i| atoms.label(i)).collect();
            errors.push(MoleculeError::new(
                format!("molecule of atoms {}", names.join(", ")),
                "all its atoms are in one place",
                "atoms that are apart",
                "correct the positions",
            ));
        }
    }
    if errors.is_empty() { Ok((lines, straight, off)) } else { Err(MoleculeErrors(errors)) }
}
