//! The first passage of several functions through zero within a step.
//!
//! | symbol | meaning |
//! |---|---|
//! | θ | fraction of the step, 0 … 1 |
//! | g_i(θ) | event function i on the dense output |
//! | side | sign of g_i where the motion is; 0: not known yet |
//!
//! Samples at eighths of the step bracket passages, and at 8^−2 … 8^−6 of it where a function starts near zero: after an event it often
//! comes back at once. A dip between samples is looked for where a parabola through three of them comes near zero. Brackets are narrowed by regula falsi with halved weights (Illinois) and bisection.

use crate::event::Direction;

/// Intervals of a step.
const CELLS: usize = 8;

/// Finer samples near the start, in powers of 1/8.
const FINER: i32 = 6;

/// A start is near zero if it is so small beside the function's values in the step.
const CLOSE: f64 = 0.02;

/// Halvings in the search for a short excursion after the start.
const HALVINGS: i32 = 34;

/// Value at the start, over that at the first sample, which is zero but for rounding.
const NEAR: f64 = 1e-9;

/// Most evaluations for one root.
const ROOT: usize = 100;

/// A function as the search sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Watched {
    pub(crate) direction: Direction,
    pub(crate) side: i8,
    /// A guard: positive in its mode.
    pub(crate) guard: bool,
    pub(crate) noise: f64,
}

/// A passage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Passage {
    pub(crate) index: usize,
    /// Where; 0: at once.
    pub(crate) theta: f64,
    /// Lower end of the bracket.
    pub(crate) from: f64,
    /// dg/dθ there; 0 where it only touches.
    pub(crate) slope: f64,
}

/// Values at the samples.
#[derive(Clone, Debug, Default)]
pub(crate) struct Search {
    grid: Vec<f64>,
    samples: Vec<Vec<f64>>,
    scratch: Vec<f64>,
}

type Evaluate<'a, E> = dyn FnMut(f64, &mut [f64]) -> Result<(), E> + 'a;

/// An interval in which a function passes: θ and g of both ends.
#[derive(Clone, Copy, Debug)]
struct Bracket {
    low: (f64, f64),
    high: (f64, f64),
}

