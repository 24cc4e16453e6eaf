//! Elements and attributes of a System, each with its force, entry and line in what is reported.

use super::Cutoff;
use crate::report::{Note, Problem, Report};
use crate::suggest::{quote, remedy};
use crate::xml::Lines;
use roxmltree::Node;

/// Most entries of each list of the report.
const MOST_ENTRIES: usize = 1000;

/// How to make a System without cutoffs.
pub(super) const NO_CUTOFF: &str =
    "forcefield.createSystem(topology, nonbondedMethod=NoCutoff, constraints=None)";

/// An element and its place for the report: "force `NonbondedForce`, exception 12".
#[derive(Clone)]
pub(super) struct Entry<'a, 'b> {
    pub node: Node<'a, 'a>,
    owner: &'b str,
    /// What it is, and its number from 0.
    number: Option<(&'static str, usize)>,
}

impl<'a, 'b> Entry<'a, 'b> {
    /// An element that is no entry of a list.
    pub fn whole(node: Node<'a, 'a>, owner: &'b str) -> Self {
        Entry { node, owner, number: None }
    }
    pub fn place(&self) -> String {
        match self.number {
            Some((what, number)) => format!("{}, {what} {number}", self.owner),
            None => self.owner.into(),
        }
    }
}

/// Collects the report while elements are read.
pub(super) struct Reader {
    pub report: Report,
    /// Number of errors, those included for which the report had no room.
    pub count: usize,
    /// The periodic box.
    pub box_vectors: Option<[[f64; 3]; 3]>,
    lines: Lines,
}

impl Reader {
    pub fn new(text: &str, report: Report) -> Self {
        Reader { report, count: 0, box_vectors: None, lines: Lines::new(text) }
    }
    pub fn line(&self, node: Node<'_, '_>) -> Option<u32> {
        self.lines.of(node)
    }
    pub fn error(
        &mut self,
        node: Node<'_, '_>,
        place: &str,
        found: impl Into<String>,
        required: &str,
        to_do: &str,
    ) {
        self.count += 1;
        let problem = Problem::new(self.lines.of(node), place, found, required, to_do);
        add(&mut self.report.errors, problem, "errors");
    }
    pub fn warning(
        &mut self,
        node: Node<'_, '_>,
        place: &str,
        found: impl Into<String>,
        required: &str,
        to_do: &str,
    ) {
        let problem = Problem::new(self.lines.of(node), place, found, required, to_do);
        add(&mut self.report.warnings, problem, "warnings");
    }
    pub fn ignored(&mut self, node: Node<'_, '_>, place: &str, what: impl Into<String>) {
        if self.report.ignored.len() < MOST_ENTRIES {
            self.report.ignored.push(Note::new(self.lines.of(node), place, what));
        }
    }

    /// Warns of every attribute that is not in `known`: it may change what the others mean.
    pub fn check_attributes(&mut self, at: &Entry<'_, '_>, known: &[&str]) {
        for attribute in at.node.attributes() {
            let name = attribute.name();
            if !known.contains(&name) {
                let found = format!("unknown attribute {} of <{}>", quote(name), at.node.tag_name().name());
                let to_do = remedy(name, known, "see whether this version of OpenMM is newer than phipsi's");
                self.warning(at.node, &at.place(), found, "an attribute that phipsi knows", &to_do);
            }
        }
    }

    /// As [`check_attributes`](Self::check_attributes), of a force: what all have is known.
    pub fn check_force(&mut self, node: Node<'_, '_>, place: &str, known: &[&str]) {
        const ALL: [&str; 5] = ["type", "name", "version", "forceGroup", "usesPeriodic"];
        let known: Vec<&str> = ALL.iter().chain(known).copied().collect();
        self.check_attributes(&Entry::whole(node, place), &known);
        if node.attribute("usesPeriodic").is_some_and(|text| text.trim() != "0") {
            let to_do = "force.setUsesPeriodicBoundaryConditions(False) in OpenMM";
            self.error(node, place, "a periodic box in use", "no periodic box", to_do);
        }
    }

