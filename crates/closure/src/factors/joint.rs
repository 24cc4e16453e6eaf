//! One joint of the factorisation: its degrees of freedom one after the other, and their rows in the front of its body.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | D | pivot of one degree of freedom, HPH* | 1 |
//! | Ξ | D^−½HP, row of the normalised residual on α⁺ | 6 |
//! | w | D^−½(HC* + E), row of the loops on the residual | m |

use super::{Done, Factors};
use crate::compiled::Number;
use crate::frames::{Frames, weight};
use crate::number::Arithmetic;
use crate::structure::{Operation, Passing, Station, Structure};
use crate::tree::{Joint, Tree, TreeBody};
use phipsi_recursion::hinge::Hinge;
use phipsi_recursion::layout::GROUND;
use phipsi_recursion::{DynamicsError, Layout};
use phipsi_spatial::{ArticulatedInertia, Scalar, Wrench};

impl<T: Number> Factors<T> {
    /// Eliminates the joint of a body, or modes; returns what it lets through, in the parent's frame, if there is one.
    #[inline(always)]
    pub(super) fn join<const PLAIN: bool>(
        &mut self,
        structure: &Structure<T>,
        (layout, tree): (&Layout<T>, &Tree<T>),
        frames: &Frames<T>,
        k: usize,
    ) -> Result<Option<ArticulatedInertia<Arithmetic<T>>>, DynamicsError> {
        let (body, station) = (&tree.bodies[k], &structure.stations[k]);
        let first = self.first_row::<PLAIN>(structure, k);
        if PLAIN {
            self.keep_plain(structure, k);
        }
        let mut rows = first;
        let mut P = self.inertia[k];
        // What is left of P after the joint, in the parent's frame: by the cheaper passage, where there is one.
        let mut moved = None;
        match &body.joint {
            Joint::Fixed => {}
            Joint::Modes(i) => {
                let singular = self.eliminate_modes(structure, frames, k, (*i, body.v), &mut P, rows);
                singular.map_err(|(l, D)| singular_at(layout, body.v + l, D))?;
                rows += body.nv;
            }
            Joint::Hinge(hinge) => {
                // Common kinds in copies of their own, in which they are constants.
                let passed = match hinge {
                    Hinge::Revolute => {
                        self.eliminate_axes::<PLAIN>(structure, body, &Hinge::Revolute, k, &mut P, first)
                    }
                    Hinge::Prismatic => {
                        self.eliminate_axes::<PLAIN>(structure, body, &Hinge::Prismatic, k, &mut P, first)
                    }
                    _ => self.eliminate_axes::<PLAIN>(structure, body, hinge, k, &mut P, first),
                };
                let passed = passed.map_err(|(i, D)| singular_at(layout, body.v + i, D))?;
                rows += passed;
                if passed == 1 && body.nv == 1 {
                    let xi = self.xi[body.v];
                    if body.parent != GROUND {
                        let gain = xi.scale(self.inverses[body.v]);
                        moved = body.eliminated_to_parent(&frames.shifts[k], &P, &gain);
                    }
                    if moved.is_none() {
                        P.subtract_outer(xi, xi);
                    }
                }
                if passed == 6 {
                    // What the subtractions leave is rounding: a free joint lets nothing through.
                    P = ArticulatedInertia::zero();
                    self.let_nothing_through(structure, k);
                }
            }
        }
        if let Some(index) = station.join.filter(|_| !PLAIN) {
            self.finish(structure, index, rows);
        }
        Ok(match moved {
            None if body.parent != GROUND => Some(frames.poses[k].articulated_to_parent(&P)),
            moved => moved,
        })
    }
    /// Brings what the join of body k takes to its place; returns the first row of its own.
    #[inline(always)]
    pub(crate) fn first_row<const PLAIN: bool>(&mut self, structure: &Structure<T>, k: usize) -> usize {
        match structure.stations[k].join.map(|index| &structure.operations[index]) {
            _ if PLAIN => 0,
            Some(operation) if operation.in_place => {
                operation.inputs.first().map_or(0, |(b, _)| self.block_rows[*b])
            }
            Some(operation) => self.stack(structure, operation, Arithmetic::<T>::splat(1.0)),
            None => 0,
        }
    }
    /// A degree of freedom whose acceleration is given.
    #[inline(always)]
    pub(crate) fn prescribe(&mut self, at: usize) {
        self.xi[at] = Wrench::zero();
        self.roots[at] = Arithmetic::<T>::splat(0.0);
        self.inverses[at] = Arithmetic::<T>::splat(0.0);
    }
    /// Takes Ξ and U of the i-th degree of freedom at body k as they were found elsewhere, and appends its row.
    #[inline(always)]
    pub(crate) fn eliminated(
        &mut self,
        structure: &Structure<T>,
        (k, at, i): (usize, usize, usize),
        hinge: &Hinge<T>,
        (xi, root): (Wrench<Arithmetic<T>>, Arithmetic<T>),
        row: usize,
    ) {
        let inverse = root.recip();
        (self.xi[at], self.roots[at], self.inverses[at]) = (xi, root, inverse);
        if let Some(operation) = structure.stations[k].join.map(|index| &structure.operations[index]) {
            self.append(structure, operation, k, i, hinge, xi, inverse, row);
        }
    }
    /// The end of a join whose `passed` degrees of freedom were found elsewhere.
    #[inline(always)]
    pub(crate) fn finish_join(&mut self, structure: &Structure<T>, k: usize, passed: usize, rows: usize) {
        if passed == 6 {
            self.let_nothing_through(structure, k);
        }
        if let Some(index) = structure.stations[k].join {
            self.finish(structure, index, rows);
        }
    }
    /// C = 0 inboard of a free joint.
    #[inline(always)]
    fn let_nothing_through(&mut self, structure: &Structure<T>, k: usize) {
        for passing in &structure.stations[k].passes {
            let strand = structure.strands[passing.strand];
            let m = structure.loops[passing.of].rows.len();
            self.c[strand.first..strand.first + m].fill(Wrench::zero());
        }
    }
    /// The error of a degree of freedom whose pivot failed.
    #[inline(never)]
    pub(crate) fn singular(&self, layout: &Layout<T>, at: usize, inertia: f64) -> DynamicsError {
        singular_at(layout, at, inertia)
    }
    /// Eliminates the passive axes of a joint one after the other, and appends their rows from `first` on; returns their number.
    /// P is left as it was for the passage of a joint of one axis.
    ///
    /// # Errors
    /// An axis whose pivot is not positive, and the pivot.
    #[inline(always)]
    fn eliminate_axes<const PLAIN: bool>(
        &mut self,
        structure: &Structure<T>,
        body: &TreeBody<T>,
        hinge: &Hinge<T>,
        k: usize,
        P: &mut ArticulatedInertia<Arithmetic<T>>,
        first: usize,
    ) -> Result<usize, (usize, f64)> {
        let mut passed = 0;
        for i in 0..hinge.nv() {
            let at = body.v + i;
            if !self.passive[at] {
                self.prescribe(at);
                continue;
            }
            let column = joint_column(P, hinge, i);
            let D = hinge.project(i, &column);
            if !D.is_positive() {
                return Err((i, D.min_lane()));
            }
            // One after the other they would take twice as long.
            let (root, reciprocal) = (D.sqrt(), D.recip());
            let inverse = root * reciprocal;
            let xi = column.scale(inverse);
            if hinge.nv() > 1 {
                P.subtract_outer(xi, xi);
            }
            (self.xi[at], self.roots[at], self.inverses[at]) = (xi, root, inverse);
            if let Some(operation) = structure.stations[k].join.map(|index| &structure.operations[index]) {
                if PLAIN {
                    self.append_plain(structure, k, i, hinge, xi, inverse);
                } else {
                    self.append(structure, operation, k, i, hinge, xi, inverse, first + passed);
                }
            }
            passed += 1;
        }
        Ok(passed)
    }
    /// Notes what a join did, and hands its block on if it was not made in place.
    #[inline(always)]
    fn finish(&mut self, structure: &Structure<T>, index: usize, rows: usize) {
        let operation = &structure.operations[index];
        self.sharp[index] = self.sharpness(operation);
        let scale = Arithmetic::<T>::splat(1.0);
        if operation.in_place {
            operation.output.into_iter().for_each(|b| self.block_rows[b] = rows);
            self.done[index] = Done { rows, rank: 0, steps: 0, left: rows, scale };
            return;
        }
        let width = operation.others;
        let (steps, left) = if rows > 2 * width {
            let mut panel = self.panel(operation, rows);
            panel.sort_rows(0, 0..width);
            let (steps, _) = panel.eliminate(0, 0..width, 0.0, width);
            (steps, steps)
        } else {
            self.panel(operation, rows);
            (0, rows)
        };
        self.done[index] = Done { rows, rank: 0, steps, left, scale };
        self.hand_on(structure, index, 0);
    }
    /// Appends the row of one degree of freedom to a join, and takes it out of C.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    fn append(
        &mut self,
        structure: &Structure<T>,
        operation: &Operation,
        k: usize,
        i: usize,
        hinge: &Hinge<T>,
        xi: Wrench<Arithmetic<T>>,
        inverse: Arithmetic<T>,
        row: usize,
    ) {
        let station = &structure.stations[k];
        let block = operation.output.map(|b| &structure.blocks[b]);
        if !operation.in_place {
            let first = operation.others;
            self.empty_row(operation, row)[first..first + 6].copy_from_slice(&xi.to_array());
        }
        for passing in &station.passes {
            for j in 0..structure.loops[passing.of].rows.len() {
                let w = self.take_out(structure, station, passing, j, (i, hinge), xi, inverse);
                match block {
                    Some(block) if operation.in_place => {
                        self.block_w[block.number + row * block.width + passing.column + j] = w;
                    }
                    _ => self.matrix[operation.number + row * operation.width + passing.column + j] = w,
                }
            }
        }
    }
    /// One row of a loop at one degree of freedom: w, which is taken out of C, and what it could be in any direction.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    pub(super) fn take_out(
        &mut self,
        structure: &Structure<T>,
        station: &Station<T>,
        passing: &Passing,
        j: usize,
        (i, hinge): (usize, &Hinge<T>),
        xi: Wrench<Arithmetic<T>>,
        inverse: Arithmetic<T>,
    ) -> Arithmetic<T> {
        let (strand, l) = (structure.strands[passing.strand], &structure.loops[passing.of]);
        let c = &mut self.c[strand.first + j];
        let mut along = hinge.project(i, c);
        let mut reach = lever::<T>(hinge, i, c);
        for entry in &station.entries {
            if entry.of == passing.of && entry.component == i {
                let weighted = (entry.coefficient * weight(structure, l, j)).to_arithmetic();
                along += weighted;
                reach += weighted * weighted;
            }
        }
        let w = along * inverse;
        *c -= xi.scale(w);
        self.squares[l.rows.start + j] += reach * (inverse * inverse);
        w
    }
}

