//! The torsion model against brute-force references: clusters, mass matrix, ln det M, generalised forces, bias,
//! accelerations; `PHIPSI_MOLECULES` names a folder with more of them.

use crate::common::{MOLECULES, find, folders, index, indices, json, list, number, numbers, vectors, word};
use phipsi_model::{JointKind, Random};
use phipsi_molecule::{
    Angles, Atoms, BondKind, Clustering, Clusters, Hinges, MoleculeErrors, Rings, TorsionModel,
};
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::{ArticulatedSweep, Kinematics, bias_forces, forward_dynamics, mass_matrix};
use phipsi_spatial::Vec3;
use serde_json::Value;
use std::collections::BTreeSet;

type V = Vec3<f64>;

/// Relative agreement with the references. They are dense sums in double precision over at most 304 atoms, solved at
/// condition numbers up to 1e5: their own rounding is ε·1e5 and the same again for ours.
const BAR: f64 = 1e-9;

/// Every torsion model of the folders: (name, torsion_model.json, ref.json).
fn references() -> Vec<(String, Value, Value)> {
    let mut all = Vec::new();
    for folder in folders() {
        let mut names: Vec<String> = std::fs::read_dir(&folder)
            .unwrap_or_else(|e| panic!("{}: {e}", folder.display()))
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        for name in names {
            if let Some(path) = find(&folder, &name, "torsion_model.json") {
                let reference = find(&folder, &name, "ref.json").unwrap();
                all.push((name, json(&path), json(&reference)));
            }
        }
    }
    let names: BTreeSet<&str> = all.iter().map(|(name, ..)| name.as_str()).collect();
    assert!(MOLECULES.iter().all(|name| names.contains(name)), "{names:?}");
    all
}

fn clustering(model: &str) -> Clustering {
    let rigid = match model {
        "all" => vec![],
        "no_omega_planar_methyl" => vec![BondKind::Omega, BondKind::Planar, BondKind::Methyl],
        other => panic!("model {other}"),
    };
    Clustering { rigid, ..Clustering::default() }
}

/// The reference's word for a kind.
fn reference_word(kind: BondKind) -> &'static str {
    kind.word().trim_start_matches("backbone_")
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs()))
}

/// Largest difference over the largest number.
fn distance(got: &[f64], want: &[f64]) -> f64 {
    assert_eq!(got.len(), want.len());
    let error = got.iter().zip(want).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    error / largest(want)
}

fn flat(x: &[V]) -> Vec<f64> {
    x.iter().flat_map(|x| x.0).collect()
}

#[test]
fn hinges_and_their_kinds_are_those_of_the_references() {
    let mut molecules = 0;
    for folder in folders() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let name = entry.unwrap().file_name().to_string_lossy().into_owned();
            let Some(path) = find(&folder, &name, "ref.json") else { continue };
            let reference = json(&path);
            if reference.get("rotatable_bonds_i_j_kind").is_none() {
                continue;
            }
            let count = list(&reference["atoms"]["name"]).len();
            let atoms = crate::common::atoms(&reference, vec![1.0; count]);
            let positions = vectors(&reference["conformations"][0]["positions"]);
            let clusters = Clusters::new(&atoms, &positions, &Clustering::default()).unwrap();
            let sorted = |i: usize, j: usize| (i.min(j), i.max(j));
            let got: BTreeSet<_> = clusters
                .hinges
                .iter()
                .map(|h| (sorted(h.atoms[0], h.atoms[1]), reference_word(h.kind)))
                .collect();
            let want: BTreeSet<_> = list(&reference["rotatable_bonds_i_j_kind"])
                .iter()
                .map(|b| (sorted(index(&b[0]), index(&b[1])), word(&b[2])))
                .collect();
            assert_eq!(got, want, "{name}");
            assert!(clusters.locked.is_empty(), "{name}: {:?}", clusters.locked);
            molecules += 1;
        }
    }
    println!("{molecules} molecules");
    assert!(molecules >= 8, "{molecules}");
}

