//! The papers' spatial operators of a model at a configuration, as expressions that evaluate as sweeps.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | E_φ, φ | rigid shift to the parent; (I − E_φ)⁻¹ | 6n × 6n | paper 2 (2.1), (2.2) |
//! | H | spatial forces to joint forces; H* has the joint axes as columns | nv × 6n | paper 2 (2.3) |
//! | M | spatial inertias | 6n × 6n | paper 1 §3 |
//! | P, D, G, K | articulated inertia, joint inertia, Kalman gain, shifted gain E_φ G | 6n, nv, 6n × nv | paper 1 §8, paper 2 (2.4) corrected |
//! | τ, τ̄ | G H, I − τ | 6n × 6n | paper 1 §8 |
//! | E_ψ, ψ | E_φ τ̄, (I − E_ψ)⁻¹ | 6n × 6n | paper 2 (2.5) |
//! | B | wrenches at points to wrenches at bodies | 6n × 6m | paper 2 §2.7 |
//! | R, S | composite inertia; φ M φ* | 6n × 6n | paper 1 (6.1), (6.2) |
//! | Υ, Ω | Υ(k) = ψ*(p,k) Υ(p) ψ(p,k) + H*D⁻¹H; ψ* H* D⁻¹ H ψ | 6n × 6n | paper 1 (10.1), (10.2), paper 2 (4.18), (4.19) |
//!
//! Blocks: one a moving body, parents before children, in the user's body frames, six-vectors angular first; bodies on fixed
//! joints belong to the body that carries them. Joint columns in the order of v. The papers count from tip to base: φ sweeps
//! inward here too, and is upper triangular in this order.
//!
//! These are for writing down what one means, for checks and for teaching; each is applied in O(n). The kernels of this crate
//! do the same sweeps ten to a hundred times faster; tests hold the two together.

use crate::error::{DynamicsError, check_length};
use crate::layout::{GROUND, Layout};
use nalgebra::DMatrix;
use phipsi_model::Model;
use phipsi_spatial::{Motion, Real, Transform, Vec3, Wrench};
use phipsi_topology::{Innovations, Operator, OperatorError, Space, Tree};
use std::sync::Arc;

mod derivatives;
mod estimation;
mod linearize;
mod log_determinant_gradient;
mod sensitivity;
mod vertical_sweeps;

pub use derivatives::DynamicsDerivatives;
pub use estimation::{FieldSample, Filtered, RandomField, Smoothed};
pub use linearize::LinearizedDynamics;
pub use sensitivity::Sensitivity;

