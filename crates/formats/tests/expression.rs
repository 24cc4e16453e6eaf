//! Expressions against closed forms, central differences, a tree evaluated naively, and their own text.

use phipsi_formats::Expression;
use phipsi_model::Random;
use proptest::prelude::*;
use std::f64::consts::{E, FRAC_1_SQRT_2, PI};

const XYZ: [&str; 3] = ["x", "y", "z"];

fn parse(text: &str) -> Expression {
    Expression::parse(text, &XYZ, &[("pi", PI)]).unwrap_or_else(|e| panic!("{text}: {e}"))
}

/// Value at x = 3, y = 5, z = −2.
fn value(text: &str) -> f64 {
    parse(text).value(&[3.0, 5.0, -2.0])
}

#[test]
fn operators_bind_as_in_openmm() {
    for (text, expected) in [
        ("1+2*3", 7.0),
        ("(1+2)*3", 9.0),
        ("2^3^2", 512.0),
        ("(2^3)^2", 64.0),
        ("-2^2", -4.0),
        ("(-2)^2", 4.0),
        ("2^-2", 0.25),
        ("2^-1^2", 0.5),
        ("2*-3", -6.0),
        ("-2*3", -6.0),
        ("--2", 2.0),
        ("1--2", 3.0),
        ("10-4-3", 3.0),
        ("24/4/3", 2.0),
        ("24/4*3", 18.0),
        ("2*3^2", 18.0),
        ("-x^2", -9.0),
        ("x^2*y", 45.0),
        ("y/x*z", 5.0 / 3.0 * -2.0),
        ("2e-3*x", 6e-3),
        ("1.5E+2", 150.0),
        (".5", 0.5),
        ("5.", 5.0),
        (" 2 * ( x + 1 ) ", 8.0),
        ("x\n+\ty", 8.0),
    ] {
        assert_eq!(value(text), expected, "{text}");
    }
}

/// Values that are known in closed form; the functions of the platform are good to one unit in the last place.
#[test]
fn functions_have_their_known_values() {
    for (text, expected) in [
        ("sqrt(2)", 2f64.sqrt()),
        ("exp(1)", E),
        ("log(exp(2))", 2.0),
        ("sin(pi/6)", 0.5),
        ("cos(pi/3)", 0.5),
        ("tan(pi/4)", 1.0),
        ("sec(pi/3)", 2.0),
        ("csc(pi/6)", 2.0),
        ("cot(pi/4)", 1.0),
        ("asin(1)", PI / 2.0),
        ("acos(0)", PI / 2.0),
        ("atan(1)", PI / 4.0),
        ("atan2(1, -1)", 3.0 * PI / 4.0),
        ("atan2(-1, 1)", -PI / 4.0),
        ("sinh(log(2))", 0.75),
        ("cosh(log(2))", 1.25),
        ("tanh(log(2))", 0.6),
        ("erf(0)", 0.0),
        ("erf(1)", 0.842_700_792_949_714_9),
        ("erfc(1)", 0.157_299_207_050_285_13),
        ("square(x)", 9.0),
        ("cube(z)", -8.0),
        ("recip(z)", -0.5),
        ("x^(1/2)", 3f64.sqrt()),
        ("y^1.5", 5.0 * 5f64.sqrt()),
        ("x^12", 531_441.0),
        ("z^-3", -0.125),
        ("x^z", 1.0 / 9.0),
        ("cos(pi/4)", FRAC_1_SQRT_2),
    ] {
        let got = value(text);
        assert!((got - expected).abs() <= 4.0 * f64::EPSILON * expected.abs().max(0.5), "{text}: {got}");
    }
}

