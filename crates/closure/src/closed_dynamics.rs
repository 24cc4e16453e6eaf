//! Forward dynamics of mechanisms with loops.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | 𝓜, C | mass matrix and bias of the tree | n×n, n | paper 2 (4.12) |
//! | J | rows of all closures on v: Jv = γ̇ | m×n | paper 2 §4.6 |
//! | λ | multipliers: forces of the closures on the body of frame B, in the axes of A at the origin of B | m | |
//! | T | generalised forces | n | |
//!
//! What it solves: 𝓜θ̈ + C = T + J*λ, Jθ̈ + J̇v = γ̈, in one inward and one outward sweep; with prescribed degrees of freedom for
//! the passive ones. Steps and symbols of the sweeps are in `factors.rs` and `solution.rs`.

use crate::compiled::Number;
use crate::error::{ClosureError, check_length};
use crate::factors::Factors;
use crate::frames::Frames;
use crate::number::Arithmetic;
use crate::solution::{Inconsistency, Load, Solution};
use crate::structure::{LoopKind, Structure};
use crate::tree::Tree;
pub(crate) use motion::Rates;
use phipsi_model::Model;
use phipsi_recursion::{InverseDynamics, Layout};
use phipsi_spatial::{Vec3, Wrench};
pub(crate) use square_root::Solve;
use square_root::SquareRoot;
use std::ops::Range;

mod choice;
mod form;
mod loss;
mod motion;
mod solved;
mod square_root;

pub use choice::ClosedFormChoice;
pub use form::ClosedForm;
pub use loss::HeavyBody;
pub use solved::Solved;

/// Positions, velocities and accelerations that closures are given at this instant: one number per row, rad and m.
///
/// An angular row counts the rotation vector from frame A to frame B: more than small angles only about one axis.
#[derive(Clone, Copy, Debug)]
pub struct ClosureMotion<'a, T> {
    /// γ.
    pub position: &'a [T],
    /// γ̇.
    pub velocity: &'a [T],
    /// γ̈.
    pub acceleration: &'a [T],
}

/// Degrees of freedom whose accelerations are given.
#[derive(Clone, Copy, Debug)]
pub struct Prescribed<'a, T> {
    /// Which ones; nv.
    pub active: &'a [bool],
    /// Their accelerations; nv, the passive ones' are not read.
    pub acceleration: &'a [T],
}

/// What is given besides state and forces.
#[derive(Clone, Copy, Debug)]
pub struct Conditions<'a, T> {
    /// Wrenches on the bodies of the model, one each, at the body frame's origin, in its axes.
    pub wrenches: Option<&'a [Wrench<T>]>,
    /// Moving closures.
    pub motion: Option<ClosureMotion<'a, T>>,
    /// Prescribed degrees of freedom.
    pub prescribed: Option<Prescribed<'a, T>>,
}

impl<T> Default for Conditions<'_, T> {
    fn default() -> Self {
        Conditions { wrenches: None, motion: None, prescribed: None }
    }
}

/// How good a result is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosedInfo {
    /// Rows of all closures.
    pub rows: usize,
    /// Independent ones among them.
    pub rank: usize,
    /// σ: the smallest pivot that was kept, over the scale of its loop; infinite without loops.
    pub smallest_pivot: f64,
    /// The smallest ratio of a kept to a dropped pivot of one loop.
    pub gap: f64,
    /// Relative error to expect of accelerations: ε/σ; of the plain form ε/σ².
    pub error_estimate: f64,
    /// σ below 1e-6, or kept and dropped pivots within a factor of 1000: accelerations are good to about ε/σ.
    pub near_singular: bool,
    /// Largest residual of the positions, m or rad.
    pub position_error: f64,
    /// Largest residual of the velocities, m/s or rad/s.
    pub velocity_error: f64,
    /// The worst redundant row that contradicts the others: a prescribed motion that the loops do not allow.
    pub inconsistency: Option<Inconsistency>,
    /// The form that the state was solved in: mixed, plain or square root.
    pub form: ClosedForm,
}

