//! Closed rings of one coordinate: what Monte Carlo samples with Fixman's potential and without, against quadrature from the atoms'
//! Cartesian coordinates alone.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | x | positions of the atoms, one after another | 3N |
//! | σ(x), S | what stiff springs hold: distances and a torsion; ∂σ/∂x | 3N − 7 |
//! | R | displacements of x by unit translations and rotations | 3N×6 |
//! | t | unit tangent of the curve of shapes σ = 0, R* t = 0; s its length | 3N |
//!
//! Springs of large constants leave ∫ δ(σ) dx: the surface σ = 0 has the density det(S S*)^(−1/2), and the rigid model that of its
//! volume in the metric of the masses m (the Gaussian integral over momenta of constrained Cartesian dynamics). With the motions of
//! the whole integrated out, the density of s is
//!
//! stiff limit √(det R* R / det S S*), rigid √det [R t]* m [R t].

use crate::common::chains::{KT, rigid_torsion};
use crate::common::statistics::{correlation, p_value};
use nalgebra::{DMatrix, DVector};
use phipsi_molecule::{
    Atoms, Bath, Clustering, Clusters, Ensemble, FixmanPotential, Rings, TorsionModel, WithFixman,
};
use phipsi_motion::Midpoint;
use phipsi_recursion::DynamicsError;
use phipsi_spatial::Vec3;
use std::f64::consts::PI;

type V = Vec3<f64>;

/// What a spring holds.
#[derive(Clone, Debug)]
enum Spring {
    Distance([usize; 2]),
    Torsion([usize; 4]),
}

/// Zero where cis.
fn torsion([i, j, k, l]: [usize; 4], x: &[V]) -> f64 {
    let (a, b, c) = (x[j] - x[i], x[k] - x[j], x[l] - x[k]);
    let (m, n) = (a.cross(b), b.cross(c));
    (m.cross(n).dot(b) / b.norm()).atan2(m.dot(n))
}

impl Spring {
    fn atoms(&self) -> &[usize] {
        match self {
            Spring::Distance(atoms) => atoms,
            Spring::Torsion(atoms) => atoms,
        }
    }
    fn value(&self, x: &[V]) -> f64 {
        match *self {
            Spring::Distance([i, j]) => (x[i] - x[j]).norm(),
            Spring::Torsion(atoms) => torsion(atoms, x),
        }
    }
    /// By central differences.
    fn gradient(&self, x: &mut [V]) -> Vec<f64> {
        const STEP: f64 = 1e-6;
        let mut gradient = vec![0.0; 3 * x.len()];
        for &i in self.atoms() {
            for k in 0..3 {
                let start = x[i].0[k];
                x[i].0[k] = start + STEP;
                let more = self.value(x);
                x[i].0[k] = start - STEP;
                gradient[3 * i + k] = (more - self.value(x)) / (2.0 * STEP);
                x[i].0[k] = start;
            }
        }
        gradient
    }
}

/// Atoms with springs that leave one coordinate.
struct Shape {
    masses: Vec<f64>,
    positions: Vec<V>,
    springs: Vec<Spring>,
}

/// A point of the curve of shapes, and both densities for a unit of its length.
#[derive(Clone)]
struct Node {
    x: Vec<V>,
    distances: Vec<f64>,
    tangent: DVector<f64>,
    stiff: f64,
    rigid: f64,
}

/// Nodes at equal lengths. A closed curve ends with its first node again, after a part of a step.
struct Curve {
    nodes: Vec<Node>,
    /// The length of the last step, in steps, of a closed curve.
    seam: Option<f64>,
}

impl Shape {
    /// The closed curve of shapes, or the piece about the given positions on which `is_inside`.
    fn curve(&self, is_inside: impl Fn(&[V]) -> bool) -> Curve {
        const STEP: f64 = 1e-3;
        let is_round = |nodes: &[Node]| {
            nodes.len() > 10 && apart(&nodes[nodes.len() - 1], &nodes[0]) < apart(&nodes[1], &nodes[0])
        };
        let is_end = |nodes: &[Node]| is_round(nodes) || !is_inside(&nodes[nodes.len() - 1].x);
        let mut nodes = self.walk(STEP, is_end);
        if is_round(&nodes) {
            let seam = (apart(&nodes[nodes.len() - 1], &nodes[0]) / apart(&nodes[1], &nodes[0])).sqrt();
            nodes.push(nodes[0].clone());
            return Curve { nodes, seam: Some(seam) };
        }
        nodes.reverse();
        nodes.extend(self.walk(-STEP, is_end).into_iter().skip(1));
        Curve { nodes, seam: None }
    }

