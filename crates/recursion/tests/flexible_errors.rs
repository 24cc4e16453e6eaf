//! What is refused of flexible bodies, by which name; batches; nodes; and places far away.

use phipsi_model::{
    Beam, Body, FlexibleBody, Inertia, Joint, JointKind, Model, ModelBuilder, Node, Placement, Section,
};
use phipsi_recursion as fast;
use phipsi_recursion::batch::{Input, kernels, run_batch};
use phipsi_recursion::{
    About, ArticulatedSweep, DynamicsError, Form, FormForwardDynamics, ForwardDynamics, Kinematics, Layout,
    MassMatrix, MassMatrixInverse,
};
use phipsi_reference::generate_flexible::{Bodies, flexible_case};
use phipsi_spatial::Vec3;
use phipsi_spatial::lanes::Level;

const SECTION: Section = Section {
    mass_per_length: 1.0,
    bending_stiffness: [3.0, 2.0],
    torsional_stiffness: 2.0,
    polar_inertia: 1e-2,
    axial_stiffness: 1e3,
};

fn beam() -> FlexibleBody {
    Beam::new(1.0, SECTION).bending([1, 1]).torsion(1).axial(1).build()
}

fn hinge(name: &str) -> Joint {
    Joint::new(name, JointKind::Revolute { axis: [0.0, 0.0, 1.0] })
}

fn boom(body: FlexibleBody) -> ModelBuilder {
    ModelBuilder::new("boom").body(Body::flexible("boom", body)).joint(hinge("root"), "world", "boom")
}

fn refused<T>(result: Result<T, DynamicsError>, name: &str) {
    match result {
        Err(DynamicsError::Flexible { body, algorithm }) => {
            assert_eq!((body.as_str(), algorithm), ("boom", name))
        }
        Err(other) => panic!("{name}: {other}"),
        Ok(_) => panic!("{name} computed something"),
    }
}

/// Accelerations of flexible bodies are judged, too; no hinge is named.
#[test]
fn accelerations_of_flexible_bodies_are_judged() {
    let model = boom(beam()).build().unwrap();
    let layout = Layout::<f64>::new(&model);
    let (q, v) = (model.neutral::<f64>(), vec![0.3; model.nv()]);
    let mut a = fast::forward_dynamics(&layout, &q, &v, &v, None).unwrap();
    let info = fast::forward_info(&layout, &q, &v, &v, None, &a).unwrap();
    let allowed = 100.0 * model.nv() as f64 * f64::EPSILON;
    assert!(info.backward_error <= allowed && info.worst_hinge.is_none(), "{info:?}");
    a[0] += 1e-3 * a[0].abs().max(1.0);
    let info = fast::forward_info(&layout, &q, &v, &v, None, &a).unwrap();
    assert!(info.backward_error > 1e-6, "{info:?}");
}

/// Algorithms that know rigid bodies only say so; none computes something else.
#[test]
fn flexible_bodies_are_refused_where_they_are_unknown() {
    let model = boom(beam()).build().unwrap();
    let layout = Layout::<f64>::new(&model);
    let (q, v) = (model.neutral::<f64>(), vec![0.0; model.nv()]);
    refused(fast::jacobian(&layout, &q, Some(0), None), "jacobian");
    refused(fast::joint_reactions(&model, &layout, &q, &v, &v, None), "joint_reactions");
    refused(ArticulatedSweep::new(&layout, &q), "ArticulatedSweep");
    refused(fast::innovations_operator(&layout, &q), "ArticulatedSweep");
    refused(fast::centroidal_momentum_matrix(&layout, &q), "centroidal_momentum_matrix");
    refused(
        fast::square_root_forward_dynamics(&model, &layout, &q, &v, &v, None),
        "square_root_forward_dynamics",
    );
    let mut out = v.clone();
    let mut form = FormForwardDynamics::new(&model, &layout, Form::SquareRoot);
    refused(form.run(&layout, &q, &v, &v, None, &mut out), "square_root_forward_dynamics");
    let rigid = ModelBuilder::new("rigid")
        .body(Body::new("rod", Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.1; 3])))
        .joint(hinge("root"), "world", "rod")
        .build()
        .unwrap();
    let error = fast::flexible::log_determinant::<f64>(&Layout::new(&rigid), &[0.0]).unwrap_err();
    assert_eq!(error, DynamicsError::Rigid { algorithm: "flexible::log_determinant" });
}

