//! The ends of the loops: where they are and how they move against each other, seen from the body in which they meet.
//!
//! | symbol | meaning | frame |
//! |---|---|---|
//! | A, B | the two frames of a closure | |
//! | c | frame with the axes of A in the origin of B, on which both ends are compared | |
//! | Φ | residual of the positions, rad and m | axes of A |
//! | S (ω, ḋ) | rate of the residual | axes of A |
//! | Π, c | of what is on a flexible body: motion by the rates of its modes, and velocity terms | hinge frame |
//!
//! Poses and velocities are relative to the common ancestor, never to the world, so that a far or fast mechanism closes as
//! well as one at rest; and both ends are compared at one point, so that a rigid motion of the ancestor opens nothing.

use crate::number::{Arithmetic, transform, wrench};
use crate::rows::{MOST_ROWS, Relative};
use crate::structure::{Loop, LoopKind, Structure};
use crate::tree::{Joint, Tree};
use phipsi_recursion::Layout;
use phipsi_recursion::flexible::HeldBody;
use phipsi_spatial::{Kernel, Mat3, Motion, Quaternion, Real, Scalar, Transform, Vec3, Wrench};

/// Where and how fast the ends of all loops are.
#[derive(Clone, Debug)]
pub(crate) struct Frames<T> {
    /// Pose of every body in its parent; of a child of modes in the hinge frame.
    pub(crate) poses: Vec<Transform<T>>,
    /// Of a child of modes, in its node or F.
    pub(crate) local: Vec<Transform<T>>,
    /// Flexible bodies.
    pub(crate) held: Vec<HeldBody<T>>,
    /// Π of all that is on flexible bodies.
    pub(crate) screws: Vec<Motion<T>>,
    /// Ends of the loops in the frames of their bodies.
    ends: Vec<[Transform<T>; 2]>,
    /// Of those on flexible bodies: origin of F, c, and angular velocity of F against the hinge frame; zero for others.
    origins: Vec<[Vec3<T>; 2]>,
    end_terms: Vec<[Motion<T>; 2]>,
    spins: Vec<[Vec3<T>; 2]>,
    /// One per loop; unused for couplings.
    relative: Vec<Relative<T>>,
    /// S of every loop.
    rows: Vec<[Wrench<T>; MOST_ROWS]>,
    /// Pose of a strand's end in each of its bodies.
    pub(crate) along: Vec<Transform<T>>,
    /// The largest residual of a loop, over the scene's length where it is one.
    pub(crate) errors: Vec<f64>,
    /// Frame c in the bodies of A and of B.
    points: Vec<[Transform<T>; 2]>,
    /// Φ − γ of all rows, rad and m.
    pub(crate) residual: Vec<T>,
}

