//! Batches of states: lanes of every width, every place and every tail give the bits of one state by itself.

mod common;

use common::{agree_on, growth, seeds};
use phipsi_model::Random;
use phipsi_recursion as fast;
use phipsi_recursion::batch::{Input, StateKernel, kernels, run_batch};
use phipsi_recursion::{About, DynamicsError, Layout};
use phipsi_reference as slow;
use phipsi_reference::generate::{Case, Limits, case, case_within};
use phipsi_reference::sensitivity::widened;
use phipsi_spatial::lanes::{Fused, Level};
use phipsi_spatial::{Vec3, Wrench};

/// Trees that every kernel is tried on.
const TREES: u64 = 200;

/// More states than two packs of the widest lanes.
const STATES: usize = 17;

/// States of one tree.
struct States {
    case: Case,
    layout: Layout<f64>,
    weightless: Layout<f64>,
    q: Vec<f64>,
    v: Vec<f64>,
    /// Forces or accelerations.
    x: Vec<f64>,
    points: Vec<f64>,
    wrenches: Vec<f64>,
    loaded: [usize; 1],
}

impl States {
    fn new(seed: u64) -> Self {
        let case = case(seed);
        let mut random = Random::new(seed);
        let (mut q, mut v) = (case.q.clone(), case.v.clone());
        for i in 1..STATES as u64 {
            let state = case.model.random_state(seed * 100 + i);
            q.extend(state.q);
            v.extend(state.v);
        }
        let mut numbers = |n: usize| (0..n * STATES).map(|_| random.signed()).collect::<Vec<f64>>();
        let layout = Layout::new(&case.model);
        States {
            x: numbers(case.model.nv()),
            points: numbers(3),
            wrenches: numbers(6),
            weightless: layout.clone().with_gravity(Vec3::zero()),
            loaded: [case.body],
            case,
            layout,
            q,
            v,
        }
    }
    fn row<'a>(&self, x: &'a [f64], state: usize) -> &'a [f64] {
        let n = x.len() / STATES;
        &x[state * n..(state + 1) * n]
    }
    fn point(&self, state: usize) -> Vec3<f64> {
        let x = self.row(&self.points, state);
        Vec3([x[0], x[1], x[2]])
    }
    fn loads(&self, state: usize) -> Vec<Wrench<f64>> {
        let mut loads = vec![Wrench::zero(); self.case.model.len()];
        let x = self.row(&self.wrenches, state);
        loads[self.case.body] = Wrench::from_array(std::array::from_fn(|i| x[i]));
        loads
    }
}

/// Something done with every kernel of [`kernels`]: its name, the kernel, its inputs, and the function of one state.
trait Visit {
    fn visit<K: StateKernel>(
        &mut self,
        name: &str,
        kernel: K,
        inputs: &[&[f64]],
        one: &dyn Fn(usize) -> Result<Vec<f64>, DynamicsError>,
    );
}

fn fused(x: &[f64]) -> Vec<Fused> {
    x.iter().map(|&x| Fused(x)).collect()
}

fn fused_loads(loads: &[Wrench<f64>]) -> Vec<Wrench<Fused>> {
    loads.iter().map(|w| w.map(Fused)).collect()
}

/// Forward dynamics of one state; on plain f64 it may take other steps than lanes do.
fn forward(s: &States, i: usize, loads: Option<&[Wrench<f64>]>) -> Result<Vec<f64>, DynamicsError> {
    let [q, v, x] = [&s.q, &s.v, &s.x].map(|x| fused(s.row(x, i)));
    let loads = loads.map(fused_loads);
    let a = fast::forward_dynamics(&s.layout, &q, &v, &x, loads.as_deref())?;
    Ok(a.iter().map(|x| x.0).collect())
}

type Three = (Vec<f64>, Vec<f64>, Vec<f64>);

fn three((a, b, c): Three) -> Vec<f64> {
    [a, b, c].concat()
}

