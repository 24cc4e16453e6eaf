//! The articulated (Riccati) sweep and its per-body steps.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | P | articulated inertia: M + Σ φ(k,c) P⁺(c) φ*(k,c) | 6×6 | paper 2 (2.4), corrected in soa.md 4 |
//! | D | H P H*, articulated joint inertia | r×r | paper 1 (9.5) |
//! | G | P H* D⁻¹, Kalman gain | 6×r | paper 1 (9.6) |
//! | P⁺ | (I − G H) P, what the joint lets through | 6×6 | paper 1 (9.7) |
//! | z | bias force: Σ φ z⁺(c) + b + P a | 6 | paper 1 (9.3) |
//! | ε, ν | innovation T − H z, residual D⁻¹ ε | r | paper 1 (9.9)–(9.10) |
//!
//! A joint of r degrees of freedom is eliminated one component after the other: the LDL* factorisation of its D. After
//! component i its pivot D_i, its gain G_i = P H_i* D_i⁻¹ and P − G_i H_i P remain, as if it were a hinge of its own.

use crate::error::{DynamicsError, check_length};
use crate::hinge::{Hinge, each_component};
use crate::kernel::kernel;
use crate::layout::{GROUND, Layout, LayoutBody, Passage, Pending, Shifts};
use phipsi_spatial::{ArticulatedInertia, Motion, RigidInertia, Scalar, Vec3, Wrench};

/// One eliminated degree of freedom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pivot<T> {
    /// G = P H* D⁻¹.
    pub(crate) gain: Wrench<T>,
    /// 1/D.
    pub(crate) inverse: T,
}

impl<T: Scalar> Pivot<T> {
    /// Before any sweep.
    pub(crate) fn empty() -> Self {
        Pivot { gain: Wrench::zero(), inverse: T::zero() }
    }
}

/// A joint whose pivot is not positive: which of its components, and the pivot.
type Singular = (usize, f64);

/// Eliminates the joint of a body: φ(p, k) P⁺ φ*(p, k), zero on the ground.
#[inline(always)]
pub(crate) fn eliminate<T: Scalar>(
    body: &LayoutBody<T::Constant>,
    passage: Passage<'_, T>,
    mut P: ArticulatedInertia<T>,
    pivots: &mut [Pivot<T>],
) -> Result<ArticulatedInertia<T>, Singular> {
    let pivots = &mut pivots[..body.hinge.nv()];
    each_component!(
        body.hinge,
        |I, C| {
            let column = P.column(C);
            pivots[I] = eliminate_axis(&mut P, column, column.get(C)).map_err(|D| (I, D))?;
        },
        {
            let column = P.times(body.hinge.axis(0));
            let D = body.hinge.project(0, &column);
            pivots[0] = eliminate_axis(&mut P, column, D).map_err(|D| (0, D))?;
        }
    );
    // A free joint lets nothing through: what the subtractions leave is rounding.
    Ok(if body.parent == GROUND || matches!(body.hinge, Hinge::Free) {
        ArticulatedInertia::zero()
    } else {
        passage.articulated_to_parent(&P)
    })
}

/// One axis with its column U of P and pivot D: P −= U D⁻¹ U*.
#[inline(always)]
pub(crate) fn eliminate_axis<T: Scalar>(
    P: &mut ArticulatedInertia<T>,
    column: Wrench<T>,
    D: T,
) -> Result<Pivot<T>, f64> {
    if !D.is_positive() {
        return Err(D.min_lane());
    }
    let inverse = D.recip();
    let gain = column.scale(inverse);
    P.subtract_outer(gain, column);
    Ok(Pivot { gain, inverse })
}

/// P of a body: its own inertia and what its children let through.
#[inline(always)]
pub(crate) fn with_own<T: Scalar>(
    body: &LayoutBody<T::Constant>,
    outboard: Option<ArticulatedInertia<T>>,
) -> ArticulatedInertia<T> {
    let M = RigidInertia::constant(&body.inertia);
    match outboard {
        Some(P) => P.plus_rigid(&M),
        None => M.to_articulated(),
    }
}

