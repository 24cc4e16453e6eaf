use super::*;
use crate::Dd;
use crate::six_lanes::rigid_entries;
use crate::wide::WIDEST;

/// Arguments near and between multiples of π/2, small, large, and beyond the own reduction.
fn arguments() -> Vec<f64> {
    let mut all = vec![0.0, -0.0, 1e-300, 5e-324, 1e-9, 0.5, 1.0, 1e8, 0.999e9, 1.001e9, 1e15, 1e300];
    for k in -4000i32..4000 {
        let x = f64::from(k) * std::f64::consts::FRAC_PI_2;
        all.extend([x, x + 1e-9, x * (1.0 + f64::EPSILON), f64::from(k) * 0.001_237]);
    }
    // The f64 nearest to a multiple of π/2 below 1e9, and a few large ones.
    all.extend((0..2000).map(|k| 4.9e5 * f64::from(k) + 0.123));
    let negative: Vec<f64> = all.iter().map(|x| -x).collect();
    all.extend(negative);
    all
}

/// A kernel of few operations, which needs no help to inline.
struct Small<F>(F);
impl<R, F: FnOnce() -> R> Kernel for Small<F> {
    type Output = R;
    #[inline(always)]
    fn run(self) -> R {
        (self.0)()
    }
}

struct SinCos(Vec<f64>);
impl Visitor for SinCos {
    type Output = Vec<(f64, f64)>;
    fn visit<T: Lanes>(self) -> Self::Output {
        let mut out = Vec::new();
        for pack in self.0.chunks(T::LANES) {
            let x = T::from_lanes(|i| pack[i.min(pack.len() - 1)]);
            let (s, c) = T::dispatch(Small(|| x.sin_cos()));
            out.extend((0..pack.len()).map(|i| (s.lane(i), c.lane(i))));
        }
        out
    }
}

/// Within 0.6 units in the last place of double-double values, where those reach.
#[test]
fn sines_are_right_to_the_last_place() {
    let x = arguments();
    let found = at_level(Level::Scalar, SinCos(x.clone())).unwrap();
    let mut worst = 0.0f64;
    for (x, (s, c)) in x.iter().zip(found).filter(|(x, _)| x.abs() < 1e9) {
        let (ws, wc) = Dd::from_f64(*x).sin_cos();
        for (want, got) in [(ws, s), (wc, c)] {
            let place = (want.hi.abs() * f64::EPSILON).max(5e-324);
            let error = (want - Dd::from_f64(got)).hi.abs() / place;
            assert!(error < 0.6, "{x:e}: {got:e} for {:e}, {error} places", want.hi);
            worst = worst.max(error);
        }
    }
    println!("largest error {worst:.3} places");
}

/// Every lane of every level does the operations of the plain number, to the last bit.
#[test]
fn lanes_are_the_scalar_to_the_last_bit() {
    let mut x = arguments();
    x.extend([f64::NAN, f64::INFINITY, -f64::INFINITY, 1.5, f64::NAN, 2.5, 1e10, 3.5]);
    let scalar = at_level(Level::Scalar, SinCos(x.clone())).unwrap();
    for level in Level::ALL {
        let Some(found) = at_level(level, SinCos(x.clone())) else {
            println!("this processor has no {}", level.name());
            continue;
        };
        for ((x, a), b) in x.iter().zip(&scalar).zip(&found) {
            let bits = |(s, c): &(f64, f64)| [s, c].map(|x| if x.is_nan() { 0 } else { x.to_bits() });
            assert_eq!(bits(a), bits(b), "{}: {x:e}", level.name());
        }
    }
}

struct Operations(Vec<f64>);
impl Visitor for Operations {
    type Output = Vec<u64>;
    fn visit<T: Lanes>(self) -> Vec<u64> {
        let mut out = Vec::new();
        for pack in self.0.chunks_exact(8) {
            for half in pack.chunks(T::LANES) {
                let at = |shift: usize| T::from_lanes(|i| half[i % half.len()] + shift as f64 * 0.37);
                let (a, b, c) = (at(0), at(1), at(2));
                let results = T::dispatch(Small(|| {
                    let (mut d, mut e, mut f, mut g) = (a, a, a, a);
                    d += b;
                    e -= b;
                    f *= b;
                    g /= b;
                    [a + b, a - b, a * b, a / b, -a, a.fma(b, c), c.recip(), c.sqrt(), d, e, f, g]
                }));
                assert_eq!(c.is_positive(), (0..T::LANES).all(|i| c.lane(i) > 0.0 && c.lane(i).is_finite()));
                for i in 0..T::LANES {
                    out.extend(results.iter().map(|r| r.lane(i)).map(f64::to_bits));
                }
            }
        }
        out
    }
}

