//! Paper 2, sections 2 to 4.5: the operators, trees, Jacobian, factorisations, diagonalised dynamics, sensitivities.

use crate::papers::row::{Equations, Row, eq, none, t};
use crate::papers::scene::{Scene, inverse, zeros};
use crate::{mul, row};
use nalgebra::DMatrix;
use phipsi_model::{JointKind, Random};
use phipsi_recursion::Operators;
use phipsi_recursion::operators::Sensitivity;
use phipsi_reference::Dual;
use phipsi_reference::inverse_dynamics_derivatives::{seeded, tangent};
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
        crate::papers::scene::stacked(&f)
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
        crate::papers::scene::stacked(&V)
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

/// B of as many rows as the point of the farthest body can move in, and its Jacobian, where that is well away from singular.
pub fn constraint<T: Real>(s: &Scene<T>, most: usize) -> Option<(usize, Operator<T>)> {
    let freedoms = |k: usize| s.tree().path_to_root(k).map(|a| s.joint_space().size(a)).sum::<usize>();
    let node = (0..s.n()).max_by_key(|&k| (freedoms(k), k))?;
    let rows = most.min(freedoms(node));
    let body = s.bodies()[node];
    let block = at_point(s, body).dense().unwrap().view((6 * node, 0), (6, 6)).into_owned();
    let mut random = Random::new(s.seed ^ 0x6c6f_6f70);
    let mix = DMatrix::from_fn(6, rows, |i, j| {
        T::splat(if rows == 6 { f64::from(u8::from(i == j)) } else { random.signed() })
    });
    let B = Operator::pick_off("B", s.state_space(), vec![node], vec![block * mix]).unwrap();
    let J = mul!(t(&B), t(&s.phi), t(&s.H)).dense().unwrap();
    let square = &J * J.transpose();
    let back = inverse(&square);
    (condition(&square, &back).to_f64() < 1e4).then_some((node, B))
}

/// Largest entries of a matrix and its inverse, multiplied.
pub fn condition<T: Real>(a: &DMatrix<T>, inverse: &DMatrix<T>) -> T {
    let size = |a: &DMatrix<T>| a.iter().fold(T::zero(), |m, x| m.larger(x.abs()));
    size(a) * size(inverse)
}

fn Q<T: Real>(s: &Scene<T>) -> Operator<T> {
    Operator::outward_composite("Q", &s.E_phi, &mul!(t(&s.H), s.H)).unwrap()
}

/// One dense block as an operator.
pub fn small<T: Real>(name: &str, space: &phipsi_topology::Space, block: DMatrix<T>) -> Operator<T> {
    Operator::diagonal(name, space, space, vec![block]).unwrap()
}

fn generalized_inverse<T: Real>(s: &Scene<T>) -> Equations<T> {
    let Some((_, B)) = constraint(s, 6) else { return none() };
    let rows = B.columns().clone();
    let square = mul!(t(&B), Q(s), B).dense().unwrap();
    let between = inverse(&square);
    // Normal equations round by the condition of J J*.
    let lost = condition(&square, &between);
    let pseudo = mul!(s.H, s.phi, B, small("(B* Q B)⁻¹", &rows, between));
    let J = mul!(t(&B), t(&s.phi), t(&s.H));
    let dense = J.dense().unwrap();
    let want = dense.transpose() * inverse(&(&dense * dense.transpose()));
    eq(pseudo.clone(), want.clone())
        .of(want.clone() * lost)
        .and(mul!(J, pseudo), Operator::identity(&rows))
        .of(lost)
        .and(mul!(pseudo, J), (&want * &dense).transpose())
        .of(lost)
}

fn inside_Q<T: Real>(s: &Scene<T>) -> Equations<T> {
    let full = mul!(t(&s.phi), t(&s.H), s.H, s.phi);
    let dense = full.dense().unwrap();
    let shift = &s.blocks.shift;
    let by_ancestors = s.spatial(|i, j| {
        s.common(i, j)
            .map(|a| s.transition(shift, a, i).transpose() * &s.blocks.Q[a] * s.transition(shift, a, j))
    });
    eq(Q(s), s.spatial_diagonal(&s.blocks.Q))
        .and(Q(s), s.diagonal_of(&dense))
        .and(full.clone(), by_ancestors)
        .printed(mul!(t(&s.E_phi), full, s.E_phi) + mul!(t(&s.H), s.H), dense)
}

