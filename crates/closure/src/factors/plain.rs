//! The plain form of the factorisation: loops by their squared rows, without fronts.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | C | rows of a loop on the acceleration of a body, articulated | m×6 | paper 2 §4.6, ψB |
//! | w | U^−*(HC* + E), as in the mixed form | r×m | |
//! | Ω | Σ w*w over the joints that a loop passes: D^−½HψB squared | m×m | paper 2 (4.18)–(4.20) |
//! | Ω_o | the same of two loops that are open at the same joints | m×m_o | |
//! | L | Ω = LL* at the ancestor, with diagonal pivoting | m×rank | |
//! | B_C, B_o | L⁻¹C, L⁻¹Ω_o | | |
//! | c | right-hand side of a loop, b = L⁻¹c | m | |
//!
//! A loop reads Cα + Ωλ + Ω_o λ_o = c on the body that its branches have come to. Joints: Ω += w*w, C −= w*Ξ. At the ancestor
//! L*λ = b − B_C α − B_o λ_o, and what the others and the body see is P += B_C*B_C, Ω_oo −= B_o*B_o, C_o −= B_o*B_C.
//!
//! L* is the R of the mixed form, −B_C its X₁ and B_o its W'_o: they are kept in the same places, so that one substitution gives
//! the multipliers of both. What squares hide below √ε is not guessed: a pivot is kept if it is certainly one, and a row left out
//! if its own w is rounding; anything else is a doubt, and the state is for the mixed form.

use super::{Done, Factors};
use crate::compiled::Number;
use crate::frames::Frames;
use crate::number::{Arithmetic, larger};
use crate::reflections::{GROUP, add_scaled};
use crate::structure::{LoopKind, Operation, Structure};
use crate::tree::Tree;
use phipsi_recursion::hinge::Hinge;
use phipsi_spatial::{Scalar, Wrench};

/// Pivots of Ω over the square of their loop's scale that are kept: σ above 1e-4, where squares have half of the digits.
const KEPT: f64 = 1e-8;

/// Where the product of columns from `a` and from `b` on of one row of numbers is added up.
#[derive(Clone, Copy, Debug)]
struct Pair {
    a: usize,
    b: usize,
    rows: usize,
    /// A whole number of groups in w, where what is too much is zero.
    columns: usize,
    /// First number, and numbers from row to row.
    start: usize,
    width: usize,
}

/// What passes one joint.
#[derive(Clone, Debug, Default)]
pub(crate) struct Front {
    /// First number of w, `width` for each degree of freedom, and first row of C.
    pub(crate) w: usize,
    pub(crate) c: usize,
    pub(crate) width: usize,
    /// First column of each loop in w: whole groups for each.
    pub(crate) columns: Vec<usize>,
    pairs: Vec<Pair>,
}

/// What one closing changes of other loops.
#[derive(Clone, Debug, Default)]
struct Coupled {
    /// Ω.
    pairs: Vec<Pair>,
    /// C of those that are closed here later.
    here: Vec<Pair>,
}

/// Why a state is not for the plain form: a pivot that may be one, or rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Doubt {
    pub(crate) closure: usize,
    pub(crate) row: usize,
    /// Its size over the scale of its loop.
    pub(crate) pivot: f64,
}

/// Numbers of the plain form; none in a workspace that has only the mixed one.
#[derive(Clone, Debug)]
pub(crate) struct Plain<T: Scalar> {
    /// The factors are those of the plain form.
    pub(crate) used: bool,
    pub(crate) doubt: Option<Doubt>,
    /// One per body.
    pub(crate) fronts: Vec<Front>,
    /// One per operation.
    coupled: Vec<Coupled>,
    pub(crate) w: Vec<Arithmetic<T>>,
    /// C before each joint.
    pub(crate) c: Vec<Wrench<Arithmetic<T>>>,
    /// Σ w² of every row, before others are taken out.
    own: Vec<Arithmetic<T>>,
}

