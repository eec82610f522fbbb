// Copies texts, and lets the time plots be zoomed and read. The page is complete without it.
(() => {
"use strict";
document.documentElement.classList.add("js");
for (const tools of document.querySelectorAll(".tools")) tools.hidden = false;

const copy = async (text) => {
  try { await navigator.clipboard.writeText(text); return true; } catch { /* a page without the right to it */ }
  const area = document.createElement("textarea");
  area.value = text;
  document.body.append(area);
  area.select();
  const done = document.execCommand("copy");
  area.remove();
  return done;
};
for (const button of document.querySelectorAll("[data-copy]")) {
  const label = button.textContent;
  button.addEventListener("click", async () => {
    const done = await copy(document.getElementById(button.dataset.copy).textContent);
    button.textContent = done ? "Copied" : "Not copied: mark the text by hand";
    setTimeout(() => { button.textContent = label; }, 1600);
  });
}

const source = document.getElementById("data");
if (!source) return;
const data = JSON.parse(source.textContent);
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const time = Array.from(new Float32Array(bytes(data.t)), (t) => t + data.start);
const last = time.length - 1;
for (const channel of Object.values(data.channels))
  for (const [name, signal] of Object.entries(channel.signals))
    channel.signals[name] = Float64Array.from(new Int16Array(bytes(signal.data)),
      (n) => (n === -32768 ? NaN : signal.middle + n * signal.step));
const SIGNALS = { residual: { before: "residual_before", after: "residual_after" },
  trajectory: { measured: "measured", before: "before", after: "after" } };
const SVG = "http://www.w3.org/2000/svg";

// The first sample at or after t.
const after = (t) => {
  let low = 0, high = last;
  while (low < high) { const k = (low + high) >> 1; if (time[k] < t) low = k + 1; else high = k; }
  return low;
};
const digits = (step) => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
const ticks = (low, high) => {
  const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= 0.75 * rough);
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) out.push(k * step);
  return [out, step];
};
const element = (name, attributes, text) => {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
};
// Three figures, and as many decimals as that takes.
const short = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(3))) : "–");

