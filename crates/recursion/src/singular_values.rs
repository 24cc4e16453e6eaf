//! Singular values of a few long vectors, by one-sided Jacobi rotations.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | A | the vectors, one after the other | `length` × `count` | |
//! | V | product of the rotations: A V has orthogonal columns, of lengths σ | `count` × `count` | Hestenes 1958 |
//!
//! Nothing is squared: small singular values keep their digits relative to the lengths of the vectors (Demmel and Veselić
//! 1992), where those of A* A would be lost below the root of the rounding.

use phipsi_spatial::Real;

/// Sweeps after which pairs are left as they are; eight are enough for any matrix seen.
const SWEEPS: usize = 60;

/// A V and V, in place of A and whatever `v` holds; columns by falling lengths, which are `sigma`. `vectors` holds `count`
/// columns of `length` numbers, `v` `count` columns of `count`. Numbers that are not finite stay so.
pub(crate) fn orthogonalize<T: Real>(vectors: &mut [T], length: usize, v: &mut [T], sigma: &mut [T]) {
    let count = sigma.len();
    v.fill(T::zero());
    for j in 0..count {
        v[j * count + j] = T::one();
    }
    let tolerance = T::splat(T::EPSILON);
    let negligible = tolerance * tolerance * (tolerance * tolerance);
    for _ in 0..SWEEPS {
        let mut rotated = false;
        for i in 0..count {
            for j in i + 1..count {
                let (a, b) = pair(vectors, length, i, j);
                let (aa, bb, ab) = (dot(a, a), dot(b, b), dot(a, b));
                // False where a number is not finite.
                let coupled = ab.abs() > tolerance * (aa.sqrt() * bb.sqrt());
                // One is rounding of rounding: squares of what comes next would underflow.
                let vanishing = aa.larger(bb) * negligible > -(-aa).larger(-bb);
                if !coupled || vanishing {
                    continue;
                }
                rotated = true;
                let zeta = (bb - aa) / (ab + ab);
                let sign = if zeta < T::zero() { -T::one() } else { T::one() };
                let t = sign / (zeta.abs() + (T::one() + zeta * zeta).sqrt());
                let c = (T::one() + t * t).sqrt().recip();
                let s = c * t;
                rotate(a, b, c, s);
                let (a, b) = pair(v, count, i, j);
                rotate(a, b, c, s);
            }
        }
        if !rotated {
            break;
        }
    }
    for (j, sigma) in sigma.iter_mut().enumerate() {
        let column = &vectors[j * length..(j + 1) * length];
        *sigma = dot(column, column).sqrt();
    }
    for i in 0..count {
        let largest = (i..count).fold(i, |best, j| if sigma[j] > sigma[best] { j } else { best });
        if largest != i {
            sigma.swap(i, largest);
            let (a, b) = pair(vectors, length, i, largest);
            a.swap_with_slice(b);
            let (a, b) = pair(v, count, i, largest);
            a.swap_with_slice(b);
        }
    }
}

/// Columns i < j.
fn pair<T>(columns: &mut [T], length: usize, i: usize, j: usize) -> (&mut [T], &mut [T]) {
    let (head, tail) = columns.split_at_mut(j * length);
    (&mut head[i * length..(i + 1) * length], &mut tail[..length])
}

pub(crate) fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::zero(), |sum, (a, b)| a.fma(*b, sum))
}

fn rotate<T: Real>(a: &mut [T], b: &mut [T], c: T, s: T) {
    for (a, b) in a.iter_mut().zip(b) {
        (*a, *b) = (c * *a - s * *b, s * *a + c * *b);
    }
}

/// Number of singular values above `tolerance` times the largest, which must be positive.
pub(crate) fn rank<T: Real>(sigma: &[T], tolerance: f64) -> usize {
    let cut = sigma.first().map_or(T::zero(), |largest| *largest * T::splat(tolerance));
    sigma.iter().filter(|s| **s > cut && s.is_positive()).count()
}

/// Rounding of a matrix of `steps` steps of a recursion: the part of its largest singular value below which one is zero.
pub(crate) fn rounding<T: Real>(steps: usize) -> f64 {
    64.0 * (steps + 6) as f64 * T::EPSILON
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::Random;
    use phipsi_spatial::Dd;

    fn check<T: Real>(length: usize, count: usize, seed: u64) {
        let mut random = Random::new(seed);
        // Columns of very different sizes.
        let a: Vec<T> = (0..length * count)
            .map(|i| T::splat(random.signed() * 10f64.powi(-3 * (i / length) as i32)))
            .collect();
        let (mut u, mut v, mut sigma) = (a.clone(), vec![T::zero(); count * count], vec![T::zero(); count]);
        orthogonalize(&mut u, length, &mut v, &mut sigma);
        assert!(sigma.windows(2).all(|s| s[0] >= s[1]));
        for i in 0..count {
            for j in 0..count {
                let vv = dot(&v[i * count..(i + 1) * count], &v[j * count..(j + 1) * count]);
                let one = if i == j { 1.0 } else { 0.0 };
                assert!((vv.to_f64() - one).abs() < 100.0 * T::EPSILON.max(f64::EPSILON));
                let uu = dot(&u[i * length..(i + 1) * length], &u[j * length..(j + 1) * length]);
                if i != j {
                    assert!(uu.abs().to_f64() <= 100.0 * T::EPSILON * (sigma[i] * sigma[j]).to_f64());
                }
                // A = (A V) V*.
                let back =
                    (0..count).fold(T::zero(), |sum, k| sum + u[k * length + i % length] * v[k * count + j]);
                let error = (back - a[j * length + i % length]).abs().to_f64();
                assert!(error < 100.0 * T::EPSILON * sigma[0].to_f64(), "{error:e}");
            }
        }
    }

    #[test]
    fn columns_become_orthogonal_and_are_rotated_back() {
        for seed in 0..20 {
            check::<f64>(6 + seed as usize, 6, seed);
            check::<f64>(3, 2, seed);
            check::<Dd>(9, 6, seed);
        }
    }

    #[test]
    fn ranks_of_zeros_and_of_what_is_no_number() {
        let (mut u, mut v, mut sigma) = ([0.0; 4], [0.0; 4], [0.0; 2]);
        orthogonalize(&mut u, 2, &mut v, &mut sigma);
        assert_eq!(rank(&sigma, 1e-12), 0);
        let mut u = [f64::NAN, 1.0, 2.0, 3.0];
        orthogonalize(&mut u, 2, &mut v, &mut sigma);
        assert!(rank(&sigma, 1e-12) <= 1);
    }
}