impl<T: Number> Plain<T> {
    pub(crate) fn none() -> Self {
        Plain {
            used: false,
            doubt: None,
            fronts: Vec::new(),
            coupled: Vec::new(),
            w: Vec::new(),
            c: Vec::new(),
            own: Vec::new(),
        }
    }
    pub(crate) fn new(structure: &Structure<T>, tree: &Tree<T>) -> Self {
        // When, and by which operation, each loop is closed.
        let mut closed = vec![(0, 0); structure.loops.len()];
        for (i, &index) in structure.closings.iter().enumerate() {
            structure.operations[index].closes.into_iter().for_each(|of| closed[of] = (i, index));
        }
        let pair = |(of, a): (usize, usize), (other, b): (usize, usize)| -> Option<Pair> {
            let (a, b, of, other) =
                if closed[of].0 <= closed[other].0 { (a, b, of, other) } else { (b, a, other, of) };
            let operation = &structure.operations[closed[of].1];
            let at = operation.other_loops.iter().find(|(o, _)| *o == other);
            let column = if of == other { 0 } else { operation.closing + at?.1 };
            let (rows, columns) = (structure.loops[of].rows.len(), structure.loops[other].rows.len());
            Some(Pair { a, b, rows, columns, start: operation.number + column, width: operation.width })
        };
        let pairs = |loops: &[(usize, usize)]| -> Vec<Pair> {
            let all = |i: usize| loops[..=i].iter().filter_map(move |other| pair(loops[i], *other));
            (0..loops.len()).flat_map(all).collect()
        };
        let (mut w, mut c) = (0, 0);
        let mut fronts = Vec::with_capacity(tree.len());
        for (station, body) in structure.stations.iter().zip(&tree.bodies) {
            let first = c;
            let (mut loops, mut width) = (Vec::new(), 0);
            for passing in &station.passes {
                loops.push((passing.of, width));
                width += structure.loops[passing.of].rows.len().next_multiple_of(GROUP);
                c += structure.loops[passing.of].rows.len();
            }
            let mut front = Front { w, c: first, width, columns: Vec::new(), pairs: pairs(&loops) };
            front.columns = loops.iter().map(|(_, column)| *column).collect();
            // A row of the panel has room after its columns: those of C.
            front.pairs.iter_mut().for_each(|pair| pair.columns = pair.columns.next_multiple_of(GROUP));
            fronts.push(front);
            w += width * body.nv;
        }
        let coupled = structure.operations.iter().map(|operation| {
            let Some(of) = operation.closes else { return Coupled::default() };
            let shifted = |(o, column): &(usize, usize)| (*o, operation.closing + column);
            let loops: Vec<(usize, usize)> = operation.other_loops.iter().map(shifted).collect();
            let here =
                loops.iter().filter(|(o, _)| structure.loops[*o].ancestor == structure.loops[of].ancestor);
            let here = here.map(|&(o, a)| {
                let later = &structure.operations[closed[o].1];
                let start = later.number + later.closing + later.others;
                Pair { a, b: 0, rows: later.closing, columns: 6, start, width: later.width }
            });
            Coupled { here: here.collect(), pairs: pairs(&loops) }
        });
        Plain {
            used: false,
            doubt: None,
            coupled: coupled.collect(),
            fronts,
            w: vec![Arithmetic::<T>::splat(0.0); w],
            c: vec![Wrench::zero(); c],
            own: vec![Arithmetic::<T>::splat(0.0); structure.rows],
        }
    }
}

