// Everything over one axis of time: bands of modes, marks of events, panels of lines.

const BAND_COLORS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#b8a800"];
const STYLES = { truth: [2.4, []], setpoint: [1.5, [5, 3]], estimate: [1.3, []], left: [2.6, []], right: [1.2, []] };
const TALL = 0.15, DENSE = 0.15, MEAN_OVER = 0.5;
const MARGIN = 6, LEAST_TALL = 38, MOST_TALL = 150, NARROW_TALL = 84;

class Plots {
  constructor(flight, colors, go) {
    Object.assign(this, { flight, colors, go });
    this.window = [flight.start, flight.end];
    this.right = document.getElementById("right");
    this.bands = document.getElementById("bands");
    this.axis = document.getElementById("axis");
    this.tip = document.getElementById("tip");
    this.bandColors = new Map();
    for (const [, , label] of [...flight.modes, ...flight.stages]) {
      const color = BAND_COLORS[this.bandColors.size % BAND_COLORS.length];
      if (!this.bandColors.has(label)) this.bandColors.set(label, color);
    }
    this.panels = flight.panels.map((panel) => this.build(panel));
    this.cursor = this.overlay("cursor");
    this.chosen = this.overlay("chosen");
    this.chosen.hidden = true;
    this.listen();
  }

  overlay(id) {
    const element = document.createElement("div");
    element.id = id;
    this.right.append(element);
    return element;
  }

  build(panel) {
    const box = document.createElement("div"), canvas = document.createElement("canvas");
    const title = document.createElement("div");
    title.className = "title";
    const name = document.createElement("b");
    name.textContent = `${panel.title} [${panel.unit}]`;
    title.append(name);
    const readings = panel.lines.map((line) => this.reading(title, line));
    canvas.setAttribute("aria-label", `${panel.title} in ${panel.unit}`);
    box.append(title, canvas);
    document.getElementById("panels").append(box);
    return { ...panel, canvas, readings };
  }

  reading(title, line) {
    const [entry, key, text] = ["span", "i", "span"].map((name) => document.createElement(name));
    key.className = line.style;
    key.style.borderColor = `var(--${line.style})`;
    text.textContent = line.name;
    entry.append(key, text);
    title.append(entry);
    return text;
  }

  // --- places

  get gutter() { return this.right.clientWidth < 520 ? 46 : 56; }

  x(t) {
    const [from, to] = this.window;
    return this.gutter + (t - from) / (to - from) * (this.right.clientWidth - this.gutter - 8);
  }

  timeAt(x) {
    const [from, to] = this.window;
    return from + (x - this.gutter) / (this.right.clientWidth - this.gutter - 8) * (to - from);
  }

  // --- what a person does

  listen() {
    const { right } = this;
    const inside = (event) => event.clientX - right.getBoundingClientRect().left;
    const plotted = (event) => event.target.tagName === "CANVAS";
    let began = null;
    right.addEventListener("pointerdown", (event) => {
      if (!plotted(event) || event.button !== 0) return;
      began = inside(event);
      right.setPointerCapture(event.pointerId);
    });
    right.addEventListener("pointermove", (event) => {
      if (began === null) this.hover(event, inside(event));
      else this.mark(began, inside(event));
    });
    right.addEventListener("pointerup", (event) => {
      if (began === null) return;
      const [a, b] = [began, inside(event)];
      began = null;
      this.chosen.hidden = true;
      if (Math.abs(b - a) > 5) this.zoomTo(this.timeAt(Math.min(a, b)), this.timeAt(Math.max(a, b)));
      else this.go(this.eventNear(b)?.time ?? this.timeAt(b));
    });
    right.addEventListener("pointercancel", () => { began = null; this.chosen.hidden = true; });
    right.addEventListener("pointerleave", () => { this.tip.hidden = true; });
    right.addEventListener("dblclick", () => this.zoomTo(this.flight.start, this.flight.end));
    right.addEventListener("wheel", (event) => {
      if (!plotted(event)) return;
      event.preventDefault();
      this.wheel(this.timeAt(inside(event)), event);
    }, { passive: false });
  }

