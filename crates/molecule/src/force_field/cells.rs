//! Pairs of atoms near each other in a periodic box, by cells.
//!
//! | symbol | meaning |
//! |---|---|
//! | s | coordinates of an atom along the box vectors, each in [0, 1) |
//! | w_k | distance of the two faces of the box across box vector k |
//! | n_k, m_k | cells along it, about half a reach wide; how many of them on either side a reach may touch |
//! | L | the box vectors that an image is away: wherever a cell is beyond a face |
//!
//! A pair is near where one of its images is: all that lie in the cells around are compared, each at its own L, so that boxes of any
//! shape, and narrower than twice the reach, are right. Cost: O(n) at a given density.

use super::image::NearestImage;
use phipsi_spatial::Vec3;

type V = Vec3<f64>;

/// Most cells along a box vector.
const MOST: f64 = 1_048_576.0;

#[derive(Clone, Debug, Default)]
pub(super) struct Cells {
    counts: [usize; 3],
    around: [isize; 3],
    vectors: [[f64; 3]; 3],
    square: f64,
    /// The cell of each atom, and its place in the box.
    own: Vec<[usize; 3]>,
    places: Vec<V>,
    /// Atoms by cells; those of a cell begin at its start.
    atoms: Vec<usize>,
    starts: Vec<usize>,
}

impl Cells {
    /// Puts finite positions into cells, for pairs that are nearer than `reach`.
    pub(super) fn fill(&mut self, x: &[V], image: &NearestImage, reach: f64) {
        let widths = image.face_distances();
        self.vectors = image.vectors().map(|v| v.0);
        self.square = reach * reach;
        self.counts = counts(widths, reach, x.len());
        for k in 0..3 {
            self.around[k] = (reach * self.counts[k] as f64 / widths[k]).ceil() as isize;
        }
        self.own.clear();
        self.places.clear();
        for x in x {
            let s = image.fractions(*x).map(|s| s - s.floor());
            let cell = [0, 1, 2].map(|k| ((s[k] * self.counts[k] as f64) as usize).min(self.counts[k] - 1));
            self.own.push(cell);
            self.places.push((0..3).fold(V::zero(), |sum, k| sum + Vec3(self.vectors[k]).scale(s[k])));
        }
        let total: usize = self.counts.iter().product();
        self.starts.clear();
        self.starts.resize(total + 1, 0);
        for cell in &self.own {
            self.starts[index(self.counts, *cell) + 1] += 1;
        }
        for c in 0..total {
            self.starts[c + 1] += self.starts[c];
        }
        let mut next = self.starts.clone();
        self.atoms.clear();
        self.atoms.resize(x.len(), 0);
        for (i, cell) in self.own.iter().enumerate() {
            let at = &mut next[index(self.counts, *cell)];
            self.atoms[*at] = i;
            *at += 1;
        }
    }

    /// Visits all atoms of which an image is nearer to atom i than the reach, i itself among them; some more than once.
    pub(super) fn near(&self, i: usize, mut visit: impl FnMut(usize)) {
        self.candidates(i, |j, d| {
            if d.dot(d) < self.square {
                visit(j);
            }
        });
    }

    /// All atoms of the cells around that of atom i, with the vectors to their images.
    fn candidates(&self, i: usize, mut visit: impl FnMut(usize, V)) {
        let (own, from) = (self.own[i], self.places[i]);
        let [x, y, z] = [0, 1, 2].map(|k| -self.around[k]..=self.around[k]);
        for c in z {
            let (kc, away) = self.beyond(2, own[2], c);
            for b in y.clone() {
                let (kb, other) = self.beyond(1, own[1], b);
                let away = away + other;
                for a in x.clone() {
                    let (ka, other) = self.beyond(0, own[0], a);
                    let shift = away + other - from;
                    let cell = index(self.counts, [ka, kb, kc]);
                    for &j in &self.atoms[self.starts[cell]..self.starts[cell + 1]] {
                        visit(j, self.places[j] + shift);
                    }
                }
            }
        }
    }

    /// The cell so many cells further, and how far its image is away.
    fn beyond(&self, k: usize, cell: usize, steps: isize) -> (usize, V) {
        let (n, to) = (self.counts[k] as isize, cell as isize + steps);
        (to.rem_euclid(n) as usize, Vec3(self.vectors[k]).scale(to.div_euclid(n) as f64))
    }
}

/// Cells along each box vector: half a reach wide, or wider where there would be more than two for each atom.
fn counts(widths: [f64; 3], reach: f64, n: usize) -> [usize; 3] {
    let mut counts = widths.map(|w| (2.0 * w / reach).clamp(1.0, MOST) as usize);
    while counts.iter().product::<usize>() > 2 * n + 8 {
        let largest = (0..3).max_by_key(|&k| counts[k]).unwrap_or(0);
        counts[largest] = counts[largest].div_ceil(2);
    }
    counts
}

