//! The kernels of closed loops, compiled in this crate for the numbers that are used: they are large, and a generic function is
//! compiled again in every crate that calls it.

// Nobody outside can name `Kernels`.
#![allow(private_interfaces)]

use crate::closed_dynamics::{Rates, Solve};
use crate::closure_compliance::Gather;
use crate::factors::Update;
use crate::frames::{Place, Turn};
use crate::number::Arithmetic;
use crate::projection::Root;
use crate::solution::{ConstraintForce, LeastNorm, Run};
use phipsi_recursion::DynamicsError;
use phipsi_spatial::{Dd, Real, Scalar};

/// A number that closed loops are computed with: f64, f32, or `Dd` with its 32 digits.
pub trait Number: Real + Kernels {}

impl<T: Real + Kernels> Number for T {}

/// Gives a macro all kernels with their results.
macro_rules! kernels {
    ($then:ident $($t:ty)?) => {
        $then! {
            $($t;)?
            place(Place<'_, Self>) -> (),
            turn(Turn<'_, Self>) -> (),
            update(Update<'_, Self>) -> Result<(), DynamicsError>,
            solve(Run<'_, Self>) -> (),
            rates(Rates<'_, '_, Self>) -> f64,
            solve_by_square_roots(Solve<'_, Self>) -> Result<(), DynamicsError>,
            least_norm(LeastNorm<'_, Self>) -> (),
            constraint_force(ConstraintForce<'_, Self>) -> (),
            multiply_by_root(Root<'_, Self>) -> (),
            gather_compliance(Gather<'_, Self>) -> (),
        }
    };
}

macro_rules! declare {
    ($($name:ident($kernel:ty) -> $output:ty,)*) => {
        /// Runs a kernel with the instructions that its numbers need.
        pub trait Kernels: Real {
            $(fn $name(kernel: $kernel) -> $output {
                Arithmetic::<Self>::dispatch(kernel)
            })*
        }
    };
}
kernels!(declare);

macro_rules! compile {
    ($t:ty; $($name:ident($kernel:ty) -> $output:ty,)*) => {
        impl Kernels for $t {
            $(fn $name(kernel: $kernel) -> $output {
                Arithmetic::<Self>::dispatch(kernel)
            })*
        }
    };
}
kernels!(compile f64);
kernels!(compile Dd);

// Compiled where it is used.
impl Kernels for f32 {}
