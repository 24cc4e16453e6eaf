//! Paper 1, sections 8 and 9: the Kalman filter factors the mass matrix; filter and smoother.

use crate::papers::row::{Equations, Form, Row, eq, t};
use crate::papers::scene::{Scene, inverse, stacked, zeros};
use crate::{mul, row};
use nalgebra::DMatrix;
use phipsi_spatial::Real;
use phipsi_topology::Operator;

/// 𝓚 = H φ K.
fn script_K<T: Real>(s: &Scene<T>) -> Operator<T> {
    mul!(s.H, s.phi, s.K)
}
/// 𝓛 = H ψ K.
fn script_L<T: Real>(s: &Scene<T>) -> Operator<T> {
    mul!(s.H, s.psi, s.K)
}
/// z of T.
fn z<T: Real>(s: &Scene<T>) -> Operator<T> {
    mul!(s.psi, s.K)
}
/// ν of T.
fn nu<T: Real>(s: &Scene<T>) -> Operator<T> {
    mul!(s.D_inverse, s.innovations_operator())
}
/// α of T.
fn alpha<T: Real>(s: &Scene<T>) -> Operator<T> {
    mul!(t(&s.psi), t(&s.H), nu(s))
}

/// Everything that the filter's equations define, against the recursion body by body.
fn kalman_filter<T: Real>(s: &Scene<T>) -> Equations<T> {
    let (state, joint, b) = (s.state_space(), s.joint_space(), &s.blocks);
    let inward = |columns: &phipsi_topology::Space, blocks: &[DMatrix<T>]| {
        s.assembled(state, columns, |i, j| (s.parent(j) == Some(i)).then(|| blocks[j].clone()))
    };
    eq(&s.P, s.spatial_diagonal(&b.P))
        .and(&s.D, s.diagonal_matrix(joint, joint, &b.D))
        .and(&s.G, s.diagonal_matrix(state, joint, &b.G))
        .and(&s.K, inward(joint, &b.K))
        .and(&s.tau_bar, s.spatial_diagonal(&b.tau_bar))
        .of(s.tau())
        .and(&s.E_psi, inward(state, &b.psi))
        .of(&s.E_phi)
}

fn definitions<T: Real>(s: &Scene<T>) -> Equations<T> {
    eq(mul!(s.H, s.P, t(&s.H)), &s.D)
        .and(mul!(s.P, t(&s.H), s.D_inverse), &s.G)
        .and(s.identity() - mul!(s.G, s.H), &s.tau_bar)
        .and(mul!(s.H, s.G), s.joint_identity())
}

/// D(k), and ν(k), of the bodies outboard of joint k with that joint free and all inboard ones locked: the inverse of the
/// block of 𝓜 that belongs to them.
fn floppy<T: Real>(s: &Scene<T>) -> Equations<T> {
    let mass = s.mass_of_reference();
    let joint = s.joint_space();
    let (mut D, mut residuals) = (vec![], zeros(s.nv(), s.nv()));
    for k in 0..s.n() {
        let outboard: Vec<usize> =
            (0..s.n()).filter(|&j| s.carries(k, j)).flat_map(|j| joint.range(j)).collect();
        let block = DMatrix::from_fn(outboard.len(), outboard.len(), |i, j| mass[(outboard[i], outboard[j])]);
        let solved = inverse(&block);
        // k is the first of its subtree.
        let size = joint.size(k);
        D.push(inverse(&solved.view((0, 0), (size, size)).into_owned()));
        for i in 0..size {
            for (j, &column) in outboard.iter().enumerate() {
                residuals[(joint.range(k).start + i, column)] = solved[(i, j)];
            }
        }
    }
    eq(&s.D, s.diagonal_matrix(joint, joint, &D)).and(nu(s), residuals)
}

