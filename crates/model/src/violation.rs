//! Conditions that a model must meet, each with what was found, what is required and what to do.

use std::fmt;

/// How bad a violation is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The model is usable; a strict reader refuses it.
    Warning,
    /// The model cannot be used.
    Error,
}

/// What a violation is about, by the user's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Subject {
    /// The whole model.
    Model,
    /// A body (URDF: link).
    Body(String),
    /// A joint.
    Joint(String),
    /// A closure.
    Closure(String),
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Subject::Model => write!(f, "model"),
            Subject::Body(name) => write!(f, "body `{name}`"),
            Subject::Joint(name) => write!(f, "joint `{name}`"),
            Subject::Closure(name) => write!(f, "closure `{name}`"),
        }
    }
}

/// One violated condition.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// Body or joint.
    pub subject: Subject,
    /// Error or warning.
    pub severity: Severity,
    /// What was found.
    pub found: String,
    /// What is required.
    pub required: String,
    /// What to do.
    pub remedy: String,
}

impl Violation {
    /// An error.
    pub fn error(
        subject: Subject,
        found: impl Into<String>,
        required: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let (found, required, remedy) = (found.into(), required.into(), remedy.into());
        Violation { subject, severity: Severity::Error, found, required, remedy }
    }
    /// The same as a warning.
    pub fn as_warning(mut self) -> Self {
        self.severity = Severity::Warning;
        self
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}; required: {}; {}", self.subject, self.found, self.required, self.remedy)
    }
}

/// Everything that is wrong with a model: at least one error.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelErrors(pub Vec<Violation>);

impl fmt::Display for ModelErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, violation) in self.0.iter().enumerate() {
            write!(f, "{}{violation}", if i > 0 { "\n" } else { "" })?;
        }
        Ok(())
    }
}

impl std::error::Error for ModelErrors {}
