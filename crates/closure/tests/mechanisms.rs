//! Mechanisms with known answers: redundant closures, singular positions, many loops.

use phipsi_closure::{ClosedDynamics, ClosedInfo, ClosureError, ClosureMotion, Conditions, Prescribed};
use phipsi_model::{
    Body, Closure, ClosureKind, Coupling, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random,
};

const G: f64 = 9.81;

fn at(x: f64, y: f64, z: f64) -> Placement {
    Placement::from_xyz_rpy([x, y, z], [0.0; 3])
}

fn hinge(name: &str, axis: [f64; 3], place: Placement) -> Joint {
    Joint::new(name, JointKind::Revolute { axis }).at(place)
}

/// N four-bars in a row on the ground, rods of 1 m and 1 kg in the x-z plane: N + 1 cranks, and couplers from tip to tip, each
/// pinned by a whole hinge, of whose five rows three are implied.
pub(crate) fn four_bars(n: usize) -> Model {
    let along = |x: f64, z: f64| {
        let moments = [z / 12.0, 1.0 / 12.0, x / 12.0];
        Inertia::from_principal(1.0, [0.5 * x, 0.0, 0.5 * z], moments)
    };
    let y = [0.0, 1.0, 0.0];
    let mut builder = ModelBuilder::new("four-bars").gravity([0.0, 0.0, -G]);
    for i in 0..=n {
        let crank = format!("crank{i}");
        builder = builder.body(Body::new(crank.as_str(), along(0.0, 1.0))).joint(
            hinge(&format!("a{i}"), y, at(i as f64, 0.0, 0.0)),
            "world",
            crank.as_str(),
        );
        if i < n {
            let coupler = format!("coupler{i}");
            builder = builder.body(Body::new(coupler.as_str(), along(1.0, 0.0))).joint(
                hinge(&format!("b{i}"), y, at(0.0, 0.0, 1.0)),
                crank,
                coupler.as_str(),
            );
        }
    }
    // The frames' z axes along the hinge.
    let turned =
        |x: f64, z: f64| Placement::from_xyz_rpy([x, 0.0, z], [-std::f64::consts::FRAC_PI_2, 0.0, 0.0]);
    for i in 0..n {
        builder = builder.closure(Closure {
            name: format!("pin{i}"),
            kind: ClosureKind::Revolute,
            body_a: format!("coupler{i}"),
            pose_a: turned(1.0, 0.0),
            body_b: format!("crank{}", i + 1),
            pose_b: turned(0.0, 1.0),
        });
    }
    builder.build().unwrap()
}

/// Coordinates or rates with all cranks at an angle.
fn parallel(model: &Model, angle: f64) -> Vec<f64> {
    let sign = |i: usize| if model.joints()[i].name.starts_with('a') { 1.0 } else { -1.0 };
    (0..model.nv()).map(|i| sign(model.joint_of_velocity(i).0) * angle).collect()
}

fn crank(model: &Model, i: usize) -> usize {
    model.v_offset(model.find_joint(&format!("a{i}")).unwrap())
}

fn accelerations(dynamics: &mut ClosedDynamics<f64>, q: &[f64], v: &[f64], out: &mut [f64]) -> ClosedInfo {
    let tau = vec![0.0; v.len()];
    dynamics.run(q, v, &tau, &Conditions::default(), out).unwrap().info()
}

#[test]
fn four_bars_near_their_singular_pose() {
    for n in [1usize, 2, 5, 40] {
        let model = four_bars(n);
        let mut dynamics = ClosedDynamics::new(&model).unwrap();
        let mut a = vec![0.0; model.nv()];
        let count = n as f64;
        // All cranks together: I θ̈ = g C sin θ.
        let (inertia, moment) = ((count + 1.0) / 3.0 + count, (count + 1.0) / 2.0 + count);
        for delta in [1.0, 1e-2, 1e-4, 1e-6] {
            let theta = std::f64::consts::FRAC_PI_2 - delta;
            let info = accelerations(&mut dynamics, &parallel(&model, theta), &parallel(&model, 1.0), &mut a);
            assert_eq!(info.rank, 2 * n, "{info:?}");
            assert_eq!(info.inconsistency, None, "{info:?}");
            let want = G * moment / inertia * theta.sin();
            let error = (0..=n).map(|i| (a[crank(&model, i)] - want).abs() / want).fold(0.0, f64::max);
            println!("{n} four-bars, δ = {delta:e}: error {error:.1e}, ε/σ {:.1e}", info.error_estimate);
            // ε/σ per loop; every loop hands its error on to the next.
            assert!(error < 8.0 * count * info.error_estimate, "{n}, {delta:e}: {error:e}, {info:?}");
        }
    }
}

