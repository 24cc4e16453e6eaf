//! Which joints at rest stay there: stick, rest on a stop, or leave.
//!
//! | symbol | meaning |
//! |---|---|
//! | T | force that holds a joint at rest, besides all others |
//! | f₀ | breakaway force of dry friction; 0 without |
//!
//! Every joint at rest is held at first; those whose T is too large are released one by one, the worst first, then by Murty's rule, and
//! held again where they would move against their release.

use super::{Dynamics, MotionError, ROUNDING};
use crate::event::{Changing, Happening, Mode, Occurrence};
use crate::integrate::Tolerances;
use crate::switch::Switches;

impl Dynamics {
    /// Modes of the joints at rest: those that are held now, and `resting`. `released`: leaves its mode in any case.
    pub(super) fn decide(
        &mut self,
        state: &mut Changing<'_>,
        tolerances: &Tolerances,
        resting: &[usize],
        released: Option<usize>,
        log: &mut Vec<Occurrence>,
    ) -> Result<(), MotionError> {
        let joints = self.switches.joints.clone();
        let n = joints.len();
        let before = state.modes.to_vec();
        let touched = self.touched(state.q, tolerances);
        // How a joint is held, where it is at rest.
        let mut holds = vec![None; n];
        for (k, joint) in joints.iter().enumerate() {
            if before[k].holds() {
                holds[k] = Some(before[k]);
            } else if resting.contains(&k) {
                let stop = touched.iter().find(|(other, _)| *other == k);
                holds[k] = match (stop, joint.friction) {
                    (Some((_, true)), _) => Some(Mode::AtUpper),
                    (Some((_, false)), _) => Some(Mode::AtLower),
                    (None, Some(_)) => Some(Mode::Stuck),
                    (None, None) => None,
                };
            }
            if let Some(hold) = holds[k] {
                state.modes[k] = hold;
                state.v[joint.dof] = 0.0;
            }
        }
        let mut way = vec![0.0; n];
        let mut keeps = released;
        let together = self.sticks_in_loops(state.modes);
        if together {
            let (margin, ways) = self.margin(state.t, (state.q, state.v, state.aux), state.modes)?;
            if released.is_some() || margin < 0.0 {
                for (k, mode) in state.modes.iter_mut().enumerate().filter(|(_, m)| **m == Mode::Stuck) {
                    *mode = joints[k].moving(ways[k]);
                }
            }
        } else if let Some(k) = released {
            self.enter_modes(state.modes);
            self.look(state.t, (state.q, state.v, state.aux))?;
            way[k] = release(state.modes[k], self.switches.holding[joints[k].dof]);
            state.modes[k] = joints[k].moving(way[k]);
        }
        let rounds = if together { 0 } else { 12 * n + 12 };
        for round in 0..rounds {
            self.enter_modes(state.modes);
            self.look(state.t, (state.q, state.v, state.aux))?;
            let Switches { holding, acceleration, scale, .. } = &self.switches;
            let mut worst: Option<(usize, f64)> = None;
            let fastest = acceleration.iter().fold(0.0f64, |most, a| most.max(a.abs()));
            for k in (0..n).filter(|k| holds[*k].is_some()) {
                let (dof, limit) = (joints[k].dof, joints[k].breakaway());
                let excess = match state.modes[k] {
                    Mode::Stuck => holding[dof].abs() - limit,
                    Mode::AtLower => -holding[dof] - limit,
                    Mode::AtUpper => holding[dof] - limit,
                    // Forces and accelerations are compared by the share of the largest one.
                    _ => -acceleration[dof] * way[k] * (scale / fastest.max(f64::MIN_POSITIVE)),
                };
                let allowed = ROUNDING * (scale + limit) * if keeps == Some(k) { 1e4 } else { 1.0 };
                if excess > allowed && (round < 4 * n + 4 || worst.is_none_or(|w| w.0 < k)) {
                    worst = match worst {
                        Some(w) if round < 4 * n + 4 && w.1 >= excess => Some(w),
                        _ => Some((k, excess)),
                    };
                }
            }
            let Some((k, _)) = worst else { break };
            if state.modes[k].holds() {
                way[k] = release(state.modes[k], holding[joints[k].dof]);
                state.modes[k] = joints[k].moving(way[k]);
            } else {
                state.modes[k] = holds[k].unwrap_or(Mode::Free);
                keeps = keeps.filter(|kept| *kept != k);
            }
        }
        self.enter_modes(state.modes);
        for (k, joint) in joints.iter().enumerate() {
            let (dof, t) = (joint.dof, state.t);
            if let (Mode::AtLower | Mode::AtUpper, Some(stops)) = (state.modes[k], joint.stops) {
                let upper = state.modes[k] == Mode::AtUpper;
                state.q[stops.coordinate] = if upper { stops.upper } else { stops.lower };
            }
            let what = match (before[k], state.modes[k]) {
                (a, b) if a == b => continue,
                (_, Mode::Stuck) => Happening::Stick { dof },
                (_, Mode::AtLower | Mode::AtUpper) => {
                    let upper = state.modes[k] == Mode::AtUpper;
                    let told = |o: &Occurrence| {
                        o.t == t && matches!(o.what, Happening::Rest { dof: other, .. } if other == dof)
                    };
                    if log.iter().rev().take(4 * n).any(told) {
                        continue;
                    }
                    Happening::Rest { dof, upper, endless: false }
                }
                (Mode::AtLower | Mode::AtUpper, _) => Happening::Leave { dof },
                (_, Mode::Free) => continue,
                (_, mode) => Happening::Slip { dof, forward: mode == Mode::Forward },
            };
            log.push(Occurrence { t, what });
        }
        Ok(())
    }

