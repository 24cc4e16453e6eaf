//! Mechanisms with loops, read from URDF, against accelerations and forces in extended precision (`validation/data/loops`,
//! conventions in its README).
#![cfg(all(feature = "formats", feature = "closure"))]

use phipsi::closure::{ClosedDynamics, ClosedForm, ClosedInfo, Conditions};
use phipsi::formats::urdf::{Mimic, UrdfOptions, read_urdf_file};
use phipsi::model::{Base, Closure, ClosureKind, Model, ModelBuilder, Placement};
use phipsi::spatial::{Quaternion, Transform, Vec3};
use serde_json::Value;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../validation/data/loops");

fn read(name: &str) -> Value {
    let text = std::fs::read_to_string(format!("{DATA}/{name}.json")).expect("a data file");
    serde_json::from_str(&text).expect("JSON")
}

fn numbers(v: &Value) -> Vec<f64> {
    let number = |x: &Value| match x.as_str() {
        Some(text) => text.parse().expect("a number"),
        None => x.as_f64().expect("a number"),
    };
    v.as_array().expect("an array").iter().map(number).collect()
}

fn three(v: &Value) -> [f64; 3] {
    numbers(v).try_into().expect("three numbers")
}

/// The tree of a file with the closures of its data.
fn model(name: &str) -> Model {
    let options = UrdfOptions { base: Base::Fixed, mimic: Mimic::Free };
    let (mut model, _) =
        read_urdf_file(format!("{DATA}/{name}.urdf"), &options).into_result(false).expect("a mechanism");
    model = model.with_gravity([0.0, 0.0, -9.81]);
    for closure in read(name)["closures"].as_array().expect("closures") {
        let text = |key: &str| closure[key].as_str().expect("text").to_string();
        let pose = |side: &str| {
            let [xyz, rpy] = ["xyz", "rpy"].map(|key| three(&closure[format!("{key}_{side}")]));
            Placement::from_xyz_rpy(xyz, rpy)
        };
        let kind = if text("type") == "point3" { ClosureKind::Spherical } else { ClosureKind::Weld };
        let closure = Closure {
            name: text("name"),
            kind,
            body_a: text("link_a"),
            pose_a: pose("a"),
            body_b: text("link_b"),
            pose_b: pose("b"),
        };
        model = model.with_closure(closure).expect("a closure");
    }
    model
}

/// Where our coordinates are in the file's arrays.
fn orders(model: &Model, file: &Value) -> (Vec<usize>, Vec<usize>) {
    let (mut q_order, mut v_order) = (vec![usize::MAX; model.nq()], vec![usize::MAX; model.nv()]);
    for joint in file["joints"].as_array().expect("joints") {
        let [q, v] = ["idx_q", "idx_v"].map(|key| joint[key].as_u64().expect("an index") as usize);
        let k = model.find_joint(joint["name"].as_str().expect("a name")).expect("the joint of that name");
        if joint["type"] == "JointModelFreeFlyer" {
            (0..7).for_each(|i| q_order[model.q_offset(k) + i] = q + i);
            (0..6).for_each(|i| v_order[model.v_offset(k) + i] = v + (i + 3) % 6);
        } else {
            q_order[model.q_offset(k)] = q;
            v_order[model.v_offset(k)] = v;
        }
    }
    (q_order, v_order)
}

fn pick(all: &[f64], order: &[usize]) -> Vec<f64> {
    order.iter().map(|&i| all[i]).collect()
}

fn relative_error(got: &[f64], want: &[f64]) -> f64 {
    let scale = want.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    got.iter().zip(want).fold(0.0f64, |m, (g, w)| m.max((g - w).abs())) / scale
}

