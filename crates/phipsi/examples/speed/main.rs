//! phipsi's side of `python -m validation.speed`: times the kernels on the states that it is given.
//!
//! MODEL is `FILE.urdf` or `FILE.urdf#LINK` (the link of the Jacobian), or `chain:N`, a chain made here. STATES-FILE may be
//! `random:COUNT`. The operations are the arms of [`Program::operation`].

mod protocol;

use phipsi::model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random};
use phipsi::prelude::{Mimic, UrdfOptions, read_urdf_file};
use phipsi::recursion::{
    ForwardDynamics, InverseDynamics, Layout, centroidal_momentum_matrix, jacobian, mass_matrix,
    mass_matrix_inverse,
};
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

impl Program for Open {
    fn open(name: &str) -> Result<Self, Failure> {
        if let Some(n) = name.strip_prefix("chain:") {
            return Ok(Open::new(chain(n.parse()?)?, None));
        }
        let (path, link) = name.split_once('#').unwrap_or((name, ""));
        let options = UrdfOptions { base: Base::Fixed, mimic: Mimic::Free };
        let (model, _) = read_urdf_file(path, &options).into_result(false)?;
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
            "inverse_dynamics" => {
                let mut workspace = InverseDynamics::new(layout);
                one(nv, Box::new(move |i, out| Ok(workspace.run(layout, s.q(i), s.v(i), s.a(i), None, out)?)))
            }
            "mass_matrix" => one(
                nv * nv,
                Box::new(move |i, out| {
                    out.copy_from_slice(&mass_matrix(layout, s.q(i))?);
                    Ok(())
                }),
            ),
            "mass_matrix_inverse" => one(
                nv * nv,
                Box::new(move |i, out| {
                    out.copy_from_slice(&mass_matrix_inverse(layout, s.q(i))?);
                    Ok(())
                }),
            ),
            "jacobian" => {
                one(6 * nv, Box::new(move |i, out| rows(out, &jacobian(layout, s.q(i), self.target, None)?)))
            }
            "centroidal" => {
                one(6 * nv, Box::new(move |i, out| rows(out, &centroidal_momentum_matrix(layout, s.q(i))?)))
            }
            _ => return Ok(None),
        }))
    }
}

/// Writes the rows of a matrix one after another.
fn rows(out: &mut [f64], matrix: &[Vec<f64>; 6]) -> Result<(), Failure> {
    let n = matrix[0].len();
    for (i, row) in matrix.iter().enumerate() {
        out[i * n..][..n].copy_from_slice(row);
    }
    Ok(())
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
