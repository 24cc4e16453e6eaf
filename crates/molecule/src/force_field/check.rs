//! Whether the tables of a force fit the particles: kernels index without a second look.

use super::ForceFieldError;
use phipsi_formats::system::{CustomBonded, Force, ForceKind, Formula, GbScope};

/// # Errors
/// The first entry that does not fit.
pub(super) fn force(force: &Force, n: usize) -> Result<(), ForceFieldError> {
    let error =
        |found: String, required: String| Err(ForceFieldError { force: force.name.clone(), found, required });
    let atoms = |what: &str, number: usize, atoms: &[usize]| match atoms.iter().find(|atom| **atom >= n) {
        Some(atom) => error(format!("particle {atom} in {what} {number}"), format!("less than {n}")),
        None => Ok(()),
    };
    let count = |what: &str, found: usize, required: usize| match found == required {
        true => Ok(()),
        false => error(format!("{found} {what}"), format!("{required}")),
    };
    let variables =
        |formula: &Formula, required: usize| count("variables of the formula", formula.variables(), required);
    match &force.kind {
        ForceKind::HarmonicBond(list) => {
            list.iter().enumerate().try_for_each(|(k, entry)| atoms("bond", k, &entry.atoms))
        }
        ForceKind::HarmonicAngle(list) => {
            list.iter().enumerate().try_for_each(|(k, entry)| atoms("angle", k, &entry.atoms))
        }
        ForceKind::PeriodicTorsion(list) => {
            list.iter().enumerate().try_for_each(|(k, entry)| atoms("torsion", k, &entry.atoms))
        }
        ForceKind::RbTorsion(list) => {
            list.iter().enumerate().try_for_each(|(k, entry)| atoms("torsion", k, &entry.atoms))
        }
        ForceKind::CmapTorsion(cmap) => {
            for map in &cmap.maps {
                if map.size == 0 || map.size.checked_mul(map.size) != Some(map.energies.len()) {
                    let found = format!("a map of size {} with {} energies", map.size, map.energies.len());
                    return error(found, "size² energies".into());
                }
            }
            for (k, torsion) in cmap.torsions.iter().enumerate() {
                atoms("torsion", k, torsion.atoms.as_flattened())?;
                if torsion.map >= cmap.maps.len() {
                    let found = format!("map {} in torsion {k}", torsion.map);
                    return error(found, format!("less than {}", cmap.maps.len()));
                }
            }
            Ok(())
        }
        ForceKind::Nonbonded(tables) => {
            count("particles", tables.particles.len(), n)?;
            let mut exceptions = tables.exceptions.iter().enumerate();
            exceptions.try_for_each(|(k, entry)| atoms("exception", k, &entry.atoms))
        }
        ForceKind::GbsaObc(tables) => count("particles", tables.particles.len(), n),
        ForceKind::CustomBond(tables) => custom(tables, atoms, count),
        ForceKind::CustomAngle(tables) => custom(tables, atoms, count),
        ForceKind::CustomTorsion(tables) => custom(tables, atoms, count),
        ForceKind::CustomNonbonded(tables) => {
            let parameters = tables.parameter_names.len();
            variables(&tables.energy, 1 + 2 * parameters)?;
            count("parameters", tables.parameters.len(), parameters * n)?;
            let mut exclusions = tables.exclusions.iter().enumerate();
            exclusions.try_for_each(|(k, pair)| atoms("exclusion", k, pair))
        }
        ForceKind::CustomGb(tables) => {
            let parameters = tables.parameter_names.len();
            count("parameters", tables.parameters.len(), parameters * n)?;
            for (k, value) in tables.values.iter().enumerate() {
                if (value.scope == GbScope::Particle) == (k == 0) {
                    let required = "a value of pairs first, then values of single particles";
                    return error(format!("value `{}` in place {k}", value.name), required.into());
                }
                let of_pair = 1 + 2 * parameters;
                variables(&value.formula, if k == 0 { of_pair } else { parameters + k })?;
            }
            for energy in &tables.energies {
                let one = parameters + tables.values.len();
                let of_pair = 1 + 2 * one;
                variables(&energy.formula, if energy.scope == GbScope::Particle { one } else { of_pair })?;
            }
            let mut exclusions = tables.exclusions.iter().enumerate();
            exclusions.try_for_each(|(k, pair)| atoms("exclusion", k, pair))
        }
    }
}

type Checked = Result<(), ForceFieldError>;

fn custom<const N: usize>(
    tables: &CustomBonded<N>,
    atoms: impl Fn(&str, usize, &[usize]) -> Checked,
    count: impl Fn(&str, usize, usize) -> Checked,
) -> Checked {
    let parameters = tables.parameter_names.len();
    count("variables of the formula", tables.energy.variables(), 1 + parameters)?;
    count("parameters", tables.parameters.len(), parameters * tables.atoms.len())?;
    tables.atoms.iter().enumerate().try_for_each(|(k, entry)| atoms("entry", k, entry))
}
