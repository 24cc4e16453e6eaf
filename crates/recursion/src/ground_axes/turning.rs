//! Axes, offsets and hinge axes of all bodies, base to tip. Where registers have four numbers, a vector lies in one: an axis takes as
//! many steps as one of its numbers, and the vectors of four bodies are turned over into rows afterwards.

use super::{AXES, AXIS, Directions, OFFSET, ground, set_axes, set_body};
use crate::hinge::Hinge;
use crate::layout::{GROUND, Layout, Shifts};
use crate::link::Direction;
use crate::places::{Aligned, Places, View, each_place};
use core::marker::PhantomData;
use core::ops::Neg;
use phipsi_spatial::wide::{WIDEST, Wide};
use phipsi_spatial::{Scalar, Vec3};

/// Numbers of a register that holds a vector, and of a body: its axes and its offset.
const QUAD: usize = 4;
const NUMBERS: usize = 4 * QUAD;

/// What is kept of the bodies between the two steps.
#[derive(Clone, Debug)]
pub(crate) struct Turning<T> {
    /// Axes and offsets, by places.
    vectors: Aligned<T>,
    /// Bodies on other joints than hinges; floating bases have no columns here.
    others: Vec<usize>,
}

/// A vector in the first three places of a register.
#[derive(Clone, Copy)]
struct Quad<T, W>(W, PhantomData<T>);

impl<T: Scalar, W: Wide<T>> Quad<T, W> {
    #[inline(always)]
    fn load(x: &[T]) -> Self {
        Quad(W::load(x), PhantomData)
    }
    #[inline(always)]
    fn store(self, x: &mut [T]) {
        self.0.store(&mut x[..QUAD]);
    }
}

impl<T: Scalar, W: Wide<T>> Neg for Quad<T, W> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Quad(-self.0, PhantomData)
    }
}

impl<T: Scalar, W: Wide<T>> Direction<T> for Quad<T, W> {
    #[inline(always)]
    fn scale(self, x: T) -> Self {
        Quad(self.0 * W::broadcast(x), PhantomData)
    }
    #[inline(always)]
    fn scale_add(self, x: T, other: Self) -> Self {
        Quad(self.0.fma(W::broadcast(x), other.0), PhantomData)
    }
}

impl<T: Scalar> Turning<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>, places: &Places) -> Self {
        let count = if T::COLUMNS > 1 { NUMBERS * places.count } else { 0 };
        let others = layout.bodies().iter().enumerate();
        let others = others.filter(|(_, body)| !matches!(body.hinge, Hinge::Revolute) && !body.floats());
        Turning { vectors: Aligned::new(count), others: others.map(|(k, _)| k).collect() }
    }
    /// Axes, offsets and columns of H* in the table.
    #[inline(always)]
    pub(crate) fn outboard<W: Wide<T>, const N: usize>(
        &mut self,
        layout: &Layout<T::Constant>,
        shifts: &Shifts<T>,
        places: &Places,
        view: &mut View<'_, T, N>,
    ) {
        if W::COUNT != QUAD {
            return number_by_number(layout, shifts, places, view);
        }
        let vectors: &mut [T] = &mut self.vectors;
        turn::<T, W>(layout, shifts, places, vectors);
        for &at in places.with_bodies(QUAD) {
            let four = &vectors[at * NUMBERS..][..QUAD * NUMBERS];
            let mut group = view.at(at);
            for (part, row) in [AXES, AXES + 3, AXES + 6, OFFSET].into_iter().enumerate() {
                let mut tile = [W::zero(); WIDEST];
                each_place!(W, I => if I < QUAD {
                    tile[I] = W::load(&four[I * NUMBERS + part * QUAD..][..QUAD]);
                });
                W::transpose(&mut tile);
                let vectors = Vec3([tile[0], tile[1], tile[2]]);
                group.set_vector(row, vectors);
                if row == AXES + 6 {
                    group.set_vector(AXIS, vectors);
                }
            }
        }
        for &k in &self.others {
            set_axes(view, places.first[k], &layout.bodies()[k]);
        }
    }
}

