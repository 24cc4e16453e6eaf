//! What a reader did with a file, for Python.

use phipsi::formats;
use pyo3::prelude::*;

/// Something that was used, approximated or ignored.
///
/// ``source``: the file, or None. ``line``: in it, from 1, or None. ``place``: where, by the user's name. ``what``: what it
/// is.
#[pyclass(frozen, get_all, module = "phipsi")]
#[derive(Clone, Debug)]
pub struct Note {
    /// The file, or None.
    pub source: Option<String>,
    /// Line in the file, or None.
    pub line: Option<u32>,
    /// Where: "link `arm`".
    pub place: String,
    /// What: "visual geometry".
    pub what: String,
}

#[pymethods]
impl Note {
    fn __repr__(&self) -> String {
        format!("{}: {}{}", self.place, self.what, in_line(self.line))
    }
}

/// Something that is wrong with a file.
///
/// ``source``: the file, or None. ``line``: in it, from 1, or None. ``place``: where. ``found``, ``required``, ``remedy``:
/// what was found, what is required, what to do.
#[pyclass(frozen, get_all, module = "phipsi")]
#[derive(Clone, Debug)]
pub struct Problem {
    /// The file, or None.
    pub source: Option<String>,
    /// Line in the file, or None.
    pub line: Option<u32>,
    /// Where: "joint `elbow`".
    pub place: String,
    /// What was found.
    pub found: String,
    /// What is required.
    pub required: String,
    /// What to do.
    pub remedy: String,
}

#[pymethods]
impl Problem {
    fn __repr__(&self) -> String {
        let Problem { line, place, found, required, remedy, .. } = self;
        format!("{place}: {found}{}; required: {required}; {remedy}", in_line(*line))
    }
}

fn in_line(line: Option<u32>) -> String {
    line.map(|l| format!(" (line {l})")).unwrap_or_default()
}

/// Everything a reader has to say about a file, or about files that belong together; ``print(report)`` shows it for people.
///
/// ``source``: the file; several are separated by commas. ``used``, ``approximated``, ``ignored``: lists of Note.
/// ``warnings``, ``errors``: lists of Problem.
///
/// Example
/// -------
/// >>> m = phipsi.Model.from_urdf("arm.urdf")
/// >>> m.report.warnings
/// []
/// >>> m.report.ignored[0].place, m.report.ignored[0].line
/// ('link `upper`', 5)
#[pyclass(frozen, module = "phipsi")]
#[derive(Clone, Debug)]
pub struct Report {
    /// The file's name as given.
    #[pyo3(get)]
    pub source: String,
    /// What was used that one may not expect, and a summary of the rest.
    #[pyo3(get)]
    pub used: Vec<Note>,
    /// What was replaced by something simpler.
    #[pyo3(get)]
    pub approximated: Vec<Note>,
    /// What had no effect.
    #[pyo3(get)]
    pub ignored: Vec<Note>,
    /// What is probably wrong; strict = True refuses it.
    #[pyo3(get)]
    pub warnings: Vec<Problem>,
    /// What makes the file unusable.
    #[pyo3(get)]
    pub errors: Vec<Problem>,
    text: String,
}

#[pymethods]
impl Report {
    fn __str__(&self) -> &str {
        self.text()
    }
    fn __repr__(&self) -> String {
        let (errors, warnings) = (self.errors.len(), self.warnings.len());
        format!("<phipsi.Report of {}: {errors} errors, {warnings} warnings>", self.source)
    }
}

impl Report {
    /// From the reader's own.
    pub fn new(report: &formats::Report) -> Self {
        let source = || Some(report.source.clone());
        let note = |n: &formats::Note| Note {
            source: source(),
            line: n.line,
            place: n.place.clone(),
            what: n.what.clone(),
        };
        let problem = |p: &formats::Problem| Problem {
            source: source(),
            line: p.line,
            place: p.place.clone(),
            found: p.found.clone(),
            required: p.required.clone(),
            remedy: p.remedy.clone(),
        };
        Report {
            source: report.source.clone(),
            used: report.used.iter().map(note).collect(),
            approximated: report.approximated.iter().map(note).collect(),
            ignored: report.ignored.iter().map(note).collect(),
            warnings: report.warnings.iter().map(problem).collect(),
            errors: report.errors.iter().map(problem).collect(),
            text: report.to_string(),
        }
    }
    /// Those of files that belong together as one.
    pub fn joined(reports: &[formats::Report]) -> Self {
        let mut reports = reports.iter().map(Report::new);
        let first = reports.next().unwrap_or_else(|| Report::new(&formats::Report::default()));
        reports.fold(first, |mut all, next| {
            all.source = format!("{}, {}", all.source, next.source);
            all.used.extend(next.used);
            all.approximated.extend(next.approximated);
            all.ignored.extend(next.ignored);
            all.warnings.extend(next.warnings);
            all.errors.extend(next.errors);
            all.text += &next.text;
            all
        })
    }
    /// For people.
    pub fn text(&self) -> &str {
        self.text.trim_end()
    }
}