#[test]
fn operators_agree_on_all_levels() {
    let x: Vec<f64> = (0..64).map(|k| 0.31 * f64::from(k) + 0.01).collect();
    let scalar = at_level(Level::Scalar, Operations(x.clone())).unwrap();
    for level in Level::ALL {
        if let Some(found) = at_level(level, Operations(x.clone())) {
            assert_eq!(scalar, found, "{}", level.name());
        }
    }
}

#[test]
fn a_pivot_is_positive_in_every_lane_or_not_at_all() {
    struct Positive;
    impl Visitor for Positive {
        type Output = ();
        fn visit<T: Lanes>(self) {
            for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
                for at in 0..T::LANES {
                    let x = T::from_lanes(|i| if i == at { bad } else { 1.0 });
                    assert!(!x.is_positive());
                }
            }
            assert!(T::splat(2.0).is_positive());
        }
    }
    for level in Level::ALL {
        at_level(level, Positive);
    }
}

/// Every operation of a register of neighbouring numbers against the same on an array.
struct SideBySide;

impl WideKernel<Fused> for SideBySide {
    type Output = ();
    #[inline(always)]
    fn run<W: Wide<Fused>>(self) {
        let n = W::COUNT;
        let numbers: Vec<Fused> = (0..80).map(|i| Fused(1.0 + i as f64)).collect();
        let read = |x: W| {
            let mut out = vec![Fused(-1.0); n];
            x.store(&mut out);
            out
        };
        for count in 0..=n + 1 {
            let mut want = vec![Fused(0.0); n];
            want.iter_mut().zip(&numbers[3..3 + count]).for_each(|(w, x)| *w = *x);
            assert_eq!(read(W::load_first(&numbers[3..3 + count])), want, "{count} of {n}");
            let mut out = vec![Fused(-1.0); n + 2];
            W::load(&numbers).store_first(&mut out[..count]);
            for (i, x) in out.iter().enumerate() {
                assert_eq!(*x, if i < count.min(n) { numbers[i] } else { Fused(-1.0) }, "{count} of {n}");
            }
        }
        for place in 0..n {
            let mut want = numbers[..n].to_vec();
            want[place] = Fused(0.5);
            assert_eq!(read(W::load(&numbers).with(place, Fused(0.5))), want);
            let both = W::load(&numbers).up_to(place, W::load(&numbers[1..]));
            assert_eq!(read(both), [&numbers[..place], &numbers[1 + place..=n]].concat(), "up to {place}");
            for to in place..=n {
                let inside = |i: usize| place <= i && i < to;
                let want: Vec<Fused> =
                    (0..n).map(|i| if inside(i) { numbers[i] } else { Fused(0.0) }).collect();
                assert_eq!(read(W::load(&numbers).between(place, to)), want, "{place} to {to}");
                let mut out = vec![Fused(-1.0); n + 1];
                W::load(&numbers).store_between(place, to, &mut out);
                for (i, x) in out.iter().enumerate() {
                    assert_eq!(
                        *x,
                        if inside(i) { numbers[i] } else { Fused(-1.0) },
                        "{place} to {to} of {n}"
                    );
                }
            }
            let mut out = vec![Fused(-1.0); n + 1];
            W::load(&numbers).store_from(place, &mut out);
            assert_eq!(out[..n - place], numbers[place..n]);
            assert!(out[n - place..].iter().all(|x| *x == Fused(-1.0)));
        }
        assert_eq!(read(W::broadcast(Fused(2.5))), vec![Fused(2.5); n]);
        let mut tile = [W::zero(); WIDEST];
        (0..n).for_each(|i| tile[i] = W::load(&numbers[i * n..]));
        W::transpose(&mut tile);
        for i in 0..n {
            let want: Vec<Fused> = (0..n).map(|j| numbers[j * n + i]).collect();
            assert_eq!(read(tile[i]), want);
        }
        // Rows of a matrix whose last one ends the slice: read, and written to a slice that is exactly as long.
        for stride in n..=9 {
            let length = (n - 1) * stride + n;
            let tile = W::load_rows(stride, &numbers[..length]);
            let mut out = vec![Fused(-1.0); length];
            W::store_rows(&tile, stride, &mut out);
            for (i, x) in out.iter().enumerate() {
                let want = if i % stride < n { numbers[i] } else { Fused(-1.0) };
                assert_eq!(*x, want, "number {i} of rows {stride} apart, {n} of each");
            }
            let refused = |step: &mut dyn FnMut()| {
                std::panic::catch_unwind(std::panic::AssertUnwindSafe(step)).is_err()
            };
            assert!(refused(&mut || _ = W::load_rows(stride, &numbers[..length - 1])));
            assert!(refused(&mut || W::store_rows(&tile, stride, &mut out[..length - 1])));
        }
    }
}

