//! What is refused, by which name, and what is not refused.

use crate::common::seeds;
use phipsi_model::{
    Body, Coupling, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random, Subject,
};
use phipsi_recursion::{
    About, ArticulatedSweep, DynamicsError, ForwardDynamics, InverseDynamics, Kinematics, Layout, Tip,
    body_pose, body_velocity, center_of_mass, centroidal_momentum_matrix, forward_dynamics,
    forward_dynamics_derivatives, inverse_dynamics, jacobian, jacobian_pseudo_inverse, joint_reactions,
    kinetic_energy, mass_matrix, mass_matrix_inverse, momentum, operational_space_inertia, potential_energy,
    singular_hinges, solve_mass_matrix,
};
use phipsi_reference::generate::{case, starved};
use phipsi_spatial::Wrench;

fn brick() -> Inertia {
    Inertia::from_principal(2.0, [0.3, -0.1, 0.4], [0.3, 0.4, 0.5])
}

fn hinge(name: &str, axis: [f64; 3]) -> Joint {
    let at = Placement { translation: [0.2, 0.1, -0.3], ..Placement::IDENTITY };
    Joint::new(name, JointKind::Revolute { axis }).at(at)
}

/// Three hinges about x, y, z with these inertias.
fn arm(inertias: [Inertia; 3]) -> Model {
    let [a, b, c] = inertias;
    ModelBuilder::new("arm")
        .body(Body::new("upper", a))
        .body(Body::new("lower", b))
        .body(Body::new("hand", c))
        .joint(hinge("shoulder", [1.0, 0.0, 0.0]), "world", "upper")
        .joint(hinge("elbow", [0.0, 1.0, 0.0]), "upper", "lower")
        .joint(hinge("wrist", [0.0, 0.0, 1.0]), "lower", "hand")
        .build()
        .unwrap()
}

