//! Shapes of a straight beam of unit length: eigenfunctions of Euler–Bernoulli beams, cubics, sines.
//!
//! φ(x) = cosh bx − cos bx − σ (sinh bx − sin bx) is evaluated as e exp(bx) + (1 − e) exp(−bx) − cos bx + σ sin bx with e from a
//! formula that does not cancel, so that high modes keep their digits.

use std::f64::consts::PI;

/// A shape on 0 ≤ x ≤ 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BeamShape {
    /// An eigenfunction with a clamped end at 0 and a free or clamped end at 1.
    Clamped {
        /// b.
        root: f64,
        /// σ.
        sigma: f64,
        /// e = (1 − σ)/2.
        growing: f64,
    },
    /// sin(b x).
    Sine {
        /// b.
        root: f64,
    },
    /// 3x² − 2x³: unit displacement, no rotation at 1.
    Displacement,
    /// x³ − x²: unit rotation, no displacement at 1.
    Rotation,
    /// x.
    Linear,
}

impl BeamShape {
    /// The eigenfunction of a clamped-free beam with root b.
    pub fn clamped_free(root: f64) -> Self {
        let (s, c, decay) = (root.sin(), root.cos(), (-root).exp());
        let below = root.sinh() + s;
        let growing = 0.5 * (-decay + s - c) / below;
        BeamShape::Clamped { root, sigma: 1.0 - 2.0 * growing, growing }
    }
    /// The eigenfunction of a clamped-clamped beam with root b.
    pub fn clamped_clamped(root: f64) -> Self {
        let (s, c, decay) = (root.sin(), root.cos(), (-root).exp());
        let below = root.sinh() - s;
        let growing = 0.5 * (-decay - s + c) / below;
        BeamShape::Clamped { root, sigma: 1.0 - 2.0 * growing, growing }
    }
    /// φ, φ′ and φ″ at x.
    pub fn at(&self, x: f64) -> [f64; 3] {
        match *self {
            BeamShape::Clamped { root: b, sigma, growing } => {
                let (s, c) = (b * x).sin_cos();
                let (up, down) = (growing * (b * x).exp(), (1.0 - growing) * (-b * x).exp());
                [
                    up + down - c + sigma * s,
                    b * (up - down + s + sigma * c),
                    b * b * (up + down + c - sigma * s),
                ]
            }
            BeamShape::Sine { root: b } => {
                let (s, c) = (b * x).sin_cos();
                [s, b * c, -b * b * s]
            }
            BeamShape::Displacement => [x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x), 6.0 - 12.0 * x],
            BeamShape::Rotation => [x * x * (x - 1.0), x * (3.0 * x - 2.0), 6.0 * x - 2.0],
            BeamShape::Linear => [x, 1.0, 0.0],
        }
    }
}

/// Newton's method for f + 1/cosh b or f − 1/cosh b, which stay of size one.
fn root(start: f64, function: impl Fn(f64) -> (f64, f64)) -> f64 {
    let mut b = start;
    for _ in 0..60 {
        let (f, slope) = function(b);
        let step = f / slope;
        b -= step;
        if step.abs() <= f64::EPSILON * b.abs() {
            break;
        }
    }
    b
}

/// The first `count` roots of a clamped-free beam, 1 + cos b cosh b = 0.
pub fn clamped_free_roots(count: usize) -> Vec<f64> {
    let function = |b: f64| (b.cos() + 1.0 / b.cosh(), -b.sin() - b.tanh() / b.cosh());
    (1..=count).map(|k| root(if k == 1 { 1.875 } else { (k as f64 - 0.5) * PI }, function)).collect()
}

/// The first `count` roots of a clamped-clamped beam, cos b cosh b = 1.
pub(crate) fn clamped_clamped_roots(count: usize) -> Vec<f64> {
    let function = |b: f64| (b.cos() - 1.0 / b.cosh(), -b.sin() + b.tanh() / b.cosh());
    (1..=count).map(|k| root((k as f64 + 0.5) * PI, function)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flexible::quadrature::panels;

    #[test]
    fn roots_are_those_of_tables() {
        for (found, want) in
            clamped_free_roots(4).iter().zip([1.87510407, 4.69409113, 7.85475744, 10.99554073])
        {
            assert!((found - want).abs() < 5e-9, "{found} {want}");
        }
        for (found, want) in clamped_clamped_roots(2).iter().zip([4.73004074, 7.85320462]) {
            assert!((found - want).abs() < 5e-9, "{found} {want}");
        }
    }

    /// Ends, derivatives and the norm ∫φ² = 1 of clamped-free modes, also high ones.
    #[test]
    fn eigenfunctions_meet_their_conditions() {
        let rule = panels(40);
        for (k, b) in clamped_free_roots(20).into_iter().enumerate() {
            let shape = BeamShape::clamped_free(b);
            let [tip, _, curvature] = shape.at(1.0);
            let sign = if k % 2 == 0 { 2.0 } else { -2.0 };
            let budget = 100.0 * b * f64::EPSILON;
            assert!((tip - sign).abs() < budget, "{k}: {tip}");
            assert!(curvature.abs() < b * b * budget, "{k}: {curvature}");
            let norm: f64 = rule.iter().map(|(x, w)| w * shape.at(*x)[0].powi(2)).sum();
            assert!((norm - 1.0).abs() < budget, "{k}: {norm}");
        }
        for b in clamped_clamped_roots(20) {
            let shape = BeamShape::clamped_clamped(b);
            let [tip, slope, _] = shape.at(1.0);
            assert!(tip.abs() < 100.0 * b * f64::EPSILON && slope.abs() < 100.0 * b * b * f64::EPSILON);
        }
    }

    #[test]
    fn derivatives_are_derivatives() {
        let shapes = [
            BeamShape::clamped_free(4.69409113),
            BeamShape::clamped_clamped(7.85320462),
            BeamShape::Sine { root: 3.0 },
            BeamShape::Displacement,
            BeamShape::Rotation,
            BeamShape::Linear,
        ];
        let h = 1e-5;
        for shape in shapes {
            for x in [0.2, 0.9] {
                let (a, b) = (shape.at(x - h), shape.at(x + h));
                let at = shape.at(x);
                for i in 0..2 {
                    // Third derivatives are below 500: h² of them and ε/h of the values.
                    assert!(((b[i] - a[i]) / (2.0 * h) - at[i + 1]).abs() < 2e-7, "{shape:?} {x} {i}");
                }
            }
        }
    }
}
