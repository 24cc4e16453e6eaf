//! What can go wrong with a scene or a run.

use phipsi_formats::Report;
use phipsi_motion::MotionError;
use phipsi_recursion::DynamicsError;
use std::fmt;
use std::path::{Path, PathBuf};

/// Why a scene was not run to its end.
#[derive(Debug)]
#[non_exhaustive]
pub enum SimulateError {
    /// The scene or a file it names cannot be used; the reports say where and why.
    Scene(Vec<Report>),
    /// The start is not one of this model.
    Start(String),
    /// A recursion failed.
    Dynamics(DynamicsError),
    /// The equations of motion could not be set up, or the loops not closed.
    Motion(MotionError),
    /// No step succeeded any more; the last good state is kept.
    Stopped {
        /// Time of the last good state.
        t: f64,
        /// What failed, with the joint or force.
        message: String,
    },
    /// A file could not be read or written.
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A run folder cannot be used as asked.
    Folder {
        /// The folder.
        path: PathBuf,
        /// What was found and what to do.
        message: String,
    },
    /// An observer stopped the run with a message of its own.
    Observer(String),
}

impl SimulateError {
    /// A failed access to a file.
    pub fn file(path: &Path, source: std::io::Error) -> Self {
        SimulateError::File { path: path.into(), source }
    }
    /// A run folder that cannot be used.
    pub fn folder(path: &Path, message: impl Into<String>) -> Self {
        SimulateError::Folder { path: path.into(), message: message.into() }
    }
}

impl fmt::Display for SimulateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SimulateError::Scene(reports) => {
                for (i, report) in reports.iter().enumerate() {
                    write!(f, "{}{}", if i > 0 { "\n" } else { "" }, report.to_string().trim_end())?;
                }
                Ok(())
            }
            SimulateError::Start(message) | SimulateError::Observer(message) => f.write_str(message),
            SimulateError::Dynamics(e) => e.fmt(f),
            SimulateError::Motion(e) => e.fmt(f),
            SimulateError::Stopped { message, .. } => f.write_str(message),
            SimulateError::File { path, source } => write!(f, "{}: {source}", path.display()),
            SimulateError::Folder { path, message } => write!(f, "{}: {message}", path.display()),
        }
    }
}

impl std::error::Error for SimulateError {}

impl From<MotionError> for SimulateError {
    fn from(e: MotionError) -> Self {
        match e {
            MotionError::Dynamics(e) => SimulateError::Dynamics(e),
            e => SimulateError::Motion(e),
        }
    }
}

impl From<DynamicsError> for SimulateError {
    fn from(e: DynamicsError) -> Self {
        SimulateError::Dynamics(e)
    }
}
