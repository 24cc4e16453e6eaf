//! Expressions as directed graphs without duplicates: equal subexpressions are one node.

use super::function::{Binary, Unary, integer_power, select};
use std::collections::HashMap;

/// Position of a node; arguments come before what uses them.
pub(super) type Id = u32;

/// Largest |n| for which xⁿ is computed by multiplications.
const LARGEST_INTEGER_POWER: f64 = 64.0;

/// An operation on arguments of any kind: nodes of a graph, registers of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Operation<A> {
    Unary(Unary, A),
    Binary(Binary, A, A),
    IntegerPower(A, i32),
    /// The second if the first is not zero, otherwise the third.
    Select(A, A, A),
}

impl<A: Copy> Operation<A> {
    /// What it uses.
    pub(super) fn arguments(self) -> impl Iterator<Item = A> {
        let [a, b, c] = match self {
            Operation::Unary(_, a) | Operation::IntegerPower(a, _) => [Some(a), None, None],
            Operation::Binary(_, a, b) => [Some(a), Some(b), None],
            Operation::Select(a, b, c) => [Some(a), Some(b), Some(c)],
        };
        a.into_iter().chain(b).chain(c)
    }
    /// The same operation on other arguments.
    pub(super) fn map<B>(self, mut to: impl FnMut(A) -> B) -> Operation<B> {
        match self {
            Operation::Unary(f, a) => Operation::Unary(f, to(a)),
            Operation::Binary(f, a, b) => Operation::Binary(f, to(a), to(b)),
            Operation::IntegerPower(a, n) => Operation::IntegerPower(to(a), n),
            Operation::Select(a, b, c) => Operation::Select(to(a), to(b), to(c)),
        }
    }
    /// Its value.
    #[inline]
    pub(super) fn value(self, argument: impl Fn(A) -> f64) -> f64 {
        match self {
            Operation::Unary(f, a) => f.value(argument(a)),
            Operation::Binary(f, a, b) => f.value(argument(a), argument(b)),
            Operation::IntegerPower(a, n) => integer_power(argument(a), n),
            Operation::Select(c, a, b) => select(argument(c), argument(a), argument(b)),
        }
    }
}

/// A number, a variable, or an operation on earlier nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Node {
    /// Bits of the number, so that equal ones are found.
    Constant(u64),
    Variable(u32),
    Operation(Operation<Id>),
}

impl Node {
    /// The nodes that it uses.
    pub(super) fn arguments(self) -> impl Iterator<Item = Id> {
        let operation = match self {
            Node::Operation(operation) => Some(operation),
            _ => None,
        };
        operation.into_iter().flat_map(Operation::arguments)
    }
}

/// Nodes, arguments first. Operations on numbers are carried out, and those that change nothing are left out.
#[derive(Clone, Debug, Default)]
pub(super) struct Graph {
    nodes: Vec<Node>,
    known: HashMap<Node, Id>,
}

