//! M⁻¹ as a full matrix and as an O(n) product.
//!
//! M⁻¹ = L* D⁻¹ L with the innovations operator L = I − HψK of [`crate::innovations`], whose entries are gains moved inward
//! (the element-wise form is Lemma 13 of paper 1, corrected in soa.md 3.3). M itself is never formed.

use crate::articulated_sweep::{ArticulatedSweep, SolveWorkspace};
use crate::error::{DynamicsError, check_length};
use crate::flexible::Solution;
use crate::innovations::InnovationsSweep;
use crate::layout::Layout;
use phipsi_spatial::Scalar;
use phipsi_spatial::wide::{Wide, WideKernel};

/// Workspace of the solution with the mass matrix.
#[derive(Clone, Debug)]
pub struct MassMatrixSolution<T: Scalar> {
    sweep: ArticulatedSweep<T>,
    workspace: SolveWorkspace<T>,
    flexible: Option<Box<Solution<T>>>,
}

impl<T: Scalar> MassMatrixSolution<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        MassMatrixSolution {
            sweep: ArticulatedSweep::empty(layout),
            workspace: SolveWorkspace::new(layout),
            flexible: Solution::new(layout),
        }
    }
    /// M⁻¹ x. `q`: nq; `x`, `out`: nv. Cost O(n), no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`]; otherwise those of [`ArticulatedSweep::new`].
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        x: &[T],
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        check_length("x", x, layout.nv())?;
        check_length("out", out, layout.nv())?;
        out.copy_from_slice(x);
        if layout.is_flexible() {
            return Solution::run(&mut self.flexible, layout, q, out);
        }
        self.sweep.update(layout, q)?;
        self.sweep.solve_in_place(layout, out, &mut self.workspace);
        Ok(())
    }
}

/// [`MassMatrixSolution::run`] for a single call.
///
/// # Errors
/// As there.
pub fn solve_mass_matrix<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    x: &[T],
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    MassMatrixSolution::new(layout).run(layout, q, x, &mut out)?;
    Ok(out)
}

/// Workspace of the inverse of the mass matrix.
#[derive(Clone, Debug)]
pub struct MassMatrixInverse<T: Scalar> {
    sweep: ArticulatedSweep<T>,
    innovations: InnovationsSweep<T::Arithmetic>,
    flexible: Option<Box<Solution<T>>>,
}

impl<T: Scalar> MassMatrixInverse<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        MassMatrixInverse {
            sweep: ArticulatedSweep::empty(layout),
            innovations: InnovationsSweep::new(layout),
            flexible: Solution::new(layout),
        }
    }
    /// The inverse of the mass matrix, full and symmetric, by rows. `q`: nq; `out`: nv×nv.
    ///
    /// # Cost
    /// O(nv · depth²) besides writing the zeros of separate trees; with flexible bodies O(nv · n). No allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`]; otherwise those of [`ArticulatedSweep::new`].
    pub fn run(&mut self, layout: &Layout<T::Constant>, q: &[T], out: &mut [T]) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        check_length("out", out, layout.nv() * layout.nv())?;
        if layout.is_flexible() {
            let nv = layout.nv();
            out.fill(T::zero());
            (0..nv).for_each(|i| out[i * nv + i] = T::one());
            return Solution::run(&mut self.flexible, layout, q, out);
        }
        check_length("workspace", &self.innovations.places.first, layout.len())?;
        self.sweep.update(layout, q)?;
        T::Arithmetic::dispatch_wide(Products::<T> { work: self, layout, out: T::arithmetic_mut(out) });
        Ok(())
    }
}

struct Products<'a, T: Scalar> {
    work: &'a mut MassMatrixInverse<T>,
    layout: &'a Layout<T::Constant>,
    out: &'a mut [T::Arithmetic],
}

impl<T: Scalar> WideKernel<T::Arithmetic> for Products<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T::Arithmetic>>(self) {
        let MassMatrixInverse { sweep, innovations, .. } = self.work;
        innovations.update::<W>(self.layout, &sweep.pivots, &sweep.shifts);
        innovations.innovations.inverse_mass_matrix::<W>(&innovations.places, self.out);
    }
}

/// [`MassMatrixInverse::run`] for a single call.
///
/// # Errors
/// As there.
pub fn mass_matrix_inverse<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv() * layout.nv()];
    MassMatrixInverse::new(layout).run(layout, q, &mut out)?;
    Ok(out)
}
