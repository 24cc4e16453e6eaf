//! A potential of atoms as forces on the torsion model: for the midpoint method, and as an ordinary [`Force`].

use crate::force_field::{ForceField, LeftOut};
use crate::potential::{Potential, PotentialError};
use crate::torsion_model::{GatherWorkspace, Poses, TorsionModel};
use phipsi_closure::ClosureError;
use phipsi_model::Model;
use phipsi_motion::{Conservative, Force, ForceError, Loads, Needs, Situation};
use phipsi_recursion::DynamicsError;
use phipsi_spatial::Vec3;
use std::cell::RefCell;
use std::fmt;
use std::sync::Arc;

/// Why forces have no value.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum MolecularError {
    /// The potential has none.
    Potential(PotentialError),
    /// A recursion failed.
    Dynamics(DynamicsError),
    /// Flexible rings that cannot be closed.
    Closure(ClosureError),
}

impl fmt::Display for MolecularError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MolecularError::Potential(e) => e.fmt(f),
            MolecularError::Dynamics(e) => e.fmt(f),
            MolecularError::Closure(e) => e.fmt(f),
        }
    }
}

impl std::error::Error for MolecularError {}

impl From<DynamicsError> for MolecularError {
    fn from(e: DynamicsError) -> Self {
        MolecularError::Dynamics(e)
    }
}

impl From<ClosureError> for MolecularError {
    fn from(e: ClosureError) -> Self {
        match e {
            ClosureError::Dynamics(e) => MolecularError::Dynamics(e),
            other => MolecularError::Closure(other),
        }
    }
}

/// A potential on a torsion model: one outward sweep for the positions, one inward sweep for the generalised forces.
pub struct MolecularForces<P> {
    torsion: Arc<TorsionModel>,
    potential: P,
    /// A slow part with its energies.
    slow: Option<(P, Vec<f64>)>,
    poses: Poses,
    positions: Vec<Vec3<f64>>,
    forces: Vec<Vec3<f64>>,
    energies: Vec<f64>,
    workspace: GatherWorkspace,
}

