//! Where an expression is not smooth: functions whose change of sign is a kink or a jump.
//!
//! | operation | changes where this changes sign |
//! |---|---|
//! | step x, delta x, abs x | x |
//! | min(x, y), max(x, y) | x − y |
//! | floor x, ceil x | sin(π x) |

use super::function::{Binary, Unary};
use super::graph::{Graph, Id, Node, Operation};

/// The switching functions of all operations, in the same graph. A condition of `select` counts by what it is made of.
pub(super) fn switches(graph: &mut Graph) -> Vec<Id> {
    let mut found = Vec::new();
    for id in 0..graph.len() as Id {
        let Node::Operation(operation) = graph.node(id) else { continue };
        match operation {
            Operation::Unary(Unary::Step | Unary::Delta | Unary::Abs, x) => found.push(x),
            Operation::Unary(Unary::Floor | Unary::Ceil, x) => {
                let pi = graph.constant(std::f64::consts::PI);
                let turned = graph.binary(Binary::Multiply, pi, x);
                found.push(graph.unary(Unary::Sin, turned));
            }
            Operation::Binary(Binary::Min | Binary::Max, x, y) => {
                found.push(graph.binary(Binary::Subtract, x, y));
            }
            _ => {}
        }
    }
    found.sort_unstable();
    found.dedup();
    found
}
