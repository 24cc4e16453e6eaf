//! Which form a mechanism is solved in: a heavy body on a light loop keeps its digits.

use crate::mechanisms::four_bars;
use phipsi_closure::{ClosedDynamics, ClosedForm, ClosedFormChoice, Conditions, HeavyBody};
use phipsi_model::{
    Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random,
};
use phipsi_recursion::Form;
use phipsi_reference::closed_dynamics::{Given, closed_dynamics};
use phipsi_reference::kinematics::kinematics;
use phipsi_reference::loops::{TOLERANCE, closed_case};
use phipsi_reference::sensitivity::widened;
use phipsi_spatial::{Dd, Real, Vec3};

const LINKS: usize = 8;

/// Links of 1 m in the x-z plane, one behind the other, of 1 kg but for the heavy one; the tip is pinned to the ground where it is at q.
fn pinned_chain(ratio: f64, heavy: usize, q: &[f64]) -> Model {
    let link = |k: usize| {
        let mass = if k == heavy { ratio } else { 1.0 };
        Body::new(
            format!("b{k}"),
            Inertia::from_principal(mass, [0.5, 0.0, 0.0], [0.01, 1.0 / 12.0, 1.0 / 12.0].map(|x| x * mass)),
        )
    };
    let mut builder = ModelBuilder::new("pinned").gravity([0.0, 0.0, -9.81]);
    for k in 0..LINKS {
        let place = Placement::from_xyz_rpy([if k == 0 { 0.0 } else { 1.0 }, 0.0, 0.0], [0.0; 3]);
        let joint = Joint::new(format!("j{k}"), JointKind::Revolute { axis: [0.0, 1.0, 0.0] }).at(place);
        let parent = if k == 0 { "world".into() } else { format!("b{}", k - 1) };
        builder = builder.body(link(k)).joint(joint, parent, format!("b{k}"));
    }
    let tree = builder.clone().build().unwrap();
    let zero = vec![Dd::from_f64(0.0); LINKS];
    let tip =
        kinematics(&tree, &widened(q), &zero, &zero)[LINKS - 1].pose.point(Vec3::splat([1.0, 0.0, 0.0]));
    builder
        .closure(Closure {
            name: "pin".into(),
            kind: ClosureKind::Spherical,
            body_a: "world".into(),
            pose_a: Placement::from_xyz_rpy(tip.0.map(|x| x.to_f64()), [0.0; 3]),
            body_b: format!("b{}", LINKS - 1),
            pose_b: Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3]),
        })
        .build()
        .unwrap()
}

fn largest(x: impl Iterator<Item = f64>) -> f64 {
    x.fold(0.0, |most, x| most.max(x.abs()))
}

/// Dense accelerations in double-double numbers.
fn exact(model: &Model, q: &[f64], v: &[f64], tau: &[f64]) -> Vec<f64> {
    let o = Dd::from_f64(0.0);
    let given = Given {
        wrenches: None,
        gamma: vec![o; 3],
        active: vec![false; LINKS],
        acceleration: vec![o; LINKS],
        length: 1.0,
        tolerance: TOLERANCE,
    };
    let solved = closed_dynamics(model, &widened(q), &widened(v), &widened(tau), &given).unwrap();
    solved.acceleration.iter().map(|a| a.to_f64()).collect()
}

/// `auto` is mixed for equal masses and square-root for a body a hundred million times heavier than its links; each keeps n·ε·κ, times the
/// root of the mass ratio (soa.md 2.2), where the mixed form loses thousands of times as much.
#[test]
fn a_heavy_body_on_a_light_loop_keeps_its_digits() {
    let mut random = Random::new(3);
    let mut lost = 0.0f64;
    for (ratio, form) in [(1.0, ClosedForm::Mixed), (1e8, ClosedForm::SquareRoot)] {
        for _ in 0..4 {
            let mut numbers =
                |size: f64| -> Vec<f64> { (0..LINKS).map(|_| size * random.signed()).collect() };
            let (q, v, tau) = (numbers(1.5), numbers(1.0), numbers(1.0));
            let model = pinned_chain(ratio, 4, &q);
            let choice = ClosedFormChoice::new(&model, Form::Auto).unwrap();
            assert_eq!(choice.form, form, "{choice}");
            assert!(choice.is_sufficient(), "{choice}");
            let truth = exact(&model, &q, &v, &tau);
            let scale = largest(truth.iter().copied());
            let error = |form: ClosedForm| {
                let mut dynamics = ClosedDynamics::<f64>::new(&model).unwrap().with_form(form).unwrap();
                let mut a = vec![0.0; LINKS];
                let info = dynamics.run(&q, &v, &tau, &Conditions::default(), &mut a).unwrap().info();
                assert_eq!((info.form, info.rank), (form, 2));
                largest(a.iter().zip(&truth).map(|(a, b)| a - b)) / scale
            };
            // κ: the largest change by small relative ones of all that is given, in units of those.
            let small = 1e-7;
            let kappa = (0..12).fold(1.0f64, |most, _| {
                let mut near = |x: &[f64]| -> Vec<f64> {
                    x.iter().map(|x| x * (1.0 + small * random.signed())).collect()
                };
                let moved = exact(&model, &near(&q), &near(&v), &near(&tau));
                most.max(largest(moved.iter().zip(&truth).map(|(a, b)| a - b)) / (small * scale))
            });
            let unit = (2 * LINKS + 3) as f64 * f64::EPSILON * kappa;
            let (chosen, mixed) = (error(form), error(ClosedForm::Mixed));
            println!("ratio {ratio:e}: {choice}; κ {kappa:.1e}, error {chosen:.1e}, mixed {mixed:.1e}");
            assert!(chosen <= 2.0 * ratio.sqrt() * unit, "{chosen:e}, κ = {kappa:e}");
            if ratio > 1.0 {
                lost = lost.max(mixed / chosen.max(f64::EPSILON));
            }
        }
    }
    assert!(lost > 1e3, "{lost:e}");
}

