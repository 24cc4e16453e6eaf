//! Freeze and thaw: identities of the projection, the energy ledger, and the distribution of what is drawn.

use crate::common::molecule;
use phipsi_closure::{ClosedDynamics, Conditions};
use phipsi_molecule::deviates::Deviates;
use phipsi_molecule::{
    Angles, BOLTZMANN, BondKind, Clustering, Clusters, ForceField, MolecularForces, Reclustered, Rings,
    TorsionModel, draw_velocities, recluster, same_motion,
};
use phipsi_motion::{Conservative, Midpoint};
use phipsi_recursion::ArticulatedSweep;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_spatial::Vec3;
use std::sync::Arc;

type V = Vec3<f64>;

const KELVIN: f64 = 300.0;

fn stiff() -> Clustering {
    Clustering { rigid: vec![BondKind::Omega, BondKind::Methyl], ..Clustering::default() }
}

fn flexible() -> Clustering {
    Clustering { rings: Rings::Flexible, ..Clustering::default() }
}

fn model(name: &str, clustering: &Clustering) -> (TorsionModel, ForceField) {
    let m = molecule(name, "vacuum", "min");
    let clusters = Clusters::new(&m.atoms, &m.positions, clustering).unwrap();
    (TorsionModel::new(&m.atoms, &m.positions, clusters).unwrap(), m.field)
}

/// Velocities at a temperature.
fn thermal(torsion: &TorsionModel, q: &[f64], seed: u64) -> Vec<f64> {
    let factors = ArticulatedSweep::new(torsion.layout(), q).unwrap();
    let (mut v, mut workspace) = (vec![0.0; torsion.model().nv()], SolveWorkspace::new(torsion.layout()));
    draw_velocities(torsion.layout(), &factors, KELVIN, &mut Deviates::new(seed), &mut workspace, &mut v);
    torsion.close_velocities(q, &mut v).unwrap();
    v
}

/// A configuration of the tree away from the neutral one; rings stay as they are.
fn turned(torsion: &TorsionModel) -> Vec<f64> {
    let step: Vec<f64> = (0..torsion.model().nv()).map(|i| 0.3 * (1.0 + i as f64).sin()).collect();
    torsion.model().integrate(&torsion.model().neutral::<f64>(), &step)
}

fn atoms_of(torsion: &TorsionModel, q: &[f64], v: &[f64]) -> (Vec<V>, Vec<V>) {
    let n = torsion.atoms().len();
    let (mut poses, mut x, mut u) = (torsion.poses(), vec![Vec3::zero(); n], vec![Vec3::zero(); n]);
    torsion.positions_into(q, &mut poses, &mut x).unwrap();
    torsion.velocities_into(&poses, v, &mut u).unwrap();
    (x, u)
}

/// Σ m a·b.
fn metric(torsion: &TorsionModel, a: &[V], b: &[V]) -> f64 {
    torsion.atoms().masses.iter().zip(a.iter().zip(b)).map(|(m, (a, b))| m * a.dot(*b)).sum()
}

fn momentum(torsion: &TorsionModel, x: &[V], u: &[V]) -> [V; 2] {
    let (mut linear, mut angular) = (Vec3::zero(), Vec3::zero());
    for (m, (x, u)) in torsion.atoms().masses.iter().zip(x.iter().zip(u)) {
        linear += u.scale(*m);
        angular += x.cross(u.scale(*m));
    }
    [linear, angular]
}

fn difference(a: &[V], b: &[V]) -> Vec<V> {
    a.iter().zip(b).map(|(a, b)| *a - *b).collect()
}

fn farthest(a: &[V], b: &[V]) -> f64 {
    difference(a, b).iter().map(|d| d.norm()).fold(0.0, f64::max)
}

/// Sums over all atoms of what the sweeps compute from bases outward: a rounding for each body of a path and each atom.
fn rounding(torsion: &TorsionModel) -> f64 {
    64.0 * torsion.atoms().len() as f64 * f64::EPSILON
}

