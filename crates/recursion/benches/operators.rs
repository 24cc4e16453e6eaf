//! Time of the papers' expressions against the number of bodies, on a chain of hinges: slope one where the result is a vector,
//! two where it is a dense n × n matrix. `PHIPSI_WRITE_PAGES=1` writes `docs/src/papers_cost.md` and its picture.

#![allow(non_snake_case)] // the papers' symbols

mod common;

use common::Example;
use phipsi_model::Random;
use phipsi_recursion::Operators;
use phipsi_topology::Operator;
use std::fmt::Write as _;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

/// Bodies, where the result is a vector, and where it is a matrix.
const VECTORS: [usize; 9] = [10, 30, 100, 300, 1000, 3000, 10_000, 30_000, 100_000];
const MATRICES: [usize; 7] = [10, 30, 100, 300, 1000, 2000, 4000];
/// Slopes are fitted over these bodies: below, calls and allocations cost as much as bodies, above, blocks leave the caches.
const CACHED: std::ops::RangeInclusive<usize> = 100..=3000;
const LARGE: std::ops::RangeInclusive<usize> = 3000..=100_000;

/// An expression with its times.
struct Line {
    name: String,
    dense: bool,
    /// (bodies, seconds).
    points: Vec<(usize, f64)>,
}

impl Line {
    /// Slope of log time over log n, by least squares.
    fn slope(&self, bodies: std::ops::RangeInclusive<usize>) -> f64 {
        let inside = self.points.iter().filter(|p| bodies.contains(&p.0));
        let logs = inside.map(|p| ((p.0 as f64).ln(), p.1.ln()));
        let logs: Vec<(f64, f64)> = logs.collect();
        let n = logs.len() as f64;
        let mean = |f: &dyn Fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / n;
        let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
        mean(&|p| (p.0 - x) * (p.1 - y)) / mean(&|p| (p.0 - x).powi(2))
    }
    /// The slope that is asked for: of vectors where they fit into caches, of matrices everywhere.
    fn main_slope(&self) -> f64 {
        self.slope(if self.dense { 100..=4000 } else { CACHED })
    }
}

/// Seconds that this thread had a processor, where the system tells.
fn on_processor() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(1e-9 * text.split(' ').next()?.parse::<f64>().ok()?)
}

/// Calls of more than two milliseconds are interrupted by whatever else runs: of these counts the time on the processor.
const INTERRUPTED: f64 = 2e-3;

/// The shortest of the calls of a quarter of a second; of long calls the mean time on the processor of at least five, or of as
/// many as six seconds allow.
fn seconds(mut call: impl FnMut()) -> f64 {
    let mut clocked = |best: f64| {
        let one = Instant::now();
        call();
        best.min(one.elapsed().as_secs_f64())
    };
    let start = Instant::now();
    // The first call of a kind brings memory in.
    let mut best = clocked(f64::INFINITY);
    if best > INTERRUPTED
        && let Some(before) = on_processor()
    {
        let mut calls = 0;
        while (calls < 5 || start.elapsed().as_secs_f64() < 0.5) && start.elapsed().as_secs_f64() < 6.0 {
            clocked(best);
            calls += 1;
        }
        if let (Some(after), 1..) = (on_processor(), calls) {
            return (after - before) / f64::from(calls);
        }
    }
    while start.elapsed().as_secs_f64() < 0.25 {
        best = clocked(best);
    }
    best
}

/// What is applied to a vector.
fn expressions(ops: &Operators<f64>) -> Vec<Operator<f64>> {
    let last = ops.bodies()[ops.bodies().len() - 1];
    let B = ops.pick_off(&[(last, phipsi_spatial::Vec3::zero())]).expect("a body");
    let J = &(&B.adjoint() * &ops.phi.adjoint()) * &ops.H.adjoint();
    let rates = ops.sensitivity(0).expect("a degree of freedom");
    vec![
        ops.phi.clone(),
        ops.psi.adjoint(),
        J,
        ops.mass_matrix(),
        ops.innovations_operator(),
        ops.mass_matrix_inverse(),
        ops.omega(),
        ops.state_covariance(),
        ops.batch_gain(),
        ops.smoothed_error_covariance(),
        rates.mass_matrix,
    ]
}

fn record(lines: &mut Vec<Line>, name: &str, dense: bool, n: usize, time: f64) {
    println!("  {n:>7}  {:>12.3e} s  {:>9.1} ns a body  {name}", time, 1e9 * time / n as f64);
    match lines.iter_mut().find(|line| line.name == name) {
        Some(line) => line.points.push((n, time)),
        None => lines.push(Line { name: name.into(), dense, points: vec![(n, time)] }),
    }
}

