//! Trees with flexible bodies as moving mass points: Lagrange's equations by d'Alembert's principle.
//!
//! A flexible body is the mass points that its integrals were made of; each point's place is a function of time, written with
//! jets. Forces of inertia, weight and strain do the work of the generalised forces on every velocity that a unit of v gives. A
//! body of which integrals alone are known is given by its kinetic energy, ½ y·M_fl(η) y: Boltzmann–Hamel equations, with
//! derivatives by dual numbers.

#![allow(non_snake_case)] // integrals have the symbols of the model

use crate::bodies::{WorldInertia, world_inertias};
use crate::dense::{Factors, NotPositive};
use crate::dual::Dual;
use crate::jet::Jet;
use crate::kinematics::{BodyMotion, combination, modal_coordinates, poses};
use nalgebra::DMatrix;
use phipsi_model::{FlexibleBody, MassPoint, Model};
use phipsi_spatial::{Mat3, Real, Vec3, Wrench};

/// A mass point of a flexible body: mass, place, velocity and acceleration in the world.
#[derive(Clone, Copy, Debug)]
struct Moving<T> {
    mass: T,
    place: Vec3<T>,
    velocity: Vec3<T>,
    acceleration: Vec3<T>,
}

/// Everything that moves: bodies' frames, points of flexible bodies.
struct Scene<T> {
    motions: Vec<BodyMotion<T>>,
    points: Vec<Vec<Moving<T>>>,
    /// η̇ and η̈ by body.
    modal: Vec<[Vec<T>; 3]>,
}

fn scene<T: Real>(model: &Model, points: &[Vec<MassPoint>], q: &[T], v: &[T], a: &[T]) -> Scene<T> {
    let poses = poses(model, q, v, a);
    let of = |k: usize| -> Vec<Moving<T>> {
        let eta = modal_coordinates(model, k, q, v, a);
        let place = |point: &MassPoint| {
            let moved = combination(&point.displacement, &eta);
            let s = [0, 1, 2].map(|i| moved[i] + Jet::constant(T::splat(point.position[i])));
            let x = poses[k].point(&s);
            Moving {
                mass: T::splat(point.mass),
                place: Vec3(x.map(|x| x.value)),
                velocity: Vec3(x.map(|x| x.rate)),
                acceleration: Vec3(x.map(|x| x.second)),
            }
        };
        points[k].iter().map(place).collect()
    };
    let coordinates = |k: usize| {
        let (qs, vs) = (model.mode_q_range(k), model.mode_v_range(k));
        [q[qs].to_vec(), v[vs.clone()].to_vec(), a[vs].to_vec()]
    };
    Scene {
        motions: poses.iter().map(|pose| pose.motion()).collect(),
        points: (0..model.len()).map(of).collect(),
        modal: (0..model.len()).map(coordinates).collect(),
    }
}

/// Scenes with one unit of velocity each.
fn unit_scenes<T: Real>(model: &Model, points: &[Vec<MassPoint>], q: &[T]) -> Vec<Scene<T>> {
    let zero = vec![T::zero(); model.nv()];
    let unit = |i: usize| {
        let mut v = zero.clone();
        v[i] = T::one();
        scene(model, points, q, &v, &zero)
    };
    (0..model.nv()).map(unit).collect()
}

/// True for a flexible body of which integrals alone are known.
fn is_general(model: &Model, points: &[Vec<MassPoint>], k: usize) -> bool {
    model.bodies()[k].modes() > 0 && points[k].is_empty()
}

fn is_rigid(model: &Model, k: usize) -> bool {
    model.bodies()[k].modes() == 0
}

/// y = [η̇; ω; v] of a flexible body, F's axes.
fn own_rates<T: Real>(scene: &Scene<T>, k: usize) -> Vec<T> {
    let motion = &scene.motions[k];
    let r = motion.pose.rotation;
    let (w, v) = (r.transpose_mul(motion.velocity.angular), r.transpose_mul(motion.velocity.linear));
    [&scene.modal[k][1][..], &w.0, &v.0].concat()
}