#[test]
fn steps_and_choices_take_their_side_at_the_edge() {
    for (text, expected) in [
        ("step(0)", 1.0),
        ("step(-1e-300)", 0.0),
        ("step(x)", 1.0),
        ("delta(0)", 1.0),
        ("delta(x)", 0.0),
        ("delta(x-3)", 1.0),
        ("min(x, z)", -2.0),
        ("max(x, z)", 3.0),
        ("abs(z)", 2.0),
        ("floor(z/4)", -1.0),
        ("ceil(y/4)", 2.0),
        ("select(0, x, y)", 5.0),
        ("select(z, x, y)", 3.0),
        ("select(x-3, x, y)", 5.0),
        // The branch that is not taken may be anything.
        ("select(step(x), x, log(z))", 3.0),
    ] {
        assert_eq!(value(text), expected, "{text}");
    }
    for text in ["step(log(z))", "delta(log(z))", "min(log(z), x)", "max(x, log(z))", "select(log(z), x, y)"]
    {
        assert!(value(text).is_nan(), "{text}");
    }
}

#[test]
fn definitions_follow_their_use() {
    for (text, expected) in [
        ("a*b; b=x^2; a=3", 27.0),
        ("a*b; b=a^2; a=3;", 27.0),
        ("a;; a = b + 1; b = y ; ", 6.0),
        // A definition hides a variable from the expressions before it, itself excepted.
        ("x; x=x+1", 4.0),
        // Of two with one name each place sees the next.
        ("b; b=b+1; b=x", 4.0),
        ("0.5*k*(x-r0)^2; k=4; r0=1", 8.0),
    ] {
        assert_eq!(value(text), expected, "{text}");
    }
}

#[test]
fn constants_and_variables_have_any_name() {
    let names = ["theta1", "distance'", "μ", "_r", "e1", "step"];
    let f = Expression::parse("theta1 + 2*distance' + 3*μ + 4*_r + 5*e1 + 6*step", &names, &[]).unwrap();
    assert_eq!(f.value(&[1.0; 6]), 21.0);
    assert_eq!(f.variables(), names);
    // A variable hides a constant.
    assert_eq!(Expression::parse("pi", &["pi"], &[("pi", PI)]).unwrap().value(&[2.0]), 2.0);
    // A missing value makes the result no number, and no panic.
    assert!(f.value(&[]).is_nan());
}

#[test]
fn errors_name_the_column_and_a_remedy() {
    for (text, column, found, remedy) in [
        ("", 1, "the end", "complete the expression"),
        ("2+", 3, "the end", "complete the expression"),
        ("2 x", 3, "the name \"x\"", "write `*` for a product"),
        ("2(x)", 2, "`(`", "write `*` for a product"),
        ("x(2)", 1, "\"x\" before `(`, which is no function", "write `*` for a product"),
        ("(x", 1, "`(` without `)`", "close it"),
        ("sin(x", 4, "`(` without `)`", "close it"),
        ("x)", 2, "`)`", "remove it, or open it before"),
        ("x+*y", 3, "`*`", "remove it"),
        ("x**2", 3, "`**`", "write `^` for a power"),
        ("+x", 1, "`+`", "remove it"),
        ("x % 2", 3, "\"%\"", "write x - y*floor(x/y) for the remainder"),
        ("x < 2", 3, "\"<\"", "use step, delta, min, max and select for conditions"),
        ("1e", 1, "number \"1e\"", "write it like 1.5 or 2e-3"),
        ("1e999", 1, "number \"1e999\"", "give a smaller number"),
        ("1.2.3", 4, "the number 0.3", "write `*` for a product"),
        ("X+q", 1, "unknown name \"X\"", "did you mean `x`?"),
        ("sqr(x)", 1, "unknown function \"sqr\"", "did you mean `sqrt`?"),
        ("ln(x)", 1, "unknown function \"ln\"", "did you mean `log`?"),
        ("atan2(x)", 1, "atan2 with 1 argument", "give 2 arguments"),
        ("sin()", 1, "sin with 0 arguments", "give 1 argument"),
        ("min(x, y, z)", 1, "min with 3 arguments", "give 2 arguments"),
        ("sin + 1", 1, "unknown name \"sin\"", "give its arguments: sin(…)"),
        (
            "a; b=2; a=b",
            11,
            "unknown name \"b\"",
            "move the definition of `b` behind the place where it is used",
        ),
        ("a=2", 1, "unknown name \"a\"", "move the definition of `a` behind the place where it is used"),
        ("x=2", 2, "`=`", "write definitions after the expression: a*b; a = 2"),
        ("a; 2", 4, "\"2\" after `;`", "give it a name"),
        ("a; a b=2", 4, "\"a b\" left of `=`", "begin the definition with the name that it defines"),
        ("a; =2", 4, "\"\" left of `=`", "begin the definition with the name that it defines"),
        ("y + μμ", 5, "unknown name \"μμ\"", "correct it, or define it: …; μμ = …"),
        // The last definition is read first.
        ("(y;x=1)", 7, "`)`", "remove it, or open it before"),
    ] {
        let error = Expression::parse(text, &XYZ, &[]).expect_err(text);
        assert_eq!(
            (error.column, error.found.as_str(), error.remedy.as_str()),
            (column, found, remedy),
            "{text}: {error}"
        );
    }
}

