//! Loops over flexible bodies: random trees with closures between any of their bodies, against the dense equations in
//! double-double numbers, with M and C of moving mass points and of Boltzmann–Hamel's equations.

use phipsi_closure::{
    ClosedDynamics, ClosedInfo, ClosureError, ClosureMotion, Conditions, Number, Prescribed,
};
use phipsi_model::{Closure, ClosureKind, Model, Placement, Random};
use phipsi_reference::closed_dynamics::{ClosedSolution, Given, OpenTree, closed_tree, closure_rates};
use phipsi_reference::flexible as slow;
use phipsi_reference::generate_flexible::{Bodies, FlexibleCase, flexible_case, perturbed};
use phipsi_reference::kinematics::kinematics;
use phipsi_reference::sensitivity::{STEP, widened};
use phipsi_spatial::{Dd, Quaternion, Real, Scalar, Transform, Vec3, Wrench};

/// Mechanisms that are tried.
const CASES: u64 = 40;

/// Roundings per step of a sweep, beyond the n of n·ε·κ, as for the sweeps of trees.
const FACTOR: f64 = 4.0;

/// A tree with closures, accelerations that they are given, and prescribed joints.
struct Closed {
    case: FlexibleCase,
    closures: Vec<Closure>,
    /// What the rows give at the accelerations of the case: redundant rows agree.
    gamma: Vec<Dd>,
    active: Vec<bool>,
}

/// Pose of body `k`; the world's for `None`.
fn pose(model: &Model, q: &[Dd], k: Option<usize>) -> Transform<Dd> {
    let zero = vec![Dd::from_f64(0.0); model.nv()];
    k.map_or(Transform::identity(), |k| kinematics(model, q, &zero, &zero)[k].pose)
}

fn placed(pose: &Transform<Dd>) -> Placement {
    let rotation = Quaternion::from_rotation(&pose.rotation).0.map(Real::to_f64);
    Placement { translation: pose.translation.0.map(Real::to_f64), rotation }
}

/// One or two closures that the state of the case closes.
fn closed_case(seed: u64) -> Closed {
    let case = flexible_case(seed, Bodies::General);
    let mut random = Random::new(seed ^ 0x6c6f_6f70);
    let (q, n) = (widened(&case.q), case.model.len());
    let mut closures = Vec::new();
    for i in 0..1 + random.below(2) {
        let a = random.below(n);
        let b = if random.below(4) == 0 { None } else { Some(random.below(n)) }.filter(|b| *b != a);
        let flexible = (0..n).find(|&k| case.model.bodies()[k].modes() > 0).filter(|k| Some(*k) != b);
        let a = if random.below(2) == 0 { flexible.unwrap_or(a) } else { a };
        let own = Placement { translation: random.vector(), rotation: random.quaternion() };
        let kinds = [
            ClosureKind::Weld,
            ClosureKind::Revolute,
            ClosureKind::Spherical,
            ClosureKind::Spherical,
            ClosureKind::PointOnPlane,
            ClosureKind::Distance { length: 1.0 },
        ];
        let mut kind = kinds[random.below(kinds.len())];
        let there = pose(&case.model, &q, Some(a)).compose(&own.to_transform());
        let mut other = pose(&case.model, &q, b).inverse().compose(&there);
        if let ClosureKind::Distance { length } = &mut kind {
            // The other frame a good way off.
            let far =
                Transform::new(other.rotation, other.translation + Vec3([1.0, 0.5, -2.0].map(Dd::from_f64)));
            let rounded = placed(&far).to_transform::<Dd>();
            let from = pose(&case.model, &q, b).compose(&rounded).translation;
            *length = (from - there.translation).norm().to_f64();
            other = far;
        }
        let name = |k: Option<usize>| k.map_or("world".to_string(), |k| case.model.bodies()[k].name.clone());
        closures.push(Closure {
            name: format!("c{i}"),
            kind,
            body_a: name(Some(a)),
            pose_a: own,
            body_b: name(b),
            pose_b: placed(&other),
        });
    }
    let model = with_closures(&case.model, &closures);
    let rates = closure_rates(&model, &q, &widened(&case.v), &widened(&case.a));
    let gamma = rates.into_iter().map(|[_, second]| second).collect();
    let joints = case.model.joint_nv();
    let prescribes = random.below(2) == 0;
    let active = (0..case.model.nv()).map(|i| i < joints && prescribes && random.below(4) == 0).collect();
    Closed { case, closures, gamma, active }
}