/// The error of a degree of freedom whose pivot failed.
fn singular_at<T: Number>(layout: &Layout<T>, i: usize, inertia: f64) -> DynamicsError {
    let (joint, component) = layout.joint_of_velocity(i);
    DynamicsError::SingularHinge { joint: joint.to_string(), component, inertia }
}

/// P H*: a column of P, but for helical joints.
#[inline(always)]
fn joint_column<T: Number>(
    P: &ArticulatedInertia<Arithmetic<T>>,
    hinge: &Hinge<T>,
    i: usize,
) -> Wrench<Arithmetic<T>> {
    match hinge {
        Hinge::Helical { .. } => P.times(hinge.axis(i)),
        _ => P.column(hinge.components()[i]),
    }
}

/// |part of a row that the i-th axis of a joint turns or moves|²: what H C* could be in any direction.
#[inline(always)]
fn lever<T: Number>(hinge: &Hinge<T>, i: usize, c: &Wrench<Arithmetic<T>>) -> Arithmetic<T> {
    let (moment, force) = (c.moment.dot(c.moment), c.force.dot(c.force));
    match hinge {
        Hinge::Helical { pitch } => {
            let pitch = pitch.to_arithmetic();
            moment + pitch * pitch * force
        }
        _ if hinge.components()[i] < 3 => moment,
        _ => force,
    }
}
