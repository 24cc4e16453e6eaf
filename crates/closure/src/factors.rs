//! The factorisation: the articulated sweep with every loop closed at the body in which its branches meet.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | P | articulated inertia, from its ancestor inward with the loop in it | 6×6 | paper 1 (9.5), Gauss' principle |
//! | ξ | D^½θ̈ + D^−½(HP α⁺ − T + Hz), normalised residual of a joint: the cost is Σ ½ξ² | r | |
//! | U, Ξ | U*U = D = HPH*, Ξ = U^−*HP | r×r, r×6 | |
//! | W | rows of a loop on the residuals: D^−½HψB, unsquared | ρ×m | paper 2 (4.20) |
//! | X | what ξ would be if the subtree moved rigidly with its body | ρ×6 | |
//! | C_r, C | rows of a loop on the body's acceleration, rigidly and articulated: C = C_r − W*X | m×6 | |
//! | Q, R | W/s = Q [R; 0] at the ancestor, s the scale of the loop | | |
//! | w | U^−*(HC* + E), E the coefficients of couplings | r×m | |
//!
//! A loop reads W*(ξ − Xα − ζ) + C_r α = g on the body that its branches hang on. A rigid motion of the ancestor opens nothing:
//! there C_r = 0, and the loop is solved for part of the residuals: Q₁*ξ = X₁α + ζ₁ + R^−*g. Their cost, ½|X₁α + …|², is all
//! that remains of the loop above: P += X₁*X₁. X₁ is bounded however singular R is.
//!
//! One joint of r degrees of freedom is eliminated one after the other, as r hinges in one place; so are the modes of a flexible
//! body (`modes.rs`).

use crate::compiled::Number;
use crate::frames::Frames;
use crate::number::{Arithmetic, larger, size};
use crate::reflections::{Panel, Record};
use crate::structure::{Operation, Structure};
use crate::tree::{Joint, Tree};
use phipsi_recursion::{DynamicsError, Layout};
use phipsi_spatial::{ArticulatedInertia, Kernel, RigidInertia, Scalar, Wrench};
use std::ops::Range;

mod joint;
mod modes;
mod plain;

pub(crate) use plain::{Doubt, Plain};

/// A row that was found to be implied by others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Redundant {
    /// The closure, counted as closures, then couplings.
    pub closure: usize,
    /// The row of that closure.
    pub row: usize,
    /// Its pivot over the scale of its loop: what was taken for zero.
    pub pivot: f64,
}

/// How well the loops of a state are conditioned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rank {
    pub(crate) rank: usize,
    pub(crate) smallest: f64,
    pub(crate) gap: f64,
}

/// What was done in one operation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Done<T> {
    /// Stacked rows, steps on the closed loop, all steps, rows that remain.
    pub(crate) rows: usize,
    pub(crate) rank: usize,
    pub(crate) steps: usize,
    pub(crate) left: usize,
    /// s.
    pub(crate) scale: T,
}

