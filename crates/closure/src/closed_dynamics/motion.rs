//! What velocities and wrenches give: bias forces, bias accelerations and right-hand sides of the closures' rows.

use super::{ClosedDynamics, Conditions};
use crate::compiled::Number;
use crate::frames::weight;
use crate::number::{Arithmetic, motion, transform, vector, wrench};
use crate::tree::Joint;
use phipsi_recursion::hinge::Hinge;
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Kernel, Motion, RigidInertia, Scalar, Transform, Vec3, Wrench};

impl<T: Number> ClosedDynamics<T> {
    /// Everything that velocities and wrenches give; returns the largest residual of the rates.
    #[inline(always)]
    fn set_motion(&mut self, (q, v): (&[T], &[T]), conditions: &Conditions<'_, T>) -> f64 {
        self.set_bias(q, v, conditions.wrenches);
        self.frames.turn(&self.structure, &self.tree, v, &mut self.rates);
        let velocity_error = self.given_rates(conditions);
        let (omega, solution) = (&self.omega, &mut self.solution);
        solution.g.fill(Arithmetic::<T>::splat(0.0));
        solution.sizes.fill(Arithmetic::<T>::splat(0.0));
        self.frames.add_velocity_terms(
            &self.structure,
            |k| if k == GROUND { Vec3::zero() } else { omega[k] },
            &mut solution.g,
            &mut solution.sizes,
        );
        if let Some(motion) = &conditions.motion {
            for l in &self.structure.loops {
                for (i, row) in l.rows.clone().enumerate() {
                    let term = weight(&self.structure, l, i) * motion.acceleration[row];
                    solution.g[row] += term.to_arithmetic();
                }
            }
        }
        velocity_error
    }
    /// Angular velocities, Coriolis accelerations and bias forces.
    #[inline(always)]
    fn set_bias(&mut self, q: &[T], v: &[T], wrenches: Option<&[Wrench<T>]>) {
        for (k, body) in self.tree.bodies.iter().enumerate() {
            let rates = &v[body.v..body.v + body.nv];
            if let Joint::Modes(i) = body.joint {
                let omega = self.omega[body.parent];
                let turned = Vec3(omega.0.map(T::from_arithmetic));
                let trees = (&self.layout, &self.tree);
                self.frames.set_flexible_velocity(&self.structure, trees, i, (q, v), turned);
                self.omega[k] = omega;
                let (bias, load) = self.frames.held[i].bias();
                self.solution.a[k] = Motion::zero();
                self.solution.z[k] = wrench(load);
                self.solution.z_modes[body.v - self.model.joint_nv()..][..body.nv]
                    .copy_from_slice(T::arithmetic(bias));
                continue;
            }
            let mut inboard = if body.parent == GROUND { Vec3::zero() } else { self.omega[body.parent] };
            let (pose, node) = match body.on {
                None => (&self.frames.poses[k], Motion::zero()),
                Some((i, node)) => {
                    let (held, flexible) = (&self.frames.held[i], &self.tree.bodies[body.parent]);
                    let rates = &v[flexible.v..flexible.v + flexible.nv];
                    let turned = held.motions(node).iter().zip(rates);
                    let turned = turned.fold(Vec3::zero(), |sum, (Pi, x)| sum + Pi.angular.scale(*x));
                    inboard = transform(held.pose(node)).rotation.transpose_mul(inboard) + vector(turned);
                    (&self.frames.local[k], motion(held.velocity_terms(node)))
                }
            };
            let carried = pose.rotation.transpose_mul(inboard);
            let centripetal = pose.rotation.transpose_mul(inboard.cross(inboard.cross(pose.translation)));
            let mut a = Motion::new(Vec3::zero(), centripetal);
            let mut omega = carried;
            if let Some(hinge) = body.hinge() {
                let rates = T::arithmetic(rates);
                if let Hinge::Revolute = hinge {
                    let ([x, y, z], rate) = (carried.0, rates[0]);
                    a.angular = Vec3([y * rate, -x * rate, Arithmetic::<T>::splat(0.0)]);
                    omega = Vec3([x, y, z + rate]);
                } else {
                    let joint = hinge.expand(rates);
                    let coriolis = carried.cross(joint.linear);
                    a += hinge.turning(rates);
                    a.angular += carried.cross(joint.angular);
                    a.linear += coriolis + coriolis;
                    omega += joint.angular;
                }
            }
            if body.on.is_some() {
                a += pose.motion_to_child(node);
            }
            self.solution.a[k] = a;
            self.omega[k] = omega;
            self.solution.z[k] = RigidInertia::constant(&body.inertia).gyroscopic(omega);
        }
        for (carrier, load) in self.layout.carriers().iter().zip(wrenches.unwrap_or_default()) {
            let k = self.tree.carrier(carrier.body);
            if k == GROUND {
                continue;
            }
            let pose: &Transform<T> = &carrier.pose;
            let mut load = pose.wrench_to_parent(*load);
            if let Some(i) = self.tree.modes(k) {
                // At F.
                let (held, first) = (&self.frames.held[i], self.tree.bodies[k].v - self.model.joint_nv());
                for (z, Pi) in self.solution.z_modes[first..].iter_mut().zip(held.motions(None)) {
                    *z -= Pi.dot(load).to_arithmetic();
                }
                load = held.pose(None).wrench_to_parent(load);
            }
            self.solution.z[k] -= wrench(load);
        }
    }
}

/// [`ClosedDynamics::set_motion`].
pub(crate) struct Rates<'a, 'b, T: Number> {
    pub(super) dynamics: &'a mut ClosedDynamics<T>,
    /// q and v.
    pub(super) state: (&'a [T], &'a [T]),
    pub(super) conditions: &'a Conditions<'b, T>,
}

impl<T: Number> Kernel for Rates<'_, '_, T> {
    type Output = f64;
    #[inline(always)]
    fn run(self) -> f64 {
        self.dynamics.set_motion(self.state, self.conditions)
    }
}
