//! Poses, velocities and accelerations of bodies.
//!
//! | symbol | meaning | frame, unit | source |
//! |---|---|---|---|
//! | X(k) | pose of body k in its parent | | soa.md 3.0 |
//! | V(k) | φ*(p,k) V(p) + H* v, spatial velocity | body, rad/s and m/s | paper 2 (3.7) |
//! | α(k) | φ*(p,k) α(p) + H* v̇ + c(k) + a(k), inertial derivative of (ω, velocity of the origin) | body | papers |
//! | a(k), c(k) | (ω_p × δω, ω_p × (ω_p × l) + 2 ω_p × δv), (0, δω × δv), with (δω, δv) = H* v | body | soa.md 3.0 |
//!
//! Of the two pairs of soa.md 3.0 this is the papers' own. The other one, the componentwise rate of V, contains products
//! v × ω of the bodies' speed: error ε |v| |ω|, where here only speeds relative to the parent enter.

use crate::error::{DynamicsError, check_length};
use crate::flexible::Placing;
use crate::hinge::Hinge;
use crate::kernel::kernel;
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{Mat3, Motion, Scalar, Transform, Vec3};

/// a(k) of a body with pose `x` in its parent, whose angular velocity is `inboard` in the parent's axes and `own` in the
/// child's; `joint` is H* v, and `own` = Rᵀ `inboard` + δω.
#[inline(always)]
pub(crate) fn coriolis<T: Scalar>(
    x: &Transform<T>,
    inboard: Vec3<T>,
    own: Vec3<T>,
    joint: Motion<T>,
) -> Motion<T> {
    let carried = own - joint.angular;
    let centripetal = x.rotation.transpose_mul(inboard.cross(inboard.cross(x.translation)));
    Motion::new(carried.cross(joint.angular), centripetal + (carried + carried).cross(joint.linear))
}

/// ω and a(k) of a body on a joint with the velocity `joint`, from what its parent's turning gives it: `carried` = Rᵀ ω_p and
/// `centripetal` = Rᵀ (ω_p × (ω_p × l)).
#[inline(always)]
pub(crate) fn relative<T: Scalar>(
    hinge: &Hinge<T::Constant>,
    carried: Vec3<T>,
    centripetal: Vec3<T>,
    joint: Motion<T>,
) -> (Vec3<T>, Motion<T>) {
    let [x, y, _] = carried.0;
    let (rate, speed) = (joint.angular.0[2], joint.linear.0[2]);
    match hinge {
        Hinge::Revolute => relative_revolute(carried, centripetal, rate),
        Hinge::Prismatic => {
            let twice = speed + speed;
            let [a, b, c] = centripetal.0;
            (carried, Motion::new(Vec3::zero(), Vec3([y.fma(twice, a), (-x).fma(twice, b), c])))
        }
        _ => {
            let linear = centripetal + (carried + carried).cross(joint.linear);
            (carried + joint.angular, Motion::new(carried.cross(joint.angular), linear))
        }
    }
}

/// The same for a hinge about z.
#[inline(always)]
pub(crate) fn relative_revolute<T: Scalar>(
    carried: Vec3<T>,
    centripetal: Vec3<T>,
    rate: T,
) -> (Vec3<T>, Motion<T>) {
    let [x, y, z] = carried.0;
    let turned = Vec3([y * rate, -(x * rate), T::zero()]);
    (Vec3([x, y, z + rate]), Motion::new(turned, centripetal))
}

/// α of a frame fixed to a body, whose pose in the body's frame is `x`.
#[inline(always)]
fn carried_acceleration<T: Scalar>(x: &Transform<T>, omega: Vec3<T>, alpha: Motion<T>) -> Motion<T> {
    let centripetal = Motion::new(Vec3::zero(), omega.cross(omega.cross(x.translation)));
    x.motion_to_child(alpha + centripetal)
}

/// Poses, velocities and accelerations of all bodies, base to tip.
#[derive(Clone, Debug)]
pub struct Kinematics<T: Scalar> {
    /// Pose of each layout body in its parent.
    pub(crate) hinge: Vec<Transform<T>>,
    /// Pose of each layout body in the world.
    pub(crate) world: Vec<Transform<T>>,
    velocity: Vec<Motion<T>>,
    acceleration: Vec<Motion<T>>,
    /// For a layout with flexible bodies.
    flexible: Option<Box<Placing<T>>>,
}

