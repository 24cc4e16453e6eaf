//! Lennard-Jones and Coulomb energies of all pairs, or of those within a cutoff.
//!
//! | symbol | meaning |
//! |---|---|
//! | E | 4 ε [(σ/r)¹² − (σ/r)⁶] + K q q / r |
//! | σ, ε | (σᵢ + σⱼ)/2, √(εᵢ εⱼ) |
//! | K | 1/(4πε₀) in kJ/mol·nm/e² |
//! | slope | −E′/r: the force on the second atom is slope d |
//! | exceptions | pairs with a charge product, σ and ε of their own, in place of these, at any distance |
//! | r_c, r_s | cutoff, and where switching begins; with a cutoff the Coulomb energy is K q q (1/r + k r² − c) |
//! | k, c | (ε_f − 1)/((2 ε_f + 1) r_c³), 3 ε_f/((2 ε_f + 1) r_c), with the dielectric constant ε_f beyond the cutoff |
//! | box | pairs at their nearest images (`image.rs`) |
//! | S | 1 − 10 t³ + 15 t⁴ − 6 t⁵, t = (r − r_s)/(r_c − r_s) ≥ 0: factor of Lennard-Jones energies |

use super::exclusions::Exclusions;
use super::geometry::distance;
use super::image::NearestImage;
use super::left_out::{RigidGroups, TakenOut};
use super::neighbors::Neighbors;
use super::sweep::{At, PairKernel, Places, Sweep, push};
use phipsi_formats::system::{Cutoff, Nonbonded, NonbondedException, NonbondedParticle};
use phipsi_spatial::Vec3;
use phipsi_spatial::lanes::{Fused, Lanes, Level};
use std::f64::consts::PI;

/// Elementary charge, C, and Avogadro's number, 1/mol: exact since 2019. Vacuum permittivity, F/m: CODATA 2018, as OpenMM.
const ELEMENTARY_CHARGE: f64 = 1.602176634e-19;
const AVOGADRO: f64 = 6.02214076e23;
const VACUUM_PERMITTIVITY: f64 = 8.8541878128e-12;

/// 1/(4πε₀), kJ/mol·nm/e².
pub(super) const COULOMB: f64 =
    1e6 * ELEMENTARY_CHARGE * ELEMENTARY_CHARGE * AVOGADRO / (4.0 * PI * VACUUM_PERMITTIVITY);

#[derive(Clone, Debug)]
pub(super) struct NonbondedPairs {
    neighbors: Neighbors,
    places: Places,
    sweep: Sweep,
    particles: Particles,
    field: Option<ReactionField>,
    /// Exceptions with an energy.
    exceptions: Vec<NonbondedException>,
    has_lennard_jones: bool,
    image: Option<NearestImage>,
    /// Exceptions too are at their nearest images.
    image_exceptions: bool,
    /// The mean energy beyond the cutoff.
    dispersion: f64,
}

/// √K q, σ/2, 2√ε of each place.
#[derive(Clone, Debug)]
struct Particles {
    charge: Vec<Fused>,
    half_sigma: Vec<Fused>,
    twice_root_epsilon: Vec<Fused>,
}

/// The numbers of a cutoff.
#[derive(Clone, Copy, Debug)]
struct ReactionField {
    /// r_c, r_c², k, c.
    distance: f64,
    square: f64,
    k: f64,
    c: f64,
    /// r_s, 1/(r_c − r_s).
    switching: Option<[f64; 2]>,
}

impl ReactionField {
    fn new(cutoff: Cutoff, dielectric: f64) -> Self {
        let (r, scale) = (cutoff.distance, 1.0 / (2.0 * dielectric + 1.0));
        ReactionField {
            distance: r,
            square: r * r,
            k: (dielectric - 1.0) * scale / (r * r * r),
            c: 3.0 * dielectric * scale / r,
            switching: cutoff.switching.map(|start| [start, 1.0 / (r - start)]),
        }
    }
}

