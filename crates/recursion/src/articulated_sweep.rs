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
//! component i its pivot D_i, its column U_i = P H_i* and P − U_i D_i⁻¹ U_i* remain, as if it were a hinge of its own.

use crate::error::{DynamicsError, check_length};
use crate::hinge::Hinge;
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{ArticulatedInertia, Motion, RigidInertia, Scalar, Transform, Wrench};

/// One eliminated degree of freedom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pivot<T> {
    /// U = P H*, N·m·s² or N·s² per unit acceleration.
    pub column: Wrench<T>,
    /// 1/D.
    pub inverse: T,
}

impl<T: Scalar> Pivot<T> {
    /// Before any sweep.
    pub fn empty() -> Self {
        Pivot { column: Wrench::zero(), inverse: T::zero() }
    }
}

/// Eliminates one joint: P becomes P⁺. Returns the component whose pivot is not positive, and the pivot.
#[inline(always)]
pub(crate) fn eliminate<T: Scalar>(
    hinge: &Hinge<T::Constant>,
    P: &mut ArticulatedInertia<T>,
    pivots: &mut [Pivot<T>],
) -> Result<(), (usize, f64)> {
    for (i, &component) in hinge.components().iter().enumerate() {
        let column = match hinge {
            Hinge::Helical { .. } => P.times(hinge.axis(i)),
            _ => P.column(component),
        };
        let D = hinge.project(i, &column);
        if !D.is_positive() {
            return Err((i, D.min_lane()));
        }
        let inverse = D.recip();
        P.add_outer(column, -inverse);
        pivots[i] = Pivot { column, inverse };
    }
    // A free joint lets nothing through: what the subtractions leave is rounding.
    if matches!(hinge, Hinge::Free) {
        *P = ArticulatedInertia::zero();
    }
    Ok(())
}

/// Filter step at one joint: ε = T − H z, ν = D⁻¹ ε, z⁺ = z + G ε. `residuals` holds T before and ν after.
#[inline(always)]
pub(crate) fn filter<T: Scalar>(
    hinge: &Hinge<T::Constant>,
    pivots: &[Pivot<T>],
    z: &mut Wrench<T>,
    residuals: &mut [T],
) {
    // H = I and G = I: z⁺ = T exactly, whatever the size of z.
    let through = match hinge {
        Hinge::Free => Some(Wrench::from_array(core::array::from_fn(|i| residuals[i]))),
        _ => None,
    };
    for i in 0..hinge.nv() {
        let nu = (residuals[i] - hinge.project(i, z)) * pivots[i].inverse;
        *z += pivots[i].column.scale(nu);
        residuals[i] = nu;
    }
    if let Some(through) = through {
        *z = through;
    }
}

/// Smoother step at one joint: θ̈ = ν − G* α⁺, α = α⁺ + H* θ̈. `residuals` holds ν before and θ̈ after.
#[inline(always)]
pub(crate) fn smooth<T: Scalar>(
    hinge: &Hinge<T::Constant>,
    pivots: &[Pivot<T>],
    alpha: &mut Motion<T>,
    residuals: &mut [T],
) {
    for i in (0..hinge.nv()).rev() {
        let x = residuals[i] - alpha.dot(pivots[i].column) * pivots[i].inverse;
        hinge.add_axis(i, x, alpha);
        residuals[i] = x;
    }
}

/// The factors of M(q): everything that M⁻¹ x needs.
#[derive(Clone, Debug)]
pub struct ArticulatedSweep<T> {
    pub(crate) hinge: Vec<Transform<T>>,
    pub(crate) pivots: Vec<Pivot<T>>,
    /// P⁺ of every body, in its own frame.
    inertia: Vec<ArticulatedInertia<T>>,
}