/// Factors of a mechanism with loops at one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Factors<T: Scalar> {
    /// P of every body before its joint.
    pub(crate) inertia: Vec<ArticulatedInertia<Arithmetic<T>>>,
    /// Ξ and U's diagonal of every degree of freedom; U = 0 where it is prescribed.
    pub(crate) xi: Vec<Wrench<Arithmetic<T>>>,
    pub(crate) roots: Vec<Arithmetic<T>>,
    /// 1/U.
    pub(crate) inverses: Vec<Arithmetic<T>>,
    /// Modes of flexible bodies.
    pub(crate) modes: Vec<modes::Modes<Arithmetic<T>>>,
    /// C where the sweep is.
    c: Vec<Wrench<Arithmetic<T>>>,
    /// Size that the rows of W could have, squared.
    squares: Vec<Arithmetic<T>>,
    /// Rows, W and X of the blocks.
    pub(crate) block_rows: Vec<usize>,
    block_w: Vec<Arithmetic<T>>,
    pub(crate) block_x: Vec<Wrench<Arithmetic<T>>>,
    /// Matrices and records of the operations.
    pub(crate) matrix: Vec<Arithmetic<T>>,
    reflections: Vec<Arithmetic<T>>,
    order: Vec<usize>,
    beta: Vec<Arithmetic<T>>,
    pub(crate) pivots: Vec<usize>,
    pub(crate) done: Vec<Done<Arithmetic<T>>>,
    pub(crate) redundant: Vec<Redundant>,
    /// The redundant ones among all rows.
    pub(crate) dropped: Vec<bool>,
    pub(crate) rank: Rank,
    passive: Vec<bool>,
    /// The largest residual of all loops, at least that of the given numbers.
    error: f64,
    /// Relative error of the model's numbers.
    pub(crate) data_error: f64,
    /// The weakest pivot, at most one, of an operation and of those that its blocks come from.
    sharp: Vec<f64>,
    /// The operation that each block comes from.
    origin: Vec<usize>,
    /// The plain form, in whose place these factors may be.
    pub(crate) plain: Plain<T>,
    /// Room for eliminations.
    sums: Vec<Arithmetic<T>>,
    row_sizes: Vec<f64>,
}

/// What the rank of a loop is decided by.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Regard<T> {
    /// Rows whose pivot the closure error could have made are redundant.
    Error,
    /// The same during projection onto the closures, where the error is large at first and known to vanish.
    Projection,
    /// No row is redundant: every row may be missed, at the cost of √μ.
    Slack(T),
}

