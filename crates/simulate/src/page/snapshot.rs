//! Several moments of a motion in one static picture: earlier ones faint, the last one strong.

use super::{Drawing, escape};
use phipsi_spatial::{Quaternion, Transform, Vec3};
use std::fmt::Write;

/// Where the picture is looked at from, and its size.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Direction of the eye about z, from x, rad.
    pub azimuth: f64,
    /// Direction of the eye above the x-y plane, rad.
    pub elevation: f64,
    /// Width of the picture, pixels.
    pub width: f64,
    /// Height of the picture, pixels.
    pub height: f64,
    /// Draws the boxes of the last moment, too.
    pub boxes: bool,
}

impl Default for View {
    fn default() -> Self {
        View { azimuth: -1.05, elevation: 0.4, width: 640.0, height: 400.0, boxes: true }
    }
}

const STYLE: &str = "\
    .l{stroke:#1c2126}.b{stroke:#7f97b0}.d{fill:#1d6fb8}\
    @media(prefers-color-scheme:dark){.l{stroke:#e4e8ec}.b{stroke:#5d7389}.d{fill:#6cb6ff}}";

type Point = [f64; 2];

/// One frame, projected.
struct Picture {
    /// Line segments and their nearness.
    lines: Vec<(f64, [Point; 2])>,
    boxes: Vec<[Point; 2]>,
    dots: Vec<(Point, f64)>,
}

/// Frames of a drawing in one SVG, which serves light and dark pages. Frames that the drawing lacks are passed over.
pub fn snapshot_svg(drawing: &Drawing, frames: &[usize], view: &View) -> String {
    let (width, height) = (view.width.max(16.0), view.height.max(16.0));
    let pictures: Vec<Picture> =
        frames.iter().filter(|f| **f < drawing.frames()).map(|f| project(drawing, *f, view)).collect();
    let (middle, scale) = fit(&pictures, width, height);
    let at = |p: Point| {
        let tenth = |x: f64| (x * 10.0).round() / 10.0;
        let x = tenth(width / 2.0 + scale * (p[0] - middle[0]));
        format!("{x} {}", tenth(height / 2.0 - scale * (p[1] - middle[1])))
    };
    let path = |lines: &mut dyn Iterator<Item = [Point; 2]>| -> String {
        lines.map(|[a, b]| format!("M{}L{}", at(a), at(b))).collect()
    };
    let names: Vec<&str> = drawing.bodies.iter().take(1).map(|b| b.name.as_str()).collect();
    let about = format!("{} moments of the motion of {}", pictures.len(), names.concat());
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         role=\"img\" aria-label=\"{}\" fill=\"none\" stroke-linecap=\"round\"><style>{STYLE}</style>",
        escape(&about)
    );
    let heaviest = drawing.bodies.iter().map(|b| b.mass).filter(|m| m.is_finite()).fold(0.0, f32::max);
    // Dots shrink where there are many.
    let largest_dot = 7.0 * (12.0 / drawing.bodies.len().max(1) as f64).sqrt().clamp(0.2, 1.0);
    let last = pictures.len().saturating_sub(1);
    for (i, picture) in pictures.iter().enumerate() {
        // Ghosts grow stronger towards the last moment.
        let (opacity, thick) =
            if i == last { (1.0, 2.8) } else { (0.2 + 0.25 * (i + 1) as f64 / pictures.len() as f64, 2.0) };
        let _ = write!(out, r#"<g opacity="{opacity:.2}">"#);
        if view.boxes && i == last {
            let d = path(&mut picture.boxes.iter().copied());
            let _ = write!(out, r#"<path class="b" stroke-width="1" d="{d}"/>"#);
        }
        let d = path(&mut picture.lines.iter().map(|l| l.1));
        let _ = write!(out, r#"<path class="l" stroke-width="{thick}" d="{d}"/>"#);
        for (p, mass) in picture.dots.iter().filter(|d| d.1 > 0.0) {
            let radius = (largest_dot * (mass / f64::from(heaviest)).cbrt()).max(1.2);
            let (x, y) =
                at(*p).split_once(' ').map(|(x, y)| (x.to_string(), y.to_string())).unwrap_or_default();
            let _ = write!(out, r#"<circle class="d" cx="{x}" cy="{y}" r="{radius:.1}"/>"#);
        }
        out.push_str("</g>");
    }
    out.push_str("</svg>");
    out
}

fn project(drawing: &Drawing, frame: usize, view: &View) -> Picture {
    let ((sa, ca), (se, ce)) = (view.azimuth.sin_cos(), view.elevation.sin_cos());
    let [right, up, toward] = [[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]].map(Vec3);
    let flat = |p: Vec3<f64>| [p.dot(right), p.dot(up)];
    let poses: Vec<Transform<f64>> = drawing.frame(frame).chunks_exact(7).map(transform).collect();
    let mut picture = Picture { lines: Vec::new(), boxes: Vec::new(), dots: Vec::new() };
    let mut line = |a: Vec3<f64>, b: Vec3<f64>| {
        if finite(a) && finite(b) {
            picture.lines.push((toward.dot(a + b), [flat(a), flat(b)]));
        }
    };
    for (k, body) in drawing.bodies.iter().enumerate() {
        let pose = &poses[k];
        for [a, b] in &body.lines {
            line(pose.point(point(a)), pose.point(point(b)));
        }
        if let Some(p) = drawing.parent(k) {
            line(poses[p].translation, pose.translation);
        }
    }
    for (k, body) in drawing.bodies.iter().enumerate() {
        let center = poses[k].point(point(&body.center));
        if finite(center) {
            picture.dots.push((flat(center), f64::from(body.mass)));
        }
        let Some(half) = body.box_half else { continue };
        let at = poses[k].compose(&transform(&body.box_pose));
        let corner = |i: usize| {
            let side =
                |bit: usize| if i >> bit & 1 == 1 { f64::from(half[bit]) } else { -f64::from(half[bit]) };
            at.point(Vec3([side(0), side(1), side(2)]))
        };
        if (0..8).all(|i| finite(corner(i))) {
            let edges = (0..8).flat_map(|i| [1, 2, 4].map(|bit| (i, i | bit))).filter(|(i, j)| i != j);
            picture.boxes.extend(edges.map(|(i, j)| [flat(corner(i)), flat(corner(j))]));
        }
    }
    picture.lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    picture
}

/// Middle of everything drawn, and pixels per unit that fit it into the picture.
fn fit(pictures: &[Picture], width: f64, height: f64) -> (Point, f64) {
    let points = || {
        pictures.iter().flat_map(|p| {
            let lines = p.lines.iter().map(|l| l.1).chain(p.boxes.iter().copied());
            lines.flatten().chain(p.dots.iter().map(|d| d.0))
        })
    };
    let limits =
        |i: usize| points().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p[i]), b.max(p[i])));
    let ((left, right), (low, high)) = (limits(0), limits(1));
    if left > right {
        return ([0.0; 2], 1.0);
    }
    const MARGIN: f64 = 12.0;
    let scale = |room: f64, size: f64| (room - 2.0 * MARGIN).max(1.0) / size.max(f64::MIN_POSITIVE);
    let scale = scale(width, right - left).min(scale(height, high - low));
    let usable = if scale.is_finite() && scale < 1e30 { scale } else { 1.0 };
    ([(left + right) / 2.0, (low + high) / 2.0], usable)
}

