//! Energies of pairs in the generalized Born model, at given radii; symbols as in `generalized_born`.

use super::generalized_born::Columns;
use super::sweep::{At, PairKernel, push};
use phipsi_spatial::lanes::Lanes;

/// Sums forces at constant B, then ∂E/∂B.
pub(super) struct Pairs<'a> {
    pub columns: &'a Columns,
    /// κ₂.
    pub kappa: f64,
    /// What the cutoff takes from 1/f.
    pub shift: f64,
    /// Infinite without a cutoff.
    pub cutoff_square: f64,
}

/// Of a row −κ₂ q, B, 1/(4 B); of a column q, B, 1/(4 B).
type Numbers<T> = [T; 3];

impl PairKernel<4> for Pairs<'_> {
    const CUTOFF: bool = true;
    type Row<T: Lanes> = Numbers<T>;
    type Column<T: Lanes> = Numbers<T>;

    #[inline(always)]
    fn cutoff_square(&self) -> f64 {
        self.cutoff_square
    }
    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> Numbers<T> {
        let Columns { charge, born, inverse_born, .. } = self.columns;
        [
            T::splat(-self.kappa * charge[place].0),
            T::broadcast(born[place]),
            T::splat(0.25 * inverse_born[place].0),
        ]
    }
    #[inline(always)]
    fn column<T: Lanes>(&self, first: usize) -> Numbers<T> {
        let Columns { charge, born, inverse_born, .. } = self.columns;
        [T::load(&charge[first..]), T::load(&born[first..]), T::load(&inverse_born[first..]) * T::splat(0.25)]
    }
    #[inline(always)]
    fn pair<T: Lanes>(
        &self,
        row: &Numbers<T>,
        column: &Numbers<T>,
        at: At<'_, T>,
        row_sums: &mut [T; 4],
        column_sums: &mut [T; 4],
    ) -> T {
        let product = row[1] * column[1];
        // r²/(4 Bᵢ) and r²/(4 Bⱼ).
        let (by_row, by_column) = (at.square * row[2], at.square * column[2]);
        let e = (by_row * (column[2] * T::splat(-4.0))).exp();
        let inverse_f = product.fma(e, at.square).reciprocal_root();
        let charges = at.only(row[0] * column[0]);
        let by_f2 = T::splat(-0.5) * charges * inverse_f * (inverse_f * inverse_f);
        let by_born = by_f2 * e;
        row_sums[3] = by_born.fma(column[1] + by_row, row_sums[3]);
        column_sums[3] = by_born.fma(row[1] + by_column, column_sums[3]);
        let force = by_f2 * e.fma(T::splat(0.5), T::splat(-2.0));
        push(force, &at.d, row_sums, column_sums);
        charges * (inverse_f - T::splat(self.shift))
    }
}
