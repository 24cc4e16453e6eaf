//! Matrix Market: matrices of finite element programs.
//!
//! | part | here |
//! |---|---|
//! | `%%MatrixMarket matrix FORMAT FIELD SYMMETRY` | FORMAT `coordinate` or `array`, FIELD `real`, `double` or `integer`, SYMMETRY `general` or `symmetric` |
//! | lines that begin with % | without effect |
//! | `rows columns entries`; of an array `rows columns` | |
//! | `row column value`, from 1 | coordinate; entries of a symmetric matrix are of one triangle |
//! | `value` | array, column after column; of a symmetric matrix the lower triangle |
//!
//! Numbers may have Fortran's exponent D. Anything else is an error with its line.

use crate::file::read_text;
use crate::report::{Loaded, Problem, Report};
use phipsi_model::{MatrixError, SymmetricMatrix};
use std::path::Path;

/// Most problems that are reported of a file.
const MOST_PROBLEMS: usize = 20;

/// A matrix as a file has it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MarketMatrix {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Row and column, from 0, and value; of a symmetric matrix one triangle.
    pub entries: Vec<(usize, usize, f64)>,
    /// True if the file says that it is symmetric.
    pub symmetric: bool,
}

impl MarketMatrix {
    /// A symmetric matrix.
    ///
    /// # Errors
    /// [`MatrixError`]: not square, or not symmetric.
    pub fn to_symmetric(&self) -> Result<SymmetricMatrix, MatrixError> {
        let (size, entries) = (self.rows, self.entries.iter().copied());
        if self.symmetric {
            SymmetricMatrix::from_triangle(size, entries)
        } else {
            SymmetricMatrix::from_entries(size, entries)
        }
    }
    /// All numbers, column after column. `None` if there are more than 2²⁸.
    pub fn to_columns(&self) -> Option<Vec<f64>> {
        let count = self.rows.checked_mul(self.columns).filter(|n| *n <= 1 << 28)?;
        let mut all = vec![0.0; count];
        for &(i, j, value) in &self.entries {
            all[j * self.rows + i] += value;
            if self.symmetric && i != j {
                all[i * self.rows + j] += value;
            }
        }
        Some(all)
    }
}

/// Reads a Matrix Market file.
pub fn read_matrix_market_file(path: &Path) -> Loaded<MarketMatrix> {
    let source = path.display().to_string();
    match read_text(path, "a Matrix Market file") {
        Ok(text) => read_matrix_market(&text, &source),
        Err(problem) => {
            let mut report = Report::new(source);
            report.errors.push(problem);
            Loaded { value: None, report }
        }
    }
}

/// Reads the text of a Matrix Market file; `source` is its name in the report.
///
/// # Example
/// ```
/// use phipsi_formats::matrix_market::read_matrix_market;
/// let text = "%%MatrixMarket matrix coordinate real symmetric\n2 2 3\n1 1 2.0\n2 1 -1.0\n2 2 1.0\n";
/// let (matrix, _) = read_matrix_market(text, "k.mtx").into_result(true)?;
/// assert_eq!(matrix.to_columns(), Some(vec![2.0, -1.0, -1.0, 1.0]));
/// let wrong = read_matrix_market(&text.replace("2 1 -1.0", "2 3 -1.0"), "k.mtx");
/// assert_eq!(wrong.report.errors[0].line, Some(4));
/// # Ok::<(), Box<phipsi_formats::Report>>(())
/// ```
pub fn read_matrix_market(text: &str, source: &str) -> Loaded<MarketMatrix> {
    let mut report = Report::new(source);
    let value = read(text, &mut report);
    Loaded { value: value.filter(|_| report.errors.is_empty()), report }
}

fn problem(line: usize, found: impl Into<String>, required: &str, remedy: &str) -> Problem {
    Problem::new(u32::try_from(line).ok(), "matrix", found, required, remedy)
}