impl<T: Scalar> ArticulatedSweep<T> {
    /// Factors M(q) = (I + HφK) D (I + HφK)* (soa.md 3.1). `q`: nq. Cost O(n).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`]; [`DynamicsError::SingularHinge`] if a D is not positive.
    pub fn new(layout: &Layout<T::Constant>, q: &[T]) -> Result<Self, DynamicsError> {
        layout.check_tree()?;
        check_length("q", q, layout.nq())?;
        let mut sweep = ArticulatedSweep {
            hinge: vec![Transform::identity(); layout.len()],
            pivots: vec![Pivot::empty(); layout.nv()],
            inertia: vec![ArticulatedInertia::zero(); layout.len()],
        };
        sweep.update(layout, q)?;
        Ok(sweep)
    }
    /// Factors M at another configuration of the same layout, without allocation. After an error there are no factors.
    ///
    /// # Errors
    /// As [`ArticulatedSweep::new`].
    pub fn update(&mut self, layout: &Layout<T::Constant>, q: &[T]) -> Result<(), DynamicsError> {
        check_length("q", q, layout.nq())?;
        check_length("sweep", &self.hinge, layout.len())?;
        for (k, body) in layout.bodies.iter().enumerate() {
            self.hinge[k] = body.pose(q);
            self.inertia[k] = RigidInertia::constant(&body.inertia).to_articulated();
        }
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let mut P = self.inertia[k];
            eliminate(&body.hinge, &mut P, &mut self.pivots[body.v..body.v + body.hinge.nv()])
                .map_err(|(i, D)| layout.singular(body.v + i, D))?;
            self.inertia[k] = P;
            if body.parent != GROUND {
                self.inertia[body.parent] =
                    self.inertia[body.parent] + self.hinge[k].articulated_to_parent(&P);
            }
        }
        Ok(())
    }
    /// ln det M = Σ ln D. `ln` is taken in f64.
    pub fn log_determinant(&self) -> f64
    where
        T: phipsi_spatial::Real,
    {
        -self.pivots.iter().map(|p| p.inverse.to_f64().ln()).sum::<f64>()
    }
    /// x ← M⁻¹ x: one filter and one smoother sweep (soa.md 3.1). `x`: nv. `workspace`: one wrench and one motion a body.
    pub fn solve_in_place(
        &self,
        layout: &Layout<T::Constant>,
        x: &mut [T],
        workspace: &mut SolveWorkspace<T>,
    ) {
        let SolveWorkspace { z, alpha } = workspace;
        z.iter_mut().for_each(|z| *z = Wrench::zero());
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let dofs = body.v..body.v + body.hinge.nv();
            let mut force = z[k];
            filter(&body.hinge, &self.pivots[dofs.clone()], &mut force, &mut x[dofs]);
            if body.parent != GROUND {
                z[body.parent] += self.hinge[k].wrench_to_parent(force);
            }
        }
        self.sweep_outboard(layout, x, alpha);
    }
    /// x ← M^(−½) x with M^(−½) = (I − HψK)* D^(−½), so that M^(−½) M^(−*½) = M⁻¹: one smoother sweep. Deviates of unit
    /// covariance become velocities of covariance M⁻¹, the equipartition of soa.md 3.8. `x`: nv. Cost O(n), no allocation.
    pub fn multiply_by_inverse_square_root(
        &self,
        layout: &Layout<T::Constant>,
        x: &mut [T],
        workspace: &mut SolveWorkspace<T>,
    ) {
        for (x, pivot) in x.iter_mut().zip(&self.pivots) {
            *x *= pivot.inverse.sqrt();
        }
        self.sweep_outboard(layout, x, &mut workspace.alpha);
    }
    /// x ← M^½ x with M^½ = (I + HφK) D^½, so that M^½ M^*½ = M: one inward sweep. Deviates of unit covariance become
    /// momenta of covariance M. `x`: nv. Cost O(n), no allocation.
    pub fn multiply_by_square_root(
        &self,
        layout: &Layout<T::Constant>,
        x: &mut [T],
        workspace: &mut SolveWorkspace<T>,
    ) {
        let z = &mut workspace.z;
        z.iter_mut().for_each(|z| *z = Wrench::zero());
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let mut force = z[k];
            for i in 0..body.hinge.nv() {
                let pivot = &self.pivots[body.v + i];
                // e = D^½ x, D⁻¹ e = D^(−½) x.
                let nu = x[body.v + i] * pivot.inverse.sqrt();
                x[body.v + i] = nu / pivot.inverse + body.hinge.project(i, &force);
                force += pivot.column.scale(nu);
            }
            if body.parent != GROUND {
                z[body.parent] += self.hinge[k].wrench_to_parent(force);
            }
        }
    }

    /// Smoother sweep from a ground at rest: `x` holds ν before and θ̈ after.
    fn sweep_outboard(&self, layout: &Layout<T::Constant>, x: &mut [T], alpha: &mut [Motion<T>]) {
        for (k, body) in layout.bodies.iter().enumerate() {
            let dofs = body.v..body.v + body.hinge.nv();
            alpha[k] = if body.parent == GROUND {
                Motion::zero()
            } else {
                self.hinge[k].motion_to_child(alpha[body.parent])
            };
            smooth(&body.hinge, &self.pivots[dofs.clone()], &mut alpha[k], &mut x[dofs]);
        }
    }
}

/// Scratch of the products of [`ArticulatedSweep`].
#[derive(Clone, Debug)]
pub struct SolveWorkspace<T> {
    z: Vec<Wrench<T>>,
    alpha: Vec<Motion<T>>,
}

impl<T: Scalar> SolveWorkspace<T> {
    /// For a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        SolveWorkspace { z: vec![Wrench::zero(); layout.len()], alpha: vec![Motion::zero(); layout.len()] }
    }
}
