//! `checkpoint/state.json`: everything that continues a run bit for bit, replaced as a whole.

use crate::error::SimulateError;
use crate::level::instruction_level;
use crate::record::LimitPassed;
use crate::run::RunState;
use phipsi_motion::{Conserved, IntegratorState, MidpointState, StepperState};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

/// The state of a run with the place that its files had reached.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Instruction level of the program that wrote it.
    pub level: String,
    /// Version of the program that wrote it.
    pub version: String,
    /// Bytes of `trajectory.csv`.
    pub table_bytes: u64,
    stepper: Stepper,
    conserved: Balances,
    rows: u64,
    steps: u64,
    limits: Vec<Limit>,
    wall_s: f64,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
enum Stepper {
    Explicit(Integrator),
    Midpoint(Midpoint),
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Midpoint {
    t: f64,
    q: Vec<f64>,
    p: Vec<f64>,
    forces: Vec<f64>,
    potential: f64,
    guess: Vec<f64>,
    steps: u64,
    iterations: u64,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Integrator {
    t: f64,
    q: Vec<f64>,
    v: Vec<f64>,
    aux: Vec<f64>,
    v_dot: Vec<f64>,
    aux_dot: Vec<f64>,
    h: f64,
    last_error: f64,
    largest: Vec<f64>,
    counts: [u64; 3],
    carried: bool,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Balances {
    start: Option<(f64, [f64; 6])>,
    energy: f64,
    energy_scale: f64,
    momentum: [f64; 2],
    momentum_scale: [f64; 2],
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct Limit {
    joint: String,
    position: f64,
    limit: f64,
    between: [f64; 2],
}

impl Checkpoint {
    /// Of a run's state.
    pub fn new(state: &RunState, table_bytes: u64) -> Self {
        let c = &state.conserved;
        Checkpoint {
            level: instruction_level(),
            version: env!("CARGO_PKG_VERSION").into(),
            table_bytes,
            stepper: Stepper::new(&state.stepper),
            conserved: Balances {
                start: c.start(),
                energy: c.energy,
                energy_scale: c.energy_scale,
                momentum: c.momentum,
                momentum_scale: c.momentum_scale,
            },
            rows: state.rows,
            steps: state.steps,
            limits: state
                .limits
                .iter()
                .map(|l| Limit {
                    joint: l.joint.clone(),
                    position: l.position,
                    limit: l.limit,
                    between: l.between,
                })
                .collect(),
            wall_s: state.wall_s,
        }
    }
    /// The state.
    pub fn into_state(self) -> RunState {
        let mut conserved = Conserved::default().with_start(self.conserved.start);
        conserved.energy = self.conserved.energy;
        conserved.energy_scale = self.conserved.energy_scale;
        conserved.momentum = self.conserved.momentum;
        conserved.momentum_scale = self.conserved.momentum_scale;
        RunState {
            stepper: self.stepper.into_state(),
            conserved,
            rows: self.rows,
            steps: self.steps,
            limits: self
                .limits
                .into_iter()
                .map(|l| LimitPassed {
                    joint: l.joint,
                    position: l.position,
                    limit: l.limit,
                    between: l.between,
                })
                .collect(),
            wall_s: self.wall_s,
        }
    }
    /// Replaces the file as a whole.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn write(&self, path: &Path) -> Result<(), SimulateError> {
        let text = serde_json::to_vec(self).map_err(|e| SimulateError::file(path, e.into()))?;
        replace(path, &text)
    }
    /// Reads one; `None` where there is no file.
    ///
    /// # Errors
    /// [`SimulateError::File`] if it cannot be read or understood.
    pub fn read(path: &Path) -> Result<Option<Self>, SimulateError> {
        match std::fs::read(path) {
            Ok(bytes) => {
                serde_json::from_slice(&bytes).map(Some).map_err(|e| SimulateError::file(path, e.into()))
            }
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(SimulateError::file(path, e)),
        }
    }
    /// True if this program, on this processor, goes on bit for bit.
    pub fn is_of_this_program(&self) -> bool {
        self.level == instruction_level() && self.version == env!("CARGO_PKG_VERSION")
    }
    /// Accepted steps.
    pub fn steps(&self) -> u64 {
        self.steps
    }
    /// Recorded rows.
    pub fn rows(&self) -> u64 {
        self.rows
    }
}

impl Stepper {
    fn new(state: &StepperState) -> Self {
        match state.clone() {
            StepperState::Explicit(s) => Stepper::Explicit(Integrator {
                t: s.t,
                q: s.q,
                v: s.v,
                aux: s.aux,
                v_dot: s.v_dot,
                aux_dot: s.aux_dot,
                h: s.h,
                last_error: s.last_error,
                largest: s.largest,
                counts: s.counts,
                carried: s.carried,
            }),
            StepperState::Midpoint(s) => Stepper::Midpoint(Midpoint {
                t: s.t,
                q: s.q,
                p: s.p,
                forces: s.forces,
                potential: s.potential,
                guess: s.guess,
                steps: s.steps,
                iterations: s.iterations,
            }),
        }
    }
    fn into_state(self) -> StepperState {
        match self {
            Stepper::Explicit(s) => StepperState::Explicit(IntegratorState {
                t: s.t,
                q: s.q,
                v: s.v,
                aux: s.aux,
                v_dot: s.v_dot,
                aux_dot: s.aux_dot,
                h: s.h,
                last_error: s.last_error,
                largest: s.largest,
                counts: s.counts,
                carried: s.carried,
            }),
            Stepper::Midpoint(s) => StepperState::Midpoint(MidpointState {
                t: s.t,
                q: s.q,
                p: s.p,
                forces: s.forces,
                potential: s.potential,
                guess: s.guess,
                steps: s.steps,
                iterations: s.iterations,
            }),
        }
    }
}

/// Replaces a file as a whole: a reader, or a kill, sees the old one or the new one.
///
/// # Errors
/// [`SimulateError::File`].
pub fn replace(path: &Path, bytes: &[u8]) -> Result<(), SimulateError> {
    let failed = |e| SimulateError::file(path, e);
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder).map_err(failed)?;
    file.write_all(bytes).map_err(failed)?;
    publish(file, path)
}

/// Puts a finished temporary file in its place.
///
/// # Errors
/// [`SimulateError::File`].
pub fn publish(file: tempfile::NamedTempFile, path: &Path) -> Result<(), SimulateError> {
    let failed = |e| SimulateError::file(path, e);
    file.as_file().sync_data().map_err(failed)?;
    open_to_all(&file).map_err(failed)?;
    file.persist(path).map_err(|e| failed(e.error))?;
    Ok(())
}

/// Temporary files are the user's alone; results are as readable as others.
#[cfg(unix)]
fn open_to_all(file: &tempfile::NamedTempFile) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.as_file().set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn open_to_all(_: &tempfile::NamedTempFile) -> std::io::Result<()> {
    Ok(())
}