fn transform(pose: &[f32]) -> Transform<f64> {
    let p = |i: usize| f64::from(pose[i]);
    let rotation = Quaternion([p(3), p(4), p(5), p(6)]).normalized().to_rotation();
    Transform::new(rotation, Vec3([p(0), p(1), p(2)]))
}

fn point(p: &[f32; 3]) -> Vec3<f64> {
    Vec3(p.map(f64::from))
}

fn finite(p: Vec3<f64>) -> bool {
    p.0.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::super::{DrawnBody, IDENTITY_POSE};
    use super::*;

    fn two_bodies() -> Drawing {
        let moved = |x: f32| [x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let base = DrawnBody { mass: 2.0, box_half: Some([0.1, 0.2, 0.3]), ..DrawnBody::default() };
        let link = DrawnBody {
            parent: Some(0),
            lines: vec![[[0.0; 3], [0.5, 0.0, 0.0]]],
            center: [0.5, 0.0, 0.0],
            mass: 1.0,
            ..DrawnBody::default()
        };
        Drawing {
            bodies: vec![base, link],
            times: vec![0.0, 1.0],
            poses: [IDENTITY_POSE, moved(1.0), moved(0.5), moved(2.0)].concat(),
            unit: "m".into(),
        }
    }

    /// From −y, x goes right and z up: the drawn lengths are the true ones times one scale.
    #[test]
    fn the_view_along_y_shows_x_and_z() {
        let view = View { azimuth: -std::f64::consts::FRAC_PI_2, elevation: 0.0, ..View::default() };
        let picture = project(&two_bodies(), 0, &view);
        let wide = |p: [Point; 2]| (p[1][0] - p[0][0]).abs();
        let mut lengths: Vec<f64> = picture.lines.iter().map(|l| wide(l.1)).collect();
        lengths.sort_by(f64::total_cmp);
        assert!((lengths[0] - 0.5).abs() < 1e-15 && (lengths[1] - 1.0).abs() < 1e-15, "{lengths:?}");
        assert_eq!(picture.boxes.len(), 12);
        let highest = picture.boxes.iter().flatten().map(|p| p[1]).fold(0.0, f64::max);
        assert!((highest - f64::from(0.3f32)).abs() < 1e-15);
    }

    #[test]
    fn everything_lies_inside_and_earlier_frames_are_fainter() {
        let svg = snapshot_svg(&two_bodies(), &[0, 1, 9], &View::default());
        assert_eq!(svg.matches("<g ").count(), 2);
        let opacity: Vec<f64> =
            svg.split("opacity=\"").skip(1).map(|t| t.split('"').next().unwrap().parse().unwrap()).collect();
        assert!(opacity[0] < 0.5 && opacity[1] == 1.0);
        for pair in svg.split(" d=\"").skip(1).flat_map(|d| d.split('"').next().unwrap().split(['M', 'L'])) {
            let Some((x, y)) = pair.split_once(' ') else { continue };
            let (x, y): (f64, f64) = (x.parse().unwrap(), y.parse().unwrap());
            assert!((0.0..=640.0).contains(&x) && (0.0..=400.0).contains(&y), "{pair}");
        }
    }

    #[test]
    fn nothing_and_nonsense_make_a_picture() {
        assert!(snapshot_svg(&Drawing::default(), &[0], &View::default()).ends_with("</svg>"));
        let mut broken = two_bodies();
        broken.poses[0] = f32::NAN;
        broken.poses[10..14].fill(0.0);
        let svg = snapshot_svg(&broken, &[0, 1], &View { width: f64::NAN, ..View::default() });
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
