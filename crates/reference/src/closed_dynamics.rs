//! Closed loops by the dense equations M a + c = τ + Jᵀ λ, J a + J̇ v = γ̈.
//!
//! Rows are scalar functions of the frames' world axes and points, differentiated by time; J is their rates at unit velocities.
//! M = L D Lᵀ, and a pivoted Gram–Schmidt orthogonalisation of D^−½ L⁻¹ Jᵀ finds the rank.

use crate::dense::{Factors, NotPositive, tips_first};
use crate::inverse_dynamics::inverse_dynamics;
use crate::kinematics::{BodyMotion, kinematics};
use crate::mass_matrix::mass_matrix;
use nalgebra::DMatrix;
use phipsi_model::{ClosureKind, Model, Placement};
use phipsi_spatial::{Mat3, Quaternion, Real, Vec3, Wrench};

/// A frame that moves; world axes.
struct Frame<T> {
    axes: Mat3<T>,
    point: Vec3<T>,
    speed: Vec3<T>,
    rate: Vec3<T>,
    omega: Vec3<T>,
    omega_rate: Vec3<T>,
}

impl<T: Real> Frame<T> {
    fn new(motion: &BodyMotion<T>, placement: &Placement) -> Self {
        let axes = motion.pose.rotation * Quaternion(placement.rotation.map(T::splat)).to_rotation();
        let point = motion.pose.point(Vec3::splat(placement.translation));
        Frame {
            axes,
            point,
            speed: motion.velocity_at(point),
            rate: motion.acceleration_at(point),
            omega: motion.velocity.angular,
            omega_rate: motion.acceleration.angular,
        }
    }
    /// An axis with its first two derivatives.
    fn axis(&self, i: usize) -> [Vec3<T>; 3] {
        let e = self.axes.column(i);
        let first = self.omega.cross(e);
        [e, first, self.omega_rate.cross(e) + self.omega.cross(first)]
    }
}

/// Value, rate and second derivative of a product of two vectors.
fn product<T: Real>(a: [Vec3<T>; 3], b: [Vec3<T>; 3]) -> [T; 3] {
    let cross = a[1].dot(b[1]);
    [a[0].dot(b[0]), a[1].dot(b[0]) + a[0].dot(b[1]), a[2].dot(b[0]) + cross + cross + a[0].dot(b[2])]
}

/// Rate and its derivative of every row of every closure and coupling at (q, v, a).
pub fn closure_rates<T: Real>(model: &Model, q: &[T], v: &[T], a: &[T]) -> Vec<[T; 2]> {
    let motions = kinematics(model, q, v, a);
    let motion = |body: &str| match model.find_body(body).expect("a body") {
        Some(k) => motions[k],
        None => BodyMotion::world(),
    };
    let mut all = Vec::new();
    for closure in model.closures() {
        let from = Frame::new(&motion(&closure.body_a), &closure.pose_a);
        let to = Frame::new(&motion(&closure.body_b), &closure.pose_b);
        let offset = [to.point - from.point, to.speed - from.speed, to.rate - from.rate];
        let relative = [to.omega - from.omega, to.omega_rate - from.omega_rate];
        let turn = |i: usize| {
            let [e, rate, _] = from.axis(i);
            [e.dot(relative[0]), rate.dot(relative[0]) + e.dot(relative[1])]
        };
        let slide = |i: usize| {
            let [_, rate, second] = product(from.axis(i), offset);
            [rate, second]
        };
        let (turns, slides): (&[usize], &[usize]) = match closure.kind {
            ClosureKind::Weld => (&[0, 1, 2], &[0, 1, 2]),
            ClosureKind::Revolute => (&[0, 1], &[0, 1, 2]),
            ClosureKind::Spherical | ClosureKind::Universal => (&[], &[0, 1, 2]),
            ClosureKind::Cylindrical => (&[0, 1], &[0, 1]),
            ClosureKind::Prismatic => (&[0, 1, 2], &[0, 1]),
            ClosureKind::Planar => (&[0, 1], &[2]),
            ClosureKind::PointOnPlane => (&[], &[2]),
            _ => (&[], &[]),
        };
        if closure.kind == ClosureKind::Universal {
            let [_, rate, second] = product(from.axis(0), to.axis(1));
            all.push([rate, second]);
        }
        if let ClosureKind::Distance { .. } = closure.kind {
            let [square, rate, second] = product(offset, offset);
            let (length, half) = (square.sqrt(), T::splat(0.5));
            let speed = rate * half / length;
            all.push([speed, (second * half - speed * speed) / length]);
        }
        all.extend(turns.iter().map(|&i| turn(i)));
        all.extend(slides.iter().map(|&i| slide(i)));
    }
    for coupling in model.couplings() {
        let at = |name: &str| model.v_offset(model.find_joint(name).expect("a joint"));
        let (i, j) = (at(&coupling.joint), at(&coupling.source));
        let m = T::splat(coupling.multiplier);
        all.push([v[i] - m * v[j], a[i] - m * a[j]]);
    }
    all
}

