//! Paper 2, sections 4.6 to 4.8: closed chains, under-actuated systems, free bases.

use crate::papers::factors::{condition, constraint, small};
use crate::papers::operators::{at_point, jacobian_of_reference};
use crate::papers::row::{Equations, Row, eq, none, t};
use crate::papers::scene::{Scene, inverse, stacked, zeros};
use crate::{mul, row};
use nalgebra::DMatrix;
use phipsi_model::Random;
use phipsi_spatial::Real;
use phipsi_topology::{Innovations, Operator, Space};

/// L with L L* = A, lower triangular.
fn cholesky<T: Real>(a: &DMatrix<T>) -> DMatrix<T> {
    let n = a.nrows();
    let mut l = zeros(n, n);
    for j in 0..n {
        for i in j..n {
            let sum = (0..j).fold(a[(i, j)], |sum, k| sum - l[(i, k)] * l[(j, k)]);
            l[(i, j)] = if i == j { sum.sqrt() } else { sum / l[(j, j)] };
        }
    }
    l
}

/// Two points on two bodies: B has a column block a point.
fn two_points<T: Real>(s: &Scene<T>) -> Equations<T> {
    let (first, second) = (s.bodies()[0], s.bodies()[s.n() - 1]);
    let picked = |body: usize| at_point(s, body).dense().unwrap();
    let point = phipsi_spatial::Vec3(s.case.point.0.map(T::splat));
    let B = s.pick_off(&[(first, point), (second, point)]).unwrap();
    let rows = [jacobian_of_reference(s, first), jacobian_of_reference(s, second)];
    let J = DMatrix::from_fn(12, s.nv(), |i, j| rows[i / 6][(i % 6, j)]);
    let separate =
        DMatrix::from_fn(6 * s.n(), 12, |i, j| picked(if j < 6 { first } else { second })[(i, j % 6)]);
    eq(mul!(t(&B), s.omega(), B), &J * s.mass_inverse_of_reference() * J.transpose()).and(B, separate)
}

fn one_point<T: Real>(s: &Scene<T>) -> Equations<T> {
    let B = at_point(s, s.case.body);
    eq(mul!(t(&B), s.upsilon, B), mul!(t(&B), s.omega(), B))
}

/// A loop to the ground, or between two bodies where there are enough: B, and its Ω.
fn closure<T: Real>(s: &Scene<T>) -> Option<(Operator<T>, DMatrix<T>)> {
    let (node, mut B) = constraint(s, 3)?;
    if let Some(other) = (0..s.n()).find(|&k| !s.carries(k, node)) {
        let mut random = Random::new(s.seed ^ 0x0074_776f);
        let block = DMatrix::from_fn(6, B.columns().dimension(), |_, _| T::splat(random.signed()));
        B = &B + &Operator::pick_off("B", s.state_space(), vec![other], vec![block]).unwrap();
    }
    let omega = mul!(t(&B), s.omega(), B).dense().unwrap();
    (condition(&omega, &inverse(&omega)).to_f64() < 1e4).then_some((B, omega))
}

/// D^−½, one block a joint, with D^−½ D (D^−½)* = I, and b̂ with or without it.
fn unit_operator<T: Real>(
    s: &Scene<T>,
    B: &Operator<T>,
    omega: &DMatrix<T>,
) -> (Operator<T>, Operator<T>, Operator<T>) {
    let blocks = s.blocks.D.iter().map(|D| inverse(&cholesky(D))).collect();
    let root = Operator::diagonal("D^−½", s.joint_space(), s.joint_space(), blocks).unwrap();
    let scale = small("Ω^−½", B.columns(), inverse(&cholesky(omega)).transpose());
    let printed = mul!(s.H, s.psi, B, scale);
    (mul!(root, printed), printed, root)
}

/// Accelerations with B* α = 0, by Lagrange multipliers.
fn multipliers<T: Real>(s: &Scene<T>, B: &Operator<T>) -> DMatrix<T> {
    let minv = s.mass_inverse_of_reference();
    let J = mul!(t(B), t(&s.phi), t(&s.H)).dense().unwrap();
    let compliance = inverse(&(&J * &minv * J.transpose()));
    &minv - &minv * J.transpose() * compliance * &J * &minv
}

