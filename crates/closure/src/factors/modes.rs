//! The modes of a flexible body in the factorisation: a joint whose axes are the modes.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | Π | of what is attached: motion by the rates of the modes, hinge frame | 6×n |
//! | D_M, P_ed, P | of the body and all on it: M′ + Σ [Π, 1]* P_t [Π, 1] | n×n, n×6, 6×6 |
//! | L | L L* = D_M | n×n |
//! | Ξ | L⁻¹P_ed, rows of the normalised residuals ξ = L*η̈ + Ξα − L⁻¹(τ − z) on the acceleration of the hinge frame | n×6 |
//! | C_e | C Π: a loop on the modes, summed over its strands where both meet on the body | m×n |
//! | w | L⁻¹C_e*, row of the loop on ξ | n×m |

use super::Factors;
use crate::compiled::Number;
use crate::frames::Frames;
use crate::number::{Arithmetic, motion, wrench};
use crate::structure::Structure;
use phipsi_recursion::flexible::HeldBody;
use phipsi_spatial::{ArticulatedInertia, Motion, Scalar, Sym3, Vec3, Wrench};

/// Inertia of the modes of one body, and its factor.
#[derive(Clone, Debug)]
pub(crate) struct Modes<S> {
    /// D_M before, L after; lower triangle by rows.
    pub(crate) L: Vec<S>,
    /// P_ed by rows.
    W: Vec<Wrench<S>>,
}

impl<S: Scalar> Modes<S> {
    pub(super) fn new(n: usize) -> Self {
        Modes { L: vec![S::zero(); n * n], W: vec![Wrench::zero(); n] }
    }
    /// M′; returns the block of the hinge frame.
    #[inline(always)]
    pub(super) fn begin<T: Number<Arithmetic = S>>(&mut self, held: &HeldBody<T>) -> ArticulatedInertia<S> {
        let (ee, ed, dd) = held.mass();
        self.L.copy_from_slice(T::arithmetic(ee));
        for (to, from) in self.W.iter_mut().zip(ed) {
            *to = wrench(*from);
        }
        inertia::<T>(dd)
    }
    /// Adds [Π, 1]* P [Π, 1] of something attached but its block of the hinge frame.
    #[inline(always)]
    pub(super) fn add<T: Number<Arithmetic = S>>(&mut self, screws: &[Motion<T>], P: &ArticulatedInertia<S>) {
        let n = self.W.len();
        for l in 0..n {
            let moved = P.times(motion(screws[l]));
            for m in 0..=l {
                self.L[l * n + m] += motion(screws[m]).dot(moved);
            }
            self.W[l] += moved;
        }
    }
}

/// An articulated inertia to compute with.
#[inline(always)]
fn inertia<T: Number>(P: &ArticulatedInertia<T>) -> ArticulatedInertia<Arithmetic<T>> {
    let symmetric = |m: &Sym3<T>| {
        let [xx, xy, xz, yy, yz, zz] = [m.xx, m.xy, m.xz, m.yy, m.yz, m.zz].map(T::to_arithmetic);
        Sym3 { xx, xy, xz, yy, yz, zz }
    };
    let rows = P.coupling.0.map(|row| Vec3(row.map(T::to_arithmetic)).0);
    ArticulatedInertia {
        inertia: symmetric(&P.inertia),
        coupling: phipsi_spatial::Mat3(rows),
        mass: symmetric(&P.mass),
    }
}

impl<T: Number> Factors<T> {
    /// Eliminates the modes of flexible body `i`, with degrees of freedom from `v` on, at their station; appends their rows from
    /// `row` on. P: the block of the hinge frame before, what the modes let through after.
    ///
    /// # Errors
    /// A mode whose pivot is not positive, and the pivot.
    #[inline(always)]
    pub(super) fn eliminate_modes(
        &mut self,
        structure: &Structure<T>,
        frames: &Frames<T>,
        k: usize,
        (i, v): (usize, usize),
        P: &mut ArticulatedInertia<Arithmetic<T>>,
        row: usize,
    ) -> Result<(), (usize, f64)> {
        let Modes { L, W } = &mut self.modes[i];
        let n = W.len();
        for l in 0..n {
            let mut xi = W[l];
            for m in 0..l {
                let mut sum = L[l * n + m];
                for j in 0..m {
                    sum -= L[l * n + j] * L[m * n + j];
                }
                let x = sum * self.inverses[v + m];
                L[l * n + m] = x;
                xi -= self.xi[v + m].scale(x);
            }
            let mut D = L[l * n + l];
            for m in 0..l {
                D -= L[l * n + m] * L[l * n + m];
            }
            if !D.is_positive() {
                return Err((l, D.min_lane()));
            }
            let root = D.sqrt();
            let inverse = root.recip();
            L[l * n + l] = root;
            xi = xi.scale(inverse);
            (self.xi[v + l], self.roots[v + l], self.inverses[v + l]) = (xi, root, inverse);
            P.subtract_outer(xi, xi);
        }
        if let Some(index) = structure.stations[k].join {
            self.append_modes(structure, frames, (k, index), (i, v), row);
        }
        Ok(())
    }
    /// Rows of the modes in the join of their station, and what they take out of C.
    #[inline(always)]
    fn append_modes(
        &mut self,
        structure: &Structure<T>,
        frames: &Frames<T>,
        (k, index): (usize, usize),
        (i, v): (usize, usize),
        row: usize,
    ) {
        let (operation, passes) = (&structure.operations[index], &structure.stations[k].passes);
        let L = &self.modes[i].L;
        let n = self.modes[i].W.len();
        let block = operation.output.filter(|_| operation.in_place).map(|b| &structure.blocks[b]);
        let (width, rows) = match block {
            Some(block) => (block.width, &mut self.block_w[block.number + row * block.width..]),
            None => (operation.width, &mut self.matrix[operation.number + row * operation.width..]),
        };
        let rows = &mut rows[..n * width];
        rows.fill(Arithmetic::<T>::splat(0.0));
        for passing in passes {
            let (strand, of) = (structure.strands[passing.strand], &structure.loops[passing.of].rows);
            for j in 0..of.len() {
                let c = self.c[strand.first + j];
                for l in 0..n {
                    let screw = motion(frames.screws[passing.attached + l]);
                    rows[l * width + passing.column + j] += screw.dot(c);
                    let turned = screw.angular.dot(screw.angular) * c.moment.dot(c.moment);
                    let moved = screw.linear.dot(screw.linear) * c.force.dot(c.force);
                    let inverse = self.inverses[v + l];
                    self.squares[of.start + j] += (turned + moved) * (inverse * inverse);
                }
            }
        }
        for l in 0..n {
            let (upper, lower) = rows.split_at_mut(l * width);
            let w = &mut lower[..operation.others];
            for (m, above) in upper.chunks_exact(width).enumerate() {
                let factor = L[l * n + m];
                for (w, above) in w.iter_mut().zip(above) {
                    *w -= factor * *above;
                }
            }
            for w in w {
                *w *= self.inverses[v + l];
            }
        }
        // Where both strands of a loop meet here nothing of C is needed any more.
        for passing in passes.iter().filter(|p| !p.last) {
            let strand = structure.strands[passing.strand];
            for j in 0..structure.loops[passing.of].rows.len() {
                for l in 0..n {
                    let w = rows[l * width + passing.column + j];
                    self.c[strand.first + j] -= self.xi[v + l].scale(w);
                }
            }
        }
        if block.is_none() {
            for (l, row) in rows.chunks_exact_mut(width).enumerate() {
                row[operation.others..operation.others + 6].copy_from_slice(&self.xi[v + l].to_array());
            }
        }
    }
}