/// A workspace of another layout is refused, whichever of the two is flexible.
#[test]
fn workspaces_of_other_layouts_are_refused() {
    let flexible = boom(beam()).build().unwrap();
    let other = boom(Beam::new(1.0, SECTION).bending([2, 0]).build()).build().unwrap();
    let rigid = boom(Beam::new(1.0, SECTION).build()).build().unwrap();
    assert!(!rigid.is_flexible());
    let models = [&flexible, &other, &rigid];
    for made in models {
        for used in models {
            let (a, b) = (Layout::<f64>::new(made), Layout::<f64>::new(used));
            let (q, v) = (used.neutral::<f64>(), vec![0.0; used.nv()]);
            let (mut out, mut square) = (v.clone(), vec![0.0; v.len() * v.len()]);
            let results = [
                ForwardDynamics::new(&a).run(&b, &q, &v, &v, None, &mut out),
                fast::InverseDynamics::new(&a).run(&b, &q, &v, &v, None, &mut out),
                MassMatrix::new(&a).run(&b, &q, &mut square),
                Kinematics::new(&a).set_position(&b, &q),
                fast::KineticEnergy::new(&a).run(&b, &q, &v).map(|_| ()),
            ];
            for result in results.into_iter().chain([MassMatrixInverse::new(&a).run(&b, &q, &mut square)]) {
                // Rigid layouts of one size fit each other's workspaces.
                if std::ptr::eq(made, used) {
                    result.unwrap();
                } else if used.is_flexible() {
                    assert!(
                        matches!(result, Err(DynamicsError::Shape { argument: "workspace", .. })),
                        "{result:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_singular_mode_is_named() {
    // A mode that moves with a slider: both along y.
    let points = [phipsi_model::MassPoint {
        mass: 1.0,
        position: [1.0, 0.0, 0.0],
        displacement: vec![[0.0, 1.0, 0.0]],
    }];
    let integrals = phipsi_model::ShapeIntegrals::from_points(1, &points);
    let model = ModelBuilder::new("boom")
        .body(Body::flexible("boom", FlexibleBody::new(integrals, vec![0.0], vec![])))
        .joint(Joint::new("slide", JointKind::Prismatic { axis: [0.0, 1.0, 0.0] }), "world", "boom")
        .build()
        .unwrap();
    let layout = Layout::<f64>::new(&model);
    let error = fast::forward_dynamics(&layout, &[0.0, 0.0], &[0.0; 2], &[1.0, 0.0], None).unwrap_err();
    assert!(matches!(&error, DynamicsError::SingularHinge { joint, .. } if joint == "slide"), "{error}");
    let found = fast::singular_hinges(&model);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].subject, phipsi_model::Subject::Joint("slide".into()));
    assert!(fast::singular_hinges(&boom(beam()).build().unwrap()).is_empty());
}

/// Everything that is wrong with modal data, by names.
#[test]
fn mistakes_in_modal_data_are_named() {
    let said = |change: &dyn Fn(&mut FlexibleBody)| {
        let mut body = beam();
        change(&mut body);
        boom(body).build().unwrap_err().to_string()
    };
    let has = |text: String, words: &[&str]| {
        assert!(words.iter().all(|w| text.contains(w)), "{words:?} not in: {text}");
    };
    has(said(&|b| b.stiffness.pop().map_or((), |_| ())), &["`boom`", "modal stiffness K", "entries"]);
    has(said(&|b| b.integrals.mass = 0.0), &["`boom`", "mass"]);
    has(said(&|b| b.integrals.displacement[1][0] = f64::NAN), &["S1", "NaN"]);
    has(said(&|b| b.stiffness[1] += 1.0), &["modal stiffness K", "(1, 0)", "symmetric"]);
    has(said(&|b| b.integrals.product[1][0][1] += 1.0), &["product integrals", "symmetric"]);
    has(said(&|b| b.nodes.push(b.nodes[0].clone())), &["two nodes", "`tip`"]);
    has(said(&|b| b.inboard = Some("root".into())), &["inboard node `root`", "tip"]);
    has(
        said(&|b| {
            let n = b.modes();
            for m in 0..n {
                b.integrals.product[m] = [[0.0; 3]; 3];
                b.integrals.product[m * n] = [[0.0; 3]; 3];
            }
        }),
        &["mode 1", "positive definite"],
    );
    let child = |node: &str, parent: &str| {
        boom(beam())
            .body(Body::new("hand", Inertia::from_principal(1.0, [0.0; 3], [0.1; 3])))
            .body(Body::new("other", Inertia::from_principal(1.0, [0.0; 3], [0.1; 3])))
            .joint(hinge("spare"), "boom", "other")
            .joint_at_node(hinge("wrist"), parent, node, "hand")
            .build()
            .unwrap_err()
            .to_string()
    };
    has(child("end", "boom"), &["`wrist`", "no node `end`", "tip"]);
    has(child("tip", "other"), &["`wrist`", "rigid"]);
    has(child("tip", "world"), &["`wrist`", "world"]);
}

#[test]
fn modes_have_names_after_all_joints() {
    let model = boom(beam())
        .body(Body::new("hand", Inertia::from_principal(1.0, [0.0; 3], [0.1; 3])))
        .joint_at_node(hinge("wrist"), "boom", "tip", "hand")
        .build()
        .unwrap();
    let n = model.bodies()[0].modes();
    assert_eq!((model.nq(), model.nv()), (2 + n, 2 + n));
    assert_eq!(model.mode_v_range(0), 2..2 + n);
    assert_eq!(model.mode_names().next().as_deref(), Some("boom.mode1"));
    let layout = Layout::<f64>::new(&model);
    assert_eq!(layout.joint_of_velocity(1), ("wrist", 0));
    assert_eq!(layout.joint_of_velocity(2), ("boom.mode1", 0));
    assert_eq!(model.joint_of_velocity(2), (0, 1));
}

/// Nodes' poses, velocities and accelerations are those of massless bodies on fixed joints there.
#[test]
fn nodes_move_as_bodies_that_are_fixed_to_them() {
    for seed in 0..40 {
        let case = flexible_case(seed, Bodies::Points);
        let layout = Layout::<f64>::new(&case.model);
        let mut kinematics = Kinematics::new(&layout);
        kinematics.set_position(&layout, &case.q).unwrap();
        kinematics.set_velocity(&layout, &case.v).unwrap();
        kinematics.set_acceleration(&layout, &case.v, &case.a).unwrap();
        for (k, joint) in case.model.joints().iter().enumerate() {
            let (Some(node), JointKind::Fixed) = (case.model.node_of_joint(k), joint.kind) else { continue };
            if joint.placement != Placement::IDENTITY || case.model.bodies()[k].modes() > 0 {
                continue;
            }
            let parent = case.model.tree().parent(k).unwrap();
            let pose = kinematics.node_pose(&layout, parent, node).unwrap();
            assert_eq!(pose, kinematics.pose(&layout, Some(k)), "seed {seed}");
            let [velocity, alpha] = kinematics.node_motion(&layout, parent, node, &case.v, &case.a).unwrap();
            assert_eq!(velocity, kinematics.velocity(&layout, Some(k)), "seed {seed}");
            let difference = (alpha - kinematics.acceleration(&layout, Some(k))).to_array();
            let size = alpha.to_array().iter().fold(1.0f64, |m, x| m.max(x.abs()));
            assert!(difference.iter().all(|x| x.abs() < 16.0 * f64::EPSILON * size), "seed {seed}");
        }
        assert!(kinematics.node_pose(&layout, 99, 0).is_none());
    }
    // The generated trees have few such bodies: one by hand.
    let model = boom(beam())
        .body(Body::new("camera", Inertia::ZERO))
        .joint_at_node(Joint::new("mount", JointKind::Fixed), "boom", "tip", "camera")
        .build()
        .unwrap();
    let (layout, state) = (Layout::<f64>::new(&model), model.random_state(2));
    let mut kinematics = Kinematics::new(&layout);
    kinematics.set_position(&layout, &state.q).unwrap();
    kinematics.set_velocity(&layout, &state.v).unwrap();
    kinematics.set_acceleration(&layout, &state.v, &state.v).unwrap();
    assert_eq!(kinematics.node_pose(&layout, 0, 0).unwrap(), kinematics.pose(&layout, Some(1)));
    let [velocity, alpha] = kinematics.node_motion(&layout, 0, 0, &state.v, &state.v).unwrap();
    assert_eq!(velocity, kinematics.velocity(&layout, Some(1)));
    assert_eq!(alpha, kinematics.acceleration(&layout, Some(1)));
}

/// Many states at once: the numbers of one, to rounding; the same at every place.
#[test]
fn batches_of_flexible_states() {
    for seed in 0..10 {
        let case = flexible_case(seed, Bodies::General);
        let layout = Layout::<f64>::new(&case.model);
        let n = case.model.nv();
        let states = 11;
        let repeat = |x: &[f64]| -> Vec<f64> { (0..states).flat_map(|_| x.to_vec()).collect() };
        let (q, v, tau) = (repeat(&case.q), repeat(&case.v), repeat(&case.tau));
        let inputs = [Input::each(&q, case.model.nq()), Input::each(&v, n), Input::each(&tau, n)];
        let mut out = vec![0.0; n * states];
        let kernel = kernels::ForwardDynamics { layout: &layout, loaded: &[] };
        run_batch(&kernel, Level::best(), &inputs, states, &mut out).map_err(|e| e.1).unwrap();
        let want = fast::forward_dynamics(&layout, &case.q, &case.v, &case.tau, None).unwrap();
        let wide = |x: &[f64]| -> Vec<phipsi_spatial::Dd> {
            x.iter().map(|&x| phipsi_spatial::Dd::from_f64(x)).collect()
        };
        let exact = fast::forward_dynamics(
            &Layout::new(&case.model),
            &wide(&case.q),
            &wide(&case.v),
            &wide(&case.tau),
            None,
        )
        .unwrap();
        let error = |x: &[f64]| x.iter().zip(&exact).fold(0.0f64, |m, (x, y)| m.max((x - y.hi).abs()));
        let size = want.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        for row in out.chunks_exact(n) {
            assert_eq!(row, &out[..n], "seed {seed}");
            // Fused and separate roundings err alike.
            assert!(error(row) <= 30.0 * error(&want) + 1e-13 * size, "seed {seed}");
        }
    }
}

/// Momentum about the centre of mass does not depend on where the scene is.
#[test]
fn a_far_flexible_scene_keeps_its_momentum() {
    let model = |far: f64| {
        let at = Placement { translation: [far, -far, far], ..Placement::IDENTITY };
        ModelBuilder::new("far")
            .body(Body::flexible("boom", beam()))
            .joint(Joint::new("root", JointKind::Spherical).at(at), "world", "boom")
            .build()
            .unwrap()
    };
    let run = |model: &Model| {
        let (layout, state) = (Layout::<f64>::new(model), model.random_state(3));
        let a = fast::forward_dynamics(&layout, &state.q, &state.v, &state.v, None).unwrap();
        (a, fast::momentum(&layout, &state.q, &state.v, About::CenterOfMass).unwrap().to_array())
    };
    let ((a, near), (b, far)) = (run(&model(0.0)), run(&model(1e9)));
    assert_eq!(a, b);
    assert_eq!(near, far);
}

/// A node held by the joint, a wrench at F: the body hangs at its own tip and a force on F does work.
#[test]
fn a_body_may_be_held_at_a_node() {
    let held = beam().held_at("tip");
    let model = boom(held).gravity([0.0; 3]).build().unwrap();
    let layout = Layout::<f64>::new(&model);
    let mut kinematics = Kinematics::new(&layout);
    let state = model.random_state(6);
    kinematics.set_position(&layout, &state.q).unwrap();
    let tip = kinematics.node_pose(&layout, 0, 0).unwrap();
    // The joint's outboard frame is the node's: at the world's origin.
    assert!(tip.translation.norm() < 4.0 * f64::EPSILON, "{tip:?}");
    assert!((kinematics.pose(&layout, Some(0)).translation - Vec3([-1.0, 0.0, 0.0])).norm() > 1e-3);
}

#[test]
fn nodes_without_modes_place_rigid_bodies() {
    let mut body = Beam::new(1.0, SECTION).build();
    body.nodes.push(Node::fixed("middle", [0.5, 0.0, 0.0], 0));
    let body = body.held_at("middle");
    let model = boom(body)
        .body(Body::new("hand", Inertia::from_principal(1.0, [0.0; 3], [0.1; 3])))
        .joint_at_node(hinge("wrist"), "boom", "tip", "hand")
        .build()
        .unwrap();
    assert!(!model.is_flexible());
    let layout = Layout::<f64>::new(&model);
    let pose = fast::body_pose(&layout, &[0.0, 0.0], Some(1)).unwrap();
    assert!((pose.translation - Vec3([0.5, 0.0, 0.0])).norm() < 4.0 * f64::EPSILON, "{pose:?}");
}
