//! Long chains and large trees: time per body must not grow with their number. One state, workspace kept, on one thread
//! and on two (feature `parallel`), which serve the branches of a tree; a chain has none.

mod common;

use common::{Example, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::{ForwardDynamics, InverseDynamics};

const CHAINS: [&str; 4] = ["chain_100", "chain_10000", "chain_100000", "chain_1000000"];
const TREES: [&str; 4] = ["tree_100", "tree_10000", "tree_100000", "tree_1000000"];
const THREADS: [usize; 2] = [1, 2];

fn main() {
    common::header("Long chains and large trees, one state; items are bodies; 1 and 2 are threads");
    divan::main();
}

/// Calls in a pool of so many threads; of small trees without the pool, whose doors cost more than the call.
fn measure(bencher: Bencher<'_, '_>, threads: usize, example: &Example, mut call: impl FnMut() + Send) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let bencher = bencher.counter(ItemsCount::new(example.layout.len()));
    if example.layout.len() < 1000 {
        bencher.bench_local(call);
    } else {
        bencher.bench_local(|| pool.install(&mut call));
    }
}

fn forward(bencher: Bencher<'_, '_>, threads: usize, model: &str) {
    let example = Example::with_states(model, 1);
    let work = ForwardDynamics::new(&example.layout);
    let call = calls(&example, example.layout.nv(), work, |work, e, s, out| {
        work.run(&e.layout, &s.q, &s.v, &s.x, None, out)
    });
    measure(bencher, threads, &example, call);
}

fn inverse(bencher: Bencher<'_, '_>, threads: usize, model: &str) {
    let example = Example::with_states(model, 1);
    let work = InverseDynamics::new(&example.layout);
    let call = calls(&example, example.layout.nv(), work, |work, e, s, out| {
        work.run(&e.layout, &s.q, &s.v, &s.x, None, out)
    });
    measure(bencher, threads, &example, call);
}

#[divan::bench(args = CHAINS, consts = THREADS, min_time = 0.1, max_time = 2)]
fn forward_dynamics_chain<const N: usize>(bencher: Bencher<'_, '_>, model: &str) {
    forward(bencher, N, model);
}

#[divan::bench(args = TREES, consts = THREADS, min_time = 0.1, max_time = 2)]
fn forward_dynamics_tree<const N: usize>(bencher: Bencher<'_, '_>, model: &str) {
    forward(bencher, N, model);
}

#[divan::bench(args = CHAINS, consts = THREADS, min_time = 0.1, max_time = 2)]
fn inverse_dynamics_chain<const N: usize>(bencher: Bencher<'_, '_>, model: &str) {
    inverse(bencher, N, model);
}

#[divan::bench(args = TREES, consts = THREADS, min_time = 0.1, max_time = 2)]
fn inverse_dynamics_tree<const N: usize>(bencher: Bencher<'_, '_>, model: &str) {
    inverse(bencher, N, model);
}
