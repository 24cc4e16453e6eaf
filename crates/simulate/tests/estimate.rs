//! The error that a run tells against the error that it has, on scenes whose end is known.

use phipsi_simulate::check::check_file;
use phipsi_simulate::folder::results::Plan;
use phipsi_simulate::folder::{RunFolder, Watcher};
use phipsi_simulate::scene::{Scene, load};
use phipsi_simulate::{Recording, Summary, run};
use std::path::Path;

/// Factor within which the estimate must lie, the part of runs in which it must, and errors that are too small to matter. At loose
/// tolerances the error of a run may be a thousand times smaller than that of its neighbours by chance, which no second run can know.
const FACTOR: f64 = 10.0;
const PART: f64 = 0.95;

/// The part of runs on which no way of estimating was chosen: seen 133 of 144.
const PART_ELSEWHERE: f64 = 0.9;
const SMALL: f64 = 1e-12;

struct Silent;

impl Watcher for Silent {}

fn scene(name: &str, overrides: &[String]) -> Scene {
    load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(name), overrides).unwrap()
}

fn with(overrides: &[&str], method: &str, tolerance: f64, estimate: bool) -> Vec<String> {
    let mut all: Vec<String> = overrides.iter().map(|o| o.to_string()).collect();
    all.push(format!("integrator.method={method}"));
    all.push(format!("integrator.rtol={tolerance:e}"));
    all.push(format!("integrator.atol={tolerance:e}"));
    all.push(format!("integrator.estimate={estimate}"));
    all
}

fn end(name: &str, overrides: &[String]) -> (Scene, Summary) {
    let mut scene = scene(name, overrides);
    let summary = run(&mut scene.simulation, &mut Recording::default()).unwrap();
    (scene, summary)
}

