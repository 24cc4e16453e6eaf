//! The projection I − b̂b̂* of closed chains.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | l | (I + HφK) D^½ of the open tree: 𝓜 = l l* | n×n | paper 2 (2.10) |
//! | b̂ | D^−½HψB (B*ΩB)^−½, orthonormal: the directions that the loops close | n×rank | paper 2 (4.21) |
//! | NN* | from forces to accelerations of the closed mechanism | n×n | paper 2 (4.20) |
//!
//! θ̈ = l^−* (I − b̂b̂*) l^−1 T on the closures, so that I − b̂b̂* = l* NN* l: one inward sweep, one solution of the closed
//! mechanism, one outward sweep. Closing a loop changes P and D above its ancestor: l belongs to the open tree.

use crate::closed_dynamics::{ClosedDynamics, Conditions};
use crate::compiled::Number;
use crate::error::{ClosureError, check_length};
use crate::factors::{Factors, Regard};
use crate::frames::Frames;
use crate::number::Arithmetic;
use crate::solution::Load;
use crate::structure::Structure;
use phipsi_model::Model;
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Kernel, Motion, Vec3, Wrench};

/// I − b̂b̂* at one configuration, as sweeps.
#[derive(Clone, Debug)]
pub struct Projection<T: Number> {
    closed: ClosedDynamics<T>,
    tree: Structure<T>,
    /// Poses for the tree, which has no loops.
    still: Frames<T>,
    open: Factors<T>,
    z: Vec<Wrench<Arithmetic<T>>>,
    velocity: Vec<Motion<Arithmetic<T>>>,
    force: Vec<T>,
}

impl<T: Number> Projection<T> {
    /// The projection of a model at `q` (nq).
    ///
    /// # Errors
    /// [`ClosureError`], as [`ClosedDynamics::new`] and [`ClosedDynamics::run`]; models with flexible bodies are refused.
    pub fn new(model: &Model, q: &[T]) -> Result<Self, ClosureError> {
        let closed = ClosedDynamics::new(model)?;
        closed.layout.check_rigid("Projection")?;
        let tree = Structure::new(&model.clone().without_closures(), &closed.layout, &closed.tree)?;
        let mut projection = Projection {
            still: Frames::new(&tree, &closed.layout, &closed.tree),
            open: Factors::new(&tree, &closed.layout, &closed.tree),
            z: vec![Wrench::zero(); closed.tree.len()],
            velocity: vec![Motion::zero(); closed.tree.len()],
            force: vec![T::zero(); closed.layout.nv()],
            tree,
            closed,
        };
        projection.update(q)?;
        Ok(projection)
    }
    /// Goes to another configuration, without allocation.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`].
    pub fn update(&mut self, q: &[T]) -> Result<(), ClosureError> {
        let ClosedDynamics { structure, layout, tree, frames, factors, .. } = &mut self.closed;
        check_length("q", q, layout.nq())?;
        let trees = (&*layout, &*tree);
        frames.set_position(structure, trees, q, None);
        factors.update(structure, trees, frames, None, Regard::Error)?;
        self.still.set_position(&self.tree, trees, q, None);
        self.open.update(&self.tree, trees, &self.still, None, Regard::Error)?;
        Ok(())
    }
    /// Number of directions that the loops close: the rank of b̂.
    pub fn rank(&self) -> usize {
        self.closed.factors.rank.rank
    }
    /// Number of degrees of freedom.
    pub fn len(&self) -> usize {
        self.closed.layout.nv()
    }
    /// True if nothing moves.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// x ← (I − b̂b̂*) x, in the coordinates of the normalised residuals D^½ν. `x`: nv. Cost O(n), no allocation.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`] for a wrong length.
    pub fn apply(&mut self, x: &mut [T]) -> Result<(), ClosureError> {
        check_length("x", x, self.len())?;
        T::multiply_by_root(Root { projection: self, x: T::arithmetic_mut(x), adjoint: false });
        self.solve(x)?;
        T::multiply_by_root(Root { projection: self, x: T::arithmetic_mut(x), adjoint: true });
        Ok(())
    }
    /// x ← NN* x: accelerations of the closed mechanism at rest, without weight, under generalised forces. `x`: nv.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`] for a wrong length.
    pub fn solve(&mut self, x: &mut [T]) -> Result<(), ClosureError> {
        check_length("x", x, self.len())?;
        self.force.copy_from_slice(x);
        let ClosedDynamics { structure, tree, frames, factors, solution, .. } = &mut self.closed;
        solution.clear();
        let load = Load { tau: Some(T::arithmetic(&self.force)), prescribed: None, ground: Vec3::zero() };
        solution.run(structure, tree, frames, factors, &load, x);
        Ok(())
    }
    /// x ← l x, inward. `x`: nv.
    #[inline(always)]
    fn multiply_by_root(&mut self, x: &mut [Arithmetic<T>]) {
        self.z.fill(Wrench::zero());
        for (k, body) in self.closed.tree.bodies.iter().enumerate().rev() {
            let Some(hinge) = body.hinge() else { continue };
            for i in 0..body.nv {
                let at = body.v + i;
                let u = x[at];
                x[at] = self.open.roots[at] * u + hinge.project(i, &self.z[k]);
                self.z[k] = self.open.xi[at].scale_add(u, self.z[k]);
            }
            if body.parent != GROUND {
                let z = self.still.poses[k].wrench_to_parent(self.z[k]);
                self.z[body.parent] += z;
            }
        }
    }
    /// x ← l* x, outward. `x`: nv.
    #[inline(always)]
    fn multiply_by_adjoint(&mut self, x: &mut [Arithmetic<T>]) {
        for (k, body) in self.closed.tree.bodies.iter().enumerate() {
            let mut velocity = match body.parent {
                GROUND => Motion::zero(),
                parent => self.still.poses[k].motion_to_child(self.velocity[parent]),
            };
            let Some(hinge) = body.hinge() else { continue };
            for i in (0..body.nv).rev() {
                let at = body.v + i;
                let u = x[at];
                x[at] = self.open.roots[at] * u + velocity.dot(self.open.xi[at]);
                hinge.add_axis(i, u, &mut velocity);
            }
            self.velocity[k] = velocity;
        }
    }
    /// Rows of the closures on velocities: `rates` gets J v. `v`: nv, `rates`: rows.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`] for a wrong length.
    pub fn closure_rates(&mut self, v: &[T], rates: &mut [T]) -> Result<(), ClosureError> {
        check_length("v", v, self.len())?;
        check_length("rates", rates, self.closed.rows())?;
        self.closed.set_rates(v, &Conditions::default());
        rates.copy_from_slice(&self.closed.rates);
        Ok(())
    }
}

/// l or l*.
pub(crate) struct Root<'a, T: Number> {
    projection: &'a mut Projection<T>,
    x: &'a mut [Arithmetic<T>],
    adjoint: bool,
}

impl<T: Number> Kernel for Root<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        if self.adjoint {
            self.projection.multiply_by_adjoint(self.x);
        } else {
            self.projection.multiply_by_root(self.x);
        }
    }
}
