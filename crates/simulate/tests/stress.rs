//! Stiff and extreme scenes: none is wrong, and those that are refused or warned of are those that must be.

use phipsi_simulate::stress::{Finding, Outcome, json, page, scenes, select, table};

/// The scenes that are judged without a run, and do not take seconds.
fn calls() -> Vec<Finding> {
    let quick = scenes().into_iter().filter(|s| !s.slow && s.family != "motions" && s.name != "chain-10000");
    quick.map(|s| s.run()).collect()
}

#[test]
fn single_calls_are_right_refused_or_warned_of() {
    let findings = calls();
    assert!(findings.len() > 60, "{}", findings.len());
    let named = |outcome: Outcome| {
        let some = findings.iter().filter(|f| f.measured.outcome == outcome);
        some.map(|f| f.name.as_str()).collect::<Vec<_>>()
    };
    println!("{}", table(&findings));
    assert!(named(Outcome::Wrong).is_empty(), "{:?}", named(Outcome::Wrong));
    for name in ["lines", "massless-tip", "rates-1e160", "negative-moment"] {
        assert!(named(Outcome::Refused).contains(&name), "{name} must be refused");
    }
    assert!(named(Outcome::Warned).contains(&"contradictory"));
    for f in findings.iter().filter(|f| f.measured.outcome == Outcome::Refused) {
        // A refusal names the place and what to do.
        let text = &f.measured.message;
        assert!(text.contains('`') || text.contains("number"), "{}: {text}", f.name);
    }
    let value = json(&findings);
    assert_eq!(value.as_array().unwrap().len(), findings.len());
    assert!(value[0]["forward_error"].as_f64().unwrap() < 100.0);
    assert_eq!(value[0]["steps"], serde_json::Value::Null);
    assert!(page(&findings).contains("## Ratios"));
}

/// Runs: one of each kind.
#[test]
fn runs_are_right_or_say_how_wrong_they_are() {
    let chosen = [
        "spring-1e12",
        "damped-1e12",
        "stiff-elbow",
        "flips-1e4",
        "separatrix-1e-2",
        "free-flyer-1e9",
        "late-1e9",
    ];
    for scene in scenes().into_iter().filter(|s| chosen.contains(&s.name.as_str())) {
        let finding = scene.run();
        assert_eq!(finding.measured.outcome, Outcome::Right, "{finding:?}");
    }
    for (name, remedy) in [("late-1e17", "a zero that is nearer"), ("swing-1e300", "choose an earlier t_end")]
    {
        let finding = select(Some(name)).unwrap().remove(0).run();
        assert_eq!(finding.measured.outcome, Outcome::Refused, "{finding:?}");
        assert!(finding.measured.message.contains(remedy), "{finding:?}");
    }
}

#[test]
fn a_name_that_does_not_exist_is_told_with_those_that_do() {
    let error = select(Some("tip")).err().unwrap();
    assert!(error.contains("`tip`") && error.contains("tip-mass-1e9") && error.contains("loops"), "{error}");
    assert_eq!(select(Some("tip-mass-1e9")).unwrap().len(), 1);
    assert!(select(Some("loops")).unwrap().len() > 5);
}