    /// Along the tangent and back to σ = 0, step after step.
    fn walk(&self, step: f64, is_end: impl Fn(&[Node]) -> bool) -> Vec<Node> {
        let mut x = self.positions.clone();
        let held: Vec<f64> = self.springs.iter().map(|s| s.value(&x)).collect();
        let mut before = DVector::from_fn(3 * x.len(), |i, _| (1.0 + i as f64).sin());
        let mut nodes = Vec::new();
        loop {
            let node = self.node(&mut x, &before);
            before = node.tangent.clone();
            nodes.push(node);
            if is_end(&nodes) {
                return nodes;
            }
            assert!(nodes.len() < 20_000, "the curve does not end");
            add(&mut x, &before, step);
            loop {
                let s = self.jacobian(&mut x);
                let off = DVector::from_fn(held.len(), |r, _| self.springs[r].value(&x) - held[r]);
                if off.amax() < 1e-13 {
                    break;
                }
                let by = (&s * s.transpose()).cholesky().expect("springs that are independent").solve(&off);
                add(&mut x, &(s.transpose() * by), -1.0);
            }
        }
    }

    fn jacobian(&self, x: &mut [V]) -> DMatrix<f64> {
        let rows: Vec<f64> = self.springs.iter().flat_map(|s| s.gradient(x)).collect();
        DMatrix::from_row_slice(self.springs.len(), 3 * x.len(), &rows)
    }

    fn node(&self, x: &mut [V], before: &DVector<f64>) -> Node {
        let n = 3 * x.len();
        assert_eq!(self.springs.len(), n - 7);
        let springs = self.jacobian(x);
        let whole = DMatrix::from_fn(n, 6, |row, column| {
            let axis = Vec3([0, 1, 2].map(|k| f64::from(u8::from(k == column % 3))));
            let moved = if column < 3 { axis } else { axis.cross(x[row / 3]) };
            moved.0[row % 3]
        });
        let mut square = DMatrix::zeros(n, n);
        square.rows_mut(0, n - 7).copy_from(&springs);
        square.rows_mut(n - 7, 6).copy_from(&whole.transpose());
        square.row_mut(n - 1).copy_from(&before.transpose());
        let mut right = DVector::zeros(n);
        right[n - 1] = 1.0;
        let tangent = square.lu().solve(&right).expect("one tangent").normalize();
        let mut motions = whole.clone().insert_column(6, 0.0);
        motions.column_mut(6).copy_from(&tangent);
        let momenta = DMatrix::from_fn(n, 7, |row, column| self.masses[row / 3] * motions[(row, column)]);
        let springs = (&springs * springs.transpose()).determinant();
        Node {
            distances: distances(x),
            x: x.to_vec(),
            tangent,
            stiff: ((whole.transpose() * &whole).determinant() / springs).sqrt(),
            rigid: (motions.transpose() * momenta).determinant().sqrt(),
        }
    }
}

fn add(x: &mut [V], by: &DVector<f64>, factor: f64) {
    for (i, x) in x.iter_mut().enumerate() {
        *x += Vec3([by[3 * i], by[3 * i + 1], by[3 * i + 2]]).scale(factor);
    }
}

fn distances(x: &[V]) -> Vec<f64> {
    (0..x.len()).flat_map(|i| (0..i).map(move |j| (x[i] - x[j]).norm())).collect()
}