impl Graph {
    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }
    pub(super) fn node(&self, id: Id) -> Node {
        self.nodes[id as usize]
    }
    /// The number that a node is, if it is one.
    pub(super) fn as_constant(&self, id: Id) -> Option<f64> {
        match self.node(id) {
            Node::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    fn intern(&mut self, node: Node) -> Id {
        let next = self.nodes.len() as Id;
        let id = *self.known.entry(node).or_insert(next);
        if id == next {
            self.nodes.push(node);
        }
        id
    }
    fn operation(&mut self, operation: Operation<Id>) -> Id {
        self.intern(Node::Operation(operation))
    }
    pub(super) fn constant(&mut self, x: f64) -> Id {
        self.intern(Node::Constant(x.to_bits()))
    }
    pub(super) fn variable(&mut self, index: u32) -> Id {
        self.intern(Node::Variable(index))
    }
    pub(super) fn unary(&mut self, function: Unary, a: Id) -> Id {
        if let Some(x) = self.as_constant(a) {
            return self.constant(function.value(x));
        }
        match (function, self.node(a)) {
            (Unary::Negate, Node::Operation(Operation::Unary(Unary::Negate, inner))) => inner,
            _ => self.operation(Operation::Unary(function, a)),
        }
    }
    pub(super) fn binary(&mut self, function: Binary, a: Id, b: Id) -> Id {
        let (x, y) = (self.as_constant(a), self.as_constant(b));
        if let (Some(x), Some(y)) = (x, y) {
            return self.constant(function.value(x, y));
        }
        let is = |value: Option<f64>, number: f64| value == Some(number);
        match function {
            Binary::Add if is(x, 0.0) => b,
            Binary::Add | Binary::Subtract if is(y, 0.0) => a,
            Binary::Subtract if is(x, 0.0) => self.unary(Unary::Negate, b),
            Binary::Multiply if is(x, 0.0) || is(y, 0.0) => self.constant(0.0),
            Binary::Divide if is(x, 0.0) => self.constant(0.0),
            Binary::Multiply if is(x, 1.0) => b,
            Binary::Multiply | Binary::Divide if is(y, 1.0) => a,
            Binary::Multiply if is(x, -1.0) => self.unary(Unary::Negate, b),
            Binary::Multiply | Binary::Divide if is(y, -1.0) => self.unary(Unary::Negate, a),
            Binary::Divide if is(x, 1.0) => self.unary(Unary::Recip, b),
            Binary::Power if is(x, 1.0) => self.constant(1.0),
            Binary::Power => match y {
                Some(y) => self.power(a, y),
                None => self.operation(Operation::Binary(function, a, b)),
            },
            // Sums and products in either order are the same number, and so the same node.
            Binary::Add | Binary::Multiply => self.operation(Operation::Binary(function, a.min(b), a.max(b))),
            _ => self.operation(Operation::Binary(function, a, b)),
        }
    }
    /// x^y with a number y.
    pub(super) fn power(&mut self, a: Id, y: f64) -> Id {
        if let Some(x) = self.as_constant(a) {
            return self.constant(x.powf(y));
        }
        match y {
            0.0 => self.constant(1.0),
            1.0 => a,
            2.0 => self.unary(Unary::Square, a),
            3.0 => self.unary(Unary::Cube, a),
            -1.0 => self.unary(Unary::Recip, a),
            0.5 => self.unary(Unary::Sqrt, a),
            y if y.abs() <= LARGEST_INTEGER_POWER && y.fract() == 0.0 => {
                self.operation(Operation::IntegerPower(a, y as i32))
            }
            y => {
                let exponent = self.constant(y);
                self.operation(Operation::Binary(Binary::Power, a, exponent))
            }
        }
    }
    pub(super) fn select(&mut self, c: Id, a: Id, b: Id) -> Id {
        match self.as_constant(c) {
            Some(x) if x.is_nan() => c,
            Some(x) => [a, b][usize::from(x == 0.0)],
            None => self.operation(Operation::Select(c, a, b)),
        }
    }

    /// How often each node is used by nodes that the root needs; 0 for nodes that it does not need.
    pub(super) fn uses(&self, root: Id) -> Vec<u32> {
        let mut uses = vec![0u32; root as usize + 1];
        uses[root as usize] = 1;
        for id in (0..=root).rev() {
            if uses[id as usize] > 0 {
                for argument in self.node(id).arguments() {
                    uses[argument as usize] += 1;
                }
            }
        }
        uses
    }
    /// A graph with the root and what it needs only.
    pub(super) fn pruned(&self, root: Id) -> (Graph, Id) {
        let uses = self.uses(root);
        let mut graph = Graph::default();
        let mut moved = vec![0 as Id; uses.len()];
        for id in (0..=root).filter(|&id| uses[id as usize] > 0) {
            let node = match self.node(id) {
                Node::Operation(operation) => Node::Operation(operation.map(|a| moved[a as usize])),
                leaf => leaf,
            };
            moved[id as usize] = graph.intern(node);
        }
        (graph, moved[root as usize])
    }
}
