//! Whether a scene is stiff: `method = "auto"` begins it with an explicit method and looks at what sets its steps.
//!
//! Steps that do not grow at a hundred times the tolerance are set by stability. Then both kinds of method go on from the same state for a
//! while, and the one that gets further for its work is taken. A scene that becomes stiff later is not found.

use crate::simulation::{Choice, Simulation, method_name};
use phipsi_model::State;
use phipsi_motion::{Method, Scheme, Stepper, System, Tolerances};

/// Accepted steps of the explicit method that are looked at.
const STEPS: usize = 120;

/// Accepted steps of the implicit one.
const IMPLICIT_STEPS: usize = 40;

/// A scene that an explicit method ends in so many evaluations needs no other.
const ENOUGH: f64 = 20_000.0;

/// Looks at an explicit method that its tolerance limits at first, where the whole run takes so many times more.
const LOOKS: usize = 6;
const WORTH: f64 = 10.0;

/// Most degrees of freedom of an implicit method: the factorisation of a step grows with their cube.
pub(crate) const MOST_DOF: usize = 200;

/// The implicit method must be this much cheaper to be taken.
const CHEAPER: f64 = 3.0;

/// Steps that are no longer at so many times the tolerance are set by stability.
const LOOSER: f64 = 100.0;

/// Loosest tolerance at which order 5 takes less than order 4, and the tightest at which an implicit method pays (notes on
/// integrators, section 7).
const LOOSE: f64 = 1e-4;
const TIGHT: f64 = 1e-10;

/// Work of a linearisation and factorisation, in evaluations: measured on trees of 4 to 30 degrees of freedom.
fn linearisation(nv: usize) -> f64 {
    4.0 + 0.3 * nv as f64
}

/// The implicit method, where the explicit one sits at its limit of stability and is dearer; `None` otherwise.
pub(crate) fn look(simulation: &mut Simulation) -> Option<Choice> {
    let Scheme::Explicit(explicit) = simulation.choice.method else { return None };
    let tolerance = simulation.tolerances.rtol.max(simulation.tolerances.atol);
    if simulation.molecule.is_some()
        || tolerance <= TIGHT
        || !(1..=MOST_DOF).contains(&simulation.model().nv())
    {
        return None;
    }
    let implicit = if tolerance >= LOOSE { Method::Rodas4 } else { Method::Rodas5p };
    let (settled, measured) = limited(simulation, explicit)?;
    let mut other = advance(simulation, implicit, &settled.end, IMPLICIT_STEPS / 2)?;
    // Steps after the first ones count, but for a run that those end.
    if other.complete {
        other = advance(simulation, implicit, &other.end, IMPLICIT_STEPS / 2)?;
    }
    let nv = simulation.model().nv();
    let work = other.evaluations + other.steps * linearisation(nv);
    let speed = (other.end.t - other.begin) / work;
    if speed < CHEAPER * measured.speed() {
        return None;
    }
    let step = |m: &Measured| (m.end.t - m.begin) / m.steps;
    let why = format!(
        "stiff: {} steps by {:.1e} {unit}, at {LOOSER} times the tolerance too: stability sets that; {} steps by {:.1e} {unit} \
         and gets {:.0} times as far for its work",
        method_name(explicit.into()),
        step(&measured),
        method_name(implicit.into()),
        step(&other),
        speed / measured.speed(),
        unit = simulation.time_unit(),
    );
    Some(Choice { method: implicit.into(), why })
}

/// Where the explicit method stands, and what it does next, once stability sets its steps; `None` if it does not.
fn limited(simulation: &mut Simulation, explicit: Method) -> Option<(Measured, Measured)> {
    let (start, span) = (simulation.start.clone(), simulation.t_end - simulation.start.t);
    // The first steps are short and follow fast motions that die out: only those after them count.
    let mut settled = advance(simulation, explicit, &start, STEPS / 2)?;
    for _ in 0..LOOKS {
        let measured = advance(simulation, explicit, &settled.end, STEPS / 2)?;
        let whole = span / measured.speed();
        if !measured.complete || whole < ENOUGH {
            return None;
        }
        // Steps that the tolerance sets would grow by 1.8 (order 8) or 2.5 (order 5).
        let tolerances = simulation.tolerances;
        (simulation.tolerances.rtol, simulation.tolerances.atol) =
            (LOOSER * tolerances.rtol, LOOSER * tolerances.atol);
        let loose = advance(simulation, explicit, &settled.end, STEPS / 2);
        simulation.tolerances = tolerances;
        let loose = loose?;
        if (loose.end.t - loose.begin) / loose.steps
            <= 1.4 * (measured.end.t - measured.begin) / measured.steps
        {
            return Some((settled, measured));
        }
        // A fast motion may still be dying out: where the run is long beside the look, it is worth another.
        if whole < WORTH * ENOUGH {
            return None;
        }
        settled = measured;
    }
    None
}

struct Measured {
    begin: f64,
    end: State,
    steps: f64,
    evaluations: f64,
    /// False if the run ended before all steps were made.
    complete: bool,
}

impl Measured {
    /// Time per evaluation.
    fn speed(&self) -> f64 {
        (self.end.t - self.begin) / self.evaluations
    }
}

/// Some steps of a method; `None` if one fails.
fn advance(simulation: &mut Simulation, method: Method, start: &State, steps: usize) -> Option<Measured> {
    let Tolerances { rtol, atol, max_step } = simulation.tolerances;
    let tolerances = Tolerances { rtol, atol, max_step };
    let t_end = simulation.t_end;
    let dynamics = &mut simulation.dynamics;
    let breaks = dynamics.breaks();
    let aux = vec![0.0; dynamics.auxiliary_len()];
    let mut stepper = Stepper::new(dynamics, method.into(), tolerances, start, &aux).ok()?;
    let mut made = 0;
    while made < steps && stepper.t() < t_end {
        let next = breaks.partition_point(|b| *b <= stepper.t());
        let limit = breaks.get(next).copied().filter(|b| *b < t_end);
        let info = stepper.step(dynamics, limit.unwrap_or(t_end), limit.is_some()).ok()?;
        if Some(info.t1) == limit {
            stepper.restart();
        }
        made += 1;
    }
    let end = State { q: stepper.q().to_vec(), v: stepper.v().to_vec(), t: stepper.t() };
    let complete = made == steps;
    Some(Measured {
        begin: start.t,
        end,
        steps: made.max(1) as f64,
        evaluations: stepper.counts()[2] as f64,
        complete,
    })
}
