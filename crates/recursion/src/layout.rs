//! The compiled form of a model that the sweeps run on.
//!
//! Fixed joints are fused into the body that carries them; a universal joint becomes two hinges with a massless body
//! between; frames are turned so that every joint axis is a coordinate axis (z for one-axis joints), and about that axis so
//! that the passage to one child needs one turn less (`link.rs`). Each body of the model keeps its pose in the layout
//! body that carries it, so results come back in the user's frames and names.
//!
//! Bodies are stored depth first: a body's first child follows it, and what a sweep carries from body to body stays in
//! registers. The model's own order stays if it is depth first and little waits for branching bodies; else, of several children
//! the one with most bodies outboard comes last, so that what waits is a stack of at most log₂ n entries.

use crate::error::DynamicsError;
use crate::flexible::{FlexibleTree, rigid_inboard, rigid_node};
use crate::hinge::Hinge;
use crate::kernel::kernel;
use crate::link::{Link, each_shape};
use core::ops::Range;
use phipsi_model::joint::rotation_from_z;
use phipsi_model::{JointKind, Model};
use phipsi_spatial::six_lanes::{RigidEntries, rigid_entries};
use phipsi_spatial::{ArticulatedInertia, Mat3, Real, RigidInertia, Scalar, Transform, Turn, Vec3, Wrench};

mod arrange;
mod branches;
mod limbs;
mod pending;
mod shifts;

pub use crate::link::Shift;
use arrange::{Raw, arrange};
pub(crate) use branches::{Branch, carve};
pub(crate) use limbs::{Gift, LimbPlan, Limbs};
pub(crate) use pending::Pending;
pub(crate) use shifts::{Passage, ShiftRun, Shifts, TOGETHER};

/// Marks the ground as a parent or carrier.
pub const GROUND: usize = usize::MAX;

/// A moving body of the layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayoutBody<C> {
    /// Index of its parent, or [`GROUND`].
    pub parent: usize,
    /// Number of its children.
    pub(crate) children: usize,
    /// Its inboard joint.
    pub hinge: Hinge<C>,
    /// First position coordinate, in the model's q.
    pub q: usize,
    /// First degree of freedom, in the model's v.
    pub v: usize,
    /// Joint frame in the parent's frame at q = 0.
    pub(crate) link: Link<C>,
    /// Place among the bodies on ball and free joints.
    pub(crate) general: usize,
    /// Inertia of the body and all that is fused to it, about its origin.
    pub inertia: RigidInertia<C>,
}

impl<C> LayoutBody<C> {
    /// True for a free joint on the ground.
    pub(crate) fn floats(&self) -> bool {
        self.parent == GROUND && matches!(self.hinge, Hinge::Free)
    }
}

impl<C: Real> LayoutBody<C> {
    /// Pose of the joint frame in the parent's frame: the body's pose at q = 0.
    pub fn placement(&self) -> Transform<C> {
        self.link.placement()
    }
}

