//! The midpoint method in (q, p): order, reversibility, the symplectic form, momentum, energy over long runs.

use crate::common::{double_pendulum, free_body, pendulum};
use allocation_counter::measure;
use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random};
use phipsi_motion::forces::{JointSpring, PointSpring};
use phipsi_motion::midpoint_momentum::MomentumSweep;
use phipsi_motion::{Conservative, Dynamics, Force, Integrator, Method, Midpoint, MidpointError, Tolerances};
use phipsi_recursion::{
    About, Layout, body_pose, inverse_dynamics, kinetic_energy, momentum, multiply_by_mass_matrix,
};
use phipsi_reference::generate::case;
use phipsi_spatial::{Dd, Motion, Real, Scalar, Vec3};

/// A free base with a hinge, a ball joint, a slider, a plane joint and a free body, tied by springs between points.
fn tree(base: JointKind, gravity: [f64; 3]) -> (Model, Vec<Box<dyn Force>>) {
    let mut random = Random::new(5);
    let mut body = |name: &str, mass: f64| {
        let mut inertia = Inertia::from_principal(mass, random.vector().map(|x| 0.3 * x), [0.11, 0.17, 0.21]);
        inertia.frame.rotation = random.quaternion();
        Body::new(name, inertia)
    };
    let mut builder = ModelBuilder::new("tree").gravity(gravity);
    for (name, mass) in [("a", 1.0), ("b", 0.7), ("c", 0.4), ("d", 0.5), ("e", 0.3), ("f", 0.6)] {
        builder = builder.body(body(name, mass));
    }
    let joints = [
        ("base", base, "world", "a"),
        ("hinge", JointKind::Revolute { axis: [0.3, -0.5, 0.8] }, "a", "b"),
        ("ball", JointKind::Spherical, "b", "c"),
        ("slider", JointKind::Prismatic { axis: [0.1, 1.0, 0.2] }, "a", "d"),
        ("plane", JointKind::Planar { normal: [1.0, 0.4, -0.3] }, "d", "e"),
        ("loose", JointKind::Free, "b", "f"),
    ];
    for (name, kind, parent, child) in joints {
        let placement =
            Placement { translation: random.vector().map(|x| 0.6 * x), rotation: random.quaternion() };
        builder = builder.joint(Joint::new(name, kind).at(placement), parent, child);
    }
    let model = builder.build().unwrap();
    let pairs = [("a", "c"), ("b", "d"), ("d", "e"), ("c", "f"), ("e", "f"), ("a", "f"), ("b", "f")];
    let mut forces: Vec<Box<dyn Force>> = Vec::new();
    for (a, b) in pairs {
        forces.push(Box::new(PointSpring {
            name: format!("{a}-{b}"),
            bodies: [model.find_body(a).unwrap(), model.find_body(b).unwrap()],
            points: [Vec3(random.vector()), Vec3(random.vector())],
            stiffness: 3.0,
            damping: 0.0,
            rest_length: 0.5,
        }));
    }
    (model, forces)
}

fn free_tree() -> (Model, Dynamics) {
    let (model, forces) = tree(JointKind::Free, [0.0; 3]);
    let system = Dynamics::new(&model, forces).unwrap();
    (model, system)
}

fn run<C: Conservative>(method: &mut Midpoint, system: &mut C, h: f64, steps: u32)
where
    C::Error: std::fmt::Debug,
{
    for _ in 0..steps {
        method.step(system, h).unwrap();
    }
}

fn start(model: &Model, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let state = model.random_state(seed);
    (state.q, state.v)
}

/// Largest component of the increment from q0 to q1 and of p1 − p0 relative to the largest p.
fn distance(model: &Model, a: (&[f64], &[f64]), b: (&[f64], &[f64])) -> f64 {
    let largest = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0f64, |m, x| m.max(x.abs()));
    let q = largest(&mut model.difference(a.0, b.0).into_iter());
    let p = largest(&mut a.1.iter().zip(b.1).map(|(x, y)| x - y)) / largest(&mut a.1.iter().copied());
    q.max(p)
}

