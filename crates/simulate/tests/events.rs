//! Events, joint stops and dry friction in scenes.

use phipsi_formats::Problem;
use phipsi_simulate::folder::{RunFolder, Watcher};
use phipsi_simulate::scene::{Scene, parse};
use phipsi_simulate::{Recording, SimulateError, Summary, run};
use std::cell::Cell;
use std::path::Path;

/// A ball of 1 kg over the ground.
const BALL: &str = r#"
[model]
gravity = [0, 0, -10]
[[body]]
name = "ball"
inertial = { mass = 1.0, inertia = { ixx = 0.1, iyy = 0.1, izz = 0.1 } }
[[joint]]
name = "height"
type = "prismatic"
parent = "world"
child = "ball"
axis = [0, 0, 1]
limit = { lower = 0 }
dynamics = { friction = 0.0 }
[initial]
q.height = 1.25
[integrator]
t_end = 4
[joint_stops]
restitution = 0.5
[outputs]
top = { body = "ball", point = [0, 0, 0.1], axis = "z" }
energy = { energy = "total" }
"#;

fn scene(text: &str) -> Result<Scene, SimulateError> {
    parse(text.into(), "test", "test.toml", Path::new(""), &[])
}

fn ran(text: &str) -> (Summary, Recording) {
    let mut scene = scene(text).unwrap();
    let mut recording = Recording::default();
    let summary = run(&mut scene.simulation, &mut recording).unwrap();
    (summary, recording)
}

fn error(old: &str, new: &str) -> Problem {
    assert!(BALL.contains(old));
    match scene(&BALL.replace(old, new)) {
        Ok(_) => panic!("accepted: {new}"),
        Err(SimulateError::Scene(reports)) => reports.into_iter().flat_map(|r| r.errors).next().unwrap(),
        Err(e) => panic!("{e}"),
    }
}

#[test]
fn limits_are_stops_where_a_scene_says_so() {
    let (summary, _) = ran(BALL);
    // Half a second of fall, then flights of 1, 1/2, 1/4 … seconds up to 2.5 s.
    let impacts: Vec<f64> = summary.events.iter().filter(|e| e.kind == "impact").map(|e| e.t).collect();
    assert!((impacts[0] - 0.5).abs() < 1e-14 && (impacts[1] - 1.0).abs() < 1e-13, "{impacts:?}");
    let rest: Vec<_> = summary.events.iter().filter(|e| e.kind == "rest").collect();
    assert!(rest.len() == 1 && rest[0].endless && (rest[0].t - 1.5).abs() < 1e-9, "{rest:?}");
    assert!(rest[0].what.contains("height") && rest[0].what.contains("infinitely many"));
    assert_eq!((summary.q[0], summary.v[0]), (0.0, 0.0));
    assert!(summary.energy_error < 1e-12 && summary.limits.is_empty());
    // Impacts are found by both runs of the estimate.
    let estimate = summary.error_estimate.unwrap();
    assert_eq!(estimate.q, Some(0.0), "{estimate:?}");
    let without = BALL.replace("[joint_stops]\nrestitution = 0.5\n", "");
    let (summary, _) = ran(&without);
    assert!(summary.events.is_empty());
    assert!(summary.limits[0].describe().contains("joint_stops"));
}

#[test]
fn events_are_recorded_or_stop_the_run() {
    let with = |more: &str| format!("{BALL}\n{more}\n");
    let (summary, _) = ran(&with(
        "[[event]]\nname = \"half way\"\nwhen = \"top - 0.725\"\n\
         [[event]]\nname = \"up\"\nwhen = \"q.height - 0.1\"\ndirection = \"rising\"\n\
         [[event]]\nname = \"clock\"\nwhen = \"t - 0.25\"",
    ));
    let of = |name: &str| -> Vec<f64> {
        summary.events.iter().filter(|e| e.kind == "event" && e.name == name).map(|e| e.t).collect()
    };
    assert!((of("half way")[0] - 0.125f64.sqrt()).abs() < 1e-14 && of("half way").len() == 1);
    // The first rebound is 0.3125 m high, the second 0.078 m.
    assert!((of("up")[0] - (0.75 - (2.0f64 * 0.2125 / 10.0).sqrt())).abs() < 1e-13 && of("up").len() == 1);
    assert_eq!(of("clock"), [0.25]);
    let (summary, recording) =
        ran(&with("[[event]]\nname = \"low\"\nwhen = \"top - 0.35\"\naction = \"stop\""));
    let t = (2.0f64 * 1.0 / 10.0).sqrt();
    assert!(summary.ended_by_event && summary.finished && (summary.t - t).abs() < 1e-14);
    let last = recording.rows.last().unwrap();
    assert!(last.t == summary.t && (last.q[0] - 0.25).abs() < 1e-14);
    assert!(recording.rows.windows(2).all(|w| w[0].t < w[1].t));
    assert!(summary.error_estimate.unwrap().q.is_some());
}

