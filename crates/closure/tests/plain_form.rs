//! The plain form against the dense twin, against the mixed form, and where it must not be used.

use crate::against_reference::{judge, largest, run, seeds};
use phipsi_closure::{ClosedDynamics, ClosedForm, ClosureError, Conditions};
use phipsi_model::{Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use phipsi_reference::loops::closed_case;

/// The same mechanisms, budgets and ranks as the mixed form; states that are left to that one are counted.
#[test]
fn the_plain_form_agrees_with_the_dense_solution() {
    let (mut plain, mut redundant, mut again, mut open) = (0, 0, 0, 0);
    let mut worst = [(0.0f64, 0u64); 4];
    for seed in seeds() {
        let closed = closed_case(seed);
        let info = run::<f64>(&closed, ClosedForm::Auto).info;
        if info.form == ClosedForm::Mixed {
            again += 1;
            continue;
        }
        plain += 1;
        open += usize::from(info.rows == 0);
        redundant += usize::from(info.rank < info.rows);
        let found = judge(&closed, seed, &mut [0; 5], ClosedForm::Plain);
        for (worst, ratio) in worst.iter_mut().zip(found) {
            if ratio > worst.0 {
                *worst = (ratio, seed);
            }
        }
    }
    println!(
        "plain in {plain} states, {redundant} of them with redundant rows, {open} open; mixed in {again}"
    );
    println!("acceleration, multipliers, force, generalised forces: worst n·ε·κ {worst:?}");
    assert!(std::env::var("PHIPSI_SEED").is_ok() || (plain > 100 && redundant > 5));
}

/// Where `Auto` is plain it has the rank of the mixed form, and its numbers but for rounding; elsewhere it has its bits.
#[test]
fn auto_is_plain_or_mixed() {
    let mut worst = 0.0f64;
    for seed in seeds() {
        let closed = closed_case(seed);
        let (auto, mixed) = (run::<f64>(&closed, ClosedForm::Auto), run::<f64>(&closed, ClosedForm::Mixed));
        assert_eq!(mixed.info.form, ClosedForm::Mixed);
        assert_eq!(auto.info.rank, mixed.info.rank, "PHIPSI_SEED={seed}: {:?}", auto.info);
        assert_eq!(auto.info.inconsistency, None, "PHIPSI_SEED={seed}");
        let pairs = [
            (&auto.acceleration, &mixed.acceleration),
            (&auto.multipliers, &mixed.multipliers),
            (&auto.force, &mixed.force),
            (&auto.tau, &mixed.tau),
        ];
        for (a, b) in pairs {
            if auto.info.form == ClosedForm::Mixed {
                assert_eq!(a, b, "PHIPSI_SEED={seed}");
                continue;
            }
            let difference = largest(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<_>>());
            let size = largest(b).max(largest(&mixed.force)).max(1e-300);
            let sigma = mixed.info.smallest_pivot.min(1.0);
            worst = worst.max(difference / size * sigma);
        }
        if auto.info.form == ClosedForm::Plain && auto.info.rank > 0 {
            let ratio = auto.info.smallest_pivot / mixed.info.smallest_pivot;
            assert!((ratio - 1.0).abs() < 1e-6, "PHIPSI_SEED={seed}: {ratio}");
        }
    }
    println!("difference of the forms over 1/σ, relative: {worst:.1e}");
}

fn at(x: f64, y: f64) -> Placement {
    Placement::from_xyz_rpy([x, y, 0.0], [0.0; 3])
}

/// A planar four-bar, its pin's frames turned in space or not.
fn four_bar(turn: f64) -> Model {
    let rod = |name: &str| Body::new(name, Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.01, 0.1, 0.1]));
    let hinge =
        |name: &str, x: f64| Joint::new(name, JointKind::Revolute { axis: [0.0, 0.0, 1.0] }).at(at(x, 0.0));
    let pin = |x: f64| Placement::from_xyz_rpy([x, 0.0, 0.0], [turn, 0.7 * turn, 0.0]);
    ModelBuilder::new("four-bar")
        .gravity([0.0, -9.81, 0.0])
        .body(rod("crank"))
        .body(rod("coupler"))
        .body(rod("rocker"))
        .joint(hinge("a", 0.0), "world", "crank")
        .joint(hinge("b", 1.0), "crank", "coupler")
        .joint(hinge("c", 1.0), "world", "rocker")
        .closure(Closure {
            name: "pin".into(),
            kind: ClosureKind::Spherical,
            body_a: "coupler".into(),
            pose_a: pin(1.0),
            body_b: "rocker".into(),
            pose_b: pin(1.0),
        })
        .build()
        .unwrap()
}

/// A parallelogram near the pose in which it is flat: plain while σ > 1e-4, and the mixed form's bits where it is not.
#[test]
fn nearly_singular_states_are_redone() {
    let model = four_bar(0.0);
    let [mut auto, mut plain] = [ClosedForm::Auto, ClosedForm::Plain]
        .map(|form| ClosedDynamics::new(&model).unwrap().with_form(form).unwrap());
    let mut mixed = ClosedDynamics::<f64>::new(&model).unwrap();
    for delta in [1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10] {
        let (q, v) = ([delta, -delta, delta], [0.5, -0.5, 0.5]);
        let (mut a, mut b) = ([0.0; 3], [0.0; 3]);
        let none = Conditions::default();
        let want = mixed.run(&q, &v, &[0.0; 3], &none, &mut b).unwrap().info();
        assert_eq!(want.rank, 2, "{delta:e}: {want:?}");
        let got = auto.run(&q, &v, &[0.0; 3], &none, &mut a).unwrap().info();
        println!("δ = {delta:e}: σ {:.1e}, {:?}, {:.1e}", want.smallest_pivot, got.form, (a[0] - b[0]).abs());
        assert_eq!(got.rank, 2, "{delta:e}: {got:?}");
        if want.smallest_pivot < 0.99e-4 {
            assert_eq!(got.form, ClosedForm::Mixed, "{delta:e}: {got:?}");
            assert_eq!(a, b, "{delta:e}");
            let error = plain.run(&q, &v, &[0.0; 3], &none, &mut a).unwrap_err();
            assert!(matches!(&error, ClosureError::PlainForm { closure, .. } if closure == "pin"), "{error}");
            assert!(error.to_string().contains("solve in the form `Auto` or `Mixed`"), "{error}");
        } else if want.smallest_pivot > 1.01e-4 {
            assert_eq!(got.form, ClosedForm::Plain, "{delta:e}: {got:?}");
        }
    }
}

/// Of a planar loop the plain form leaves out the row across the plane; where the rows' axes are oblique no row is zero by itself,
/// and the state is redone.
#[test]
fn only_rows_that_are_zero_by_themselves_are_left_out() {
    for (turn, form) in [(0.0, ClosedForm::Plain), (0.4, ClosedForm::Mixed)] {
        let model = four_bar(turn);
        let mut dynamics = ClosedDynamics::new(&model).unwrap().with_form(ClosedForm::Auto).unwrap();
        let mut a = [0.0; 3];
        let solved = dynamics
            .run(&[1.0, -1.0, 1.0], &[0.5, -0.5, 0.5], &[0.0; 3], &Conditions::default(), &mut a)
            .unwrap();
        assert_eq!((solved.info().form, solved.info().rank), (form, 2), "{:?}", solved.info());
        assert_eq!(solved.redundant().len(), 1);
    }
}
