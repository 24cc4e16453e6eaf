//! Text files of bounded size.

use crate::report::Problem;
use std::io::Read;
use std::path::Path;

/// Largest file that is read, bytes.
const LARGEST_FILE: u64 = 256 << 20;

/// The text of a file; `what` it should be: "a URDF".
///
/// # Errors
/// A file that cannot be read, is too large or is not UTF-8.
pub(crate) fn read_text(path: &Path, what: &str) -> Result<String, Problem> {
    let cannot = |error: std::io::Error| {
        Problem::new(None, "file", error.to_string(), "a readable file", "check the path and its permissions")
    };
    let file = std::fs::File::open(path).map_err(cannot)?;
    let mut bytes = Vec::new();
    file.take(LARGEST_FILE + 1).read_to_end(&mut bytes).map_err(cannot)?;
    if bytes.len() as u64 > LARGEST_FILE {
        let required = format!("at most {LARGEST_FILE} bytes");
        return Err(Problem::new(
            None,
            "file",
            "a larger file",
            required,
            format!("check that it is {what}"),
        ));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = 1 + error.as_bytes()[..at].iter().filter(|b| **b == b'\n').count();
        let (found, to_do) = match error.as_bytes() {
            [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => ("text in UTF-16".into(), "convert the file to UTF-8"),
            [0x1f, 0x8b, ..] => ("a gzipped file".into(), "gunzip it first"),
            _ => (format!("byte {at} is not UTF-8"), "convert the file to UTF-8"),
        };
        Problem::new(u32::try_from(line).ok(), "file", found, "text in UTF-8", to_do)
    })
}
