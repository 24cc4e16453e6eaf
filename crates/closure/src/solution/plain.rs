//! One right-hand side in the plain form: what joints make of it, and the residuals that multipliers demand.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | c | right-hand side of the loops, with what bodies and joints have taken from it: c −= C a + w*s | m |
//! | ξ | w λ | r |

use super::{Own, Solution, most_of};
use crate::compiled::Number;
use crate::factors::Factors;
use crate::number::{Arithmetic, larger, size};
use crate::structure::Structure;
use crate::tree::Tree;
use phipsi_spatial::{Motion, Scalar};

impl<T: Number> Solution<T> {
    /// c −= C a at the joint of body k.
    #[inline(always)]
    pub(super) fn carry_plain(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        k: usize,
        a: Motion<Arithmetic<T>>,
    ) {
        let length = Arithmetic::<T>::splat(structure.length);
        let term = larger(most_of(a.angular) * length, most_of(a.linear));
        for passing in &structure.stations[k].passes {
            let first = factors.plain.fronts[k].c + passing.column;
            for (i, row) in structure.loops[passing.of].rows.clone().enumerate() {
                self.g[row] -= a.dot(factors.plain.c[first + i]);
                self.note(row, term);
            }
        }
    }
    /// c −= w*s there.
    #[inline(always)]
    pub(super) fn innovate_plain(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        factors: &Factors<T>,
        k: usize,
    ) {
        let (front, body) = (&factors.plain.fronts[k], &tree.bodies[k]);
        for i in (0..body.nv).filter(|&i| factors.is_passive(body.v + i)) {
            let w = &factors.plain.w[front.w + i * front.width..][..front.width];
            let s = self.s[body.v + i];
            for (passing, column) in structure.stations[k].passes.iter().zip(&front.columns) {
                for (j, row) in structure.loops[passing.of].rows.clone().enumerate() {
                    self.g[row] = (-w[column + j]).fma(s, self.g[row]);
                }
            }
        }
    }
    /// ξ of the passive degrees of freedom of body k, on the stack.
    #[inline(always)]
    pub(super) fn residuals_plain(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        factors: &Factors<T>,
        k: usize,
    ) -> Own {
        let (front, body) = (&factors.plain.fronts[k], &tree.bodies[k]);
        if front.width == 0 {
            return Own::Nowhere;
        }
        let passive = (0..body.nv).filter(|&i| factors.is_passive(body.v + i));
        for (passed, i) in passive.enumerate() {
            let w = &factors.plain.w[front.w + i * front.width..][..front.width];
            let mut xi = Arithmetic::<T>::splat(0.0);
            for (passing, column) in structure.stations[k].passes.iter().zip(&front.columns) {
                for (j, row) in structure.loops[passing.of].rows.clone().enumerate() {
                    xi = w[column + j].fma(self.lambda[row], xi);
                }
            }
            self.stack[passed] = xi;
        }
        Own::Stack(0)
    }
    /// The largest s of the joints that loops pass: c has such terms.
    #[inline(always)]
    pub(super) fn free(&self, structure: &Structure<T>, tree: &Tree<T>) -> Arithmetic<T> {
        let mut most = Arithmetic::<T>::splat(0.0);
        for (station, body) in structure.stations.iter().zip(&tree.bodies) {
            if !station.passes.is_empty() {
                for s in &self.s[body.v..body.v + body.nv] {
                    most = larger(most, size(*s));
                }
            }
        }
        most
    }
}
