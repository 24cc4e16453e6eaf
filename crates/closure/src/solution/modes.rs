//! Modes of a flexible body in the filter and the smoother: a joint whose axes are the modes.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | s | L⁻¹(τ − z_e) | n |
//! | η̈ | L^−*(ξ + s − Ξα), ξ the residuals that the loops demand | n |

use super::{Load, Solution};
use crate::compiled::Number;
use crate::factors::Factors;
use crate::number::Arithmetic;
use crate::structure::Structure;
use phipsi_spatial::{Motion, Scalar};

impl<T: Number> Solution<T> {
    /// The filter at the modes of flexible body `i`: n degrees of freedom from `v` on, at station k.
    #[inline(always)]
    pub(super) fn filter_modes(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        k: usize,
        (i, v, n): (usize, usize, usize),
    ) {
        let join = structure.stations[k].join;
        let own = self.enter(structure, factors, join.map(|index| &structure.operations[index]));
        let L = &factors.modes[i].L;
        for l in 0..n {
            let tau = load.tau.map_or(Arithmetic::<T>::splat(0.0), |tau| tau[v + l]);
            let mut s = tau - self.z_modes[v - self.first_mode + l];
            for m in 0..l {
                s -= L[l * n + m] * self.s[v + m];
            }
            s *= factors.inverses[v + l];
            self.s[v + l] = s;
            self.z[k] = factors.xi[v + l].scale_add(s, self.z[k]);
            self.set_residual(own, l, -s);
        }
        if let Some(index) = join.filter(|&index| !structure.operations[index].in_place) {
            self.turn(structure, factors, &structure.operations[index], &factors.done[index]);
        }
    }
    /// The smoother there: the acceleration of the hinge frame is `alpha`.
    #[inline(always)]
    pub(super) fn smooth_modes(
        &mut self,
        structure: &Structure<T>,
        factors: &Factors<T>,
        k: usize,
        (i, v, n): (usize, usize, usize),
        alpha: Motion<Arithmetic<T>>,
        out: &mut [Arithmetic<T>],
    ) {
        let own = self.part(structure, factors, k);
        let L = &factors.modes[i].L;
        for l in (0..n).rev() {
            let mut sum = self.residual(own, l) - alpha.dot(factors.xi[v + l]) + self.s[v + l];
            for m in l + 1..n {
                sum -= L[m * n + l] * out[v + m];
            }
            out[v + l] = sum * factors.inverses[v + l];
        }
        self.alpha[k] = alpha;
    }
}
