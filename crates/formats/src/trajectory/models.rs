//! Trajectories as MODELs of a PDB file.

use super::{Frame, TrajectoryError, cannot};
use crate::file::read_text;
use crate::pdb::{Pdb, read_pdb};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Reads the models of a file one after the other; a file without MODEL records is one.
pub(super) struct ModelReader {
    path: PathBuf,
    /// Texts of the models that are left, the next one last.
    models: Vec<String>,
    step: i32,
}

impl ModelReader {
    pub fn open(path: &Path) -> Result<Self, TrajectoryError> {
        let text = read_text(path, "a PDB file")
            .map_err(|p| TrajectoryError::new(path, p.found, p.required, p.remedy))?;
        let mut models = vec![String::new()];
        for line in text.lines() {
            if line.starts_with("MODEL ") {
                models.push(String::new());
            } else if ["ATOM", "HETATM", "TER"].iter().any(|record| line.starts_with(record))
                && let Some(model) = models.last_mut()
            {
                model.push_str(line);
                model.push('\n');
            }
        }
        models.retain(|model| !model.is_empty());
        models.reverse();
        Ok(ModelReader { path: path.into(), models, step: 0 })
    }
    pub fn next_frame(&mut self) -> Result<Option<Frame>, TrajectoryError> {
        let Some(text) = self.models.pop() else { return Ok(None) };
        let loaded = read_pdb(&text, &format!("model {}", self.step + 1));
        let Some(pdb) = loaded.value else {
            let found = loaded.report.to_string();
            return Err(TrajectoryError::new(
                &self.path,
                found.trim().to_string(),
                "a PDB file",
                "correct it",
            ));
        };
        let frame = Frame {
            step: self.step,
            time_ps: None,
            positions: pdb.atoms.iter().map(|atom| atom.position).collect(),
        };
        self.step += 1;
        Ok(Some(frame))
    }
}

/// Writes each frame as a model.
pub(super) struct ModelWriter {
    file: BufWriter<File>,
    path: PathBuf,
    names: Pdb,
    models: usize,
}

impl ModelWriter {
    pub fn create(path: &Path, names: Pdb) -> Result<Self, TrajectoryError> {
        let file = BufWriter::new(File::create(path).map_err(|e| cannot(path, e))?);
        Ok(ModelWriter { file, path: path.into(), names, models: 0 })
    }
    pub fn write(&mut self, positions: &[[f64; 3]]) -> Result<(), TrajectoryError> {
        self.models += 1;
        let mut text = format!("MODEL     {:4}\n", self.models % 10_000);
        for (i, (atom, position)) in self.names.atoms.iter().zip(positions).enumerate() {
            let x = position.map(|x| 10.0 * x);
            // Eight columns with three decimals.
            if !x.iter().all(|x| (-999.999..9999.999).contains(x)) {
                let found = format!("position {position:?} nm of atom {i} in frame {}", self.models - 1);
                let required = "at most eight columns in Å: -99.9999 to 999.9999 nm";
                return Err(TrajectoryError::new(&self.path, found, required, "write DCD or XTC"));
            }
            // Names of one-letter elements begin in the second of their four columns.
            let name = match atom.element.len() < 2 && atom.name.len() < 4 {
                true => format!(" {:<3}", atom.name),
                false => format!("{:<4}", atom.name),
            };
            text += &format!(
                "{:<6}{:5} {name:.4} {:>3.4} {:1.1}{:4}{}   {:8.3}{:8.3}{:8.3}  1.00  0.00          {:>2.2}\n",
                if atom.hetero { "HETATM" } else { "ATOM" },
                (i + 1) % 100_000,
                atom.residue_name,
                atom.chain,
                atom.residue_number.rem_euclid(10_000),
                atom.insertion_code,
                x[0],
                x[1],
                x[2],
                atom.element
            );
            let next = self.names.atoms.get(i + 1);
            if next.is_none_or(|next| next.chain != atom.chain) {
                text += "TER\n";
            }
        }
        text += "ENDMDL\n";
        self.file.write_all(text.as_bytes()).map_err(|e| cannot(&self.path, e))
    }
    pub fn finish(mut self) -> Result<(), TrajectoryError> {
        self.file.write_all(b"END\n").and_then(|()| self.file.flush()).map_err(|e| cannot(&self.path, e))
    }
}