/// For every row, whether it is an angle.
pub fn angular_rows(model: &Model) -> Vec<bool> {
    let closures =
        model.closures().iter().flat_map(|c| (0..c.kind.rows()).map(|i| i < c.kind.angular_rows()));
    let couplings = model.couplings().iter().map(|c| {
        let k = model.find_joint(&c.joint).expect("a joint");
        model.joints()[k].kind.is_rotation(0)
    });
    closures.chain(couplings).collect()
}

/// J, rows×nv.
pub fn closure_jacobian<T: Real>(model: &Model, q: &[T]) -> DMatrix<T> {
    let zero = vec![T::zero(); model.nv()];
    let rows = angular_rows(model).len();
    let mut jacobian = DMatrix::from_element(rows, model.nv(), T::zero());
    for i in 0..model.nv() {
        let mut v = zero.clone();
        v[i] = T::one();
        for (row, [rate, _]) in closure_rates(model, q, &v, &zero).into_iter().enumerate() {
            jacobian[(row, i)] = rate;
        }
    }
    jacobian
}

/// What is given to [`closed_dynamics`] besides q, v and τ.
#[derive(Clone, Debug)]
pub struct Given<'a, T> {
    /// One wrench per body.
    pub wrenches: Option<&'a [Wrench<T>]>,
    /// γ̈ of every row.
    pub gamma: Vec<T>,
    /// Degrees of freedom with given accelerations.
    pub active: Vec<bool>,
    /// Those accelerations; others are not read.
    pub acceleration: Vec<T>,
    /// What angular rows are multiplied with, m.
    pub length: f64,
    /// Pivots below this part of the largest column are zero.
    pub tolerance: f64,
}

/// A solution.
#[derive(Clone, Debug)]
pub struct ClosedSolution<T> {
    /// Accelerations.
    pub acceleration: Vec<T>,
    /// λ of least norm, moments counted divided by the length.
    pub multipliers: Vec<T>,
    /// Jᵀ λ.
    pub force: Vec<T>,
    /// τ, with what the prescribed degrees of freedom need.
    pub tau: Vec<T>,
    /// Independent rows on the degrees of freedom that are not prescribed.
    pub rank: usize,
    /// Smallest pivot kept and largest dropped, of the largest column.
    pub pivots: [f64; 2],
}

/// The equations of motion of an open tree at a state.
pub struct OpenTree<'a, T> {
    /// M.
    pub matrix: DMatrix<T>,
    /// Degrees of freedom in the order in which they are eliminated.
    pub order: Vec<usize>,
    /// Generalised forces at accelerations, with the velocities and wrenches of the state.
    pub inverse: &'a dyn Fn(&[T]) -> Vec<T>,
}

