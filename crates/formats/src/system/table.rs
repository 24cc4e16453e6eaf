//! Tabulated functions that expressions may call.
//!
//! | OpenMM | arguments | value |
//! |---|---|---|
//! | Discrete1DFunction, 2D, 3D | whole numbers, rounded to the nearest | of the table, the first argument fastest; none outside |
//! | Continuous1DFunction | a number | cubic spline through equally spaced values; 0 outside [min, max], or periodic |

use super::spline::{hermite, natural_slopes, periodic_slopes};

/// A tabulated function.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Its name in expressions.
    pub name: String,
    shape: Shape,
    values: Vec<f64>,
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    Discrete { sizes: Vec<usize> },
    Continuous { min: f64, step: f64, periodic: bool, slopes: Vec<f64> },
}

impl Table {
    /// A function of as many whole numbers as there are sizes; `None` unless the number of values is their product.
    pub fn discrete(name: impl Into<String>, sizes: &[usize], values: Vec<f64>) -> Option<Table> {
        let product = sizes.iter().try_fold(1usize, |product, n| product.checked_mul(*n))?;
        let fits = (1..=3).contains(&sizes.len()) && product == values.len() && product > 0;
        fits.then(|| Table { name: name.into(), shape: Shape::Discrete { sizes: sizes.to_vec() }, values })
    }

    /// A spline from `min` to `max`; `None` for fewer than two values (three if periodic), an empty interval, or a
    /// periodic one whose first and last value differ.
    pub fn continuous(
        name: impl Into<String>,
        [min, max]: [f64; 2],
        periodic: bool,
        mut values: Vec<f64>,
    ) -> Option<Table> {
        let least = if periodic { 3 } else { 2 };
        let step = (max - min) / values.len().checked_sub(1)? as f64;
        if values.len() < least || !step.is_finite() || step <= 0.0 {
            return None;
        }
        let slopes = if periodic {
            if values.first() != values.last() {
                return None;
            }
            let mut slopes = periodic_slopes(&values[1..]);
            slopes.rotate_right(1);
            slopes.push(slopes[0]);
            slopes
        } else {
            natural_slopes(&values)
        };
        values.shrink_to_fit();
        Some(Table { name: name.into(), shape: Shape::Continuous { min, step, periodic, slopes }, values })
    }

    /// Number of arguments.
    pub fn arguments(&self) -> usize {
        match &self.shape {
            Shape::Discrete { sizes } => sizes.len(),
            Shape::Continuous { .. } => 1,
        }
    }

    /// The sizes of a discrete table.
    pub fn sizes(&self) -> Option<&[usize]> {
        match &self.shape {
            Shape::Discrete { sizes } => Some(sizes),
            Shape::Continuous { .. } => None,
        }
    }

    /// The values, the first argument fastest.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The value and the slope in the first argument; NaN outside a discrete table.
    pub fn value_and_slope(&self, arguments: &[f64]) -> (f64, f64) {
        match &self.shape {
            Shape::Discrete { sizes } => (self.discrete_value(sizes, arguments), 0.0),
            Shape::Continuous { min, step, periodic, slopes } => {
                let x = arguments.first().copied().unwrap_or(f64::NAN);
                let steps = self.values.len() - 1;
                let mut t = (x - min) / step;
                if *periodic {
                    t = t.rem_euclid(steps as f64);
                } else if t < 0.0 || t > steps as f64 {
                    return (0.0, 0.0);
                }
                if !t.is_finite() {
                    return (f64::NAN, f64::NAN);
                }
                let i = (t as usize).min(steps - 1);
                let (value, slope) = hermite(t - i as f64);
                let ends = [self.values[i], self.values[i + 1], slopes[i], slopes[i + 1]];
                let sum = |w: [f64; 4]| w[0] * ends[0] + w[1] * ends[1] + (w[2] * ends[2] + w[3] * ends[3]);
                (sum(value), sum(slope) / step)
            }
        }
    }

    fn discrete_value(&self, sizes: &[usize], arguments: &[f64]) -> f64 {
        let (mut index, mut stride) = (0usize, 1usize);
        for (k, size) in sizes.iter().enumerate() {
            let x = arguments.get(k).copied().unwrap_or(f64::NAN).round();
            if !(x >= 0.0 && x < *size as f64) {
                return f64::NAN;
            }
            index += stride * x as usize;
            stride *= size;
        }
        self.values.get(index).copied().unwrap_or(f64::NAN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_argument_is_fastest_and_outside_is_nothing() {
        let table = Table::discrete("t", &[2, 3], vec![0., 1., 2., 3., 4., 5.]).unwrap();
        assert_eq!(table.value_and_slope(&[1.0, 2.0]), (5.0, 0.0));
        assert_eq!(table.value_and_slope(&[0.6, 0.4]).0, 1.0);
        for outside in [[2.0, 0.0], [-0.6, 0.0], [0.0, 3.0], [f64::NAN, 0.0], [1e300, 0.0]] {
            assert!(table.value_and_slope(&outside).0.is_nan());
        }
        assert!(Table::discrete("t", &[usize::MAX, 2], vec![1.0]).is_none());
        assert!(Table::discrete("t", &[2, 2], vec![1.0; 3]).is_none());
    }

    #[test]
    fn splines_end_or_go_on() {
        let line = Table::continuous("t", [1.0, 3.0], false, vec![2.0, 4.0, 6.0]).unwrap();
        assert_eq!(line.value_and_slope(&[1.5]), (3.0, 2.0));
        assert_eq!(line.value_and_slope(&[3.0]).0, 6.0);
        assert_eq!(line.value_and_slope(&[3.0001]), (0.0, 0.0));
        let wave = Table::continuous("t", [0.0, 4.0], true, vec![0., 1., 0., -1., 0.]).unwrap();
        let (value, slope) = wave.value_and_slope(&[-3.5]);
        let (same, as_much) = wave.value_and_slope(&[4.5]);
        assert!((value - same).abs() + (slope - as_much).abs() <= 8.0 * f64::EPSILON);
        assert!(wave.value_and_slope(&[f64::INFINITY]).0.is_nan());
        assert!(Table::continuous("t", [0.0, 4.0], true, vec![0., 1., 0., 1.]).is_none());
        assert!(Table::continuous("t", [4.0, 4.0], false, vec![0., 1.]).is_none());
    }
}
