//! Rows of numbers, one row a state, to lanes and back: tiles of four numbers, turned in registers.
//!
//! Numbers written one by one to a register's place in memory could be read as a whole only after all had reached the cache.
//! The last tile overlaps the one before it where the numbers are no multiple of four; fewer than four go one by one.

use super::{F64x4, F64x8};
use core::arch::x86_64::*;

/// Numbers of a tile.
const WIDTH: usize = 4;

macro_rules! rows {
    ($t:ident, $n:literal, $pack:ident, $unpack:ident, $one:ident, $read:ident, $write:ident) => {
        /// [`Lanes::pack`](super::Lanes::pack).
        ///
        /// # Safety
        /// The processor has the instructions.
        #[inline(always)]
        pub(super) unsafe fn $pack(rows: &[&[f64]], out: &mut [$t]) {
            let n = out.len();
            let mut starts = [core::ptr::null(); $n];
            for (start, row) in starts.iter_mut().zip(rows) {
                *start = row.as_ptr();
                if row.len() < n {
                    return;
                }
            }
            if rows.len() < $n {
                return;
            }
            // SAFETY: every row and `out` have n numbers, and a tile ends at n.
            unsafe {
                let mut at = 0;
                while n < WIDTH && at < n {
                    out[at] = $one(&starts, at);
                    at += 1;
                }
                while at < n {
                    let here = at.min(n - WIDTH);
                    $read(&starts, here, out.as_mut_ptr().add(here));
                    at += WIDTH;
                }
            }
        }
        /// [`Lanes::unpack`](super::Lanes::unpack).
        ///
        /// # Safety
        /// The processor has the instructions.
        #[inline(always)]
        pub(super) unsafe fn $unpack(x: &[$t], out: &mut [f64]) {
            let n = x.len();
            if n < WIDTH {
                for (lane, row) in out.chunks_exact_mut(n.max(1)).take($n).enumerate() {
                    for (to, x) in row.iter_mut().zip(x) {
                        *to = super::Lanes::lane(*x, lane);
                    }
                }
                return;
            }
            let rows = (out.len() / n).min($n);
            let mut at = 0;
            while at < n {
                let here = at.min(n - WIDTH);
                // SAFETY: `out` has `rows` rows of n numbers, x has n, and a tile ends at n.
                unsafe { $write(x.as_ptr().add(here), out.as_mut_ptr().add(here), n, rows) };
                at += WIDTH;
            }
        }
    };
}

rows!(F64x8, 8, pack8, unpack8, one8, read8, write8);
rows!(F64x4, 4, pack4, unpack4, one4, read4, write4);

// SAFETY of what follows: rows have four numbers from `at` on (one: one), `out` and `x` four registers.

#[inline(always)]
unsafe fn one8(rows: &[*const f64; 8], at: usize) -> F64x8 {
    unsafe {
        let [a, b, c, d, e, f, g, h] = *rows;
        F64x8(_mm512_setr_pd(
            *a.add(at),
            *b.add(at),
            *c.add(at),
            *d.add(at),
            *e.add(at),
            *f.add(at),
            *g.add(at),
            *h.add(at),
        ))
    }
}

#[inline(always)]
unsafe fn one4(rows: &[*const f64; 4], at: usize) -> F64x4 {
    unsafe {
        let [a, b, c, d] = *rows;
        F64x4(_mm256_setr_pd(*a.add(at), *b.add(at), *c.add(at), *d.add(at)))
    }
}

/// Four numbers of two rows in one register.
#[inline(always)]
unsafe fn two_rows(a: *const f64, b: *const f64, at: usize) -> __m512d {
    unsafe {
        let low = _mm512_castpd256_pd512(_mm256_loadu_pd(a.add(at)));
        _mm512_insertf64x4::<1>(low, _mm256_loadu_pd(b.add(at)))
    }
}

