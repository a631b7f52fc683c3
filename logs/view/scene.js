// The bird along its track, drawn with the painter's algorithm: x east, y north, z up; the bird's x forward, y left, z up.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => times(a, 1 / (Math.hypot(...a) || 1));
const NEAR = 0.05, LINES = 18, NEARBY = 8;

function turned([w, x, y, z], v) {
  const t = times(cross([x, y, z], v), 2);
  return add(add(v, times(t, w)), cross([x, y, z], t));
}

// As logs.scene: flap about x, then half the tip's twist about the span.
function wingTurn(flap, twist, side) {
  const a = 0.5 * side * flap, b = -0.25 * twist;
  return [Math.cos(a) * Math.cos(b), Math.sin(a) * Math.cos(b), Math.cos(a) * Math.sin(b), Math.sin(a) * Math.sin(b)];
}

function tailTurn(elevator, rudder) {
  const a = 0.5 * rudder, b = 0.5 * elevator;
  return [Math.cos(a) * Math.cos(b), -Math.sin(a) * Math.sin(b), Math.cos(a) * Math.sin(b), Math.sin(a) * Math.cos(b)];
}

// A column of rows that may be absent, interpolated at t.
function rowsAt(source, rows, t) {
  const [n, next, share] = between(source.time, t);
  return rows.map((row) => row[n] + share * (row[next] - row[n]));
}

function poseAt(motion, t) {
  const { body, wings } = motion;
  const inside = wings && t >= wings.time[0] && t <= wings.time.at(-1);
  return {
    place: rowsAt(body, body.place, t),
    quaternion: normed(rowsAt(body, body.quaternion, t)),
    tail: rowsAt(body, body.tail, t),
    flap: inside ? rowsAt(wings, wings.flap, t) : [0, 0],
    twist: inside ? rowsAt(wings, wings.twist, t) : [0, 0],
  };
}

function normed(q) {
  const size = Math.hypot(...q) || 1;
  return q.map((part) => part / size);
}

// Faces of the bird in its own axes, each with the name of its colour.
function faces(shape, pose) {
  const right = [shape.hinge[0], -shape.hinge[1], shape.hinge[2]];
  const frames = {
    left_wing: [shape.hinge, wingTurn(pose.flap[0], pose.twist[0], 1), "left"],
    right_wing: [right, wingTurn(pose.flap[1], pose.twist[1], -1), "right"],
    tail: [shape.tail, tailTurn(...pose.tail), "tail"],
  };
  const out = hull(shape);
  for (const [name, [origin, turn, color]] of Object.entries(frames)) {
    for (const plate of shape.plates[name]) {
      out.push({ color, points: plate.map((corner) => add(origin, turned(turn, corner))) });
    }
  }
  return out;
}

// The fuselage: a body of its radius ahead, a boom to the tail.
function hull(shape) {
  const length = shape.nose - shape.tail[0], out = [], sides = 10;
  const profile = [[0, 0.04], [0.04, 0.42], [0.12, 0.76], [0.24, 1], [0.4, 0.92], [0.55, 0.55], [0.7, 0.22], [1, 0.1]];
  const rings = profile.map(([along, wide]) => Array.from({ length: sides }, (_, k) => [
    shape.nose - along * length,
    0.8 * shape.body * wide * Math.cos(2 * k * Math.PI / sides),
    shape.body * wide * Math.sin(2 * k * Math.PI / sides),
  ]));
  for (let r = 0; r + 1 < rings.length; r++) {
    for (let k = 0; k < sides; k++) {
      const next = (k + 1) % sides;
      out.push({ color: "hull", points: [rings[r][k], rings[r][next], rings[r + 1][next], rings[r + 1][k]] });
    }
  }
  return out;
}

class Scene {
  constructor(canvas, flight, colors) {
    Object.assign(this, { canvas, colors, shape: flight.shape, motion: flight.motion });
    this.track = thinTrack(flight.motion.body, 6000);
    this.estimated = flight.motion.estimated && thinTrack(flight.motion.estimated, 6000);
    this.box = bounds(this.track.points);
    this.mode = "follow";
    this.azimuth = -2.2;
    this.elevation = 0.32;
    this.distance = 5.5 * this.shape.semispan + 2.0;
    this.target = [0, 0, 0];
    this.yaw = null;
    this.listen();
  }

