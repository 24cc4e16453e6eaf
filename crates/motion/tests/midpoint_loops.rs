//! The midpoint method on closed loops: order, reversibility, closures, energy over long runs, momentum of free chains.
//!
//! `PHIPSI_STEPS=100000 cargo test --release -p phipsi-motion --test all midpoint_loops -- --nocapture` makes the long run.

use phipsi_model::{
    Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random,
};
use phipsi_motion::forces::JointSpring;
use phipsi_motion::{Dynamics, Force, Integrator, Method, Midpoint, MidpointError, System, Tolerances};
use phipsi_recursion::{About, Layout, momentum};
use phipsi_spatial::Vec3;

const AXIS: [f64; 3] = [0.0, 1.0, 0.0];

fn at(x: f64, y: f64, z: f64) -> Placement {
    Placement { translation: [x, y, z], ..Placement::IDENTITY }
}

fn rod(name: &str, length: f64) -> Body {
    let i = length * length / 12.0;
    Body::new(name, Inertia::from_principal(length, [0.5 * length, 0.0, 0.0], [1e-4, i, i]))
}

/// Crank 0.7, coupler 1.6, rocker 1.1 on a ground of 1.5, closed by a hinge: a row across the plane and two rotations are
/// redundant.
fn four_bar() -> Model {
    let hinge =
        |name: &str, x: f64| Joint::new(name, JointKind::Continuous { axis: AXIS }).at(at(x, 0.0, 0.0));
    let flat = std::f64::consts::FRAC_1_SQRT_2;
    // The closure's axis is z: a quarter turn about x brings it to the hinges'.
    let turned = |x: f64| Placement { translation: [x, 0.0, 0.0], rotation: [-flat, 0.0, 0.0, flat] };
    ModelBuilder::new("four-bar")
        .body(rod("crank", 0.7))
        .body(rod("coupler", 1.6))
        .body(rod("rocker", 1.1))
        .joint(hinge("a", 0.0), "world", "crank")
        .joint(hinge("b", 0.7), "crank", "coupler")
        .joint(hinge("c", 1.5), "world", "rocker")
        .closure(Closure {
            name: "pin".into(),
            kind: ClosureKind::Revolute,
            body_a: "coupler".into(),
            pose_a: turned(1.6),
            body_b: "rocker".into(),
            pose_b: turned(1.1),
        })
        .gravity([0.0, 0.0, -9.81])
        .build()
        .unwrap()
}

/// Six hinges at right angles on the edges of a cube, the last to the world: Bricard's mechanism, one row redundant.
fn bricard() -> Model {
    let axes = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let points = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, -1.0, 0.0],
        [1.0, -1.0, 1.0],
        [0.0, -1.0, 1.0],
        [0.0, 0.0, 1.0],
    ];
    let mut builder = ModelBuilder::new("Bricard").gravity([0.0, 0.0, -9.81]);
    let mut parent = "world".to_string();
    for i in 0..5 {
        let step: [f64; 3] = std::array::from_fn(|k| points[i + 1][k] - points[i][k]);
        let from: [f64; 3] =
            std::array::from_fn(|k| if i == 0 { points[0][k] } else { points[i][k] - points[i - 1][k] });
        let principal = std::array::from_fn(|k| 1e-3 + (1.0 - step[k] * step[k]) / 12.0);
        let name = format!("rod{i}");
        let inertia = Inertia::from_principal(1.0, step.map(|x| 0.5 * x), principal);
        let joint = Joint::new(format!("hinge{i}"), JointKind::Continuous { axis: axes[i] });
        let placement = Placement { translation: from, ..Placement::IDENTITY };
        builder =
            builder.body(Body::new(name.as_str(), inertia)).joint(joint.at(placement), parent, name.as_str());
        parent = name;
    }
    // The last hinge turns about x: z of the closure's frames is brought there.
    let flat = std::f64::consts::FRAC_1_SQRT_2;
    let rotation = [0.0, flat, 0.0, flat];
    builder
        .closure(Closure {
            name: "last".into(),
            kind: ClosureKind::Revolute,
            body_a: parent,
            pose_a: Placement { translation: [0.0, 1.0, 0.0], rotation },
            body_b: "world".into(),
            pose_b: Placement { translation: points[5], rotation },
        })
        .build()
        .unwrap()
}

