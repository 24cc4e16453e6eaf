//! The square-root form against the dense twin: without the growth of the tree's factors, whatever the masses.

use crate::against_reference::{growth, judge, seeds};
use phipsi_closure::ClosedForm;
use phipsi_model::{Body, Inertia, Joint, Random};
use phipsi_reference::generate::{Case, rebuilt};
use phipsi_reference::loops::{ClosedCase, closed_again, closed_case};

/// Every mass and its moments times a power of ten, up to 10^±`decades`.
fn unequal(closed: &ClosedCase, seed: u64, decades: f64) -> ClosedCase {
    if decades == 0.0 {
        return closed.clone();
    }
    let mut random = Random::new(seed ^ 0x0068_6561_7679);
    let body = |_: usize, body: &Body| {
        let factor = 10f64.powf(decades * random.signed());
        let Inertia { mass, frame, tensor } = body.inertia;
        Inertia { mass: factor * mass, frame, tensor: tensor.map(|x| factor * x) }
    };
    let tree = closed.case.model.clone().without_closures();
    let same = |_: usize, joint: &Joint| (joint.kind, joint.placement);
    let model = rebuilt(&tree, body, same, tree.gravity());
    closed_again(&Case { model, ..closed.case.clone() }, &closed.drafts)
}

/// All mechanisms, as they are and with masses over eight decades, with no more than the root of a mass ratio lost.
#[test]
fn the_square_root_form_agrees_with_the_dense_solution() {
    for decades in [0.0, 4.0] {
        let mut worst = [(0.0f64, 0u64); 4];
        for seed in seeds() {
            let closed = unequal(&closed_case(seed), seed, decades);
            let found = judge(&closed, seed, &mut [0; 5], ClosedForm::SquareRoot);
            for (worst, ratio) in worst.iter_mut().zip(found) {
                if ratio > worst.0 {
                    *worst = (ratio, seed);
                }
            }
        }
        println!("masses within 10^±{decades}: worst n·ε·κ {worst:?}");
    }
}

/// Masses over eight decades: accelerations off by more than 4 n·ε·κ, without any growth in the budget, are rarer than in the mixed
/// form, and off by less.
#[test]
fn heavy_bodies_on_light_ones_cost_fewer_digits() {
    let (mut counts, mut worst) = ([0; 2], [0.0f64; 2]);
    for seed in 0..400 {
        let closed = unequal(&closed_case(seed), seed, 4.0);
        let tree = Case { model: closed.case.model.clone().without_closures(), ..closed.case.clone() };
        let growth = growth(&tree);
        let forms = [(ClosedForm::Mixed, growth), (ClosedForm::SquareRoot, 2.0 * growth.sqrt())];
        for (i, (form, lost)) in forms.into_iter().enumerate() {
            let ratio = lost * judge(&closed, seed, &mut [0; 5], form)[0];
            counts[i] += usize::from(ratio > 4.0);
            worst[i] = worst[i].max(ratio);
        }
    }
    println!(
        "above 4 n·ε·κ: {} mixed, {} square-root; worst {:.0}, {:.0}",
        counts[0], counts[1], worst[0], worst[1]
    );
    assert!(2 * counts[1] < counts[0] && 5.0 * worst[1] < worst[0], "{counts:?}, {worst:?}");
}
