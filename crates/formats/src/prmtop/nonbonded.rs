//! Charges, Lennard-Jones coefficients, exceptions, generalized Born radii.

use super::bonded::Pair14;
use super::sections::Sections;
use super::{CALORIE, Pointers};
use crate::system::{GbsaObc, GbsaParticle, Nonbonded, NonbondedException, NonbondedParticle};
use std::collections::BTreeMap;

/// The unit of charges, in e: they are multiplied by the root of Coulomb's constant in kcal Å/mol.
const CHARGE: f64 = 18.2223;

/// Relative difference of a coefficient from the combination rules: its eight digits, to the powers that are taken.
const SAME: f64 = 1e-6;

/// Energy of the surface that GBSAOBCForce has, kJ/mol/nm².
const SURFACE: f64 = 2.25936;

/// σ (nm) and ε (kJ/mol) of A/r¹² − B/r⁶.
fn sigma_epsilon([a, b]: [f64; 2]) -> [f64; 2] {
    match a == 0.0 || b == 0.0 {
        true => [0.1, 0.0],
        false => [0.1 * (a / b).powf(1.0 / 6.0), 0.25 * CALORIE * b * b / a],
    }
}

/// The coefficients of all pairs of types.
struct Coefficients {
    types: usize,
    /// Place in the lists of coefficients, from 1; not positive for 10-12 terms.
    index: Vec<i64>,
    a: Vec<f64>,
    b: Vec<f64>,
}

impl Coefficients {
    fn read(sections: &mut Sections<'_>, types: usize) -> Option<Self> {
        let count = types * (types + 1) / 2;
        let index = sections.integers("NONBONDED_PARM_INDEX", Some(types * types))?;
        let a = sections.reals("LENNARD_JONES_ACOEF", count)?;
        let b = sections.reals("LENNARD_JONES_BCOEF", count)?;
        if let Some(k) = index.iter().position(|i| *i > count as i64) {
            let name = "NONBONDED_PARM_INDEX";
            let found = format!("field {} is {}", k + 1, index[k]);
            let required = format!("at most {count}, the number of coefficients");
            sections.error(sections.line(name), name, found, &required, "write the file anew");
            return None;
        }
        Some(Coefficients { types, index, a, b })
    }
    /// A and B of a pair of types; none for 10-12 terms.
    fn of(&self, i: usize, j: usize) -> Option<[f64; 2]> {
        let k = usize::try_from(self.index[self.types * i + j] - 1).ok()?;
        Some([self.a[k], self.b[k]])
    }
    /// σ and ε of each type, where all pairs follow from them by the rules of Lorentz and Berthelot.
    fn of_types(&self, sections: &mut Sections<'_>, used: &[usize]) -> Option<Vec<[f64; 2]>> {
        let mut of_type = vec![[0.1, 0.0]; self.types];
        for &i in used {
            of_type[i] = sigma_epsilon(self.of(i, i).unwrap_or_default());
        }
        for &i in used {
            for &j in used {
                let Some([a, b]) = self.of(i, j) else { continue };
                let sigma = 10.0 * 0.5 * (of_type[i][0] + of_type[j][0]);
                let epsilon = (of_type[i][1] * of_type[j][1]).sqrt() / CALORIE;
                let power = sigma.powi(6);
                let rules = [4.0 * epsilon * power * power, 4.0 * epsilon * power];
                let differs = |x: f64, rule: f64| (x - rule).abs() > SAME * x.abs().max(rule.abs());
                if differs(a, rules[0]) || differs(b, rules[1]) {
                    let name = "LENNARD_JONES_ACOEF";
                    let found = format!("types {} and {} with coefficients of their own", i + 1, j + 1);
                    let required = "coefficients by the rules of Lorentz and Berthelot";
                    let remedy = "make a System with OpenMM: createSystem, then XmlSerializer.serialize";
                    sections.error(sections.line(name), name, found, required, remedy);
                    return None;
                }
            }
        }
        Some(of_type)
    }
}

