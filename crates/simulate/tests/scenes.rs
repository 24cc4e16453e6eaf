//! Scene files: what they mean, and what is said of wrong ones.

use phipsi_formats::Problem;
use phipsi_simulate::scene::{Scene, parse};
use phipsi_simulate::{Recording, SimulateError, run};
use std::path::Path;

const PENDULUM: &str = r#"
title = "pendulum"
[[body]]
name = "rod"
inertial = { mass = 1.0, origin = { xyz = [0.5, 0, 0] }, inertia = { iyy = 0.0833333333, izz = 0.0833333333 } }
[[joint]]
name = "hinge"
type = "continuous"
parent = "world"
child = "rod"
axis = [0, 1, 0]
[initial]
q.hinge = 0.3
[integrator]
t_end = 2
rtol = 1e-10
[outputs]
angle = { joint = "hinge" }
height = { body = "rod", point = [1, 0, 0], axis = "z" }
energy = { energy = "total" }
"#;

fn scene(text: &str) -> Result<Scene, SimulateError> {
    parse(text.into(), "test", "test.toml", Path::new(""), &[])
}

fn errors(text: &str) -> Vec<Problem> {
    match scene(text) {
        Ok(_) => panic!("accepted: {text}"),
        Err(SimulateError::Scene(reports)) => reports.into_iter().flat_map(|r| r.errors).collect(),
        Err(e) => panic!("{e}"),
    }
}

