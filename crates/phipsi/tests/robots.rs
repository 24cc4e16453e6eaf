//! Robots read from URDF against Pinocchio's numbers (`validation/data/robots`, conventions in its README): linear before
//! angular there, angular before linear here; joints matched by name.

use phipsi::formats::urdf::{Mimic, UrdfOptions, read_urdf_file};
use phipsi::model::{Base, Model};
use phipsi::recursion::{
    About, Layout, bias_forces, body_pose, center_of_mass, forward_dynamics, inverse_dynamics, jacobian,
    kinetic_energy, mass_matrix, momentum, potential_energy,
};
use serde_json::Value;

/// Relative error of every array; Pinocchio's own error in double precision is part of it.
const BUDGET: f64 = 1e-11;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../validation/data/robots");

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().expect("an array").iter().map(|x| x.as_f64().expect("a number")).collect()
}

struct Robot {
    name: String,
    model: Model,
    file: Value,
    /// For each of our position coordinates and degrees of freedom, the index in the file.
    q_order: Vec<usize>,
    v_order: Vec<usize>,
}

fn load(name: &str) -> Robot {
    let text = std::fs::read_to_string(format!("{DATA}/reference/{name}.json")).expect("a reference file");
    let file: Value = serde_json::from_str(&text).expect("JSON");
    // Free bases have a floating joint to a link `world` in their files.
    let options = UrdfOptions { base: Base::Fixed, mimic: Mimic::Free };
    let (model, _) =
        read_urdf_file(format!("{DATA}/models/{name}.urdf"), &options).into_result(false).expect("a robot");
    let model = model.with_gravity([0.0, 0.0, -9.81]);
    let (mut q_order, mut v_order) = (vec![usize::MAX; model.nq()], vec![usize::MAX; model.nv()]);
    for joint in file["joints"].as_array().expect("joints") {
        let (kind, their_name) =
            (joint["type"].as_str().expect("a type"), joint["name"].as_str().expect("a name"));
        let [q, v] = ["idx_q", "idx_v"].map(|key| joint[key].as_u64().expect("an index") as usize);
        if kind == "JointModelFreeFlyer" {
            let k = (0..model.len()).find(|&k| model.tree().parent(k).is_none()).expect("a root");
            (0..7).for_each(|i| q_order[model.q_offset(k) + i] = q + i);
            (0..6).for_each(|i| v_order[model.v_offset(k) + i] = v + (i + 3) % 6);
        } else {
            let k = model.find_joint(their_name).expect("the joint of that name");
            assert_eq!(model.q_range(k).len(), 1, "{name}: {their_name} is {kind}");
            q_order[model.q_offset(k)] = q;
            v_order[model.v_offset(k)] = v;
        }
    }
    assert!(q_order.iter().chain(&v_order).all(|&i| i != usize::MAX), "{name}: a joint is not in the file");
    Robot { name: name.into(), model, file, q_order, v_order }
}

fn pick(all: &[f64], order: &[usize]) -> Vec<f64> {
    order.iter().map(|&i| all[i]).collect()
}

/// Largest error over the largest number.
fn relative_error(got: &[f64], want: &[f64]) -> f64 {
    assert_eq!(got.len(), want.len());
    let scale = want.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    got.iter().zip(want).fold(0.0f64, |m, (g, w)| m.max((g - w).abs() / scale))
}

fn check(robot: &Robot, what: &str, got: &[f64], want: &[f64], budget: f64) {
    let error = relative_error(got, want);
    assert!(error <= budget, "{}: {what}: relative error {error:e}, allowed {budget:e}", robot.name);
}

