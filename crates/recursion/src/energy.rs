//! Kinetic and potential energy, centre of mass.
//!
//! Bodies welded to the world do not move and do not count, as in other programs: mass and centre of mass are those of the
//! moving bodies.

use crate::error::{DynamicsError, check_length};
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{Motion, RigidInertia, Scalar, Transform, Vec3};

/// ½ Σ V·M V over the bodies, J. `q`: nq, `v`: nv. Cost O(n).
///
/// # Errors
/// [`DynamicsError::Shape`].
pub fn kinetic_energy<T: Scalar>(layout: &Layout<T::Constant>, q: &[T], v: &[T]) -> Result<T, DynamicsError> {
    check_length("q", q, layout.nq())?;
    check_length("v", v, layout.nv())?;
    let mut velocity = vec![Motion::zero(); layout.len()];
    let mut twice = T::zero();
    for (k, body) in layout.bodies.iter().enumerate() {
        let x = body.pose(q);
        let joint = body.hinge.expand(&v[body.v..]);
        velocity[k] = match body.parent {
            GROUND => joint,
            p => x.motion_to_child(velocity[p]) + joint,
        };
        twice += velocity[k].dot(RigidInertia::constant(&body.inertia).momentum(velocity[k]));
    }
    Ok(T::splat(0.5) * twice)
}

/// Mass and first moment Σ m c of the moving bodies, by root: (root's pose, mass, first moment in the root's frame).
///
/// Gathered in body frames, so that a distant origin costs no digits until the last addition.
pub(crate) fn roots<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> Vec<(usize, Transform<T>, T, Vec3<T>)> {
    let mut gathered: Vec<(T, Vec3<T>)> = layout
        .bodies
        .iter()
        .map(|b| (T::constant(b.inertia.mass), Vec3::constant(b.inertia.first_moment)))
        .collect();
    let mut roots = Vec::new();
    for (k, body) in layout.bodies.iter().enumerate().rev() {
        let x = body.pose(q);
        let (mass, moment) = gathered[k];
        if body.parent == GROUND {
            roots.push((k, x, mass, moment));
        } else {
            let (m, h) = gathered[body.parent];
            gathered[body.parent] = (m + mass, h + x.rotation * moment + x.translation.scale(mass));
        }
    }
    roots
}

/// Centre of mass of the moving bodies, m, world axes; NaN if they have no mass. Cost O(n).
///
/// # Errors
/// [`DynamicsError::Shape`].
pub fn center_of_mass<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<Vec3<T>, DynamicsError> {
    check_length("q", q, layout.nq())?;
    let (mut mass, mut moment) = (T::zero(), Vec3::zero());
    for (_, x, m, h) in roots(layout, q) {
        mass += m;
        moment += x.rotation * h + x.translation.scale(m);
    }
    Ok(Vec3(moment.0.map(|h| h / mass)))
}

/// Potential energy of gravity, −Σ m g·c, zero at the world's origin, J. Cost O(n).
///
/// # Errors
/// [`DynamicsError::Shape`].
pub fn potential_energy<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<T, DynamicsError> {
    check_length("q", q, layout.nq())?;
    let g = Vec3::constant(layout.gravity);
    let mut energy = T::zero();
    for (_, x, mass, moment) in roots(layout, q) {
        energy -= g.dot(x.rotation * moment + x.translation.scale(mass));
    }
    Ok(energy)
}
