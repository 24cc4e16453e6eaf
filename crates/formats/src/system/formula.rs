//! Expressions that may call tabulated functions, with their slopes.
//!
//! Each different call `name(…)` becomes a variable of its own; its arguments become expressions of the variables and of
//! the calls before it. Slopes follow by the chain rule.

use super::table::Table;
use crate::expression::{Expression, ExpressionError};
use std::sync::Arc;

/// Most calls of tabulated functions in one expression.
const MOST_CALLS: usize = 64;
/// Longest text with calls, bytes: each call reads the definitions behind it again.
const LONGEST: usize = 1 << 14;

/// A function of named variables that may call tabulated functions.
///
/// Values are computed in a buffer whose first numbers are the variables, in their order, and whose length is
/// [`Formula::slots`].
#[derive(Clone, Debug)]
pub struct Formula {
    variables: usize,
    calls: Vec<Call>,
    main: Expression,
}

/// A call of a tabulated function.
#[derive(Clone, Debug)]
pub struct Call {
    /// The function.
    pub table: Arc<Table>,
    /// Its arguments: expressions of the variables, and of the calls before it as further variables.
    pub arguments: Vec<Expression>,
}

/// The slope of a [`Formula`] in one of its variables.
#[derive(Clone, Debug)]
pub struct Slope {
    /// For each call, the slope of its first argument; empty for a discrete table, which has none.
    calls: Vec<Option<Chain>>,
    main: Chain,
}

/// The slope of an expression: in the variable itself, and in the calls that it uses.
#[derive(Clone, Debug)]
struct Chain {
    direct: Expression,
    through: Vec<(usize, Expression)>,
}

impl Formula {
    /// Reads an expression of these variables, constants and tabulated functions.
    ///
    /// # Errors
    /// [`ExpressionError`] at the first place where the text is no expression; within the arguments of a tabulated
    /// function the column is that of the call.
    pub fn parse(
        text: &str,
        variables: &[&str],
        constants: &[(&str, f64)],
        tables: &[Arc<Table>],
    ) -> Result<Formula, ExpressionError> {
        let mut names: Vec<String> = variables.iter().map(|name| name.to_string()).collect();
        let mut calls = Vec::new();
        let mut text = text.to_string();
        // From the back: calls in later definitions, and inner calls, come first.
        while let Some(found) = last_call(&text, tables)? {
            if calls.len() == MOST_CALLS || text.len() > LONGEST {
                let found =
                    format!("{} calls of tabulated functions in {} bytes", calls.len() + 1, text.len());
                let required = format!("at most {MOST_CALLS} calls in {LONGEST} bytes");
                return Err(error(&text, 0, found, &required, "make tables of their combinations"));
            }
            let known: Vec<&str> = names.iter().map(String::as_str).collect();
            let behind = text[found.end..].split_once(';').map_or("", |(_, definitions)| definitions);
            let mut arguments = Vec::new();
            for argument in &found.arguments {
                let argument = format!("{argument};{behind}");
                arguments.push(Expression::parse(&argument, &known, constants).map_err(|e| {
                    let column = 1 + text[..found.start].chars().count();
                    ExpressionError { column, ..e }
                })?);
            }
            let name = unused_name(&text, &names);
            text.replace_range(found.start..found.end, &format!(" {name} "));
            names.push(name);
            calls.push(Call { table: tables[found.table].clone(), arguments });
        }
        let known: Vec<&str> = names.iter().map(String::as_str).collect();
        let main = Expression::parse(&text, &known, constants)?;
        Ok(Formula { variables: variables.len(), calls, main })
    }

    /// Length of the buffer for the variables and for what is computed on the way.
    pub fn slots(&self) -> usize {
        self.variables + 2 * self.calls.len()
    }

    /// Number of variables.
    pub fn variables(&self) -> usize {
        self.variables
    }

    /// The expression, with the calls as further variables behind its own.
    pub fn expression(&self) -> &Expression {
        &self.main
    }

    /// The calls.
    pub fn calls(&self) -> &[Call] {
        &self.calls
    }

    /// True if its value takes this variable.
    pub fn depends_on(&self, variable: &str) -> bool {
        let expressions = self.calls.iter().flat_map(|call| &call.arguments);
        expressions.chain([&self.main]).any(|e| e.depends_on(variable))
    }