#[inline(always)]
unsafe fn read8(rows: &[*const f64; 8], at: usize, out: *mut F64x8) {
    unsafe {
        let [a, b, c, d, e, f, g, h] = *rows;
        // Rows two apart, so that pairs of rows come out in order.
        let (ac, bd) = (two_rows(a, c, at), two_rows(b, d, at));
        let (eg, fh) = (two_rows(e, g, at), two_rows(f, h, at));
        // Numbers 0 and 2, then 1 and 3, of rows in pairs.
        let (first, second) = (_mm512_unpacklo_pd(ac, bd), _mm512_unpacklo_pd(eg, fh));
        *out = F64x8(_mm512_shuffle_f64x2::<0x88>(first, second));
        *out.add(2) = F64x8(_mm512_shuffle_f64x2::<0xdd>(first, second));
        let (first, second) = (_mm512_unpackhi_pd(ac, bd), _mm512_unpackhi_pd(eg, fh));
        *out.add(1) = F64x8(_mm512_shuffle_f64x2::<0x88>(first, second));
        *out.add(3) = F64x8(_mm512_shuffle_f64x2::<0xdd>(first, second));
    }
}

#[inline(always)]
unsafe fn write8(x: *const F64x8, out: *mut f64, size: usize, rows: usize) {
    unsafe {
        let [a, b, c, d] = [(*x).0, (*x.add(1)).0, (*x.add(2)).0, (*x.add(3)).0];
        let near = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11);
        let far = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
        let (ab, cd) = (_mm512_unpacklo_pd(a, b), _mm512_unpacklo_pd(c, d));
        let even = [_mm512_permutex2var_pd(ab, near, cd), _mm512_permutex2var_pd(ab, far, cd)];
        let (ab, cd) = (_mm512_unpackhi_pd(a, b), _mm512_unpackhi_pd(c, d));
        let odd = [_mm512_permutex2var_pd(ab, near, cd), _mm512_permutex2var_pd(ab, far, cd)];
        let tile = [
            _mm512_castpd512_pd256(even[0]),
            _mm512_castpd512_pd256(odd[0]),
            _mm512_extractf64x4_pd::<1>(even[0]),
            _mm512_extractf64x4_pd::<1>(odd[0]),
            _mm512_castpd512_pd256(even[1]),
            _mm512_castpd512_pd256(odd[1]),
            _mm512_extractf64x4_pd::<1>(even[1]),
            _mm512_extractf64x4_pd::<1>(odd[1]),
        ];
        for (row, numbers) in tile.iter().enumerate() {
            if row < rows {
                _mm256_storeu_pd(out.add(row * size), *numbers);
            }
        }
    }
}

#[inline(always)]
unsafe fn turned4([a, b, c, d]: [__m256d; 4]) -> [__m256d; 4] {
    unsafe {
        let (even, odd) = (_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b));
        let (next_even, next_odd) = (_mm256_unpacklo_pd(c, d), _mm256_unpackhi_pd(c, d));
        [
            _mm256_permute2f128_pd::<0x20>(even, next_even),
            _mm256_permute2f128_pd::<0x20>(odd, next_odd),
            _mm256_permute2f128_pd::<0x31>(even, next_even),
            _mm256_permute2f128_pd::<0x31>(odd, next_odd),
        ]
    }
}

#[inline(always)]
unsafe fn read4(rows: &[*const f64; 4], at: usize, out: *mut F64x4) {
    unsafe {
        let [a, b, c, d] = *rows;
        let [a, b, c, d] = turned4([
            _mm256_loadu_pd(a.add(at)),
            _mm256_loadu_pd(b.add(at)),
            _mm256_loadu_pd(c.add(at)),
            _mm256_loadu_pd(d.add(at)),
        ]);
        (*out, *out.add(1), *out.add(2), *out.add(3)) = (F64x4(a), F64x4(b), F64x4(c), F64x4(d));
    }
}

#[inline(always)]
unsafe fn write4(x: *const F64x4, out: *mut f64, size: usize, rows: usize) {
    unsafe {
        let tile = turned4([(*x).0, (*x.add(1)).0, (*x.add(2)).0, (*x.add(3)).0]);
        for (row, numbers) in tile.iter().enumerate() {
            if row < rows {
                _mm256_storeu_pd(out.add(row * size), *numbers);
            }
        }
    }
}