/// The only error of the pendulum with `old` replaced by `new`.
fn error(old: &str, new: &str) -> Problem {
    assert!(PENDULUM.contains(old));
    let mut found = errors(&PENDULUM.replace(old, new));
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

#[test]
fn a_scene_runs_and_measures() {
    let mut scene = scene(PENDULUM).unwrap();
    let mut recording = Recording::default();
    let summary = run(&mut scene.simulation, &mut recording).unwrap();
    let value = |name: &str| summary.outputs.iter().find(|(n, _)| n == name).unwrap().1;
    assert_eq!(value("angle"), summary.q[0]);
    assert!((value("height") + summary.q[0].sin()).abs() < 4.0 * f64::EPSILON);
    // It starts at rest: its energy is that of its height, m g z of the centre of mass.
    assert!((value("energy") + 9.80665 * 0.5 * 0.3f64.sin()).abs() < 1e-9);
    assert_eq!(recording.rows.last().unwrap().t, 2.0);
}

#[test]
fn unknown_keys_and_words_come_with_a_suggestion() {
    let e = error("rtol = 1e-10", "rtoll = 1e-10");
    assert_eq!((e.line, e.remedy.as_str()), (Some(16), "did you mean `rtol`?"));
    assert_eq!(error("[initial]", "[inital]").remedy, "did you mean `initial`?");
    assert_eq!(error("type = \"continuous\"", "type = \"continous\"").remedy, "did you mean `continuous`?");
    let e = error("q.hinge = 0.3", "q.hing = 0.3");
    assert_eq!((e.line, e.remedy.as_str()), (Some(13), "did you mean `hinge`?"));
    assert_eq!(error("joint = \"hinge\" }", "joint = \"hingee\" }").remedy, "did you mean `hinge`?");
}

#[test]
fn wrong_values_say_what_is_required() {
    assert!(error("rtol = 1e-10", "rtol = nan").required.contains("finite"));
    assert!(error("rtol = 1e-10", "rtol = 1").required.contains("1e-14"));
    assert!(error("t_end = 2", "t_end = -2").required.contains("above 0"));
    assert!(error("t_end = 2\n", "").found.contains("no `t_end`"));
    assert!(error("t_end = 2", "t_end = 1979-05-27").found.contains("1979"));
    assert!(error("q.hinge = 0.3", "q.hinge = [1, 2]").required.contains("1 finite"));
    assert!(error("q.hinge = 0.3", "q.hinge = inf").required.contains("finite"));
    assert!(error("mass = 1.0", "mass = -1.0").found.contains("mass"));
    assert!(error("axis = [0, 1, 0]", "axis = [0, 0, 0]").found.contains("axis"));
    assert!(error("parent = \"world\"", "parent = \"wold\"").found.contains("wold"));
    assert!(error("rtol = 1e-10", "step = 0.1").found.contains("step"));
    assert!(error("rtol = 1e-10", "method = \"rk4\"").remedy.contains("step"));
    assert!(error("[integrator]", "[record]\nevery = 1e-12\n[integrator]").found.contains("samples"));
}

#[test]
fn a_joint_without_inertia_is_named() {
    let text = PENDULUM.replace("inertial = { mass", "# inertial = { mass");
    let found = errors(&text);
    assert!(
        found[0].place.contains("hinge") && found[0].found.contains("no articulated inertia"),
        "{found:?}"
    );
}

#[test]
fn forces_name_what_is_wrong_with_them() {
    let with = |force: &str| errors(&format!("{PENDULUM}\n[[force]]\n{force}\n"));
    let first = |force: &str| with(force)[0].to_owned();
    assert!(first("kind = \"sprng\"").remedy.contains("spring"));
    assert!(first("joint = \"hinge\"").found.contains("no `kind`"));
    assert!(first("kind = \"torque\"\njoint = \"hinge\"").found.contains("no `value`"));
    assert!(first("kind = \"torque\"\njoint = \"hinge\"\nvalue = \"sin(x)\"").found.contains('x'));
    assert!(
        first("kind = \"torque\"\njoint = \"hinge\"\nvalue = [[1, 0], [0, 0]]")
            .required
            .contains("increasing")
    );
    assert!(
        first("kind = \"spring\"\nbody_a = \"rod\"\nbody_b = \"rod\"\nstiffness = 1")
            .found
            .contains("one body")
    );
    assert!(first("kind = \"wrench\"\nbody = \"world\"").found.contains("world"));
    assert!(first("kind = \"servo\"\njoint = \"hinge\"\ntarget = 0").found.contains("no `stiffness`"));
    assert!(first("kind = \"damper\"\njoint = \"hinge\"\ndamping = -1").required.contains("at least 0"));
    assert!(
        first("kind = \"torque\"\njoint = \"hinge\"\ncomponent = 1\nvalue = 0")
            .required
            .contains("degree of freedom")
    );
}

#[test]
fn every_kind_of_force_is_read() {
    let forces = r#"
[[force]]
kind = "torque"
joint = "hinge"
value = "0.1*sin(2*pi*t)"
[[force]]
kind = "torque"
joint = "hinge"
value = [[0, 0], [1, 0.2], [1.5, 0]]
[[force]]
kind = "servo"
joint = "hinge"
target = 0.1
stiffness = 2
damping = 0.1
integral = 0.3
limit = 5
[[force]]
kind = "spring"
joint = "hinge"
stiffness = 1
rest = 0.2
[[force]]
kind = "spring"
name = "cord"
body_a = "world"
point_a = [0, 0, 1]
body_b = "rod"
point_b = [1, 0, 0]
stiffness = 3
rest_length = 0.5
[[force]]
kind = "damper"
body_a = "world"
body_b = "rod"
point_b = [1, 0, 0]
damping = 0.1
[[force]]
kind = "wrench"
body = "rod"
point = [1, 0, 0]
axes = "world"
force = [0, 0, "exp(-t)"]
"#;
    let mut scene = scene(&format!("{PENDULUM}{forces}")).unwrap();
    assert_eq!(scene.simulation.dynamics.forces().len(), 7);
    let summary = run(&mut scene.simulation, &mut Recording::default()).unwrap();
    // Work of all of them is integrated with the state at the run's tolerance.
    assert!(summary.energy_error < 1e-8, "{}", summary.energy_error);
}

#[test]
fn limits_that_are_passed_are_told_with_joint_and_time() {
    let text = PENDULUM
        .replace("type = \"continuous\"", "type = \"revolute\"\nlimit = { lower = -0.5, upper = 0.5 }");
    let mut scene = scene(&text).unwrap();
    let summary = run(&mut scene.simulation, &mut Recording::default()).unwrap();
    let [limit] = &summary.limits[..] else { panic!("{:?}", summary.limits) };
    assert_eq!((limit.joint.as_str(), limit.limit), ("hinge", 0.5));
    // From 0.3 rad at rest, the rod takes 0.17 … 0.21 s to fall to 0.5 rad: ½ (3 g/2 cos q) t² = 0.2.
    assert!(limit.between[0] < 0.21 && limit.between[1] > 0.16, "{limit:?}");
}

#[test]
fn friction_is_reported_as_approximated_with_its_speed() {
    let text = PENDULUM.replace("axis = [0, 1, 0]", "axis = [0, 1, 0]\ndynamics = { friction = 0.1 }")
        + "[model]\nfriction_speed = 0.01\n";
    let scene = scene(&text).unwrap();
    let notes: Vec<String> = scene.reports[0].approximated.iter().map(|n| n.what.clone()).collect();
    assert!(notes.iter().any(|n| n.contains("regularised") && n.contains("0.01")), "{notes:?}");
}

#[test]
fn mimic_couples_joints_unless_it_is_free() {
    let second = r#"
[[body]]
name = "tip"
inertial = { mass = 1.0, origin = { xyz = [0.5, 0, 0] }, inertia = { iyy = 0.1, izz = 0.1 } }
[[joint]]
name = "follower"
type = "continuous"
parent = "rod"
child = "tip"
axis = [0, 1, 0]
mimic = { joint = "hinge" }
"#;
    let text = format!("{PENDULUM}{second}");
    // The start names 0.3 rad of the hinge, which the other joint does not have.
    assert!(errors(&text)[0].remedy.contains("assemble = true"));
    let mut coupled = scene(&text.replace("q.hinge = 0.3", "q.hinge = 0.3\nassemble = true")).unwrap();
    let mut recording = Recording::default();
    let summary = run(&mut coupled.simulation, &mut recording).unwrap();
    assert!(recording.rows.iter().all(|r| (r.q[0] - r.q[1]).abs() < 1e-14));
    assert!(summary.energy_error < 1e-9 && summary.q[0] != 0.3, "{summary:?}");
    let free = text.replace("title = \"pendulum\"", "title = \"pendulum\"\n[model]\nmimic = \"free\"");
    let scene = scene(&free).unwrap();
    assert!(scene.reports[0].approximated.iter().any(|n| n.what.contains("mimic")));
}

#[test]
fn kinks_and_jumps_of_expressions_are_found_to_the_last_bit() {
    let force = "[[force]]\nkind = \"torque\"\njoint = \"hinge\"\nvalue = \"min(t/0.7, 1) + 0.1*step(sin(2*pi*t)) + floor(t/0.3)*0\"\n";
    let scene = scene(&format!("{PENDULUM}\n{force}")).unwrap();
    let breaks = scene.simulation.dynamics.breaks();
    // 0·floor is left out when the expression is read; the sine changes sign at every half second.
    for want in [0.5, 0.7, 1.0, 1.5] {
        assert!(breaks.iter().any(|b| (b - want).abs() <= 4.0 * f64::EPSILON), "{want}: {breaks:?}");
    }
    assert!(breaks.contains(&0.7) && breaks.len() <= 6, "{breaks:?}");
}

#[test]
fn the_midpoint_method_keeps_energy_to_second_order_and_lands_on_its_steps() {
    let noise = |step: &str| {
        let text = PENDULUM.replace("rtol = 1e-10", &format!("method = \"midpoint\"\nstep = {step}"));
        let mut scene = scene(&text).unwrap();
        let mut recording = Recording::default();
        let summary = run(&mut scene.simulation, &mut recording).unwrap();
        assert_eq!(recording.rows.last().unwrap().t, 2.0);
        assert!(summary.error_estimate.is_none());
        summary.energy_error
    };
    let (coarse, fine) = (noise("0.01"), noise("0.005"));
    let order = (coarse / fine).log2();
    assert!((order - 2.0).abs() < 0.1, "{coarse:e} {fine:e}");
    let midpoint = "rtol = 1e-10";
    assert!(error(midpoint, "method = \"midpoint\"\nstep = 0.3").required.contains("whole number"));
    assert!(error(midpoint, "method = \"midpoint\"").remedy.contains("step"));
    let driven = format!(
        "{}\n[[force]]\nkind = \"torque\"\njoint = \"hinge\"\nvalue = 1\n",
        PENDULUM.replace(midpoint, "method = \"midpoint\"\nstep = 0.01")
    );
    let failed = run(&mut scene(&driven).unwrap().simulation, &mut Recording::default()).unwrap_err();
    assert!(failed.to_string().contains("`torque 0` has no potential energy"), "{failed}");
}

/// The form of forward dynamics: what the model needs, or what is asked for; said by the plan.
#[test]
fn the_plan_names_the_form_of_forward_dynamics() {
    let form = |text: &str| scene(text).unwrap().simulation.form();
    let (name, why) = form(PENDULUM).unwrap();
    assert_eq!(name, "plain");
    assert!(why.contains("error at the states tried"), "{why}");
    for asked in ["plain", "refined", "square_root", "double_double"] {
        let text = PENDULUM.replace("rtol = 1e-10", &format!("rtol = 1e-10\nform = \"{asked}\""));
        assert_eq!(form(&text), Some((asked, "asked for".into())));
        let mut scene = scene(&text).unwrap();
        assert_eq!(
            phipsi_simulate::folder::results::Plan::new(&scene.simulation).form.as_deref(),
            Some(asked)
        );
        let summary = run(&mut scene.simulation, &mut Recording::default()).unwrap();
        assert!(summary.energy_error < 1e-9, "{asked}: {:e}", summary.energy_error);
    }
    let midpoint = PENDULUM.replace("rtol = 1e-10", "method = \"midpoint\"\nstep = 0.01");
    assert_eq!(form(&midpoint), None);
    let e = error("rtol = 1e-10", "method = \"midpoint\"\nstep = 0.01\nform = \"plain\"");
    assert!(e.remedy.contains("form") && e.line.is_some(), "{e:?}");
    let e = error("rtol = 1e-10", "form = \"square_rot\"");
    assert_eq!(e.remedy, "did you mean `square_root`?");
}

/// A tip a million million times heavier than ten links: `auto` takes the square-root form.
#[test]
fn a_heavy_tip_gets_the_square_root_form() {
    let mut text = String::from("title = \"chain\"\n");
    let mut parent = "world".to_string();
    for k in 0..10 {
        let mass = if k == 9 { 1e12 } else { 1.0 };
        let moment = mass / 12.0;
        let x = if k == 0 { 0.0 } else { 1.0 };
        let axis = if k % 2 == 0 { "[0, 1, 0]" } else { "[0, 0, 1]" };
        text += &format!(
            "[[body]]\nname = \"b{k}\"\ninertial = {{ mass = {mass}, origin = {{ xyz = [0.5, 0, 0] }}, \
             inertia = {{ ixx = {}, iyy = {moment}, izz = {moment} }} }}\n\
             [[joint]]\nname = \"j{k}\"\ntype = \"continuous\"\nparent = \"{parent}\"\nchild = \"b{k}\"\n\
             axis = {axis}\norigin = {{ xyz = [{x}, 0, 0] }}\n",
            0.01 * mass
        );
        parent = format!("b{k}");
    }
    text += "[integrator]\nt_end = 0.1\n";
    let scene = scene(&text).unwrap();
    let (name, why) = scene.simulation.form().unwrap();
    assert_eq!(name, "square_root", "{why}");
    assert!(why.contains("of the plain form"), "{why}");
}

const BOOM: &str = r#"
title = "boom"
[[body]]
name = "boom"
flexible = { length = 1, mass_per_length = 1, bending_stiffness = [30, 20], bending = [1, 1], stiffened = true }
[[body]]
name = "camera"
inertial = { mass = 0.2, origin = { xyz = [0.1, 0, 0] }, inertia = { ixx = 1e-3, iyy = 1e-3, izz = 1e-3 } }
[[joint]]
name = "root"
type = "continuous"
parent = "world"
child = "boom"
axis = [0, 1, 0]
[[joint]]
name = "mount"
type = "fixed"
parent = "boom"
node = "tip"
child = "camera"
[integrator]
t_end = 0.5
rtol = 1e-10
[outputs]
height = { body = "camera", axis = "z" }
energy = { energy = "total" }
"#;

/// A boom with a camera swings under gravity, with its energy.
#[test]
fn a_flexible_boom_swings() {
    let mut scene = scene(BOOM).unwrap();
    let mut recording = Recording::default();
    let summary = run(&mut scene.simulation, &mut recording).unwrap();
    let value = |name: &str| summary.outputs.iter().find(|(n, _)| n == name).unwrap().1;
    assert_eq!(summary.q.len(), 1 + 2 * 3);
    // It starts straight and at rest on the height of its joint.
    assert!(value("energy").abs() < 1e-8, "{}", value("energy"));
    assert!(value("height") < -0.5, "{}", value("height"));
    assert!(summary.q[1..].iter().any(|x| x.abs() > 1e-4), "{:?}", summary.q);
}

#[test]
fn mistakes_in_flexible_bodies_are_named() {
    let error = |old: &str, new: &str| {
        assert!(BOOM.contains(old));
        let found = errors(&BOOM.replace(old, new));
        assert_eq!(found.len(), 1, "{found:?}");
        format!("{} {} {} {}", found[0].place, found[0].found, found[0].required, found[0].remedy)
    };
    assert!(error("node = \"tip\"", "node = \"end\"").contains("no node `end`"));
    assert!(error("mass_per_length = 1,", "").contains("mass_per_length"));
    assert!(error("bending = [1, 1]", "bending = [1.5, 1]").contains("whole numbers"));
    assert!(error("stiffened = true", "stifened = true").contains("stiffened"));
}
