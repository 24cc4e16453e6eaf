//! DCD trajectories of molecules, as CHARMM, NAMD and OpenMM write them: little-endian, positions in Å as f32, no unit cell.
//!
//! | bytes | what |
//! |---|---|
//! | 0 | length 84, `CORD`, number of frames, first step, steps between frames, last step |
//! | 44 | time step as f32 in units of √(Da Å² mol/kcal) = 0.04888821 ps; 0 for no unit cell; 24, the version of CHARMM |
//! | 88 | length 84; length 164, two titles of 80 characters, length 164 |
//! | 264 | length 4, number of atoms, length 4 |
//! | 276 | frames: x, y, z of all atoms, each between two lengths |
//!
//! A frame is written first and counted in the header after, in one write: a run that is killed leaves a file that is
//! right, and [`DcdWriter::append`] cuts off what was not counted.

use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The unit of time, ps: √(Da Å² mol/kcal), as other programs round it.
const TIME_UNIT: f64 = 0.04888821;
const HEADER: usize = 276;
/// Most atoms: the length of a record is an i32.
const MOST_ATOMS: usize = (i32::MAX as usize) / 4;

/// When the frames of a trajectory are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DcdTiming {
    /// Step of the first frame.
    pub first_step: i32,
    /// Steps from one frame to the next.
    pub interval: i32,
    /// Time step, ps.
    pub dt_ps: f64,
}

/// Writes a trajectory frame by frame.
///
/// # Example
/// ```
/// use phipsi_formats::dcd::{DcdTiming, DcdWriter};
/// # let folder = std::env::temp_dir().join(format!("phipsi-dcd-{}", std::process::id()));
/// # std::fs::create_dir_all(&folder)?;
/// # let path = folder.join("run.dcd");
/// let timing = DcdTiming { first_step: 0, interval: 100, dt_ps: 0.005 };
/// let mut trajectory = DcdWriter::create(&path, 2, timing)?;
/// trajectory.write(&[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])?;
/// let mut trajectory = DcdWriter::append(&path, 2)?;
/// trajectory.write(&[[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]])?;
/// assert_eq!(trajectory.frames(), 2);
/// # std::fs::remove_dir_all(&folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct DcdWriter {
    file: File,
    path: PathBuf,
    atoms: usize,
    frames: i32,
    first_step: i32,
    interval: i32,
    buffer: Vec<u8>,
}

/// Why a trajectory cannot be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DcdError {
    /// The file.
    pub path: PathBuf,
    /// What was found.
    pub found: String,
    /// What is required.
    pub required: String,
    /// What to do.
    pub remedy: String,
}

impl fmt::Display for DcdError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let DcdError { path, found, required, remedy } = self;
        write!(f, "{}: {found}; required: {required}; {remedy}", path.display())
    }
}

impl std::error::Error for DcdError {}

