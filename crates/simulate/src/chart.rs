//! Charts as SVG: lines over a linear or logarithmic axis, readable alone and inside the page of a run.

mod axis;
mod legend;
mod thin;

use crate::page::escape;
use axis::{Axis, power_of_ten};
use legend::Legend;
use std::fmt::Write;
use thin::{is_finite, thin};

/// A chart of one or more curves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Written above.
    pub title: String,
    /// Quantity and unit along x. Where it begins with "time", the page marks the moment that its drawing shows.
    pub x_label: String,
    /// Quantity and unit along y.
    pub y_label: String,
    /// Logarithmic y axis; exact zeros (and a few values far below all others) are drawn in a strip below it, negative
    /// values leave gaps.
    pub log_y: bool,
    /// Logarithmic x axis; points are then few and each of them is marked.
    pub log_x: bool,
    /// The curves.
    pub series: Vec<Series>,
}

/// One curve.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Points in their order; those that are not finite leave gaps.
    pub points: Vec<(f64, f64)>,
}

/// Most points drawn of one curve.
const MOST_POINTS: usize = 1000;
/// Most points drawn of one chart, if that leaves `FEWEST_POINTS` for each curve.
const MOST_POINTS_IN_ALL: usize = 40_000;
const FEWEST_POINTS: usize = 100;
/// Width of the picture; a letter of 12 units is easy to read where it is shown 350 to 550 pixels wide.
const WIDTH: f64 = 400.0;
const PLOT_TOP: f64 = 42.0;
const PLOT_HEIGHT: f64 = 190.0;
/// Mean width of a letter and of a digit at 12 units.
const LETTER: f64 = 6.6;
/// Colours on white; the page gives its own by the classes c0 … c9.
const COLORS: [&str; 10] = [
    "#1d6fb8", "#d2560b", "#23843b", "#7b3fc4", "#c2185b", "#00838f", "#7a7a00", "#8d5a3b", "#5f6b76",
    "#303f9f",
];
/// After ten curves colours repeat with another dash.
const DASHES: [&str; 4] = ["", "6 3", "2 3", "9 3 2 3"];

impl Chart {
    /// The chart as one `<svg>` element. `id` begins the ids inside it: unique on its page, letters and digits.
    pub fn to_svg(&self, id: &str) -> String {
        let frame = Frame::new(self);
        // A single curve that the title names needs no legend.
        let named = matches!(&self.series[..], [one] if self.title.contains(&one.name));
        let explained = if named { &[] } else { &self.series[..] };
        let legend = Legend::new(explained.iter().map(|s| s.name.as_str()));
        let height = frame.bottom + 38.0 + legend.height;
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"chart\" viewBox=\"0 0 {WIDTH} {height}\" \
             role=\"img\" aria-label=\"{}\" font-family=\"system-ui, sans-serif\" font-size=\"12\"",
            escape(&self.description())
        );
        if self.x_label.starts_with("time") {
            let (low, high) = frame.x.limits();
            let _ = write!(out, r#" data-time="{low:e} {high:e} {:.2} {:.2}""#, frame.left, frame.right);
        }
        let _ = write!(
            out,
            r#"><text class="chart-title" x="0" y="14" font-size="14" font-weight="600">{}</text>"#,
            escape(&legend::shortened(&self.title, 50))
        );
        frame.write_axes(self, &mut out);
        let mut ends = Vec::new();
        for (i, series) in self.series.iter().enumerate() {
            ends.extend(frame.write_series(series, i, self.series.len(), id, &mut out).map(|y| (y, i)));
            if self.log_x {
                frame.write_dots(series, i, &mut out);
            }
        }
        if self.series.len() > COLORS.len() {
            frame.write_end_numbers(ends, &mut out);
        }
        frame.write_note(self, &mut out);
        if self.x_label.starts_with("time") {
            let _ = write!(
                out,
                r##"<path class="cursor" d="M0 {PLOT_TOP}V{}" stroke="#888" visibility="hidden"/>"##,
                frame.bottom
            );
        }
        legend.write(frame.bottom + 50.0, &mut out);
        out.push_str("</svg>");
        out
    }

    /// What a reader hears who does not see the chart.
    fn description(&self) -> String {
        let count = match self.series.len() {
            1 => "1 curve".into(),
            n => format!("{n} curves"),
        };
        format!("{}: {} against {}, {count}", self.title, self.y_label, self.x_label)
    }
}

