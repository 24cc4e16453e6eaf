//! Sums over the pairs of [`Tiles`] in the lanes of SIMD registers, and on several threads.
//!
//! Eight columns are eight lanes at every level ([`Lanes`]): narrower registers take them one after the other. What a lane adds
//! up, and the order in which lanes and chunks are added in the end, is the same on every processor and on every number of
//! threads, to the last bit.

use super::image::NearestImage;
use super::tiles::{COLUMNS, ROWS, Tile, Tiles, WHOLE};
use phipsi_spatial::lanes::{Fused, Lanes, Level, Visitor, at_level};
use phipsi_spatial::{Kernel, Vec3};
use std::ops::Range;

/// Most numbers of one place that a kernel sums.
pub(super) const MOST_SUMS: usize = 4;

/// What a pair adds to S sums of its first place and S of its second. All methods are `#[inline(always)]`.
pub(super) trait PairKernel<const S: usize>: Sync {
    /// Numbers of each pair that are kept for a later kernel on the same tiles.
    const KEPT: usize = 0;
    /// The square of the distance from which on pairs add nothing.
    const CUTOFF: bool = false;
    #[inline(always)]
    fn cutoff_square(&self) -> f64 {
        f64::INFINITY
    }
    /// Numbers of a place in all lanes, and of as many places as there are lanes.
    type Row<T: Lanes>: Copy;
    type Column<T: Lanes>: Copy;
    fn row<T: Lanes>(&self, place: usize) -> Self::Row<T>;
    fn column<T: Lanes>(&self, first: usize) -> Self::Column<T>;
    /// The energy. Lanes without a pair add zeros.
    fn pair<T: Lanes>(
        &self,
        row: &Self::Row<T>,
        column: &Self::Column<T>,
        at: At<'_, T>,
        row_sums: &mut [T; S],
        column_sums: &mut [T; S],
    ) -> T;
}

/// Where a pair is.
pub(super) struct At<'a, T> {
    /// From the first to the second atom, and its square: 1 in lanes without a pair.
    pub d: [T; 3],
    pub square: T,
    /// The lanes that have a pair; all where there is none.
    lanes: Option<u32>,
    /// The square of the cutoff.
    limit: Option<T>,
    /// The first of the numbers kept; the next begin [`COLUMNS`] further each.
    pub kept: &'a mut [Fused],
}

impl<T: Lanes> At<'_, T> {
    /// The pair at its nearest image in a box.
    #[inline(always)]
    pub(super) fn nearest(&mut self, image: &NearestImage) {
        image.shift(&mut self.d);
        let [x, y, z] = self.d;
        let square = z.fma(z, y.fma(y, x * x));
        self.square = match self.lanes {
            Some(bits) => square.choose(bits, T::one()),
            None => square,
        };
    }
    /// The number in lanes with a pair within the cutoff, 0 in others.
    #[inline(always)]
    pub(super) fn only(&self, x: T) -> T {
        let x = match self.lanes {
            Some(bits) => x.choose(bits, T::zero()),
            None => x,
        };
        match self.limit {
            Some(limit) => self.square.below(limit, x, T::zero()),
            None => x,
        }
    }
    #[inline(always)]
    pub(super) fn keep(&mut self, number: usize, x: T) {
        x.store(&mut self.kept[number * COLUMNS..]);
    }
    #[inline(always)]
    pub(super) fn kept(&self, number: usize) -> T {
        T::load(&self.kept[number * COLUMNS..])
    }
}

/// Adds the force `force` d to the first three sums of the second atom, and takes it from those of the first.
#[inline(always)]
pub(super) fn push<T: Lanes, const S: usize>(
    force: T,
    d: &[T; 3],
    row_sums: &mut [T; S],
    column_sums: &mut [T; S],
) {
    let opposite = -force;
    for k in 0..3 {
        row_sums[k] = opposite.fma(d[k], row_sums[k]);
        column_sums[k] = force.fma(d[k], column_sums[k]);
    }
}

/// Coordinates by places, in whole column blocks.
#[derive(Clone, Debug, Default)]
pub(super) struct Places {
    x: [Vec<Fused>; 3],
}

