//! Events of a mechanism: the user's functions, stops that are struck, joints that stick and slip.
//!
//! | symbol | meaning |
//! |---|---|
//! | s, e | distance from a stop, its restitution |
//! | T | force that holds a joint at rest, besides all others |
//! | f, f₀ | sliding and breakaway force of dry friction; 0 without |
//!
//! Guards, positive in their mode: s of each stop while a joint moves, v or −v while it slides; f₀ − |T| while it sticks, T + f₀ on a lower
//! stop, f₀ − T on an upper one. At rest the modes follow from an active set: every joint at rest is held at first, those whose T is too
//! large are released one by one, and held again where they would move against their release. Several sticking joints of closed loops hold
//! each other, so that T is not determined: they stick together as long as no joint moves with the breakaway forces of all against the way
//! in which they would move without.

use super::{Dynamics, MotionError, Solver};
use crate::constraints::Constraints;
use crate::event::{
    Action, Changing, Consequence, Direction, Energies, Event, Events, Function, Happening, Mode, Occurrence,
};
use crate::force::Situation;
use crate::impact::impulses;
use crate::integrate::Tolerances;
use crate::plan::Plan;
use crate::prescription::Prescription;
use crate::switch::{JointSwitch, Switches};
use crate::system::System;
use phipsi_model::Model;
use phipsi_recursion::{kinetic_energy, potential_energy};

mod resting;

/// Guards of a joint: lower stop, upper stop, sliding or holding.
const GUARDS: usize = 3;

/// Relative rounding of forces and accelerations that decide about modes.
const ROUNDING: f64 = 1e-11;

/// Tolerances of events, however loose those of the steps are.
const LOOSEST: f64 = 1e-6;

