// Draws the plots of a page with uPlot from its JSON data; see `logs.pages.plots.plot_data`.

// At least twice the pixels of a screen, for paper. uPlot, which follows, reads the ratio when it loads.
{
  const native = window.devicePixelRatio || 1;
  Object.defineProperty(window, "devicePixelRatio", { configurable: true, get: () => Math.max(2, native) });
}

document.addEventListener("DOMContentLoaded", () => {
  const PRINT = { wide: [703, 140], narrow: [229, 130] };
  const SCREEN = { wide: 230, narrow: 195 };
  function line({ label, role, style }) {
    const known = { label, value: (u, value) => shortNumber(value) };
    const stroke = () => color(role), fill = () => `${color(role)}59`;
    if (style === "points") {
      const dots = { show: true, size: 4, stroke: () => `${color(role)}90`, fill: () => `${color(role)}70` };
      return { ...known, stroke, paths: () => null, points: dots };
    }
    const none = { points: { show: false } };
    if (style === "stems") return { ...known, ...none, stroke, fill: stroke, paths: uPlot.paths.bars({ size: [0.3, 3] }) };
    if (style === "steps") return { ...known, ...none, stroke, fill, width: 0.6, paths: uPlot.paths.stepped({ align: 1 }) };
    return { ...known, ...none, stroke, width: 1.4, dash: style === "dashed" ? [5, 4] : undefined };
  }

  // One table of all columns over a common x; a missing sample of another column is no gap.
  function table({ columns, series, bands }) {
    const parts = series.map(({ x, y }) => [columns[x], columns[y]]);
    for (const { x, low, high } of bands) parts.push([columns[x], columns[high], columns[low]]);
    return uPlot.join(parts, parts.map((part) => part.map(() => 2)));
  }

  function marked(u, marks) {
    const { ctx, bbox } = u, ratio = devicePixelRatio;
    ctx.save();
    ctx.strokeStyle = color("line");
    ctx.fillStyle = color("dim");
    ctx.font = `${10 * ratio}px system-ui, sans-serif`;
    ctx.textBaseline = "top";
    ctx.textAlign = "left";
    let end = -Infinity;
    for (const [x, label] of marks) {
      const at = u.valToPos(x, "x", true);
      if (at < bbox.left || at > bbox.left + bbox.width) continue;
      ctx.beginPath();
      ctx.moveTo(at, bbox.top);
      ctx.lineTo(at, bbox.top + bbox.height);
      ctx.stroke();
      if (at < end) continue;
      ctx.fillText(label, at + 3 * ratio, bbox.top + ratio);
      end = at + ctx.measureText(label).width + 8 * ratio;
    }
    ctx.restore();
  }

  function build(element, data) {
    const first = 1 + data.series.length;
    const bands = data.bands.map((_, n) => ({ series: [first + 2 * n, first + 2 * n + 1], fill: () => color("shade") }));
    const edges = data.bands.flatMap(({ label }) => [label, ""]).map((label) => ({
      label, value: (u, value) => shortNumber(value), points: { show: false },
    }));
    const below = document.createElement("div");
    below.className = "x";
    const place = (u) => {
      const { idx } = u.cursor;
      below.textContent = idx == null ? data.x : `${data.x}: ${shortNumber(u.data[0][idx])}`;
    };
    const named = data.series.some(({ label }) => label) || data.bands.some(({ label }) => label);
    const plot = new uPlot({
      width: element.clientWidth || 340,
      height: height(element),
      scales: { x: { time: false } },
      axes: [axis("x"), axis("y")],
      series: [{}, ...data.series.map(line), ...edges],
      bands,
      legend: { show: named, live: true, markers: { show: false } },
      cursor: { sync: { key: data.sync, setSeries: false }, points: { size: 5 }, y: false },
      padding: [6, 16, 0, 0],
      hooks: { draw: [(u) => marked(u, data.marks)], ready: [place], setCursor: [place] },
    }, table(data), element);
    const kinds = data.series.map(({ role, style, label }) => [role, style, label ? "named" : "unnamed"]);
    const classes = [["axis"], ...kinds, ...edges.map(({ label }) => ["band", label ? "named" : "unnamed"])];
    plot.root.querySelectorAll(".u-series").forEach((row, n) => row.classList.add(...classes[n]));
    element.append(below);
    return plot;
  }

  const shape = (element) => (element.closest("figure").classList.contains("wide") ? "wide" : "narrow");
  const height = (element) => SCREEN[shape(element)];

  const all = JSON.parse(document.getElementById("plots").textContent);
  const made = [...document.querySelectorAll("[data-plot]")].map((element) => [element, build(element, all[Number(element.dataset.plot)])]);
  const fit = () => {
    for (const [element, plot] of made) plot.setSize({ width: element.clientWidth || 340, height: height(element) });
  };
  let waiting = 0;
  // A scroll bar changes the width without a resize of the window.
  new ResizeObserver(() => {
    cancelAnimationFrame(waiting);
    if (!document.documentElement.classList.contains("print")) waiting = requestAnimationFrame(fit);
  }).observe(document.querySelector("main"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", fit);
  window.addEventListener("beforeprint", () => {
    document.documentElement.classList.add("print");
    for (const [element, plot] of made) {
      const [width, high] = PRINT[shape(element)];
      plot.setSize({ width, height: high });
    }
  });
  window.addEventListener("afterprint", () => {
    document.documentElement.classList.remove("print");
    fit();
  });
  window.plots = made.map(([, plot]) => plot);
});
