//! The form of forward dynamics: of a tree, or of loops and prescribed motions.

use super::{Dynamics, MotionError, Solver};
use phipsi_closure::{ClosedForm, ClosedFormChoice};
use phipsi_model::Model;
use phipsi_recursion::{Form, FormChoice, FormForwardDynamics, Layout};

impl Dynamics {
    /// Another form of forward dynamics than the plan's; of loops and prescribed motions that of [`ClosedFormChoice`].
    ///
    /// # Errors
    /// [`MotionError::Closure`] for a form that mechanisms with loops or prescribed motions do not have, [`MotionError::Dynamics`] for
    /// one that flexible bodies do not have; nothing has changed then.
    pub fn set_form(&mut self, form: Form) -> Result<(), MotionError> {
        if form == self.plan.form {
            return Ok(());
        }
        match &mut self.solver {
            Solver::Tree(tree) => (*tree, self.form_choice) = forward(&self.model, &self.layout, form),
            Solver::Constrained(_) => {
                self.closed_choice = Some(ClosedFormChoice::new(&self.model, form)?);
            }
        }
        self.plan.form = form;
        self.spread_form()
    }
    /// Takes the form over to what closes loops and holds joints.
    pub(super) fn spread_form(&mut self) -> Result<(), MotionError> {
        let of_tree = ClosedFormChoice::beside(self.form(), self.layout.is_flexible());
        let form = self.closed_choice.as_ref().map_or(of_tree, |choice| choice.form);
        self.constraints().map_or(Ok(()), |constraints| Ok(constraints.set_form(form)?))
    }
    /// The form that runs, of loops and prescribed motions the one that asks for it; never [`Form::Auto`].
    pub fn form(&self) -> Form {
        match (&self.solver, &self.closed_choice) {
            (Solver::Tree(forward), _) => forward.form(),
            (_, Some(choice)) if choice.form == ClosedForm::SquareRoot => Form::SquareRoot,
            _ => Form::Plain,
        }
    }
    /// The form of loops and prescribed motions, and why; `None` of a tree without them.
    pub fn closed_form_choice(&self) -> Option<&ClosedFormChoice> {
        self.closed_choice.as_ref()
    }
    /// Why this form, where the plan's is [`Form::Auto`].
    pub fn form_choice(&self) -> Option<&FormChoice> {
        self.form_choice.as_ref()
    }
}

/// Forward dynamics in a form; with `Auto`, measured on the model.
pub(super) fn forward(
    model: &Model,
    layout: &Layout<f64>,
    form: Form,
) -> (FormForwardDynamics, Option<FormChoice>) {
    let choice = (form == Form::Auto).then(|| FormChoice::of(model, layout));
    let form = choice.map_or(form, |choice| choice.form);
    (FormForwardDynamics::new(model, layout, form), choice)
}
