//! Gragg's extrapolation on embedded coordinates: an independent method of order 16 for references.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | y | (q, v, aux) with quaternions as four numbers: no chart, no retraction | |
//! | z_m | z_{m+1} = z_{m−1} + 2 (H/n) f(z_m): modified midpoint rule with n substeps | Hairer, Nørsett, Wanner, *Solving ODEs I*, II.9 (9.13) |
//! | T_{j,k} | T_{j,k−1} + (T_{j,k−1} − T_{j−1,k−1})/((n_j/n_{j−k})² − 1) | the same, (9.10); expansion in H², (9.14b) |
//!
//! It shares nothing with the Runge–Kutta methods: another formula, no coefficients but small integers, other coordinates.
//! So it can judge them, and in double-double numbers it is good to far below the rounding of f64.

use phipsi_model::{JointKind, Model};
use phipsi_spatial::{Quaternion, Real, Vec3};

/// Columns of the table: order 16. Rounding grows little with 2, 4, … 16 substeps.
const COLUMNS: usize = 8;

/// q̇ of a velocity, in the coordinates of q: quaternions as four numbers. `q`, `out`: nq, `v`: nv.
///
/// # Computes
/// q̇ = v for joints whose q is a vector; ½ q∘(ω, 0) for orientations; R v for the position of a free joint and the planar one.
pub fn coordinate_rate<T: Real>(model: &Model, q: &[T], v: &[T], out: &mut [T]) {
    let turning = |q: &[T], w: &[T], out: &mut [T]| {
        let half = T::splat(0.5);
        let rate = Quaternion([q[0], q[1], q[2], q[3]]).compose(Quaternion([w[0], w[1], w[2], T::zero()]));
        out.iter_mut().zip(rate.0).for_each(|(out, x)| *out = half * x);
    };
    for k in model.moving_joints() {
        let (q, v) = (&q[model.q_range(k)], &v[model.v_range(k)]);
        let out = &mut out[model.q_range(k)];
        match model.joints()[k].kind {
            JointKind::Spherical => turning(q, v, out),
            JointKind::Free => {
                let rotation = Quaternion([q[3], q[4], q[5], q[6]]).to_rotation();
                out[..3].copy_from_slice(&(rotation * Vec3([v[3], v[4], v[5]])).0);
                turning(&q[3..], v, &mut out[3..]);
            }
            JointKind::Planar { .. } => {
                let (s, c) = q[2].sin_cos();
                (out[0], out[1], out[2]) = (c * v[1] - s * v[2], s * v[1] + c * v[2], v[0]);
            }
            _ => out.copy_from_slice(v),
        }
    }
}

/// Why no step succeeded.
#[derive(Clone, Debug, PartialEq)]
pub enum ExtrapolationError<E> {
    /// The step size fell below what the time can resolve.
    StepUnderflow {
        /// Time.
        t: f64,
    },
    /// The derivative failed at every step size.
    Derivative {
        /// Time.
        t: f64,
        /// Why.
        cause: E,
    },
}

/// A derivative: f(t, y, ẏ).
pub type Rate<'a, T, E> = dyn FnMut(f64, &[T], &mut [T]) -> Result<(), E> + 'a;

/// The method with its state.
#[derive(Clone, Debug)]
pub struct Extrapolation<T> {
    t: f64,
    y: Vec<T>,
    h: f64,
    tolerance: f64,
    evaluations: u64,
    /// Last row of the table of every number of substeps: one column vector each.
    table: Vec<Vec<T>>,
    z: [Vec<T>; 3],
    rate: Vec<T>,
    start_rate: Vec<T>,
}