    /// The slope in a variable.
    pub fn slope(&self, variable: &str) -> Slope {
        let chain = |expression: &Expression, calls: usize| Chain {
            direct: expression.derivative(variable),
            through: (0..calls)
                .filter_map(|k| {
                    let name = &self.main.variables()[self.variables + k];
                    expression.depends_on(name).then(|| (k, expression.derivative(name)))
                })
                .collect(),
        };
        let of_call = |(k, call): (usize, &Call)| match call.table.sizes() {
            Some(_) => None,
            None => call.arguments.first().map(|argument| chain(argument, k)),
        };
        let calls = self.calls.iter().enumerate().map(of_call).collect();
        Slope { calls, main: chain(&self.main, self.calls.len()) }
    }

    /// The value; `buffer` has [`slots`](Self::slots) numbers, the first of them the variables. NaN if it is too short.
    pub fn value(&self, buffer: &mut [f64]) -> f64 {
        self.value_and_slopes(buffer, &[], &mut [])
    }

    /// The value, and its slopes, which are written to `slopes`.
    ///
    /// # Cost
    /// That of the expressions. No allocation.
    pub fn value_and_slopes(&self, buffer: &mut [f64], of: &[&Slope], slopes: &mut [f64]) -> f64 {
        let (n, calls) = (self.variables, self.calls.len());
        if buffer.len() < self.slots() {
            slopes.fill(f64::NAN);
            return f64::NAN;
        }
        // Behind the variables: values of the calls, then the slopes of the tables.
        for (k, call) in self.calls.iter().enumerate() {
            let mut arguments = [f64::NAN; 3];
            for (slot, argument) in arguments.iter_mut().zip(&call.arguments) {
                *slot = argument.value(&buffer[..n + k]);
            }
            (buffer[n + k], buffer[n + calls + k]) = call.table.value_and_slope(&arguments);
        }
        for (slope, out) in of.iter().zip(&mut *slopes) {
            *out = self.slope_value(buffer, slope);
        }
        self.main.value(&buffer[..n + calls])
    }

    fn slope_value(&self, buffer: &[f64], slope: &Slope) -> f64 {
        let (n, calls) = (self.variables, self.calls.len());
        let variables = &buffer[..n + calls];
        let mut through = [0.0; MOST_CALLS];
        let value = |chain: &Chain, through: &[f64]| {
            let direct = chain.direct.value(variables);
            chain.through.iter().fold(direct, |sum, (k, e)| match through[*k] {
                // Not 0 · ∞ where the call does not depend on the variable.
                0.0 => sum,
                by_call => sum + e.value(variables) * by_call,
            })
        };
        for (k, chain) in slope.calls.iter().enumerate() {
            if let Some(chain) = chain {
                through[k] = buffer[n + calls + k] * value(chain, &through);
            }
        }
        value(&slope.main, &through)
    }
}

/// A call in a text.
struct Found {
    table: usize,
    start: usize,
    end: usize,
    arguments: Vec<String>,
}

fn error(text: &str, byte: usize, found: String, required: &str, remedy: &str) -> ExpressionError {
    let column = 1 + text[..byte].chars().count();
    ExpressionError { column, found, required: required.into(), remedy: remedy.into() }
}

fn is_name(c: char) -> bool {
    !c.is_whitespace() && !"+-*/^(),;=".contains(c)
}

/// The call of a table that begins last.
fn last_call(text: &str, tables: &[Arc<Table>]) -> Result<Option<Found>, ExpressionError> {
    let mut best: Option<(usize, usize)> = None;
    for (table, name) in tables.iter().map(|table| table.name.as_str()).enumerate() {
        let begins = text.rmatch_indices(name).map(|(start, _)| start).find(|&start| {
            let before = text[..start].chars().next_back();
            let behind = text[start + name.len()..].trim_start();
            before.is_none_or(|c| !is_name(c)) && behind.starts_with('(')
        });
        if let Some(start) = begins
            && best.is_none_or(|(other, _)| start > other)
        {
            best = Some((start, table));
        }
    }
    let Some((start, table)) = best else { return Ok(None) };
    let name = &tables[table].name;
    let open = start + name.len() + text[start + name.len()..].find('(').unwrap_or(0);
    let (mut depth, mut arguments, mut from) = (0usize, Vec::new(), open + 1);
    for (i, c) in text[open..].char_indices().map(|(i, c)| (open + i, c)) {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            ';' => break,
            _ => {}
        }
        if depth == 0 || (depth == 1 && c == ',') {
            arguments.push(text[from..i].to_string());
            from = i + 1;
        }
        if depth == 0 {
            let required = tables[table].arguments();
            if arguments.len() != required {
                let found = format!("{name} with {} arguments", arguments.len());
                let required = format!("{required} arguments");
                return Err(error(text, start, found, &required, &format!("give {required}")));
            }
            return Ok(Some(Found { table, start, end: i + 1, arguments }));
        }
    }
    Err(error(text, open, "`(` without `)`".into(), "a `)` for every `(`", "close it"))
}

