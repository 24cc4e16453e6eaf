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
    // Beyond it unrelated methods have one distribution of the kinetic energy.
    distributions_agree(&report, &["dop853", "tsit5"]);
    // Where the motion is known to the end there is none.
    let (report, _scratch) = made(&benchmark("pendulum.toml"), &["integrator.t_end=2"], 5.0);
    assert!(report.trials.iter().all(|t| t.beyond.is_empty()));
}

/// The finest runs of methods: means of the kinetic energy within six standard errors of their difference, from ten pieces each (a t of
/// eighteen degrees of freedom: p = 1e-5).
fn distributions_agree(report: &Report, methods: &[&str]) {
    let finest = methods.iter().map(|method| {
        let mut own = report.trials.iter().rev().filter(|t| t.method == *method && t.failed.is_none());
        own.find(|t| !t.beyond.is_empty()).unwrap_or_else(|| panic!("{method}"))
    });
    let kinetic: Vec<_> = finest.map(|t| t.beyond[0].clone()).collect();
    for pair in kinetic.windows(2) {
        assert_eq!((pair[0].name.as_str(), pair[1].name.as_str()), ("kinetic energy", "kinetic energy"));
        let off = pair[0].mean - pair[1].mean;
        println!("{}; {}", pair[0].describe(), pair[1].describe());
        assert!(off.abs() < 6.0 * pair[0].error.hypot(pair[1].error), "{pair:?}");
        assert!(pair.iter().all(|b| b.deviation > 0.0 && b.quantiles.is_sorted() && b.samples >= 40));
    }
}

/// A molecule: the trajectory's error up to the horizon, some picoseconds; the energy's drift over all of the run; beyond the horizon the
/// distribution of the kinetic energy, which the midpoint method has as unrelated ones have it.
#[test]
fn a_molecule_has_errors_to_the_horizon_and_distributions_beyond() {
    let path = benchmark("../ala_dipeptide.toml");
    let (report, scratch) = made(&path, &["integrator.t_end=40"], 40.0);
    let horizon = report.reference.horizon.unwrap();
    println!("horizon {horizon} ps");
    assert!(horizon > 0.1 && horizon < 20.0, "{horizon}");
    let fine: Vec<_> =
        report.trials.iter().filter(|t| t.failed.is_none() && t.method == "midpoint").collect();
    assert!(fine.len() >= 3, "{}", fine.len());
    // Errors fall with the step as long as the motion is known; the energy's drift is of the whole run.
    let errors: Vec<f64> = fine.iter().map(|t| t.error_q.unwrap()).collect();
    assert!(errors[errors.len() - 1] < errors[0], "{errors:?}");
    assert!(fine.iter().all(|t| t.drift.is_some() && t.energy_error < 1e-2), "{fine:?}");
    distributions_agree(&report, &["dop853", "midpoint"]);
    let read = |name: &str| std::fs::read_to_string(scratch.path().join("report").join(name)).unwrap();
    let json: serde_json::Value = serde_json::from_str(&read("report.json")).unwrap();
    let runs = json["runs"].as_array().unwrap();
    let shown = runs.iter().filter_map(|run| run["beyond_horizon"].as_array()?.first());
    assert!(shown.clone().count() >= 4 && shown.into_iter().all(|b| b["name"] == "kinetic energy"));
    assert!(json["reference"]["horizon"].as_f64() == Some(horizon));
    assert!(read("index.html").contains("Beyond the horizon: kinetic energy"));
    assert!(read("runs.csv").lines().next().unwrap().contains("kinetic_beyond,kinetic_beyond_error"));
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
