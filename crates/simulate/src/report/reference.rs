//! The reference of a report: the same motion by two unrelated methods.
//!
//! | | first | second, which is taken |
//! |---|---|---|
//! | method | DOP853 on increments, tolerance 1e-13 | extrapolation of order 16 on embedded coordinates |
//! | numbers | f64 | double-double where the scene is small and its forces can be had in them, else f64 |
//!
//! Where these two differ by more than 1e-12 though the motion is known (a stiff scene, whose fast forces multiply rounding), a
//! third one by Rodas5P is made, and the two of the three that agree best are the reference.
//!
//! They share the model, the forces and (in f64) forward dynamics; formulas, coefficients, coordinates and step control differ. The
//! error of the second is at most about what they differ by, which is told.

use super::{Budget, ReportWatcher};
use crate::error::SimulateError;
use crate::folder::summary::short;
use crate::record::spread;
use crate::simulation::Simulation;
use crate::stiffness::MOST_DOF;
use phipsi_model::{Model, State};
use phipsi_motion::extrapolation::Rate;
use phipsi_motion::{
    Dynamics, Extrapolation, ExtrapolationError, Method, MotionError, Scheme, Stepper, System, Tolerances,
    WideDynamics, coordinate_rate,
};
use phipsi_spatial::{Dd, Real};
use std::time::Instant;

/// Most instants at which runs are judged.
pub const INSTANTS: usize = 64;

/// Tolerances of the first reference, tried in this order.
const TOLERANCES: [f64; 2] = [1e-13, 1e-12];

/// Tolerance of the extrapolation in f64: below it rounding is met.
const PLAIN: f64 = 1e-13;

/// Tolerance of the extrapolation in double-double numbers: below the rounding of f64.
const WIDE: f64 = 1e-18;

/// Tolerance of the third reference, and the agreement of the others that is worse than it should be.
const THIRD: f64 = 1e-12;

/// Tolerance of the second reference where events need one that steps.
const OTHER: f64 = 1e-13;

/// Cost of an evaluation in double-double numbers over one in f64 (docs, Accuracy of forward dynamics).
const WIDE_COST: f64 = 60.0;

/// Where references differ by more, the motion is not known: the horizon.
pub const KNOWN: f64 = 1e-7;

/// Where they differ by more, going on says nothing.
const LOST: f64 = 0.1;

/// The reference.
#[derive(Clone, Debug)]
pub struct Reference {
    /// States at the instants up to the horizon.
    pub states: Vec<State>,
    /// Difference of the two methods at each instant at which both were there: time, in q, in v.
    pub differences: Vec<(f64, f64, f64)>,
    /// Largest difference in q, rad or m, and in v, up to the horizon.
    pub agreement: [f64; 2],
    /// The time up to which the motion is known, where it is not known to the end.
    pub horizon: Option<f64>,
    /// Why it is not known to the end.
    pub why: Option<String>,
    /// The two methods in words.
    pub methods: [String; 2],
    /// True for double-double numbers.
    pub wide: bool,
    /// Why not.
    pub why_not_wide: Option<String>,
    /// Evaluations of both.
    pub evaluations: u64,
    /// Wall time of both, s.
    pub wall_s: f64,
}

/// Times of the scene's samples at which runs are judged; the start is not one of them.
pub fn instants(simulation: &Simulation) -> Vec<u64> {
    let samples = simulation.samples() as usize;
    spread(samples - 1, INSTANTS).map(|i| i as u64 + 1).collect()
}

struct Track {
    states: Vec<State>,
    evaluations: u64,
    wall_s: f64,
    /// Why it ended before the last instant.
    ended: Option<String>,
}

