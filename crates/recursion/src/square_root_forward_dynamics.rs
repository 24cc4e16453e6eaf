//! Forward dynamics by a square-root information filter: the articulated recursion on factors of the inertias.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | S, y | Gauss' sum of squares Σ ½‖S α + y‖² of a body and what hangs on it; S*S = P | rows×6, rows | soa.md 2.2 |
//! | p | linear term p·α: forces that no inertia carries, and joint forces | 6 | soa.md 2.2 |
//! | ρ, r | row that a hinge takes out: ρ x + r·α⁺ + y; ρ² = D, r ρ = P H* | 1, 6 | paper 1 (9.5)–(9.6) |
//! | e | T − H p, joint force that is left for the hinge | 1 | |
//! | u | e/ρ − y: then x = (u − r·α⁺)/ρ | 1 | paper 1 (9.13) |
//! | a, c, ω, α | as in [`mod@crate::forward_dynamics`] | | |
//!
//! The plain recursion subtracts U D⁻¹ U* from P, which loses ε × (mass ratio) where a heavy body hangs on a light one. Here
//! reflections (`rows.rs`) turn the rows of a body and its children until one of them alone contains the hinge; the others
//! are what the joint lets through. Nothing is subtracted, and rows of all sizes keep their digits.
//!
//! A joint of several degrees of freedom is eliminated one after the other, displacements first: rotations are then found
//! from moments about the centre of mass, however far that is from the frame's origin. Children's rows are reduced to six as they come.

#[doc(hidden)]
pub mod body;
#[doc(hidden)]
pub mod rows;

use crate::error::{DynamicsError, check_length};
use crate::kinematics::coriolis;
use crate::layout::{GROUND, Layout};
use body::BodyRows;
use phipsi_model::Model;
use phipsi_spatial::{Motion, Real, Transform, Vec3, Wrench};
use rows::{Held, Rows, covector, zero};

/// An eliminated degree of freedom: x = (u − r·α⁺)/ρ.
#[derive(Clone, Copy, Debug)]
struct Taken<T> {
    r: Wrench<T>,
    rho: T,
    u: T,
}

/// Workspace of forward dynamics in its square-root form.
#[derive(Clone, Debug)]
pub struct SquareRootForwardDynamics<T> {
    bodies: Vec<BodyRows<T>>,
    hinge: Vec<Transform<T>>,
    omega: Vec<Vec3<T>>,
    coriolis: Vec<Motion<T>>,
    children: Vec<Held<T>>,
    load: Vec<Wrench<T>>,
    linear: Vec<Wrench<T>>,
    alpha: Vec<Motion<T>>,
    taken: Vec<Taken<T>>,
    stack: Rows<T>,
    at_parent: Rows<T>,
}

