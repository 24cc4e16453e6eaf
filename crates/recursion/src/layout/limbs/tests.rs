use super::*;
use phipsi_model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use phipsi_reference::generate::case_with_limbs;
use phipsi_spatial::lanes::Level;

/// Bodies on hinges about alternating axes, by their parents; body 0 floats.
fn tree(parents: &[usize]) -> Model {
    let ball = Inertia::from_principal(1.0, [0.1, 0.0, 0.05], [0.02; 3]);
    let mut builder = ModelBuilder::new("limbs").base(Base::Free).body(Body::new("b0", ball));
    for (k, parent) in (1..).zip(parents) {
        let axis = if k % 2 == 0 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        let placement = Placement::from_xyz_rpy([0.2, 0.1 * k as f64, 0.0], [0.0; 3]);
        builder = builder.body(Body::new(format!("b{k}").as_str(), ball)).joint(
            Joint::new(format!("j{k}"), JointKind::Revolute { axis }).at(placement),
            format!("b{parent}"),
            format!("b{k}"),
        );
    }
    builder.build().expect("a tree")
}

/// Number of limbs and of their bodies, group by group.
fn groups(parents: &[usize]) -> Vec<(usize, usize)> {
    let layout = Layout::<f64>::new(&tree(parents));
    let plan = layout.limbs.as_ref();
    plan.map_or(Vec::new(), |plan| plan.groups.iter().map(|l| (l.count, l.layout.len())).collect())
}

#[test]
fn limbs_of_robots_are_found() {
    if Level::best() < Level::Avx2 {
        println!("this processor has no lanes for limbs");
        return;
    }
    // A quadruped, a tripod, a hexapod, of which two legs stay, and legs with arms, of which the outer parts are like the legs.
    assert_eq!(groups(&[0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11]), [(4, 3)]);
    assert_eq!(groups(&[0, 1, 0, 3, 0, 5]), [(3, 2)]);
    assert_eq!(groups(&[0, 1, 0, 3, 0, 5, 0, 7, 0, 9, 0, 11]), [(4, 2)]);
    assert_eq!(groups(&[0, 1, 2, 0, 4, 5, 0, 7, 8, 9, 0, 11, 12, 13]), [(4, 3)]);
    // Nothing alike, or too little of it.
    assert_eq!(groups(&[0, 1, 2, 3, 4, 5, 6, 7]), []);
    assert_eq!(groups(&[0, 1, 2, 0, 4, 5]), []);
    assert_eq!(groups(&[0, 0, 0, 0]), []);
}

/// Every body is in the trunk or in one lane, with its own constants.
#[test]
fn every_body_has_one_place() {
    let mut found = 0;
    for seed in 0..200 {
        let layout = Layout::<f64>::new(&case_with_limbs(seed).model);
        let Some(plan) = layout.limbs.as_ref() else { continue };
        found += 1;
        let mut seen = vec![0; layout.len()];
        for (bodies, _) in &plan.trunk {
            seen[bodies.clone()].iter_mut().for_each(|n| *n += 1);
        }
        for limbs in &plan.groups {
            for lane in 0..limbs.count {
                for (i, body) in limbs.layout.bodies.iter().enumerate() {
                    let own = &layout.bodies[limbs.roots[lane] + i];
                    seen[limbs.roots[lane] + i] += 1;
                    assert_eq!((limbs.q[i][lane], limbs.v[i][lane]), (own.q, own.v));
                    let masses: [f64; 4] = body.inertia.mass.to_array();
                    assert_eq!(masses[lane], own.inertia.mass);
                    assert_eq!(matches!(body.hinge, Hinge::Revolute), matches!(own.hinge, Hinge::Revolute));
                }
            }
        }
        assert!(seen.iter().all(|n| *n == 1), "seed {seed}: {seen:?}");
    }
    assert!(found == 200 || Level::best() < Level::Avx2, "{found}");
}
