//! The lanes of one six-vector in a register of eight numbers.

use super::F64x8;
use crate::lanes::{Fused, Level};
use crate::six_lanes::{RIGID_COLUMNS, RigidEntries, SixLanes};
use core::arch::x86_64::*;

/// The lanes of one six-vector of plain numbers.
impl SixLanes<Fused> for F64x8 {
    const IN_REGISTERS: bool = true;
    #[inline(always)]
    fn is_fast() -> bool {
        Level::best() == Level::Avx512
    }
    #[inline(always)]
    fn of(x: [Fused; 8]) -> Self {
        // SAFETY of this block: as in the macro above.
        unsafe { F64x8(_mm512_loadu_pd(x.as_ptr().cast())) }
    }
    #[inline(always)]
    fn to_array(self) -> [Fused; 8] {
        let mut out = [Fused(0.0); 8];
        unsafe { _mm512_storeu_pd(out.as_mut_ptr().cast(), self.0) };
        out
    }
    #[inline(always)]
    fn fill(x: Fused) -> Self {
        unsafe { F64x8(_mm512_set1_pd(x.0)) }
    }
    #[inline(always)]
    fn zeros() -> Self {
        // SAFETY: all zero bits are eight zeros; no instruction of AVX-512 is needed.
        unsafe { core::mem::zeroed() }
    }
    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        unsafe { F64x8(_mm512_fmadd_pd(self.0, a.0, b.0)) }
    }
    #[inline(always)]
    fn subtract_from(self, a: Self, b: Self) -> Self {
        unsafe { F64x8(_mm512_fnmadd_pd(self.0, a.0, b.0)) }
    }
    #[inline(always)]
    fn eliminate<const I: usize>(self, a: Self, b: Self) -> Self {
        unsafe { F64x8(_mm512_maskz_fnmadd_pd(!(1 << I), self.0, a.0, b.0)) }
    }
    #[inline(always)]
    fn halves(x: Fused, y: Fused, z: Fused) -> Self {
        unsafe { F64x8(in_lanes(x, y, z, &HALVES)) }
    }
    #[inline(always)]
    fn first_half(x: Fused, y: Fused, z: Fused) -> Self {
        unsafe { F64x8(in_lanes(x, y, z, &FIRST_HALF)) }
    }
    #[inline(always)]
    fn about_z(cos: Fused, sin: Fused) -> (Self, Self) {
        unsafe {
            let (s, c, rest) = (TURNS[0].as_ptr(), TURNS[2].as_ptr(), TURNS[3].as_ptr());
            let cosine = _mm512_fmadd_pd(_mm512_set1_pd(cos.0), _mm512_loadu_pd(c), _mm512_loadu_pd(rest));
            (F64x8(cosine), F64x8(_mm512_mul_pd(_mm512_set1_pd(sin.0), _mm512_loadu_pd(s))))
        }
    }
    #[inline(always)]
    fn about_x(cos: Fused, sin: Fused) -> (Self, Self) {
        unsafe {
            let (s, c, rest) = (TURNS[1].as_ptr(), TURNS[4].as_ptr(), TURNS[5].as_ptr());
            let cosine = _mm512_fmadd_pd(_mm512_set1_pd(cos.0), _mm512_loadu_pd(c), _mm512_loadu_pd(rest));
            (F64x8(cosine), F64x8(_mm512_mul_pd(_mm512_set1_pd(sin.0), _mm512_loadu_pd(s))))
        }
    }
    #[inline(always)]
    fn swap_xy(self) -> Self {
        unsafe { F64x8(_mm512_permutex_pd::<0b11_10_00_01>(self.0)) }
    }
    #[inline(always)]
    fn swap_yz(self) -> Self {
        unsafe { F64x8(_mm512_permutex_pd::<0b11_01_10_00>(self.0)) }
    }
    #[inline(always)]
    fn yzx(self) -> Self {
        unsafe { F64x8(_mm512_permutex_pd::<0b11_00_10_01>(self.0)) }
    }
    #[inline(always)]
    fn zxy(self) -> Self {
        unsafe { F64x8(_mm512_permutex_pd::<0b11_01_00_10>(self.0)) }
    }
    #[inline(always)]
    fn second_zxy(self) -> Self {
        unsafe { F64x8(_mm512_permutexvar_pd(lanes_of([6, 4, 5, 7, 6, 4, 5, 7]), self.0)) }
    }
    #[inline(always)]
    fn second_yzx(self) -> Self {
        unsafe { F64x8(_mm512_permutexvar_pd(lanes_of([5, 6, 4, 7, 5, 6, 4, 7]), self.0)) }
    }
    #[inline(always)]
    fn broadcast<const I: usize>(self) -> Self {
        unsafe { F64x8(_mm512_permutexvar_pd(_mm512_set1_epi64(I as i64), self.0)) }
    }
    #[inline(always)]
    fn lane_0(self) -> Fused {
        unsafe { Fused(_mm512_cvtsd_f64(self.0)) }
    }
    #[inline(always)]
    fn with_lane_2(self, x: Self) -> Self {
        unsafe { F64x8(_mm512_mask_mov_pd(self.0, 0x04, x.0)) }
    }
    #[inline(always)]
    fn first_three(x: &[Fused]) -> Self {
        let x: &[Fused] = &x[..3];
        unsafe { F64x8(_mm512_maskz_loadu_pd(0b111, x.as_ptr().cast())) }
    }
    #[inline(always)]
    fn rigid(m: &RigidEntries<f64>) -> [Self; 6] {
        unsafe { columns(m.as_ptr()) }
    }
    #[inline(always)]
    fn rigid_columns(m: &RigidEntries<Fused>) -> [Self; 6] {
        unsafe { columns(m.as_ptr().cast()) }
    }
}

