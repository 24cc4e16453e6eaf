//! Custom forces that have a closed form: recognized by their formulas, with the numbers that the file gives.
//!
//! A formula fits a pattern if both are the same expression after parsing, but for numbers that the pattern leaves open.

use super::exclusions::Exclusions;
use super::generalized_born::{Constants, GeneralizedBorn, Particle};
use super::lennard_jones_table::LennardJonesTable;
use phipsi_formats::Expression;
use phipsi_formats::system::{CustomGb, CustomNonbonded, Formula, GbScope};

/// Numbers in patterns that stand for any number.
const OPEN: [&str; 3] = ["7.03125e211", "7.09375e211", "7.15625e211"];

/// The energy of [`LennardJonesTable`], if it is that.
pub(super) fn lennard_jones(tables: &CustomNonbonded, n: usize) -> Option<LennardJonesTable> {
    let [name] = &tables.parameter_names[..] else { return None };
    // From the back: the last call is read first.
    let [b, a] = tables.energy.calls() else { return None };
    let variables = ["r", &format!("{name}1"), &format!("{name}2")];
    for call in [a, b] {
        let arguments: Vec<String> = call.arguments.iter().map(Expression::to_string).collect();
        if arguments != variables[1..] {
            return None;
        }
    }
    let names = tables.energy.expression().variables();
    let (b_name, a_name) = (names.get(3)?, names.get(4)?);
    let pattern = format!("{a_name}/r^12 - {b_name}/r^6");
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let pattern = Expression::parse(&pattern, &names, &[]).ok()?;
    if pattern.to_string() != tables.energy.expression().to_string() {
        return None;
    }
    let [count, columns] = *a.table.sizes()? else { return None };
    if count != columns || b.table.sizes()? != [count, count] {
        return None;
    }
    let coefficients = a.table.values().iter().zip(b.table.values()).map(|(a, b)| [*a, *b]).collect();
    let known = |x: &f64| (x.round() >= 0.0 && x.round() < count as f64).then_some(x.round() as usize);
    let types = tables.parameters.iter().map(known).collect::<Option<Vec<usize>>>()?;
    let exclusions = Exclusions::new(n, tables.exclusions.iter().copied());
    Some(LennardJonesTable { types, count, coefficients, exclusions, cutoff: tables.cutoff })
}

/// The energy that OpenMM's `implicit/obc2.xml` makes, with or without its surface energy.
pub(super) fn obc2(tables: &CustomGb) -> Option<GeneralizedBorn> {
    if tables.parameter_names != ["charge", "or", "sr"] {
        return None;
    }
    let [integral, born] = &tables.values[..] else { return None };
    if (integral.name.as_str(), born.name.as_str()) != ("I", "B") || integral.scope != GbScope::Pair {
        return None;
    }
    let overlap = "select(step(r+sr2-or1), 0.5*(1/L-1/U+0.25*(r-sr2^2/r)*(1/(U^2)-1/(L^2))+0.5*log(L/U)/r), 0); \
                   U=r+sr2; L=max(or1, D); D=abs(r-sr2)";
    fit(overlap, &integral.formula)?;
    let [a, b, c] = OPEN;
    let radius = format!("1/(1/or-tanh(psi-{a}*psi^2+{b}*psi^3)/radius); psi=I*or; radius=or+{c}");
    let [beta, gamma, offset] = fit(&radius, &born.formula)?;
    let (mut own, mut pair, mut surface) = (None, None, None);
    for energy in &tables.energies {
        let (slot, numbers) = match energy.scope {
            GbScope::Particle => {
                let surface_energy = format!("{a}*(radius+{b})^2*(radius/B)^6; radius=or+{c}");
                match fit(&format!("-{a}*charge^2/B"), &energy.formula) {
                    Some(numbers) => (&mut own, numbers),
                    None => (&mut surface, fit(&surface_energy, &energy.formula)?),
                }
            }
            GbScope::Pair => {
                let f = "f=sqrt(r^2+B1*B2*exp(-r^2/(4*B1*B2)))";
                let plain = fit(&format!("-{a}*charge1*charge2/f; {f}"), &energy.formula);
                let shifted = || fit(&format!("-{a}*charge1*charge2*(1/f-{b}); {f}"), &energy.formula);
                (&mut pair, plain.or_else(shifted)?)
            }
            GbScope::PairWithExclusions => return None,
        };
        if slot.replace(numbers).is_some() {
            return None;
        }
    }
    let mut particles = Vec::new();
    for row in tables.parameters.chunks_exact(3) {
        let &[charge, offset_radius, scaled_radius] = row else { return None };
        // Outside this range B may be negative or infinite: the formulas themselves say what that means.
        if offset_radius <= 0.0 || scaled_radius < 0.0 || offset < 0.0 {
            return None;
        }
        let surface = surface.map_or(0.0, |[factor, probe, offset]: [f64; 3]| {
            let radius = offset_radius + offset;
            factor * (radius + probe) * (radius + probe) * radius.powi(6)
        });
        let radius = offset_radius + offset;
        particles.push(Particle { charge, offset_radius, scaled_radius, radius, surface });
    }
    let [factor, shift, _] = pair?;
    let constants = Constants {
        kappa: [own?[0], factor],
        obc: [beta, gamma],
        inside: false,
        cutoff: tables.cutoff,
        shift,
    };
    Some(GeneralizedBorn::new(particles, constants))
}

