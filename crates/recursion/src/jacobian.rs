//! The Jacobian J = B* φ* H* of a point of a body (paper 2, (4.8)).

use crate::error::{DynamicsError, check_length};
use crate::kinematics::point_in_body;
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{Scalar, Transform, Vec3};

/// J with (ω, velocity of the point) = J v, world axes.
///
/// # Shapes & units
/// `q`: nq; `point`: in the body's frame, m (`None`: its origin); result: 6×nv by rows, angular rows first.
///
/// # Method
/// Columns are the axes of the joints on the path, moved to the point relative to the body (no distance to the world's
/// origin enters), then turned into world axes. Cost O(depth) besides writing the zeros.
///
/// # Errors
/// [`DynamicsError::Shape`].
pub fn jacobian<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    body: Option<usize>,
    point: Option<Vec3<T>>,
) -> Result<[Vec<T>; 6], DynamicsError> {
    check_length("q", q, layout.nq())?;
    let mut rows: [Vec<T>; 6] = std::array::from_fn(|_| vec![T::zero(); layout.nv()]);
    let Some(body) = body else { return Ok(rows) };
    let carrier = &layout.carriers[body];
    let mut pose = Transform::constant(&carrier.pose).compose(&point_in_body(point));
    let mut path = Vec::new();
    let mut k = carrier.body;
    while k != GROUND {
        let b = &layout.bodies[k];
        for i in 0..b.hinge.nv() {
            let column = pose.motion_to_child(b.hinge.axis(i)).to_array();
            (0..6).for_each(|r| rows[r][b.v + i] = column[r]);
        }
        path.push(k);
        pose = b.pose(q).compose(&pose);
        k = b.parent;
    }
    for b in path.iter().map(|&k| &layout.bodies[k]) {
        for j in b.v..b.v + b.hinge.nv() {
            for first in [0, 3] {
                let local = Vec3([rows[first][j], rows[first + 1][j], rows[first + 2][j]]);
                let world = pose.rotation * local;
                (0..3).for_each(|r| rows[first + r][j] = world.0[r]);
            }
        }
    }
    Ok(rows)
}
