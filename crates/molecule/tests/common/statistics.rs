//! Means with errors, and the χ² test.

/// Mean and its standard error from the scatter of 40 blocks.
pub fn mean(x: &[f64]) -> (f64, f64) {
    const BLOCKS: usize = 40;
    let length = x.len() / BLOCKS;
    let blocks: Vec<f64> =
        x.chunks_exact(length).take(BLOCKS).map(|b| b.iter().sum::<f64>() / length as f64).collect();
    let n = blocks.len() as f64;
    let mean = blocks.iter().sum::<f64>() / n;
    let variance = blocks.iter().map(|b| (b - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// Fails unless the mean is the wanted one within four and a half of its errors and `bias`; returns mean and error.
pub fn check_mean(what: &str, x: &[f64], want: f64, bias: f64) -> (f64, f64) {
    let (got, error) = mean(x);
    println!("{what}: {got:.5} ± {error:.5}, exact {want:.5}");
    assert!((got - want).abs() < 4.5 * error + bias, "{what}: {got} ± {error}, exact {want}");
    (got, error)
}

/// Root mean square about a line through equally spaced values, and the line's slope for a step from one to the next.
pub fn about_a_line(x: &[f64]) -> (f64, f64) {
    let n = x.len() as f64;
    let (middle, mean) = (0.5 * (n - 1.0), x.iter().sum::<f64>() / n);
    let (mut te, mut tt) = (0.0, 0.0);
    for (i, x) in x.iter().enumerate() {
        let t = i as f64 - middle;
        te += t * (x - mean);
        tt += t * t;
    }
    let slope = te / tt;
    let square = |(i, x): (usize, &f64)| (x - mean - slope * (i as f64 - middle)).powi(2);
    ((x.iter().enumerate().map(square).sum::<f64>() / n).sqrt(), slope)
}

/// ln Γ(x) by Stirling's series above 10.
fn ln_gamma(x: f64) -> f64 {
    if x < 10.0 {
        return ln_gamma(x + 1.0) - x.ln();
    }
    (x - 0.5) * x.ln() - x + 0.5 * (2.0 * std::f64::consts::PI).ln() + 1.0 / (12.0 * x)
        - 1.0 / (360.0 * x.powi(3))
        + 1.0 / (1260.0 * x.powi(5))
        - 1.0 / (1680.0 * x.powi(7))
        + 1.0 / (1188.0 * x.powi(9))
}

/// Q(a, x) = Γ(a, x)/Γ(a): by the series below a + 1, by the continued fraction above.
pub fn upper_gamma(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > 1e-17 * sum {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return 1.0 - front * sum;
    }
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (1e300, 1.0 / b);
    let mut h = d;
    for i in 1..10_000 {
        let k = -f64::from(i) * (f64::from(i) - a);
        b += 2.0;
        d = 1.0 / (k * d + b);
        c = b + k / c;
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-16 {
            break;
        }
    }
    front * h
}

/// Probability of a χ² at least as large as that of samples in [low, high) counted in bins of equal width, where `density`
/// (not normalised) is their distribution.
pub fn p_value(x: &[f64], [low, high]: [f64; 2], bins: usize, density: impl Fn(f64) -> f64) -> f64 {
    let width = (high - low) / bins as f64;
    // Simpson's rule with 16 intervals in a bin.
    let integral = |bin: usize| -> f64 {
        let at = |i: usize| density(low + width * (bin as f64 + i as f64 / 16.0));
        let weight = |i: usize| if i.is_multiple_of(16) { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 };
        (0..=16).map(|i| weight(i) * at(i)).sum()
    };
    let expected: Vec<f64> = (0..bins).map(integral).collect();
    let total: f64 = expected.iter().sum();
    let mut counts = vec![0.0; bins];
    for x in x {
        let bin = (x - low) / width;
        assert!(bin >= 0.0 && bin < bins as f64 + 1e-9, "{x} is not in [{low}, {high})");
        counts[(bin as usize).min(bins - 1)] += 1.0;
    }
    let n = x.len() as f64;
    let chi2: f64 =
        counts.iter().zip(&expected).map(|(c, e)| (c - n * e / total).powi(2) / (n * e / total)).sum();
    upper_gamma(0.5 * (bins - 1) as f64, 0.5 * chi2)
}

/// Normalised correlation of x at a distance.
pub fn correlation(x: &[f64], lag: usize) -> f64 {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let variance: f64 = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
    let product = |(a, b): (&f64, &f64)| (a - mean) * (b - mean);
    x.iter().zip(&x[lag..]).map(product).sum::<f64>() / (n - lag as f64) / variance
}

/// Known values of χ² tables.
#[test]
fn the_incomplete_gamma_function_is_right() {
    for (a, x, want) in [
        (0.5, 0.5 * 3.841_458_820_694_124, 0.05),
        (5.0, 0.5 * 23.209_251_158_954_356, 0.01),
        (1.0, 2.0, (-2.0f64).exp()),
    ] {
        assert!((upper_gamma(a, x) - want).abs() < 1e-12, "{a} {x}: {}", upper_gamma(a, x));
    }
}
