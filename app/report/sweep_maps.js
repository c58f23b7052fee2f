// The map of a sweep: a plane of cells or curves along a way on a canvas, and what is known of the chosen pose beside it.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  document.documentElement.classList.add("live");
  const canvas = document.getElementById("map"), context = canvas.getContext("2d"), panel = document.getElementById("pose");
  const choice = document.getElementById("quantity"), slices = document.getElementById("slices");
  const moving = data.shape.map((count, axis) => (count > 1 ? axis : -1)).filter((axis) => axis >= 0);
  const plane = data.kind === "grid" && moving.length >= 2, across = moving[0], up = moving[1];
  const strides = data.shape.map((_, axis) => data.shape.slice(axis + 1).reduce((product, count) => product * count, 1));
  const place = data.shape.map((count) => Math.floor(count / 2));
  const stops = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const left = 64, right = 92, top = 14, bottom = 46, font = "12px system-ui, sans-serif";
  let shown = 0, chosen = plane ? numberOf(place) : Math.floor(data.positions.length / 2), box = null;

  function numberOf(at) { return plane || data.kind === "grid" ? at.reduce((sum, value, axis) => sum + value * strides[axis], 0) : at[0]; }
  function color(share) {
    const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1), low = Math.min(Math.floor(at), stops.length - 2), part = at - low;
    return `rgb(${stops[low].map((value, channel) => Math.round(value + part * (stops[low + 1][channel] - value))).join(",")})`;
  }
  function ink(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }
  function known(values) { return values.filter((value) => value !== null); }
  function text(words, x, y, align) { context.textAlign = align; context.fillText(words, x, y); }
  function digits(value) { return value === null || value === undefined ? "–" : Number(value.toPrecision(4)).toLocaleString("en", { maximumSignificantDigits: 4, useGrouping: false }); }
  // as many digits as tell the ends of a narrow range apart
  function end(value, low, high) {
    const more = high > low ? Math.ceil(Math.log10(Math.max(Math.abs(low), Math.abs(high)) / (high - low))) + 1 : 0;
    return value.toLocaleString("en", { maximumSignificantDigits: Math.min(Math.max(4, more), 10), useGrouping: false });
  }
  function columns(axis) { return Array.from({ length: data.shape[axis] }, (_, index) => data.positions[index * strides[axis]][axis]); }

  function draw() {
    const width = canvas.clientWidth || 700, height = Math.round(plane ? Math.min(width * 0.78, 640) : Math.min(width * 0.6, 520)), scale = window.devicePixelRatio || 1;
    canvas.width = width * scale; canvas.height = height * scale; canvas.style.height = `${height}px`;
    context.setTransform(scale, 0, 0, scale, 0, 0); context.clearRect(0, 0, width, height); context.font = font; context.fillStyle = ink("--ink");
    box = { x: left, y: top, w: width - left - right, h: height - top - bottom };
    if (plane) drawPlane(); else drawWay();
  }
  function drawPlane() {
    const { values, unit } = data.quantities[shown], numbers = known(values), low = Math.min(...numbers), high = Math.max(...numbers);
    const n = data.shape[across], m = data.shape[up], w = box.w / n, h = box.h / m, at = place.slice();
    for (let i = 0; i < n; i++) for (let j = 0; j < m; j++) {
      at[across] = i; at[up] = j;
      const value = values[numberOf(at)];
      context.fillStyle = value === null ? "#c3c8cf" : color((value - low) / (high - low || 1));
      context.fillRect(box.x + i * w, box.y + box.h - (j + 1) * h, w + 0.6, h + 0.6);
    }
    context.strokeStyle = "#fff"; context.lineWidth = 3; const x = box.x + place[across] * w, y = box.y + box.h - (place[up] + 1) * h;
    context.strokeRect(x, y, w, h); context.strokeStyle = "#b1122f"; context.lineWidth = 1.6; context.strokeRect(x, y, w, h);
    for (let k = 0; k < 100; k++) { context.fillStyle = color(k / 99); context.fillRect(box.x + box.w + 18, box.y + box.h * (1 - (k + 1) / 100), 14, box.h / 100 + 0.6); }
    context.fillStyle = ink("--ink"); text(end(high, low, high), box.x + box.w + 36, box.y + 10, "left"); text(end(low, low, high), box.x + box.w + 36, box.y + box.h, "left");
    text(unit, box.x + box.w + 36, box.y + box.h / 2, "left");
    axisMarks(columns(across), columns(up));
  }
  function axisMarks(xs, ys) {
    const w = box.w / xs.length, h = box.h / ys.length, name = (axis) => `${data.axes[axis]} [${data.units[axis]}]`;
    for (const i of [0, Math.floor(xs.length / 2), xs.length - 1]) text(digits(xs[i]), box.x + (i + 0.5) * w, box.y + box.h + 16, "center");
    for (const j of [0, Math.floor(ys.length / 2), ys.length - 1]) text(digits(ys[j]), box.x - 6, box.y + box.h - (j + 0.5) * h + 4, "right");
    text(name(across), box.x + box.w / 2, box.y + box.h + 36, "center");
    context.save(); context.translate(14, box.y + box.h / 2); context.rotate(-Math.PI / 2); text(name(up), 0, 0, "center"); context.restore();
  }
  function way() {
    const axis = data.axes.map((_, index) => index).filter((index) => new Set(data.positions.map((p) => p[index])).size > 1);
    const rising = axis.length === 1 && data.positions.every((p, k) => k === 0 || p[axis[0]] > data.positions[k - 1][axis[0]]);
    return rising ? [data.positions.map((p) => p[axis[0]]), `${data.axes[axis[0]]} [${data.units[axis[0]]}]`] : [data.positions.map((_, k) => k + 1), "pose"];
  }
  function drawWay() {
    const asked = data.quantities[shown], family = data.quantities.filter((q) => q.unit === asked.unit && q.unit !== "" ? q.name.startsWith("mode_") === asked.name.startsWith("mode_") : q === asked);
    const [xs, label] = way(), all = known(family.flatMap((q) => q.values)), low = Math.min(...all), high = Math.max(...all), span = high - low || 1;
    const x = (value) => box.x + box.w * (value - xs[0]) / (xs[xs.length - 1] - xs[0] || 1), y = (value) => box.y + box.h * (1 - (value - low) / span);
    family.forEach((quantity, number) => {
      context.strokeStyle = quantity === asked ? ink("--accent") : `hsl(${(number * 67) % 360} 45% 55%)`; context.lineWidth = quantity === asked ? 3 : 1.3;
      context.beginPath(); let pen = false;
      quantity.values.forEach((value, k) => { if (value === null) { pen = false; return; } if (pen) context.lineTo(x(xs[k]), y(value)); else context.moveTo(x(xs[k]), y(value)); pen = true; });
      context.stroke();
    });
    nameCurves(family, asked, y);
    context.strokeStyle = "#b1122f"; context.lineWidth = 1; context.beginPath(); context.moveTo(x(xs[chosen]), box.y); context.lineTo(x(xs[chosen]), box.y + box.h); context.stroke();
    context.fillStyle = ink("--ink"); text(end(high, low, high), box.x - 6, box.y + 10, "right"); text(end(low, low, high), box.x - 6, box.y + box.h, "right"); text(asked.unit, box.x - 6, box.y + box.h / 2, "right");
    text(digits(xs[0]), box.x, box.y + box.h + 16, "center"); text(digits(xs[xs.length - 1]), box.x + box.w, box.y + box.h + 16, "center"); text(label, box.x + box.w / 2, box.y + box.h + 36, "center");
  }
  // the name of each curve beside its end, moved apart where they would touch
  function nameCurves(family, asked, y) {
    const ends = family.map((quantity, number) => [y(quantity.values.findLast((value) => value !== null)), quantity, number]).filter((entry) => !Number.isNaN(entry[0]));
    let below = -Infinity;
    ends.sort((a, b) => a[0] - b[0]).forEach(([level, quantity, number]) => {
      below = Math.max(level, below + 13);
      context.fillStyle = quantity === asked ? ink("--accent") : `hsl(${(number * 67) % 360} 45% 45%)`;
      text(quantity.title.replace(/ at .*$/, "").replace("compliance", "compl."), box.x + box.w + 6, below + 4, "left");
    });
  }
  function cell(row, words, numeric, head) { const made = document.createElement(head ? "th" : "td"); made.textContent = words; if (numeric) made.className = "number"; row.append(made); }
  function table(heading, rows, marked, head) {
    const title = document.createElement("h3"), made = document.createElement("table"); title.textContent = heading;
    if (head) { const row = made.insertRow(); head.forEach((word, index) => cell(row, word, index > 0, true)); }
    rows.forEach((words, number) => { const row = made.insertRow(); if (number === marked) row.className = "shown"; words.forEach((word, index) => cell(row, word, index > 0 && /^[-–\d]/.test(word))); });
    panel.append(title, made);
  }
  function describe() {
    panel.replaceChildren();
    const at = data.positions[chosen], heading = data.labels[chosen] || data.axes.map((axis, k) => `${axis} ${digits(at[k])} ${data.units[k]}`).join(", ");
    const title = document.createElement("h3"); title.textContent = `Pose ${heading}`; panel.append(title);
    if (data.errors[chosen]) { const said = document.createElement("p"); said.textContent = data.errors[chosen]; said.className = "soft"; panel.append(said); }
    const row = data.frequencies[chosen] || [];
    if (row.length) {
      const order = row.map((_, mode) => mode).filter((mode) => row[mode] !== null).sort((a, b) => row[a] - row[b]);
      table("Natural modes [Hz]", order.map((mode) => [`mode ${mode + 1}`, digits(row[mode]), data.modes[mode] || ""]), order.findIndex((mode) => data.quantities[shown].name === `mode_${mode + 1}`));
    }
    for (const [name, point] of Object.entries(data.points)) {
      const matrix = point.matrix[chosen], links = point.weakest[chosen];
      if (matrix[0][0] === null) continue;
      table(`Compliance at ${name} [µm/kN]`, [0, 1, 2].map((column) => ["xyz"[column], ...[0, 1, 2].map((line) => digits(matrix[line][column]))]), undefined, ["force in", "moves x", "y", "z"]);
      table("Largest compliance", [[`${digits(point.largest[chosen])} µm/kN`, `along (${point.direction[chosen].map((v) => v.toFixed(2)).join(", ")})`]]);
      table("Gives most of it", [0, 1, 2].map((k) => ["xyz"[k], links[k], `${Math.round(100 * point.share[chosen][k])} %`]));
    }
    const rest = data.quantities.filter((q) => !q.name.startsWith("mode_") && !q.name.startsWith("compliance_"));
    if (rest.length) table("More", rest.map((q) => [q.title, `${digits(q.values[chosen])} ${q.unit}`]));
  }
  function select() { chosen = numberOf(plane ? place : [chosen]); draw(); describe(); }
  function pick(event) {
    const bounds = canvas.getBoundingClientRect(), x = (event.clientX - bounds.left - box.x) / box.w, y = (event.clientY - bounds.top - box.y) / box.h;
    if (x < 0 || x >= 1 || y < 0 || y >= 1) return;
    if (plane) { place[across] = Math.floor(x * data.shape[across]); place[up] = Math.floor((1 - y) * data.shape[up]); select(); return; }
    const xs = way()[0], wanted = xs[0] + x * (xs[xs.length - 1] - xs[0]);
    chosen = xs.reduce((best, value, k) => (Math.abs(value - wanted) < Math.abs(xs[best] - wanted) ? k : best), 0); draw(); describe();
  }
  function step(event) {
    const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] }[event.key];
    if (!move) return;
    event.preventDefault();
    const clamp = (value, count) => Math.min(Math.max(value, 0), count - 1);
    if (plane) { place[across] = clamp(place[across] + move[0], data.shape[across]); place[up] = clamp(place[up] + move[1], data.shape[up]); select(); }
    else { chosen = clamp(chosen + move[0] + move[1], data.positions.length); draw(); describe(); }
  }
  data.quantities.forEach((quantity, number) => {
    const mode = /^mode_(\d+)$/.exec(quantity.name), name = mode ? data.modes[mode[1] - 1] : "";
    choice.add(new Option(`${quantity.title}${quantity.unit ? ` [${quantity.unit}]` : ""}${name ? ` – ${name}` : ""}`, number));
  });
  if (plane) moving.slice(2).forEach((axis) => {
    const label = document.createElement("label"), slider = document.createElement("input"), value = document.createElement("span"), stands = columns(axis);
    Object.assign(slider, { type: "range", min: 0, max: data.shape[axis] - 1, value: place[axis] });
    const tell = () => { value.textContent = ` ${digits(stands[place[axis]])} ${data.units[axis]}`; };
    slider.addEventListener("input", () => { place[axis] = Number(slider.value); tell(); select(); });
    tell(); label.append(`${data.axes[axis]} `, slider, value); slices.append(label);
  });
  choice.addEventListener("change", () => { shown = Number(choice.value); draw(); describe(); });
  canvas.addEventListener("click", pick); canvas.addEventListener("keydown", step); window.addEventListener("resize", draw);
  const first = data.quantities.findIndex((quantity) => quantity.name.endsWith("_largest"));
  if (data.quantities.length) { shown = Math.max(first, 0); choice.value = shown; draw(); describe(); }
})();
