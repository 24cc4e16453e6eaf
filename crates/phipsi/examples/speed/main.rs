//! phipsi's side of `python -m validation.speed`: times the kernels on the states that it is given.
//!
//! MODEL is `FILE.urdf` or `FILE.urdf#LINK` (the link of the Jacobian), or `chain:N`, a chain made here; with closed loops,
//! `FILE.loops`: the path of its tree, a line with gravity, then a line `NAME KIND LINK X Y Z ROLL PITCH YAW LINK X Y Z ROLL PITCH YAW` for each closure.
//! STATES-FILE may be `random:COUNT`. The operations are the arms of [`Program::operation`].

mod protocol;

use phipsi::closure::{ClosedDynamics, Conditions};
use phipsi::model::{
    Base, Body, Closure, ClosureKind, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random,
};
use phipsi::prelude::{Mimic, UrdfOptions, read_urdf_file};
use phipsi::recursion::batch::{BatchRunner, Input, StateKernel, kernels};
use phipsi::recursion::{
    CentroidalMomentumMatrix, ForwardDynamics, ForwardDynamicsDerivatives, InverseDynamics,
    InverseDynamicsDerivatives, Jacobian, Layout, MassMatrix, MassMatrixInverse,
};
use phipsi::spatial::lanes::Level;
use protocol::{Call, Failure, Operation, Program, States, serve};

struct Open {
    model: Model,
    layout: Layout<f64>,
    /// The body whose Jacobian is taken.
    target: Option<usize>,
}

impl Open {
    fn new(model: Model, target: Option<usize>) -> Self {
        let layout = Layout::new(&model);
        Open { model, layout, target }
    }
}

impl Open {
    /// A kernel of (q, v, τ) on all states at once; `size` results a state.
    fn batch<'a, K: StateKernel + 'a>(&'a self, kernel: K, size: usize, s: &'a States) -> Operation<'a> {
        let (nq, nv) = s.dimensions();
        let runner = BatchRunner::new(kernel, Level::best());
        let mut call: Call<'a> = Box::new(move |_, out| {
            let [q, v, tau, _] = s.all();
            let inputs = [Input::each(q, nq), Input::each(v, nv), Input::each(tau, nv)];
            let done = runner.run(&inputs, s.count, out);
            Ok(done.map_err(|(_, error)| error)?)
        });
        // Workspaces, which a runner keeps, are made before the time begins; an error comes again.
        call(0, &mut vec![0.0; size * s.count]).ok();
        Operation { size, batch: true, call }
    }
}

impl Program for Open {
    fn open(name: &str) -> Result<Self, Failure> {
        if let Some(n) = name.strip_prefix("chain:") {
            return Ok(Open::new(chain(n.parse()?)?, None));
        }
        if name.ends_with(".loops") {
            return Ok(Open::new(closed(&std::fs::read_to_string(name)?)?, None));
        }
        let (path, link) = name.split_once('#').unwrap_or((name, ""));
        let model = tree(path)?;
        let target = if link.is_empty() { None } else { model.find_body(link)? };
        Ok(Open::new(model, target))
    }

    fn states(&self, name: &str) -> Option<States> {
        let count = name.strip_prefix("random:")?.parse().ok()?;
        let mut rows: [Vec<f64>; 4] = Default::default();
        for seed in 0..count as u64 {
            let state = self.model.random_state(seed);
            let mut random = Random::new(seed);
            rows[0].extend(state.q);
            rows[1].extend(state.v);
            rows[2].extend((0..self.model.nv()).map(|_| random.signed()));
            rows[3].extend((0..self.model.nv()).map(|_| random.signed()));
        }
        Some(States::new(count, self.model.nq(), self.model.nv(), rows))
    }

