//! A heat bath between the steps of the midpoint method: what makes a run sample an ensemble.

use crate::atoms::MoleculeError;
use crate::center_of_mass::{is_translation_free, remove_momentum};
use crate::deviates::{Deviates, DeviatesState};
use crate::ensemble::Ensemble;
use crate::hybrid_monte_carlo::{Trajectory, Trials};
use crate::langevin::Exchange;
use crate::nose_hoover::{ChainState, Chains, outer_closure};
use phipsi_motion::{Conservative, Midpoint, MidpointError, MidpointState};
use phipsi_recursion::DynamicsError;

/// The stream of a seed from which baths draw; the first one gives the velocities at the start.
const STREAM: u64 = 1 << 32;

/// Refused Langevin drifts one after the other after which the step is the fault, and not the momenta.
const MOST_IN_A_ROW: u64 = 20;

/// Everything of a bath that continues a run bit for bit, beside the [`MidpointState`].
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BathState {
    /// The place in the stream of random numbers.
    pub deviates: DeviatesState,
    /// Energy that the bath has given.
    pub heat: f64,
    /// Chains of rigid and of internal motion.
    pub chains: [ChainState; 2],
    /// Monte Carlo trajectories; of Langevin dynamics the refused drifts.
    pub trials: Trials,
    /// Refused Langevin drifts up to now, one after the other.
    pub in_a_row: u64,
}

/// A heat bath.
///
/// K + U − [`Bath::heat`] is the conserved quantity: the energy at constant energy; the energy less the heat of friction and
/// noise in Langevin dynamics; the extended energy of Nosé–Hoover chains; for Monte Carlo the sum of the steps' errors.
#[derive(Clone, Debug)]
pub struct Bath {
    ensemble: Ensemble,
    kt: f64,
    deviates: Deviates,
    heat: f64,
    chains: [ChainState; 2],
    trials: Trials,
    in_a_row: u64,
    removed: usize,
    exchange: Exchange,
    thermostats: Chains,
    trajectory: Trajectory,
    saved: MidpointState,
}

impl Bath {
    /// For a method at its start. In the ensemble of Nosé–Hoover the common linear momentum of free trees is removed here.
    /// `kt`: in the units of the model's energy.
    ///
    /// # Errors
    /// [`MoleculeError`] that names the parameter which is wrong.
    pub fn new(method: &mut Midpoint, ensemble: Ensemble, kt: f64, seed: u64) -> Result<Self, MoleculeError> {
        ensemble.check()?;
        let canonical = ensemble != Ensemble::ConstantEnergy;
        if !(kt.is_finite() && (kt > 0.0 || !canonical && kt == 0.0)) {
            let found = format!("kT = {kt}");
            let remedy = "give a temperature above zero, or take constant energy";
            return Err(MoleculeError::new("temperature", found, "a positive finite number", remedy));
        }
        let singular = |e: DynamicsError| {
            MoleculeError::new("model", e.to_string(), "a regular mass matrix", "lock the named hinge")
        };
        let constrained = method.model().nv() - method.degrees_of_freedom().map_err(singular)?;
        let closed = method.loops().map_err(singular)?.map_or(0, |closed| closed.rank());
        if let Ensemble::NoseHoover { .. } = ensemble
            && let Some(closure) = outer_closure(method)
        {
            let found = format!("nose_hoover with closure `{closure}` to another tree or the world");
            let remedy = "take \"langevin\"";
            return Err(MoleculeError::new("ensemble", found, "closures within one molecule", remedy));
        }
        let mut removed = 0;
        if let Ensemble::NoseHoover { .. } = ensemble
            && is_translation_free(method.layout())
        {
            removed = 3;
            let mut p = method.state().p.clone();
            if remove_momentum(method.layout(), &method.state().q, &mut p) > 0.0 {
                method.set_momenta(&p).map_err(singular)?;
            }
        }
        let relaxation = if let Ensemble::NoseHoover { relaxation } = ensemble { relaxation } else { 1.0 };
        let mut deviates = Deviates::stream(seed, STREAM);
        let thermostats = Chains::new(method, kt, relaxation, removed, closed);
        let mut chains = Default::default();
        if let Ensemble::NoseHoover { .. } = ensemble {
            chains = thermostats.draw(&mut deviates);
        }
        let mut bath = Bath {
            ensemble,
            kt,
            deviates,
            heat: 0.0,
            chains,
            trials: Trials::default(),
            in_a_row: 0,
            removed: removed + constrained,
            exchange: Exchange::new(method),
            thermostats,
            trajectory: Trajectory::new(method),
            saved: method.state().clone(),
        };
        if let Ensemble::NoseHoover { .. } = ensemble {
            bath.heat = -bath.thermostats.energy(&bath.chains);
        }
        Ok(bath)
    }
    /// A bath of another model that goes on where this one is: with its random numbers, its heat and its counts. Chains of thermostats,
    /// whose masses are those of the degrees of freedom, are drawn anew; the heat is less by their energy then.
    ///
    /// # Errors
    /// As [`Bath::new`].
    pub fn of_another(&self, method: &mut Midpoint) -> Result<Self, MoleculeError> {
        let mut next = Bath::new(method, self.ensemble, self.kt, 0)?;
        next.deviates = self.deviates.clone();
        (next.trials, next.heat) = (self.trials, self.heat);
        if let Ensemble::NoseHoover { .. } = self.ensemble {
            next.chains = next.thermostats.draw(&mut next.deviates);
            next.heat = -next.thermostats.energy(&next.chains);
        }
        Ok(next)
    }
    /// The ensemble.
    pub fn ensemble(&self) -> Ensemble {
        self.ensemble
    }
    /// kT.
    pub fn kt(&self) -> f64 {
        self.kt
    }
    /// Energy given to the model so far; less that of the chains where there are any.
    pub fn heat(&self) -> f64 {
        self.heat
    }
    /// Monte Carlo trajectories so far.
    pub fn trials(&self) -> &Trials {
        &self.trials
    }
    /// Degrees of freedom that are coupled to the bath: nv, less the rows that close rings and the lines of linear molecules, less three where the common momentum
    /// is zero. 2 K/(n k) is the temperature.
    pub fn degrees_of_freedom(&self) -> usize {
        self.saved.p.len() - self.removed
    }
    /// What a checkpoint keeps.
    pub fn state(&self) -> BathState {
        let deviates = self.deviates.state();
        let Bath { heat, chains, trials, in_a_row, .. } = *self;
        BathState { deviates, heat, chains, trials, in_a_row }
    }
    /// Continues from a checkpoint of the same run; the method is restored by itself.
    pub fn restore(&mut self, state: &BathState) {
        self.deviates = Deviates::at(state.deviates);
        (self.heat, self.chains) = (state.heat, state.chains);
        (self.trials, self.in_a_row) = (state.trials, state.in_a_row);
    }

