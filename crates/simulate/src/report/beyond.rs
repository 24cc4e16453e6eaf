//! What a run does beyond the horizon: distributions, which runs of a chaotic scene have in common where their trajectories have parted.
//!
//! | symbol | meaning |
//! |---|---|
//! | x | the kinetic energy, or an output of the scene, at the recorded instants after the horizon |
//! | mean | of x; its error is the standard error of the means of ten pieces of that time, as if these were independent |
//! | deviation | root mean square of x − mean |
//! | quantiles | x below which 0, 1/20, 2/20, …, 1 of the samples lie |

use crate::record::Row;
use serde_json::{Value, json};

/// Pieces of the time for the error of a mean.
const PIECES: usize = 10;

/// Fewest samples of a piece.
const FEWEST: usize = 4;

/// Intervals between quantiles.
const PARTS: usize = 20;

/// Most samples that are kept.
const MOST: usize = 100_000;

/// Samples of one quantity after the horizon.
#[derive(Clone, Debug, PartialEq)]
pub struct Beyond {
    /// "kinetic energy", or the name of an output.
    pub name: String,
    /// Number of samples.
    pub samples: usize,
    /// Mean.
    pub mean: f64,
    /// Standard error of the mean.
    pub error: f64,
    /// Standard deviation.
    pub deviation: f64,
    /// Values below which 0, 1/20, …, 1 of the samples lie.
    pub quantiles: Vec<f64>,
}

impl Beyond {
    /// Of samples in the order of time; `None` where there are too few, or some are no numbers.
    fn new(name: &str, samples: &[f64]) -> Option<Self> {
        if samples.len() < PIECES * FEWEST || samples.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let mean_of = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
        let mean = mean_of(samples);
        let square = |x: f64| (x - mean) * (x - mean);
        let deviation = (samples.iter().map(|x| square(*x)).sum::<f64>() / samples.len() as f64).sqrt();
        let piece = |i: usize| &samples[i * samples.len() / PIECES..(i + 1) * samples.len() / PIECES];
        let spread: f64 = (0..PIECES).map(|i| square(mean_of(piece(i)))).sum();
        let error = (spread / ((PIECES - 1) * PIECES) as f64).sqrt();
        let mut sorted = samples.to_vec();
        sorted.sort_by(f64::total_cmp);
        let quantiles = (0..=PARTS).map(|i| sorted[i * (sorted.len() - 1) / PARTS]).collect();
        Some(Beyond { name: name.into(), samples: samples.len(), mean, error, deviation, quantiles })
    }
    /// Points of the distribution function: value, part of the samples below it.
    pub fn distribution(&self) -> Vec<(f64, f64)> {
        self.quantiles.iter().enumerate().map(|(i, x)| (*x, i as f64 / PARTS as f64)).collect()
    }
    /// In a few words.
    pub fn describe(&self) -> String {
        let Beyond { name, mean, error, deviation, .. } = self;
        format!("{name} {mean:.4e} ± {error:.1e}, deviation {deviation:.3e}")
    }
    pub(super) fn to_json(&self) -> Value {
        json!({
            "name": self.name, "samples": self.samples, "mean": self.mean, "error": self.error,
            "deviation": self.deviation, "quantiles": self.quantiles,
        })
    }
}

/// Collects what comes after the horizon.
pub(super) struct Collector<'a> {
    horizon: Option<f64>,
    names: &'a [String],
    /// Of the kinetic energy, then of each output.
    columns: Vec<Vec<f64>>,
}

impl<'a> Collector<'a> {
    pub(super) fn new(horizon: Option<f64>, names: &'a [String]) -> Self {
        Collector { horizon, names, columns: vec![Vec::new(); 1 + names.len()] }
    }
    pub(super) fn row(&mut self, row: &Row) {
        if self.horizon.is_none_or(|t| row.t <= t) || self.columns[0].len() >= MOST {
            return;
        }
        let values = std::iter::once(row.energy[0]).chain(row.outputs.iter().copied());
        self.columns.iter_mut().zip(values).for_each(|(column, x)| column.push(x));
    }
    /// Of each quantity that has enough samples.
    pub(super) fn finish(&self) -> Vec<Beyond> {
        let names = std::iter::once("kinetic energy").chain(self.names.iter().map(String::as_str));
        names.zip(&self.columns).filter_map(|(name, column)| Beyond::new(name, column)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uniform_distribution_is_found() {
        // Numbers of the golden ratio's sequence are uniform, to a few times 1/n.
        let n = 10_000;
        let samples: Vec<f64> = (0..n).map(|i| (0.618_033_988_749_894_8 * f64::from(i)).fract()).collect();
        let found = Beyond::new("x", &samples).unwrap();
        assert!((found.mean - 0.5).abs() < 1e-3 && (found.deviation - 12f64.sqrt().recip()).abs() < 1e-3);
        assert!(found.error < 1e-3, "{found:?}");
        assert!(found.distribution().iter().all(|(x, part)| (x - part).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn the_error_is_that_of_pieces() {
        // Ten steps, 0 to 9: the means of the pieces are all there is. Their variance is 55/6, its tenth that of the mean.
        let samples: Vec<f64> = (0..1000).map(|i| f64::from(i / 100)).collect();
        let found = Beyond::new("x", &samples).unwrap();
        assert!((found.error - (55.0f64 / 60.0).sqrt()).abs() < 1e-12, "{found:?}");
        assert!(Beyond::new("x", &samples[..39]).is_none());
        assert!(Beyond::new("x", &[f64::NAN; 100]).is_none());
    }
}
