//! The forms of forward dynamics, and which one a model needs.
//!
//! All forms give the same accelerations but for rounding. What plain recursion loses depends on the model: heavy bodies
//! on light ones (soa.md 2.2). [`FormChoice`] measures it once: the plain and the square-root form are two unrelated ways
//! of rounding, so where they agree both are right; where they do not, the square-root form in double-double numbers judges.

use crate::error::{DynamicsError, check_length};
use crate::forward_dynamics::ForwardDynamics;
use crate::inverse_dynamics::InverseDynamics;
use crate::layout::Layout;
use crate::refined_forward_dynamics::RefinedForwardDynamics;
use crate::square_root_forward_dynamics::SquareRootForwardDynamics;
use phipsi_model::{Model, Random};
use phipsi_spatial::{Dd, Vec3, Wrench};
use std::fmt;

/// A form of forward dynamics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Hash)]
pub enum Form {
    /// What the model needs: [`FormChoice::of`].
    #[default]
    Auto,
    /// [`ForwardDynamics`].
    Plain,
    /// [`RefinedForwardDynamics`].
    Refined,
    /// [`SquareRootForwardDynamics`].
    SquareRoot,
    /// [`ForwardDynamics`] in double-double numbers, its result rounded.
    DoubleDouble,
}

impl Form {
    /// Every form.
    pub const ALL: [Form; 5] = [Form::Auto, Form::Plain, Form::Refined, Form::SquareRoot, Form::DoubleDouble];

    /// Its name in scene files and in Python.
    pub fn name(self) -> &'static str {
        match self {
            Form::Auto => "auto",
            Form::Plain => "plain",
            Form::Refined => "refined",
            Form::SquareRoot => "square_root",
            Form::DoubleDouble => "double_double",
        }
    }
    /// The form of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|form| form.name() == name)
    }
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Errors up to this one are left to the plain form; other states may be worse than those that were tried by some times.
const GOOD: f64 = 3e-13;

/// Plain errors up to this one are refined: at a state a hundred times worse the refined error is still 1e-12.
const REFINABLE: f64 = 1e-8;

/// The error that long trees are allowed: 16 n ε, four times what soa.md 2.3 demands of uniform chains.
const GOOD_PER_BODY: f64 = 16.0 * f64::EPSILON;

/// Which form a model needs, and by what measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FormChoice {
    /// The form; never [`Form::Auto`].
    pub form: Form,
    /// Largest relative error of the plain form at the states that were tried (largest component over largest component);
    /// infinite if it failed there.
    pub plain_error: f64,
    /// That of the chosen form.
    pub error: f64,
    /// The error that was to be kept.
    pub limit: f64,
}

impl FormChoice {
    /// Measures a model at six states: the neutral configuration and two random ones, each with joint forces zero and with
    /// random ones of the size that random accelerations need; velocities random, gravity the layout's.
    ///
    /// # Method
    /// Plain, if it agrees with the square-root form to max(3e-13, 16 n ε). Else the square-root form in double-double
    /// numbers judges: the refined form, if the plain one errs by 1e-8 at most and the refined one keeps the limit; else the
    /// square-root form, if it does; else double-double numbers, if they are better.
    ///
    /// # Cost
    /// O(n), once per model: six evaluations of the plain and of the square-root form; where they differ, six or
    /// twelve more in double-double numbers.
    pub fn of(model: &Model, layout: &Layout<f64>) -> Self {
        let limit = GOOD.max(GOOD_PER_BODY * layout.len() as f64);
        let mut choice = FormChoice { form: Form::Plain, plain_error: 0.0, error: 0.0, limit };
        if layout.check_closures().is_err() || layout.nv() == 0 {
            return choice;
        }
        let states = states(model, layout);
        if layout.is_flexible() {
            return Self::of_flexible(model, layout, &states, choice);
        }
        let results = |form| -> Vec<Option<Vec<f64>>> {
            let mut forward = FormForwardDynamics::new(model, layout, form);
            states.iter().map(|state| state.accelerations(layout, &mut forward)).collect()
        };
        let (plain, root) = (results(Form::Plain), results(Form::SquareRoot));
        choice.plain_error = largest_difference(&plain, &root);
        choice.error = choice.plain_error;
        if choice.error <= limit {
            return choice;
        }
        let wide_layout = Layout::<Dd>::new(model).with_gravity(Vec3(layout.gravity().0.map(Dd::from_f64)));
        let mut judge = SquareRootForwardDynamics::<Dd>::new(model, &wide_layout);
        let judged: Vec<_> = states.iter().map(|state| state.judge(&wide_layout, &mut judge)).collect();
        choice.plain_error = largest_difference(&plain, &judged);
        if choice.plain_error <= REFINABLE {
            (choice.form, choice.error) =
                (Form::Refined, largest_difference(&results(Form::Refined), &judged));
            if choice.error <= limit {
                return choice;
            }
        }
        (choice.form, choice.error) = (Form::SquareRoot, largest_difference(&root, &judged));
        if choice.error > limit {
            let error = largest_difference(&results(Form::DoubleDouble), &judged);
            if error < choice.error {
                (choice.form, choice.error) = (Form::DoubleDouble, error);
            }
        }
        choice
    }
    /// There is no square-root form with flexible bodies: plain recursion in double-double numbers judges.
    fn of_flexible(model: &Model, layout: &Layout<f64>, states: &[State], mut choice: Self) -> Self {
        let results = |form| -> Vec<Option<Vec<f64>>> {
            let mut forward = FormForwardDynamics::new(model, layout, form);
            states.iter().map(|state| state.accelerations(layout, &mut forward)).collect()
        };
        let judged = results(Form::DoubleDouble);
        choice.plain_error = largest_difference(&results(Form::Plain), &judged);
        choice.error = choice.plain_error;
        if choice.error > choice.limit {
            (choice.form, choice.error) =
                (Form::Refined, largest_difference(&results(Form::Refined), &judged));
        }
        if choice.error > choice.limit {
            (choice.form, choice.error) = (Form::DoubleDouble, 0.0);
        }
        choice
    }
    /// True if the chosen form's error is not above the limit.
    pub fn is_sufficient(&self) -> bool {
        self.error <= self.limit
    }
}