/// Accelerations of a mechanism with loops, of any rank, with any degrees of freedom prescribed.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite on the others.
pub fn closed_dynamics<T: Real>(
    model: &Model,
    q: &[T],
    v: &[T],
    tau: &[T],
    given: &Given<'_, T>,
) -> Result<ClosedSolution<T>, NotPositive> {
    let inverse = |a: &[T]| inverse_dynamics(model, q, v, a, given.wrenches);
    let open = OpenTree { matrix: mass_matrix(model, q), order: tips_first(model), inverse: &inverse };
    closed_tree(model, open, (q, v, tau), given)
}

/// The same for any tree whose equations are given.
///
/// # Errors
/// As [`closed_dynamics`].
pub fn closed_tree<T: Real>(
    model: &Model,
    open: OpenTree<'_, T>,
    (q, v, tau): (&[T], &[T], &[T]),
    given: &Given<'_, T>,
) -> Result<ClosedSolution<T>, NotPositive> {
    let OpenTree { matrix, order, inverse } = open;
    let n = model.nv();
    let o = T::zero();
    let known: Vec<T> = (0..n).map(|i| if given.active[i] { given.acceleration[i] } else { o }).collect();
    let bias = inverse(&known);
    let rates = closure_rates(model, q, v, &known);
    let weights: Vec<T> =
        angular_rows(model).iter().map(|&a| if a { T::splat(given.length) } else { T::one() }).collect();
    let m = weights.len();
    let jacobian = closure_jacobian(model, q);
    let normal = |order: Vec<usize>| -> Result<(Factors<T>, Vec<T>), NotPositive> {
        let factors = Factors::new(&matrix, order, 0.0)?;
        let roots = factors.pivots().into_iter().map(|d| if d == o { o } else { d.sqrt().recip() }).collect();
        Ok((factors, roots))
    };
    let passive: Vec<usize> = order.iter().copied().filter(|&i| !given.active[i]).collect();
    let (all, all_roots) = normal(order)?;
    let (factors, roots) = normal(passive)?;
    let scaled = |factors: &Factors<T>, roots: &[T], x: &[T]| -> Vec<T> {
        factors.innovations(x).into_iter().zip(roots).map(|(x, r)| x * *r).collect()
    };
    let row = |j: usize| -> Vec<T> { (0..n).map(|i| jacobian[(j, i)] * weights[j]).collect() };
    let columns: Vec<Vec<T>> = (0..m).map(|j| scaled(&factors, &roots, &row(j))).collect();
    // Where every row is rounding, as between bodies that no joint parts, so is the largest.
    let floor = all_roots.iter().fold(o, |most, x| most.larger(*x)) * T::splat(1e-15 * given.length);
    let largest = (0..m).fold(floor, |most, j| most.larger(norm(&scaled(&all, &all_roots, &row(j)))));
    let net: Vec<T> = (0..n).map(|i| tau[i] - bias[i]).collect();
    let free = scaled(&factors, &roots, &net);
    // Orthogonalised twice, the longest rest first.
    let (mut rest, mut basis, mut pivots) = (columns.clone(), Vec::<Vec<T>>::new(), Vec::new());
    let mut smallest = f64::INFINITY;
    let mut dropped = 0.0;
    while pivots.len() < m {
        let left = (0..m).filter(|j| !pivots.contains(j));
        let j = left.fold(usize::MAX, |best, j| {
            if best == usize::MAX || norm(&rest[j]) > norm(&rest[best]) { j } else { best }
        });
        let ratio = if largest == o { 0.0 } else { (norm(&rest[j]) / largest).to_f64() };
        if ratio <= given.tolerance {
            dropped = ratio;
            break;
        }
        smallest = smallest.min(ratio);
        let mut unit = rest[j].clone();
        for _ in 0..2 {
            for b in &basis {
                let along = dot(&unit, b);
                subtract(&mut unit, b, along);
            }
        }
        let scale = norm(&unit).recip();
        unit.iter_mut().for_each(|x| *x *= scale);
        for r in &mut rest {
            let along = dot(r, &unit);
            subtract(r, &unit, along);
        }
        basis.push(unit);
        pivots.push(j);
    }
    // Q* (ξ − ξ_free) = R^−* (g − G* ξ_free), and the residuals are ξ_free + Q Q* (ξ − ξ_free).
    let rank = pivots.len();
    let mut steps: Vec<T> = Vec::new();
    for t in 0..rank {
        let j = pivots[t];
        let g = weights[j] * (given.gamma[j] - rates[j][1]) - dot(&columns[j], &free);
        let g = (0..t).fold(g, |g, u| g - dot(&basis[u], &columns[j]) * steps[u]);
        steps.push(g / dot(&basis[t], &columns[j]));
    }
    let mut residual = free;
    for (b, step) in basis.iter().zip(&steps) {
        subtract(&mut residual, b, -*step);
    }
    // Basic multipliers R λ = steps, then without their part in the null space of the columns.
    let mut lambda = vec![o; m];
    let solve = |rhs: &[T]| -> Vec<T> {
        let mut x = vec![o; m];
        for t in (0..rank).rev() {
            let sum =
                (t + 1..rank).fold(rhs[t], |s, u| s - dot(&basis[t], &columns[pivots[u]]) * x[pivots[u]]);
            x[pivots[t]] = sum / dot(&basis[t], &columns[pivots[t]]);
        }
        x
    };
    lambda.copy_from_slice(&solve(&steps));
    let mut null: Vec<Vec<T>> = Vec::new();
    for j in (0..m).filter(|j| !pivots.contains(j)) {
        let rhs: Vec<T> = basis.iter().map(|b| -dot(b, &columns[j])).collect();
        let mut u = solve(&rhs);
        u[j] = T::one();
        for _ in 0..2 {
            for other in &null {
                let along = dot(&u, other);
                subtract(&mut u, other, along);
            }
        }
        let scale = norm(&u).recip();
        u.iter_mut().for_each(|x| *x *= scale);
        null.push(u);
    }
    for u in &null {
        let along = dot(&lambda, u);
        subtract(&mut lambda, u, along);
    }
    let mut force = vec![o; n];
    for i in 0..n {
        force[i] = (0..m).fold(o, |sum, j| sum + jacobian[(j, i)] * weights[j] * lambda[j]);
    }
    let mut acceleration = from_residuals(&factors, &roots, &residual);
    for i in (0..n).filter(|&i| given.active[i]) {
        acceleration[i] = known[i];
    }
    let mut needed = inverse(&acceleration);
    for i in 0..n {
        needed[i] = if given.active[i] { needed[i] - force[i] } else { tau[i] };
    }
    let multipliers = lambda.iter().zip(&weights).map(|(x, w)| *x * *w).collect();
    Ok(ClosedSolution { acceleration, multipliers, force, tau: needed, rank, pivots: [smallest, dropped] })
}

/// L^−* D^−½ ξ: the accelerations of residuals ξ, without λ, which may be large.
fn from_residuals<T: Real>(factors: &Factors<T>, roots: &[T], xi: &[T]) -> Vec<T> {
    let n = xi.len();
    let mut out = vec![T::zero(); n];
    // Column by column: innovations of unit forces are columns of L⁻¹, whose transpose is L^−*.
    for i in (0..n).filter(|&i| roots[i] != T::zero()) {
        let mut unit = vec![T::zero(); n];
        unit[i] = T::one();
        let column = factors.innovations(&unit);
        out[i] = (0..n).fold(T::zero(), |sum, j| sum + column[j] * roots[j] * xi[j]);
    }
    out
}

fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::zero(), |sum, (a, b)| sum + *a * *b)
}

fn norm<T: Real>(a: &[T]) -> T {
    dot(a, a).sqrt()
}

fn subtract<T: Real>(a: &mut [T], b: &[T], s: T) {
    for (a, b) in a.iter_mut().zip(b) {
        *a -= s * *b;
    }
}
