//! Files and expressions broken at random: no panic, no hang, and what is accepted is sound.
//!
//! `PHIPSI_FUZZ_SECONDS=60` makes each test run that long, `PHIPSI_FUZZ_SEED=N` starts with another seed. A failure prints
//! the seed of its case.

use phipsi_formats::Expression;
use phipsi_formats::report::Report;
use phipsi_formats::urdf::{Mimic, UrdfOptions, read_urdf, urdf_builder};
use phipsi_model::{Base, Model, Random, Severity};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

/// Everything that the reader knows, and some that it does not.
const EVERYTHING: &str = include_str!("mutation/everything.urdf");

const NUMBERS: [&str; 24] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "1e-9",
    "1e-320",
    "5e-324",
    "1e59",
    "1e61",
    "1e154",
    "1e308",
    "-1.7976931348623157e308",
    "1e309",
    "nan",
    "-inf",
    "inf",
    "0x10",
    "1,5",
    "",
    " ",
    "3.14159265358979",
    "1e",
    "90 90 90",
];

const PIECES: [&str; 34] = [
    "<",
    ">",
    "/>",
    "</",
    "\"",
    "'",
    "&",
    "&#0;",
    "&#x1b;",
    "&lt;",
    "<!--",
    "-->",
    "<![CDATA[",
    "]]>",
    "<?xml ",
    "?>",
    "<!DOCTYPE a>",
    "</robot>",
    "</link>",
    "</joint>",
    "<link name=\"a\"/>",
    "<joint name=\"j\" type=\"fixed\">",
    "<parent link=\"world\"/>",
    "<mimic joint=\"hinge\"/>",
    " xmlns:x=\"y\"",
    " xmlns=\"z\"",
    "xacro:",
    "${p}",
    "world",
    "\u{feff}",
    "\0",
    "é",
    "\u{1f980}",
    "\n",
];

