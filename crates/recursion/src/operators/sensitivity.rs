//! Sensitivities: the derivatives of all operators by one joint coordinate, in terms of the operators themselves.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | S, S~ | the joint's axis, a column of H*(i); S~ f = S × f | soa.md 3.9 |
//! | Ė_φ | φ(p,i) S~ in block (p, i), zero elsewhere | paper 2 §4.5 |
//! | φ̇ | φ Ė_φ φ | |
//! | Ṗ⁺(k) | Ṗ − U̇ G* − G U̇* + G Ḋ G*, U = P H* | |
//! | Ṗ(p) | Σ over children of Ė P⁺ E* + E P⁺ Ė* + E Ṗ⁺ E*: along the path to the root only | |
//! | Ġ, τ̄˙, K̇ | (U̇ − G Ḋ) D⁻¹, −Ġ H − G Ḣ, Ė G + E Ġ | |
//! | Ė_ψ, ψ̇ | Ė τ̄ + E τ̄˙, ψ Ė_ψ ψ | |
//!
//! In body-fixed frames only φ(p, i) moves with coordinate i, and M is constant; of H moves the first axis of a universal
//! joint with its second angle. The coordinate moves the body along S from where it is: the increments of `Model::integrate`.

use super::{Operators, cross_wrench};
use nalgebra::DMatrix;
use phipsi_spatial::Real;
use phipsi_topology::{Operator, OperatorError};

/// Derivatives of the operators by one degree of freedom, named as the operators.
#[derive(Clone, Debug)]
pub struct Sensitivity<T> {
    /// Ė_φ.
    pub E_phi: Operator<T>,
    /// φ̇ = φ Ė_φ φ.
    pub phi: Operator<T>,
    /// Ḣ, zero but at universal joints.
    pub H: Operator<T>,
    /// Ṗ.
    pub P: Operator<T>,
    /// Ḋ = Ḣ P H* + H Ṗ H* + H P Ḣ*.
    pub D: Operator<T>,
    /// (D⁻¹)˙ = −D⁻¹ Ḋ D⁻¹.
    pub D_inverse: Operator<T>,
    /// Ġ.
    pub G: Operator<T>,
    /// K̇.
    pub K: Operator<T>,
    /// τ̄˙.
    pub tau_bar: Operator<T>,
    /// Ė_ψ.
    pub E_psi: Operator<T>,
    /// ψ̇ = ψ Ė_ψ ψ.
    pub psi: Operator<T>,
    /// Ṙ.
    pub R: Operator<T>,
    /// Υ̇.
    pub upsilon: Operator<T>,
    /// Ṡ = φ̇ M φ* + φ M φ̇*.
    pub state_covariance: Operator<T>,
    /// The derivative of the mass matrix H φ M φ* H*.
    pub mass_matrix: Operator<T>,
    /// The derivative of its inverse, −𝓜⁻¹ 𝓜˙ 𝓜⁻¹.
    pub mass_matrix_inverse: Operator<T>,
    /// Ω̇.
    pub omega: Operator<T>,
}

/// A product A N A* of operators by the product rule, for a symmetric N.
fn congruence<T: Real>(
    [a, n]: [&Operator<T>; 2],
    [a_rate, n_rate]: [Option<&Operator<T>>; 2],
) -> Option<Operator<T>> {
    let a_term = a_rate.map(|rate| {
        let one = &(rate * n) * &a.adjoint();
        &one + &one.adjoint()
    });
    let n_term = n_rate.map(|rate| &(a * rate) * &a.adjoint());
    match (a_term, n_term) {
        (Some(x), Some(y)) => Some(&x + &y),
        (x, y) => x.or(y),
    }
}

impl<T: Real> Operators<T> {
    /// The derivatives of all operators by degree of freedom `i`, as expressions. Cost O(n), the path of the joint in cubes of
    /// blocks.
    ///
    /// # Errors
    /// [`OperatorError::Node`] if there is no such degree of freedom.
    ///
    /// # Example
    /// ```
    /// # use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
    /// # let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
    /// # let hinge = |name: &str| Joint::new(name, JointKind::Revolute { axis: [0.0, 1.0, 0.0] });
    /// # let at = phipsi_model::Placement { translation: [1.0, 0.0, 0.0], ..phipsi_model::Placement::IDENTITY };
    /// # let model = ModelBuilder::new("double pendulum").body(Body::new("upper", rod)).body(Body::new("lower", rod))
    /// #     .joint(hinge("shoulder"), "world", "upper").joint(hinge("elbow").at(at), "upper", "lower").build()?;
    /// // The inertia about the shoulder answers to the elbow: m₁/3 + m₂(4/3 + cos q₂) for rods of length one.
    /// let ops = phipsi_recursion::Operators::new(&model, &[0.2, 0.7])?;
    /// let rate = ops.sensitivity(1)?.mass_matrix.dense()?;
    /// assert!((rate[(0, 0)] + 0.7_f64.sin()).abs() < 1e-15);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn sensitivity(&self, i: usize) -> Result<Sensitivity<T>, OperatorError> {
        let joint = self.joint_space();
        let moved = (0..joint.blocks()).find(|&k| joint.range(k).contains(&i)).ok_or_else(|| {
            OperatorError::Node { name: "sensitivity".into(), node: i, nodes: joint.dimension() }
        })?;
        let component = i - joint.range(moved).start;
        let S = self.axes[moved][component];
        let zero = |rows: usize, columns: usize| DMatrix::from_element(rows, columns, T::zero());
        let state = self.state_space();
        let n = self.bodies.len();
        let own = Self::own_blocks;
        let (all_P, all_D_inverse, all_G) = (own(&self.P), own(&self.D_inverse), own(&self.G));
        let (all_H, all_R) = (own(&self.H), own(&self.R));