/// Rows of some bodies.
fn picked<T: Real>(s: &Scene<T>, bodies: impl Iterator<Item = usize>) -> Operator<T> {
    let nodes: Vec<usize> = bodies.collect();
    let blocks = vec![DMatrix::identity(6, 6); nodes.len()];
    Operator::pick_off("B", s.state_space(), nodes, blocks).unwrap()
}
fn tips<T: Real>(s: &Scene<T>) -> Operator<T> {
    let children = s.tree().children();
    picked(s, (0..s.n()).filter(|&k| children[k].is_empty()))
}
fn roots<T: Real>(s: &Scene<T>) -> Operator<T> {
    picked(s, (0..s.n()).filter(|&k| s.parent(k).is_none()))
}

fn at_the_tips<T: Real>(s: &Scene<T>) -> Equations<T> {
    let B = tips(s);
    eq(mul!(t(&B), z(s)), zeros(B.columns().dimension(), s.nv()))
        .of(&s.G)
        .and(mul!(t(&B), s.P, B), mul!(t(&B), s.M, B))
}

fn at_the_base<T: Real>(s: &Scene<T>) -> Equations<T> {
    let B = roots(s);
    eq(mul!(t(&B), t(&s.E_phi), alpha(s)), zeros(B.columns().dimension(), s.nv())).of(alpha(s))
}

/// Filter and smoother as values.
fn values<T: Real>(s: &Scene<T>) -> Equations<T> {
    let tau = s.applied();
    let filtered = s.filter(&tau).unwrap();
    let smoothed = s.smooth(&filtered).unwrap();
    let want = s.pass(&tau);
    eq(filtered.z, stacked(&want.z))
        .of(stacked(&want.f))
        .and(filtered.epsilon, stacked(&want.epsilon))
        .and(filtered.nu, stacked(&want.nu))
        .and(filtered.z_plus, stacked(&want.z_plus))
        .and(smoothed.alpha_plus, stacked(&want.alpha_plus))
        .of(stacked(&want.alpha))
        .and(smoothed.alpha, stacked(&want.alpha))
        .and(smoothed.acceleration, stacked(&want.acceleration))
        .and(smoothed.f, stacked(&want.f))
}

/// z(k+1) = ψ(k+1,k) z(k) + K(k+1,k) T(k), gathered over the children.
fn z_recursion<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    s.matrix(s.nv(), |tau| {
        let tau = s.cut(tau);
        let mut z = vec![zeros(6, 1); s.n()];
        for k in (0..s.n()).rev() {
            if let Some(p) = s.parent(k) {
                let moved = &s.blocks.psi[k] * &z[k] + &s.blocks.K[k] * &tau[k];
                z[p] += moved;
            }
        }
        stacked(&z)
    })
}

/// θ̈(k) = ν(k) − K*(k+1,k) α(k+1), α(k) = φ*(k+1,k) α(k+1) + H*(k) θ̈(k).
fn bryson_frazier<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    s.matrix(s.nv(), |nu| {
        let (mut rates, mut alpha) = (s.cut(nu), vec![zeros(6, 1); s.n()]);
        for k in 0..s.n() {
            if let Some(p) = s.parent(k) {
                rates[k] -= s.blocks.K[k].transpose() * &alpha[p];
                alpha[k] = s.blocks.shift[k].transpose() * &alpha[p];
            }
            alpha[k] += s.blocks.H[k].transpose() * &rates[k];
        }
        stacked(&rates)
    })
}

fn dense_inverse<T: Real>(a: &Operator<T>) -> Form<T> {
    inverse(&a.dense().unwrap()).into()
}