    /// One step of size h, or one Monte Carlo trajectory, of at most `most` steps. Returns how many.
    ///
    /// # Errors
    /// [`MidpointError`]; method and bath are as before. Monte Carlo refuses trajectories instead; Langevin dynamics meets a
    /// drift that does not converge by reversing the momenta, which leaves the distribution as it is, up to twenty times in a
    /// row.
    pub fn advance<C: Conservative>(
        &mut self,
        method: &mut Midpoint,
        system: &mut C,
        h: f64,
        most: u64,
    ) -> Result<u64, MidpointError<C::Error>> {
        self.saved.copy(method.state());
        let before = self.state();
        let done = self.attempt(method, system, h, most);
        if done.is_err() {
            self.restore(&before);
            let t = self.saved.t;
            method.reset(&self.saved).map_err(|cause| MidpointError::Dynamics { t, cause })?;
        }
        done
    }

    fn attempt<C: Conservative>(
        &mut self,
        method: &mut Midpoint,
        system: &mut C,
        h: f64,
        most: u64,
    ) -> Result<u64, MidpointError<C::Error>> {
        let t = method.state().t;
        let failed = |cause| MidpointError::Dynamics { t, cause };
        match self.ensemble {
            Ensemble::ConstantEnergy => {
                method.step(system, h)?;
            }
            Ensemble::Langevin { friction } => {
                let c = (-0.5 * friction * h).exp();
                let (exchange, deviates) = (&mut self.exchange, &mut self.deviates);
                self.heat += exchange.run(method, deviates, self.kt, c).map_err(failed)?.0;
                match method.step(system, h) {
                    Ok(_) => self.in_a_row = 0,
                    Err(MidpointError::NotConverged { iterations, .. }) if self.in_a_row < MOST_IN_A_ROW => {
                        let state = method.state();
                        let counts = (t + h, state.steps + 1, state.iterations + iterations as u64);
                        exchange.reverse(method).map_err(failed)?;
                        method.count(counts.0, counts.1, counts.2);
                        self.in_a_row += 1;
                        self.trials.refused += 1;
                    }
                    Err(e) => return Err(e),
                }
                self.heat += exchange.run(method, deviates, self.kt, c).map_err(failed)?.0;
            }
            Ensemble::NoseHoover { .. } => {
                let thermostats = &mut self.thermostats;
                thermostats.run(method, &mut self.chains, 0.5 * h).map_err(failed)?;
                method.step(system, h)?;
                thermostats.run(method, &mut self.chains, 0.5 * h).map_err(failed)?;
                self.heat = -thermostats.energy(&self.chains);
            }
            Ensemble::HybridMonteCarlo { steps } => {
                let n = steps.min(most).max(1);
                self.heat += self.trajectory.run(
                    (method, system),
                    (&mut self.exchange, &mut self.deviates),
                    &mut self.trials,
                    self.kt,
                    (h, n),
                )?;
                return Ok(n);
            }
        }
        Ok(1)
    }
}
