//! Forward dynamics of trees with flexible bodies: filter and smoother, modes eliminated before the joint.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | P | M_fl + Σ A_t* P_t A_t over children t, A_t = [Π_t, X_t] | n + 6 |
//! | z | b_fl + [K η + C η̇; 0] − w + Σ A_t* (z_t + P_t c_t) | n + 6 |
//! | P′, z′ | L* P L, L* (z + P o), L = [[1, 0], [Γ, X_d⁻¹]]: the hinge frame in place of F | n + 6 |
//! | c, W | P′_ee = D_M = c c*, W = c⁻¹ P′_ed | n×n, n×6 |
//! | y | c⁻¹ (τ_e − z′_e) | n |
//! | P_r, z_r | P′_dd − W* W, z′_d + W* y: what the joint meets | 6×6, 6 |
//! | D, G, ε, ν | of the joint: the rigid filter's own steps on (P_r, z_r + P_r a) | [`crate::articulated_sweep`] |
//! | η̈ | c⁻* (y − W α_d) | n |
//!
//! Only 6×6 quantities travel from body to body. The Cholesky factor keeps the digits that the push-through form of D_M⁻¹ loses
//! under a heavy payload.

use super::body::{BodyState, NodeState};
use super::motions::{Motions, elastic};
use super::tree::FlexibleTree;
use crate::articulated_sweep::{Pivot, eliminate_axis, filter, smooth};
use crate::error::DynamicsError;
use crate::hinge::Hinge;
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{ArticulatedInertia, Motion, Scalar, Wrench};

/// P, z and the factors of a flexible body.
#[derive(Clone, Debug)]
pub(crate) struct Front<T> {
    /// P_ee before, c after (lower triangle).
    pub(crate) c: Vec<T>,
    /// P_de by columns before, W by rows after.
    pub(crate) W: Vec<Wrench<T>>,
    /// z_e before, y after.
    pub(crate) y: Vec<T>,
}

impl<T: Scalar> Front<T> {
    /// Adds A_t* P_t A_t of a child on a node; returns the block of F, which the caller keeps.
    pub(crate) fn add(&mut self, node: &NodeState<T>, P_t: &ArticulatedInertia<T>) -> ArticulatedInertia<T> {
        let n = self.y.len();
        for l in 0..n {
            let moved = P_t.times(node.Pi[l]);
            for m in 0..=l {
                self.c[l * n + m] += node.Pi[m].dot(moved);
            }
            self.W[l] += node.pose.wrench_to_parent(moved);
        }
        node.pose.articulated_to_parent(P_t)
    }
    /// L* P L: Γ where the joint `held` a node, then the axes of the hinge frame.
    pub(crate) fn change_to_hinge(
        &mut self,
        P: &mut ArticulatedInertia<T>,
        held: bool,
        state: &BodyState<T>,
    ) {
        let n = self.y.len();
        if held {
            for l in 0..n {
                let moved = P.times(state.Gamma[l]);
                for m in 0..=l {
                    let sum = state.Gamma[l].dot(self.W[m])
                        + state.Gamma[m].dot(self.W[l])
                        + state.Gamma[m].dot(moved);
                    self.c[l * n + m] += sum;
                }
            }
            for l in 0..n {
                self.W[l] += P.times(state.Gamma[l]);
            }
        }
        let body_in_hinge = state.hinge.inverse();
        *P = body_in_hinge.articulated_to_parent(P);
        for column in &mut self.W {
            *column = body_in_hinge.wrench_to_parent(*column);
        }
    }
}

/// Workspace of forward dynamics.
#[derive(Clone, Debug)]
pub(crate) struct Filter<T: Scalar> {
    pub(crate) motions: Motions<T>,
    pub(crate) fronts: Vec<Front<T>>,
    /// P_dd and z_d, at the body's frame.
    pub(crate) P: Vec<ArticulatedInertia<T>>,
    z: Vec<Wrench<T>>,
    pub(crate) pivots: Vec<Pivot<T>>,
    /// P⁺ of every body at its hinge frame.
    pub(crate) P_through: Vec<ArticulatedInertia<T>>,
    alpha: Vec<Motion<T>>,
}

