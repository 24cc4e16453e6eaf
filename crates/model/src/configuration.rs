//! Configuration space: neutral and random states, `integrate`, `difference`, `normalize`.
//!
//! Increments are in the joint's own algebra, body axes, angular part first, ordered as v: q ∘ τ(x) with τ = exp
//! (notes/integrators.md 1). For joints whose q is a vector and for modal coordinates, q + x.

use crate::joint::JointKind;
use crate::{Model, Random, State};
use phipsi_spatial::quaternion::{angle_series, exp_motion, log_motion};
use phipsi_spatial::{Motion, Quaternion, Real, Vec3};

impl Model {
    /// The neutral configuration: zeros, and unit quaternions.
    pub fn neutral<T: Real>(&self) -> Vec<T> {
        let mut q = vec![T::zero(); self.nq()];
        for k in self.moving_joints() {
            if matches!(self.joints[k].kind, JointKind::Spherical | JointKind::Free) {
                q[self.q_offsets[k + 1] - 1] = T::one();
            }
        }
        q
    }
    /// A reproducible random state: angles and lengths in [−1, 1] (within the limits where there are), uniform
    /// orientations, modal coordinates in [−0.01, 0.01], velocities in [−1, 1].
    pub fn random_state(&self, seed: u64) -> State {
        let mut random = Random::new(seed);
        let mut q: Vec<f64> = vec![0.0; self.nq()];
        for k in self.moving_joints() {
            let range = self.q_range(k);
            let joint = &self.joints[k];
            match joint.kind {
                JointKind::Spherical => q[range].copy_from_slice(&random.quaternion()),
                JointKind::Free => {
                    q[range.start..range.start + 3].copy_from_slice(&random.vector());
                    q[range.start + 3..range.end].copy_from_slice(&random.quaternion());
                }
                _ => {
                    for i in range {
                        let x = random.signed();
                        q[i] = match joint.limits.position {
                            Some([lower, upper]) if lower <= upper => {
                                let (lower, upper) = (lower.max(-3.0), upper.min(3.0));
                                0.5 * (lower + upper) + 0.5 * (upper - lower) * x
                            }
                            _ => x,
                        };
                    }
                }
            }
        }
        for q in &mut q[self.joint_nq()..] {
            *q = 0.01 * random.signed();
        }
        let v = (0..self.nv()).map(|_| random.signed()).collect();
        State { q, v, t: 0.0 }
    }
    /// q ∘ τ(x): the configuration after unit time at the constant body velocity x.
    ///
    /// `q`: nq, `x`: nv, `out`: nq; slices of these lengths. Quaternions come out normalised.
    pub fn integrate_into<T: Real>(&self, q: &[T], x: &[T], out: &mut [T]) {
        for k in self.moving_joints() {
            let (qr, vr) = (self.q_range(k), self.v_range(k));
            integrate_joint(&self.joints[k].kind, &q[qr.clone()], &x[vr], &mut out[qr]);
        }
        let (first, x) = (self.joint_nq(), &x[self.joint_nv()..]);
        for ((out, q), x) in out[first..].iter_mut().zip(&q[first..]).zip(x) {
            *out = *q + *x;
        }
    }
    /// [`integrate_into`](Self::integrate_into) a new vector.
    pub fn integrate<T: Real>(&self, q: &[T], x: &[T]) -> Vec<T> {
        let mut out = vec![T::zero(); self.nq()];
        self.integrate_into(q, x, &mut out);
        out
    }
    /// The shortest x with q0 ∘ τ(x) = q1; angles are not wrapped, quaternions are read with either sign.
    pub fn difference_into<T: Real>(&self, q0: &[T], q1: &[T], out: &mut [T]) {
        for k in self.moving_joints() {
            let (qr, vr) = (self.q_range(k), self.v_range(k));
            difference_joint(&self.joints[k].kind, &q0[qr.clone()], &q1[qr], &mut out[vr]);
        }
        let (first, out) = (self.joint_nq(), &mut out[self.joint_nv()..]);
        for ((out, q0), q1) in out.iter_mut().zip(&q0[first..]).zip(&q1[first..]) {
            *out = *q1 - *q0;
        }
    }
    /// [`difference_into`](Self::difference_into) a new vector.
    pub fn difference<T: Real>(&self, q0: &[T], q1: &[T]) -> Vec<T> {
        let mut out = vec![T::zero(); self.nv()];
        self.difference_into(q0, q1, &mut out);
        out
    }
    /// Divides every quaternion by its length; a zero one becomes the identity.
    pub fn normalize<T: Real>(&self, q: &mut [T]) {
        for k in self.moving_joints() {
            if matches!(self.joints[k].kind, JointKind::Spherical | JointKind::Free) {
                let end = self.q_offsets[k + 1];
                let x = quaternion_at(q, end - 4);
                let unit =
                    if x.0.iter().all(|c| *c == T::zero()) { Quaternion::identity() } else { x.normalized() };
                q[end - 4..end].copy_from_slice(&unit.0);
            }
        }
    }
}

