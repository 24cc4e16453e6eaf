//! The gradient of ln det M(q), all components in two sweeps.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | P⁺ | (I − G H) P, inertia outboard of the joint, on its inboard side | 6×6 | paper 1 (9.7) |
//! | Y⁺ | φ*(p,k) Y(p) φ(p,k), compliance inboard of the joint, joint frozen: [`crate::upsilon`](mod@crate::upsilon) | 6×6 | soa.md 3.2 |
//! | S, S~ | axis of a degree of freedom, and its cross product on wrenches | 6, 6×6 | soa.md 3.0 |
//! | g | the wrench with ∂ ln det M/∂q_j = S_j · g: g = 2 (x(P⁺Y⁺)₁₁ + x(P⁺Y⁺)₂₂, x(P⁺Y⁺)₂₁) | 6 | soa.md 3.9 |
//! | x(A) | (A₁₂ − A₂₁, A₂₀ − A₀₂, A₀₁ − A₁₀): tr(ω~ A) = ω · x(A) | 3 | |
//!
//! ∂ ln det M/∂q_j = 2 tr(Y⁺ S~ P⁺): paper 2, section 4.5, with the trace of soa.md 3.9. The trace is linear in S, so that one
//! wrench serves all degrees of freedom of a joint.

use crate::articulated_sweep::{ArticulatedSweep, Pivot};
use crate::error::{DynamicsError, check_length};
use crate::hinge::{Hinge, each_component};
use crate::kernel::kernel;
use crate::layout::{GROUND, Layout, LayoutBody};
use crate::upsilon::Compliance;
use num_traits::Zero;
use phipsi_spatial::{ArticulatedInertia, Mat3, Scalar, Vec3, Wrench};

/// Workspace of the gradient.
#[derive(Clone, Debug)]
pub struct LogDeterminantGradient<T: Scalar> {
    factors: ArticulatedSweep<T>,
    P: Vec<ArticulatedInertia<T::Arithmetic>>,
    /// Y of bodies with several children.
    Y: Vec<Compliance<T::Arithmetic>>,
}

impl<T: Scalar> LogDeterminantGradient<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        LogDeterminantGradient {
            factors: ArticulatedSweep::empty(layout),
            P: vec![ArticulatedInertia::zero(); layout.len()],
            Y: vec![Compliance::zero(); layout.len()],
        }
    }
    /// The factors of M at the configuration of the last run: ln det M, products with M⁻¹ and its roots.
    pub fn factors(&self) -> &ArticulatedSweep<T> {
        &self.factors
    }
    /// All ∂ ln det M/∂q_j.
    ///
    /// # Computes
    /// 2 tr(Y⁺ S~ P⁺) for every degree of freedom. The generalised force of the potential −½ kT ln det M is half of it times kT;
    /// Fixman's potential is +½ kT ln det M, its force −½ kT times the gradient.
    ///
    /// # Shapes & units
    /// `q`: nq; `out`: nv, 1/rad or 1/m, along the increments of `Model::integrate`: velocities in body axes for ball, planar and
    /// free joints.
    ///
    /// # Method
    /// Jain and Rodriguez, paper 2, section 4.5; soa.md 3.9. Zero for joints of roots and for free joints.
    ///
    /// # Cost
    /// O(n): the articulated sweep inward and one sweep outward; no allocation. No derivative of an operator is formed.
    ///
    /// # Accuracy
    /// n·ε times the size of the products in the trace, and what the articulated sweep loses where heavy bodies hang on light
    /// ones (`forward_info`).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`], [`DynamicsError::SingularHinge`].
    pub fn run(&mut self, layout: &Layout<T::Constant>, q: &[T], out: &mut [T]) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        layout.check_rigid("log_determinant_gradient")?;
        check_length("q", q, layout.nq())?;
        check_length("out", out, layout.nv())?;
        check_length("workspace", &self.P, layout.len())?;
        let (q, out) = (T::arithmetic(q), T::arithmetic_mut(out));
        T::Arithmetic::dispatch(Sweeps { work: self, layout, q, out })
    }
}

kernel! {
    Sweeps<'a, T> {
        work: &'a mut LogDeterminantGradient<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        out: &'a mut [T::Arithmetic],
    } -> Result<(), DynamicsError> {
        let LogDeterminantGradient { factors, P, Y } = work;
        factors.sweep_inboard(layout, q, |k, inertia| P[k] = *inertia)?;
        let mut previous = Compliance::zero();
        for (k, body) in layout.bodies.iter().enumerate() {
            let pivots = &factors.pivots[body.v..body.v + body.hinge.nv()];
            let gradient = &mut out[body.v..body.v + body.hinge.nv()];
            if body.parent == GROUND {
                gradient.fill(T::Arithmetic::zero());
                previous = Compliance::zero().through(body, pivots);
            } else {
                let inboard = if body.follows_parent(k) { previous } else { Y[body.parent] };
                let inboard = Compliance(factors.shifts.at(k, body).compliance_to_child(&inboard.0));
                differentiate(body, &P[k], pivots, &inboard, gradient);
                previous = inboard.through(body, pivots);
            }
            if body.children > 1 {
                Y[k] = previous;
            }
        }
        Ok(())
    }
}

