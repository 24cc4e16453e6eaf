//! Lanes in the registers of x86-64.

use super::*;
use crate::wide::WIDEST;
use core::arch::x86_64::*;

mod four;
mod halves;
mod ordered;
mod rows;

pub use four::Four;
pub use halves::Halves;
use rows::{pack4, pack8, unpack4, unpack8};

/// Runs a kernel compiled for AVX2 and FMA.
///
/// # Safety
/// The processor has both.
#[target_feature(enable = "avx2,fma")]
pub(super) unsafe fn with_fma<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

/// Runs a kernel compiled for AVX-512. Without VL, numbers in the upper 16 registers are moved 64 bytes at a time, and a processor that
/// joins two of its units for that has one less for all that is scalar.
///
/// # Safety
/// The processor has AVX-512F, VL, DQ and BW, AVX2 and FMA.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
pub(super) unsafe fn with_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

/// Four states.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct F64x4(__m256d);

/// Eight states.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct F64x8(__m512d);

/// A step for each row of a tile, whose number is a constant: an array of registers then needs no memory.
macro_rules! each_row {
    ($n:literal, $i:ident => $step:expr) => {
        each_row!($n, $i => $step; 0 1 2 3 4 5 6 7)
    };
    ($n:literal, $i:ident => $step:expr; $($number:literal)*) => {$(
        if $number < $n {
            const $i: usize = $number;
            $step
        }
    )*};
}

/// A slice has `count` rows of as many numbers, `stride` apart. No sum overflows: slices have fewer numbers than an eighth of what can be
/// counted.
#[inline(always)]
fn check_rows(count: usize, stride: usize, x: &[Fused]) {
    // Without numbers in its message, which would be stored each time.
    assert!(
        stride <= x.len() && (count - 1) * stride + count <= x.len(),
        "a matrix has fewer rows or columns than a register has numbers"
    );
}

