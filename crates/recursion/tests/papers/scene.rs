//! The scenes that every row runs on, and the papers' recursions written out body by body: what the operators are held to.

use nalgebra::DMatrix;
use phipsi_model::{Base, Body, Inertia, Joint, JointKind, ModelBuilder, Placement, Random};
use phipsi_recursion::Operators;
use phipsi_reference::generate::{Case, Limits, case_within, configuration};
use phipsi_spatial::{Real, Transform, Vec3, Wrench};
use std::ops::Deref;

/// What a tree looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Nothing branches, one root.
    pub chain: bool,
    /// Two bodies on different branches of one tree both have children.
    pub two_levels: bool,
    /// One root, on a joint of six degrees of freedom.
    pub free: bool,
}

/// A shape of one's own: a tree or forest, and which joints it has.
pub struct Plan {
    pub name: &'static str,
    parents: &'static [Option<usize>],
    kinds: &'static [char],
}

/// Chains, trees that branch on three levels, a forest, with joints of one to six degrees of freedom.
pub const PLANS: [Plan; 6] = [
    Plan {
        name: "chain of hinges",
        parents: &[None, Some(0), Some(1), Some(2), Some(3), Some(4), Some(5)],
        kinds: &['r'],
    },
    Plan {
        name: "chain of one to six degrees of freedom",
        parents: &[None, Some(0), Some(1), Some(2), Some(3), Some(4)],
        kinds: &['f', 'r', 'u', 's', 'h', 'c'],
    },
    Plan {
        name: "tree of hinges",
        parents: &[None, Some(0), Some(0), Some(1), Some(1), Some(2), Some(2), Some(3), Some(5)],
        kinds: &['r', 'r', 'p', 'r'],
    },
    Plan {
        name: "tree of one to five degrees of freedom",
        parents: &[None, Some(0), Some(0), Some(1), Some(1), Some(2), Some(2)],
        kinds: &['s', 'r', 'c', 'u', 'h', 'r', 'l'],
    },
    Plan {
        name: "free tree",
        parents: &[None, Some(0), Some(1), Some(1), Some(0), Some(4), Some(4)],
        kinds: &['f', 'r', 'p', 'r', 'u', 'r', 's'],
    },
    Plan {
        name: "forest",
        parents: &[None, None, Some(0), Some(0), Some(1), Some(4), Some(4)],
        kinds: &['r', 'l', 'r', 'u', 'r', 'p'],
    },
];

/// Shorter and longer chains of equal joints, for costs per body.
pub const SHORT: usize = 4;
pub const LONG: usize = 8;

fn direction(random: &mut Random) -> [f64; 3] {
    loop {
        let a = random.vector();
        if a.iter().map(|x| x * x).sum::<f64>() > 0.1 {
            return a;
        }
    }
}

