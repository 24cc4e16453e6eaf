//! Derivatives of forward dynamics by q, v and the generalised forces.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | θ̈ | accelerations of (q, v, T) | paper 1 (9.14) |
//! | ∂θ̈/∂q, ∂θ̈/∂v | −M⁻¹ ∂T/∂q, −M⁻¹ ∂T/∂v, derivatives of inverse dynamics at θ̈ | |
//! | M⁻¹ | L* D⁻¹ L with L = I − HψK: [`crate::innovations`] | soa.md 3.1 |
//! | P, K, D | filter and smoother in the axes of the ground, which the derivatives have anyway: `filter.rs` | |
//! | c | turning of the axes of planar and free joints: T is a function of θ̈ + c, so ∂c/∂v is subtracted at the end and the speed of a free body stays out of its moments | |

use crate::error::{DynamicsError, check_length};
use crate::flexible::{Map, derivatives};
use crate::forward_dynamics::ForwardDynamics;
use crate::hinge::Hinge;
use crate::innovations::Innovations;
use crate::inverse_dynamics_derivatives::{DerivativeSweeps, accelerate_outboard, check_arguments};
use crate::layout::{Layout, Shifts};
use crate::packed::is_lone;
use phipsi_spatial::wide::{Wide, WideKernel};
use phipsi_spatial::{Scalar, Vec3, Wrench};

mod filter;

use filter::Sweep as FilterSweep;
use filter::{Filter, LimbFilter, smooth};

/// Workspace of the derivatives of forward dynamics.
#[derive(Clone, Debug)]
pub struct ForwardDynamicsDerivatives<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    sweeps: DerivativeSweeps<T::Arithmetic>,
    filter: Filter<T::Arithmetic>,
    innovations: Innovations<T::Arithmetic>,
    acceleration: Vec<T>,
    /// For a layout with flexible bodies.
    flexible: Option<Box<ForwardDynamics<T>>>,
}

