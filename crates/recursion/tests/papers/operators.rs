//! Paper 2, sections 2, 3 and (4.8): the operators, trees, the Jacobian.

use crate::papers::row::{Equations, Row, eq, none, t};
use crate::papers::scene::{Scene, inverse, stacked, zeros};
use crate::{mul, row};
use nalgebra::DMatrix;
use phipsi_spatial::{Mat3, Motion, Real, Transform, Vec3, Wrench};
use phipsi_topology::Operator;

/// φ of a pose: [[R, l~R], [0, R]].
pub fn shift_of<T: Real>(pose: &Transform<T>) -> DMatrix<T> {
    let columns: Vec<[T; 6]> = (0..6).map(|j| pose.wrench_to_parent(Wrench::unit(j)).to_array()).collect();
    DMatrix::from_fn(6, 6, |i, j| columns[j][i])
}

/// The block that carries the case's body, and the pose of its point in the world; none for what cannot move.
pub fn tip<T: Real>(s: &Scene<T>, body: usize) -> Option<(usize, Transform<T>)> {
    let carrier =
        s.case.model.tree().path_to_root(body).find_map(|b| s.bodies().iter().position(|&k| k == b))?;
    let zero = vec![T::zero(); s.nv()];
    let motions = phipsi_reference::kinematics(&s.case.model, &s.q, &zero, &zero);
    let point = Vec3(s.case.point.0.map(T::splat));
    Some((carrier, motions[body].pose.compose(&Transform::new(Mat3::identity(), point))))
}

/// B of the case's point on a body.
pub fn at_point<T: Real>(s: &Scene<T>, body: usize) -> Operator<T> {
    s.pick_off(&[(body, Vec3(s.case.point.0.map(T::splat)))]).unwrap()
}

fn from_poses<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    let relative = |i: usize, j: usize| shift_of(&s.poses[i].inverse().compose(&s.poses[j]));
    s.spatial(|i, j| (s.parent(j) == Some(i)).then(|| relative(i, j)))
}

/// Joint axes by the dense reference: columns of the body's own Jacobian that its joint has.
fn hinge_by_reference<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    let blocks: Vec<DMatrix<T>> = (0..s.n())
        .map(|k| {
            let J = phipsi_reference::jacobian(&s.case.model, &s.q, Some(s.bodies()[k]), None);
            let turn = s.poses[k].rotation;
            let columns: Vec<[T; 6]> = s
                .joint_space()
                .range(k)
                .map(|c| {
                    let half =
                        |at: usize| turn.transpose_mul(Vec3([J[(at, c)], J[(at + 1, c)], J[(at + 2, c)]]));
                    Motion::new(half(0), half(3)).to_array()
                })
                .collect();
            DMatrix::from_fn(columns.len(), 6, |i, j| columns[i][j])
        })
        .collect();
    s.diagonal_matrix(s.joint_space(), s.state_space(), &blocks)
}

fn powers<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    let E = s.E_phi.dense().unwrap();
    let one = DMatrix::identity(6 * s.n(), 6 * s.n());
    let (mut sum, mut power) = (one.clone(), one);
    for _ in 1..s.n() {
        power *= &E;
        sum += &power;
    }
    sum
}

fn pick_off<T: Real>(s: &Scene<T>) -> Equations<T> {
    let B = at_point(s, s.case.body);
    let Some((carrier, point)) = tip(s, s.case.body) else { return none() };
    let block = |k: usize| shift_of(&s.poses[k].inverse().compose(&point));
    let here = s.assembled(s.state_space(), B.columns(), |k, _| (k == carrier).then(|| block(k)));
    let along = s.assembled(s.state_space(), B.columns(), |k, _| s.carries(k, carrier).then(|| block(k)));
    eq(mul!(s.phi, B), along).and(&B, here.clone()).and(t(&B), here.transpose())
}

fn gather<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    s.matrix(6 * s.n(), |f| {
        let mut f = s.cut_spatial(f);
        s.tree().gather(&mut f, |_, k, f| &s.blocks.shift[k] * f, |sum, x| *sum += x);
        stacked(&f)
    })
}

fn scatter<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    s.matrix(6 * s.n(), |V| {
        let mut V = s.cut_spatial(V);
        for k in 0..s.n() {
            if let Some(p) = s.parent(k) {
                let moved = s.blocks.shift[k].transpose() * &V[p];
                V[k] += moved;
            }
        }
        stacked(&V)
    })
}

