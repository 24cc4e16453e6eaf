//! Two-sided dynamics against the one-sided recursions and the dense equations, and against itself from another base.

use nalgebra::DMatrix;
use phipsi_freeflight::{FreeFlightError, TwoSided};
use phipsi_model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random};
use phipsi_recursion::{Layout, body_pose, body_velocity};
use phipsi_reference::generate::{Case, Limits, case_within};
use phipsi_reference::sensitivity::widened;
use phipsi_spatial::{Dd, Quaternion, Real, Scalar, Transform, Vec3};

fn wide(x: f64) -> Dd {
    Dd::from_f64(x)
}

/// `PHIPSI_SEED`, or the first `count` seeds whose trees float.
fn floating(count: usize, freedoms: usize) -> Vec<(u64, Case)> {
    let case = |seed: u64| case_within(seed, Limits { degrees_of_freedom: freedoms, decades: 0.5 });
    if let Ok(seed) = std::env::var("PHIPSI_SEED") {
        let seed = seed.parse().expect("PHIPSI_SEED is a whole number");
        return vec![(seed, case(seed))];
    }
    let all = (0..).map(|seed| (seed, case(seed)));
    all.filter(|(_, case)| TwoSided::new(&Layout::<f64>::new(&case.model)).is_ok()).take(count).collect()
}

/// What a result may lose of its digits: the condition of M scaled to a unit diagonal, and what pivots lose.
fn lost(case: &Case) -> f64 {
    let q = widened(&case.q);
    let m = phipsi_reference::mass_matrix(&case.model, &q);
    let inverse = phipsi_reference::mass_matrix_inverse(&case.model, &q).unwrap();
    (0..case.model.nv()).map(|i| (m[(i, i)] * inverse[(i, i)]).hi).fold(1.0, f64::max)
}

fn pattern(seed: u64, layout: &Layout<Dd>) -> Vec<bool> {
    let mut random = Random::new(seed);
    let mut active: Vec<bool> = (0..layout.nv()).map(|_| random.uniform() < 0.4).collect();
    for body in layout.bodies().iter().filter(|b| b.parent == phipsi_recursion::layout::GROUND) {
        active[body.v..body.v + 6].fill(false);
    }
    active
}

fn assert_near(what: &str, seed: u64, got: &[Dd], want: &[Dd], allowed: f64) {
    let size = want.iter().fold(1.0f64, |m, x| m.max(x.abs().hi));
    for (i, (x, y)) in got.iter().zip(want).enumerate() {
        let error = (*x - *y).abs().hi;
        assert!(error <= allowed * size, "{what}[{i}], PHIPSI_SEED={seed}: error {error:e} of {size:e}");
    }
    assert_eq!(got.len(), want.len());
}

/// Both limits and mixed patterns, under wrenches, against the dense partitioned equations in double-double numbers.
#[test]
fn every_body_by_itself_agrees_with_the_dense_equations() {
    for (seed, case) in floating(150, 14) {
        let layout = Layout::<Dd>::new(&case.model);
        let (q, v, a, tau) = (widened(&case.q), widened(&case.v), widened(&case.a), widened(&case.tau));
        let wrenches: Vec<_> = case.wrenches.iter().map(|w| w.map(Dd::from_f64)).collect();
        let mut work = TwoSided::new(&layout).unwrap();
        let nv = case.model.nv();
        let mixed = pattern(seed, &layout);
        let mut driven = vec![true; nv];
        for body in layout.bodies().iter().filter(|b| b.parent == phipsi_recursion::layout::GROUND) {
            driven[body.v..body.v + 6].fill(false);
        }
        let allowed = 1e2 * Dd::EPSILON * nv as f64 * lost(&case);
        for active in [vec![false; nv], mixed, driven] {
            let (mut got_a, mut got_tau) = (a.clone(), tau.clone());
            work.run(&layout, &q, &v, &active, &mut got_a, &mut got_tau, Some(&wrenches)).unwrap();
            let (want_a, want_tau) =
                phipsi_reference::hybrid_dynamics(&case.model, &q, &v, &active, &a, &tau, Some(&wrenches))
                    .unwrap();
            assert_near("accelerations", seed, &got_a, &want_a, allowed);
            assert_near("forces", seed, &got_tau, &want_tau, allowed);
        }
    }
}

