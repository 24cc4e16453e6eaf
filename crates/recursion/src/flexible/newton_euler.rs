//! Inverse dynamics, kinetic energy, momentum and first moments of trees with flexible bodies.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | f | M_fl x + b_fl + [K η + C η̇; 0] − w + Σ A_t* f_t over children t; a rigid body's as ever | n + 6 |
//! | τ_e, f_d | L* f: modal forces f_e + Γ* f_V and the wrench across the joint, at the hinge frame | n, 6 |
//! | T | H f_d | r |
//! | h | momentum: M_fl y of F, gathered as f | 6 |

use super::motions::{Motions, checked, ground};
use super::tree::FlexibleTree;
use crate::error::DynamicsError;
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{Motion, RigidInertia, Scalar, Transform, Vec3, Wrench};

/// Workspace.
#[derive(Clone, Debug)]
pub(crate) struct NewtonEuler<T: Scalar> {
    pub(crate) motions: Motions<T>,
    alpha: Vec<Motion<T>>,
    /// f of F or of the rigid body's frame.
    f: Vec<Wrench<T>>,
    /// f_e of all modes.
    f_e: Vec<T>,
    world: Vec<Transform<T>>,
}

impl<T: Scalar> NewtonEuler<T> {
    pub(crate) fn new(tree: &FlexibleTree<T::Constant>) -> Self {
        let n = tree.bodies.len();
        NewtonEuler {
            motions: Motions::new(tree),
            alpha: vec![Motion::zero(); n],
            f: vec![Wrench::zero(); n],
            f_e: vec![T::zero(); tree.modes],
            world: vec![Transform::identity(); n],
        }
    }
    /// For a layout with flexible bodies.
    pub(crate) fn of(layout: &Layout<T::Constant>) -> Option<Box<Self>> {
        layout.flexible().map(|tree| Box::new(Self::new(tree)))
    }
    pub(crate) fn checked<'a>(
        work: &'a mut Option<Box<Self>>,
        tree: &FlexibleTree<T::Constant>,
    ) -> Result<&'a mut Self, DynamicsError> {
        checked(work, tree, |work| &work.motions)
    }
    /// Generalised forces of accelerations `a` into `out`.
    pub(crate) fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        tree: &FlexibleTree<T::Constant>,
        (q, v, a): (&[T], &[T], &[T]),
        loads: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) {
        self.motions.set_position(tree, q);
        self.motions.set_velocity(tree, v);
        let ground = ground(layout.gravity());
        for (k, body) in tree.bodies.iter().enumerate() {
            let parent = if body.parent == GROUND { ground } else { self.alpha[body.parent] };
            let alpha = self.motions.accelerated(tree, k, parent, v, a);
            self.alpha[k] = alpha;
            self.f[k] = match body.modal {
                None => {
                    let M = RigidInertia::constant(&body.inertia);
                    M.momentum(alpha) + M.gyroscopic(self.motions.velocity[k].angular)
                }
                Some(i) => {
                    let modal = &tree.modal[i];
                    let f_e = &mut self.f_e[modal.first..modal.first + modal.n];
                    self.motions.force(tree, i, (q, v, a), alpha, f_e)
                }
            };
            if let Some(loads) = loads {
                self.f[k] += loads[k];
            }
        }
        for k in (0..tree.bodies.len()).rev() {
            let body = &tree.bodies[k];
            let f_d = self.across(tree, k, Some(&mut *out));
            if let Some(hinge) = &body.hinge {
                for i in 0..hinge.nv() {
                    out[body.v + i] = hinge.project(i, &f_d);
                }
            }
            self.give(tree, k, f_d, true);
        }
    }
    /// The wrench across joint `k`, at its hinge frame; modal forces into `out`.
    fn across(&self, tree: &FlexibleTree<T::Constant>, k: usize, out: Option<&mut [T]>) -> Wrench<T> {
        let Some(i) = tree.bodies[k].modal else { return self.f[k] };
        let (modal, state) = (&tree.modal[i], &self.motions.states[i]);
        if let Some(out) = out {
            for l in 0..modal.n {
                out[modal.v + l] = self.f_e[modal.first + l] + state.Gamma[l].dot(self.f[k]);
            }
        }
        state.hinge.wrench_to_child(self.f[k])
    }
    /// Adds a wrench at the hinge frame of body `k` to its parent, with its share of the modal forces.
    fn give(&mut self, tree: &FlexibleTree<T::Constant>, k: usize, f_d: Wrench<T>, modal_forces: bool) {
        let body = &tree.bodies[k];
        if body.parent == GROUND {
            return;
        }
        let mut f_t = self.motions.x[k].wrench_to_parent(f_d);
        if let (Some(i), Some(t)) = (tree.bodies[body.parent].modal, body.node) {
            let node = &self.motions.states[i].nodes[t];
            if modal_forces {
                let first = tree.modal[i].first;
                for (l, Pi) in node.Pi.iter().enumerate() {
                    self.f_e[first + l] += Pi.dot(f_t);
                }
            }
            f_t = node.pose.wrench_to_parent(f_t);
        }
        self.f[body.parent] += f_t;
    }
    /// ½ Σ y·M_fl y.
    pub(crate) fn kinetic_energy(&mut self, tree: &FlexibleTree<T::Constant>, q: &[T], v: &[T]) -> T {
        self.motions.set_position(tree, q);
        self.motions.set_velocity(tree, v);
        let mut twice = T::zero();
        for (k, body) in tree.bodies.iter().enumerate() {
            let velocity = self.motions.velocity[k];
            twice += match body.modal {
                None => velocity.dot(RigidInertia::constant(&body.inertia).momentum(velocity)),
                Some(i) => {
                    let modal = &tree.modal[i];
                    let p_e = &mut self.f_e[modal.first..modal.first + modal.n];
                    let p = self.motions.momentum(tree, i, v, velocity, p_e);
                    let rates = &v[modal.v..modal.v + modal.n];
                    p_e.iter().zip(rates).fold(velocity.dot(p), |sum, (p, x)| sum + *p * *x)
                }
            };
        }
        T::splat(0.5) * twice
    }
    /// Where the first root is in the world: the point to refer to, so that a far scene costs no digits. After a position is set.
    pub(crate) fn reference(&mut self, tree: &FlexibleTree<T::Constant>, q: &[T]) -> Vec3<T> {
        self.motions.set_position(tree, q);
        self.motions.x.first().map_or(Vec3::zero(), |x| x.translation)
    }
    /// Momenta of all bodies, gathered to the roots: about a point of the world; world axes.
    pub(crate) fn momentum(
        &mut self,
        tree: &FlexibleTree<T::Constant>,
        q: &[T],
        v: &[T],
        about: Vec3<T>,
    ) -> Wrench<T> {
        self.motions.set_position(tree, q);
        self.motions.set_velocity(tree, v);
        for (k, body) in tree.bodies.iter().enumerate() {
            let velocity = self.motions.velocity[k];
            self.f[k] = match body.modal {
                None => RigidInertia::constant(&body.inertia).momentum(velocity),
                Some(i) => {
                    let modal = &tree.modal[i];
                    let p_e = &mut self.f_e[modal.first..modal.first + modal.n];
                    self.motions.momentum(tree, i, v, velocity, p_e)
                }
            };
        }
        let mut total = Wrench::zero();
        for k in (0..tree.bodies.len()).rev() {
            let h = self.across(tree, k, None);
            self.give(tree, k, h, false);
            if tree.bodies[k].parent == GROUND {
                let x = &self.motions.x[k];
                total += Transform::new(x.rotation, x.translation - about).wrench_to_parent(h);
            }
        }
        total
    }
    /// Mass and Σ m c of all bodies about a point of the world, world axes.
    pub(crate) fn first_moment(
        &mut self,
        tree: &FlexibleTree<T::Constant>,
        q: &[T],
        about: Vec3<T>,
    ) -> (T, Vec3<T>) {
        self.motions.set_position(tree, q);
        self.motions.world_poses(tree, about, &mut self.world);
        let (mut mass, mut moment) = (T::zero(), Vec3::zero());
        for (k, body) in tree.bodies.iter().enumerate() {
            let pose = &self.world[k];
            let (m, d) = match body.modal {
                None => (T::constant(body.inertia.mass), Vec3::constant(body.inertia.first_moment)),
                Some(i) => {
                    let M = &self.motions.states[i].M_dd;
                    (M.mass, M.first_moment)
                }
            };
            mass += m;
            moment += pose.rotation * d + pose.translation.scale(m);
        }
        (mass, moment)
    }
    /// −g·Σ m c + ½ η·K η.
    pub(crate) fn potential_energy(
        &mut self,
        layout: &Layout<T::Constant>,
        tree: &FlexibleTree<T::Constant>,
        q: &[T],
    ) -> T {
        let (_, moment) = self.first_moment(tree, q, Vec3::zero());
        let mut twice = T::zero();
        for modal in &tree.modal {
            let eta = &q[modal.q..modal.q + modal.n];
            for (l, x) in eta.iter().enumerate() {
                for (m, y) in eta.iter().enumerate() {
                    twice += T::constant(modal.stiffness[l * modal.n + m]) * (*x * *y);
                }
            }
        }
        T::splat(0.5) * twice - Vec3::constant(layout.gravity()).dot(moment)
    }
}
