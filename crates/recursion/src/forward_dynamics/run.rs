//! A run of bodies in the sweeps of forward dynamics, and the sweeps over branches.

use super::carrying::{Carrying, Lanes, carried};
use super::{Moved, Moving};
use crate::articulated_sweep::Pivot;
use crate::branching::{Given, Recursion};
use crate::error::DynamicsError;
use crate::layout::{Branch, GROUND, Layout, ShiftRun, carve};
use crate::packed::Packed;
use core::marker::PhantomData;
use core::ops::Range;
use phipsi_spatial::{Kernel, Motion, Scalar, SixLanes, Vec3, Wrench};

/// α where it is kept for several children. Its numbers lie apart: where they lie side by side, the compiler packs them into registers and takes
/// them out again at every body, kept or not, and the next body waits for it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Apart<T>([T; 11]);

impl<T: Scalar> Apart<T> {
    pub(super) fn zero() -> Self {
        Apart([T::zero(); 11])
    }
    #[inline(always)]
    pub(super) fn get(&self) -> Motion<T> {
        let x = &self.0;
        Motion::new(Vec3([x[0], x[2], x[4]]), Vec3([x[6], x[8], x[10]]))
    }
    #[inline(always)]
    pub(super) fn set(&mut self, alpha: &Motion<T>) {
        for i in 0..3 {
            self.0[2 * i] = alpha.angular.0[i];
            self.0[2 * i + 6] = alpha.linear.0[i];
        }
    }
}

/// What all runs of bodies share in a call.
#[derive(Clone, Copy)]
pub(super) struct Call<'a, T: Scalar> {
    pub(super) layout: &'a Layout<T::Constant>,
    pub(super) q: &'a [T::Arithmetic],
    pub(super) v: &'a [T::Arithmetic],
    pub(super) loads: Option<&'a [Wrench<T::Arithmetic>]>,
    pub(super) ground: Motion<T::Arithmetic>,
    pub(super) lanes: Lanes,
}

/// A run of bodies. Slices begin at its first body and degree of freedom; those of the call at the layout's.
pub(super) struct Run<'a, T: Scalar> {
    pub(super) call: Call<'a, T>,
    pub(super) first: usize,
    pub(super) first_v: usize,
    /// ω and α of the parent that is not in the run.
    pub(super) outside: (Vec3<T::Arithmetic>, Motion<T::Arithmetic>),
    pub(super) shifts: ShiftRun<'a, T::Arithmetic>,
    pub(super) moving: &'a mut [Moving<T::Arithmetic>],
    pub(super) pivots: &'a mut [Pivot<T::Arithmetic>],
    pub(super) alpha: &'a mut [Apart<T::Arithmetic>],
    pub(super) residuals: &'a mut [T::Arithmetic],
    pub(super) given: &'a mut Given<Moved<T::Arithmetic>>,
    /// The same where six-vectors are in lanes.
    pub(super) packed: &'a mut Given<Packed<<T::Arithmetic as Scalar>::Six>>,
}

/// Which sweeps.
#[derive(Clone, Copy)]
enum Sweeps {
    Velocities,
    Filter,
    Smoother,
}

