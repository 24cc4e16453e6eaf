//! One right-hand side: the filter inward, the smoother and the multipliers outward.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | z | bias force | 6 | paper 1 (9.3) |
//! | s | U^−*(T − Hz) | r | paper 1 (9.9) |
//! | ζ | what ξ would be, but for Xα, if the subtree moved rigidly | ρ | |
//! | g | right-hand side of the loops' rows | m | |
//! | h | R^−*g, the part of the residuals that the loop demands | rank | |
//! | η | Q*ξ, the residuals as an operation leaves them | ρ | |
//! | λ | multipliers: R λ = η₁ − Σ W'_o λ_o | m | |
//!
//! Angular rows are multiplied with the scene's length throughout, so that λ of an angular row is a moment over that length.

use crate::factors::{Done, Factors};
use crate::frames::{Frames, weight};
use crate::number::{Arithmetic, larger, motion, size, transform};
use crate::structure::{LoopKind, Operation, Structure};
use crate::tree::{Joint, Tree};
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Kernel, Motion, Real, Scalar, Vec3, Wrench};

mod modes;
mod multipliers;

/// A redundant row whose right-hand side is not what the others imply.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inconsistency {
    /// The closure, counted as closures, then couplings.
    pub closure: usize,
    /// The row of that closure.
    pub row: usize,
    /// By how much, relative to the terms of the row.
    pub size: f64,
}

/// A right-hand side and its solution.
#[derive(Clone, Debug)]
pub(crate) struct Solution<T: Scalar> {
    /// Bias forces and bias accelerations of the bodies: input.
    pub(crate) z: Vec<Wrench<Arithmetic<T>>>,
    pub(crate) a: Vec<Motion<Arithmetic<T>>>,
    /// Bias forces of all modes: input.
    pub(crate) z_modes: Vec<Arithmetic<T>>,
    first_mode: usize,
    /// Right-hand sides of the rows: input; and the size of their terms.
    pub(crate) g: Vec<Arithmetic<T>>,
    pub(crate) sizes: Vec<Arithmetic<T>>,
    s: Vec<Arithmetic<T>>,
    zeta: Vec<Arithmetic<T>>,
    eta: Vec<Arithmetic<T>>,
    /// ζ₁ + h of the closings.
    first: Vec<Arithmetic<T>>,
    /// What the redundant rows lack.
    lost: Vec<Arithmetic<T>>,
    stack: Vec<Arithmetic<T>>,
    x: Vec<Arithmetic<T>>,
    alpha: Vec<Motion<Arithmetic<T>>>,
    /// Σ X a over the bodies of a strand, at the frame of its end, in its axes; and Σ of their sizes.
    carried: Vec<(Motion<Arithmetic<T>>, Arithmetic<T>)>,
    pub(crate) lambda: Vec<Arithmetic<T>>,
    /// Of conjugate gradients.
    direction: Vec<Arithmetic<T>>,
    gradient: Vec<Arithmetic<T>>,
    image: Vec<Arithmetic<T>>,
    /// The largest |η₁| of all loops.
    largest: Arithmetic<T>,
    pub(crate) inconsistency: Option<Inconsistency>,
}

/// Where the residuals of a joint are while its body is dealt with.
#[derive(Clone, Copy)]
enum Own {
    /// No loop passes the joint.
    Nowhere,
    /// From this row on among all blocks' rows: the join is in place.
    Block(usize),
    /// From this row on, on the stack.
    Stack(usize),
}

/// What drives the mechanism besides z, a and g.
#[derive(Clone, Copy)]
pub(crate) struct Load<'a, S> {
    /// Generalised forces.
    pub(crate) tau: Option<&'a [S]>,
    /// Accelerations of the prescribed degrees of freedom.
    pub(crate) prescribed: Option<&'a [S]>,
    /// Acceleration of the ground.
    pub(crate) ground: Vec3<S>,
}

