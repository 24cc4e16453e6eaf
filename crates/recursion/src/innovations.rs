//! The innovations operator L = I − HψK as a matrix, and M⁻¹ = L* D⁻¹ L with it.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | z | K e_c of a unit innovation at c, moved inward by ψ | 6 | soa.md 3.1 |
//! | L | I − HψK: ε = L T; entry (i, c) is −H(i) z(i), zero unless i lies on the way from c to the base | nv×nv | soa.md 3.1 |
//! | D | articulated joint inertias | nv | paper 1 (9.5) |
//!
//! L is unit triangular in the order of elimination (joints outboard first, components of a joint in their order). Nothing is
//! subtracted in products with it that the filter does not subtract too: it keeps the digits that a Cholesky factor of M loses
//! where heavy bodies hang on light ones.

use crate::articulated_sweep::{ArticulatedSweep, Pivot};
use crate::error::DynamicsError;
use crate::hinge::Hinge;
use crate::inverse_dynamics_derivatives::subtree_ends;
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{Scalar, Transform, Wrench};

/// Columns of a matrix that are worked on at once.
const WIDTH: usize = 8;

/// L and D⁻¹ of one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Innovations<T> {
    /// For every body, one past the last degree of freedom outboard of it.
    ends: Vec<usize>,
    /// L by rows. Only entries of joints outboard are ever written; the others stay zero.
    operator: Vec<T>,
    /// D⁻¹.
    inverse: Vec<T>,
    /// z of every column.
    gains: Vec<Wrench<T>>,
    /// A few columns of a matrix.
    columns: Vec<T>,
}