/// The degrees of freedom of a model with the reference's roots, in the reference's order.
fn their_order(torsion: &TorsionModel, bases: &[usize], hinges: &[Value]) -> Vec<usize> {
    let model = torsion.model();
    let mut order = Vec::new();
    for &atom in bases {
        let body = torsion.body_of_cluster(torsion.clusters().cluster_of[atom]);
        order.extend(model.v_range(body));
    }
    for hinge in hinges {
        let mut pair = [index(&hinge[2]), index(&hinge[3])];
        pair.sort_unstable();
        let own = torsion.clusters().hinges.iter().position(|h| {
            let mut atoms = h.atoms;
            atoms.sort_unstable();
            atoms == pair
        });
        order.push(torsion.hinge_dof(own.expect("the reference's hinge")));
    }
    order
}

/// ω × v of every base in its place, zero elsewhere: what the turning of the base's axes adds to the rates of v.
fn turning(bases: usize, u: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; u.len()];
    for b in 0..bases {
        let at = |i: usize| Vec3([u[6 * b + i], u[6 * b + i + 1], u[6 * b + i + 2]]);
        out[6 * b + 3..6 * b + 6].copy_from_slice(&at(0).cross(at(3)).0);
    }
    out
}

/// Accelerations of all atoms, world axes, with generalised accelerations `a`.
fn atom_accelerations(torsion: &TorsionModel, q: &[f64], v: &[f64], a: &[f64]) -> Vec<V> {
    let layout = torsion.layout();
    let mut kinematics = Kinematics::new(layout);
    kinematics.set_position(layout, q).unwrap();
    kinematics.set_velocity(layout, v).unwrap();
    kinematics.set_acceleration(layout, v, a).unwrap();
    let positions = torsion.positions(q).unwrap();
    let place = |(atom, x): (usize, &V)| {
        let body = Some(torsion.body_of_cluster(torsion.clusters().cluster_of[atom]));
        let r = *x - kinematics.pose(layout, body).translation;
        let (omega, alpha) =
            (kinematics.velocity(layout, body).angular, kinematics.acceleration(layout, body));
        alpha.linear + alpha.angular.cross(r) + omega.cross(omega.cross(r))
    };
    positions.iter().enumerate().map(place).collect()
}

/// The worst relative differences seen.
#[derive(Default, Debug)]
struct Worst {
    mass_matrix: f64,
    log_determinant: f64,
    forces: f64,
    bias: f64,
    accelerations: f64,
    atoms: f64,
    energy: f64,
}

#[test]
fn models_agree_with_brute_force() {
    for (name, model_reference, reference) in references() {
        let atoms = crate::common::atoms(&reference, numbers(&model_reference["mass"]));
        for (kind, want) in model_reference["models"].as_object().unwrap() {
            let mut worst = Worst::default();
            for state in list(&want["conformations"]) {
                let id = word(&state["id"]);
                compare(&atoms, want, state, &reference, kind, &mut worst);
                for value in [
                    worst.mass_matrix,
                    worst.log_determinant,
                    worst.forces,
                    worst.bias,
                    worst.accelerations,
                    worst.atoms,
                    worst.energy,
                ] {
                    assert!(value < BAR, "{name}, {kind}, {id}: {worst:?}");
                }
            }
            println!("{name}, {kind}: {worst:?}");
        }
    }
}

