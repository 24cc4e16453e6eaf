//! The compiled form of a model with flexible bodies: bodies in the model's order, parents first.
//!
//! Rigid bodies on fixed joints of rigid bodies are fused, a universal joint is two hinges, joint axes are turned onto coordinate
//! axes, as in a rigid layout. A flexible body is never fused; a fixed joint on or of one is a body without a hinge.
//!
//! | symbol | meaning |
//! |---|---|
//! | F | floating frame of a flexible body: its user's frame |
//! | hinge frame | outboard frame of the inboard joint, with turned axes. A rigid body's frame is its hinge frame |

use crate::hinge::Hinge;
use crate::layout::{Carrier, GROUND, hinge_of, turn};
use phipsi_model::joint::rotation_from_z;
use phipsi_model::{FlexibleBody, JointKind, Model};
use phipsi_spatial::{Mat3, Real, RigidInertia, Scalar, Sym3, Transform, Vec3};

/// A body with its inboard joint.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TreeBody<C> {
    /// Index of its parent, or [`GROUND`].
    pub(crate) parent: usize,
    /// The parent's node that the joint is on; `None`: the parent's frame.
    pub(crate) node: Option<usize>,
    /// The joint; `None` for a fixed one.
    pub(crate) hinge: Option<Hinge<C>>,
    /// First position coordinate.
    pub(crate) q: usize,
    /// First degree of freedom.
    pub(crate) v: usize,
    /// Joint frame in the parent's or the node's frame.
    pub(crate) placement: Transform<C>,
    /// Of a rigid body and all that is fused to it; zero for a flexible one.
    pub(crate) inertia: RigidInertia<C>,
    /// Index among the flexible bodies.
    pub(crate) modal: Option<usize>,
}

impl<C> TreeBody<C> {
    /// Number of degrees of freedom of its joint.
    pub(crate) fn dofs(&self) -> usize {
        self.hinge.as_ref().map_or(0, Hinge::nv)
    }
}

/// Constants of a flexible body: notes of [`phipsi_model::flexible`].
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Modal<C> {
    /// Number of modes.
    pub(crate) n: usize,
    /// Its modal coordinates in q.
    pub(crate) q: usize,
    /// And in v.
    pub(crate) v: usize,
    /// First of its modes, counted over all bodies.
    pub(crate) first: usize,
    pub(crate) mass: C,
    pub(crate) d0: Vec3<C>,
    pub(crate) W0: Mat3<C>,
    pub(crate) S1: Vec<Vec3<C>>,
    pub(crate) E: Vec<Mat3<C>>,
    pub(crate) S: Vec<Mat3<C>>,
    pub(crate) J_r: Mat3<C>,
    pub(crate) C_r: Vec<Vec3<C>>,
    /// tr S_lm + M_r.
    pub(crate) M_ee: Vec<C>,
    /// T1 and T2, empty without stiffening.
    pub(crate) T1: Vec<Vec3<C>>,
    pub(crate) T2: Vec<Mat3<C>>,
    pub(crate) stiffness: Vec<C>,
    pub(crate) damping: Vec<C>,
    pub(crate) nodes: Vec<ModalNode<C>>,
    /// The node that the inboard joint holds; `None`: F.
    pub(crate) inboard: Option<usize>,
    /// Axes of the hinge frame in those of the inboard node, or of F.
    pub(crate) hinge_axes: Mat3<C>,
}

/// Constants of a node.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ModalNode<C> {
    pub(crate) s0: Vec3<C>,
    pub(crate) psi: Vec<Vec3<C>>,
    pub(crate) psi_r: Vec<Vec3<C>>,
    /// Empty without quadratic displacement.
    pub(crate) S2: Vec<Vec3<C>>,
}

/// A model with flexible bodies, compiled.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FlexibleTree<C> {
    pub(crate) bodies: Vec<TreeBody<C>>,
    pub(crate) modal: Vec<Modal<C>>,
    /// Number of modes of all bodies.
    pub(crate) modes: usize,
    /// Name of the first flexible body, for refusals.
    pub(crate) name: String,
    /// (−1)ᵏ/(2k + 2)! and (−1)ᵏ/(2k + 3)!.
    pub(crate) series: Vec<[C; 2]>,
}

