//! Simeon's slider-crank with a flexible rod: its published end, and what each of its terms changes.

use phipsi_simulate::scene::load;
use phipsi_simulate::{Recording, Summary, run};
use std::f64::consts::PI;
use std::path::Path;

const LENGTH: f64 = 0.3;
const MASS: f64 = 0.151104;

fn end(overrides: &[String]) -> Summary {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/benchmarks/slider_crank_flexible.toml");
    let mut scene = load(&path, overrides).unwrap();
    run(&mut scene.simulation, &mut Recording::default()).unwrap()
}

fn known() -> Vec<f64> {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/benchmarks/slider_crank_flexible.toml");
    let scene = load(&path, &[]).unwrap();
    ["q1", "q2", "q3", "q4"]
        .map(|name| scene.simulation.known.iter().find(|known| known.output == name).unwrap().value)
        .to_vec()
}

/// Relative differences of q1 to q4.
fn differences(summary: &Summary, wanted: &[f64]) -> Vec<f64> {
    let found = |i: usize| summary.outputs.iter().find(|(name, _)| *name == format!("q{}", i + 1)).unwrap().1;
    (0..4).map(|i| (found(i) / wanted[i] - 1.0).abs()).collect()
}

/// What bends by 1e-6 m asks for an absolute tolerance of its own.
fn tolerance(rtol: f64) -> Vec<String> {
    vec![format!("integrator.rtol={rtol:e}"), format!("integrator.atol={:e}", 1e-5 * rtol)]
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most, x| x.abs().max(most))
}

/// q1 to q4 at t = 0.1, of 2e-4 to 5e-6 m, against the published equations in double-double numbers. Below 1e-13 the errors are
/// rounding, a random walk of N = 6000 steps: 150 t and t round to 9e-16 rad and 7e-18 s at most, the crank's pin to 2e-16 m in a step,
/// of which a tenth reaches a mode along the rod: 0.1 · 2e-16 m √N = 1.5e-15 m at most, 2e-16 m as seen of 5e-6 m.
#[test]
fn the_flexible_slider_crank_reaches_its_published_end() {
    let wanted = known();
    println!("| `rtol` | evaluations | q1 | q2 | q3 | q4 |\n|---|---|---|---|---|---|");
    let errors = |rtol: f64| {
        let summary = end(&tolerance(rtol));
        let all = <[f64; 4]>::try_from(differences(&summary, &wanted)).unwrap();
        let [a, b, c, d] = all;
        println!("| {rtol:.0e} | {} | {a:.0e} | {b:.0e} | {c:.0e} | {d:.0e} |", summary.evaluations);
        all
    };
    for (rtol, budget) in [(1e-8, 1e-4), (1e-10, 1e-6), (1e-12, 1e-8)] {
        let worst = largest(&errors(rtol));
        assert!(worst < budget, "rtol = {rtol:e}: {worst:e}");
    }
    for rtol in [8e-14, 5e-14, 3e-14, 2e-14, 1e-14] {
        let worst = largest(&errors(rtol));
        assert!(worst < 1e-10, "rtol = {rtol:e}: {worst:e}");
    }
}

/// Products of modes, S_lm: the entry of the matrix that is not zero.
fn products(longitudinal: f64, mixed: f64) -> String {
    let entry = |l: usize, m: usize, (i, j): (usize, usize), value: f64| {
        let mut rows = [[0.0; 3]; 3];
        rows[i][j] = value;
        format!("{{ modes = [{l}, {m}], matrix = {rows:?} }}")
    };
    let all = [
        entry(1, 1, (1, 1), 0.5 * MASS),
        entry(2, 2, (1, 1), 0.5 * MASS),
        entry(3, 3, (0, 0), 8.0 * longitudinal * MASS),
        entry(3, 4, (0, 0), longitudinal * MASS),
        entry(4, 4, (0, 0), 2.0 * longitudinal * MASS),
        entry(3, 1, (0, 1), mixed * MASS * 16.0 / PI.powi(3)),
        entry(4, 1, (0, 1), mixed * MASS * (1.0 / PI - 8.0 / PI.powi(3))),
        entry(4, 2, (0, 1), -0.5 * mixed * MASS / PI),
    ];
    format!("body.1.flexible.integrals.product=[{}]", all.join(", "))
}

