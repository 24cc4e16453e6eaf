//! The integration methods and their error control.

/// An integration method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Order 8, adaptive.
    Dop853,
    /// Order 5, adaptive.
    Tsit5,
    /// Order 4, fixed step.
    Rk4 {
        /// Step size.
        step: f64,
    },
    /// Rosenbrock method of order 4 for stiff scenes, adaptive.
    Rodas4,
    /// Rosenbrock method of order 5 for stiff scenes, adaptive.
    Rodas5p,
}

impl Method {
    /// Its order.
    pub fn order(&self) -> u32 {
        match self {
            Method::Dop853 => 8,
            Method::Tsit5 | Method::Rodas5p => 5,
            Method::Rk4 { .. } | Method::Rodas4 => 4,
        }
    }
    /// True for a method that solves with the Jacobian and has no limit of stability.
    pub fn is_implicit(&self) -> bool {
        matches!(self, Method::Rodas4 | Method::Rodas5p)
    }
}

/// Error control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// Relative tolerance of velocities, against 1 + their largest value so far.
    pub rtol: f64,
    /// Absolute tolerance of increments, rad or m.
    pub atol: f64,
    /// Largest step.
    pub max_step: f64,
}

impl Tolerances {
    /// Equal tolerances, no largest step.
    pub fn new(tolerance: f64) -> Self {
        Tolerances { rtol: tolerance, atol: tolerance, max_step: f64::INFINITY }
    }
}