impl<T: Number> Factors<T> {
    pub(crate) fn new(structure: &Structure<T>, layout: &Layout<T>, tree: &Tree<T>) -> Self {
        let zero = Wrench::zero();
        let most = structure
            .operations
            .iter()
            .fold((0, 0), |(rows, width), o| (o.most.max(rows), o.width.max(width)));
        let empty = Done { rows: 0, rank: 0, steps: 0, left: 0, scale: Arithmetic::<T>::splat(1.0) };
        Factors {
            inertia: vec![ArticulatedInertia::zero(); tree.len()],
            modes: layout.held_bodies().iter().map(|held| modes::Modes::new(held.modes())).collect(),
            xi: vec![zero; layout.nv()],
            roots: vec![Arithmetic::<T>::splat(0.0); layout.nv()],
            inverses: vec![Arithmetic::<T>::splat(0.0); layout.nv()],
            c: vec![zero; structure.strand_rows],
            squares: vec![Arithmetic::<T>::splat(0.0); structure.rows],
            block_rows: vec![0; structure.blocks.len()],
            block_w: vec![Arithmetic::<T>::splat(0.0); structure.block_numbers],
            block_x: vec![zero; structure.block_x],
            matrix: vec![Arithmetic::<T>::splat(0.0); structure.operation_numbers],
            reflections: vec![Arithmetic::<T>::splat(0.0); structure.reflections],
            order: vec![0; structure.operation_rows],
            beta: vec![Arithmetic::<T>::splat(0.0); structure.operation_steps],
            pivots: vec![usize::MAX; structure.operation_steps],
            done: vec![empty; structure.operations.len()],
            redundant: Vec::with_capacity(structure.rows),
            dropped: vec![false; structure.rows],
            rank: Rank { rank: 0, smallest: f64::INFINITY, gap: f64::INFINITY },
            passive: vec![true; layout.nv()],
            error: 0.0,
            data_error: 0.0,
            sharp: vec![1.0; structure.operations.len()],
            origin: origins(structure),
            plain: Plain::none(),
            sums: vec![Arithmetic::<T>::splat(0.0); most.1],
            row_sizes: vec![0.0; most.0],
        }
    }
    /// Factors at the poses of `frames`; `active`: the prescribed degrees of freedom, none if missing.
    pub(crate) fn update(
        &mut self,
        structure: &Structure<T>,
        (layout, tree): (&Layout<T>, &Tree<T>),
        frames: &Frames<T>,
        active: Option<&[bool]>,
        regard: Regard<T>,
    ) -> Result<(), DynamicsError> {
        self.plain.used = false;
        T::update(Update { factors: self, structure, layout, tree, frames, active, regard })
    }
    /// The same in the plain form, for which there must be room; the doubt on which it was given up, if there is one.
    pub(crate) fn update_plain(
        &mut self,
        structure: &Structure<T>,
        (layout, tree): (&Layout<T>, &Tree<T>),
        frames: &Frames<T>,
        active: Option<&[bool]>,
    ) -> Result<Option<Doubt>, DynamicsError> {
        self.plain.used = true;
        let regard = Regard::Error;
        T::update(Update { factors: self, structure, layout, tree, frames, active, regard })?;
        Ok(self.plain.doubt)
    }
    #[inline(always)]
    fn sweep<const PLAIN: bool>(
        &mut self,
        structure: &Structure<T>,
        (layout, tree): (&Layout<T>, &Tree<T>),
        frames: &Frames<T>,
        active: Option<&[bool]>,
        regard: Regard<T>,
    ) -> Result<(), DynamicsError> {
        self.clear(tree, frames, active);
        if PLAIN {
            self.clear_plain(structure);
        }
        // The ground comes last.
        let ground = tree.len();
        for k in (0..ground).rev().chain([ground]) {
            self.begin(structure, frames, k);
            for operation in structure.stations[k].closes.clone() {
                if PLAIN {
                    self.close_plain(structure, frames, operation, k);
                    if self.plain.doubt.is_some() {
                        return Ok(());
                    }
                } else {
                    self.close(structure, operation, k, regard);
                }
            }
            if k == ground {
                break;
            }
            let moved = self.join::<PLAIN>(structure, (layout, tree), frames, k)?;
            let body = &tree.bodies[k];
            if PLAIN {
                self.shift_plain(structure, frames, k);
            } else {
                self.shift(structure, frames, k, body.v..body.v + body.nv);
            }
            if let Some(moved) = moved {
                self.inertia[body.parent] = self.inertia[body.parent] + moved;
                if let (Some((i, _)), Some(first)) = (body.on, structure.attached[k]) {
                    self.modes[i].add(&frames.screws[first..], &moved);
                }
            }
        }
        Ok(())
    }
    /// Before a sweep: no rows, own inertias, which degrees of freedom are passive, and the largest residual.
    #[inline(always)]
    pub(crate) fn clear(&mut self, tree: &Tree<T>, frames: &Frames<T>, active: Option<&[bool]>) {
        for (i, passive) in self.passive.iter_mut().enumerate() {
            *passive = active.is_none_or(|active| !active[i]);
        }
        for (P, body) in self.inertia.iter_mut().zip(&tree.bodies) {
            *P = match body.joint {
                Joint::Modes(i) => self.modes[i].begin(&frames.held[i]),
                _ => RigidInertia::constant(&body.inertia).to_articulated(),
            };
        }
        self.squares.fill(Arithmetic::<T>::splat(0.0));
        // Couplings begin with nothing.
        self.c.fill(Wrench::zero());
        self.redundant.clear();
        self.dropped.fill(false);
        self.rank = Rank { rank: 0, smallest: f64::INFINITY, gap: f64::INFINITY };
        self.error = frames.errors.iter().fold(self.data_error, |most: f64, e| most.max(*e));
    }
    /// C = C_r of the strands that begin on a body.
    #[inline(always)]
    pub(crate) fn begin(&mut self, structure: &Structure<T>, frames: &Frames<T>, k: usize) {
        for &s in &structure.stations[k].begins {
            let strand = structure.strands[s];
            let side = usize::from(structure.loops[strand.of].strands[1] == Some(s));
            for i in 0..structure.loops[strand.of].rows.len() {
                self.c[strand.first + i] = frames.strand_row(structure, strand.of, side, i);
            }
        }
    }
    /// Puts blocks into the matrix of an operation: columns of the closed loop, of the others, of X. Returns the rows.
    #[inline(always)]
    fn stack(&mut self, structure: &Structure<T>, operation: &Operation, scale: Arithmetic<T>) -> usize {
        match operation.width {
            12 => self.stack_known::<12>(structure, operation, scale),
            16 => self.stack_known::<16>(structure, operation, scale),
            _ => self.stack_known::<0>(structure, operation, scale),
        }
    }
    /// The same for rows of W numbers; of any number with W = 0.
    #[inline(always)]
    fn stack_known<const W: usize>(
        &mut self,
        structure: &Structure<T>,
        operation: &Operation,
        scale: Arithmetic<T>,
    ) -> usize {
        let (closing, columns) = (operation.closing, operation.closing + operation.others);
        let width = if W == 0 { operation.width } else { W };
        let matrix = &mut self.matrix[operation.number..][..operation.most * width];
        let mut rows = matrix.chunks_exact_mut(width);
        let mut row = 0;
        for (b, map) in &operation.inputs {
            let block = &structure.blocks[*b];
            for i in 0..self.block_rows[*b] {
                let Some(to) = rows.next() else { return row };
                to.fill(Arithmetic::<T>::splat(0.0));
                let w = &self.block_w[block.number + i * block.width..][..block.width];
                for (x, &column) in w.iter().zip(map) {
                    to[column] = if column < closing { *x * scale } else { *x };
                }
                to[columns..columns + 6].copy_from_slice(&self.block_x[block.x + i].to_array());
                row += 1;
            }
        }
        row
    }
    /// One more row of a matrix, all zero.
    #[inline(always)]
    fn empty_row(&mut self, operation: &Operation, row: usize) -> &mut [Arithmetic<T>] {
        let row = &mut self.matrix[operation.number + row * operation.width..][..operation.width];
        row.fill(Arithmetic::<T>::splat(0.0));
        row
    }
    /// Closes the loop of an operation at body k, or at the ground.
    #[inline(always)]
    pub(crate) fn close(&mut self, structure: &Structure<T>, index: usize, k: usize, regard: Regard<T>) {
        let operation = &structure.operations[index];
        let of = operation.closes.unwrap_or(0);
        let scale = self.scale(structure.loops[of].rows.clone());
        let mut rows = self.stack(structure, operation, scale.recip());
        let (m, others, width) = (operation.closing, operation.others, operation.width);
        if let Regard::Slack(slack) = regard {
            for i in 0..m {
                self.empty_row(operation, rows + i)[i] = slack.to_arithmetic();
            }
            rows += m;
        }
        // Of all loops: those that were closed before hand their errors on.
        let error = self.error;
        // Rounding of rows that a weak pivot was taken out of: ε over that pivot at worst, over its root as a rule.
        let sharpness = self.sharpness(operation);
        let margin = match regard {
            Regard::Error => 10.0 * error,
            Regard::Projection if error > 1e-3 => 0.1 * error,
            Regard::Projection => 10.0 * error,
            Regard::Slack(_) => 0.0,
        };
        let tolerance = match regard {
            Regard::Slack(_) => 0.0,
            _ => 64.0 * T::EPSILON * (rows as f64 / sharpness).sqrt() + margin,
        };
        let mut panel = self.panel(operation, rows);
        panel.sort_rows(0, 0..m);
        let (rank, dropped) = panel.eliminate(0, 0..m, tolerance, m);
        let left = rows - rank;
        let (steps, left) = if others == 0 {
            (rank, 0)
        } else if left > others {
            panel.sort_rows(rank, m..m + others);
            let (steps, _) = panel.eliminate(rank, m..m + others, 0.0, others);
            (steps, steps - rank)
        } else {
            (rank, left)
        };
        self.done[index] = Done { rows, rank, steps, left, scale };
        self.sharp[index] = (0..rank).fold(sharpness, |least, t| {
            let column = self.pivots[operation.step + t];
            least.min(size(self.matrix[operation.number + t * width + column]).min_lane())
        });
        self.judge(structure, operation, rows, rank, dropped);
        self.condense(operation, k, rank);
        self.hand_on(structure, index, rank);
    }
    /// s of the rows of a loop.
    #[inline(always)]
    fn scale(&self, rows: Range<usize>) -> Arithmetic<T> {
        let mut square = Arithmetic::<T>::splat(0.0);
        for x in &self.squares[rows] {
            square = larger(square, *x);
        }
        if square.is_positive() { square.sqrt() } else { Arithmetic::<T>::splat(1.0) }
    }
    /// What is left of a closed loop at body k: P += X₁*X₁, C_o += W'_o*X₁.
    #[inline(always)]
    fn condense(&mut self, operation: &Operation, k: usize, rank: usize) {
        let (m, width) = (operation.closing, operation.width);
        for t in 0..rank {
            let x = self.x_row(operation, t);
            if k < self.inertia.len() {
                self.inertia[k].add_outer(x, Arithmetic::<T>::splat(1.0));
            }
            // Of the loops that stay open here.
            for &(first, column, rows) in &operation.held {
                for i in 0..rows {
                    let w = self.matrix[operation.number + t * width + m + column + i];
                    let c = &mut self.c[first + i];
                    *c = x.scale_add(w, *c);
                }
            }
        }
    }
    /// The weakest pivot of the operations that an operation's blocks come from.
    #[inline(always)]
    fn sharpness(&self, operation: &Operation) -> f64 {
        operation.inputs.iter().fold(1.0, |least, (b, _)| least.min(self.sharp[self.origin[*b]]))
    }
    /// Notes rank, redundant rows and pivots of a closed loop.
    #[inline(always)]
    fn judge(
        &mut self,
        structure: &Structure<T>,
        operation: &Operation,
        rows: usize,
        rank: usize,
        dropped: f64,
    ) {
        let m = operation.closing;
        let kept = &self.pivots[operation.step..][..rank];
        let diagonal =
            |t: usize| size(self.matrix[operation.number + t * operation.width + kept[t]]).min_lane();
        let smallest = (0..rank).map(diagonal).fold(f64::INFINITY, f64::min);
        self.rank.rank += rank;
        self.rank.smallest = self.rank.smallest.min(smallest);
        if rank < m && rank > 0 && dropped > 0.0 {
            self.rank.gap = self.rank.gap.min(smallest / dropped);
        }
        for column in 0..m {
            if !kept.contains(&column) && self.redundant.len() < structure.rows {
                let closure = operation.closes.unwrap_or(0);
                let rest = (rank..rows).map(|t| self.matrix[operation.number + t * operation.width + column]);
                // Later steps have turned the rest, but not made it longer.
                let pivot = rest.fold(0.0f64, |most, x| most.max(size(x).min_lane()));
                self.dropped[structure.loops[closure].rows.start + column] = true;
                self.redundant.push(Redundant { closure, row: column, pivot });
            }
        }
    }
    /// The block that an operation leaves: rows from `first` on, what the steps left in them.
    #[inline(always)]
    fn hand_on(&mut self, structure: &Structure<T>, index: usize, first: usize) {
        let operation = &structure.operations[index];
        let Some(output) = operation.output else { return };
        let block = &structure.blocks[output];
        let done = self.done[index];
        self.block_rows[output] = done.left;
        for i in 0..done.left {
            let row = &self.matrix[operation.number + (first + i) * operation.width..][operation.closing..];
            self.block_w[block.number + i * block.width..][..block.width]
                .copy_from_slice(&row[..block.width]);
            self.block_x[block.x + i] = self.x_row(operation, first + i);
        }
    }
    /// Moves what leaves a body to its parent's frame.
    #[inline(always)]
    pub(crate) fn shift(
        &mut self,
        structure: &Structure<T>,
        frames: &Frames<T>,
        k: usize,
        dofs: impl Iterator<Item = usize>,
    ) {
        let (station, pose) = (&structure.stations[k], &frames.poses[k]);
        for passing in station.passes.iter().filter(|p| !p.last) {
            let strand = structure.strands[passing.strand];
            let m = structure.loops[passing.of].rows.len();
            for i in strand.first..strand.first + m {
                self.c[i] = pose.wrench_to_parent(self.c[i]);
            }
        }
        let Some(operation) = station.join.map(|index| &structure.operations[index]) else { return };
        let Some(output) = operation.output else { return };
        let to = structure.blocks[output].x;
        if !operation.in_place {
            for x in &mut self.block_x[to..to + self.block_rows[output]] {
                *x = pose.wrench_to_parent(*x);
            }
            return;
        }
        let mut row = 0;
        if let Some((input, _)) = operation.inputs.first() {
            let from = structure.blocks[*input].x;
            row = self.block_rows[*input];
            for i in 0..row {
                self.block_x[to + i] = pose.wrench_to_parent(self.block_x[from + i]);
            }
        }
        for at in dofs {
            if self.passive[at] {
                self.block_x[to + row] = pose.wrench_to_parent(self.xi[at]);
                row += 1;
            }
        }
    }
    /// False if a degree of freedom is prescribed.
    #[inline(always)]
    pub(crate) fn is_passive(&self, i: usize) -> bool {
        self.passive[i]
    }
    /// Row of X in the matrix of an operation.
    #[inline(always)]
    pub(crate) fn x_row(&self, operation: &Operation, row: usize) -> Wrench<Arithmetic<T>> {
        let columns = operation.closing + operation.others;
        let x = &self.matrix[operation.number + row * operation.width + columns..][..6];
        Wrench::from_array([x[0], x[1], x[2], x[3], x[4], x[5]])
    }
    #[inline(always)]
    fn panel(&mut self, operation: &Operation, rows: usize) -> Panel<'_, Arithmetic<T>> {
        let columns = operation.closing + operation.others;
        let order = &mut self.order[operation.row..][..operation.most];
        for (i, o) in order.iter_mut().enumerate() {
            *o = i;
        }
        let pivots = &mut self.pivots[operation.step..][..columns];
        pivots.fill(usize::MAX);
        Panel {
            a: &mut self.matrix[operation.number..][..operation.most * operation.width],
            width: operation.width,
            rows,
            order,
            v: &mut self.reflections[operation.reflection..][..operation.most * columns.min(operation.most)],
            most: operation.most,
            beta: &mut self.beta[operation.step..][..columns],
            pivots,
            squares: &mut self.sums,
            sizes: &mut self.row_sizes,
        }
    }
    /// What an operation did, to do it to vectors.
    #[inline(always)]
    pub(crate) fn record(
        &self,
        operation: &Operation,
        done: &Done<Arithmetic<T>>,
    ) -> Record<'_, Arithmetic<T>> {
        let columns = operation.closing + operation.others;
        Record {
            v: &self.reflections[operation.reflection..][..operation.most * columns.min(operation.most)],
            most: operation.most,
            rows: done.rows,
            steps: done.steps,
            order: &self.order[operation.row..][..operation.most],
            beta: &self.beta[operation.step..][..columns],
        }
    }
}

/// The operation that each block comes from.
fn origins<T>(structure: &Structure<T>) -> Vec<usize> {
    let mut origins = vec![0; structure.blocks.len()];
    for (i, operation) in structure.operations.iter().enumerate() {
        operation.output.into_iter().for_each(|b| origins[b] = i);
    }
    origins
}

pub(crate) struct Update<'a, T: Number> {
    factors: &'a mut Factors<T>,
    structure: &'a Structure<T>,
    layout: &'a Layout<T>,
    tree: &'a Tree<T>,
    frames: &'a Frames<T>,
    active: Option<&'a [bool]>,
    regard: Regard<T>,
}

impl<T: Number> Kernel for Update<'_, T> {
    type Output = Result<(), DynamicsError>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let Update { factors, structure, layout, tree, frames, active, regard } = self;
        if factors.plain.used {
            factors.sweep::<true>(structure, (layout, tree), frames, active, regard)
        } else {
            factors.sweep::<false>(structure, (layout, tree), frames, active, regard)
        }
    }
}
