//! The square-root form: bodies as rows [S | y] of Gauss' sum of squares, loops as in the mixed form, in one inward sweep.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | S, y | Σ ½‖Sα + y‖² of a body, what hangs on it and the loops closed there; S*S = P | rows×6, rows | soa.md 2.2 |
//! | p | linear term p·α: forces that no inertia carries, and joint forces | 6 | soa.md 2.2 |
//! | U, Ξ | row that a degree of freedom takes out of the others: U ẍ + Ξα⁺ + y | 1, 6 | paper 1 (9.5)–(9.6) |
//! | s | (T − Hp)/U − y | 1 | paper 1 (9.9) |
//! | X₁, ζ₁ + h | what a closed loop leaves: r more rows on its ancestor | r×6, r | `factors.rs`, `solution.rs` |
//!
//! P − Ξ*Ξ and z + Ξ*s lose ε × (mass ratio) where heavy bodies hang on light ones; reflections of rows do not. W, X, ζ and the
//! order of closing are those of the mixed form, but degrees of freedom of one joint go in the reverse order, displacements first.

use crate::compiled::Number;
use crate::factors::{Factors, Regard};
use crate::frames::Frames;
use crate::number::{Arithmetic, plain, wrench};
use crate::solution::{Load, Solution};
use crate::structure::Structure;
use crate::tree::{Tree, TreeBody};
use phipsi_model::Model;
use phipsi_recursion::layout::GROUND;
use phipsi_recursion::square_root_forward_dynamics::body::BodyRows;
use phipsi_recursion::square_root_forward_dynamics::rows::{Held, Row, Rows, covector, zero};
use phipsi_recursion::{DynamicsError, Layout};
use phipsi_spatial::{Kernel, Motion, Scalar, Vec3, Wrench};

/// Rows of all bodies; none in a workspace of another form.
#[derive(Clone, Debug)]
pub(crate) struct SquareRoot<T: Scalar> {
    bodies: Vec<BodyRows<T>>,
    held: Vec<Held<T>>,
    /// The opposite of the external wrench on each body, and p of its children.
    load: Vec<Wrench<T>>,
    linear: Vec<Wrench<T>>,
    stack: Rows<T>,
    at_parent: Rows<T>,
}

impl<T: Number> SquareRoot<T> {
    pub(super) fn new(model: &Model, layout: &Layout<T>) -> Self {
        let n = layout.len();
        SquareRoot {
            bodies: BodyRows::of_layout(model, layout),
            held: vec![([zero(); 6], 0); n],
            load: vec![Wrench::zero(); n],
            linear: vec![Wrench::zero(); n],
            stack: Rows::new(),
            at_parent: Rows::new(),
        }
    }
    fn clear(&mut self, layout: &Layout<T>, wrenches: Option<&[Wrench<T>]>) {
        self.held.iter_mut().for_each(|held| held.1 = 0);
        self.load.fill(Wrench::zero());
        self.linear.fill(Wrench::zero());
        for (carrier, wrench) in layout.carriers().iter().zip(wrenches.unwrap_or_default()) {
            if carrier.body != GROUND {
                self.load[carrier.body] -= carrier.pose.wrench_to_parent(*wrench);
            }
        }
    }
}

/// Factors and accelerations of one state.
pub(crate) struct Solve<'a, T: Number> {
    pub(super) square_root: &'a mut SquareRoot<T>,
    pub(super) structure: &'a Structure<T>,
    pub(super) layout: &'a Layout<T>,
    pub(super) tree: &'a Tree<T>,
    pub(super) frames: &'a Frames<T>,
    pub(super) factors: &'a mut Factors<T>,
    pub(super) solution: &'a mut Solution<T>,
    pub(super) omega: &'a [Vec3<Arithmetic<T>>],
    pub(super) wrenches: Option<&'a [Wrench<T>]>,
    pub(super) active: Option<&'a [bool]>,
    pub(super) load: &'a Load<'a, Arithmetic<T>>,
    pub(super) out: &'a mut [Arithmetic<T>],
}

impl<T: Number> Kernel for Solve<'_, T> {
    type Output = Result<(), DynamicsError>;
    #[inline(always)]
    fn run(mut self) -> Self::Output {
        let structure = self.structure;
        self.factors.clear(self.tree, self.frames, self.active);
        self.solution.begin();
        self.square_root.clear(self.layout, self.wrenches);
        let ground = self.tree.len();
        for k in (0..ground).rev().chain([ground]) {
            self.factors.begin(structure, self.frames, k);
            self.square_root.stack.clear();
            if let Some((rows, count)) = self.square_root.held.get(k) {
                rows[..*count].iter().for_each(|row| self.square_root.stack.push(*row));
            }
            for index in structure.stations[k].closes.clone() {
                self.close(index, k);
            }
            if k == ground {
                break;
            }
            self.join(k)?;
            let body = &self.tree.bodies[k];
            self.factors.shift(structure, self.frames, k, (body.v..body.v + body.nv).rev());
        }
        let Solve { structure, tree, frames, factors, solution, load, out, .. } = self;
        solution.sweep_outboard::<false, true>(structure, tree, frames, factors, load, out);
        Ok(())
    }
}