/// μ = M v and g = ∂(½ v·M v)/∂q on generated trees with every joint, against inverse dynamics and against central
/// differences of the kinetic energy, in double-double numbers.
#[test]
fn momenta_and_their_gradient_are_those_of_the_kinetic_energy() {
    for seed in 0..100 {
        let case = case(seed);
        let lift = |x: &[f64]| x.iter().map(|&x| Dd::from_f64(x)).collect::<Vec<Dd>>();
        let (mut q, v) = (lift(&case.q), lift(&case.v));
        case.model.normalize(&mut q);
        let layout = Layout::<Dd>::new(&case.model);
        let nv = case.model.nv();
        let (mut mu, mut g) = (lift(&vec![0.0; nv]), lift(&vec![0.0; nv]));
        MomentumSweep::new(&layout).run(&layout, &q, &v, &mut mu, &mut g);
        let want = multiply_by_mass_matrix(&layout, &q, &v).unwrap();
        let energy = kinetic_energy(&layout, &q, &v).unwrap();
        // The step of a difference, in which the energy is smooth: lengths and angles of 1.
        let step = Dd::from_f64(1e-9);
        let size = |x: &[Dd]| x.iter().fold(0.0f64, |m, x| m.max(x.to_f64().abs()));
        for i in 0..nv {
            assert!((mu[i] - want[i]).to_f64().abs() <= 1e-28 * size(&want), "μ[{i}], seed {seed}");
            let at = |sign: f64| {
                let mut x = lift(&vec![0.0; nv]);
                x[i] = step * Dd::from_f64(sign);
                kinetic_energy(&layout, &case.model.integrate(&q, &x), &v).unwrap()
            };
            let slope = (at(1.0) - at(-1.0)) / (step + step);
            // Truncation step² of the third derivative, which is at most 8 K (two factors of sin or a length each).
            let error = (slope - g[i]).to_f64().abs();
            let allowed = 1e-17 * (energy.to_f64() + size(&g));
            assert!(error <= allowed, "g[{i}], seed {seed}: {} {} {allowed:e}", g[i].hi, slope.hi);
        }
    }
}

/// ṗ = −H V~ h + Q, without accelerations: the rate of M v along a motion by forward dynamics.
#[test]
fn momenta_change_by_forces_and_the_gradient() {
    let (model, _) = free_tree();
    let layout = Layout::<Dd>::new(&model);
    let (q, v) = start(&model, 3);
    let lift = |x: &[f64]| x.iter().map(|&x| Dd::from_f64(x)).collect::<Vec<Dd>>();
    let (mut q, v) = (lift(&q), lift(&v));
    model.normalize(&mut q);
    let nv = model.nv();
    let zeros = lift(&vec![0.0; nv]);
    let a = lift(&model.random_state(4).v);
    let tau = inverse_dynamics(&layout, &q, &v, &a, None).unwrap();
    let mut sweep = MomentumSweep::new(&layout);
    let mut at = |sign: f64| {
        let h = Dd::from_f64(sign * 1e-9);
        let half = h * h * Dd::splat(0.5);
        let x: Vec<Dd> = v.iter().zip(&a).map(|(v, a)| *v * h + *a * half).collect();
        let v: Vec<Dd> = v.iter().zip(&a).map(|(v, a)| *v + *a * h).collect();
        let (mut mu, mut g) = (zeros.clone(), zeros.clone());
        sweep.run(&layout, &model.integrate(&q, &x), &v, &mut mu, &mut g);
        (mu, g)
    };
    let ((before, _), (_, g), (after, _)) = (at(-1.0), at(0.0), at(1.0));
    let mut mu = zeros.clone();
    let mut rest = zeros.clone();
    MomentumSweep::new(&layout).run(&layout, &q, &v, &mut mu, &mut rest);
    for k in 0..model.len() {
        let range = model.v_range(k);
        // ad*_v μ of the joint's own algebra is the difference between V~ h and V⁺~ h.
        let turning = own_bracket(&model, k, &v, &mu);
        for (i, turning) in range.zip(turning) {
            let rate = (after[i] - before[i]).to_f64() / 2e-9;
            let want = (tau[i] + g[i] - turning).to_f64();
            assert!((rate - want).abs() < 1e-14 * (1.0 + want.abs()), "{i}: {rate} {want}");
        }
    }
}

