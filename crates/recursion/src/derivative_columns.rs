//! Changes of forces at unit changes of each degree of freedom, moved inward side by side: the columns of
//! [`crate::inverse_dynamics_derivatives`], whose symbols are used here.
//!
//! | rows | meaning |
//! |---|---|
//! | `INERTIA` | R S, the force of an acceleration; also the weights with which rows of c see changes Ψ and Γ inboard |
//! | `POSITION` | force of a change of position |
//! | `VELOCITY` | force of a change of velocity |
//! | `GYROSCOPIC` | −2B* S, the weights with which rows of c see angular changes of velocity inboard: a moment only |

use crate::columns::{WidePassage, vector};
use crate::hinge::Hinge;
use crate::inverse_dynamics_derivatives::{AxisRates, DerivativeSweeps};
use crate::layout::{GROUND, Layout, Shifts};
use crate::side_by_side::{Places, Rows, scatter};
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{Motion, Scalar, Vec3, Wrench};

const INERTIA: usize = 0;
const POSITION: usize = 6;
const VELOCITY: usize = 12;
const GYROSCOPIC: usize = 18;
const COUNT: usize = 21;

/// One column.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column<T> {
    pub(crate) inertia: Wrench<T>,
    pub(crate) position: Wrench<T>,
    pub(crate) velocity: Wrench<T>,
    pub(crate) gyroscopic: Vec3<T>,
}

/// All of them, by components, and the derivatives that they meet in.
#[derive(Clone, Debug)]
pub(crate) struct DerivativeColumns<T> {
    rows: Vec<T>,
    /// ∂T/∂q and ∂T/∂v by places. What is zero for every configuration is never anything else between calls.
    pub(crate) d_dq: Vec<T>,
    pub(crate) d_dv: Vec<T>,
    /// M, above the diagonal.
    pub(crate) d_da: Vec<T>,
}

impl<T: Scalar> DerivativeColumns<T> {
    pub(crate) fn new(places: &Places) -> Self {
        let rows = vec![T::zero(); COUNT * places.stride];
        DerivativeColumns { rows, d_dq: places.zeros(), d_dv: places.zeros(), d_da: places.zeros() }
    }
}

type Columns<'a, T> = Rows<'a, T, COUNT>;

/// Begins a column.
#[inline(always)]
fn begin<T: Scalar>(columns: &mut Columns<'_, T>, at: usize, column: &Column<T>) {
    columns.set_wrench(INERTIA, at, column.inertia);
    columns.set_wrench(POSITION, at, column.position);
    columns.set_wrench(VELOCITY, at, column.velocity);
    columns.set_vector(GYROSCOPIC, at, column.gyroscopic);
}

/// Component i of H of the wrenches from row `row` on.
#[inline(always)]
fn along<T: Scalar, W: Wide<T>>(
    columns: &Columns<'_, T>,
    hinge: &Hinge<T::Constant>,
    i: usize,
    row: usize,
    at: usize,
) -> W {
    match hinge {
        Hinge::Revolute => columns.load(row + 2, at),
        _ => hinge.project(i, &columns.wrench(row, at)),
    }
}

/// The columns at `at` and beside it, from `skip` on, as row and column of axis i of a joint see them.
#[inline(always)]
fn meet<T: Scalar, W: Wide<T>>(
    columns: &Columns<'_, T>,
    hinge: &Hinge<T::Constant>,
    rates: &AxisRates<T>,
    at: usize,
) -> [W; 2] {
    let inertia = columns.wrench::<W>(INERTIA, at);
    let gyroscopic = columns.vector::<W>(GYROSCOPIC, at);
    let position = see(&inertia, gyroscopic, &rates.position, rates.psi);
    let velocity = if let Hinge::Revolute = hinge {
        // Γ has no more than two components, s one.
        let [x, y, _] = rates.velocity.angular.0;
        let [n, m, _] = inertia.moment.0;
        n.fma(W::broadcast(x), m.fma(W::broadcast(y), gyroscopic.0[2]))
    } else {
        see(&inertia, gyroscopic, &rates.velocity, rates.axis.angular)
    };
    [position, velocity]
}

/// φ(p, k) of columns; `drift` is −2u.
#[inline(always)]
fn shift<T: Scalar, W: Wide<T>>(
    columns: &mut Columns<'_, T>,
    passage: &WidePassage<'_, T, W>,
    drift: Vec3<W>,
    at: usize,
) {
    let inertia = passage.wrench_to_parent(columns.wrench::<W>(INERTIA, at));
    columns.set_wrench(INERTIA, at, inertia);
    let turned = passage.vector_to_parent(columns.vector::<W>(GYROSCOPIC, at));
    columns.set_vector(GYROSCOPIC, at, inertia.force.cross_add(drift, turned));
    let position = passage.wrench_to_parent(columns.wrench::<W>(POSITION, at));
    columns.set_wrench(POSITION, at, position);
    let velocity = passage.wrench_to_parent(columns.wrench::<W>(VELOCITY, at));
    columns.set_wrench(VELOCITY, at, velocity);
}

