//! One right-hand side: the filter inward, the smoother and the multipliers outward.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | z | bias force | 6 | paper 1 (9.3) |
//! | s | U^−*(T − Hz) | r | paper 1 (9.9) |
//! | ζ | what ξ would be, but for Xα, if the subtree moved rigidly | ρ | |
//! | g | right-hand side of the loops' rows | m | |
//! | h | R^−*g, the part of the residuals that the loop demands | rank | |
//! | η | Q*ξ, the residuals as an operation leaves them | ρ | |
//! | λ | multipliers: R λ = η₁ − Σ W'_o λ_o | m | |
//!
//! Angular rows are multiplied with the scene's length throughout, so that λ of an angular row is a moment over that length.

use crate::compiled::Number;
use crate::factors::Factors;
use crate::frames::Frames;
use crate::number::{Arithmetic, larger, motion, size};
use crate::structure::{Operation, Structure};
use crate::tree::{Joint, Tree};
use phipsi_recursion::layout::GROUND;
use phipsi_spatial::{Kernel, Motion, Scalar, Vec3, Wrench};

mod filter;
mod modes;
mod multipliers;
mod plain;
mod smoother;

pub(crate) use multipliers::{ConstraintForce, LeastNorm};

/// A redundant row whose right-hand side is not what the others imply.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inconsistency {
    /// The closure, counted as closures, then couplings.
    pub closure: usize,
    /// The row of that closure.
    pub row: usize,
    /// By how much, relative to the terms of the row.
    pub size: f64,
}

/// A right-hand side and its solution.
#[derive(Clone, Debug)]
pub(crate) struct Solution<T: Scalar> {
    /// Bias forces and bias accelerations of the bodies: input.
    pub(crate) z: Vec<Wrench<Arithmetic<T>>>,
    pub(crate) a: Vec<Motion<Arithmetic<T>>>,
    /// Bias forces of all modes: input.
    pub(crate) z_modes: Vec<Arithmetic<T>>,
    first_mode: usize,
    /// Right-hand sides of the rows: input; and the size of their terms.
    pub(crate) g: Vec<Arithmetic<T>>,
    pub(crate) sizes: Vec<Arithmetic<T>>,
    s: Vec<Arithmetic<T>>,
    zeta: Vec<Arithmetic<T>>,
    eta: Vec<Arithmetic<T>>,
    /// ζ₁ + h of the closings.
    first: Vec<Arithmetic<T>>,
    /// What the redundant rows lack.
    lost: Vec<Arithmetic<T>>,
    stack: Vec<Arithmetic<T>>,
    x: Vec<Arithmetic<T>>,
    alpha: Vec<Motion<Arithmetic<T>>>,
    /// Σ X a over the bodies of a strand, at the frame of its end, in its axes; and Σ of their sizes.
    carried: Vec<(Motion<Arithmetic<T>>, Arithmetic<T>)>,
    pub(crate) lambda: Vec<Arithmetic<T>>,
    /// Of conjugate gradients.
    direction: Vec<Arithmetic<T>>,
    gradient: Vec<Arithmetic<T>>,
    image: Vec<Arithmetic<T>>,
    /// The largest |η₁| of all loops.
    largest: Arithmetic<T>,
    pub(crate) inconsistency: Option<Inconsistency>,
}

/// Where the residuals of a joint are while its body is dealt with.
#[derive(Clone, Copy)]
enum Own {
    /// No loop passes the joint.
    Nowhere,
    /// From this row on among all blocks' rows: the join is in place.
    Block(usize),
    /// From this row on, on the stack.
    Stack(usize),
}

/// What drives the mechanism besides z, a and g.
#[derive(Clone, Copy)]
pub(crate) struct Load<'a, S> {
    /// Generalised forces.
    pub(crate) tau: Option<&'a [S]>,
    /// Accelerations of the prescribed degrees of freedom.
    pub(crate) prescribed: Option<&'a [S]>,
    /// Acceleration of the ground.
    pub(crate) ground: Vec3<S>,
}

