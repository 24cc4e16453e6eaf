//! Conditions that a flexible body must meet.

use super::{FlexibleBody, Matrix3};
use crate::violation::{Subject, Violation};
use nalgebra::DMatrix;
use std::collections::HashSet;

/// Symmetry to this part of the largest entry: printed matrices carry about six digits, integrals from elements twelve.
const SYMMETRY: f64 = 1e-6;

/// Largest magnitude of a number.
const LARGEST: f64 = 1e60;

/// All that is wrong with the modal data of body `name`.
pub(crate) fn check_flexible(name: &str, body: &FlexibleBody, found: &mut Vec<Violation>) {
    let subject = || Subject::Body(name.to_string());
    let before = found.len();
    check_lengths(&subject, body, found);
    if found.len() > before {
        return;
    }
    check_numbers(&subject, body, found);
    check_nodes(&subject, body, found);
    if found.len() > before {
        return;
    }
    check_matrices(&subject, body, found);
}

fn check_lengths(subject: &dyn Fn() -> Subject, body: &FlexibleBody, found: &mut Vec<Violation>) {
    let integrals = &body.integrals;
    let n = body.modes();
    let mut all = vec![
        ("moment integrals E".to_string(), integrals.moment.len(), n),
        ("product integrals S".to_string(), integrals.product.len(), n * n),
        ("rotary coupling C_r".to_string(), integrals.rotary_coupling.len(), n),
        ("rotary modal inertia M_r".to_string(), integrals.rotary_modal.len(), n * n),
        ("modal stiffness K".to_string(), body.stiffness.len(), n * n),
        ("modal damping C".to_string(), body.damping.len(), n * n),
    ];
    if let Some(stiffening) = &integrals.stiffening {
        all.push(("stiffening integrals T1".to_string(), stiffening.displacement.len(), n * n));
        all.push(("stiffening integrals T2".to_string(), stiffening.moment.len(), n * n));
    }
    for node in &body.nodes {
        all.push((format!("displacements of node `{}`", node.name), node.displacement.len(), n));
        all.push((format!("rotations of node `{}`", node.name), node.rotation.len(), n));
        if let Some(quadratic) = &node.quadratic {
            all.push((format!("quadratic displacements of node `{}`", node.name), quadratic.len(), n * n));
        }
    }
    for (what, length, required) in all {
        if length != required {
            let what = format!("{what}: {length} entries for {n} modes");
            let remedy = "give every integral for every mode, pairs by rows";
            found.push(Violation::error(subject(), what, format!("{required} entries"), remedy));
        }
    }
}

fn check_numbers(subject: &dyn Fn() -> Subject, body: &FlexibleBody, found: &mut Vec<Violation>) {
    fn vectors(x: &[[f64; 3]]) -> Vec<f64> {
        x.concat()
    }
    fn matrices(x: &[Matrix3]) -> Vec<f64> {
        x.iter().flatten().flatten().copied().collect()
    }
    let integrals = &body.integrals;
    let mut all: Vec<(String, Vec<f64>)> = vec![
        ("mass".into(), vec![integrals.mass]),
        ("first moment".into(), integrals.first_moment.to_vec()),
        ("second moment".into(), integrals.second_moment.concat()),
        ("displacement integrals S1".into(), vectors(&integrals.displacement)),
        ("moment integrals E".into(), matrices(&integrals.moment)),
        ("product integrals S".into(), matrices(&integrals.product)),
        ("rotary inertia J_r".into(), integrals.rotary.concat()),
        ("rotary coupling C_r".into(), vectors(&integrals.rotary_coupling)),
        ("rotary modal inertia M_r".into(), integrals.rotary_modal.clone()),
        ("modal stiffness K".into(), body.stiffness.clone()),
        ("modal damping C".into(), body.damping.clone()),
    ];
    if let Some(stiffening) = &integrals.stiffening {
        all.push(("stiffening integrals T1".into(), vectors(&stiffening.displacement)));
        all.push(("stiffening integrals T2".into(), matrices(&stiffening.moment)));
    }
    for node in &body.nodes {
        let mut numbers = node.position.to_vec();
        numbers.extend(vectors(&node.displacement));
        numbers.extend(vectors(&node.rotation));
        numbers.extend(node.quadratic.iter().flat_map(|x| vectors(x)));
        all.push((format!("node `{}`", node.name), numbers));
    }
    for (what, numbers) in all {
        if let Some(x) = numbers.iter().find(|x| !x.is_finite() || x.abs() > LARGEST) {
            let required = format!("finite numbers of magnitude at most {LARGEST:e}");
            found.push(Violation::error(subject(), format!("{what}: {x:?}"), required, "correct the number"));
        }
    }
    if body.integrals.mass <= 0.0 {
        let what = format!("mass {:e} kg of a flexible body", body.integrals.mass);
        found.push(Violation::error(subject(), what, "mass > 0", "give the body its mass"));
    }
}