macro_rules! lanes {
    (
        $t:ident, $n:literal, $with:ident, $set:ident, $load:ident, $store:ident,
        $add:ident, $sub:ident, $mul:ident, $div:ident, $fma:ident, $sqrt:ident,
        negate: $negate:ident, all: $all:ident, size: $size:ident, turn: $turn:ident,
        insert: $insert:ident, up_to: $up_to:ident, between: $between:ident,
        store_from: $store_from:ident, store_between: $store_between:ident, load_first: $load_first:ident,
        store_first: $store_first:ident, transpose: $transpose:ident, pack: $pack:ident, unpack: $unpack:ident
    ) => {
        // SAFETY of this macro: a value of the type exists only after the processor was asked (see the module above).
        impl Add for $t {
            type Output = Self;
            #[inline(always)]
            fn add(self, b: Self) -> Self {
                unsafe { $t($add(self.0, b.0)) }
            }
        }
        impl Sub for $t {
            type Output = Self;
            #[inline(always)]
            fn sub(self, b: Self) -> Self {
                unsafe { $t($sub(self.0, b.0)) }
            }
        }
        impl Mul for $t {
            type Output = Self;
            #[inline(always)]
            fn mul(self, b: Self) -> Self {
                unsafe { $t($mul(self.0, b.0)) }
            }
        }
        impl Div for $t {
            type Output = Self;
            #[inline(always)]
            fn div(self, b: Self) -> Self {
                unsafe { $t($div(self.0, b.0)) }
            }
        }
        impl Neg for $t {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                unsafe { $t($negate(self.0)) }
            }
        }
        assigning_operators!($t);
        impl $t {
            #[inline(always)]
            fn to_array(self) -> [f64; $n] {
                let mut out = [0.0; $n];
                unsafe { $store(out.as_mut_ptr(), self.0) };
                out
            }
            #[inline(always)]
            fn from_array(x: [f64; $n]) -> Self {
                unsafe { $t($load(x.as_ptr())) }
            }
        }
        impl PartialEq for $t {
            fn eq(&self, b: &Self) -> bool {
                self.to_array() == b.to_array()
            }
        }
        impl Scalar for $t {
            type Constant = f64;
            type Abreast = Four;
            const LANES: usize = $n;
            const EPSILON: f64 = f64::EPSILON;
            crate::arithmetic_is_self!();
            #[inline(always)]
            fn splat(x: f64) -> Self {
                unsafe { $t($set(x)) }
            }
            #[inline(always)]
            fn constant(x: f64) -> Self {
                unsafe { $t($set(x)) }
            }
            #[inline(always)]
            fn fma(self, a: Self, b: Self) -> Self {
                unsafe { $t($fma(self.0, a.0, b.0)) }
            }
            #[inline(always)]
            fn recip(self) -> Self {
                Self::splat(1.0) / self
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                unsafe { $t($sqrt(self.0)) }
            }
            #[inline(always)]
            fn sin_cos(self) -> (Self, Self) {
                sin_cos(self)
            }
            #[inline(always)]
            fn is_positive(self) -> bool {
                unsafe { $all(self.0, $set(0.0), $set(f64::INFINITY)) }
            }
            fn min_lane(self) -> f64 {
                self.to_array().into_iter().fold(f64::INFINITY, f64::min)
            }
            #[inline(always)]
            fn first_lane(self) -> f64 {
                self.to_array()[0]
            }
            #[inline(always)]
            fn dispatch<K: Kernel>(kernel: K) -> K::Output {
                unsafe { $with(kernel) }
            }
        }
        impl Lanes for $t {
            #[inline(always)]
            fn from_lanes(f: impl FnMut(usize) -> f64) -> Self {
                Self::from_array(core::array::from_fn(f))
            }
            #[inline(always)]
            fn lane(self, i: usize) -> f64 {
                self.to_array()[i]
            }
            numbers_in_memory!();
            #[inline(always)]
            fn pack(rows: &[&[f64]], out: &mut [Self]) {
                unsafe { $pack(rows, out) }
            }
            #[inline(always)]
            fn unpack(x: &[Self], out: &mut [f64]) {
                unsafe { $unpack(x, out) }
            }
        }
        impl Wide<Fused> for $t {
            const COUNT: usize = $n;
            #[inline(always)]
            fn load(x: &[Fused]) -> Self {
                let x = &x[..$n];
                unsafe { $t($load(x.as_ptr().cast())) }
            }
            #[inline(always)]
            fn store(self, x: &mut [Fused]) {
                let x = &mut x[..$n];
                unsafe { $store(x.as_mut_ptr().cast(), self.0) }
            }
            #[inline(always)]
            fn load_first(x: &[Fused]) -> Self {
                unsafe { $t($load_first(x)) }
            }
            #[inline(always)]
            fn store_first(self, x: &mut [Fused]) {
                unsafe { $store_first(x, self.0) }
            }
            #[inline(always)]
            fn transpose(tile: &mut [Self; WIDEST]) {
                unsafe { $transpose(tile) }
            }
            #[inline(always)]
            fn store_from(self, first: usize, x: &mut [Fused]) {
                if first < $n {
                    let x = &mut x[..$n - first];
                    unsafe { $store_from(x, first, self.0) }
                }
            }
            #[inline(always)]
            fn store_between(self, from: usize, to: usize, x: &mut [Fused]) {
                let x = &mut x[..$n];
                unsafe { $store_between(x, from, to, self.0) }
            }
            #[inline(always)]
            fn load_rows(stride: usize, x: &[Fused]) -> [Self; WIDEST] {
                check_rows($n, stride, x);
                let (x, mut tile) = (x.as_ptr().cast::<f64>(), [Self::zero(); WIDEST]);
                each_row!($n, I => tile[I] = unsafe { $t($load(x.add(I * stride))) });
                tile
            }
            #[inline(always)]
            fn store_rows(tile: &[Self; WIDEST], stride: usize, x: &mut [Fused]) {
                check_rows($n, stride, x);
                let x = x.as_mut_ptr().cast::<f64>();
                each_row!($n, I => unsafe { $store(x.add(I * stride), tile[I].0) });
            }
            #[inline(always)]
            fn broadcast(x: Fused) -> Self {
                Self::splat(x.0)
            }
            #[inline(always)]
            fn with(self, lane: usize, x: Fused) -> Self {
                unsafe { $t($insert(self.0, lane, x.0)) }
            }
            #[inline(always)]
            fn up_to(self, place: usize, others: Self) -> Self {
                unsafe { $t($up_to(self.0, place, others.0)) }
            }
            #[inline(always)]
            fn between(self, from: usize, to: usize) -> Self {
                unsafe { $t($between(self.0, from, to)) }
            }
        }
        impl Quadrants for $t {
            #[inline(always)]
            fn turn(shifted: Self, sin: Self, cos: Self) -> (Self, Self) {
                let (s, c) = unsafe { $turn(shifted.0, sin.0, cos.0) };
                ($t(s), $t(c))
            }
            #[inline(always)]
            fn within(self, limit: f64) -> bool {
                unsafe { $all($size(self.0), $set(-1.0), $set(limit)) }
            }
            #[cold]
            #[inline(never)]
            fn by_library(self, limit: f64, sin: Self, cos: Self) -> (Self, Self) {
                let (x, mut s, mut c) = (self.to_array(), sin.to_array(), cos.to_array());
                for i in 0..$n {
                    // Written so that NaN, too, asks the library.
                    if !matches!(x[i].abs().partial_cmp(&limit), Some(o) if o.is_lt()) {
                        (s[i], c[i]) = x[i].sin_cos();
                    }
                }
                (Self::from_array(s), Self::from_array(c))
            }
        }
    };
}

