//! Sums over pairs against the plain double loops of the same formulas, on generated atoms; and their reproducibility.

use phipsi_formats::system::{
    Cutoff, Force, ForceKind, GbsaObc, GbsaParticle, Nonbonded, NonbondedException, NonbondedParticle,
    Periodic, System,
};
use phipsi_model::Random;
use phipsi_molecule::{ForceField, Potential};
use phipsi_spatial::Vec3;
use phipsi_spatial::lanes::Level;
use std::collections::HashMap;
use std::f64::consts::PI;

type V = Vec3<f64>;

/// 1/(4πε₀) of CODATA 2018, kJ/mol·nm/e².
const COULOMB: f64 = 138.935_457_644_382;

/// Atoms on a grid of 0.15 nm, shaken by a third of it: neighbours as close as bonded atoms, none closer.
fn positions(n: usize, random: &mut Random) -> Vec<V> {
    let side = (1..).find(|side| side * side * side >= n).unwrap();
    let place = |i: usize, random: &mut Random| {
        let cell = [i % side, i / side % side, i / side / side];
        Vec3(cell.map(|c| 0.15 * (c as f64 + 0.33 * random.signed())))
    };
    (0..n).map(|i| place(i, random)).collect()
}

fn nonbonded(n: usize, lennard_jones: bool, random: &mut Random) -> Nonbonded {
    let epsilon = if lennard_jones { 0.4 } else { 0.0 };
    let particles = (0..n).map(|_| NonbondedParticle {
        charge: 0.6 * random.signed(),
        sigma: 0.2 + 0.1 * random.signed(),
        epsilon: epsilon * random.uniform(),
    });
    let mut force = Nonbonded { particles: particles.collect(), ..Nonbonded::default() };
    for i in 0..n {
        for j in i + 1..n {
            // Neighbours, most of them without any energy, and some distant pairs.
            if j - i <= 3 || random.below(40) == 0 {
                let own = if random.below(2) == 0 { 0.0 } else { 0.3 };
                let atoms = if random.below(2) == 0 { [i, j] } else { [j, i] };
                force.exceptions.push(NonbondedException {
                    atoms,
                    charge_product: own,
                    sigma: 0.2,
                    epsilon: own,
                });
            }
        }
    }
    force
}

fn born(n: usize, random: &mut Random) -> GbsaObc {
    let particles = (0..n).map(|_| GbsaParticle {
        charge: 0.6 * random.signed(),
        radius: 0.15 + 0.04 * random.signed(),
        scale: 0.8 + 0.3 * random.signed(),
    });
    GbsaObc {
        cutoff: None,
        solvent_dielectric: 78.5,
        solute_dielectric: 1.0,
        surface_area_energy: 2.25936,
        particles: particles.collect(),
    }
}

fn field(n: usize, kind: ForceKind) -> ForceField {
    let force = Force { name: "force".into(), class: "force".into(), group: 0, line: None, kind };
    let system = System { masses: vec![1.0; n], forces: vec![force], ..System::default() };
    ForceField::new(&system).unwrap()
}

fn evaluate(field: &mut ForceField, x: &[V]) -> (f64, Vec<V>) {
    let (mut energy, mut forces) = ([0.0], vec![Vec3([0.0; 3]); x.len()]);
    field.evaluate(x, &mut energy, &mut forces).unwrap();
    (energy[0], forces)
}

/// Adds a force along the line between two atoms.
fn push(forces: &mut [V], x: &[V], atoms: [usize; 2], by_r: f64) {
    push_along(forces, x[atoms[1]] - x[atoms[0]], atoms, by_r);
}

fn push_along(forces: &mut [V], d: V, [i, j]: [usize; 2], by_r: f64) {
    let force = d.scale(-by_r / d.norm());
    forces[i] -= force;
    forces[j] += force;
}

