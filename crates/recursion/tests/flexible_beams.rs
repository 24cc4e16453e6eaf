//! Frequencies of mechanisms of beams against transcendental equations and power series, and their limits.

use nalgebra::{DMatrix, SymmetricEigen};
use phipsi_model::{
    Beam, BeamModes, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Section,
};
use phipsi_recursion::{
    Form, FormForwardDynamics, Layout, forward_dynamics, inverse_dynamics_derivatives, mass_matrix,
    mass_matrix_inverse, refined_forward_dynamics,
};
use phipsi_spatial::Dd;

const fn section(mass_per_length: f64, bending_stiffness: f64) -> Section {
    Section {
        mass_per_length,
        bending_stiffness: [bending_stiffness; 2],
        torsional_stiffness: 1.0,
        polar_inertia: 0.0,
        axial_stiffness: 1.0,
    }
}

fn at(x: f64) -> Placement {
    Placement { translation: [x, 0.0, 0.0], ..Placement::IDENTITY }
}

const FIXED: JointKind = JointKind::Fixed;
const ABOUT_Z: JointKind = JointKind::Revolute { axis: [0.0, 0.0, 1.0] };

/// Frequencies of small vibrations about q = 0 at velocities v, with further joint stiffness; the joints of `locked` dofs do not
/// move.
fn frequencies(model: &Model, v: &[f64], springs: &[(usize, f64)], locked: usize) -> Vec<f64> {
    let layout = Layout::<f64>::new(model);
    let (q, n) = (model.neutral::<f64>(), model.nv());
    let (mut stiffness, _, _) = inverse_dynamics_derivatives(&layout, &q, v, &vec![0.0; n], None).unwrap();
    for &(i, k) in springs {
        stiffness[i * n + i] += k;
    }
    let mass = mass_matrix(&layout, &q).unwrap();
    let free = n - locked;
    let block = |m: &[f64]| DMatrix::from_fn(free, free, |i, j| m[(locked + i) * n + locked + j]);
    let c = block(&mass).cholesky().expect("a positive definite mass matrix").l();
    let left = c.solve_lower_triangular(&block(&stiffness)).unwrap();
    let standard = c.solve_lower_triangular(&left.transpose()).unwrap();
    let eigen = SymmetricEigen::new((&standard + standard.transpose()) * 0.5);
    let mut squares: Vec<f64> = eigen.eigenvalues.iter().copied().collect();
    squares.sort_by(f64::total_cmp);
    squares.iter().map(|x| x.signum() * x.abs().sqrt()).collect()
}

/// A straight arm of two links, its base clamped, with a spring at its joint and a mass at its tip.
fn arm(family: BeamModes, modes: usize, tip_mass: f64) -> Model {
    let link = |length, stiffness| {
        Beam::new(length, section(1.0, stiffness)).family(family).bending([modes, 0]).build()
    };
    let mut builder = ModelBuilder::new("arm")
        .gravity([0.0; 3])
        .body(Body::flexible("first", link(1.0, 3.0)))
        .body(Body::flexible("second", link(0.8, 1.0)))
        .joint(Joint::new("base", FIXED), "world", "first")
        .joint_at_node(Joint::new("elbow", ABOUT_Z), "first", "tip", "second");
    if tip_mass > 0.0 {
        builder = builder
            .body(Body::new("payload", Inertia { mass: tip_mass, ..Inertia::ZERO }))
            .joint_at_node(Joint::new("grip", FIXED), "second", "tip", "payload");
    }
    builder.build().unwrap()
}

/// Published errors have one digit: ours may be half or twice as large.
fn about(error: f64, table: f64) -> bool {
    error > 0.5 * table && error < 2.0 * table
}

/// Joint spring, tip mass, frequencies, errors of both families.
type Row<'a> = (f64, f64, &'a [f64], [f64; 3], [f64; 3]);

