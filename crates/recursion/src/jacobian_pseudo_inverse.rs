//! Generalised inverse of the Jacobian of one or several tips.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | J | B* φ* H*, six rows for each tip | 6t×nv | paper 2 (4.8) |
//! | Q(k) | φ*(p,k) Q(p) φ(p,k) + H* H, diagonal blocks of φ* H* H φ; zero on the ground | 6×6 | paper 2 (4.10) |
//! | J J* | B* Q B; block (i, j) is B_i* φ*(a,i) Q(a) φ(a,j) B_j, a the lowest common ancestor, 0 if there is none | 6t×6t | (4.9), corrected in soa.md 3.2, 3.5 |
//! | W | diag(ℓ, ℓ, ℓ, 1, 1, 1) for each tip: angular rows count at the radius ℓ | 6t×6t | |
//! | σ, U, V | singular values and vectors of W J = U σ V* | | |
//! | J⁺ | J* (J J*)⁻¹ where J has full row rank; else V σ⁺ U* W | nv×6t | (4.8) |
//!
//! J J* has the squares of the singular values: near a singular configuration it loses twice the digits, and it is singular
//! for every arm of fewer than six degrees of freedom. The inverse goes by the singular values of J itself.

use crate::error::{DynamicsError, check_length};
use crate::jacobian::Jacobian;
use crate::kinematics::body_pose;
use crate::layout::{GROUND, Layout};
use crate::singular_values::{dot, orthogonalize, rank, rounding};
use crate::upsilon::Compliance;
use phipsi_spatial::{Real, Transform, Vec3, Wrench};

/// A point of a body that is to move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tip<T> {
    /// The body; `None` is the world, which does not move.
    pub body: Option<usize>,
    /// The point in the body's frame, m; `None` is its origin.
    pub point: Option<Vec3<T>>,
}

/// How small singular values are dealt with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PseudoInverseOptions {
    /// Singular values below this part of the largest count as zero; `None`: 64 n ε, the rounding of J.
    pub rank_tolerance: Option<f64>,
    /// λ: σ⁺ = σ/(σ² + λ²), so that no rate exceeds |x|/2λ; in units of σ. Zero for the pseudo-inverse itself.
    pub damping: f64,
    /// ℓ, m: the radius at which angular rows count. It matters for ranks, damping, and where not all of x can be had.
    pub length: f64,
}

impl Default for PseudoInverseOptions {
    fn default() -> Self {
        PseudoInverseOptions { rank_tolerance: None, damping: 0.0, length: 1.0 }
    }
}

/// Workspace of the generalised inverse.
#[derive(Clone, Debug)]
pub struct JacobianPseudoInverse<T: phipsi_spatial::Scalar> {
    jacobian: Jacobian<T>,
    nv: usize,
    rows: usize,
    options: PseudoInverseOptions,
    /// Six rows for each tip.
    matrix: Vec<T>,
    /// Rows of W J or its columns, whichever are fewer, made orthogonal.
    vectors: Vec<T>,
    /// The rotations that did.
    rotations: Vec<T>,
    sigma: Vec<T>,
    rank: usize,
    weighted: Vec<T>,
}