    /// True where several joints of closed loops stick, and none rests on a stop.
    pub(super) fn sticks_in_loops(&self, modes: &[Mode]) -> bool {
        let count = |wanted: &dyn Fn(Mode) -> bool| modes.iter().filter(|m| wanted(**m)).count();
        self.plan.loops
            && count(&|m| m == Mode::Stuck) > 1
            && count(&|m| m.holds()) == count(&|m| m == Mode::Stuck)
    }
    /// Whether joints that stick break away together: negative if they do, relative to the accelerations without friction; and the way
    /// of each joint.
    pub(super) fn margin(
        &mut self,
        t: f64,
        state: (&[f64], &[f64], &[f64]),
        modes: &[Mode],
    ) -> Result<(f64, Vec<f64>), MotionError> {
        let joints = self.switches.joints.clone();
        let stuck = |k: &usize| modes[*k] == Mode::Stuck;
        let free: Vec<Mode> = modes.iter().map(|m| if *m == Mode::Stuck { Mode::Free } else { *m }).collect();
        self.enter_modes(&free);
        self.look(t, state)?;
        let accelerations: Vec<f64> = joints.iter().map(|j| self.switches.acceleration[j.dof]).collect();
        let size = accelerations.iter().fold(0.0f64, |most, a| most.max(a.abs()));
        let way: Vec<f64> = accelerations.iter().map(|a| a.signum()).collect();
        for k in (0..joints.len()).filter(stuck) {
            self.switches.trial[joints[k].dof] = -way[k] * joints[k].breakaway();
        }
        let looked = self.look(t, state);
        self.switches.trial.fill(0.0);
        let moves = (0..joints.len())
            .filter(stuck)
            .map(|k| self.switches.acceleration[joints[k].dof] * way[k])
            .fold(f64::NEG_INFINITY, f64::max);
        self.enter_modes(modes);
        looked?;
        Ok((if size > 0.0 { -moves / size } else { f64::INFINITY }, way))
    }
}

/// Direction in which a joint leaves, held by a force T.
fn release(mode: Mode, holding: f64) -> f64 {
    match mode {
        Mode::AtLower => 1.0,
        Mode::AtUpper => -1.0,
        // Friction cannot push harder, so the joint gives way to what it is held against.
        _ => -holding.signum(),
    }
}
