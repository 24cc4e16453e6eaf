//! How the filter carries P and z inward: as numbers, or as six-vectors in lanes.

use super::{Moved, Run};
use crate::error::DynamicsError;
use crate::layout::GROUND;
use crate::packed::{Packed, is_lone};
use core::ops::Range;
use phipsi_spatial::{RigidInertia, Scalar, SixLanes};

/// Six-vectors of what kernels on `T` compute with, in the lanes of one register.
type Six<T> = <<T as Scalar>::Arithmetic as Scalar>::Six;
/// The same in two registers.
type Halves<T> = <<T as Scalar>::Arithmetic as Scalar>::Halves;

/// Where the six-vectors of one state lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lanes {
    Numbers,
    Six,
    Halves,
}

impl Lanes {
    /// The fastest of this processor.
    #[inline(always)]
    pub(super) fn of<T: Scalar>() -> Self {
        match is_lone::<T>() && Six::<T>::IN_REGISTERS {
            true if Halves::<T>::is_fast() => Lanes::Halves,
            true if Six::<T>::is_fast() => Lanes::Six,
            _ => Lanes::Numbers,
        }
    }
}

/// The inward sweep of a way of carrying.
pub(super) trait Carrying<T: Scalar> {
    /// True if six-vectors are in lanes.
    const PACKED: bool;
    fn inboard<const WHOLE: bool>(run: &mut Run<'_, T>, numbers: Range<usize>) -> Result<(), DynamicsError>;
    /// Before the trunk of limbs in lanes is met: nothing is in hand.
    fn begin(run: &mut Run<'_, T>);
    /// Takes what a limb whose first body is `root` gives to its parent.
    fn take(run: &mut Run<'_, T>, root: usize, moved: &Moved<T::Arithmetic>);
}

pub(super) struct InNumbers;
pub(super) struct InSix;
pub(super) struct InHalves;

impl<T: Scalar> Carrying<T> for InNumbers {
    const PACKED: bool = false;
    #[inline(always)]
    fn inboard<const WHOLE: bool>(run: &mut Run<'_, T>, numbers: Range<usize>) -> Result<(), DynamicsError> {
        run.sweep_inboard::<WHOLE>(numbers)
    }
    #[inline(always)]
    fn begin(_: &mut Run<'_, T>) {}
    #[inline(always)]
    fn take(run: &mut Run<'_, T>, root: usize, (P, z): &Moved<T::Arithmetic>) {
        let body = &run.call.layout.bodies[root];
        if body.follows_parent(root) {
            // What goes to the next body gets its own inertia, too.
            let own = &run.call.layout.bodies[body.parent].inertia;
            run.given.hand = (P.plus_rigid(&RigidInertia::constant(own)), *z);
        } else if body.parent != GROUND {
            run.given.pending.put(&(*P, *z));
        }
    }
}

impl<T: Scalar> Carrying<T> for InSix {
    const PACKED: bool = true;
    #[inline(always)]
    fn inboard<const WHOLE: bool>(run: &mut Run<'_, T>, numbers: Range<usize>) -> Result<(), DynamicsError> {
        run.sweep_inboard_packed::<WHOLE, Six<T>>(numbers)
    }
    #[inline(always)]
    fn begin(run: &mut Run<'_, T>) {
        run.packed.hand = Packed::<Six<T>>::zero().to();
    }
    #[inline(always)]
    fn take(run: &mut Run<'_, T>, root: usize, moved: &Moved<T::Arithmetic>) {
        take_packed(run, root, moved);
    }
}

impl<T: Scalar> Carrying<T> for InHalves {
    const PACKED: bool = true;
    #[inline(always)]
    fn inboard<const WHOLE: bool>(run: &mut Run<'_, T>, numbers: Range<usize>) -> Result<(), DynamicsError> {
        run.sweep_inboard_packed::<WHOLE, Halves<T>>(numbers)
    }
    #[inline(always)]
    fn begin(run: &mut Run<'_, T>) {
        run.packed.hand = Packed::<Halves<T>>::zero().to();
    }
    #[inline(always)]
    fn take(run: &mut Run<'_, T>, root: usize, moved: &Moved<T::Arithmetic>) {
        take_packed(run, root, moved);
    }
}

#[inline(always)]
fn take_packed<T: Scalar>(run: &mut Run<'_, T>, root: usize, (P, z): &Moved<T::Arithmetic>) {
    let body = &run.call.layout.bodies[root];
    if body.follows_parent(root) {
        run.packed.hand = Packed::pack(P, z);
    } else if body.parent != GROUND {
        run.packed.pending.put(&Packed::pack(P, z));
    }
}

/// A step with the type of a way of carrying; types without lanes have one.
macro_rules! carried {
    ($lanes:expr, |$X:ident| $step:expr) => {
        if <<T::Arithmetic as Scalar>::Six as SixLanes<T::Arithmetic>>::IN_REGISTERS {
            match $lanes {
                $crate::forward_dynamics::carrying::Lanes::Numbers => {
                    type $X = $crate::forward_dynamics::carrying::InNumbers;
                    $step
                }
                $crate::forward_dynamics::carrying::Lanes::Six => {
                    type $X = $crate::forward_dynamics::carrying::InSix;
                    $step
                }
                $crate::forward_dynamics::carrying::Lanes::Halves => {
                    type $X = $crate::forward_dynamics::carrying::InHalves;
                    $step
                }
            }
        } else {
            type $X = $crate::forward_dynamics::carrying::InNumbers;
            $step
        }
    };
}
pub(super) use carried;

#[cfg(test)]
mod tests {
    use super::super::{ForwardDynamics, Whole};
    use super::*;
    use crate::layout::Layout;
    use core::marker::PhantomData;
    use phipsi_reference::generate::{Case, case};
    use phipsi_spatial::lanes::Level;

    fn run<X: Carrying<f64>>(layout: &Layout, case: &Case) -> Option<Vec<f64>> {
        let (mut work, mut out) = (ForwardDynamics::<f64>::new(layout), case.tau.clone());
        let (q, v) = (f64::arithmetic(&case.q), f64::arithmetic(&case.v));
        let (out_numbers, loaded, by) = (f64::arithmetic_mut(&mut out), false, PhantomData::<X>);
        let whole = Whole { work: &mut work, layout, q, v, loaded, out: out_numbers, by };
        <f64 as Scalar>::Arithmetic::dispatch(whole).ok().map(|()| out)
    }

    /// A processor takes one of them: on those that could take both, results have the same bits.
    #[test]
    fn one_register_and_two_give_the_same_bits() {
        if Level::best() < Level::Avx512 {
            println!("this processor has no {}", Level::Avx512.name());
            return;
        }
        let mut compared = 0;
        for seed in 0..300 {
            let case = case(seed);
            let layout = Layout::new(&case.model);
            if layout.is_flexible() {
                continue;
            }
            let [six, halves] = [run::<InSix>(&layout, &case), run::<InHalves>(&layout, &case)];
            assert_eq!(six, halves, "seed {seed}");
            compared += 1;
        }
        assert!(compared > 200, "{compared}");
    }
}