/// The rows.
pub fn rows() -> Vec<Row> {
    vec![
        row!(
            "1 (8.1)",
            "𝓜 = (I + 𝓚) D (I + 𝓚*), 𝓚 = H φ K",
            "",
            "`Operators::factor`",
            Trees,
            |s| eq(mul!(s.factor(), s.D, t(&s.factor())), s.mass_of_reference())
        ),
        row!(
            "1 (8.2)",
            "𝓜⁻¹ = (I − 𝓛*) D⁻¹ (I − 𝓛), 𝓛 = H ψ K",
            "",
            "`Operators::mass_matrix_inverse`, `Operator::inverse`",
            Trees,
            |s| eq(s.mass_matrix_inverse(), s.mass_inverse_of_reference())
                .and(s.mass_matrix().inverse().unwrap(), s.mass_inverse_of_reference())
        ),
        row!(
            "1 §8, filter",
            "P(k) = Σ ψ(k,c) P(c) ψ*(k,c) + M(k), D, G, K, τ̄, ψ as printed",
            "one child c only",
            "`Operators::new`, `Innovations`",
            Trees,
            |s| kalman_filter(s)
        ),
        row!(
            "1 §8, definitions",
            "D = H P H*, G = P H* D⁻¹, τ = G H, τ̄ = I − τ; H G = I",
            "printed D = H P H",
            "`Operators::D`, `G`, `tau_bar`",
            Trees,
            |s| definitions(s)
        ),
        row!(
            "1 §8, K and E_ψ",
            "K = E_φ G, E_ψ = E_φ τ̄",
            "",
            "`Operators::K`, `E_psi`",
            Trees,
            |s| eq(mul!(s.E_phi, s.G), &s.K).and(mul!(s.E_phi, s.tau_bar), &s.E_psi).of(&s.E_phi)
        ),
        row!(
            "1 §8, ψ",
            "ψ = (I − E_ψ)⁻¹, ψ(k,m) = Π ψ(i+1,i)",
            "",
            "`Operators::psi`",
            Trees,
            |s| eq(&s.psi, s.spatial(|i, j| s.carries(i, j).then(|| s.transition(&s.blocks.psi, i, j))))
                .and(&s.psi, dense_inverse(&(s.identity() - &s.E_psi)))
        ),
        row!(
            "1 Lemma 3 (8.3)",
            "S = P + φ~P + P φ~* + φ K D K* φ*",
            "",
            "`Operators::state_covariance`, `P`",
            Trees,
            |s| eq(
                &s.P + mul!(s.phi_tilde(), s.P)
                    + mul!(s.P, t(&s.phi_tilde()))
                    + mul!(s.phi, s.K, s.D, t(&s.K), t(&s.phi)),
                s.state_covariance()
            )
        ),
        row!("1 Lemma 3, proof", "τ̄ P τ̄* = τ̄ P = P τ̄*", "", "`Operators::tau_bar`", Trees, |s| {
            eq(mul!(s.tau_bar, s.P, t(&s.tau_bar)), mul!(s.tau_bar, s.P))
                .of(&s.P)
                .and(mul!(s.tau_bar, s.P), mul!(s.P, t(&s.tau_bar)))
                .of(&s.P)
        }),
        row!(
            "1 Lemma 3, proof 2",
            "P = E_ψ P E_ψ* + M = E_φ P E_φ* + M − K D K*",
            "printed K D K for K D K*",
            "`Operators::P`",
            Trees,
            |s| eq(mul!(s.E_psi, s.P, t(&s.E_psi)) + &s.M, &s.P)
                .and(mul!(s.E_phi, s.P, t(&s.E_phi)) + &s.M - mul!(s.K, s.D, t(&s.K)), &s.P)
                .of(mul!(s.E_phi, s.P, t(&s.E_phi)))
        ),
        row!(
            "1 Lemma 4",
            "𝓜 = (I + 𝓚) D (I + 𝓚)*, 𝓚 = H φ~ G = H φ K",
            "",
            "`Operators::factor`",
            Trees,
            |s| eq(script_K(s), mul!(s.H, s.phi_tilde(), s.G))
                .of(s.factor())
                .and(mul!(s.factor(), s.D, t(&s.factor())), s.mass_matrix())
        ),
        row!(
            "1 Lemma 5",
            "ψ⁻¹ = φ⁻¹ + K H = I − E_ψ = φ⁻¹ + E_φ τ",
            "",
            "`Operator::inverse`",
            Trees,
            |s| eq(s.phi.inverse().unwrap() + mul!(s.K, s.H), dense_inverse(&s.psi))
                .and(s.phi.inverse().unwrap() + mul!(s.E_phi, s.tau()), s.identity() - &s.E_psi)
        ),
        row!(
            "1 Lemma 6",
            "(I + 𝓚)⁻¹ = I − 𝓛",
            "",
            "`Operators::innovations_operator`, `Operator::inverse`",
            Trees,
            |s| eq(s.innovations_operator(), dense_inverse(&s.factor()))
                .and(s.factor().inverse().unwrap(), s.innovations_operator())
                .and(mul!(s.innovations_operator(), s.factor()), s.joint_identity())
        ),
        row!(
            "1 Lemma 6, 𝓚 and 𝓛",
            "𝓚 = 𝓛 + 𝓚𝓛 = 𝓛 + 𝓛𝓚, 𝓛𝓚 = 𝓚𝓛",
            "printed as K, L, which are other operators",
            "`Operators::factor`",
            Trees,
            |s| {
                let (k, l) = (script_K(s), script_L(s));
                eq(&l + mul!(k, l), &k)
                    .of(s.factor())
                    .and(&l + mul!(l, k), &k)
                    .of(s.factor())
                    .and(mul!(l, k), mul!(k, l))
                    .of(s.factor())
            }
        ),
        row!(
            "1 Lemma 6, proof",
            "φ − ψ = ψ K H φ = φ K H ψ, (I − 𝓛)(I + 𝓚) = I − 𝓛 + (I − 𝓛) H φ K",
            "",
            "`Operators::psi`",
            Trees,
            |s| eq(mul!(s.psi, s.K, s.H, s.phi), &s.phi - &s.psi)
                .of(&s.phi)
                .and(mul!(s.phi, s.K, s.H, s.psi), &s.phi - &s.psi)
                .of(&s.phi)
                .and(
                    s.innovations_operator() + mul!(s.innovations_operator(), s.H, s.phi, s.K),
                    s.joint_identity()
                )
        ),
        row!(
            "1 §9, θ̈",
            "θ̈ = (I − 𝓛*) D⁻¹ (I − 𝓛) T",
            "",
            "`Operators::filter`, `smooth`",
            Trees,
            |s| eq(s.mass_matrix_inverse(), s.of_pass(|p| p.acceleration))
        ),
        row!("1 §9, ε", "ε = (I − 𝓛) T", "", "`Operators::innovations_operator`", Trees, |s| eq(
            s.innovations_operator(),
            s.of_pass(|p| p.epsilon)
        )),
        row!(
            "1 §9, z",
            "z = ψ K T: z(k+1) = Σ ψ(k+1,k) z(k) + K(k+1,k) T(k)",
            "starts at z(1) = 0, not z(0) = 0",
            "`Operators::filter`",
            Trees,
            |s| eq(z(s), z_recursion(s)).of(&s.G)
        ),
        row!("1 §9, ε(k)", "ε(k) = T(k) − H(k) z(k)", "", "`Filtered::epsilon`", Trees, |s| eq(
            s.joint_identity() - mul!(s.H, z(s)),
            s.of_pass(|p| p.epsilon)
        )),
        row!("1 §9, ν", "ν = D⁻¹ ε", "", "`Filtered::nu`", Trees, |s| eq(nu(s), s.of_pass(|p| p.nu))),
        row!("1 (9.1)", "θ̈ = (I − 𝓛*) ν", "", "`Operators::innovations_operator`", Trees, |s| eq(
            t(&s.innovations_operator()),
            bryson_frazier(s)
        )),
        row!("1 (9.2)", "α = ψ* H* ν", "", "`Smoothed::alpha`", Trees, |s| eq(
            alpha(s),
            mul!(t(&s.phi), t(&s.H), s.mass_matrix_inverse())
        )),
        row!("1 §9, θ̈ of α", "θ̈ = ν − K* α", "", "`Smoothed::acceleration`", Trees, |s| eq(
            nu(s) - mul!(t(&s.K), alpha(s)),
            s.mass_inverse_of_reference()
        )),
        row!(
            "1 §9, smoother",
            "θ̈(k) = ν(k) − K*(k+1,k) α(k+1), α(k) = φ*(k+1,k) α(k+1) + H*(k) θ̈(k)",
            "",
            "`Operators::smooth`",
            Trees,
            |s| eq(s.joint_identity() - mul!(t(&s.K), t(&s.psi), t(&s.H)), bryson_frazier(s))
        ),
        row!(
            "1 (9.3)",
            "z = 0 and P = M at the tips",
            "printed P(0) = 0 starts before the first body",
            "`Operators::filter`",
            Trees,
            |s| at_the_tips(s)
        ),
        row!("1 (9.4)", "P⁺ = (I − G H) P", "", "`Operators::tau_bar`", Trees, |s| eq(
            mul!(s.tau_bar, s.P),
            s.spatial_diagonal(&s.blocks.P_plus)
        )
        .of(&s.P)),
        row!(
            "1 (9.5)",
            "P(k) = Σ φ(k,c) P⁺(c) φ*(k,c) + M(k)",
            "one child c only",
            "`Operators::P`",
            Trees,
            |s| eq(mul!(s.E_phi, s.tau_bar, s.P, t(&s.E_phi)) + &s.M, s.spatial_diagonal(&s.blocks.P))
        ),
        row!(
            "1 (9.6)",
            "D = H P H*, G = P H* D⁻¹",
            "printed G = P H* without D⁻¹",
            "`Operators::D`, `G`",
            Trees,
            |s| eq(
                mul!(s.P, t(&s.H), s.D_inverse),
                s.diagonal_matrix(s.state_space(), s.joint_space(), &s.blocks.G)
            )
            .and(mul!(s.H, s.P, t(&s.H)), s.diagonal_matrix(s.joint_space(), s.joint_space(), &s.blocks.D))
            .printed(mul!(s.P, t(&s.H)), &s.G)
        ),
        row!("1 (9.7)", "ε = T − H z", "", "`Filtered::epsilon`", Trees, |s| eq(
            s.joint_identity() - mul!(s.H, z(s)),
            s.of_pass(|p| p.epsilon)
        )),
        row!("1 (9.8)", "ν = D⁻¹ ε", "", "`Filtered::nu`", Trees, |s| eq(nu(s), s.of_pass(|p| p.nu))),
        row!("1 (9.9)", "z⁺ = z + G ε", "", "`Filtered::z_plus`", Trees, |s| eq(
            z(s) + mul!(s.G, s.innovations_operator()),
            s.of_pass(|p| p.z_plus)
        )),
        row!("1 (9.10)", "z(k+1) = Σ φ(k+1,k) z⁺(k)", "one child k only", "`Filtered::z`", Trees, |s| {
            eq(mul!(s.E_phi, z(s) + mul!(s.G, s.innovations_operator())), s.of_pass(|p| p.z)).of(&s.G)
        }),
        row!("1 (9.11)", "α⁺ = 0 at the roots", "", "`Operators::smooth`", Trees, |s| at_the_base(s)),
        row!("1 (9.12)", "α⁺(k) = φ*(k+1,k) α(k+1)", "", "`Smoothed::alpha_plus`", Trees, |s| eq(
            mul!(t(&s.E_phi), alpha(s)),
            s.of_pass(|p| p.alpha_plus)
        )
        .of(alpha(s))),
        row!("1 (9.13)", "θ̈ = ν − G* α⁺", "", "`Smoothed::acceleration`", Trees, |s| eq(
            nu(s) - mul!(t(&s.G), t(&s.E_phi), alpha(s)),
            s.of_pass(|p| p.acceleration)
        )),
        row!("1 (9.14)", "α = α⁺ + H* θ̈", "", "`Smoothed::alpha`", Trees, |s| eq(
            mul!(t(&s.E_phi), alpha(s)) + mul!(t(&s.H), s.mass_matrix_inverse()),
            s.of_pass(|p| p.alpha)
        )),
        row!(
            "1 (9.3)–(9.14), values",
            "filter and smoother of one T",
            "",
            "`Operators::filter`, `Operators::smooth`",
            Trees,
            |s| values(s)
        ),
        row!(
            "1 §9, D and ν",
            "D(k) is the inertia, ν(k) the acceleration of joint k if all inboard joints are locked",
            "",
            "`Operators::D`, `Filtered::nu`",
            Trees,
            |s| floppy(s)
        ),
    ]
}