impl<C: Scalar> LayoutBody<C> {
    /// Pose of the body in its parent at coordinates `q` of the whole model.
    #[inline(always)]
    pub fn pose<T: Scalar<Constant = C>>(&self, q: &[T]) -> Transform<T> {
        let (shift, general) = self.link.at(&self.hinge, &q[self.q..]);
        general.unwrap_or_else(|| self.link.pose(&shift))
    }
    /// Its passage to its parent and its pose there, where sine and cosine of its first coordinate are known. `q`: of the whole model.
    #[inline(always)]
    pub fn shift<T: Scalar<Constant = C>>(&self, q: &[T], (sin, cos): (T, T)) -> (Shift<T>, Transform<T>) {
        if let Hinge::Revolute = self.hinge {
            let shift = self.link.hinged(self.link.turned_by(Turn { cos, sin }));
            return (shift, self.link.pose(&shift));
        }
        let (shift, general) = self.link.at(&self.hinge, &q[self.q..]);
        (shift, general.unwrap_or_else(|| self.link.pose(&shift)))
    }
    /// φ(p, k) (P − G H P) φ*(p, k) of a hinge about an axis or a slider along it with gain G; of other joints none.
    #[inline(always)]
    pub fn eliminated_to_parent<T: Scalar<Constant = C>>(
        &self,
        shift: &Shift<T>,
        P: &ArticulatedInertia<T>,
        gain: &Wrench<T>,
    ) -> Option<ArticulatedInertia<T>> {
        match self.hinge {
            Hinge::Revolute => {
                Some(each_shape!(self.link, |link| link.eliminated_to_parent(shift.turn, P, gain)))
            }
            Hinge::Prismatic => Some(each_shape!(self.link, |link| link.slid_to_parent(shift, P, gain))),
            _ => None,
        }
    }
    /// The parent's axes, in any frame, turned into the body's; and the body's origin from the parent's, there.
    #[inline(always)]
    pub(crate) fn axes_to_child<T: Scalar<Constant = C>>(
        &self,
        q: &[T],
        axes: [Vec3<T>; 3],
    ) -> ([Vec3<T>; 3], Vec3<T>) {
        let (shift, general) = self.link.at(&self.hinge, &q[self.q..]);
        Passage { body: self, shift: &shift, general: general.as_ref() }.axes_to_child(axes)
    }
    /// True for ball and free joints.
    #[inline(always)]
    pub(crate) fn is_general(&self) -> bool {
        matches!(self.hinge, Hinge::Spherical | Hinge::Free)
    }
    /// True if the parent of body `k` is stored just before it.
    #[inline(always)]
    pub(crate) fn follows_parent(&self, k: usize) -> bool {
        self.parent.wrapping_add(1) == k && self.parent != GROUND
    }
}

/// Copies of a step for the kinds of joints that robots have besides hinges, in which the kind is a constant, and one for all
/// others: a step asks for the kind many times.
///
/// One copy without optimisation, as `link::each_shape`.
#[cfg(debug_assertions)]
macro_rules! each_kind {
    ($body:expr, |$known:ident| $step:expr) => {{
        let $known = $body;
        $step
    }};
}
#[cfg(not(debug_assertions))]
macro_rules! each_kind {
    ($body:expr, |$known:ident| $step:expr) => {
        match $body.hinge {
            $crate::hinge::Hinge::Prismatic => {
                let $known = &$crate::layout::LayoutBody { hinge: $crate::hinge::Hinge::Prismatic, ..*$body };
                $step
            }
            $crate::hinge::Hinge::Free => {
                let $known = &$crate::layout::LayoutBody { hinge: $crate::hinge::Hinge::Free, ..*$body };
                $step
            }
            _ => {
                let $known = $body;
                $step
            }
        }
    };
}
pub(crate) use each_kind;

/// Where a body of the model lives in the layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carrier<C> {
    /// The layout body, or [`GROUND`].
    pub body: usize,
    /// Pose of the user's body frame in the layout body's frame.
    pub pose: Transform<C>,
    /// The body's own inertia about its frame's origin, in the user's axes.
    pub inertia: RigidInertia<C>,
}

/// A model compiled for the sweeps, with constants in the scalar `C`.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout<C: Scalar = f64> {
    pub(crate) bodies: Vec<LayoutBody<C>>,
    pub(crate) carriers: Vec<Carrier<C>>,
    /// Most contributions that wait at once for their branching body, tip to base.
    pub(crate) waiting: usize,
    /// Degrees of freedom of every body and all outboard of it.
    pub(crate) outboard_dofs: Vec<usize>,
    /// Inertias of the bodies, for steps on packed six-vectors.
    pub(crate) rigid: Vec<RigidEntries<C>>,
    /// The tree in branches that threads can share, if it is large.
    pub(crate) branches: Option<Branch>,
    /// Limbs that are alike, in lanes, if the tree has no branches.
    pub(crate) limbs: Option<Box<LimbPlan<C>>>,
    /// Branch by branch also on a single thread.
    always_branches: bool,
    pub(crate) gravity: Vec3<C>,
    /// The whole tree, if bodies are flexible: `bodies` is empty then, and carriers count the tree's bodies.
    flexible: Option<Box<FlexibleTree<C>>>,
    nq: usize,
    nv: usize,
    /// All coordinates of hinges, and perhaps some between them: the angles whose sines sweeps need.
    angles: Range<usize>,
    joint_of_velocity: Vec<(String, usize)>,
    refused: Option<DynamicsError>,
}

