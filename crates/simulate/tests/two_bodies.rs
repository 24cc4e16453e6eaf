//! Two free bodies and one hinge, from zero angular momentum: the base turns by a closed form of the hinge angle.
//!
//! In the plane, with centres of mass at distances a and b from the hinge, moments I₁, I₂ and reduced mass μ,
//! the angular momentum (A + B cos φ) θ̇ + (I₂ + μ b² + (B/2) cos φ) φ̇ with A = I₁ + I₂ + μ (a² + b²), B = 2 μ a b stays zero, so
//! θ = −φ/2 − c/√(A² − B²) · 2 atan(√((A−B)/(A+B)) tan(φ/2)) with c = (I₂ − I₁ + μ (b² − a²))/2.

use phipsi_model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use phipsi_motion::forces::Servo;
use phipsi_motion::{Force, Signal, Tolerances};
use phipsi_simulate::{Recording, Simulation, run};

const MASSES: [f64; 2] = [5.0, 2.0];
const MOMENTS: [f64; 2] = [0.9, 0.3];
const ARMS: [f64; 2] = [0.7, 0.4];

fn model() -> Model {
    let body = |i: usize, x: f64| {
        let m = MOMENTS[i];
        Inertia::from_principal(MASSES[i], [x, 0.0, 0.0], [0.6 * m, 0.7 * m, m])
    };
    let hinge = Placement { translation: [ARMS[0], 0.0, 0.0], ..Placement::IDENTITY };
    ModelBuilder::new("pair")
        .body(Body::new("base", body(0, 0.0)))
        .body(Body::new("arm", body(1, ARMS[1])))
        .joint(Joint::new("hinge", JointKind::Continuous { axis: [0.0, 0.0, 1.0] }).at(hinge), "base", "arm")
        .base(Base::Free)
        .gravity([0.0; 3])
        .build()
        .unwrap()
}

fn base_turn(phi: f64) -> f64 {
    let mu = MASSES[0] * MASSES[1] / (MASSES[0] + MASSES[1]);
    let [a, b] = ARMS;
    let whole = MOMENTS[0] + MOMENTS[1] + mu * (a * a + b * b);
    let cross = 2.0 * mu * a * b;
    let c = 0.5 * (MOMENTS[1] - MOMENTS[0] + mu * (b * b - a * a));
    let root = (whole * whole - cross * cross).sqrt();
    -0.5 * phi - c * 2.0 / root * (((whole - cross) / (whole + cross)).sqrt() * (0.5 * phi).tan()).atan()
}

#[test]
fn the_base_turns_by_the_closed_form() {
    let model = model();
    let target = Signal::function(|t| 2.5 * (0.6 * t).sin(), |t| 1.5 * (0.6 * t).cos());
    let servo = Servo {
        name: "drive".into(),
        coordinate: 7,
        dof: 6,
        target,
        stiffness: 40.0,
        damping: 12.0,
        integral: 0.0,
        limit: f64::INFINITY,
    };
    let forces: Vec<Box<dyn Force>> = vec![Box::new(servo)];
    let mut simulation = Simulation::new(&model, forces, 6.0).unwrap();
    simulation.tolerances = Tolerances::new(1e-12);
    let mut recording = Recording::default();
    let summary = run(&mut simulation, &mut recording).unwrap();
    assert!(recording.rows.len() == 201 && summary.finished);
    let mut largest = 0.0f64;
    for row in &recording.rows {
        let theta = 2.0 * row.q[5].atan2(row.q[6]);
        let want = base_turn(row.q[7]);
        // Angles modulo a full turn; the motion stays below half of one.
        assert!((theta - want).abs() < 1e-10, "t = {}: {theta} {want}", row.t);
        largest = largest.max(theta.abs());
    }
    assert!(largest > 0.3, "the base must turn: {largest}");
    assert!(summary.momentum_error.unwrap().iter().all(|e| *e < 1e-12), "{:?}", summary.momentum_error);
    let estimate = summary.error_estimate.unwrap();
    assert!(estimate.q.unwrap() < 1e-10, "{estimate:?}");
}
