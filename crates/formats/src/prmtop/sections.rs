//! Sections of a prmtop file: fields of fixed width under a name.

use crate::report::{Problem, Report};
use crate::suggest::quote;
use std::collections::BTreeMap;

/// A section.
struct Section<'a> {
    /// Line of its name.
    line: u32,
    /// Columns of a field.
    width: usize,
    /// Blank fields are words; numbers are never blank.
    is_text: bool,
    /// Fields on a line.
    per_line: usize,
    /// Its lines and their numbers.
    lines: Vec<(u32, &'a str)>,
}

/// All sections of a file, and what is wrong with them.
pub(super) struct Sections<'a> {
    sections: BTreeMap<&'a str, Section<'a>>,
    pub report: Report,
}

/// A field and its line.
type Field<'a> = (u32, &'a str);

impl<'a> Sections<'a> {
    /// Splits a text.
    pub fn new(text: &'a str, source: &str) -> Self {
        let mut sections: BTreeMap<&'a str, Section<'a>> = BTreeMap::new();
        let mut report = Report::new(source);
        let mut name = None;
        for (number, line) in (1u32..).zip(text.lines()) {
            let mut error = |found: String, required: &str, remedy: &str| {
                report.errors.push(Problem::new(Some(number), "file", found, required, remedy));
            };
            if let Some(rest) = line.strip_prefix("%FLAG") {
                let flag = rest.trim();
                let section =
                    Section { line: number, width: 0, is_text: false, per_line: 0, lines: Vec::new() };
                if sections.insert(flag, section).is_some() {
                    error(format!("a second section {}", quote(flag)), "each section once", "remove one");
                }
                name = Some(flag);
            } else if let Some(rest) = line.strip_prefix("%FORMAT") {
                let format = parse_format(rest);
                match (name.and_then(|name| sections.get_mut(name)), format) {
                    (Some(section), Some((per_line, is_text, width))) => {
                        (section.per_line, section.is_text, section.width) = (per_line, is_text, width);
                    }
                    (None, _) => {
                        error("a format without a section".into(), "%FLAG before %FORMAT", "correct it")
                    }
                    (_, None) => {
                        let required = "a format such as (10I8), (5E16.8) or (20a4)";
                        error(format!("format {}", quote(rest.trim())), required, "correct it");
                    }
                }
            } else if !line.starts_with('%')
                && !line.trim().is_empty()
                && let Some(section) = name.and_then(|name| sections.get_mut(name))
            {
                section.lines.push((number, line));
            }
        }
        if !sections.contains_key("POINTERS") {
            let found = match text.trim_start().starts_with("%VERSION") {
                true => "a file without the section POINTERS",
                false => "a file that does not begin with %VERSION",
            };
            let remedy = "give the prmtop file first and the inpcrd file second; files from before AMBER 7 have to be \
                          written anew";
            report.errors.push(Problem::new(
                Some(1),
                "file",
                found,
                "a prmtop file of AMBER 7 or later",
                remedy,
            ));
        }
        Sections { sections, report }
    }
    /// True if there is such a section.
    pub fn has(&self, name: &str) -> bool {
        self.sections.contains_key(name)
    }
    /// Line of a section.
    pub fn line(&self, name: &str) -> Option<u32> {
        self.sections.get(name).map(|s| s.line)
    }
    /// An error in a section.
    pub fn error(&mut self, line: Option<u32>, name: &str, found: String, required: &str, remedy: &str) {
        let place = format!("section `{name}`");
        self.report.errors.push(Problem::new(line, place, found, required, remedy));
    }
    /// All fields of a section; `count`: how many there must be, `None` for any number.
    fn fields(&mut self, name: &str, count: Option<usize>) -> Option<Vec<Field<'a>>> {
        let Some(section) = self.sections.get(name) else {
            if count == Some(0) {
                return Some(Vec::new());
            }
            let required = format!("a section `{name}`");
            self.error(None, name, "no such section".into(), &required, "write the file anew");
            return None;
        };
        let (line, width, per_line, is_text) =
            (section.line, section.width, section.per_line, section.is_text);
        if width == 0 {
            self.error(Some(line), name, "no format".into(), "%FORMAT after %FLAG", "write the file anew");
            return None;
        }
        let mut fields = Vec::new();
        let mut not_ascii = None;
        for (number, text) in &section.lines {
            if !text.is_ascii() {
                not_ascii = Some(*number);
                continue;
            }
            for at in (0..text.len().min(width * per_line)).step_by(width) {
                let field = text[at..(at + width).min(text.len())].trim();
                // What follows the last field of a line is blank.
                if !field.is_empty() || is_text && text.len() >= at + width {
                    fields.push((*number, field));
                }
            }
        }
        if let Some(number) = not_ascii {
            self.error(Some(number), name, "a character that is not ASCII".into(), "ASCII", "remove it");
            return None;
        }
        if let Some(count) = count
            && fields.len() < count
        {
            let required = format!("{count}, as POINTERS says");
            self.error(
                Some(line),
                name,
                format!("{} fields", fields.len()),
                &required,
                "write the file anew",
            );
            return None;
        }
        fields.truncate(count.unwrap_or(usize::MAX));
        Some(fields)
    }
    fn parsed<T>(
        &mut self,
        name: &str,
        count: Option<usize>,
        required: &str,
        parse: impl Fn(&str) -> Option<T>,
    ) -> Option<Vec<T>> {
        let fields = self.fields(name, count)?;
        let mut values = Vec::with_capacity(fields.len());
        for (i, (line, text)) in fields.into_iter().enumerate() {
            match parse(text) {
                Some(value) => values.push(value),
                None => {
                    let found = format!("field {} is {}", i + 1, quote(text));
                    self.error(Some(line), name, found, required, "correct it");
                    return None;
                }
            }
        }
        Some(values)
    }
    /// Real numbers.
    pub fn reals(&mut self, name: &str, count: usize) -> Option<Vec<f64>> {
        let parse = |text: &str| text.replace(['D', 'd'], "E").parse().ok().filter(|x: &f64| x.is_finite());
        self.parsed(name, Some(count), "a finite number", parse)
    }
    /// Whole numbers; `count`: `None` for as many as there are.
    pub fn integers(&mut self, name: &str, count: Option<usize>) -> Option<Vec<i64>> {
        self.parsed(name, count, "a whole number", |text| text.parse::<i32>().ok().map(i64::from))
    }
    /// Words.
    pub fn words(&mut self, name: &str, count: usize) -> Option<Vec<String>> {
        self.parsed(name, Some(count), "a word", |text| Some(text.to_string()))
    }
}

/// Fields of a line, whether they are words, and columns of a field: `(5E16.8)` is (5, false, 16).
fn parse_format(text: &str) -> Option<(usize, bool, usize)> {
    // Groups may have parentheses of their own: (8(F9.5)).
    let inner = text.trim().strip_prefix('(')?.replace(['(', ')', ' '], "");
    let kind = inner.find(|c: char| c.is_ascii_alphabetic())?;
    let digits = |text: &str| text.chars().take_while(char::is_ascii_digit).collect::<String>();
    let per_line = if kind == 0 { 1 } else { inner.get(..kind)?.trim().parse().ok()? };
    let width = digits(inner.get(kind + 1..)?).parse().ok()?;
    let is_text = inner.get(kind..)?.starts_with(['a', 'A']);
    ((1..=1000).contains(&per_line) && (1..=1000).contains(&width)).then_some((per_line, is_text, width))
}