impl<T: Scalar> Kinematics<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let n = layout.flexible().map_or(layout.len(), |tree| tree.bodies.len());
        Kinematics {
            hinge: vec![Transform::identity(); n],
            world: vec![Transform::identity(); n],
            velocity: vec![Motion::zero(); n],
            acceleration: vec![Motion::zero(); n],
            flexible: layout.flexible().map(|tree| Box::new(Placing::new(tree))),
        }
    }
    /// Computes poses. `q`: nq.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    #[inline(always)]
    pub fn set_position(&mut self, layout: &Layout<T::Constant>, q: &[T]) -> Result<(), DynamicsError> {
        check_length("q", q, layout.nq())?;
        if let Some(tree) = layout.flexible() {
            let placing = Placing::checked(&mut self.flexible, tree)?;
            placing.set_position(tree, q);
            self.world.copy_from_slice(&placing.world);
            return Ok(());
        }
        for (k, body) in layout.bodies.iter().enumerate() {
            self.hinge[k] = body.pose(q);
            self.world[k] = if body.parent == GROUND {
                self.hinge[k]
            } else {
                self.world[body.parent].compose(&self.hinge[k])
            };
        }
        Ok(())
    }
    /// Computes velocities, at the poses set before. `v`: nv.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    #[inline(always)]
    pub fn set_velocity(&mut self, layout: &Layout<T::Constant>, v: &[T]) -> Result<(), DynamicsError> {
        check_length("v", v, layout.nv())?;
        if let Some(tree) = layout.flexible() {
            let placing = Placing::checked(&mut self.flexible, tree)?;
            placing.set_velocity(tree, v);
            for (k, velocity) in self.velocity.iter_mut().enumerate() {
                *velocity = placing.motion(k).0;
            }
            return Ok(());
        }
        for (k, body) in layout.bodies.iter().enumerate() {
            let joint = body.hinge.expand(&v[body.v..]);
            self.velocity[k] = if body.parent == GROUND {
                joint
            } else {
                self.hinge[k].motion_to_child(self.velocity[body.parent]) + joint
            };
        }
        Ok(())
    }
    /// Computes accelerations α, at the poses and velocities set before; no gravity. `v`, `a`: nv.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`].
    #[inline(always)]
    pub fn set_acceleration(
        &mut self,
        layout: &Layout<T::Constant>,
        v: &[T],
        a: &[T],
    ) -> Result<(), DynamicsError> {
        check_length("v", v, layout.nv())?;
        check_length("a", a, layout.nv())?;
        if let Some(tree) = layout.flexible() {
            let placing = Placing::checked(&mut self.flexible, tree)?;
            placing.set_acceleration(tree, v, a);
            for (k, acceleration) in self.acceleration.iter_mut().enumerate() {
                *acceleration = placing.motion(k).1;
            }
            return Ok(());
        }
        for (k, body) in layout.bodies.iter().enumerate() {
            let joint = body.hinge.expand(&v[body.v..]);
            let (inboard, carried) = if body.parent == GROUND {
                (Vec3::zero(), Motion::zero())
            } else {
                let carried = self.hinge[k].motion_to_child(self.acceleration[body.parent]);
                (self.velocity[body.parent].angular, carried)
            };
            let coriolis = coriolis(&self.hinge[k], inboard, self.velocity[k].angular, joint);
            let relative = body.hinge.expand(&a[body.v..]) + body.hinge.turning(&v[body.v..]);
            self.acceleration[k] = carried + relative + coriolis;
        }
        Ok(())
    }
    /// World pose of body `body` of the model (`None`: the world).
    #[inline(always)]
    pub fn pose(&self, layout: &Layout<T::Constant>, body: Option<usize>) -> Transform<T> {
        let Some(body) = body else { return Transform::identity() };
        let carrier = &layout.carriers[body];
        let local = Transform::constant(&carrier.pose);
        if carrier.body == GROUND { local } else { self.world[carrier.body].compose(&local) }
    }
    /// Velocity of a body of the model, in its own axes at its own origin.
    #[inline(always)]
    pub fn velocity_in_body(&self, layout: &Layout<T::Constant>, body: Option<usize>) -> Motion<T> {
        match body.map(|b| &layout.carriers[b]) {
            Some(c) if c.body != GROUND => {
                Transform::constant(&c.pose).motion_to_child(self.velocity[c.body])
            }
            _ => Motion::zero(),
        }
    }
    /// (ω, velocity of the origin) of a body of the model, world axes.
    #[inline(always)]
    pub fn velocity(&self, layout: &Layout<T::Constant>, body: Option<usize>) -> Motion<T> {
        let v = self.velocity_in_body(layout, body);
        let r = self.pose(layout, body).rotation;
        Motion::new(r * v.angular, r * v.linear)
    }
    /// The papers' α of a body of the model, world axes: inertial rates of ω and of the velocity of its origin.
    #[inline(always)]
    pub fn acceleration(&self, layout: &Layout<T::Constant>, body: Option<usize>) -> Motion<T> {
        let a = self.acceleration_in_body(layout, body);
        let r = self.pose(layout, body).rotation;
        Motion::new(r * a.angular, r * a.linear)
    }
    /// α of a body of the model, in its own axes.
    #[inline(always)]
    pub fn acceleration_in_body(&self, layout: &Layout<T::Constant>, body: Option<usize>) -> Motion<T> {
        match body.map(|b| &layout.carriers[b]) {
            Some(c) if c.body != GROUND => {
                let omega = self.velocity[c.body].angular;
                carried_acceleration(&Transform::constant(&c.pose), omega, self.acceleration[c.body])
            }
            _ => Motion::zero(),
        }
    }
    /// World pose of a node of a flexible body, by its index; `None` if the body has no such node.
    pub fn node_pose(&self, layout: &Layout<T::Constant>, body: usize, node: usize) -> Option<Transform<T>> {
        let tree = layout.flexible()?;
        self.flexible.as_ref()?.node_pose(tree, layout.carriers.get(body)?.body, node)
    }
    /// Velocity and the papers' α of a node of a flexible body, world axes, at the velocities and accelerations set before, which
    /// are given again; `None` if the body has no such node. Allocates.
    pub fn node_motion(
        &self,
        layout: &Layout<T::Constant>,
        body: usize,
        node: usize,
        v: &[T],
        a: &[T],
    ) -> Option<[Motion<T>; 2]> {
        let tree = layout.flexible()?;
        let (placing, k) = (self.flexible.as_ref()?, layout.carriers.get(body)?.body);
        let r = placing.node_pose(tree, k, node)?.rotation;
        let (velocity, alpha) = placing.node_motion(tree, k, node, (v, a))?;
        Some([velocity, alpha].map(|x| Motion::new(r * x.angular, r * x.linear)))
    }
}

