//! Coordinates from positions: the pose of each base by superposition, then hinge after hinge outward.
//!
//! A hinge that bends and turns is two axes of the layout, the first of a body without atoms: R = R(z, q₁) R(a, q₂) takes the atoms
//! beyond to their places, and R a = R(z, q₁) a has q₁.

use crate::torsion_model::{Mark, Site, TorsionModel, check};
use nalgebra::{Matrix4, SymmetricEigen};
use phipsi_recursion::DynamicsError;
use phipsi_recursion::hinge::Hinge;
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Quaternion, Transform, Vec3};

impl TorsionModel {
    /// The configuration whose positions are nearest, cluster by cluster from the bases outward, and the largest distance
    /// (nm) that an atom is then away: zero but for rounding where positions differ from the reference by torsions, bends and
    /// motions of whole molecules, infinite where a position is not finite. Angles are in (−π, π]. Cost O(atoms).
    ///
    /// # Method
    /// Bases: least squares over the base's atoms, the far ends of its hinges, and normals of its open angles (Horn 1987). Hinges:
    /// the angle of least squares about the axis of the frame reached so far; where they bend and turn, about the first axis by the
    /// rotation of least squares of what lies beyond.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn coordinates(&self, positions: &[Vec3<f64>]) -> Result<(Vec<f64>, f64), DynamicsError> {
        check("positions", positions.len(), self.atoms().len())?;
        let mut q = self.model().neutral::<f64>();
        let mut world = vec![Transform::identity(); self.layout.len()];
        let mut largest = 0.0f64;
        for (k, body) in self.layout.bodies().iter().enumerate() {
            let frame = match body.parent {
                GROUND => body.placement(),
                parent => world[parent].compose(&body.placement()),
            };
            let inward = frame.inverse();
            let pairs_of = |k: usize| {
                let sites =
                    self.sites[k].iter().chain(&self.far[k]).map(|s: &Site| (s.place, positions[s.atom]));
                let marks = self.marks[k].iter().map(|m| (m.place, Mark::point(m.atoms, positions)));
                // An angle that is straight has no normal.
                let marks = marks.filter(|(_, to)| to.0.iter().all(|x| x.is_finite()));
                sites.chain(marks).map(|(from, to)| (from, inward.point(to)))
            };
            let pairs = || pairs_of(k);
            let beyond = match pairs().next() {
                None => self.layout.bodies().iter().position(|body| body.parent == k),
                Some(_) => None,
            };
            match (body.hinge, beyond) {
                (Hinge::Translation, _) => {
                    let moved = pairs().next().map_or(Vec3::zero(), |(from, to)| to - from);
                    q[body.q..body.q + 3].copy_from_slice(&moved.0);
                }
                (Hinge::Free, _) => {
                    let (rotation, moved) = superposition(pairs);
                    q[body.q..body.q + 3].copy_from_slice(&moved.0);
                    q[body.q + 3..body.q + 7].copy_from_slice(&rotation.0);
                }
                (_, Some(beyond)) => {
                    let placed = self.layout.bodies()[beyond].placement();
                    let (rotation, _) = superposition(|| pairs_of(beyond).map(|(x, y)| (placed.point(x), y)));
                    let axis = placed.rotation.column(2);
                    let turned = rotation.to_rotation() * axis;
                    let cosine = axis.0[0] * turned.0[0] + axis.0[1] * turned.0[1];
                    q[body.q] = axis.cross(turned).0[2].atan2(cosine);
                }
                (_, None) => {
                    let (mut sine, mut cosine) = (0.0, 0.0);
                    for (from, to) in pairs() {
                        sine += from.cross(to).0[2];
                        cosine += from.0[0] * to.0[0] + from.0[1] * to.0[1];
                    }
                    q[body.q] = sine.atan2(cosine);
                }
            }
            world[k] = frame.compose(&body.hinge.transform(&Transform::identity(), &q[body.q..]));
            for site in &self.sites[k] {
                let away = (world[k].point(site.place) - positions[site.atom]).norm();
                largest = if away.is_finite() { largest.max(away) } else { f64::INFINITY };
            }
        }
        Ok((q, largest))
    }
}

/// The rotation and translation that take the first points nearest to the second.
fn superposition<I: Iterator<Item = (Vec3<f64>, Vec3<f64>)>>(
    pairs: impl Fn() -> I,
) -> (Quaternion<f64>, Vec3<f64>) {
    let count = pairs().count().max(1) as f64;
    let sum = pairs().fold((Vec3::zero(), Vec3::zero()), |(a, b), (x, y)| (a + x, b + y));
    let (from, to) = (sum.0.scale(1.0 / count), sum.1.scale(1.0 / count));
    let mut s = [[0.0; 3]; 3];
    for (x, y) in pairs() {
        let (x, y) = (x - from, y - to);
        for i in 0..3 {
            for j in 0..3 {
                s[i][j] += x.0[i] * y.0[j];
            }
        }
    }
    // The quaternion (w, x, y, z) is the eigenvector of the largest eigenvalue.
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = s;
    let matrix = Matrix4::new(
        xx + yy + zz,
        yz - zy,
        zx - xz,
        xy - yx,
        yz - zy,
        xx - yy - zz,
        xy + yx,
        zx + xz,
        zx - xz,
        xy + yx,
        yy - xx - zz,
        yz + zy,
        xy - yx,
        zx + xz,
        yz + zy,
        zz - xx - yy,
    );
    // Iterations do not end on numbers that are not finite.
    let Some(eigen) = SymmetricEigen::try_new(matrix, f64::EPSILON, 100) else {
        return (Quaternion::identity(), to - from);
    };
    let vector = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let rotation = Quaternion([vector[1], vector[2], vector[3], vector[0]]).normalized();
    (rotation, to - rotation.to_rotation() * from)
}
