//! Large trees branch by branch, on any number of threads: the bits of one sweep over all bodies. (Without the feature
//! `parallel` the branches take turns on one thread.)

use crate::common::seeds;
use phipsi_model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random};
use phipsi_recursion::{
    DynamicsError, ForwardDynamics, InverseDynamics, Layout, forward_dynamics, inverse_dynamics,
};
use phipsi_reference::generate::{Case, Limits, case_within, starved};
use phipsi_spatial::lanes::Fused;
use phipsi_spatial::{Real, Wrench};

const CASES: u64 = 300;

/// Pools of one, two and four threads.
fn pools() -> Vec<rayon::ThreadPool> {
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    [1, 2, 4].map(pool).into()
}

/// Trees of many branches.
fn bushy(seed: u64) -> Case {
    let mut case = case_within(seed, Limits { degrees_of_freedom: 150, decades: 0.5 });
    // A third with hinges that fail.
    if seed.is_multiple_of(3) {
        case.model = starved(&mut Random::new(seed), &case.model);
    }
    case
}

fn bits<T: Real>(x: Result<Vec<T>, DynamicsError>) -> Result<Vec<u64>, DynamicsError> {
    x.map(|x| x.iter().map(|x| x.to_f64().to_bits()).collect())
}

#[test]
fn branches_give_the_bits_of_one_sweep() {
    let pools = pools();
    let (mut cut, mut failed, mut nested) = (0, 0, 0);
    for seed in seeds(CASES) {
        let case = bushy(seed);
        let layout = Layout::<f64>::new(&case.model).with_branches(usize::MAX);
        let (q, v) = (&case.q[..], &case.v[..]);
        let fused = |x: &[f64]| x.iter().map(|x| Fused(*x)).collect::<Vec<Fused>>();
        let (fq, fv, ftau) = (fused(q), fused(v), fused(&case.tau));
        for wrenches in [None, Some(&case.wrenches[..])] {
            let forward = |l: &Layout<f64>| bits(forward_dynamics(l, q, v, &case.tau, wrenches));
            let inverse = |l: &Layout<f64>| bits(inverse_dynamics(l, q, v, &case.a, wrenches));
            // The way of a number in lanes, without packed six-vectors.
            let plain = |l: &Layout<f64>| {
                let result = forward_dynamics::<Fused>(l, &fq, &fv, &ftau, None);
                result.map(|x| x.iter().map(|x| x.0.to_bits()).collect::<Vec<u64>>())
            };
            let want = (forward(&layout), inverse(&layout), plain(&layout));
            failed += usize::from(want.0.is_err());
            for least in [1, 2, 5, 20] {
                let branches = layout.clone().with_branches(least);
                cut += usize::from(branches.branch_count() > 2);
                nested += usize::from(branches.branch_count() > 10);
                for pool in &pools {
                    let got = pool.install(|| (forward(&branches), inverse(&branches), plain(&branches)));
                    let threads = pool.current_num_threads();
                    assert_eq!(got, want, "PHIPSI_SEED={seed}, at least {least} bodies, {threads} threads");
                }
            }
        }
    }
    println!("{cut} layouts cut, {nested} in more than ten runs, {failed} with a hinge that fails");
    if std::env::var("PHIPSI_SEED").is_err() {
        assert!(cut > 1000 && nested > 200 && failed > 20, "too little was tried");
    }
}

#[test]
fn a_workspace_of_other_branches_is_refused() {
    let case = bushy(1);
    let whole = Layout::<f64>::new(&case.model);
    let (ones, fives) = (whole.clone().with_branches(1), whole.clone().with_branches(5));
    assert_ne!(ones.branch_count(), fives.branch_count());
    let mut out = vec![0.0; case.model.nv()];
    for other in [&whole, &fives] {
        let forward = ForwardDynamics::new(other).run(&ones, &case.q, &case.v, &case.tau, None, &mut out);
        let inverse = InverseDynamics::new(other).run(&ones, &case.q, &case.v, &case.a, None, &mut out);
        for result in [forward, inverse] {
            assert!(matches!(result, Err(DynamicsError::Shape { argument: "workspace", .. })), "{result:?}");
        }
    }
}