fn index(counts: [usize; 3], [a, b, c]: [usize; 3]) -> usize {
    (c * counts[1] + b) * counts[0] + a
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_formats::system::Periodic;
    use phipsi_model::Random;

    fn periodic(box_vectors: [[f64; 3]; 3]) -> NearestImage {
        NearestImage::new(&Periodic { box_vectors, exceptions: false, dispersion_correction: false })
    }

    /// Right, oblique to the last, long, flat, and barely two reaches wide.
    fn boxes(reach: f64) -> Vec<[[f64; 3]; 3]> {
        let mut all = Vec::new();
        for [a, b, c] in
            [[3.0, 3.0, 3.0], [9.0, 2.1, 2.5], [2.01, 2.01, 2.01], [2.3, 7.0, 2.01], [1.9, 1.85, 1.83]]
        {
            for [p, q, r] in [
                [0.0, 0.0, 0.0],
                [0.5, 0.5, 0.5],
                [-0.5, 0.5, -0.5],
                [0.5, -0.5, -0.5],
                [1.0 / 3.0, -1.0 / 3.0, 1.0 / 3.0],
            ] {
                let [a, b, c] = [a, b, c].map(|x| x * reach);
                all.push([[a, 0.0, 0.0], [p * a, b, 0.0], [q * a, r * b, c]]);
            }
        }
        all
    }

    /// Atoms of a box, some of them images of those inside.
    fn scatter(n: usize, image: &NearestImage, random: &mut Random) -> Vec<V> {
        let vectors = image.vectors();
        let place = |random: &mut Random| {
            let far = |random: &mut Random| random.uniform() + random.below(5) as f64 - 2.0;
            (0..3).fold(V::zero(), |sum, k| sum + vectors[k].scale(far(random)))
        };
        (0..n).map(|_| place(random)).collect()
    }

    /// True if an image of d is nearer than the reach: all of them are tried.
    fn is_near(d: V, image: &NearestImage, reach: f64) -> bool {
        let (vectors, d) = (image.vectors(), image.of(d));
        let turns = || -3..=3;
        turns().any(|a| {
            turns().any(|b| {
                turns().any(|c| {
                    let to = [a, b, c].iter().zip(vectors).fold(d, |d, (t, v)| d + v.scale(f64::from(*t)));
                    to.dot(to) < reach * reach
                })
            })
        })
    }

    #[test]
    fn near_pairs_are_those_of_all_images() {
        let reach = 0.7;
        for (seed, vectors) in boxes(reach).into_iter().enumerate() {
            let (image, mut random) = (periodic(vectors), Random::new(seed as u64));
            for n in [1, 2, 90] {
                let x = scatter(n, &image, &mut random);
                let mut cells = Cells::default();
                cells.fill(&x, &image, reach);
                for i in 0..n {
                    let mut seen = vec![false; n];
                    cells.near(i, |j| seen[j] = true);
                    for j in 0..n {
                        assert_eq!(
                            seen[j],
                            is_near(x[j] - x[i], &image, reach),
                            "{vectors:?}: {i} {j} of {n}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn fractions_are_those_of_the_box_vectors() {
        for vectors in boxes(1.0) {
            let image = periodic(vectors);
            let x = Vec3([1.25, -7.5, 3.125]);
            let s = image.fractions(x);
            let back = (0..3).fold(V::zero(), |sum, k| sum + image.vectors()[k].scale(s[k]));
            // Three products of numbers up to 30.
            assert!((back - x).norm() < 200.0 * f64::EPSILON, "{back:?}");
            // Faces are as far apart as the projections of the box vectors on their normals.
            let [a, b, c] = image.vectors();
            for (k, (own, others)) in
                [(a, b.cross(c)), (b, c.cross(a)), (c, a.cross(b))].into_iter().enumerate()
            {
                let distance = own.dot(others).abs() / others.norm();
                assert!((image.face_distances()[k] - distance).abs() < 1e-14 * distance);
            }
        }
    }

    /// At a given density the comparisons grow with the number of atoms.
    #[test]
    fn the_cost_is_linear() {
        let comparisons = |side: f64| {
            let image = periodic([[side, 0.0, 0.0], [0.5 * side, side, 0.0], [0.5 * side, 0.5 * side, side]]);
            let n = (20.0 * side.powi(3)) as usize;
            let x = scatter(n, &image, &mut Random::new(1));
            let mut cells = Cells::default();
            cells.fill(&x, &image, 1.0);
            let mut count = 0;
            (0..n).for_each(|i| cells.candidates(i, |_, _| count += 1));
            count as f64 / n as f64
        };
        let (small, large) = (comparisons(4.0), comparisons(8.0));
        // The number of cells is rounded: by a factor of (9/8)³ at most.
        assert!(large < 1.5 * small, "{small} {large}");
        // A box of nearly nothing has few cells.
        let image = periodic([[1e9, 0.0, 0.0], [0.0, 1e9, 0.0], [0.0, 0.0, 1e9]]);
        let mut cells = Cells::default();
        cells.fill(&[V::zero(); 3], &image, 1e-3);
        assert!(cells.starts.len() < 20);
    }
}
