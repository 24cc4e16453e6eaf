//! Expressions as flat lists of instructions on registers.

use super::graph::{Graph, Id, Node, Operation};

/// Registers that are kept on the stack for small programs, and for most others.
const FEW: usize = 16;
const MANY: usize = 256;

/// Where an instruction finds a number.
#[derive(Clone, Copy, Debug)]
enum Operand {
    Register(u32),
    Variable(u32),
    Number(f64),
}

#[derive(Clone, Copy, Debug)]
struct Instruction {
    operation: Operation<Operand>,
    register: u32,
}

/// A compiled expression.
#[derive(Clone, Debug)]
pub(super) struct Program {
    instructions: Box<[Instruction]>,
    result: Operand,
    registers: usize,
}

impl Program {
    /// Instructions in depth-first order; a register is free again after the last use of its number.
    ///
    /// # Cost
    /// O(nodes).
    pub(super) fn new(graph: &Graph, root: Id) -> Self {
        let mut uses = graph.uses(root);
        let mut places: Vec<Option<Operand>> = vec![None; graph.len()];
        let mut instructions = Vec::new();
        let (mut free, mut registers) = (Vec::new(), 0u32);
        let mut stack = vec![(root, false)];
        while let Some((id, ready)) = stack.pop() {
            if places[id as usize].is_some() {
                continue;
            }
            let operation = match graph.node(id) {
                Node::Constant(bits) => {
                    places[id as usize] = Some(Operand::Number(f64::from_bits(bits)));
                    continue;
                }
                Node::Variable(i) => {
                    places[id as usize] = Some(Operand::Variable(i));
                    continue;
                }
                Node::Operation(operation) => operation,
            };
            if !ready {
                stack.push((id, true));
                let first = stack.len();
                stack.extend(operation.arguments().map(|a| (a, false)));
                stack[first..].reverse();
                continue;
            }
            // All arguments have been placed: they came later on the stack than this node.
            let on_operands = operation.map(|a| places[a as usize].unwrap_or(Operand::Number(f64::NAN)));
            for argument in operation.arguments() {
                uses[argument as usize] -= 1;
                if let (0, Some(Operand::Register(r))) = (uses[argument as usize], places[argument as usize])
                {
                    free.push(r);
                }
            }
            let register = free.pop().unwrap_or_else(|| {
                registers += 1;
                registers - 1
            });
            instructions.push(Instruction { operation: on_operands, register });
            places[id as usize] = Some(Operand::Register(register));
        }
        let result = places[root as usize].unwrap_or(Operand::Number(f64::NAN));
        Program { instructions: instructions.into(), result, registers: registers as usize }
    }

    /// The value at these variables; a missing one counts as NaN.
    pub(super) fn value(&self, variables: &[f64]) -> f64 {
        match self.registers {
            n if n <= FEW => self.run(variables, &mut [0.0; FEW]),
            n if n <= MANY => self.run(variables, &mut [0.0; MANY]),
            n => self.run(variables, &mut vec![0.0; n]),
        }
    }

    fn run(&self, variables: &[f64], registers: &mut [f64]) -> f64 {
        let get = |registers: &[f64], operand| match operand {
            Operand::Register(r) => registers[r as usize],
            Operand::Variable(i) => variables.get(i as usize).copied().unwrap_or(f64::NAN),
            Operand::Number(x) => x,
        };
        for instruction in &self.instructions {
            let value = instruction.operation.value(|operand| get(registers, operand));
            registers[instruction.register as usize] = value;
        }
        get(registers, self.result)
    }
}
