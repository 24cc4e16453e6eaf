//! Symbolic derivatives of graphs.
//!
//! | f | ∂f | at a kink or jump |
//! |---|---|---|
//! | step, delta, floor, ceil | 0 | 0 |
//! | abs x | step(x) − step(−x) | 0 |
//! | min(x, y) | that of x where x ≤ y, else of y | of x |
//! | max(x, y) | that of x where x ≥ y, else of y | of x |
//! | select(c, x, y) | that of the selected one | |
//! | x^y | y x^(y−1) ∂x + x^y log(x) ∂y | a term with ∂x = 0 or ∂y = 0 everywhere is left out |

use super::function::{Binary, Unary};
use super::graph::{Graph, Id, Node, Operation};
use std::f64::consts::FRAC_2_SQRT_PI;

/// The derivative of `root` with respect to a variable, in the same graph; `None` where it is zero everywhere.
///
/// # Cost
/// O(nodes): one pass, arguments first.
pub(super) fn derivative(graph: &mut Graph, root: Id, variable: u32) -> Option<Id> {
    let mut slopes: Vec<Option<Id>> = Vec::with_capacity(root as usize + 1);
    for id in 0..=root {
        let slope = match graph.node(id) {
            Node::Constant(_) => None,
            Node::Variable(i) => (i == variable).then(|| graph.constant(1.0)),
            Node::Operation(operation) => {
                let slope = |a: Id| slopes.get(a as usize).copied().flatten();
                of_operation(graph, id, operation, slope)
            }
        };
        slopes.push(slope);
    }
    slopes.pop().flatten()
}

/// ∂ of the operation `id`, given those of its arguments.
fn of_operation(
    g: &mut Graph,
    id: Id,
    operation: Operation<Id>,
    slope: impl Fn(Id) -> Option<Id>,
) -> Option<Id> {
    match operation {
        Operation::Unary(f, x) => {
            let dx = slope(x)?;
            let df = of_function(g, f, x, id)?;
            Some(g.binary(Binary::Multiply, df, dx))
        }
        Operation::IntegerPower(x, n) => {
            let dx = slope(x)?;
            let df = power_slope(g, x, f64::from(n));
            Some(g.binary(Binary::Multiply, df, dx))
        }
        Operation::Binary(f, x, y) => of_binary(g, id, f, [x, y], [slope(x), slope(y)]),
        Operation::Select(c, x, y) => choose(g, c, slope(x), slope(y)),
    }
}

/// df/dx of f(x), whose node is `fx`.
fn of_function(g: &mut Graph, f: Unary, x: Id, fx: Id) -> Option<Id> {
    let one = g.constant(1.0);
    Some(match f {
        Unary::Negate => g.constant(-1.0),
        Unary::Sqrt => {
            let half = g.constant(0.5);
            g.binary(Binary::Divide, half, fx)
        }
        Unary::Exp => fx,
        Unary::Log => g.unary(Unary::Recip, x),
        Unary::Sin => g.unary(Unary::Cos, x),
        Unary::Cos => {
            let sine = g.unary(Unary::Sin, x);
            g.unary(Unary::Negate, sine)
        }
        Unary::Tan => {
            let square = g.unary(Unary::Square, fx);
            g.binary(Binary::Add, one, square)
        }
        Unary::Cot => {
            let square = g.unary(Unary::Square, fx);
            let sum = g.binary(Binary::Add, one, square);
            g.unary(Unary::Negate, sum)
        }
        Unary::Sec => {
            let tangent = g.unary(Unary::Tan, x);
            g.binary(Binary::Multiply, fx, tangent)
        }
        Unary::Csc => {
            let cotangent = g.unary(Unary::Cot, x);
            let product = g.binary(Binary::Multiply, fx, cotangent);
            g.unary(Unary::Negate, product)
        }
        Unary::Asin | Unary::Acos => {
            // (1 − x)(1 + x) does not cancel near ±1 as 1 − x² does.
            let less = g.binary(Binary::Subtract, one, x);
            let more = g.binary(Binary::Add, one, x);
            let product = g.binary(Binary::Multiply, less, more);
            let root = g.unary(Unary::Sqrt, product);
            let slope = g.unary(Unary::Recip, root);
            if f == Unary::Asin { slope } else { g.unary(Unary::Negate, slope) }
        }
        Unary::Atan => {
            let square = g.unary(Unary::Square, x);
            let sum = g.binary(Binary::Add, one, square);
            g.unary(Unary::Recip, sum)
        }
        Unary::Sinh => g.unary(Unary::Cosh, x),
        Unary::Cosh => g.unary(Unary::Sinh, x),
        Unary::Tanh => {
            // 1 − tanh² cancels for large |x|.
            let cosine = g.unary(Unary::Cosh, x);
            let secant = g.unary(Unary::Recip, cosine);
            g.unary(Unary::Square, secant)
        }
        Unary::Erf | Unary::Erfc => {
            let square = g.unary(Unary::Square, x);
            let minus = g.unary(Unary::Negate, square);
            let bell = g.unary(Unary::Exp, minus);
            let scale = g.constant(if f == Unary::Erf { FRAC_2_SQRT_PI } else { -FRAC_2_SQRT_PI });
            g.binary(Binary::Multiply, scale, bell)
        }
        Unary::Step | Unary::Delta | Unary::Floor | Unary::Ceil => return None,
        Unary::Square => power_slope(g, x, 2.0),
        Unary::Cube => power_slope(g, x, 3.0),
        Unary::Recip => power_slope(g, x, -1.0),
        Unary::Abs => {
            let minus = g.unary(Unary::Negate, x);
            let (right, left) = (g.unary(Unary::Step, x), g.unary(Unary::Step, minus));
            g.binary(Binary::Subtract, right, left)
        }
    })
}

