//! Dynamics as estimation: filter, smoother, batch estimates and their covariances, and the random field behind them.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | z, z⁺ | filtered spatial forces, before and after the joint's measurement: ψ K T, z + G ε | 6n | paper 1 (9.9), (9.10) |
//! | ε, ν | innovations T − H z, residuals D⁻¹ ε | nv | paper 1 (9.7), (9.8) |
//! | α⁺, α | accelerations of the joint's inboard and outboard side: E_φ* α, ψ* H* ν | 6n | paper 1 (9.12), (9.14) |
//! | θ̈ | joint accelerations ν − K* α | nv | paper 1 (9.13) |
//! | f | spatial forces z + P α | 6n | paper 1 §4 |
//! | 𝒢 | gain of the batch estimate, S H* 𝓜⁻¹ | 6n × nv | paper 1 (7.2) |
//! | 𝒫 | covariance of X − f: (I − 𝒢 H) S | 6n × 6n | paper 1 (7.5) |
//! | Q | covariance of W − Ŵ: M − M Ω M | 6n × 6n | paper 1 §7 |
//! | W, X, T | D'Alembert forces N(0, M), φ W, H X | 6n, 6n, nv | paper 1 (5.1)–(5.4) |
//! | M^½ | a root of M: M^½ (M^½)* = M | 6n × 6n | |
//!
//! Forces in N and N·m at the joint's body frame, accelerations in rad/s² and m/s², body axes, angular first. The velocity
//! terms are left out, as in the papers: T is what is left after bias forces.

use super::Operators;
use crate::error::DynamicsError;
use nalgebra::DMatrix;
use phipsi_model::Random;
use phipsi_spatial::Real;
use phipsi_topology::Operator;

/// What the filter leaves, tip to base.
#[derive(Clone, Debug, PartialEq)]
pub struct Filtered<T> {
    /// z = ψ K T: spatial forces estimated from the joints outboard, 6n.
    pub z: Vec<T>,
    /// ε = T − H z, nv: white, with covariance D.
    pub epsilon: Vec<T>,
    /// ν = D⁻¹ ε, nv: accelerations if all inboard joints were locked.
    pub nu: Vec<T>,
    /// z⁺ = z + G ε, 6n.
    pub z_plus: Vec<T>,
}

/// What the smoother makes of it, base to tip.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoothed<T> {
    /// α⁺ = E_φ* α: what the parent's motion gives each body, 6n.
    pub alpha_plus: Vec<T>,
    /// α = ψ* H* ν: spatial accelerations, 6n.
    pub alpha: Vec<T>,
    /// θ̈ = ν − K* α = 𝓜⁻¹ T, nv.
    pub acceleration: Vec<T>,
    /// f = z + P α: spatial forces, 6n.
    pub f: Vec<T>,
}

/// One realization of the random field.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldSample<T> {
    /// W ~ N(0, M), 6n.
    pub W: Vec<T>,
    /// X = φ W, 6n: covariance S.
    pub X: Vec<T>,
    /// T = H X, nv: covariance 𝓜.
    pub T: Vec<T>,
}

/// The random field of a model at a configuration, to draw from many times.
///
/// # Computes
/// W ~ N(0, M), X = φ W, T = H X: the covariance of T is the mass matrix (paper 1 Lemma 2). After N samples the mean of T T* is
/// wrong by √((‖𝓜‖² + (tr 𝓜)²)/N) in the Frobenius norm, on average.
///
/// # Cost
/// O(n) a sample.
#[derive(Clone, Debug)]
pub struct RandomField<T> {
    root: Operator<T>,
    phi: Operator<T>,
    H: Operator<T>,
}

