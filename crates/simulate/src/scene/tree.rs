//! A TOML document as a tree with the line of every key and value, and overrides from the command line.

use phipsi_formats::{Problem, Report, nearest};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Deepest nesting that is read; a scene has about five levels.
const DEEPEST: usize = 40;

/// A value with its line.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Node {
    pub(crate) value: Value,
    /// Line in the scene file; `None` for an override.
    pub(crate) line: Option<u32>,
}

/// A TOML value; dates are not used in scenes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Number(f64),
    /// An integer, kept apart for counts and indices.
    Integer(i64),
    Text(String),
    Flag(bool),
    List(Vec<Node>),
    Table(Vec<Entry>),
    /// A date or a number out of range, in the user's words.
    Other(String),
}

/// A key with its value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Entry {
    pub(crate) key: String,
    pub(crate) line: Option<u32>,
    pub(crate) node: Node,
}

impl Value {
    /// What it is, for messages.
    pub(crate) fn describe(&self) -> String {
        match self {
            Value::Number(x) => format!("{x}"),
            Value::Integer(x) => format!("{x}"),
            Value::Text(s) => format!("{:?}", shorten(s)),
            Value::Flag(b) => format!("{b}"),
            Value::List(items) => format!("a list of {}", items.len()),
            Value::Table(_) => "a table".into(),
            Value::Other(s) => shorten(s),
        }
    }
}

/// At most 60 characters of a text.
pub(crate) fn shorten(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.into(),
    }
}

/// Parses a scene; every violation of TOML's grammar is reported.
pub(crate) fn parse(text: &str, report: &mut Report) -> Option<Node> {
    if nesting(text) > DEEPEST {
        report.errors.push(Problem::new(
            None,
            "scene",
            format!("brackets nested more than {DEEPEST} deep"),
            "a scene file",
            "see whether this is the right file",
        ));
        return None;
    }
    let starts: Vec<usize> = std::iter::once(0)
        .chain(text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i + 1))
        .collect();
    let line = |byte: usize| u32::try_from(starts.partition_point(|&s| s <= byte)).ok();
    let (table, errors) = DeTable::parse_recoverable(text);
    for e in &errors {
        let at = e.span().and_then(|s| line(s.start));
        report.errors.push(Problem::new(
            at,
            "TOML",
            e.message(),
            "valid TOML",
            "correct the file at this place",
        ));
    }
    if !errors.is_empty() {
        return None;
    }
    let at = table.span().start;
    Some(Node { value: Value::Table(entries(table.into_inner(), &line)), line: line(at) })
}

/// Upper bound of the nesting of brackets, and of the segments of a dotted key, text in quotes included.
fn nesting(text: &str) -> usize {
    let (mut depth, mut dots, mut deepest) = (0usize, 0usize, 0);
    for b in text.bytes() {
        match b {
            b'[' | b'{' => depth += 1,
            b']' | b'}' => depth = depth.saturating_sub(1),
            b'.' => dots += 1,
            b'\n' | b'=' | b',' | b' ' => dots = 0,
            _ => {}
        }
        deepest = deepest.max(depth + dots);
    }
    deepest
}

type LineOf<'a> = &'a dyn Fn(usize) -> Option<u32>;

fn entries(table: DeTable<'_>, line: LineOf<'_>) -> Vec<Entry> {
    let mut list: Vec<(usize, Entry)> = table
        .into_iter()
        .map(|(key, value)| {
            let start = key.span().start;
            (start, Entry { key: key.into_inner().into_owned(), line: line(start), node: node(value, line) })
        })
        .collect();
    // The parser keeps keys in alphabetical order; people read files from the top.
    list.sort_by_key(|(start, _)| *start);
    list.into_iter().map(|(_, e)| e).collect()
}

fn node(value: Spanned<DeValue<'_>>, line: LineOf<'_>) -> Node {
    let at = line(value.span().start);
    let value = match value.into_inner() {
        DeValue::String(s) => Value::Text(s.into_owned()),
        DeValue::Integer(i) => match i64::from_str_radix(i.as_str(), i.radix()) {
            Ok(x) => Value::Integer(x),
            Err(_) => Value::Other(i.as_str().into()),
        },
        DeValue::Float(x) => match x.as_str().parse::<f64>() {
            Ok(value) => Value::Number(value),
            Err(_) => Value::Other(x.as_str().into()),
        },
        DeValue::Boolean(b) => Value::Flag(b),
        DeValue::Datetime(d) => Value::Other(d.to_string()),
        DeValue::Array(items) => Value::List(items.into_iter().map(|v| node(v, line)).collect()),
        DeValue::Table(table) => Value::Table(entries(table, line)),
    };
    Node { value, line: at }
}

