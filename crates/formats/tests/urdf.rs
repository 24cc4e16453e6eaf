//! URDF: every joint type, every element; in `mistakes` every kind of mistake.

mod mistakes;

use phipsi_formats::report::{Loaded, Report};
use phipsi_formats::urdf::{Mimic, UrdfOptions, read_urdf, read_urdf_file, urdf_builder};
use phipsi_model::{Base, Body, Coupling, Inertia, Joint, JointKind, Model};
use std::fmt::Write as _;

fn read(text: &str) -> Loaded<Model> {
    read_urdf(text, "test.urdf", &UrdfOptions::default())
}

fn accept(text: &str) -> (Model, Report) {
    read(text).into_result(false).unwrap_or_else(|report| panic!("{report}"))
}

/// An arm with every element that is used; nothing in it deserves a warning.
const ARM: &str = r#"<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0.1 0.2 0.3" rpy="0 0 1.5"/>
      <mass value="2.5"/>
      <inertia ixx="0.3" ixy="0.01" ixz="0.02" iyy="0.4" iyz="-0.03" izz="0.5"/>
    </inertial>
  </link>
  <link name="lower">
    <inertial>
      <mass value="1"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>
    </inertial>
  </link>
  <joint name="shoulder" type="revolute">
    <origin xyz="1 2 3" rpy="0 0 0"/>
    <parent link="base"/>
    <child link="upper"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="30" velocity="4"/>
    <dynamics damping="0.5" friction="0.25"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/>
    <child link="lower"/>
    <axis xyz="0 1 0"/>
    <mimic joint="shoulder" multiplier="-2" offset="0.5"/>
  </joint>
</robot>
"#;

/// [`ARM`] with one piece replaced.
fn arm(from: &str, to: &str) -> String {
    assert_eq!(ARM.matches(from).count(), 1, "{from}");
    ARM.replace(from, to)
}

#[test]
fn everything_that_is_used_arrives() {
    let (model, report) = accept(ARM);
    assert!(
        report.warnings.is_empty() && report.ignored.is_empty() && report.approximated.is_empty(),
        "{report}"
    );
    assert_eq!((model.name(), model.len(), model.nv()), ("arm", 3, 2));
    let upper = &model.bodies()[1];
    assert_eq!((upper.name.as_str(), upper.inertia.mass), ("upper", 2.5));
    assert_eq!(upper.inertia.tensor, [0.3, 0.01, 0.02, 0.4, -0.03, 0.5]);
    assert_eq!(upper.inertia.frame.translation, [0.1, 0.2, 0.3]);
    // Half the angle about z, rounded once in sine and cosine.
    let half = [0.0, 0.0, 0.75f64.sin(), 0.75f64.cos()];
    for (got, expected) in upper.inertia.frame.rotation.iter().zip(half) {
        assert!((got - expected).abs() <= 4.0 * f64::EPSILON);
    }
    let shoulder = &model.joints()[1];
    assert_eq!(shoulder.kind, JointKind::Revolute { axis: [0.0, 0.0, 1.0] });
    assert_eq!(shoulder.placement.translation, [1.0, 2.0, 3.0]);
    assert_eq!(shoulder.limits.position, Some([-1.0, 2.0]));
    assert_eq!((shoulder.limits.effort, shoulder.limits.velocity), (Some(30.0), Some(4.0)));
    assert_eq!((shoulder.damping, shoulder.friction), (0.5, 0.25));
    let follows =
        Coupling { joint: "elbow".into(), source: "shoulder".into(), multiplier: -2.0, offset: 0.5 };
    assert_eq!(model.couplings(), [follows]);
    let used = |place: &str| report.used.iter().find(|n| n.place == place).expect(place);
    assert_eq!(used("robot `arm`").what, "links: 3, joints: 2 (1 continuous, 1 revolute)");
    assert_eq!(
        (used("link `base`").what.as_str(), used("link `base`").line),
        ("root, welded to the world", Some(3))
    );
}

