//! The forms of forward dynamics on one state: what digits cost. Workspaces kept, kinematics included.

mod common;

use common::{Example, MODELS, STATES, calls};
use divan::Bencher;
use divan::counter::ItemsCount;
use phipsi_recursion::{Form, FormForwardDynamics};

fn main() {
    common::header("Forward dynamics of one state in each form; items are bodies");
    divan::main();
}

fn time(bencher: Bencher<'_, '_>, model: &str, form: Form) {
    let example = Example::named(model);
    let work = FormForwardDynamics::new(&example.model, &example.layout, form);
    let bodies = ItemsCount::new(example.layout.len());
    bencher.counter(bodies).bench_local(calls(&example, example.layout.nv(), work, |work, e, s, out| {
        work.run(&e.layout, &s.q, &s.v, &s.x, None, out)
    }));
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn plain(bencher: Bencher<'_, '_>, model: &str) {
    time(bencher, model, Form::Plain);
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn refined(bencher: Bencher<'_, '_>, model: &str) {
    time(bencher, model, Form::Refined);
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn square_root(bencher: Bencher<'_, '_>, model: &str) {
    time(bencher, model, Form::SquareRoot);
}

#[divan::bench(args = MODELS, sample_size = STATES, min_time = 0.1)]
fn double_double(bencher: Bencher<'_, '_>, model: &str) {
    time(bencher, model, Form::DoubleDouble);
}
