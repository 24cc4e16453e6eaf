//! Cubic splines through equally spaced values, by their slopes at the nodes.
//!
//! | symbol | meaning |
//! |---|---|
//! | fᵢ, sᵢ | value and slope at node i, the slope per step |
//! | interior | sᵢ₋₁ + 4 sᵢ + sᵢ₊₁ = 3 (fᵢ₊₁ − fᵢ₋₁), so that the second derivative is continuous |
//! | natural ends | 2 s₀ + s₁ = 3 (f₁ − f₀): no second derivative there |

/// Slopes per step of the spline without second derivative at its ends.
///
/// # Cost
/// O(n).
pub fn natural_slopes(values: &[f64]) -> Vec<f64> {
    let n = values.len();
    if n < 2 {
        return vec![0.0; n];
    }
    let right = |i: usize| 3.0 * (values[(i + 1).min(n - 1)] - values[i.saturating_sub(1)]);
    let mut slopes: Vec<f64> = (0..n).map(right).collect();
    let mut diagonal = vec![4.0; n];
    (diagonal[0], diagonal[n - 1]) = (2.0, 2.0);
    eliminate(&diagonal, &mut [&mut slopes]);
    slopes
}

/// Slopes per step of the spline of period n through n values.
///
/// # Cost
/// O(n).
pub fn periodic_slopes(values: &[f64]) -> Vec<f64> {
    let n = values.len();
    // Two neighbors that are the same node: by symmetry no slope.
    if n < 3 {
        return vec![0.0; n];
    }
    let right = |i: usize| 3.0 * (values[(i + 1) % n] - values[(i + n - 1) % n]);
    let mut slopes: Vec<f64> = (0..n).map(right).collect();
    // The two corners of the cyclic matrix are u uᵀ with u = e₀ + eₙ₋₁, by the Sherman–Morrison formula.
    let mut corner = vec![0.0; n];
    (corner[0], corner[n - 1]) = (1.0, 1.0);
    let mut diagonal = vec![4.0; n];
    (diagonal[0], diagonal[n - 1]) = (3.0, 3.0);
    eliminate(&diagonal, &mut [&mut slopes, &mut corner]);
    let factor = (slopes[0] + slopes[n - 1]) / (1.0 + corner[0] + corner[n - 1]);
    for (slope, c) in slopes.iter_mut().zip(&corner) {
        *slope -= factor * c;
    }
    slopes
}

/// Solves the tridiagonal systems with ones beside this diagonal, which dominates.
fn eliminate(diagonal: &[f64], sides: &mut [&mut Vec<f64>]) {
    let n = diagonal.len();
    let mut pivots = diagonal.to_vec();
    for i in 1..n {
        let factor = 1.0 / pivots[i - 1];
        pivots[i] -= factor;
        for side in &mut *sides {
            side[i] -= factor * side[i - 1];
        }
    }
    for side in sides {
        side[n - 1] /= pivots[n - 1];
        for i in (0..n - 1).rev() {
            side[i] = (side[i] - side[i + 1]) / pivots[i];
        }
    }
}

/// Weights of f₀, f₁, s₀, s₁ in the value and in the slope per step, at a fraction t of the step from node 0 to node 1.
#[inline]
pub fn hermite(t: f64) -> ([f64; 4], [f64; 4]) {
    let u = 1.0 - t;
    let value = [(1.0 + 2.0 * t) * u * u, t * t * (3.0 - 2.0 * t), t * u * u, -t * t * u];
    let slope = [-6.0 * t * u, 6.0 * t * u, u * (1.0 - 3.0 * t), t * (3.0 * t - 2.0)];
    (value, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cubic is its own spline: with the right second derivative at the ends, which a symmetric one has in the middle.
    #[test]
    fn straight_lines_and_sines() {
        let line: Vec<f64> = (0..7).map(|i| 2.0 - 0.5 * f64::from(i)).collect();
        for slope in natural_slopes(&line) {
            assert!((slope + 0.5).abs() <= 8.0 * f64::EPSILON, "{slope}");
        }
        assert_eq!(natural_slopes(&[1.0, 4.0]), [3.0, 3.0]);
        // The equations of the periodic spline are diagonal for sines: slopes 3 sin(w) / (2 + cos(w)) cos(w i).
        for n in [3usize, 4, 5, 24] {
            let w = std::f64::consts::TAU / n as f64;
            let values: Vec<f64> = (0..n).map(|i| (w * i as f64).sin()).collect();
            for (i, slope) in periodic_slopes(&values).into_iter().enumerate() {
                let exact = 3.0 * w.sin() / (2.0 + w.cos()) * (w * i as f64).cos();
                assert!((slope - exact).abs() <= 20.0 * f64::EPSILON, "{n} {i}: {slope} {exact}");
            }
        }
        assert_eq!(periodic_slopes(&[1.0, 5.0]), [0.0, 0.0]);
    }

    #[test]
    fn weights_reproduce_cubics() {
        let f = |t: f64| 1.0 - 2.0 * t + 3.0 * t * t - 4.0 * t * t * t;
        let df = |t: f64| -2.0 + 6.0 * t - 12.0 * t * t;
        let ends = [f(0.0), f(1.0), df(0.0), df(1.0)];
        for i in 0..=10 {
            let t = 0.1 * f64::from(i);
            let (value, slope) = hermite(t);
            let sum = |w: [f64; 4]| -> f64 { w.iter().zip(ends).map(|(w, e)| w * e).sum() };
            assert!((sum(value) - f(t)).abs() <= 30.0 * f64::EPSILON);
            assert!((sum(slope) - df(t)).abs() <= 60.0 * f64::EPSILON);
        }
    }
}
