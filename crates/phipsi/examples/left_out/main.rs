//! What the plan of a scene saves: time of a step with the plan and with the general code.
//!
//! `cargo run --release -p phipsi --example left_out` prints the table of `docs/src/left_out.md`; with `-- --write` it puts it there.

use phipsi::model::{
    Base, Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, Placement,
};
use phipsi::motion::forces::{JointSpring, JointTorque};
use phipsi::motion::{
    Course, Dynamics, Force, Integrator, Method, Plan, PrescribedJoint, Prescription, Signal, System,
    Tolerances,
};
use phipsi::recursion::{Layout, body_pose};
use phipsi::spatial::Vec3;
use std::time::Instant;

mod molecule;

type Failure = Box<dyn std::error::Error>;

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/src/left_out.md");

/// Rounds in which the two take turns, and steps of each.
const ROUNDS: usize = 31;
const STEPS: usize = 400;

/// A scene: how it is called, its mechanism, what acts and what is given.
struct Kind {
    name: &'static str,
    model: Model,
    forces: fn() -> Vec<Box<dyn Force>>,
    prescription: Prescription,
}

/// Joint angles at the start, rad: away from the straight arm, which is a singular position of the loop.
const BENT: f64 = 0.4;

/// Seven rods of 1 m, axes y and z in turn.
fn arm(base: Base, gravity: f64) -> Result<Model, Failure> {
    let mut builder = ModelBuilder::new("arm").gravity([0.0, 0.0, -gravity]);
    let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [1e-3, 0.084, 0.084]);
    for k in 0..7 {
        builder = builder.body(Body::new(format!("link{k}"), rod));
        if k == 0 && matches!(base, Base::Free) {
            continue;
        }
        let axis = if k % 2 == 0 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        let at = Placement::from_xyz_rpy([if k == 0 { 0.0 } else { 1.0 }, 0.0, 0.0], [0.0; 3]);
        let parent = if k == 0 { "world".to_string() } else { format!("link{}", k - 1) };
        let joint = Joint::new(format!("joint{k}"), JointKind::Continuous { axis }).at(at);
        builder = builder.joint(joint, parent, format!("link{k}"));
    }
    Ok(builder.base(base).build()?)
}

/// The end of the arm tied to the place where it is at the start.
fn tied(arm: Model) -> Result<Model, Failure> {
    let last = arm.find_body("link6")?;
    let pose = body_pose(&Layout::<f64>::new(&arm), &start(&arm), last)?;
    let end = Vec3([1.0, 0.0, 0.0]);
    Ok(arm.with_closure(Closure {
        name: "tie".into(),
        kind: ClosureKind::Spherical,
        body_a: "world".into(),
        pose_a: Placement::from_xyz_rpy(pose.point(end).0, [0.0; 3]),
        body_b: "link6".into(),
        pose_b: Placement::from_xyz_rpy(end.0, [0.0; 3]),
    })?)
}

fn start(model: &Model) -> Vec<f64> {
    let mut q = model.neutral::<f64>();
    for (k, joint) in model.joints().iter().enumerate() {
        if let JointKind::Continuous { .. } = joint.kind {
            q[model.q_offset(k)] = BENT;
        }
    }
    q
}

