//! The pairs that a sum takes: all, or those within a cutoff, by a list that is made again when an atom has moved too far.
//!
//! The list has the tiles with a pair below the cutoff and a skin; kernels compare every distance with the cutoff itself. Tiles
//! are blocks of atoms in their own order, so that a sum is the same to the last bit whenever its list was made: pairs beyond the
//! cutoff add zeros. A list is short where atoms that follow each other are near each other, as in any chain molecule.
//!
//! | cost | of a list |
//! |---|---|
//! | O(n log n) | boxes around column blocks, and around eight boxes again and again; row blocks ask from the top |
//! | O(n) | in a periodic box: cells (`cells.rs`) |

use super::cells::Cells;
use super::exclusions::Exclusions;
use super::image::NearestImage;
use super::tiles::{COLUMNS, ROWS, Tile, Tiles, inside};
use phipsi_spatial::Vec3;

type V = Vec3<f64>;

/// The skin, of the cutoff. Larger: fewer lists, more pairs in each.
const SKIN: f64 = 0.1;
/// Boxes in a box.
const BRANCHES: usize = 8;

#[derive(Clone, Debug)]
pub(super) struct Neighbors {
    tiles: Tiles,
    exclusions: Exclusions,
    cutoff: Option<f64>,
    image: Option<NearestImage>,
    /// The positions of the list; none before the first.
    known: Vec<V>,
    boxes: Vec<Vec<Bounds>>,
    cells: Cells,
}

impl Neighbors {
    /// Pairs of n atoms that are not excluded. Those within a cutoff are known from [`Neighbors::update`] on.
    pub(super) fn new(n: usize, exclusions: Exclusions, cutoff: Option<f64>) -> Self {
        let tiles = match cutoff {
            Some(_) => Tiles::listed(n),
            None => Tiles::all_pairs(n, &exclusions),
        };
        let (known, boxes, cells) = (Vec::new(), Vec::new(), Cells::default());
        Neighbors { tiles, exclusions, cutoff, image: None, known, boxes, cells }
    }

    /// The same at the nearest images in a box.
    pub(super) fn in_box(self, image: Option<NearestImage>) -> Self {
        Neighbors { image, ..self }
    }

    pub(super) fn exclusions(&self) -> &Exclusions {
        &self.exclusions
    }

    pub(super) fn tiles(&self) -> &Tiles {
        &self.tiles
    }

    /// Makes the list again where that is necessary; true if so.
    pub(super) fn update(&mut self, x: &[V]) -> bool {
        let Some(cutoff) = self.cutoff else { return false };
        let allowed = (0.5 * SKIN * cutoff).powi(2);
        let stays = |(x, known): (&V, &V)| {
            let d = *x - *known;
            d.dot(d) <= allowed
        };
        if self.known.len() == x.len() && x.iter().zip(&self.known).all(stays) {
            return false;
        }
        self.known.clear();
        self.known.extend_from_slice(x);
        let reach = (1.0 + SKIN) * cutoff;
        if let Some(image) = self.image {
            self.list_in_box(x, &image, reach);
            return true;
        }
        self.bound(x);
        let reach = reach * reach;
        let (boxes, exclusions) = (&self.boxes, &self.exclusions);
        self.tiles.list(|rows, tiles| row_list(rows, x, reach, boxes, exclusions, tiles));
        true
    }

    /// The tiles that have a pair of which an image is near enough.
    fn list_in_box(&mut self, x: &[V], image: &NearestImage, reach: f64) {
        let n = x.len();
        // A position without a value must be seen by the sum.
        let all = x.iter().any(|x| x.0.iter().any(|x| !x.is_finite()));
        if !all {
            self.cells.fill(x, image, reach);
        }
        let (cells, exclusions) = (&self.cells, &self.exclusions);
        let (mut blocks, mut listed) = (Vec::new(), vec![usize::MAX; n.div_ceil(COLUMNS)]);
        self.tiles.list(|rows, tiles| {
            let first = rows * ROWS;
            blocks.clear();
            if all {
                blocks.extend(first / COLUMNS..listed.len());
            } else {
                for i in first..(first + ROWS).min(n) {
                    cells.near(i, |j| {
                        let block = j / COLUMNS;
                        if j > i && listed[block] != rows && !exclusions.of(i).contains(&j) {
                            listed[block] = rows;
                            blocks.push(block);
                        }
                    });
                }
                blocks.sort_unstable();
            }
            let begin = tiles.len();
            tiles.extend(blocks.iter().map(|&b| Tile { block: b as u32, mask: inside(rows, b, n) }));
            exclude(exclusions, rows, n, &mut tiles[begin..]);
        });
    }

