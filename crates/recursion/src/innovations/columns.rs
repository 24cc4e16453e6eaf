//! −M⁻¹ B by a filter and a smoother over the columns of B, several side by side.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | z | force that comes from outboard, moved inward | paper 1 (9.3) |
//! | ε | innovation b − H z | paper 1 (9.5) |
//! | λ | minus the acceleration of the body | paper 1 (9.12) |
//! | x | D⁻¹ ε + K* λ | paper 1 (9.14) |
//!
//! About 33 multiplications an entry, where the product with M⁻¹ has one for every degree of freedom that is related to the
//! column's: this way is for long chains.

use super::{GAIN, GAINS, Innovations, base_gains};
use crate::floating_base::{self, along_axes, each_axis};
use crate::ground_axes::{AXIS, OFFSET, Passages, along, dot};
use crate::hinge::Hinge;
use crate::layout::{GROUND, Layout, LayoutBody};
use crate::places::{Pair, PairRows, PairView, Places, Table, View, vector};
use phipsi_spatial::wide::Wide;
use phipsi_spatial::{Motion, Scalar, Vec3, Wrench};

/// Degrees of freedom related to a column, on average, from which sweeps take less time than products.
const RELATED: usize = 48;
/// Registers side by side, at most.
const SIDE: usize = 4;

/// Room for the sweeps.
#[derive(Clone, Debug)]
pub(super) struct ColumnSweeps<T> {
    /// ε of every place.
    innovations: Vec<T>,
    /// z, then λ, of the bodies with several children.
    branches: Vec<T>,
    /// The place of a body among those.
    branch: Vec<usize>,
}

impl<T: Scalar> ColumnSweeps<T> {
    /// Where sweeps take less time.
    pub(super) fn new(layout: &Layout<T::Constant>, places: &Places) -> Option<Self> {
        let bodies = layout.bodies();
        // Inside a tree a free joint passes nothing of what comes from outboard.
        let passes = bodies.iter().any(|b| matches!(b.hinge, Hinge::Free) && b.parent != GROUND);
        // Every pair of a degree of freedom with one outboard of it relates both.
        let related = 2 * places.pairs();
        if passes || related < RELATED * (places.count - places.margin) {
            return None;
        }
        Some(Self::always(layout, places))
    }
    fn always(layout: &Layout<T::Constant>, places: &Places) -> Self {
        let mut count = 0;
        let mut number = |several: bool| {
            count += usize::from(several);
            count.saturating_sub(1)
        };
        let branch = layout.bodies().iter().map(|b| number(b.children > 1)).collect();
        ColumnSweeps {
            innovations: vec![T::zero(); places.count * SIDE * T::COLUMNS],
            branches: vec![T::zero(); count * 6 * SIDE * T::COLUMNS],
            branch,
        }
    }
}

/// Six numbers of `C` registers, kept.
#[inline(always)]
fn load<T: Scalar, W: Wide<T>, const C: usize>(kept: &[T]) -> [[W; 6]; C] {
    let mut numbers = [[W::zero(); 6]; C];
    for (x, kept) in numbers.as_flattened_mut().iter_mut().zip(kept.chunks_exact(W::COUNT)) {
        *x = W::load(kept);
    }
    numbers
}

#[inline(always)]
fn store<T: Scalar, W: Wide<T>, const C: usize>(numbers: [[W; 6]; C], kept: &mut [T]) {
    for (x, kept) in numbers.into_iter().flatten().zip(kept.chunks_exact_mut(W::COUNT)) {
        x.store(kept);
    }
}

#[inline(always)]
fn wrench<W: Copy>([a, b, c, d, e, f]: [W; 6]) -> Wrench<W> {
    Wrench { moment: Vec3([a, b, c]), force: Vec3([d, e, f]) }
}

#[inline(always)]
fn numbers<W: Copy>(angular: Vec3<W>, linear: Vec3<W>) -> [W; 6] {
    let ([a, b, c], [d, e, f]) = (angular.0, linear.0);
    [a, b, c, d, e, f]
}