impl<T: Number> Solve<'_, T> {
    /// Closes a loop at body k: its rows there.
    #[inline(always)]
    fn close(&mut self, index: usize, k: usize) {
        let Solve { square_root, structure, frames, factors, solution, .. } = self;
        factors.close(structure, index, k, Regard::Error);
        solution.take_carried(structure, frames, index);
        solution.close::<false>(structure, factors, index, k);
        if k == square_root.bodies.len() {
            return;
        }
        let operation = &structure.operations[index];
        for t in 0..factors.done[index].rank {
            let x = factors.x_row(operation, t).map(T::from_arithmetic);
            let [a, b, c, d, e, f] = x.to_array();
            let y = T::from_arithmetic(solution.first(operation, t));
            let size = |x: Vec3<T>| x.0[0].abs() + x.0[1].abs() + x.0[2].abs();
            square_root.stack.push([a, b, c, d, e, f, y, size(x.moment), size(x.force)]);
        }
        square_root.stack.compress();
    }
    /// The joint of body k: its rows go out of those of the body, and into the front.
    #[inline(always)]
    fn join(&mut self, k: usize) -> Result<(), DynamicsError> {
        let Solve { square_root, structure, layout, tree, frames, factors, solution, load, omega, .. } = self;
        let SquareRoot { bodies, held, load: wrenches, linear, stack, at_parent } = square_root;
        let body = &tree.bodies[k];
        let Some(hinge) = body.hinge() else { return Ok(()) };
        let left =
            bodies[k].rows(Vec3(omega[k].0.map(T::from_arithmetic)), wrenches[k], |row| stack.push(row));
        let mut p = linear[k] + left;
        let a = solution.carry::<false>(structure, tree, frames, factors, load, k);
        let a =
            Motion::new(Vec3(a.angular.0.map(T::from_arithmetic)), Vec3(a.linear.0.map(T::from_arithmetic)));
        for row in stack.get_mut() {
            row[6] += a.dot(covector(row));
        }
        // A helical hinge moves along its axis too: while rows and p are joined, its column is that of its angle.
        let pitch = if hinge.nv() == 1 { hinge.axis::<T>(0).linear.0[2] } else { T::zero() };
        let helical = hinge.components() == [2] && pitch != T::zero();
        if helical {
            stack.join(pitch);
            p.moment.0[2] += pitch * p.force.0[2];
        }
        let first = factors.first_row::<false>(structure, k);
        let mut passed = 0;
        for (i, &column) in hinge.components().iter().enumerate().rev() {
            let at = body.v + i;
            if !factors.is_passive(at) {
                factors.prescribe(at);
                continue;
            }
            let row =
                take(stack, column).ok_or_else(|| factors.singular(layout, at, stack.square(column)))?;
            let tau = load.tau.map_or(T::zero(), |tau| T::from_arithmetic(tau[at]));
            let mut xi = covector(&row);
            let share = (tau - p.get(column)) / row[column];
            p += xi.scale(share);
            if helical {
                xi.moment.0[2] -= pitch * xi.force.0[2];
            }
            solution.set_innovation(at, (share - row[6]).to_arithmetic());
            factors.eliminated(
                structure,
                (k, at, i),
                hinge,
                (wrench(xi), row[column].to_arithmetic()),
                first + passed,
            );
            passed += 1;
        }
        factors.finish_join(structure, k, passed, first + passed);
        solution.enter_innovations(structure, factors, k, (body.v..body.v + body.nv).rev());
        if body.parent == GROUND {
            return Ok(());
        }
        let given = |at: usize| load.tau.map_or(T::zero(), |tau| T::from_arithmetic(tau[at]));
        let mut p = hinge_exact(body, hinge.components(), p, |at| factors.is_passive(at).then(|| given(at)));
        if p != Wrench::zero() || stack.get().len() > 6 - passed {
            stack.absorb(&mut p);
        }
        if helical {
            stack.part(pitch);
            p.moment.0[2] -= pitch * p.force.0[2];
        }
        let pose = plain::<T>(&frames.poses[k]);
        linear[body.parent] += pose.wrench_to_parent(p);
        at_parent.hand_over(&mut held[body.parent], &pose, stack.get());
        Ok(())
    }
}

/// The row that alone has an entry in a column from here on, if the column is more than rounding.
#[inline(always)]
fn take<T: Number>(stack: &mut Rows<T>, column: usize) -> Option<Row<T>> {
    if stack.is_rounding(column) { None } else { stack.take(column) }
}

/// p inboard of a joint, whose passive components are the joint's own forces exactly, whatever the size of p.
#[inline(always)]
fn hinge_exact<T: Number>(
    body: &TreeBody<T>,
    components: &[usize],
    p: Wrench<T>,
    given: impl Fn(usize) -> Option<T>,
) -> Wrench<T> {
    let mut entries = p.to_array();
    for (i, &column) in components.iter().enumerate() {
        if let Some(tau) = given(body.v + i) {
            entries[column] = tau;
        }
    }
    Wrench::from_array(entries)
}
