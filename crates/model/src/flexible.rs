//! Flexible bodies: a floating frame F and a displacement that is linear in modal coordinates η.
//!
//! The material point at s0 of the undeformed body is at s0 + Σ η_l ψ_l(s0) in F. All that the dynamics needs of the shapes are
//! integrals over the body, [`ShapeIntegrals`], and their values at the few points where other bodies attach, [`Node`]s.
//! Integrals come from a [`Beam`], from [`MassPoint`]s, from a finite element model (`CraigBampton`, with the feature `finite-elements`), or as numbers.
//!
//! | symbol | meaning | shape | here |
//! |---|---|---|---|
//! | η | modal coordinates | n | the last entries of q, body after body |
//! | ψ_l | displacement by mode l | 3 | [`Node::displacement`] |
//! | ψʳ_l | rotation by mode l | 3 | [`Node::rotation`] |
//! | d0, W0 | Σ m s0, Σ m s0 s0* | 3, 3×3 | `first_moment`, `second_moment` |
//! | S1 | Σ m ψ_l | 3×n | `displacement` |
//! | E_l | Σ m ψ_l s0* | n of 3×3 | `moment` |
//! | S_lm | Σ m ψ_l ψ_m* | n² of 3×3 | `product` |
//! | J_r, C_r, M_r | Σ J, Σ J ψʳ, Σ ψʳ* J ψʳ: rotary inertia, to zeroth order | 3×3, 3×n, n×n | `rotary…` |
//! | T1_lm, T2_lm | Σ m S2_lm, Σ m S2_lm s0*: displacement of second order, S2 | n² of 3, of 3×3 | [`Stiffening`] |
//! | K, C | modal stiffness and damping | n×n | `stiffness`, `damping` |
//!
//! Matrices over modes are stored by rows: entry (l, m) at l·n + m.

mod beam;
mod check;
#[cfg(feature = "finite-elements")]
mod clamped_modes;
#[cfg(feature = "finite-elements")]
mod craig_bampton;
mod points;
mod quadrature;
mod shapes;
mod symmetric_matrix;

pub use beam::{Beam, BeamModes, Section};
#[cfg(feature = "finite-elements")]
pub use craig_bampton::{CraigBampton, ImportReport, InterfaceNode, KeptModes};
pub use points::MassPoint;
pub use shapes::{BeamShape, clamped_free_roots};
pub use symmetric_matrix::{MatrixError, SymmetricMatrix};

pub(crate) use check::check_flexible;

use crate::{Inertia, Placement};
use nalgebra::DMatrix;

/// A 3×3 matrix, by rows.
pub type Matrix3 = [[f64; 3]; 3];

/// Integrals of the shapes over the mass of a body, in the axes of F and about its origin.
///
/// They need not come from shape functions: published models may have other numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShapeIntegrals {
    /// m, kg.
    pub mass: f64,
    /// d0 = Σ m s0, kg·m.
    pub first_moment: [f64; 3],
    /// W0 = Σ m s0 s0*, kg·m²; symmetric.
    pub second_moment: Matrix3,
    /// S1: Σ m ψ_l for every mode.
    pub displacement: Vec<[f64; 3]>,
    /// E_l = Σ m ψ_l s0* for every mode.
    pub moment: Vec<Matrix3>,
    /// S_lm = Σ m ψ_l ψ_m* for every pair, S_ml = S_lm*.
    pub product: Vec<Matrix3>,
    /// J_r = Σ J, kg·m²; symmetric.
    pub rotary: Matrix3,
    /// C_r = Σ J ψʳ_l for every mode.
    pub rotary_coupling: Vec<[f64; 3]>,
    /// M_r = Σ ψʳ_l·J ψʳ_m for every pair; symmetric.
    pub rotary_modal: Vec<f64>,
    /// Displacements of second order (geometric stiffening); `None` leaves them out.
    pub stiffening: Option<Stiffening>,
}

/// Integrals of a displacement of second order, ½ Σ η_l η_m S2_lm, symmetric in l and m.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stiffening {
    /// T1_lm = Σ m S2_lm for every pair.
    pub displacement: Vec<[f64; 3]>,
    /// T2_lm = Σ m S2_lm s0* for every pair.
    pub moment: Vec<Matrix3>,
}

