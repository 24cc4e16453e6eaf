//! Craig–Bampton reduction of a finite element model: modes with the interfaces clamped, and one static shape for every degree
//! of freedom of an outboard interface.
//!
//! | symbol | meaning |
//! |---|---|
//! | i, t | inner degrees of freedom, those of outboard interface nodes; the inboard node is clamped and carries F |
//! | Φ_i | K_ii Φ_i = M_ii Φ_i ω², the lowest |
//! | Ψ | [[Φ_i, −K_ii⁻¹ K_it], [0, I]], then turned to M_ee = I, K = diag λ |
//! | R_t, R_r | displacements of all nodes by a unit translation and rotation of F |
//! | M_s | the scalar mass matrix, where all directions have the same |

use super::{FlexibleBody, Node, ShapeIntegrals};
use crate::violation::{ModelErrors, Subject, Violation};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// A node of the elements that others attach to.
#[derive(Clone, Debug, PartialEq)]
pub struct InterfaceNode {
    /// Its name in the model.
    pub name: String,
    /// Its index among the nodes of the elements.
    pub index: usize,
}

/// A finite element model, dense, as a program writes it.
#[derive(Clone, Debug, PartialEq)]
pub struct CraigBampton {
    /// Mass matrix, node after node, each with x, y, z and, if there are six, rotations about x, y, z. kg, kg·m, kg·m².
    pub mass: DMatrix<f64>,
    /// Stiffness matrix, likewise.
    pub stiffness: DMatrix<f64>,
    /// Where the nodes are, m, in axes along F's.
    pub positions: Vec<[f64; 3]>,
    /// The node that carries F: the body's joint holds it.
    pub inboard: usize,
    /// Nodes at which other bodies attach.
    pub outboard: Vec<InterfaceNode>,
    /// How many modes with clamped interfaces to keep.
    pub modes: usize,
}

/// What an import found.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportReport {
    /// √λ of every mode, rad/s.
    pub frequencies: Vec<f64>,
    /// Largest |Σ_a S_aa − M_ee|: what products of shapes lack if masses are lumped at nodes. Zero for solid elements.
    pub lumping: f64,
    /// True if products of shapes were taken with lumped masses.
    pub lumped: bool,
}