/// 1 − 10 t³ + 15 t⁴ − 6 t⁵ and its slope.
fn switch(r: f64, cutoff: Cutoff) -> [f64; 2] {
    match cutoff.switching {
        Some(start) if r > start => {
            let width = cutoff.distance - start;
            let t = (r - start) / width;
            let slope = -30.0 * t.powi(2) + 60.0 * t.powi(3) - 30.0 * t.powi(4);
            [1.0 - 10.0 * t.powi(3) + 15.0 * t.powi(4) - 6.0 * t.powi(5), slope / width]
        }
        _ => [1.0, 0.0],
    }
}

/// k r² − c and its slope.
fn reaction_field(r: f64, cutoff: f64, e: f64) -> [f64; 2] {
    let k = (e - 1.0) / (2.0 * e + 1.0) / cutoff.powi(3);
    [k * r * r - 3.0 * e / (2.0 * e + 1.0) / cutoff, 2.0 * k * r]
}

/// The shortest of all images of d.
fn nearest(d: V, periodic: Option<Periodic>) -> V {
    let Some(periodic) = periodic else { return d };
    let [a, b, c] = periodic.box_vectors.map(Vec3);
    let mut images = Vec::new();
    for i in -3..=3 {
        for j in -3..=3 {
            for k in -3..=3 {
                images.push(d + a.scale(f64::from(i)) + b.scale(f64::from(j)) + c.scale(f64::from(k)));
            }
        }
    }
    images.into_iter().min_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap()
}

/// The image of an exception, which may be farther than half a width: by OpenMM's formula.
fn reduced(mut d: V, periodic: Option<Periodic>) -> V {
    for k in [2, 1, 0] {
        if let Some(vector) = periodic.map(|p| p.box_vectors[k]) {
            d -= Vec3(vector).scale((d.0[k] / vector[k]).round());
        }
    }
    d
}

fn plain_nonbonded(force: &Nonbonded, x: &[V]) -> (f64, Vec<V>, f64) {
    let ordered = |[i, j]: [usize; 2]| [i.min(j), i.max(j)];
    let exceptions: HashMap<_, _> = force.exceptions.iter().map(|e| (ordered(e.atoms), e)).collect();
    let (mut energy, mut sizes, mut forces) = (0.0, 0.0, vec![Vec3([0.0; 3]); x.len()]);
    for i in 0..x.len() {
        for j in i + 1..x.len() {
            let (a, b) = (force.particles[i], force.particles[j]);
            let (charges, sigma, epsilon) = match exceptions.get(&[i, j]) {
                Some(e) => (e.charge_product, e.sigma, e.epsilon),
                None => (a.charge * b.charge, 0.5 * (a.sigma + b.sigma), (a.epsilon * b.epsilon).sqrt()),
            };
            let is_exception = exceptions.contains_key(&[i, j]);
            let d = match is_exception {
                true => reduced(x[j] - x[i], force.periodic.filter(|p| p.exceptions)),
                false => nearest(x[j] - x[i], force.periodic),
            };
            let r = d.norm();
            let s6 = (sigma / r).powi(6);
            let lennard_jones =
                [4.0 * epsilon * (s6 * s6 - s6), -4.0 * epsilon * (12.0 * s6 * s6 - 6.0 * s6) / r];
            let cutoff = force.cutoff.filter(|_| !is_exception);
            if cutoff.is_some_and(|c| r >= c.distance) {
                continue;
            }
            // Factor of each energy, and its slope; what the reaction field adds to 1/r, and its slope.
            let ([factor, factor_by_r], [field, field_by_r]) = match cutoff {
                Some(c) => (switch(r, c), reaction_field(r, c.distance, force.reaction_field_dielectric)),
                None => ([1.0, 0.0], [0.0, 0.0]),
            };
            let coulomb = COULOMB * charges * (1.0 / r + field);
            energy += factor * lennard_jones[0] + coulomb;
            sizes += 4.0 * epsilon * (s6 * s6 + s6) + (COULOMB * charges / r).abs();
            let by_r = factor * lennard_jones[1] + factor_by_r * lennard_jones[0];
            let by_r = by_r + COULOMB * charges * (field_by_r - 1.0 / (r * r));
            push_along(&mut forces, d, [i, j], by_r);
        }
    }
    (energy, forces, sizes)
}

