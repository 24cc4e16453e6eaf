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

use crate::compiled::Number;
use crate::number::{Arithmetic, motion, plain, size, transform, vector};
use crate::rows::{MOST_ROWS, OWN, Relative};
use crate::structure::{Loop, LoopKind, Structure};
use crate::tree::{Joint, Tree};
use phipsi_recursion::Layout;
use phipsi_recursion::flexible::HeldBody;
use phipsi_recursion::hinge::Hinge;
use phipsi_recursion::layout::Shift;
use phipsi_spatial::{Kernel, Mat3, Motion, Scalar, Transform, Vec3, Wrench};

/// Where and how fast the ends of all loops are.
#[derive(Clone, Debug)]
pub(crate) struct Frames<T: Scalar> {
    /// Passage of every body to its parent, where there is a cheaper one than its pose.
    pub(crate) shifts: Vec<Shift<Arithmetic<T>>>,
    /// Pose of every body in its parent; of a child of modes in the hinge frame.
    pub(crate) poses: Vec<Transform<Arithmetic<T>>>,
    /// Of a child of modes, in its node or F.
    pub(crate) local: Vec<Transform<Arithmetic<T>>>,
    /// Sines and cosines of all coordinates.
    sin: Vec<Arithmetic<T>>,
    cos: Vec<Arithmetic<T>>,
    /// Flexible bodies.
    pub(crate) held: Vec<HeldBody<T>>,
    /// Π of all that is on flexible bodies.
    pub(crate) screws: Vec<Motion<T>>,
    /// Ends of the loops in the frames of their bodies.
    ends: Vec<[Transform<Arithmetic<T>>; 2]>,
    /// Of those on flexible bodies: origin of F, c, and angular velocity of F against the hinge frame; zero for others.
    origins: Vec<[Vec3<Arithmetic<T>>; 2]>,
    end_terms: Vec<[Motion<Arithmetic<T>>; 2]>,
    spins: Vec<[Vec3<Arithmetic<T>>; 2]>,
    /// One per loop; unused for couplings.
    relative: Vec<Relative<Arithmetic<T>>>,
    /// The row of S of every loop that is along no axis.
    own: Vec<Wrench<Arithmetic<T>>>,
    /// Pose of a strand's end in each of its bodies.
    pub(crate) along: Vec<Transform<Arithmetic<T>>>,
    /// The largest residual of a loop, over the scene's length where it is one.
    pub(crate) errors: Vec<f64>,
    /// Frame c in the bodies of A and of B.
    points: Vec<[Transform<Arithmetic<T>>; 2]>,
    /// Φ − γ of all rows, rad and m.
    pub(crate) residual: Vec<T>,
}

