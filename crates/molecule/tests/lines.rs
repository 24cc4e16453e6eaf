//! Linear molecules: five degrees of freedom, against closed forms of the free linear rotor and of a dipole in a field.

use phipsi_model::{Body, Inertia, Joint, JointKind, Model, ModelBuilder};
use phipsi_molecule::deviates::Deviates;
use phipsi_molecule::{
    Atoms, BOLTZMANN, Bath, Clustering, Clusters, Ensemble, FixmanPotential, MolecularForces, Potential,
    PotentialError, TorsionModel, draw_velocities,
};
use phipsi_motion::Midpoint;
use phipsi_recursion::ArticulatedSweep;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_spatial::{Quaternion, Vec3};
use std::sync::Arc;

type V = Vec3<f64>;

const KT: f64 = BOLTZMANN * 300.0;

/// HCN along a direction, its carbon at a point; nm, Da.
fn hydrogen_cyanide(direction: V, carbon: V) -> (Vec<f64>, Vec<V>) {
    let places = [-0.1066, 0.0, 0.1153].map(|x| carbon + direction.scale(x));
    (vec![1.008, 12.011, 14.007], places.into())
}

/// Molecules of HCN, each one rigid body.
fn molecules(places: &[(V, V)]) -> TorsionModel {
    let (mut masses, mut positions, mut bonds) = (Vec::new(), Vec::new(), Vec::new());
    for &(direction, carbon) in places {
        let n = masses.len();
        let (m, x) = hydrogen_cyanide(direction, carbon);
        masses.extend(m);
        positions.extend(x);
        bonds.extend([[n, n + 1], [n + 1, n + 2]]);
    }
    let elements = [1, 6, 7].repeat(places.len());
    let atoms = Atoms { masses, elements, bonds, names: Vec::new() };
    let clusters = Clusters::new(&atoms, &positions, &Clustering::default()).unwrap();
    TorsionModel::new(&atoms, &positions, clusters).unwrap()
}

fn one() -> TorsionModel {
    molecules(&[(unit([1.0, 2.0, -0.7]), Vec3([0.3, -0.2, 0.5]))])
}

fn unit(v: [f64; 3]) -> V {
    Vec3(v).scale(1.0 / Vec3(v).norm())
}

fn free(_: &[f64], forces: &mut [f64]) -> Result<f64, String> {
    forces.fill(0.0);
    Ok(0.0)
}

/// The direction from H to N.
fn direction(positions: &[V]) -> V {
    let along = positions[2] - positions[0];
    along.scale(1.0 / along.norm())
}

fn center(torsion: &TorsionModel, positions: &[V]) -> V {
    let masses = &torsion.atoms().masses;
    let total: f64 = masses.iter().sum();
    positions.iter().zip(masses).fold(Vec3::zero(), |c, (x, m)| c + x.scale(m / total))
}

#[test]
fn a_linear_molecule_has_five_degrees_of_freedom() {
    let torsion = one();
    assert_eq!((torsion.model().nv(), torsion.degrees_of_freedom()), (6, 5));
    let many =
        molecules(&[(unit([1.0, 0.0, 0.0]), Vec3::zero()), (unit([0.0, 1.0, 1.0]), Vec3([1.0, 0.0, 0.0]))]);
    assert_eq!(many.degrees_of_freedom(), 10);
    // Nitrogen, and carbon dioxide whose atoms are off the line by the rounding of a PDB file.
    let atoms = Atoms {
        masses: vec![14.007, 14.007, 15.999, 12.011, 15.999],
        elements: vec![7, 7, 8, 6, 8],
        bonds: vec![[0, 1], [2, 3], [3, 4]],
        names: Vec::new(),
    };
    let positions: Vec<V> = [
        [0.0, 0.0, 0.0],
        [0.0634, 0.0634, 0.0634],
        [1.0, 0.0, 0.0],
        [1.0820, 0.0821, 0.0],
        [1.1640, 0.1640, 0.0001],
    ]
    .map(Vec3)
    .into();
    let clusters = Clusters::new(&atoms, &positions, &Clustering::default()).unwrap();
    let torsion = TorsionModel::new(&atoms, &positions, clusters).unwrap();
    assert_eq!(torsion.degrees_of_freedom(), 10);
    assert!(torsion.straightened() > 1e-5 && torsion.straightened() < 1e-4, "{}", torsion.straightened());
    let placed = torsion.positions(&torsion.model().neutral()).unwrap();
    let (u, w) = (placed[3] - placed[2], placed[4] - placed[2]);
    assert!(u.cross(w).norm() < 16.0 * f64::EPSILON * u.norm() * w.norm());
    // One place for two atoms is no line.
    let atoms = Atoms { bonds: vec![[0, 1]], masses: vec![1.0; 2], elements: vec![1; 2], names: Vec::new() };
    let positions = [Vec3([0.1, 0.2, 0.3]); 2];
    let clusters = Clusters::new(&atoms, &positions, &Clustering::default()).unwrap();
    let error = TorsionModel::new(&atoms, &positions, clusters).unwrap_err().to_string();
    assert!(error.contains("one place"), "{error}");
}

