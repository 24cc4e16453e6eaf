//! Changes of forces at unit changes of each degree of freedom, moved inward side by side: the columns of
//! [`crate::inverse_dynamics_derivatives`], whose symbols are used here.
//!
//! | rows | meaning |
//! |---|---|
//! | `INERTIA` | R S, the force of an acceleration; also the weights with which rows of c see changes Ψ and Γ inboard |
//! | `POSITION` | force of a change of position |
//! | `VELOCITY` | force of a change of velocity |
//! | `GYROSCOPIC` | −2B* S, the weights with which rows of c see angular changes of velocity inboard: a moment only |

use crate::ground_axes::{AXIS, OFFSET, along, linear_axes};
use crate::inverse_dynamics_derivatives::{
    COLUMNS, DRIFT, FORCE, POSITION_RATE, PSI, ROWS as ALL, VELOCITY_RATE,
};
use crate::layout::{GROUND, Layout};
use crate::places::{Group, Places, View, vector};
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{Motion, Scalar, Vec3, Wrench};

const INERTIA: usize = COLUMNS;
const POSITION: usize = INERTIA + 6;
const VELOCITY: usize = POSITION + 6;
const GYROSCOPIC: usize = VELOCITY + 6;
/// Rows of a column.
pub(crate) const ROWS: usize = 21;

/// Columns of a group.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column<W> {
    pub(crate) inertia: Wrench<W>,
    pub(crate) position: Wrench<W>,
    pub(crate) velocity: Wrench<W>,
    pub(crate) gyroscopic: Vec3<W>,
}

