//! The gradient of ln det 𝓜 from the operators: the trace of paper 2, section 4.5, for all coordinates at once.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | P⁺, Y⁺ | τ̄ P, and E_φ* Υ E_φ between a body and its parent | paper 1 (9.7), soa.md 3.2 |
//! | ∂ ln det 𝓜 | 2 tr(Υ Ė_φ P⁺ E_φ*) = 2 tr(S~ P⁺ Y⁺), and 2 tr(Ḣ (I − P⁺ Y⁺) G) of a universal joint, from S H* 𝓜⁻¹ = (φ P + P ψ~*) H* D⁻¹ L | soa.md 3.9 |

use super::{Operators, cross_wrench};
use nalgebra::DMatrix;
use phipsi_spatial::Real;

impl<T: Real> Operators<T> {
    /// All ∂ ln det 𝓜/∂q, along the increments of `Model::integrate`: [`crate::log_determinant_gradient()`] gives the same
    /// without forming the operators. Length nv, 1/rad or 1/m. Cost O(n).
    pub fn log_determinant_gradient(&self) -> Vec<T> {
        let own = Self::own_blocks;
        let (upsilon, G) = (own(&self.upsilon), own(&self.G));
        let outboard = own(&(&self.tau_bar * &self.P));
        let two = T::splat(2.0);
        let mut gradient = vec![T::zero(); self.joint_space().dimension()];
        for (k, axes) in self.axes.iter().enumerate() {
            let at = self.joint_space().range(k).start;
            let inboard = match self.tree.parent(k) {
                Some(p) => {
                    let E = super::shift(&self.poses[k]);
                    E.transpose() * &upsilon[p] * E
                }
                None => DMatrix::from_element(6, 6, T::zero()),
            };
            let product = &outboard[k] * &inboard;
            for (gradient, &S) in gradient[at..].iter_mut().zip(axes) {
                *gradient = (cross_wrench(S) * &product).trace() * two;
            }
            if let Some(turned) = self.turned_axis(k) {
                // Of Ḣ by the second angle only the first row is not zero.
                let forces = &G[k] - &product * &G[k];
                let along = turned.to_array().into_iter().enumerate();
                gradient[at + 1] += along.fold(T::zero(), |sum, (i, x)| sum + x * forces[(i, 0)]) * two;
            }
        }
        gradient
    }
}
