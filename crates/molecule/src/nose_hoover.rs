//! Nosé–Hoover chains on the momenta of bases and of hinges.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | η_j, r_j | position and rate of the j-th thermostat of a chain | Martyna, Klein, Tuckerman 1992 |
//! | Q_1, Q_j | n kT τ², kT τ²: n degrees of freedom of the group, relaxation time τ | the same |
//! | A, B, C | p_b·W_bb p_b, p_b·W_bh p_h, p_h·W_hh p_h with W = M⁻¹: K of momenta scaled by s_b, s_h is ½(s_b² A + 2 s_b s_h B + s_h² C) | |
//! | G_1 | p_g·v_g − n_g kT: the group's virial less its mean | |
//!
//! Between two half-steps of the chains is one step of [`phipsi_motion::Midpoint`]. A chain on all momenta together keeps the
//! direction and the proportions of linear and angular momentum, which the forces keep too: what it samples is then not
//! canonical. Here the common linear momentum is removed, which no configuration depends on, and bases have a chain of their
//! own, so that the angular momentum takes all sizes.
//!
//! Conserved: K + U + Σ over chains of ½ Σ Q_j r_j² + n kT η_1 + kT Σ_{j>1} η_j.

use crate::deviates::Deviates;
use crate::langevin::dot;
use phipsi_motion::Midpoint;
use phipsi_recursion::DynamicsError;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::layout::GROUND;

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

/// A group of momenta with its chain.
#[derive(Clone, Debug)]
struct Group {
    /// True where a component of p belongs to it.
    has: Vec<bool>,
    freedom: f64,
}

/// The chains of bases and of hinges.
#[derive(Clone, Debug)]
pub(crate) struct Chains {
    groups: [Group; 2],
    kt: f64,
    tau: f64,
    workspace: SolveWorkspace<f64>,
    p: Vec<f64>,
    v: Vec<f64>,
    /// M⁻¹ of the bases' momenta.
    w: Vec<f64>,
}

impl Chains {
    /// `removed`: degrees of freedom of the bases that do not move.
    pub(crate) fn new(method: &Midpoint, kt: f64, tau: f64, removed: usize) -> Self {
        let layout = method.layout();
        let nv = layout.nv();
        let mut is_base = vec![false; nv];
        // The hinges of a fixed base are hinges like all others.
        if crate::center_of_mass::is_translation_free(layout) {
            for body in layout.bodies().iter().filter(|b| b.parent == GROUND) {
                is_base[body.v..body.v + body.hinge.nv()].fill(true);
            }
        }
        let bases = is_base.iter().filter(|b| **b).count();
        let is_hinge = is_base.iter().map(|b| !b).collect();
        Chains {
            groups: [
                Group { has: is_base, freedom: bases.saturating_sub(removed) as f64 },
                Group { has: is_hinge, freedom: (nv - bases) as f64 },
            ],
            kt,
            tau,
            workspace: SolveWorkspace::new(layout),
            p: vec![0.0; nv],
            v: vec![0.0; nv],
            w: vec![0.0; nv],
        }
    }
    /// Rates of the canonical distribution, positions zero.
    pub(crate) fn draw(&self, deviates: &mut Deviates) -> [ChainState; 2] {
        self.groups.each_ref().map(|group| {
            let mut chain = ChainState::default();
            deviates.fill_normal(&mut chain.rate);
            if group.freedom > 0.0 {
                let masses = self.masses(group);
                chain.rate.iter_mut().zip(masses).for_each(|(r, m)| *r *= (self.kt / m).sqrt());
            } else {
                chain.rate = [0.0; CHAIN];
            }
            chain
        })
    }
    fn masses(&self, group: &Group) -> [f64; CHAIN] {
        let one = self.kt * self.tau * self.tau;
        std::array::from_fn(|j| if j == 0 { group.freedom * one } else { one })
    }
    /// Energy of the chains.
    pub(crate) fn energy(&self, chains: &[ChainState; 2]) -> f64 {
        let own = |(group, chain): (&Group, &ChainState)| -> f64 {
            if group.freedom == 0.0 {
                return 0.0;
            }
            let kinetic: f64 = self.masses(group).iter().zip(&chain.rate).map(|(m, r)| 0.5 * m * r * r).sum();
            let potential = group.freedom * chain.position[0] + chain.position[1..].iter().sum::<f64>();
            kinetic + self.kt * potential
        };
        self.groups.iter().zip(chains).map(own).sum()
    }
    /// The chains act for a time h on the momenta at the method's configuration. Cost: two solutions with M.
    pub(crate) fn run(
        &mut self,
        method: &mut Midpoint,
        chains: &mut [ChainState; 2],
        h: f64,
    ) -> Result<(), DynamicsError> {
        self.v.copy_from_slice(method.velocity()?);
        self.p.copy_from_slice(&method.state().p);
        let bases = &self.groups[0].has;
        for i in 0..self.p.len() {
            self.w[i] = if bases[i] { self.p[i] } else { 0.0 };
        }
        let (layout, factors) = method.layout_and_factors()?;
        factors.solve_in_place(layout, &mut self.w, &mut self.workspace);
        let of = |own: bool, x: &[f64]| -> f64 {
            (0..x.len()).filter(|&i| bases[i] == own).map(|i| self.p[i] * x[i]).sum()
        };
        let (a, b) = (of(true, &self.w), of(false, &self.w));
        let c = dot(&self.p, &self.v) - a - b - b;
        // Virials of the two groups: s_g (own s_g + b s_other).
        let own = [a, c];
        let mut s = [1.0, 1.0];
        for (g, time) in [(0, 0.5 * h), (1, h), (0, 0.5 * h)] {
            if self.groups[g].freedom > 0.0 {
                let other = s[1 - g];
                let masses = self.masses(&self.groups[g]);
                let mean = self.groups[g].freedom * self.kt;
                let virial = |s: f64| s * (own[g] * s + b * other) - mean;
                s[g] = advance(&mut chains[g], &masses, self.kt, time, s[g], virial);
            }
        }
        for i in 0..self.p.len() {
            self.p[i] *= if bases[i] { s[0] } else { s[1] };
            self.v[i] = s[0] * self.w[i] + s[1] * (self.v[i] - self.w[i]);
        }
        method.set_momenta_and_velocity(&self.p, &self.v)
    }
}

/// One chain for a time h, symmetric in time: rates inward, scaling, rates outward. Returns the new scale of the momenta.
fn advance(
    chain: &mut ChainState,
    masses: &[f64; CHAIN],
    kt: f64,
    h: f64,
    s: f64,
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
    (0..CHAIN).rev().for_each(|j| push(rate, j, s));
    let s = s * (-h * rate[0]).exp();
    chain.position.iter_mut().zip(rate.iter()).for_each(|(x, r)| *x += h * r);
    (0..CHAIN).for_each(|j| push(rate, j, s));
    s
}
