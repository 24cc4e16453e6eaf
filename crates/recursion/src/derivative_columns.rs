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
use crate::side_by_side::{Places, scatter};
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
    #[inline(always)]
    fn vector<W: Wide<T>>(&self, s: usize, row: usize, at: usize) -> Vec3<W> {
        let r = &self.rows[row * s + at..];
        Vec3([W::load(r), W::load(&r[s..]), W::load(&r[2 * s..])])
    }
    #[inline(always)]
    fn set_vector<W: Wide<T>>(&mut self, s: usize, row: usize, at: usize, x: Vec3<W>) {
        let r = &mut self.rows[row * s + at..];
        x.0[0].store(r);
        x.0[1].store(&mut r[s..]);
        x.0[2].store(&mut r[2 * s..]);
    }
    #[inline(always)]
    fn wrench<W: Wide<T>>(&self, s: usize, row: usize, at: usize) -> Wrench<W> {
        Wrench::new(self.vector(s, row, at), self.vector(s, row + 3, at))
    }
    #[inline(always)]
    fn set_wrench<W: Wide<T>>(&mut self, s: usize, row: usize, at: usize, f: Wrench<W>) {
        self.set_vector(s, row, at, f.moment);
        self.set_vector(s, row + 3, at, f.force);
    }
    /// Begins a column.
    #[inline(always)]
    fn set(&mut self, s: usize, at: usize, column: &Column<T>) {
        self.set_wrench(s, INERTIA, at, column.inertia);
        self.set_wrench(s, POSITION, at, column.position);
        self.set_wrench(s, VELOCITY, at, column.velocity);
        self.set_vector(s, GYROSCOPIC, at, column.gyroscopic);
    }
    /// Component i of H of the wrenches in `rows`.
    #[inline(always)]
    fn along<W: Wide<T>>(&self, s: usize, hinge: &Hinge<T::Constant>, i: usize, row: usize, at: usize) -> W {
        match hinge {
            Hinge::Revolute => W::load(&self.rows[(row + 2) * s + at..]),
            Hinge::Helical { pitch } => {
                let (n, f) = (&self.rows[(row + 2) * s + at..], &self.rows[(row + 5) * s + at..]);
                W::load(f).fma(W::constant(*pitch), W::load(n))
            }
            _ => W::load(&self.rows[(row + hinge.components()[i]) * s + at..]),
        }
    }
    /// Row and column of axis i of a joint, at place `here`, with the columns at `at` and beside it from `skip` on.
    #[inline(always)]
    fn meet<W: Wide<T>, const MASS: bool>(
        &mut self,
        s: usize,
        hinge: &Hinge<T::Constant>,
        i: usize,
        rates: &AxisRates<T>,
        here: usize,
        (at, skip): (usize, usize),
    ) {
        let row = here * s + at;
        self.along::<W>(s, hinge, i, POSITION, at).store(&mut self.d_dq[row..]);
        self.along::<W>(s, hinge, i, VELOCITY, at).store(&mut self.d_dv[row..]);
        if MASS {
            self.along::<W>(s, hinge, i, INERTIA, at).store(&mut self.d_da[row..]);
        }
        let inertia = self.wrench::<W>(s, INERTIA, at);
        let gyroscopic = self.vector::<W>(s, GYROSCOPIC, at);
        let down = at * s + here;
        let position = see(&inertia, gyroscopic, &rates.position, rates.psi);
        scatter(position, &mut self.d_dq, down, s, skip);
        let velocity = if let Hinge::Revolute = hinge {
            // Γ has no more than two components, s one.
            let [x, y, _] = rates.velocity.angular.0;
            let [n, m, _] = inertia.moment.0;
            n.fma(W::broadcast(x), m.fma(W::broadcast(y), gyroscopic.0[2]))
        } else {
            see(&inertia, gyroscopic, &rates.velocity, rates.axis.angular)
        };
        scatter(velocity, &mut self.d_dv, down, s, skip);
    }
    /// φ(p, k) of columns; `drift` is −2u.
    #[inline(always)]
    fn shift<W: Wide<T>>(&mut self, s: usize, passage: &WidePassage<'_, T, W>, drift: Vec3<W>, at: usize) {
        let inertia = passage.wrench_to_parent(self.wrench::<W>(s, INERTIA, at));
        self.set_wrench(s, INERTIA, at, inertia);
        let turned = passage.vector_to_parent(self.vector::<W>(s, GYROSCOPIC, at));
        self.set_vector(s, GYROSCOPIC, at, inertia.force.cross_add(drift, turned));
        let position = passage.wrench_to_parent(self.wrench::<W>(s, POSITION, at));
        self.set_wrench(s, POSITION, at, position);
        let velocity = passage.wrench_to_parent(self.wrench::<W>(s, VELOCITY, at));
        self.set_wrench(s, VELOCITY, at, velocity);
    }
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
        let s = self.places.stride;
        for (k, body) in layout.bodies().iter().enumerate().rev() {
            let (moving, composite) = (self.moving[k], self.composite[k]);
            let (first, end) = (self.places.first[k], self.places.end[k]);
            let count = body.hinge.nv();
            let inner = first + count;
            let columns = &mut self.columns;
            for i in 0..count {
                let (rates, column) = if let Hinge::Revolute = body.hinge {
                    composite.revolute(&moving)
                } else {
                    composite.general::<TURNING>(body, i, &moving, &v[body.v..])
                };
                let here = first + i;
                columns.set(s, here, &column);
                let mut at = end;
                while at > inner {
                    at -= W::COUNT;
                    let skip = inner.saturating_sub(at);
                    columns.meet::<W, TURNING>(s, &body.hinge, i, &rates, here, (at, skip));
                }
                if W::COUNT > 1 {
                    let before = here * s + first - W::COUNT;
                    W::zero().store(&mut columns.d_dq[before..]);
                    W::zero().store(&mut columns.d_dv[before..]);
                }
            }
            for i in 0..count {
                for c in first..inner {
                    let row = (first + i) * s + c;
                    columns.d_dq[row] = columns.along::<T>(s, &body.hinge, i, POSITION, c);
                    columns.d_dv[row] = columns.along::<T>(s, &body.hinge, i, VELOCITY, c);
                    if TURNING {
                        columns.d_da[row] = columns.along::<T>(s, &body.hinge, i, INERTIA, c);
                    }
                }
            }
            if body.parent == GROUND {
                continue;
            }
            for i in 0..count {
                // The force itself turns and moves with the axis, as the parent sees it.
                let turned = body.hinge.axis(i).cross_wrench(composite.force);
                let mut position = columns.wrench::<T>(s, POSITION, first + i);
                position += turned;
                columns.set_wrench(s, POSITION, first + i, position);
            }
            let passage = shifts.at(k, body);
            let wide = WidePassage::<T, W>::new(body, shifts.at(k, body));
            let drift = vector::<T, W>(moving.drift);
            let mut at = end;
            while at > first {
                at -= W::COUNT;
                columns.shift(s, &wide, drift, at);
            }
            let moved = composite.shifted(&passage, moving.drift);
            self.composite[body.parent].add(&moved);
        }
    }
}