/// A ring of n bodies that floats: ball joints, the last one a closure, springs in no joint.
fn floating_ring(n: usize) -> Model {
    let mut random = Random::new(8);
    let mut builder = ModelBuilder::new("ring").gravity([0.0; 3]);
    let corner = |i: usize| {
        let angle = std::f64::consts::TAU * i as f64 / n as f64;
        [angle.cos(), angle.sin(), 0.1 * (i % 2) as f64]
    };
    for i in 0..n {
        let center = random.vector().map(|x| 0.1 * x);
        let inertia = Inertia::from_principal(1.0 + 0.2 * i as f64, center, [0.11, 0.17, 0.21]);
        let name = format!("link{i}");
        let (parent, from) =
            if i == 0 { ("world".into(), [0.0; 3]) } else { (format!("link{}", i - 1), corner(i - 1)) };
        let kind = if i == 0 { JointKind::Free } else { JointKind::Spherical };
        let translation = std::array::from_fn(|k| corner(i)[k] - from[k]);
        let joint = Joint::new(format!("ball{i}"), kind).at(Placement { translation, ..Placement::IDENTITY });
        builder = builder.body(Body::new(name.as_str(), inertia)).joint(joint, parent, name.as_str());
    }
    let translation = std::array::from_fn(|k| corner(0)[k] - corner(n - 1)[k]);
    builder
        .closure(Closure {
            name: "last".into(),
            kind: ClosureKind::Spherical,
            body_a: "link0".into(),
            pose_a: Placement::IDENTITY,
            body_b: format!("link{}", n - 1),
            pose_b: Placement { translation, ..Placement::IDENTITY },
        })
        .build()
        .unwrap()
}

/// A consistent state: the loops closed from a guess, velocities projected.
pub fn settle(dynamics: &mut Dynamics, mut q: Vec<f64>, mut v: Vec<f64>) -> (Vec<f64>, Vec<f64>) {
    let none = vec![false; v.len()];
    dynamics.assemble(0.0, &mut q, &mut v, [&none, &none]).unwrap();
    (q, v)
}

pub fn started(model: &Model, seed: u64) -> (Dynamics, Vec<f64>, Vec<f64>) {
    let mut dynamics = Dynamics::new(model, Vec::new()).unwrap();
    let mut random = Random::new(seed);
    let v: Vec<f64> = (0..model.nv()).map(|_| random.signed()).collect();
    let q = if model.name() == "four-bar" { vec![1.2, -0.9, 1.9] } else { model.neutral() };
    let (q, v) = settle(&mut dynamics, q, v);
    (dynamics, q, v)
}

fn largest(x: impl IntoIterator<Item = f64>) -> f64 {
    x.into_iter().fold(0.0f64, |most, x| most.max(x.abs()))
}

pub fn models() -> [Model; 3] {
    [four_bar(), bricard(), floating_ring(7)]
}

/// Against DOP853 with projection at 1e-12.
#[test]
fn the_order_is_two() {
    for model in models() {
        let (mut dynamics, q, v) = started(&model, 3);
        let (aux, t_end) = (vec![0.0; dynamics.auxiliary_len()], 0.4);
        let mut exact = Integrator::new(&model, Method::Dop853, Tolerances::new(1e-12), 0.0, &q, &v, &aux);
        while exact.t() < t_end {
            exact.step(&mut dynamics, t_end, false).unwrap();
        }
        let mut error = |steps: u32| {
            let mut method = Midpoint::new(&model, &mut dynamics, 0.0, &q, &v).unwrap();
            for _ in 0..steps {
                method.step(&mut dynamics, t_end / f64::from(steps)).unwrap();
            }
            let of_v = largest(method.velocity().unwrap().iter().zip(exact.v()).map(|(a, b)| a - b));
            (largest(model.difference(exact.q(), &method.state().q)), of_v)
        };
        let errors = [error(40), error(80), error(160)];
        for pair in errors.windows(2) {
            let (of_q, of_v) = ((pair[0].0 / pair[1].0).log2(), (pair[0].1 / pair[1].1).log2());
            println!("{}: order {of_q:.3} in q, {of_v:.3} in v", model.name());
            assert!((of_q - 2.0).abs() < 0.06 && (of_v - 2.0).abs() < 0.06, "{}: {errors:?}", model.name());
        }
    }
}

