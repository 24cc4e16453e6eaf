//! Paper 1, sections 3 to 7: the state-space model, the random field, covariance = inertia, batch estimates.

use crate::papers::row::{Equations, Row, eq, t};
use crate::papers::scene::{Scene, inverse, stacked, zeros};
use crate::{mul, row};
use nalgebra::DMatrix;
use phipsi_model::Random;
use phipsi_spatial::{Quaternion, Real, Vec3};
use phipsi_topology::{Operator, Space};

/// One block of a tree's edges at its place.
fn edges<T: Real>(s: &Scene<T>, blocks: &[DMatrix<T>]) -> DMatrix<T> {
    s.spatial(|i, j| (s.parent(j) == Some(i)).then(|| blocks[j].clone()))
}

/// φ⁻¹(p,k) = φ(k,p): of [[R, l~R], [0, R]] it is [[R*, (l~R)*], [0, R*]].
fn transitions<T: Real>(s: &Scene<T>) -> Equations<T> {
    let paths = s.spatial(|i, j| s.carries(i, j).then(|| s.transition(&s.blocks.shift, i, j)));
    let turned =
        |a: &DMatrix<T>| DMatrix::from_fn(6, 6, |i, j| a[(3 * (i / 3) + j % 3, 3 * (j / 3) + i % 3)]);
    let back: Vec<DMatrix<T>> =
        s.blocks.shift.iter().map(|a| if a.nrows() == 0 { a.clone() } else { turned(a) }).collect();
    let forth: Vec<DMatrix<T>> =
        s.blocks.shift.iter().map(|a| if a.nrows() == 0 { a.clone() } else { inverse(a) }).collect();
    eq(&s.phi, paths).and(edges(s, &forth), edges(s, &back))
}

/// Every body as six points of the same inertia: what the integral over the bodies' mass is for rigid ones.
fn points<T: Real>(s: &Scene<T>) -> Equations<T> {
    let (mut places, mut masses) = (vec![], vec![]);
    for (body, of) in s.case.model.bodies().iter().enumerate() {
        let inertia = of.inertia;
        if inertia.mass == 0.0 {
            continue;
        }
        let mass = T::splat(inertia.mass);
        let [x, y, z] = [0, 3, 5].map(|i| T::splat(inertia.tensor[i]));
        let turn = Quaternion(inertia.frame.rotation.map(T::splat)).to_rotation();
        let half = T::splat(0.5);
        // Two of six points on each axis: Σ m x² = (I_y + I_z − I_x)/2.
        for (axis, second) in
            [(y + z - x) * half, (z + x - y) * half, (x + y - z) * half].into_iter().enumerate()
        {
            let reach = (T::splat(3.0) * second / mass).sqrt();
            for side in [reach, -reach] {
                places.push((
                    body,
                    Vec3::splat(inertia.frame.translation) + turn * Vec3::unit(axis).scale(side),
                ));
                masses.push(mass / T::splat(6.0));
            }
        }
    }
    let picked = s.pick_off(&places).unwrap();
    let (six, three) = (picked.columns().clone(), Space::uniform(masses.len(), 3));
    let force = DMatrix::from_fn(6, 3, |i, j| if i == 3 + j { T::one() } else { T::zero() });
    let B = Operator::diagonal("[0, I]*", &six, &three, vec![force; masses.len()]).unwrap();
    let density = masses.iter().map(|&m| DMatrix::<T>::identity(3, 3) * m).collect();
    let rho = Operator::diagonal("ρ", &three, &three, density).unwrap();
    let field = &s.random_field().root().clone();
    let map = mul!(picked, B);
    eq(mul!(map, rho, t(&map)), &s.M)
        .and(mul!(s.H, s.phi, map, rho, t(&map), t(&s.phi), t(&s.H)), s.mass_of_reference())
        .and(mul!(field, t(field)), &s.M)
}

