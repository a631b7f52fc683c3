"use strict";
// Colors, numbers and axes of all plots.

const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const FONT = '11px system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif';

// Numbers with the digits that the distance of the ticks needs.
function tickText(values, step) {
  let digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  // A step of 2.5 needs one more.
  if (Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6) digits += 1;
  const largest = Math.max(...values.map(Math.abs));
  const exponent = digits > 4 || largest >= 1e6;
  return values.map((value) => {
    if (Math.abs(value) < 1e-9 * step) return "0";
    if (exponent) return value.toExponential(Math.max(0, Math.floor(Math.log10(Math.abs(value))) + digits)).replace("e+", "e").replaceAll("-", "−");
    return value.toFixed(digits).replace("-", "−");
  });
}

const shortNumber = (value) => (value == null ? "–" : String(Number(value.toPrecision(4))).replace("-", "−"));

const axis = (side) => ({
  stroke: () => color("dim"),
  font: FONT,
  grid: { stroke: () => color("grid"), width: 1 },
  ticks: { stroke: () => color("grid"), width: 1, size: 4 },
  gap: 3,
  space: side === "x" ? 60 : 30,
  size: side === "x" ? 24 : (u, values) => 12 + 6.3 * Math.max(...(values || ["0"]).map((text) => text.length)),
  values: (u, splits, place, space, step) => tickText(splits, step),
});