/// Wherever the heavy link hangs, accelerations are right to 1e-12 or the choice says that they are not, and which body it is; it says
/// nothing of a link that is not heavy, nor of one that hangs between light ones.
#[test]
fn a_heavy_body_next_to_the_cut_is_told() {
    let mut random = Random::new(11);
    let mut told = [0; LINKS];
    for ratio in [1.0, 1e3, 1e8] {
        for heavy in 0..LINKS {
            for _ in 0..6 {
                let mut numbers =
                    |size: f64| -> Vec<f64> { (0..LINKS).map(|_| size * random.signed()).collect() };
                let (q, v, tau) = (numbers(1.5), numbers(1.0), numbers(1.0));
                let model = pinned_chain(ratio, heavy, &q);
                let choice = ClosedFormChoice::new(&model, Form::Auto).unwrap();
                let truth = exact(&model, &q, &v, &tau);
                let mut dynamics =
                    ClosedDynamics::<f64>::new(&model).unwrap().with_form(choice.form).unwrap();
                let mut a = vec![0.0; LINKS];
                dynamics.run(&q, &v, &tau, &Conditions::default(), &mut a).unwrap();
                let error =
                    largest(a.iter().zip(&truth).map(|(a, b)| a - b)) / largest(truth.iter().copied());
                println!("{ratio:e} kg, link {heavy}: {error:.0e}, {choice}");
                assert!(
                    error <= 1e-12 || !choice.is_sufficient(),
                    "{ratio:e} kg, link {heavy}: {error:e}, {choice}"
                );
                if ratio < 1e8 {
                    assert!(choice.is_sufficient(), "{ratio:e} kg, link {heavy}: {error:e}, {choice}");
                }
                if choice.is_sufficient() {
                    assert_eq!(choice.heavy, None);
                    continue;
                }
                told[heavy] += 1;
                let expected = HeavyBody { body: format!("b{heavy}"), closure: "pin".into(), ratio };
                assert_eq!(choice.heavy, Some(expected));
                assert!(choice.why().contains("farther from it") && choice.error() > 3e-13, "{choice}");
            }
        }
    }
    // The two links next to the cut are told of at every closed position, the first three at none.
    assert_eq!((&told[..3], &told[6..]), (&[0; 3][..], &[6; 2][..]), "{told:?}");
}

/// Mechanisms of bodies of about the same mass: nothing is lost that needs a warning. Rows of four-bars at random positions have
/// condition numbers that grow with the power of their number, which is no form's loss.
#[test]
fn light_loops_are_not_warned_of() {
    let mut warned = Vec::new();
    for seed in 0..100 {
        let model = closed_case(seed).case.model;
        let choice = ClosedFormChoice::new(&model, Form::Auto).unwrap();
        if !choice.is_sufficient() {
            warned.push(format!("{seed}: {choice}, {:?}", choice.tree));
        }
    }
    for n in [1, 10, 100, 1000] {
        let choice = ClosedFormChoice::new(&four_bars(n), Form::Auto).unwrap();
        if choice.form != ClosedForm::Mixed || !choice.is_sufficient() {
            warned.push(format!("{n} four-bars: {choice}"));
        }
    }
    assert!(warned.is_empty(), "{}", warned.join("\n"));
}

/// What is asked for runs, or is refused by name.
#[test]
fn a_form_that_is_asked_for_is_taken() {
    let model = pinned_chain(1.0, 0, &[0.3; LINKS]);
    let of = |form| ClosedFormChoice::new(&model, form);
    let plain = of(Form::Plain).unwrap();
    assert_eq!((plain.form, plain.name()), (ClosedForm::Auto, "plain"));
    assert!(plain.why().contains("asked for"), "{plain}");
    let root = of(Form::SquareRoot).unwrap();
    assert_eq!((root.form, root.name()), (ClosedForm::SquareRoot, "square_root"));
    for form in [Form::Refined, Form::DoubleDouble] {
        let e = of(form).unwrap_err().to_string();
        assert!(e.contains(form.name()) && e.contains("square_root"), "{e}");
    }
}