impl<T: Real> JacobianPseudoInverse<T> {
    /// A workspace for a layout and a number of tips.
    pub fn new(layout: &Layout<T>, tips: usize) -> Self {
        let (nv, rows) = (layout.nv(), 6 * tips);
        let few = nv.min(rows);
        JacobianPseudoInverse {
            jacobian: Jacobian::new(layout),
            nv,
            rows,
            options: PseudoInverseOptions::default(),
            matrix: vec![T::zero(); rows * nv],
            vectors: vec![T::zero(); rows * nv],
            rotations: vec![T::zero(); few * few],
            sigma: vec![T::zero(); few],
            rank: 0,
            weighted: vec![T::zero(); rows],
        }
    }
    /// Singular values of W J at a configuration: what [`Self::solve`] works with. `q`: nq; `tips`: as many as the workspace
    /// was made for. Cost O(t² nv) for t tips, no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn update(
        &mut self,
        layout: &Layout<T>,
        q: &[T],
        tips: &[Tip<T>],
        options: PseudoInverseOptions,
    ) -> Result<(), DynamicsError> {
        self.load(layout, q, tips, options)?;
        self.decompose();
        Ok(())
    }
    /// J alone.
    pub(crate) fn load(
        &mut self,
        layout: &Layout<T>,
        q: &[T],
        tips: &[Tip<T>],
        options: PseudoInverseOptions,
    ) -> Result<(), DynamicsError> {
        check_length("tips", tips, self.rows / 6)?;
        check_length("workspace", &self.matrix, self.rows * layout.nv())?;
        for (tip, rows) in tips.iter().zip(self.matrix.chunks_exact_mut((6 * self.nv).max(1))) {
            self.jacobian.run(layout, q, tip.body, tip.point, rows)?;
        }
        self.options = options;
        Ok(())
    }
    /// J of the last update by rows, and for the caller to change before [`Self::decompose`].
    pub(crate) fn matrix_mut(&mut self) -> &mut [T] {
        &mut self.matrix
    }
    /// Singular values of W J as it stands.
    pub(crate) fn decompose(&mut self) {
        let (nv, rows) = (self.nv, self.rows);
        let length = T::splat(self.options.length);
        for (r, row) in self.matrix.chunks_exact(nv.max(1)).enumerate() {
            let weight = if r % 6 < 3 { length } else { T::one() };
            for (c, x) in row.iter().enumerate() {
                let at = if rows <= nv { r * nv + c } else { c * rows + r };
                self.vectors[at] = *x * weight;
            }
        }
        orthogonalize(&mut self.vectors, nv.max(rows), &mut self.rotations, &mut self.sigma);
        let tolerance = self.options.rank_tolerance.unwrap_or(rounding::<T>(nv.max(rows)));
        self.rank = rank(&self.sigma, tolerance);
    }
    /// σ of W J at the last update, falling: as many as J has rows or columns, whichever are fewer; m.
    pub fn singular_values(&self) -> &[T] {
        &self.sigma
    }
    /// How many of them count.
    pub fn rank(&self) -> usize {
        self.rank
    }
    /// J⁺ x.
    ///
    /// # Computes
    /// V σ⁺ U* W x: the least joint rates (as numbers, rad/s and m/s alike) with J θ̇ = x, where all of x can be had, and else
    /// those whose motion is nearest to x in the metric of W. Under-determined, over-determined and singular arms alike. With
    /// damping λ: the rates that minimise |W (J θ̇ − x)|² + λ² |θ̇|².
    ///
    /// # Shapes & units
    /// `x`: (ω, velocity of the point) of each tip, world axes; `out`: nv.
    ///
    /// # Cost
    /// O(t nv); no allocation.
    ///
    /// # Accuracy
    /// ε times the largest over the smallest singular value that counts.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn solve(&mut self, x: &[T], out: &mut [T]) -> Result<(), DynamicsError> {
        check_length("x", x, self.rows)?;
        check_length("out", out, self.nv)?;
        let length = T::splat(self.options.length);
        for (r, (to, x)) in self.weighted.iter_mut().zip(x).enumerate() {
            *to = if r % 6 < 3 { length * *x } else { *x };
        }
        let square = T::splat(self.options.damping * self.options.damping);
        self.apply(square, out);
        Ok(())
    }
    /// V σ/(σ² + μ) U* y of y = W x.
    pub(crate) fn solve_weighted(&mut self, y: &[T], mu: T, out: &mut [T]) -> Result<(), DynamicsError> {
        check_length("y", y, self.rows)?;
        check_length("out", out, self.nv)?;
        self.weighted.copy_from_slice(y);
        self.apply(mu, out);
        Ok(())
    }
    /// |W J θ̇|².
    pub(crate) fn moved_square(&self, rates: &[T]) -> T {
        let length = T::splat(self.options.length);
        let rows = self.matrix.chunks_exact(self.nv.max(1)).enumerate();
        rows.fold(T::zero(), |sum, (r, row)| {
            let x = dot(row, rates) * if r % 6 < 3 { length } else { T::one() };
            x.fma(x, sum)
        })
    }
    fn apply(&self, square: T, out: &mut [T]) {
        let (nv, rows, few) = (self.nv, self.rows, self.sigma.len());
        out.fill(T::zero());
        for k in 0..self.rank {
            let (long, short) =
                (&self.vectors[k * nv.max(rows)..][..nv.max(rows)], &self.rotations[k * few..][..few]);
            // One of them is U or V, the other one σ times it.
            let (left, right) = if rows <= nv { (short, long) } else { (long, short) };
            let along = dot(left, &self.weighted) / (self.sigma[k] * self.sigma[k] + square);
            for (to, x) in out.iter_mut().zip(right) {
                *to += *x * along;
            }
        }
    }
}

