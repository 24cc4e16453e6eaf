//! Nosé–Hoover chains on the rigid and on the internal motion of molecules.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | η_j, r_j | position and rate of the j-th thermostat of a chain | Martyna, Klein, Tuckerman 1992 |
//! | Q_1, Q_j | n kT τ², kT τ²: n degrees of freedom of the group, relaxation time τ | the same |
//! | M_bb | inertia of each molecule with its hinges locked, at its base | paper 1, composite bodies |
//! | p_b, p^r | momenta of the bases; M (M_bb⁻¹ p_b, 0): those of molecules that move as rigid bodies with them | |
//! | p^i | p − p^r: internal motion, no momentum at the bases | |
//! | G_1 | p_g·v_g − n_g kT: the group's virial less its mean | |
//!
//! Between two half-steps of the chains is one step of [`phipsi_motion::Midpoint`]. A chain on all momenta together keeps the
//! direction and the proportions of linear and angular momentum, which the forces keep too: what it samples is then not
//! canonical. Here the common linear momentum is removed, which no configuration depends on, and rigid motion has a chain of its
//! own, so that the angular momentum takes all sizes. The two parts are orthogonal in M⁻¹, so that each chain sees its own energy
//! alone; closures of flexible rings, which rigid motions do not open, hold for either part, so that scaling keeps them.
//!
//! Conserved: K + U + Σ over chains of ½ Σ Q_j r_j² + n kT η_1 + kT Σ_{j>1} η_j.

use crate::deviates::Deviates;
use crate::langevin::dot;
use nalgebra::{Matrix6, Vector6};
use phipsi_motion::Midpoint;
use phipsi_motion::midpoint_momentum::MomentumSweep;
use phipsi_recursion::hinge::Hinge;
use phipsi_recursion::layout::GROUND;
use phipsi_recursion::{DynamicsError, Layout};
use phipsi_spatial::RigidInertia;

/// Thermostats of a chain.
pub const CHAIN: usize = 3;

/// Positions and rates of a chain.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ChainState {
    /// Positions η.
    pub position: [f64; CHAIN],
    /// Rates r, 1/time.
    pub rate: [f64; CHAIN],
}

/// The chains of rigid and of internal motion.
#[derive(Clone, Debug)]
pub(crate) struct Chains {
    /// Degrees of freedom of the groups.
    freedom: [f64; 2],
    /// Roots that belong to the first group: all, or none.
    bases: Vec<usize>,
    kt: f64,
    tau: f64,
    composites: Vec<RigidInertia<f64>>,
    momentum: MomentumSweep<f64>,
    p: Vec<f64>,
    v: Vec<f64>,
    /// p^r, its velocities, and what the sweep gives besides.
    rigid: [Vec<f64>; 2],
    unused: Vec<f64>,
}

