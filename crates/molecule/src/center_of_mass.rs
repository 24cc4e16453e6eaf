//! Removal of the common momentum of free trees.
//!
//! | symbol | meaning |
//! |---|---|
//! | P | linear momentum, Σ over roots of R h, h the linear part of p at a root |
//! | V | P/m, velocity of the centre of mass |
//! | v_V | the speeds of all bases moving with V: R* V |
//!
//! p ← p − M(q) v_V leaves P = 0 and all motion relative to the centre of mass, with ½ P²/m less kinetic energy.

use phipsi_motion::midpoint_momentum::MomentumSweep;
use phipsi_recursion::Layout;
use phipsi_recursion::hinge::Hinge;
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Motion, Vec3, Wrench};

/// True if a common translation is free: every root can be displaced in all directions.
pub(crate) fn is_translation_free(layout: &Layout<f64>) -> bool {
    let mut roots = layout.bodies().iter().filter(|b| b.parent == GROUND);
    !layout.is_empty() && roots.all(|b| matches!(b.hinge, Hinge::Free | Hinge::Translation))
}

/// Makes the linear momentum zero. Returns the kinetic energy that has gone; 0 where the bases are not free, or where the
/// momentum is rounding.
pub(crate) fn remove_momentum(layout: &Layout<f64>, q: &[f64], p: &mut [f64]) -> f64 {
    if !is_translation_free(layout) {
        return 0.0;
    }
    let (mut total, mut sizes, mut mass) = (Vec3::zero(), 0.0, 0.0);
    for body in layout.bodies() {
        mass += body.inertia.mass;
        if body.parent == GROUND {
            let mut h = Wrench::zero();
            for (i, &component) in body.hinge.components().iter().enumerate() {
                h.add_to(component, p[body.v + i]);
            }
            let force = body.pose(q).rotation * h.force;
            total += force;
            sizes += force.norm();
        }
    }
    let scale: f64 = p.iter().map(|p| p.abs()).sum();
    if total.norm() <= 1e-10 * (sizes + scale) {
        return 0.0;
    }
    let velocity = total.scale(1.0 / mass);
    let nv = layout.nv();
    let (mut v, mut mu, mut g) = (vec![0.0; nv], vec![0.0; nv], vec![0.0; nv]);
    for body in layout.bodies().iter().filter(|b| b.parent == GROUND) {
        let own = Motion::new(Vec3::zero(), body.pose(q).rotation.transpose_mul(velocity));
        for (i, &component) in body.hinge.components().iter().enumerate() {
            v[body.v + i] = if component < 3 { 0.0 } else { own.linear.0[component - 3] };
        }
    }
    MomentumSweep::new(layout).run(layout, q, &v, &mut mu, &mut g);
    p.iter_mut().zip(&mu).for_each(|(p, mu)| *p -= mu);
    0.5 * total.dot(total) / mass
}
