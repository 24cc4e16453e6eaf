// The picture: an orthographic view with z up, drawn on the canvas.
const canvas = document.getElementById("canvas");
const pen = canvas.getContext("2d");
const view = {
  azimuth: -1.05, elevation: 0.4, zoom: 1, right: 0, up: 0,
  frame: 0, follow: extent.travel > 4 * extent.size, boxes: true, marked: null,
  // Half width and half height of what the picture shows at zoom 1.
  half: [1, 1],
};
const few = bodies.length <= 300;
// Marks shrink where there are many.
const markSize = Math.max(0.2, Math.min(1, Math.sqrt(12 / bodies.length)));
const heaviest = Math.max(0, ...bodies.map((b) => b.mass || 0)) || 1;
let shown = [];

function color(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

// The axes of the picture and what its middle shows.
function camera(frame = view.frame) {
  const [ca, sa, ce, se] = [Math.cos(view.azimuth), Math.sin(view.azimuth), Math.cos(view.elevation), Math.sin(view.elevation)];
  const width = canvas.clientWidth, height = canvas.clientHeight, base = center(frame, 0);
  return {
    right: [-sa, ca, 0], up: [-se * ca, -se * sa, ce], toward: [ce * ca, ce * sa, se],
    width, height, target: view.follow && finite(base) ? base : origin,
    scale: Math.min((0.44 * width) / view.half[0], (0.42 * height) / view.half[1]) * view.zoom,
  };
}
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const relative = (cam, p) => p.map((x, i) => x - cam.target[i]);
// Pixels across and down, and the depth in sizes of the mechanism, nearer positive.
function project(cam, p) {
  const d = relative(cam, p), across = dot(d, cam.right) - view.right, up = dot(d, cam.up) - view.up;
  return [cam.width / 2 + cam.scale * across, cam.height / 2 - cam.scale * up, dot(d, cam.toward) / extent.size];
}

// Moves and zooms so that the whole motion fits, seen from the present side.
function fit() {
  const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
  for (const f of sampled) {
    const cam = camera(f);
    for (const p of pointsOf(f)) {
      const d = relative(cam, p);
      [dot(d, cam.right), dot(d, cam.up)].forEach((x, i) => {
        if (Number.isFinite(x)) { low[i] = Math.min(low[i], x); high[i] = Math.max(high[i], x); }
      });
    }
  }
  view.zoom = 1;
  if (!finite(low)) return;
  [view.right, view.up] = low.map((x, i) => (x + high[i]) / 2);
  const least = Math.max(high[0] - low[0], high[1] - low[1]) / 50 || 1;
  view.half = low.map((x, i) => Math.max(high[i] - x, least) / 2);
}

function line(a, b, style, width, alpha) {
  pen.globalAlpha = alpha;
  pen.strokeStyle = style;
  pen.lineWidth = width;
  pen.beginPath();
  pen.moveTo(a[0], a[1]);
  pen.lineTo(b[0], b[1]);
  pen.stroke();
}
function disc(at, radius, fill, stroke) {
  pen.globalAlpha = 1;
  pen.beginPath();
  pen.arc(at[0], at[1], radius, 0, 2 * Math.PI);
  if (fill) { pen.fillStyle = fill; pen.fill(); }
  if (stroke) { pen.strokeStyle = stroke; pen.lineWidth = 1.5; pen.stroke(); }
}
function text(words, x, y, style, align) {
  pen.globalAlpha = 1;
  pen.fillStyle = style;
  pen.textAlign = align;
  pen.fillText(words, x, y);
}

function draw() {
  const ratio = window.devicePixelRatio || 1, cam = camera(), f = view.frame;
  const [w, h] = [Math.round(cam.width * ratio), Math.round(cam.height * ratio)];
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, cam.width, cam.height);
  pen.lineCap = "round";
  pen.font = "12px system-ui, sans-serif";
  const ink = Object.fromEntries(["ink", "faint", "box", "accent", "c0", "c2", "c4", "panel", "axis"].map((n) => [n, color(n)]));
  drawOrigin(cam, ink);
  if (view.boxes) drawBoxes(cam, f, ink);
  drawSegments(cam, f, ink);
  shown = bodies.map((body, k) => drawBody(cam, f, body, k, ink));
  drawTriad(cam, ink);
  drawScale(cam, ink);
  if (view.marked !== null) drawMarked(cam, ink);
  pen.globalAlpha = 1;
}

// The world's axes at the world's origin.
function drawOrigin(cam, ink) {
  const length = roundLength(0.2 * extent.size), from = project(cam, origin);
  for (let i = 0; i < 3; i++) {
    const tip = [0, 0, 0];
    tip[i] = length;
    line(from, project(cam, tip), ink.axis, 1, 0.7);
  }
}

