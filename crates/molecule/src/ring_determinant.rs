//! ln det(G M⁻¹ G*) of the closures of flexible rings, and its gradient along the closed rings.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | F_r | wrench of row r: fixed in the body of one end of its closure, about the closure's point | 6 | |
//! | G_r v | F_r · (V_b − V_a): twists of the two ends | | |
//! | s_i, σ_i | axis of degree of freedom i on a strand between the ends, about that point; +1 towards b, −1 towards a | 6 | |
//! | W_i | V_b − V_p, p the body inboard of i | 6 | |
//! | Ω, L | G M⁻¹ G* = L L* | m×m | paper 2, (4.18) |
//! | A, C | M⁻¹ G* Ω⁻¹, M⁻¹ G* L^(−*) | n×m | |
//!
//! ∂ ln det Ω = tr Ω⁻¹ ∂Ω = 2 Σ_r ∂(G_r) a_r − Σ_r c_r·(∂M) c_r. The second is twice the configuration derivative of the kinetic
//! energy at the velocities c_r, which the momentum sweep has ([`MomentumSweep`]). The first: a turn about s_i carries F_r where i
//! is inboard of a, and the axes outboard of i; what is inboard of both ends cancels, and what is left is
//!
//! ∂_i(G_r) a = σ_i F_r · (s_i × W_i(a)).
//!
//! F_r is carried by a also where the rings are open, which changes the gradient across the closed rings only: multipliers take that
//! part of a force away.

use crate::atoms::MoleculeError;
use crate::torsion_model::TorsionModel;
use phipsi_model::ClosureKind;
use phipsi_motion::midpoint_momentum::MomentumSweep;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_recursion::layout::GROUND;
use phipsi_recursion::{ArticulatedSweep, Layout};
use phipsi_spatial::{Motion, Transform, Vec3, Wrench};

/// Rows of the closure of a ring: two angles and a point.
const ROWS: usize = 5;

/// A degree of freedom on a strand.
#[derive(Clone, Copy, Debug)]
struct Link {
    dof: usize,
    body: usize,
}

/// The closure of a ring: its end on body a, and the two strands to a and b from where they part, outward.
#[derive(Clone, Debug)]
struct Ring {
    body: usize,
    end: Transform<f64>,
    strands: [Vec<Link>; 2],
}

/// Workspace; made once for a molecule.
#[derive(Clone, Debug)]
pub(crate) struct RingDeterminant {
    rings: Vec<Ring>,
    /// Angular rows are multiplied with it, nm.
    length: f64,
    world: Vec<Transform<f64>>,
    /// F_r, by rings.
    wrenches: Vec<Wrench<f64>>,
    /// s_i of both strands, by rings.
    axes: Vec<[Vec<Motion<f64>>; 2]>,
    /// M⁻¹ G*, then A; C: a column of nv for every row.
    a: Vec<f64>,
    c: Vec<f64>,
    /// G*.
    rows: Vec<f64>,
    omega: Vec<f64>,
    momentum: MomentumSweep<f64>,
    solve: SolveWorkspace<f64>,
    mu: Vec<f64>,
    g: Vec<f64>,
}

