//! Workspaces that the public algorithms hold for layouts with flexible bodies.

use super::motions::{Motions, checked, ground};
use super::{Filter, FlexibleTree, NewtonEuler, gather_loads};
use crate::error::{DynamicsError, check_length};
use crate::layout::Layout;
use phipsi_spatial::{Motion, Scalar, Transform, Wrench};

/// Of forward dynamics.
#[derive(Clone, Debug)]
pub(crate) struct Forward<T: Scalar> {
    filter: Filter<T>,
    loads: Vec<Wrench<T>>,
}

impl<T: Scalar> Forward<T> {
    pub(crate) fn new(tree: &FlexibleTree<T::Constant>) -> Self {
        Forward { filter: Filter::new(tree), loads: vec![Wrench::zero(); tree.bodies.len()] }
    }
    /// `out` holds τ before and accelerations after. Lengths are checked by the caller.
    pub(crate) fn run(
        work: &mut Option<Box<Self>>,
        layout: &Layout<T::Constant>,
        state: (&[T], &[T]),
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        let Some(tree) = layout.flexible() else { return Ok(()) };
        let Forward { filter, loads } = checked(work, tree, |work| &work.filter.motions)?;
        if let Some(wrenches) = wrenches {
            gather_loads(layout, wrenches, loads);
        }
        let loads = wrenches.map(|_| &loads[..]);
        filter.run(layout, tree, ground(layout.gravity()), state, loads, out)
    }
}

/// Of inverse dynamics.
#[derive(Clone, Debug)]
pub(crate) struct Inverse<T: Scalar> {
    sweep: NewtonEuler<T>,
    loads: Vec<Wrench<T>>,
}

impl<T: Scalar> Inverse<T> {
    pub(crate) fn new(tree: &FlexibleTree<T::Constant>) -> Self {
        Inverse { sweep: NewtonEuler::new(tree), loads: vec![Wrench::zero(); tree.bodies.len()] }
    }
    /// Lengths are checked by the caller.
    pub(crate) fn run(
        work: &mut Option<Box<Self>>,
        layout: &Layout<T::Constant>,
        state: (&[T], &[T], &[T]),
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        let Some(tree) = layout.flexible() else { return Ok(()) };
        let Inverse { sweep, loads } = checked(work, tree, |work| &work.sweep.motions)?;
        if let Some(wrenches) = wrenches {
            gather_loads(layout, wrenches, loads);
        }
        sweep.run(layout, tree, state, wrenches.map(|_| &loads[..]), out);
        Ok(())
    }
}

/// Of solutions with the mass matrix: forward dynamics at rest, without weight and strain.
#[derive(Clone, Debug)]
pub(crate) struct Solution<T: Scalar> {
    filter: Filter<T>,
    tree: FlexibleTree<T::Constant>,
    rest: Vec<T>,
}

impl<T: Scalar> Solution<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Option<Box<Self>> {
        let tree = layout.flexible()?.clone().inertial();
        Some(Box::new(Solution { filter: Filter::new(&tree), tree, rest: vec![T::zero(); layout.nv()] }))
    }
    /// x ← M⁻¹ x for every row of `x`, of nv numbers each.
    pub(crate) fn run(
        work: &mut Option<Box<Self>>,
        layout: &Layout<T::Constant>,
        q: &[T],
        x: &mut [T],
    ) -> Result<(), DynamicsError> {
        let Some(tree) = layout.flexible() else { return Ok(()) };
        check_length("q", q, layout.nq())?;
        let Solution { filter, tree, rest } = checked(work, tree, |work| &work.filter.motions)?;
        for row in x.chunks_exact_mut(layout.nv()) {
            filter.run(layout, tree, Motion::zero(), (q, rest), None, row)?;
        }
        Ok(())
    }
}

/// Of kinematics.
#[derive(Clone, Debug)]
pub(crate) struct Placing<T: Scalar> {
    motions: Motions<T>,
    /// Poses of bodies' frames in the world.
    pub(crate) world: Vec<Transform<T>>,
    acceleration: Vec<Motion<T>>,
}

impl<T: Scalar> Placing<T> {
    pub(crate) fn new(tree: &FlexibleTree<T::Constant>) -> Self {
        let n = tree.bodies.len();
        Placing {
            motions: Motions::new(tree),
            world: vec![Transform::identity(); n],
            acceleration: vec![Motion::zero(); n],
        }
    }
    pub(crate) fn checked<'a>(
        work: &'a mut Option<Box<Self>>,
        tree: &FlexibleTree<T::Constant>,
    ) -> Result<&'a mut Self, DynamicsError> {
        checked(work, tree, |work| &work.motions)
    }
    pub(crate) fn set_position(&mut self, tree: &FlexibleTree<T::Constant>, q: &[T]) {
        self.motions.set_position(tree, q);
        self.motions.world_poses(tree, phipsi_spatial::Vec3::zero(), &mut self.world);
    }
    pub(crate) fn set_velocity(&mut self, tree: &FlexibleTree<T::Constant>, v: &[T]) {
        self.motions.set_velocity(tree, v);
    }
    pub(crate) fn set_acceleration(&mut self, tree: &FlexibleTree<T::Constant>, v: &[T], a: &[T]) {
        for (k, body) in tree.bodies.iter().enumerate() {
            let parent = match body.parent {
                crate::layout::GROUND => Motion::zero(),
                p => self.acceleration[p],
            };
            self.acceleration[k] = self.motions.accelerated(tree, k, parent, v, a);
        }
    }
    /// Velocity and acceleration of tree body `k`, its frame.
    pub(crate) fn motion(&self, k: usize) -> (Motion<T>, Motion<T>) {
        (self.motions.velocity[k], self.acceleration[k])
    }
    /// World pose of a node of tree body `k`; `None` if it has none of that index.
    pub(crate) fn node_pose(
        &self,
        tree: &FlexibleTree<T::Constant>,
        k: usize,
        node: usize,
    ) -> Option<Transform<T>> {
        let state = &self.motions.states[tree.bodies.get(k)?.modal?];
        Some(self.world[k].compose(&state.nodes.get(node)?.pose))
    }
    /// Velocity and acceleration of a node at rates `v` and `a`, node axes.
    pub(crate) fn node_motion(
        &self,
        tree: &FlexibleTree<T::Constant>,
        k: usize,
        node: usize,
        (v, a): (&[T], &[T]),
    ) -> Option<(Motion<T>, Motion<T>)> {
        let i = tree.bodies.get(k)?.modal?;
        let modal = &tree.modal[i];
        let state = self.motions.states[i].nodes.get(node)?;
        let rates = |x: &[T]| -> Option<Vec<T>> { x.get(modal.v..modal.v + modal.n).map(<[T]>::to_vec) };
        let velocity = state.carry(self.motions.velocity[k], &rates(v)?);
        Some((velocity, state.carry(self.acceleration[k], &rates(a)?) + state.c))
    }
}
