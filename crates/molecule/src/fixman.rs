//! Fixman's potential: the rigid model with the distribution of the stiff limit of the flexible molecule.
//!
//! | symbol | meaning | unit | source |
//! |---|---|---|---|
//! | M(q) | mass matrix of the rigid model, base included | | |
//! | U_F | ½ kT ln det M = ½ kT Σ ln det D(k), up to a constant | energy | soa.md 3.9 |
//! | Q_F | −∂U_F/∂q = −kT tr(Y⁺ S~ P⁺), along the joints' own increments | energy/rad, energy/length | paper 2, section 4.5 |
//!
//! Integrating e^(−(K+U)/kT) over the momenta gives √det M e^(−U/kT), the distribution of the rigid model. With U_F added to U
//! the factor cancels: e^(−U/kT), the stiff limit, in coordinates whose measure is dq: hinge angles; Haar's for balls and
//! bases. U_F acts in kicks and in the energy, never in the drift, and depends on the temperature.
//!
//! Open bond angles θ have the measure sin θ dθ, which the stiff limit keeps: U_F = ½ kT ln det M − kT Σ ln |sin θ|, with the
//! force kT cot θ. On flexible rings the rigid model samples √(det M det(G M⁻¹ G*)) e^(−U/kT) δ(g): U_F has
//! ½ kT ln det(G M⁻¹ G*) besides, whose force along the closed rings is in `ring_determinant.rs`.

use crate::atoms::MoleculeError;
use crate::ring_determinant::RingDeterminant;
use crate::torsion_model::TorsionModel;
use phipsi_closure::ClosedMomenta;
use phipsi_model::Model;
use phipsi_motion::{Conservative, Force, ForceError, Loads, Needs, Situation};
use phipsi_recursion::{DynamicsError, Layout, LogDeterminantGradient};
use std::cell::RefCell;

/// Which distribution of the configurations is sampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Distribution {
    /// √det M e^(−U/kT): of the model whose clusters are rigid.
    #[default]
    Rigid,
    /// e^(−U/kT): of the molecule whose bonds and angles are stiff springs; with Fixman's potential.
    StiffLimit,
}

impl Distribution {
    /// With Fixman's potential, or without.
    pub fn with_fixman(fixman: bool) -> Self {
        if fixman { Distribution::StiffLimit } else { Distribution::Rigid }
    }
    /// In a word or two: "rigid", "stiff limit".
    pub fn word(self) -> &'static str {
        match self {
            Distribution::Rigid => "rigid",
            Distribution::StiffLimit => "stiff limit",
        }
    }
    /// In a sentence.
    pub fn describe(self) -> &'static str {
        match self {
            Distribution::Rigid => {
                "rigid: sqrt(det M) exp(-U/kT), the rigid model's own, without Fixman's potential"
            }
            Distribution::StiffLimit => "stiff limit: exp(-U/kT), with Fixman's potential 1/2 kT ln det M",
        }
    }
    /// In a sentence, of a model with or without flexible rings and open angles.
    pub fn describe_for(self, torsion: &TorsionModel) -> &'static str {
        match self {
            Distribution::Rigid if torsion.has_rings() => {
                "rigid: sqrt(det M det(G M^-1 G^T)) exp(-U/kT) on the closed rings, without Fixman's potential"
            }
            Distribution::StiffLimit if torsion.has_rings() => {
                "stiff limit: prod(sin theta) exp(-U/kT) on the closed rings, theta the open angles, with Fixman's potential \
                 1/2 kT ln[det M det(G M^-1 G^T)] - kT sum ln sin theta"
            }
            Distribution::StiffLimit if torsion.open_angles().next().is_some() => {
                "stiff limit: prod(sin theta) exp(-U/kT), with Fixman's potential 1/2 kT ln det M - kT sum ln sin theta of \
                 the open angles"
            }
            other => other.describe(),
        }
    }
}

/// U_F and its generalised force.
#[derive(Clone, Debug)]
pub struct FixmanPotential {
    layout: Layout<f64>,
    kt: f64,
    work: LogDeterminantGradient<f64>,
    gradient: Vec<f64>,
    /// Closures of flexible rings.
    rings: Option<Box<RingDeterminant>>,
    /// Open angles: coordinate, degree of freedom, θ₀.
    angles: Vec<(usize, usize, f64)>,
}

