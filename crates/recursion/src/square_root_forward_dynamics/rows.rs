//! Rows of a least-squares problem in the acceleration of one body, and their reduction by Householder reflections.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | S, y | rows of ‖S α + y‖², S angular first | up to 12×6, 12 |
//! | v, β | reflection I − β v v* that leaves one entry of a column | |
//!
//! Each reflection takes the row with the largest entry of its column as pivot row (Powell and Reid 1969): then every row
//! is in error by ε of its own size only, whatever the sizes of the others (Cox and Higham 1998).

use phipsi_spatial::{Real, Transform, Vec3, Wrench};

/// One row: six entries of S, one of y, and the sizes of the terms that its angular and its linear entries are sums of.
pub type Row<T> = [T; 9];

/// What the children of a body let through: six rows at most, and how many.
pub type Held<T> = ([Row<T>; 6], usize);

/// No entries.
pub fn zero<T: Real>() -> Row<T> {
    [T::zero(); 9]
}

/// A column whose every entry is below this many ε of the terms of its row is rounding: a dozen rows, six reflections.
const ROUNDING: f64 = 64.0;

/// Rows of a body that it and its children add up to before elimination.
const CAPACITY: usize = 12;

/// The first six entries, which move between frames as a wrench does.
#[inline(always)]
pub fn covector<T: Real>(row: &Row<T>) -> Wrench<T> {
    Wrench::new(Vec3([row[0], row[1], row[2]]), Vec3([row[3], row[4], row[5]]))
}

/// |x| + |y| + |z|.
#[inline(always)]
fn sum<T: Real>(v: Vec3<T>) -> T {
    v.0[0].abs() + v.0[1].abs() + v.0[2].abs()
}

/// Up to twelve rows; those before `first` have been taken out.
#[derive(Clone, Debug)]
pub struct Rows<T> {
    rows: [Row<T>; CAPACITY],
    first: usize,
    end: usize,
}

impl<T: Real> Default for Rows<T> {
    fn default() -> Self {
        Rows { rows: [zero(); CAPACITY], first: 0, end: 0 }
    }
}

