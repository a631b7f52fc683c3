// Track and mission from above, north up, equal scales; positions in m from home.

function track(canvas, rows, mission, state) {
  const drawn = surface(canvas);
  if (!drawn) return;
  const { pen, width, height } = drawn;
  const here = finite(state.north) && finite(state.east) ? [[state.north, state.east]] : [];
  const places = mission.map((item, number) => ({ ...item, number })).filter((item) => finite(item.north) && finite(item.east));
  const points = [[0, 0], ...rows, ...here, ...places.map((item) => [item.north, item.east])];
  let [south, north, west, east] = [0, 0, 0, 0];
  for (const [n, e] of points) {
    south = Math.min(south, n);
    north = Math.max(north, n);
    west = Math.min(west, e);
    east = Math.max(east, e);
  }
  const scale = Math.min((width - 60) / Math.max(east - west, 40), (height - 70) / Math.max(north - south, 40));
  const x = (e) => width / 2 + (e - (west + east) / 2) * scale, y = (n) => height / 2 - (n - (south + north) / 2) * scale;

  const step = niceStep(70 / scale);
  pen.strokeStyle = color("grid");
  pen.lineWidth = 1;
  const left = (west + east) / 2 - width / 2 / scale, bottom = (south + north) / 2 - height / 2 / scale;
  for (let e = Math.ceil(left / step) * step; x(e) < width; e += step) line(pen, [x(e), 0], [x(e), height]);
  for (let n = Math.ceil(bottom / step) * step; y(n) > 0; n += step) line(pen, [0, y(n)], [width, y(n)]);

  pen.strokeStyle = color("ahead");
  pen.lineWidth = 1.5;
  pen.setLineDash([5, 4]);
  line(pen, ...places.map((item) => [x(item.east), y(item.north)]));
  pen.setLineDash([]);
  pen.strokeStyle = color("flown");
  pen.lineWidth = 2;
  line(pen, ...rows.map(([n, e]) => [x(e), y(n)]));

  pen.fillStyle = color("ink");
  pen.font = font(17);
  label(pen, "⌂", x(0), y(0));
  for (const { number, north: n, east: e } of places) {
    const active = number === state.item;
    pen.fillStyle = color(active ? "accent" : "card");
    pen.strokeStyle = color(active ? "accent" : "dim");
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.arc(x(e), y(n), 9, 0, TURN);
    pen.fill();
    pen.stroke();
    pen.fillStyle = color(active ? "card" : "ink");
    pen.font = font(11, 600);
    label(pen, String(number), x(e), y(n) + 0.5);
  }
  if (here.length) {
    pen.save();
    pen.translate(x(state.east), y(state.north));
    pen.rotate(state.yaw ?? 0);
    pen.fillStyle = color("cursor");
    pen.strokeStyle = color("card");
    pen.beginPath();
    for (const [right, up] of [[0, 13], [8, -9], [0, -4], [-8, -9]]) pen.lineTo(right, -up);
    pen.closePath();
    pen.fill();
    pen.stroke();
    pen.restore();
  } else {
    pen.fillStyle = color("dim");
    pen.font = font(13);
    label(pen, "no position", width / 2, 24);
  }
  pen.strokeStyle = pen.fillStyle = color("dim");
  pen.lineWidth = 2;
  pen.font = font(11);
  line(pen, [12, height - 12], [12 + step * scale, height - 12]);
  label(pen, `${step} m`, 12, height - 23, "left");
  line(pen, [width - 16, 30], [width - 16, 12], [width - 20, 17]);
  label(pen, "N", width - 16, 39);
}

// The next of 1, 2, 5 times a power of ten.
function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= least);
}