impl CraigBampton {
    /// Reduces the model.
    ///
    /// # Computes
    /// Mass, first and second moments, S1, M_we(0) and M_ee from the mass matrix and rigid motions, without further
    /// approximation; S_lm and the symmetric part of E_l as Ψ_a* M_s Ψ_b where all directions have one scalar mass matrix
    /// (solid elements), else with masses lumped at the nodes (the rows' sums), which [`ImportReport::lumping`] measures.
    ///
    /// # Cost
    /// Cubic in the number of degrees of freedom: dense factors.
    ///
    /// # Errors
    /// [`ModelErrors`]: matrices that are not square, finite and of the size of the nodes; nodes that do not exist; a stiffness
    /// that leaves a motion free with the inboard node clamped; a mode with λ ≤ 0.
    pub fn reduce(&self, name: &str) -> Result<(FlexibleBody, ImportReport), ModelErrors> {
        let error = |found: String, required: &str, remedy: &str| {
            ModelErrors(vec![Violation::error(Subject::Body(name.into()), found, required, remedy)])
        };
        let width = self.check(name)?;
        let outboard: Vec<usize> = self.outboard.iter().map(|node| node.index).collect();
        let dofs = |node: usize| node * width..(node + 1) * width;
        let t: Vec<usize> = outboard.iter().flat_map(|&node| dofs(node)).collect();
        let is_inner = |node: &usize| *node != self.inboard && !outboard.contains(node);
        let i: Vec<usize> = (0..self.positions.len()).filter(is_inner).flat_map(dofs).collect();
        let pick = |m: &DMatrix<f64>, rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |r, c| m[(rows[r], columns[c])])
        };
        let stiff = pick(&self.stiffness, &i, &i).cholesky().ok_or_else(|| {
            error(
                "the stiffness of the inner nodes is not positive definite".into(),
                "a body without free motion once its interfaces are clamped",
                "connect every node with elements",
            )
        })?;
        let kept = self.modes.min(i.len());
        let inner_mass = pick(&self.mass, &i, &i);
        let phi = lowest(&stiff, &inner_mass, kept);
        let constraint = -stiff.solve(&pick(&self.stiffness, &i, &t));
        let n = kept + t.len();
        if n == 0 {
            let remedy = "name an outboard node, or give a rigid body";
            return Err(error("no modes and no outboard interface".into(), "at least one shape", remedy));
        }
        let mut shapes = DMatrix::zeros(self.mass.nrows(), n);
        for (r, &row) in i.iter().enumerate() {
            for c in 0..n {
                shapes[(row, c)] = if c < kept { phi[(r, c)] } else { constraint[(r, c - kept)] };
            }
        }
        for (c, &row) in t.iter().enumerate() {
            shapes[(row, kept + c)] = 1.0;
        }
        // To M_ee = I and K = diag λ.
        let reduced_mass = shapes.transpose() * &self.mass * &shapes;
        let reduced_stiffness = shapes.transpose() * &self.stiffness * &shapes;
        let factor = reduced_mass.cholesky().ok_or_else(|| {
            error(
                "the reduced mass matrix is not positive definite".into(),
                "mass behind every mode",
                "keep fewer modes, or give the interface nodes mass",
            )
        })?;
        let l = factor.l();
        let left = solve_lower(&l, &reduced_stiffness);
        let standard = symmetric(&solve_lower(&l, &left.transpose()));
        let eigen = SymmetricEigen::new(standard);
        let order = sorted(&eigen.eigenvalues);
        let mut turn = DMatrix::zeros(n, n);
        let mut lambda = Vec::with_capacity(n);
        for (c, &from) in order.iter().enumerate() {
            lambda.push(eigen.eigenvalues[from]);
            turn.set_column(c, &eigen.eigenvectors.column(from));
        }
        if let Some(mode) = lambda.iter().position(|x| x.is_nan() || *x <= 0.0) {
            return Err(error(
                format!("mode {} has λ = {:e}", mode + 1, lambda[mode]),
                "λ > 0 for every mode",
                "the elements leave a free motion, which the body's joint is to have",
            ));
        }
        let back = l.transpose().solve_upper_triangular(&turn).unwrap_or(turn);
        let shapes = shapes * back;
        let (integrals, lumping, lumped) = self.integrals(width, &shapes);
        let stiffness = DMatrix::from_diagonal(&DVector::from_vec(lambda.clone()));
        let origin = self.positions[self.inboard];
        let nodes = self.outboard.iter().map(|node| {
            let first = node.index * width;
            let column = |c: usize, from: usize| [0, 1, 2].map(|a| shapes[(first + from + a, c)]);
            Node {
                name: node.name.clone(),
                position: difference(self.positions[node.index], origin),
                displacement: (0..n).map(|c| column(c, 0)).collect(),
                rotation: (0..n).map(|c| if width == 6 { column(c, 3) } else { [0.0; 3] }).collect(),
                quadratic: None,
            }
        });
        let body = FlexibleBody::new(integrals, stiffness.as_slice().to_vec(), nodes.collect());
        let frequencies = lambda.iter().map(|x| x.sqrt()).collect();
        Ok((body, ImportReport { frequencies, lumping, lumped }))
    }

    /// Degrees of freedom of a node.
    fn check(&self, name: &str) -> Result<usize, ModelErrors> {
        let mut found = Vec::new();
        let mut error = |what: String, required: &str, remedy: &str| {
            found.push(Violation::error(Subject::Body(name.into()), what, required, remedy));
        };
        let nodes = self.positions.len();
        let size = self.mass.nrows();
        let width = if size == 6 * nodes { 6 } else { 3 };
        if nodes == 0 || size != width * nodes {
            let what = format!("{size} rows of the mass matrix for {nodes} nodes");
            error(
                what,
                "three or six rows for every node",
                "give positions of all nodes in the matrix's order",
            );
        }
        for (what, matrix) in [("mass", &self.mass), ("stiffness", &self.stiffness)] {
            if matrix.nrows() != size || matrix.ncols() != size {
                let what = format!("{what} matrix of {}×{}", matrix.nrows(), matrix.ncols());
                error(what, &format!("{size}×{size}"), "give both matrices for the same degrees of freedom");
            } else if matrix.iter().any(|x| !x.is_finite()) {
                error(
                    format!("{what} matrix with an entry that is not finite"),
                    "finite numbers",
                    "correct it",
                );
            }
        }
        if self.positions.iter().flatten().any(|x| !x.is_finite()) {
            error("a node's position is not finite".into(), "finite numbers", "correct it");
        }
        let mut seen = vec![self.inboard];
        for index in std::iter::once(self.inboard).chain(self.outboard.iter().map(|n| n.index)) {
            if index >= nodes {
                error(format!("interface node {index}"), &format!("an index below {nodes}"), "correct it");
            }
        }
        for node in &self.outboard {
            if seen.contains(&node.index) {
                let what = format!("node {} is an interface twice", node.index);
                error(what, "different nodes", "let several joints name the same node");
            }
            seen.push(node.index);
        }
        if found.is_empty() { Ok(width) } else { Err(ModelErrors(found)) }
    }

    /// Integrals of the shapes, what lumping lacks, and whether masses were lumped.
    fn integrals(&self, width: usize, shapes: &DMatrix<f64>) -> (ShapeIntegrals, f64, bool) {
        let (nodes, n, origin) = (self.positions.len(), shapes.ncols(), self.positions[self.inboard]);
        let at: Vec<[f64; 3]> = self.positions.iter().map(|&x| difference(x, origin)).collect();
        // Rigid motions of all nodes: three translations, three rotations about F.
        let mut rigid = DMatrix::zeros(self.mass.nrows(), 6);
        for (k, s) in at.iter().enumerate() {
            for a in 0..3 {
                rigid[(k * width + a, a)] = 1.0;
                let turned = cross(unit(a), *s);
                (0..3).for_each(|r| rigid[(k * width + r, 3 + a)] = turned[r]);
                if width == 6 {
                    rigid[(k * width + 3 + a, 3 + a)] = 1.0;
                }
            }
        }
        let weighted = &self.mass * &rigid;
        let rigid_mass = rigid.transpose() * &weighted;
        let coupling = weighted.transpose() * shapes;
        let modal = shapes.transpose() * &self.mass * shapes;
        let (scalar, lumped) = match self.scalar_mass(width) {
            Some(scalar) => (scalar, false),
            None => (self.lumped_mass(width), true),
        };
        let direction = |a: usize| DMatrix::from_fn(nodes, n, |k, l| shapes[(k * width + a, l)]);
        let place = DMatrix::from_fn(nodes, 3, |k, a| at[k][a]);
        let displacement = [0, 1, 2].map(direction);
        let heavy = [0, 1, 2].map(|a| &scalar * &displacement[a]);
        let mut sum = ShapeIntegrals::zero(n);
        sum.mass = rigid_mass[(0, 0)];
        // R_t* M R_r = −d0~: the moment of the mass about F.
        sum.first_moment = [rigid_mass[(1, 5)], rigid_mass[(2, 3)], rigid_mass[(0, 4)]];
        let second = place.transpose() * &scalar * &place;
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
                        let product = heavy[a].column(l).dot(&displacement[b].column(k));
                        sum.product[l * n + k][a][b] = product;
                        trace += if a == b { product } else { 0.0 };
                    }
                }
                sum.rotary_modal[l * n + k] = modal[(l, k)] - trace;
                lumping = lumping.max((modal[(l, k)] - trace).abs());
            }
        }
        (sum, lumping, lumped)
    }

    /// The mass matrix of one direction, if all three have the same and none is coupled with another or with rotations.
    fn scalar_mass(&self, width: usize) -> Option<DMatrix<f64>> {
        if width != 3 {
            return None;
        }
        let nodes = self.positions.len();
        let slack = 1e-12 * self.mass.amax();
        let scalar = DMatrix::from_fn(nodes, nodes, |k, l| self.mass[(3 * k, 3 * l)]);
        let same = |k: usize, l: usize| {
            (0..3).all(|a| {
                (0..3).all(|b| {
                    let want = if a == b { scalar[(k, l)] } else { 0.0 };
                    (self.mass[(3 * k + a, 3 * l + b)] - want).abs() <= slack
                })
            })
        };
        let all = (0..nodes).all(|k| (0..nodes).all(|l| same(k, l)));
        all.then_some(scalar)
    }
    /// Sums of rows over translations along x: the share of each node.
    fn lumped_mass(&self, width: usize) -> DMatrix<f64> {
        let nodes = self.positions.len();
        let share = |k: usize| (0..nodes).map(|l| self.mass[(k * width, l * width)]).sum::<f64>();
        DMatrix::from_diagonal(&DVector::from_fn(nodes, |k, _| share(k)))
    }
}

