//! Energy maps of two torsions: tensor products of periodic cubic splines.
//!
//! | symbol | meaning |
//! |---|---|
//! | E | energy at the nodes (2πi/n, 2πj/n), number i + n j |
//! | Eₐ, E_b, E_ab | slopes per step of the splines along a, along b, and of the splines of Eₐ along b |
//! | t, u | fractions of the step in a and in b |

use super::geometry::{push_torsion, torsion};
use phipsi_formats::system::{CmapMap, CmapPair, CmapTorsion, hermite, periodic_slopes};
use phipsi_spatial::Vec3;
use std::f64::consts::TAU;

#[derive(Clone, Debug)]
pub(super) struct Cmap {
    maps: Vec<Map>,
    torsions: Vec<CmapPair>,
}

#[derive(Clone, Debug)]
struct Map {
    n: usize,
    /// E, Eₐ, E_b, E_ab of each node.
    nodes: Vec<[f64; 4]>,
}

impl Map {
    fn new(map: &CmapMap) -> Self {
        let n = map.size;
        let rows = |values: &[f64]| -> Vec<f64> { values.chunks(n).flat_map(periodic_slopes).collect() };
        let columns = |values: &[f64]| -> Vec<f64> {
            let transpose =
                |values: &[f64]| -> Vec<f64> { (0..n * n).map(|k| values[(k % n) * n + k / n]).collect() };
            transpose(&rows(&transpose(values)))
        };
        let along_a = rows(&map.energies);
        let (along_b, mixed) = (columns(&map.energies), columns(&along_a));
        let nodes = (0..n * n).map(|k| [map.energies[k], along_a[k], along_b[k], mixed[k]]).collect();
        Map { n, nodes }
    }

    /// The energy and its slopes in both angles.
    fn value(&self, angles: [f64; 2]) -> (f64, [f64; 2]) {
        let n = self.n;
        let step = TAU / n as f64;
        let place = |angle: f64| {
            let t = angle.rem_euclid(TAU) / step;
            let node = (t as usize).min(n - 1);
            (node, (node + 1) % n, hermite(t - node as f64))
        };
        let ((i0, i1, (a, da)), (j0, j1, (b, db))) = (place(angles[0]), place(angles[1]));
        let (mut energy, mut slopes) = (0.0, [0.0; 2]);
        for (k, i) in [i0, i1].into_iter().enumerate() {
            for (l, j) in [j0, j1].into_iter().enumerate() {
                let [e, e_a, e_b, e_ab] = self.nodes[i + n * j];
                // Weights of values in the first two places, of slopes in the last two.
                let sum = |a: &[f64; 4], b: &[f64; 4]| {
                    (a[k] * e + a[k + 2] * e_a) * b[l] + (a[k] * e_b + a[k + 2] * e_ab) * b[l + 2]
                };
                energy += sum(&a, &b);
                slopes[0] += sum(&da, &b);
                slopes[1] += sum(&a, &db);
            }
        }
        (energy, slopes.map(|slope| slope / step))
    }
}

impl Cmap {
    pub(super) fn new(tables: &CmapTorsion) -> Self {
        Cmap { maps: tables.maps.iter().map(Map::new).collect(), torsions: tables.torsions.clone() }
    }

    pub(super) fn evaluate(&mut self, x: &[Vec3<f64>], forces: &mut [Vec3<f64>]) -> f64 {
        let mut energy = 0.0;
        for CmapPair { map, atoms: [a, b] } in &self.torsions {
            let ((phi_a, gradients_a), (phi_b, gradients_b)) = (torsion(x, *a), torsion(x, *b));
            let (value, slopes) = self.maps[*map].value([phi_a, phi_b]);
            energy += value;
            push_torsion(forces, *a, slopes[0], gradients_a);
            push_torsion(forces, *b, slopes[1], gradients_b);
        }
        energy
    }
}
