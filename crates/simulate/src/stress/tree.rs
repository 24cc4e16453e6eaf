//! One call of forward dynamics on a tree, in the form that the library chooses, and its errors.

use super::chain::State;
use super::page::number;
use super::sensitivity::{kappa, largest};
use super::{Measured, Outcome, timed};
use phipsi_model::{Model, ModelErrors};
use phipsi_recursion::{
    FormChoice, FormForwardDynamics, ForwardDynamics, InverseDynamics, Layout, SquareRootForwardDynamics,
    forward_info, mass_matrix,
};
use phipsi_spatial::{Dd, Scalar};

/// Trees up to this size are judged in every way; larger ones in time linear in their size.
const SMALL: usize = 400;

/// Budgets of soa.md 2.3: 4 n ε κ forward, 100 n ε backward.
const FORWARD: f64 = 4.0;
const BACKWARD: f64 = 100.0;

/// An error above this leaves no digit.
const MEANINGFUL: f64 = 0.1;

/// What rounding of double-double inverse dynamics leaves, over the largest terms and for each body.
const RESOLUTION: f64 = 1e-31;

/// A call.
pub(super) struct Call {
    pub model: Result<Model, ModelErrors>,
    pub state: State,
    /// The error that the scene must keep, where it is not 4 n ε κ.
    pub line: Option<f64>,
    /// Another call with the same result, for the truth: where double-double numbers would lose their lower parts to underflow.
    pub twin: Option<(Model, State)>,
}

impl Call {
    pub fn new(model: Result<Model, ModelErrors>, state: State) -> Self {
        Call { model, state, line: None, twin: None }
    }
}

/// Makes the call and judges it.
pub(super) fn judge(call: Call) -> Measured {
    let Call { model, state, line, twin } = call;
    let model = match model {
        Ok(model) => model,
        Err(e) => return Measured::refused(e),
    };
    let layout = Layout::<f64>::new(&model);
    let choice = FormChoice::of(&model, &layout);
    let mut forward = FormForwardDynamics::new(&model, &layout, choice.form);
    let mut a = vec![0.0; layout.nv()];
    let State { q, v, tau } = &state;
    let (done, wall_s) = timed(|| forward.run(&layout, q, v, tau, None, &mut a));
    if let Err(e) = done {
        return Measured { wall_s, ..Measured::refused(e) };
    }
    if let Some(i) = a.iter().position(|x| !x.is_finite()) {
        return Measured {
            wall_s,
            ..Measured::wrong(format!("acceleration {i} is {}, and no error said so", a[i]))
        };
    }
    let n = layout.len();
    let (model, state) = twin.unwrap_or((model, state));
    let wide = Layout::<Dd>::new(&model);
    let wide_a: Vec<Dd> = a.iter().map(|&x| Dd::from_f64(x)).collect();
    let (mut error, mut sensitivity) = (None, None);
    if let Some(exact) = truth(&model, &state) {
        let scale = largest(&exact);
        let off = wide_a.iter().zip(&exact).fold(0.0f64, |m, (x, y)| m.max((*x - *y).hi.abs()));
        error = Some(if off == 0.0 { 0.0 } else { off / scale });
        let samples = if n <= SMALL { 6 } else { 1 };
        sensitivity = Some(kappa((&model, &state), samples, n <= SMALL, &exact, truth));
    }
    let backward = backward_error(&wide, &state, &wide_a);
    let allowed = BACKWARD * n as f64 * f64::EPSILON;
    let explained = FORWARD * n as f64 * f64::EPSILON * sensitivity.unwrap_or(1.0);
    // A result without a digit is never right, whatever explains it.
    let line = line.unwrap_or(explained.max(choice.limit)).min(MEANINGFUL);
    let mut message = format!("{} ({})", choice.form, choice.why());
    let good = error.is_none_or(|e| e <= line) && backward.is_none_or(|b| b <= allowed);
    let outcome = if good && (error.is_some() || backward.is_some()) {
        Outcome::Right
    } else if let Some(told) = warning(&choice, &layout, &state, &a)
        && error.is_none_or(|e| e <= 10.0 * told.0)
    {
        message = told.1;
        Outcome::Warned
    } else {
        message = format!(
            "{message}; error {} where {line:.0e} is required, backward {}",
            number(error),
            number(backward)
        );
        Outcome::Wrong
    };
    Measured { error, kappa: sensitivity, backward, drift: None, steps: None, wall_s, outcome, message }
}

