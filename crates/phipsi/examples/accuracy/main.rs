//! How many digits the forms of forward dynamics keep on extreme mechanisms, and what they cost.
//!
//! `cargo run --release -p phipsi --example accuracy` prints the tables of `docs/src/accuracy.md`; with `-- --write` it puts
//! them there; with `-- --costs` it prints the costs alone.

#[path = "../../tests/common/stored.rs"]
mod stored;

use nalgebra::{DMatrix, DVector};
use phipsi::recursion::{
    DynamicsError, Form, FormChoice, FormForwardDynamics, Layout, SquareRootForwardDynamics, forward_info,
    inverse_dynamics, mass_matrix, mass_matrix_inverse,
};
use phipsi::spatial::{Dd, Scalar};
use phipsi_reference::extreme::{Chain, Scene, beyond, scenes};
use phipsi_reference::generate::Case;
use phipsi_reference::sensitivity::{sensitivity, widened};
use std::fmt::Write;
use std::time::Instant;

const FORMS: [Form; 4] = [Form::Plain, Form::Refined, Form::SquareRoot, Form::DoubleDouble];

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/src/accuracy.md");

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let text = if std::env::args().any(|a| a == "--costs") {
        costs()?
    } else {
        format!("{}\n{}", errors()?, costs()?)
    };
    println!("{text}");
    if std::env::args().any(|a| a == "--write") {
        let page = std::fs::read_to_string(PAGE)?;
        let (begin, end) = ("<!-- tables: begin -->\n", "<!-- tables: end -->");
        let first = page.find(begin).ok_or("the page has no mark where tables begin")? + begin.len();
        let last = page.find(end).ok_or("the page has no mark where tables end")?;
        std::fs::write(PAGE, format!("{}\n{text}\n{}", &page[..first], &page[last..]))?;
    }
    Ok(())
}

/// Accelerations in double-double numbers, by the square-root form.
fn truth(case: &Case) -> Result<Vec<Dd>, DynamicsError> {
    let layout = Layout::<Dd>::new(&case.model);
    let mut out = vec![Dd::splat(0.0); layout.nv()];
    let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
    SquareRootForwardDynamics::new(&case.model, &layout).run(&layout, &q, &v, &tau, None, &mut out)?;
    Ok(out)
}

fn largest(x: &[Dd]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.hi.abs()))
}

/// Largest error over largest number.
fn error(a: &[f64], truth: &[Dd]) -> f64 {
    let worst = a.iter().zip(truth).fold(0.0f64, |m, (x, y)| m.max((Dd::from_f64(*x) - *y).hi.abs()));
    worst / largest(truth)
}

/// Accelerations by a factored mass matrix, which is not one of our forms; none if it has no Cholesky factor.
fn factored(layout: &Layout<f64>, case: &Case) -> Result<Option<Vec<f64>>, DynamicsError> {
    let (nv, still) = (layout.nv(), vec![0.0; layout.nv()]);
    let bias = inverse_dynamics(layout, &case.q, &case.v, &still, None)?;
    let matrix = DMatrix::from_row_slice(nv, nv, &mass_matrix(layout, &case.q)?);
    let forces = DVector::from_iterator(nv, case.tau.iter().zip(&bias).map(|(tau, bias)| tau - bias));
    Ok(matrix.cholesky().map(|factor| factor.solve(&forces).as_slice().to_vec()))
}

/// κ₂ of the mass matrix: the largest eigenvalues of M and of M⁻¹, the latter in double-double numbers, for its digits are beyond f64.
fn condition(layout: &Layout<f64>, case: &Case) -> Option<f64> {
    let largest =
        |m: Vec<f64>| DMatrix::from_row_slice(layout.nv(), layout.nv(), &m).symmetric_eigenvalues().max();
    let inverse = mass_matrix_inverse(&Layout::<Dd>::new(&case.model), &widened(&case.q)).ok()?;
    Some(largest(mass_matrix(layout, &case.q).ok()?) * largest(inverse.iter().map(|x| x.hi).collect()))
}

