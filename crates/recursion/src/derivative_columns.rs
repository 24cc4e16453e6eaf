//! Changes of forces at unit changes of each degree of freedom, moved inward side by side: the columns of
//! [`crate::inverse_dynamics_derivatives`], whose symbols are used here. A register of columns goes its way to the base without being
//! stored, twice: the weights, then the forces, so that each way has names for all that it carries.
//!
//! | column | meaning |
//! |---|---|
//! | inertia | R S, the force of an acceleration; also the weights with which rows of c see changes Ψ and Γ inboard |
//! | gyroscopic | −2B* S, the weights with which rows of c see angular changes of velocity inboard: a moment only |
//! | position | force of a change of position |
//! | velocity | force of a change of velocity |

use crate::floating_base::{along_axes, each_axis};
use crate::ground_axes::{AXES, AXIS, OFFSET, Passages, along, dot, each_way};
use crate::inverse_dynamics_derivatives::{
    DIAGONAL, DRIFT, FORCE, POSITION_RATE, PSI, ROWS, VELOCITY_RATE, begin_columns, own_blocks,
    own_position_block, weigh_position, weigh_velocity,
};
use crate::layout::Layout;
use crate::places::{Aligned, Pair, Places, Table, View, inside, vector};
use core::marker::PhantomData;
use core::ops::Range;
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{Kernel, Scalar, Vec3, Wrench};

/// Columns of a register.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column<W> {
    pub(crate) inertia: Wrench<W>,
    pub(crate) position: Wrench<W>,
    pub(crate) velocity: Wrench<W>,
    pub(crate) gyroscopic: Vec3<W>,
}

/// Where columns meet the joints inboard: the derivatives, by places. What is zero for every configuration is never anything
/// else between calls.
#[derive(Clone, Debug)]
pub(crate) struct Meetings<T> {
    /// ∂T/∂q and ∂T/∂v.
    pub(crate) rates: Pair<T>,
    /// M, above the diagonal.
    pub(crate) d_da: Aligned<T>,
    /// Below the diagonal, turned over: row p has what the rows of the columns outboard see of joint p. By panels of [`Scalar::COLUMNS`]
    /// columns: rows of ∂T/∂q and, beside them, of ∂T/∂v. Empty where columns are one number wide.
    turned: Aligned<T>,
    passages: Passages,
}

impl<T: Scalar> Meetings<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>, places: &Places) -> Self {
        let turned = if T::COLUMNS > 1 { 2 * places.count * places.count } else { 0 };
        Meetings {
            rates: Pair::new(places),
            d_da: places.zeros(),
            turned: Aligned::new(turned),
            passages: Passages::new::<T>(layout, places),
        }
    }
}

#[inline(always)]
fn dot_add<T: Scalar, W: Wide<T>>(a: Vec3<T>, b: Vec3<W>, c: W) -> W {
    let ([x, y, z], [u, v, w]) = (a.0, b.0);
    u.fma(W::broadcast(x), v.fma(W::broadcast(y), w.fma(W::broadcast(z), c)))
}

/// Columns from their joints to the base: every column meets all joints inboard of it. A kernel of its own, for smaller functions
/// keep more in registers.
pub(crate) struct Meet<'a, T: Scalar, W, const TURNING: bool> {
    pub(crate) places: &'a Places,
    pub(crate) view: View<'a, T, ROWS>,
    pub(crate) meetings: &'a mut Meetings<T>,
    pub(crate) register: PhantomData<W>,
}

impl<T: Scalar, W: Wide<T>, const TURNING: bool> Kernel for Meet<'_, T, W, TURNING> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Meet { places, mut view, meetings, .. } = self;
        let mut at = Places::group(places.margin, W::COUNT);
        while at < places.count {
            if places.all_of_base(at, W::COUNT) {
                at += W::COUNT;
                continue;
            }
            let mut group = view.at(at);
            let column: Column<W> = if meetings.passages.is_linear(at, W::COUNT) {
                begin_columns::<T, W, TURNING, true>(&mut group)
            } else {
                begin_columns::<T, W, TURNING, false>(&mut group)
            };
            meetings.weigh::<W, TURNING>(places, &view, at, column.inertia, column.gyroscopic);
            meetings.add_up(&mut view, at, column.position, column.velocity);
            at += W::COUNT;
        }
        meetings.turn_back::<W>(places);
        for &first in &places.bases {
            let [velocity, M] = own_blocks::<T, TURNING>(&view.at(first));
            let mut rates = meetings.rates.view();
            rates.set_block(1, (first, first), &velocity);
            if TURNING || first != places.margin {
                rates.set_block(0, (first, first), &own_position_block(&view.at(first)));
            }
            if TURNING {
                for (i, row) in M.iter().enumerate() {
                    meetings.d_da[(first + i) * places.stride + first..][..6].copy_from_slice(row);
                }
            }
        }
    }
}

