//! Freeze and thaw: other clusters from the state of a run, with velocities projected and the energy accounted for.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | u | velocities of the atoms; ‖u‖² = Σ m u², twice the kinetic energy | |
//! | T | what velocities the hinges allow at these positions: a linear space of u | |
//! | Π | projection onto T in that metric: u ↦ J v, v = M⁻¹ J* m u | |
//!
//! Velocities become Π u: the least change of kinetic energy, as an inelastic lock of the hinges. Rigid motions of each molecule
//! lie in every T, so that linear and angular momentum of each are kept; ‖u‖² − ‖Πu‖² = ‖u − Πu‖². Where hinges are thawed only,
//! T grows and Πu = u. Of velocities with the Maxwell–Boltzmann distribution on the old T, those projected onto a part of it have
//! the one of that part.
//!
//! Thawed hinges begin without speed against each other; with a temperature their speeds are drawn: w − Π_old w, w drawn on the
//! new T, is what a Maxwell–Boltzmann distribution has across the old T.

use crate::atoms::{Atoms, MoleculeError, MoleculeErrors};
use crate::clustering::Clustering;
use crate::clusters::Clusters;
use crate::deviates::Deviates;
use crate::torsion_model::{GatherWorkspace, Poses, TorsionModel, loops_failed};
use crate::velocities::draw_velocities;
use phipsi_closure::ClosedMomenta;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{ArticulatedSweep, DynamicsError};
use phipsi_spatial::Vec3;

/// The kinetic energies of a change of clusters, kJ/mol: `after` = `before` − `removed` + `drawn`, to rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Ledger {
    /// Before.
    pub before: f64,
    /// Lost by what was frozen: ½ ‖u − Πu‖².
    pub removed: f64,
    /// Given by the draw to what was thawed.
    pub drawn: f64,
    /// After.
    pub after: f64,
    /// Degrees of freedom before and after.
    pub degrees_of_freedom: [usize; 2],
}

/// A molecule with other clusters, in the state that it was in.
#[derive(Clone, Debug)]
pub struct Reclustered {
    /// The model, whose neutral configuration has the positions of the state.
    pub torsion: TorsionModel,
    /// The neutral configuration.
    pub q: Vec<f64>,
    /// Velocities.
    pub v: Vec<f64>,
    /// What became of the kinetic energy. The potential energy is that of the same positions.
    pub ledger: Ledger,
}

/// Other clusters from a state of a torsion model.
///
/// # Computes
/// The model of the clusters at the positions of q, v = M⁻¹ J* m u there, and the energies of [`Ledger`]. With `thaw`
/// (temperature in K, deviates) the speeds of thawed degrees of freedom are drawn.
///
/// # Shapes & units
/// `q`: nq, `v`: nv of `torsion`; rad, nm, ps.
///
/// # Accuracy
/// Positions are those of q to rounding; atoms of molecules that become linear are put on one line
/// ([`TorsionModel::straightened`]). The draw is exact where hinges are frozen only or thawed only; make two calls, the freeze
/// first, where a change does both.
///
/// # Cost
/// That of making a model, and O(atoms).
///
/// # Errors
/// [`MoleculeErrors`]: lengths, clusters, hinges without inertia.
pub fn recluster(
    torsion: &TorsionModel,
    q: &[f64],
    v: &[f64],
    clustering: &Clustering,
    thaw: Option<(f64, &mut Deviates)>,
) -> Result<Reclustered, MoleculeErrors> {
    let atoms = torsion.atoms();
    let mut old = Tangent::new(torsion, q)?;
    let mut u = old.spread(v).map_err(|e| failed(&e))?;
    let clusters = Clusters::new(atoms, &old.positions, clustering)?;
    let next = TorsionModel::new(atoms, &old.positions, clusters)?;
    let start = next.model().neutral::<f64>();
    let mut new = Tangent::new(&next, &start)?;
    let mut ledger = Ledger {
        before: kinetic(atoms, &u),
        degrees_of_freedom: [torsion.degrees_of_freedom(), next.degrees_of_freedom()],
        ..Ledger::default()
    };
    let mut speeds = new.project(&u).map_err(|e| failed(&e))?;
    let kept = new.spread(&speeds).map_err(|e| failed(&e))?;
    subtract(&mut u, &kept);
    ledger.removed = kinetic(atoms, &u);
    if let Some((kelvin, deviates)) = thaw {
        let mut w = vec![0.0; speeds.len()];
        let mut workspace = SolveWorkspace::new(next.layout());
        draw_velocities(next.layout(), &new.sweep, kelvin, deviates, &mut workspace, &mut w);
        next.close_velocities(&start, &mut w)?;
        let mut across = new.spread(&w).map_err(|e| failed(&e))?;
        let along = old.project(&across).and_then(|v| old.spread(&v)).map_err(|e| failed(&e))?;
        subtract(&mut across, &along);
        let drawn = new.project(&across).map_err(|e| failed(&e))?;
        speeds.iter_mut().zip(&drawn).for_each(|(v, w)| *v += w);
    }
    let moving = new.spread(&speeds).map_err(|e| failed(&e))?;
    ledger.after = kinetic(atoms, &moving);
    ledger.drawn = ledger.after - kinetic(atoms, &kept);
    drop((old, new));
    Ok(Reclustered { torsion: next, q: start, v: speeds, ledger })
}

