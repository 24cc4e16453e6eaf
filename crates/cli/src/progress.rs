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
    is_molecule: bool,
    begun: Instant,
    looked: Instant,
    bar: Option<ProgressBar>,
    first: Option<f64>,
}

impl Progress {
    /// Silent if `quiet`; of a molecule times are in ps, and ns a day are shown.
    pub fn new(quiet: bool, is_molecule: bool) -> Self {
        let now = Instant::now();
        Progress { quiet, is_molecule, begun: now, looked: now, bar: None, first: None }
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
        let rate = self.is_molecule.then(|| (t - first) / self.begun.elapsed().as_secs_f64());
        let bar = self.bar();
        bar.set_message(message(t, t_end, rate));
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

/// The line of the bar; `rate`: of a molecule, in ps a second.
fn message(t: f64, t_end: f64, rate: Option<f64>) -> String {
    match rate {
        Some(rate) => format!("t = {t:.4} of {t_end} ps, {:.3} ns a day", 86.4 * rate),
        None => format!("t = {t:.4} of {t_end} s"),
    }
}

#[cfg(test)]
mod tests {
    use super::message;

    #[test]
    fn a_picosecond_a_second_is_86_nanoseconds_a_day() {
        assert_eq!(message(1.0, 20.0, Some(1.0)), "t = 1.0000 of 20 ps, 86.400 ns a day");
        assert_eq!(message(0.5, 2.0, None), "t = 0.5000 of 2 s");
    }
}
