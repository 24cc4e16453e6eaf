//! The command `phipsi stress`: one JSON value, exit status, a page.

use std::process::{Command, Output};

fn stress(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_phipsi")).arg("stress").args(arguments).output().unwrap()
}

#[test]
fn a_family_is_printed_as_one_value_and_put_into_a_page() {
    let scratch = tempfile::tempdir().unwrap();
    let page = scratch.path().join("page.md");
    std::fs::write(&page, "before\n<!-- tables: begin -->\n(replaced)\n<!-- tables: end -->\nafter\n")
        .unwrap();
    let output = stress(&["--only", "loops", "--json", "--page", page.to_str().unwrap()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let near = value.as_array().unwrap().iter().find(|f| f["name"] == "singular-1e-2").unwrap();
    assert_eq!(near["outcome"], "right");
    // Units of εκ: the budget is 4 n.
    assert!(near["forward_error"].as_f64().unwrap() <= 12.0, "{near}");
    let text = std::fs::read_to_string(&page).unwrap();
    assert!(
        text.starts_with("before\n") && text.ends_with("after\n") && !text.contains("(replaced)"),
        "{text}"
    );
    assert!(text.contains("| singular-1e-2 | right |"), "{text}");
}

#[test]
fn an_unknown_scene_is_refused() {
    let output = stress(&["--only", "nothing", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(value["error"].as_str().unwrap().contains("`nothing`"));
}