impl Dynamics {
    /// With motions that are given, and joints with stops and dry friction.
    ///
    /// # Errors
    /// As [`Dynamics::prescribed`]; [`MotionError::Switch`] for stops and friction that cannot be.
    pub fn switching(
        model: &Model,
        forces: Vec<Box<dyn crate::Force>>,
        prescription: &Prescription,
        joints: Vec<JointSwitch>,
    ) -> Result<Self, MotionError> {
        // A given motion is followed whatever friction says, and within or without stops.
        let given = |joint: &JointSwitch| prescription.joints.iter().any(|p| p.dof == joint.dof);
        let joints: Vec<JointSwitch> = joints.into_iter().filter(|j| !given(j)).collect();
        let switches = Switches::new(model, joints)?;
        let mut plan = Plan::new(model, &forces).with_prescription(model, prescription);
        if !switches.joints.is_empty() {
            plan = plan.with_switches(model, switches.joints.iter().map(|j| j.dof));
        }
        let mut dynamics = Self::planned(model, forces, plan, prescription)?;
        dynamics.switches = switches;
        let strikes = dynamics.switches.joints.iter().any(|j| j.stops.is_some());
        let ready = |c: Constraints| if strikes { c.with_impulses(model) } else { Ok(c) };
        match &mut dynamics.solver {
            Solver::Constrained(_) if !strikes => {}
            Solver::Constrained(c) => **c = ready(Constraints::general(model, prescription)?)?,
            Solver::Tree(_) if dynamics.switches.joints.is_empty() => {}
            Solver::Tree(_) => {
                dynamics.holder = Some(Box::new(ready(Constraints::general(model, prescription)?)?));
            }
        }
        dynamics.spread_form()?;
        Ok(dynamics)
    }
    /// The same with further events.
    pub fn with_events(mut self, events: Vec<Event>) -> Self {
        self.add_events(events);
        self
    }
    /// Adds events.
    pub fn add_events(&mut self, events: Vec<Event>) {
        self.plan.kinematics |= events.iter().any(|e| e.kinematics);
        self.switches.events.extend(events);
    }
    /// Whether events that stop a run are recorded only.
    pub fn pass_over_stops(&mut self, pass: bool) {
        self.switches.passes_over_stops = pass;
    }
    /// True if the passage of a user's event ends the run.
    pub(crate) fn ends(&self, event: usize) -> bool {
        matches!(self.switches.events[event].action, Action::Stop) && !self.switches.passes_over_stops
    }
    /// Joints with stops and dry friction.
    pub fn switches(&self) -> &[JointSwitch] {
        &self.switches.joints
    }
    /// The user's events.
    pub fn user_events(&self) -> &[Event] {
        &self.switches.events
    }
    /// True if equations or state change at instants that the state decides.
    pub fn is_switching(&self) -> bool {
        !self.switches.joints.is_empty() || self.switches.events.iter().any(Event::changes)
    }
    /// The solver that can hold joints.
    pub(super) fn constraints(&mut self) -> Option<&mut Constraints> {
        match (&mut self.solver, &mut self.holder) {
            (Solver::Constrained(c), _) | (Solver::Tree(_), Some(c)) => Some(c),
            _ => None,
        }
    }
    /// Accelerations at a state in the present modes, and what holds the joints that do not move.
    fn look(&mut self, t: f64, (q, v, aux): (&[f64], &[f64], &[f64])) -> Result<(), MotionError> {
        let mut aux_dot = vec![0.0; aux.len()];
        let mut a = std::mem::take(&mut self.switches.acceleration);
        if !self.switches.any_held {
            let result = self.derivative(t, q, v, aux, &mut a, &mut aux_dot);
            self.switches.acceleration = a;
            return result;
        }
        let mut holding = std::mem::take(&mut self.switches.holding);
        let collected = self.collect(t, (q, v, aux), &mut aux_dot);
        let tau = std::mem::take(&mut self.tau);
        let wrenches = std::mem::take(&mut self.wrenches);
        let loads = self.plan.wrenches.then_some(&wrenches[..]);
        let result = match (collected, self.constraints()) {
            (Err(e), _) => Err(e),
            (Ok(()), Some(c)) => {
                c.run_holding((t, q, v), &tau, loads, &mut a, &mut holding).map_err(MotionError::from)
            }
            (Ok(()), None) => Ok(()),
        };
        let size = |x: &[f64]| x.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        self.switches.scale = size(&tau).max(size(&holding));
        (self.tau, self.wrenches) = (tau, wrenches);
        (self.switches.acceleration, self.switches.holding) = (a, holding);
        result
    }
    /// Values of the functions of the user's events.
    pub(crate) fn user_values(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        out: &mut [f64],
    ) -> Result<(), MotionError> {
        if self.switches.events.is_empty() {
            return Ok(());
        }
        let mut energies = Energies::default();
        if self.switches.events.iter().any(Event::looks_at_energies) {
            energies.kinetic = kinetic_energy(&self.layout, q, v)?;
            energies.potential =
                potential_energy(&self.layout, q)? + self.potentials(t, q, v)?.iter().sum::<f64>();
        }
        if self.switches.events.iter().any(|e| e.kinematics) {
            self.place(q, v)?;
        }
        let kinematics = self.plan.kinematics.then_some(&self.kinematics);
        let at = Situation { model: &self.model, layout: &self.layout, t, q, v, kinematics };
        for (event, out) in self.switches.events.iter_mut().zip(out) {
            *out = match &mut event.function {
                Function::Motion(function) => function(&at),
                Function::Energy(function) => function(&at, energies),
            };
        }
        Ok(())
    }
    fn enter_modes(&mut self, modes: &[Mode]) {
        self.switches.enter(modes);
        let held = std::mem::take(&mut self.switches.held);
        if let Some(c) = self.constraints() {
            c.hold_joints(&held);
        }
        self.switches.held = held;
    }

    /// Stops that are touched: joint switch, whether the upper one.
    fn touched(&self, q: &[f64], tolerances: &Tolerances) -> Vec<(usize, bool)> {
        let mut found = Vec::new();
        for (k, joint) in self.switches.joints.iter().enumerate() {
            for (i, gap) in joint.gaps(q).into_iter().enumerate() {
                if gap <= reach(joint, q, tolerances) {
                    found.push((k, i == 1));
                }
            }
        }
        found
    }

