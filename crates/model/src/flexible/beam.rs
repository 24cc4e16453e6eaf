//! Euler–Bernoulli beams along x of F, from their section's properties.

use super::quadrature::panels;
use super::shapes::{BeamShape, clamped_clamped_roots, clamped_free_roots};
use super::{FlexibleBody, Node, ShapeIntegrals, Stiffening};
use std::f64::consts::PI;

/// Properties of a section, the same along the beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// ρA, kg/m.
    pub mass_per_length: f64,
    /// EI for displacement along y and along z, N·m².
    pub bending_stiffness: [f64; 2],
    /// GJ, N·m².
    pub torsional_stiffness: f64,
    /// ρI_p about the axis, kg·m.
    pub polar_inertia: f64,
    /// EA, N.
    pub axial_stiffness: f64,
}

/// Families of bending shapes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BeamModes {
    /// Clamped-clamped eigenfunctions and two Hermite cubics: for beams that carry something. Errors of frequencies fall like
    /// the fourth power of the number of modes.
    #[default]
    Interface,
    /// Clamped-free eigenfunctions: for beams with a free end. With a load at the end errors fall like the first power only.
    ClampedFree,
    /// Sines: the frame F rides on the chord, pinned at both ends. A pin passes no moment to the beam.
    Pinned,
}

/// A straight beam from the origin of F along x.
///
/// # Example
/// ```
/// use phipsi_model::{Beam, Body, Joint, JointKind, ModelBuilder, Section};
/// let section = Section {
///     mass_per_length: 1.0,
///     bending_stiffness: [3.0, 3.0],
///     torsional_stiffness: 2.0,
///     polar_inertia: 1e-3,
///     axial_stiffness: 1e4,
/// };
/// let beam = Beam::new(1.0, section).bending([2, 2]).build();
/// let model = ModelBuilder::new("boom")
///     .body(Body::flexible("boom", beam))
///     .joint(Joint::new("root", JointKind::Revolute { axis: [0.0, 0.0, 1.0] }), "world", "boom")
///     .build()?;
/// assert_eq!(model.nv(), 1 + 2 * (2 + 2)); // of each plane two eigenfunctions and two cubics
/// # Ok::<(), phipsi_model::ModelErrors>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Beam {
    length: f64,
    section: Section,
    family: BeamModes,
    bending: [usize; 2],
    torsion: usize,
    axial: usize,
    stiffening: bool,
    damping: f64,
    nodes: Vec<(String, f64)>,
}

/// What a mode does with the section at x: displacement and rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Direction {
    /// Bending, along y (1) or z (2).
    Bending(usize),
    Torsion,
    Axial,
}

impl Beam {
    /// A beam of this length, m, without modes, and with a node `tip` at its end.
    pub fn new(length: f64, section: Section) -> Self {
        Beam {
            length,
            section,
            family: BeamModes::Interface,
            bending: [0; 2],
            torsion: 0,
            axial: 0,
            stiffening: false,
            damping: 0.0,
            nodes: vec![("tip".into(), 1.0)],
        }
    }
    /// Another family of bending shapes.
    pub fn family(mut self, family: BeamModes) -> Self {
        self.family = family;
        self
    }
    /// Numbers of eigenfunctions along y and z. The interface family adds two cubics to each plane that has any.
    pub fn bending(mut self, modes: [usize; 2]) -> Self {
        self.bending = modes;
        self
    }
    /// Number of torsion modes (the interface family: sines of a beam held at both ends, and a linear one among the count).
    pub fn torsion(mut self, modes: usize) -> Self {
        self.torsion = modes;
        self
    }
    /// Number of axial modes, as [`Beam::torsion`].
    pub fn axial(mut self, modes: usize) -> Self {
        self.axial = modes;
        self
    }
    /// With the shortening by bending, u_x = −½ ∫ (w′)² dx: needed from about a tenth of the first bending frequency of spin on,
    /// and under axial loads.
    pub fn stiffened(mut self) -> Self {
        self.stiffening = true;
        self
    }
    /// Damping C = `factor` K, s.
    pub fn damped(mut self, factor: f64) -> Self {
        self.damping = factor;
        self
    }
    /// A further node at the distance x from the origin of F, m.
    pub fn node(mut self, name: impl Into<String>, x: f64) -> Self {
        self.nodes.push((name.into(), x / self.length));
        self
    }

