//! The compliance that a tree shows to its closures.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | B | rows of the closures on the accelerations of bodies, as wrenches | 6n×m | paper 2 §4.6 |
//! | Ω | ψ*H*D⁻¹Hψ, what wrenches on all bodies give to all bodies | 6n×6n | paper 2 (4.18), soa.md 3.2 |
//! | Υ | its diagonal blocks: Υ(k) = ψ*(p,k) Υ(p) ψ(p,k) + H*D⁻¹H | 6×6 | paper 1 (10.2), [`mod@phipsi_recursion::upsilon`] |
//! | C | ψ B: wrenches of one loop on the body that they have come to | m×6 | |
//! | E, ν | coefficient of a coupling on a joint, D⁻¹(HC + E) of the joint | | |
//!
//! Two wrenches on bodies i and j meet in the body a in which the ways of i and j to the ground meet:
//! Ω(i,j) = ψ*(a,i) Υ(a) ψ(a,j). A wrench goes inward only while there is another one that it has not met. A coupling pushes a
//! joint, not a body: on the inboard side its wrench is −G E, and it meets what comes through the joint by E ν.

use crate::compiled::Number;
use crate::error::{ClosureError, check_length};
use crate::frames::{Frames, weight};
use crate::number::Arithmetic;
use crate::structure::{LoopKind, Structure};
use crate::tree::Tree;
use phipsi_model::Model;
use phipsi_recursion::layout::GROUND;
use phipsi_recursion::{Layout, Upsilon};
use phipsi_spatial::{Kernel, Motion, Scalar, Wrench};

/// What happens at one body. A part is one end of a loop, or both once they have met: 2 · loop + end.
#[derive(Clone, Debug, Default)]
struct Meeting<T> {
    /// Parts that begin on the body, one each, then those of each child.
    groups: Vec<Vec<usize>>,
    /// How many of the groups begin here.
    begins: usize,
    /// Parts of one loop that are one from here on: into the first.
    merges: Vec<(usize, usize)>,
    /// Parts that go on through the joint.
    passes: Vec<usize>,
    /// Couplings that push the joint: part and coefficient.
    pushes: Vec<(usize, T)>,
    /// Parts of one coupling that are one inboard of the joint.
    merges_inboard: Vec<(usize, usize)>,
}

/// B*ΩB of a mechanism's tree: a workspace, made once; no allocation afterwards.
#[derive(Clone, Debug)]
pub struct ClosureCompliance<T: Number> {
    layout: Layout<T>,
    tree: Tree<T>,
    structure: Structure<T>,
    frames: Frames<T>,
    upsilon: Upsilon<T>,
    meetings: Vec<Meeting<T>>,
    /// C of every part, each on the body that it has come to.
    c: Vec<Wrench<Arithmetic<T>>>,
    /// D⁻¹ H C of every part at a joint of one degree of freedom that a coupling pushes.
    nu: Vec<Arithmetic<T>>,
    /// Υ C of one part.
    accelerations: Vec<Motion<Arithmetic<T>>>,
}

