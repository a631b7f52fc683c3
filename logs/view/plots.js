// Everything over one axis of time: bands of modes, marks of events, panels of lines by uPlot.

const BAND_COLORS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#b8a800"];
const STYLES = { truth: [2.4, []], setpoint: [1.5, [5, 3]], estimate: [1.3, []], left: [2.6, []], right: [1.2, []] };
const TALL = 0.15, DENSE = 0.15, MEAN_OVER = 0.5;
const LEAST_TALL = 38, MOST_TALL = 150, NARROW_TALL = 84, AXIS_TALL = 34;

class Plots {
  constructor(flight, colors, go) {
    Object.assign(this, { flight, colors, go });
    this.window = [flight.start, flight.end];
    this.right = document.getElementById("right");
    this.bands = document.getElementById("bands");
    this.tip = document.getElementById("tip");
    this.bandColors = new Map();
    for (const [, , label] of [...flight.modes, ...flight.stages]) {
      const color = BAND_COLORS[this.bandColors.size % BAND_COLORS.length];
      if (!this.bandColors.has(label)) this.bandColors.set(label, color);
    }
    this.panels = flight.panels.map((panel, n) => this.build(panel, n + 1 === flight.panels.length));
    this.cursor = this.overlay("cursor");
    this.chosen = this.overlay("chosen");
    this.chosen.hidden = true;
    this.listen();
    // A scroll bar changes the width without a resize of the window.
    new ResizeObserver(() => this.schedule()).observe(this.right);
  }

  overlay(id) {
    const element = document.createElement("div");
    element.id = id;
    this.right.append(element);
    return element;
  }

  build(panel, last) {
    const box = document.createElement("div"), title = document.createElement("div");
    title.className = "title";
    const name = document.createElement("b");
    name.textContent = `${panel.title} [${panel.unit}]`;
    title.append(name);
    const readings = panel.lines.map((line) => this.reading(title, line));
    box.append(title);
    box.setAttribute("aria-label", `${panel.title} in ${panel.unit}`);
    document.getElementById("panels").append(box);
    const made = { ...panel, readings, last, range: [0, 1] };
    made.plot = new uPlot(this.options(made), this.columns(made, LEAST_TALL), box);
    return made;
  }

  // Three series a line: the line, and the edges of its envelope.
  options(panel) {
    const curve = ({ style }) => {
      const [width, dash] = STYLES[style], stroke = () => this.colors[style];
      const hidden = { points: { show: false } };
      return [{ ...hidden, stroke, width, dash, alpha: style === "truth" ? 0.75 : 1 }, hidden, hidden];
    };
    const shades = panel.lines.map(({ style }, n) => (
      { series: [3 * n + 2, 3 * n + 3], fill: () => `${this.colors[style]}38` }));
    return {
      width: 300, height: LEAST_TALL, padding: [7, 8, 7, 0],
      legend: { show: false }, select: { show: false }, cursor: { show: false },
      scales: { x: { time: false, range: () => this.window }, y: { range: () => panel.range } },
      axes: [this.timeAxis(panel.last), { ...axis("y"), space: 18, size: () => this.gutter, ...(panel.wraps && TURNS) }],
      series: [{}, ...panel.lines.flatMap(curve)],
      bands: shades,
      hooks: { drawClear: [(plot) => this.drawModes(plot)] },
    };
  }

  timeAxis(shown) {
    const base = { ...axis("x"), incrs: TIME_STEPS, space: 75 };
    if (!shown) return { ...base, size: 0, values: () => [], ticks: { show: false } };
    const values = (plot, splits, place, space, step) => splits.map((t) => this.timeText(t, step));
    return { ...base, size: AXIS_TALL - 14, values, label: "time since boot", labelSize: 14, labelFont: FONT };
  }

  timeText(t, step) {
    const [from, to] = this.window;
    return to - from < 120 ? `${t.toFixed(step < 0.1 ? 2 : step < 1 ? 1 : 0)} s` : minutes(t);
  }