impl<T: Scalar> Filter<T> {
    pub(crate) fn new(tree: &FlexibleTree<T::Constant>) -> Self {
        let n = tree.bodies.len();
        let front =
            |n: usize| Front { c: vec![T::zero(); n * n], W: vec![Wrench::zero(); n], y: vec![T::zero(); n] };
        let joints = tree.bodies.iter().map(|b| b.v + b.dofs()).max().unwrap_or(0);
        Filter {
            motions: Motions::new(tree),
            fronts: tree.modal.iter().map(|m| front(m.n)).collect(),
            P: vec![ArticulatedInertia::zero(); n],
            z: vec![Wrench::zero(); n],
            pivots: vec![Pivot::empty(); joints],
            P_through: vec![ArticulatedInertia::zero(); n],
            alpha: vec![Motion::zero(); n],
        }
    }
    /// Accelerations; `out` holds τ before. `ground` is α of the ground; `loads`: minus the external wrenches at the bodies'
    /// frames.
    #[allow(clippy::too_many_arguments)] // one sweep's inputs
    pub(crate) fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        tree: &FlexibleTree<T::Constant>,
        ground: Motion<T>,
        (q, v): (&[T], &[T]),
        loads: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        self.motions.set_position(tree, q);
        self.motions.set_velocity(tree, v);
        self.sweep_inboard(layout, tree, (q, v), loads, out)?;
        self.sweep_outboard(tree, ground, v, out);
        Ok(())
    }
    /// Factors alone, at rest and without loads.
    pub(crate) fn factor(
        &mut self,
        layout: &Layout<T::Constant>,
        tree: &FlexibleTree<T::Constant>,
        q: &[T],
        rest: &[T],
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        self.motions.set_position(tree, q);
        self.motions.set_velocity(tree, rest);
        self.sweep_inboard(layout, tree, (q, rest), None, out)
    }

    fn sweep_inboard(
        &mut self,
        layout: &Layout<T::Constant>,
        tree: &FlexibleTree<T::Constant>,
        (q, v): (&[T], &[T]),
        loads: Option<&[Wrench<T>]>,
        residuals: &mut [T],
    ) -> Result<(), DynamicsError> {
        self.begin(tree, (q, v), loads);
        for k in (0..tree.bodies.len()).rev() {
            let body = &tree.bodies[k];
            let (mut P, mut z) = (self.P[k], self.z[k]);
            if let Some(i) = body.modal {
                let tau = &residuals[tree.modal[i].v..];
                (P, z) = self
                    .eliminate_modes(tree, k, i, tau)
                    .map_err(|(l, D)| layout.singular(tree.modal[i].v + l, D))?;
            }
            if body.parent != GROUND {
                z += P.times(self.motions.coriolis[k]);
            }
            if let Some(hinge) = &body.hinge {
                let dofs = body.v..body.v + hinge.nv();
                eliminate_hinge(hinge, &mut P, &mut self.pivots[dofs.clone()])
                    .map_err(|(i, D)| layout.singular(body.v + i, D))?;
                filter(hinge, &self.pivots[dofs.clone()], &mut z, &mut residuals[dofs]);
            }
            self.P_through[k] = P;
            if body.parent != GROUND {
                self.give(tree, k, P, z);
            }
        }
        Ok(())
    }
    /// M_fl and b_fl of all bodies, and their loads.
    fn begin(&mut self, tree: &FlexibleTree<T::Constant>, (q, v): (&[T], &[T]), loads: Option<&[Wrench<T>]>) {
        for (k, body) in tree.bodies.iter().enumerate() {
            (self.P[k], self.z[k]) = match body.modal {
                None => {
                    let M = phipsi_spatial::RigidInertia::constant(&body.inertia);
                    (M.to_articulated(), M.gyroscopic(self.motions.velocity[k].angular))
                }
                Some(i) => {
                    let (state, modal) = (&self.motions.states[i], &tree.modal[i]);
                    let front = &mut self.fronts[i];
                    for (c, M) in front.c.iter_mut().zip(&modal.M_ee) {
                        *c = T::constant(*M);
                    }
                    front.W.copy_from_slice(&state.M_de);
                    for l in 0..modal.n {
                        front.y[l] = state.b_e[l] + elastic(modal, l, q, v);
                    }
                    (state.M_dd.to_articulated(), state.b_d)
                }
            };
            if let Some(loads) = loads {
                self.z[k] += loads[k];
            }
        }
    }
    /// To the hinge frame, then D_M and what it leaves: P_r and z_r.
    fn eliminate_modes(
        &mut self,
        tree: &FlexibleTree<T::Constant>,
        k: usize,
        i: usize,
        tau: &[T],
    ) -> Result<(ArticulatedInertia<T>, Wrench<T>), (usize, f64)> {
        let n = tree.modal[i].n;
        let (front, state) = (&mut self.fronts[i], &self.motions.states[i]);
        let mut P = self.P[k];
        let mut z = self.z[k];
        let held = tree.modal[i].inboard.is_some();
        if held {
            for l in 0..n {
                front.y[l] += state.o.dot(front.W[l]);
            }
            z += P.times(state.o);
            for l in 0..n {
                front.y[l] += state.Gamma[l].dot(z);
            }
        }
        front.change_to_hinge(&mut P, held, state);
        z = state.hinge.wrench_to_child(z);
        for l in 0..n {
            front.y[l] = tau[l] - front.y[l];
        }
        cholesky(&mut front.c, n)?;
        for l in 0..n {
            for m in 0..l {
                let c = front.c[l * n + m];
                let (W, y) = (front.W[m], front.y[m]);
                front.W[l] -= W.scale(c);
                front.y[l] -= c * y;
            }
            let inverse = front.c[l * n + l].recip();
            front.W[l] = front.W[l].scale(inverse);
            front.y[l] *= inverse;
            P.subtract_outer(front.W[l], front.W[l]);
            z += front.W[l].scale(front.y[l]);
        }
        Ok((P, z))
    }
    /// P⁺ and z⁺ of body `k`, at its hinge frame, to its parent: A_t* P_t A_t, A_t* (z_t + P_t c_t).
    fn give(&mut self, tree: &FlexibleTree<T::Constant>, k: usize, P: ArticulatedInertia<T>, z: Wrench<T>) {
        let body = &tree.bodies[k];
        let p = body.parent;
        let P_t = self.motions.x[k].articulated_to_parent(&P);
        let mut z_t = self.motions.x[k].wrench_to_parent(z);
        let (Some(i), Some(t)) = (tree.bodies[p].modal, body.node) else {
            self.P[p] = self.P[p] + P_t;
            self.z[p] += z_t;
            return;
        };
        let (node, front) = (&self.motions.states[i].nodes[t], &mut self.fronts[i]);
        z_t += P_t.times(node.c);
        for (y, Pi) in front.y.iter_mut().zip(&node.Pi) {
            *y += Pi.dot(z_t);
        }
        self.P[p] = self.P[p] + front.add(node, &P_t);
        self.z[p] += node.pose.wrench_to_parent(z_t);
    }
    /// Bryson–Frazier smoother: `residuals` holds ν before and accelerations after.
    fn sweep_outboard(
        &mut self,
        tree: &FlexibleTree<T::Constant>,
        ground: Motion<T>,
        v: &[T],
        residuals: &mut [T],
    ) {
        for (k, body) in tree.bodies.iter().enumerate() {
            let inboard = match body.parent {
                GROUND => ground,
                p => self.motions.carried(tree, k, self.alpha[p], residuals, true),
            };
            let mut alpha = self.motions.x[k].motion_to_child(inboard);
            if let Some(hinge) = &body.hinge {
                let dofs = body.v..body.v + hinge.nv();
                smooth(hinge, &self.pivots[dofs.clone()], &mut alpha, &mut residuals[dofs.clone()]);
                hinge.subtract_turning(&v[body.v..], &mut residuals[dofs]);
            }
            alpha += self.motions.coriolis[k];
            if let Some(i) = body.modal {
                let (n, first, front) = (tree.modal[i].n, tree.modal[i].v, &self.fronts[i]);
                for l in (0..n).rev() {
                    let mut sum = front.y[l] - alpha.dot(front.W[l]);
                    for m in l + 1..n {
                        sum -= front.c[m * n + l] * residuals[first + m];
                    }
                    residuals[first + l] = sum / front.c[l * n + l];
                }
                alpha = self.motions.to_body(tree, k, alpha, residuals, true);
            }
            self.alpha[k] = alpha;
        }
    }
    /// Pivots of all joints and squares of the diagonals of all c: ln det M is the sum of their logarithms.
    pub(crate) fn pivots(&self) -> impl Iterator<Item = T> + '_ {
        let modes = self.fronts.iter().flat_map(|front| {
            let n = front.y.len();
            (0..n).map(move |l| front.c[l * n + l] * front.c[l * n + l])
        });
        self.pivots.iter().map(|pivot| pivot.inverse.recip()).chain(modes)
    }
}

