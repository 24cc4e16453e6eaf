//! The constant rows of a rigid body: a factor of its inertia that exists for points, rods and bodies without mass.
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | m, c | mass, centre of mass | kg, m |
//! | λ_i, e_i | principal moments about c, their axes | kg·m² |
//! | rows | √λ_i (e_i, 0) and √m (c × e_j, e_j): the squares add up to M | |
//!
//! Built once, in double-double numbers from the user's own numbers, so that a moment of 1e-16 of the others keeps its digits.

use super::rows::Row;
use crate::layout::Layout;
use phipsi_model::{Inertia, Model};
use phipsi_spatial::{Dd, Mat3, Quaternion, Real, Scalar, Sym3, Transform, Vec3, Wrench};

/// What a body puts under the sum of squares.
#[derive(Clone, Debug)]
pub struct BodyRows<T> {
    axes: [Vec3<T>; 3],
    /// √λ.
    roots: [T; 3],
    /// λ_k − λ_j of the other two axes in cyclic order, over √λ_i where that is not zero.
    gyroscopic: [T; 3],
    mass_root: T,
    center: Vec3<T>,
    /// |what adds up to c|: c itself may be the rounding of that.
    reach: T,
}

impl<T: Real> BodyRows<T> {
    /// For every body of a layout of the model.
    pub fn of_layout(model: &Model, layout: &Layout<T>) -> Vec<Self> {
        let mut parts: Vec<Vec<(usize, Transform<Dd>)>> = vec![Vec::new(); layout.len()];
        for (k, carrier) in layout.carriers().iter().enumerate() {
            if let Some(parts) = parts.get_mut(carrier.body)
                && !model.bodies()[k].inertia.is_zero()
            {
                parts.push((k, wide_transform(&carrier.pose)));
            }
        }
        parts.iter().map(|parts| Self::of_parts(model, parts)).collect()
    }

    fn of_parts(model: &Model, parts: &[(usize, Transform<Dd>)]) -> Self {
        let of = |k: usize| -> &Inertia { &model.bodies()[k].inertia };
        let mut mass = Dd::splat(0.0);
        let (mut moment, mut reach) = (Vec3::<Dd>::zero(), 0.0f64);
        for (k, pose) in parts {
            let (m, own) = (Dd::from_f64(of(*k).mass), Vec3::splat(of(*k).frame.translation));
            mass += m;
            moment += pose.point(own).scale(m);
            reach = reach.max(pose.translation.norm().hi + own.norm().hi);
        }
        let massive = mass.is_positive();
        let center = if massive { moment.scale(mass.recip()) } else { Vec3::zero() };
        let (mut tensor, mut turn) = (Sym3::<Dd>::zero(), Mat3::<Dd>::identity());
        for (k, pose) in parts {
            let inertia = of(*k);
            let [xx, xy, xz, yy, yz, zz] = inertia.tensor.map(Dd::from_f64);
            let own = Sym3 { xx, xy, xz, yy, yz, zz };
            let axes = pose.rotation * Quaternion(inertia.frame.rotation.map(Dd::from_f64)).to_rotation();
            if parts.len() == 1 {
                // Its own axes: a turned tensor would mix the moments' digits.
                (tensor, turn) = (own, axes);
            } else {
                let lever = pose.point(Vec3::splat(inertia.frame.translation)) - center;
                tensor = tensor + own.rotate(&axes) + Sym3::point_mass(Dd::from_f64(inertia.mass), lever);
            }
        }
        let (moments, axes) = principal(&tensor, &turn);
        let moments = moments.map(|x| if x.is_positive() { x } else { Dd::from_f64(0.0) });
        let roots = moments.map(|x| x.sqrt());
        let gyroscopic = [0, 1, 2].map(|i| {
            let difference = moments[(i + 2) % 3] - moments[(i + 1) % 3];
            if roots[i].is_positive() { difference / roots[i] } else { difference }
        });
        BodyRows {
            axes: axes.map(narrow_vector),
            roots: roots.map(narrow),
            gyroscopic: gyroscopic.map(narrow),
            mass_root: if massive { narrow(mass.sqrt()) } else { T::zero() },
            center: narrow_vector(center),
            reach: T::splat(reach),
        }
    }