impl<T: Real> Solution<T> {
    pub(crate) fn new(
        structure: &Structure<T>,
        layout: &phipsi_recursion::Layout<T>,
        tree: &Tree<T>,
    ) -> Self {
        let modes = |k: usize| tree.modes(k).map_or(0, |_| tree.bodies[k].nv);
        let modes: usize = (0..tree.len()).map(modes).sum();
        let o = Arithmetic::<T>::splat(0.0);
        let most = structure.operations.iter().fold(0, |most, operation| most.max(operation.most));
        Solution {
            z: vec![Wrench::zero(); tree.len()],
            a: vec![Motion::zero(); tree.len()],
            z_modes: vec![o; modes],
            first_mode: layout.nv() - modes,
            g: vec![o; structure.rows],
            sizes: vec![o; structure.rows],
            s: vec![o; layout.nv()],
            zeta: vec![o; structure.block_rows],
            eta: vec![o; structure.block_rows],
            first: vec![o; structure.operation_rows],
            lost: vec![o; structure.rows],
            stack: vec![o; most],
            x: vec![o; most],
            alpha: vec![Motion::zero(); tree.len()],
            carried: vec![(Motion::zero(), o); structure.strands.len()],
            lambda: vec![o; structure.rows],
            direction: vec![o; structure.rows],
            gradient: vec![o; structure.rows],
            image: vec![o; structure.rows],
            largest: o,
            inconsistency: None,
        }
    }
    /// No forces, no biases, no right-hand side.
    pub(crate) fn clear(&mut self) {
        self.z.fill(Wrench::zero());
        self.a.fill(Motion::zero());
        self.z_modes.fill(Arithmetic::<T>::splat(0.0));
        self.g.fill(Arithmetic::<T>::splat(0.0));
        self.sizes.fill(Arithmetic::<T>::splat(0.0));
    }
    /// Solves; `out` gets the accelerations, `self.lambda` basic multipliers.
    #[allow(clippy::too_many_arguments)]
    pub(crate) fn run(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        out: &mut [T],
    ) {
        let out = T::arithmetic_mut(out);
        Arithmetic::<T>::dispatch(Run { solution: self, structure, tree, frames, factors, load, out });
    }
    #[inline(always)]
    fn sweep(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        out: &mut [Arithmetic<T>],
    ) {
        for (term, g) in self.sizes.iter_mut().zip(&self.g) {
            *term = larger(*term, size(*g));
        }
        self.carried.fill((Motion::zero(), Arithmetic::<T>::splat(0.0)));
        // The ground comes last inward, and first outward.
        let ground = tree.len();
        for k in (0..ground).rev().chain([ground]) {
            for index in structure.stations[k].closes.clone() {
                self.take_carried(structure, frames, index);
                self.close(structure, factors, index, k);
            }
            if k == ground {
                break;
            }
            let body = &tree.bodies[k];
            match body.joint {
                Joint::Modes(i) => self.filter_modes(structure, factors, load, k, (i, body.v, body.nv)),
                _ => self.filter(structure, tree, frames, factors, load, k),
            }
            if body.parent != GROUND {
                let z = transform(&frames.poses[k]).wrench_to_parent(self.z[k]);
                self.z[body.parent] += z;
                if let Some(first) = structure.attached[k] {
                    let flexible = &tree.bodies[body.parent];
                    let modes = &mut self.z_modes[flexible.v - self.first_mode..][..flexible.nv];
                    for (sum, screw) in modes.iter_mut().zip(&frames.screws[first..]) {
                        *sum += motion(*screw).dot(z);
                    }
                }
            }
        }
        self.largest = Arithmetic::<T>::splat(0.0);
        let at_ground = Motion::new(Vec3::zero(), load.ground);
        for k in [ground].into_iter().chain(0..ground) {
            let mut alpha = at_ground;
            if k < ground {
                let body = &tree.bodies[k];
                let mut inboard = if body.parent == GROUND { at_ground } else { self.alpha[body.parent] };
                if let Some(first) = structure.attached[k] {
                    let flexible = &tree.bodies[body.parent];
                    let rates = &out[flexible.v..flexible.v + flexible.nv];
                    for (screw, x) in frames.screws[first..].iter().zip(rates) {
                        inboard += motion(*screw).scale(*x);
                    }
                }
                let inboard = transform(&frames.poses[k]).motion_to_child(inboard);
                match body.joint {
                    Joint::Modes(i) => {
                        self.smooth_modes(structure, factors, k, (i, body.v, body.nv), inboard, out);
                    }
                    _ => self.smooth(structure, tree, factors, load, k, inboard, out),
                }
                alpha = self.alpha[k];
            }
            for index in structure.stations[k].closes.clone().rev() {
                self.reopen(structure, factors, index, alpha);
            }
        }
        self.find_inconsistency(structure, frames, factors, load.ground);
    }
    /// A term of a row.
    #[inline(always)]
    fn note(&mut self, row: usize, term: Arithmetic<T>) {
        self.sizes[row] = larger(self.sizes[row], size(term));
    }
    /// The blocks that an operation takes, on `self.stack`; returns their rows.
    #[inline(always)]
    fn gather(&mut self, structure: &Structure<T>, factors: &Factors<T>, operation: &Operation) -> usize {
        let mut row = 0;
        for (b, _) in &operation.inputs {
            let (first, rows) = (structure.blocks[*b].row, factors.block_rows[*b]);
            self.stack[row..row + rows].copy_from_slice(&self.zeta[first..first + rows]);
            row += rows;
        }
        row
    }
    /// Q* of the stack, on `self.x`; the rows that remain go to the operation's block.
    #[inline(always)]
    fn turn(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        operation: &Operation,
        done: &Done<Arithmetic<T>>,
    ) {
        factors.record(operation, done).apply_transposed(&self.stack[..done.rows], &mut self.x);
        if let Some(output) = operation.output {
            let block = structure.blocks[output].row;
            self.zeta[block..block + done.left].copy_from_slice(&self.x[done.rank..done.rank + done.left]);
        }
    }
    /// g −= C_r a of all bodies of a loop.
    #[inline(always)]
    fn take_carried(&mut self, structure: &Structure<T>, frames: &Frames<T>, index: usize) {
        let Some(of) = structure.operations[index].closes else { return };
        let l = &structure.loops[of];
        if matches!(l.kind, LoopKind::Gear { .. }) {
            return;
        }
        let none = (Motion::zero(), Arithmetic::<T>::splat(0.0));
        let [(inner, a), (outer, b)] = l.strands.map(|strand| strand.map_or(none, |s| self.carried[s]));
        let (motion, term) = (frames.relative_motion(of, inner, outer), larger(a, b));
        for (i, row) in l.rows.clone().enumerate() {
            let weight = weight(structure, l, i).to_arithmetic();
            self.g[row] -= motion.dot(frames.row(of, i)) * weight;
            self.note(row, term);
        }
    }
    /// Closes a loop at body k: h, and what it adds to z and g.
    #[inline(always)]
    fn close(&mut self, structure: &Structure<T>, factors: &Factors<T>, index: usize, k: usize) {
        let (operation, done) = (&structure.operations[index], &factors.done[index]);
        let row = self.gather(structure, factors, operation);
        self.stack[row..done.rows].fill(Arithmetic::<T>::splat(0.0));
        self.turn(structure, factors, operation, done);
        let of = operation.closes.unwrap_or(0);
        let rows = structure.loops[of].rows.clone();
        let R = |t: usize, c: usize| factors.matrix[operation.number + t * operation.width + c];
        let pivots = &factors.pivots[operation.step..][..done.rank];
        let inverse = done.scale.recip();
        // h on the stack, which is free again.
        for t in 0..done.rank {
            let mut h = self.g[rows.start + pivots[t]] * inverse;
            for u in 0..t {
                h -= R(u, pivots[t]) * self.stack[u];
            }
            self.stack[t] = h / R(t, pivots[t]);
        }
        for c in 0..operation.closing {
            let mut lost = Arithmetic::<T>::splat(0.0);
            if !pivots.contains(&c) {
                lost = self.g[rows.start + c] * inverse;
                for t in 0..done.rank {
                    let term = R(t, c) * self.stack[t];
                    lost -= term;
                    self.note(rows.start + c, term * done.scale);
                }
            }
            self.lost[rows.start + c] = lost;
        }
        for t in 0..done.rank {
            let zeta = self.x[t] + self.stack[t];
            self.first[operation.row + t] = zeta;
            if k < self.z.len() {
                let x = factors.x_row(operation, t);
                self.z[k] = x.scale_add(zeta, self.z[k]);
            }
        }
        for &(other, first) in &operation.other_loops {
            for (i, row) in structure.loops[other].rows.clone().enumerate() {
                for t in 0..done.rank {
                    let term = R(t, operation.closing + first + i) * self.stack[t];
                    self.g[row] -= term;
                    self.note(row, term);
                }
            }
        }
    }
    /// Brings what a join takes to where the residuals of its joint are set.
    #[inline(always)]
    fn enter(&mut self, structure: &Structure<T>, factors: &Factors<T>, joined: Option<&Operation>) -> Own {
        match joined {
            Some(operation) if operation.in_place => Own::Block(appended(structure, factors, operation)),
            Some(operation) => Own::Stack(self.gather(structure, factors, operation)),
            None => Own::Nowhere,
        }
    }
    /// ζ of the i-th passive degree of freedom of a joint.
    #[inline(always)]
    fn set_residual(&mut self, own: Own, i: usize, zeta: Arithmetic<T>) {
        match own {
            Own::Block(row) => self.zeta[row + i] = zeta,
            Own::Stack(row) => self.stack[row + i] = zeta,
            Own::Nowhere => {}
        }
    }
    /// η of the i-th passive degree of freedom of a joint: what the loops demand.
    #[inline(always)]
    fn residual(&self, own: Own, i: usize) -> Arithmetic<T> {
        match own {
            Own::Block(row) => self.eta[row + i],
            Own::Stack(row) => self.stack[row + i],
            Own::Nowhere => Arithmetic::<T>::splat(0.0),
        }
    }
    /// The filter at the joint of body k.
    #[inline(always)]
    fn filter(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        k: usize,
    ) {
        let (body, station) = (&tree.bodies[k], &structure.stations[k]);
        let o = Arithmetic::<T>::splat(0.0);
        let hinge = body.hinge();
        let prescribed = |i: usize| load.prescribed.map_or(o, |a| a[body.v + i]);
        let is_active = |i: usize| factors.roots[body.v + i] == o;
        for i in (0..body.nv).filter(|&i| is_active(i)) {
            if let Some(hinge) = hinge {
                hinge.add_axis(i, prescribed(i), &mut self.a[k]);
            }
            for entry in station.entries.iter().filter(|e| e.component == i) {
                let l = &structure.loops[entry.of];
                let term = (entry.coefficient * weight(structure, l, 0)).to_arithmetic() * prescribed(i);
                self.g[l.rows.start] -= term;
                self.note(l.rows.start, term);
            }
        }
        let a = self.a[k];
        for &b in &station.waiting {
            let block = &structure.blocks[b];
            for i in 0..factors.block_rows[b] {
                self.zeta[block.row + i] += a.dot(factors.block_x[block.x + i]);
            }
        }
        let a_size = larger(most_of(a.angular) * Arithmetic::<T>::splat(structure.length), most_of(a.linear));
        for passing in &station.passes {
            let along = transform(&frames.along[passing.place]);
            let (sum, size) = &mut self.carried[passing.strand];
            *sum += along.motion_to_child(a);
            *size = larger(*size, a_size);
        }
        self.z[k] += factors.inertia[k].times(a);
        let joined = station.join.map(|index| &structure.operations[index]);
        let own = self.enter(structure, factors, joined);
        let mut passed = 0;
        for i in 0..body.nv {
            let Some(hinge) = hinge.filter(|_| !is_active(i)) else { continue };
            let tau = load.tau.map_or(o, |tau| tau[body.v + i]);
            let s = (tau - hinge.project(i, &self.z[k])) * factors.inverses[body.v + i];
            self.z[k] = factors.xi[body.v + i].scale_add(s, self.z[k]);
            self.s[body.v + i] = s;
            self.set_residual(own, passed, -s);
            passed += 1;
        }
        if passed == 6 {
            // A free joint hands on its own force exactly, whatever the size of z.
            self.z[k] = load.tau.map_or(Wrench::zero(), |tau| {
                let t = &tau[body.v..body.v + 6];
                Wrench::from_array([t[0], t[1], t[2], t[3], t[4], t[5]])
            });
        }
        if let Some(index) = station.join.filter(|&index| !structure.operations[index].in_place) {
            self.turn(structure, factors, &structure.operations[index], &factors.done[index]);
        }
    }
    /// Gives `self.x`, filled up to `row` and zero beyond, back to the blocks that an operation took.
    #[inline(always)]
    fn scatter(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        operation: &Operation,
        done: &Done<Arithmetic<T>>,
        row: usize,
    ) -> usize {
        self.x[row..done.rows].fill(Arithmetic::<T>::splat(0.0));
        factors.record(operation, done).apply(&mut self.x, &mut self.stack);
        let mut row = 0;
        for (b, _) in &operation.inputs {
            let (first, rows) = (structure.blocks[*b].row, factors.block_rows[*b]);
            self.eta[first..first + rows].copy_from_slice(&self.stack[row..row + rows]);
            row += rows;
        }
        row
    }
    /// Gives η of what leaves body k back to the blocks that its join took; returns where those of its own joint are.
    #[inline(always)]
    fn part(&mut self, structure: &Structure<T>, factors: &Factors<T>, k: usize) -> Own {
        let Some(index) = structure.stations[k].join else { return Own::Nowhere };
        let (operation, done) = (&structure.operations[index], &factors.done[index]);
        if operation.in_place {
            return Own::Block(appended(structure, factors, operation));
        }
        let output = operation.output.map_or(0, |b| structure.blocks[b].row);
        self.x[..done.left].copy_from_slice(&self.eta[output..output + done.left]);
        Own::Stack(self.scatter(structure, factors, operation, done, done.left))
    }
    /// The smoother at the joint of body k, whose parent gives it α⁺.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    fn smooth(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        k: usize,
        mut alpha: Motion<Arithmetic<T>>,
        out: &mut [Arithmetic<T>],
    ) {
        let body = &tree.bodies[k];
        let o = Arithmetic::<T>::splat(0.0);
        let own = self.part(structure, factors, k);
        let nv = body.nv;
        let mut passed = (0..nv).filter(|&i| factors.roots[body.v + i] != o).count();
        for i in (0..nv).rev() {
            let at = body.v + i;
            if factors.roots[at] == o {
                out[at] = load.prescribed.map_or(o, |a| a[at]);
                continue;
            }
            passed -= 1;
            out[at] =
                (self.residual(own, passed) - alpha.dot(factors.xi[at]) + self.s[at]) * factors.inverses[at];
            if let Some(hinge) = body.hinge() {
                hinge.add_axis(i, out[at], &mut alpha);
            }
        }
        self.alpha[k] = alpha + self.a[k];
    }
    /// Residuals and multipliers of a loop that was closed at a body with acceleration `alpha`.
    #[inline(always)]
    fn reopen(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        index: usize,
        alpha: Motion<Arithmetic<T>>,
    ) {
        let (operation, done) = (&structure.operations[index], &factors.done[index]);
        for t in 0..done.rank {
            self.x[t] = alpha.dot(factors.x_row(operation, t)) + self.first[operation.row + t];
            self.largest = larger(self.largest, size(self.x[t]));
        }
        self.substitute(structure, factors, index, true);
        let mut row = done.rank;
        if let Some(output) = operation.output {
            let block = structure.blocks[output].row;
            self.x[row..row + done.left].copy_from_slice(&self.eta[block..block + done.left]);
            row += done.left;
        }
        self.scatter(structure, factors, operation, done, row);
    }
    /// The redundant row that lacks most, measured by its terms, the largest residual of all loops and the largest acceleration.
    #[inline(always)]
    fn find_inconsistency(
        &mut self,
        structure: &Structure<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        ground: Vec3<Arithmetic<T>>,
    ) {
        self.inconsistency = None;
        if factors.redundant.is_empty() {
            return;
        }
        let length = Arithmetic::<T>::splat(structure.length);
        let mut fastest = most_of(ground);
        for alpha in &self.alpha {
            fastest = larger(fastest, length.fma(most_of(alpha.angular), most_of(alpha.linear)));
        }
        for &index in &structure.closings {
            let (operation, done) = (&structure.operations[index], &factors.done[index]);
            let of = operation.closes.unwrap_or(0);
            let start = structure.loops[of].rows.start;
            for row in 0..operation.closing {
                let lost = size(self.lost[start + row]).min_lane();
                let terms = larger(self.sizes[start + row], fastest) / done.scale;
                let size = larger(self.largest, terms).min_lane();
                // A row that is open by e cannot be more consistent than that.
                let allowed = 1e-9 + 10.0 * frames.errors[of];
                if lost > allowed * size {
                    let size = lost / size;
                    if self.inconsistency.is_none_or(|worst| worst.size < size) {
                        self.inconsistency = Some(Inconsistency { closure: of, row, size });
                    }
                }
            }
        }
    }
}

struct Run<'a, T: Real> {
    solution: &'a mut Solution<T>,
    structure: &'a Structure<T>,
    tree: &'a Tree<T>,
    frames: &'a Frames<T>,
    factors: &'a Factors<T>,
    load: &'a Load<'a, Arithmetic<T>>,
    out: &'a mut [Arithmetic<T>],
}

impl<T: Real> Kernel for Run<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Run { solution, structure, tree, frames, factors, load, out } = self;
        solution.sweep(structure, tree, frames, factors, load, out);
    }
}

/// The first row that a join in place appends to its block, among all blocks' rows.
#[inline(always)]
fn appended<T: Real>(structure: &Structure<T>, factors: &Factors<T>, operation: &Operation) -> usize {
    let first = operation.output.map_or(0, |b| structure.blocks[b].row);
    first + operation.inputs.first().map_or(0, |(b, _)| factors.block_rows[*b])
}

/// The largest component of a vector.
#[inline(always)]
fn most_of<S: Scalar>(x: Vec3<S>) -> S {
    let [x, y, z] = x.0;
    larger(larger(size(x), size(y)), size(z))
}
