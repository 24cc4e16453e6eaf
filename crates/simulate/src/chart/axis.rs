//! Axes of charts: ranges, round ticks and their labels, linear and logarithmic.

/// One axis: where values lie between 0 (start) and 1 (end), and what is written beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Place (0 … 1) and text of each labelled tick.
    pub ticks: Vec<(f64, String)>,
    /// Places of unlabelled ticks.
    pub minor: Vec<f64>,
    /// All labels are to be multiplied by ten to this power.
    pub exponent: i32,
    scale: Scale,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Scale {
    Linear {
        low: f64,
        high: f64,
    },
    /// Decades; zeros and what is below the lowest decade lie at place 0, below `floor` where the decades begin.
    Log {
        low: f64,
        high: f64,
        floor: f64,
    },
}

/// Ranges narrower than this part of the values are drawn as constant; labels then need at most seven digits.
const NARROWEST: f64 = 1e-5;
/// Values below are drawn as zero.
const TINIEST: f64 = 1e-300;
/// Height of the strip for zeros on a logarithmic axis.
const STRIP: f64 = 0.09;
/// This part of the positive values may lie below the lowest decade: a balance that passes through zero has a few values of
/// any smallness, which would press all others together.
const BELOW: f64 = 0.02;

impl Axis {
    /// A linear axis over the finite ones of `values`, with about `count` ticks. `rounded`: it ends on ticks.
    pub fn linear(values: impl Iterator<Item = f64>, count: usize, rounded: bool) -> Axis {
        let (low, high) = widened(range(values.filter(|v| v.is_finite())));
        let step = round_step((high / 4.0 - low / 4.0) / count.max(1) as f64 * 4.0);
        let (first, last) = if rounded {
            ((low / step).floor(), (high / step).ceil())
        } else {
            // A tick that misses the end by rounding is still a tick.
            ((low / step - 1e-9).ceil(), (high / step + 1e-9).floor())
        };
        let clamp = |v: f64| v.clamp(-f64::MAX, f64::MAX);
        let (low, high) = if rounded { (clamp(first * step), clamp(last * step)) } else { (low, high) };
        let scale = Scale::Linear { low, high };
        let steps = (last - first).clamp(0.0, 100.0) as usize;
        let values: Vec<f64> = (0..=steps).map(|i| clamp((first + i as f64) * step)).collect();
        let largest = values.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let magnitude = if largest > 0.0 { largest.log10().floor() as i32 } else { 0 };
        let exponent = if (-3..=4).contains(&magnitude) { 0 } else { magnitude.div_euclid(3) * 3 };
        let decimals = (exponent - step.log10().floor() as i32).max(0) as usize;
        let text = |v: f64| label(scaled(v, exponent), decimals);
        let ticks = values.into_iter().filter_map(|v| Some((scale.place(v)?, text(v)))).collect();
        Axis { ticks, minor: Vec::new(), exponent, scale }
    }

    /// A logarithmic axis over the positive finite ones of `values`. Exact zeros, and the lowest fiftieth of many values, are
    /// put into a strip of their own at its start.
    pub fn logarithmic(values: impl Iterator<Item = f64>) -> Axis {
        let mut sorted: Vec<f64> = values.filter(|v| v.is_finite() && *v >= 0.0).collect();
        sorted.sort_by(f64::total_cmp);
        let positive = &sorted[sorted.partition_point(|v| *v == 0.0)..];
        let decade = |v: f64| v.log10().floor();
        let (low, high) = match (positive.get((BELOW * positive.len() as f64) as usize), positive.last()) {
            (Some(low), Some(high)) => (decade(*low), high.log10().ceil()),
            _ => (-3.0, 0.0),
        };
        let zeros = positive.len() < sorted.len();
        let tiny = positive.first().is_some_and(|v| decade(*v) < low);
        let high = if high > low { high } else { low + 1.0 };
        let scale = Scale::Log { low, high, floor: if zeros || tiny { STRIP } else { 0.0 } };
        let decades = (high - low) as i32;
        let every = (decades + 5) / 6;
        let at = |decade: f64| scale.place_of_decade(decade);
        let mut ticks: Vec<(f64, String)> = (0..=decades)
            .filter(|d| d % every == 0)
            .map(|d| (at(low + f64::from(d)), power_of_ten(low as i32 + d)))
            .collect();
        if zeros || tiny {
            ticks.insert(0, (0.0, if tiny { "less" } else { "0" }.into()));
        }
        let minor = match (decades, every) {
            (..4, _) => (0..decades)
                .flat_map(|d| (2..10).map(move |m| low + f64::from(d) + f64::from(m).log10()))
                .map(at)
                .collect(),
            (_, 1) => Vec::new(),
            _ => (0..=decades).filter(|d| d % every != 0).map(|d| at(low + f64::from(d))).collect(),
        };
        Axis { ticks, minor, exponent: 0, scale }
    }

