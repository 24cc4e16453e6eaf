//! The mass matrix of trees with flexible bodies, by composite bodies.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | R | M_fl + Σ A_t* R_t A_t: inertia of everything outboard, joints locked, modes of inner bodies locked | n + 6 |
//! | R′ | L* R L; only R′_dd goes to the parent | n + 6 |
//! | column | R′ [1, 0; 0, H*], carried up by A_t* X* and L* | n + 6 |

use super::motions::{Motions, checked};
use super::tree::FlexibleTree;
use crate::error::DynamicsError;
use crate::layout::GROUND;
use phipsi_spatial::{RigidInertia, Scalar, Wrench};

/// Workspace.
#[derive(Clone, Debug)]
pub(crate) struct Composite<T: Scalar> {
    motions: Motions<T>,
    /// R_dd at the body's frame; then R′_dd at the hinge frame.
    R: Vec<RigidInertia<T>>,
    /// R_ee, modes after modes: n×n of each body.
    R_ee: Vec<Vec<T>>,
    /// R_de by columns; then R′_de at the hinge frame.
    R_de: Vec<Vec<Wrench<T>>>,
}

impl<T: Scalar> Composite<T> {
    pub(crate) fn new(tree: &FlexibleTree<T::Constant>) -> Self {
        Composite {
            motions: Motions::new(tree),
            R: vec![RigidInertia::zero(); tree.bodies.len()],
            R_ee: tree.modal.iter().map(|m| vec![T::zero(); m.n * m.n]).collect(),
            R_de: tree.modal.iter().map(|m| vec![Wrench::zero(); m.n]).collect(),
        }
    }
    /// [`Self::run`] with a workspace that may belong to another layout.
    pub(crate) fn run_checked(
        work: &mut Option<Box<Self>>,
        tree: &FlexibleTree<T::Constant>,
        nv: usize,
        q: &[T],
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        let work = checked(work, tree, |work| &work.motions)?;
        work.run(tree, nv, q, out);
        Ok(())
    }
    /// The mass matrix, nv×nv, by rows.
    pub(crate) fn run(&mut self, tree: &FlexibleTree<T::Constant>, nv: usize, q: &[T], out: &mut [T]) {
        out.fill(T::zero());
        self.motions.set_position(tree, q);
        for (k, body) in tree.bodies.iter().enumerate() {
            self.R[k] = match body.modal {
                None => RigidInertia::constant(&body.inertia),
                Some(i) => {
                    let state = &self.motions.states[i];
                    self.R_de[i].copy_from_slice(&state.M_de);
                    for (R, M) in self.R_ee[i].iter_mut().zip(&tree.modal[i].M_ee) {
                        *R = T::constant(*M);
                    }
                    state.M_dd
                }
            };
        }
        for k in (0..tree.bodies.len()).rev() {
            let body = &tree.bodies[k];
            if let Some(i) = body.modal {
                self.change_to_hinge(tree, k, i);
                let (n, v) = (tree.modal[i].n, tree.modal[i].v);
                for l in 0..n {
                    for m in 0..n {
                        out[(v + l) * nv + v + m] = self.R_ee[i][l * n + m];
                    }
                    let column = self.R_de[i][l];
                    self.carry(tree, k, column, v + l, nv, out);
                }
            }
            if let Some(hinge) = &body.hinge {
                for i in 0..hinge.nv() {
                    let column = self.R[k].momentum(hinge.axis(i));
                    self.carry(tree, k, column, body.v + i, nv, out);
                }
            }
            self.give(tree, k);
        }
    }
    /// R′ of flexible body `i`.
    fn change_to_hinge(&mut self, tree: &FlexibleTree<T::Constant>, k: usize, i: usize) {
        let (state, n) = (&self.motions.states[i], tree.modal[i].n);
        let (R_ee, R_de) = (&mut self.R_ee[i], &mut self.R_de[i]);
        if tree.modal[i].inboard.is_some() {
            for l in 0..n {
                let moved = self.R[k].momentum(state.Gamma[l]);
                for m in 0..n {
                    R_ee[l * n + m] +=
                        state.Gamma[l].dot(R_de[m]) + state.Gamma[m].dot(R_de[l]) + state.Gamma[m].dot(moved);
                }
            }
            for l in 0..n {
                R_de[l] += self.R[k].momentum(state.Gamma[l]);
            }
        }
        let body_in_hinge = state.hinge.inverse();
        for column in R_de {
            *column = body_in_hinge.wrench_to_parent(*column);
        }
        self.R[k] = body_in_hinge.rigid_to_parent(&self.R[k]);
    }
    /// Entries of column `j` at joint `k` and inboard of it; `f` is at the hinge frame of `k`.
    fn carry(
        &self,
        tree: &FlexibleTree<T::Constant>,
        k: usize,
        mut f: Wrench<T>,
        j: usize,
        nv: usize,
        out: &mut [T],
    ) {
        let mut put = |i: usize, x: T| {
            out[i * nv + j] = x;
            out[j * nv + i] = x;
        };
        let mut k = k;
        loop {
            let body = &tree.bodies[k];
            if let Some(hinge) = &body.hinge {
                for i in 0..hinge.nv() {
                    put(body.v + i, hinge.project(i, &f));
                }
            }
            let p = body.parent;
            if p == GROUND {
                return;
            }
            f = self.motions.x[k].wrench_to_parent(f);
            if let Some(i) = tree.bodies[p].modal {
                let (modal, state) = (&tree.modal[i], &self.motions.states[i]);
                let node = body.node.map(|t| &state.nodes[t]);
                let at_body = node.map_or(f, |node| node.pose.wrench_to_parent(f));
                for l in 0..modal.n {
                    let own = node.map_or(T::zero(), |node| node.Pi[l].dot(f));
                    put(modal.v + l, own + state.Gamma[l].dot(at_body));
                }
                f = state.hinge.wrench_to_child(at_body);
            }
            k = p;
        }
    }
    /// R′_dd of body `k` to its parent.
    fn give(&mut self, tree: &FlexibleTree<T::Constant>, k: usize) {
        let body = &tree.bodies[k];
        if body.parent == GROUND {
            return;
        }
        let p = body.parent;
        let R_t = self.motions.x[k].rigid_to_parent(&self.R[k]);
        let (Some(i), Some(t)) = (tree.bodies[p].modal, body.node) else {
            self.R[p] = self.R[p] + R_t;
            return;
        };
        let (n, node) = (tree.modal[i].n, &self.motions.states[i].nodes[t]);
        for l in 0..n {
            let moved = R_t.momentum(node.Pi[l]);
            for m in 0..n {
                self.R_ee[i][l * n + m] += node.Pi[m].dot(moved);
            }
            self.R_de[i][l] += node.pose.wrench_to_parent(moved);
        }
        self.R[p] = self.R[p] + node.pose.rigid_to_parent(&R_t);
    }
}
