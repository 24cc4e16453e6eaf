//! Trajectories of molecules in any of the formats: by the end of their file's name.
//!
//! | name | read | written |
//! |---|---|---|
//! | `.dcd` | little-endian, also with a unit cell | [`crate::dcd`] |
//! | `.xtc` | both numbers of atoms | [`crate::xtc`] |
//! | `.pdb` | one frame for each MODEL | one MODEL for each frame, with names from another PDB file |

mod models;

use crate::dcd::{DcdReader, DcdTiming, DcdWriter};
use crate::pdb::{Pdb, read_pdb_file};
use crate::xtc::{XtcReader, XtcWriter};
use models::{ModelReader, ModelWriter};
use std::fmt;
use std::path::{Path, PathBuf};

/// Positions at one instant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// The step.
    pub step: i32,
    /// The time, ps, where the file tells it.
    pub time_ps: Option<f64>,
    /// Positions of the atoms, nm.
    pub positions: Vec<[f64; 3]>,
}

/// Why a trajectory cannot be read or written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrajectoryError {
    /// The file.
    pub path: PathBuf,
    /// What was found.
    pub found: String,
    /// What is required.
    pub required: String,
    /// What to do.
    pub remedy: String,
}

impl fmt::Display for TrajectoryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let TrajectoryError { path, found, required, remedy } = self;
        write!(f, "{}: {found}; required: {required}; {remedy}", path.display())
    }
}

impl std::error::Error for TrajectoryError {}

impl TrajectoryError {
    pub(crate) fn new(
        path: &Path,
        found: impl Into<String>,
        required: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let (found, required, remedy) = (found.into(), required.into(), remedy.into());
        TrajectoryError { path: path.into(), found, required, remedy }
    }
}

/// An error of the file system.
pub(crate) fn cannot(path: &Path, e: std::io::Error) -> TrajectoryError {
    let required = "a file that can be read or written";
    TrajectoryError::new(path, e.to_string(), required, "check the path, its permissions and the space left")
}

/// A format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Dcd,
    Xtc,
    Pdb,
}

impl Format {
    fn of(path: &Path) -> Result<Format, TrajectoryError> {
        let end = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        match end.as_str() {
            "dcd" => Ok(Format::Dcd),
            "xtc" => Ok(Format::Xtc),
            "pdb" => Ok(Format::Pdb),
            _ => {
                let found =
                    if end.is_empty() { "a name without end".into() } else { format!("a .{end} file") };
                Err(TrajectoryError::new(path, found, "a name that ends in .dcd, .xtc or .pdb", "rename it"))
            }
        }
    }
}

/// True if the name is that of a trajectory that [`convert`] reads or writes.
pub fn is_trajectory(path: &Path) -> bool {
    Format::of(path).is_ok()
}

/// Writes a DCD or an XTC trajectory, as the file's name says.
#[derive(Debug)]
pub enum TrajectoryWriter {
    /// DCD.
    Dcd(DcdWriter),
    /// XTC.
    Xtc(XtcWriter, DcdTiming, i32),
}

impl TrajectoryWriter {
    /// Starts a trajectory; a file of this name is replaced. A name that ends in .xtc is that of an XTC file, any other of a DCD
    /// file.
    ///
    /// # Errors
    /// [`TrajectoryError`], as the writers of both formats.
    pub fn create(
        path: impl AsRef<Path>,
        atoms: usize,
        timing: DcdTiming,
    ) -> Result<TrajectoryWriter, TrajectoryError> {
        let path = path.as_ref();
        Ok(match Format::of(path) {
            Ok(Format::Xtc) => {
                TrajectoryWriter::Xtc(XtcWriter::create(path, atoms)?, timing, timing.first_step)
            }
            _ => TrajectoryWriter::Dcd(DcdWriter::create(path, atoms, timing)?),
        })
    }
    /// Adds a frame; positions in nm.
    ///
    /// # Errors
    /// [`TrajectoryError`], as the writers of both formats.
    pub fn write(&mut self, positions: &[[f64; 3]]) -> Result<(), TrajectoryError> {
        match self {
            TrajectoryWriter::Dcd(writer) => writer.write(positions),
            TrajectoryWriter::Xtc(writer, timing, step) => {
                writer.write(*step, f64::from(*step) * timing.dt_ps, positions)?;
                *step = step.saturating_add(timing.interval);
                Ok(())
            }
        }
    }
}

enum Reader {
    Dcd(DcdReader),
    Xtc(XtcReader),
    Pdb(ModelReader),
}

impl Reader {
    fn open(path: &Path) -> Result<Reader, TrajectoryError> {
        Ok(match Format::of(path)? {
            Format::Dcd => Reader::Dcd(DcdReader::open(path)?),
            Format::Xtc => Reader::Xtc(XtcReader::open(path)?),
            Format::Pdb => Reader::Pdb(ModelReader::open(path)?),
        })
    }
    fn next_frame(&mut self) -> Result<Option<Frame>, TrajectoryError> {
        match self {
            Reader::Dcd(reader) => reader.next_frame(),
            Reader::Xtc(reader) => reader.next_frame(),
            Reader::Pdb(reader) => reader.next_frame(),
        }
    }
}

