//! Two-sided dynamics and the space Jacobian.

mod space_jacobian;
mod two_sided;
