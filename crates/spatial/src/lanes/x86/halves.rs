//! The lanes of one six-vector in two registers of four numbers, its halves. A register of eight would need fewer instructions but no less
//! time: Zen 4 takes two turns for each, Intel's units for single numbers rest beside them. A force has no lever, a turn of both halves one
//! coefficient: forward dynamics of an arm takes 0.87 of the time of one register (Zen 4). Where AVX2 has 16 registers, some numbers wait in
//! memory: 0.95 of the time of single numbers.

use crate::lanes::{Fused, Level};
use crate::six_lanes::{RIGID_COLUMNS, RigidEntries, SixLanes};
use core::arch::x86_64::*;
use core::ops::{Add, Mul, Neg, Sub};

/// A packed six-vector of plain numbers, its first and its second half.
#[derive(Clone, Copy, Debug)]
pub struct Halves(__m256d, __m256d);

// SAFETY of this file: as in the macro of `x86.rs`.
impl Add for Halves {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        unsafe { Halves(_mm256_add_pd(self.0, b.0), _mm256_add_pd(self.1, b.1)) }
    }
}
impl Sub for Halves {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        unsafe { Halves(_mm256_sub_pd(self.0, b.0), _mm256_sub_pd(self.1, b.1)) }
    }
}
impl Mul for Halves {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        unsafe { Halves(_mm256_mul_pd(self.0, b.0), _mm256_mul_pd(self.1, b.1)) }
    }
}
impl Neg for Halves {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        unsafe {
            let sign = _mm256_set1_pd(-0.0);
            Halves(_mm256_xor_pd(self.0, sign), _mm256_xor_pd(self.1, sign))
        }
    }
}

#[inline(always)]
unsafe fn four(x: Fused, y: Fused, z: Fused) -> __m256d {
    unsafe { _mm256_set_pd(0.0, z.0, y.0, x.0) }
}

macro_rules! both {
    ($x:expr, |$v:ident| $step:expr) => {
        unsafe {
            let first = {
                let $v = $x.0;
                $step
            };
            let second = {
                let $v = $x.1;
                $step
            };
            Halves(first, second)
        }
    };
}

