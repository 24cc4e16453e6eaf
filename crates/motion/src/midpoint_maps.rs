//! Adjoint maps of the retraction τ = exp, by which momenta move from the middle of a drift to its ends.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | L_x | left differential of τ at x: Σ (−ad_x)ⁿ/(n+1)! = 1 − c₁ ad + c₂ ad² − c₃ ad³ + c₄ ad⁴ | notes on integrators, 1 |
//! | B_x | L_x⁻¹ = 1 + ½ ad + A ad² + B ad⁴ | the same |
//! | x~ f | force cross product; ad_x* f = −x~ f | soa.md 3.0 |
//!
//! On SE(3) ad⁵ = −2θ² ad³ − θ⁴ ad with θ = |rotation part of x|, hence four coefficients. Rotations and plane motions are
//! subgroups, so that one pair of formulas serves all joints; for the others, which commute, both maps are the identity.

use crate::increment::rigid_coefficients;
use phipsi_recursion::Layout;
use phipsi_recursion::hinge::Hinge;
use phipsi_spatial::{Motion, Wrench};

/// Below this angle the closed forms of c₁…c₄ cancel: c₄ loses ε/θ⁴ of its θ⁴, its series less than that.
const SMALL: f64 = 0.1;

/// c₁…c₄.
fn differential_coefficients(theta2: f64) -> [f64; 4] {
    if theta2 < SMALL * SMALL {
        let fourth = theta2 * theta2;
        return [
            0.5 - fourth * (1.0 / 720.0 - theta2 / 20160.0),
            1.0 / 6.0 - fourth * (1.0 / 5040.0 - theta2 / 181_440.0),
            1.0 / 24.0 - theta2 / 360.0 + fourth / 13440.0,
            1.0 / 120.0 - theta2 / 2520.0 + fourth / 120_960.0,
        ];
    }
    let theta = theta2.sqrt();
    let (s, c) = theta.sin_cos();
    [
        (4.0 - theta * s - 4.0 * c) / (2.0 * theta2),
        (4.0 * theta - 5.0 * s + theta * c) / (2.0 * theta2 * theta),
        (2.0 - theta * s - 2.0 * c) / (2.0 * theta2 * theta2),
        (2.0 * theta - 3.0 * s + theta * c) / (2.0 * theta2 * theta2 * theta),
    ]
}

/// L_x* f.
pub fn differential_adjoint(x: Motion<f64>, f: Wrench<f64>) -> Wrench<f64> {
    let [c1, c2, c3, c4] = differential_coefficients(x.angular.dot(x.angular));
    let first = x.cross_wrench(f);
    let second = x.cross_wrench(first);
    let third = x.cross_wrench(second);
    f + first.scale(c1) + second.scale(c2) + third.scale(c3) + x.cross_wrench(third).scale(c4)
}

/// B_x* f.
pub fn increment_adjoint(x: Motion<f64>, f: Wrench<f64>) -> Wrench<f64> {
    let (a, b) = rigid_coefficients(x.angular.dot(x.angular));
    let first = x.cross_wrench(f);
    let second = x.cross_wrench(first);
    let fourth = x.cross_wrench(x.cross_wrench(second));
    f - first.scale(0.5) + second.scale(a) + fourth.scale(b)
}

/// `out` = `map`(s x, f) joint by joint; f itself where a joint's motions commute. `x`, `f`, `out`: nv.
pub(crate) fn map_momenta(
    layout: &Layout<f64>,
    map: impl Fn(Motion<f64>, Wrench<f64>) -> Wrench<f64>,
    s: f64,
    x: &[f64],
    f: &[f64],
    out: &mut [f64],
) {
    out.copy_from_slice(f);
    for body in layout.bodies() {
        if matches!(body.hinge, Hinge::Spherical | Hinge::Planar | Hinge::Free) {
            let mut wrench = Wrench::zero();
            for (i, &component) in body.hinge.components().iter().enumerate() {
                wrench.add_to(component, f[body.v + i]);
            }
            let moved = map(body.hinge.expand(&x[body.v..]).scale(s), wrench);
            for (i, &component) in body.hinge.components().iter().enumerate() {
                out[body.v + i] = moved.get(component);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::Random;

    /// B_x* L_x* = 1, at angles on both sides of the changes of formula.
    #[test]
    fn the_two_maps_are_inverse() {
        let mut random = Random::new(11);
        for scale in [0.0, 1e-8, 1e-3, 0.0199, 0.0201, 0.0999, 0.1001, 0.7, 2.5] {
            let direction = random.vector();
            let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
            let angular = direction.map(|x| scale * x / length);
            let [a, b, c] = random.vector();
            let x = Motion::from_array([angular[0], angular[1], angular[2], a, b, c]);
            let f = Wrench::new(phipsi_spatial::Vec3(random.vector()), phipsi_spatial::Vec3(random.vector()));
            let back = increment_adjoint(x, differential_adjoint(x, f)) - f;
            // Six products and four coefficients, which lose 1/θ at the change of formula.
            let error = back.to_array().iter().fold(0.0f64, |m, e| m.max(e.abs()));
            assert!(error < 64.0 * f64::EPSILON, "{scale}: {error:e}");
        }
    }
}
