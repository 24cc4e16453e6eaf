//! Mechanisms and runs that several tests share.

use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use phipsi_motion::{Dynamics, Force, Integrator, Method, System, Tolerances};

pub const Y: JointKind = JointKind::Revolute { axis: [0.0, -1.0, 0.0] };

/// Point mass 1 kg on a massless rod of 1 m under g = 9.81; q from the downward vertical.
pub fn pendulum() -> Model {
    let bob = Inertia::from_principal(1.0, [0.0, 0.0, -1.0], [0.0; 3]);
    ModelBuilder::new("pendulum")
        .body(Body::new("bob", bob))
        .joint(Joint::new("hinge", Y), "world", "bob")
        .gravity([0.0, 0.0, -9.81])
        .build()
        .unwrap()
}

/// Two rods, the second at the end of the first: chaotic from the horizontal.
pub fn double_pendulum() -> Model {
    let rod = || Inertia::from_principal(1.0, [0.0, 0.0, -0.5], [1.0 / 12.0, 1.0 / 12.0, 0.0]);
    let at_end = Placement { translation: [0.0, 0.0, -1.0], ..Placement::IDENTITY };
    ModelBuilder::new("double pendulum")
        .body(Body::new("upper", rod()))
        .body(Body::new("lower", rod()))
        .joint(Joint::new("shoulder", Y), "world", "upper")
        .joint(Joint::new("elbow", Y).at(at_end), "upper", "lower")
        .gravity([0.0, 0.0, -9.81])
        .build()
        .unwrap()
}

/// A free body with principal moments about its centre of mass, without gravity.
pub fn free_body(moments: [f64; 3]) -> Model {
    ModelBuilder::new("body")
        .body(Body::new("body", Inertia::from_principal(1.0, [0.0; 3], moments)))
        .joint(Joint::new("base", JointKind::Free), "world", "body")
        .gravity([0.0; 3])
        .build()
        .unwrap()
}

/// Ends of all steps of a run, and its integrator at the end.
pub fn run(
    dynamics: &mut Dynamics,
    method: Method,
    tol: f64,
    q: &[f64],
    v: &[f64],
    t_end: f64,
) -> (Integrator, Vec<f64>) {
    let aux = vec![0.0; dynamics.auxiliary_len()];
    let model = dynamics.model().clone();
    let mut integrator = Integrator::new(&model, method, Tolerances::new(tol), 0.0, q, v, &aux);
    let mut ends = Vec::new();
    let breaks: Vec<f64> = dynamics.breaks().into_iter().filter(|b| *b > 0.0 && *b < t_end).collect();
    for limit in breaks.iter().copied().chain([t_end]) {
        while integrator.t() < limit {
            ends.push(integrator.step(dynamics, limit, limit < t_end).unwrap().t1);
        }
        integrator.restart();
    }
    (integrator, ends)
}

pub fn free_fall(model: &Model, forces: Vec<Box<dyn Force>>) -> Dynamics {
    Dynamics::new(model, forces).unwrap()
}
