//! Poses, velocities and velocity terms of all bodies of a flexible tree, base to tip.
//!
//! | symbol | meaning | frame |
//! |---|---|---|
//! | x(k) | pose of the hinge frame of body k in its parent's frame or node | |
//! | V(k) | velocity of body k | its frame: F, or the hinge frame of a rigid body |
//! | V_t | velocity of the node or frame that joint k is on | there |
//! | V_d | x* V_t + H* β, at the hinge frame; V = X_d⁻¹ V_d + Γ η̇ | hinge frame |
//! | a(k) | joint's Coriolis acceleration, with the node's ω: [`crate::kinematics`] | hinge frame |
//! | α(k) | acceleration, the papers' pair; α = X_d⁻¹ α_d + Γ η̈ + o | as V |

use super::body::BodyState;
use super::tree::FlexibleTree;
use crate::error::DynamicsError;
use crate::kinematics::coriolis;
use crate::layout::GROUND;
use phipsi_spatial::{Motion, Scalar, Transform, Vec3, Wrench};

/// Motion of all bodies.
#[derive(Clone, Debug)]
pub(crate) struct Motions<T> {
    /// x.
    pub(crate) x: Vec<Transform<T>>,
    /// V.
    pub(crate) velocity: Vec<Motion<T>>,
    /// a.
    pub(crate) coriolis: Vec<Motion<T>>,
    /// Of flexible bodies.
    pub(crate) states: Vec<BodyState<T>>,
}

