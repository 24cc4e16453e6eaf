//! Shape integrals of a finite element model.
//!
//! | symbol | meaning |
//! |---|---|
//! | R_t, R_r | displacements of all nodes by a unit translation and rotation of F |
//! | M_s | the scalar mass matrix, where all directions have the same; else masses lumped at the nodes |
//! | m, d0, M_ww | from R* M R: exact |
//! | S1, M_we(0), M_ee | R_t* M Ψ, R_r* M Ψ, Ψ* M Ψ: exact |
//! | E_l, S_lm | Ψ_a* M_s s0, Ψ_a* M_s Ψ_b; what they lack of the exact ones is in C_r and M_r |

use super::{CraigBampton, difference};
use crate::flexible::{ShapeIntegrals, SymmetricMatrix};
use nalgebra::DMatrix;

impl CraigBampton {
    /// Rigid motions of all nodes: three translations, three rotations about F.
    pub(super) fn rigid_motions(&self, width: usize) -> DMatrix<f64> {
        let mut rigid = DMatrix::zeros(self.mass.size(), 6);
        for (k, &x) in self.positions.iter().enumerate() {
            let s = difference(x, self.origin());
            for a in 0..3 {
                rigid[(k * width + a, a)] = 1.0;
                let turned = cross(unit(a), s);
                (0..3).for_each(|r| rigid[(k * width + r, 3 + a)] = turned[r]);
                if width == 6 {
                    rigid[(k * width + 3 + a, 3 + a)] = 1.0;
                }
            }
        }
        rigid
    }

    /// Integrals of the shapes, what lumping lacks, and whether masses were lumped.
    pub(super) fn integrals(&self, width: usize, shapes: &DMatrix<f64>) -> (ShapeIntegrals, f64, bool) {
        let (nodes, n, origin) = (self.positions.len(), shapes.ncols(), self.origin());
        let at: Vec<[f64; 3]> = self.positions.iter().map(|&x| difference(x, origin)).collect();
        let rigid = self.rigid_motions(width);
        let weighted = self.mass.times(&rigid);
        let rigid_mass = rigid.transpose() * &weighted;
        let coupling = weighted.transpose() * shapes;
        let modal = self.reduced(&self.mass, shapes);
        let (scalar, lumped) = match self.scalar_mass(width) {
            Some(scalar) => (scalar, false),
            None => (self.lumped_mass(width), true),
        };
        let direction = |a: usize| DMatrix::from_fn(nodes, n, |k, l| shapes[(k * width + a, l)]);
        let place = DMatrix::from_fn(nodes, 3, |k, a| at[k][a]);
        let displacement = [0, 1, 2].map(direction);
        let heavy = [0, 1, 2].map(|a| scalar.times(&displacement[a]));
        // Products of all shapes, direction by direction.
        let product = [0, 1, 2].map(|a| [0, 1, 2].map(|b| heavy[a].transpose() * &displacement[b]));
        let mut sum = ShapeIntegrals::zero(n);
        sum.mass = rigid_mass[(0, 0)];
        // R_t* M R_r = −d0~: the moment of the mass about F.
        sum.first_moment = [rigid_mass[(1, 5)], rigid_mass[(2, 3)], rigid_mass[(0, 4)]];
        let second = place.transpose() * scalar.times(&place);
        let trace = second.trace();
        for i in 0..3 {
            for j in 0..3 {
                sum.second_moment[i][j] = second[(i, j)];
                let rest = if i == j { trace } else { 0.0 };
                sum.rotary[i][j] = rigid_mass[(3 + i, 3 + j)] - rest + second[(i, j)];
            }
        }
        let mut lumping = 0.0f64;
        for l in 0..n {
            for a in 0..3 {
                sum.displacement[l][a] = coupling[(a, l)];
                for b in 0..3 {
                    sum.moment[l][a][b] = heavy[a].column(l).dot(&place.column(b));
                }
            }
            // What M_we(0) has beyond Σ s0 × ψ is rotary; for lumped masses also what lumping lacks.
            let e = &sum.moment[l];
            let axial = [e[2][1] - e[1][2], e[0][2] - e[2][0], e[1][0] - e[0][1]];
            sum.rotary_coupling[l] = [0, 1, 2].map(|a| coupling[(3 + a, l)] - axial[a]);
            for k in 0..n {
                let mut trace = 0.0;
                for a in 0..3 {
                    for b in 0..3 {
                        sum.product[l * n + k][a][b] = product[a][b][(l, k)];
                    }
                    trace += product[a][a][(l, k)];
                }
                sum.rotary_modal[l * n + k] = modal[(l, k)] - trace;
                lumping = lumping.max((modal[(l, k)] - trace).abs());
            }
        }
        (sum, lumping, lumped)
    }

    /// The mass matrix of one direction, if all three have the same and none is coupled with another or with rotations.
    fn scalar_mass(&self, width: usize) -> Option<SymmetricMatrix> {
        if width != 3 {
            return None;
        }
        let directions = [0, 1, 2].map(|a| {
            let rows: Vec<usize> = (0..self.positions.len()).map(|k| 3 * k + a).collect();
            self.mass.principal(&rows)
        });
        let largest = self.mass.entries().fold(0.0f64, |most, x| most.max(x.2.abs()));
        let slack = 1e-12 * largest;
        let coupled = self.mass.entries().any(|(i, j, a)| i % 3 != j % 3 && a.abs() > slack);
        let [x, y, z] = &directions;
        let same = |y: &SymmetricMatrix| {
            x.entries().count() == y.entries().count()
                && x.entries()
                    .zip(y.entries())
                    .all(|(a, b)| (a.0, a.1) == (b.0, b.1) && (a.2 - b.2).abs() <= slack)
        };
        (!coupled && same(y) && same(z)).then(|| x.clone())
    }
    /// Sums of rows over translations along x: the share of each node.
    fn lumped_mass(&self, width: usize) -> SymmetricMatrix {
        let nodes = self.positions.len();
        let along = DMatrix::from_fn(self.mass.size(), 1, |i, _| if i % width == 0 { 1.0 } else { 0.0 });
        let sums = self.mass.times(&along);
        SymmetricMatrix::diagonal((0..nodes).map(|k| sums[k * width]))
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(i: usize) -> [f64; 3] {
    let mut unit = [0.0; 3];
    unit[i] = 1.0;
    unit
}
