// Attitude indicator, tapes and wings on canvases; angles in rad.

const DEGREE = Math.PI / 180;
const TURN = 2 * Math.PI;
const finite = (value) => typeof value === "number" && Number.isFinite(value);
const text = (value, digits, unit = "") => (finite(value) ? `${value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1").replace("-", "−")}${unit}` : "–");

// Context of a canvas whose unit is a pixel of the page, cleared; null while it has no size.
function surface(canvas) {
  const width = canvas.clientWidth, height = canvas.clientHeight, ratio = window.devicePixelRatio || 1;
  if (!width || !height) return null;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = font(12);
  return { pen, width, height };
}

const font = (size, weight = 400) => `${weight} ${size}px system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif`;

function line(pen, ...points) {
  pen.beginPath();
  for (const [x, y] of points) pen.lineTo(x, y);
  pen.stroke();
}

function label(pen, words, x, y, align = "center", baseline = "middle") {
  pen.textAlign = align;
  pen.textBaseline = baseline;
  pen.fillText(words, x, y);
}

function clipped(pen, x, y, width, height, draw) {
  pen.save();
  pen.beginPath();
  pen.rect(x, y, width, height);
  pen.clip();
  draw();
  pen.restore();
}

function instruments(canvas, state) {
  const drawn = surface(canvas);
  if (!drawn) return;
  const { pen, width, height } = drawn, side = width < 420 ? 58 : 72, below = 36;
  horizon(pen, side, 0, width - 2 * side, height - below, state);
  tape(pen, 0, 0, side, height - below, {
    value: state.airspeed, label: "m/s", name: "airspeed", step: 1, every: 2, scale: 22, digits: 1, left: true,
  });
  tape(pen, width - side, 0, side, height - below, {
    value: state.altitude, setpoint: state.altitude_setpoint, label: "m", name: "altitude", step: 5, every: 2, scale: 4, digits: 1,
  });
  compass(pen, 0, height - below, width, below, state);
}

function horizon(pen, x, y, width, height, { roll, pitch }) {
  const middle = [x + width / 2, y + height / 2], perDegree = height / 60;
  clipped(pen, x, y, width, height, () => {
    if (!finite(roll) || !finite(pitch)) {
      pen.fillStyle = color("grid");
      pen.fillRect(x, y, width, height);
      pen.fillStyle = color("dim");
      label(pen, "no attitude", ...middle);
      return;
    }
    pen.translate(...middle);
    pen.rotate(-roll);
    const far = width + height, drop = (pitch / DEGREE) * perDegree;
    pen.fillStyle = color("above");
    pen.fillRect(-far, -far + drop, 2 * far, far);
    pen.fillStyle = color("below");
    pen.fillRect(-far, drop, 2 * far, far);
    pen.strokeStyle = pen.fillStyle = "#fff";
    pen.lineWidth = 1.5;
    line(pen, [-far, drop], [far, drop]);
    pen.font = font(11);
    for (let degrees = -90; degrees <= 90; degrees += 5) {
      const at = drop - degrees * perDegree, half = degrees % 10 ? 14 : 30;
      if (!degrees || Math.abs(at) > 0.38 * height) continue;
      pen.lineWidth = 1;
      line(pen, [-half, at], [half, at]);
      if (degrees % 10) continue;
      label(pen, text(degrees, 0), half + 4, at, "left");
      label(pen, text(degrees, 0), -half - 4, at, "right");
    }
    const radius = Math.min(width, height) * 0.46;
    pen.lineWidth = 1.5;
    for (const degrees of [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60]) {
      const a = degrees * DEGREE - Math.PI / 2, long = degrees % 30 ? 6 : 11;
      line(pen, [radius * Math.cos(a), radius * Math.sin(a)], [(radius - long) * Math.cos(a), (radius - long) * Math.sin(a)]);
    }
    pen.rotate(roll);
    pen.fillStyle = pen.strokeStyle = "#ffd34d";
    pen.beginPath();
    pen.moveTo(0, -radius + 13);
    pen.lineTo(-6, -radius + 24);
    pen.lineTo(6, -radius + 24);
    pen.fill();
    pen.lineWidth = 3;
    line(pen, [-52, 0], [-20, 0], [-12, 9]);
    line(pen, [52, 0], [20, 0], [12, 9]);
    pen.fillRect(-2, -2, 4, 4);
  });
}

function tape(pen, x, y, width, height, { value, setpoint, label: unit, name, step, every, scale, digits, left }) {
  const middle = y + height / 2, edge = left ? x + width : x, inward = left ? -1 : 1;
  pen.fillStyle = color("page");
  pen.fillRect(x, y, width, height);
  clipped(pen, x, y, width, height, () => {
    pen.strokeStyle = color("dim");
    pen.lineWidth = 1;
    pen.font = font(11);
    if (finite(value)) {
      const first = Math.ceil((value - height / 2 / scale) / step), last = Math.floor((value + height / 2 / scale) / step);
      for (let n = first; n <= last; n += 1) {
        const at = middle - (n * step - value) * scale, named = n % every === 0;
        if (left && n < 0) continue;
        line(pen, [edge, at], [edge + inward * (named ? 9 : 5), at]);
        pen.fillStyle = color("dim");
        if (named && Math.abs(at - middle) > 18) label(pen, text(n * step, 0), edge + inward * 13, at, left ? "right" : "left");
      }
    }
    if (finite(value) && finite(setpoint)) {
      const at = middle - Math.max(-height / 2 + 4, Math.min(height / 2 - 4, (setpoint - value) * scale));
      pen.fillStyle = color("setpoint");
      pen.beginPath();
      pen.moveTo(edge, at);
      pen.lineTo(edge + inward * 10, at - 6);
      pen.lineTo(edge + inward * 10, at + 6);
      pen.fill();
    }
    pen.fillStyle = color("page");
    pen.fillRect(x, y, width, 17);
    pen.fillRect(x, y + height - 16, width, 16);
    pen.fillStyle = color("dim");
    label(pen, name, x + width / 2, y + 9);
    label(pen, unit, x + width / 2, y + height - 8);
  });
  pen.fillStyle = color("ink");
  pen.beginPath();
  pen.moveTo(edge, middle);
  pen.lineTo(edge + inward * 8, middle - 13);
  pen.lineTo(edge + inward * (width - 1), middle - 13);
  pen.lineTo(edge + inward * (width - 1), middle + 13);
  pen.lineTo(edge + inward * 8, middle + 13);
  pen.fill();
  pen.fillStyle = color("page");
  pen.font = font(16, 600);
  label(pen, text(value, digits), edge + inward * (width / 2 + 3), middle + 0.5);
}