impl<C: Real> FlexibleTree<C> {
    /// Compiles a model; `None` if no body has modes. Cost O(n).
    pub(crate) fn new(model: &Model) -> Option<(Self, Vec<Carrier<C>>)> {
        if !model.is_flexible() {
            return None;
        }
        let mut bodies: Vec<TreeBody<C>> = Vec::new();
        let mut modal: Vec<Modal<C>> = Vec::new();
        let mut carriers: Vec<Carrier<C>> = Vec::with_capacity(model.len());
        let mut name = None;
        for k in 0..model.len() {
            let joint = &model.joints()[k];
            let body = &model.bodies()[k];
            let parent = model.tree().parent(k);
            let on_flexible = parent.is_some_and(|p| model.bodies()[p].modes() > 0);
            let node = if on_flexible { model.node_of_joint(k) } else { None };
            let (at, inboard) = parent.map_or((GROUND, Transform::identity()), |p| {
                (carriers[p].body, carriers[p].pose.compose(&rigid_node(model, k)))
            });
            let frame = inboard.compose(&joint.placement.to_transform());
            let (q, v) = (model.q_offset(k), model.v_offset(k));
            let mut push = |parent, node, hinge, placement, first: usize| {
                let (q, v, inertia) = (q + first, v + first, RigidInertia::zero());
                bodies.push(TreeBody { parent, node, hinge, q, v, placement, inertia, modal: None });
                bodies.len() - 1
            };
            let along = |axis: [f64; 3]| rotation_from_z(Vec3::<C>::splat(axis));
            let flexible = body.flexible.as_ref().filter(|_| body.modes() > 0);
            // The user's frame in the hinge frame, and whether the body is one of its own.
            let (index, axes) = match joint.kind {
                JointKind::Fixed if on_flexible || flexible.is_some() => {
                    (push(at, node, None, frame, 0), Mat3::identity())
                }
                JointKind::Fixed => (at, Mat3::identity()),
                JointKind::Universal { axes: [first, second] } => {
                    let (a, b) = (along(first), along(second));
                    let between = push(at, node, Some(Hinge::Revolute), turn(&frame, &a), 0);
                    let placement = Transform::new(a.transpose() * b, Vec3::zero());
                    (push(between, None, Some(Hinge::Revolute), placement, 1), b)
                }
                kind => {
                    let (hinge, turned) = hinge_of(&kind);
                    (push(at, node, Some(hinge), turn(&frame, &turned), 0), turned)
                }
            };
            let inertia = body.inertia.to_rigid();
            if let Some(flexible) = flexible {
                name.get_or_insert_with(|| body.name.clone());
                bodies[index].modal = Some(modal.len());
                let (q, v) = (model.mode_q_range(k).start, model.mode_v_range(k).start);
                modal.push(Modal::new(flexible, q, v, v - model.joint_nv(), axes));
                carriers.push(Carrier { body: index, pose: Transform::identity(), inertia });
                continue;
            }
            let fused = joint.kind == JointKind::Fixed && !on_flexible;
            let outside = if fused { frame } else { Transform::new(axes.transpose(), Vec3::zero()) };
            let pose = outside.compose(&rigid_inboard(model, k));
            if index != GROUND {
                bodies[index].inertia = bodies[index].inertia + pose.rigid_to_parent(&inertia);
            }
            carriers.push(Carrier { body: index, pose, inertia });
        }
        let modes = model.modes();
        let series = series();
        Some((FlexibleTree { bodies, modal, modes, name: name.unwrap_or_default(), series }, carriers))
    }
}

impl<C: Scalar> FlexibleTree<C> {
    /// The same tree without stiffness and damping.
    pub(crate) fn inertial(mut self) -> Self {
        for body in &mut self.modal {
            body.stiffness.fill(C::zero());
            body.damping.fill(C::zero());
        }
        self
    }
    /// The flexible body that tree body `k` is.
    #[inline(always)]
    pub(crate) fn modal_of(&self, k: usize) -> Option<&Modal<C>> {
        self.bodies[k].modal.map(|i| &self.modal[i])
    }
}