impl<T: Real> Frames<T> {
    pub(crate) fn new(structure: &Structure<T>, layout: &Layout<T>, tree: &Tree<T>) -> Self {
        let n = structure.loops.len();
        let held = layout.held_bodies();
        let ends = structure.loops.iter().map(|l| match &l.kind {
            LoopKind::Frames { a, b, .. } => [a.pose, b.pose],
            LoopKind::Gear { .. } => [Transform::identity(); 2],
        });
        Frames {
            poses: vec![Transform::identity(); tree.len()],
            local: vec![Transform::identity(); if held.is_empty() { 0 } else { tree.len() }],
            held,
            screws: vec![Motion::zero(); structure.screws],
            ends: ends.collect(),
            origins: vec![[Vec3::zero(); 2]; n],
            end_terms: vec![[Motion::zero(); 2]; n],
            spins: vec![[Vec3::zero(); 2]; n],
            relative: vec![Relative::at_rest(); n],
            rows: vec![[Wrench::zero(); MOST_ROWS]; n],
            along: vec![Transform::identity(); structure.paths.len()],
            errors: vec![0.0; n],
            points: vec![[Transform::identity(); 2]; n],
            residual: vec![T::zero(); structure.rows],
        }
    }
    /// Poses of bodies and ends, and the residual; `gamma`: one number per row, or none.
    pub(crate) fn set_position(
        &mut self,
        structure: &Structure<T>,
        (layout, tree): (&Layout<T>, &Tree<T>),
        q: &[T],
        gamma: Option<&[T]>,
    ) {
        Arithmetic::<T>::dispatch(Place { frames: self, structure, layout, tree, q, gamma });
    }
    #[inline(always)]
    fn place(
        &mut self,
        structure: &Structure<T>,
        (layout, tree): (&Layout<T>, &Tree<T>),
        q: &[T],
        gamma: Option<&[T]>,
    ) {
        for (pose, body) in self.poses.iter_mut().zip(&tree.bodies) {
            *pose = body.pose(q);
        }
        self.set_flexible_position(structure, layout, tree, q);
        for (of, l) in structure.loops.iter().enumerate() {
            let phi = match &l.kind {
                LoopKind::Frames { kind, .. } => {
                    let [at_a, at_b] = self.ends[of];
                    let from = self.in_ancestor(structure, l, 0, at_a);
                    let to = self.in_ancestor(structure, l, 1, at_b);
                    // A product of rotations is not quite one; what it lacks would tell A from B where the loop is nearly singular.
                    let product = from.rotation.transpose() * to.rotation;
                    let rotation = Quaternion::from_rotation(&product).to_rotation();
                    let offset = from.rotation.transpose_mul(to.translation - from.translation);
                    let relative = Relative { rotation, offset, twist: Motion::zero() };
                    self.relative[of] = relative;
                    self.rows[of] = relative.rows(*kind);
                    self.points[of] = [
                        at_a.compose(&Transform::new(Mat3::identity(), offset)),
                        Transform::new(at_b.rotation * rotation.transpose(), at_b.translation),
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
            self.errors[of] = self.relative_error(structure, l);
        }
    }
    /// Flexible bodies, and poses and Π of what is on them.
    fn set_flexible_position(
        &mut self,
        structure: &Structure<T>,
        layout: &Layout<T>,
        tree: &Tree<T>,
        q: &[T],
    ) {
        if self.held.is_empty() {
            return;
        }
        for held in &mut self.held {
            held.set_position(layout, q);
        }
        for (k, body) in tree.bodies.iter().enumerate() {
            let (Some((i, node)), Some(first)) = (body.on, structure.attached[k]) else { continue };
            let held = &self.held[i];
            self.local[k] = self.poses[k];
            self.poses[k] = held.pose(node).compose(&self.local[k]);
            for (screw, Pi) in self.screws[first..].iter_mut().zip(held.motions(node)) {
                *screw = held.pose(node).motion_to_parent(*Pi);
            }
        }
        for (of, l) in structure.loops.iter().enumerate() {
            let LoopKind::Frames { a, b, .. } = &l.kind else { continue };
            for (side, end) in [a, b].into_iter().enumerate() {
                let (Some(first), Some(i)) = (l.attached[side], tree.modes(end.body)) else { continue };
                let held = &self.held[i];
                self.ends[of][side] = held.pose(None).compose(&end.pose);
                self.origins[of][side] = held.pose(None).translation;
                for (screw, Pi) in self.screws[first..].iter_mut().zip(held.motions(None)) {
                    *screw = held.pose(None).motion_to_parent(*Pi);
                }
            }
        }
    }
    /// Velocity terms of flexible body `i` at the angular velocity of its hinge frame, and of the ends on it.
    pub(crate) fn set_flexible_velocity(
        &mut self,
        structure: &Structure<T>,
        (layout, tree): (&Layout<T>, &Tree<T>),
        i: usize,
        state: (&[T], &[T]),
        omega: Vec3<T>,
    ) {
        self.held[i].set_velocity(layout, state, omega);
        let held = &self.held[i];
        let rates = &state.1[held.v_range(layout)];
        for (of, l) in structure.loops.iter().enumerate() {
            let LoopKind::Frames { a, b, .. } = &l.kind else { continue };
            for (side, end) in [a, b].into_iter().enumerate() {
                if tree.modes(end.body) == Some(i) {
                    self.end_terms[of][side] = held.pose(None).motion_to_parent(held.velocity_terms(None));
                    self.spins[of][side] = self.carried(l.attached[side], rates).angular;
                }
            }
        }
    }
    /// Pose of an end in the ancestor of its loop.
    #[inline(always)]
    fn in_ancestor(
        &mut self,
        structure: &Structure<T>,
        l: &Loop<T>,
        side: usize,
        end: Transform<T>,
    ) -> Transform<T> {
        let mut pose = end;
        if let Some(strand) = l.strands[side].map(|s| &structure.strands[s]) {
            for i in strand.path..strand.path + strand.bodies {
                self.along[i] = pose;
                pose = self.poses[structure.paths[i]].compose(&pose);
            }
        }
        pose
    }
    /// Velocity of an end against the ancestor of its loop, of the end's origin, in its axes.
    #[inline(always)]
    fn twist(
        &self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        (l, side): (&Loop<T>, usize),
        v: &[T],
    ) -> Motion<T> {
        let mut twist = Motion::zero();
        let mut attached = l.attached[side];
        if let Some(strand) = l.strands[side].map(|s| &structure.strands[s]) {
            for i in strand.path..strand.path + strand.bodies {
                let k = structure.paths[i];
                let body = &tree.bodies[k];
                let v = &v[body.v..body.v + body.nv];
                let moved = match &body.joint {
                    Joint::Hinge(hinge) => hinge.expand(v),
                    Joint::Fixed => Motion::zero(),
                    Joint::Modes(_) => self.carried(attached, v),
                };
                twist += self.along[i].motion_to_child(moved);
                attached = structure.attached[k];
            }
        }
        twist
    }
    /// Σ Π x of what is at these places.
    pub(crate) fn carried(&self, attached: Option<usize>, x: &[T]) -> Motion<T> {
        let screws = attached.map_or(&[][..], |first| &self.screws[first..]);
        screws.iter().zip(x).fold(Motion::zero(), |sum, (screw, x)| sum + screw.scale(*x))
    }
    /// The relative twists at velocities `v`, and their rows: `rates` gets S (ω, ḋ) of all rows, rad/s and m/s.
    #[inline(always)]
    pub(crate) fn set_velocity(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        v: &[T],
        rates: &mut [T],
    ) {
        for (of, l) in structure.loops.iter().enumerate() {
            match &l.kind {
                LoopKind::Frames { .. } => {
                    let inner = self.twist(structure, tree, (l, 0), v);
                    let outer = self.twist(structure, tree, (l, 1), v);
                    let Relative { rotation, offset, .. } = self.relative[of];
                    let angular = rotation * outer.angular - inner.angular;
                    let linear = rotation * outer.linear - (inner.linear + inner.angular.cross(offset));
                    self.relative[of].twist = Motion::new(angular, linear);
                    for (i, row) in l.rows.clone().enumerate() {
                        rates[row] = self.relative[of].twist.dot(self.rows[of][i]);
                    }
                }
                LoopKind::Gear { v: at, multiplier, .. } => {
                    rates[l.rows.start] = v[at[0]] - *multiplier * v[at[1]];
                }
            }
        }
    }
    /// C_r of a strand where it begins: rows on the acceleration of its body, ± S X(c ← body).
    #[inline(always)]
    pub(crate) fn strand_row(&self, structure: &Structure<T>, of: usize, side: usize, i: usize) -> Wrench<T> {
        let l = &structure.loops[of];
        let row = self.points[of][side].wrench_to_parent(self.rows[of][i]).scale(weight(structure, l, i));
        if side == 0 { -row } else { row }
    }
    /// Relative motion of the two ends of a loop at the origin of B, axes of A, from those of the frames A and B in their own axes.
    #[inline(always)]
    pub(crate) fn relative_motion(
        &self,
        of: usize,
        inner: Motion<Arithmetic<T>>,
        outer: Motion<Arithmetic<T>>,
    ) -> Motion<Arithmetic<T>> {
        let Relative { rotation, offset, .. } = self.relative[of];
        let x = transform(&Transform::new(rotation, offset));
        let angular = x.rotation * outer.angular - inner.angular;
        let linear = x.rotation * outer.linear - (inner.linear + inner.angular.cross(x.translation));
        Motion::new(angular, linear)
    }
    /// S of row i of a loop, axes of A.
    #[inline(always)]
    pub(crate) fn row(&self, of: usize, i: usize) -> Wrench<Arithmetic<T>> {
        wrench(self.rows[of][i])
    }
    /// What the velocities add to the right-hand side of all rows (angular ones times the scene's length), and the size of the
    /// terms, which may cancel. `omega`: angular velocity of every body, its axes.
    #[inline(always)]
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
            let inboard = self.ends[of][0].rotation.transpose_mul(omega(a.body) + self.spins[of][0]);
            let from = |side: usize| {
                let point = &self.points[of][side];
                point.rotation.transpose_mul(point.translation - self.origins[of][side])
            };
            let size = |x: Vec3<T>| x.0[0].abs() + x.0[1].abs() + x.0[2].abs();
            let (turn, speed) = (size(inboard), size(relative.twist.linear));
            let angular = turn * size(relative.twist.angular);
            let outboard = turn + size(relative.twist.angular);
            let linear = outboard * (outboard * (size(from(0)) + size(from(1))) + speed + speed);
            let terms = relative.velocity_terms(inboard, from(0), from(1));
            let rows = &self.rows[of];
            for (i, row) in l.rows.clone().enumerate() {
                let turning = if i == 0 { relative.turning(*kind) } else { T::zero() };
                g[row] += weight(structure, l, i) * (terms.dot(rows[i]) - turning);
                sizes[row] = weight(structure, l, i) * if i < l.angular { angular } else { linear };
                for side in [0, 1].into_iter().filter(|&side| l.attached[side].is_some()) {
                    let term = self.end_terms[of][side].dot(self.strand_row(structure, of, side, i));
                    g[row] -= term;
                    sizes[row] += term.abs();
                }
            }
        }
    }
    /// The largest residual of a loop, over the scene's length where it is one.
    #[inline(always)]
    fn relative_error(&self, structure: &Structure<T>, l: &Loop<T>) -> f64 {
        let residual = &self.residual[l.rows.clone()];
        let over = |(i, x): (usize, &T)| {
            let x = x.abs().to_f64();
            if i < l.angular { x } else { x / structure.length }
        };
        residual.iter().enumerate().map(over).fold(0.0, f64::max)
    }
}

struct Place<'a, T: Real> {
    frames: &'a mut Frames<T>,
    structure: &'a Structure<T>,
    layout: &'a Layout<T>,
    tree: &'a Tree<T>,
    q: &'a [T],
    gamma: Option<&'a [T]>,
}

impl<T: Real> Kernel for Place<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.frames.place(self.structure, (self.layout, self.tree), self.q, self.gamma);
    }
}

/// What row i of a loop is multiplied with: the scene's length, if it is an angle.
#[inline(always)]
pub(crate) fn weight<T: Real>(structure: &Structure<T>, l: &Loop<T>, i: usize) -> T {
    if i < l.angular { T::splat(structure.length) } else { T::one() }
}
