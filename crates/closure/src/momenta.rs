//! Momenta of mechanisms with loops: what a method on (q, p) needs to stay on the closures and in their cotangent space.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | 𝓜, J | mass matrix of the tree, rows of all closures | n×n, m×n | paper 2 §4.6 |
//! | Φ | residual of the positions | m | |
//! | x, λ | 𝓜x = f + J*λ, Jx = r | n, m | |
//! | U, R, s | roots of the joints' inertias with the loops closed, triangles and scales of the loops | | `factors.rs` |
//!
//! One factorisation at q serves all solutions there, also for residuals elsewhere: the chord iteration of RATTLE. Eliminating
//! joints and multipliers in the order of the sweep gives det 𝓜 · det(J𝓜⁻¹J*) = ∏ U² ∏ (R s)².

use crate::closed_dynamics::{ClosedDynamics, largest};
use crate::compiled::Number;
use crate::error::ClosureError;
use crate::factors::Regard;
use crate::frames::{Frames, weight};
use crate::number::size;
use crate::solution::Load;
use phipsi_model::Model;
use phipsi_recursion::{DynamicsError, Layout};
use phipsi_spatial::{Scalar, Vec3};

/// How a configuration stands to the closures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Openness {
    /// The largest residual, m or rad.
    pub residual: f64,
    /// The same with angles times the scene's length, m.
    pub weighted: f64,
    /// What rounding leaves open for certain, m: 8 ε L a body of the longest path, and more where hinges have made many turns.
    pub rounding: f64,
}

impl Openness {
    /// Nothing but rounding is open.
    pub fn is_closed(&self) -> bool {
        self.weighted <= self.rounding
    }
    /// What is open may be rounding, if it does not get smaller.
    pub fn may_be_rounding(&self) -> bool {
        self.weighted <= 64.0 * self.rounding
    }
}

/// Solutions with 𝓜 and J at one configuration: a workspace, made once; no allocation afterwards.
///
/// # Computes
/// x and f + J*λ with 𝓜x = f + J*λ, Jx = r; f + J*λ is the part of f in the cotangent space where r = 0.
///
/// # Shapes & units
/// f: nv, momenta or forces; x: nv. Rows as in [`ClosedDynamics`].
///
/// # Cost
/// [`ClosedMomenta::place`] factors, [`ClosedMomenta::solve`] substitutes; O(n) where loops are local.
///
/// # Accuracy
/// As [`ClosedDynamics`]. J may have any rank.
///
/// # Example
/// ```
/// use phipsi_closure::ClosedMomenta;
/// use phipsi_model::{Body, Closure, ClosureKind, Inertia, Joint, JointKind, ModelBuilder, Placement};
/// // A bead that slides on two crossed rails is held by a rod to the origin: it moves on a circle.
/// let bead = Body::new("bead", Inertia::from_principal(2.0, [0.0; 3], [0.0; 3]));
/// let model = ModelBuilder::new("circle")
///     .body(bead)
///     .joint(Joint::new("place", JointKind::Translation), "world", "bead")
///     .closure(Closure {
///         name: "rod".into(),
///         kind: ClosureKind::Distance { length: 1.0 },
///         body_a: "world".into(),
///         pose_a: Placement::IDENTITY,
///         body_b: "bead".into(),
///         pose_b: Placement::IDENTITY,
///     })
///     .build()?;
/// let mut momenta = ClosedMomenta::<f64>::new(&model)?;
/// momenta.place(&[0.6, 0.0, 0.8])?;
/// let (mut v, mut p) = ([0.0; 3], [0.0; 3]);
/// momenta.solve(&[1.0, 1.0, 1.0], None, &mut v, &mut p)?;
/// assert!((0.6 * p[0] + 0.8 * p[2]).abs() < 1e-15 && (2.0 * v[1] - p[1]).abs() < 1e-15);
/// // det 𝓜 = 8, J𝓜⁻¹J* = 1/2.
/// assert!((momenta.log_determinant().unwrap() - 4.0_f64.ln()).abs() < 1e-14);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ClosedMomenta<T: Number> {
    dynamics: ClosedDynamics<T>,
    /// Another configuration, whose residual is looked at.
    ahead: Frames<T>,
    /// Degrees of freedom on loops with their coordinate, whose turns count.
    hinges: Vec<usize>,
}

