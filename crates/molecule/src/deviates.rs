//! Reproducible normal deviates: the ChaCha8 stream of a seed, by Box and Muller's transformation.
//!
//! The transformation is here because a library's may change its numbers from version to version, and because with a fixed
//! number of words a deviate the place in the stream is the whole state. Logarithm, sine and cosine are libm's, the same on
//! every machine.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// 2⁻⁵³.
const STEP: f64 = f64::EPSILON / 2.0;

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Deviates {
    seed: u64,
    random: ChaCha8Rng,
}

/// The place in a stream: what a checkpoint keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DeviatesState {
    /// The seed.
    pub seed: u64,
    /// The stream of the seed.
    pub stream: u64,
    /// Words of 32 bits used.
    pub position: u128,
}

impl Deviates {
    /// The first stream of a seed.
    pub fn new(seed: u64) -> Self {
        Self::at(DeviatesState { seed, stream: 0, position: 0 })
    }
    /// Another, independent stream of a seed: one for each replica.
    pub fn stream(seed: u64, stream: u64) -> Self {
        Self::at(DeviatesState { seed, stream, position: 0 })
    }
    /// A stream from a place on.
    pub fn at(state: DeviatesState) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&state.seed.to_le_bytes());
        let mut random = ChaCha8Rng::from_seed(key);
        random.set_stream(state.stream);
        random.set_word_pos(state.position);
        Deviates { seed: state.seed, random }
    }
    /// The present place.
    pub fn state(&self) -> DeviatesState {
        DeviatesState {
            seed: self.seed,
            stream: self.random.get_stream(),
            position: self.random.get_word_pos(),
        }
    }
    /// Uniform in (0, 1].
    pub fn uniform(&mut self) -> f64 {
        ((self.random.next_u64() >> 11) + 1) as f64 * STEP
    }
    /// Independent deviates of mean 0 and variance 1, in pairs: of an odd number the last one's companion is dropped.
    pub fn fill_normal(&mut self, out: &mut [f64]) {
        for pair in out.chunks_mut(2) {
            let radius = (-2.0 * libm::log(self.uniform())).sqrt();
            let (sine, cosine) = libm::sincos(std::f64::consts::TAU * self.uniform());
            pair[0] = radius * cosine;
            if let Some(second) = pair.get_mut(1) {
                *second = radius * sine;
            }
        }
    }
}
