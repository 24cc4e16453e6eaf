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
use crate::structure::{LoopKind, Operation, Structure};
use phipsi_recursion::Layout;
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Motion, Real, Vec3, Wrench};

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
pub(crate) struct Solution<T> {
    /// Bias forces and bias accelerations of the bodies: input.
    pub(crate) z: Vec<Wrench<T>>,
    pub(crate) a: Vec<Motion<T>>,
    /// Right-hand sides of the rows: input; and the size of their terms.
    pub(crate) g: Vec<T>,
    pub(crate) sizes: Vec<T>,
    s: Vec<T>,
    zeta: Vec<T>,
    eta: Vec<T>,
    /// ζ₁ + h of the closings.
    first: Vec<T>,
    /// What the redundant rows lack.
    lost: Vec<T>,
    stack: Vec<T>,
    x: Vec<T>,
    alpha: Vec<Motion<T>>,
    pub(crate) lambda: Vec<T>,
    /// Of conjugate gradients.
    direction: Vec<T>,
    gradient: Vec<T>,
    image: Vec<T>,
    /// The largest |η₁| of all loops.
    largest: T,
    pub(crate) inconsistency: Option<Inconsistency>,
}

/// What drives the mechanism besides z, a and g.
#[derive(Clone, Copy)]
pub(crate) struct Load<'a, T> {
    /// Generalised forces.
    pub(crate) tau: Option<&'a [T]>,
    /// Accelerations of the prescribed degrees of freedom.
    pub(crate) prescribed: Option<&'a [T]>,
    /// Acceleration of the ground.
    pub(crate) ground: Vec3<T>,
}