/// Exactly in the singular pose one row of every loop is gone, and Gauss' principle holds for what is left.
#[test]
fn the_singular_pose_itself() {
    let model = four_bars(2);
    let mut dynamics = ClosedDynamics::new(&model).unwrap();
    let mut a = vec![0.0; model.nv()];
    let (q, v) = (parallel(&model, std::f64::consts::FRAC_PI_2), parallel(&model, 1.0));
    let info = accelerations(&mut dynamics, &q, &v, &mut a);
    assert_eq!(info.rank, 2, "{info:?}");
    for (i, want) in [12.03954545, 10.70181818, 12.03954545].into_iter().enumerate() {
        let got = a[crank(&model, i)];
        assert!((got - want).abs() < 1e-8, "crank {i}: {got}");
    }
}

/// One step of Runge's and Kutta's method, then both projections.
fn step(
    dynamics: &mut ClosedDynamics<f64>,
    model: &Model,
    q: &mut Vec<f64>,
    v: &mut Vec<f64>,
    h: f64,
) -> f64 {
    let n = model.nv();
    let add =
        |x: &[f64], s: f64, y: &[f64]| -> Vec<f64> { x.iter().zip(y).map(|(x, y)| x + s * y).collect() };
    let mut k: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
    for (i, fraction) in [0.0, 0.5, 0.5, 1.0].into_iter().enumerate() {
        let (dq, dv) = if i == 0 { (vec![0.0; n], vec![0.0; n]) } else { k[i - 1].clone() };
        let (qi, vi) = (add(q, fraction * h, &dq), add(v, fraction * h, &dv));
        let mut a = vec![0.0; n];
        accelerations(dynamics, &qi, &vi, &mut a);
        k.push((vi, a));
    }
    for (weight, (dq, dv)) in [1.0, 2.0, 2.0, 1.0].into_iter().zip(&k) {
        *q = add(q, weight * h / 6.0, dq);
        *v = add(v, weight * h / 6.0, dv);
    }
    let moved = dynamics.project_position(q, &Conditions::default()).unwrap();
    let turned = dynamics.project_velocity(q, v, &Conditions::default()).unwrap();
    moved.residual[1].max(turned.residual[1])
}

#[test]
fn motion_goes_on_through_the_singular_pose() {
    let model = four_bars(2);
    let mut dynamics = ClosedDynamics::new(&model).unwrap();
    let (mut q, mut v) = (parallel(&model, 0.0), parallel(&model, 1.0));
    let h = 2e-3;
    let mut open = 0.0f64;
    for _ in 0..500 {
        open = open.max(step(&mut dynamics, &model, &mut q, &mut v, h));
    }
    // Closed form of the benchmark at t = 1, past the singular pose at t = 0.714.
    let (theta, rate) = (3.337_870_803_105_097_7, 6.807_385_240_869_445);
    let error = (q[crank(&model, 0)] - theta).abs();
    println!("angle {error:.1e}, rate {:.1e}, open by {open:.1e}", (v[crank(&model, 0)] - rate).abs());
    // h⁴ times the derivatives of the motion, some 1e3 over one second.
    assert!(error < 1e-8, "{error:e}");
    assert!(open < 1e-14, "{open:e}");
}