impl FixmanPotential {
    /// On a model, at a temperature: `kt` in the units of the model's energy.
    pub fn new(layout: &Layout<f64>, kt: f64) -> Self {
        let gradient = vec![0.0; layout.nv()];
        let (layout, work) = (layout.clone(), LogDeterminantGradient::new(layout));
        FixmanPotential { layout, kt, work, gradient, rings: None, angles: Vec::new() }
    }
    /// On a molecule, with the parts of its open angles and its flexible rings. On these the force is right along the closed rings;
    /// across them it is what multipliers take away.
    ///
    /// # Errors
    /// [`MoleculeError`] for closures that are redundant: their determinant is zero.
    pub fn of(torsion: &TorsionModel, kt: f64) -> Result<Self, MoleculeError> {
        let mut rings = None;
        if torsion.has_rings() {
            let redundant = |found: String| {
                let remedy = "keep one of the rings rigid, or sample the rigid model's distribution";
                MoleculeError::new("Fixman's potential", found, "closures that are independent", remedy)
            };
            let mut momenta =
                ClosedMomenta::<f64>::new(torsion.model()).map_err(|e| redundant(e.to_string()))?;
            momenta.place(&torsion.model().neutral::<f64>()).map_err(|e| redundant(e.to_string()))?;
            if momenta.log_determinant().is_none() {
                return Err(redundant("flexible rings whose closures are redundant".into()));
            }
            rings = Some(Box::new(RingDeterminant::new(torsion, momenta.dynamics().length())?));
        }
        let angles = torsion.open_angles().collect();
        Ok(FixmanPotential { rings, angles, ..Self::new(torsion.layout(), kt) })
    }
    /// kT.
    pub fn kt(&self) -> f64 {
        self.kt
    }
    /// Adds Q_F to `forces` (nv) and returns U_F. Cost O(n): one articulated sweep and one sweep outward; with flexible rings a
    /// solution and a momentum sweep more for each row of their closures; no allocation.
    ///
    /// # Errors
    /// [`DynamicsError`]: shapes, closures, a hinge without inertia.
    ///
    /// ```
    /// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder, Placement};
    /// use phipsi_molecule::FixmanPotential;
    /// use phipsi_recursion::Layout;
    /// // Two equal rods: the mass matrix is least, and Fixman's potential lowest, where they are stretched.
    /// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
    /// let hinge = JointKind::Revolute { axis: [0.0, 1.0, 0.0] };
    /// let model = ModelBuilder::new("double pendulum")
    ///     .body(Body::new("upper", rod))
    ///     .body(Body::new("lower", rod))
    ///     .joint(Joint::new("shoulder", hinge), "world", "upper")
    ///     .joint(Joint::new("elbow", hinge).at(Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3])), "upper", "lower")
    ///     .build()?;
    /// let mut fixman = FixmanPotential::new(&Layout::new(&model), 2.0);
    /// let mut forces = [0.0; 2];
    /// let energy = fixman.evaluate(&[0.2, 0.5], &mut forces)?;
    /// let c = 0.5f64.cos();
    /// assert!((energy - (4.0 / 9.0 - 0.25 * c * c).ln()).abs() < 1e-14);
    /// assert!(forces[0] == 0.0 && forces[1] < 0.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn evaluate(&mut self, q: &[f64], forces: &mut [f64]) -> Result<f64, DynamicsError> {
        let (expected, found) = (self.gradient.len(), forces.len());
        if found != expected {
            return Err(DynamicsError::Shape { argument: "forces", expected, found });
        }
        self.work.run(&self.layout, q, &mut self.gradient)?;
        let mut logarithm = self.work.factors().log_determinant();
        if let Some(rings) = &mut self.rings {
            logarithm += rings.run(&self.layout, self.work.factors(), q, &mut self.gradient);
        }
        for (force, gradient) in forces.iter_mut().zip(&self.gradient) {
            *force -= 0.5 * self.kt * gradient;
        }
        let mut energy = 0.5 * self.kt * logarithm;
        for &(coordinate, dof, start) in &self.angles {
            let (sin, cos) = (start + q[coordinate]).sin_cos();
            energy -= self.kt * sin.abs().ln();
            forces[dof] += self.kt * cos / sin;
        }
        Ok(energy)
    }
}

