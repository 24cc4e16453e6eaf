//! From text to a graph: precedence climbing over the tokens.

use super::error::ExpressionError;
use super::function::{Binary, FUNCTIONS, Function, SYNONYMS, Unary};
use super::graph::{Graph, Id};
use super::token::{Token, next};
use crate::suggest::{nearest, quote};
use std::collections::HashMap;

/// Longest text, bytes.
const LONGEST: usize = 1 << 20;
/// Deepest nesting of parentheses, signs and powers, which the parser follows on its stack.
const DEEPEST: usize = 200;
/// Largest number of different subexpressions.
const MOST_NODES: usize = 200_000;

/// An error at a byte of the text.
#[derive(Debug)]
pub(super) struct Problem {
    byte: usize,
    found: String,
    required: String,
    remedy: String,
}

impl Problem {
    pub(super) fn new(
        byte: usize,
        found: impl Into<String>,
        required: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Problem { byte, found: found.into(), required: required.into(), remedy: remedy.into() }
    }
}

/// The graph of a text and its root.
///
/// # Errors
/// The first place where the text is no expression.
pub(super) fn parse(
    text: &str,
    variables: &[&str],
    constants: &[(&str, f64)],
) -> Result<(Graph, Id), ExpressionError> {
    parse_bytes(text, variables, constants).map_err(|Problem { byte, found, required, remedy }| {
        let column = 1 + text.get(..byte).map_or(0, |before| before.chars().count());
        ExpressionError { column, found, required, remedy }
    })
}

