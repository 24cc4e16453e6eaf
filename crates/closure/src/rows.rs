//! The rows of one closure: its residual, its row matrix S on the relative twist, and its velocity terms.
//!
//! | symbol | meaning | shape, axes | source |
//! |---|---|---|---|
//! | R, d | axes of frame B, and its origin from that of A | 3×3, 3; axes of A | notes of the crate |
//! | (ω, ḋ) | relative twist of B at its origin: ω_B − ω_A and the rate of d | 6, axes of A | |
//! | S | rows on the relative twist: S (ω, ḋ) = γ̇ | m×6, axes of A | paper 2 §4.6 (B* of one loop) |
//! | Φ | residual of the positions: Φ = γ | m | |
//! | g | what S gives on the accelerations α of the two bodies: S X_c (α_b − α_a) = g | m | |
//!
//! α are the papers' accelerations (inertial derivative of the velocity of a body's origin), so that only angular velocities
//! and the relative twist enter g; the common velocity of the two bodies costs no digits.

use phipsi_model::ClosureKind;
use phipsi_spatial::{Mat3, Motion, Quaternion, Real, Scalar, Vec3, Wrench};

/// Most rows of a closure.
pub(crate) const MOST_ROWS: usize = 6;

/// Where frame B is from frame A, and how the two move; axes of A.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Relative<T> {
    /// Axes of B.
    pub(crate) rotation: Mat3<T>,
    /// Origin of B from that of A.
    pub(crate) offset: Vec3<T>,
    /// ω_B − ω_A and the rate of the offset.
    pub(crate) twist: Motion<T>,
}

/// In place of an axis: the row has a direction of its own.
pub(crate) const OWN: usize = 6;

/// What the rows of a kind of closure are along: components of the twist, or [`OWN`]; unused ones beyond its number of rows.
pub(crate) fn axes(kind: ClosureKind) -> [usize; MOST_ROWS] {
    match kind {
        ClosureKind::Weld | ClosureKind::Prismatic => [0, 1, 2, 3, 4, 5],
        ClosureKind::Revolute | ClosureKind::Cylindrical => [0, 1, 3, 4, 5, OWN],
        ClosureKind::Planar => [0, 1, 5, OWN, OWN, OWN],
        ClosureKind::Universal => [OWN, 3, 4, 5, OWN, OWN],
        ClosureKind::Distance { .. } => [OWN; MOST_ROWS],
        ClosureKind::PointOnPlane => [5, OWN, OWN, OWN, OWN, OWN],
        _ => [3, 4, 5, OWN, OWN, OWN],
    }
}

impl<T: Real> Relative<T> {
    /// Φ of a kind; unused entries are zero.
    pub(crate) fn residual(&self, kind: ClosureKind) -> [T; MOST_ROWS] {
        let Relative { rotation, offset, .. } = self;
        let [x, y, z] = offset.0;
        let o = T::zero();
        match kind {
            ClosureKind::Weld => {
                let [a, b, c] = rotation_vector(rotation).0;
                [a, b, c, x, y, z]
            }
            ClosureKind::Prismatic => {
                let [a, b, c] = rotation_vector(rotation).0;
                [a, b, c, x, y, o]
            }
            ClosureKind::Revolute => {
                let [a, b] = tilt(rotation);
                [a, b, x, y, z, o]
            }
            ClosureKind::Cylindrical => {
                let [a, b] = tilt(rotation);
                [a, b, x, y, o, o]
            }
            ClosureKind::Planar => {
                let [a, b] = tilt(rotation);
                [a, b, z, o, o, o]
            }
            ClosureKind::Universal => [rotation.0[0][1], x, y, z, o, o],
            ClosureKind::Distance { length } => [offset.norm() - T::splat(length), o, o, o, o, o],
            ClosureKind::PointOnPlane => [z, o, o, o, o, o],
            _ => [x, y, z, o, o, o],
        }
    }
}

impl<T: Scalar> Relative<T> {
    /// Both frames at rest in the same place.
    pub(crate) fn at_rest() -> Self {
        Relative { rotation: Mat3::identity(), offset: Vec3::zero(), twist: Motion::zero() }
    }
    /// The row of S that is along no axis; zero where there is none.
    #[inline(always)]
    pub(crate) fn own_row(&self, kind: ClosureKind) -> Wrench<T> {
        match kind {
            ClosureKind::Universal => Wrench::new(self.rotation.column(1).cross(Vec3::unit(0)), Vec3::zero()),
            ClosureKind::Distance { .. } => Wrench::new(Vec3::zero(), self.line()),
            _ => Wrench::zero(),
        }
    }
    /// The direction from A to B; x where they coincide.
    #[inline(always)]
    fn line(&self) -> Vec3<T> {
        let length = self.offset.norm();
        if length == T::zero() { Vec3::unit(0) } else { self.offset.scale(length.recip()) }
    }
    /// Ṡ (ω, ḋ) of the first angular and of the only row that turn with the frames.
    #[inline(always)]
    pub(crate) fn turning(&self, kind: ClosureKind) -> T {
        match kind {
            ClosureKind::Universal => {
                let rate = self.twist.angular.cross(self.rotation.column(1));
                rate.cross(Vec3::unit(0)).dot(self.twist.angular)
            }
            ClosureKind::Distance { .. } => {
                let length = self.offset.norm();
                if length == T::zero() {
                    return T::zero();
                }
                let speed = self.twist.linear;
                let along = self.line().dot(speed);
                (speed.dot(speed) - along * along) / length
            }
            _ => T::zero(),
        }
    }
    /// What the velocities add to g before S: (ω_A × ω, ω_A × (ω_A × c_a) − ω_b × (ω_b × c_b) + 2 ω_A × ḋ), where `inboard`
    /// is ω_A and c_a, c_b lead to the origin of B from the origins of the two bodies.
    #[inline(always)]
    pub(crate) fn velocity_terms(&self, inboard: Vec3<T>, c_a: Vec3<T>, c_b: Vec3<T>) -> Motion<T> {
        let outboard = inboard + self.twist.angular;
        let coriolis = inboard.cross(self.twist.linear);
        let linear =
            inboard.cross(inboard.cross(c_a)) - outboard.cross(outboard.cross(c_b)) + coriolis + coriolis;
        Motion::new(inboard.cross(self.twist.angular), linear)
    }
}