fn composite<T: Real>(s: &Scene<T>) -> Equations<T> {
    let (joint, b) = (s.joint_space(), &s.blocks);
    let mass = s.mass_of_reference();
    let element = |k: usize, j: usize| {
        if s.carries(k, j) {
            Some(&b.H[k] * s.transition(&b.shift, k, j) * &b.R[j] * b.H[j].transpose())
        } else if s.carries(j, k) {
            Some(&b.H[k] * &b.R[k] * s.transition(&b.shift, j, k).transpose() * b.H[j].transpose())
        } else {
            None
        }
    };
    let own = s.assembled(joint, joint, |i, j| {
        (i == j).then(|| {
            mass.view((joint.range(i).start, joint.range(i).start), (joint.size(i), joint.size(i)))
                .into_owned()
        })
    });
    eq(mul!(s.E_phi, s.R, t(&s.E_phi)) + &s.M, &s.R)
        .and(mul!(s.H, s.R, t(&s.H)), own)
        .and(s.assembled(joint, joint, element), mass)
}

fn diagonal_velocity<T: Real>(s: &Scene<T>) -> Equations<T> {
    let v = s.v();
    let nu = t(&s.factor()).apply(&v).unwrap();
    let V = mul!(t(&s.phi), t(&s.H)).apply(&v).unwrap();
    let weighted = s.D.apply(&nu).unwrap();
    let energy = nu.iter().zip(&weighted).fold(T::zero(), |sum, (&x, &y)| sum + x * y) * T::splat(0.5);
    eq(energy, phipsi_reference::kinetic_energy(&s.case.model, &s.q, &v))
        .and(nu, t(&s.G).apply(&V).unwrap())
        .and(t(&s.innovations_operator()).apply(&t(&s.G).apply(&V).unwrap()).unwrap(), v)
}

/// D ν̇ + C = ε: ν̇ by the product rule on (I + HφK)* θ̇, C by recursions.
fn diagonalised<T: Real>(s: &Scene<T>) -> Equations<T> {
    let (v, tau) = (s.v(), s.applied());
    let rest = vec![T::zero(); s.nv()];
    let gravity = s.inverse_dynamics(&rest, &rest).unwrap();
    let applied: Vec<T> = tau.iter().zip(&gravity).map(|(&t, &g)| t - g).collect();
    let acceleration = s.forward_dynamics(&v, &tau).unwrap();
    let add = |sum: &mut Vec<T>, x: Vec<T>, by: T| sum.iter_mut().zip(x).for_each(|(s, x)| *s += x * by);
    let V = mul!(t(&s.phi), t(&s.H)).apply(&v).unwrap();
    let mut rate = t(&s.factor()).apply(&acceleration).unwrap();
    let (mut gain, mut axes) = (rest.clone(), vec![T::zero(); V.len()]);
    for (i, &speed) in v.iter().enumerate() {
        let r = s.sensitivity(i).unwrap();
        let factor = mul!(r.H, s.phi, s.K) + mul!(s.H, r.phi, s.K) + mul!(s.H, s.phi, r.K);
        add(&mut rate, t(&factor).apply(&v).unwrap(), speed);
        add(&mut gain, t(&r.G).apply(&V).unwrap(), speed);
        add(&mut axes, t(&r.H).apply(&v).unwrap(), speed);
    }
    let six = |x: &[T]| -> Vec<[T; 6]> {
        x.chunks_exact(6).map(|x| [x[0], x[1], x[2], x[3], x[4], x[5]]).collect()
    };
    let h = t(&s.H).apply(&v).unwrap();
    let momentum = s.M.apply(&V).unwrap();
    let (mut a, mut b) = (vec![], vec![]);
    for (k, V) in six(&V).into_iter().enumerate() {
        let V = Motion::from_array(V);
        a.extend(V.cross_motion(Motion::from_array(six(&h)[k])).to_array());
        b.extend(V.cross_wrench(Wrench::from_array(six(&momentum)[k])).to_array());
    }
    add(&mut a, axes, T::one());
    add(&mut b, s.P.apply(&a).unwrap(), T::one());
    let mut C = mul!(s.H, s.psi).apply(&b).unwrap();
    let mut through = t(&s.G).apply(&a).unwrap();
    add(&mut through, gain, T::one());
    let through = s.D.apply(&through).unwrap();
    add(&mut C, through.clone(), -T::one());
    let epsilon = s.innovations_operator().apply(&applied).unwrap();
    let left = s.D.apply(&rate).unwrap();
    let difference: Vec<T> = epsilon.iter().zip(&C).map(|(&e, &c)| e - c).collect();
    let terms = [mul!(s.H, s.psi).apply(&b).unwrap(), through, applied, gravity, left.clone()].concat();
    let without: Vec<T> = rate.iter().zip(&C).map(|(&r, &c)| r + c).collect();
    eq(left, difference).of(terms).printed(without, epsilon)
}