impl NonbondedPairs {
    pub(super) fn new(tables: &Nonbonded) -> Self {
        let n = tables.particles.len();
        let exceptions = tables.exceptions.iter();
        let exclusions = Exclusions::new(n, exceptions.clone().map(|e| e.atoms));
        let each = |f: fn(&NonbondedParticle) -> f64| tables.particles.iter().map(|p| Fused(f(p))).collect();
        let particles = Particles {
            charge: each(|p| COULOMB.sqrt() * p.charge),
            half_sigma: each(|p| 0.5 * p.sigma),
            twice_root_epsilon: each(|p| 2.0 * p.epsilon.sqrt()),
        };
        let field = tables.cutoff.map(|c| ReactionField::new(c, tables.reaction_field_dielectric));
        let with_energy = exceptions.filter(|e| e.charge_product != 0.0 || e.epsilon != 0.0);
        let image = tables.periodic.as_ref().map(NearestImage::new);
        let mut sum = Self::of(n, particles, exclusions, with_energy.copied().collect(), (field, image));
        if let (Some(image), Some(periodic), Some(cutoff)) = (image, tables.periodic, tables.cutoff) {
            sum.image_exceptions = periodic.exceptions;
            if periodic.dispersion_correction {
                sum.dispersion = image.dispersion(&tables.particles, cutoff);
            }
        }
        sum
    }

    /// The sum of n particles.
    fn of(
        n: usize,
        mut particles: Particles,
        exclusions: Exclusions,
        exceptions: Vec<NonbondedException>,
        (field, image): (Option<ReactionField>, Option<NearestImage>),
    ) -> Self {
        let neighbors = Neighbors::new(n, exclusions, field.map(|field| field.distance)).in_box(image);
        let padded = neighbors.tiles().padded();
        let mut sweep = Sweep::default();
        sweep.fit(neighbors.tiles(), 0);
        let Particles { charge, half_sigma, twice_root_epsilon } = &mut particles;
        for numbers in [charge, half_sigma, twice_root_epsilon] {
            numbers.resize(padded, Fused(0.0));
        }
        NonbondedPairs {
            places: Places::new(padded),
            sweep,
            neighbors,
            field,
            has_lennard_jones: particles.twice_root_epsilon.iter().any(|x| x.0 != 0.0),
            particles,
            exceptions,
            image,
            image_exceptions: false,
            dispersion: 0.0,
        }
    }

    /// Pairs are at their nearest images.
    pub(super) fn is_periodic(&self) -> bool {
        self.image.is_some()
    }

    /// Takes out the pairs within groups.
    pub(super) fn take_out(&mut self, groups: &RigidGroups, level: Level, x: &[Vec3<f64>]) -> TakenOut {
        let n = x.len();
        let known = self.neighbors.exclusions();
        let mut excluded: Vec<[usize; 2]> = known.pairs().collect();
        let mut count = [0, n * n.saturating_sub(1) / 2 - excluded.len() + self.exceptions.len()];
        let mut energy = 0.0;
        // A group so large that its pairs may be nearest at other images turns in the box: they are not constant.
        let limit = self.image.zip(self.field).map(|(image, field)| image.width() - field.distance);
        for (group, pairs) in groups.pairs() {
            let far = |limit: f64| group.iter().any(|&i| 2.0 * (x[i] - x[group[0]]).norm() >= limit);
            if limit.is_some_and(far) {
                continue;
            }
            let own = |pair: &[usize; 2]| !known.of(group[pair[0]]).contains(&group[pair[1]]);
            let (own, others): (Vec<[usize; 2]>, _) = pairs.into_iter().partition(own);
            if own.is_empty() {
                continue;
            }
            count[0] += own.len();
            excluded.extend(own.iter().map(|pair| pair.map(|k| group[k])));
            // The sum over the group alone, without the pairs that are excluded or counted in another group.
            let all = (0..group.len()).flat_map(|a| (a + 1..group.len()).map(move |b| [a, b]));
            let rest = all.filter(|pair| !own.contains(pair)).chain(others);
            let of = |numbers: &[Fused]| group.iter().map(|&i| numbers[i]).collect();
            let particles = Particles {
                charge: of(&self.particles.charge),
                half_sigma: of(&self.particles.half_sigma),
                twice_root_epsilon: of(&self.particles.twice_root_epsilon),
            };
            let exclusions = Exclusions::new(group.len(), rest);
            let mut sum = Self::of(group.len(), particles, exclusions, Vec::new(), (self.field, self.image));
            let places: Vec<Vec3<f64>> = group.iter().map(|&i| x[i]).collect();
            energy += sum.evaluate(level, &places, &mut vec![Vec3::zero(); group.len()]);
        }
        let exceptions = std::mem::take(&mut self.exceptions);
        let (out, rest): (Vec<_>, Vec<_>) =
            exceptions.into_iter().partition(|e| !self.image_exceptions && groups.hold(&e.atoms));
        count[0] += out.len();
        self.exceptions = out;
        energy += self.exceptions(x, &mut vec![Vec3::zero(); n]);
        let particles = self.particles.clone();
        let (image_exceptions, dispersion) = (self.image_exceptions, self.dispersion);
        let ranges = (self.field, self.image);
        *self = Self::of(n, particles, Exclusions::new(n, excluded.into_iter()), rest, ranges);
        (self.image_exceptions, self.dispersion) = (image_exceptions, dispersion);
        (count, energy)
    }