fn check_nodes(subject: &dyn Fn() -> Subject, body: &FlexibleBody, found: &mut Vec<Violation>) {
    let mut seen = HashSet::new();
    for node in &body.nodes {
        if !seen.insert(node.name.as_str()) {
            let what = format!("two nodes called `{}`", node.name);
            found.push(Violation::error(subject(), what, "different names", "rename one of the nodes"));
        }
    }
    if let Some(inboard) = &body.inboard
        && body.find_node(inboard).is_none()
    {
        let names: Vec<&str> = body.nodes.iter().take(20).map(|n| n.name.as_str()).collect();
        let what = format!("inboard node `{inboard}` does not exist; nodes: {}", names.join(", "));
        found.push(Violation::error(subject(), what, "the name of a node", "correct the name"));
    }
}

fn check_matrices(subject: &dyn Fn() -> Subject, body: &FlexibleBody, found: &mut Vec<Violation>) {
    let integrals = &body.integrals;
    let n = body.modes();
    let mut symmetric = |what: &str, m: &[f64], n: usize| {
        let largest = m.iter().fold(0.0f64, |a, x| a.max(x.abs()));
        for l in 0..n {
            for k in 0..l {
                let (a, b) = (m[l * n + k], m[k * n + l]);
                if (a - b).abs() > SYMMETRY * largest {
                    let what = format!("{what}: entries ({l}, {k}) and ({k}, {l}) are {a:e} and {b:e}");
                    found.push(Violation::error(
                        subject(),
                        what,
                        "a symmetric matrix",
                        "correct one of them",
                    ));
                    return;
                }
            }
        }
    };
    symmetric("second moment", &integrals.second_moment.concat(), 3);
    symmetric("rotary inertia J_r", &integrals.rotary.concat(), 3);
    symmetric("rotary modal inertia M_r", &integrals.rotary_modal, n);
    symmetric("modal stiffness K", &body.stiffness, n);
    symmetric("modal damping C", &body.damping, n);
    for i in 0..3 {
        for j in 0..3 {
            let entry = |l: usize, k: usize| {
                let s = &integrals.product;
                if l < k { s[l * n + k][i][j] } else { s[l * n + k][j][i] }
            };
            let part: Vec<f64> = (0..n * n).map(|x| entry(x / n, x % n)).collect();
            symmetric("product integrals, S_ml = S_lm*", &part, n);
        }
    }
    let mut paired = |what: &str, entry: &dyn Fn(usize) -> Vec<f64>| {
        let width = if n > 0 { entry(0).len() } else { 0 };
        for i in 0..width {
            let part: Vec<f64> = (0..n * n).map(|x| entry(x)[i]).collect();
            symmetric(what, &part, n);
        }
    };
    if let Some(stiffening) = &integrals.stiffening {
        paired("stiffening integrals T1", &|x| stiffening.displacement[x].to_vec());
        paired("stiffening integrals T2", &|x| stiffening.moment[x].concat());
    }
    for node in &body.nodes {
        if let Some(quadratic) = &node.quadratic {
            paired(&format!("quadratic displacements of node `{}`", node.name), &|x| quadratic[x].to_vec());
        }
    }
    if let Some(mode) = dependent_mode(&integrals.modal_mass(), n) {
        let what = format!("modal mass matrix tr S + M_r is not positive definite at mode {}", mode + 1);
        let remedy = "the mode has no mass or depends on the others: leave it out";
        found.push(Violation::error(subject(), what, "a positive definite modal mass matrix", remedy));
    }
    for mode in 0..n {
        let k = body.stiffness[mode * n + mode];
        if k < 0.0 {
            let what = format!("stiffness {k:e} of mode {}", mode + 1);
            found.push(
                Violation::error(subject(), what, "0 or more", "a negative stiffness buckles").as_warning(),
            );
        }
    }
}

/// The first mode at which an elimination of the modal mass matrix meets a pivot that is not positive.
fn dependent_mode(mass: &[f64], n: usize) -> Option<usize> {
    let mut a = DMatrix::from_row_slice(n, n, mass);
    for j in 0..n {
        let pivot = a[(j, j)];
        // What is left of a dependent mode is rounding of its own mass.
        if pivot.is_nan() || pivot <= 16.0 * n as f64 * f64::EPSILON * mass[j * n + j].abs() {
            return Some(j);
        }
        for i in j + 1..n {
            let factor = a[(i, j)] / pivot;
            for k in j..n {
                a[(i, k)] -= factor * a[(j, k)];
            }
        }
    }
    None
}
