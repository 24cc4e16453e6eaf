//! The ends of the loops: where they are and how they move against each other, seen from the body in which they meet.
//!
//! | symbol | meaning | frame |
//! |---|---|---|
//! | A, B | the two frames of a closure | |
//! | c | frame with the axes of A in the origin of B, on which both ends are compared | |
//! | Φ | residual of the positions, rad and m | axes of A |
//! | S (ω, ḋ) | rate of the residual | axes of A |
//!
//! Poses and velocities are relative to the common ancestor, never to the world, so that a far or fast mechanism closes as
//! well as one at rest; and both ends are compared at one point, so that a rigid motion of the ancestor opens nothing.

use crate::rows::{MOST_ROWS, Relative};
use crate::structure::{End, Loop, LoopKind, Structure};
use phipsi_recursion::Layout;
use phipsi_spatial::{Mat3, Motion, Quaternion, Real, Transform, Vec3, Wrench};

/// Where and how fast the ends of all loops are.
#[derive(Clone, Debug)]
pub(crate) struct Frames<T> {
    /// Pose of every body of the layout in its parent.
    pub(crate) poses: Vec<Transform<T>>,
    /// One per loop; unused for couplings.
    relative: Vec<Relative<T>>,
    /// Frame c in the bodies of A and of B.
    points: Vec<[Transform<T>; 2]>,
    /// Φ − γ of all rows, rad and m.
    pub(crate) residual: Vec<T>,
}