/// One coordinate of the scene.
fn coordinate<T: Real>(s: &Scene<T>) -> usize {
    (s.seed as usize).wrapping_mul(7) % s.nv()
}

fn moved<T: Real>(s: &Scene<T>, i: usize) -> Vec<Dual<T>> {
    let unit: Vec<T> = (0..s.nv()).map(|j| if j == i { T::one() } else { T::zero() }).collect();
    seeded(&s.q, &tangent(&s.case.model, &s.q, &unit))
}

/// A sensitivity against the operator on dual numbers.
fn sensitivity<T: Real>(
    s: &Scene<T>,
    rate: impl Fn(&Sensitivity<T>) -> Operator<T>,
    own: impl Fn(&Operators<Dual<T>>) -> Operator<Dual<T>>,
) -> Equations<T> {
    let i = coordinate(s);
    let dual = own(&Operators::new(&s.case.model, &moved(s, i)).unwrap()).dense().unwrap();
    eq(rate(&s.sensitivity(i).unwrap()), dual.map(|x| x.rate)).of(dual.map(|x| x.value))
}

fn of_mass<T: Real>(s: &Scene<T>) -> Equations<T> {
    let i = coordinate(s);
    let q = moved(s, i);
    let mass = phipsi_reference::mass_matrix(&s.case.model, &q);
    let rates = s.sensitivity(i).unwrap();
    let (mass_rate, minv) = (mass.map(|x| x.rate), s.mass_inverse_of_reference());
    eq(rates.mass_matrix, mass_rate.clone())
        .of(s.mass_matrix())
        .and(rates.mass_matrix_inverse, -(&minv * mass_rate * &minv))
        .of(s.mass_matrix_inverse())
}

