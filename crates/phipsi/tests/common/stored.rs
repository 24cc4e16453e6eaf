//! Mechanisms with accelerations known to many digits: `validation/data/extreme_chains.json` (quadruple precision) and the
//! chains of unequal masses of `validation/data/robots` (100 digits).

use phipsi::formats::urdf::{Mimic, UrdfOptions, read_urdf_file};
use phipsi::model::Base;
use phipsi::spatial::{Vec3, Wrench};
use phipsi_reference::extreme::{Chain, Scene};
use phipsi_reference::generate::Case;
use serde_json::Value;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../validation/data");

/// The chains whose masses differ.
pub const UNEQUAL: [&str; 6] = [
    "mr_tip_1e3_0064",
    "mr_tip_1e6_0064",
    "mr_tip_1e9_0064",
    "mr_alt_1e3_0064",
    "mr_alt_1e6_0064",
    "mr_alt_1e9_0064",
];

fn read(path: &str) -> Value {
    let text = std::fs::read_to_string(format!("{DATA}/{path}")).expect("a data file");
    serde_json::from_str(&text).expect("JSON")
}

fn numbers(v: &Value) -> Vec<f64> {
    let number = |x: &Value| x.as_f64().or_else(|| x.as_str()?.parse().ok()).expect("a number");
    v.as_array().expect("an array").iter().map(number).collect()
}

/// Each chain and its accelerations.
pub fn extreme_chains() -> Vec<(Scene, Vec<f64>)> {
    let one = |c: &Value| {
        let n = |key: &str| numbers(&c[key]);
        let offset = n("offset");
        let chain = Chain {
            masses: n("m"),
            lengths: n("L"),
            axes: n("axis").into_iter().map(|x| x as usize).collect(),
            offset: [offset[0], offset[1], offset[2]],
            gravity: c["g"].as_f64().expect("a number"),
            radius: 0.05,
        };
        let case = chain.case(n("q"), n("qd"), n("tau"));
        (Scene { name: c["name"].as_str().expect("a name").into(), case }, n("acc_ref"))
    };
    read("extreme_chains.json").as_array().expect("chains").iter().map(one).collect()
}

/// The samples of a robot of one-axis joints that have accelerations of 100 digits, and these.
pub fn robot(name: &str) -> Vec<(Scene, Vec<f64>)> {
    let options = UrdfOptions { base: Base::Fixed, mimic: Mimic::Free };
    let (model, _) = read_urdf_file(format!("{DATA}/robots/models/{name}.urdf"), &options)
        .into_result(false)
        .expect("a robot");
    let model = model.with_gravity([0.0, 0.0, -9.81]);
    let file = read(&format!("robots/reference/{name}.json"));
    let mut order = vec![(0, 0); model.nv()];
    for joint in file["joints"].as_array().expect("joints") {
        let k = model.find_joint(joint["name"].as_str().expect("a name")).expect("the joint of that name");
        let [q, v] = ["idx_q", "idx_v"].map(|key| joint[key].as_u64().expect("an index") as usize);
        assert_eq!(model.q_range(k).len(), 1, "{name}");
        assert_eq!(model.q_offset(k), model.v_offset(k), "{name}");
        order[model.v_offset(k)] = (q, v);
    }
    let samples = file["samples"].as_array().expect("samples");
    let one = |(i, sample): (usize, &Value)| {
        let v_array = |key: &str| {
            let all = numbers(&sample[key]);
            order.iter().map(|&(_, v)| all[v]).collect::<Vec<f64>>()
        };
        let q = numbers(&sample["q"]);
        let wrenches = vec![Wrench::zero(); model.len()];
        let case = Case {
            q: order.iter().map(|&(at, _)| q[at]).collect(),
            v: v_array("v"),
            a: vec![0.0; model.nv()],
            tau: v_array("tau"),
            rounding: wrenches.clone(),
            wrenches,
            body: 0,
            point: Vec3::zero(),
            model: model.clone(),
        };
        (Scene { name: format!("{name}, sample {i}"), case }, v_array("ddq_mp"))
    };
    samples.iter().enumerate().filter(|(_, sample)| !sample["ddq_mp"].is_null()).map(one).collect()
}
