//! What velocities and wrenches give: bias forces, bias accelerations and right-hand sides of the closures' rows.

use super::{ClosedDynamics, Conditions};
use crate::frames::weight;
use crate::number::{motion, wrench};
use crate::tree::Joint;
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Kernel, Motion, Real, Transform, Vec3, Wrench};

impl<T: Real> ClosedDynamics<T> {
    /// Everything that velocities and wrenches give; returns the largest residual of the rates.
    #[inline(always)]
    fn set_motion(&mut self, (q, v): (&[T], &[T]), conditions: &Conditions<'_, T>) -> f64 {
        self.set_bias(q, v, conditions.wrenches);
        let velocity_error = self.set_rates(v, conditions);
        self.terms.fill(T::zero());
        self.sizes.fill(T::zero());
        self.frames.add_velocity_terms(
            &self.structure,
            |k| if k == GROUND { Vec3::zero() } else { self.omega[k] },
            &mut self.terms,
            &mut self.sizes,
        );
        if let Some(motion) = &conditions.motion {
            for l in &self.structure.loops {
                for (i, row) in l.rows.clone().enumerate() {
                    self.terms[row] += weight(&self.structure, l, i) * motion.acceleration[row];
                }
            }
        }
        self.solution.g.copy_from_slice(T::arithmetic(&self.terms));
        self.solution.sizes.copy_from_slice(T::arithmetic(&self.sizes));
        velocity_error
    }
    /// Angular velocities, Coriolis accelerations and bias forces.
    #[inline(always)]
    fn set_bias(&mut self, q: &[T], v: &[T], wrenches: Option<&[Wrench<T>]>) {
        for (k, body) in self.tree.bodies.iter().enumerate() {
            let rates = &v[body.v..body.v + body.nv];
            if let Joint::Modes(i) = body.joint {
                let omega = self.omega[body.parent];
                let trees = (&self.layout, &self.tree);
                self.frames.set_flexible_velocity(&self.structure, trees, i, (q, v), omega);
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
                    inboard = held.pose(node).rotation.transpose_mul(inboard) + turned;
                    (&self.frames.local[k], held.velocity_terms(node))
                }
            };
            let joint = body.hinge().map_or(Motion::zero(), |hinge| hinge.expand(rates));
            let carried = pose.rotation.transpose_mul(inboard);
            let centripetal = pose.rotation.transpose_mul(inboard.cross(inboard.cross(pose.translation)));
            let coriolis = carried.cross(joint.linear);
            let mut a = body.hinge().map_or(Motion::zero(), |hinge| hinge.turning(rates));
            a.angular += carried.cross(joint.angular);
            a.linear += centripetal + coriolis + coriolis;
            if body.on.is_some() {
                a += pose.motion_to_child(node);
            }
            self.solution.a[k] = motion(a);
            self.omega[k] = carried + joint.angular;
            self.solution.z[k] = wrench(body.inertia.gyroscopic(self.omega[k]));
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
pub(super) struct Rates<'a, 'b, T: Real> {
    pub(super) dynamics: &'a mut ClosedDynamics<T>,
    /// q and v.
    pub(super) state: (&'a [T], &'a [T]),
    pub(super) conditions: &'a Conditions<'b, T>,
}

impl<T: Real> Kernel for Rates<'_, '_, T> {
    type Output = f64;
    #[inline(always)]
    fn run(self) -> f64 {
        self.dynamics.set_motion(self.state, self.conditions)
    }
}