#[test]
fn frequencies_of_a_two_link_arm() {
    // kh, mt; ω; errors of the first (flexible) frequency with 2, 4, 8 modes of both families.
    let table: [Row<'_>; 3] = [
        (
            5.0,
            0.0,
            &[1.74018821357, 7.93404487962, 25.5189010116, 43.9488280169],
            [2e-2, 9e-3, 4e-3],
            [6e-6, 5e-7, 2e-8],
        ),
        (
            5.0,
            0.4,
            &[1.21477037753, 6.5093856784, 21.7470686579, 39.6176965834],
            [3e-2, 1e-2, 5e-3],
            [1e-6, 1e-7, 6e-9],
        ),
        (
            0.0,
            0.4,
            &[0.0, 4.29474495128, 20.0958547034, 34.5284917096, 69.5290961728],
            [7e-4, 9e-5, 1e-5],
            [3e-5, 3e-6, 2e-7],
        ),
    ];
    for (spring, tip_mass, exact, free, interface) in table {
        let first = exact.iter().position(|x| *x > 0.0).unwrap();
        for (i, modes) in [2, 4, 8].into_iter().enumerate() {
            for (family, errors) in [(BeamModes::ClampedFree, free), (BeamModes::Interface, interface)] {
                let model = arm(family, modes, tip_mass);
                let omega = frequencies(&model, &vec![0.0; model.nv()], &[(0, spring)], 0);
                let error = omega[first] / exact[first] - 1.0;
                assert!(
                    about(error, errors[i]),
                    "{family:?}, {modes} modes, spring {spring}, tip {tip_mass}: {error:e}, table {:e}",
                    errors[i]
                );
                if family == BeamModes::Interface && modes == 8 {
                    for (found, want) in omega.iter().zip(exact).skip(first) {
                        assert!((found / want - 1.0).abs() < 1e-4, "{found} {want}");
                    }
                }
            }
        }
    }
}

/// A cantilever on a hub that spins with γ = Ω √(ρA L⁴/EI), hub radius δ L.
fn spinning(modes: usize, radius: f64, stiffened: bool) -> Model {
    let beam = Beam::new(1.0, section(1.0, 1.0)).family(BeamModes::ClampedFree).bending([modes; 2]);
    let beam = if stiffened { beam.stiffened() } else { beam };
    ModelBuilder::new("blade")
        .gravity([0.0; 3])
        .body(Body::new("hub", Inertia::from_principal(1.0, [0.0; 3], [1.0; 3])))
        .body(Body::flexible("blade", beam.build()))
        .joint(Joint::new("spin", ABOUT_Z), "world", "hub")
        .joint(Joint::new("root", FIXED).at(at(radius)), "hub", "blade")
        .build()
        .unwrap()
}

const GAMMAS: [f64; 5] = [1.0, 2.0, 4.0, 6.0, 10.0];
const FLAP: [[f64; 5]; 2] = [
    [3.681646814, 4.137319573, 5.585001421, 7.360373019, 11.20232776],
    [3.888823502, 4.833688872, 7.475047792, 10.44386587, 16.60636284],
];

fn spun(model: &Model, gamma: f64) -> Vec<f64> {
    let mut v = vec![0.0; model.nv()];
    v[0] = gamma;
    frequencies(model, &v, &[], 1)
}

#[test]
fn a_stiffened_cantilever_spins() {
    for (radius, table) in FLAP.iter().enumerate() {
        for (gamma, flap) in GAMMAS.iter().zip(table) {
            let found = spun(&spinning(8, radius as f64, true), *gamma);
            let lag = (flap * flap - gamma * gamma).sqrt();
            // Lag is the lower of the two; errors of eight modes grow with γ⁴ or so.
            let budget = 1e-5 * (gamma / 4.0).powi(4).max(1.0);
            assert!((found[0] / lag - 1.0).abs() < budget * 4.0, "lag {gamma}: {} {lag}", found[0]);
            assert!((found[1] / flap - 1.0).abs() < budget, "flap {gamma}: {} {flap}", found[1]);
        }
    }
    for (modes, error) in [(2, 8e-4), (4, 4e-5), (8, 2e-6)] {
        let found = spun(&spinning(modes, 0.0, true), 4.0)[1] / FLAP[0][2] - 1.0;
        assert!(about(found, error), "{modes} modes: {found:e}, table {error:e}");
    }
}

/// In-plane vibrations of a beam that also stretches (slenderness 70), about the unstretched state: Coriolis forces couple the two.
/// Published: Hamza-cherif and Houmat, 24th ICAS congress, table 2.
#[test]
fn a_stretching_cantilever_spins() {
    let section = Section { axial_stiffness: 70.0 * 70.0, ..section(1.0, 1.0) };
    let beam = Beam::new(1.0, section).family(BeamModes::ClampedFree).bending([8, 0]).axial(6).stiffened();
    let model = ModelBuilder::new("blade")
        .gravity([0.0; 3])
        .body(Body::new("hub", Inertia::from_principal(1.0, [0.0; 3], [1.0; 3])))
        .body(Body::flexible("blade", beam.build()))
        .joint(Joint::new("spin", ABOUT_Z), "world", "hub")
        .joint(Joint::new("root", FIXED), "hub", "blade")
        .build()
        .unwrap();
    let layout = Layout::<f64>::new(&model);
    let (q, n) = (model.neutral::<f64>(), model.nv());
    let free = n - 1;
    // γ, frequency, and the part of it that the printed digits and the expansion behind them leave open.
    let table = [
        (2.0, 3.6195, 2e-4),
        (4.0, 3.888, 2e-4),
        (6.0, 4.2393, 2e-4),
        (8.0, 4.6105, 2e-4),
        (10.0, 4.97, 1e-3),
    ];
    for (gamma, want, part) in table {
        let mut v = vec![0.0; n];
        v[0] = gamma;
        let (k, g, m) = inverse_dynamics_derivatives(&layout, &q, &v, &vec![0.0; n], None).unwrap();
        let block = |x: &[f64]| DMatrix::from_fn(free, free, |i, j| x[(1 + i) * n + 1 + j]);
        let lu = block(&m).lu();
        let (k, g) = (lu.solve(&block(&k)).unwrap(), lu.solve(&block(&g)).unwrap());
        let mut first_order = DMatrix::zeros(2 * free, 2 * free);
        for i in 0..free {
            first_order[(i, free + i)] = 1.0;
            for j in 0..free {
                first_order[(free + i, j)] = -k[(i, j)];
                first_order[(free + i, free + j)] = -g[(i, j)];
            }
        }
        let eigen = first_order.complex_eigenvalues();
        let lowest = eigen.iter().map(|x| x.im).filter(|x| *x > 1e-3).fold(f64::INFINITY, f64::min);
        assert!((lowest / want - 1.0).abs() < part, "{gamma}: {lowest} {want}");
    }
}

