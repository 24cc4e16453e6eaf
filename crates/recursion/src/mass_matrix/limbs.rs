//! The mass matrix of one state with its limbs in lanes ([`crate::layout::LimbPlan`]): the same sweep, on registers in place of numbers.
//!
//! Limbs go first; the trunk meets their composites and columns where they stand in the order of bodies.

use super::entries::{Blocks, Entries, Rows, Scattered};
use super::sweep::{Sweep, Work};
use super::{MassMatrix, clear};
use crate::error::{DynamicsError, check_length};
use crate::layout::{GROUND, Gift, Layout, LimbPlan, Limbs};
use crate::limbs;
use crate::places::Places;
use num_traits::Zero;
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{Kernel, RigidInertia, Scalar};

/// Workspace of one group of limbs.
#[derive(Clone, Debug)]
pub(super) struct OfLimbs<T: Scalar> {
    q: Vec<T::Abreast>,
    work: Work<T::Abreast>,
    /// Places of the bodies of each limb, among all.
    places: Vec<[usize; 4]>,
    /// What each limb gives to its parent.
    gifts: [RigidInertia<T::Arithmetic>; 4],
}

impl<T: Scalar> OfLimbs<T> {
    pub(super) fn of_all(layout: &Layout<T::Constant>, places: &Places) -> Vec<Self> {
        let groups = layout.limbs.iter().flat_map(|plan| &plan.groups);
        groups
            .map(|limbs| OfLimbs {
                q: vec![T::Abreast::zero(); limbs.q.len()],
                work: Work::new(&limbs.layout),
                places: (0..limbs.q.len()).map(|i| limbs.roots.map(|root| places.first[root + i])).collect(),
                gifts: [RigidInertia::zero(); 4],
            })
            .collect()
    }
    /// All bodies of the limbs, tip to base.
    #[inline(always)]
    fn inboard(
        &mut self,
        of: &Limbs<T::Constant>,
        q: &[T::Arithmetic],
        whole: &Places,
        out: &mut [T::Arithmetic],
    ) {
        for (to, at) in self.q.iter_mut().zip(&of.q) {
            *to = limbs::numbers(q, *at);
        }
        self.work.shifts.set_all(&of.layout, &self.q);
        let mut sweep = self.work.sweep(&of.layout);
        let margin = sweep.places.margin;
        let mut entries = OfFour::<T> { of, margin, whole, out };
        sweep.inboard::<T::Abreast, _>(0..self.q.len(), &mut entries);
        limbs::give_rigid(of, &sweep.composites.given(), &mut self.gifts);
    }
    /// Their composites and columns, to the trunk.
    #[inline(always)]
    fn give<W: Wide<T::Arithmetic>>(
        &self,
        of: &Limbs<T::Constant>,
        gift: &Gift,
        trunk: &mut Sweep<'_, T::Arithmetic>,
    ) {
        if of.parents[gift.lane] == GROUND {
            return;
        }
        trunk.composites.take(gift.root, &self.gifts[gift.lane]);
        let margin = self.work.places.margin;
        for (i, places) in self.places.iter().enumerate() {
            let f = self.work.column(margin + i);
            if of.together {
                let f = limbs::lanes_of_wrench::<T::Arithmetic>(f);
                for lane in 0..of.count {
                    trunk.set_column::<W>(places[lane], &f[lane]);
                }
            } else {
                let f = limbs::lane_of_wrench::<T::Arithmetic>(f, gift.lane);
                trunk.set_column::<W>(places[gift.lane], &f);
            }
        }
    }
}

/// Entries of four limbs, to the model's order; below the diagonal only where rows are not in the order of the places.
struct OfFour<'a, T: Scalar> {
    of: &'a Limbs<T::Constant>,
    margin: usize,
    whole: &'a Places,
    out: &'a mut [T::Arithmetic],
}

