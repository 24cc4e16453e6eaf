//! Multipliers: outward substitution, least norm, and the generalised force.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | λ | multipliers: R λ = η₁ − Σ W'_o λ_o, the others' known, since loops open outward in the reverse order of closing | m |
//! | U | null vectors of W: for every redundant row one on it, −R⁻¹R₂ in its own loop, and what follows in those closed before | m×dropped |
//!
//! With redundant rows λ is determined but for U y. The least norm is |λ − U y|², by conjugate gradients: products with U are
//! outward substitutions, those with U* inward ones, so that no null vector is ever stored.

use super::Solution;
use crate::compiled::Number;
use crate::factors::Factors;
use crate::frames::{Frames, weight};
use crate::number::{Arithmetic, motion};
use crate::structure::{LoopKind, Structure};
use crate::tree::{Joint, Tree};
use phipsi_spatial::{Kernel, Scalar, Wrench};

impl<T: Number> Solution<T> {
    /// λ of one loop from those closed after it: R λ = η₁ − Σ W'_o λ_o with η₁ on `self.x`, redundant rows without force; or,
    /// not `driven`, with η₁ = 0 and the redundant rows' λ as they are.
    #[inline(always)]
    pub(super) fn substitute(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        index: usize,
        driven: bool,
    ) {
        let (operation, done) = (&structure.operations[index], &factors.done[index]);
        let start = operation.closes.map_or(0, |of| structure.loops[of].rows.start);
        let R = |t: usize, c: usize| factors.matrix[operation.number + t * operation.width + c];
        let pivots = &factors.pivots[operation.step..][..done.rank];
        if driven {
            for c in (0..operation.closing).filter(|c| !pivots.contains(c)) {
                self.lambda[start + c] = Arithmetic::<T>::splat(0.0);
            }
        }
        for t in (0..done.rank).rev() {
            let mut sum = if driven { self.x[t] } else { Arithmetic::<T>::splat(0.0) };
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
        T::least_norm(LeastNorm { solution: self, structure, factors });
    }
    #[inline(always)]
    fn take_out_null(&mut self, structure: &Structure<T>, factors: &Factors<T>) {
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
    #[inline(always)]
    fn descend(&mut self, structure: &Structure<T>, factors: &Factors<T>) {
        self.project_null(structure, factors);
        let mut gamma = square::<T>(&self.gradient);
        self.direction.copy_from_slice(&self.gradient);
        for _ in 0..4 * factors.redundant.len() + 8 {
            if gamma == Arithmetic::<T>::splat(0.0) {
                break;
            }
            // λ = U direction.
            for row in 0..structure.rows {
                self.lambda[row] =
                    if factors.dropped[row] { self.direction[row] } else { Arithmetic::<T>::splat(0.0) };
            }
            for &index in structure.closings.iter().rev() {
                self.substitute(structure, factors, index, false);
            }
            // |U x| ≥ |x|: the step is at most one.
            let step = gamma / square::<T>(&self.lambda);
            for row in 0..structure.rows {
                let change = step * self.lambda[row];
                self.image[row] -= change;
            }
            let change = step * step * square::<T>(&self.lambda);
            if change.min_lane() <= T::EPSILON * T::EPSILON * square::<T>(&self.image).min_lane() {
                break;
            }
            self.project_null(structure, factors);
            let next = square::<T>(&self.gradient);
            // Where the gradient grows it was rounding: begin again.
            let ratio =
                if next.min_lane() < gamma.min_lane() { next / gamma } else { Arithmetic::<T>::splat(0.0) };
            for row in 0..structure.rows {
                self.direction[row] = self.gradient[row] + ratio * self.direction[row];
            }
            gamma = next;
        }
    }
    /// gradient = U* image.
    #[inline(always)]
    fn project_null(&mut self, structure: &Structure<T>, factors: &Factors<T>) {
        self.gradient.copy_from_slice(&self.image);
        for &index in &structure.closings {
            let (operation, done) = (&structure.operations[index], &factors.done[index]);
            let start = operation.closes.map_or(0, |of| structure.loops[of].rows.start);
            let R = |t: usize, c: usize| factors.matrix[operation.number + t * operation.width + c];
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
                self.gradient[start + pivots[t]] = Arithmetic::<T>::splat(0.0);
            }
        }
    }
    /// Generalised force of the multipliers.
    pub(crate) fn constraint_force(
        &self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        frames: &Frames<T>,
        out: &mut [T],
    ) {
        let out = T::arithmetic_mut(out);
        T::constraint_force(ConstraintForce { solution: self, structure, tree, frames, out });
    }
    #[inline(always)]
    fn gather_force(
        &self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        frames: &Frames<T>,
        out: &mut [Arithmetic<T>],
    ) {
        out.fill(Arithmetic::<T>::splat(0.0));
        for (of, l) in structure.loops.iter().enumerate() {
            if matches!(l.kind, LoopKind::Gear { .. }) {
                continue;
            }
            for (side, strand) in l.strands.iter().enumerate() {
                let Some(strand) = strand.map(|s| &structure.strands[s]) else { continue };
                // The force on the end, moved inward body by body.
                let mut f = Wrench::zero();
                for (i, row) in l.rows.clone().enumerate() {
                    let c = frames.strand_row(structure, of, side, i);
                    f = c.scale_add(self.lambda[row], f);
                }
                let mut attached = l.attached[side];
                for &k in &structure.paths[strand.path..strand.path + strand.bodies] {
                    let body = &tree.bodies[k];
                    let out = &mut out[body.v..body.v + body.nv];
                    match &body.joint {
                        Joint::Fixed => {}
                        Joint::Hinge(hinge) => {
                            for (i, out) in out.iter_mut().enumerate() {
                                *out += hinge.project(i, &f);
                            }
                        }
                        Joint::Modes(_) => {
                            let screws = attached.map_or(&[][..], |first| &frames.screws[first..]);
                            for (out, Pi) in out.iter_mut().zip(screws) {
                                *out += motion(*Pi).dot(f);
                            }
                        }
                    }
                    f = frames.poses[k].wrench_to_parent(f);
                    attached = structure.attached[k];
                }
            }
        }
        for (station, body) in structure.stations.iter().zip(&tree.bodies) {
            for entry in &station.entries {
                let l = &structure.loops[entry.of];
                let coefficient = (entry.coefficient * weight(structure, l, 0)).to_arithmetic();
                out[body.v + entry.component] += coefficient * self.lambda[l.rows.start];
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
                out[row] = T::from_arithmetic(self.lambda[row]) * weight;
            }
        }
    }
}

pub(crate) struct LeastNorm<'a, T: Number> {
    solution: &'a mut Solution<T>,
    structure: &'a Structure<T>,
    factors: &'a Factors<T>,
}

impl<T: Number> Kernel for LeastNorm<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.solution.take_out_null(self.structure, self.factors);
    }
}

pub(crate) struct ConstraintForce<'a, T: Number> {
    solution: &'a Solution<T>,
    structure: &'a Structure<T>,
    tree: &'a Tree<T>,
    frames: &'a Frames<T>,
    out: &'a mut [Arithmetic<T>],
}

impl<T: Number> Kernel for ConstraintForce<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.solution.gather_force(self.structure, self.tree, self.frames, self.out);
    }
}

/// x*x.
#[inline(always)]
fn square<T: Number>(x: &[Arithmetic<T>]) -> Arithmetic<T> {
    let mut sum = Arithmetic::<T>::splat(0.0);
    for x in x {
        sum = x.fma(*x, sum);
    }
    sum
}