/// The bracket of the integral and its slope in r.
fn bracket(r: f64, o: f64, s: f64) -> [f64; 2] {
    let u = r + s;
    if u <= o {
        return [0.0; 2];
    }
    let l = o.max((r - s).abs());
    let log = (l / u).ln();
    let squares = 1.0 / (u * u) - 1.0 / (l * l);
    let inside = if o < s - r { 2.0 * (1.0 / o - 1.0 / l) } else { 0.0 };
    [
        1.0 / l - 1.0 / u + 0.25 * (r - s * s / r) * squares + 0.5 * log / r + inside,
        0.25 * (1.0 + s * s / (r * r)) * squares - 0.5 * log / (r * r),
    ]
}

fn plain_born(force: &GbsaObc, x: &[V]) -> (f64, Vec<V>, f64) {
    let n = x.len();
    let kappa = COULOMB * (1.0 / force.solute_dielectric - 1.0 / force.solvent_dielectric);
    let o = |i: usize| force.particles[i].radius - 0.009;
    let s = |i: usize| force.particles[i].scale * o(i);
    let distance = |i: usize, j: usize| (x[j] - x[i]).norm();
    let cutoff = force.cutoff.unwrap_or(f64::INFINITY);
    let others = |i: usize| (0..n).filter(move |&j| j != i && distance(i, j) < cutoff);
    let (mut born, mut by_integral) = (vec![0.0; n], vec![0.0; n]);
    for i in 0..n {
        let integral: f64 = others(i).map(|j| 0.5 * bracket(distance(i, j), o(i), s(j))[0]).sum();
        let (psi, radius) = (integral * o(i), force.particles[i].radius);
        let tanh = (psi - 0.8 * psi * psi + 4.85 * psi.powi(3)).tanh();
        born[i] = 1.0 / (1.0 / o(i) - tanh / radius);
        let slope = (1.0 - tanh * tanh) * (1.0 - 1.6 * psi + 14.55 * psi * psi) * o(i) / radius;
        by_integral[i] = born[i] * born[i] * slope;
    }
    let (mut energy, mut sizes, mut forces) = (0.0, 0.0, vec![Vec3([0.0; 3]); n]);
    let mut by_born = vec![0.0; n];
    for i in 0..n {
        let (q, radius) = (force.particles[i].charge, force.particles[i].radius);
        let surface =
            4.0 * PI * force.surface_area_energy * (radius + 0.14).powi(2) * (radius / born[i]).powi(6);
        energy += surface - 0.5 * kappa * q * q / born[i];
        sizes += surface + 0.5 * kappa * q * q / born[i];
        by_born[i] += (0.5 * kappa * q * q / born[i] - 6.0 * surface) / born[i];
        for j in others(i) {
            let (r, product) = (distance(i, j), born[i] * born[j]);
            let e = (-r * r / (4.0 * product)).exp();
            let f = (r * r + product * e).sqrt();
            let pair = -kappa * q * force.particles[j].charge / f;
            energy += 0.5 * (pair + kappa * q * force.particles[j].charge / cutoff);
            sizes += 0.5 * pair.abs();
            by_born[i] += -0.5 * pair / (f * f) * e * (born[j] + r * r / (4.0 * born[i]));
            if i < j {
                push(&mut forces, x, [i, j], -pair * r * (1.0 - 0.25 * e) / (f * f));
            }
        }
    }
    for i in 0..n {
        for j in others(i) {
            let slope = 0.5 * bracket(distance(i, j), o(i), s(j))[1];
            push(&mut forces, x, [i, j], by_born[i] * by_integral[i] * slope);
        }
    }
    (energy, forces, sizes)
}