/// M_fl(η), order [η; ω; v], from the integrals.
pub fn body_mass_matrix<T: Real>(body: &FlexibleBody, eta: &[T]) -> DMatrix<T> {
    let integrals = &body.integrals;
    let n = eta.len();
    let matrix = |m: &[[f64; 3]; 3]| Mat3(m.map(|row| row.map(T::splat)));
    let vector = |x: &[f64; 3]| Vec3::<T>::splat(*x);
    let half = T::splat(0.5);
    let second = integrals.stiffening.as_ref();
    let T1 = |l: usize, m: usize| second.map_or(Vec3::zero(), |t| vector(&t.displacement[l * n + m]));
    let T2 = |l: usize, m: usize| second.map_or(Mat3::zero(), |t| matrix(&t.moment[l * n + m]));
    let mut M = DMatrix::from_element(n + 6, n + 6, T::zero());
    let mut d = vector(&integrals.first_moment);
    let mut W = matrix(&integrals.second_moment);
    for l in 0..n {
        let mut F = matrix(&integrals.moment[l]);
        let mut Y = F;
        let mut S1 = vector(&integrals.displacement[l]);
        d += S1.scale(eta[l]);
        for m in 0..n {
            let S = matrix(&integrals.product[l * n + m]);
            F = F + S.scale(eta[m]) + T2(l, m).scale(eta[m]);
            Y = Y + T2(l, m).scale(half * eta[m]);
            W = W + S.scale(eta[l] * eta[m]);
            S1 += T1(l, m).scale(eta[m]);
            d += T1(l, m).scale(half * eta[l] * eta[m]);
            let trace = S.0[0][0] + S.0[1][1] + S.0[2][2];
            M[(l, m)] = trace + T::splat(integrals.rotary_modal[l * n + m]);
        }
        W = W + (Y + Y.transpose()).scale(eta[l]);
        let f = &F.0;
        let turned = Vec3([f[2][1] - f[1][2], f[0][2] - f[2][0], f[1][0] - f[0][1]])
            + vector(&integrals.rotary_coupling[l]);
        for a in 0..3 {
            (M[(l, n + a)], M[(n + a, l)]) = (turned.0[a], turned.0[a]);
            (M[(l, n + 3 + a)], M[(n + 3 + a, l)]) = (S1.0[a], S1.0[a]);
        }
    }
    let trace = W.0[0][0] + W.0[1][1] + W.0[2][2];
    let cross = Mat3::skew(d);
    for i in 0..3 {
        for j in 0..3 {
            let diagonal = |x: T| if i == j { x } else { T::zero() };
            M[(n + i, n + j)] = diagonal(trace) - W.0[i][j] + T::splat(integrals.rotary[i][j]);
            M[(n + i, n + 3 + j)] = cross.0[i][j];
            M[(n + 3 + j, n + i)] = cross.0[i][j];
            M[(n + 3 + i, n + 3 + j)] = diagonal(T::splat(integrals.mass));
        }
    }
    M
}

fn times<T: Real>(M: &DMatrix<T>, x: &[T]) -> Vec<T> {
    (0..M.nrows()).map(|i| (0..x.len()).fold(T::zero(), |sum, j| sum + M[(i, j)] * x[j])).collect()
}

fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::zero(), |sum, (a, b)| sum + *a * *b)
}

