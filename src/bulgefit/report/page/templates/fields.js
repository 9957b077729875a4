"use strict";
// Maps, profiles and the surface of the page: what #data holds, drawn on canvases.

const data = JSON.parse(document.getElementById("data").textContent);
const NAMES = ["dx", "dy", "dz"];
const LOST = -32768;
const state = { test: 0, frame: 0, field: "", colour: "", turn: -0.6, tilt: 1.05 };
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

// ---- numbers

function bytes(text) {
  const raw = atob(text);
  const out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out;
}

function numbers(packed) {
  const view = new DataView(bytes(packed.data).buffer);
  const out = new Float32Array(view.byteLength / 2);
  for (let i = 0; i < out.length; i++) {
    const step = view.getInt16(2 * i, true);
    out[i] = step === LOST ? NaN : step * packed.step;
  }
  return out;
}

function unpacked(block) {
  const view = new DataView(bytes(block.triangles).buffer);
  const triangles = new Uint16Array(view.byteLength / 2);
  for (let i = 0; i < triangles.length; i++) triangles[i] = view.getUint16(2 * i, true);
  return {
    ...block,
    reference: numbers(block.reference),
    triangles,
    measured: numbers(block.measured),
    residuals: block.residuals.map(numbers),
  };
}

for (const test of data.tests) test.blocks = test.blocks.map(unpacked);

const here = () => data.tests[state.test];
const blockOf = (frame) => here().blocks[here().frames[frame].block];

// A field is "measured", or "left:k" and "model:k" of the k-th model.
function fields() {
  const out = [];
  here().models.forEach((name, k) => out.push([`left:${k}`, `measured − modelled, ${name}`]));
  out.reverse();
  out.push(["measured", "measured"]);
  here().models.forEach((name, k) => out.push([`model:${k}`, `modelled, ${name}`]));
  return out;
}

function value(frame, field, point, component) {
  const block = blockOf(frame);
  const at = (here().frames[frame].row * block.count + point) * 3 + component;
  if (field === "measured") return block.measured[at];
  const [kind, k] = field.split(":");
  const left = block.residuals[+k][at];
  return kind === "left" ? left : block.measured[at] - left;
}

// Where colours end, the same at all pressures: the 98th percentile, or the range of dz itself.
const limits = new Map();
function limit(field, component) {
  const key = `${state.test} ${field} ${component}`;
  if (!limits.has(key)) {
    const all = [];
    here().frames.forEach((_, frame) => {
      for (let i = 0; i < blockOf(frame).count; i++) {
        const v = value(frame, field, i, component);
        if (!Number.isNaN(v)) all.push(v);
      }
    });
    const sizes = all.map(Math.abs).sort((a, b) => a - b);
    const signed = field.startsWith("left") || component < 2;
    const end = Math.max(sizes[Math.floor(0.98 * (sizes.length - 1))] || 0, 1e-9);
    const [low, high] = all.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [0, 1e-9]);
    limits.set(key, signed ? { low: -end, high: end, signed } : { low, high, signed });
  }
  return limits.get(key);
}

// ---- colours: told apart by colour-blind readers; zero is grey, never the colour of the paper

const SIGNED = [[5, 48, 97], [33, 102, 172], [103, 169, 207], [214, 214, 208], [239, 168, 98],
  [179, 88, 6], [110, 50, 8]];
const RISING = [[0, 34, 78], [53, 69, 108], [102, 105, 112], [148, 142, 119], [200, 183, 101],
  [254, 232, 56]];

function colour(v, { low, high, signed }) {
  const stops = signed ? SIGNED : RISING;
  const t = clamp((v - low) / (high - low), 0, 1) * (stops.length - 1);
  const k = Math.min(Math.floor(t), stops.length - 2);
  return stops[k].map((c, i) => c + (t - k) * (stops[k + 1][i] - c));
}

const rgb = (c, shade = 1) => `rgb(${c.map((v) => Math.round(v * shade)).join(",")})`;

// ---- canvases

function prepared(canvas) {
  const box = canvas.getBoundingClientRect();
  const ratio = Math.max(window.devicePixelRatio || 1, 2);
  const [w, h] = [Math.max(Math.round(box.width), 1), Math.max(Math.round(box.height), 1)];
  canvas.width = w * ratio;
  canvas.height = h * ratio;
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, w, h);
  pen.font = `12px ${getComputedStyle(document.body).fontFamily}`;
  pen.textBaseline = "middle";
  pen.lineJoin = "round";
  return [pen, w, h];
}