pub(super) fn nonbonded(
    sections: &mut Sections<'_>,
    pointers: &Pointers,
    n: usize,
    pairs: &[Pair14],
) -> Option<Nonbonded> {
    let charges: Vec<f64> = sections.reals("CHARGE", n)?.into_iter().map(|q| q / CHARGE).collect();
    let types = pointers.count(1);
    let type_of = sections.integers("ATOM_TYPE_INDEX", Some(n))?;
    let type_of: Vec<usize> = type_of.into_iter().filter_map(|t| usize::try_from(t - 1).ok()).collect();
    if type_of.len() < n || type_of.iter().any(|t| *t >= types) {
        let (name, found) = ("ATOM_TYPE_INDEX", "a type that is not there".to_string());
        sections.error(sections.line(name), name, found, &format!("types 1…{types}"), "write the file anew");
        return None;
    }
    refuse_10_12(sections, pointers.count(19));
    let coefficients = Coefficients::read(sections, types)?;
    let mut used = type_of.clone();
    used.sort_unstable();
    used.dedup();
    let of_type = coefficients.of_types(sections, &used)?;
    let particle = |i: usize| {
        let [sigma, epsilon] = of_type[type_of[i]];
        NonbondedParticle { charge: charges[i], sigma, epsilon }
    };
    let mut exceptions: BTreeMap<[usize; 2], NonbondedException> = BTreeMap::new();
    for &Pair14 { atoms: [i, j], scee, scnb } in pairs {
        let [sigma, epsilon] = sigma_epsilon(coefficients.of(type_of[i], type_of[j]).unwrap_or_default());
        let (charge_product, epsilon) = (charges[i] * charges[j] / scee, epsilon / scnb);
        let exception = NonbondedException { atoms: [i, j], charge_product, sigma, epsilon };
        exceptions.insert([i.min(j), i.max(j)], exception);
    }
    for atoms in excluded(sections, n)? {
        let none = NonbondedException { atoms, charge_product: 0.0, sigma: 0.1, epsilon: 0.0 };
        exceptions.entry([atoms[0].min(atoms[1]), atoms[0].max(atoms[1])]).or_insert(none);
    }
    let particles = (0..n).map(particle).collect();
    Some(Nonbonded { particles, exceptions: exceptions.into_values().collect(), ..Nonbonded::default() })
}

fn refuse_10_12(sections: &mut Sections<'_>, count: usize) {
    for name in ["HBOND_ACOEF", "HBOND_BCOEF"] {
        let numbers = if count > 0 { sections.reals(name, count) } else { None };
        if numbers.is_some_and(|x| x.iter().any(|x| *x != 0.0)) {
            let remedy = "use a force field without 10-12 terms";
            sections.error(sections.line(name), name, "10-12 terms".into(), "zeros", remedy);
        }
    }
}

/// The excluded pairs: of each atom the later ones that its list names; a list of nothing is one zero.
fn excluded(sections: &mut Sections<'_>, n: usize) -> Option<Vec<[usize; 2]>> {
    let counts = sections.integers("NUMBER_EXCLUDED_ATOMS", Some(n))?;
    let name = "EXCLUDED_ATOMS_LIST";
    let total = counts.iter().map(|c| usize::try_from(*c).unwrap_or(0)).fold(0, usize::saturating_add);
    let list = sections.integers(name, Some(total))?;
    let mut rest = &list[..];
    let mut pairs = Vec::new();
    for (i, count) in counts.iter().enumerate() {
        let (own, others) = rest.split_at(usize::try_from(*count).unwrap_or(0).min(rest.len()));
        rest = others;
        for j in own.iter().filter(|j| **j != 0) {
            match usize::try_from(j - 1).ok().filter(|j| *j < n && *j != i) {
                Some(j) => pairs.push([i, j]),
                None => {
                    let found = format!("atom {j} in the list of atom {}", i + 1);
                    let required = format!("another atom of 1…{n}");
                    sections.error(sections.line(name), name, found, &required, "write the file anew");
                    return None;
                }
            }
        }
    }
    Some(pairs)
}

pub(super) fn gbsa_obc(
    sections: &mut Sections<'_>,
    charges: &[f64],
    [solvent_dielectric, solute_dielectric]: [f64; 2],
) -> Option<GbsaObc> {
    let radii = sections.reals("RADII", charges.len())?;
    let screen = sections.reals("SCREEN", charges.len())?;
    // The offset that is taken from each radius.
    if let Some(i) = radii.iter().position(|r| *r <= 0.09) {
        let found = format!("radius {} Å of atom {}", radii[i], i + 1);
        sections.error(
            sections.line("RADII"),
            "RADII",
            found,
            "more than 0.09 Å",
            "set radii: mbondi2 for OBC2",
        );
        return None;
    }
    let particle = |i: usize| GbsaParticle { charge: charges[i], radius: 0.1 * radii[i], scale: screen[i] };
    let particles = (0..charges.len()).map(particle).collect();
    Some(GbsaObc {
        solvent_dielectric,
        solute_dielectric,
        surface_area_energy: SURFACE,
        particles,
        cutoff: None,
    })
}