/// Puts `key=value` of the command line into the tree; `value` is TOML, or else a text.
///
/// Segments of the key are separated by dots; the position in a list is counted from 0: `force.0.stiffness=3`. An empty
/// value removes the key: `integrator.step=`.
pub(crate) fn set(root: &mut Node, assignment: &str) -> Result<(), Problem> {
    let problem = |found: String, required: &str, remedy: String| {
        Problem::new(None, format!("--set {}", shorten(assignment)), found, required, remedy)
    };
    let Some((key, text)) = assignment.split_once('=') else {
        return Err(problem("no `=`".into(), "key=value", "for example --set integrator.rtol=1e-9".into()));
    };
    let mut scratch = Report::new("");
    let given = format!("value = {text}");
    let value = match parse(&given, &mut scratch).map(|n| n.value) {
        Some(Value::Table(mut list)) if list.len() == 1 => list.remove(0).node.value,
        _ => Value::Text(text.trim().into()),
    };
    let mut value = Node { value, line: None };
    forget_lines(&mut value);
    let segments: Vec<&str> = key.trim().split('.').map(str::trim).collect();
    if segments.iter().any(|s| s.is_empty()) || segments.len() > DEEPEST {
        return Err(problem(format!("key `{key}`"), "names separated by dots", "correct the key".into()));
    }
    let mut at = root;
    for (i, segment) in segments.iter().enumerate() {
        let last = i + 1 == segments.len();
        if last
            && text.trim().is_empty()
            && let Value::Table(list) = &mut at.value
        {
            list.retain(|e| e.key != *segment);
            return Ok(());
        }
        at = match &mut at.value {
            Value::Table(list) => {
                let position = match list.iter().position(|e| e.key == *segment) {
                    Some(position) => position,
                    None => {
                        let empty = Node { value: Value::Table(Vec::new()), line: None };
                        list.push(Entry { key: (*segment).into(), line: None, node: empty });
                        list.len() - 1
                    }
                };
                &mut list[position].node
            }
            Value::List(items) => {
                let n = items.len();
                match segment.parse::<usize>().ok().and_then(|k| items.get_mut(k)) {
                    Some(item) => item,
                    None => {
                        let required = "a position in the list, from 0";
                        let remedy = format!("the list has {n} entries");
                        return Err(problem(format!("`{segment}`"), required, remedy));
                    }
                }
            }
            other => {
                let found = format!("`{segment}` inside {}", other.describe());
                return Err(problem(found, "a table or a list", "correct the key".into()));
            }
        };
        if last {
            *at = value;
            return Ok(());
        }
    }
    Ok(())
}

fn forget_lines(node: &mut Node) {
    node.line = None;
    match &mut node.value {
        Value::List(items) => items.iter_mut().for_each(forget_lines),
        Value::Table(list) => list.iter_mut().for_each(|e| {
            e.line = None;
            forget_lines(&mut e.node);
        }),
        _ => {}
    }
}

/// A table being read: every key asked for is known; [`Table::finish`] refuses the others.
pub(crate) struct Table<'a> {
    entries: &'a [Entry],
    known: Vec<&'static str>,
    pub(crate) place: String,
    pub(crate) line: Option<u32>,
}