/// Where joint `k` is on a parent whose node no mode moves: a body with modal data but without modes is rigid.
pub(crate) fn rigid_node<C: Real>(model: &Model, k: usize) -> Transform<C> {
    match model.attachment(k) {
        Some(node) if node.displacement.is_empty() => {
            Transform::new(Mat3::identity(), Vec3::splat(node.position))
        }
        _ => Transform::identity(),
    }
}

/// The frame of body `k` in the outboard frame of its joint, if it is held at a node that no mode moves.
pub(crate) fn rigid_inboard<C: Real>(model: &Model, k: usize) -> Transform<C> {
    let held = model.bodies()[k].flexible.as_ref().filter(|body| body.modes() == 0);
    let node = held.and_then(|body| Some(&body.nodes[body.inboard_node()?]));
    node.map_or(Transform::identity(), |node| {
        Transform::new(Mat3::identity(), -Vec3::<C>::splat(node.position))
    })
}

impl<C: Real> Modal<C> {
    fn new(body: &FlexibleBody, q: usize, v: usize, first: usize, hinge_axes: Mat3<C>) -> Self {
        let integrals = &body.integrals;
        let n = body.modes();
        let vectors = |x: &[[f64; 3]]| -> Vec<Vec3<C>> { x.iter().map(|x| Vec3::splat(*x)).collect() };
        let matrix = |m: &[[f64; 3]; 3]| Mat3(m.map(|row| row.map(C::splat)));
        let matrices = |x: &[[[f64; 3]; 3]]| -> Vec<Mat3<C>> { x.iter().map(matrix).collect() };
        let numbers = |x: &[f64]| -> Vec<C> { x.iter().map(|&x| C::splat(x)).collect() };
        let S = matrices(&integrals.product);
        let trace = |s: &Mat3<C>| s.0[0][0] + s.0[1][1] + s.0[2][2];
        let M_ee = S.iter().zip(&integrals.rotary_modal).map(|(s, r)| trace(s) + C::splat(*r)).collect();
        let (T1, T2) = integrals
            .stiffening
            .as_ref()
            .map_or((Vec::new(), Vec::new()), |t| (vectors(&t.displacement), matrices(&t.moment)));
        let node = |node: &phipsi_model::Node| ModalNode {
            s0: Vec3::splat(node.position),
            psi: vectors(&node.displacement),
            psi_r: vectors(&node.rotation),
            S2: node.quadratic.as_ref().map_or(Vec::new(), |x| vectors(x)),
        };
        Modal {
            n,
            q,
            v,
            first,
            mass: C::splat(integrals.mass),
            d0: Vec3::splat(integrals.first_moment),
            W0: matrix(&integrals.second_moment),
            S1: vectors(&integrals.displacement),
            E: matrices(&integrals.moment),
            S,
            J_r: matrix(&integrals.rotary),
            C_r: vectors(&integrals.rotary_coupling),
            M_ee,
            T1,
            T2,
            stiffness: numbers(&body.stiffness),
            damping: numbers(&body.damping),
            nodes: body.nodes.iter().map(node).collect(),
            inboard: body.inboard_node(),
            hinge_axes,
        }
    }
}

/// (−1)ᵏ/(2k + 2)! and (−1)ᵏ/(2k + 3)!: as many as rotations of up to half a turn need in this number type.
fn series<C: Real>() -> Vec<[C; 2]> {
    let terms = if C::EPSILON < 1e-20 { 24 } else { 14 };
    let (mut all, mut a) = (Vec::with_capacity(terms), C::splat(0.5));
    for k in 0..terms {
        let next = C::splat((2 * k + 3) as f64);
        all.push([a, a / next]);
        a = -(a / (next * C::splat((2 * k + 4) as f64)));
    }
    all
}

/// The entries of a symmetric matrix.
pub(crate) fn symmetric<C: Scalar>(m: &Mat3<C>) -> Sym3<C> {
    Sym3::from_upper(m)
}
