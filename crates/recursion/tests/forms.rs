//! The forms of forward dynamics against their dense twins, on generated trees and on chains at the edges.

mod common;

use common::{agree, seeds, wide_wrenches};
use phipsi_recursion as fast;
use phipsi_recursion::Layout;
use phipsi_reference as slow;
use phipsi_reference::generate::Case;
use phipsi_reference::sensitivity::widened;

/// κ alone: no mass ratio multiplies it.
fn kappa(_: &Case, _: &mut [f64]) {}

#[test]
fn square_root_forward_dynamics() {
    agree(
        "square_root_forward_dynamics",
        |layout, case| {
            let Case { model, q, v, tau, wrenches, .. } = case;
            fast::square_root_forward_dynamics(model, layout, q, v, tau, Some(wrenches))
        },
        |case| {
            let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
            slow::square_root_forward_dynamics(&case.model, &q, &v, &tau, Some(&wide_wrenches(case)))
                .expect("generated trees are regular")
        },
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

#[test]
fn x() {
    let _ = (seeds(1), Layout::<f64>::new);
}