/// Forces on (η, ω, v) of the inertia of a body, from its kinetic energy: Boltzmann–Hamel. `y` and the rate `y_dot` of its
/// components.
pub fn body_inertia_force<T: Real>(body: &FlexibleBody, eta: &[T], y: &[T], y_dot: &[T]) -> Vec<T> {
    let n = eta.len();
    let moved = |direction: &dyn Fn(usize) -> T| {
        let eta: Vec<Dual<T>> = eta.iter().enumerate().map(|(l, x)| Dual::new(*x, direction(l))).collect();
        let M = body_mass_matrix(body, &eta);
        DMatrix::from_fn(n + 6, n + 6, |i, j| M[(i, j)].rate)
    };
    let M = body_mass_matrix(body, eta);
    let (p, inertia, changing) = (times(&M, y), times(&M, y_dot), times(&moved(&|l| y[l]), y));
    let mut f: Vec<T> = inertia.iter().zip(&changing).map(|(a, b)| *a + *b).collect();
    for l in 0..n {
        let direction = |m: usize| if l == m { T::one() } else { T::zero() };
        f[l] -= dot(y, &times(&moved(&direction), y)) * T::splat(0.5);
    }
    let at = |x: &[T], i: usize| Vec3([x[n + i], x[n + i + 1], x[n + i + 2]]);
    let (w, v) = (at(y, 0), at(y, 3));
    let moment = w.cross(at(&p, 0)) + v.cross(at(&p, 3));
    let force = w.cross(at(&p, 3));
    for i in 0..3 {
        f[n + i] += moment.0[i];
        f[n + 3 + i] += force.0[i];
    }
    f
}

/// Generalised forces of accelerations `a` at (q, v): modal ones beyond strain and damping. `points`: of every body, the mass
/// points of its integrals.
pub fn inverse_dynamics<T: Real>(
    model: &Model,
    points: &[Vec<MassPoint>],
    (q, v, a): (&[T], &[T], &[T]),
    wrenches: Option<&[Wrench<T>]>,
) -> Vec<T> {
    let now = scene(model, points, q, v, a);
    let g = Vec3::<T>::splat(model.gravity());
    let inertias = world_inertias(model, &now.motions);
    // Forces of each general body on its own y, with the acceleration of F against gravity.
    let general = |k: usize| {
        let body = model.bodies()[k].flexible.as_ref().expect("a flexible body");
        let y = own_rates(&now, k);
        let n = body.modes();
        let motion = &now.motions[k];
        let r = motion.pose.rotation;
        let (w, v) = (Vec3([y[n], y[n + 1], y[n + 2]]), Vec3([y[n + 3], y[n + 4], y[n + 5]]));
        let angular = r.transpose_mul(motion.acceleration.angular);
        let linear = r.transpose_mul(motion.acceleration.linear - g) - w.cross(v);
        let y_dot = [&now.modal[k][2][..], &angular.0, &linear.0].concat();
        body_inertia_force(body, &now.modal[k][0], &y, &y_dot)
    };
    let general: Vec<Vec<T>> = (0..model.len())
        .map(|k| if is_general(model, points, k) { general(k) } else { Vec::new() })
        .collect();
    let work = |unit: &Scene<T>| {
        let mut sum = T::zero();
        for k in 0..model.len() {
            let (motion, along) = (&now.motions[k], &unit.motions[k]);
            if is_rigid(model, k) {
                sum += rigid_work(motion, along, &inertias[k], g);
            }
            for (point, along) in now.points[k].iter().zip(&unit.points[k]) {
                sum += (point.acceleration - g).dot(along.velocity) * point.mass;
            }
            if !general[k].is_empty() {
                sum += dot(&general[k], &own_rates(unit, k));
            }
            sum += dot(&elastic(model, k, &now), &unit.modal[k][1]);
            if let Some(wrenches) = wrenches {
                let r = motion.pose.rotation;
                sum -= (r * wrenches[k].moment).dot(along.velocity.angular)
                    + (r * wrenches[k].force).dot(along.velocity.linear);
            }
        }
        sum
    };
    unit_scenes(model, points, q).iter().map(work).collect()
}

