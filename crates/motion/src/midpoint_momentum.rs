//! Momenta and the configuration derivative of the kinetic energy: two short sweeps that replace the mass matrix.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | V⁺, V | velocity of a body's inboard side φ*(p,k) V(p), and of the body V⁺ + H* v | 6 | paper 2 (3.7) |
//! | h | momentum of everything outboard of the hinge, M V + Σ φ(k,c) h(c) | 6 | notes on integrators, 1 |
//! | μ | H h: the generalised momenta M(q) v | nv | the same |
//! | g | −H V⁺~ h: ∂(½ v·M v)/∂q along the joints' own increments, at fixed v | nv | the same |
//!
//! Valid because the axes of every hinge of a layout are constant in the child frame and closed under brackets.

use phipsi_recursion::Layout;
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Motion, RigidInertia, Scalar, Transform, Wrench};

/// Workspace of the two sweeps.
#[derive(Clone, Debug)]
pub struct MomentumSweep<T> {
    hinge: Vec<Transform<T>>,
    inboard: Vec<Motion<T>>,
    velocity: Vec<Motion<T>>,
    h: Vec<Wrench<T>>,
}

impl<T: Scalar> MomentumSweep<T> {
    /// For a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let n = layout.len();
        MomentumSweep {
            hinge: vec![Transform::identity(); n],
            inboard: vec![Motion::zero(); n],
            velocity: vec![Motion::zero(); n],
            h: vec![Wrench::zero(); n],
        }
    }
    /// Writes μ and g at (q, v). `q`: nq; `v`, `mu`, `g`: nv; slices of these lengths. Cost O(n), no allocation.
    pub fn run(&mut self, layout: &Layout<T::Constant>, q: &[T], v: &[T], mu: &mut [T], g: &mut [T]) {
        for (k, body) in layout.bodies().iter().enumerate() {
            self.hinge[k] = body.pose(q);
            self.inboard[k] = if body.parent == GROUND {
                Motion::zero()
            } else {
                self.hinge[k].motion_to_child(self.velocity[body.parent])
            };
            self.velocity[k] = self.inboard[k] + body.hinge.expand(&v[body.v..]);
            self.h[k] = RigidInertia::constant(&body.inertia).momentum(self.velocity[k]);
        }
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let h = self.h[k];
            let turned = self.inboard[k].cross_wrench(h);
            for i in 0..body.hinge.nv() {
                mu[body.v + i] = body.hinge.project(i, &h);
                g[body.v + i] = -body.hinge.project(i, &turned);
            }
            if body.parent != GROUND {
                self.h[body.parent] += self.hinge[k].wrench_to_parent(h);
            }
        }
    }
}