/// A scene, what is changed in it, and how far two tight runs of different methods may be apart: that is what is known of the end.
type Known = (&'static str, &'static [&'static str], f64);

const SCENES: [Known; 11] = [
    ("benchmarks/pendulum.toml", &["integrator.t_end=5"], 1e-11),
    ("benchmarks/double_pendulum.toml", &["integrator.t_end=4"], 1e-11),
    ("benchmarks/chain10.toml", &["integrator.t_end=2"], 1e-11),
    ("benchmarks/torque_free.toml", &["integrator.t_end=25"], 1e-10),
    ("benchmarks/andrews.toml", &[], 1e-10),
    ("benchmarks/car_axis.toml", &[], 1e-10),
    ("benchmarks/spatial_slider_crank.toml", &[], 1e-10),
    ("benchmarks/bricard.toml", &["integrator.t_end=3"], 1e-10),
    ("benchmarks/n_four_bar.toml", &["integrator.t_end=2"], 1e-10),
    ("benchmarks/light_cart_pole.toml", &["integrator.t_end=2"], 1e-10),
    ("satellite_arm.toml", &["integrator.t_end=10"], 1e-10),
];

/// Other starts, ends and scenes, on which no way of estimating was chosen.
const OTHERS: [Known; 12] = [
    ("benchmarks/pendulum.toml", &["integrator.t_end=7", "initial.q.hinge=3.0"], 1e-10),
    (
        "benchmarks/double_pendulum.toml",
        &["integrator.t_end=3", "initial.q.hinge1=0.8", "initial.q.hinge2=-1.1"],
        1e-10,
    ),
    (
        "benchmarks/chain10.toml",
        &["integrator.t_end=1.5", "initial.q.hinge1=0.6", "initial.q.hinge5=0.4"],
        1e-10,
    ),
    (
        "benchmarks/torque_free.toml",
        &["integrator.t_end=12", "initial.v.body=[0.4, 0.7, 1.1, 0, 0, 0]"],
        1e-10,
    ),
    ("benchmarks/andrews.toml", &["integrator.t_end=0.02"], 1e-10),
    ("benchmarks/car_axis.toml", &["integrator.t_end=1.6"], 1e-10),
    ("benchmarks/spatial_slider_crank_thick.toml", &["integrator.t_end=2"], 1e-10),
    ("benchmarks/bricard.toml", &["integrator.t_end=1.1"], 1e-10),
    ("benchmarks/n_four_bar.toml", &["integrator.t_end=1.3", "initial.v.a0=2.2"], 1e-10),
    ("benchmarks/light_cart_pole.toml", &["integrator.t_end=3", "initial.q.hinge=2.5"], 1e-9),
    ("satellite_arm.toml", &["integrator.t_end=17"], 1e-10),
    ("satellite_two_arms.toml", &["integrator.t_end=6"], 1e-10),
];

#[test]
fn the_estimate_is_within_a_factor_of_ten() {
    let tolerances = [4, 5, 6, 7, 8, 9, 10].map(|decade| 10f64.powi(-decade));
    assert_within(&SCENES, &tolerances, PART);
}

#[test]
fn it_is_on_scenes_on_which_it_was_not_chosen() {
    assert_within(&OTHERS, &[3e-5, 3e-6, 3e-7, 3e-8, 3e-9, 3e-10], PART_ELSEWHERE);
}

/// Runs every scene with both explicit methods at every tolerance, prints a table of errors and estimates, and counts.
fn assert_within(scenes: &[Known], tolerances: &[f64], part: f64) {
    let (mut count, mut good) = (0, 0);
    let mut table = String::from(
        "| scene | method, tolerance | error | estimate | how | more evaluations |\n|---|---|---|---|---|---|\n",
    );
    for &(name, overrides, known) in scenes {
        let (tight, exact) = end(name, &with(overrides, "dop853", 1e-13, false));
        let (_, other) = end(name, &with(overrides, "tsit5", 1e-12, false));
        let model = tight.simulation.model();
        let apart = |x: &Summary, y: &Summary| {
            model.difference(&x.q, &y.q).iter().fold(0.0f64, |m, x| m.max(x.abs()))
        };
        let doubt = apart(&exact, &other);
        assert!(doubt <= known, "{name}: two tight runs differ by {doubt:e}");
        for method in ["dop853", "tsit5"] {
            for &tolerance in tolerances {
                let (_, summary) = end(name, &with(overrides, method, tolerance, true));
                let error = apart(&summary, &exact);
                // What is not known of the end cannot be told.
                if error < 10.0 * doubt && error > SMALL {
                    continue;
                }
                let estimate = summary.error_estimate.unwrap();
                let told = estimate.q.unwrap_or(f64::INFINITY);
                let within = told <= FACTOR * error && error <= FACTOR * told;
                let fine = within || (error < SMALL && told < SMALL);
                count += 1;
                good += usize::from(fine);
                let mark = if fine { "" } else { " **" };
                let stem = name.trim_start_matches("benchmarks/").trim_end_matches(".toml");
                let more = 100.0 * estimate.evaluations as f64 / summary.evaluations as f64;
                table += &format!(
                    "| {stem} | {method}, {tolerance:.0e} | {error:.1e} | {told:.1e}{mark} | {} | {more:.0} % |\n",
                    estimate.how
                );
            }
        }
    }
    println!("{table}\n{good} of {count}");
    assert!(count >= 60, "{count} runs whose error is known");
    assert!(good as f64 >= part * count as f64, "{good} of {count}");
}

/// An estimate that is left out is said by the plan: by `phipsi check`, in `run.json`, and instead of the number.
#[test]
fn the_plan_says_that_the_estimate_is_left_out() {
    const SAID: &str = "estimate of the error at the end: estimate = false";
    let plan = |estimate: &str| {
        let overrides = [format!("integrator.estimate={estimate}")];
        Plan::new(&scene("benchmarks/pendulum.toml", &overrides).simulation).left_out
    };
    assert!(plan("true").iter().all(|line| !line.starts_with("estimate")), "{:?}", plan("true"));
    assert!(plan("false").iter().any(|line| line == SAID), "{:?}", plan("false"));

    let scratch = tempfile::tempdir().unwrap();
    let path = scratch.path().join("pendulum.toml");
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/benchmarks/pendulum.toml");
    std::fs::copy(example, &path).unwrap();
    assert!(std::fs::read_to_string(&path).unwrap().contains("\nestimate = false\n"));
    let printed = check_file(&path).to_string();
    let (_, after) = printed.split_once("left out:\n").unwrap();
    assert!(after.lines().any(|line| line.trim() == SAID), "{printed}");

    let out = scratch.path().join("run");
    let folder = RunFolder::create(&path, load(&path, &[]).unwrap(), Some(&out)).unwrap();
    let outcome = folder.run(&mut Silent).unwrap();
    assert!(outcome.finished && outcome.file.results.as_ref().unwrap().error_estimate.is_none());
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("run.json")).unwrap()).unwrap();
    let lines = json["plan"]["left_out"].as_array().unwrap();
    assert!(lines.iter().any(|line| line == SAID), "{lines:?}");
    assert!(json["results"]["error_estimate"].is_null());
}

/// Trajectories of molecules part within a picosecond: a run has its conserved quantities, and no second run beside it or after it.
#[test]
fn molecules_have_conserved_quantities_and_no_companion() {
    let short = ["integrator.t_end=1".to_string(), "record.every=0.1".to_string()];
    let mut molecule = scene("ala_dipeptide.toml", &short);
    assert!(molecule.simulation.estimate, "nothing is asked for");
    let left_out = Plan::new(&molecule.simulation).left_out;
    assert!(left_out.iter().any(|line| line.ends_with("the midpoint method reports conserved quantities")));
    let summary = run(&mut molecule.simulation, &mut Recording::default()).unwrap();
    assert!(summary.error_estimate.is_none() && !summary.estimated_beside);
    assert!(summary.energy_error > 0.0 && summary.momentum_error.is_some());
    // One evaluation of the forces at the start and one a step: a companion would add half as many.
    assert_eq!(summary.evaluations, summary.steps + 1);
}
