//! Motions with closed forms: the pendulum, torque-free bodies, and a two-body spacecraft that turns by zero angular momentum.

use crate::common::*;
use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder, Placement};
use phipsi_motion::forces::JointTorque;
use phipsi_motion::{Method, Signal};
use serde_json::Value;

fn data() -> Value {
    serde_json::from_str(&std::fs::read_to_string("../../validation/data/closed_form.json").unwrap()).unwrap()
}

fn text(v: &Value) -> f64 {
    v.as_str().expect("digits as text").parse().unwrap()
}

/// IFToMM A01: x = sin φ, y = −cos φ of a pendulum that starts horizontal.
#[test]
fn pendulum_follows_the_elliptic_function() {
    let reference = data();
    for t in ["0.1", "1", "2", "5", "10", "100"] {
        let want = &reference["pendulum_A01"]["at"][t];
        let t_end: f64 = t.parse().unwrap();
        let mut dynamics = free_fall(&pendulum(), vec![]);
        let (end, _) =
            run(&mut dynamics, Method::Dop853, 1e-13, &[std::f64::consts::FRAC_PI_2], &[0.0], t_end);
        let error = (end.q()[0] - text(&want["phi"])).abs();
        // Local errors of 1e-13 a step, some ten steps a second; phases add up linearly in time.
        assert!(error < 1e-12 * (1.0 + 10.0 * t_end), "t = {t}: {error:e}");
    }
}

/// Periods from small amplitudes to a hair below the separatrix, measured at the first return of the velocity to zero.
#[test]
fn pendulum_periods_against_amplitude() {
    let reference = data();
    for (key, want) in reference["pendulum_A01"]["period_vs_amplitude"].as_object().unwrap() {
        let inner = key.split(['(', ')']).nth(1).unwrap().trim_matches('"');
        let small: f64 = inner.parse().unwrap();
        let amplitude = if key.starts_with("pi") { std::f64::consts::PI - small } else { small };
        let half = 0.5 * text(want);
        let mut dynamics = free_fall(&pendulum(), vec![]);
        let (end, _) = run(&mut dynamics, Method::Dop853, 1e-13, &[amplitude], &[0.0], half);
        // After half a period it stands at −amplitude. Near the separatrix ε of the amplitude and of the tolerance grows by the
        // instability exp(√g T/4) at the start.
        let growth = (9.81f64.sqrt() * half / 2.0).exp();
        let error = (end.q()[0] + amplitude).abs();
        assert!(error < 1e-11 * growth, "{key}: {error:e}");
    }
}

/// Euler's equations, five bodies, at t = 1, 10, 50, 100.
#[test]
fn torque_free_bodies_follow_jacobi() {
    let reference = data();
    for case in reference["torque_free"]["cases"].as_array().unwrap() {
        let numbers = |key: &str| -> Vec<f64> { case[key].as_array().unwrap().iter().map(text).collect() };
        let (moments, w0) = (numbers("I"), numbers("w0"));
        let mut v = w0.clone();
        v.extend([0.3, -0.2, 0.1]);
        let norm = |w: &[f64]| (0..3).map(|i| (moments[i] * w[i]).powi(2)).sum::<f64>().sqrt();
        let energy = |w: &[f64]| (0..3).map(|i| moments[i] * w[i] * w[i]).sum::<f64>();
        // Distance from the unstable axis: errors relative to it grow to full size in the first flip; passing the axis again
        // squares it, because E − L²/2I₂, which decides the next flip, is itself d² large.
        let d = (w0[0].hypot(w0[2]) / w0[1].hypot(w0[0].hypot(w0[2]))).min(1.0);
        // Euler's equations hold differences of moments: they cancel in nearly symmetric bodies.
        let gaps = [moments[1] - moments[0], moments[2] - moments[1], moments[2] - moments[0]];
        let cancellation = moments[2] / gaps.iter().fold(f64::INFINITY, |m, g| m.min(g.abs()));
        for (t, want) in case["at"].as_object().unwrap() {
            let model = free_body(moments.clone().try_into().unwrap());
            let mut dynamics = free_fall(&model, vec![]);
            let t_end: f64 = t.parse().unwrap();
            let (end, steps) = run(&mut dynamics, Method::Dop853, 1e-14, &model.neutral::<f64>(), &v, t_end);
            let rounding = steps.len() as f64 * f64::EPSILON;
            let sensitivity = if t_end > 0.45 * text(&case["period"]) { 1.0 / (d * d) } else { 1.0 / d };
            let budget = 10.0 * rounding * sensitivity * cancellation;
            for (what, f) in [("L", &norm as &dyn Fn(&[f64]) -> f64), ("E", &energy)] {
                let drift = (f(&end.v()[..3]) / f(&w0) - 1.0).abs();
                assert!(drift < 20.0 * rounding, "I = {moments:?}, t = {t}: {what} drifts by {drift:e}");
            }
            // A second flip from 1e-8 has lost all digits in double precision; its E and L are still judged above.
            for (i, want) in want.as_array().unwrap().iter().enumerate().filter(|_| budget < 0.1) {
                let error = (end.v()[i] - text(want)).abs();
                assert!(error < budget, "I = {moments:?}, t = {t}, axis {i}: {error:e} > {budget:e}");
            }
        }
    }
}

/// Base angle of two hinged bodies with zero angular momentum against its quadrature:
/// θ = −φ/2 − C/√(A²−B²) atan(√((A−B)/(A+B)) tan(φ/2)).
#[test]
fn two_bodies_turn_as_zero_angular_momentum_says() {
    let (m1, i1, m2, i2, a, b) = (12.0, 1.5, 3.0, 0.4, 0.6, 0.8);
    let z = JointKind::Revolute { axis: [0.0, 0.0, 1.0] };
    let model = ModelBuilder::new("two bodies")
        .body(Body::new("base", Inertia::from_principal(m1, [0.0; 3], [i1; 3])))
        .body(Body::new("arm", Inertia::from_principal(m2, [b, 0.0, 0.0], [i2; 3])))
        .joint(Joint::new("free", JointKind::Free), "world", "base")
        .joint(
            Joint::new("hinge", z).at(Placement { translation: [a, 0.0, 0.0], ..Placement::IDENTITY }),
            "base",
            "arm",
        )
        .gravity([0.0; 3])
        .build()
        .unwrap();
    let torque = JointTorque {
        name: "motor".into(),
        dof: 6,
        value: Signal::function(|t| 0.3 * (1.7 * t).sin(), |t| 0.51 * (1.7 * t).cos()),
    };
    let mut dynamics = free_fall(&model, vec![Box::new(torque)]);
    let (end, _) = run(&mut dynamics, Method::Dop853, 1e-13, &model.neutral::<f64>(), &[0.0; 7], 4.0);
    let phi = end.q()[7];
    assert!(phi.abs() > 0.3 && phi.abs() < 3.0, "the hinge moved by {phi}");
    let mu = m1 * m2 / (m1 + m2);
    let (big_a, big_b) = (i1 + i2 + mu * (a * a + b * b), 2.0 * mu * a * b);
    let c = i2 - i1 + mu * (b * b - a * a);
    let integral = 2.0 / (big_a * big_a - big_b * big_b).sqrt()
        * (((big_a - big_b) / (big_a + big_b)).sqrt() * (0.5 * phi).tan()).atan();
    let want = -0.5 * phi - 0.5 * c * integral;
    let got = 2.0 * end.q()[5].atan2(end.q()[6]);
    assert!((got - want).abs() < 1e-10, "{got} instead of {want}: {:e}", (got - want).abs());
}