impl Reference {
    /// Makes it in about the given time.
    ///
    /// # Errors
    /// [`SimulateError::Stopped`] if neither method gets anywhere.
    pub(crate) fn new(
        simulation: &mut Simulation,
        seconds: f64,
        budget: &Budget,
        watcher: &mut dyn ReportWatcher,
    ) -> Result<Self, SimulateError> {
        let times: Vec<f64> = instants(simulation).into_iter().map(|k| simulation.sample_time(k)).collect();
        let breaks: Vec<f64> = simulation.dynamics.breaks();
        let mut first = Track { states: Vec::new(), evaluations: 0, wall_s: 0.0, ended: None };
        let mut tolerance = TOLERANCES[0];
        let mut look = |what: &str| {
            watcher.at(what, budget.part());
            watcher.stop()
        };
        for t in TOLERANCES {
            tolerance = t;
            let tolerances = Tolerances { rtol: t, atol: t, max_step: simulation.tolerances.max_step };
            let next =
                by_steps(simulation, Method::Dop853, tolerances, &times, &breaks, 0.4 * seconds, &mut look)?;
            let better = next.states.len() >= first.states.len();
            if better {
                first = next;
            }
            if first.ended.is_none() || first.states.len() > times.len() / 2 {
                break;
            }
        }
        // Extrapolation takes up to three times the evaluations of DOP853.
        let predicted = 3.0 * WIDE_COST * first.wall_s;
        let judged = |second: &Track| second.states.len();
        let mut why_not_wide = None;
        let mut second = None;
        if simulation.dynamics.is_switching() {
            why_not_wide = Some("joints of the scene strike stops, stick or slip".into());
        } else if predicted > seconds {
            why_not_wide = Some(format!("it would take about {predicted:.0} s"));
        } else {
            match wide(simulation, &first, &times, 0.5 * seconds, &mut look) {
                None => why_not_wide = Some("a force of the scene cannot be had in them".into()),
                Some(track) if track.ended.is_none() || judged(&track) > first.states.len() / 2 => {
                    second = Some((track, true));
                }
                Some(track) => why_not_wide = track.ended,
            }
        }
        let switching = simulation.dynamics.is_switching();
        let (second, wide) = match second {
            Some(second) => second,
            None if switching => {
                // Extrapolation does not look for events.
                let tolerances =
                    Tolerances { rtol: OTHER, atol: OTHER, max_step: simulation.tolerances.max_step };
                let known = &times[..first.states.len()];
                let other =
                    by_steps(simulation, Method::Tsit5, tolerances, known, &breaks, seconds, &mut look)?;
                (other, false)
            }
            None => (plain(simulation, &first, &breaks, seconds, &mut look), false),
        };
        let mut methods = [
            format!("dop853, tolerance {tolerance:e}"),
            match wide {
                _ if switching => format!("tsit5, tolerance {OTHER:e}"),
                true => format!("extrapolation of order 16, tolerance {WIDE:e}, double-double numbers"),
                false => format!("extrapolation of order 16, tolerance {PLAIN:e}"),
            },
        ];
        let mut second = second;
        let cost = (first.evaluations + second.evaluations, first.wall_s + second.wall_s);
        let mut third_cost = (0, 0.0);
        let doubtful = |worst: f64| worst > THIRD && worst <= KNOWN;
        if !wide
            && simulation.molecule.is_none()
            && simulation.model().nv() <= MOST_DOF
            && doubtful(worst(simulation.model(), &first, &second))
        {
            let tolerances =
                Tolerances { rtol: THIRD, atol: THIRD, max_step: simulation.tolerances.max_step };
            let share = 0.5 * seconds;
            let third = by_steps(simulation, Method::Rodas5p, tolerances, &times, &breaks, share, &mut look)?;
            third_cost = (third.evaluations, third.wall_s);
            let model = simulation.model();
            if third.states.len() == first.states.len().min(second.states.len()) {
                let pairs =
                    [(&first, &second), (&first, &third), (&second, &third)].map(|(a, b)| worst(model, a, b));
                let name = format!("rodas5p, tolerance {THIRD:e}");
                if pairs[1] < pairs[0] && pairs[1] <= pairs[2] {
                    (second, methods[1]) = (third, name);
                } else if pairs[2] < pairs[0] {
                    (first, methods[0]) = (third, name);
                }
            }
        }
        let model = simulation.model();
        let mut reference = Reference {
            states: Vec::new(),
            differences: Vec::new(),
            agreement: [0.0; 2],
            horizon: None,
            why: None,
            methods,
            wide,
            why_not_wide,
            evaluations: cost.0 + third_cost.0,
            wall_s: cost.1 + third_cost.1,
        };
        let mut known = true;
        for (a, b) in first.states.iter().zip(&second.states) {
            let [q, v] = apart(model, a, b);
            reference.differences.push((a.t, q, v));
            known &= q <= KNOWN;
            if known {
                reference.agreement = [reference.agreement[0].max(q), reference.agreement[1].max(v)];
                reference.states.push(b.clone());
            }
        }
        if reference.states.len() < times.len() {
            let t0 = simulation.start.t;
            reference.horizon = Some(reference.states.last().map_or(t0, |s| s.t));
            reference.why = Some(if known {
                first.ended.or(second.ended).unwrap_or_else(|| "the references ended".into())
            } else {
                format!("the references part by more than {KNOWN:e} there: neighbouring motions separate")
            });
        }
        Ok(reference)
    }
    /// What is wrong with it.
    pub fn warnings(&self, simulation: &Simulation) -> Vec<String> {
        let Some(horizon) = self.horizon else { return Vec::new() };
        let unit = simulation.time_unit();
        let why = self.why.as_deref().unwrap_or_default();
        vec![match self.states.is_empty() {
            true => format!("the motion is not known at any instant ({why}): no error can be judged"),
            false => format!(
                "the motion is known up to t = {} {unit} of {} {unit} ({why}); errors are those up to then, beyond it \
                 conserved quantities are judged and distributions set side by side",
                short(horizon),
                short(simulation.t_end)
            ),
        }]
    }
}