impl<T: Real> Solution<T> {
    pub(crate) fn new(structure: &Structure<T>, layout: &Layout<T>) -> Self {
        let o = T::zero();
        let most = structure.operations.iter().fold(0, |most, operation| most.max(operation.most));
        Solution {
            z: vec![Wrench::zero(); layout.len()],
            a: vec![Motion::zero(); layout.len()],
            g: vec![o; structure.rows],
            sizes: vec![o; structure.rows],
            s: vec![o; layout.nv()],
            zeta: vec![o; structure.block_rows],
            eta: vec![o; structure.block_rows],
            first: vec![o; structure.operation_rows],
            lost: vec![o; structure.rows],
            stack: vec![o; most],
            x: vec![o; most],
            alpha: vec![Motion::zero(); layout.len()],
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
        self.g.fill(T::zero());
        self.sizes.fill(T::zero());
    }
    /// Solves; `out` gets the accelerations, `self.lambda` basic multipliers.
    pub(crate) fn run(
        &mut self,
        structure: &Structure<T>,
        layout: &Layout<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        load: &Load<'_, T>,
        out: &mut [T],
    ) {
        for (size, g) in self.sizes.iter_mut().zip(&self.g) {
            *size = size.larger(g.abs());
        }
        for k in (0..layout.len()).rev() {
            for index in structure.stations[k].closes.clone() {
                self.close(structure, factors, index, k);
            }
            self.filter(structure, layout, factors, load, k);
            let parent = layout.bodies()[k].parent;
            if parent != GROUND {
                let z = frames.poses[k].wrench_to_parent(self.z[k]);
                self.z[parent] += z;
            }
        }
        let ground = layout.len();
        for index in structure.stations[ground].closes.clone() {
            self.close(structure, factors, index, ground);
        }
        self.largest = T::zero();
        let at_ground = Motion::new(Vec3::zero(), load.ground);
        for index in structure.stations[ground].closes.clone().rev() {
            self.reopen(structure, factors, index, at_ground);
        }
        for k in 0..layout.len() {
            let parent = layout.bodies()[k].parent;
            let inboard = if parent == GROUND { at_ground } else { self.alpha[parent] };
            self.smooth(structure, layout, factors, load, k, frames.poses[k].motion_to_child(inboard), out);
            for index in structure.stations[k].closes.clone().rev() {
                self.reopen(structure, factors, index, self.alpha[k]);
            }
        }
        self.find_inconsistency(structure, frames, factors, load.ground);
    }
    /// The blocks that an operation takes, on `self.stack`; returns their rows.
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
    fn turn(&mut self, structure: &Structure<T>, factors: &Factors<T>, operation: &Operation, done: &Done<T>) {
        factors.record(operation, done).apply_transposed(&self.stack[..done.rows], &mut self.x);
        if let Some(output) = operation.output {
            let block = structure.blocks[output].row;
            self.zeta[block..block + done.left]
                .copy_from_slice(&self.x[done.rank..done.rank + done.left]);
        }
    }
    /// Closes a loop at body k: h, and what it adds to z and g.
    fn close(&mut self, structure: &Structure<T>, factors: &Factors<T>, index: usize, k: usize) {
        let (operation, done) = (&structure.operations[index], &factors.done[index]);
        let row = self.gather(structure, factors, operation);
        self.stack[row..done.rows].fill(T::zero());
        self.turn(structure, factors, operation, done);
        let of = operation.closes.unwrap_or(0);
        let rows = structure.loops[of].rows.clone();
        let lead = operation.most;
        let R = |t: usize, c: usize| factors.matrix[operation.number + c * lead + t];
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
            let mut lost = T::zero();
            if !pivots.contains(&c) {
                lost = self.g[rows.start + c] * inverse;
                for t in 0..done.rank {
                    let term = R(t, c) * self.stack[t];
                    lost -= term;
                    self.sizes[rows.start + c] = self.sizes[rows.start + c].larger((term * done.scale).abs());
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
                    self.sizes[row] = self.sizes[row].larger(term.abs());
                }
            }
        }
    }
    /// The filter at the joint of body k.
    fn filter(
        &mut self,
        structure: &Structure<T>,
        layout: &Layout<T>,
        factors: &Factors<T>,
        load: &Load<'_, T>,
        k: usize,
    ) {
        let (body, station) = (&layout.bodies()[k], &structure.stations[k]);
        let o = T::zero();
        let prescribed = |i: usize| load.prescribed.map_or(o, |a| a[body.v + i]);
        let is_active = |i: usize| factors.roots[body.v + i] == o;
        for i in (0..body.hinge.nv()).filter(|&i| is_active(i)) {
            body.hinge.add_axis(i, prescribed(i), &mut self.a[k]);
            for entry in station.entries.iter().filter(|e| e.component == i) {
                let l = &structure.loops[entry.of];
                let term = entry.coefficient * weight(structure, l, 0) * prescribed(i);
                self.g[l.rows.start] -= term;
                self.sizes[l.rows.start] = self.sizes[l.rows.start].larger(term.abs());
            }
        }
        let a = self.a[k];
        for &b in &station.waiting {
            let first = structure.blocks[b].row;
            for row in first..first + factors.block_rows[b] {
                self.zeta[row] += a.dot(factors.block_x[row]);
            }
        }
        for passing in &station.passes {
            for (i, row) in structure.loops[passing.of].rows.clone().enumerate() {
                let term = a.dot(factors.kept[passing.kept + i]);
                self.g[row] -= term;
                self.sizes[row] = self.sizes[row].larger(term.abs());
            }
        }
        self.z[k] += factors.inertia[k].times(a);
        let rows = match station.join {
            Some(index) => self.gather(structure, factors, &structure.operations[index]),
            None => 0,
        };
        let mut passed = 0;
        for i in 0..body.hinge.nv() {
            if is_active(i) {
                continue;
            }
            let tau = load.tau.map_or(o, |tau| tau[body.v + i]);
            let s = (tau - body.hinge.project(i, &self.z[k])) / factors.roots[body.v + i];
            self.z[k] = factors.xi[body.v + i].scale_add(s, self.z[k]);
            self.s[body.v + i] = s;
            if station.join.is_some() {
                self.stack[rows + passed] = -s;
            }
            passed += 1;
        }
        if passed == 6 {
            // A free joint hands on its own force exactly, whatever the size of z.
            self.z[k] = load.tau.map_or(Wrench::zero(), |tau| {
                Wrench::from_array([0, 1, 2, 3, 4, 5].map(|i| tau[body.v + i]))
            });
        }
        if let Some(index) = station.join {
            self.turn(structure, factors, &structure.operations[index], &factors.done[index]);
        }
    }
    /// Gives `self.x`, filled up to `row` and zero beyond, back to the blocks that an operation took.
    fn scatter(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        operation: &Operation,
        done: &Done<T>,
        row: usize,
    ) -> usize {
        self.x[row..done.rows].fill(T::zero());
        factors.record(operation, done).apply(&mut self.x, &mut self.stack);
        let mut row = 0;
        for (b, _) in &operation.inputs {
            let (first, rows) = (structure.blocks[*b].row, factors.block_rows[*b]);
            self.eta[first..first + rows].copy_from_slice(&self.stack[row..row + rows]);
            row += rows;
        }
        row
    }
    /// The smoother at the joint of body k, whose parent gives it α⁺.
    #[allow(clippy::too_many_arguments)]
    fn smooth(
        &mut self,
        structure: &Structure<T>,
        layout: &Layout<T>,
        factors: &Factors<T>,
        load: &Load<'_, T>,
        k: usize,
        mut alpha: Motion<T>,
        out: &mut [T],
    ) {
        let body = &layout.bodies()[k];
        let o = T::zero();
        let mut xi_row = 0;
        if let Some(index) = structure.stations[k].join {
            let (operation, done) = (&structure.operations[index], &factors.done[index]);
            let output = operation.output.map_or(0, |b| structure.blocks[b].row);
            self.x[..done.left].copy_from_slice(&self.eta[output..output + done.left]);
            xi_row = self.scatter(structure, factors, operation, done, done.left);
        }
        let nv = body.hinge.nv();
        let mut passed = (0..nv).filter(|&i| factors.roots[body.v + i] != o).count();
        let joined = structure.stations[k].join.is_some();
        for i in (0..nv).rev() {
            let at = body.v + i;
            if factors.roots[at] == o {
                out[at] = load.prescribed.map_or(o, |a| a[at]);
                continue;
            }
            passed -= 1;
            let xi = if joined { self.stack[xi_row + passed] } else { o };
            out[at] = (xi - alpha.dot(factors.xi[at]) + self.s[at]) / factors.roots[at];
            body.hinge.add_axis(i, out[at], &mut alpha);
        }
        self.alpha[k] = alpha + self.a[k];
    }
    /// Residuals and multipliers of a loop that was closed at a body with acceleration `alpha`.
    fn reopen(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        index: usize,
        alpha: Motion<T>,
    ) {
        let (operation, done) = (&structure.operations[index], &factors.done[index]);
        for t in 0..done.rank {
            self.x[t] = alpha.dot(factors.x_row(operation, t)) + self.first[operation.row + t];
            self.largest = self.largest.larger(self.x[t].abs());
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
    fn find_inconsistency(
        &mut self,
        structure: &Structure<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        ground: Vec3<T>,
    ) {
        self.inconsistency = None;
        if factors.redundant.is_empty() {
            return;
        }
        let length = T::splat(structure.length);
        let most_of = |x: Vec3<T>| x.0[0].abs().larger(x.0[1].abs()).larger(x.0[2].abs());
        let size_of = |alpha: &Motion<T>| most_of(alpha.linear) + length * most_of(alpha.angular);
        let fastest = self.alpha.iter().fold(most_of(ground), |most, alpha| most.larger(size_of(alpha)));
        for &index in &structure.closings {
            let (operation, done) = (&structure.operations[index], &factors.done[index]);
            let of = operation.closes.unwrap_or(0);
            let start = structure.loops[of].rows.start;
            for row in 0..operation.closing {
                let lost = self.lost[start + row].abs();
                let size = self.largest.larger(self.sizes[start + row].larger(fastest) / done.scale);
                // A row that is open by e cannot be more consistent than that.
                let allowed = 1e-9 + 10.0 * frames.errors[of];
                if lost > T::splat(allowed) * size {
                    let size = (lost / size).to_f64();
                    if self.inconsistency.is_none_or(|worst| worst.size < size) {
                        self.inconsistency = Some(Inconsistency { closure: of, row, size });
                    }
                }
            }
        }
    }
    /// λ of one loop from those closed after it: R λ = η₁ − Σ W'_o λ_o with η₁ on `self.x`, redundant rows without force; or,
    /// not `driven`, with η₁ = 0 and the redundant rows' λ as they are.
    fn substitute(&mut self, structure: &Structure<T>, factors: &Factors<T>, index: usize, driven: bool) {
        let (operation, done) = (&structure.operations[index], &factors.done[index]);
        let start = operation.closes.map_or(0, |of| structure.loops[of].rows.start);
        let lead = operation.most;
        let R = |t: usize, c: usize| factors.matrix[operation.number + c * lead + t];
        let pivots = &factors.pivots[operation.step..][..done.rank];
        if driven {
            for c in (0..operation.closing).filter(|c| !pivots.contains(c)) {
                self.lambda[start + c] = T::zero();
            }
        }
        for t in (0..done.rank).rev() {
            let mut sum = if driven { self.x[t] } else { T::zero() };
            for &(other, first) in &operation.other_loops {
                for (i, row) in structure.loops[other].rows.clone().enumerate() {
                    sum -= R(t, operation.closing + first + i) * self.lambda[row];
                }
            }
            for c in 0..operation.closing {
                if !pivots[..t + 1].contains(&c) {
                    sum -= R(t, c) * self.lambda[start + c] * done.scale;
                }
            }
            self.lambda[start + pivots[t]] = sum / (R(t, pivots[t]) * done.scale);
        }
    }
    /// λ without its part in the null space of W: the multipliers of least norm. Conjugate gradients on the null vectors, one
    /// per redundant row.
    pub(crate) fn least_norm(&mut self, structure: &Structure<T>, factors: &Factors<T>) {
        if factors.redundant.is_empty() {
            return;
        }
        // image = what is left of λ; gradient = U* of it; direction in the places of the redundant rows.
        self.image.copy_from_slice(&self.lambda);
        // What one pass leaves through rounding, the next takes out.
        for _ in 0..3 {
            self.descend(structure, factors);
        }
        self.lambda.copy_from_slice(&self.image);
    }
    /// Conjugate gradients on |image − U x|², from x = 0.
    fn descend(&mut self, structure: &Structure<T>, factors: &Factors<T>) {
        let square = |x: &[T]| x.iter().fold(T::zero(), |sum, x| sum + *x * *x);
        self.project_null(structure, factors);
        let mut gamma = square(&self.gradient);
        self.direction.copy_from_slice(&self.gradient);
        for _ in 0..4 * factors.redundant.len() + 8 {
            if gamma == T::zero() {
                break;
            }
            // λ = U direction.
            for row in 0..structure.rows {
                self.lambda[row] = if factors.dropped[row] { self.direction[row] } else { T::zero() };
            }
            for &index in structure.closings.iter().rev() {
                self.substitute(structure, factors, index, false);
            }
            // |U x| ≥ |x|: the step is at most one.
            let step = gamma / square(&self.lambda);
            for row in 0..structure.rows {
                let change = step * self.lambda[row];
                self.image[row] -= change;
            }
            let change = step * step * square(&self.lambda);
            if change <= T::splat(T::EPSILON * T::EPSILON) * square(&self.image) {
                break;
            }
            self.project_null(structure, factors);
            let next = square(&self.gradient);
            // Where the gradient grows it was rounding: begin again.
            let ratio = if next < gamma { next / gamma } else { T::zero() };
            for row in 0..structure.rows {
                self.direction[row] = self.gradient[row] + ratio * self.direction[row];
            }
            gamma = next;
        }
    }
    /// gradient = U* image.
    fn project_null(&mut self, structure: &Structure<T>, factors: &Factors<T>) {
        self.gradient.copy_from_slice(&self.image);
        for &index in &structure.closings {
            let (operation, done) = (&structure.operations[index], &factors.done[index]);
            let start = operation.closes.map_or(0, |of| structure.loops[of].rows.start);
            let lead = operation.most;
            let R = |t: usize, c: usize| factors.matrix[operation.number + c * lead + t];
            let pivots = &factors.pivots[operation.step..][..done.rank];
            // R^−* of the kept rows, on the stack.
            for t in 0..done.rank {
                let mut x = self.gradient[start + pivots[t]];
                for u in 0..t {
                    x -= R(u, pivots[t]) * self.stack[u];
                }
                self.stack[t] = x / R(t, pivots[t]);
            }
            for c in 0..operation.closing {
                if pivots.contains(&c) {
                    continue;
                }
                for t in 0..done.rank {
                    let x = R(t, c) * self.stack[t];
                    self.gradient[start + c] -= x;
                }
            }
            let inverse = done.scale.recip();
            for &(other, first) in &operation.other_loops {
                for (i, row) in structure.loops[other].rows.clone().enumerate() {
                    for t in 0..done.rank {
                        let x = R(t, operation.closing + first + i) * self.stack[t] * inverse;
                        self.gradient[row] -= x;
                    }
                }
            }
            for t in 0..done.rank {
                self.gradient[start + pivots[t]] = T::zero();
            }
        }
    }
    /// Generalised force of the multipliers.
    pub(crate) fn constraint_force(
        &self,
        structure: &Structure<T>,
        layout: &Layout<T>,
        factors: &Factors<T>,
        out: &mut [T],
    ) {
        for (k, body) in layout.bodies().iter().enumerate() {
            let station = &structure.stations[k];
            let mut f = Wrench::zero();
            for passing in &station.passes {
                for (i, row) in structure.loops[passing.of].rows.clone().enumerate() {
                    f = factors.kept[passing.kept + i].scale_add(self.lambda[row], f);
                }
            }
            for i in 0..body.hinge.nv() {
                let mut force = body.hinge.project(i, &f);
                for entry in station.entries.iter().filter(|e| e.component == i) {
                    let l = &structure.loops[entry.of];
                    force += entry.coefficient * weight(structure, l, 0) * self.lambda[l.rows.start];
                }
                out[body.v + i] = force;
            }
        }
    }
    /// Multipliers in the units of their rows: moments of angular ones.
    pub(crate) fn multipliers(&self, structure: &Structure<T>, out: &mut [T]) {
        for l in &structure.loops {
            for (i, row) in l.rows.clone().enumerate() {
                let angular = match l.kind {
                    LoopKind::Gear { rotation, .. } => rotation,
                    LoopKind::Frames { .. } => i < l.angular,
                };
                let weight = if angular { T::splat(structure.length) } else { T::one() };
                out[row] = self.lambda[row] * weight;
            }
        }
    }
}