  listen() {
    const { canvas } = this, held = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      held.set(event.pointerId, [event.clientX, event.clientY]);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => held.delete(e.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!held.has(event.pointerId)) return;
      const before = [...held.values()];
      const [x, y] = held.get(event.pointerId);
      held.set(event.pointerId, [event.clientX, event.clientY]);
      if (held.size === 2) this.pinch(before, [...held.values()]);
      else if (event.shiftKey || event.buttons === 2) this.shift(event.clientX - x, event.clientY - y);
      else this.orbit(event.clientX - x, event.clientY - y);
    });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(0.0015 * event.deltaY));
    }, { passive: false });
  }

  orbit(dx, dy) {
    this.azimuth -= 0.007 * dx;
    this.elevation = Math.min(1.55, Math.max(-0.3, this.elevation + 0.007 * dy));
    this.draw();
  }

  shift(dx, dy) {
    const { right, up } = this.axes(), scale = this.distance / this.focal();
    if (this.mode !== "overview") this.choose("free");
    this.target = add(this.target, add(times(right, -dx * scale), times(up, dy * scale)));
    this.draw();
  }

  pinch(before, after) {
    const size = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);
    this.zoom(size(before) / Math.max(1, size(after)));
  }

  zoom(factor) {
    this.distance = Math.min(20 * this.box.size + 50, Math.max(1.5 * this.shape.semispan, this.distance * factor));
    this.draw();
  }

  choose(mode) {
    if (mode === "overview") {
      this.target = this.box.middle;
      this.distance = 1.15 * this.box.size + 4 * this.shape.semispan;
      this.elevation = Math.max(this.elevation, 0.45);
    } else if (this.mode === "overview" && mode !== "free") {
      this.distance = 5.5 * this.shape.semispan + 2.0;
    }
    this.mode = mode;
    this.yaw = null;
    this.draw();
  }

  // Move to time t.
  show(t) {
    this.time = t;
    this.pose = poseAt(this.motion, t);
    const { place, quaternion } = this.pose;
    if (this.mode === "follow" || this.mode === "chase") this.target = place;
    const nose = turned(quaternion, [1, 0, 0]), yaw = Math.atan2(nose[1], nose[0]);
    if (this.mode === "chase") {
      if (this.yaw !== null) this.azimuth += Math.atan2(Math.sin(yaw - this.yaw), Math.cos(yaw - this.yaw));
      else this.azimuth = yaw + Math.PI - 0.35;
      this.yaw = yaw;
    }
    this.draw();
  }

  axes() {
    const [ca, sa] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
    const [ce, se] = [Math.cos(this.elevation), Math.sin(this.elevation)];
    return { right: [-sa, ca, 0], up: [-se * ca, -se * sa, ce], ahead: [-ce * ca, -ce * sa, -se] };
  }

  focal() { return 1.1 * Math.min(this.height, this.width); }

  draw() {
    if (!this.pose) return;
    const { context, width, height } = sized(this.canvas);
    Object.assign(this, { context, width, height }, this.axes());
    this.eye = add(this.target, times(this.ahead, -this.distance));
    context.fillStyle = this.colors.sky;
    context.fillRect(0, 0, width, height);
    this.drawGround();
    this.drawTrack();
    this.drawBird();
    this.drawNorth();
  }

  // Right, up and ahead of the eye.
  seen(point) {
    const p = sub(point, this.eye);
    return [dot(p, this.right), dot(p, this.up), dot(p, this.ahead)];
  }

  placed([x, y, depth]) {
    const scale = this.focal() / depth;
    return [0.5 * this.width + scale * x, 0.5 * this.height - scale * y];
  }

  // A line through points in space, cut off at the eye.
  trace(points, from = 0, to = points.length - 1) {
    const { context } = this;
    let last = null;
    context.beginPath();
    for (let n = from; n <= to; n++) {
      const next = this.seen(points[n]);
      if (last && (last[2] > NEAR || next[2] > NEAR)) this.piece(last, next, n === from + 1);
      last = next;
    }
    context.stroke();
  }

  piece(a, b, first) {
    const { context } = this;
    if (first || a[2] <= NEAR) context.moveTo(...this.placed(a[2] > NEAR ? a : cut(a, b)));
    context.lineTo(...this.placed(b[2] > NEAR ? b : cut(b, a)));
  }

  drawGround() {
    const { context, colors } = this;
    const step = tidy(Math.max(this.distance, Math.abs(this.target[2])) / 5);
    const x0 = Math.round(this.target[0] / step) * step, y0 = Math.round(this.target[1] / step) * step;
    context.lineWidth = 1;
    context.strokeStyle = colors.ground;
    for (let k = -LINES; k <= LINES; k++) {
      context.globalAlpha = 0.9 * (1 - Math.abs(k) / (LINES + 1));
      for (const side of [-1, 1]) {
        this.trace([[x0 + k * step, y0, 0], [x0 + k * step, y0 + side * LINES * step, 0]]);
        this.trace([[x0, y0 + k * step, 0], [x0 + side * LINES * step, y0 + k * step, 0]]);
      }
    }
    context.globalAlpha = 1;
    this.step = step;
  }

  // The thinned track between two times.
  coarse(from, to) {
    const { time, points } = this.track;
    const first = from <= time[0] ? 0 : indexAt(time, from) + 1;
    const after = to >= time.at(-1) ? time.length : indexAt(time, to);
    return points.slice(first, Math.max(first, after));
  }

  // Every point of the track between two times: around the bird a thinned one would miss it.
  fine(from, to) {
    const { time, place } = this.motion.body, out = [];
    for (let n = indexAt(time, from); n < time.length && time[n] <= to; n++) {
      if (time[n] > from) out.push(place.map((row) => row[n]));
    }
    return out;
  }

  drawTrack() {
    const { context, colors } = this;
    context.lineJoin = "round";
    if (this.estimated) {
      context.lineWidth = 1.2;
      context.strokeStyle = colors.estimate;
      context.globalAlpha = 0.7;
      context.setLineDash([4, 4]);
      this.trace(this.estimated.points);
      context.setLineDash([]);
      context.globalAlpha = 1;
    }
    context.lineWidth = 1.5;
    context.strokeStyle = colors.ahead;
    const [before, later] = [this.time - NEARBY, this.time + NEARBY];
    this.trace([this.pose.place, ...this.fine(this.time, later), ...this.coarse(later, Infinity)]);
    context.lineWidth = 2.5;
    context.strokeStyle = colors.flown;
    this.trace([...this.coarse(-Infinity, before), ...this.fine(before, this.time), this.pose.place]);
    const [x, y] = this.pose.place;
    context.lineWidth = 1;
    context.strokeStyle = colors.dim;
    context.setLineDash([3, 3]);
    this.trace([this.pose.place, [x, y, 0]]);
    context.setLineDash([]);
  }

  // Far away it is drawn larger than it is, and that is said.
  drawBird() {
    const depth = Math.max(NEAR, this.seen(this.pose.place)[2]);
    const size = this.focal() * 2 * this.shape.semispan / depth;
    this.enlarged = Math.max(1, 64 / size);
    const drawn = faces(this.shape, this.pose).map(({ color, points }) => ({
      color,
      points: points.map((p) => add(this.pose.place, turned(this.pose.quaternion, times(p, this.enlarged)))),
    }));
    for (const { points } of drawn) this.fill(points.map(([x, y]) => [x, y, 0]), this.colors.shadow, null);
    const eyes = drawn.map((face) => ({ ...face, depth: face.points.reduce((s, p) => s + this.seen(p)[2], 0) / 4 }));
    eyes.sort((a, b) => b.depth - a.depth);
    for (const { color, points } of eyes) this.fill(points, this.colors[color], shade(points), color !== "hull");
  }

  fill(points, color, light, edged) {
    const { context } = this, seen = points.map((p) => this.seen(p));
    if (seen.some((p) => p[2] <= NEAR)) return;
    context.beginPath();
    seen.forEach((p, n) => context[n ? "lineTo" : "moveTo"](...this.placed(p)));
    context.closePath();
    context.fillStyle = color;
    context.fill();
    if (light === null) return;
    context.fillStyle = light < 0 ? `rgba(0,0,0,${-light})` : `rgba(255,255,255,${light})`;
    context.fill();
    if (!edged) return;
    context.lineWidth = 1;
    context.strokeStyle = this.colors.hull;
    context.stroke();
  }

  drawNorth() {
    const { context, colors } = this, middle = [this.width - 34, this.height - 34];
    const north = [this.right[1], -this.up[1]], size = Math.hypot(...north) || 1;
    const tip = [middle[0] + 18 * north[0], middle[1] + 18 * north[1]];
    context.strokeStyle = context.fillStyle = colors.dim;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(middle[0] - 12 * north[0], middle[1] - 12 * north[1]);
    context.lineTo(...tip);
    context.stroke();
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText("N", tip[0] + 9 * north[0] / size, tip[1] + 9 * north[1] / size);
  }
}