/// Nesting is refused before the stack ends; length is not nesting.
#[test]
fn neither_depth_nor_length_overflows() {
    let n = 100_000;
    for text in [
        "(".repeat(n),
        "-".repeat(n),
        "sin(".repeat(n),
        "2^".repeat(n),
        format!("{}x{}", "(".repeat(n), ")".repeat(n)),
        "min(x,".repeat(n),
        format!("{}x", "x-(".repeat(n)),
    ] {
        let error = Expression::parse(&text, &XYZ, &[]).unwrap_err();
        assert!(error.found.contains("nested"), "{error}");
    }
    let sum = format!("x{}", "+x*y".repeat(n));
    assert_eq!(parse(&sum).value(&[1.0, 1.0, 0.0]), 1.0 + n as f64);
    assert_eq!(parse(&sum).derivative("x").value(&[1.0, 1.0, 0.0]), 1.0 + n as f64);
    let long = "x".repeat(2 << 20);
    assert!(Expression::parse(&long, &XYZ, &[]).unwrap_err().found.contains("bytes"));
    // Every sum of two earlier names is different.
    let many: String = (1..70_000).map(|i| format!("x+{i}+")).collect();
    assert!(Expression::parse(&(many + "1"), &XYZ, &[]).unwrap_err().found.contains("subexpressions"));
}

/// A chain of definitions, each used twice by the one before: 2^500 terms, 500 subexpressions.
#[test]
fn shared_subexpressions_are_computed_and_written_once() {
    let mut text = String::from("a0");
    for i in 0..500 {
        text += &format!("; a{i} = 0.5*(a{j} + cos(a{j})*0 + a{j}*1)", j = i + 1);
    }
    text += "; a500 = x";
    let f = parse(&text);
    assert_eq!(f.value(&[3.0, 0.0, 0.0]), 3.0);
    assert_eq!(f.derivative("x").value(&[3.0, 0.0, 0.0]), 1.0);
    let written = f.to_string();
    assert!(written.len() < 20_000);
    assert_eq!(parse(&written).value(&[3.0, 0.0, 0.0]), 3.0);
}

/// (f(x+h) − f(x−h)) / 2h, and a bound of its error: what half the step would change, and the rounding of f.
fn central_difference(f: impl Fn(f64) -> f64, x: f64) -> (f64, f64) {
    let h = x.abs().max(0.1) * f64::EPSILON.cbrt();
    let slope = |h: f64| (f(x + h) - f(x - h)) / ((x + h) - (x - h));
    // Each f is off by a few ε of itself and of the argument's rounding, both sides added.
    let rounding = 16.0 * f64::EPSILON * (f(x).abs() + 1.0) / h;
    (slope(h), (slope(h) - slope(2.0 * h)).abs() + rounding)
}

