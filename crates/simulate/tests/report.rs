//! Reports: references that agree, orders, advice that holds, chaotic scenes, files.

use phipsi_simulate::report::{Report, report};
use phipsi_simulate::scene::{Scene, load};
use phipsi_simulate::{Recording, run};
use std::path::{Path, PathBuf};

fn benchmark(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/benchmarks").join(name)
}

fn made(path: &Path, overrides: &[&str], seconds: f64) -> (Report, tempfile::TempDir) {
    let scratch = tempfile::tempdir().unwrap();
    let overrides: Vec<String> = overrides.iter().map(|o| o.to_string()).collect();
    let mut scene: Scene = load(path, &overrides).unwrap();
    let out = scratch.path().join("report");
    let (report, folder) = report(path, &mut scene, Some(&out), seconds, &mut ()).unwrap();
    assert_eq!(folder, out);
    assert!(report.finished);
    (report, scratch)
}

/// The advised settings are run as a user would, and the result is compared with the closed form.
#[test]
fn advice_holds_on_a_pendulum_whose_motion_is_known() {
    let path = benchmark("pendulum.toml");
    let (report, scratch) = made(&path, &[], 20.0);
    assert!(report.reference.wide && report.reference.horizon.is_none());
    // Tolerance 1e-13 over 4 periods; measured 5e-13.
    assert!(report.reference.agreement[0] < 1e-11, "{:?}", report.reference.agreement);
    let exact = 0.278_680_673_569_982_94;
    let end = report.reference.states.last().unwrap();
    // The reference itself is right to the rounding of the start, π/2 in f64.
    assert!((end.q[0] - exact).abs() < 1e-14, "{}", end.q[0]);
    for (method, margin) in [("rk4", 0.3), ("midpoint", 0.1)] {
        let order = report.orders.iter().find(|o| o.method == method).unwrap();
        let observed = order.observed.unwrap();
        assert!((observed - f64::from(order.order)).abs() < margin, "{method}: {observed}");
    }
    let mut advised = 0;
    for advice in report.advice.iter().filter(|a| a.error >= 1e-10) {
        let trial = &report.trials[advice.trial.unwrap()];
        assert!(trial.error_q.unwrap() <= advice.error);
        let mut scene = load(&path, &report.settings(trial)).unwrap();
        let summary = run(&mut scene.simulation, &mut Recording::default()).unwrap();
        let error = (summary.q[0] - exact).abs();
        assert!(error <= advice.error, "{}: {error:e}", report.command(trial));
        assert_eq!(summary.evaluations, trial.evaluations);
        advised += 1;
    }
    assert!(advised >= 5);
    let read = |name: &str| std::fs::read_to_string(scratch.path().join("report").join(name)).unwrap();
    assert_eq!(read("runs.csv").lines().count(), report.trials.len() + 1);
    let json: serde_json::Value = serde_json::from_str(&read("report.json")).unwrap();
    assert_eq!(json["runs"].as_array().unwrap().len(), report.trials.len());
    let page = read("index.html");
    assert!(page.contains("<svg") && !page.contains("src=\"http"), "a page that loads nothing");
    assert!(!page.contains("has not ended"));
}

/// A chain whose references part: errors are those up to the horizon, and what lies beyond is not advised on.
#[test]
fn a_chaotic_scene_has_a_horizon() {
    let (report, _scratch) = made(&benchmark("chain10.toml"), &["integrator.t_end=20"], 10.0);
    let horizon = report.reference.horizon.unwrap();
    assert!(horizon > 2.0 && horizon < 15.0, "{horizon}");
    assert!(
        report.warnings.iter().any(|w| w.contains("neighbouring motions separate")),
        "{:?}",
        report.warnings
    );
    let best = report.advice.last().unwrap();
    assert!(best.trial.is_none() && best.why.as_ref().unwrap().contains("agree"));
    assert!(report.trials.iter().any(|t| t.failed.is_none() && t.energy_error < 1e-9));
}

/// A scene of a fixed step: what an adaptive method does not have is removed by the advised command.
#[test]
fn advice_removes_what_another_method_does_not_have() {
    let path = benchmark("pendulum.toml");
    let overrides =
        ["integrator.method=rk4", "integrator.rtol=", "integrator.step=0.01", "integrator.t_end=2"];
    let (report, _scratch) = made(&path, &overrides, 5.0);
    let trial = report.trials.iter().find(|t| t.method == "dop853").unwrap();
    let settings = report.settings(trial);
    assert!(settings.contains(&"integrator.step=".to_string()), "{settings:?}");
    let all: Vec<String> = overrides.iter().map(|o| o.to_string()).chain(settings).collect();
    load(&path, &all).unwrap();
    assert!(report.command(trial).contains("--set integrator.step= "), "{}", report.command(trial));
}