fn compare(atoms: &Atoms, want: &Value, state: &Value, reference: &Value, kind: &str, worst: &mut Worst) {
    let structure = crate::common::conformation(reference, word(&state["id"]));
    let positions = vectors(&structure["positions"]);
    let clusters = Clusters::new(atoms, &positions, &clustering(kind)).unwrap();
    let their_clusters: BTreeSet<_> = list(&want["clusters"]).iter().map(indices).collect();
    assert_eq!(clusters.clusters.iter().cloned().collect::<BTreeSet<_>>(), their_clusters);
    let bases: Vec<usize> = list(&want["bases_cluster_origin_atom"]).iter().map(|b| index(&b[1])).collect();
    let torsion = TorsionModel::with_roots(atoms, &positions, clusters.clone(), &bases).unwrap();
    assert_eq!(torsion.degrees_of_freedom(), index(&want["n_speeds"]));
    let order = their_order(&torsion, &bases, list(&want["hinges"]));
    let layout = torsion.layout();
    let q = torsion.model().neutral::<f64>();
    let nv = order.len();
    let u = numbers(&state["u"]);
    let mine = |theirs: &[f64]| {
        let mut out = vec![0.0; nv];
        order.iter().zip(theirs).for_each(|(&i, x)| out[i] = *x);
        out
    };
    let v = mine(&u);
    let note = |worst: &mut f64, value: f64| *worst = worst.max(value);

    let m = mass_matrix(layout, &q).unwrap();
    if let Some(rows) = state.get("M") {
        for (i, row) in list(rows).iter().enumerate() {
            for (j, x) in numbers(row).into_iter().enumerate() {
                let scale = (m[order[i] * (nv + 1)] * m[order[j] * (nv + 1)]).sqrt();
                note(&mut worst.mass_matrix, (m[order[i] * nv + order[j]] - x).abs() / scale);
            }
        }
    }
    let lndet = number(&state["lndetM"]);
    let error = (torsion.log_determinant(&q).unwrap() - lndet).abs() / lndet.abs();
    note(&mut worst.log_determinant, error);

    let moved = mine(&turning(bases.len(), &u));
    let product: Vec<f64> = m.chunks(nv).map(|r| r.iter().zip(&moved).map(|(a, b)| a * b).sum()).collect();
    let bias = bias_forces(layout, &q, &v).unwrap();
    let classical: Vec<f64> = bias.iter().zip(&product).map(|(b, p)| b - p).collect();
    note(&mut worst.bias, distance(&classical, &mine(&numbers(&state["bias_JT_m_Jdot_u"]))));

    // The same molecules with roots of our own choice, moving with the same velocities of all atoms.
    let other = TorsionModel::new(atoms, &positions, clusters).unwrap();
    let start = other.model().neutral::<f64>();
    let error = (other.log_determinant(&start).unwrap() - lndet).abs() / lndet.abs();
    note(&mut worst.log_determinant, error);
    let (mut poses, mut other_poses) = (torsion.poses(), other.poses());
    let mut place = positions.clone();
    torsion.positions_into(&q, &mut poses, &mut place).unwrap();
    other.positions_into(&start, &mut other_poses, &mut place).unwrap();
    let mut velocities = positions.clone();
    torsion.velocities_into(&poses, &v, &mut velocities).unwrap();
    let square: f64 = velocities.iter().zip(&atoms.masses).map(|(u, m)| 0.5 * m * u.dot(*u)).sum();
    note(&mut worst.energy, (square - number(&state["ke"])).abs() / square);
    let momenta: Vec<V> = velocities.iter().zip(&atoms.masses).map(|(u, m)| u.scale(*m)).collect();
    let mut other_v = vec![0.0; nv];
    let mut workspace = other.gather_workspace();
    other.gather_into(&other_poses, &momenta, &mut workspace, &mut other_v).unwrap();
    let sweep = ArticulatedSweep::new(other.layout(), &start).unwrap();
    sweep.solve_in_place(other.layout(), &mut other_v, &mut SolveWorkspace::new(other.layout()));

    for environment in ["vacuum", "obc2", "charmm36"] {
        let Some(want) = state.get(environment) else { continue };
        let forces = vectors(&structure[environment]["forces"]);
        let mut tau = vec![0.0; nv];
        torsion.gather_into(&poses, &forces, &mut torsion.gather_workspace(), &mut tau).unwrap();
        // Where hinge forces cancel (a minimum), against the moment of the largest force at the length of a bond.
        let theirs = mine(&numbers(&want["Q"]));
        let scale = largest(&theirs).max(0.1 * largest(&flat(&forces)));
        let away = tau.iter().zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        note(&mut worst.forces, away / scale);
        let mut a = forward_dynamics(layout, &q, &v, &tau, None).unwrap();
        let mine_atoms = atom_accelerations(&torsion, &q, &v, &a);
        a.iter_mut().zip(&moved).for_each(|(a, c)| *a += c);
        note(&mut worst.accelerations, distance(&a, &mine(&numbers(&want["udot"]))));
        let their_atoms = match want.get("atom_acceleration") {
            Some(given) => flat(&vectors(given)),
            None => flat(&mine_atoms),
        };
        note(&mut worst.atoms, distance(&flat(&mine_atoms), &their_atoms));

        other.gather_into(&other_poses, &forces, &mut workspace, &mut tau).unwrap();
        // Without a force on the molecule from outside, hinge forces are the same whichever end is outboard.
        let hinges = if bases.len() == 1 { torsion.clusters().hinges.len() } else { 0 };
        for h in 0..hinges {
            let error = (tau[other.hinge_dof(h)] - theirs[torsion.hinge_dof(h)]).abs() / scale;
            note(&mut worst.forces, error);
        }
        let a = forward_dynamics(other.layout(), &start, &other_v, &tau, None).unwrap();
        let other_atoms = atom_accelerations(&other, &start, &other_v, &a);
        note(&mut worst.atoms, distance(&flat(&other_atoms), &their_atoms));
    }
}

