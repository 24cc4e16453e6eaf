//! Poses, velocities and accelerations: derivatives of poses that are functions of time.

use crate::jet::Jet;
use phipsi_model::{JointKind, Model, Node};
use phipsi_spatial::{Mat3, Motion, Real, Transform, Vec3};

/// How a body is placed and moves; world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyMotion<T> {
    /// Pose in the world.
    pub pose: Transform<T>,
    /// (ω, velocity of the origin).
    pub velocity: Motion<T>,
    /// (ω̇, acceleration of the origin).
    pub acceleration: Motion<T>,
}

impl<T: Real> BodyMotion<T> {
    /// The inertial frame.
    pub fn world() -> Self {
        BodyMotion { pose: Transform::identity(), velocity: Motion::zero(), acceleration: Motion::zero() }
    }
    /// Acceleration of the body's point at the world position x.
    pub fn acceleration_at(&self, x: Vec3<T>) -> Vec3<T> {
        let (w, r) = (self.velocity.angular, x - self.pose.translation);
        self.acceleration.linear + self.acceleration.angular.cross(r) + w.cross(w.cross(r))
    }
    /// Velocity of the body's point at the world position x.
    pub fn velocity_at(&self, x: Vec3<T>) -> Vec3<T> {
        self.velocity.linear + self.velocity.angular.cross(x - self.pose.translation)
    }
}

/// Every body's motion for `q` (nq), velocities `v` and accelerations `a` (nv); no gravity. A flexible body's is that of its
/// floating frame.
pub fn kinematics<T: Real>(model: &Model, q: &[T], v: &[T], a: &[T]) -> Vec<BodyMotion<T>> {
    poses(model, q, v, a).iter().map(Pose::motion).collect()
}

/// Poses of all bodies as functions of time.
pub(crate) fn poses<T: Real>(model: &Model, q: &[T], v: &[T], a: &[T]) -> Vec<Pose<T>> {
    let mut poses: Vec<Pose<T>> = Vec::with_capacity(model.len());
    for k in 0..model.len() {
        let joint = &model.joints()[k];
        let (qs, vs) = (model.q_range(k), model.v_range(k));
        let moved = joint_pose(&joint.kind, &q[qs], &v[vs.clone()], &a[vs]);
        let placed = Pose {
            rotation: quaternion_rotation(joint.placement.rotation.map(|x| Jet::constant(T::splat(x)))),
            origin: joint.placement.translation.map(|x| Jet::constant(T::splat(x))),
        };
        let mut inner = placed.compose(&moved);
        if let (Some(node), Some(p)) = (model.attachment(k), model.tree().parent(k)) {
            inner = node_pose(node, &modal_coordinates(model, p, q, v, a)).compose(&inner);
        }
        let held = model.bodies()[k].flexible.as_ref().and_then(|b| Some(&b.nodes[b.inboard_node()?]));
        if let Some(node) = held {
            inner = inner.compose(&node_pose(node, &modal_coordinates(model, k, q, v, a)).inverse());
        }
        poses.push(match model.tree().parent(k) {
            Some(p) => poses[p].compose(&inner),
            None => inner,
        });
    }
    poses
}

/// η of a body as functions of time.
pub(crate) fn modal_coordinates<T: Real>(model: &Model, k: usize, q: &[T], v: &[T], a: &[T]) -> Vec<Jet<T>> {
    let rates = model.mode_v_range(k).map(|i| (v[i], a[i]));
    q[model.mode_q_range(k)].iter().zip(rates).map(|(q, (v, a))| Jet::new(*q, v, a)).collect()
}

/// Σ x_l of vectors ψ_l.
pub(crate) fn combination<T: Real>(vectors: &[[f64; 3]], x: &[Jet<T>]) -> [Jet<T>; 3] {
    let zero = Jet::constant(T::zero());
    [0, 1, 2].map(|i| vectors.iter().zip(x).fold(zero, |sum, (psi, x)| sum + x.scale(T::splat(psi[i]))))
}