lanes!(
    F64x4, 4, with_fma, _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd,
    _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd, _mm256_div_pd, _mm256_fmadd_pd, _mm256_sqrt_pd,
    negate: negate4, all: all_between4, size: size4, turn: turn4,
    insert: insert4, up_to: up_to4, between: between4,
    store_from: store_from4, store_between: store_between4, load_first: load_first4, store_first: store_first4,
    transpose: transpose4, pack: pack4, unpack: unpack4
);

lanes!(
    F64x8, 8, with_avx512, _mm512_set1_pd, _mm512_loadu_pd, _mm512_storeu_pd,
    _mm512_add_pd, _mm512_sub_pd, _mm512_mul_pd, _mm512_div_pd, _mm512_fmadd_pd, _mm512_sqrt_pd,
    negate: negate8, all: all_between8, size: _mm512_abs_pd, turn: turn8,
    insert: insert8, up_to: up_to8, between: between8,
    store_from: store_from8, store_between: store_between8, load_first: load_first8, store_first: store_first8,
    transpose: transpose8, pack: pack8, unpack: unpack8
);

// Functions, for closures cannot be made to inline. SAFETY: as in the macro.

#[inline(always)]
unsafe fn negate4(x: __m256d) -> __m256d {
    unsafe { _mm256_xor_pd(x, _mm256_set1_pd(-0.0)) }
}

#[inline(always)]
unsafe fn size4(x: __m256d) -> __m256d {
    unsafe { _mm256_andnot_pd(_mm256_set1_pd(-0.0), x) }
}

#[inline(always)]
unsafe fn all_between4(x: __m256d, low: __m256d, high: __m256d) -> bool {
    unsafe {
        let above = _mm256_cmp_pd::<_CMP_GT_OQ>(x, low);
        _mm256_movemask_pd(_mm256_and_pd(above, _mm256_cmp_pd::<_CMP_LT_OQ>(x, high))) == 0xf
    }
}

#[inline(always)]
unsafe fn turn4(shifted: __m256d, s: __m256d, c: __m256d) -> (__m256d, __m256d) {
    unsafe {
        let n = _mm256_castpd_si256(shifted);
        let odd = _mm256_castsi256_pd(_mm256_slli_epi64::<63>(n));
        let (two, next) = (_mm256_set1_epi64x(2), _mm256_add_epi64(n, _mm256_set1_epi64x(1)));
        let sign = _mm256_slli_epi64::<62>(_mm256_and_si256(n, two));
        let next_sign = _mm256_slli_epi64::<62>(_mm256_and_si256(next, two));
        (
            _mm256_xor_pd(_mm256_blendv_pd(s, c, odd), _mm256_castsi256_pd(sign)),
            _mm256_xor_pd(_mm256_blendv_pd(c, s, odd), _mm256_castsi256_pd(next_sign)),
        )
    }
}

#[inline(always)]
unsafe fn negate8(x: __m512d) -> __m512d {
    unsafe { flip(x, _mm512_castpd_si512(_mm512_set1_pd(-0.0))) }
}

#[inline(always)]
unsafe fn all_between8(x: __m512d, low: __m512d, high: __m512d) -> bool {
    unsafe { _mm512_cmp_pd_mask::<_CMP_GT_OQ>(x, low) & _mm512_cmp_pd_mask::<_CMP_LT_OQ>(x, high) == 0xff }
}

#[inline(always)]
unsafe fn turn8(shifted: __m512d, s: __m512d, c: __m512d) -> (__m512d, __m512d) {
    unsafe {
        let n = _mm512_castpd_si512(shifted);
        let odd = _mm512_test_epi64_mask(n, _mm512_set1_epi64(1));
        let (two, next) = (_mm512_set1_epi64(2), _mm512_add_epi64(n, _mm512_set1_epi64(1)));
        let sign = _mm512_slli_epi64::<62>(_mm512_and_si512(n, two));
        let next_sign = _mm512_slli_epi64::<62>(_mm512_and_si512(next, two));
        (flip(_mm512_mask_blend_pd(odd, s, c), sign), flip(_mm512_mask_blend_pd(odd, c, s), next_sign))
    }
}