/// A name for a call that is not in the text nor among the variables.
fn unused_name(text: &str, names: &[String]) -> String {
    let taken = |name: &String| text.contains(name.as_str()) || names.contains(name);
    let mut number = names.len();
    loop {
        let name = format!("call_{number}");
        if !taken(&name) {
            return name;
        }
        number += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tables() -> Vec<Arc<Table>> {
        let squares = (0..=20).map(|i| f64::from(i * i) / 100.0).collect();
        vec![
            Arc::new(Table::discrete("pair", &[2, 2], vec![1.0, 2.0, 3.0, 4.0]).unwrap()),
            Arc::new(Table::continuous("f", [0.0, 2.0], false, squares).unwrap()),
        ]
    }

    fn value(formula: &Formula, variables: &[f64]) -> f64 {
        let mut buffer = variables.to_vec();
        buffer.resize(formula.slots(), 0.0);
        formula.value(&mut buffer)
    }

    #[test]
    fn calls_nest_and_use_the_definitions_behind_them() {
        let text = "pair(a, k)*f(x + s) + g; g = f(s)*a; s = pair(k, 1 - a)*0.1";
        let formula = Formula::parse(text, &["x", "a", "k"], &[], &tables()).unwrap();
        assert_eq!(formula.calls().len(), 4);
        // a = 1, k = 0: pair(1, 0) = 2; s = pair(0, 0)/10 = 0.1: both arguments are nodes.
        let exact = 2.0 * 0.36 + 0.01;
        assert!((value(&formula, &[0.5, 1.0, 0.0]) - exact).abs() <= 4.0 * f64::EPSILON);
        let nested = Formula::parse("f(f(f(x)))", &["x"], &[], &tables()).unwrap();
        assert!((value(&nested, &[1.0]) - 1.0).abs() <= 4.0 * f64::EPSILON);
        // A name that ends like a table, and a variable called like a call.
        let other = Formula::parse("f (0.1*call_2) + 2*pairs", &["pairs", "call_2"], &[], &tables()).unwrap();
        assert!((value(&other, &[1.0, 10.0]) - 3.0).abs() <= 4.0 * f64::EPSILON);
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let text = "f(0.3*x + f(x*y))*y + f(y)*pair(k, 1); k = step(x - 0.5)";
        let formula = Formula::parse(text, &["x", "y"], &[], &tables()).unwrap();
        let slopes = [formula.slope("x"), formula.slope("y")];
        let at = [0.731, 0.912];
        let mut buffer = at.to_vec();
        buffer.resize(formula.slots(), 0.0);
        let mut got = [0.0; 2];
        formula.value_and_slopes(&mut buffer, &[&slopes[0], &slopes[1]], &mut got);
        for i in 0..2 {
            let at_distance = |h: f64| {
                let (mut more, mut less) = (at, at);
                more[i] += h;
                less[i] -= h;
                (value(&formula, &more) - value(&formula, &less)) / (2.0 * h)
            };
            let h = 1e-3;
            let richardson = (4.0 * at_distance(h) - at_distance(2.0 * h)) / 3.0;
            // Values of size 1 over 2h, and an error h⁴ f⁽⁵⁾/5! of the formula.
            assert!((got[i] - richardson).abs() <= 1e-11, "{i}: {} {richardson}", got[i]);
        }
    }

    #[test]
    fn mistakes_have_their_place() {
        let parse = |text: &str| Formula::parse(text, &["x"], &[], &tables()).unwrap_err();
        assert_eq!(parse("1 + pair(x)").column, 5);
        assert_eq!(parse("1 + pair(x, x)*(f(x, 2)").found, "f with 2 arguments");
        assert_eq!(parse("f(x + ").found, "`(` without `)`");
        assert_eq!(parse("2*f(z)").found, "unknown name \"z\"");
        assert_eq!(parse("2*fx(x)").column, 3);
    }
}