fn measure() -> Vec<Line> {
    let mut lines = vec![];
    for n in VECTORS {
        let example = Example::with_states(&format!("chain_{n}"), 1);
        let (model, state) = (&example.model, &example.states[0]);
        let time = seconds(|| drop(black_box(Operators::new(model, black_box(&state.q)))));
        record(&mut lines, "all operators of a configuration", false, n, time);
        let ops = Operators::new(model, &state.q).expect("a regular state");
        for expression in expressions(&ops) {
            let x: Vec<f64> = (0..expression.columns().dimension()).map(|i| (i % 7) as f64 - 3.0).collect();
            let time = seconds(|| drop(black_box(expression.apply(black_box(&x)))));
            record(&mut lines, &expression.to_string(), false, n, time);
        }
        let time = seconds(|| {
            let filtered = ops.filter(black_box(&state.x)).expect("fits");
            drop(black_box(ops.smooth(&filtered)));
        });
        record(&mut lines, "filter and smoother", false, n, time);
        let (field, mut random) = (ops.random_field(), Random::new(1));
        let time = seconds(|| drop(black_box(field.sample(&mut random))));
        record(&mut lines, "a sample of the random field", false, n, time);
        let time = seconds(|| drop(black_box(ops.sensitivity(0))));
        record(&mut lines, "sensitivities of all operators", false, n, time);
    }
    for n in MATRICES {
        let example = Example::with_states(&format!("chain_{n}"), 1);
        let ops = Operators::new(&example.model, &example.states[0].q).expect("a regular state");
        for expression in [ops.mass_matrix(), ops.mass_matrix_inverse()] {
            let time = seconds(|| drop(black_box(expression.dense())));
            record(&mut lines, &format!("{expression}, dense"), true, n, time);
        }
        let time = seconds(|| drop(black_box(ops.mass_matrix_inverse_by_sweeps())));
        record(&mut lines, "vertical sweeps (Lemma 13), dense", true, n, time);
    }
    lines
}

/// Both axes logarithmic, a line an expression; its name and slope at its right end, spread so that none covers another.
fn picture(lines: &[Line]) -> String {
    let (width, height, left, right, top, bottom) = (960.0, 620.0, 70.0, 400.0, 30.0, 40.0);
    let points = || lines.iter().flat_map(|line| &line.points);
    let most = points().map(|p| p.0 as f64).fold(1.0, f64::max);
    let low = points().map(|p| p.1).fold(1.0, f64::min).log10().floor();
    let high = points().map(|p| p.1).fold(0.0, f64::max).log10().ceil();
    let x = |n: f64| left + (n.log10() - 1.0) / (most.log10() - 1.0) * (width - left - right);
    let y = |t: f64| top + (high - t.log10()) / (high - low) * (height - top - bottom);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" role=\"img\" \
         aria-label=\"Time of the papers' expressions against the number of bodies\"><style>text{{font:12px sans-serif;fill:#1c2126}}\
         .g{{stroke:#d5dbe1}}.v{{stroke:#1d6fb8;fill:none}}.m{{stroke:#c2410c;fill:none}}.v,.m{{stroke-width:1.5}}\
         @media(prefers-color-scheme:dark){{text{{fill:#e4e8ec}}.g{{stroke:#39424c}}.v{{stroke:#6cb6ff}}.m{{stroke:#fb923c}}}}</style>\
         <text x=\"{left}\" y=\"16\">time of one evaluation over bodies of a chain; number: fitted slope</text>"
    );
    for decade in 1..=most.log10() as i32 {
        let at = x(10f64.powi(decade));
        let _ = write!(out, "<path class=\"g\" d=\"M{at:.1} {top}V{:.1}\"/>", height - bottom);
        let _ = write!(
            out,
            "<text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">10{}</text>",
            height - bottom + 18.0,
            raised(decade)
        );
    }
    for decade in low as i32..=high as i32 {
        let at = y(10f64.powi(decade));
        let _ = write!(out, "<path class=\"g\" d=\"M{left} {at:.1}H{:.1}\"/>", width - right);
        let _ = write!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">10{} s</text>",
            left - 8.0,
            at + 4.0,
            raised(decade)
        );
    }
    let mut ends: Vec<(f64, &Line)> =
        lines.iter().map(|line| (y(line.points[line.points.len() - 1].1), line)).collect();
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut last = top - 16.0;
    for (end, line) in ends {
        let class = if line.dense { "m" } else { "v" };
        let path: Vec<String> =
            line.points.iter().map(|&(n, t)| format!("{:.1} {:.1}", x(n as f64), y(t))).collect();
        let _ = write!(out, "<path class=\"{class}\" d=\"M{}\"/>", path.join("L"));
        last = end.max(last + 16.0);
        let from = x(line.points[line.points.len() - 1].0 as f64);
        let _ = write!(
            out,
            "<path class=\"g\" d=\"M{from:.1} {end:.1}L{:.1} {last:.1}\"/>",
            width - right + 14.0
        );
        let _ = write!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\">{:.2}  {}</text>",
            width - right + 18.0,
            last + 4.0,
            line.main_slope(),
            shortened(&line.name)
        );
    }
    out + "</svg>\n"
}

