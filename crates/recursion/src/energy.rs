//! Kinetic and potential energy, centre of mass.
//!
//! Bodies welded to the world do not move and do not count, as in other programs: mass and centre of mass are those of the
//! moving bodies.

use crate::error::{DynamicsError, check_length};
use crate::flexible::NewtonEuler;
use crate::kernel::kernel;
use crate::layout::{GROUND, Layout, Shifts};
use phipsi_spatial::{Motion, RigidInertia, Scalar, Transform, Vec3};

/// Workspace of the kinetic energy.
#[derive(Clone, Debug)]
pub struct KineticEnergy<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    velocity: Vec<Motion<T::Arithmetic>>,
    flexible: Option<Box<NewtonEuler<T>>>,
}

impl<T: Scalar> KineticEnergy<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        KineticEnergy {
            shifts: Shifts::new(layout),
            velocity: vec![Motion::zero(); layout.len()],
            flexible: NewtonEuler::of(layout),
        }
    }
    /// ½ Σ V·M V over the bodies, J. `q`: nq, `v`: nv. Cost O(n), no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn run(&mut self, layout: &Layout<T::Constant>, q: &[T], v: &[T]) -> Result<T, DynamicsError> {
        check_length("q", q, layout.nq())?;
        check_length("v", v, layout.nv())?;
        check_length("workspace", &self.velocity, layout.len())?;
        if let Some(tree) = layout.flexible() {
            return Ok(NewtonEuler::checked(&mut self.flexible, tree)?.kinetic_energy(tree, q, v));
        }
        let (q, v) = (T::arithmetic(q), T::arithmetic(v));
        Ok(T::from_arithmetic(T::Arithmetic::dispatch(Energies::<T> { work: self, layout, q, v })))
    }
}

kernel! {
    Energies<'a, T> {
        work: &'a mut KineticEnergy<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        v: &'a [T::Arithmetic],
    } -> T::Arithmetic {
        let KineticEnergy { shifts, velocity, .. } = work;
        let mut twice = T::Arithmetic::splat(0.0);
        shifts.set_all(layout, q);
        for (k, body) in layout.bodies.iter().enumerate() {
            let joint = body.hinge.expand(&v[body.v..]);
            velocity[k] = match body.parent {
                GROUND => joint,
                p => shifts.at(k, body).motion_to_child(velocity[p]) + joint,
            };
            twice += velocity[k].dot(RigidInertia::constant(&body.inertia).momentum(velocity[k]));
        }
        T::Arithmetic::splat(0.5) * twice
    }
}

/// [`KineticEnergy::run`] for a single call.
///
/// # Errors
/// As there.
pub fn kinetic_energy<T: Scalar>(layout: &Layout<T::Constant>, q: &[T], v: &[T]) -> Result<T, DynamicsError> {
    KineticEnergy::new(layout).run(layout, q, v)
}

/// A body on the ground with all outboard of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Root<T> {
    pub(crate) body: usize,
    /// Its pose in the world.
    pub(crate) pose: Transform<T>,
    pub(crate) mass: T,
    /// Σ m c in the root's frame.
    pub(crate) moment: Vec3<T>,
}

impl<T: Scalar> Root<T> {
    /// Σ m c, world axes, about the point `origin` of the world.
    #[inline(always)]
    pub(crate) fn moment_about(&self, origin: Vec3<T>) -> Vec3<T> {
        self.pose.rotation * self.moment + (self.pose.translation - origin).scale(self.mass)
    }
}

/// Workspace of the centre of mass and the potential energy.
#[derive(Clone, Debug)]
pub struct CenterOfMass<T: Scalar> {
    gathered: Vec<(T::Arithmetic, Vec3<T::Arithmetic>)>,
    pub(crate) roots: Vec<Root<T::Arithmetic>>,
    flexible: Option<Box<NewtonEuler<T>>>,
}