#[test]
fn numbers_side_by_side_at_every_level() {
    Fused::dispatch_wide(SideBySide);
    Fused::dispatch(With::<Fused, Fused, _>::new(SideBySide));
    #[cfg(target_arch = "x86_64")]
    {
        if Level::Avx2.is_available() {
            super::x86::F64x4::dispatch(With::<Fused, super::x86::F64x4, _>::new(SideBySide));
        }
        if Level::Avx512.is_available() {
            super::x86::F64x8::dispatch(With::<Fused, super::x86::F64x8, _>::new(SideBySide));
        }
    }
}

/// Rows of every size up to three tiles, to lanes and back to as many rows as there are states.
#[test]
fn rows_go_to_lanes_and_back() {
    struct Rows;
    impl Visitor for Rows {
        type Output = ();
        fn visit<T: Lanes>(self) {
            for size in 0..13usize {
                let numbers: Vec<f64> = (0..T::LANES * size).map(|k| k as f64 + 0.5).collect();
                let rows: Vec<&[f64]> =
                    (0..T::LANES).map(|lane| &numbers[lane * size..(lane + 1) * size]).collect();
                let mut packed = vec![T::splat(-1.0); size];
                T::dispatch(Small(|| T::pack(&rows, &mut packed)));
                for (i, x) in packed.iter().enumerate() {
                    (0..T::LANES).for_each(|lane| assert_eq!(x.lane(lane), rows[lane][i]));
                }
                for states in 0..=T::LANES {
                    // One number more than the rows have: it is left alone.
                    let mut out = vec![-1.0; states * size + 1];
                    T::dispatch(Small(|| T::unpack(&packed, &mut out[..states * size])));
                    assert_eq!(
                        out[..states * size],
                        numbers[..states * size],
                        "{size} numbers, {states} states"
                    );
                    assert_eq!(out[states * size], -1.0);
                }
            }
        }
    }
    for level in Level::ALL {
        at_level(level, Rows);
    }
}

/// Functions of [`Ordered`] on positive numbers: lane after lane (1/√x, eˣ of −x and of x below 700, ln x).
struct Functions(Vec<f64>);
impl Visitor for Functions {
    type Output = Vec<[f64; 4]>;
    fn visit<T: Lanes>(self) -> Self::Output {
        let mut out = Vec::new();
        for pack in self.0.chunks(T::LANES) {
            let x = T::from_lanes(|i| pack[i.min(pack.len() - 1)]);
            let up = T::from_lanes(|i| pack[i.min(pack.len() - 1)].min(700.0));
            let found = T::dispatch(Small(|| [x.reciprocal_root(), (-x).exp(), up.exp(), x.ln()]));
            out.extend((0..pack.len()).map(|i| found.map(|f| f.lane(i))));
        }
        out
    }
}

/// Against the standard library, whose own error is below one place.
#[test]
fn roots_exponentials_and_logarithms() {
    let mut x: Vec<f64> = (-1022..1023).map(|k| 2f64.powi(k)).collect();
    x.extend((0..4000).flat_map(|k| {
        let step = f64::from(k) * 0.001_237;
        [1.0 + 1e-4 * step, 1.0 - 1e-4 * step, 0.5 + step, step.exp(), 150.0 * step + 1e-9]
    }));
    let mut worst = [0f64; 4];
    let found = at_level(Level::Scalar, Functions(x.clone())).unwrap();
    for (x, found) in x.iter().zip(&found) {
        let want = [1.0 / x.sqrt(), (-x.min(708.0)).exp(), x.min(700.0).exp(), x.ln()];
        for (k, (want, found)) in want.iter().zip(found).enumerate() {
            // Next to 1 the logarithm is compared with the distance from it.
            let places = (found - want).abs() / (f64::EPSILON * want.abs().max(f64::MIN_POSITIVE));
            worst[k] = worst[k].max(places);
            assert!(places <= 3.0, "function {k} of {x:e}: {found:e} for {want:e}");
        }
    }
    println!("largest differences, places: {worst:?}");
    for level in Level::ALL {
        if let Some(other) = at_level(level, Functions(x.clone())) {
            let bits = |all: &[[f64; 4]]| all.iter().map(|x| x.map(f64::to_bits)).collect::<Vec<_>>();
            assert_eq!(bits(&found), bits(&other), "{}", level.name());
        }
    }
    let coincident = at_level(Level::Scalar, Functions(vec![0.0])).unwrap()[0][0];
    assert!(coincident > 1e154 && coincident * coincident == f64::INFINITY);
}

