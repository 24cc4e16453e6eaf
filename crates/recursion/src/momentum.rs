//! Momentum of the whole system and the centroidal momentum matrix.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | h(k) | M(k) V(k) + Σ φ(k,c) h(c), momentum of everything outboard of joint k | notes/integrators.md 1 |
//! | R(k) | M(k) + Σ φ(k,c) R(c) φ*(k,c), inertia of everything outboard of joint k, joints locked | paper 2 (4.12) |

use crate::composites::Composites;
use crate::energy::{CenterOfMass, Root};
use crate::error::{DynamicsError, check_length};
use crate::flexible::{FlexibleTree, NewtonEuler};
use crate::hinge::{Axes, Hinge, combine};
use crate::kernel::kernel;
use crate::layout::Pending;
use crate::layout::{GROUND, Layout, Shifts};
use phipsi_spatial::{Motion, RigidInertia, Scalar, Transform, Vec3, Wrench};

/// The point about which angular momentum is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum About<T> {
    /// The centre of mass of the moving bodies.
    CenterOfMass,
    /// A point of the world, m.
    Point(Vec3<T>),
}

/// Workspace of the momentum.
#[derive(Clone, Debug)]
pub struct Momentum<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    velocity: Vec<Motion<T::Arithmetic>>,
    h: Vec<Wrench<T::Arithmetic>>,
    center: CenterOfMass<T>,
    flexible: Option<Box<NewtonEuler<T>>>,
}

impl<T: Scalar> Momentum<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        Momentum {
            shifts: Shifts::new(layout),
            velocity: vec![Motion::zero(); layout.len()],
            h: vec![Wrench::zero(); layout.len()],
            center: CenterOfMass::new(layout),
            flexible: NewtonEuler::of(layout),
        }
    }
    /// Angular momentum about a point, then linear momentum; world axes; kg·m²/s, kg·m/s. `q`: nq, `v`: nv. Cost O(n), no
    /// allocation.
    ///
    /// # Accuracy
    /// Momenta are gathered in body frames to each root and moved from there, so that for a tree with one root the result
    /// about the centre of mass does not depend on the distance to the world's origin.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        about: About<T>,
    ) -> Result<Wrench<T>, DynamicsError> {
        check_length("q", q, layout.nq())?;
        check_length("v", v, layout.nv())?;
        check_length("workspace", &self.velocity, layout.len())?;
        if let Some(tree) = layout.flexible() {
            return flexible_momentum(NewtonEuler::checked(&mut self.flexible, tree)?, tree, q, v, about);
        }
        let (q, v) = (T::arithmetic(q), T::arithmetic(v));
        let [a, b, c, d, e, f] =
            T::Arithmetic::dispatch(Gather::<T> { work: self, layout, q, v, about }).to_array();
        let back = T::from_arithmetic;
        Ok(Wrench::from_array([back(a), back(b), back(c), back(d), back(e), back(f)]))
    }
}

kernel! {
    Gather<'a, T> {
        work: &'a mut Momentum<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        v: &'a [T::Arithmetic],
        about: About<T>,
    } -> Wrench<T::Arithmetic> {
        let Momentum { shifts, velocity, h, center, .. } = work;
        shifts.set_all(layout, q);
        for (k, body) in layout.bodies.iter().enumerate() {
            let joint = body.hinge.expand(&v[body.v..]);
            velocity[k] = match body.parent {
                GROUND => joint,
                p => shifts.at(k, body).motion_to_child(velocity[p]) + joint,
            };
            h[k] = RigidInertia::constant(&body.inertia).momentum(velocity[k]);
        }
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            if body.parent != GROUND {
                let shifted = shifts.at(k, body).wrench_to_parent(h[k]);
                h[body.parent] += shifted;
            }
        }
        center.gather(layout, q);
        let mut total = Wrench::zero();
        for root in &center.roots {
            total += frame_at(center, root, about).wrench_to_child(h[root.body]);
        }
        total
    }
}

/// Momenta are taken about the first root, and moved from there.
fn flexible_momentum<T: Scalar>(
    work: &mut NewtonEuler<T>,
    tree: &FlexibleTree<T::Constant>,
    q: &[T],
    v: &[T],
    about: About<T>,
) -> Result<Wrench<T>, DynamicsError> {
    let root = work.reference(tree, q);
    let h = work.momentum(tree, q, v, root);
    let offset = match about {
        About::Point(point) => point - root,
        About::CenterOfMass => {
            let (mass, Vec3([x, y, z])) = work.first_moment(tree, q, root);
            Vec3([x / mass, y / mass, z / mass])
        }
    };
    Ok(Wrench::new(h.moment - offset.cross(h.force), h.force))
}

/// The frame at the point with world axes, seen from a root's frame.
#[inline(always)]
fn frame_at<T: Scalar>(
    center: &CenterOfMass<T>,
    root: &Root<T::Arithmetic>,
    about: About<T>,
) -> Transform<T::Arithmetic> {
    let pose = &root.pose;
    // The point relative to this root, world axes.
    let offset = match about {
        About::Point(Vec3([x, y, z])) => {
            Vec3([x.to_arithmetic(), y.to_arithmetic(), z.to_arithmetic()]) - pose.translation
        }
        About::CenterOfMass => {
            let (mass, Vec3([x, y, z])) = center.sum(pose.translation);
            Vec3([x / mass, y / mass, z / mass])
        }
    };
    Transform::new(pose.rotation.transpose(), pose.rotation.transpose_mul(offset))
}