/// What every change keeps: positions, momenta, and the ledger's balance; and that what is removed is across the new hinges.
fn check(old: &TorsionModel, q: &[f64], v: &[f64], new: &Reclustered) {
    let (x, u) = atoms_of(old, q, v);
    let (y, w) = atoms_of(&new.torsion, &new.q, &new.v);
    let eps = rounding(old);
    assert!(farthest(&x, &y) < eps, "{:e}", farthest(&x, &y));
    let (before, after) = (momentum(old, &x, &u), momentum(old, &y, &w));
    let speed = metric(old, &u, &u).max(metric(old, &w, &w)).sqrt();
    let scale = speed * old.atoms().masses.iter().sum::<f64>().sqrt();
    for (before, after) in before.iter().zip(&after) {
        assert!((*before - *after).norm() < eps * scale, "{before:?} {after:?}");
    }
    let ledger = &new.ledger;
    let balance = ledger.before - ledger.removed + ledger.drawn - ledger.after;
    assert!(balance.abs() < eps * (ledger.before + ledger.after), "{ledger:?}");
    assert!((ledger.before - 0.5 * metric(old, &u, &u)).abs() < eps * ledger.before);
    assert!((ledger.after - 0.5 * metric(old, &w, &w)).abs() < eps * ledger.after);
}

#[test]
fn freezing_is_the_projection_in_the_metric_of_kinetic_energy() {
    for name in ["aladi", "met_enkephalin"] {
        let (torsion, _) = model(name, &Clustering::default());
        let q = turned(&torsion);
        let v = thermal(&torsion, &q, 1);
        let frozen = recluster(&torsion, &q, &v, &stiff(), None).unwrap();
        check(&torsion, &q, &v, &frozen);
        let [before, after] = frozen.ledger.degrees_of_freedom;
        assert!(after < before && frozen.ledger.removed > 0.1 && frozen.ledger.drawn == 0.0);
        let (_, u) = atoms_of(&torsion, &q, &v);
        let (_, w) = atoms_of(&frozen.torsion, &frozen.q, &frozen.v);
        let lost = difference(&u, &w);
        assert!((0.5 * metric(&torsion, &lost, &lost) - frozen.ledger.removed).abs() < 1e-12);
        for i in 0..frozen.v.len() {
            let mut unit = vec![0.0; frozen.v.len()];
            unit[i] = 1.0;
            let (_, e) = atoms_of(&frozen.torsion, &frozen.q, &unit);
            let size = (metric(&torsion, &e, &e) * metric(&torsion, &u, &u)).sqrt();
            assert!(metric(&torsion, &lost, &e).abs() < rounding(&torsion) * size);
        }
        // Frozen again, nothing is lost; thawed, the atoms go on as they were.
        let again = recluster(&frozen.torsion, &frozen.q, &frozen.v, &stiff(), None).unwrap();
        assert!(again.ledger.removed < rounding(&torsion) * again.ledger.before);
        let all = Clustering::default();
        let thawed = recluster(&frozen.torsion, &frozen.q, &frozen.v, &all, None).unwrap();
        check(&frozen.torsion, &frozen.q, &frozen.v, &thawed);
        assert_eq!(thawed.ledger.degrees_of_freedom, [after, before]);
        let (_, z) = atoms_of(&thawed.torsion, &thawed.q, &thawed.v);
        // Light rotors have some hundredths of the inertia of others: the root of M's condition.
        assert!(farthest(&z, &w) < 20.0 * rounding(&torsion) * metric(&torsion, &w, &w).sqrt());
    }
}