impl<'a, T: Scalar> Run<'a, T> {
    /// Sweeps over some bodies of the run, by their numbers in it.
    fn sweep(&mut self, numbers: Range<usize>, which: Sweeps) -> Result<(), DynamicsError> {
        carried!(self.call.lanes, |X| {
            T::Arithmetic::dispatch(SweepOver::<T, X> { run: self, numbers, which, by: PhantomData })
        })
    }
    /// The same run, lent.
    pub(super) fn again(&mut self) -> Run<'_, T> {
        Run {
            call: self.call,
            shifts: self.shifts.again(),
            moving: self.moving,
            pivots: self.pivots,
            alpha: self.alpha,
            residuals: self.residuals,
            given: self.given,
            packed: self.packed,
            ..*self
        }
    }
    /// Its first body: of all bodies, a constant.
    #[inline(always)]
    pub(super) fn first<const WHOLE: bool>(&self) -> usize {
        if WHOLE { 0 } else { self.first }
    }
    /// Its first degree of freedom.
    #[inline(always)]
    pub(super) fn first_v<const WHOLE: bool>(&self) -> usize {
        if WHOLE { 0 } else { self.first_v }
    }
    fn numbers(&self, bodies: Range<usize>) -> Range<usize> {
        bodies.start - self.first..bodies.end - self.first
    }
    /// Its branches.
    fn parts(&mut self, branch: &Branch) -> Vec<Run<'_, T>> {
        let (call, first, runs) = (self.call, self.first, &branch.branches);
        let outside: Vec<_> = runs
            .iter()
            .map(|b| match b.outside {
                GROUND => (Vec3::zero(), call.ground),
                parent if parent < first => self.outside,
                parent => (self.moving[parent - first].omega, self.alpha[parent - first].get()),
            })
            .collect();
        let bodies = || runs.iter().map(|b| b.bodies.clone());
        let v = || branch.by_v.iter().map(|&i| runs[i].v.clone());
        let mut dofs: Vec<_> = carve(self.pivots, self.first_v, v())
            .into_iter()
            .zip(carve(self.residuals, self.first_v, v()))
            .zip(&branch.by_v)
            .collect();
        dofs.sort_unstable_by_key(|(_, i)| **i);
        let bodies = carve(self.moving, first, bodies()).into_iter().zip(carve(self.alpha, first, bodies()));
        let given = self.given.branches.iter_mut().zip(&mut self.packed.branches);
        let shared = self.shifts.carve(branch).into_iter().zip(given).zip(outside);
        let each = runs.iter().zip(shared).zip(bodies.zip(dofs));
        each.map(
            |((b, ((shifts, (given, packed)), outside)), ((moving, alpha), ((pivots, residuals), _)))| {
                given.clear();
                packed.clear();
                let (first, first_v) = (b.bodies.start, b.v.start);
                Run { call, first, first_v, outside, shifts, moving, pivots, alpha, residuals, given, packed }
            },
        )
        .collect()
    }
}

struct SweepOver<'r, 'a, T: Scalar, X> {
    run: &'r mut Run<'a, T>,
    numbers: Range<usize>,
    which: Sweeps,
    by: PhantomData<X>,
}

impl<T: Scalar, X: Carrying<T>> Kernel for SweepOver<'_, '_, T, X> {
    type Output = Result<(), DynamicsError>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let SweepOver { run, numbers, which, .. } = self;
        match which {
            Sweeps::Velocities => run.sweep_velocities::<false>(numbers),
            Sweeps::Filter => return X::inboard::<false>(run, numbers),
            Sweeps::Smoother => run.sweep_outboard::<false, X>(numbers),
        }
        Ok(())
    }
}

/// Velocities outward, the filter inward.
pub(super) struct Filter<'a, T: Scalar>(pub(super) Run<'a, T>);

impl<T: Scalar> Recursion for Filter<'_, T> {
    type Part<'b>
        = Filter<'b, T>
    where
        Self: 'b;
    fn outward(&mut self, bodies: Range<usize>) -> Result<(), DynamicsError> {
        self.0.sweep(self.0.numbers(bodies), Sweeps::Velocities)
    }
    fn parts<'b>(&'b mut self, branch: &'b Branch) -> Vec<Filter<'b, T>> {
        self.0.parts(branch).into_iter().map(Filter).collect()
    }
    fn take(&mut self, branch: usize) {
        self.0.given.take(branch);
        self.0.packed.take(branch);
    }
    fn inward(&mut self, bodies: Range<usize>) -> Result<(), DynamicsError> {
        self.0.sweep(self.0.numbers(bodies), Sweeps::Filter)
    }
}

/// The smoother outward.
pub(super) struct Smoother<'a, T: Scalar>(pub(super) Run<'a, T>);

impl<T: Scalar> Recursion for Smoother<'_, T> {
    type Part<'b>
        = Smoother<'b, T>
    where
        Self: 'b;
    fn outward(&mut self, bodies: Range<usize>) -> Result<(), DynamicsError> {
        self.0.sweep(self.0.numbers(bodies), Sweeps::Smoother)
    }
    fn parts<'b>(&'b mut self, branch: &'b Branch) -> Vec<Smoother<'b, T>> {
        self.0.parts(branch).into_iter().map(Smoother).collect()
    }
    fn take(&mut self, _: usize) {}
    fn inward(&mut self, _: Range<usize>) -> Result<(), DynamicsError> {
        Ok(())
    }
}
