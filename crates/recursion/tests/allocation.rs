//! Workspaces are made once; afterwards nothing allocates. A binary of its own: the counter is the global allocator.

use allocation_counter::measure;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{
    ArticulatedSweep, CentroidalMomentumMatrix, Form, FormForwardDynamics, ForwardDynamics,
    ForwardDynamicsDerivatives, InverseDynamics, InverseDynamicsDerivatives, Jacobian, Kinematics, Layout,
    MassMatrix, MassMatrixInverse, body_pose, body_velocity,
};
use phipsi_reference::generate::case;

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
        assert_none("derivatives of inverse dynamics", seed, || {
            let out = (&mut d_dq, &mut d_dv, &mut d_last);
            inverse_derivatives.run(&layout, q, v, &case.a, wrenches, out.0, out.1, out.2).unwrap();
        });
        assert_none("derivatives of forward dynamics", seed, || {
            let out = (&mut d_dq, &mut d_dv, &mut d_last);
            forward_derivatives.run(&layout, q, v, &case.tau, wrenches, out.0, out.1, out.2).unwrap();
        });
        assert_none("mass matrix", seed, || mass_matrix.run(&layout, q, &mut matrix).unwrap());
        let mut inverse_matrix = MassMatrixInverse::new(&layout);
        assert_none("mass matrix inverse", seed, || inverse_matrix.run(&layout, q, &mut matrix).unwrap());
        let mut rows = vec![0.0; 6 * out.len()];
        let (mut jacobian, mut centroidal) = (Jacobian::new(&layout), CentroidalMomentumMatrix::new(&layout));
        assert_none("Jacobian", seed, || {
            jacobian.run(&layout, q, Some(case.body), None, &mut rows).unwrap();
        });
        assert_none("centroidal matrix", seed, || centroidal.run(&layout, q, &mut rows).unwrap());
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
    }
}