impl<T: Real> SquareRootForwardDynamics<T> {
    /// A workspace for a model and its layout. Cost O(n).
    pub fn new(model: &Model, layout: &Layout<T>) -> Self {
        let n = layout.len();
        let none = Taken { r: Wrench::zero(), rho: T::one(), u: T::zero() };
        SquareRootForwardDynamics {
            bodies: BodyRows::of_layout(model, layout),
            hinge: vec![Transform::identity(); n],
            omega: vec![Vec3::zero(); n],
            coriolis: vec![Motion::zero(); n],
            children: vec![([zero(); 6], 0); n],
            load: vec![Wrench::zero(); n],
            linear: vec![Wrench::zero(); n],
            alpha: vec![Motion::zero(); n],
            taken: vec![none; layout.nv()],
            stack: Rows::new(),
            at_parent: Rows::new(),
        }
    }
    /// Accelerations of generalised forces `tau` at (q, v): the result of [`crate::ForwardDynamics::run`], arguments as there.
    ///
    /// # Computes
    /// min over θ̈ of Σ ½‖S(k) α(k) + y(k)‖² + p(k)·α(k) − τ·θ̈, Gauss' principle.
    ///
    /// # Cost
    /// O(n): three sweeps; no allocation.
    ///
    /// # Accuracy
    /// n·ε·κ; no mass ratio multiplies it on the generated trees, nor on chains over a hundred decades of mass
    /// (`docs/src/accuracy.md`).
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`]; [`DynamicsError::SingularHinge`] if D = ρ² is zero to rounding,
    /// also when a coordinate is not finite.
    pub fn run(
        &mut self,
        layout: &Layout<T>,
        q: &[T],
        v: &[T],
        tau: &[T],
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        layout.check_rigid("square_root_forward_dynamics")?;
        check_length("q", q, layout.nq())?;
        check_length("v", v, layout.nv())?;
        check_length("tau", tau, layout.nv())?;
        check_length("out", out, layout.nv())?;
        check_length("workspace", &self.linear, layout.len())?;
        check_length("workspace", &self.taken, layout.nv())?;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, layout.model_bodies())?;
        }
        self.sweep_velocities(layout, q, v);
        for (carrier, wrench) in layout.carriers().iter().zip(wrenches.unwrap_or_default()) {
            if carrier.body != GROUND {
                self.load[carrier.body] -= carrier.pose.wrench_to_parent(*wrench);
            }
        }
        self.sweep_inboard(layout, tau)?;
        self.sweep_outboard(layout, v, out);
        Ok(())
    }

    fn sweep_velocities(&mut self, layout: &Layout<T>, q: &[T], v: &[T]) {
        for (k, body) in layout.bodies().iter().enumerate() {
            let x = body.pose(q);
            let joint = body.hinge.expand(&v[body.v..]);
            let inboard = if body.parent == GROUND { Vec3::zero() } else { self.omega[body.parent] };
            let omega = x.rotation.transpose_mul(inboard) + joint.angular;
            self.coriolis[k] = coriolis(&x, inboard, omega, joint);
            (self.hinge[k], self.omega[k]) = (x, omega);
            self.children[k].1 = 0;
            (self.load[k], self.linear[k]) = (Wrench::zero(), Wrench::zero());
        }
    }

    /// Square-root filter. `load` holds the opposite of the external wrench on each body.
    fn sweep_inboard(&mut self, layout: &Layout<T>, tau: &[T]) -> Result<(), DynamicsError> {
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let (hinge, stack, a) = (&body.hinge, &mut self.stack, self.coriolis[k]);
            let (children, count) = &self.children[k];
            stack.clear();
            children[..*count].iter().for_each(|row| stack.push(*row));
            let left = self.bodies[k].rows(self.omega[k], self.load[k], |row| stack.push(row));
            let mut p = self.linear[k] + left;
            for row in stack.get_mut() {
                row[6] += a.dot(covector(row));
            }
            // A helical hinge moves along its axis too: while rows and p are joined, its column is that of its angle.
            let pitch = if hinge.nv() == 1 { hinge.axis::<T>(0).linear.0[2] } else { T::zero() };
            let helical = hinge.components() == [2] && pitch != T::zero();
            if helical {
                stack.join(pitch);
                p.moment.0[2] += pitch * p.force.0[2];
            }
            for (i, &column) in hinge.components().iter().enumerate().rev() {
                let taken = if stack.is_rounding(column) { None } else { stack.take(column) };
                let Some(row) = taken else {
                    return Err(layout.singular(body.v + i, stack.square(column)));
                };
                let (r, rho, e) = (covector(&row), row[column], tau[body.v + i] - p.get(column));
                let share = e / rho;
                p += r.scale(share);
                self.taken[body.v + i] = Taken { r, rho, u: share - row[6] };
            }
            if body.parent != GROUND {
                // H p⁺ = T exactly, so that a free joint lets the size of p through to nothing.
                let mut entries = p.to_array();
                for (i, &column) in hinge.components().iter().enumerate() {
                    entries[column] = tau[body.v + i];
                }
                p = Wrench::from_array(entries);
                if p != Wrench::zero() || stack.get().len() > 6 - hinge.nv() {
                    stack.absorb(&mut p);
                }
            }
            if helical {
                stack.part(pitch);
                p.moment.0[2] -= pitch * p.force.0[2];
                let r = &mut self.taken[body.v].r;
                r.moment.0[2] -= pitch * r.force.0[2];
            }
            if body.parent != GROUND {
                self.linear[body.parent] += self.hinge[k].wrench_to_parent(p);
                self.at_parent.hand_over(&mut self.children[body.parent], &self.hinge[k], self.stack.get());
            }
        }
        Ok(())
    }

    /// Bryson–Frazier smoother.
    fn sweep_outboard(&mut self, layout: &Layout<T>, v: &[T], out: &mut [T]) {
        let ground = Motion::new(Vec3::zero(), -layout.gravity());
        for (k, body) in layout.bodies().iter().enumerate() {
            let inboard = if body.parent == GROUND { ground } else { self.alpha[body.parent] };
            let mut alpha = self.hinge[k].motion_to_child(inboard);
            let c = body.hinge.turning(&v[body.v..]);
            for (i, &component) in body.hinge.components().iter().enumerate() {
                let Taken { r, rho, u } = self.taken[body.v + i];
                let x = (u - alpha.dot(r)) / rho;
                body.hinge.add_axis(i, x, &mut alpha);
                out[body.v + i] = x - c.get(component);
            }
            self.alpha[k] = alpha + self.coriolis[k];
        }
    }
}

/// [`SquareRootForwardDynamics::run`] for a single call.
///
/// # Errors
/// As there.
pub fn square_root_forward_dynamics<T: Real>(
    model: &Model,
    layout: &Layout<T>,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    SquareRootForwardDynamics::new(model, layout).run(layout, q, v, tau, wrenches, &mut out)?;
    Ok(out)
}