    /// Where a value lies between start (0) and end (1); `None` if it cannot be drawn.
    pub fn place(&self, value: f64) -> Option<f64> {
        self.scale.place(value)
    }
    /// First and last value of a linear axis.
    pub fn limits(&self) -> (f64, f64) {
        match self.scale {
            Scale::Linear { low, high } => (low, high),
            Scale::Log { low, high, .. } => (10f64.powf(low), 10f64.powf(high)),
        }
    }
    /// Where the decades begin, if there is a strip for zeros below.
    pub fn strip(&self) -> Option<f64> {
        match self.scale {
            Scale::Log { floor, .. } if floor > 0.0 => Some(floor),
            _ => None,
        }
    }
}

impl Scale {
    fn place(&self, value: f64) -> Option<f64> {
        match *self {
            _ if !value.is_finite() => None,
            // Quarters, because the length of the longest axis is no finite number.
            Scale::Linear { low, high } => Some((value / 4.0 - low / 4.0) / (high / 4.0 - low / 4.0)),
            Scale::Log { low, .. } if value > 0.0 => match value.log10() {
                decade if decade < low => Some(0.0),
                decade => Some(self.place_of_decade(decade)),
            },
            Scale::Log { .. } => (value == 0.0).then_some(0.0),
        }
    }
    fn place_of_decade(&self, decade: f64) -> f64 {
        match *self {
            Scale::Log { low, high, floor } => floor + (1.0 - floor) * (decade - low) / (high - low),
            Scale::Linear { .. } => decade,
        }
    }
}

fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.fold(None, |r, v| match r {
        None => Some((v, v)),
        Some((low, high)) => Some((v.min(low), v.max(high))),
    })
}

/// A range that an axis can show.
fn widened(range: Option<(f64, f64)>) -> (f64, f64) {
    let Some((low, high)) = range else { return (0.0, 1.0) };
    let largest = low.abs().max(high.abs());
    if largest < TINIEST {
        (-1.0, 1.0)
    } else if high / 4.0 - low / 4.0 < NARROWEST * largest / 4.0 {
        let edge = |v: f64| v.clamp(-f64::MAX, f64::MAX);
        (edge(low - 0.05 * largest), edge(high + 0.05 * largest))
    } else {
        (low, high)
    }
}

/// The smallest of 1, 2, 5 times a power of ten that is not below `least`.
fn round_step(least: f64) -> f64 {
    let least = least.clamp(TINIEST * 1e-6, 1e308);
    let power = least.log10().floor() as i32;
    let ten = |p: i32| format!("1e{p}").parse().unwrap_or(f64::MAX);
    let unit: f64 = ten(power);
    let step = [1.0, 2.0, 5.0].map(|m| m * unit).into_iter().find(|s| *s >= least * (1.0 - 1e-12));
    step.unwrap_or_else(|| ten(power + 1))
}

/// v / 10^exponent without leaving the range of numbers.
fn scaled(v: f64, exponent: i32) -> f64 {
    let half = exponent / 2;
    v / 10f64.powi(half) / 10f64.powi(exponent - half)
}

fn label(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(rest) if rest.chars().all(|c| c == '0' || c == '.') => rest.into(),
        Some(rest) => format!("−{rest}"),
        None => text,
    }
}