/// Errors of accelerations and generalised constraint forces, the worst of all samples, and how many of them were solved in the
/// plain form.
fn check(name: &str, form: ClosedForm) -> ([f64; 2], usize) {
    let (model, file) = (model(name), read(name));
    let (q_order, v_order) = orders(&model, &file);
    let dynamics = ClosedDynamics::<f64>::new(&model).expect("a mechanism");
    let mut dynamics = dynamics.with_form(form).expect("rigid");
    let (mut worst, mut plain) = ([0.0f64; 2], 0);
    for sample in file["samples"].as_array().expect("samples") {
        let array = |key: &str| pick(&numbers(&sample[key]), &v_order);
        let q = pick(&numbers(&sample["q"]), &q_order);
        let (mut a, mut force) = (vec![0.0; model.nv()], vec![0.0; model.nv()]);
        let solved =
            dynamics.run(&q, &array("v"), &array("tau"), &Conditions::default(), &mut a).expect("regular");
        solved.generalized_constraint_force(&mut force).expect("lengths");
        assert_eq!(Some(solved.info().rank as u64), sample["rank"].as_u64(), "{name}: {:?}", solved.info());
        assert_eq!(solved.info().inconsistency, None, "{name}");
        plain += usize::from(solved.info().form == ClosedForm::Plain);
        worst[0] = worst[0].max(relative_error(&a, &array("ddq_closed_ext")));
        worst[1] = worst[1].max(relative_error(&force, &array("generalized_constraint_force_ext")));
    }
    println!(
        "{name}, {form:?}: accelerations {:.1e}, generalised constraint force {:.1e}",
        worst[0], worst[1]
    );
    (worst, plain)
}

const NAMES: [&str; 9] = [
    "ladderL_0001",
    "ladderL_0002",
    "ladderL_0004",
    "ladderL_0008",
    "ladderL_0016",
    "ladderL_0064",
    "ladderL_0128",
    "stewart",
    "twoarm",
];

#[test]
fn loops_agree_with_extended_precision() {
    for name in NAMES {
        // The files' last digit is 1e-16 of the largest component; 128 loops add up roundings of 384 bodies.
        let ([a, force], plain) = check(name, ClosedForm::Mixed);
        assert_eq!(plain, 0);
        assert!(a <= 1e-12, "{name}: accelerations are off by {a:e}");
        assert!(force <= 1e-12, "{name}: constraint forces are off by {force:e}");
    }
}

/// All states of these mechanisms are for the plain form: rows that their trees imply lie along an axis.
#[test]
fn the_plain_form_agrees_with_extended_precision() {
    for name in NAMES {
        let ([a, force], plain) = check(name, ClosedForm::Auto);
        assert_eq!(plain, read(name)["samples"].as_array().expect("samples").len(), "{name}");
        assert!(a <= 1e-12, "{name}: accelerations are off by {a:e}");
        assert!(force <= 1e-12, "{name}: constraint forces are off by {force:e}");
    }
}

#[test]
fn the_square_root_form_agrees_with_extended_precision() {
    for name in NAMES {
        let ([a, force], _) = check(name, ClosedForm::SquareRoot);
        assert!(a <= 1e-12, "{name}: accelerations are off by {a:e}");
        assert!(force <= 1e-12, "{name}: constraint forces are off by {force:e}");
    }
}

#[test]
fn a_nearly_folded_four_bar_keeps_its_digits() {
    folded(ClosedForm::Mixed);
    folded(ClosedForm::SquareRoot);
}

/// The plain form above σ = 1e-4; below it the state is redone, and keeps its digits, too.
#[test]
fn a_nearly_folded_four_bar_is_redone_where_squares_lose_it() {
    folded(ClosedForm::Auto);
}

fn folded(form: ClosedForm) {
    let (model, file) = (model("ladderL_0001"), read("near_singular_four_bar"));
    let names: Vec<&str> =
        file["order"].as_array().expect("names").iter().map(|n| n.as_str().expect("a name")).collect();
    let order: Vec<usize> = (0..model.nv())
        .map(|i| {
            let joint = &model.joints()[model.joint_of_velocity(i).0];
            names.iter().position(|n| *n == joint.name).expect("the joint")
        })
        .collect();
    let dynamics = ClosedDynamics::<f64>::new(&model).expect("a mechanism");
    let mut dynamics = dynamics.with_form(form).expect("rigid");
    for sample in file["samples"].as_array().expect("samples") {
        let theta = sample["theta"].as_f64().expect("an angle");
        let array = |key: &str| pick(&numbers(&sample[key]), &order);
        let mut a = vec![0.0; 3];
        let solved = dynamics
            .run(&array("q"), &array("v"), &array("tau"), &Conditions::default(), &mut a)
            .expect("regular");
        let info: ClosedInfo = solved.info();
        let error = relative_error(&a, &array("ddq"));
        let plain = form == ClosedForm::Auto && info.smallest_pivot > 1e-4;
        assert_eq!(info.form == ClosedForm::Plain, plain, "{theta:e}: {info:?}");
        println!("crank angle {theta:e}: error {error:.1e}, σ {:.1e}, {info:?}", info.smallest_pivot);
        assert_eq!(info.rank, 2, "{theta:e}: {info:?}");
        assert_eq!(info.near_singular, theta < 2e-6, "{theta:e}: {info:?}");
        assert!(error <= 1e-13, "{theta:e}: {error:e}");
    }
}

