//! The inertia that a tip shows to whoever pushes it.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | B | pick-off of a point of a body, world axes | | paper 2, section 2.7 |
//! | N | D^(−½) H ψ B: one filter of six unit wrenches along the path to the base | path×6 | soa.md 2.5, 3.5 |
//! | Λ⁻¹ | B* Ω B = J M⁻¹ J* = N* N: Υ of the body, at the point | 6×6 | soa.md 3.5 |
//! | Λ | its inverse, the operational-space inertia | 6×6 | |
//! | ℓ | radius that makes angular and linear motions comparable: ℓ² = tr(linear block)/tr(angular block) of Λ⁻¹ | m | |
//! | W | diag(ℓ, ℓ, ℓ, 1, 1, 1) | 6×6 | |
//! | σ, V | singular values and right vectors of N W | 6, 6×6 | |
//!
//! Λ = W V σ⁻² V* W over the singular values that are not zero. The factor N is never squared, so that directions with σ as
//! small as rounding are told from immovable ones; those of N* N would be lost below its root.

use crate::articulated_sweep::{ArticulatedSweep, filter};
use crate::error::{DynamicsError, check_length};
use crate::kernel::kernel;
use crate::kinematics::body_pose;
use crate::layout::{GROUND, Layout};
use crate::singular_values::{orthogonalize, rank, rounding};
use num_traits::Zero;
use phipsi_spatial::{Real, Scalar, Transform, Vec3, Wrench};

/// What decided about an operational-space inertia.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OperationalSpaceInfo {
    /// σ of N W, falling, kg^(−½): how easily the six principal directions move.
    pub singular_values: [f64; 6],
    /// How many of them count; the others are directions in which the point cannot move.
    pub rank: usize,
    /// Largest over smallest of those that count; Λ loses the square of it. 1 if none counts.
    pub condition: f64,
    /// ℓ, m: the radius at which angular motions count as linear ones.
    pub length: f64,
}

/// Workspace of the operational-space inertia.
#[derive(Clone, Debug)]
pub struct OperationalSpaceInertia<T: Scalar> {
    factors: ArticulatedSweep<T>,
    /// Columns of N.
    columns: Vec<T>,
    /// ν of one joint.
    residuals: [T::Arithmetic; 6],
}

impl<T: Real> OperationalSpaceInertia<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T>) -> Self {
        OperationalSpaceInertia {
            factors: ArticulatedSweep::empty(layout),
            columns: vec![T::zero(); 6 * layout.nv()],
            residuals: [T::Arithmetic::zero(); 6],
        }
    }
    /// Λ at a point of a body, and what decided about it.
    ///
    /// # Computes
    /// Λ = (B* Ω B)⁻¹ = (J M⁻¹ J*)⁻¹: the wrench Λ a on the body accelerates it by a, at rest and without weight. Where the
    /// point cannot move in all directions, the pseudo-inverse in the metric of W: Λ a is the least wrench (moments counted
    /// in units of ℓ) for accelerations that are possible, and for others what their nearest possible one needs.
    ///
    /// # Shapes & units
    /// `q`: nq; `body`: `None` is the world, whose Λ is zero; `point`: in the body's frame, m (`None`: its origin);
    /// `out`: 36 numbers by rows, angular rows first: kg·m², kg·m, kg.
    ///
    /// # Frames
    /// World axes, at the point.
    ///
    /// # Method
    /// Paper 2 (4.18)–(4.21) corrected in soa.md 3.5; singular values by one-sided Jacobi rotations. A singular value counts if
    /// it is above 64 n ε times the largest, n counting the degrees of freedom on the path.
    ///
    /// # Cost
    /// O(n) for the articulated sweep, O(depth) for the rest; no allocation.
    ///
    /// # Accuracy
    /// n·ε·`condition`², and what the articulated sweep loses where heavy bodies hang on light ones (`forward_info`).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Body`], [`DynamicsError::Closure`], [`DynamicsError::SingularHinge`];
    /// [`DynamicsError::NotFinite`] for inputs that are not finite.
    pub fn run(
        &mut self,
        layout: &Layout<T>,
        q: &[T],
        body: Option<usize>,
        point: Option<Vec3<T>>,
        out: &mut [T],
    ) -> Result<OperationalSpaceInfo, DynamicsError> {
        layout.check_closures()?;
        layout.check_rigid("operational_space_inertia")?;
        check_length("q", q, layout.nq())?;
        check_length("out", out, 36)?;
        check_length("workspace", &self.columns, 6 * layout.nv())?;
        out.fill(T::zero());
        let Some(body) = body else { return Ok(immovable()) };
        let pose = body_pose(layout, q, Some(body))?;
        self.factors.update(layout, q)?;
        let mut wrenches = [Wrench::zero(); 6];
        for (j, wrench) in wrenches.iter_mut().enumerate() {
            let unit = Wrench::<T>::unit(j);
            let force = pose.rotation.transpose_mul(unit.force);
            let moment = pose.rotation.transpose_mul(unit.moment);
            let lever = point.unwrap_or(Vec3::zero());
            *wrench = Wrench::new(moment + lever.cross(force), force);
        }
        let length = T::Arithmetic::dispatch(Path::<T> { work: self, layout, body, wrenches });
        let columns = &mut self.columns[..6 * length];
        if let Some(index) = columns.iter().position(|x| !x.is_finite()) {
            return Err(DynamicsError::NotFinite { index, found: columns[index].to_f64() });
        }
        Ok(invert(columns, length, out))
    }
}

