//! Workspaces are made once; afterwards nothing allocates. A binary of its own: the counter is the global allocator.

use allocation_counter::measure;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{
    About, ArticulatedSweep, CenterOfMass, CentroidalMomentumMatrix, DiagonalDynamics, DiagonalVelocity,
    Form, FormForwardDynamics, ForwardDynamics, ForwardDynamicsDerivatives, HybridDynamics, InverseDynamics,
    InverseDynamicsDerivatives, InverseKinematics, InverseKinematicsOptions, Jacobian, JacobianPseudoInverse,
    JointReactions, Kinematics, KineticEnergy, Layout, Linearization, LogDeterminantGradient, MassMatrix,
    MassMatrixInverse, MassMatrixSolution, Momentum, OperationalSpaceInertia, PseudoInverseOptions, Tip,
    Upsilon, body_pose, body_velocity,
};
use phipsi_reference::generate::case;
use phipsi_reference::generate_flexible::{Bodies, flexible_case};
use phipsi_spatial::Wrench;

fn assert_none(what: &str, seed: u64, run: impl FnOnce()) {
    let counted = measure(run);
    assert_eq!(counted.count_total, 0, "{what}, seed {seed}: {counted:?}");
}

#[test]
fn the_counter_counts() {
    assert_eq!(measure(|| drop(std::hint::black_box(vec![0u8; 8]))).count_total, 1);
}

#[test]
fn kernels_do_not_allocate() {
    for seed in 0..50 {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let (q, v, wrenches) = (&case.q[..], &case.v[..], Some(&case.wrenches[..]));
        let mut out = vec![0.0; case.model.nv()];
        let mut forward = ForwardDynamics::new(&layout);
        let mut inverse = InverseDynamics::new(&layout);
        let mut mass_matrix = MassMatrix::new(&layout);
        let mut matrix = vec![0.0; out.len() * out.len()];
        let mut inverse_derivatives = InverseDynamicsDerivatives::new(&layout);
        let mut forward_derivatives = ForwardDynamicsDerivatives::new(&layout);
        let square = vec![0.0; case.model.nv() * case.model.nv()];
        let (mut d_dq, mut d_dv, mut d_last) = (square.clone(), square.clone(), square);
        let mut kinematics = Kinematics::new(&layout);
        let mut sweep = ArticulatedSweep::new(&layout, q).unwrap();
        let mut workspace = SolveWorkspace::new(&layout);
        assert_none("forward dynamics", seed, || {
            forward.run(&layout, q, v, &case.tau, wrenches, &mut out).unwrap();
        });
        for form in Form::ALL {
            let mut forward = FormForwardDynamics::new(&case.model, &layout, form);
            assert_none(form.name(), seed, || {
                forward.run(&layout, q, v, &case.tau, wrenches, &mut out).unwrap();
            });
        }
        assert_none("inverse dynamics", seed, || {
            inverse.run(&layout, q, v, &case.a, wrenches, &mut out).unwrap();
        });
        let active: Vec<bool> = (0..case.model.nv()).map(|i| i % 2 == 1).collect();
        let (mut a, mut tau) = (case.a.clone(), case.tau.clone());
        let mut hybrid = HybridDynamics::new(&layout);
        assert_none("hybrid dynamics", seed, || {
            hybrid.run(&layout, q, v, &active, &mut a, &mut tau, wrenches).unwrap();
        });
        assert_none("derivatives of inverse dynamics", seed, || {
            let out = (&mut d_dq, &mut d_dv, &mut d_last);
            inverse_derivatives.run(&layout, q, v, &case.a, wrenches, out.0, out.1, out.2).unwrap();
        });
        assert_none("derivatives of forward dynamics", seed, || {
            let out = (&mut d_dq, &mut d_dv, &mut d_last);
            forward_derivatives.run(&layout, q, v, &case.tau, wrenches, out.0, out.1, out.2).unwrap();
        });
        assert_none("mass matrix", seed, || mass_matrix.run(&layout, q, &mut matrix).unwrap());
        assert_none("factors", seed, || sweep.update(&layout, q).unwrap());
        assert_none("solve", seed, || sweep.solve_in_place(&layout, &mut out, &mut workspace));
        assert_none("square roots", seed, || {
            sweep.multiply_by_square_root(&layout, &mut out, &mut workspace);
            sweep.multiply_by_inverse_square_root(&layout, &mut out, &mut workspace);
        });
        assert_none("kinematics", seed, || {
            kinematics.set_position(&layout, q).unwrap();
            kinematics.set_velocity(&layout, v).unwrap();
            kinematics.set_acceleration(&layout, v, &case.a).unwrap();
        });
        assert_none("one body", seed, || {
            body_pose(&layout, q, Some(case.body)).unwrap();
            body_velocity(&layout, q, v, Some(case.body)).unwrap();
        });
        let (mut inverse, mut solution) = (MassMatrixInverse::new(&layout), MassMatrixSolution::new(&layout));
        assert_none("inverse of the mass matrix", seed, || inverse.run(&layout, q, &mut matrix).unwrap());
        assert_none("solution", seed, || solution.run(&layout, q, &case.tau, &mut out).unwrap());
        let (mut kinetic, mut center) = (KineticEnergy::new(&layout), CenterOfMass::new(&layout));
        assert_none("energies", seed, || {
            kinetic.run(&layout, q, v).unwrap();
            center.potential_energy(&layout, q).unwrap();
            center.run(&layout, q).unwrap();
        });
        let mut momentum = Momentum::new(&layout);
        let mut centroidal = CentroidalMomentumMatrix::new(&layout);
        let mut rows = vec![0.0; 6 * case.model.nv()];
        assert_none("momentum", seed, || {
            momentum.run(&layout, q, v, About::CenterOfMass).unwrap();
            centroidal.run(&layout, q, &mut rows).unwrap();
        });
        let mut jacobian = Jacobian::new(&layout);
        assert_none("Jacobian", seed, || {
            jacobian.run(&layout, q, Some(case.body), Some(case.point), &mut rows).unwrap();
        });
        let (mut gradient, mut upsilon) = (LogDeterminantGradient::new(&layout), Upsilon::new(&layout));
        let mut blocks = vec![0.0; 36 * case.model.len()];
        assert_none("gradient of the determinant", seed, || {
            gradient.run(&layout, q, &mut out).unwrap();
            upsilon.run(&layout, q, &mut blocks).unwrap();
        });
        let mut diagonal = DiagonalDynamics::new(&layout);
        let mut rate = out.clone();
        assert_none("diagonal dynamics", seed, || {
            for kind in [DiagonalVelocity::Plain, DiagonalVelocity::Normalized] {
                diagonal.diagonal(&layout, q, v, kind, &mut out).unwrap();
                diagonal.joint_velocity(&layout, q, v, kind, &mut out).unwrap();
                diagonal.coriolis(&layout, q, v, kind, &mut out).unwrap();
                diagonal.run(&layout, q, v, &case.tau, wrenches, kind, &mut out, &mut rate).unwrap();
            }
        });
        let mut inertia = OperationalSpaceInertia::new(&layout);
        let mut pseudo_inverse = JacobianPseudoInverse::new(&layout, 2);
        let tips =
            [Tip { body: Some(case.body), point: Some(case.point) }, Tip { body: Some(0), point: None }];
        assert_none("inverses of the Jacobian", seed, || {
            inertia.run(&layout, q, Some(case.body), Some(case.point), &mut blocks[..36]).unwrap();
            pseudo_inverse.update(&layout, q, &tips, PseudoInverseOptions::default()).unwrap();
            pseudo_inverse.solve(&[0.1; 12], &mut out).unwrap();
        });
        let mut inverse_kinematics = InverseKinematics::new(&case.model, &layout);
        let mut found = case.q.clone();
        let options = InverseKinematicsOptions { restarts: 1, iterations: 5, ..Default::default() };
        let target = body_pose(&layout, &case.model.random_state(seed).q, Some(case.body)).unwrap();
        assert_none("inverse kinematics", seed, || {
            inverse_kinematics.run(&case.model, &layout, case.body, &target, q, options, &mut found).unwrap();
        });
        let mut linearization = Linearization::new(&layout);
        let (mut a, mut b) = (vec![0.0; 4 * matrix.len()], vec![0.0; 2 * matrix.len()]);
        assert_none("linearization", seed, || {
            linearization.run(&layout, q, v, &case.tau, wrenches, &mut a, &mut b).unwrap();
        });
        let mut reactions = JointReactions::new(&case.model, &layout);
        let mut forces = vec![Wrench::zero(); case.model.len()];
        assert_none("joint reactions", seed, || {
            reactions.run(&layout, q, v, &case.a, wrenches, &mut forces).unwrap();
        });
    }
}