  // The rows of a panel in the window, and the range of its axis; strokes too many to be told apart as an envelope.
  columns(panel, tall) {
    const width = Math.max(100, this.right.clientWidth - this.gutter);
    const shown = panel.lines.map((line) => visible(line, this.window, width));
    const [low, high] = panel.range = panel.wraps ? [-180, 180] : range(shown, panel.span);
    const y = (value) => (high - value) / (high - low) * tall;
    const dense = !panel.wraps && shown.some((rows) => tallShare(rows, { y }, TALL * tall) > DENSE);
    const parts = shown.map((rows) => (dense ? envelope(rows) : polyline(rows, panel.wraps)));
    return parts.length ? uPlot.join(parts, parts.map((part) => part.map(() => 2))) : [[], []];
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
    const plotted = (event) => event.target.closest("canvas, .u-over") !== null;
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
    this.schedule();
  }

  schedule() {
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
    this.tip.hidden = !text || !event.target.closest("canvas, .u-over");
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
      panel.plot.setSize({ width: this.right.clientWidth - 2, height: tall + (panel.last ? AXIS_TALL : 0) });
      panel.plot.setData(this.columns(panel, tall));
    }
    // uPlot sets the heights in a microtask.
    queueMicrotask(() => {
      const { offsetTop, offsetHeight } = document.getElementById("panels");
      for (const element of [this.cursor, this.chosen]) {
        element.style.height = `${offsetTop + offsetHeight - AXIS_TALL - 4}px`;
      }
    });
    if (this.time !== undefined) this.show(this.time);
  }

  // Side by side with the bird all panels fit the window if they can; below it each has its height.
  tall() {
    if (window.innerWidth < 1000) return NARROW_TALL;
    const rest = this.bands.offsetHeight + AXIS_TALL + document.getElementById("hint").offsetHeight + 14;
    const share = Math.floor((this.right.clientHeight - rest) / this.panels.length) - 24;
    return Math.min(MOST_TALL, Math.max(LEAST_TALL, share));
  }

  // Modes as background, events as ticks at the top.
  drawModes({ ctx, bbox }) {
    const ratio = window.devicePixelRatio || 1, left = bbox.left, right = bbox.left + bbox.width;
    const place = (t) => Math.min(right, Math.max(left, ratio * this.x(t)));
    ctx.save();
    ctx.globalAlpha = 0.28 * this.colors.band;
    for (const [from, to, label] of this.flight.modes) {
      ctx.fillStyle = this.bandColors.get(label);
      ctx.fillRect(place(from), bbox.top, place(to) - place(from), bbox.height);
    }
    ctx.globalAlpha = 0.5;
    for (const { time, severity } of this.flight.events) {
      ctx.fillStyle = severity <= 4 ? this.colors.alarm : this.colors.mark;
      if (time >= this.window[0] && time <= this.window[1]) ctx.fillRect(place(time), bbox.top, ratio, 5 * ratio);
    }
    ctx.restore();
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
}

// Time steps of an axis in s.
const TIME_STEPS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 21600];
const TURNS = { incrs: [90, 180] };

// A line through least and greatest of each row; a wrap interrupts it.
function polyline({ time, low, high, from, to }, wraps) {
  const x = [], y = [], none = [];
  const add = (t, value) => { x.push(t); y.push(value); none.push(null); };
  for (let n = from; n <= to; n++) {
    const step = n < to ? time[n + 1] - time[n] : 0;
    if (wraps && n > from && Math.abs(low[n] - low[n - 1]) > 180) add(0.5 * (time[n - 1] + time[n]), null);
    add(time[n], Number.isNaN(low[n]) ? null : low[n]);
    if (high[n] !== low[n] && step > 0 && !Number.isNaN(low[n])) add(time[n] + 0.4 * step, high[n]);
  }
  return [x, y, none, none];
}

// Mean over some strokes, and from least to greatest a shade.
function envelope(rows) {
  const { time, low, high, from, to } = rows, known = (value) => (Number.isNaN(value) ? null : value);
  const part = (column) => Array.from(column.subarray(from, to + 1), known);
  return [part(time), Array.from(running(rows, MEAN_OVER), known), part(high), part(low)];
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
  for (const rows of lines) {
    for (let n = rows.from; n <= rows.to; n++) {
      if (rows.low[n] < least) least = rows.low[n];
      if (rows.high[n] > greatest) greatest = rows.high[n];
    }
  }
  if (least > greatest) return [0, 1];
  const room = Math.max(0.06 * (greatest - least), 0.5 * (span - greatest + least));
  return [least - room, greatest + room];
}

// A proper minus, and none before zero.
function signed(text) {
  return text.replace(/^-(0(\.0*)?)$/, "$1").replace("-", "−");
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
