//! A run of bodies in the sweeps of inverse dynamics, and the sweeps over branches.

use super::Moving;
use crate::branching::{Given, Recursion};
use crate::error::DynamicsError;
use crate::layout::{Branch, GROUND, Layout, ShiftRun, carve};
use core::ops::Range;
use phipsi_spatial::{Kernel, Motion, Scalar, Vec3, Wrench};

/// What all runs of bodies share in a call.
#[derive(Clone, Copy)]
pub(super) struct Call<'a, T: Scalar> {
    pub(super) layout: &'a Layout<T::Constant>,
    pub(super) q: &'a [T::Arithmetic],
    pub(super) v: &'a [T::Arithmetic],
    pub(super) a: &'a [T::Arithmetic],
    pub(super) loads: Option<&'a [Wrench<T::Arithmetic>]>,
}

/// A run of bodies. Slices begin at its first body and degree of freedom; those of the call at the layout's.
pub(super) struct Run<'a, T: Scalar> {
    pub(super) call: Call<'a, T>,
    pub(super) first: usize,
    pub(super) first_v: usize,
    /// Motion of the parent that is not in the run.
    pub(super) outside: Moving<T::Arithmetic>,
    pub(super) shifts: ShiftRun<'a, T::Arithmetic>,
    pub(super) moving: &'a mut [Moving<T::Arithmetic>],
    pub(super) force: &'a mut [Wrench<T::Arithmetic>],
    pub(super) out: &'a mut [T::Arithmetic],
    pub(super) given: &'a mut Given<Wrench<T::Arithmetic>>,
}

/// Which sweeps.
#[derive(Clone, Copy)]
enum Sweeps {
    Outboard,
    Inboard,
}

impl<'a, T: Scalar> Run<'a, T> {
    /// Sweeps over some bodies of the run, by their numbers in it.
    fn sweep(&mut self, numbers: Range<usize>, which: Sweeps) {
        T::Arithmetic::dispatch(SweepOver { run: self, numbers, which });
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
}

struct SweepOver<'r, 'a, T: Scalar> {
    run: &'r mut Run<'a, T>,
    numbers: Range<usize>,
    which: Sweeps,
}

impl<T: Scalar> Kernel for SweepOver<'_, '_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let SweepOver { run, numbers, which } = self;
        match which {
            Sweeps::Outboard => run.sweep_outboard::<false>(numbers),
            Sweeps::Inboard => run.sweep_inboard::<false>(numbers),
        }
    }
}

impl<T: Scalar> Recursion for Run<'_, T> {
    type Part<'b>
        = Run<'b, T>
    where
        Self: 'b;
    fn outward(&mut self, bodies: Range<usize>) -> Result<(), DynamicsError> {
        self.sweep(self.numbers(bodies), Sweeps::Outboard);
        Ok(())
    }
    fn parts<'b>(&'b mut self, branch: &'b Branch) -> Vec<Run<'b, T>> {
        let (call, first, runs) = (self.call, self.first, &branch.branches);
        let ground = (Vec3::zero(), Motion::new(Vec3::zero(), -Vec3::constant(call.layout.gravity)));
        let outside: Vec<_> = runs
            .iter()
            .map(|b| match b.outside {
                GROUND => ground,
                parent if parent < first => self.outside,
                parent => self.moving[parent - first],
            })
            .collect();
        let bodies = || runs.iter().map(|b| b.bodies.clone());
        let v = branch.by_v.iter().map(|&i| runs[i].v.clone());
        let mut out: Vec<_> = carve(self.out, self.first_v, v).into_iter().zip(&branch.by_v).collect();
        out.sort_unstable_by_key(|(_, i)| **i);
        let bodies = carve(self.moving, first, bodies()).into_iter().zip(carve(self.force, first, bodies()));
        let shared = self.shifts.carve(branch).into_iter().zip(&mut self.given.branches).zip(outside);
        let each = runs.iter().zip(shared).zip(bodies.zip(out));
        each.map(|((b, ((shifts, given), outside)), ((moving, force), (out, _)))| {
            given.clear();
            let (first, first_v) = (b.bodies.start, b.v.start);
            Run { call, first, first_v, outside, shifts, moving, force, out, given }
        })
        .collect()
    }
    fn take(&mut self, branch: usize) {
        self.given.take(branch);
    }
    fn inward(&mut self, bodies: Range<usize>) -> Result<(), DynamicsError> {
        self.sweep(self.numbers(bodies), Sweeps::Inboard);
        Ok(())
    }
}
