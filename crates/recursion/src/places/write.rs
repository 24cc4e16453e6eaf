//! Matrices by places, written to the model's order.

use super::Places;
use phipsi_spatial::Scalar;
use phipsi_spatial::wide::Wide;

impl Places {
    /// Writes a whole matrix, to the model's order.
    #[inline(always)]
    pub(crate) fn write_all<T: Scalar, W: Wide<T>>(&self, matrix: &[T], out: &mut [T]) {
        self.write_rows::<T, W>(&matrix[self.margin * self.stride + self.margin..], self.stride, out);
    }
    /// Writes a matrix, to the model's order, whose rows begin at multiples of `stride`, of the first place first.
    #[inline(always)]
    pub(crate) fn write_rows<T: Scalar, W: Wide<T>>(&self, matrix: &[T], stride: usize, out: &mut [T]) {
        let (nv, dofs) = (self.count - self.margin, &self.dof[self.margin..]);
        if self.in_order {
            match nv.div_ceil(W::COUNT) {
                1 if W::COUNT > 1 => copy_rows::<T, W, 1>(matrix, stride, nv, out),
                2 if W::COUNT > 1 => copy_rows::<T, W, 2>(matrix, stride, nv, out),
                3 if W::COUNT > 1 => copy_rows::<T, W, 3>(matrix, stride, nv, out),
                4 if W::COUNT > 1 => copy_rows::<T, W, 4>(matrix, stride, nv, out),
                _ => copy_last_rows::<T, W>(matrix, stride, nv, out),
            }
            return;
        }
        for (i, &dof) in dofs.iter().enumerate() {
            let (row, out) = (&matrix[i * stride..][..nv], &mut out[dof * nv..][..nv]);
            for (&x, &dof) in row.iter().zip(dofs) {
                out[dof] = x;
            }
        }
    }
}

/// Rows of `nv` numbers, one after the other, by `G` whole registers, whose last numbers the next row overwrites.
#[inline(always)]
fn copy_rows<T: Scalar, W: Wide<T>, const G: usize>(from: &[T], stride: usize, nv: usize, out: &mut [T]) {
    let (mut from, mut out) = (from, out);
    let whole = G * W::COUNT;
    while let (Some(row), Some(to)) = (from.get(..whole), out.get_mut(..whole)) {
        for g in 0..G {
            W::load(&row[g * W::COUNT..]).store(&mut to[g * W::COUNT..]);
        }
        let (Some(rest), Some((_, next))) = (from.get(stride..), out.split_at_mut_checked(nv)) else {
            return;
        };
        (from, out) = (rest, next);
    }
    copy_last_rows::<T, W>(from, stride, nv, out);
}

/// Rows of `nv` numbers, one after the other, as far as there are any, each by as many numbers as it has.
#[inline(always)]
fn copy_last_rows<T: Scalar, W: Wide<T>>(from: &[T], stride: usize, nv: usize, out: &mut [T]) {
    let (mut from, mut out) = (from, out);
    while let (Some(row), Some((to, next))) = (from.get(..nv), out.split_at_mut_checked(nv.max(1))) {
        if W::COUNT == 1 {
            to.copy_from_slice(row);
        } else {
            let (groups, whole) = (row.chunks_exact(W::COUNT), to.len() - to.len() % W::COUNT);
            let (registers, rest) = to.split_at_mut(whole);
            W::load_first(groups.remainder()).store_first(rest);
            for (row, to) in groups.zip(registers.chunks_exact_mut(W::COUNT)) {
                W::load(row).store(to);
            }
        }
        let Some(rest) = from.get(stride..) else { return };
        (from, out) = (rest, next);
    }
}