function drawBoxes(cam, f, ink) {
  boxes.forEach((corners, k) => {
    if (!corners) return;
    const at = corners.map((c) => project(cam, inWorld(f, k, c)));
    if (!at.every(finite)) return;
    const marked = k === view.marked, base = bodies[k].parent === null;
    for (const [i, j] of boxEdges) {
      line(at[i], at[j], marked ? ink.accent : base ? ink.c0 : ink.box, base || marked ? 1.4 : 1, base ? 0.75 : 0.9);
    }
  });
}

function drawSegments(cam, f, ink) {
  const drawn = segments.map((s) => ({ s, a: project(cam, inWorld(f, s.a, s.p)), b: project(cam, inWorld(f, s.b, s.q)) }));
  const visible = drawn.filter((d) => finite(d.a) && finite(d.b));
  visible.sort((d, e) => d.a[2] + d.b[2] - e.a[2] - e.b[2]);
  const middles = visible.map((d) => (d.a[2] + d.b[2]) / 2), low = middles[0], high = middles[middles.length - 1];
  for (const { s, a, b } of visible) {
    // What is nearer is stronger.
    const depth = Math.min(1, Math.max(0, ((a[2] + b[2]) / 2 - low) / (high - low || 1)));
    line(a, b, s.a === view.marked ? ink.accent : ink.ink, few ? 2.6 : 1.6, 0.45 + 0.55 * depth);
  }
}

// Joint and centre of mass of a body; returns where pointing finds it.
function drawBody(cam, f, body, k, ink) {
  const joint = project(cam, inWorld(f, k, origin)), mass = project(cam, center(f, k));
  if (!finite(joint) || !finite(mass)) return null;
  if (few && body.parent !== null) disc(joint, Math.max(1.6, 3.2 * markSize), ink.panel, ink.ink);
  if (body.mass > 0) {
    disc(mass, Math.max(few ? 1.8 : 1.2, 9 * markSize * Math.cbrt(body.mass / heaviest)), k === view.marked ? ink.accent : ink.c0);
  }
  return { joint, mass };
}

// The directions of the world's axes, in the corner.
function drawTriad(cam, ink) {
  const at = [38, cam.height - 38];
  const axes = ["x", "y", "z"].map((name, i) => ({ name, x: cam.right[i], y: -cam.up[i], depth: cam.toward[i], style: [ink.c4, ink.c2, ink.c0][i] }));
  axes.sort((a, b) => a.depth - b.depth);
  for (const a of axes) {
    line(at, [at[0] + 22 * a.x, at[1] + 22 * a.y], a.style, 2, 1);
    text(a.name, at[0] + 31 * a.x, at[1] + 31 * a.y + 4, a.style, "center");
  }
}

function roundLength(longest) {
  const ten = 10 ** Math.floor(Math.log10(longest));
  return ten * [5, 2, 1].find((m) => m * ten <= longest);
}
function drawScale(cam, ink) {
  const length = roundLength((0.25 * cam.width) / cam.scale), right = cam.width - 16, y = cam.height - 16;
  const left = right - length * cam.scale;
  for (const [a, b] of [[[left, y], [right, y]], [[left, y - 4], [left, y + 4]], [[right, y - 4], [right, y + 4]]]) line(a, b, ink.faint, 1.2, 1);
  text(`${Number(length.toPrecision(1))} ${data.unit}`, (left + right) / 2, y - 7, ink.faint, "center");
}

// The name of the body that is pointed at, and the path of its centre of mass.
function drawMarked(cam, ink) {
  const body = bodies[view.marked], at = shown[view.marked];
  let last = null;
  for (let f = 0; f < frames && !view.follow; f++) {
    const p = project(cam, center(f, view.marked));
    if (last && finite(p)) line(last, p, ink.accent, 1, 0.55);
    last = finite(p) ? p : null;
  }
  if (!at) return;
  const unit = data.unit === "nm" ? "Da" : "kg";
  const mass = body.mass > 0 && `${Number(body.mass.toPrecision(4))} ${unit}`;
  const words = [body.name, body.joint && `joint ${body.joint}`, mass].filter(Boolean).join(" · ");
  const width = pen.measureText(words).width + 12;
  const x = Math.max(4, Math.min(cam.width - width - 4, at.mass[0] + 12)), y = Math.max(4, at.mass[1] - 30);
  pen.globalAlpha = 0.92;
  pen.fillStyle = ink.panel;
  pen.fillRect(x, y, width, 20);
  pen.strokeStyle = ink.axis;
  pen.lineWidth = 1;
  pen.strokeRect(x, y, width, 20);
  text(words, x + 6, y + 14, ink.ink, "left");
}

// The body nearest to a point of the canvas, if it is near.
function bodyAt(x, y) {
  let best = null, least = 14;
  shown.forEach((at, k) => {
    if (!at) return;
    for (const end of [at.mass, at.joint]) {
      const d = Math.hypot(end[0] - x, end[1] - y) + (end === at.joint ? 3 : 0);
      if (d < least) [best, least] = [k, d];
    }
  });
  return best;
}
