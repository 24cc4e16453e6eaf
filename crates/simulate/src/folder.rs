//! Run folders: everything about a run in one place, safe against being killed at any moment.
//!
//! | file | what |
//! |---|---|
//! | `run.json` | status, inputs with hashes, versions, plan, results; replaced as a whole |
//! | `trajectory.csv` | recorded instants, readable while the run goes on |
//! | `trajectory.dcd` | positions of a molecule's atoms |
//! | `trajectory.npz` | the same for NumPy, when the run has ended |
//! | `index.html` | the run to look at, when it has ended |
//! | `inputs/` | copies of the scene and the files it names |
//! | `checkpoint/` | what continues the run bit for bit |
//! | `lock` | held by the process that runs in the folder |

pub mod atoms;
pub mod checkpoint;
pub mod inputs;
pub mod npz;
pub mod results;
pub mod steps;
pub mod summary;
pub mod table;

use crate::error::SimulateError;
use crate::level::instruction_level;
use crate::record::{Observer, Row, StepRecord, spread};
use crate::run::{Progress, RunState, Summary, resume, run};
use crate::scene::{self, Scene};
use crate::simulation::Simulation;
use atoms::AtomWriter;
use checkpoint::{Checkpoint, replace};
use inputs::Input;
use phipsi_model::State;
use results::{RunFile, Status};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use steps::{StepWriter, read_steps};
use table::{Columns, TableWriter, read_rows};

/// Wall time between checkpoints where a scene does not say, s.
pub const CHECKPOINT_S: f64 = 2.0;

/// What one looks at while a run goes on.
pub trait Watcher {
    /// After a step: time now, at the end, accepted steps.
    fn step(&mut self, _t: f64, _t_end: f64) {}
    /// The estimate of the error begins.
    fn estimating(&mut self) {}
    /// Something to tell the user.
    fn message(&mut self, _text: &str) {}
    /// True stops the run after the present step.
    fn stop(&self) -> bool {
        false
    }
}

/// A folder that this process runs in.
pub struct RunFolder {
    path: PathBuf,
    file: RunFile,
    scene: Scene,
    /// Held until the folder is dropped.
    _lock: File,
}

/// What a run in a folder came to.
#[derive(Debug)]
pub struct Outcome {
    /// Results; those of before if the run had already ended.
    pub file: RunFile,
    /// The folder.
    pub path: PathBuf,
    /// True if the run has ended, false if it can be resumed.
    pub finished: bool,
    /// True if there was nothing left to run.
    pub already: bool,
}