/// [`Momentum::run`] for a single call.
///
/// # Errors
/// As there.
pub fn momentum<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    about: About<T>,
) -> Result<Wrench<T>, DynamicsError> {
    Momentum::new(layout).run(layout, q, v, about)
}

/// Axes of a body in the world, and its origin from the centre of mass.
type Frame<T> = ([Vec3<T>; 3], Vec3<T>);

/// Workspace of the centroidal momentum matrix.
#[derive(Clone, Debug)]
pub struct CentroidalMomentumMatrix<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    pending: Pending<RigidInertia<T::Arithmetic>>,
    R: Vec<RigidInertia<T::Arithmetic>>,
    frames: Vec<Frame<T::Arithmetic>>,
    center: CenterOfMass<T>,
}

impl<T: Scalar> CentroidalMomentumMatrix<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        CentroidalMomentumMatrix {
            shifts: Shifts::new(layout),
            pending: Pending::new(layout, RigidInertia::zero()),
            R: vec![RigidInertia::zero(); layout.len()],
            frames: vec![([Vec3::zero(); 3], Vec3::zero()); layout.len()],
            center: CenterOfMass::new(layout),
        }
    }
    /// A with (angular momentum about the centre of mass, linear momentum) = A v; world axes.
    ///
    /// # Shapes & units
    /// `q`: nq; `out`: 6×nv by rows.
    ///
    /// # Method
    /// Column i is the momentum of the composite body outboard of the joint, moving along axis i, moved to the centre of mass
    /// by the body's place from its root's. Cost O(n), no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn run(&mut self, layout: &Layout<T::Constant>, q: &[T], out: &mut [T]) -> Result<(), DynamicsError> {
        layout.check_rigid("centroidal_momentum_matrix")?;
        check_length("q", q, layout.nq())?;
        check_length("out", out, 6 * layout.nv())?;
        check_length("workspace", &self.R, layout.len())?;
        let (q, out) = (T::arithmetic(q), T::arithmetic_mut(out));
        T::Arithmetic::dispatch(Columns::<T> { work: self, layout, q, out });
        Ok(())
    }
}

kernel! {
    Columns<'a, T> {
        work: &'a mut CentroidalMomentumMatrix<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        out: &'a mut [T::Arithmetic],
    } -> () {
        let CentroidalMomentumMatrix { shifts, pending, R, frames, center } = work;
        shifts.set_all(layout, q);
        let mut composites = Composites::begin(layout, shifts, pending);
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            R[k] = composites.next(k, body);
        }
        for root in &mut center.roots {
            let k = root.body;
            let pose = shifts.at(k, &layout.bodies[k]).pose();
            *root = Root { body: k, pose, mass: R[k].mass, moment: R[k].first_moment };
        }
        for root in &center.roots {
            let (mass, Vec3([x, y, z])) = center.sum(root.pose.translation);
            let axes = |i: usize| root.pose.rotation.column(i);
            frames[root.body] = ([axes(0), axes(1), axes(2)], -Vec3([x / mass, y / mass, z / mass]));
        }
        let nv = layout.nv();
        let mut previous = ([Vec3::zero(); 3], Vec3::zero());
        for (k, body) in layout.bodies.iter().enumerate() {
            previous = if body.parent == GROUND {
                frames[k]
            } else {
                let (axes, origin) = if body.follows_parent(k) { previous } else { frames[body.parent] };
                let (axes, step) = shifts.at(k, body).axes_to_child(axes);
                (axes, origin + step)
            };
            if body.children > 1 {
                frames[k] = previous;
            }
            let rows = &mut *out;
            if let Hinge::Revolute = body.hinge {
                put(rows, nv, body.v, &previous, R[k].column(2));
                continue;
            }
            for i in 0..body.hinge.nv() {
                put(rows, nv, body.v + i, &previous, R[k].momentum(body.hinge.axis(i)));
            }
        }
    }
}

/// Writes a momentum in the axes of a body, about its origin, as column `i`.
#[inline(always)]
fn put<T: Scalar>(out: &mut [T], nv: usize, i: usize, (axes, origin): &Axes<T>, h: Wrench<T>) {
    let force = combine(axes, h.force);
    let moment = origin.cross_add(force, combine(axes, h.moment));
    let column = Wrench::new(moment, force).to_array();
    for r in 0..6 {
        out[r * nv + i] = column[r];
    }
}

/// [`CentroidalMomentumMatrix::run`] for a single call, by rows.
///
/// # Errors
/// As there.
pub fn centroidal_momentum_matrix<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> Result<[Vec<T>; 6], DynamicsError> {
    let nv = layout.nv();
    let mut out = vec![T::zero(); 6 * nv];
    CentroidalMomentumMatrix::new(layout).run(layout, q, &mut out)?;
    Ok(std::array::from_fn(|r| out[r * nv..(r + 1) * nv].to_vec()))
}
