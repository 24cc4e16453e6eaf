//! Craig–Bampton reduction of a finite element model: modes with the interfaces clamped, and one static shape for every degree
//! of freedom of an outboard interface.
//!
//! | symbol | meaning |
//! |---|---|
//! | i, t | inner degrees of freedom, those of outboard interface nodes; inboard nodes are clamped and carry F |
//! | Φ_i | K_ii Φ_i = M_ii Φ_i ω², the lowest |
//! | Ψ | [[Φ_i, −K_ii⁻¹ K_it], [0, I]], then turned to M_ee = I, K = diag λ |
//! | R_t, R_r | displacements of all nodes by a unit translation and rotation of F |
//! | M_s | the scalar mass matrix, where all directions have the same |

mod integrals;

use super::clamped_modes::{ClampedModes, Factor};
use super::{FlexibleBody, Node, SymmetricMatrix};
use crate::violation::{ModelErrors, Subject, Violation};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use std::fmt;

/// Largest relative force of a rigid motion: above it the elements hang on something else than their interfaces.
const LARGEST_RIGID_FORCE: f64 = 1e-3;

/// Largest magnitude of a number: products of four are finite.
const LARGEST: f64 = 1e60;

/// A node of the elements that others attach to.
#[derive(Clone, Debug, PartialEq)]
pub struct InterfaceNode {
    /// Its name in the model.
    pub name: String,
    /// Its index among the nodes of the elements.
    pub index: usize,
}

/// Which shapes the inner nodes keep.
#[derive(Clone, Debug, PartialEq)]
pub enum KeptModes {
    /// As many eigenmodes with all interfaces clamped, the lowest, and a static shape for every degree of freedom of an
    /// outboard interface.
    Lowest(usize),
    /// These shapes, one a column, with a row for every degree of freedom: from a program that has reduced the model itself.
    /// They are zero at the inboard nodes.
    Given(DMatrix<f64>),
}

impl KeptModes {
    /// Given shapes from numbers by rows: a row for every degree of freedom, `columns` modes.
    pub fn given(columns: usize, by_rows: &[f64]) -> Self {
        let rows = by_rows.len() / columns.max(1);
        KeptModes::Given(DMatrix::from_row_slice(rows, columns, &by_rows[..rows * columns]))
    }
}

/// A finite element model, as a program writes it.
///
/// # Example
/// ```
/// use phipsi_model::{CraigBampton, InterfaceNode, KeptModes, SymmetricMatrix};
/// // Two masses on springs along x, y and z in a row; the first node is held.
/// let chain = |k: [f64; 3]| (0..3).flat_map(move |a| [(3 + a, 3 + a, k[0]), (6 + a, 6 + a, k[1]), (6 + a, 3 + a, k[2])]);
/// let held = |k: [f64; 2]| (0..3).flat_map(move |a| [(a, a, k[0]), (3 + a, a, k[1])]);
/// let elements = CraigBampton {
///     mass: SymmetricMatrix::from_triangle(9, chain([1.0, 1.0, 0.0]))?,
///     stiffness: SymmetricMatrix::from_triangle(9, chain([2.0, 1.0, -1.0]).chain(held([1.0, -1.0])))?,
///     positions: vec![[0.0; 3]; 3],
///     inboard: vec![0],
///     outboard: vec![InterfaceNode { name: "tip".into(), index: 2 }],
///     modes: KeptModes::Lowest(3),
/// };
/// let (body, report) = elements.reduce("chain")?;
/// assert_eq!(body.modes(), 6);
/// let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
/// assert!((report.frequencies[0] - golden).abs() < 1e-14);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct CraigBampton {
    /// Mass matrix, node after node, each with x, y, z and, if there are six, rotations about x, y, z. kg, kg·m, kg·m².
    pub mass: SymmetricMatrix,
    /// Stiffness matrix, likewise, of the free elements: without supports.
    pub stiffness: SymmetricMatrix,
    /// Where the nodes are, m, in axes along F's.
    pub positions: Vec<[f64; 3]>,
    /// The nodes that the body's joint holds; the origin of F is at the first. One node of six degrees of freedom, or at least
    /// three of three that are not on a line.
    pub inboard: Vec<usize>,
    /// Nodes at which other bodies attach.
    pub outboard: Vec<InterfaceNode>,
    /// Which shapes to keep.
    pub modes: KeptModes,
}