// Where a line from in front of the eye to behind it leaves the visible space.
function cut(behind, front) {
  const share = (NEAR - behind[2]) / (front[2] - behind[2]);
  return behind.map((part, k) => (k === 2 ? NEAR * 1.0001 : part + share * (front[k] - part)));
}

// Light falls from above and a little from the south-west, on both faces.
function shade(points) {
  const normal = unit(cross(sub(points[1], points[0]), sub(points[2], points[0])));
  return 0.42 * Math.abs(dot(normal, [-0.3, -0.4, 0.866])) - 0.26;
}

function thinTrack(source, limit) {
  const every = Math.max(1, Math.ceil(source.time.length / limit)), points = [], time = [];
  for (let n = 0; n < source.time.length; n += every) {
    time.push(source.time[n]);
    points.push(source.place.map((row) => row[n]));
  }
  return { time, points };
}

function bounds(points) {
  const low = [Infinity, Infinity, 0], high = [-Infinity, -Infinity, 0];
  for (const p of points) {
    for (let k = 0; k < 3; k++) {
      low[k] = Math.min(low[k], p[k]);
      high[k] = Math.max(high[k], p[k]);
    }
  }
  return { middle: times(add(low, high), 0.5), size: Math.max(2, Math.hypot(...sub(high, low))) };
}

// 1, 2 or 5 times a power of ten, not below x.
function tidy(x) {
  const power = 10 ** Math.floor(Math.log10(x));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= x * 0.999);
}

// The canvas with as many pixels as the screen has, in units of CSS.
function sized(canvas) {
  const ratio = window.devicePixelRatio || 1, { clientWidth: width, clientHeight: height } = canvas;
  const [across, down] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== across || canvas.height !== down) [canvas.width, canvas.height] = [across, down];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height };
}
