//! Every kind of mistake, with its line, the user's name and a remedy.

use super::{ARM, arm, read};
use phipsi_formats::report::{Problem, Report};
use phipsi_formats::urdf::{Mimic, UrdfOptions, read_urdf, read_urdf_file};

/// A mistake in [`ARM`]: what is replaced, by what, and how it is reported.
struct Case {
    from: &'static str,
    to: &'static str,
    line: u32,
    place: &'static str,
    found: &'static str,
    remedy: &'static str,
}

fn case(
    [from, to]: [&'static str; 2],
    line: u32,
    place: &'static str,
    found: &'static str,
    remedy: &'static str,
) -> Case {
    Case { from, to, line, place, found, remedy }
}

fn check(cases: &[Case], problems: impl Fn(&Report) -> &[Problem], is_error: bool) {
    for Case { from, to, line, place, found, remedy } in cases {
        let read = read(&arm(from, to));
        assert_eq!(read.value.is_none(), is_error, "{to}: {}", read.report);
        let list = problems(&read.report);
        let [problem] = list else { panic!("{to}: not one problem:\n{}", read.report) };
        assert!(
            problem.line == Some(*line)
                && problem.place == *place
                && problem.found == *found
                && problem.remedy == *remedy,
            "{to}: {problem:#?}"
        );
        assert!(!problem.required.is_empty());
    }
}

#[test]
fn errors_have_line_name_and_remedy() {
    let xacro = "expand the file with the program xacro first";
    let number = "give a decimal number such as -1.5e-3";
    let sane = "correct the number (units: kg, m, kg·m²)";
    let mass = "value=\"2.5\"";
    check(
        &[
            case(
                [mass, "value=\"-2.5\""],
                4,
                "link `upper`",
                "mass -2.5e0 kg",
                "give a positive mass, or 0 for a massless frame",
            ),
            case(
                [mass, "value=\"nan\""],
                7,
                "link `upper`",
                "\"nan\" in attribute `value` of <mass>",
                "give a number; leave the attribute out where there is no limit",
            ),
            case(
                [mass, "value=\"1e999\""],
                7,
                "link `upper`",
                "\"1e999\" in attribute `value` of <mass>",
                "give a number between -1.8e308 and 1.8e308",
            ),
            case([mass, "value=\"1e308\""], 4, "link `upper`", "mass [1e308]", sane),
            case(
                [mass, "value=\"2,5\""],
                7,
                "link `upper`",
                "\"2,5\" in attribute `value` of <mass>",
                "write the decimal point as `.` and separate numbers by spaces",
            ),
            case(
                [mass, "value=\"two\""],
                7,
                "link `upper`",
                "\"two\" in attribute `value` of <mass>",
                number,
            ),
            case(
                [mass, "value=\"${m}\""],
                7,
                "link `upper`",
                "\"${m}\" in attribute `value` of <mass>",
                xacro,
            ),
            case(
                [mass, "value=\"\""],
                7,
                "link `upper`",
                "\"\" in attribute `value` of <mass>",
                "give 1 number separated by spaces",
            ),
            case(["<mass value=\"2.5\"/>", ""], 5, "link `upper`", "no <mass> in <inertial>", "add <mass>"),
            case(
                ["<mass value=\"2.5\"/>", "<mass/>"],
                7,
                "link `upper`",
                "no attribute `value` in <mass>",
                "add value=\"…\"",
            ),
            case(
                ["<mass value=\"2.5\"/>", "<mass value='1'/>\n<mass value='1'/>"],
                8,
                "link `upper`",
                "a second <mass>",
                "remove one of them",
            ),
            case(
                ["iyz=\"-0.03\" ", ""],
                8,
                "link `upper`",
                "no attribute `iyz` in <inertia>",
                "add iyz=\"…\"",
            ),
            case(
                [
                    "ixx=\"0.1\" ixy=\"0\" ixz=\"0\" iyy=\"0.1\" iyz=\"0\" izz=\"0.1\"",
                    "ixx=\"-0.1\" ixy=\"0\" ixz=\"0\" iyy=\"0.1\" iyz=\"0\" izz=\"0.3\"",
                ],
                11,
                "link `lower`",
                "principal moments -1.000000e-1, 1.000000e-1, 3.000000e-1 kg·m²",
                "check the signs and the axes of the inertial frame; the nearest that a body can have: ixx=0.0 ixy=0.0 ixz=0.0 iyy=0.2 iyz=0.0 izz=0.2",
            ),
            case(
                ["xyz=\"0.1 0.2 0.3\"", "xyz=\"0.1 0.2\""],
                6,
                "link `upper`",
                "\"0.1 0.2\" in attribute `xyz` of <origin>",
                "give 3 numbers separated by spaces",
            ),
            case(
                ["xyz=\"0.1 0.2 0.3\"", "xyz=\"0.1\n0.2\nx\""],
                6,
                "link `upper`",
                "\"x\" in attribute `xyz` of <origin>",
                number,
            ),
            case(
                ["xyz=\"0.1 0.2 0.3\" rpy=\"0 0 1.5\"", "quat_xyzw=\"0 0 0 0\""],
                4,
                "link `upper`",
                "inertial frame's quaternion is zero",
                "use (0, 0, 0, 1)",
            ),
            case(
                ["xyz=\"0.1 0.2 0.3\"", "quat_xyzw=\"0 0 0 1\""],
                6,
                "link `upper`",
                "both `rpy` and `quat_xyzw` in <origin>",
                "remove one of them",
            ),
            case(
                ["type=\"revolute\"", "type=\"Hinge\""],
                17,
                "joint `shoulder`",
                "joint type \"Hinge\"",
                "did you mean `revolute`?",
            ),
            case(
                [" type=\"revolute\"", ""],
                17,
                "joint `shoulder`",
                "no attribute `type` in <joint>",
                "add type=\"…\"",
            ),
            case(
                ["type=\"revolute\"", "type=\"universal\""],
                17,
                "joint `shoulder`",
                "a universal joint without axis2",
                "give axis2, the axis that turns with the first",
            ),
            case(
                ["<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 0\"/>"],
                17,
                "joint `shoulder`",
                "axis [0.0, 0.0, 0.0]",
                "give a unit vector",
            ),
            case(
                ["<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0\"/>"],
                21,
                "joint `shoulder`",
                "\"0 0\" in attribute `xyz` of <axis>",
                "give 3 numbers separated by spaces",
            ),
            case(
                ["xyz=\"1 2 3\"", "xyz=\"1 2 1e100\""],
                17,
                "joint `shoulder`",
                "origin [1.0, 2.0, 1e100]",
                "correct the number",
            ),
            case(
                ["<parent link=\"base\"/>", ""],
                17,
                "joint `shoulder`",
                "no <parent> in <joint>",
                "add <parent>",
            ),
            case(
                ["<parent link=\"base\"/>", "<parent/>"],
                19,
                "joint `shoulder`",
                "no attribute `link` in <parent>",
                "add link=\"…\"",
            ),
            case(
                ["<parent link=\"base\"/>", "<parent link=\"bas\"/>"],
                17,
                "joint `shoulder`",
                "parent `bas` does not exist",
                "add the body or correct the name",
            ),
            case(
                ["<child link=\"upper\"/>", "<child link=\"uper\"/>"],
                17,
                "joint `shoulder`",
                "child `uper` does not exist",
                "add the body or correct the name",
            ),
            case(
                ["<child link=\"upper\"/>", "<child link=\"lower\"/>"],
                25,
                "joint `elbow`",
                "body `lower` is also the child of joint `shoulder`",
                "make one of the joints a closure of the loop",
            ),
            case(
                ["<parent link=\"base\"/>", "<parent link=\"lower\"/>"],
                4,
                "link `upper`",
                "2 bodies hang in a cycle, this one among them",
                "remove a joint of the cycle, or make it a closure",
            ),
            case(
                ["<link name=\"base\"/>", "<link name=\"base\"/>\n<link name=\"spare\"/>"],
                2,
                "robot `arm`",
                "2 bodies without an inboard joint: base, spare",
                "connect them with joints, to `world` if they are separate",
            ),
            case(
                ["<link name=\"base\"/>", "<link name=\"base\"/>\n<link name=\"base\"/>"],
                4,
                "link `base`",
                "name given twice",
                "rename one of the bodies",
            ),
            case(
                ["<link name=\"base\"/>", "<link name=\"base\"/>\n<link/>"],
                4,
                "link without a name",
                "no attribute `name` in <link>",
                "add name=\"…\"",
            ),
            case(
                ["<link name=\"base\"/>", "<link name=\"base\"/>\n<include filename=\"x\"/>"],
                4,
                "robot `arm`",
                "element <include>, which only xacro knows",
                xacro,
            ),
            case(
                [
                    "<link name=\"base\"/>",
                    "<link name=\"base\"/><xacro:if value=\"1\" xmlns:xacro=\"http://ros.org/wiki/xacro\"/>",
                ],
                3,
                "robot `arm`",
                "xacro element \"if\"",
                xacro,
            ),
            case(
                ["<link name=\"base\"/>", "<link name=\"base\"/><xacro:if/>"],
                3,
                "XML, column 23",
                "an unknown namespace prefix 'xacro' at 3:23",
                xacro,
            ),
            case(
                ["mimic joint=\"shoulder\"", "mimic joint=\"sholder\""],
                25,
                "joint `elbow`",
                "mimics joint `sholder`, which does not exist",
                "did you mean `shoulder`?",
            ),
            case(
                ["mimic joint=\"shoulder\"", "mimic joint=\"elbow\""],
                25,
                "joint `elbow`",
                "mimics itself",
                "remove one <mimic> of the circle",
            ),
            case(
                ["mimic joint=\"shoulder\"", "mimic"],
                29,
                "joint `elbow`",
                "no attribute `joint` in <mimic>",
                "add joint=\"…\"",
            ),
            case(
                ["type=\"continuous\"", "type=\"planar\""],
                25,
                "joint `elbow`",
                "mimic with joint `elbow`, which has 3 degrees of freedom",
                "remove the <mimic>",
            ),
            case(
                ["<dynamics damping=\"0.5\"", "<dynamics damping=\"inf\""],
                23,
                "joint `shoulder`",
                "\"inf\" in attribute `damping` of <dynamics>",
                "give a number; leave the attribute out where there is no limit",
            ),
            case(
                ["damping=\"0.5\"", "damping=\"1e200\""],
                17,
                "joint `shoulder`",
                "damping 1e200",
                "correct the number",
            ),
        ],
        |report| &report.errors,
        true,
    );
}

#[test]
fn warnings_have_line_name_and_remedy() {
    check(
        &[
            case(
                [
                    "ixx=\"0.1\" ixy=\"0\" ixz=\"0\" iyy=\"0.1\" iyz=\"0\" izz=\"0.1\"",
                    "ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"5\"",
                ],
                11,
                "link `lower`",
                "principal moments 1.000000e0 + 1.000000e0 < 5.000000e0 kg·m²",
                "no mass distribution has this inertia; the nearest that a body can have: ixx=2.0 ixy=0.0 ixz=0.0 iyy=2.0 iyz=0.0 izz=4.0",
            ),
            case(
                ["<mass value=\"1\"/>", "<mass value=\"0\"/>"],
                11,
                "link `lower`",
                "no mass but principal moments 1.000000e-1, 1.000000e-1, 1.000000e-1 kg·m²",
                "give the body its mass, or remove the inertia",
            ),
            case(
                ["<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 2\"/>"],
                17,
                "joint `shoulder`",
                "axis [0.0, 0.0, 2.0] has length 2.000000",
                "it is normalised: check that its direction is meant",
            ),
            case(
                ["<limit lower=\"-1\" upper=\"2\" effort=\"30\" velocity=\"4\"/>", ""],
                17,
                "joint `shoulder`",
                "a revolute joint without <limit>",
                "add it, or use a continuous joint",
            ),
            case(
                ["lower=\"-1\" upper=\"2\"", ""],
                22,
                "joint `shoulder`",
                "neither `lower` nor `upper` in <limit>, which URDF reads as 0 and 0",
                "add them; until then there is no position limit",
            ),
            case(
                ["lower=\"-1\"", "lower=\"2\""],
                22,
                "joint `shoulder`",
                "lower = upper = 2.0",
                "correct the limits, or use a fixed joint",
            ),
            case(
                ["lower=\"-1\"", "lower=\"3\""],
                17,
                "joint `shoulder`",
                "lower limit 3.0 above upper limit 2.0",
                "exchange them",
            ),
            case(
                ["effort=\"30\"", "effort=\"0\""],
                22,
                "joint `shoulder`",
                "effort=\"0\"",
                "give the largest value, or leave it out for no limit",
            ),
            case(
                ["effort=\"30\"", "effort=\"-3\""],
                22,
                "joint `shoulder`",
                "effort=\"-3.0\"",
                "give a positive number; it is read as no limit",
            ),
            case(
                ["effort=\"30\"", ""],
                22,
                "joint `shoulder`",
                "no attribute `effort` in <limit>",
                "add it; it is read as no limit",
            ),
            case(
                ["damping=\"0.5\"", "damping=\"-0.5\""],
                17,
                "joint `shoulder`",
                "damping -0.5",
                "a negative value feeds energy in",
            ),
            case(
                ["rpy=\"0 0 1.5\"", "rpy=\"0 0 90\""],
                6,
                "link `upper`",
                "angle 90.0 in `rpy`, more than a turn",
                "if it is meant in degrees, write 1.570796327",
            ),
            case(
                ["<dynamics damping", "<dynamics dampin=\"1\" damping"],
                23,
                "joint `shoulder`",
                "unknown attribute \"dampin\" of <dynamics>",
                "did you mean `damping`?",
            ),
            case(
                ["<link name=\"base\"/>", "<link name=\"base\"><vissual/></link>"],
                3,
                "link `base`",
                "unknown element \"vissual\" in <link>",
                "did you mean `visual`?",
            ),
            case([" name=\"arm\"", ""], 2, "robot", "no attribute `name` in <robot>", "add name=\"…\""),
        ],
        |report| &report.warnings,
        false,
    );
}

#[test]
fn loading_does_not_stop_at_the_first_problem() {
    let text = ARM
        .replace("value=\"2.5\"", "value=\"-1\"")
        .replace("value=\"1\"", "value=\"one\"")
        .replace("type=\"revolute\"", "type=\"revolut\"")
        .replace("<axis xyz=\"0 1 0\"/>", "<axis xyz=\"0 1\"/>")
        .replace("lower=\"-1\"", "lower=\"low\"")
        .replace("<parent link=\"base\"/>", "<parent link=\"lower\"/>");
    let report = read(&text).report;
    let mut lines: Vec<u32> = report.errors.iter().filter_map(|e| e.line).collect();
    lines.sort_unstable();
    // Mass, cycle, unreadable mass, joint type, limit, axis.
    assert_eq!(lines, [4, 4, 13, 17, 22, 28], "{report}");
    // A link without a name leaves its joint without a child, which is not reported on top of it.
    let report = read(&arm("<link name=\"lower\">", "<link>")).report;
    let found: Vec<&str> = report.errors.iter().map(|e| e.found.as_str()).collect();
    assert_eq!(found, ["no attribute `name` in <link>", "child `lower` does not exist"]);
    // Mistakes in a dropped mimic are mistakes.
    let free = UrdfOptions { mimic: Mimic::Free, ..Default::default() };
    assert!(
        !read_urdf(&arm("mimic joint=\"shoulder\"", "mimic joint=\"x\""), "a", &free)
            .report
            .errors
            .is_empty()
    );
}

#[test]
fn of_two_joints_with_one_name_the_second_is_reported() {
    let text = ARM.replace("name=\"elbow\"", "name=\"shoulder\"");
    let text = text.replace("<mimic joint=\"shoulder\" multiplier=\"-2\" offset=\"0.5\"/>", "");
    let report = read(&text).report;
    let [error] = &report.errors[..] else { panic!("{report}") };
    assert_eq!((error.line, error.place.as_str()), (Some(25), "joint `shoulder`"));
    assert_eq!(
        (error.found.as_str(), error.remedy.as_str()),
        ("name given twice", "rename one of the joints")
    );
}

#[test]
fn a_circle_of_mimics_is_found_and_its_followers_are_not() {
    let joint = |name: &str, child: &str, source: &str| {
        format!(
            "<link name='{child}'/>\n<joint name='{name}' type='continuous'><parent link='a'/><child link='{child}'/>\
             <mimic joint='{source}'/></joint>\n"
        )
    };
    let text = format!(
        "<robot name='r'><link name='a'/>\n{}{}{}</robot>",
        joint("i", "b", "j"),
        joint("j", "c", "i"),
        joint("k", "d", "i")
    );
    let report = read(&text).report;
    let lines: Vec<_> = report.errors.iter().map(|e| e.line).collect();
    assert_eq!(lines, [Some(3), Some(5)], "{report}");
    assert!(report.errors[0].found.contains("mimics joint `j`, which follows it in turn"));
}

/// Files that are no URDF at all: refused with one error, at once.
#[test]
fn hostile_files_are_refused_with_a_line() {
    let truncated = &ARM[..ARM.find("<limit").unwrap() + 10];
    let entities = "<!DOCTYPE a [<!ENTITY b \"bbbb\"><!ENTITY c \"&b;&b;\">]><robot name='&c;'/>";
    let deep = format!("<robot>\n{}", "<link>".repeat(100_000));
    let wide: String = (0..100_000).map(|i| format!(" a{i}='1'")).collect();
    let cases: [(&str, String, Option<u32>, &str); 20] = [
        ("nothing", String::new(), Some(1), ""),
        ("spaces", " \n \n".into(), Some(1), ""),
        ("no XML", "hello\n".into(), Some(1), "correct the file"),
        ("truncated", truncated.into(), Some(22), "written to its end"),
        ("a tag that is not closed", ARM.replace("</robot>", ""), Some(30), "written to its end"),
        ("wrong end", ARM.replace("</robot>", "</rob>"), Some(31), ""),
        ("a name twice", arm("name=\"base\"", "name=\"base\" name=\"x\""), Some(3), ""),
        ("an unknown entity", arm("name=\"base\"", "name=\"&x;\""), Some(3), ""),
        ("a DTD", entities.into(), Some(1), "remove the DOCTYPE declaration"),
        ("NUL", arm("name=\"base\"", "name=\"b\0\""), Some(3), ""),
        ("deep", deep, Some(2), "see whether a program wrote the file wrongly"),
        ("wide", format!("<robot\n{wide}/>"), Some(1), "see whether a program wrote the file wrongly"),
        ("SDF", "<sdf version='1.6'/>".into(), Some(1), "this is an SDF file: convert it to URDF"),
        ("MJCF", "<mujoco/>".into(), Some(1), "this is a MuJoCo file: convert it to URDF"),
        ("another file", "<html/>".into(), Some(1), "give a URDF file"),
        ("no link", "<robot name='r'>\n</robot>".into(), Some(1), "add a link"),
        (
            "a long name",
            arm("name=\"base\"", &format!("name=\"{}\"", "b".repeat(2000))),
            Some(3),
            "give a shorter name",
        ),
        ("a blank name", arm("link name=\"base\"", "link name=\" \""), Some(3), "add name=\"…\""),
        (
            "a template",
            arm("link name=\"base\"", "link name=\"${p}b\""),
            Some(3),
            "with the program xacro first",
        ),
        ("comments without end", "<!--".repeat(100_000), Some(1), ""),
    ];
    for (what, text, line, remedy) in cases {
        let read = read(&text);
        assert!(read.value.is_none(), "{what}");
        let error = read.report.errors.first().unwrap_or_else(|| panic!("{what}"));
        assert!(line.is_none_or(|line| error.line == Some(line)), "{what}: {error:?}");
        assert!(
            error.remedy.contains(remedy) && !error.found.is_empty() && !error.required.is_empty(),
            "{what}: {error:?}"
        );
        // A report fits a screen, whatever the file.
        assert!(read.report.to_string().len() < 10_000, "{what}");
    }
}

#[test]
fn unreadable_files_are_errors() {
    let directory = std::env::temp_dir().join(format!("phipsi-urdf-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = directory.join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let error = |path: &std::path::Path| {
        let read = read_urdf_file(path, &UrdfOptions::default());
        assert!(read.value.is_none());
        read.report.errors[0].clone()
    };
    assert_eq!(error(&directory.join("missing.urdf")).place, "file");
    assert_eq!(error(&directory).place, "file");
    let latin = [b"<robot name='r'>\n<link name='".as_slice(), &[0xe9], b"'/></robot>"].concat();
    let latin = error(&write("latin.urdf", &latin));
    assert_eq!((latin.line, latin.found.as_str()), (Some(2), "byte 29 is not UTF-8"));
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(ARM.bytes().flat_map(|b| [b, 0])).collect();
    assert_eq!(error(&write("wide.urdf", &wide)).found, "text in UTF-16");
    let marked = [&[0xef, 0xbb, 0xbf], ARM.as_bytes()].concat();
    let path = write("marked.urdf", &marked);
    assert!(read_urdf_file(&path, &UrdfOptions::default()).value.is_some());
    std::fs::remove_dir_all(&directory).unwrap();
}

/// Control characters of names do not reach the terminal.
#[test]
fn names_are_shown_without_control_characters() {
    let report = read(&arm("link name=\"base\"", "link name=\"&#27;[2J\" x=\"\"")).report;
    let text = report.to_string();
    assert!(text.contains("u{1b}") || !text.contains('\u{1b}'), "{text:?}");
    assert!(!text.contains('\u{1b}'), "{text:?}");
}