/// The spatial operators of a model at a configuration, named as in the papers.
///
/// # Computes
/// Every operator of paper 2's table 1, and R, S, Υ, Ω. Expressions of them are operators again and stay sweeps:
/// `&ops.H * &ops.phi * &ops.M * ops.phi.adjoint() * ops.H.adjoint()` is the mass matrix, its `inverse()` the filter and smoother.
///
/// # Cost
/// O(n) to make, O(n) to apply any of them.
///
/// # Example
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
/// use phipsi_recursion::{Operators, mass_matrix, Layout};
/// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
/// let hinge = |name: &str| Joint::new(name, JointKind::Revolute { axis: [0.0, 1.0, 0.0] });
/// let model = ModelBuilder::new("double pendulum")
///     .body(Body::new("upper", rod))
///     .body(Body::new("lower", rod))
///     .joint(hinge("shoulder"), "world", "upper")
///     .joint(hinge("elbow"), "upper", "lower")
///     .build()?;
/// let q = [0.3, -0.5_f64];
/// let ops = Operators::new(&model, &q)?;
/// let mass = &ops.H * &ops.phi * &ops.M * ops.phi.adjoint() * ops.H.adjoint();
/// assert_eq!(mass.to_string(), "H φ M φ* H*");
/// let column = mass.apply(&[1.0, 0.0])?;
/// let kernel = mass_matrix(&Layout::new(&model), &q)?;
/// assert!((column[1] - kernel[2]).abs() < 1e-15);
/// let acceleration = mass.inverse()?.apply(&[0.0, 1.0])?; // a filter and a smoother
/// assert!((mass.apply(&acceleration)?[1] - 1.0).abs() < 1e-14);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Operators<T> {
    /// E_φ: block (p, k) is φ(p, k).
    pub E_phi: Operator<T>,
    /// φ = (I − E_φ)⁻¹.
    pub phi: Operator<T>,
    /// H, nv × 6n.
    pub H: Operator<T>,
    /// M, the spatial inertias.
    pub M: Operator<T>,
    /// P, the articulated inertias.
    pub P: Operator<T>,
    /// D = H P H*.
    pub D: Operator<T>,
    /// D⁻¹.
    pub D_inverse: Operator<T>,
    /// G = P H* D⁻¹.
    pub G: Operator<T>,
    /// K = E_φ G.
    pub K: Operator<T>,
    /// τ̄ = I − G H.
    pub tau_bar: Operator<T>,
    /// E_ψ = E_φ τ̄.
    pub E_psi: Operator<T>,
    /// ψ = (I − E_ψ)⁻¹.
    pub psi: Operator<T>,
    /// R, the composite inertias.
    pub R: Operator<T>,
    /// Υ, the diagonal blocks of Ω.
    pub upsilon: Operator<T>,
    bodies: Vec<usize>,
    tree: Arc<Tree>,
    /// Per body of the model: its block and its pose in that block's frame.
    carriers: Vec<Option<(usize, Transform<T>)>>,
    /// Pose of each block's frame in its parent block's, or in the world.
    poses: Vec<Transform<T>>,
    /// Joint axes of each block.
    axes: Vec<Vec<Motion<T>>>,
    /// Axes that turn about another axis of their joint: the universal joint's first about its second.
    turning: Vec<bool>,
    gravity: Vec3<T>,
}

/// A 6 × 6 block from its image of unit vectors.
fn block<T: Real>(columns: impl Fn(usize) -> [T; 6]) -> DMatrix<T> {
    let columns: Vec<[T; 6]> = (0..6).map(columns).collect();
    DMatrix::from_fn(6, 6, |i, j| columns[j][i])
}

/// V ↦ x × V on motions.
fn cross_motion<T: Real>(x: Motion<T>) -> DMatrix<T> {
    block(|j| x.cross_motion(Motion::unit(j)).to_array())
}

/// f ↦ x × f on wrenches: S~ of a twist S.
fn cross_wrench<T: Real>(x: Motion<T>) -> DMatrix<T> {
    block(|j| x.cross_wrench(Wrench::unit(j)).to_array())
}

/// φ(p, k) of a pose.
fn shift<T: Real>(pose: &Transform<T>) -> DMatrix<T> {
    block(|j| pose.wrench_to_parent(Wrench::unit(j)).to_array())
}