    pub(super) fn evaluate(&mut self, level: Level, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let NonbondedPairs { neighbors, places, sweep, particles, .. } = self;
        neighbors.update(x);
        places.set(x);
        let tiles = neighbors.tiles();
        let all_pairs = match (self.field, self.image, self.has_lennard_jones) {
            (None, _, true) => sweep.run(level, tiles, places, &Pairs::<true> { particles }),
            (None, _, false) => sweep.run(level, tiles, places, &Pairs::<false> { particles }),
            (Some(field), None, _) => sweep.run(level, tiles, places, &NearPairs { particles, field }),
            (Some(field), Some(image), _) => {
                let near = NearPairs { particles, field };
                sweep.run(level, tiles, places, &PeriodicPairs { near, image })
            }
        };
        sweep.add_forces(tiles, forces);
        all_pairs + self.exceptions(x, forces) + self.dispersion
    }

    fn exceptions(&self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let mut energy = 0.0;
        for exception in &self.exceptions {
            let (r, gradient) = match self.image.filter(|_| self.image_exceptions) {
                None => distance(x, exception.atoms),
                Some(image) => {
                    let [i, j] = exception.atoms;
                    distance(&[Vec3::zero(), image.of(x[j] - x[i])], [0, 1])
                }
            };
            let s2 = (exception.sigma / r) * (exception.sigma / r);
            let s6 = s2 * s2 * s2;
            let coulomb = COULOMB * exception.charge_product / r;
            energy += 4.0 * exception.epsilon * s6 * (s6 - 1.0) + coulomb;
            let force = gradient.scale((4.0 * exception.epsilon * s6 * (12.0 * s6 - 6.0) + coulomb) / r);
            forces[exception.atoms[0]] -= force;
            forces[exception.atoms[1]] += force;
        }
        energy
    }
}

impl Particles {
    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> [T; 3] {
        let Particles { charge, half_sigma, twice_root_epsilon } = self;
        [
            T::broadcast(charge[place]),
            T::broadcast(half_sigma[place]),
            T::broadcast(twice_root_epsilon[place]),
        ]
    }
    #[inline(always)]
    fn column<T: Lanes>(&self, first: usize) -> [T; 3] {
        let Particles { charge, half_sigma, twice_root_epsilon } = self;
        [T::load(&charge[first..]), T::load(&half_sigma[first..]), T::load(&twice_root_epsilon[first..])]
    }
}

/// 4 ε and (σ/r)⁶ of a pair, both multiplied: of lanes without a pair 0; and (σ/r)⁶ itself.
#[inline(always)]
fn lennard_jones<T: Lanes>(row: &[T; 3], column: &[T; 3], at: &At<'_, T>, inverse_square: T) -> (T, T) {
    let sigma = row[1] + column[1];
    let s2 = sigma * sigma * inverse_square;
    let s6 = s2 * s2 * s2;
    (at.only(row[2] * column[2]) * s6, s6)
}

/// The sum over pairs that have no exception; with Lennard-Jones energies or without.
struct Pairs<'a, const LENNARD_JONES: bool> {
    particles: &'a Particles,
}