    /// All stops that are touched push back at once. Joints that come to rest go to `resting`.
    fn strike(
        &mut self,
        state: &mut Changing<'_>,
        tolerances: &Tolerances,
        resting: &mut Vec<usize>,
        log: &mut Vec<Occurrence>,
    ) -> Result<(), MotionError> {
        let t = state.t;
        let touched = self.touched(state.q, tolerances);
        let joints = self.switches.joints.clone();
        let sign = |upper: bool| if upper { -1.0 } else { 1.0 };
        let before: Vec<f64> =
            touched.iter().map(|(k, upper)| sign(*upper) * state.v[joints[*k].dof]).collect();
        if before.iter().all(|s| *s >= 0.0) {
            return Ok(());
        }
        self.look(t, (state.q, state.v, state.aux))?;
        let (m, nv) = (touched.len(), state.v.len());
        let mut restitution = vec![0.0; m];
        let mut endless = vec![false; m];
        for (i, (k, upper)) in touched.iter().enumerate().filter(|(i, _)| before[*i] < 0.0) {
            let e = joints[*k].stops.map_or(0.0, |s| s.restitution);
            let push = sign(*upper) * self.switches.acceleration[joints[*k].dof];
            let size = joints[*k].stops.map_or(0.0, |s| state.q[s.coordinate].abs());
            endless[i] = is_endless(t, size, e, [before[i], push], tolerances);
            restitution[i] = if endless[i] { 0.0 } else { e };
        }
        let mut responses = vec![0.0; m * nv];
        let mut powers = vec![0.0; m];
        let v = state.v.to_vec();
        if let Some(c) = self.constraints() {
            for (i, (k, upper)) in touched.iter().enumerate() {
                let out = &mut responses[i * nv..(i + 1) * nv];
                powers[i] = sign(*upper) * c.respond((t, state.q, &v), joints[*k].dof, out)?;
                out.iter_mut().for_each(|x| *x *= sign(*upper));
            }
        }
        let of = |i: usize| (sign(touched[i].1), joints[touched[i].0].dof);
        let mut a = vec![0.0; m * m];
        for i in 0..m {
            let (sign, dof) = of(i);
            for j in 0..m {
                a[i * m + j] = sign * responses[j * nv + dof];
            }
        }
        let b: Vec<f64> = (0..m).map(|i| (1.0 + restitution[i]) * before[i]).collect();
        let p = impulses(&a, &b);
        for (j, p) in p.iter().enumerate().filter(|(_, p)| **p > 0.0) {
            for (v, r) in state.v.iter_mut().zip(&responses[j * nv..(j + 1) * nv]) {
                *v += p * r;
            }
        }
        let fastest = v.iter().chain(state.v.iter()).fold(0.0f64, |most, x| most.max(x.abs()));
        for i in 0..m {
            let (sign, dof) = of(i);
            if p[i] > 0.0 {
                // Without the rounding of the sum: rest is rest.
                state.v[dof] = -sign * restitution[i] * before[i].min(0.0);
            }
            let after = sign * state.v[dof];
            let energy = -0.5 * p[i] * (before[i] + after);
            if self.plan.work {
                state.aux[0] += p[i] * powers[i] - energy;
            }
            if before[i] < 0.0 && p[i] > 0.0 {
                let what = Happening::Impact {
                    dof,
                    upper: touched[i].1,
                    speed: [sign * before[i], state.v[dof]],
                    energy,
                };
                log.push(Occurrence { t, what });
            }
            if endless[i] {
                let what = Happening::Rest { dof, upper: touched[i].1, endless: true };
                log.push(Occurrence { t, what });
            }
            if state.v[dof] == 0.0 {
                resting.push(touched[i].0);
            }
        }
        for (k, joint) in joints.iter().enumerate() {
            let speed = &mut state.v[joint.dof];
            if state.modes[k].holds() && speed.abs() <= 64.0 * f64::EPSILON * fastest {
                *speed = 0.0;
            }
            if *speed != 0.0 {
                state.modes[k] = joint.moving(*speed);
            }
        }
        Ok(())
    }