const short = (v) => (v === 0 ? "0" : Math.abs(v) >= 100 ? v.toFixed(0)
  : Math.abs(v) < 1e-3 ? v.toExponential(1) : String(+v.toPrecision(3)));

function scale(pen, x, y, width, span, title) {
  for (let i = 0; i < width; i++) {
    pen.fillStyle = rgb(colour(span.low + ((i + 0.5) / width) * (span.high - span.low), span));
    pen.fillRect(x + i, y, 1.5, 9);
  }
  pen.fillStyle = css("--quiet");
  pen.textAlign = "left";
  pen.fillText(short(span.low), x, y + 20);
  pen.textAlign = "right";
  pen.fillText(short(span.high), x + width, y + 20);
  pen.textAlign = "center";
  pen.fillText(title, x + width / 2, y + 20);
}

function hatched(pen) {
  const tile = document.createElement("canvas");
  tile.width = tile.height = 8;
  const own = tile.getContext("2d");
  own.strokeStyle = css("--rule");
  own.lineWidth = 1.2;
  own.beginPath();
  own.moveTo(-2, 10);
  own.lineTo(10, -2);
  own.moveTo(-2, 2);
  own.lineTo(2, -2);
  own.moveTo(6, 10);
  own.lineTo(10, 6);
  own.stroke();
  return pen.createPattern(tile, "repeat");
}

function triangle(pen, corners, fill) {
  pen.fillStyle = pen.strokeStyle = fill;
  pen.beginPath();
  corners.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.closePath();
  pen.fill();
  pen.stroke();
}

function map(canvas) {
  const component = +canvas.dataset.component;
  const [pen, w, h] = prepared(canvas);
  const { rim } = here();
  const block = blockOf(state.frame);
  const [size, top] = [Math.min(w, h - 62), 22];
  const unit = size / (2.04 * Math.max(...rim));
  const place = (i) => [w / 2 + unit * block.reference[3 * i],
    top + size / 2 - unit * block.reference[3 * i + 1]];
  const span = limit(state.field, component);
  pen.fillStyle = css("--ink");
  pen.textAlign = "left";
  pen.font = pen.font.replace("12px", "600 13px");
  pen.fillText(NAMES[component], 0, 9);
  pen.font = pen.font.replace("13px", "12px").replace("600 ", "");
  const known = [];
  for (let i = 0; i < block.count; i++) {
    const v = value(state.frame, state.field, i, component);
    if (!Number.isNaN(v)) known.push(v);
  }
  const rms = Math.sqrt(known.reduce((s, v) => s + v * v, 0) / known.length);
  pen.fillStyle = css("--quiet");
  pen.textAlign = "right";
  pen.fillText(known.length ? `rms ${short(rms)} mm` : "not measured", w, 9);
  pen.beginPath();
  pen.ellipse(w / 2, top + size / 2, unit * rim[0], unit * rim[1], 0, 0, 2 * Math.PI);
  pen.fillStyle = hatched(pen);
  pen.fill();
  pen.lineWidth = 0.8;
  const t = block.triangles;
  for (let k = 0; k < t.length; k += 3) {
    const three = [t[k], t[k + 1], t[k + 2]];
    const mean = three.reduce((s, i) => s + value(state.frame, state.field, i, component), 0) / 3;
    if (!Number.isNaN(mean)) triangle(pen, three.map(place), rgb(colour(mean, span)));
  }
  if (!t.length) {
    for (let i = 0; i < block.count; i++) {
      const v = value(state.frame, state.field, i, component);
      if (Number.isNaN(v)) continue;
      const [x, y] = place(i);
      pen.fillStyle = rgb(colour(v, span));
      pen.fillRect(x - 3, y - 3, 6, 6);
    }
  }
  pen.beginPath();
  pen.ellipse(w / 2, top + size / 2, unit * rim[0], unit * rim[1], 0, 0, 2 * Math.PI);
  pen.strokeStyle = css("--quiet");
  pen.lineWidth = 1;
  pen.stroke();
  scale(pen, w * 0.1, top + size + 6, w * 0.8, span, "mm");
  canvas.dataset.frame = state.frame;
}

// ---- profiles

