//! Momentum of the whole system and the centroidal momentum matrix.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | h(k) | M(k) V(k) + Σ φ(k,c) h(c), momentum of everything outboard of joint k | notes/integrators.md 1 |

use crate::energy::roots;
use crate::error::{DynamicsError, check_length};
use crate::layout::{GROUND, Layout};
use crate::mass_matrix::composite_inertias;
use phipsi_spatial::{Mat3, Motion, RigidInertia, Scalar, Transform, Vec3, Wrench};

/// The point about which angular momentum is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum About<T> {
    /// The centre of mass of the moving bodies.
    CenterOfMass,
    /// A point of the world, m.
    Point(Vec3<T>),
}

/// Angular momentum about a point, then linear momentum; world axes; kg·m²/s, kg·m/s. Cost O(n).
///
/// Momenta are gathered in body frames to each root and moved from there, so that for a tree with one root the result about
/// the centre of mass does not depend on the distance to the world's origin.
///
/// # Errors
/// [`DynamicsError::Shape`].
pub fn momentum<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    about: About<T>,
) -> Result<Wrench<T>, DynamicsError> {
    check_length("q", q, layout.nq())?;
    check_length("v", v, layout.nv())?;
    let hinge: Vec<Transform<T>> = layout.bodies.iter().map(|b| b.pose(q)).collect();
    let mut velocity = vec![Motion::zero(); layout.len()];
    let mut h = vec![Wrench::zero(); layout.len()];
    for (k, body) in layout.bodies.iter().enumerate() {
        let joint = body.hinge.expand(&v[body.v..]);
        velocity[k] = match body.parent {
            GROUND => joint,
            p => hinge[k].motion_to_child(velocity[p]) + joint,
        };
        h[k] = RigidInertia::constant(&body.inertia).momentum(velocity[k]);
    }
    for (k, body) in layout.bodies.iter().enumerate().rev() {
        if body.parent != GROUND {
            let shifted = hinge[k].wrench_to_parent(h[k]);
            h[body.parent] += shifted;
        }
    }
    let to_point = points_in_roots(layout, q, about);
    let mut total = Wrench::zero();
    for (root, frame) in to_point {
        total += frame.wrench_to_child(h[root]);
    }
    Ok(total)
}

/// For each root, the frame at the point with world axes, seen from the root's frame.
fn points_in_roots<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    about: About<T>,
) -> Vec<(usize, Transform<T>)> {
    let roots = roots(layout, q);
    let mass = roots.iter().fold(T::zero(), |sum, r| sum + r.2);
    roots
        .iter()
        .map(|(k, x, _, _)| {
            // The point relative to this root, world axes.
            let offset = match about {
                About::Point(point) => point - x.translation,
                About::CenterOfMass => {
                    let sum = roots.iter().fold(Vec3::zero(), |sum, (_, y, m, h)| {
                        sum + y.rotation * *h + (y.translation - x.translation).scale(*m)
                    });
                    Vec3(sum.0.map(|s| s / mass))
                }
            };
            (*k, Transform::new(x.rotation.transpose(), x.rotation.transpose_mul(offset)))
        })
        .collect()
}

/// A with (angular momentum about the centre of mass, linear momentum) = A v; 6×nv by rows, world axes.
///
/// # Method
/// Column i is the momentum of the composite body outboard of the joint, moving along axis i. Cost O(n · depth).
///
/// # Errors
/// [`DynamicsError::Shape`].
pub fn centroidal_momentum_matrix<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> Result<[Vec<T>; 6], DynamicsError> {
    check_length("q", q, layout.nq())?;
    let (hinge, R) = composite_inertias(layout, q);
    let mut frames = vec![Transform::new(Mat3::identity(), Vec3::zero()); layout.len()];
    for (root, frame) in points_in_roots(layout, q, About::CenterOfMass) {
        frames[root] = frame;
    }
    let mut rows: [Vec<T>; 6] = std::array::from_fn(|_| vec![T::zero(); layout.nv()]);
    for (k, body) in layout.bodies.iter().enumerate() {
        for i in 0..body.hinge.nv() {
            let mut h = R[k].momentum(body.hinge.axis(i));
            let mut at = k;
            while layout.bodies[at].parent != GROUND {
                h = hinge[at].wrench_to_parent(h);
                at = layout.bodies[at].parent;
            }
            let column = frames[at].wrench_to_child(h).to_array();
            (0..6).for_each(|r| rows[r][body.v + i] = column[r]);
        }
    }
    Ok(rows)
}