/// The components of one joint, from P before its elimination and Y⁺.
#[inline(always)]
fn differentiate<T: Scalar>(
    body: &LayoutBody<T::Constant>,
    P: &ArticulatedInertia<T>,
    pivots: &[Pivot<T>],
    Y: &Compliance<T>,
    gradient: &mut [T],
) {
    match body.hinge {
        Hinge::Revolute => gradient[0] = revolute(P, &pivots[0], Y),
        // Nothing outboard answers to what is inboard.
        Hinge::Free => gradient.fill(T::zero()),
        _ => {
            let mut through = *P;
            each_component!(
                body.hinge,
                |I, C| {
                    let column = through.column(C);
                    through.subtract_outer(pivots[I].gain, column);
                },
                {
                    let column = through.times(body.hinge.axis(0));
                    through.subtract_outer(pivots[0].gain, column);
                }
            );
            let g = wrench(&through, Y);
            each_component!(
                body.hinge,
                |I, C| gradient[I] = g.get(C),
                gradient[0] = body.hinge.project(0, &g)
            );
        }
    }
}

/// 2 x(A).z of P⁺ Y⁺ for a hinge about z: rows and columns z of J⁺ and row z of C⁺ are zero.
#[inline(always)]
fn revolute<T: Scalar>(P: &ArticulatedInertia<T>, pivot: &Pivot<T>, Y: &Compliance<T>) -> T {
    let (J, C, [gx, gy, _], g) = (&P.inertia, &P.coupling.0, pivot.gain.moment.0, pivot.gain.force);
    let (A, B, L) = (&Y.0.mass, &Y.0.coupling.0, &Y.0.inertia);
    let force = Vec3(C[2]);
    let [xx, xy, yy] = [(-gx).fma(J.xz, J.xx), (-gx).fma(J.yz, J.xy), (-gy).fma(J.yz, J.yy)];
    let (c, d) = (force.scale_add(-gx, Vec3(C[0])), force.scale_add(-gy, Vec3(C[1])));
    let mut m = P.mass;
    m.add_product(-g, force);
    let (first, second) = (Vec3([B[0][0], B[1][0], B[2][0]]), Vec3([B[0][1], B[1][1], B[2][1]]));
    let angular = xx.fma(A.xy, xy.fma(A.yy - A.xx, -(yy * A.xy))) + c.dot(second) - d.dot(first);
    let across = c.0[0].fma(B[1][0], d.0[0] * B[1][1]) - c.0[1].fma(B[0][0], d.0[1] * B[0][1]);
    let linear = m.column(0).dot(L.column(1)) - m.column(1).dot(L.column(0));
    let half = angular + across + linear;
    half + half
}

/// g of a joint from P⁺ and Y⁺.
#[inline(always)]
fn wrench<T: Scalar>(P: &ArticulatedInertia<T>, Y: &Compliance<T>) -> Wrench<T> {
    let (J, C, m) = (P.inertia.to_mat3(), P.coupling, P.mass.to_mat3());
    let (A, B, L) = (Y.0.mass.to_mat3(), Y.0.coupling, Y.0.inertia.to_mat3());
    let diagonal = J * A + C * B + C.transpose() * B.transpose() + m * L;
    let moment = axial(&diagonal);
    let force = axial(&(C.transpose() * A + m * B));
    Wrench::new(moment + moment, force + force)
}

/// x(A).
#[inline(always)]
fn axial<T: Scalar>(A: &Mat3<T>) -> Vec3<T> {
    let [a, b, c] = A.0;
    Vec3([b[2] - c[1], c[0] - a[2], a[1] - b[0]])
}

/// [`LogDeterminantGradient::run`] for a single call.
///
/// # Errors
/// As there.
///
/// # Example
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder, Placement};
/// use phipsi_recursion::{Layout, log_determinant_gradient};
/// // Two equal rods: det M = J₁ D, least when they are stretched.
/// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
/// let hinge = JointKind::Revolute { axis: [0.0, 1.0, 0.0] };
/// let model = ModelBuilder::new("double pendulum")
///     .body(Body::new("upper", rod))
///     .body(Body::new("lower", rod))
///     .joint(Joint::new("shoulder", hinge), "world", "upper")
///     .joint(Joint::new("elbow", hinge).at(Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3])), "upper", "lower")
///     .build()?;
/// let gradient = log_determinant_gradient(&Layout::<f64>::new(&model), &[0.2, 0.5])?;
/// let (s, c) = 0.5f64.sin_cos();
/// assert_eq!(gradient[0], 0.0);
/// assert!((gradient[1] - 2.0 * 0.25 * s * c / (4.0 / 9.0 - 0.25 * c * c)).abs() < 1e-14);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn log_determinant_gradient<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    LogDeterminantGradient::new(layout).run(layout, q, &mut out)?;
    Ok(out)
}
