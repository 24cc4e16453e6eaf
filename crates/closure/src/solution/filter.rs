//! The filter inward: what closes and joins make of a right-hand side.
//!
//! Symbols: those of [`super`].

use super::{Load, Own, Solution, appended, most_of};
use crate::compiled::Number;
use crate::factors::{Done, Factors};
use crate::frames::{Frames, weight};
use crate::number::{Arithmetic, larger, size};
use crate::structure::{LoopKind, Operation, Structure};
use crate::tree::Tree;
use phipsi_recursion::hinge::Hinge;
use phipsi_spatial::{Motion, Scalar, Wrench};

impl<T: Number> Solution<T> {
    /// A term of a row.
    #[inline(always)]
    pub(super) fn note(&mut self, row: usize, term: Arithmetic<T>) {
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
    pub(super) fn turn(
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
    pub(crate) fn take_carried(&mut self, structure: &Structure<T>, frames: &Frames<T>, index: usize) {
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
            self.g[row] -= frames.along_row((of, l), i, &motion) * weight;
            self.note(row, term);
        }
    }
    /// Closes a loop at body k: h, and what it adds to z and g.
    #[inline(always)]
    pub(crate) fn close<const PLAIN: bool>(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        index: usize,
        k: usize,
    ) {
        let (operation, done) = (&structure.operations[index], &factors.done[index]);
        if PLAIN {
            // Forces on the joints are in c already.
            self.x[..done.rank].fill(Arithmetic::<T>::splat(0.0));
        } else {
            let row = self.gather(structure, factors, operation);
            self.stack[row..done.rows].fill(Arithmetic::<T>::splat(0.0));
            self.turn(structure, factors, operation, done);
        }
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
    pub(super) fn enter(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        joined: Option<&Operation>,
    ) -> Own {
        match joined {
            Some(operation) if operation.in_place => Own::Block(appended(structure, factors, operation)),
            Some(operation) => Own::Stack(self.gather(structure, factors, operation)),
            None => Own::Nowhere,
        }
    }
    /// ζ of the i-th passive degree of freedom of a joint.
    #[inline(always)]
    pub(super) fn set_residual(&mut self, own: Own, i: usize, zeta: Arithmetic<T>) {
        match own {
            Own::Block(row) => self.zeta[row + i] = zeta,
            Own::Stack(row) => self.stack[row + i] = zeta,
            Own::Nowhere => {}
        }
    }
    /// The filter at the joint of body k.
    #[inline(always)]
    pub(super) fn filter<const PLAIN: bool>(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        k: usize,
    ) {
        let (body, station) = (&tree.bodies[k], &structure.stations[k]);
        let hinge = body.hinge();
        let a = self.carry::<PLAIN>(structure, tree, frames, factors, load, k);
        let joined = station.join.filter(|_| !PLAIN).map(|index| &structure.operations[index]);
        let own = self.enter(structure, factors, joined);
        let z = self.z[k] + factors.inertia[k].times(a);
        // Common kinds in copies of their own, in which they are constants.
        self.z[k] = match hinge {
            Some(Hinge::Revolute) => self.innovate(factors, load, body.v, &Hinge::Revolute, own, z),
            Some(Hinge::Prismatic) => self.innovate(factors, load, body.v, &Hinge::Prismatic, own, z),
            Some(hinge) => self.innovate(factors, load, body.v, hinge, own, z),
            None => z,
        };
        if PLAIN {
            self.innovate_plain(structure, tree, factors, k);
        } else if let Some(index) = station.join.filter(|&index| !structure.operations[index].in_place) {
            self.turn(structure, factors, &structure.operations[index], &factors.done[index]);
        }
    }
    /// Prescribed accelerations join a, and a goes into ζ, g and what strands carry; returns it.
    #[inline(always)]
    pub(crate) fn carry<const PLAIN: bool>(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        k: usize,
    ) -> Motion<Arithmetic<T>> {
        let (body, station) = (&tree.bodies[k], &structure.stations[k]);
        let hinge = body.hinge();
        if let Some(prescribed) = load.prescribed {
            for i in (0..body.nv).filter(|&i| !factors.is_passive(body.v + i)) {
                let acceleration = prescribed[body.v + i];
                if let Some(hinge) = hinge {
                    hinge.add_axis(i, acceleration, &mut self.a[k]);
                }
                for entry in station.entries.iter().filter(|e| e.component == i) {
                    let l = &structure.loops[entry.of];
                    let coefficient = (entry.coefficient * weight(structure, l, 0)).to_arithmetic();
                    let term = coefficient * acceleration;
                    self.g[l.rows.start] -= term;
                    self.note(l.rows.start, term);
                }
            }
        }
        let a = self.a[k];
        if PLAIN {
            self.carry_plain(structure, factors, k, a);
        }
        for &b in station.waiting.iter().filter(|_| !PLAIN) {
            let block = &structure.blocks[b];
            for i in 0..factors.block_rows[b] {
                self.zeta[block.row + i] += a.dot(factors.block_x[block.x + i]);
            }
        }
        let a_size = larger(most_of(a.angular) * Arithmetic::<T>::splat(structure.length), most_of(a.linear));
        for passing in station.passes.iter().filter(|_| !PLAIN) {
            let along = &frames.along[passing.place];
            let (sum, size) = &mut self.carried[passing.strand];
            *sum += along.motion_to_child(a);
            *size = larger(*size, a_size);
        }
        a
    }
    /// s of a degree of freedom that was eliminated elsewhere.
    #[inline(always)]
    pub(crate) fn set_innovation(&mut self, at: usize, s: Arithmetic<T>) {
        self.s[at] = s;
    }
    /// Brings s of the passive ones among some degrees of freedom of body k, in the order of their elimination, into its front.
    #[inline(always)]
    pub(crate) fn enter_innovations(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        k: usize,
        dofs: impl Iterator<Item = usize>,
    ) {
        let join = structure.stations[k].join;
        let own = self.enter(structure, factors, join.map(|index| &structure.operations[index]));
        for (passed, at) in dofs.filter(|&at| factors.is_passive(at)).enumerate() {
            self.set_residual(own, passed, -self.s[at]);
        }
        if let Some(index) = join.filter(|&index| !structure.operations[index].in_place) {
            self.turn(structure, factors, &structure.operations[index], &factors.done[index]);
        }
    }
    /// ζ₁ + h of a row of a closing.
    #[inline(always)]
    pub(crate) fn first(&self, operation: &Operation, row: usize) -> Arithmetic<T> {
        self.first[operation.row + row]
    }
    /// s and ζ of the passive axes of a joint whose degrees of freedom begin at `first`; returns what it hands on of z.
    #[inline(always)]
    fn innovate(
        &mut self,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        first: usize,
        hinge: &Hinge<T>,
        own: Own,
        mut z: Wrench<Arithmetic<T>>,
    ) -> Wrench<Arithmetic<T>> {
        let o = Arithmetic::<T>::splat(0.0);
        let mut passed = 0;
        for i in 0..hinge.nv() {
            let at = first + i;
            if factors.roots[at] == o {
                continue;
            }
            let tau = load.tau.map_or(o, |tau| tau[at]);
            let s = (tau - hinge.project(i, &z)) * factors.inverses[at];
            z = factors.xi[at].scale_add(s, z);
            self.s[at] = s;
            self.set_residual(own, passed, -s);
            passed += 1;
        }
        if passed < 6 {
            return z;
        }
        // A free joint hands on its own force exactly, whatever the size of z.
        load.tau.map_or(Wrench::zero(), |tau| {
            let t = &tau[first..first + 6];
            Wrench::from_array([t[0], t[1], t[2], t[3], t[4], t[5]])
        })
    }
}
