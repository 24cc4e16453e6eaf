//! The smoother outward: residuals go back to where they came from, accelerations and multipliers follow.
//!
//! Symbols: those of [`super`].

use super::{Load, Own, Solution, appended};
use crate::compiled::Number;
use crate::factors::{Done, Factors};
use crate::number::{Arithmetic, larger, size};
use crate::structure::{Operation, Structure};
use crate::tree::Tree;
use phipsi_recursion::hinge::Hinge;
use phipsi_spatial::{Motion, Scalar};

impl<T: Number> Solution<T> {
    /// η of the i-th passive degree of freedom of a joint: what the loops demand.
    #[inline(always)]
    pub(super) fn residual(&self, own: Own, i: usize) -> Arithmetic<T> {
        match own {
            Own::Block(row) => self.eta[row + i],
            Own::Stack(row) => self.stack[row + i],
            Own::Nowhere => Arithmetic::<T>::splat(0.0),
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
    pub(super) fn part(&mut self, structure: &Structure<T>, factors: &Factors<T>, k: usize) -> Own {
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
    pub(super) fn smooth<const PLAIN: bool, const ASCENDING: bool>(
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
        let own = if PLAIN {
            self.residuals_plain(structure, tree, factors, k)
        } else {
            self.part(structure, factors, k)
        };
        match body.hinge() {
            Some(Hinge::Revolute) => {
                self.accelerate::<ASCENDING>(factors, load, body.v, &Hinge::Revolute, own, &mut alpha, out);
            }
            Some(Hinge::Prismatic) => {
                self.accelerate::<ASCENDING>(factors, load, body.v, &Hinge::Prismatic, own, &mut alpha, out);
            }
            Some(hinge) => self.accelerate::<ASCENDING>(factors, load, body.v, hinge, own, &mut alpha, out),
            None => {}
        }
        self.alpha[k] = alpha + self.a[k];
    }
    /// Accelerations of a joint whose degrees of freedom begin at `first`, added to that of its inboard side.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    fn accelerate<const ASCENDING: bool>(
        &self,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        first: usize,
        hinge: &Hinge<T>,
        own: Own,
        alpha: &mut Motion<Arithmetic<T>>,
        out: &mut [Arithmetic<T>],
    ) {
        let o = Arithmetic::<T>::splat(0.0);
        let dofs = first..first + hinge.nv();
        let mut passed = 0;
        for at in dofs.clone() {
            passed += usize::from(factors.roots[at] != o);
        }
        let last = dofs.end + dofs.start;
        for at in dofs {
            let at = if ASCENDING { at } else { last - 1 - at };
            if factors.roots[at] == o {
                out[at] = load.prescribed.map_or(o, |a| a[at]);
                continue;
            }
            passed -= 1;
            out[at] =
                (self.residual(own, passed) - alpha.dot(factors.xi[at]) + self.s[at]) * factors.inverses[at];
            hinge.add_axis(at - first, out[at], alpha);
        }
    }
    /// Residuals and multipliers of a loop that was closed at a body with acceleration `alpha`.
    #[inline(always)]
    pub(super) fn reopen<const PLAIN: bool>(
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
        if PLAIN {
            return;
        }
        let mut row = done.rank;
        if let Some(output) = operation.output {
            let block = structure.blocks[output].row;
            self.x[row..row + done.left].copy_from_slice(&self.eta[block..block + done.left]);
            row += done.left;
        }
        self.scatter(structure, factors, operation, done, row);
    }
}
