//! Kernels against `golden_trees.json`: random trees with joints of 1 to 6 degrees of freedom, every number checked by
//! D'Alembert's principle in multiple precision to 1e-14. The file counts tip to base; frames are given at one configuration.

use phipsi::model::joint::rotation_from_z;
use phipsi::model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use phipsi::recursion::{
    ArticulatedSweep, Layout, forward_dynamics, inverse_dynamics, mass_matrix, mass_matrix_inverse,
};
use phipsi::spatial::{Mat3, Quaternion, RigidInertia, Sym3, Vec3};
use serde_json::Value;

/// The file's numbers are correct to 1e-14 relative to the largest entry of each array.
const FILE: f64 = 1e-14;

fn numbers(v: &Value) -> Vec<f64> {
    match v {
        Value::Array(a) => a.iter().flat_map(numbers).collect(),
        v => vec![v.as_f64().expect("a number")],
    }
}

/// The joint type whose hinge map has these rows, with the vector from the file's frame to a point on its axis.
fn joint_of(rows: &[Vec<f64>]) -> (JointKind, Vec3<f64>) {
    let angular = |r: &[f64]| Vec3([r[0], r[1], r[2]]);
    let linear = |r: &[f64]| Vec3([r[3], r[4], r[5]]);
    let zero = Vec3::zero();
    match rows {
        [r] => {
            let (w, v) = (angular(r), linear(r));
            if w == zero {
                return (JointKind::Prismatic { axis: v.0 }, zero);
            }
            // A screw: the axis passes through w × v / |w|², its pitch is w·v / |w|².
            let square = w.dot(w);
            let (pitch, point) = (w.dot(v) / square, w.cross(v).scale(1.0 / square));
            if pitch.abs() < 1e-15 {
                (JointKind::Revolute { axis: w.0 }, point)
            } else {
                (JointKind::Helical { axis: w.0, pitch }, point)
            }
        }
        [a, _] => (JointKind::Cylindrical { axis: angular(a).0 }, zero),
        [a, b, _] if angular(a) != zero && angular(b) == zero => {
            (JointKind::Planar { normal: angular(a).0 }, zero)
        }
        [_, _, _] => (JointKind::Spherical, zero),
        _ => (JointKind::Free, zero),
    }
}

struct Golden {
    model: Model,
    /// Index in the file of our degree of freedom i, with its sign or scale.
    order: Vec<usize>,
    betas: Vec<f64>,
    accelerations: Vec<f64>,
    forces: Vec<f64>,
}

fn load(name: &str, tree: &Value) -> Golden {
    let parent: Vec<usize> = numbers(&tree["parent"]).iter().map(|&p| p as usize).collect();
    let n = parent.len();
    let frames: Vec<(Mat3<f64>, Vec3<f64>)> = (0..n)
        .map(|k| {
            let t = numbers(&tree["T0"][k]);
            (Mat3([[t[0], t[1], t[2]], [t[4], t[5], t[6]], [t[8], t[9], t[10]]]), Vec3([t[3], t[7], t[11]]))
        })
        .collect();
    let joints: Vec<(JointKind, Vec3<f64>)> = (0..n)
        .map(|k| joint_of(&tree["H"][k].as_array().unwrap().iter().map(numbers).collect::<Vec<_>>()))
        .collect();
    let mut builder = ModelBuilder::new(name).gravity(numbers(&tree["g"]).try_into().unwrap());
    for k in 0..n {
        let (kind, offset) = joints[k];
        // Bodies' frames are moved onto screw axes; children and masses move with them.
        let inertia = tree["points"][k].clone();
        let masses = numbers(&inertia[0]);
        let (mut m, mut h, mut about) = (0.0, Vec3::zero(), Sym3::zero());
        for (i, mass) in masses.iter().enumerate() {
            let p = numbers(&inertia[1][i]);
            let p = Vec3([p[0], p[1], p[2]]) - offset;
            (m, h, about) = (m + mass, h + p.scale(*mass), about + Sym3::point_mass(*mass, p));
        }
        let center = h.scale(1.0 / m);
        let tensor = (about + Sym3::point_mass(-m, center)).entries();
        let frame = Placement { translation: center.0, ..Placement::IDENTITY };
        let outer = joints.get(parent[k]).map_or(Vec3::zero(), |j| j.1);
        let (r, l) = frames[k];
        let placement =
            Placement { translation: (r * offset + l - outer).0, rotation: Quaternion::from_rotation(&r).0 };
        let body = Body::new(format!("b{k}"), Inertia { mass: m, frame, tensor });
        let to = if parent[k] == n { "world".to_string() } else { format!("b{}", parent[k]) };
        builder =
            builder.body(body).joint(Joint::new(format!("j{k}"), kind).at(placement), to, format!("b{k}"));
    }
    let model = builder.build().unwrap();
    let mut starts = vec![0];
    for k in 0..n {
        starts.push(starts[k] + tree["H"][k].as_array().unwrap().len());
    }
    // Our order of joints and, inside planar joints, our own axes of the plane.
    let mut order = Vec::new();
    for joint in model.joints() {
        let k: usize = joint.name[1..].parse().unwrap();
        order.extend(starts[k]..starts[k + 1]);
        if let JointKind::Planar { normal } = joint.kind {
            let rows: Vec<Vec<f64>> = tree["H"][k].as_array().unwrap().iter().map(numbers).collect();
            let axes = rotation_from_z(Vec3(normal));
            for i in 0..2 {
                let theirs = Vec3([rows[i + 1][3], rows[i + 1][4], rows[i + 1][5]]);
                assert!((axes.column(i) - theirs).norm() < 1e-14, "plane axes of {name} {k}");
            }
        }
    }
    let pick = |key: &str| {
        let all = numbers(&tree[key]);
        order.iter().map(|&i| all[i]).collect::<Vec<f64>>()
    };
    let (betas, accelerations, forces) = (pick("beta"), pick("betadot"), pick("T"));
    Golden { model, order, betas, accelerations, forces }
}