#[test]
fn a_free_base_and_a_world_link() {
    let free = UrdfOptions { base: Base::Free, ..Default::default() };
    let (model, _) = read_urdf(ARM, "a", &free).into_result(true).unwrap();
    assert_eq!((model.nv(), model.joints()[0].kind), (8, JointKind::Free));
    assert_eq!(model.joints()[0].name, "base");
    let world = ARM.replace("\"base\"", "\"world\"");
    let (model, report) = accept(&world);
    assert_eq!((model.len(), model.nv()), (2, 2));
    assert!(report.used.iter().any(|n| n.what == "root, the inertial frame"));
    let refused = read_urdf(&world, "a", &free);
    assert!(refused.report.errors[0].found.contains("free base called `world`"), "{}", refused.report);
    assert_eq!(refused.report.errors[0].line, Some(3));
}

#[test]
fn mimic_is_a_coupling_or_dropped_and_listed() {
    let free = UrdfOptions { mimic: Mimic::Free, ..Default::default() };
    let (model, report) = read_urdf(ARM, "a", &free).into_result(true).unwrap();
    assert!(model.couplings().is_empty());
    let note = &report.approximated[0];
    assert_eq!((note.line, note.place.as_str()), (Some(25), "joint `elbow`"));
    assert_eq!(note.what, "mimic of joint `shoulder` dropped: the joint moves freely");
    let (model, _) = accept(&arm(r#" multiplier="-2" offset="0.5""#, ""));
    assert_eq!((model.couplings()[0].multiplier, model.couplings()[0].offset), (1.0, 0.0));
}

/// One joint of a type between two links, with these child elements.
fn one_joint(kind: &str, inside: &str) -> String {
    format!(
        "<robot name='r'>\n<link name='a'/>\n<link name='b'/>\n\
         <joint name='j' type='{kind}'>\n<parent link='a'/><child link='b'/>\n{inside}\n</joint></robot>"
    )
}

#[test]
fn every_joint_type_is_read() {
    let limit = "<limit lower='0' upper='1' effort='1' velocity='1'/>";
    let z = [0.0, 0.0, 1.0];
    let axis = format!("<axis xyz='0 0 1'/>{limit}");
    for (word, inside, expected) in [
        ("revolute", axis.as_str(), JointKind::Revolute { axis: z }),
        ("continuous", "<axis xyz='0 0 1'/>", JointKind::Continuous { axis: z }),
        ("prismatic", &axis, JointKind::Prismatic { axis: z }),
        ("fixed", "", JointKind::Fixed),
        ("floating", "", JointKind::Free),
        ("planar", "<axis xyz='0 0 1'/>", JointKind::Planar { normal: z }),
        ("helical", "<axis xyz='0 0 1' pitch='-2e-3'/>", JointKind::Helical { axis: z, pitch: -2e-3 }),
        ("cylindrical", "<axis xyz='0 0 1'/>", JointKind::Cylindrical { axis: z }),
        (
            "universal",
            "<axis xyz='0 0 1'/><axis2 xyz='0 1 0'/>",
            JointKind::Universal { axes: [z, [0.0, 1.0, 0.0]] },
        ),
        ("spherical", "", JointKind::Spherical),
        ("translation", "", JointKind::Translation),
        // URDF's default axis.
        ("continuous", "", JointKind::Continuous { axis: [1.0, 0.0, 0.0] }),
    ] {
        let (model, report) = accept(&one_joint(word, inside));
        assert_eq!(model.joints()[1].kind, expected, "{word}");
        assert!(report.warnings.is_empty() && report.ignored.is_empty(), "{word}: {report}");
        let extension = phipsi_formats::is_extension(&expected);
        let noted = |what: &str| report.used.iter().any(|n| n.line == Some(4) && n.what.contains(what));
        assert_eq!(noted("an extension of URDF"), extension, "{word}");
        assert_eq!(noted("no axis: URDF's default"), expected.axes() == [[1.0, 0.0, 0.0]], "{word}");
    }
}

#[test]
fn what_a_joint_has_no_use_for_is_ignored_and_listed() {
    for (word, inside, what) in [
        ("fixed", "<axis xyz='0 0 1'/>", "axis of a fixed joint"),
        ("fixed", "<dynamics damping='1'/>", "dynamics of a fixed joint"),
        ("floating", "<limit effort='1' velocity='1'/>", "limit of a floating joint"),
        ("planar", "<axis2 xyz='0 0 1'/>", "axis2 of a planar joint"),
        ("continuous", "<axis xyz='0 0 1' pitch='1'/>", "pitch of a continuous joint"),
        ("continuous", "<limit lower='0' upper='1'/>", "lower and upper of a continuous joint"),
        ("fixed", "<calibration rising='0'/>", "calibration, calibration"),
        ("fixed", "<safety_controller k_velocity='0'/>", "safety_controller, controller settings"),
        ("fixed", "some text", "text in <joint>"),
        ("fixed", "<s:x xmlns:s='http://example.org/s'/>", "element \"x\" of another namespace"),
    ] {
        let (_, report) = accept(&one_joint(word, inside));
        let note =
            report.ignored.iter().find(|n| n.what == what).unwrap_or_else(|| panic!("{what}: {report}"));
        let line = if inside == "some text" { 4 } else { 6 };
        assert_eq!((note.line, note.place.as_str()), (Some(line), "joint `j`"), "{what}");
        assert!(report.warnings.is_empty(), "{report}");
    }
    // Several visuals of one link are one note; the geometry in them is not looked at.
    let pictures = arm(
        "<link name=\"base\"/>",
        "<link name=\"base\"><visual><x y='z'/></visual><visual/><collision/></link>",
    );
    let (_, report) = accept(&pictures);
    let what: Vec<&str> = report.ignored.iter().map(|n| n.what.as_str()).collect();
    assert_eq!(what, ["visual, geometry to look at", "collision, geometry of contacts"]);
    let parts = arm("</robot>", "<transmission/><gazebo/><material/></robot>");
    let (_, report) = accept(&parts);
    assert_eq!(report.ignored.len(), 3);
    assert!(report.ignored.iter().all(|n| n.line == Some(31) && n.place == "robot `arm`"));
}

/// A chain of n links; joint k hangs link k on link k − 1.
fn chain(n: usize) -> String {
    let mut text = String::from("<robot name='chain'>\n");
    for k in 0..n {
        writeln!(
            text,
            "<link name='l{k}'><inertial><origin xyz='0 0 0.5'/><mass value='1'/><inertia ixx='0.1' ixy='0' ixz='0' \
             iyy='0.1' iyz='0' izz='0.01'/></inertial><visual/></link>"
        )
        .unwrap();
        if let Some(parent) = k.checked_sub(1) {
            writeln!(
                text,
                "<joint name='j{k}' type='continuous'><origin xyz='0 0 1'/><parent link='l{parent}'/>\
                 <child link='l{k}'/><axis xyz='0 1 0'/></joint>"
            )
            .unwrap();
        }
    }
    text + "</robot>"
}

#[test]
fn a_chain_of_a_hundred_thousand_links_is_read() {
    let (model, report) = accept(&chain(100_000));
    assert_eq!((model.len(), model.nv()), (100_000, 99_999));
    assert_eq!(model.bodies()[99_999].name, "l99999");
    assert_eq!(report.ignored.len(), 100_000);
    // The report counts; it does not repeat.
    assert!(report.to_string().len() < 1000);
}

/// More can be added to what a URDF says.
#[test]
fn a_builder_takes_more() {
    let builder = urdf_builder(ARM, "arm.urdf", &UrdfOptions::default()).value.unwrap();
    let tool = Body::new("tool", Inertia::from_principal(0.5, [0.0; 3], [0.1; 3]));
    let kind = phipsi_formats::joint_kind("prismatic", Some([0.0, 0.0, 1.0]), None, None).unwrap();
    let model = builder
        .body(tool)
        .joint(Joint::new("slide", kind), "lower", "tool")
        .gravity([0.0; 3])
        .build()
        .unwrap();
    assert_eq!((model.len(), model.nv(), model.gravity()), (4, 3, [0.0; 3]));
}

/// The published robots that a clone carries, without a warning that they do not deserve.
#[test]
fn published_robots_are_read() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../validation/data/robots/models");
    for (file, bodies, freedoms) in
        [("panda.urdf", None, 9), ("ur5.urdf", None, 6), ("allegro.urdf", None, 16)]
    {
        let read = read_urdf_file(format!("{folder}/{file}"), &UrdfOptions::default());
        let (model, _) = read.into_result(false).unwrap_or_else(|report| panic!("{report}"));
        assert_eq!(model.nv(), freedoms, "{file}");
        assert!(bodies.is_none_or(|n: usize| model.len() == n));
    }
}
