// Time, playing, turning, and the moment's mark in the charts.
const element = (id) => document.getElementById(id);
const [slider, clock, play, speed, follow] = ["time", "clock", "play", "speed", "follow"].map(element);
const duration = times[frames - 1] - times[0];
const decimals = Math.min(12, Math.max(0, duration > 0 ? 3 - Math.floor(Math.log10(duration)) : 3));
let playing = false, now = times[0], clockAt = 0, waiting = false;

// At most one drawing for each picture of the screen.
function redraw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => { waiting = false; draw(); });
}

function frameAt(t) {
  let low = 0, high = frames - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}
function showFrame(f) {
  view.frame = f;
  slider.value = f;
  const t = `${times[f].toFixed(decimals)} ${data.time_unit}`;
  clock.textContent = t;
  slider.setAttribute("aria-valuetext", t);
  markCharts(times[f]);
  redraw();
}

const charts = [...document.querySelectorAll("svg[data-time]")].map((svg) => {
  const [low, high, left, right] = svg.dataset.time.split(" ").map(Number);
  return { svg, cursor: svg.querySelector(".cursor"), low, high, left, right };
});
function markCharts(t) {
  for (const c of charts) {
    const x = c.left + ((t - c.low) / (c.high - c.low)) * (c.right - c.left);
    const inside = x >= c.left - 0.5 && x <= c.right + 0.5;
    c.cursor.setAttribute("visibility", inside ? "visible" : "hidden");
    c.cursor.setAttribute("transform", `translate(${inside ? x.toFixed(2) : 0})`);
  }
}
for (const c of charts) {
  c.svg.addEventListener("click", (event) => {
    const box = c.svg.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * c.svg.viewBox.baseVal.width;
    if (x >= c.left && x <= c.right) seek(c.low + ((x - c.left) / (c.right - c.left)) * (c.high - c.low));
  });
}
function seek(t) {
  now = t;
  showFrame(frameAt(t));
}

// Speeds: seconds as they were, where that is neither a blink nor a wait; else the whole run in some seconds.
const choices = [5, 10, 20, 60].map((s) => [`all in ${s} s`, duration / s]);
if (data.time_unit === "s" && duration >= 0.5 && duration <= 600) {
  choices.unshift(["real time", 1], ["real time × ¼", 0.25], ["real time × 4", 4]);
}
choices.forEach(([name], i) => speed.add(new Option(name, i)));
speed.value = choices.length === 4 ? 1 : duration < 2 || duration > 60 ? 4 : 0;

function setPlaying(on) {
  playing = on && duration > 0;
  play.textContent = playing ? "Pause" : "Play";
  play.setAttribute("aria-label", play.textContent);
  if (!playing) return;
  if (view.frame === frames - 1) seek(times[0]);
  now = times[view.frame];
  clockAt = performance.now();
  requestAnimationFrame(advance);
}
function advance(at) {
  if (!playing) return;
  now += (Math.max(0, at - clockAt) / 1000) * choices[speed.value][1];
  clockAt = Math.max(at, clockAt);
  showFrame(frameAt(now));
  if (now >= times[frames - 1]) setPlaying(false); else requestAnimationFrame(advance);
}
play.addEventListener("click", () => setPlaying(!playing));
slider.addEventListener("input", () => { setPlaying(false); seek(times[Number(slider.value)]); showFrame(Number(slider.value)); });

follow.checked = view.follow;
follow.closest("label").hidden = extent.travel === 0;
follow.addEventListener("change", () => { view.follow = follow.checked; frameAll(); });
element("boxes").closest("label").hidden = boxes.every((b) => !b);
element("boxes").addEventListener("change", (event) => { view.boxes = event.target.checked; redraw(); });
function frameAll() {
  fit();
  redraw();
}
element("frame").addEventListener("click", frameAll);

function turn(dx, dy) {
  view.azimuth -= dx;
  view.elevation = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, view.elevation + dy));
  redraw();
}
function zoom(factor) {
  view.zoom = Math.max(0.05, Math.min(500, view.zoom * factor));
  redraw();
}
function move(dx, dy) {
  const { scale } = camera();
  view.right -= dx / scale;
  view.up += dy / scale;
  redraw();
}

const held = new Map();
let moved = 0;
const place = (event) => {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
};
const spread = () => { const [a, b] = [...held.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  held.set(event.pointerId, place(event));
  moved = 0;
});
canvas.addEventListener("pointermove", (event) => {
  const at = place(event), from = held.get(event.pointerId);
  if (!from) { mark(bodyAt(...at)); return; }
  const [dx, dy] = [at[0] - from[0], at[1] - from[1]];
  moved += Math.hypot(dx, dy);
  const before = held.size === 2 ? spread() : 0;
  held.set(event.pointerId, at);
  if (held.size === 2) {
    if (before > 0) zoom(spread() / before);
    move(dx / 2, dy / 2);
  } else if (event.shiftKey || event.buttons & 2) move(dx, dy);
  else turn(0.008 * dx, 0.008 * dy);
});
for (const name of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(name, (event) => {
    // A touch that did not move points at a body.
    if (name === "pointerup" && moved < 5) mark(bodyAt(...place(event)));
    held.delete(event.pointerId);
  });
}
canvas.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse" && !held.size) mark(null); });
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => {
  // Before a click the wheel scrolls the page.
  if (document.activeElement !== canvas) return;
  event.preventDefault();
  zoom(Math.exp(-0.0015 * event.deltaY));
}, { passive: false });
function mark(body) {
  if (body === view.marked) return;
  view.marked = body;
  redraw();
}

const keys = {
  ArrowLeft: () => turn(-0.08, 0), ArrowRight: () => turn(0.08, 0), ArrowUp: () => turn(0, -0.08), ArrowDown: () => turn(0, 0.08),
  "+": () => zoom(1.15), "=": () => zoom(1.15), "-": () => zoom(1 / 1.15), f: frameAll, " ": () => setPlaying(!playing),
};
canvas.addEventListener("keydown", (event) => {
  const action = keys[event.key];
  if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  action();
});

new ResizeObserver(redraw).observe(canvas);
for (const query of ["(prefers-color-scheme: dark)", "print"]) matchMedia(query).addEventListener("change", draw);
addEventListener("beforeprint", () => {
  for (const fold of document.querySelectorAll("details")) fold.open = true;
  draw();
});
fit();
showFrame(0);
draw();
