//! A tree with flexible bodies as closed loops are eliminated on it: every flexible body is two stations, the hinge frame of its
//! inboard joint and, on it, its modes.
//!
//! | symbol | meaning | axes |
//! |---|---|---|
//! | d | hinge frame of a flexible body | |
//! | α_t | X_t α_d + Π_t η̈ + c_t: acceleration of node t, or of F | its own |
//! | M′, b′ | L* M_fl L and L* (b_fl + M_fl o) with strain and damping: of the body alone, seen from d | d |
//!
//! Only six-vectors at d leave the modes, so that whatever is closed inboard of a flexible body meets a rigid one.

use super::body::BodyState;
use super::filter::Front;
use super::motions::elastic;
use super::tree::FlexibleTree;
use crate::hinge::Hinge;
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{ArticulatedInertia, Motion, Real, RigidInertia, Transform, Vec3, Wrench};

/// How a station moves in its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StationJoint<C> {
    /// By a joint.
    Hinge(Hinge<C>),
    /// Not at all.
    Fixed,
    /// The modes of the flexible body of this number; the station's frame is its parent's, d.
    Modes(usize),
}

/// A rigid body, the hinge frame of a flexible one, or its modes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station<C> {
    /// Index of its parent, or [`GROUND`].
    pub parent: usize,
    /// On a parent that is modes: the node that the joint is on; `None`: F.
    pub node: Option<usize>,
    /// How it moves.
    pub joint: StationJoint<C>,
    /// First position coordinate.
    pub q: usize,
    /// First degree of freedom.
    pub v: usize,
    /// Joint frame in the parent's or the node's frame.
    pub placement: Transform<C>,
    /// Of a rigid body; zero for the others.
    pub inertia: RigidInertia<C>,
}

impl<C: Real> Layout<C> {
    /// The stations of a layout with flexible bodies, parents first, and the station on which each body of
    /// [`Layout::carriers`] is; `None` for a rigid layout. Cost O(n).
    pub fn stations(&self) -> Option<(Vec<Station<C>>, Vec<usize>)> {
        let tree = self.flexible()?;
        let mut stations = Vec::new();
        // The station that carries a body's children: its modes, if it has any.
        let mut outer: Vec<usize> = Vec::with_capacity(tree.bodies.len());
        for body in &tree.bodies {
            let parent = if body.parent == GROUND { GROUND } else { outer[body.parent] };
            let joint = body.hinge.map_or(StationJoint::Fixed, StationJoint::Hinge);
            stations.push(Station {
                parent,
                node: body.node,
                joint,
                q: body.q,
                v: body.v,
                placement: body.placement,
                inertia: body.inertia,
            });
            if let Some(i) = body.modal {
                stations.push(Station {
                    parent: stations.len() - 1,
                    node: None,
                    joint: StationJoint::Modes(i),
                    q: tree.modal[i].q,
                    v: tree.modal[i].v,
                    placement: Transform::identity(),
                    inertia: RigidInertia::zero(),
                });
            }
            outer.push(stations.len() - 1);
        }
        Some((stations, outer))
    }
    /// The flexible bodies at rest, undeformed; empty for a rigid layout.
    pub fn held_bodies(&self) -> Vec<HeldBody<C>> {
        let count = self.flexible().map_or(0, |tree| tree.modal.len());
        let made = (0..count).filter_map(|i| HeldBody::new(self.flexible()?, i));
        made.collect()
    }
}

/// A flexible body at a state, seen from its hinge frame.
#[derive(Clone, Debug)]
pub struct HeldBody<T> {
    index: usize,
    state: BodyState<T>,
    /// F, then the nodes.
    places: Vec<Place<T>>,
    /// M′_ee (lower triangle) and M′_ed by rows, M′_dd.
    front: Front<T>,
    inertia: ArticulatedInertia<T>,
    /// b′_e, b′_d.
    bias: Vec<T>,
    load: Wrench<T>,
}

/// F or a node.
#[derive(Clone, Debug)]
struct Place<T> {
    pose: Transform<T>,
    Pi: Vec<Motion<T>>,
    c: Motion<T>,
}

