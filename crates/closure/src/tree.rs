//! The tree that loops are closed on: the bodies of a layout, a flexible body as two of them, its hinge frame and its modes.
//!
//! | symbol | meaning |
//! |---|---|
//! | modes | a body whose "joint" is n modal coordinates; its frame is its parent's, the hinge frame of the flexible body |
//! | attached | what moves with a flexible body: a child of its modes, or an end of a loop on it |
//! | Π | motion of what is attached by the rates of the modes, hinge frame |
//!
//! Only six-vectors leave the modes: inboard of them a loop meets rigid bodies.

use phipsi_recursion::Layout;
use phipsi_recursion::flexible::StationJoint;
use phipsi_recursion::hinge::Hinge;
use phipsi_recursion::layout::{GROUND, LayoutBody, Shift};
use phipsi_spatial::{ArticulatedInertia, Real, RigidInertia, Scalar, Transform, Wrench};

/// How a body moves in its parent.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Joint<T> {
    /// By a joint.
    Hinge(Hinge<T>),
    /// Not at all.
    Fixed,
    /// By the modes of the flexible body of this number.
    Modes(usize),
}

/// Where a body is in its parent, or in the node of a flexible one.
#[derive(Clone, Copy, Debug)]
enum Place<T> {
    Link(LayoutBody<T>),
    Frame { q: usize, placement: Transform<T> },
}

/// A body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TreeBody<T> {
    /// Index of its parent, or [`GROUND`].
    pub(crate) parent: usize,
    pub(crate) joint: Joint<T>,
    /// First degree of freedom, and their number.
    pub(crate) v: usize,
    pub(crate) nv: usize,
    pub(crate) inertia: RigidInertia<T>,
    place: Place<T>,
    /// The flexible body that its parent is the modes of, and the node that it is on (`None`: F).
    pub(crate) on: Option<(usize, Option<usize>)>,
}

impl<T: Real> TreeBody<T> {
    /// Its joint, if it has one.
    #[inline(always)]
    pub(crate) fn hinge(&self) -> Option<&Hinge<T>> {
        if let Joint::Hinge(hinge) = &self.joint { Some(hinge) } else { None }
    }
    /// Passage to its parent, or to the node that it is on, and pose there. `sin`, `cos`: of all coordinates.
    #[inline(always)]
    pub(crate) fn shift<S: Scalar<Constant = T>>(
        &self,
        q: &[S],
        sin: &[S],
        cos: &[S],
    ) -> (Shift<S>, Transform<S>) {
        match &self.place {
            Place::Link(body) => body.shift(q, (sin[body.q], cos[body.q])),
            Place::Frame { q: at, placement } => {
                let pose = match &self.joint {
                    Joint::Hinge(hinge) => hinge.transform(placement, &q[*at..]),
                    Joint::Fixed | Joint::Modes(_) => Transform::constant(placement),
                };
                (Shift::identity(), pose)
            }
        }
    }
    /// φ(p, k) (P − G H P) φ*(p, k) of a joint of one axis with gain G, where that is cheaper than by the pose.
    #[inline(always)]
    pub(crate) fn eliminated_to_parent<S: Scalar<Constant = T>>(
        &self,
        shift: &Shift<S>,
        P: &ArticulatedInertia<S>,
        gain: &Wrench<S>,
    ) -> Option<ArticulatedInertia<S>> {
        match &self.place {
            Place::Link(body) => body.eliminated_to_parent(shift, P, gain),
            Place::Frame { .. } => None,
        }
    }
    /// Pose in its parent at q = 0.
    pub(crate) fn placement(&self) -> Transform<T> {
        match &self.place {
            Place::Link(body) => body.placement(),
            Place::Frame { placement, .. } => *placement,
        }
    }
}

/// The bodies, parents first.
#[derive(Clone, Debug)]
pub(crate) struct Tree<T> {
    pub(crate) bodies: Vec<TreeBody<T>>,
    /// The body on which each body of the layout's carriers is.
    pub(crate) carriers: Vec<usize>,
}

impl<T: Real> Tree<T> {
    pub(crate) fn new(layout: &Layout<T>) -> Self {
        let Some((stations, carriers)) = layout.stations() else {
            let of = |body: &LayoutBody<T>| TreeBody {
                parent: body.parent,
                joint: Joint::Hinge(body.hinge),
                v: body.v,
                nv: body.hinge.nv(),
                inertia: body.inertia,
                place: Place::Link(*body),
                on: None,
            };
            return Tree {
                bodies: layout.bodies().iter().map(of).collect(),
                carriers: (0..layout.len()).collect(),
            };
        };
        let held = layout.held_bodies();
        let modes_of = |k: usize| match stations.get(k)?.joint {
            StationJoint::Modes(i) => Some(i),
            _ => None,
        };
        let of = |station: &phipsi_recursion::flexible::Station<T>| {
            let (joint, nv) = match station.joint {
                StationJoint::Hinge(hinge) => (Joint::Hinge(hinge), hinge.nv()),
                StationJoint::Fixed => (Joint::Fixed, 0),
                StationJoint::Modes(i) => (Joint::Modes(i), held[i].modes()),
            };
            TreeBody {
                parent: station.parent,
                joint,
                v: station.v,
                nv,
                inertia: station.inertia,
                place: Place::Frame { q: station.q, placement: station.placement },
                on: modes_of(station.parent).map(|i| (i, station.node)),
            }
        };
        Tree { bodies: stations.iter().map(of).collect(), carriers }
    }
    /// Number of bodies.
    pub(crate) fn len(&self) -> usize {
        self.bodies.len()
    }
    /// The body of a carrier.
    pub(crate) fn carrier(&self, body: usize) -> usize {
        if body == GROUND { GROUND } else { self.carriers[body] }
    }
    /// The flexible body whose modes a body is.
    pub(crate) fn modes(&self, k: usize) -> Option<usize> {
        match self.bodies.get(k)?.joint {
            Joint::Modes(i) => Some(i),
            _ => None,
        }
    }
}
