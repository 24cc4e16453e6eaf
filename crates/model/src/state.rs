//! States: what the kernels see.

/// Configuration, velocity and time. Whatever else evolves lives beside it, with whoever owns it.
#[derive(Clone, Debug, PartialEq)]
pub struct State<T = f64> {
    /// Position coordinates, nq.
    pub q: Vec<T>,
    /// Generalised velocities, nv.
    pub v: Vec<T>,
    /// Time, s or ps.
    pub t: f64,
}