/// Class and attributes of the i-th curve's stroke.
fn stroke(i: usize) -> String {
    let dash = DASHES[i / COLORS.len() % DASHES.len()];
    let dash = if dash.is_empty() { String::new() } else { format!(r#" stroke-dasharray="{dash}""#) };
    format!(r#"class="c{0}" stroke="{1}"{dash}"#, i % COLORS.len(), COLORS[i % COLORS.len()])
}

/// The axes and where they lie in the picture.
struct Frame {
    x: Axis,
    y: Axis,
    left: f64,
    right: f64,
    bottom: f64,
}

impl Frame {
    fn new(chart: &Chart) -> Frame {
        let finite = || chart.series.iter().flat_map(|s| &s.points).filter(|p| is_finite(p));
        let values = finite().map(|p| p.1);
        let y = if chart.log_y { Axis::logarithmic(values) } else { Axis::linear(values, 5, true) };
        let mut count = 7;
        let mut x = match chart.log_x {
            true => Axis::logarithmic(finite().map(|p| p.0)),
            false => Axis::linear(finite().map(|p| p.0), count, false),
        };
        // Labels of x need room beside each other.
        while !chart.log_x && count > 2 && widest(&x) + 1.5 > 46.0 / x.ticks.len().max(1) as f64 {
            count -= 1;
            x = Axis::linear(finite().map(|p| p.0), count, false);
        }
        let numbers = if chart.series.len() > COLORS.len() { 20.0 } else { 0.0 };
        Frame {
            left: (widest(&y) * LETTER + 9.0).max(30.0),
            right: WIDTH - 10.0 - numbers,
            bottom: PLOT_TOP + PLOT_HEIGHT,
            x,
            y,
        }
    }
    fn across(&self, place: f64) -> f64 {
        self.left + place * (self.right - self.left)
    }
    fn up(&self, place: f64) -> f64 {
        self.bottom - place * PLOT_HEIGHT
    }

    fn write_axes(&self, chart: &Chart, out: &mut String) {
        let (left, right, bottom) = (self.left, self.right, self.bottom);
        let line = |out: &mut String, class: &str, color: &str, [x1, y1, x2, y2]: [f64; 4]| {
            let _ = write!(
                out,
                r#"<path class="{class}" stroke="{color}" d="M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}"/>"#
            );
        };
        for place in &self.y.minor {
            line(out, "axis", "#999", [left - 3.0, self.up(*place), left, self.up(*place)]);
        }
        for place in &self.x.minor {
            line(out, "axis", "#999", [self.across(*place), bottom, self.across(*place), bottom + 3.0]);
        }
        for (place, text) in &self.y.ticks {
            let y = self.up(*place);
            line(out, "grid", "#e3e3e3", [left, y, right, y]);
            let (x, y) = (left - 5.0, y + 4.0);
            let _ = write!(out, r#"<text x="{x:.1}" y="{y:.1}" text-anchor="end">{text}</text>"#);
        }
        for (place, text) in &self.x.ticks {
            let x = self.across(*place);
            line(out, "axis", "#999", [x, bottom, x, bottom + 4.0]);
            let y = bottom + 17.0;
            let _ = write!(out, r#"<text x="{x:.1}" y="{y:.1}" text-anchor="middle">{text}</text>"#);
        }
        if let Some(floor) = self.y.strip() {
            let y = self.up(floor / 2.0);
            line(out, "axis", "#999", [left - 3.0, y - 2.0, left + 3.0, y + 2.0]);
        }
        line(out, "axis", "#999", [left, bottom, right, bottom]);
        line(out, "axis", "#999", [left, PLOT_TOP, left, bottom]);
        let y_label = escape(&label(&chart.y_label, self.y.exponent));
        let _ = write!(out, r#"<text class="label" x="0" y="32">{y_label}</text>"#);
        let (x, y) = ((left + right) / 2.0, bottom + 33.0);
        let x_label = escape(&label(&chart.x_label, self.x.exponent));
        let _ =
            write!(out, r#"<text class="label" x="{x:.1}" y="{y:.1}" text-anchor="middle">{x_label}</text>"#);
    }

    /// Writes a curve; returns the height of its last point.
    fn write_series(
        &self,
        series: &Series,
        i: usize,
        count: usize,
        id: &str,
        out: &mut String,
    ) -> Option<f64> {
        let limit = (MOST_POINTS_IN_ALL / count).clamp(FEWEST_POINTS, MOST_POINTS);
        let drawable = |(x, y): (f64, f64)| match (self.x.place(x), self.y.place(y)) {
            (Some(a), Some(b)) => (self.across(a), self.up(b)),
            _ => (f64::NAN, f64::NAN),
        };
        let points: Vec<(f64, f64)> = series.points.iter().map(|p| drawable(*p)).collect();
        let path = path(&thin(&points, limit));
        let name = escape(&series.name);
        let _ = write!(
            out,
            r#"<g class="series" fill="none" stroke-width="1.5" stroke-linejoin="round" stroke-linecap="round">"#
        );
        let _ = write!(out, r#"<title>{name}</title><path id="{id}s{i}" {} d="{path}"/>"#, stroke(i));
        // Unseen and wide, so that pointing need not be exact.
        out.push_str(r#"<use stroke-width="10" visibility="hidden" pointer-events="stroke""#);
        let _ = write!(out, r##" href="#{id}s{i}"/></g>"##);
        points.iter().rev().find(|p| is_finite(p)).map(|p| p.1)
    }

    /// Marks every point of a curve.
    fn write_dots(&self, series: &Series, i: usize, out: &mut String) {
        let mut d = String::new();
        for (x, y) in &series.points {
            if let (Some(a), Some(b)) = (self.x.place(*x), self.y.place(*y)) {
                let _ = write!(d, "M{:.1} {:.1}h0", self.across(a), self.up(b));
            }
        }
        // Strokes of length 0 with round ends are dots.
        let _ = write!(
            out,
            r#"<path {} fill="none" stroke-width="5" stroke-linecap="round" d="{d}"/>"#,
            stroke(i)
        );
    }

    /// Numbers of the curves at their ends, moved apart where they would overlap.
    fn write_end_numbers(&self, mut ends: Vec<(f64, usize)>, out: &mut String) {
        const APART: f64 = 9.0;
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        let room = (PLOT_HEIGHT / APART) as usize + 1;
        if ends.len() > room {
            // Too many to write each: evenly chosen ones; the legend and hovering name the others.
            let n = ends.len();
            ends = (0..room).map(|k| ends[k * (n - 1) / (room - 1)]).collect();
        }
        let mut place = f64::NEG_INFINITY;
        let mut at: Vec<f64> = Vec::new();
        for (y, _) in &ends {
            place = y.max(place + APART).max(PLOT_TOP);
            at.push(place);
        }
        let mut place = self.bottom + APART;
        for y in at.iter_mut().rev() {
            place = y.min(place - APART);
            *y = place;
        }
        for ((end, i), y) in ends.iter().zip(at) {
            let (x, color, rise) = (self.right, stroke(*i), y - end);
            let _ = write!(
                out,
                r#"<path {color} stroke-width="0.7" fill="none" d="M{x:.1} {end:.1}l8 {rise:.1}"/>"#
            );
            let (x, y, number) = (x + 10.0, y + 3.0, i + 1);
            let _ = write!(out, r#"<text x="{x:.1}" y="{y:.1}" font-size="9">{number}</text>"#);
        }
    }

    /// Says in the plot what it cannot show.
    fn write_note(&self, chart: &Chart, out: &mut String) {
        let points = || chart.series.iter().flat_map(|s| &s.points);
        let negative = points().filter(|p| chart.log_y && is_finite(p) && p.1 < 0.0).count();
        let note = if !points().any(is_finite) {
            "no data".to_string()
        } else if chart.log_y && points().filter(|p| is_finite(p)).all(|p| p.1 == 0.0) {
            "all values are exactly 0".into()
        } else if negative > 0 {
            format!("{negative} negative values not shown")
        } else {
            return;
        };
        let (x, y) = ((self.left + self.right) / 2.0, PLOT_TOP + 14.0);
        let _ = write!(out, r#"<text class="note" x="{x:.1}" y="{y:.1}" text-anchor="middle">{note}</text>"#);
    }
}

fn widest(axis: &Axis) -> f64 {
    axis.ticks.iter().map(|t| t.1.chars().count()).max().unwrap_or(0) as f64
}

/// An axis label with the power of ten that the tick labels leave out.
fn label(text: &str, exponent: i32) -> String {
    if exponent == 0 { text.into() } else { format!("{text}  × {}", power_of_ten(exponent)) }
}

/// Path data in tenths of a unit, relative, a new stroke after each gap.
fn path(points: &[(f64, f64)]) -> String {
    let mut d = String::new();
    let mut last: Option<(i64, i64)> = None;
    let mut alone = false;
    for p in points {
        if !is_finite(p) {
            if alone {
                d.push_str("h0");
            }
            (last, alone) = (None, false);
            continue;
        }
        let at = ((p.0 * 10.0).round() as i64, (p.1 * 10.0).round() as i64);
        match last {
            None => {
                let _ = write!(d, "M{} {}", tenths(at.0), tenths(at.1));
                alone = true;
            }
            Some(from) if from == at => {}
            Some(from) => {
                let (dx, dy) = (tenths(at.0 - from.0), tenths(at.1 - from.1));
                let gap = if dy.starts_with('-') { "" } else { " " };
                let _ = write!(d, "l{dx}{gap}{dy}");
                alone = false;
            }
        }
        last = Some(at);
    }
    // A stroke of length 0 with round ends is a dot.
    if alone {
        d.push_str("h0");
    }
    d
}

fn tenths(n: i64) -> String {
    let (sign, n) = (if n < 0 { "-" } else { "" }, n.abs());
    match (n / 10, n % 10) {
        (whole, 0) => format!("{sign}{whole}"),
        (0, part) => format!("{sign}.{part}"),
        (whole, part) => format!("{sign}{whole}.{part}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(log_y: bool, curves: Vec<Vec<(f64, f64)>>) -> Chart {
        let series = |(i, points)| Series { name: format!("curve {i}"), points };
        Chart {
            title: "title".into(),
            x_label: "time, s".into(),
            y_label: "rad".into(),
            log_y,
            log_x: false,
            series: curves.into_iter().enumerate().map(series).collect(),
        }
    }
    /// The picture is well-formed XML and no number in it is NaN or infinite.
    fn checked(chart: &Chart) -> String {
        let svg = chart.to_svg("a");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        let mut open = Vec::new();
        for tag in svg.split('<').skip(1) {
            let name = tag.split([' ', '>', '/']).next().unwrap();
            if let Some(closed) = tag.strip_prefix('/') {
                assert_eq!(open.pop(), closed.split('>').next(), "{svg}");
            } else if !tag.split('>').next().unwrap().ends_with('/') {
                open.push(name);
            }
        }
        assert!(open.is_empty(), "{open:?}");
        svg
    }

    #[test]
    fn empty_and_constant_and_broken_data_make_a_chart() {
        assert!(checked(&chart(false, vec![])).contains("no data"));
        assert!(checked(&chart(true, vec![vec![], vec![]])).contains("no data"));
        assert!(
            checked(&chart(false, vec![vec![(f64::NAN, 1.0), (0.0, f64::INFINITY)]])).contains("no data")
        );
        assert!(checked(&chart(true, vec![vec![(0.0, 0.0), (1.0, 0.0)]])).contains("exactly 0"));
        assert!(checked(&chart(true, vec![vec![(0.0, -1.0), (1.0, 2.0)]])).contains("1 negative"));
        checked(&chart(false, vec![vec![(0.0, 3.0), (1.0, 3.0)]]));
        checked(&chart(false, vec![vec![(f64::MAX, f64::MAX), (-f64::MAX, -f64::MAX)]]));
    }

    #[test]
    fn a_chart_with_two_logarithmic_axes_marks_its_points() {
        let points = vec![(1e-3, 1e-2), (1e-2, 1e-5), (0.0, 0.0), (f64::NAN, 1.0), (1.0, 1e-12)];
        let chart = Chart { log_x: true, x_label: "wall time, s".into(), ..chart(true, vec![points]) };
        let svg = checked(&chart);
        let dots = svg.split("stroke-width=\"5\"").nth(1).unwrap().split("/>").next().unwrap();
        assert_eq!(dots.matches("h0").count(), 4, "{svg}");
        assert!(svg.contains("10⁻³") && svg.contains("10⁻¹²"), "{svg}");
    }

    #[test]
    fn gaps_split_a_curve_and_a_single_point_is_a_dot() {
        let nan = f64::NAN;
        assert_eq!(path(&[(0.0, 0.0), (1.0, -2.5), (nan, nan), (3.0, 4.0)]), "M0 0l1-2.5M3 4h0");
        assert_eq!(path(&[(0.04, 0.0), (0.0, 0.04), (10.0, 0.0)]), "M0 0l10 0");
    }

    #[test]
    fn ten_thousand_points_of_thirty_curves_stay_small() {
        let curve =
            |k: usize| (0..10_000).map(|i| (i as f64 * 1e-3, (i as f64 * 0.1 + k as f64).sin())).collect();
        let svg = checked(&chart(false, (0..30).map(curve).collect()));
        // A relative step takes at most "l400.0-190.0".
        assert!(svg.len() < 30 * MOST_POINTS * 12 + 20_000, "{}", svg.len());
        assert_eq!(svg.matches("<title>").count(), 30);
    }

    #[test]
    fn names_are_escaped() {
        let mut c = chart(false, vec![vec![(0.0, 1.0)], vec![(0.0, 2.0)]]);
        c.series[0].name = "</svg><script>\"&'\u{1}".into();
        let svg = checked(&c);
        assert!(svg.contains("&lt;/svg&gt;&lt;script&gt;&quot;&amp;&#39;\u{fffd}"), "{svg}");
    }

    #[test]
    fn numbers_at_the_ends_keep_apart() {
        let curves = (0..40).map(|k| vec![(0.0, 0.0), (1.0, 1e-6 * k as f64 + 1.0)]).collect();
        let svg = checked(&chart(false, curves));
        let heights: Vec<f64> = svg
            .split("<text ")
            .filter(|t| t.contains(r#"font-size="9">"#))
            .map(|t| t.split("y=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap())
            .collect();
        assert!(heights.len() > 20 && heights.windows(2).all(|w| w[1] - w[0] > 8.8), "{heights:?}");
    }
}
