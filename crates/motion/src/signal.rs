//! Functions of time: constants, tables, and functions given with their rates.

use std::fmt;
use std::sync::Arc;

/// A function of time with its rate.
#[derive(Clone)]
pub enum Signal {
    /// A constant.
    Constant(f64),
    /// Straight lines between (time, value) points, constant outside; its knots are [`breaks`](Signal::breaks).
    Table(Vec<(f64, f64)>),
    /// Value and rate.
    Function {
        /// f(t).
        value: Arc<dyn Fn(f64) -> f64 + Send + Sync>,
        /// df/dt.
        rate: Arc<dyn Fn(f64) -> f64 + Send + Sync>,
        /// Times at which it is not smooth.
        breaks: Vec<f64>,
    },
}

/// Why a table is not a function of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableError {
    /// Index of the offending point.
    pub point: usize,
    /// Its time.
    pub time: f64,
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let TableError { point, time } = self;
        write!(
            f,
            "point {point} of the table has time {time}; finite, increasing times and finite values are required"
        )
    }
}

impl std::error::Error for TableError {}

impl fmt::Debug for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Signal::Constant(x) => write!(f, "Constant({x})"),
            Signal::Table(points) => write!(f, "Table({points:?})"),
            Signal::Function { .. } => write!(f, "Function"),
        }
    }
}

impl Signal {
    /// A table of (time, value) points.
    ///
    /// # Errors
    /// [`TableError`] if there is no point, a number is not finite, or the times do not increase.
    pub fn table(points: Vec<(f64, f64)>) -> Result<Self, TableError> {
        let mut last = f64::NEG_INFINITY;
        for (point, &(time, value)) in points.iter().enumerate() {
            if !(time.is_finite() && value.is_finite() && time > last) {
                return Err(TableError { point, time });
            }
            last = time;
        }
        if points.is_empty() {
            Err(TableError { point: 0, time: f64::NAN })
        } else {
            Ok(Signal::Table(points))
        }
    }
    /// A smooth function with its rate.
    pub fn function(
        value: impl Fn(f64) -> f64 + Send + Sync + 'static,
        rate: impl Fn(f64) -> f64 + Send + Sync + 'static,
    ) -> Self {
        Signal::Function { value: Arc::new(value), rate: Arc::new(rate), breaks: Vec::new() }
    }
    /// The same with times at which it is not smooth; constants and tables have their own.
    pub fn with_breaks(mut self, times: Vec<f64>) -> Self {
        if let Signal::Function { breaks, .. } = &mut self {
            *breaks = times;
        }
        self
    }
    /// f(t).
    pub fn value(&self, t: f64) -> f64 {
        match self {
            Signal::Constant(x) => *x,
            Signal::Function { value, .. } => value(t),
            Signal::Table(points) => match segment(points, t) {
                Segment::Outside(i) => points[i].1,
                Segment::Inside(i) => {
                    let ((t0, x0), (t1, x1)) = (points[i], points[i + 1]);
                    x0 + (x1 - x0) * ((t - t0) / (t1 - t0))
                }
            },
        }
    }
    /// df/dt; at a knot, that of the line to the right.
    pub fn rate(&self, t: f64) -> f64 {
        match self {
            Signal::Constant(_) => 0.0,
            Signal::Function { rate, .. } => rate(t),
            Signal::Table(points) => match segment(points, t) {
                Segment::Outside(_) => 0.0,
                Segment::Inside(i) => (points[i + 1].1 - points[i].1) / (points[i + 1].0 - points[i].0),
            },
        }
    }
    /// Times at which the function is not smooth.
    pub fn breaks(&self) -> Vec<f64> {
        match self {
            Signal::Table(points) => points.iter().map(|p| p.0).collect(),
            Signal::Function { breaks, .. } => breaks.clone(),
            Signal::Constant(_) => Vec::new(),
        }
    }
}

enum Segment {
    Outside(usize),
    Inside(usize),
}

fn segment(points: &[(f64, f64)], t: f64) -> Segment {
    let after = points.partition_point(|p| p.0 <= t);
    if after == 0 {
        Segment::Outside(0)
    } else if after == points.len() {
        Segment::Outside(after - 1)
    } else {
        Segment::Inside(after - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_linear_between_and_constant_outside() {
        let table = Signal::table(vec![(0.0, 1.0), (2.0, 5.0), (3.0, 5.0)]).unwrap();
        let values: Vec<f64> = [-1.0, 0.0, 0.5, 2.0, 2.5, 9.0].iter().map(|&t| table.value(t)).collect();
        assert_eq!(values, [1.0, 1.0, 2.0, 5.0, 5.0, 5.0]);
        assert_eq!(
            [table.rate(-1.0), table.rate(0.0), table.rate(2.0), table.rate(3.0)],
            [0.0, 2.0, 0.0, 0.0]
        );
        assert_eq!(table.breaks(), [0.0, 2.0, 3.0]);
    }

    #[test]
    fn a_table_that_goes_back_in_time_is_refused() {
        assert_eq!(Signal::table(vec![(0.0, 1.0), (0.0, 2.0)]).unwrap_err().point, 1);
        assert!(Signal::table(vec![]).is_err());
        assert!(Signal::table(vec![(f64::NAN, 1.0)]).is_err());
    }
}
