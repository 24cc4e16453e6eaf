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
use std::ops::Range;

/// Columns of each of two matrices that are worked on at once.
const WIDTH: usize = 12;

/// A row of them, in cache lines of its own.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Row<T>([T; 2 * WIDTH]);

impl<T: Scalar> Row<T> {
    /// += w y.
    #[inline(always)]
    fn add_scaled(&mut self, y: &Self, w: T) {
        for x in 0..2 * WIDTH {
            self.0[x] = y.0[x].fma(w, self.0[x]);
        }
    }
}

/// L and D⁻¹ of one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Innovations<T> {
    /// For every body, one past the last degree of freedom outboard of it.
    ends: Vec<usize>,
    /// L by rows. Only entries of joints outboard are ever written; the others stay zero.
    operator: Vec<T>,
    /// L*, below the diagonal of L only.
    transposed: Vec<T>,
    /// For every body, which of `runs` are the degrees of freedom on its parent's way to the base.
    ways: Vec<Range<usize>>,
    runs: Vec<Range<usize>>,
    /// D⁻¹.
    inverse: Vec<T>,
    /// z of every column.
    gains: Vec<Wrench<T>>,
    /// A few columns of two matrices.
    rows: Vec<Row<T>>,
}

impl<T: Scalar> Innovations<T> {
    /// A workspace for a layout.
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let nv = layout.nv();
        let (mut ways, mut runs): (Vec<Range<usize>>, Vec<Range<usize>>) = (Vec::new(), Vec::new());
        for body in layout.bodies() {
            let start = runs.len();
            if body.parent != GROUND {
                let up = &layout.bodies()[body.parent];
                let own = up.v..up.v + up.hinge.nv();
                runs.extend_from_within(ways[body.parent].clone());
                match runs[start..].last_mut() {
                    Some(last) if last.end == own.start => last.end = own.end,
                    _ => runs.push(own),
                }
            }
            ways.push(start..runs.len());
        }
        Innovations {
            ends: subtree_ends(layout),
            transposed: vec![T::zero(); nv * nv],
            ways,
            runs,
            operator: vec![T::zero(); nv * nv],
            inverse: vec![T::zero(); nv],
            gains: vec![Wrench::zero(); nv],
            rows: vec![Row([T::zero(); 2 * WIDTH]); nv],
        }
    }
    /// Takes the pivots of an articulated sweep and the poses of the same configuration. Cost O(n · depth), no allocation.
    #[inline(always)]
    pub(crate) fn update(
        &mut self,
        layout: &Layout<T::Constant>,
        pivots: &[Pivot<T>],
        poses: &[Transform<T>],
    ) {
        let nv = layout.nv();
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let (first, inner, end) = (body.v, body.v + body.hinge.nv(), self.ends[k]);
            for i in first..inner {
                let Pivot { gain, inverse } = pivots[i];
                self.inverse[i] = inverse;
                let row = &mut self.operator[i * nv..(i + 1) * nv];
                row[i] = T::one();
                // Innovations of the axes before this one in the joint, then of the joints outboard.
                innovate(&body.hinge, i - first, gain, &mut row[first..i], &mut self.gains[first..i]);
                innovate(&body.hinge, i - first, gain, &mut row[inner..end], &mut self.gains[inner..end]);
                for c in (first..i).chain(inner..end) {
                    self.transposed[c * nv + i] = row[c];
                }
                self.gains[i] = gain;
            }
            if matches!(body.hinge, Hinge::Free) {
                // G = I: the joint passes its own force and nothing of what comes from outboard.
                (first..inner).for_each(|i| self.gains[i] = Wrench::unit(i - first));
                self.gains[inner..end].fill(Wrench::zero());
            }
            if body.parent != GROUND {
                let pose = poses[k];
                for gain in &mut self.gains[first..end] {
                    *gain = pose.wrench_to_parent(*gain);
                }
            }
        }
    }
    /// B ← −M⁻¹ B for two matrices of nv rows and columns.
    #[inline(always)]
    pub(crate) fn negative_solve(&mut self, layout: &Layout<T::Constant>, first: &mut [T], second: &mut [T]) {
        let nv = layout.nv();
        let mut at = 0;
        while at < nv {
            let width = WIDTH.min(nv - at);
            let sources = first.chunks_exact(nv).zip(second.chunks_exact(nv));
            for (row, (a, b)) in self.rows.iter_mut().zip(sources) {
                row.0[..width].copy_from_slice(&a[at..at + width]);
                row.0[WIDTH..WIDTH + width].copy_from_slice(&b[at..at + width]);
            }
            self.solve_rows(layout);
            let targets = first.chunks_exact_mut(nv).zip(second.chunks_exact_mut(nv));
            for (row, (a, b)) in self.rows.iter().zip(targets) {
                a[at..at + width].copy_from_slice(&row.0[..width]);
                b[at..at + width].copy_from_slice(&row.0[WIDTH..WIDTH + width]);
            }
            at += width;
        }
    }
    #[inline(always)]
    fn solve_rows(&mut self, layout: &Layout<T::Constant>) {
        let nv = layout.nv();
        let rows = &mut self.rows[..nv];
        // Y = −D⁻¹ L B, from the base outward: a row takes rows that are not changed yet.
        for (k, body) in layout.bodies().iter().enumerate() {
            let (first, inner, end) = (body.v, body.v + body.hinge.nv(), self.ends[k]);
            for i in (first..inner).rev() {
                let weights = &self.operator[i * nv..(i + 1) * nv];
                let mut sum = rows[i];
                for (w, y) in weights[first..i].iter().zip(&rows[first..i]) {
                    sum.add_scaled(y, *w);
                }
                for (w, y) in weights[inner..end].iter().zip(&rows[inner..end]) {
                    sum.add_scaled(y, *w);
                }
                let scale = -self.inverse[i];
                for x in 0..2 * WIDTH {
                    rows[i].0[x] = sum.0[x] * scale;
                }
            }
        }
        // L* Y, from the tips inward: a row takes rows of the way to the base, which change later.
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let (first, inner) = (body.v, body.v + body.hinge.nv());
            for c in first..inner {
                let weights = &self.transposed[c * nv..(c + 1) * nv];
                let mut sum = rows[c];
                for (w, y) in weights[c + 1..inner].iter().zip(&rows[c + 1..inner]) {
                    sum.add_scaled(y, *w);
                }
                for run in &self.runs[self.ways[k].clone()] {
                    for (w, y) in weights[run.clone()].iter().zip(&rows[run.clone()]) {
                        sum.add_scaled(y, *w);
                    }
                }
                rows[c] = sum;
            }
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
    let bodies = layout.bodies().iter().enumerate();
    let poses: Vec<_> = bodies.map(|(k, body)| sweep.shifts.at(k, body).pose()).collect();
    innovations.update(layout, &sweep.pivots, &poses);
    Ok(innovations.operator.into_iter().map(T::from_arithmetic).collect())
}
