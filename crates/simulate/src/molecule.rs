//! What a scene of a molecule has besides its mechanism: atoms, their positions, backbone angles, a drawing.

use crate::page::{Drawing, DrawnBody};
use crate::recluster::Schedule;
use crate::record::Row;
use phipsi_molecule::{
    BOLTZMANN, Bath, Distribution, Ensemble, FixmanForce, FixmanPotential, ForceField, LeftOut,
    MolecularForces, MoleculeError, MoleculeErrors, PotentialForce, TorsionModel,
};
use phipsi_motion::{Force, Midpoint};
use phipsi_recursion::{DynamicsError, Kinematics};
use phipsi_spatial::{Quaternion, Vec3};
use std::sync::Arc;

/// The forces of a molecule's own.
pub struct OwnForces {
    /// The force field, in one or two parts, and Fixman's potential.
    pub forces: Vec<Box<dyn Force>>,
    /// What is constant within clusters and evaluated no more.
    pub left_out: Vec<LeftOut>,
}

/// A molecule, or several.
#[derive(Clone)]
pub struct Molecule {
    /// Clusters and hinges.
    pub torsion: Arc<TorsionModel>,
    /// Backbone angles: name and the four atoms.
    pub backbone: Vec<(String, [usize; 4])>,
    /// Seed of the velocities and of the bath.
    pub seed: u64,
    /// Temperature of the velocities at the start, of the bath and of Fixman's potential, K.
    pub temperature: Option<f64>,
    /// The ensemble that is sampled.
    pub ensemble: Ensemble,
    /// The distribution that is sampled: whether Fixman's potential acts.
    pub distribution: Distribution,
    /// Steps with bonds, angles and torsions in a step with pairs: more than one, multiple time steps.
    pub inner_steps: usize,
    /// Freeze and thaw during the run; `torsion` then has every hinge that turns at some time.
    pub schedule: Option<Arc<Schedule>>,
}

impl Molecule {
    /// With the backbone angles φ and ψ that the atoms' names tell.
    pub fn new(torsion: Arc<TorsionModel>, seed: u64) -> Self {
        Molecule {
            backbone: backbone_angles(&torsion),
            torsion,
            seed,
            temperature: None,
            ensemble: Ensemble::ConstantEnergy,
            distribution: Distribution::Rigid,
            inner_steps: 1,
            schedule: None,
        }
    }
    /// The forces on a model of its atoms: the force field without what is constant within clusters, at a configuration, and Fixman's
    /// potential.
    ///
    /// # Errors
    /// [`MoleculeErrors`]: no energy at the configuration, closures that are redundant.
    pub fn forces_on(
        &self,
        torsion: &Arc<TorsionModel>,
        field: ForceField,
        q: &[f64],
    ) -> Result<OwnForces, MoleculeErrors> {
        let mut forces: Vec<Box<dyn Force>> = Vec::new();
        let mut left_out = Vec::new();
        let parts = match self.inner_steps {
            0 | 1 => vec![("force field", false, field)],
            _ => {
                let [fast, slow] = field.split();
                vec![("force field", false, fast), ("pairs", true, slow)]
            }
        };
        for (name, is_slow, part) in parts {
            let mut part = MolecularForces::new(torsion.clone(), part);
            left_out.extend(part.leave_out_constants(q).map_err(|e| {
                let remedy = "move the atoms apart, or correct the files";
                MoleculeErrors(vec![MoleculeError::new(
                    "force field",
                    e.to_string(),
                    "finite energies",
                    remedy,
                )])
            })?);
            let force = PotentialForce::new(name, part);
            forces.push(Box::new(if is_slow { force.slow() } else { force }));
        }
        if let Some(kt) = self.fixman_kt() {
            let potential = FixmanPotential::of(torsion, kt).map_err(|e| MoleculeErrors(vec![e]))?;
            forces.push(Box::new(FixmanForce::from(potential)));
        }
        Ok(OwnForces { forces, left_out })
    }
    /// kT of Fixman's potential, where it acts.
    pub(crate) fn fixman_kt(&self) -> Option<f64> {
        let temperature = self.temperature.filter(|_| self.distribution == Distribution::StiffLimit);
        temperature.map(|kelvin| BOLTZMANN * kelvin)
    }
    /// True if a heat bath acts.
    pub fn has_bath(&self) -> bool {
        self.ensemble != Ensemble::ConstantEnergy
    }
    /// The bath of a method at its start; `None` at constant energy.
    ///
    /// # Errors
    /// [`MoleculeError`] that names the parameter which is wrong.
    pub fn bath(&self, method: &mut Midpoint) -> Result<Option<Bath>, MoleculeError> {
        if !self.has_bath() {
            return Ok(None);
        }
        let kt = BOLTZMANN * self.temperature.unwrap_or(0.0);
        Bath::new(method, self.ensemble, kt, self.seed).map(Some)
    }
    /// Degrees of freedom at the start that carry the temperature: three less where the common momentum is zero.
    pub fn degrees_of_freedom(&self) -> usize {
        let at_start = self.schedule.as_ref().map(|s| s.degrees_of_freedom);
        self.carrying(at_start.unwrap_or(self.torsion.degrees_of_freedom()))
    }
    /// Those at a time of the run.
    pub fn degrees_of_freedom_at(&self, t: f64) -> usize {
        match &self.schedule {
            Some(schedule) => self.carrying(schedule.degrees_of_freedom_at(t)),
            None => self.degrees_of_freedom(),
        }
    }
    /// Freeze and thaw during the run, in lines.
    pub fn changes(&self) -> Vec<String> {
        let all = self.schedule.iter().flat_map(|schedule| &schedule.changes);
        all.map(|change| change.describe(self.carrying(change.degrees_of_freedom))).collect()
    }
    fn carrying(&self, degrees_of_freedom: usize) -> usize {
        let removed = if let Ensemble::NoseHoover { .. } = self.ensemble { 3 } else { 0 };
        degrees_of_freedom.saturating_sub(removed)
    }
    /// Positions of all atoms at a recorded instant, nm.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn positions(&self, q: &[f64]) -> Result<Vec<[f64; 3]>, DynamicsError> {
        Ok(self.torsion.positions(q)?.into_iter().map(|p| p.0).collect())
    }
    /// Backbone angles at the recorded instants, degrees: for each angle its name and (t, angle).
    pub fn backbone_series(&self, rows: &[Row]) -> Vec<(String, Vec<(f64, f64)>)> {
        let mut series: Vec<(String, Vec<(f64, f64)>)> =
            self.backbone.iter().map(|(name, _)| (name.clone(), Vec::with_capacity(rows.len()))).collect();
        for row in rows {
            // Rows are states of this model.
            let Ok(positions) = self.torsion.positions(&row.q) else { continue };
            for ((_, points), (_, atoms)) in series.iter_mut().zip(&self.backbone) {
                points.push((row.t, dihedral(atoms.map(|a| positions[a])).to_degrees()));
            }
        }
        series
    }
    /// Clusters as bodies, bonds as lines.
    pub fn drawing(&self, rows: &[&Row]) -> Drawing {
        let torsion = &self.torsion;
        let (model, layout, atoms) = (torsion.model(), torsion.layout(), torsion.atoms());
        let mut kinematics = Kinematics::new(layout);
        let neutral = model.neutral::<f64>();
        let mut bodies: Vec<DrawnBody> = Vec::with_capacity(model.len());
        if kinematics.set_position(layout, &neutral).is_err() {
            return Drawing::default();
        }
        let Ok(positions) = torsion.positions(&neutral) else { return Drawing::default() };
        let mut lines = vec![Vec::new(); model.len()];
        let body_of = |atom: usize| torsion.body_of_cluster(torsion.clusters().cluster_of[atom]);
        for &[i, j] in &atoms.bonds {
            let body = body_of(i);
            let pose = kinematics.pose(layout, Some(body));
            let own = [i, j]
                .map(|a| pose.rotation.transpose_mul(positions[a] - pose.translation).0.map(|x| x as f32));
            lines[body].push(own);
        }
        for (body, lines) in model.bodies().iter().zip(lines) {
            bodies.push(DrawnBody {
                name: body.name.clone(),
                lines,
                center: body.inertia.frame.translation.map(|x| x as f32),
                mass: body.inertia.mass as f32,
                ..DrawnBody::default()
            });
        }
        let mut drawing = Drawing { bodies, times: Vec::new(), poses: Vec::new(), unit: "nm".into() };
        for row in rows {
            if kinematics.set_position(layout, &row.q).is_err() {
                continue;
            }
            drawing.times.push(row.t);
            for k in 0..model.len() {
                let pose = kinematics.pose(layout, Some(k));
                let (Vec3(p), Quaternion(r)) = (pose.translation, Quaternion::from_rotation(&pose.rotation));
                drawing.poses.extend(p.iter().chain(&r).map(|x| *x as f32));
            }
        }
        drawing
    }
}

