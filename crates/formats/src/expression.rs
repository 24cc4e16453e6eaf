//! Algebraic expressions with symbolic derivatives: functions of time in scenes, custom forces of OpenMM.
//!
//! The grammar is that of OpenMM's custom forces:
//!
//! | what | how |
//! |---|---|
//! | numbers | `2`, `.5`, `1e-3` |
//! | operators, loosest first | `+ -`, then `* /`, then the sign `-`, then `^`; all but `^` group to the left: −x^2 = −(x²), 2^3^2 = 2⁹ |
//! | functions of one argument | sqrt exp log sin cos tan sec csc cot asin acos atan sinh cosh tanh erf erfc step delta square cube recip abs floor ceil |
//! | of two | atan2(y, x), min, max |
//! | of three | select(c, x, y): x if c is not 0, otherwise y |
//! | definitions | after the expression, each using those after it: `a*b; b = a^2; a = 3` |
//!
//! step(x) is 1 for x ≥ 0 and 0 otherwise; delta(x) is 1 for x = 0 and 0 otherwise; log is the natural logarithm. A
//! definition hides a variable of the same name, a variable a constant. Unlike OpenMM's, NaN as an argument of step,
//! delta, min, max and a condition gives NaN.
//!
//! Equal subexpressions are computed once; operations on numbers are carried out when the expression is read; what
//! multiplies by 0 is 0, also where it is not finite.
//!
//! Source: OpenMM user guide, "Writing Custom Expressions".

mod derivative;
mod display;
mod error;
mod function;
mod graph;
mod parser;
mod program;
mod switch;
mod token;

pub use error::ExpressionError;

use graph::{Graph, Id};
use program::Program;
use std::fmt;
use std::sync::Arc;

/// A function of named variables.
///
/// [`fmt::Display`] writes it so that it reads back as the same function: equal values to the last bit.
///
/// # Example
/// ```
/// use phipsi_formats::Expression;
/// let f = Expression::parse("a*sin(2*pi*t); a = 0.5", &["t"], &[("pi", std::f64::consts::PI)])?;
/// assert_eq!(f.value(&[0.25]), 0.5);
/// assert_eq!(f.derivative("t").value(&[0.0]), std::f64::consts::PI);
/// let error = Expression::parse("2*tme", &["time"], &[]).unwrap_err();
/// assert_eq!((error.column, error.remedy.as_str()), (3, "did you mean `time`?"));
/// # Ok::<(), phipsi_formats::ExpressionError>(())
/// ```
#[derive(Clone)]
pub struct Expression {
    variables: Arc<[String]>,
    graph: Graph,
    root: Id,
    program: Program,
}

impl Expression {
    /// Reads an expression of these variables and constants.
    ///
    /// # Cost
    /// Linear in the length of the text; at most 1 MiB, 200 levels deep.
    ///
    /// # Errors
    /// [`ExpressionError`] at the first place where the text is no expression.
    pub fn parse(
        text: &str,
        variables: &[&str],
        constants: &[(&str, f64)],
    ) -> Result<Expression, ExpressionError> {
        let (graph, root) = parser::parse(text, variables, constants)?;
        Ok(Expression::new(variables.iter().map(|name| name.to_string()).collect(), &graph, root))
    }

    fn new(variables: Arc<[String]>, graph: &Graph, root: Id) -> Self {
        let (graph, root) = graph.pruned(root);
        let program = Program::new(&graph, root);
        Expression { variables, graph, root, program }
    }

    /// The value; `variables` in the order in which they were named. A missing one counts as NaN.
    ///
    /// # Cost
    /// One operation for each different subexpression. No allocation, unless more than 256 numbers are needed at once.
    ///
    /// # Accuracy
    /// Each operation is rounded once, xⁿ with a whole n up to 64 at most n times, sec, csc, cot twice; the functions
    /// are those of the platform.
    pub fn value(&self, variables: &[f64]) -> f64 {
        self.program.value(variables)
    }

    /// The derivative with respect to a variable; zero for a name that is not one.
    ///
    /// step, delta, floor and ceil have derivative 0 everywhere; at a kink abs has 0, min and max that of their first
    /// argument. x^y with a varying y needs x > 0.
    ///
    /// # Cost
    /// Linear in the number of different subexpressions, and so is the size of the result.
    pub fn derivative(&self, variable: &str) -> Expression {
        let mut graph = self.graph.clone();
        let index = (0u32..).zip(self.variables.iter()).filter(|(_, name)| *name == variable).last();
        let slope = index.and_then(|(i, _)| derivative::derivative(&mut graph, self.root, i));
        let root = slope.unwrap_or_else(|| graph.constant(0.0));
        Expression::new(self.variables.clone(), &graph, root)
    }

    /// Functions that change sign wherever this one has a kink or a jump (and perhaps elsewhere).
    ///
    /// ```
    /// use phipsi_formats::Expression;
    /// let ramp = Expression::parse("min(t/10, 1)", &["t"], &[])?;
    /// let [switch] = &ramp.switches()[..] else { panic!() };
    /// assert!(switch.value(&[9.9]) < 0.0 && switch.value(&[10.1]) > 0.0);
    /// # Ok::<(), phipsi_formats::ExpressionError>(())
    /// ```
    pub fn switches(&self) -> Vec<Expression> {
        let mut graph = self.graph.clone();
        let found = switch::switches(&mut graph);
        found.into_iter().map(|root| Expression::new(self.variables.clone(), &graph, root)).collect()
    }

    /// The variables in their order.
    pub fn variables(&self) -> &[String] {
        &self.variables
    }

    /// The number that it is, if it depends on no variable.
    pub fn as_constant(&self) -> Option<f64> {
        self.graph.as_constant(self.root)
    }

    /// True if its value takes this variable.
    pub fn depends_on(&self, variable: &str) -> bool {
        (0..self.graph.len() as Id).any(|id| match self.graph.node(id) {
            graph::Node::Variable(i) => self.variables.get(i as usize).is_some_and(|name| name == variable),
            _ => false,
        })
    }
}

impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        display::write(f, &self.graph, self.root, &self.variables)
    }
}

impl fmt::Debug for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Expression({:?}; {self})", self.variables)
    }
}

const _: () = {
    const fn send_and_sync<T: Send + Sync>() {}
    send_and_sync::<Expression>();
};
