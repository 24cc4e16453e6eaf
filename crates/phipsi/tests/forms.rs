//! Forms of forward dynamics against accelerations that are known to many digits.

#[path = "common/stored.rs"]
mod stored;

use phipsi::recursion::{Form, FormChoice, FormForwardDynamics, Layout, forward_info};
use phipsi_reference::extreme::Scene;

/// Largest error over largest number of one form.
fn error(scene: &Scene, known: &[f64], form: Form) -> f64 {
    let case = &scene.case;
    let layout = Layout::<f64>::new(&case.model);
    let mut a = vec![0.0; layout.nv()];
    let mut forward = FormForwardDynamics::new(&case.model, &layout, form);
    forward
        .run(&layout, &case.q, &case.v, &case.tau, None, &mut a)
        .unwrap_or_else(|e| panic!("{}: {e}", scene.name));
    let info = forward_info(&layout, &case.q, &case.v, &case.tau, None, &a).unwrap();
    let allowed = 100.0 * layout.len() as f64 * f64::EPSILON;
    if matches!(form, Form::Auto | Form::SquareRoot) {
        assert!(info.backward_error <= allowed, "{}: backward error {:e}", scene.name, info.backward_error);
    }
    let scale = known.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    a.iter().zip(known).fold(0.0, |m, (x, y)| m.max((x - y).abs() / scale))
}

/// Chains in quadruple precision. The square-root form keeps 1e-12 for the tip of 1e9 and 1e-14 elsewhere. `auto` may take the refined
/// form, which keeps n ε κ: κ is 30 at most (docs/src/accuracy.md), but of the straight chain, which rounds less.
#[test]
fn extreme_chains_agree_with_quadruple_precision() {
    let chains = stored::extreme_chains();
    assert_eq!(chains.len(), 6);
    for (scene, known) in &chains {
        let line: f64 = if scene.name == "tip mass 1e9" { 1e-12 } else { 1e-14 };
        let refined = 30.0 * scene.case.model.nv() as f64 * f64::EPSILON;
        for (form, line) in [(Form::SquareRoot, line), (Form::Auto, line.max(refined))] {
            let found = error(scene, known, form);
            assert!(found <= line, "{}, {form}: {found:e}", scene.name);
        }
        let found = error(scene, known, Form::DoubleDouble);
        // What is stored is read as f64.
        assert!(found <= f64::EPSILON, "{}, double-double: {found:e}", scene.name);
    }
}

/// 64 links, one tip or every other link heavier by 1e3, 1e6, 1e9.
#[test]
fn unequal_masses_agree_with_a_hundred_digits_in_every_form() {
    for name in stored::UNEQUAL {
        let samples = stored::robot(name);
        assert!(!samples.is_empty(), "{name}");
        for (scene, known) in &samples {
            for form in [Form::SquareRoot, Form::DoubleDouble, Form::Refined] {
                let found = error(scene, known, form);
                assert!(found <= 1e-13, "{}, {form}: {found:e}", scene.name);
            }
            let found = error(scene, known, Form::Auto);
            assert!(found <= 1e-12, "{}, auto: {found:e}", scene.name);
        }
        let model = &samples[0].0.case.model;
        let choice = FormChoice::of(model, &Layout::new(model));
        let expected = match name {
            "mr_tip_1e6_0064" => Form::Refined,
            "mr_tip_1e9_0064" => Form::SquareRoot,
            _ => Form::Plain,
        };
        assert_eq!(choice.form, expected, "{name}: {choice}");
    }
}
