//! Fewer points of a curve that look the same: the extremes of each stretch stay.

/// Thins `points` to at most `limit` of them (`limit` ≥ 4).
///
/// The first and the last point stay. The rest is cut into stretches of equal length; of each, the lowest and the highest
/// point stay in their order. A stretch with a point that is not finite keeps one such point, so that gaps stay gaps; then it
/// counts as three.
pub fn thin(points: &[(f64, f64)], limit: usize) -> Vec<(f64, f64)> {
    let n = points.len();
    if n <= limit.max(4) {
        return points.to_vec();
    }
    let gaps = points.iter().any(|p| !is_finite(p));
    let stretches = (limit.max(4) - 2) / if gaps { 3 } else { 2 };
    let inner = &points[1..n - 1];
    let mut kept = Vec::with_capacity(limit);
    kept.push(points[0]);
    for s in 0..stretches.max(1) {
        let (from, to) = (s * inner.len() / stretches.max(1), (s + 1) * inner.len() / stretches.max(1));
        let mut chosen = [None; 3];
        for i in from..to {
            if !is_finite(&inner[i]) {
                chosen[2] = chosen[2].or(Some(i));
                continue;
            }
            let better = |best: Option<usize>, sign: f64| match best {
                Some(b) if sign * inner[b].1 >= sign * inner[i].1 => Some(b),
                _ => Some(i),
            };
            chosen[0] = better(chosen[0], -1.0);
            chosen[1] = better(chosen[1], 1.0);
        }
        let mut order: Vec<usize> = chosen.into_iter().flatten().collect();
        order.sort_unstable();
        order.dedup();
        kept.extend(order.into_iter().map(|i| inner[i]));
    }
    kept.push(points[n - 1]);
    kept
}

/// True if both coordinates are finite.
pub fn is_finite(point: &(f64, f64)) -> bool {
    point.0.is_finite() && point.1.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extremes_and_ends_stay() {
        let mut points: Vec<(f64, f64)> = (0..100_000).map(|i| (i as f64, (i as f64 * 0.37).sin())).collect();
        points[71_234].1 = 9.0;
        points[5_001].1 = -7.0;
        let thinned = thin(&points, 1000);
        assert!(thinned.len() <= 1000, "{}", thinned.len());
        assert!(thinned.contains(&(71_234.0, 9.0)) && thinned.contains(&(5_001.0, -7.0)));
        assert_eq!((thinned[0], thinned.last()), (points[0], points.last()));
        assert!(thinned.windows(2).all(|w| w[0].0 < w[1].0), "order");
    }

    #[test]
    fn gaps_stay_gaps() {
        let mut points: Vec<(f64, f64)> = (0..9_000).map(|i| (i as f64, 1.0)).collect();
        points[4_500].1 = f64::NAN;
        let thinned = thin(&points, 300);
        assert!(thinned.len() <= 300);
        assert_eq!(thinned.iter().filter(|p| p.1.is_nan()).count(), 1);
    }

    #[test]
    fn short_curves_are_untouched() {
        let points = vec![(0.0, 1.0), (1.0, f64::INFINITY), (2.0, 3.0)];
        assert_eq!(thin(&points, 4).len(), 3);
        assert!(thin(&[], 4).is_empty());
    }
}
