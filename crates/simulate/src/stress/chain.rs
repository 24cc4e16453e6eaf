//! Serial chains of rods with one-axis joints at their ends.

use phipsi_model::{
    Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, ModelErrors, Placement, Random,
};

/// A chain: link k hangs at the end of link k − 1, the first one at `offset`.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    /// kg.
    pub masses: Vec<f64>,
    /// m.
    pub lengths: Vec<f64>,
    /// Joint axes: 0, 1, 2 for x, y, z of the link; x is along it.
    pub axes: Vec<usize>,
    /// Place of the first joint, m.
    pub offset: [f64; 3],
    /// Gravity along −y, m/s².
    pub gravity: f64,
    /// Radius over length of the rods.
    pub radius: f64,
    /// Whether the first link moves freely.
    pub base: Base,
}

/// A state of a model with forces.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub tau: Vec<f64>,
}

impl Chain {
    /// n equal rods of 1 kg and 1 m, axes y and z in turn.
    pub fn uniform(n: usize) -> Self {
        Chain {
            masses: vec![1.0; n],
            lengths: vec![1.0; n],
            axes: (0..n).map(|k| 1 + k % 2).collect(),
            offset: [0.0; 3],
            gravity: 9.81,
            radius: 0.05,
            base: Base::Fixed,
        }
    }
    /// Masses (kg) and lengths (m) that grow by factors from link to link.
    pub fn growing(n: usize, mass: f64, length: f64) -> Self {
        let powers = |x: f64| (0..n).map(|k| x.powi(k as i32)).collect();
        Chain { masses: powers(mass), lengths: powers(length), ..Chain::uniform(n) }
    }
    /// The model.
    pub fn model(&self) -> Result<Model, ModelErrors> {
        let mut builder = ModelBuilder::new("chain").gravity([0.0, -self.gravity, 0.0]);
        let free = matches!(self.base, Base::Free);
        for (k, (&m, &l)) in self.masses.iter().zip(&self.lengths).enumerate() {
            let axial = 0.5 * self.radius * self.radius * m * l * l;
            let across = m * l * l / 12.0 + axial / 2.0;
            let inertia = Inertia::from_principal(m, [l / 2.0, 0.0, 0.0], [axial, across, across]);
            builder = builder.body(Body::new(format!("link{k}"), inertia));
            if k == 0 && free {
                continue;
            }
            let at = if k == 0 { self.offset } else { [self.lengths[k - 1], 0.0, 0.0] };
            let mut axis = [0.0; 3];
            axis[self.axes[k]] = 1.0;
            let joint = Joint::new(format!("joint{k}"), JointKind::Continuous { axis })
                .at(Placement { translation: at, ..Placement::IDENTITY });
            let parent = if k == 0 { "world".to_string() } else { format!("link{}", k - 1) };
            builder = builder.joint(joint, parent, format!("link{k}"));
        }
        builder.base(self.base).build()
    }
    /// Random angles up to `bend`, rates up to `rate`, joint forces up to mass times length of the link. A free base lies at the
    /// origin and does not turn.
    pub fn state(&self, seed: u64, bend: f64, rate: f64) -> State {
        let mut random = Random::new(seed);
        let mut numbers =
            |scale: f64| self.masses.iter().map(|_| scale * random.signed()).collect::<Vec<f64>>();
        let (mut q, mut v, mut tau) = (numbers(bend), numbers(rate), numbers(1.0));
        for ((tau, m), l) in tau.iter_mut().zip(&self.masses).zip(&self.lengths) {
            *tau *= m * l;
        }
        if let Base::Free = self.base {
            q.splice(..1, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
            v.splice(..1, [0.0; 6]);
            tau.splice(..1, [0.0; 6]);
        }
        State { q, v, tau }
    }
}