impl<T: Real> Frames<T> {
    pub(crate) fn new(structure: &Structure<T>, layout: &Layout<T>) -> Self {
        let n = structure.loops.len();
        Frames {
            poses: vec![Transform::identity(); layout.len()],
            relative: vec![Relative::at_rest(); n],
            points: vec![[Transform::identity(); 2]; n],
            residual: vec![T::zero(); structure.rows],
        }
    }
    /// Poses of bodies and ends, and the residual; `gamma`: one number per row, or none.
    pub(crate) fn set_position(
        &mut self,
        structure: &Structure<T>,
        layout: &Layout<T>,
        q: &[T],
        gamma: Option<&[T]>,
    ) {
        for (pose, body) in self.poses.iter_mut().zip(layout.bodies()) {
            *pose = body.pose(q);
        }
        for (of, l) in structure.loops.iter().enumerate() {
            let phi = match &l.kind {
                LoopKind::Frames { kind, a, b } => {
                    let (from, to) = (self.in_ancestor(layout, l, a), self.in_ancestor(layout, l, b));
                    // A product of rotations is not quite one; what it lacks would tell A from B where the loop is nearly singular.
                    let product = from.rotation.transpose() * to.rotation;
                    let rotation = Quaternion::from_rotation(&product).to_rotation();
                    let offset = from.rotation.transpose_mul(to.translation - from.translation);
                    let relative = Relative { rotation, offset, twist: Motion::zero() };
                    self.relative[of] = relative;
                    self.points[of] = [
                        a.pose.compose(&Transform::new(Mat3::identity(), offset)),
                        Transform::new(b.pose.rotation * rotation.transpose(), b.pose.translation),
                    ];
                    relative.residual(*kind)
                }
                LoopKind::Gear { q: at, multiplier, offset, .. } => {
                    let mut phi = [T::zero(); MOST_ROWS];
                    phi[0] = q[at[0]] - *multiplier * q[at[1]] - *offset;
                    phi
                }
            };
            for (i, row) in l.rows.clone().enumerate() {
                self.residual[row] = phi[i] - gamma.map_or(T::zero(), |gamma| gamma[row]);
            }
        }
    }
    /// Pose of an end in the ancestor of its loop.
    fn in_ancestor(&self, layout: &Layout<T>, l: &Loop<T>, end: &End<T>) -> Transform<T> {
        let (mut pose, mut k) = (end.pose, end.body);
        while k != l.ancestor {
            pose = self.poses[k].compose(&pose);
            k = layout.bodies()[k].parent;
        }
        pose
    }
    /// Velocity of an end against the ancestor of its loop, of the end's origin, in its axes.
    fn twist(&self, layout: &Layout<T>, l: &Loop<T>, end: &End<T>, v: &[T]) -> Motion<T> {
        let (mut pose, mut k) = (end.pose, end.body);
        let mut twist = Motion::zero();
        while k != l.ancestor {
            let body = &layout.bodies()[k];
            twist += pose.motion_to_child(body.hinge.expand(&v[body.v..]));
            pose = self.poses[k].compose(&pose);
            k = body.parent;
        }
        twist
    }
    /// The relative twists at velocities `v`, and their rows: `rates` gets S (ω, ḋ) of all rows, rad/s and m/s.
    pub(crate) fn set_velocity(
        &mut self,
        structure: &Structure<T>,
        layout: &Layout<T>,
        v: &[T],
        rates: &mut [T],
    ) {
        for (of, l) in structure.loops.iter().enumerate() {
            match &l.kind {
                LoopKind::Frames { kind, a, b } => {
                    let inner = self.twist(layout, l, a, v);
                    let outer = self.twist(layout, l, b, v);
                    let Relative { rotation, offset, .. } = self.relative[of];
                    let angular = rotation * outer.angular - inner.angular;
                    let linear = rotation * outer.linear - (inner.linear + inner.angular.cross(offset));
                    self.relative[of].twist = Motion::new(angular, linear);
                    let rows = self.relative[of].rows(*kind);
                    for (i, row) in l.rows.clone().enumerate() {
                        rates[row] = self.relative[of].twist.dot(rows[i]);
                    }
                }
                LoopKind::Gear { v: at, multiplier, .. } => {
                    rates[l.rows.start] = v[at[0]] - *multiplier * v[at[1]];
                }
            }
        }
    }
    /// C_r of a strand where it begins: rows on the acceleration of its body, ± S X(c ← body).
    pub(crate) fn strand_row(&self, structure: &Structure<T>, of: usize, side: usize, i: usize) -> Wrench<T> {
        let l = &structure.loops[of];
        let LoopKind::Frames { kind, .. } = &l.kind else { return Wrench::zero() };
        let row = self.relative[of].rows(*kind)[i];
        let row = self.points[of][side].wrench_to_parent(row).scale(weight(structure, l, i));
        if side == 0 { -row } else { row }
    }
    /// What the velocities add to the right-hand side of all rows (angular ones times the scene's length), and the size of the
    /// terms, which may cancel. `omega`: angular velocity of every body, its axes.
    pub(crate) fn add_velocity_terms(
        &self,
        structure: &Structure<T>,
        omega: impl Fn(usize) -> Vec3<T>,
        g: &mut [T],
        sizes: &mut [T],
    ) {
        for (of, l) in structure.loops.iter().enumerate() {
            let LoopKind::Frames { kind, a, .. } = &l.kind else { continue };
            let relative = &self.relative[of];
            let inboard = a.pose.rotation.transpose_mul(omega(a.body));
            let from = |side: usize| {
                let point = &self.points[of][side];
                point.rotation.transpose_mul(point.translation)
            };
            let (turn, speed) = (inboard.norm(), relative.twist.linear.norm());
            let angular = turn * relative.twist.angular.norm();
            let outboard = turn + relative.twist.angular.norm();
            let linear = outboard * (outboard * (from(0).norm() + from(1).norm()) + speed + speed);
            let terms = relative.velocity_terms(inboard, from(0), from(1));
            let rows = relative.rows(*kind);
            for (i, row) in l.rows.clone().enumerate() {
                let turning = if i == 0 { relative.turning(*kind) } else { T::zero() };
                g[row] += weight(structure, l, i) * (terms.dot(rows[i]) - turning);
                sizes[row] = weight(structure, l, i) * if i < l.angular { angular } else { linear };
            }
        }
    }
    /// The largest residual of a loop, over the scene's length where it is one.
    pub(crate) fn relative_error(&self, structure: &Structure<T>, of: usize) -> f64 {
        let l = &structure.loops[of];
        let residual = &self.residual[l.rows.clone()];
        let over = |(i, x): (usize, &T)| {
            let x = x.abs().to_f64();
            if i < l.angular { x } else { x / structure.length }
        };
        residual.iter().enumerate().map(over).fold(0.0, f64::max)
    }
}

/// What row i of a loop is multiplied with: the scene's length, if it is an angle.
pub(crate) fn weight<T: Real>(structure: &Structure<T>, l: &Loop<T>, i: usize) -> T {
    if i < l.angular { T::splat(structure.length) } else { T::one() }
}