impl<T: Scalar> Entries<T::Abreast, T::Abreast> for OfFour<'_, T> {
    #[inline(always)]
    fn side_by_side(&mut self, _: usize, _: usize) -> Option<&mut [T::Abreast]> {
        None
    }
    #[inline(always)]
    fn put(&mut self, row: usize, at: usize, x: T::Abreast) {
        let nv = self.whole.count - self.whole.margin;
        let (rows, columns) = (&self.of.v[row - self.margin], &self.of.v[at - self.margin]);
        let x = limbs::lanes::<T::Arithmetic>(x);
        for lane in 0..4 {
            let (i, j) = (rows[lane], columns[lane]);
            self.out[i * nv + j] = x[lane];
            if !self.whole.in_order {
                self.out[j * nv + i] = x[lane];
            }
        }
    }
}

impl<T: Scalar> Blocks<T::Abreast> for OfFour<'_, T> {
    #[inline(always)]
    fn put_block(&mut self, first: usize, block: &[[T::Abreast; 6]; 6]) {
        for (i, row) in block.iter().enumerate() {
            for (j, &x) in row.iter().enumerate() {
                self.put(first + i, first + j, x);
            }
        }
    }
}

/// All bodies of one state, limbs in lanes.
pub(super) struct WithLimbs<'a, T: Scalar> {
    pub(super) work: &'a mut MassMatrix<T>,
    pub(super) plan: &'a LimbPlan<T::Constant>,
    pub(super) q: &'a [T::Arithmetic],
    pub(super) out: &'a mut [T::Arithmetic],
}

impl<T: Scalar> Kernel for WithLimbs<'_, T> {
    type Output = Result<(), DynamicsError>;
    fn run(self) -> Self::Output {
        for (own, limbs) in self.work.limbs.iter().zip(&self.plan.groups) {
            check_length("workspace", &own.q, limbs.q.len())?;
        }
        T::Arithmetic::dispatch_beside_numbers(LimbsAndTrunk(self));
        Ok(())
    }
}

struct LimbsAndTrunk<'a, T: Scalar>(WithLimbs<'a, T>);

impl<T: Scalar> WideKernel<T::Arithmetic> for LimbsAndTrunk<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T::Arithmetic>>(self) {
        let WithLimbs { work: MassMatrix { work, zeros, limbs, .. }, plan, q, out } = self.0;
        if *zeros {
            clear::<_, W>(out);
        }
        for (own, of) in limbs.iter_mut().zip(&plan.groups) {
            own.inboard(of, q, &work.places, out);
        }
        let bodies = plan.layout.bodies();
        let mut shifts = work.shifts.run();
        for (trunk, _) in &plan.trunk {
            let trunk = trunk.clone();
            shifts.begin(&bodies[trunk.clone()], q);
            for (i, k) in trunk.enumerate() {
                shifts.set::<false>(k, i, &bodies[k], q);
            }
        }
        let (mut sweep, nv) = (work.sweep(&plan.layout), plan.layout.nv());
        if sweep.places.in_order && W::COUNT > 1 {
            let mut rows = Rows { places: sweep.places, nv, out };
            trunk::<T, W, _>(&mut sweep, plan, limbs, &mut rows);
            sweep.places.mirror::<_, W>(sweep.places.margin, nv, out);
        } else {
            let mut scattered = Scattered { places: sweep.places, nv, out };
            trunk::<T, W, _>(&mut sweep, plan, limbs, &mut scattered);
        }
    }
}

/// The trunk, and limbs where they meet it.
#[inline(always)]
fn trunk<T: Scalar, W: Wide<T::Arithmetic>, E: Entries<T::Arithmetic, W> + Blocks<T::Arithmetic>>(
    sweep: &mut Sweep<'_, T::Arithmetic>,
    plan: &LimbPlan<T::Constant>,
    limbs: &[OfLimbs<T>],
    entries: &mut E,
) {
    for (bodies, gift) in plan.trunk.iter().rev() {
        if let Some(gift) = gift {
            limbs[gift.group].give::<W>(&plan.groups[gift.group], gift, sweep);
        }
        sweep.inboard::<W, _>(bodies.clone(), entries);
    }
}