impl<'a> Table<'a> {
    /// A node that must be a table.
    pub(crate) fn new(node: &'a Node, place: impl Into<String>, report: &mut Report) -> Option<Self> {
        let place = place.into();
        match &node.value {
            Value::Table(entries) => Some(Table { entries, known: Vec::new(), place, line: node.line }),
            other => {
                let found = other.describe();
                report.errors.push(Problem::new(node.line, place, found, "a table", "see the scene format"));
                None
            }
        }
    }
    /// The value of a key.
    pub(crate) fn get(&mut self, key: &'static str) -> Option<&'a Node> {
        if !self.known.contains(&key) {
            self.known.push(key);
        }
        self.entries.iter().find(|e| e.key == key).map(|e| &e.node)
    }
    /// True if the key is there.
    pub(crate) fn has(&mut self, key: &'static str) -> bool {
        self.get(key).is_some()
    }
    /// All keys with their values, for tables whose keys are the user's names.
    pub(crate) fn rest(&self) -> impl Iterator<Item = &'a Entry> + '_ {
        self.entries.iter().filter(|e| !self.known.iter().any(|k| *k == e.key))
    }
    /// An error at a value (or the table, where there is none).
    pub(crate) fn error(
        &self,
        node: Option<&Node>,
        report: &mut Report,
        found: impl Into<String>,
        required: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        let line = node.map_or(self.line, |n| n.line);
        report.errors.push(Problem::new(line, self.place.clone(), found, required, remedy));
    }
    fn wrong(&self, key: &str, node: &Node, report: &mut Report, required: &str) {
        let found = format!("{key} = {}", node.value.describe());
        self.error(Some(node), report, found, required, format!("correct `{key}`"));
    }
    /// The value of a key that must be there.
    pub(crate) fn required(
        &mut self,
        key: &'static str,
        report: &mut Report,
        what: &str,
    ) -> Option<&'a Node> {
        let node = self.get(key);
        if node.is_none() {
            self.error(None, report, format!("no `{key}`"), what, format!("add `{key} = …`"));
        }
        node
    }
    /// A finite number.
    pub(crate) fn number(&mut self, key: &'static str, report: &mut Report) -> Option<f64> {
        let node = self.get(key)?;
        let number = finite(node);
        if number.is_none() {
            self.wrong(key, node, report, "a finite number");
        }
        number
    }
    /// A finite number, positive where `zero` is false and not negative otherwise.
    pub(crate) fn positive(&mut self, key: &'static str, zero: bool, report: &mut Report) -> Option<f64> {
        let node = self.get(key)?;
        match finite(node) {
            Some(x) if x > 0.0 || (zero && x == 0.0) => Some(x),
            _ => {
                let required = if zero { "a finite number, at least 0" } else { "a finite number above 0" };
                self.wrong(key, node, report, required);
                None
            }
        }
    }
    /// A text.
    pub(crate) fn text(&mut self, key: &'static str, report: &mut Report) -> Option<&'a str> {
        let node = self.get(key)?;
        match &node.value {
            Value::Text(s) => Some(s),
            _ => {
                self.wrong(key, node, report, "a text in quotes");
                None
            }
        }
    }
    /// A text that must be there.
    pub(crate) fn required_text(&mut self, key: &'static str, report: &mut Report) -> Option<&'a str> {
        self.required(key, report, "a text in quotes")?;
        self.text(key, report)
    }
    /// True or false.
    pub(crate) fn flag(&mut self, key: &'static str, report: &mut Report) -> Option<bool> {
        let node = self.get(key)?;
        match node.value {
            Value::Flag(b) => Some(b),
            _ => {
                self.wrong(key, node, report, "true or false");
                None
            }
        }
    }
    /// N finite numbers.
    pub(crate) fn numbers<const N: usize>(
        &mut self,
        key: &'static str,
        report: &mut Report,
    ) -> Option<[f64; N]> {
        let node = self.get(key)?;
        let list = number_list(node).and_then(|list| <[f64; N]>::try_from(list).ok());
        if list.is_none() {
            self.wrong(key, node, report, &format!("{N} finite numbers in brackets"));
        }
        list
    }
    /// Texts in brackets.
    pub(crate) fn texts(&mut self, key: &'static str, report: &mut Report) -> Option<Vec<String>> {
        let node = self.get(key)?;
        let text = |item: &Node| match &item.value {
            Value::Text(s) => Some(s.clone()),
            _ => None,
        };
        let list = match &node.value {
            Value::List(items) => items.iter().map(text).collect(),
            _ => None,
        };
        if list.is_none() {
            self.wrong(key, node, report, "texts in brackets");
        }
        list
    }
    /// One of a few words.
    pub(crate) fn word(
        &mut self,
        key: &'static str,
        words: &[&'static str],
        report: &mut Report,
    ) -> Option<&'static str> {
        let text = self.text(key, report)?;
        let found = words.iter().copied().find(|w| *w == text);
        if found.is_none() {
            let node = self.get(key);
            let what = format!("{key} = {:?}", shorten(text));
            self.error(node, report, what, format!("one of {}", words.join(", ")), suggestion(text, words));
        }
        found
    }
    /// A table inside this one.
    pub(crate) fn table(&mut self, key: &'static str, report: &mut Report) -> Option<Table<'a>> {
        let node = self.get(key)?;
        Table::new(node, format!("{}.{key}", self.place), report)
    }
    /// The tables of a list of tables.
    pub(crate) fn tables(&mut self, key: &'static str, report: &mut Report) -> Vec<Table<'a>> {
        let Some(node) = self.get(key) else { return Vec::new() };
        match &node.value {
            Value::List(items) => items
                .iter()
                .enumerate()
                .filter_map(|(i, item)| Table::new(item, format!("{key} {i}"), report))
                .collect(),
            _ => {
                self.wrong(key, node, report, &format!("tables under [[{key}]]"));
                Vec::new()
            }
        }
    }
    /// Refuses every key that was not asked for, with a suggestion.
    pub(crate) fn finish(self, report: &mut Report) {
        for entry in self.rest() {
            let remedy = suggestion(&entry.key, &self.known);
            report.errors.push(Problem::new(
                entry.line,
                self.place.clone(),
                format!("unknown key `{}`", shorten(&entry.key)),
                format!("one of {}", self.known.join(", ")),
                remedy,
            ));
        }
    }
}

/// "did you mean `rtol`?", or where the known words are said.
pub(crate) fn suggestion(word: &str, known: &[&str]) -> String {
    match nearest(word, known.iter().copied()) {
        Some(k) => format!("did you mean `{k}`?"),
        None => "remove it, or use one of these".into(),
    }
}

/// A finite number, integer or not.
pub(crate) fn finite(node: &Node) -> Option<f64> {
    match node.value {
        Value::Number(x) if x.is_finite() => Some(x),
        Value::Integer(x) => Some(x as f64),
        _ => None,
    }
}

/// A list of finite numbers.
pub(crate) fn number_list(node: &Node) -> Option<Vec<f64>> {
    match &node.value {
        Value::List(items) => items.iter().map(finite).collect(),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> (Option<Node>, Report) {
        let mut report = Report::new("scene.toml");
        (parse(text, &mut report), report)
    }

    #[test]
    fn keys_keep_their_order_and_lines() {
        let (root, _) = read("b = 1\n[z]\na = [1, 2.5]\n");
        let Some(Node { value: Value::Table(list), .. }) = root else { panic!() };
        let keys: Vec<_> = list.iter().map(|e| (e.key.as_str(), e.line)).collect();
        assert_eq!(keys, [("b", Some(1)), ("z", Some(2))]);
    }

    #[test]
    fn an_override_replaces_or_adds() {
        let (root, _) = read("[integrator]\nrtol = 1e-6\n[[force]]\nkind = 'spring'\n");
        let mut root = root.unwrap();
        set(&mut root, "integrator.rtol=1e-9").unwrap();
        set(&mut root, "integrator.method=tsit5").unwrap();
        set(&mut root, "force.0.stiffness = 3").unwrap();
        assert!(set(&mut root, "force.1.stiffness=3").unwrap_err().remedy.contains("1 entries"));
        assert!(set(&mut root, "integrator").unwrap_err().found.contains('='));
        set(&mut root, "integrator.step=0.1").unwrap();
        set(&mut root, "integrator.step=").unwrap();
        set(&mut root, "integrator.never=").unwrap();
        let mut report = Report::new("");
        let mut top = Table::new(&root, "scene", &mut report).unwrap();
        let mut integrator = top.table("integrator", &mut report).unwrap();
        assert_eq!(integrator.number("rtol", &mut report), Some(1e-9));
        assert!(!integrator.has("step"));
        assert_eq!(integrator.text("method", &mut report), Some("tsit5"));
        assert_eq!(top.tables("force", &mut report)[0].number("stiffness", &mut report), Some(3.0));
        assert!(report.errors.is_empty());
    }

    #[test]
    fn deep_nesting_and_bad_grammar_are_errors() {
        assert!(read(&format!("a = {}", "[".repeat(100_000))).0.is_none());
        assert!(read(&format!("{} = 1", vec!["a"; 100_000].join("."))).0.is_none());
        let (root, report) = read("a = 1\nb = = 2\n");
        assert!(root.is_none() && report.errors[0].line == Some(2));
    }
}