/// 10ⁿ in print.
pub fn power_of_ten(n: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    match n {
        0 => "1".into(),
        1 => "10".into(),
        _ => {
            let digit = |c: char| c.to_digit(10).map_or('⁻', |d| DIGITS[d as usize]);
            format!("10{}", n.to_string().chars().map(digit).collect::<String>())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<&str> {
        axis.ticks.iter().map(|t| t.1.as_str()).collect()
    }
    fn linear(values: &[f64]) -> Axis {
        Axis::linear(values.iter().copied(), 5, true)
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!(labels(&linear(&[0.0, 10.0])), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(labels(&linear(&[-0.9, 1.7])), ["−1", "0", "1", "2"]);
        assert_eq!(labels(&linear(&[0.13, 0.29])), ["0.10", "0.15", "0.20", "0.25", "0.30"]);
        let unrounded = Axis::linear([0.0, 9.7].into_iter(), 5, false);
        assert_eq!(labels(&unrounded), ["0", "2", "4", "6", "8"]);
        assert_eq!(unrounded.place(9.7), Some(1.0));
    }

    #[test]
    fn a_power_of_ten_is_taken_out_of_the_labels() {
        let small = linear(&[0.0, 4.2e-9]);
        assert_eq!((labels(&small), small.exponent), (vec!["0", "1", "2", "3", "4", "5"], -9));
        let large = linear(&[0.0, 3e7]);
        assert_eq!((labels(&large), large.exponent), (vec!["0", "10", "20", "30"], 6));
    }

    /// Labels must differ from each other and lie on the axis, whatever the numbers are.
    #[test]
    fn any_numbers_make_an_axis() {
        let edge = [0.0, -0.0, 1.0, 5e-324, -2e-308, f64::MAX, -f64::MAX, 1e-17, 123456.789, 123456.7890001];
        for a in edge {
            for b in edge.into_iter().chain([f64::NAN, f64::INFINITY, 1.0 + 1e-5, 1.0 + 1e-4]) {
                for rounded in [true, false] {
                    let axis = Axis::linear([a, b].into_iter(), 5, rounded);
                    let text = labels(&axis);
                    assert!((1..=12).contains(&text.len()), "{a:e} {b:e}: {text:?}");
                    assert!(text.windows(2).all(|w| w[0] != w[1]), "{a:e} {b:e}: {text:?}");
                    assert!(text.iter().all(|t| t.chars().count() <= 9), "{a:e} {b:e}: {text:?}");
                    let on_axis = |p: f64| (-1e-6..=1.0 + 1e-6).contains(&p);
                    assert!(axis.ticks.iter().all(|t| on_axis(t.0)), "{a:e} {b:e}: {axis:?}");
                    assert!(axis.place(a).is_some_and(on_axis), "{a:e} {b:e}: {axis:?}");
                }
            }
        }
        assert!(!linear(&[]).ticks.is_empty());
    }

    #[test]
    fn zeros_have_their_own_strip_on_a_logarithmic_axis() {
        let axis = Axis::logarithmic([0.0, 3e-16, 2e-13].into_iter());
        assert_eq!(labels(&axis), ["0", "10⁻¹⁶", "10⁻¹⁵", "10⁻¹⁴", "10⁻¹³", "10⁻¹²"]);
        assert_eq!(axis.place(0.0), Some(0.0));
        assert_eq!(axis.place(1e-16), axis.strip());
        assert!((axis.place(1e-12).unwrap() - 1.0).abs() < 4.0 * f64::EPSILON);
        assert_eq!((axis.place(-1.0), axis.place(f64::NAN)), (None, None));
    }

    #[test]
    fn a_few_tiny_values_do_not_press_the_others_together() {
        let many = (0..1000).map(|i| if i % 100 == 7 { 1e-32 } else { 2e-15 * f64::from(i + 1) });
        let axis = Axis::logarithmic(many);
        assert_eq!(labels(&axis), ["less", "10⁻¹⁴", "10⁻¹³", "10⁻¹²", "10⁻¹¹"]);
        assert_eq!((axis.place(1e-32), axis.place(1e-14)), (Some(0.0), axis.strip()));
        // Few values are all of interest.
        let convergence = Axis::logarithmic((2..14).map(|k| 10f64.powi(-k)));
        assert_eq!((convergence.place(1e-13), convergence.strip()), (Some(0.0), None));
    }

    #[test]
    fn any_numbers_make_a_logarithmic_axis() {
        for values in [vec![], vec![0.0], vec![1.0], vec![-3.0], vec![5e-324, f64::MAX], vec![f64::INFINITY]]
        {
            let axis = Axis::logarithmic(values.iter().copied());
            assert!((2..=9).contains(&axis.ticks.len()), "{values:?}: {axis:?}");
            assert!(axis.ticks.iter().all(|t| t.0.is_finite()), "{values:?}");
        }
    }
}