#[test]
fn friction_of_a_scene_sticks() {
    let text = BALL
        .replace("friction = 0.0", "friction = 2.0")
        .replace("gravity = [0, 0, -10]", "gravity = [0, 0, 0]")
        .replace("q.height = 1.25", "q.height = 1.25\nv.height = 1.0");
    let (summary, _) = ran(&text);
    // v²/(2f) m after v/f s.
    assert!((summary.q[0] - 1.5).abs() < 1e-14 && summary.v[0] == 0.0, "{:?}", summary.q);
    let stick = summary.events.iter().find(|e| e.kind == "stick").unwrap();
    assert!((stick.t - 0.5).abs() < 1e-14 && stick.what.contains("height"));
    assert!(summary.energy_error < 1e-13);
    // A breakaway force of 3 N holds against 2.9 N; regularised friction is still there where a scene asks for it.
    let pushed = format!(
        "{}\n[[force]]\nkind = \"torque\"\njoint = \"height\"\nvalue = 2.9\n[friction]\nbreakaway_ratio = {{ height = 1.5 }}\n",
        text.replace("v.height = 1.0", "v.height = 0.0")
    );
    assert_eq!(ran(&pushed).0.q[0], 1.25);
    let creeping = scene(&text.replace("[model]", "[model]\nfriction_speed = 0.01")).unwrap();
    assert!(creeping.simulation.approximated[0].contains("regularised"));
}

#[test]
fn wrong_events_and_stops_say_what_is_required() {
    let event = |more: &str| error("[outputs]", &format!("[[event]]\n{more}\n[outputs]"));
    assert!(event("name = \"x\"").found.contains("no `when`"));
    assert!(event("when = \"tpo - 1\"").found.contains("tpo"));
    assert!(event("when = \"enery - 1\"").remedy.contains("outputs"));
    assert!(event("when = \"2\"").found.contains("never changes"));
    assert!(event("when = \"t\"\naction = \"halt\"").required.contains("stop"));
    assert!(error("restitution = 0.5", "restitution = 1.5").required.contains("from 0 to 1"));
    assert!(error("restitution = 0.5", "restitution = { heigt = 0.5 }").remedy.contains("height"));
    let e = scene(
        &BALL
            .replace("limit = { lower = 0 }", "")
            .replace("restitution = 0.5", "restitution = { height = 0.5 }"),
    );
    let Err(SimulateError::Scene(reports)) = e else { panic!("accepted") };
    assert!(reports[0].errors[0].found.contains("no limits"));
    assert!(error("restitution = 0.5", "").found.contains("no `restitution`"));
    let e = error("t_end = 4", "t_end = 4\nmethod = \"midpoint\"\nstep = 0.1");
    assert!(e.found.contains("midpoint") && e.found.contains("stops"), "{e:?}");
}

/// Stops after some steps, again and again.
struct Impatient {
    left: Cell<u32>,
}

impl Watcher for Impatient {
    fn step(&mut self, _: f64, _: f64) {
        self.left.set(self.left.get().saturating_sub(1));
    }
    fn stop(&self) -> bool {
        self.left.get() == 0
    }
}

/// A run with impacts, stick and slip that is interrupted every few steps ends with the bytes of one that is not.
#[test]
fn a_run_with_events_resumes_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.toml");
    let text = BALL
        .replace("friction = 0.0", "friction = 1.0")
        .replace("restitution = 0.5", "restitution = 0.8")
        + "[[force]]\nkind = \"torque\"\njoint = \"height\"\nvalue = \"12*sin(7*t)\"\n\
           [[event]]\nwhen = \"top - 0.2\"\n[[event]]\nname = \"end\"\nwhen = \"t - 3.3\"\naction = \"stop\"\n";
    std::fs::write(&path, &text).unwrap();
    let load = || phipsi_simulate::scene::load(&path, &[]).unwrap();
    let whole = folder.path().join("whole");
    let one = RunFolder::create(&path, load(), Some(&whole)).unwrap();
    let one = one.run(&mut Impatient { left: Cell::new(u32::MAX) }).unwrap();
    let parts = folder.path().join("parts");
    let mut made = RunFolder::create(&path, load(), Some(&parts)).unwrap();
    let mut rounds = 0;
    let other = loop {
        let outcome = made.run(&mut Impatient { left: Cell::new(3) }).unwrap();
        rounds += 1;
        if outcome.finished {
            break outcome;
        }
        made = RunFolder::open(&parts, None).unwrap();
    };
    let bytes = |folder: &Path| std::fs::read(folder.join("trajectory.csv")).unwrap();
    assert!(rounds > 10, "{rounds}");
    assert_eq!(bytes(&whole), bytes(&parts));
    let (a, b) = (one.file.results.unwrap(), other.file.results.unwrap());
    assert_eq!(a.events, b.events);
    assert_eq!((a.end.q, a.end.v, a.ended_by), (b.end.q, b.end.v, Some("end".to_string())));
    for kind in ["impact", "event", "slip"] {
        assert!(a.events.iter().any(|e| e.kind == kind), "no {kind}");
    }
    assert!(std::fs::read_to_string(whole.join("index.html")).unwrap().contains("struck its lower stop"));
}

