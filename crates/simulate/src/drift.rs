//! Drift and noise of a conserved energy: a straight line through its values.
//!
//! | symbol | meaning |
//! |---|---|
//! | E(t) | kinetic + potential energy − work, at the recorded instants |
//! | slope | least squares of E(t) = E₀ + slope · t |
//! | error | standard error of the slope, √(Σ r²/(n − 2) / Σ (t − t̄)²), as if the residuals r were independent |
//! | noise | root mean square of r |

use crate::record::Row;

/// The line through an energy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// Energy per time.
    pub slope: f64,
    /// Its standard error.
    pub error: f64,
    /// Root mean square about the line.
    pub noise: f64,
}

/// Drift of the total energy, less work; `None` for fewer than three instants.
pub fn drift(rows: &[Row]) -> Option<Drift> {
    let n = rows.len() as f64;
    if rows.len() < 3 {
        return None;
    }
    // Differences from the first instant: a large constant costs no digits.
    let energy = |r: &Row| r.energy[0] + r.energy[1] - r.energy[2];
    let (t0, e0) = (rows[0].t, energy(&rows[0]));
    let points = || rows.iter().map(|r| (r.t - t0, energy(r) - e0));
    let (mean_t, mean_e) = points().fold((0.0, 0.0), |(t, e), p| (t + p.0 / n, e + p.1 / n));
    let (tt, te) = points().fold((0.0, 0.0), |(tt, te), (t, e)| {
        (tt + (t - mean_t) * (t - mean_t), te + (t - mean_t) * (e - mean_e))
    });
    let slope = te / tt;
    let squares: f64 = points().map(|(t, e)| (e - mean_e - slope * (t - mean_t)).powi(2)).sum();
    Some(Drift { slope, error: (squares / (n - 2.0) / tt).sqrt(), noise: (squares / n).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_with_alternating_noise_is_found() {
        let rows: Vec<Row> = (0..1000)
            .map(|i| {
                let t = 0.1 * f64::from(i);
                let noise = if i % 2 == 0 { 0.25 } else { -0.25 };
                let energy = [1e6 + 0.5 * t, noise, 2.0 * t];
                Row { t, q: vec![], v: vec![], energy, momentum: [0.0; 6], outputs: vec![], terms: vec![] }
            })
            .collect();
        let found = drift(&rows).unwrap();
        // The alternation projects onto the line by 3·0.25·2/(n·T) = 1.5e-5.
        assert!((found.slope + 1.5).abs() < 2e-5, "{found:?}");
        assert!((found.noise - 0.25).abs() < 1e-6, "{found:?}");
        assert!(found.error > 2e-4 && found.error < 3.5e-4, "{found:?}");
    }
}