impl Search {
    /// The earliest passage; `watched` gets the sides at the end of the step. The values at both ends are given.
    pub(crate) fn first<E>(
        &mut self,
        watched: &mut [Watched],
        start: &[f64],
        end: &[f64],
        evaluate: &mut Evaluate<'_, E>,
    ) -> Result<Option<Passage>, E> {
        let n = watched.len();
        self.scratch.resize(n, 0.0);
        self.grid.clear();
        self.grid.extend((0..=CELLS).map(|k| k as f64 / CELLS as f64));
        self.samples.truncate(CELLS + 1);
        self.samples.resize(CELLS + 1, Vec::new());
        self.samples.iter_mut().for_each(|s| s.resize(n, 0.0));
        for k in 0..=CELLS {
            match k {
                0 => self.samples[k].copy_from_slice(start),
                CELLS => self.samples[k].copy_from_slice(end),
                _ => evaluate(self.grid[k], &mut self.samples[k])?,
            }
        }
        let is_close = |i: usize| {
            let most = self.samples[1..].iter().fold(0.0f64, |most, s| most.max(s[i].abs()));
            start[i].is_finite() && start[i].abs() < CLOSE * most
        };
        if (0..n).any(is_close) {
            for power in (2..=FINER).rev() {
                let at = 1 + (FINER - power) as usize;
                let theta = 8f64.powi(-power);
                let mut values = vec![0.0; n];
                evaluate(theta, &mut values)?;
                self.grid.insert(at, theta);
                self.samples.insert(at, values);
            }
        }
        let mut first: Option<Passage> = None;
        for (i, w) in watched.iter_mut().enumerate().filter(|(i, _)| start[*i].is_finite()) {
            let Some(found) = self.passage(i, w, evaluate)? else { continue };
            if first.is_none_or(|f| found.theta < f.theta) {
                first = Some(found);
            }
        }
        Ok(first)
    }
    fn value<E>(&mut self, i: usize, theta: f64, evaluate: &mut Evaluate<'_, E>) -> Result<f64, E> {
        let mut scratch = std::mem::take(&mut self.scratch);
        let result = evaluate(theta, &mut scratch);
        self.scratch = scratch;
        result.map(|()| self.scratch[i])
    }
    /// The first passage of one function.
    fn passage<E>(
        &mut self,
        i: usize,
        w: &mut Watched,
        evaluate: &mut Evaluate<'_, E>,
    ) -> Result<Option<Passage>, E> {
        let mut before = (0.0, self.samples[0][i]);
        for k in 1..self.grid.len() {
            let now = (self.grid[k], self.samples[k][i]);
            if !now.1.is_finite() {
                continue;
            }
            let sign = side(now.1);
            if w.side == 0 {
                if w.guard && now.1 < -w.noise {
                    return self.after_start(i, 1, now, evaluate).map(Some);
                }
                // A function of the user's that was left at zero: it may go to the other side and come back at once.
                if !w.guard && k == 1 && w.direction.leaves(-sign) {
                    let found = self.after_start(i, -sign, now, evaluate)?;
                    // Sooner it is rounding of the zero.
                    if found.theta > NEAR {
                        return Ok(Some(found));
                    }
                }
                if now.1.abs() > w.noise {
                    w.side = sign;
                }
            } else if sign == -w.side {
                if w.direction.leaves(w.side) {
                    // It has just come to this side, at the event that ended the last step.
                    if k == 1 && before.1.abs() <= NEAR * now.1.abs() {
                        return self.after_start(i, w.side, now, evaluate).map(Some);
                    }
                    let bracket = Bracket { low: on_side(before, w.side), high: now };
                    return self.root(i, bracket, evaluate).map(Some);
                }
                w.side = sign;
            } else if w.direction.leaves(w.side)
                && k + 1 < self.grid.len()
                && let Some(low) = self.dip(i, k, w.side, evaluate)?
            {
                let bracket = Bracket { low: on_side(before, w.side), high: low };
                return self.root(i, bracket, evaluate).map(Some);
            }
            before = now;
        }
        Ok(None)
    }
    /// A function that is zero at the start and not on its side at `end`: the end of a short excursion, or at once.
    fn after_start<E>(
        &mut self,
        i: usize,
        of: i8,
        end: (f64, f64),
        evaluate: &mut Evaluate<'_, E>,
    ) -> Result<Passage, E> {
        let mut high = end;
        for _ in 0..HALVINGS {
            let theta = 0.5 * high.0;
            let g = self.value(i, theta, evaluate)?;
            if side(g) == of {
                return self.root(i, Bracket { low: (theta, g), high }, evaluate);
            }
            high = (theta, g);
        }
        Ok(Passage { index: i, theta: 0.0, from: 0.0, slope: 0.0 })
    }
    /// A place near sample k where the function is on the other side, between two samples on this one.
    fn dip<E>(
        &mut self,
        i: usize,
        k: usize,
        side: i8,
        evaluate: &mut Evaluate<'_, E>,
    ) -> Result<Option<(f64, f64)>, E> {
        let s = f64::from(side);
        let [(x, a), (y, b), (z, c)] = [k - 1, k, k + 1].map(|k| (self.grid[k], s * self.samples[k][i]));
        let [before, after] = [(b - a) / (y - x), (c - b) / (z - y)];
        let bend = (after - before) / (z - x);
        let slope = before + bend * (y - x);
        if !(a > b && b <= c && c > 0.0) || b - slope * slope / (4.0 * bend) > 0.5 * b {
            return Ok(None);
        }
        // Golden section; it ends at the first value beyond zero.
        const GOLDEN: f64 = 0.381_966_011_250_105_1;
        let (mut low, mut high) = (x, z);
        let (mut middle, mut least) = (y, b);
        for _ in 0..40 {
            let left = middle - low > high - middle;
            let trial =
                if left { middle - GOLDEN * (middle - low) } else { middle + GOLDEN * (high - middle) };
            let g = s * self.value(i, trial, evaluate)?;
            if g < 0.0 {
                return Ok(Some((trial, s * g)));
            }
            if g < least {
                if left {
                    high = middle
                } else {
                    low = middle
                }
                (middle, least) = (trial, g);
            } else if left {
                low = trial;
            } else {
                high = trial;
            }
            if high - low < 1e-8 * high {
                break;
            }
        }
        Ok(None)
    }
    /// Narrows a bracket.
    fn root<E>(
        &mut self,
        i: usize,
        Bracket { mut low, mut high }: Bracket,
        evaluate: &mut Evaluate<'_, E>,
    ) -> Result<Passage, E> {
        let from = low.0;
        let (mut weights, mut last) = ([1.0, 1.0], 0);
        for count in 0..ROOT {
            let width = high.0 - low.0;
            if width <= 2.0 * f64::EPSILON {
                break;
            }
            let (a, b) = (weights[0] * low.1, weights[1] * high.1);
            let mut trial = low.0 + width * (a / (a - b));
            if count % 4 == 3 || !(trial > low.0 && trial < high.0) {
                trial = 0.5 * (low.0 + high.0);
            }
            let g = self.value(i, trial, evaluate)?;
            if g == 0.0 {
                (low, high) = ((trial, g), (trial, g));
                break;
            }
            if side(g) == side(low.1) {
                low = (trial, g);
                weights = [1.0, if last == 1 { 0.5 * weights[1] } else { 1.0 }];
                last = 1;
            } else {
                high = (trial, g);
                weights = [if last == 2 { 0.5 * weights[0] } else { 1.0 }, 1.0];
                last = 2;
            }
        }
        let theta = if low.1.abs() < high.1.abs() { low.0 } else { high.0 };
        // Wide enough for a difference quotient, narrow beside the step.
        let delta = 1e-5;
        let (a, b) = ((theta - delta).max(0.0), (theta + delta).min(1.0));
        let slope = (self.value(i, b, evaluate)? - self.value(i, a, evaluate)?) / (b - a);
        Ok(Passage { index: i, theta, from, slope: if slope.is_finite() { slope } else { 0.0 } })
    }
}

