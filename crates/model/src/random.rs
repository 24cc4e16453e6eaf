//! Reproducible random numbers for generated states and models.
//!
//! SplitMix64 (Steele, Lea, Flood 2014): eight bytes of state, the same numbers on every machine and in every version.
//! For test states and starting points, not for statistics.

/// A seeded generator.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// From a seed.
    pub fn new(seed: u64) -> Self {
        Random(seed)
    }
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
    /// Uniform in [−1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.uniform() - 1.0
    }
    /// Uniform in 0…n−1; n must not be zero.
    pub fn below(&mut self, n: usize) -> usize {
        (self.uniform() * n as f64) as usize
    }
    /// Three numbers in [−1, 1).
    pub fn vector(&mut self) -> [f64; 3] {
        [self.signed(), self.signed(), self.signed()]
    }
    /// A uniformly distributed unit quaternion (Shoemake 1992).
    pub fn quaternion(&mut self) -> [f64; 4] {
        let (u, a, b) = (self.uniform(), self.uniform(), self.uniform());
        let (a, b) = (std::f64::consts::TAU * a, std::f64::consts::TAU * b);
        let (r, s) = ((1.0 - u).sqrt(), u.sqrt());
        [r * a.sin(), r * a.cos(), s * b.sin(), s * b.cos()]
    }
}
