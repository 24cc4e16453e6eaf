//! Why a text is no expression.

use std::fmt;

/// The first place where a text is no expression.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExpressionError {
    /// Character in the text, from 1.
    pub column: usize,
    /// What was found.
    pub found: String,
    /// What is required.
    pub required: String,
    /// What to do.
    pub remedy: String,
}

impl fmt::Display for ExpressionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ExpressionError { column, found, required, remedy } = self;
        write!(f, "column {column}: {found}; required: {required}; {remedy}")
    }
}

impl std::error::Error for ExpressionError {}