/// A molecule of the tests with its default model.
fn default_model(name: &str) -> (TorsionModel, Value) {
    let (_, model, reference) = references().into_iter().find(|(n, ..)| n == name).unwrap();
    let atoms = crate::common::atoms(&reference, numbers(&model["mass"]));
    let positions = vectors(&reference["conformations"][0]["positions"]);
    let clusters = Clusters::new(&atoms, &positions, &Clustering::default()).unwrap();
    (TorsionModel::new(&atoms, &positions, clusters).unwrap(), reference)
}

/// Rounding of one outward sweep over n clusters of a molecule of size 1 nm.
fn sweep_rounding(torsion: &TorsionModel) -> f64 {
    16.0 * torsion.layout().len() as f64 * f64::EPSILON
}

#[test]
fn coordinates_invert_positions() {
    for name in MOLECULES {
        let (torsion, reference) = default_model(name);
        let allowed = sweep_rounding(&torsion);
        let neutral = torsion.positions(&torsion.model().neutral()).unwrap();
        for (a, b) in neutral.iter().zip(vectors(&reference["conformations"][0]["positions"])) {
            assert!((*a - b).norm() < allowed, "{name}");
        }
        for seed in 0..10 {
            let q = torsion.model().random_state(seed).q;
            let positions = torsion.positions(&q).unwrap();
            let (back, away) = torsion.coordinates(&positions).unwrap();
            assert!(away < 100.0 * allowed, "{name}, seed {seed}: {away:e}");
            let error = largest(&torsion.model().difference(&q, &back));
            // Angles of atoms 0.1 nm from their axes, and superpositions of a few atoms.
            assert!(error < 1000.0 * allowed, "{name}, seed {seed}: {error:e}");
        }
    }
}

/// The reference's conformations `torsion1` and `torsion2` are the first one turned about every rotatable bond.
#[test]
fn turned_conformations_are_reached() {
    for name in MOLECULES {
        let (torsion, reference) = default_model(name);
        for id in ["torsion1", "torsion2"] {
            let positions = vectors(&crate::common::conformation(&reference, id)["positions"]);
            let (q, away) = torsion.coordinates(&positions).unwrap();
            let hinges = torsion.clusters().hinges.len();
            let turned = (0..hinges).filter(|&h| {
                let (joint, _) = torsion.model().joint_of_velocity(torsion.hinge_dof(h));
                q[torsion.model().q_offset(joint)].abs() > 1e-3
            });
            assert!(turned.count() > 0, "{name}, {id}");
            println!("{name}, {id}: {away:.1e} nm");
            // Turned one bond after the other in double precision.
            assert!(away < 1e-12, "{name}, {id}: {away:e} nm");
        }
        let mut broken = torsion.positions(&torsion.model().neutral()).unwrap();
        broken[1].0[0] = f64::NAN;
        assert_eq!(torsion.coordinates(&broken).unwrap().1, f64::INFINITY);
        let strained = vectors(&crate::common::conformation(&reference, "md")["positions"]);
        assert!(torsion.coordinates(&strained).unwrap().1 > 1e-3, "{name}");
    }
}

/// Generalised forces of any potential are minus its gradient along increments; here of a random linear one.
#[test]
fn gathered_forces_are_gradients() {
    let (torsion, _) = default_model("aladi_x2");
    let model = torsion.model();
    let mut random = Random::new(3);
    let forces: Vec<V> = (0..torsion.atoms().len()).map(|_| Vec3(random.vector())).collect();
    let state = model.random_state(5);
    let mut poses = torsion.poses();
    let mut positions = forces.clone();
    torsion.positions_into(&state.q, &mut poses, &mut positions).unwrap();
    let mut tau = vec![0.0; model.nv()];
    torsion.gather_into(&poses, &forces, &mut torsion.gather_workspace(), &mut tau).unwrap();
    let step = 1e-4;
    let work = |x: &[f64]| -> f64 {
        let positions = torsion.positions(&model.integrate(&state.q, x)).unwrap();
        positions.iter().zip(&forces).map(|(x, f)| x.dot(*f)).sum()
    };
    for i in 0..model.nv() {
        let at = |sign: f64| {
            let mut x = vec![0.0; model.nv()];
            x[i] = sign * step;
            work(&x)
        };
        let slope = (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * step);
        // Fourth order: step⁴/30 of the fifth derivative; rounding ε Σ|x f| / step.
        assert!((slope - tau[i]).abs() < 1e-11 * (1.0 + largest(&tau)), "{i}: {slope} {}", tau[i]);
    }
}