/// The rotation vector of a rotation matrix.
fn rotation_vector<T: Real>(rotation: &Mat3<T>) -> Vec3<T> {
    Quaternion::from_rotation(rotation).log()
}

/// Rotation about x and y, in that order, of the shortest turn that takes the z axis to the third column.
fn tilt<T: Real>(rotation: &Mat3<T>) -> [T; 2] {
    let [x, y, z] = rotation.column(2).0;
    // z × (x, y, z) = (−y, x, 0), of length sin; the factor is angle/sin.
    let sine = (x * x + y * y).sqrt();
    if sine == T::zero() {
        // Straight, or turned over: then about x.
        return if z < T::zero() { [T::zero().atan2(-T::one()), T::zero()] } else { [T::zero(); 2] };
    }
    let factor = sine.atan2(z) / sine;
    [-y * factor, x * factor]
}

#[cfg(test)]
mod tests {
    use super::*;
    use phipsi_model::Random;
    use phipsi_spatial::Dd;
    use phipsi_spatial::quaternion::{exp_motion, pose};

    /// B moves against a resting A with a constant twist of its own: Φ̇ = S (ω, ḋ) where the closure holds, by differences.
    #[test]
    fn rows_are_derivatives_of_residuals() {
        let mut random = Random::new(3);
        let kinds = ClosureKind::WORDS.map(|word| ClosureKind::from_word(word, 0.7).expect("a word"));
        for kind in kinds {
            for _ in 0..20 {
                let q = Quaternion(random.quaternion().map(Dd::from_f64));
                let axis = |i: usize, angle: f64| Quaternion::exp(Vec3::unit(i).scale(Dd::from_f64(angle)));
                let (angle, other) = (random.signed(), random.signed());
                let rotation = match kind {
                    ClosureKind::Weld | ClosureKind::Prismatic => Quaternion::identity(),
                    ClosureKind::Universal => axis(0, angle).compose(axis(1, other)),
                    ClosureKind::Revolute | ClosureKind::Cylindrical | ClosureKind::Planar => axis(2, angle),
                    _ => q,
                };
                let offset = Vec3::splat(random.vector());
                let [x, y, z] = offset.0;
                let o = Dd::from_f64(0.0);
                let offset = match kind {
                    ClosureKind::Cylindrical | ClosureKind::Prismatic => Vec3([o, o, z]),
                    ClosureKind::Planar | ClosureKind::PointOnPlane => Vec3([x, y, o]),
                    ClosureKind::Distance { .. } => offset.scale(Dd::from_f64(0.7) / offset.norm()),
                    _ => Vec3::zero(),
                };
                let start = pose(rotation, offset);
                // Twist in the axes of B, of its origin.
                let body = [0; 6].map(|_| Dd::from_f64(random.signed()));
                let moved = |step: f64| {
                    let twist = Motion::from_array(body).scale(Dd::from_f64(step));
                    let (r, t) = exp_motion(twist);
                    let there = start.compose(&pose(r, t));
                    Relative { rotation: there.rotation, offset: there.translation, twist: Motion::zero() }
                };
                let here = moved(0.0);
                let turned = Motion::new(
                    start.rotation * Motion::from_array(body).angular,
                    start.rotation * Motion::from_array(body).linear,
                );
                let step = 1e-8;
                let (after, before) = (moved(step).residual(kind), moved(-step).residual(kind));
                let residual = here.residual(kind);
                let row_of = |relative: &Relative<Dd>, i: usize| match axes(kind)[i] {
                    OWN => relative.own_row(kind),
                    axis => Wrench::unit(axis),
                };
                for i in 0..kind.rows() {
                    assert!(residual[i].hi.abs() < 1e-25, "{kind:?} {i}: {:?}", residual[i]);
                    let rate = (after[i] - before[i]) / Dd::from_f64(2.0 * step);
                    let error = (rate - turned.dot(row_of(&here, i))).hi.abs();
                    assert!(error < 1e-13, "{kind:?} row {i}: {error:e}");
                }
                // Ṡ (ω, ḋ) by differences of S along the motion.
                let there = Relative { twist: turned, ..here };
                let (after, before) = (row_of(&moved(step), 0), row_of(&moved(-step), 0));
                let rate = (turned.dot(after) - turned.dot(before)) / Dd::from_f64(2.0 * step);
                let error = (rate - there.turning(kind)).hi.abs();
                assert!(error < 1e-12, "{kind:?}: {error:e}");
            }
        }
    }
}