fn squares(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

fn apart(a: &Node, b: &Node) -> f64 {
    squares(&a.distances, &b.distances)
}

impl Curve {
    /// The length of the step after a node.
    fn step(&self, from: usize) -> f64 {
        if from + 2 == self.nodes.len() { self.seam.unwrap_or(1.0) } else { 1.0 }
    }
    /// Where a shape is: a node and the part of the step from there.
    fn place(&self, x: &[V]) -> (usize, f64) {
        let own = distances(x);
        let far: Vec<f64> = self.nodes.iter().map(|node| squares(&own, &node.distances)).collect();
        let ends = |k: usize| far[k] + far[k + 1];
        let from = (0..far.len() - 1).min_by(|a, b| ends(*a).total_cmp(&ends(*b))).unwrap();
        let chord = apart(&self.nodes[from], &self.nodes[from + 1]);
        let part = 0.5 * (1.0 + (far[from] - far[from + 1]) / chord);
        // From the foot on the chord: what is left is the curvature of a step.
        let off = far[from] - part * part * chord;
        let whole = apart(&self.nodes[0], &self.nodes[1]);
        assert!(off < 1e-3 * whole, "a shape that is {} steps off the curve", (off / whole).sqrt());
        (from, part)
    }
}

/// The share of a distribution before each node, of its densities there.
fn shares(curve: &Curve, of: impl Fn(&Node) -> f64) -> Vec<f64> {
    let mut before = vec![0.0];
    for (k, pair) in curve.nodes.windows(2).enumerate() {
        before.push(before[k] + curve.step(k) * 0.5 * (of(&pair[0]) + of(&pair[1])));
    }
    let all = before[before.len() - 1];
    before.iter().map(|u| u / all).collect()
}

/// p of χ² of places, whose shares are uniform in [0, 1) if the distribution is theirs.
fn uniformity(places: &[(usize, f64)], shares: &[f64]) -> f64 {
    let share = |&(from, part): &(usize, f64)| shares[from] + part * (shares[from + 1] - shares[from]);
    let u: Vec<f64> = places.iter().map(|p| share(p).clamp(0.0, 1.0)).collect();
    p_value(&u, [0.0, 1.0], 16, |_| 1.0)
}

/// The quadrature itself, on four beads with rigid angles: both densities of the torsion are closed forms.
#[test]
fn the_quadrature_has_the_closed_forms_of_an_open_chain() {
    let theta = (-1.0f64 / 3.0).acos();
    let (across, along) = ((theta / 2.0).cos(), (theta / 2.0).sin());
    let mut positions: Vec<V> =
        (0..4).map(|i| Vec3([along * f64::from(i), across * f64::from(i % 2), 0.0])).collect();
    // Out of the plane, about the middle bond.
    let (a, b) = (positions[1], positions[2] - positions[1]);
    let axis = b.scale(1.0 / b.norm());
    let arm = positions[3] - a;
    let foot = axis.scale(axis.dot(arm));
    positions[3] = a + foot + (arm - foot).scale(1.0f64.cos()) + axis.cross(arm).scale(1.0f64.sin());
    let springs = [[0, 1], [1, 2], [2, 3], [0, 2], [1, 3]].map(Spring::Distance).to_vec();
    let shape = Shape { masses: vec![24.0, 5.0, 5.0, 24.0], positions, springs };
    let spring = Spring::Torsion([0, 1, 2, 3]);
    let mut ratios = [Vec::new(), Vec::new()];
    let curve = shape.curve(|_| true);
    assert!(curve.seam.is_some());
    for mut node in curve.nodes {
        let phi = spring.value(&node.x);
        let rate = DVector::from_vec(spring.gradient(&mut node.x)).dot(&node.tangent).abs();
        ratios[0].push(node.stiff / rate);
        ratios[1].push(node.rigid / rate / rigid_torsion(24.0, 5.0, -1.0 / 3.0, phi));
    }
    for ratio in ratios {
        for x in &ratio {
            // Central differences: ε/1e-6 of a distance.
            assert!((x / ratio[0] - 1.0).abs() < 1e-8, "{ratio:?}");
        }
    }
}

/// A ring with two light atoms on each of two neighbours, between which it is cut: they have an inertia about the last bonds.
fn ring(
    size: usize,
    cut: [usize; 2],
    [pucker, noise]: [f64; 2],
    masses: impl Fn(usize) -> f64,
) -> (Atoms, Vec<V>) {
    // The radius at which bonds are about 0.15 nm, puckered.
    let radius = 0.075 / (PI / size as f64).sin();
    let at = |k: usize| {
        let (a, k) = (2.0 * PI * k as f64 / size as f64, k as f64);
        let radius = radius * (1.0 + 3.0 * noise * (1.0 + 3.0 * k).sin());
        Vec3([radius * a.cos(), radius * a.sin(), pucker * (PI * k).cos() + noise * (2.0 + k).sin()])
    };
    let mut positions: Vec<V> = (0..size).map(at).collect();
    let mut bonds: Vec<[usize; 2]> = (0..size).map(|k| [k, (k + 1) % size]).collect();
    for i in cut {
        let outward = positions[i].scale(0.06 / positions[i].norm());
        for side in [-1.0, 1.0] {
            bonds.push([i, positions.len()]);
            positions.push(positions[i] + outward + Vec3([0.0, 0.0, 0.09 * side]));
        }
    }
    let n = positions.len();
    let elements = (0..n).map(|i| if i < size { 6 } else { 1 }).collect();
    (Atoms { masses: (0..n).map(masses).collect(), elements, bonds, names: Vec::new() }, positions)
}

/// Distances of an atom from three others.
fn fastened(atom: usize, to: [usize; 3]) -> [Spring; 3] {
    to.map(|i| Spring::Distance([i, atom]))
}

fn angle([h, i, j]: [usize; 3], x: &[V]) -> f64 {
    let (u, w) = (x[h] - x[i], x[j] - x[i]);
    u.cross(w).norm().atan2(u.dot(w))
}

/// Energy −WALL kT Σ ln sin θ of open angles, which keeps them from the line, where their coordinates end.
const WALL: f64 = 2.0;

/// A ring, the torsion that is held, what springs hold besides distances of neighbours, its open angles, and how it is sampled: h, steps
/// of a trajectory, trajectories to a sample, samples.
struct Case {
    name: &'static str,
    atoms: Atoms,
    positions: Vec<V>,
    held: [usize; 4],
    springs: Vec<Spring>,
    angles: Vec<[usize; 3]>,
    plan: (f64, u64, usize, usize),
}

/// χ² of the place on the curve, by hybrid Monte Carlo.
fn judge(case: Case) {
    let Case { name, atoms, positions, held, mut springs, angles, plan: (h, n, thin, samples) } = case;
    let [_, i, j, _] = held;
    let clustering = Clustering { rings: Rings::Flexible, groups: vec![vec![i, j]], ..Clustering::default() };
    let clusters = Clusters::new(&atoms, &positions, &clustering).unwrap();
    assert_eq!((clusters.closures.len(), clusters.bends()), (1, angles.len()), "{clusters:?}");
    let torsion = TorsionModel::new(&atoms, &positions, clusters).unwrap();
    assert_eq!(torsion.degrees_of_freedom(), 7);
    springs.push(Spring::Torsion(held));
    let sines = |x: &[V]| angles.iter().map(|a| angle(*a, x).sin()).product::<f64>();
    // Some 1e-6 of the samples are beyond.
    let mut curve = Shape { masses: atoms.masses, positions, springs }.curve(|x| sines(x) > 0.02);
    assert_eq!(curve.seam.is_some(), angles.is_empty());
    for node in &mut curve.nodes {
        let wall = sines(&node.x).powf(WALL);
        node.stiff *= wall;
        node.rigid *= wall;
    }
    let (stiff, rigid) = (shares(&curve, |node| node.stiff), shares(&curve, |node| node.rigid));
    let open: Vec<(usize, usize, f64)> = torsion.open_angles().collect();
    let samples = std::env::var("PHIPSI_SAMPLES").map_or(samples, |s| s.parse().expect("a whole number"));
    for fixman in [false, true] {
        let mut wall = |q: &[f64], forces: &mut [f64]| {
            forces.fill(0.0);
            let mut energy = 0.0;
            for &(coordinate, dof, start) in &open {
                let (sin, cos) = (start + q[coordinate]).sin_cos();
                energy -= WALL * KT * sin.abs().ln();
                forces[dof] += WALL * KT * cos / sin;
            }
            Ok::<f64, DynamicsError>(energy)
        };
        let mut potential = FixmanPotential::of(&torsion, KT).unwrap();
        let mut system = WithFixman { inner: &mut wall, fixman: fixman.then_some(&mut potential) };
        let model = torsion.model();
        let start = (model.neutral::<f64>(), vec![0.0; model.nv()]);
        let mut method = Midpoint::new(model, &mut system, 0.0, &start.0, &start.1).unwrap();
        let mut bath = Bath::new(&mut method, Ensemble::HybridMonteCarlo { steps: n }, KT, 1).unwrap();
        let mut places = Vec::with_capacity(samples);
        for i in 0..(samples + 10) * thin {
            bath.advance(&mut method, &mut system, h, n).unwrap();
            if i >= 10 * thin && i % thin == 0 {
                places.push(curve.place(&torsion.positions(&method.state().q).unwrap()));
            }
        }
        let (rigid, stiff) = (uniformity(&places, &rigid), uniformity(&places, &stiff));
        let turn = 2.0 * PI / curve.nodes.len() as f64;
        let waves = [f64::sin, f64::cos].map(|wave| {
            let x: Vec<f64> = places.iter().map(|(from, part)| wave(turn * (*from as f64 + part))).collect();
            correlation(&x, 1)
        });
        let trials = bath.trials();
        println!(
            "{name}, fixman {fixman}: p {rigid:.2e} rigid, {stiff:.2e} stiff limit, {samples} samples; acceptance {:.3}, refused {}, \
             correlation {:.3}, {:.3}",
            trials.acceptance().unwrap(),
            trials.refused,
            waves[0],
            waves[1]
        );
        // Of independent samples: 1/√n.
        assert!(waves.iter().all(|c| c.abs() < 4.0 / (samples as f64).sqrt()), "{name}: {waves:?}");
        let (right, wrong) = if fixman { (stiff, rigid) } else { (rigid, stiff) };
        assert!(right > 1e-3 && wrong < 1e-6, "{name}, fixman {fixman}: {right:e} {wrong:e}");
    }
}

/// Eight atoms, angles rigid, one torsion held: a ring as of disulfides.
#[test]
fn a_ring_of_torsions_has_both_densities() {
    let (atoms, positions) = ring(8, [4, 5], [0.02, 0.03], |i| if i < 8 { 12.0 } else { 3.0 });
    let mut springs: Vec<Spring> =
        (0..8).flat_map(|k| [1, 2].map(|d| Spring::Distance([k, (k + d) % 8]))).collect();
    for (atom, near) in [(8, [4, 3, 5]), (9, [4, 3, 5]), (10, [5, 4, 6]), (11, [5, 4, 6])] {
        springs.extend(fastened(atom, near));
    }
    let plan = (0.04, 10, 7, 800);
    let name = "eight atoms";
    judge(Case { name, atoms, positions, held: [1, 2, 3, 4], springs, angles: Vec::new(), plan });
}

/// Five atoms, one torsion held, three angles open: a ring as of proline. The stiff limit has sin θ of the open angles, as springs of
/// torsions have.
#[test]
fn a_ring_with_open_angles_has_both_densities() {
    let (atoms, positions) = ring(5, [3, 4], [0.05, 0.01], |i| if i < 5 { 12.0 } else { 3.0 });
    let mut springs: Vec<Spring> = (0..5).map(|k| Spring::Distance([k, (k + 1) % 5])).collect();
    springs.extend([[2, 4], [3, 0]].map(Spring::Distance));
    for (atom, near) in [(5, [3, 2, 4]), (6, [3, 2, 4]), (7, [4, 3, 0]), (8, [4, 3, 0])] {
        springs.extend(fastened(atom, near));
    }
    let (angles, plan) = (vec![[4, 0, 1], [0, 1, 2], [1, 2, 3]], (0.04, 10, 4, 1800));
    judge(Case { name: "five atoms", atoms, positions, held: [0, 1, 2, 3], springs, angles, plan });
}
