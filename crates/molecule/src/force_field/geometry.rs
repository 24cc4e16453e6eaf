//! Distances, angles and torsions with their gradients.
//!
//! | symbol | meaning |
//! |---|---|
//! | u, w | from the vertex of an angle to its ends |
//! | c, s | u × w, \|c\|; θ = atan2(s, u·w), exact to rounding at every angle |
//! | b₁, b₂, b₃ | from each atom of a torsion to the next |
//! | m, n | b₁ × b₂, b₂ × b₃; φ = atan2(\|b₂\| b₁·n, m·n), ±π for trans |

use phipsi_spatial::Vec3;

type V = Vec3<f64>;

/// A distance and its gradient with respect to the second atom; that of the first is its negative.
#[inline]
pub(super) fn distance(x: &[V], [i, j]: [usize; 2]) -> (f64, V) {
    let d = x[j] - x[i];
    // Summed in OpenMM's order: one unit in the last place of a stiff bond's length is 1e-11 kJ/mol/nm, a good part of what
    // is left of the forces in a minimum.
    let r = (d.0[0] * d.0[0] + d.0[1] * d.0[1] + d.0[2] * d.0[2]).sqrt();
    (r, d.scale(1.0 / r))
}

/// An angle in [0, π] and its gradients with respect to the first and the last atom.
///
/// Both gradients are zero where the atoms lie on a line: the angle has a kink there, and no direction is better.
#[inline]
pub(super) fn angle(x: &[V], [i, j, k]: [usize; 3]) -> (f64, [V; 2]) {
    let (u, w) = (x[i] - x[j], x[k] - x[j]);
    let c = u.cross(w);
    let s = c.norm();
    let theta = s.atan2(u.dot(w));
    if s == 0.0 {
        return (theta, [V::zero(); 2]);
    }
    (theta, [u.cross(c).scale(1.0 / (u.dot(u) * s)), c.cross(w).scale(1.0 / (w.dot(w) * s))])
}

/// A torsion in [−π, π] and its gradients with respect to the four atoms; not finite where three lie on a line.
#[inline]
pub(super) fn torsion(x: &[V], atoms: [usize; 4]) -> (f64, [V; 4]) {
    let ([cos, sin], gradients) = torsion_sides(x, atoms);
    (sin.atan2(cos), gradients)
}

/// Cosine and sine of a torsion and its gradients; not finite where three atoms lie on a line.
#[inline]
pub(super) fn torsion_cos_sin(x: &[V], atoms: [usize; 4]) -> ([f64; 2], [V; 4]) {
    let ([cos, sin], gradients) = torsion_sides(x, atoms);
    let inverse = 1.0 / (cos * cos + sin * sin).sqrt();
    ([cos * inverse, sin * inverse], gradients)
}

/// m·n and |b₂| b₁·n, proportional to cosine and sine, and the gradients of the angle.
#[inline]
fn torsion_sides(x: &[V], [i, j, k, l]: [usize; 4]) -> ([f64; 2], [V; 4]) {
    let (b1, b2, b3) = (x[j] - x[i], x[k] - x[j], x[l] - x[k]);
    let (m, n) = (b1.cross(b2), b2.cross(b3));
    let b2_square = b2.dot(b2);
    let b2_norm = b2_square.sqrt();
    let sides = [m.dot(n), b2_norm * b1.dot(n)];
    let (first, last) = (m.scale(-b2_norm / m.dot(m)), n.scale(b2_norm / n.dot(n)));
    let (s, t) = (b1.dot(b2) / b2_square, b3.dot(b2) / b2_square);
    let second = last.scale(t) - first.scale(1.0 + s);
    let third = first.scale(s) - last.scale(1.0 + t);
    (sides, [first, second, third, last])
}

/// Adds −slope ∂θ to the forces of an angle.
#[inline]
pub(super) fn push_angle(forces: &mut [V], [i, j, k]: [usize; 3], slope: f64, gradients: [V; 2]) {
    let [first, last] = gradients.map(|g| g.scale(-slope));
    forces[i] += first;
    forces[j] -= first + last;
    forces[k] += last;
}

/// Adds −slope ∂φ to the forces of a torsion.
#[inline]
pub(super) fn push_torsion(forces: &mut [V], atoms: [usize; 4], slope: f64, gradients: [V; 4]) {
    for (atom, gradient) in atoms.into_iter().zip(gradients) {
        forces[atom] += gradient.scale(-slope);
    }
}
