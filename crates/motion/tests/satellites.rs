//! What moves satellites: gravity gradient, reaction wheels, thrusters, against closed forms.

use crate::common::*;
use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder};
use phipsi_motion::forces::{CentralGravity, JointTorque, STANDARD_GRAVITY, Thruster};
use phipsi_motion::{Conserved, Dynamics, Method, Signal, System, balance};
use phipsi_recursion::Kinematics;
use phipsi_spatial::Vec3;

/// Earth.
const MU: f64 = 3.986_004_418e14;

fn free(mass: f64, moments: [f64; 3]) -> Model {
    ModelBuilder::new("satellite")
        .body(Body::new("bus", Inertia::from_principal(mass, [0.0; 3], moments)))
        .joint(Joint::new("base", JointKind::Free), "world", "bus")
        .gravity([0.0; 3])
        .build()
        .unwrap()
}

/// Small pitch on a circular orbit swings as θ₀ cos ωt, ω² = 3n²(I_x − I_z)/I_y: x along the track, y across the orbit, z along r.
#[test]
fn pitch_librates_with_the_gravity_gradient() {
    let moments = [500.0, 600.0, 200.0];
    let model = free(1000.0, moments);
    let r = 7e6f64;
    let n = (MU / r.powi(3)).sqrt();
    let amplitude = 1e-3f64;
    let omega = n * (3.0 * (moments[0] - moments[2]) / moments[1]).sqrt();
    let attract = || -> Dynamics {
        free_fall(&model, vec![Box::new(CentralGravity::new("earth", &model, MU, [0.0; 3]))])
    };
    // At (0, 0, r), moving along x: the orbit turns about +y at rate n, and the body turns with it, pitched by θ₀.
    let (sine, cosine) = (0.5 * amplitude).sin_cos();
    let q = [0.0, 0.0, r, 0.0, sine, 0.0, cosine];
    let (s, c) = amplitude.sin_cos();
    let v = [0.0, n, 0.0, n * r * c, 0.0, n * r * s];
    for part in [0.25, 0.5, 1.0, 2.0] {
        let t_end = part * 2.0 * std::f64::consts::PI / omega;
        let mut dynamics = attract();
        let (end, _) = run(&mut dynamics, Method::Dop853, 1e-13, &q, &v, t_end);
        let at = end.q();
        let turned = 2.0 * at[4].atan2(at[6]);
        let whole = 2.0 * std::f64::consts::PI;
        let pitch = turned - at[0].atan2(at[2]);
        let pitch = pitch - whole * (pitch / whole).round();
        let want = amplitude * (omega * t_end).cos();
        // The pendulum's frequency falls by θ₀²/4 of itself: a phase of 3e-6 of the amplitude after two periods. Attitude and orbit
        // are integrated to 1e-13 a step.
        let allowed = amplitude * 5e-6;
        assert!((pitch - want).abs() < allowed, "{part}: {pitch:e} instead of {want:e}");
    }
}

/// A tumbling body not much smaller than its distance: energy and the angular momentum about the centre stay, so force and moment belong to
/// the potential.
#[test]
fn central_gravity_conserves_energy_and_angular_momentum() {
    let model = free(2.0, [1.0, 1.6, 2.1]);
    let mut dynamics =
        free_fall(&model, vec![Box::new(CentralGravity::new("planet", &model, 20.0, [0.0; 3]))]);
    let q = [6.0, 1.0, -2.0, 0.5, -0.5, 0.1, 0.7];
    let mut q0 = q.to_vec();
    model.normalize(&mut q0);
    let v = [0.3, -0.4, 0.2, 0.6, 1.5, -0.9];
    let spin = |q: &[f64], v: &[f64]| {
        let [x, y, z, w] = [q[3], q[4], q[5], q[6]];
        let rotation = phipsi_spatial::Quaternion([x, y, z, w]).to_rotation();
        let own = rotation * Vec3([v[0], 1.6 * v[1], 2.1 * v[2]]);
        own + Vec3([q[0], q[1], q[2]]).cross(rotation * Vec3([v[3], v[4], v[5]])).scale(2.0)
    };
    let (end, _) = run(&mut dynamics, Method::Dop853, 1e-12, &q0, &v, 6.0);
    let mut kinematics = Kinematics::new(dynamics.layout());
    let mut conserved = Conserved::default();
    let zero = vec![0.0; dynamics.auxiliary_len()];
    for (t, q, v, aux) in [(0.0, &q0[..], &v[..], &zero[..]), (6.0, end.q(), end.v(), end.aux())] {
        conserved.record(&balance(&mut dynamics, &mut kinematics, (t, q, v), aux).unwrap());
    }
    // Local errors of 1e-12 over about a hundred steps.
    assert!(conserved.energy_error() < 1e-10, "{:e}", conserved.energy_error());
    let drift = (spin(end.q(), end.v()) - spin(&q0, &v)).norm();
    assert!(drift < 1e-10, "{drift:e}");
    assert!((spin(end.q(), end.v()).norm()) > 1.0);
}

