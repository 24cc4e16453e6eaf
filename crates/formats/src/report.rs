//! What a reader did with a file: what it used, approximated and ignored, and what is wrong with it.

use std::collections::HashMap;
use std::fmt;

/// Something that was used, approximated or ignored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// Line in the source, from 1, where there is one.
    pub line: Option<u32>,
    /// Where, by the user's name: "link `arm`".
    pub place: String,
    /// What: "visual geometry".
    pub what: String,
}

/// Something that is wrong, or that probably is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// Line in the source, from 1, where there is one.
    pub line: Option<u32>,
    /// Where, by the user's name: "joint `elbow`".
    pub place: String,
    /// What was found.
    pub found: String,
    /// What is required.
    pub required: String,
    /// What to do.
    pub remedy: String,
}

/// Everything a reader has to say about one source.
///
/// [`fmt::Display`] prints it for people: errors and warnings with file and line, then what was used, approximated and
/// ignored. Entries that differ only in their place are printed once, with their number; of more than a hundred different
/// ones of a list the first hundred.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// The file's name as the user gave it.
    pub source: String,
    /// What was used that the user may not expect, and a summary of the rest.
    pub used: Vec<Note>,
    /// What was replaced by something simpler.
    pub approximated: Vec<Note>,
    /// What had no effect.
    pub ignored: Vec<Note>,
    /// What is probably wrong; a strict reader refuses it.
    pub warnings: Vec<Problem>,
    /// What makes the source unusable.
    pub errors: Vec<Problem>,
}

/// A value read from a source, where there were no errors, and the report, always.
#[derive(Clone, Debug)]
pub struct Loaded<T> {
    /// The value; `None` exactly if the report has errors.
    pub value: Option<T>,
    /// What was used, approximated and ignored, and every problem.
    pub report: Report,
}

impl<T> Loaded<T> {
    /// The value with its report.
    ///
    /// # Errors
    /// The report, if it has errors, or warnings where `strict`.
    pub fn into_result(self, strict: bool) -> Result<(T, Report), Box<Report>> {
        match self.value {
            Some(value) if self.report.is_ok(strict) => Ok((value, self.report)),
            _ => Err(Box::new(self.report)),
        }
    }
}

impl Report {
    /// An empty report on a source.
    pub fn new(source: impl Into<String>) -> Self {
        Report { source: source.into(), ..Default::default() }
    }
    /// True if there are no errors and, where `strict`, no warnings.
    pub fn is_ok(&self, strict: bool) -> bool {
        self.errors.is_empty() && (!strict || self.warnings.is_empty())
    }
}

impl Note {
    /// A note.
    pub fn new(line: Option<u32>, place: impl Into<String>, what: impl Into<String>) -> Self {
        Note { line, place: place.into(), what: what.into() }
    }
}

impl Problem {
    /// A problem.
    pub fn new(
        line: Option<u32>,
        place: impl Into<String>,
        found: impl Into<String>,
        required: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Problem {
            line,
            place: place.into(),
            found: found.into(),
            required: required.into(),
            remedy: remedy.into(),
        }
    }
}

/// Entries that are printed as one: the first of them, and the number of all.
struct Group<'a, T> {
    first: &'a T,
    count: usize,
}