impl<T: Number> ClosedMomenta<T> {
    /// A workspace for a model.
    ///
    /// # Errors
    /// As [`ClosedDynamics::new`]; models with flexible bodies are refused.
    pub fn new(model: &Model) -> Result<Self, ClosureError> {
        let dynamics = ClosedDynamics::new(model)?;
        dynamics.layout.check_rigid("ClosedMomenta")?;
        let on_loops = dynamics.layout.bodies().iter().zip(&dynamics.structure.stations);
        let hinges = on_loops
            .filter(|(body, station)| body.hinge.nv() == 1 && !station.passes.is_empty())
            .map(|(body, _)| body.q)
            .collect();
        let ahead = Frames::new(&dynamics.structure, &dynamics.layout, &dynamics.tree);
        Ok(ClosedMomenta { ahead, dynamics, hinges })
    }
    /// The tree.
    pub fn layout(&self) -> &Layout<T> {
        &self.dynamics.layout
    }
    /// The equations of motion with the same loops. They use the same workspace: place anew after calling them.
    pub fn dynamics(&mut self) -> &mut ClosedDynamics<T> {
        &mut self.dynamics
    }
    /// Factors at a configuration. `q`: nq.
    ///
    /// # Errors
    /// [`DynamicsError`]: a length, or a joint without articulated inertia.
    pub fn place(&mut self, q: &[T]) -> Result<(), DynamicsError> {
        let ClosedDynamics { structure, layout, tree, frames, factors, .. } = &mut self.dynamics;
        if q.len() != layout.nq() {
            return Err(DynamicsError::Shape { argument: "q", expected: layout.nq(), found: q.len() });
        }
        let trees = (&*layout, &*tree);
        frames.set_position(structure, trees, q, None);
        factors.update(structure, trees, frames, None, Regard::Error)
    }
    /// Independent rows where the factors are.
    pub fn rank(&self) -> usize {
        self.dynamics.factors.rank.rank
    }
    /// Looks at the residual of another configuration. `q`: nq.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn look(&mut self, q: &[T]) -> Result<Openness, DynamicsError> {
        let ClosedDynamics { structure, layout, tree, .. } = &self.dynamics;
        if q.len() != layout.nq() {
            return Err(DynamicsError::Shape { argument: "q", expected: layout.nq(), found: q.len() });
        }
        self.ahead.set_position(structure, (layout, tree), q, None);
        let mut weighted = 0.0f64;
        for l in &structure.loops {
            for (i, row) in l.rows.clone().enumerate() {
                let x = (weight(structure, l, i) * self.ahead.residual[row]).abs().to_f64();
                // A residual that is no number is as open as can be.
                weighted = if x.is_finite() { weighted.max(x) } else { f64::INFINITY };
            }
        }
        let turned = self.hinges.iter().fold(0.0f64, |most, i| most.max(q[*i].abs().to_f64()));
        let depth = self.dynamics.depth().max(1) as f64;
        let rounding = T::EPSILON * self.dynamics.length() * (8.0 * depth + 2.0 * turned);
        Ok(Openness { residual: largest(&self.ahead.residual), weighted, rounding })
    }
    /// The largest residuals of the positions and of their rates, m or rad and m/s or rad/s, at the configuration of the factors,
    /// which is given again. `q`: nq, `v`: nv.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn residual(&mut self, q: &[T], v: &[T]) -> Result<[f64; 2], DynamicsError> {
        let ClosedDynamics { structure, layout, tree, frames, rates, .. } = &mut self.dynamics;
        for (argument, expected, found) in [("q", layout.nq(), q.len()), ("v", layout.nv(), v.len())] {
            if found != expected {
                return Err(DynamicsError::Shape { argument, expected, found });
            }
        }
        frames.set_position(structure, (layout, tree), q, None);
        frames.set_velocity(structure, tree, v, rates);
        Ok([largest(&frames.residual), largest(rates)])
    }
    /// x and f + J*λ with 𝓜x = f + J*λ and Jx = c Φ, Φ the residual that was looked at last; Jx = 0 without c.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn solve(
        &mut self,
        f: &[T],
        c: Option<T>,
        x: &mut [T],
        momentum: &mut [T],
    ) -> Result<(), DynamicsError> {
        let ClosedDynamics { structure, layout, tree, frames, factors, solution, .. } = &mut self.dynamics;
        for (argument, found) in [("f", f.len()), ("x", x.len()), ("momentum", momentum.len())] {
            if found != layout.nv() {
                return Err(DynamicsError::Shape { argument, expected: layout.nv(), found });
            }
        }
        solution.clear();
        if let Some(c) = c {
            for l in &structure.loops {
                for (i, row) in l.rows.clone().enumerate() {
                    let r = c * weight(structure, l, i) * self.ahead.residual[row];
                    solution.g[row] = r.to_arithmetic();
                }
            }
        }
        let load = Load { tau: Some(T::arithmetic(f)), prescribed: None, ground: Vec3::zero() };
        solution.run(structure, tree, frames, factors, &load, x);
        solution.constraint_force(structure, tree, frames, momentum);
        for (momentum, f) in momentum.iter_mut().zip(f) {
            *momentum += *f;
        }
        Ok(())
    }
    /// ln[det 𝓜 · det(J𝓜⁻¹J*)] where the factors are, angular rows times the scene's length; `None` where rows are redundant:
    /// the determinant is zero.
    pub fn log_determinant(&self) -> Option<f64> {
        let ClosedDynamics { structure, factors, .. } = &self.dynamics;
        if factors.rank.rank < structure.rows {
            return None;
        }
        let of_joints: f64 = factors.roots.iter().map(|u| size(*u).min_lane().ln()).sum();
        let mut of_loops = 0.0;
        for &index in &structure.closings {
            let (operation, done) = (&structure.operations[index], &factors.done[index]);
            for t in 0..done.rank {
                let column = factors.pivots[operation.step + t];
                let r = factors.matrix[operation.number + t * operation.width + column];
                of_loops += (size(r) * done.scale).min_lane().ln();
            }
        }
        Some(2.0 * (of_joints + of_loops))
    }
}