fn parse_bytes<'a>(
    text: &'a str,
    variables: &[&'a str],
    constants: &[(&'a str, f64)],
) -> Result<(Graph, Id), Problem> {
    if text.len() > LONGEST {
        let found = format!("an expression of {} bytes", text.len());
        return Err(Problem::new(0, found, format!("at most {LONGEST} bytes"), "use a table"));
    }
    let mut parser = Parser {
        text,
        end: 0,
        at: 0,
        token: Token::End,
        after: 0,
        depth: 0,
        graph: Graph::default(),
        names: HashMap::new(),
        definitions: Vec::new(),
    };
    for (name, value) in constants {
        let id = parser.graph.constant(*value);
        parser.names.insert(name, id);
    }
    for (i, name) in (0u32..).zip(variables) {
        let id = parser.graph.variable(i);
        parser.names.insert(name, id);
    }
    let mut start = 0;
    let mut parts = Vec::new();
    for part in text.split(';') {
        parts.push((start, part));
        start += part.len() + 1;
    }
    parser.definitions =
        parts.iter().filter_map(|(_, part)| part.split_once('=')).map(|(name, _)| name.trim()).collect();
    // The last definition first: each may use those after it.
    for &(start, part) in parts[1..].iter().rev().filter(|(_, part)| !part.trim().is_empty()) {
        let (name, equals) = parser.definition(start, part)?;
        let id = parser.whole(equals + 1, start + part.len())?;
        parser.names.insert(name, id);
    }
    let root = parser.whole(0, parts[0].1.len())?;
    Ok((parser.graph, root))
}

struct Parser<'a> {
    text: &'a str,
    /// Where the expression that is being read ends.
    end: usize,
    /// The token that is next, where it begins, and where the one after it may begin.
    token: Token<'a>,
    at: usize,
    after: usize,
    depth: usize,
    graph: Graph,
    /// What a name stands for: a definition, else a variable, else a constant.
    names: HashMap<&'a str, Id>,
    /// Names of all definitions, those that have not been read included.
    definitions: Vec<&'a str>,
}

impl<'a> Parser<'a> {
    /// Name of a definition, and where its `=` is.
    fn definition(&mut self, start: usize, part: &str) -> Result<(&'a str, usize), Problem> {
        let Some(equals) = part.find('=') else {
            let at = start + part.len() - part.trim_start().len();
            let found = format!("{} after `;`", quote(part.trim()));
            return Err(Problem::new(at, found, "a definition NAME = EXPRESSION", "give it a name"));
        };
        (self.after, self.end) = (start, start + equals);
        self.advance()?;
        let (at, token) = (self.at, self.token);
        self.advance()?;
        match (token, self.token) {
            (Token::Name(name), Token::End) => Ok((name, start + equals)),
            _ => {
                let found = format!("{} left of `=`", quote(part[..equals].trim()));
                Err(Problem::new(at, found, "one name", "begin the definition with the name that it defines"))
            }
        }
    }

    /// The expression that fills these bytes.
    fn whole(&mut self, start: usize, end: usize) -> Result<Id, Problem> {
        (self.after, self.end) = (start, end);
        self.advance()?;
        let id = self.expression(0)?;
        if self.token == Token::End {
            return Ok(id);
        }
        let remedy = match self.token {
            Token::Number(_) | Token::Name(_) | Token::Sign('(') => "write `*` for a product",
            Token::Sign(')') => "remove it, or open it before",
            Token::Sign('=') => "write definitions after the expression: a*b; a = 2",
            _ => "remove it",
        };
        Err(Problem::new(self.at, self.token.describe(), "an operator or the end", remedy))
    }

    fn advance(&mut self) -> Result<(), Problem> {
        (self.at, self.token, self.after) = next(&self.text[..self.end], self.after)?;
        Ok(())
    }

    /// An expression of operators that bind at least as tightly as `least`.
    fn expression(&mut self, least: u8) -> Result<Id, Problem> {
        self.depth += 1;
        if self.depth > DEEPEST {
            let found = format!("an expression nested more than {DEEPEST} deep");
            let required = format!("at most {DEEPEST} levels");
            return Err(Problem::new(self.at, found, required, "define its parts: a*b; a = …; b = …"));
        }
        let mut left = self.operand()?;
        while let Token::Sign(sign) = self.token {
            let (operator, binds, right_binds) = match sign {
                '+' => (Binary::Add, 0, 1),
                '-' => (Binary::Subtract, 0, 1),
                '*' => (Binary::Multiply, 1, 2),
                '/' => (Binary::Divide, 1, 2),
                // To the right: a^b^c is a^(b^c).
                '^' => (Binary::Power, 3, 3),
                _ => break,
            };
            if binds < least {
                break;
            }
            self.advance()?;
            let right = self.expression(right_binds)?;
            left = self.graph.binary(operator, left, right);
            self.check_size()?;
        }
        self.depth -= 1;
        Ok(left)
    }

    /// A number, a name, a call, something in parentheses, or minus one of them or its power.
    fn operand(&mut self) -> Result<Id, Problem> {
        let (at, token) = (self.at, self.token);
        let required = "a number, a name, `-` or `(`";
        match token {
            Token::Number(x) => {
                self.advance()?;
                Ok(self.graph.constant(x))
            }
            Token::Name(name) => {
                self.advance()?;
                if self.token == Token::Sign('(') {
                    return self.call(at, name);
                }
                self.names.get(name).copied().ok_or_else(|| self.unknown_name(at, name))
            }
            Token::Sign('(') => {
                self.advance()?;
                let id = self.expression(0)?;
                self.close(at)?;
                Ok(id)
            }
            Token::Sign('-') => {
                self.advance()?;
                let id = self.expression(2)?;
                Ok(self.graph.unary(Unary::Negate, id))
            }
            Token::Sign('*') if self.text[..at].ends_with('*') => {
                Err(Problem::new(at, "`**`", required, "write `^` for a power"))
            }
            Token::Sign(_) => Err(Problem::new(at, token.describe(), required, "remove it")),
            Token::End => Err(Problem::new(at, token.describe(), required, "complete the expression")),
        }
    }

    /// A call; its opening parenthesis is next.
    fn call(&mut self, at: usize, name: &str) -> Result<Id, Problem> {
        let open = self.at;
        let Some((_, function)) = FUNCTIONS.iter().find(|(known, _)| *known == name) else {
            return Err(self.unknown_function(at, name));
        };
        let mut arguments = Vec::new();
        self.advance()?;
        if self.token != Token::Sign(')') {
            arguments.push(self.expression(0)?);
            while self.token == Token::Sign(',') {
                self.advance()?;
                arguments.push(self.expression(0)?);
            }
        }
        self.close(open)?;
        let id = match (function, &arguments[..]) {
            (Function::One(f), &[x]) => self.graph.unary(*f, x),
            (Function::Two(f), &[x, y]) => self.graph.binary(*f, x, y),
            (Function::Select, &[c, x, y]) => self.graph.select(c, x, y),
            _ => {
                let plural = |n: usize| format!("{n} argument{}", if n == 1 { "" } else { "s" });
                let found = format!("{name} with {}", plural(arguments.len()));
                let required = plural(function.arguments());
                return Err(Problem::new(at, found, &required, format!("give {required}")));
            }
        };
        self.check_size()?;
        Ok(id)
    }

    /// Reads the closing parenthesis of the one at byte `open`.
    fn close(&mut self, open: usize) -> Result<(), Problem> {
        match self.token {
            Token::Sign(')') => self.advance(),
            Token::Number(_) | Token::Name(_) | Token::Sign('(') => Err(Problem::new(
                self.at,
                self.token.describe(),
                "an operator or `)`",
                "write `*` for a product",
            )),
            Token::End => Err(Problem::new(open, "`(` without `)`", "a `)` for every `(`", "close it")),
            token => Err(Problem::new(self.at, token.describe(), "an operator or `)`", "remove it")),
        }
    }

    fn check_size(&self) -> Result<(), Problem> {
        if self.graph.len() <= MOST_NODES {
            return Ok(());
        }
        let found = format!("more than {MOST_NODES} different subexpressions");
        Err(Problem::new(self.at, found, format!("at most {MOST_NODES}"), "use a table"))
    }

    fn unknown_name(&self, at: usize, name: &str) -> Problem {
        let found = format!("unknown name {}", quote(name));
        let mut known: Vec<&str> = self.names.keys().copied().collect();
        known.sort_unstable();
        let listed = known.iter().take(20).copied().collect::<Vec<_>>().join(", ");
        let required = match known.len() {
            0 => "an expression without variables".into(),
            1..=20 => format!("one of {listed}"),
            _ => format!("one of {listed}, …"),
        };
        let remedy = if self.definitions.contains(&name) {
            format!("move the definition of `{name}` behind the place where it is used")
        } else if FUNCTIONS.iter().any(|(function, _)| *function == name) {
            format!("give its arguments: {name}(…)")
        } else {
            match nearest(name, known) {
                Some(guess) => format!("did you mean `{guess}`?"),
                None => format!("correct it, or define it: …; {} = …", short(name)),
            }
        };
        Problem::new(at, found, required, remedy)
    }

    fn unknown_function(&self, at: usize, name: &str) -> Problem {
        let names = || FUNCTIONS.iter().map(|(name, _)| *name);
        let lower = name.to_ascii_lowercase();
        let synonym = SYNONYMS.iter().find(|(other, _)| *other == lower).map(|(_, ours)| *ours);
        if self.names.contains_key(name) && synonym.is_none() {
            let found = format!("{} before `(`, which is no function", quote(name));
            return Problem::new(at, found, "a function, or an operator", "write `*` for a product");
        }
        let remedy = match synonym.or_else(|| nearest(name, names())) {
            Some(guess) => format!("did you mean `{guess}`?"),
            None => "use one of the functions".into(),
        };
        let required = format!("one of {}", names().collect::<Vec<_>>().join(", "));
        Problem::new(at, format!("unknown function {}", quote(name)), required, remedy)
    }
}

/// At most 60 characters of a name.
fn short(name: &str) -> &str {
    name.char_indices().nth(60).map_or(name, |(end, _)| &name[..end])
}
