//! Copies of a run's inputs with their hashes, so that a run folder resumes without the files it was made from.

use super::checkpoint::replace;
use crate::error::SimulateError;
use crate::scene::{Scene, SceneFile};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// One input of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// The key of the scene that names it; empty for the scene itself.
    pub key: String,
    /// The file as the user named it.
    pub file: String,
    /// Its copy, relative to the run folder.
    pub copy: String,
    /// BLAKE3 hash of its bytes.
    pub blake3: String,
}

/// The hash of an input.
pub fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Copies the scene and the files that it names; the scene comes first.
///
/// # Errors
/// [`SimulateError::File`].
pub fn copy(folder: &Path, scene_path: &Path, scene: &Scene) -> Result<Vec<Input>, SimulateError> {
    let target = folder.join("inputs");
    std::fs::create_dir_all(&target).map_err(|e| SimulateError::file(&target, e))?;
    let mut inputs = vec![place(folder, "", scene_path, "scene.toml".into(), scene.text.as_bytes())?];
    for (i, file) in scene.files.iter().enumerate() {
        let SceneFile { key, path } = file;
        let bytes = std::fs::read(path).map_err(|e| SimulateError::file(path, e))?;
        let name = path.file_name().map_or("file".into(), |n| n.to_string_lossy().into_owned());
        inputs.push(place(folder, key, path, format!("{i}-{name}"), &bytes)?);
    }
    Ok(inputs)
}

fn place(folder: &Path, key: &str, file: &Path, name: String, bytes: &[u8]) -> Result<Input, SimulateError> {
    let copy = format!("inputs/{name}");
    replace(&folder.join(&copy), bytes)?;
    Ok(Input { key: key.into(), file: file.display().to_string(), copy, blake3: hash(bytes) })
}

/// Reads a copy back.
///
/// # Errors
/// [`SimulateError::File`] if it cannot be read, [`SimulateError::Folder`] if it is not what was copied.
pub fn read_back(folder: &Path, input: &Input) -> Result<Vec<u8>, SimulateError> {
    let path = folder.join(&input.copy);
    let bytes = std::fs::read(&path).map_err(|e| SimulateError::file(&path, e))?;
    if hash(&bytes) != input.blake3 {
        let message = "has been changed since the run began, so the run cannot be continued; start a new one";
        return Err(SimulateError::folder(&path, message));
    }
    Ok(bytes)
}
