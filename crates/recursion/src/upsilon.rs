//! The operational-space compliance Υ of every body, base to tip.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | Ω | ψ* H* D⁻¹ H ψ = φ* H* M⁻¹ H φ, what wrenches on all bodies give to all bodies | 6n×6n | soa.md 3.2 |
//! | Y | Υ(k): ψ*(p,k) Y(p) ψ(p,k) + H* D⁻¹ H, the diagonal blocks of Ω; zero on the ground | 6×6 | paper 1 (10.2), paper 2 (4.18) |
//! | Y⁺ | φ*(p,k) Y(p) φ(p,k), on the inboard side of the joint | 6×6 | |
//! | P, D, G | articulated inertia, joint inertia, gain: [`crate::articulated_sweep`] | | |
//!
//! With H the c-th row of the identity and G_c = 1, row c of Y is −Y⁺ G without the c-th terms and its diagonal entry
//! D⁻¹ + G* Y⁺ G without them: nothing of Y⁺ cancels. Joints of several degrees of freedom are passed one component after
//! the other, in the reverse of the order in which the articulated sweep eliminates them.

use crate::articulated_sweep::{ArticulatedSweep, Pivot, filter};
use crate::error::{DynamicsError, check_length};
use crate::hinge::each_component;
use crate::kernel::kernel;
use crate::layout::{GROUND, Layout, LayoutBody};
use num_traits::Zero;
use phipsi_spatial::{ArticulatedInertia, Motion, Scalar, Sym3, Transform, Vec3, Wrench};

/// A symmetric 6×6 matrix from wrenches to motions, kept as an inertia with its halves exchanged: `inertia` is the linear
/// block, `coupling` has linear rows and angular columns, `mass` is the angular block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Compliance<T>(pub(crate) ArticulatedInertia<T>);

impl<T: Scalar> Compliance<T> {
    #[inline(always)]
    pub(crate) fn zero() -> Self {
        Compliance(ArticulatedInertia::zero())
    }
    /// Y f.
    #[inline(always)]
    pub(crate) fn times(&self, f: Wrench<T>) -> Motion<T> {
        let exchanged = self.0.times(Motion::new(f.force, f.moment));
        Motion::new(exchanged.force, exchanged.moment)
    }
    /// X*(k) Y X(k) of a frame k fixed to the body, with pose `x` in the body's frame.
    #[inline(always)]
    pub(crate) fn at(&self, x: &Transform<T>) -> Self {
        Compliance(x.inverse().articulated_to_parent(&self.0))
    }
    /// By rows, angular first.
    #[inline(always)]
    pub(crate) fn write(&self, out: &mut [T]) {
        for j in 0..6 {
            let column = self.0.column((j + 3) % 6);
            let column = Motion::new(column.force, column.moment).to_array();
            for i in 0..6 {
                out[6 * i + j] = column[i];
            }
        }
    }
    /// Row and column c, angular first.
    #[inline(always)]
    fn set(&mut self, c: usize, row: &Motion<T>) {
        if c < 3 {
            set_column(&mut self.0.mass, c, row.angular);
            for i in 0..3 {
                self.0.coupling.0[i][c] = row.linear.0[i];
            }
        } else {
            set_column(&mut self.0.inertia, c - 3, row.linear);
            self.0.coupling.0[c - 3] = row.angular.0;
        }
    }
    /// (I − G H)* Y (I − G H) + H* D⁻¹ H for component c.
    #[inline(always)]
    fn pass(&mut self, c: usize, pivot: &Pivot<T>) {
        let mut G = pivot.gain;
        if c < 3 {
            G.moment.0[c] = T::zero()
        } else {
            G.force.0[c - 3] = T::zero()
        }
        let y = self.times(G);
        let (mut row, diagonal) = (-y, pivot.inverse + y.dot(G));
        if c < 3 {
            row.angular.0[c] = diagonal
        } else {
            row.linear.0[c - 3] = diagonal
        }
        self.set(c, &row);
    }
    /// The same for any axis.
    #[inline(always)]
    fn pass_axis(&mut self, axis: Motion<T>, pivot: &Pivot<T>) {
        let y = self.times(pivot.gain);
        let half = (pivot.inverse + y.dot(pivot.gain)) * T::splat(0.5);
        // − H* y* − y H + (G* Y G + D⁻¹) H* H as a symmetric product.
        let x = axis.scale_add(half, -y);
        self.add_symmetric(axis, x);
    }
    /// Y += a xᵀ + x aᵀ.
    #[inline(always)]
    pub(crate) fn add_symmetric(&mut self, a: Motion<T>, x: Motion<T>) {
        let outer = |m: &mut Sym3<T>, a: Vec3<T>, x: Vec3<T>| {
            m.add_product(a, x);
            m.add_product(x, a);
        };
        outer(&mut self.0.mass, a.angular, x.angular);
        outer(&mut self.0.inertia, a.linear, x.linear);
        for i in 0..3 {
            for j in 0..3 {
                let entry = &mut self.0.coupling.0[i][j];
                *entry = a.linear.0[i].fma(x.angular.0[j], x.linear.0[i].fma(a.angular.0[j], *entry));
            }
        }
    }
    /// Y of a body from Y⁺ at its joint.
    #[inline(always)]
    pub(crate) fn through(mut self, body: &LayoutBody<T::Constant>, pivots: &[Pivot<T>]) -> Self {
        let pivots = &pivots[..body.hinge.nv()];
        each_component!(
            reversed body.hinge,
            |I, C| self.pass(C, &pivots[I]),
            self.pass_axis(body.hinge.axis(0), &pivots[0])
        );
        self
    }
}