fn every_kernel(s: &States, visitor: &mut impl Visit) {
    let States { case, layout, weightless, loaded, .. } = s;
    let (body, model) = (Some(case.body), &case.model);
    let (q, v, x) = (|i| s.row(&s.q, i), |i| s.row(&s.v, i), |i| s.row(&s.x, i));
    let loads = |i| s.loads(i);
    let zero = vec![0.0; s.v.len()];
    let (full, none): (&[usize], &[usize]) = (loaded, &[]);

    let active: Vec<bool> = (0..model.nv()).map(|i| i % 3 == 1).collect();
    let kernel = kernels::HybridDynamics { layout, active: &active, loaded: full };
    visitor.visit("hybrid dynamics", kernel, &[&s.q, &s.v, &s.x, &s.wrenches], &|i| {
        let [q, v, x] = [&s.q, &s.v, &s.x].map(|x| fused(s.row(x, i)));
        let loads = fused_loads(&loads(i));
        let (a, tau) = fast::hybrid_dynamics(layout, &q, &v, &active, &x, &x, Some(&loads))?;
        Ok(a.iter()
            .zip(&tau)
            .zip(&active)
            .map(|((a, tau), active)| if *active { tau.0 } else { a.0 })
            .collect())
    });
    let kernel = kernels::ForwardDynamics { layout, loaded: full };
    visitor.visit("forward dynamics under wrenches", kernel, &[&s.q, &s.v, &s.x, &s.wrenches], &|i| {
        forward(s, i, Some(&loads(i)))
    });
    let kernel = kernels::ForwardDynamics { layout, loaded: none };
    visitor.visit("forward dynamics", kernel, &[&s.q, &s.v, &s.x], &|i| forward(s, i, None));
    let kernel = kernels::InverseDynamics { layout, loaded: full };
    visitor.visit("inverse dynamics", kernel, &[&s.q, &s.v, &s.x, &s.wrenches], &|i| {
        fast::inverse_dynamics(layout, q(i), v(i), x(i), Some(&loads(i)))
    });
    let kernel = kernels::InverseDynamics { layout, loaded: none };
    visitor.visit("bias forces", kernel, &[&s.q, &s.v, &zero], &|i| fast::bias_forces(layout, q(i), v(i)));
    visitor.visit("gravity forces", kernel, &[&s.q, &zero, &zero], &|i| fast::gravity_forces(layout, q(i)));
    let kernel = kernels::InverseDynamics { layout: weightless, loaded: none };
    visitor.visit("product with the mass matrix", kernel, &[&s.q, &zero, &s.x], &|i| {
        fast::multiply_by_mass_matrix(layout, q(i), x(i))
    });
    visitor
        .visit("mass matrix", kernels::MassMatrix { layout }, &[&s.q], &|i| fast::mass_matrix(layout, q(i)));
    visitor.visit("inverse of the mass matrix", kernels::MassMatrixInverse { layout }, &[&s.q], &|i| {
        fast::mass_matrix_inverse(layout, q(i))
    });
    visitor.visit("solution", kernels::MassMatrixSolution { layout }, &[&s.q, &s.x], &|i| {
        fast::solve_mass_matrix(layout, q(i), x(i))
    });
    let kernel = kernels::ForwardDynamicsDerivatives { layout, loaded: full };
    visitor.visit("derivatives of forward dynamics", kernel, &[&s.q, &s.v, &s.x, &s.wrenches], &|i| {
        let [q, v, x] = [q(i), v(i), x(i)].map(fused);
        let all = fast::forward_dynamics_derivatives(layout, &q, &v, &x, Some(&fused_loads(&loads(i))))?;
        Ok([all.0, all.1, all.2].concat().iter().map(|x| x.0).collect())
    });
    let kernel = kernels::InverseDynamicsDerivatives { layout, loaded: full };
    visitor.visit("derivatives of inverse dynamics", kernel, &[&s.q, &s.v, &s.x, &s.wrenches], &|i| {
        fast::inverse_dynamics_derivatives(layout, q(i), v(i), x(i), Some(&loads(i))).map(three)
    });
    let kernel = kernels::JointReactions { model, layout, loaded: full };
    visitor.visit("joint reactions", kernel, &[&s.q, &s.v, &s.x, &s.wrenches], &|i| {
        let reactions = fast::joint_reactions(model, layout, q(i), v(i), x(i), Some(&loads(i)))?;
        Ok(reactions.iter().flat_map(|f| f.to_array()).collect())
    });
    visitor.visit("pose", kernels::BodyPose { layout, body }, &[&s.q], &|i| {
        Ok(fast::body_pose(layout, q(i), body)?.to_homogeneous().concat())
    });
    visitor.visit("velocity", kernels::BodyVelocity { layout, body }, &[&s.q, &s.v], &|i| {
        Ok(fast::body_velocity(layout, q(i), v(i), body)?.to_array().to_vec())
    });
    let kernel = kernels::Jacobian { layout, body };
    visitor.visit("Jacobian", kernel, &[&s.q, &s.points], &|i| {
        Ok(fast::jacobian(layout, q(i), body, Some(s.point(i)))?.concat())
    });
    visitor.visit("Jacobian of the origin", kernel, &[&s.q], &|i| {
        Ok(fast::jacobian(layout, q(i), body, None)?.concat())
    });
    visitor.visit("kinetic energy", kernels::KineticEnergy { layout }, &[&s.q, &s.v], &|i| {
        Ok(vec![fast::kinetic_energy(layout, q(i), v(i))?])
    });
    visitor.visit("potential energy", kernels::PotentialEnergy { layout }, &[&s.q], &|i| {
        Ok(vec![fast::potential_energy(layout, q(i))?])
    });
    visitor.visit("center of mass", kernels::CenterOfMass { layout }, &[&s.q], &|i| {
        Ok(fast::center_of_mass(layout, q(i))?.0.to_vec())
    });
    let kernel = kernels::Momentum { layout };
    visitor.visit("momentum", kernel, &[&s.q, &s.v], &|i| {
        Ok(fast::momentum(layout, q(i), v(i), About::CenterOfMass)?.to_array().to_vec())
    });
    visitor.visit("momentum about a point", kernel, &[&s.q, &s.v, &s.points], &|i| {
        Ok(fast::momentum(layout, q(i), v(i), About::Point(s.point(i)))?.to_array().to_vec())
    });
    let kernel = kernels::CentroidalMomentumMatrix { layout };
    visitor.visit("centroidal momentum matrix", kernel, &[&s.q], &|i| {
        Ok(fast::centroidal_momentum_matrix(layout, q(i))?.concat())
    });
}

