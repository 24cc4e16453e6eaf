//! Operators over random trees, blocks of any sizes, against dense matrices.

use nalgebra::DMatrix;
use phipsi_spatial::{Dd, Real};
use phipsi_topology::{Innovations, Operator, OperatorError, Space, Tree};
use std::sync::Arc;

/// A linear congruential generator: the trees and blocks of a seed.
struct Numbers(u64);

impl Numbers {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        self.0 >> 33
    }
    fn below(&mut self, n: usize) -> usize {
        self.bits() as usize % n
    }
    fn signed<T: Real>(&mut self) -> T {
        T::splat(self.bits() as f64 / (1u64 << 30) as f64 - 1.0)
    }
    fn matrix<T: Real>(&mut self, rows: usize, columns: usize) -> DMatrix<T> {
        DMatrix::from_fn(rows, columns, |_, _| self.signed())
    }
}

/// Operators of a random tree, and their dense twins.
struct Case<T> {
    state: Space,
    edges: Operator<T>,
    phi: Operator<T>,
    hinge: Operator<T>,
    inertia: Operator<T>,
    gain: Operator<T>,
}

fn case<T: Real>(seed: u64) -> Case<T> {
    let mut random = Numbers(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let n = 2 + random.below(9);
    let parents = (0..n).map(|k| (k > 0 && random.below(6) > 0).then(|| random.below(k))).collect();
    let tree = Arc::new(Tree::new(parents).unwrap());
    let state = Space::new((0..n).map(|_| 2 + random.below(4)));
    let joint = Space::new((0..n).map(|k| 1 + random.below(state.size(k))));
    let mut blocks = Vec::new();
    for k in 0..n {
        let p = tree.parent(k).unwrap_or(k);
        blocks.push(random.matrix(state.size(p), state.size(k)));
    }
    let edges = Operator::edges("E", &tree, &state, &state, blocks).unwrap();
    let phi = Operator::resolvent("φ", &edges).unwrap();
    let hinge = (0..n).map(|k| random.matrix(joint.size(k), state.size(k))).collect();
    let gain = (0..n).map(|k| random.matrix(state.size(k), joint.size(k))).collect();
    let inertia = (0..n)
        .map(|k| {
            let a: DMatrix<T> = random.matrix(state.size(k), state.size(k));
            &a * a.transpose() + DMatrix::identity(state.size(k), state.size(k))
        })
        .collect();
    Case {
        phi,
        hinge: Operator::diagonal("H", &joint, &state, hinge).unwrap(),
        gain: Operator::diagonal("G", &state, &joint, gain).unwrap(),
        inertia: Operator::diagonal("M", &state, &state, inertia).unwrap(),
        edges,
        state,
    }
}

fn size<T: Real>(a: &DMatrix<T>) -> f64 {
    a.iter().fold(0.0, |m, x| m.max(x.abs().to_f64()))
}

/// |a − b| over the sizes of all factors that made them: rounding of products of a few dozen terms.
fn assert_same<T: Real>(what: &str, seed: u64, a: &DMatrix<T>, b: &DMatrix<T>, scale: f64) {
    let error = size(&(a - b));
    assert!(error <= 1e3 * T::EPSILON * scale, "{what}, seed {seed}: error {error:e}, scale {scale:e}");
}

/// Sweeps are their matrices: φ (I − E) = I, adjoints are transposes, products and sums those of matrices.
fn evaluations<T: Real>() {
    for seed in 0..100 {
        let Case { state, edges, phi, hinge, inertia, gain, .. } = case::<T>(seed);
        let one = DMatrix::<T>::identity(state.dimension(), state.dimension());
        let (e, f) = (edges.dense().unwrap(), phi.dense().unwrap());
        assert_same("φ (I − E)", seed, &(&f * (&one - &e)), &one, size(&f) * (1.0 + size(&e)));
        for a in [&edges, &phi, &hinge, &gain, &(&hinge * &phi), &(&edges * &gain)] {
            let (dense, adjoint) = (a.dense().unwrap(), a.adjoint().dense().unwrap());
            assert_same("adjoint", seed, &dense.transpose(), &adjoint, 1.0 + size(&dense));
        }
        let product = &hinge * &phi * &inertia * phi.adjoint() * hinge.adjoint();
        let (h, m) = (hinge.dense().unwrap(), inertia.dense().unwrap());
        let dense = &h * &f * &m * f.transpose() * h.transpose();
        let scale = size(&h).powi(2) * size(&f).powi(2) * size(&m) * state.dimension() as f64;
        assert_same("product", seed, &product.dense().unwrap(), &dense, scale);
        let sum = &phi.scaled(T::splat(2.0)) - &(&edges + &inertia);
        let dense = &f * T::splat(2.0) - &e - &m;
        assert_same("sum", seed, &sum.dense().unwrap(), &dense, size(&f) + size(&e) + size(&m));
    }
}

#[test]
fn evaluations_are_those_of_matrices() {
    evaluations::<f64>();
    evaluations::<Dd>();
}

/// Every rule of inversion gives an inverse, in both numbers.
fn inverses<T: Real>() {
    for seed in 0..100 {
        let Case { edges, phi, hinge, inertia, gain, state, .. } = case::<T>(seed);
        let one = Operator::identity(&state);
        let joint_one = Operator::identity(hinge.rows());
        let k = &edges * &gain;
        let expressions = [
            inertia.clone(),
            phi.clone(),
            phi.adjoint(),
            &one - &edges,
            &inertia + &edges,
            (&inertia + &edges).adjoint(),
            &joint_one + &(&hinge * &phi) * &k,
            (&joint_one - &(&hinge * &phi) * &k).adjoint(),
            &one + &(&k * &hinge) * &phi,
            &phi.inverse().unwrap() + &(&k * &hinge),
            &(&phi * &inertia) * &phi.adjoint(),
            &(&phi * &inertia) + &inertia,
            &inertia + &(&edges * &inertia).scaled(T::splat(0.5)),
            &hinge * &phi * &inertia * phi.adjoint() * hinge.adjoint(),
        ];
        for a in expressions {
            let inverse = a.inverse().unwrap_or_else(|error| panic!("seed {seed}: {error}"));
            let product = (&a * &inverse).dense().unwrap();
            let (size_a, size_b) = (size(&a.dense().unwrap()), size(&inverse.dense().unwrap()));
            let one = DMatrix::identity(product.nrows(), product.nrows());
            let scale = size_a * size_b * product.nrows() as f64;
            assert_same(&a.to_string(), seed, &product, &one, scale);
        }
    }
}

#[test]
fn inverses_are_inverses() {
    inverses::<f64>();
    inverses::<Dd>();
}

/// The Riccati equation factors H φ M φ* H*, and its ψ is that of the inverse of I + H φ K.
#[test]
fn innovations_factor_the_expression() {
    for seed in 0..100 {
        let Case { edges, phi, hinge, inertia, .. } = case::<Dd>(seed);
        let factors = Innovations::new(&hinge, &edges, &inertia).unwrap();
        let mass = (&hinge * &phi * &inertia * phi.adjoint() * hinge.adjoint()).dense().unwrap();
        let factor = factors.factor();
        let product = (&factor * &factors.pivots * factor.adjoint()).dense().unwrap();
        assert_same("(I + HφK) D (I + HφK)*", seed, &product, &mass, 1e3 * size(&mass));
        let psi = factors.factor().inverse().unwrap().dense().unwrap();
        let l = factors.inverse_factor().dense().unwrap();
        assert_same("I − HψK", seed, &psi, &l, 1e3 * (1.0 + size(&l)).powi(2));
    }
}

/// R = E R E* + M everywhere; Υ is the diagonal of φ* N φ.
#[test]
fn composites_solve_their_equations() {
    for seed in 0..100 {
        let Case { edges, phi, inertia, state, .. } = case::<Dd>(seed);
        let r = Operator::inward_composite("R", &edges, &inertia).unwrap();
        let rest = (&r - &(&edges * &r * edges.adjoint())).dense().unwrap();
        let (whole, m) = (r.dense().unwrap(), inertia.dense().unwrap());
        assert_same("R − E R E*", seed, &rest, &m, 1e3 * size(&whole));
        let y = Operator::outward_composite("Υ", &edges, &inertia).unwrap().dense().unwrap();
        let whole = (phi.adjoint() * &inertia * &phi).dense().unwrap();
        for k in 0..state.blocks() {
            let at = |a: &DMatrix<Dd>| {
                let range = state.range(k);
                a.view((range.start, range.start), (range.len(), range.len())).into_owned()
            };
            assert_same("diagonal of φ* N φ", seed, &at(&y), &at(&whole), 1e3 * size(&whole));
        }
    }
}

#[test]
fn expressions_are_written_as_in_the_papers() {
    let Case { phi, hinge, inertia, edges, gain, .. } = case::<f64>(3);
    let mass = &hinge * &phi * &inertia * phi.adjoint() * hinge.adjoint();
    assert_eq!(mass.to_string(), "H φ M φ* H*");
    let factor = Operator::identity(hinge.rows()) + &(&hinge * &phi) * &(&edges * &gain);
    assert_eq!(factor.to_string(), "I + H φ E G");
    assert_eq!((&factor - &(&hinge * &gain)).to_string(), "I + H φ E G − H G");
    assert_eq!((&factor * &factor.adjoint()).to_string(), "(I + H φ E G) (I + G* E* φ* H*)");
    assert_eq!(mass.cost(), 2 * hinge.cost() + 2 * phi.cost() + inertia.cost());
}

/// Mistakes are told with names and sizes, by products also when they are evaluated.
#[test]
fn mistakes_are_named() {
    let Case { phi, hinge, inertia, edges, .. } = case::<f64>(5);
    let wrong = &phi * &hinge;
    assert!(matches!(wrong.apply(&[]), Err(OperatorError::Spaces { .. })));
    assert!(matches!((&wrong * &phi).adjoint().dense(), Err(OperatorError::Spaces { .. })));
    assert!(wrong.check().unwrap_err().to_string().contains("`φ`"));
    assert!(matches!(phi.apply(&[1.0]), Err(OperatorError::Length { found: 1, .. })));
    assert!(matches!((&phi + &phi.adjoint()).inverse(), Err(OperatorError::NoInverse { .. })));
    assert!(matches!((&hinge * &phi).inverse(), Err(OperatorError::NoInverse { .. })));
    assert!(matches!(Operator::resolvent("?", &inertia), Err(OperatorError::NotEdges { .. })));
    assert!(matches!(edges.inverse(), Err(OperatorError::NoInverse { .. })));
    let zero = inertia.scaled(0.0);
    assert!(matches!((&zero + &edges).inverse(), Err(OperatorError::Singular { .. })));
    assert!(matches!(phi.block(99, 0), Err(OperatorError::Node { node: 99, .. })));
}