/// 100 steps, momenta reversed, 100 steps.
#[test]
fn steps_are_reversible_and_stay_on_the_closures() {
    for model in models() {
        let (mut dynamics, q, v) = started(&model, 4);
        let mut method = Midpoint::new(&model, &mut dynamics, 0.0, &q, &v).unwrap();
        let begin = method.state().clone();
        let mut open = [0.0f64; 2];
        for half in 0..2 {
            for _ in 0..100 {
                method.step(&mut dynamics, 0.01).unwrap();
                let found = method.residual().unwrap().unwrap();
                open = [open[0].max(found.position), open[1].max(found.velocity)];
            }
            if half == 0 {
                assert!(largest(model.difference(&begin.q, &method.state().q)) > 0.1);
                let reversed: Vec<f64> = method.state().p.iter().map(|p| -p).collect();
                method.set_momenta(&reversed).unwrap();
            }
        }
        let of_q = largest(model.difference(&begin.q, &method.state().q));
        let of_p =
            largest(begin.p.iter().zip(&method.state().p).map(|(a, b)| a + b)) / largest(begin.p.clone());
        println!(
            "{}: back within {of_q:.1e}, momenta {of_p:.1e}, closures open by {open:?}, {:.1} iterations",
            model.name(),
            method.state().iterations as f64 / 200.0
        );
        assert!(of_q < 1e-12 && of_p < 1e-12, "{}: {of_q:e} {of_p:e}", model.name());
        assert!(open[0] < 1e-13 && open[1] < 1e-12, "{}: {open:?}", model.name());
    }
}

/// The closed ring turns and tumbles: momentum about the centre of mass to rounding.
#[test]
fn momentum_of_a_floating_ring_is_kept() {
    let model = floating_ring(7);
    let (mut dynamics, q, v) = started(&model, 5);
    let mut method = Midpoint::new(&model, &mut dynamics, 0.0, &q, &v).unwrap();
    let layout = Layout::new(&model.clone().without_closures());
    let of = |method: &mut Midpoint| {
        let v = method.velocity().unwrap().to_vec();
        momentum(&layout, &method.state().q, &v, About::Point(Vec3::zero())).unwrap().to_array()
    };
    let before = of(&mut method);
    for _ in 0..500 {
        method.step(&mut dynamics, 0.01).unwrap();
    }
    let after = of(&mut method);
    let error = largest(before.iter().zip(&after).map(|(a, b)| a - b)) / largest(before);
    println!("floating ring: momentum after 500 steps {error:.1e} relative");
    // A step rounds the momentum by some ε of each of the 7 bodies, and the ring drifts off by some lengths: √500 · 7 · 10 ε.
    assert!(error < 1e3 * 7.0 * f64::EPSILON, "{error:e}");
}