impl RunFolder {
    /// True if a molecule runs in it: times are in ps.
    pub fn has_molecule(&self) -> bool {
        self.scene.simulation.molecule.is_some()
    }
    /// A new folder: `out`, or the next free `runs/SCENE-001`, `runs/SCENE-002` ….
    ///
    /// # Errors
    /// [`SimulateError::Folder`] if `out` exists and is not empty, [`SimulateError::File`] if nothing can be written.
    pub fn create(scene_path: &Path, scene: Scene, out: Option<&Path>) -> Result<Self, SimulateError> {
        let stem = scene_path.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned());
        let path = match out {
            Some(out) => {
                claim(out)?;
                out.to_path_buf()
            }
            None => next_free(Path::new("runs"), &stem)?,
        };
        let lock = lock(&path)?;
        let checkpoints = path.join("checkpoint");
        std::fs::create_dir_all(&checkpoints).map_err(|e| SimulateError::file(&checkpoints, e))?;
        let inputs = inputs::copy(&path, scene_path, &scene)?;
        let file = RunFile::begin(&scene, inputs, scene_path);
        let folder = RunFolder { path, file, scene, _lock: lock };
        folder.write_file()?;
        Ok(folder)
    }
    /// A folder of before. `scene_path`: must be the scene that the folder was made from.
    ///
    /// # Errors
    /// [`SimulateError::Folder`] if it is no run folder, another process runs in it, or the scene is another one.
    pub fn open(path: &Path, scene_path: Option<&Path>) -> Result<Self, SimulateError> {
        let description = path.join("run.json");
        let text = match std::fs::read(&description) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                let message = "no `run.json` in it: not a run folder; give the folder that a run printed";
                return Err(SimulateError::folder(path, message));
            }
            Err(e) => return Err(SimulateError::file(&description, e)),
        };
        let lock = lock(path)?;
        let file: RunFile = serde_json::from_slice(&text)
            .map_err(|e| SimulateError::folder(&description, format!("cannot be understood: {e}")))?;
        let Some(first) = file.inputs.first() else {
            return Err(SimulateError::folder(&description, "names no scene; start a new run"));
        };
        if let Some(scene_path) = scene_path {
            let bytes = std::fs::read(scene_path).map_err(|e| SimulateError::file(scene_path, e))?;
            if inputs::hash(&bytes) != first.blake3 {
                let message = format!(
                    "was made from another scene than {} (the hashes differ); leave the scene out to continue \
                     the run as it began, or start a new one",
                    scene_path.display()
                );
                return Err(SimulateError::folder(path, message));
            }
        }
        let scene = reload(path, &file)?;
        Ok(RunFolder { path: path.into(), file, scene, _lock: lock })
    }
    /// Sets the largest number of threads; results do not depend on it.
    pub fn set_threads(&mut self, threads: usize) {
        self.scene.simulation.threads = Some(threads);
    }
    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }
    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    fn write_file(&self) -> Result<(), SimulateError> {
        let path = self.path.join("run.json");
        let mut text =
            serde_json::to_vec_pretty(&self.file).map_err(|e| SimulateError::file(&path, e.into()))?;
        text.push(b'\n');
        replace(&path, &text)
    }

    /// Runs to the end, from the last checkpoint where there is one.
    ///
    /// # Errors
    /// [`SimulateError`]; what was recorded up to then is in the folder, which says why it ended.
    pub fn run(mut self, watcher: &mut dyn Watcher) -> Result<Outcome, SimulateError> {
        if self.file.status == Status::Finished {
            return Ok(Outcome { file: self.file, path: self.path, finished: true, already: true });
        }
        let checkpoint = self.checkpoint(watcher)?;
        let every = self.file.checkpoint_s;
        let mut recorder =
            Recorder::open(&self.path, &self.scene.simulation, checkpoint.as_ref(), every, watcher)?;
        let simulation = &mut self.scene.simulation;
        let result = match checkpoint {
            Some(c) => resume(simulation, c.state, &mut recorder),
            None => run(simulation, &mut recorder),
        };
        match result {
            Ok(summary) => {
                recorder.sync()?;
                if summary.finished {
                    recorder.table.finish()?;
                }
                let finished = summary.finished;
                self.end(&summary)?;
                Ok(Outcome { file: self.file, path: self.path, finished, already: false })
            }
            Err(e) => {
                // The first error is the one to tell; writing what there is may fail too.
                let _ = recorder.sync();
                self.file.status = Status::Failed;
                self.file.error = Some(e.to_string());
                let _ = self.write_file();
                Err(e)
            }
        }
    }

    fn checkpoint(&self, watcher: &mut dyn Watcher) -> Result<Option<Checkpoint>, SimulateError> {
        let path = self.path.join("checkpoint/state.json");
        let Some(checkpoint) = Checkpoint::read(&path)? else { return Ok(None) };
        let level = instruction_level();
        if checkpoint.level != level {
            watcher.message(&format!(
                "note: the run began on `{}` and goes on on `{level}`: from here on it may differ in the last digits \
                 from one that was not interrupted",
                checkpoint.level
            ));
        }
        let version = env!("CARGO_PKG_VERSION");
        if checkpoint.version != version {
            watcher.message(&format!(
                "note: the run began with phipsi {} and goes on with {version}: it may differ in the last digits from \
                 one that was not interrupted",
                checkpoint.version
            ));
        }
        Ok(Some(checkpoint))
    }

    /// Writes what is made from a run's rows and steps.
    fn end(&mut self, summary: &Summary) -> Result<(), SimulateError> {
        let columns = Columns::new(&self.scene.simulation);
        let rows = read_rows(&self.path.join("trajectory.csv"), &columns, u64::MAX)?;
        let steps = read_steps(&self.path.join("checkpoint/steps.bin"), summary.steps)?;
        self.file.complete(&self.scene.simulation, summary, &rows);
        if summary.finished {
            npz::write(&self.path.join("trajectory.npz"), &columns, &rows)?;
        }
        let page = crate::run_page::page(&self.scene, &self.file, &columns, &rows, &steps);
        replace(&self.path.join("index.html"), page.as_bytes())?;
        self.write_file()
    }
}

/// Rows and steps of a run into its folder.
struct Recorder<'a> {
    folder: PathBuf,
    table: TableWriter,
    steps: StepWriter,
    columns: Columns,
    every: Duration,
    written: Instant,
    rows: u64,
    step_count: u64,
    atoms: Option<AtomWriter>,
    watcher: &'a mut dyn Watcher,
}

impl<'a> Recorder<'a> {
    fn open(
        folder: &Path,
        simulation: &Simulation,
        checkpoint: Option<&Checkpoint>,
        every: f64,
        watcher: &'a mut dyn Watcher,
    ) -> Result<Self, SimulateError> {
        let columns = Columns::new(simulation);
        let csv = folder.join("trajectory.csv");
        let table = match checkpoint {
            Some(c) => {
                let mut table = TableWriter::open(&csv, columns.clone(), c.table_bytes)?;
                // Rows of another level or version are not written over byte by byte: they may be longer.
                if !c.is_of_this_program() {
                    table.finish()?;
                }
                table
            }
            None => TableWriter::create(&csv, columns.clone())?,
        };
        let step_count = checkpoint.map_or(0, |c| c.state.steps);
        let steps = StepWriter::open(&folder.join("checkpoint/steps.bin"), step_count)?;
        let every = Duration::try_from_secs_f64(every).unwrap_or(Duration::MAX);
        let rows = checkpoint.map_or(0, |c| c.state.rows);
        let before = match simulation.molecule {
            Some(_) if rows > 0 => read_rows(&csv, &columns, rows)?,
            _ => Vec::new(),
        };
        let atoms = AtomWriter::open(&folder.join("trajectory.dcd"), simulation, &before)?;
        Ok(Recorder {
            folder: folder.into(),
            table,
            steps,
            columns,
            every,
            written: Instant::now(),
            rows,
            step_count,
            atoms,
            watcher,
        })
    }
    fn write(&mut self, state: RunState) -> Result<(), SimulateError> {
        // The files first: a checkpoint never points behind their ends.
        let table_bytes = self.table.sync()?;
        self.steps.sync()?;
        Checkpoint::new(state, table_bytes).write(&self.folder.join("checkpoint/state.json"))?;
        self.written = Instant::now();
        Ok(())
    }
    fn sync(&mut self) -> Result<(), SimulateError> {
        self.table.sync()?;
        self.steps.sync()
    }
}