impl ShapeIntegrals {
    /// No mass, `n` modes.
    pub fn zero(n: usize) -> Self {
        ShapeIntegrals {
            displacement: vec![[0.0; 3]; n],
            moment: vec![[[0.0; 3]; 3]; n],
            product: vec![[[0.0; 3]; 3]; n * n],
            rotary_coupling: vec![[0.0; 3]; n],
            rotary_modal: vec![0.0; n * n],
            ..Default::default()
        }
    }
    /// Number of modes n.
    pub fn modes(&self) -> usize {
        self.displacement.len()
    }
    /// M_ee[l, m] = tr S_lm + M_r, the mass matrix of the modes, by rows.
    pub fn modal_mass(&self) -> Vec<f64> {
        let trace = |s: &Matrix3| s[0][0] + s[1][1] + s[2][2];
        self.product.iter().zip(&self.rotary_modal).map(|(s, r)| trace(s) + r).collect()
    }
    /// Mass properties of the undeformed body.
    pub fn undeformed(&self) -> Inertia {
        let (m, d, w) = (self.mass, self.first_moment, &self.second_moment);
        let center = d.map(|x| if m > 0.0 { x / m } else { 0.0 });
        // Σ m s0 s0* about the center of mass, and from it the moments of inertia.
        let about = |i: usize, j: usize| w[i][j] - d[i] * center[j];
        let trace = about(0, 0) + about(1, 1) + about(2, 2);
        let moment = |i: usize, j: usize| self.rotary[i][j] - about(i, j) + if i == j { trace } else { 0.0 };
        let tensor = [moment(0, 0), moment(0, 1), moment(0, 2), moment(1, 1), moment(1, 2), moment(2, 2)];
        Inertia { mass: m, frame: Placement { translation: center, ..Placement::IDENTITY }, tensor }
    }
}

/// A point of a flexible body at which a joint attaches or a motion is measured, with axes along F's where nothing is deformed.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// The user's name.
    pub name: String,
    /// s0: where it is in F, m.
    pub position: [f64; 3],
    /// ψ_l: its displacement by every mode.
    pub displacement: Vec<[f64; 3]>,
    /// ψʳ_l: its rotation by every mode; the node's rotation is exp(Σ η_l ψʳ_l).
    pub rotation: Vec<[f64; 3]>,
    /// S2_lm: its displacement of second order, ½ Σ η_l η_m S2_lm, for every pair; symmetric.
    pub quadratic: Option<Vec<[f64; 3]>>,
}

impl Node {
    /// A node that no mode moves.
    pub fn fixed(name: impl Into<String>, position: [f64; 3], modes: usize) -> Self {
        let zero = vec![[0.0; 3]; modes];
        Node { name: name.into(), position, displacement: zero.clone(), rotation: zero, quadratic: None }
    }
}

/// The modal coordinates of a body.
///
/// A body with flywheels, motors or a payload carries them as child bodies on fixed joints: an inertia that is lumped into the
/// integrals loses digits that no refinement brings back.
#[derive(Clone, Debug, PartialEq)]
pub struct FlexibleBody {
    /// Integrals of its shapes.
    pub integrals: ShapeIntegrals,
    /// K, n×n by rows, symmetric: the strain energy is ½ η·K η.
    pub stiffness: Vec<f64>,
    /// C, n×n by rows, symmetric: generalised forces −C η̇.
    pub damping: Vec<f64>,
    /// Where other bodies attach.
    pub nodes: Vec<Node>,
    /// The node that the body's own joint holds; `None`: the frame F, where the modes vanish.
    pub inboard: Option<String>,
}

impl FlexibleBody {
    /// Without damping; held at F.
    pub fn new(integrals: ShapeIntegrals, stiffness: Vec<f64>, nodes: Vec<Node>) -> Self {
        let damping = vec![0.0; stiffness.len()];
        FlexibleBody { integrals, stiffness, damping, nodes, inboard: None }
    }
    /// With damping C, n×n by rows.
    pub fn damped(mut self, damping: Vec<f64>) -> Self {
        self.damping = damping;
        self
    }
    /// Held by its joint at a node instead of F.
    pub fn held_at(mut self, node: impl Into<String>) -> Self {
        self.inboard = Some(node.into());
        self
    }
    /// Number of modes.
    pub fn modes(&self) -> usize {
        self.integrals.modes()
    }
    /// Squares of the natural frequencies with F held, rad²/s², rising: K x = M_ee x ω². `None` if M_ee is not positive definite
    /// or a number is not finite.
    pub fn squared_frequencies(&self) -> Option<Vec<f64>> {
        let n = self.modes();
        if n == 0 {
            return Some(Vec::new());
        }
        let mass = self.integrals.modal_mass();
        if mass.iter().chain(&self.stiffness).any(|x| !x.is_finite()) || self.stiffness.len() != n * n {
            return None;
        }
        let root = DMatrix::from_row_slice(n, n, &mass).cholesky()?.l();
        let left = root.solve_lower_triangular(&DMatrix::from_row_slice(n, n, &self.stiffness))?;
        let both = root.solve_lower_triangular(&left.transpose())?;
        let values = ((&both + both.transpose()) * 0.5).symmetric_eigenvalues();
        let mut values: Vec<f64> = values.iter().copied().collect();
        values.sort_by(f64::total_cmp);
        Some(values)
    }
    /// Index of a node by name.
    pub fn find_node(&self, name: &str) -> Option<usize> {
        self.nodes.iter().position(|node| node.name == name)
    }
    /// Index of the inboard node, if it has one.
    pub fn inboard_node(&self) -> Option<usize> {
        self.inboard.as_ref().and_then(|name| self.find_node(name))
    }
}
