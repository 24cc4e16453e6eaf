//! The published problems under `examples/benchmarks` against their reference values.

use phipsi_motion::{Method, Scheme};
use phipsi_simulate::scene::{Scene, load};
use phipsi_simulate::{Recording, Summary, run};
use std::path::Path;

fn scene(name: &str, overrides: &[&str]) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/benchmarks").join(name);
    let overrides: Vec<String> = overrides.iter().map(|o| o.to_string()).collect();
    load(&path, &overrides).unwrap()
}

fn end(name: &str, overrides: &[&str]) -> Summary {
    run(&mut scene(name, overrides).simulation, &mut Recording::default()).unwrap()
}

/// The scene's own tolerance is tight: what is left is rounding times the sensitivity of the motion.
#[test]
fn tight_runs_reach_the_reference_values() {
    for (name, line, why) in [
        ("pendulum.toml", 1e-11, "tolerance 1e-13 over four periods; measured 2e-12"),
        (
            "light_cart_pole.toml",
            1e-8,
            "4060 steps through 11 turns of 1e-6 s; accepted is 1e-6, measured 1.5e-9",
        ),
        ("double_pendulum.toml", 1e-11, "neighbouring motions separate a hundredfold; measured 2e-13"),
        ("chain10.toml", 1e-11, "likewise; measured 9e-13"),
        ("torque_free.toml", 1e-8, "four flips multiply rounding by 1e6; measured 1e-9"),
    ] {
        let error = end(name, &[]).reference_error.unwrap();
        assert!(error < line, "{name}: {error:e}, and {line:e} is required ({why})");
    }
}

/// s of the flyball governor at t = 10 s to 1e-10 at a tight tolerance.
#[test]
fn the_flyball_governor_reaches_ten_digits() {
    let summary = end("flyball.toml", &["integrator.method=rodas5p", "integrator.rtol=1e-11"]);
    // Measured 2.5e-12 over all outputs.
    assert!(summary.reference_error.unwrap() < 1e-10, "{:e}", summary.reference_error.unwrap());
}

/// Steps of a hundredth of a second, where an explicit method needs 8e-4 s: s and rod within 1e-5.
#[test]
fn the_flyball_governor_takes_steps_of_a_hundredth_of_a_second() {
    for method in ["rodas4", "rodas5p"] {
        let method = format!("integrator.method={method}");
        let fixed = [method.as_str(), "integrator.rtol=0.1", "integrator.max_step=0.01"];
        let scene = scene("flyball.toml", &fixed);
        let known: Vec<(String, f64)> =
            scene.simulation.known.iter().map(|k| (k.output.clone(), k.value)).collect();
        let summary = end("flyball.toml", &fixed);
        assert!(summary.steps < 1020 && summary.rejected == 0, "{} steps", summary.steps);
        for (name, value) in known.iter().filter(|(name, _)| name == "s" || name == "rod") {
            let found = summary.outputs.iter().find(|(n, _)| n == name).unwrap().1;
            assert!((found - value).abs() < 1e-5, "{method}, {name}: {:e}", found - value);
        }
    }
}

/// `auto` finds that stability sets the explicit steps, and says so; not where the scene is smooth or the tolerance tight.
#[test]
fn auto_takes_an_implicit_method_where_stability_sets_the_step() {
    let choice = |name: &str, overrides: &[&str]| scene(name, overrides).simulation.choice;
    let stiff = choice("flyball.toml", &[]);
    assert_eq!(stiff.method, Scheme::Explicit(Method::Rodas5p));
    assert!(stiff.why.starts_with("stiff: dop853 steps by"), "{}", stiff.why);
    assert_eq!(choice("flyball.toml", &["integrator.rtol=1e-3"]).method, Scheme::Explicit(Method::Rodas4));
    assert_eq!(choice("flyball.toml", &["integrator.rtol=1e-11"]).method, Scheme::Explicit(Method::Dop853));
    let soft = ["force.0.stiffness=80", "force.1.damping=4", "force.2.stiffness=80", "force.3.damping=4"];
    assert_eq!(choice("flyball.toml", &soft).method, Scheme::Explicit(Method::Dop853));
    assert_eq!(choice("chain10.toml", &["integrator.rtol=1e-7"]).method, Scheme::Explicit(Method::Dop853));
}