impl<T: Real> Operators<T> {
    /// All operators at a configuration. `q`: nq. A model with closures gives the operators of its tree.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`]; [`DynamicsError::SingularHinge`] if a D is not positive definite.
    pub fn new(model: &Model, q: &[T]) -> Result<Self, DynamicsError> {
        check_length("q", q, model.nq())?;
        let layout = Layout::<T>::new(model);
        layout.check_rigid("operators")?;
        let bodies: Vec<usize> = model.moving_joints().collect();
        let mut block_of = vec![None; model.len()];
        let mut carriers: Vec<Option<(usize, Transform<T>)>> = Vec::with_capacity(model.len());
        // The nearest moving body, the body itself included, of every body.
        for k in 0..model.len() {
            let inboard = model.tree().parent(k).and_then(|p| block_of[p]);
            block_of[k] = bodies.binary_search(&k).ok().or(inboard);
        }
        let user = |k: usize| layout.carriers()[k].pose;
        for k in 0..model.len() {
            carriers.push(block_of[k].map(|b: usize| (b, user(bodies[b]).inverse().compose(&user(k)))));
        }
        let parents =
            bodies.iter().map(|&k| model.tree().parent(k).and_then(|p| block_of[p])).collect::<Vec<_>>();
        let tree = Arc::new(Tree::new(parents).unwrap_or_else(|_| unreachable!("bodies are in order")));
        let (mut poses, mut axes, mut turning) = (Vec::new(), Vec::new(), Vec::new());
        for (b, &k) in bodies.iter().enumerate() {
            let own = &layout.carriers()[k];
            // A universal joint is two bodies of the layout.
            let (mut pose, mut at, mut joint) = (own.pose, own.body, Vec::new());
            let stop = tree.parent(b).map_or(GROUND, |p| layout.carriers()[bodies[p]].body);
            while at != stop {
                let body = &layout.bodies()[at];
                let here = |axis: Motion<T>| pose.motion_to_child(axis);
                let mut own: Vec<_> = (0..body.hinge.nv()).map(|i| here(body.hinge.axis(i))).collect();
                own.append(&mut joint);
                joint = own;
                pose = body.pose(q).compose(&pose);
                at = body.parent;
            }
            let inboard = tree.parent(b).map_or(Transform::identity(), |p| user(bodies[p]).inverse());
            poses.push(inboard.compose(&pose));
            axes.push(joint);
            turning.push(matches!(model.joints()[k].kind, phipsi_model::JointKind::Universal { .. }));
        }
        let inertia = |&k: &usize| {
            let own = &layout.carriers()[k];
            let M = own.pose.inverse().rigid_to_parent(&layout.bodies()[own.body].inertia);
            block(|j| M.momentum(Motion::unit(j)).to_array())
        };
        let state = Space::uniform(bodies.len(), 6);
        let joint = Space::new(axes.iter().map(Vec::len));
        let hinge = |axes: &Vec<Motion<T>>| {
            let rows: Vec<[T; 6]> = axes.iter().map(|a| a.to_array()).collect();
            DMatrix::from_fn(rows.len(), 6, |i, j| rows[i][j])
        };
        let parts = || -> Result<_, OperatorError> {
            let E_phi = Operator::edges("E_φ", &tree, &state, &state, poses.iter().map(shift).collect())?;
            let H = Operator::diagonal("H", &joint, &state, axes.iter().map(hinge).collect())?;
            let M = Operator::diagonal("M", &state, &state, bodies.iter().map(inertia).collect())?;
            let innovations = Innovations::new(&H, &E_phi, &M)?;
            let R = Operator::inward_composite("R", &E_phi, &M)?;
            let source = &(&H.adjoint() * &innovations.inverse_pivots) * &H;
            let upsilon = Operator::outward_composite("Υ", &innovations.e_psi, &source)?;
            Ok((E_phi, M, innovations, R, upsilon))
        };
        let (E_phi, M, factors, R, upsilon) =
            parts().map_err(|error| singular_hinge(model, &bodies, &error))?;
        Ok(Operators {
            E_phi,
            phi: factors.phi,
            H: factors.hinge,
            M,
            P: factors.articulated,
            D: factors.pivots,
            D_inverse: factors.inverse_pivots,
            G: factors.gain,
            K: factors.shifted_gain,
            tau_bar: factors.tau_bar,
            E_psi: factors.e_psi,
            psi: factors.psi,
            R,
            upsilon,
            bodies,
            tree,
            carriers,
            poses,
            axes,
            turning,
            gravity: layout.gravity(),
        })
    }

