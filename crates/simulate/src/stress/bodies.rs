//! Bodies at the edge of what a body can be: without mass, needles, hinges without inertia, denormal numbers, gimbals.

use super::Scene;
use super::chain::{Chain, State};
use super::tree::{Call, judge};
use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder, ModelErrors, Placement, Random};
use std::f64::consts::{FRAC_PI_2, SQRT_2};

const FAMILY: &str = "bodies";

fn scene(name: impl Into<String>, what: &str, make: impl FnOnce() -> Call + Send + 'static) -> Scene {
    Scene::new(FAMILY, name, what, move || judge(make()))
}

fn chain(name: impl Into<String>, what: &str, chain: Chain) -> Scene {
    scene(name, what, move || {
        let state = chain.state(600, 0.5, 1.0);
        Call::new(chain.model(), state)
    })
}

/// Bodies one after the other, each 1 m along x from the last, with a joint.
fn series(parts: Vec<(JointKind, Inertia)>) -> Result<Model, ModelErrors> {
    let mut builder = ModelBuilder::new("series").gravity([0.0, -9.81, 0.0]);
    for (k, (kind, inertia)) in parts.into_iter().enumerate() {
        let at = [if k == 0 { 0.0 } else { 1.0 }, 0.0, 0.0];
        let parent = if k == 0 { "world".to_string() } else { format!("body{}", k - 1) };
        let joint =
            Joint::new(format!("joint{k}"), kind).at(Placement { translation: at, ..Placement::IDENTITY });
        builder =
            builder.body(Body::new(format!("body{k}"), inertia)).joint(joint, parent, format!("body{k}"));
    }
    builder.build()
}

fn axis(i: usize) -> JointKind {
    let mut axis = [0.0; 3];
    axis[i] = 1.0;
    JointKind::Continuous { axis }
}

fn brick() -> Inertia {
    Inertia::from_principal(1.0, [0.3, 0.2, 0.1], [0.1, 0.12, 0.15])
}

/// Random rates and forces of size one.
fn at(q: Vec<f64>, nv: usize) -> State {
    let mut random = Random::new(7);
    let mut numbers = || (0..nv).map(|_| random.signed()).collect::<Vec<f64>>();
    State { q, v: numbers(), tau: numbers() }
}

