//! The Jacobian J = B* φ* H* of a point of a body (paper 2, (4.8)).

use crate::error::{DynamicsError, check_length};
use crate::kernel::kernel;
use crate::layout::{GROUND, Layout};
use num_traits::Zero;
use phipsi_spatial::{Mat3, Scalar, Transform, Vec3};

/// J with (ω, velocity of the point) = J v, world axes, into `out`.
///
/// # Shapes & units
/// `q`: nq; `point`: in the body's frame, m (`None`: its origin); `out`: 6×nv by rows, angular rows first.
///
/// # Method
/// Columns are the axes of the joints on the path, moved to the point relative to the body (no distance to the world's
/// origin enters), then turned into world axes. Cost O(depth) besides writing the zeros; no allocation.
///
/// # Errors
/// [`DynamicsError::Shape`].
pub fn jacobian_into<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    body: Option<usize>,
    point: Option<Vec3<T>>,
    out: &mut [T],
) -> Result<(), DynamicsError> {
    check_length("q", q, layout.nq())?;
    check_length("out", out, 6 * layout.nv())?;
    let (q, out) = (T::arithmetic(q), T::arithmetic_mut(out));
    T::Arithmetic::dispatch(Path::<T> { layout, q, body, point, out });
    Ok(())
}

kernel! {
    Path<'a, T> {
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        body: Option<usize>,
        point: Option<Vec3<T>>,
        out: &'a mut [T::Arithmetic],
    } -> () {
        out.fill(T::Arithmetic::zero());
        let Some(carrier) = body.map(|b| &layout.carriers[b]) else { return };
        let nv = layout.nv();
        let mut pose = Transform::constant(&carrier.pose);
        if let Some(Vec3([x, y, z])) = point {
            let point = Vec3([x.to_arithmetic(), y.to_arithmetic(), z.to_arithmetic()]);
            pose = pose.compose(&Transform::new(Mat3::identity(), point));
        }
        let mut k = carrier.body;
        while k != GROUND {
            let b = &layout.bodies[k];
            for i in 0..b.hinge.nv() {
                let column = pose.motion_to_child(b.hinge.axis(i)).to_array();
                for (r, x) in column.into_iter().enumerate() {
                    out[r * nv + b.v + i] = x;
                }
            }
            pose = b.pose(q).compose(&pose);
            k = b.parent;
        }
        k = carrier.body;
        while k != GROUND {
            let b = &layout.bodies[k];
            for j in b.v..b.v + b.hinge.nv() {
                for first in [0, 3] {
                    let at = [first * nv + j, (first + 1) * nv + j, (first + 2) * nv + j];
                    let world = pose.rotation * Vec3([out[at[0]], out[at[1]], out[at[2]]]);
                    for (at, x) in at.into_iter().zip(world.0) {
                        out[at] = x;
                    }
                }
            }
            k = b.parent;
        }
    }
}

/// [`jacobian_into`], as rows of its own.
///
/// # Errors
/// As there.
pub fn jacobian<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    body: Option<usize>,
    point: Option<Vec3<T>>,
) -> Result<[Vec<T>; 6], DynamicsError> {
    let nv = layout.nv();
    let mut out = vec![T::zero(); 6 * nv];
    jacobian_into(layout, q, body, point, &mut out)?;
    Ok(std::array::from_fn(|r| out[r * nv..(r + 1) * nv].to_vec()))
}