/// H (H* v)~ μ of one joint, zero for joints that commute.
fn own_bracket(model: &Model, k: usize, v: &[Dd], mu: &[Dd]) -> Vec<Dd> {
    let layout = Layout::<Dd>::new(model);
    let body = layout.bodies()[layout.carriers()[k].body];
    let mut wrench = phipsi_spatial::Wrench::zero();
    for (i, &c) in body.hinge.components().iter().enumerate() {
        wrench.add_to(c, mu[body.v + i]);
    }
    let turned = body.hinge.expand(&v[body.v..]).cross_wrench(wrench);
    (0..body.hinge.nv()).map(|i| body.hinge.project(i, &turned)).collect()
}

/// Errors against DOP853 at steps halved twice: slope 2 ± 0.05.
#[test]
fn the_order_is_two() {
    let (model, forces) = tree(JointKind::Free, [0.0, 0.0, -9.81]);
    let (q, v) = start(&model, 1);
    let mut dynamics = Dynamics::new(&model, forces).unwrap();
    let aux = vec![0.0; phipsi_motion::System::auxiliary_len(&dynamics)];
    let mut exact = Integrator::new(&model, Method::Dop853, Tolerances::new(1e-13), 0.0, &q, &v, &aux);
    while exact.t() < 0.5 {
        exact.step(&mut dynamics, 0.5, false).unwrap();
    }
    let (_, forces) = tree(JointKind::Free, [0.0, 0.0, -9.81]);
    let mut system = Dynamics::new(&model, forces).unwrap();
    let layout = Layout::<f64>::new(&model);
    let p =
        multiply_by_mass_matrix(&layout.clone().with_gravity(Vec3::zero()), exact.q(), exact.v()).unwrap();
    let errors: Vec<f64> = [100, 200, 400]
        .iter()
        .map(|&n| {
            let mut method = Midpoint::new(&model, &mut system, 0.0, &q, &v).unwrap();
            run(&mut method, &mut system, 0.5 / f64::from(n), n);
            distance(&model, (exact.q(), &p), (&method.state().q, &method.state().p))
        })
        .collect();
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 2.0).abs() < 0.05, "order {order}, errors {errors:?}");
    }
}

/// n steps, momenta reversed, n steps: the start again, to the rounding of the drifts' fixed points.
#[test]
fn steps_are_reversible() {
    let (model, mut system) = free_tree();
    let (q, v) = start(&model, 2);
    let mut returned = |n: u32, tolerance: f64| {
        let mut method = Midpoint::new(&model, &mut system, 0.0, &q, &v).unwrap();
        method.tolerance = tolerance;
        let begin = method.state().clone();
        run(&mut method, &mut system, 0.02, n);
        let reversed: Vec<f64> = method.state().p.iter().map(|p| -p).collect();
        method.set_momenta(&reversed).unwrap();
        run(&mut method, &mut system, 0.02, n);
        let back: Vec<f64> = method.state().p.iter().map(|p| -p).collect();
        distance(&model, (&begin.q, &begin.p), (&method.state().q, &back))
    };
    for n in [1, 100] {
        let error = returned(n, 0.0);
        println!("{n} steps there and back: {error:.1e}");
        assert!(error < 1e-12, "{n} steps: {error:e}");
    }
    // The test can fail: drifts that stop early do not return.
    assert!(returned(100, 1e-3) > 1e-8);
}

/// ξ, p of the image of a start moved by `x` (increments, then momenta), left-trivialised at the image of the start.
fn image(model: &Model, system: &mut Dynamics, q: &[f64], p: &[f64], x: &[f64], tolerance: f64) -> Vec<f64> {
    let nv = model.nv();
    let run = |system: &mut Dynamics, q: &[f64], p: &[f64]| {
        let mut method = Midpoint::new(model, system, 0.0, q, &vec![0.0; nv]).unwrap();
        method.tolerance = tolerance;
        method.set_momenta(p).unwrap();
        method.step(system, 0.05).unwrap();
        method.state().clone()
    };
    let middle = run(system, q, p);
    let moved_p: Vec<f64> = p.iter().zip(&x[nv..]).map(|(p, x)| p + x).collect();
    let moved = run(system, &model.integrate(q, &x[..nv]), &moved_p);
    let mut out = model.difference(&middle.q, &moved.q);
    out.extend(moved.p.iter().zip(&middle.p).map(|(a, b)| a - b));
    out
}

