//! Simeon's slider-crank with a flexible rod (IVP test set): accelerations at stored states, with the stored multipliers as forces.
//!
//! The rod's frame is its chord, pinned at both ends: two sines across, two quadratic shapes along (the displacements of the
//! middle and of the tip). Its published longitudinal mass block is fifteen times that of the shapes, (8 1; 1 2) ρAL: a body takes
//! such a number as it is. Reference: `validation/data/slider_crank_flexible.json`, the values for π without truncation.

use phipsi_model::{
    Body, FlexibleBody, Inertia, Joint, JointKind, Model, ModelBuilder, Node, Placement, ShapeIntegrals,
};
use phipsi_recursion::{Layout, forward_dynamics};
use phipsi_spatial::{Vec3, Wrench};
use serde_json::Value;
use std::f64::consts::PI;

const CRANK: f64 = 0.15;
const ROD: f64 = 0.3;

fn data() -> Value {
    let text = std::fs::read_to_string("../../validation/data/slider_crank_flexible.json").unwrap();
    serde_json::from_str(&text).unwrap()
}

fn rod(p: &Value) -> FlexibleBody {
    let number = |key: &str| p[key].as_f64().unwrap();
    let (width, height, density, young) = (number("B"), number("H"), number("rho"), number("E"));
    let mass = density * width * height * ROD;
    let mut sum = ShapeIntegrals::zero(4);
    sum.mass = mass;
    sum.first_moment[0] = 0.5 * mass * ROD;
    sum.second_moment[0][0] = mass * ROD * ROD / 3.0;
    sum.rotary[2][2] = number("J2") - mass * ROD * ROD / 3.0;
    // Across: sin πx, sin 2πx; along: 4x(1 − x), x(2x − 1).
    let across = [[2.0 / PI, 1.0 / PI], [0.0, -0.5 / PI]];
    let along = [[2.0 / 3.0, 1.0 / 3.0], [1.0 / 6.0, 1.0 / 6.0]];
    let mixed = [[16.0 / PI.powi(3), 0.0], [1.0 / PI - 8.0 / PI.powi(3), -0.5 / PI]];
    let published = [[8.0, 1.0], [1.0, 2.0]];
    for l in 0..2 {
        sum.displacement[l][1] = mass * across[l][0];
        sum.moment[l][1][0] = mass * ROD * across[l][1];
        sum.displacement[2 + l][0] = mass * along[l][0];
        sum.moment[2 + l][0][0] = mass * ROD * along[l][1];
        sum.product[l * 4 + l][1][1] = 0.5 * mass;
        for m in 0..2 {
            sum.product[(2 + l) * 4 + 2 + m][0][0] = mass * published[l][m];
            sum.product[(2 + l) * 4 + m][0][1] = mass * mixed[l][m];
            sum.product[m * 4 + 2 + l][1][0] = mass * mixed[l][m];
        }
    }
    let axial = young * width * height / ROD;
    let bending = axial * PI.powi(4) * (height / ROD).powi(2);
    let mut stiffness = vec![0.0; 16];
    stiffness[0] = bending / 24.0;
    stiffness[5] = bending * 2.0 / 3.0;
    stiffness[10] = axial * 16.0 / 3.0;
    (stiffness[11], stiffness[14]) = (-axial * 8.0 / 3.0, -axial * 8.0 / 3.0);
    stiffness[15] = axial * 7.0 / 3.0;
    let mut tip = Node::fixed("tip", [ROD, 0.0, 0.0], 4);
    tip.displacement[3] = [1.0, 0.0, 0.0];
    FlexibleBody::new(sum, stiffness, vec![tip])
}

fn slider_crank(p: &Value) -> Model {
    let about_z = JointKind::Revolute { axis: [0.0, 0.0, 1.0] };
    let number = |key: &str| p[key].as_f64().unwrap();
    let crank = Inertia::from_principal(number("M1"), [0.0; 3], [1e-3, 1e-3, number("J1")]);
    let slider = Inertia::from_principal(number("M3"), [0.0; 3], [1e-3; 3]);
    let end = Placement { translation: [CRANK, 0.0, 0.0], ..Placement::IDENTITY };
    ModelBuilder::new("slider-crank")
        .gravity([0.0; 3])
        .body(Body::new("crank", crank))
        .body(Body::flexible("rod", rod(p)))
        .body(Body::new("pin", Inertia::ZERO))
        .body(Body::new("slider", slider))
        .joint(Joint::new("drive", about_z), "world", "crank")
        .joint(Joint::new("knee", about_z).at(end), "crank", "rod")
        .joint_at_node(Joint::new("end", JointKind::Fixed), "rod", "tip", "pin")
        .joint(Joint::new("guide", JointKind::Prismatic { axis: [1.0, 0.0, 0.0] }), "world", "slider")
        .build()
        .unwrap()
}

#[test]
fn accelerations_of_the_published_states() {
    let data = data();
    let model = slider_crank(&data["parameters"]);
    let layout = Layout::<f64>::new(&model);
    let at = |name: &str| model.v_offset(model.find_joint(name).unwrap());
    let (drive, knee, guide) = (at("drive"), at("knee"), at("guide"));
    let modes = model.mode_v_range(model.find_body("rod").unwrap().unwrap()).start;
    let mut worst = 0.0f64;
    for (t, stored) in data["reference_true_pi"].as_object().unwrap() {
        let x: Vec<f64> =
            stored.as_array().unwrap().iter().map(|x| x.as_str().unwrap().parse().unwrap()).collect();
        // Crank and rod angles are absolute there.
        let tree = |x: &[f64]| {
            let mut y = vec![0.0; 7];
            (y[drive], y[knee], y[guide]) = (x[0], x[1] - x[0], x[2]);
            y[modes..].copy_from_slice(&x[3..7]);
            y
        };
        let (q, v) = (tree(&x[..7]), tree(&x[7..14]));
        // Constraints y and −x of the tip less the slider, and the crank's angle; forces are minus their gradients.
        let lambda = &x[21..24];
        let mut tau = vec![0.0; 7];
        (tau[drive], tau[guide]) = (-lambda[2], -lambda[1]);
        let (force, (s, c)) = ([lambda[1], -lambda[0]], x[1].sin_cos());
        let mut wrenches = vec![Wrench::zero(); model.len()];
        let on_tip = Vec3([c * force[0] + s * force[1], c * force[1] - s * force[0], 0.0]);
        wrenches[model.find_body("pin").unwrap().unwrap()] = Wrench::new(Vec3::zero(), on_tip);
        let a = forward_dynamics(&layout, &q, &v, &tau, Some(&wrenches)).unwrap();
        let mut found = vec![a[drive], a[drive] + a[knee], a[guide]];
        found.extend(&a[modes..]);
        // What rounds: the joints' accelerations, and in the modes' those of the rod's points.
        let largest = |x: &[f64]| x.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let joints = largest(&x[14..17]);
        for (i, (found, want)) in found.iter().zip(&x[14..21]).enumerate() {
            let scale = if i < 3 { joints } else { ROD * joints };
            let error = (found - want).abs() / scale;
            worst = worst.max(error);
            assert!(error < 1e-14, "t = {t}, component {i}: {found} instead of {want}, {error:e}");
        }
    }
    println!("largest error {worst:e} of the accelerations of joints and points");
}