/// Forward dynamics of a model with loops: a workspace, made once; no allocation afterwards.
///
/// # Computes
/// θ̈ with 𝓜θ̈ + C = T + J*λ and Jθ̈ + J̇v = γ̈, J of any rank.
///
/// # Shapes & units
/// As forward dynamics of trees. Rows of closures in the order of [`Model::closures`], then [`Model::couplings`]; what each
/// row is: [`phipsi_model::ClosureKind`]; rad, m, N·m, N.
///
/// # Method
/// Gauss' principle: the articulated sweep minimises the joints' residuals subject to the loops' rows, and each loop is closed
/// in the body in which its branches meet, by a pivoted QR of its unsquared rows. Paper 2 §4.6 (4.20)–(4.23) is the same with
/// squared rows, for independent loops. [`Self::with_form`] offers a form with squared rows where that is certain about the rank.
///
/// # Cost
/// O(Σ m_k²) over joints with m_k open rows: linear in bodies and loops where loops are local. Flexible bodies are split into
/// their hinge frame and their modes, which a loop passes as a joint of n degrees of freedom.
///
/// # Accuracy
/// n·ε·κ; near singular positions ε/σ with σ = [`ClosedInfo::smallest_pivot`]. Rows are redundant if their pivot is below
/// 64 ε √ρ + 10 e/L of the loop's scale, e its residual and L the scene's length.
///
/// # Example
/// ```
/// use phipsi_closure::{ClosedDynamics, Conditions};
/// use phipsi_model::{Body, Closure, ClosureKind, Inertia, Joint, JointKind, ModelBuilder, Placement};
/// let rod = |name: &str| Body::new(name, Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 0.1, 0.1]));
/// let hinge = |name: &str, x: f64| {
///     let kind = JointKind::Revolute { axis: [0.0, 1.0, 0.0] };
///     Joint::new(name, kind).at(Placement::from_xyz_rpy([x, 0.0, 0.0], [0.0; 3]))
/// };
/// // A four-bar: two cranks on the ground, a coupler on the first, its far end on the second.
/// let model = ModelBuilder::new("four-bar")
///     .body(rod("crank")).body(rod("coupler")).body(rod("rocker"))
///     .joint(hinge("a", 0.0), "world", "crank")
///     .joint(hinge("b", 1.0), "crank", "coupler")
///     .joint(hinge("c", 1.0), "world", "rocker")
///     .closure(Closure {
///         name: "pin".into(),
///         kind: ClosureKind::Spherical,
///         body_a: "coupler".into(),
///         pose_a: Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3]),
///         body_b: "rocker".into(),
///         pose_b: Placement::from_xyz_rpy([1.0, 0.0, 0.0], [0.0; 3]),
///     })
///     .build()?;
/// let mut dynamics = ClosedDynamics::<f64>::new(&model)?;
/// let mut acceleration = [0.0; 3];
/// let solved =
///     dynamics.run(&[1.0, -1.0, 1.0], &[0.5, -0.5, 0.5], &[0.0; 3], &Conditions::default(), &mut acceleration)?;
/// assert_eq!(solved.info().rank, 2); // the third row, across the plane, is implied
/// assert!((acceleration[0] - acceleration[2]).abs() < 1e-13); // a parallelogram
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ClosedDynamics<T: Number> {
    pub(crate) layout: Layout<T>,
    pub(crate) tree: Tree<T>,
    pub(crate) structure: Structure<T>,
    pub(crate) frames: Frames<T>,
    pub(crate) factors: Factors<T>,
    pub(crate) solution: Solution<T>,
    pub(crate) rates: Vec<T>,
    /// An increment, where it leads and where it began, in projections.
    pub(crate) step: Vec<T>,
    pub(crate) trial: Vec<T>,
    pub(crate) origin: Vec<T>,
    /// The model without its loops.
    pub(crate) model: Model,
    form: ClosedForm,
    square_root: Option<SquareRoot<T>>,
    omega: Vec<Vec3<Arithmetic<T>>>,
    inverse: InverseDynamics<T>,
    work: Vec<T>,
}

