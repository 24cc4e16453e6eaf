//! How the filter carries P and z inward: as numbers, or as six-vectors in lanes.

use super::{Moved, Run};
use crate::error::DynamicsError;
use crate::layout::GROUND;
use crate::packed::{Packed, is_lone};
use core::ops::Range;
use phipsi_spatial::{RigidInertia, Scalar, SixLanes};

/// Six-vectors of what kernels on `T` compute with, in lanes.
type Six<T> = <<T as Scalar>::Arithmetic as Scalar>::Six;

/// Where the six-vectors of one state lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lanes {
    Numbers,
    Six,
}

impl Lanes {
    /// The fastest of this processor.
    #[inline(always)]
    pub(super) fn of<T: Scalar>() -> Self {
        let six = is_lone::<T>() && Six::<T>::IN_REGISTERS && Six::<T>::is_fast();
        if six { Lanes::Six } else { Lanes::Numbers }
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
        run.sweep_inboard_packed::<WHOLE>(numbers)
    }
    #[inline(always)]
    fn begin(run: &mut Run<'_, T>) {
        run.packed.hand = Packed::zero::<T::Arithmetic>();
    }
    #[inline(always)]
    fn take(run: &mut Run<'_, T>, root: usize, (P, z): &Moved<T::Arithmetic>) {
        let body = &run.call.layout.bodies[root];
        if body.follows_parent(root) {
            run.packed.hand = Packed::pack(P, z);
        } else if body.parent != GROUND {
            run.packed.pending.put(&Packed::pack(P, z));
        }
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
            }
        } else {
            type $X = $crate::forward_dynamics::carrying::InNumbers;
            $step
        }
    };
}
pub(super) use carried;