/// The space T at one configuration.
pub(crate) struct Tangent<'a> {
    torsion: &'a TorsionModel,
    poses: Poses,
    pub(crate) positions: Vec<Vec3<f64>>,
    sweep: ArticulatedSweep<f64>,
    closed: Option<ClosedMomenta<f64>>,
    gather: GatherWorkspace,
    solve: SolveWorkspace<f64>,
}

impl<'a> Tangent<'a> {
    pub(crate) fn new(torsion: &'a TorsionModel, q: &[f64]) -> Result<Self, MoleculeErrors> {
        let (mut poses, mut positions) = (torsion.poses(), vec![Vec3::zero(); torsion.atoms().len()]);
        torsion.positions_into(q, &mut poses, &mut positions).map_err(|e| failed(&e))?;
        let mut closed = None;
        if torsion.has_rings() {
            let mut momenta = ClosedMomenta::new(torsion.model()).map_err(|e| loops_failed(&e))?;
            momenta.place(q).map_err(|e| failed(&e))?;
            closed = Some(momenta);
        }
        Ok(Tangent {
            poses,
            positions,
            sweep: ArticulatedSweep::new(torsion.layout(), q).map_err(|e| failed(&e))?,
            closed,
            gather: torsion.gather_workspace(),
            solve: SolveWorkspace::new(torsion.layout()),
            torsion,
        })
    }
    /// u = J v.
    pub(crate) fn spread(&self, v: &[f64]) -> Result<Vec<Vec3<f64>>, DynamicsError> {
        let mut u = vec![Vec3::zero(); self.positions.len()];
        self.torsion.velocities_into(&self.poses, v, &mut u)?;
        Ok(u)
    }
    /// v of the velocities in T that are nearest to u.
    pub(crate) fn project(&mut self, u: &[Vec3<f64>]) -> Result<Vec<f64>, DynamicsError> {
        let momenta: Vec<Vec3<f64>> =
            u.iter().zip(&self.torsion.atoms().masses).map(|(u, m)| u.scale(*m)).collect();
        let mut p = vec![0.0; self.torsion.model().nv()];
        self.torsion.gather_into(&self.poses, &momenta, &mut self.gather, &mut p)?;
        self.torsion.model().still_axes().for_each(|axis| axis.remove(&mut p));
        match &mut self.closed {
            Some(closed) => {
                let (mut v, mut within) = (p.clone(), p.clone());
                closed.solve(&p, None, &mut v, &mut within)?;
                Ok(v)
            }
            None => {
                self.sweep.solve_in_place(self.torsion.layout(), &mut p, &mut self.solve);
                Ok(p)
            }
        }
    }
}

fn kinetic(atoms: &Atoms, u: &[Vec3<f64>]) -> f64 {
    0.5 * atoms.masses.iter().zip(u).map(|(m, u)| m * u.dot(*u)).sum::<f64>()
}

fn subtract(a: &mut [Vec3<f64>], b: &[Vec3<f64>]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a -= *b);
}

pub(crate) fn failed(e: &DynamicsError) -> MoleculeErrors {
    let remedy = "give q and v of the same model, and keep hinges that move nothing rigid";
    MoleculeErrors(vec![MoleculeError::new("state", e.to_string(), "a state of the torsion model", remedy)])
}