/// In f64 the two-sided result keeps n·ε and what the condition takes.
#[test]
fn rounding_is_that_of_the_condition() {
    let mut worst = 0.0f64;
    for (seed, case) in floating(150, 20) {
        let layout = Layout::<f64>::new(&case.model);
        let nv = case.model.nv();
        let (mut a, mut tau) = (vec![0.0; nv], case.tau.clone());
        let mut work = TwoSided::new(&layout).unwrap();
        work.run(&layout, &case.q, &case.v, &vec![false; nv], &mut a, &mut tau, None).unwrap();
        let (q, v) = (widened(&case.q), widened(&case.v));
        let want =
            phipsi_reference::forward_dynamics(&case.model, &q, &v, &widened(&case.tau), None).unwrap();
        let size = want.iter().fold(1.0f64, |m, x| m.max(x.abs().hi));
        let error = a.iter().zip(&want).map(|(x, y)| (wide(*x) - *y).abs().hi).fold(0.0, f64::max);
        // The condition once for what the pivots of both sequences lose, once for the 6 × 6 systems; with one of them seeds reach 40.
        let units = error / (nv as f64 * f64::EPSILON * size * lost(&case).powi(2));
        assert!(units <= 4.0, "PHIPSI_SEED={seed}: {units} n·ε·κ²");
        worst = worst.max(units);
    }
    println!("two-sided forward dynamics: at most {worst:.2} n·ε·κ²");
}

/// P + S⁺ of every body is (J M⁻¹ J*)⁻¹, J the body's Jacobian in its own axes.
#[test]
fn inertias_of_all_bodies_from_one_pass() {
    for (seed, case) in floating(100, 12) {
        let layout = Layout::<Dd>::new(&case.model);
        let q = widened(&case.q);
        let mut work = TwoSided::new(&layout).unwrap();
        work.set_position(&layout, &q).unwrap();
        let inverse = phipsi_reference::mass_matrix_inverse(&case.model, &q).unwrap();
        let zero = vec![wide(0.0); case.model.nv()];
        let motions = phipsi_reference::kinematics(&case.model, &q, &zero, &zero);
        for body in 0..case.model.len() {
            let jacobian = phipsi_reference::jacobian(&case.model, &q, Some(body), None);
            let r = motions[body].pose.rotation;
            let own = DMatrix::from_fn(6, case.model.nv(), |i, j| {
                let at = 3 * (i / 3);
                let column = Vec3([jacobian[(at, j)], jacobian[(at + 1, j)], jacobian[(at + 2, j)]]);
                r.transpose_mul(column).0[i - at]
            });
            let felt = work.inertia(&layout, body).unwrap();
            let mobility = &own * &inverse * own.transpose();
            let inertia = DMatrix::from_fn(6, 6, |i, j| felt.to_rows()[i][j]);
            let product = &inertia * &mobility;
            let size = |m: &DMatrix<Dd>| m.iter().fold(0.0f64, |s, x| s.max(x.abs().hi));
            let allowed = 1e2 * Dd::EPSILON * lost(&case) * size(&inertia) * size(&mobility);
            let error = size(&(product - DMatrix::identity(6, 6)));
            assert!(error <= allowed, "body {body}, PHIPSI_SEED={seed}: {error:e}, allowed {allowed:e}");
        }
    }
}

/// A tree of bodies without a base: joints between frames fixed in two bodies.
struct Graph {
    inertias: Vec<Inertia>,
    /// Body, frame in it, body, frame in it, axis, true for a hinge.
    joints: Vec<(usize, Placement, usize, Placement, [f64; 3], bool)>,
}

fn random_graph(seed: u64) -> Graph {
    let mut random = Random::new(seed);
    let n = 3 + random.below(8);
    let frame =
        |random: &mut Random| Placement { translation: random.vector(), rotation: random.quaternion() };
    let inertias = (0..n)
        .map(|_| {
            let size = random.vector().map(|x| 0.1 + x * x);
            let moments = [size[1] + size[2], size[2] + size[0], size[0] + size[1]];
            Inertia::from_principal(0.3 + random.uniform(), random.vector(), moments)
        })
        .collect();
    let joints = (1..n)
        .map(|k| {
            let parent = if random.uniform() < 0.5 { k - 1 } else { random.below(k) };
            let axis = random.vector().map(|x| x + 0.1);
            (parent, frame(&mut random), k, frame(&mut random), axis, random.uniform() < 0.7)
        })
        .collect();
    Graph { inertias, joints }
}

