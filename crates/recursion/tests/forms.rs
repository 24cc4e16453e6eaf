//! The forms of forward dynamics against their dense twins, on generated trees and on chains at the edges.

use crate::common::{SAMPLES, agree, compare, scaled_condition, seeds, steps, wide_wrenches};
use phipsi_model::{JointKind, Random, Subject};
use phipsi_recursion as fast;
use phipsi_recursion::{
    ArticulatedSweep, DynamicsError, Form, FormChoice, FormForwardDynamics, Layout,
    SquareRootForwardDynamics, forward_info, singular_hinges,
};
use phipsi_reference as slow;
use phipsi_reference::extreme::{Chain, beyond, scenes};
use phipsi_reference::generate::{Case, Limits, case, case_within, rebuilt, starved};
use phipsi_reference::sensitivity::{sensitivity, widened};
use phipsi_spatial::{Dd, Scalar, Wrench};

/// κ alone: no mass ratio multiplies it. Twice, since six perturbations find half of what forty do (seed 779).
fn kappa(_: &Case, size: &mut [f64]) {
    size.iter_mut().for_each(|x| *x *= 2.0);
}

fn dense(case: &Case) -> Vec<Dd> {
    let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
    slow::square_root_forward_dynamics(&case.model, &q, &v, &tau, Some(&wide_wrenches(case)))
        .expect("generated trees are regular")
}

fn run(form: Form, layout: &Layout<f64>, case: &Case) -> Result<Vec<f64>, DynamicsError> {
    let mut out = vec![0.0; layout.nv()];
    FormForwardDynamics::new(&case.model, layout, form).run(
        layout,
        &case.q,
        &case.v,
        &case.tau,
        Some(&case.wrenches),
        &mut out,
    )?;
    Ok(out)
}

/// Largest error over largest number.
fn relative(got: &[f64], want: &[Dd]) -> f64 {
    let scale = want.iter().fold(0.0f64, |m, x| m.max(x.hi.abs()));
    let worst = got.iter().zip(want).fold(0.0f64, |m, (x, y)| m.max((Dd::from_f64(*x) - *y).hi.abs()));
    if worst == 0.0 { 0.0 } else { worst / scale }
}

#[test]
fn square_root_forward_dynamics() {
    agree(
        "square_root_forward_dynamics",
        |layout, case| {
            let Case { model, q, v, tau, wrenches, .. } = case;
            fast::square_root_forward_dynamics(model, layout, q, v, tau, Some(wrenches))
        },
        dense,
        kappa,
    );
}

#[test]
fn refined_forward_dynamics() {
    agree(
        "refined_forward_dynamics",
        |layout, case| {
            fast::refined_forward_dynamics(layout, &case.q, &case.v, &case.tau, Some(&case.wrenches))
        },
        |case| {
            let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
            slow::refined_forward_dynamics(&case.model, &q, &v, &tau, Some(&wide_wrenches(case)))
                .expect("generated trees are regular")
        },
        kappa,
    );
}

/// Lengths twice a link outward, masses as their cubes: refinement finds what the plain form lost (soa.md 2.2: 4e-11 and 9e-14), on any
/// processor: n ε κ, with κ = 25 and 4 for what the plain form leaves.
#[test]
fn refinement_finds_the_digits_of_chains_that_grow_outward() {
    let scenes = scenes();
    let scene = scenes.iter().find(|s| s.name == "length x2 per link, mass as its cube").unwrap();
    let layout = Layout::<f64>::new(&scene.case.model);
    let got = run(Form::Refined, &layout, &scene.case).unwrap();
    let (error, allowed) =
        (relative(&got, &dense(&scene.case)), 4.0 * layout.len() as f64 * f64::EPSILON * 25.0);
    assert!(error <= allowed, "{error:e}, allowed {allowed:e}");
}

/// Only the last rounding is left: ½ ε of each number, and what the reference loses.
#[test]
fn double_double_form_rounds_once() {
    for seed in seeds(200) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        let got = run(Form::DoubleDouble, &layout, &case).unwrap();
        let want = dense(&case);
        let size: Vec<f64> = want.iter().map(|x| x.hi.abs()).collect();
        let largest = size.iter().fold(0.0f64, |m, x| m.max(*x));
        let lost = 100.0 * steps(&case) * Dd::EPSILON * scaled_condition(&case) * largest;
        for (i, (x, y)) in got.iter().zip(&want).enumerate() {
            let error = (Dd::from_f64(*x) - *y).hi.abs();
            assert!(error <= 0.5 * f64::EPSILON * size[i] + lost, "[{i}], PHIPSI_SEED={seed}: {error:e}");
        }
    }
}