#[test]
fn names_are_those_of_residues_or_indices() {
    let (torsion, _) = default_model("aladi");
    let mut names: Vec<&str> = torsion.model().joints().iter().map(|j| j.name.as_str()).collect();
    names.sort_unstable();
    let mut want = vec![
        "ACE1:CH3-C",
        "ACE1:C-ALA2:N",
        "ALA2:N-CA",
        "ALA2:CA-C",
        "ALA2:CA-CB",
        "ALA2:C-NME3:N",
        "NME3:N-C",
    ];
    want.push(torsion.model().bodies()[0].name.as_str());
    want.sort_unstable();
    assert_eq!(names, want);
    let (twice, _) = default_model("aladi_x2");
    assert!(
        twice.model().find_joint("1/ALA2:N-CA").is_ok() || twice.model().find_joint("0/ALA2:N-CA").is_ok()
    );
    let bare = Atoms { names: vec![], ..torsion.atoms().clone() };
    let positions = torsion.positions(&torsion.model().neutral()).unwrap();
    let clusters = Clusters::new(&bare, &positions, &Clustering::default()).unwrap();
    let model = TorsionModel::new(&bare, &positions, clusters).unwrap();
    assert!(model.model().find_joint("6-8").is_ok());
}

/// Atoms along a zigzag or a line, by their elements; bonds between neighbours, hydrogens given as the parents they hang on.
fn small(heavy: &[u8], places: &[[f64; 3]], hydrogens: &[(usize, [f64; 3])]) -> (Atoms, Vec<V>) {
    let mut atoms = Atoms::default();
    let mut positions = Vec::new();
    for (i, (&element, place)) in heavy.iter().zip(places).enumerate() {
        atoms.elements.push(element);
        atoms.masses.push(2.0 * f64::from(element));
        positions.push(Vec3(*place));
        if i > 0 {
            atoms.bonds.push([i - 1, i]);
        }
    }
    for (parent, offset) in hydrogens {
        atoms.bonds.push([*parent, positions.len()]);
        atoms.elements.push(1);
        atoms.masses.push(1.008);
        positions.push(positions[*parent] + Vec3(*offset));
    }
    (atoms, positions)
}

const METHYL: [[f64; 3]; 3] = [[-0.036, 0.103, 0.0], [-0.036, -0.051, 0.089], [-0.036, -0.051, -0.089]];

fn opposite(x: [f64; 3]) -> [f64; 3] {
    x.map(|x| -x)
}

fn whole(atoms: &Atoms, positions: &[V], clustering: &Clustering) -> Result<TorsionModel, MoleculeErrors> {
    TorsionModel::new(atoms, positions, Clusters::new(atoms, positions, clustering)?)
}