/// Pose of a node in its body's floating frame: the rotation is the power series of exp(θ~).
pub(crate) fn node_pose<T: Real>(node: &Node, eta: &[Jet<T>]) -> Pose<T> {
    let n = eta.len();
    let mut origin = combination(&node.displacement, eta);
    if let Some(quadratic) = &node.quadratic {
        let pairs: Vec<Jet<T>> = (0..n * n).map(|x| (eta[x / n] * eta[x % n]).scale(T::splat(0.5))).collect();
        let second = combination(quadratic, &pairs);
        origin = [0, 1, 2].map(|i| origin[i] + second[i]);
    }
    let origin = [0, 1, 2].map(|i| origin[i] + Jet::constant(T::splat(node.position[i])));
    let zero = Jet::constant(T::zero());
    let [x, y, z] = combination(&node.rotation, eta);
    let theta = [[zero, zero - z, y], [z, zero, zero - x], [zero - y, x, zero]];
    let mut power = constant_matrix(&Mat3::identity());
    let mut rotation = power;
    for k in 1..50 {
        let scale = T::splat(f64::from(k)).recip();
        power = product(&power, &theta).map(|row| row.map(|x| x.scale(scale)));
        rotation = [0, 1, 2].map(|i| [0, 1, 2].map(|j| rotation[i][j] + power[i][j]));
    }
    Pose { rotation, origin }
}

/// A pose that changes with time.
#[derive(Clone, Copy)]
pub(crate) struct Pose<T> {
    rotation: Matrix<T>,
    pub(crate) origin: [Jet<T>; 3],
}

type Matrix<T> = [[Jet<T>; 3]; 3];

impl<T: Real> Pose<T> {
    fn compose(&self, inner: &Self) -> Self {
        Pose { rotation: product(&self.rotation, &inner.rotation), origin: self.point(&inner.origin) }
    }
    fn inverse(&self) -> Self {
        let zero = Jet::constant(T::zero());
        let rotation = [0, 1, 2].map(|i| [0, 1, 2].map(|j| self.rotation[j][i]));
        let origin = turn(&rotation, &self.origin).map(|x| zero - x);
        Pose { rotation, origin }
    }
    /// A point of the frame in the world.
    pub(crate) fn point(&self, x: &[Jet<T>; 3]) -> [Jet<T>; 3] {
        let turned = turn(&self.rotation, x);
        [0, 1, 2].map(|i| self.origin[i] + turned[i])
    }

    /// ω~ = Ṙ Rᵀ and its derivative R̈ Rᵀ + Ṙ Ṙᵀ.
    pub(crate) fn motion(&self) -> BodyMotion<T> {
        let entries = |f: fn(&Jet<T>) -> T| Mat3(self.rotation.map(|row| row.map(|x| f(&x))));
        let (r, rate, second) = (entries(|x| x.value), entries(|x| x.rate), entries(|x| x.second));
        let omega = rate * r.transpose();
        let omega_rate = second * r.transpose() + rate * rate.transpose();
        BodyMotion {
            pose: Transform::new(r, Vec3(self.origin.map(|x| x.value))),
            velocity: Motion::new(vector_of_skew(&omega), Vec3(self.origin.map(|x| x.rate))),
            acceleration: Motion::new(vector_of_skew(&omega_rate), Vec3(self.origin.map(|x| x.second))),
        }
    }
}

fn vector_of_skew<T: Real>(m: &Mat3<T>) -> Vec3<T> {
    let half = T::splat(0.5);
    let m = &m.0;
    Vec3([(m[2][1] - m[1][2]) * half, (m[0][2] - m[2][0]) * half, (m[1][0] - m[0][1]) * half])
}

fn product<T: Real>(a: &Matrix<T>, b: &Matrix<T>) -> Matrix<T> {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j]))
}

fn turn<T: Real>(a: &Matrix<T>, x: &[Jet<T>; 3]) -> [Jet<T>; 3] {
    [0, 1, 2].map(|i| a[i][0] * x[0] + a[i][1] * x[1] + a[i][2] * x[2])
}

fn constant_matrix<T: Real>(m: &Mat3<T>) -> Matrix<T> {
    m.0.map(|row| row.map(Jet::constant))
}

/// Rodrigues: 1 + sin θ K + (1 − cos θ) K², K the cross product with the unit axis.
fn rotation_about<T: Real>(axis: Vec3<T>, angle: Jet<T>) -> Matrix<T> {
    let (s, c) = angle.sin_cos();
    let one = Jet::constant(T::one());
    let k = Mat3::skew(axis);
    let square = k * k;
    let mut r = constant_matrix(&Mat3::identity());
    for i in 0..3 {
        for j in 0..3 {
            r[i][j] = r[i][j] + s.scale(k.0[i][j]) + (one - c).scale(square.0[i][j]);
        }
    }
    r
}

