// The recorded motion: bodies, frames, and points carried by bodies.
const data = JSON.parse(document.getElementById("drawing-data").textContent);
const bodies = data.bodies;
const frames = data.times.length;
const times = data.times.every((t, i) => t !== null && (i === 0 || t >= data.times[i - 1])) ? data.times : data.times.map((_, i) => i);
const poses = (() => {
  const letters = atob(data.poses);
  const view = new DataView(new ArrayBuffer(letters.length));
  for (let i = 0; i < letters.length; i++) view.setUint8(i, letters.charCodeAt(i));
  return Float32Array.from({ length: letters.length / 4 }, (_, i) => view.getFloat32(4 * i, true));
})();

// Point p of a pose (x y z qx qy qz qw at offset o of an array) in the axes of its parent.
function carried(pose, o, p) {
  const [x, y, z, w] = [pose[o + 3], pose[o + 4], pose[o + 5], pose[o + 6]];
  const tx = 2 * (y * p[2] - z * p[1]), ty = 2 * (z * p[0] - x * p[2]), tz = 2 * (x * p[1] - y * p[0]);
  return [
    pose[o] + p[0] + w * tx + y * tz - z * ty,
    pose[o + 1] + p[1] + w * ty + z * tx - x * tz,
    pose[o + 2] + p[2] + w * tz + x * ty - y * tx,
  ];
}
const inWorld = (frame, body, p) => carried(poses, 7 * (frame * bodies.length + body), p);
const center = (frame, body) => inWorld(frame, body, bodies[body].center);

// Segments between points of bodies: from (body a, point p) to (body b, point q).
const origin = [0, 0, 0];
const segments = [];
bodies.forEach((body, k) => {
  for (let i = 0; i + 5 < body.lines.length; i += 6) {
    segments.push({ a: k, p: body.lines.slice(i, i + 3), b: k, q: body.lines.slice(i + 3, i + 6) });
  }
  if (body.parent !== null) segments.push({ a: body.parent, p: origin, b: k, q: origin });
});

// Corners of each body's box; corner bits are the signs along its axes.
const boxes = bodies.map((body) => {
  if (!body.half) return null;
  const sign = (i, bit) => ((i >> bit) & 1 ? 1 : -1);
  return Array.from({ length: 8 }, (_, i) => carried(body.box, 0, body.half.map((h, bit) => sign(i, bit) * h)));
});
const boxEdges = [];
for (let i = 0; i < 8; i++) for (const bit of [1, 2, 4]) if (!(i & bit)) boxEdges.push([i, i | bit]);

const finite = (p) => p.every(Number.isFinite);
const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

function* pointsOf(frame) {
  for (const s of segments) { yield inWorld(frame, s.a, s.p); yield inWorld(frame, s.b, s.q); }
  for (let k = 0; k < bodies.length; k++) {
    yield center(frame, k);
    if (boxes[k]) for (const corner of boxes[k]) yield inWorld(frame, k, corner);
  }
}

// Every point that is drawn, of so many frames that framing stays quick.
const sampled = (() => {
  const every = Math.max(1, Math.ceil((frames * (2 * segments.length + 9 * bodies.length)) / 400000));
  const chosen = [];
  for (let f = 0; f < frames; f += every) chosen.push(f);
  if (chosen[chosen.length - 1] !== frames - 1) chosen.push(frames - 1);
  return chosen;
})();

// Size of the mechanism about its base, and how far the base travels.
const extent = (() => {
  const first = center(0, 0);
  let size = 0, travel = 0;
  for (const f of sampled) {
    const base = center(f, 0);
    if (!finite(base)) continue;
    if (finite(first)) travel = Math.max(travel, distance(base, first));
    for (const p of pointsOf(f)) if (finite(p)) size = Math.max(size, distance(p, base));
  }
  return { size: size || 1, travel };
})();