/// φ (C–N–CA–C) and ψ (N–CA–C–N) of every residue whose atoms are there.
fn backbone_angles(torsion: &TorsionModel) -> Vec<(String, [usize; 4])> {
    let atoms = torsion.atoms();
    let neighbors = atoms.neighbors();
    let name = |a: usize| atoms.names.get(a).map_or("", |n| n.atom.as_str());
    let bonded =
        |a: usize, to: &str, but: usize| neighbors[a].iter().copied().find(|&b| b != but && name(b) == to);
    let mut angles = Vec::new();
    for alpha in (0..atoms.len()).filter(|&a| name(a) == "CA") {
        let residue = &atoms.names[alpha].residue;
        let (Some(n), Some(c)) = (bonded(alpha, "N", alpha), bonded(alpha, "C", alpha)) else { continue };
        if let Some(before) = bonded(n, "C", alpha) {
            angles.push((format!("{residue} backbone_phi"), [before, n, alpha, c]));
        }
        if let Some(after) = bonded(c, "N", alpha) {
            angles.push((format!("{residue} backbone_psi"), [n, alpha, c, after]));
        }
    }
    angles
}

/// The torsion of four points, rad, IUPAC: π for trans.
fn dihedral([a, b, c, d]: [Vec3<f64>; 4]) -> f64 {
    let (u, v, w) = (b - a, c - b, d - c);
    let (m, n) = (u.cross(v), v.cross(w));
    (v.norm() * u.dot(n)).atan2(m.dot(n))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torsions_have_the_sign_of_iupac() {
        let at = |x: f64, y: f64, z: f64| Vec3([x, y, z]);
        // Looking along b → c (z), d is turned clockwise by 90° from a: +90°.
        let four = [at(1.0, 0.0, 0.0), at(0.0, 0.0, 0.0), at(0.0, 0.0, 1.0), at(0.0, 1.0, 1.0)];
        assert!((dihedral(four).to_degrees() - 90.0).abs() < 1e-12);
        let trans = [at(1.0, 0.0, 0.0), at(0.0, 0.0, 0.0), at(0.0, 0.0, 1.0), at(-1.0, 0.0, 1.0)];
        assert!((dihedral(trans).abs() - std::f64::consts::PI).abs() < 1e-12);
    }
}