/// A change Ψ or Γ inboard and its angular part ψ or s, as the rows of the columns see it.
#[inline(always)]
fn see<T: Scalar, W: Wide<T>>(f: &Wrench<W>, gyroscopic: Vec3<W>, change: &Motion<T>, angular: Vec3<T>) -> W {
    let (n, f, g) = (f.moment.0, f.force.0, gyroscopic.0);
    let ([a, b, c], [d, e, h], [x, y, z]) = (change.angular.0, change.linear.0, angular.0);
    let first = n[0].fma(W::broadcast(a), n[1].fma(W::broadcast(b), n[2] * W::broadcast(c)));
    let second = f[0].fma(W::broadcast(d), f[1].fma(W::broadcast(e), f[2] * W::broadcast(h)));
    let third = g[0].fma(W::broadcast(x), g[1].fma(W::broadcast(y), g[2] * W::broadcast(z)));
    first + second + third
}

impl<T: Scalar> DerivativeSweeps<T> {
    /// Composites and columns, from the tips to the base; every body meets the columns of all joints outboard of it. With
    /// `TURNING`, v̇ is the derivative of v, and M comes, too; without, v̇ + c is the number that stays while v changes.
    #[inline(always)]
    pub(crate) fn inboard<const TURNING: bool, W: Wide<T>>(
        &mut self,
        layout: &Layout<T::Constant>,
        shifts: &Shifts<T>,
        v: &[T],
    ) {
        let DerivativeSweeps { places, moving, composite: composites, columns: all, .. } = self;
        let s = places.stride;
        let DerivativeColumns { rows, d_dq, d_dv, d_da } = all;
        let mut columns = Columns::new(rows, s);
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let (moving, composite) = (&moving[k], composites[k]);
            let (first, end) = (places.first[k], places.end[k]);
            let count = body.hinge.nv();
            let inner = first + count;
            for i in 0..count {
                let (rates, column) = if let Hinge::Revolute = body.hinge {
                    composite.revolute(moving)
                } else {
                    composite.general::<TURNING>(body, i, moving, &v[body.v..])
                };
                let here = first + i;
                begin(&mut columns, here, &column);
                let mut at = end;
                while at > inner {
                    at -= W::COUNT;
                    let row = here * s..(here + 1) * s;
                    along::<T, W>(&columns, &body.hinge, i, POSITION, at).store(&mut d_dq[row.clone()][at..]);
                    along::<T, W>(&columns, &body.hinge, i, VELOCITY, at).store(&mut d_dv[row.clone()][at..]);
                    if TURNING {
                        along::<T, W>(&columns, &body.hinge, i, INERTIA, at).store(&mut d_da[row][at..]);
                    }
                    let skip = inner.saturating_sub(at);
                    let [position, velocity] = meet::<T, W>(&columns, &body.hinge, &rates, at);
                    scatter(position, d_dq, s, (at, here), skip);
                    scatter(velocity, d_dv, s, (at, here), skip);
                }
                if W::COUNT > 1 {
                    // The last group has written more than there is.
                    let before = here * s + first - W::COUNT;
                    W::zero().store(&mut d_dq[before..]);
                    W::zero().store(&mut d_dv[before..]);
                }
            }
            for i in 0..count {
                for c in first..inner {
                    let row = (first + i) * s + c;
                    d_dq[row] = along::<T, T>(&columns, &body.hinge, i, POSITION, c);
                    d_dv[row] = along::<T, T>(&columns, &body.hinge, i, VELOCITY, c);
                    if TURNING {
                        d_da[row] = along::<T, T>(&columns, &body.hinge, i, INERTIA, c);
                    }
                }
            }
            if body.parent == GROUND {
                continue;
            }
            for i in 0..count {
                // The force itself turns and moves with the axis, as the parent sees it.
                let turned = body.hinge.axis(i).cross_wrench(composite.force);
                let mut position = columns.wrench::<T>(POSITION, first + i);
                position += turned;
                columns.set_wrench(POSITION, first + i, position);
            }
            let passage = shifts.at(k, body);
            let wide = WidePassage::<T, W>::new(body, shifts.at(k, body));
            let drift = vector::<T, W>(moving.drift);
            let mut at = end;
            while at > first {
                at -= W::COUNT;
                shift(&mut columns, &wide, drift, at);
            }
            let moved = composite.shifted(&passage, moving.drift);
            composites[body.parent].add(&moved);
        }
    }
}