fn largest(forces: &[V]) -> f64 {
    forces.iter().flat_map(|f| f.0).fold(0.0, |most, x| most.max(x.abs()))
}

/// Energy and forces against those of the plain loops.
fn compare(place: &str, found: &(f64, Vec<V>), want: &(f64, Vec<V>, f64)) {
    // √n² terms of about 50 roundings, and r⁻¹³ of a distance with three.
    let bar = 1e-13 + 100.0 * f64::EPSILON * (found.1.len() as f64).sqrt();
    let energy = (found.0 - want.0).abs() / want.2.max(f64::MIN_POSITIVE);
    assert!(energy <= bar, "{place}: energy {} for {}, {energy:e}", found.0, want.0);
    let difference: Vec<V> = found.1.iter().zip(&want.1).map(|(a, b)| *a - *b).collect();
    let force = largest(&difference) / largest(&want.1).max(f64::MIN_POSITIVE);
    assert!(force <= bar, "{place}: forces {force:e}");
}

/// Sizes about the ends of tiles, and one with several chunks.
const SIZES: [usize; 12] = [1, 2, 3, 4, 5, 8, 9, 12, 15, 17, 100, 413];

/// No cutoff, one that leaves many pairs, with switching and without, and one that leaves none.
const CUTOFFS: [Option<Cutoff>; 4] = [
    None,
    Some(Cutoff { distance: 0.5, switching: None }),
    Some(Cutoff { distance: 0.45, switching: Some(0.2) }),
    Some(Cutoff { distance: 0.02, switching: None }),
];

#[test]
fn nonbonded_pairs_are_those_of_the_double_loop() {
    for n in SIZES {
        for lennard_jones in [true, false] {
            for cutoff in CUTOFFS {
                let mut random = Random::new(n as u64);
                let (force, x) = (nonbonded(n, lennard_jones, &mut random), positions(n, &mut random));
                let force = Nonbonded { cutoff, reaction_field_dielectric: 5.0, ..force };
                let found = evaluate(&mut field(n, ForceKind::Nonbonded(force.clone())), &x);
                compare(&format!("{n} atoms, {cutoff:?}"), &found, &plain_nonbonded(&force, &x));
            }
        }
    }
}

/// Right and strongly oblique boxes whose least width is barely two cutoffs, with atoms that have left them.
#[test]
fn pairs_in_a_box_are_those_of_all_images() {
    for n in [7, 100, 413] {
        let side = (1..).find(|side| side * side * side >= n).unwrap();
        let a = 0.15 * f64::from(side as u32);
        for [p, q, r] in [[0.0; 3], [0.5, 0.5, 0.5], [-0.5, 0.5, -0.5], [0.3, -0.5, 0.1]] {
            for (exceptions, switching) in [(false, None), (true, Some(0.3 * a))] {
                let box_vectors = [[a, 0.0, 0.0], [p * a, 1.1 * a, 0.0], [q * a, r * a, 1.3 * a]];
                let mut random = Random::new(n as u64);
                let force = nonbonded(n, true, &mut random);
                let place = |i: usize, random: &mut Random| {
                    let cell = [i % side, i / side % side, i / side / side];
                    let turns = [(); 3].map(|()| random.below(3) as f64 - 1.0);
                    // Exceptions that see no images are within one box.
                    let turns = if exceptions { turns } else { [0.0; 3] };
                    let s =
                        [0, 1, 2].map(|k| (cell[k] as f64 + 0.33 * random.signed()) / side as f64 + turns[k]);
                    (0..3).fold(Vec3([0.0; 3]), |sum, k| sum + Vec3(box_vectors[k]).scale(s[k]))
                };
                let x: Vec<V> = (0..n).map(|i| place(i, &mut random)).collect();
                let force = Nonbonded {
                    cutoff: Some(Cutoff { distance: 0.499 * a, switching }),
                    periodic: Some(Periodic { box_vectors, exceptions, dispersion_correction: false }),
                    reaction_field_dielectric: 5.0,
                    ..force
                };
                let found = evaluate(&mut field(n, ForceKind::Nonbonded(force.clone())), &x);
                compare(&format!("{n} atoms in {box_vectors:?}"), &found, &plain_nonbonded(&force, &x));
            }
        }
    }
}