/// The square-root form in double-double numbers keeps thirty digits of the largest component.
#[test]
fn square_root_form_in_double_double_numbers() {
    for seed in seeds(100) {
        let case = case(seed);
        let layout = Layout::<Dd>::new(&case.model);
        let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
        let (want, size) = sensitivity(&case, SAMPLES, seed, dense);
        let largest = size.iter().fold(0.0f64, |m, x| m.max(*x));
        let wrenches = wide_wrenches(&case);
        let got =
            fast::square_root_forward_dynamics(&case.model, &layout, &q, &v, &tau, Some(&wrenches)).unwrap();
        let unit = steps(&case) * Dd::EPSILON;
        compare("square_root", seed, &got, &want, &vec![2.0 * largest; got.len()], unit);
    }
}

/// Seven digits, for models without decades of masses; what cancels rounds by its terms, a thousandth of the largest component.
#[test]
fn square_root_form_in_single_precision() {
    for seed in seeds(200) {
        let limits = Limits { degrees_of_freedom: 1 + (seed % 12) as usize, decades: 0.5 };
        let mut case = case_within(seed, limits);
        for x in [&mut case.q, &mut case.v, &mut case.tau] {
            x.iter_mut().for_each(|x| *x = f64::from(*x as f32));
        }
        case.wrenches.iter_mut().for_each(|w| *w = Wrench::zero());
        let [q, v, tau] =
            [&case.q, &case.v, &case.tau].map(|x| x.iter().map(|&x| x as f32).collect::<Vec<_>>());
        let layout = Layout::<f32>::new(&case.model);
        let got = fast::square_root_forward_dynamics(&case.model, &layout, &q, &v, &tau, None).unwrap();
        let (want, mut size) = sensitivity(&case, SAMPLES, seed, dense);
        kappa(&case, &mut size);
        let largest = size.iter().fold(0.0f64, |m, x| m.max(*x));
        size.iter_mut().for_each(|x| *x = x.max(1e-3 * largest));
        compare("f32", seed, &got, &want, &size, steps(&case) * f64::from(f32::EPSILON));
    }
}

/// Trees with bodies without mass and points, wherever no hinge is singular: the rows of M are fewer than six.
#[test]
fn bodies_without_mass_and_points() {
    let mut tried = 0;
    for seed in seeds(1000) {
        let mut case = case(seed);
        case.model = starved(&mut Random::new(seed), &case.model);
        if case.model.nv() == 0 || !singular_hinges(&case.model).is_empty() {
            continue;
        }
        // At this configuration the reference must find it regular too.
        let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
        let judge =
            slow::square_root_forward_dynamics(&case.model, &q, &v, &tau, Some(&wide_wrenches(&case)));
        if judge.is_err() || scaled_condition(&case) > 1e8 {
            continue;
        }
        tried += 1;
        let (want, mut size) = sensitivity(&case, SAMPLES, seed, dense);
        kappa(&case, &mut size);
        let largest = size.iter().fold(0.0f64, |m, x| m.max(*x));
        size.iter_mut().for_each(|x| *x += 16.0 * f64::EPSILON * largest);
        let layout = Layout::<f64>::new(&case.model);
        let got = run(Form::SquareRoot, &layout, &case).unwrap_or_else(|e| panic!("PHIPSI_SEED={seed}: {e}"));
        compare("starved", seed, &got, &want, &size, steps(&case) * f64::EPSILON);
    }
    assert!(tried > 100 || std::env::var("PHIPSI_SEED").is_ok(), "{tried}");
}

/// A hinge that carries nothing has the name of the plain form's error.
#[test]
fn a_singular_hinge_is_named() {
    let mut found = 0;
    for seed in seeds(1000) {
        let mut case = case(seed);
        case.model = starved(&mut Random::new(seed), &case.model);
        let singular = singular_hinges(&case.model);
        if singular.is_empty() {
            continue;
        }
        found += 1;
        let layout = Layout::<f64>::new(&case.model);
        match run(Form::SquareRoot, &layout, &case) {
            Err(DynamicsError::SingularHinge { joint, .. }) => {
                // The first one that elimination meets.
                let named = Subject::Joint(joint);
                assert!(singular.iter().any(|s| s.subject == named), "PHIPSI_SEED={seed}: {named:?}");
            }
            other => panic!("PHIPSI_SEED={seed}: {other:?} instead of one of {singular:?}"),
        }
    }
    assert!(found > 100 || std::env::var("PHIPSI_SEED").is_ok(), "{found}");
}

/// Accelerations of a scene in double-double numbers, on which the plain and the square-root recursion agree. The dense
/// reference, in world axes, has no digits left where lengths grow over ten decades.
fn judge(name: &str, case: &Case) -> Vec<Dd> {
    let layout = Layout::<Dd>::new(&case.model);
    let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
    let plain = fast::forward_dynamics(&layout, &q, &v, &tau, None).expect("chains are regular");
    let root = fast::square_root_forward_dynamics(&case.model, &layout, &q, &v, &tau, None).unwrap();
    let rounded: Vec<f64> = root.iter().map(|x| x.hi).collect();
    assert!(relative(&rounded, &plain) <= f64::EPSILON, "{name}: {:e}", relative(&rounded, &plain));
    plain
}

