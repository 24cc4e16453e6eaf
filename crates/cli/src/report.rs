//! `phipsi report`: error against run time.

use crate::interrupt;
use crate::show::{fail, print_json, table};
use crate::{Common, Ending};
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use phipsi::simulate::SimulateError;
use phipsi::simulate::report::{BUDGET_S, ReportWatcher, report};
use phipsi::simulate::scene;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What to report on.
#[derive(Args)]
pub struct Options {
    /// The scene
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Folder to make; otherwise the next free reports/SCENE-001, -002, …
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace a value of the scene, for example integrator.t_end=5; an empty value removes the key
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Wall time that the report may take, s
    #[arg(long, value_name = "SECONDS", default_value_t = BUDGET_S, value_parser = seconds)]
    budget: f64,
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("a number of seconds above 0 is required".into()),
    }
}

/// Makes a report.
pub fn make(options: &Options, common: &Common) -> Ending {
    interrupt::listen();
    let mut scene = match scene::load(&options.scene, &options.set) {
        Ok(scene) => scene,
        Err(e) => return fail(&e.to_string(), common),
    };
    if common.strict && scene.reports.iter().any(|r| !r.warnings.is_empty()) {
        return fail(&SimulateError::Scene(scene.reports).to_string(), common);
    }
    if !common.quiet {
        for p in scene.reports.iter().flat_map(|r| &r.warnings) {
            anstream::eprintln!("warning: {}: {}; {}", p.place, p.found, p.remedy);
        }
    }
    let mut shown = Shown { quiet: common.quiet, begun: Instant::now(), bar: None };
    let made = report(&options.scene, &mut scene, options.out.as_deref(), options.budget, &mut shown);
    if let Some(bar) = shown.bar.take() {
        bar.finish_and_clear();
    }
    let (report, folder) = match made {
        Ok(made) => made,
        Err(e) => return fail(&e.to_string(), common),
    };
    if common.json {
        print_json(&report.to_json(&folder));
    } else {
        let mut rows: Vec<(&str, Vec<String>)> = Vec::new();
        let summary = report.summary();
        rows.extend(summary.iter().map(|(name, lines)| (name.as_str(), lines.clone())));
        for (name, lines) in [("warnings", &report.warnings), ("left out", &report.left_out)] {
            if !lines.is_empty() {
                rows.push((name, lines.clone()));
            }
        }
        rows.push(("report", vec![folder.join("index.html").display().to_string()]));
        anstream::print!("{}", table(&rows));
    }
    if report.finished {
        Ending::Fine
    } else {
        anstream::eprintln!("interrupted; the runs so far are in {}", folder.display());
        Ending::Interrupted
    }
}

/// A progress bar, once a report takes more than a second.
struct Shown {
    quiet: bool,
    begun: Instant,
    bar: Option<ProgressBar>,
}

impl ReportWatcher for Shown {
    fn at(&mut self, what: &str, part: f64) {
        if self.quiet || self.begun.elapsed() < Duration::from_secs(1) {
            return;
        }
        let bar = self.bar.get_or_insert_with(|| {
            let bar = ProgressBar::with_draw_target(Some(1000), ProgressDrawTarget::stderr_with_hz(8));
            let style =
                ProgressStyle::with_template("[{bar:30}] {percent:>3} % of the budget  {elapsed}  {msg}");
            if let Ok(style) = style {
                bar.set_style(style.progress_chars("=> "));
            }
            bar
        });
        if bar.message() != what {
            bar.set_message(what.to_string());
        }
        bar.set_position((1000.0 * part) as u64);
    }
    fn stop(&self) -> bool {
        interrupt::asked()
    }
}
