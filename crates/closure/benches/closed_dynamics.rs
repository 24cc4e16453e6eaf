//! Accelerations of ladders of four-bars, one state, workspace kept, kinematics included; items are loops. Beside them the same
//! trees with their loops open, by the recursion of trees; and the compliance of their closures, on ladders of which the m² numbers
//! fit a cache.

use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_closure::{ClosedDynamics, ClosedForm, ClosureCompliance, Conditions};
use phipsi_model::{Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use phipsi_recursion::{ForwardDynamics, Layout};

const LOOPS: [usize; 5] = [1, 8, 64, 128, 1000];

fn main() {
    divan::main();
}

/// Four-bars one upon the other: three bodies and three rows each.
fn ladder(n: usize) -> Model {
    let rod = |name: &str| Body::new(name, Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.01, 0.1, 0.1]));
    let at = |x: f64| Placement::from_xyz_rpy([x, 0.0, 0.0], [0.0; 3]);
    let hinge =
        |name: String, x: f64| Joint::new(name, JointKind::Revolute { axis: [0.0, 0.0, 1.0] }).at(at(x));
    let mut builder = ModelBuilder::new("ladder");
    let mut base = "world".to_string();
    for i in 0..n {
        let [left, right, rung] = ["left", "right", "rung"].map(|name| format!("{name}{i}"));
        builder = builder
            .body(rod(&left))
            .body(rod(&right))
            .body(rod(&rung))
            .joint(hinge(format!("a{i}"), 0.0), base.as_str(), left.as_str())
            .joint(hinge(format!("c{i}"), 1.0), base.as_str(), right.as_str())
            .joint(hinge(format!("b{i}"), 1.0), left.as_str(), rung.as_str())
            .closure(Closure {
                name: format!("pin{i}"),
                kind: ClosureKind::Spherical,
                body_a: rung.clone(),
                pose_a: at(1.0),
                body_b: right,
                pose_b: at(1.0),
            });
        base = rung;
    }
    builder.build().expect("a ladder")
}

/// Parallelograms, each leaning a little differently, at rates that keep them closed.
fn state(model: &Model) -> (Vec<f64>, Vec<f64>) {
    let angle = |k: usize| {
        let name = &model.joints()[k].name;
        let i: f64 = name[1..].parse().expect("a number");
        let lean = 1.2 + 0.1 * i.sin();
        if name.starts_with('b') { -lean } else { lean }
    };
    let q: Vec<f64> = model.moving_joints().map(angle).collect();
    let v = q.iter().map(|q| 0.1 * q).collect();
    (q, v)
}

#[divan::bench(args = LOOPS, min_time = 0.1)]
fn closed_dynamics(bencher: Bencher<'_, '_>, loops: usize) {
    in_form(bencher, loops, ClosedForm::Mixed);
}

#[divan::bench(args = LOOPS, min_time = 0.1)]
fn plain_form(bencher: Bencher<'_, '_>, loops: usize) {
    in_form(bencher, loops, ClosedForm::Plain);
}

fn in_form(bencher: Bencher<'_, '_>, loops: usize, form: ClosedForm) {
    let model = ladder(loops);
    let (q, v) = state(&model);
    let tau = vec![0.1; model.nv()];
    let mut out = tau.clone();
    let work = ClosedDynamics::<f64>::new(&model).expect("a mechanism");
    let mut work = work.with_form(form).expect("rigid");
    bencher.counter(ItemsCount::new(loops)).bench_local(|| {
        work.run(&q, &v, &tau, &Conditions::default(), &mut out).expect("regular");
        out[0]
    });
}

#[divan::bench(args = LOOPS, min_time = 0.1)]
fn open_tree(bencher: Bencher<'_, '_>, loops: usize) {
    let model = ladder(loops);
    let (q, v) = state(&model);
    let tau = vec![0.1; model.nv()];
    let mut out = tau.clone();
    let layout = Layout::new(&model.without_closures());
    let mut work = ForwardDynamics::new(&layout);
    bencher.counter(ItemsCount::new(loops)).bench_local(|| {
        work.run(&layout, &q, &v, &tau, None, &mut out).expect("regular");
        out[0]
    });
}

#[divan::bench(args = [1, 8, 64], min_time = 0.1)]
fn closure_compliance(bencher: Bencher<'_, '_>, loops: usize) {
    let model = ladder(loops);
    let (q, _) = state(&model);
    let mut work = ClosureCompliance::<f64>::new(&model).expect("a mechanism");
    let mut out = vec![0.0; work.rows() * work.rows()];
    bencher.counter(ItemsCount::new(loops)).bench_local(|| {
        work.run(&q, &mut out).expect("regular");
        out[0]
    });
}
