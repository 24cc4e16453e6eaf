//! The two papers, executable: a row for every numbered equation, lemma and identity about operators and recursions, each with
//! two evaluations that are compared, and the page that tells how far they differ. `PHIPSI_WRITE_PAGES=1` writes the page.
#![allow(non_snake_case)] // the papers' symbols

pub mod closed;
pub mod covariance_table;
pub mod covariances;
pub mod dynamics_derivatives;
pub mod factors;
pub mod filter;
pub mod inverse;
pub mod operators;
pub mod page;
pub mod random_field;
pub mod row;
pub mod scene;
pub mod sensitivities;

use nalgebra::DMatrix;
use page::Measured;
use phipsi_model::Random;
use phipsi_reference::generate::Case;
use phipsi_reference::sensitivity::{STEP, perturbed};
use phipsi_spatial::{Dd, Real, Scalar};
use row::{Domain, Equations, Form, Row};
use scene::{LONG, PLANS, SHORT, Scene, Shape};

/// Generated trees beside the shapes of one's own.
const GENERATED: u64 = 30;
/// Perturbations that κ is estimated from; a residual above the budget is tried again with more.
const SAMPLES: u64 = 2;
const MORE_SAMPLES: u64 = 8;
/// Residuals allowed, in units of n·ε·κ: as the kernels'.
const BUDGET: f64 = crate::common::FACTOR;
/// A statement that must fail is off by at least this much, relative to its size: more than any rounding.
const WRONG: f64 = 1e-6;

