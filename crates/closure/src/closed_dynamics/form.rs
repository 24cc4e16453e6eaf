//! The forms of the elimination, and which of them a state is solved in.

use super::ClosedDynamics;
use super::square_root::SquareRoot;
use crate::compiled::Number;
use crate::error::ClosureError;
use crate::factors::{Doubt, Plain, Regard};
use std::fmt;

/// Forms of the elimination of loops.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ClosedForm {
    /// The plain form where it is certain about the rank, otherwise the state again in the mixed form.
    Auto,
    /// Rows of the loops unsquared, by QR: any rank, down to σ of rounding.
    #[default]
    Mixed,
    /// Rows of the loops squared, by Cholesky's factorisation: the fewest operations. Kept are pivots σ² above 1e-8 of their loop's scale;
    /// left out are only rows that are zero by themselves. Any other row is an error.
    Plain,
    /// Bodies as rows of a sum of squares, by QR, and loops as in the mixed form: for heavy bodies on light ones.
    SquareRoot,
}

impl ClosedForm {
    /// Its name in results.
    pub fn name(self) -> &'static str {
        match self {
            ClosedForm::Auto => "auto",
            ClosedForm::Mixed => "mixed",
            ClosedForm::Plain => "plain",
            ClosedForm::SquareRoot => "square_root",
        }
    }
}

impl fmt::Display for ClosedForm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl<T: Number> ClosedDynamics<T> {
    /// The same, solved in another form by [`ClosedDynamics::run`]; projections and assembly are always mixed, and so are models with
    /// flexible bodies unless the plain or the square-root form is demanded, which they refuse.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`] for the plain or the square-root form of a model with flexible bodies.
    pub fn with_form(mut self, form: ClosedForm) -> Result<Self, ClosureError> {
        match form {
            ClosedForm::Plain => self.layout.check_rigid("ClosedForm::Plain")?,
            ClosedForm::SquareRoot => self.layout.check_rigid("ClosedForm::SquareRoot")?,
            ClosedForm::Auto | ClosedForm::Mixed => {}
        }
        let rigid = !self.layout.is_flexible();
        self.form = if rigid { form } else { ClosedForm::Mixed };
        self.factors.plain = match self.form {
            ClosedForm::Mixed | ClosedForm::SquareRoot => Plain::none(),
            ClosedForm::Auto | ClosedForm::Plain => Plain::new(&self.structure, &self.tree),
        };
        let square = self.form == ClosedForm::SquareRoot;
        self.square_root = square.then(|| SquareRoot::new(&self.model, &self.layout));
        Ok(self)
    }
    /// The form that was asked for.
    pub fn form(&self) -> ClosedForm {
        self.form
    }
    /// Factors in the form that was asked for, or in that which is left.
    pub(super) fn factor(&mut self, active: Option<&[bool]>) -> Result<(), ClosureError> {
        let trees = (&self.layout, &self.tree);
        if matches!(self.form, ClosedForm::Auto | ClosedForm::Plain) {
            let doubt = self.factors.update_plain(&self.structure, trees, &self.frames, active)?;
            match doubt {
                None => return Ok(()),
                Some(doubt) if self.form == ClosedForm::Plain => return Err(self.doubtful(&doubt)),
                Some(_) => {}
            }
        }
        Ok(self.factors.update(&self.structure, trees, &self.frames, active, Regard::Error)?)
    }
    fn doubtful(&self, doubt: &Doubt) -> ClosureError {
        let closure = self.structure.loops[doubt.closure].name.clone();
        ClosureError::PlainForm { closure, row: doubt.row, pivot: doubt.pivot }
    }
    /// The form that the last state was solved in.
    pub(super) fn used_form(&self) -> ClosedForm {
        match self.form {
            ClosedForm::SquareRoot => ClosedForm::SquareRoot,
            _ if self.factors.plain.used => ClosedForm::Plain,
            _ => ClosedForm::Mixed,
        }
    }
}
