//! Values of each particle and energies of them, by their formulas: the general form of generalized Born models.
//!
//! | symbol | meaning |
//! |---|---|
//! | V₁ᵢ | Σ_j F₁(rᵢⱼ, parameters of i, of j): the first value, of pairs |
//! | Vₖᵢ | Fₖ(parameters of i, V₁ᵢ … Vₖ₋₁,ᵢ): the others |
//! | E | Σᵢ of single particles + Σ_{i<j} of pairs |
//! | ∂Vₖᵢ | ∂E/∂Vₖᵢ: first of the energies alone, then from the last value to the first through the Fₖ |

use super::exclusions::Exclusions;
use super::geometry::distance;
use phipsi_formats::system::{CustomGb, Formula, GbScope, Slope};
use phipsi_spatial::Vec3;

#[derive(Clone, Debug)]
pub(super) struct CustomGbTerm {
    /// Number of parameters, and of parameters and values, of one particle.
    parameters: usize,
    width: usize,
    /// Pairs from this distance on are left out.
    cutoff: f64,
    /// The first value; its slope is that in r.
    first: Option<Function>,
    /// The other values, with slopes in the values before.
    others: Vec<Function>,
    /// Energies, with slopes in the values: in pairs first in r, then in the values of both.
    energies: Vec<Function>,
    /// Parameters and values of all particles, particle by particle; ∂E/∂V of them.
    rows: Vec<f64>,
    by_value: Vec<f64>,
    /// The variables of a formula, and its slopes.
    buffer: Vec<f64>,
    slopes: Vec<f64>,
}

#[derive(Clone, Debug)]
struct Function {
    scope: GbScope,
    exclusions: Exclusions,
    formula: Formula,
    slopes: Vec<Slope>,
}

impl Function {
    fn new(tables: &CustomGb, n: usize, scope: GbScope, formula: &Formula, variables: &[String]) -> Self {
        let excluded = tables.exclusions.iter().filter(|_| scope == GbScope::PairWithExclusions);
        Function {
            scope,
            exclusions: Exclusions::new(n, excluded.copied()),
            formula: formula.clone(),
            slopes: variables.iter().map(|name| formula.slope(name)).collect(),
        }
    }
    /// The value; slopes go to `slopes`.
    fn value(&self, buffer: &mut [f64], slopes: &mut [f64]) -> f64 {
        for (slope, out) in self.slopes.iter().zip(&mut *slopes) {
            self.formula.value_and_slopes(buffer, &[slope], std::slice::from_mut(out));
        }
        self.formula.value(buffer)
    }
}