fn with_closures(model: &Model, closures: &[Closure]) -> Model {
    let add = |model: Model, c: &Closure| model.with_closure(c.clone()).expect("a closure of the model");
    closures.iter().fold(model.clone(), add)
}

fn solve(closed: &Closed, case: &FlexibleCase, length: f64) -> ClosedSolution<Dd> {
    let model = with_closures(&case.model, &closed.closures);
    let [q, v, a, tau] = [&case.q, &case.v, &case.a, &case.tau].map(|x| widened(x));
    let wide = |w: Vec3<f64>| Vec3(w.0.map(Dd::from_f64));
    let wrenches: Vec<Wrench<Dd>> =
        case.wrenches.iter().map(|w| Wrench::new(wide(w.moment), wide(w.force))).collect();
    let given = Given {
        wrenches: Some(&wrenches),
        gamma: closed.gamma.clone(),
        active: closed.active.clone(),
        acceleration: a,
        length,
        tolerance: 1e-10,
    };
    let inverse = |a: &[Dd]| slow::inverse_dynamics(&case.model, &case.points, (&q, &v, a), Some(&wrenches));
    let matrix = slow::mass_matrix(&case.model, &case.points, &q);
    let open = OpenTree { matrix, order: (0..case.model.nv()).rev().collect(), inverse: &inverse };
    closed_tree(&model, open, (&q, &v, &tau), &given).expect("generated trees are regular")
}

/// max M_ii M⁻¹_ii: what the pivots of an elimination lose, here and in the reference.
fn scaled_condition(case: &FlexibleCase) -> f64 {
    let m = slow::mass_matrix(&case.model, &case.points, &widened(&case.q));
    let n = case.model.nv();
    let factors = phipsi_reference::dense::Factors::new(&m, (0..n).rev().collect(), 0.0).expect("regular");
    let entry = |i: usize| {
        let unit: Vec<Dd> = (0..n).map(|j| Dd::from_f64(if i == j { 1.0 } else { 0.0 })).collect();
        (m[(i, i)] * factors.solve(&unit)[i]).hi
    };
    (0..n).map(entry).fold(1.0, f64::max)
}

/// Accelerations, multipliers, generalised constraint force and generalised forces; rank; the scene's length.
type Outcome<T> = ([Vec<T>; 4], usize, f64);

fn run<T: Number>(closed: &Closed) -> Outcome<T> {
    let case = &closed.case;
    let convert = |x: &[f64]| -> Vec<T> { x.iter().map(|x| T::splat(*x)).collect() };
    let model = with_closures(&case.model, &closed.closures);
    // Closures' poses are rounded to f64.
    let mut dynamics = ClosedDynamics::<T>::new(&model).unwrap().with_data_error(f64::EPSILON);
    let [q, v, a, tau] = [&case.q, &case.v, &case.a, &case.tau].map(|x| convert(x));
    let wrenches: Vec<Wrench<T>> = case.wrenches.iter().map(|w| w.map(T::splat)).collect();
    let gamma: Vec<T> = closed.gamma.iter().map(|x| T::splat(x.hi) + T::splat(x.lo)).collect();
    let zero = vec![T::zero(); gamma.len()];
    let conditions = Conditions {
        wrenches: Some(&wrenches),
        motion: Some(ClosureMotion { position: &zero, velocity: &zero, acceleration: &gamma }),
        prescribed: Some(Prescribed { active: &closed.active, acceleration: &a }),
    };
    let n = model.nv();
    let [mut acceleration, mut force, mut forces] = [(); 3].map(|()| vec![T::zero(); n]);
    let mut multipliers = zero.clone();
    let length = dynamics.length();
    let mut solved = dynamics.run(&q, &v, &tau, &conditions, &mut acceleration).unwrap();
    let ClosedInfo { rank, inconsistency, .. } = solved.info();
    assert_eq!(inconsistency, None);
    solved.closure_forces(&mut multipliers).unwrap();
    solved.generalized_constraint_force(&mut force).unwrap();
    solved.generalized_forces(&q, &v, &tau, &acceleration, Some(&wrenches), &mut forces).unwrap();
    ([acceleration, multipliers, force, forces], rank, length)
}

