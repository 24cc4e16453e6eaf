//! Serial chains at the edges: heavy and light tips, masses and lengths over decades, far places, fast joints.
//!
//! Slender rods along x, one-axis joints at their ends; the scenes of soa.md 2.2 and 2.6, each addressed by its name.

use crate::generate::Case;
use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder, Placement, Random};
use phipsi_spatial::{Vec3, Wrench};

/// A chain with a name.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What is extreme in it.
    pub name: String,
    /// Model and state.
    pub case: Case,
}

/// A serial chain. Link k hangs at the end of link k − 1, the first one at `offset`.
#[derive(Clone, Debug)]
pub struct Chain {
    /// kg.
    pub masses: Vec<f64>,
    /// m.
    pub lengths: Vec<f64>,
    /// Joint axes: 0, 1, 2 for x, y, z of the link.
    pub axes: Vec<usize>,
    /// Place of the first joint, m.
    pub offset: [f64; 3],
    /// Gravity along −y, m/s².
    pub gravity: f64,
    /// Radius over length of the rods.
    pub radius: f64,
}

impl Chain {
    /// n equal rods of 1 kg and 1 m, axes y and z in turn.
    pub fn uniform(n: usize) -> Self {
        let axes = (0..n).map(|k| 1 + k % 2).collect();
        Chain {
            masses: vec![1.0; n],
            lengths: vec![1.0; n],
            axes,
            offset: [0.0; 3],
            gravity: 9.81,
            radius: 0.05,
        }
    }
    /// With a state.
    pub fn case(&self, q: Vec<f64>, v: Vec<f64>, tau: Vec<f64>) -> Case {
        let mut builder = ModelBuilder::new("chain").gravity([0.0, -self.gravity, 0.0]);
        let mut parent = "world".to_string();
        for (k, (&m, &l)) in self.masses.iter().zip(&self.lengths).enumerate() {
            let axial = 0.5 * self.radius * self.radius * m * l * l;
            let across = m * l * l / 12.0 + axial / 2.0;
            let inertia = Inertia::from_principal(m, [l / 2.0, 0.0, 0.0], [axial, across, across]);
            let at = if k == 0 { self.offset } else { [self.lengths[k - 1], 0.0, 0.0] };
            let placement = Placement { translation: at, ..Placement::IDENTITY };
            let axis = Vec3::unit(self.axes[k]).0;
            let joint = Joint::new(format!("joint{k}"), JointKind::Revolute { axis }).at(placement);
            let name = format!("link{k}");
            builder =
                builder.body(Body::new(name.as_str(), inertia)).joint(joint, parent.as_str(), name.as_str());
            parent = name;
        }
        let model = builder.build().expect("a chain is a valid model");
        let n = model.len();
        let wrenches = vec![Wrench::zero(); n];
        let a = vec![0.0; model.nv()];
        let rounding = wrenches.clone();
        Case { model, q, v, a, tau, wrenches, rounding, body: n - 1, point: Vec3::zero() }
    }
    /// With random angles up to `bend`, rates up to `rate`, joint forces up to mass times length of the link.
    pub fn scene(&self, name: &str, seed: u64, bend: f64, rate: f64) -> Scene {
        let n = self.masses.len();
        let mut random = Random::new(seed);
        let mut numbers = |scale: f64| (0..n).map(|_| scale * random.signed()).collect::<Vec<f64>>();
        let (q, v, mut tau) = (numbers(bend), numbers(rate), numbers(1.0));
        tau.iter_mut().zip(&self.masses).zip(&self.lengths).for_each(|((tau, m), l)| *tau *= m * l);
        Scene { name: name.into(), case: self.case(q, v, tau) }
    }
}

/// Masses over a hundred decades, lengths over sixteen: beyond what the plain recursion can do even in double-double numbers.
pub fn beyond() -> Vec<Scene> {
    let scaled = |from: f64, ratio: f64, n: usize| powers(ratio, n).into_iter().map(|x| from * x).collect();
    let heavier = Chain { masses: scaled(1e-50, 1e10, 10), ..Chain::uniform(10) };
    let longer =
        Chain { masses: scaled(1e-30, 1e3, 16), lengths: scaled(1e-8, 10.0, 16), ..Chain::uniform(16) };
    vec![
        heavier.scene("mass x1e10 per link", 1, 0.5, 1.0),
        longer.scene("length x10 per link, mass as its cube", 1, 0.5, 1.0),
    ]
}

fn powers(base: f64, n: usize) -> Vec<f64> {
    (0..n).map(|k| base.powi(k as i32)).collect()
}

/// The scenes of soa.md 2.2, in its order, and more of each kind.
pub fn scenes() -> Vec<Scene> {
    let uniform = Chain::uniform;
    let mut all = Vec::new();
    for n in [16, 64, 256] {
        let planar = Chain { axes: vec![2; n], ..uniform(n) };
        all.push(planar.scene(&format!("planar straight n={n}"), n as u64, 0.0, 1.0));
    }
    for n in [64, 1000] {
        all.push(uniform(n).scene(&format!("y/z alternating n={n}"), n as u64, 0.3, 1.0));
    }
    for decade in [-12, -6, 3, 6, 9, 12] {
        let mut chain = uniform(10);
        chain.masses[9] = 10f64.powi(decade);
        all.push(chain.scene(&format!("tip mass 1e{decade}"), (100 + decade) as u64, 0.5, 1.0));
    }
    for decade in [-12, -6] {
        let mut chain = uniform(10);
        chain.masses[0] = 10f64.powi(decade);
        all.push(chain.scene(&format!("base mass 1e{decade}"), (130 + decade) as u64, 0.5, 1.0));
    }
    for ratio in [0.1, 2.0, 4.0, 10.0] {
        let chain = Chain { masses: powers(ratio, 20), ..uniform(20) };
        all.push(chain.scene(&format!("mass x{ratio} per link"), 200, 0.5, 1.0));
    }
    for decade in [3, 6, 9, 12, 15] {
        let mut chain = uniform(20);
        chain.masses.iter_mut().skip(1).step_by(2).for_each(|m| *m = 10f64.powi(-decade));
        all.push(chain.scene(&format!("alternating 1 : 1e-{decade}"), 300 + decade as u64, 0.5, 1.0));
    }
    for ratio in [0.1, 0.25, 0.5, 1.25, 2.0, 3.0, 4.0] {
        let chain =
            Chain { masses: powers(ratio * ratio * ratio, 20), lengths: powers(ratio, 20), ..uniform(20) };
        all.push(chain.scene(&format!("length x{ratio} per link, mass as its cube"), 400, 0.5, 1.0));
    }
    for radius in [1e-2, 1e-5, 1e-8] {
        let chain = Chain { axes: (0..12).map(|k| k % 3).collect(), radius, ..uniform(12) };
        all.push(chain.scene(&format!("rods of radius {radius:e}, axes x, y, z"), 450, 0.5, 1.0));
    }
    for offset in [1e4, 1e8] {
        let chain = Chain { offset: [offset, -offset, offset], ..uniform(10) };
        all.push(chain.scene(&format!("offset {offset:e}"), 500, 0.5, 1.0));
    }
    for rate in [1e-8, 1e6, 1e8] {
        all.push(uniform(10).scene(&format!("joint rates {rate:e}"), 600, 0.5, rate));
    }
    all
}