/// Largest difference in q at the instants that both have; infinite where the second has not all of the first's.
fn worst(model: &Model, a: &Track, b: &Track) -> f64 {
    if b.states.len() < a.states.len() {
        return f64::INFINITY;
    }
    a.states.iter().zip(&b.states).map(|(a, b)| apart(model, a, b)[0]).fold(0.0, f64::max)
}

/// Largest components of the difference in q and in v.
pub fn apart(model: &Model, a: &State, b: &State) -> [f64; 2] {
    // A NaN stays: it must not look like a small difference.
    let larger = |m: f64, x: f64| if x.is_nan() || m.is_nan() { f64::NAN } else { m.max(x.abs()) };
    let q = model.difference(&a.q, &b.q).into_iter().fold(0.0, larger);
    [q, a.v.iter().zip(&b.v).map(|(a, b)| a - b).fold(0.0, larger)]
}

/// The first reference; it lands on every instant, so that no interpolation enters.
fn by_steps(
    simulation: &mut Simulation,
    method: Method,
    tolerances: Tolerances,
    times: &[f64],
    breaks: &[f64],
    seconds: f64,
    look: &mut dyn FnMut(&str) -> bool,
) -> Result<Track, SimulateError> {
    let clock = Instant::now();
    let mut track = Track { states: Vec::new(), evaluations: 0, wall_s: 0.0, ended: None };
    let dynamics = &mut simulation.dynamics;
    let aux = vec![0.0; dynamics.auxiliary_len()];
    let scheme = Scheme::Explicit(method);
    let mut stepper = Stepper::new(dynamics, scheme, tolerances, &simulation.start, &aux)
        .map_err(|e| SimulateError::stopped(&e, dynamics.model()))?;
    'instants: for &time in times {
        while stepper.t() < time {
            let next = breaks.partition_point(|b| *b <= stepper.t());
            let (limit, is_break) = match breaks.get(next) {
                Some(b) if *b <= time => (*b, true),
                _ => (time, false),
            };
            match stepper.step(dynamics, limit, is_break) {
                Ok(info) if is_break && info.t1 == limit => stepper.restart(),
                Ok(_) => {}
                Err(e) => {
                    track.ended = Some(e.describe(dynamics.model()));
                    break 'instants;
                }
            }
            if look("reference by steps") {
                track.ended = Some("stopped by the user".into());
            } else if clock.elapsed().as_secs_f64() > seconds {
                track.ended = Some(format!("{seconds:.0} s of wall time were used up"));
            }
            if track.ended.is_some() {
                break 'instants;
            }
        }
        track.states.push(State { q: stepper.q().to_vec(), v: stepper.v().to_vec(), t: time });
    }
    track.evaluations = stepper.counts()[2];
    track.wall_s = clock.elapsed().as_secs_f64();
    Ok(track)
}

/// Extrapolation in f64 of (q, v, auxiliary quantities).
fn plain(
    simulation: &mut Simulation,
    first: &Track,
    breaks: &[f64],
    seconds: f64,
    look: &mut dyn FnMut(&str) -> bool,
) -> Track {
    let Simulation { dynamics, start, .. } = simulation;
    let (nq, nv, na) = (dynamics.model().nq(), dynamics.model().nv(), dynamics.auxiliary_len());
    let mut y = [&start.q[..], &start.v, &vec![0.0; na]].concat();
    y.truncate(nq + nv + na);
    let model = dynamics.model().clone();
    let mut rate =
        |t: f64, y: &[f64], out: &mut [f64]| -> Result<(), MotionError> { derivative(dynamics, t, y, out) };
    let times: Vec<f64> = first.states.iter().map(|s| s.t).collect();
    extrapolate(&model, (start.t, y), PLAIN, &times, breaks, first, seconds, &mut rate, look)
}