fn closed_chain<T: Real>(s: &Scene<T>) -> Equations<T> {
    let Some((B, omega)) = closure(s) else { return none() };
    let (b, _, root) = unit_operator(s, &B, &omega);
    let L = s.innovations_operator();
    let projection = s.joint_identity() - mul!(b, t(&b));
    let terms = s.mass_inverse_of_reference() * condition(&omega, &inverse(&omega));
    eq(mul!(t(&L), t(&root), projection, root, L), multipliers(s, &B)).of(terms)
}

fn unit<T: Real>(s: &Scene<T>) -> Equations<T> {
    let Some((B, omega)) = closure(s) else { return none() };
    let (b, printed, _) = unit_operator(s, &B, &omega);
    let one = Operator::identity(B.columns());
    let projection = mul!(b, t(&b));
    // The root of Ω rounds by its condition.
    let lost = condition(&omega, &inverse(&omega));
    eq(mul!(t(&b), b), one.clone())
        .of(lost)
        .and(mul!(projection, projection), projection)
        .of(lost)
        .printed(mul!(t(&printed), printed), one)
}

/// What the three steps at the end of §4.6 give, the last one a smoother.
fn in_three_steps<T: Real>(s: &Scene<T>) -> Equations<T> {
    let Some((B, omega)) = closure(s) else { return none() };
    let tau = s.applied();
    let filtered = s.filter(&tau).unwrap();
    // The bias that the loop force leaves: λ = Ω⁻¹ B* α of the open chain.
    let open = s.smooth(&filtered).unwrap();
    let lambda =
        inverse(&omega) * DMatrix::from_column_slice(omega.nrows(), 1, &t(&B).apply(&open.alpha).unwrap());
    let pushed = mul!(s.H, s.psi, B).apply(lambda.as_slice()).unwrap();
    let mut closed = filtered.clone();
    closed.epsilon = filtered.epsilon.iter().zip(pushed).map(|(&e, x)| e - x).collect();
    closed.nu = s.D_inverse.apply(&closed.epsilon).unwrap();
    let accelerations = s.smooth(&closed).unwrap();
    let want = multipliers(s, &B) * DMatrix::from_column_slice(tau.len(), 1, &tau);
    let lost = condition(&omega, &inverse(&omega));
    let terms = |x: Vec<T>| x.into_iter().map(|x| x * lost).collect::<Vec<T>>();
    eq(accelerations.acceleration, want)
        .of(terms(open.acceleration))
        .and(t(&B).apply(&accelerations.alpha).unwrap(), zeros(omega.nrows(), 1))
        .of(terms(open.alpha))
}

/// The joints whose motion is given.
fn active<T: Real>(s: &Scene<T>, k: usize) -> bool {
    (k as u64 + s.seed).is_multiple_of(3)
}

/// Operators of the passive joints: τ̄ = I at active ones, whose rows of H_p are empty.
struct Passive<T> {
    H_a: Operator<T>,
    H_p: Operator<T>,
    factors: Innovations<T>,
    rows: [Vec<usize>; 2],
}

fn passive<T: Real>(s: &Scene<T>, active: impl Fn(usize) -> bool) -> Option<Passive<T>> {
    let part = |name: &str, wanted: bool| {
        let chosen = |k: usize| active(k) == wanted;
        let space = Space::new((0..s.n()).map(|k| if chosen(k) { s.joint_space().size(k) } else { 0 }));
        let blocks =
            (0..s.n()).map(|k| if chosen(k) { s.blocks.H[k].clone() } else { zeros(0, 6) }).collect();
        let rows: Vec<usize> =
            (0..s.n()).filter(|&k| chosen(k)).flat_map(|k| s.joint_space().range(k)).collect();
        (Operator::diagonal(name, &space, s.state_space(), blocks).unwrap(), rows)
    };
    let ((H_a, a), (H_p, p)) = (part("H_a", true), part("H_p", false));
    if a.is_empty() || p.is_empty() {
        return None;
    }
    let factors = Innovations::new(&H_p, &s.E_phi, &s.M).ok()?;
    Some(Passive { H_a, H_p, factors, rows: [a, p] })
}

/// A part of a joint matrix.
fn part<T: Real>(m: &DMatrix<T>, rows: &[usize], columns: &[usize]) -> DMatrix<T> {
    DMatrix::from_fn(rows.len(), columns.len(), |i, j| m[(rows[i], columns[j])])
}