/// n(t) = n cos ωt + (ω̂ × n) sin ωt: a free rotor whose centre rests is a rotation with a constant twist, which the drift makes
/// without an error; a moving centre brings one of second order.
#[test]
fn a_free_rotor_turns_uniformly() {
    let torsion = one();
    let start = torsion.positions(&torsion.model().neutral()).unwrap();
    let (n, c) = (direction(&start), center(&torsion, &start));
    let across = unit([0.3, -1.0, 0.4]).cross(n);
    let omega = across.scale(7.0 / across.norm());
    let errors = |velocity: V, steps: usize| {
        // The body's axes are those of the world at the start; its origin is the first atom.
        let v = velocity + omega.cross(start[0] - c);
        let spin = n.scale(40.0);
        let v = [omega + spin, v + spin.cross(start[0] - c)];
        let v: Vec<f64> = v.iter().flat_map(|x| x.0).collect();
        let mut method =
            Midpoint::new(torsion.model(), &mut free, 0.0, &torsion.model().neutral::<f64>(), &v).unwrap();
        let h = 1.0 / steps as f64;
        for _ in 0..steps {
            method.step(&mut free, h).unwrap();
        }
        let end = torsion.positions(&method.state().q).unwrap();
        let turned = n.scale(7.0f64.cos()) + omega.scale(7.0f64.sin() / 7.0).cross(n);
        let moved = c + velocity;
        ((direction(&end) - turned).norm(), (center(&torsion, &end) - moved).norm())
    };
    let (turned, moved) = errors(Vec3::zero(), 100);
    // A hundred rotations, and as many iterations to rounding.
    assert!(turned < 500.0 * f64::EPSILON && moved < 500.0 * f64::EPSILON, "{turned:e} {moved:e}");
    let velocity = Vec3([0.2, 0.5, -0.1]);
    let [coarse, fine] = [50, 100].map(|steps| errors(velocity, steps));
    for (coarse, fine) in [(coarse.0, fine.0), (coarse.1, fine.1)] {
        let rounding = 500.0 * f64::EPSILON;
        let order = (coarse / fine).log2();
        assert!((order - 2.0).abs() < 0.05 || coarse < rounding, "{coarse:e} {fine:e}");
    }
}

/// The inertia J about the line enters the error of the steps alone: what two of them tell apart falls with h⁴. (A drift whose momentum
/// about the line is zero has a spin of h² m v_∥ (v·ω)/12 J there, and the action is stationary in it.)
#[test]
fn the_motion_does_not_depend_on_the_inertia_about_the_line() {
    let end = |about: f64, steps: usize| {
        let inertia = Inertia::from_principal(3.0, [0.0, 0.0, 0.4], [0.7, 0.7, about]);
        let model = ModelBuilder::new("rotor")
            .gravity([0.0; 3])
            .body(Body::new("rod", inertia).with_still_axis([0.0, 0.0, 1.0]))
            .joint(Joint::new("free", JointKind::Free), "world", "rod")
            .build()
            .unwrap();
        let mut system = field_on(&model);
        let state = model.random_state(5);
        let mut method = Midpoint::new(&model, &mut system, 0.0, &state.q, &state.v).unwrap();
        for _ in 0..steps {
            method.step(&mut system, 4.0 / steps as f64).unwrap();
        }
        assert_eq!(method.state().p[2], 0.0);
        let q = &method.state().q;
        let axis = Quaternion([q[3], q[4], q[5], q[6]]).to_rotation().column(2);
        (Vec3([q[0], q[1], q[2]]), axis)
    };
    for about in [0.01, 0.1, 1.4] {
        let apart = |steps: usize| {
            let (one, other) = (end(0.7, steps), end(about, steps));
            (other.0 - one.0).norm().max((other.1 - one.1).norm())
        };
        let (coarse, fine) = (apart(400), apart(800));
        let order = (coarse / fine).log2();
        assert!((order - 4.0).abs() < 0.2 && coarse < 1e-6, "{about}: {coarse:e} {fine:e}");
    }
}

/// A spring on the tip (0, 0, 1) of the rod and a constant force on its origin.
fn field_on(model: &Model) -> impl FnMut(&[f64], &mut [f64]) -> Result<f64, String> + use<> {
    assert_eq!(model.nv(), 6);
    |q: &[f64], forces: &mut [f64]| {
        let r = Quaternion([q[3], q[4], q[5], q[6]]).to_rotation();
        let (x, tip) = (Vec3([q[0], q[1], q[2]]), Vec3([0.0, 0.0, 1.0]));
        let end = x + r * tip;
        let (pull, constant) = (end.scale(-2.0), Vec3([0.3, 0.0, -0.4]));
        let (own, base) = (r.transpose_mul(pull), r.transpose_mul(constant));
        forces[..3].copy_from_slice(&tip.cross(own).0);
        forces[3..].copy_from_slice(&(own + base).0);
        Ok(end.dot(end) - constant.dot(x))
    }
}