impl FormChoice {
    /// What was measured, for people.
    pub fn why(&self) -> String {
        let FormChoice { form, plain_error, error, limit } = self;
        match form {
            Form::Plain if self.is_sufficient() => {
                format!("error at the states tried {plain_error:.0e}, at most {limit:.0e}")
            }
            _ if self.is_sufficient() => {
                format!("error at the states tried {error:.0e}; of the plain form {plain_error:.0e}")
            }
            _ => format!("error at the states tried {error:.0e}, more than {limit:.0e}; no form has less"),
        }
    }
}

impl fmt::Display for FormChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.form, self.why())
    }
}

/// A state that forms are tried at.
struct State {
    q: Vec<f64>,
    v: Vec<f64>,
    tau: Vec<f64>,
}

impl State {
    fn accelerations(&self, layout: &Layout<f64>, forward: &mut FormForwardDynamics) -> Option<Vec<f64>> {
        let mut out = vec![0.0; layout.nv()];
        forward.run(layout, &self.q, &self.v, &self.tau, None, &mut out).ok().map(|()| out)
    }
    fn judge(&self, layout: &Layout<Dd>, forward: &mut SquareRootForwardDynamics<Dd>) -> Option<Vec<f64>> {
        let [q, v, tau] = [&self.q, &self.v, &self.tau].map(|x| widened(x));
        let mut out = widened(&vec![0.0; layout.nv()]);
        forward.run(layout, &q, &v, &tau, None, &mut out).ok()?;
        Some(out.iter().map(|x| x.hi).collect())
    }
}

fn widened(x: &[f64]) -> Vec<Dd> {
    x.iter().map(|&x| Dd::from_f64(x)).collect()
}

fn states(model: &Model, layout: &Layout<f64>) -> Vec<State> {
    let mut random = Random::new(5);
    let mut inverse = InverseDynamics::new(layout);
    let mut all = Vec::with_capacity(6);
    for seed in 0..3 {
        let state = model.random_state(seed);
        let q = if seed == 0 { model.neutral() } else { state.q };
        let a: Vec<f64> = (0..layout.nv()).map(|_| random.signed()).collect();
        let mut tau = vec![0.0; layout.nv()];
        all.push(State { q: q.clone(), v: state.v.clone(), tau: tau.clone() });
        if inverse.run(layout, &q, &state.v, &a, None, &mut tau).is_ok() {
            // Of that size, but not balanced: forces that nearly cancel make any form's result uncertain.
            tau.iter_mut().for_each(|tau| *tau *= random.signed());
            all.push(State { q, v: state.v, tau });
        }
    }
    all
}

/// Largest |x − y| over largest |y|, of the worst state. What both could not compute says nothing.
fn largest_difference(x: &[Option<Vec<f64>>], y: &[Option<Vec<f64>>]) -> f64 {
    let one = |pair: (&Option<Vec<f64>>, &Option<Vec<f64>>)| match pair {
        (Some(x), Some(y)) => {
            let scale = y.iter().fold(0.0f64, |m, y| m.max(y.abs()));
            let worst = x.iter().zip(y).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
            // A number that is not finite is no agreement.
            let finite = x.iter().chain(y).all(|x| x.is_finite());
            if !finite {
                f64::INFINITY
            } else if worst == 0.0 {
                0.0
            } else {
                worst / scale
            }
        }
        (None, None) => 0.0,
        _ => f64::INFINITY,
    };
    x.iter().zip(y).map(one).fold(0.0, f64::max)
}