impl<T: Scalar> ForwardDynamicsDerivatives<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let sweeps = DerivativeSweeps::new(layout);
        ForwardDynamicsDerivatives {
            shifts: Shifts::new(layout),
            filter: Filter::new(layout, &sweeps.places, is_lone::<T>()),
            innovations: Innovations::with_products(
                layout,
                &sweeps.places,
                if falls(layout) { 6 } else { 0 },
            ),
            sweeps,
            acceleration: vec![T::zero(); layout.nv()],
            flexible: layout.is_flexible().then(|| Box::new(ForwardDynamics::new(layout))),
        }
    }
    /// Derivatives of the accelerations of generalised forces `tau` at (q, v) under wrenches that are constant in their bodies'
    /// axes. The accelerations themselves are in [`acceleration`](Self::acceleration) afterwards.
    ///
    /// # Computes
    /// ∂θ̈/∂q along the increments of `Model::integrate` (body-axes velocities of the joints), ∂θ̈/∂v, ∂θ̈/∂T = M⁻¹(q); in each
    /// the other arguments stay as numbers.
    ///
    /// # Shapes & units
    /// `q`: nq; `v`, `tau`: nv; `wrenches`: one per body of the model, at its frame's origin, its axes; `d_dq`, `d_dv`,
    /// `d_dtau`: nv×nv by rows, row i is the acceleration of degree of freedom i.
    ///
    /// # Cost
    /// O(n · depth) for the forces' derivatives, O(nv · depth²) for M⁻¹, and two products with M⁻¹: O(nv² · depth), or O(nv²) by
    /// sweeps over the columns where that is less; no allocation. With flexible
    /// bodies dual numbers go through the sweeps: O(nv · n), with allocations.
    ///
    /// # Accuracy
    /// n·ε·|M⁻¹| times the κ of the forces' derivatives, and ε × mass ratio where a heavy body hangs on a light one, as in
    /// [`ForwardDynamics::run`]. Accelerations and M⁻¹ come from a recursion in the axes of the ground, in which a D is known to
    /// ε times the inertia that it is a part of, also at a tip.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`]; [`DynamicsError::SingularHinge`] if a D is not larger than such rounding.
    #[allow(clippy::too_many_arguments)] // three arguments, three derivatives
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        tau: &[T],
        wrenches: Option<&[Wrench<T>]>,
        d_dq: &mut [T],
        d_dv: &mut [T],
        d_dtau: &mut [T],
    ) -> Result<(), DynamicsError> {
        check_arguments(layout, (q, v, ("tau", tau)), wrenches, (d_dq, d_dv, ("d_dtau", d_dtau)))?;
        check_length("workspace", &self.acceleration, layout.nv())?;
        if layout.is_flexible() {
            let forward = self.flexible.get_or_insert_with(|| Box::new(ForwardDynamics::new(layout)));
            forward.run(layout, q, v, tau, wrenches, &mut self.acceleration)?;
            return derivatives(Map::Forward, layout, (q, v, tau), wrenches, (d_dq, d_dv, d_dtau));
        }
        check_length("workspace", &self.sweeps.places.first, layout.len())?;
        self.sweeps.load(layout, wrenches);
        self.acceleration.copy_from_slice(tau);
        let (q, v, d_dtau) = (T::arithmetic(q), T::arithmetic(v), T::arithmetic_mut(d_dtau));
        let (d_dq, d_dv) = (T::arithmetic_mut(d_dq), T::arithmetic_mut(d_dv));
        T::Arithmetic::dispatch_wide(Accelerate { work: self, layout, q, v })?;
        T::Arithmetic::dispatch_wide(Derive { work: self, layout });
        // Kernels of their own: smaller functions keep their sums in registers.
        if self.innovations.has_sweeps() {
            let out = [&mut *d_dq, &mut *d_dv];
            T::Arithmetic::dispatch_wide(Sweep { work: self, layout, out });
        }
        T::Arithmetic::dispatch_wide(Solve { work: self, layout, v, out: [d_dq, d_dv, d_dtau] });
        Ok(())
    }
    /// θ̈ of the last successful run.
    pub fn acceleration(&self) -> &[T] {
        &self.acceleration
    }
}

struct Accelerate<'a, T: Scalar> {
    work: &'a mut ForwardDynamicsDerivatives<T>,
    layout: &'a Layout<T::Constant>,
    q: &'a [T::Arithmetic],
    v: &'a [T::Arithmetic],
}

impl<T: Scalar> WideKernel<T::Arithmetic> for Accelerate<'_, T> {
    type Output = Result<(), DynamicsError>;
    #[inline(always)]
    fn run<W: Wide<T::Arithmetic>>(self) -> Result<(), DynamicsError> {
        let Accelerate { work, layout, q, v } = self;
        let ForwardDynamicsDerivatives { shifts, sweeps, filter, innovations, acceleration, .. } = work;
        shifts.set_all(layout, q);
        sweeps.move_bodies::<false, W>(layout, shifts, v, &[]);
        let (places, view, gains) = (&sweeps.places, sweeps.table.view(), innovations.gains());
        let residuals = T::arithmetic_mut(acceleration);
        let mut sweep = FilterSweep { layout, places, view, gains, residuals };
        let in_lanes = match layout.limbs.as_deref() {
            Some(plan) => T::lone(LimbFilter { filter, plan, sweep: &mut sweep }).unwrap_or(Ok(false))?,
            None => false,
        };
        if !in_lanes {
            filter.inward(is_lone::<T>(), &mut sweep)?;
        }
        let FilterSweep { mut view, mut gains, residuals, .. } = sweep;
        accelerate_outboard(layout, places, &mut view, |view, body, place, alpha| {
            smooth(body, place, view, &mut gains, residuals, alpha);
        });
        Ok(())
    }
}