/// Φ with K Φ = M Φ ω², the `count` lowest, by the largest 1/ω² of c⁻¹ M c⁻* with K = c c*.
fn lowest(stiff: &nalgebra::Cholesky<f64, nalgebra::Dyn>, mass: &DMatrix<f64>, count: usize) -> DMatrix<f64> {
    if count == 0 {
        return DMatrix::zeros(mass.nrows(), 0);
    }
    let c = stiff.l();
    let left = solve_lower(&c, mass);
    let standard = symmetric(&solve_lower(&c, &left.transpose()));
    let eigen = SymmetricEigen::new(standard);
    let mut order = sorted(&eigen.eigenvalues);
    order.reverse();
    let mut chosen = DMatrix::zeros(mass.nrows(), count);
    for (column, &from) in order.iter().take(count).enumerate() {
        chosen.set_column(column, &eigen.eigenvectors.column(from));
    }
    c.transpose().solve_upper_triangular(&chosen).unwrap_or(chosen)
}

fn solve_lower(l: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    // The factor of a positive definite matrix has no zero on its diagonal.
    l.solve_lower_triangular(b).unwrap_or_else(|| b.clone())
}

fn symmetric(a: &DMatrix<f64>) -> DMatrix<f64> {
    (a + a.transpose()) * 0.5
}