/// The pivot of a hinge about z: U is a column of P.
#[inline(always)]
pub(crate) fn revolute_pivot<T: Scalar>(P: &ArticulatedInertia<T>) -> Result<Pivot<T>, Singular> {
    let D = P.inertia.zz;
    if !D.is_positive() {
        return Err((0, D.min_lane()));
    }
    let inverse = D.recip();
    let gain = Wrench::new(
        Vec3([P.inertia.xz * inverse, P.inertia.yz * inverse, T::one()]),
        Vec3(P.coupling.0[2]).scale(inverse),
    );
    Ok(Pivot { gain, inverse })
}

/// The pivot of a slider along z: U is a column of P.
#[inline(always)]
pub(crate) fn prismatic_pivot<T: Scalar>(P: &ArticulatedInertia<T>) -> Result<Pivot<T>, Singular> {
    let D = P.mass.zz;
    if !D.is_positive() {
        return Err((0, D.min_lane()));
    }
    let inverse = D.recip();
    let gain = Wrench::new(
        P.coupling.column(2).scale(inverse),
        Vec3([P.mass.xz * inverse, P.mass.yz * inverse, T::one()]),
    );
    Ok(Pivot { gain, inverse })
}

/// Filter step at one joint: ε = T − H z, ν = D⁻¹ ε, z⁺ = z + G ε. `residuals` holds T before and ν after.
#[inline(always)]
pub(crate) fn filter<T: Scalar>(
    hinge: &Hinge<T::Constant>,
    pivots: &[Pivot<T>],
    z: &mut Wrench<T>,
    residuals: &mut [T],
) {
    match hinge {
        Hinge::Revolute => residuals[0] = filter_revolute(&pivots[0], z, residuals[0]),
        Hinge::Free => {
            // H = I and G = I: z⁺ = T exactly, whatever the size of z; what gains have for axes before their own is rounding. Sum by sum, not
            // gain by gain: rows of gains would be read by registers of 64 bytes.
            let (pivots, residuals) = (&pivots[..6], &mut residuals[..6]);
            let (mut through, mut epsilon, z_at) = ([T::zero(); 6], [T::zero(); 6], z.to_array());
            each_component!(
                hinge,
                |I, C| {
                    let mut rest = z_at[C];
                    for j in 0..6 {
                        if (..I).contains(&j) {
                            rest = pivots[j].gain.get(C).fma(epsilon[j], rest);
                        }
                    }
                    epsilon[I] = residuals[I] - rest;
                    through[C] = residuals[I];
                    residuals[I] = epsilon[I] * core::hint::black_box(&pivots[I]).inverse;
                },
                {}
            );
            *z = Wrench::from_array(through);
        }
        _ => filter_components(hinge, pivots, z, residuals),
    }
}

/// The hinge about z: ν from T. H G = 1, so that the component of z⁺ along the axis is T itself.
#[inline(always)]
pub(crate) fn filter_revolute<T: Scalar>(pivot: &Pivot<T>, z: &mut Wrench<T>, T: T) -> T {
    let epsilon = T - z.moment.0[2];
    let ([x, y, _], [gx, gy, _]) = (z.moment.0, pivot.gain.moment.0);
    z.moment = Vec3([gx.fma(epsilon, x), gy.fma(epsilon, y), T]);
    z.force = pivot.gain.force.scale_add(epsilon, z.force);
    epsilon * pivot.inverse
}

/// The slider along z: ν from T, as [`filter_revolute`].
#[inline(always)]
pub(crate) fn filter_prismatic<T: Scalar>(pivot: &Pivot<T>, z: &mut Wrench<T>, T: T) -> T {
    let epsilon = T - z.force.0[2];
    let ([x, y, _], [gx, gy, _]) = (z.force.0, pivot.gain.force.0);
    z.force = Vec3([gx.fma(epsilon, x), gy.fma(epsilon, y), T]);
    z.moment = pivot.gain.moment.scale_add(epsilon, z.moment);
    epsilon * pivot.inverse
}

