//! Velocities and motions of a free-flying robot whose total momentum is zero.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | J_b, J_m | columns of a Jacobian of the base and of the joints | 6 × 6, 6 × n_m | paper 2 (4.8) |
//! | 𝓜_bb, 𝓜_bm | rows of the mass matrix of the base: locked inertia, coupling | 6 × 6, 6 × n_m | paper 2 (4.11) |
//! | J_g | J_m − J_b 𝓜_bb⁻¹ 𝓜_bm, the generalised (space) Jacobian | 6 × n_m | Umetani and Yoshida 1989; paper 2 §4.7 |
//!
//! At zero momentum the base moves by −𝓜_bb⁻¹ 𝓜_bm θ̇_m; joint rates in the null space of 𝓜_bm leave it where it is.

use crate::FreeFlightError;
use crate::solve::solve;
use nalgebra::DMatrix;
use phipsi_recursion::hinge::Hinge;
use phipsi_recursion::layout::{GROUND, Layout};
use phipsi_recursion::{DynamicsError, Jacobian, MassMatrix};
use phipsi_spatial::{ArticulatedInertia, Mat3, Real, Sym3, Vec3, Wrench};

/// First degree of freedom of the one floating base.
fn base<T: Real>(layout: &Layout<T>) -> Result<usize, FreeFlightError> {
    layout.check_rigid("space_jacobian")?;
    let roots = || layout.bodies().iter().filter(|b| b.parent == GROUND);
    match (roots().next(), roots().count()) {
        (Some(root), 1) if matches!(root.hinge, Hinge::Free) => Ok(root.v),
        (Some(root), 1) => {
            Err(FreeFlightError::NotFree { joint: layout.joint_of_velocity(root.v).0.to_string() })
        }
        (_, found) => Err(FreeFlightError::Roots { found }),
    }
}

/// The locked inertia 𝓜_bb, for a solve.
fn locked<T: Real>(m: &[T], nv: usize, b: usize) -> ArticulatedInertia<T> {
    let at = |i: usize, j: usize| m[(b + i) * nv + b + j];
    let block = |i: usize| Sym3 {
        xx: at(i, i),
        xy: at(i, i + 1),
        xz: at(i, i + 2),
        yy: at(i + 1, i + 1),
        yz: at(i + 1, i + 2),
        zz: at(i + 2, i + 2),
    };
    let coupling = Mat3([0, 1, 2].map(|i| [3, 4, 5].map(|j| at(i, j))));
    ArticulatedInertia { inertia: block(0), coupling, mass: block(3) }
}

/// Workspace of the space Jacobian.
#[derive(Clone, Debug)]
pub struct SpaceJacobian<T: Real> {
    base: usize,
    mass_matrix: MassMatrix<T>,
    jacobian: Jacobian<T>,
    m: Vec<T>,
    j: Vec<T>,
}

impl<T: Real> SpaceJacobian<T> {
    /// A workspace for a layout with one floating base.
    ///
    /// # Errors
    /// [`FreeFlightError::NotFree`], [`FreeFlightError::Roots`].
    pub fn new(layout: &Layout<T>) -> Result<Self, FreeFlightError> {
        let nv = layout.nv();
        Ok(SpaceJacobian {
            base: base(layout)?,
            mass_matrix: MassMatrix::new(layout),
            jacobian: Jacobian::new(layout),
            m: vec![T::zero(); nv * nv],
            j: vec![T::zero(); 6 * nv],
        })
    }
    /// J_g of a point of a body: (ω, velocity of the point) = J_g θ̇_m, world axes, while the total momentum is zero.
    /// `q`: nq; `point`: in the body's frame, m, its origin if `None`; `out`: 6 × (nv − 6), rows first, columns in the order
    /// of v without the base's. Cost O(n · depth), no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`]; [`FreeFlightError::NoInertia`] for a system without mass.
    pub fn run(
        &mut self,
        layout: &Layout<T>,
        q: &[T],
        body: Option<usize>,
        point: Option<Vec3<T>>,
        out: &mut [T],
    ) -> Result<(), FreeFlightError> {
        let (nv, b) = (layout.nv(), self.base);
        if out.len() != 6 * (nv - 6) {
            let (argument, expected, found) = ("out", 6 * (nv - 6), out.len());
            return Err(DynamicsError::Shape { argument, expected, found }.into());
        }
        self.mass_matrix.run(layout, q, &mut self.m)?;
        self.jacobian.run(layout, q, body, point, &mut self.j)?;
        let locked = locked(&self.m, nv, b);
        let joints = (0..nv).filter(|i| !(b..b + 6).contains(i));
        for (column, i) in joints.enumerate() {
            let pushed = Wrench::from_array(core::array::from_fn(|r| self.m[(b + r) * nv + i]));
            let follows = solve(&locked, pushed).map_err(|pivot| FreeFlightError::NoInertia {
                joint: layout.joint_of_velocity(b).0.into(),
                pivot,
            })?;
            let follows = follows.to_array();
            for r in 0..6 {
                let row = &self.j[r * nv..(r + 1) * nv];
                let own = row[i];
                out[r * (nv - 6) + column] = (0..6).fold(own, |sum, c| sum - row[b + c] * follows[c]);
            }
        }
        Ok(())
    }
}