/// The lines of soa.md 2.3 and the last column of its table 2.2, or better: what no scene may exceed.
fn line(name: &str) -> f64 {
    match name {
        "tip mass 1e6" => 1e-13,
        "tip mass 1e9" => 1e-12,
        "tip mass 1e12" => 1e-11,
        "mass x10 per link" => 5e-14,
        "length x2 per link, mass as its cube" => 2e-14,
        // Twenty links over twelve decades of length: 3e-9 there.
        "length x3 per link, mass as its cube" | "length x4 per link, mass as its cube" => 1e-13,
        _ => 1e-14,
    }
}

/// Forward error of the square-root form, and that of the form chosen; backward error of the latter ≤ 100 n ε.
#[test]
fn extreme_chains_keep_their_digits() {
    for scene in scenes() {
        let (name, case) = (&scene.name, &scene.case);
        let layout = Layout::<f64>::new(&case.model);
        let want = judge(name, case);
        let error = relative(&run(Form::SquareRoot, &layout, case).unwrap(), &want);
        assert!(error <= line(name), "{name}: {error:e}");
        let choice = FormChoice::of(&case.model, &layout);
        assert!(choice.is_sufficient(), "{name}: {choice}");
        let a = run(choice.form, &layout, case).unwrap();
        let error = relative(&a, &want);
        assert!(error <= choice.limit, "{name}, {choice}: {error:e}");
        let info = forward_info(&layout, &case.q, &case.v, &case.tau, None, &a).unwrap();
        let allowed = 100.0 * layout.len() as f64 * f64::EPSILON;
        assert!(info.backward_error <= allowed, "{name}, {choice}: {:e}", info.backward_error);
    }
}

/// Where even double-double numbers fail in the plain recursion, the square-root form agrees with itself in those numbers:
/// its rows do not know of each other's size.
#[test]
fn beyond_the_reach_of_the_plain_recursion() {
    for scene in beyond() {
        let (name, case) = (&scene.name, &scene.case);
        let layout = Layout::<f64>::new(&case.model);
        let choice = FormChoice::of(&case.model, &layout);
        assert_eq!(choice.form, Form::SquareRoot, "{name}: {choice}");
        assert!(choice.is_sufficient() && choice.plain_error > 0.1, "{name}: {choice}");
        let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
        let wide = Layout::<Dd>::new(&case.model);
        let want = fast::square_root_forward_dynamics(&case.model, &wide, &q, &v, &tau, None).unwrap();
        let a = run(Form::SquareRoot, &layout, case).unwrap();
        let error = relative(&a, &want);
        assert!(error <= choice.limit, "{name}: {error:e}");
        // Also where the plain sweep finds no positive D, the result is judged.
        let info = forward_info(&layout, &case.q, &case.v, &case.tau, None, &a).unwrap();
        let allowed = 100.0 * layout.len() as f64 * f64::EPSILON;
        assert!(info.backward_error <= allowed, "{name}: {:e}", info.backward_error);
        let fails = ArticulatedSweep::new(&layout, &case.q).is_err();
        assert_eq!(fails, info.worst_hinge.is_some_and(|worst| worst.ratio == 0.0), "{name}");
    }
}

#[test]
fn heavy_tips_are_not_left_to_the_plain_form() {
    for (mass, form) in
        [(1.0, Form::Plain), (1e-12, Form::Plain), (1e6, Form::Refined), (1e12, Form::SquareRoot)]
    {
        let mut chain = Chain::uniform(10);
        chain.masses[9] = mass;
        let case = chain.scene("tip", 1, 0.5, 1.0).case;
        let layout = Layout::<f64>::new(&case.model);
        assert_eq!(FormChoice::of(&case.model, &layout).form, form, "{mass}");
    }
}

/// Trees with masses over up to eight decades: what is chosen keeps its limit, or says that it does not.
#[test]
fn the_chosen_form_keeps_what_it_promises() {
    let mut chosen = std::collections::BTreeMap::new();
    for seed in seeds(400) {
        let limits = Limits { degrees_of_freedom: 1 + (seed % 30) as usize, decades: (seed % 5) as f64 };
        let case = case_within(seed, limits);
        let layout = Layout::<f64>::new(&case.model);
        let choice = FormChoice::of(&case.model, &layout);
        *chosen.entry(choice.form.name()).or_insert(0) += 1;
        let (want, size) = sensitivity(&case, SAMPLES, seed, dense);
        let largest = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0f64, f64::max);
        let kappa = largest(&mut size.iter().copied()) / largest(&mut want.iter().map(|x| x.hi.abs()));
        let error = relative(&run(choice.form, &layout, &case).unwrap(), &want);
        // This state may be worse than those tried, and worse conditioned.
        let allowed = 4.0 * choice.limit + 8.0 * steps(&case) * f64::EPSILON * kappa;
        assert!(!choice.is_sufficient() || error <= allowed, "PHIPSI_SEED={seed}, {choice}: {error:e}");
    }
    println!("{chosen:?}");
    assert!(chosen.len() >= 2 || std::env::var("PHIPSI_SEED").is_ok(), "{chosen:?}");
}