function compass(pen, x, y, width, height, { yaw, heading_setpoint: setpoint }) {
  const scale = width / 120, middle = x + width / 2, names = { 0: "N", 90: "E", 180: "S", 270: "W" };
  pen.fillStyle = color("card");
  pen.fillRect(x, y, width, height);
  if (!finite(yaw)) return;
  const heading = yaw / DEGREE;
  pen.strokeStyle = color("dim");
  pen.lineWidth = 1;
  clipped(pen, x, y, width, height, () => {
    for (let degrees = Math.ceil((heading - 60) / 5) * 5; degrees <= heading + 60; degrees += 5) {
      const at = middle + (degrees - heading) * scale, named = degrees % 30 === 0, point = ((degrees % 360) + 360) % 360;
      line(pen, [at, y], [at, y + (named ? 8 : 4)]);
      if (!named || Math.abs(at - middle) < 40) continue;
      pen.fillStyle = color(point in names ? "ink" : "dim");
      pen.font = font(12, point in names ? 600 : 400);
      label(pen, names[point] ?? String(point).padStart(3, "0"), at, y + 20);
    }
    if (finite(setpoint)) {
      const away = Math.atan2(Math.sin(setpoint - yaw), Math.cos(setpoint - yaw)) / DEGREE;
      const at = middle + Math.max(-58, Math.min(58, away)) * scale;
      pen.fillStyle = color("setpoint");
      pen.beginPath();
      pen.moveTo(at, y);
      pen.lineTo(at - 6, y + 10);
      pen.lineTo(at + 6, y + 10);
      pen.fill();
    }
  });
  pen.fillStyle = color("ink");
  pen.fillRect(middle - 27, y + 9, 54, 24);
  pen.fillStyle = color("page");
  pen.font = font(15, 600);
  label(pen, `${String(((Math.round(heading) % 360) + 360) % 360).padStart(3, "0")}°`, middle + 2, y + 21.5);
}

// Wings from behind at the phase, and the phase on a circle; 0 is the upward crossing of the stroke's middle.
function wings(canvas, state, phase) {
  const drawn = surface(canvas);
  if (!drawn) return;
  const { pen, width, height } = drawn, dial = Math.min(0.36 * height, 0.13 * width);
  const across = width - 2 * dial - 44, half = Math.min(0.44 * across, 0.62 * height), root = [across / 2 + 6, 0.55 * height];
  pen.fillStyle = color("dim");
  if (!finite(state.flap_left) || !finite(state.flap_right)) {
    label(pen, "no wing angles", width / 2, height / 2);
    return;
  }
  const flapping = phase !== null && finite(state.flap_amplitude);
  const middleAngle = state.flap_mean ?? 0, swing = state.flap_amplitude;
  const angles = flapping ? Array(2).fill(middleAngle + swing * Math.sin(phase)) : [state.flap_left, state.flap_right];
  const tip = (side, angle) => [root[0] + side * half * Math.cos(angle), root[1] - half * Math.sin(angle)];
  if (flapping) {
    pen.fillStyle = color("shade");
    for (const side of [-1, 1]) {
      pen.beginPath();
      pen.moveTo(...root);
      const start = side < 0 ? Math.PI + middleAngle : -middleAngle;
      pen.arc(...root, half, start - swing, start + swing);
      pen.fill();
    }
  }
  pen.lineWidth = 4;
  pen.lineCap = "round";
  for (const [side, angle, name] of [[-1, angles[0], "left"], [1, angles[1], "right"]]) {
    pen.strokeStyle = color(name);
    line(pen, root, tip(side, angle));
  }
  pen.fillStyle = color("hull");
  pen.beginPath();
  pen.ellipse(...root, 9, 12, 0, 0, TURN);
  pen.fill();
  const middle = [width - dial - 22, 0.45 * height];
  pen.strokeStyle = color("line");
  pen.lineWidth = 2;
  pen.beginPath();
  pen.arc(...middle, dial, 0, TURN);
  pen.stroke();
  if (phase !== null) {
    pen.fillStyle = color("cursor");
    pen.beginPath();
    pen.arc(middle[0] + dial * Math.cos(phase), middle[1] - dial * Math.sin(phase), 6, 0, TURN);
    pen.fill();
  }
  pen.fillStyle = color("ink");
  pen.font = font(15, 600);
  label(pen, text(state.flap_frequency, 2), ...middle);
  pen.fillStyle = color("dim");
  pen.font = font(11);
  label(pen, "Hz", middle[0], middle[1] + 14);
  label(pen, "phase", middle[0], height - 10);
  label(pen, `stroke ±${text((state.flap_amplitude ?? NaN) / DEGREE, 0, "°")}`, 8, 13, "left");
}
