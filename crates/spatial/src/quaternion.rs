//! Unit quaternions (x, y, z, w), child to parent, and the exponential maps of rotations and rigid motions.

use crate::{Mat3, Motion, Real, Scalar, Transform, Vec3};

/// A quaternion (x, y, z, w); unit length where it is a rotation from child to parent axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quaternion<T>(pub [T; 4]);

impl<T: Scalar> Quaternion<T> {
    /// No rotation.
    pub fn identity() -> Self {
        Quaternion([T::zero(), T::zero(), T::zero(), T::one()])
    }
    /// The rotation matrix, child to parent; the quaternion need not have unit length, only not be zero.
    #[inline(always)]
    pub fn to_rotation(self) -> Mat3<T> {
        let [x, y, z, w] = self.0;
        let s = (x.fma(x, y.fma(y, z.fma(z, w * w)))).recip();
        let s = s + s;
        let (xs, ys, zs) = (x * s, y * s, z * s);
        let (wx, wy, wz) = (w * xs, w * ys, w * zs);
        let (xx, xy, xz, yy, yz, zz) = (x * xs, x * ys, x * zs, y * ys, y * zs, z * zs);
        let one = T::one();
        Mat3([
            [one - (yy + zz), xy - wz, xz + wy],
            [xy + wz, one - (xx + zz), yz - wx],
            [xz - wy, yz + wx, one - (xx + yy)],
        ])
    }
    /// The product p ∘ q: first q, then p.
    pub fn compose(self, q: Self) -> Self {
        let ([a, b, c, d], [x, y, z, w]) = (self.0, q.0);
        Quaternion([
            d * x + a * w + b * z - c * y,
            d * y - a * z + b * w + c * x,
            d * z + a * y - b * x + c * w,
            d * w - a * x - b * y - c * z,
        ])
    }
    /// The inverse of a unit quaternion.
    pub fn conjugate(self) -> Self {
        let [x, y, z, w] = self.0;
        Quaternion([-x, -y, -z, w])
    }
    /// Divided by its length.
    pub fn normalized(self) -> Self {
        let [x, y, z, w] = self.0;
        let s = (x * x + y * y + z * z + w * w).sqrt().recip();
        Quaternion([x * s, y * s, z * s, w * s])
    }
}

impl<T: Real> Quaternion<T> {
    /// From roll, pitch, yaw (URDF: rotations about fixed x, then y, then z), rad.
    pub fn from_roll_pitch_yaw(roll: T, pitch: T, yaw: T) -> Self {
        let half = T::splat(0.5);
        let about = |axis: usize, angle: T| {
            let (s, c) = (angle * half).sin_cos();
            let mut q = Self::identity();
            q.0[axis] = s;
            q.0[3] = c;
            q
        };
        about(2, yaw).compose(about(1, pitch)).compose(about(0, roll))
    }
    /// From a rotation matrix, by the largest component (well conditioned for every rotation).
    pub fn from_rotation(r: &Mat3<T>) -> Self {
        let m = &r.0;
        let one = T::one();
        let squares = [
            one + m[0][0] - m[1][1] - m[2][2],
            one - m[0][0] + m[1][1] - m[2][2],
            one - m[0][0] - m[1][1] + m[2][2],
            one + m[0][0] + m[1][1] + m[2][2],
        ];
        let k = (0..4).fold(0, |best, i| if squares[i] > squares[best] { i } else { best });
        let (x, y, z) = (m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]);
        let (xy, xz, yz) = (m[0][1] + m[1][0], m[0][2] + m[2][0], m[1][2] + m[2][1]);
        let s = squares[k];
        Quaternion(match k {
            0 => [s, xy, xz, x],
            1 => [xy, s, yz, y],
            2 => [xz, yz, s, z],
            _ => [x, y, z, s],
        })
        .normalized()
    }
    /// exp: the rotation by |ω| about ω.
    pub fn exp(omega: Vec3<T>) -> Self {
        let half = T::splat(0.5);
        let theta2 = omega.dot(omega);
        // sin(θ/2)/θ; the series is exact to rounding of the widest scalar below 1e-8.
        let (s, c) = if theta2 < T::splat(1e-16) {
            (half - theta2 * T::splat(1.0) / T::splat(48.0), T::one() - theta2 * T::splat(0.125))
        } else {
            let theta = theta2.sqrt();
            let (s, c) = (theta * half).sin_cos();
            (s / theta, c)
        };
        let v = omega.scale(s);
        Quaternion([v.0[0], v.0[1], v.0[2], c]).normalized()
    }
    /// log: the rotation vector with |ω| ≤ π; either sign of the quaternion gives the same rotation.
    pub fn log(self) -> Vec3<T> {
        let [x, y, z, w] = self.0;
        let sign = if w < T::zero() { -T::one() } else { T::one() };
        let v = Vec3([x, y, z]).scale(sign);
        let s = v.norm();
        let two = T::splat(2.0);
        if s == T::zero() {
            return v.scale(two);
        }
        v.scale(two * s.atan2(w * sign) / s)
    }
}