#[test]
fn derivatives_agree_with_central_differences() {
    let functions = [
        "sqrt(x+3)",
        "exp(x)",
        "log(x+3)",
        "sin(x)",
        "cos(x)",
        "tan(x)",
        "sec(x)",
        "csc(x)",
        "cot(x)",
        "asin(x/3)",
        "acos(x/3)",
        "atan(x)",
        "sinh(x)",
        "cosh(x)",
        "tanh(x)",
        "erf(x)",
        "erfc(x)",
        "square(x)",
        "cube(x)",
        "recip(x)",
        "abs(x)",
        "floor(x)",
        "ceil(x)",
        "step(x)",
        "delta(x)",
        "-x",
        "x^5",
        "x^-4",
        "(x+3)^2.5",
        "(x+3)^y",
        "y^x",
        "(x+3)^x",
        "x*y",
        "x/y",
        "y/x",
        "x*x/(1+x)",
        "atan2(x, y)",
        "atan2(y, x)",
        "min(x, y)",
        "max(x, y)",
        "min(y, x)",
        "select(step(x-y), x^2, x^3)",
        "select(x, y, z)",
        "exp(-x^2/2)*cos(3*x+y)",
        "a^2*exp(a); a=sin(b); b=x*y",
        "4*y*((1/s)^12-(1/s)^6); s=abs(x)+1",
        "1-x",
        "y-x",
        "x-y",
        "log(1+exp(x*y))",
        "sin(x)^2+cos(x)^2",
    ];
    for text in functions {
        let f = parse(text);
        for (name, i) in [("x", 0), ("y", 1)] {
            let slope = f.derivative(name);
            for point in [[0.7, 1.3, 2.0], [-1.1, 0.4, 1.0], [0.31, 2.9, -0.5], [1.9, 1.0, 0.0]] {
                let along = |x: f64| {
                    let mut at = point;
                    at[i] = x;
                    f.value(&at)
                };
                let (expected, error) = central_difference(along, point[i]);
                let got = slope.value(&point);
                assert!(
                    (got - expected).abs() <= error,
                    "d({text})/d{name} at {point:?}: {got} {expected} {error}"
                );
                // The budget must be able to notice a wrong derivative.
                assert!(error <= 1e-6 * expected.abs().max(10.0), "{text} {name}: {error}");
            }
        }
        assert_eq!(f.derivative("z").value(&[0.7, 1.3, 2.0]), 0.0, "{text}");
    }
}

#[test]
fn derivatives_at_kinks_and_ends_are_finite() {
    for (text, at, expected) in [
        ("abs(x)", 0.0, 0.0),
        ("min(x, 0)", 0.0, 1.0),
        ("max(x, 0)", 0.0, 1.0),
        ("x^2", 0.0, 0.0),
        ("x^y", 0.0, 0.0),
        ("tanh(x)", 1000.0, 0.0),
        ("1/x", 1e-200, -f64::INFINITY),
        ("1e200/(1e200*x)", 1.0, -1.0),
        ("step(x)*5", 0.0, 0.0),
    ] {
        assert_eq!(parse(text).derivative("x").value(&[at, 2.0, 0.0]), expected, "{text}");
    }
    // The fourth derivative of a fourth power.
    let f = parse("x^4");
    assert_eq!(f.derivative("x").derivative("x").derivative("x").derivative("x").as_constant(), Some(24.0));
    assert!(parse("x*0 + y").depends_on("y") && !parse("x*0 + y").depends_on("x"));
    assert_eq!(parse("2*pi").as_constant(), Some(2.0 * PI));
}

