//! Derivatives of inverse and forward dynamics as operator expressions: sensitivities by all coordinates at once.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | h, V, V⁺ | H* v, φ* h, V − h: joint velocity, velocity, what the parent gives | paper 2 (3.7) |
//! | α, α⁺ | φ*(H* a + V × h + Ḣ* v + gravity), what the parent gives; componentwise rates in body axes | soa.md 3.0 |
//! | f | φ (M α + V × M V) | paper 2 (3.6) |
//! | V~, f̄ | V~ S = V × S on motions; f̄ S = S × f | |
//! | N_x | derivative of H* x by the joint's coordinates: the turning axis of a universal joint | |
//!
//! φ̇* x along δ is φ* times the parent's part of x crossed with H* δ, so that one sweep serves all coordinates:
//!
//! ∂V = φ*(V~⁺ H* + N_v) · ∂α = φ*(α~⁺ H* + N_a + V~ N_v + Ṅ_v − h~ ∂V) · ∂f = φ(M ∂α + V~ M ∂V + (MV)¯ ∂V + E_φ f̄ H*) · ∂T = H ∂f + N_f

use super::{Operators, block, cross_motion, cross_wrench};
use crate::error::{DynamicsError, check_length};
use nalgebra::DMatrix;
use phipsi_spatial::{Motion, Real, Vec3, Wrench};
use phipsi_topology::{Operator, Space};

/// ∂/∂q (increments of `Model::integrate`), ∂/∂v, and ∂/∂ of the last argument, each nv × nv, as expressions.
#[derive(Clone, Debug)]
pub struct DynamicsDerivatives<T> {
    /// By the increments of q.
    pub d_dq: Operator<T>,
    /// By v.
    pub d_dv: Operator<T>,
    /// By a (inverse dynamics) or the joint forces (forward dynamics).
    pub d_last: Operator<T>,
}

/// One six-vector a block.
fn motions<T: Real>(x: &[T]) -> Vec<Motion<T>> {
    x.chunks_exact(6).map(|m| Motion::from_array([m[0], m[1], m[2], m[3], m[4], m[5]])).collect()
}

fn wrenches<T: Real>(x: &[T]) -> Vec<Wrench<T>> {
    x.chunks_exact(6).map(|m| Wrench::from_array([m[0], m[1], m[2], m[3], m[4], m[5]])).collect()
}

/// S ↦ S × f.
fn bar<T: Real>(f: Wrench<T>) -> DMatrix<T> {
    block(|j| Motion::unit(j).cross_wrench(f).to_array())
}

/// Vectors of the nominal motion.
struct Nominal<T> {
    h: Vec<Motion<T>>,
    V: Vec<Motion<T>>,
    V_in: Vec<Motion<T>>,
    alpha_in: Vec<Motion<T>>,
    momentum: Vec<Wrench<T>>,
    f: Vec<Wrench<T>>,
}

impl<T: Real> Operators<T> {
    /// A x for an operator of this model and a vector that fits it.
    pub(super) fn image(a: &Operator<T>, x: &[T]) -> Vec<T> {
        a.apply(x).unwrap_or_else(|error| unreachable!("operators of one model fit: {error}"))
    }
    pub(super) fn check_joint_vector(&self, argument: &'static str, x: &[T]) -> Result<(), DynamicsError> {
        check_length(argument, x, self.joint_space().dimension())
    }
    /// The velocity of the turning axis of joint k: Ḣ* v.
    fn axis_rate(&self, k: usize, v: &[T]) -> Motion<T> {
        let at = self.joint_space().range(k).start;
        self.turned_axis(k).map_or(Motion::zero(), |axis| axis.scale(v[at] * v[at + 1]))
    }