fn quaternion_at<T: Real>(q: &[T], i: usize) -> Quaternion<T> {
    Quaternion([q[i], q[i + 1], q[i + 2], q[i + 3]])
}

fn vector_at<T: Real>(q: &[T], i: usize) -> Vec3<T> {
    Vec3([q[i], q[i + 1], q[i + 2]])
}

fn integrate_joint<T: Real>(kind: &JointKind, q: &[T], x: &[T], out: &mut [T]) {
    match kind {
        JointKind::Spherical => {
            let turned = quaternion_at(q, 0).compose(Quaternion::exp(vector_at(x, 0))).normalized();
            out.copy_from_slice(&turned.0);
        }
        JointKind::Free => {
            let (rotation, step) = exp_motion(Motion::new(vector_at(x, 0), vector_at(x, 3)));
            let start = quaternion_at(q, 3);
            let position = vector_at(q, 0) + start.to_rotation() * step;
            out[..3].copy_from_slice(&position.0);
            out[3..].copy_from_slice(&start.compose(rotation).normalized().0);
        }
        JointKind::Planar { .. } => {
            // SE(2): translation (sin ω/ω) v + ((1 − cos ω)/ω) z × v in child axes.
            let w = x[0];
            let (a, b) = angle_series(w * w);
            let (s, c) = (T::one() - b * w * w, a * w);
            let (dx, dy) = (s * x[1] - c * x[2], c * x[1] + s * x[2]);
            let (sine, cosine) = q[2].sin_cos();
            out[0] = q[0] + cosine * dx - sine * dy;
            out[1] = q[1] + sine * dx + cosine * dy;
            out[2] = q[2] + w;
        }
        _ => {
            for i in 0..q.len() {
                out[i] = q[i] + x[i];
            }
        }
    }
}

fn difference_joint<T: Real>(kind: &JointKind, q0: &[T], q1: &[T], out: &mut [T]) {
    match kind {
        JointKind::Spherical => {
            let step = quaternion_at(q0, 0).conjugate().compose(quaternion_at(q1, 0)).normalized();
            out.copy_from_slice(&step.log().0);
        }
        JointKind::Free => {
            let start = quaternion_at(q0, 3);
            let step = start.conjugate().compose(quaternion_at(q1, 3)).normalized();
            let moved = start.to_rotation().transpose_mul(vector_at(q1, 0) - vector_at(q0, 0));
            out.copy_from_slice(&log_motion(step, moved).to_array());
        }
        JointKind::Planar { .. } => {
            let w = q1[2] - q0[2];
            let (sine, cosine) = q0[2].sin_cos();
            let (x, y) = (q1[0] - q0[0], q1[1] - q0[1]);
            let (dx, dy) = (cosine * x + sine * y, cosine * y - sine * x);
            let (a, b) = angle_series(w * w);
            let (s, c) = (T::one() - b * w * w, a * w);
            let scale = (s * s + c * c).recip();
            out[0] = w;
            out[1] = (s * dx + c * dy) * scale;
            out[2] = (s * dy - c * dx) * scale;
        }
        _ => {
            for i in 0..q0.len() {
                out[i] = q1[i] - q0[i];
            }
        }
    }
}