impl<T: Number> ClosureCompliance<T> {
    /// A workspace for a model.
    ///
    /// # Errors
    /// [`ClosureError::Coupling`] if a coupled joint has not one degree of freedom; models with flexible bodies are refused.
    pub fn new(model: &Model) -> Result<Self, ClosureError> {
        let layout = Layout::new(&model.clone().without_closures());
        layout.check_rigid("closure_compliance")?;
        let tree = Tree::new(&layout);
        let structure = Structure::new(model, &layout, &tree)?;
        Ok(ClosureCompliance {
            frames: Frames::new(&structure, &layout, &tree),
            upsilon: Upsilon::new(&layout),
            meetings: meetings(&structure, &tree),
            c: vec![Wrench::zero(); 2 * structure.rows],
            nu: vec![Arithmetic::<T>::splat(0.0); 2 * structure.rows],
            accelerations: vec![Motion::zero(); structure.rows],
            layout,
            tree,
            structure,
        })
    }
    /// Rows of all closures and couplings, in the order of [`crate::ClosedDynamics`].
    pub fn rows(&self) -> usize {
        self.structure.rows
    }
    /// B*ΩB at a configuration.
    ///
    /// # Computes
    /// B*ΩB = J M⁻¹ J* of the open tree: the accelerations of all rows under the forces of all closures, at rest and without
    /// weight. Singular where rows are redundant, near singular positions it has the squares of what [`crate::ClosedDynamics`]
    /// decides by.
    ///
    /// # Shapes & units
    /// `q`: nq; `out`: rows² numbers, by rows, filled and symmetric. Rows in their own units, m or rad, angular ones *not*
    /// multiplied with the scene's length: 1/kg, 1/(kg·m), 1/(kg·m²), so that it belongs to the forces that
    /// [`crate::Solved::closure_forces`] gives.
    ///
    /// # Frames
    /// Each row as its closure: axes of frame A, at the origin of B.
    ///
    /// # Method
    /// Paper 2 (4.18)–(4.19) corrected for trees: soa.md 3.2.
    ///
    /// # Cost
    /// O(n) for Υ, O(m) for each joint that parts pass on their way to the others, O(m²) for what is written.
    ///
    /// # Accuracy
    /// n·ε·κ relative to the largest entry, and what the articulated sweep loses where heavy bodies hang on light ones.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`]: a length, or a joint without articulated inertia.
    pub fn run(&mut self, q: &[T], out: &mut [T]) -> Result<(), ClosureError> {
        check_length("q", q, self.layout.nq())?;
        check_length("out", out, self.rows() * self.rows())?;
        self.upsilon.update(&self.layout, q)?;
        self.frames.set_position(&self.structure, (&self.layout, &self.tree), q, None);
        T::gather_compliance(Gather { work: self, out: T::arithmetic_mut(out) });
        Ok(())
    }
    /// First place of a part in `c`, its rows' first among all rows, and their number.
    #[inline(always)]
    fn part(&self, part: usize) -> (usize, usize, usize) {
        let rows = &self.structure.loops[part / 2].rows;
        (2 * rows.start + (part % 2) * rows.len(), rows.start, rows.len())
    }
    /// All sweeps but that of Υ: tips to base.
    #[inline(always)]
    fn gather(&mut self, out: &mut [Arithmetic<T>]) {
        out.fill(Arithmetic::<T>::splat(0.0));
        for k in (0..self.tree.len()).rev() {
            self.begin(k);
            self.meet_all(k, out);
            for i in 0..self.meetings[k].merges.len() {
                let merge = self.meetings[k].merges[i];
                self.merge(merge);
            }
            self.pass(k);
            self.push(k, out);
            for i in 0..self.meetings[k].merges_inboard.len() {
                let merge = self.meetings[k].merges_inboard[i];
                self.merge(merge);
            }
        }
    }
    /// C of the parts that begin on a body.
    #[inline(always)]
    fn begin(&mut self, k: usize) {
        for group in &self.meetings[k].groups[..self.meetings[k].begins] {
            for &part in group {
                let (first, _, m) = self.part(part);
                for i in 0..m {
                    let row = self.frames.strand_row(&self.structure, part / 2, part % 2, i);
                    let unit = weight(&self.structure, &self.structure.loops[part / 2], i).to_arithmetic();
                    self.c[first + i] = row.scale(unit.recip());
                }
            }
        }
    }
    /// Each part with those of the groups before its own, and those that begin here with themselves.
    #[inline(always)]
    fn meet_all(&mut self, k: usize, out: &mut [Arithmetic<T>]) {
        let Meeting { groups, begins, .. } = &self.meetings[k];
        for (g, group) in groups.iter().enumerate() {
            for &part in group.iter().filter(|_| g > 0 || *begins > 0) {
                let (first, _, m) = self.part(part);
                for i in 0..m {
                    self.accelerations[i] = self.upsilon.acceleration(k, self.c[first + i]);
                }
                if g < *begins {
                    self.meet(part, part, out);
                }
                for &other in groups[..g].iter().flatten() {
                    self.meet(part, other, out);
                }
            }
        }
    }
    /// Adds C Υ C* of two parts, the first of which has its accelerations set.
    #[inline(always)]
    fn meet(&self, part: usize, other: usize, out: &mut [Arithmetic<T>]) {
        let (_, row, m) = self.part(part);
        let (first, column, count) = self.part(other);
        for i in 0..m {
            // A part with itself: one triangle, written twice.
            for j in if part == other { i..count } else { 0..count } {
                let x = self.accelerations[i].dot(self.c[first + j]);
                self.add((row + i, column + j), part == other && i == j, x, out);
            }
        }
    }
    /// Adds to an entry and, unless it is one with `itself`, to the one across the diagonal: two parts of one loop give both.
    #[inline(always)]
    fn add(&self, (i, j): (usize, usize), itself: bool, x: Arithmetic<T>, out: &mut [Arithmetic<T>]) {
        out[i * self.structure.rows + j] += x;
        if !itself {
            out[j * self.structure.rows + i] += x;
        }
    }
    #[inline(always)]
    fn merge(&mut self, (into, from): (usize, usize)) {
        let (to, _, m) = self.part(into);
        let (first, ..) = self.part(from);
        for i in 0..m {
            let c = self.c[first + i];
            self.c[to + i] += c;
        }
    }
    /// ψ of what goes on.
    #[inline(always)]
    fn pass(&mut self, k: usize) {
        for i in 0..self.meetings[k].passes.len() {
            let (first, _, m) = self.part(self.meetings[k].passes[i]);
            for at in first..first + m {
                let mut residuals = [Arithmetic::<T>::splat(0.0); 6];
                self.c[at] = self.upsilon.filter(&self.layout, k, self.c[at], &mut residuals);
                self.nu[at] = -residuals[0];
            }
        }
    }
    /// Couplings on the joint of a body, with what has come through it and with themselves.
    #[inline(always)]
    fn push(&mut self, k: usize, out: &mut [Arithmetic<T>]) {
        let parent = self.tree.bodies[k].parent;
        for at in 0..self.meetings[k].pushes.len() {
            let (part, coefficient) = self.meetings[k].pushes[at];
            let coefficient = coefficient.to_arithmetic();
            let (first, row, _) = self.part(part);
            let mut residuals = [Arithmetic::<T>::splat(0.0); 6];
            residuals[0] = -coefficient;
            self.c[first] = self.upsilon.filter(&self.layout, k, Wrench::zero(), &mut residuals);
            self.nu[first] = -residuals[0];
            let acceleration = self.upsilon.acceleration(parent, self.c[first]);
            self.accelerations[0] = acceleration;
            let Meeting { passes, pushes, .. } = &self.meetings[k];
            let before = pushes[..at].iter().map(|(part, _)| *part);
            for other in passes.iter().copied().chain(before).chain([part]) {
                let (first, column, m) = self.part(other);
                for j in 0..m {
                    let x = acceleration.dot(self.c[first + j]) + coefficient * self.nu[first + j];
                    self.add((row, column + j), part == other, x, out);
                }
            }
        }
    }
}