    /// The distance of a force's cutoff, if it has one; an error for other methods than NoCutoff and CutoffNonPeriodic.
    pub fn cutoff(&mut self, node: Node<'_, '_>, place: &str, methods: &[&str]) -> Option<f64> {
        let at = Entry::whole(node, place);
        match self.integer(&at, "method")? {
            0 => None,
            1 => self.positive(&at, "cutoff"),
            method => {
                let name = usize::try_from(method).ok().and_then(|m| methods.get(m)).unwrap_or(&"unknown");
                let found = format!("method {method} ({name})");
                let required = "method 0 (NoCutoff) or 1 (CutoffNonPeriodic)";
                self.error(node, place, found, required, &format!("make the system by {NO_CUTOFF}"));
                None
            }
        }
    }

    /// As [`cutoff`](Self::cutoff), with the distance where switching begins, in a force that may switch.
    pub fn switched_cutoff(&mut self, node: Node<'_, '_>, place: &str, methods: &[&str]) -> Option<Cutoff> {
        let distance = self.cutoff(node, place, methods)?;
        self.switching(node, place, distance)
    }

    /// A cutoff with the distance where switching begins.
    pub fn switching(&mut self, node: Node<'_, '_>, place: &str, distance: f64) -> Option<Cutoff> {
        let at = Entry::whole(node, place);
        let mut switching = None;
        if node.attribute("useSwitchingFunction").is_some_and(|text| text.trim() != "0") {
            let start = self.non_negative(&at, "switchingDistance")?;
            if start >= distance {
                return self.bad(&at, "switchingDistance", &start.to_string(), "less than the cutoff");
            }
            switching = Some(start);
        }
        Some(Cutoff { distance, switching })
    }

    /// The child elements with these names, each at most once; an error for a missing one that is not optional, and a
    /// warning for every other element.
    pub fn lists<'a, const N: usize>(
        &mut self,
        node: Node<'a, 'a>,
        place: &str,
        names: &[&str; N],
        optional: &[&str],
    ) -> [Option<Node<'a, 'a>>; N] {
        let mut lists = [None; N];
        for child in node.children().filter(Node::is_element) {
            let name = child.tag_name().name();
            match names.iter().position(|known| *known == name) {
                Some(i) if lists[i].is_some() => {
                    self.error(
                        child,
                        place,
                        format!("a second <{name}>"),
                        "at most one",
                        "remove one of them",
                    );
                }
                Some(i) => lists[i] = Some(child),
                None => self.unknown_element(child, place, names),
            }
        }
        for (name, list) in names.iter().zip(&lists) {
            if list.is_none() && !optional.contains(name) {
                self.error(node, place, format!("no <{name}>"), "exactly one", "serialize the system again");
            }
        }
        lists
    }

    /// The child elements called `tag`, numbered as `what`; a warning for every other element.
    pub fn entries<'a, 'b>(
        &mut self,
        list: Option<Node<'a, 'a>>,
        owner: &'b str,
        tag: &str,
        what: &'static str,
    ) -> Vec<Entry<'a, 'b>> {
        let mut entries = Vec::new();
        let Some(list) = list else { return entries };
        for node in list.children().filter(Node::is_element) {
            if node.tag_name().name() == tag {
                entries.push(Entry { node, owner, number: Some((what, entries.len())) });
            } else {
                self.unknown_element(node, owner, &[tag]);
            }
        }
        entries
    }

    fn unknown_element(&mut self, node: Node<'_, '_>, place: &str, known: &[&str]) {
        let name = node.tag_name().name();
        let parent = node.parent().map_or("", |parent| parent.tag_name().name());
        let found = format!("unknown element {} in <{}>", quote(name), quote(parent).trim_matches('"'));
        let to_do = remedy(name, known, "see whether this version of OpenMM is newer than phipsi's");
        self.ignored(node, place, format!("element {}", quote(name)));
        self.warning(node, place, found, "an element that phipsi knows", &to_do);
    }

    /// An attribute's text; an error if it is missing.
    pub fn text<'a>(&mut self, at: &Entry<'a, '_>, name: &str) -> Option<&'a str> {
        let value = at.node.attribute(name);
        if value.is_none() {
            let found = format!("no attribute `{name}` in <{}>", at.node.tag_name().name());
            self.error(at.node, &at.place(), found, "one", "serialize the system again");
        }
        value
    }

