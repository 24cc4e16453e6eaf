//! ln det M and its gradient for trees with flexible bodies.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | Υ⁺(k) | X A_t Υ_fl(p) A_t* X*, at the hinge frame of k | 6×6 |
//! | Υ_r | τ̄* Υ⁺ τ̄ + H* D⁻¹ H | 6×6 |
//! | Υ′ | [−G_M, 1]* Υ_r [−G_M, 1] + diag(D_M⁻¹, 0) | n + 6 |
//! | Υ_fl | L Υ′ L* | n + 6 |
//!
//! Source: soa.md 3.9 for joints, 2 tr(Υ⁺ S~ P⁺); for modes tr(Υ′ ∂P′/∂η_l) with P⁺ of the children held. The derivative of P′,
//! of one body alone, is taken on dual numbers.

use super::body::BodyState;
use super::filter::{Filter, Front};
use super::tangent::Tangent;
use super::tree::FlexibleTree;
use crate::error::{DynamicsError, check_length};
use crate::layout::{GROUND, Layout};
use phipsi_spatial::{ArticulatedInertia, Motion, Real, Scalar, Wrench};

/// ln det M(q) of a model with flexible bodies: Σ ln det D_M + Σ ln det D.
///
/// # Shapes & units
/// `q`: nq. Logarithms are taken in f64.
///
/// # Cost
/// O(n), and O(m³) for each body of m modes; allocates.
///
/// # Errors
/// [`DynamicsError::Shape`], [`DynamicsError::Closure`], [`DynamicsError::SingularHinge`]; [`DynamicsError::Rigid`] for a model
/// without modes, whose determinant [`crate::ArticulatedSweep::log_determinant`] has.
pub fn log_determinant<T: Real>(layout: &Layout<T::Constant>, q: &[T]) -> Result<f64, DynamicsError> {
    let (_, filter) = factor(layout, q)?;
    Ok(filter.pivots().map(|D| D.to_f64().ln()).sum())
}

/// Gradient of ln det M(q) by the increments of q: joints' velocities in body axes, then modal coordinates.
///
/// # Computes
/// 2 tr(Υ⁺ S~ P⁺) for every axis S of a joint, tr(Υ′ ∂P′/∂η_l) for every mode.
///
/// # Shapes & units
/// `q`: nq; result: nv.
///
/// # Cost
/// O(n), and O(m³) for each body of m modes; allocates.
///
/// # Errors
/// As [`log_determinant`].
///
/// # Example
/// ```
/// use phipsi_model::{Beam, Body, Joint, JointKind, ModelBuilder, Section};
/// use phipsi_recursion::Layout;
/// use phipsi_recursion::flexible::log_determinant_gradient;
/// let section = Section {
///     mass_per_length: 1.0,
///     bending_stiffness: [3.0, 3.0],
///     torsional_stiffness: 2.0,
///     polar_inertia: 1e-3,
///     axial_stiffness: 1e4,
/// };
/// let model = ModelBuilder::new("boom")
///     .body(Body::flexible("boom", Beam::new(1.0, section).bending([2, 0]).build()))
///     .joint(Joint::new("root", JointKind::Revolute { axis: [0.0, 0.0, 1.0] }), "world", "boom")
///     .build()?;
/// let gradient = log_determinant_gradient(&Layout::<f64>::new(&model), &vec![0.0_f64; model.nq()])?;
/// // A straight boom: turning changes nothing, and bending to either side the same.
/// assert!(gradient.iter().all(|x| x.abs() < 1e-12));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn log_determinant_gradient<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
) -> Result<Vec<T>, DynamicsError> {
    let (tree, filter) = factor(layout, q)?;
    let mut out = vec![T::zero(); layout.nv()];
    // Υ of each body's frame: of a rigid one 6×6, of a flexible one with its modes first.
    let mut upsilon: Vec<Vec<T>> = Vec::with_capacity(tree.bodies.len());
    for (k, body) in tree.bodies.iter().enumerate() {
        let mut Y = inboard(tree, &filter, k, &upsilon);
        if let Some(hinge) = &body.hinge {
            let P = &filter.P_through[k];
            for i in 0..hinge.nv() {
                let S = hinge.axis(i);
                let sum = (0..6).fold(T::zero(), |sum, j| sum + Y[j].dot(S.cross_wrench(P.column(j))));
                out[body.v + i] = sum + sum;
            }
            for i in (0..hinge.nv()).rev() {
                let pivot = &filter.pivots[body.v + i];
                let axis = hinge.axis(i);
                let u = apply(&Y, pivot.gain);
                let s = u.dot(pivot.gain) + pivot.inverse;
                for (j, column) in Y.iter_mut().enumerate() {
                    let (e, g) = (component(axis, j), component(u, j));
                    *column = *column - axis.scale(g) - u.scale(e) + axis.scale(e * s);
                }
            }
        }
        let Some(i) = body.modal else {
            upsilon.push(Y.iter().flat_map(|column| column.to_array()).collect());
            continue;
        };
        let (modal, front, state) = (&tree.modal[i], &filter.fronts[i], &filter.motions.states[i]);
        let n = modal.n;
        let inverse = inverse_of_square(&front.c, n);
        let G = gains(front, n);
        let YG: Vec<Motion<T>> = G.iter().map(|g| apply(&Y, *g)).collect();
        let ee = |l: usize, m: usize| YG[l].dot(G[m]) + inverse[l * n + m];
        for l in 0..n {
            let (dee, dde, ddd) = moved_inertia(tree, &filter, k, i, l, q);
            let mut sum = (0..6).fold(T::zero(), |sum, j| sum + Y[j].dot(ddd.column(j)));
            for a in 0..n {
                let twice = YG[a].dot(dde[a]);
                sum -= twice + twice;
                for b in 0..n {
                    sum += ee(a, b) * dee[a * n + b];
                }
            }
            out[modal.v + l] = sum;
        }
        // To F: V = X_d⁻¹ V_d + Γ η̇.
        let size = n + 6;
        let mut columns: Vec<(Vec<T>, Motion<T>)> = Vec::with_capacity(size);
        for l in 0..n {
            columns.push(((0..n).map(|m| ee(m, l)).collect(), -YG[l]));
        }
        for (j, column) in Y.iter().enumerate() {
            columns.push(((0..n).map(|m| -component(YG[m], j)).collect(), *column));
        }
        let to_body = |(eta, V): &(Vec<T>, Motion<T>)| {
            let moved = state.hinge.motion_to_parent(*V);
            eta.iter().zip(&state.Gamma).fold(moved, |sum, (x, Gamma)| sum + Gamma.scale(*x))
        };
        // L Y′ by columns, then its rows likewise.
        let half: Vec<(Vec<T>, Motion<T>)> = columns.iter().map(|c| (c.0.clone(), to_body(c))).collect();
        let entry = |row: usize, column: usize| {
            if row < n { half[column].0[row] } else { component(half[column].1, row - n) }
        };
        let mut full = vec![T::zero(); size * size];
        for row in 0..size {
            let eta: Vec<T> = (0..n).map(|l| entry(row, l)).collect();
            let V = Motion::from_array(std::array::from_fn(|j| entry(row, n + j)));
            let moved = to_body(&(eta.clone(), V)).to_array();
            for l in 0..n {
                full[row * size + l] = eta[l];
            }
            for j in 0..6 {
                full[row * size + n + j] = moved[j];
            }
        }
        upsilon.push(full);
    }
    Ok(out)
}