    fn nominal(&self, v: &[T], a: &[T]) -> Nominal<T> {
        let (outward, expand) = (self.phi.adjoint(), self.H.adjoint());
        let flat = |x: &[Motion<T>]| x.iter().flat_map(|m| m.to_array()).collect::<Vec<T>>();
        let h = motions(&Self::image(&expand, v));
        let V = motions(&Self::image(&outward, &flat(&h)));
        let push = motions(&Self::image(&expand, a));
        let own: Vec<Motion<T>> =
            (0..h.len()).map(|k| push[k] + V[k].cross_motion(h[k]) + self.axis_rate(k, v)).collect();
        let gravity = |k: usize| match self.tree.parent(k) {
            Some(_) => Motion::zero(),
            None => {
                let down = self.poses[k].rotation.transpose_mul(-self.gravity);
                Motion::new(Vec3::zero(), down)
            }
        };
        let driven: Vec<Motion<T>> = (0..h.len()).map(|k| own[k] + gravity(k)).collect();
        let alpha = Self::image(&outward, &flat(&driven));
        let momentum = wrenches(&Self::image(&self.M, &flat(&V)));
        let inertial = wrenches(&Self::image(&self.M, &alpha));
        let forces: Vec<T> =
            (0..h.len()).flat_map(|k| (inertial[k] + V[k].cross_wrench(momentum[k])).to_array()).collect();
        let alpha = motions(&alpha);
        Nominal {
            V_in: (0..h.len()).map(|k| V[k] - h[k]).collect(),
            alpha_in: (0..h.len()).map(|k| alpha[k] - own[k]).collect(),
            f: wrenches(&Self::image(&self.phi, &forces)),
            h,
            V,
            momentum,
        }
    }

