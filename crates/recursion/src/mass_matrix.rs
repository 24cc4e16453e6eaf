//! The mass matrix by composite bodies.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | R(k) | M(k) + Σ φ(k,c) R(c) φ*(k,c), inertia of everything outboard of joint k, joints locked | paper 2 (4.12) |
//! | M(q) | H φ M φ* H* = H (R + φ~R + R φ~*) H* | soa.md 3.1 |
//! | f | R H* of a degree of freedom, a column of φ R H* as far inboard as it has come | soa.md 3.1 |
//!
//! All is in the axes of the bodies, where H is a choice of components: what the joint of a body has of the columns that have come to it
//! is a row of M. Columns lie side by side in registers, and go to the parent together. Deep trees go another way (`ground.rs`).

use crate::error::{DynamicsError, check_length};
use crate::flexible::Composite;
use crate::layout::Layout;
use crate::packed::is_lone;
use phipsi_spatial::Scalar;
use phipsi_spatial::wide::{Wide, WideKernel};

mod entries;
mod ground;
mod limbs;
mod sweep;

use entries::{Rows, Scattered};
use ground::InGround;
use limbs::{OfLimbs, WithLimbs};
use sweep::Work;

/// Workspace of the mass matrix.
#[derive(Clone, Debug)]
pub struct MassMatrix<T: Scalar> {
    work: Work<T::Arithmetic>,
    /// True if some degrees of freedom are not related.
    zeros: bool,
    /// Limbs in lanes, group by group.
    limbs: Vec<OfLimbs<T>>,
    /// For a deep tree.
    ground: Option<InGround<T::Arithmetic>>,
    /// For a layout with flexible bodies.
    flexible: Option<Box<Composite<T>>>,
}

impl<T: Scalar> MassMatrix<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let work = Work::new(layout);
        let limbs = if is_lone::<T>() { OfLimbs::of_all(layout, &work.places) } else { Vec::new() };
        MassMatrix {
            zeros: work.places.end.iter().any(|&end| end < work.places.count),
            ground: if limbs.is_empty() { InGround::new(layout, &work.places) } else { None },
            limbs,
            work,
            flexible: layout.flexible().map(|tree| Box::new(Composite::new(tree))),
        }
    }
    /// The mass matrix, full and symmetric, by rows.
    ///
    /// # Computes
    /// M = H φ M φ* H* (soa.md 3.1): the momentum of the composite body outboard of a joint, moving along its axis, is
    /// carried to the base; its components along the axes on the way are entries of M. Closures and couplings stay open.
    ///
    /// # Shapes & units
    /// `q`: nq; `out`: nv×nv; kg·m², kg·m or kg.
    ///
    /// # Cost
    /// O(n · depth) besides writing the zeros; no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    #[inline(always)]
    pub fn run(&mut self, layout: &Layout<T::Constant>, q: &[T], out: &mut [T]) -> Result<(), DynamicsError> {
        let nv = layout.nv();
        check_length("q", q, layout.nq())?;
        check_length("out", out, nv * nv)?;
        if let Some(tree) = layout.flexible() {
            return Composite::run_checked(&mut self.flexible, tree, nv, q, out);
        }
        check_length("workspace", self.work.shifts.all(), layout.len())?;
        let (q, out) = (T::arithmetic(q), T::arithmetic_mut(out));
        if let Some(plan) = layout.limbs.as_deref()
            && plan.groups.len() == self.limbs.len()
        {
            let with_limbs = WithLimbs { work: &mut *self, plan, q, out: &mut *out };
            if let Some(done) = T::lone(with_limbs) {
                return done;
            }
        }
        let MassMatrix { work, zeros, ground, .. } = self;
        if let Some(ground) = ground {
            T::Arithmetic::dispatch_beside_numbers(ground::Gather { work: &mut *work, ground, layout, q });
            let (places, zeros) = (&work.places, *zeros);
            T::Arithmetic::dispatch_wide(ground::Sweep { places, ground, zeros, nv, out });
        } else {
            T::Arithmetic::dispatch_beside_numbers(Whole::<T> { work: self, layout, q, out });
        }
        Ok(())
    }
}

/// All bodies, one by one.
struct Whole<'a, T: Scalar> {
    work: &'a mut MassMatrix<T>,
    layout: &'a Layout<T::Constant>,
    q: &'a [T::Arithmetic],
    out: &'a mut [T::Arithmetic],
}

impl<T: Scalar> WideKernel<T::Arithmetic> for Whole<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T::Arithmetic>>(self) {
        let Whole { work: MassMatrix { work, zeros, .. }, layout, q, out } = self;
        if *zeros {
            clear::<_, W>(out);
        }
        work.shifts.set_all(layout, q);
        let (mut sweep, nv) = (work.sweep(layout), layout.nv());
        if sweep.places.in_order && W::COUNT > 1 {
            let mut rows = Rows { places: sweep.places, nv, out };
            sweep.inboard::<W, _>(0..layout.len(), &mut rows);
            sweep.places.mirror::<_, W>(sweep.places.margin, nv, out);
        } else {
            let mut scattered = Scattered { places: sweep.places, nv, out };
            sweep.inboard::<W, _>(0..layout.len(), &mut scattered);
        }
    }
}

/// Zeros, by stores alone: small matrices would feel a call, which the compiler makes of zeros that it knows.
#[inline(always)]
fn clear<T: Scalar, W: Wide<T>>(x: &mut [T]) {
    let zero = core::hint::black_box(W::zero());
    let mut groups = x.chunks_exact_mut(W::COUNT);
    for group in &mut groups {
        zero.store(group);
    }
    zero.store_first(groups.into_remainder());
}

/// [`MassMatrix::run`] for a single call.
///
/// # Errors
/// As there.
pub fn mass_matrix<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv() * layout.nv()];
    MassMatrix::new(layout).run(layout, q, &mut out)?;
    Ok(out)
}

#[cfg(test)]
mod tests;