fn levels() -> impl Iterator<Item = Level> {
    Level::ALL.into_iter().filter(|level| level.is_available())
}

fn bits(x: &[f64]) -> Vec<u64> {
    x.iter().map(|x| x.to_bits()).collect()
}

/// Batches against single states.
struct SameBits {
    seed: u64,
    kernels: usize,
}

impl Visit for SameBits {
    fn visit<K: StateKernel>(
        &mut self,
        name: &str,
        kernel: K,
        inputs: &[&[f64]],
        one: &dyn Fn(usize) -> Result<Vec<f64>, DynamicsError>,
    ) {
        self.kernels += 1;
        let at = format!("{name}, PHIPSI_SEED={}", self.seed);
        let single: Vec<Vec<f64>> =
            (0..STATES).map(|i| one(i).unwrap_or_else(|e| panic!("{at}: {e}"))).collect();
        let size = single[0].len();
        let each: Vec<Input<'_>> = inputs.iter().map(|x| Input::each(x, x.len() / STATES)).collect();
        // Another order, some states twice.
        let map: Vec<usize> = (0..STATES).map(|i| (7 * i + 3) % (STATES - 1)).collect();
        let mapped: Vec<Input<'_>> =
            inputs.iter().map(|x| Input::mapped(x, x.len() / STATES, &map)).collect();
        for level in levels() {
            for count in [1 + self.seed as usize % STATES, STATES] {
                let mut out = vec![f64::NAN; count * size];
                run_batch(&kernel, level, &each, count, &mut out).unwrap_or_else(|e| panic!("{at}: {e:?}"));
                for (i, row) in out.chunks_exact(size).enumerate() {
                    assert_eq!(bits(row), bits(&single[i]), "{at}, {level:?}, state {i} of {count}");
                }
            }
            let mut out = vec![f64::NAN; STATES * size];
            run_batch(&kernel, level, &mapped, STATES, &mut out).unwrap_or_else(|e| panic!("{at}: {e:?}"));
            for (row, &i) in out.chunks_exact(size).zip(&map) {
                assert_eq!(bits(row), bits(&single[i]), "{at}, {level:?}, state {i}, mapped");
            }
        }
    }
}

