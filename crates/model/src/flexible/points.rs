//! Shape integrals of mass points.

use super::ShapeIntegrals;

/// A mass at a point of a body, or a node of a quadrature over it.
#[derive(Clone, Debug, PartialEq)]
pub struct MassPoint {
    /// kg.
    pub mass: f64,
    /// s0: where it is in F, m.
    pub position: [f64; 3],
    /// ψ_l: its displacement by every mode.
    pub displacement: Vec<[f64; 3]>,
}

impl ShapeIntegrals {
    /// Sums over mass points with `n` modes each; modes that a point does not name do not move it.
    pub fn from_points(n: usize, points: &[MassPoint]) -> Self {
        let mut sum = ShapeIntegrals::zero(n);
        for point in points {
            let (m, s) = (point.mass, point.position);
            let psi = |l: usize| point.displacement.get(l).copied().unwrap_or_default();
            sum.mass += m;
            for i in 0..3 {
                sum.first_moment[i] += m * s[i];
                for j in 0..3 {
                    sum.second_moment[i][j] += m * s[i] * s[j];
                }
            }
            for l in 0..n {
                let a = psi(l);
                for i in 0..3 {
                    sum.displacement[l][i] += m * a[i];
                    for j in 0..3 {
                        sum.moment[l][i][j] += m * a[i] * s[j];
                    }
                }
                for k in 0..n {
                    let b = psi(k);
                    for i in 0..3 {
                        for j in 0..3 {
                            sum.product[l * n + k][i][j] += m * (a[i] * b[j]);
                        }
                    }
                }
            }
        }
        sum
    }
}
