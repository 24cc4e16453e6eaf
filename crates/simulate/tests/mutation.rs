//! Hostile scenes: mutated bytes and shuffled lines never make the reader panic, and what it accepts runs or says why not.

use phipsi_model::{Random, State};
use phipsi_simulate::scene::parse;
use phipsi_simulate::{Observer, Recording, Row, SimulateError, StepRecord, run};
use std::path::Path;
use std::time::{Duration, Instant};

const SEED: &str = r#"
title = "everything"
[model]
gravity = [0, 0, -9.81]
mimic = "free"
friction_speed = 0.02
[[body]]
name = "rod"
inertial = { mass = 1.0, origin = { xyz = [0.5, 0, 0], rpy = [0.1, 0, 0] }, inertia = { ixx = 0.01, iyy = 0.08, izz = 0.08 } }
[[body]]
name = "ball"
inertial = { mass = 2.0, origin = { xyz = [0.1, 0, 0] }, inertia = { ixx = 0.1, iyy = 0.1, izz = 0.1, ixy = 0.01 } }
[[joint]]
name = "hinge"
type = "revolute"
parent = "world"
child = "rod"
axis = [0, 1, 0]
limit = { lower = -1.5, upper = 1.5, effort = 10, velocity = 3 }
dynamics = { damping = 0.1, friction = 0.2 }
[[joint]]
name = "socket"
type = "spherical"
parent = "rod"
child = "ball"
origin = { xyz = [1, 0, 0] }
[initial]
q.hinge = 0.3
q.socket = [0, 0, 0.6, 0.8]
v.socket = [0.1, 0.2, 0.3]
[[force]]
kind = "torque"
joint = "socket"
component = 1
value = "0.1*sin(2*pi*t) + exp(-t)"
[[force]]
kind = "servo"
joint = "hinge"
target = [[0, 0], [0.5, 0.2]]
stiffness = 2
damping = 0.1
integral = 0.3
limit = 5
[[force]]
kind = "spring"
body_a = "world"
point_a = [0, 0, 1]
body_b = "ball"
stiffness = 3
rest_length = 0.5
[[force]]
kind = "wrench"
body = "ball"
axes = "world"
moment = [0, "t", 0]
[integrator]
method = "auto"
t_end = 0.1
rtol = 1e-6
atol = 1e-8
max_step = 0.1
estimate = true
[record]
every = 0.01
[outputs]
angle = { joint = "hinge" }
sum = { joints = ["hinge", "hinge"], factors = [1, -2], of = "v" }
height = { body = "ball", point = [0, 0, 1], axis = "z", of = "velocity" }
far = { body_a = "world", body_b = "ball", point_b = [0, 0, 1] }
energy = { energy = "total" }
[reference]
source = "none"
angle = 0.3
"#;

/// Pieces that programs and people put where they do not belong.
const PIECES: [&str; 24] = [
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e-320",
    "-1",
    "0",
    "\"\"",
    "[]",
    "{}",
    "[[",
    "]]",
    "'''",
    "\"\"\"",
    "\u{0}",
    "ü",
    "world",
    "99999999999999999999",
    "1979-05-27T07:32:00Z",
    "true",
    "q.hinge = 1\n",
    ".",
    "=",
];

/// Rows are dropped; the run is stopped after some steps, because a mutated scene may run for ever.
#[derive(Default)]
struct Short {
    recording: Recording,
    steps: usize,
}

impl Observer for Short {
    fn row(&mut self, row: &Row) -> Result<(), SimulateError> {
        if self.recording.rows.len() < 1000 { self.recording.row(row) } else { Ok(()) }
    }
    fn step(
        &mut self,
        step: &StepRecord,
        progress: &phipsi_simulate::Progress<'_>,
    ) -> Result<(), SimulateError> {
        self.steps += 1;
        self.recording.step(step, progress)
    }
    fn stop(&self) -> bool {
        self.steps >= 50
    }
    fn step_ends(&mut self) -> Result<Vec<f64>, SimulateError> {
        self.recording.step_ends()
    }
    fn spread_rows(&mut self, most: usize) -> Result<Vec<State>, SimulateError> {
        self.recording.spread_rows(most)
    }
}

fn mutate(text: &str, random: &mut Random) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..1 + random.below(4) {
        let at = random.below(bytes.len().max(1));
        match random.below(6) {
            0 => bytes[at] = random.bits() as u8,
            1 => {
                let end = (at + 1 + random.below(20)).min(bytes.len());
                bytes.drain(at..end);
            }
            2 => {
                let piece = PIECES[random.below(PIECES.len())];
                bytes.splice(at..at, piece.bytes());
            }
            // A value is replaced: from behind a `=` to the end of its line.
            3 => {
                let equals = bytes[at..].iter().position(|b| *b == b'=').map(|i| at + i + 1);
                if let Some(from) = equals {
                    let to = bytes[from..].iter().position(|b| *b == b'\n').map_or(bytes.len(), |i| from + i);
                    let piece = PIECES[random.below(PIECES.len())];
                    bytes.splice(from..to, piece.bytes());
                }
            }
            // A line moves.
            4 => {
                let mut lines: Vec<Vec<u8>> = bytes.split(|b| *b == b'\n').map(<[u8]>::to_vec).collect();
                let line = lines.remove(random.below(lines.len()));
                lines.insert(random.below(lines.len() + 1), line);
                bytes = lines.join(&b'\n');
            }
            _ => bytes.truncate(at),
        }
        if bytes.is_empty() {
            bytes.push(b' ');
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[test]
fn mutated_scenes_are_read_or_refused_in_time() {
    let seconds = std::env::var("PHIPSI_FUZZ_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(4.0);
    let only: Option<u64> = std::env::var("PHIPSI_SEED").ok().and_then(|s| s.parse().ok());
    let end = Instant::now() + Duration::from_secs_f64(seconds);
    let (mut cases, mut accepted, mut slowest) = (0u64, 0u64, (Duration::ZERO, 0));
    for seed in only.map_or(1..u64::MAX, |s| s..s + 1) {
        if Instant::now() >= end {
            break;
        }
        let text = mutate(SEED, &mut Random::new(seed));
        let begun = Instant::now();
        let outcome = std::panic::catch_unwind(|| {
            let Ok(mut scene) = parse(text.clone(), "mutated", "mutated.toml", Path::new("."), &[]) else {
                return false;
            };
            let found = run(&mut scene.simulation, &mut Short::default());
            if let Ok(summary) = found {
                assert!(summary.q.iter().chain(&summary.v).all(|x| x.is_finite()), "a NaN got through");
            }
            true
        });
        match outcome {
            Ok(ran) => accepted += u64::from(ran),
            Err(_) => panic!("PHIPSI_SEED={seed} reproduces it:\n{text}"),
        }
        slowest = slowest.max((begun.elapsed(), seed));
        cases += 1;
    }
    assert!(only.is_some() || (cases > 100 && accepted > 10), "{cases} cases, {accepted} accepted");
    println!("{cases} scenes, {accepted} of them run; slowest: {:?}, PHIPSI_SEED={}", slowest.0, slowest.1);
}
