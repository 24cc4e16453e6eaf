//! 𝓜⁻¹ element by element: the vertical sweeps of Lemma 13, corrected, on trees.
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | Υ(p) | compliance seen at the parent of i | 6 × 6 | paper 1 (10.2) |
//! | 𝓜⁻¹(i,i) | D⁻¹(i) + K*(p,i) Υ(p) K(p,i) | r × r | Lemma 13; D⁻¹ for every joint |
//! | λ | row that descends: K*(p,i) Υ(p) ψ(p,i) − D⁻¹(i) H(i) below i | r × 6 | Lemma 13: 𝓜⁻¹(i,i) H(i), not H(i) 𝓜⁻¹(i,i) |
//! | 𝓜⁻¹(i,c) | λ K(node,c), then λ ← λ ψ(node,c) | r × r_c | Lemma 13 has its transpose |
//! | μ(a) | K*(p,i) ψ*(a,p) on the path to the root | r × 6 | |
//! | side branches | λ = μ(a) Υ(a) into the children of a that are not on the path | r × 6 | not in the paper: chains have none |

use super::Operators;
use nalgebra::DMatrix;
use phipsi_spatial::Real;

/// Blocks of the operators, by child.
struct Parts<T> {
    H: Vec<DMatrix<T>>,
    D_inverse: Vec<DMatrix<T>>,
    K: Vec<DMatrix<T>>,
    psi: Vec<DMatrix<T>>,
    upsilon: Vec<DMatrix<T>>,
}

impl<T: Real> Operators<T> {
    /// 𝓜⁻¹ by vertical sweeps, nv × nv; no mass matrix is formed and none is factored.
    ///
    /// # Method
    /// Paper 1 Lemma 13, corrected and with the branches beside the path to the root, on which joint i acts through the bodies
    /// that both hang on.
    ///
    /// # Cost
    /// O(n²): a constant number of 6 × 6 products an element.
    pub fn mass_matrix_inverse_by_sweeps(&self) -> DMatrix<T> {
        let parts = self.parts();
        let joint = self.joint_space();
        let children = self.tree.children();
        let mut inverse = DMatrix::from_element(joint.dimension(), joint.dimension(), T::zero());
        for i in 0..self.bodies.len() {
            let mut diagonal = parts.D_inverse[i].clone();
            let mut lambda = -(&parts.D_inverse[i] * &parts.H[i]);
            let mut starts = Vec::new();
            if let Some(p) = self.tree.parent(i) {
                let mut mu = parts.K[i].transpose();
                let seen = &mu * &parts.upsilon[p];
                diagonal += &seen * &parts.K[i];
                lambda += &seen * &parts.psi[i];
                let mut below = i;
                for a in self.tree.path_to_root(p) {
                    if a != p {
                        mu *= parts.psi[below].transpose();
                    }
                    let side = &mu * &parts.upsilon[a];
                    starts.extend(children[a].iter().filter(|&&c| c != below).map(|&c| (c, side.clone())));
                    below = a;
                }
            }
            inverse
                .view_mut((joint.range(i).start, joint.range(i).start), diagonal.shape())
                .copy_from(&diagonal);
            // Only bodies that come later in storage: the rest is the transpose.
            starts.extend(children[i].iter().map(|&c| (c, lambda.clone())));
            while let Some((c, lambda)) = starts.pop() {
                let element = &lambda * &parts.K[c];
                let (row, column) = (joint.range(i).start, joint.range(c).start);
                if c > i {
                    inverse.view_mut((row, column), element.shape()).copy_from(&element);
                    inverse
                        .view_mut((column, row), (element.ncols(), element.nrows()))
                        .copy_from(&element.transpose());
                }
                let down = &lambda * &parts.psi[c];
                starts.extend(children[c].iter().map(|&d| (d, down.clone())));
            }
        }
        inverse
    }

    fn parts(&self) -> Parts<T> {
        let shift = |k: usize| super::shift(&self.poses[k]);
        let own = |a| Self::own_blocks(a);
        let each = |blocks: Vec<DMatrix<T>>| -> Vec<DMatrix<T>> {
            blocks.iter().enumerate().map(|(k, block)| shift(k) * block).collect()
        };
        Parts {
            H: own(&self.H),
            D_inverse: own(&self.D_inverse),
            K: each(own(&self.G)),
            psi: each(own(&self.tau_bar)),
            upsilon: own(&self.upsilon),
        }
    }
}