impl<T: Number> Frames<T> {
    pub(crate) fn new(structure: &Structure<T>, layout: &Layout<T>, tree: &Tree<T>) -> Self {
        let n = structure.loops.len();
        let held = layout.held_bodies();
        let ends = structure.loops.iter().map(|l| match &l.kind {
            LoopKind::Frames { a, b, .. } => [transform(&a.pose), transform(&b.pose)],
            LoopKind::Gear { .. } => [Transform::identity(); 2],
        });
        Frames {
            shifts: vec![Shift::identity(); tree.len()],
            poses: vec![Transform::identity(); tree.len()],
            local: vec![Transform::identity(); if held.is_empty() { 0 } else { tree.len() }],
            sin: vec![Arithmetic::<T>::splat(0.0); layout.nq().next_multiple_of(Arithmetic::<T>::COLUMNS)],
            cos: vec![Arithmetic::<T>::splat(1.0); layout.nq().next_multiple_of(Arithmetic::<T>::COLUMNS)],
            held,
            screws: vec![Motion::zero(); structure.screws],
            ends: ends.collect(),
            origins: vec![[Vec3::zero(); 2]; n],
            end_terms: vec![[Motion::zero(); 2]; n],
            spins: vec![[Vec3::zero(); 2]; n],
            relative: vec![Relative::at_rest(); n],
            own: vec![Wrench::zero(); n],
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
        T::place(Place { frames: self, structure, layout, tree, q, gamma });
    }
    #[inline(always)]
    fn place(
        &mut self,
        structure: &Structure<T>,
        (layout, tree): (&Layout<T>, &Tree<T>),
        q: &[T],
        gamma: Option<&[T]>,
    ) {
        let numbers = T::arithmetic(q);
        Arithmetic::<T>::sin_cos_all(numbers, &mut self.sin, &mut self.cos);
        for (k, body) in tree.bodies.iter().enumerate() {
            (self.shifts[k], self.poses[k]) = body.shift(numbers, &self.sin, &self.cos);
        }
        self.set_flexible_position(structure, layout, tree, q);
        for (of, l) in structure.loops.iter().enumerate() {
            let phi = match &l.kind {
                LoopKind::Frames { kind, .. } => {
                    let [at_a, at_b] = self.ends[of];
                    let from = self.in_ancestor(structure, l, 0, at_a);
                    let to = self.in_ancestor(structure, l, 1, at_b);
                    // A product of rotations is not quite one; what it lacks would tell A from B where the loop is nearly singular.
                    let rotation = straightened(&(from.rotation.transpose() * to.rotation));
                    let offset = from.rotation.transpose_mul(to.translation - from.translation);
                    let relative = Relative { rotation, offset, twist: Motion::zero() };
                    self.relative[of] = relative;
                    self.own[of] = relative.own_row(*kind);
                    self.points[of] = [
                        Transform::new(at_a.rotation, at_a.point(offset)),
                        Transform::new(at_b.rotation * rotation.transpose(), at_b.translation),
                    ];
                    let Transform { rotation, translation: offset } =
                        plain::<T>(&Transform::new(rotation, offset));
                    Relative { rotation, offset, twist: Motion::zero() }.residual(*kind)
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
            self.poses[k] = transform(held.pose(node)).compose(&self.local[k]);
            for (screw, Pi) in self.screws[first..].iter_mut().zip(held.motions(node)) {
                *screw = held.pose(node).motion_to_parent(*Pi);
            }
        }
        for (of, l) in structure.loops.iter().enumerate() {
            let LoopKind::Frames { a, b, .. } = &l.kind else { continue };
            for (side, end) in [a, b].into_iter().enumerate() {
                let (Some(first), Some(i)) = (l.attached[side], tree.modes(end.body)) else { continue };
                let held = &self.held[i];
                self.ends[of][side] = transform(&held.pose(None).compose(&end.pose));
                self.origins[of][side] = vector(held.pose(None).translation);
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
                    self.end_terms[of][side] =
                        motion(held.pose(None).motion_to_parent(held.velocity_terms(None)));
                    self.spins[of][side] = vector(self.carried(l.attached[side], rates).angular);
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
        end: Transform<Arithmetic<T>>,
    ) -> Transform<Arithmetic<T>> {
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
    ) -> Motion<Arithmetic<T>> {
        let mut twist = Motion::zero();
        let mut attached = l.attached[side];
        if let Some(strand) = l.strands[side].map(|s| &structure.strands[s]) {
            for i in strand.path..strand.path + strand.bodies {
                let k = structure.paths[i];
                let (body, along) = (&tree.bodies[k], &self.along[i]);
                let v = &v[body.v..body.v + body.nv];
                twist += match &body.joint {
                    Joint::Hinge(Hinge::Revolute) => {
                        let ([x, y, z], l) = (along.rotation.0.map(Vec3), along.translation.0);
                        Motion::new(z, y.scale_add(l[0], x.scale(-l[1]))).scale(v[0].to_arithmetic())
                    }
                    Joint::Hinge(Hinge::Prismatic) => {
                        let z = Vec3(along.rotation.0[2]);
                        Motion::new(Vec3::zero(), z.scale(v[0].to_arithmetic()))
                    }
                    Joint::Hinge(hinge) => along.motion_to_child(hinge.expand(T::arithmetic(v))),
                    Joint::Fixed => Motion::zero(),
                    Joint::Modes(_) => along.motion_to_child(motion(self.carried(attached, v))),
                };
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
    pub(crate) fn set_velocity(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        v: &[T],
        rates: &mut [T],
    ) {
        T::turn(Turn { frames: self, structure, tree, v, rates });
    }
    /// The same, inside a kernel.
    #[inline(always)]
    pub(crate) fn turn(&mut self, structure: &Structure<T>, tree: &Tree<T>, v: &[T], rates: &mut [T]) {
        for (of, l) in structure.loops.iter().enumerate() {
            match &l.kind {
                LoopKind::Frames { .. } => {
                    let inner = self.twist(structure, tree, (l, 0), v);
                    let outer = self.twist(structure, tree, (l, 1), v);
                    let twist = self.relative_motion(of, inner, outer);
                    self.relative[of].twist = twist;
                    for (i, row) in l.rows.clone().enumerate() {
                        rates[row] = T::from_arithmetic(self.along_row((of, l), i, &twist));
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
    pub(crate) fn strand_row(
        &self,
        structure: &Structure<T>,
        of: usize,
        side: usize,
        i: usize,
    ) -> Wrench<Arithmetic<T>> {
        let (l, point) = (&structure.loops[of], &self.points[of][side]);
        let row = match l.axes[i] {
            OWN => point.wrench_to_parent(self.own[of]),
            axis if axis < 3 => Wrench::new(point.rotation.column(axis), Vec3::zero()),
            axis => {
                let force = point.rotation.column(axis - 3);
                Wrench::new(point.translation.cross(force), force)
            }
        };
        let weight = weight(structure, l, i).to_arithmetic();
        row.scale(if side == 0 { -weight } else { weight })
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
        let angular = rotation * outer.angular - inner.angular;
        let linear = rotation * outer.linear - (inner.linear + inner.angular.cross(offset));
        Motion::new(angular, linear)
    }
    /// Row i of S of a loop on a motion, axes of A.
    #[inline(always)]
    pub(crate) fn along_row(
        &self,
        (of, l): (usize, &Loop<T>),
        i: usize,
        motion: &Motion<Arithmetic<T>>,
    ) -> Arithmetic<T> {
        match l.axes[i] {
            OWN => motion.dot(self.own[of]),
            axis => motion.get(axis),
        }
    }
    /// What the velocities add to the right-hand side of all rows (angular ones times the scene's length), and the size of the
    /// terms, which may cancel. `omega`: angular velocity of every body, its axes.
    #[inline(always)]
    pub(crate) fn add_velocity_terms(
        &self,
        structure: &Structure<T>,
        omega: impl Fn(usize) -> Vec3<Arithmetic<T>>,
        g: &mut [Arithmetic<T>],
        sizes: &mut [Arithmetic<T>],
    ) {
        for (of, l) in structure.loops.iter().enumerate() {
            let LoopKind::Frames { kind, a, .. } = &l.kind else { continue };
            let relative = &self.relative[of];
            let inboard = self.ends[of][0].rotation.transpose_mul(omega(a.body) + self.spins[of][0]);
            // Not by `map`, whose closure would be compiled for any processor.
            let from = |side: usize| {
                let point = &self.points[of][side];
                point.rotation.transpose_mul(point.translation - self.origins[of][side])
            };
            let from = [from(0), from(1)];
            let all = |x: Vec3<Arithmetic<T>>| size(x.0[0]) + size(x.0[1]) + size(x.0[2]);
            let (turn, speed) = (all(inboard), all(relative.twist.linear));
            let angular = turn * all(relative.twist.angular);
            let outboard = turn + all(relative.twist.angular);
            let linear = outboard * (outboard * (all(from[0]) + all(from[1])) + speed + speed);
            let terms = relative.velocity_terms(inboard, from[0], from[1]);
            for (i, row) in l.rows.clone().enumerate() {
                let weight = weight(structure, l, i).to_arithmetic();
                let mut along = self.along_row((of, l), i, &terms);
                if l.axes[i] == OWN {
                    along -= relative.turning(*kind);
                }
                g[row] += weight * along;
                sizes[row] = weight * if i < l.angular { angular } else { linear };
                for side in [0, 1].into_iter().filter(|&side| l.attached[side].is_some()) {
                    let term = self.end_terms[of][side].dot(self.strand_row(structure, of, side, i));
                    g[row] -= term;
                    sizes[row] += size(term);
                }
            }
        }
    }
    /// The largest residual of a loop, over the scene's length where it is one.
    #[inline(always)]
    fn relative_error(&self, structure: &Structure<T>, l: &Loop<T>) -> f64 {
        let mut most = 0.0f64;
        for (i, x) in self.residual[l.rows.clone()].iter().enumerate() {
            let x = x.abs().to_f64();
            most = most.max(if i < l.angular { x } else { x / structure.length });
        }
        most
    }
}

pub(crate) struct Place<'a, T: Number> {
    frames: &'a mut Frames<T>,
    structure: &'a Structure<T>,
    layout: &'a Layout<T>,
    tree: &'a Tree<T>,
    q: &'a [T],
    gamma: Option<&'a [T]>,
}

impl<T: Number> Kernel for Place<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.frames.place(self.structure, (self.layout, self.tree), self.q, self.gamma);
    }
}

pub(crate) struct Turn<'a, T: Number> {
    frames: &'a mut Frames<T>,
    structure: &'a Structure<T>,
    tree: &'a Tree<T>,
    v: &'a [T],
    rates: &'a mut [T],
}

impl<T: Number> Kernel for Turn<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.frames.turn(self.structure, self.tree, self.v, self.rates);
    }
}

/// The rotation nearest to a matrix that is one but for rounding, to second order: R (3 − R*R)/2.
#[inline(always)]
fn straightened<S: Scalar>(R: &Mat3<S>) -> Mat3<S> {
    let [x, y, z] = [0, 1, 2].map(|i| R.column(i));
    let half = S::splat(0.5);
    let on = |a: Vec3<S>| (-half).fma(a.dot(a), S::splat(1.5));
    let off = |a: Vec3<S>, b: Vec3<S>| -half * a.dot(b);
    let (xy, xz, yz) = (off(x, y), off(x, z), off(y, z));
    Mat3::from_columns(
        x.scale_add(on(x), y.scale_add(xy, z.scale(xz))),
        y.scale_add(on(y), x.scale_add(xy, z.scale(yz))),
        z.scale_add(on(z), x.scale_add(xz, y.scale(yz))),
    )
}

/// What row i of a loop is multiplied with: the scene's length, if it is an angle.
#[inline(always)]
pub(crate) fn weight<T: Number>(structure: &Structure<T>, l: &Loop<T>, i: usize) -> T {
    if i < l.angular { T::splat(structure.length) } else { T::one() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::Random;
    use phipsi_spatial::Quaternion;

    /// A rotation with errors of 1e-6 is one to rounding afterwards, but for their square, and has turned no further.
    #[test]
    fn straightening_squares_the_error() {
        let mut random = Random::new(5);
        for _ in 0..50 {
            let exact = Quaternion(random.quaternion()).to_rotation();
            let error = 1e-6;
            let R: Mat3<f64> = Mat3(exact.0.map(|row| row.map(|x| x + error * random.signed())));
            let straight = straightened(&R);
            let (square, moved) = (straight.transpose() * straight, straight.transpose() * exact);
            for i in 0..3 {
                for j in 0..3 {
                    let one = f64::from(u8::from(i == j));
                    // R*R differs from one by 2·3e at most, and by three quarters of the square of that afterwards.
                    let bound = 27.0 * error * error + 16.0 * f64::EPSILON;
                    assert!((square.0[i][j] - one).abs() <= bound, "{:e}", square.0[i][j] - one);
                    assert!((moved.0[i][j] - one).abs() <= 6.0 * error);
                }
            }
        }
    }
}
