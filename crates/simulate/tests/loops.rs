//! Scenes with closed loops and prescribed motions: published benchmarks, residuals over long runs, balances, resume.

use phipsi_simulate::scene::{self, Scene};
use phipsi_simulate::{
    Observer, Progress, Recording, Row, RunState, SimulateError, StepRecord, Summary, resume, run,
};
use std::path::{Path, PathBuf};

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/benchmarks")
}

fn parse(text: &str) -> Result<Scene, SimulateError> {
    scene::parse(text.into(), "test", "test.toml", Path::new(""), &[])
}

/// Runs an example without its error estimate; prints what it came to.
fn benchmark(name: &str, overrides: &[&str]) -> Summary {
    let mut given: Vec<String> = overrides.iter().map(|s| s.to_string()).collect();
    given.push("integrator.estimate=false".into());
    let mut scene = scene::load(&examples().join(format!("{name}.toml")), &given).unwrap();
    let summary = run(&mut scene.simulation, &mut Recording::default()).unwrap();
    let closures = summary.closures.unwrap();
    println!(
        "{name} {overrides:?}: reference {:.1e}, energy {:.1e}, closures {:.1e} {:.1e}, removed {:.1e} J, {} steps, \
         {} rejected, {} evaluations, {:.2} s",
        summary.reference_error.unwrap(),
        summary.energy_error,
        closures.position,
        closures.velocity,
        closures.energy_removed,
        summary.steps,
        summary.rejected,
        summary.evaluations,
        summary.wall_s
    );
    for (output, known) in &scene.simulation.known.iter().map(|k| (&k.output, k.value)).collect::<Vec<_>>() {
        let found = summary.outputs.iter().find(|(n, _)| n == *output).unwrap().1;
        println!("    {output}: {found:.15e}, off by {:.1e}", found - known);
    }
    summary
}

#[test]
fn andrews_squeezing_mechanism() {
    let summary = benchmark("andrews", &[]);
    assert!(summary.reference_error.unwrap() <= 1e-12);
}

#[test]
fn four_bars_in_a_row_through_the_singular_pose() {
    let summary = benchmark("n_four_bar", &[]);
    // th = 31.75: its relative error is a 32nd of the position's.
    assert!(summary.reference_error.unwrap() * 32.0 <= 1e-8);
}

#[test]
fn bricards_mechanism() {
    let summary = benchmark("bricard", &[]);
    let q1 = summary.outputs.iter().find(|(name, _)| name == "q1").unwrap().1;
    assert!((q1 - 2.6904888332464651167e-4).abs() <= 1e-9, "{q1}");
}

#[test]
fn spatial_slider_cranks() {
    for name in ["spatial_slider_crank", "spatial_slider_crank_thick"] {
        let summary = benchmark(name, &[]);
        assert!(summary.reference_error.unwrap() <= 1e-9, "{name}");
    }
}

#[test]
fn car_axis() {
    let summary = benchmark("car_axis", &[]);
    assert!(summary.reference_error.unwrap() <= 1e-9);
    // The road does work on the axis, and all of it is counted.
    assert!(summary.energy_error < 1e-9);
}
