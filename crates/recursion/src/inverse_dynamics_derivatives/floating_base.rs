//! What a floating base ([`crate::floating_base`]) takes part in: its own 6×6 blocks, in its own axes, and what rows of joints outboard
//! see of it. The ground does not turn, so that ω_λ and ψ are zero and Ψ is g seen from an axis that turns. Symbols: those of
//! [`crate::inverse_dynamics_derivatives`].

use super::{CARRIED_ALPHA, MOMENT, MOMENTUM, OMEGA, ROWS, SPEED};
use crate::floating_base::{along_axes, along_three, seen, seen_matrix, seen_rigid};
use crate::ground_axes::{AXES, COMPOSITE, Directions};
use crate::places::{Group, Lane, vector};
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{RigidInertia, Scalar, Vec3, Wrench};

/// What joints outboard see of a base that turns and, with `SLIDING`, slides, by a column's weights: rows of ∂T/∂v. While v̇ + c stays, a
/// base that slides changes nothing.
#[inline(always)]
pub(crate) fn weigh_velocity<T: Scalar, W: Wide<T>, const SLIDING: bool>(
    here: &Lane<'_, T, ROWS>,
    inertia: Wrench<W>,
    gyroscopic: Vec3<W>,
) -> [W; 6] {
    let axes: Directions<T> = here.vectors(AXES);
    let (m, f, omega) = (inertia.moment, inertia.force, vector::<T, W>(here.vector(OMEGA)));
    // Γ* R S + s* g of all axes.
    let turns = m.cross_add(omega, gyroscopic);
    if SLIDING {
        let turns = vector::<T, W>(here.vector(SPEED)).cross_add(f, turns);
        return along_axes(&axes, &Wrench::new(turns, f.cross(omega)));
    }
    let ([a, b, c], zero) = (along_three(&axes, turns), W::zero());
    [a, b, c, zero, zero, zero]
}

/// The same by the place of a base, where only turning changes anything: rows of ∂T/∂q.
#[inline(always)]
pub(crate) fn weigh_position<T: Scalar, W: Wide<T>>(here: &Lane<'_, T, ROWS>, inertia: Wrench<W>) -> [W; 3] {
    // Ψ* R S of all axes.
    let a = vector::<T, W>(here.vector(CARRIED_ALPHA + 3));
    along_three(&here.vectors(AXES), inertia.force.cross(a))
}

/// Writes a column of a block.
#[inline(always)]
fn put<T: Scalar>(block: &mut [[T; 6]; 6], j: usize, f: Wrench<T>) {
    for i in 0..3 {
        block[i][j] = f.moment.0[i];
        block[i + 3][j] = f.force.0[i];
    }
}

/// ∂T/∂q of a base's own axes.
#[inline(always)]
pub(crate) fn own_position_block<T: Scalar>(here: &Group<'_, T, ROWS>) -> [[T; 6]; 6] {
    let axes = here.axes();
    let R: RigidInertia<T> = here.rigid(COMPOSITE);
    let (h, a) = (seen(&axes, R.first_moment), seen(&axes, here.vector(CARRIED_ALPHA + 3)));
    let mut position = [[T::zero(); 6]; 6];
    for j in 0..3 {
        // Ψ = (0, a × s), and its force.
        let falls = a.cross(Vec3::unit(j));
        put(&mut position, j, Wrench::new(h.cross(falls), falls.scale(R.mass)));
    }
    position
}

/// ∂T/∂v of a base's own axes, and M if `TURNING`.
#[inline(always)]
pub(crate) fn own_blocks<T: Scalar, const TURNING: bool>(here: &Group<'_, T, ROWS>) -> [[[T; 6]; 6]; 2] {
    let axes = here.axes();
    let R = seen_rigid(&axes, &here.rigid(COMPOSITE));
    let (J, h, m) = (R.inertia, R.first_moment, R.mass);
    let (omega, speed) = (seen(&axes, here.vector(OMEGA)), seen(&axes, here.vector(SPEED)));
    let (N, l) = (seen_matrix(&axes, &here.matrix(MOMENT)), seen(&axes, here.vector(MOMENTUM)));
    let mut velocity = [[T::zero(); 6]; 6];
    for j in 0..3 {
        let s = Vec3::unit(j);
        // Γ = (ω × s, s × δv), and what turns with s.
        let turns = omega.cross(s);
        let mut moment = J * turns + N.column(j);
        let mut force = l.cross(s) - h.cross(turns);
        if TURNING {
            let slides = s.cross(speed);
            moment += h.cross(slides);
            force = slides.scale_add(m, force);
            // Γ = (0, ω × s) of the axis that slides.
            put(&mut velocity, j + 3, Wrench::new(h.cross(turns), turns.scale(m)));
        }
        put(&mut velocity, j, Wrench::new(moment, force));
    }
    let M = if TURNING { R.to_articulated().to_rows() } else { [[T::zero(); 6]; 6] };
    [velocity, M]
}