/// Changes signs; the instruction on f64 itself belongs to AVX-512DQ.
#[inline(always)]
unsafe fn flip(x: __m512d, sign: __m512i) -> __m512d {
    unsafe { _mm512_castsi512_pd(_mm512_xor_si512(_mm512_castpd_si512(x), sign)) }
}

/// Windows of these are masks: read, a mask costs one instruction, where one that is compared becomes a dozen once a loop keeps it.
static BEFORE: [u64; 12] = [0, 0, 0, 0, !0, !0, !0, !0, 0, 0, 0, 0];
static ONE: [u64; 9] = [0, 0, 0, 0, !0, 0, 0, 0, 0];

/// All bits set in the lanes before `lane`.
#[inline(always)]
unsafe fn before4(lane: usize) -> __m256d {
    unsafe { _mm256_loadu_pd(BEFORE.as_ptr().add(8 - lane.min(4)).cast()) }
}

/// All bits set in the lanes from `lane` on.
#[inline(always)]
unsafe fn from4(lane: usize) -> __m256d {
    unsafe { _mm256_loadu_pd(BEFORE.as_ptr().add(4 - lane.min(4)).cast()) }
}

#[inline(always)]
unsafe fn insert4(x: __m256d, lane: usize, number: f64) -> __m256d {
    unsafe {
        let here = _mm256_loadu_pd(ONE.as_ptr().add(4 - lane.min(4)).cast());
        _mm256_blendv_pd(x, _mm256_set1_pd(number), here)
    }
}

#[inline(always)]
unsafe fn insert8(x: __m512d, lane: usize, number: f64) -> __m512d {
    unsafe { _mm512_mask_broadcastsd_pd(x, 1u8.wrapping_shl(lane as u32), _mm_set_sd(number)) }
}

#[inline(always)]
unsafe fn up_to4(x: __m256d, lane: usize, others: __m256d) -> __m256d {
    unsafe { _mm256_blendv_pd(others, x, before4(lane)) }
}

#[inline(always)]
unsafe fn up_to8(x: __m512d, lane: usize, others: __m512d) -> __m512d {
    unsafe { _mm512_mask_blend_pd(0xffu32.wrapping_shl(lane as u32) as u8, x, others) }
}

#[inline(always)]
unsafe fn between4(x: __m256d, from: usize, to: usize) -> __m256d {
    unsafe { _mm256_and_pd(x, places4(from, to)) }
}

/// All bits set from place `from` on and before place `to`.
#[inline(always)]
unsafe fn places4(from: usize, to: usize) -> __m256d {
    unsafe { _mm256_and_pd(from4(from), before4(to)) }
}

#[inline(always)]
unsafe fn between8(x: __m512d, from: usize, to: usize) -> __m512d {
    unsafe { _mm512_maskz_mov_pd(places8(from, to), x) }
}

/// A bit for each place from `from` on and before `to`.
#[inline(always)]
fn places8(from: usize, to: usize) -> u8 {
    (0xffu32.wrapping_shl(from as u32) & !0xffu32.wrapping_shl(to as u32)) as u8
}

/// `out` has as many numbers as there are places.
#[inline(always)]
unsafe fn store_between4(out: &mut [Fused], from: usize, to: usize, x: __m256d) {
    // Stores with a mask take a dozen cycles on processors without AVX-512.
    let out = out.as_mut_ptr().cast::<f64>();
    unsafe { _mm256_storeu_pd(out, _mm256_blendv_pd(_mm256_loadu_pd(out), x, places4(from, to))) }
}

/// `out` has as many numbers as there are places.
#[inline(always)]
unsafe fn store_between8(out: &mut [Fused], from: usize, to: usize, x: __m512d) {
    unsafe { _mm512_mask_storeu_pd(out.as_mut_ptr().cast(), places8(from, to), x) }
}

/// `to` has as many numbers as there are lanes from `first` on, at least one.
#[inline(always)]
unsafe fn store_from4(to: &mut [Fused], first: usize, x: __m256d) {
    let to = to.as_mut_ptr().cast::<f64>();
    unsafe {
        let high = _mm256_extractf128_pd::<1>(x);
        match first {
            0 => _mm256_storeu_pd(to, x),
            1 => {
                _mm_storeh_pd(to, _mm256_castpd256_pd128(x));
                _mm_storeu_pd(to.add(1), high);
            }
            2 => _mm_storeu_pd(to, high),
            _ => _mm_storeh_pd(to, high),
        }
    }
}

