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
    COLUMNS, DIAGONAL, DRIFT, FORCE, POSITION_RATE, PSI, ROWS as ALL, VELOCITY_RATE,
};
use crate::layout::{GROUND, Layout, LayoutBody};
use crate::places::{Group, Places, View, inside, vector};
use core::marker::PhantomData;
use core::ops::Range;
use phipsi_spatial::wide::{WIDEST, Wide};
use phipsi_spatial::{Kernel, Motion, Scalar, Vec3, Wrench};

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
    linear: Vec<bool>,
}

impl<T: Scalar> Meetings<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>, places: &Places) -> Self {
        Meetings {
            d_dq: places.zeros(),
            d_dv: places.zeros(),
            d_da: places.zeros(),
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

/// Columns from the tips to the base: every joint meets those of all joints outboard of it. A kernel of its own, for smaller
/// functions keep more in registers.
pub(crate) struct Meet<'a, T: Scalar, W, const TURNING: bool> {
    pub(crate) layout: &'a Layout<T::Constant>,
    pub(crate) places: &'a Places,
    pub(crate) view: View<'a, T, ALL>,
    pub(crate) meetings: &'a mut Meetings<T>,
    pub(crate) register: PhantomData<W>,
}

impl<T: Scalar, W: Wide<T>, const TURNING: bool> Kernel for Meet<'_, T, W, TURNING> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Meet { layout, places, mut view, meetings, .. } = self;
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            if body.hinge.nv() == 1 {
                meet::<T, W, TURNING, false>(places, &mut view, meetings, k, body);
            } else {
                meet::<T, W, TURNING, true>(places, &mut view, meetings, k, body);
            }
        }
    }
}

/// A joint, of more than one degree of freedom if `MANY`, and the columns outboard of it.
#[inline(always)]
fn meet<T: Scalar, W: Wide<T>, const TURNING: bool, const MANY: bool>(
    places: &Places,
    view: &mut View<'_, T, ALL>,
    meetings: &mut Meetings<T>,
    k: usize,
    body: &LayoutBody<T::Constant>,
) {
    let Meetings { d_dq, d_dv, d_da, linear } = meetings;
    let (s, first, end) = (places.stride, places.first[k], places.end[k]);
    let (count, linear) = (if MANY { body.hinge.nv() } else { 1 }, linear[first]);
    let inner = first + count;
    let here = view.at(first);
    let (d, drift) = (here.vector::<T>(OFFSET), here.vector::<T>(DRIFT));
    let force = here.wrench::<T>(FORCE);
    let mut joint = Joint::get(&here, linear);
    let mut at = Places::group(first, W::COUNT);
    while at < end {
        let column: Column<W> = Column::get(&view.at(at));
        let (from, to) = (first.saturating_sub(at), (end - at).min(W::COUNT));
        let own = inner.saturating_sub(at).min(W::COUNT);
        for i in 0..count {
            if MANY {
                joint = Joint::get(&view.at(first + i), linear);
            }
            let row = (first + i) * s + at..(first + i) * s + at + W::COUNT;
            let mut position = joint.along(&column.position);
            if MANY && own > 0 {
                // Axes of the same joint do not turn each other's force.
                let axes = view.at(at).motion::<W>(AXIS);
                let f = Wrench::new(vector(force.moment), vector(force.force));
                position -= joint.along(&axes.cross_wrench(f)).between(from, own);
            }
            position.between(from, to).store(&mut d_dq[row.clone()]);
            joint.along(&column.velocity).between(from, to).store(&mut d_dv[row.clone()]);
            if TURNING {
                joint.along(&column.inertia).between(from, to).store(&mut d_da[row]);
            }
            if own >= to {
                continue;
            }
            // Rows of the columns' own joints, which the sweep has passed.
            let place = (at * s + first + i, s);
            scatter(joint.position(&column), d_dq, place, own..to);
            scatter(joint.velocity(&column), d_dv, place, own..to);
        }
        if body.parent != GROUND {
            // Columns beside those of the range stay where they are.
            let d = inside(vector::<T, W>(d), from, to);
            column.shift(d, inside(vector::<T, W>(drift), from, to), &mut view.at(at));
        }
        at += W::COUNT;
    }
    for here in first..inner {
        // The axis does not turn its own force: exactly so, where the columns have the difference of what rounds.
        d_dq[here * s + here] = view.at(here).get(DIAGONAL);
    }
}

/// Some numbers of `x`, number l to row `first` + l of a matrix, in one column: `first` and the column are those of the first
/// index, the second is the distance of rows.
#[inline(always)]
fn scatter<T: Scalar, W: Wide<T>>(
    x: W,
    matrix: &mut [T],
    (first, stride): (usize, usize),
    some: Range<usize>,
) {
    if W::COUNT == 1 {
        return x.store(&mut matrix[first..]);
    }
    let mut numbers = [T::zero(); WIDEST];
    x.store(&mut numbers);
    let rows = matrix[first + some.start * stride..].chunks_mut(stride);
    for (row, x) in rows.zip(&numbers[some]) {
        row[0] = *x;
    }
}