/// n xⁿ⁻¹.
fn power_slope(g: &mut Graph, x: Id, n: f64) -> Id {
    let (factor, power) = (g.constant(n), g.power(x, n - 1.0));
    g.binary(Binary::Multiply, factor, power)
}

fn of_binary(g: &mut Graph, id: Id, f: Binary, [x, y]: [Id; 2], [dx, dy]: [Option<Id>; 2]) -> Option<Id> {
    if dx.is_none() && dy.is_none() {
        return None;
    }
    let product = |g: &mut Graph, a: Id, b: Option<Id>| b.map(|b| g.binary(Binary::Multiply, a, b));
    match f {
        Binary::Add => sum(g, dx, dy),
        Binary::Subtract => difference(g, dx, dy),
        Binary::Multiply => {
            let (left, right) = (product(g, y, dx), product(g, x, dy));
            sum(g, left, right)
        }
        Binary::Divide => {
            // (∂x − (x/y) ∂y) / y: no square of y, which may overflow.
            let right = product(g, id, dy);
            let numerator = difference(g, dx, right)?;
            Some(g.binary(Binary::Divide, numerator, y))
        }
        Binary::Power => {
            let left = dx.map(|dx| {
                let exponent = match g.as_constant(y) {
                    Some(number) => g.constant(number - 1.0),
                    None => {
                        let one = g.constant(1.0);
                        g.binary(Binary::Subtract, y, one)
                    }
                };
                let power = g.binary(Binary::Power, x, exponent);
                let factor = g.binary(Binary::Multiply, y, power);
                g.binary(Binary::Multiply, factor, dx)
            });
            let right = dy.map(|dy| {
                let log = g.unary(Unary::Log, x);
                let factor = g.binary(Binary::Multiply, id, log);
                g.binary(Binary::Multiply, factor, dy)
            });
            sum(g, left, right)
        }
        Binary::Atan2 => {
            // atan2(x, y): (y ∂x − x ∂y) / (x² + y²).
            let (left, right) = (product(g, y, dx), product(g, x, dy));
            let numerator = difference(g, left, right)?;
            let (xx, yy) = (g.unary(Unary::Square, x), g.unary(Unary::Square, y));
            let denominator = g.binary(Binary::Add, xx, yy);
            Some(g.binary(Binary::Divide, numerator, denominator))
        }
        Binary::Min | Binary::Max => {
            let (low, high) = if f == Binary::Min { (x, y) } else { (y, x) };
            let gap = g.binary(Binary::Subtract, high, low);
            let first = g.unary(Unary::Step, gap);
            choose(g, first, dx, dy)
        }
    }
}

fn sum(g: &mut Graph, a: Option<Id>, b: Option<Id>) -> Option<Id> {
    match (a, b) {
        (Some(a), Some(b)) => Some(g.binary(Binary::Add, a, b)),
        (one, other) => one.or(other),
    }
}

fn difference(g: &mut Graph, a: Option<Id>, b: Option<Id>) -> Option<Id> {
    match (a, b) {
        (Some(a), Some(b)) => Some(g.binary(Binary::Subtract, a, b)),
        (a, None) => a,
        (None, Some(b)) => Some(g.unary(Unary::Negate, b)),
    }
}

/// The first where the condition is not zero, otherwise the second.
fn choose(g: &mut Graph, condition: Id, a: Option<Id>, b: Option<Id>) -> Option<Id> {
    if a.is_none() && b.is_none() {
        return None;
    }
    let zero = g.constant(0.0);
    Some(g.select(condition, a.unwrap_or(zero), b.unwrap_or(zero)))
}