/// What an import found and what it left out.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportReport {
    /// √λ of every mode, rad/s.
    pub frequencies: Vec<f64>,
    /// Frequencies with all interfaces clamped of the modes that were kept, rad/s; none if shapes were given.
    pub clamped: Vec<f64>,
    /// The next of them, which was left out with all above it; `None` if there is none, or shapes were given.
    pub first_left_out: Option<f64>,
    /// Degrees of freedom of the elements, and those of inner nodes.
    pub degrees_of_freedom: [usize; 2],
    /// Mass, kg.
    pub mass: f64,
    /// Largest force that a rigid motion of all nodes makes, relative to its terms: rounding where the elements are free.
    pub rigid_force: f64,
    /// Largest |Σ_a S_aa − M_ee|: what products of shapes lack if masses are lumped at nodes. Zero for solid elements.
    pub lumping: f64,
    /// True if products of shapes were taken with lumped masses.
    pub lumped: bool,
}

impl fmt::Display for ImportReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [all, inner] = self.degrees_of_freedom;
        let modes = self.frequencies.len();
        write!(f, "{all} degrees of freedom reduced to {modes} modes")?;
        if let (Some(low), Some(high)) = (self.frequencies.first(), self.frequencies.last()) {
            write!(f, " of {low:.6e} to {high:.6e} rad/s")?;
        }
        write!(f, ", mass {:.9} kg", self.mass)?;
        if let Some(next) = self.first_left_out {
            let left = inner - self.clamped.len();
            write!(f, "; {left} modes with clamped interfaces left out, from {next:.4e} rad/s on")?;
        }
        if self.lumped {
            write!(
                f,
                "; products of shapes with lumped masses, which changes M_ee by {:.1e} of 1",
                self.lumping
            )?;
        }
        write!(f, "; a rigid motion strains the elements by {:.1e}, relative", self.rigid_force)
    }
}

/// Shapes of all degrees of freedom, and what is known of the eigenmodes among them.
struct Shapes {
    psi: DMatrix<f64>,
    clamped: Vec<f64>,
    first_left_out: Option<f64>,
    inner: usize,
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
    /// One sparse Cholesky factor of K_ii, a solution with it for every static shape, and some twenty for every mode.
    ///
    /// # Accuracy
    /// Modes by subspace iteration until frequencies stand to 1e-12; frequencies of the reduced body are Rayleigh–Ritz values:
    /// not below those of the elements.
    ///
    /// # Errors
    /// [`ModelErrors`]: matrices that have not the size of the nodes; nodes that do not exist; a stiffness that leaves a motion
    /// free with the inboard nodes clamped, or that holds a rigid motion; a mode with λ ≤ 0.
    pub fn reduce(&self, name: &str) -> Result<(FlexibleBody, ImportReport), ModelErrors> {
        let width = self.check(name)?;
        let shapes = self.shapes(name, width)?;
        let n = shapes.psi.ncols();
        // To M_ee = I and K = diag λ.
        let factor = self.reduced(&self.mass, &shapes.psi).cholesky().ok_or_else(|| {
            error(
                name,
                "the reduced mass matrix is not positive definite",
                "mass behind every mode",
                "keep fewer modes, or give the interface nodes mass",
            )
        })?;
        let l = factor.l();
        let left = solve_lower(&l, &self.reduced(&self.stiffness, &shapes.psi));
        let eigen = SymmetricEigen::new(symmetric(&solve_lower(&l, &left.transpose())));
        let order = sorted(&eigen.eigenvalues);
        let mut turn = DMatrix::zeros(n, n);
        let mut lambda = Vec::with_capacity(n);
        for (c, &from) in order.iter().enumerate() {
            lambda.push(eigen.eigenvalues[from]);
            turn.set_column(c, &eigen.eigenvectors.column(from));
        }
        let highest = lambda.last().copied().unwrap_or(0.0);
        // What is left of a free motion is rounding of the highest.
        let least = 8.0 * n as f64 * f64::EPSILON * highest;
        if let Some(mode) = lambda.iter().position(|x| x.is_nan() || *x <= least) {
            let found = format!("mode {} has λ = {:e}", mode + 1, lambda[mode]);
            let remedy = "the elements leave a free motion, which the body's joint is to have; hold three nodes where they have \
                          no rotations";
            return Err(error(name, found, "λ > 0 for every mode", remedy));
        }
        let back = l.transpose().solve_upper_triangular(&turn).unwrap_or(turn);
        let psi = shapes.psi * back;
        let (rigid_force, place) = self.stiffness.relative_product(&self.rigid_motions(width));
        if rigid_force > LARGEST_RIGID_FORCE {
            let at = format!("node {}, degree of freedom {}", place / width, place % width);
            let found = format!("a rigid motion makes a relative force of {rigid_force:.1e} at {at}");
            let remedy =
                "write the matrices of the free elements, without supports, in the order of the nodes";
            return Err(error(name, found, format!("at most {LARGEST_RIGID_FORCE:e}"), remedy));
        }
        let (integrals, lumping, lumped) = self.integrals(width, &psi);
        let mass = integrals.mass;
        let stiffness = DMatrix::from_diagonal(&DVector::from_vec(lambda.clone()));
        let nodes = self.nodes(width, &psi);
        let body = FlexibleBody::new(integrals, stiffness.as_slice().to_vec(), nodes);
        let report = ImportReport {
            frequencies: lambda.iter().map(|x| x.sqrt()).collect(),
            clamped: shapes.clamped,
            first_left_out: shapes.first_left_out,
            degrees_of_freedom: [self.mass.size(), shapes.inner],
            mass,
            rigid_force,
            lumping,
            lumped,
        };
        Ok((body, report))
    }