impl<C: Real> Layout<C> {
    /// Compiles a model. Cost O(n).
    pub fn new(model: &Model) -> Self {
        match FlexibleTree::new(model) {
            Some((tree, carriers)) => Self::assemble(model, &[], carriers, Some(Box::new(tree))),
            None => Self::rigid(model),
        }
    }
    fn rigid(model: &Model) -> Self {
        let mut bodies: Vec<Raw<C>> = Vec::new();
        let mut carriers: Vec<Carrier<C>> = Vec::with_capacity(model.len());
        for k in 0..model.len() {
            let joint = &model.joints()[k];
            let (parent, inboard) = match model.tree().parent(k) {
                Some(p) => (carriers[p].body, carriers[p].pose),
                None => (GROUND, Transform::identity()),
            };
            let inboard = match model.attachment(k) {
                Some(_) => inboard.compose(&rigid_node(model, k)),
                None => inboard,
            };
            let frame = inboard.compose(&joint.placement.to_transform());
            let (q, v) = (model.q_offset(k), model.v_offset(k));
            let mut push = |parent: usize, hinge: Hinge<C>, placement: Transform<C>, first: usize| {
                let (q, v) = (q + first, v + first);
                bodies.push(Raw { parent, hinge, q, v, placement, inertia: RigidInertia::zero() });
                bodies.len() - 1
            };
            let along = |axis: [f64; 3]| rotation_from_z(Vec3::<C>::splat(axis));
            let (body, pose) = match joint.kind {
                JointKind::Fixed => (parent, frame),
                JointKind::Universal { axes: [first, second] } => {
                    let (a, b) = (along(first), along(second));
                    let between = push(parent, Hinge::Revolute, turn(&frame, &a), 0);
                    let placement = Transform::new(a.transpose() * b, Vec3::zero());
                    let body = push(between, Hinge::Revolute, placement, 1);
                    (body, Transform::new(b.transpose(), Vec3::zero()))
                }
                kind => {
                    let (hinge, turned) = hinge_of(&kind);
                    let body = push(parent, hinge, turn(&frame, &turned), 0);
                    (body, Transform::new(turned.transpose(), Vec3::zero()))
                }
            };
            let pose = match model.bodies()[k].flexible {
                Some(_) => pose.compose(&rigid_inboard(model, k)),
                None => pose,
            };
            let inertia = model.bodies()[k].inertia.to_rigid();
            if body != GROUND {
                bodies[body].inertia = bodies[body].inertia + pose.rigid_to_parent(&inertia);
            }
            carriers.push(Carrier { body, pose, inertia });
        }
        Self::assemble(model, &bodies, carriers, None)
    }
    fn assemble(
        model: &Model,
        bodies: &[Raw<C>],
        mut carriers: Vec<Carrier<C>>,
        flexible: Option<Box<FlexibleTree<C>>>,
    ) -> Self {
        let joints = (0..model.joint_nv()).map(|i| {
            let (k, component) = model.joint_of_velocity(i);
            (model.joints()[k].name.clone(), component)
        });
        let joint_of_velocity = joints.chain(model.mode_names().map(|name| (name, 0))).collect();
        let refused = model
            .refused_closure()
            .map(|c| DynamicsError::Closure { joint: c.joint.clone(), source: c.source.clone() })
            .or_else(|| model.closures().first().map(|c| DynamicsError::Loop { closure: c.name.clone() }));
        let (bodies, waiting) = arrange(bodies, if flexible.is_some() { &mut [] } else { &mut carriers });
        let rigid = bodies.iter().map(|b| rigid_entries(&b.inertia)).collect();
        let mut outboard_dofs: Vec<usize> = bodies.iter().map(|b| b.hinge.nv()).collect();
        for (k, body) in bodies.iter().enumerate().rev() {
            if body.parent != GROUND {
                outboard_dofs[body.parent] += outboard_dofs[k];
            }
        }
        let branches = branches::cut_large(&bodies);
        let of_hinges = || bodies.iter().filter(|b| matches!(b.hinge, Hinge::Revolute)).map(|b| b.q);
        let angles = of_hinges().min().unwrap_or(0)..of_hinges().max().map_or(0, |last| last + 1);
        let mut layout = Layout {
            bodies,
            carriers,
            waiting,
            outboard_dofs,
            rigid,
            branches,
            limbs: None,
            always_branches: false,
            gravity: Vec3::splat(model.gravity()),
            flexible,
            nq: model.nq(),
            nv: model.nv(),
            angles,
            joint_of_velocity,
            refused,
        };
        // Branches are met by many threads or by one, for the same bits.
        if layout.branches.is_none() {
            layout.limbs = LimbPlan::new(&layout);
        }
        layout
    }
}

