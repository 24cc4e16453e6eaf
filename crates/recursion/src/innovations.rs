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

use crate::articulated_sweep::Pivot;
use crate::error::DynamicsError;
use crate::hinge::Hinge;
use crate::inverse_dynamics_derivatives::subtree_ends;
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{Scalar, Transform, Wrench};

/// L and D⁻¹ of one configuration.
#[derive(Clone, Debug)]
pub struct Innovations<T> {
    ends: Vec<usize>,
    /// L by rows. Only entries below the way to the base are ever written; the others stay zero.
    operator: Vec<T>,
    /// D⁻¹.
    inverse: Vec<T>,
    /// z of every column.
    gains: Vec<Wrench<T>>,
}

impl<T: Scalar> Innovations<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let nv = layout.nv();
        Innovations {
            ends: subtree_ends(layout),
            operator: vec![T::zero(); nv * nv],
            inverse: vec![T::zero(); nv],
            gains: vec![Wrench::zero(); nv],
        }
    }
    /// Takes the pivots of an articulated sweep and the poses of the same configuration. Cost O(n · depth), no allocation.
    #[inline(always)]
    pub(crate) fn update<'a>(
        &mut self,
        layout: &Layout<T::Constant>,
        pivots: &[Pivot<T>],
        pose: impl Fn(usize) -> &'a Transform<T>,
    ) {
        let nv = layout.nv();
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let (first, inner, end) = (body.v, body.v + body.hinge.nv(), self.ends[k]);
            for i in first..inner {
                let Pivot { column, inverse } = pivots[i];
                self.inverse[i] = inverse;
                self.operator[i * nv + i] = T::one();
                // Innovations of the axes before this one in the joint, then of the joints outboard.
                let (before, outboard) = (first..i, inner..end);
                for c in before.chain(outboard) {
                    let innovation = -body.hinge.project(i - first, &self.gains[c]);
                    self.operator[i * nv + c] = innovation;
                    self.gains[c] += column.scale(innovation * inverse);
                }
                self.gains[i] = column.scale(inverse);
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
    /// B ← −M⁻¹ B for a matrix of nv rows and nv columns whose entry (i, c) is zero unless i and c are on one way to the base.
    #[inline(always)]
    pub(crate) fn negative_solve(&self, layout: &Layout<T::Constant>, matrix: &mut [T]) {
        let nv = layout.nv();
        // Y = −D⁻¹ L B, from the base outward: a row takes rows that are not changed yet.
        let mut tree = 0;
        for (k, body) in layout.bodies.iter().enumerate() {
            if body.parent == GROUND {
                tree = body.v;
            }
            let (first, inner, end) = (body.v, body.v + body.hinge.nv(), self.ends[k]);
            for i in (first..inner).rev() {
                let (above, rest) = matrix.split_at_mut(i * nv);
                let (row, below) = rest.split_at_mut(nv);
                let row = &mut row[tree..end];
                let weights = &self.operator[i * nv..(i + 1) * nv];
                for c in first..i {
                    add_scaled(row, weights[c], &above[c * nv + tree..c * nv + end]);
                }
                for c in inner..end {
                    let from = (c - i - 1) * nv;
                    add_scaled(row, weights[c], &below[from + tree..from + end]);
                }
                let scale = -self.inverse[i];
                row.iter_mut().for_each(|x| *x *= scale);
            }
        }
        // L* Y, from the tips inward.
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let inner = body.v + body.hinge.nv();
            for c in body.v..inner {
                let (above, rest) = matrix.split_at_mut(c * nv);
                let (row, below) = rest.split_at_mut(nv);
                let (mut at, mut root) = (k, body.v);
                while at != GROUND {
                    root = layout.bodies[at].v;
                    at = layout.bodies[at].parent;
                }
                for i in c + 1..inner {
                    let from = (i - c - 1) * nv;
                    let span = root..self.ends[k];
                    add_scaled(
                        &mut row[span.clone()],
                        self.operator[i * nv + c],
                        &below[from + span.start..from + span.end],
                    );
                }
                let mut at = body.parent;
                while at != GROUND {
                    let up = &layout.bodies[at];
                    let span = root..self.ends[at];
                    for i in up.v..up.v + up.hinge.nv() {
                        let from = &above[i * nv + span.start..i * nv + span.end];
                        add_scaled(&mut row[span.clone()], self.operator[i * nv + c], from);
                    }
                    at = up.parent;
                }
            }
        }
    }
    /// M⁻¹, full and symmetric.
    #[inline(always)]
    pub(crate) fn inverse_mass_matrix(&self, layout: &Layout<T::Constant>, out: &mut [T]) {
        let nv = layout.nv();
        out.fill(T::zero());
        for (k, body) in layout.bodies.iter().enumerate() {
            let inner = body.v + body.hinge.nv();
            for c in body.v..inner {
                // Right of the diagonal; L is zero where a row's joint is not outboard.
                let row = &mut out[c * nv..(c + 1) * nv];
                for i in c..inner {
                    let weights = &self.operator[i * nv..(i + 1) * nv];
                    let scale = weights[c] * self.inverse[i];
                    add_scaled(&mut row[c..self.ends[k]], scale, &weights[c..self.ends[k]]);
                }
                let mut at = body.parent;
                while at != GROUND {
                    let up = &layout.bodies[at];
                    for i in up.v..up.v + up.hinge.nv() {
                        let weights = &self.operator[i * nv..(i + 1) * nv];
                        let scale = weights[c] * self.inverse[i];
                        add_scaled(&mut row[c..self.ends[at]], scale, &weights[c..self.ends[at]]);
                    }
                    at = up.parent;
                }
                for x in c + 1..nv {
                    out[x * nv + c] = out[c * nv + x];
                }
            }
        }
    }
}

/// row += s · from.
#[inline(always)]
fn add_scaled<T: Scalar>(row: &mut [T], s: T, from: &[T]) {
    for (x, y) in row.iter_mut().zip(from) {
        *x = y.fma(s, *x);
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
    let sweep = crate::ArticulatedSweep::new(layout, q)?;
    let mut innovations = Innovations::new(layout);
    innovations.update(layout, &sweep.pivots, |k| &sweep.hinge[k]);
    Ok(innovations.operator)
}
