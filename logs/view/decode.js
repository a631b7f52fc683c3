// From the page's text back to columns; packing.py is the way here.

async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(plain).arrayBuffer());
}

function whole16(bytes, at, count, take) {
  for (let n = 0, sum = 0; n < count; n++) {
    sum = (sum + (bytes[at + n] | (bytes[at + count + n] << 8))) << 16 >> 16;
    take(n, sum, sum === -32768);
  }
}

function whole32(bytes, at, count, take) {
  const [b, c, d] = [at + count, at + 2 * count, at + 3 * count];
  for (let n = 0, sum = 0; n < count; n++) {
    sum = (sum + (bytes[at + n] | (bytes[b + n] << 8) | (bytes[c + n] << 16) | (bytes[d + n] << 24))) | 0;
    take(n, sum, sum === -2147483648);
  }
}

// Differences were stored: their running sum is the column.
function column(bytes, where) {
  const out = where.width === 4 ? new Float64Array(where.count) : new Float32Array(where.count);
  const take = (n, sum, absent) => { out[n] = absent ? NaN : where.middle + where.step * sum; };
  (where.width === 4 ? whole32 : whole16)(bytes, where.at, where.count, take);
  return out;
}

// The last index whose time is not after t, at least 0.
function indexAt(time, t) {
  let low = 0, high = time.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (time[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

// Index and share of the way to the next sample.
function between(time, t) {
  const n = indexAt(time, t), next = Math.min(n + 1, time.length - 1);
  const span = time[next] - time[n];
  return [n, next, span > 0 ? Math.min(1, Math.max(0, (t - time[n]) / span)) : 0];
}

function valueAt(time, values, t) {
  const [n, next, share] = between(time, t);
  return values[n] + share * (values[next] - values[n]);
}

const CONDENSED = 4;

// Coarser and coarser copies: each row is the least, the greatest and the mean of four rows of the one before.
function levels(time, low, high) {
  const out = [{ time, low, high, mean: low === high ? low : low.map((value, n) => 0.5 * (value + high[n])) }];
  while (out.at(-1).time.length > 2000) out.push(condensed(out.at(-1)));
  return out;
}

function condensed({ time, low, high, mean }) {
  const count = Math.ceil(time.length / CONDENSED);
  const out = { time: new Float64Array(count) };
  for (const name of ["low", "high", "mean"]) out[name] = new Float32Array(count);
  for (let n = 0; n < count; n++) {
    const from = n * CONDENSED, to = Math.min(from + CONDENSED, time.length);
    let least = Infinity, greatest = -Infinity, sum = 0, there = 0;
    for (let m = from; m < to; m++) {
      if (low[m] < least) least = low[m];
      if (high[m] > greatest) greatest = high[m];
      if (!Number.isNaN(mean[m])) { sum += mean[m]; there++; }
    }
    out.mean[n] = there ? sum / there : NaN;
    out.time[n] = time[(from + to) >> 1 < time.length ? (from + to) >> 1 : from];
    out.low[n] = least <= greatest ? least : NaN;
    out.high[n] = least <= greatest ? greatest : NaN;
  }
  return out;
}
