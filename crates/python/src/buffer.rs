//! Memory for copies of large arguments, kept from call to call.
//!
//! The system takes the memory of a large copy back when it is freed, and gives it anew, page by page and zeroed, to the
//! next one: for a batch of arms that costs as much as their dynamics.

use std::mem::take;
use std::ops::Deref;
use std::sync::{Mutex, PoisonError};

/// Numbers from which a buffer is kept: about where an allocator turns to the system.
pub const LARGE: usize = 16 * 1024;

/// Numbers that are kept in all, 128 MiB of them: three arguments of 10⁵ states of fifty numbers.
const KEPT: usize = 16 * 1024 * 1024;

/// Those that nobody uses now, the one last given back at the end.
static IDLE: Mutex<Vec<Vec<f64>>> = Mutex::new(Vec::new());

/// Numbers in memory that goes back to the store.
pub struct Buffer(Vec<f64>);

impl Buffer {
    /// An empty one with room for so many numbers.
    pub fn of(size: usize) -> Self {
        Buffer(if size < LARGE { Vec::with_capacity(size) } else { kept(size) })
    }
    /// Appends numbers.
    #[inline]
    pub fn extend(&mut self, x: &[f64]) {
        self.0.extend_from_slice(x);
    }
}

impl From<Vec<f64>> for Buffer {
    fn from(x: Vec<f64>) -> Self {
        Buffer(x)
    }
}

impl Deref for Buffer {
    type Target = [f64];
    #[inline]
    fn deref(&self) -> &[f64] {
        &self.0
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        if !(LARGE..=KEPT).contains(&self.0.capacity()) {
            return;
        }
        let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
        idle.push(take(&mut self.0));
        let mut total: usize = idle.iter().map(Vec::capacity).sum();
        while total > KEPT {
            total -= idle.remove(0).capacity();
        }
    }
}

/// The smallest of the idle ones that is large enough; new memory if there is none.
fn kept(size: usize) -> Vec<f64> {
    let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
    let fits = idle.iter().enumerate().filter(|(_, x)| x.capacity() >= size);
    let Some((at, _)) = fits.min_by_key(|(_, x)| x.capacity()) else { return Vec::with_capacity(size) };
    let mut found = idle.remove(at);
    found.clear();
    found
}