impl<T: Real> Passive<T> {
    fn S_pp(&self) -> Operator<T> {
        self.factors.inverse()
    }
    fn S_ap(&self) -> Operator<T> {
        let f = &self.factors;
        let through = mul!(f.psi, f.shifted_gain);
        let back = mul!(f.articulated, t(&f.psi), t(&self.H_p), f.inverse_pivots, f.inverse_factor());
        mul!(self.H_a, through + back)
    }
    fn S_aa(&self, s: &Scene<T>) -> Operator<T> {
        let f = &self.factors;
        let omega = mul!(t(&f.psi), t(&self.H_p), f.inverse_pivots, self.H_p, f.psi);
        let inner = mul!(f.psi, s.M, t(&f.psi)) - mul!(f.articulated, omega, f.articulated);
        mul!(self.H_a, inner, t(&self.H_a))
    }
}

fn hybrid<T: Real>(s: &Scene<T>, which: usize) -> Equations<T> {
    let Some(of) = passive(s, |k| active(s, k)) else { return none() };
    let mass = s.mass_of_reference();
    let [a, p] = &of.rows;
    let (M_aa, M_ap) = (part(&mass, a, a), part(&mass, a, p));
    let M_pp_inverse = inverse(&part(&mass, p, p));
    match which {
        0 => {
            let L = of.factors.inverse_factor();
            eq(of.S_pp(), M_pp_inverse.clone()).printed(mul!(L, of.factors.inverse_pivots, L), M_pp_inverse)
        }
        1 => eq(of.S_ap(), M_ap * M_pp_inverse).of(s.factor()),
        2 => eq(of.S_aa(s), &M_aa - &M_ap * M_pp_inverse * M_ap.transpose()).of(M_aa),
        _ => {
            // Any accelerations and the forces that they need.
            let rates = s.a();
            let forces = &mass * DMatrix::from_column_slice(rates.len(), 1, &rates);
            let pick =
                |rows: &[usize], x: &dyn Fn(usize) -> T| rows.iter().map(|&i| x(i)).collect::<Vec<T>>();
            let (rate_a, rate_p) = (pick(a, &|i| rates[i]), pick(p, &|i| rates[i]));
            let (force_a, force_p) = (pick(a, &|i| forces[i]), pick(p, &|i| forces[i]));
            let add = |x: Vec<T>, y: Vec<T>| x.into_iter().zip(y).map(|(x, y)| x + y).collect::<Vec<T>>();
            let got_a = add(of.S_aa(s).apply(&rate_a).unwrap(), of.S_ap().apply(&force_p).unwrap());
            let got_p = add((-t(&of.S_ap())).apply(&rate_a).unwrap(), of.S_pp().apply(&force_p).unwrap());
            let terms = part(&mass, a, a).map(|x| x.abs()) * DMatrix::from_element(a.len(), 1, T::one());
            eq(got_a, force_a).of(terms).and(got_p, rate_p).of(of.S_pp().apply(&force_p).unwrap())
        }
    }
}

/// Every body has mass, and the base is free: what two-sided views need.
fn floats<T: Real>(s: &Scene<T>) -> bool {
    s.shape.free && s.n() > 1 && s.blocks.M.iter().all(|M| M[(5, 5)].to_f64() > 0.0)
}

/// S(k), S⁺(k), and with joint forces s⁺(k), from the base outward; s may be wanted or not.
struct Inboard<T> {
    S: Vec<DMatrix<T>>,
    S_plus: Vec<DMatrix<T>>,
    s_plus: Vec<DMatrix<T>>,
    z: Vec<DMatrix<T>>,
    /// What eliminating inboard joints may lose: the largest ratio of inertias with them locked and free.
    growth: T,
}