impl<const LENNARD_JONES: bool> PairKernel<3> for Pairs<'_, LENNARD_JONES> {
    type Row<T: Lanes> = [T; 3];
    type Column<T: Lanes> = [T; 3];

    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> [T; 3] {
        self.particles.row(place)
    }
    #[inline(always)]
    fn column<T: Lanes>(&self, first: usize) -> [T; 3] {
        self.particles.column(first)
    }
    #[inline(always)]
    fn pair<T: Lanes>(
        &self,
        row: &[T; 3],
        column: &[T; 3],
        at: At<'_, T>,
        row_sums: &mut [T; 3],
        column_sums: &mut [T; 3],
    ) -> T {
        let inverse = at.square.reciprocal_root();
        // Of coincident atoms it is infinite, and the force then not a number.
        let inverse_square = inverse * inverse;
        let coulomb = at.only(row[0] * column[0]) * inverse;
        let (mut energy, mut slope) = (coulomb, coulomb);
        if LENNARD_JONES {
            let (scaled, s6) = lennard_jones(row, column, &at, inverse_square);
            energy = scaled.fma(s6 - T::one(), energy);
            slope = scaled.fma(s6.fma(T::splat(12.0), T::splat(-6.0)), slope);
        }
        push(slope * inverse_square, &at.d, row_sums, column_sums);
        energy
    }
}

/// The same within a cutoff.
struct NearPairs<'a> {
    particles: &'a Particles,
    field: ReactionField,
}

impl PairKernel<3> for NearPairs<'_> {
    const CUTOFF: bool = true;
    type Row<T: Lanes> = [T; 3];
    type Column<T: Lanes> = [T; 3];

    #[inline(always)]
    fn cutoff_square(&self) -> f64 {
        self.field.square
    }
    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> [T; 3] {
        self.particles.row(place)
    }
    #[inline(always)]
    fn column<T: Lanes>(&self, first: usize) -> [T; 3] {
        self.particles.column(first)
    }
    #[inline(always)]
    fn pair<T: Lanes>(
        &self,
        row: &[T; 3],
        column: &[T; 3],
        at: At<'_, T>,
        row_sums: &mut [T; 3],
        column_sums: &mut [T; 3],
    ) -> T {
        let inverse = at.square.reciprocal_root();
        let inverse_square = inverse * inverse;
        let charges = at.only(row[0] * column[0]);
        let k_square = at.square * T::splat(self.field.k);
        let coulomb = charges * ((inverse + k_square) - T::splat(self.field.c));
        let coulomb_slope = charges * (inverse - (k_square + k_square));
        let (scaled, s6) = lennard_jones(row, column, &at, inverse_square);
        let mut energy = scaled * (s6 - T::one());
        let mut slope = scaled * s6.fma(T::splat(12.0), T::splat(-6.0));
        if let Some([start, scale]) = self.field.switching {
            let (r, scale) = (at.square * inverse, T::splat(scale));
            let t = ((r - T::splat(start)) * scale).larger(T::zero());
            let (t2, six) = (t * t, T::splat(-6.0));
            let factor = (t2 * t).fma(t.fma(t.fma(six, T::splat(15.0)), T::splat(-10.0)), T::one());
            // −r S′ = 30 t² (1 − t)² r/(r_c − r_s).
            let rest = T::one() - t;
            let fall = T::splat(30.0) * t2 * rest * rest * scale * r;
            slope = energy.fma(fall, slope * factor);
            energy *= factor;
        }
        push((slope + coulomb_slope) * inverse_square, &at.d, row_sums, column_sums);
        energy + coulomb
    }
}

/// The same at nearest images.
struct PeriodicPairs<'a> {
    near: NearPairs<'a>,
    image: NearestImage,
}

impl PairKernel<3> for PeriodicPairs<'_> {
    const CUTOFF: bool = true;
    type Row<T: Lanes> = [T; 3];
    type Column<T: Lanes> = [T; 3];

    #[inline(always)]
    fn cutoff_square(&self) -> f64 {
        self.near.cutoff_square()
    }
    #[inline(always)]
    fn row<T: Lanes>(&self, place: usize) -> [T; 3] {
        self.near.row(place)
    }
    #[inline(always)]
    fn column<T: Lanes>(&self, first: usize) -> [T; 3] {
        self.near.column(first)
    }
    #[inline(always)]
    fn pair<T: Lanes>(
        &self,
        row: &[T; 3],
        column: &[T; 3],
        mut at: At<'_, T>,
        row_sums: &mut [T; 3],
        column_sums: &mut [T; 3],
    ) -> T {
        at.nearest(&self.image);
        self.near.pair(row, column, at, row_sums, column_sums)
    }
}