impl CustomGbTerm {
    pub(super) fn new(tables: &CustomGb, n: usize) -> Self {
        let names: Vec<String> = tables.values.iter().map(|value| value.name.clone()).collect();
        let parameters = tables.parameter_names.len();
        let width = parameters + names.len();
        let r = ["r".to_string()];
        let mut values = tables.values.iter();
        let first = values.next().map(|value| Function::new(tables, n, value.scope, &value.formula, &r));
        let others = values
            .enumerate()
            .map(|(k, value)| Function::new(tables, n, value.scope, &value.formula, &names[..=k]))
            .collect();
        let numbered = [1, 2].into_iter().flat_map(|k| names.iter().map(move |name| format!("{name}{k}")));
        let of_pair: Vec<String> = r.iter().cloned().chain(numbered).collect();
        let energies: Vec<Function> = (tables.energies.iter())
            .map(|energy| match energy.scope {
                GbScope::Particle => Function::new(tables, n, energy.scope, &energy.formula, &names),
                _ => Function::new(tables, n, energy.scope, &energy.formula, &of_pair),
            })
            .collect();
        let mut rows = vec![0.0; n * width];
        for i in 0..n {
            let own = &tables.parameters[i * parameters..(i + 1) * parameters];
            rows[i * width..i * width + parameters].copy_from_slice(own);
        }
        let formulas = tables.values.iter().map(|v| &v.formula).chain(energies.iter().map(|e| &e.formula));
        let slots = formulas.map(Formula::slots).max().unwrap_or(0);
        CustomGbTerm {
            parameters,
            width,
            cutoff: tables.cutoff.unwrap_or(f64::INFINITY),
            first,
            others,
            energies,
            rows,
            by_value: vec![0.0; n * names.len()],
            buffer: vec![0.0; slots],
            slopes: vec![0.0; 1 + 2 * names.len()],
        }
    }

    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        self.values(x);
        self.by_value.fill(0.0);
        let mut energy = 0.0;
        for k in 0..self.energies.len() {
            energy += match self.energies[k].scope {
                GbScope::Particle => self.single(k),
                _ => self.pairs(k, x, forces),
            };
        }
        self.chain(x, forces);
        energy
    }

    /// All values of all particles.
    fn values(&mut self, x: &[Vec3<f64>]) {
        let Some(first) = &self.first else { return };
        let (p, w) = (self.parameters, self.width);
        for i in 0..x.len() {
            self.rows[i * w + p..(i + 1) * w].fill(0.0);
        }
        for i in 0..x.len() {
            for j in first.exclusions.partners(i).flatten() {
                let (r, _) = distance(x, [i, j]);
                if r >= self.cutoff {
                    continue;
                }
                self.buffer[0] = r;
                for [i, j] in [[i, j], [j, i]] {
                    self.buffer[1..1 + p].copy_from_slice(&self.rows[i * w..i * w + p]);
                    self.buffer[1 + p..1 + 2 * p].copy_from_slice(&self.rows[j * w..j * w + p]);
                    self.rows[i * w + p] += first.formula.value(&mut self.buffer);
                }
            }
        }
        for i in 0..x.len() {
            for (k, other) in self.others.iter().enumerate() {
                let known = p + 1 + k;
                self.buffer[..known].copy_from_slice(&self.rows[i * w..i * w + known]);
                self.rows[i * w + known] = other.formula.value(&mut self.buffer);
            }
        }
    }

    /// An energy of single particles; adds to ∂E/∂V.
    fn single(&mut self, k: usize) -> f64 {
        let (w, v) = (self.width, self.width - self.parameters);
        let mut energy = 0.0;
        for (row, by_value) in self.rows.chunks(w.max(1)).zip(self.by_value.chunks_mut(v.max(1))) {
            self.buffer[..w].copy_from_slice(row);
            energy += self.energies[k].value(&mut self.buffer, &mut self.slopes);
            by_value.iter_mut().zip(&self.slopes).for_each(|(sum, slope)| *sum += slope);
        }
        energy
    }

    /// An energy of pairs; adds to ∂E/∂V and to the forces at constant V.
    fn pairs(&mut self, k: usize, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let (w, v) = (self.width, self.width - self.parameters);
        let term = &self.energies[k];
        let mut energy = 0.0;
        for i in 0..x.len() {
            for j in term.exclusions.partners(i).flatten() {
                let (r, gradient) = distance(x, [i, j]);
                if r >= self.cutoff {
                    continue;
                }
                self.buffer[0] = r;
                self.buffer[1..1 + w].copy_from_slice(&self.rows[i * w..(i + 1) * w]);
                self.buffer[1 + w..1 + 2 * w].copy_from_slice(&self.rows[j * w..(j + 1) * w]);
                energy += term.value(&mut self.buffer, &mut self.slopes);
                for l in 0..v {
                    self.by_value[i * v + l] += self.slopes[1 + l];
                    self.by_value[j * v + l] += self.slopes[1 + v + l];
                }
                let force = gradient.scale(-self.slopes[0]);
                forces[i] -= force;
                forces[j] += force;
            }
        }
        energy
    }

    /// Forces through the values.
    fn chain(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) {
        let (p, w) = (self.parameters, self.width);
        let v = w - p;
        let Some(first) = &self.first else { return };
        for i in 0..x.len() {
            for (k, other) in self.others.iter().enumerate().rev() {
                let known = p + 1 + k;
                self.buffer[..known].copy_from_slice(&self.rows[i * w..i * w + known]);
                other.value(&mut self.buffer, &mut self.slopes);
                let by_value = self.by_value[i * v + 1 + k];
                for l in 0..=k {
                    self.by_value[i * v + l] += by_value * self.slopes[l];
                }
            }
        }
        for i in 0..x.len() {
            for j in first.exclusions.partners(i).flatten() {
                let (r, gradient) = distance(x, [i, j]);
                if r >= self.cutoff {
                    continue;
                }
                self.buffer[0] = r;
                let mut by_r = 0.0;
                for [i, j] in [[i, j], [j, i]] {
                    self.buffer[1..1 + p].copy_from_slice(&self.rows[i * w..i * w + p]);
                    self.buffer[1 + p..1 + 2 * p].copy_from_slice(&self.rows[j * w..j * w + p]);
                    let mut slope = [0.0];
                    first.formula.value_and_slopes(&mut self.buffer, &[&first.slopes[0]], &mut slope);
                    by_r += self.by_value[i * v] * slope[0];
                }
                let force = gradient.scale(-by_r);
                forces[i] -= force;
                forces[j] += force;
            }
        }
    }
}