pub(super) fn scenes() -> Vec<Scene> {
    let mut all = Vec::new();
    for decade in [2, 5, 8] {
        let needles = Chain {
            axes: (0..12).map(|k| k % 3).collect(),
            radius: 10f64.powi(-decade),
            ..Chain::uniform(12)
        };
        let what = "twelve rods of that radius over length, axes along and across them in turn";
        all.push(chain(format!("needles-1e-{decade}"), what, needles));
    }
    let lines = Chain { axes: vec![1, 2, 0], radius: 0.0, ..Chain::uniform(3) };
    all.push(chain("lines", "rods without thickness, the last about its own line: nothing resists", lines));
    let mut middle = Chain::uniform(10);
    middle.masses[4] = 0.0;
    all.push(chain("massless-middle", "a body without mass in the middle of ten rods", middle));
    let mut two = Chain::uniform(10);
    (two.masses[3], two.masses[4]) = (0.0, 0.0);
    all.push(chain("massless-two", "two bodies without mass, one on the other", two));
    let mut tip = Chain::uniform(10);
    tip.masses[9] = 0.0;
    all.push(chain("massless-tip", "a tip without mass: nothing resists its joint", tip));
    for (name, moment) in [("1e-12", 1e-12), ("1e-30", 1e-30), ("1e-200", 1e-200), ("1e-310", 1e-310)] {
        let what = "a tip whose moment about its joint is that, kg·m², on two bricks";
        all.push(scene(format!("hinge-inertia-{name}"), what, move || {
            let tip = Inertia::from_principal(1.0, [0.2, 0.0, 0.0], [moment, 0.1, 0.1]);
            let model = series(vec![(axis(1), brick()), (axis(2), brick()), (axis(0), tip)]);
            let mut state = at(vec![0.3, 0.4, 0.5], 3);
            // A force that such a hinge can bear.
            state.tau[2] *= moment;
            Call::new(model, state)
        }));
    }
    for (name, mass) in [("1e-100", 1e-100f64), ("1e-300", 1e-300), ("1e-310", 1e-310)] {
        all.push(scene(format!("mass-{name}"), "ten rods of that mass each, kg", move || {
            let of = |mass: f64| {
                let light = Chain { masses: vec![mass; 10], ..Chain::uniform(10) };
                (light.model(), light.state(600, 0.5, 1.0))
            };
            let (model, state) = of(mass);
            // Masses and forces by a power of two: the same accelerations.
            let (heavier, its_state) = of(mass * 2f64.powi(900));
            Call { twin: heavier.ok().map(|m| (m, its_state)), ..Call::new(model, state) }
        }));
    }
    let heavy = Chain { masses: vec![1e55; 10], ..Chain::uniform(10) };
    all.push(chain("mass-1e55", "ten rods of that mass each, kg", heavy));
    all.push(scene("denormal-state", "rates, forces and gravity of 1e-310", || {
        let weak = Chain { gravity: 1e-310, ..Chain::uniform(10) };
        let mut state = weak.state(600, 0.5, 1e-310);
        state.tau.iter_mut().for_each(|x| *x *= 1e-310);
        Call::new(weak.model(), state)
    }));
    let gimbal = |middle: f64| {
        move || {
            // Rings without mass: three axes that lie in one plane at 90°.
            let model = ModelBuilder::new("gimbal")
                .gravity([0.0, -9.81, 0.0])
                .body(Body::new("outer", Inertia::ZERO))
                .body(Body::new("inner", Inertia::ZERO))
                .body(Body::new("rotor", brick()))
                .joint(Joint::new("yaw", axis(2)), "world", "outer")
                .joint(Joint::new("pitch", axis(1)), "outer", "inner")
                .joint(Joint::new("roll", axis(0)), "inner", "rotor")
                .build();
            Call::new(model, at(vec![0.3, middle, 0.4], 3))
        }
    };
    for decade in [2, 6] {
        let what =
            "massless gimbal rings, that far from the position in which their axes lie in a plane, rad";
        all.push(scene(format!("gimbal-1e-{decade}"), what, gimbal(FRAC_PI_2 - 10f64.powi(-decade))));
    }
    all.push(scene("gimbal-locked", "massless gimbal rings at 90° to the last bit", gimbal(FRAC_PI_2)));
    all.push(scene("universal-90", "a universal joint of bricks at 90°", || {
        let kind = JointKind::Universal { axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };
        Call::new(series(vec![(kind, brick()), (axis(2), brick())]), at(vec![0.4, FRAC_PI_2, 0.3], 3))
    }));
    all.push(scene("ball-at-pi", "spherical joints turned by half a turn", || {
        let q = vec![1.0, 0.0, 0.0, 0.0, SQRT_2 / 2.0, SQRT_2 / 2.0, 0.0, 0.0];
        let ball = JointKind::Spherical;
        Call::new(series(vec![(ball, brick()), (ball, brick())]), at(q, 6))
    }));
    all.push(scene("moments-1e-6", "a body of principal moments 1e-6, 1, 1 on a ball", || {
        let needle = Inertia::from_principal(1.0, [0.0; 3], [1e-6, 1.0, 1.0]);
        Call::new(series(vec![(JointKind::Spherical, needle)]), at(vec![0.1, 0.2, 0.3, 0.86f64.sqrt()], 3))
    }));
    all.push(scene("negative-moment", "a body of moments −1, 1, 1", || {
        let no_body = Inertia::from_principal(1.0, [0.0; 3], [-1.0, 1.0, 1.0]);
        Call::new(series(vec![(axis(1), no_body)]), at(vec![0.3], 1))
    }));
    all
}