/// The columns of a rigid inertia, whose 16 entries begin at `m`.
#[inline(always)]
unsafe fn columns(m: *const f64) -> [F64x8; 6] {
    let [a, b, c, d, e, f] = RIGID_COLUMNS;
    unsafe {
        let (low, high) = (_mm512_loadu_pd(m), _mm512_loadu_pd(m.add(8)));
        [
            F64x8(_mm512_permutex2var_pd(low, lanes_of(a), high)),
            F64x8(_mm512_permutex2var_pd(low, lanes_of(b), high)),
            F64x8(_mm512_permutex2var_pd(low, lanes_of(c), high)),
            F64x8(_mm512_permutex2var_pd(low, lanes_of(d), high)),
            F64x8(_mm512_permutex2var_pd(low, lanes_of(e), high)),
            F64x8(_mm512_permutex2var_pd(low, lanes_of(f), high)),
        ]
    }
}

/// x a + y b + z c for unit patterns: products with constants in memory, where masks would have to be made each time.
#[inline(always)]
unsafe fn in_lanes(x: Fused, y: Fused, z: Fused, patterns: &[[f64; 8]; 3]) -> __m512d {
    unsafe {
        let all = _mm512_mul_pd(_mm512_set1_pd(x.0), _mm512_loadu_pd(patterns[0].as_ptr()));
        let all = _mm512_fmadd_pd(_mm512_set1_pd(y.0), _mm512_loadu_pd(patterns[1].as_ptr()), all);
        _mm512_fmadd_pd(_mm512_set1_pd(z.0), _mm512_loadu_pd(patterns[2].as_ptr()), all)
    }
}

/// x, y and z of both halves.
const HALVES: [[f64; 8]; 3] = [
    [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
];

/// x, y and z of the first half.
const FIRST_HALF: [[f64; 8]; 3] = [
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
];

/// s (−e₀ + e₁) and s (−e₁ + e₂) of both halves; c (e₀ + e₁) + e₂ and e₀ + c (e₁ + e₂).
const TURNS: [[f64; 8]; 6] = [
    [-1.0, 1.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0],
    [0.0, -1.0, 1.0, 0.0, 0.0, -1.0, 1.0, 0.0],
    [1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    [0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0],
    [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
];

#[inline(always)]
unsafe fn lanes_of(i: [usize; 8]) -> __m512i {
    unsafe {
        _mm512_set_epi64(
            i[7] as i64,
            i[6] as i64,
            i[5] as i64,
            i[4] as i64,
            i[3] as i64,
            i[2] as i64,
            i[1] as i64,
            i[0] as i64,
        )
    }
}