/// The numbers in place of the open ones; `None` unless the formula fits the pattern. Absent ones are 0.
fn fit(pattern: &str, formula: &Formula) -> Option<[f64; 3]> {
    let names: Vec<&str> = formula.expression().variables().iter().map(String::as_str).collect();
    let pattern = Expression::parse(pattern, &names, &[]).ok()?;
    let (frame, expected) = split(&pattern.to_string())?;
    let (found_frame, found) = split(&formula.expression().to_string())?;
    if frame != found_frame || expected.len() != found.len() {
        return None;
    }
    let open: Vec<f64> = OPEN.iter().filter_map(|text| text.parse().ok()).collect();
    let mut numbers: [Option<f64>; 3] = [None; 3];
    for (expected, found) in expected.into_iter().zip(found) {
        match open.iter().position(|number| *number == expected) {
            Some(k) if numbers[k].is_none_or(|known| known == found) => numbers[k] = Some(found),
            None if expected == found => {}
            _ => return None,
        }
    }
    Some(numbers.map(Option::unwrap_or_default))
}

/// An expression with `#` in place of its numbers, and the numbers.
fn split(text: &str) -> Option<(String, Vec<f64>)> {
    let (mut frame, mut numbers) = (String::new(), Vec::new());
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let in_name = frame.ends_with(|c: char| c.is_alphanumeric() || c == '_');
        if !c.is_ascii_digit() || in_name {
            frame.push(c);
            rest = &rest[c.len_utf8()..];
            continue;
        }
        let bytes = rest.as_bytes();
        let is_number = |k: usize| match bytes[k] {
            b'0'..=b'9' | b'.' | b'e' => true,
            b'-' => bytes[k - 1] == b'e',
            _ => false,
        };
        let end = (1..bytes.len()).find(|k| !is_number(*k)).unwrap_or(bytes.len());
        numbers.push(rest[..end].parse().ok()?);
        frame.push('#');
        rest = &rest[end..];
    }
    Some((frame, numbers))
}

#[cfg(test)]
mod tests {
    use super::super::{Term, custom_gb::CustomGbTerm, custom_nonbonded::CustomPairs};
    use super::*;
    use flate2::read::GzDecoder;
    use phipsi_formats::system::{ForceKind, SystemOptions, read_system};
    use phipsi_model::Random;
    use phipsi_spatial::Vec3;
    use std::io::Read;

    /// Texts of systems, and how many custom forces with a closed form and without they have.
    const FILES: [(&str, usize, usize); 6] = [
        ("aladi/aladi.obc2.xml.gz", 1, 0),
        ("aladi/aladi.charmm36.xml.gz", 1, 0),
        ("every_force/implicit.xml.gz", 1, 2),
        ("every_force/pairs.xml.gz", 1, 2),
        ("cutoffs/custom_born.xml.gz", 1, 0),
        ("cutoffs/charmm.xml.gz", 1, 0),
    ];

