//! `phipsi run`.

use crate::progress::Progress;
use crate::show::{fail, print_json, table};
use crate::{Common, Ending, interrupt};
use clap::Args;
use phipsi::simulate::SimulateError;
use phipsi::simulate::folder::summary::summary;
use phipsi::simulate::folder::{Outcome, RunFolder};
use phipsi::simulate::scene;
use std::path::{Path, PathBuf};

/// What to run.
#[derive(Args)]
pub struct Options {
    /// The scene; with --resume it may be left out
    #[arg(value_name = "SCENE.toml", required_unless_present = "resume")]
    scene: Option<PathBuf>,
    /// Run folder to make; otherwise the next free runs/SCENE-001, -002, …
    #[arg(long, value_name = "DIR", conflicts_with = "resume")]
    out: Option<PathBuf>,
    /// Replace a value of the scene, for example integrator.rtol=1e-9
    #[arg(long, value_name = "KEY=VALUE", conflicts_with = "resume")]
    set: Vec<String>,
    /// Continue the run in this folder from its last checkpoint
    #[arg(long, value_name = "DIR")]
    resume: Option<PathBuf>,
}

/// Runs a scene.
pub fn run(options: &Options, common: &Common) -> Ending {
    interrupt::listen();
    let mut folder = match prepare(options, common) {
        Ok(folder) => folder,
        Err(e) => return fail(&e.to_string(), common),
    };
    if let Some(threads) = common.threads {
        folder.set_threads(threads.into());
    }
    let path = folder.path().to_path_buf();
    let mut progress = Progress::new(common.quiet, folder.has_molecule());
    let outcome = folder.run(&mut progress);
    progress.finish();
    match outcome {
        Ok(outcome) => tell(&outcome, common),
        Err(e) => {
            let kept = format!("{e}\nwhat was recorded up to then is in {}", path.display());
            fail(&kept, common)
        }
    }
}

fn prepare(options: &Options, common: &Common) -> Result<RunFolder, SimulateError> {
    if let Some(resume) = &options.resume {
        return RunFolder::open(resume, options.scene.as_deref());
    }
    let path = options.scene.as_deref().unwrap_or(Path::new(""));
    let scene = scene::load(path, &options.set)?;
    if common.strict && scene.reports.iter().any(|r| !r.warnings.is_empty()) {
        return Err(SimulateError::Scene(scene.reports));
    }
    // Before the first step: what is probably wrong with the start changes what the user wants.
    if !common.quiet {
        for report in &scene.reports {
            for p in &report.warnings {
                anstream::eprintln!("warning: {}: {}; {}", p.place, p.found, p.remedy);
            }
        }
    }
    RunFolder::create(path, scene, options.out.as_deref())
}

fn tell(outcome: &Outcome, common: &Common) -> Ending {
    let Outcome { file, path, finished, already } = outcome;
    if common.json {
        print_json(&file.to_json(path));
    } else if file.results.is_some() {
        if *already {
            anstream::println!("this run has already ended; its results:");
        }
        let mut rows = summary(file);
        rows.push(("run folder", vec![path.display().to_string()]));
        anstream::print!("{}", table(&rows));
    }
    if *finished {
        return Ending::Fine;
    }
    let folder = path.display().to_string();
    let quoted = if folder.contains(char::is_whitespace) { format!("'{folder}'") } else { folder };
    anstream::eprintln!("interrupted; continue with: phipsi run --resume {quoted}");
    Ending::Interrupted
}
