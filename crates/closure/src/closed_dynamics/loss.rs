//! How many digits the forms of the elimination lose on a model, and the heavy body that may be the reason.
//!
//! The sweep over the tree is measured without loops ([`phipsi_recursion::FormChoice`]); what is lost where loops are closed is not seen there:
//! a heavy body next to a cut makes the rows C of the closure cancel. So accelerations of the whole mechanism are compared at some
//! states: the mixed and the square-root form round in unrelated ways, and where they differ, the mixed form in double-double
//! numbers judges.
//!
//! The states need not close the loops. At rest, closures are taken to keep what they find there, γ = Φ(q), and are given γ̈ = Ja of
//! random a, so that rows of any rank agree with each other.

use super::{ClosedDynamics, ClosedForm, ClosureMotion, Conditions};
use crate::compiled::Number;
use crate::error::ClosureError;
use phipsi_model::{Model, Random};
use phipsi_recursion::{InverseDynamics, Layout};
use phipsi_spatial::Dd;
use std::fmt;

/// A body that weighs this many times the lightest one of its loop is heavy: six of sixteen digits.
const HEAVY: f64 = 1e6;

/// How far states are moved for their condition number, rad or m; the rounding of what is given there is a ten-thousandth of that.
const NEAR: f64 = 1e-12;

/// Accelerations that such a move changes by more are no measure: double numbers have no digits at the state.
const LOST: f64 = 0.1;

/// A state at rest with what the closures keep there.
struct State {
    q: Vec<f64>,
    tau: Vec<f64>,
    /// The accelerations that the closures' are made of.
    a: Vec<f64>,
    position: Vec<f64>,
    acceleration: Vec<f64>,
}

/// Accelerations and the rank of the loops.
type Outcome = Option<(Vec<f64>, usize)>;

/// The form that loses less, the preferred one if it keeps the limit, and its largest relative error at the states that were tried:
/// largest component over largest component, over the condition number of the state. `None` without closures.
pub(super) fn least_loss(
    model: &Model,
    preferred: ClosedForm,
    limit: f64,
) -> Result<Option<(ClosedForm, f64)>, ClosureError> {
    let mut dynamics = ClosedDynamics::<f64>::new(model)?;
    if dynamics.rows() == 0 || model.nv() == 0 {
        return Ok(None);
    }
    let states = states(model, &mut dynamics)?;
    let in_form = |form| -> Result<Vec<Outcome>, ClosureError> {
        let mut dynamics = ClosedDynamics::<f64>::new(model)?.with_form(form)?;
        Ok(states.iter().map(|state| state.solve(&mut dynamics)).collect())
    };
    let mixed = in_form(ClosedForm::Mixed)?;
    let root = if model.is_flexible() { None } else { Some(in_form(ClosedForm::SquareRoot)?) };
    if let Some(root) = &root {
        let apart = largest(mixed.iter().zip(root).map(|(x, y)| difference(x, y)));
        if apart <= limit {
            return Ok(Some((preferred, apart)));
        }
    }
    let mut judge = ClosedDynamics::<Dd>::new(model)?.with_data_error(f64::EPSILON);
    let judged: Vec<Outcome> = states.iter().map(|state| state.solve(&mut judge)).collect();
    let mut conditions = vec![1.0; states.len()];
    for (i, state) in states.iter().enumerate() {
        let found = [Some(&mixed), root.as_ref()].into_iter().flatten();
        if found.into_iter().any(|found| difference(&found[i], &judged[i]) > limit) {
            conditions[i] = state.condition(model, &mut dynamics, &mut judge, &judged[i])?;
        }
    }
    let error = |found: &[Outcome]| {
        let each = found.iter().zip(&judged).zip(&conditions);
        largest(each.map(|((x, y), condition)| difference(x, y) / condition))
    };
    let mine =
        (preferred, error(root.as_ref().filter(|_| preferred == ClosedForm::SquareRoot).unwrap_or(&mixed)));
    let other = match (preferred, &root) {
        (_, None) => return Ok(Some(mine)),
        (ClosedForm::SquareRoot, _) => (ClosedForm::Mixed, error(&mixed)),
        (_, Some(root)) => (ClosedForm::SquareRoot, error(root)),
    };
    Ok(Some(if mine.1 <= limit || mine.1 <= other.1 { mine } else { other }))
}

/// The neutral configuration and two random ones, each with forces zero and with random ones of the size that random accelerations
/// need.
fn states(model: &Model, dynamics: &mut ClosedDynamics<f64>) -> Result<Vec<State>, ClosureError> {
    let (mut random, nv) = (Random::new(7), model.nv());
    let open = model.clone().without_closures();
    let layout = Layout::new(&open);
    let mut inverse = InverseDynamics::new(&layout);
    let mut all = Vec::with_capacity(6);
    for seed in 0..3 {
        let q = if seed == 0 { model.neutral() } else { model.random_state(seed).q };
        let a: Vec<f64> = (0..nv).map(|_| random.signed()).collect();
        let (rest, mut tau) = (vec![0.0; nv], vec![0.0; nv]);
        if inverse.run(&layout, &q, &rest, &a, None, &mut tau).is_ok() {
            tau.iter_mut().for_each(|tau| *tau *= random.signed());
            all.push(State::new(q.clone(), tau, a.clone(), dynamics)?);
        }
        all.push(State::new(q, rest, a, dynamics)?);
    }
    Ok(all)
}

