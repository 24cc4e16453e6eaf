//! `checkpoint/steps.bin`: end and imbalances of every accepted step, four little-endian f64 each.

use crate::error::SimulateError;
use crate::record::StepRecord;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const RECORD: usize = 32;

/// Steps being written.
pub struct StepWriter {
    path: PathBuf,
    file: BufWriter<File>,
}

impl StepWriter {
    /// Behind the first `steps` records, over what may be there.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn open(path: &Path, steps: u64) -> Result<Self, SimulateError> {
        let failed = |e| SimulateError::file(path, e);
        let mut file =
            OpenOptions::new().write(true).create(true).truncate(false).open(path).map_err(failed)?;
        file.seek(SeekFrom::Start(steps * RECORD as u64)).map_err(failed)?;
        Ok(StepWriter { path: path.into(), file: BufWriter::new(file) })
    }
    /// Adds a step.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn step(&mut self, step: &StepRecord) -> Result<(), SimulateError> {
        let mut bytes = [0u8; RECORD];
        let [e, a, l] = step.imbalance;
        for (slot, x) in bytes.chunks_exact_mut(8).zip([step.t, e, a, l]) {
            slot.copy_from_slice(&x.to_le_bytes());
        }
        self.file.write_all(&bytes).map_err(|e| SimulateError::file(&self.path, e))
    }
    /// Puts everything on the disk.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn sync(&mut self) -> Result<(), SimulateError> {
        let failed = |e| SimulateError::file(&self.path, e);
        self.file.flush().map_err(failed)?;
        self.file.get_ref().sync_data().map_err(failed)
    }
}

/// The first `steps` records.
///
/// # Errors
/// [`SimulateError::File`] if the file cannot be read or has fewer.
pub fn read_steps(path: &Path, steps: u64) -> Result<Vec<StepRecord>, SimulateError> {
    let failed = |e| SimulateError::file(path, e);
    let mut bytes = Vec::new();
    File::open(path).map_err(failed)?.take(steps * RECORD as u64).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 != steps * RECORD as u64 {
        let text = format!("{} bytes where {} are required", bytes.len(), steps * RECORD as u64);
        return Err(failed(std::io::Error::new(std::io::ErrorKind::UnexpectedEof, text)));
    }
    let number = |chunk: &[u8], i: usize| {
        let mut eight = [0u8; 8];
        eight.copy_from_slice(&chunk[8 * i..8 * i + 8]);
        f64::from_le_bytes(eight)
    };
    Ok(bytes
        .chunks_exact(RECORD)
        .map(|c| StepRecord { t: number(c, 0), imbalance: [number(c, 1), number(c, 2), number(c, 3)] })
        .collect())
}
