//! Derivatives of inverse dynamics, one direction after the other, by dual numbers.

use crate::dual::Dual;
use crate::inverse_dynamics::inverse_dynamics;
use crate::mass_matrix::mass_matrix;
use nalgebra::DMatrix;
use phipsi_model::{JointKind, Model};
use phipsi_spatial::{Real, Vec3, Wrench};

/// Derivatives of generalised forces (or accelerations) by the increments of q, by v, and by v̇ (or forces). nv×nv each.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivatives<T> {
    /// Along the increments of `Model::integrate`.
    pub d_dq: DMatrix<T>,
    /// By the components of v.
    pub d_dv: DMatrix<T>,
    /// By the components of v̇ (inverse dynamics) or of the forces (forward dynamics).
    pub d_last: DMatrix<T>,
}

/// The rate of q that `Model::integrate` gives an increment at its start: the joints' velocities x in body axes. nq.
pub fn tangent<T: Real>(model: &Model, q: &[T], x: &[T]) -> Vec<T> {
    let mut rate = vec![T::zero(); model.nq()];
    for (k, joint) in model.joints().iter().enumerate() {
        let (qs, vs) = (model.q_range(k), model.v_range(k));
        let (q, x, out) = (&q[qs.clone()], &x[vs], &mut rate[qs]);
        match joint.kind {
            JointKind::Spherical => out.copy_from_slice(&quaternion_rate(q, x)),
            JointKind::Free => {
                out[..3].copy_from_slice(&turned(&q[3..], [x[3], x[4], x[5]]));
                out[3..].copy_from_slice(&quaternion_rate(&q[3..], &x[..3]));
            }
            JointKind::Planar { .. } => {
                let (s, c) = q[2].sin_cos();
                out.copy_from_slice(&[c * x[1] - s * x[2], s * x[1] + c * x[2], x[0]]);
            }
            _ => out.copy_from_slice(x),
        }
    }
    rate
}

/// ½ q∘(ω, 0), for q = (x, y, z, w).
fn quaternion_rate<T: Real>(q: &[T], w: &[T]) -> [T; 4] {
    let half = T::splat(0.5);
    let (u, scalar, w) = (Vec3([q[0], q[1], q[2]]), q[3], Vec3([w[0], w[1], w[2]]));
    let vector = w.scale(scalar) + u.cross(w);
    let [x, y, z] = vector.scale(half).0;
    [x, y, z, -(u.dot(w) * half)]
}

/// x turned by q of any length: x + 2 u × (w x + u × x)/|q|².
fn turned<T: Real>(q: &[T], x: [T; 3]) -> [T; 3] {
    let (u, w, x) = (Vec3([q[0], q[1], q[2]]), q[3], Vec3(x));
    let length = u.dot(u) + w * w;
    (x + u.cross(x.scale(w) + u.cross(x)).scale(T::splat(2.0) / length)).0
}

/// Numbers with these rates.
pub fn seeded<T: Real>(x: &[T], rate: &[T]) -> Vec<Dual<T>> {
    x.iter().zip(rate).map(|(x, r)| Dual::new(*x, *r)).collect()
}

/// Numbers that do not change.
pub fn fixed<T: Real>(x: &[T]) -> Vec<Dual<T>> {
    x.iter().map(|x| Dual::fixed(*x)).collect()
}

/// Wrenches that do not change in their bodies' axes.
pub fn fixed_wrenches<T: Real>(wrenches: &[Wrench<T>]) -> Vec<Wrench<Dual<T>>> {
    wrenches.iter().map(|w| Wrench::from_array(w.to_array().map(Dual::fixed))).collect()
}

/// Derivatives of [`inverse_dynamics`] at (q, v, a); `d_last` is M.
pub fn inverse_dynamics_derivatives<T: Real>(
    model: &Model,
    q: &[T],
    v: &[T],
    a: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Derivatives<T> {
    let nv = model.nv();
    let wrenches = wrenches.map(fixed_wrenches);
    let column = |q: &[Dual<T>], v: &[Dual<T>]| {
        inverse_dynamics(model, q, v, &fixed(a), wrenches.as_deref()).into_iter().map(|x| x.rate)
    };
    let mut d_dq = DMatrix::from_element(nv, nv, T::zero());
    let mut d_dv = d_dq.clone();
    for j in 0..nv {
        let mut unit = vec![T::zero(); nv];
        unit[j] = T::one();
        for (i, x) in column(&seeded(q, &tangent(model, q, &unit)), &fixed(v)).enumerate() {
            d_dq[(i, j)] = x;
        }
        for (i, x) in column(&fixed(q), &seeded(v, &unit)).enumerate() {
            d_dv[(i, j)] = x;
        }
    }
    Derivatives { d_dq, d_dv, d_last: mass_matrix(model, q) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::case;
    use crate::sensitivity::widened;
    use phipsi_spatial::Dd;

    /// The tangent against differences along `Model::integrate`.
    #[test]
    fn the_tangent_is_that_of_integrate() {
        let step = Dd::from_f64(1e-9);
        for seed in 0..200 {
            let case = case(seed);
            let mut q = widened(&case.q);
            case.model.normalize(&mut q);
            let x = widened(&case.v);
            let moved = |sign: f64| {
                let h: Vec<Dd> = x.iter().map(|x| *x * step * Dd::from_f64(sign)).collect();
                case.model.integrate(&q, &h)
            };
            let (after, before) = (moved(1.0), moved(-1.0));
            let speed: f64 = 1.0 + x.iter().map(|v| v.hi.abs()).sum::<f64>();
            for (i, rate) in tangent(&case.model, &q, &x).iter().enumerate() {
                let difference = (after[i] - before[i]) / (step + step);
                let error = (difference - *rate).hi.abs();
                // Third derivative of the path: at most speed³.
                assert!(error < 1e-18 * speed * speed * speed, "seed {seed}, q[{i}]: {error:e}");
            }
        }
    }
}