impl<T: Scalar> CenterOfMass<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let zero = T::Arithmetic::splat(0.0);
        let root = |body| Root { body, pose: Transform::identity(), mass: zero, moment: Vec3::zero() };
        let bodies = layout.bodies.iter().enumerate();
        CenterOfMass {
            gathered: vec![(zero, Vec3::zero()); layout.len()],
            roots: bodies.filter(|(_, b)| b.parent == GROUND).map(|(k, _)| root(k)).collect(),
            flexible: NewtonEuler::of(layout),
        }
    }
    /// Centre of mass of the moving bodies, m, world axes; NaN if they have no mass. Cost O(n), no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn run(&mut self, layout: &Layout<T::Constant>, q: &[T]) -> Result<Vec3<T>, DynamicsError> {
        check_length("q", q, layout.nq())?;
        check_length("workspace", &self.gathered, layout.len())?;
        if let Some(tree) = layout.flexible() {
            let work = NewtonEuler::checked(&mut self.flexible, tree)?;
            let (mass, Vec3([x, y, z])) = work.first_moment(tree, q, Vec3::zero());
            return Ok(Vec3([x / mass, y / mass, z / mass]));
        }
        let [x, y, z] = T::Arithmetic::dispatch(Center::<T> { work: self, layout, q: T::arithmetic(q) }).0;
        Ok(Vec3([T::from_arithmetic(x), T::from_arithmetic(y), T::from_arithmetic(z)]))
    }
    /// Potential energy of gravity, −Σ m g·c, zero at the world's origin, and of strain of flexible bodies, ½ η·K η; J. Cost O(n),
    /// no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    pub fn potential_energy(&mut self, layout: &Layout<T::Constant>, q: &[T]) -> Result<T, DynamicsError> {
        check_length("q", q, layout.nq())?;
        check_length("workspace", &self.gathered, layout.len())?;
        if let Some(tree) = layout.flexible() {
            return Ok(NewtonEuler::checked(&mut self.flexible, tree)?.potential_energy(layout, tree, q));
        }
        let energy = T::Arithmetic::dispatch(Potential::<T> { work: self, layout, q: T::arithmetic(q) });
        Ok(T::from_arithmetic(energy))
    }
    /// Mass and first moment of every root.
    ///
    /// Gathered in body frames, so that a distant origin costs no digits until the last addition.
    #[inline(always)]
    pub(crate) fn gather(&mut self, layout: &Layout<T::Constant>, q: &[T::Arithmetic]) {
        let CenterOfMass { gathered, roots, .. } = self;
        for (sum, body) in gathered.iter_mut().zip(&layout.bodies) {
            let M = &body.inertia;
            *sum = (T::Arithmetic::constant(M.mass), Vec3::constant(M.first_moment));
        }
        let mut root = roots.len();
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let pose = body.pose(q);
            let (mass, moment) = gathered[k];
            if body.parent == GROUND {
                root -= 1;
                roots[root] = Root { body: k, pose, mass, moment };
            } else {
                let (m, h) = gathered[body.parent];
                gathered[body.parent] = (m + mass, h + pose.rotation * moment + pose.translation.scale(mass));
            }
        }
    }
    /// Mass of the roots, and Σ m c about the point `origin` of the world, world axes.
    #[inline(always)]
    pub(crate) fn sum(&self, origin: Vec3<T::Arithmetic>) -> (T::Arithmetic, Vec3<T::Arithmetic>) {
        let (mut mass, mut moment) = (T::Arithmetic::splat(0.0), Vec3::zero());
        for root in self.roots.iter().rev() {
            mass += root.mass;
            moment += root.moment_about(origin);
        }
        (mass, moment)
    }
}

kernel! {
    Center<'a, T> {
        work: &'a mut CenterOfMass<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
    } -> Vec3<T::Arithmetic> {
        work.gather(layout, q);
        let (mass, Vec3([x, y, z])) = work.sum(Vec3::zero());
        Vec3([x / mass, y / mass, z / mass])
    }
}

kernel! {
    Potential<'a, T> {
        work: &'a mut CenterOfMass<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
    } -> T::Arithmetic {
        work.gather(layout, q);
        let (_, moment) = work.sum(Vec3::zero());
        -Vec3::constant(layout.gravity).dot(moment)
    }
}

/// [`CenterOfMass::run`] for a single call.
///
/// # Errors
/// As there.
pub fn center_of_mass<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<Vec3<T>, DynamicsError> {
    CenterOfMass::new(layout).run(layout, q)
}

/// [`CenterOfMass::potential_energy`] for a single call.
///
/// # Errors
/// As there.
pub fn potential_energy<T: Scalar>(layout: &Layout<T::Constant>, q: &[T]) -> Result<T, DynamicsError> {
    CenterOfMass::new(layout).potential_energy(layout, q)
}