pub(crate) struct Gather<'a, T: Number> {
    work: &'a mut ClosureCompliance<T>,
    out: &'a mut [Arithmetic<T>],
}

impl<T: Number> Kernel for Gather<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        self.work.gather(self.out);
    }
}

/// Where parts begin, meet and become one.
fn meetings<T: Number>(structure: &Structure<T>, tree: &Tree<T>) -> Vec<Meeting<T>> {
    let n = tree.len();
    let empty = Meeting {
        groups: Vec::new(),
        begins: 0,
        merges: Vec::new(),
        passes: Vec::new(),
        pushes: Vec::new(),
        merges_inboard: Vec::new(),
    };
    let mut meetings = vec![empty; n];
    // Of every body its base, and of every base the parts that its tree has.
    let mut base = vec![0; n];
    for (k, body) in tree.bodies.iter().enumerate() {
        base[k] = if body.parent == GROUND { k } else { base[body.parent] };
    }
    let mut all = vec![0; n];
    for (of, l) in structure.loops.iter().enumerate() {
        match l.kind {
            LoopKind::Frames { a, b, .. } => {
                for (side, end) in [a, b].into_iter().enumerate().filter(|(_, end)| end.body != GROUND) {
                    meetings[end.body].groups.push(vec![2 * of + side]);
                    meetings[end.body].begins += 1;
                    all[base[end.body]] += 1;
                }
            }
            LoopKind::Gear { v, multiplier, .. } => {
                for (side, coefficient) in [T::one(), -multiplier].into_iter().enumerate() {
                    let moves = |b: &crate::tree::TreeBody<T>| (b.v..b.v + b.nv).contains(&v[side]);
                    let Some(k) = tree.bodies.iter().position(moves) else { continue };
                    meetings[k].pushes.push((2 * of + side, coefficient));
                    all[base[k]] += 1;
                }
            }
        }
    }
    let mut gathered = vec![0; n];
    for k in (0..n).rev() {
        let mut live: Vec<usize> = Vec::new();
        for part in meetings[k].groups.concat() {
            join(&mut live, part, &mut meetings[k].merges);
        }
        gathered[k] += meetings[k].begins;
        if gathered[k] == all[base[k]] {
            continue;
        }
        meetings[k].passes = live.clone();
        gathered[k] += meetings[k].pushes.len();
        for (part, _) in meetings[k].pushes.clone() {
            join(&mut live, part, &mut meetings[k].merges_inboard);
        }
        let parent = tree.bodies[k].parent;
        if parent != GROUND {
            gathered[parent] += gathered[k];
            if !live.is_empty() && gathered[k] < all[base[k]] {
                meetings[parent].groups.push(live);
            }
        }
    }
    meetings
}

