//! Which form of the elimination a mechanism is solved in, and why.
//!
//! Loops leave the sweep over the tree as it is: what plain recursion loses on the tree without its loops, heavy bodies on light ones,
//! the mixed form loses too. So the tree is measured, as [`FormChoice`] does it, and no new criterion is needed.

use super::form::ClosedForm;
use crate::error::ClosureError;
use phipsi_model::Model;
use phipsi_recursion::{DynamicsError, Form, FormChoice, Layout};
use std::fmt;

/// The form of the elimination of loops for a form of forward dynamics.
///
/// | form of forward dynamics | form of the elimination |
/// |---|---|
/// | [`Form::Auto`] | [`ClosedForm::Mixed`] where the tree needs the plain form only, otherwise [`ClosedForm::SquareRoot`] |
/// | [`Form::Plain`] | [`ClosedForm::Auto`]: squared rows where they are certain about the rank, otherwise the state again in the mixed form |
/// | [`Form::SquareRoot`] | [`ClosedForm::SquareRoot`] |
/// | [`Form::Refined`], [`Form::DoubleDouble`] | none |
///
/// Models with flexible bodies have the mixed form only.
///
/// # Accuracy
/// The square-root form keeps the digits of heavy bodies that hang between light ones. Of one next to the cut, ε × mass ratio is lost in
/// any form: the rows of the closure cancel on their way to it. The choice does not see that; `docs/src/loops.md` has numbers.
///
/// # Example
/// ```
/// use phipsi_closure::{ClosedForm, ClosedFormChoice};
/// use phipsi_recursion::Form;
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
/// let body = Body::new("crank", Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.1; 3]));
/// let hinge = Joint::new("hinge", JointKind::Continuous { axis: [0.0, 0.0, 1.0] });
/// let model = ModelBuilder::new("crank").body(body).joint(hinge, "world", "crank").build()?;
/// assert_eq!(ClosedFormChoice::new(&model, Form::Auto)?.form, ClosedForm::Mixed);
/// assert!(ClosedFormChoice::new(&model, Form::Refined).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosedFormChoice {
    /// The form.
    pub form: ClosedForm,
    /// What the tree without its loops was found to need, where nothing was asked for.
    pub tree: Option<FormChoice>,
    is_flexible: bool,
}

impl ClosedFormChoice {
    /// For a model, with its loops or without them.
    ///
    /// # Cost
    /// With [`Form::Auto`] that of [`FormChoice::of`], O(n), once per model; nothing otherwise.
    ///
    /// # Errors
    /// [`ClosureError::Form`] for a form that is for trees only; [`ClosureError::Dynamics`] for the square-root form of a model with
    /// flexible bodies.
    pub fn new(model: &Model, asked: Form) -> Result<Self, ClosureError> {
        let flexible = model.bodies().iter().find(|body| body.modes() > 0);
        let is_flexible = flexible.is_some();
        let (form, tree) = match asked {
            Form::Auto => {
                let open = model.clone().without_closures();
                let tree = FormChoice::of(&open, &Layout::new(&open));
                (Self::beside(tree.form, is_flexible), Some(tree))
            }
            Form::Plain if is_flexible => (ClosedForm::Mixed, None),
            Form::Plain => (ClosedForm::Auto, None),
            Form::SquareRoot => {
                if let Some(body) = flexible {
                    let (body, algorithm) = (body.name.clone(), "ClosedForm::SquareRoot");
                    return Err(DynamicsError::Flexible { body, algorithm }.into());
                }
                (ClosedForm::SquareRoot, None)
            }
            Form::Refined | Form::DoubleDouble => return Err(ClosureError::Form { found: asked }),
        };
        Ok(ClosedFormChoice { form, tree, is_flexible })
    }
    /// The form of the elimination that keeps the digits of a form of the tree.
    pub fn beside(tree: Form, is_flexible: bool) -> ClosedForm {
        match tree {
            Form::Auto | Form::Plain => ClosedForm::Mixed,
            _ if is_flexible => ClosedForm::Mixed,
            Form::Refined | Form::SquareRoot | Form::DoubleDouble => ClosedForm::SquareRoot,
        }
    }
    /// False where the tree loses digits and no form of the elimination saves them.
    pub fn is_sufficient(&self) -> bool {
        self.form != ClosedForm::Mixed || self.tree.is_none_or(|tree| tree.plain_error <= tree.limit)
    }
    /// Its name in results: "mixed", "square_root", or "plain" where squared rows are tried first.
    pub fn name(&self) -> &'static str {
        if self.form == ClosedForm::Auto { ClosedForm::Plain.name() } else { self.form.name() }
    }
    /// Why it is this form, for people.
    pub fn why(&self) -> String {
        match self.tree {
            Some(FormChoice { plain_error, limit, .. }) => {
                let found =
                    format!("error of the tree's plain recursion at the states tried {plain_error:.0e}");
                match self.is_sufficient() {
                    true if plain_error <= limit => format!("{found}, at most {limit:.0e}"),
                    true => format!("{found}, more than {limit:.0e}"),
                    false => format!("{found}, more than {limit:.0e}; flexible bodies have no other form"),
                }
            }
            None if self.is_flexible => "the form of flexible bodies".into(),
            None if self.form == ClosedForm::Auto => {
                "asked for; mixed where squares do not tell the rank".into()
            }
            None => "asked for".into(),
        }
    }
}

impl fmt::Display for ClosedFormChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.name(), self.why())
    }
}