#[inline(always)]
fn filter_components<T: Scalar>(
    hinge: &Hinge<T::Constant>,
    pivots: &[Pivot<T>],
    z: &mut Wrench<T>,
    residuals: &mut [T],
) {
    let (pivots, residuals) = (&pivots[..hinge.nv()], &mut residuals[..hinge.nv()]);
    each_component!(
        hinge,
        |I, C| residuals[I] = filter_axis(&pivots[I], z, z.get(C), residuals[I]),
        residuals[0] = filter_axis(&pivots[0], z, hinge.project(0, z), residuals[0])
    );
}

/// One axis: ν from T, where `along` is H z.
#[inline(always)]
fn filter_axis<T: Scalar>(pivot: &Pivot<T>, z: &mut Wrench<T>, along: T, T: T) -> T {
    let epsilon = T - along;
    *z = pivot.gain.scale_add(epsilon, *z);
    epsilon * pivot.inverse
}

/// Smoother step at one joint: θ̈ = ν − G* α⁺, α = α⁺ + H* θ̈. `residuals` holds ν before and θ̈ after.
#[inline(always)]
pub(crate) fn smooth<T: Scalar>(
    hinge: &Hinge<T::Constant>,
    pivots: &[Pivot<T>],
    alpha: &mut Motion<T>,
    residuals: &mut [T],
) {
    if let Hinge::Revolute = hinge {
        residuals[0] = smooth_revolute(&pivots[0], alpha, residuals[0]);
        return;
    }
    let (pivots, residuals) = (&pivots[..hinge.nv()], &mut residuals[..hinge.nv()]);
    if let Hinge::Free = hinge {
        // H = I, and what gains have for axes before their own is rounding: back substitution.
        let mut x = [T::zero(); 6];
        each_component!(
            reversed hinge,
            |I, C| {
                let gain = pivots[I].gain.to_array();
                let mut sum = residuals[I];
                for j in 0..6 {
                    if j > I {
                        sum = (-gain[j]).fma(x[j], sum);
                    }
                }
                x[I] = sum;
                residuals[I] = sum - alpha.get(C);
            },
            {}
        );
        *alpha = Motion::new(Vec3([x[0], x[1], x[2]]), Vec3([x[3], x[4], x[5]]));
        return;
    }
    each_component!(
        reversed hinge,
        |I, C| {
            residuals[I] -= alpha.dot(pivots[I].gain);
            alpha.add_to(C, residuals[I]);
        },
        {
            residuals[0] -= alpha.dot(pivots[0].gain);
            hinge.add_axis(0, residuals[0], alpha);
        }
    );
}

/// The hinge about z: θ̈ from ν.
#[inline(always)]
pub(crate) fn smooth_revolute<T: Scalar>(pivot: &Pivot<T>, alpha: &mut Motion<T>, nu: T) -> T {
    let ([x, y, z], [gx, gy, _]) = (alpha.angular.0, pivot.gain.moment.0);
    let ([a, b, c], [ga, gb, gc]) = (alpha.linear.0, pivot.gain.force.0);
    let across = gx.fma(x, gy.fma(y, z)) + ga.fma(a, gb.fma(b, gc * c));
    let x = nu - across;
    alpha.angular.0[2] = z + x;
    x
}

/// The factors of M(q): everything that M⁻¹ x needs.
#[derive(Clone, Debug)]
pub struct ArticulatedSweep<T: Scalar> {
    pub(crate) shifts: Shifts<T::Arithmetic>,
    pub(crate) pivots: Vec<Pivot<T::Arithmetic>>,
    pending: Pending<ArticulatedInertia<T::Arithmetic>>,
}

