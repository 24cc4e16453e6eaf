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

use crate::trajectory::{Frame, TrajectoryError, cannot};
use std::fs::{File, OpenOptions};
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The unit of time, ps: √(Da Å² mol/kcal), as other programs round it.
const TIME_UNIT: f64 = 0.04888821;
const HEADER: usize = 276;
/// Most atoms: the length of a record is an i32.
const MOST_ATOMS: usize = (i32::MAX as usize) / 4;
/// Most bytes of titles that are read.
const LONGEST_TITLES: usize = 1 << 20;

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

impl DcdWriter {
    /// Starts a trajectory; a file of this name is replaced.
    ///
    /// # Errors
    /// [`TrajectoryError`] where the file cannot be written, and for numbers that its header cannot hold.
    pub fn create(
        path: impl AsRef<Path>,
        atoms: usize,
        timing: DcdTiming,
    ) -> Result<DcdWriter, TrajectoryError> {
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
    /// [`TrajectoryError`] where the file cannot be read and written, is no such trajectory, or is of other atoms.
    pub fn append(path: impl AsRef<Path>, atoms: usize) -> Result<DcdWriter, TrajectoryError> {
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
    /// [`TrajectoryError`] for another number of atoms, for positions that are not finite in f32, and where the file cannot be
    /// written. The file then has the frames before.
    pub fn write(&mut self, positions: &[[f64; 3]]) -> Result<(), TrajectoryError> {
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

fn check_atoms(path: &Path, atoms: usize) -> Result<(), TrajectoryError> {
    if (1..=MOST_ATOMS).contains(&atoms) {
        return Ok(());
    }
    let required = format!("1 to {MOST_ATOMS} atoms");
    Err(error(path, format!("{atoms} atoms"), &required, "write fewer atoms"))
}

fn error(path: &Path, found: String, required: &str, remedy: &str) -> TrajectoryError {
    TrajectoryError::new(path, found, required, remedy)
}

/// Reads a trajectory frame by frame: little-endian, with or without unit cell, any number of titles.
#[derive(Debug)]
pub struct DcdReader {
    file: BufReader<File>,
    path: PathBuf,
    atoms: usize,
    timing: DcdTiming,
    has_cell: bool,
    frames: usize,
}

impl DcdReader {
    /// Opens a trajectory.
    ///
    /// # Errors
    /// [`TrajectoryError`] where the file cannot be read, is no such trajectory, or keeps some atoms fixed.
    pub fn open(path: impl AsRef<Path>) -> Result<DcdReader, TrajectoryError> {
        let path = path.as_ref();
        let file = File::open(path).map_err(|e| cannot(path, e))?;
        let timing = DcdTiming { first_step: 0, interval: 1, dt_ps: 1.0 };
        let mut reader = DcdReader {
            file: BufReader::new(file),
            path: path.into(),
            atoms: 0,
            timing,
            has_cell: false,
            frames: 0,
        };
        let header =
            reader.record(84, 84)?.ok_or_else(|| reader.wrong("a file that ends in its header".into()))?;
        let number =
            |at: usize| i32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        if number(0) != i32::from_le_bytes(*b"CORD") {
            return Err(reader.wrong(format!("{} in place of CORD", number(0))));
        }
        if number(36) != 0 {
            return Err(reader.wrong(format!("{} fixed atoms", number(36))));
        }
        reader.timing.first_step = number(8).max(0);
        reader.timing.interval = number(12).max(1);
        let dt = f64::from(f32::from_bits(number(40).cast_unsigned())) * TIME_UNIT;
        if dt > 0.0 && dt.is_finite() {
            reader.timing.dt_ps = dt;
        }
        reader.has_cell = number(44) == 1;
        let titles = reader.record(4, LONGEST_TITLES)?;
        let atoms = reader.record(4, 4)?.filter(|_| titles.is_some());
        let atoms = atoms.map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        match atoms.and_then(|n| usize::try_from(n).ok()).filter(|n| (1..=MOST_ATOMS).contains(n)) {
            Some(atoms) => reader.atoms = atoms,
            None => return Err(reader.wrong(format!("{} atoms", atoms.unwrap_or(0)))),
        }
        Ok(reader)
    }
    /// The next frame; `None` at the end, also where the last frame is not complete.
    ///
    /// # Errors
    /// [`TrajectoryError`] for what is no DCD frame.
    pub fn next_frame(&mut self) -> Result<Option<Frame>, TrajectoryError> {
        if self.has_cell && self.record(48, 48)?.is_none() {
            return Ok(None);
        }
        let size = 4 * self.atoms;
        let mut positions = vec![[0.0; 3]; if self.frames == 0 { 0 } else { self.atoms }];
        for axis in 0..3 {
            let Some(bytes) = self.record(size, size)? else { return Ok(None) };
            positions.resize(self.atoms, [0.0; 3]);
            for (x, b) in positions.iter_mut().zip(bytes.chunks_exact(4)) {
                x[axis] = f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])) / 10.0;
            }
        }
        let step = i64::from(self.timing.first_step) + i64::from(self.timing.interval) * self.frames as i64;
        let time_ps = Some(step as f64 * self.timing.dt_ps);
        self.frames += 1;
        Ok(Some(Frame { step: i32::try_from(step).unwrap_or(i32::MAX), time_ps, positions }))
    }
    /// The bytes of a record of a length in these bounds; `None` where the file ends before.
    fn record(&mut self, least: usize, most: usize) -> Result<Option<Vec<u8>>, TrajectoryError> {
        let mut mark = [0; 4];
        if !self.fill(&mut mark)? {
            return Ok(None);
        }
        let length = i32::from_le_bytes(mark);
        let Some(size) = usize::try_from(length).ok().filter(|size| (least..=most).contains(size)) else {
            return Err(self.wrong(format!("a record of {length} bytes in place of {least}")));
        };
        let mut bytes = Vec::new();
        let read =
            (&mut self.file).take(size as u64).read_to_end(&mut bytes).map_err(|e| cannot(&self.path, e))?;
        if read < size || !self.fill(&mut mark)? {
            return Ok(None);
        }
        if i32::from_le_bytes(mark) != length {
            let after = i32::from_le_bytes(mark);
            return Err(self.wrong(format!("a record with {length} before and {after} behind it")));
        }
        Ok(Some(bytes))
    }
    /// Fills a buffer; false where the file ends before.
    fn fill(&mut self, buffer: &mut [u8]) -> Result<bool, TrajectoryError> {
        match self.file.read_exact(buffer) {
            Ok(()) => Ok(true),
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => Ok(false),
            Err(e) => Err(cannot(&self.path, e)),
        }
    }
    fn wrong(&self, found: String) -> TrajectoryError {
        let required = "a little-endian DCD file in which all atoms move";
        error(&self.path, found, required, "write it anew, with mdtraj for example")
    }
}