/// U with U U* = M of a body's inertia, which may be singular: mass before moments, so that a point's moment leaves nothing
/// behind, then the largest moment first. What is left below rounding of the body's largest moment counts as zero.
fn root<T: Real>(M: &DMatrix<T>) -> DMatrix<T> {
    let n = M.nrows();
    let (mut rest, mut out) = (M.clone(), DMatrix::from_element(n, n, T::zero()));
    for half in [3..6, 0..3] {
        let size = half.clone().fold(T::zero(), |m, i| m.larger(M[(i, i)]));
        let mut left: Vec<usize> = half.collect();
        while !left.is_empty() {
            let larger =
                |a: usize, b: usize| if rest[(left[b], left[b])] > rest[(left[a], left[a])] { b } else { a };
            let j = left.remove((1..left.len()).fold(0, larger));
            let pivot = rest[(j, j)];
            let counts = pivot > size * T::splat(64.0 * T::EPSILON);
            if !counts {
                break;
            }
            let scale = pivot.sqrt().recip();
            let column: Vec<T> = (0..n).map(|i| rest[(i, j)] * scale).collect();
            for i in 0..n {
                out[(i, j)] = column[i];
                for k in 0..n {
                    rest[(i, k)] -= column[i] * column[k];
                }
            }
        }
    }
    out
}

/// Two independent numbers of the standard normal distribution (Box and Muller 1958).
fn normal_pair(random: &mut Random) -> [f64; 2] {
    let (u, turn) = (1.0 - random.uniform(), std::f64::consts::TAU * random.uniform());
    let radius = (-2.0 * u.ln()).sqrt();
    [radius * turn.cos(), radius * turn.sin()]
}

impl<T: Real> RandomField<T> {
    /// M^½, block by block.
    pub fn root(&self) -> &Operator<T> {
        &self.root
    }
    /// One realization. The same generator gives the same numbers on every machine.
    pub fn sample(&self, random: &mut Random) -> FieldSample<T> {
        let size = self.root.columns().dimension();
        let mut white = Vec::with_capacity(size + 1);
        while white.len() < size {
            white.extend(normal_pair(random).map(T::splat));
        }
        white.truncate(size);
        let W = Operators::image(&self.root, &white);
        let X = Operators::image(&self.phi, &W);
        let T = Operators::image(&self.H, &X);
        FieldSample { W, X, T }
    }
}