impl<T: Real> Extrapolation<T> {
    /// At a time and state; `tolerance`: largest local error of a component over 1 + its size.
    pub fn new(t: f64, y: Vec<T>, tolerance: f64) -> Self {
        let zero = vec![T::zero(); y.len()];
        Extrapolation {
            t,
            h: 0.0,
            tolerance,
            evaluations: 0,
            table: vec![zero.clone(); COLUMNS],
            z: [zero.clone(), zero.clone(), zero.clone()],
            rate: zero.clone(),
            start_rate: zero,
            y,
        }
    }
    /// Time.
    pub fn t(&self) -> f64 {
        self.t
    }
    /// State.
    pub fn y(&self) -> &[T] {
        &self.y
    }
    /// Evaluations of the derivative so far.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// One accepted step, ending at `limit` at the latest and exactly there when it is reached. `f(t, y, ẏ)` is evaluated at
    /// times up to `latest`; `settle` may move the new state back onto its manifold.
    ///
    /// # Errors
    /// [`ExtrapolationError`]; the state is that before the step.
    pub fn step<E>(
        &mut self,
        limit: f64,
        latest: f64,
        f: &mut Rate<'_, T, E>,
        settle: &dyn Fn(&mut [T]),
    ) -> Result<(), ExtrapolationError<E>> {
        let t = self.t;
        self.evaluations += 1;
        f(t, &self.y, &mut self.start_rate).map_err(|cause| ExtrapolationError::Derivative { t, cause })?;
        if self.h == 0.0 {
            let size = |x: &[T]| x.iter().fold(0.0f64, |m, x| m.max(x.to_f64().abs()));
            self.h = 0.01 * (1.0 + size(&self.y)) / size(&self.start_rate).max(1e-3);
        }
        let mut h = self.h;
        let mut cause = None;
        loop {
            let landing = t + 1.01 * h >= limit;
            let trial = if landing { limit - t } else { h };
            if !(trial > 4.0 * f64::EPSILON * t.abs().max(f64::MIN_POSITIVE) && t + trial > t) {
                return Err(match cause {
                    Some(cause) => ExtrapolationError::Derivative { t, cause },
                    None => ExtrapolationError::StepUnderflow { t },
                });
            }
            let end = if landing { limit } else { t + trial };
            let error = match self.attempt(end, latest, f) {
                Ok(error) => {
                    cause = None;
                    error
                }
                Err(e) => {
                    cause = Some(e);
                    f64::INFINITY
                }
            };
            let factor = match error {
                e if e.is_finite() => {
                    (0.8 * e.max(1e-30).powf(-1.0 / (2 * COLUMNS - 1) as f64)).clamp(0.2, 3.0)
                }
                _ => 0.25,
            };
            if error <= 1.0 {
                self.t = end;
                self.y.copy_from_slice(&self.table[COLUMNS - 1]);
                settle(&mut self.y);
                // A step cut short by its limit says little about the next one.
                self.h = if trial < 0.999 * h { h.max(trial * factor) } else { trial * factor };
                return Ok(());
            }
            h = trial * factor.min(0.9);
        }
    }

    /// All columns of a step to the time `end`; the result is the table's last vector. Returns the error over the tolerance.
    fn attempt<E>(&mut self, end: f64, latest: f64, f: &mut Rate<'_, T, E>) -> Result<f64, E> {
        let mut error = f64::INFINITY;
        for j in 0..COLUMNS {
            self.midpoint(2 * (j + 1), end, latest, f)?;
            // Row j of the table replaces row j − 1 in place: T_{j,k} from T_{j,k−1} and T_{j−1,k−1}.
            let [_, new, _] = &mut self.z;
            for k in 0..j {
                let divisor =
                    T::splat(((j + 1) * (j + 1)) as f64) / T::splat(((j - k) * (j - k)) as f64) - T::one();
                for (new, old) in new.iter_mut().zip(&mut self.table[k]) {
                    let better = *new + (*new - *old) / divisor;
                    *old = *new;
                    *new = better;
                }
            }
            if j + 1 == COLUMNS {
                let scaled = new.iter().zip(&self.table[COLUMNS - 2]).map(|(new, last)| {
                    (*new - *last).to_f64().abs() / (self.tolerance * (1.0 + new.to_f64().abs()))
                });
                // A NaN must not pass for a small error.
                error = scaled.fold(0.0f64, |m, e| if e.is_nan() { f64::INFINITY } else { m.max(e) });
            }
            self.table[j].copy_from_slice(new);
        }
        Ok(error)
    }