impl Places {
    pub(super) fn new(padded: usize) -> Self {
        Places { x: [(); 3].map(|()| vec![Fused(0.0); padded]) }
    }
    /// The coordinates of a place, in all lanes.
    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> [T; 3] {
        let [x, y, z] = &self.x;
        [T::broadcast(x[place]), T::broadcast(y[place]), T::broadcast(z[place])]
    }
    /// Takes the coordinates of atoms, each in its own place.
    pub(super) fn set(&mut self, x: &[Vec3<f64>]) {
        for (i, x) in x.iter().enumerate() {
            for k in 0..3 {
                self.x[k][i] = Fused(x.0[k]);
            }
        }
    }
}

/// What the chunks of a sweep work with; kept from sweep to sweep.
#[derive(Clone, Debug, Default)]
pub(super) struct Sweep {
    chunks: Vec<Chunk>,
}

#[derive(Clone, Debug, Default)]
struct Chunk {
    /// S sums of all places, one sum after the other.
    sums: Vec<Fused>,
    energy: f64,
    kept: Vec<Fused>,
}

impl Sweep {
    /// Makes room for tiles, with so many numbers kept of each pair.
    pub(super) fn fit(&mut self, tiles: &Tiles, kept: usize) {
        self.chunks.resize_with(tiles.chunks().len(), Chunk::default);
        for (rows, chunk) in tiles.chunks().iter().zip(&mut self.chunks) {
            chunk.sums.resize(MOST_SUMS * tiles.padded(), Fused(0.0));
            chunk.kept.resize(tiles.count(rows) * ROWS * COLUMNS * kept, Fused(0.0));
        }
    }

    /// Runs a kernel on all pairs; the energy.
    pub(super) fn run<const S: usize, K: PairKernel<S>>(
        &mut self,
        level: Level,
        tiles: &Tiles,
        places: &Places,
        kernel: &K,
    ) -> f64 {
        let work = Work { tiles, places, kernel };
        if at_level(level, Chunks::<S, K> { work, chunks: &mut self.chunks }).is_none() {
            at_level(Level::Scalar, Chunks::<S, K> { work, chunks: &mut self.chunks });
        }
        let used = S * tiles.padded();
        let Some((first, others)) = self.chunks.split_first_mut() else { return 0.0 };
        let mut energy = first.energy;
        for other in others {
            energy += other.energy;
            for (sum, x) in first.sums[..used].iter_mut().zip(&other.sums[..used]) {
                sum.0 += x.0;
            }
        }
        energy
    }

    /// Sum k of all places in the last sweep.
    pub(super) fn sums(&self, tiles: &Tiles, k: usize) -> &[Fused] {
        let padded = tiles.padded();
        self.chunks.first().map_or(&[], |chunk| &chunk.sums[k * padded..(k + 1) * padded])
    }

    /// Adds sums 0, 1, 2 of the last sweep to the forces of atoms in their own places.
    pub(super) fn add_forces(&self, tiles: &Tiles, forces: &mut [Vec3<f64>]) {
        let sums = [0, 1, 2].map(|k| self.sums(tiles, k));
        for (i, force) in forces.iter_mut().enumerate() {
            *force += Vec3([sums[0][i].0, sums[1][i].0, sums[2][i].0]);
        }
    }
}

struct Work<'a, K> {
    tiles: &'a Tiles,
    places: &'a Places,
    kernel: &'a K,
}

impl<K> Clone for Work<'_, K> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<K> Copy for Work<'_, K> {}

/// All chunks.
struct Chunks<'a, const S: usize, K> {
    work: Work<'a, K>,
    chunks: &'a mut [Chunk],
}

impl<const S: usize, K: PairKernel<S>> Visitor for Chunks<'_, S, K> {
    type Output = ();
    fn visit<T: Lanes>(self) {
        let work = self.work;
        let one = |(rows, chunk): (&Range<usize>, &mut Chunk)| {
            T::dispatch(OneChunk::<S, T, K> {
                work,
                rows: rows.clone(),
                chunk,
                lanes: std::marker::PhantomData,
            });
        };
        #[cfg(feature = "parallel")]
        if self.chunks.len() > 1 && rayon::current_num_threads() > 1 {
            use rayon::prelude::*;
            work.tiles.chunks().par_iter().zip(self.chunks.par_iter_mut()).for_each(one);
            return;
        }
        work.tiles.chunks().iter().zip(self.chunks.iter_mut()).for_each(one);
    }
}

struct OneChunk<'a, const S: usize, T, K> {
    work: Work<'a, K>,
    rows: Range<usize>,
    chunk: &'a mut Chunk,
    lanes: std::marker::PhantomData<T>,
}