/// Sign of a number; 0 for zero.
pub(crate) fn side(x: f64) -> i8 {
    i8::from(x > 0.0) - i8::from(x < 0.0)
}

/// A start of a bracket whose value is on its side by less than rounding.
fn on_side((theta, g): (f64, f64), of: i8) -> (f64, f64) {
    (theta, if side(g) == of { g } else { f64::from(of) * f64::MIN_POSITIVE })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(g: impl Fn(f64) -> f64, direction: Direction, side: i8, guard: bool) -> Option<f64> {
        let mut w = [Watched { direction, side, guard, noise: 1e-14 }];
        let mut evaluate = |theta: f64, out: &mut [f64]| {
            out[0] = g(theta);
            Ok::<(), ()>(())
        };
        let found = Search::default().first(&mut w, &[g(0.0)], &[g(1.0)], &mut evaluate).unwrap();
        found.map(|p| p.theta)
    }

    #[test]
    fn passages_are_found_to_rounding() {
        let near = |found: Option<f64>, want: f64| (found.unwrap() - want).abs() < 4.0 * f64::EPSILON;
        assert!(near(find(|x| 0.7 - x, Direction::Falling, 1, false), 0.7));
        assert_eq!(find(|x| 0.7 - x, Direction::Rising, 1, false), None);
        assert!(near(find(|x| (x - 0.3) * (x - 0.9), Direction::Rising, 1, false), 0.9));
        // Between two samples it dips below zero by 1e-6: a chord of 2e-3.
        let dip = |x: f64| (x - 0.43).powi(2) - 1e-6;
        assert!((find(dip, Direction::Falling, 1, false).unwrap() - 0.429).abs() < 1e-12);
        assert_eq!(find(|x| (x - 0.43).powi(2) + 1e-6, Direction::Falling, 1, false), None);
        // From just above zero down and up again, long before the first eighth.
        let at_once = |x: f64| (x - 1e-6) * (x - 1e-3);
        assert!((find(at_once, Direction::Falling, 1, true).unwrap() - 1e-6).abs() < 1e-15);
    }

    /// A guard that starts at zero: up and down again, away for good, or down at once.
    #[test]
    fn a_guard_at_zero_is_not_a_passage() {
        let bounce = |x: f64| x * (1e-3 - x);
        assert!((find(bounce, Direction::Falling, 0, true).unwrap() - 1e-3).abs() < 1e-15);
        assert_eq!(find(|x| x, Direction::Falling, 0, true), None);
        assert_eq!(find(|x| -x, Direction::Falling, 0, true), Some(0.0));
        assert_eq!(find(|x| 1e-15 * (x - 0.5), Direction::Falling, 0, true), None);
    }
}
