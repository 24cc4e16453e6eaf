//! Chains of beads whose distributions are known in closed form.

use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement};
use phipsi_molecule::{
    Atoms, BOLTZMANN, Bath, Clustering, Clusters, Ensemble, FixmanPotential, TorsionModel, Trials, WithFixman,
};
use phipsi_motion::Midpoint;
use phipsi_recursion::{DynamicsError, Layout};
use phipsi_spatial::Vec3;
use std::f64::consts::PI;

/// kT at 300 K, kJ/mol.
pub const KT: f64 = BOLTZMANN * 300.0;

/// Beads with rigid bonds and bond angles θ (π: straight), all torsions trans: q = 0.
pub fn rotating(masses: &[f64], bond: f64, theta: f64) -> TorsionModel {
    let (mut x, mut positions) = (Vec3::zero(), vec![Vec3::zero()]);
    for i in 1..masses.len() {
        let angle = if i % 2 == 0 { PI - theta } else { 0.0 };
        x += Vec3([angle.cos(), angle.sin(), 0.0]).scale(bond);
        positions.push(x);
    }
    let atoms = Atoms {
        masses: masses.to_vec(),
        elements: vec![0; masses.len()],
        bonds: (1..masses.len()).map(|i| [i - 1, i]).collect(),
        names: Vec::new(),
    };
    let clusters = Clusters::new(&atoms, &positions, &Clustering::default()).unwrap();
    assert_eq!(clusters.torsions(), masses.len() - 3);
    TorsionModel::new(&atoms, &positions, clusters).unwrap()
}

/// √(P Q) of four beads with equal bonds, of the masses at the ends and in the middle, t = cos θ, c = cos φ, φ = 0 cis.
pub fn rigid_torsion(end: f64, middle: f64, t: f64, phi: f64) -> f64 {
    let (a, b, c) = (1.0 / end, 1.0 / middle, phi.cos());
    let common = c * c * t * t - c * c;
    let p = a * a + 2.0 * a * b * c * t - 2.0 * a * b * c - 2.0 * a * b * t
        + 3.0 * a * b
        + b * b * (common - t * t + 1.0);
    let q = a * a - 2.0 * a * b * c * t + 2.0 * a * b * c - 2.0 * a * b * t
        + 4.0 * a * b
        + b * b * (common + 2.0 * c * t * t - 2.0 * c * t + t * t - 2.0 * t + 2.0);
    (p * q).sqrt()
}

/// Beads on rods of 0.15 nm, joined by balls.
pub fn jointed(masses: &[f64]) -> Model {
    const BOND: f64 = 0.15;
    // One bead at the outboard end of its rod, with the inertia about the rod that it lacks.
    let own = |mass: f64| Inertia::from_principal(mass, [BOND, 0.0, 0.0], [0.1, 0.0, 0.0]);
    let total = masses[0] + masses[1];
    let across = masses[0] * masses[1] / total * BOND * BOND;
    let pair = Inertia::from_principal(total, [BOND * masses[1] / total, 0.0, 0.0], [0.1, across, across]);
    let mut builder = ModelBuilder::new("chain").gravity([0.0; 3]).body(Body::new("rod1", pair)).joint(
        Joint::new("base", JointKind::Free),
        "world",
        "rod1",
    );
    for (i, mass) in masses.iter().enumerate().skip(2) {
        let place = Placement::from_xyz_rpy([BOND, 0.0, 0.0], [0.0; 3]);
        builder = builder.body(Body::new(format!("rod{i}"), own(*mass))).joint(
            Joint::new(format!("ball{i}"), JointKind::Spherical).at(place),
            format!("rod{}", i - 1),
            format!("rod{i}"),
        );
    }
    builder.build().unwrap()
}

/// Cosines of the bond angles of [`jointed`]: of the axes of two rods, −1 where they are straight.
pub fn cosines(model: &Model, q: &[f64]) -> Vec<f64> {
    let balls = (1..model.len()).map(|k| &q[model.q_range(k)]);
    balls.map(|r| -(1.0 - 2.0 * (r[1] * r[1] + r[2] * r[2]))).collect()
}

/// √det H from the cosines of the angles: D_k = (1/m_k + 1/m_{k+1}) D_{k−1} − cos²θ/m_k² D_{k−2}.
pub fn root_of_constraints(masses: &[f64], cosines: &[f64]) -> f64 {
    let link = |k: usize| 1.0 / masses[k] + 1.0 / masses[k + 1];
    let (mut last, mut now) = (1.0, link(0));
    for (k, c) in (1..).zip(cosines) {
        (last, now) = (now, link(k) * now - c * c / (masses[k] * masses[k]) * last);
    }
    now.sqrt()
}

/// The distribution of the first angle's cosine in [`jointed`] of the rigid model, at 101 values of |cos θ|: √det H
/// integrated over the other angles, by the midpoint rule.
pub fn first_angle(masses: &[f64]) -> impl Fn(f64) -> f64 {
    const NODES: usize = 60;
    let node = |i: usize| -1.0 + (i as f64 + 0.5) * 2.0 / NODES as f64;
    let others = masses.len() - 3;
    let at = |u: f64| -> f64 {
        let mut angles = vec![u; 1 + others];
        let mut sum = 0.0;
        for mut k in 0..NODES.pow(others as u32) {
            for angle in &mut angles[1..] {
                *angle = node(k % NODES);
                k /= NODES;
            }
            sum += root_of_constraints(masses, &angles);
        }
        sum
    };
    let table: Vec<f64> = (0..=100).map(|i| at(f64::from(i) / 100.0)).collect();
    move |u: f64| {
        let x = 100.0 * u.abs().min(1.0);
        let i = (x as usize).min(99);
        table[i] + (x - i as f64) * (table[i + 1] - table[i])
    }
}

/// Values of `measure` at the ends of every `thin`-th trajectory of n steps of size h.
pub fn sample(
    model: &Model,
    fixman: bool,
    (h, n, thin): (f64, u64, usize),
    samples: usize,
    seed: u64,
    mut measure: impl FnMut(&[f64]),
) -> Trials {
    let mut free = |_: &[f64], forces: &mut [f64]| {
        forces.fill(0.0);
        Ok::<f64, DynamicsError>(0.0)
    };
    let layout = Layout::new(model);
    let mut potential = FixmanPotential::new(&layout, KT);
    let fixman = fixman.then_some(&mut potential);
    let mut system = WithFixman { inner: &mut free, fixman };
    // Away from straight angles and from symmetry.
    let q = model.random_state(seed).q;
    let mut method = Midpoint::new(model, &mut system, 0.0, &q, &vec![0.0; model.nv()]).unwrap();
    let ensemble = Ensemble::HybridMonteCarlo { steps: n };
    let mut bath = Bath::new(&mut method, ensemble, KT, seed).unwrap();
    for i in 0..(samples + 20) * thin {
        bath.advance(&mut method, &mut system, h, n).unwrap();
        if i >= 20 * thin && i % thin == thin - 1 {
            measure(&method.state().q);
        }
    }
    *bath.trials()
}