    /// Direction and shape of every mode: along y, along z, torsion, axial.
    fn modes(&self) -> Vec<(Direction, BeamShape)> {
        let bending = |count: usize| -> Vec<BeamShape> {
            match self.family {
                _ if count == 0 => Vec::new(),
                BeamModes::Interface => {
                    let clamped = clamped_clamped_roots(count).into_iter().map(BeamShape::clamped_clamped);
                    clamped.chain([BeamShape::Displacement, BeamShape::Rotation]).collect()
                }
                BeamModes::ClampedFree => {
                    clamped_free_roots(count).into_iter().map(BeamShape::clamped_free).collect()
                }
                BeamModes::Pinned => (1..=count).map(|k| BeamShape::Sine { root: k as f64 * PI }).collect(),
            }
        };
        let along = |count: usize| -> Vec<BeamShape> {
            match self.family {
                _ if count == 0 => Vec::new(),
                BeamModes::Interface => {
                    let held = (1..count).map(|k| BeamShape::Sine { root: k as f64 * PI });
                    held.chain([BeamShape::Linear]).collect()
                }
                _ => (0..count).map(|k| BeamShape::Sine { root: (k as f64 + 0.5) * PI }).collect(),
            }
        };
        let mut all = Vec::new();
        for (plane, count) in self.bending.into_iter().enumerate() {
            all.extend(bending(count).into_iter().map(|shape| (Direction::Bending(plane + 1), shape)));
        }
        all.extend(along(self.torsion).into_iter().map(|shape| (Direction::Torsion, shape)));
        all.extend(along(self.axial).into_iter().map(|shape| (Direction::Axial, shape)));
        all
    }
    /// ψ and ψʳ of a mode at x/L.
    fn motion(&self, (direction, shape): (Direction, BeamShape), x: f64) -> [[f64; 3]; 2] {
        let [value, slope, _] = shape.at(x);
        let slope = slope / self.length;
        match direction {
            Direction::Bending(1) => [[0.0, value, 0.0], [0.0, 0.0, slope]],
            Direction::Bending(_) => [[0.0, 0.0, value], [0.0, -slope, 0.0]],
            Direction::Torsion => [[0.0; 3], [value, 0.0, 0.0]],
            Direction::Axial => [[value, 0.0, 0.0], [0.0; 3]],
        }
    }
    /// The flexible body: integrals by Gauss quadrature. The rotary inertia of sections counts about the beam's axis only.
    /// Damping, stiffness and masses are not checked here but when a model is built.
    pub fn build(&self) -> FlexibleBody {
        let (length, section) = (self.length, self.section);
        let modes = self.modes();
        let n = modes.len();
        let highest = self.bending.into_iter().max().unwrap_or(0).max(self.torsion).max(self.axial);
        // Sixteen points for each half wave of the highest mode.
        let rule = panels(2 * highest + 8);
        let mut sum = ShapeIntegrals::zero(n);
        let mut stiffness = vec![0.0; n * n];
        let mut stiffening =
            Stiffening { displacement: vec![[0.0; 3]; n * n], moment: vec![[[0.0; 3]; 3]; n * n] };
        sum.mass = section.mass_per_length * length;
        sum.first_moment[0] = 0.5 * sum.mass * length;
        sum.second_moment[0][0] = sum.mass * length * length / 3.0;
        sum.rotary[0][0] = section.polar_inertia * length;
        for &(x, weight) in &rule {
            let mass = section.mass_per_length * length * weight;
            let polar = section.polar_inertia * length * weight;
            let at: Vec<_> = modes.iter().map(|&mode| self.motion(mode, x)).collect();
            let shape: Vec<_> = modes.iter().map(|(_, shape)| shape.at(x)).collect();
            for l in 0..n {
                let [psi, turn] = at[l];
                for i in 0..3 {
                    sum.displacement[l][i] += mass * psi[i];
                    sum.moment[l][i][0] += mass * psi[i] * x * length;
                }
                sum.rotary_coupling[l][0] += polar * turn[0];
                for k in 0..n {
                    let [other, other_turn] = at[k];
                    let pair = l * n + k;
                    for i in 0..3 {
                        for j in 0..3 {
                            sum.product[pair][i][j] += mass * (psi[i] * other[j]);
                        }
                    }
                    sum.rotary_modal[pair] += polar * (turn[0] * other_turn[0]);
                    if modes[l].0 != modes[k].0 {
                        continue;
                    }
                    let (order, rigidity) = match modes[l].0 {
                        Direction::Bending(plane) => (2, section.bending_stiffness[plane - 1]),
                        Direction::Torsion => (1, section.torsional_stiffness),
                        Direction::Axial => (1, section.axial_stiffness),
                    };
                    let scale = rigidity * weight * length / length.powi(2 * order);
                    stiffness[pair] += scale * (shape[l][order as usize] * shape[k][order as usize]);
                    if let Direction::Bending(_) = modes[l].0 {
                        // ∫ ρA ∫₀ˣ w′w′ and ∫ ρA x ∫₀ˣ w′w′, with the order of integration exchanged.
                        let slopes = shape[l][1] * shape[k][1] / length;
                        stiffening.displacement[pair][0] -= mass * (1.0 - x) * slopes;
                        stiffening.moment[pair][0][0] -= mass * 0.5 * (1.0 - x * x) * slopes * length;
                    }
                }
            }
        }
        if self.stiffening {
            sum.stiffening = Some(stiffening);
        }
        let nodes = self.nodes.iter().map(|(name, x)| self.node_at(name, *x, &modes)).collect();
        let damping = stiffness.iter().map(|k| self.damping * k).collect();
        FlexibleBody::new(sum, stiffness, nodes).damped(damping)
    }
    fn node_at(&self, name: &str, x: f64, modes: &[(Direction, BeamShape)]) -> Node {
        let n = modes.len();
        let motions: Vec<_> = modes.iter().map(|&mode| self.motion(mode, x)).collect();
        let mut quadratic = vec![[0.0; 3]; n * n];
        for (at, weight) in panels(2 * self.bending[0].max(self.bending[1]) + 8) {
            let slope: Vec<f64> = modes.iter().map(|(_, shape)| shape.at(at * x)[1]).collect();
            for l in 0..n {
                for k in 0..n {
                    if let (Direction::Bending(a), Direction::Bending(b)) = (modes[l].0, modes[k].0)
                        && a == b
                    {
                        quadratic[l * n + k][0] -= weight * x / self.length * (slope[l] * slope[k]);
                    }
                }
            }
        }
        Node {
            name: name.into(),
            position: [x * self.length, 0.0, 0.0],
            displacement: motions.iter().map(|m| m[0]).collect(),
            rotation: motions.iter().map(|m| m[1]).collect(),
            quadratic: self.stiffening.then_some(quadratic),
        }
    }
}