fn inboard<T: Real>(s: &Scene<T>, tau: &[T]) -> Inboard<T> {
    let (b, n) = (&s.blocks, s.n());
    let (pass, T) = (s.pass(tau), s.cut(tau));
    let (mut S, mut S_plus) = (vec![zeros(6, 6); n], vec![zeros(6, 6); n]);
    let mut s_plus = vec![zeros(6, 1); n];
    let (mut locked, mut growth) = (vec![zeros(6, 6); n], T::one());
    // On the base acts nothing but its own force.
    s_plus[0] = -(inverse(&b.H[0]) * &T[0]);
    let children = s.tree().children();
    for k in 1..n {
        let p = s.parent(k).expect("one root");
        let (mut inertia, mut bias) = (&b.M[p] + &S_plus[p], s_plus[p].clone());
        let mut whole = &b.M[p] + &locked[p];
        for &j in children[p].iter().filter(|&&j| j != k) {
            inertia += &b.shift[j] * &b.P_plus[j] * b.shift[j].transpose();
            bias += &b.shift[j] * &pass.z_plus[j];
            whole += &b.shift[j] * &b.R[j] * b.shift[j].transpose();
        }
        let back = inverse(&b.shift[k]);
        S[k] = &back * inertia * back.transpose();
        let own = &back * bias;
        locked[k] = &back * whole * back.transpose();
        let at_joint = |a: &DMatrix<T>| &b.H[k] * a * b.H[k].transpose();
        let pivot = inverse(&at_joint(&S[k]));
        let held = at_joint(&locked[k]);
        growth = (0..pivot.nrows()).fold(growth, |m, i| m.larger(held[(i, i)] * pivot[(i, i)]));
        let gain = &S[k] * b.H[k].transpose() * pivot;
        S_plus[k] = &S[k] - &gain * &b.H[k] * &S[k];
        s_plus[k] = &own - gain * (&T[k] + &b.H[k] * &own);
    }
    Inboard { S, S_plus, s_plus, z: pass.z, growth }
}

fn two_sided<T: Real>(s: &Scene<T>, which: usize) -> Equations<T> {
    if !floats(s) {
        return none();
    }
    let tau = s.applied();
    let sides = inboard(s, &tau);
    let b = &s.blocks;
    let sums: Vec<DMatrix<T>> = (0..s.n()).map(|k| &b.P[k] + &sides.S_plus[k]).collect();
    let both: Vec<DMatrix<T>> = sums.iter().map(inverse).collect();
    // The inverse of a sum rounds by its condition after scaling, the sum itself by the growth of the inboard sweep.
    let scaled = |k: usize| (0..6).fold(T::one(), |m, i| m.larger(sums[k][(i, i)] * both[k][(i, i)]));
    let lost = (0..s.n()).fold(T::one(), |m, k| m.larger(scaled(k))) * sides.growth;
    match which {
        0 => eq(&s.upsilon, s.spatial_diagonal(&both)).of(s.spatial_diagonal(&both) * lost),
        1 => {
            let minv = s.mass_inverse_of_reference();
            let joint = s.joint_space();
            let block = |k: usize, whole: bool| match (k, whole) {
                (0, _) => zeros(joint.size(0), joint.size(0)),
                (_, true) => inverse(
                    &minv
                        .view((joint.range(k).start, joint.range(k).start), (joint.size(k), joint.size(k)))
                        .into_owned(),
                ),
                _ => &b.H[k] * &b.P[k] * inverse(&(&b.P[k] + &sides.S[k])) * &sides.S[k] * b.H[k].transpose(),
            };
            let all = |whole: bool| {
                s.diagonal_matrix(joint, joint, &(0..s.n()).map(|k| block(k, whole)).collect::<Vec<_>>())
            };
            eq(all(false), all(true)).of(all(true) * lost)
        }
        _ => {
            let alpha: Vec<DMatrix<T>> =
                (0..s.n()).map(|k| -(&both[k] * (&sides.z[k] + &sides.s_plus[k]))).collect();
            let terms: Vec<T> = stacked(&alpha).into_iter().map(|x| x * lost).collect();
            eq(stacked(&alpha), s.smooth(&s.filter(&tau).unwrap()).unwrap().alpha).of(terms)
        }
    }
}

/// The base of a free flyer is passive, everything else active.
fn free_flyer<T: Real>(s: &Scene<T>) -> Equations<T> {
    if !floats(s) {
        return none();
    }
    let Some(of) = passive(s, |k| k != 0) else { return none() };
    let mass = s.mass_of_reference();
    let [a, p] = &of.rows;
    let body = s.bodies()[s.n() - 1];
    let B = at_point(s, body);
    let J = jacobian_of_reference(s, body);
    let all: Vec<usize> = (0..6).collect();
    let removed = inverse(&part(&mass, p, p)) * part(&mass, p, a);
    let generalized = mul!(t(&B), t(&s.phi), t(&of.H_a) - mul!(t(&of.H_p), t(&of.S_ap())));
    let momentum = mul!(of.H_p, s.phi, s.M, t(&s.phi), t(&of.H_a) - mul!(t(&of.H_p), t(&of.S_ap())));
    eq(generalized, part(&J, &all, a) - part(&J, &all, p) * &removed)
        .of(J)
        .and(momentum, zeros(p.len(), a.len()))
        .of(s.mass_matrix())
}