impl<P: Potential> MolecularForces<P> {
    /// A potential of the model's atoms.
    pub fn new(torsion: Arc<TorsionModel>, potential: P) -> Self {
        let zeros = vec![Vec3::zero(); torsion.atoms().len()];
        MolecularForces {
            poses: torsion.poses(),
            positions: zeros.clone(),
            forces: zeros,
            energies: vec![0.0; potential.terms().len()],
            workspace: torsion.gather_workspace(),
            torsion,
            potential,
            slow: None,
        }
    }
    /// The same with a part that changes slowly, which a step evaluates once: [`ForceField::split`], [`Midpoint::substeps`].
    ///
    /// [`Midpoint::substeps`]: phipsi_motion::Midpoint::substeps
    pub fn with_slow(mut self, slow: P) -> Self {
        let energies = vec![0.0; slow.terms().len()];
        self.slow = Some((slow, energies));
        self
    }
    /// The torsion model.
    pub fn torsion(&self) -> &Arc<TorsionModel> {
        &self.torsion
    }
    /// The potential.
    pub fn potential(&self) -> &P {
        &self.potential
    }
    /// Names of the terms and their energies (kJ/mol) at the last configuration.
    pub fn energies(&self) -> impl Iterator<Item = (&str, f64)> {
        let slow = self.slow.iter().flat_map(|(slow, energies)| slow.terms().iter().zip(energies));
        let all = self.potential.terms().iter().zip(&self.energies).chain(slow);
        all.map(|(name, energy)| (name.as_str(), *energy))
    }
    /// Positions of the atoms (nm) at the last configuration.
    pub fn positions(&self) -> &[Vec3<f64>] {
        &self.positions
    }
    /// Forces on the atoms (kJ/mol/nm) at the last configuration, of the part that was evaluated last.
    pub fn atom_forces(&self) -> &[Vec3<f64>] {
        &self.forces
    }
    /// The atom with the largest force at the last configuration, and that force, kJ/mol/nm.
    pub fn largest_force(&self) -> Option<(usize, f64)> {
        let sizes = self.forces.iter().map(|f| f.norm()).enumerate();
        sizes.max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

impl MolecularForces<ForceField> {
    /// Leaves out what is constant within rigid clusters, with its energy at this configuration: [`ForceField::leave_out`]. The
    /// generalised forces stay as they are; [`MolecularForces::atom_forces`] no longer have forces within clusters.
    ///
    /// # Errors
    /// No positions or no energy at this configuration.
    pub fn leave_out_constants(&mut self, q: &[f64]) -> Result<Vec<LeftOut>, MolecularError> {
        self.torsion.positions_into(q, &mut self.poses, &mut self.positions)?;
        let groups = self.torsion.rigid_groups();
        let mut left_out =
            self.potential.leave_out(&groups, &self.positions).map_err(MolecularError::Potential)?;
        if let Some((slow, _)) = &mut self.slow {
            left_out.extend(slow.leave_out(&groups, &self.positions).map_err(MolecularError::Potential)?);
        }
        Ok(left_out)
    }
}

impl<P: Potential> Conservative for MolecularForces<P> {
    type Error = MolecularError;

    fn evaluate(&mut self, q: &[f64], out: &mut [f64]) -> Result<f64, MolecularError> {
        self.torsion.positions_into(q, &mut self.poses, &mut self.positions)?;
        self.potential
            .evaluate(&self.positions, &mut self.energies, &mut self.forces)
            .map_err(MolecularError::Potential)?;
        self.torsion.gather_into(&self.poses, &self.forces, &mut self.workspace, out)?;
        Ok(self.energies.iter().sum())
    }
    fn has_slow(&self) -> bool {
        self.slow.is_some()
    }
    fn evaluate_slow(&mut self, q: &[f64], out: &mut [f64]) -> Result<f64, MolecularError> {
        let Some((slow, energies)) = &mut self.slow else {
            out.fill(0.0);
            return Ok(0.0);
        };
        self.torsion.positions_into(q, &mut self.poses, &mut self.positions)?;
        slow.evaluate(&self.positions, energies, &mut self.forces).map_err(MolecularError::Potential)?;
        self.torsion.gather_into(&self.poses, &self.forces, &mut self.workspace, out)?;
        Ok(energies.iter().sum())
    }
}

/// The last configuration of a [`PotentialForce`] and what was found there.
struct Cache<P> {
    forces: MolecularForces<P>,
    q: Vec<f64>,
    tau: Vec<f64>,
    energy: f64,
}

impl<P: Potential> Cache<P> {
    fn at(&mut self, q: &[f64]) -> Result<(), MolecularError> {
        if self.q != q {
            self.q.clear();
            self.energy = self.forces.evaluate(q, &mut self.tau)?;
            self.q.extend_from_slice(q);
        }
        Ok(())
    }
}

/// A potential of the atoms as a force among others on the model.
///
/// The [`Situation`] must be one of this torsion model's own [`TorsionModel::model`].
pub struct PotentialForce<P> {
    name: String,
    is_slow: bool,
    cache: RefCell<Cache<P>>,
}

impl<P: Potential> PotentialForce<P> {
    /// A named force.
    pub fn new(name: impl Into<String>, forces: MolecularForces<P>) -> Self {
        let tau = vec![0.0; forces.torsion.model().nv()];
        let cache = Cache { forces, q: Vec::new(), tau, energy: f64::NAN };
        PotentialForce { name: name.into(), is_slow: false, cache: RefCell::new(cache) }
    }
    /// The same as a slow part: of several steps in one it acts on the long one alone, [`phipsi_motion::Midpoint::substeps`].
    pub fn slow(self) -> Self {
        PotentialForce { is_slow: true, ..self }
    }
}

impl<P: Potential> Force for PotentialForce<P> {
    fn name(&self) -> &str {
        &self.name
    }
    fn needs(&self) -> Needs {
        Needs { conservative: true, ..Needs::default() }
    }
    fn is_slow(&self) -> bool {
        self.is_slow
    }
    /// A potential of the atoms' distances leaves their common momentum alone; a periodic box turns it.
    fn is_external(&self, _: &Model) -> bool {
        !self.cache.borrow().forces.potential.is_isotropic()
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        let cache = self.cache.get_mut();
        cache.at(at.q).map_err(|e| ForceError {
            force: self.name.clone(),
            t: at.t,
            message: e.to_string(),
        })?;
        for (total, tau) in loads.tau.iter_mut().zip(&cache.tau) {
            *total += tau;
        }
        Ok(())
    }
    /// NaN where the potential has no value.
    fn potential(&self, at: &Situation<'_>) -> f64 {
        let mut cache = self.cache.borrow_mut();
        if cache.at(at.q).is_ok() { cache.energy } else { f64::NAN }
    }
    fn terms(&self) -> Vec<String> {
        self.cache.borrow().forces.potential.terms().to_vec()
    }
    /// NaN where the potential has no value.
    fn term_energies(&self, at: &Situation<'_>) -> Vec<f64> {
        let mut cache = self.cache.borrow_mut();
        let known = cache.at(at.q).is_ok();
        cache.forces.energies.iter().map(|e| if known { *e } else { f64::NAN }).collect()
    }
}
