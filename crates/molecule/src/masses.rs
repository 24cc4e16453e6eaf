//! Masses of atoms against their elements.
//!
//! | mass | judgement |
//! |---|---|
//! | within 1.2 Da of the element's | fits: isotopes do, neighbours of carbon do not |
//! | hydrogen up to 5 Da | fits: heavy hydrogens allow longer steps |
//! | of a heavy atom, with what its hydrogens have too much, within 1.2 Da | fits: hydrogen masses were repartitioned |
//! | 0 | fits: a particle that does not move |
//! | anything else | another atom |

use crate::atoms::Atoms;

/// Largest difference from the element's mass, Da.
const TOLERANCE: f64 = 1.2;

/// Hydrogens made heavier at their neighbours' cost have up to four times their mass, Da.
const HEAVIEST_HYDROGEN: f64 = 5.0;

/// Standard atomic weights, Da (IUPAC; of the longest-lived isotope where there is none), in the order of atomic numbers.
#[rustfmt::skip]
const WEIGHTS: [f64; 103] = [
    1.008, 4.003, 6.940, 9.012, 10.810, 12.011, 14.007, 15.999, 18.998, 20.180, 22.990, 24.305, 26.982,
    28.085, 30.974, 32.060, 35.450, 39.948, 39.098, 40.078, 44.956, 47.867, 50.941, 51.996, 54.938, 55.845,
    58.933, 58.693, 63.546, 65.380, 69.723, 72.630, 74.922, 78.971, 79.904, 83.798, 85.468, 87.620, 88.906,
    91.224, 92.906, 95.950, 97.907, 101.070, 102.906, 106.420, 107.868, 112.414, 114.818, 118.710, 121.760,
    127.600, 126.904, 131.293, 132.905, 137.327, 138.905, 140.116, 140.908, 144.242, 144.913, 150.360,
    151.964, 157.250, 158.925, 162.500, 164.930, 167.259, 168.934, 173.054, 174.967, 178.490, 180.948,
    183.840, 186.207, 190.230, 192.217, 195.084, 196.967, 200.592, 204.380, 207.200, 208.980, 208.982,
    209.987, 222.018, 223.020, 226.025, 227.028, 232.038, 231.036, 238.029, 237.048, 244.064, 243.061,
    247.070, 247.070, 251.080, 252.083, 257.095, 258.098, 259.101, 262.110,
];

/// The mass of an element, Da; `None` for what is none, and beyond lawrencium.
pub(crate) fn weight(element: u8) -> Option<f64> {
    WEIGHTS.get(usize::from(element).checked_sub(1)?).copied()
}

/// The element that has this mass, within 0.2 Da; 0 where none has.
pub(crate) fn element_of_mass(mass: f64) -> u8 {
    let near = |i: &usize| (WEIGHTS[*i] - mass).abs();
    let nearest = (0..WEIGHTS.len()).min_by(|a, b| near(a).total_cmp(&near(b)));
    nearest.filter(|i| near(i) < 0.2).map_or(0, |i| i as u8 + 1)
}

/// The atoms whose masses are not those of their elements. Those without an element are not judged.
pub(crate) fn misfits(atoms: &Atoms) -> Vec<usize> {
    let excess = |i: usize| weight(atoms.elements[i]).map_or(0.0, |weight| atoms.masses[i] - weight);
    let is_hydrogen = |i: usize| atoms.elements[i] == 1 && atoms.masses[i] <= HEAVIEST_HYDROGEN;
    let mut borrowed = vec![0.0; atoms.len()];
    for &[i, j] in &atoms.bonds {
        for (hydrogen, heavy) in [(i, j), (j, i)] {
            if is_hydrogen(hydrogen) && atoms.elements[heavy] > 1 {
                borrowed[heavy] += excess(hydrogen);
            }
        }
    }
    let fits = |i: usize| {
        let mass = atoms.masses[i];
        mass == 0.0
            || excess(i).abs() <= TOLERANCE
            || is_hydrogen(i)
            || (atoms.elements[i] > 1 && (excess(i) + borrowed[i]).abs() <= TOLERANCE)
    };
    (0..atoms.len()).filter(|&i| !fits(i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Methanol: C, three H, O, H.
    fn methanol(masses: [f64; 6]) -> Vec<usize> {
        let bonds = vec![[0, 1], [0, 2], [0, 3], [0, 4], [4, 5]];
        misfits(&Atoms { masses: masses.into(), elements: vec![6, 1, 1, 1, 8, 1], bonds, names: Vec::new() })
    }

    #[test]
    fn isotopes_fit_and_neighbours_in_the_table_do_not() {
        assert!(methanol([12.01, 1.008, 2.014, 1.0, 16.0, 3.016]).is_empty());
        assert!(methanol([13.003, 1.008, 1.008, 1.008, 17.0, 1.008]).is_empty());
        assert_eq!(methanol([14.01, 1.008, 1.008, 1.008, 14.01, 1.008]), [0, 4]);
        assert_eq!(methanol([1.008, 12.01, 1.008, 1.008, 16.0, 1.008]), [0, 1]);
    }

    #[test]
    fn mass_that_hydrogens_have_may_be_missing_at_their_neighbour() {
        assert!(methanol([12.01 - 9.0, 4.008, 4.008, 4.008, 13.0, 4.008]).is_empty());
        // Heavy hydrogens without a donor are one's own choice; a donor that gave more than they have is another atom.
        assert!(methanol([12.01, 4.008, 4.008, 4.008, 16.0, 1.008]).is_empty());
        assert_eq!(methanol([12.01 - 9.0, 3.0, 3.0, 3.0, 16.0, 1.008]), [0]);
        assert!(methanol([0.0, 1.008, 1.008, 1.008, 16.0, 1.008]).is_empty());
    }

    #[test]
    fn elements_are_known_by_their_masses() {
        assert_eq!([12.01, 35.45, 1.008, 5.5, 0.0].map(element_of_mass), [6, 17, 1, 0, 0]);
        assert!((1..=103).all(|z| weight(z).is_some()) && weight(0).is_none() && weight(104).is_none());
    }
}