    /// Joint forces T = H φ (M α + V × M V), gravity included. `v`, `a`: nv. Cost O(n).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn inverse_dynamics(&self, v: &[T], a: &[T]) -> Result<Vec<T>, DynamicsError> {
        self.check_joint_vector("v", v)?;
        self.check_joint_vector("a", a)?;
        let f: Vec<T> = self.nominal(v, a).f.iter().flat_map(|f| f.to_array()).collect();
        Ok(Self::image(&self.H, &f))
    }

    /// A diagonal operator with one column a degree of freedom, from what the second angle of a universal joint does.
    fn turning(&self, rows: &Space, entries: impl Fn(usize, Motion<T>) -> [Vec<T>; 2]) -> Operator<T> {
        self.diagonal("N", rows, self.joint_space(), |k| {
            let mut n = DMatrix::from_element(rows.size(k), self.joint_space().size(k), T::zero());
            if let Some(axis) = self.turned_axis(k) {
                for (c, column) in entries(k, axis).into_iter().enumerate() {
                    column.into_iter().enumerate().for_each(|(r, x)| n[(r, c)] = x);
                }
            }
            n
        })
    }

    /// ∂T/∂q, ∂T/∂v, ∂T/∂a of inverse dynamics. `v`, `a`: nv. Cost O(n) to make and O(n) an application.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn inverse_dynamics_derivatives(
        &self,
        v: &[T],
        a: &[T],
    ) -> Result<DynamicsDerivatives<T>, DynamicsError> {
        self.check_joint_vector("v", v)?;
        self.check_joint_vector("a", a)?;
        let Nominal { h, V, V_in, alpha_in, momentum, f } = self.nominal(v, a);
        let (state, joint) = (self.state_space(), self.joint_space());
        let (outward, axes) = (self.phi.adjoint(), self.H.adjoint());
        let crossed = |name: &str, x: &[Motion<T>]| self.diagonal(name, state, state, |k| cross_motion(x[k]));
        let speeds = |k: usize| (v[joint.range(k).start], v[joint.range(k).start + 1]);
        let none = |rows: usize| vec![T::zero(); rows];
        let list = |m: Motion<T>| m.to_array().to_vec();
        let (V_cross, h_cross) = (crossed("V~", &V), crossed("h~", &h));
        let velocity_forces = {
            let turned = self.diagonal("V~*", state, state, |k| cross_wrench(V[k]));
            &(&turned * &self.M) + &self.diagonal("(MV)¯", state, state, |k| bar(momentum[k]))
        };
        let turns = self.turning.iter().any(|&t| t);
        // H φ (M ∂α + (V~ M + (MV)¯) ∂V + pushed).
        let forces = |dV: &Operator<T>, d_alpha: &Operator<T>, pushed: Option<Operator<T>>| {
            let own = &(&self.M * d_alpha) + &(&velocity_forces * dV);
            let all = pushed.map_or(own.clone(), |p| &own + &p);
            &(&self.H * &self.phi) * &all
        };

        let mut moved = &crossed("V~⁺", &V_in) * &axes;
        let mut pushed = &crossed("α~⁺", &alpha_in) * &axes;
        if turns {
            let N_v = self.turning(state, |k, axis| [none(6), list(axis.scale(speeds(k).0))]);
            let N_a = self.turning(state, |k, axis| [none(6), list(axis.scale(a[joint.range(k).start]))]);
            let N_rate = self.turning(state, |k, axis| {
                let (x, y) = speeds(k);
                [none(6), list(axis.cross_motion(self.axes[k][1]).scale(x * y))]
            });
            moved = &moved + &N_v;
            pushed = &(&pushed + &N_a) + &(&(&V_cross * &N_v) + &N_rate);
        }
        let dV = &outward * &moved;
        let d_alpha = &outward * &(&pushed - &(&h_cross * &dV));
        let through = &(&self.E_phi * &self.diagonal("f¯", state, state, |k| bar(f[k]))) * &axes;
        let mut d_dq = forces(&dV, &d_alpha, Some(through));
        if turns {
            d_dq = &d_dq + &self.turning(joint, |k, axis| [none(2), vec![axis.dot(f[k]), T::zero()]]);
        }

        let dV = &outward * &axes;
        let mut pushed = &V_cross * &axes;
        if turns {
            let N = self.turning(state, |k, axis| {
                let (x, y) = speeds(k);
                [list(axis.scale(y)), list(axis.scale(x))]
            });
            pushed = &pushed + &N;
        }
        let d_alpha = &outward * &(&pushed - &(&h_cross * &dV));
        let d_dv = forces(&dV, &d_alpha, None);
        Ok(DynamicsDerivatives { d_dq, d_dv, d_last: self.mass_matrix() })
    }

    /// Accelerations 𝓜⁻¹ (T − C), by filter and smoother. `v`, `tau`: nv. Cost O(n).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn forward_dynamics(&self, v: &[T], tau: &[T]) -> Result<Vec<T>, DynamicsError> {
        self.check_joint_vector("tau", tau)?;
        let bias = self.inverse_dynamics(v, &vec![T::zero(); tau.len()])?;
        let rest: Vec<T> = tau.iter().zip(bias).map(|(&t, c)| t - c).collect();
        Ok(Self::image(&self.mass_matrix_inverse(), &rest))
    }

    /// ∂a/∂q, ∂a/∂v, ∂a/∂T of forward dynamics: −𝓜⁻¹ times those of inverse dynamics at the accelerations that result, and
    /// 𝓜⁻¹. `v`, `tau`: nv. Cost O(n) to make and O(n) an application.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn forward_dynamics_derivatives(
        &self,
        v: &[T],
        tau: &[T],
    ) -> Result<DynamicsDerivatives<T>, DynamicsError> {
        let a = self.forward_dynamics(v, tau)?;
        let inverse_dynamics = self.inverse_dynamics_derivatives(v, &a)?;
        let inverse = self.mass_matrix_inverse();
        Ok(DynamicsDerivatives {
            d_dq: -(&inverse * &inverse_dynamics.d_dq),
            d_dv: -(&inverse * &inverse_dynamics.d_dv),
            d_last: inverse,
        })
    }
}
