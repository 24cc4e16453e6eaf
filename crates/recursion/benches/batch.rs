//! Many states of one model at every level of lanes that this processor has: states a second.
//!
//! On one thread, unless the feature `parallel` is on.

mod common;

use common::Example;
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use phipsi_recursion::batch::{Input, StateKernel, kernels, run_batch};
use phipsi_spatial::lanes::Level;

const COUNT: usize = 1024;
const MODELS: [&str; 2] = ["arm_7", "quadruped_18"];

fn main() {
    common::header("Batches of 1024 states at each level of lanes; items are states");
    divan::main();
}

/// A level and a model, in a row's name.
struct Case(Level, &'static str);

impl std::fmt::Display for Case {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, {}", self.1, self.0.name())
    }
}

fn cases() -> Vec<Case> {
    let levels = || Level::ALL.into_iter().filter(|level| level.is_available());
    MODELS.into_iter().flat_map(|model| levels().map(move |level| Case(level, model))).collect()
}

/// `size` numbers of results a state.
fn time(bencher: Bencher<'_, '_>, example: &Example, level: Level, kernel: impl StateKernel, size: usize) {
    let (q, v, x) = (example.rows(|s| &s.q), example.rows(|s| &s.v), example.rows(|s| &s.x));
    let (nq, nv) = (example.layout.nq(), example.layout.nv());
    let inputs = [Input::each(&q, nq), Input::each(&v, nv), Input::each(&x, nv)];
    let mut out = vec![0.0; COUNT * size];
    bencher.counter(ItemsCount::new(COUNT)).bench_local(|| {
        run_batch(&kernel, level, &inputs, COUNT, &mut out)
            .map_err(|(_, error)| error)
            .expect("regular states");
        black_box(&mut out);
    });
}

#[divan::bench(args = cases(), min_time = 0.2)]
fn forward_dynamics(bencher: Bencher<'_, '_>, case: &Case) {
    let example = Example::with_states(case.1, COUNT as u32);
    let kernel = kernels::ForwardDynamics { layout: &example.layout, loaded: &[] };
    time(bencher, &example, case.0, kernel, example.layout.nv());
}

#[divan::bench(args = cases(), min_time = 0.2)]
fn inverse_dynamics(bencher: Bencher<'_, '_>, case: &Case) {
    let example = Example::with_states(case.1, COUNT as u32);
    let kernel = kernels::InverseDynamics { layout: &example.layout, loaded: &[] };
    time(bencher, &example, case.0, kernel, example.layout.nv());
}

#[divan::bench(args = cases(), min_time = 0.2)]
fn forward_dynamics_derivatives(bencher: Bencher<'_, '_>, case: &Case) {
    let example = Example::with_states(case.1, COUNT as u32);
    let kernel = kernels::ForwardDynamicsDerivatives { layout: &example.layout, loaded: &[] };
    time(bencher, &example, case.0, kernel, 3 * example.layout.nv().pow(2));
}