impl Chains {
    /// `removed`: degrees of freedom of the bases that do not move; `closed`: independent rows of closures.
    pub(crate) fn new(method: &Midpoint, kt: f64, tau: f64, removed: usize, closed: usize) -> Self {
        let layout = method.layout();
        let nv = layout.nv();
        // The hinges of a fixed base are hinges like all others.
        let bases = match crate::center_of_mass::is_translation_free(layout) {
            true => (0..layout.len()).filter(|&k| layout.bodies()[k].parent == GROUND).collect(),
            false => Vec::new(),
        };
        let of_bases: usize = bases.iter().map(|&k: &usize| layout.bodies()[k].hinge.nv()).sum();
        let still = method.model().still_axes().count();
        Chains {
            freedom: [
                of_bases.saturating_sub(removed + still) as f64,
                nv.saturating_sub(of_bases + closed) as f64,
            ],
            bases,
            kt,
            tau,
            composites: vec![RigidInertia::zero(); layout.len()],
            momentum: MomentumSweep::new(layout),
            p: vec![0.0; nv],
            v: vec![0.0; nv],
            rigid: [vec![0.0; nv], vec![0.0; nv]],
            unused: vec![0.0; nv],
        }
    }
    /// Rates of the canonical distribution, positions zero.
    pub(crate) fn draw(&self, deviates: &mut Deviates) -> [ChainState; 2] {
        self.freedom.map(|freedom| {
            let mut chain = ChainState::default();
            deviates.fill_normal(&mut chain.rate);
            if freedom > 0.0 {
                let masses = self.masses(freedom);
                chain.rate.iter_mut().zip(masses).for_each(|(r, m)| *r *= (self.kt / m).sqrt());
            } else {
                chain.rate = [0.0; CHAIN];
            }
            chain
        })
    }
    fn masses(&self, freedom: f64) -> [f64; CHAIN] {
        let one = self.kt * self.tau * self.tau;
        std::array::from_fn(|j| if j == 0 { freedom * one } else { one })
    }
    /// Energy of the chains.
    pub(crate) fn energy(&self, chains: &[ChainState; 2]) -> f64 {
        let own = |(&freedom, chain): (&f64, &ChainState)| -> f64 {
            if freedom == 0.0 {
                return 0.0;
            }
            let kinetic: f64 =
                self.masses(freedom).iter().zip(&chain.rate).map(|(m, r)| 0.5 * m * r * r).sum();
            let potential = freedom * chain.position[0] + chain.position[1..].iter().sum::<f64>();
            kinetic + self.kt * potential
        };
        self.freedom.iter().zip(chains).map(own).sum()
    }
    /// The chains act for a time h on the momenta at the method's configuration. Cost: a solution with M, a momentum sweep.
    pub(crate) fn run(
        &mut self,
        method: &mut Midpoint,
        chains: &mut [ChainState; 2],
        h: f64,
    ) -> Result<(), DynamicsError> {
        self.v.copy_from_slice(method.velocity()?);
        self.p.copy_from_slice(&method.state().p);
        self.find_rigid(method.layout(), &method.state().q);
        let [p_rigid, v_rigid] = &self.rigid;
        let rigid = dot(p_rigid, v_rigid);
        let internal = dot(&self.p, &self.v) - rigid;
        let mut s = [1.0, 1.0];
        for (g, own) in [rigid, internal].into_iter().enumerate() {
            if self.freedom[g] > 0.0 {
                let (masses, mean) = (self.masses(self.freedom[g]), self.freedom[g] * self.kt);
                s[g] = advance(&mut chains[g], &masses, self.kt, h, |s| own * s * s - mean);
            }
        }
        for i in 0..self.p.len() {
            self.p[i] = s[0] * p_rigid[i] + s[1] * (self.p[i] - p_rigid[i]);
            self.v[i] = s[0] * v_rigid[i] + s[1] * (self.v[i] - v_rigid[i]);
        }
        method.set_momenta_and_velocity(&self.p, &self.v)
    }
    /// p^r and its velocities, of the momenta `p`.
    fn find_rigid(&mut self, layout: &Layout<f64>, q: &[f64]) {
        let [p_rigid, v_rigid] = &mut self.rigid;
        v_rigid.fill(0.0);
        p_rigid.fill(0.0);
        if self.bases.is_empty() {
            return;
        }
        for (k, body) in layout.bodies().iter().enumerate() {
            self.composites[k] = body.inertia;
        }
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            if body.parent != GROUND {
                let moved = body.pose(q).rigid_to_parent(&self.composites[k]);
                self.composites[body.parent] = self.composites[body.parent] + moved;
            }
        }
        for &k in &self.bases {
            let body = &layout.bodies()[k];
            let p = &self.p[body.v..body.v + body.hinge.nv()];
            let v = &mut v_rigid[body.v..body.v + body.hinge.nv()];
            if let Hinge::Free = body.hinge {
                let rows = self.composites[k].to_articulated().to_rows();
                let inertia = Matrix6::from_fn(|i, j| rows[i][j]);
                // Positive definite: the mass matrix has been factored.
                if let Some(factors) = inertia.cholesky() {
                    v.copy_from_slice(factors.solve(&Vector6::from_column_slice(p)).as_slice());
                }
            } else {
                v.iter_mut().zip(p).for_each(|(v, p)| *v = p / self.composites[k].mass);
            }
        }
        self.momentum.run(layout, q, v_rigid, p_rigid, &mut self.unused);
    }
}

/// A closure that a rigid motion of one tree opens.
pub(crate) fn outer_closure(method: &Midpoint) -> Option<String> {
    let (model, layout) = (method.model(), method.layout());
    let root = |name: &str| {
        let mut k = layout.carriers()[model.find_body(name).ok().flatten()?].body;
        while k != GROUND && layout.bodies()[k].parent != GROUND {
            k = layout.bodies()[k].parent;
        }
        (k != GROUND).then_some(k)
    };
    let outer = model.closures().iter().find(|c| {
        let ends = [root(&c.body_a), root(&c.body_b)];
        crate::center_of_mass::is_translation_free(layout) && (ends[0].is_none() || ends[0] != ends[1])
    });
    outer.map(|c| c.name.clone())
}

/// One chain for a time h, symmetric in time: rates inward, scaling, rates outward. Returns the scale of the momenta.
fn advance(
    chain: &mut ChainState,
    masses: &[f64; CHAIN],
    kt: f64,
    h: f64,
    virial: impl Fn(f64) -> f64,
) -> f64 {
    let t = 0.5 * h;
    let rate = &mut chain.rate;
    let push = |rate: &mut [f64; CHAIN], j: usize, s: f64| {
        let force = match j {
            0 => virial(s),
            _ => masses[j - 1] * rate[j - 1] * rate[j - 1] - kt,
        };
        let damping = if j + 1 < CHAIN { (-0.5 * t * rate[j + 1]).exp() } else { 1.0 };
        rate[j] = (rate[j] * damping + t * force / masses[j]) * damping;
    };
    (0..CHAIN).rev().for_each(|j| push(rate, j, 1.0));
    let s = (-h * rate[0]).exp();
    chain.position.iter_mut().zip(rate.iter()).for_each(|(x, r)| *x += h * r);
    (0..CHAIN).for_each(|j| push(rate, j, s));
    s
}