    fn operation<'a>(&'a self, name: &str, s: &'a States) -> Result<Option<Operation<'a>>, Failure> {
        let (layout, nv) = (&self.layout, self.model.nv());
        if s.dimensions() != (self.model.nq(), nv) {
            return Err("the states have other dimensions than the model".into());
        }
        let one = |size: usize, call: Call<'a>| Operation { size, batch: false, call };
        Ok(Some(match name {
            "forward_dynamics" => {
                let mut workspace = ForwardDynamics::new(layout);
                one(
                    nv,
                    Box::new(move |i, out| Ok(workspace.run(layout, s.q(i), s.v(i), s.tau(i), None, out)?)),
                )
            }
            "closed_forward_dynamics" => {
                let mut workspace = ClosedDynamics::new(&self.model)?;
                one(
                    nv,
                    Box::new(move |i, out| {
                        workspace.run(s.q(i), s.v(i), s.tau(i), &Conditions::default(), out)?;
                        Ok(())
                    }),
                )
            }
            "inverse_dynamics" => {
                let mut workspace = InverseDynamics::new(layout);
                one(nv, Box::new(move |i, out| Ok(workspace.run(layout, s.q(i), s.v(i), s.a(i), None, out)?)))
            }
            "mass_matrix" => {
                let mut workspace = MassMatrix::new(layout);
                one(nv * nv, Box::new(move |i, out| Ok(workspace.run(layout, s.q(i), out)?)))
            }
            "mass_matrix_inverse" => {
                let mut workspace = MassMatrixInverse::new(layout);
                one(nv * nv, Box::new(move |i, out| Ok(workspace.run(layout, s.q(i), out)?)))
            }
            "inverse_dynamics_derivatives" => {
                let mut workspace = InverseDynamicsDerivatives::new(layout);
                one(
                    3 * nv * nv,
                    Box::new(move |i, out| {
                        let [d_dq, d_dv, d_da] = thirds(out);
                        Ok(workspace.run(layout, s.q(i), s.v(i), s.a(i), None, d_dq, d_dv, d_da)?)
                    }),
                )
            }
            "forward_dynamics_derivatives" => {
                let mut workspace = ForwardDynamicsDerivatives::new(layout);
                one(
                    3 * nv * nv,
                    Box::new(move |i, out| {
                        let [d_dq, d_dv, d_dtau] = thirds(out);
                        Ok(workspace.run(layout, s.q(i), s.v(i), s.tau(i), None, d_dq, d_dv, d_dtau)?)
                    }),
                )
            }
            "jacobian" => {
                let mut workspace = Jacobian::new(layout);
                one(
                    6 * nv,
                    Box::new(move |i, out| Ok(workspace.run(layout, s.q(i), self.target, None, out)?)),
                )
            }
            "centroidal" => {
                let mut workspace = CentroidalMomentumMatrix::new(layout);
                one(6 * nv, Box::new(move |i, out| Ok(workspace.run(layout, s.q(i), out)?)))
            }
            "forward_dynamics_batch" => self.batch(kernels::ForwardDynamics { layout, loaded: &[] }, nv, s),
            "derivatives_batch" => {
                self.batch(kernels::ForwardDynamicsDerivatives { layout, loaded: &[] }, 3 * nv * nv, s)
            }
            _ => return Ok(None),
        }))
    }
}

/// The model of a URDF file.
fn tree(path: &str) -> Result<Model, Failure> {
    let options = UrdfOptions { base: Base::Fixed, mimic: Mimic::Free };
    Ok(read_urdf_file(path, &options).into_result(false)?.0)
}

/// A tree and its closures.
fn closed(text: &str) -> Result<Model, Failure> {
    let mut lines = text.lines();
    let model = tree(lines.next().ok_or("the file lacks its tree")?)?;
    let gravity: Vec<f64> = lines
        .next()
        .ok_or("the file lacks its gravity")?
        .split_ascii_whitespace()
        .map(str::parse)
        .collect::<Result<_, _>>()?;
    let &[x, y, z] = &gravity[..] else { return Err("gravity is three numbers".into()) };
    let mut model = model.with_gravity([x, y, z]);
    for line in lines {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let &[name, kind, ..] = &words[..] else { return Err("a closure lacks its kind".into()) };
        let side = |first: usize| -> Result<(String, Placement), Failure> {
            let words = words.get(first..first + 7).ok_or("a closure ends early")?;
            let mut x = [0.0f64; 6];
            for (x, word) in x.iter_mut().zip(&words[1..]) {
                *x = word.parse()?;
            }
            Ok((words[0].into(), Placement::from_xyz_rpy([x[0], x[1], x[2]], [x[3], x[4], x[5]])))
        };
        let ((body_a, pose_a), (body_b, pose_b)) = (side(2)?, side(9)?);
        let kind = if kind == "weld" { ClosureKind::Weld } else { ClosureKind::Spherical };
        model = model.with_closure(Closure { name: name.into(), kind, body_a, pose_a, body_b, pose_b })?;
    }
    Ok(model)
}

/// Three matrices of one buffer.
fn thirds<T>(out: &mut [T]) -> [&mut [T]; 3] {
    let n = out.len() / 3;
    let (first, rest) = out.split_at_mut(n);
    let (second, third) = rest.split_at_mut(n);
    [first, second, third]
}