/// The mechanism with a base: a model, the joints in its order with their signs, and each body's frame in its own.
type Rooted = (Model, Vec<(usize, f64)>, Vec<Transform<f64>>);

/// A rooting with the frames of its bodies and its state.
type Known = (Model, Vec<Transform<f64>>, Vec<f64>, Vec<f64>);

/// Body r is the base. Each body's frame in the model is that of its joint to the base.
fn rooted(graph: &Graph, r: usize) -> Rooted {
    let n = graph.inertias.len();
    let mut frames: Vec<Option<Transform<f64>>> = vec![None; n];
    frames[r] = Some(Transform::identity());
    let placed =
        |frame: &Transform<f64>, inner: Transform<f64>| placement_of(&frame.inverse().compose(&inner));
    let body = |k: usize, frame: &Transform<f64>| {
        let inertia = graph.inertias[k];
        Body::new(format!("b{k}"), Inertia { frame: placed(frame, inertia.frame.to_transform()), ..inertia })
    };
    let mut builder = ModelBuilder::new("graph").base(Base::Free).gravity([0.4, -0.3, -9.0]);
    builder = builder.body(body(r, &Transform::identity()));
    let (mut order, mut left): (Vec<(usize, f64)>, Vec<usize>) = (vec![], (0..graph.joints.len()).collect());
    while !left.is_empty() {
        let (at, forward) = left
            .iter()
            .enumerate()
            .find_map(|(at, &j)| {
                let (a, _, b, _, _, _) = graph.joints[j];
                match (&frames[a], &frames[b]) {
                    (Some(_), None) => Some((at, true)),
                    (None, Some(_)) => Some((at, false)),
                    _ => None,
                }
            })
            .expect("a graph in one piece");
        let j = left.remove(at);
        let (a, in_a, b, in_b, axis, hinge) = graph.joints[j];
        let (parent, in_parent, child, in_child) =
            if forward { (a, in_a, b, in_b) } else { (b, in_b, a, in_a) };
        let kind = if hinge { JointKind::Revolute { axis } } else { JointKind::Prismatic { axis } };
        let frame = in_child.to_transform();
        let joint = Joint::new(format!("j{j}"), kind)
            .at(placed(&frames[parent].expect("reached"), in_parent.to_transform()));
        builder = builder.body(body(child, &frame)).joint(joint, format!("b{parent}"), format!("b{child}"));
        frames[child] = Some(frame);
        order.push((j, if forward { 1.0 } else { -1.0 }));
    }
    let model = builder.build().unwrap();
    let joints = (1..model.len())
        .map(|k| {
            let name = &model.joints()[k].name;
            *order.iter().find(|(j, _)| format!("j{j}") == *name).expect("a joint of the graph")
        })
        .collect();
    (model, joints, frames.into_iter().map(|f| f.expect("reached")).collect())
}

fn placement_of(x: &Transform<f64>) -> Placement {
    let rotation = Quaternion::from_rotation(&x.rotation).0;
    Placement { translation: x.translation.0, rotation }
}

/// Joint accelerations of the same mechanism for every choice of the base.
#[test]
fn the_choice_of_the_base_does_not_matter() {
    let mut worst = 0.0f64;
    for seed in 0..60 {
        let graph = random_graph(seed);
        let n = graph.inertias.len();
        let mut random = Random::new(seed + 1000);
        let mut numbers = |count: usize| (0..count).map(|_| random.signed()).collect::<Vec<f64>>();
        let (joint_q, joint_v, joint_tau) = (numbers(n - 1), numbers(n - 1), numbers(n - 1));
        let (mut base_q, base_v) = (numbers(7), numbers(6));
        base_q[6] += 2.0;
        let mut first: Option<Vec<f64>> = None;
        let mut world: Option<Known> = None;
        for r in 0..n {
            let (model, joints, frames) = rooted(&graph, r);
            let layout = Layout::<f64>::new(&model);
            let (mut q, mut v) = (base_q.clone(), base_v.clone());
            if let Some((model, frames, q0, v0)) = &world {
                // Where the first rooting has this body, in the frame that the new base has.
                let known = Layout::<f64>::new(model);
                let k = model.find_body(&format!("b{r}")).unwrap();
                let pose = body_pose(&known, q0, k).unwrap();
                let own = pose.compose(&frames[r].inverse());
                let velocity = body_velocity(&known, q0, v0, k).unwrap();
                let linear = velocity.linear + velocity.angular.cross(own.translation - pose.translation);
                let placed = placement_of(&own);
                q = [placed.translation.to_vec(), placed.rotation.to_vec()].concat();
                let here = |x: Vec3<f64>| own.rotation.transpose_mul(x).0.to_vec();
                v = [here(velocity.angular), here(linear)].concat();
            }
            let mut tau = vec![0.0; 6];
            for &(j, sign) in &joints {
                q.push(sign * joint_q[j]);
                v.push(sign * joint_v[j]);
                tau.push(sign * joint_tau[j]);
            }
            let mut a = vec![0.0; n + 5];
            let mut work = TwoSided::new(&layout).unwrap();
            work.run(&layout, &q, &v, &vec![false; n + 5], &mut a, &mut tau, None).unwrap();
            let mut by_joint = vec![0.0; n - 1];
            joints.iter().zip(&a[6..]).for_each(|(&(j, sign), x)| by_joint[j] = sign * x);
            let want = first.get_or_insert_with(|| by_joint.clone());
            let size = want.iter().fold(1.0f64, |m, x| m.max(x.abs()));
            let error = want.iter().zip(&by_joint).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
            // Poses of the new base round too; the largest seen is 6.
            let units = error / (size * n as f64 * f64::EPSILON);
            assert!(units < 100.0, "seed {seed}, base {r}: {error:e} of {size:e}, {units} n·ε");
            worst = worst.max(units);
            world.get_or_insert((model, frames, q, v));
        }
    }
    println!("accelerations for every base: within {worst:.0} n·ε of the first");
}