/// What changes at t = 0.1 where a term of the rod is left out or put in, relative; known from the published equations with terms
/// switched off: all of the first, and q1 of the second, which depends on η² in the inertia alone.
#[test]
fn terms_of_the_slider_crank_change_what_is_known() {
    let run = |terms: &[String]| end(&[tolerance(1e-9), terms.to_vec()].concat());
    let base = run(&[]);
    let wanted: Vec<f64> =
        ["q1", "q2", "q3", "q4"].map(|n| base.outputs.iter().find(|(m, _)| m == n).unwrap().1).to_vec();
    // Without effect if nothing is changed: the text above is the scene's.
    let same = run(&[products(1.0, 1.0)]);
    assert!(largest(&differences(&same, &wanted)) < 1e-6, "{:?}", differences(&same, &wanted));
    let modal = format!(
        "body.1.flexible.integrals.rotary_modal={:?}",
        [[0.5, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 8.0, 1.0], [0.0, 0.0, 1.0, 2.0]]
            .map(|row| row.map(|x| x * MASS))
    );
    let none = "body.1.flexible.integrals.product=[]".to_string();
    // −1/L ∫ φ_l′ φ_m′ up to x, over the rod, with the weights 1 and x, and at the tip.
    let second = |l: f64| (l * PI).powi(2);
    let pairs = [
        (1, 1, second(1.0) / 4.0, second(1.0) / 6.0 - 0.125),
        (2, 2, second(2.0) / 4.0, second(2.0) / 6.0 - 0.125),
        (1, 2, 20.0 / 9.0, 10.0 / 9.0),
    ];
    let vector = |l: usize, m: usize, x: f64| format!("{{ modes = [{l}, {m}], vector = [{x:?}, 0, 0] }}");
    let list = |key: &str, entries: Vec<String>| format!("body.1.flexible.{key}=[{}]", entries.join(", "));
    let stiffening = [
        list(
            "integrals.stiffening_displacement",
            pairs.iter().map(|p| vector(p.0, p.1, -MASS / LENGTH * p.2)).collect(),
        ),
        list(
            "integrals.stiffening_moment",
            pairs
                .iter()
                .map(|p| {
                    format!(
                        "{{ modes = [{}, {}], matrix = [[{:?}, 0, 0], [0, 0, 0], [0, 0, 0]] }}",
                        p.0,
                        p.1,
                        -MASS * p.3
                    )
                })
                .collect(),
        ),
        list(
            "nodes.0.quadratic",
            [1.0, 2.0].map(|l| vector(l as usize, l as usize, -second(l) / (2.0 * LENGTH))).to_vec(),
        ),
    ];
    println!("| term | q1 | q2 | q3 | q4 |\n|---|---|---|---|---|");
    for (what, terms, known) in [
        (
            "longitudinal S_xx of the shapes, a fifteenth",
            vec![products(1.0 / 15.0, 1.0)],
            &[6e-5, 2e-4, 8e-3, 7e-3][..],
        ),
        (
            "no products S_lm beyond M_ee: η² in the inertia and its velocity terms",
            vec![none, modal],
            &[9e-3],
        ),
        (
            "no products of bending and stretching: inertia and Coriolis terms of η_1 η̇_3 and such",
            vec![products(1.0, 0.0)],
            &[],
        ),
        ("rotary inertia of the sections", vec!["body.1.flexible.integrals.rotary=".into()], &[]),
        ("shortening by bending put in (geometric stiffening)", stiffening.to_vec(), &[]),
    ] {
        let changed = differences(&run(&terms), &wanted);
        println!(
            "| {what} | {:.0e} | {:.0e} | {:.0e} | {:.0e} |",
            changed[0], changed[1], changed[2], changed[3]
        );
        for (found, known) in changed.iter().zip(known) {
            // One digit is known.
            assert!((found / known - 1.0).abs() < 0.5, "{what}: {changed:?}");
        }
    }
}