/// The energy of the last tenth of a run ranges as that of the first: no drift.
#[test]
fn energy_does_not_drift() {
    let steps: usize = match std::env::var("PHIPSI_STEPS") {
        Ok(text) => text.parse().expect("PHIPSI_STEPS is a whole number"),
        Err(_) => 5000,
    };
    for model in [four_bar(), bricard()] {
        let (mut dynamics, q, v) = started(&model, 6);
        let mut method = Midpoint::new(&model, &mut dynamics, 0.0, &q, &v).unwrap();
        let mut tenths = Vec::new();
        let mut scale = 0.0f64;
        for _ in 0..10 {
            let mut sum = 0.0;
            for _ in 0..steps / 10 {
                method.step(&mut dynamics, 0.01).unwrap();
                let kinetic = method.kinetic_energy().unwrap();
                scale = scale.max(kinetic);
                sum += kinetic + method.state().potential;
            }
            tenths.push(sum / (steps / 10) as f64);
        }
        let mean = tenths.iter().sum::<f64>() / 10.0;
        let spread = largest(tenths.iter().map(|e| e - mean)) / scale;
        // Slope of a line through the tenths, over the whole run.
        let slope: f64 =
            tenths.iter().enumerate().map(|(i, e)| (i as f64 - 4.5) * (e - mean)).sum::<f64>() / 8.25;
        println!(
            "{}: {steps} steps, tenths {spread:.1e} of the kinetic energy, drift {:.1e}",
            model.name(),
            slope / scale
        );
        // Means over a tenth of a periodic motion differ by the part of a period that is cut off, of the second-order error.
        assert!((slope / scale).abs() < 2e-4 && spread < 2e-4, "{}: {tenths:?}", model.name());
    }
}

/// A crank that has made ten thousand turns closes to the rounding of its angle.
#[test]
fn many_turns_do_not_stop_the_iteration() {
    let model = four_bar();
    let (mut dynamics, mut q, v) = started(&model, 7);
    q[0] += std::f64::consts::TAU * 1e4;
    let mut method = Midpoint::new(&model, &mut dynamics, 0.0, &q, &v).unwrap();
    for _ in 0..100 {
        method.step(&mut dynamics, 0.01).unwrap();
        let open = method.residual().unwrap().unwrap();
        assert!(open.position < 8.0 * f64::EPSILON * q[0], "{open:?}");
    }
}

/// A linkage that hangs at rest has nothing but constraint forces, and stays.
#[test]
fn a_linkage_at_rest_stays() {
    let model = four_bar();
    let q = started(&model, 7).1;
    let spring = |joint: usize| -> Box<dyn Force> {
        Box::new(JointSpring {
            name: format!("s{joint}"),
            coordinate: joint,
            dof: joint,
            stiffness: 50.0,
            damping: 0.0,
            rest: q[joint],
        })
    };
    let still = model.clone().with_gravity([0.0; 3]);
    let mut dynamics = Dynamics::new(&still, (0..3).map(spring).collect()).unwrap();
    let mut method = Midpoint::new(&still, &mut dynamics, 0.0, &q, &[0.0; 3]).unwrap();
    let begin = method.state().q.clone();
    for _ in 0..50 {
        method.step(&mut dynamics, 0.01).unwrap();
    }
    assert!(largest(still.difference(&begin, &method.state().q)) < 1e-13);
}

/// Checkpoints continue to the last bit.
#[test]
fn checkpoints_continue() {
    let model = bricard();
    let (mut dynamics, q, v) = started(&model, 9);
    let mut method = Midpoint::new(&model, &mut dynamics, 0.0, &q, &v).unwrap();
    for _ in 0..20 {
        method.step(&mut dynamics, 0.01).unwrap();
    }
    let kept = method.state().clone();
    let mut other = Midpoint::new(&model, &mut dynamics, 0.0, &q, &v).unwrap();
    other.restore(kept).unwrap();
    for _ in 0..20 {
        method.step(&mut dynamics, 0.01).unwrap();
        other.step(&mut dynamics, 0.01).unwrap();
    }
    assert_eq!(method.state(), other.state());
}

/// A start from which the loop cannot be closed is refused with the closure's name.
#[test]
fn a_start_that_is_open_is_refused() {
    let model = four_bar();
    let mut dynamics = Dynamics::new(&model, Vec::new()).unwrap();
    let error = Midpoint::new(&model, &mut dynamics, 0.0, &[0.0, 3.1, 0.1], &[0.0; 3]).unwrap_err();
    assert!(matches!(error, MidpointError::Closure { .. }), "{error:?}");
    assert!(error.to_string().contains("`pin`"), "{error}");
}