/// W, X, T of one draw against the recursion X(p) = Σ φ(p,k) X(k) + W(p).
fn sample<T: Real>(s: &Scene<T>) -> Equations<T> {
    let drawn = s.sample_field(&mut Random::new(s.seed));
    let mut X = s.cut_spatial(&drawn.W);
    for k in (0..s.n()).rev() {
        if let Some(p) = s.parent(k) {
            let moved = &s.blocks.shift[k] * &X[k];
            X[p] += moved;
        }
    }
    let T: Vec<DMatrix<T>> = (0..s.n()).map(|k| &s.blocks.H[k] * &X[k]).collect();
    eq(drawn.X, stacked(&X)).and(drawn.T, stacked(&T))
}

/// f(k) and T(k) tip to base, α(k) base to tip, body by body, without velocity terms.
fn boundary_values<T: Real>(s: &Scene<T>, forces: bool) -> DMatrix<T> {
    s.matrix(s.nv(), |rates| {
        let rates = s.cut(rates);
        let mut alpha: Vec<DMatrix<T>> = vec![];
        for k in 0..s.n() {
            let own = s.blocks.H[k].transpose() * &rates[k];
            alpha.push(match s.parent(k) {
                Some(p) => s.blocks.shift[k].transpose() * &alpha[p] + own,
                None => own,
            });
        }
        let mut f: Vec<DMatrix<T>> = (0..s.n()).map(|k| &s.blocks.M[k] * &alpha[k]).collect();
        for k in (0..s.n()).rev() {
            if let Some(p) = s.parent(k) {
                let moved = &s.blocks.shift[k] * &f[k];
                f[p] += moved;
            }
        }
        stacked(if forces { &f } else { &alpha })
    })
}

fn hinges<T: Real>(s: &Scene<T>) -> DMatrix<T> {
    s.diagonal_matrix(s.joint_space(), s.state_space(), &s.blocks.H)
}

/// Velocity terms: the componentwise rates of the operators against the reference in world axes.
fn with_velocities<T: Real>(s: &Scene<T>) -> Equations<T> {
    let (v, a) = (s.v(), s.a());
    let got = s.inverse_dynamics(&v, &a).unwrap();
    let want = phipsi_reference::inverse_dynamics(&s.case.model, &s.q, &v, &a, None);
    // Componentwise rates make terms as large as the square of what φ carries.
    let size = |a: &DMatrix<T>| a.iter().fold(0.0f64, |m, x| m.max(x.abs().to_f64()));
    let reach = size(&s.phi.dense().unwrap());
    let speed = v.iter().chain(&a).fold(1.0f64, |m, x| m + x.abs().to_f64());
    let terms = size(&s.M.dense().unwrap()) * reach * reach * speed * speed * 10.0;
    eq(got, want).of(T::splat(terms))
}

fn kinetic_energy<T: Real>(s: &Scene<T>) -> Equations<T> {
    let v = s.v();
    let V = mul!(t(&s.phi), t(&s.H)).apply(&v).unwrap();
    let dot = |x: &[T], y: &[T]| x.iter().zip(y).fold(T::zero(), |sum, (&x, &y)| sum + x * y) * T::splat(0.5);
    let by_bodies = s
        .cut_spatial(&V)
        .iter()
        .zip(&s.blocks.M)
        .fold(T::zero(), |sum, (V, M)| sum + (V.transpose() * M * V)[(0, 0)]);
    let want = phipsi_reference::kinetic_energy(&s.case.model, &s.q, &v);
    eq(dot(&V, &s.M.apply(&V).unwrap()), want)
        .and(by_bodies * T::splat(0.5), want)
        .and(dot(&v, &s.mass_matrix().apply(&v).unwrap()), want)
}

/// The block (k, j) of S: the composite inertia of the outer body, carried inward.
fn elements_of_S<T: Real>(s: &Scene<T>) -> Equations<T> {
    let R = &s.blocks.R;
    let block = |k: usize, j: usize| match (s.carries(k, j), s.carries(j, k)) {
        (true, _) => Some(s.transition(&s.blocks.shift, k, j) * &R[j]),
        (_, true) => Some(&R[k] * s.transition(&s.blocks.shift, j, k).transpose()),
        _ => None,
    };
    eq(s.state_covariance(), s.spatial(block))
}