impl<C: Scalar> Layout<C> {
    /// Bodies in lanes, for the sweeps of dynamics. Each has one degree of freedom.
    fn of_limbs(bodies: Vec<LayoutBody<C>>, waiting: usize) -> Self {
        let n = bodies.len();
        let outboard_dofs = branches::subtree_sizes(&bodies);
        Layout {
            bodies,
            carriers: Vec::new(),
            waiting,
            outboard_dofs,
            rigid: Vec::new(),
            branches: None,
            limbs: None,
            always_branches: false,
            gravity: Vec3::zero(),
            flexible: None,
            nq: n,
            nv: n,
            angles: 0..n,
            joint_of_velocity: vec![(String::new(), 0); n],
            refused: None,
        }
    }
    /// Number of moving bodies; zero if bodies are flexible, whose tree is kept apart.
    pub fn len(&self) -> usize {
        self.bodies.len()
    }
    /// True if nothing moves.
    pub fn is_empty(&self) -> bool {
        self.bodies.is_empty() && self.flexible.is_none()
    }
    /// True if some body has modal coordinates.
    pub fn is_flexible(&self) -> bool {
        self.flexible.is_some()
    }
    /// The tree with flexible bodies.
    #[inline(always)]
    pub(crate) fn flexible(&self) -> Option<&FlexibleTree<C>> {
        self.flexible.as_deref()
    }
    /// Number of bodies of the model.
    pub fn model_bodies(&self) -> usize {
        self.carriers.len()
    }
    /// Number of position coordinates.
    pub fn nq(&self) -> usize {
        self.nq
    }
    /// Number of degrees of freedom.
    pub fn nv(&self) -> usize {
        self.nv
    }
    /// Gravity, world axes.
    pub fn gravity(&self) -> Vec3<C> {
        self.gravity
    }
    /// The same layout under another gravity.
    pub fn with_gravity(mut self, gravity: Vec3<C>) -> Self {
        self.gravity = gravity;
        self
    }
    /// The same layout without weight, modal stiffness and damping: what a product with the mass matrix needs.
    pub(crate) fn inertial(mut self) -> Self {
        self.gravity = Vec3::zero();
        self.flexible = self.flexible.map(|tree| Box::new(tree.inertial()));
        self
    }
    /// The same layout cut into branches of at least `least` bodies, whatever its size, and without limbs in lanes. For tests: results are
    /// the same for all sizes.
    #[doc(hidden)]
    pub fn with_branches(mut self, least: usize) -> Self {
        (self.branches, self.always_branches) = (branches::cut(&self.bodies, least), true);
        self.limbs = None;
        self
    }
    /// The branches, if sweeps on scalars `T` are to go through them: for one state, where there are threads.
    pub(crate) fn branches<T: Scalar<Constant = C>>(&self) -> Option<&Branch> {
        // States in lanes are many: they have threads of their own.
        let worth = || T::LANES == 1 && (self.always_branches || crate::branching::several_threads());
        self.branches.as_ref().filter(|_| worth())
    }
    /// Number of limbs that are swept in lanes.
    #[doc(hidden)]
    pub fn limb_count(&self) -> usize {
        self.limbs.as_ref().map_or(0, |plan| plan.groups.iter().map(|limbs| limbs.count).sum())
    }
    /// Number of runs of bodies that may run on threads of their own.
    #[doc(hidden)]
    pub fn branch_count(&self) -> usize {
        fn count(branch: &Branch) -> usize {
            1 + branch.branches.iter().map(count).sum::<usize>()
        }
        self.branches.as_ref().map_or(0, count)
    }
    /// The moving bodies, parents before children; none if bodies are flexible.
    pub fn bodies(&self) -> &[LayoutBody<C>] {
        &self.bodies
    }
    /// Where each body of the model lives.
    pub fn carriers(&self) -> &[Carrier<C>] {
        &self.carriers
    }
    /// Name of the joint and component of a degree of freedom.
    pub fn joint_of_velocity(&self, i: usize) -> (&str, usize) {
        let (name, component) = &self.joint_of_velocity[i];
        (name, *component)
    }
    /// The error of a hinge whose pivot failed.
    pub(crate) fn singular(&self, i: usize, inertia: f64) -> DynamicsError {
        let (joint, component) = self.joint_of_velocity[i].clone();
        DynamicsError::SingularHinge { joint, component, inertia }
    }
    /// Why tree dynamics refuses the model, if it has closures that would be ignored.
    pub fn refusal(&self) -> Option<&DynamicsError> {
        self.refused.as_ref()
    }
    /// Refuses models whose closures tree dynamics would ignore.
    pub(crate) fn check_closures(&self) -> Result<(), DynamicsError> {
        self.refused.clone().map_or(Ok(()), Err)
    }
    /// Refuses models with flexible bodies, for an algorithm that knows none.
    ///
    /// # Errors
    /// [`DynamicsError::Flexible`].
    #[inline(always)]
    pub fn check_rigid(&self, algorithm: &'static str) -> Result<(), DynamicsError> {
        match &self.flexible {
            None => Ok(()),
            Some(tree) => Err(DynamicsError::Flexible { body: tree.name.clone(), algorithm }),
        }
    }
    /// Refuses a number that no body of the model has.
    pub(crate) fn check_body(&self, body: Option<usize>) -> Result<(), DynamicsError> {
        match body {
            Some(found) if found >= self.carriers.len() => {
                Err(DynamicsError::Body { found, count: self.carriers.len() })
            }
            _ => Ok(()),
        }
    }
    /// Minus the user's external wrenches (one per body of the model, its frame), each at its carrier.
    pub(crate) fn gather_loads<T: Scalar<Constant = C>>(
        &self,
        wrenches: &[Wrench<T>],
        loads: &mut [Wrench<T::Arithmetic>],
    ) {
        T::Arithmetic::dispatch(GatherLoads::<T> { layout: self, wrenches, loads });
    }
}