fn immovable() -> OperationalSpaceInfo {
    OperationalSpaceInfo { singular_values: [0.0; 6], rank: 0, condition: 1.0, length: 1.0 }
}

/// (N* N)⁺ from the columns of N.
fn invert<T: Real>(columns: &mut [T], length: usize, out: &mut [T]) -> OperationalSpaceInfo {
    if length == 0 {
        return immovable();
    }
    let square = |x: &[T]| x.iter().fold(T::zero(), |sum, x| *x * *x + sum);
    let (angular, linear) = columns.split_at(3 * length);
    let (angular, linear) = (square(angular), square(linear));
    let radius =
        if angular.is_positive() && linear.is_positive() { (linear / angular).sqrt() } else { T::one() };
    columns[..3 * length].iter_mut().for_each(|x| *x *= radius);
    let (mut v, mut sigma) = ([T::zero(); 36], [T::zero(); 6]);
    orthogonalize(columns, length, &mut v, &mut sigma);
    let rank = rank(&sigma, rounding::<T>(length));
    let weight = |i: usize| if i < 3 { radius } else { T::one() };
    for k in 0..rank {
        let inverse = (sigma[k] * sigma[k]).recip();
        for i in 0..6 {
            for j in 0..6 {
                out[6 * i + j] += v[6 * k + i] * weight(i) * inverse * (v[6 * k + j] * weight(j));
            }
        }
    }
    let condition = if rank == 0 { 1.0 } else { (sigma[0] / sigma[rank - 1]).to_f64() };
    OperationalSpaceInfo {
        singular_values: sigma.map(|s| s.to_f64()),
        rank,
        condition,
        length: radius.to_f64(),
    }
}

kernel! {
    Path<'a, T> {
        work: &'a mut OperationalSpaceInertia<T>,
        layout: &'a Layout<T::Constant>,
        body: usize,
        // At the origin of the user's body frame, its axes.
        wrenches: [Wrench<T>; 6],
    } -> usize {
        let OperationalSpaceInertia { factors, columns, residuals } = work;
        let carrier = &layout.carriers[body];
        let mut length = 0;
        let mut k = carrier.body;
        while k != GROUND {
            length += layout.bodies[k].hinge.nv();
            k = layout.bodies[k].parent;
        }
        for (column, wrench) in columns.chunks_exact_mut(length.max(1)).zip(wrenches) {
            let mut z = Transform::constant(&carrier.pose).wrench_to_parent(wrench.map(T::to_arithmetic));
            let (mut row, mut k) = (0, carrier.body);
            while k != GROUND {
                let body = &layout.bodies[k];
                let count = body.hinge.nv();
                let pivots = &factors.pivots[body.v..body.v + count];
                let residuals = &mut residuals[..count];
                residuals.fill(T::Arithmetic::zero());
                filter(&body.hinge, pivots, &mut z, residuals);
                for (nu, pivot) in residuals.iter().zip(pivots) {
                    column[row] = T::from_arithmetic(*nu / pivot.inverse.sqrt());
                    row += 1;
                }
                z = factors.shifts.at(k, body).wrench_to_parent(z);
                k = body.parent;
            }
        }
        length
    }
}

/// [`OperationalSpaceInertia::run`] for a single call.
///
/// # Errors
/// As there.
///
/// # Example
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
/// use phipsi_recursion::{Layout, operational_space_inertia};
/// use phipsi_spatial::Vec3;
/// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
/// let model = ModelBuilder::new("pendulum")
///     .body(Body::new("rod", rod))
///     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
///     .build()?;
/// let tip = Some(Vec3([1.0, 0.0, 0.0]));
/// let (inertia, info) = operational_space_inertia(&Layout::<f64>::new(&model), &[0.0], Some(0), tip)?;
/// assert_eq!(info.rank, 1); // a rod on a hinge moves in one way only
/// assert!(inertia[5][5] > 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn operational_space_inertia<T: Real>(
    layout: &Layout<T>,
    q: &[T],
    body: Option<usize>,
    point: Option<Vec3<T>>,
) -> Result<([[T; 6]; 6], OperationalSpaceInfo), DynamicsError> {
    let mut out = [T::zero(); 36];
    let info = OperationalSpaceInertia::new(layout).run(layout, q, body, point, &mut out)?;
    Ok((std::array::from_fn(|i| std::array::from_fn(|j| out[6 * i + j])), info))
}
