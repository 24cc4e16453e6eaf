//! `trajectory.npz`: the recorded instants as NumPy arrays.

use super::table::Columns;
use crate::error::SimulateError;
use crate::record::Row;
use npyz::WriterBuilder;
use std::io::{BufWriter, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;

/// Writes t (n), q (n, nq), v (n, nv), energy (n, 3: kinetic, potential, work), momentum (n, 6: angular, linear), each
/// force-field term (n) and each output (n).
///
/// # Errors
/// [`SimulateError::File`].
pub fn write(path: &Path, columns: &Columns, rows: &[Row]) -> Result<(), SimulateError> {
    let failed = |e: std::io::Error| SimulateError::file(path, e);
    let folder = path.parent().unwrap_or(Path::new("."));
    let scratch = tempfile::NamedTempFile::new_in(folder).map_err(failed)?;
    let mut archive = zip::ZipWriter::new(BufWriter::new(scratch.as_file()));
    let n = rows.len() as u64;
    let mut array = |name: &str, width: Option<usize>, values: &mut dyn Iterator<Item = f64>| {
        let options =
            SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored).large_file(true);
        archive.start_file(format!("{name}.npy"), options)?;
        let shape: Vec<u64> = std::iter::once(n).chain(width.map(|w| w as u64)).collect();
        let mut writer =
            npyz::WriteOptions::new().default_dtype().shape(&shape).writer(&mut archive).begin_nd()?;
        writer.extend(values)?;
        writer.finish()
    };
    let mut write = || -> std::io::Result<()> {
        array("t", None, &mut rows.iter().map(|r| r.t))?;
        array("q", Some(columns.q.len()), &mut rows.iter().flat_map(|r| r.q.iter().copied()))?;
        array("v", Some(columns.v.len()), &mut rows.iter().flat_map(|r| r.v.iter().copied()))?;
        array("energy", Some(3), &mut rows.iter().flat_map(|r| r.energy))?;
        array("momentum", Some(6), &mut rows.iter().flat_map(|r| r.momentum))?;
        // A slash would make a folder inside the archive.
        let safe = |name: &str| name.replace(['/', '\\'], "_");
        for (i, name) in columns.terms.iter().enumerate() {
            array(&format!("energy.{}", safe(name)), None, &mut rows.iter().map(|r| r.terms[i]))?;
        }
        for (i, name) in columns.outputs.iter().enumerate() {
            array(&format!("output.{}", safe(name)), None, &mut rows.iter().map(|r| r.outputs[i]))?;
        }
        Ok(())
    };
    write().map_err(failed)?;
    archive.finish().map_err(|e| failed(e.into()))?.flush().map_err(failed)?;
    super::checkpoint::publish(scratch, path)
}