/// |A|: what the terms of a product are as large as.
pub fn sizes<T: Real>(a: &DMatrix<T>) -> DMatrix<T> {
    a.map(|x| x.abs())
}

fn batch<T: Real>(s: &Scene<T>) -> Equations<T> {
    let S = s.state_covariance().dense().unwrap();
    let (right, inverse) = (&S * hinges(s).transpose(), s.mass_inverse_of_reference());
    eq(s.batch_gain(), &right * &inverse).of(sizes(&right) * sizes(&inverse))
}

/// E(X/T) by its defining property: the error X − 𝒢 T is orthogonal to what is measured.
fn orthogonality<T: Real>(s: &Scene<T>) -> Equations<T> {
    let S = s.state_covariance();
    eq(mul!(s.batch_gain(), s.H, S, t(&s.H)), mul!(S, t(&s.H)))
}

fn kalman_complement<T: Real>(s: &Scene<T>) -> Operator<T> {
    s.identity() - mul!(s.batch_gain(), s.H)
}

fn error_covariance<T: Real>(s: &Scene<T>) -> Equations<T> {
    let S = s.state_covariance();
    let (dense, H) = (S.dense().unwrap(), hinges(s));
    let removed = &dense * H.transpose() * s.mass_inverse_of_reference() * &H * &dense;
    let rest = kalman_complement(s);
    let want = &dense - removed;
    eq(mul!(rest, S, t(&rest)), want.clone())
        .of(&S)
        .and(s.smoothed_error_covariance(), want.clone())
        .of(&S)
        .and(mul!(S, t(&rest)), want)
        .of(&S)
}

fn no_error_at_joints<T: Real>(s: &Scene<T>) -> Equations<T> {
    let (S, P) = (s.state_covariance(), s.smoothed_error_covariance());
    let (n, nv) = (6 * s.n(), s.nv());
    eq(mul!(s.H, P), zeros(nv, n))
        .of(mul!(s.H, S))
        .and(mul!(P, t(&s.H)), zeros(n, nv))
        .of(mul!(S, t(&s.H)))
        .and(mul!(s.H, P, t(&s.H)), zeros(nv, nv))
        .of(s.mass_matrix())
}

fn inertial_error<T: Real>(s: &Scene<T>) -> Equations<T> {
    let right = mul!(s.H, s.phi);
    let estimated = mul!(s.M, t(&right), s.mass_matrix_inverse(), right);
    let rest = s.identity() - &estimated;
    eq(rest.clone(), s.identity() - mul!(s.M, s.omega())).of(estimated)
}

fn inertial_error_covariance<T: Real>(s: &Scene<T>) -> Equations<T> {
    let rest = s.identity() - mul!(s.M, s.omega());
    eq(s.inertial_force_error_covariance(), mul!(rest, s.M, t(&rest))).of(mul!(s.M, s.omega(), s.M))
}

