//! Stiff and extreme scenes, each judged by a truth that is not f64: what `phipsi stress` runs.
//!
//! | part | what |
//! |---|---|
//! | `chain` | serial chains by their masses, lengths and axes |
//! | `ratios`, `places`, `bodies` | scenes of single calls of forward dynamics: unequal masses and lengths; long, far, small, fast; nearly massless, needle-like, singular |
//! | `loops` | closures near singular positions, redundant, contradictory, far and unequal |
//! | `motions` | runs: stiff springs and dampers, fast spins, separatrices, long spans |
//! | `tree`, `sensitivity` | errors of a call, and what rounding of its inputs explains |
//! | `page` | the table for people, for programs and for the documentation |
//!
//! | number | what it is |
//! |---|---|
//! | forward error | largest error over largest component, against the same kernels in double-double numbers or a closed form, in units of εκ |
//! | κ | largest answer to relative changes of masses, lengths, gravity, q, v and forces, over the largest component; of loops at least 1/σ |
//! | backward error | \|τ − inverse dynamics(result)\| over the sum of \|terms\|, largest component, in units of ε |
//! | drift | of a run: the larger of its energy and momentum errors |
//!
//! An outcome is *right* within the bar of its scene, *refused* with an error that says where and why, *warned* where the number is
//! off by more than the bar but the library's own estimate beside it says so, and *wrong* otherwise: also for numbers that are not
//! finite, panics, and scenes that do not end.

mod bodies;
mod chain;
mod loops;
mod motions;
mod page;
mod places;
mod ratios;
mod sensitivity;
mod tree;

pub use page::{json, page, table};

use std::fmt;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// A scene that takes longer has not ended.
const LIMIT: Duration = Duration::from_secs(300);

/// What a scene came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The numbers are within the bar.
    Right,
    /// The library refused, and said where and why.
    Refused,
    /// The numbers are not within the bar, and the library said by how much they may be off.
    Warned,
    /// None of these.
    Wrong,
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Outcome::Right => "right",
            Outcome::Refused => "refused",
            Outcome::Warned => "warned",
            Outcome::Wrong => "wrong",
        })
    }
}

/// What was measured; `None` where a scene has no such number.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// Largest error over largest component.
    pub error: Option<f64>,
    /// κ.
    pub kappa: Option<f64>,
    /// Backward error, in units of 1.
    pub backward: Option<f64>,
    /// Energy or momentum error of a run.
    pub drift: Option<f64>,
    /// Steps of a run.
    pub steps: Option<u64>,
    /// Of the call, or of the run.
    pub wall_s: f64,
    /// What it came to.
    pub outcome: Outcome,
    /// Form or method; why it was refused or warned; the bar that was missed.
    pub message: String,
}

impl Measured {
    /// A refusal.
    fn refused(message: impl fmt::Display) -> Self {
        Measured {
            error: None,
            kappa: None,
            backward: None,
            drift: None,
            steps: None,
            wall_s: 0.0,
            outcome: Outcome::Refused,
            message: message.to_string(),
        }
    }
    /// What must not be.
    fn wrong(message: impl fmt::Display) -> Self {
        Measured { outcome: Outcome::Wrong, ..Self::refused(message) }
    }
}

/// A scene and what it came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// The scene's name.
    pub name: String,
    /// Its family.
    pub family: &'static str,
    /// What is extreme in it.
    pub what: String,
    /// What was measured.
    pub measured: Measured,
}

impl Finding {
    /// Forward error in units of εκ.
    pub fn forward_error(&self) -> Option<f64> {
        let Measured { error, kappa, .. } = self.measured;
        Some(error? / (f64::EPSILON * kappa?))
    }
    /// Backward error in units of ε.
    pub fn backward_error(&self) -> Option<f64> {
        self.measured.backward.map(|x| x / f64::EPSILON)
    }
}

/// A scene: made and judged when it is run.
pub struct Scene {
    /// Its name.
    pub name: String,
    /// Its family.
    pub family: &'static str,
    /// What is extreme in it.
    pub what: String,
    /// True if it takes seconds.
    pub slow: bool,
    judge: Box<dyn FnOnce() -> Measured + Send>,
}

impl Scene {
    fn new(
        family: &'static str,
        name: impl Into<String>,
        what: impl Into<String>,
        judge: impl FnOnce() -> Measured + Send + 'static,
    ) -> Self {
        Scene { name: name.into(), family, what: what.into(), slow: false, judge: Box::new(judge) }
    }
    fn slow(mut self) -> Self {
        self.slow = true;
        self
    }
    /// Runs and judges it. A panic or a scene without end is *wrong*.
    pub fn run(self) -> Finding {
        let Scene { name, family, what, judge, .. } = self;
        let (send, receive) = channel();
        let started = Instant::now();
        // On a thread of its own: one that hangs must not hang the others.
        let thread = std::thread::Builder::new().name(name.clone()).spawn(move || {
            let _ = send.send(judge());
        });
        let mut measured = match thread {
            Err(e) => Measured::wrong(format!("no thread could be started: {e}")),
            Ok(_) => match receive.recv_timeout(LIMIT) {
                Ok(measured) => measured,
                Err(RecvTimeoutError::Timeout) => Measured::wrong(format!("no end after {LIMIT:?}")),
                Err(RecvTimeoutError::Disconnected) => Measured::wrong("panicked"),
            },
        };
        if measured.wall_s == 0.0 {
            measured.wall_s = started.elapsed().as_secs_f64();
        }
        Finding { name, family, what, measured }
    }
}

/// Every scene, by family.
pub fn scenes() -> Vec<Scene> {
    let mut all = ratios::scenes();
    all.extend(places::scenes());
    all.extend(bodies::scenes());
    all.extend(loops::scenes());
    all.extend(motions::scenes());
    all
}

/// Scenes of one name or family; all of them without.
///
/// # Errors
/// What there is, if there is no such name.
pub fn select(only: Option<&str>) -> Result<Vec<Scene>, String> {
    let Some(only) = only else { return Ok(scenes()) };
    let (mut found, mut names, mut families) = (Vec::new(), Vec::new(), Vec::new());
    for scene in scenes() {
        names.push(scene.name.clone());
        if !families.contains(&scene.family) {
            families.push(scene.family);
        }
        if scene.name == only || scene.family == only {
            found.push(scene);
        }
    }
    if found.is_empty() {
        return Err(format!(
            "there is no extreme scene or family `{only}`; families: {}; scenes: {}",
            families.join(", "),
            names.join(", ")
        ));
    }
    Ok(found)
}

/// Median of the wall times of a call, s: up to 9 calls, fewer if they are long.
fn timed<R>(mut call: impl FnMut() -> R) -> (R, f64) {
    let begun = Instant::now();
    let mut times = Vec::new();
    loop {
        let start = Instant::now();
        let result = call();
        times.push(start.elapsed().as_secs_f64());
        if times.len() == 9 || begun.elapsed() > Duration::from_millis(200) {
            times.sort_by(f64::total_cmp);
            return (result, times[times.len() / 2]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_wrong() {
        let finding = Scene::new("tests", "panics", "a scene that panics", || panic!("as it must")).run();
        assert_eq!(finding.measured.outcome, Outcome::Wrong);
        assert_eq!(finding.measured.message, "panicked");
    }
}
