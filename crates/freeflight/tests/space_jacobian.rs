//! Motions at zero momentum.

use phipsi_freeflight::{FreeFlightError, SpaceJacobian, reactionless_basis};
use phipsi_model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use phipsi_recursion::{About, Layout, jacobian, momentum, multiply_by_mass_matrix};
use phipsi_spatial::Vec3;

/// A satellite with an arm of `n` hinges.
fn satellite(n: usize) -> Model {
    let bus = Inertia::from_principal(8.0, [0.1, 0.0, 0.0], [2.0, 2.5, 3.0]);
    let rod = Inertia::from_principal(1.0, [0.4, 0.1, 0.0], [0.02, 0.1, 0.1]);
    let mut builder =
        ModelBuilder::new("satellite").base(Base::Free).body(Body::new("bus", bus)).gravity([0.0; 3]);
    for k in 0..n {
        let axis = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.2]][k % 3];
        let at = Placement { translation: [0.6, 0.1, -0.2], ..Placement::IDENTITY };
        let parent = if k == 0 { "bus".to_string() } else { format!("link{}", k - 1) };
        builder = builder.body(Body::new(format!("link{k}"), rod)).joint(
            Joint::new(format!("j{k}"), JointKind::Revolute { axis }).at(at),
            parent,
            format!("link{k}"),
        );
    }
    builder.build().unwrap()
}

/// v with the base's answer to joint rates at zero momentum: M v has no part along the base's axes.
fn zero_momentum(layout: &Layout<f64>, q: &[f64], rates: &[f64]) -> Vec<f64> {
    let nv = layout.nv();
    let mut v = vec![0.0; nv];
    v[6..].copy_from_slice(rates);
    // Six unit motions of the base span what M v can be balanced with.
    let push = multiply_by_mass_matrix(layout, q, &v).unwrap();
    let columns: Vec<Vec<f64>> = (0..6)
        .map(|i| {
            let mut unit = vec![0.0; nv];
            unit[i] = 1.0;
            multiply_by_mass_matrix(layout, q, &unit).unwrap()[..6].to_vec()
        })
        .collect();
    let locked = nalgebra::DMatrix::from_fn(6, 6, |i, j| columns[j][i]);
    let follows = locked.lu().solve(&nalgebra::DVector::from_column_slice(&push[..6])).unwrap();
    (0..6).for_each(|i| v[i] = -follows[i]);
    v
}

#[test]
fn points_move_as_the_space_jacobian_says() {
    for seed in 0..20 {
        let model = satellite(7);
        let layout = Layout::<f64>::new(&model);
        let state = model.random_state(seed);
        let rates = &state.v[6..];
        let v = zero_momentum(&layout, &state.q, rates);
        let total = momentum(&layout, &state.q, &v, About::CenterOfMass).unwrap().to_array();
        assert!(total.iter().all(|x| x.abs() < 1e-13), "{total:?}");
        let (body, point) = (model.find_body("link6").unwrap(), Some(Vec3([0.5, -0.1, 0.2])));
        let mut space = vec![0.0; 6 * 7];
        SpaceJacobian::new(&layout).unwrap().run(&layout, &state.q, body, point, &mut space).unwrap();
        let full = jacobian(&layout, &state.q, body, point).unwrap();
        for (row, full) in space.chunks_exact(7).zip(&full) {
            let got: f64 = row.iter().zip(rates).map(|(a, b)| a * b).sum();
            let want: f64 = full.iter().zip(&v).map(|(a, b)| a * b).sum();
            assert!((got - want).abs() < 1e-13, "{got} instead of {want}");
        }
    }
}

/// Seven joints and six constraints: one motion leaves the base at rest, and it is a unit vector.
#[test]
fn reactionless_motions_leave_the_base_alone() {
    for (joints, dimension) in [(7, 1), (9, 3), (5, 0)] {
        let model = satellite(joints);
        let layout = Layout::<f64>::new(&model);
        let state = model.random_state(3);
        let basis = reactionless_basis(&layout, &state.q).unwrap();
        assert_eq!(basis.vectors.len(), dimension, "{:?}", basis.singular_values);
        for (i, vector) in basis.vectors.iter().enumerate() {
            for (j, other) in basis.vectors.iter().enumerate() {
                let dot: f64 = vector.iter().zip(other).map(|(a, b)| a * b).sum();
                assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-14);
            }
            let v = zero_momentum(&layout, &state.q, vector);
            assert!(v[..6].iter().all(|x| x.abs() < 1e-14 / basis.singular_values[5]), "{:?}", &v[..6]);
        }
    }
}

#[test]
fn a_fixed_base_is_named() {
    let model = ModelBuilder::new("arm")
        .body(Body::new("link", Inertia::from_principal(1.0, [0.1; 3], [0.1; 3])))
        .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 0.0, 1.0] }), "world", "link")
        .build()
        .unwrap();
    let layout = Layout::<f64>::new(&model);
    let error = FreeFlightError::NotFree { joint: "hinge".into() };
    assert_eq!(SpaceJacobian::new(&layout).unwrap_err(), error);
    assert_eq!(reactionless_basis(&layout, &[0.0]).unwrap_err(), error);
}