impl<T: Scalar> ArticulatedSweep<T> {
    /// Factors M(q) = (I + HφK) D (I + HφK)* (soa.md 3.1). `q`: nq. Cost O(n).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`], [`DynamicsError::Flexible`]; [`DynamicsError::SingularHinge`] if a
    /// D is not positive.
    pub fn new(layout: &Layout<T::Constant>, q: &[T]) -> Result<Self, DynamicsError> {
        layout.check_closures()?;
        check_length("q", q, layout.nq())?;
        let mut sweep = Self::empty(layout);
        sweep.update(layout, q)?;
        Ok(sweep)
    }
    /// A workspace without factors.
    pub(crate) fn empty(layout: &Layout<T::Constant>) -> Self {
        ArticulatedSweep {
            shifts: Shifts::new(layout),
            pivots: vec![Pivot::empty(); layout.nv()],
            pending: Pending::new(layout, ArticulatedInertia::zero()),
        }
    }
    /// Factors M at another configuration of the same layout, without allocation. After an error there are no factors.
    ///
    /// # Errors
    /// As [`ArticulatedSweep::new`].
    pub fn update(&mut self, layout: &Layout<T::Constant>, q: &[T]) -> Result<(), DynamicsError> {
        layout.check_rigid("ArticulatedSweep")?;
        check_length("q", q, layout.nq())?;
        check_length("sweep", &self.pivots, layout.nv())?;
        T::Arithmetic::dispatch(Factor { sweep: self, layout, q: T::arithmetic(q) })
    }
    /// ln det M = Σ ln D. `ln` is taken in f64.
    pub fn log_determinant(&self) -> f64
    where
        T: phipsi_spatial::Real,
    {
        -self.pivots.iter().map(|p| T::from_arithmetic(p.inverse).to_f64().ln()).sum::<f64>()
    }
    /// x ← M⁻¹ x: one filter and one smoother sweep (soa.md 3.1). `x`: nv. `workspace`: one wrench and one motion a body.
    pub fn solve_in_place(
        &self,
        layout: &Layout<T::Constant>,
        x: &mut [T],
        workspace: &mut SolveWorkspace<T>,
    ) {
        let x = T::arithmetic_mut(x);
        T::Arithmetic::dispatch(Solve { sweep: self, layout, x, work: workspace });
    }
    /// x ← M^(−½) x with M^(−½) = (I − HψK)* D^(−½), so that M^(−½) M^(−*½) = M⁻¹: one smoother sweep. Deviates of unit
    /// covariance become velocities of covariance M⁻¹, the equipartition of soa.md 3.8. `x`: nv. Cost O(n), no allocation.
    pub fn multiply_by_inverse_square_root(
        &self,
        layout: &Layout<T::Constant>,
        x: &mut [T],
        workspace: &mut SolveWorkspace<T>,
    ) {
        let x = T::arithmetic_mut(x);
        T::Arithmetic::dispatch(InverseSquareRoot { sweep: self, layout, x, work: workspace });
    }
    /// x ← M^½ x with M^½ = (I + HφK) D^½, so that M^½ M^*½ = M: one inward sweep. Deviates of unit covariance become
    /// momenta of covariance M. `x`: nv. Cost O(n), no allocation.
    pub fn multiply_by_square_root(
        &self,
        layout: &Layout<T::Constant>,
        x: &mut [T],
        workspace: &mut SolveWorkspace<T>,
    ) {
        let x = T::arithmetic_mut(x);
        T::Arithmetic::dispatch(SquareRoot { sweep: self, layout, x, work: workspace });
    }

    /// The Riccati sweep. `keep` sees P of every body before its joint is eliminated.
    #[inline(always)]
    pub(crate) fn sweep_inboard(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T::Arithmetic],
        mut keep: impl FnMut(usize, &ArticulatedInertia<T::Arithmetic>),
    ) -> Result<(), DynamicsError> {
        self.shifts.set_all(layout, q);
        self.pending.clear();
        let mut hand = ArticulatedInertia::zero();
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let P = with_own(body, self.pending.all(body, &mut hand, |a, b| *a = *a + *b));
            keep(k, &P);
            if let Hinge::Revolute = body.hinge {
                let pivot = revolute_pivot(&P).map_err(|(i, D)| layout.singular(body.v + i, D))?;
                self.pivots[body.v] = pivot;
                if body.parent != GROUND {
                    let moved = body.link.eliminated_to_parent(self.shifts.turn(k), &P, &pivot.gain);
                    self.pending.give(k, body, &mut hand, moved);
                }
                continue;
            }
            let pivots = &mut self.pivots[body.v..body.v + body.hinge.nv()];
            let moved = eliminate(body, self.shifts.at(k, body), P, pivots)
                .map_err(|(i, D)| layout.singular(body.v + i, D))?;
            self.pending.give(k, body, &mut hand, moved);
        }
        Ok(())
    }

    /// Smoother sweep from a ground at rest: `x` holds ν before and θ̈ after.
    #[inline(always)]
    pub(crate) fn sweep_outboard(
        &self,
        layout: &Layout<T::Constant>,
        x: &mut [T::Arithmetic],
        alpha: &mut [Motion<T::Arithmetic>],
    ) {
        for (k, body) in layout.bodies.iter().enumerate() {
            let dofs = body.v..body.v + body.hinge.nv();
            alpha[k] = if body.parent == GROUND {
                Motion::zero()
            } else {
                self.shifts.at(k, body).motion_to_child(alpha[body.parent])
            };
            smooth(&body.hinge, &self.pivots[dofs.clone()], &mut alpha[k], &mut x[dofs]);
        }
    }
}