/// ½ kT ln[det M · det(G M⁻¹ G*)] on the flexible rings of a molecule, up to a constant: what [`FixmanPotential`] has without the
/// part of open angles, from the elimination of the loops. Angular rows of G count times the model's length. `q`: nq, on the closures.
/// Cost O(n).
///
/// # Errors
/// [`DynamicsError`].
///
/// # Returns
/// `None` where closures are redundant: the determinant is zero.
pub fn fixman_energy_of_rings(
    momenta: &mut ClosedMomenta<f64>,
    q: &[f64],
    kt: f64,
) -> Result<Option<f64>, DynamicsError> {
    momenta.place(q)?;
    Ok(momenta.log_determinant().map(|log| 0.5 * kt * log))
}

/// Forces with Fixman's potential added where there is one.
pub struct WithFixman<'a, C> {
    /// The forces.
    pub inner: &'a mut C,
    /// Fixman's potential.
    pub fixman: Option<&'a mut FixmanPotential>,
}

impl<C: Conservative> Conservative for WithFixman<'_, C>
where
    C::Error: From<DynamicsError>,
{
    type Error = C::Error;

    fn evaluate(&mut self, q: &[f64], forces: &mut [f64]) -> Result<f64, C::Error> {
        let energy = self.inner.evaluate(q, forces)?;
        match &mut self.fixman {
            Some(fixman) => Ok(energy + fixman.evaluate(q, forces)?),
            None => Ok(energy),
        }
    }
    fn has_slow(&self) -> bool {
        self.inner.has_slow()
    }
    fn evaluate_slow(&mut self, q: &[f64], forces: &mut [f64]) -> Result<f64, C::Error> {
        self.inner.evaluate_slow(q, forces)
    }
}

/// What was found at the last configuration.
struct Cache {
    potential: FixmanPotential,
    q: Vec<f64>,
    tau: Vec<f64>,
    energy: f64,
}

impl Cache {
    fn at(&mut self, q: &[f64]) -> Result<(), DynamicsError> {
        if self.q != q {
            self.q.clear();
            self.tau.fill(0.0);
            self.energy = self.potential.evaluate(q, &mut self.tau)?;
            self.q.extend(q);
        }
        Ok(())
    }
}

/// Fixman's potential as a force among others; the [`Situation`] must be one of its model.
pub struct FixmanForce(RefCell<Cache>);

impl FixmanForce {
    /// Name of the force and of its energy.
    pub const NAME: &str = "Fixman";

    /// On a model, at a temperature: `kt` in the units of the model's energy.
    pub fn new(layout: &Layout<f64>, kt: f64) -> Self {
        FixmanPotential::new(layout, kt).into()
    }
    /// NaN where it has no value.
    fn energy(&self, at: &Situation<'_>) -> f64 {
        let mut cache = self.0.borrow_mut();
        if cache.at(at.q).is_ok() { cache.energy } else { f64::NAN }
    }
}

impl From<FixmanPotential> for FixmanForce {
    fn from(potential: FixmanPotential) -> Self {
        let tau = vec![0.0; potential.layout.nv()];
        FixmanForce(RefCell::new(Cache { potential, q: Vec::new(), tau, energy: f64::NAN }))
    }
}

impl Force for FixmanForce {
    fn name(&self) -> &str {
        Self::NAME
    }
    fn needs(&self) -> Needs {
        Needs { conservative: true, ..Needs::default() }
    }
    /// ln det M does not depend on where a free base is.
    fn is_external(&self, _: &Model) -> bool {
        false
    }
    fn add(
        &mut self,
        at: &Situation<'_>,
        _: &[f64],
        _: &mut [f64],
        loads: &mut Loads<'_>,
    ) -> Result<(), ForceError> {
        let cache = self.0.get_mut();
        cache.at(at.q).map_err(|e| ForceError {
            force: Self::NAME.into(),
            t: at.t,
            message: e.to_string(),
        })?;
        for (total, tau) in loads.tau.iter_mut().zip(&cache.tau) {
            *total += tau;
        }
        Ok(())
    }
    fn potential(&self, at: &Situation<'_>) -> f64 {
        self.energy(at)
    }
    fn terms(&self) -> Vec<String> {
        vec![Self::NAME.into()]
    }
    fn term_energies(&self, at: &Situation<'_>) -> Vec<f64> {
        vec![self.energy(at)]
    }
}