impl<T: Number> Factors<T> {
    /// Ω = 0, C = 0.
    #[inline(always)]
    pub(super) fn clear_plain(&mut self, structure: &Structure<T>) {
        self.plain.doubt = None;
        self.plain.own.fill(Arithmetic::<T>::splat(0.0));
        for &index in &structure.closings {
            let operation = &structure.operations[index];
            self.matrix[operation.number..][..operation.closing * operation.width]
                .fill(Arithmetic::<T>::splat(0.0));
        }
    }
    /// Keeps C before the joint of body k.
    #[inline(always)]
    pub(super) fn keep_plain(&mut self, structure: &Structure<T>, k: usize) {
        for passing in &structure.stations[k].passes {
            let (to, from) =
                (self.plain.fronts[k].c + passing.column, structure.strands[passing.strand].first);
            let m = structure.loops[passing.of].rows.len();
            self.plain.c[to..to + m].copy_from_slice(&self.c[from..from + m]);
        }
    }
    /// w of the i-th degree of freedom of a joint, and Ω += w*w.
    #[inline(always)]
    pub(super) fn append_plain(
        &mut self,
        structure: &Structure<T>,
        k: usize,
        i: usize,
        hinge: &Hinge<T>,
        xi: Wrench<Arithmetic<T>>,
        inverse: Arithmetic<T>,
    ) {
        let station = &structure.stations[k];
        let (first, width) = (self.plain.fronts[k].w, self.plain.fronts[k].width);
        for (at, passing) in station.passes.iter().enumerate() {
            let column = self.plain.fronts[k].columns[at];
            let start = structure.loops[passing.of].rows.start;
            for j in 0..structure.loops[passing.of].rows.len() {
                let w = self.take_out(structure, station, passing, j, (i, hinge), xi, inverse);
                self.plain.w[first + i * width + column + j] = w;
                self.plain.own[start + j] = w.fma(w, self.plain.own[start + j]);
            }
        }
        let w = &self.plain.w[first + i * width..][..width];
        for pair in &self.plain.fronts[k].pairs {
            for row in 0..pair.rows {
                let factor = w[pair.a + row];
                let to = &mut self.matrix[pair.start + row * pair.width..][..pair.columns];
                add_scaled(to, factor, &w[pair.b..][..pair.columns]);
            }
        }
    }
    /// Moves C of what leaves body k to its parent's frame.
    #[inline(always)]
    pub(super) fn shift_plain(&mut self, structure: &Structure<T>, frames: &Frames<T>, k: usize) {
        for passing in &structure.stations[k].passes {
            let first = structure.strands[passing.strand].first;
            for i in first..first + structure.loops[passing.of].rows.len() {
                self.c[i] = frames.poses[k].wrench_to_parent(self.c[i]);
            }
        }
    }
    /// Closes the loop of an operation at body k, or at the ground, or finds a doubt.
    #[inline(always)]
    pub(super) fn close_plain(
        &mut self,
        structure: &Structure<T>,
        frames: &Frames<T>,
        index: usize,
        k: usize,
    ) {
        let operation = &structure.operations[index];
        let of = operation.closes.unwrap_or(0);
        let rows_of = structure.loops[of].rows.clone();
        let scale = self.scale(rows_of.clone());
        let (m, width) = (operation.closing, operation.width);
        self.gather_plain(structure, frames, operation, of);
        // Ω/s², Ω_o/s, −C/s: the rows that remain of L* have s in their own columns only.
        let inverse = scale.recip();
        for row in self.matrix[operation.number..][..m * width].chunks_exact_mut(width) {
            row.iter_mut().for_each(|x| *x *= inverse);
            row[..m].iter_mut().for_each(|x| *x *= inverse);
        }
        let tolerance = 64.0 * T::EPSILON * (operation.most as f64).sqrt() + 10.0 * self.error;
        let rank = self.factor_plain(operation, KEPT.max(4.0 * tolerance * tolerance));
        let mut dropped = 0.0f64;
        for t in rank..m {
            let column = self.order[operation.row + t];
            let row = &mut self.matrix[operation.number + t * width..][..width];
            let square = larger(row[column], Arithmetic::<T>::splat(0.0));
            // Rounding of Ω, as much as it ever was.
            let own = self.plain.own[rows_of.start + column] * inverse * inverse;
            let rounding = 16.0 * T::EPSILON * operation.most as f64 * own.min_lane();
            let pivot = square.sqrt();
            let certain = square.min_lane() + rounding <= tolerance * tolerance;
            if !certain {
                self.plain.doubt = Some(Doubt { closure: of, row: column, pivot: pivot.min_lane() });
                return;
            }
            row.fill(Arithmetic::<T>::splat(0.0));
            row[column] = pivot;
            dropped = dropped.max(pivot.min_lane());
        }
        self.done[index] = Done { rows: m, rank, steps: rank, left: 0, scale };
        self.judge(structure, operation, m, rank, dropped);
        self.condense(operation, k, rank);
        self.decouple(operation, index, rank);
    }
    /// −C of a loop at its ancestor: what has come there by its strands, and its ends on the body itself.
    #[inline(always)]
    fn gather_plain(
        &mut self,
        structure: &Structure<T>,
        frames: &Frames<T>,
        operation: &Operation,
        of: usize,
    ) {
        let l = &structure.loops[of];
        let first = operation.closing + operation.others;
        for side in 0..2 {
            let strand = l.strands[side].map(|s| structure.strands[s].first);
            if strand.is_none() && matches!(l.kind, LoopKind::Gear { .. }) {
                continue;
            }
            for i in 0..operation.closing {
                let c = match strand {
                    Some(strand) => self.c[strand + i],
                    None => frames.strand_row(structure, of, side, i),
                };
                let to = &mut self.matrix[operation.number + i * operation.width + first..][..6];
                for (to, c) in to.iter_mut().zip(c.to_array()) {
                    *to -= c;
                }
            }
        }
    }
    /// Cholesky's factorisation with diagonal pivoting while a pivot is above `least`, on all columns of the rows; returns the
    /// number of pivots. `order` gets the row of the loop that stands in each row, `pivots` their columns.
    #[inline(always)]
    fn factor_plain(&mut self, operation: &Operation, least: f64) -> usize {
        // The width of one loop alone, in a copy whose rows are registers.
        match operation.width {
            12 => self.factor_known::<12>(operation, least),
            _ => self.factor_known::<0>(operation, least),
        }
    }
    /// The same for rows of W numbers; of any number with W = 0.
    #[inline(always)]
    fn factor_known<const W: usize>(&mut self, operation: &Operation, least: f64) -> usize {
        let (m, width) = (operation.closing, if W == 0 { operation.width } else { W });
        let a = &mut self.matrix[operation.number..][..m * width];
        let order = &mut self.order[operation.row..][..m];
        let pivots = &mut self.pivots[operation.step..][..m + operation.others];
        pivots.fill(usize::MAX);
        for (i, o) in order.iter_mut().enumerate() {
            *o = i;
        }
        for t in 0..m {
            let mut best = t;
            for row in t + 1..m {
                if a[row * width + order[row]].min_lane() > a[best * width + order[best]].min_lane() {
                    best = row;
                }
            }
            let pivot = a[best * width + order[best]];
            if pivot.min_lane().is_nan() || pivot.min_lane() <= least {
                return t;
            }
            if best != t {
                let (upper, lower) = a.split_at_mut(best * width);
                upper[t * width..][..width].swap_with_slice(&mut lower[..width]);
                order.swap(t, best);
            }
            let column = order[t];
            pivots[t] = column;
            let root = pivot.sqrt();
            let inverse = root.recip();
            let (upper, lower) = a.split_at_mut((t + 1) * width);
            let first = &mut upper[t * width..][..width];
            first.iter_mut().for_each(|x| *x *= inverse);
            first[column] = root;
            for (row, o) in lower.chunks_exact_mut(width).zip(&order[t + 1..]) {
                add_scaled(row, -first[*o], first);
                row[column] = Arithmetic::<T>::splat(0.0);
            }
        }
        m
    }
    /// Ω_oo −= B_o*B_o, and C_o −= B_o*B_C of loops that are closed at the same body later.
    #[inline(always)]
    fn decouple(&mut self, operation: &Operation, index: usize, rank: usize) {
        let width = operation.width;
        let columns = operation.closing + operation.others;
        let Coupled { pairs, here } = &self.plain.coupled[index];
        for t in 0..rank {
            let row = &mut self.sums[..width];
            row.copy_from_slice(&self.matrix[operation.number + t * width..][..width]);
            for pair in pairs {
                subtract_product(&mut self.matrix, pair, row, &row[pair.b..]);
            }
            // Both C and X₁ are kept with the other sign.
            for pair in here {
                subtract_product(&mut self.matrix, pair, row, &row[columns..]);
            }
        }
    }
}

/// Subtracts, for each of the pair's rows, its number in `row` times `columns`.
#[inline(always)]
fn subtract_product<S: Scalar>(matrix: &mut [S], pair: &Pair, row: &[S], columns: &[S]) {
    for i in 0..pair.rows {
        let factor = -row[pair.a + i];
        let to = &mut matrix[pair.start + i * pair.width..][..pair.columns];
        for (to, x) in to.iter_mut().zip(columns) {
            *to = factor.fma(*x, *to);
        }
    }
}