/// Words of one sample in place of those of another.
fn mutate(r: &mut Random, text: &str, pieces: &[&str], numbers: &[&str], other: &str) -> String {
    let mut bytes = text.as_bytes().to_vec();
    // Half of the cases only change numbers: most of those are still read to the end.
    let numbers_only = r.below(2) == 0;
    for _ in 0..1 + r.below(6) {
        let n = bytes.len();
        let at = r.below(n + 1);
        let end = (at + [1, 4, 40, n][r.below(4)].min(1 + r.below(n + 1))).min(n);
        match if numbers_only { 8 } else { r.below(9) } {
            0 if n > 0 => bytes[at.min(n - 1)] ^= 1 << r.below(8),
            1 if n > 0 => bytes[at.min(n - 1)] = r.below(256) as u8,
            2 => {
                bytes.drain(at..end);
            }
            3 => {
                let copy = bytes[at..end].to_vec();
                let to = r.below(n + 1);
                bytes.splice(to..to, copy);
            }
            4 => bytes.truncate(at),
            5 => {
                let from = r.below(other.len());
                let to = (from + r.below(200)).min(other.len());
                bytes.splice(at..end, other.as_bytes()[from..to].iter().copied());
            }
            6 => {
                let piece = pieces[r.below(pieces.len())];
                bytes.splice(at..at, piece.bytes());
            }
            _ => replace_number(r, &mut bytes, at, numbers),
        }
        // Copies of copies may not grow without bound.
        bytes.truncate(200_000);
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Puts another number in the place of the first one behind a position.
fn replace_number(r: &mut Random, bytes: &mut Vec<u8>, at: usize, numbers: &[&str]) {
    let is_number = |b: &u8| b.is_ascii_digit() || *b == b'.' || *b == b'-';
    let Some(start) = bytes[at..].iter().position(is_number).map(|i| at + i) else { return };
    let end = bytes[start..].iter().position(|b| !is_number(b)).map_or(bytes.len(), |i| start + i);
    bytes.splice(start..end, numbers[r.below(numbers.len())].bytes());
}

/// Runs cases until the time is over; a failing one is printed with its seed. A case tells whether its input was accepted.
fn fuzz(name: &str, case: impl Fn(u64) -> bool) {
    let number = |variable: &str| std::env::var(variable).ok().and_then(|text| text.parse::<u64>().ok());
    let duration = number("PHIPSI_FUZZ_SECONDS").map_or(Duration::from_millis(2500), Duration::from_secs);
    let first = number("PHIPSI_FUZZ_SEED").unwrap_or(0);
    let start = Instant::now();
    let (mut seed, mut accepted, mut slowest) = (first, 0, (Duration::ZERO, first));
    while seed == first || start.elapsed() < duration {
        let began = Instant::now();
        match catch_unwind(AssertUnwindSafe(|| case(seed))) {
            Ok(was_accepted) => accepted += u64::from(was_accepted),
            Err(panic) => {
                eprintln!("{name}: PHIPSI_FUZZ_SEED={seed} reproduces this");
                std::panic::resume_unwind(panic);
            }
        }
        slowest = slowest.max((began.elapsed(), seed));
        seed += 1;
    }
    let (cases, (slowest, slow_seed)) = (seed - first, slowest);
    eprintln!("{name}: {cases} cases, {accepted} accepted, slowest {slowest:?} (seed {slow_seed})");
}

fn samples() -> Vec<String> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../validation/data/robots/models");
    let read = |file: &str| std::fs::read_to_string(format!("{folder}/{file}.urdf")).expect(file);
    let mut samples: Vec<String> = ["ur5", "panda", "solo12", "allegro", "chain_0007", "mr_tip_1e9_0064"]
        .into_iter()
        .map(read)
        .collect();
    // The small one that has everything is the most rewarding.
    samples.extend([EVERYTHING, EVERYTHING, EVERYTHING].map(String::from));
    samples
}

#[test]
fn the_sample_with_everything_is_accepted() {
    let read = read_urdf(EVERYTHING, "everything.urdf", &UrdfOptions::default());
    let model = read.value.unwrap_or_else(|| panic!("{}", read.report));
    sound(&model);
    assert_eq!(model.joints().len(), 12);
}

#[test]
fn broken_robots_are_refused_or_sound() {
    let samples = samples();
    fuzz("robots", |seed| {
        let mut r = Random::new(seed);
        let (sample, other) = (&samples[r.below(samples.len())], &samples[r.below(samples.len())]);
        let text = mutate(&mut r, sample, &PIECES, &NUMBERS, other);
        let options = UrdfOptions {
            base: [Base::Fixed, Base::Free][r.below(2)],
            mimic: [Mimic::Closure, Mimic::Free][r.below(2)],
        };
        let built = urdf_builder(&text, "mutation.urdf", &options);
        let read = read_urdf(&text, "mutation.urdf", &options);
        assert_eq!(built.report, read.report);
        assert_eq!(read.value.is_none(), !read.report.errors.is_empty());
        readable(&read.report, &text);
        let (Some(builder), Some(model)) = (built.value, read.value) else { return false };
        assert!(builder.check().iter().all(|violation| violation.severity != Severity::Error));
        sound(&model);
        true
    });
}

/// Every problem says all that it should, on a line that exists.
fn readable(report: &Report, text: &str) {
    let lines = text.split('\n').count();
    for problem in report.errors.iter().chain(&report.warnings) {
        let parts = [&problem.place, &problem.found, &problem.required, &problem.remedy];
        assert!(parts.iter().all(|part| !part.is_empty()), "{problem:?}");
        assert!(problem.line.is_none_or(|line| (1..=lines).contains(&(line as usize))), "{problem:?}");
    }
    assert!(!report.to_string().is_empty());
}

/// Numbers that the dynamics can start from.
fn sound(model: &Model) {
    let finite =
        |what: &str, numbers: &[f64]| assert!(numbers.iter().all(|x| x.is_finite()), "{what} {numbers:?}");
    assert!(!model.joints().is_empty() || model.bodies().is_empty());
    for body in model.bodies() {
        let inertia = &body.inertia;
        assert!(inertia.mass >= 0.0);
        let rigid = inertia.to_rigid::<f64>();
        finite("first moment", &rigid.first_moment.0);
        let j = rigid.inertia;
        finite("inertia", &[rigid.mass, j.xx, j.xy, j.xz, j.yy, j.yz, j.zz]);
    }
    for joint in model.joints() {
        let place = joint.placement.to_transform::<f64>();
        finite("translation", &place.translation.0);
        finite("rotation", place.rotation.0.as_flattened());
        finite("damping and friction", &[joint.damping, joint.friction]);
        finite("limits", &joint.limits.position.unwrap_or_default());
        for limit in [joint.limits.velocity, joint.limits.effort].into_iter().flatten() {
            assert!(limit.is_finite() && limit >= 0.0);
        }
        for axis in joint.kind.axes() {
            let square: f64 = axis.iter().map(|x| x * x).sum();
            assert!(square.is_finite() && square > 0.0, "{axis:?}");
        }
    }
    for coupling in model.couplings() {
        finite("coupling", &[coupling.multiplier, coupling.offset]);
        for name in [&coupling.joint, &coupling.source] {
            let k = model.find_joint(name).expect("a coupling's joint exists");
            assert_eq!(model.joints()[k].kind.nv(), 1);
        }
    }
}

const EXPRESSIONS: [&str; 10] = [
    "0.5*k*(r-r0)^2; k=4; r0=1.5e-1",
    "4*e*((s/r)^12-(s/r)^6); s=0.5*(a+b); e=sqrt(a*b); a=x; b=y",
    "select(step(x-1), min(x, y)^2, max(x, -z)^-3) + abs(floor(x)) - ceil(y)*delta(z)",
    "a*sin(2*pi*x) + b*cos(2*pi*x)*exp(-c*x); a=1; b=2; c=.5",
    "2^3^2 - -x^-y^2 / (1 - z) * x",
    "atan2(x, y) + asin(x/9) + acos(y/9) + atan(z) + sinh(x) + cosh(y) + tanh(z)",
    "erf(x) + erfc(y) + sec(x) + csc(y) + cot(z) + tan(x) + log(y) + recip(z) + square(x) + cube(y)",
    "((((((((x))))))))+((y)-(z))",
    "a0*a0; a0=a1*a1+1; a1=a2*a2+1; a2=a3*a3+1; a3=x*y+z",
    "x + y*z - x/y^z",
];

const EXPRESSION_PIECES: [&str; 30] = [
    "(", ")", "((((", "))))", "-", "--", "^", "^^", "*", "**", "/", "+", ",", ";", "; x = ", "=", "sin(",
    "select(", "min(", "0/0", "1/0", "x", "y", "pi", "é", "\0", " ", "\n", "1e", ".",
];

#[test]
fn broken_expressions_are_refused_or_sound() {
    let joined = EXPRESSIONS.join(" ");
    let variables = ["x", "y", "z", "r"];
    fuzz("expressions", |seed| {
        let mut r = Random::new(seed);
        let sample = EXPRESSIONS[r.below(EXPRESSIONS.len())];
        let text = mutate(&mut r, sample, &EXPRESSION_PIECES, &NUMBERS, &joined);
        let constants = [("pi", std::f64::consts::PI)];
        let parsed = match Expression::parse(&text, &variables, &constants) {
            Ok(parsed) => parsed,
            Err(error) => {
                let columns = text.chars().count() + 1;
                assert!((1..=columns).contains(&error.column), "{error}");
                assert!([&error.found, &error.required, &error.remedy].iter().all(|part| !part.is_empty()));
                return false;
            }
        };
        let derivatives =
            [parsed.derivative("x"), parsed.derivative("r"), parsed.derivative("x").derivative("y")];
        for function in [&parsed].into_iter().chain(&derivatives) {
            let text = function.to_string();
            let again =
                Expression::parse(&text, &variables, &constants).unwrap_or_else(|e| panic!("{text}: {e}"));
            for _ in 0..3 {
                let at: [f64; 4] = std::array::from_fn(|_| 3.0 * r.signed());
                let (value, other) = (function.value(&at), again.value(&at));
                assert!(
                    value == other || (value.is_nan() && other.is_nan()),
                    "{text} is not {again} at {at:?}"
                );
            }
        }
        true
    });
}