impl<T: Real> Operators<T> {
    /// The filter: estimates from the tips to the base of the spatial forces that joint forces leave.
    ///
    /// # Computes
    /// z = ψ K T, ε = T − H z, ν = D⁻¹ ε, z⁺ = z + G ε; paper 1 (9.7)–(9.10). `tau`: T, nv, without bias forces.
    ///
    /// # Cost
    /// O(n), one sweep.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    ///
    /// # Example
    /// ```
    /// # use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder, Placement};
    /// # let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
    /// # let hinge = |name: &str| Joint::new(name, JointKind::Revolute { axis: [0.0, 1.0, 0.0] });
    /// # let at = Placement { translation: [1.0, 0.0, 0.0], ..Placement::IDENTITY };
    /// # let model = ModelBuilder::new("double pendulum").body(Body::new("upper", rod)).body(Body::new("lower", rod))
    /// #     .joint(hinge("shoulder"), "world", "upper").joint(hinge("elbow").at(at), "upper", "lower").build()?;
    /// let ops = phipsi_recursion::Operators::new(&model, &[0.3, -0.5])?;
    /// let filtered = ops.filter(&[1.0, 2.0])?;
    /// // Nothing is outboard of the elbow: its innovation is its moment, its residual the acceleration of one rod.
    /// assert_eq!(filtered.epsilon[1], 2.0);
    /// assert!((filtered.nu[1] - 6.0_f64).abs() < 1e-14);
    /// let smoothed = ops.smooth(&filtered)?;
    /// let forces = ops.mass_matrix().apply(&smoothed.acceleration)?;
    /// assert!((forces[0] - 1.0_f64).abs() < 1e-14 && (forces[1] - 2.0_f64).abs() < 1e-14);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn filter(&self, tau: &[T]) -> Result<Filtered<T>, DynamicsError> {
        self.check_joint_vector("tau", tau)?;
        let z = Self::image(&self.psi, &Self::image(&self.K, tau));
        let seen = Self::image(&self.H, &z);
        let epsilon: Vec<T> = tau.iter().zip(seen).map(|(&t, x)| t - x).collect();
        let nu = Self::image(&self.D_inverse, &epsilon);
        let z_plus = z.iter().zip(Self::image(&self.G, &epsilon)).map(|(&z, x)| z + x).collect();
        Ok(Filtered { z, epsilon, nu, z_plus })
    }

    /// The smoother: accelerations from the base to the tips, and the spatial forces that they tell.
    ///
    /// # Computes
    /// α = ψ* H* ν, α⁺ = E_φ* α, θ̈ = ν − K* α, f = z + P α; paper 1 (9.11)–(9.14).
    ///
    /// # Cost
    /// O(n), one sweep.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`] if `filtered` is of another model.
    pub fn smooth(&self, filtered: &Filtered<T>) -> Result<Smoothed<T>, DynamicsError> {
        self.check_joint_vector("filtered.nu", &filtered.nu)?;
        crate::error::check_length("filtered.z", &filtered.z, self.state_space().dimension())?;
        let nu = &filtered.nu;
        let alpha = Self::image(&self.psi.adjoint(), &Self::image(&self.H.adjoint(), nu));
        let alpha_plus = Self::image(&self.E_phi.adjoint(), &alpha);
        let taken = Self::image(&self.K.adjoint(), &alpha);
        let acceleration = nu.iter().zip(taken).map(|(&nu, x)| nu - x).collect();
        let f = filtered.z.iter().zip(Self::image(&self.P, &alpha)).map(|(&z, x)| z + x).collect();
        Ok(Smoothed { alpha_plus, alpha, acceleration, f })
    }

    /// 𝒢 = S H* 𝓜⁻¹, the gain of the batch estimate f = E(X/T) = 𝒢 T (paper 1 (7.2)).
    pub fn batch_gain(&self) -> Operator<T> {
        &(&self.state_covariance() * &self.H.adjoint()) * &self.mass_matrix_inverse()
    }
    /// 𝒫 = (I − 𝒢 H) S, the covariance of the error X − f of the smoothed forces (paper 1 (7.5)). H 𝒫 = 0: at the joints there
    /// is no error.
    pub fn smoothed_error_covariance(&self) -> Operator<T> {
        &(self.identity() - &self.batch_gain() * &self.H) * &self.state_covariance()
    }
    /// ψ M ψ*, the covariance of the error X − z of the filtered forces (paper 1 Lemma 8).
    pub fn filtered_error_covariance(&self) -> Operator<T> {
        &(&self.psi * &self.M) * &self.psi.adjoint()
    }
    /// Q = M − M φ* H* 𝓜⁻¹ H φ M, the covariance of the error W − Ŵ of the inertial forces (paper 1 §7).
    pub fn inertial_force_error_covariance(&self) -> Operator<T> {
        let right = &(&self.H * &self.phi) * &self.M;
        &self.M - &(&(&right.adjoint() * &self.mass_matrix_inverse()) * &right)
    }
    /// The random field W ~ N(0, M), X = φ W, T = H X (paper 1 (5.1)–(5.4)).
    ///
    /// # Example
    /// ```
    /// # use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder, Random};
    /// # let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
    /// # let hinge = Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] });
    /// # let model = ModelBuilder::new("pendulum").body(Body::new("rod", rod)).joint(hinge, "world", "rod").build()?;
    /// let ops = phipsi_recursion::Operators::new(&model, &[0.3_f64])?;
    /// let (field, mut random) = (ops.random_field(), Random::new(1));
    /// let mean = (0..10_000).map(|_| field.sample(&mut random).T[0].powi(2)).sum::<f64>() / 1e4;
    /// assert!((mean - 1.0 / 3.0).abs() < 0.02); // the inertia of a rod about its end
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn random_field(&self) -> RandomField<T> {
        let state = self.state_space();
        let blocks = Self::own_blocks(&self.M);
        let root = self.diagonal("M^½", state, state, |k| root(&blocks[k]));
        RandomField { root, phi: self.phi.clone(), H: self.H.clone() }
    }
    /// One realization of [`Operators::random_field`].
    pub fn sample_field(&self, random: &mut Random) -> FieldSample<T> {
        self.random_field().sample(random)
    }
}