impl<T: Real> Rows<T> {
    /// No rows.
    pub fn new() -> Self {
        Self::default()
    }
    /// Forgets all rows.
    #[inline(always)]
    pub fn clear(&mut self) {
        (self.first, self.end) = (0, 0);
    }
    /// The rows.
    #[inline(always)]
    pub fn get(&self) -> &[Row<T>] {
        &self.rows[self.first..self.end]
    }
    /// The rows, to be changed.
    #[inline(always)]
    pub fn get_mut(&mut self) -> &mut [Row<T>] {
        &mut self.rows[self.first..self.end]
    }
    /// Adds a row. Callers add at most six to at most six.
    #[inline(always)]
    pub fn push(&mut self, row: Row<T>) {
        if self.end < CAPACITY {
            self.rows[self.end] = row;
            self.end += 1;
        }
    }
    /// Adds rows of a child with pose `x`: S φ*. A vector of rounding alone is set to zero: it has no size of its own.
    #[inline(always)]
    pub fn push_from_child(&mut self, x: &Transform<T>, rows: &[Row<T>]) {
        let unit = T::splat(ROUNDING * T::EPSILON);
        for row in rows {
            let mut own = covector(row);
            let (mut angular, mut linear) = (sum(own.moment), sum(own.force));
            if angular <= unit * row[7] {
                (own.moment, angular) = (Vec3::zero(), T::zero());
            }
            if linear <= unit * row[8] {
                (own.force, linear) = (Vec3::zero(), T::zero());
            }
            let w = x.wrench_to_parent(own);
            let ([a, b, c], [d, e, f]) = (w.moment.0, w.force.0);
            self.push([a, b, c, d, e, f, row[6], angular + sum(x.translation) * linear, linear]);
        }
    }
    /// Adds rows of a child with pose `x` to those that its parent holds of its other children; these rows are the room for it.
    #[inline(always)]
    pub fn hand_over(&mut self, held: &mut Held<T>, x: &Transform<T>, rows: &[Row<T>]) {
        let (held, count) = held;
        self.clear();
        held[..*count].iter().for_each(|row| self.push(*row));
        self.push_from_child(x, rows);
        if self.get().len() > 6 {
            self.compress();
        }
        *count = self.get().len().min(6);
        held[..*count].copy_from_slice(&self.get()[..*count]);
    }
    /// True if no entry of a column is more than rounding.
    #[inline(always)]
    pub fn is_rounding(&self, column: usize) -> bool {
        let unit = T::splat(ROUNDING * T::EPSILON);
        let terms = if column < 3 { 7 } else { 8 };
        !self.get().iter().any(|row| row[column].abs() > unit * row[terms])
    }
    /// Sum of squares of a column, as an error message prints it.
    pub fn square(&self, column: usize) -> f64 {
        self.get().iter().map(|row| row[column].to_f64().powi(2)).sum()
    }
    /// Entries of angle and displacement along z that belong to one helical hinge: the column of the angle becomes the hinge's.
    #[inline(always)]
    pub fn join(&mut self, pitch: T) {
        for row in self.get_mut() {
            row[2] += pitch * row[5];
            row[7] += (pitch * row[5]).abs();
        }
    }
    /// Undoes [`Rows::join`].
    #[inline(always)]
    pub fn part(&mut self, pitch: T) {
        self.get_mut().iter_mut().for_each(|row| row[2] -= pitch * row[5]);
    }
    /// Reflects the rows so that the first alone has an entry in `column`; takes that row out and returns it.
    /// `None` if all entries are zero or one is not finite.
    #[inline(always)]
    pub fn take(&mut self, column: usize) -> Option<Row<T>> {
        let rows = &mut self.rows[self.first..self.end];
        let mut pivot = 0;
        let mut largest = T::zero();
        for (i, row) in rows.iter().enumerate() {
            let size = row[column].abs();
            if size > largest {
                (pivot, largest) = (i, size);
            }
        }
        if !largest.is_positive() {
            return None;
        }
        rows.swap(0, pivot);
        let mut square = T::zero();
        for row in rows.iter() {
            square = row[column].fma(row[column], square);
        }
        let size = square.sqrt();
        if !size.is_positive() {
            return None;
        }
        let lead = rows[0][column];
        let rho = if lead > T::zero() { -size } else { size };
        let v0 = lead - rho;
        // β = 2/‖v‖² = −1/(ρ v₀).
        let beta = -(rho * v0).recip();
        let mut w = rows[0];
        for x in &mut w {
            *x *= v0;
        }
        (w[7], w[8]) = (w[7].abs(), w[8].abs());
        for row in &rows[1..] {
            let v = row[column];
            for j in 0..7 {
                w[j] = v.fma(row[j], w[j]);
            }
            for j in 7..9 {
                w[j] += v.abs() * row[j];
            }
        }
        for x in &mut w {
            *x *= beta;
        }
        for (i, row) in rows.iter_mut().enumerate() {
            let v = if i == 0 { v0 } else { row[column] };
            for j in 0..7 {
                row[j] -= v * w[j];
            }
            for j in 7..9 {
                row[j] = row[j].larger(v.abs() * w[j]);
            }
            row[column] = T::zero();
        }
        rows[0][column] = rho;
        let taken = rows[0];
        self.first += 1;
        Some(taken)
    }
    /// The same sum of squares, up to a constant, in at most as many rows as there are columns that are not zero.
    #[inline(always)]
    pub fn compress(&mut self) {
        self.absorb(&mut Wrench::zero());
    }
    /// [`Rows::compress`], and the linear term p goes into y as far as the rows reach: R* Δy = p by substitution, whose errors
    /// are ε of the rows again. Columns without a row keep their entry of p.
    #[inline(always)]
    pub fn absorb(&mut self, p: &mut Wrench<T>) {
        let mut kept = [zero(); 6];
        let mut count = 0;
        let mut left = p.to_array();
        // Lengths first: their entries do not depend on a frame's origin.
        for column in [3, 4, 5, 0, 1, 2] {
            // A column of rounding is no inertia: a share of p in it would be anything.
            if self.is_rounding(column) {
                continue;
            }
            if let Some(mut row) = self.take(column) {
                let share = left[column] / row[column];
                row[6] += share;
                for j in 0..6 {
                    left[j] -= share * row[j];
                }
                left[column] = T::zero();
                kept[count] = row;
                count += 1;
            }
        }
        *p = Wrench::from_array(left);
        self.clear();
        for row in &kept[..count] {
            self.push(*row);
        }
    }
}
