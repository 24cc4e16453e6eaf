//! Pairs that a sum over all pairs leaves out.

/// For each particle the partners with a larger index, in order.
#[derive(Clone, Debug)]
pub(super) struct Exclusions {
    starts: Vec<usize>,
    partners: Vec<usize>,
}

impl Exclusions {
    pub(super) fn new(n: usize, pairs: impl Iterator<Item = [usize; 2]>) -> Self {
        let mut sorted: Vec<[usize; 2]> = pairs.map(|[i, j]| [i.min(j), i.max(j)]).collect();
        sorted.sort_unstable();
        sorted.dedup();
        let mut starts = vec![0; n + 1];
        for [i, _] in &sorted {
            starts[i + 1] += 1;
        }
        for i in 0..n {
            starts[i + 1] += starts[i];
        }
        Exclusions { starts, partners: sorted.into_iter().map(|[_, j]| j).collect() }
    }

    /// All excluded pairs, the lower index first.
    pub(super) fn pairs(&self) -> impl Iterator<Item = [usize; 2]> {
        (0..self.starts.len() - 1).flat_map(|i| self.of(i).iter().map(move |&j| [i, j]))
    }

    /// No pairs of n particles.
    pub(super) fn none(n: usize) -> Self {
        Exclusions { starts: vec![0; n + 1], partners: Vec::new() }
    }

    /// The excluded partners j > i of particle i, in order; none of a particle that does not exist.
    #[inline]
    pub(super) fn of(&self, i: usize) -> &[usize] {
        match self.starts.get(i..i + 2) {
            Some(&[begin, end]) => &self.partners[begin..end],
            _ => &[],
        }
    }

    /// Ranges of the partners j > i of particle i that are not excluded.
    #[inline]
    pub(super) fn partners(&self, i: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
        let n = self.starts.len() - 1;
        let excluded = self.of(i);
        let begins = [i + 1].into_iter().chain(excluded.iter().map(|j| j + 1));
        begins.zip(excluded.iter().copied().chain([n])).map(|(begin, end)| begin..end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn excluded_pairs_are_left_out_once() {
        let pairs = [[2, 0], [0, 1], [1, 4], [0, 2], [0, 4]];
        let exclusions = Exclusions::new(5, pairs.into_iter());
        let partners = |i: usize| exclusions.partners(i).flatten().collect::<Vec<usize>>();
        assert_eq!(
            (0..5).map(partners).collect::<Vec<_>>(),
            [vec![3], vec![2, 3], vec![3, 4], vec![4], vec![]]
        );
    }
}