/// r⁻¹² between the atoms of different molecules, and a weak spring that holds the molecules together.
struct Soft {
    names: Vec<String>,
}

impl Potential for Soft {
    fn terms(&self) -> &[String] {
        &self.names
    }
    fn evaluate(&mut self, x: &[V], energies: &mut [f64], forces: &mut [V]) -> Result<(), PotentialError> {
        energies[0] = 0.0;
        forces.fill(Vec3::zero());
        for i in 0..x.len() {
            for j in (0..i).filter(|j| j / 3 != i / 3) {
                let d = x[i] - x[j];
                let square = d.dot(d);
                let repulsion = (0.3f64.powi(2) / square).powi(6);
                energies[0] += repulsion + 2.0 * square;
                let f = d.scale(12.0 * repulsion / square - 4.0);
                forces[i] += f;
                forces[j] += -f;
            }
        }
        Ok(())
    }
}

fn crowd() -> (Arc<TorsionModel>, MolecularForces<Soft>) {
    let places: Vec<(V, V)> = (0..4)
        .map(|i| {
            let x = f64::from(i);
            (unit([1.0, 0.3 * x, 0.5 - 0.2 * x]), Vec3([0.1 * x, 0.4 * x, 0.35 * x * x * 0.3]))
        })
        .collect();
    let torsion = Arc::new(molecules(&places));
    let forces = MolecularForces::new(torsion.clone(), Soft { names: vec!["soft".into()] });
    (torsion, forces)
}

fn thermal(torsion: &TorsionModel, kelvin: f64, seed: u64) -> Vec<f64> {
    let q = torsion.model().neutral::<f64>();
    let mut v = vec![0.0; torsion.model().nv()];
    let factors = ArticulatedSweep::new(torsion.layout(), &q).unwrap();
    let mut workspace = SolveWorkspace::new(torsion.layout());
    draw_velocities(torsion.layout(), &factors, kelvin, &mut Deviates::new(seed), &mut workspace, &mut v);
    torsion.close_velocities(&q, &mut v).unwrap();
    v
}

/// Energy to second order, momentum to rounding, there and back; no molecule turns about its line.
#[test]
fn linear_molecules_keep_their_energy() {
    let (torsion, mut forces) = crowd();
    let q = torsion.model().neutral::<f64>();
    let v = thermal(&torsion, 300.0, 3);
    let noise = |forces: &mut MolecularForces<Soft>, steps: usize| {
        let h = 2.0 / steps as f64;
        let mut method = Midpoint::new(torsion.model(), forces, 0.0, &q, &v).unwrap();
        let start = method.kinetic_energy().unwrap() + method.state().potential;
        let mut most = 0.0f64;
        for _ in 0..steps {
            method.step(forces, h).unwrap();
            let velocity = method.velocity().unwrap().to_vec();
            for axis in torsion.model().still_axes() {
                let spin: f64 = (0..3).map(|i| axis.axis.0[i] * velocity[axis.dof + i]).sum();
                assert!(spin.abs() < 64.0 * f64::EPSILON * 100.0, "{spin:e}");
            }
            most = most.max((method.kinetic_energy().unwrap() + method.state().potential - start).abs());
        }
        most
    };
    let order = (noise(&mut forces, 2000) / noise(&mut forces, 4000)).log2();
    assert!((order - 2.0).abs() < 0.1, "{order}");
    let mut method = Midpoint::new(torsion.model(), &mut forces, 0.0, &q, &v).unwrap();
    for _ in 0..100 {
        method.step(&mut forces, 2e-3).unwrap();
    }
    let p: Vec<f64> = method.state().p.iter().map(|p| -p).collect();
    method.set_momenta(&p).unwrap();
    for _ in 0..100 {
        method.step(&mut forces, 2e-3).unwrap();
    }
    let (here, there) = (torsion.positions(&method.state().q).unwrap(), torsion.positions(&q).unwrap());
    let off = here.iter().zip(&there).map(|(a, b)| (*a - *b).norm()).fold(0.0, f64::max);
    assert!(off < 1e-12, "{off:e}");
}

