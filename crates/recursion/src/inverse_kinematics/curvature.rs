//! Second derivatives of the squared pose error, and Newton steps with them.
//!
//! With a, v the angular and linear parts of the columns of J, and i inboard of j:
//! B_ij = ℓ² (a_i · (1 + c φ~²) a_j − ½ φ · (a_i × a_j)) + v_i · v_j − p · (a_i × v_j), c = (1 − (θ/2) cot(θ/2))/θ², θ = |φ|.
//! Degrees of freedom of one joint have no term in φ · (a_i × a_j), and the mean of the last one both ways: increments along
//! one-parameter groups.

use crate::layout::{GROUND, Layout};
use phipsi_spatial::{Real, Vec3};

/// Degrees of freedom that move a body.
#[derive(Clone, Debug)]
pub(super) struct Path {
    /// Index in v and joint of the layout, base first.
    pub(super) dofs: Vec<(usize, usize)>,
}

impl Path {
    pub(super) fn new<T: Real>(layout: &Layout<T>) -> Self {
        Path { dofs: Vec::with_capacity(layout.nv()) }
    }
    pub(super) fn set<T: Real>(&mut self, layout: &Layout<T>, body: usize) {
        self.dofs.clear();
        let mut k = layout.carriers()[body].body;
        while k != GROUND {
            let body = &layout.bodies()[k];
            self.dofs.extend((body.v..body.v + body.hinge.nv()).map(|v| (v, k)));
            k = body.parent;
        }
        self.dofs.reverse();
    }
}

/// B of the path's degrees of freedom, by rows; those at limits get a row of zeros. `squares`, nv: |v|² + ℓ² |a|², at least
/// √ε of the largest.
/// `scale`: ℓ, zero where rotations do not count.
pub(super) fn curvature<T: Real>(
    jacobian: &[T],
    path: &Path,
    frozen: &[bool],
    scale: f64,
    [rotation, position]: [Vec3<T>; 2],
    hessian: &mut [T],
    squares: &mut [T],
) {
    let (nv, n, square) = (frozen.len(), path.dofs.len(), T::splat(scale * scale));
    let column = |i: usize| {
        let at = |r: usize| jacobian[r * nv + i];
        (Vec3([at(0), at(1), at(2)]), Vec3([at(3), at(4), at(5)]))
    };
    let theta2 = rotation.dot(rotation);
    let c = if theta2 < T::splat(1e-4) {
        T::one() / T::splat(12.0) + theta2 / T::splat(720.0)
    } else {
        let half = theta2.sqrt() * T::splat(0.5);
        let (s, cosine) = half.sin_cos();
        (T::one() - half * cosine / s) / theta2
    };
    let half = T::splat(0.5);
    for (row, &(i, joint)) in path.dofs.iter().enumerate() {
        let (a, v) = column(i);
        squares[i] = square.fma(a.dot(a), v.dot(v));
        for (other, &(j, outer)) in path.dofs.iter().enumerate().skip(row) {
            let (b, w) = column(j);
            let bent = a.dot(b) - c * rotation.cross(a).dot(rotation.cross(b));
            let (turn, lever) = if joint == outer {
                (T::zero(), (position.dot(a.cross(w)) + position.dot(b.cross(v))) * half)
            } else {
                (rotation.dot(a.cross(b)) * half, position.dot(a.cross(w)))
            };
            let stays = frozen[i] || frozen[j];
            let x = if stays { T::zero() } else { square.fma(bent - turn, v.dot(w) - lever) };
            hessian[row * n + other] = x;
            hessian[other * n + row] = x;
        }
    }
    // Columns that are rounding have a B that is: μ must outgrow it.
    let largest = path.dofs.iter().fold(T::zero(), |largest, &(i, _)| squares[i].larger(largest));
    let least = largest * T::splat(T::EPSILON.sqrt());
    path.dofs.iter().for_each(|&(i, _)| squares[i] = squares[i].larger(least));
}

/// Solves (B + μ) δq = −g by Cholesky's factorisation in place; false if B + μ is not positive definite.
pub(super) fn factor_and_solve<T: Real>(
    path: &Path,
    frozen: &[bool],
    hessian: &mut [T],
    mu: &[T],
    gradient: &[T],
    step: &mut [T],
) -> bool {
    let n = path.dofs.len();
    for j in 0..n {
        let dof = path.dofs[j].0;
        // A column of zeros, as of a wrist that does not move the point, has no B and no gradient either.
        let free = !frozen[dof] && mu[dof].is_positive();
        let mut pivot = if free { hessian[j * n + j] + mu[dof] } else { T::one() };
        for k in 0..j {
            pivot -= hessian[j * n + k] * hessian[j * n + k];
        }
        // A pivot that is all rounding makes a step that is.
        let counts = pivot > mu[dof] * T::splat(1e-3) && pivot.is_positive();
        if !counts {
            return false;
        }
        let root = pivot.sqrt();
        hessian[j * n + j] = root;
        for i in j + 1..n {
            let mut x = hessian[i * n + j];
            for k in 0..j {
                x -= hessian[i * n + k] * hessian[j * n + k];
            }
            hessian[i * n + j] = x / root;
        }
    }
    for i in 0..n {
        let dof = path.dofs[i].0;
        let mut x = if frozen[dof] { T::zero() } else { -gradient[dof] };
        for k in 0..i {
            x -= hessian[i * n + k] * step[path.dofs[k].0];
        }
        step[dof] = x / hessian[i * n + i];
    }
    for i in (0..n).rev() {
        let dof = path.dofs[i].0;
        let mut x = step[dof];
        for k in i + 1..n {
            x -= hessian[k * n + i] * step[path.dofs[k].0];
        }
        step[dof] = x / hessian[i * n + i];
    }
    true
}
