//! The error that a run tells against the error that it has, on scenes whose end is known.

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
