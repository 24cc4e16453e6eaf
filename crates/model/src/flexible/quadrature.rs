//! Gauss–Legendre quadrature.

/// Points and weights on [0, 1], exact for polynomials of degree 2 `n` − 1.
pub(crate) fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    let degree = n as f64;
    (0..n)
        .map(|i| {
            // Newton's method from Tricomi's estimate of the root.
            let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (degree + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..20 {
                let (p, d) = legendre(n, x);
                slope = d;
                let step = p / d;
                x -= step;
                if step.abs() < 1e-16 {
                    break;
                }
            }
            (0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// P_n and its derivative at x.
fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut before, mut p) = (1.0, x);
    for k in 1..n {
        let k = k as f64;
        (before, p) = (p, ((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0));
    }
    (p, n as f64 * (x * p - before) / (x * x - 1.0))
}

/// Points and weights on [0, 1] in `panels` equal panels of 16 points.
pub(crate) fn panels(panels: usize) -> Vec<(f64, f64)> {
    let rule = gauss_legendre(16);
    let width = 1.0 / panels as f64;
    let panel = |k: usize| rule.iter().map(move |&(x, w)| (width * (k as f64 + x), width * w));
    (0..panels).flat_map(panel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_integrated_exactly() {
        let rule = gauss_legendre(16);
        for power in 0..32 {
            let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(power)).sum();
            let want = 1.0 / (f64::from(power) + 1.0);
            assert!((sum - want).abs() < 20.0 * f64::EPSILON, "{power}: {sum} {want}");
        }
        let sum: f64 = panels(5).iter().map(|(x, w)| w * (3.0 * x).sin()).sum();
        assert!((sum - (1.0 - 3f64.cos()) / 3.0).abs() < 4.0 * f64::EPSILON);
    }
}