/// 2⟨K⟩/kT = 5 for drawn velocities and in Langevin dynamics, and each bath counts five.
#[test]
fn velocities_have_five_degrees_of_freedom() {
    let torsion = one();
    let q = torsion.model().neutral::<f64>();
    let (n, mut sum) = (4000, 0.0);
    for seed in 0..n {
        let v = thermal(&torsion, 300.0, seed);
        sum += Midpoint::new(torsion.model(), &mut free, 0.0, &q, &v).unwrap().kinetic_energy().unwrap();
    }
    // 2K/kT is χ² of five degrees of freedom, of variance 10: four standard errors.
    let mean = 2.0 * sum / (n as f64 * KT);
    assert!((mean - 5.0).abs() < 4.0 * (10.0 / n as f64).sqrt(), "{mean}");
    let mut method = Midpoint::new(torsion.model(), &mut free, 0.0, &q, &[0.0; 6]).unwrap();
    assert_eq!(method.degrees_of_freedom().unwrap(), 5);
    let nose_hoover = Ensemble::NoseHoover { relaxation: 0.1 };
    assert_eq!(Bath::new(&mut method, nose_hoover, KT, 1).unwrap().degrees_of_freedom(), 2);
    let mut bath = Bath::new(&mut method, Ensemble::Langevin { friction: 50.0 }, KT, 1).unwrap();
    assert_eq!(bath.degrees_of_freedom(), 5);
    let (mut sum, steps) = (0.0, 20_000);
    let start = method.kinetic_energy().unwrap();
    for _ in 0..steps {
        bath.advance(&mut method, &mut free, 2e-3, 1).unwrap();
        sum += method.kinetic_energy().unwrap();
    }
    // Without forces energy comes from the bath alone; e^(−2γh) = 0.82 leaves a tenth of the samples independent.
    let gained = method.kinetic_energy().unwrap() - start;
    // The centre moves with an error of (hω)² h v/12, 3e-8 nm a step, which turns momentum of 13 Da nm/ps at 10 rad/ps: 4e-6 kJ/mol a
    // step at most. What goes to and fro is 10 % of kT a step.
    assert!((gained - bath.heat()).abs() < 4e-6 * steps as f64, "{gained} {}", bath.heat());
    let mean = 2.0 * sum / (steps as f64 * KT);
    assert!((mean - 5.0).abs() < 4.0 * (10.0 / (0.1 * steps as f64)).sqrt(), "{mean}");
}

/// Directions are uniform on the sphere without a field, and ⟨cos θ⟩ = coth x − 1/x in one, with Fixman's potential, which is
/// constant, and without.
#[test]
fn directions_have_the_measure_of_the_sphere() {
    let torsion = one();
    let local = direction(&torsion.positions(&torsion.model().neutral()).unwrap());
    let mut fixman = FixmanPotential::of(&torsion, KT).unwrap();
    let mut last = None;
    for seed in 0..20 {
        let q = torsion.model().random_state(seed).q;
        let mut forces = [0.0; 6];
        let energy = fixman.evaluate(&q, &mut forces).unwrap();
        assert!(forces.iter().all(|f| f.abs() < 1e-12 * KT));
        assert!((energy - *last.get_or_insert(energy)).abs() < 1e-12 * KT);
    }
    for (x, want) in [(0.0, 0.0), (2.0, 1.0 / 2.0f64.tanh() - 0.5)] {
        let mut field = |q: &[f64], forces: &mut [f64]| {
            let r = Quaternion([q[3], q[4], q[5], q[6]]).to_rotation();
            let along = r.transpose_mul(Vec3([0.0, 0.0, x * KT]));
            forces[..3].copy_from_slice(&local.cross(along).0);
            forces[3..].fill(0.0);
            Ok::<f64, String>(-local.dot(along))
        };
        let q = torsion.model().neutral::<f64>();
        let mut method = Midpoint::new(torsion.model(), &mut field, 0.0, &q, &[0.0; 6]).unwrap();
        let mut bath = Bath::new(&mut method, Ensemble::HybridMonteCarlo { steps: 8 }, KT, 11).unwrap();
        let n = 8000;
        let [mut first, mut second] = [0.0; 2];
        for _ in 0..n {
            bath.advance(&mut method, &mut field, 0.03, 8).unwrap();
            let q = &method.state().q;
            let z = (Quaternion([q[3], q[4], q[5], q[6]]).to_rotation() * local).0[2];
            (first, second) = (first + z / n as f64, second + z * z / n as f64);
        }
        // ⟨cos²θ⟩ = 1 − 2⟨cos θ⟩/x; turns of 1.6 rad a trajectory leave more than a third of the samples independent.
        let square = if x > 0.0 { 1.0 - 2.0 * want / x } else { 1.0 / 3.0 };
        let error = 4.0 * ((square - want * want) / (n as f64 / 3.0)).sqrt();
        assert!((first - want).abs() < error, "{x}: {first} {want} ± {error}");
        assert!((second - square).abs() < error, "{x}: {second} {square}");
        assert!(bath.trials().acceptance().unwrap() > 0.5);
    }
}