/// Rods on hinges; the body's number gives its parent, or `None` on the ground.
fn rods(count: usize, base: JointKind, parent: impl Fn(usize) -> Option<usize>) -> Model {
    let rod = Inertia::from_principal(1.0, [0.02, 0.01, 0.15], [0.012, 0.011, 0.002]);
    let mut builder = ModelBuilder::new("rods").base(Base::Fixed);
    for k in 0..count {
        let body = format!("b{k}");
        builder = builder.body(Body::new(body.as_str(), rod));
        let turn = 0.3 + 0.1 * (k % 5) as f64;
        let placement = Placement::from_xyz_rpy([0.05, 0.0, 0.3], [turn, 0.0, 0.0]);
        let (on, kind) = match parent(k) {
            Some(p) => (format!("b{p}"), JointKind::Revolute { axis: [0.0, 0.0, 1.0] }),
            None => ("world".to_owned(), base),
        };
        builder = builder.joint(Joint::new(format!("j{k}"), kind).at(placement), on, body);
    }
    builder.build().expect("a valid model")
}

/// Shapes of large trees, the depth of some of which would overflow a stack of calls.
#[test]
fn large_trees_are_cut_and_give_the_same_bits() {
    let n = 50_000;
    let hinge = JointKind::Revolute { axis: [0.0, 0.0, 1.0] };
    let before = |k: usize| k.checked_sub(1);
    // A hub on a root, arms on it, the last the shortest; on the root a rod, the last of all. This order is kept.
    let hub = |k: usize| match k {
        0 => None,
        1 => Some(0),
        _ if k == n - 1 => Some(0),
        _ => Some(if (k - 2).is_multiple_of(12_500) { 1 } else { k - 1 }),
    };
    let shapes: [(&str, bool, Model); 8] = [
        ("chain", false, rods(n, hinge, before)),
        ("binary tree", true, rods(n, hinge, |k| (k > 0).then(|| (k - 1) / 2))),
        ("comb, short teeth", false, rods(n, hinge, |k| k.checked_sub(if k % 4 == 0 { 4 } else { 1 }))),
        ("comb, long teeth", true, rods(n, hinge, |k| k.checked_sub(if k % 2500 == 0 { 2500 } else { 1 }))),
        (
            "64 arms",
            true,
            rods(n, hinge, |k| if (k - 1.min(k)) % 781 == 0 { (k > 0).then_some(0) } else { before(k) }),
        ),
        ("arms on a hub", true, rods(n, hinge, hub)),
        ("star", true, rods(n, hinge, |k| (k > 0).then_some(0))),
        ("free bodies", true, rods(n, JointKind::Free, |k| if k % 3 == 0 { None } else { before(k) })),
    ];
    let pools = pools();
    for (shape, is_cut, model) in shapes {
        let layout = Layout::<f64>::new(&model);
        assert_eq!(layout.branch_count() > 2, is_cut, "{shape}: {} runs", layout.branch_count());
        let state = model.random_state(7);
        let mut random = Random::new(8);
        let x: Vec<f64> = (0..model.nv()).map(|_| random.signed()).collect();
        let wrenches = vec![Wrench::from_array([0.1, -0.2, 0.3, -0.4, 0.5, -0.6]); model.len()];
        let results = |layout: &Layout<f64>| {
            let forward = forward_dynamics(layout, &state.q, &state.v, &x, Some(&wrenches)).expect("regular");
            let inverse = inverse_dynamics(layout, &state.q, &state.v, &x, Some(&wrenches)).expect("regular");
            (bits(Ok::<_, DynamicsError>(forward)), bits(Ok::<_, DynamicsError>(inverse)))
        };
        // One thread: no branches.
        let whole = layout.clone().with_branches(usize::MAX);
        let want = pools[0].install(|| results(&whole));
        for pool in pools.iter().filter(|_| is_cut) {
            assert!(
                pool.install(|| results(&layout)) == want,
                "{shape}, {} threads",
                pool.current_num_threads()
            );
        }
        let branches = layout.clone().with_branches(100);
        assert!(pools[1].install(|| results(&branches)) == want, "{shape}, branches of 100");
    }
}
