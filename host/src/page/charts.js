"use strict";
// What went wrong is on the page itself, for whoever looks at it and for the test.
addEventListener("error", (event) => { document.documentElement.dataset.failed = event.message; });

const data = JSON.parse(document.getElementById("data").textContent);

/** A number with so many significant digits, without the noise of binary fractions. */
function formatNumber(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "-";
  return String(Number(value.toPrecision(digits)));
}

/** Index of the value nearest to x in an ascending list. */
function nearest(values, x) {
  let best = 0;
  values.forEach((value, n) => { if (Math.abs(value - x) < Math.abs(values[best] - x)) best = n; });
  return best;
}

function element(name, attributes = {}, parent = null, text = null) {
  const svg = ["svg", "g", "line", "path", "rect", "circle", "text", "image", "clipPath", "defs"].includes(name);
  const made = svg ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== null) made.textContent = text;
  if (parent) parent.append(made);
  return made;
}

/** Round numbers within low..high, about so many. */
function ticks(low, high, count) {
  const rough = (high - low) / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((step) => step >= rough * 0.999);
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n += 1) found.push(n * step);
  return { step, found };
}

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const dash = (series) => ["", "7 3", "2 2.5", "9 3 2 3", "12 4"][series % 5];
const MARKERS = [
  (x, y) => `M${x - 3} ${y}a3 3 0 1 0 6 0a3 3 0 1 0 -6 0`,
  (x, y) => `M${x - 3} ${y - 3}h6v6h-6z`,
  (x, y) => `M${x} ${y - 4}l4 7h-8z`,
  (x, y) => `M${x} ${y - 4}l4 4l-4 4l-4 -4z`,
];

/** A chart in a figure of the page; `describe` says what it shows each time it is drawn. */
class Chart {
  constructor(name, describe) {
    this.figure = document.getElementById(name);
    this.describe = describe;
    this.at = null;
    this.parts = Object.fromEntries(["controls", "plot", "reading", "legend", "numbers"]
      .map((part) => [part, this.figure.querySelector("." + part)]));
    const { plot, numbers } = this.parts;
    plot.addEventListener("pointermove", (event) => this.point(event));
    plot.addEventListener("pointerdown", (event) => this.point(event));
    plot.addEventListener("keydown", (event) => this.step(event));
    numbers.addEventListener("toggle", () => this.list());
    // Drawn in the next frame: a picture that changes its own height while it is observed would trigger this at once again.
    new ResizeObserver(() => requestAnimationFrame(() => { if (Math.max(plot.clientWidth, 280) !== this.width) this.draw(); })).observe(plot);
    Chart.all.push(this);
  }

  /** A slider over values that were computed before; `words` says one of them. */
  slider(id, label, values, start, words) {
    const { controls } = this.parts;
    const holder = element("label", { for: id }, controls, label + " ");
    const value = element("output", { class: "value", for: id }, holder);
    const input = element("input", { type: "range", id, min: 0, max: values.length - 1, step: 1, value: start }, holder);
    const show = () => {
      value.textContent = words(values[input.valueAsNumber]);
      input.setAttribute("aria-valuetext", value.textContent);
    };
    input.addEventListener("input", () => { show(); this.draw(); });
    show();
    return { get index() { return input.valueAsNumber; }, get value() { return values[input.valueAsNumber]; },
      set index(n) { input.value = n; show(); } };
  }

  point(event) {
    const box = this.parts.plot.getBoundingClientRect(), { x, y } = this.scales;
    const within = (value, { low, high }) => Math.min(Math.max(value, low), high);
    this.at = { x: within(x.back(event.clientX - box.left), x), y: within(y.back(event.clientY - box.top), y) };
    this.cursor();
  }

