//! Which form of the elimination a mechanism is solved in, and why.
//!
//! Loops leave the sweep over the tree as it is: what plain recursion loses on the tree without its loops, heavy bodies on light ones,
//! the mixed form loses too. So the tree is measured, as [`FormChoice`] does it; then the mechanism with its loops, for what is lost
//! where they are closed.

use super::form::ClosedForm;
use super::loss::{HeavyBody, least_loss};
use crate::error::ClosureError;
use phipsi_model::Model;
use phipsi_recursion::{DynamicsError, Form, FormChoice, Layout};
use std::fmt;

/// The form of the elimination of loops for a form of forward dynamics.
///
/// | form of forward dynamics | form of the elimination |
/// |---|---|
/// | [`Form::Auto`] | [`ClosedForm::Mixed`] where the tree needs the plain form only, otherwise [`ClosedForm::SquareRoot`]; the other one where that loses less with the loops closed |
/// | [`Form::Plain`] | [`ClosedForm::Auto`]: squared rows where they are certain about the rank, otherwise the state again in the mixed form |
/// | [`Form::SquareRoot`] | [`ClosedForm::SquareRoot`] |
/// | [`Form::Refined`], [`Form::DoubleDouble`] | none |
///
/// Models with flexible bodies have the mixed form only.
///
/// # Accuracy
/// The square-root form keeps the digits of heavy bodies that hang between light ones. Of one next to the cut, ε × mass ratio is lost in
/// any form: the rows of the closure cancel on their way to it. [`Self::is_sufficient`] says so, and [`Self::heavy`] which body it may be;
/// `docs/src/loops.md` has numbers.
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
#[derive(Clone, Debug, PartialEq)]
pub struct ClosedFormChoice {
    /// The form.
    pub form: ClosedForm,
    /// What the tree without its loops was found to need, where nothing was asked for.
    pub tree: Option<FormChoice>,
    /// Largest relative error with the loops closed at the states that were tried; `None` where nothing was measured.
    pub closed_error: Option<f64>,
    /// Where that is above the limit: the body that is the heaviest beside the lightest one of its loop.
    pub heavy: Option<HeavyBody>,
    is_flexible: bool,
}

impl ClosedFormChoice {
    /// For a model, with its loops or without them.
    ///
    /// # Cost
    /// With [`Form::Auto`] that of [`FormChoice::of`], and six evaluations of the mixed and of the square-root form; where those differ,
    /// six more in double-double numbers. Once per model; nothing otherwise.
    ///
    /// # Errors
    /// [`ClosureError::Form`] for a form that is for trees only; [`ClosureError::Dynamics`] for the square-root form of a model with
    /// flexible bodies.
    pub fn new(model: &Model, asked: Form) -> Result<Self, ClosureError> {
        let flexible = model.bodies().iter().find(|body| body.modes() > 0);
        let is_flexible = flexible.is_some();
        let form = match asked {
            Form::Auto => {
                let open = model.clone().without_closures();
                let tree = FormChoice::of(&open, &Layout::new(&open));
                let preferred = Self::beside(tree.form, is_flexible);
                let measured = least_loss(model, preferred, tree.limit)?;
                let form = measured.map_or(preferred, |m| m.0);
                let closed_error = measured.map(|m| m.1);
                let heavy = closed_error.filter(|e| *e > tree.limit).and_then(|_| HeavyBody::of(model));
                return Ok(ClosedFormChoice { form, tree: Some(tree), closed_error, heavy, is_flexible });
            }
            Form::Plain if is_flexible => ClosedForm::Mixed,
            Form::Plain => ClosedForm::Auto,
            Form::SquareRoot => {
                if let Some(body) = flexible {
                    let (body, algorithm) = (body.name.clone(), "ClosedForm::SquareRoot");
                    return Err(DynamicsError::Flexible { body, algorithm }.into());
                }
                ClosedForm::SquareRoot
            }
            Form::Refined | Form::DoubleDouble => return Err(ClosureError::Form { found: asked }),
        };
        Ok(ClosedFormChoice { form, tree: None, closed_error: None, heavy: None, is_flexible })
    }
    /// The form of the elimination that keeps the digits of a form of the tree.
    pub fn beside(tree: Form, is_flexible: bool) -> ClosedForm {
        match tree {
            Form::Auto | Form::Plain => ClosedForm::Mixed,
            _ if is_flexible => ClosedForm::Mixed,
            Form::Refined | Form::SquareRoot | Form::DoubleDouble => ClosedForm::SquareRoot,
        }
    }
    /// Largest error that was measured in this form, with the loops closed, of flexible bodies also of the tree without them; 0 where
    /// nothing was measured.
    pub fn error(&self) -> f64 {
        let tree = self.tree.filter(|_| self.is_flexible).map_or(0.0, |tree| tree.plain_error);
        self.closed_error.map_or(tree, |closed| closed.max(tree))
    }
    /// False where digits are lost that no form of the elimination saves.
    pub fn is_sufficient(&self) -> bool {
        self.tree.is_none_or(|tree| self.error() <= tree.limit)
    }
    /// Its name in results: "mixed", "square_root", or "plain" where squared rows are tried first.
    pub fn name(&self) -> &'static str {
        if self.form == ClosedForm::Auto { ClosedForm::Plain.name() } else { self.form.name() }
    }
    /// Why it is this form, for people.
    pub fn why(&self) -> String {
        match self.tree {
            Some(FormChoice { form: tree_form, plain_error, limit, .. }) => {
                let of_tree =
                    format!("error of the tree's plain recursion at the states tried {plain_error:.0e}");
                match self.closed_error {
                    Some(error) if error > limit => {
                        let found = format!(
                            "error at the states tried {error:.0e}, more than {limit:.0e}; no form has less"
                        );
                        self.heavy.as_ref().map_or(found.clone(), |heavy| format!("{found}; {heavy}"))
                    }
                    _ if !self.is_sufficient() => {
                        format!("{of_tree}, more than {limit:.0e}; flexible bodies have no other form")
                    }
                    Some(error) if self.form != Self::beside(tree_form, self.is_flexible) => {
                        format!(
                            "error at the states tried {error:.0e} with the loops closed, less than in the other form"
                        )
                    }
                    _ if plain_error <= limit => format!("{of_tree}, at most {limit:.0e}"),
                    _ => format!("{of_tree}, more than {limit:.0e}"),
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