fn derivative(dynamics: &mut Dynamics, t: f64, y: &[f64], out: &mut [f64]) -> Result<(), MotionError> {
    let (nq, nv) = (dynamics.model().nq(), dynamics.model().nv());
    let (q, rest) = y.split_at(nq);
    let (v, aux) = rest.split_at(nv);
    let (q_dot, rest) = out.split_at_mut(nq);
    let (v_dot, aux_dot) = rest.split_at_mut(nv);
    coordinate_rate(dynamics.model(), q, v, q_dot);
    aux_dot.fill(0.0);
    dynamics.derivative(t, q, v, aux, v_dot, aux_dot)
}

/// Extrapolation in double-double numbers; `None` if a force cannot be had in them.
fn wide(
    simulation: &Simulation,
    first: &Track,
    times: &[f64],
    seconds: f64,
    look: &mut dyn FnMut(&str) -> bool,
) -> Option<Track> {
    let mut dynamics = WideDynamics::new(&simulation.dynamics)?;
    let State { q, v, t } = &simulation.start;
    let mut y: Vec<Dd> = q.iter().chain(v).map(|x| Dd::from_f64(*x)).collect();
    simulation.model().normalize(&mut y[..q.len()]);
    let mut rate = |_: f64, y: &[Dd], out: &mut [Dd]| dynamics.derivative(y, out);
    let times = &times[..first.states.len()];
    Some(extrapolate(simulation.model(), (*t, y), WIDE, times, &[], first, seconds, &mut rate, look))
}

/// The second reference; it ends where it has nothing to do with the first one any more.
#[allow(clippy::too_many_arguments)] // where, how exactly, until when
fn extrapolate<T: Real, E: std::fmt::Display>(
    model: &Model,
    (t, y): (f64, Vec<T>),
    tolerance: f64,
    times: &[f64],
    breaks: &[f64],
    first: &Track,
    seconds: f64,
    rate: &mut Rate<'_, T, E>,
    look: &mut dyn FnMut(&str) -> bool,
) -> Track {
    let clock = Instant::now();
    let (nq, nv) = (model.nq(), model.nv());
    let mut track = Track { states: Vec::new(), evaluations: 0, wall_s: 0.0, ended: None };
    let mut method = Extrapolation::new(t, y, tolerance);
    let settle = |y: &mut [T]| model.normalize(&mut y[..nq]);
    'instants: for (&time, other) in times.iter().zip(&first.states) {
        while method.t() < time {
            let next = breaks.partition_point(|b| *b <= method.t());
            let (limit, latest) = match breaks.get(next) {
                Some(b) if *b <= time => (*b, b.next_down()),
                _ => (time, f64::INFINITY),
            };
            if let Err(e) = method.step(limit, latest, rate, &settle) {
                track.ended = Some(match e {
                    ExtrapolationError::StepUnderflow { t } => {
                        format!("at t = {t} no step of the second reference meets {tolerance:e}")
                    }
                    ExtrapolationError::Derivative { t, cause } => format!("at t = {t}: {cause}"),
                });
            } else if look("reference by extrapolation") {
                track.ended = Some("stopped by the user".into());
            } else if clock.elapsed().as_secs_f64() > seconds {
                track.ended = Some(format!("{seconds:.0} s of wall time were used up"));
            }
            if track.ended.is_some() {
                break 'instants;
            }
        }
        let plain = |y: &[T]| y.iter().map(|x| x.to_f64()).collect();
        let y = method.y();
        let state = State { q: plain(&y[..nq]), v: plain(&y[nq..nq + nv]), t: time };
        let difference = apart(model, other, &state)[0];
        let lost = difference.is_nan() || difference > LOST;
        track.states.push(state);
        if lost {
            track.ended = Some("the references have parted".into());
            break;
        }
    }
    track.evaluations = method.evaluations();
    track.wall_s = clock.elapsed().as_secs_f64();
    track
}
