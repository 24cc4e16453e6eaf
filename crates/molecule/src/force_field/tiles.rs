//! Pairs of atoms in tiles of four rows and eight columns.
//!
//! Atoms have places; a pair belongs to the tile of its lower place's row block and its higher place's column block. A tile of
//! excluded pairs, of the diagonal, or beyond the last atom has a mask; the others are whole.

use super::exclusions::Exclusions;
use std::ops::Range;

/// Places of a row block, and of a column block.
pub(super) const ROWS: usize = 4;
pub(super) const COLUMNS: usize = 8;

/// The mask of a tile with all its pairs.
pub(super) const WHOLE: u32 = u32::MAX;

/// Tiles that a chunk has at least, so that a thread is worth its start, and the most chunks: each has sums of its own.
const CHUNK: usize = 1000;
const MOST_CHUNKS: usize = 16;
/// Row blocks of a chunk at least, where the tiles are those of a list.
const ROWS_OF_CHUNK: usize = 25;

/// A column block with the pairs that it has with a row block: bit `COLUMNS * row + column`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub block: u32,
    pub mask: u32,
}

/// Tiles of all row blocks, and row blocks in chunks of about equal work. Nothing here depends on the number of threads.
#[derive(Clone, Debug, Default)]
pub(super) struct Tiles {
    places: usize,
    /// Where the tiles of a row block begin; those of the last end with the list.
    starts: Vec<usize>,
    tiles: Vec<Tile>,
    chunks: Vec<Range<usize>>,
}

impl Tiles {
    /// All pairs of n atoms, each in its own place, that are not excluded.
    pub(super) fn all_pairs(n: usize, exclusions: &Exclusions) -> Self {
        let mut tiles = Tiles { places: n, ..Tiles::default() };
        let blocks = n.div_ceil(COLUMNS);
        for rows in 0..n.div_ceil(ROWS) {
            let first_block = rows * ROWS / COLUMNS;
            let begin = tiles.tiles.len();
            tiles.starts.push(begin);
            for block in first_block..blocks {
                tiles.tiles.push(Tile { block: block as u32, mask: inside(rows, block, n) });
            }
            for row in 0..ROWS {
                for &j in exclusions.of(rows * ROWS + row) {
                    let tile = &mut tiles.tiles[begin + j / COLUMNS - first_block];
                    tile.mask &= !(1 << (row * COLUMNS + j % COLUMNS));
                }
            }
        }
        tiles.divide();
        tiles
    }

    /// No tiles yet of n atoms: [`Tiles::list`] makes them. The chunks depend on nothing but n, so that no sum depends on the
    /// list.
    pub(super) fn listed(n: usize) -> Self {
        let rows = n.div_ceil(ROWS);
        let count = (rows / ROWS_OF_CHUNK).clamp(1, MOST_CHUNKS);
        let chunks = (0..count).map(|k| rows * k / count..rows * (k + 1) / count).collect();
        Tiles { places: n, starts: vec![0; rows + 1], tiles: Vec::new(), chunks }
    }

    /// Lists the tiles again: `row` appends those of a row block, in the order of their columns.
    pub(super) fn list(&mut self, mut row: impl FnMut(usize, &mut Vec<Tile>)) {
        self.tiles.clear();
        for rows in 0..self.starts.len() - 1 {
            self.starts[rows] = self.tiles.len();
            row(rows, &mut self.tiles);
        }
        if let Some(last) = self.starts.last_mut() {
            *last = self.tiles.len();
        }
    }

    /// Chunks of the row blocks.
    fn divide(&mut self) {
        let (rows, tiles) = (self.starts.len(), self.tiles.len());
        self.starts.push(tiles);
        let count = (tiles / CHUNK).clamp(1, MOST_CHUNKS);
        self.chunks.clear();
        let mut begin = 0;
        for chunk in 1..=count {
            // Through the row block that reaches this chunk's share of all tiles.
            let share = tiles * chunk / count;
            let end =
                if chunk == count { rows } else { self.starts.partition_point(|&s| s < share).min(rows) };
            self.chunks.push(begin..end.max(begin));
            begin = end.max(begin);
        }
    }

    /// Number of places, all of whole column blocks.
    pub(super) fn padded(&self) -> usize {
        self.places.next_multiple_of(COLUMNS)
    }
    /// Row blocks of each chunk.
    pub(super) fn chunks(&self) -> &[Range<usize>] {
        &self.chunks
    }
    /// The tiles of a row block.
    #[inline(always)]
    pub(super) fn of(&self, rows: usize) -> &[Tile] {
        &self.tiles[self.starts[rows]..self.starts[rows + 1]]
    }
    /// Number of tiles of some row blocks.
    pub(super) fn count(&self, rows: &Range<usize>) -> usize {
        self.starts[rows.end] - self.starts[rows.start]
    }
}

/// The pairs of a tile whose first place is before the second and both before n.
pub(super) fn inside(rows: usize, block: usize, n: usize) -> u32 {
    let mut mask = 0;
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let (i, j) = (rows * ROWS + row, block * COLUMNS + column);
            if i < j && j < n {
                mask |= 1 << (row * COLUMNS + column);
            }
        }
    }
    mask
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_is_in_one_tile_unless_excluded() {
        for n in [0, 1, 2, 3, 7, 8, 9, 31, 257] {
            let excluded = |i: usize, j: usize| i < j && (j - i == 1 || (3 * i + j) % 11 == 5);
            let pairs = (0..n).flat_map(|i| (0..n).filter(move |&j| excluded(i, j)).map(move |j| [j, i]));
            let tiles = Tiles::all_pairs(n, &Exclusions::new(n, pairs));
            let mut seen = vec![0; n * n];
            let rows: Vec<usize> = tiles.chunks().iter().cloned().flatten().collect();
            assert_eq!(rows, (0..n.div_ceil(ROWS)).collect::<Vec<_>>());
            for rows in rows {
                for tile in tiles.of(rows) {
                    for bit in (0..32).filter(|bit| tile.mask >> bit & 1 == 1) {
                        let (row, column) = (bit as usize / COLUMNS, bit as usize % COLUMNS);
                        seen[(rows * ROWS + row) * n + tile.block as usize * COLUMNS + column] += 1;
                    }
                }
            }
            for i in 0..n {
                for j in 0..n {
                    assert_eq!(seen[i * n + j], i32::from(i < j && !excluded(i, j)), "{i} {j} of {n}");
                }
            }
        }
    }
}