/// Bricard's mechanism: six hinges, each at a right angle to the next; five rows close it, one of them always implied.
fn bricard() -> Model {
    let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let directions = [x, [0.0, -1.0, 0.0], z, [-1.0, 0.0, 0.0], y];
    let axes = [y, z, x, y, z];
    let mut builder = ModelBuilder::new("bricard").gravity([0.0, -G, 0.0]);
    let mut parent = "world".to_string();
    let mut place = at(0.0, 0.0, 0.0);
    for (i, (axis, d)) in axes.into_iter().zip(directions).enumerate() {
        // A square section of 0.1 m.
        let (along, across) = (0.01 / 6.0, (1.0 + 0.01) / 12.0);
        let moments = d.map(|c: f64| if c != 0.0 { along } else { across });
        let name = format!("rod{i}");
        builder = builder
            .body(Body::new(name.as_str(), Inertia::from_principal(1.0, d.map(|c| 0.5 * c), moments)))
            .joint(hinge(&format!("q{}", i + 1), axis, place), parent, name.as_str());
        (parent, place) = (name, at(d[0], d[1], d[2]));
    }
    // The sixth hinge along x at (0, 0, 1).
    let along_x = |xyz: [f64; 3]| Placement::from_xyz_rpy(xyz, [0.0, std::f64::consts::FRAC_PI_2, 0.0]);
    let closure = Closure {
        name: "sixth".into(),
        kind: ClosureKind::Revolute,
        body_a: "world".into(),
        pose_a: along_x([0.0, 0.0, 1.0]),
        body_b: parent,
        pose_b: along_x([0.0, 1.0, 0.0]),
    };
    builder.closure(closure).build().unwrap()
}

#[test]
fn bricard_keeps_its_motion_off_the_closure() {
    let model = bricard();
    let mut dynamics = ClosedDynamics::new(&model).unwrap();
    let (a, b) = (0.252_528_840_525_052_37, -0.201_262_145_609_307_2);
    let closed = [a, b, a, b, a];
    let rest = [0.0; 5];
    let mut want = [0.0; 5];
    let info = accelerations(&mut dynamics, &closed, &rest, &mut want);
    assert_eq!(info.rank, 4, "{info:?}");
    assert!(want[0].abs() > 0.1, "{want:?}");
    let mut random = Random::new(5);
    for noise in [0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4] {
        let q = closed.map(|q| q + noise * random.signed());
        let mut got = [0.0; 5];
        let info = accelerations(&mut dynamics, &q, &rest, &mut got);
        assert_eq!(info.rank, 4, "noise {noise:e}: {info:?}");
        let error = (0..5).map(|i| (got[i] - want[i]).abs()).fold(0.0, f64::max);
        // The accelerations themselves change with q, at some 30 rad/s² per rad.
        assert!(error < 1e-13 + 100.0 * noise, "noise {noise:e}: {error:e}");
    }
    let mut q = closed.map(|q| q + 1e-2 * random.signed());
    let projected = dynamics.project_position(&mut q, &Conditions::default()).unwrap();
    assert!(projected.residual[1] < 1e-14, "{projected:?}");
}

/// A planar ladder: four-bars one upon the other.
fn ladder(n: usize) -> Model {
    let z = [0.0, 0.0, 1.0];
    let rod = |x: f64| Inertia::from_principal(1.0, [0.5 * x, 0.0, 0.0], [0.0, 0.1, 0.1]);
    let mut builder = ModelBuilder::new("ladder").gravity([0.0, -G, 0.0]);
    let mut base = "world".to_string();
    for i in 0..n {
        let [left, right, rung] = ["left", "right", "rung"].map(|name| format!("{name}{i}"));
        builder = builder
            .body(Body::new(left.as_str(), rod(1.0)))
            .body(Body::new(right.as_str(), rod(1.0)))
            .body(Body::new(rung.as_str(), rod(1.0)))
            .joint(hinge(&format!("a{i}"), z, at(0.0, 0.0, 0.0)), base.as_str(), left.as_str())
            .joint(hinge(&format!("c{i}"), z, at(1.0, 0.0, 0.0)), base.as_str(), right.as_str())
            .joint(hinge(&format!("b{i}"), z, at(1.0, 0.0, 0.0)), left.as_str(), rung.as_str());
        builder = builder.closure(Closure {
            name: format!("pin{i}"),
            kind: ClosureKind::Spherical,
            body_a: rung.clone(),
            pose_a: at(1.0, 0.0, 0.0),
            body_b: right,
            pose_b: at(1.0, 0.0, 0.0),
        });
        base = rung;
    }
    builder.build().unwrap()
}