impl<T: Scalar> Motions<T> {
    pub(crate) fn new(tree: &FlexibleTree<T::Constant>) -> Self {
        let n = tree.bodies.len();
        Motions {
            x: vec![Transform::identity(); n],
            velocity: vec![Motion::zero(); n],
            coriolis: vec![Motion::zero(); n],
            states: tree.modal.iter().map(BodyState::new).collect(),
        }
    }
    /// True for a workspace that was made from a tree of this shape.
    pub(crate) fn fits(&self, tree: &FlexibleTree<T::Constant>) -> bool {
        let same = |(state, body): (&BodyState<T>, &super::tree::Modal<T::Constant>)| {
            state.b_e.len() == body.n && state.nodes.len() == body.nodes.len()
        };
        self.x.len() == tree.bodies.len()
            && self.states.len() == tree.modal.len()
            && self.states.iter().zip(&tree.modal).all(same)
    }
    pub(crate) fn set_position(&mut self, tree: &FlexibleTree<T::Constant>, q: &[T]) {
        for (state, body) in self.states.iter_mut().zip(&tree.modal) {
            state.set_position(body, &tree.series, &q[body.q..body.q + body.n]);
        }
        for (x, body) in self.x.iter_mut().zip(&tree.bodies) {
            *x = match &body.hinge {
                Some(hinge) => hinge.transform(&body.placement, &q[body.q..]),
                None => Transform::constant(&body.placement),
            };
        }
    }
    /// Velocities and all velocity terms; after [`Self::set_position`].
    pub(crate) fn set_velocity(&mut self, tree: &FlexibleTree<T::Constant>, v: &[T]) {
        for k in 0..tree.bodies.len() {
            let body = &tree.bodies[k];
            let inboard = match body.parent {
                GROUND => Motion::zero(),
                p => self.carried(tree, k, self.velocity[p], v, false),
            };
            let joint = body.hinge.as_ref().map_or(Motion::zero(), |hinge| hinge.expand(&v[body.v..]));
            let outboard = self.x[k].motion_to_child(inboard) + joint;
            self.coriolis[k] = match body.parent {
                GROUND => Motion::zero(),
                _ => coriolis(&self.x[k], inboard.angular, outboard.angular, joint),
            };
            self.velocity[k] = self.to_body(tree, k, outboard, v, false);
            if let Some(i) = body.modal {
                let modal = &tree.modal[i];
                let rates = &v[modal.v..modal.v + modal.n];
                self.states[i].set_velocity(modal, rates, self.velocity[k].angular);
            }
        }
    }
    /// The motion of the node or frame that joint `k` is on, from the parent's and from η̇ or η̈ in `rates` (of the whole
    /// model); `accelerating` with c.
    #[inline(always)]
    pub(crate) fn carried(
        &self,
        tree: &FlexibleTree<T::Constant>,
        k: usize,
        parent: Motion<T>,
        rates: &[T],
        accelerating: bool,
    ) -> Motion<T> {
        let body = &tree.bodies[k];
        let Some((modal, node)) = self.node(tree, k) else { return parent };
        debug_assert!(body.node.is_some());
        let moved = node.carry(parent, &rates[modal.v..modal.v + modal.n]);
        if accelerating { moved + node.c } else { moved }
    }
    /// The parent and its node, if joint `k` is on one.
    #[inline(always)]
    pub(crate) fn node<'a>(
        &'a self,
        tree: &'a FlexibleTree<T::Constant>,
        k: usize,
    ) -> Option<(&'a super::tree::Modal<T::Constant>, &'a super::body::NodeState<T>)> {
        let body = &tree.bodies[k];
        let i = tree.bodies[body.parent].modal?;
        Some((&tree.modal[i], &self.states[i].nodes[body.node?]))
    }
    /// The body's motion from that of its hinge frame.
    #[inline(always)]
    pub(crate) fn to_body(
        &self,
        tree: &FlexibleTree<T::Constant>,
        k: usize,
        outboard: Motion<T>,
        rates: &[T],
        accelerating: bool,
    ) -> Motion<T> {
        let Some(i) = tree.bodies[k].modal else { return outboard };
        let (modal, state) = (&tree.modal[i], &self.states[i]);
        let moved = state.hinge.motion_to_parent(outboard);
        let moved = state
            .Gamma
            .iter()
            .zip(&rates[modal.v..modal.v + modal.n])
            .fold(moved, |sum, (Gamma, x)| sum + Gamma.scale(*x));
        if accelerating { moved + state.o } else { moved }
    }
    /// Acceleration of body `k` at joint accelerations and η̈ in `a`, from its parent's; `ground` is α of the ground.
    #[inline(always)]
    pub(crate) fn accelerated(
        &self,
        tree: &FlexibleTree<T::Constant>,
        k: usize,
        parent: Motion<T>,
        v: &[T],
        a: &[T],
    ) -> Motion<T> {
        let body = &tree.bodies[k];
        let inboard = match body.parent {
            GROUND => parent,
            _ => self.carried(tree, k, parent, a, true),
        };
        let mut outboard = self.x[k].motion_to_child(inboard) + self.coriolis[k];
        if let Some(hinge) = &body.hinge {
            outboard += hinge.expand(&a[body.v..]) + hinge.turning(&v[body.v..]);
        }
        self.to_body(tree, k, outboard, a, true)
    }
    /// (M_fl x + b_fl + [K η + C η̇; 0]) of flexible body `i` at η̈ (in `a`) and α: modal forces into `f_e`, the wrench at F.
    pub(crate) fn force(
        &self,
        tree: &FlexibleTree<T::Constant>,
        i: usize,
        (q, v, a): (&[T], &[T], &[T]),
        alpha: Motion<T>,
        f_e: &mut [T],
    ) -> Wrench<T> {
        let (modal, state) = (&tree.modal[i], &self.states[i]);
        let n = modal.n;
        let eta_second = &a[modal.v..modal.v + n];
        let mut f = state.M_dd.momentum(alpha) + state.b_d;
        for l in 0..n {
            f += state.M_de[l].scale(eta_second[l]);
            let mut sum = alpha.dot(state.M_de[l]) + state.b_e[l] + elastic(modal, l, q, v);
            for m in 0..n {
                sum += T::constant(modal.M_ee[l * n + m]) * eta_second[m];
            }
            f_e[l] = sum;
        }
        f
    }
    /// y·M_fl y/2's factor M_fl y: momentum of the modes into `p_e`, of F.
    pub(crate) fn momentum(
        &self,
        tree: &FlexibleTree<T::Constant>,
        i: usize,
        v: &[T],
        velocity: Motion<T>,
        p_e: &mut [T],
    ) -> Wrench<T> {
        let (modal, state) = (&tree.modal[i], &self.states[i]);
        let n = modal.n;
        let rates = &v[modal.v..modal.v + n];
        let mut p = state.M_dd.momentum(velocity);
        for l in 0..n {
            p += state.M_de[l].scale(rates[l]);
            let mut sum = velocity.dot(state.M_de[l]);
            for m in 0..n {
                sum += T::constant(modal.M_ee[l * n + m]) * rates[m];
            }
            p_e[l] = sum;
        }
        p
    }
    /// World poses of all bodies' frames, parents first, into `world`; positions from the point `about`.
    pub(crate) fn world_poses(
        &self,
        tree: &FlexibleTree<T::Constant>,
        about: Vec3<T>,
        world: &mut [Transform<T>],
    ) {
        for (k, body) in tree.bodies.iter().enumerate() {
            let mut local = self.x[k];
            if let Some(i) = body.modal {
                local = local.compose(&self.states[i].hinge.inverse());
            }
            world[k] = match body.parent {
                GROUND => Transform::new(local.rotation, local.translation - about),
                p => match self.node(tree, k) {
                    Some((_, node)) => world[p].compose(&node.pose).compose(&local),
                    None => world[p].compose(&local),
                },
            };
        }
    }
}

/// The workspace, if it is one for this tree.
pub(crate) fn checked<'a, W, T: Scalar>(
    work: &'a mut Option<Box<W>>,
    tree: &FlexibleTree<T::Constant>,
    motions: impl Fn(&W) -> &Motions<T>,
) -> Result<&'a mut W, DynamicsError> {
    let found = work.as_ref().map_or(0, |work| motions(work).x.len());
    match work {
        Some(work) if motions(work).fits(tree) => Ok(work),
        _ => Err(DynamicsError::Shape { argument: "workspace", expected: tree.bodies.len(), found }),
    }
}

/// Component l of K η + C η̇.
#[inline(always)]
pub(crate) fn elastic<T: Scalar>(modal: &super::tree::Modal<T::Constant>, l: usize, q: &[T], v: &[T]) -> T {
    let n = modal.n;
    let mut sum = T::zero();
    for m in 0..n {
        sum += T::constant(modal.stiffness[l * n + m]) * q[modal.q + m];
        sum += T::constant(modal.damping[l * n + m]) * v[modal.v + m];
    }
    sum
}

/// α of the ground: (0, −g).
pub(crate) fn ground<T: Scalar>(gravity: Vec3<T::Constant>) -> Motion<T> {
    Motion::new(Vec3::zero(), -Vec3::constant(gravity))
}