kernel! {
    Factor<'a, T> {
        sweep: &'a mut ArticulatedSweep<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
    } -> Result<(), DynamicsError> {
        sweep.sweep_inboard(layout, q, |_, _| {})
    }
}

kernel! {
    Solve<'a, T> {
        sweep: &'a ArticulatedSweep<T>,
        layout: &'a Layout<T::Constant>,
        x: &'a mut [T::Arithmetic],
        work: &'a mut SolveWorkspace<T>,
    } -> () {
        work.pending.clear();
        let mut hand = Wrench::zero();
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let dofs = body.v..body.v + body.hinge.nv();
            let mut z = work.pending.all(body, &mut hand, |a, b| *a += *b).unwrap_or(Wrench::zero());
            filter(&body.hinge, &sweep.pivots[dofs.clone()], &mut z, &mut x[dofs]);
            if body.parent != GROUND {
                work.pending.give(k, body, &mut hand, sweep.shifts.at(k, body).wrench_to_parent(z));
            }
        }
        sweep.sweep_outboard(layout, x, &mut work.alpha);
    }
}

kernel! {
    InverseSquareRoot<'a, T> {
        sweep: &'a ArticulatedSweep<T>,
        layout: &'a Layout<T::Constant>,
        x: &'a mut [T::Arithmetic],
        work: &'a mut SolveWorkspace<T>,
    } -> () {
        for (x, pivot) in x.iter_mut().zip(&sweep.pivots) {
            *x *= pivot.inverse.sqrt();
        }
        sweep.sweep_outboard(layout, x, &mut work.alpha);
    }
}

kernel! {
    SquareRoot<'a, T> {
        sweep: &'a ArticulatedSweep<T>,
        layout: &'a Layout<T::Constant>,
        x: &'a mut [T::Arithmetic],
        work: &'a mut SolveWorkspace<T>,
    } -> () {
        work.pending.clear();
        let mut hand = Wrench::zero();
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let mut z = work.pending.all(body, &mut hand, |a, b| *a += *b).unwrap_or(Wrench::zero());
            for i in 0..body.hinge.nv() {
                let pivot = &sweep.pivots[body.v + i];
                let epsilon = x[body.v + i] / pivot.inverse.sqrt();
                x[body.v + i] = epsilon + body.hinge.project(i, &z);
                z = pivot.gain.scale_add(epsilon, z);
            }
            if body.parent != GROUND {
                work.pending.give(k, body, &mut hand, sweep.shifts.at(k, body).wrench_to_parent(z));
            }
        }
    }
}

/// Scratch of the products of [`ArticulatedSweep`].
#[derive(Clone, Debug)]
pub struct SolveWorkspace<T: Scalar> {
    pending: Pending<Wrench<T::Arithmetic>>,
    alpha: Vec<Motion<T::Arithmetic>>,
}

impl<T: Scalar> SolveWorkspace<T> {
    /// For a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        SolveWorkspace {
            pending: Pending::new(layout, Wrench::zero()),
            alpha: vec![Motion::zero(); layout.len()],
        }
    }
}