fn assert_close(what: &str, got: &[f64], want: &[f64], budget: f64) {
    let scale = want.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    for (i, (g, w)) in got.iter().zip(want).enumerate() {
        assert!(
            (g - w).abs() <= budget * scale,
            "{what}[{i}]: {g} instead of {w}, {:e}",
            (g - w).abs() / scale
        );
    }
    assert_eq!(got.len(), want.len(), "{what}");
}

#[test]
fn kernels_reproduce_the_golden_trees() {
    let text = std::fs::read_to_string("../../validation/data/golden_trees.json").unwrap();
    let all: Value = serde_json::from_str(&text).unwrap();
    for name in ["serial-1dof", "tree-fixed", "tree-free", "forest"] {
        let tree = &all[name];
        let golden = load(name, tree);
        let (model, q) = (&golden.model, golden.model.neutral::<f64>());
        let layout = Layout::<f64>::new(model);
        let nv = model.nv();
        // Rounding of n bodies' recursions besides that of the file; κ of these scenes is below 50 (soa.md 2.2).
        let budget = FILE + model.len() as f64 * f64::EPSILON * 50.0;
        let tau = inverse_dynamics(&layout, &q, &golden.betas, &golden.accelerations, None).unwrap();
        assert_close(&format!("{name}: T"), &tau, &golden.forces, budget);
        let a = forward_dynamics(&layout, &q, &golden.betas, &golden.forces, None).unwrap();
        let m_inverse = mass_matrix_inverse(&layout, &q).unwrap();
        let permuted = |key: &str| {
            let dense = numbers(&tree[key]);
            let at = |i: usize, j: usize| dense[golden.order[i] * nv + golden.order[j]];
            (0..nv * nv).map(|ij| at(ij / nv, ij % nv)).collect::<Vec<f64>>()
        };
        // Accelerations answer to errors of the file's forces through M⁻¹.
        let gain = m_inverse.iter().fold(0.0f64, |m, x| m.max(x.abs()))
            * golden.forces.iter().fold(0.0f64, |m, x| m.max(x.abs()))
            / golden.accelerations.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        assert_close(
            &format!("{name}: betadot"),
            &a,
            &golden.accelerations,
            budget * (1.0 + gain) * nv as f64,
        );
        assert_close(
            &format!("{name}: M"),
            &mass_matrix(&layout, &q).unwrap(),
            &permuted("mass_matrix"),
            budget,
        );
        assert_close(&format!("{name}: M⁻¹"), &m_inverse, &permuted("mass_inverse"), 10.0 * budget);
        let sweep = ArticulatedSweep::new(&layout, &q).unwrap();
        let want = tree["lndet"].as_f64().unwrap();
        assert!(
            (sweep.log_determinant() - want).abs() <= budget * want.abs() * nv as f64,
            "{name}: ln det M"
        );
    }
}

#[test]
fn a_rigid_inertia_of_points_has_their_momentum() {
    let m = RigidInertia::from_center_of_mass(2.0, Vec3([1.0, 0.0, 0.0]), Sym3::zero());
    assert_eq!(m.inertia, Sym3::point_mass(2.0, Vec3([1.0, 0.0, 0.0])));
}