/// Work of a rigid body's inertia and weight along a virtual velocity.
fn rigid_work<T: Real>(
    motion: &BodyMotion<T>,
    along: &BodyMotion<T>,
    inertia: &WorldInertia<T>,
    g: Vec3<T>,
) -> T {
    let w = motion.velocity.angular;
    let moment = inertia.tensor * motion.acceleration.angular + w.cross(inertia.tensor * w);
    let force = (motion.acceleration_at(inertia.center) - g).scale(inertia.mass);
    moment.dot(along.velocity.angular) + force.dot(along.velocity_at(inertia.center))
}

/// K η + C η̇.
fn elastic<T: Real>(model: &Model, k: usize, now: &Scene<T>) -> Vec<T> {
    let [eta, rate, _] = &now.modal[k];
    let n = eta.len();
    let Some(body) = &model.bodies()[k].flexible else { return Vec::new() };
    let row = |l: usize| {
        (0..n).fold(T::zero(), |sum, m| {
            sum + T::splat(body.stiffness[l * n + m]) * eta[m] + T::splat(body.damping[l * n + m]) * rate[m]
        })
    };
    (0..n).map(row).collect()
}

/// M(q): sums of m v_i·v_j over points and bodies.
pub fn mass_matrix<T: Real>(model: &Model, points: &[Vec<MassPoint>], q: &[T]) -> DMatrix<T> {
    let units = unit_scenes(model, points, q);
    let n = model.nv();
    let Some(first) = units.first() else { return DMatrix::from_element(0, 0, T::zero()) };
    let inertias = world_inertias(model, &first.motions);
    let general: Vec<Option<DMatrix<T>>> = (0..model.len())
        .map(|k| {
            let body = model.bodies()[k].flexible.as_ref().filter(|_| is_general(model, points, k))?;
            Some(body_mass_matrix(body, &first.modal[k][0]))
        })
        .collect();
    let entry = |a: &Scene<T>, b: &Scene<T>| {
        let mut sum = T::zero();
        for k in 0..model.len() {
            if is_rigid(model, k) {
                let (c, m) = (inertias[k].center, inertias[k].mass);
                let (x, y) = (&a.motions[k], &b.motions[k]);
                sum += x.velocity_at(c).dot(y.velocity_at(c)) * m
                    + x.velocity.angular.dot(inertias[k].tensor * y.velocity.angular);
            }
            for (x, y) in a.points[k].iter().zip(&b.points[k]) {
                sum += x.velocity.dot(y.velocity) * x.mass;
            }
            if let Some(M) = &general[k] {
                sum += dot(&own_rates(a, k), &times(M, &own_rates(b, k)));
            }
        }
        sum
    };
    DMatrix::from_fn(n, n, |i, j| entry(&units[i], &units[j]))
}

/// Accelerations of generalised forces `tau`.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn forward_dynamics<T: Real>(
    model: &Model,
    points: &[Vec<MassPoint>],
    (q, v, tau): (&[T], &[T], &[T]),
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<T>, NotPositive> {
    let rest = vec![T::zero(); model.nv()];
    let bias = inverse_dynamics(model, points, (q, v, &rest), wrenches);
    let net: Vec<T> = tau.iter().zip(&bias).map(|(t, b)| *t - *b).collect();
    let M = mass_matrix(model, points, q);
    Ok(Factors::new(&M, (0..model.nv()).rev().collect(), 0.0)?.solve(&net))
}

/// ln det M, logarithms in f64.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn log_determinant<T: Real>(
    model: &Model,
    points: &[Vec<MassPoint>],
    q: &[T],
) -> Result<f64, NotPositive> {
    let M = mass_matrix(model, points, q);
    let factors = Factors::new(&M, (0..model.nv()).rev().collect(), 0.0)?;
    Ok(factors.pivots().iter().map(|x| x.to_f64().ln()).sum())
}