#[test]
fn accelerations_and_forces_of_random_flexible_mechanisms() {
    let seeds: Vec<u64> = match std::env::var("PHIPSI_SEED") {
        Ok(seed) => vec![seed.parse().expect("PHIPSI_SEED is a whole number")],
        Err(_) => (0..CASES).collect(),
    };
    let mut worst = [[0.0f64; 4]; 2];
    // Loops that close over a flexible body, that end on one; redundant rows; prescribed joints.
    let mut seen = [0usize; 3];
    for &seed in &seeds {
        let closed = closed_case(seed);
        let case = &closed.case;
        let (got, rank, length) = run::<f64>(&closed);
        let (wide, wide_rank, _) = run::<Dd>(&closed);
        let want = solve(&closed, case, length);
        let [kept, dropped] = want.pivots;
        assert!(kept > 1e3 * dropped, "PHIPSI_SEED={seed}: pivots {kept:e} and {dropped:e} tell no rank");
        assert_eq!([rank, wide_rank], [want.rank; 2], "PHIPSI_SEED={seed}");
        let ends = |c: &Closure| {
            [c.body_a.as_str(), c.body_b.as_str()].map(|b| case.model.find_body(b).ok().flatten())
        };
        let on = |k: Option<usize>| k.is_some_and(|k| case.model.bodies()[k].modes() > 0);
        seen[0] += usize::from(closed.closures.iter().flat_map(ends).any(on));
        seen[1] += usize::from(want.rank < closed.gamma.len());
        seen[2] += usize::from(closed.active.contains(&true));
        let parts =
            |s: &ClosedSolution<Dd>| [&s.acceleration, &s.multipliers, &s.force, &s.tau].map(|x| x.clone());
        let exact = parts(&want);
        let mut size = exact.each_ref().map(|x| x.iter().fold(1e-3f64, |m, x| m.max(x.hi.abs())));
        let mut random = Random::new(seed);
        for _ in 0..4 {
            let changed = parts(&solve(&closed, &perturbed(case, &mut random, STEP), length));
            for ((size, x), y) in size.iter_mut().zip(&exact).zip(&changed) {
                for (x, y) in x.iter().zip(y) {
                    *size = size.max((*y - *x).hi.abs() / STEP);
                }
            }
        }
        let pairs: usize = case.model.bodies().iter().map(|b| b.modes() * b.modes()).sum();
        let steps = (case.model.len() + case.model.nv() + closed.gamma.len() + pairs) as f64;
        let unit = steps * scaled_condition(case);
        for part in 0..4 {
            let narrow = got[part].iter().map(|x| Dd::from_f64(*x));
            let error = |x: Dd, y: &Dd| (x - *y).hi.abs();
            let errors = [
                narrow.zip(&exact[part]).map(|(x, y)| error(x, y)).fold(0.0, f64::max) / f64::EPSILON,
                wide[part].iter().zip(&exact[part]).map(|(x, y)| error(*x, y)).fold(0.0, f64::max)
                    / Dd::EPSILON,
            ];
            for (worst, error) in worst.iter_mut().zip(errors) {
                let ratio = error / (unit * size[part]);
                assert!(
                    ratio <= FACTOR,
                    "PHIPSI_SEED={seed}, part {part}: {ratio} n·ε·κ; {:?}",
                    closed.closures
                );
                worst[part] = worst[part].max(ratio);
            }
        }
    }
    println!("accelerations, multipliers, force, generalised forces: {worst:?} n·ε·κ; seen {seen:?}");
    assert!(seeds.len() == 1 || seen.iter().all(|n| *n > 5), "{seen:?}");
}