fn built(name: &str, parents: &[Option<usize>], kinds: &[char], seed: u64) -> Case {
    let mut random = Random::new(seed ^ 0x7061_7065_7273);
    let mut builder = ModelBuilder::new(name).gravity([0.7, -0.3, -9.0]);
    for (k, parent) in parents.iter().enumerate() {
        let axis = direction(&mut random);
        let kind = match kinds[k % kinds.len()] {
            'r' => JointKind::Revolute { axis },
            'p' => JointKind::Prismatic { axis },
            'h' => JointKind::Helical { axis, pitch: 0.4 },
            'c' => JointKind::Cylindrical { axis },
            'u' => JointKind::Universal { axes: [axis, direction(&mut random)] },
            'l' => JointKind::Planar { normal: axis },
            's' => JointKind::Spherical,
            _ => JointKind::Free,
        };
        let sides = [0; 3].map(|_| 0.2 + 0.5 * random.uniform());
        let mass = 0.5 + random.uniform();
        let [a, b, c] = sides.map(|x| x * x * mass / 12.0);
        let mut inertia =
            Inertia::from_principal(mass, random.vector().map(|x| 0.5 * x), [b + c, c + a, a + b]);
        inertia.frame.rotation = random.quaternion();
        let at =
            Placement { translation: direction(&mut random).map(|x| 0.7 * x), rotation: random.quaternion() };
        let body = format!("b{k}");
        builder = builder.body(Body::new(body.as_str(), inertia));
        builder = if kind == JointKind::Free && k == 0 {
            builder.base(Base::Free)
        } else {
            let inboard = parent.map_or("world".into(), |p| format!("b{p}"));
            builder.joint(Joint::new(format!("j{k}"), kind).at(at), inboard, body)
        };
    }
    let model = builder.build().expect("a model of one's own is valid");
    let q = configuration(&mut random, &model);
    let mut numbers = || (0..model.nv()).map(|_| random.signed()).collect::<Vec<f64>>();
    let (v, a, tau) = (numbers(), numbers(), numbers());
    let wrenches = vec![Wrench::zero(); model.len()];
    let rounding = wrenches.clone();
    let (body, point) = (model.len() - 1, Vec3(random.vector()));
    Case { model, q, v, a, tau, wrenches, rounding, body, point }
}

/// The case of a plan.
pub fn planned(plan: &Plan, seed: u64) -> Case {
    built(plan.name, plan.parents, plan.kinds, seed)
}

/// A chain of hinges.
pub fn chain(count: usize) -> Case {
    let parents: Vec<Option<usize>> = (0..count).map(|k: usize| k.checked_sub(1)).collect();
    built("chain", &parents, &['r'], 5)
}

/// A generated case: small, because dense matrices of double-double numbers are slow.
pub fn generated(seed: u64) -> Case {
    case_within(seed, Limits { degrees_of_freedom: 1 + (seed % 9) as usize, decades: 0.5 })
}

pub fn zeros<T: Real>(rows: usize, columns: usize) -> DMatrix<T> {
    DMatrix::from_element(rows, columns, T::zero())
}

/// A⁻¹ by Gauss–Jordan elimination with row pivoting.
pub fn inverse<T: Real>(a: &DMatrix<T>) -> DMatrix<T> {
    let n = a.nrows();
    let (mut a, mut out) = (a.clone(), DMatrix::identity(n, n));
    for j in 0..n {
        let size = |i: usize| a[(i, j)].abs().to_f64();
        let best = (j..n).max_by(|&i, &k| size(i).total_cmp(&size(k))).unwrap_or(j);
        a.swap_rows(j, best);
        out.swap_rows(j, best);
        let pivot = a[(j, j)];
        for m in [&mut a, &mut out] {
            for c in 0..n {
                m[(j, c)] /= pivot;
            }
        }
        for i in (0..n).filter(|&i| i != j) {
            let factor = a[(i, j)];
            for m in [&mut a, &mut out] {
                for c in 0..n {
                    let x = m[(j, c)];
                    m[(i, c)] -= factor * x;
                }
            }
        }
    }
    out
}

/// Blocks of the papers' recursions, as they are printed (corrected), by body.
pub struct Blocks<T> {
    /// φ(p, k), empty at roots.
    pub shift: Vec<DMatrix<T>>,
    pub H: Vec<DMatrix<T>>,
    pub M: Vec<DMatrix<T>>,
    pub R: Vec<DMatrix<T>>,
    pub P: Vec<DMatrix<T>>,
    pub P_plus: Vec<DMatrix<T>>,
    pub D: Vec<DMatrix<T>>,
    pub D_inverse: Vec<DMatrix<T>>,
    pub G: Vec<DMatrix<T>>,
    pub tau_bar: Vec<DMatrix<T>>,
    pub psi: Vec<DMatrix<T>>,
    pub K: Vec<DMatrix<T>>,
    pub upsilon: Vec<DMatrix<T>>,
    pub Q: Vec<DMatrix<T>>,
}

