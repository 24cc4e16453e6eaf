//! Error against run time: methods × tolerances or steps on a scene, against a reference that is made for it.
//!
//! | part | what |
//! |---|---|
//! | [`mod@reference`] | the trajectory at some instants by two unrelated methods, and how well they agree |
//! | [`study`] | runs of every method at tighter and tighter tolerances (smaller steps), judged by the reference |
//! | [`beyond`] | distributions after the time to which the trajectory is known |
//! | [`advice`] | observed orders, and the cheapest run for each error |
//! | [`files`] | page, CSV and JSON in a folder |
//!
//! The error of a run is the largest component of `difference(q, reference)` (and of v) over the instants up to the horizon:
//! the time to which the references agree. A chaotic scene has one; beyond it conserved quantities are judged, and distributions
//! are set side by side.

pub mod advice;
pub mod beyond;
pub mod files;
pub mod reference;
pub mod study;

use crate::error::SimulateError;
use crate::scene::Scene;
use advice::{Advice, MethodOrder};
use phipsi_motion::Action;
use reference::Reference;
use std::path::{Path, PathBuf};
use std::time::Instant;
use study::{Trial, study};

/// Wall time that a report may take where nothing else is said, s.
pub const BUDGET_S: f64 = 60.0;

/// What one looks at while a report is made.
pub trait ReportWatcher {
    /// What is being done, and the part of the budget that is used up.
    fn at(&mut self, _what: &str, _part: f64) {}
    /// True ends the report with what is known.
    fn stop(&self) -> bool {
        false
    }
}

impl ReportWatcher for () {}

/// What a report has found.
#[derive(Clone, Debug)]
pub struct Report {
    /// Name of the scene's file.
    pub scene: String,
    /// Title of the scene.
    pub title: String,
    /// "s", or "ps" for a molecule.
    pub time_unit: String,
    /// End of the runs.
    pub t_end: f64,
    /// True for a free base: momentum is a conserved quantity.
    pub momentum: bool,
    /// The reference.
    pub reference: Reference,
    /// All runs, in the order they were made.
    pub trials: Vec<Trial>,
    /// Theoretical and observed orders.
    pub orders: Vec<MethodOrder>,
    /// The cheapest run for each error.
    pub advice: Vec<Advice>,
    /// What was left out, and why.
    pub left_out: Vec<String>,
    /// What is probably wrong.
    pub warnings: Vec<String>,
    /// The scene as it is given to `phipsi run`.
    pub path: String,
    /// Overrides of the command line.
    pub overrides: Vec<String>,
    /// Keys of `[integrator]` in the scene that another method does not have.
    pub present: Vec<String>,
    /// False if it was stopped.
    pub finished: bool,
}

/// Time that is left.
pub(crate) struct Budget {
    begun: Instant,
    seconds: f64,
}

impl Budget {
    pub(crate) fn new(seconds: f64) -> Self {
        Budget { begun: Instant::now(), seconds }
    }
    /// Used part.
    pub(crate) fn part(&self) -> f64 {
        (self.begun.elapsed().as_secs_f64() / self.seconds).min(1.0)
    }
    /// Seconds left.
    pub(crate) fn left(&self) -> f64 {
        (self.seconds - self.begun.elapsed().as_secs_f64()).max(0.0)
    }
}

/// Makes a report into a folder: `out`, or the next free `reports/SCENE-001`, …. After every run the files are those of all
/// runs so far.
///
/// # Errors
/// [`SimulateError`] if the scene has no reference, or nothing can be written.
pub fn report(
    path: &Path,
    scene: &mut Scene,
    out: Option<&Path>,
    budget_s: f64,
    watcher: &mut dyn ReportWatcher,
) -> Result<(Report, PathBuf), SimulateError> {
    let stem = path.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned());
    if scene.simulation.molecule.as_ref().is_some_and(|m| m.schedule.is_some()) {
        let message = "a report compares methods on one model, and [[molecule.recluster]] changes it during the run; remove it";
        return Err(SimulateError::Start(message.into()));
    }
    let folder = match out {
        Some(out) => {
            crate::folder::claim(out)?;
            out.to_path_buf()
        }
        None => crate::folder::next_free(Path::new("reports"), &stem)?,
    };
    let budget = Budget::new(budget_s);
    let stops = scene.simulation.dynamics.user_events().iter().any(|e| matches!(e.action, Action::Stop));
    scene.simulation.dynamics.pass_over_stops(true);
    let reference =
        Reference::new(&mut scene.simulation, 0.5 * budget_s, &budget, watcher).inspect_err(|_| {
            // A folder without a report would only take the name; it is empty, or stays.
            let _ = std::fs::remove_dir(&folder);
        })?;
    let simulation = &scene.simulation;
    let mut report = Report {
        scene: stem,
        title: simulation.name.clone(),
        time_unit: simulation.time_unit().into(),
        t_end: simulation.t_end,
        momentum: simulation.dynamics.plan().momentum,
        warnings: reference.warnings(simulation),
        reference,
        trials: Vec::new(),
        orders: Vec::new(),
        advice: Vec::new(),
        left_out: match stops {
            true => vec!["events that stop a run: all runs go on to t_end".into()],
            false => Vec::new(),
        },
        path: path.display().to_string(),
        overrides: scene.overrides.clone(),
        present: scene.integrator_keys.clone(),
        finished: false,
    };
    files::write(&report, &folder)?;
    let stopped = study(&mut scene.simulation, &mut report, &budget, watcher, &mut |report| {
        files::write(report, &folder)
    })?;
    report.finished = !stopped;
    files::write(&report, &folder)?;
    Ok((report, folder))
}