impl<T: Real> HeldBody<T> {
    fn new(tree: &FlexibleTree<T>, index: usize) -> Option<Self> {
        let modal = tree.modal.get(index)?;
        let n = modal.n;
        let place = Place { pose: Transform::identity(), Pi: vec![Motion::zero(); n], c: Motion::zero() };
        Some(HeldBody {
            index,
            state: BodyState::new(modal),
            places: vec![place; modal.nodes.len() + 1],
            front: Front { c: vec![T::zero(); n * n], W: vec![Wrench::zero(); n], y: vec![T::zero(); n] },
            inertia: ArticulatedInertia::zero(),
            bias: vec![T::zero(); n],
            load: Wrench::zero(),
        })
    }
    /// Number of modes.
    pub fn modes(&self) -> usize {
        self.bias.len()
    }
    /// Its modal coordinates in v.
    pub fn v_range(&self, layout: &Layout<T>) -> std::ops::Range<usize> {
        let first = layout.flexible().map_or(0, |tree| tree.modal[self.index].v);
        first..first + self.modes()
    }
    fn place(&self, node: Option<usize>) -> &Place<T> {
        &self.places[node.map_or(0, |t| t + 1)]
    }
    /// Pose of a node, or of F, in the hinge frame.
    pub fn pose(&self, node: Option<usize>) -> &Transform<T> {
        &self.place(node).pose
    }
    /// Π_t by columns: motion of a node, or of F, by the rates of the modes with the hinge frame at rest; its own axes.
    pub fn motions(&self, node: Option<usize>) -> &[Motion<T>] {
        &self.place(node).Pi
    }
    /// c_t: what the acceleration of a node, or of F, has beyond X_t α_d + Π_t η̈; its own axes. After [`Self::set_velocity`].
    pub fn velocity_terms(&self, node: Option<usize>) -> Motion<T> {
        self.place(node).c
    }
    /// M′: lower triangle of the modes' block by rows, the columns that couple them with the hinge frame, the block of that.
    pub fn mass(&self) -> (&[T], &[Wrench<T>], &ArticulatedInertia<T>) {
        (&self.front.c, &self.front.W, &self.inertia)
    }
    /// b′ of the modes and of the hinge frame. After [`Self::set_velocity`].
    pub fn bias(&self) -> (&[T], Wrench<T>) {
        (&self.bias, self.load)
    }
    /// Poses, Π and M′ at `q` of the whole model.
    pub fn set_position(&mut self, layout: &Layout<T>, q: &[T]) {
        let Some(tree) = layout.flexible() else { return };
        let modal = &tree.modal[self.index];
        let (n, state) = (modal.n, &mut self.state);
        state.set_position(modal, &tree.series, &q[modal.q..modal.q + n]);
        let held = modal.inboard.is_some();
        let F_in_hinge = state.hinge.inverse();
        for l in 0..n {
            self.places[0].Pi[l] = if held { state.Gamma[l] } else { Motion::zero() };
        }
        self.places[0].pose = F_in_hinge;
        for (t, node) in state.nodes.iter().enumerate() {
            let place = &mut self.places[t + 1];
            place.pose = F_in_hinge.compose(&node.pose);
            for l in 0..n {
                let carried = if held { node.pose.motion_to_child(state.Gamma[l]) } else { Motion::zero() };
                place.Pi[l] = node.Pi[l] + carried;
            }
        }
        self.front.c.copy_from_slice(&modal.M_ee);
        self.front.W.copy_from_slice(&state.M_de);
        self.inertia = state.M_dd.to_articulated();
        self.front.change_to_hinge(&mut self.inertia, held, state);
    }
    /// Velocity terms, strain and damping at `q` and `v` of the whole model and the angular velocity of the hinge frame, its
    /// axes; after [`Self::set_position`].
    pub fn set_velocity(&mut self, layout: &Layout<T>, (q, v): (&[T], &[T]), omega: Vec3<T>) {
        let Some(tree) = layout.flexible() else { return };
        let modal = &tree.modal[self.index];
        let (n, state) = (modal.n, &mut self.state);
        let held = modal.inboard.is_some();
        let rates = &v[modal.v..modal.v + n];
        let mut omega_F = state.hinge.rotation * omega;
        if held {
            for l in 0..n {
                omega_F += state.Gamma[l].angular.scale(rates[l]);
            }
        }
        state.set_velocity(modal, rates, omega_F);
        let o = if held { state.o } else { Motion::zero() };
        self.places[0].c = o;
        for (place, node) in self.places[1..].iter_mut().zip(&state.nodes) {
            place.c = node.c + node.pose.motion_to_child(o);
        }
        // L* (b_fl + M_fl o).
        let mut z = state.b_d + state.M_dd.momentum(o);
        for l in 0..n {
            self.bias[l] = state.b_e[l] + elastic(modal, l, q, v) + o.dot(state.M_de[l]);
        }
        if held {
            for l in 0..n {
                self.bias[l] += state.Gamma[l].dot(z);
            }
        }
        z = state.hinge.wrench_to_child(z);
        self.load = z;
    }
}