/// Merges entries with equal keys, in the order of their first ones.
fn groups<'a, T, K: std::hash::Hash + Eq>(entries: &'a [T], key: impl Fn(&'a T) -> K) -> Vec<Group<'a, T>> {
    let mut position = HashMap::new();
    let mut found: Vec<Group<'a, T>> = Vec::new();
    for entry in entries {
        let at = *position.entry(key(entry)).or_insert(found.len());
        match found.get_mut(at) {
            Some(group) => group.count += 1,
            None => found.push(Group { first: entry, count: 1 }),
        }
    }
    found
}

/// The kind of thing a place is: "link" of "link `arm`".
fn kind(place: &str) -> &str {
    place.split([' ', '`']).next().unwrap_or_default()
}

/// "arm.urdf:12", or the name alone.
fn position(source: &str, line: Option<u32>) -> String {
    match line {
        Some(line) => format!("{source}:{line}"),
        None => source.into(),
    }
}

fn count(n: usize, word: &str) -> String {
    format!("{n} {word}{}", if n == 1 { "" } else { "s" })
}

/// Most groups of a list that are printed.
const MOST_PRINTED: usize = 100;

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (severity, problems) in [("error", &self.errors), ("warning", &self.warnings)] {
            let groups = groups(problems, |p| (kind(&p.place), &p.found, &p.required, &p.remedy));
            for group in groups.iter().take(MOST_PRINTED) {
                let p = group.first;
                writeln!(f, "{severity}: {}: {}", p.place, p.found)?;
                write!(f, "  --> {}", position(&self.source, p.line))?;
                if group.count > 1 {
                    write!(f, " (and {} like it)", count(group.count - 1, kind(&p.place)))?;
                }
                writeln!(f, "\n   = required: {}\n   = to do: {}", p.required, p.remedy)?;
            }
            if groups.len() > MOST_PRINTED {
                writeln!(
                    f,
                    "{severity}: {} more of other kinds are not printed",
                    groups.len() - MOST_PRINTED
                )?;
            }
        }
        writeln!(
            f,
            "{}: {}, {}",
            self.source,
            count(self.errors.len(), "error"),
            count(self.warnings.len(), "warning")
        )?;
        for (title, notes) in
            [("used", &self.used), ("approximated", &self.approximated), ("ignored", &self.ignored)]
        {
            if notes.is_empty() {
                continue;
            }
            writeln!(f, "{title}:")?;
            let groups = groups(notes, |n| (kind(&n.place), &n.what));
            for group in groups.iter().take(MOST_PRINTED) {
                let n = group.first;
                let line = n.line.map(|line| format!("line {line}"));
                match (group.count, line) {
                    (1, None) => writeln!(f, "  {}: {}", n.place, n.what)?,
                    (1, Some(line)) => writeln!(f, "  {}: {} ({line})", n.place, n.what)?,
                    (many, None) => writeln!(f, "  {}: {}", count(many, kind(&n.place)), n.what)?,
                    (many, Some(line)) => {
                        writeln!(f, "  {}: {} (first: {line})", count(many, kind(&n.place)), n.what)?
                    }
                }
            }
            if groups.len() > MOST_PRINTED {
                writeln!(f, "  {} more are not printed", groups.len() - MOST_PRINTED)?;
            }
        }
        Ok(())
    }
}

impl std::error::Error for Report {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_entries_are_printed_once_with_their_number() {
        let mut report = Report::new("arm.urdf");
        report.ignored.push(Note::new(Some(3), "link `a`", "visual geometry"));
        report.ignored.push(Note::new(Some(5), "joint `j`", "calibration"));
        report.ignored.push(Note::new(Some(9), "link `b`", "visual geometry"));
        for (line, name) in [(4, "j"), (7, "k")] {
            let place = format!("joint `{name}`");
            report.warnings.push(Problem::new(Some(line), place, "no limit", "a limit", "add it"));
        }
        assert!(report.is_ok(false) && !report.is_ok(true));
        let expected = "warning: joint `j`: no limit\n  --> arm.urdf:4 (and 1 joint like it)\n   = required: a limit\n   \
                        = to do: add it\narm.urdf: 0 errors, 2 warnings\nignored:\n  2 links: visual geometry (first: \
                        line 3)\n  joint `j`: calibration (line 5)\n";
        assert_eq!(report.to_string(), expected);
    }

    #[test]
    fn many_different_entries_are_cut() {
        let mut report = Report::new("arm.urdf");
        for i in 0..1000 {
            report.errors.push(Problem::new(None, "link `a`", format!("{i}"), "less", "change it"));
            report.used.push(Note::new(None, "link `a`", format!("{i}")));
        }
        let text = report.to_string();
        assert!(
            text.contains("error: 900 more of other kinds") && text.contains("  900 more are not printed")
        );
        assert!(text.contains("arm.urdf: 1000 errors") && !text.contains("link `a`: 100\n"));
    }
}