impl SixLanes<Fused> for Halves {
    const IN_REGISTERS: bool = true;
    #[inline(always)]
    fn is_fast() -> bool {
        Level::best() >= Level::Avx2
    }
    #[inline(always)]
    fn of(x: [Fused; 8]) -> Self {
        let x: *const f64 = x.as_ptr().cast();
        unsafe { Halves(_mm256_loadu_pd(x), _mm256_loadu_pd(x.add(4))) }
    }
    #[inline(always)]
    fn to_array(self) -> [Fused; 8] {
        let mut out = [Fused(0.0); 8];
        let x: *mut f64 = out.as_mut_ptr().cast();
        unsafe {
            _mm256_storeu_pd(x, self.0);
            _mm256_storeu_pd(x.add(4), self.1);
        }
        out
    }
    #[inline(always)]
    fn fill(x: Fused) -> Self {
        let x = unsafe { _mm256_set1_pd(x.0) };
        Halves(x, x)
    }
    #[inline(always)]
    fn reciprocal(self) -> Self {
        let one = Self::fill(Fused(1.0));
        unsafe { Halves(_mm256_div_pd(one.0, self.0), _mm256_div_pd(one.1, self.1)) }
    }
    #[inline(always)]
    fn zeros() -> Self {
        // SAFETY: all zero bits are eight zeros; no instruction of AVX is needed.
        unsafe { core::mem::zeroed() }
    }
    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        unsafe { Halves(_mm256_fmadd_pd(self.0, a.0, b.0), _mm256_fmadd_pd(self.1, a.1, b.1)) }
    }
    #[inline(always)]
    fn subtract_from(self, a: Self, b: Self) -> Self {
        unsafe { Halves(_mm256_fnmadd_pd(self.0, a.0, b.0), _mm256_fnmadd_pd(self.1, a.1, b.1)) }
    }
    #[inline(always)]
    fn eliminate<const I: usize>(self, a: Self, b: Self) -> Self {
        let Halves(first, second) = self.subtract_from(a, b);
        let zero = unsafe { _mm256_setzero_pd() };
        unsafe {
            match I {
                2 => Halves(_mm256_blend_pd::<0b0100>(first, zero), second),
                6 => Halves(first, _mm256_blend_pd::<0b0100>(second, zero)),
                _ => unreachable!("axes are z axes"),
            }
        }
    }
    #[inline(always)]
    fn halves(x: Fused, y: Fused, z: Fused) -> Self {
        let v = unsafe { four(x, y, z) };
        Halves(v, v)
    }
    #[inline(always)]
    fn first_half(x: Fused, y: Fused, z: Fused) -> Self {
        unsafe { Halves(four(x, y, z), _mm256_setzero_pd()) }
    }
    #[inline(always)]
    fn swap_xy(self) -> Self {
        both!(self, |v| _mm256_permute4x64_pd::<0b11_10_00_01>(v))
    }
    #[inline(always)]
    fn swap_yz(self) -> Self {
        both!(self, |v| _mm256_permute4x64_pd::<0b11_01_10_00>(v))
    }
    #[inline(always)]
    fn yzx(self) -> Self {
        both!(self, |v| _mm256_permute4x64_pd::<0b11_00_10_01>(v))
    }
    #[inline(always)]
    fn zxy(self) -> Self {
        both!(self, |v| _mm256_permute4x64_pd::<0b11_01_00_10>(v))
    }
    #[inline(always)]
    fn levered(self, ahead: Self, back: Self) -> Self {
        unsafe {
            let (zxy, yzx) = (
                _mm256_permute4x64_pd::<0b11_01_00_10>(self.1),
                _mm256_permute4x64_pd::<0b11_00_10_01>(self.1),
            );
            let moment = _mm256_fmadd_pd(ahead.0, zxy, self.0);
            Halves(_mm256_fnmadd_pd(back.0, yzx, moment), self.1)
        }
    }
    #[inline(always)]
    fn broadcast<const I: usize>(self) -> Self {
        let x = unsafe {
            match I {
                0 => _mm256_permute4x64_pd::<0x00>(self.0),
                1 => _mm256_permute4x64_pd::<0x55>(self.0),
                2 => _mm256_permute4x64_pd::<0xaa>(self.0),
                4 => _mm256_permute4x64_pd::<0x00>(self.1),
                5 => _mm256_permute4x64_pd::<0x55>(self.1),
                _ => _mm256_permute4x64_pd::<0xaa>(self.1),
            }
        };
        Halves(x, x)
    }
    #[inline(always)]
    fn lane_0(self) -> Fused {
        unsafe { Fused(_mm256_cvtsd_f64(self.0)) }
    }
    #[inline(always)]
    fn with_lane_2(self, x: Self) -> Self {
        unsafe { Halves(_mm256_blend_pd::<0b0100>(self.0, x.0), self.1) }
    }
    #[inline(always)]
    fn rigid(m: &RigidEntries<f64>) -> [Self; 6] {
        let (mass, o) = (Fused(m[9]), Fused(0.0));
        unsafe {
            let [a, b, c] = [column::<0>(m), column::<3>(m), column::<6>(m)];
            let [x, y, z] = [column::<10>(m), column::<13>(m), column::<16>(m)];
            let sign = _mm256_set1_pd(-0.0);
            [
                Halves(a, _mm256_xor_pd(x, sign)),
                Halves(b, _mm256_xor_pd(y, sign)),
                Halves(c, _mm256_xor_pd(z, sign)),
                Halves(x, four(mass, o, o)),
                Halves(y, four(o, mass, o)),
                Halves(z, four(o, o, mass)),
            ]
        }
    }
    #[inline(always)]
    fn rigid_columns(m: &RigidEntries<Fused>) -> [Self; 6] {
        // Number by number: they are in registers, not in memory.
        let [a, b, c, d, e, f] = RIGID_COLUMNS;
        [picked(m, a), picked(m, b), picked(m, c), picked(m, d), picked(m, e), picked(m, f)]
    }
}

/// A column of three entries, and the next one.
#[inline(always)]
unsafe fn column<const I: usize>(m: &RigidEntries<f64>) -> __m256d {
    const { assert!(I + 4 <= 20) };
    unsafe { _mm256_loadu_pd(m.as_ptr().add(I)) }
}

#[inline(always)]
fn picked(m: &RigidEntries<Fused>, i: [usize; 8]) -> Halves {
    unsafe { Halves(four(m[i[0]], m[i[1]], m[i[2]]), four(m[i[4]], m[i[5]], m[i[6]])) }
}