fn factor<'a, T: Scalar>(
    layout: &'a Layout<T::Constant>,
    q: &[T],
) -> Result<(&'a FlexibleTree<T::Constant>, Filter<T>), DynamicsError> {
    layout.check_closures()?;
    check_length("q", q, layout.nq())?;
    let Some(tree) = layout.flexible() else {
        return Err(DynamicsError::Rigid { algorithm: "flexible::log_determinant" });
    };
    let mut filter = Filter::new(tree);
    let rest = vec![T::zero(); layout.nv()];
    filter.factor(layout, tree, q, &rest, &mut rest.clone())?;
    Ok((tree, filter))
}

/// The first degree of freedom whose pivot is not above `part` of its entry of M.
pub(crate) fn first_singular<T: Real>(layout: &Layout<T::Constant>, q: &[T], part: f64) -> Option<usize> {
    let tree = layout.flexible()?;
    let nv = layout.nv();
    let mut matrix = vec![T::zero(); nv * nv];
    super::Composite::new(tree).run(tree, nv, q, &mut matrix);
    let mut filter = Filter::new(tree);
    let rest = vec![T::zero(); nv];
    match filter.factor(layout, tree, q, &rest, &mut rest.clone()) {
        Err(DynamicsError::SingularHinge { joint, component, .. }) => {
            (0..nv).find(|&i| layout.joint_of_velocity(i) == (joint.as_str(), component))
        }
        Err(_) => None,
        Ok(()) => filter
            .pivots()
            .enumerate()
            .find(|(i, D)| !D.is_positive() || *D <= matrix[i * nv + i] * T::splat(part))
            .map(|(i, _)| i),
    }
}

/// Υ⁺ by columns.
fn inboard<T: Scalar>(
    tree: &FlexibleTree<T::Constant>,
    filter: &Filter<T>,
    k: usize,
    upsilon: &[Vec<T>],
) -> [Motion<T>; 6] {
    let body = &tree.bodies[k];
    if body.parent == GROUND {
        return [Motion::zero(); 6];
    }
    let Y = &upsilon[body.parent];
    let modes = tree.modal_of(body.parent).map_or(0, |modal| modal.n);
    let size = modes + 6;
    let x = &filter.motions.x[k];
    let node = filter.motions.node(tree, k).map(|(_, node)| node);
    // X A_t: the hinge frame's motion by every mode of the parent and by its six.
    let map: Vec<Motion<T>> = (0..size)
        .map(|c| match node {
            Some(node) if c < modes => x.motion_to_child(node.Pi[c]),
            Some(node) => x.motion_to_child(node.pose.motion_to_child(Motion::unit(c - modes))),
            None if c < modes => Motion::zero(),
            None => x.motion_to_child(Motion::unit(c - modes)),
        })
        .collect();
    let half: Vec<Motion<T>> = (0..size)
        .map(|c| (0..size).fold(Motion::zero(), |sum, r| sum + map[r].scale(Y[r * size + c])))
        .collect();
    std::array::from_fn(|j| {
        (0..size).fold(Motion::zero(), |sum, c| sum + half[c].scale(component(map[c], j)))
    })
}

