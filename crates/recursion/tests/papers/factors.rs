//! Paper 2, (4.9) to (4.17): inverse of the Jacobian, factorisations, diagonalised dynamics.

use crate::papers::operators::at_point;
use crate::papers::row::{Equations, Row, eq, none, t};
use crate::papers::scene::{Scene, inverse};
use crate::{mul, row};
use nalgebra::DMatrix;
use phipsi_model::Random;
use phipsi_spatial::{Motion, Real, Wrench};
use phipsi_topology::Operator;

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

/// The rows.
pub fn rows() -> Vec<Row> {
    vec![
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
    ]
}
