//! The error that a run tells against the error that it has, on scenes whose end is known.

use phipsi_simulate::scene::{Scene, load};
use phipsi_simulate::{Recording, Summary, run};
use std::path::Path;

/// Factor within which the estimate must lie, the part of runs in which it must, and errors that are too small to matter. At loose
/// tolerances the error of a run may be a thousand times smaller than that of its neighbours by chance, which no second run can know.
const FACTOR: f64 = 10.0;
const PART: f64 = 0.95;
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

/// Scenes, what is changed in them, and how far two tight runs of different methods may be apart: that is what is known of the end.
const SCENES: [(&str, &[&str], f64); 11] = [
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

#[test]
fn the_estimate_is_within_a_factor_of_ten() {
    let (mut count, mut good) = (0, 0);
    let mut table =
        String::from("| scene | method, tolerance | error | estimate | how |\n|---|---|---|---|---|\n");
    for (name, overrides, known) in SCENES {
        let (tight, exact) = end(name, &with(overrides, "dop853", 1e-13, false));
        let (_, other) = end(name, &with(overrides, "tsit5", 1e-12, false));
        let model = tight.simulation.model();
        let apart = |x: &Summary, y: &Summary| {
            model.difference(&x.q, &y.q).iter().fold(0.0f64, |m, x| m.max(x.abs()))
        };
        let doubt = apart(&exact, &other);
        assert!(doubt <= known, "{name}: two tight runs differ by {doubt:e}");
        for method in ["dop853", "tsit5"] {
            for decade in [4, 5, 6, 7, 8, 9, 10] {
                let (_, summary) = end(name, &with(overrides, method, 10f64.powi(-decade), true));
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
                table += &format!(
                    "| {stem} | {method}, 1e-{decade} | {error:.1e} | {told:.1e}{mark} | {} |\n",
                    estimate.how
                );
            }
        }
    }
    println!("{table}\n{good} of {count}");
    assert!(count >= 60, "{count} runs whose error is known");
    assert!(good as f64 >= PART * count as f64, "{good} of {count}");
}
