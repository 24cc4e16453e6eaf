//! The integrals of generalized Born radii, and the forces through them; symbols as in `generalized_born`.
//!
//! L and U depend on r, but their slopes cancel in ∂I/∂r, except where the atom i lies inside j and the last part of the
//! bracket is missing: 2/L² remains there.

use super::generalized_born::Columns;
use super::sweep::{At, PairKernel, push};
use phipsi_spatial::lanes::Lanes;

/// Numbers of a pair that [`Integrals`] keeps for [`Chain`]: −½/r times the slopes in r of the first place's bracket, and of the
/// second's.
pub(super) const KEPT: usize = 2;

/// Sums the brackets of each place.
#[derive(Clone, Copy)]
pub(super) struct Integrals<'a, const KEEPS: bool> {
    pub columns: &'a Columns,
    /// True if the bracket has its last part.
    pub inside: bool,
    /// Infinite without a cutoff.
    pub cutoff_square: f64,
}

impl<const KEEPS: bool> Integrals<'_, KEEPS> {
    /// The brackets of both places, and the numbers to keep.
    #[inline(always)]
    fn brackets<T: Lanes>(&self, row: &[T; 3], column: &[T; 3], at: &At<'_, T>) -> ([T; 2], [T; 2]) {
        let inverse_r = at.square.reciprocal_root();
        let r = at.square * inverse_r;
        let (of_row, row_slope) = bracket(self.inside, [r, inverse_r], row[0], row[1], column[2]);
        let (of_column, column_slope) = bracket(self.inside, [r, inverse_r], column[0], column[1], row[2]);
        let scale = T::splat(-0.5) * inverse_r;
        ([at.only(of_row), at.only(of_column)], [at.only(row_slope * scale), at.only(column_slope * scale)])
    }
}

impl<const KEEPS: bool> PairKernel<1> for Integrals<'_, KEEPS> {
    const KEPT: usize = if KEEPS { KEPT } else { 0 };
    const CUTOFF: bool = true;
    /// o, 1/o, s.
    type Row<T: Lanes> = [T; 3];
    type Column<T: Lanes> = [T; 3];

    #[inline(always)]
    fn cutoff_square(&self) -> f64 {
        self.cutoff_square
    }
    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> [T; 3] {
        let Columns { offset_radius, inverse_offset_radius, scaled_radius, .. } = self.columns;
        [
            T::broadcast(offset_radius[place]),
            T::broadcast(inverse_offset_radius[place]),
            T::broadcast(scaled_radius[place]),
        ]
    }
    #[inline(always)]
    fn column<T: Lanes>(&self, first: usize) -> [T; 3] {
        let Columns { offset_radius, inverse_offset_radius, scaled_radius, .. } = self.columns;
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
        let (brackets, slopes) = self.brackets(row, column, &at);
        row_sums[0] += brackets[0];
        column_sums[0] += brackets[1];
        if KEEPS {
            at.keep(0, slopes[0]);
            at.keep(1, slopes[1]);
        }
        T::zero()
    }
}

/// The bracket in I and its slope in r.
#[inline(always)]
fn bracket<T: Lanes>(inside: bool, [r, inverse_r]: [T; 2], o: T, inverse_o: T, s: T) -> (T, T) {
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
    if inside {
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
    const KEPT: usize = KEPT;
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
        push(row.fma(at.kept(0), *column * at.kept(1)), &at.d, row_sums, column_sums);
        T::zero()
    }
}

/// The same, from slopes computed again.
pub(super) struct ChainAgain<'a>(pub Integrals<'a, false>);

impl PairKernel<3> for ChainAgain<'_> {
    const CUTOFF: bool = true;
    /// ∂E/∂I; o, 1/o, s.
    type Row<T: Lanes> = (T, [T; 3]);
    type Column<T: Lanes> = (T, [T; 3]);

    #[inline(always)]
    fn cutoff_square(&self) -> f64 {
        self.0.cutoff_square
    }
    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> (T, [T; 3]) {
        (Chain(self.0.columns).row(place), self.0.row(place))
    }
    #[inline(always)]
    fn column<T: Lanes>(&self, first: usize) -> (T, [T; 3]) {
        (Chain(self.0.columns).column(first), self.0.column(first))
    }
    #[inline(always)]
    fn pair<T: Lanes>(
        &self,
        row: &(T, [T; 3]),
        column: &(T, [T; 3]),
        at: At<'_, T>,
        row_sums: &mut [T; 3],
        column_sums: &mut [T; 3],
    ) -> T {
        let (_, slopes) = self.0.brackets(&row.1, &column.1, &at);
        push(row.0.fma(slopes[0], column.0 * slopes[1]), &at.d, row_sums, column_sums);
        T::zero()
    }
}