#[test]
fn a_ladder_of_a_thousand_loops() {
    let mut sizes = Vec::new();
    for n in [10usize, 100, 1000] {
        let model = ladder(n);
        let mut dynamics = ClosedDynamics::new(&model).unwrap();
        let mut q = vec![0.0; model.nq()];
        let mut v = vec![0.0; model.nv()];
        for i in 0..n {
            // Every four-bar a parallelogram, leaning a little more or less.
            let lean = 1.2 + 0.1 * (i as f64).sin();
            for (name, sign) in [("a", 1.0), ("c", 1.0), ("b", -1.0)] {
                let k = model.find_joint(&format!("{name}{i}")).unwrap();
                (q[model.q_offset(k)], v[model.v_offset(k)]) = (sign * lean, 0.1 * sign * lean);
            }
        }
        let mut a = vec![0.0; model.nv()];
        let info = accelerations(&mut dynamics, &q, &v, &mut a);
        assert_eq!((info.rank, info.rows), (2 * n, 3 * n), "{info:?}");
        let start = std::time::Instant::now();
        let runs = 2000 / n;
        for _ in 0..runs {
            accelerations(&mut dynamics, &q, &v, &mut a);
        }
        let each = start.elapsed().as_secs_f64() / (runs * n) as f64;
        println!("{n} loops: {:.2} µs a loop, Σ m² {}", 1e6 * each, dynamics.nesting());
        for i in 0..n {
            let of = |name: &str| a[model.v_offset(model.find_joint(&format!("{name}{i}")).unwrap())];
            // A parallelogram stays one.
            let size = of("a").abs().max(1.0);
            assert!((of("a") - of("c")).abs() < 1e-9 * size && (of("a") + of("b")).abs() < 1e-9 * size);
        }
        // Fourteen of every loop's: 3 rows at each of its three joints, none at the rungs' joints of the loops above.
        sizes.push(dynamics.nesting() / n);
    }
    assert!(sizes.windows(2).all(|w| w[0] == w[1]), "{sizes:?}");
}

#[test]
fn a_ball_out_of_reach_is_not_closed() {
    let model = bricard();
    let far = Closure {
        name: "far".into(),
        kind: ClosureKind::Spherical,
        body_a: "world".into(),
        pose_a: at(50.0, 0.0, 0.0),
        body_b: "rod4".into(),
        pose_b: at(0.0, 1.0, 0.0),
    };
    let model = model.without_closures().with_closure(far).unwrap();
    let mut dynamics = ClosedDynamics::new(&model).unwrap();
    let mut q = [0.1, 0.2, 0.3, 0.4, 0.5];
    for result in [
        dynamics.project_position(&mut q.clone(), &Conditions::default()),
        dynamics.assemble(&mut q, &Conditions::default()),
    ] {
        match result {
            Err(ClosureError::NotClosed { closure, residual, .. }) => {
                assert_eq!(closure, "far");
                assert!(residual > 40.0, "{residual}");
            }
            other => panic!("{other:?}"),
        }
    }
}

/// Two wheels of which the small one turns three times as fast, the other way.
fn gear() -> Model {
    let wheel = |inertia: f64| Inertia::from_principal(1.0, [0.0; 3], [0.1, 0.1, inertia]);
    let z = [0.0, 0.0, 1.0];
    let gear = Coupling { joint: "b".into(), source: "a".into(), multiplier: -3.0, offset: 0.25 };
    ModelBuilder::new("gear")
        .body(Body::new("large", wheel(2.0)))
        .body(Body::new("small", wheel(0.5)))
        .joint(hinge("a", z, at(0.0, 0.0, 0.0)), "world", "large")
        .joint(hinge("b", z, at(1.0, 0.0, 0.0)), "world", "small")
        .coupling(gear)
        .build()
        .unwrap()
}

#[test]
fn a_gear_turns_two_wheels_as_one() {
    let mut dynamics = ClosedDynamics::<f64>::new(&gear()).unwrap();
    let (mut a, mut lambda, mut q) = ([0.0; 2], [0.0; 1], [0.1, -0.05]);
    let mut solved = dynamics.run(&q, &[1.0, -3.0], &[1.0, 0.5], &Conditions::default(), &mut a).unwrap();
    solved.closure_forces(&mut lambda).unwrap();
    // (2 + 9 · 0.5) θ̈ = 1 − 3 · 0.5.
    let want = -0.5 / 6.5;
    assert!((a[0] - want).abs() < 1e-15 && (a[1] + 3.0 * want).abs() < 1e-15, "{a:?}");
    // 0.5 θ̈_b = 0.5 + λ.
    assert!((lambda[0] - (-1.5 * want - 0.5)).abs() < 1e-15, "{lambda:?}");
    q[1] = 0.7;
    dynamics.assemble(&mut q, &Conditions::default()).unwrap();
    assert!((q[1] + 3.0 * q[0] - 0.25).abs() < 1e-14, "{q:?}");
}

