//! `trajectory.csv`: one row per recorded instant, every number in the shortest form that reads back exactly.
//!
//! A resumed run writes over the rows behind its checkpoint in place, so that the file never gets shorter.

use crate::error::SimulateError;
use crate::record::Row;
use crate::simulation::Simulation;
use phipsi_model::{JointKind, Model};
use std::fmt::Write as _;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The columns of a trajectory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Columns {
    nq: usize,
    nv: usize,
    /// True if the base is free, so that momentum is recorded.
    pub momentum: bool,
    /// Names of the outputs.
    pub outputs: Vec<String>,
    /// Names of the parts of the potential energy.
    pub terms: Vec<String>,
    /// Names of the position coordinates: `shoulder`, `base.x` …
    pub q: Vec<String>,
    /// Names of the degrees of freedom.
    pub v: Vec<String>,
}

impl Columns {
    /// Of a simulation.
    pub fn new(simulation: &Simulation) -> Self {
        let model = simulation.model();
        Columns {
            nq: model.nq(),
            nv: model.nv(),
            momentum: simulation.dynamics.plan().momentum,
            outputs: simulation.outputs.iter().map(|o| o.name.clone()).collect(),
            terms: simulation.dynamics.terms(),
            q: component_names(model, position_suffixes, |k| model.q_range(k).len()),
            v: component_names(model, velocity_suffixes, |k| model.v_range(k).len()),
        }
    }
    /// The header line.
    pub fn header(&self) -> String {
        let mut names = vec!["t".to_string()];
        names.extend(self.q.iter().map(|n| format!("q.{n}")));
        names.extend(self.v.iter().map(|n| format!("v.{n}")));
        names.extend(["kinetic_energy", "potential_energy", "work"].map(String::from));
        if self.momentum {
            for what in ["angular_momentum", "linear_momentum"] {
                names.extend(["x", "y", "z"].map(|a| format!("{what}.{a}")));
            }
        }
        names.extend(self.terms.iter().map(|n| format!("energy.{n}")));
        names.extend(self.outputs.iter().map(|n| format!("output.{n}")));
        let quoted: Vec<String> = names.iter().map(|n| quote(n)).collect();
        quoted.join(",") + "\n"
    }
    fn len(&self) -> usize {
        1 + self.nq + self.nv + 3 + if self.momentum { 6 } else { 0 } + self.terms.len() + self.outputs.len()
    }
    fn line(&self, row: &Row, line: &mut String) {
        line.clear();
        let momentum = if self.momentum { &row.momentum[..] } else { &[] };
        let numbers = std::iter::once(&row.t)
            .chain(&row.q)
            .chain(&row.v)
            .chain(&row.energy)
            .chain(momentum)
            .chain(&row.terms)
            .chain(&row.outputs);
        for (i, x) in numbers.enumerate() {
            if i > 0 {
                line.push(',');
            }
            // Writing to a String cannot fail.
            let _ = write!(line, "{x:?}");
        }
        line.push('\n');
    }
    fn parse(&self, line: &str) -> Option<Row> {
        let numbers: Vec<f64> = line.split(',').map(|w| w.parse().ok()).collect::<Option<_>>()?;
        if numbers.len() != self.len() {
            return None;
        }
        let mut rest = numbers.into_iter();
        let mut take = |n: usize| rest.by_ref().take(n).collect::<Vec<f64>>();
        let t = take(1)[0];
        let (q, v, energy) = (take(self.nq), take(self.nv), take(3));
        let momentum = if self.momentum { take(6) } else { vec![0.0; 6] };
        let terms = take(self.terms.len());
        let outputs = take(self.outputs.len());
        Some(Row {
            t,
            q,
            v,
            energy: energy.try_into().ok()?,
            momentum: momentum.try_into().ok()?,
            outputs,
            terms,
        })
    }
}

/// A CSV field.
fn quote(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", name.replace('"', "\"\""))
    } else {
        name.into()
    }
}

fn component_names(
    model: &Model,
    suffixes: fn(&JointKind) -> &'static [&'static str],
    len: impl Fn(usize) -> usize,
) -> Vec<String> {
    let mut names = Vec::new();
    for k in model.moving_joints() {
        let joint = &model.joints()[k];
        if len(k) == 1 {
            names.push(joint.name.clone());
        } else {
            names.extend(suffixes(&joint.kind).iter().map(|s| format!("{}.{s}", joint.name)));
        }
    }
    names.extend(model.mode_names());
    names
}

