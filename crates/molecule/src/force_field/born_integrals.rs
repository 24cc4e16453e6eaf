//! The integrals of generalized Born radii, and the forces through them; symbols as in `generalized_born`.
//!
//! L and U depend on r, but their slopes cancel in ∂I/∂r, except where the atom i lies inside j and the last part of the
//! bracket is missing: 2/L² remains there.

use super::generalized_born::Columns;
use super::sweep::{At, PairKernel};
use phipsi_spatial::lanes::Lanes;

/// Sums the brackets of each place, and keeps −½/r times their slopes in r: of the first place's, then of the second's.
pub(super) struct Integrals<'a, const INSIDE: bool>(pub &'a Columns);

impl<const INSIDE: bool> Integrals<'_, INSIDE> {
    /// Numbers kept.
    pub(super) const NUMBERS: usize = 2;
}

impl<const INSIDE: bool> PairKernel<1> for Integrals<'_, INSIDE> {
    const KEPT: usize = Self::NUMBERS;
    /// o, 1/o, s.
    type Row<T: Lanes> = [T; 3];
    type Column<T: Lanes> = [T; 3];

    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> [T; 3] {
        let Columns { offset_radius, inverse_offset_radius, scaled_radius, .. } = self.0;
        [
            T::broadcast(offset_radius[place]),
            T::broadcast(inverse_offset_radius[place]),
            T::broadcast(scaled_radius[place]),
        ]
    }
    #[inline(always)]
    fn column<T: Lanes>(&self, first: usize) -> [T; 3] {
        let Columns { offset_radius, inverse_offset_radius, scaled_radius, .. } = self.0;
        [
            T::load(&offset_radius[first..]),
            T::load(&inverse_offset_radius[first..]),
            T::load(&scaled_radius[first..]),
        ]
    }
    #[inline(always)]
    fn pair<T: Lanes>(
        &self,
        row: &[T; 3],
        column: &[T; 3],
        mut at: At<'_, T>,
        row_sums: &mut [T; 1],
        column_sums: &mut [T; 1],
    ) -> T {
        let inverse_r = at.square.reciprocal_root();
        let r = at.square * inverse_r;
        let (of_row, row_slope) = bracket::<T, INSIDE>(r, inverse_r, row[0], row[1], column[2]);
        let (of_column, column_slope) = bracket::<T, INSIDE>(r, inverse_r, column[0], column[1], row[2]);
        row_sums[0] += at.only(of_row);
        column_sums[0] += at.only(of_column);
        let scale = T::splat(-0.5) * inverse_r;
        let (first, second) = (at.only(row_slope * scale), at.only(column_slope * scale));
        at.keep(0, first);
        at.keep(1, second);
        T::zero()
    }
}

/// The bracket in I and its slope in r.
#[inline(always)]
fn bracket<T: Lanes, const INSIDE: bool>(r: T, inverse_r: T, o: T, inverse_o: T, s: T) -> (T, T) {
    let upper = r + s;
    let lower = (r - s).abs().larger(o);
    let inverse = (upper * lower).recip();
    let (inverse_u, inverse_l) = (lower * inverse, upper * inverse);
    let difference = inverse_u - inverse_l;
    let squares = T::splat(0.25) * difference * (inverse_u + inverse_l);
    let log = T::splat(0.5) * (lower * inverse_u).ln() * inverse_r;
    let ratio = s * inverse_r;
    let mut sum = s.fma(-ratio, r).fma(squares, log - difference);
    let mut slope = ratio.fma(ratio, T::one()).fma(squares, -(log * inverse_r));
    let depth = s - r;
    if INSIDE {
        let more = T::splat(2.0) * (inverse_o - inverse_l);
        sum += o.below(depth, more, T::zero());
    } else {
        slope += o.below(depth, T::splat(2.0) * inverse_l * inverse_l, T::zero());
    }
    (o.below(upper, sum, T::zero()), o.below(upper, slope, T::zero()))
}

/// Forces through the radii, from the slopes that [`Integrals`] kept.
pub(super) struct Chain<'a>(pub &'a Columns);

impl PairKernel<3> for Chain<'_> {
    const KEPT: usize = Integrals::<true>::NUMBERS;
    /// ∂E/∂I.
    type Row<T: Lanes> = T;
    type Column<T: Lanes> = T;

    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> T {
        T::broadcast(self.0.slopes[place])
    }
    #[inline(always)]
    fn column<T: Lanes>(&self, first: usize) -> T {
        T::load(&self.0.slopes[first..])
    }
    #[inline(always)]
    fn pair<T: Lanes>(
        &self,
        row: &T,
        column: &T,
        at: At<'_, T>,
        row_sums: &mut [T; 3],
        column_sums: &mut [T; 3],
    ) -> T {
        let force = row.fma(at.kept(0), *column * at.kept(1));
        let opposite = -force;
        for k in 0..3 {
            row_sums[k] = opposite.fma(at.d[k], row_sums[k]);
            column_sums[k] = force.fma(at.d[k], column_sums[k]);
        }
        T::zero()
    }
}