/// J⁺ x of [`JacobianPseudoInverse::solve`] for a single call, with the singular values that decided and how many count.
///
/// # Errors
/// As there.
///
/// # Example
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
/// use phipsi_recursion::{Layout, PseudoInverseOptions, Tip, jacobian_pseudo_inverse};
/// use phipsi_spatial::Vec3;
/// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
/// let model = ModelBuilder::new("pendulum")
///     .body(Body::new("rod", rod))
///     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 0.0, 1.0] }), "world", "rod")
///     .build()?;
/// let tips = [Tip { body: Some(0), point: Some(Vec3([1.0, 0.0, 0.0])) }];
/// let motion = [0.0, 0.0, 2.0, 0.0, 2.0, 0.0]; // two radians a second
/// let (rates, sigma, rank) =
///     jacobian_pseudo_inverse(&Layout::<f64>::new(&model), &[0.0], &tips, &motion, PseudoInverseOptions::default())?;
/// assert!((rates[0] - 2.0).abs() < 1e-14 && rank == 1 && sigma.len() == 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn jacobian_pseudo_inverse<T: Real>(
    layout: &Layout<T>,
    q: &[T],
    tips: &[Tip<T>],
    x: &[T],
    options: PseudoInverseOptions,
) -> Result<(Vec<T>, Vec<T>, usize), DynamicsError> {
    let mut work = JacobianPseudoInverse::new(layout, tips.len());
    work.update(layout, q, tips, options)?;
    let mut out = vec![T::zero(); layout.nv()];
    work.solve(x, &mut out)?;
    Ok((out, work.sigma, work.rank))
}

/// J J* of one or several tips, 6t×6t by rows, world axes: the recursion for Q instead of the product.
///
/// `q`: nq. Cost O(n + t² depth). With units of metres and radians as they are.
///
/// # Errors
/// [`DynamicsError::Shape`].
pub fn jacobian_gram<T: Real>(layout: &Layout<T>, q: &[T], tips: &[Tip<T>]) -> Result<Vec<T>, DynamicsError> {
    check_length("q", q, layout.nq())?;
    let bodies = layout.bodies();
    let hinge: Vec<Transform<T>> = bodies.iter().map(|b| b.pose(q)).collect();
    let mut Q: Vec<Compliance<T>> = Vec::with_capacity(bodies.len());
    for (k, body) in bodies.iter().enumerate() {
        let mut own = match body.parent {
            GROUND => Compliance::zero(),
            p => Q[p].at(&hinge[k]),
        };
        for i in 0..body.hinge.nv() {
            let axis = body.hinge.axis::<T>(i);
            own.add_symmetric(axis, axis.scale(T::splat(0.5)));
        }
        Q.push(own);
    }
    let rows = 6 * tips.len();
    let mut out = vec![T::zero(); rows * rows];
    for (i, tip) in tips.iter().enumerate() {
        for (j, other) in tips.iter().enumerate().take(i + 1) {
            let (Some((mut a, mut left)), Some((mut b, mut right))) =
                (pick_off(layout, q, tip)?, pick_off(layout, q, other)?)
            else {
                continue;
            };
            // Bodies are numbered parents first: the later one cannot be an ancestor.
            while a != b && a != GROUND && b != GROUND {
                let (at, columns) = if a > b { (&mut a, &mut left) } else { (&mut b, &mut right) };
                *columns = columns.map(|z| hinge[*at].wrench_to_parent(z));
                *at = bodies[*at].parent;
            }
            if a != b || a == GROUND {
                continue;
            }
            for (c, z) in right.iter().enumerate() {
                let motion = Q[a].times(*z);
                for (r, w) in left.iter().enumerate() {
                    let x = motion.dot(*w);
                    out[(6 * i + r) * rows + 6 * j + c] = x;
                    out[(6 * j + c) * rows + 6 * i + r] = x;
                }
            }
        }
    }
    Ok(out)
}

/// A body of the layout, and six wrenches in its axes at its origin.
type PickOff<T> = (usize, [Wrench<T>; 6]);

/// The body of the layout that carries a tip, and unit wrenches at the tip in world axes, moved to its origin and axes.
fn pick_off<T: Real>(layout: &Layout<T>, q: &[T], tip: &Tip<T>) -> Result<Option<PickOff<T>>, DynamicsError> {
    layout.check_body(tip.body)?;
    let Some(body) = tip.body else { return Ok(None) };
    let carrier = &layout.carriers()[body];
    if carrier.body == GROUND {
        return Ok(None);
    }
    let rotation = body_pose(layout, q, Some(body))?.rotation;
    let lever = tip.point.unwrap_or(Vec3::zero());
    let columns = std::array::from_fn(|i| {
        let unit = Wrench::<T>::unit(i);
        let force = rotation.transpose_mul(unit.force);
        let moment = rotation.transpose_mul(unit.moment) + lever.cross(force);
        carrier.pose.wrench_to_parent(Wrench::new(moment, force))
    });
    Ok(Some((carrier.body, columns)))
}