/// The Jacobian of a step by central differences of sixth order, by columns.
fn step_jacobian(
    model: &Model,
    system: &mut Dynamics,
    q: &[f64],
    p: &[f64],
    tolerance: f64,
) -> Vec<Vec<f64>> {
    let n = 2 * model.nv();
    let width = 4e-3;
    let weights = [(1.0, 0.75), (2.0, -0.15), (3.0, 1.0 / 60.0)];
    (0..n)
        .map(|j| {
            let mut column = vec![0.0; n];
            for (distance, weight) in weights {
                for sign in [1.0, -1.0] {
                    let mut x = vec![0.0; n];
                    x[j] = sign * distance * width;
                    for (c, y) in column.iter_mut().zip(image(model, system, q, p, &x, tolerance)) {
                        *c += sign * weight * y / width;
                    }
                }
            }
            column
        })
        .collect()
}

fn determinant(mut columns: Vec<Vec<f64>>) -> f64 {
    let n = columns.len();
    let mut product = 1.0;
    for k in 0..n {
        let pivot = (k..n).max_by(|&a, &b| columns[a][k].abs().total_cmp(&columns[b][k].abs())).unwrap();
        if pivot != k {
            columns.swap(pivot, k);
            product = -product;
        }
        product *= columns[k][k];
        for j in k + 1..n {
            let factor = columns[j][k] / columns[k][k];
            for i in k..n {
                let x = columns[k][i];
                columns[j][i] -= factor * x;
            }
        }
    }
    product
}

/// The symplectic form in left-trivialised coordinates: δp₂·ξ₁ − δp₁·ξ₂ + p·[ξ₁, ξ₂].
fn form(model: &Model, p: &[f64], a: &[f64], b: &[f64]) -> f64 {
    let nv = model.nv();
    let mut sum: f64 = (0..nv).map(|i| b[nv + i] * a[i] - a[nv + i] * b[i]).sum();
    let layout = Layout::<f64>::new(model);
    for body in layout.bodies() {
        let twist = |x: &[f64]| -> Motion<f64> { body.hinge.expand(&x[body.v..]) };
        let bracket = twist(a).cross_motion(twist(b));
        for (i, &c) in body.hinge.components().iter().enumerate() {
            sum += p[body.v + i] * bracket.get(c);
        }
    }
    sum
}

/// The step keeps the symplectic form, hence phase volume; differences are good to a few 1e-12 here.
#[test]
fn steps_are_symplectic() {
    let (model, mut system) = free_tree();
    let (q, v) = start(&model, 6);
    let layout = Layout::<f64>::new(&model);
    let p = multiply_by_mass_matrix(&layout, &q, &v).unwrap();
    let n = 2 * model.nv();
    let mut judge = |tolerance: f64| {
        let columns = step_jacobian(&model, &mut system, &q, &p, tolerance);
        let mut method = Midpoint::new(&model, &mut system, 0.0, &q, &vec![0.0; model.nv()]).unwrap();
        method.tolerance = tolerance;
        method.set_momenta(&p).unwrap();
        method.step(&mut system, 0.05).unwrap();
        let after = &method.state().p;
        let mut worst = 0.0f64;
        for i in 0..n {
            for j in 0..n {
                let unit = |i: usize| (0..n).map(|k| f64::from(u8::from(k == i))).collect::<Vec<f64>>();
                let want = form(&model, &p, &unit(i), &unit(j));
                worst = worst.max((form(&model, after, &columns[i], &columns[j]) - want).abs());
            }
        }
        ((determinant(columns) - 1.0).abs(), worst)
    };
    let (volume, form) = judge(0.0);
    println!("|det J − 1| = {volume:.1e}, symplectic form within {form:.1e}");
    assert!(volume < 1e-10, "{volume:e}");
    assert!(form < 1e-10, "{form:e}");
    // The test can fail: a drift after one iteration is not symplectic.
    let (_, form) = judge(1.0);
    assert!(form > 1e-6, "{form:e}");
}