impl<const S: usize, T: Lanes, K: PairKernel<S>> Kernel for OneChunk<'_, S, T, K> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let OneChunk { work: Work { tiles, places, kernel }, rows, chunk, .. } = self;
        let padded = tiles.padded();
        chunk.sums[..S * padded].fill(Fused(0.0));
        chunk.energy = 0.0;
        let mut first_kept = 0;
        for rows in rows {
            let row_tiles = tiles.of(rows);
            let kept = row_tiles.len() * ROWS * COLUMNS * K::KEPT;
            let kept_here = &mut chunk.kept[first_kept..first_kept + kept];
            first_kept += kept;
            // Lane after lane of each sum of each row; the energy last.
            let mut lanes = [[Fused(0.0); COLUMNS]; 17];
            let mut half = 0;
            while half < COLUMNS {
                row_block::<S, T, K>(
                    row_tiles,
                    places,
                    kernel,
                    [rows, half, padded],
                    &mut chunk.sums,
                    kept_here,
                    &mut lanes,
                );
                half += T::LANES;
            }
            for row in 0..ROWS {
                for k in 0..S {
                    chunk.sums[k * padded + rows * ROWS + row].0 += total(&lanes[row * S + k]);
                }
            }
            chunk.energy += total(&lanes[ROWS * S]);
        }
    }
}

#[inline(always)]
fn total(x: &[Fused; COLUMNS]) -> f64 {
    ((x[0].0 + x[1].0) + (x[2].0 + x[3].0)) + ((x[4].0 + x[5].0) + (x[6].0 + x[7].0))
}

/// The tiles of a row block in the lanes from `half` on.
#[inline(always)]
fn row_block<const S: usize, T: Lanes, K: PairKernel<S>>(
    tiles: &[Tile],
    places: &Places,
    kernel: &K,
    [rows, half, padded]: [usize; 3],
    sums: &mut [Fused],
    kept: &mut [Fused],
    lanes: &mut [[Fused; COLUMNS]; 17],
) {
    let first = rows * ROWS;
    let [x, y, z] = [&places.x[0][..], &places.x[1][..], &places.x[2][..]];
    let xi: [[T; 3]; ROWS] =
        [places.row(first), places.row(first + 1), places.row(first + 2), places.row(first + 3)];
    let row: [K::Row<T>; ROWS] =
        [kernel.row(first), kernel.row(first + 1), kernel.row(first + 2), kernel.row(first + 3)];
    let limit = if K::CUTOFF { Some(T::splat(kernel.cutoff_square())) } else { None };
    let mut row_sums = [[T::zero(); S]; ROWS];
    let mut energy = T::zero();
    for (number, tile) in tiles.iter().enumerate() {
        let place = tile.block as usize * COLUMNS + half;
        let xj = [T::load(&x[place..]), T::load(&y[place..]), T::load(&z[place..])];
        let column = kernel.column::<T>(place);
        let mut column_sums = [T::zero(); S];
        for k in 0..S {
            column_sums[k] = T::load(&sums[k * padded + place..]);
        }
        for i in 0..ROWS {
            let d = [xj[0] - xi[i][0], xj[1] - xi[i][1], xj[2] - xi[i][2]];
            let square = d[2].fma(d[2], d[1].fma(d[1], d[0] * d[0]));
            let kept = match K::KEPT {
                0 => &mut [][..],
                _ => &mut kept[(number * ROWS + i) * COLUMNS * K::KEPT + half..],
            };
            if tile.mask == WHOLE {
                let at = At { d, square, lanes: None, limit, kept };
                energy += kernel.pair(&row[i], &column, at, &mut row_sums[i], &mut column_sums);
            } else {
                let bits = tile.mask >> (i * COLUMNS + half);
                let square = square.choose(bits, T::one());
                let at = At { d, square, lanes: Some(bits), limit, kept };
                energy += kernel.pair(&row[i], &column, at, &mut row_sums[i], &mut column_sums);
            }
        }
        for k in 0..S {
            column_sums[k].store(&mut sums[k * padded + place..]);
        }
    }
    for i in 0..ROWS {
        for k in 0..S {
            row_sums[i][k].store(&mut lanes[i * S + k][half..]);
        }
    }
    energy.store(&mut lanes[ROWS * S][half..]);
}