/// The rows.
pub fn rows() -> Vec<Row> {
    vec![
        row!(
            "1 §3",
            "φ(k,i) = φ(k,m) φ(m,i), φ⁻¹(k,i) = φ(i,k), φ(k,k) = I",
            "",
            "`Operators::phi`",
            Trees,
            |s| transitions(s)
        ),
        row!("1 §4, V", "V = φ* H* θ̇", "", "`Operators::phi`, `H`", Trees, |s| eq(
            mul!(t(&s.phi), t(&s.H)),
            boundary_values(s, false)
        )),
        row!(
            "1 §4, f",
            "f(k) = φ(k,k−1) f(k−1) + M(k) α(k), α(k) = φ*(k+1,k) α(k+1) + H*(k) θ̈(k): f = φ M φ* H* θ̈",
            "velocity terms a(k) of α left out, see the next row",
            "`Operators::state_covariance`",
            Trees,
            |s| eq(mul!(s.state_covariance(), t(&s.H)), boundary_values(s, true))
        ),
        row!(
            "1 §4, a and b",
            "α = φ*(H* θ̈ + a), f = φ (M α + b), T = H f, with a(k) and b(k)",
            "a(k) is missing",
            "`Operators::inverse_dynamics`",
            Trees,
            |s| with_velocities(s)
        ),
        row!(
            "1 §4, 𝓜",
            "T = H f = 𝓜 θ̈, 𝓜 = H φ M φ* H*",
            "",
            "`Operators::mass_matrix`",
            Trees,
            |s| eq(s.mass_matrix(), s.mass_of_reference())
        ),
        row!(
            "1 §4, K.E.",
            "½ Σ V*(k) M(k) V(k) = ½ V* M V = ½ θ̇* 𝓜 θ̇",
            "",
            "`Operators::M`, `mass_matrix`",
            Trees,
            |s| kinetic_energy(s)
        ),
        row!("1 §4, f = z + Pα", "f = z + P α", "", "`Operators::smooth`", Trees, |s| eq(
            mul!(s.psi, s.K) + mul!(s.P, t(&s.psi), t(&s.H), s.D_inverse, s.innovations_operator()),
            mul!(s.state_covariance(), t(&s.H), s.mass_matrix_inverse())
        )),
        row!(
            "1 (5.1), (5.2)",
            "X(k) = Σ φ(k,c) X(c) + W(k), T(k) = H(k) X(k)",
            "one child c only: a chain",
            "`Operators::sample_field`",
            Trees,
            |s| sample(s)
        ),
        row!(
            "1 (5.3)",
            "E[W W*] = M: W = M^½ × white noise, M^½ (M^½)* = M",
            "",
            "`RandomField::root`",
            Trees,
            |s| {
                let root = s.random_field().root().clone();
                eq(mul!(root, t(&root)), &s.M)
            }
        ),
        row!("1 (5.4)", "X = φ W, T = H X", "", "`RandomField::sample`", Trees, |s| {
            let drawn = s.sample_field(&mut Random::new(s.seed + 1));
            eq(mul!(s.H, s.phi).apply(&drawn.W).unwrap(), drawn.T)
                .and(s.phi.apply(&drawn.W).unwrap(), drawn.X)
        }),
        row!(
            "1 §5, integral",
            "T = H φ B w, E[w w*] = ρ I: 𝓜 = H φ B ρ B* φ* H* over the mass points of all bodies",
            "B = [0, I]* is 6 × 3, E[w(x) w*(y)]",
            "`Operators::pick_off`",
            Trees,
            |s| points(s)
        ),
        row!(
            "1 Lemma 1 (6.1)",
            "S = φ M φ* = R + φ~R + R φ~*",
            "",
            "`Operators::state_covariance`, `R`",
            Trees,
            |s| eq(s.state_covariance(), &s.R + mul!(s.phi_tilde(), s.R) + mul!(s.R, t(&s.phi_tilde())))
        ),
        row!(
            "1 (6.2)",
            "R(k) = Σ φ(k,c) R(c) φ*(k,c) + M(k)",
            "one child c only",
            "`Operators::R`",
            Trees,
            |s| eq(&s.R, s.spatial_diagonal(&s.blocks.R))
        ),
        row!("1 Lemma 1, proof", "M = R − E_φ R E_φ*", "", "`Operators::R`", Trees, |s| eq(
            &s.R - mul!(s.E_phi, s.R, t(&s.E_phi)),
            &s.M
        )
        .of(&s.R)),
        row!(
            "1 Lemma 1, proof 2",
            "S = φ R φ* − φ E_φ R φ* E_φ* = (φ~ + I) R (φ~ + I)* − φ~ R φ~*",
            "",
            "`Operators::phi_tilde`",
            Trees,
            |s| eq(
                mul!(s.phi, s.R, t(&s.phi)) - mul!(s.phi, s.E_phi, s.R, t(&s.phi), t(&s.E_phi)),
                s.state_covariance()
            )
            .of(mul!(s.phi, s.R, t(&s.phi)))
        ),
        row!(
            "1 §6, elements",
            "S(k,j) = φ(k,j) R(j) for j outboard of k, R(k) φ*(j,k) for k outboard of j, else 0",
            "no third case on chains",
            "`Operators::state_covariance`",
            Trees,
            |s| elements_of_S(s)
        ),
        row!(
            "1 Lemma 2 (6.3)",
            "E[T T*] = 𝓜",
            "printed M for the mass matrix 𝓜",
            "`Operators::random_field`",
            Trees,
            |s| {
                let map = mul!(s.H, s.phi, s.random_field().root());
                eq(mul!(map, t(&map)), s.mass_of_reference())
            }
        ),
        row!(
            "1 (7.1)",
            "E(X/T) = 𝒢 T: E[(X − 𝒢 T) T*] = 0",
            "",
            "`Operators::batch_gain`",
            Trees,
            |s| orthogonality(s)
        ),
        row!("1 (7.2)", "𝒢 = S H* 𝓜⁻¹", "", "`Operators::batch_gain`", Trees, |s| batch(s)),
        row!("1 (7.3)", "θ̈ = 𝓜⁻¹ T", "", "`Operators::mass_matrix_inverse`", Trees, |s| eq(
            s.mass_matrix_inverse(),
            s.mass_inverse_of_reference()
        )),
        row!("1 (7.4)", "α = φ* H* θ̈", "", "`Operators::smooth`", Trees, |s| eq(
            mul!(t(&s.phi), t(&s.H), s.mass_matrix_inverse()),
            s.of_pass(|p| p.alpha)
        )),
        row!("1 §7, f", "E[X/T] = φ M α = f", "", "`Operators::batch_gain`", Trees, |s| eq(
            mul!(s.phi, s.M, t(&s.psi), t(&s.H), s.D_inverse, s.innovations_operator()),
            s.of_pass(|p| p.f)
        )
        .and(s.batch_gain().apply(&s.applied()).unwrap(), stacked(&s.pass(&s.applied()).f))),
        row!("1 §7, e", "X − f = (I − 𝒢 H) φ W", "", "`Operators::batch_gain`", Trees, |s| {
            let f = s.of_pass(|p| p.f) * hinges(s);
            eq(
                mul!(kalman_complement(s), s.phi),
                (DMatrix::identity(6 * s.n(), 6 * s.n()) - f) * s.phi.dense().unwrap(),
            )
            .of(&s.phi)
        }),
        row!(
            "1 (7.5)",
            "𝒫 = (I − 𝒢H) S (I − 𝒢H)* = (I − 𝒢H) S = S (I − 𝒢H)* = S − S H* 𝓜⁻¹ H S",
            "",
            "`Operators::smoothed_error_covariance`",
            Trees,
            |s| error_covariance(s)
        ),
        row!(
            "1 §7, H𝒫 = 0",
            "H 𝒫 = 0, 𝒫 H* = 0, H 𝒫 H* = 0",
            "",
            "`Operators::smoothed_error_covariance`",
            Trees,
            |s| no_error_at_joints(s)
        ),
        row!("1 §7, Ŵ", "Ŵ = M φ* H* 𝓜⁻¹ T = M α", "", "`Operators::smooth`", Trees, |s| eq(
            mul!(s.M, t(&s.phi), t(&s.H), s.mass_matrix_inverse()),
            s.spatial_diagonal(&s.blocks.M) * s.of_pass(|p| p.alpha)
        )),
        row!(
            "1 §7, W − Ŵ",
            "W − Ŵ = (I − M φ* H* 𝓜⁻¹ H φ) W = (I − M Ω) W",
            "",
            "`Operators::omega`",
            Trees,
            |s| inertial_error(s)
        ),
        row!(
            "1 §7, Q",
            "Q = M − M φ* H* 𝓜⁻¹ H φ M = (I − MΩ) M (I − MΩ)*",
            "",
            "`Operators::inertial_force_error_covariance`",
            Trees,
            |s| inertial_error_covariance(s)
        ),
    ]
}
