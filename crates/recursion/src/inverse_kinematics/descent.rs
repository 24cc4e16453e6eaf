//! The way from one start to a minimum of ½ |e|²: damped least squares, then Newton's steps where e does not go to zero.

use super::curvature::{curvature, factor_and_solve};
use super::{InverseKinematics, InverseKinematicsOptions};
use crate::error::DynamicsError;
use crate::jacobian_pseudo_inverse::{PseudoInverseOptions, Tip};
use crate::kinematics::body_pose;
use crate::layout::Layout;
use crate::singular_values::dot;
use phipsi_model::Model;
use phipsi_spatial::{Quaternion, Real, Scalar, Transform, Vec3};

/// The least damping and shift.
const FLOOR: f64 = 1e-12;

/// A configuration's errors.
#[derive(Clone, Copy)]
pub(super) struct Residual<T> {
    pub(super) rotation: Vec3<T>,
    pub(super) position: Vec3<T>,
    /// e, six numbers; angular ones zero where only the position counts.
    pub(super) weighted: [T; 6],
    /// |e|².
    pub(super) square: T,
}

/// What does not change during a call.
pub(super) struct Goal<'a, T: Scalar> {
    pub(super) model: &'a Model,
    pub(super) layout: &'a Layout<T>,
    pub(super) body: usize,
    pub(super) target: &'a Transform<T>,
    pub(super) options: InverseKinematicsOptions,
    pub(super) length: f64,
}

impl<T: Real> Goal<'_, T> {
    /// ℓ where rotations count, else zero.
    fn scale(&self) -> f64 {
        if self.options.orientation { self.length } else { 0.0 }
    }
    pub(super) fn residual(&self, q: &[T]) -> Result<Residual<T>, DynamicsError> {
        let pose = body_pose(self.layout, q, Some(self.body))?;
        let turned = self.target.rotation * pose.rotation.transpose();
        let rotation = Quaternion::from_rotation(&turned).log();
        let position = self.target.translation - pose.translation;
        let ([a, b, c], [d, e, f]) = (rotation.scale(T::splat(self.scale())).0, position.0);
        let weighted = [a, b, c, d, e, f];
        Ok(Residual { rotation, position, weighted, square: dot(&weighted, &weighted) })
    }
    pub(super) fn is_reached(&self, e: &Residual<T>) -> bool {
        let rotation = if self.options.orientation { e.rotation.norm().to_f64() } else { 0.0 };
        rotation.max(e.position.norm().to_f64() / self.length) <= self.options.tolerance
    }
}

/// Where a start ended.
pub(super) struct End<T> {
    pub(super) residual: Residual<T>,
    pub(super) gradient: f64,
    pub(super) at_limits: usize,
    pub(super) singular_values: [f64; 6],
}