/// Axes and offsets of all bodies, in registers of four numbers.
#[inline(always)]
fn turn<T: Scalar, W: Wide<T>>(
    layout: &Layout<T::Constant>,
    shifts: &Shifts<T>,
    places: &Places,
    vectors: &mut [T],
) {
    let (bodies, first) = (layout.bodies(), &places.first[..layout.len()]);
    let mut k = 0;
    // Along a run of first children axes stay in registers.
    while k < bodies.len() {
        let mut axes = match bodies[k].parent {
            GROUND => in_registers(ground()),
            parent => three(&vectors[first[parent] * NUMBERS..]),
        };
        loop {
            let (body, here) = (&bodies[k], &mut vectors[first[k] * NUMBERS..][..NUMBERS]);
            let passage = shifts.at(k, body);
            let offset: Quad<T, W>;
            if passage.general.is_none() {
                (axes, offset) = body.link.axes_to_child(passage.shift, axes);
            } else {
                let mut numbers = [T::zero(); NUMBERS];
                put(&axes, &mut numbers);
                let [x, y, z, ..] = numbers.as_chunks::<QUAD>().0 else { return };
                let inboard = [Vec3([x[0], x[1], x[2]]), Vec3([y[0], y[1], y[2]]), Vec3([z[0], z[1], z[2]])];
                let (turned, d) = passage.axes_to_child(inboard);
                axes = in_registers(turned);
                offset = in_register(d);
            }
            put(&axes, here);
            offset.store(&mut here[3 * QUAD..]);
            k += 1;
            if k == bodies.len() || !bodies[k].follows_parent(k) {
                break;
            }
        }
    }
}

#[inline(always)]
fn in_register<T: Scalar, W: Wide<T>>(x: Vec3<T>) -> Quad<T, W> {
    let [x, y, z] = x.0;
    let numbers = [x, y, z, T::zero()];
    Quad(W::load_first(&numbers), PhantomData)
}

#[inline(always)]
fn in_registers<T: Scalar, W: Wide<T>>([x, y, z]: Directions<T>) -> [Quad<T, W>; 3] {
    [in_register(x), in_register(y), in_register(z)]
}

#[inline(always)]
fn three<T: Scalar, W: Wide<T>>(x: &[T]) -> [Quad<T, W>; 3] {
    [Quad::load(&x[..QUAD]), Quad::load(&x[QUAD..2 * QUAD]), Quad::load(&x[2 * QUAD..3 * QUAD])]
}

#[inline(always)]
fn put<T: Scalar, W: Wide<T>>(axes: &[Quad<T, W>; 3], x: &mut [T]) {
    axes[0].store(&mut x[..QUAD]);
    axes[1].store(&mut x[QUAD..2 * QUAD]);
    axes[2].store(&mut x[2 * QUAD..3 * QUAD]);
}

/// The same of scalars without such registers.
#[inline(always)]
fn number_by_number<T: Scalar, const N: usize>(
    layout: &Layout<T::Constant>,
    shifts: &Shifts<T>,
    places: &Places,
    view: &mut View<'_, T, N>,
) {
    let (bodies, first) = (layout.bodies(), &places.first[..layout.len()]);
    let mut k = 0;
    while k < bodies.len() {
        let mut axes: Directions<T> = match bodies[k].parent {
            GROUND => ground(),
            parent => view.at(first[parent]).axes(),
        };
        loop {
            let (body, at) = (&bodies[k], first[k]);
            let offset;
            (axes, offset) = shifts.at(k, body).axes_to_child(axes);
            set_body(view, at, body, &axes, offset);
            k += 1;
            if k == bodies.len() || !bodies[k].follows_parent(k) {
                break;
            }
        }
    }
}