#[test]
fn born_energies_are_those_of_the_double_loop() {
    for n in SIZES {
        for cutoff in CUTOFFS {
            let mut random = Random::new(n as u64);
            let (force, mut x) = (born(n, &mut random), positions(n, &mut random));
            let force = GbsaObc { cutoff: cutoff.map(|c| c.distance), ..force };
            // Also denser than any molecule, with atoms inside each other.
            for scale in [1.0, 0.3] {
                x.iter_mut().for_each(|x| *x = x.scale(scale));
                let found = evaluate(&mut field(n, ForceKind::GbsaObc(force.clone())), &x);
                compare(
                    &format!("{n} atoms, {cutoff:?}, scaled by {scale}"),
                    &found,
                    &plain_born(&force, &x),
                );
            }
        }
    }
}

/// Bits of an energy and of forces.
fn bits((energy, forces): &(f64, Vec<V>)) -> Vec<u64> {
    [*energy].iter().chain(forces.iter().flat_map(|f| &f.0)).map(|x| x.to_bits()).collect()
}

/// Every kind of sum over n atoms, without cutoff and with.
fn kinds(n: usize, random: &mut Random) -> Vec<ForceKind> {
    let (pairs, born) = (nonbonded(n, true, random), born(n, random));
    let each = |cutoff: Option<Cutoff>| {
        let pairs = Nonbonded { cutoff, reaction_field_dielectric: 5.0, ..pairs.clone() };
        let born = GbsaObc { cutoff: cutoff.map(|c| c.distance), ..born.clone() };
        [ForceKind::Nonbonded(pairs), ForceKind::GbsaObc(born)]
    };
    let box_vectors = [[1.2, 0.0, 0.0], [0.6, 1.2, 0.0], [-0.6, 0.5, 1.2]];
    let periodic = Nonbonded {
        cutoff: CUTOFFS[2],
        periodic: Some(Periodic { box_vectors, exceptions: false, dispersion_correction: true }),
        ..pairs.clone()
    };
    CUTOFFS.into_iter().flat_map(each).chain([ForceKind::Nonbonded(periodic)]).collect()
}

/// A list of neighbours made elsewhere leaves no trace either.
#[test]
fn every_level_and_repetition_has_the_same_bits() {
    for n in [7, 100, 413] {
        let mut random = Random::new(n as u64);
        let (kinds, x) = (kinds(n, &mut random), positions(n, &mut random));
        for kind in kinds {
            let first = bits(&evaluate(&mut field(n, kind.clone()), &x));
            for level in Level::ALL {
                let mut field = field(n, kind.clone()).at_level(level);
                for scale in [1.1, 1.002] {
                    let elsewhere: Vec<V> = x.iter().map(|x| x.scale(scale)).collect();
                    assert_eq!(bits(&evaluate(&mut field, &x)), first, "{n} atoms, {}", level.name());
                    evaluate(&mut field, &elsewhere);
                }
                assert_eq!(bits(&evaluate(&mut field, &x)), first, "{n} atoms, {}", level.name());
            }
        }
    }
}

#[cfg(feature = "parallel")]
#[test]
fn every_number_of_threads_has_the_same_bits() {
    let n = 413;
    let mut random = Random::new(1);
    let (kinds, x) = (kinds(n, &mut random), positions(n, &mut random));
    for kind in kinds {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bits(&evaluate(&mut field(n, kind.clone()), &x)))
        };
        let one = on(1);
        assert!([2, 3, 7].into_iter().all(|threads| on(threads) == one));
    }
}