/// exp of a twist: the pose reached by moving along the constant body twist x for unit time
/// (notes/integrators.md 1, `exp`).
pub fn exp_motion<T: Real>(x: Motion<T>) -> (Quaternion<T>, Vec3<T>) {
    let (w, v) = (x.angular, x.linear);
    let theta2 = w.dot(w);
    let (a, b) = angle_series(theta2);
    let wv = w.cross(v);
    (Quaternion::exp(w), v + wv.scale(a) + w.cross(wv).scale(b))
}

/// log of a pose: the body twist x with exp(x) = pose.
pub fn log_motion<T: Real>(rotation: Quaternion<T>, translation: Vec3<T>) -> Motion<T> {
    let w = rotation.log();
    let theta2 = w.dot(w);
    // V⁻¹ = 1 − ½ ω~ + c ω~², c = (1 − (θ/2) cot(θ/2))/θ².
    let c = if theta2 < T::splat(1e-4) {
        // 1/12 + θ²/720 + θ⁴/30240 + θ⁶/1209600 + θ⁸/47900160 + …
        let t = theta2;
        T::one() / T::splat(12.0)
            + t * (T::one() / T::splat(720.0)
                + t * (T::one() / T::splat(30240.0)
                    + t * (T::one() / T::splat(1209600.0)
                        + t * (T::one() / T::splat(47900160.0)
                            + t * T::splat(691.0) / T::splat(1307674368000.0)))))
    } else {
        let two = T::splat(2.0);
        let half_angle = theta2.sqrt() / two;
        let (s, cosine) = half_angle.sin_cos();
        (T::one() - half_angle * cosine / s) / theta2
    };
    let wp = w.cross(translation);
    Motion::new(w, translation - wp.scale(T::splat(0.5)) + w.cross(wp).scale(c))
}

/// (1 − cos θ)/θ² and (θ − sin θ)/θ³ from θ², by series where the closed forms cancel.
pub fn angle_series<T: Real>(theta2: T) -> (T, T) {
    if theta2 < T::splat(0.25) {
        // Alternating Taylor series; 14 terms leave less than 1e-33 at θ = ½.
        let (mut a, mut b) = (T::zero(), T::zero());
        for k in (0..14).rev() {
            let k2 = 2.0 * k as f64;
            a = (T::one() - theta2 * a) / T::splat((k2 + 1.0) * (k2 + 2.0));
            b = (T::one() - theta2 * b) / T::splat((k2 + 2.0) * (k2 + 3.0));
        }
        (a, b)
    } else {
        let theta = theta2.sqrt();
        let (s, c) = theta.sin_cos();
        ((T::one() - c) / theta2, (theta - s) / (theta2 * theta))
    }
}

/// The pose of a quaternion and a position.
pub fn pose<T: Scalar>(rotation: Quaternion<T>, translation: Vec3<T>) -> Transform<T> {
    Transform::new(rotation.to_rotation(), translation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Dd;

    fn twist(scale: f64) -> Motion<Dd> {
        let v = [0.3, -0.5, 0.7, 1.1, 0.2, -0.9].map(|x| Dd::from_f64(x) * Dd::from_f64(scale));
        Motion::from_array(v)
    }

    #[test]
    fn log_inverts_exp_at_every_angle() {
        for scale in [1e-12, 1e-6, 1e-3, 0.0109, 0.1, 0.5, 1.0, 3.0] {
            let x = twist(scale);
            let (q, t) = exp_motion(x);
            let y = log_motion(q, t);
            for i in 0..6 {
                // The closed form of c cancels down to ε/θ² relative, ε absolute after its factor θ².
                let error = (x.get(i) - y.get(i)).to_f64().abs();
                assert!(error < 200.0 * Dd::EPSILON * (scale + 1e-3), "scale {scale}: {error:e}");
            }
        }
    }

    #[test]
    fn exponentials_of_parallel_twists_add() {
        let (p, s) = exp_motion(twist(0.5));
        let (q, t) = exp_motion(twist(0.75));
        let sum = pose(p, s).compose(&pose(q, t));
        let (r, u) = exp_motion(twist(1.25));
        let error = (sum.translation - u).norm().to_f64();
        assert!(error < 100.0 * Dd::EPSILON, "{error:e}");
        let back = Quaternion::from_rotation(&sum.rotation).conjugate().compose(r).log();
        assert!(back.norm().to_f64() < 100.0 * Dd::EPSILON);
    }

    #[test]
    fn roll_pitch_yaw_is_yaw_after_pitch_after_roll() {
        let r = Quaternion::from_roll_pitch_yaw(0.1, 0.2, 0.3).to_rotation();
        // Third row of Rz(y) Ry(p) Rx(r): (−sin p, cos p sin r, cos p cos r).
        let want = [-0.2f64.sin(), 0.2f64.cos() * 0.1f64.sin(), 0.2f64.cos() * 0.1f64.cos()];
        for j in 0..3 {
            assert!((r.0[2][j] - want[j]).abs() < 4.0 * f64::EPSILON);
        }
    }
}