impl<T: Scalar> Meetings<T> {
    /// Rows of the columns from place `at` on, at the joints inboard; M on the way, if `TURNING`.
    #[inline(always)]
    fn weigh<W: Wide<T>, const TURNING: bool>(
        &mut self,
        places: &Places,
        view: &View<'_, T, ROWS>,
        at: usize,
        mut inertia: Wrench<W>,
        mut gyroscopic: Vec3<W>,
    ) {
        let Meetings { rates, d_da, turned, passages } = self;
        let (d_da, mut rates, s): (&mut [T], _, usize) = (d_da, rates.view(), places.stride);
        let panel: &mut [T] = if W::COUNT > 1 { &mut turned[panel(places, at, T::COLUMNS)] } else { &mut [] };
        let lane = at & (T::COLUMNS - W::COUNT.min(T::COLUMNS));
        for (place, joint) in passages.inward(at, W::COUNT) {
            each_way!(joint.columns(at, W::COUNT), |columns, ALL| {
                let here = view.lane(Table::<T, ROWS>::start(place));
                let seen = ALL || place < at + W::COUNT;
                if TURNING && seen {
                    let x = along(&here.motion(AXIS), joint.linear, &inertia);
                    columns.outboard::<ALL, _, _>(x).store(&mut d_da[place * s + at..]);
                }
                // Not where all columns are the joint's own.
                if ALL || seen && columns.own != columns.to {
                    let (change, rate) = (here.motion(POSITION_RATE), here.motion(VELOCITY_RATE));
                    // Ψ* R S + ψ* g.
                    let moment = dot_add(here.vector(PSI), gyroscopic, dot(change.angular, inertia.moment));
                    let position = moment + dot(change.linear, inertia.force);
                    // Γ* R S + s* g.
                    let mut velocity = dot(rate.angular, inertia.moment) + dot(here.vector(AXIS), gyroscopic);
                    if joint.linear {
                        velocity = dot_add(rate.linear, inertia.force, velocity);
                    }
                    if W::COUNT == 1 {
                        rates.set(at, place, [position, velocity]);
                    } else {
                        let row = &mut panel[place * 2 * T::COLUMNS..][..2 * T::COLUMNS];
                        columns.outboard::<ALL, _, _>(position).store(&mut row[lane..]);
                        columns.outboard::<ALL, _, _>(velocity).store(&mut row[T::COLUMNS + lane..]);
                    }
                }
                if joint.shifts {
                    let d = columns.moving::<ALL, _, _>(here.vector(OFFSET));
                    let drift = columns.moving::<ALL, _, _>(here.vector(DRIFT));
                    inertia.moment = d.cross_add(inertia.force, inertia.moment);
                    gyroscopic = inertia.force.cross_add(drift, gyroscopic);
                }
            });
        }
        for base in passages.bases(at, W::COUNT) {
            let (first, columns) = (base.first, base.columns(at, W::COUNT));
            let here = view.lane(Table::<T, ROWS>::start(first));
            if TURNING {
                let all = along_axes(&here.vectors(AXES), &inertia);
                each_axis!(|I| all[I].between(0, columns.to).store(&mut d_da[(first + I) * s + at..]));
            }
            let velocity = weigh_velocity::<T, W, TURNING>(&here, inertia, gyroscopic);
            let mut position = [W::zero(); 3];
            // Without `TURNING`, the first base's columns by its place are known.
            if TURNING || first != places.margin {
                position = weigh_position(&here, inertia);
            }
            each_axis!(|I| if W::COUNT == 1 {
                let position = if I < 3 { position[I % 3] } else { W::zero() };
                rates.set(at, first + I, [position, velocity[I]]);
            } else {
                let row = &mut panel[(first + I) * 2 * T::COLUMNS..][..2 * T::COLUMNS];
                if I < 3 {
                    position[I % 3].between(0, columns.to).store(&mut row[lane..]);
                }
                if I < 3 || TURNING {
                    velocity[I].between(0, columns.to).store(&mut row[T::COLUMNS + lane..]);
                }
            });
        }
    }
    /// Rows of the joints from the columns from place `at` on.
    #[inline(always)]
    fn add_up<W: Wide<T>>(
        &mut self,
        view: &mut View<'_, T, ROWS>,
        at: usize,
        mut position: Wrench<W>,
        mut velocity: Wrench<W>,
    ) {
        let Meetings { rates, passages, .. } = self;
        let mut rates = rates.view();
        for (place, joint) in passages.inward(at, W::COUNT) {
            each_way!(joint.columns(at, W::COUNT), |columns, ALL| {
                let here = view.lane(Table::<T, ROWS>::start(place));
                let axis = here.motion(AXIS);
                let mut seen = position;
                if !ALL && joint.inner > joint.first + 1 && columns.own > columns.from {
                    // Axes of the same joint do not turn each other's force.
                    let f = Wrench::new(vector(here.vector(FORCE)), vector(here.vector(FORCE + 3)));
                    let turned = view.at(at).motion::<W>(AXIS).cross_wrench(f);
                    seen.moment -= inside(turned.moment, columns.from, columns.own);
                    seen.force -= inside(turned.force, columns.from, columns.own);
                }
                let here = view.lane(Table::<T, ROWS>::start(place));
                let mut x: W = along(&axis, joint.linear, &seen);
                let y = along(&axis, joint.linear, &velocity);
                if !ALL && (at..at + W::COUNT).contains(&place) {
                    // The axis does not turn its own force: exactly so, where the columns have the difference of what rounds.
                    x = x.with(place - at, here.get(DIAGONAL));
                }
                let both = [columns.outboard::<ALL, _, _>(x), columns.outboard::<ALL, _, _>(y)];
                rates.put(place, at, both);
                if joint.shifts {
                    let d = columns.moving::<ALL, _, _>(here.vector(OFFSET));
                    position.moment = d.cross_add(position.force, position.moment);
                    velocity.moment = d.cross_add(velocity.force, velocity.moment);
                }
            });
        }
        for base in passages.bases(at, W::COUNT) {
            let to = base.columns(at, W::COUNT).to;
            let axes = view.lane(Table::<T, ROWS>::start(base.first)).vectors(AXES);
            let (x, y) = (along_axes(&axes, &position), along_axes(&axes, &velocity));
            each_axis!(|I| rates.put(base.first + I, at, [x[I].between(0, to), y[I].between(0, to)]));
        }
    }
    /// What was turned over goes to its rows, beside what is there of the rows' own joints and of those outboard.
    #[inline(always)]
    fn turn_back<W: Wide<T>>(&mut self, places: &Places) {
        if W::COUNT == 1 {
            return;
        }
        let Meetings { rates, turned, passages, .. } = self;
        let (turned, mut rates): (&[T], _) = (turned, rates.view());
        let mut left = Places::group(places.margin, W::COUNT);
        while left < places.count {
            let (mut top, end) = (left, places.outboard_end(left, W::COUNT));
            while top < end {
                let ends = passages.first(top..top + W::COUNT);
                if ends[W::COUNT - 1] <= left.max(places.margin) {
                    // No row has a joint inboard among these columns: its own is not one.
                    top += W::COUNT;
                    continue;
                }
                let lane = top & (T::COLUMNS - W::COUNT.min(T::COLUMNS));
                let rows = &turned[panel(places, top, T::COLUMNS)][left * 2 * T::COLUMNS..];
                let rows = &rows[..W::COUNT * 2 * T::COLUMNS];
                let (x, y) = (&rows[lane..], &rows[T::COLUMNS + lane..]);
                let mut tiles = [W::load_rows(2 * T::COLUMNS, x), W::load_rows(2 * T::COLUMNS, y)];
                W::transpose(&mut tiles[0]);
                W::transpose(&mut tiles[1]);
                // Of every row what lies inboard of its joint.
                rates.put_tiles((top, left), tiles, ends);
                top += W::COUNT;
            }
            left += W::COUNT;
        }
    }
}

/// Where the panel of the columns around place `at` lies, two numbers a place.
#[inline(always)]
fn panel(places: &Places, at: usize, columns: usize) -> Range<usize> {
    let size = places.count * 2 * columns;
    at / columns * size..(at / columns + 1) * size
}