/// n equal rods on revolute joints whose axes turn from joint to joint.
fn chain(n: usize) -> Result<Model, Failure> {
    let rod = Inertia::from_principal(1.0, [0.0, 0.0, 0.05], [0.01, 0.012, 0.004]);
    let mut builder = ModelBuilder::new("chain");
    let mut parent = "world".to_owned();
    for i in 0..n {
        let name = format!("link{i}");
        let placement = Placement::from_xyz_rpy([0.0, 0.0, if i == 0 { 0.0 } else { 0.1 }], [1.1, 0.4, 0.0]);
        let joint =
            Joint::new(format!("joint{i}"), JointKind::Revolute { axis: [0.0, 0.0, 1.0] }).at(placement);
        builder = builder.body(Body::new(name.as_str(), rod)).joint(joint, &parent, &name);
        parent = name;
    }
    Ok(builder.build()?)
}

fn main() -> Result<(), Failure> {
    serve::<Open>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi::recursion::{forward_dynamics, inverse_dynamics};
    use protocol::reply;

    /// The answers to questions, in one session.
    fn session(lines: &[&str]) -> Vec<String> {
        let mut open = None;
        lines
            .iter()
            .map(|line| reply::<Open>(&mut open, line).unwrap_or_else(|reason| format!("error: {reason}")))
            .collect()
    }

    fn result(answer: &str) -> Vec<f64> {
        let numbers = answer.strip_prefix("result ").expect("a result").split(' ');
        numbers.map(|x| x.parse().expect("a number")).collect()
    }

    #[test]
    fn results_are_the_kernels() {
        let open = Open::open("chain:5").expect("a chain");
        let s = open.states("random:3").expect("states");
        let answers = session(&[
            "chain:5 forward_dynamics random:3 -2",
            "chain:5 inverse_dynamics random:3 0",
            // States are cycled.
            "chain:5 forward_dynamics random:3 -5",
        ]);
        let forward = forward_dynamics(&open.layout, s.q(2), s.v(2), s.tau(2), None).expect("accelerations");
        let inverse = inverse_dynamics(&open.layout, s.q(0), s.v(0), s.a(0), None).expect("forces");
        assert_eq!(result(&answers[0]), forward);
        assert_eq!(result(&answers[1]), inverse);
        assert_eq!(answers[2], answers[0]);
    }

    #[test]
    fn a_batch_has_the_results_of_its_states() {
        let pairs = [
            ("forward_dynamics_batch", "forward_dynamics"),
            ("derivatives_batch", "forward_dynamics_derivatives"),
        ];
        for ((many, one), state) in pairs.into_iter().flat_map(|pair| (0..11).map(move |state| (pair, state)))
        {
            let ask = |operation| format!("chain:5 {operation} random:11 -{state}");
            let answers = session(&[&ask(many), &ask(one)]);
            let (many, one) = (result(&answers[0]), result(&answers[1]));
            let scale = one.iter().fold(0.0f64, |m, x| m.max(x.abs()));
            // Rounding of a few hundred operations per body.
            assert!(
                many.iter().zip(&one).all(|(a, b)| (a - b).abs() < 1e3 * f64::EPSILON * scale),
                "{state}"
            );
        }
    }

    #[test]
    fn times_are_positive_and_checksums_those_of_the_last_call() {
        let answers = session(&["chain:5 mass_matrix random:3 3", "chain:5 mass_matrix random:3 -2"]);
        let (ns, sum) = answers[0].split_once(' ').expect("two numbers");
        assert!(ns.parse::<f64>().expect("a time") > 0.0);
        assert_eq!(sum.parse::<f64>().expect("a sum"), result(&answers[1]).iter().sum::<f64>());
    }

    #[test]
    fn every_operation_has_its_size() {
        for (operation, size) in [
            ("forward_dynamics", 5),
            ("inverse_dynamics", 5),
            ("mass_matrix", 25),
            ("mass_matrix_inverse", 25),
            ("forward_dynamics_batch", 5),
            ("derivatives_batch", 75),
            ("inverse_dynamics_derivatives", 75),
            ("forward_dynamics_derivatives", 75),
            ("jacobian", 30),
            ("centroidal", 30),
        ] {
            let answer = session(&[&format!("chain:5 {operation} random:1 0")]);
            assert_eq!(result(&answer[0]).len(), size, "{operation}");
        }
    }

    #[test]
    fn what_is_wrong_is_answered_in_words() {
        let answers = session(&[
            "chain:5 flying random:3 1",
            "nowhere.urdf forward_dynamics random:3 1",
            "chain:5 forward_dynamics nowhere 1",
            "chain:5 forward_dynamics random:3",
            "chain:5 forward_dynamics random:3 many",
            "chain:x forward_dynamics random:3 1",
            "chain:5 forward_dynamics random:0 1",
            "chain:5 forward_dynamics random:3 0",
        ]);
        assert_eq!(answers[0], "unsupported");
        assert!(answers[1..7].iter().all(|a| a.starts_with("error: ")), "{answers:?}");
        // The session goes on.
        assert_eq!(result(&answers[7]).len(), 5);
    }
}
