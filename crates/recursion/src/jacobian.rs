//! The Jacobian J = B* φ* H* of a point of a body (paper 2, (4.8)).

use crate::error::{DynamicsError, check_length};
use crate::hinge::{Axes, Hinge, combine, each_component};
use crate::kernel::kernel;
use crate::layout::{GROUND, Layout};
use num_traits::{One, Zero};
use phipsi_spatial::{Mat3, Scalar, Turn, Vec3};

/// Workspace of a Jacobian.
#[derive(Clone, Debug)]
pub struct Jacobian<T: Scalar> {
    /// Bodies from the point's to the root.
    path: Vec<usize>,
    /// Coordinates of hinges on the path, with their sines and cosines.
    angle: Vec<T::Arithmetic>,
    sin: Vec<T::Arithmetic>,
    cos: Vec<T::Arithmetic>,
    /// Axes in the world, and the origin from the parent's.
    frames: Vec<Axes<T::Arithmetic>>,
}

impl<T: Scalar> Jacobian<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let n = layout.len();
        let zero = T::Arithmetic::zero();
        Jacobian {
            path: vec![0; n],
            angle: vec![zero; n],
            sin: vec![zero; n.next_multiple_of(T::Arithmetic::COLUMNS)],
            cos: vec![zero; n.next_multiple_of(T::Arithmetic::COLUMNS)],
            frames: vec![([Vec3::zero(); 3], Vec3::zero()); n],
        }
    }
    /// J with (ω, velocity of the point) = J v, world axes.
    ///
    /// # Shapes & units
    /// `q`: nq; `point`: in the body's frame, m (`None`: its origin); `out`: 6×nv by rows, angular rows first.
    ///
    /// # Method
    /// Axes of the joints on the path are turned into world axes outward, and their lever arms added up inward from the point:
    /// no distance to the world's origin or to the root enters. Cost O(depth) besides writing the zeros; no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Body`].
    #[inline(always)]
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        body: Option<usize>,
        point: Option<Vec3<T>>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        layout.check_rigid("jacobian")?;
        layout.check_body(body)?;
        check_length("q", q, layout.nq())?;
        check_length("out", out, 6 * layout.nv())?;
        check_length("workspace", &self.path, layout.len())?;
        let (q, out) = (T::arithmetic(q), T::arithmetic_mut(out));
        T::Arithmetic::dispatch(Path::<T> { work: self, layout, q, body, point, out });
        Ok(())
    }
}

kernel! {
    Path<'a, T> {
        work: &'a mut Jacobian<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        body: Option<usize>,
        point: Option<Vec3<T>>,
        out: &'a mut [T::Arithmetic],
    } -> () {
        let (nv, n) = (layout.nv(), layout.len());
        out[..6 * nv].fill(T::Arithmetic::zero());
        let Some(carrier) = body.map(|b| &layout.carriers[b]) else { return };
        let Jacobian { path, angle, sin, cos, frames } = work;
        let (path, angle, frames) = (&mut path[..n], &mut angle[..n], &mut frames[..n]);
        let mut depth = 0;
        let mut k = carrier.body;
        while k != GROUND {
            let b = &layout.bodies[k];
            path[depth] = k;
            angle[depth] = q[b.q];
            depth += 1;
            k = b.parent;
        }
        T::Arithmetic::sin_cos_all(&angle[..depth], sin, cos);
        let (o, one) = (T::Arithmetic::zero(), T::Arithmetic::one());
        let mut axes = [Vec3([one, o, o]), Vec3([o, one, o]), Vec3([o, o, one])];
        for m in (0..depth).rev() {
            let b = &layout.bodies[path[m]];
            let origin;
            (axes, origin) = if let Hinge::Revolute = b.hinge {
                let turn = b.link.turned_by(Turn { cos: cos[m], sin: sin[m] });
                b.link.axes_to_child(&b.link.hinged(turn), axes)
            } else {
                b.axes_to_child(q, axes)
            };
            frames[m] = (axes, origin);
        }
        // From the present body's origin to the point, world axes.
        let mut arm = Vec3::constant(carrier.pose.translation);
        if let Some(Vec3([x, y, z])) = point {
            let point = Vec3([x.to_arithmetic(), y.to_arithmetic(), z.to_arithmetic()]);
            arm += Mat3::constant(&carrier.pose.rotation) * point;
        }
        arm = combine(&axes, arm);
        let rows = &mut out[..6 * nv];
        for m in 0..depth {
            let b = &layout.bodies[path[m]];
            let (axes, origin) = frames[m];
            // Axes are those of the body, but for that of a helical joint.
            each_component!(
                b.hinge,
                |I, C| {
                    let axis = axes[C % 3];
                    if C < 3 {
                        put(rows, nv, b.v + I, axis, axis.cross(arm));
                    } else {
                        put(rows, nv, b.v + I, Vec3::zero(), axis);
                    }
                },
                {
                    let along = combine(&axes, b.hinge.axis(0).linear);
                    put(rows, nv, b.v, axes[2], axes[2].cross_add(arm, along));
                }
            );
            arm += origin;
        }
    }
}

#[inline(always)]
fn put<T: Scalar>(rows: &mut [T], nv: usize, i: usize, angular: Vec3<T>, linear: Vec3<T>) {
    for r in 0..3 {
        rows[r * nv + i] = angular.0[r];
        rows[(r + 3) * nv + i] = linear.0[r];
    }
}

/// [`Jacobian::run`] for a single call, by rows.
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
    Jacobian::new(layout).run(layout, q, body, point, &mut out)?;
    Ok(std::array::from_fn(|r| out[r * nv..(r + 1) * nv].to_vec()))
}