    /// Modes at the start of a run.
    fn begin(
        &mut self,
        state: &mut Changing<'_>,
        tolerances: &Tolerances,
        log: &mut Vec<Occurrence>,
    ) -> Result<(), MotionError> {
        let joints = self.switches.joints.clone();
        let mut resting = Vec::new();
        for (k, joint) in joints.iter().enumerate() {
            let gaps = joint.gaps(state.q);
            let reach = reach(joint, state.q, tolerances);
            if let Some(stops) = joint.stops
                && let Some(upper) = [0, 1].into_iter().find(|&i| gaps[i].is_nan() || gaps[i] < -reach)
            {
                return Err(MotionError::BeyondStop {
                    joint: self.model.joints()[self.model.joint_of_velocity(joint.dof).0].name.clone(),
                    position: state.q[stops.coordinate],
                    stop: if upper == 1 { stops.upper } else { stops.lower },
                });
            }
            state.modes[k] = joint.moving(state.v[joint.dof]);
            if state.v[joint.dof] == 0.0 {
                resting.push(k);
            }
        }
        self.enter_modes(state.modes);
        self.strike(state, tolerances, &mut resting, log)?;
        self.decide(state, tolerances, &resting, None, log)
    }

    /// Passage of a guard.
    fn pass(
        &mut self,
        i: usize,
        state: &mut Changing<'_>,
        tolerances: &Tolerances,
        log: &mut Vec<Occurrence>,
    ) -> Result<(), MotionError> {
        let (k, guard) = (i / GUARDS, i % GUARDS);
        let joint = self.switches.joints[k];
        let mut resting = Vec::new();
        let mut released = None;
        if guard < 2 {
            if let Some(stops) = joint.stops {
                state.q[stops.coordinate] = if guard == 1 { stops.upper } else { stops.lower };
            }
            self.strike(state, tolerances, &mut resting, log)?;
        } else if state.modes[k].holds() {
            released = Some(k);
        } else {
            state.v[joint.dof] = 0.0;
            resting.push(k);
        }
        // Joints of one linkage come to rest at the same instant, up to rounding.
        let slow = 1e-4 * tolerances.rtol.min(LOOSEST);
        for (k, joint) in self.switches.joints.iter().enumerate() {
            if joint.friction.is_some() && state.v[joint.dof].abs() <= slow && !resting.contains(&k) {
                resting.push(k);
            }
        }
        self.decide(state, tolerances, &resting, released, log)
    }
}

/// Distance at which a stop counts as touched: what the tolerance does not tell from it.
fn reach(joint: &JointSwitch, q: &[f64], tolerances: &Tolerances) -> f64 {
    let Some(stops) = joint.stops else { return 0.0 };
    let finite = |x: f64| if x.is_finite() { x.abs() } else { 0.0 };
    let size = finite(stops.lower).max(finite(stops.upper)).max(q[stops.coordinate].abs());
    (0.1 * tolerances.atol.min(LOOSEST)).max(64.0 * f64::EPSILON * size)
}

/// True if the impacts that follow are smaller than the tolerance tells from rest, or than rounding of time and position does.
/// `speed` < 0 before, `push` < 0 towards the stop, `size` of its position.
fn is_endless(t: f64, size: f64, restitution: f64, [speed, push]: [f64; 2], tolerances: &Tolerances) -> bool {
    if !(push < 0.0 && restitution > 0.0 && restitution < 1.0) {
        return false;
    }
    let rebound = restitution * speed.abs();
    let (height, flight) = (0.5 * rebound * rebound / -push, 2.0 * rebound / -push);
    let small = rebound <= 0.1 * tolerances.rtol.min(LOOSEST) && height <= 0.1 * tolerances.atol.min(LOOSEST);
    small || flight <= 64.0 * f64::EPSILON * t.abs() || height <= 32.0 * f64::EPSILON * size
}

impl Events for Dynamics {
    type Error = MotionError;