impl<T: Number> Solution<T> {
    pub(crate) fn new(
        structure: &Structure<T>,
        layout: &phipsi_recursion::Layout<T>,
        tree: &Tree<T>,
    ) -> Self {
        let modes = |k: usize| tree.modes(k).map_or(0, |_| tree.bodies[k].nv);
        let modes: usize = (0..tree.len()).map(modes).sum();
        let o = Arithmetic::<T>::splat(0.0);
        let most = structure.operations.iter().fold(0, |most, operation| most.max(operation.most));
        Solution {
            z: vec![Wrench::zero(); tree.len()],
            a: vec![Motion::zero(); tree.len()],
            z_modes: vec![o; modes],
            first_mode: layout.nv() - modes,
            g: vec![o; structure.rows],
            sizes: vec![o; structure.rows],
            s: vec![o; layout.nv()],
            zeta: vec![o; structure.block_rows],
            eta: vec![o; structure.block_rows],
            first: vec![o; structure.operation_rows],
            lost: vec![o; structure.rows],
            stack: vec![o; most],
            x: vec![o; most],
            alpha: vec![Motion::zero(); tree.len()],
            carried: vec![(Motion::zero(), o); structure.strands.len()],
            lambda: vec![o; structure.rows],
            direction: vec![o; structure.rows],
            gradient: vec![o; structure.rows],
            image: vec![o; structure.rows],
            largest: o,
            inconsistency: None,
        }
    }
    /// No forces, no biases, no right-hand side.
    pub(crate) fn clear(&mut self) {
        self.z.fill(Wrench::zero());
        self.a.fill(Motion::zero());
        self.z_modes.fill(Arithmetic::<T>::splat(0.0));
        self.g.fill(Arithmetic::<T>::splat(0.0));
        self.sizes.fill(Arithmetic::<T>::splat(0.0));
    }
    /// Solves; `out` gets the accelerations, `self.lambda` basic multipliers.
    #[allow(clippy::too_many_arguments)]
    pub(crate) fn run(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        out: &mut [T],
    ) {
        let out = T::arithmetic_mut(out);
        T::solve(Run { solution: self, structure, tree, frames, factors, load, out });
    }
    #[inline(always)]
    fn sweep<const PLAIN: bool>(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        out: &mut [Arithmetic<T>],
    ) {
        self.begin();
        // The ground comes last inward, and first outward.
        let ground = tree.len();
        for k in (0..ground).rev().chain([ground]) {
            for index in structure.stations[k].closes.clone() {
                if !PLAIN {
                    self.take_carried(structure, frames, index);
                }
                self.close::<PLAIN>(structure, factors, index, k);
            }
            if k == ground {
                break;
            }
            let body = &tree.bodies[k];
            match body.joint {
                Joint::Modes(i) => self.filter_modes(structure, factors, load, k, (i, body.v, body.nv)),
                _ => self.filter::<PLAIN>(structure, tree, frames, factors, load, k),
            }
            if body.parent != GROUND {
                let z = frames.poses[k].wrench_to_parent(self.z[k]);
                self.z[body.parent] += z;
                if let Some(first) = structure.attached[k] {
                    let flexible = &tree.bodies[body.parent];
                    let modes = &mut self.z_modes[flexible.v - self.first_mode..][..flexible.nv];
                    for (sum, screw) in modes.iter_mut().zip(&frames.screws[first..]) {
                        *sum += motion(*screw).dot(z);
                    }
                }
            }
        }
        self.sweep_outboard::<PLAIN, false>(structure, tree, frames, factors, load, out);
    }
    /// Before a sweep: sizes of the rows' terms, nothing carried.
    #[inline(always)]
    pub(crate) fn begin(&mut self) {
        for (term, g) in self.sizes.iter_mut().zip(&self.g) {
            *term = larger(*term, size(*g));
        }
        self.carried.fill((Motion::zero(), Arithmetic::<T>::splat(0.0)));
    }
    /// The smoother; `ASCENDING` where the last degree of freedom of a joint was eliminated first.
    #[inline(always)]
    pub(crate) fn sweep_outboard<const PLAIN: bool, const ASCENDING: bool>(
        &mut self,
        structure: &Structure<T>,
        tree: &Tree<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        load: &Load<'_, Arithmetic<T>>,
        out: &mut [Arithmetic<T>],
    ) {
        let ground = tree.len();
        self.largest = if PLAIN { self.free(structure, tree) } else { Arithmetic::<T>::splat(0.0) };
        let at_ground = Motion::new(Vec3::zero(), load.ground);
        for k in [ground].into_iter().chain(0..ground) {
            let mut alpha = at_ground;
            if k < ground {
                let body = &tree.bodies[k];
                let mut inboard = if body.parent == GROUND { at_ground } else { self.alpha[body.parent] };
                if let Some(first) = structure.attached[k] {
                    let flexible = &tree.bodies[body.parent];
                    let rates = &out[flexible.v..flexible.v + flexible.nv];
                    for (screw, x) in frames.screws[first..].iter().zip(rates) {
                        inboard += motion(*screw).scale(*x);
                    }
                }
                let inboard = frames.poses[k].motion_to_child(inboard);
                match body.joint {
                    Joint::Modes(i) => {
                        self.smooth_modes(structure, factors, k, (i, body.v, body.nv), inboard, out);
                    }
                    _ => self.smooth::<PLAIN, ASCENDING>(structure, tree, factors, load, k, inboard, out),
                }
                alpha = self.alpha[k];
            }
            for index in structure.stations[k].closes.clone().rev() {
                self.reopen::<PLAIN>(structure, factors, index, alpha);
            }
        }
        self.find_inconsistency(structure, frames, factors, load.ground);
    }
    /// The redundant row that lacks most, measured by its terms, the largest residual of all loops and the largest acceleration.
    #[inline(always)]
    fn find_inconsistency(
        &mut self,
        structure: &Structure<T>,
        frames: &Frames<T>,
        factors: &Factors<T>,
        ground: Vec3<Arithmetic<T>>,
    ) {
        self.inconsistency = None;
        if factors.redundant.is_empty() {
            return;
        }
        let length = Arithmetic::<T>::splat(structure.length);
        let mut fastest = most_of(ground);
        for alpha in &self.alpha {
            fastest = larger(fastest, length.fma(most_of(alpha.angular), most_of(alpha.linear)));
        }
        for &index in &structure.closings {
            let (operation, done) = (&structure.operations[index], &factors.done[index]);
            let of = operation.closes.unwrap_or(0);
            let start = structure.loops[of].rows.start;
            for row in 0..operation.closing {
                let lost = size(self.lost[start + row]).min_lane();
                let terms = larger(self.sizes[start + row], fastest) / done.scale;
                let size = larger(self.largest, terms).min_lane();
                // A row that is open by e cannot be more consistent than that.
                let allowed = 1e-9 + 10.0 * frames.errors[of];
                if lost > allowed * size {
                    let size = lost / size;
                    if self.inconsistency.is_none_or(|worst| worst.size < size) {
                        self.inconsistency = Some(Inconsistency { closure: of, row, size });
                    }
                }
            }
        }
    }
}

pub(crate) struct Run<'a, T: Number> {
    solution: &'a mut Solution<T>,
    structure: &'a Structure<T>,
    tree: &'a Tree<T>,
    frames: &'a Frames<T>,
    factors: &'a Factors<T>,
    load: &'a Load<'a, Arithmetic<T>>,
    out: &'a mut [Arithmetic<T>],
}

impl<T: Number> Kernel for Run<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Run { solution, structure, tree, frames, factors, load, out } = self;
        if factors.plain.used {
            solution.sweep::<true>(structure, tree, frames, factors, load, out);
        } else {
            solution.sweep::<false>(structure, tree, frames, factors, load, out);
        }
    }
}

/// The first row that a join in place appends to its block, among all blocks' rows.
#[inline(always)]
fn appended<T: Number>(structure: &Structure<T>, factors: &Factors<T>, operation: &Operation) -> usize {
    let first = operation.output.map_or(0, |b| structure.blocks[b].row);
    first + operation.inputs.first().map_or(0, |(b, _)| factors.block_rows[*b])
}

/// The largest component of a vector.
#[inline(always)]
fn most_of<S: Scalar>(x: Vec3<S>) -> S {
    let [x, y, z] = x.0;
    larger(larger(size(x), size(y)), size(z))
}