struct Derive<'a, T: Scalar> {
    work: &'a mut ForwardDynamicsDerivatives<T>,
    layout: &'a Layout<T::Constant>,
}

impl<T: Scalar> WideKernel<T::Arithmetic> for Derive<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T::Arithmetic>>(self) {
        let ForwardDynamicsDerivatives { sweeps, innovations, .. } = self.work;
        sweeps.run::<false, W>(self.layout);
        let DerivativeSweeps { places, table, .. } = sweeps;
        innovations.update::<W, _>(places, &mut table.view());
        if falls(self.layout) {
            // g in the axes of the body, which turn under it.
            let axes = table.view().at(places.margin).axes();
            let g = Vec3::constant(self.layout.gravity());
            let seen = Vec3([axes[0].dot(g), axes[1].dot(g), axes[2].dot(g)]);
            for j in 0..3 {
                innovations.set_known((places.margin + 3, places.margin + j), seen.cross(Vec3::unit(j)));
            }
        }
    }
}

struct Sweep<'a, T: Scalar> {
    work: &'a mut ForwardDynamicsDerivatives<T>,
    layout: &'a Layout<T::Constant>,
    /// ∂θ̈/∂q, ∂θ̈/∂v.
    out: [&'a mut [T::Arithmetic]; 2],
}

impl<T: Scalar> WideKernel<T::Arithmetic> for Sweep<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T::Arithmetic>>(self) {
        let ForwardDynamicsDerivatives { sweeps, innovations, .. } = self.work;
        let DerivativeSweeps { places, meetings, table, .. } = sweeps;
        let mut bodies = table.view();
        innovations.negative_sweeps::<W, _>(self.layout, places, &mut bodies, &meetings.rates, self.out);
    }
}

struct Solve<'a, T: Scalar> {
    work: &'a mut ForwardDynamicsDerivatives<T>,
    layout: &'a Layout<T::Constant>,
    v: &'a [T::Arithmetic],
    /// ∂θ̈/∂q, ∂θ̈/∂v, M⁻¹.
    out: [&'a mut [T::Arithmetic]; 3],
}

impl<T: Scalar> WideKernel<T::Arithmetic> for Solve<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<T::Arithmetic>>(self) {
        let Solve { work, layout, v, out: [d_dq, d_dv, d_dtau] } = self;
        let DerivativeSweeps { places, meetings, .. } = &work.sweeps;
        work.innovations.inverse_mass_matrix::<W>(places, d_dtau);
        if !work.innovations.has_sweeps() {
            work.innovations.negative_solve::<W>(places, &meetings.rates, [d_dq, &mut *d_dv]);
        }
        subtract_turning_rates(layout, v, d_dv);
        let acceleration = T::arithmetic_mut(&mut work.acceleration);
        for body in layout.bodies() {
            let dofs = body.v..body.v + body.hinge.nv();
            body.hinge.subtract_turning(&v[body.v..], &mut acceleration[dofs]);
        }
    }
}

/// True if the first body is free: wherever it is moved, with all that it carries, only its own acceleration changes, as
/// gravity is seen from it.
fn falls<C: phipsi_spatial::Scalar>(layout: &Layout<C>) -> bool {
    layout.bodies().first().is_some_and(|root| matches!(root.hinge, Hinge::Free))
}

/// −= ∂c/∂v: column j of a joint gets s × δv + δω × b.
#[inline(always)]
fn subtract_turning_rates<T: Scalar>(layout: &Layout<T::Constant>, v: &[T], d_dv: &mut [T]) {
    let nv = layout.nv();
    for body in layout.bodies() {
        if !matches!(body.hinge, Hinge::Planar | Hinge::Free) {
            continue;
        }
        let joint = body.hinge.expand(&v[body.v..]);
        let dofs = body.v..body.v + body.hinge.nv();
        for (i, &component) in body.hinge.components().iter().enumerate() {
            // Only linear components have a rate: (δs × v + ω × δb)_i = δs · (v × e_i) + δb · (e_i × ω).
            let Some(direction) = component.checked_sub(3).map(Vec3::unit) else { continue };
            let [x, y, z, a, b, c] =
                Wrench::new(joint.linear.cross(direction), direction.cross(joint.angular)).to_array();
            let rate = if let Hinge::Planar = body.hinge { [z, a, b, a, b, c] } else { [x, y, z, a, b, c] };
            let row = &mut d_dv[(body.v + i) * nv..][dofs.clone()];
            for (x, &rate) in row.iter_mut().zip(&rate) {
                *x -= rate;
            }
        }
    }
}