    /// The body of the model that each block belongs to.
    pub fn bodies(&self) -> &[usize] {
        &self.bodies
    }
    /// The tree of the blocks.
    pub fn tree(&self) -> &Tree {
        &self.tree
    }
    /// The space of spatial vectors: six numbers a moving body.
    pub fn state_space(&self) -> &Space {
        self.M.rows()
    }
    /// The space of joint vectors: as v.
    pub fn joint_space(&self) -> &Space {
        self.D.rows()
    }
    /// I on spatial vectors.
    pub fn identity(&self) -> Operator<T> {
        Operator::identity(self.state_space())
    }
    /// I on joint vectors.
    pub fn joint_identity(&self) -> Operator<T> {
        Operator::identity(self.joint_space())
    }
    /// τ = G H.
    pub fn tau(&self) -> Operator<T> {
        &self.G * &self.H
    }
    /// φ~ = φ − I = E_φ φ.
    pub fn phi_tilde(&self) -> Operator<T> {
        &self.E_phi * &self.phi
    }
    /// ψ~ = ψ − I = E_ψ ψ.
    pub fn psi_tilde(&self) -> Operator<T> {
        &self.E_psi * &self.psi
    }
    /// S = φ M φ*, the covariance of spatial forces (paper 1 Lemma 1).
    pub fn state_covariance(&self) -> Operator<T> {
        &(&self.phi * &self.M) * &self.phi.adjoint()
    }
    /// The mass matrix H φ M φ* H* (paper 2 (4.11)).
    pub fn mass_matrix(&self) -> Operator<T> {
        &(&self.H * &self.state_covariance()) * &self.H.adjoint()
    }
    /// I + H φ K (paper 2 (4.13)).
    pub fn factor(&self) -> Operator<T> {
        self.joint_identity() + &(&self.H * &self.phi) * &self.K
    }
    /// L = I − H ψ K (paper 2 (4.14)).
    pub fn innovations_operator(&self) -> Operator<T> {
        self.joint_identity() - &(&self.H * &self.psi) * &self.K
    }
    /// L* D⁻¹ L (paper 2 (4.15)).
    pub fn mass_matrix_inverse(&self) -> Operator<T> {
        let L = self.innovations_operator();
        &(&L.adjoint() * &self.D_inverse) * &L
    }
    /// Ω = ψ* H* D⁻¹ H ψ (paper 2 (4.18)).
    pub fn omega(&self) -> Operator<T> {
        let right = &self.H * &self.psi;
        &(&right.adjoint() * &self.D_inverse) * &right
    }
    /// B for points fixed in bodies of the model: column block j takes a wrench at point j, in the axes of its body, to its
    /// body's block. Columns of a point that cannot move are zero. Points in m, body frame.
    ///
    /// # Errors
    /// [`OperatorError::Node`] if there is no such body.
    pub fn pick_off(&self, points: &[(usize, Vec3<T>)]) -> Result<Operator<T>, OperatorError> {
        let (mut nodes, mut blocks) = (Vec::new(), Vec::new());
        for &(body, point) in points {
            let carrier = self.carriers.get(body).ok_or_else(|| OperatorError::Node {
                name: "B".into(),
                node: body,
                nodes: self.carriers.len(),
            })?;
            let at = Transform::new(phipsi_spatial::Mat3::identity(), point);
            let (node, block) = match carrier {
                Some((node, pose)) => (*node, shift(&pose.compose(&at))),
                None => (0, DMatrix::from_element(6, 6, T::zero())),
            };
            if node < self.bodies.len() {
                nodes.push(node);
                blocks.push(block);
            }
        }
        Operator::pick_off("B", self.state_space(), nodes, blocks)
    }
    /// The blocks of one of the diagonal operators.
    fn own_blocks(a: &Operator<T>) -> Vec<DMatrix<T>> {
        a.diagonal_blocks().unwrap_or_else(|error| unreachable!("one block a body: {error}"))
    }
    /// Blocks of a diagonal operator of these bodies.
    fn diagonal(
        &self,
        name: &str,
        rows: &Space,
        columns: &Space,
        block: impl Fn(usize) -> DMatrix<T>,
    ) -> Operator<T> {
        let blocks = (0..self.bodies.len()).map(block).collect();
        let made = Operator::diagonal(name, rows, columns, blocks);
        made.unwrap_or_else(|error| unreachable!("blocks are made for this tree: {error}"))
    }
    /// How the first axis of a universal joint turns with its second angle: −S₂ × S₁.
    fn turned_axis(&self, k: usize) -> Option<Motion<T>> {
        self.turning[k].then(|| self.axes[k][0].cross_motion(self.axes[k][1]))
    }
}

/// The error of an operator that could not be made: a hinge without articulated inertia.
fn singular_hinge(model: &Model, bodies: &[usize], error: &OperatorError) -> DynamicsError {
    let (node, inertia) = match error {
        OperatorError::Singular { node, pivot, .. } => (*node, *pivot),
        other => unreachable!("operators of a model fit each other: {other}"),
    };
    let joint = model.joints()[bodies[node]].name.clone();
    DynamicsError::SingularHinge { joint, component: 0, inertia }
}
