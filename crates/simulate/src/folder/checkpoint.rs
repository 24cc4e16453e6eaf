//! `checkpoint/state.json`: everything that continues a run bit for bit, replaced as a whole.

use crate::error::SimulateError;
use crate::level::instruction_level;
use crate::run::RunState;
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
    /// The state.
    pub state: RunState,
}

impl Checkpoint {
    /// Of a run's state.
    pub fn new(state: RunState, table_bytes: u64) -> Self {
        let version = env!("CARGO_PKG_VERSION").into();
        Checkpoint { level: instruction_level(), version, table_bytes, state }
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