    /// Ψ* A Ψ.
    fn reduced(&self, matrix: &SymmetricMatrix, psi: &DMatrix<f64>) -> DMatrix<f64> {
        symmetric(&(psi.transpose() * matrix.times(psi)))
    }

    /// Ψ before it is turned.
    fn shapes(&self, name: &str, width: usize) -> Result<Shapes, ModelErrors> {
        let outboard: Vec<usize> = self.outboard.iter().map(|node| node.index).collect();
        let dofs = |node: usize| node * width..(node + 1) * width;
        let t: Vec<usize> = outboard.iter().flat_map(|&node| dofs(node)).collect();
        let is_inner = |node: &usize| !self.inboard.contains(node) && !outboard.contains(node);
        let i: Vec<usize> = (0..self.positions.len()).filter(is_inner).flat_map(dofs).collect();
        let count = match &self.modes {
            KeptModes::Given(psi) => {
                return Ok(Shapes {
                    psi: psi.clone(),
                    clamped: Vec::new(),
                    first_left_out: None,
                    inner: i.len(),
                });
            }
            KeptModes::Lowest(count) => (*count).min(i.len()),
        };
        let n = count + t.len();
        if n == 0 {
            let remedy = "name an outboard node, or give a rigid body";
            return Err(error(name, "no modes and no outboard interface", "at least one shape", remedy));
        }
        let mut psi = DMatrix::zeros(self.mass.size(), n);
        let mut found = ClampedModes::default();
        if !i.is_empty() {
            let factor = Factor::new(&self.stiffness.principal(&i)).ok_or_else(|| {
                let loose = i.iter().find(|&&x| !self.has_stiffness(x));
                let place = loose.map_or(String::new(), |x| {
                    format!(": node {}, degree of freedom {}, has none", x / width, x % width)
                });
                error(
                    name,
                    format!("the stiffness of the inner nodes is not positive definite{place}"),
                    "a body without free motion once its interfaces are clamped",
                    "connect every node with elements",
                )
            })?;
            found = ClampedModes::lowest(&factor, &self.mass.principal(&i), count).map_err(|rank| {
                error(
                    name,
                    format!("{count} modes with clamped interfaces, but inner nodes have mass for {rank}"),
                    "mass behind every mode",
                    format!("keep {rank} modes, or give the inner nodes mass"),
                )
            })?;
            let mut constraint = self.stiffness.block(&i, &t);
            factor.solve(&mut constraint);
            for (r, &row) in i.iter().enumerate() {
                for c in 0..n {
                    psi[(row, c)] =
                        if c < count { found.shapes[(r, c)] } else { -constraint[(r, c - count)] };
                }
            }
        }
        for (c, &row) in t.iter().enumerate() {
            psi[(row, count + c)] = 1.0;
        }
        Ok(Shapes { psi, clamped: found.frequencies, first_left_out: found.next, inner: i.len() })
    }

    fn has_stiffness(&self, dof: usize) -> bool {
        self.stiffness.entries().any(|(i, j, a)| i == dof && j == dof && a > 0.0)
    }