#[test]
fn lanes_places_and_tails_give_the_bits_of_one_state() {
    for seed in seeds(TREES) {
        let mut visitor = SameBits { seed, kernels: 0 };
        every_kernel(&States::new(seed), &mut visitor);
        assert_eq!(visitor.kernels, 23);
    }
}

/// The kernel that has no function of one state.
#[test]
fn accelerations() {
    agree_on(
        TREES,
        common::SAMPLES,
        "acceleration in lanes",
        |layout, case| {
            let inputs = [Input::same(&case.q), Input::same(&case.v), Input::same(&case.a)];
            let mut all = Vec::new();
            for body in 0..case.model.len() {
                let kernel = kernels::BodyAcceleration { layout, body: Some(body) };
                let mut one = [0.0; 6];
                let failed = |e: (usize, DynamicsError)| e.1;
                run_batch(&kernel, Level::Scalar, &inputs, 1, &mut one).map_err(failed)?;
                for level in levels() {
                    let mut out = [0.0; 6 * 11];
                    run_batch(&kernel, level, &inputs, 11, &mut out).map_err(failed)?;
                    assert!(out.chunks_exact(6).all(|row| bits(row) == bits(&one)), "{level:?}");
                }
                all.extend(one);
            }
            Ok(all)
        },
        |case| {
            let motions =
                slow::kinematics(&case.model, &widened(&case.q), &widened(&case.v), &widened(&case.a));
            motions.iter().flat_map(|m| m.acceleration.to_array()).collect()
        },
        |case, _, size| {
            // The reference's ω̇ is a difference of terms of size ω².
            let speed: f64 = case.v.iter().map(|v| v.abs()).sum();
            size.iter_mut().for_each(|x| *x += 16.0 * f64::EPSILON * speed * speed);
        },
    );
}

/// On plain f64 forward dynamics may take other steps: both against the reference.
#[test]
fn forward_dynamics() {
    agree_on(
        TREES,
        common::SAMPLES,
        "forward dynamics in lanes",
        |layout, case| {
            let inputs = [Input::same(&case.q), Input::same(&case.v), Input::same(&case.tau)];
            let mut out = vec![0.0; 9 * case.model.nv()];
            let kernel = kernels::ForwardDynamics { layout, loaded: &[] };
            run_batch(&kernel, Level::best(), &inputs, 9, &mut out).map_err(|e| e.1)?;
            Ok(out[..case.model.nv()].to_vec())
        },
        |case| {
            let (q, v, tau) = (widened(&case.q), widened(&case.v), widened(&case.tau));
            slow::forward_dynamics(&case.model, &q, &v, &tau, None).expect("generated trees are regular")
        },
        |case, _, size| {
            let growth = growth(case);
            size.iter_mut().for_each(|x| *x *= growth);
        },
    );
}

/// A number that is not finite in one lane.
struct FirstFailure {
    seed: u64,
}

impl Visit for FirstFailure {
    fn visit<K: StateKernel>(
        &mut self,
        name: &str,
        kernel: K,
        inputs: &[&[f64]],
        one: &dyn Fn(usize) -> Result<Vec<f64>, DynamicsError>,
    ) {
        let size = one(0).expect("generated trees are regular").len();
        // The earlier of two; both in one pack, or in two.
        let first = self.seed as usize % (STATES - 1);
        let second = STATES - 1;
        let spoiled: Vec<Vec<f64>> = inputs
            .iter()
            .map(|x| {
                let (mut x, n) = (x.to_vec(), x.len() / STATES);
                x[first * n..(first + 1) * n].fill(f64::NAN);
                x[second * n..].fill(f64::INFINITY);
                x
            })
            .collect();
        let each: Vec<Input<'_>> = spoiled.iter().map(|x| Input::each(x, x.len() / STATES)).collect();
        let map = [first];
        let alone: Vec<Input<'_>> =
            spoiled.iter().map(|x| Input::mapped(x, x.len() / STATES, &map)).collect();
        let mut out = vec![0.0; size];
        let wanted =
            run_batch(&kernel, Level::Scalar, &alone, 1, &mut out).map_err(|(_, e)| format!("{e:?}"));
        for level in levels() {
            let mut out = vec![0.0; STATES * size];
            let found = run_batch(&kernel, level, &each, STATES, &mut out);
            let at = format!("{name}, PHIPSI_SEED={}, {level:?}", self.seed);
            match found {
                Err((state, error)) => {
                    assert_eq!(Err::<(), _>(format!("{error:?}")), wanted, "{at}");
                    assert_eq!(state, first, "{at}");
                }
                // The result does not depend on the numbers: that of a body welded to the ground.
                Ok(()) => assert_eq!(wanted, Ok(()), "{at}"),
            }
        }
    }
}