fn blocks<T: Real>(ops: &Operators<T>) -> Blocks<T> {
    let n = ops.bodies().len();
    let parent = |k: usize| ops.tree().parent(k);
    let own = |a: &phipsi_topology::Operator<T>| (0..n).map(|k| a.block(k, k).unwrap()).collect::<Vec<_>>();
    let (H, M) = (own(&ops.H), own(&ops.M));
    let shift: Vec<DMatrix<T>> =
        (0..n).map(|k| parent(k).map_or(zeros(0, 0), |p| ops.E_phi.block(p, k).unwrap())).collect();
    let empty = || vec![zeros(0, 0); n];
    let (mut R, mut P) = (M.clone(), M.clone());
    let (mut P_plus, mut D, mut D_inverse, mut G, mut tau_bar) =
        (empty(), empty(), empty(), empty(), empty());
    let (mut psi, mut K) = (empty(), empty());
    for k in (0..n).rev() {
        D[k] = &H[k] * &P[k] * H[k].transpose();
        D_inverse[k] = inverse(&D[k]);
        G[k] = &P[k] * H[k].transpose() * &D_inverse[k];
        tau_bar[k] = DMatrix::identity(6, 6) - &G[k] * &H[k];
        P_plus[k] = &P[k] - &G[k] * &D[k] * G[k].transpose();
        if let Some(p) = parent(k) {
            psi[k] = &shift[k] * &tau_bar[k];
            K[k] = &shift[k] * &G[k];
            let (composite, articulated) =
                (&shift[k] * &R[k] * shift[k].transpose(), &shift[k] * &P_plus[k] * shift[k].transpose());
            R[p] += composite;
            P[p] += articulated;
        }
    }
    let (mut upsilon, mut Q) = (empty(), empty());
    for k in 0..n {
        upsilon[k] = H[k].transpose() * &D_inverse[k] * &H[k];
        Q[k] = H[k].transpose() * &H[k];
        if let Some(p) = parent(k) {
            let moved = psi[k].transpose() * &upsilon[p] * &psi[k];
            upsilon[k] += moved;
            let moved = shift[k].transpose() * &Q[p] * &shift[k];
            Q[k] += moved;
        }
    }
    Blocks { shift, H, M, R, P, P_plus, D, D_inverse, G, tau_bar, psi, K, upsilon, Q }
}

/// Filter and smoother as paper 1 (9.3)–(9.14) prints them, body by body; six numbers, or as many as the joint has, a body.
#[derive(Clone)]
pub struct Pass<T> {
    pub z: Vec<DMatrix<T>>,
    pub z_plus: Vec<DMatrix<T>>,
    pub epsilon: Vec<DMatrix<T>>,
    pub nu: Vec<DMatrix<T>>,
    pub alpha_plus: Vec<DMatrix<T>>,
    pub alpha: Vec<DMatrix<T>>,
    pub acceleration: Vec<DMatrix<T>>,
    pub f: Vec<DMatrix<T>>,
}

/// A case with its operators.
pub struct Scene<T> {
    pub case: Case,
    pub q: Vec<T>,
    pub ops: Operators<T>,
    pub blocks: Blocks<T>,
    pub shape: Shape,
    pub seed: u64,
    /// Pose of each block's frame in the world, by the dense reference.
    pub poses: Vec<Transform<T>>,
}

impl<T> Deref for Scene<T> {
    type Target = Operators<T>;
    fn deref(&self) -> &Operators<T> {
        &self.ops
    }
}

pub fn numbers<T: Real>(x: &[f64]) -> Vec<T> {
    x.iter().map(|&x| T::splat(x)).collect()
}