/// x ↦ q x q⁻¹ for a quaternion (x, y, z, w) of any constant length: (w² − u·u) 1 + 2 u uᵀ + 2 w u~, over |q|².
fn quaternion_rotation<T: Real>(q: [Jet<T>; 4]) -> Matrix<T> {
    let [x, y, z, w] = q;
    let u = [x, y, z];
    let uu = x * x + y * y + z * z;
    let scale = (w * w + uu).value.recip();
    let zero = Jet::constant(T::zero());
    let cross = [[zero, zero - z, y], [z, zero, zero - x], [zero - y, x, zero]];
    let two = T::splat(2.0);
    [0, 1, 2].map(|i| {
        [0, 1, 2].map(|j| {
            let off = (u[i] * u[j] + w * cross[i][j]).scale(two);
            let sum = if i == j { w * w - uu + off } else { off };
            sum.scale(scale)
        })
    })
}

/// The unit vector along an axis as the user gave it.
pub(crate) fn unit<T: Real>(axis: [f64; 3]) -> Vec3<T> {
    let a = Vec3::<T>::splat(axis);
    a.scale(a.norm().recip())
}

/// Axes of a planar joint's plane: the shortest rotation that takes z to the normal, 1 + K + K²/(1 + n·z) with K the
/// cross product with z × n.
pub(crate) fn plane_axes<T: Real>(normal: [f64; 3]) -> Mat3<T> {
    let n = unit::<T>(normal);
    let k = Mat3::skew(Vec3::unit(2).cross(n));
    if k == Mat3::skew(Vec3::zero()) && n.0[2] < T::zero() {
        // No shortest rotation: half a turn about x.
        let one = T::one();
        return Mat3::from_columns(Vec3::unit(0), Vec3::unit(1).scale(-one), Vec3::unit(2).scale(-one));
    }
    Mat3::identity() + k + (k * k).scale((T::one() + n.0[2]).recip())
}

/// q∘(x, 0): the quaternion product with a vector.
fn times_vector<T: Real>(q: [T; 4], x: [T; 3]) -> [T; 4] {
    let ([a, b, c, d], [x, y, z]) = (q, x);
    [d * x + b * z - c * y, d * y - a * z + c * x, d * z + a * y - b * x, -(a * x + b * y + c * z)]
}

/// q with q̇ = ½ q∘ω and its derivative, for ω in body axes.
fn quaternion_motion<T: Real>(q: &[T], w: &[T], w_rate: &[T]) -> [Jet<T>; 4] {
    let half = T::splat(0.5);
    let q = [q[0], q[1], q[2], q[3]];
    let (w, w_rate) = ([w[0], w[1], w[2]], [w_rate[0], w_rate[1], w_rate[2]]);
    let rate = times_vector(q, w).map(|x| x * half);
    let (first, last) = (times_vector(rate, w), times_vector(q, w_rate));
    [0, 1, 2, 3].map(|i| Jet::new(q[i], rate[i], (first[i] + last[i]) * half))
}

