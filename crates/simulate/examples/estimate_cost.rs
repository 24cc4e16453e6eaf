//! What the error estimate costs: evaluations and time of runs without it, with it on one thread, and with it on a second one.
//!
//! `cargo run --release -p phipsi-simulate --example estimate_cost` prints a table of `docs/src/errors.md`. The three kinds of runs take turns.
//! Times are the shortest of all rounds; the second thread needs a free core: the last column says how busy the machine was.

use phipsi_simulate::scene::load;
use phipsi_simulate::{Recording, Summary, run};
use std::path::Path;
use std::time::Instant;

type Failure = Box<dyn std::error::Error>;

const SCENES: [&str; 7] = [
    "benchmarks/pendulum.toml",
    "benchmarks/double_pendulum.toml",
    "benchmarks/chain10.toml",
    "benchmarks/andrews.toml",
    "benchmarks/bricard.toml",
    "benchmarks/n_four_bar.toml",
    "satellite_arm.toml",
];

/// Time for the runs without an estimate of one scene and tolerance, s.
const LONG: f64 = 0.5;

/// A run with its wall time, s.
fn timed(name: &str, tolerance: f64, estimate: bool, threads: usize) -> Result<(Summary, f64), Failure> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(name);
    let overrides = [
        "integrator.method=dop853".to_string(),
        format!("integrator.rtol={tolerance:e}"),
        format!("integrator.atol={tolerance:e}"),
        format!("integrator.estimate={estimate}"),
    ];
    let mut simulation = load(&path, &overrides)?.simulation;
    simulation.threads = Some(threads);
    let begun = Instant::now();
    let summary = run(&mut simulation, &mut Recording::default())?;
    Ok((summary, begun.elapsed().as_secs_f64()))
}

fn more(ratio: f64) -> String {
    format!("{:.0} %", 100.0 * (ratio - 1.0))
}

/// Mean number of threads that wanted to run in the last minute; more than the processors: none was free.
fn busy() -> String {
    let told = std::fs::read_to_string("/proc/loadavg").ok();
    told.and_then(|text| Some(text.split_whitespace().next()?.into())).unwrap_or_else(|| "unknown".into())
}

fn main() -> Result<(), Failure> {
    println!(
        "| scene | tolerance | how | evaluations of the run | more for the estimate | wall time, ms | more on one thread \
         | more on two threads | load |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for name in SCENES {
        for tolerance in [1e-6, 1e-8, 1e-9, 1e-11] {
            let (mut spent, mut wall) = (0.0, [f64::INFINITY; 3]);
            let mut last = None;
            while spent < LONG {
                for (i, (estimate, threads)) in [(false, 1), (true, 1), (true, 2)].into_iter().enumerate() {
                    let (summary, elapsed) = timed(name, tolerance, estimate, threads)?;
                    spent += if estimate { 0.0 } else { elapsed };
                    wall[i] = elapsed.min(wall[i]);
                    last = Some(summary);
                }
            }
            let summary = last.ok_or("no run")?;
            let estimate = summary.error_estimate.ok_or("no estimate")?;
            let stem = name.trim_start_matches("benchmarks/").trim_end_matches(".toml");
            println!(
                "| {stem} | {tolerance:e} | {} | {} | {:.0} % | {:.2} | {} | {} | {} |",
                estimate.how,
                summary.evaluations,
                100.0 * estimate.evaluations as f64 / summary.evaluations as f64,
                1e3 * wall[0],
                more(wall[1] / wall[0]),
                if summary.estimated_beside { more(wall[2] / wall[0]) } else { "one processor".into() },
                busy(),
            );
        }
    }
    Ok(())
}