impl<T: Scalar> Innovations<T> {
    /// A workspace for a layout.
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let nv = layout.nv();
        Innovations {
            ends: subtree_ends(layout),
            operator: vec![T::zero(); nv * nv],
            inverse: vec![T::zero(); nv],
            gains: vec![Wrench::zero(); nv],
            columns: vec![T::zero(); nv * WIDTH],
        }
    }
    /// Takes the pivots of an articulated sweep and the poses of the same configuration. Cost O(n · depth), no allocation.
    #[inline(always)]
    pub(crate) fn update(
        &mut self,
        layout: &Layout<T::Constant>,
        pivot: impl Fn(usize) -> Pivot<T>,
        pose: impl Fn(usize) -> Transform<T>,
    ) {
        let nv = layout.nv();
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let (first, inner, end) = (body.v, body.v + body.hinge.nv(), self.ends[k]);
            for i in first..inner {
                let Pivot { column, inverse } = pivot(i);
                self.inverse[i] = inverse;
                let row = &mut self.operator[i * nv..(i + 1) * nv];
                row[i] = T::one();
                let gain = column.scale(inverse);
                // Innovations of the axes before this one in the joint, then of the joints outboard.
                innovate(&body.hinge, i - first, gain, &mut row[first..i], &mut self.gains[first..i]);
                innovate(&body.hinge, i - first, gain, &mut row[inner..end], &mut self.gains[inner..end]);
                self.gains[i] = gain;
            }
            if matches!(body.hinge, Hinge::Free) {
                // G = I: the joint passes its own force and nothing of what comes from outboard.
                (first..inner).for_each(|i| self.gains[i] = Wrench::unit(i - first));
                self.gains[inner..end].fill(Wrench::zero());
            }
            if body.parent != GROUND {
                let pose = pose(k);
                for gain in &mut self.gains[first..end] {
                    *gain = pose.wrench_to_parent(*gain);
                }
            }
        }
    }
    /// B ← −M⁻¹ B for a matrix of nv rows and columns whose entry (i, c) is zero unless i and c are in one tree.
    #[inline(always)]
    pub(crate) fn negative_solve(&mut self, layout: &Layout<T::Constant>, matrix: &mut [T]) {
        let (nv, mut at) = (layout.nv(), 0);
        while at + WIDTH <= nv {
            self.solve_columns::<WIDTH>(layout, matrix, at);
            at += WIDTH;
        }
        if at + 4 <= nv {
            self.solve_columns::<4>(layout, matrix, at);
            at += 4;
        }
        if at + 2 <= nv {
            self.solve_columns::<2>(layout, matrix, at);
            at += 2;
        }
        if at < nv {
            self.solve_columns::<1>(layout, matrix, at);
        }
    }
    /// The same for `W` columns from column `at`.
    #[inline(always)]
    fn solve_columns<const W: usize>(&mut self, layout: &Layout<T::Constant>, matrix: &mut [T], at: usize) {
        let nv = layout.nv();
        let (columns, _) = self.columns.as_chunks_mut::<W>();
        let columns = &mut columns[..nv];
        for (column, row) in columns.iter_mut().zip(matrix.chunks_exact(nv)) {
            column.copy_from_slice(&row[at..at + W]);
        }
        // Y = −D⁻¹ L B, from the base outward: a row takes rows that are not changed yet.
        for (k, body) in layout.bodies().iter().enumerate() {
            let (first, inner, end) = (body.v, body.v + body.hinge.nv(), self.ends[k]);
            for i in (first..inner).rev() {
                let weights = &self.operator[i * nv..(i + 1) * nv];
                let mut sum = columns[i];
                for (w, y) in weights[first..i].iter().zip(&columns[first..i]) {
                    add_scaled(&mut sum, y, *w);
                }
                for (w, y) in weights[inner..end].iter().zip(&columns[inner..end]) {
                    add_scaled(&mut sum, y, *w);
                }
                let scale = -self.inverse[i];
                for (column, sum) in columns[i].iter_mut().zip(sum) {
                    *column = sum * scale;
                }
            }
        }
        // L* Y, from the tips inward: a row is given to others before it changes itself.
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let (first, inner, end) = (body.v, body.v + body.hinge.nv(), self.ends[k]);
            for i in first..inner {
                let weights = &self.operator[i * nv..(i + 1) * nv];
                let own = columns[i];
                for (w, x) in weights[first..i].iter().zip(&mut columns[first..i]) {
                    add_scaled(x, &own, *w);
                }
                for (w, x) in weights[inner..end].iter().zip(&mut columns[inner..end]) {
                    add_scaled(x, &own, *w);
                }
            }
        }
        for (column, row) in columns.iter().zip(matrix.chunks_exact_mut(nv)) {
            row[at..at + W].copy_from_slice(column);
        }
    }
    /// M⁻¹ = Σ over rows of L of ℓ* D⁻¹ ℓ, full and symmetric.
    #[inline(always)]
    pub(crate) fn inverse_mass_matrix(&self, layout: &Layout<T::Constant>, out: &mut [T]) {
        let nv = layout.nv();
        out.fill(T::zero());
        for (k, body) in layout.bodies().iter().enumerate() {
            let (first, end) = (body.v, self.ends[k]);
            for i in first..body.v + body.hinge.nv() {
                let weights = &self.operator[i * nv..(i + 1) * nv];
                for c in first..end {
                    // Right of the diagonal; ℓ is zero at the axes that come after i in its joint.
                    let scale = weights[c] * self.inverse[i];
                    let row = &mut out[c * nv + c..c * nv + end];
                    for (x, y) in row.iter_mut().zip(&weights[c..end]) {
                        *x = y.fma(scale, *x);
                    }
                }
            }
        }
        for c in 0..nv {
            for x in c + 1..nv {
                out[x * nv + c] = out[c * nv + x];
            }
        }
    }
}

/// One row of L: ε = −H z for every column, and z⁺ = z + G ε.
#[inline(always)]
fn innovate<T: Scalar>(
    hinge: &Hinge<T::Constant>,
    i: usize,
    gain: Wrench<T>,
    row: &mut [T],
    gains: &mut [Wrench<T>],
) {
    for (entry, z) in row.iter_mut().zip(gains) {
        let innovation = -hinge.project(i, z);
        *z += gain.scale(innovation);
        *entry = innovation;
    }
}

/// sum += w y.
#[inline(always)]
fn add_scaled<T: Scalar, const W: usize>(sum: &mut [T; W], y: &[T; W], w: T) {
    for (sum, y) in sum.iter_mut().zip(y) {
        *sum = y.fma(w, *sum);
    }
}

/// L(q) by rows, nv×nv. `q`: nq. Cost O(n · depth) besides writing the zeros.
///
/// # Errors
/// Those of [`crate::ArticulatedSweep::new`].
pub fn innovations_operator<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> Result<Vec<T>, DynamicsError> {
    let sweep = ArticulatedSweep::new(layout, q)?;
    let mut innovations = Innovations::new(layout);
    innovations.update(layout, |i| sweep.pivots[i], |k| sweep.hinge[k]);
    Ok(innovations.operator)
}