    fn functions(&self) -> usize {
        GUARDS * self.switches.joints.len() + self.switches.events.len()
    }
    fn modes(&self) -> usize {
        self.switches.joints.len()
    }
    fn direction(&self, i: usize) -> Direction {
        match i.checked_sub(GUARDS * self.switches.joints.len()) {
            Some(user) => self.switches.events[user].direction,
            None => Direction::Falling,
        }
    }
    fn is_guard(&self, i: usize) -> bool {
        i < GUARDS * self.switches.joints.len()
    }
    fn acts(&self, i: usize) -> bool {
        match i.checked_sub(GUARDS * self.switches.joints.len()) {
            Some(user) => self.switches.events[user].changes(),
            None => true,
        }
    }
    fn enter(&mut self, modes: &[Mode]) {
        self.enter_modes(modes);
    }
    fn values(
        &mut self,
        t: f64,
        (q, v, aux): (&[f64], &[f64], &[f64]),
        out: &mut [f64],
    ) -> Result<u64, MotionError> {
        out.fill(f64::INFINITY);
        let evaluations = u64::from(self.switches.any_held);
        let mut together = None;
        if self.sticks_in_loops(&self.switches.modes) {
            let modes = self.switches.modes.clone();
            together = Some(self.margin(t, (q, v, aux), &modes)?.0);
        } else if self.switches.any_held {
            self.look(t, (q, v, aux))?;
        }
        let Switches { joints, modes, holding, .. } = &self.switches;
        for ((joint, mode), out) in joints.iter().zip(modes).zip(out.chunks_exact_mut(GUARDS)) {
            let force = holding[joint.dof];
            if !mode.holds() {
                out[..2].copy_from_slice(&joint.gaps(q));
            }
            out[2] = match mode {
                Mode::Free => f64::INFINITY,
                Mode::Forward => v[joint.dof],
                Mode::Backward => -v[joint.dof],
                Mode::Stuck => together.unwrap_or(joint.breakaway() - force.abs()),
                Mode::AtLower => force + joint.breakaway(),
                Mode::AtUpper => joint.breakaway() - force,
            };
        }
        let guards = GUARDS * self.switches.joints.len();
        self.user_values(t, q, v, &mut out[guards..])?;
        Ok(evaluations)
    }
    fn noise(&self, i: usize, q: &[f64], _: &[f64], tolerances: &Tolerances) -> f64 {
        let Some(joint) = self.switches.joints.get(i / GUARDS) else { return 0.0 };
        match i % GUARDS {
            2 if self.sticks_in_loops(&self.switches.modes) => ROUNDING,
            2 if self.switches.modes[i / GUARDS].holds() => {
                ROUNDING * (self.switches.scale + joint.breakaway())
            }
            2 => 1e-6 * tolerances.rtol.min(LOOSEST),
            _ => 1e-5 * reach(joint, q, tolerances),
        }
    }
    fn act(
        &mut self,
        cause: Option<usize>,
        state: &mut Changing<'_>,
        tolerances: &Tolerances,
        log: &mut Vec<Occurrence>,
    ) -> Result<Consequence, MotionError> {
        let guards = GUARDS * self.switches.joints.len();
        let Some(i) = cause else {
            self.begin(state, tolerances, log)?;
            return Ok(Consequence { changed: guards > 0, stop: false });
        };
        if i < guards {
            self.pass(i, state, tolerances, log)?;
            return Ok(Consequence { changed: true, stop: false });
        }
        log.push(Occurrence { t: state.t, what: Happening::Event { index: i - guards } });
        match &mut self.switches.events[i - guards].action {
            Action::Record => Ok(Consequence::default()),
            Action::Stop => Ok(Consequence { changed: false, stop: self.ends(i - guards) }),
            Action::Change(change) => {
                change(state.t, state.q, state.v);
                self.model.normalize(state.q);
                if guards > 0 {
                    self.begin(state, tolerances, log)?;
                }
                Ok(Consequence { changed: true, stop: false })
            }
        }
    }
}
