//! Attributes, numbers and child elements, each with its line and place in what is reported.

use crate::report::{Note, Problem, Report};
use crate::suggest::{quote, remedy};
use crate::xml::Lines;
use phipsi_model::{Placement, Severity};
use roxmltree::{Attribute, Node};

/// Longest name of a link or joint, bytes: names are repeated in what is reported on their parts.
const LONGEST_NAME: usize = 1000;
/// Most entries of each list of the report.
const MOST_ENTRIES: usize = 200_000;
/// Angles beyond this are taken for degrees by mistake: a full turn, with some room for rounding.
const LARGEST_ANGLE: f64 = 6.5;

/// What to do about the language of templates.
const EXPAND: &str = "expand the file with the program xacro first";
/// Elements of that language, in which they may stand without its prefix.
const XACRO_WORDS: [&str; 7] = ["include", "macro", "property", "if", "unless", "arg", "insert_block"];

/// An element and its place for the report: "link `arm`".
#[derive(Clone)]
pub(super) struct Element<'a> {
    pub node: Node<'a, 'a>,
    pub place: String,
    pub line: Option<u32>,
}

impl<'a> Element<'a> {
    /// The name of the element.
    pub fn tag(&self) -> &'a str {
        self.node.tag_name().name()
    }
}

/// Collects the report while elements are read.
pub(super) struct Reader {
    pub report: Report,
    lines: Lines,
}

impl Reader {
    pub fn new(text: &str, report: Report) -> Self {
        Reader { report, lines: Lines::new(text) }
    }
    /// An element at a place.
    pub fn element<'a>(&self, node: Node<'a, 'a>, place: impl Into<String>) -> Element<'a> {
        Element { node, place: place.into(), line: self.lines.of(node) }
    }
    pub fn error(&mut self, at: &Element<'_>, found: impl Into<String>, required: &str, remedy: &str) {
        self.problem(Severity::Error, Problem::new(at.line, &at.place, found, required, remedy));
    }
    pub fn warning(&mut self, at: &Element<'_>, found: impl Into<String>, required: &str, remedy: &str) {
        self.problem(Severity::Warning, Problem::new(at.line, &at.place, found, required, remedy));
    }
    /// Adds a problem, as long as the report has room.
    pub fn problem(&mut self, severity: Severity, problem: Problem) {
        let (list, word) = match severity {
            Severity::Error => (&mut self.report.errors, "errors"),
            Severity::Warning => (&mut self.report.warnings, "warnings"),
        };
        if list.len() < MOST_ENTRIES {
            list.push(problem);
        } else if list.len() == MOST_ENTRIES {
            let found = format!("more than {MOST_ENTRIES} {word}, of which the rest is not listed");
            list.push(Problem::new(problem.line, "report", found, "fewer", "correct these first"));
        }
    }
    pub fn used(&mut self, at: &Element<'_>, what: impl Into<String>) {
        note(&mut self.report.used, at.line, &at.place, what);
    }
    pub fn approximated(&mut self, at: &Element<'_>, what: impl Into<String>) {
        note(&mut self.report.approximated, at.line, &at.place, what);
    }
    pub fn ignored(&mut self, at: &Element<'_>, what: impl Into<String>) {
        note(&mut self.report.ignored, at.line, &at.place, what);
    }

    /// Notes every attribute that is not in `known`: with a warning, unless it is of another namespace.
    pub fn check_attributes(&mut self, at: &Element<'_>, known: &[&str]) {
        for attribute in at.node.attributes() {
            let name = attribute.name();
            if attribute.namespace().is_some() {
                self.ignored(at, format!("attribute `{}` of another namespace", quote(name)));
            } else if !known.contains(&name) {
                let line = self.lines.of_attribute(&attribute);
                let what = format!("attribute {} of <{}>", quote(name), at.tag());
                note(&mut self.report.ignored, line, &at.place, &what);
                let found = format!("unknown {what}");
                let to_do = remedy(name, known, "remove it");
                let problem = Problem::new(line, &at.place, found, "an attribute of URDF", to_do);
                self.problem(Severity::Warning, problem);
            }
        }
    }