fn errors() -> Result<String, Box<dyn std::error::Error>> {
    let stored_chains = stored::extreme_chains().into_iter().map(|(mut scene, a)| {
        scene.name = format!("{} (stored)", scene.name);
        (scene, Some(a))
    });
    let robots = stored::UNEQUAL.iter().filter_map(|name| stored::robot(name).into_iter().next());
    let all = scenes().into_iter().chain(beyond()).map(|s| (s, None)).chain(stored_chains);
    let all = all.chain(robots.map(|(s, a)| (s, Some(a))));
    let mut table = String::from(
        "| scene | κ | κ₂(M) | M factored | plain | refined | square_root | double_double | auto | its backward error / ε |\n\
         |---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (scene, known) in all {
        let Scene { name, case } = &scene;
        let layout = Layout::<f64>::new(&case.model);
        let exact = truth(case)?;
        if let Some(known) = known {
            // Angles of a URDF file become quaternions, rounded to ε.
            let off = error(&known, &exact);
            if off > 32.0 * f64::EPSILON {
                return Err(
                    format!("{name}: double-double numbers differ from the stored ones by {off:e}").into()
                );
            }
        }
        let (_, sizes) = sensitivity(case, 6, 1, |c| truth(c).unwrap_or_default());
        let kappa = sizes.iter().fold(0.0f64, |m, x| m.max(*x)) / largest(&exact);
        write!(table, "| {name} | {kappa:.1} ")?;
        match condition(&layout, case) {
            Some(condition) => write!(table, "| {condition:.0e} ")?,
            None => table += "| – ",
        }
        match factored(&layout, case)? {
            Some(a) => write!(table, "| {:.0e} ", error(&a, &exact))?,
            None => table += "| fails ",
        }
        let run = |form| -> Result<(Vec<f64>, Form), DynamicsError> {
            let mut forward = FormForwardDynamics::new(&case.model, &layout, form);
            let mut out = vec![0.0; layout.nv()];
            forward.run(&layout, &case.q, &case.v, &case.tau, None, &mut out)?;
            Ok((out, forward.form()))
        };
        for form in FORMS {
            match run(form) {
                Ok((a, _)) => write!(table, "| {:.0e} ", error(&a, &exact))?,
                Err(_) => table += "| fails ",
            }
        }
        let (a, form) = run(Form::Auto)?;
        // It needs the plain recursion's factors, which may not exist.
        let info = forward_info(&layout, &case.q, &case.v, &case.tau, None, &a);
        let backward = info.map_or("–".into(), |i| format!("{:.0e}", i.backward_error / f64::EPSILON));
        writeln!(table, "| {form} | {backward} |")?;
    }
    Ok(table)
}

/// Nanoseconds per body, median of `rounds`, of every form in turn.
fn costs() -> Result<String, Box<dyn std::error::Error>> {
    let mut table = String::from(
        "| chain of | plain, ns a body | refined / plain | square_root / plain | double_double / plain | choosing / plain |\n\
         |---|---|---|---|---|---|\n",
    );
    for n in [7, 64, 1000] {
        let scene = Chain::uniform(n).scene("", 1, 0.3, 1.0);
        let case = &scene.case;
        let layout = Layout::<f64>::new(&case.model);
        let mut out = vec![0.0; layout.nv()];
        let mut kernels = FORMS.map(|form| FormForwardDynamics::new(&case.model, &layout, form));
        let calls = 20_000 / n;
        let mut times = vec![Vec::new(); FORMS.len() + 1];
        for _ in 0..41 {
            for (kernel, times) in kernels.iter_mut().zip(&mut times) {
                let start = Instant::now();
                for _ in 0..calls {
                    kernel.run(&layout, &case.q, &case.v, &case.tau, None, &mut out)?;
                    std::hint::black_box(&mut out);
                }
                times.push(start.elapsed().as_secs_f64() / (calls * n) as f64);
            }
            let start = Instant::now();
            std::hint::black_box(FormChoice::of(&case.model, &layout));
            times[FORMS.len()].push(start.elapsed().as_secs_f64() / n as f64);
        }
        let medians: Vec<f64> = times
            .iter_mut()
            .map(|t| {
                t.sort_by(f64::total_cmp);
                t[t.len() / 2]
            })
            .collect();
        write!(table, "| {n} | {:.0} ", 1e9 * medians[0])?;
        for x in &medians[1..] {
            write!(table, "| {:.1} ", x / medians[0])?;
        }
        table += "|\n";
    }
    Ok(table)
}