impl<T: Scalar> Innovations<T> {
    /// True where [`Innovations::negative_sweeps`] are the faster way.
    pub(crate) fn has_sweeps(&self) -> bool {
        self.columns.is_some()
    }
    /// −M⁻¹ B for two matrices B, to the model's order; `bodies` of the same configuration.
    #[inline(always)]
    pub(crate) fn negative_sweeps<W: Wide<T>, const N: usize>(
        &mut self,
        layout: &Layout<T::Constant>,
        places: &Places,
        bodies: &mut View<'_, T, N>,
        b: &Pair<T>,
        out: [&mut [T]; 2],
    ) {
        let Innovations { columns, gains, inverse, passages, products, .. } = self;
        let known = products.known;
        let (b, mut solution) = (b.read(), products.solution.view());
        let Some(columns) = columns else { return };
        // Four registers hold 24 numbers: only AVX-512 has names for as many.
        let wide = size_of::<W>() >= 64;
        let (mut column, end) = (known, 2 * (places.count - places.margin));
        while column < end {
            if wide && column + 2 * W::COUNT < end {
                inward::<T, W, N, SIDE>(layout, places, bodies, gains, passages, columns, b, column);
                outward::<T, W, N, SIDE>(
                    layout,
                    places,
                    bodies,
                    gains,
                    (inverse, passages),
                    columns,
                    &mut solution,
                    column,
                );
                column += SIDE * W::COUNT;
            } else {
                inward::<T, W, N, 2>(layout, places, bodies, gains, passages, columns, b, column);
                outward::<T, W, N, 2>(
                    layout,
                    places,
                    bodies,
                    gains,
                    (inverse, passages),
                    columns,
                    &mut solution,
                    column,
                );
                column += 2 * W::COUNT;
            }
        }
        products.solution.write::<W>(places, out);
    }
}

/// One degree of freedom: its axis, K, and what `$step` does with it, for axes with a linear part and for those without.
macro_rules! with_axis {
    ($bodies:expr, $gains:expr, $passages:expr, $place:expr, |$axis:ident, $gain:ident, $LINEAR:ident| $step:expr) => {
        let ($axis, $gain): (Motion<T>, Wrench<T>) =
            ($bodies.at($place).motion(AXIS), $gains.at($place).wrench(GAIN));
        if $passages.linear($place) {
            const $LINEAR: bool = true;
            $step;
        } else {
            const $LINEAR: bool = false;
            $step;
        }
    };
}

/// ε of `C` registers from column `column` of both matrices on.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn inward<T: Scalar, W: Wide<T>, const N: usize, const C: usize>(
    layout: &Layout<T::Constant>,
    places: &Places,
    bodies: &mut View<'_, T, N>,
    gains: &mut Table<T, GAINS>,
    passages: &Passages,
    columns: &mut ColumnSweeps<T>,
    b: PairRows<'_, T>,
    column: usize,
) {
    let size = 6 * SIDE * T::COLUMNS;
    let mut gains = gains.view();
    columns.branches.fill(T::zero());
    let mut z = [Wrench::<W>::zero(); C];
    let all = layout.bodies();
    let mut k = all.len();
    while k > 0 {
        k -= 1;
        let body = &all[k];
        let (first, inner) = (places.first[k], places.first[k] + body.hinge.nv());
        match body.children {
            0 => z = [Wrench::zero(); C],
            1 => (),
            _ => {
                let kept = &columns.branches[columns.branch[k] * size..][..size];
                for (z, kept) in z.iter_mut().zip(load::<T, W, C>(kept)) {
                    *z = wrench(kept);
                }
            }
        }
        if let Hinge::Revolute = body.hinge {
            // Along a run of hinges z stays in registers: by number, for iterators would keep it in memory.
            let mut run = z;
            loop {
                let (body, place) = (&all[k], places.first[k]);
                let here = bodies.lane(Table::<T, N>::start(place));
                let (axis, d) = (here.vector(AXIS), vector::<T, W>(here.vector(OFFSET)));
                let gain = gains.at(place).wrench::<T>(GAIN);
                let (moment, force) = (vector::<T, W>(gain.moment), vector::<T, W>(gain.force));
                let kept = &mut columns.innovations[place * SIDE * T::COLUMNS..][..C * W::COUNT];
                let measured = b.one::<W, C>(place, column);
                for c in 0..C {
                    let innovation = W::load(&measured[c * W::COUNT..]) - dot(axis, run[c].moment);
                    run[c].moment = moment.scale_add(innovation, run[c].moment);
                    run[c].force = force.scale_add(innovation, run[c].force);
                    innovation.store(&mut kept[c * W::COUNT..]);
                }
                if body.parent == GROUND {
                    break;
                }
                for c in 0..C {
                    run[c].moment = d.cross_add(run[c].force, run[c].moment);
                }
                if !body.follows_parent(k)
                    || all[k - 1].children > 1
                    || !matches!(all[k - 1].hinge, Hinge::Revolute)
                {
                    break;
                }
                k -= 1;
            }
            z = run;
            wait::<T, W, C>(all, &all[k], &z, columns);
            continue;
        }
        if body.floats() {
            let (axes, gains) = (bodies.at(first).axes(), base_gains(&mut gains, first));
            for c in 0..C {
                let mut difference = along_axes(&axes, &-z[c]);
                let mut measured = b.all(first, first + 6, column);
                each_axis!(|I| {
                    let Some(measured) = measured.next() else { return };
                    difference[I] += W::load(&measured[c * W::COUNT..]);
                });
                let all = floating_base::innovations(&gains, difference);
                each_axis!(|I| {
                    let kept = &mut columns.innovations[((first + I) * SIDE * T::COLUMNS)..];
                    all[I].store(&mut kept[c * W::COUNT..]);
                });
            }
            continue;
        }
        for place in first..inner {
            let kept = &mut columns.innovations[place * SIDE * T::COLUMNS..][..SIDE * T::COLUMNS];
            let measured = b.one::<W, C>(place, column);
            with_axis!(bodies, gains, passages, place, |axis, gain, LINEAR| {
                let (moment, force) = (vector::<T, W>(gain.moment), vector::<T, W>(gain.force));
                for c in 0..C {
                    let measured = W::load(&measured[c * W::COUNT..]);
                    let innovation = measured - along::<T, W>(&axis, LINEAR, &z[c]);
                    z[c].moment = moment.scale_add(innovation, z[c].moment);
                    z[c].force = force.scale_add(innovation, z[c].force);
                    innovation.store(&mut kept[c * W::COUNT..]);
                }
            });
        }
        if body.parent == GROUND {
            continue;
        }
        let d = vector::<T, W>(bodies.at(first).vector(OFFSET));
        for z in &mut z {
            z.moment = d.cross_add(z.force, z.moment);
        }
        wait::<T, W, C>(all, body, &z, columns);
    }
}