fn read(text: &str, report: &mut Report) -> Option<MarketMatrix> {
    let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    let (_, header) = lines.next().unwrap_or((1, ""));
    let Some((array, symmetric)) = read_header(header) else {
        let required = "`%%MatrixMarket matrix coordinate real symmetric`, or array, integer, general";
        report.errors.push(problem(1, shorten(header), required, "write the matrix in this format"));
        return None;
    };
    let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('%'));
    let required = if array { "two whole numbers" } else { "three whole numbers" };
    let (number, sizes) = lines.next().unwrap_or((2, ""));
    let counts: Vec<usize> = sizes.split_whitespace().map_while(|x| x.parse().ok()).collect();
    let (rows, columns, count) = match counts[..] {
        [rows, columns, count] if !array && sizes.split_whitespace().count() == 3 => (rows, columns, count),
        [rows, columns] if array && sizes.split_whitespace().count() == 2 => {
            let all = if symmetric { triangle(rows) } else { rows.checked_mul(columns) };
            (rows, columns, all.unwrap_or(usize::MAX))
        }
        _ => {
            report.errors.push(problem(
                number,
                shorten(sizes),
                required,
                "write the sizes of the matrix here",
            ));
            return None;
        }
    };
    if symmetric && rows != columns {
        let found = format!("a symmetric matrix of {rows} rows and {columns} columns");
        report.errors.push(problem(number, found, "equal numbers", "correct the sizes"));
        return None;
    }
    let mut entries = Vec::new();
    let mut place = (0, 0);
    let mut last = number;
    for (number, line) in lines {
        last = number;
        if report.errors.len() >= MOST_PROBLEMS {
            return None;
        }
        let mut words = line.split_whitespace();
        let at = if array {
            let at = place;
            place.0 += 1;
            if place.0 >= rows {
                let column = place.1 + 1;
                place = (if symmetric { column } else { 0 }, column);
            }
            Some(at)
        } else {
            let mut index = || words.next()?.parse::<usize>().ok()?.checked_sub(1);
            index().zip(index()).filter(|&(i, j)| i < rows && j < columns)
        };
        let value = words.next().and_then(real);
        let (Some((i, j)), Some(value), None) = (at, value, words.next()) else {
            let required = if array {
                "one finite number".to_string()
            } else {
                format!("a row of 1 to {rows}, a column of 1 to {columns}, and a finite number")
            };
            report.errors.push(problem(number, shorten(line), &required, "correct the line"));
            continue;
        };
        if entries.len() >= count {
            let found = format!("more than {count} entries");
            report.errors.push(problem(number, found, "as many as the sizes say", "correct one of them"));
            return None;
        }
        entries.push((i, j, value));
    }
    if entries.len() < count && report.errors.is_empty() {
        let found = format!("{} of {count} entries", entries.len());
        let remedy = "see whether the file was cut off, or correct the sizes";
        report.errors.push(problem(last, found, "as many as the sizes say", remedy));
    }
    Some(MarketMatrix { rows, columns, entries, symmetric })
}

/// Whether the format is an array, and the symmetry.
fn read_header(line: &str) -> Option<(bool, bool)> {
    let words: Vec<String> = line.split_whitespace().map(str::to_ascii_lowercase).collect();
    let [banner, object, format, field, symmetry] = &words[..] else { return None };
    if banner != "%%matrixmarket" || object != "matrix" {
        return None;
    }
    let array = match format.as_str() {
        "coordinate" => false,
        "array" => true,
        _ => return None,
    };
    let symmetric = match symmetry.as_str() {
        "general" => false,
        "symmetric" => true,
        _ => return None,
    };
    matches!(field.as_str(), "real" | "double" | "integer").then_some((array, symmetric))
}

fn triangle(rows: usize) -> Option<usize> {
    Some(rows.checked_mul(rows.checked_add(1)?)? / 2)
}

/// A finite number, with Fortran's D too.
pub(crate) fn real(word: &str) -> Option<f64> {
    let number = word.parse().or_else(|_| word.replace(['d', 'D'], "e").parse());
    number.ok().filter(|x: &f64| x.is_finite())
}

/// A line, cut where it is long.
pub(crate) fn shorten(line: &str) -> String {
    let short: String = line.chars().take(60).collect();
    if short.len() < line.len() { format!("`{short}…`") } else { format!("`{short}`") }
}