    /// A finite number.
    pub fn number(&mut self, at: &Entry<'_, '_>, name: &str) -> Option<f64> {
        let text = self.text(at, name)?;
        match text.trim().parse::<f64>() {
            Ok(value) if value.is_finite() => Some(value),
            _ => self.bad(at, name, text, "a finite number"),
        }
    }

    /// A finite number, or another one where the attribute is missing.
    pub fn number_or(&mut self, at: &Entry<'_, '_>, name: &str, otherwise: f64) -> Option<f64> {
        if at.node.has_attribute(name) { self.number(at, name) } else { Some(otherwise) }
    }

    /// A finite number that is not negative.
    pub fn non_negative(&mut self, at: &Entry<'_, '_>, name: &str) -> Option<f64> {
        let value = self.number(at, name)?;
        if value >= 0.0 { Some(value) } else { self.bad(at, name, &value.to_string(), "no negative number") }
    }

    /// A finite number greater than zero.
    pub fn positive(&mut self, at: &Entry<'_, '_>, name: &str) -> Option<f64> {
        let value = self.number(at, name)?;
        if value > 0.0 { Some(value) } else { self.bad(at, name, &value.to_string(), "a positive number") }
    }

    /// A whole number; OpenMM writes some as 1e+06.
    pub fn integer(&mut self, at: &Entry<'_, '_>, name: &str) -> Option<i64> {
        let text = self.text(at, name)?;
        let from_decimal = |x: f64| (x.fract() == 0.0 && x.abs() < 9e15).then_some(x as i64);
        let value = text.trim();
        match value.parse().ok().or_else(|| value.parse().ok().and_then(from_decimal)) {
            Some(value) => Some(value),
            None => self.bad(at, name, text, "a whole number"),
        }
    }

    /// A whole number from `least` to `most`.
    pub fn integer_in(&mut self, at: &Entry<'_, '_>, name: &str, least: i64, most: i64) -> Option<usize> {
        let value = self.integer(at, name)?;
        if (least..=most).contains(&value) {
            return usize::try_from(value).ok();
        }
        self.bad(at, name, &value.to_string(), &format!("a whole number from {least} to {most}"))
    }

    /// Different particles out of n.
    pub fn atoms<const N: usize>(
        &mut self,
        at: &Entry<'_, '_>,
        names: [&str; N],
        n: usize,
    ) -> Option<[usize; N]> {
        let atoms = names.map(|name| self.integer_in(at, name, 0, n as i64 - 1));
        if atoms.contains(&None) {
            return None;
        }
        let atoms = atoms.map(Option::unwrap_or_default);
        for (i, atom) in atoms.iter().enumerate() {
            if atoms[..i].contains(atom) {
                let found = format!("particle {atom} twice in <{}>", at.node.tag_name().name());
                let to_do = "remove this entry, or correct its particles";
                self.error(at.node, &at.place(), found, "different particles", to_do);
                return None;
            }
        }
        Some(atoms)
    }

    /// An error unless there is one entry for each of n particles.
    pub fn check_count(&mut self, node: Node<'_, '_>, place: &str, found: usize, n: usize) {
        if found != n {
            let found = format!("parameters of {found} particles");
            let required = format!("those of the {n} particles of the system");
            self.error(node, place, found, &required, "call force.addParticle(…) once for each");
        }
    }

    pub fn bad<T>(&mut self, at: &Entry<'_, '_>, name: &str, value: &str, required: &str) -> Option<T> {
        let found = format!("{name}={} in <{}>", quote(value), at.node.tag_name().name());
        self.error(at.node, &at.place(), found, required, "correct it, or serialize the system again");
        None
    }
}

fn add(list: &mut Vec<Problem>, problem: Problem, word: &str) {
    if list.len() < MOST_ENTRIES {
        list.push(problem);
    } else if list.len() == MOST_ENTRIES {
        let found = format!("more than {MOST_ENTRIES} {word}, of which the rest is not listed");
        list.push(Problem::new(problem.line, "report", found, "fewer", "correct these first"));
    }
}