#[inline(always)]
fn set_column<T: Scalar>(m: &mut Sym3<T>, j: usize, Vec3([x, y, z]): Vec3<T>) {
    match j {
        0 => (m.xx, m.xy, m.xz) = (x, y, z),
        1 => (m.xy, m.yy, m.yz) = (x, y, z),
        _ => (m.xz, m.yz, m.zz) = (x, y, z),
    }
}

/// Y of all bodies of a layout, each in its own frame.
#[derive(Clone, Debug)]
pub struct Upsilon<T: Scalar> {
    factors: ArticulatedSweep<T>,
    Y: Vec<Compliance<T::Arithmetic>>,
}

impl<T: Scalar> Upsilon<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let Y = vec![Compliance::zero(); layout.len()];
        Upsilon { factors: ArticulatedSweep::empty(layout), Y }
    }
    /// Y of every body.
    ///
    /// # Computes
    /// Y(k) = ψ*(p,k) Y(p) ψ(p,k) + H* D⁻¹ H: the acceleration α = Y f that a wrench f on body k alone gives to it, at rest and
    /// without weight. On chains and trees it is the diagonal block of Ω; blocks of two bodies need their common ancestor
    /// (soa.md 3.2).
    ///
    /// # Shapes & units
    /// `q`: nq; `out`: 36 numbers for each body of the model, by rows, angular first; 1/(kg·m²), 1/(kg·m), 1/kg. Zero for
    /// bodies that are fixed to the world.
    ///
    /// # Frames
    /// The user's frame of each body: origin and axes.
    ///
    /// # Method
    /// Paper 1 (10.2), paper 2 (4.18) as the recursion for diagonal blocks.
    ///
    /// # Cost
    /// O(n): the articulated sweep inward and one sweep outward; no allocation.
    ///
    /// # Accuracy
    /// n·ε·κ times what the articulated sweep loses where heavy bodies hang on light ones (`forward_info`).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`], [`DynamicsError::SingularHinge`].
    pub fn run(&mut self, layout: &Layout<T::Constant>, q: &[T], out: &mut [T]) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        layout.check_rigid("upsilon")?;
        check_length("q", q, layout.nq())?;
        check_length("out", out, 36 * layout.model_bodies())?;
        check_length("workspace", &self.Y, layout.len())?;
        let (q, out) = (T::arithmetic(q), T::arithmetic_mut(out));
        T::Arithmetic::dispatch(Sweeps { work: self, layout, q, out })
    }
    /// Y of every body of the layout at another configuration, for [`Upsilon::acceleration`] and [`Upsilon::filter`]; nothing is
    /// written out.
    ///
    /// # Errors
    /// As [`Upsilon::run`].
    pub fn update(&mut self, layout: &Layout<T::Constant>, q: &[T]) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        layout.check_rigid("upsilon")?;
        check_length("q", q, layout.nq())?;
        check_length("workspace", &self.Y, layout.len())?;
        T::Arithmetic::dispatch(Sweeps { work: self, layout, q: T::arithmetic(q), out: &mut [] })
    }
    /// Y(k) f: the acceleration that a wrench on body `k` of the layout alone gives to it; both in the body's frame. Zero on the
    /// ground.
    #[inline(always)]
    pub fn acceleration(&self, k: usize, f: Wrench<T::Arithmetic>) -> Motion<T::Arithmetic> {
        self.Y.get(k).map_or(Motion::zero(), |Y| Y.times(f))
    }
    /// The filter at the joint of body `k` of the layout: φ(p,k) (z + G ε) in the frame of its parent p, with ε = T − H z;
    /// zero if that is the ground. `residuals`, at least the joint's degrees of freedom, holds T before and D⁻¹ ε after. With
    /// T = 0 it is ψ(p,k) z.
    #[inline(always)]
    pub fn filter(
        &self,
        layout: &Layout<T::Constant>,
        k: usize,
        mut z: Wrench<T::Arithmetic>,
        residuals: &mut [T::Arithmetic],
    ) -> Wrench<T::Arithmetic> {
        let Some(body) = layout.bodies.get(k) else { return Wrench::zero() };
        let count = body.hinge.nv();
        let pivots = self.factors.pivots.get(body.v..body.v + count);
        if let (Some(pivots), Some(residuals)) = (pivots, residuals.get_mut(..count)) {
            filter(&body.hinge, pivots, &mut z, residuals);
        }
        if body.parent == GROUND {
            return Wrench::zero();
        }
        self.factors.shifts.at(k, body).wrench_to_parent(z)
    }
}