/// A tree that is written with all parentheses and evaluated step by step.
enum Tree {
    Number(f64),
    Variable(usize),
    One(&'static str, Box<Tree>),
    Two(&'static str, Box<Tree>, Box<Tree>),
    Select(Box<[Tree; 3]>),
}

impl Tree {
    fn random(r: &mut Random, depth: usize) -> Tree {
        const ONE: [&str; 12] =
            ["-", "sin", "cos", "exp", "atan", "abs", "step", "floor", "square", "cube", "recip", "sqrt"];
        const TWO: [&str; 6] = ["+", "-", "*", "/", "min", "max"];
        let below = |r: &mut Random| Tree::random(r, depth - 1);
        match if depth == 0 { r.below(2) } else { r.below(9) } {
            0 => Tree::Number((r.uniform() * 8.0).ceil() / 4.0),
            1 => Tree::Variable(r.below(3)),
            2..=4 => Tree::One(ONE[r.below(ONE.len())], Box::new(below(r))),
            8 => Tree::Select(Box::new([below(r), below(r), below(r)])),
            _ => Tree::Two(TWO[r.below(TWO.len())], Box::new(below(r)), Box::new(below(r))),
        }
    }
    fn write(&self) -> String {
        match self {
            Tree::Number(x) => x.to_string(),
            Tree::Variable(i) => XYZ[*i].into(),
            Tree::One("-", a) => format!("(-{})", a.write()),
            Tree::One(f, a) => format!("{f}({})", a.write()),
            Tree::Two(f @ ("min" | "max"), a, b) => format!("{f}({},{})", a.write(), b.write()),
            Tree::Two(f, a, b) => format!("({}{f}{})", a.write(), b.write()),
            Tree::Select(t) => format!("select({},{},{})", t[0].write(), t[1].write(), t[2].write()),
        }
    }
    /// `None` where something on the way is not finite: simplification may leave it out.
    fn value(&self, at: &[f64]) -> Option<f64> {
        let value = match self {
            Tree::Number(x) => *x,
            Tree::Variable(i) => at[*i],
            Tree::One(f, a) => {
                let x = a.value(at)?;
                match *f {
                    "-" => -x,
                    "sin" => x.sin(),
                    "cos" => x.cos(),
                    "exp" => x.exp(),
                    "atan" => x.atan(),
                    "abs" => x.abs(),
                    "step" => f64::from(x >= 0.0),
                    "floor" => x.floor(),
                    "square" => x * x,
                    "cube" => x * x * x,
                    "recip" => 1.0 / x,
                    _ => x.sqrt(),
                }
            }
            Tree::Two(f, a, b) => {
                let (x, y) = (a.value(at)?, b.value(at)?);
                match *f {
                    "+" => x + y,
                    "-" => x - y,
                    "*" => x * y,
                    "/" => x / y,
                    "min" => x.min(y),
                    _ => x.max(y),
                }
            }
            Tree::Select(t) => {
                let [c, x, y] = [t[0].value(at)?, t[1].value(at)?, t[2].value(at)?];
                if c != 0.0 { x } else { y }
            }
        };
        value.is_finite().then_some(value)
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Sharing, simplification and registers change no bit; and what is written reads back as the same function.
    #[test]
    fn programs_are_equal_to_trees(seed: u64) {
        let mut r = Random::new(seed);
        let tree = Tree::random(&mut r, 7);
        let f = parse(&tree.write());
        let slope = f.derivative("x");
        let (again, slope_again) = (parse(&f.to_string()), parse(&slope.to_string()));
        for _ in 0..4 {
            let at = r.vector().map(|x| 2.0 * x);
            let value = f.value(&at);
            if let Some(expected) = tree.value(&at) {
                prop_assert_eq!(value, expected, "{} at {:?}", tree.write(), at);
            }
            prop_assert!(same(value, again.value(&at)), "{} is not {}", f, again);
            prop_assert!(same(slope.value(&at), slope_again.value(&at)), "{} is not {}", slope, slope_again);
        }
    }
}

fn same(a: f64, b: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan())
}

/// Values and slopes by OpenMM's own parser, of expressions written without the parentheses that would hide how operators
/// bind; the file says how it was made.
#[test]
fn values_and_slopes_are_those_of_openmm() {
    const FILE: &str =
        include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../validation/data/expressions/openmm.txt"));
    // Two programs round some twenty operations each; the scales hold how the result takes changes of its inputs.
    const BUDGET: f64 = 64.0 * f64::EPSILON;
    let numbers = |text: &str| -> Vec<f64> {
        text.split_whitespace().map(|word| word.parse().expect("a number")).collect()
    };
    let lines: Vec<&str> = FILE.lines().filter(|line| !line.starts_with('#')).collect();
    assert!(lines.len() > 200);
    for line in lines {
        let parts: Vec<&str> = line.split(" | ").collect();
        let [text, at, value, slopes, scale, slope_scale] = parts[..] else { panic!("{line}") };
        let (f, at) = (parse(text), numbers(at));
        let error = (f.value(&at) - numbers(value)[0]).abs();
        assert!(error <= BUDGET * numbers(scale)[0], "{line}: {error:e}");
        for (name, expected) in XYZ.iter().zip(numbers(slopes)) {
            let error = (f.derivative(name).value(&at) - expected).abs();
            assert!(error <= BUDGET * numbers(slope_scale)[0].max(1.0), "{line}: d/d{name} {error:e}");
        }
    }
}
