//! Expressions as text that reads back as the same expression.

use super::function::{Binary, Unary};
use super::graph::{Graph, Id, Node, Operation};
use std::collections::HashMap;
use std::fmt::{self, Write as _};

/// How tightly an operation binds.
const SUM: u8 = 1;
const PRODUCT: u8 = 2;
const MINUS: u8 = 3;
const POWER: u8 = 4;
const ATOM: u8 = 5;

enum Item {
    /// A node, and how tightly it must bind to need no parentheses.
    Node(Id, u8),
    Text(&'static str),
    Integer(i32),
}

/// Writes the expression; what is used twice or more is defined after it.
pub(super) fn write(
    f: &mut fmt::Formatter<'_>,
    graph: &Graph,
    root: Id,
    variables: &[String],
) -> fmt::Result {
    let uses = graph.uses(root);
    let mut names: HashMap<Id, String> = HashMap::new();
    let mut counter = 0;
    // Users before what they use: a definition may use only those after it.
    let shared: Vec<Id> = (0..root)
        .rev()
        .filter(|&id| uses[id as usize] > 1 && matches!(graph.node(id), Node::Operation(_)))
        .collect();
    for &id in &shared {
        let name = loop {
            counter += 1;
            let name = format!("s{counter}");
            if !variables.contains(&name) {
                break name;
            }
        };
        names.insert(id, name);
    }
    write_node(f, graph, root, variables, &names)?;
    for id in shared {
        write!(f, "; {} = ", names[&id])?;
        write_node(f, graph, id, variables, &names)?;
    }
    Ok(())
}

/// Writes one node with everything below it, down to named nodes; with its own stack, since nesting has no bound.
fn write_node(
    f: &mut fmt::Formatter<'_>,
    graph: &Graph,
    top: Id,
    variables: &[String],
    names: &HashMap<Id, String>,
) -> fmt::Result {
    let mut stack = vec![Item::Node(top, SUM)];
    while let Some(item) = stack.pop() {
        let (id, least) = match item {
            Item::Text(text) => {
                f.write_str(text)?;
                continue;
            }
            Item::Integer(n) => {
                write!(f, "{n}")?;
                continue;
            }
            Item::Node(id, least) => (id, least),
        };
        if id != top
            && let Some(name) = names.get(&id)
        {
            f.write_str(name)?;
            continue;
        }
        let (binds, mut items) = match graph.node(id) {
            Node::Constant(bits) => {
                write_number(f, f64::from_bits(bits), least)?;
                continue;
            }
            Node::Variable(i) => {
                f.write_str(variables.get(i as usize).map_or("?", |name| name))?;
                continue;
            }
            Node::Operation(operation) => pieces(operation),
        };
        if binds < least {
            f.write_char('(')?;
            items.push(Item::Text(")"));
        }
        stack.extend(items.into_iter().rev());
    }
    Ok(())
}

/// How tightly an operation binds, and how it is written.
fn pieces(operation: Operation<Id>) -> (u8, Vec<Item>) {
    use Item::{Node, Text};
    match operation {
        Operation::Unary(Unary::Negate, a) => (MINUS, vec![Text("-"), Node(a, POWER)]),
        Operation::Unary(Unary::Square, a) => (POWER, vec![Node(a, ATOM), Text("^2")]),
        Operation::Unary(Unary::Cube, a) => (POWER, vec![Node(a, ATOM), Text("^3")]),
        Operation::Unary(Unary::Recip, a) => (PRODUCT, vec![Text("1/"), Node(a, MINUS)]),
        Operation::Unary(function, a) => {
            (ATOM, vec![Text(function.name()), Text("("), Node(a, SUM), Text(")")])
        }
        Operation::Binary(Binary::Add, a, b) => (SUM, vec![Node(a, SUM), Text(" + "), Node(b, PRODUCT)]),
        Operation::Binary(Binary::Subtract, a, b) => (SUM, vec![Node(a, SUM), Text(" - "), Node(b, PRODUCT)]),
        Operation::Binary(Binary::Multiply, a, b) => {
            (PRODUCT, vec![Node(a, PRODUCT), Text("*"), Node(b, MINUS)])
        }
        Operation::Binary(Binary::Divide, a, b) => {
            (PRODUCT, vec![Node(a, PRODUCT), Text("/"), Node(b, MINUS)])
        }
        Operation::Binary(Binary::Power, a, b) => (POWER, vec![Node(a, ATOM), Text("^"), Node(b, MINUS)]),
        Operation::Binary(function, a, b) => {
            (ATOM, vec![Text(function.name()), Text("("), Node(a, SUM), Text(", "), Node(b, SUM), Text(")")])
        }
        Operation::IntegerPower(a, n) => (POWER, vec![Node(a, ATOM), Text("^"), Item::Integer(n)]),
        Operation::Select(a, b, c) => {
            let comma = || Text(", ");
            (
                ATOM,
                vec![Text("select("), Node(a, SUM), comma(), Node(b, SUM), comma(), Node(c, SUM), Text(")")],
            )
        }
    }
}

/// A number, in parentheses where a sign or a quotient would bind too weakly.
fn write_number(f: &mut fmt::Formatter<'_>, x: f64, least: u8) -> fmt::Result {
    let (binds, text) = if x.is_nan() {
        (PRODUCT, "0/0".to_string())
    } else if x.is_infinite() {
        (PRODUCT, if x > 0.0 { "1/0" } else { "-1/0" }.to_string())
    } else {
        let usual = x == 0.0 || (1e-4..1e16).contains(&x.abs());
        let text = if usual { format!("{x}") } else { format!("{x:e}") };
        (if x.is_sign_negative() { MINUS } else { ATOM }, text)
    };
    if binds < least { write!(f, "({text})") } else { f.write_str(&text) }
}