impl<T: Real> InverseKinematics<T> {
    /// Steps from `self.q` to a minimum.
    pub(super) fn descend(
        &mut self,
        goal: &Goal<'_, T>,
        iterations: &mut usize,
    ) -> Result<End<T>, DynamicsError> {
        let layout = goal.layout;
        let tips = [Tip { body: Some(goal.body), point: None }];
        let weights = PseudoInverseOptions { length: goal.scale(), ..Default::default() };
        let mut e = goal.residual(&self.q)?;
        // μ = damping |e|² of least squares, shift · |column|² of Newton's steps.
        let (mut damping, mut shift, mut newton) = (1e-3, FLOOR, false);
        let (mut polished, mut polishes) = (false, 0);
        for step in 0..=goal.options.iterations {
            self.pseudo.load(layout, &self.q, &tips, weights)?;
            self.differentiate(goal, &e);
            let sigma = self.pseudo.singular_values().first().copied().unwrap_or(T::zero());
            let mut slope = T::zero();
            for (g, frozen) in self.gradient.iter().zip(&self.frozen) {
                slope += if *frozen { T::zero() } else { *g * *g };
            }
            let gradient = slope.sqrt() / (sigma * e.square.sqrt());
            let gradient = if gradient.is_positive() { gradient.to_f64() } else { 0.0 };
            let stationary = polished || gradient <= 64.0 * T::EPSILON;
            if goal.is_reached(&e) || stationary || step == goal.options.iterations {
                return Ok(self.end(e, gradient));
            }
            *iterations += 1;
            let moved = loop {
                let predicted = if newton {
                    self.newton_step(goal, &e, &mut shift)
                } else {
                    self.least_squares_step(&e, damping * e.square.to_f64())?
                };
                goal.model.integrate_into(&self.q, &self.step, &mut self.trial);
                if self.bounded {
                    clip(goal.model, &self.lower, &self.upper, &mut self.trial);
                }
                let next = goal.residual(&self.trial)?;
                let gain = ((e.square - next.square) / (predicted + predicted)).to_f64();
                // Below the rounding of |e|² a Newton step still makes the gradient smaller.
                let level = T::splat(32.0 * T::EPSILON) * e.square;
                if newton && predicted <= level && next.square <= e.square + level {
                    (polished, polishes) = (polishes > 2, polishes + 1);
                    break Some(next);
                }
                if next.square < e.square {
                    let grip = if newton { &mut shift } else { &mut damping };
                    if gain > 0.7 {
                        *grip = (*grip * 0.1).max(FLOOR);
                    } else if gain < 0.2 {
                        *grip *= 4.0;
                    }
                    break Some(next);
                }
                let grip = if newton { &mut shift } else { &mut damping };
                *grip = (*grip * 10.0).max(1e-6);
                if *grip > 1e12 {
                    break None;
                }
            };
            let Some(next) = moved else {
                if newton {
                    // No step comes nearer: rounding.
                    return Ok(self.end(e, gradient));
                }
                (newton, damping) = (true, 1e-3);
                continue;
            };
            newton = next.square > e.square * T::splat(0.25);
            e = next;
            core::mem::swap(&mut self.q, &mut self.trial);
        }
        Err(DynamicsError::NotFinite { index: 0, found: e.square.to_f64() })
    }
    fn end(&self, residual: Residual<T>, gradient: f64) -> End<T> {
        let mut singular_values = [0.0; 6];
        for (to, x) in singular_values.iter_mut().zip(self.pseudo.singular_values()) {
            *to = x.to_f64();
        }
        let at_limits = self.frozen.iter().filter(|x| **x).count();
        End { residual, gradient, at_limits, singular_values }
    }
    /// g, and which coordinates it presses against a limit: their columns of W J become zero.
    fn differentiate(&mut self, goal: &Goal<'_, T>, e: &Residual<T>) {
        let (nv, length) = (goal.layout.nv(), T::splat(goal.scale()));
        let matrix = self.pseudo.matrix_mut();
        for i in 0..nv {
            let mut g = T::zero();
            for r in 0..6 {
                let weight = if r < 3 { length } else { T::one() };
                g -= matrix[r * nv + i] * weight * e.weighted[r];
            }
            self.gradient[i] = g;
        }
        self.frozen.fill(false);
        for k in (0..goal.model.len()).filter(|&k| self.moving[k]) {
            let (at, v) = (goal.model.q_offset(k), goal.model.v_offset(k));
            if goal.model.joints()[k].kind.nv() != 1 {
                continue;
            }
            let low = self.lower[v].is_some_and(|x| self.q[at] <= T::splat(x));
            let high = self.upper[v].is_some_and(|x| self.q[at] >= T::splat(x));
            let g = self.gradient[v];
            self.frozen[v] = self.bounded && (low && g > T::zero() || high && g < T::zero());
        }
        let matrix = self.pseudo.matrix_mut();
        for i in (0..nv).filter(|&i| self.frozen[i]) {
            for r in 0..6 {
                matrix[r * nv + i] = T::zero();
            }
        }
        self.pseudo.decompose();
    }
    /// A damped least-squares step; returns the reduction of ½ |e|² that it promises.
    fn least_squares_step(&mut self, e: &Residual<T>, mu: f64) -> Result<T, DynamicsError> {
        self.pseudo.solve_weighted(&e.weighted, T::splat(mu), &mut self.step)?;
        // −g·δq − ½ |W J δq|², of which the second is at most half of the first.
        let along = dot(&self.gradient, &self.step);
        Ok(self.pseudo.moved_square(&self.step).fma(T::splat(-0.5), -along))
    }
    /// A Newton step with B made positive definite; returns the reduction of ½ |e|² that it promises.
    fn newton_step(&mut self, goal: &Goal<'_, T>, e: &Residual<T>, shift: &mut f64) -> T {
        loop {
            let InverseKinematics { pseudo, path, hessian, step, gradient, frozen, squares, .. } = self;
            let error = [e.rotation, e.position];
            curvature(pseudo.matrix_mut(), path, frozen, goal.scale(), error, hessian, squares);
            squares.iter_mut().for_each(|x| *x *= T::splat(*shift));
            step.fill(T::zero());
            if factor_and_solve(path, frozen, hessian, squares, gradient, step) || *shift > 1e12 {
                // (B + μ) δq = −g: −g·δq − ½ δq·B δq = ½ (−g·δq + δq·μ δq).
                let mut twice = -dot(gradient, step);
                for (x, mu) in step.iter().zip(&*squares) {
                    twice += *x * *x * *mu;
                }
                return twice * T::splat(0.5);
            }
            *shift = (*shift * 10.0).max(1e-6);
        }
    }
}

/// Coordinates with limits, moved into them.
pub(super) fn clip<T: Real>(model: &Model, lower: &[Option<f64>], upper: &[Option<f64>], q: &mut [T]) {
    for k in model.moving_joints() {
        let (at, v) = (model.q_offset(k), model.v_offset(k));
        if let Some(lower) = lower[v] {
            q[at] = q[at].larger(T::splat(lower));
        }
        if let Some(upper) = upper[v] {
            q[at] = -(-q[at]).larger(T::splat(-upper));
        }
    }
}