function ticks(low, high, most) {
  const raw = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw);
  const out = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) out.push(+(k * step).toPrecision(6));
  return out;
}

function onLine(block, along) {
  const out = [];
  for (let i = 0; i < block.count; i++) {
    if (Math.abs(block.reference[3 * i + 1 - along]) <= 0.5 * block.spacing) out.push(i);
  }
  return out.sort((a, b) => block.reference[3 * a + along] - block.reference[3 * b + along]);
}

function profile(canvas) {
  const along = +canvas.dataset.along;
  const [pen, w, h] = prepared(canvas);
  const { rim, frames, models } = here();
  const reach = rim[along];
  const best = `model:${models.length - 1}`;
  const { low, high } = limit("measured", 2);
  const [left, right, top, bottom] = [44, w - 16, 24, h - 34];
  const x = (p) => left + ((p + reach) / (2 * reach)) * (right - left);
  const y = (v) => bottom - ((v - low) / (1.04 * (high - low))) * (bottom - top);
  pen.lineWidth = 1;
  pen.strokeStyle = css("--rule");
  pen.fillStyle = css("--quiet");
  pen.textAlign = "right";
  for (const v of ticks(low, high, 5)) {
    pen.beginPath();
    pen.moveTo(left, y(v));
    pen.lineTo(right, y(v));
    pen.stroke();
    pen.fillText(short(v), left - 6, y(v));
  }
  pen.textAlign = "center";
  for (const p of ticks(-reach, reach, 5)) pen.fillText(short(p), x(p), bottom + 12);
  pen.fillText(`${"xy"[along]} before inflation (mm)`, (left + right) / 2, bottom + 27);
  pen.textAlign = "left";
  pen.fillStyle = css("--ink");
  pen.fillText(`dz (mm) along ${"yx"[along]} = 0`, left, 10);
  frames.forEach((_, frame) => {
    const block = blockOf(frame);
    const line = onLine(block, along);
    const now = frame === state.frame;
    pen.globalAlpha = now ? 1 : 0.22;
    pen.strokeStyle = css("--accent");
    pen.lineWidth = now ? 2 : 1;
    pen.beginPath();
    let drawn = false;
    for (const i of line) {
      const v = value(frame, best, i, 2);
      if (Number.isNaN(v)) continue;
      const to = [x(block.reference[3 * i + along]), y(v)];
      drawn ? pen.lineTo(...to) : pen.moveTo(...to);
      drawn = true;
    }
    pen.stroke();
    if (!now) return;
    pen.strokeStyle = css("--p3");
    pen.lineWidth = 1.3;
    for (const i of line) {
      const v = value(frame, "measured", i, 2);
      if (Number.isNaN(v)) continue;
      pen.beginPath();
      pen.arc(x(block.reference[3 * i + along]), y(v), 3, 0, 2 * Math.PI);
      pen.stroke();
    }
  });
  pen.globalAlpha = 1;
}

// ---- the surface

function turned(x, y, z) {
  const [c, s] = [Math.cos(state.turn), Math.sin(state.turn)];
  const [ct, st] = [Math.cos(state.tilt), Math.sin(state.tilt)];
  const away = s * x + c * y;
  return [c * x - s * y, ct * away + st * z, -st * away + ct * z]; // right, up, towards the eye
}

