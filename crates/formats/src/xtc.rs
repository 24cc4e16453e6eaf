//! XTC trajectories of molecules, as GROMACS writes them: big-endian, positions in nm rounded to 1/precision, compressed.
//!
//! | bytes | what |
//! |---|---|
//! | 0 | 1995, the number of atoms, the step; the time in ps as f32; nine f32, the box (zeros for none) |
//! | 52 | the number of atoms again |
//! | 56 | of at most nine atoms: x, y, z of all as f32; else the precision as f32, and whole numbers compressed |
//!
//! A frame is written in one write: of a run that is killed the last frame may be half there. [`XtcWriter::append`] cuts it
//! off, and [`XtcReader`] ends before it.

mod compression;

use crate::trajectory::{Frame, TrajectoryError, cannot};
use std::fs::{File, OpenOptions};
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Frames begin with it.
const MAGIC: i32 = 1995;

/// Positions are rounded to 1/PRECISION nm: 0.001 nm, as GROMACS does where nothing else is asked for.
pub const PRECISION: f32 = 1000.0;

/// At most so many atoms are written as they are.
const FEW: usize = 9;

/// Most atoms: of larger systems the length of a frame does not fit into an i32.
const MOST_ATOMS: usize = 298_261_617;

/// Bytes before the precision or the positions.
const HEADER: usize = 56;

/// Writes a trajectory frame by frame.
///
/// # Example
/// ```
/// use phipsi_formats::xtc::{XtcReader, XtcWriter};
/// # let folder = std::env::temp_dir().join(format!("phipsi-xtc-{}", std::process::id()));
/// # std::fs::create_dir_all(&folder)?;
/// # let path = folder.join("run.xtc");
/// let mut trajectory = XtcWriter::create(&path, 2)?;
/// trajectory.write(0, 0.0, &[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])?;
/// let mut frames = XtcReader::open(&path)?;
/// assert_eq!(frames.next_frame()?.map(|f| f.positions[1]), Some([0.1_f32 as f64, 0.0, 0.0]));
/// assert!(frames.next_frame()?.is_none());
/// # std::fs::remove_dir_all(&folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct XtcWriter {
    file: File,
    path: PathBuf,
    atoms: usize,
}

impl XtcWriter {
    /// Starts a trajectory; a file of this name is replaced.
    ///
    /// # Errors
    /// [`TrajectoryError`] where the file cannot be written, and without atoms.
    pub fn create(path: impl AsRef<Path>, atoms: usize) -> Result<XtcWriter, TrajectoryError> {
        let path = path.as_ref();
        if !(1..=MOST_ATOMS).contains(&atoms) {
            let required = format!("1 to {MOST_ATOMS} atoms");
            return Err(TrajectoryError::new(path, format!("{atoms} atoms"), required, "write fewer atoms"));
        }
        let file = File::create(path).map_err(|e| cannot(path, e))?;
        Ok(XtcWriter { file, path: path.into(), atoms })
    }
    /// Goes on with a trajectory behind its last complete frame.
    ///
    /// # Errors
    /// [`TrajectoryError`] where the file cannot be read and written, is no such trajectory, or is of other atoms.
    pub fn append(path: impl AsRef<Path>, atoms: usize) -> Result<XtcWriter, TrajectoryError> {
        let path = path.as_ref();
        let mut end = 0;
        let mut reader = XtcReader::open(path)?;
        while let Some(frame) = reader.next_frame()? {
            if frame.positions.len() != atoms {
                let found = format!("a frame of {} atoms", frame.positions.len());
                return Err(TrajectoryError::new(
                    path,
                    found,
                    format!("{atoms} atoms"),
                    "write to another file",
                ));
            }
            end = reader.file.stream_position().map_err(|e| cannot(path, e))?;
        }
        let mut file = OpenOptions::new().write(true).open(path).map_err(|e| cannot(path, e))?;
        file.set_len(end).and_then(|()| file.seek(SeekFrom::Start(end))).map_err(|e| cannot(path, e))?;
        Ok(XtcWriter { file, path: path.into(), atoms })
    }
    /// Adds a frame; time in ps, positions in nm.
    ///
    /// # Errors
    /// [`TrajectoryError`] for another number of atoms, for positions that are not finite or too large for the precision (2·10⁶
    /// nm), and where the file cannot be written.
    pub fn write(&mut self, step: i32, time_ps: f64, positions: &[[f64; 3]]) -> Result<(), TrajectoryError> {
        if positions.len() != self.atoms {
            let found = format!("positions of {} atoms", positions.len());
            let required = format!("{} atoms", self.atoms);
            return Err(TrajectoryError::new(&self.path, found, required, "give all positions"));
        }
        let most = f64::from(i32::MAX - 2) / f64::from(PRECISION);
        let is_good = |x: &[f64; 3]| x.iter().all(|x| x.abs() < most);
        if let Some(i) = positions.iter().position(|x| !is_good(x)) {
            let found = format!("position {:?} nm of atom {i}", positions[i]);
            let required = format!("finite numbers below {most:.0} nm");
            let remedy = "go back to the last good positions";
            return Err(TrajectoryError::new(&self.path, found, required, remedy));
        }
        let atoms = self.atoms as i32;
        let mut bytes = Vec::with_capacity(HEADER + 6 * self.atoms);
        [MAGIC, atoms, step].iter().for_each(|n| bytes.extend(n.to_be_bytes()));
        bytes.extend((time_ps as f32).to_be_bytes());
        bytes.extend([0; 36]);
        bytes.extend(atoms.to_be_bytes());
        if self.atoms <= FEW {
            positions.iter().flatten().for_each(|x| bytes.extend((*x as f32).to_be_bytes()));
        } else {
            bytes.extend(PRECISION.to_be_bytes());
            let whole = |x: f64| (x * f64::from(PRECISION)).round() as i32;
            let numbers: Vec<[i32; 3]> = positions.iter().map(|x| x.map(whole)).collect();
            compression::compress(&numbers, &mut bytes);
        }
        self.file.write_all(&bytes).map_err(|e| cannot(&self.path, e))
    }
}