/// Velocities that were drawn with the hinges rigid and then for what is thawed are those of the thawed model: 2⟨K⟩/kT counts its
/// degrees of freedom, what is drawn those that are thawed, and momenta stay.
#[test]
fn what_is_thawed_is_drawn_across_what_moved() {
    for (name, rigid, free) in
        [("aladi", stiff(), Clustering::default()), ("ace_pro_nme", Clustering::default(), flexible())]
    {
        let (torsion, _) = model(name, &rigid);
        let q = if name == "aladi" { turned(&torsion) } else { torsion.model().neutral() };
        let (n, mut drawn, mut total) = (600, 0.0, 0.0);
        let mut thawed = 0;
        let mut all = 0;
        for seed in 0..n {
            let v = thermal(&torsion, &q, 2 * seed);
            let mut deviates = Deviates::new(2 * seed + 1);
            let new = recluster(&torsion, &q, &v, &free, Some((KELVIN, &mut deviates))).unwrap();
            check(&torsion, &q, &v, &new);
            assert!(new.ledger.removed < rounding(&torsion) * new.ledger.before);
            drawn += new.ledger.drawn;
            total += new.ledger.after;
            let [before, after] = new.ledger.degrees_of_freedom;
            (thawed, all) = (after - before, after);
        }
        // χ² of so many degrees of freedom: four standard errors.
        for (sum, freedom) in [(drawn, thawed as f64), (total, all as f64)] {
            let mean = 2.0 * sum / (n as f64 * BOLTZMANN * KELVIN);
            assert!(
                (mean - freedom).abs() < 4.0 * (2.0 * freedom / n as f64).sqrt(),
                "{name}: {mean} {freedom}"
            );
        }
    }
}

/// A run that is frozen loses what the ledger says, and keeps its energy before and after.
#[test]
fn a_run_goes_on_with_other_clusters() {
    let (torsion, field) = model("aladi", &Clustering::default());
    let torsion = Arc::new(torsion);
    let q = torsion.model().neutral::<f64>();
    let v = thermal(&torsion, &q, 5);
    let mut forces = MolecularForces::new(torsion.clone(), field.clone());
    let mut method = Midpoint::new(torsion.model(), &mut forces, 0.0, &q, &v).unwrap();
    let energy = |method: &mut Midpoint| method.kinetic_energy().unwrap() + method.state().potential;
    let run = |method: &mut Midpoint, forces: &mut MolecularForces<ForceField>| {
        let mut most = 0.0f64;
        let start = energy(method);
        for _ in 0..100 {
            method.step(forces, 1e-3).unwrap();
            most = most.max((energy(method) - start).abs());
        }
        most
    };
    // Twenty times the noise of steps of 1 fs that the documentation has.
    assert!(run(&mut method, &mut forces) < 0.02);
    let (before, q) = (energy(&mut method), method.state().q.clone());
    let v = method.velocity().unwrap().to_vec();
    let frozen = recluster(&torsion, &q, &v, &stiff(), None).unwrap();
    let ledger = frozen.ledger;
    let torsion = Arc::new(frozen.torsion);
    let mut forces = MolecularForces::new(torsion.clone(), field);
    forces.leave_out_constants(&frozen.q).unwrap();
    let potential = forces.evaluate(&frozen.q, &mut vec![0.0; frozen.v.len()]).unwrap();
    // Terms of some hundred kJ/mol, each of positions that round.
    assert!((potential - method.state().potential).abs() < 1e-9);
    let t = method.state().t;
    let mut method = Midpoint::new(torsion.model(), &mut forces, t, &frozen.q, &frozen.v).unwrap();
    assert!((energy(&mut method) - (before - ledger.removed)).abs() < 1e-9);
    assert!(run(&mut method, &mut forces) < 0.02);
}