impl RingDeterminant {
    /// For the closures of a molecule.
    ///
    /// # Errors
    /// [`MoleculeError`] for closures that are not those of rings.
    pub(crate) fn new(torsion: &TorsionModel, length: f64) -> Result<Self, MoleculeError> {
        let (model, layout) = (torsion.model(), torsion.layout());
        let mut rings = Vec::new();
        for closure in model.closures() {
            let end = |name: &str, pose: &phipsi_model::Placement| {
                let carrier = &layout.carriers()[model.find_body(name).ok().flatten()?];
                Some((carrier.body, carrier.pose.compose(&pose.to_transform())))
            };
            let ends = (end(&closure.body_a, &closure.pose_a), end(&closure.body_b, &closure.pose_b));
            let ((Some((body, end)), Some((other, _))), ClosureKind::Revolute) = (ends, closure.kind) else {
                let found = "a closure that is not that of a ring";
                let remedy = "make the ring flexible by `rings`";
                return Err(MoleculeError::new(&closure.name, found, "a ring cut at a bond", remedy));
            };
            rings.push(Ring { body, end, strands: strands(layout, body, other) });
        }
        let (n, m, nv) = (layout.len(), ROWS * rings.len(), layout.nv());
        Ok(RingDeterminant {
            length,
            world: vec![Transform::identity(); n],
            wrenches: vec![Wrench::zero(); m],
            axes: rings.iter().map(|r| r.strands.each_ref().map(|s| vec![Motion::zero(); s.len()])).collect(),
            a: vec![0.0; m * nv],
            c: vec![0.0; m * nv],
            rows: vec![0.0; m * nv],
            omega: vec![0.0; m * m],
            momentum: MomentumSweep::new(layout),
            solve: SolveWorkspace::new(layout),
            mu: vec![0.0; nv],
            g: vec![0.0; nv],
            rings,
        })
    }
    /// Adds ∂ ln det Ω to `gradient` (nv) and returns ln det Ω; NaN where rows are redundant. `factors`: those of M at q. Cost: a
    /// solution and a momentum sweep for each row, and m² n products; no allocation.
    pub(crate) fn run(
        &mut self,
        layout: &Layout<f64>,
        factors: &ArticulatedSweep<f64>,
        q: &[f64],
        gradient: &mut [f64],
    ) -> f64 {
        self.place(layout, q);
        let (m, nv) = (self.wrenches.len(), layout.nv());
        self.a.copy_from_slice(&self.rows);
        for column in self.a.chunks_exact_mut(nv) {
            factors.solve_in_place(layout, column, &mut self.solve);
        }
        for i in 0..m {
            for j in 0..m {
                self.omega[i * m + j] = dot(&self.rows[i * nv..][..nv], &self.a[j * nv..][..nv]);
            }
        }
        let logarithm = cholesky(&mut self.omega, m);
        // C* = L⁻¹ (M⁻¹ G*)*, A* = L^(−*) C*.
        self.c.copy_from_slice(&self.a);
        for i in 0..m {
            for j in 0..i {
                subtract(&mut self.c, nv, (i, j), self.omega[i * m + j]);
            }
            divide(&mut self.c[i * nv..][..nv], self.omega[i * m + i]);
        }
        self.a.copy_from_slice(&self.c);
        for i in (0..m).rev() {
            for j in i + 1..m {
                subtract(&mut self.a, nv, (i, j), self.omega[j * m + i]);
            }
            divide(&mut self.a[i * nv..][..nv], self.omega[i * m + i]);
        }
        for c in self.c.chunks_exact(nv) {
            self.momentum.run(layout, q, c, &mut self.mu, &mut self.g);
            gradient.iter_mut().zip(&self.g).for_each(|(sum, g)| *sum -= 2.0 * g);
        }
        self.add_rows(nv, gradient);
        logarithm
    }