kernel! {
    GatherLoads<'a, T> {
        layout: &'a Layout<T::Constant>,
        wrenches: &'a [Wrench<T>],
        loads: &'a mut [Wrench<T::Arithmetic>],
    } -> () {
        loads.fill(Wrench::zero());
        for (carrier, wrench) in layout.carriers.iter().zip(wrenches) {
            if carrier.body != GROUND {
                let wrench = wrench.map(T::to_arithmetic);
                loads[carrier.body] -= Transform::constant(&carrier.pose).wrench_to_parent(wrench);
            }
        }
    }
}

pub(crate) fn turn<C: Scalar>(frame: &Transform<C>, rotation: &Mat3<C>) -> Transform<C> {
    Transform::new(frame.rotation * *rotation, frame.translation)
}

/// The hinge of a joint and the rotation of the layout's joint frame against the user's.
pub(crate) fn hinge_of<C: Real>(kind: &JointKind) -> (Hinge<C>, Mat3<C>) {
    let hinge = match *kind {
        JointKind::Revolute { .. } | JointKind::Continuous { .. } => Hinge::Revolute,
        JointKind::Prismatic { .. } => Hinge::Prismatic,
        JointKind::Helical { pitch, .. } => Hinge::Helical { pitch: C::splat(pitch) },
        JointKind::Cylindrical { .. } => Hinge::Cylindrical,
        JointKind::Planar { .. } => Hinge::Planar,
        JointKind::Translation => Hinge::Translation,
        JointKind::Spherical => Hinge::Spherical,
        _ => Hinge::Free,
    };
    let rotation = kind.axes().first().map_or(Mat3::identity(), |axis| rotation_from_z(Vec3::splat(*axis)));
    (hinge, rotation)
}
