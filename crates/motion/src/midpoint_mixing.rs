//! Anderson mixing of depth two for the drift's iteration v ← v − M⁻¹ r, in the metric M.
//!
//! | symbol | meaning |
//! |---|---|
//! | f | −M⁻¹ r = −d, the plain correction |
//! | δf_a, δr_a, δv_a | differences of the last iterates |
//! | γ | minimises \|f − Σ γ_a δf_a\| in M; its Gram matrix needs no product with M: ⟨δf_a, δf_c⟩ = −δr_a·δf_c |

/// Below this part of its diagonal a Gram determinant is rounding, and the older difference is left out.
const DEPENDENT: f64 = 1e-8;

/// The last three iterates.
#[derive(Clone, Debug)]
pub(crate) struct Mixing {
    /// v, r, f before the present ones.
    last: [Vec<f64>; 3],
    /// δv, δr, δf, the newest first.
    differences: [[Vec<f64>; 3]; 2],
    /// Iterates seen since the restart.
    seen: usize,
}

impl Mixing {
    pub(crate) fn new(nv: usize) -> Self {
        let three = || [vec![0.0; nv], vec![0.0; nv], vec![0.0; nv]];
        Mixing { last: three(), differences: [three(), three()], seen: 0 }
    }
    /// Forgets the iterates.
    pub(crate) fn restart(&mut self) {
        self.seen = 0;
    }
    /// v ← the next iterate, from the residual r at v and d = M⁻¹ r.
    pub(crate) fn advance(&mut self, v: &mut [f64], r: &[f64], d: &[f64]) {
        if self.seen > 0 {
            self.differences.swap(0, 1);
            let [dv, dr, df] = &mut self.differences[0];
            let [last_v, last_r, last_f] = &self.last;
            for i in 0..v.len() {
                dv[i] = v[i] - last_v[i];
                dr[i] = r[i] - last_r[i];
                df[i] = -d[i] - last_f[i];
            }
        }
        let [last_v, last_r, last_f] = &mut self.last;
        for i in 0..v.len() {
            (last_v[i], last_r[i], last_f[i]) = (v[i], r[i], -d[i]);
        }
        let gamma = self.weights(d);
        for i in 0..v.len() {
            let mut next = v[i] - d[i];
            for (gamma, [dv, _, df]) in gamma.iter().zip(&self.differences) {
                if *gamma != 0.0 {
                    next -= gamma * (dv[i] + df[i]);
                }
            }
            v[i] = next;
        }
        self.seen += 1;
    }

    fn weights(&self, d: &[f64]) -> [f64; 2] {
        let product = |a: usize, x: &[f64]| -> f64 {
            -self.differences[a][1].iter().zip(x).map(|(r, x)| r * x).sum::<f64>()
        };
        if self.seen < 1 {
            return [0.0; 2];
        }
        let newest = &self.differences[0][2];
        let (g00, b0) = (product(0, newest), -product(0, d));
        if !(g00 > 0.0 && g00.is_finite()) {
            return [0.0; 2];
        }
        if self.seen >= 2 {
            let (g01, g11, b1) =
                (product(0, &self.differences[1][2]), product(1, &self.differences[1][2]), -product(1, d));
            let determinant = g00 * g11 - g01 * g01;
            if determinant > DEPENDENT * g00 * g11 {
                return [(b0 * g11 - b1 * g01) / determinant, (b1 * g00 - b0 * g01) / determinant];
            }
        }
        [b0 / g00, 0.0]
    }
}