/// Without stiffening the in-plane square is ω₁² − Ω², which is wrong; the model says so exactly.
#[test]
fn a_cantilever_without_stiffening_softens() {
    let first = phipsi_model::flexible::clamped_free_roots(1)[0].powi(2);
    for gamma in [1.0, 2.0, 3.0, 4.0] {
        let model = spinning(4, 0.0, false);
        let found = spun(&model, gamma);
        let square = found[0] * found[0].abs();
        assert!((square - (first * first - gamma * gamma)).abs() < 1e-10, "{gamma}: {square}");
    }
}

/// A column under a payload: weight over the Euler load, interface basis with stiffening.
#[test]
fn a_column_buckles_under_its_payload() {
    let euler = std::f64::consts::PI.powi(2) / 4.0;
    let lowest = |modes: usize, load: f64| {
        // Gravity along −x of the column, which stands along x; its own mass is small.
        let beam = Beam::new(1.0, section(1e-9, 1.0)).bending([modes, 0]).stiffened().build();
        let model = ModelBuilder::new("column")
            .gravity([-1.0, 0.0, 0.0])
            .body(Body::flexible("column", beam))
            .body(Body::new("payload", Inertia { mass: load, ..Inertia::ZERO }))
            .joint(Joint::new("base", FIXED), "world", "column")
            .joint_at_node(Joint::new("top", FIXED), "column", "tip", "payload")
            .build()
            .unwrap();
        let layout = Layout::<f64>::new(&model);
        let n = model.nv();
        let rest = vec![0.0; n];
        let (k, _, _) = inverse_dynamics_derivatives(&layout, &rest, &rest, &rest, None).unwrap();
        SymmetricEigen::new(DMatrix::from_row_slice(n, n, &k)).eigenvalues.min()
    };
    for (modes, table) in [(1, 1.00017), (3, 1.000008)] {
        let (mut low, mut high) = (0.5 * euler, 2.0 * euler);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if lowest(modes, middle) > 0.0 { low = middle } else { high = middle }
        }
        let excess = low / euler - 1.0;
        assert!(about(excess, table - 1.0), "{modes} modes: {excess:e}");
    }
}

/// An arm in three dimensions, with a payload on a fixed joint.
fn loaded_arm(payload: f64, stiffness: f64) -> Model {
    let beam = |stiffness| {
        let section = Section {
            mass_per_length: 1.0,
            bending_stiffness: [stiffness, 0.7 * stiffness],
            torsional_stiffness: 0.5 * stiffness,
            polar_inertia: 0.01,
            axial_stiffness: 1.0,
        };
        Beam::new(1.0, section).bending([1, 1]).torsion(1).build()
    };
    let block = Inertia::from_principal(payload, [0.1, 0.05, 0.0], [0.02, 0.03, 0.04].map(|x| x * payload));
    ModelBuilder::new("arm")
        .body(Body::flexible("upper", beam(stiffness)))
        .body(Body::flexible("lower", beam(0.8 * stiffness)))
        .body(Body::new("payload", block))
        .joint(Joint::new("shoulder", JointKind::Spherical), "world", "upper")
        .joint_at_node(
            Joint::new("elbow", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }),
            "upper",
            "tip",
            "lower",
        )
        .joint_at_node(Joint::new("grip", FIXED), "lower", "tip", "payload")
        .build()
        .unwrap()
}

fn largest<T: phipsi_spatial::Real>(x: &[T]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.to_f64().abs()))
}