fn shape<T: std::fmt::Debug>(result: Result<T, DynamicsError>, name: &str, required: usize, given: usize) {
    match result {
        Err(DynamicsError::Shape { argument, expected, found }) => {
            assert_eq!((argument, expected, found), (name, required, given));
        }
        other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn bodies_that_do_not_exist_are_refused() {
    let layout = Layout::<f64>::new(&arm([brick(); 3]));
    let (q, body) = ([0.1; 3], Some(3));
    let missing = DynamicsError::Body { found: 3, count: 3 };
    assert_eq!(jacobian(&layout, &q, body, None).unwrap_err(), missing);
    assert_eq!(body_pose(&layout, &q, body).unwrap_err(), missing);
    assert_eq!(body_velocity(&layout, &q, &q, body).unwrap_err(), missing);
    assert_eq!(operational_space_inertia(&layout, &q, body, None).unwrap_err(), missing);
    let tips = [Tip { body, point: None }];
    assert_eq!(
        jacobian_pseudo_inverse(&layout, &q, &tips, &[0.0; 6], Default::default()).unwrap_err(),
        missing
    );
    assert!(missing.to_string().contains("the model has 3"));
}

#[test]
fn arguments_of_wrong_length_are_named() {
    let model = arm([brick(); 3]);
    let layout = Layout::<f64>::new(&model);
    let (three, two) = ([0.1; 3], [0.1; 2]);
    let wrenches = [Wrench::zero(); 2];
    shape(forward_dynamics(&layout, &two, &three, &three, None), "q", 3, 2);
    shape(forward_dynamics(&layout, &three, &two, &three, None), "v", 3, 2);
    shape(forward_dynamics(&layout, &three, &three, &two, None), "tau", 3, 2);
    shape(forward_dynamics(&layout, &three, &three, &three, Some(&wrenches)), "wrenches", 3, 2);
    shape(inverse_dynamics(&layout, &two, &three, &three, None), "q", 3, 2);
    shape(inverse_dynamics(&layout, &three, &two, &three, None), "v", 3, 2);
    shape(inverse_dynamics(&layout, &three, &three, &two, None), "a", 3, 2);
    shape(inverse_dynamics(&layout, &three, &three, &three, Some(&wrenches)), "wrenches", 3, 2);
    let mut out = [0.0; 2];
    let forward = ForwardDynamics::new(&layout).run(&layout, &three, &three, &three, None, &mut out);
    shape(forward, "out", 3, 2);
    let inverse = InverseDynamics::new(&layout).run(&layout, &three, &three, &three, None, &mut out);
    shape(inverse, "out", 3, 2);
    shape(mass_matrix(&layout, &two), "q", 3, 2);
    shape(mass_matrix_inverse(&layout, &two), "q", 3, 2);
    shape(solve_mass_matrix(&layout, &three, &two), "x", 3, 2);
    shape(ArticulatedSweep::new(&layout, &two), "q", 3, 2);
    shape(jacobian(&layout, &two, Some(0), None), "q", 3, 2);
    shape(body_pose(&layout, &two, Some(0)), "q", 3, 2);
    shape(body_velocity(&layout, &three, &two, Some(0)), "v", 3, 2);
    shape(kinetic_energy(&layout, &three, &two), "v", 3, 2);
    shape(potential_energy(&layout, &two), "q", 3, 2);
    shape(center_of_mass(&layout, &two), "q", 3, 2);
    shape(momentum(&layout, &three, &two, About::CenterOfMass), "v", 3, 2);
    shape(centroidal_momentum_matrix(&layout, &two), "q", 3, 2);
    shape(joint_reactions(&model, &layout, &three, &three, &two, None), "a", 3, 2);
    shape(joint_reactions(&model, &layout, &three, &three, &three, Some(&wrenches)), "wrenches", 3, 2);
    let mut kinematics = Kinematics::new(&layout);
    shape(kinematics.set_position(&layout, &two), "q", 3, 2);
    shape(kinematics.set_velocity(&layout, &two), "v", 3, 2);
    shape(kinematics.set_acceleration(&layout, &three, &two), "a", 3, 2);
}

#[test]
fn a_workspace_of_another_model_is_refused() {
    let layout = Layout::<f64>::new(&arm([brick(); 3]));
    let other = ModelBuilder::new("one")
        .body(Body::new("b", brick()))
        .joint(hinge("j", [1.0, 0.0, 0.0]), "world", "b")
        .build()
        .unwrap();
    let mut forward = ForwardDynamics::new(&Layout::<f64>::new(&other));
    let mut out = [0.0; 3];
    shape(forward.run(&layout, &[0.1; 3], &[0.1; 3], &[0.1; 3], None, &mut out), "workspace", 3, 1);
}

fn assert_refused(model: &Model, name: &str) {
    let layout = Layout::<f64>::new(model);
    let x = vec![0.1; model.nv()];
    let q = model.random_state(1).q;
    let mut refused: Vec<Result<(), DynamicsError>> = vec![
        forward_dynamics(&layout, &q, &x, &x, None).map(drop),
        mass_matrix_inverse(&layout, &q).map(drop),
        ArticulatedSweep::new(&layout, &q).map(drop),
    ];
    // In axes that turn, what should be zero is rounding, of either sign.
    refused.extend((0..500).map(|seed| {
        let q = model.random_state(seed).q;
        forward_dynamics_derivatives(&layout, &q, &x, &x, None).map(drop)
    }));
    for error in refused {
        let error = error.unwrap_err();
        let DynamicsError::SingularHinge { joint, .. } = &error else { panic!("{error}") };
        assert_eq!(joint, name);
        assert!(error.to_string().contains(&format!("`{name}`")), "{error}");
    }
}

#[test]
fn a_massless_end_body_is_refused_by_its_joint() {
    let model = arm([brick(), brick(), Inertia::ZERO]);
    assert_refused(&model, "wrist");
    let found = singular_hinges(&model);
    assert_eq!(found.iter().map(|v| &v.subject).collect::<Vec<_>>(), [&Subject::Joint("wrist".into())]);
}

/// Mass on the joint's own axis gives no inertia about it.
#[test]
fn mass_on_the_axis_only_is_refused_by_its_joint() {
    let point = Inertia::from_principal(1.0, [0.0, 0.0, 0.7], [0.0; 3]);
    let model = arm([brick(), brick(), point]);
    assert_refused(&model, "wrist");
    assert_eq!(singular_hinges(&model).len(), 1);
}

#[test]
fn a_massless_middle_body_is_accepted() {
    let model = arm([brick(), Inertia::ZERO, brick()]);
    assert!(singular_hinges(&model).is_empty());
    let layout = Layout::<f64>::new(&model);
    let a: Vec<f64> = forward_dynamics(&layout, &[0.1; 3], &[0.1; 3], &[0.1; 3], None).unwrap();
    assert!(a.iter().all(|a| a.is_finite()));
}

#[test]
fn a_number_that_is_not_finite_is_refused() {
    let layout = Layout::<f64>::new(&arm([brick(); 3]));
    for bad in [f64::NAN, f64::INFINITY] {
        let error = forward_dynamics(&layout, &[0.1, bad, 0.1], &[0.1; 3], &[0.1; 3], None).unwrap_err();
        assert!(matches!(error, DynamicsError::SingularHinge { .. }), "{error}");
    }
}

#[test]
fn a_mimic_joint_is_refused_by_both_names() {
    let coupling = Coupling { joint: "wrist".into(), source: "elbow".into(), multiplier: 1.0, offset: 0.0 };
    let model = ModelBuilder::new("arm")
        .body(Body::new("lower", brick()))
        .body(Body::new("hand", brick()))
        .joint(hinge("elbow", [0.0, 1.0, 0.0]), "world", "lower")
        .joint(hinge("wrist", [0.0, 0.0, 1.0]), "lower", "hand")
        .coupling(coupling)
        .build()
        .unwrap();
    let layout = Layout::<f64>::new(&model);
    let x = [0.1; 2];
    let refused: [Result<(), DynamicsError>; 4] = [
        forward_dynamics(&layout, &x, &x, &x, None).map(drop),
        inverse_dynamics(&layout, &x, &x, &x, None).map(drop),
        mass_matrix_inverse(&layout, &x).map(drop),
        joint_reactions(&model, &layout, &x, &x, &x, None).map(drop),
    ];
    for error in refused {
        let expected = DynamicsError::Closure { joint: "wrist".into(), source: "elbow".into() };
        assert_eq!(error, Err(expected));
    }
}

/// The check made before anything runs finds what the dense pivots find, on trees with massless bodies and point masses.
#[test]
fn singular_hinges_are_those_of_the_reference() {
    let mut found = 0;
    for seed in seeds(1000) {
        let model = starved(&mut Random::new(seed), &case(seed).model);
        let expected: Vec<Subject> = phipsi_reference::singular_hinges(&model)
            .into_iter()
            .map(|i| Subject::Joint(model.joints()[model.joint_of_velocity(i).0].name.clone()))
            .collect();
        let got: Vec<Subject> = singular_hinges(&model).into_iter().map(|v| v.subject).collect();
        assert_eq!(got, expected, "PHIPSI_SEED={seed}");
        found += got.len();
    }
    assert!(found > 100 || std::env::var("PHIPSI_SEED").is_ok());
}
