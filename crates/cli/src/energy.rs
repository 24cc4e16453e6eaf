//! `phipsi energy`: the energy of a molecule, term by term.

use crate::show::{fail, print_json, table};
use crate::{Common, Ending};
use clap::Args;
use phipsi::formats::Report;
use phipsi::formats::system::SystemOptions;
use phipsi::molecule::{ForceField, Molecule, Potential, read_molecule};
use phipsi::spatial::Vec3;
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// What to evaluate.
#[derive(Args)]
pub struct Options {
    /// Atoms and positions
    #[arg(value_name = "PDB")]
    pdb: PathBuf,
    /// Their force field: an OpenMM System, as openmm.XmlSerializer writes it
    #[arg(long, value_name = "XML")]
    system: PathBuf,
    /// Print the force on every atom too
    #[arg(long)]
    forces: bool,
    /// Leave out a force of the System, by its name or class; may be repeated
    #[arg(long, value_name = "NAME")]
    ignore: Vec<String>,
}

/// Energies (kJ/mol) of the terms, and forces (kJ/mol/nm).
struct Evaluated {
    terms: Vec<(String, f64)>,
    total: f64,
    forces: Vec<Vec3<f64>>,
}

/// Evaluates a force field at the positions of a PDB file.
pub fn energy(options: &Options, common: &Common) -> Ending {
    let system = SystemOptions { ignore: options.ignore.clone() };
    let (molecule, reports) =
        match read_molecule(&options.pdb, &options.system, &system).into_result(common.strict) {
            Ok(loaded) => loaded,
            Err(reports) => {
                // A report without problems has nothing to say about the failure of the other one.
                let told = reports.iter().filter(|r| !r.errors.is_empty() || !r.warnings.is_empty());
                let text: Vec<String> = told.map(|r| r.to_string().trim_end().into()).collect();
                return fail(&text.join("\n"), common);
            }
        };
    let evaluated = match evaluate(&molecule) {
        Ok(evaluated) => evaluated,
        Err(message) => return fail(&format!("{}: {message}", options.pdb.display()), common),
    };
    if common.json {
        print_json(&to_json(&evaluated, options.forces));
        return Ending::Fine;
    }
    anstream::print!("{}", for_people(&molecule, &evaluated, options.forces));
    if !common.quiet {
        anstream::eprint!("{}", remarks(&reports));
    }
    Ending::Fine
}

fn evaluate(molecule: &Molecule) -> Result<Evaluated, String> {
    let mut field = ForceField::new(&molecule.system).map_err(|e| e.to_string())?;
    let mut energies = vec![0.0; field.terms().len()];
    let mut forces = vec![Vec3::zero(); molecule.positions.len()];
    field.evaluate(&molecule.positions, &mut energies, &mut forces).map_err(|e| molecule.describe(&e))?;
    let total: f64 = energies.iter().sum();
    if !total.is_finite() {
        return Err(format!("the sum of the energies is {total}; separate atoms that nearly coincide"));
    }
    Ok(Evaluated { terms: field.terms().iter().cloned().zip(energies).collect(), total, forces })
}

fn to_json(evaluated: &Evaluated, forces: bool) -> Value {
    let terms: Map<String, Value> = evaluated.terms.iter().map(|(k, e)| (k.clone(), json!(e))).collect();
    let forces = forces.then(|| evaluated.forces.iter().map(|f| f.0).collect::<Vec<_>>());
    json!({ "terms": terms, "total": evaluated.total, "forces": forces })
}

fn for_people(molecule: &Molecule, evaluated: &Evaluated, forces: bool) -> String {
    let total = [("total".to_string(), evaluated.total)];
    let number = |x: &f64| format!("{x:16.6}");
    let rows: Vec<(&str, Vec<String>)> = evaluated
        .terms
        .iter()
        .chain(&total)
        .map(|(name, e)| (name.as_str(), vec![format!("{} kJ/mol", number(e))]))
        .collect();
    let mut text = table(&rows);
    if forces {
        let names: Vec<String> = (0..molecule.atoms.len()).map(|i| molecule.atoms.label(i)).collect();
        let mut rows: Vec<(&str, Vec<String>)> =
            vec![("forces", vec![format!("{:>16}{:>16}{:>16}  kJ/mol/nm", "x", "y", "z")])];
        let line = |f: &Vec3<f64>| vec![f.0.iter().map(number).collect::<String>()];
        rows.extend(names.iter().zip(&evaluated.forces).map(|(name, f)| (name.as_str(), line(f))));
        text += "\n";
        text += &table(&rows);
    }
    text
}

/// Warnings, and what had no effect.
fn remarks(reports: &[Report]) -> String {
    let mut text = String::new();
    for report in reports {
        let at = |line: Option<u32>| line.map_or(report.source.clone(), |l| format!("{}:{l}", report.source));
        for p in &report.warnings {
            text += &format!("warning: {}: {}: {}; {}\n", at(p.line), p.place, p.found, p.remedy);
        }
        for (word, notes) in [("approximated", &report.approximated), ("ignored", &report.ignored)] {
            for n in notes {
                text += &format!("{word}: {}: {}: {}\n", at(n.line), n.place, n.what);
            }
        }
    }
    text
}