/// `to` has as many numbers as there are lanes from `first` on, at least one.
#[inline(always)]
unsafe fn store_from8(to: &mut [Fused], first: usize, x: __m512d) {
    // The lanes before `first` are not written: their addresses need not exist.
    let mask = 0xffu8.wrapping_shl(first as u32);
    unsafe { _mm512_mask_storeu_pd(to.as_mut_ptr().cast::<f64>().wrapping_sub(first), mask, x) }
}

#[inline(always)]
unsafe fn load_first4(x: &[Fused]) -> __m256d {
    unsafe { _mm256_maskload_pd(x.as_ptr().cast(), _mm256_castpd_si256(before4(x.len()))) }
}

#[inline(always)]
unsafe fn store_first4(to: &mut [Fused], x: __m256d) {
    let count = to.len();
    let to = to.as_mut_ptr().cast::<f64>();
    unsafe {
        let (low, high) = (_mm256_castpd256_pd128(x), _mm256_extractf128_pd::<1>(x));
        match count {
            0 => (),
            1 => _mm_store_sd(to, low),
            2 => _mm_storeu_pd(to, low),
            3 => {
                _mm_storeu_pd(to, low);
                _mm_store_sd(to.add(2), high);
            }
            _ => _mm256_storeu_pd(to, x),
        }
    }
}

/// A bit for each of as many lanes as there are numbers.
#[inline(always)]
fn some8(count: usize) -> u8 {
    (0xffu16 >> (8 - count.min(8))) as u8
}

#[inline(always)]
unsafe fn load_first8(x: &[Fused]) -> __m512d {
    unsafe { _mm512_maskz_loadu_pd(some8(x.len()), x.as_ptr().cast()) }
}

#[inline(always)]
unsafe fn store_first8(to: &mut [Fused], x: __m512d) {
    unsafe { _mm512_mask_storeu_pd(to.as_mut_ptr().cast(), some8(to.len()), x) }
}

#[inline(always)]
unsafe fn transpose4(tile: &mut [F64x4; WIDEST]) {
    unsafe {
        let [a, b, c, d] = [tile[0].0, tile[1].0, tile[2].0, tile[3].0];
        let (ab, cd) = (_mm256_unpacklo_pd(a, b), _mm256_unpacklo_pd(c, d));
        tile[0].0 = _mm256_permute2f128_pd::<0x20>(ab, cd);
        tile[2].0 = _mm256_permute2f128_pd::<0x31>(ab, cd);
        let (ab, cd) = (_mm256_unpackhi_pd(a, b), _mm256_unpackhi_pd(c, d));
        tile[1].0 = _mm256_permute2f128_pd::<0x20>(ab, cd);
        tile[3].0 = _mm256_permute2f128_pd::<0x31>(ab, cd);
    }
}

#[inline(always)]
unsafe fn transpose8(tile: &mut [F64x8; WIDEST]) {
    unsafe {
        let [a, b, c, d, e, f, g, h] = *tile;
        let (a, b, c, d, e, f, g, h) = (a.0, b.0, c.0, d.0, e.0, f.0, g.0, h.0);
        let even = [
            _mm512_unpacklo_pd(a, b),
            _mm512_unpacklo_pd(c, d),
            _mm512_unpacklo_pd(e, f),
            _mm512_unpacklo_pd(g, h),
        ];
        let odd = [
            _mm512_unpackhi_pd(a, b),
            _mm512_unpackhi_pd(c, d),
            _mm512_unpackhi_pd(e, f),
            _mm512_unpackhi_pd(g, h),
        ];
        let [even, odd] = [pairs8(even), pairs8(odd)];
        for i in 0..4 {
            (tile[2 * i], tile[2 * i + 1]) = (F64x8(even[i]), F64x8(odd[i]));
        }
    }
}

/// Numbers 2i of eight rows from four that hold two rows each: pairs of numbers of a row become neighbours.
#[inline(always)]
unsafe fn pairs8([a, b, c, d]: [__m512d; 4]) -> [__m512d; 4] {
    unsafe {
        let (ab_even, cd_even) = (_mm512_shuffle_f64x2::<0x88>(a, b), _mm512_shuffle_f64x2::<0x88>(c, d));
        let (ab_odd, cd_odd) = (_mm512_shuffle_f64x2::<0xdd>(a, b), _mm512_shuffle_f64x2::<0xdd>(c, d));
        [
            _mm512_shuffle_f64x2::<0x88>(ab_even, cd_even),
            _mm512_shuffle_f64x2::<0x88>(ab_odd, cd_odd),
            _mm512_shuffle_f64x2::<0xdd>(ab_even, cd_even),
            _mm512_shuffle_f64x2::<0xdd>(ab_odd, cd_odd),
        ]
    }
}
