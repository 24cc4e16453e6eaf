//! A mechanism on the tree that its loops ask for is the same mechanism.

use phipsi_closure::{ClosedDynamics, Conditions, choose_tree};
use phipsi_model::{
    Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random,
};
use phipsi_spatial::Vec3;

const Z: [f64; 3] = [0.0, 0.0, 1.0];

fn at(x: f64, y: f64) -> Placement {
    Placement::from_xyz_rpy([x, y, 0.0], [0.0; 3])
}

fn rod(name: String) -> Body {
    Body::new(name, Inertia::from_principal(1.3, [0.5, 0.1, 0.0], [0.02, 0.11, 0.12]))
}

/// Two rails of n pieces on the ground, each a chain, and rungs that hang on the left one, closed to the right one.
fn ladder(n: usize) -> Model {
    let hinge =
        |name: String, place: Placement| Joint::new(name, JointKind::Continuous { axis: Z }).at(place);
    let mut builder = ModelBuilder::new("ladder").gravity([0.0, -9.81, 0.0]);
    for (side, y) in [("left", 0.0), ("right", 1.0)] {
        let mut parent = "world".to_string();
        for i in 0..n {
            let name = format!("{side}{i}");
            let place = if i == 0 { at(0.0, y) } else { at(1.0, 0.0) };
            builder = builder.body(rod(name.clone())).joint(
                hinge(format!("{name} hinge"), place),
                parent,
                name.as_str(),
            );
            parent = name;
        }
    }
    for i in 0..n {
        let [left, right, rung] = ["left", "right", "rung"].map(|name| format!("{name}{i}"));
        builder = builder
            .body(rod(rung.clone()))
            .joint(hinge(format!("{rung} hinge"), at(1.0, 0.0)), left, rung.as_str())
            .closure(Closure {
                name: format!("pin{i}"),
                kind: ClosureKind::Revolute,
                body_a: rung,
                pose_a: at(1.0, 0.0),
                body_b: right,
                pose_b: at(1.0, 0.0),
            });
    }
    builder.build().unwrap()
}

/// Positions of the bodies' centres, and their accelerations, from the closed dynamics at rest.
fn motion(model: &Model, q: &[f64]) -> Vec<(String, Vec3<f64>, Vec3<f64>)> {
    let mut dynamics = ClosedDynamics::<f64>::new(model).unwrap();
    let zero = vec![0.0; model.nv()];
    let mut a = zero.clone();
    dynamics.run(q, &zero, &zero, &Conditions::default(), &mut a).unwrap();
    let motions = phipsi_reference::kinematics(model, q, &zero, &a);
    let mut all: Vec<_> = model
        .bodies()
        .iter()
        .zip(&motions)
        .filter(|(body, _)| body.inertia.mass > 0.0)
        .map(|(body, m)| {
            let point = m.pose.point(Vec3([0.5, 0.1, 0.0]));
            (body.name.clone(), point, m.acceleration_at(point))
        })
        .collect();
    all.sort_by(|a, b| a.0.cmp(&b.0));
    all
}

#[test]
fn a_ladder_hangs_on_its_rungs() {
    for n in [3usize, 8, 20] {
        let model = ladder(n);
        let choice = choose_tree(&model, &[]).unwrap();
        println!("{n}: {choice}");
        assert!(choice.is_changed() && choice.found.cost.nesting < choice.given.nesting);
        let given = ClosedDynamics::<f64>::new(&model).unwrap();
        let best = ClosedDynamics::<f64>::new(&choice.model).unwrap();
        assert_eq!((given.nesting(), best.nesting()), (choice.given.nesting, choice.found.cost.nesting));
        // Two loops of five rows at most are open at a loop's three joints, where two chains as rails cost their cube.
        assert!(best.nesting() <= 300 * n, "{n}: {}", best.nesting());
        assert_eq!(best.closures(), n);
    }
}

/// Positions and accelerations of all bodies are those of the given model, from a state that both are assembled to.
#[test]
fn the_mechanism_is_the_same() {
    let n = 4;
    let model = ladder(n);
    let mut dynamics = ClosedDynamics::<f64>::new(&model).unwrap();
    let mut random = Random::new(3);
    let mut q: Vec<f64> = (0..model.nq())
        .map(|i| {
            let name = &model.joints()[model.joint_of_velocity(i).0].name;
            // Rails lean a little, rungs stand across.
            if name.starts_with("rung") { 1.5 } else { 0.1 * random.signed() }
        })
        .collect();
    dynamics.assemble(&mut q, &Conditions::default()).unwrap();
    let want = motion(&model, &q);
    let choice = choose_tree(&model, &[]).unwrap();
    assert!(choice.is_changed());
    // The same place of every body: each joint's coordinate is the angle of its child's axes in its parent's.
    let other = &choice.model;
    let zero = vec![0.0; model.nv()];
    let places = phipsi_reference::kinematics(&model, &q, &zero, &zero);
    let heading = |name: &str| match model.find_body(name).unwrap() {
        Some(k) => {
            let x = places[k].pose.rotation.column(0);
            x.0[1].atan2(x.0[0])
        }
        None => 0.0,
    };
    let still = vec![0.0; other.nv()];
    let mut again = other.neutral::<f64>();
    for k in 0..other.len() {
        let joint = &other.joints()[k];
        if joint.kind.nv() == 0 {
            continue;
        }
        // A massless body has the frame of its only child, turned by a constant that is zero here.
        let body = &other.bodies()[k];
        let outer = (0..other.len()).find(|&c| other.tree().parent(c) == Some(k));
        let name = if body.inertia.mass > 0.0 { &body.name } else { &other.bodies()[outer.unwrap()].name };
        let inner = other.tree().parent(k).map_or("world", |p| &other.bodies()[p].name);
        let sign = joint.kind.axes()[0][2];
        again[other.q_offset(k)] = sign * (heading(name) - heading(inner));
    }
    let got = motion(other, &again);
    assert_eq!(still.len(), model.nv());
    let size = want.iter().fold(1.0f64, |m, (_, _, a)| m.max(a.norm()));
    for ((name, place, rate), (other, there, rate_there)) in want.iter().zip(&got) {
        assert_eq!(name, other);
        // Lengths of metres, and an assembly to 1e-15.
        assert!((*place - *there).norm() < 1e-12, "{name}: {place:?} {there:?}");
        // Conditioning of a ladder of four loops.
        assert!((*rate - *rate_there).norm() < 1e-10 * size, "{name}: {rate:?} {rate_there:?}");
    }
}

#[test]
fn what_the_user_keeps_stays() {
    let model = ladder(8);
    let pins: Vec<String> = model.closures().iter().map(|c| c.name.clone()).collect();
    let pins: Vec<&str> = pins.iter().map(String::as_str).collect();
    let kept = choose_tree(&model, &pins).unwrap();
    assert!(!kept.is_changed(), "{kept}");
    let some = choose_tree(&model, &["pin3", "left2 hinge"]).unwrap();
    assert!(some.model.closures().iter().any(|c| c.name == "pin3"));
    assert!(some.model.find_joint("left2 hinge").is_ok());
    // A tree of one loop cannot be bettered.
    assert!(!choose_tree(&ladder(1), &[]).unwrap().is_changed());
}