        // Blocks along the path; everything else is zero.
        let shift = |k: usize| super::shift(&self.poses[k]);
        let turned = self.turned_axis(moved).filter(|_| component == 1).map(|axis| axis.to_array());
        let H_rate = |k: usize| {
            let mut block = zero(joint.size(k), 6);
            if let (true, Some(axis)) = (k == moved, &turned) {
                axis.iter().enumerate().for_each(|(c, &x)| block[(0, c)] = x);
            }
            block
        };
        let mut P_rate: Vec<DMatrix<T>> = (0..n).map(|_| zero(6, 6)).collect();
        let mut G_rate: Vec<DMatrix<T>> = (0..n).map(|k| zero(6, joint.size(k))).collect();
        let mut R_rate = P_rate.clone();
        for k in self.tree.path_to_root(moved) {
            let (P, D_inverse, G) = (&all_P[k], &all_D_inverse[k], &all_G[k]);
            let (H, rate, R) = (&all_H[k], H_rate(k), &all_R[k]);
            let U = P * H.transpose();
            let U_rate = &P_rate[k] * H.transpose() + P * rate.transpose();
            let D_rate = &rate * &U + H * &U_rate;
            G_rate[k] = (&U_rate - G * &D_rate) * D_inverse;
            let Some(p) = self.tree.parent(k) else { break };
            let through = P - G * U.transpose();
            let cross = &U_rate * G.transpose();
            let through_rate = &P_rate[k] - &cross - cross.transpose() + G * &D_rate * G.transpose();
            let E = shift(k);
            let add = |into: &mut DMatrix<T>, whole: &DMatrix<T>, rate: &DMatrix<T>| {
                *into += &E * rate * E.transpose();
                if k == moved {
                    let turned = &E * cross_wrench(S) * whole * E.transpose();
                    *into += &turned + turned.transpose();
                }
            };
            add(&mut P_rate[p], &through, &through_rate);
            let inner = R_rate[k].clone();
            add(&mut R_rate[p], R, &inner);
        }

        let edge = |k: usize| if k == moved { shift(k) * cross_wrench(S) } else { zero(6, 6) };
        let E_phi = Operator::edges("Ė_φ", &self.tree, state, state, (0..n).map(edge).collect())?;
        let phi = &(&self.phi * &E_phi) * &self.phi;
        let H = self.diagonal("Ḣ", joint, state, H_rate);
        let P = self.diagonal("Ṗ", state, state, |k| P_rate[k].clone());
        let G = self.diagonal("Ġ", state, joint, |k| G_rate[k].clone());
        let R = self.diagonal("Ṙ", state, state, |k| R_rate[k].clone());
        let turns = turned.is_some().then_some(&H);
        let D = congruence([&self.H, &self.P], [turns, Some(&P)]).unwrap_or_else(|| P.clone());
        let D_inverse = -(&(&self.D_inverse * &D) * &self.D_inverse);
        let minus_tau_bar = &(&G * &self.H) + &(&self.G * &H);
        let tau_bar = -&minus_tau_bar;
        let K = &(&E_phi * &self.G) + &(&self.E_phi * &G);
        let E_psi = &(&E_phi * &self.tau_bar) + &(&self.E_phi * &tau_bar);
        let psi = &(&self.psi * &E_psi) * &self.psi;
        let source = congruence(
            [&self.H.adjoint(), &self.D_inverse],
            [turned.is_some().then(|| H.adjoint()).as_ref(), Some(&D_inverse)],
        );
        let source = source.unwrap_or_else(|| P.clone());
        let upsilon = self.upsilon_rate(&E_psi, &source)?;
        let state_covariance = congruence([&self.phi, &self.M], [Some(&phi), None]);
        let state_covariance = state_covariance.unwrap_or_else(|| P.clone());
        let mass_matrix = congruence([&self.H, &self.state_covariance()], [turns, Some(&state_covariance)]);
        let mass_matrix = mass_matrix.unwrap_or_else(|| D.clone());
        let inverse = self.mass_matrix_inverse();
        let mass_matrix_inverse = -(&(&inverse * &mass_matrix) * &inverse);
        let outward = self.psi.adjoint();
        let N = &(&self.H.adjoint() * &self.D_inverse) * &self.H;
        let omega = congruence([&outward, &N], [Some(&psi.adjoint()), Some(&source)]);
        let omega = omega.unwrap_or_else(|| P.clone());
        Ok(Sensitivity {
            E_phi,
            phi,
            H,
            P,
            D,
            D_inverse,
            G,
            K,
            tau_bar,
            E_psi,
            psi,
            R,
            upsilon,
            state_covariance,
            mass_matrix,
            mass_matrix_inverse,
            omega,
        })
    }

    /// Υ̇(k) = ψ̇* Υ ψ + ψ* Υ̇ ψ + ψ* Υ ψ̇ + Ṅ(k), base to tip.
    fn upsilon_rate(&self, E_psi: &Operator<T>, source: &Operator<T>) -> Result<Operator<T>, OperatorError> {
        let mut rates = source.diagonal_blocks()?;
        let (edges, turned, upsilon) =
            (self.E_psi.edge_blocks()?, E_psi.edge_blocks()?, Self::own_blocks(&self.upsilon));
        for k in 0..self.bodies.len() {
            if let Some(p) = self.tree.parent(k) {
                let edge = &edges[k];
                let cross = turned[k].transpose() * &upsilon[p] * edge;
                let moved = &cross + cross.transpose() + edge.transpose() * &rates[p] * edge;
                rates[k] += moved;
            }
        }
        let state = self.state_space();
        Ok(self.diagonal("Υ̇", state, state, |k| rates[k].clone()))
    }
}