  step(event) {
    const direction = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] }[event.key];
    if (!direction) return;
    event.preventDefault();
    const { x, y } = this.scales, part = event.shiftKey ? 10 : 100;
    const at = this.at || { x: (x.low + x.high) / 2, y: (y.low + y.high) / 2 };
    const move = (value, { low, high }, by) => Math.min(Math.max(value + by * (high - low) / part, low), high);
    this.at = { x: move(at.x, x, direction[0]), y: move(at.y, y, direction[1]) };
    this.cursor();
  }

  cursor() {
    if (!this.at) { this.parts.reading.textContent = this.shown.hint || "Point at the picture, or use the arrow keys on it, to read values."; return; }
    const { x, y } = this.scales;
    this.lines.vertical.setAttribute("d", `M${x.to(this.at.x)} ${y.to(y.low)}V${y.to(y.high)}` +
      (this.shown.plane ? `M${x.to(x.low)} ${y.to(this.at.y)}H${x.to(x.high)}` : ""));
    this.parts.reading.textContent = this.shown.read(this.at.x, this.at.y);
  }

  draw() {
    const shown = this.shown = this.describe(), { plot, legend } = this.parts;
    const width = this.width = Math.max(plot.clientWidth, 280), height = shown.height || 320;
    const left = 64, right = 14, top = shown.ribbon ? 26 : 12, bottom = 46;
    const scale = (axis, from, to) => {
      const span = (axis.high - axis.low) || 1;
      return { ...axis, to: (value) => from + (value - axis.low) / span * (to - from), back: (place) => axis.low + (place - from) / (to - from) * span };
    };
    const x = scale(shown.x, left, width - right), y = scale(shown.y, height - bottom, top);
    this.scales = { x, y };
    plot.replaceChildren();
    const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, "aria-hidden": "true" }, plot);
    const clip = "clip-" + this.figure.id;
    element("rect", { x: left, y: top, width: width - left - right, height: height - top - bottom }, element("clipPath", { id: clip }, element("defs", {}, svg)));
    if (shown.cells) this.cells(svg, shown.cells, x, y);
    for (const [axis, across] of [[x, true], [y, false]]) {
      const { step, found } = ticks(axis.low, axis.high, (across ? width : height) / (across ? 90 : 50));
      const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
      for (const value of found) {
        const place = axis.to(value), text = value.toFixed(digits);
        if (!shown.cells) element("path", { class: "grid", d: across ? `M${place} ${y.to(y.low)}V${y.to(y.high)}` : `M${x.to(x.low)} ${place}H${x.to(x.high)}` }, svg);
        element("text", across ? { class: "tick", x: place, y: height - bottom + 17, "text-anchor": "middle" }
          : { class: "tick", x: left - 7, y: place + 4, "text-anchor": "end" }, svg, text);
      }
      const label = axis.label + (axis.unit ? ` / ${axis.unit}` : "");
      if (across) element("text", { x: (left + width - right) / 2, y: height - 8, "text-anchor": "middle" }, svg, label);
      else element("text", { transform: `translate(14 ${(top + height - bottom) / 2}) rotate(-90)`, "text-anchor": "middle" }, svg, label);
    }
    const inside = element("g", { "clip-path": `url(#${clip})` }, svg);
    const words = element("g", {}, svg);
    legend.replaceChildren();
    const entry = (name, paint) => {
      if (!name) return;
      const item = element("li", {}, legend);
      paint(element("svg", { viewBox: "0 0 32 14", "aria-hidden": "true" }, item));
      item.append(name);
    };
    const path = (points) => {
      let pen = false, d = "";
      for (const [a, b] of points) {
        if (b === null || !Number.isFinite(b)) { pen = false; continue; }
        d += `${pen ? "L" : "M"}${x.to(a).toFixed(1)} ${y.to(b).toFixed(1)}`;
        pen = true;
      }
      return d;
    };
    for (const layer of shown.layers) {
      const colour = `var(--series${(layer.series || 0) % 7})`;
      if (layer.kind === "line") {
        const look = { fill: "none", stroke: colour, "stroke-width": 2, "stroke-dasharray": dash(layer.series) };
        element("path", { ...look, d: path(layer.points) }, inside);
        entry(layer.name, (svg) => element("path", { ...look, d: "M1 7H31" }, svg));
      } else if (layer.kind === "area") {
        const look = { fill: colour, "fill-opacity": 0.25, stroke: colour, "stroke-width": 1.5, "stroke-dasharray": dash(layer.series) };
        const there = layer.points.filter(([, low, high]) => low !== null && high !== null);
        const d = there.length ? path(there.map(([a, low]) => [a, low])) + path(there.map(([a, , high]) => [a, high]).reverse()).replace("M", "L") + "Z" : "";
        element("path", { ...look, d }, inside);
        entry(layer.name, (svg) => element("rect", { ...look, x: 1, y: 1, width: 30, height: 12 }, svg));
      } else if (layer.kind === "points") {
        const marker = MARKERS[(layer.series || 0) % 4];
        const look = { fill: colour };
        element("path", { ...look, d: layer.points.filter(([, b]) => b !== null).map(([a, b]) => marker(x.to(a), y.to(b))).join("") }, inside);
        entry(layer.name, (svg) => element("path", { ...look, d: marker(16, 7) }, svg));
      } else if (layer.kind === "strip") {
        element("rect", { class: "strip", x: x.to(x.low), width: x.to(x.high) - x.to(x.low), y: y.to(layer.high), height: Math.max(y.to(layer.low) - y.to(layer.high), 0) }, inside);
        entry(layer.name, (svg) => element("rect", { class: "strip", x: 1, y: 1, width: 30, height: 12 }, svg));
      } else if (layer.kind === "level" && Number.isFinite(layer.y)) {
        element("path", { class: "mark", d: `M${x.to(x.low)} ${y.to(layer.y)}H${x.to(x.high)}` }, inside);
        element("text", { class: "tick halo", x: x.to(x.high) - 4, y: y.to(layer.y) - 4, "text-anchor": "end" }, words, layer.name);
      } else if (layer.kind === "mark" && layer.x >= x.low && layer.x <= x.high) {
        element("path", { class: "mark", d: `M${x.to(layer.x)} ${y.to(y.low)}V${y.to(y.high)}` }, inside);
        const late = x.to(layer.x) > width * 0.75;
        element("text", { class: "tick halo", x: x.to(layer.x) + (late ? -4 : 4), y: y.to(y.high) + 13 + 15 * (layer.row || 0), "text-anchor": late ? "end" : "start" }, words, layer.name);
      }
    }
    if (shown.ribbon) {
      const used = new Set();
      const merged = [];
      for (const [from, to, fill] of shown.ribbon) {
        if (merged.at(-1)?.[2] === fill) merged.at(-1)[1] = to;
        else merged.push([from, to, fill]);
      }
      for (const [from, to, fill] of merged) {
        element("rect", { x: x.to(from), width: Math.max(x.to(to) - x.to(from), 0.5), y: top - 14, height: 10, style: `fill:var(--fill${fill})`, stroke: "var(--axis)", "stroke-width": 0.5 }, svg);
        used.add(fill);
      }
      for (const fill of used) entry(shown.fills[fill], (svg) => this.swatch(svg, fill));
    }
    if (shown.cells) for (const [fill, name] of shown.cells.legend) entry(name, (svg) => this.swatch(svg, fill));
    element("rect", { class: "frame", x: left, y: top, width: width - left - right, height: height - top - bottom }, svg);
    this.lines = { vertical: element("path", { class: "cursor", fill: "none" }, inside) };
    if (shown.verdict !== undefined) {
      let verdict = this.figure.querySelector(".verdict");
      if (!verdict) {
        verdict = element("output", { class: "reading verdict" });
        this.parts.plot.before(verdict);
      }
      verdict.textContent = shown.verdict;
    }
    this.cursor();
    this.list();
  }

  swatch(svg, fill) {
    element("rect", { x: 1, y: 1, width: 30, height: 12, style: `fill:var(--fill${fill})`, stroke: "var(--axis)" }, svg);
  }

  /** A map of cells, one sign for each, row by row from below. */
  cells(svg, { side, signs }, x, y) {
    const canvas = element("canvas", { width: side, height: side });
    const context = canvas.getContext("2d"), colours = {};
    for (let n = 0; n < signs.length; n += 1) {
      const fill = signs[n];
      context.fillStyle = colours[fill] ||= style("--fill" + fill);
      context.fillRect(n % side, side - 1 - Math.floor(n / side), 1, 1);
    }
    element("image", { href: canvas.toDataURL(), x: x.to(x.low), y: y.to(y.high), width: x.to(x.high) - x.to(x.low), height: y.to(y.low) - y.to(y.high),
      preserveAspectRatio: "none", style: "image-rendering:pixelated" }, svg);
  }

  list() {
    const { numbers } = this.parts;
    if (!numbers.open) return;
    numbers.querySelector("div")?.remove();
    const { heads, rows } = this.shown.numbers();
    const table = element("table", {}, element("div", { tabindex: 0 }, numbers));
    const line = (cells, name, parent) => { const row = element("tr", {}, parent); for (const cell of cells) element(name, {}, row, typeof cell === "number" ? formatNumber(cell, 6) : cell ?? "-"); };
    line(heads, "th", element("thead", {}, table));
    const body = element("tbody", {}, table);
    for (const row of rows) line(row, "td", body);
  }
}
Chart.all = [];

const dark = matchMedia("(prefers-color-scheme: dark)");
const button = document.getElementById("colours");
const theme = () => document.documentElement.dataset.theme || (dark.matches ? "dark" : "light");
function coloured() {
  button.setAttribute("aria-pressed", String(theme() === "dark"));
  button.textContent = theme() === "dark" ? "light colours" : "dark colours";
  for (const chart of Chart.all) chart.draw();
}
button.addEventListener("click", () => { document.documentElement.dataset.theme = theme() === "dark" ? "light" : "dark"; coloured(); });
dark.addEventListener("change", coloured);
// On paper the colours are those for light.
let before = null;
addEventListener("beforeprint", () => { before = document.documentElement.dataset.theme ?? ""; document.documentElement.dataset.theme = "light"; coloured(); });
addEventListener("afterprint", () => { if (before) document.documentElement.dataset.theme = before; else delete document.documentElement.dataset.theme; coloured(); });