/// Momentum of the free tree before and after a run, angular about the world's origin, and the largest component before.
fn momenta_of_a_run(moving: bool, steps: u32) -> ([f64; 6], [f64; 6], f64) {
    let (model, mut system) = free_tree();
    let (q, mut v) = start(&model, 8);
    let layout = Layout::<f64>::new(&model);
    let spatial =
        |q: &[f64], v: &[f64]| momentum(&layout, q, v, About::Point(Vec3::zero())).unwrap().to_array();
    if !moving {
        let [.., x, y, z] = spatial(&q, &v);
        let axes = body_pose(&layout, &q, Some(0)).unwrap().rotation;
        let speed = axes.transpose_mul(Vec3([x, y, z])).scale(1.0 / model.total_mass());
        (0..3).for_each(|i| v[3 + i] -= speed.0[i]);
    }
    let mut method = Midpoint::new(&model, &mut system, 0.0, &q, &v).unwrap();
    let before = spatial(&q, &v);
    run(&mut method, &mut system, 0.01, steps);
    let v = method.velocity().unwrap().to_vec();
    let after = spatial(&method.state().q, &v);
    (before, after, before.iter().fold(0.0f64, |m, x| m.max(x.abs())))
}

/// A tree that turns about its centre of mass at rest, over 100 000 steps, and one that also travels.
///
/// About a fixed point: the centre of mass of a tree that travels moves by P h/m to the method's order only.
#[test]
fn momentum_of_a_free_tree_is_exact() {
    for (moving, steps) in [(false, 100_000), (true, 1000)] {
        let (before, after, size) = momenta_of_a_run(moving, steps);
        let error = before.iter().zip(&after).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / size;
        println!("momentum after {steps} steps: {error:.1e} relative");
        // A step rounds by some ten ε; the roundings of many steps add up like a random walk, or partly linearly.
        assert!(error < 1e-12, "{error:e}: {before:?} {after:?}");
    }
}

/// Mean energies of the tenths of a run differ by less than the energy's oscillation within one: no drift.
fn tenths<C: Conservative>(method: &mut Midpoint, system: &mut C, h: f64, steps: usize) -> (Vec<f64>, f64)
where
    C::Error: std::fmt::Debug,
{
    let mut means = Vec::new();
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for _ in 0..10 {
        let mut sum = 0.0;
        for _ in 0..steps / 10 {
            method.step(system, h).unwrap();
            let energy = method.kinetic_energy().unwrap() + method.state().potential;
            sum += energy;
            (lowest, highest) = (lowest.min(energy), highest.max(energy));
        }
        means.push(sum * 10.0 / steps as f64);
    }
    (means, highest - lowest)
}