#[test]
fn the_first_state_that_fails_is_reported() {
    for seed in seeds(TREES) {
        every_kernel(&States::new(seed), &mut FirstFailure { seed });
    }
}

#[test]
fn shapes_are_refused() {
    let s = States::new(3);
    let kernel = kernels::MassMatrix { layout: &s.layout };
    let (nq, nv) = (s.case.model.nq(), s.case.model.nv());
    let short = [Input::each(&s.q[..nq], nq)];
    let mut out = vec![0.0; 2 * nv * nv];
    let refused = |inputs: &[Input<'_>], out: &mut [f64]| {
        matches!(run_batch(&kernel, Level::best(), inputs, 2, out), Err((0, DynamicsError::Shape { .. })))
    };
    assert!(refused(&short, &mut out));
    assert!(refused(&[Input::mapped(&s.q, nq, &[0])], &mut out));
    assert!(refused(&[Input::mapped(&s.q, nq, &[0, STATES])], &mut out));
    assert!(refused(&[Input::same(&s.q[..nq - 1])], &mut out));
    assert!(refused(&[Input::each(&s.q, nq)], &mut out[1..]));
    assert!(run_batch(&kernel, Level::best(), &[Input::each(&s.q, nq)], 2, &mut out).is_ok());
}

/// Inputs that are to be checked are refused where they are not finite, also where no result depends on them; the first state is told.
#[test]
fn inputs_that_are_not_finite_are_found() {
    let s = States::new(3);
    let kernel = kernels::MassMatrix { layout: &s.layout };
    let (nv, size) = (s.case.model.nv(), s.case.model.nv() * s.case.model.nv());
    let mut extra = vec![1.0; 2 * STATES];
    (extra[2 * 11 + 1], extra[2 * 15]) = (f64::NAN, f64::INFINITY);
    assert!(nv > 0);
    let mut out = vec![0.0; STATES * size];
    for level in levels() {
        let q = Input::each(&s.q, s.case.model.nq()).checked();
        let other = Input::each(&extra, 2);
        run_batch(&kernel, level, &[q, other], STATES, &mut out).expect("nobody looks at the second input");
        let (state, error) = run_batch(&kernel, level, &[q, other.checked()], STATES, &mut out).unwrap_err();
        assert_eq!(state, 11);
        assert!(matches!(error, DynamicsError::InputNotFinite { input: 1, index: 1, .. }), "{error}");
    }
}

/// Matrices so large that states go one by one have the bits of single states, too.
#[test]
fn large_matrices_have_the_bits_of_one_state() {
    let limits = Limits { degrees_of_freedom: 130, decades: 0.0 };
    let case = case_within(5, limits);
    let (layout, nv) = (Layout::new(&case.model), case.model.nv());
    assert!(nv >= 128, "{nv}");
    let count = 3;
    let (mut q, mut v) = (Vec::new(), Vec::new());
    for seed in 0..count as u64 {
        let state = case.model.random_state(seed);
        q.extend(state.q);
        v.extend(state.v);
    }
    let inputs = [Input::each(&q, case.model.nq()), Input::each(&v, nv), Input::each(&v, nv)];
    let kernel = kernels::InverseDynamicsDerivatives { layout: &layout, loaded: &[] };
    let size = 3 * nv * nv;
    let mut one_by_one = vec![0.0; count * size];
    for i in 0..count {
        let own = [
            Input::same(&q[i * case.model.nq()..][..case.model.nq()]),
            Input::same(&v[i * nv..][..nv]),
            Input::same(&v[i * nv..][..nv]),
        ];
        run_batch(&kernel, Level::Scalar, &own, 1, &mut one_by_one[i * size..][..size]).unwrap();
    }
    for level in levels() {
        let mut out = vec![0.0; count * size];
        run_batch(&kernel, level, &inputs, count, &mut out).unwrap();
        assert_eq!(bits(&out), bits(&one_by_one), "{}", level.name());
    }
}