kernel! {
    Sweeps<'a, T> {
        work: &'a mut Upsilon<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        out: &'a mut [T::Arithmetic],
    } -> Result<(), DynamicsError> {
        let Upsilon { factors, Y } = work;
        factors.sweep_inboard(layout, q, |_, _| {})?;
        for (k, body) in layout.bodies.iter().enumerate() {
            let inboard = match body.parent {
                GROUND => Compliance::zero(),
                p => Compliance(factors.shifts.at(k, body).compliance_to_child(&Y[p].0)),
            };
            Y[k] = inboard.through(body, &factors.pivots[body.v..]);
        }
        for (carrier, out) in layout.carriers.iter().zip(out.chunks_exact_mut(36)) {
            match carrier.body {
                GROUND => out.fill(T::Arithmetic::zero()),
                k => Y[k].at(&Transform::constant(&carrier.pose)).write(out),
            }
        }
        Ok(())
    }
}

/// [`Upsilon::run`] for a single call: one 6×6 matrix for every body of the model.
///
/// # Errors
/// As there.
///
/// # Example
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
/// use phipsi_recursion::{Layout, upsilon};
/// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
/// let model = ModelBuilder::new("pendulum")
///     .body(Body::new("rod", rod))
///     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
///     .build()?;
/// let compliance = &upsilon::<f64>(&Layout::new(&model), &[0.4])?[0];
/// assert!((compliance[1][1] - 3.0).abs() < 1e-14); // 1/D of a rod about its end
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn upsilon<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<Vec<[[T; 6]; 6]>, DynamicsError> {
    let mut out = vec![T::zero(); 36 * layout.model_bodies()];
    Upsilon::new(layout).run(layout, q, &mut out)?;
    let blocks = out.chunks_exact(36);
    Ok(blocks.map(|b| std::array::from_fn(|i| std::array::from_fn(|j| b[6 * i + j]))).collect())
}