/// Reads a trajectory frame by frame.
#[derive(Debug)]
pub struct XtcReader {
    file: BufReader<File>,
    path: PathBuf,
    frames: usize,
}

impl XtcReader {
    /// Opens a trajectory.
    ///
    /// # Errors
    /// [`TrajectoryError`] where the file cannot be read.
    pub fn open(path: impl AsRef<Path>) -> Result<XtcReader, TrajectoryError> {
        let path = path.as_ref();
        let file = File::open(path).map_err(|e| cannot(path, e))?;
        Ok(XtcReader { file: BufReader::new(file), path: path.into(), frames: 0 })
    }
    /// The next frame; `None` at the end, also where the last frame is not complete.
    ///
    /// # Errors
    /// [`TrajectoryError`] for what is no XTC frame.
    pub fn next_frame(&mut self) -> Result<Option<Frame>, TrajectoryError> {
        let mut header = [0; HEADER];
        if !self.fill(&mut header)? {
            return Ok(None);
        }
        let word = |at: usize| [header[at], header[at + 1], header[at + 2], header[at + 3]];
        let integer = |at: usize| i32::from_be_bytes(word(at));
        let atoms = usize::try_from(integer(4)).ok().filter(|n| *n > 0 && integer(52) == integer(4));
        let (Some(atoms), MAGIC) = (atoms, integer(0)) else {
            let found = format!("{} and {} atoms at the start of a frame", integer(0), integer(4));
            return Err(self.wrong(found, format!("{MAGIC} and at least one atom")));
        };
        let mut frame = Frame {
            step: integer(8),
            time_ps: Some(f64::from(f32::from_be_bytes(word(12)))),
            positions: Vec::new(),
        };
        let numbers = if atoms <= FEW { 3 * atoms } else { 9 };
        let mut start = vec![0; 4 * numbers];
        if !self.fill(&mut start)? {
            return Ok(None);
        }
        let words: Vec<[u8; 4]> = start.chunks_exact(4).map(|w| [w[0], w[1], w[2], w[3]]).collect();
        if atoms <= FEW {
            let x: Vec<f64> = words.iter().map(|w| f64::from(f32::from_be_bytes(*w))).collect();
            frame.positions = x.chunks_exact(3).map(|x| [x[0], x[1], x[2]]).collect();
        } else {
            let precision = f64::from(f32::from_be_bytes(words[0]));
            let integers: Vec<i32> = words[1..].iter().map(|w| i32::from_be_bytes(*w)).collect();
            let length = usize::try_from(integers[7]).unwrap_or(usize::MAX);
            // Three numbers of 32 bits, flags and a run of small ones take less.
            if length / 20 > atoms + 4 || !(precision > 0.0 && precision.is_finite()) {
                let found = format!("precision {precision} and {} bytes for {atoms} atoms", integers[7]);
                return Err(self.wrong(found, "a positive precision and at most 20 bytes an atom".into()));
            }
            let mut bytes = Vec::new();
            let padded = length.next_multiple_of(4);
            let read = (&mut self.file).take(padded as u64).read_to_end(&mut bytes);
            if read.map_err(|e| cannot(&self.path, e))? < padded {
                return Ok(None);
            }
            let Some(whole) = compression::decompress(&integers[..7], &bytes[..length], atoms) else {
                return Err(self.wrong("compressed positions that end early".into(), "all positions".into()));
            };
            // As other programs do: in single precision.
            let inverse = 1.0 / precision as f32;
            let position = |x: [i32; 3]| x.map(|x| f64::from(x as f32 * inverse));
            frame.positions = whole.into_iter().map(position).collect();
        }
        self.frames += 1;
        Ok(Some(frame))
    }
    /// Fills a buffer; false where the file ends before.
    fn fill(&mut self, buffer: &mut [u8]) -> Result<bool, TrajectoryError> {
        match self.file.read_exact(buffer) {
            Ok(()) => Ok(true),
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => Ok(false),
            Err(e) => Err(cannot(&self.path, e)),
        }
    }
    fn wrong(&self, found: String, required: String) -> TrajectoryError {
        let found = format!("frame {}: {found}", self.frames);
        TrajectoryError::new(&self.path, found, required, "give an XTC trajectory with numbers of 1995")
    }
}