/// What the library says about its own error beside the number: of the choice of the form, or of the hinge that loses most digits.
fn warning(choice: &FormChoice, layout: &Layout<f64>, state: &State, a: &[f64]) -> Option<(f64, String)> {
    if !choice.is_sufficient() {
        return Some((choice.error, format!("{choice}")));
    }
    let info = forward_info(layout, &state.q, &state.v, &state.tau, None, a).ok()?;
    let worst = info.worst_hinge?;
    let told = f64::EPSILON / worst.ratio;
    let text = format!(
        "joint `{}` keeps {:.0e} of its inertia: an error up to {told:.0e} is told (info.worst_hinge)",
        worst.joint, worst.ratio
    );
    (told > choice.limit).then_some((told, text))
}

fn widened(x: &[f64]) -> Vec<Dd> {
    x.iter().map(|&x| Dd::from_f64(x)).collect()
}

/// Accelerations in double-double numbers: by the square-root form, of large trees by plain recursion.
fn truth(model: &Model, state: &State) -> Option<Vec<Dd>> {
    let layout = Layout::<Dd>::new(model);
    let mut out = vec![Dd::splat(0.0); layout.nv()];
    let (q, v, tau) = (widened(&state.q), widened(&state.v), widened(&state.tau));
    if layout.len() <= SMALL {
        SquareRootForwardDynamics::new(model, &layout).run(&layout, &q, &v, &tau, None, &mut out).ok()?;
    } else {
        ForwardDynamics::new(&layout).run(&layout, &q, &v, &tau, None, &mut out).ok()?;
    }
    out.iter().all(|x| x.hi.is_finite()).then_some(out)
}

/// |τ − inverse dynamics(a)| over the sum of |terms| |τ_i| + |bias_i| + Σ_j |𝓜_ij a_j|, in double-double numbers: largest component.
/// Differences that those numbers do not resolve beside the largest terms count as none. Of large trees: the largest difference over the largest |τ_i| + |bias_i| + |(𝓜a)_i|.
fn backward_error(layout: &Layout<Dd>, state: &State, a: &[Dd]) -> Option<f64> {
    let (q, v, tau) = (widened(&state.q), widened(&state.v), widened(&state.tau));
    let n = a.len();
    let mut inverse = InverseDynamics::new(layout);
    let (mut back, mut bias) = (a.to_vec(), a.to_vec());
    inverse.run(layout, &q, &v, a, None, &mut back).ok()?;
    inverse.run(layout, &q, &v, &vec![Dd::splat(0.0); n], None, &mut bias).ok()?;
    let off = |i: usize| (back[i] - tau[i]).hi.abs();
    let rest = |i: usize| tau[i].hi.abs() + bias[i].hi.abs();
    let found = if layout.len() <= SMALL {
        let matrix = mass_matrix(layout, &q).ok()?;
        let moved = |i: usize| (0..n).map(|j| (matrix[i * n + j] * a[j]).hi.abs()).sum::<f64>();
        let noise = RESOLUTION * n as f64 * most((0..n).map(|i| rest(i) + moved(i)));
        let part = |i: usize| if off(i) <= noise { 0.0 } else { off(i) / (rest(i) + moved(i)) };
        most((0..n).map(part))
    } else {
        let moved = |i: usize| (back[i] - bias[i]).hi.abs();
        most((0..n).map(off)) / most((0..n).map(|i| rest(i) + moved(i)))
    };
    found.is_finite().then_some(found)
}

/// The largest; a number that is none stays.
fn most(x: impl Iterator<Item = f64>) -> f64 {
    x.fold(0.0, |m, x| if x.is_nan() || m.is_nan() { f64::NAN } else { m.max(x) })
}