fn kinds() -> Result<Vec<Kind>, Failure> {
    let none: fn() -> Vec<Box<dyn Force>> = Vec::new;
    let motors: fn() -> Vec<Box<dyn Force>> = || {
        let motor = |dof: usize| -> Box<dyn Force> {
            Box::new(JointTorque { name: format!("motor{dof}"), dof, value: Signal::Constant(0.1) })
        };
        (0..7).map(motor).collect()
    };
    let springs: fn() -> Vec<Box<dyn Force>> = || {
        let spring = |i: usize| -> Box<dyn Force> {
            let name = format!("spring{i}");
            Box::new(JointSpring { name, coordinate: i, dof: i, stiffness: 5.0, damping: 0.0, rest: 0.0 })
        };
        (0..7).map(spring).collect()
    };
    let still = Prescription::default;
    let all = |dof: usize| PrescribedJoint {
        dof,
        coordinate: None,
        course: Course::Acceleration(Signal::Constant(0.01)),
    };
    let driven = Prescription { joints: (0..7).map(all).collect(), closures: Vec::new() };
    let fixed = || arm(Base::Fixed, 9.81);
    let kind = |name, model, forces, prescription| Kind { name, model, forces, prescription };
    Ok(vec![
        kind("fixed serial arm with motors", fixed()?, motors, still()),
        kind("free tree", arm(Base::Free, 9.81)?, none, still()),
        kind("with a loop", tied(fixed()?)?, none, still()),
        kind("all joints prescribed", fixed()?, none, driven),
        kind("all joints passive", fixed()?, none, still()),
        kind("springs, no gravity", arm(Base::Fixed, 0.0)?, springs, still()),
    ])
}

/// An integrator of fourth order with steps of 1e-4 s, at rest at the start.
fn integrator(dynamics: &Dynamics) -> Integrator {
    let model = System::model(dynamics);
    let (q, v) = (start(model), vec![0.0; model.nv()]);
    let aux = vec![0.0; dynamics.auxiliary_len()];
    let method = Method::Rk4 { step: 1e-4 };
    Integrator::new(model, method, Tolerances::new(1e-9), 0.0, &q, &v, &aux)
}

/// Seconds a step.
fn time(dynamics: &mut Dynamics) -> Result<f64, Failure> {
    let mut run = integrator(dynamics);
    let start = Instant::now();
    for _ in 0..STEPS {
        run.step(dynamics, 1.0, false).map_err(|e| format!("{e:?}"))?;
    }
    Ok(start.elapsed().as_secs_f64() / STEPS as f64)
}

fn median(mut x: Vec<f64>) -> f64 {
    x.sort_by(f64::total_cmp);
    x[x.len() / 2]
}

fn table() -> Result<String, Failure> {
    let mut text = String::from(
        "| scene | with its plan, µs a step | the general code, µs | general / plan | what is left out |\n|---|---|---|---|---|\n",
    );
    for Kind { name, model, forces, prescription } in kinds()? {
        let mut planned = Dynamics::prescribed(&model, forces(), &prescription)?;
        let mut general = Dynamics::with_plan(&model, forces(), Plan::everything(), &prescription)?;
        let mut times = [Vec::new(), Vec::new()];
        for _ in 0..ROUNDS {
            times[0].push(time(&mut planned)?);
            times[1].push(time(&mut general)?);
        }
        let [plan, whole] = times.map(median);
        let left_out: Vec<String> = planned.plan().left_out();
        let short = left_out.iter().map(|l| l.split(':').next().unwrap_or(l)).collect::<Vec<_>>().join("; ");
        text += &row(name, [plan, whole], &short);
    }
    let (left_out, times) = molecule::row()?;
    text += &row("molecule with rigid clusters", times, &left_out);
    Ok(text)
}

fn row(name: &str, [plan, whole]: [f64; 2], left_out: &str) -> String {
    format!("| {name} | {:.2} | {:.2} | {:.2} | {left_out} |\n", 1e6 * plan, 1e6 * whole, whole / plan)
}

fn main() -> Result<(), Failure> {
    let text = table()?;
    print!("{text}");
    if std::env::args().any(|a| a == "--write") {
        let page = std::fs::read_to_string(PAGE)?;
        let (begin, end) = ("<!-- table: begin -->\n", "<!-- table: end -->");
        let first = page.find(begin).ok_or("the page has no mark where the table begins")? + begin.len();
        let last = page.find(end).ok_or("the page has no mark where the table ends")?;
        std::fs::write(PAGE, format!("{}\n{text}\n{}", &page[..first], &page[last..]))?;
    }
    Ok(())
}