/// Bends and torsions of universal hinges from positions: whatever they are, of chains and of rings.
#[test]
fn bends_are_found_from_positions() {
    let angles = Clustering { angles: Angles::AtHinges, ..Clustering::default() };
    let ring = Clustering { angles: Angles::AtHinges, ..flexible() };
    for (name, clustering) in [("aladi", &angles), ("met_enkephalin", &angles), ("ace_pro_nme", &ring)] {
        let (torsion, _) = model(name, clustering);
        assert!(torsion.clusters().bends() > 2);
        let model = torsion.model();
        for seed in 0..10 {
            // Torsions of any size, and angles that stay between 0 and π.
            let x: Vec<f64> = (0..model.nv()).map(|i| (f64::from(seed) + 1.7 * i as f64).sin()).collect();
            let mut q = model.integrate(&model.neutral::<f64>(), &x);
            torsion.open_angles().for_each(|(c, _, start)| q[c] = 0.3 * q[c] * start.min(3.0 - start));
            let (found, off) = torsion.coordinates(&torsion.positions(&q).unwrap()).unwrap();
            // Angles of atoms 0.1 nm from their axes, superposed after as many hinges as a path has.
            let bar = 1000.0 * rounding(&torsion);
            assert!(off < rounding(&torsion), "{name}: {off:e}");
            let away = model.difference(&q, &found).into_iter().fold(0.0f64, |m, x| m.max(x.abs()));
            assert!(away < bar, "{name}, seed {seed}: {away:e}");
        }
    }
}

/// A run on clusters that are frozen in part, rings and open angles included, in the coordinates of all hinges: the same positions,
/// velocities and kinetic energy, with the rings closed.
#[test]
fn the_motion_of_frozen_clusters_is_one_of_the_wider_ones() {
    let everything = Clustering { angles: Angles::AtHinges, ..flexible() };
    let (wide, field) = model("ace_pro_nme", &everything);
    let open = wide.clusters().hinges.iter().filter(|h| !stiff().rigid.contains(&h.kind));
    let angles = Angles::Listed(open.filter_map(|h| h.open_angle()).collect());
    let narrow = Clustering { angles, ..Clustering { rings: Rings::Flexible, ..stiff() } };
    let start = wide.model().neutral::<f64>();
    let frozen = recluster(&wide, &start, &thermal(&wide, &start, 7), &narrow, None).unwrap();
    let [before, after] = frozen.ledger.degrees_of_freedom;
    assert!(after + 6 <= before && frozen.torsion.has_rings(), "{before} {after}");
    let torsion = Arc::new(frozen.torsion);
    let mut forces = MolecularForces::new(torsion.clone(), field);
    let mut method = Midpoint::new(torsion.model(), &mut forces, 0.0, &frozen.q, &frozen.v).unwrap();
    let mut closed = ClosedDynamics::<f64>::new(wide.model()).unwrap();
    let mut near = start;
    for _ in 0..20 {
        for _ in 0..10 {
            method.step(&mut forces, 5e-4).unwrap();
        }
        let (q, v) = (method.state().q.clone(), method.velocity().unwrap().to_vec());
        let (wide_q, wide_v) = same_motion(&torsion, &q, &v, &wide, &near).unwrap();
        let ((x, u), (y, w)) = (atoms_of(&torsion, &q, &v), atoms_of(&wide, &wide_q, &wide_v));
        let speed = metric(&torsion, &u, &u).sqrt();
        assert!(farthest(&x, &y) < rounding(&wide), "{:e}", farthest(&x, &y));
        // A projection solves with the mass matrix of hydrogen rotors and closures: the root of its condition, some 1e3.
        assert!(farthest(&u, &w) < 1e3 * rounding(&wide) * speed, "{:e}", farthest(&u, &w) / speed);
        let rows = closed.rows();
        let (mut position, mut rate) = (vec![0.0; rows], vec![0.0; rows]);
        closed.residual(&wide_q, Some(&wide_v), &Conditions::default(), &mut position, &mut rate).unwrap();
        let open = position.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        assert!(open < 10.0 * rounding(&wide), "{open:e}");
        near = wide_q;
    }
}

#[test]
fn states_of_other_models_are_refused() {
    let (torsion, _) = model("aladi", &Clustering::default());
    let q = torsion.model().neutral::<f64>();
    for (q, v) in [(&q[1..], vec![0.0; torsion.model().nv()]), (&q[..], vec![0.0; 2])] {
        let error = recluster(&torsion, q, &v, &stiff(), None).unwrap_err().to_string();
        assert!(error.contains("state"), "{error}");
    }
}