/// The same mechanism with its ground and its gravity turned.
fn turned(model: &Model, turn: &Transform<f64>) -> Model {
    let gravity = turn.rotation * Vec3(model.gravity());
    let mut builder = ModelBuilder::new(model.name()).gravity(gravity.0);
    for (k, (body, joint)) in model.bodies().iter().zip(model.joints()).enumerate() {
        let mut joint = joint.clone();
        let parent = match model.tree().parent(k) {
            Some(p) => model.bodies()[p].name.clone(),
            None => {
                let pose = turn.compose(&joint.placement.to_transform());
                let rotation = Quaternion::from_rotation(&pose.rotation).0;
                joint.placement = Placement { translation: pose.translation.0, rotation };
                "world".into()
            }
        };
        builder = builder.body(body.clone()).joint(joint, parent, body.name.clone());
    }
    model.closures().iter().fold(builder, |b, c| b.closure(c.clone())).build().expect("the same mechanism")
}

/// Copies in any direction, and coordinates changed in their last digits: what the data allow is ε/σ, with σ and the rank told.
#[test]
fn copies_of_a_nearly_folded_four_bar_are_as_good_as_their_data() {
    let (model, file) = (model("ladderL_0001"), read("near_singular_four_bar"));
    let names: Vec<&str> =
        file["order"].as_array().expect("names").iter().map(|n| n.as_str().expect("a name")).collect();
    let order: Vec<usize> = (0..model.nv())
        .map(|i| {
            let joint = &model.joints()[model.joint_of_velocity(i).0];
            names.iter().position(|n| *n == joint.name).expect("the joint")
        })
        .collect();
    let mut worst = 0.0f64;
    for seed in 0..24 {
        let mut random = phipsi::model::Random::new(seed);
        let turn = Transform::new(Quaternion(random.quaternion()).to_rotation(), Vec3(random.vector()));
        let copy = turned(&model, &turn);
        let mut dynamics = ClosedDynamics::<f64>::new(&copy).expect("a mechanism");
        for sample in file["samples"].as_array().expect("samples") {
            let theta = sample["theta"].as_f64().expect("an angle");
            let array = |key: &str| pick(&numbers(&sample[key]), &order);
            let mut q = array("q");
            if seed >= 12 {
                q.iter_mut().for_each(|q| *q *= 1.0 + 2.0 * f64::EPSILON * random.signed());
            }
            let mut a = vec![0.0; 3];
            let solved = dynamics
                .run(&q, &array("v"), &array("tau"), &Conditions::default(), &mut a)
                .expect("regular");
            let info = solved.info();
            assert_eq!(info.rank, 2, "{seed}, {theta:e}: {info:?}");
            assert_eq!(info.near_singular, theta < 2e-6, "{seed}, {theta:e}: {info:?}");
            let error = relative_error(&a, &array("ddq"));
            worst = worst.max(error * info.smallest_pivot / f64::EPSILON);
            assert!(
                error <= 20.0 * f64::EPSILON / info.smallest_pivot,
                "{seed}, {theta:e}: {error:e}, {info:?}"
            );
        }
    }
    println!("worst {worst:.1} ε/σ");
}

/// From half a radian, or half a metre, beside, on all joints.
#[test]
fn mechanisms_are_assembled_from_rough_guesses() {
    for name in ["ladderL_0001", "ladderL_0008", "stewart", "twoarm"] {
        let (model, file) = (model(name), read(name));
        let (q_order, _) = orders(&model, &file);
        let mut dynamics = ClosedDynamics::<f64>::new(&model).expect("a mechanism");
        let mut random = phipsi::model::Random::new(11);
        for sample in file["samples"].as_array().expect("samples") {
            let mut q = pick(&numbers(&sample["q"]), &q_order);
            model.normalize(&mut q);
            let noise: Vec<f64> = (0..model.nv()).map(|_| 0.5 * random.signed()).collect();
            let mut q = model.integrate(&q, &noise);
            let done = dynamics.assemble(&mut q, &Conditions::default()).expect("it can be closed");
            println!("{name}: {done:?}");
            assert!(done.residual[0] > 1e-2, "{name}: {done:?}");
            assert!(done.residual[1] < 1e-13, "{name}: {done:?}");
        }
    }
}