/// Indices in the order of increasing values.
fn sorted(values: &DVector<f64>) -> Vec<usize> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    order
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(i: usize) -> [f64; 3] {
    let mut unit = [0.0; 3];
    unit[i] = 1.0;
    unit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Beam, MassPoint, Random, Section};

    /// Masses at random places, all connected by springs.
    fn cloud(seed: u64) -> (Vec<f64>, CraigBampton) {
        let mut random = Random::new(seed);
        let count = 6;
        let positions: Vec<[f64; 3]> = (0..count).map(|_| random.vector()).collect();
        let masses: Vec<f64> = (0..count).map(|_| 0.5 + random.uniform()).collect();
        let mut stiffness = DMatrix::zeros(3 * count, 3 * count);
        for k in 0..count {
            for l in 0..k {
                let d = difference(positions[k], positions[l]);
                for a in 0..3 {
                    for b in 0..3 {
                        let x = d[a] * d[b] * (1.0 + (k + l) as f64);
                        stiffness[(3 * k + a, 3 * k + b)] += x;
                        stiffness[(3 * l + a, 3 * l + b)] += x;
                        stiffness[(3 * k + a, 3 * l + b)] -= x;
                        stiffness[(3 * l + a, 3 * k + b)] -= x;
                    }
                }
            }
        }
        // A cloud held at one point only turns about it: a spring of each mass to the ground of F stops that.
        for k in 3..3 * count {
            stiffness[(k, k)] += 0.5;
        }
        let mass = DMatrix::from_fn(3 * count, 3 * count, |i, j| if i == j { masses[i / 3] } else { 0.0 });
        let outboard = (1..count).map(|k| InterfaceNode { name: format!("n{k}"), index: k }).collect();
        (masses, CraigBampton { mass, stiffness, positions, inboard: 0, outboard, modes: 0 })
    }

    /// With every node an interface the shapes are known at all of them: integrals are sums over mass points.
    #[test]
    fn integrals_of_masses_and_springs_are_sums_over_points() {
        for seed in 0..5 {
            let (masses, elements) = cloud(seed);
            let (body, report) = elements.reduce("cloud").unwrap();
            let n = body.modes();
            assert_eq!(n, 15);
            assert!(!report.lumped && report.lumping < 1e-12, "{report:?}");
            let mut points =
                vec![MassPoint { mass: masses[0], position: [0.0; 3], displacement: vec![[0.0; 3]; n] }];
            points.extend(body.nodes.iter().enumerate().map(|(k, node)| MassPoint {
                mass: masses[k + 1],
                position: node.position,
                displacement: node.displacement.clone(),
            }));
            let want = ShapeIntegrals::from_points(n, &points);
            let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
            close(body.integrals.mass, want.mass);
            for a in 0..3 {
                close(body.integrals.first_moment[a], want.first_moment[a]);
                for b in 0..3 {
                    close(body.integrals.second_moment[a][b], want.second_moment[a][b]);
                    close(body.integrals.rotary[a][b], 0.0);
                    for l in 0..n {
                        close(body.integrals.moment[l][a][b], want.moment[l][a][b]);
                        for m in 0..n {
                            let x = l * n + m;
                            close(body.integrals.product[x][a][b], want.product[x][a][b]);
                        }
                    }
                }
                for l in 0..n {
                    close(body.integrals.displacement[l][a], want.displacement[l][a]);
                    close(body.integrals.rotary_coupling[l][a], 0.0);
                }
            }
            let modal = body.integrals.modal_mass();
            for l in 0..n {
                for m in 0..n {
                    close(modal[l * n + m], if l == m { 1.0 } else { 0.0 });
                }
            }
        }
    }

    /// A beam of cubic elements in one plane, with all six degrees of freedom at each node; the others are stiff and heavy.
    fn beam_elements(elements: usize) -> CraigBampton {
        let nodes = elements + 1;
        let h = 1.0 / elements as f64;
        let (mut mass, mut stiffness) =
            (DMatrix::zeros(6 * nodes, 6 * nodes), DMatrix::zeros(6 * nodes, 6 * nodes));
        let m = [
            [156.0, 22.0 * h, 54.0, -13.0 * h],
            [22.0 * h, 4.0 * h * h, 13.0 * h, -3.0 * h * h],
            [54.0, 13.0 * h, 156.0, -22.0 * h],
            [-13.0 * h, -3.0 * h * h, -22.0 * h, 4.0 * h * h],
        ];
        let k = [
            [12.0, 6.0 * h, -12.0, 6.0 * h],
            [6.0 * h, 4.0 * h * h, -6.0 * h, 2.0 * h * h],
            [-12.0, -6.0 * h, 12.0, -6.0 * h],
            [6.0 * h, 2.0 * h * h, -6.0 * h, 4.0 * h * h],
        ];
        for e in 0..elements {
            // Bending along y: y and the rotation about z; along z: z and minus the rotation about y.
            for (moved, turned, sign) in [(1, 5, 1.0), (2, 4, -1.0)] {
                let dofs = [6 * e + moved, 6 * e + turned, 6 * e + 6 + moved, 6 * e + 6 + turned];
                let signs = [1.0, sign, 1.0, sign];
                for i in 0..4 {
                    for j in 0..4 {
                        let s = signs[i] * signs[j];
                        mass[(dofs[i], dofs[j])] += s * m[i][j] * h / 420.0;
                        stiffness[(dofs[i], dofs[j])] += s * k[i][j] / (h * h * h);
                    }
                }
            }
            // Axial and torsion, with a linear shape.
            for (dof, inertia, rigidity) in [(0, 1.0, 1e4), (3, 1e-3, 1e2)] {
                let dofs = [6 * e + dof, 6 * e + 6 + dof];
                for i in 0..2 {
                    for j in 0..2 {
                        let same = if i == j { 1.0 } else { -1.0 };
                        mass[(dofs[i], dofs[j])] += inertia * h * (1.5 + 0.5 * same) / 6.0;
                        stiffness[(dofs[i], dofs[j])] += same * rigidity / h;
                    }
                }
            }
        }
        CraigBampton {
            mass,
            stiffness,
            positions: (0..nodes).map(|k| [k as f64 * h, 0.0, 0.0]).collect(),
            inboard: 0,
            outboard: vec![InterfaceNode { name: "tip".into(), index: elements }],
            modes: 14,
        }
    }

    /// Frequencies and first-order integrals of a beam of elements are those of the beam.
    #[test]
    fn a_beam_of_elements_is_a_beam() {
        let elements = beam_elements(16);
        let (body, report) = elements.reduce("beam").unwrap();
        let roots = crate::flexible::clamped_free_roots(2);
        for (k, root) in roots.iter().enumerate() {
            for plane in 0..2 {
                let found = report.frequencies[2 * k + plane];
                let want = root * root;
                // Cubic elements: (b h)⁴/1440 or so; clamped-interface modes cost less.
                assert!((found / want - 1.0).abs() < 1e-4, "{found} {want}");
            }
        }
        assert!(report.lumped && report.lumping > 1e-6, "{report:?}");
        let section = Section {
            mass_per_length: 1.0,
            bending_stiffness: [1.0; 2],
            torsional_stiffness: 1e2,
            polar_inertia: 1e-3,
            axial_stiffness: 1e4,
        };
        let rigid = Beam::new(1.0, section).build().integrals;
        assert!((body.integrals.mass - rigid.mass).abs() < 1e-13);
        assert!((body.integrals.first_moment[0] - rigid.first_moment[0]).abs() < 1e-13);
        let (a, b) = (body.integrals.undeformed(), rigid.undeformed());
        for i in [0, 3, 5] {
            assert!((a.tensor[i] - b.tensor[i]).abs() < 1e-10, "{:?} {:?}", a.tensor, b.tensor);
        }
        // M_ee and M_we(0) come from the mass matrix, whatever masses are lumped.
        let modal = body.integrals.modal_mass();
        let n = body.modes();
        for l in 0..n {
            for m in 0..n {
                let want = if l == m { 1.0 } else { 0.0 };
                assert!((modal[l * n + m] - want).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn what_is_wrong_is_said() {
        let mut elements = beam_elements(4);
        elements.outboard.push(InterfaceNode { name: "far".into(), index: 99 });
        let said = elements.reduce("beam").unwrap_err().to_string();
        assert!(said.contains("interface node 99") && said.contains("`beam`"), "{said}");
        let mut free = beam_elements(4);
        free.stiffness.fill(0.0);
        let said = free.reduce("beam").unwrap_err().to_string();
        assert!(said.contains("not positive definite"), "{said}");
    }
}