class Plot {
  constructor(svg) {
    this.svg = svg;
    this.channel = data.channels[svg.dataset.channel];
    this.signals = SIGNALS[svg.dataset.plot];
    this.box = svg.dataset.box.split(" ").map(Number);
    this.first = svg.dataset.range.split(" ").map(Number);
    this.range = this.first;
    this.powers = svg.dataset.powers.split(" ").map(Number);
    this.area = svg.querySelector("svg.data");
    this.whole = new Map([...svg.querySelectorAll("svg.data > *, .tx, .ty, .grid, .ticks")]
      .map((part) => [part, part.cloneNode(true)]));
    this.cursor = element("path", { stroke: "var(--pm-faint)", "stroke-width": ".8", fill: "none" });
    this.marked = element("rect", { y: this.box[1], height: this.box[3], fill: "var(--pm-found)",
      "fill-opacity": ".15", width: 0, x: 0 });
    this.area.append(this.marked, this.cursor);
    this.told = document.createElement("output");
    svg.after(this.told);
    svg.setAttribute("tabindex", "0");
    this.listen();
  }
  reset() {
    this.range = this.first;
    for (const [part, copy] of this.whole) {
      for (const { name, value } of copy.attributes) part.setAttribute(name, value);
      part.replaceChildren(...copy.cloneNode(true).childNodes);
    }
  }
  x(t) { const [left, , wide] = this.box, [low, high] = this.range; return left + (t - low) / (high - low) * wide; }
  y(v) { const [, top, , high] = this.box, [, , low, up] = this.range; return top + (up - v) / (up - low) * high; }
  time(event) {
    const place = this.svg.getBoundingClientRect(), scale = this.svg.viewBox.baseVal.width / place.width;
    const [left, , wide] = this.box, [low, high] = this.range;
    const share = ((event.clientX - place.left) * scale - left) / wide;
    return low + Math.min(1, Math.max(0, share)) * (high - low);
  }
  // The smallest and the largest value of each pixel, so that no peak is lost.
  points(values, from, to) {
    const count = to - from + 1, runs = Math.min(count, Math.ceil(this.box[2] * 2)), out = [];
    for (let run = 0; run < runs; run++) {
      const start = from + Math.floor(run * count / runs), stop = from + Math.floor((run + 1) * count / runs);
      let low = -1, high = -1;
      for (let k = start; k < stop; k++) {
        if (Number.isNaN(values[k])) continue;
        if (low < 0 || values[k] < values[low]) low = k;
        if (high < 0 || values[k] > values[high]) high = k;
      }
      if (low < 0) { out.push(-1); continue; }
      out.push(Math.min(low, high));
      if (low !== high) out.push(Math.max(low, high));
    }
    return out;
  }
  show(low, high) {
    const from = Math.max(0, after(low) - 1), to = Math.min(last, after(high) + 1);
    const drawn = Object.entries(this.signals)
      .map(([role, name]) => [role, this.channel.signals[name], this.points(this.channel.signals[name], from, to)]);
    let bottom = Infinity, top = -Infinity;
    for (const [, values, points] of drawn)
      for (const k of points) if (k >= 0) { bottom = Math.min(bottom, values[k]); top = Math.max(top, values[k]); }
    if (this.svg.dataset.plot === "residual" && this.channel.noise) {
      bottom = Math.min(bottom, -3 * this.channel.noise);
      top = Math.max(top, 3 * this.channel.noise);
    }
    if (!(top >= bottom)) { bottom = 0; top = 1; }
    const margin = (top - bottom) * 0.04 || Math.abs(top) * 0.1 || 1;
    this.range = [low, high, bottom - margin, top + margin];
    for (const [role, values, points] of drawn) {
      const path = this.area.querySelector(`path.${role}`);
      const dots = path.classList.contains("dots");
      let pen = "M", line = "";
      for (const k of points) {
        if (k < 0) { pen = "M"; continue; }
        line += `${dots ? "M" : pen}${this.x(time[k]).toFixed(1)} ${this.y(values[k]).toFixed(1)}${dots ? "h0" : ""}`;
        pen = "L";
      }
      path.setAttribute("d", line);
    }
    this.frame();
  }
  frame() {
    const [left, up, wide, high] = this.box, bottom = up + high, noise = 2 * (this.channel.noise || 0);
    const [xs, dx] = ticks(this.range[0], this.range[1]), [ys, dy] = ticks(this.range[2], this.range[3]);
    const band = this.area.querySelector("rect.band");
    if (band) {
      band.setAttribute("y", this.y(noise));
      band.setAttribute("height", Math.max(0.5, this.y(-noise) - this.y(noise)));
      this.area.querySelectorAll("line.edge").forEach((line, k) => {
        line.setAttribute("y1", this.y(k ? noise : -noise));
        line.setAttribute("y2", this.y(k ? noise : -noise));
      });
    }
    const label = (value, step, power) => (value / 10 ** power || 0).toFixed(digits(step / 10 ** power));
    const style = { fill: "var(--pm-faint)" };
    this.svg.querySelector(".grid").setAttribute("d", ys.map((v) => `M${left} ${this.y(v)}H${left + wide}`).join(""));
    this.svg.querySelector(".ticks").setAttribute("d",
      xs.map((t) => `M${this.x(t)} ${bottom}v3`).join("") + `M${left} ${bottom}H${left + wide}`);
    this.svg.querySelector(".tx").replaceChildren(...xs.map((t) => element("text",
      { ...style, x: this.x(t), y: bottom + 14, "text-anchor": "middle" }, label(t, dx, this.powers[0]))));
    this.svg.querySelector(".ty").replaceChildren(...ys.map((v) => element("text",
      { ...style, x: left - 5, y: this.y(v) + 3.4, "text-anchor": "end" }, label(v, dy, this.powers[1]))));
  }
  read(t) {
    let k = after(t);
    if (k > 0 && t - time[k - 1] < time[k] - t) k--;
    if (data.paired) k -= k % 2;
    const [, top, , high] = this.box, across = this.x(time[k]);
    this.cursor.setAttribute("d", `M${across} ${top}v${high}`);
    const values = Object.entries(this.signals).map(([role, name]) => {
      const signal = this.channel.signals[name];
      const pair = data.paired && k < last ? [signal[k], signal[k + 1]].sort((a, b) => a - b) : [signal[k]];
      return `${role} ${pair.map(short).filter((text, n, all) => !n || text !== all[0]).join(" … ")}`;
    });
    this.told.value = `t = ${Number(time[k].toPrecision(6))} s: ${values.join(", ")} ${this.channel.unit}`;
  }
  forget() { this.cursor.setAttribute("d", ""); this.marked.setAttribute("width", 0); this.told.value = ""; }
  listen() {
    let start = null;
    const span = (event) => [start, this.time(event)].sort((a, b) => a - b);
    this.svg.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || event.pointerType === "touch") return;
      start = this.time(event);
      this.svg.setPointerCapture(event.pointerId);
    });
    this.svg.addEventListener("pointermove", (event) => {
      this.read(this.time(event));
      if (start === null) return;
      const [low, high] = span(event);
      this.marked.setAttribute("x", this.x(low));
      this.marked.setAttribute("width", this.x(high) - this.x(low));
    });
    this.svg.addEventListener("pointerup", (event) => {
      if (start === null) return;
      const [low, high] = span(event);
      start = null;
      this.forget();
      if (this.x(high) - this.x(low) > 4) zoom(low, high);
    });
    this.svg.addEventListener("pointercancel", () => { start = null; this.forget(); });
    this.svg.addEventListener("pointerleave", () => { if (start === null) this.forget(); });
    this.svg.addEventListener("dblclick", () => reset());
    this.svg.addEventListener("keydown", (event) => {
      const way = { "+": "in", "-": "out", ArrowLeft: "left", ArrowRight: "right", Escape: "all", 0: "all" }[event.key];
      if (way && !event.ctrlKey && !event.metaKey && !event.altKey) { event.preventDefault(); act(way); }
    });
  }
}
const plots = [...document.querySelectorAll("svg[data-plot]")].map((svg) => new Plot(svg));
const whole = [time[0], time[last]];
let view = whole;
const zoom = (low, high) => {
  const least = Math.max((whole[1] - whole[0]) * 4 / (last + 1), 1e-9), wide = Math.max(high - low, least);
  if (wide >= (whole[1] - whole[0]) * 0.999) { view = whole; } else {
    const start = Math.min(Math.max(low, whole[0]), whole[1] - wide);
    view = [start, start + wide];
  }
  for (const plot of plots) plot.show(...view);
};
const reset = () => { view = whole; for (const plot of plots) plot.reset(); };
const act = (way) => {
  const [low, high] = view, wide = high - low, middle = (low + high) / 2;
  if (way === "all") reset();
  else if (way === "in") zoom(middle - wide / 4, middle + wide / 4);
  else if (way === "out") zoom(middle - wide, middle + wide);
  else zoom(low + (way === "left" ? -wide / 2 : wide / 2), high + (way === "left" ? -wide / 2 : wide / 2));
};
for (const button of document.querySelectorAll("[data-zoom]"))
  button.addEventListener("click", () => act(button.dataset.zoom));
})();