/// ∂ ln det 𝓜 = 2 tr(Υ Ė_φ P⁺ E_φ*) where the joint's axes are fixed in the body, and tr(D⁻¹ Ḋ) everywhere.
fn of_log_determinant<T: Real>(s: &Scene<T>) -> Equations<T> {
    let i = coordinate(s);
    let trace = |a: &DMatrix<T>| (0..a.nrows()).fold(T::zero(), |sum, k| sum + a[(k, k)]);
    let mass = phipsi_reference::mass_matrix(&s.case.model, &moved(s, i)).map(|x| x.rate);
    let product = s.mass_inverse_of_reference() * mass;
    let want = trace(&product);
    let rates = s.sensitivity(i).unwrap();
    let pivots = mul!(s.D_inverse, rates.D).dense().unwrap();
    // Every degree of freedom has a term of the size of 𝓜⁻¹ 𝓜.
    let terms = DMatrix::from_element(1, 1, T::splat(s.nv() as f64));
    let out = eq(trace(&pivots), want).of(terms.clone());
    let (joint, _) = s.case.model.joint_of_velocity(i);
    if matches!(s.case.model.joints()[joint].kind, JointKind::Universal { .. }) {
        return out;
    }
    let sandwich = mul!(s.upsilon, rates.E_phi, s.tau_bar, s.P, t(&s.E_phi)).dense().unwrap();
    out.and(trace(&sandwich) * T::splat(2.0), want).of(terms)
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
        row!(
            "2 (4.9)",
            "J⁺ = J*(J J*)⁻¹ = H φ B (B* Q B)⁻¹: J J⁺ = I, J⁺ J symmetric",
            "for one point, where J has full row rank; Q is semidefinite only",
            "`Operator::outward_composite`",
            Trees,
            |s| generalized_inverse(s)
        ),
        row!(
            "2 (4.10)",
            "Q(k) = φ*(p,k) Q(p) φ(p,k) + H*(k) H(k): diagonal blocks of φ* H* H φ, its block (i,j) is φ*(a,i) Q(a) φ(a,j), a the lowest common ancestor",
            "taken for all of φ* H* H φ",
            "`Operator::outward_composite`",
            Trees,
            |s| inside_Q(s)
        ),
        row!(
            "2 (4.10), chains",
            "Q = E_φ* Q E_φ + H* H, φ* H* H φ = Q + Q φ~ + φ~* Q",
            "",
            "`Operator::outward_composite`",
            Chains,
            |s| {
                let (Q, tilde) = (Q(s), s.phi_tilde());
                eq(&Q + mul!(Q, tilde) + mul!(t(&tilde), Q), mul!(t(&s.phi), t(&s.H), s.H, s.phi))
                    .and(mul!(t(&s.E_phi), Q, s.E_phi) + mul!(t(&s.H), s.H), Q)
            }
        ),
        row!("2 (4.11)", "𝓜 = H φ M φ* H*", "", "`Operators::mass_matrix`", Trees, |s| eq(
            s.mass_matrix(),
            s.mass_of_reference()
        )),
        row!(
            "2 (4.12)",
            "R = E_φ R E_φ* + M: 𝓜(k,k) = H(k) R(k) H*(k), 𝓜(k,j) = H(k) φ(k,j) R(j) H*(j)",
            "",
            "`Operators::R`, `Operator::inward_composite`",
            Trees,
            |s| composite(s)
        ),
        row!("2 (4.13)", "𝓜 = (I + H φ K) D (I + H φ K)*", "", "`Operators::factor`", Trees, |s| eq(
            mul!(s.factor(), s.D, t(&s.factor())),
            s.mass_of_reference()
        )),
        row!(
            "2 (4.14)",
            "(I + H φ K)⁻¹ = I − H ψ K",
            "",
            "`Operators::innovations_operator`, `Operator::inverse`",
            Trees,
            |s| eq(s.innovations_operator(), inverse(&s.factor().dense().unwrap()))
        ),
        row!(
            "2 (4.15)",
            "𝓜⁻¹ = (I − H ψ K)* D⁻¹ (I − H ψ K)",
            "",
            "`Operators::mass_matrix_inverse`",
            Trees,
            |s| eq(s.mass_matrix_inverse(), s.mass_inverse_of_reference())
        ),
        row!(
            "2 (4.16)",
            "½ θ̇* 𝓜 θ̇ = ½ ν* D ν, ν = (I + H φ K)* θ̇ = G* V, θ̇ = (I − H ψ K)* ν",
            "",
            "`Operators::factor`",
            Trees,
            |s| diagonal_velocity(s)
        ),
        row!(
            "2 (4.17)",
            "D ν̇ + C = ε, C = H ψ (b + P a) − D (G* a + Ġ* V)",
            "D is missing",
            "`Operators::sensitivity`, `innovations_operator`",
            Trees,
            |s| diagonalised(s)
        ),
        row!("2 §4.5, E_φ", "Ė_φ = φ(p,i) S~ in block (p,i)", "", "`Sensitivity::E_phi`", Trees, |s| {
            sensitivity(s, |r| r.E_phi.clone(), |o| o.E_phi.clone())
        }),
        row!("2 §4.5, φ", "φ̇ = φ Ė_φ φ", "", "`Sensitivity::phi`", Trees, |s| sensitivity(
            s,
            |r| r.phi.clone(),
            |o| o.phi.clone()
        )),
        row!(
            "2 §4.5, H",
            "Ḣ = 0, but for the first axis of a universal joint",
            "",
            "`Sensitivity::H`",
            Trees,
            |s| sensitivity(s, |r| r.H.clone(), |o| o.H.clone())
        ),
        row!(
            "2 §4.5, P",
            "Ṗ(p) = Σ (Ė P⁺ E* + E P⁺ Ė* + E Ṗ⁺ E*)",
            "",
            "`Sensitivity::P`",
            Trees,
            |s| sensitivity(s, |r| r.P.clone(), |o| o.P.clone())
        ),
        row!("2 §4.5, D", "Ḋ = Ḣ P H* + H Ṗ H* + H P Ḣ*", "", "`Sensitivity::D`", Trees, |s| {
            sensitivity(s, |r| r.D.clone(), |o| o.D.clone())
        }),
        row!(
            "2 §4.5, D⁻¹",
            "(D⁻¹)˙ = −D⁻¹ Ḋ D⁻¹",
            "",
            "`Sensitivity::D_inverse`",
            Trees,
            |s| sensitivity(s, |r| r.D_inverse.clone(), |o| o.D_inverse.clone())
        ),
        row!("2 §4.5, G", "Ġ = (U̇ − G Ḋ) D⁻¹, U = P H*", "", "`Sensitivity::G`", Trees, |s| {
            sensitivity(s, |r| r.G.clone(), |o| o.G.clone())
        }),
        row!("2 §4.5, K", "K̇ = Ė_φ G + E_φ Ġ", "", "`Sensitivity::K`", Trees, |s| sensitivity(
            s,
            |r| r.K.clone(),
            |o| o.K.clone()
        )),
        row!("2 §4.5, τ̄", "τ̄˙ = −Ġ H − G Ḣ", "", "`Sensitivity::tau_bar`", Trees, |s| {
            sensitivity(s, |r| r.tau_bar.clone(), |o| o.tau_bar.clone())
        }),
        row!("2 §4.5, E_ψ", "Ė_ψ = Ė_φ τ̄ + E_φ τ̄˙", "", "`Sensitivity::E_psi`", Trees, |s| {
            sensitivity(s, |r| r.E_psi.clone(), |o| o.E_psi.clone())
        }),
        row!("2 §4.5, ψ", "ψ̇ = ψ Ė_ψ ψ", "", "`Sensitivity::psi`", Trees, |s| sensitivity(
            s,
            |r| r.psi.clone(),
            |o| o.psi.clone()
        )),
        row!(
            "2 §4.5, B",
            "Ḃ = 0: points are fixed in their bodies; J̇ = B* φ̇* H* + B* φ* Ḣ*",
            "",
            "`Sensitivity::phi`, `H`",
            Trees,
            |s| {
                let point = s.case.point.0;
                sensitivity(
                    s,
                    |r| {
                        mul!(t(&at_point(s, s.case.body)), t(&r.phi), t(&s.H))
                            + mul!(t(&at_point(s, s.case.body)), t(&s.phi), t(&r.H))
                    },
                    |o| {
                        let B = o
                            .pick_off(&[(s.case.body, Vec3(point.map(phipsi_spatial::Scalar::splat)))])
                            .unwrap();
                        mul!(t(&B), t(&o.phi), t(&o.H))
                    },
                )
            }
        ),
        row!(
            "2 §4.5, R",
            "Ṙ(p) = Σ (Ė R E* + E R Ė* + E Ṙ E*)",
            "",
            "`Sensitivity::R`",
            Trees,
            |s| sensitivity(s, |r| r.R.clone(), |o| o.R.clone())
        ),
        row!(
            "2 §4.5, Υ",
            "Υ̇(k) = ψ̇*Υψ + ψ*Υ̇ψ + ψ*Υψ̇ + (H*D⁻¹H)˙",
            "",
            "`Sensitivity::upsilon`",
            Trees,
            |s| sensitivity(s, |r| r.upsilon.clone(), |o| o.upsilon.clone())
        ),
        row!(
            "2 §4.5, S",
            "Ṡ = φ̇ M φ* + φ M φ̇*",
            "",
            "`Sensitivity::state_covariance`",
            Trees,
            |s| sensitivity(s, |r| r.state_covariance.clone(), |o| o.state_covariance())
        ),
        row!(
            "2 §4.5, Ω",
            "Ω̇ = ψ̇* H*D⁻¹H ψ + ψ* (H*D⁻¹H)˙ ψ + ψ* H*D⁻¹H ψ̇",
            "",
            "`Sensitivity::omega`",
            Trees,
            |s| sensitivity(s, |r| r.omega.clone(), |o| o.omega())
        ),
        row!(
            "2 §4.5, 𝓜",
            "𝓜˙ = H (φ̇ M φ* + φ M φ̇*) H* + Ḣ S H* + H S Ḣ*, (𝓜⁻¹)˙ = −𝓜⁻¹ 𝓜˙ 𝓜⁻¹",
            "",
            "`Sensitivity::mass_matrix`, `mass_matrix_inverse`",
            Trees,
            |s| of_mass(s)
        ),
        row!(
            "2 §4.5, ln det",
            "∂ ln det 𝓜 = tr(D⁻¹ Ḋ) = 2 tr(Υ Ė_φ P⁺ E_φ*)",
            "",
            "`Sensitivity::D`, `E_phi`",
            Trees,
            |s| of_log_determinant(s)
        ),
    ]
}