    /// Boxes of column blocks, and of boxes.
    fn bound(&mut self, x: &[V]) {
        let mut level = std::mem::take(&mut self.boxes);
        level.iter_mut().for_each(Vec::clear);
        let mut depth = 0;
        loop {
            if level.len() == depth {
                level.push(Vec::new());
            }
            let (below, here) = level.split_at_mut(depth);
            match below.last() {
                None => here[0].extend(x.chunks(COLUMNS).map(Bounds::of)),
                Some(below) => here[0].extend(below.chunks(BRANCHES).map(Bounds::around)),
            }
            depth += 1;
            if level[depth - 1].len() <= 1 {
                level.truncate(depth);
                self.boxes = level;
                return;
            }
        }
    }
}

/// Appends the tiles of a row block.
fn row_list(
    rows: usize,
    x: &[V],
    reach: f64,
    boxes: &[Vec<Bounds>],
    exclusions: &Exclusions,
    tiles: &mut Vec<Tile>,
) {
    let (n, first) = (x.len(), rows * ROWS);
    let own = &x[first..(first + ROWS).min(n)];
    let begin = tiles.len();
    let mut search = Search { own: Bounds::of(own), reach, boxes, first_block: first / COLUMNS, tiles };
    search.visit(boxes.len().saturating_sub(1), 0);
    for tile in &mut tiles[begin..] {
        tile.mask = inside(rows, tile.block as usize, n);
    }
    exclude(exclusions, rows, n, &mut tiles[begin..]);
    let mut kept = begin;
    for k in begin..tiles.len() {
        if has_pair(tiles[k], own, x, reach) {
            tiles[kept] = tiles[k];
            kept += 1;
        }
    }
    tiles.truncate(kept);
}

/// Takes the excluded pairs out of the tiles of a row block.
fn exclude(exclusions: &Exclusions, rows: usize, n: usize, tiles: &mut [Tile]) {
    let first = rows * ROWS;
    for row in 0..ROWS.min(n - first) {
        for &j in exclusions.of(first + row) {
            let block = (j / COLUMNS) as u32;
            if let Ok(at) = tiles.binary_search_by_key(&block, |tile| tile.block) {
                tiles[at].mask &= !(1 << (row * COLUMNS + j % COLUMNS));
            }
        }
    }
}

/// True if a pair of the tile is near enough.
fn has_pair(tile: Tile, own: &[V], x: &[V], reach: f64) -> bool {
    let first = tile.block as usize * COLUMNS;
    let columns = &x[first..(first + COLUMNS).min(x.len())];
    own.iter().enumerate().any(|(row, a)| {
        columns.iter().enumerate().any(|(column, b)| {
            let d = *b - *a;
            d.dot(d) < reach && tile.mask >> (row * COLUMNS + column) & 1 == 1
        })
    })
}

/// The column blocks near a row block, in order.
struct Search<'a> {
    own: Bounds,
    reach: f64,
    boxes: &'a [Vec<Bounds>],
    first_block: usize,
    tiles: &'a mut Vec<Tile>,
}

impl Search<'_> {
    fn visit(&mut self, level: usize, index: usize) {
        let Some(bounds) = self.boxes.get(level).and_then(|boxes| boxes.get(index)) else { return };
        let blocks = BRANCHES.pow(level as u32);
        if (index + 1) * blocks <= self.first_block || bounds.distance_square(&self.own) >= self.reach {
            return;
        }
        if level == 0 {
            self.tiles.push(Tile { block: index as u32, mask: 0 });
            return;
        }
        for child in index * BRANCHES..(index + 1) * BRANCHES {
            self.visit(level - 1, child);
        }
    }
}

/// A box along the axes.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [f64; 3],
    high: [f64; 3],
}