#[test]
fn energy_does_not_drift() {
    let cases = [
        ("pendulum", pendulum(), vec![2.0], vec![0.0], 0.05),
        ("double pendulum", double_pendulum(), vec![0.4, -0.5], vec![0.0, 0.3], 0.02),
        (
            "torque-free body",
            free_body([1.0, 2.0, 3.0]),
            vec![0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
            vec![1e-3, 1.0, 1e-3, 0.1, 0.0, 0.0],
            0.05,
        ),
    ];
    for (name, model, q, v, h) in cases {
        let mut system = Dynamics::new(&model, Vec::new()).unwrap();
        let mut method = Midpoint::new(&model, &mut system, 0.0, &q, &v).unwrap();
        let steps = 200_000;
        let (means, range) = tenths(&mut method, &mut system, h, steps);
        let spread = means.iter().fold(f64::NEG_INFINITY, |m, x| m.max(*x))
            - means.iter().fold(f64::INFINITY, |m, x| m.min(*x));
        println!("{name}: energy within {range:.1e}, means of tenths within {spread:.1e}");
        // A tenth holds hundreds of periods or more: its mean leaves less than a hundredth of the oscillation, and the
        // roundings of so many steps a random walk.
        assert!(spread < 0.01 * range + 1e-12, "{name}: {means:?}, range {range:e}");
    }
}

#[test]
fn a_closure_is_a_system() {
    let model = pendulum();
    let mut free = |_: &[f64], forces: &mut [f64]| -> Result<f64, String> {
        forces[0] = 0.0;
        Ok(0.0)
    };
    let mut method = Midpoint::new(&model, &mut free, 0.0, &[0.1], &[2.0]).unwrap();
    run(&mut method, &mut free, 0.1, 10);
    assert!((method.state().q[0] - 2.1).abs() < 10.0 * f64::EPSILON);
    assert!((method.state().t - 1.0).abs() < 10.0 * f64::EPSILON);
}

/// A step that starts at rest, and one in which nothing happens.
#[test]
fn starts_from_rest() {
    let model = pendulum();
    let mut system = Dynamics::new(&model, Vec::new()).unwrap();
    let mut method = Midpoint::new(&model, &mut system, 0.0, &[1.0], &[0.0]).unwrap();
    method.step(&mut system, 0.01).unwrap();
    assert!(method.state().q[0] < 1.0);
    let mut method = Midpoint::new(&model, &mut system, 0.0, &[0.0], &[0.0]).unwrap();
    method.step(&mut system, 0.01).unwrap();
    assert_eq!(method.state().q[0], 0.0);
}

#[test]
fn checkpoints_continue_bit_for_bit_and_steps_do_not_allocate() {
    let (model, mut system) = free_tree();
    let (q, v) = start(&model, 9);
    let mut method = Midpoint::new(&model, &mut system, 0.0, &q, &v).unwrap();
    run(&mut method, &mut system, 0.02, 5);
    let saved = method.state().clone();
    run(&mut method, &mut system, 0.02, 5);
    let mut again = Midpoint::new(&model, &mut system, 0.0, &q, &v).unwrap();
    again.restore(saved).unwrap();
    run(&mut again, &mut system, 0.02, 5);
    assert_eq!(method.state(), again.state());
    let mut nothing = |_: &[f64], _: &mut [f64]| -> Result<f64, String> { Ok(0.0) };
    let counted = measure(|| run(&mut method, &mut nothing, 0.02, 1));
    assert_eq!(counted.count_total, 0, "{counted:?}");
}

/// A step in which a joint turns far is refused by name, and leaves the state as it was.
#[test]
fn a_drift_that_does_not_converge_names_its_joint() {
    let (model, mut system) = free_tree();
    let (q, mut v) = start(&model, 10);
    v[model.v_offset(model.find_joint("ball").unwrap())] = 400.0;
    let mut method = Midpoint::new(&model, &mut system, 0.0, &q, &v).unwrap();
    let before = method.state().clone();
    let error = method.step(&mut system, 0.1).unwrap_err();
    assert!(matches!(error, MidpointError::NotConverged { .. }), "{error}");
    assert!(error.to_string().contains("joint `"), "{error}");
    assert_eq!(*method.state(), before);
}

/// Forces that are no numbers end the run before they enter the state.
#[test]
fn forces_that_are_not_finite_are_refused() {
    let model = pendulum();
    let mut broken = |q: &[f64], forces: &mut [f64]| -> Result<f64, String> {
        forces[0] = if q[0] > 0.3 { f64::NAN } else { 0.0 };
        Ok(0.0)
    };
    let mut method = Midpoint::new(&model, &mut broken, 0.0, &[0.2], &[1.0]).unwrap();
    method.step(&mut broken, 0.09).unwrap();
    let before = method.state().clone();
    let error = method.step(&mut broken, 0.09).unwrap_err();
    assert!(
        matches!(&error, MidpointError::NotFinite { joint: Some(joint), .. } if joint == "hinge"),
        "{error}"
    );
    assert_eq!(*method.state(), before);
}

#[test]
fn forces_without_a_potential_are_refused() {
    let model = pendulum();
    let damper =
        JointSpring { name: "damper".into(), coordinate: 0, dof: 0, stiffness: 0.0, damping: 1.0, rest: 0.0 };
    let mut dynamics = Dynamics::new(&model, vec![Box::new(damper)]).unwrap();
    let error = Midpoint::new(&model, &mut dynamics, 0.0, &[0.1], &[0.0]).unwrap_err();
    assert!(error.to_string().contains("`damper`"), "{error}");
}

/// Steps and events at fixed times against the discrete Lagrangian in double-double numbers, on generated trees under weight.
#[test]
fn steps_and_passages_are_those_of_the_discrete_lagrangian() {
    use phipsi_motion::{Action, Direction, Event, Scheme, Stepper};
    use phipsi_reference::fixed_midpoint::{midpoint_step, passage};
    use phipsi_reference::generate::{Case, Limits, case_within};
    use phipsi_reference::gravity_forces;
    use phipsi_reference::sensitivity::{sensitivity, widened};
    const STEPS: usize = 4;
    const H: f64 = 0.02;
    let lift = |x: f64| Dd::from_f64(x);
    let mut passed = 0;
    for seed in 0..5 {
        let mut start = case_within(seed, Limits { degrees_of_freedom: 1 + seed as usize % 4, decades: 0.0 });
        start.model.normalize(&mut start.q);
        // Speeds of one: a few hundredths of a radian in a step.
        let fastest = start.v.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        start.v.iter_mut().for_each(|x| *x /= fastest.max(1.0));
        let path = |case: &Case| -> Vec<(Vec<Dd>, Vec<Dd>)> {
            let model = &case.model;
            let weight = |q: &[Dd]| gravity_forces(model, q).into_iter().map(|x| -x).collect::<Vec<Dd>>();
            let mut q = widened(&case.q);
            model.normalize(&mut q);
            let p = phipsi_reference::multiply_by_mass_matrix(model, &q, &widened(&case.v));
            let mut states = vec![(q, p)];
            for _ in 0..STEPS {
                let (q, p) = states.last().unwrap();
                states.push(midpoint_step(model, (q, p), lift(H), &weight).unwrap());
            }
            states
        };
        let at_end = |case: &Case| {
            let (q, p) = path(case).pop().unwrap();
            [q, p].concat()
        };
        let (_, size) = sensitivity(&start, 2, seed, at_end);
        let states = path(&start);
        let model = &start.model;
        let (nq, nv) = (model.nq(), model.nv());
        // A level that the middle of the third step has passed.
        let c = (0..nq).max_by(|&a, &b| {
            let moved = |i: usize| (states[3].0[i] - states[2].0[i]).hi.abs();
            moved(a).total_cmp(&moved(b))
        });
        let c = c.unwrap();
        let level = 0.5 * (states[2].0[c].hi + states[3].0[c].hi);
        let event = Event::new("level", Direction::Either, Action::Record, move |at| at.q[c] - level);
        let mut dynamics = Dynamics::new(model, vec![]).unwrap().with_events(vec![event]);
        dynamics.leave_out_integrals();
        let state = phipsi_model::State { q: start.q.clone(), v: start.v.clone(), t: 0.0 };
        let scheme = Scheme::Midpoint { step: H };
        let mut stepper = Stepper::new(&mut dynamics, scheme, Tolerances::new(1e-9), &state, &[]).unwrap();
        let weight = |q: &[Dd]| gravity_forces(model, q).into_iter().map(|x| -x).collect::<Vec<Dd>>();
        // n·ε·κ for every step, with a drift that is solved to some roundings of its velocity.
        let kappa = |range: std::ops::Range<usize>| size[range].iter().fold(0.0f64, |m, x| m.max(*x));
        let unit = 64.0 * STEPS as f64 * (model.len() + nv) as f64 * f64::EPSILON;
        for n in 0..STEPS {
            stepper.step(&mut dynamics, 1.0, false).unwrap();
            let (q, _) = &states[n + 1];
            let off = stepper.q().iter().zip(q).map(|(a, b)| (a - b.hi).abs()).fold(0.0, f64::max);
            assert!(off <= unit * kappa(0..nq), "seed {seed}, step {n}: {off:e} {:e}", unit * kappa(0..nq));
            let found = stepper.occurrences();
            let (before, after) = (states[n].0[c].hi - level, q[c].hi - level);
            if before * after >= 0.0 {
                assert!(found.is_empty(), "seed {seed}, step {n}");
                continue;
            }
            let from = (&states[n].0[..], &states[n].1[..]);
            let theta = passage(model, from, lift(H), &weight, &|q: &[Dd]| q[c] - lift(level)).unwrap();
            let want = n as f64 * H + theta.to_f64() * H;
            assert_eq!(found.len(), 1, "seed {seed}, step {n}");
            let rate = (after - before).abs() / H;
            let allowed = 8.0 * f64::EPSILON + unit * kappa(0..nq) / rate;
            assert!((found[0].t - want).abs() <= allowed, "seed {seed}: {} {want} {allowed:e}", found[0].t);
            passed += 1;
        }
        let p = multiply_by_mass_matrix(&Layout::new(model), stepper.q(), stepper.v()).unwrap();
        let off = p.iter().zip(&states[STEPS].1).map(|(a, b)| (a - b.hi).abs()).fold(0.0, f64::max);
        let of_p = nq..nq + nv;
        assert!(off <= unit * kappa(of_p.clone()), "seed {seed}: {off:e} {:e}", unit * kappa(of_p));
    }
    assert!(passed >= 4, "{passed}");
}