/// The joint's pivots one component after the other, P⁺ in place of P.
fn eliminate_hinge<T: Scalar>(
    hinge: &Hinge<T::Constant>,
    P: &mut ArticulatedInertia<T>,
    pivots: &mut [Pivot<T>],
) -> Result<(), (usize, f64)> {
    for (i, pivot) in pivots.iter_mut().enumerate() {
        let column = P.times(hinge.axis(i));
        let D = hinge.project(i, &column);
        *pivot = eliminate_axis(P, column, D).map_err(|D| (i, D))?;
    }
    if let Hinge::Free = hinge {
        // A free joint lets nothing through: what the subtractions leave is rounding.
        *P = ArticulatedInertia::zero();
    }
    Ok(())
}

/// c with c c* the matrix whose lower triangle is in `a`; a pivot that is not positive, and its row.
fn cholesky<T: Scalar>(a: &mut [T], n: usize) -> Result<(), (usize, f64)> {
    for j in 0..n {
        for k in 0..=j {
            let mut sum = a[j * n + k];
            for m in 0..k {
                sum -= a[j * n + m] * a[k * n + m];
            }
            if k < j {
                a[j * n + k] = sum / a[k * n + k];
            } else {
                if !sum.is_positive() {
                    return Err((j, sum.min_lane()));
                }
                a[j * n + j] = sum.sqrt();
            }
        }
    }
    Ok(())
}
