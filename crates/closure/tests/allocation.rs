//! Workspaces are made once; afterwards nothing allocates. A binary of its own: the counter is the global allocator.

use allocation_counter::measure;
use phipsi_closure::{ClosedDynamics, ClosedForm, ClosureCompliance, Conditions, Projection};
use phipsi_reference::loops::closed_case;

fn assert_none(what: &str, seed: u64, run: impl FnOnce()) {
    let counted = measure(run);
    assert_eq!(counted.count_total, 0, "{what}, seed {seed}: {counted:?}");
}

#[test]
fn nothing_allocates_after_the_workspace() {
    for seed in 0..50 {
        let closed = closed_case(seed);
        let case = &closed.case;
        let mut dynamics = ClosedDynamics::<f64>::new(&case.model).unwrap();
        let (mut a, mut force, mut v) = (case.a.clone(), case.a.clone(), case.v.clone());
        let mut lambda = vec![0.0; dynamics.rows()];
        let mut q = case.q.clone();
        case.model.normalize(&mut q);
        let conditions = Conditions { wrenches: Some(&case.wrenches), ..Conditions::default() };
        assert_none("forward dynamics", seed, || {
            let mut solved = dynamics.run(&q, &v, &case.tau, &conditions, &mut a).unwrap();
            solved.closure_forces(&mut lambda).unwrap();
            solved.generalized_constraint_force(&mut force).unwrap();
        });
        for form in [ClosedForm::Auto, ClosedForm::SquareRoot] {
            let mut other = ClosedDynamics::<f64>::new(&case.model).unwrap().with_form(form).unwrap();
            assert_none("other forms", seed, || {
                let mut solved = other.run(&q, &v, &case.tau, &conditions, &mut a).unwrap();
                solved.closure_forces(&mut lambda).unwrap();
            });
        }
        let mut compliance = ClosureCompliance::<f64>::new(&case.model).unwrap();
        let mut omega = vec![0.0; lambda.len() * lambda.len()];
        assert_none("compliance", seed, || compliance.run(&q, &mut omega).unwrap());
        assert_none("velocities", seed, || {
            dynamics.project_velocity(&q, &mut v, &conditions).unwrap();
        });
        assert_none("positions", seed, || {
            dynamics.project_position(&mut q, &conditions).unwrap();
            dynamics.assemble(&mut q, &conditions).unwrap();
        });
        let mut projection = Projection::<f64>::new(&case.model, &q).unwrap();
        assert_none("projection", seed, || {
            projection.update(&q).unwrap();
            projection.apply(&mut a).unwrap();
        });
    }
}