impl State {
    fn new(
        q: Vec<f64>,
        tau: Vec<f64>,
        a: Vec<f64>,
        dynamics: &mut ClosedDynamics<f64>,
    ) -> Result<Self, ClosureError> {
        let mut position = vec![0.0; dynamics.rows()];
        let mut acceleration = position.clone();
        // The rates of rows are linear in v: those of a are Ja.
        dynamics.residual(&q, Some(&a), &Conditions::default(), &mut position, &mut acceleration)?;
        Ok(State { q, tau, a, position, acceleration })
    }
    /// What data in double numbers leave open here, which is no form's loss: the largest relative change of the accelerations for moves
    /// in three random directions, over the move. Infinite where they have no digits.
    fn condition(
        &self,
        model: &Model,
        dynamics: &mut ClosedDynamics<f64>,
        judge: &mut ClosedDynamics<Dd>,
        here: &Outcome,
    ) -> Result<f64, ClosureError> {
        let (mut random, mut apart) = (Random::new(9), 0.0f64);
        for _ in 0..3 {
            let step: Vec<f64> = (0..model.nv()).map(|_| NEAR * random.signed()).collect();
            let mut q = self.q.clone();
            model.integrate_into(&self.q, &step, &mut q);
            let there = State::new(q, self.tau.clone(), self.a.clone(), dynamics)?;
            apart = apart.max(difference(&there.solve(judge), here));
        }
        Ok(if apart <= LOST { (apart / NEAR).max(1.0) } else { f64::INFINITY })
    }
    fn solve<T: Number>(&self, dynamics: &mut ClosedDynamics<T>) -> Outcome {
        let of = |x: &[f64]| -> Vec<T> { x.iter().map(|x| T::splat(*x)).collect() };
        let (position, acceleration) = (of(&self.position), of(&self.acceleration));
        let still = vec![T::zero(); position.len()];
        let motion = ClosureMotion { position: &position, velocity: &still, acceleration: &acceleration };
        let conditions = Conditions { motion: Some(motion), ..Conditions::default() };
        let mut out = of(&self.tau);
        let rest = vec![T::zero(); out.len()];
        let solved = dynamics.run(&of(&self.q), &rest, &of(&self.tau), &conditions, &mut out).ok()?;
        let rank = solved.info().rank;
        Some((out.iter().map(|x| x.to_f64()).collect(), rank))
    }
}

fn largest(x: impl Iterator<Item = f64>) -> f64 {
    x.fold(0.0, f64::max)
}

/// Largest |x − y| over largest |y|. What both could not compute, and a rank that only wider numbers tell, says nothing.
fn difference(x: &Outcome, y: &Outcome) -> f64 {
    match (x, y) {
        (Some((x, rank)), Some((y, other))) if rank == other => {
            let worst = largest(x.iter().zip(y).map(|(x, y)| (x - y).abs()));
            if worst == 0.0 { 0.0 } else { worst / largest(y.iter().map(|y| y.abs())) }
        }
        (Some(_), Some(_)) | (None, None) => 0.0,
        _ => f64::INFINITY,
    }
}

/// A body that is heavy beside the lightest one of a loop that it is in.
#[derive(Clone, Debug, PartialEq)]
pub struct HeavyBody {
    /// The body.
    pub body: String,
    /// The closure of that loop.
    pub closure: String,
    /// Its mass over that of the lightest body of the loop.
    pub ratio: f64,
}

impl HeavyBody {
    /// The one with the largest ratio; `None` if all are below 1e6, or without closures between bodies. Massless bodies do not count.
    pub(super) fn of(model: &Model) -> Option<Self> {
        let mut worst: Option<HeavyBody> = None;
        for closure in model.closures() {
            let to_ground = |name: &str| {
                let first = model.find_body(name).ok().flatten();
                std::iter::successors(first, |&k| model.tree().parent(k)).collect::<Vec<_>>()
            };
            let (a, b) = (to_ground(&closure.body_a), to_ground(&closure.body_b));
            // What is on both ways to the ground is not in the loop.
            let one_way = a.iter().filter(|k| !b.contains(k)).chain(b.iter().filter(|k| !a.contains(k)));
            let mass = |k: usize| model.bodies()[k].inertia.mass;
            let (mut heavy, mut light) = (None, f64::INFINITY);
            for k in one_way.copied().filter(|&k| mass(k) > 0.0) {
                light = light.min(mass(k));
                if heavy.is_none_or(|h| mass(k) > mass(h)) {
                    heavy = Some(k);
                }
            }
            let Some(k) = heavy else { continue };
            let ratio = mass(k) / light;
            if ratio >= HEAVY && worst.as_ref().is_none_or(|w| ratio > w.ratio) {
                let (body, closure) = (model.bodies()[k].name.clone(), closure.name.clone());
                worst = Some(HeavyBody { body, closure, ratio });
            }
        }
        worst
    }
}

impl fmt::Display for HeavyBody {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let HeavyBody { body, closure, ratio } = self;
        write!(
            f,
            "body `{body}` weighs {ratio:.0e} times the lightest one in the loop of closure `{closure}`: cut that loop farther from it, \
             between light bodies"
        )
    }
}