impl<W: Scalar> Column<W> {
    #[inline(always)]
    fn get<T: Scalar>(group: &Group<'_, T, ALL>) -> Self
    where
        W: Wide<T>,
    {
        Column {
            inertia: group.wrench(INERTIA),
            position: group.wrench(POSITION),
            velocity: group.wrench(VELOCITY),
            gyroscopic: group.vector(GYROSCOPIC),
        }
    }
    #[inline(always)]
    pub(crate) fn put<T: Scalar>(&self, group: &mut Group<'_, T, ALL>)
    where
        W: Wide<T>,
    {
        group.set_wrench(INERTIA, self.inertia);
        group.set_wrench(POSITION, self.position);
        group.set_wrench(VELOCITY, self.velocity);
        group.set_vector(GYROSCOPIC, self.gyroscopic);
    }
    /// φ(p, k): by d, and by `drift` = −2u to the parent's frame of reference. Forces stay as they are.
    #[inline(always)]
    fn shift<T: Scalar>(&self, d: Vec3<W>, drift: Vec3<W>, group: &mut Group<'_, T, ALL>)
    where
        W: Wide<T>,
    {
        group.set_vector(INERTIA, d.cross_add(self.inertia.force, self.inertia.moment));
        group.set_vector(POSITION, d.cross_add(self.position.force, self.position.moment));
        group.set_vector(VELOCITY, d.cross_add(self.velocity.force, self.velocity.moment));
        group.set_vector(GYROSCOPIC, self.inertia.force.cross_add(drift, self.gyroscopic));
    }
}

/// Where columns meet the joints inboard: the derivatives, by places. What is zero for every configuration is never anything
/// else between calls.
#[derive(Clone, Debug)]
pub(crate) struct Meetings<T> {
    /// ∂T/∂q and ∂T/∂v.
    pub(crate) d_dq: Vec<T>,
    pub(crate) d_dv: Vec<T>,
    /// M, above the diagonal.
    pub(crate) d_da: Vec<T>,
    /// The transposes of ∂T/∂q and ∂T/∂v below the diagonal, where columns lie side by side.
    below_q: Vec<T>,
    below_v: Vec<T>,
    linear: Vec<bool>,
}

impl<T: Scalar> Meetings<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>, places: &Places) -> Self {
        let below = if T::COLUMNS > 1 { places.zeros() } else { Vec::new() };
        Meetings {
            d_dq: places.zeros(),
            d_dv: places.zeros(),
            d_da: places.zeros(),
            below_q: below.clone(),
            below_v: below,
            linear: linear_axes::<T>(layout, places),
        }
    }
    /// True if an axis at one of `count` places may have a linear part.
    #[inline(always)]
    pub(crate) fn is_linear(&self, at: usize, count: usize) -> bool {
        self.linear[at..at + count].iter().any(|x| *x)
    }
}

/// A degree of freedom, as columns from outboard see it.
struct Joint<T> {
    axis: Motion<T>,
    psi: Vec3<T>,
    position: Motion<T>,
    velocity: Motion<T>,
    linear: bool,
}

impl<T: Scalar> Joint<T> {
    #[inline(always)]
    fn get(here: &Group<'_, T, ALL>, linear: bool) -> Self {
        Joint {
            axis: here.motion(AXIS),
            psi: here.vector(PSI),
            position: here.motion(POSITION_RATE),
            velocity: here.motion(VELOCITY_RATE),
            linear,
        }
    }
    /// S* f.
    #[inline(always)]
    fn along<W: Wide<T>>(&self, f: &Wrench<W>) -> W {
        along(&self.axis, self.linear, f)
    }
    /// Ψ* R S + ψ* g.
    #[inline(always)]
    fn position<W: Wide<T>>(&self, column: &Column<W>) -> W {
        let moment = dot_add(self.psi, column.gyroscopic, dot(self.position.angular, column.inertia.moment));
        moment + dot(self.position.linear, column.inertia.force)
    }
    /// Γ* R S + s* g.
    #[inline(always)]
    fn velocity<W: Wide<T>>(&self, column: &Column<W>) -> W {
        let moment =
            dot(self.velocity.angular, column.inertia.moment) + dot(self.axis.angular, column.gyroscopic);
        if self.linear { dot_add(self.velocity.linear, column.inertia.force, moment) } else { moment }
    }
}

#[inline(always)]
fn dot<T: Scalar, W: Wide<T>>(a: Vec3<T>, b: Vec3<W>) -> W {
    let ([x, y, z], [u, v, w]) = (a.0, b.0);
    u.fma(W::broadcast(x), v.fma(W::broadcast(y), w * W::broadcast(z)))
}

#[inline(always)]
fn dot_add<T: Scalar, W: Wide<T>>(a: Vec3<T>, b: Vec3<W>, c: W) -> W {
    let ([x, y, z], [u, v, w]) = (a.0, b.0);
    u.fma(W::broadcast(x), v.fma(W::broadcast(y), w.fma(W::broadcast(z), c)))
}

/// Columns from the tips to the base: every joint meets those of all joints outboard of it.
#[inline(always)]
pub(crate) fn meet<T: Scalar, W: Wide<T>, const TURNING: bool>(
    layout: &Layout<T::Constant>,
    places: &Places,
    view: &mut View<'_, T, ALL>,
    meetings: &mut Meetings<T>,
) {
    let s = places.count;
    let Meetings { d_dq, d_dv, d_da, below_q, below_v, linear } = meetings;
    for (k, body) in layout.bodies().iter().enumerate().rev() {
        let (first, end) = (places.first[k], places.end[k]);
        let count = body.hinge.nv();
        let inner = first + count;
        let here = view.at(first);
        let (d, drift) = (here.vector::<T>(OFFSET), here.vector::<T>(DRIFT));
        let force = here.wrench::<T>(FORCE);
        let mut joint = Joint::get(&here, linear[first]);
        let mut at = Places::group(first, W::COUNT);
        while at < end {
            let column: Column<W> = Column::get(&view.at(at));
            let (from, to) = (first.saturating_sub(at), (end - at).min(W::COUNT));
            let own = inner.saturating_sub(at).min(W::COUNT);
            for i in 0..count {
                if count > 1 {
                    joint = Joint::get(&view.at(first + i), linear[first]);
                }
                let row = (first + i) * s + at..(first + i) * s + at + W::COUNT;
                let mut position = joint.along(&column.position);
                if count > 1 && own > 0 {
                    // Axes of the same joint do not turn each other's force.
                    let axes = view.at(at).motion::<W>(AXIS);
                    let f = Wrench::new(vector(force.moment), vector(force.force));
                    position -= joint.along(&axes.cross_wrench(f)).between(from, own);
                }
                position.between(from, to).store(&mut d_dq[row.clone()]);
                joint.along(&column.velocity).between(from, to).store(&mut d_dv[row.clone()]);
                if TURNING {
                    joint.along(&column.inertia).between(from, to).store(&mut d_da[row.clone()]);
                }
                if own >= to {
                    continue;
                }
                let position = joint.position(&column).between(own, to);
                let velocity = joint.velocity(&column).between(own, to);
                if W::COUNT > 1 {
                    position.store(&mut below_q[row.clone()]);
                    velocity.store(&mut below_v[row]);
                } else {
                    position.store(&mut d_dq[at * s + first + i..]);
                    velocity.store(&mut d_dv[at * s + first + i..]);
                }
            }
            if body.parent != GROUND {
                let (mut d, mut drift) = (vector::<T, W>(d), vector::<T, W>(drift));
                if to - from < W::COUNT {
                    // Columns beside those of the range stay where they are.
                    d = Vec3([d.0[0].between(from, to), d.0[1].between(from, to), d.0[2].between(from, to)]);
                    drift = Vec3([
                        drift.0[0].between(from, to),
                        drift.0[1].between(from, to),
                        drift.0[2].between(from, to),
                    ]);
                }
                column.shift(d, drift, &mut view.at(at));
            }
            at += W::COUNT;
        }
    }
    if W::COUNT > 1 {
        places.set_below::<T, W>(below_q, d_dq);
        places.set_below::<T, W>(below_v, d_dv);
    }
}