impl DcdWriter {
    /// Starts a trajectory; a file of this name is replaced.
    ///
    /// # Errors
    /// [`DcdError`] where the file cannot be written, and for numbers that its header cannot hold.
    pub fn create(path: impl AsRef<Path>, atoms: usize, timing: DcdTiming) -> Result<DcdWriter, DcdError> {
        let path = path.as_ref();
        check_atoms(path, atoms)?;
        let DcdTiming { first_step, interval, dt_ps } = timing;
        if first_step < 0 || interval < 1 || !(dt_ps > 0.0 && dt_ps.is_finite()) {
            return Err(error(
                path,
                format!("first step {first_step}, interval {interval}, time step {dt_ps} ps"),
                "no negative step, an interval of at least 1 and a positive time step",
                "correct them",
            ));
        }
        let mut header = Vec::with_capacity(HEADER);
        let mut put = |numbers: &[i32]| numbers.iter().for_each(|n| header.extend(n.to_le_bytes()));
        put(&[84, i32::from_le_bytes(*b"CORD"), 0, first_step, interval, 0, 0, 0, 0, 0, 0]);
        put(&[((dt_ps / TIME_UNIT) as f32).to_bits().cast_signed()]);
        put(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 24, 84, 164, 2]);
        for title in ["Created by phipsi", ""] {
            header.extend(title.bytes().chain(std::iter::repeat(0)).take(80));
        }
        for number in [164, 4, atoms as i32, 4] {
            header.extend(number.to_le_bytes());
        }
        let mut file = File::create(path).map_err(|e| cannot(path, e))?;
        file.write_all(&header).map_err(|e| cannot(path, e))?;
        Ok(DcdWriter { file, path: path.into(), atoms, frames: 0, first_step, interval, buffer: Vec::new() })
    }

    /// Goes on with a trajectory that this writer or OpenMM's began, behind its last complete frame.
    ///
    /// # Errors
    /// [`DcdError`] where the file cannot be read and written, is no such trajectory, or is of other atoms.
    pub fn append(path: impl AsRef<Path>, atoms: usize) -> Result<DcdWriter, DcdError> {
        let path = path.as_ref();
        check_atoms(path, atoms)?;
        let mut file = OpenOptions::new().read(true).write(true).open(path).map_err(|e| cannot(path, e))?;
        let mut header = [0u8; HEADER];
        let other = |found: String| {
            let required = "a little-endian DCD file without unit cell and with two titles";
            error(path, found, required, "write to another file")
        };
        file.read_exact(&mut header).map_err(|e| match e.kind() {
            std::io::ErrorKind::UnexpectedEof => other(format!("a file of less than {HEADER} bytes")),
            _ => cannot(path, e),
        })?;
        let number = |at: usize| {
            let bytes = header.get(at..at + 4).and_then(|b| b.try_into().ok()).unwrap_or_default();
            i32::from_le_bytes(bytes)
        };
        let cord = i32::from_le_bytes(*b"CORD");
        let expected =
            [(0, 84), (4, cord), (48, 0), (88, 84), (92, 164), (96, 2), (260, 164), (264, 4), (272, 4)];
        if let Some((at, value)) = expected.into_iter().find(|(at, value)| number(*at) != *value) {
            return Err(other(format!("{} at byte {at} in place of {value}", number(at))));
        }
        let (frames, first_step, interval) = (number(8), number(12), number(16));
        if frames < 0 || first_step < 0 || interval < 1 {
            return Err(other(format!("{frames} frames, first step {first_step}, interval {interval}")));
        }
        if number(268) != atoms as i32 {
            let found = format!("a trajectory of {} atoms", number(268));
            return Err(error(path, found, &format!("{atoms} atoms"), "write to another file"));
        }
        let end = HEADER as u64 + frames as u64 * frame_size(atoms);
        let length = file.metadata().map_err(|e| cannot(path, e))?.len();
        if length < end {
            return Err(other(format!("{length} bytes with {frames} frames, which need {end}")));
        }
        file.set_len(end).map_err(|e| cannot(path, e))?;
        Ok(DcdWriter { file, path: path.into(), atoms, frames, first_step, interval, buffer: Vec::new() })
    }

    /// Number of frames in the file.
    pub fn frames(&self) -> usize {
        usize::try_from(self.frames).unwrap_or_default()
    }

    /// Adds a frame; positions in nm.
    ///
    /// # Errors
    /// [`DcdError`] for another number of atoms, for positions that are not finite in f32, and where the file cannot be
    /// written. The file then has the frames before.
    pub fn write(&mut self, positions: &[[f64; 3]]) -> Result<(), DcdError> {
        if positions.len() != self.atoms {
            let found = format!("positions of {} atoms", positions.len());
            return Err(error(&self.path, found, &format!("{} atoms", self.atoms), "give all positions"));
        }
        let length = (4 * self.atoms as i32).to_le_bytes();
        self.buffer.clear();
        for axis in 0..3 {
            self.buffer.extend(length);
            for (i, position) in positions.iter().enumerate() {
                let x = (10.0 * position[axis]) as f32;
                if !x.is_finite() {
                    let found = format!("position {:?} nm of atom {i}", position);
                    return Err(error(
                        &self.path,
                        found,
                        "finite numbers",
                        "go back to the last good positions",
                    ));
                }
                self.buffer.extend(x.to_le_bytes());
            }
            self.buffer.extend(length);
        }
        let Some(frames) = self.frames.checked_add(1) else {
            let found = format!("{} frames", self.frames);
            return Err(error(&self.path, found, "fewer", "write to another file"));
        };
        let last = self.interval.saturating_mul(self.frames).saturating_add(self.first_step);
        let mut counts = [0u8; 16];
        for (slot, number) in counts.chunks_mut(4).zip([frames, self.first_step, self.interval, last]) {
            slot.copy_from_slice(&number.to_le_bytes());
        }
        let end = HEADER as u64 + self.frames as u64 * frame_size(self.atoms);
        let mut put = |at: u64, bytes: &[u8]| {
            self.file.seek(SeekFrom::Start(at))?;
            self.file.write_all(bytes)
        };
        put(end, &self.buffer).and_then(|()| put(8, &counts)).map_err(|e| cannot(&self.path, e))?;
        self.frames = frames;
        Ok(())
    }
}

/// Bytes of one frame.
fn frame_size(atoms: usize) -> u64 {
    3 * (8 + 4 * atoms as u64)
}

fn check_atoms(path: &Path, atoms: usize) -> Result<(), DcdError> {
    if (1..=MOST_ATOMS).contains(&atoms) {
        return Ok(());
    }
    let required = format!("1 to {MOST_ATOMS} atoms");
    Err(error(path, format!("{atoms} atoms"), &required, "write fewer atoms"))
}

fn error(path: &Path, found: String, required: &str, remedy: &str) -> DcdError {
    DcdError { path: path.into(), found, required: required.into(), remedy: remedy.into() }
}

fn cannot(path: &Path, e: std::io::Error) -> DcdError {
    error(
        path,
        e.to_string(),
        "a file that can be written",
        "check the path, its permissions and the space left",
    )
}