/// A free body on a circular orbit that a pair of opposite pulses leaves as it was, but for where it is.
#[test]
fn satellites_have_thrusters_and_a_planet() {
    let text = r#"
[model]
gravity = [0, 0, 0]
[[body]]
name = "bus"
inertial = { mass = 10.0, inertia = { ixx = 1, iyy = 2, izz = 3 } }
[[joint]]
name = "base"
type = "floating"
parent = "world"
child = "bus"
[initial]
q.base = [100, 0, 0, 0, 0, 0, 1]
v.base = [0, 0, 0.1, 0, 10, 0]
[integrator]
t_end = 62.83185307179586
rtol = 1e-11
[[force]]
kind = "central_gravity"
mu = 1e4
[[force]]
kind = "thruster"
body = "bus"
direction = [0, 0, 2]
thrust = 1e-3
on = [[1, 2], [3, 4]]
specific_impulse = 200
[outputs]
far = { body_a = "world", body_b = "bus" }
"#;
    let (summary, _) = ran(text);
    // Across the orbit it is pushed by 2e-4 m/s; the radius changes by squares of that, and by the size of the body over 100 m.
    assert!((summary.outputs[0].1 - 100.0).abs() < 1e-3, "{:?}", summary.outputs);
    assert!(summary.energy_error < 1e-10, "{:e}", summary.energy_error);
    let wrong = scene(&text.replace("on = [[1, 2], [3, 4]]", "on = [[1, 2], [1.5, 4]]"));
    let Err(SimulateError::Scene(reports)) = wrong else { panic!("accepted") };
    assert!(reports[0].errors[0].required.contains("do not overlap"));
}

/// A wheel, a thruster and a planet act in one tree. At (0, 0, r), with the orbit about +y: the wheel's torque τ turns the bus by −τ, which the
/// gravity gradient answers as a spring: pitch −τ (1 − cos ωt)/(3n² (I_x − I_z)) with ω² = 3n² (I_x − I_z)/I_y of the bus; the thruster pushes
/// across the orbit: y = F (1 − cos nt)/(m n²).
#[test]
fn a_wheel_a_thruster_and_a_gravity_gradient_act_in_one_tree() {
    let (mu, r, torque, thrust) = (3.986_004_418e14f64, 7e6f64, 1e-7, 1e-3);
    let n = (mu / r.powi(3)).sqrt();
    let omega = n * (3.0f64 * 300.0 / 600.0).sqrt();
    let t_end = 0.7 * std::f64::consts::TAU / omega;
    let text = format!(
        r#"
[model]
gravity = [0, 0, 0]
[[body]]
name = "bus"
inertial = {{ mass = 1000, inertia = {{ ixx = 500, iyy = 600, izz = 200 }} }}
[[body]]
name = "wheel"
inertial = {{ mass = 10, inertia = {{ ixx = 0.25, iyy = 0.5, izz = 0.25 }} }}
[[joint]]
name = "base"
type = "floating"
parent = "world"
child = "bus"
[[joint]]
name = "spin"
type = "continuous"
parent = "bus"
child = "wheel"
axis = [0, 1, 0]
[initial]
q.base = [0, 0, {r}, 0, 0, 0, 1]
v.base = [0, {n}, 0, {}, 0, 0]
[integrator]
t_end = {t_end}
rtol = 1e-12
[[force]]
kind = "central_gravity"
mu = {mu}
[[force]]
kind = "torque"
joint = "spin"
value = {torque}
[[force]]
kind = "thruster"
body = "bus"
direction = [0, 1, 0]
thrust = {thrust}
specific_impulse = 200
"#,
        n * r
    );
    let (summary, _) = ran(&text);
    let q = &summary.q;
    let whole = std::f64::consts::TAU;
    let pitch = 2.0 * q[4].atan2(q[6]) - q[0].atan2(q[2]);
    let pitch = pitch - whole * (pitch / whole).round();
    let want = -torque / (3.0 * n * n * 300.0) * (1.0 - (omega * t_end).cos());
    // The gradient goes with ½ sin 2θ = θ − ⅔ θ³: θ² of the pitch, and as much of its phase, which is some 4 rad. The attitude is
    // integrated to 1e-12 a step, the pitch is 1e-4.
    let allowed = want.abs() * (6.0 * want * want + 1e-6);
    assert!((pitch - want).abs() < allowed, "{pitch:e} instead of {want:e}");
    let across = thrust / (1010.0 * n * n) * (1.0 - (n * t_end).cos());
    // The bus rolls by as much as y/r.
    assert!((q[1] - across).abs() < 1e-6 * across, "{} instead of {across}", q[1]);
    // J (ω + Ω) of the wheel gains τ t.
    let own = 0.5 * (summary.v[1] - n + summary.v[6]);
    assert!((own - torque * t_end).abs() < 1e-6 * torque * t_end, "{own} instead of {}", torque * t_end);
    assert!(summary.energy_error < 1e-10, "{:e}", summary.energy_error);
}