/// A moving closure: the gear's row follows γ, γ̇ and γ̈.
#[test]
fn a_gear_is_driven() {
    let mut dynamics = ClosedDynamics::<f64>::new(&gear()).unwrap();
    let motion = ClosureMotion { position: &[0.1], velocity: &[0.2], acceleration: &[0.3] };
    let conditions = Conditions { motion: Some(motion), ..Conditions::default() };
    let (mut q, mut v, mut a) = ([0.0; 2], [1.0, 1.0], [0.0; 2]);
    dynamics.project_position(&mut q, &conditions).unwrap();
    assert!((q[1] + 3.0 * q[0] - 0.25 - 0.1).abs() < 1e-15, "{q:?}");
    let done = dynamics.project_velocity(&q, &mut v, &conditions).unwrap();
    // The row was off by 3.8, rounded a few times.
    let unit = 8.0 * 3.8 * f64::EPSILON;
    assert!((v[1] + 3.0 * v[0] - 0.2).abs() < unit, "{v:?}");
    // Least kinetic energy: 2 δ_a : 0.5 δ_b as −3 : −1 of the row, which was off by 3.8.
    let lambda = 3.8 / (9.0 / 2.0 + 1.0 / 0.5);
    assert!((v[0] - (1.0 - 1.5 * lambda)).abs() < unit, "{v:?}");
    assert!((done.energy_removed - 0.5 * 3.8 * lambda).abs() < 1e-14, "{done:?}");
    dynamics.run(&q, &v, &[0.0; 2], &conditions, &mut a).unwrap();
    assert!((a[1] + 3.0 * a[0] - 0.3).abs() < unit, "{a:?}");
}

/// Prescribed motions that the gear does not allow are told, those that it allows are not.
#[test]
fn contradictions_are_told() {
    let mut dynamics = ClosedDynamics::<f64>::new(&gear()).unwrap();
    for (acceleration, contradicts) in [([1.0, -3.0], false), ([1.0, 1.0], true)] {
        let prescribed = Prescribed { active: &[true, true], acceleration: &acceleration };
        let conditions = Conditions { prescribed: Some(prescribed), ..Conditions::default() };
        let (q, v) = ([0.1, -0.05], [1.0, -3.0]);
        let mut a = [0.0; 2];
        let info = dynamics.run(&q, &v, &[0.0; 2], &conditions, &mut a).unwrap().info();
        assert_eq!((a, info.rank), (acceleration, 0));
        assert_eq!(info.inconsistency.is_some(), contradicts, "{info:?}");
    }
}

/// The sweeps of trees refuse what they would not close.
#[test]
fn trees_refuse_loops() {
    let model = four_bars(1);
    let layout = phipsi_recursion::Layout::<f64>::new(&model);
    let zero = vec![0.0; model.nv()];
    let error = phipsi_recursion::forward_dynamics(&layout, &zero, &zero, &zero, None).unwrap_err();
    assert!(error.to_string().contains("closure `pin0` closes a loop"), "{error}");
}

/// After thousands of turns an angle has fewer digits after the point; a projection does as well as it can there.
#[test]
fn cranks_that_have_turned_often_are_projected() {
    let model = four_bars(1);
    let mut dynamics = ClosedDynamics::new(&model).unwrap();
    let mut random = Random::new(7);
    for turns in [0.0, 10.0, 1e3, 1e5] {
        let mut q = parallel(&model, 1.0 + std::f64::consts::TAU * turns);
        q.iter_mut().for_each(|q| *q += 1e-5 * random.signed());
        let done = dynamics.project_position(&mut q, &Conditions::default()).unwrap();
        // Three angles, each rounded to ε of itself, on rods of 1 m.
        let rounding = 8.0 * f64::EPSILON * (1.0 + std::f64::consts::TAU * turns);
        assert!(done.residual[1] < rounding && done.iterations < 6, "{turns} turns: {done:?}");
    }
}