/// Adds a part to those that are there, or to the other part of its loop.
fn join(live: &mut Vec<usize>, part: usize, merges: &mut Vec<(usize, usize)>) {
    match live.iter().find(|other| **other / 2 == part / 2) {
        Some(&other) => merges.push((other, part)),
        None => live.push(part),
    }
}

/// [`ClosureCompliance::run`] for a single call: rows² numbers, by rows.
///
/// # Errors
/// As there, and as [`ClosureCompliance::new`].
///
/// # Example
/// ```
/// use phipsi_closure::closure_compliance;
/// use phipsi_model::{Body, Closure, ClosureKind, Inertia, Joint, JointKind, ModelBuilder, Placement};
/// // A bead of 2 kg on three rails is held by a rod to the origin.
/// let model = ModelBuilder::new("bead")
///     .body(Body::new("bead", Inertia::from_principal(2.0, [0.0; 3], [0.0; 3])))
///     .joint(Joint::new("place", JointKind::Translation), "world", "bead")
///     .closure(Closure {
///         name: "rod".into(),
///         kind: ClosureKind::Distance { length: 1.0 },
///         body_a: "world".into(),
///         pose_a: Placement::IDENTITY,
///         body_b: "bead".into(),
///         pose_b: Placement::IDENTITY,
///     })
///     .build()?;
/// let compliance = closure_compliance::<f64>(&model, &[0.6, 0.0, 0.8])?;
/// assert!((compliance[0] - 0.5).abs() < 1e-15); // 1/kg along the rod
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn closure_compliance<T: Number>(model: &Model, q: &[T]) -> Result<Vec<T>, ClosureError> {
    let mut work = ClosureCompliance::new(model)?;
    let mut out = vec![T::zero(); work.rows() * work.rows()];
    work.run(q, &mut out)?;
    Ok(out)
}
