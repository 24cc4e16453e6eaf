//! Rates of increments: ξ̇ = B_ξ v, the inverse of the differential of the retraction.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | τ(ξ) | retraction, exp: q = q_n ∘ τ(ξ) | notes on integrators, 1 |
//! | B_ξ | I + ½ ad_ξ + A ad_ξ² + B ad_ξ⁴ (spherical, planar: A only, B = 0 with A = (1 − α)/θ²) | the same, adjoint of its B_x* |
//! | α, β | (θ/2) cot(θ/2), (θ/2)²/sin²(θ/2), θ = rotation part | |

use phipsi_model::{JointKind, Model};
use phipsi_spatial::{Motion, Vec3};

/// Below this angle the closed forms of the coefficients cancel and their series are exact to rounding.
const SMALL: f64 = 0.02;

/// (1 − (θ/2) cot(θ/2))/θ².
fn half_cotangent(theta2: f64) -> f64 {
    if theta2 < SMALL * SMALL {
        1.0 / 12.0 + theta2 / 720.0 + theta2 * theta2 / 30240.0
    } else {
        let half = 0.5 * theta2.sqrt();
        (1.0 - half / half.tan()) / theta2
    }
}

/// A and B of a rigid motion.
pub(crate) fn rigid_coefficients(theta2: f64) -> (f64, f64) {
    if theta2 < SMALL * SMALL {
        return (1.0 / 12.0 - theta2 * theta2 / 30240.0, -1.0 / 720.0 - theta2 / 15120.0);
    }
    let half = 0.5 * theta2.sqrt();
    let sine = half.sin();
    let (alpha, beta) = (half / half.tan(), half * half / (sine * sine));
    let spread = 0.5 * (alpha - beta);
    ((2.0 * (1.0 - alpha) + spread) / theta2, ((1.0 - alpha) + spread) / (theta2 * theta2))
}

/// ξ̇ = B_ξ v for all joints. `xi`, `v`, `out`: nv.
pub fn increment_rate(model: &Model, xi: &[f64], v: &[f64], out: &mut [f64]) {
    out.copy_from_slice(v);
    for k in model.moving_joints() {
        let i = model.v_offset(k);
        match model.joints()[k].kind {
            JointKind::Spherical => {
                let (x, w) = (Vec3([xi[i], xi[i + 1], xi[i + 2]]), Vec3([v[i], v[i + 1], v[i + 2]]));
                let first = x.cross(w);
                let rate = w + first.scale(0.5) + x.cross(first).scale(half_cotangent(x.dot(x)));
                out[i..i + 3].copy_from_slice(&rate.0);
            }
            JointKind::Free => {
                let x = Motion::from_array(std::array::from_fn(|j| xi[i + j]));
                let w = Motion::from_array(std::array::from_fn(|j| v[i + j]));
                let (a, b) = rigid_coefficients(x.angular.dot(x.angular));
                let first = x.cross_motion(w);
                let second = x.cross_motion(first);
                let fourth = x.cross_motion(x.cross_motion(second));
                let rate = w + first.scale(0.5) + second.scale(a) + fourth.scale(b);
                out[i..i + 6].copy_from_slice(&rate.to_array());
            }
            JointKind::Planar { .. } => {
                let (w, x, y) = (xi[i], xi[i + 1], xi[i + 2]);
                let bracket = |e: [f64; 3]| [0.0, e[0] * y - w * e[2], w * e[1] - e[0] * x];
                let first = bracket([v[i], v[i + 1], v[i + 2]]);
                let second = bracket(first);
                let c = half_cotangent(w * w);
                (0..3).for_each(|j| out[i + j] += 0.5 * first[j] + c * second[j]);
            }
            _ => {}
        }
    }
}

/// ad_a b of a joint: the bracket of two of its increments or velocities; zero where its q is a vector.
pub fn bracket(kind: &JointKind, a: &[f64], b: &[f64]) -> [f64; 6] {
    let mut out = [0.0; 6];
    match kind {
        JointKind::Spherical => {
            out[..3].copy_from_slice(&Vec3([a[0], a[1], a[2]]).cross(Vec3([b[0], b[1], b[2]])).0);
        }
        JointKind::Free => {
            let six = |x: &[f64]| Motion::from_array(std::array::from_fn(|i| x[i]));
            out = six(a).cross_motion(six(b)).to_array();
        }
        JointKind::Planar { .. } => {
            (out[1], out[2]) = (b[0] * a[2] - a[0] * b[2], a[0] * b[1] - b[0] * a[1]);
        }
        _ => {}
    }
    out
}

/// The largest rotation angle among spherical and free joints of an increment.
pub fn largest_rotation(model: &Model, xi: &[f64]) -> f64 {
    let mut largest = 0.0f64;
    for k in model.moving_joints() {
        if matches!(model.joints()[k].kind, JointKind::Spherical | JointKind::Free) {
            let i = model.v_offset(k);
            largest = largest.max(Vec3([xi[i], xi[i + 1], xi[i + 2]]).norm());
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::{Body, Inertia, Joint, ModelBuilder};
    use phipsi_spatial::Dd;

    /// d/ds of q ∘ τ(ξ + s B_ξ v) is the body velocity v, by central differences in double-double.
    #[test]
    fn increment_rates_invert_the_differential_of_the_retraction() {
        let unit = || Inertia::from_principal(1.0, [0.0; 3], [1.0; 3]);
        for kind in [JointKind::Spherical, JointKind::Free, JointKind::Planar { normal: [0.0, 0.0, 1.0] }] {
            let model = ModelBuilder::new("one")
                .body(Body::new("b", unit()))
                .joint(Joint::new("j", kind), "world", "b")
                .build()
                .unwrap();
            let n = model.nv();
            for scale in [1e-6, 0.01, 0.03, 0.5, 2.0] {
                let state = model.random_state(7);
                let xi: Vec<f64> = model.random_state(8).v.iter().map(|x| x * scale).collect();
                let mut rate = vec![0.0; n];
                increment_rate(&model, &xi, &state.v, &mut rate);
                let h = Dd::from_f64(1e-8);
                let lift = |x: &[f64]| x.iter().map(|&x| Dd::from_f64(x)).collect::<Vec<Dd>>();
                let mut q = lift(&state.q);
                model.normalize(&mut q);
                let at = |sign: f64| {
                    let moved: Vec<Dd> =
                        lift(&xi).iter().zip(&rate).map(|(x, r)| *x + h * Dd::from_f64(sign * r)).collect();
                    model.integrate(&q, &moved)
                };
                let moved = model.difference(&at(-1.0), &at(1.0));
                for i in 0..n {
                    let velocity = (moved[i] / (h + h)).hi;
                    // Differences are good to h² = 1e-16; the coefficients to a few ε.
                    assert!(
                        (velocity - state.v[i]).abs() < 1e-14,
                        "{kind:?} {scale} {i}: {velocity} {}",
                        state.v[i]
                    );
                }
            }
        }
    }
}