/// The shape of a case.
pub fn shape(case: &Case) -> Shape {
    let ops = Operators::new(&case.model, &case.q).expect("generated trees are regular");
    let (tree, children) = (ops.tree(), ops.tree().children());
    let roots = tree.parents().iter().filter(|p| p.is_none()).count();
    let above = |a: usize, b: usize| tree.path_to_root(b).any(|x| x == a);
    let inner: Vec<usize> = (0..tree.len()).filter(|&k| !children[k].is_empty()).collect();
    let one_tree = |a: usize, b: usize| tree.path_to_root(a).last() == tree.path_to_root(b).last();
    let apart = |a: usize, b: usize| one_tree(a, b) && !above(a, b) && !above(b, a);
    let two_levels = inner.iter().any(|&a| inner.iter().any(|&b| apart(a, b)));
    Shape {
        chain: roots == 1 && children.iter().all(|c| c.len() < 2),
        two_levels,
        free: roots == 1 && ops.joint_space().size(0) == 6,
    }
}

impl<T: Real> Scene<T> {
    pub fn new(case: &Case, seed: u64) -> Self {
        let mut q = numbers::<T>(&case.q);
        case.model.normalize(&mut q);
        let ops = Operators::new(&case.model, &q).expect("generated trees are regular");
        let zero = vec![T::zero(); case.model.nv()];
        let motions = phipsi_reference::kinematics(&case.model, &q, &zero, &zero);
        let poses = ops.bodies().iter().map(|&k| motions[k].pose).collect();
        Scene { blocks: blocks(&ops), case: case.clone(), q, ops, shape: shape(case), seed, poses }
    }
    pub fn n(&self) -> usize {
        self.bodies().len()
    }
    pub fn nv(&self) -> usize {
        self.joint_space().dimension()
    }
    pub fn parent(&self, k: usize) -> Option<usize> {
        self.tree().parent(k)
    }
    /// v, a, τ of the case.
    pub fn v(&self) -> Vec<T> {
        numbers(&self.case.v)
    }
    pub fn a(&self) -> Vec<T> {
        numbers(&self.case.a)
    }
    pub fn applied(&self) -> Vec<T> {
        numbers(&self.case.tau)
    }
    /// The dense reference's mass matrix: Kane's equations in world axes.
    pub fn mass_of_reference(&self) -> DMatrix<T> {
        phipsi_reference::mass_matrix(&self.case.model, &self.q)
    }
    /// Its inverse, by a dense LDL*.
    pub fn mass_inverse_of_reference(&self) -> DMatrix<T> {
        phipsi_reference::mass_matrix_inverse(&self.case.model, &self.q).expect("generated trees are regular")
    }
    /// True if a is b or inboard of b.
    pub fn carries(&self, a: usize, b: usize) -> bool {
        self.tree().path_to_root(b).any(|x| x == a)
    }
    /// The lowest common ancestor.
    pub fn common(&self, i: usize, j: usize) -> Option<usize> {
        self.tree().path_to_root(i).find(|&a| self.carries(a, j))
    }
    /// The product of edges from j inward to i.
    pub fn transition(&self, edges: &[DMatrix<T>], i: usize, j: usize) -> DMatrix<T> {
        let mut product = DMatrix::identity(6, 6);
        let mut at = j;
        while at != i {
            product = &edges[at] * product;
            at = self.parent(at).expect("i carries j");
        }
        product
    }
    /// A matrix from its blocks.
    pub fn assembled(
        &self,
        rows: &phipsi_topology::Space,
        columns: &phipsi_topology::Space,
        block: impl Fn(usize, usize) -> Option<DMatrix<T>>,
    ) -> DMatrix<T> {
        let mut out = zeros(rows.dimension(), columns.dimension());
        for i in 0..rows.blocks() {
            for j in 0..columns.blocks() {
                if let Some(b) = block(i, j) {
                    out.view_mut((rows.range(i).start, columns.range(j).start), b.shape()).copy_from(&b);
                }
            }
        }
        out
    }
    /// Spatial by spatial, from blocks.
    pub fn spatial(&self, block: impl Fn(usize, usize) -> Option<DMatrix<T>>) -> DMatrix<T> {
        self.assembled(self.state_space(), self.state_space(), block)
    }
    /// One block a body.
    pub fn diagonal_matrix(
        &self,
        rows: &phipsi_topology::Space,
        columns: &phipsi_topology::Space,
        blocks: &[DMatrix<T>],
    ) -> DMatrix<T> {
        self.assembled(rows, columns, |i, j| (i == j).then(|| blocks[i].clone()))
    }
    pub fn spatial_diagonal(&self, blocks: &[DMatrix<T>]) -> DMatrix<T> {
        self.diagonal_matrix(self.state_space(), self.state_space(), blocks)
    }
    /// The diagonal blocks of a spatial matrix.
    pub fn diagonal_of(&self, a: &DMatrix<T>) -> DMatrix<T> {
        self.spatial(|i, j| (i == j).then(|| a.view((6 * i, 6 * i), (6, 6)).into_owned()))
    }
    /// The procedure's images of unit vectors.
    pub fn matrix(&self, columns: usize, image: impl Fn(&[T]) -> Vec<T>) -> DMatrix<T> {
        let images: Vec<Vec<T>> = (0..columns)
            .map(|j| {
                image(&(0..columns).map(|i| if i == j { T::one() } else { T::zero() }).collect::<Vec<T>>())
            })
            .collect();
        DMatrix::from_fn(images.first().map_or(0, Vec::len), columns, |i, j| images[j][i])
    }
    /// Cuts a joint vector into blocks.
    pub fn cut(&self, x: &[T]) -> Vec<DMatrix<T>> {
        let of =
            |k| DMatrix::from_column_slice(self.joint_space().size(k), 1, &x[self.joint_space().range(k)]);
        (0..self.n()).map(of).collect()
    }
    /// Cuts a spatial vector into blocks.
    pub fn cut_spatial(&self, x: &[T]) -> Vec<DMatrix<T>> {
        x.chunks_exact(6).map(|x| DMatrix::from_column_slice(6, 1, x)).collect()
    }
    /// Filter and smoother, body by body.
    pub fn pass(&self, tau: &[T]) -> Pass<T> {
        let (b, n) = (&self.blocks, self.n());
        let T = self.cut(tau);
        let six = || vec![zeros(6, 1); n];
        let (mut z, mut z_plus, mut epsilon, mut nu) = (six(), six(), T.clone(), T.clone());
        for k in (0..n).rev() {
            epsilon[k] = &T[k] - &b.H[k] * &z[k];
            nu[k] = &b.D_inverse[k] * &epsilon[k];
            z_plus[k] = &z[k] + &b.G[k] * &epsilon[k];
            if let Some(p) = self.parent(k) {
                let moved = &b.shift[k] * &z_plus[k];
                z[p] += moved;
            }
        }
        let (mut alpha_plus, mut alpha, mut acceleration, mut f) = (six(), six(), T.clone(), six());
        for k in 0..n {
            if let Some(p) = self.parent(k) {
                alpha_plus[k] = b.shift[k].transpose() * &alpha[p];
            }
            acceleration[k] = &nu[k] - b.G[k].transpose() * &alpha_plus[k];
            alpha[k] = &alpha_plus[k] + b.H[k].transpose() * &acceleration[k];
            f[k] = &z[k] + &b.P[k] * &alpha[k];
        }
        Pass { z, z_plus, epsilon, nu, alpha_plus, alpha, acceleration, f }
    }
    /// One result of [`Scene::pass`] as a matrix that acts on joint forces.
    pub fn of_pass(&self, part: impl Fn(Pass<T>) -> Vec<DMatrix<T>>) -> DMatrix<T> {
        self.matrix(self.nv(), |tau| stacked(&part(self.pass(tau))))
    }
}

pub fn stacked<T: Real>(parts: &[DMatrix<T>]) -> Vec<T> {
    parts.iter().flat_map(|x| x.iter().copied()).collect()
}
