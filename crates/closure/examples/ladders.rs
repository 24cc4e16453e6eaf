//! Cost of a loop in ladders of 1 to 1000 loops, on three spanning trees:
//! `cargo run --release -p phipsi-closure --example ladders [-- LONGEST]`.
//!
//! Two rails of hinged pieces, a rung between each pair of pieces. *Rails*: both rails are chains of the tree and rungs are closed to the
//! right one, so that all loops are nested (short ladders only: the cost of a loop grows). *Chosen*: the same model after
//! [`choose_tree`]. *Rungs*: the tree that a person would draw, each pair of pieces on the rung below. Accelerations of one state, the
//! workspace kept, kinematics included; the shortest of many samples.

use phipsi_closure::{ClosedDynamics, Conditions, choose_tree};
use phipsi_model::{Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use std::error::Error;
use std::f64::consts::FRAC_PI_2;
use std::time::Instant;

/// Rungs.
const LENGTHS: [usize; 10] = [1, 2, 4, 8, 16, 32, 64, 128, 256, 1000];

/// The longest ladder that is timed on its rails.
const NESTED: usize = 32;

/// Time of one sample, ns: long samples are interrupted by whatever else runs; and of all samples of a case.
const SAMPLE: f64 = 5e5;
const BUDGET: f64 = 1e9;

fn rod(name: &str) -> Body {
    Body::new(name, Inertia::from_principal(1.3, [0.5, 0.1, 0.0], [0.02, 0.11, 0.12]))
}

fn at(x: f64, y: f64, turn: f64) -> Placement {
    Placement::from_xyz_rpy([x, y, 0.0], [0.0, 0.0, turn])
}

fn hinge(name: String, place: Placement) -> Joint {
    Joint::new(name, JointKind::Continuous { axis: [0.0, 0.0, 1.0] }).at(place)
}

/// A square ladder, closed at zero: rungs hang on the tips of the left pieces; `on_rungs`: pieces hang on the rung below.
fn ladder(rungs: usize, on_rungs: bool) -> Result<Model, Box<dyn Error>> {
    let mut builder = ModelBuilder::new("ladder").gravity([0.0, -9.81, 0.0]);
    for i in 0..rungs {
        for (side, y) in [("left", 0.0), ("right", 1.0)] {
            let name = format!("{side}{i}");
            let (parent, place) = match i.checked_sub(1) {
                None => ("world".to_string(), at(0.0, y, 0.0)),
                // A rung stands across: its x axis is the ladder's y.
                Some(below) if on_rungs => (format!("rung{below}"), at(y, 0.0, -FRAC_PI_2)),
                Some(below) => (format!("{side}{below}"), at(1.0, 0.0, 0.0)),
            };
            builder =
                builder.body(rod(&name)).joint(hinge(format!("{name} hinge"), place), parent, name.as_str());
        }
        let (rung, left) = (format!("rung{i}"), format!("left{i}"));
        builder = builder
            .body(rod(&rung))
            .joint(hinge(format!("{rung} hinge"), at(1.0, 0.0, FRAC_PI_2)), left, rung.as_str())
            .closure(Closure {
                name: format!("pin{i}"),
                kind: ClosureKind::Revolute,
                body_a: rung,
                pose_a: at(1.0, 0.0, -FRAC_PI_2),
                body_b: format!("right{i}"),
                pose_b: at(1.0, 0.0, 0.0),
            });
    }
    Ok(builder.build()?)
}

/// ns of one solution at the neutral configuration, the independent rows, and Σ m².
fn time(model: &Model) -> Result<(f64, usize, usize), Box<dyn Error>> {
    let mut work = ClosedDynamics::<f64>::new(model)?;
    let (mut q, v) = (model.neutral(), vec![0.0; model.nv()]);
    let tau: Vec<f64> = (0..model.nv()).map(|i| 0.1 + 0.01 * (i % 7) as f64).collect();
    let mut out = v.clone();
    // Rounding of the frames of long rails.
    work.project_position(&mut q, &Conditions::default())?;
    let mut rank = 0;
    let mut sample = |calls: usize| -> Result<f64, Box<dyn Error>> {
        let before = Instant::now();
        for _ in 0..calls {
            rank = work.run(&q, &v, &tau, &Conditions::default(), &mut out)?.info().rank;
        }
        Ok(before.elapsed().as_nanos() as f64 / calls as f64)
    };
    sample(1)?;
    let calls = (SAMPLE / sample(1)?.max(1.0)).ceil() as usize;
    let (mut least, began) = (f64::INFINITY, Instant::now());
    while least.is_infinite() || (began.elapsed().as_nanos() as f64) < BUDGET {
        least = least.min(sample(calls)?);
    }
    Ok((least, rank, work.nesting()))
}

fn main() -> Result<(), Box<dyn Error>> {
    let longest = std::env::args().nth(1).map_or(Ok(usize::MAX), |n| n.parse())?;
    println!(
        "| loops | rails, ns a loop | Σ m² a loop | choosing, s | chosen, ns a loop | Σ m² a loop | rungs, ns a loop | Σ m² a loop |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for n in LENGTHS.into_iter().filter(|n| *n <= longest) {
        let rails = ladder(n, false)?;
        let cell = |model: &Model| -> Result<String, Box<dyn Error>> {
            let (time, rank, nesting) = time(model)?;
            assert_eq!(rank, 2 * n, "two rows of every loop are independent");
            Ok(format!("{:.0} | {:.0}", time / n as f64, nesting as f64 / n as f64))
        };
        let nested = if n <= NESTED { cell(&rails)? } else { "– | –".into() };
        let before = Instant::now();
        let choice = choose_tree(&rails, &[])?;
        let choosing = before.elapsed().as_secs_f64();
        let (chosen, rungs) = (cell(&choice.model)?, cell(&ladder(n, true)?)?);
        println!("| {n} | {nested} | {choosing:.1e} | {chosen} | {rungs} |");
    }
    Ok(())
}