    /// The modified midpoint rule with n substeps from y; the result is `z[1]`.
    fn midpoint<E>(&mut self, n: usize, end: f64, latest: f64, f: &mut Rate<'_, T, E>) -> Result<(), E> {
        // The exact difference of two f64 times: a rounded one would be an error of the step in double-double numbers.
        let part = (T::splat(end) - T::splat(self.t)) / T::splat(n as f64);
        let [before, now, next] = &mut self.z;
        before.copy_from_slice(&self.y);
        for i in 0..now.len() {
            now[i] = self.y[i] + part * self.start_rate[i];
        }
        for m in 1..n {
            let time = (self.t + (end - self.t) * m as f64 / n as f64).min(latest);
            self.evaluations += 1;
            f(time, now, &mut self.rate)?;
            for i in 0..now.len() {
                next[i] = before[i] + (part + part) * self.rate[i];
            }
            before.swap_with_slice(now);
            now.swap_with_slice(next);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_spatial::Dd;
    use std::convert::Infallible;

    /// y″ = −y, in both precisions: the error after 10 s is that of the tolerance.
    fn oscillator<T: Real>(tolerance: f64) -> f64 {
        let mut e = Extrapolation::new(0.0, vec![T::one(), T::zero()], tolerance);
        let mut f = |_: f64, y: &[T], out: &mut [T]| -> Result<(), Infallible> {
            (out[0], out[1]) = (y[1], -y[0]);
            Ok(())
        };
        while e.t() < 10.0 {
            e.step(10.0, f64::INFINITY, &mut f, &|_| {}).unwrap();
        }
        let (s, c) = T::splat(10.0).sin_cos();
        (e.y()[0] - c).to_f64().abs().max((e.y()[1] + s).to_f64().abs())
    }

    #[test]
    fn an_oscillator_is_right_to_the_tolerance_in_both_precisions() {
        // Some ten steps, each with an error below the tolerance of the formula one order lower.
        assert!(oscillator::<f64>(1e-13) < 1e-13);
        assert!(oscillator::<Dd>(1e-22) < 1e-21, "{:e}", oscillator::<Dd>(1e-22));
    }

    /// Difference quotients of `Model::integrate` in double-double are the rates.
    #[test]
    fn coordinate_rates_are_the_derivative_of_integrate() {
        use phipsi_model::{Body, Inertia, Joint, ModelBuilder};
        let unit = || Inertia::from_principal(1.0, [0.0; 3], [1.0; 3]);
        let kinds = [
            JointKind::Spherical,
            JointKind::Free,
            JointKind::Planar { normal: [0.0, 0.6, 0.8] },
            JointKind::Revolute { axis: [1.0, 0.0, 0.0] },
        ];
        for kind in kinds {
            let model = ModelBuilder::new("one")
                .body(Body::new("b", unit()))
                .joint(Joint::new("j", kind), "world", "b")
                .build()
                .unwrap();
            let state = model.random_state(3);
            let lift = |x: &[f64]| x.iter().map(|&x| Dd::from_f64(x)).collect::<Vec<Dd>>();
            let mut q = lift(&state.q);
            model.normalize(&mut q);
            let v = lift(&state.v);
            let mut rate = vec![Dd::from_f64(0.0); model.nq()];
            coordinate_rate(&model, &q, &v, &mut rate);
            let at =
                |h: f64| model.integrate(&q, &v.iter().map(|v| *v * Dd::from_f64(h)).collect::<Vec<Dd>>());
            let (plus, minus) = (at(1e-10), at(-1e-10));
            for i in 0..model.nq() {
                let difference = (plus[i] - minus[i]) / Dd::from_f64(2e-10);
                // Truncation h² = 1e-20, rounding 1e-32/h = 1e-22.
                assert!((difference - rate[i]).to_f64().abs() < 1e-18, "{kind:?} {i}");
            }
        }
    }
}