/// Forward dynamics in the form asked for, with the workspace of that form only.
#[derive(Clone, Debug)]
pub struct FormForwardDynamics {
    form: Form,
    kernel: Kernel,
}

#[derive(Clone, Debug)]
enum Kernel {
    Plain(Box<ForwardDynamics<f64>>),
    Refined(Box<RefinedForwardDynamics<f64>>),
    SquareRoot(Box<SquareRootForwardDynamics<f64>>),
    DoubleDouble(Box<Wide>),
}

/// Forward dynamics in double-double numbers.
#[derive(Clone, Debug)]
struct Wide {
    layout: Layout<Dd>,
    forward: ForwardDynamics<Dd>,
    q: Vec<Dd>,
    v: Vec<Dd>,
    tau: Vec<Dd>,
    wrenches: Vec<Wrench<Dd>>,
    out: Vec<Dd>,
}

impl FormForwardDynamics {
    /// A workspace for a model and its layout. With [`Form::Auto`] the model is measured first; who makes many workspaces
    /// for one model measures once and gives them [`FormChoice::form`].
    pub fn new(model: &Model, layout: &Layout<f64>, form: Form) -> Self {
        let form = if form == Form::Auto { FormChoice::of(model, layout).form } else { form };
        let kernel = match form {
            Form::Auto | Form::Plain => Kernel::Plain(Box::new(ForwardDynamics::new(layout))),
            Form::Refined => Kernel::Refined(Box::new(RefinedForwardDynamics::new(layout))),
            Form::SquareRoot => Kernel::SquareRoot(Box::new(SquareRootForwardDynamics::new(model, layout))),
            Form::DoubleDouble => Kernel::DoubleDouble(Box::new(Wide::new(model, layout))),
        };
        FormForwardDynamics { form, kernel }
    }
    /// The form; never [`Form::Auto`].
    pub fn form(&self) -> Form {
        self.form
    }
    /// Accelerations of generalised forces `tau` at (q, v); arguments as of [`ForwardDynamics::run`]. No allocation.
    ///
    /// # Errors
    /// As [`ForwardDynamics::run`]; [`DynamicsError::NotFinite`] where products overflow.
    pub fn run(
        &mut self,
        layout: &Layout<f64>,
        q: &[f64],
        v: &[f64],
        tau: &[f64],
        wrenches: Option<&[Wrench<f64>]>,
        out: &mut [f64],
    ) -> Result<(), DynamicsError> {
        match &mut self.kernel {
            Kernel::Plain(kernel) => kernel.run(layout, q, v, tau, wrenches, out),
            Kernel::Refined(kernel) => kernel.run(layout, q, v, tau, wrenches, out),
            Kernel::SquareRoot(kernel) => kernel.run(layout, q, v, tau, wrenches, out),
            Kernel::DoubleDouble(kernel) => kernel.run(q, v, tau, wrenches, out),
        }?;
        match out.iter().position(|x| !x.is_finite()) {
            Some(index) => Err(DynamicsError::NotFinite { index, found: out[index] }),
            None => Ok(()),
        }
    }
}

impl Wide {
    /// The model's own numbers in double-double; gravity is the layout's.
    fn new(model: &Model, layout: &Layout<f64>) -> Self {
        let wide = Layout::<Dd>::new(model).with_gravity(Vec3(layout.gravity().0.map(Dd::from_f64)));
        let zero = |n: usize| vec![Dd::from_f64(0.0); n];
        Wide {
            forward: ForwardDynamics::new(&wide),
            q: zero(wide.nq()),
            v: zero(wide.nv()),
            tau: zero(wide.nv()),
            wrenches: vec![Wrench::zero(); wide.model_bodies()],
            out: zero(wide.nv()),
            layout: wide,
        }
    }
    fn run(
        &mut self,
        q: &[f64],
        v: &[f64],
        tau: &[f64],
        wrenches: Option<&[Wrench<f64>]>,
        out: &mut [f64],
    ) -> Result<(), DynamicsError> {
        let copy = |argument, from: &[f64], to: &mut [Dd]| {
            check_length(argument, from, to.len())?;
            to.iter_mut().zip(from).for_each(|(to, from)| *to = Dd::from_f64(*from));
            Ok(())
        };
        copy("q", q, &mut self.q)?;
        copy("v", v, &mut self.v)?;
        copy("tau", tau, &mut self.tau)?;
        check_length("out", out, self.out.len())?;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, self.wrenches.len())?;
            for (to, from) in self.wrenches.iter_mut().zip(wrenches) {
                *to = Wrench::from_array(from.to_array().map(Dd::from_f64));
            }
        }
        let wide = wrenches.map(|_| &self.wrenches[..]);
        self.forward.run(&self.layout, &self.q, &self.v, &self.tau, wide, &mut self.out)?;
        out.iter_mut().zip(&self.out).for_each(|(to, from)| *to = from.hi);
        Ok(())
    }
}