/// A payload that is a body of its own keeps twelve digits after one refinement, up to a million times the arm's mass.
#[test]
fn a_heavy_payload_is_refined() {
    for payload in [1.0, 1e3, 1e6] {
        let model = loaded_arm(payload, 10.0);
        let state = model.random_state(3);
        let layout = Layout::<f64>::new(&model);
        let tau: Vec<f64> = model.random_state(4).v;
        let refined = refined_forward_dynamics(&layout, &state.q, &state.v, &tau, None).unwrap();
        let widened = |x: &[f64]| x.iter().map(|&x| Dd::from_f64(x)).collect::<Vec<Dd>>();
        let wide = Layout::<Dd>::new(&model);
        let exact =
            forward_dynamics(&wide, &widened(&state.q), &widened(&state.v), &widened(&tau), None).unwrap();
        let error = refined.iter().zip(&exact).fold(0.0f64, |m, (x, y)| m.max((x - y.hi).abs()));
        let relative = error / largest(&exact);
        assert!(relative < 1e-12, "payload {payload:e}: {relative:e}");
        let mut chosen = FormForwardDynamics::new(&model, &layout, Form::Auto);
        let mut out = vec![0.0; model.nv()];
        chosen.run(&layout, &state.q, &state.v, &tau, None, &mut out).unwrap();
        let error = out.iter().zip(&exact).fold(0.0f64, |m, (x, y)| m.max((x - y.hi).abs()));
        assert!(error < 1e-11 * largest(&exact), "payload {payload:e}, {}: {error:e}", chosen.form());
    }
}

/// As K grows the joints accelerate as those of the rigid mechanism: the difference falls like 1/K.
#[test]
fn a_stiff_body_is_rigid() {
    let rigid = {
        let flexible = loaded_arm(2.0, 1.0);
        let body = |k: usize| Body::new(flexible.bodies()[k].name.as_str(), flexible.bodies()[k].inertia);
        ModelBuilder::new("rigid")
            .body(body(0))
            .body(body(1))
            .body(body(2))
            .joint(Joint::new("shoulder", JointKind::Spherical), "world", "upper")
            .joint(
                Joint::new("elbow", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }).at(at(1.0)),
                "upper",
                "lower",
            )
            .joint(Joint::new("grip", FIXED).at(at(1.0)), "lower", "payload")
            .build()
            .unwrap()
    };
    let state = rigid.random_state(8);
    let tau: Vec<f64> = rigid.random_state(9).v;
    let want = forward_dynamics(&Layout::<f64>::new(&rigid), &state.q, &state.v, &tau, None).unwrap();
    // At rest in the deformation that the rigid motion's forces give, η̈ = 0: K η balances them, found by Newton's method.
    let mut before = f64::INFINITY;
    for stiffness in [1e4, 1e6, 1e8] {
        let model = loaded_arm(2.0, stiffness);
        let layout = Layout::<Dd>::new(&model);
        let widened = |x: &[f64]| x.iter().map(|&x| Dd::from_f64(x)).collect::<Vec<Dd>>();
        let (n, modes) = (model.nv(), model.modes());
        let joints = n - modes;
        let mut q = widened(&state.q);
        q.resize(model.nq(), Dd::from_f64(0.0));
        let mut v = widened(&state.v);
        v.resize(n, Dd::from_f64(0.0));
        let mut forces = widened(&tau);
        forces.resize(n, Dd::from_f64(0.0));
        let mut a = Vec::new();
        for _ in 0..40 {
            a = forward_dynamics(&layout, &q, &v, &forces, None).unwrap();
            // K δη = Λ⁻¹ η̈ with Λ the modes' block of M⁻¹: the force that is not balanced.
            let inverse = mass_matrix_inverse(&layout, &q).unwrap();
            let rest = vec![Dd::from_f64(0.0); n];
            let (k, _, _) = inverse_dynamics_derivatives(&layout, &q, &rest, &rest, None).unwrap();
            let block = |x: &[Dd]| DMatrix::from_fn(modes, modes, |i, j| x[(joints + i) * n + joints + j].hi);
            let second = DMatrix::from_fn(modes, 1, |i, _| a[joints + i].hi);
            let load = block(&inverse).lu().solve(&second).unwrap();
            let change = block(&k).lu().solve(&load).unwrap();
            for i in 0..modes {
                q[model.joint_nq() + i] += Dd::from_f64(change[(i, 0)]);
            }
        }
        assert!(largest(&a[joints..]) < 1e-9 * largest(&a), "not balanced: {:e}", largest(&a[joints..]));
        let error = want.iter().zip(&a).fold(0.0f64, |m, (x, y)| m.max((x - y.hi).abs())) / largest(&want);
        assert!(error < 0.05 * before && error < 1e4 / stiffness, "{stiffness:e}: {error:e} {before:e}");
        before = error;
    }
}