/// An exponent.
fn raised(n: i32) -> String {
    let digit = |c: char| match c {
        '-' => '⁻',
        c => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][c.to_digit(10).unwrap_or(0) as usize],
    };
    n.to_string().chars().map(digit).collect()
}

fn shortened(name: &str) -> String {
    let letters: Vec<char> = name.chars().collect();
    if letters.len() <= 56 { name.into() } else { letters[..55].iter().collect::<String>() + "…" }
}

fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 1e-6 => format!("{:.0} ns", 1e9 * s),
        s if s < 1e-3 => format!("{:.2} µs", 1e6 * s),
        s if s < 1.0 => format!("{:.2} ms", 1e3 * s),
        s => format!("{s:.2} s"),
    }
}

fn page(lines: &[Line]) -> String {
    let mut out = "# Cost of the papers' expressions\n\nEach expression of [The two papers, line by line](papers.md) is applied as sweeps: its time grows like the number of bodies. A dense \
         n × n matrix has n² numbers and costs n sweeps, or the vertical sweeps of Lemma 13. Measured on chains of hinges, one thread, the \
         shortest of many calls, of calls beyond 2 ms the mean time on the processor; slopes are those of log time over log n. Beyond some thousand bodies the blocks, 288 \
         bytes each and one behind the other, no longer fit into caches, which costs a factor once. Of the inverse mass matrix of 4000 bodies a quarter of the entries are themselves subnormal numbers (below 2.2e-308; of 2000 bodies one in a hundred, of 1000 none), with which processors compute many times more slowly: a unit force takes 1.4 to 7.8 ms there, a full vector 0.7 ms. That lifts the slopes of the two inverses above 2; from 100 to 1000 bodies they are 2.0 and 2.1. Written by `PHIPSI_WRITE_PAGES=1 cargo bench -p phipsi-recursion --bench operators`.\n\n\
         ![Time of the papers' expressions against the number of bodies](images/operators.svg)\n\n"
        .to_string();
    for (dense, title) in [(false, "Results that are vectors"), (true, "Results that are matrices")] {
        let sizes: &[usize] = if dense { &MATRICES } else { &VECTORS };
        let heads: Vec<String> = sizes.iter().map(usize::to_string).collect();
        let slopes = if dense {
            "slope 100–4000"
        } else {
            "slope 100–3000 | slope 3000–10⁵ | slope 10–10⁵"
        };
        let columns = sizes.len() + if dense { 1 } else { 3 };
        let _ = write!(out, "## {title}\n\n| expression | {slopes} | {} |\n", heads.join(" | "));
        let _ = writeln!(out, "|---|{}", "---|".repeat(columns));
        for line in lines.iter().filter(|line| line.dense == dense) {
            let mut cells = vec![line.name.clone(), format!("{:.2}", line.main_slope())];
            if !dense {
                cells.extend([LARGE, 10..=100_000].map(|sizes| format!("{:.2}", line.slope(sizes))));
            }
            cells.extend(line.points.iter().map(|p| duration(p.1)));
            let _ = writeln!(out, "| {} |", cells.join(" | "));
        }
        out.push('\n');
    }
    let compiler = common::compiler().unwrap_or_else(|| "unknown".into());
    let _ = writeln!(out, "Processor: {}; compiler: {compiler}.", common::processor());
    out
}

fn main() {
    // `cargo test --benches` runs this, too, and wants no hours.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    common::header("The papers' expressions on a chain of hinges, one state; all numbers f64");
    let lines = measure();
    for line in &lines {
        println!("slope {:.2}  {}", line.main_slope(), line.name);
    }
    if std::env::var_os("PHIPSI_WRITE_PAGES").is_some() {
        let docs = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/src");
        std::fs::write(docs.join("images/operators.svg"), picture(&lines)).expect("the picture");
        std::fs::write(docs.join("papers_cost.md"), page(&lines)).expect("the page");
    }
}