fn rows() -> Vec<Row> {
    [
        random_field::rows(),
        filter::rows(),
        covariances::rows(),
        covariance_table::rows(),
        inverse::rows(),
        operators::rows(),
        factors::rows(),
        sensitivities::rows(),
        dynamics_derivatives::rows(),
        closed::rows(),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn largest<T: Real>(a: &DMatrix<T>) -> f64 {
    a.iter().fold(0.0f64, |m, x| if x.is_finite() { m.max(x.abs().to_f64()) } else { f64::INFINITY })
}

fn distance<T: Real>(a: &DMatrix<T>, b: &DMatrix<T>) -> f64 {
    assert_eq!(a.shape(), b.shape());
    largest(&(a - b))
}

/// Largest residual of the equations relative to the sides, over the parts.
fn relative<T: Real>(equations: &Equations<T>) -> f64 {
    let of = |left: &Form<T>, right: &Form<T>| {
        let (left, right) = (left.dense(), right.dense());
        let size = largest(&left).max(largest(&right));
        if size == 0.0 { 0.0 } else { distance(&left, &right) / size }
    };
    equations.parts.iter().map(|part| of(&part.left, &part.right)).fold(0.0, f64::max)
}

fn relative_of_print<T: Real>(equations: &Equations<T>) -> Option<f64> {
    let (left, right) = equations.printed.as_ref()?;
    let (left, right) = (left.dense(), right.dense());
    let size = largest(&left).max(largest(&right));
    Some(if size == 0.0 { 0.0 } else { distance(&left, &right) / size })
}

fn serves(domain: Domain, shape: Shape) -> bool {
    match domain {
        Domain::Trees => true,
        Domain::Chains => shape.chain,
        Domain::Free => shape.free,
    }
}

/// The left sides and what sets their scale, dense.
fn sized(equations: &Equations<Dd>) -> Vec<[DMatrix<Dd>; 2]> {
    let scale =
        |form: &Option<Form<Dd>>, left: &DMatrix<Dd>| form.as_ref().map_or_else(|| left.clone(), Form::dense);
    equations
        .parts
        .iter()
        .map(|part| {
            let left = part.left.dense();
            [scale(&part.scale, &left), left]
        })
        .collect()
}

/// One case in both numbers, with perturbed ones.
struct Trial {
    name: String,
    plain: Scene<f64>,
    wide: Scene<Dd>,
    perturbed: Vec<Scene<Dd>>,
    /// n times what an elimination may lose beyond κ: 𝓜's condition once its diagonal is scaled to ones (Demmel 1989). It is
    /// at least the growth of the filter, the largest ratio of composite to articulated inertia.
    unit: f64,
}

impl Trial {
    fn new(name: String, case: &Case, seed: u64) -> Self {
        let unit = crate::common::steps(case) * crate::common::scaled_condition(case);
        let mut trial = Trial {
            name,
            plain: Scene::new(case, seed),
            wide: Scene::new(case, seed),
            perturbed: vec![],
            unit,
        };
        trial.perturb(SAMPLES);
        trial
    }
    fn perturb(&mut self, count: u64) {
        let (case, seed) = (&self.wide.case, self.wide.seed);
        let have = self.perturbed.len() as u64;
        let of = |i: u64| Scene::new(&perturbed(case, &mut Random::new(seed ^ (i << 32)), STEP), seed);
        let more: Vec<Scene<Dd>> = (have..count).map(of).collect();
        self.perturbed.extend(more);
    }

    /// κ of every part: the largest |change| over the perturbations for a relative change of one, at least the size.
    fn kappa(&self, row: &Row) -> Vec<f64> {
        let exact = sized(&(row.wide)(&self.wide));
        let mut sizes: Vec<f64> =
            exact.iter().map(|[scale, left]| largest(scale).max(largest(left))).collect();
        for other in &self.perturbed {
            let other = sized(&(row.wide)(other));
            assert_eq!(other.len(), exact.len(), "{}, {}", row.number, self.name);
            for (size, (a, b)) in sizes.iter_mut().zip(exact.iter().zip(&other)) {
                let change = |i: usize| distance(&a[i], &b[i]) / STEP;
                *size = size.max(change(0)).max(change(1));
            }
        }
        sizes
    }

    /// Residuals in units of n·ε·κ, f64 and double-double; none if the row has nothing to say here.
    fn residuals(&self, row: &Row) -> Option<[f64; 2]> {
        let (plain, wide) = ((row.plain)(&self.plain), (row.wide)(&self.wide));
        if wide.parts.is_empty() {
            return None;
        }
        let mut worst = [0.0f64; 2];
        for (i, kappa) in self.kappa(row).into_iter().enumerate() {
            let ratio = |residual: f64, epsilon: f64| {
                let ratio = if residual == 0.0 { 0.0 } else { residual / (self.unit * epsilon * kappa) };
                if ratio.is_nan() { f64::INFINITY } else { ratio }
            };
            let residual = distance(&plain.parts[i].left.dense(), &plain.parts[i].right.dense());
            worst[0] = worst[0].max(ratio(residual, f64::EPSILON));
            let residual = distance(&wide.parts[i].left.dense(), &wide.parts[i].right.dense());
            worst[1] = worst[1].max(ratio(residual, Dd::EPSILON));
        }
        Some(worst)
    }
}

/// The trials: own shapes and generated ones, or those of the seed in `PHIPSI_SEED`.
fn trials() -> Vec<Trial> {
    let seeds = crate::common::seeds(GENERATED);
    let own: Vec<u64> = if seeds.len() == 1 { seeds.clone() } else { vec![1, 2] };
    let mut all = vec![];
    for &seed in &own {
        for plan in &PLANS {
            all.push(Trial::new(plan.name.to_string(), &scene::planned(plan, seed), seed));
        }
    }
    for seed in seeds {
        all.push(Trial::new("generated".into(), &scene::generated(seed), seed));
    }
    all
}

/// Runs every row on every trial. Everything that is wrong is told, not the first only.
fn measure(rows: &[Row]) -> (Vec<Measured>, Vec<String>) {
    let mut trials = trials();
    let chains = [SHORT, LONG].map(|n| Scene::<f64>::new(&scene::chain(n), 3));
    let mut wrong = vec![];
    let mut all = vec![];
    for row in rows {
        let mut measured = Measured::default();
        for trial in &mut trials {
            let place = format!("{}, {}, PHIPSI_SEED={}", row.number, trial.name, trial.wide.seed);
            if row.domain == Domain::Chains && trial.wide.shape.two_levels && trial.name != "generated" {
                let off = relative(&(row.wide)(&trial.wide));
                if off < WRONG {
                    wrong.push(format!("{place}: holds to {off:.1e} on a tree, where it should not"));
                }
                measured.on_trees = Some(measured.on_trees.map_or(off, |m: f64| m.min(off)));
            }
            if !serves(row.domain, trial.wide.shape) {
                continue;
            }
            let Some(mut worst) = trial.residuals(row) else { continue };
            if worst.iter().any(|&r| r > BUDGET) {
                trial.perturb(MORE_SAMPLES);
                worst = trial.residuals(row).expect("as before");
            }
            for (ratio, number) in worst.iter().zip(["f64", "double-double"]) {
                if *ratio > BUDGET {
                    wrong.push(format!("{place}: {ratio:.1} n·ε·κ in {number}"));
                }
            }
            measured.scenes += 1;
            measured.plain = measured.plain.max(worst[0]);
            measured.wide = measured.wide.max(worst[1]);
            if let Some(off) = relative_of_print(&(row.wide)(&trial.wide)) {
                measured.printed = Some(measured.printed.map_or(off, |m: f64| m.max(off)));
            }
        }
        if measured.printed.is_some_and(|off| off < WRONG) {
            wrong.push(format!("{}: the printed form holds", row.number));
        }
        let [short, long] =
            chains.each_ref().map(|chain| match (row.plain)(chain).parts.into_iter().next() {
                Some(row::Part { left: Form::Expression(a), .. }) => Some((a.to_string(), a.cost())),
                _ => None,
            });
        if let (Some((text, few)), Some((_, many))) = (short, long) {
            measured.expression = text;
            measured.cost = Some((many - few) / (LONG - SHORT) as u64);
        }
        println!("{}: {} scenes, {:.1e} {:.1e}", row.number, measured.scenes, measured.plain, measured.wide);
        all.push(measured);
    }
    (all, wrong)
}

/// Every row is executed, holds within its budget in f64 and in double-double numbers, and fails where it must; the page says
/// what the checks give.
#[test]
fn the_papers_hold_line_by_line() {
    let rows = rows();
    let mut numbers: Vec<&str> = rows.iter().map(|row| row.number).collect();
    numbers.sort_unstable();
    assert!(numbers.windows(2).all(|pair| pair[0] != pair[1]), "a number twice: {numbers:?}");
    let (measured, wrong) = measure(&rows);
    assert!(wrong.is_empty(), "{} rows are wrong:\n{}", wrong.len(), wrong.join("\n"));
    let one_seed = std::env::var_os("PHIPSI_SEED").is_some();
    for (row, measured) in rows.iter().zip(&measured) {
        assert!(one_seed || measured.scenes > 1, "{}: no executed check", row.number);
        let failed = row.domain != Domain::Chains || measured.on_trees.is_some();
        assert!(failed, "{}: not tried on a tree", row.number);
    }
    if !one_seed {
        let pairs: Vec<(Row, Measured)> = rows.into_iter().zip(measured).collect();
        page::write_or_compare(&page::text(&pairs, BUDGET, ""));
    }
}