    /// Poses, F, s and G*.
    fn place(&mut self, layout: &Layout<f64>, q: &[f64]) {
        for (k, body) in layout.bodies().iter().enumerate() {
            let hinge = body.pose(q);
            self.world[k] =
                if body.parent == GROUND { hinge } else { self.world[body.parent].compose(&hinge) };
        }
        let nv = layout.nv();
        self.rows.fill(0.0);
        for (of, ring) in self.rings.iter().enumerate() {
            let frame = self.world[ring.body].compose(&ring.end);
            let (o, e) = (Vec3::zero(), |i: usize| frame.rotation.column(i));
            let wrenches = &mut self.wrenches[ROWS * of..][..ROWS];
            for i in 0..2 {
                wrenches[i] = Wrench::new(e(i).scale(self.length), o);
            }
            for i in 0..3 {
                wrenches[2 + i] = Wrench::new(o, e(i));
            }
            for (side, strand) in ring.strands.iter().enumerate() {
                let sign = if side == 0 { -1.0 } else { 1.0 };
                for (link, axis) in strand.iter().zip(&mut self.axes[of][side]) {
                    let (pose, body) = (&self.world[link.body], &layout.bodies()[link.body]);
                    let own: Motion<f64> = body.hinge.axis(link.dof - body.v);
                    let angular = pose.rotation * own.angular;
                    let linear =
                        pose.rotation * own.linear + angular.cross(frame.translation - pose.translation);
                    *axis = Motion::new(angular, linear);
                    for (r, wrench) in wrenches.iter().enumerate() {
                        self.rows[(ROWS * of + r) * nv + link.dof] = sign * axis.dot(*wrench);
                    }
                }
            }
        }
    }

    /// 2 Σ_r σ_i F_r · (s_i × W_i(a_r)).
    fn add_rows(&self, nv: usize, gradient: &mut [f64]) {
        for (of, ring) in self.rings.iter().enumerate() {
            let axes = &self.axes[of];
            for r in ROWS * of..ROWS * (of + 1) {
                let (wrench, a) = (self.wrenches[r], &self.a[r * nv..][..nv]);
                // V_b − V_p from b inward, then on from where the strands part towards a.
                let mut w = Motion::zero();
                for (link, s) in ring.strands[1].iter().zip(&axes[1]).rev() {
                    w += s.scale(a[link.dof]);
                    gradient[link.dof] += 2.0 * s.cross_motion(w).dot(wrench);
                }
                for (link, s) in ring.strands[0].iter().zip(&axes[0]) {
                    gradient[link.dof] -= 2.0 * s.cross_motion(w).dot(wrench);
                    w -= s.scale(a[link.dof]);
                }
            }
        }
    }
}

/// Degrees of freedom from where the paths to two bodies part, outward.
fn strands(layout: &Layout<f64>, a: usize, b: usize) -> [Vec<Link>; 2] {
    let path = |mut k: usize| {
        let mut path = Vec::new();
        while k != GROUND {
            path.push(k);
            k = layout.bodies()[k].parent;
        }
        path.reverse();
        path
    };
    let (a, b) = (path(a), path(b));
    let common = a.iter().zip(&b).take_while(|(a, b)| a == b).count();
    let links = |path: &[usize]| {
        let of = |&body: &usize| {
            let own = &layout.bodies()[body];
            (own.v..own.v + own.hinge.nv()).map(move |dof| Link { dof, body })
        };
        path[common..].iter().flat_map(of).collect()
    };
    [links(&a), links(&b)]
}

/// L in place of the lower triangle of Ω; returns ln det Ω, NaN where a pivot is not above rounding.
fn cholesky(omega: &mut [f64], m: usize) -> f64 {
    let mut logarithm = 0.0;
    for j in 0..m {
        let size = omega[j * m + j];
        for i in j..m {
            let sum = dot(&omega[i * m..][..j], &omega[j * m..][..j]);
            omega[i * m + j] -= sum;
        }
        let pivot = omega[j * m + j];
        let is_independent = pivot > 64.0 * m as f64 * f64::EPSILON * size;
        if !is_independent {
            return f64::NAN;
        }
        logarithm += pivot.ln();
        let root = pivot.sqrt();
        (j..m).for_each(|i| omega[i * m + j] /= root);
    }
    logarithm
}

/// Column i less a multiple of column j.
fn subtract(columns: &mut [f64], nv: usize, (i, j): (usize, usize), factor: f64) {
    for k in 0..nv {
        columns[i * nv + k] -= factor * columns[j * nv + k];
    }
}

fn divide(column: &mut [f64], by: f64) {
    column.iter_mut().for_each(|x| *x /= by);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