/// A scene moved by 1e8 m has the same accelerations in every form, to 10 ε of the largest.
#[test]
fn a_far_scene_has_the_same_accelerations_in_every_form() {
    for seed in seeds(100) {
        let near = case(seed);
        let root = |k: usize| near.model.tree().parent(k).is_none();
        // Placements of joints on a fixed root are sums with its own: they round.
        if (0..near.model.len()).any(|k| root(k) && near.model.joints()[k].kind == JointKind::Fixed) {
            continue;
        }
        let moved = |k: usize, joint: &phipsi_model::Joint| {
            let mut placement = joint.placement;
            if root(k) {
                placement.translation = [1e8, -1e8, 1e8];
            }
            (joint.kind, placement)
        };
        let model = rebuilt(&near.model, |_, body| body.inertia, moved, near.model.gravity());
        let far = Case { model, ..near.clone() };
        for form in [Form::Plain, Form::Refined, Form::SquareRoot, Form::DoubleDouble] {
            let [a, b] = [&near, &far].map(|case| run(form, &Layout::<f64>::new(&case.model), case).unwrap());
            let b: Vec<Dd> = b.into_iter().map(Dd::from_f64).collect();
            let error = relative(&a, &b);
            assert!(error <= 10.0 * f64::EPSILON, "{form}, PHIPSI_SEED={seed}: {error:e}");
        }
    }
}

/// A choice that does not keep its limit says so.
#[test]
fn a_choice_that_is_not_good_says_so() {
    let good = FormChoice { form: Form::SquareRoot, plain_error: 1e-3, error: 1e-14, limit: 3e-13 };
    assert!(good.is_sufficient() && good.why().contains("of the plain form 1e-3"), "{good}");
    let bad = FormChoice { error: 1e-9, ..good };
    assert!(!bad.is_sufficient() && bad.to_string().contains("1e-9, more than 3e-13"), "{bad}");
    let unknown = FormChoice { error: f64::INFINITY, ..good };
    assert!(!unknown.is_sufficient());
}

#[test]
fn forms_have_names() {
    for form in Form::ALL {
        assert_eq!(Form::from_name(form.name()), Some(form));
    }
    assert_eq!(Form::from_name("Plain"), None);
    assert_eq!(Form::default(), Form::Auto);
}

/// Wrong lengths are refused by name, another layout's workspace too.
#[test]
fn wrong_lengths_are_named() {
    let case = case(3);
    let layout = Layout::<f64>::new(&case.model);
    let short = &case.tau[1..];
    for form in Form::ALL {
        let mut forward = FormForwardDynamics::new(&case.model, &layout, form);
        let mut out = vec![0.0; layout.nv()];
        match forward.run(&layout, &case.q, &case.v, short, None, &mut out) {
            Err(DynamicsError::Shape { argument: "tau", expected, found }) => {
                assert_eq!((expected, found), (layout.nv(), layout.nv() - 1), "{form}");
            }
            other => panic!("{form}: {other:?}"),
        }
    }
    let other = Layout::<f64>::new(&Chain::uniform(50).scene("", 1, 0.1, 1.0).case.model);
    let x = vec![0.1; 50];
    let mut out = vec![0.0; 50];
    let found = SquareRootForwardDynamics::new(&case.model, &layout).run(&other, &x, &x, &x, None, &mut out);
    assert!(matches!(found, Err(DynamicsError::Shape { argument: "workspace", .. })), "{found:?}");
}

/// Numbers that are not finite do not panic; coordinates that are not are an error.
#[test]
fn numbers_that_are_not_finite_do_not_panic() {
    for seed in seeds(100) {
        let case = case(seed);
        let layout = Layout::<f64>::new(&case.model);
        for form in [Form::Refined, Form::SquareRoot, Form::DoubleDouble] {
            for bad in [f64::NAN, f64::INFINITY] {
                let spoiled = |x: &[f64]| x.iter().map(|_| bad).collect::<Vec<f64>>();
                let _ = run(form, &layout, &Case { v: spoiled(&case.v), ..case.clone() });
                let _ = run(form, &layout, &Case { tau: spoiled(&case.tau), ..case.clone() });
                let _ = run(form, &layout, &Case { q: spoiled(&case.q), ..case.clone() });
            }
        }
    }
}