impl<T: Number> ClosedDynamics<T> {
    /// A workspace for a model; finds the order in which its loops are closed.
    ///
    /// # Errors
    /// [`ClosureError::Coupling`] if a coupled joint has not one degree of freedom.
    pub fn new(model: &Model) -> Result<Self, ClosureError> {
        let open = model.clone().without_closures();
        let layout = Layout::new(&open);
        let tree = Tree::new(&layout);
        let structure = Structure::new(model, &layout, &tree)?;
        Ok(ClosedDynamics {
            frames: Frames::new(&structure, &layout, &tree),
            factors: Factors::new(&structure, &layout, &tree),
            solution: Solution::new(&structure, &layout, &tree),
            rates: vec![T::zero(); structure.rows],
            step: vec![T::zero(); layout.nv()],
            trial: vec![T::zero(); layout.nq()],
            origin: vec![T::zero(); layout.nq()],
            omega: vec![Vec3::zero(); tree.len()],
            inverse: InverseDynamics::new(&layout),
            work: vec![T::zero(); layout.nv()],
            layout,
            tree,
            structure,
            model: open,
            form: ClosedForm::Mixed,
            square_root: None,
        })
    }
    /// The same, where lengths and directions of the model are known to a relative error only: rows that are redundant but for it
    /// count as redundant. For a wider scalar than the model's numbers have.
    pub fn with_data_error(mut self, relative: f64) -> Self {
        self.factors.data_error = relative;
        self
    }
    /// The tree, for algorithms that need no loops.
    pub fn layout(&self) -> &Layout<T> {
        &self.layout
    }
    /// Number of closures and couplings.
    pub fn closures(&self) -> usize {
        self.structure.loops.len()
    }
    /// Rows of all closures.
    pub fn rows(&self) -> usize {
        self.structure.rows
    }
    /// Name of closure i (of a coupling: its following joint) and its rows among all rows.
    pub fn closure(&self, i: usize) -> (&str, Range<usize>) {
        let l = &self.structure.loops[i];
        (&l.name, l.rows.clone())
    }
    /// What row `row` of closure i keeps, in words.
    pub fn direction(&self, i: usize, row: usize) -> &'static str {
        match self.structure.loops[i].kind {
            LoopKind::Frames { kind, .. } => kind.direction(row),
            LoopKind::Gear { .. } => "ratio",
        }
    }
    /// Σ over joints of (rows of the loops open there)²: what the choice of the tree costs.
    pub fn nesting(&self) -> usize {
        self.structure.nesting
    }
    /// Length that angular rows are multiplied with before sizes are compared, m.
    pub fn length(&self) -> f64 {
        self.structure.length
    }
    /// Bodies on the longest path of the tree.
    pub(crate) fn depth(&self) -> usize {
        self.structure.depth
    }
    /// Accelerations. `q`: nq, `v`, `tau`, `out`: nv.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`]: a length, or a joint without articulated inertia; [`ClosureError::NotFinite`];
    /// [`ClosureError::PrescribedMode`]; [`ClosureError::PlainForm`] where only the plain form is allowed.
    pub fn run(
        &mut self,
        q: &[T],
        v: &[T],
        tau: &[T],
        conditions: &Conditions<'_, T>,
        out: &mut [T],
    ) -> Result<Solved<'_, T>, ClosureError> {
        check_length("v", v, self.layout.nv())?;
        check_length("tau", tau, self.layout.nv())?;
        check_length("out", out, self.layout.nv())?;
        self.set_position(q, conditions)?;
        let active = conditions.prescribed.map(|p| p.active);
        self.check_passive(active)?;
        if self.square_root.is_none() {
            self.factor(active)?;
        }
        let velocity_error = T::rates(Rates { dynamics: self, state: (q, v), conditions });
        let [x, y, z] = self.layout.gravity().0;
        let load = Load {
            tau: Some(T::arithmetic(tau)),
            prescribed: conditions.prescribed.map(|p| T::arithmetic(p.acceleration)),
            ground: -Vec3([x.to_arithmetic(), y.to_arithmetic(), z.to_arithmetic()]),
        };
        match &mut self.square_root {
            None => {
                self.solution.run(&self.structure, &self.tree, &self.frames, &self.factors, &load, out);
            }
            Some(square_root) => T::solve_by_square_roots(Solve {
                square_root,
                structure: &self.structure,
                layout: &self.layout,
                tree: &self.tree,
                frames: &self.frames,
                factors: &mut self.factors,
                solution: &mut self.solution,
                omega: &self.omega,
                wrenches: conditions.wrenches,
                active,
                load: &load,
                out: T::arithmetic_mut(out),
            })?,
        }
        if let Some(i) = out.iter().position(|x| !x.is_finite()) {
            let (joint, component) = self.layout.joint_of_velocity(i);
            return Err(ClosureError::NotFinite { joint: joint.into(), component, found: out[i].to_f64() });
        }
        let info = self.info(velocity_error);
        Ok(Solved { dynamics: self, info })
    }
    /// Checks lengths and sets poses and residuals.
    pub(crate) fn set_position(
        &mut self,
        q: &[T],
        conditions: &Conditions<'_, T>,
    ) -> Result<(), ClosureError> {
        check_length("q", q, self.layout.nq())?;
        if let Some(wrenches) = conditions.wrenches {
            check_length("wrenches", wrenches, self.layout.model_bodies())?;
        }
        if let Some(motion) = &conditions.motion {
            check_length("motion.position", motion.position, self.rows())?;
            check_length("motion.velocity", motion.velocity, self.rows())?;
            check_length("motion.acceleration", motion.acceleration, self.rows())?;
        }
        if let Some(prescribed) = &conditions.prescribed {
            check_length("prescribed.active", prescribed.active, self.layout.nv())?;
            check_length("prescribed.acceleration", prescribed.acceleration, self.layout.nv())?;
        }
        let gamma = conditions.motion.as_ref().map(|m| m.position);
        self.frames.set_position(&self.structure, (&self.layout, &self.tree), q, gamma);
        Ok(())
    }
    /// Sets Jv − γ̇; returns the largest.
    pub(crate) fn set_rates(&mut self, v: &[T], conditions: &Conditions<'_, T>) -> f64 {
        self.frames.set_velocity(&self.structure, &self.tree, v, &mut self.rates);
        self.given_rates(conditions)
    }
    /// Takes the rates that the closures are given from Jv; returns the largest that is left.
    #[inline(always)]
    fn given_rates(&mut self, conditions: &Conditions<'_, T>) -> f64 {
        if let Some(motion) = &conditions.motion {
            for (rate, gamma) in self.rates.iter_mut().zip(motion.velocity) {
                *rate -= *gamma;
            }
        }
        largest(&self.rates)
    }
    /// Refuses modes whose accelerations are given.
    pub(crate) fn check_passive(&self, active: Option<&[bool]>) -> Result<(), ClosureError> {
        let Some(active) = active else { return Ok(()) };
        match (self.model.joint_nv()..self.layout.nv()).find(|&i| active[i]) {
            Some(i) => Err(ClosureError::PrescribedMode { mode: self.layout.joint_of_velocity(i).0.into() }),
            None => Ok(()),
        }
    }
    fn info(&self, velocity_error: f64) -> ClosedInfo {
        let rank = self.factors.rank;
        let form = self.used_form();
        let squared = if form == ClosedForm::Plain { rank.smallest.min(1.0) } else { 1.0 };
        ClosedInfo {
            rows: self.rows(),
            rank: rank.rank,
            smallest_pivot: rank.smallest,
            gap: rank.gap,
            error_estimate: T::EPSILON / (rank.smallest * squared),
            near_singular: rank.smallest < 1e-6 || rank.gap < 1e3,
            position_error: largest(&self.frames.residual),
            velocity_error,
            inconsistency: self.solution.inconsistency,
            form,
        }
    }
    /// Residuals of all rows: Φ − γ, rad and m, and S(ω, ḋ) − γ̇ if velocities are given.
    ///
    /// # Errors
    /// [`ClosureError::Dynamics`] for a wrong length.
    pub fn residual(
        &mut self,
        q: &[T],
        v: Option<&[T]>,
        conditions: &Conditions<'_, T>,
        position: &mut [T],
        velocity: &mut [T],
    ) -> Result<(), ClosureError> {
        check_length("position", position, self.rows())?;
        self.set_position(q, conditions)?;
        position.copy_from_slice(&self.frames.residual);
        if let Some(v) = v {
            check_length("v", v, self.layout.nv())?;
            check_length("velocity", velocity, self.rows())?;
            self.set_rates(v, conditions);
            velocity.copy_from_slice(&self.rates);
        }
        Ok(())
    }
}

/// The largest number.
pub(crate) fn largest<T: Number>(x: &[T]) -> f64 {
    x.iter().fold(0.0f64, |most, x| most.max(x.abs().to_f64()))
}
