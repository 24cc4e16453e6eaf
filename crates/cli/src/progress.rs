//! A progress bar on standard error, once a run takes more than a second.

use crate::interrupt;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use phipsi::simulate::folder::Watcher;
use std::time::{Duration, Instant};

/// Wall time before the bar appears.
const PATIENCE: Duration = Duration::from_secs(1);

/// Resolution of the bar.
const LENGTH: u64 = 10_000;

/// Shows a run to people.
pub struct Progress {
    quiet: bool,
    begun: Instant,
    looked: Instant,
    bar: Option<ProgressBar>,
    first: Option<f64>,
}

impl Progress {
    /// Silent if `quiet`.
    pub fn new(quiet: bool) -> Self {
        let now = Instant::now();
        Progress { quiet, begun: now, looked: now, bar: None, first: None }
    }
    /// Takes the bar away.
    pub fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
    fn bar(&mut self) -> &ProgressBar {
        self.bar.get_or_insert_with(|| {
            let bar = ProgressBar::with_draw_target(Some(LENGTH), ProgressDrawTarget::stderr_with_hz(8));
            let style =
                ProgressStyle::with_template("{msg} [{bar:30}] {percent:>3} %  {elapsed} (about {eta} left)");
            if let Ok(style) = style {
                bar.set_style(style.progress_chars("=> "));
            }
            bar
        })
    }
}

impl Watcher for Progress {
    fn step(&mut self, t: f64, t_end: f64) {
        let first = *self.first.get_or_insert(t);
        if self.quiet || self.looked.elapsed() < Duration::from_millis(50) {
            return;
        }
        self.looked = Instant::now();
        if self.begun.elapsed() < PATIENCE {
            return;
        }
        let done = ((t - first) / (t_end - first)).clamp(0.0, 1.0);
        let bar = self.bar();
        bar.set_message(format!("t = {t:.4} of {t_end} s"));
        bar.set_position((done * LENGTH as f64) as u64);
    }
    fn estimating(&mut self) {
        if self.quiet {
            return;
        }
        if let Some(bar) = &self.bar {
            bar.set_position(LENGTH);
            bar.set_message("estimating the error");
            bar.tick();
        }
    }
    fn message(&mut self, text: &str) {
        if !self.quiet {
            anstream::eprintln!("{text}");
        }
    }
    fn stop(&self) -> bool {
        interrupt::asked()
    }
}