/// Pose of the child in the joint frame, from the joint's definition.
fn joint_pose<T: Real>(kind: &JointKind, q: &[T], v: &[T], a: &[T]) -> Pose<T> {
    let zero = Jet::constant(T::zero());
    let identity = constant_matrix(&Mat3::identity());
    let coordinate = |i: usize| Jet::new(q[i], v[i], a[i]);
    let along = |axis: Vec3<T>, d: Jet<T>| axis.0.map(|x| d.scale(x));
    let (rotation, origin) = match *kind {
        JointKind::Revolute { axis } | JointKind::Continuous { axis } => {
            (rotation_about(unit(axis), coordinate(0)), [zero; 3])
        }
        JointKind::Prismatic { axis } => (identity, along(unit(axis), coordinate(0))),
        JointKind::Helical { axis, pitch } => (
            rotation_about(unit(axis), coordinate(0)),
            along(unit(axis), coordinate(0).scale(T::splat(pitch))),
        ),
        JointKind::Cylindrical { axis } => {
            (rotation_about(unit(axis), coordinate(0)), along(unit(axis), coordinate(1)))
        }
        JointKind::Universal { axes: [first, second] } => (
            product(
                &rotation_about(unit(first), coordinate(0)),
                &rotation_about(unit(second), coordinate(1)),
            ),
            [zero; 3],
        ),
        JointKind::Planar { normal } => {
            // The velocity (ẋ, ẏ) in the plane is the velocity in child axes turned by the angle.
            let angle = Jet::new(q[2], v[0], a[0]);
            let (s, c) = q[2].sin_cos();
            let (vx, vy) = (c * v[1] - s * v[2], s * v[1] + c * v[2]);
            let (ax, ay) = (c * a[1] - s * a[2] - v[0] * vy, s * a[1] + c * a[2] + v[0] * vx);
            let in_plane = [Jet::new(q[0], vx, ax), Jet::new(q[1], vy, ay), zero];
            (rotation_about(unit(normal), angle), turn(&constant_matrix(&plane_axes(normal)), &in_plane))
        }
        JointKind::Translation => (identity, [0, 1, 2].map(coordinate)),
        JointKind::Spherical => (quaternion_rotation(quaternion_motion(q, v, a)), [zero; 3]),
        JointKind::Free => {
            // ṗ = R v and its derivative R (v̇ + ω × v).
            let rotation = quaternion_rotation(quaternion_motion(&q[3..], &v[..3], &a[..3]));
            let r = Mat3(rotation.map(|row| row.map(|x| x.value)));
            let vector = |x: &[T]| Vec3([x[0], x[1], x[2]]);
            let velocity = vector(&v[3..]);
            let rate = r * velocity;
            let second = r * (vector(&a[3..]) + vector(v).cross(velocity));
            (rotation, [0, 1, 2].map(|i| Jet::new(q[i], rate.0[i], second.0[i])))
        }
        _ => (identity, [zero; 3]),
    };
    Pose { rotation, origin }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::case;
    use crate::jacobian::{bias_acceleration, jacobian};
    use crate::sensitivity::widened;
    use phipsi_spatial::{Dd, Scalar};

    /// The two descriptions of a joint, by its pose and by its axes, belong together: V = J v, A = J a + J̇ v.
    #[test]
    fn derivatives_of_poses_are_sums_over_axes() {
        for seed in 0..200 {
            let case = case(seed);
            let (q, v, a) = (widened(&case.q), widened(&case.v), widened(&case.a));
            let motions = kinematics(&case.model, &q, &v, &a);
            let zero = vec![Dd::from_f64(0.0); v.len()];
            for k in 0..case.model.len() {
                let j = jacobian(&case.model, &q, Some(k), None);
                let bias = bias_acceleration(&case.model, &q, &v, Some(k)).to_array();
                let without_v = kinematics(&case.model, &q, &zero, &a)[k].acceleration.to_array();
                let (velocity, acceleration) =
                    (motions[k].velocity.to_array(), motions[k].acceleration.to_array());
                for row in 0..6 {
                    let (mut jv, mut ja, mut size) = (zero_of(), zero_of(), 1e-30);
                    for i in 0..v.len() {
                        jv += j[(row, i)] * v[i];
                        ja += j[(row, i)] * a[i];
                        size += (j[(row, i)].abs().hi + 1.0) * (v[i].abs().hi + a[i].abs().hi);
                    }
                    size += bias[row].abs().hi;
                    // Rotations and lengths along a path of n bodies are rounded once per body.
                    let budget = 100.0 * case.model.len() as f64 * Dd::EPSILON * size * (1.0 + size);
                    for (what, error) in [
                        ("J v", jv - velocity[row]),
                        ("J a", ja - without_v[row]),
                        ("J a + J̇ v", ja + bias[row] - acceleration[row]),
                    ] {
                        assert!(error.hi.abs() <= budget, "seed {seed}, body {k}, {what}[{row}]: {error:?}");
                    }
                }
            }
        }
    }

    fn zero_of() -> Dd {
        Dd::from_f64(0.0)
    }

    /// The poses' derivatives against differences of poses along `Model::integrate`, which has its own exponentials.
    #[test]
    fn velocities_are_those_of_integrate() {
        let step = Dd::from_f64(1e-9);
        for seed in 0..200 {
            let case = case(seed);
            let (q, v) = (widened(&case.q), widened(&case.v));
            let mut unit = q.clone();
            case.model.normalize(&mut unit);
            let zero = vec![Dd::from_f64(0.0); v.len()];
            let motions = kinematics(&case.model, &unit, &v, &zero);
            let moved = |sign: f64| {
                let x: Vec<Dd> = v.iter().map(|v| *v * step * Dd::from_f64(sign)).collect();
                kinematics(&case.model, &case.model.integrate(&unit, &x), &zero, &zero)
            };
            let (after, before) = (moved(1.0), moved(-1.0));
            let speed: f64 = 1.0 + v.iter().map(|v| v.abs().hi).sum::<f64>();
            for k in 0..case.model.len() {
                let difference =
                    (after[k].pose.translation - before[k].pose.translation).scale((step + step).recip());
                let error = (difference - motions[k].velocity.linear).norm().hi;
                // Third derivative of the path: speed³ times its size, 100 m.
                assert!(error < 1e-18 * 100.0 * speed * speed * speed, "seed {seed}, body {k}: {error:e}");
            }
        }
    }
}