    /// Calls `push` with every row, at angular velocity `omega` and under the opposite `load` of an external wrench, both in
    /// the body's frame; returns the part of gyroscopic and external forces that no row can carry, for want of inertia.
    #[inline(always)]
    pub fn rows(&self, omega: Vec3<T>, load: Wrench<T>, mut push: impl FnMut(Row<T>)) -> Wrench<T> {
        let o = T::zero();
        let moment = load.moment - self.center.cross(load.force);
        let spin = self.axes.map(|e| e.dot(omega));
        let mut left = Wrench::zero();
        for i in 0..3 {
            let (e, root) = (self.axes[i], self.roots[i]);
            let own = self.gyroscopic[i] * spin[(i + 1) % 3] * spin[(i + 2) % 3];
            let external = e.dot(moment);
            if root > o {
                let [x, y, z] = e.scale(root).0;
                push([x, y, z, o, o, o, own + external / root, root, o]);
            } else {
                left.moment += e.scale(own + external);
            }
        }
        let root = self.mass_root;
        if root > o {
            let centrifugal = omega.cross(omega.cross(self.center)).scale(root);
            let [x, y, z] = self.center.scale(root).0;
            let [a, b, c] = (centrifugal + load.force.scale(root.recip())).0;
            let terms = self.reach * root;
            push([o, z, -y, root, o, o, a, terms, root]);
            push([-z, o, x, o, root, o, b, terms, root]);
            push([y, -x, o, o, o, root, c, terms, root]);
        } else {
            left.force = load.force;
        }
        left
    }
}

/// Principal moments and axes of a tensor given in `turn`ed axes, by cyclic Jacobi rotations: small moments keep their digits,
/// which a tridiagonal method's do not.
fn principal<T: Real>(tensor: &Sym3<T>, turn: &Mat3<T>) -> ([T; 3], [Vec3<T>; 3]) {
    let mut a = tensor.to_mat3().0;
    let mut axes = [turn.column(0), turn.column(1), turn.column(2)];
    // Convergence is quadratic; a dozen sweeps are never used up.
    for _ in 0..12 {
        let mut done = true;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = a[p][q];
            let tiny = T::splat(T::EPSILON * T::EPSILON) * (a[p][p] * a[q][q]).abs();
            if off == T::zero() || off * off <= tiny {
                continue;
            }
            done = false;
            let theta = (a[q][q] - a[p][p]) / (off + off);
            let t = {
                let t = (theta.abs() + (theta * theta + T::one()).sqrt()).recip();
                if theta < T::zero() { -t } else { t }
            };
            let c = (t * t + T::one()).sqrt().recip();
            let s = t * c;
            let r = 3 - p - q;
            a[p][p] -= t * off;
            a[q][q] += t * off;
            (a[p][q], a[q][p]) = (T::zero(), T::zero());
            let (x, y) = (a[p][r], a[q][r]);
            a[p][r] = c * x - s * y;
            a[q][r] = s * x + c * y;
            (a[r][p], a[r][q]) = (a[p][r], a[q][r]);
            let (x, y) = (axes[p], axes[q]);
            axes[p] = x.scale(c) - y.scale(s);
            axes[q] = x.scale(s) + y.scale(c);
        }
        if done {
            break;
        }
    }
    ([a[0][0], a[1][1], a[2][2]], axes)
}

fn wide<T: Real>(x: T) -> Dd {
    let high = x.to_f64();
    Dd::from_f64(high) + Dd::from_f64((x - T::splat(high)).to_f64())
}

fn narrow<T: Real>(x: Dd) -> T {
    T::splat(x.hi) + T::splat(x.lo)
}

fn narrow_vector<T: Real>(x: Vec3<Dd>) -> Vec3<T> {
    Vec3(x.0.map(narrow))
}

fn wide_transform<T: Real>(x: &Transform<T>) -> Transform<Dd> {
    Transform::new(Mat3(x.rotation.0.map(|row| row.map(wide))), Vec3(x.translation.0.map(wide)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moments over fourteen decades, in any axes, come back to the digits of an f64 and more.
    #[test]
    fn principal_moments_keep_their_digits() {
        let r = Quaternion([0.3, -0.5, 0.1, 0.7].map(Dd::from_f64)).to_rotation();
        let moments = [1.0, 1e-7, 1e-14].map(Dd::from_f64);
        let tensor = Sym3 { xx: moments[0], yy: moments[1], zz: moments[2], ..Sym3::zero() }.rotate(&r);
        let (found, axes) = principal(&tensor, &Mat3::identity());
        for (x, e) in found.into_iter().zip(axes) {
            let k = (0..3).find(|&k| r.column(k).dot(e).abs() > Dd::from_f64(0.5)).expect("an axis");
            assert!(((x - moments[k]) / moments[k]).hi.abs() < 1e-15, "{x:?}");
            assert!((r.column(k).dot(e).abs() - Dd::from_f64(1.0)).hi.abs() < 1e-30);
        }
    }
}
