//! Chains of beads against their closed-form distributions, with Fixman's potential and without: χ² of many samples.
//!
//! `cargo run --release -p phipsi-molecule --example closed_form_chains -- 1000000` (samples of each case); with a word after the
//! number, only the cases whose name has it, as in `1000000 jointed` or `1000000 'stiff limit'`.
//!
//! A sample is the end of six Monte Carlo trajectories of ten steps, after which nothing is left of the last one. The samples
//! are drawn in threads, each with a stream of its own, so that the numbers do not depend on how many threads run.

#[path = "../tests/common/chains.rs"]
#[allow(dead_code)] // the tests use the rest
mod chains;
#[path = "../tests/common/statistics.rs"]
#[allow(dead_code)] // the tests use the rest
mod statistics;

use chains::*;
use phipsi_model::Model;
use statistics::{correlation, p_value};
use std::f64::consts::PI;
use std::time::Instant;

/// Independent runs of a case.
const RUNS: u64 = 16;

type Density<'a> = &'a (dyn Fn(f64) -> f64 + Sync);

struct Case<'a> {
    name: &'a str,
    model: &'a Model,
    plan: (f64, u64, usize),
    measure: &'a (dyn Fn(&[f64]) -> f64 + Sync),
    range: [f64; 2],
    rigid: Density<'a>,
}

fn run(case: &Case<'_>, samples: usize, only: &str) {
    let uniform = |_: f64| 1.0;
    for fixman in [false, true] {
        let name = format!("{}, {}", case.name, if fixman { "stiff limit" } else { "rigid" });
        if !name.contains(only) {
            continue;
        }
        let clock = Instant::now();
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
        let mut all = vec![(Vec::new(), 0.0); RUNS as usize];
        for first in (0..RUNS).step_by(threads as usize) {
            std::thread::scope(|scope| {
                for (run, out) in (first..RUNS.min(first + threads)).zip(&mut all[first as usize..]) {
                    scope.spawn(move || {
                        let mut x = Vec::new();
                        let own = samples / RUNS as usize;
                        let trials =
                            sample(case.model, fixman, case.plan, own, run, |q| x.push((case.measure)(q)));
                        *out = (x, trials.acceptance().unwrap_or(0.0));
                    });
                }
            });
        }
        let lag = all.iter().map(|(x, _)| correlation(x, 1)).sum::<f64>() / RUNS as f64;
        let acceptance = all.iter().map(|(_, a)| a).sum::<f64>() / RUNS as f64;
        let x: Vec<f64> = all.into_iter().flat_map(|(x, _)| x).collect();
        let (right, wrong): (Density<'_>, Density<'_>) =
            if fixman { (&uniform, case.rigid) } else { (case.rigid, &uniform) };
        println!(
            "| {name} | {} | {acceptance:.3} | {lag:.4} | {:.3} | {:.0e} | {:.0} |",
            x.len(),
            p_value(&x, case.range, 40, right),
            p_value(&x, case.range, 40, wrong),
            clock.elapsed().as_secs_f64(),
        );
    }
}

fn main() {
    let samples = std::env::args().nth(1).and_then(|a| a.parse().ok()).unwrap_or(1_000_000);
    let only = std::env::args().nth(2).unwrap_or_default();
    println!(
        "| chain, distribution | samples | acceptance | correlation of neighbours | p | p of the other distribution | s |"
    );
    println!("|---|---|---|---|---|---|---|");
    let torsion = rotating(&[15.0; 4], 0.15, (-1.0f64 / 3.0).acos());
    let i = torsion.model().nq() - 1;
    run(
        &Case {
            name: "freely rotating, 4 beads: torsion",
            model: torsion.model(),
            plan: (0.05, 10, 6),
            measure: &|q| (PI + q[i]).rem_euclid(2.0 * PI),
            range: [0.0, 2.0 * PI],
            rigid: &|phi| rigid_torsion(15.0, 15.0, -1.0 / 3.0, phi),
        },
        samples,
        &only,
    );
    let masses = [15.0; 3];
    let model = jointed(&masses);
    run(
        &Case {
            name: "freely jointed, 3 beads: cosine of the angle",
            model: &model,
            plan: (0.03, 12, 6),
            measure: &|q| cosines(&model, q)[0],
            range: [-1.0, 1.0],
            rigid: &|u| root_of_constraints(&masses, &[u]),
        },
        samples,
        &only,
    );
}