/// Everything of one sample; `forward` is the budget of the accelerations.
fn check_sample(robot: &Robot, sample: &Value, forward: f64) {
    let layout = Layout::<f64>::new(&robot.model);
    let v_array = |key: &str| pick(&numbers(&sample[key]), &robot.v_order);
    let q = pick(&numbers(&sample["q"]), &robot.q_order);
    let [v, tau, a] = ["v", "tau", "a"].map(v_array);
    // Where there are numbers of 100 digits, they are the judge.
    let best = |key: &str| {
        let wide = format!("{key}_mp");
        if sample[&wide].is_null() { v_array(key) } else { v_array(&wide) }
    };
    check(robot, "ddq", &forward_dynamics(&layout, &q, &v, &tau, None).unwrap(), &best("ddq"), forward);
    let torques = inverse_dynamics(&layout, &q, &v, &a, None).unwrap();
    check(robot, "tau_rnea", &torques, &best("tau_rnea"), BUDGET);
    check(robot, "nle", &bias_forces(&layout, &q, &v).unwrap(), &v_array("nle"), BUDGET);
    check(robot, "com", &center_of_mass(&layout, &q).unwrap().0, &numbers(&sample["com"]), BUDGET);
    let scalar = |key: &str| [sample[key].as_f64().expect("a number")];
    check(robot, "kinetic", &[kinetic_energy(&layout, &q, &v).unwrap()], &scalar("kinetic"), BUDGET);
    check(robot, "potential", &[potential_energy(&layout, &q).unwrap()], &scalar("potential"), BUDGET);
    let h = momentum(&layout, &q, &v, About::CenterOfMass).unwrap().to_array();
    let theirs = numbers(&sample["h_centroidal"]);
    check(robot, "angular momentum", &h[..3], &theirs[3..], BUDGET);
    check(robot, "linear momentum", &h[3..], &theirs[..3], BUDGET);
    let last = robot.model.find_joint(robot.file["last_joint"].as_str().expect("a name")).unwrap();
    let pose = body_pose(&layout, &q, Some(last)).unwrap();
    let placement = &sample["placement_last"];
    check(robot, "translation", &pose.translation.0, &numbers(&placement["xyz"]), BUDGET);
    check(robot, "rotation", &pose.rotation.0.concat(), &numbers(&placement["R"]), BUDGET);
    let nv = robot.model.nv();
    if !sample["M"].is_null() {
        let theirs = numbers(&sample["M"]);
        let order = &robot.v_order;
        let want: Vec<f64> = (0..nv * nv).map(|ij| theirs[order[ij / nv] * nv + order[ij % nv]]).collect();
        check(robot, "M", &mass_matrix(&layout, &q).unwrap(), &want, BUDGET);
    }
    if !sample["J_last"].is_null() {
        let theirs = numbers(&sample["J_last"]);
        let rows = jacobian(&layout, &q, Some(last), None).unwrap();
        for (row, ours) in rows.iter().enumerate() {
            let first = (row + 3) % 6 * nv;
            let want = pick(&theirs[first..first + nv], &robot.v_order);
            if want.iter().any(|x| *x != 0.0) {
                check(robot, "J_last", ours, &want, BUDGET);
            } else {
                assert!(ours.iter().all(|x| x.abs() < BUDGET), "{}: row {row} of J_last", robot.name);
            }
        }
    }
}

fn check_robot(name: &str, forward: f64) {
    let robot = load(name);
    let samples = robot.file["samples"].as_array().expect("samples");
    assert!(samples.len() >= 4, "{name}");
    for sample in samples {
        check_sample(&robot, sample, forward);
    }
    let total: f64 = robot.file["total_mass"].as_f64().expect("a mass");
    let fixed: f64 = (0..robot.model.len())
        .filter(|&k| !robot.model.tree().path_to_root(k).any(|j| robot.model.joints()[j].kind.nv() > 0))
        .map(|k| robot.model.bodies()[k].inertia.mass)
        .sum();
    check(&robot, "mass", &[robot.model.total_mass() - fixed], &[total], BUDGET);
}

#[test]
fn robots_agree_with_pinocchio() {
    for name in [
        "panda",
        "ur5",
        "allegro",
        "solo12",
        "anymal_c",
        "talos_reduced",
        "chain_0007",
        "chain_0016",
        "chain_0064",
        "chainz_0007",
        "chainz_0016",
        "chainz_0064",
        "tree_0063",
    ] {
        check_robot(name, BUDGET);
    }
}

/// Heavy tips lose digits in forward dynamics, about ε times the ratio of masses (soa.md 2.2); alternating masses do not.
#[test]
fn chains_of_unequal_masses_agree_with_a_hundred_digits() {
    for (power, ratio) in [(3, 1e3), (6, 1e6), (9, 1e9)] {
        check_robot(&format!("mr_tip_1e{power}_0064"), (100.0 * f64::EPSILON * ratio).max(BUDGET));
        check_robot(&format!("mr_alt_1e{power}_0064"), BUDGET);
    }
}