/// J of the case's point in the body's axes.
pub fn jacobian_of_reference<T: Real>(s: &Scene<T>, body: usize) -> DMatrix<T> {
    let point = Vec3(s.case.point.0.map(T::splat));
    let J = phipsi_reference::jacobian(&s.case.model, &s.q, Some(body), Some(point));
    let zero = vec![T::zero(); s.nv()];
    let turn = phipsi_reference::kinematics(&s.case.model, &s.q, &zero, &zero)[body].pose.rotation;
    DMatrix::from_fn(6, J.ncols(), |i, c| {
        let at = 3 * (i / 3);
        turn.transpose_mul(Vec3([J[(at, c)], J[(at + 1, c)], J[(at + 2, c)]])).0[i - at]
    })
}

fn jacobian<T: Real>(s: &Scene<T>) -> Equations<T> {
    let B = at_point(s, s.case.body);
    let mut want = jacobian_of_reference(s, s.case.body);
    if tip(s, s.case.body).is_none() {
        want = zeros(6, s.nv());
    }
    eq(mul!(t(&B), t(&s.phi), t(&s.H)), want)
}

fn identity_like<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    inverse(&(s.identity() - &s.E_psi).dense().unwrap())
}

/// The rows.
pub fn rows() -> Vec<Row> {
    vec![
        row!(
            "2 (2.1)",
            "E_φ: block (p(k), k) is φ(p(k), k)",
            "a subdiagonal: chains",
            "`Operators::E_phi`",
            Trees,
            |s| eq(&s.E_phi, from_poses(s))
        ),
        row!(
            "2 (2.2)",
            "φ = (I − E_φ)⁻¹ = I + E_φ + E_φ² + …",
            "",
            "`Operators::phi`, `Operator::resolvent`",
            Trees,
            |s| eq(&s.phi, powers(s)).and(&s.phi, inverse(&(s.identity() - &s.E_phi).dense().unwrap()))
        ),
        row!(
            "2 (2.3)",
            "H: block diagonal, columns of H* are the joint axes",
            "",
            "`Operators::H`",
            Trees,
            |s| eq(&s.H, hinge_by_reference(s))
        ),
        row!("2 (2.4)", "P = E_φ τ̄ P E_φ* + M", "τ̄ E_φ P E_φ + M", "`Operators::P`", Trees, |s| {
            eq(mul!(s.E_phi, s.tau_bar, s.P, t(&s.E_phi)) + &s.M, &s.P)
                .and(mul!(s.E_psi, s.P, t(&s.E_phi)) + &s.M, &s.P)
                .printed(mul!(s.tau_bar, s.E_phi, s.P, s.E_phi) + &s.M, &s.P)
        }),
        row!(
            "2 Table 1",
            "D = H P H*, K = E_φ G, τ̄ = I − G H, E_ψ = E_φ τ̄",
            "",
            "`Operators::D`, `K`, `tau_bar`, `E_psi`",
            Trees,
            |s| eq(mul!(s.H, s.P, t(&s.H)), &s.D)
                .and(mul!(s.E_phi, s.G), &s.K)
                .and(mul!(s.E_phi, s.identity() - mul!(s.G, s.H)), &s.E_psi)
                .of(&s.E_phi)
        ),
        row!(
            "2 §2.5",
            "G = P H* D⁻¹, τ̄ = I − G H: H τ̄ = 0, τ̄ G = 0, G D G* = P − τ̄ P",
            "",
            "`Operators::G`, `tau_bar`",
            Trees,
            |s| eq(mul!(s.H, s.tau_bar), zeros(s.nv(), 6 * s.n()))
                .of(mul!(s.H, s.tau()))
                .and(mul!(s.tau_bar, s.G), zeros(6 * s.n(), s.nv()))
                .of(mul!(s.tau(), s.G))
                .and(mul!(s.G, s.D, t(&s.G)), &s.P - mul!(s.tau_bar, s.P))
                .of(&s.P)
        ),
        row!("2 (2.5)", "ψ = (I − E_ψ)⁻¹, E_ψ = E_φ τ̄", "", "`Operators::psi`", Trees, |s| eq(
            &s.psi,
            identity_like(s)
        )),
        row!(
            "2 §2.7",
            "f = φ B f(C), V(C) = B* V, B = [φ*(1,C), 0, 0]*",
            "stars of B",
            "`Operators::pick_off`",
            Trees,
            |s| pick_off(s)
        ),
        row!(
            "2 (3.6)",
            "f(p) = Σ over children φ(p,k) f(k): gathered by φ",
            "",
            "`Operators::phi`, `Tree::gather`",
            Trees,
            |s| eq(&s.phi, gather(s))
        ),
        row!(
            "2 (3.7)",
            "V(k) = φ*(p,k) V(p): scattered by φ*",
            "",
            "`Operator::adjoint`, `Tree::scatter`",
            Trees,
            |s| eq(t(&s.phi), scatter(s))
        ),
        row!("2 (4.8)", "J = B* φ* H*", "", "`Operators::pick_off`", Trees, |s| jacobian(s)),
    ]
}