#[test]
fn kernels_with_flexible_bodies_do_not_allocate() {
    for seed in 0..50 {
        let case = flexible_case(seed, Bodies::General);
        let layout = Layout::<f64>::new(&case.model);
        let (q, v, wrenches) = (&case.q[..], &case.v[..], Some(&case.wrenches[..]));
        let mut out = vec![0.0; case.model.nv()];
        let mut matrix = vec![0.0; out.len() * out.len()];
        let mut forward = ForwardDynamics::new(&layout);
        let mut inverse = InverseDynamics::new(&layout);
        let mut mass_matrix = MassMatrix::new(&layout);
        let mut inverse_matrix = MassMatrixInverse::new(&layout);
        let mut solution = MassMatrixSolution::new(&layout);
        let mut kinematics = Kinematics::new(&layout);
        let mut kinetic = KineticEnergy::new(&layout);
        let mut center = CenterOfMass::new(&layout);
        let mut momentum = Momentum::new(&layout);
        assert_none("forward dynamics", seed, || {
            forward.run(&layout, q, v, &case.tau, wrenches, &mut out).unwrap();
        });
        for form in [Form::Auto, Form::Plain, Form::Refined, Form::DoubleDouble] {
            let mut forward = FormForwardDynamics::new(&case.model, &layout, form);
            assert_none(form.name(), seed, || {
                forward.run(&layout, q, v, &case.tau, wrenches, &mut out).unwrap();
            });
        }
        assert_none("inverse dynamics", seed, || {
            inverse.run(&layout, q, v, &case.a, wrenches, &mut out).unwrap();
        });
        assert_none("mass matrix", seed, || mass_matrix.run(&layout, q, &mut matrix).unwrap());
        assert_none("inverse of the mass matrix", seed, || {
            inverse_matrix.run(&layout, q, &mut matrix).unwrap();
        });
        assert_none("solution", seed, || solution.run(&layout, q, &case.tau, &mut out).unwrap());
        assert_none("kinematics", seed, || {
            kinematics.set_position(&layout, q).unwrap();
            kinematics.set_velocity(&layout, v).unwrap();
            kinematics.set_acceleration(&layout, v, &case.a).unwrap();
        });
        assert_none("energies and momentum", seed, || {
            kinetic.run(&layout, q, v).unwrap();
            center.run(&layout, q).unwrap();
            center.potential_energy(&layout, q).unwrap();
            momentum.run(&layout, q, v, About::CenterOfMass).unwrap();
        });
    }
}