  wheel(t, event) {
    const [from, to] = this.window;
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      const moved = event.deltaX / this.right.clientWidth * (to - from);
      this.zoomTo(from + moved, to + moved);
    } else {
      const factor = Math.exp(0.0015 * event.deltaY);
      this.zoomTo(t + (from - t) * factor, t + (to - t) * factor);
    }
  }

  mark(a, b) {
    this.tip.hidden = true;
    this.chosen.hidden = Math.abs(b - a) <= 5;
    this.chosen.style.left = `${Math.min(a, b)}px`;
    this.chosen.style.width = `${Math.abs(b - a)}px`;
  }

  zoomTo(from, to) {
    const { start, end } = this.flight, span = Math.min(end - start, Math.max(0.05, to - from));
    const first = Math.min(Math.max(start, from), end - span);
    this.window = [first, first + span];
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  eventNear(x) {
    const near = this.flight.events.filter((event) => Math.abs(this.x(event.time) - x) < 6);
    return near.sort((a, b) => Math.abs(this.x(a.time) - x) - Math.abs(this.x(b.time) - x))[0];
  }

  // What happened here, and what mode it was.
  hover(event, x) {
    const onStrip = event.target === this.bands, near = this.eventNear(x), t = this.timeAt(x);
    const at = (bands) => bands.find(([from, to]) => t >= from && t < to)?.[2];
    const words = [near && `${clock(near.time)}  ${near.text}`];
    if (onStrip) words.push([at(this.flight.modes), at(this.flight.stages)].filter(Boolean).join(", "));
    const text = words.filter(Boolean).join("\n");
    this.tip.hidden = !text || event.target.tagName !== "CANVAS";
    this.tip.textContent = text;
    this.tip.style.left = `${Math.min(event.clientX + 12, window.innerWidth - this.tip.offsetWidth - 8)}px`;
    this.tip.style.top = `${event.clientY + 14}px`;
  }

  // --- drawing

  show(t) {
    this.time = t;
    const x = this.x(t);
    this.cursor.hidden = x < this.gutter - 1 || x > this.right.clientWidth - 7;
    this.cursor.style.left = `${x}px`;
    for (const { lines, readings, unit: symbol } of this.panels) {
      lines.forEach((line, n) => { readings[n].textContent = `${line.name} ${written(lineAt(line, t), symbol)}`; });
    }
  }

  draw() {
    const tall = this.tall();
    this.drawBands();
    for (const panel of this.panels) {
      panel.canvas.style.height = `${tall}px`;
      this.drawPanel(panel);
    }
    this.drawAxis();
    for (const element of [this.cursor, this.chosen]) {
      element.style.height = `${this.axis.offsetTop + 4}px`;
    }
    if (this.time !== undefined) this.show(this.time);
  }

  // Side by side with the bird all panels fit the window if they can; below it each has its height.
  tall() {
    if (window.innerWidth < 1000) return NARROW_TALL;
    const rest = this.bands.offsetHeight + this.axis.offsetHeight + document.getElementById("hint").offsetHeight + 10;
    const share = Math.floor((this.right.clientHeight - rest) / this.panels.length) - 24;
    return Math.min(MOST_TALL, Math.max(LEAST_TALL, share));
  }

  clip(context, width, height) {
    context.save();
    context.beginPath();
    context.rect(this.gutter, 0, width - this.gutter - 8, height);
    context.clip();
  }

  drawBands() {
    const { context, width, height } = sized(this.bands), { flight } = this;
    context.clearRect(0, 0, width, height);
    this.labels(context, [["mode", 10, flight.modes.length], ["stage", 28, flight.stages.length], ["events", 46, 1]]);
    this.clip(context, width, height);
    this.drawRow(context, flight.modes, 2, 16);
    this.drawRow(context, flight.stages, 20, 16);
    for (const event of flight.events) this.drawMark(context, event);
    context.restore();
  }

  labels(context, rows) {
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "right";
    context.textBaseline = "middle";
    context.fillStyle = this.colors.dim;
    for (const [text, y, there] of rows) if (there) context.fillText(text, this.gutter - 6, y);
  }

  drawRow(context, bands, top, tall) {
    context.textAlign = "left";
    for (const [from, to, label] of bands) {
      const x = this.x(from), end = this.x(to);
      if (end < this.gutter || x > this.right.clientWidth) continue;
      context.globalAlpha = 2.2 * this.colors.band;
      context.fillStyle = this.bandColors.get(label);
      context.fillRect(x, top, Math.max(1, end - x - 1), tall);
      context.globalAlpha = 1;
      const seen = Math.max(x, this.gutter);
      context.fillStyle = this.colors.ink;
      if (context.measureText(label).width < end - seen - 8) context.fillText(label, seen + 4, top + 0.5 * tall + 0.5);
    }
  }

  drawMark(context, { time, severity }) {
    const x = this.x(time);
    context.fillStyle = severity <= 4 ? this.colors.alarm : this.colors.mark;
    context.beginPath();
    context.moveTo(x, 39);
    context.lineTo(x + 4.5, 46);
    context.lineTo(x, 53);
    context.lineTo(x - 4.5, 46);
    context.fill();
  }

  drawPanel(panel) {
    const { context, width, height } = sized(panel.canvas);
    const shown = panel.lines.map((line) => ({ ...line, rows: visible(line, this.window, width - this.gutter) }));
    const scale = scaled(panel.wraps ? [-180, 180] : range(shown, panel.span), height, panel.wraps);
    context.clearRect(0, 0, width, height);
    this.clip(context, width, height);
    for (const [from, to, label] of this.flight.modes) {
      context.globalAlpha = 0.28 * this.colors.band;
      context.fillStyle = this.bandColors.get(label);
      context.fillRect(this.x(from), 0, this.x(to) - this.x(from), height);
    }
    context.globalAlpha = 1;
    this.drawGrid(context, scale, width, height);
    context.restore();
    this.labels(context, spaced(scale).map((value) => [scale.text(value), scale.y(value), 1]));
    this.clip(context, width, height);
    const dense = !panel.wraps && shown.some(({ rows }) => tallShare(rows, scale, TALL * height) > DENSE);
    for (const line of shown) (dense ? this.drawEnvelope : this.drawLine).call(this, context, line, scale, panel.wraps);
    context.restore();
  }

  drawGrid(context, scale, width, height) {
    context.lineWidth = 1;
    context.strokeStyle = this.colors.grid;
    context.beginPath();
    for (const value of scale.ticks) {
      context.moveTo(this.gutter, Math.round(scale.y(value)) + 0.5);
      context.lineTo(width, Math.round(scale.y(value)) + 0.5);
    }
    for (const { t } of timeTicks(this.window, width)) {
      context.moveTo(Math.round(this.x(t)) + 0.5, 0);
      context.lineTo(Math.round(this.x(t)) + 0.5, height);
    }
    context.stroke();
    context.globalAlpha = 0.5;
    for (const event of this.flight.events) {
      context.strokeStyle = event.severity <= 4 ? this.colors.alarm : this.colors.mark;
      context.beginPath();
      context.moveTo(this.x(event.time), 0);
      context.lineTo(this.x(event.time), 5);
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  drawLine(context, { rows, style }, scale, wraps) {
    const [thick, dash] = STYLES[style], { time, low, high, from, to } = rows;
    context.strokeStyle = this.colors[style];
    context.globalAlpha = style === "truth" ? 0.75 : 1;
    context.lineWidth = thick;
    context.setLineDash(dash);
    context.lineJoin = "round";
    context.lineCap = dash.length ? "butt" : "round";
    context.beginPath();
    let pen = false;
    for (let n = from; n <= to; n++) {
      if (Number.isNaN(low[n])) { pen = false; continue; }
      const x = this.x(time[n]), y = scale.y(low[n]);
      if (pen && wraps && Math.abs(low[n] - low[n - 1]) > 180) pen = false;
      if (!pen) context.moveTo(x, y);
      context.lineTo(x, y);
      if (high[n] !== low[n]) context.lineTo(x, scale.y(high[n]));
      pen = true;
    }
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  // Strokes too many to be told apart: from least to greatest a shade, and on it the mean over some of them.
  drawEnvelope(context, { rows, style }, scale) {
    const { time, low, high, from, to } = rows, smooth = running(rows, MEAN_OVER);
    context.fillStyle = context.strokeStyle = this.colors[style];
    context.globalAlpha = 0.22;
    for (let n = from; n <= to; n++) {
      if (Number.isNaN(low[n])) continue;
      const first = n;
      while (n < to && !Number.isNaN(low[n + 1])) n++;
      context.beginPath();
      for (let m = first; m <= n; m++) context.lineTo(this.x(time[m]), scale.y(high[m]));
      for (let m = n; m >= first; m--) context.lineTo(this.x(time[m]), scale.y(low[m]));
      context.fill();
    }
    context.globalAlpha = 1;
    context.lineWidth = STYLES[style][0];
    context.setLineDash(STYLES[style][1]);
    context.beginPath();
    let pen = false;
    for (let n = from; n <= to; n++) {
      if (Number.isNaN(low[n])) { pen = false; continue; }
      if (pen) context.lineTo(this.x(time[n]), scale.y(smooth[n - from]));
      else context.moveTo(this.x(time[n]), scale.y(smooth[n - from]));
      pen = true;
    }
    context.stroke();
    context.setLineDash([]);
  }

  drawAxis() {
    const { context, width } = sized(this.axis);
    context.clearRect(0, 0, width, 40);
    context.font = "11px system-ui, sans-serif";
    context.textBaseline = "top";
    context.fillStyle = context.strokeStyle = this.colors.dim;
    context.textAlign = "center";
    for (const { t, text } of timeTicks(this.window, width)) {
      const x = this.x(t);
      context.fillRect(x, 0, 1, 4);
      context.fillText(text, Math.min(x, width - 0.5 * context.measureText(text).width - 1), 6);
    }
    const [from, to] = this.window, seconds = to - from < 120 ? "s" : to < 3600 ? "min:s" : "h:min:s";
    context.fillText(`time since boot [${seconds}]`, 0.5 * (width + this.gutter), 20);
  }
}

// The level whose rows are about as many as the pixels, and which of its rows are inside.
function visible(line, [from, to], width) {
  const inside = (rows) => [indexAt(rows.time, from), Math.min(rows.time.length - 1, indexAt(rows.time, to) + 1)];
  const found = line.levels.find((rows) => {
    const [a, b] = inside(rows);
    return b - a <= 2 * width;
  }) || line.levels.at(-1);
  const [a, b] = inside(found);
  return { ...found, from: a, to: b };
}

// The share of its rows that are taller than so many px: none where every sample is drawn.
function tallShare({ low, high, from, to }, { y }, least) {
  let tall = 0, there = 0;
  for (let n = from; n <= to; n++) {
    if (Number.isNaN(low[n])) continue;
    if (y(low[n]) - y(high[n]) > least) tall++;
    there++;
  }
  return there ? tall / there : 0;
}

// Mean over some seconds about each row that is drawn.
function running({ time, mean, from, to }, seconds) {
  const out = new Float64Array(to - from + 1);
  let first = from, next = from, sum = 0, there = 0;
  for (let n = from; n <= to; n++) {
    for (; next <= to && time[next] <= time[n] + 0.5 * seconds; next++) {
      if (!Number.isNaN(mean[next])) { sum += mean[next]; there++; }
    }
    for (; time[first] < time[n] - 0.5 * seconds; first++) {
      if (!Number.isNaN(mean[first])) { sum -= mean[first]; there--; }
    }
    out[n - from] = there ? sum / there : NaN;
  }
  return out;
}

// From the least to the greatest value with a little room, and never less than the span.
function range(lines, span) {
  let least = Infinity, greatest = -Infinity;
  for (const { rows } of lines) {
    for (let n = rows.from; n <= rows.to; n++) {
      if (rows.low[n] < least) least = rows.low[n];
      if (rows.high[n] > greatest) greatest = rows.high[n];
    }
  }
  if (least > greatest) return [0, 1];
  const room = Math.max(0.06 * (greatest - least), 0.5 * (span - greatest + least));
  return [least - room, greatest + room];
}

function scaled([least, greatest], height, wraps) {
  const y = (value) => MARGIN + (greatest - value) / (greatest - least) * (height - 2 * MARGIN);
  const step = wraps ? (height > 80 ? 90 : 180) : tickStep(least, greatest, height), ticks = [];
  for (let k = Math.ceil(least / step - 1e-9); k * step <= greatest + 1e-9; k++) ticks.push(k * step);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return { y, ticks, text: (value) => signed(value.toFixed(digits)) };
}

// The ticks that have room for their label.
function spaced({ ticks, y }) {
  const every = ticks.length > 1 ? Math.ceil(11.5 / Math.abs(y(ticks[0]) - y(ticks[1]))) : 1;
  return ticks.filter((_, n) => n % every === 0);
}

// As many ticks as there is room for, two at least.
function tickStep(least, greatest, height) {
  const step = tidy((greatest - least) / Math.max(2, height / 20));
  const count = Math.floor(greatest / step) - Math.ceil(least / step) + 1;
  return count >= 2 ? step : tidy(0.4 * step);
}

// A proper minus, and none before zero.
function signed(text) {
  return text.replace(/^-(0(\.0*)?)$/, "$1").replace("-", "−");
}

const TIME_STEPS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 21600];

function timeTicks([from, to], width) {
  const wanted = (to - from) / Math.max(2, width / 75), step = TIME_STEPS.find((s) => s >= wanted) || 43200, out = [];
  const digits = step < 0.1 ? 2 : step < 1 ? 1 : 0;
  for (let k = Math.ceil(from / step); k * step <= to; k++) {
    out.push({ t: k * step, text: to - from < 120 ? (k * step).toFixed(digits) : minutes(k * step) });
  }
  return out;
}

function minutes(t) {
  const seconds = Math.round(t), two = (n) => String(n).padStart(2, "0");
  const hours = Math.floor(seconds / 3600), rest = `${two(Math.floor(seconds / 60) % 60)}:${two(seconds % 60)}`;
  return hours ? `${hours}:${rest}` : rest;
}

function clock(t) {
  const tenths = Math.round(t * 10);
  return `${minutes(Math.floor(tenths / 10))}.${((tenths % 10) + 10) % 10}`;
}

// The value that held at t; nothing outside of the line and in its gaps.
function lineAt(line, t) {
  const { time, low, high } = line.levels[0];
  if (t < time[0] - 1 || t > time.at(-1) + 1) return NaN;
  const n = indexAt(time, t);
  return 0.5 * (low[n] + high[n]);
}

function written(value, symbol) {
  if (Number.isNaN(value)) return "–";
  const text = value.toFixed(Math.abs(value) >= 100 ? 0 : Math.abs(value) >= 10 ? 1 : 2);
  return symbol === "°" ? `${signed(text)}°` : `${signed(text)} ${symbol}`;
}