/// The papers' α from the componentwise (Featherstone's spatial) acceleration: (ω̇, v̇ + ω × v).
#[inline(always)]
pub fn spatial_to_inertial<T: Scalar>(v: Motion<T>, a: Motion<T>) -> Motion<T> {
    Motion::new(a.angular, a.linear + v.angular.cross(v.linear))
}

/// World pose of one body of the model, along its path only. `q`: nq. Cost O(depth), no allocation; O(n) with flexible bodies.
///
/// # Errors
/// [`DynamicsError::Shape`], [`DynamicsError::Body`].
pub fn body_pose<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    body: Option<usize>,
) -> Result<Transform<T>, DynamicsError> {
    check_length("q", q, layout.nq())?;
    layout.check_body(body)?;
    let Some(body) = body else { return Ok(Transform::identity()) };
    if layout.is_flexible() {
        let mut kinematics = Kinematics::new(layout);
        kinematics.set_position(layout, q)?;
        return Ok(kinematics.pose(layout, Some(body)));
    }
    let pose = T::Arithmetic::dispatch(PosePath::<T> { layout, q: T::arithmetic(q), body });
    let ([a, b, c], back) = (pose.rotation.0, plain::<T>);
    Ok(Transform::new(Mat3([back(a), back(b), back(c)]), Vec3(back(pose.translation.0))))
}

#[inline(always)]
fn plain<T: Scalar>([x, y, z]: [T::Arithmetic; 3]) -> [T; 3] {
    [T::from_arithmetic(x), T::from_arithmetic(y), T::from_arithmetic(z)]
}

kernel! {
    PosePath<'a, T> {
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        body: usize,
    } -> Transform<T::Arithmetic> {
        let carrier = &layout.carriers[body];
        let (mut pose, mut k) = (Transform::constant(&carrier.pose), carrier.body);
        while k != GROUND {
            let b = &layout.bodies[k];
            pose = b.pose(q).compose(&pose);
            k = b.parent;
        }
        pose
    }
}

/// (ω, velocity of the origin) of one body of the model, world axes. `q`: nq, `v`: nv. Cost O(depth), no allocation; O(n) with
/// flexible bodies.
///
/// # Errors
/// [`DynamicsError::Shape`], [`DynamicsError::Body`].
pub fn body_velocity<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    body: Option<usize>,
) -> Result<Motion<T>, DynamicsError> {
    check_length("q", q, layout.nq())?;
    check_length("v", v, layout.nv())?;
    layout.check_body(body)?;
    let Some(body) = body else { return Ok(Motion::zero()) };
    if layout.is_flexible() {
        let mut kinematics = Kinematics::new(layout);
        kinematics.set_position(layout, q)?;
        kinematics.set_velocity(layout, v)?;
        return Ok(kinematics.velocity(layout, Some(body)));
    }
    let (q, v) = (T::arithmetic(q), T::arithmetic(v));
    let velocity = T::Arithmetic::dispatch(VelocityPath::<T> { layout, q, v, body });
    Ok(Motion::new(Vec3(plain::<T>(velocity.angular.0)), Vec3(plain::<T>(velocity.linear.0))))
}

kernel! {
    VelocityPath<'a, T> {
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        v: &'a [T::Arithmetic],
        body: usize,
    } -> Motion<T::Arithmetic> {
        let carrier = &layout.carriers[body];
        // `pose`: the body in the frame of its ancestor k, so that no distance to the world's origin enters.
        let (mut pose, mut k) = (Transform::constant(&carrier.pose), carrier.body);
        let mut velocity = Motion::zero();
        while k != GROUND {
            let b = &layout.bodies[k];
            velocity += pose.motion_to_child(b.hinge.expand(&v[b.v..]));
            pose = b.pose(q).compose(&pose);
            k = b.parent;
        }
        Motion::new(pose.rotation * velocity.angular, pose.rotation * velocity.linear)
    }
}