fn position_suffixes(kind: &JointKind) -> &'static [&'static str] {
    match kind {
        JointKind::Cylindrical { .. } => &["angle", "displacement"],
        JointKind::Universal { .. } => &["angle1", "angle2"],
        JointKind::Planar { .. } => &["x", "y", "angle"],
        JointKind::Translation => &["x", "y", "z"],
        JointKind::Spherical => &["qx", "qy", "qz", "qw"],
        _ => &["x", "y", "z", "qx", "qy", "qz", "qw"],
    }
}

fn velocity_suffixes(kind: &JointKind) -> &'static [&'static str] {
    match kind {
        JointKind::Cylindrical { .. } => &["rate", "speed"],
        JointKind::Universal { .. } => &["rate1", "rate2"],
        JointKind::Planar { .. } => &["wz", "vx", "vy"],
        JointKind::Translation => &["vx", "vy", "vz"],
        JointKind::Spherical => &["wx", "wy", "wz"],
        _ => &["wx", "wy", "wz", "vx", "vy", "vz"],
    }
}

/// A trajectory being written.
pub struct TableWriter {
    path: PathBuf,
    columns: Columns,
    file: BufWriter<File>,
    /// Bytes written, the header included.
    position: u64,
    line: String,
}

impl TableWriter {
    /// A new file with its header; where one exists from before a kill, it is written over in place.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn create(path: &Path, columns: Columns) -> Result<Self, SimulateError> {
        let header = columns.header();
        let mut table = Self::open(path, columns, 0)?;
        table.write(header.as_bytes())?;
        Ok(table)
    }
    /// Continues behind the first `position` bytes.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn open(path: &Path, columns: Columns, position: u64) -> Result<Self, SimulateError> {
        let failed = |e| SimulateError::file(path, e);
        let mut file =
            OpenOptions::new().write(true).create(true).truncate(false).open(path).map_err(failed)?;
        file.seek(SeekFrom::Start(position)).map_err(failed)?;
        Ok(TableWriter {
            path: path.into(),
            columns,
            file: BufWriter::new(file),
            position,
            line: String::new(),
        })
    }
    fn write(&mut self, bytes: &[u8]) -> Result<(), SimulateError> {
        self.file.write_all(bytes).map_err(|e| SimulateError::file(&self.path, e))?;
        self.position += bytes.len() as u64;
        Ok(())
    }
    /// Adds a row.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn row(&mut self, row: &Row) -> Result<(), SimulateError> {
        let mut line = std::mem::take(&mut self.line);
        self.columns.line(row, &mut line);
        let written = self.write(line.as_bytes());
        self.line = line;
        written
    }
    /// Puts everything on the disk; the number of bytes that are sure.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn sync(&mut self) -> Result<u64, SimulateError> {
        let failed = |e| SimulateError::file(&self.path, e);
        self.file.flush().map_err(failed)?;
        self.file.get_ref().sync_data().map_err(failed)?;
        Ok(self.position)
    }
    /// Cuts off what an earlier attempt wrote behind the end.
    ///
    /// # Errors
    /// [`SimulateError::File`].
    pub fn finish(&mut self) -> Result<(), SimulateError> {
        let position = self.sync()?;
        self.file.get_ref().set_len(position).map_err(|e| SimulateError::file(&self.path, e))
    }
}

/// Rows of a trajectory, up to the first `most`; an incomplete last line is left out.
///
/// # Errors
/// [`SimulateError::File`] if the file cannot be read, or a line is not one of this run.
pub fn read_rows(path: &Path, columns: &Columns, most: u64) -> Result<Vec<Row>, SimulateError> {
    let failed = |e| SimulateError::file(path, e);
    let mut reader = BufReader::new(File::open(path).map_err(failed)?);
    let mut line = String::new();
    reader.read_line(&mut line).map_err(failed)?;
    let invalid = |n: usize, what: &str| {
        let text = format!("line {n}: {what}; the file has been changed since the run wrote it");
        SimulateError::file(path, std::io::Error::new(std::io::ErrorKind::InvalidData, text))
    };
    if line != columns.header() {
        return Err(invalid(1, "not the header of this run"));
    }
    let mut rows = Vec::new();
    while (rows.len() as u64) < most {
        line.clear();
        reader.read_line(&mut line).map_err(failed)?;
        let Some(text) = line.strip_suffix('\n') else { break };
        let number = rows.len() + 2;
        rows.push(columns.parse(text).ok_or_else(|| invalid(number, "not a row of this run"))?);
    }
    Ok(rows)
}
