//! Impulses of several stops at once: a linear complementarity problem.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | A | S*NS: change of the stops' speeds by unit impulses at them | m×m, symmetric, positive semidefinite |
//! | b | speeds that impulses have to make good: (1 + e) ṡ⁻ where a stop is struck, ṡ⁻ where it is touched | m |
//! | p | impulses: p ≥ 0, A p + b ≥ 0, p·(A p + b) = 0 | m |
//!
//! Principal pivoting: the set of stops with an impulse is changed one by one, the worst first, then by Murty's rule (the last one that is
//! wrong), which ends for every positive definite A.

/// Impulses. `a`: by rows. Stops that others imply (a pivot below rounding) get none.
pub(crate) fn impulses(a: &[f64], b: &[f64]) -> Vec<f64> {
    let m = b.len();
    let mut pushes = vec![false; m];
    let mut p = vec![0.0; m];
    let size = b.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    let scale = (0..m).fold(0.0f64, |most, i| most.max(a[i * m + i]));
    if size == 0.0 || scale == 0.0 {
        return p;
    }
    for round in 0..50 * (m + 1) {
        solve(a, b, &pushes, &mut p);
        // How wrong each stop is, in units of speed.
        let wrong = |i: usize| match pushes[i] {
            true => -p[i] * a[i * m + i],
            false => -(b[i] + (0..m).map(|j| a[i * m + j] * p[j]).sum::<f64>()),
        };
        let rounding = 1e-12 * size;
        let mut wrongs = (0..m).map(|i| (i, wrong(i))).filter(|(_, w)| *w > rounding);
        let chosen = match round < 4 * m {
            true => wrongs.max_by(|x, y| x.1.total_cmp(&y.1)),
            false => wrongs.next_back(),
        };
        let Some((i, _)) = chosen else { break };
        pushes[i] = !pushes[i];
    }
    p.iter_mut().for_each(|p| *p = p.max(0.0));
    p
}

/// p of the pushing stops with A p + b = 0 there, by elimination; zero elsewhere.
fn solve(a: &[f64], b: &[f64], pushes: &[bool], p: &mut [f64]) {
    let m = b.len();
    let set: Vec<usize> = (0..m).filter(|i| pushes[*i]).collect();
    let n = set.len();
    p.fill(0.0);
    let mut w: Vec<Vec<f64>> =
        set.iter().map(|&i| set.iter().map(|&j| a[i * m + j]).chain([-b[i]]).collect()).collect();
    let mut kept = vec![false; n];
    for k in 0..n {
        let pivot = w[k][k];
        // A is symmetric and positive semidefinite: no exchange of rows is needed, a small pivot means a row implied by others.
        if pivot <= 1e-12 * a[set[k] * m + set[k]] {
            continue;
        }
        kept[k] = true;
        let row = w[k].clone();
        for (i, other) in w.iter_mut().enumerate().filter(|(i, _)| *i != k) {
            let factor = other[k] / pivot;
            if factor != 0.0 && (i > k || kept[i]) {
                other.iter_mut().zip(&row).for_each(|(x, y)| *x -= factor * y);
            }
        }
    }
    for k in (0..n).filter(|&k| kept[k]) {
        p[set[k]] = w[k][n] / w[k][k];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impulses_satisfy_the_complementarity() {
        // Two stops that push each other's joint away: only the first pushes.
        let (a, b) = ([2.0, 1.5, 1.5, 2.0], [-1.0, -0.5]);
        let p = impulses(&a, &b);
        assert_eq!(p, [0.5, 0.0]);
        // Both push where they resist each other.
        let a = [2.0, -1.0, -1.0, 2.0];
        let p = impulses(&a, &b);
        assert!((p[0] - 2.5 / 3.0).abs() < 1e-15 && (p[1] - 2.0 / 3.0).abs() < 1e-15, "{p:?}");
        // The same stop twice: one impulse.
        let p = impulses(&[1.0, 1.0, 1.0, 1.0], &[-1.0, -1.0]);
        assert_eq!(p.iter().sum::<f64>(), 1.0);
        assert_eq!(impulses(&[1.0], &[0.5]), [0.0]);
    }
}