/// Keeps z for a parent of several bodies.
#[inline(always)]
fn wait<T: Scalar, W: Wide<T>, const C: usize>(
    bodies: &[LayoutBody<T::Constant>],
    body: &LayoutBody<T::Constant>,
    z: &[Wrench<W>; C],
    columns: &mut ColumnSweeps<T>,
) {
    if body.parent == GROUND || bodies[body.parent].children < 2 {
        return;
    }
    let size = 6 * SIDE * T::COLUMNS;
    let kept = &mut columns.branches[columns.branch[body.parent] * size..][..size];
    let mut sum = load::<T, W, C>(kept);
    for (sum, z) in sum.iter_mut().zip(z) {
        let z = wrench(*sum) + *z;
        *sum = numbers(z.moment, z.force);
    }
    store::<T, W, C>(sum, kept);
}

/// −x of what [`inward`] has left.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn outward<T: Scalar, W: Wide<T>, const N: usize, const C: usize>(
    layout: &Layout<T::Constant>,
    places: &Places,
    bodies: &mut View<'_, T, N>,
    gains: &mut Table<T, GAINS>,
    (inverse, passages): (&[T], &Passages),
    columns: &mut ColumnSweeps<T>,
    out: &mut PairView<'_, T>,
    column: usize,
) {
    let size = 6 * SIDE * T::COLUMNS;
    let mut gains = gains.view();
    let mut lambda = [Motion::<W>::zero(); C];
    let all = layout.bodies();
    let mut k = 0;
    while k < all.len() {
        let body = &all[k];
        let (first, inner) = (places.first[k], places.first[k] + body.hinge.nv());
        if body.parent == GROUND {
            lambda = [Motion::zero(); C];
        } else if !body.follows_parent(k) {
            let kept = &columns.branches[columns.branch[body.parent] * size..][..size];
            for (lambda, [a, b, c, d, e, f]) in lambda.iter_mut().zip(load::<T, W, C>(kept)) {
                *lambda = Motion::new(Vec3([a, b, c]), Vec3([d, e, f]));
            }
        }
        if let Hinge::Revolute = body.hinge {
            // Along a run of hinges λ stays in registers.
            let mut run = lambda;
            loop {
                let (body, place) = (&all[k], places.first[k]);
                let here = bodies.lane(Table::<T, N>::start(place));
                let gain = gains.at(place).wrench::<T>(GAIN);
                let (moment, force) = (vector::<T, W>(gain.moment), vector::<T, W>(gain.force));
                let (angular, pivot) = (vector::<T, W>(-here.vector(AXIS)), W::broadcast(inverse[place]));
                let kept = &columns.innovations[place * SIDE * T::COLUMNS..][..C * W::COUNT];
                if body.parent != GROUND {
                    let d = vector::<T, W>(here.vector(OFFSET));
                    for c in 0..C {
                        run[c].linear = run[c].angular.cross_add(d, run[c].linear);
                    }
                }
                let out = out.one::<W, C>(place, column);
                for c in 0..C {
                    let innovation = W::load(&kept[c * W::COUNT..]);
                    let seen = moment.dot(run[c].angular) + force.dot(run[c].linear);
                    let x = innovation.fma(pivot, seen);
                    run[c].angular = angular.scale_add(x, run[c].angular);
                    (-x).store(&mut out[c * W::COUNT..]);
                }
                let Some(next) = all.get(k + 1) else { break };
                if body.children > 1 || !next.follows_parent(k + 1) || !matches!(next.hinge, Hinge::Revolute)
                {
                    break;
                }
                k += 1;
            }
            lambda = run;
            leave::<T, W, C>(k, &all[k], &lambda, columns);
            k += 1;
            continue;
        }
        if body.parent != GROUND {
            let d = vector::<T, W>(bodies.at(first).vector(OFFSET));
            for lambda in &mut lambda {
                lambda.linear = lambda.angular.cross_add(d, lambda.linear);
            }
        }
        if body.floats() {
            let (axes, gains) = (bodies.at(first).axes(), base_gains(&mut gains, first));
            for c in 0..C {
                let mut x = [W::zero(); 6];
                each_axis!(|I| {
                    let kept = &columns.innovations[((first + I) * SIDE * T::COLUMNS)..];
                    x[I] = W::load(&kept[c * W::COUNT..]) * W::broadcast(inverse[first + I]);
                });
                let mut x = floating_base::accelerations(&gains, x);
                each_axis!(|I| x[I] = -x[I]);
                let mut rows = out.all(first, first + 6, column);
                each_axis!(|I| {
                    let Some(out) = rows.next() else { return };
                    x[I].store(&mut out[c * W::COUNT..]);
                });
                lambda[c] = floating_base::motion(&axes, x);
            }
        }
        for place in (first..inner).rev().take_while(|_| !body.floats()) {
            let pivot = W::broadcast(inverse[place]);
            let kept = &columns.innovations[place * SIDE * T::COLUMNS..][..SIDE * T::COLUMNS];
            with_axis!(bodies, gains, passages, place, |axis, gain, LINEAR| {
                let (moment, force) = (vector::<T, W>(gain.moment), vector::<T, W>(gain.force));
                let (angular, along) = (vector::<T, W>(-axis.angular), vector::<T, W>(-axis.linear));
                let mut x = [W::zero(); C];
                for c in 0..C {
                    let innovation = W::load(&kept[c * W::COUNT..]);
                    let seen = moment.dot(lambda[c].angular) + force.dot(lambda[c].linear);
                    x[c] = innovation.fma(pivot, seen);
                    lambda[c].angular = angular.scale_add(x[c], lambda[c].angular);
                    if LINEAR {
                        lambda[c].linear = along.scale_add(x[c], lambda[c].linear);
                    }
                }
                let out = out.one::<W, C>(place, column);
                for c in 0..C {
                    (-x[c]).store(&mut out[c * W::COUNT..]);
                }
            });
        }
        leave::<T, W, C>(k, body, &lambda, columns);
        k += 1;
    }
}

/// Leaves λ for several children.
#[inline(always)]
fn leave<T: Scalar, W: Wide<T>, const C: usize>(
    k: usize,
    body: &LayoutBody<T::Constant>,
    lambda: &[Motion<W>; C],
    columns: &mut ColumnSweeps<T>,
) {
    if body.children < 2 {
        return;
    }
    let size = 6 * SIDE * T::COLUMNS;
    let kept = &mut columns.branches[columns.branch[k] * size..][..size];
    let mut all = [[W::zero(); 6]; C];
    for (all, x) in all.iter_mut().zip(lambda) {
        *all = numbers(x.angular, x.linear);
    }
    store::<T, W, C>(all, kept);
}

#[cfg(test)]
impl<T: Scalar> Innovations<T> {
    /// By sweeps or by products, whichever takes less time.
    pub(crate) fn choose(&mut self, layout: &Layout<T::Constant>, places: &Places, sweeps: bool) {
        self.columns = sweeps.then(|| ColumnSweeps::always(layout, places));
        self.products = super::Products::new(places, !sweeps, true, self.products.known);
    }
}
