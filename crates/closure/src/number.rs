//! Between the numbers of a caller and those that sweeps compute with, and comparisons of the latter, which have no order.

use phipsi_spatial::{Mat3, Motion, Real, Scalar, Transform, Vec3, Wrench};

/// What sweeps on `T` compute with: for f64 the same numbers with fused multiplications.
pub(crate) type Arithmetic<T> = <T as Scalar>::Arithmetic;

/// |x|.
#[inline(always)]
pub(crate) fn size<S: Scalar>(x: S) -> S {
    if x.min_lane() < 0.0 { -x } else { x }
}

/// The larger one.
#[inline(always)]
pub(crate) fn larger<S: Scalar>(a: S, b: S) -> S {
    if a.min_lane() > b.min_lane() { a } else { b }
}

/// A vector to compute with.
#[inline(always)]
pub(crate) fn vector<T: Real>(x: Vec3<T>) -> Vec3<Arithmetic<T>> {
    let [a, b, c] = x.0;
    Vec3([a.to_arithmetic(), b.to_arithmetic(), c.to_arithmetic()])
}

/// A pose to compute with.
#[inline(always)]
pub(crate) fn transform<T: Real>(x: &Transform<T>) -> Transform<Arithmetic<T>> {
    let [a, b, c] = x.rotation.0;
    let rotation = Mat3([vector(Vec3(a)).0, vector(Vec3(b)).0, vector(Vec3(c)).0]);
    Transform::new(rotation, vector(x.translation))
}

/// A wrench to compute with.
#[inline(always)]
pub(crate) fn wrench<T: Real>(x: Wrench<T>) -> Wrench<Arithmetic<T>> {
    Wrench::new(vector(x.moment), vector(x.force))
}

/// A motion to compute with.
#[inline(always)]
pub(crate) fn motion<T: Real>(x: Motion<T>) -> Motion<Arithmetic<T>> {
    Motion::new(vector(x.angular), vector(x.linear))
}

/// A vector that was computed.
#[inline(always)]
fn plain_vector<T: Real>(x: Vec3<Arithmetic<T>>) -> Vec3<T> {
    Vec3(x.0.map(T::from_arithmetic))
}

/// A pose that was computed.
#[inline(always)]
pub(crate) fn plain<T: Real>(x: &Transform<Arithmetic<T>>) -> Transform<T> {
    let rows = x.rotation.0.map(|row| plain_vector::<T>(Vec3(row)).0);
    Transform::new(Mat3(rows), plain_vector(x.translation))
}