/// Tips and bridges on one line are locked, one of two collinear rotors remains, and the mass matrix is regular.
#[test]
fn hinges_that_move_nothing_are_locked() {
    // CH3–C≡N.
    let (atoms, positions) =
        small(&[6, 6, 7], &[[0.0, 0.0, 0.0], [0.146, 0.0, 0.0], [0.262, 0.0, 0.0]], &METHYL.map(|h| (0, h)));
    let nitrile = whole(&atoms, &positions, &Clustering::default()).unwrap();
    assert_eq!((nitrile.degrees_of_freedom(), nitrile.clusters().locked.len()), (6, 1));
    assert!(nitrile.clusters().locked[0].why.contains("line"));
    // CH3–C≡C–CH3: three collinear bonds, one torsion.
    let places = [0.0, 0.146, 0.266, 0.412].map(|x| [x, 0.0, 0.0]);
    let hydrogens: Vec<_> =
        METHYL.map(|h| (0, h)).into_iter().chain(METHYL.map(|h| (3, opposite(h)))).collect();
    let (atoms, positions) = small(&[6; 4], &places, &hydrogens);
    let butyne = whole(&atoms, &positions, &Clustering::default()).unwrap();
    assert_eq!((butyne.degrees_of_freedom(), butyne.clusters().locked.len()), (7, 2));
    for seed in 0..20 {
        assert!(butyne.log_determinant(&butyne.model().random_state(seed).q).unwrap().is_finite());
    }
    // H–O–O–H: no cluster has three atoms, and every torsion moves something.
    let (atoms, positions) = small(
        &[8, 8],
        &[[0.0, 0.0, 0.0], [0.147, 0.0, 0.0]],
        &[(0, [-0.016, 0.095, 0.0]), (1, [0.016, 0.0, 0.095])],
    );
    let peroxide = whole(&atoms, &positions, &Clustering::default()).unwrap();
    assert_eq!((peroxide.degrees_of_freedom(), peroxide.clusters().locked.len()), (7, 0));
    assert!(peroxide.log_determinant(&peroxide.model().neutral()).unwrap().is_finite());
}

#[test]
fn atoms_that_are_free_are_points() {
    let (atoms, positions) = small(&[8, 6, 8], &[[-0.116, 0.0, 0.0], [0.0; 3], [0.116, 0.0, 0.0]], &[]);
    let free = Clustering { free: vec![0, 1, 2], ..Clustering::default() };
    let points = whole(&atoms, &positions, &free).unwrap();
    assert_eq!(points.degrees_of_freedom(), 9);
    assert!(points.model().joints().iter().all(|j| j.kind == JointKind::Translation));
}

/// Waters are one cluster each and ions points; every molecule has its own base.
#[test]
fn several_molecules_have_a_base_each() {
    let folder = &folders()[0];
    let reference = json(&find(folder, "aladi_water_ions", "ref.json").unwrap());
    let count = list(&reference["atoms"]["name"]).len();
    let atoms = crate::common::atoms(&reference, vec![12.0; count]);
    let positions = vectors(&reference["conformations"][0]["positions"]);
    let torsion = whole(&atoms, &positions, &Clustering::default()).unwrap();
    // 6 + 7 torsions, four waters, two ions.
    assert_eq!(torsion.degrees_of_freedom(), 13 + 4 * 6 + 2 * 3);
    let cartesian = Clustering { free: (0..count).collect(), ..Clustering::default() };
    let points = whole(&atoms, &positions, &cartesian).unwrap();
    assert_eq!(points.degrees_of_freedom(), 3 * count);
    let want = atoms.masses.iter().map(|m| 3.0 * m.ln()).sum::<f64>();
    let lndet = points.log_determinant(&points.model().neutral()).unwrap();
    assert!((lndet - want).abs() < 100.0 * f64::EPSILON * want);
}

