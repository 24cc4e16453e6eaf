//! One kernel, called so and so many times: what `tools/instructions.py` counts instructions of.
//!
//!     instructions KERNEL MODEL CALLS
//!
//! Without arguments it lists the kernels and the models that are counted.

#[path = "../benches/common/mod.rs"]
mod common;

use common::{Example, STATES, calls, thirds};
use phipsi_recursion::batch::{Input, StateKernel, kernels, run_batch};
use phipsi_recursion::{
    ForwardDynamics, ForwardDynamicsDerivatives, InverseDynamics, InverseDynamicsDerivatives, MassMatrix,
    MassMatrixInverse, SquareRootForwardDynamics,
};
use phipsi_spatial::lanes::Level;
use std::process::ExitCode;

const KERNELS: [&str; 9] = [
    "forward_dynamics",
    "inverse_dynamics",
    "mass_matrix",
    "mass_matrix_inverse",
    "inverse_dynamics_derivatives",
    "forward_dynamics_derivatives",
    "square_root_forward_dynamics",
    "forward_dynamics_batch",
    "forward_dynamics_derivatives_batch",
];

/// States that a call of a `…_batch` kernel takes.
const BATCH: u32 = 64;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match &arguments[..] {
        [] => {
            println!("level {}", Level::best().name());
            println!("states {STATES}");
            println!("batch {BATCH}");
            println!("kernels {}", KERNELS.join(" "));
            println!("models {}", common::MODELS.join(" "));
            println!("compiler {}", common::compiler().unwrap_or_default());
            ExitCode::SUCCESS
        }
        [kernel, model, count] if KERNELS.contains(&kernel.as_str()) => match count.parse() {
            Ok(count) if common::MODELS.contains(&model.as_str()) => {
                run(kernel, model, count);
                ExitCode::SUCCESS
            }
            _ => refuse(),
        },
        _ => refuse(),
    }
}

fn refuse() -> ExitCode {
    eprintln!("usage: instructions KERNEL MODEL CALLS; without arguments the names are listed");
    ExitCode::FAILURE
}

/// A kernel on all states of an example at once, with `size` numbers of results each.
fn batch<'a, K: StateKernel + 'a>(e: &'a Example, size: usize, kernel: K) -> Box<dyn FnMut() + 'a> {
    let (count, nv) = (e.states.len(), e.layout.nv());
    let (q, v, x) = (e.rows(|s| &s.q), e.rows(|s| &s.v), e.rows(|s| &s.x));
    let mut out = vec![0.0; count * size];
    Box::new(move || {
        let inputs = [Input::each(&q, e.layout.nq()), Input::each(&v, nv), Input::each(&x, nv)];
        run_batch(&kernel, Level::best(), &inputs, count, &mut out)
            .map_err(|(_, error)| error)
            .expect("regular states");
        std::hint::black_box(&mut out);
    })
}

fn run(kernel: &str, model: &str, count: usize) {
    let states = if kernel.ends_with("_batch") { BATCH } else { STATES };
    let example = Example::with_states(model, states);
    let (e, layout, nv) = (&example, &example.layout, example.layout.nv());
    let mut call: Box<dyn FnMut() + '_> = match kernel {
        "forward_dynamics" => Box::new(calls(e, nv, ForwardDynamics::new(layout), |work, e, s, out| {
            work.run(&e.layout, &s.q, &s.v, &s.x, None, out)
        })),
        "inverse_dynamics" => Box::new(calls(e, nv, InverseDynamics::new(layout), |work, e, s, out| {
            work.run(&e.layout, &s.q, &s.v, &s.x, None, out)
        })),
        "mass_matrix" => Box::new(calls(e, nv * nv, MassMatrix::new(layout), |work, e, s, out| {
            work.run(&e.layout, &s.q, out)
        })),
        "mass_matrix_inverse" => {
            Box::new(calls(e, nv * nv, MassMatrixInverse::new(layout), |work, e, s, out| {
                work.run(&e.layout, &s.q, out)
            }))
        }
        "inverse_dynamics_derivatives" => {
            let work = InverseDynamicsDerivatives::new(layout);
            Box::new(calls(e, 3 * nv * nv, work, |work, e, s, out| {
                let [d_dq, d_dv, d_da] = thirds(out);
                work.run(&e.layout, &s.q, &s.v, &s.x, None, d_dq, d_dv, d_da)
            }))
        }
        "forward_dynamics_derivatives" => {
            let work = ForwardDynamicsDerivatives::new(layout);
            Box::new(calls(e, 3 * nv * nv, work, |work, e, s, out| {
                let [d_dq, d_dv, d_dtau] = thirds(out);
                work.run(&e.layout, &s.q, &s.v, &s.x, None, d_dq, d_dv, d_dtau)
            }))
        }
        "square_root_forward_dynamics" => {
            let work = SquareRootForwardDynamics::new(&e.model, layout);
            Box::new(calls(e, nv, work, |work, e, s, out| work.run(&e.layout, &s.q, &s.v, &s.x, None, out)))
        }
        "forward_dynamics_batch" => batch(e, nv, kernels::ForwardDynamics { layout, loaded: &[] }),
        "forward_dynamics_derivatives_batch" => {
            batch(e, 3 * nv * nv, kernels::ForwardDynamicsDerivatives { layout, loaded: &[] })
        }
        _ => unreachable!("the caller knows the names"),
    };
    (0..count).for_each(|_| call());
}