impl Bounds {
    const NONE: Bounds = Bounds { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    fn of(x: &[V]) -> Bounds {
        x.iter().fold(Bounds::NONE, |bounds, x| bounds.with(&Bounds { low: x.0, high: x.0 }))
    }
    fn around(boxes: &[Bounds]) -> Bounds {
        boxes.iter().fold(Bounds::NONE, |bounds, other| bounds.with(other))
    }
    fn with(self, other: &Bounds) -> Bounds {
        let [low, high] = [[&self.low, &other.low], [&self.high, &other.high]];
        Bounds {
            low: [0, 1, 2].map(|k| low[0][k].min(low[1][k])),
            high: [0, 1, 2].map(|k| high[0][k].max(high[1][k])),
        }
    }
    fn distance_square(&self, other: &Bounds) -> f64 {
        let gap = |k: usize| (self.low[k] - other.high[k]).max(other.low[k] - self.high[k]).max(0.0);
        [0, 1, 2].map(|k| gap(k) * gap(k)).iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::Random;

    /// How often each pair is in the tiles.
    fn pairs(tiles: &Tiles, n: usize) -> Vec<u8> {
        let mut seen = vec![0; n * n];
        for rows in tiles.chunks().iter().cloned().flatten() {
            for tile in tiles.of(rows) {
                for bit in (0..32).filter(|bit| tile.mask >> bit & 1 == 1) {
                    let (row, column) = (bit as usize / COLUMNS, bit as usize % COLUMNS);
                    seen[(rows * ROWS + row) * n + tile.block as usize * COLUMNS + column] += 1;
                }
            }
        }
        seen
    }

    #[test]
    fn every_near_pair_is_listed_once_until_an_atom_moves_too_far() {
        const CUTOFF: f64 = 0.5;
        for n in [1, 5, 8, 65, 700] {
            let mut random = Random::new(n as u64);
            let mut at = Vec3([0.0; 3]);
            let mut step = |size: f64| Vec3([(); 3].map(|()| size * random.signed()));
            let mut x: Vec<V> = (0..n)
                .map(|_| {
                    at += step(0.2);
                    at
                })
                .collect();
            let excluded = |i: usize, j: usize| j == i + 1 || j == i + 40;
            let list = (0..n).flat_map(|i| [[i, i + 1], [i, i + 40]]).filter(|p| p[1] < n);
            let mut neighbors = Neighbors::new(n, Exclusions::new(n, list), Some(CUTOFF));
            assert!(neighbors.update(&x));
            let mut made = 1;
            for _ in 0..30 {
                let seen = pairs(neighbors.tiles(), n);
                for i in 0..n {
                    for j in 0..n {
                        let near = (x[j] - x[i]).norm() < CUTOFF && i < j && !excluded(i, j);
                        let at_most_once = u8::from(i < j && !excluded(i, j));
                        assert!(
                            seen[i * n + j] <= at_most_once && (!near || seen[i * n + j] == 1),
                            "{i} {j}"
                        );
                    }
                }
                x.iter_mut().for_each(|x| *x += step(0.005));
                made += usize::from(neighbors.update(&x));
            }
            assert!((2..30).contains(&made), "{made} lists");
        }
    }

    /// In boxes of all shapes, the widths barely two cutoffs: with atoms that have left the box, and atoms that move.
    #[test]
    fn every_near_pair_of_a_box_is_listed_once_until_an_atom_moves_too_far() {
        const CUTOFF: f64 = 0.5;
        for (seed, [a, b, c, p, q, r]) in [
            [2.0, 2.0, 2.0, 0.0, 0.0, 0.0],
            [1.0, 1.0, 1.0, 0.5, -0.5, 0.5],
            [1.01, 1.3, 1.0, -0.5, 0.5, 0.5],
            [5.0, 1.0, 1.02, 0.5, 0.5, -0.5],
        ]
        .into_iter()
        .enumerate()
        {
            let box_vectors = [[a, 0.0, 0.0], [p * a, b, 0.0], [q * a, r * b, c]];
            let periodic = phipsi_formats::system::Periodic {
                box_vectors,
                exceptions: false,
                dispersion_correction: false,
            };
            let image = NearestImage::new(&periodic);
            for n in [1, 7, 65, 200] {
                let mut random = Random::new((seed * 1000 + n) as u64);
                let mut vector = |size: f64| Vec3([(); 3].map(|()| size * random.signed()));
                let mut x: Vec<V> = (0..n).map(|_| vector(4.0)).collect();
                let excluded = |i: usize, j: usize| j == i + 1 || j == i + 40;
                let list = (0..n).flat_map(|i| [[i, i + 1], [i, i + 40]]).filter(|p| p[1] < n);
                let exclusions = Exclusions::new(n, list);
                let mut neighbors = Neighbors::new(n, exclusions, Some(CUTOFF)).in_box(Some(image));
                assert!(neighbors.update(&x));
                let mut made = 1;
                for _ in 0..20 {
                    let seen = pairs(neighbors.tiles(), n);
                    for i in 0..n {
                        for j in 0..n {
                            let may = i < j && !excluded(i, j);
                            let near = may && image.of(x[j] - x[i]).norm() < CUTOFF;
                            let count = seen[i * n + j];
                            assert!(count <= u8::from(may) && (!near || count == 1), "{i} {j}");
                        }
                    }
                    x.iter_mut().for_each(|x| *x += vector(0.005));
                    made += usize::from(neighbors.update(&x));
                }
                // Of a few atoms, none may have gone that far.
                assert!(n < 65 || (2..20).contains(&made), "{made} lists of {n}");
                // A position without a value is compared with all.
                x[0] = Vec3([f64::NAN, 0.0, 0.0]);
                assert!(neighbors.update(&x));
                let seen = pairs(neighbors.tiles(), n);
                assert!((1..n).all(|j| seen[j] == u8::from(!excluded(0, j))));
            }
        }
    }

    #[test]
    fn the_list_of_a_long_chain_grows_with_its_length() {
        let tiles = |n: usize| {
            let helix = |i: usize| Vec3([(0.7 * i as f64).cos(), (0.7 * i as f64).sin(), 0.05 * i as f64]);
            let x: Vec<V> = (0..n).map(helix).collect();
            let mut neighbors = Neighbors::new(n, Exclusions::none(n), Some(0.8));
            neighbors.update(&x);
            neighbors.tiles().count(&(0..n.div_ceil(ROWS)))
        };
        let (short, long) = (tiles(2000), tiles(16000));
        assert!(long < 9 * short, "{short} {long}");
    }
}