/// A wheel that is spun up takes its momentum from the bus: (I − J) ω = −J (ω + Ω), J of the wheel, Ω = ∫τ/J_r.
#[test]
fn a_reaction_wheel_exchanges_momentum() {
    let (bus, wheel) = (50.0, 0.2);
    let model = ModelBuilder::new("wheel")
        .body(Body::new("bus", Inertia::from_principal(100.0, [0.0; 3], [40.0, 45.0, bus])))
        .body(Body::new("wheel", Inertia::from_principal(3.0, [0.0; 3], [0.11, 0.11, wheel])))
        .joint(Joint::new("base", JointKind::Free), "world", "bus")
        .joint(Joint::new("spin", JointKind::Continuous { axis: [0.0, 0.0, 1.0] }), "bus", "wheel")
        .gravity([0.0; 3])
        .build()
        .unwrap();
    let torque = 0.05;
    let motor = JointTorque { name: "motor".into(), dof: 6, value: Signal::Constant(torque) };
    let mut dynamics = free_fall(&model, vec![Box::new(motor)]);
    let (end, _) = run(&mut dynamics, Method::Dop853, 1e-12, &model.neutral::<f64>(), &[0.0; 7], 100.0);
    let want_bus = -torque * 100.0 / bus;
    let want_wheel = torque * 100.0 / wheel - want_bus;
    assert!(
        (end.v()[2] - want_bus).abs() < 1e-12 && (end.v()[6] - want_wheel).abs() < 1e-11,
        "{:?}",
        end.v()
    );
    // The bus has turned by half the end's rate times the time.
    let turned = 2.0 * end.q()[5].atan2(end.q()[6]);
    let whole = 2.0 * std::f64::consts::PI;
    let apart = turned - 0.5 * want_bus * 100.0;
    assert!((apart - whole * (apart / whole).round()).abs() < 1e-11);
}

/// Two opposite pulses through the centre of mass: the satellite moves and stops; propellant is F·Δt/(I_sp g₀) each.
#[test]
fn a_thruster_pulses() {
    let model = free(10.0, [1.0, 2.0, 3.0]);
    let (thrust, impulse) = (5.0, 220.0);
    let one = |name: &str, direction: f64, span: [f64; 2]| Thruster {
        name: name.into(),
        body: 0,
        point: Vec3([-0.5, 0.0, 0.0]),
        direction: Vec3([direction, 0.0, 0.0]),
        thrust: Thruster::on_off(thrust, vec![span]),
        specific_impulse: Some(impulse),
    };
    let mut dynamics = free_fall(
        &model,
        vec![Box::new(one("ahead", 1.0, [1.0, 1.5])), Box::new(one("back", -1.0, [4.0, 4.5]))],
    );
    let (end, _) = run(&mut dynamics, Method::Dop853, 1e-10, &model.neutral::<f64>(), &[0.0; 6], 6.0);
    let speed = thrust * 0.5 / 10.0;
    assert!((end.q()[0] - speed * 3.0).abs() < 1e-14 && end.v()[3].abs() < 1e-15, "{:?}", end.q());
    let used = thrust * 0.5 / (impulse * STANDARD_GRAVITY);
    let names = dynamics.auxiliary_names();
    for name in ["ahead.propellant", "back.propellant"] {
        let i = names.iter().position(|n| n == name).unwrap();
        assert!((end.aux()[i] - used).abs() < 1e-16);
    }
}
