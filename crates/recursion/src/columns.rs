//! Wrenches of many degrees of freedom that move through the same joints: columns of 6×n operators, side by side.
//!
//! Degrees of freedom are in the order in which an inward sweep meets their bodies, so that those outboard of a joint are a
//! range, and the same few numbers of φ(p, k) act on the whole range: the loops vectorise, also on one state. They run in
//! groups of [`GROUP`]; what a group does beyond the end of its range is overwritten when those columns begin.

use crate::hinge::Hinge;
use crate::layout::{Layout, Passage};
use core::ops::Range;
use phipsi_spatial::{Scalar, Wrench};

/// Columns that are moved at once.
const GROUP: usize = 8;

/// Rows: moment x, y, z, force x, y, z; one entry for each degree of freedom.
#[derive(Clone, Debug)]
pub(crate) struct Columns<T> {
    rows: [Vec<T>; 6],
    /// Degree of freedom of the model of every column.
    dof: Vec<usize>,
    count: usize,
}

impl<T: Scalar> Columns<T> {
    pub(crate) fn new(layout: &Layout<T::Constant>) -> Self {
        let room = layout.nv() + GROUP;
        Columns { rows: [(); 6].map(|()| vec![T::zero(); room]), dof: vec![0; room], count: 0 }
    }
    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }
    /// Begins the column of a degree of freedom.
    #[inline(always)]
    pub(crate) fn push(&mut self, dof: usize, f: Wrench<T>) {
        let at = self.count;
        for (row, x) in self.rows.iter_mut().zip(f.to_array()) {
            row[at] = x;
        }
        self.dof[at] = dof;
        self.count += 1;
    }
    /// The columns of body `k` and all outboard of it, when its own have just been pushed.
    #[inline(always)]
    pub(crate) fn outboard(&self, layout: &Layout<T::Constant>, k: usize) -> Range<usize> {
        self.count - layout.outboard_dofs[k]..self.count
    }
    /// Component `i` of H f for a range of columns, with the degree of freedom of each.
    #[inline(always)]
    pub(crate) fn project(
        &self,
        hinge: &Hinge<T::Constant>,
        i: usize,
        range: Range<usize>,
        mut put: impl FnMut(usize, T),
    ) {
        let along = &self.rows[hinge.components()[i]][range.clone()];
        let dofs = &self.dof[range.clone()];
        if let Hinge::Helical { pitch } = hinge {
            let pitch = T::constant(*pitch);
            for ((&a, &b), &dof) in along.iter().zip(&self.rows[5][range]).zip(dofs) {
                put(dof, pitch.fma(b, a));
            }
        } else {
            for (&a, &dof) in along.iter().zip(dofs) {
                put(dof, a);
            }
        }
    }
    /// φ(p, k) of every column of a range.
    #[inline(always)]
    pub(crate) fn move_to_parent(&mut self, passage: Passage<'_, T>, range: Range<usize>) {
        let mut at = range.start;
        while at < range.end {
            let mut group = [Wrench::zero(); GROUP];
            let [a, b, c, d, e, f] = &self.rows;
            let load =
                |row: &[T]| -> [T; GROUP] { row[at..at + GROUP].try_into().unwrap_or([T::zero(); GROUP]) };
            let (a, b, c, d, e, f) = (load(a), load(b), load(c), load(d), load(e), load(f));
            for i in 0..GROUP {
                let x = Wrench::from_array([a[i], b[i], c[i], d[i], e[i], f[i]]);
                group[i] = passage.wrench_to_parent(x);
            }
            for (r, row) in self.rows.iter_mut().enumerate() {
                let row = &mut row[at..at + GROUP];
                for i in 0..GROUP {
                    row[i] = group[i].get(r);
                }
            }
            at += GROUP;
        }
    }
}