function surface() {
  const canvas = document.getElementById("surface");
  const [pen, w, h] = prepared(canvas);
  const { rim } = here();
  const block = blockOf(state.frame);
  const [field, c] = state.colour.split("/");
  const span = limit(field, +c);
  const top = limit("measured", 2).high;
  const unit = Math.min(w / 2.15, (h - 44) / 1.9) / Math.max(...rim);
  const shape = field.startsWith("model") ? field : "measured";
  const middle = [w / 2, (h - 30) / 2 + unit * Math.sin(state.tilt) * 0.5 * top];
  const place = ([a, b]) => [middle[0] + unit * a, middle[1] - unit * b];
  const points = [];
  for (let i = 0; i < block.count; i++) {
    const p = [0, 1, 2].map((k) => block.reference[3 * i + k] + value(state.frame, shape, i, k));
    points.push(turned(...p));
  }
  pen.strokeStyle = css("--quiet");
  pen.lineWidth = 1;
  pen.beginPath();
  for (let k = 0; k <= 96; k++) {
    const angle = (k * Math.PI) / 48;
    const at = place(turned(rim[0] * Math.cos(angle), rim[1] * Math.sin(angle), 0));
    k ? pen.lineTo(...at) : pen.moveTo(...at);
  }
  pen.stroke();
  const t = block.triangles;
  const faces = [];
  for (let k = 0; k < t.length; k += 3) {
    const three = [t[k], t[k + 1], t[k + 2]];
    const corners = three.map((i) => points[i]);
    const mean = three.reduce((s, i) => s + value(state.frame, field, i, +c), 0) / 3;
    const depth = corners[0][2] + corners[1][2] + corners[2][2];
    if (!Number.isNaN(mean + depth)) faces.push([depth, corners, mean]);
  }
  faces.sort((a, b) => a[0] - b[0]);
  pen.lineWidth = 0.8;
  for (const [, [a, b, d], mean] of faces) {
    const [u, v] = [[0, 1, 2].map((k) => b[k] - a[k]), [0, 1, 2].map((k) => d[k] - a[k])];
    const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const light = Math.abs(-0.3 * normal[0] + 0.5 * normal[1] + 0.81 * normal[2]) / Math.hypot(...normal);
    triangle(pen, [a, b, d].map(place), rgb(colour(mean, span), 0.72 + 0.28 * light));
  }
  pen.fillStyle = css("--quiet");
  pen.textAlign = "center";
  for (const [name, p] of [["x", [1.08 * rim[0], 0, 0]], ["y", [0, 1.08 * rim[1], 0]]]) {
    pen.fillText(name, ...place(turned(...p)));
  }
  const wide = Math.min(w - 32, 320);
  scale(pen, (w - wide) / 2, h - 32, wide, span, `${NAMES[+c]} (mm)`);
  canvas.dataset.turn = state.turn.toFixed(3);
  canvas.dataset.tilt = state.tilt.toFixed(3);
}

// ---- what the reader does

const control = (id) => document.getElementById(id);

function draw() {
  document.querySelectorAll("#maps canvas").forEach(map);
  document.querySelectorAll("#profiles canvas").forEach(profile);
  surface();
  const { bar } = here().frames[state.frame];
  control("bar").textContent = `${short(bar)} bar`;
}

function filled(select, options, chosen) {
  select.replaceChildren(...options.map(([key, text]) => new Option(text, key)));
  const kept = options.some(([key]) => key === chosen) ? chosen : options[0][0];
  select.value = kept;
  return kept;
}

function choose() {
  state.frame = here().frames.length - 1;
  control("pressure").max = state.frame;
  control("pressure").value = state.frame;
  state.field = filled(control("field"), fields(), state.field);
  const colours = fields().flatMap(([key, text]) => NAMES.map((n, c) => [`${key}/${c}`, `${n}, ${text}`]));
  state.colour = filled(control("colour"), colours, state.colour || "measured/2");
  draw();
}

function turn(across, down) {
  state.turn += across;
  state.tilt = clamp(state.tilt + down, 0, Math.PI / 2);
  surface();
}

control("pressure").addEventListener("input", (event) => { state.frame = +event.target.value; draw(); });
control("field").addEventListener("change", (event) => { state.field = event.target.value; draw(); });
control("colour").addEventListener("change", (event) => { state.colour = event.target.value; surface(); });
if (control("test")) {
  control("test").addEventListener("change", (event) => { state.test = +event.target.value; choose(); });
}

let held = null;
const stage = control("surface");
stage.addEventListener("pointerdown", (event) => {
  held = [event.clientX, event.clientY];
  stage.setPointerCapture(event.pointerId);
});
stage.addEventListener("pointermove", (event) => {
  if (!held) return;
  turn(0.01 * (event.clientX - held[0]), -0.01 * (event.clientY - held[1]));
  held = [event.clientX, event.clientY];
});
for (const kind of ["pointerup", "pointercancel"]) stage.addEventListener(kind, () => { held = null; });
const KEYS = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
stage.addEventListener("keydown", (event) => {
  if (!(event.key in KEYS)) return;
  event.preventDefault();
  turn(...KEYS[event.key]);
});

let width = 0;
window.addEventListener("resize", () => {
  if (width !== window.innerWidth) { width = window.innerWidth; draw(); }
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
matchMedia("print").addEventListener("change", draw);
choose();
