//! Operators as they are written: φ M φ*.

use super::{Node, Operator};
use phipsi_spatial::Real;
use std::fmt;

/// As a factor or under an exponent.
pub(super) fn in_brackets<T: Real>(a: &Operator<T>) -> String {
    match &a.node {
        Node::Leaf { .. } => a.to_string(),
        _ => format!("({a})"),
    }
}

impl<T: Real> fmt::Display for Operator<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.node {
            Node::Leaf { name, adjoint, .. } => {
                // (I + E)*, but φ*.
                let compound = name.contains(' ') && !(name.starts_with('(') && name.ends_with(')'));
                match (adjoint, compound) {
                    (false, _) => write!(f, "{name}"),
                    (true, false) => write!(f, "{name}*"),
                    (true, true) => write!(f, "({name})*"),
                }
            }
            Node::Scaled(s, a) => match (s.to_f64(), &a.node) {
                (-1.0, Node::Sum(_)) => write!(f, "−({a})"),
                (-1.0, _) => write!(f, "−{a}"),
                (s, Node::Sum(_)) => write!(f, "{s} ({a})"),
                (s, _) => write!(f, "{s} {a}"),
            },
            Node::Sum(terms) => {
                for (i, term) in terms.iter().enumerate() {
                    let text = term.to_string();
                    match (i, text.strip_prefix('−')) {
                        (0, _) => write!(f, "{text}")?,
                        (_, Some(positive)) => write!(f, " − {positive}")?,
                        (_, None) => write!(f, " + {text}")?,
                    }
                }
                Ok(())
            }
            Node::Product(factors) => {
                for (i, factor) in factors.iter().enumerate() {
                    let space = if i == 0 { "" } else { " " };
                    match &factor.node {
                        Node::Sum(_) | Node::Scaled(..) => write!(f, "{space}({factor})")?,
                        _ => write!(f, "{space}{factor}")?,
                    }
                }
                Ok(())
            }
            Node::Mismatch(error) => write!(f, "[{error}]"),
        }
    }
}
