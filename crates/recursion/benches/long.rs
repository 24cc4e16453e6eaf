//! Long chains and large trees: time per body must not grow with their number. One state, workspace kept.

mod common;

use common::{Example, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::{ForwardDynamics, InverseDynamics};

const CHAINS: [&str; 4] = ["chain_100", "chain_10000", "chain_100000", "chain_1000000"];
const TREES: [&str; 4] = ["tree_100", "tree_10000", "tree_100000", "tree_1000000"];

fn main() {
    common::header("Long chains and large trees, one state; items are bodies");
    divan::main();
}

fn forward(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::with_states(model, 1);
    let work = ForwardDynamics::new(&example.layout);
    let bodies = ItemsCount::new(example.layout.len());
    bencher.counter(bodies).bench_local(calls(&example, example.layout.nv(), work, |work, e, s, out| {
        work.run(&e.layout, &s.q, &s.v, &s.x, None, out)
    }));
}

fn inverse(bencher: Bencher<'_, '_>, model: &str) {
    let example = Example::with_states(model, 1);
    let work = InverseDynamics::new(&example.layout);
    let bodies = ItemsCount::new(example.layout.len());
    bencher.counter(bodies).bench_local(calls(&example, example.layout.nv(), work, |work, e, s, out| {
        work.run(&e.layout, &s.q, &s.v, &s.x, None, out)
    }));
}

#[divan::bench(args = CHAINS, min_time = 0.1, max_time = 2)]
fn forward_dynamics_chain(bencher: Bencher<'_, '_>, model: &str) {
    forward(bencher, model);
}

#[divan::bench(args = TREES, min_time = 0.1, max_time = 2)]
fn forward_dynamics_tree(bencher: Bencher<'_, '_>, model: &str) {
    forward(bencher, model);
}

#[divan::bench(args = CHAINS, min_time = 0.1, max_time = 2)]
fn inverse_dynamics_chain(bencher: Bencher<'_, '_>, model: &str) {
    inverse(bencher, model);
}

#[divan::bench(args = TREES, min_time = 0.1, max_time = 2)]
fn inverse_dynamics_tree(bencher: Bencher<'_, '_>, model: &str) {
    inverse(bencher, model);
}