    /// The outboard nodes as nodes of the body.
    fn nodes(&self, width: usize, psi: &DMatrix<f64>) -> Vec<Node> {
        let (n, origin) = (psi.ncols(), self.origin());
        let node = |node: &InterfaceNode| {
            let first = node.index * width;
            let column = |c: usize, from: usize| [0, 1, 2].map(|a| psi[(first + from + a, c)]);
            Node {
                name: node.name.clone(),
                position: difference(self.positions[node.index], origin),
                displacement: (0..n).map(|c| column(c, 0)).collect(),
                rotation: (0..n).map(|c| if width == 6 { column(c, 3) } else { [0.0; 3] }).collect(),
                quadratic: None,
            }
        };
        self.outboard.iter().map(node).collect()
    }

    fn origin(&self) -> [f64; 3] {
        self.inboard.first().map_or([0.0; 3], |&k| self.positions[k])
    }

    /// Degrees of freedom of a node.
    fn check(&self, name: &str) -> Result<usize, ModelErrors> {
        let mut found = Vec::new();
        let mut error = |what: String, required: &str, remedy: &str| {
            found.push(Violation::error(Subject::Body(name.into()), what, required, remedy));
        };
        let nodes = self.positions.len();
        let size = self.mass.size();
        let width = if size == 6 * nodes { 6 } else { 3 };
        if nodes == 0 || size != width * nodes {
            let what = format!("{size} rows of the mass matrix for {nodes} nodes");
            let remedy = "give positions of all nodes in the matrix's order";
            error(what, "three or six rows for every node", remedy);
        }
        if self.stiffness.size() != size {
            let what = format!("stiffness matrix of {} rows, mass matrix of {size}", self.stiffness.size());
            error(what, "equal sizes", "give both matrices for the same degrees of freedom");
        }
        let numbers = self.mass.entries().chain(self.stiffness.entries()).map(|x| x.2);
        let given = if let KeptModes::Given(psi) = &self.modes { psi.as_slice() } else { &[] };
        let numbers = numbers.chain(self.positions.iter().flatten().copied()).chain(given.iter().copied());
        if let Some(x) = numbers.into_iter().find(|x| !x.is_finite() || x.abs() > LARGEST) {
            let required = format!("finite numbers of magnitude at most {LARGEST:e}");
            error(format!("a number of the elements is {x:e}"), &required, "correct it");
        }
        if self.inboard.is_empty() {
            error("no inboard node".into(), "a node that the joint holds", "name it");
        }
        let mut seen = Vec::new();
        for index in self.inboard.iter().copied().chain(self.outboard.iter().map(|n| n.index)) {
            if index >= nodes {
                error(format!("interface node {index}"), &format!("an index below {nodes}"), "correct it");
            }
            if seen.contains(&index) {
                let what = format!("node {index} is an interface twice");
                error(what, "different nodes", "let several joints name the same node");
            }
            seen.push(index);
        }
        if let KeptModes::Given(psi) = &self.modes {
            if psi.nrows() != size || psi.ncols() == 0 {
                let what = format!("shape matrix of {}×{}", psi.nrows(), psi.ncols());
                error(
                    what,
                    &format!("{size} rows, and a column for every mode"),
                    "give all degrees of freedom",
                );
            } else {
                for &k in self.inboard.iter().filter(|k| **k < nodes) {
                    let rows = (k * width).min(size)..((k + 1) * width).min(size);
                    if rows.clone().any(|r| psi.row(r).iter().any(|x| *x != 0.0)) {
                        let what = format!("a shape moves inboard node {k}");
                        error(what, "zero at the inboard nodes", "subtract the rigid motion of F");
                    }
                }
            }
        }
        if found.is_empty() { Ok(width) } else { Err(ModelErrors(found)) }
    }
}

fn error(
    name: &str,
    found: impl Into<String>,
    required: impl Into<String>,
    remedy: impl Into<String>,
) -> ModelErrors {
    ModelErrors(vec![Violation::error(Subject::Body(name.into()), found, required, remedy)])
}

fn solve_lower(l: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    // The factor of a positive definite matrix has no zero on its diagonal.
    l.solve_lower_triangular(b).unwrap_or_else(|| b.clone())
}

pub(super) fn symmetric(a: &DMatrix<f64>) -> DMatrix<f64> {
    (a + a.transpose()) * 0.5
}

/// Indices in the order of increasing values.
pub(super) fn sorted(values: &DVector<f64>) -> Vec<usize> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    order
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[cfg(test)]
mod tests;