/// A falling ball of 1 kg at q = 1.25 m: at a kinetic energy of 2 J it has fallen by 0.2 m, under the midpoint method too, whose steps under a
/// constant force are exact; the total passes nothing until the stop takes from it.
#[test]
fn energies_are_events() {
    let outputs = "[outputs]\nkinetic = { energy = \"kinetic\" }";
    let text = BALL.replace("[outputs]", outputs)
        + "[[event]]\nname = \"two\"\nwhen = \"kinetic - 2\"\ndirection = \"rising\"\n\
           [[event]]\nname = \"loss\"\nwhen = \"energy - 12\"\n";
    let (summary, _) = ran(&text);
    let of = |summary: &Summary, name: &str| -> Vec<f64> {
        summary.events.iter().filter(|e| e.kind == "event" && e.name == name).map(|e| e.t).collect()
    };
    assert!((of(&summary, "two")[0] - 0.2).abs() < 1e-14, "{:?}", summary.events);
    assert_eq!(of(&summary, "loss"), [summary.events.iter().find(|e| e.kind == "impact").unwrap().t]);
    let falling = text
        .replace("[joint_stops]\nrestitution = 0.5\n", "")
        .replace("limit = { lower = 0 }\ndynamics = { friction = 0.0 }", "")
        .replace("t_end = 4", "t_end = 0.5\nmethod = \"midpoint\"\nstep = 0.05");
    let (summary, recording) = ran(&falling);
    assert!((of(&summary, "two")[0] - 0.2).abs() < 1e-14 && summary.events.len() == 1);
    assert_eq!((summary.t, recording.rows.len()), (0.5, 11));
    let (summary, recording) = ran(&falling.replace("direction = \"rising\"", "action = \"stop\""));
    assert!(summary.ended_by_event && (summary.t - 0.2).abs() < 1e-14, "{}", summary.t);
    let last = recording.rows.last().unwrap();
    assert!(last.t == summary.t && (last.q[0] - 1.05).abs() < 1e-14, "{last:?}");
    assert!(summary.energy_error < 1e-14);
}

/// A flexible boom with stops and friction runs as it is, without a law that creeps.
#[test]
fn booms_have_stops_and_friction() {
    let boom =
        "flexible = { length = 1, mass_per_length = 1, bending_stiffness = [30, 20], bending = [1, 1] }";
    let text = BALL
        .replace("inertial = { mass = 1.0, inertia = { ixx = 0.1, iyy = 0.1, izz = 0.1 } }", boom)
        .replace("type = \"prismatic\"", "type = \"revolute\"")
        .replace("axis = [0, 0, 1]", "axis = [0, 1, 0]")
        .replace("limit = { lower = 0 }", "limit = { lower = -1, upper = 0.5 }")
        .replace("friction = 0.0", "friction = 0.1")
        .replace("q.height = 1.25", "q.height = 0.0")
        .replace("t_end = 4", "t_end = 1");
    let mut scene = scene(&text).unwrap();
    assert!(scene.simulation.approximated.is_empty());
    let summary = run(&mut scene.simulation, &mut Recording::default()).unwrap();
    assert!(summary.events.iter().any(|e| e.kind == "impact"), "{:?}", summary.events);
    // A thousand steps at 1e-9 each.
    assert!(summary.energy_error < 1e-6, "{:e}", summary.energy_error);
}