/// A body in one sequence of ten thousand: the same numbers with and without threads.
#[test]
fn a_long_chain_agrees_with_the_filter_and_smoother() {
    let n = 6000;
    let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.01, 0.09, 0.09]);
    let mut builder = ModelBuilder::new("chain").base(Base::Free).body(Body::new("b0", rod));
    for k in 1..n {
        let axis = if k % 2 == 0 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        let at = Placement { translation: [1.0, 0.0, 0.0], ..Placement::IDENTITY };
        let joint = Joint::new(format!("j{k}"), JointKind::Revolute { axis }).at(at);
        builder = builder.body(Body::new(format!("b{k}"), rod)).joint(
            joint,
            format!("b{}", k - 1),
            format!("b{k}"),
        );
    }
    let model = builder.build().unwrap();
    let layout = Layout::<f64>::new(&model);
    let state = model.random_state(5);
    let nv = model.nv();
    let tau: Vec<f64> = (0..nv).map(|i| (i as f64).sin()).collect();
    let want = phipsi_recursion::forward_dynamics(&layout, &state.q, &state.v, &tau, None).unwrap();
    let (mut a, mut forces) = (vec![0.0; nv], tau);
    let mut work = TwoSided::new(&layout).unwrap();
    work.run(&layout, &state.q, &state.v, &vec![false; nv], &mut a, &mut forces, None).unwrap();
    let size = want.iter().fold(1.0f64, |m, x| m.max(x.abs()));
    let error = a.iter().zip(&want).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    assert!(error <= 10.0 * n as f64 * f64::EPSILON * size, "{error:e} of {size:e}");
}

#[test]
fn mistakes_are_named() {
    let fixed = ModelBuilder::new("arm")
        .body(Body::new("link", Inertia::from_principal(1.0, [0.1; 3], [0.1; 3])))
        .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 0.0, 1.0] }), "world", "link")
        .build()
        .unwrap();
    let error = TwoSided::new(&Layout::<f64>::new(&fixed)).unwrap_err();
    assert_eq!(error, FreeFlightError::NotFree { joint: "hinge".into() });
    let free = ModelBuilder::new("stone")
        .base(Base::Free)
        .body(Body::new("stone", Inertia::from_principal(1.0, [0.1; 3], [0.1; 3])))
        .build()
        .unwrap();
    let layout = Layout::<f64>::new(&free);
    let mut work = TwoSided::new(&layout).unwrap();
    let q = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut run = |active: [bool; 6], q: &[f64]| {
        work.run(&layout, q, &[0.0; 6], &active, &mut [0.0; 6], &mut [0.0; 6], None)
    };
    let active = run([false, false, true, false, false, false], &q).unwrap_err();
    assert_eq!(active, FreeFlightError::ActiveBase { joint: "stone".into(), component: 2 });
    assert!(run([false; 6], &[]).unwrap_err().to_string().contains("`q`"));
    assert_eq!(run([false; 6], &q), Ok(()));
}