fn component<T: Scalar>(x: Motion<T>, i: usize) -> T {
    x.to_array()[i]
}

/// Y f for a symmetric matrix by columns.
fn apply<T: Scalar>(Y: &[Motion<T>; 6], f: Wrench<T>) -> Motion<T> {
    Y.iter().zip(f.to_array()).fold(Motion::zero(), |sum, (column, f)| sum + column.scale(f))
}

/// Columns of G_M: P′_de D_M⁻¹ = W* c⁻¹.
fn gains<T: Scalar>(front: &Front<T>, n: usize) -> Vec<Wrench<T>> {
    let mut G = front.W.clone();
    for l in (0..n).rev() {
        for m in l + 1..n {
            let moved = G[m].scale(front.c[m * n + l]);
            G[l] -= moved;
        }
        G[l] = G[l].scale(front.c[l * n + l].recip());
    }
    G
}

/// (c c*)⁻¹.
fn inverse_of_square<T: Scalar>(c: &[T], n: usize) -> Vec<T> {
    let mut out = vec![T::zero(); n * n];
    for j in 0..n {
        let mut x = vec![T::zero(); n];
        for l in j..n {
            let start = if l == j { T::one() } else { T::zero() };
            let sum = (j..l).fold(start, |sum, m| sum - c[l * n + m] * x[m]);
            x[l] = sum / c[l * n + l];
        }
        for l in (0..n).rev() {
            let sum = (l + 1..n).fold(x[l], |sum, m| sum - c[m * n + l] * x[m]);
            x[l] = sum / c[l * n + l];
        }
        for l in 0..n {
            out[l * n + j] = x[l];
        }
    }
    out
}

/// ∂P′/∂η_l of flexible body `i` with P⁺ of its children held: blocks ee, de by columns, dd.
fn moved_inertia<T: Scalar>(
    tree: &FlexibleTree<T::Constant>,
    filter: &Filter<T>,
    k: usize,
    i: usize,
    l: usize,
    q: &[T],
) -> (Vec<T>, Vec<Wrench<T>>, ArticulatedInertia<T>) {
    let modal = &tree.modal[i];
    let n = modal.n;
    let mut eta: Vec<Tangent<T>> = q[modal.q..modal.q + n].iter().map(|x| Tangent::fixed(*x)).collect();
    eta[l].rate = T::one();
    let mut state = BodyState::<Tangent<T>>::new(modal);
    state.set_position(modal, &tree.series, &eta);
    let mut front = Front {
        c: modal.M_ee.iter().map(|M| Tangent::constant(*M)).collect(),
        W: state.M_de.clone(),
        y: vec![Tangent::fixed(T::zero()); n],
    };
    let mut P = state.M_dd.to_articulated();
    for (child, body) in tree.bodies.iter().enumerate().skip(k + 1) {
        if body.parent == k {
            let P_t = lifted(&filter.motions.x[child].articulated_to_parent(&filter.P_through[child]));
            P = P + match body.node {
                Some(t) => front.add(&state.nodes[t], &P_t),
                None => P_t,
            };
        }
    }
    front.change_to_hinge(&mut P, modal.inboard.is_some(), &state);
    let mut ee: Vec<T> = front.c.iter().map(|x| x.rate).collect();
    for a in 0..n {
        for b in 0..a {
            ee[b * n + a] = ee[a * n + b];
        }
    }
    (ee, front.W.iter().map(|w| w.map(|x| x.rate)).collect(), rates(&P))
}

fn lifted<T: Scalar>(P: &ArticulatedInertia<T>) -> ArticulatedInertia<Tangent<T>> {
    map_inertia(P, Tangent::fixed)
}

fn rates<T: Scalar>(P: &ArticulatedInertia<Tangent<T>>) -> ArticulatedInertia<T> {
    map_inertia(P, |x| x.rate)
}

fn map_inertia<T: Scalar, U: Scalar>(
    P: &ArticulatedInertia<T>,
    f: impl Fn(T) -> U + Copy,
) -> ArticulatedInertia<U> {
    let symmetric = |s: &phipsi_spatial::Sym3<T>| {
        let [xx, xy, xz, yy, yz, zz] = [s.xx, s.xy, s.xz, s.yy, s.yz, s.zz].map(f);
        phipsi_spatial::Sym3 { xx, xy, xz, yy, yz, zz }
    };
    ArticulatedInertia {
        inertia: symmetric(&P.inertia),
        coupling: phipsi_spatial::Mat3(P.coupling.0.map(|row| row.map(f))),
        mass: symmetric(&P.mass),
    }
}