/// Joint motions that leave the base at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct ReactionlessBasis {
    /// An orthonormal basis: one vector of nv − 6 joint rates after the other, in the order of v without the base's.
    pub vectors: Vec<Vec<f64>>,
    /// Singular values of the coupling 𝓜_bm, scaled to joint rates of unit kinetic energy, largest first. Those below
    /// `tolerance` times the largest are counted as zero.
    pub singular_values: Vec<f64>,
    /// The cut.
    pub tolerance: f64,
}

/// The null space of the base's coupling 𝓜_bm at a configuration: joint rates for which base and joints exchange no momentum.
/// `q`: nq. Cost O(n · depth) and a singular value decomposition of 6 × (nv − 6).
///
/// # Accuracy
/// Columns are scaled by 1/√𝓜_ii before the decomposition, so that the rank does not depend on units; the vectors are
/// orthonormal in plain joint rates. `singular_values` tell how near the next one is.
///
/// # Errors
/// [`FreeFlightError::NotFree`], [`FreeFlightError::Roots`]; [`DynamicsError::Shape`].
pub fn reactionless_basis(layout: &Layout<f64>, q: &[f64]) -> Result<ReactionlessBasis, FreeFlightError> {
    let (nv, b) = (layout.nv(), base(layout)?);
    let mut m = vec![0.0; nv * nv];
    MassMatrix::new(layout).run(layout, q, &mut m)?;
    let joints: Vec<usize> = (0..nv).filter(|i| !(b..b + 6).contains(i)).collect();
    let n = joints.len();
    let tolerance = 6.0 * n.max(1) as f64 * f64::EPSILON;
    let scale = |i: usize| m[i * nv + i].sqrt();
    // Six rows more than the null space needs, for a square decomposition with all right vectors.
    let rows = n.max(6);
    let scaled = DMatrix::from_fn(rows, n, |r, c| {
        if r < 6 { m[(b + r) * nv + joints[c]] / (scale(b + r) * scale(joints[c])) } else { 0.0 }
    });
    if n == 0 {
        return Ok(ReactionlessBasis { vectors: vec![], singular_values: vec![], tolerance });
    }
    let svd = scaled.svd(false, true);
    let right = svd.v_t.expect("right vectors were asked for");
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| svd.singular_values[j].total_cmp(&svd.singular_values[i]));
    let values: Vec<f64> = order.iter().map(|&i| svd.singular_values[i]).collect();
    let largest = values[0];
    let null = order.iter().filter(|&&i| svd.singular_values[i] <= tolerance * largest);
    let columns: Vec<Vec<f64>> =
        null.map(|&i| (0..n).map(|c| right[(i, c)] / scale(joints[c])).collect()).collect();
    let mut vectors = vec![];
    if !columns.is_empty() {
        let q = DMatrix::from_fn(n, columns.len(), |r, c| columns[c][r]).qr().q();
        vectors = (0..columns.len()).map(|c| q.column(c).iter().copied().collect()).collect();
    }
    Ok(ReactionlessBasis { vectors, singular_values: values.into_iter().take(6.min(n)).collect(), tolerance })
}