    fn text(file: &str) -> String {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../validation/data/molecules");
        let mut text = String::new();
        let file = std::fs::File::open(format!("{folder}/{file}")).unwrap();
        GzDecoder::new(file).read_to_string(&mut text).unwrap();
        text
    }

    fn forces(text: &str) -> (usize, Vec<ForceKind>) {
        let (system, _) = read_system(text, "", &SystemOptions::default()).into_result(true).unwrap();
        (system.masses.len(), system.forces.into_iter().map(|force| force.kind).collect())
    }

    /// The closed form of a force and its general form.
    fn twins(kind: &ForceKind, n: usize) -> Option<(Option<Term>, Term)> {
        Some(match kind {
            ForceKind::CustomGb(tables) => {
                (obc2(tables).map(Term::GeneralizedBorn), Term::CustomGb(CustomGbTerm::new(tables, n)))
            }
            ForceKind::CustomNonbonded(tables) => {
                let closed = lennard_jones(tables, n).map(Term::LennardJonesTable);
                (closed, Term::CustomNonbonded(CustomPairs::new(tables, n)))
            }
            _ => return None,
        })
    }

    #[test]
    fn closed_forms_are_the_formulas() {
        for (file, closed_forms, others) in FILES {
            let (n, kinds) = forces(&text(file));
            let (mut recognized, mut general_only) = (0, 0);
            for (closed, mut general) in kinds.iter().filter_map(|kind| twins(kind, n)) {
                let Some(mut closed) = closed else {
                    general_only += 1;
                    continue;
                };
                recognized += 1;
                for seed in 0..5 {
                    let mut random = Random::new(seed);
                    // In the densest ones atoms lie inside each other.
                    let size = [1.0, 0.6, 0.3, 0.2, 0.15][seed as usize];
                    let x: Vec<Vec3<f64>> =
                        (0..n).map(|_| Vec3([0, 1, 2].map(|_| size * random.signed()))).collect();
                    let zero = vec![Vec3([0.0; 3]); n];
                    let (mut f, mut g) = (zero.clone(), zero);
                    let level = phipsi_spatial::lanes::Level::best();
                    let (a, b) = (closed.evaluate(level, &x, &mut f), general.evaluate(level, &x, &mut g));
                    let largest = |f: &[Vec3<f64>]| f.iter().map(|f| f.norm()).fold(0.0, f64::max);
                    let difference: Vec<Vec3<f64>> = f.iter().zip(&g).map(|(f, g)| *f - *g).collect();
                    // About 10² operations between a coordinate and the energy of a pair, 231 pairs, and cancellation
                    // of charges.
                    let bar = 5000.0 * f64::EPSILON;
                    assert!((a - b).abs() <= bar * b.abs(), "{file} seed {seed}: {a} {b}");
                    assert!(largest(&difference) <= bar * largest(&g), "{file} seed {seed}: forces");
                }
            }
            assert_eq!((recognized, general_only), (closed_forms, others), "{file}");
        }
    }

    #[test]
    fn numbers_are_those_of_the_file_and_other_formulas_are_not_recognized() {
        let text = text("aladi/aladi.obc2.xml.gz");
        let gb = |from: &str, to: &str| {
            assert!(text.contains(from), "{from}");
            let (_, kinds) = forces(&text.replace(from, to));
            let Some(ForceKind::CustomGb(tables)) = kinds.into_iter().next_back() else { panic!("{from}") };
            obc2(&tables)
        };
        for (from, to) in
            [("solventDielectric=78.5", "solventDielectric=4"), ("4.85*psi^3", "5*psi^3"), ("0.14)", "0.1)")]
        {
            assert!(gb(from, to).is_some(), "{to}");
        }
        for (from, to) in [
            ("0.25*(r-sr2^2/r)", "0.26*(r-sr2^2/r)"),
            ("tanh(psi", "tanh(2*psi"),
            ("charge^2/B", "charge^2/B^2"),
            ("(radius/B)^6", "(radius/B)^5"),
            ("r^2/(4*B1*B2)", "r^2/(3*B1*B2)"),
            ("log(L/U)", "log(U/L)"),
            ("name=\"I\" type=\"2\"", "name=\"I\" type=\"1\""),
            ("param2=\".111", "param2=\"-.111"),
        ] {
            assert!(gb(from, to).is_none(), "{to}");
        }
    }
}