/// d ln det M/ds = tr(M⁻¹ dM/ds) along dq/ds: `q` holds dual numbers.
///
/// # Errors
/// [`NotPositive`] if M is not positive definite.
pub fn log_determinant_rate<T: Real>(
    model: &Model,
    points: &[Vec<MassPoint>],
    q: &[Dual<T>],
) -> Result<T, NotPositive> {
    let M = mass_matrix(model, points, q);
    let factors = Factors::new(&M, (0..model.nv()).rev().collect(), 0.0)?;
    Ok(factors.pivots().iter().fold(T::zero(), |sum, x| sum + x.rate / x.value))
}

/// Kinetic and potential energy, strain included; momentum about the world's origin; mass and Σ m c.
pub fn totals<T: Real>(
    model: &Model,
    points: &[Vec<MassPoint>],
    (q, v): (&[T], &[T]),
) -> (T, T, Wrench<T>, (T, Vec3<T>)) {
    let rest = vec![T::zero(); model.nv()];
    let now = scene(model, points, q, v, &rest);
    let moves = crate::bodies::moves(model);
    let half = T::splat(0.5);
    let (mut kinetic, mut potential) = (T::zero(), T::zero());
    let (mut h, mut mass, mut moment) = (Wrench::zero(), T::zero(), Vec3::zero());
    for (k, inertia) in world_inertias(model, &now.motions).iter().enumerate() {
        let motion = &now.motions[k];
        let w = motion.velocity.angular;
        if is_rigid(model, k) && moves[k] {
            let velocity = motion.velocity_at(inertia.center);
            let (p, spin) = (velocity.scale(inertia.mass), inertia.tensor * w);
            kinetic += (velocity.dot(p) + w.dot(spin)) * half;
            h += Wrench::new(inertia.center.cross(p) + spin, p);
            mass += inertia.mass;
            moment += inertia.center.scale(inertia.mass);
        }
        for point in &now.points[k] {
            let p = point.velocity.scale(point.mass);
            kinetic += p.dot(point.velocity) * half;
            h += Wrench::new(point.place.cross(p), p);
            mass += point.mass;
            moment += point.place.scale(point.mass);
        }
        if is_general(model, points, k) {
            let body = model.bodies()[k].flexible.as_ref().expect("a flexible body");
            let (eta, y, n) = (&now.modal[k][0], own_rates(&now, k), body.modes());
            let M = body_mass_matrix(body, eta);
            let p = times(&M, &y);
            kinetic += dot(&y, &p) * half;
            let (r, o) = (motion.pose.rotation, motion.pose.translation);
            let force = r * Vec3([p[n + 3], p[n + 4], p[n + 5]]);
            h += Wrench::new(r * Vec3([p[n], p[n + 1], p[n + 2]]) + o.cross(force), force);
            let m = T::splat(body.integrals.mass);
            // d~ is the block M_wv.
            let d = Vec3([M[(n + 2, n + 4)], M[(n, n + 5)], M[(n + 1, n + 3)]]);
            mass += m;
            moment += o.scale(m) + r * d;
        }
        if let Some(body) = &model.bodies()[k].flexible {
            let (eta, n) = (&now.modal[k][0], body.modes());
            for l in 0..n {
                for m in 0..n {
                    potential += T::splat(body.stiffness[l * n + m]) * eta[l] * eta[m] * half;
                }
            }
        }
    }
    (kinetic, potential - Vec3::<T>::splat(model.gravity()).dot(moment), h, (mass, moment))
}

/// Rates of q for one unit of velocity i: by what bodies' coordinates do along the model's increments.
pub fn unit_rates<T: Real>(model: &Model, q: &[T], i: usize) -> Vec<Dual<T>> {
    let mut out: Vec<Dual<T>> = q.iter().map(|x| Dual::fixed(*x)).collect();
    let mut x = vec![Dual::fixed(T::zero()); model.nv()];
    x[i].rate = T::one();
    let moved = model.integrate(&out, &x);
    // Quaternions are normalised on the way: these are unit already.
    out.copy_from_slice(&moved);
    out
}
