//! Order, choice and bits of the lanes.

use super::{F64x4, F64x8};
use crate::lanes::{BITS, EXPONENT_ZERO, ROOT_BITS};
use crate::ordered::Ordered;
use core::arch::x86_64::*;

/// Bits of a number that is one of [`BITS`], as the intrinsics take them.
const fn signed(bits: u64) -> i64 {
    bits as i64
}

impl Ordered for F64x4 {
    // SAFETY of this block and the next: as in the macro of the module above.
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { F64x4(_mm256_andnot_pd(_mm256_set1_pd(-0.0), self.0)) }
    }
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        unsafe { F64x4(_mm256_max_pd(self.0, other.0)) }
    }
    #[inline(always)]
    fn below(self, bound: Self, yes: Self, no: Self) -> Self {
        unsafe { F64x4(_mm256_blendv_pd(no.0, yes.0, _mm256_cmp_pd::<_CMP_LT_OQ>(self.0, bound.0))) }
    }
    #[inline(always)]
    fn choose(self, bits: u32, other: Self) -> Self {
        unsafe {
            let lanes = _mm256_setr_epi64x(1, 2, 4, 8);
            let set = _mm256_and_si256(_mm256_set1_epi64x(i64::from(bits)), lanes);
            let mask = _mm256_castsi256_pd(_mm256_cmpeq_epi64(set, lanes));
            F64x4(_mm256_blendv_pd(other.0, self.0, mask))
        }
    }
    #[inline(always)]
    fn reciprocal_root_guess(self) -> Self {
        unsafe {
            let half = _mm256_srli_epi64::<1>(_mm256_castpd_si256(self.0));
            F64x4(_mm256_castsi256_pd(_mm256_sub_epi64(_mm256_set1_epi64x(signed(ROOT_BITS)), half)))
        }
    }
    #[inline(always)]
    fn times_power_of_two(self, shifted: Self) -> Self {
        unsafe {
            let n = _mm256_slli_epi64::<52>(_mm256_castpd_si256(shifted.0));
            F64x4(_mm256_castsi256_pd(_mm256_add_epi64(_mm256_castpd_si256(self.0), n)))
        }
    }
    #[inline(always)]
    fn mantissa_and_exponent(self) -> (Self, Self) {
        unsafe {
            let bits = _mm256_castpd_si256(self.0);
            let moved = _mm256_add_epi64(bits, _mm256_set1_epi64x(signed(BITS[1] - BITS[0])));
            let biased = _mm256_srli_epi64::<52>(moved);
            let m = _mm256_sub_epi64(bits, _mm256_slli_epi64::<52>(biased));
            let m = _mm256_add_epi64(m, _mm256_set1_epi64x(signed(BITS[1])));
            let k = _mm256_castsi256_pd(_mm256_or_si256(biased, _mm256_set1_epi64x(signed(BITS[2]))));
            let k = _mm256_sub_pd(k, _mm256_set1_pd(EXPONENT_ZERO));
            (F64x4(_mm256_castsi256_pd(m)), F64x4(k))
        }
    }
}

impl Ordered for F64x8 {
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { F64x8(_mm512_abs_pd(self.0)) }
    }
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        unsafe { F64x8(_mm512_max_pd(self.0, other.0)) }
    }
    #[inline(always)]
    fn below(self, bound: Self, yes: Self, no: Self) -> Self {
        unsafe {
            let below = _mm512_cmp_pd_mask::<_CMP_LT_OQ>(self.0, bound.0);
            F64x8(_mm512_mask_blend_pd(below, no.0, yes.0))
        }
    }
    #[inline(always)]
    fn choose(self, bits: u32, other: Self) -> Self {
        unsafe { F64x8(_mm512_mask_blend_pd(bits as u8, other.0, self.0)) }
    }
    #[inline(always)]
    fn reciprocal_root_guess(self) -> Self {
        unsafe {
            let half = _mm512_srli_epi64::<1>(_mm512_castpd_si512(self.0));
            F64x8(_mm512_castsi512_pd(_mm512_sub_epi64(_mm512_set1_epi64(signed(ROOT_BITS)), half)))
        }
    }
    #[inline(always)]
    fn times_power_of_two(self, shifted: Self) -> Self {
        unsafe {
            let n = _mm512_slli_epi64::<52>(_mm512_castpd_si512(shifted.0));
            F64x8(_mm512_castsi512_pd(_mm512_add_epi64(_mm512_castpd_si512(self.0), n)))
        }
    }
    #[inline(always)]
    fn mantissa_and_exponent(self) -> (Self, Self) {
        unsafe {
            let bits = _mm512_castpd_si512(self.0);
            let moved = _mm512_add_epi64(bits, _mm512_set1_epi64(signed(BITS[1] - BITS[0])));
            let biased = _mm512_srli_epi64::<52>(moved);
            let m = _mm512_sub_epi64(bits, _mm512_slli_epi64::<52>(biased));
            let m = _mm512_add_epi64(m, _mm512_set1_epi64(signed(BITS[1])));
            let k = _mm512_castsi512_pd(_mm512_or_si512(biased, _mm512_set1_epi64(signed(BITS[2]))));
            let k = _mm512_sub_pd(k, _mm512_set1_pd(EXPONENT_ZERO));
            (F64x8(_mm512_castsi512_pd(m)), F64x8(k))
        }
    }
}