/// (∂θ̈/∂q, ∂θ̈/∂v, ∂θ̈/∂T = M⁻¹): [`ForwardDynamicsDerivatives::run`] for a single call.
///
/// # Errors
/// As there.
#[allow(clippy::type_complexity)] // three matrices
pub fn forward_dynamics_derivatives<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<(Vec<T>, Vec<T>, Vec<T>), DynamicsError> {
    let zero = vec![T::zero(); layout.nv() * layout.nv()];
    let (mut d_dq, mut d_dv, mut d_dtau) = (zero.clone(), zero.clone(), zero);
    let mut work = ForwardDynamicsDerivatives::new(layout);
    work.run(layout, q, v, tau, wrenches, &mut d_dq, &mut d_dv, &mut d_dtau)?;
    Ok((d_dq, d_dv, d_dtau))
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_reference::generate::case;

    /// Two ways of the same product. Terms are of the size √(M⁻¹_ii M⁻¹_cc) |B_cj|, and both ways lose digits where a D is small
    /// against its composite inertia.
    #[test]
    fn sweeps_over_columns_are_products_with_the_inverse() {
        let mut compared = 0;
        for seed in 0..200 {
            let case = case(seed);
            let (layout, nv) = (Layout::<f64>::new(&case.model), case.model.nv());
            if layout
                .bodies()
                .iter()
                .any(|b| matches!(b.hinge, Hinge::Free) && b.parent != crate::layout::GROUND)
            {
                continue;
            }
            compared += 1;
            let mut work = ForwardDynamicsDerivatives::new(&layout);
            let (q, v, tau) = (&case.q[..], &case.v[..], &case.tau[..]);
            let [products, sweeps] = [false, true].map(|sweeps| {
                let zero = vec![0.0; nv * nv];
                let (mut d_dq, mut d_dv, mut d_dtau) = (zero.clone(), zero.clone(), zero);
                work.innovations.choose(&layout, &work.sweeps.places, sweeps);
                work.run(&layout, q, v, tau, None, &mut d_dq, &mut d_dv, &mut d_dtau).unwrap();
                [d_dq, d_dv, d_dtau]
            });
            assert_eq!(products[2], sweeps[2]);
            let a = work.acceleration();
            let (b_dq, b_dv, m) = crate::inverse_dynamics_derivatives(&layout, q, v, a, None).unwrap();
            let diagonal = |x: &[f64], i: usize| x[i * nv + i];
            let growth = (0..nv).map(|i| diagonal(&m, i) * diagonal(&sweeps[2], i)).fold(1.0, f64::max);
            for (which, b) in [b_dq, b_dv].iter().enumerate() {
                for j in 0..nv {
                    let terms: f64 =
                        (0..nv).map(|c| diagonal(&sweeps[2], c).sqrt() * b[c * nv + j].abs()).sum();
                    for i in 0..nv {
                        let unit = 4.0 * nv as f64 * f64::EPSILON * growth;
                        let allowed = unit * diagonal(&sweeps[2], i).sqrt() * terms;
                        let error = (products[which][i * nv + j] - sweeps[which][i * nv + j]).abs();
                        assert!(error <= allowed, "seed {seed}, [{i}, {j}]: {error:e}, allowed {allowed:e}");
                    }
                }
            }
        }
        assert!(compared > 100, "{compared}");
    }
}