#[test]
fn users_choose_hinges_clusters_and_groups() {
    let (torsion, _) = default_model("aladi");
    let atoms = torsion.atoms();
    let positions = torsion.positions(&torsion.model().neutral()).unwrap();
    let divide = |clustering: Clustering| Clusters::new(atoms, &positions, &clustering);
    let two = Hinges::Bonds(vec![[8, 6], [8, 10]]);
    let chosen = divide(Clustering { hinges: two.clone(), ..Clustering::default() }).unwrap();
    assert_eq!((chosen.clusters.len(), chosen.torsions()), (3, 2));
    let same = Clustering { hinges: Hinges::Clusters(chosen.clusters.clone()), ..Clustering::default() };
    assert_eq!(divide(same).unwrap(), chosen);
    // A group over three clusters locks the two hinges between, and only these.
    let group = Clustering { groups: vec![vec![0, 9]], ..Clustering::default() };
    let grouped = divide(group).unwrap();
    assert_eq!((grouped.torsions(), grouped.locked.len()), (4, 3));
    let one_kind = Clustering { rigid: vec![BondKind::Methyl], ..Clustering::default() };
    assert_eq!(divide(one_kind).unwrap().torsions(), 4);
    // A hinge to a lone atom is locked and said to be.
    let lone = Clustering { hinges: Hinges::Bonds(vec![[6, 7], [6, 8]]), ..Clustering::default() };
    let lone = divide(lone).unwrap();
    assert_eq!((lone.torsions(), lone.locked[0].atoms), (1, [6, 7]));
    for (clustering, words) in [
        (Clustering { hinges: Hinges::Bonds(vec![[0, 9]]), ..Clustering::default() }, "no bond"),
        (Clustering { free: vec![99], ..Clustering::default() }, "atom 99"),
        (Clustering { hinges: Hinges::Clusters(vec![vec![0, 1]]), ..Clustering::default() }, "in 0 clusters"),
    ] {
        let error = divide(clustering).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn hinges_on_rings_and_bad_tables_are_refused() {
    let (torsion, _) = default_model("ace_pro_nme");
    let positions = torsion.positions(&torsion.model().neutral()).unwrap();
    let atoms = torsion.atoms().clone();
    let ring = atoms.bonds.iter().copied().find(|b| atoms.bond_label(*b) == "PRO2:CB-CG").unwrap();
    let hinges = Hinges::Bonds(vec![ring]);
    let error =
        Clusters::new(&atoms, &positions, &Clustering { hinges, ..Clustering::default() }).unwrap_err();
    assert!(error.to_string().contains("PRO2:CB-CG: it lies on a ring"), "{error}");
    let refused = |change: &dyn Fn(&mut Atoms), words: &str| {
        let mut bad = atoms.clone();
        change(&mut bad);
        let error = Clusters::new(&bad, &positions, &Clustering::default()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused(&|a| a.masses[3] = 0.0, "mass 0");
    refused(&|a| a.masses[3] = f64::NAN, "mass NaN");
    refused(&|a| a.elements.truncate(2), "elements: 2 entries");
    refused(&|a| a.bonds.push([0, 1000]), "between atoms 0 and 1000");
    refused(&|a| a.bonds.push([a.bonds[0][1], a.bonds[0][0]]), "given twice");
    let mut bad = positions.clone();
    bad[4].0[1] = f64::INFINITY;
    let error = Clusters::new(&atoms, &bad, &Clustering::default()).unwrap_err().to_string();
    assert!(error.contains("atom 4"), "{error}");
}

/// Where all other bonds of a flexible ring are rigid the last one holds: it is locked and said to be, with the angles at it. A bond that
/// is asked for alone is refused.
#[test]
fn a_ring_whose_other_bonds_are_rigid_is_rigid() {
    let (rigid, _) = default_model("ace_pro_nme");
    let positions = rigid.positions(&rigid.model().neutral()).unwrap();
    let atoms = rigid.atoms().clone();
    let flexible = Clustering { rings: Rings::Flexible, ..Clustering::default() };
    let atom = |name: &str| (0..atoms.len()).find(|&i| atoms.label(i) == format!("PRO2:{name}")).unwrap();
    let angles = Angles::Listed(vec![["CD", "N", "CA"].map(atom)]);
    let frozen = |clustering: &Clustering| {
        let clustering = Clustering { rigid: vec![BondKind::Chi], ..clustering.clone() };
        Clusters::new(&atoms, &positions, &clustering)
    };
    let found = frozen(&flexible).unwrap();
    let [locked] = &found.locked[..] else { panic!("{:?}", found.locked) };
    assert_eq!(atoms.bond_label(locked.atoms), "PRO2:N-CA");
    assert!(locked.why.contains("other bonds of its ring are rigid"), "{}", locked.why);
    assert_eq!((found.closures.len(), found.bends()), (0, 0));
    assert_eq!(found.clusters, frozen(&Clustering::default()).unwrap().clusters);
    // An angle at it, open where the ring is flexible, is as rigid as the ring.
    let open = Clustering { angles: angles.clone(), ..flexible.clone() };
    assert_eq!(Clusters::new(&atoms, &positions, &open).unwrap().bends(), 1);
    let listed = frozen(&Clustering { angles, ..flexible.clone() }).unwrap();
    assert_eq!((listed.locked.len(), listed.bends(), &listed.clusters), (1, 0, &found.clusters));
    let one = Clustering { hinges: Hinges::Bonds(vec![locked.atoms]), ..flexible };
    let error = Clusters::new(&atoms, &positions, &one).unwrap_err().to_string();
    assert!(
        error.contains("no other bond of its ring turns") && error.contains("add other bonds"),
        "{error}"
    );
}