impl Observer for Recorder<'_> {
    fn row(&mut self, row: &Row) -> Result<(), SimulateError> {
        self.rows += 1;
        if let Some(atoms) = &mut self.atoms {
            atoms.row(row)?;
        }
        self.table.row(row)
    }
    fn step(&mut self, step: &StepRecord, progress: &Progress<'_>) -> Result<(), SimulateError> {
        self.step_count += 1;
        self.steps.step(step)?;
        self.watcher.step(progress.t, progress.t_end);
        let due = self.written.elapsed() >= self.every;
        if due || progress.t >= progress.t_end { self.write(progress.state()) } else { Ok(()) }
    }
    fn stopped(&mut self, progress: &Progress<'_>) -> Result<(), SimulateError> {
        self.write(progress.state())
    }
    fn stop(&self) -> bool {
        self.watcher.stop()
    }
    fn estimating(&mut self) {
        self.watcher.estimating();
    }
    fn step_ends(&mut self) -> Result<Vec<f64>, SimulateError> {
        self.steps.sync()?;
        let path = self.folder.join("checkpoint/steps.bin");
        Ok(read_steps(&path, self.step_count)?.iter().map(|s| s.t).collect())
    }
    fn spread_rows(&mut self, most: usize) -> Result<Vec<State>, SimulateError> {
        self.table.sync()?;
        let rows = read_rows(&self.folder.join("trajectory.csv"), &self.columns, self.rows)?;
        Ok(spread(rows.len(), most).map(|i| rows[i].state()).collect())
    }
}

/// Takes a folder that is empty or does not exist.
pub(crate) fn claim(path: &Path) -> Result<(), SimulateError> {
    let failed = |e| SimulateError::file(path, e);
    std::fs::create_dir_all(path).map_err(failed)?;
    if std::fs::read_dir(path).map_err(failed)?.next().is_some() {
        let message = "exists and is not empty; an existing folder is never overwritten: give another one, or --resume it";
        return Err(SimulateError::folder(path, message));
    }
    Ok(())
}

/// Makes the first of `parent/stem-001`, `parent/stem-002` … that does not exist.
pub(crate) fn next_free(parent: &Path, stem: &str) -> Result<PathBuf, SimulateError> {
    std::fs::create_dir_all(parent).map_err(|e| SimulateError::file(parent, e))?;
    for n in 1..100_000 {
        let path = parent.join(format!("{stem}-{n:03}"));
        match std::fs::create_dir(&path) {
            Ok(()) => return Ok(path),
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(SimulateError::file(&path, e)),
        }
    }
    Err(SimulateError::folder(parent, "holds 99999 runs of this scene; give --out"))
}

/// Locks a folder; the system lets go of it when the process ends in whatever way.
fn lock(path: &Path) -> Result<File, SimulateError> {
    let file = path.join("lock");
    let lock = File::create(&file).map_err(|e| SimulateError::file(&file, e))?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(TryLockError::WouldBlock) => {
            Err(SimulateError::folder(path, "another phipsi process runs in it; wait for it, or end it"))
        }
        Err(TryLockError::Error(e)) => Err(SimulateError::file(&file, e)),
    }
}

/// The scene of a folder, from its own copies.
fn reload(path: &Path, file: &RunFile) -> Result<Scene, SimulateError> {
    let scene: &Input = &file.inputs[0];
    let bytes = inputs::read_back(path, scene)?;
    let text = String::from_utf8(bytes).map_err(|_| SimulateError::folder(path, "its scene is not UTF-8"))?;
    let mut overrides = file.overrides.clone();
    for input in &file.inputs[1..] {
        inputs::read_back(path, input)?;
        let name = input.copy.trim_start_matches("inputs/");
        // JSON's quotation is TOML's for text without control characters other than these.
        overrides.push(format!("{}={}", input.key, serde_json::Value::from(name)));
    }
    let folder = path.join("inputs");
    let mut loaded = scene::parse(text, &file.scene, &scene.file, &folder, &overrides)?;
    loaded.overrides.truncate(file.overrides.len());
    Ok(loaded)
}