enum Writer {
    Dcd(DcdWriter),
    Xtc(XtcWriter),
    Pdb(ModelWriter),
}

/// What [`convert`] wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Converted {
    /// Frames.
    pub frames: usize,
    /// Atoms of each.
    pub atoms: usize,
}

/// Writes the frames of a trajectory in the format that the output's name says; `names`: a PDB file with the names of the atoms,
/// needed to write PDB from another format. An output that exists is not overwritten.
///
/// XTC rounds positions to 0.001 nm, PDB to 0.0001 nm, DCD to single precision. The times of a DCD file are those of equal steps:
/// the ones of the first two frames; 1 ps where the input tells none.
///
/// # Errors
/// [`TrajectoryError`]: files that cannot be read or written, that are not of these formats, or not of the same atoms; an input
/// without frames.
///
/// # Example
/// ```
/// use phipsi_formats::trajectory::convert;
/// use phipsi_formats::xtc::XtcWriter;
/// # let folder = std::env::temp_dir().join(format!("phipsi-convert-{}", std::process::id()));
/// # std::fs::create_dir_all(&folder)?;
/// # let (from, to) = (folder.join("run.xtc"), folder.join("run.dcd"));
/// XtcWriter::create(&from, 1)?.write(0, 0.0, &[[0.1, 0.2, 0.3]])?;
/// assert_eq!(convert(&from, None, &to)?.frames, 1);
/// # std::fs::remove_dir_all(&folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn convert(input: &Path, names: Option<&Path>, output: &Path) -> Result<Converted, TrajectoryError> {
    let format = Format::of(output)?;
    if output.exists() {
        let required = "a file that does not exist yet";
        return Err(TrajectoryError::new(output, "a file", required, "give another name, or remove it"));
    }
    let mut reader = Reader::open(input)?;
    let (first, mut second) = (reader.next_frame()?, reader.next_frame()?);
    let Some(first) = first else {
        let (found, required) = ("no complete frame", "at least one");
        return Err(TrajectoryError::new(
            input,
            found,
            required,
            "see whether the file was written to its end",
        ));
    };
    let atoms = first.positions.len();
    let mut writer = match format {
        Format::Dcd => Writer::Dcd(DcdWriter::create(output, atoms, timing(&first, second.as_ref()))?),
        Format::Xtc => Writer::Xtc(XtcWriter::create(output, atoms)?),
        Format::Pdb => Writer::Pdb(ModelWriter::create(output, names_of(input, names, atoms)?)?),
    };
    let mut frames = 0;
    let mut next = Some(first);
    while let Some(frame) = next {
        if frame.positions.len() != atoms {
            let found = format!("{} atoms in frame {frames}", frame.positions.len());
            return Err(TrajectoryError::new(
                input,
                found,
                format!("{atoms}, as in the first"),
                "split the file",
            ));
        }
        match &mut writer {
            Writer::Dcd(writer) => writer.write(&frame.positions)?,
            Writer::Xtc(writer) => {
                writer.write(frame.step, frame.time_ps.unwrap_or(frames as f64), &frame.positions)?
            }
            Writer::Pdb(writer) => writer.write(&frame.positions)?,
        }
        frames += 1;
        next = match second.take() {
            Some(frame) => Some(frame),
            None => reader.next_frame()?,
        };
    }
    if let Writer::Pdb(writer) = writer {
        writer.finish()?;
    }
    Ok(Converted { frames, atoms })
}

/// Equal steps through the first two frames.
fn timing(first: &Frame, second: Option<&Frame>) -> DcdTiming {
    let start = DcdTiming { first_step: first.step.max(0), interval: 1, dt_ps: 1.0 };
    let Some(second) = second else { return start };
    let interval = second.step.saturating_sub(first.step).max(1);
    let span = second.time_ps.zip(first.time_ps).map(|(b, a)| b - a).filter(|span| *span > 0.0);
    DcdTiming { interval, dt_ps: span.map_or(1.0, |span| span / f64::from(interval)), ..start }
}

/// The atoms' names for a PDB file.
fn names_of(input: &Path, names: Option<&Path>, atoms: usize) -> Result<Pdb, TrajectoryError> {
    let path = match (names, Format::of(input)?) {
        (Some(path), _) => path,
        (None, Format::Pdb) => input,
        (None, _) => {
            let (found, required) = ("positions without names of atoms", "a PDB file with the names");
            let remedy = "give it between the trajectory and the output";
            return Err(TrajectoryError::new(input, found, required, remedy));
        }
    };
    let loaded = read_pdb_file(path);
    let Some(pdb) = loaded.value else {
        let found = loaded.report.to_string();
        return Err(TrajectoryError::new(path, found.trim().to_string(), "a PDB file", "correct it"));
    };
    if pdb.atoms.len() != atoms {
        let (found, required) =
            (format!("{} atoms", pdb.atoms.len()), format!("{atoms}, as in the trajectory"));
        return Err(TrajectoryError::new(path, found, required, "give the PDB file of the same atoms"));
    }
    Ok(pdb)
}