#[test]
fn lanes_are_compared_and_chosen() {
    struct Choice;
    impl Visitor for Choice {
        type Output = ();
        fn visit<T: Lanes>(self) {
            let (a, b) = (T::from_lanes(|i| i as f64 - 2.0), T::splat(1.0));
            let [size, larger, below] = T::dispatch(Small(|| [a.abs(), a.larger(b), a.below(b, a, b)]));
            for bits in 0..1u32 << T::LANES {
                let chosen = T::dispatch(Small(|| a.choose(bits, b)));
                for i in 0..T::LANES {
                    assert_eq!(chosen.lane(i), if bits >> i & 1 == 1 { a.lane(i) } else { 1.0 });
                }
            }
            for i in 0..T::LANES {
                let x = a.lane(i);
                assert_eq!([size.lane(i), larger.lane(i), below.lane(i)], [x.abs(), x.max(1.0), x.min(1.0)]);
            }
            let nan = T::dispatch(Small(|| T::splat(f64::NAN).exp()));
            assert!((0..T::LANES).all(|i| nan.lane(i).is_nan()));
        }
    }
    for level in Level::ALL {
        at_level(level, Choice);
    }
}

#[cfg(target_arch = "x86_64")]
struct Packed<S>([f64; 16], core::marker::PhantomData<S>);
#[cfg(target_arch = "x86_64")]
impl<S: crate::SixLanes<Fused>> Kernel for Packed<S> {
    type Output = Vec<[Fused; 8]>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let m = self.0.map(Fused);
        let [x, y, z] = [m[0], m[5], m[9]];
        let a = S::of([m[0], m[1], m[2], Fused(0.0), m[3], m[4], m[5], Fused(0.0)]);
        let b = S::of([m[6], m[7], m[8], Fused(0.0), m[9], m[10], m[11], Fused(0.0)]);
        let (c, s) = S::about_z(x, y);
        let (d, t) = S::about_x(z, x);
        let whole = [
            a + b,
            a - b,
            a * b,
            -a,
            a.times_plus(b, c),
            a.subtract_from(b, s),
            a.eliminate::<2>(b, d),
            a.eliminate::<6>(b, t),
            S::fill(x),
            S::zeros(),
            S::halves(x, y, z),
            S::first_half(x, y, z),
            a.swap_xy(),
            a.swap_yz(),
            a.yzx(),
            a.zxy(),
            a.levered(S::first_half(y, z, x), S::first_half(z, x, y)),
            a.broadcast::<0>(),
            a.broadcast::<1>(),
            a.broadcast::<2>(),
            a.broadcast::<4>(),
            a.broadcast::<5>(),
            a.broadcast::<6>(),
            S::fill(a.lane_0()),
            S::fill(x).reciprocal(),
            a.with_lane_2(b),
        ];
        let [mass, hx, hy, hz, xx, xy, xz, yy, yz, zz] = *self.0.first_chunk().expect("16 numbers");
        let M = crate::RigidInertia {
            mass,
            first_moment: crate::Vec3([hx, hy, hz]),
            inertia: crate::Sym3 { xx, xy, xz, yy, yz, zz },
        };
        let entries = rigid_entries(&M);
        let columns = [S::rigid(&entries), S::rigid_columns(&entries.map(Fused))];
        whole.into_iter().chain(columns.into_iter().flatten()).map(S::to_array).collect()
    }
}

/// Six-vectors in registers are eight numbers, to the last bit.
#[cfg(target_arch = "x86_64")]
#[test]
fn packed_six_vectors_are_eight_numbers_to_the_last_bit() {
    if Level::best() < Level::Avx2 {
        println!("this processor has no {}", Level::Avx2.name());
        return;
    }
    let m: [f64; 16] = core::array::from_fn(|i| (1.3 * i as f64 + 0.7).sin() + 0.2);
    let by = core::marker::PhantomData;
    let numbers = Fused::dispatch(Packed::<crate::six_lanes::Eight<Fused>>(m, by));
    let found = Fused::dispatch(Packed::<x86::Halves>(m, core::marker::PhantomData));
    assert_eq!(found.len(), numbers.len());
    for (i, (a, b)) in numbers.iter().zip(&found).enumerate() {
        for lane in [0, 1, 2, 4, 5, 6] {
            // −0 and 0 are the same number: products with zeros of a pattern may have either sign.
            assert_eq!(a[lane].0, b[lane].0, "operation {i}, lane {lane}");
        }
    }
}