/// A payload on the tip of a beam, hung up by a weld, moves as one on a fixed joint; velocities and positions are projected.
#[test]
fn a_weld_at_a_node_is_a_fixed_joint() {
    use phipsi_model::{Beam, Body, Inertia, Joint, JointKind, ModelBuilder, Section};
    let section = Section {
        mass_per_length: 1.0,
        bending_stiffness: [30.0, 20.0],
        torsional_stiffness: 10.0,
        polar_inertia: 0.01,
        axial_stiffness: 1e3,
    };
    let beam = Beam::new(1.0, section).bending([2, 1]).torsion(1).stiffened().build();
    let payload = Inertia::from_principal(0.5, [0.1, 0.02, 0.0], [0.01, 0.02, 0.03]);
    let start = |name: &str| {
        ModelBuilder::new(name)
            .body(Body::flexible("beam", beam.clone()))
            .body(Body::new("payload", payload))
            .joint(Joint::new("root", JointKind::Spherical), "world", "beam")
    };
    let tree = start("tree")
        .joint_at_node(Joint::new("mount", JointKind::Fixed), "beam", "tip", "payload")
        .build()
        .unwrap();
    let closed = start("closed")
        .body(Body::new("pin", Inertia::ZERO))
        .joint_at_node(Joint::new("end", JointKind::Fixed), "beam", "tip", "pin")
        .joint(Joint::new("float", JointKind::Free), "world", "payload")
        .closure(Closure {
            name: "weld".into(),
            kind: ClosureKind::Weld,
            body_a: "pin".into(),
            pose_a: Placement::IDENTITY,
            body_b: "payload".into(),
            pose_b: Placement::IDENTITY,
        })
        .build()
        .unwrap();
    let state = tree.random_state(3);
    let mut dynamics = ClosedDynamics::<f64>::new(&closed).unwrap();
    let (modes, joints) = (tree.modes(), closed.v_offset(closed.find_joint("float").unwrap()));
    let mut q = closed.neutral::<f64>();
    let eta: Vec<f64> = state.q[4..].iter().map(|x| 0.1 * x).collect();
    let beam_q = |model: &Model| model.q_offset(model.find_joint("root").unwrap());
    q[beam_q(&closed)..][..4].copy_from_slice(&state.q[..4]);
    q[closed.nq() - modes..].copy_from_slice(&eta);
    // The payload near its place.
    let layout = phipsi_recursion::Layout::<f64>::new(&tree);
    let mut kinematics = phipsi_recursion::Kinematics::new(&layout);
    kinematics.set_position(&layout, &[&state.q[..4], &eta].concat()).unwrap();
    let place = kinematics.pose(&layout, tree.find_body("payload").unwrap());
    let float = closed.q_offset(closed.find_joint("float").unwrap());
    for i in 0..3 {
        q[float + i] = place.translation.0[i] + 0.01;
    }
    q[float + 3..float + 7].copy_from_slice(&Quaternion::from_rotation(&place.rotation).0);
    let free = Conditions::default();
    let (held, mut v) = (q.clone(), vec![0.0; closed.nv()]);
    dynamics.assemble(&mut q, &free).unwrap();
    v[closed.nv() - modes..].copy_from_slice(&state.v[3..]);
    v[..3].copy_from_slice(&state.v[..3]);
    let projected = dynamics.project_velocity(&q, &mut v, &free).unwrap();
    assert!(projected.residual[1] < 1e-14 && projected.rank == 6, "{projected:?}");
    assert!(held != q);
    let mut a = vec![0.0; closed.nv()];
    let tau = vec![0.0; closed.nv()];
    let info = dynamics.run(&q, &v, &tau, &free, &mut a).unwrap().info();
    assert!(info.position_error < 1e-14 && info.velocity_error < 1e-14, "{info:?}");
    let on_tree = |x: &[f64], beam: usize| [&x[..beam], &x[x.len() - modes..]].concat();
    let (qt, vt) = (on_tree(&q, 4), on_tree(&v, 3));
    let want = phipsi_recursion::forward_dynamics(&layout, &qt, &vt, &vec![0.0; tree.nv()], None).unwrap();
    let got = on_tree(&a, 3);
    let largest = want.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    // n·ε·κ, κ that of the elimination.
    let n = tree.nv();
    let mass = phipsi_recursion::mass_matrix(&layout, &qt).unwrap();
    let inverse = phipsi_recursion::mass_matrix_inverse(&layout, &qt).unwrap();
    let kappa = (0..n).map(|i| mass[i * (n + 1)] * inverse[i * (n + 1)]).fold(1.0, f64::max);
    let budget =
        FACTOR * (closed.len() + closed.nv() + modes * modes) as f64 * f64::EPSILON * kappa * largest;
    for (got, want) in got.iter().zip(&want) {
        assert!((got - want).abs() < budget, "{got} {want}, {budget:e}");
    }
    assert_eq!(joints, 3);
    // A mode cannot be prescribed, and is named.
    let mut active = vec![false; closed.nv()];
    active[closed.nv() - modes] = true;
    let given = Prescribed { active: &active, acceleration: &tau };
    let prescribed = Conditions { prescribed: Some(given), ..Conditions::default() };
    let error = dynamics.run(&q, &v, &tau, &prescribed, &mut a).unwrap_err();
    assert_eq!(error, ClosureError::PrescribedMode { mode: "beam.mode1".into() });
}
