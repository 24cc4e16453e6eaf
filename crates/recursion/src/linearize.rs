//! The dynamics linearised about a state.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | δq, δv | deviation from the motion through (q, v): `difference`(q̄, q), v − v̄ | nv | |
//! | A | ∂(δq̇, δv̇)/∂(δq, δv) = (−ad(v), I; ∂θ̈/∂q, ∂θ̈/∂v) | 2nv×2nv | |
//! | B | ∂(δq̇, δv̇)/∂τ = (0; M⁻¹) | 2nv×nv | |
//! | ad(v) | of each joint: its own velocity's cross product on increments in body axes; zero for joints that add their increments | nv×nv | |
//!
//! With q = q̄ ∘ τ(δq) and both moving, δq̇ = δv − ad(v̄) δq + O(2): increments are seen from a frame that turns.

use crate::error::{DynamicsError, check_length};
use crate::forward_dynamics_derivatives::ForwardDynamicsDerivatives;
use crate::hinge::Hinge;
use crate::layout::Layout;
use phipsi_spatial::{Motion, Real, Scalar, Wrench};

/// Workspace of the linearisation.
#[derive(Clone, Debug)]
pub struct Linearization<T: Scalar> {
    derivatives: ForwardDynamicsDerivatives<T>,
    d_dq: Vec<T>,
    d_dv: Vec<T>,
    d_dtau: Vec<T>,
}

impl<T: Scalar> Linearization<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let square = vec![T::zero(); layout.nv() * layout.nv()];
        Linearization {
            derivatives: ForwardDynamicsDerivatives::new(layout),
            d_dq: square.clone(),
            d_dv: square.clone(),
            d_dtau: square,
        }
    }
    /// A and B with δẋ = A δx + B δτ, x = (δq, δv).
    ///
    /// # Computes
    /// The first order of the deviation of a motion from the one through (q, v) under the same forces but for δτ. At rest, and
    /// for joints whose q are numbers, the upper left block is zero; ball, planar and free joints add −ad(v).
    ///
    /// # Shapes & units
    /// `q`: nq; `v`, `tau`: nv; `wrenches`: one per body of the model, at its frame's origin, its axes, which stay in them;
    /// `a`: 2nv×2nv, `b`: 2nv×nv, by rows. δq in the increments of `Model::integrate`.
    ///
    /// # Method
    /// [`ForwardDynamicsDerivatives`]; no differences.
    ///
    /// # Cost
    /// That of the derivatives, and 6 nv² numbers written; no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`], [`DynamicsError::SingularHinge`].
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        tau: &[T],
        wrenches: Option<&[Wrench<T>]>,
        a: &mut [T],
        b: &mut [T],
    ) -> Result<(), DynamicsError> {
        let nv = layout.nv();
        check_length("a", a, 4 * nv * nv)?;
        check_length("b", b, 2 * nv * nv)?;
        check_length("workspace", &self.d_dq, nv * nv)?;
        let Linearization { derivatives, d_dq, d_dv, d_dtau } = self;
        derivatives.run(layout, q, v, tau, wrenches, d_dq, d_dv, d_dtau)?;
        a.fill(T::zero());
        b.fill(T::zero());
        let (upper, lower) = a.split_at_mut(2 * nv * nv);
        for i in 0..nv {
            upper[2 * nv * i + nv + i] = T::one();
            let (left, right) = lower[2 * nv * i..2 * nv * (i + 1)].split_at_mut(nv);
            left.copy_from_slice(&d_dq[nv * i..nv * (i + 1)]);
            right.copy_from_slice(&d_dv[nv * i..nv * (i + 1)]);
        }
        b[nv * nv..].copy_from_slice(d_dtau);
        for body in layout.bodies() {
            if !matches!(body.hinge, Hinge::Planar | Hinge::Spherical | Hinge::Free) {
                continue;
            }
            let velocity: Motion<T> = body.hinge.expand(&v[body.v..]);
            for j in 0..body.hinge.nv() {
                let column = velocity.cross_motion(body.hinge.axis(j));
                for (i, &c) in body.hinge.components().iter().enumerate() {
                    upper[2 * nv * (body.v + i) + body.v + j] = -column.get(c);
                }
            }
        }
        Ok(())
    }
}

/// [`Linearization::run`] for a single call: A and B by rows.
///
/// # Errors
/// As there.
///
/// # Example
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
/// use phipsi_recursion::{Layout, linearize};
/// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
/// let model = ModelBuilder::new("pendulum")
///     .body(Body::new("rod", rod))
///     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
///     .gravity([0.0, 0.0, -9.81])
///     .build()?;
/// let hanging = [std::f64::consts::FRAC_PI_2];
/// let (a, b) = linearize(&Layout::<f64>::new(&model), &hanging, &[0.0], &[0.0], None)?;
/// assert!((a[2] + 1.5 * 9.81).abs() < 1e-13); // −(3/2) g/l, the square of the frequency
/// assert!((b[1] - 3.0).abs() < 1e-14);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn linearize<T: Real>(
    layout: &Layout<T>,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<(Vec<T>, Vec<T>), DynamicsError> {
    let nv = layout.nv();
    let (mut a, mut b) = (vec![T::zero(); 4 * nv * nv], vec![T::zero(); 2 * nv * nv]);
    Linearization::new(layout).run(layout, q, v, tau, wrenches, &mut a, &mut b)?;
    Ok((a, b))
}
