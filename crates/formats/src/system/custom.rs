//! Forces whose energies are expressions.

use super::nonbonded::METHODS;
use super::reader::{Entry, Reader};
use super::{CustomBonded, CustomGb, CustomNonbonded, Formula, GbEnergy, GbScope, GbValue, Table};
use crate::suggest::quote;
use roxmltree::Node;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Most parameters of one force; a formula reads them one after the other.
const MOST_PARAMETERS: usize = 50;

/// Words of a force on N particles.
pub(super) struct Words<const N: usize> {
    parameters: &'static str,
    list: &'static str,
    entry: &'static str,
    what: &'static str,
    coordinate: &'static str,
    atoms: [&'static str; N],
}

pub(super) const BOND: Words<2> = Words {
    parameters: "PerBondParameters",
    list: "Bonds",
    entry: "Bond",
    what: "bond",
    coordinate: "r",
    atoms: ["p1", "p2"],
};
pub(super) const ANGLE: Words<3> = Words {
    parameters: "PerAngleParameters",
    list: "Angles",
    entry: "Angle",
    what: "angle",
    coordinate: "theta",
    atoms: ["p1", "p2", "p3"],
};
pub(super) const TORSION: Words<4> = Words {
    parameters: "PerTorsionParameters",
    list: "Torsions",
    entry: "Torsion",
    what: "torsion",
    coordinate: "theta",
    atoms: ["p1", "p2", "p3", "p4"],
};

type Globals = BTreeMap<String, f64>;

pub(super) fn bonded<const N: usize>(
    reader: &mut Reader,
    node: Node<'_, '_>,
    place: &str,
    n: usize,
    words: &Words<N>,
    globals: &mut Globals,
) -> Option<CustomBonded<N>> {
    reader.check_force(node, place, &["energy"]);
    let names = [words.parameters, "GlobalParameters", "EnergyParameterDerivatives", words.list];
    let [parameters, global, derivatives, list] = reader.lists(node, place, &names, &names[1..3]);
    ignore_derivatives(reader, derivatives, place);
    let constants = global_parameters(reader, global, place, globals);
    let parameter_names = parameter_names(reader, parameters, place, &[words.coordinate])?;
    let mut variables = vec![words.coordinate];
    variables.extend(parameter_names.iter().map(String::as_str));
    let energy = formula(reader, &Entry::whole(node, place), "energy", &variables, &constants, &[])?;
    let (mut atoms, mut values) = (Vec::new(), Vec::new());
    for entry in reader.entries(list, place, words.entry, words.what) {
        if let Some(found) = reader.atoms(&entry, words.atoms, n) {
            atoms.push(found);
        }
        parameter_values(reader, &entry, &words.atoms, parameter_names.len(), &mut values);
    }
    Some(CustomBonded { energy, coordinate: words.coordinate, parameter_names, atoms, parameters: values })
}

pub(super) fn nonbonded(
    reader: &mut Reader,
    node: Node<'_, '_>,
    place: &str,
    n: usize,
    globals: &mut Globals,
) -> Option<CustomNonbonded> {
    let known =
        ["energy", "method", "cutoff", "useSwitchingFunction", "switchingDistance", "useLongRangeCorrection"];
    reader.check_force(node, place, &known);
    let cutoff = reader.switched_cutoff(node, place, &METHODS[..3]);
    const LISTS: [&str; 8] = [
        "PerParticleParameters",
        "Particles",
        "Exclusions",
        "GlobalParameters",
        "ComputedValues",
        "EnergyParameterDerivatives",
        "Functions",
        "InteractionGroups",
    ];
    let lists = reader.lists(node, place, &LISTS, &LISTS[3..]);
    let [parameters, particles, exclusions, global, computed, derivatives, functions, groups] = lists;
    ignore_derivatives(reader, derivatives, place);
    for (list, what) in [(computed, "a computed value"), (groups, "an interaction group")] {
        if let Some(entry) = list.and_then(|list| list.children().find(Node::is_element)) {
            let to_do = "write the energy by parameters of the particles";
            reader.error(entry, place, what, "none", to_do);
        }
    }
    let constants = global_parameters(reader, global, place, globals);
    let tables = tables(reader, functions, place)?;
    let parameter_names = parameter_names(reader, parameters, place, &["r"])?;
    let variables = pair_variables(&parameter_names, &[]);
    let variables: Vec<&str> = variables.iter().map(String::as_str).collect();
    let energy = formula(reader, &Entry::whole(node, place), "energy", &variables, &constants, &tables)?;
    let parameters = particle_parameters(reader, particles, place, parameter_names.len(), n);
    let exclusions = pairs(reader, exclusions, place, n);
    Some(CustomNonbonded { cutoff, energy, parameter_names, parameters, exclusions })
}

pub(super) fn gb(
    reader: &mut Reader,
    node: Node<'_, '_>,
    place: &str,
    n: usize,
    globals: &mut Globals,
) -> Option<CustomGb> {
    reader.check_force(node, place, &["method", "cutoff"]);
    let cutoff = reader.cutoff(node, place, &METHODS[..3]);
    const LISTS: [&str; 8] = [
        "PerParticleParameters",
        "ComputedValues",
        "EnergyTerms",
        "Particles",
        "Exclusions",
        "GlobalParameters",
        "EnergyParameterDerivatives",
        "Functions",
    ];
    let lists = reader.lists(node, place, &LISTS, &LISTS[5..]);
    let [parameters, computed, terms, particles, exclusions, global, derivatives, functions] = lists;
    ignore_derivatives(reader, derivatives, place);
    let constants = global_parameters(reader, global, place, globals);
    let tables = tables(reader, functions, place)?;
    let parameter_names = parameter_names(reader, parameters, place, &["r"])?;
    let mut values: Vec<GbValue> = Vec::new();
    for entry in reader.entries(computed, place, "Value", "computed value") {
        reader.check_attributes(&entry, &["name", "expression", "type"]);
        let scope = scope(reader, &entry)?;
        let name = reader.text(&entry, "name")?;
        let taken = name.is_empty() || name == "r" || parameter_names.iter().any(|known| known == name);
        if taken || values.iter().any(|value| value.name == name) || values.len() >= MOST_PARAMETERS {
            return reader.bad(&entry, "name", name, "a name that nothing else has");
        }
        if (scope == GbScope::Particle) == values.is_empty() {
            let (found, required) = match scope {
                GbScope::Particle => ("the first computed value of a single particle", "one of pairs"),
                _ => ("a computed value of pairs behind another one", "one of single particles"),
            };
            reader.error(entry.node, &entry.place(), found, required, "OpenMM has the same rule: rewrite it");
            return None;
        }
        let variables = match scope {
            GbScope::Particle => particle_variables(&parameter_names, &values),
            _ => pair_variables(&parameter_names, &[]),
        };
        let variables: Vec<&str> = variables.iter().map(String::as_str).collect();
        let formula = formula(reader, &entry, "expression", &variables, &constants, &tables)?;
        values.push(GbValue { name: name.into(), scope, formula });
    }
    let mut energies = Vec::new();
    for entry in reader.entries(terms, place, "Term", "energy term") {
        reader.check_attributes(&entry, &["expression", "type"]);
        let scope = scope(reader, &entry)?;
        let variables = match scope {
            GbScope::Particle => particle_variables(&parameter_names, &values),
            _ => pair_variables(&parameter_names, &values),
        };
        let variables: Vec<&str> = variables.iter().map(String::as_str).collect();
        let formula = formula(reader, &entry, "expression", &variables, &constants, &tables)?;
        energies.push(GbEnergy { scope, formula });
    }
    let parameters = particle_parameters(reader, particles, place, parameter_names.len(), n);
    let exclusions = pairs(reader, exclusions, place, n);
    Some(CustomGb { cutoff, parameter_names, parameters, values, energies, exclusions })
}

fn scope(reader: &mut Reader, entry: &Entry<'_, '_>) -> Option<GbScope> {
    let scopes = [GbScope::Particle, GbScope::PairWithExclusions, GbScope::Pair];
    reader.integer_in(entry, "type", 0, 2).map(|kind| scopes[kind])
}

/// Parameters of one particle, then the values before.
fn particle_variables(parameters: &[String], values: &[GbValue]) -> Vec<String> {
    parameters.iter().chain(values.iter().map(|value| &value.name)).cloned().collect()
}

/// `r`, then parameters and values of the first particle, then of the second.
fn pair_variables(parameters: &[String], values: &[GbValue]) -> Vec<String> {
    let one = particle_variables(parameters, values);
    let numbered = [1, 2].into_iter().flat_map(|k| one.iter().map(move |name| format!("{name}{k}")));
    ["r".to_string()].into_iter().chain(numbered).collect()
}

fn formula(
    reader: &mut Reader,
    at: &Entry<'_, '_>,
    attribute: &str,
    variables: &[&str],
    constants: &[(String, f64)],
    tables: &[Arc<Table>],
) -> Option<Formula> {
    let text = reader.text(at, attribute)?;
    let constants: Vec<(&str, f64)> = constants.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    match Formula::parse(text, variables, &constants, tables) {
        Ok(formula) => Some(formula),
        Err(e) => {
            let found = format!("{} at character {} of {attribute}={}", e.found, e.column, quote(text));
            reader.error(at.node, &at.place(), found, &e.required, &e.remedy);
            None
        }
    }
}

/// Names of the parameters; an error for one that is empty, repeated or `taken`.
fn parameter_names(
    reader: &mut Reader,
    list: Option<Node<'_, '_>>,
    place: &str,
    taken: &[&str],
) -> Option<Vec<String>> {
    let mut names: Vec<String> = Vec::new();
    for entry in reader.entries(list, place, "Parameter", "parameter") {
        reader.check_attributes(&entry, &["name"]);
        let name = reader.text(&entry, "name")?;
        let known = taken.contains(&name) || names.iter().any(|other| other == name);
        if name.is_empty() || known || names.len() >= MOST_PARAMETERS {
            let required = format!("a name that nothing else has, of at most {MOST_PARAMETERS}");
            return reader.bad(&entry, "name", name, &required);
        }
        names.push(name.into());
    }
    Some(names)
}

/// Names and default values; an error where another force gave the same name another value.
fn global_parameters(
    reader: &mut Reader,
    list: Option<Node<'_, '_>>,
    place: &str,
    globals: &mut Globals,
) -> Vec<(String, f64)> {
    let mut constants = Vec::new();
    for entry in reader.entries(list, place, "Parameter", "global parameter") {
        reader.check_attributes(&entry, &["name", "default"]);
        let (name, value) = (reader.text(&entry, "name"), reader.number(&entry, "default"));
        let (Some(name), Some(value)) = (name, value) else { continue };
        let first = *globals.entry(name.into()).or_insert(value);
        if first != value {
            let required = format!("{first}, as in a force before");
            let _ = reader.bad::<()>(&entry, "default", &value.to_string(), &required);
        }
        constants.push((name.to_string(), value));
    }
    constants
}

fn ignore_derivatives(reader: &mut Reader, list: Option<Node<'_, '_>>, place: &str) {
    for entry in reader.entries(list, place, "Parameter", "derivative") {
        reader.ignored(entry.node, place, "derivative by a global parameter");
    }
}

/// Adds the values of the attributes `param1`, `param2`, … of an entry.
fn parameter_values(
    reader: &mut Reader,
    entry: &Entry<'_, '_>,
    others: &[&str],
    count: usize,
    to: &mut Vec<f64>,
) {
    for k in 1..=count {
        to.push(reader.number(entry, &format!("param{k}")).unwrap_or(0.0));
    }
    if entry.node.attributes().len() != others.len() + count {
        let names: Vec<String> = (1..=count).map(|k| format!("param{k}")).collect();
        let known: Vec<&str> = others.iter().copied().chain(names.iter().map(String::as_str)).collect();
        reader.check_attributes(entry, &known);
    }
}

fn particle_parameters(
    reader: &mut Reader,
    list: Option<Node<'_, '_>>,
    place: &str,
    count: usize,
    n: usize,
) -> Vec<f64> {
    let mut values = Vec::new();
    let entries = reader.entries(list, place, "Particle", "particle");
    for entry in &entries {
        parameter_values(reader, entry, &[], count, &mut values);
    }
    if let Some(list) = list {
        reader.check_count(list, place, entries.len(), n);
    }
    values
}

fn pairs(reader: &mut Reader, list: Option<Node<'_, '_>>, place: &str, n: usize) -> Vec<[usize; 2]> {
    let mut pairs = Vec::new();
    for entry in reader.entries(list, place, "Exclusion", "exclusion") {
        reader.check_attributes(&entry, &["p1", "p2"]);
        pairs.extend(reader.atoms(&entry, ["p1", "p2"], n));
    }
    pairs
}

/// `None` where one has an error: every formula that calls it would have another.
fn tables(reader: &mut Reader, list: Option<Node<'_, '_>>, place: &str) -> Option<Vec<Arc<Table>>> {
    let errors = reader.count;
    let mut tables: Vec<Arc<Table>> = Vec::new();
    for entry in reader.entries(list, place, "Function", "function") {
        if let Some(table) = table(reader, &entry, place) {
            if tables.iter().any(|other| other.name == table.name) || tables.len() >= MOST_PARAMETERS {
                let _ = reader.bad::<()>(&entry, "name", &table.name, "a name that nothing else has");
            }
            tables.push(Arc::new(table));
        }
    }
    (reader.count == errors).then_some(tables)
}

fn table(reader: &mut Reader, entry: &Entry<'_, '_>, place: &str) -> Option<Table> {
    let name = reader.text(entry, "name")?;
    if name.is_empty() || name.contains(|c: char| c.is_whitespace() || "+-*/^(),;=".contains(c)) {
        return reader.bad(entry, "name", name, "a name without spaces and operators");
    }
    let class = entry.node.attribute("type").unwrap_or_default();
    const COMMON: [&str; 3] = ["name", "type", "version"];
    let sizes: &[&str] = match class {
        "Discrete1DFunction" | "Continuous1DFunction" => &[],
        "Discrete2DFunction" => &["xsize", "ysize"],
        "Discrete3DFunction" => &["xsize", "ysize", "zsize"],
        _ => {
            let required =
                "Discrete1DFunction, Discrete2DFunction, Discrete3DFunction or Continuous1DFunction";
            return reader.bad(entry, "type", class, required);
        }
    };
    let continuous = class == "Continuous1DFunction";
    let others: &[&str] = if continuous { &["min", "max", "periodic"] } else { sizes };
    reader.check_attributes(entry, &[&COMMON, others].concat());
    let [list] = reader.lists(entry.node, place, &["Values"], &[]);
    let mut values = Vec::new();
    for value in reader.entries(list, place, "Value", "value of a function") {
        values.push(reader.number(&value, "v")?);
    }
    let (count, table) = (values.len(), name.to_string());
    let made = if continuous {
        let limits = [reader.number(entry, "min")?, reader.number(entry, "max")?];
        let periodic = entry.node.attribute("periodic").is_some_and(|text| text.trim() != "0");
        Table::continuous(table, limits, periodic, values)
    } else if sizes.is_empty() {
        Table::discrete(table, &[count], values)
    } else {
        let mut numbers = Vec::new();
        for size in sizes {
            numbers.push(reader.integer_in(entry, size, 1, 1_000_000_000)?);
        }
        Table::discrete(table, &numbers, values)
    };
    if made.is_none() {
        let required = match continuous {
            true => "at least two values (three, the last as the first, if periodic) and min < max",
            false => "as many values as the product of the sizes",
        };
        reader.error(entry.node, &entry.place(), format!("{count} values"), required, "correct the function");
    }
    made
}