/// The rows.
pub fn rows() -> Vec<Row> {
    vec![
        row!(
            "2 (4.18)",
            "B* Ω B = B* ψ* H* D⁻¹ H ψ B = J 𝓜⁻¹ J*, at several points",
            "",
            "`Operators::omega`, `pick_off`",
            Trees,
            |s| two_points(s)
        ),
        row!(
            "2 (4.19)",
            "Λ = E_ψ* Λ E_ψ + H* D⁻¹ H; Λ is Υ of paper 1",
            "",
            "`Operators::upsilon`",
            Chains,
            |s| eq(mul!(t(&s.E_psi), s.upsilon, s.E_psi) + mul!(t(&s.H), s.D_inverse, s.H), &s.upsilon)
        ),
        row!(
            "2 (4.19), trees",
            "B* Λ B = B* Ω B at one point, Λ(k) = ψ*(p,k) Λ(p) ψ(p,k) + H*(k) D⁻¹(k) H(k)",
            "diagonal blocks of Ω only: not for several points",
            "`Operators::upsilon`",
            Trees,
            |s| one_point(s)
        ),
        row!(
            "2 (4.20)",
            "θ̈ = (I − HψK)* D^−½ (I − b̂ b̂*) D^−½ (I − HψK) T solves B* α = 0",
            "α for θ̈",
            "`Operators::innovations_operator`",
            Trees,
            |s| closed_chain(s)
        ),
        row!(
            "2 (4.21)",
            "b̂ = D^−½ H ψ B Ω^−½: b̂* b̂ = I, (b̂ b̂*)² = b̂ b̂*",
            "D^−½ is missing",
            "`Operators::psi`",
            Trees,
            |s| unit(s)
        ),
        row!(
            "2 §4.6, steps",
            "filter, remove the loop's bias from the innovations, smooth",
            "last step printed as filtering",
            "`Operators::filter`, `smooth`",
            Trees,
            |s| in_three_steps(s)
        ),
        row!(
            "2 (4.22)",
            "T_a = S_aa β_a + S_ap T_p, β_p = −S_ap* β_a + S_pp T_p, β accelerations",
            "dots",
            "`Innovations`",
            Trees,
            |s| hybrid(s, 3)
        ),
        row!(
            "2 (4.23)",
            "S_pp = (I − H_p ψ K_p)* D_p⁻¹ (I − H_p ψ K_p) = 𝓜_pp⁻¹, τ̄ = I at active joints",
            "first factor without its star",
            "`Innovations::inverse`",
            Trees,
            |s| hybrid(s, 0)
        ),
        row!(
            "2 §4.7, S_ap",
            "S_ap = H_a [ψ K_p + P ψ* H_p* D_p⁻¹ (I − H_p ψ K_p)] = 𝓜_ap 𝓜_pp⁻¹",
            "\"similar expressions\": not printed",
            "`Innovations`",
            Trees,
            |s| hybrid(s, 1)
        ),
        row!(
            "2 §4.7, S_aa",
            "S_aa = H_a (ψ M ψ* − P Ω_p P) H_a* = 𝓜_aa − 𝓜_ap 𝓜_pp⁻¹ 𝓜_pa",
            "not printed",
            "`Innovations`",
            Trees,
            |s| hybrid(s, 2)
        ),
        row!(
            "2 §4.8, Υ",
            "Υ(k) = (P(k) + S⁺(k))⁻¹, S(k) the articulated inertia of everything inboard of joint k",
            "in words only",
            "`Operators::upsilon`",
            Free,
            |s| two_sided(s, 0)
        ),
        row!(
            "2 §4.8, joints",
            "[𝓜⁻¹(k,k)]⁻¹ = H P (P + S)⁻¹ S H*",
            "in words only",
            "`Operators::mass_matrix_inverse`",
            Free,
            |s| two_sided(s, 1)
        ),
        row!(
            "2 §4.8, α",
            "α(k) = −(P(k) + S⁺(k))⁻¹ (z(k) + s⁺(k)), each body by itself",
            "in words only",
            "`Operators::smooth`",
            Free,
            |s| two_sided(s, 2)
        ),
        row!(
            "2 §4.8, free flyer",
            "zero momentum: β_base = −S_ap* β_a; generalized Jacobian B* φ* (H_a* − H_p* S_ap*)",
            "in words only",
            "`Innovations`",
            Free,
            |s| free_flyer(s)
        ),
    ]
}
