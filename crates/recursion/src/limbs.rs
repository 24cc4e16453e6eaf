//! Numbers of limbs that are alike into lanes and back ([`crate::layout::LimbPlan`]).

use crate::layout::Limbs;
use phipsi_spatial::{Abreast, ArticulatedInertia, Mat3, RigidInertia, Scalar, Sym3, Vec3, Wrench};

/// P and z of an eliminated body.
pub(crate) type Moved<T> = (ArticulatedInertia<T>, Wrench<T>);

// Functions, for closures may not be inlined.

/// Numbers of four places.
#[inline(always)]
pub(crate) fn numbers<T: Scalar>(x: &[T], [a, b, c, d]: [usize; 4]) -> T::Abreast {
    number([x[a], x[b], x[c], x[d]])
}

#[inline(always)]
pub(crate) fn number<T: Scalar>([a, b, c, d]: [T; 4]) -> T::Abreast {
    T::Abreast::of([a.first_lane(), b.first_lane(), c.first_lane(), d.first_lane()])
}

#[inline(always)]
pub(crate) fn vector<T: Scalar>([a, b, c, d]: [Vec3<T>; 4]) -> Vec3<T::Abreast> {
    let ([a, b, c], [d, e, f], [g, h, i], [j, k, l]) = (a.0, b.0, c.0, d.0);
    Vec3([number([a, d, g, j]), number([b, e, h, k]), number([c, f, i, l])])
}

/// The number of each lane.
#[inline(always)]
pub(crate) fn lanes<T: Scalar>(x: T::Abreast) -> [T; 4] {
    let [a, b, c, d] = x.to_array();
    [T::constant(a), T::constant(b), T::constant(c), T::constant(d)]
}

/// The wrench of each lane.
#[inline(always)]
pub(crate) fn lanes_of_wrench<T: Scalar>(f: Wrench<T::Abreast>) -> [Wrench<T>; 4] {
    let [a, b, c, d, e, g] = f.to_array();
    let (a, b, c) = (lanes::<T>(a), lanes::<T>(b), lanes::<T>(c));
    let (d, e, g) = (lanes::<T>(d), lanes::<T>(e), lanes::<T>(g));
    let mut all = [Wrench::zero(); 4];
    for i in 0..4 {
        all[i] = Wrench::new(Vec3([a[i], b[i], c[i]]), Vec3([d[i], e[i], g[i]]));
    }
    all
}

/// The wrench of one lane.
#[inline(always)]
pub(crate) fn lane_of_wrench<T: Scalar>(f: Wrench<T::Abreast>, lane: usize) -> Wrench<T> {
    let ([a, b, c, d, e, g], lane) = (f.to_array(), lane & 3);
    Wrench::from_array([
        lanes(a)[lane],
        lanes(b)[lane],
        lanes(c)[lane],
        lanes(d)[lane],
        lanes(e)[lane],
        lanes(g)[lane],
    ])
}

/// What limbs give to the trunk: that of each, or in the first place the sum, where their parent is one body.
#[inline(always)]
pub(crate) fn give<T: Scalar>(
    limbs: &Limbs<T::Constant>,
    moved: &Moved<T::Abreast>,
    gifts: &mut [Moved<T>; 4],
) {
    match (limbs.together, limbs.count) {
        (true, 3) => gifts[0] = one_of_moved::<T, Total<3>>(moved),
        (true, _) => gifts[0] = one_of_moved::<T, Total<4>>(moved),
        _ => {
            gifts[0] = one_of_moved::<T, Lane<0>>(moved);
            gifts[1] = one_of_moved::<T, Lane<1>>(moved);
            gifts[2] = one_of_moved::<T, Lane<2>>(moved);
            gifts[3] = one_of_moved::<T, Lane<3>>(moved);
        }
    }
}

/// The same of rigid inertias.
#[inline(always)]
pub(crate) fn give_rigid<T: Scalar>(
    limbs: &Limbs<T::Constant>,
    moved: &RigidInertia<T::Abreast>,
    gifts: &mut [RigidInertia<T>; 4],
) {
    match (limbs.together, limbs.count) {
        (true, 3) => gifts[0] = one_of_rigid::<T, Total<3>>(moved),
        (true, _) => gifts[0] = one_of_rigid::<T, Total<4>>(moved),
        _ => {
            gifts[0] = one_of_rigid::<T, Lane<0>>(moved);
            gifts[1] = one_of_rigid::<T, Lane<1>>(moved);
            gifts[2] = one_of_rigid::<T, Lane<2>>(moved);
            gifts[3] = one_of_rigid::<T, Lane<3>>(moved);
        }
    }
}

/// How numbers become one.
trait One {
    fn of<T: Scalar>(x: T::Abreast) -> T;
}

/// One lane.
struct Lane<const I: usize>;
/// The sum over `N` lanes.
struct Total<const N: usize>;

impl<const I: usize> One for Lane<I> {
    #[inline(always)]
    fn of<T: Scalar>(x: T::Abreast) -> T {
        T::constant(x.to_array()[I])
    }
}

impl<const N: usize> One for Total<N> {
    #[inline(always)]
    fn of<T: Scalar>(x: T::Abreast) -> T {
        T::constant(x.sum::<N>())
    }
}

#[inline(always)]
fn one_of_vector<T: Scalar, O: One>([x, y, z]: [T::Abreast; 3]) -> [T; 3] {
    [O::of::<T>(x), O::of::<T>(y), O::of::<T>(z)]
}

#[inline(always)]
fn one_of_symmetric<T: Scalar, O: One>(s: &Sym3<T::Abreast>) -> Sym3<T> {
    let [xx, xy, xz] = one_of_vector::<T, O>([s.xx, s.xy, s.xz]);
    let [yy, yz, zz] = one_of_vector::<T, O>([s.yy, s.yz, s.zz]);
    Sym3 { xx, xy, xz, yy, yz, zz }
}

#[inline(always)]
fn one_of_moved<T: Scalar, O: One>((P, z): &Moved<T::Abreast>) -> Moved<T> {
    let C = P.coupling.0;
    let rows = [one_of_vector::<T, O>(C[0]), one_of_vector::<T, O>(C[1]), one_of_vector::<T, O>(C[2])];
    let (inertia, mass) = (one_of_symmetric::<T, O>(&P.inertia), one_of_symmetric::<T, O>(&P.mass));
    let (moment, force) = (one_of_vector::<T, O>(z.moment.0), one_of_vector::<T, O>(z.force.0));
    (ArticulatedInertia { inertia, coupling: Mat3(rows), mass }, Wrench::new(Vec3(moment), Vec3(force)))
}

#[inline(always)]
fn one_of_rigid<T: Scalar, O: One>(R: &RigidInertia<T::Abreast>) -> RigidInertia<T> {
    RigidInertia {
        mass: O::of::<T>(R.mass),
        first_moment: Vec3(one_of_vector::<T, O>(R.first_moment.0)),
        inertia: one_of_symmetric::<T, O>(&R.inertia),
    }
}