    /// The child elements called as one of `used`; every other one is noted.
    ///
    /// `ignored` has the elements that are known to have no effect here, each with a word on what it is. Others are
    /// noted with a warning.
    pub fn children<'a>(
        &mut self,
        at: &Element<'a>,
        used: &[&str],
        ignored: &[(&str, &str)],
    ) -> Vec<Node<'a, 'a>> {
        let namespace = at.node.tag_name().namespace();
        let mut found = Vec::new();
        let mut noted: Vec<&str> = Vec::new();
        let mut text = false;
        for node in at.node.children() {
            if !node.is_element() {
                text |= node.is_text() && node.text().is_some_and(|t| !t.trim().is_empty());
                continue;
            }
            let name = node.tag_name().name();
            let child = self.element(node, &at.place);
            if node.tag_name().namespace() != namespace {
                self.foreign(&child);
            } else if used.contains(&name) {
                found.push(node);
            } else if let Some((_, what)) = ignored.iter().find(|(known, _)| *known == name) {
                // Several visuals of one link are one note.
                if !noted.contains(&name) || at.node.tag_name().name() == "robot" {
                    noted.push(name);
                    self.ignored(&child, format!("{name}, {what}"));
                }
            } else if XACRO_WORDS.contains(&name) {
                let what = format!("element <{name}>, which only xacro knows");
                self.error(&child, what, "plain URDF", EXPAND);
            } else {
                let known: Vec<&str> =
                    used.iter().copied().chain(ignored.iter().map(|(known, _)| *known)).collect();
                self.ignored(&child, format!("element {}", quote(name)));
                let what = format!("unknown element {} in <{}>", quote(name), at.tag());
                self.warning(&child, what, "an element of URDF", &remedy(name, &known, "remove it"));
            }
        }
        if text {
            self.ignored(at, format!("text in <{}>", at.tag()));
        }
        found
    }

    /// An element of another namespace: xacro's change the model and must be expanded; others have no effect.
    fn foreign(&mut self, child: &Element<'_>) {
        let what = format!("element {} of another namespace", quote(child.tag()));
        if child.node.tag_name().namespace().is_some_and(|n| n.contains("xacro")) {
            let what = format!("xacro element {}", quote(child.tag()));
            self.error(child, what, "plain URDF", EXPAND);
        } else {
            self.ignored(child, what);
        }
    }

    /// The only one of `nodes` called `name`; an error if there are more.
    pub fn only<'a>(&mut self, at: &Element<'a>, nodes: &[Node<'a, 'a>], name: &str) -> Option<Element<'a>> {
        let mut named = nodes.iter().filter(|n| n.tag_name().name() == name);
        let first = named.next()?;
        if let Some(second) = named.next() {
            let second = self.element(*second, &at.place);
            self.error(&second, format!("a second <{name}>"), "at most one", "remove one of them");
        }
        Some(self.element(*first, &at.place))
    }

    /// Like [`only`](Self::only); an error if there is none.
    pub fn required<'a>(
        &mut self,
        at: &Element<'a>,
        nodes: &[Node<'a, 'a>],
        name: &str,
    ) -> Option<Element<'a>> {
        let found = self.only(at, nodes, name);
        if found.is_none() {
            self.error(at, format!("no <{name}> in <{}>", at.tag()), "exactly one", &format!("add <{name}>"));
        }
        found
    }

    /// An attribute's text; an error if it is missing or blank.
    pub fn text<'a>(&mut self, at: &Element<'a>, name: &str) -> Option<&'a str> {
        let value = at.node.attribute(name);
        if value.is_none_or(|v| v.trim().is_empty()) {
            let found = match value {
                None => format!("no attribute `{name}` in <{}>", at.tag()),
                Some(v) => format!("{name}={} in <{}>", quote(v), at.tag()),
            };
            self.error(at, found, "a name", &format!("add {name}=\"…\""));
            return None;
        }
        value
    }

    /// A name; an error if it is missing, blank, longer than any name should be, or a template.
    pub fn name<'a>(&mut self, at: &Element<'a>, attribute: &str) -> Option<&'a str> {
        let name = self.text(at, attribute)?;
        let found = || format!("{attribute}={} in <{}>", quote(name), at.tag());
        if name.contains("${") || name.contains("$(") {
            self.error(at, found(), "plain URDF", EXPAND);
            return None;
        }
        if name.len() > LONGEST_NAME {
            let found = format!("{}, of {} bytes", found(), name.len());
            self.error(at, found, &format!("at most {LONGEST_NAME} bytes"), "give a shorter name");
            return None;
        }
        Some(name)
    }

    /// N numbers of an attribute; `None` if it is missing, or wrong and reported.
    pub fn numbers<const N: usize>(&mut self, at: &Element<'_>, name: &str) -> Option<[f64; N]> {
        let attribute = at.node.attribute_node(name)?;
        let text = attribute.value();
        let mut values = [0.0; N];
        let mut n = 0;
        for word in text.split_ascii_whitespace() {
            match word.parse::<f64>() {
                Ok(value) if value.is_finite() => {
                    if let Some(slot) = values.get_mut(n) {
                        *slot = value;
                    }
                }
                Ok(_) => {
                    let to_do = if word.contains(['n', 'N']) {
                        "give a number; leave the attribute out where there is no limit"
                    } else {
                        "give a number between -1.8e308 and 1.8e308"
                    };
                    return self.bad_number(at, &attribute, word, "a finite number", to_do);
                }
                Err(_) => {
                    let to_do = if word.contains("${") {
                        EXPAND
                    } else if word.contains(',') {
                        "write the decimal point as `.` and separate numbers by spaces"
                    } else {
                        "give a decimal number such as -1.5e-3"
                    };
                    return self.bad_number(at, &attribute, word, "a number", to_do);
                }
            }
            n += 1;
        }
        if n != N {
            let plural = if N == 1 { "number" } else { "numbers" };
            let required = format!("{N} {plural}");
            return self.bad_number(
                at,
                &attribute,
                text,
                &required,
                &format!("give {required} separated by spaces"),
            );
        }
        Some(values)
    }

    fn bad_number<T>(
        &mut self,
        at: &Element<'_>,
        attribute: &Attribute<'_, '_>,
        word: &str,
        required: &str,
        to_do: &str,
    ) -> Option<T> {
        let line = self.lines.of_attribute(attribute);
        let found = format!("{} in attribute `{}` of <{}>", quote(word), attribute.name(), at.tag());
        self.problem(Severity::Error, Problem::new(line, &at.place, found, required, to_do));
        None
    }

    /// One number of an attribute; `None` if it is missing, or wrong and reported.
    pub fn number(&mut self, at: &Element<'_>, name: &str) -> Option<f64> {
        self.numbers::<1>(at, name).map(|[value]| value)
    }

    /// One number of an attribute; an error if it is missing.
    pub fn required_number(&mut self, at: &Element<'_>, name: &str) -> Option<f64> {
        if !at.node.has_attribute(name) {
            let found = format!("no attribute `{name}` in <{}>", at.tag());
            self.error(at, found, "a number", &format!("add {name}=\"…\""));
        }
        self.number(at, name)
    }

    /// The pose of an `<origin>`: `xyz` in m, `rpy` in rad or `quat_xyzw`; each is zero where it is missing.
    pub fn origin(&mut self, origin: Option<&Element<'_>>) -> Placement {
        let Some(origin) = origin else { return Placement::IDENTITY };
        self.check_attributes(origin, &["xyz", "rpy", "quat_xyzw"]);
        self.children(origin, &[], &[]);
        let xyz = self.numbers(origin, "xyz").unwrap_or([0.0; 3]);
        let rpy = self.numbers(origin, "rpy");
        if let Some(rotation) = self.numbers(origin, "quat_xyzw") {
            if rpy.is_some() {
                let to_do = "remove one of them";
                self.error(origin, "both `rpy` and `quat_xyzw` in <origin>", "one orientation", to_do);
            }
            return Placement { translation: xyz, rotation };
        }
        if let Some(angle) = rpy.iter().flatten().find(|angle| angle.abs() > LARGEST_ANGLE) {
            let to_do = format!("if it is meant in degrees, write {:.9?}", angle.to_radians());
            self.warning(origin, format!("angle {angle:?} in `rpy`, more than a turn"), "radians", &to_do);
        }
        Placement::from_xyz_rpy(xyz, rpy.unwrap_or([0.0; 3]))
    }
}

/// Adds a note, as long as the list has room.
fn note(list: &mut Vec<Note>, line: Option<u32>, place: &str, what: impl Into<String>) {
    if list.len() < MOST_ENTRIES {
        list.push(Note::new(line, place, what));
    } else if list.len() == MOST_ENTRIES {
        list.push(Note::new(
            None,
            "report",
            format!("more than {MOST_ENTRIES} entries, the rest is not listed"),
        ));
    }
}
